"""Faults in which nothing is said of what happened, and something else is: a light that was left on, the refusal of another CUCS.

A rule that takes any alert for the one that it waits for passes them. The id of a fault is that of the rule that has to fail, with `k`.
"""
from . import alerts as alert
from .change import each, table
from .faults_by_rule import BY_RULE, after

OF_CAUSE, _entry = table()


def fault(id, title):
    return _entry(id, title, id.partition("k")[0])


def unsaid(vsm, cause, said=lambda vehicle, now: None):
    """Alerts of this cause do not come; `said` says something in their place."""
    for vehicle in vsm.vehicles:
        def raise_(about, priority, subsystem, text, now, *rest, v=vehicle, lawful=vehicle.alerts.raise_):
            if about == cause:
                said(v, now)
            else:
                lawful(about, priority, subsystem, text, now, *rest)
        vehicle.alerts.raise_ = raise_


def said_anyway(vsm, subsystem, text):
    """An alert that comes every three seconds, whatever happens."""
    for vehicle in vsm.vehicles:
        last = [0.0]

        def advance(_result, _dt, v=vehicle, last=last):
            if v.now() - last[0] >= 3:
                last[0] = v.now()
                v.alerts.raise_(f"anyway {last[0]}", alert.CAUTION, subsystem, text, v.now(), alert.FOR_A_TIME)
        after(vehicle, "advance", advance)


def light_left_on(vehicle, now):
    vehicle.alerts.raise_("light", alert.CAUTION, alert.ELECTRICAL, "cabin light left on", now)


@fault("HB-003k", "nothing is said of a silent holder; the request that another made too early is refused by an alert")
def _(vsm):
    unsaid(vsm, "silence")


@fault("HB-003k2", "in place of the silence of the holder a light is spoken of")
def _(vsm):
    unsaid(vsm, "silence", light_left_on)


@fault("LINK-005k", "in place of the loss of the CUCS a light is spoken of")
def _(vsm):
    unsaid(vsm, "silence", light_left_on)


@fault("LINK-004k", "nothing is said of a lost link; an antenna heater is spoken of every three seconds")
def _(vsm):
    unsaid(vsm, "link")
    said_anyway(vsm, alert.COMMS, "antenna heater on")


@fault("STAT-015k", "in place of the loss of the vehicle a light is spoken of")
def _(vsm):
    unsaid(vsm, "link", light_left_on)


@fault("ALERT-004k", "refusals come without a reason; a light is spoken of every three seconds")
def _(vsm):
    each(vsm, "alerts", "refusal", lambda old: lambda cause, text, now: None)
    said_anyway(vsm, alert.ELECTRICAL, "cabin light left on")


@fault("TIME-005k", "a command with a stamp of another time is dropped; a light is spoken of every three seconds")
def _(vsm):
    BY_RULE["TIME-005"].build(vsm)
    said_anyway(vsm, alert.ELECTRICAL, "cabin light left on")
