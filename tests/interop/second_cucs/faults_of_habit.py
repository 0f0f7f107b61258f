"""Faults of a CUCS in what it makes of what it is sent: the second alert, the other bound, the later answer, what is not its own.

Like the others, the id of a fault is that of the rule that has to fail, with a letter from `f` on.
"""
import math

from second_vsm import units
from second_vsm.change import replace, table
from second_vsm.mutants import parts_of, resealed
from second_vsm.wire import HEADER, reference

from .faults import change_wire
from .faults_in_detail import change_fields
from .station import LOI_4

OF_HABIT, _entry = table()


def fault(id, title):
    return _entry(id, title, id[:-1])


# On the wire

@fault("ACK-003f", "acknowledgements request to be acknowledged")
def _(station):
    replace(station, "encode", lambda old: lambda id, fields, ack=False, to=None: old(id, fields, ack or id == 17000, to))


@fault("PV-002f", "2017 and 13002 have no time stamp")
def _(station):
    replace(station.codec, "encode", lambda old: lambda id, source, to, fields, ack=False: old(
        id, source, to, {n: v for n, v in fields.items() if n != "Time Stamp" or id not in (2017, 13002)}, ack))


@fault("WRAP-004f", "a route goes out in one datagram, however long")
def _(station):
    kept = []

    def transmit(wire, lawful=station.transmit):
        kind = int.from_bytes(wire[12:14], "big")
        if 13001 <= kind <= 13003:
            # Three times, for a network that loses some.
            kept.extend([wire] * 3)
            return
        if kept:
            lawful(b"".join(kept))
            kept.clear()
        lawful(wire)
    station.transmit = transmit


@fault("WRAP-012f", "version 31")
def _(station):
    def alter(_id, wire):
        header, data, style = parts_of(wire)
        return resealed(header[:14] + bytes([header[14] & 0x80 | 31]) + header[15:], data, style)
    change_wire(station, alter)


@fault("WRAP-003f", "Length of 13003 is one too small")
def _(station):
    def alter(id, wire):
        header, data, style = parts_of(wire)
        words = list(HEADER.unpack(header))
        words[1] -= id == 13003
        return resealed(HEADER.pack(*words), data, style)
    change_wire(station, alter)


@fault("SCALAR-003h", "numbers of four bytes are sent least significant byte first")
def _(station):
    def alter(id, wire):
        header, data, style = parts_of(wire)
        if id != 13002:
            return wire
        at, new = reference.MESSAGES[id]["pv_bytes"], bytearray(data)
        presence = int.from_bytes(data[:at], "big")
        for field in reference.MESSAGES[id]["fields"]:
            if presence >> field["bit"] & 1:
                size = reference.width(field["type"])[0]
                if size == 4:
                    new[at : at + size] = new[at : at + size][::-1]
                at += size
        return resealed(header, bytes(new), style)
    change_wire(station, alter)


@fault("SCALAR-003f", "longitudes have no sign")
def _(station):
    replace(station, "longitude", lambda old: lambda lon: old(abs(lon)))


