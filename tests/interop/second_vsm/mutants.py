"""The 60 faults of a VSM that the conformance suite has to find, each in one place.

A fault replaces one or a few methods of a VSM that is otherwise lawful; the ids are those of the suite's
table of faults, and each names the rules that have to fail, the first one in any case. `old` is always the
lawful method.
"""
import math
import struct
import time

from . import mission as plans
from . import units
from .authority import CONTROL, LOI_4
from .change import each, replace, table
from .edition25 import OWN_HEADER
from .steering import LOITER, NO_MODE, RETURN, Outcome
from .wire import BROADCAST, HEADER, TRAILER_BYTES, reference

MUTANTS, mutant = table()


# Wrapper

def resealed(header, data, style):
    wire = header + data
    return wire + reference.checksum(style, wire)


def parts_of(wire):
    """Header, data, style of an encoded message."""
    length, style = int.from_bytes(wire[2:4], "big"), wire[15] >> 6
    return wire[: HEADER.size], wire[HEADER.size : HEADER.size + length], style


def change_wire(vsm, alter):
    replace(vsm.codec, "encode", lambda old: lambda *args, **named: alter(old(*args, **named)))


def change_sent(vsm, alter):
    """Changes the fields of what is sent: `alter(id, fields)` gives new ones."""
    replace(vsm.codec, "encode", lambda old: lambda id, source, destination, fields, ack=False: old(id, source, destination, alter(id, fields), ack))


@mutant("V01", "header words written least significant byte first", "SCALAR-001 WRAP-001")
def _(vsm):
    def alter(wire):
        header, data, style = parts_of(wire)
        return resealed(struct.pack("<HHIIHH", *HEADER.unpack(header)), data, style)
    change_wire(vsm, alter)


@mutant("V02", "Vehicle Type in #2 and #3 with its bytes exchanged", "SCALAR-001 DISC-006")
def _(vsm):
    def alter(id, fields):
        if id not in (2, 3):
            return fields
        return {**fields, "Vehicle Type": int.from_bytes(fields["Vehicle Type"].to_bytes(2, "big"), "little")}
    change_sent(vsm, alter)


@mutant("V03", "Length counts header and checksum as well", "WRAP-003")
def _(vsm):
    def alter(wire):
        header, data, style = parts_of(wire)
        words = list(HEADER.unpack(header))
        words[1] = len(wire)
        return resealed(HEADER.pack(*words), data, style)
    change_wire(vsm, alter)
    # It takes such messages too, beside right ones.
    replace(vsm.codec, "data_length", lambda old: lambda datagram, at: (
        old(datagram, at) - HEADER.size - TRAILER_BYTES[datagram[at + 15] >> 6] if old(datagram, at) == len(datagram) - at else old(datagram, at)))


@mutant("V04", "checksum is never verified", "WRAP-009")
def _(vsm):
    replace(vsm.codec, "checksum_matches", lambda old: lambda *_: True)


@mutant("V05", "checksum is summed over the data only", "WRAP-007 WRAP-006")
def _(vsm):
    def alter(wire):
        if vsm.options.edition == "2.5":
            return wire[:-4] + sum(wire[OWN_HEADER.size:-4]).to_bytes(4, "big") if wire else wire
        header, data, style = parts_of(wire)
        return header + data + reference.checksum(style, data)
    change_wire(vsm, alter)


@mutant("V06", "byte sum kept in 16 bits though style 2 promises 32", "WRAP-007")
def _(vsm):
    def alter(wire):
        header, data, style = parts_of(wire)
        return wire if style != 2 else header + data + (sum(header + data) & 0xFFFF).to_bytes(4, "big")
    change_wire(vsm, alter)
    replace(vsm.codec, "checksum_matches", lambda old: lambda style, covered, trailer: (
        trailer == (sum(covered) & 0xFFFF).to_bytes(4, "big") if style == 2 else old(style, covered, trailer)))


@mutant("V07", "checksum style in the properties is always 0, though a trailer follows", "WRAP-007")
def _(vsm):
    def alter(wire):
        header, data, style = parts_of(wire)
        words = list(HEADER.unpack(header))
        words[5] &= ~0xC0
        return resealed(HEADER.pack(*words), data, style)
    change_wire(vsm, alter)


