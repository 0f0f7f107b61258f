"""More faults, each a small slip of the kind that a review overlooks: a wrong field, sign, number, step, receiver, or only the second time.

The table of `REPORTS` has those that change the fields of one message; the functions below it have the others. The id of a fault is
that of the rule that has to fail, with a letter.
"""
import math

from . import alerts as alert
from . import units
from .authority import CONTROL, LOI_2
from .change import each, replace, table
from .faults_by_rule import after, before, change_reports
from .mutants import change_sent, change_wire, parts_of, resealed, without_loi
from .steering import LOITER, LOITER_DEFAULTS
from .wire import BROADCAST, HEADER, reference

IN_DETAIL, _entry = table()


def fault(id, title):
    return _entry(id, title, id.rstrip("bcde"))


def swapped(a, b):
    return lambda f: f | {a: f[b], b: f[a]} if a in f and b in f else f


def with_(**fields):
    return lambda f: f | {name.replace("_", " "): value for name, value in fields.items()}


def scaled(names, factor):
    return lambda f: f | {n: int(f[n] * factor) for n in names if n in f}


ENDS = ("Min Value", "Max Value")
# Id, title, message, and what becomes of its fields.
REPORTS = (
    ("STAT-007b", "north and east speeds exchanged", 4000, swapped("U_Speed", "V_Speed")),
    ("STAT-007c", "speeds in steps of 0.1 m/s", 4000, scaled(("U_Speed", "V_Speed", "W_Speed"), 0.5)),
    ("SCALAR-003b", "latitude and longitude exchanged", 4000, swapped("Latitude", "Longitude")),
    ("SCALAR-008b", "heading counter-clockwise", 4000, lambda f: f | {"Heading": -f["Heading"]}),
    ("STAT-008b", "altitude above the ellipsoid called barometric", 4000, lambda f: f | {"Altitude Type": 1} if "Altitude" in f else f),
    ("STAT-010b", "From and To exchanged", 4001, swapped("From Waypoint Number", "To Waypoint Number")),
    ("STAT-010c", "Next repeats To", 4001, lambda f: f | {"Next Waypoint Number": f["To Waypoint Number"]}),
    ("STAT-011b", "To Waypoint Time is the time of the report", 4001, lambda f: f | {"To Waypoint Time": f["Time Stamp"]}),
    ("STAT-011c", "Next Waypoint Time is that of the next leg alone", 4001, lambda f: f | {"Next Waypoint Time": f["Time Stamp"] + 5}),
    ("STAT-012b", "3002 shows no commanded altitude but 0", 3002, with_(Commanded_Altitude=0)),
    ("MODE-001b", "3001 always shows mode 12", 3001, with_(Select_Flight_Path_Control_Mode=LOITER)),
    ("MODE-013b", "engines are counted from 0", 3007, lambda f: f | {"Engine Number": f["Engine Number"] - 1}),
    ("MODE-013c", "Engine Status repeats the command", 3007, lambda f: f | {"Engine Status": f["Reported Engine Command"] + 1}),
    ("MODE-014b", "lights one bit too high", 3006, lambda f: f | {"Navigation Lights State": f["Navigation Lights State"] << 1}),
    ("SCALAR-006b", "the reserved bit of the lights is set", 3006, lambda f: f | {"Navigation Lights State": f["Navigation Lights State"] | 0x20}),
    ("SCALAR-006c", "altitude type 7 in 3004", 3004, with_(Altitude_Type=7)),
    ("ACK-001b", "17000 names message 0", 17000, with_(Original_Message_Type=0)),
    ("ACK-001c", "17000 names its own time stamp", 17000, lambda f: f | {"Original Message Time Stamp": f.get("Time Stamp", 5)}),
    ("ALERT-003b", "report reference 0 in every alert", 16000, with_(Subsystem_State_Report_Reference=0)),
    ("ALERT-003c", "alerts of subsystem 15, which is none", 16000, with_(Subsystem_ID=15)),
    ("ALERT-001b", "alerts begin with a positive id", 16000, lambda f: f | {"Alert (Warning) ID": abs(f["Alert (Warning) ID"])}),
    ("ROUTE-012b", "Percent Complete goes on to 200", 14000, lambda f: f | {"Percent Complete": 2 * f["Percent Complete"]}),
    ("ROUTE-020b", "14000 names the plan mode one too high", 14000, lambda f: f | {"Mission Plan Mode": f["Mission Plan Mode"] + 1}),
    ("ROUTE-008b", "a download has no turn types", 13002, with_(Turn_Type=0)),
    ("ROUTE-008c", "speeds of waypoints come back in whole m/s", 13002, lambda f: f | {"Waypoint to Speed": f.get("Waypoint to Speed", 0) & ~1}),
    ("ROUTE-008d", "a loiter comes back without its duration", 13003, with_(Loiter_Duration=0)),
    ("ROUTE-013b", "every route comes back with initial waypoint 1", 13001, with_(Initial_Waypoint_Number=1)),
    ("CONF-001b", "41005 names another vehicle type", 41005, with_(Vehicle_Type=22)),
    ("CONF-004b", "44003 counts values from 1", 44003, lambda f: f | {"Reported Enumerated Index": f["Reported Enumerated Index"] + 1}
     if "Reported Enumerated Index" in f else f),
    ("CONF-007b", "minimum and maximum exchanged", 41003, swapped(*ENDS)),
    ("AUTH-001b", "Access Granted stays 0", 2, with_(Access_Granted=0)),
    ("AUTH-002b", "a denial says 'in control'", 2, with_(Access_Granted=1)),
    ("DISC-003b", "LOI Authorised is what is granted", 2, lambda f: f | {"LOI Authorized": f["LOI Granted"]}),
    ("AUTH-008b", "grants of LOI 3 name no station", 2, with_(**{"Controlled_Station_1-16": 0})),
    ("PAYL-004b", "azimuth is positive to the left", 21101, lambda f: f | {"Actual Centreline Azimuth Angle": -f["Actual Centreline Azimuth Angle"]}),
    ("PAYL-001b", "21000 names all stations at once", 21000, lambda f: f | {"Station Number 1-16": f["Payload Stations Available 1-16"]}),
    ("HAND-001b", "35000 never gets beyond 'in progress'", 35000, lambda f: f | {"Status": min(1, f["Status"])}),
    ("HAND-003b", "#5 names the giver", 5, with_(Requesting_CUCS_ID=0x1B0000A2)),
    ("STAT-016b", "subsystem states of 9", 16001, with_(Subsystem_State=9)),
    ("PV-005b", "altitude is left out of every second 4000", 4000, lambda f: {n: v for n, v in f.items() if n != "Altitude" or f["Time Stamp"] % 2}),
)


