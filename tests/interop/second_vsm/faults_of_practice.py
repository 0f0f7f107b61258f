"""Faults that a VSM in use would have: state that all CUCSs share, caches that outlive what they are of, half of a pair forgotten,
the message after the first, the far end of a range.

They were thought of message by message and timer by timer, after the rules had found all other tables. The id of a fault is that of
the rule that has to fail, with `z` and a number where there are several.
"""
import math

from . import mission as plans
from . import units
from .alerts import CLEARED
from .authority import ACT_S, CONTROL, HANDOVER_S, LOI_2, LOI_3, LOI_4, SUCCESSFUL, Wish
from .change import each, replace, table
from .faults_by_rule import after, before, change_reports
from .mutants import change_sent
from .steering import DONE, WAYPOINT
from .wire import BROADCAST, reference, signed

OF_PRACTICE, _entry = table()
SPEED_TYPE = next(f["bit"] for f in reference.MESSAGES[2016]["fields"] if f["name"] == "Speed Type") + 1


def fault(id, title, *beside):
    """`beside` are rules whose play shows what this one looks at."""
    return _entry(id, title, " ".join((id.partition("z")[0], *beside)))


def to_body(fields):
    heading = units.from_bam(fields["Heading"], 16)
    north, east = fields["U_Speed"], fields["V_Speed"]
    return fields | {"U_Speed": round(north * math.cos(heading) + east * math.sin(heading)),
                     "V_Speed": round(east * math.cos(heading) - north * math.sin(heading))}


def cut_off(name, degrees):
    limit = units.to_bam(math.radians(degrees), 32)
    return lambda f: f | {name: units.clamp(f[name], -limit, limit)}


# Id, title, message, and what becomes of its fields.
REPORTS = (
    ("AUTH-008z", "Controlled Station 1-16 of 2 has its bytes exchanged", 2,
     lambda f: f | {"Controlled Station 1-16": int.from_bytes(f["Controlled Station 1-16"].to_bytes(2, "big"), "little")}),
    ("AUTH-011z", "LOI Authorized is what is left to be requested", 2, lambda f: f | {"LOI Authorized": f["LOI Authorized"] & ~f["LOI Granted"]}),
    ("MODE-006z", "Magnetic Variation of 4000 is positive to the west", 4000, lambda f: f | {"Magnetic Variation": -f["Magnetic Variation"]}),
    ("STAT-007z", "U_Speed and V_Speed of 4000 are forward and to the right", 4000, to_body),
    ("STAT-007z2", "the wind of 3009 is where it comes from", 3009, lambda f: f | {"U_Wind": -f["U_Wind"], "V_Wind": -f["V_Wind"]}),
    ("PV-005z", "fields of 4000 whose value is 0 are left out", 4000, lambda f: {n: v for n, v in f.items() if v}),
    ("SCALAR-003z", "longitudes beyond 179 degrees are cut off", 13002, cut_off("Waypoint to Longitude or Relative X", 179.0)),
    ("SCALAR-003z2", "latitudes beyond 85 degrees are cut off, as on a map of the web", 13002, cut_off("Waypoint to Latitude or Relative Y", 85.05)),
)
for _id, _title, _message, _alter in REPORTS:
    fault(_id, _title, *(["MODE-004"] if _id == "PV-005z" else []))(lambda vsm, message=_message, alter=_alter: change_reports(vsm, message, alter))


# Wrapper, stamps, who the VSM is

@fault("TIME-002z", "time stamps are kept in 32 bits")
def _(vsm):
    replace(vsm, "rising", lambda old: lambda cucs, source, id, stamp: old(cucs, source, id, stamp) & 0xFFFFFFFF)


@fault("WRAP-012z", "after a message of Edition 3 everybody is answered in Edition 3", "WRAP-013")
def _(vsm):
    def take(message, address):
        vsm.codec.idd = message.idd
    before(vsm, "take", take)


@fault("DISC-010z", "the VSM calls itself by the vehicle's id")
def _(vsm):
    change_sent(vsm, lambda id, fields: fields | {"VSM ID": signed(vsm.options.vehicle_id)} if "VSM ID" in fields else fields)


