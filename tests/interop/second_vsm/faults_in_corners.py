"""Faults in the corners that the other tables leave: what one value of several, the second of two, or the moment between two commands shows.

They were thought of from the messages, field by field, not from the rules: each showed, by reading or by running it, that the rules of
that time passed it. The id of a fault is that of the rule that has to fail, with a letter from `p` on.
"""
from . import aircraft as flight
from .change import each, replace, table
from .faults_by_rule import after, change_reports
from .faults_in_detail import swapped
from .mission import CANCEL
from .steering import Outcome
from .wire import reference

IN_CORNERS, _entry = table()


def fault(id, title):
    return _entry(id, title, id[:-1])


# Id, title, message, and what becomes of its fields.
REPORTS = (
    ("STAT-010p", "4001 has waypoint altitudes above the sea, under type 3", 4001,
     lambda f: f | {n: f[n] - 2350 for n in ("From Waypoint Altitude", "To Waypoint Altitude", "Next Waypoint Altitude") if f.get(n)}),
    ("STAT-010q", "4001 has waypoint speeds in whole m/s", 4001,
     lambda f: f | {n: f[n] // 2 for n in ("To Waypoint Speed", "Next Waypoint Speed") if n in f}),
    ("STAT-011p", "From Waypoint Time is the arrival at To", 4001, lambda f: f | {"From Waypoint Time": f["To Waypoint Time"] + 60_000}),
    ("STAT-012p", "3002 exchanges latitude and longitude of the loiter place", 3002,
     swapped("Commanded Loiter Position Latitude", "Commanded Loiter Position Longitude")),
    ("STAT-012q", "3002 shows the commanded course as heading", 3002, swapped("Commanded Heading", "Commanded Course")),
    ("STAT-012r", "3002 shows commanded speeds in m/s", 3002, lambda f: f | {"Commanded Speed": f["Commanded Speed"] // 2}),
    ("STAT-007p", "U_Ground and V_Ground of 3009 exchanged", 3009, swapped("U_Ground", "V_Ground")),
    ("STAT-008p", "3009 has the altitude above the sea as WGS-84 Altitude", 3009, lambda f: f | {"WGS-84 Altitude": f["Barometric Altitude"]}),
    ("DISC-010p", "41005 names another VSM than 2", 41005, lambda f: f | {"VSM ID": f["VSM ID"] + 1}),
    ("DISC-009p", "Vehicle ID Update of 3 is an id of another", 3, lambda f: f | {"Vehicle ID Update": f["Vehicle ID Update"] + 77}),
    ("SCALAR-009p", "Turn Rate of 4000 is positive to the left", 4000, lambda f: f | {"Turn Rate": -f["Turn Rate"]}),
)
for _id, _title, _message, _alter in REPORTS:
    fault(_id, _title)(lambda vsm, message=_message, alter=_alter: change_reports(vsm, message, alter))


# Wrapper, vectors, acknowledgements

@fault("WRAP-005p", "at most four messages of a datagram are taken")
def _(vsm):
    replace(vsm.codec, "split", lambda old: lambda datagram: list(old(datagram))[:4])


@fault("WRAP-008p", "a CRC-32 is not verified")
def _(vsm):
    replace(vsm.codec, "checksum_matches", lambda old: lambda style, covered, trailer: style == 3 or old(style, covered, trailer))


@fault("WRAP-009p", "only the first checksum of a datagram is verified")
def _(vsm):
    def make(old):
        def split(datagram):
            whole, lawful = list(old(datagram)), vsm.codec.checksum_matches
            if whole and len(whole[0]) < len(datagram):
                vsm.codec.checksum_matches = lambda style, covered, trailer: True
                whole = list(old(datagram))
                vsm.codec.checksum_matches = lawful
            return whole
        return split
    replace(vsm.codec, "split", make)


@fault("WRAP-009q", "the high half of a checksum is not compared")
def _(vsm):
    replace(vsm.codec, "checksum_matches", lambda old: lambda style, covered, trailer: (
        reference.checksum(style, covered)[-1:] == trailer[-1:] if style in (1, 2) else old(style, covered, trailer)))


@fault("PV-002p", "bit 0 of the requested fields stands for field 2")
def _(vsm):
    replace(vsm, "only", lambda old: lambda id, fields, wanted: old(id, fields, wanted << 1))


@fault("ACK-001p", "schedules are not acknowledged")
def _(vsm):
    def acknowledge(message, vehicle, kind, lawful=vsm.acknowledge):
        if message.id != 17001:
            lawful(message, vehicle, kind)
    vsm.acknowledge = acknowledge


@fault("SCALAR-007p", "a speed type out of range is taken")
def _(vsm):
    each(vsm, "steering", "problem_of_values", lambda old: lambda fields: old({n: v for n, v in fields.items() if n != "Speed Type"}))


# Rights

@fault("AUTH-001p", "Access Granted stays 1 after a release")
def _(vsm):
    had = set()

    def alter(fields, cucs):
        if fields["Access Granted"]:
            had.add(cucs)
        return fields | {"Access Granted": 1 if cucs in had else 0}
    replace(vsm.codec, "encode", lambda old: lambda id, source, cucs, fields, ack=False: old(
        id, source, cucs, alter(fields, cucs) if id == 2 else fields, ack))


@fault("AUTH-006p", "anybody may cancel the upload of the holder")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle, "permits", lambda old: lambda message: (
            None if message.id == 13000 and message.fields.get("Mission Plan Mode") == CANCEL else old(message)))


@fault("AUTH-006q", "waypoints are accepted without LOI 4")
def _(vsm):
    each(vsm, "", "permits", lambda old: lambda message: None if message.id in (13001, 13002, 13003) else old(message))


@fault("AUTH-016p", "the same request a second time is not answered")
def _(vsm):
    replace(vsm, "repeat", lambda old: lambda message, vehicle, acknowledged: None if message.id == 1 else old(message, vehicle, acknowledged))


@fault("AUTH-018p", "a release is not stored: the holder before a restart has control again")
def _(vsm):
    def save(lawful=vsm.save):
        if any(v.authority.holder() for v in vsm.vehicles):
            lawful()
    vsm.save = save


@fault("DISC-004p", "strangers may ask for subsystems")
def _(vsm):
    def take(message, address, lawful=vsm.take):
        if message.source in vsm.access:
            lawful(message, address)
        elif message.id == 15000:
            fields = {"Subsystem ID": 9, "Subsystem State": 1, "Subsystem State Report Reference": -1}
            vsm.socket.sendto(vsm.wire(message.source, vsm.vehicles[0].id, 16001, fields), address)
    vsm.known_source, vsm.take = lambda source: True, take


@fault("HAND-006p", "a change of control resets the loiter settings")
def _(vsm):
    for vehicle in vsm.vehicles:
        def changed(_result, cucs, granted, holder, handover, v=vehicle):
            if v.authority.holder() not in (None, holder):
                v.steering.loiter["Loiter Radius"] = 40
        after(vehicle, "after_change", changed)


@fault("HAND-006q", "a change of control clears the mission")
def _(vsm):
    for vehicle in vsm.vehicles:
        def changed(_result, cucs, granted, holder, handover, v=vehicle):
            if v.authority.holder() not in (None, holder):
                v.mission.aboard = type(v.mission.aboard)()
        after(vehicle, "after_change", changed)


# Missions

@fault("ROUTE-006p", "Waypoint Request names the waypoint after the one that is missing")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.mission, "status", lambda old, m=vehicle.mission: lambda cucs, status, percent, mode, mission: (
            m._report(cucs, 14000, {"Mission ID": mission, "Status": status, "Percent Complete": percent, "Waypoint Request": 23, "Mission Plan Mode": mode})
            if mission == "GAP" and status == 2 else old(cucs, status, percent, mode, mission)))


@fault("ROUTE-007p", "a refused upload ends the route that is flown")
def _(vsm):
    for vehicle in vsm.vehicles:
        def reject(_result, *_args, a=vehicle.aircraft):
            if a.mode in flight.ON_ROUTE:
                a.hold()
        after(vehicle.mission, "reject", reject)


@fault("ROUTE-008p", "a download has all altitudes above the ellipsoid")
def _(vsm):
    for vehicle in vsm.vehicles:
        def download_of(plan, v=vehicle, lawful=vehicle.mission.download_of):
            for id, fields in lawful(plan):
                if id == 13002 and fields.get("Waypoint Altitude Type") == 2:
                    fields = fields | {"Waypoint Altitude Type": 3, "Waypoint to Altitude": fields["Waypoint to Altitude"] + 26_750}
                yield id, fields
        vehicle.mission.download_of = download_of


@fault("ROUTE-009p", "a single download has no loiter")
def _(vsm):
    for vehicle in vsm.vehicles:
        def start(cucs, mode, mission, queue, now, lawful=vehicle.mission._start_download):
            return lawful(cucs, mode, mission, [m for m in queue if mode != 4 or m[0] != 13003], now)
        vehicle.mission._start_download = start


@fault("ROUTE-010p", "clear removes the waypoints and leaves the routes")
def _(vsm):
    for vehicle in vsm.vehicles:
        def clear(cucs, mission, m=vehicle.mission, lawful=vehicle.mission.clear):
            routes = m.aboard.routes
            result = lawful(cucs, mission)
            m.aboard.routes = routes
            return result
        vehicle.mission.clear = clear


@fault("ROUTE-013p", "approach routes come back as flights")
def _(vsm):
    change_reports(vsm, 13001, lambda f: f | {"Route Type": 2} if f.get("Route Type") == 1 else f)


@fault("ROUTE-020p", "a refusal names no mission")
def _(vsm):
    change_reports(vsm, 14000, lambda f: f | {"Mission ID": ""} if f["Status"] == 2 else f)


# Flight

@fault("MODE-004p", "without a waypoint number the flight begins at the last waypoint")
def _(vsm):
    for vehicle in vsm.vehicles:
        def route_from(kinds=(2, 0, 1), start=None, m=vehicle.mission, lawful=vehicle.mission.route_from):
            return lawful(kinds, list(m.aboard.waypoints)[-1] if start is None and m.aboard.waypoints else start)
        vehicle.mission.route_from = route_from


@fault("MODE-005p", "the altitude of a loiter command is ignored")
def _(vsm):
    each(vsm, "aircraft", "hold", lambda old: lambda place=None, altitude=None, *rest, **named: old(place, None if place else altitude, *rest, **named))


@fault("MODE-005q", "the speed of a loiter command is ignored")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.aircraft, "change_speed", lambda old, a=vehicle.aircraft: lambda speed, airspeed: None if a.mode == flight.LOITER else old(speed, airspeed))


@fault("MODE-005r", "To 65535 of 4001 is where the vehicle is, not where it was sent")
def _(vsm):
    for vehicle in vsm.vehicles:
        def send_report(cucs, id, mask=0, wanted=0, a=vehicle.aircraft, lawful=vehicle.send_report):
            if id != 4001 or a.loiter is None:
                return lawful(cucs, id, mask, wanted)
            place, a.loiter.place = a.loiter.place, a.place
            try:
                return lawful(cucs, id, mask, wanted)
            finally:
                a.loiter.place = place
        vehicle.send_report = send_report


@fault("MODE-006p", "mode 15 holds its vertical speed beside a commanded altitude")
def _(vsm):
    for vehicle in vsm.vehicles:
        def steering(fields, s=vehicle.steering, lawful=vehicle.steering.steering):
            made = lawful(fields)
            if fields.get("Commanded Vertical Speed"):
                made.altitude, made.vertical_speed = None, fields["Commanded Vertical Speed"] * 0.05
            return made
        vehicle.steering.steering = steering


@fault("MODE-009p", "'execute' after 'arm' is acknowledged, and nothing happens")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.steering, "terminate", lambda old: lambda fields: Outcome() if fields.get("Commanded Flight Termination State") == 2 else old(fields))


