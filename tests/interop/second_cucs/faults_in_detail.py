"""More faults of a CUCS, each a small slip. The id of a fault is that of the rule that has to fail, with a letter."""
from second_vsm import units
from second_vsm.change import replace, table
from second_vsm.mutants import parts_of, resealed
from second_vsm.wire import BROADCAST, HEADER, reference

from .display import MODE
from .faults import change_wire
from .station import ACK_S, ANSWER_S, LOI_3, LOI_4

IN_DETAIL, _entry = table()


def fault(id, title):
    return _entry(id, title, id.rstrip("bcde"))


def change_fields(station, id, alter):
    """Changes the fields of one message: `alter(fields)` gives new ones."""
    replace(station, "encode", lambda old: lambda sent, fields, *rest, **named: old(sent, alter(fields) if sent == id else fields, *rest, **named))


@fault("WRAP-007b", "the checksum is summed over the data only")
def _(station):
    def alter(_id, wire):
        header, data, style = parts_of(wire)
        return header + data + reference.checksum(style, data)
    change_wire(station, alter)


@fault("WRAP-014b", "property bits 5 to 0 are set")
def _(station):
    def alter(_id, wire):
        header, data, style = parts_of(wire)
        return resealed(header[:15] + bytes([header[15] | 0x3F]), data, style)
    change_wire(station, alter)


@fault("WRAP-016b", "settings go to everybody")
def _(station):
    replace(station, "encode", lambda old: lambda id, fields, ack=False, to=None: old(id, fields, ack, BROADCAST if id == 2017 else to))


@fault("WRAP-016c", "the vehicle's id is the source")
def _(station):
    replace(station, "source", lambda old: lambda: station.vehicle or old())


@fault("SCALAR-003b", "latitude and longitude of waypoints exchanged")
def _(station):
    north, east = "Waypoint to Latitude or Relative Y", "Waypoint to Longitude or Relative X"
    change_fields(station, 13002, lambda f: f | {north: f[east], east: f[north]})


@fault("SCALAR-005b", "the Mission ID is filled with blanks, without NUL")
def _(station):
    def alter(id, wire):
        header, data, style = parts_of(wire)
        at = reference.MESSAGES[id]["pv_bytes"] + 5
        return wire if id != 13000 else resealed(header, data[:at] + data[at : at + 20].replace(b"\0", b" ") + data[at + 20:], style)
    change_wire(station, alter)


@fault("SCALAR-006b", "turn type 9 in waypoints")
def _(station):
    change_fields(station, 13002, lambda f: f | {"Turn Type": 9})


@fault("PV-003b", "a byte is left over behind the fields of 2017")
def _(station):
    def alter(id, wire):
        header, data, style = parts_of(wire)
        words = list(HEADER.unpack(header))
        words[1] += 1
        return wire if id != 2017 else resealed(HEADER.pack(*words), data + b"\0", style)
    change_wire(station, alter)


@fault("TIME-002b", "time stamps are local time, two hours ahead")
def _(station):
    replace(station, "stamp", lambda old: lambda: old() + 7_200_000)


@fault("TIME-004b", "time stamps fall now and then")
def _(station):
    count = [0]

    def stamp():
        count[0] += 1
        return units.stamp() - (900 if count[0] % 3 == 0 else 0)
    station.stamp = stamp


@fault("DISC-008b", "a discovery names no VSM")
def _(station):
    replace(station, "search", lambda old: lambda: old() | {"VSM ID": 0})


@fault("AUTH-014b", "launches with LOI 4")
def _(station):
    def take_rights(fields, lawful=station.take_rights, sent=[]):
        lawful(fields)
        if station.display.loi & 12 == LOI_4 and not sent:
            sent.append(True)
            station.send(2016, {MODE: 21})
    station.take_rights = take_rights


@fault("AUTH-014c", "commands another payload station than its own")
def _(station):
    def take_rights(fields, lawful=station.take_rights, sent=[]):
        lawful(fields)
        if station.display.loi & LOI_3 and not sent:
            sent.append(True)
            station.send(19001, {"Station Number 1-16": 2, "Set Centreline Azimuth Angle": 100})
    station.take_rights = take_rights


