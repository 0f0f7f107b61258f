"""The 25 faults of a CUCS that the conformance suite has to find, each in one place; `station` is lawful before."""
import time

from second_vsm.change import replace, table
from second_vsm.mutants import parts_of, resealed
from second_vsm.wire import BROADCAST, HEADER, TRAILER_BYTES, reference

from .display import MODE, MODES
from .station import LOI_4, REQUEST

FAULTS, fault = table()


def change_wire(station, alter):
    replace(station.codec, "encode", lambda old: lambda id, *args: alter(id, old(id, *args)))


@fault("C01", "sends length with the header included", "WRAP-003")
def _(station):
    def alter(_id, wire):
        header, data, style = parts_of(wire)
        words = list(HEADER.unpack(header))
        words[1] += HEADER.size
        return resealed(HEADER.pack(*words), data, style)
    change_wire(station, alter)


@fault("C02", "fills the checksum trailer with 0", "WRAP-007 WRAP-006")
def _(station):
    def alter(_id, wire):
        size = TRAILER_BYTES[wire[15] >> 6]
        return wire[: len(wire) - size] + bytes(size)
    change_wire(station, alter)


@fault("C03", "accepts damaged status and grants", "WRAP-010")
def _(station):
    replace(station.codec, "checksum_matches", lambda old: lambda style, covered, trailer: True)


@fault("C04", "sends the first word and version of Edition 3 to an Edition 4 VSM", "WRAP-012 WRAP-014")
def _(station):
    station.codec.idd = 30


@fault("C05", "longitudes west sent as unsigned beyond pi", "SCALAR-003 SCALAR-001")
def _(station):
    # Four bytes hold no angle beyond pi: what is written overflows to the largest one.
    replace(station, "longitude", lambda old: lambda lon: old(lon) if lon >= 0 else 2**31 - 1)


@fault("C06", "unused presence bits set to 1", "PV-006")
def _(station):
    def alter(id, wire):
        header, data, style = parts_of(wire)
        layout = reference.MESSAGES[id]
        size = layout["pv_bytes"]
        unused = (1 << 8 * size) - (1 << len(layout["fields"]))
        return resealed(header, (int.from_bytes(data[:size], "big") | unused).to_bytes(size, "big") + data[size:], style)
    change_wire(station, alter)


@fault("C07", "sends a vector of 2 bytes in 13002", "PV-001 PV-003")
def _(station):
    def alter(id, wire):
        if id != 13002:
            return wire
        header, data, style = parts_of(wire)
        words = list(HEADER.unpack(header))
        words[1] -= 1
        return resealed(HEADER.pack(*words), data[1:], style)
    change_wire(station, alter)


@fault("C08", "shows 0/0 when the position is absent", "PV-008")
def _(station):
    replace(station.display, "show_position", lambda old: lambda fields, now: old({"Latitude": 0, "Longitude": 0, **fields}, now))


@fault("C09", "discovery names access 1 and LOI 4", "DISC-008")
def _(station):
    replace(station, "search", lambda old: lambda: old() | {"Requested/Handover LOI": LOI_4, "Requested/Handover Access": REQUEST})


@fault("C10", "uses the broadcast id as its own source", "DISC-010 WRAP-016")
def _(station):
    station.source = lambda: BROADCAST


@fault("C11", "sends 2016 before, or without, a grant", "AUTH-015 AUTH-014")
def _(station):
    def discover(lawful=station.discover):
        lawful()
        station.send(2016, {MODE: 12})
    station.discover = discover
    station.must_hold = lambda loi: None


@fault("C12", "goes on commanding after #2 has taken its LOI", "AUTH-015 AUTH-014")
def _(station):
    had = set()

    def take_rights(fields, lawful=station.take_rights):
        lawful(fields)
        had.update(bit for bit in (1, 2, 4, 8) if station.display.loi & bit)

    def must_hold(loi, lawful=station.must_hold):
        if loi not in had:
            lawful(loi)
    station.take_rights, station.must_hold = take_rights, must_hold
    sent = [0.0]

    def tick(lawful=station.tick):
        lawful()
        if LOI_4 in had and not station.display.loi & LOI_4 and time.monotonic() - sent[0] > 1:
            sent[0] = time.monotonic()
            station.send(2017, {"Loiter Radius": 40})
    station.tick = tick