def _report(message, alter):
    return lambda vsm: change_reports(vsm, message, alter)


for _id, _title, _message, _alter in REPORTS:
    fault(_id, _title)(_report(_message, _alter))


# Wrapper, numbers, vectors

@fault("WRAP-014b", "property bits 5 to 0 are set")
def _(vsm):
    def alter(wire):
        header, data, style = parts_of(wire)
        return resealed(header[:15] + bytes([header[15] | 0x3F]), data, style)
    change_wire(vsm, alter)


@fault("WRAP-012b", "version 31")
def _(vsm):
    def alter(wire):
        header, data, style = parts_of(wire)
        return resealed(header[:14] + bytes([header[14] & 0x80 | 31]) + header[15:], data, style)
    change_wire(vsm, alter)


@fault("WRAP-003b", "Length is one too small")
def _(vsm):
    def alter(wire):
        header, data, style = parts_of(wire)
        words = list(HEADER.unpack(header))
        words[1] -= 1
        return resealed(HEADER.pack(*words), data, style)
    change_wire(vsm, alter)


@fault("WRAP-009b", "checksums of style 1 are not verified")
def _(vsm):
    replace(vsm.codec, "checksum_matches", lambda old: lambda style, covered, trailer: style == 1 or old(style, covered, trailer))


@fault("WRAP-013b", "every version up to the own one is served")
def _(vsm):
    replace(vsm.codec, "serves", lambda old: lambda idd: idd <= 32)


@fault("WRAP-016b", "messages for all name the first CUCS as their receiver")
def _(vsm):
    first = []

    def make(old):
        def encode(id, source, destination, fields, ack=False):
            first.append(destination)
            return old(id, source, first[0], fields, ack)
        return encode
    replace(vsm.codec, "encode", make)


@fault("WRAP-017b", "settings for everybody are obeyed")
def _(vsm):
    replace(vsm, "addressed", lambda old: lambda message: vsm.vehicles if message.destination == BROADCAST else old(message))