@mutant("V08", "only the first message of a datagram is taken", "WRAP-005 ROBUST-003")
def _(vsm):
    if vsm.options.edition == "2.5":
        replace(vsm.codec, "messages", lambda old: lambda datagram, known: list(old(datagram, known))[:1])
    else:
        replace(vsm.codec, "split", lambda old: lambda datagram: list(old(datagram))[:1])


@mutant("V09", "everything after an unknown message in a datagram is lost", "ROBUST-003")
def _(vsm):
    replace(vsm.codec, "continues_after_unknown", lambda old: lambda: False)


@mutant("V10", "answers longer than 548 bytes", "WRAP-004")
def _(vsm):
    replace(vsm.codec, "pack", lambda old: lambda wires: [b"".join(wires)])
    for vehicle in vsm.vehicles:
        def tick(configuration=vehicle.configuration):
            for cucs, queue in list(configuration.running.items()):
                configuration._send(cucs, queue)
                del configuration.running[cucs]
        vehicle.configuration.tick = tick


@mutant("V11", "IDD version not looked at", "WRAP-013")
def _(vsm):
    replace(vsm.codec, "serves", lambda old: lambda idd: True)


@mutant("V12", "destination not looked at: obeys commands for any vehicle", "WRAP-017 MULTI-002")
def _(vsm):
    replace(vsm, "addressed", lambda old: lambda message: old(message) or vsm.vehicles[:1])


@mutant("V13", "source is the VSM id in status of all vehicles", "WRAP-016 MULTI-002")
def _(vsm):
    each(vsm, "", "source", lambda old: lambda: vsm.options.vsm_id)


# Numbers

def change_bams(vsm, alter):
    """Changes every binary angle of what is sent."""
    kinds = {id: {f["name"]: int(f["type"][3:]) for f in m["fields"] if f["type"].startswith("bam")} for id, m in reference.MESSAGES.items()}
    change_sent(vsm, lambda id, fields: {n: alter(v, kinds[id][n]) if n in kinds[id] else v for n, v in fields.items()})


@mutant("V14", "binary angles as offset binary", "SCALAR-003")
def _(vsm):
    change_bams(vsm, lambda raw, bits: raw - 2 ** (bits - 1) if raw >= 0 else raw + 2 ** (bits - 1))