@fault("MODE-011p", "a launch climbs to twice the commanded height")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.aircraft, "launch", lambda old, a=vehicle.aircraft: lambda altitude=None: old(
            None if altitude is None else a.ground + 2 * (altitude - a.ground)))


# Configuration, alerts, payloads, links

@fault("CONF-001p", "the configuration of payloads never ends")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.configuration, "phase", lambda old: lambda kind, stations: [m for m in old(kind, stations) if kind != 2 or m[0] != 41005])


@fault("CONF-004p", "a loiter type that is refused is not listed")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.configuration, "answers", lambda old: lambda kind, stations: [
            (id, f) for id, f in old(kind, stations) if (f.get("Reported Message"), f.get("Reported Enumerated Index")) != (2017, 3)])


@fault("CONF-008p", "radii below the declared minimum are accepted")
def _(vsm):
    each(vsm, "steering", "problem_of_loiter", lambda old: lambda settings: old(
        {n: v for n, v in settings.items() if n != "Loiter Radius" or v > 20_000}))


@fault("CONF-008q", "waypoints faster than declared are accepted")
def _(vsm):
    for vehicle in vsm.vehicles:
        vehicle.mission.fastest_mps = 200.0


@fault("ALERT-002p", "who connects is sent alerts that are over")
def _(vsm):
    for vehicle in vsm.vehicles:
        old_ones = []

        def clear(cause, own=vehicle.alerts, old_ones=old_ones, lawful=vehicle.alerts.clear):
            if cause in own.open:
                old_ones.append(dict(own.fields(own.open[cause], own.open[cause].id)))
            lawful(cause)
        vehicle.alerts.clear = clear
        replace(vehicle.alerts, "standing", lambda old, old_ones=old_ones: lambda: old() + old_ones)