@fault("ACK-001z", "of several messages in one datagram only the first is acknowledged")
def _(vsm):
    def make(old):
        def messages(datagram, known_source):
            for count, message in enumerate(old(datagram, known_source)):
                message.ack = message.ack and not count
                yield message
        return messages
    replace(vsm.codec, "messages", make)


@fault("ACK-006z", "a 13000 that comes again is carried out again")
def _(vsm):
    replace(vsm, "is_duplicate", lambda old: lambda peer, key: old(peer, key) and int.from_bytes(key[1][12:14], "big") != 13000)


@fault("ACK-006z2", "what has been carried out is known for two seconds")
def _(vsm):
    known = {}

    def make(old):
        def is_duplicate(peer, key):
            fresh = vsm.now() - known.setdefault(key, vsm.now()) < 2
            return old(peer, key) and fresh
        return is_duplicate
    replace(vsm, "is_duplicate", make)


@fault("ACK-007z", "'received' comes after 'carried out'")
def _(vsm):
    late = {}

    def make(old):
        def acknowledge(message, vehicle, kind):
            if kind == 1:
                late[message.wire] = True
                return
            old(message, vehicle, kind)
            if late.pop(message.wire, False):
                old(message, vehicle, 1)
        return acknowledge
    replace(vsm, "acknowledge", make)


@fault("ACK-007z2", "a question about a message that is not there ends the process")
def _(vsm):
    def handle(message):
        if message.id == 17002 and message.fields.get("Message Type") == 29_999:
            raise SystemExit(1)
    for vehicle in vsm.vehicles:
        before(vehicle, "handle", handle)


def carried_out_late(vsm, wanted):
    replace(vsm, "untimely", lambda old: lambda message, vehicle, peer: None if message.id == wanted else old(message, vehicle, peer))


@fault("MODE-015z", "a 2016 that was overtaken is carried out when it arrives")
def _(vsm):
    carried_out_late(vsm, 2016)


@fault("ROBUST-010z", "a 2007 that was overtaken is carried out when it arrives")
def _(vsm):
    carried_out_late(vsm, 2007)


@fault("ROBUST-010z2", "a waypoint that arrives twice spoils the upload")
def _(vsm):
    def repeat(message, vehicle, _acknowledged):
        if message.id == 13002:
            vehicle.mission.upload.problem = "a waypoint was sent twice"
    before(vsm, "repeat", repeat)


# Rights

@fault("DISC-003z", "the answer to a discovery shows what the holder has been granted, whoever asks")
def _(vsm):
    for vehicle in vsm.vehicles:
        asked = [False]

        def authorise(message, discovery, asked=asked, lawful=vehicle.authorise):
            asked[0] = message.destination == BROADCAST
            try:
                return lawful(message, discovery)
            finally:
                asked[0] = False

        def granted(cucs, a=vehicle.authority, asked=asked, lawful=vehicle.granted_field):
            return lawful(a.holder() if asked[0] and a.holder() else cucs)
        vehicle.authorise, vehicle.granted_field = authorise, granted


@fault("DISC-007z", "the discovery of another CUCS ends the control of the holder")
def _(vsm):
    for vehicle in vsm.vehicles:
        def authorise(message, discovery, a=vehicle.authority):
            holder = a.holder()
            if message.destination == BROADCAST and holder not in (None, message.source):
                a.take_from(holder)
        before(vehicle, "authorise", authorise)


@fault("AUTH-005z", "what a CUCS has scheduled outlives its release")
def _(vsm):
    def default_schedules(peer, vehicle, granted, now, lawful=vsm.default_schedules):
        asked = {key: s for key, s in peer.schedules.items() if s.asked}
        lawful(peer, vehicle, granted, now)
        peer.schedules.update(asked)
    vsm.default_schedules = default_schedules


@fault("AUTH-008z2", "who gives back one station gives back all")
def _(vsm):
    each(vsm, "authority", "release", lambda old: lambda cucs, loi, stations, now: old(cucs, loi, 0, now))