@mutant("V15", "binary angle step pi/2^n: half of each angle", "SCALAR-003 SCALAR-008")
def _(vsm):
    change_bams(vsm, lambda raw, bits: raw // 2)


@mutant("V16", "altitude step 0.025 m instead of 0.02 m", "SCALAR-004 STAT-008")
def _(vsm):
    each(vsm, "", "altitude_field", lambda old: lambda altitude: round(altitude / 0.025))
    each(vsm, "", "above_sea", lambda old: lambda altitude, kind: old(altitude / units.ALTITUDE_STEP_M * 0.025, kind))


@mutant("V17", "altitudes come back one step off: rounded through a float", "ROUTE-008 SCALAR-004")
def _(vsm):
    def rounded(fields):
        if "Waypoint to Altitude" not in fields:
            return fields
        metres = struct.unpack(">f", struct.pack(">f", fields["Waypoint to Altitude"] * 0.02 - 0.005))[0]
        return {**fields, "Waypoint to Altitude": math.floor(metres / 0.02)}
    each(vsm, "mission", "download_of", lambda old: lambda plan: [(id, rounded(fields)) for id, fields in old(plan)])


@mutant("V18", "presence vector bit 0 stands for field 2", "PV-002 PV-003")
def _(vsm):
    def alter(wire):
        header, data, style = parts_of(wire)
        size = reference.MESSAGES[int.from_bytes(header[12:14], "big")]["pv_bytes"]
        presence = int.from_bytes(data[:size], "big") >> 1
        return resealed(header, presence.to_bytes(size, "big") + data[size:], style)
    change_wire(vsm, alter)


@mutant("V19", "presence vector ignored: all fields expected in every command", "PV-004 PV-007 MODE-015")
def _(vsm):
    def make(old):
        def fields(layout, data):
            if not 2000 <= layout["id"] < 3000:
                return old(layout, data)
            return old(layout, ((1 << len(layout["fields"])) - 1).to_bytes(layout["pv_bytes"], "big") + data[layout["pv_bytes"]:])
        return fields
    replace(vsm.codec, "fields", make)


@mutant("V20", "absent fields read as 0", "PV-004 MODE-015")
def _(vsm):
    each(vsm, "steering", "setting", lambda old: lambda fields, name: fields.get(name, 0))
    each(vsm, "steering", "problem_of_loiter", lambda old: lambda settings: None)
    each(vsm, "steering", "commanded_mode", lambda old: lambda fields: fields.get("Select Flight Path Control Mode", LOITER))
    each(vsm, "steering", "altitude", lambda old: lambda fields: old({"Commanded Altitude": 0, "Altitude Type": 2, **fields}))


@mutant("V21", "text fields filled to the last byte without NUL", "SCALAR-005")
def _(vsm):
    def alter(id, source, destination, fields, ack=False):
        layout = reference.MESSAGES[id]["fields"]
        texts = {f["name"]: reference.width(f["type"])[0] for f in layout if f["type"].startswith("char") and f["name"] in fields}
        wire = lawful(id, source, destination, fields, ack)
        if not texts:
            return wire
        header, data, style = parts_of(wire)
        at, new = reference.MESSAGES[id]["pv_bytes"], bytearray(data)
        for field in layout:
            if field["name"] in fields:
                size = reference.width(field["type"])[0]
                if field["name"] in texts:
                    new[at : at + size] = fields[field["name"]].encode().ljust(size, b" ")[:size]
                at += size
        return resealed(header, bytes(new), style)
    lawful = vsm.codec.encode
    vsm.codec.encode = alter


@mutant("V22", "reserved flight path mode 13 sent while the vehicle is in an unknown mode", "SCALAR-006")
def _(vsm):
    each(vsm, "steering", "reported_mode", lambda old: lambda: 13 if old() in (NO_MODE, RETURN) else old())


@mutant("V23", "heading is magnetic", "SCALAR-008")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle, "reported_heading", lambda old, v=vehicle: lambda heading: heading - v.aircraft.variation)


@mutant("V24", "vertical speed with up positive in W_Speed", "STAT-007")
def _(vsm):
    each(vsm, "", "down_speed", lambda old: lambda up: units.fine(up))


@mutant("V25", "altitude above the sea reported as type 3", "STAT-008")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle, "reported_altitude", lambda old, v=vehicle: lambda above_sea: v.altitude_field(above_sea))


# Discovery and authority

def change_discovery(vsm, make):
    """Changes what happens to a discovery: `make(old, vehicle)` gives the new `authorise`."""
    for vehicle in vsm.vehicles:
        replace(vehicle, "authorise", lambda old, v=vehicle: make(old, v))


@mutant("V26", "broadcast discovery unanswered, directed request answered", "DISC-001")
def _(vsm):
    replace(vsm, "addressed", lambda old: lambda message: [] if message.id == 1 and message.destination == BROADCAST else old(message))


@mutant("V27", "one response for two vehicles", "DISC-002")
def _(vsm):
    replace(vsm, "addressed", lambda old: lambda message: old(message)[:1])


@mutant("V28", "LOI Granted in the discovery answer repeats LOI Authorised", "DISC-003 AUTH-016")
def _(vsm):
    def make(old, v):
        def authorise(message, discovery):
            v.granted_field = v.authority.authorised if discovery else lambda cucs: v.authority.granted(cucs)
            return old(message, discovery)
        return authorise
    change_discovery(vsm, make)


@mutant("V29", "CUCS ids that are not listed may discover and connect", "DISC-004")
def _(vsm):
    access = next(iter(vsm.access.values()))

    def known(source):
        vsm.access.setdefault(source, access)
        return True
    vsm.known_source = known