@fault("PAYL-003p", "of two addressed stations the first alone moves")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.payloads, "addressed", lambda old: lambda mask: old(mask)[:1])


@fault("PAYL-004p", "slew rates turn to the left")
def _(vsm):
    for vehicle in vsm.vehicles:
        def steer(_result, fields, own=vehicle.payloads):
            for station in own.stations:
                station.rates = (-station.rates[0], station.rates[1])
        after(vehicle.payloads, "steer", steer)


@fault("PAYL-005p", "21100 is not answered")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle, "send_report", lambda old: lambda cucs, id, *rest: id != 21100 and old(cucs, id, *rest))


@fault("PAYL-007p", "the image centre is below the vehicle wherever the camera looks")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.payloads, "image_centre", lambda old, a=vehicle.aircraft: lambda station: old(station) and a.place)


@fault("LINK-004p", "what is refused while the vehicle is silent is done when it is back")
def _(vsm):
    for vehicle in vsm.vehicles:
        waiting = []

        def command(fields, v=vehicle, waiting=waiting, lawful=vehicle.steering.command_engine):
            if v.link_lost:
                waiting.append(fields)
            return lawful(fields)

        def connected(_result, *_args, v=vehicle, waiting=waiting, lawful=vehicle.steering.command_engine, **_named):
            while waiting:
                lawful(waiting.pop())
        vehicle.steering.command_engine = command
        after(vehicle, "connect", connected)


@fault("MULTI-002p", "while one vehicle is silent the status of all stops")
def _(vsm):
    for vehicle in vsm.vehicles:
        vehicle.status_is_fresh = lambda: not any(v.link_lost for v in vsm.vehicles)


@fault("LOAD-001p", "status waits while commands come")
def _(vsm):
    busy = [0.0]

    def take(message, address, lawful=vsm.take):
        if message.id == 2017:
            busy[0] = vsm.now()
        lawful(message, address)

    def push(now, lawful=vsm.push):
        if now - busy[0] > 0.3:
            lawful(now)
    vsm.take, vsm.push = take, push


@fault("TIME-004p", "stamps of 4001 fall now and then")
def _(vsm):
    count = [0]

    def make(old):
        def encode(id, source, cucs, fields, ack=False):
            count[0] += id == 4001
            late = id == 4001 and count[0] % 5 == 0
            return old(id, source, cucs, fields | {"Time Stamp": fields["Time Stamp"] - 1_500} if late else fields, ack)
        return encode
    replace(vsm.codec, "encode", make)