@fault("AUTH-010z", "no more than three CUCSs may monitor")
def _(vsm):
    for vehicle in vsm.vehicles:
        def request(cucs, loi, *rest, a=vehicle.authority, lawful=vehicle.authority.request):
            full = sum(bool(a.granted(other)) for other in a.access if other != cucs) >= 3
            lawful(cucs, loi & ~LOI_2 if full else loi, *rest)
        vehicle.authority.request = request


@fault("AUTH-017z", "who gives back a payload station ends the control of the holder")
def _(vsm):
    for vehicle in vsm.vehicles:
        def release(_result, cucs, loi, _stations, _now, a=vehicle.authority):
            if loi & LOI_3 and a.holder() is not None:
                a.take_from(a.holder())
        after(vehicle.authority, "release", release)


@fault("AUTH-006z", "curves are accepted without LOI 4")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle, "permits", lambda old: lambda message: None if message.id in (50001, 50002) else old(message))


@fault("HAND-001z", "35000 names the CUCSs of the handover before")
def _(vsm):
    for vehicle in vsm.vehicles:
        last = []

        def step(status, giving, taking, last=last, lawful=vehicle.handover_step):
            shown = last[-1] if last else (giving, taking)
            if status == SUCCESSFUL:
                last.append((giving, taking))
            lawful(status, *shown)
        vehicle.handover_step = step


@fault("HAND-003z", "who requests a handover twice has it")
def _(vsm):
    for vehicle in vsm.vehicles:
        def handover(message, v=vehicle, count={}, lawful=vehicle.positive_handover):
            cucs, a = message.source, v.authority
            count[cucs] = count.get(cucs, 0) + 1
            if count[cucs] % 2 == 0 and not a.controls(cucs) and a.holder() is not None:
                v.consent(a.holder(), Wish(cucs, CONTROL & a.authorised(cucs), 0, v.now() + HANDOVER_S))
                return DONE
            return lawful(message)
        vehicle.positive_handover = handover


@fault("HAND-003z2", "the holder's refusal, a #4 without a level, is taken for its consent")
def _(vsm):
    for vehicle in vsm.vehicles:
        def handover(message, v=vehicle, lawful=vehicle.positive_handover):
            a = v.authority
            if a.controls(message.source) and a.wish and not message.fields.get("Requested/Handover LOI", 0) & CONTROL:
                v.consent(message.source, a.wish)
                return DONE
            return lawful(message)
        vehicle.positive_handover = handover


@fault("HAND-005z", "a handover that has lapsed takes place when the holder gives its control back")
def _(vsm):
    for vehicle in vsm.vehicles:
        lapsed = []
        before(vehicle, "fail_handover", lambda _why, v=vehicle, lapsed=lapsed: lapsed.append(v.authority.wish))

        def change(_result, cucs, fields, _now, v=vehicle, lapsed=lapsed):
            if lapsed and v.authority.holder() is None:
                v.consent(cucs, lapsed.pop())
        after(vehicle, "change_rights", change)


@fault("HAND-006z", "a change of control switches the lights off")
def _(vsm):
    for vehicle in vsm.vehicles:
        def change(_result, _cucs, _before, holder, _handover, v=vehicle):
            if v.authority.holder() != holder:
                v.aircraft.lights = 0
        after(vehicle, "after_change", change)


@fault("AUTH-005z2", "who gives back LOI 4 and keeps LOI 2 is sent no status any more")
def _(vsm):
    muted = set()
    for vehicle in vsm.vehicles:
        after(vehicle.authority, "release", lambda _r, cucs, loi, *_: muted.add(cucs) if loi & LOI_4 else None)
        after(vehicle.authority, "request", lambda _r, cucs, loi, *_: muted.discard(cucs) if loi else None)

    def default_schedules(peer, vehicle, granted, now, lawful=vsm.default_schedules):
        cucs = next(id for id, other in vsm.peers.items() if other is peer)
        lawful(peer, vehicle, 0 if cucs in muted else granted, now)
    vsm.default_schedules = default_schedules


