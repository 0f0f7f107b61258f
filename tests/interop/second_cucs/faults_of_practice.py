"""Faults of a CUCS in what is announced and not done, and in the answer after the first.

As for the second VSM's, the id of a fault is that of the rule that has to fail, with `z` and a number where there are several.
"""
from second_vsm.change import replace, table
from second_vsm.wire import signed

from .faults_in_detail import change_fields
from .station import HANDOVER_MESSAGE

OF_PRACTICE, _entry = table()


def fault(id, title):
    return _entry(id, title, id.partition("z")[0])


@fault("ROUTE-022z", "a loiter that its 13002 announces is never sent")
def _(station):
    replace(station, "route", lambda old: lambda points: [(id, fields) for id, fields in old(points) if id != 13003])


@fault("ROUTE-022z2", "the route begins at waypoint 0: its 13001 deletes it")
def _(station):
    change_fields(station, 13001, lambda f: f | {"Initial Waypoint Number": 0})


@fault("ROUTE-022z3", "no waypoint names the next one")
def _(station):
    change_fields(station, 13002, lambda f: f | {"Next Waypoint": 0})


@fault("ROUTE-023z", "a route that was rejected is shown as loaded")
def _(station):
    def take_status(fields, lawful=station.take_status):
        lawful(fields | ({"Status": 1} if fields.get("Status") == 2 else {}))
    station.take_status = take_status


@fault("HAND-008z", "the operator's refusal goes out as a consent")
def _(station):
    def answer(_consent, display=station.display):
        station.send(HANDOVER_MESSAGE, {"VSM ID": station.vsm_id, "Requested/Handover LOI": 12, "Requesting CUCS ID": signed(display.handover or 0)})
        display.handover = None
    station.answer_handover = answer


@fault("HAND-008z2", "the operator's refusal gives control back")
def _(station):
    def answer(_consent, display=station.display):
        station.send(1, station.request_fields(12, 0))
        display.handover = None
    station.answer_handover = answer


@fault("ROBUST-011z", "an alert of an unknown subsystem ends the program")
def _(station):
    def show(fields, now, lawful=station.display.show_alert):
        if fields.get("Subsystem ID", 0) > 31:
            raise KeyError(fields["Subsystem ID"])
        lawful(fields, now)
    station.display.show_alert = show


@fault("MODE-016z", "of several modes that are not available the last is remembered")
def _(station):
    def learn(fields, display=station.display, lawful=station.display.learn_availability):
        if fields.get("Enumerated Index Enable", 0) < 0:
            display.unavailable.clear()
        lawful(fields)
    station.display.learn_availability = learn


@fault("ACK-008z", "only the first message that asks for it is acknowledged")
def _(station):
    def acknowledges(message, lawful=station.acknowledges, count=[0]):
        count[0] += 1
        return lawful(message) and count[0] == 1
    station.acknowledges = acknowledges


@fault("HB-001z", "heartbeats come in pairs every two seconds")
def _(station):
    station.heartbeat_at = station.now()

    def send(id, fields, ack=False, to=None, count=[0], lawful=station.send):
        if id == 16002:
            count[0] += 1
            if count[0] % 2:
                return
            lawful(id, fields, ack, to)
        lawful(id, fields, ack, to)
    station.send = send