@fault("SCALAR-005b", "behind the NUL of a text is what was there before")
def _(vsm):
    def make(old):
        def encode(id, source, destination, fields, ack=False):
            wire = old(id, source, destination, fields, ack)
            header, data, style = parts_of(wire)
            at, new = reference.MESSAGES[id]["pv_bytes"], bytearray(data)
            for field in reference.MESSAGES[id]["fields"]:
                if field["name"] in fields:
                    size = reference.width(field["type"])[0]
                    if field["type"].startswith("char"):
                        end = len(fields[field["name"]]) + 1
                        new[at + end : at + size] = b"x" * max(0, size - end)
                    at += size
            return resealed(header, bytes(new), style)
        return encode
    replace(vsm.codec, "encode", make)


@fault("PV-006b", "bits beyond the last field are set")
def _(vsm):
    def alter(wire):
        header, data, style = parts_of(wire)
        layout = reference.MESSAGES[int.from_bytes(header[12:14], "big")]
        size = layout["pv_bytes"]
        unused = (1 << 8 * size) - (1 << len(layout["fields"]))
        return resealed(header, (int.from_bytes(data[:size], "big") | unused).to_bytes(size, "big") + data[size:], style)
    change_wire(vsm, alter)


@fault("PV-007b", "bytes behind the fields are ignored")
def _(vsm):
    def make(old):
        def fields(layout, data):
            size = layout["pv_bytes"]
            presence = int.from_bytes(data[:size], "big")
            known = sum(reference.width(f["type"])[0] for f in layout["fields"] if presence >> f["bit"] & 1)
            return old(layout, data[: size + known])
        return fields
    replace(vsm.codec, "fields", make)


@fault("PV-004b", "a 2017 sets what it does not name to its default")
def _(vsm):
    each(vsm, "steering", "setting", lambda old: lambda fields, name: fields.get(
        name, LOITER_DEFAULTS.get(name) if name != "Loiter Radius" and "Select Flight Path Control Mode" not in fields else None))


# Discovery and authority

@fault("DISC-001b", "each CUCS is answered its first discovery only")
def _(vsm):
    seen = set()

    def make(old):
        def take(message, address):
            if message.id == 1 and message.destination == BROADCAST:
                if message.source in seen:
                    return
                seen.add(message.source)
            old(message, address)
        return take
    replace(vsm, "take", make)


@fault("DISC-004b", "strangers may ask for #3")
def _(vsm):
    def known(source):
        return True

    def take(message, address, lawful=vsm.take):
        if message.source in vsm.access:
            lawful(message, address)
        elif message.id == 17002:
            v = vsm.vehicles[0]
            fields = {"VSM ID": v.vsm_id_field, "Vehicle Type": v.type, "Vehicle Subtype": v.subtype, "Tail Number": v.tail_number}
            vsm.socket.sendto(vsm.wire(message.source, v.id, 3, fields), address)
    vsm.known_source, vsm.take = known, take


@fault("AUTH-003b", "override is denied to all")
def _(vsm):
    each(vsm, "authority", "may_override", lambda old: lambda cucs: False)


@fault("AUTH-004b", "control ends 50 s after the grant")
def _(vsm):
    for vehicle in vsm.vehicles:
        given = {}
        after(vehicle.authority, "give", lambda _r, cucs, loi, v=vehicle, given=given: given.setdefault(cucs, v.now()) if loi & CONTROL else None)
        after(vehicle.authority, "release", lambda _r, cucs, *_, given=given: given.pop(cucs, None))

        def watch(now, v=vehicle, given=given):
            holder = v.authority.holder()
            if holder in given and now - given[holder] > 50:
                v.authority.take_from(holder)
                del given[holder]
        before(vehicle, "watch_station", watch)


@fault("AUTH-005b", "who has had control is obeyed after its release")
def _(vsm):
    for vehicle in vsm.vehicles:
        had = set()
        after(vehicle.authority, "give", lambda _r, cucs, _loi, had=had: had.add(cucs))
        replace(vehicle, "permits", lambda old, had=had: lambda message: None if message.source in had else old(message))


@fault("AUTH-006b", "13000 is accepted without LOI 4")
def _(vsm):
    without_loi(vsm, 13000)


@fault("AUTH-006c", "engines and termination are accepted without LOI 5")
def _(vsm):
    without_loi(vsm, 2005, 2008)