@fault("HB-002z", "the silence of a CUCS that monitors ends the control of the holder")
def _(vsm):
    for vehicle in vsm.vehicles:
        def watch(_result, now, a=vehicle.authority):
            for cucs, peer in vsm.peers.items():
                if peer.heartbeats and now - peer.received >= ACT_S and a.holder() not in (None, cucs):
                    peer.heartbeats = False
                    a.take_from(a.holder())
        after(vehicle, "watch_station", watch)


@fault("HB-003z", "the heartbeats of any CUCS keep a silent holder in control")
def _(vsm):
    def take(message, _address):
        if message.id == 16002:
            for peer in vsm.peers.values():
                peer.received = vsm.now()
    before(vsm, "take", take)


# Plans and flight

@fault("ROUTE-006z", "only routes of type flight are looked through for gaps")
def _(vsm):
    for vehicle in vsm.vehicles:
        def problem(plan, number, fields, m=vehicle.mission, lawful=vehicle.mission.problem_of_leg):
            others = [r["Initial Waypoint Number"] for r in plan.routes.values() if r.get("Route Type", 2) > 2]
            return None if any(number in m.chain(plan, first) for first in others) else lawful(plan, number, fields)
        vehicle.mission.problem_of_leg = problem


@fault("ROUTE-007z", "after a load that was refused every load is refused until one is cancelled")
def _(vsm):
    for vehicle in vsm.vehicles:
        stuck = []

        def load(cucs, mission, now, m=vehicle.mission, stuck=stuck, lawful=vehicle.mission.load):
            problem = m.reject(cucs, mission, plans.LOAD, "the load before was refused") if stuck else lawful(cucs, mission, now)
            stuck[:] = [True] if problem else []
            return problem
        vehicle.mission.load = load
        for name in ("clear", "cancel"):
            before(vehicle.mission, name, lambda *_, stuck=stuck: stuck.clear())


@fault("DISC-009z", "3 names the mission of a load that was refused")
def _(vsm):
    for vehicle in vsm.vehicles:
        def reject(_result, _cucs, mission, mode, _problem, m=vehicle.mission):
            if mode == plans.LOAD:
                m.aboard.mission = mission
        after(vehicle.mission, "reject", reject)


@fault("ROUTE-012z", "a load that is complete is called rejected afterwards")
def _(vsm):
    for vehicle in vsm.vehicles:
        def status(_result, cucs, status, percent, mode, mission, m=vehicle.mission):
            if status == plans.COMPLETE and mode == plans.LOAD:
                m.status(cucs, plans.REJECTED, 100, mode, mission)
        after(vehicle.mission, "status", status)


@fault("ROUTE-016z", "all waypoints have the altitude type of the first")
def _(vsm):
    for vehicle in vsm.vehicles:
        def point(number, fields, m=vehicle.mission, lawful=vehicle.mission.point):
            first = next(iter(m.aboard.waypoints.values()))
            return lawful(number, {**fields, "Waypoint Altitude Type": first.get("Waypoint Altitude Type", 1)})
        vehicle.mission.point = point


@fault("MODE-004z", "mode 11 flies the route that was sent last, whatever its type")
def _(vsm):
    for vehicle in vsm.vehicles:
        def first(kinds, m=vehicle.mission, lawful=vehicle.mission.first_waypoint):
            routes = list(m.aboard.routes.values())
            return routes[-1]["Initial Waypoint Number"] if routes and plans.FLIGHT in kinds else lawful(kinds)
        vehicle.mission.first_waypoint = first


@fault("MODE-004z2", "a waypoint without a speed is flown to at 0 m/s")
def _(vsm):
    for vehicle in vsm.vehicles:
        def point(number, fields, lawful=vehicle.mission.point):
            made = lawful(number, fields)
            made.speed = made.speed or 0.01
            return made
        vehicle.mission.point = point


@fault("MODE-006z2", "heading command type 3 flies along the heading, not the course")
def _(vsm):
    for vehicle in vsm.vehicles:
        def steering(fields, lawful=vehicle.steering.steering):
            made = lawful(fields)
            if fields.get("Heading Command Type") == 3:
                made.course = None
            return made
        vehicle.steering.steering = steering