@fault("AUTH-015b", "what is authorised is taken for what is granted")
def _(station):
    def take_rights(fields, lawful=station.take_rights):
        lawful(fields)
        station.display.loi = station.display.authorised
    station.take_rights = take_rights


@fault("ACK-008b", "an acknowledgement names no time stamp")
def _(station):
    change_fields(station, 17000, lambda f: f | {"Original Message Time Stamp": 0})


@fault("ACK-008c", "acknowledgements go to everybody")
def _(station):
    replace(station, "encode", lambda old: lambda id, fields, ack=False, to=None: old(id, fields, ack, BROADCAST if id == 17000 else to))


@fault("ACK-002b", "every report is acknowledged")
def _(station):
    replace(station, "take", lambda old: lambda message: [setattr(message, "ack", message.ack or message.id == 3001), old(message)][1])


@fault("ACK-009b", "a command that gets lost is not repeated")
def _(station):
    def command(id, fields, loi=LOI_4):
        station.must_hold(loi)
        since = len(station.inbox)
        station.transmit(station.make_command(id, fields)[0])
        answer = station.wait(lambda m: m.id == 17000 and m.fields.get("Original Message Type") == id, ACK_S + ANSWER_S, since)
        return answer and answer.fields.get("Acknowledgement Type")
    station.command = command


@fault("ACK-009c", "a command is repeated without end")
def _(station):
    last = []

    def make_command(id, fields, lawful=station.make_command):
        made = lawful(id, fields)
        last[:] = [made[0]]
        return made

    def tick(lawful=station.tick):
        lawful()
        for wire in last:
            station.transmit(wire)
    station.make_command, station.tick = make_command, tick


@fault("HAND-008b", "refuses handover requests by itself")
def _(station):
    def take(message, lawful=station.take):
        lawful(message)
        if message.id == 4:
            station.answer_handover(False)
    station.take = take


@fault("ROUTE-022b", "waypoints are numbered from 0")
def _(station):
    def route(points, lawful=station.route):
        return [(id, f | {n: f[n] - 1 for n in ("Waypoint Number", "Next Waypoint", "Initial Waypoint Number") if f.get(n, 0) > 0}) for id, f in lawful(points)]
    station.route = route


@fault("ROUTE-022c", "a loiter names a waypoint that is not there")
def _(station):
    def route(points, lawful=station.route):
        return [(id, f | {"Waypoint Number": 77} if id == 13003 else f) for id, f in lawful(points)]
    station.route = route


@fault("ROUTE-022d", "the load command comes first")
def _(station):
    replace(station, "route", lambda old: lambda points: [(13000, {"Mission ID": "PLAN", "Mission Plan Mode": 2}), *old(points)])


@fault("CONF-012b", "asks for 44003 by 17002")
def _(station):
    def configure(lawful=station.configure):
        station.send(17002, {"Message Type": 44003})
        lawful()
    station.configure = configure


@fault("HB-001b", "heartbeats come every 0.3 s")
def _(station):
    due = [0.0]

    def tick(lawful=station.tick):
        lawful()
        if station.display.loi and station.now() > due[0]:
            due[0] = station.now() + 0.3
            station.send(16002, {})
    station.tick = tick


@fault("ROBUST-003b", "an unknown message ends the program")
def _(station):
    def take_datagram(datagram, lawful=station.take_datagram):
        if len(datagram) >= HEADER.size and int.from_bytes(datagram[12:14], "big") not in reference.MESSAGES:
            raise KeyError("message type")
        lawful(datagram)
    station.take_datagram = take_datagram


@fault("ROBUST-007b", "a text without NUL ends the program")
def _(station):
    def value(kind, data, lawful=station.codec.value):
        if kind.startswith("char") and 0 not in data:
            raise ValueError("text")
        return lawful(kind, data)
    station.codec.value = value


@fault("ROBUST-008b", "a request of the vehicle is answered")
def _(station):
    def take(message, lawful=station.take):
        lawful(message)
        if message.id == 1:
            station.send(2, {"VSM ID": station.vsm_id, "LOI Granted": 15}, to=message.source)
    station.take = take