@fault("AUTH-013b", "landing is accepted with LOI 4")
def _(vsm):
    each(vsm, "steering", "loi_needed", lambda old: lambda fields: 4 if fields.get("Select Flight Path Control Mode") == 19 else old(fields))


@fault("AUTH-016b", "a second request of the holder takes its control away")
def _(vsm):
    for vehicle in vsm.vehicles:
        def request(cucs, loi, *rest, a=vehicle.authority, lawful=vehicle.authority.request):
            if a.controls(cucs):
                a.take_from(cucs)
            else:
                lawful(cucs, loi, *rest)
        vehicle.authority.request = request


@fault("AUTH-001c", "LOI 5 is granted with LOI 4")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.authority, "request", lambda old: lambda cucs, loi, *rest: old(cucs, loi | 8 if loi & 4 else loi, *rest))


@fault("AUTH-017b", "whoever gives up LOI 2 frees the vehicle")
def _(vsm):
    for vehicle in vsm.vehicles:
        def release(cucs, loi, stations, now, a=vehicle.authority, lawful=vehicle.authority.release):
            holder = a.holder()
            if loi & LOI_2 and a.held.get(cucs, 0) & LOI_2 and holder not in (None, cucs):
                a.take_from(holder)
            lawful(cucs, loi, stations, now)
        vehicle.authority.release = release


@fault("AUTH-019b", "status stays with the port that came first")
def _(vsm):
    firsts = {}

    def make(old):
        def peer(source, address):
            found = old(source, address)
            if any(v.authority.granted(source) for v in vsm.vehicles):
                found.address = firsts.setdefault(source, address)
            else:
                firsts.pop(source, None)
            return found
        return peer
    replace(vsm, "peer", make)


@fault("HAND-006b", "a change of control forgets the commanded altitude")
def _(vsm):
    for vehicle in vsm.vehicles:
        def changed(_result, cucs, granted, holder, handover, v=vehicle):
            if v.authority.holder() != holder:
                v.steering.commanded["Commanded Altitude"] = 0
        after(vehicle, "after_change", changed)


@fault("HAND-007b", "an upload goes on for whoever has control")
def _(vsm):
    for vehicle in vsm.vehicles:
        vehicle.mission.drop_upload = lambda: None


@fault("HB-001b", "heartbeats come every 0.4 s")
def _(vsm):
    vsm.heartbeat_s = 0.4


@fault("HB-003b", "control is offered without a word")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.alerts, "raise_", lambda old: lambda cause, *rest: None if cause == "silence" else old(cause, *rest))


# Missions

@fault("ROUTE-003b", "a loiter is lost that comes before its waypoint")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.mission, "store", lambda old, m=vehicle.mission: lambda id, fields: (
            None if id == 13003 and fields.get("Waypoint Number") not in m.upload.waypoints else old(id, fields)))


@fault("ROUTE-006b", "a route whose first waypoint is missing is accepted")
def _(vsm):
    for vehicle in vsm.vehicles:
        def problem_of_plan(plan, lawful=vehicle.mission.problem_of_plan):
            routes, plan.routes = plan.routes, {}
            found, plan.routes = lawful(plan), routes
            return found
        vehicle.mission.problem_of_plan = problem_of_plan


@fault("ROUTE-009b", "the waypoint after the one asked for is returned")
def _(vsm):
    for vehicle in vsm.vehicles:
        def command(cucs, fields, now, m=vehicle.mission, lawful=vehicle.mission.command):
            numbers = list(m.aboard.waypoints)
            if fields.get("Mission Plan Mode") == 4 and fields.get("Waypoint Number") in numbers:
                fields = fields | {"Waypoint Number": numbers[(numbers.index(fields["Waypoint Number"]) + 1) % len(numbers)]}
            return lawful(cucs, fields, now)
        vehicle.mission.command = command


@fault("ROUTE-011b", "a download cannot be cancelled")
def _(vsm):
    for vehicle in vsm.vehicles:
        def cancel(cucs, m=vehicle.mission, lawful=vehicle.mission.cancel):
            return lawful(cucs) if m.transfer is None or m.transfer.mode == 2 else None
        vehicle.mission.cancel = cancel


@fault("ROUTE-012c", "a download never says that it is over")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.mission, "status", lambda old: lambda cucs, status, percent, mode, mission: (
            None if mode == 3 and status == 1 else old(cucs, status, percent, mode, mission)))