@fault("MODE-008z", "an indicated airspeed (type 0) is flown over the ground")
def _(vsm):
    each(vsm, "steering", "take_values", lambda old: lambda mode, fields: old(mode, fields | {"Speed Type": 2} if fields.get("Speed Type") == 0 else fields))


# Status, configuration, alerts, payload

@fault("STAT-003z", "frequencies are rounded down to a power of two")
def _(vsm):
    replace(vsm, "period", lambda old: lambda frequency: old(2 ** (frequency.bit_length() - 1)))


@fault("STAT-012z", "the commanded altitude of 3002 is the altitude at which it flies")
def _(vsm):
    def alter(fields):
        v = vsm.vehicles[0]
        return fields | {"Commanded Altitude": v.reported_altitude(v.aircraft.altitude)} if v.aircraft.airborne else fields
    change_reports(vsm, 3002, alter)


@fault("STAT-015z", "whoever asks for 4000 of a silent vehicle gets the last one with a new stamp")
def _(vsm):
    for vehicle in vsm.vehicles:
        def answer(message, v=vehicle, lawful=vehicle.answer):
            if message.fields.get("Message Type") != 4000 or not v.link_lost:
                return lawful(message)
            v.status_is_fresh, v.sampled = lambda: True, units.stamp()
            try:
                return lawful(message)
            finally:
                del v.status_is_fresh
        vehicle.answer = answer


@fault("STAT-016z", "of several subsystems only the first is reported")
def _(vsm):
    for vehicle in vsm.vehicles:
        def report(message, lawful=vehicle.report_subsystems):
            mask = message.fields.get("Subsystem ID", 0)
            message.fields["Subsystem ID"] = mask & -mask
            return lawful(message)
        vehicle.report_subsystems = report


@fault("CONF-001z", "a CUCS that requests the configuration ends that of another")
def _(vsm):
    for vehicle in vsm.vehicles:
        before(vehicle.configuration, "request", lambda cucs, _fields, c=vehicle.configuration: [c.running.pop(other) for other in list(c.running) if other != cucs])


@fault("CONF-002z", "a question about one field ends the configuration in progress")
def _(vsm):
    for vehicle in vsm.vehicles:
        before(vehicle.configuration, "request", lambda cucs, fields, c=vehicle.configuration: (
            None if fields.get("Request Type") else c.running.pop(cucs, None)))


@fault("ALERT-001z", "every alert has the number 1", "LINK-004")
def _(vsm):
    for vehicle in vsm.vehicles:
        before(vehicle.alerts, "raise_", lambda *_, a=vehicle.alerts: setattr(a, "_next", 1))


@fault("ALERT-002z", "the end of an alert is sent to one CUCS only")
def _(vsm):
    for vehicle in vsm.vehicles:
        def announce(fields, v=vehicle, lawful=vehicle.announce):
            if fields["Priority"] == CLEARED:
                for cucs in v.authority.watching()[:1]:
                    v.report(cucs, 16000, fields)
            else:
                lawful(fields)
        vehicle.alerts._send = announce


@fault("ALERT-006z", "standing alerts are sent to a CUCS the first time that it connects")
def _(vsm):
    for vehicle in vsm.vehicles:
        met = set()

        def change(cucs, *rest, v=vehicle, met=met, lawful=vehicle.after_change):
            standing = v.alerts.standing
            if cucs in met:
                v.alerts.standing = lambda: []
            lawful(cucs, *rest)
            v.alerts.standing = standing
            if v.authority.granted(cucs):
                met.add(cucs)
        vehicle.after_change = change


@fault("PAYL-003z", "the field of view of all stations follows a command for one")
def _(vsm):
    for vehicle in vsm.vehicles:
        def steer(_result, fields, p=vehicle.payloads):
            for station in p.stations:
                station.view = fields.get("Set Horizontal Field of View", station.view) or station.view
        after(vehicle.payloads, "steer", steer)


@fault("TIME-005z", "a command whose stamp is more than two seconds off is dropped without a word")
def _(vsm):
    def make(old):
        def process(message, vehicle, peer):
            if message.stamp is None or abs(units.stamp() - message.stamp) < 2_000 or message.id == 1:
                old(message, vehicle, peer)
        return process
    replace(vsm, "process", make)