@mutant("V30", "discovery of the controller is taken as a release", "DISC-007")
def _(vsm):
    def make(old, v):
        def authorise(message, discovery):
            if discovery and v.authority.controls(message.source):
                v.authority.release(message.source, 15, 0, v.now())
            return old(message, discovery)
        return authorise
    change_discovery(vsm, make)


@mutant("V31", "LOI bits 2, 4, 8, 16", "AUTH-012")
def _(vsm):
    change_sent(vsm, lambda id, fields: {n: v << 1 if n in ("LOI Authorized", "LOI Granted") else v for n, v in fields.items()})

    def make(old):
        def take(message, address):
            if "Requested/Handover LOI" in message.fields:
                message.fields["Requested/Handover LOI"] >>= 1
            old(message, address)
        return take
    replace(vsm, "take", make)


@mutant("V32", "LOI 4 granted to two CUCSs", "AUTH-002 HAND-002 MULTI-004")
def _(vsm):
    for vehicle in vsm.vehicles:
        vehicle.authority._take_control = lambda cucs, loi, access, now, a=vehicle.authority: a.give(cucs, loi)


@mutant("V33", "override granted to anyone", "AUTH-003 AUTH-011")
def _(vsm):
    each(vsm, "authority", "may_override", lambda old: lambda cucs: True)


@mutant("V34", "override leaves the former holder's commands valid for some seconds", "AUTH-003 HAND-002")
def _(vsm):
    for vehicle in vsm.vehicles:
        former = {}

        def take_from(cucs, v=vehicle, former=former, lawful=vehicle.authority.take_from):
            former[cucs] = v.now() + 4.0
            lawful(cucs)
        vehicle.authority.take_from = take_from
        replace(vehicle, "permits", lambda old, v=vehicle, former=former: lambda message: (
            None if former.get(message.source, 0) > v.now() else old(message)))


@mutant("V35", "control given up after 30 s without a command", "AUTH-004")
def _(vsm):
    commanded = {}
    for vehicle in vsm.vehicles:
        def handle(message, v=vehicle, lawful=vehicle.handle):
            if message.id not in (17001, 17002):
                commanded[v, message.source] = v.now()
            return lawful(message)

        def watch(now, v=vehicle, lawful=vehicle.watch_station):
            holder = v.authority.holder()
            if holder is not None and now - commanded.setdefault((v, holder), now) > 30:
                v.authority.take_from(holder)
                del commanded[v, holder]
            lawful(now)
        vehicle.handle, vehicle.watch_station = handle, watch


@mutant("V36", "release by any CUCS frees the vehicle", "AUTH-017")
def _(vsm):
    for vehicle in vsm.vehicles:
        def release(cucs, loi, stations, now, a=vehicle.authority, lawful=vehicle.authority.release):
            holder = a.holder()
            lawful(holder if holder is not None and loi & CONTROL else cucs, loi, stations, now)
        vehicle.authority.release = release


def without_loi(vsm, *ids):
    each(vsm, "", "permits", lambda old: lambda message: None if message.id in ids else old(message))


@mutant("V37", "2016 and 2017 accepted without LOI 4", "AUTH-006")
def _(vsm):
    without_loi(vsm, 2016, 2017)


@mutant("V38", "payload commands accepted from the holder of LOI 4 alone", "AUTH-009 PAYL-002")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.payloads, "may_command", lambda old, v=vehicle: lambda cucs, mask: old(cucs, mask) or v.authority.has(cucs, LOI_4))


@mutant("V39", "station mask ignored: LOI 3 is for all stations", "AUTH-008 PAYL-003")
def _(vsm):
    for vehicle in vsm.vehicles:
        everywhere = vehicle.payloads.mask
        replace(vehicle.authority, "_take_stations", lambda old, mask=everywhere: lambda cucs, stations, access: old(cucs, mask, access))
        replace(vehicle.payloads, "mask_of", lambda old, mask=everywhere: lambda fields: mask)
        vehicle.payloads.may_command = lambda cucs, mask, a=vehicle.authority: bool(a.stations_of(cucs))