@fault("ROUTE-015b", "loiters are flown the other way round")
def _(vsm):
    for vehicle in vsm.vehicles:
        def loiter_at(number, waypoint, lawful=vehicle.mission.loiter_at):
            made = lawful(number, waypoint)
            if made:
                made.clockwise = not made.clockwise
            return made
        vehicle.mission.loiter_at = loiter_at


@fault("ROUTE-015c", "the radius of a loiter waypoint is its diameter")
def _(vsm):
    for vehicle in vsm.vehicles:
        def loiter_at(number, waypoint, lawful=vehicle.mission.loiter_at):
            made = lawful(number, waypoint)
            if made:
                made.radius /= 2
            return made
        vehicle.mission.loiter_at = loiter_at


@fault("ROUTE-016b", "heights above the ellipsoid are flown as heights above the sea")
def _(vsm):
    each(vsm, "", "above_sea", lambda old: lambda altitude, kind: altitude if kind == 3 else old(altitude, kind))


# Flight commands

@fault("MODE-004b", "the commanded waypoint number is ignored")
def _(vsm):
    each(vsm, "mission", "route_from", lambda old: lambda *args, start=None: old(*args))


@fault("MODE-004c", "an unknown waypoint number begins at the first waypoint")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.mission, "route_from", lambda old, m=vehicle.mission: lambda *args, start=None: old(
            *args, start=start if start in m.aboard.waypoints else None))


@fault("MODE-005b", "loiters are always clockwise")
def _(vsm):
    each(vsm, "steering", "clockwise", lambda old: lambda: True)


@fault("MODE-005c", "the loiter radius of 2017 is flown as a diameter")
def _(vsm):
    each(vsm, "steering", "loiter_radius", lambda old: lambda: old() / 2)


@fault("MODE-006b", "vertical speed is positive down")
def _(vsm):
    each(vsm, "steering", "steering", lambda old: lambda fields: old(
        fields | {"Commanded Vertical Speed": -fields["Commanded Vertical Speed"]} if "Commanded Vertical Speed" in fields else fields))


@fault("MODE-006c", "the altitude is flown whatever the altitude command type")
def _(vsm):
    each(vsm, "steering", "steering", lambda old: lambda fields: old(
        fields | {"Altitude Command Type": 1} if "Commanded Altitude" in fields else fields))


@fault("MODE-008b", "speeds are read as km/h")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.aircraft, "change_speed", lambda old: lambda speed, airspeed: old(speed / 3.6, airspeed))


@fault("MODE-009b", "a reset does not disarm")
def _(vsm):
    for vehicle in vsm.vehicles:
        armed = []

        def terminate(fields, armed=armed, lawful=vehicle.steering.terminate):
            outcome = lawful(fields)
            if fields.get("Commanded Flight Termination State") == 1:
                armed.append(True)
            return outcome
        vehicle.steering.terminate = terminate
        replace(vehicle.steering, "may_execute", lambda old, armed=armed: lambda: bool(armed) or old())


@fault("MODE-015b", "a speed alone resets the commanded altitude")
def _(vsm):
    for vehicle in vsm.vehicles:
        def accept(fields, s=vehicle.steering, lawful=vehicle.steering.accept):
            lawful(fields)
            if "Commanded Speed" in fields and "Commanded Altitude" not in fields and "Select Flight Path Control Mode" not in fields:
                s.commanded["Commanded Altitude"] = 0
        vehicle.steering.accept = accept


# Status, configuration, alerts

@fault("STAT-001b", "status does not begin again after a second grant")
def _(vsm):
    ended = set()

    def make(old):
        def default_schedules(peer, vehicle, granted, now):
            if not granted and peer.schedules:
                ended.add(id(peer))
            if id(peer) not in ended:
                old(peer, vehicle, granted, now)
            elif not granted:
                peer.schedules = {}
        return default_schedules
    replace(vsm, "default_schedules", make)


@fault("STAT-003b", "scheduled messages come at twice the rate")
def _(vsm):
    replace(vsm, "period", lambda old: lambda frequency: old(frequency) / 2)


@fault("STAT-003c", "17001 works for 4000 only")
def _(vsm):
    replace(vsm, "schedule", lambda old: lambda cucs, vehicle, id, frequency: old(cucs, vehicle, id, frequency) if id == 4000 else None)