@fault("MULTI-002z", "a schedule of one vehicle takes the place of that of the other")
def _(vsm):
    def schedule(cucs, vehicle, id, _frequency):
        for other in vsm.vehicles:
            if other is not vehicle:
                vsm.peers[cucs].schedules.pop((other.number, id), None)
    before(vsm, "schedule", schedule)


# Second looks at the text of the rules: what each of them says besides what its fault above, or in the other tables, breaks

@fault("DISC-005z", "3 names the tail number of the vehicle that is not connected")
def _(vsm):
    change_sent(vsm, lambda id, fields: fields | {"Tail Number": vsm.vehicles[0].tail_number} if id == 3 else fields)


@fault("AUTH-019z", "alerts stay with the port that came first")
def _(vsm):
    first = {}

    def make(old):
        def transmit(cucs, datagram):
            peer = vsm.peers.get(cucs)
            if peer is None or int.from_bytes(datagram[12:14], "big") != 16000:
                old(cucs, datagram)
                return
            address, peer.address = peer.address, first.get(cucs, peer.address)
            old(cucs, datagram)
            peer.address = address
        return transmit
    replace(vsm, "transmit", make)
    before(vsm, "take", lambda message, address: first.setdefault(message.source, address))
    # Whoever gives everything back begins as new.
    for vehicle in vsm.vehicles:
        after(vehicle.authority, "release", lambda _r, cucs, *_: first.pop(cucs, None))


@fault("AUTH-006z2", "lights are switched without LOI 4, though it is called refused")
def _(vsm):
    for vehicle in vsm.vehicles:
        def permits(reason, message, v=vehicle):
            if reason and message.id == 2007:
                v.steering.switch_lights(message.fields)
        after(vehicle, "permits", permits)


@fault("HAND-005z2", "after a handover that lapsed both CUCSs are obeyed")
def _(vsm):
    for vehicle in vsm.vehicles:
        both = set()
        before(vehicle, "fail_handover", lambda _why, v=vehicle, both=both: both.add(v.authority.wish.cucs))
        replace(vehicle, "permits", lambda old, both=both: lambda message: None if message.source in both else old(message))


@fault("HAND-007z", "an override keeps the upload of the former holder")
def _(vsm):
    for vehicle in vsm.vehicles:
        def change(cucs, before_, holder, handover, v=vehicle, lawful=vehicle.after_change):
            upload = v.mission.upload
            lawful(cucs, before_, holder, handover)
            if holder is not None and v.authority.holder() not in (None, holder):
                v.mission.upload = upload
        vehicle.after_change = change


@fault("HB-003z2", "control is taken from a silent CUCS without a word")
def _(vsm):
    for vehicle in vsm.vehicles:
        def watch(now, v=vehicle, lawful=vehicle.watch_station):
            holder, raise_, send = v.authority.holder(), v.alerts.raise_, v.send_report
            peer = vsm.peers.get(holder)
            if peer and peer.heartbeats and now - peer.received >= ACT_S:
                v.alerts.raise_ = lambda *_: None
                v.send_report = lambda *_: None
            lawful(now)
            v.alerts.raise_, v.send_report = raise_, send
        vehicle.watch_station = watch


@fault("ROUTE-011z", "a download that was cancelled is called complete")
def _(vsm):
    for vehicle in vsm.vehicles:
        def cancel(cucs, m=vehicle.mission, lawful=vehicle.mission.cancel):
            going = m.transfer
            if going is None or going.mode != plans.DOWNLOAD:
                return lawful(cucs)
            m.transfer = None
            m.status(cucs, plans.COMPLETE, 100, going.mode, going.mission)
            return None
        vehicle.mission.cancel = cancel


@fault("ROUTE-019z", "types and directions of loiter waypoints are not looked at")
def _(vsm):
    each(vsm, "mission", "problem_of_loiter", lambda old: lambda fields: None)


