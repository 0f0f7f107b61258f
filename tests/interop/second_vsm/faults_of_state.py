"""Faults in what is reported of the vehicle beside its place: the signs of rates and accelerations, its state, its engines; and in what
its sticks do.

The id of a fault is that of the rule that has to fail, with `n` and a number where there are several.
"""
from . import aircraft as flight
from .change import each, table
from .faults_by_rule import change_reports
from .mission import IN_PROGRESS
from .steering import DONE

OF_STATE, _entry = table()
FEET = 1 / 0.3048
ACCELERATIONS = ("U_Accel", "V_Accel", "W_Accel")


def fault(id, title, *beside):
    """`beside` are rules whose play shows what this one looks at."""
    return _entry(id, title, " ".join((id.partition("n")[0], *beside)))


def scaled(factor, *names):
    return lambda f: f | {name: round(factor * f[name]) for name in names if name in f}


def inverted(*names):
    return scaled(-1, *names)


# Id, title, message, and what becomes of its fields.
REPORTS = (
    ("STAT-017n", "Pitch of 4000 is positive nose down", 4000, inverted("Pitch")),
    ("STAT-017n2", "Pitch and Pitch Rate of 4000 are positive nose down", 4000, inverted("Pitch", "Pitch Rate")),
    ("STAT-017n3", "Pitch Rate of 4000 is positive nose down", 4000, inverted("Pitch Rate")),
    ("STAT-017n4", "Roll Rate of 4000 is positive to the left", 4000, inverted("Roll Rate")),
    ("STAT-017n5", "the accelerations of 4000 are those against the motion", 4000, inverted(*ACCELERATIONS)),
    ("STAT-017n6", "W_Accel of 4000 is positive up", 4000, inverted("W_Accel")),
    ("STAT-017n7", "U_Accel of 4000 is positive to the south", 4000, inverted("U_Accel")),
    ("STAT-017n8", "the accelerations of 4000 are always 0", 4000, scaled(0, *ACCELERATIONS)),
    ("STAT-017n9", "the accelerations of 4000 are in feet", 4000, scaled(FEET, *ACCELERATIONS)),
    ("STAT-017n10", "Turn Rate of 4000 is always 0", 4000, scaled(0, "Turn Rate")),
    ("STAT-017n11", "Pitch Rate of 4000 is always 0", 4000, scaled(0, "Pitch Rate")),
    ("STAT-017n12", "W_Speed of 4000 is in feet a second", 4000, scaled(FEET, "W_Speed")),
    ("STAT-018n", "UA State of 3002 is one too high", 3002, lambda f: f | {"UA State": f["UA State"] + 1}),
    ("STAT-019n", "Engine Speed of 3007 is 600 rad/s whatever the engine does", 3007, lambda f: f | {"Engine Speed 1": 1200}),
    ("STAT-019n2", "Engine Speed of 3007 is always 0", 3007, lambda f: f | {"Engine Speed 1": 0}),
    ("ROUTE-024n", "Percent Complete of 14000 is 0 until the end", 14000, lambda f: f | {"Percent Complete": 0} if f["Status"] == IN_PROGRESS else f),
    ("ROUTE-024n2", "Percent Complete of 14000 is 100 from the beginning", 14000,
     lambda f: f | {"Percent Complete": 100} if f["Status"] == IN_PROGRESS else f),
)
for _id, _title, _message, _alter in REPORTS:
    fault(_id, _title)(lambda vsm, message=_message, alter=_alter: change_reports(vsm, message, alter))


@fault("ROUTE-024n3", "of a load that takes 25 s the beginning and the second half are reported once each, with 0 %, and the end")
def _(vsm):
    for vehicle in vsm.vehicles:
        mission = vehicle.mission
        late = []

        def load(*args, m=mission, lawful=mission.load, late=late):
            late.clear()
            problem = lawful(*args)
            if m.transfer:
                m.transfer.takes = 25.0
            return problem

        def status(cucs, status, percent, *rest, lawful=mission.status, late=late):
            if status != IN_PROGRESS:
                lawful(cucs, status, percent, *rest)
            elif percent == 0 or (percent >= 60 and not late):
                late.extend([True] if percent else [])
                lawful(cucs, status, 0, *rest)
        mission.load, mission.status = load, status


@fault("STAT-018n2", "after a landing UA State of 3002 is 'launch abort'")
def _(vsm):
    flown = []

    def alter(fields):
        if vsm.vehicles[0].aircraft.airborne:
            flown.append(True)
        return fields | {"UA State": 4} if flown and not vsm.vehicles[0].aircraft.airborne else fields
    change_reports(vsm, 3002, alter)


@fault("SCALAR-006n", "in flight UA State of 3002 is one too low: a reserved value", "STAT-018")
def _(vsm):
    change_reports(vsm, 3002, lambda f: f | {"UA State": 9} if f["UA State"] == 10 else f)


@fault("STAT-019n3", "a stopped engine keeps the speed that it had")
def _(vsm):
    last = {}

    def alter(fields):
        speed = fields["Engine Speed 1"] or last.get(fields["Engine Number"], 0)
        last[fields["Engine Number"]] = speed
        return fields | {"Engine Speed 1": speed}
    change_reports(vsm, 3007, alter)


# Sticks

@fault("MODE-017n", "2010 is taken, and moves nothing")
def _(vsm):
    each(vsm, "steering", "move_sticks", lambda old: lambda fields: DONE)


def stick_inverted(name):
    def build(vsm):
        each(vsm, "steering", "move_sticks", lambda old: lambda fields: old(inverted(name)(fields)))
    return build


fault("MODE-017n2", "the Lateral Stick of 2010 is positive to the left")(stick_inverted("Lateral Stick"))
fault("MODE-017n3", "the Longitudinal Stick of 2010 is positive backward")(stick_inverted("Longitudinal Stick"))
fault("MODE-017n4", "the Rotational Stick of 2010 is positive to the left")(stick_inverted("Rotational Stick (Rudder)"))


@fault("MODE-017n5", "of the sticks of 2010 the last deflection stays when they are centred")
def _(vsm):
    for vehicle in vsm.vehicles:
        def move(fields, v=vehicle, lawful=vehicle.steering.move_sticks):
            moved = any(fields.get(name) for name in ("Lateral Stick", "Longitudinal Stick", "Rotational Stick (Rudder)"))
            return lawful(fields) if moved or v.aircraft.mode != flight.MANUAL else DONE
        vehicle.steering.move_sticks = move