@fault("STAT-003d", "scheduled messages come 30 % too often")
def _(vsm):
    replace(vsm, "period", lambda old: lambda frequency: old(frequency) / 1.3)


@fault("STAT-004b", "the end of one schedule ends all status")
def _(vsm):
    def make(old):
        def schedule(cucs, vehicle, id, frequency):
            old(cucs, vehicle, id, frequency)
            if not frequency:
                for schedule in vsm.peers[cucs].schedules.values():
                    schedule.due = math.inf
        return schedule
    replace(vsm, "schedule", make)


@fault("STAT-005b", "each question is answered twice")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle, "answer", lambda old: lambda message: [old(message), old(message)][0])


@fault("STAT-005c", "an answer goes to every CUCS")
def _(vsm):
    for vehicle in vsm.vehicles:
        def answer(message, v=vehicle, lawful=vehicle.answer):
            for cucs in v.authority.watching():
                if cucs != message.source:
                    v.send_report(cucs, message.fields.get("Message Type", 0))
            return lawful(message)
        vehicle.answer = answer


@fault("STAT-015b", "the loss of the vehicle is not said")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.alerts, "raise_", lambda old: lambda cause, *rest: None if cause == "link" else old(cause, *rest))


@fault("MULTI-003b", "a schedule of one CUCS is everybody's")
def _(vsm):
    replace(vsm, "schedule", lambda old: lambda cucs, vehicle, id, frequency: [old(peer, vehicle, id, frequency) for peer in vsm.peers])


@fault("CONF-001c", "only the first request for configuration is answered")
def _(vsm):
    for vehicle in vsm.vehicles:
        asked = set()
        replace(vehicle.configuration, "request", lambda old, asked=asked: lambda cucs, fields: (
            None if fields.get("Request Type") not in (0, 6) and (cucs in asked or asked.add(cucs)) else old(cucs, fields)))


@fault("CONF-001d", "every request is answered by the configuration of LOI 4")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.configuration, "phase", lambda old: lambda kind, stations: old(3, stations))


@fault("CONF-002b", "fields are counted from 0")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.configuration, "about", lambda old: lambda *args, **named: (
            lambda made: made | {"Requested Field": made["Requested Field"] - 1})(old(*args, **named)))


@fault("CONF-002c", "what is not supported is called supported when it is asked for alone")
def _(vsm):
    for vehicle in vsm.vehicles:
        def single(message, number, stations, lawful=vehicle.configuration.single):
            id, fields = lawful(message, number, stations)
            return id, fields | {"Field Supported": 1} if "Field Supported" in fields else fields
        vehicle.configuration.single = single


@fault("ALERT-002b", "the end of an alert has a new id")
def _(vsm):
    change_sent(vsm, lambda id, fields: fields | {"Alert (Warning) ID": -7000 - fields["Alert (Warning) ID"]}
                if id == 16000 and fields.get("Priority") == alert.CLEARED else fields)


@fault("ALERT-004b", "every refusal says the same")
def _(vsm):
    each(vsm, "alerts", "refusal", lambda old: lambda cause, text, now: old(cause, "command refused", now))


@fault("ALERT-005b", "after a storm of refusals there are no more alerts")
def _(vsm):
    for vehicle in vsm.vehicles:
        count = [0]

        def refusal(cause, text, now, count=count, lawful=vehicle.alerts.refusal):
            count[0] += 1
            if count[0] < 100:
                lawful(cause, text, now)
        vehicle.alerts.refusal = refusal


# Acknowledgements

@fault("ACK-002b", "waypoints are acknowledged unasked")
def _(vsm):
    before(vsm, "take", lambda message, address: setattr(message, "ack", message.ack or message.id == 13002))


@fault("ACK-006b", "a repetition is not acknowledged again")
def _(vsm):
    vsm.repeat = lambda message, vehicle, acknowledged: vehicle.send_report(message.source, 2) if message.id == 1 else None


@fault("ACK-007b", "refusals are silent")
def _(vsm):
    replace(vsm, "acknowledge", lambda old: lambda message, vehicle, kind: old(message, vehicle, kind) if kind != 3 else None)


@fault("ACK-007c", "settings are received, and never carried out")
def _(vsm):
    replace(vsm, "acknowledge", lambda old: lambda message, vehicle, kind: old(message, vehicle, 1 if kind == 2 and message.id == 2017 else kind))