@mutant("V40", "mode 21 (launch) accepted with LOI 4", "AUTH-013")
def _(vsm):
    each(vsm, "steering", "loi_needed", lambda old: lambda fields: 4)


@mutant("V41", "control forgotten when the CUCS comes back from another port, or the VSM restarts", "AUTH-019 AUTH-018")
def _(vsm):
    def make(old):
        def peer(source, address):
            known = vsm.peers.get(source)
            if known and known.address != address:
                for vehicle in vsm.vehicles:
                    vehicle.authority.release(source, 15, 0, vsm.now())
            return old(source, address)
        return peer
    replace(vsm, "peer", make)
    vsm.restore = lambda: None


# Missions

@mutant("V42", "waypoints flown as they arrive, before the load command", "ROUTE-002")
def _(vsm):
    for vehicle in vsm.vehicles:
        def store(id, fields, m=vehicle.mission, lawful=vehicle.mission.store):
            problem = lawful(id, fields)
            if not problem and id == 13002:
                if len(m.upload.waypoints) == 1:
                    m.aboard = plans.Plan(m.aboard.mission)
                m.aboard.waypoints[fields["Waypoint Number"]] = m.upload.waypoints[fields["Waypoint Number"]]
            return problem
        vehicle.mission.store = store


@mutant("V43", "waypoints flown in order of number", "ROUTE-004 MODE-004")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.mission, "flown_order", lambda old, m=vehicle.mission: lambda start: sorted(n for n in m.aboard.waypoints if n >= min(old(start))))
        replace(vehicle.mission, "first_waypoint", lambda old, m=vehicle.mission: lambda kinds: min(m.aboard.waypoints) if old(kinds) else None)


@mutant("V44", "route with a gap accepted", "ROUTE-006 ROUTE-019")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.mission, "problem_of_leg", lambda old, m=vehicle.mission: lambda plan, number, fields: (
            old(plan, number, fields) if fields.get("Next Waypoint", 0) in plan.waypoints else None))


@mutant("V45", "half an upload kept after a refusal, the old plan gone", "ROUTE-007 HAND-007")
def _(vsm):
    for vehicle in vsm.vehicles:
        def problem_of_plan(plan, m=vehicle.mission, lawful=vehicle.mission.problem_of_plan):
            problem = lawful(plan)
            if problem:
                m.aboard = plan
            return problem
        vehicle.mission.problem_of_plan = problem_of_plan


@mutant("V46", "download returns the autopilot's item numbers and rounded values", "ROUTE-008 STAT-010")
def _(vsm):
    def download_of(plan):
        items = {number: k for k, number in enumerate(plan.waypoints, 1)}
        for number, fields in plan.waypoints.items():
            grid = {n: round(fields[n] * 180 / 2**31 * 1e5) * 2**31 // int(180e5) for n in fields if n.startswith("Waypoint to L")}
            yield 13002, {**fields, **grid, "Waypoint Number": items[number], "Next Waypoint": items.get(fields.get("Next Waypoint", 0), 0)}
    each(vsm, "mission", "download_of", lambda old: download_of)


@mutant("V47", "loiter duration read as minutes", "ROUTE-015")
def _(vsm):
    each(vsm, "mission", "loiter_seconds", lambda old: lambda fields: 60 * old(fields))


@mutant("V48", "altitude type ignored: everything is above the sea", "ROUTE-016")
def _(vsm):
    each(vsm, "", "above_sea", lambda old: lambda altitude, kind: altitude)


@mutant("V49", "14000 'complete' sent before the vehicle has taken the plan", "ROUTE-001 ROUTE-007")
def _(vsm):
    for vehicle in vsm.vehicles:
        def load(cucs, mission, now, m=vehicle.mission, lawful=vehicle.mission.load):
            m.status(cucs, plans.COMPLETE, 100, plans.LOAD, mission)
            speak, m._report = m._report, lambda *_: None
            try:
                problem = lawful(cucs, mission, now)
            finally:
                m._report = speak
            if m.transfer:
                m.transfer.takes += 3.0
                m.transfer.cucs = None
            return problem

        def status(cucs, *rest, lawful=vehicle.mission.status):
            if cucs is not None:
                lawful(cucs, *rest)
        vehicle.mission.load, vehicle.mission.status = load, status


# Modes

@mutant("V50", "mode report shows the mode asked for, though the vehicle refused it", "MODE-002 ACK-007")
def _(vsm):
    for vehicle in vsm.vehicles:
        asked = []

        def command_mode(fields, v=vehicle, asked=asked, lawful=vehicle.steering.command_mode):
            before, outcome = v.steering.aircraft.mode, lawful(fields)
            if outcome.reason and "Select Flight Path Control Mode" in fields:
                asked[:] = [(fields["Select Flight Path Control Mode"], before)]
            return outcome

        def reported_mode(v=vehicle, asked=asked, lawful=vehicle.steering.reported_mode):
            if asked and asked[0][1] == v.aircraft.mode:
                return asked[0][0]
            return lawful()
        vehicle.steering.command_mode, vehicle.steering.reported_mode = command_mode, reported_mode


@mutant("V51", "unsupported modes mapped to 'hold'", "MODE-003 CONF-004")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.steering, "commanded_mode", lambda old, s=vehicle.steering: lambda fields: (
            LOITER if s.problem_of_mode(old(fields)) else old(fields)))