@fault("C13", "sends flight commands while holding LOI 3 only", "AUTH-014")
def _(station):
    station.must_hold = lambda loi, lawful=station.must_hold: None if station.display.loi & 2 else lawful(loi)
    sent = [False]

    def take_rights(fields, lawful=station.take_rights):
        lawful(fields)
        if station.display.loi & 14 == 2 and not sent[0]:
            sent[0] = True
            station.send(2016, {MODE: 12})
    station.take_rights = take_rights


@fault("C14", "answers handover requests by itself", "HAND-008")
def _(station):
    def take(message, lawful=station.take):
        lawful(message)
        if message.id == 4:
            station.answer_handover(True)
    station.take = take


@fault("C15", "load command before the last waypoints; a Next Waypoint that was never sent", "ROUTE-022")
def _(station):
    def route(points, lawful=station.route):
        messages = lawful(points)
        id, last = messages[-1] if messages[-1][0] == 13002 else messages[-2]
        return [*messages[:-1], (13000, {"Mission ID": "PLAN", "Mission Plan Mode": 2}), (id, {**last, "Next Waypoint": 999})]
    station.route = route


@fault("C16", "shows 'loaded' when the load command has been sent", "ROUTE-023")
def _(station):
    def load(mission, since, lawful=station.load):
        station.display.mission = "loaded"
        station.take_status = lambda fields: None
        station.send(13000, {"Mission ID": mission, "Mission Plan Mode": 2, "Waypoint Number": 0, "Route ID": ""})
    station.load = load


@fault("C17", "offers every flight mode whatever 44003 said", "MODE-016")
def _(station):
    station.display.offered_modes = lambda: sorted(MODES)


@fault("C18", "ignores declared ranges: any loiter radius is sent", "CONF-010")
def _(station):
    station.display.within = lambda message, number, value: True


@fault("C19", "raises no warning of its own from declared limits", "CONF-011")
def _(station):
    station.display.watch = lambda message, number, value: None


@fault("C20", "asks for 41000 by 17002", "CONF-012")
def _(station):
    def configure(lawful=station.configure):
        station.send(17002, {"Message Type": 41000})
        lawful()
    station.configure = configure


@fault("C21", "never acknowledges, and acknowledges acknowledgements", "ACK-008 ACK-003")
def _(station):
    station.acknowledges = lambda message: message.id == 17000


@fault("C22", "repeats a command with a new time stamp", "ACK-009")
def _(station):
    station.again = lambda wire, id, fields: station.encode(id, fields, ack=True)


@fault("C23", "alerts vanish at once or cannot be cleared by priority 0; each update is a new entry", "ALERT-007 ALERT-008")
def _(station):
    count = [0]

    def show_alert(fields, now, lawful=station.display.show_alert):
        if fields.get("Priority") == 0:
            return
        count[0] += 1
        lawful({**fields, "Alert (Warning) ID": 100_000 + count[0], "Persistence": 0}, now)
    station.display.show_alert = show_alert


@fault("C24", "stops when 3001 names a mode it does not know, or 4000 a latitude of 3 rad", "ROBUST-011")
def _(station):
    def take(message, lawful=station.take):
        lawful(message)
        if message.id == 3001 and message.fields.get(MODE, 0) not in (0, *MODES, *station.display.names):
            raise KeyError(message.fields[MODE])
        if message.id == 4000 and abs(message.fields.get("Latitude", 0)) > 2**30:
            raise ValueError("latitude")
    station.take = take


@fault("C25", "closes its socket on an empty or oversized datagram", "ROBUST-005 ROBUST-001")
def _(station):
    def take_datagram(datagram, lawful=station.take_datagram):
        if not 0 < len(datagram) <= 548:
            station.socket.close()
            raise OSError("the socket is closed")
        lawful(datagram)
    station.take_datagram = take_datagram
