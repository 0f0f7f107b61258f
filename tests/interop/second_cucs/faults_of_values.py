"""Faults of a CUCS in units, in kinds of places, and in what it repeats.

As for the others, the id of a fault is that of the rule that has to fail, with `n` and a number where there are several.
"""
from second_vsm import units
from second_vsm.change import replace, table

from .display import MODE
from .faults_in_detail import change_fields
from .station import ACK_S, ANSWER_S, LOI_4

OF_VALUES, _entry = table()
FEET = 1 / 0.3048
NORTH, EAST = "Waypoint to Latitude or Relative Y", "Waypoint to Longitude or Relative X"


def fault(id, title):
    return _entry(id, title, id.partition("n")[0])


def scaled(name, factor):
    return lambda f: f | {name: round(f[name] * factor)} if name in f else f


@fault("ROUTE-025n", "altitudes of waypoints are feet")
def _(station):
    change_fields(station, 13002, scaled("Waypoint to Altitude", FEET))


@fault("ROUTE-025n2", "altitudes of waypoints are taken for feet, and converted to metres")
def _(station):
    change_fields(station, 13002, scaled("Waypoint to Altitude", 1 / FEET))


@fault("ROUTE-026n", "places on the globe are called relative (Location Type 1)")
def _(station):
    change_fields(station, 13002, lambda f: f | {"Location Type": 1})


@fault("ROUTE-026n2", "offsets from the vehicle are called absolute (Location Type 0)")
def _(station):
    def relative(fields):
        place = tuple(units.from_bam(fields[name], 32) for name in (NORTH, EAST))
        north, east = units.offset(station.display.position or place, place)
        return fields | {NORTH: round(north), EAST: round(east)}
    change_fields(station, 13002, relative)


@fault("MODE-016n", "waypoints are called relative, which 44003 says is not implemented")
def _(station):
    change_fields(station, 13002, lambda f: f | {"Location Type": 1, NORTH: 5_000, EAST: 5_000})


@fault("MODE-016n2", "a 44003 after the configuration phase changes nothing")
def _(station):
    # What belongs to the phase comes before it is over.
    def make(old):
        return lambda fields: None if station.configured else old(fields)
    replace(station.display, "learn_availability", make)


@fault("MODE-016n3", "a mode that was unavailable once is not offered again")
def _(station):
    def make(old):
        return lambda fields: old(fields) if fields.get("Enumerated Index Enable", 0) < 0 else None
    replace(station.display, "learn_availability", make)


@fault("ACK-009n", "a 2016 asks for no acknowledgement, and is sent three times a second apart, each time as a new one")
def _(station):
    def command(id, fields, *rest, lawful=station.command):
        if id != 2016:
            return lawful(id, fields, *rest)
        station.must_hold(4)
        for _ in range(3):
            station.send(id, {MODE: fields[MODE], **fields})
            station.pump(1.0)
        return 2
    station.command = command


@fault("ACK-009n2", "a command that gets lost is sent again after six seconds, as a new one")
def _(station):
    def make(old):
        def wait(wanted, seconds, since):
            # The time of an acknowledgement alone, not that of an answer.
            return old(wanted, 6.0 if seconds < ANSWER_S else seconds, since)
        return wait
    replace(station, "wait", make)
    station.again = lambda _wire, id, fields: station.encode(id, fields, ack=True)


@fault("ACK-009n3", "a 2016 that gets lost is not repeated; five seconds after its time another one replaces it")
def _(station):
    def command(id, fields, *rest, lawful=station.command):
        if id != 2016:
            return lawful(id, fields, *rest)
        station.must_hold(LOI_4)

        def sent(fields):
            since = len(station.inbox)
            station.transmit(station.make_command(id, fields)[0])
            return station.wait(lambda m: m.id == 17000 and m.fields.get("Original Message Type") == id, ACK_S + ANSWER_S, since)
        answer = sent(fields)
        if not answer:
            station.pump(5.0)
            answer = sent(fields | {MODE: 15})
        if not answer:
            station.display.unconfirmed.append(id)
        return answer and answer.fields.get("Acknowledgement Type")
    station.command = command