@fault("ROUTE-019z2", "turn type 9 of a waypoint is taken for 1")
def _(vsm):
    each(vsm, "mission", "problem_of_waypoint", lambda old: lambda fields: old({n: v for n, v in fields.items() if n != "Turn Type"}))


@fault("MODE-005z", "every loiter of mode 12 is flown counter-clockwise")
def _(vsm):
    each(vsm, "steering", "clockwise", lambda old: lambda: False)


@fault("MODE-015z2", "a speed alone is shown as commanded, and not flown")
def _(vsm):
    for vehicle in vsm.vehicles:
        def take(mode, fields, lawful=vehicle.steering.take_values):
            alone = mode is None and "Commanded Altitude" not in fields
            lawful(mode, {n: v for n, v in fields.items() if n != "Commanded Speed"} if alone else fields)
        vehicle.steering.take_values = take


@fault("STAT-004z", "the end of one schedule ends all schedules of that CUCS")
def _(vsm):
    def schedule(cucs, _vehicle, _id, frequency):
        if not frequency:
            schedules = vsm.peers[cucs].schedules
            for key in [key for key, one in schedules.items() if one.asked]:
                del schedules[key]
    before(vsm, "schedule", schedule)


@fault("STAT-001z", "who connects again is sent the position of before first")
def _(vsm):
    kept = {}

    def make(old):
        def wire(cucs, source, id, fields, ack=False):
            if id == 4000:
                peer = vsm.peers.get(cucs)
                begins = peer is not None and cucs in kept and kept[cucs][1]
                if begins:
                    kept[cucs] = (fields, False)
                    return vsm.codec.encode(id, source, cucs, begins, ack)
                kept[cucs] = (fields, False)
            return old(cucs, source, id, fields, ack)
        return wire
    replace(vsm, "wire", make)
    for vehicle in vsm.vehicles:
        def release(_result, cucs, *_):
            if cucs in kept:
                kept[cucs] = (kept[cucs][0], dict(kept[cucs][0]))
        after(vehicle.authority, "release", release)


@fault("CONF-004z", "44003 does not list the speed type that the vehicle lacks")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.configuration, "answers", lambda old, c=vehicle.configuration: lambda kind, stations: [
            m for m in old(kind, stations) if m[0] != 44003 or (m[1].get("Reported Message"), m[1].get("Reported Field")) != (2016, SPEED_TYPE)])


@fault("CONF-005z", "44003 comes when mode 11 comes or goes, and for no other mode")
def _(vsm):
    each(vsm, "configuration", "changed", lambda old: lambda: [m for m in old() if m[1].get("Reported Enumerated Index") == WAYPOINT])


@fault("LINK-004z", "a load while the vehicle is silent is called complete")
def _(vsm):
    for vehicle in vsm.vehicles:
        def load(cucs, mission, now, v=vehicle, lawful=vehicle.mission.load):
            if not v.link_lost:
                return lawful(cucs, mission, now)
            v.mission.status(cucs, plans.COMPLETE, 100, plans.LOAD, mission)
            return None
        vehicle.mission.load = load


@fault("LOAD-002z", "waypoints beyond 255 are lost, and the route is called complete")
def _(vsm):
    for vehicle in vsm.vehicles:
        def complete(upload, lawful=vehicle.mission.complete):
            plan = lawful(upload)
            kept = dict(list(plan.waypoints.items())[:255])
            plan.waypoints = {n: f if f.get("Next Waypoint", 0) in kept else {**f, "Next Waypoint": 0} for n, f in kept.items()}
            return plan
        vehicle.mission.complete = complete


@fault("ACK-001z2", "acknowledgements go to the CUCS in control, whoever asked")
def _(vsm):
    def make(old):
        def encode(id, source, destination, fields, ack=False):
            holder = vsm.vehicles[0].authority.holder()
            return old(id, source, holder if id == 17000 and holder else destination, fields, ack)
        return encode
    replace(vsm.codec, "encode", make)


@fault("ACK-001z3", "requests for configuration and subsystems are not acknowledged")
def _(vsm):
    replace(vsm, "acknowledge", lambda old: lambda message, vehicle, kind: None if message.id in (15000, 40000) else old(message, vehicle, kind))