@fault("ACK-007d", "a refused command is carried out as well")
def _(vsm):
    def make(old):
        def settle(message, vehicle, outcome):
            old(message, vehicle, outcome)
            if outcome.reason:
                vsm.acknowledge(message, vehicle, 2)
        return settle
    replace(vsm, "settle", make)


# Payload and data link

@fault("PAYL-003b", "stations are counted from 0")
def _(vsm):
    for vehicle in vsm.vehicles:
        payloads = vehicle.payloads
        for name in ("steer", "set"):
            replace(payloads, name, lambda old, p=payloads: lambda fields: old(
                fields | {"Station Number 1-16": fields.get("Station Number 1-16", 0) << 1 & p.mask or 1}))


@fault("PAYL-004c", "a ground point is not looked at")
def _(vsm):
    for vehicle in vsm.vehicles:
        vehicle.payloads.toward = lambda target: (0.0, 0.0)


@fault("PAYL-006b", "a message without a firing field fires")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.payloads, "command_lasers", lambda old: lambda station, fields: old(station, {"Fire Laser Pointer": 238} | fields))


@fault("LINK-002b", "a link is granted to everybody")
def _(vsm):
    for vehicle in vsm.vehicles:
        before(vehicle, "assign_link", lambda message, v=vehicle: setattr(v, "link_holder", None))


@fault("LINK-004b", "commands are accepted while the vehicle is silent")
def _(vsm):
    for vehicle in vsm.vehicles:
        vehicle.unreachable = lambda: None
        replace(vehicle.steering, "take_values", lambda old, v=vehicle: lambda mode, fields: None if v.link_lost else old(mode, fields))
        vehicle.confirm = lambda now, v=vehicle: [vsm.acknowledge(m, v, 2) for m, _, _ in v.pending] and v.pending.clear()


# Time, several vehicles, malformed input

@fault("TIME-002b", "stamps are local time, an hour ahead")
def _(vsm):
    replace(vsm, "rising", lambda old: lambda cucs, source, id, stamp: old(cucs, source, id, stamp + 3_600_000))


@fault("TIME-002c", "stamps in whole seconds")
def _(vsm):
    replace(vsm, "rising", lambda old: lambda cucs, source, id, stamp: stamp // 1000 * 1000)


@fault("TIME-003b", "stamps of the vehicle's reports are 8 s old")
def _(vsm):
    each(vsm, "", "stamp_of", lambda old: lambda id: old(id) - (8000 if 3000 <= id <= 4001 else 0))


@fault("MULTI-002b", "a plan is loaded into every vehicle")
def _(vsm):
    for vehicle in vsm.vehicles:
        def aboard(plan):
            for other in vsm.vehicles:
                other.mission.aboard = plan
        vehicle.mission.take_aboard = aboard


@fault("ROBUST-001b", "a request for a download that is cut ends the process")
def _(vsm):
    def split(datagram):
        if len(datagram) > 16 and datagram[12:14] == (13000).to_bytes(2, "big") and len(datagram) < 16 + int.from_bytes(datagram[2:4], "big"):
            raise SystemExit(1)
    before(vsm.codec, "split", split)


@fault("ROBUST-002b", "a length beyond 528 ends the process")
def _(vsm):
    def split(datagram):
        if int.from_bytes(datagram[2:4], "big") > 528:
            raise SystemExit(1)
    before(vsm.codec, "split", split)


@fault("ROBUST-003b", "an unknown message ends the process")
def _(vsm):
    def decode(raw):
        if int.from_bytes(raw[12:14], "big") not in reference.MESSAGES:
            raise SystemExit(1)
    before(vsm.codec, "decode", decode)


@fault("ROBUST-009b", "the vehicle's own id may take control")
def _(vsm):
    vsm.access[vsm.options.vehicle_id] = next(iter(vsm.access.values()))


@fault("CURVE-004b", "a curve bends the other way")
def _(vsm):
    for vehicle in vsm.vehicles:
        def curve_to(number, points, lawful=vehicle.mission.curve_to):
            made = lawful(number, points)
            if made:
                for point in made:
                    north, _ = units.offset(points[-1].place, point.place)
                    point.place = units.moved(point.place, -2 * north, 0.0)
            return made
        vehicle.mission.curve_to = curve_to