@fault("SCALAR-003g", "angles are half of what they should be")
def _(station):
    names = ("Waypoint to Latitude or Relative Y", "Waypoint to Longitude or Relative X")
    change_fields(station, 13002, lambda f: f | {n: f[n] // 2 for n in names})


@fault("SCALAR-005f", "behind the NUL of a Mission ID is what was there before")
def _(station):
    def alter(id, wire):
        header, data, style = parts_of(wire)
        at = reference.MESSAGES[id]["pv_bytes"] + 5
        return wire if id != 13000 else resealed(header, data[: at + 12] + b"OLDNAME\0" + data[at + 20 :], style)
    change_wire(station, alter)


@fault("SCALAR-006f", "loiter type 9")
def _(station):
    change_fields(station, 13003, lambda f: f | {"Waypoint Loiter Type": 9})


@fault("TIME-002f", "time stamps are seconds since 2000")
def _(station):
    station.stamp = lambda: units.stamp() // 1000


@fault("TIME-003f", "time stamps lie three seconds ahead")
def _(station):
    replace(station, "stamp", lambda old: lambda: old() + 3000)


@fault("DISC-010f", "its id begins with 255")
def _(station):
    station.source = lambda: 0xFF0000A0


# Rights

@fault("AUTH-014f", "a route is uploaded without LOI 4")
def _(station):
    def take_rights(fields, lawful=station.take_rights, sent=[]):
        lawful(fields)
        if station.display.loi and not station.display.loi & 12 and not sent:
            sent.append(True)
            station.send(13000, {"Mission ID": "EARLY", "Mission Plan Mode": 1})
    station.take_rights = take_rights


@fault("AUTH-015f", "what was granted before a restart of the VSM counts after it")
def _(station):
    station.must_hold = lambda loi, lawful=station.must_hold, had=[]: had.append(1) if station.display.loi & loi else None if had else lawful(loi)
    due = [0.0]

    def tick(lawful=station.tick):
        lawful()
        if station.vehicle and not station.display.loi & LOI_4 and station.now() > due[0] and any(m.id == 2 and m.fields.get("LOI Granted", 0) & LOI_4 for m in station.inbox):
            due[0] = station.now() + 1
            station.send(2017, {"Loiter Radius": 80})
    station.tick = tick


# Missions and commands

@fault("ROUTE-022f", "all waypoints have one number")
def _(station):
    change_fields(station, 13002, lambda f: f | {"Waypoint Number": 1})


@fault("ROUTE-022g", "the last waypoint leads to itself")
def _(station):
    change_fields(station, 13002, lambda f: f | {"Next Waypoint": f["Next Waypoint"] or f["Waypoint Number"]})


@fault("ROUTE-022h", "a route is never loaded")
def _(station):
    def load(mission, since):
        station.display.mission = "loaded"
    station.load = load


@fault("ROUTE-023f", "any mission status is taken for 'loaded'")
def _(station):
    def take_status(fields):
        station.display.mission = "loaded"

    def load(mission, since):
        station.send(13000, {"Mission ID": mission, "Mission Plan Mode": 2, "Waypoint Number": 0, "Route ID": ""})
        station.wait(lambda m: m.id == 14000, 60.0, since)
    station.take_status, station.load = take_status, load


@fault("MODE-016f", "what is not implemented (-2) is offered; what is not available (-1) is not")
def _(station):
    def learn(fields, lawful=station.display.learn_availability):
        if fields.get("Enumerated Index Enable") != -2:
            lawful(fields)
    station.display.learn_availability = learn


@fault("CONF-010f", "only declared minima are kept")
def _(station):
    def within(message, number, value, display=station.display):
        limits = display.limits.get((message, number))
        return limits is None or limits.low is None or value >= limits.low
    station.display.within = within


@fault("ACK-008f", "acknowledgements come after five seconds")
def _(station):
    waiting = []

    def take(message, lawful=station.take):
        if message.ack and message.id != 17000:
            message.ack = False
            waiting.append((station.now() + 5, message))
        lawful(message)

    def tick(lawful=station.tick):
        lawful()
        while waiting and waiting[0][0] < station.now():
            m = waiting.pop(0)[1]
            station.send(17000, {"Original Message Time Stamp": m.stamp or 0, "Original Message Type": m.id, "Acknowledgement Type": 1}, to=m.source)
    station.take, station.tick = take, tick


@fault("ACK-008g", "an acknowledgement names another message")
def _(station):
    change_fields(station, 17000, lambda f: f | {"Original Message Type": 4000})


@fault("ACK-009f", "a command that gets lost is repeated with other values")
def _(station):
    station.again = lambda wire, id, fields: station.encode(id, fields | ({"Loiter Radius": fields["Loiter Radius"] + 10} if "Loiter Radius" in fields else {}), ack=True)


# What the operator sees

@fault("ALERT-007f", "priority 0 clears every alert")
def _(station):
    def show(fields, now, lawful=station.display.show_alert):
        lawful(fields, now)
        if fields.get("Priority") == 0:
            station.display.alerts.clear()
    station.display.show_alert = show


@fault("ALERT-007g", "cautions are not shown")
def _(station):
    replace(station.display, "show_alert", lambda old: lambda fields, now: old(fields, now) if fields.get("Priority") != 3 else None)


@fault("ALERT-008f", "an update does not change the text")
def _(station):
    def show(fields, now, lawful=station.display.show_alert):
        known = station.display.alerts.get(abs(fields.get("Alert (Warning) ID", 0)))
        lawful(fields | {"Text": known.text} if known else fields, now)
    station.display.show_alert = show


@fault("PV-008f", "a position that is absent looks as fresh as before")
def _(station):
    def show(fields, now, display=station.display, lawful=station.display.show_position):
        lawful(fields, now)
        if display.position:
            display.position_at = now
    station.display.show_position = show


@fault("CONF-011f", "warnings come at 0 only")
def _(station):
    def watch(message, number, value, display=station.display):
        if value <= 0:
            display.own_warnings.add((message, number, "warning"))
    station.display.watch = watch


@fault("WRAP-010f", "damaged positions are shown")
def _(station):
    def matches(style, covered, trailer, lawful=station.codec.checksum_matches):
        return lawful(style, covered, trailer) or int.from_bytes(covered[12:14], "big") == 4000
    station.codec.checksum_matches = matches


@fault("HAND-008f", "gives its control up when another asks for it")
def _(station):
    def take(message, lawful=station.take):
        lawful(message)
        if message.id == 4:
            station.send(1, station.request_fields(12, 0))
    station.take = take


# Input that is no message

@fault("ROBUST-001f", "a datagram that is cut in its header ends the program")
def _(station):
    def take_datagram(datagram, lawful=station.take_datagram):
        if 0 < len(datagram) < HEADER.size:
            raise ValueError("header")
        lawful(datagram)
    station.take_datagram = take_datagram


@fault("ROBUST-002f", "a length beyond the datagram ends the program")
def _(station):
    def take_datagram(datagram, lawful=station.take_datagram):
        if len(datagram) >= HEADER.size and int.from_bytes(datagram[2:4], "big") > len(datagram):
            raise ValueError("length")
        lawful(datagram)
    station.take_datagram = take_datagram


@fault("ROBUST-011f", "a waypoint that it does not know ends the program")
def _(station):
    def take(message, lawful=station.take):
        lawful(message)
        if message.id == 4001 and message.fields.get("To Waypoint Number", 0) not in range(0, 100) and message.fields["To Waypoint Number"] != 65535:
            raise KeyError("waypoint")
    station.take = take


@fault("ROBUST-011g", "a latitude beyond the pole ends the program")
def _(station):
    def show(fields, now, lawful=station.display.show_position):
        if abs(fields.get("Latitude", 0)) > 2**30:
            raise ValueError(math.degrees(fields["Latitude"]))
        lawful(fields, now)
    station.display.show_position = show