@mutant("V52", "flight termination executes without being armed", "MODE-009")
def _(vsm):
    each(vsm, "steering", "may_execute", lambda old: lambda: True)


# Status

@mutant("V53", "status at 1 Hz whatever 17001 asks for", "STAT-002 STAT-003")
def _(vsm):
    vsm.push_hz = 1.0
    replace(vsm, "period", lambda old: lambda frequency: 1.0)


@mutant("V54", "cancel by one CUCS stops the stream of all", "MULTI-003")
def _(vsm):
    def make(old):
        def schedule(cucs, vehicle, id, frequency):
            old(cucs, vehicle, id, frequency)
            if not frequency:
                for peer in vsm.peers.values():
                    peer.schedules[vehicle.number, id] = type(next(iter(peer.schedules.values())))(1e9, math.inf, True)
        return schedule
    replace(vsm, "schedule", make)


@mutant("V55", "last position repeated with new stamps after the vehicle fell silent", "STAT-015 LINK-004 TIME-003")
def _(vsm):
    for vehicle in vsm.vehicles:
        vehicle.status_is_fresh = lambda: True
        vehicle.stamp_of = lambda id: units.stamp()
        vehicle.watch_link = lambda now: None
        lawful = vehicle.aircraft.advance
        vehicle.aircraft.advance = lambda seconds, v=vehicle, advance=lawful: advance(seconds) if v.link_up else None


@mutant("V56", "no fix reported as latitude 0, longitude 0", "STAT-014")
def _(vsm):
    each(vsm, "", "unknown_position", lambda old: lambda: {"Latitude": 0, "Longitude": 0})


@mutant("V57", "Configuration Complete sent first", "CONF-001")
def _(vsm):
    each(vsm, "configuration", "phase", lambda old: lambda kind, stations: old(kind, stations)[-1:] + old(kind, stations)[:-1])


# Acknowledgement and hostile input

@mutant("V58", "acknowledges before doing: type 2 at once for every command", "ACK-007")
def _(vsm):
    replace(vsm, "settle", lambda old: lambda message, vehicle, outcome: old(message, vehicle, Outcome()))


@mutant("V59", "duplicates carried out again", "ACK-006 ROBUST-010")
def _(vsm):
    replace(vsm, "is_duplicate", lambda old: lambda peer, key: False)
    replace(vsm, "untimely", lambda old: lambda message, vehicle, peer: None)


@mutant("V60", "endless loop on a message of length 0", "ROBUST-002")
def _(vsm):
    def make(old):
        def split(datagram):
            while len(datagram) >= HEADER.size and datagram[2:4] == b"\0\0":
                # The process hangs for good, without burning a core of the machine that tests it.
                time.sleep(1)
            yield from old(datagram)
        return split
    replace(vsm.codec, "split", make)
