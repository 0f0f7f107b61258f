"""A fault for every rule that the table of 60 leaves without one, or does not name first: a rule that no fault makes fail has not
been shown to be able to. `faults_beside_flight` adds the rest to the same table.

The id of a fault is that of the rule that has to fail.
"""
import math

from . import aircraft as flight
from . import steering, units
from .authority import CONTROL, LOI_2, Handover
from .change import each, replace, table
from .mission import DOWNLOAD, Plan
from .mutants import change_sent
from .reports import REPORTS
from .wire import BROADCAST

BY_RULE, _entry = table()


def fault(rule, title):
    return _entry(rule, title, rule)


def change_reports(vsm, id, alter):
    """Changes the fields of one status message: `alter(fields)` gives new ones."""
    change_sent(vsm, lambda sent, fields: alter(fields) if sent == id else fields)


def before(part, name, action):
    """Calls `action(*args)` before a method."""
    def make(old):
        def method(*args, **named):
            action(*args)
            return old(*args, **named)
        return method
    replace(part, name, make)


def after(part, name, action):
    """Calls `action(result, *args)` after a method."""
    def make(old):
        def method(*args, **named):
            result = old(*args, **named)
            action(result, *args)
            return result
        return method
    replace(part, name, make)


# Wrapper, numbers, vectors

@fault("WRAP-008", "messages with a CRC-32 are dropped")
def _(vsm):
    replace(vsm.codec, "checksum_matches", lambda old: lambda style, covered, trailer: style != 3 and old(style, covered, trailer))


@fault("SCALAR-007", "values out of range are used")
def _(vsm):
    each(vsm, "steering", "problem_of_loiter", lambda old: lambda settings: None)
    each(vsm, "steering", "problem_of_values", lambda old: lambda fields: None)


@fault("SCALAR-009", "the commanded turn rate comes back in another scale")
def _(vsm):
    change_reports(vsm, 3002, lambda f: {**f, "Commanded Turn Rate": f["Commanded Turn Rate"] // 50})


@fault("PV-005", "fields that have not changed are left out of 3002 and 4000")
def _(vsm):
    last = {}

    def alter(id, fields):
        if id not in (3002, 4000):
            return fields
        known, last[id] = last.get(id, {}), fields
        return {n: v for n, v in fields.items() if n == "Time Stamp" or known.get(n) != v}
    change_sent(vsm, alter)


# Discovery and authority

@fault("DISC-005", "the configured id is offered though no vehicle is connected")
def _(vsm):
    for vehicle in vsm.vehicles:
        vehicle.id = vehicle.real_id
        vehicle.rename = lambda id: None


@fault("DISC-009", "no #3 when the mission changes")
def _(vsm):
    for vehicle in vsm.vehicles:
        vehicle.mission._changed = lambda: None


@fault("AUTH-001", "a granted request is answered with LOI Granted 0")
def _(vsm):
    each(vsm, "", "granted_field", lambda old: lambda cucs: old(cucs) & ~CONTROL)


@fault("AUTH-005", "a release is confirmed, and nobody else gets control after it")
def _(vsm):
    for vehicle in vsm.vehicles:
        stuck = set()
        after(vehicle.authority, "release", lambda _r, cucs, *_, s=stuck: s.add(cucs))
        replace(vehicle.authority, "_take_control", lambda old, s=stuck: lambda cucs, *rest: None if s - {cucs} else old(cucs, *rest))


@fault("AUTH-007", "a payload controller keeps its station against the holder of LOI 4")
def _(vsm):
    for vehicle in vsm.vehicles:
        def take(cucs, stations, access, a=vehicle.authority):
            for bit in (1 << k for k in range(16)):
                if bit & stations & a.stations and a.station_holder.get(bit) in (None, cucs):
                    a.station_holder[bit] = cucs
        vehicle.authority._take_stations = take


@fault("AUTH-010", "LOI 2 is denied while another is in control")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.authority, "request", lambda old, a=vehicle.authority: lambda cucs, loi, *rest: (
            old(cucs, loi & ~LOI_2 if a.holder() not in (None, cucs) else loi, *rest)))


@fault("AUTH-020", "a CUCS that asks before a grant is locked out")
def _(vsm):
    out = set()
    for vehicle in vsm.vehicles:
        before(vehicle, "handle", lambda m, v=vehicle: out.add(m.source) if not v.authority.granted(m.source) else None)
        replace(vehicle.authority, "request", lambda old: lambda cucs, *rest: None if cucs in out else old(cucs, *rest))


@fault("AUTH-011", "LOI Granted shows all that was asked for, authorised or not")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle, "granted_field", lambda old, v=vehicle: lambda cucs: old(cucs) | v.last_request.get(cucs, {}).get("Requested/Handover LOI", 0))


@fault("AUTH-016", "a request that is denied is not answered")
def _(vsm):
    def make(old):
        def process(message, vehicle, peer):
            f, holder = message.fields, vehicle.authority.holder()
            plain = message.id == 1 and message.destination != BROADCAST and f.get("Requested/Handover Access") == 1
            if not (plain and f.get("Requested/Handover LOI", 0) & CONTROL and holder not in (None, message.source)):
                old(message, vehicle, peer)
        return process
    replace(vsm, "process", make)


@fault("DISC-006", "#2 names another vehicle type than #3")
def _(vsm):
    change_reports(vsm, 2, lambda f: {**f, "Vehicle Type": 1})


# Handover and heartbeat

@fault("HAND-007", "what one CUCS uploaded is still there for the next")
def _(vsm):
    for vehicle in vsm.vehicles:
        vehicle.mission.drop_upload = lambda: None


@fault("HAND-001", "35000 names giver and taker the wrong way round")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle, "handover_step", lambda old: lambda status, giving, taking: old(status, taking, giving))


@fault("HAND-003", "a request by #4 takes control without the holder's consent")
def _(vsm):
    for vehicle in vsm.vehicles:
        def positive(message, v=vehicle, lawful=vehicle.positive_handover):
            outcome = lawful(message)
            if v.authority.wish:
                v.consent(v.authority.holder() or 0, v.authority.wish)
            return outcome
        vehicle.positive_handover = positive


@fault("HAND-004", "a request that asks to wait for the data link is granted at once")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle, "change_rights", lambda old: lambda cucs, fields, now: old(
            cucs, {**fields, "Wait for Vehicle Data Link Transition Coordination Message": 0}, now))


@fault("HAND-005", "a handover that lapses leaves the vehicle without a holder, and nothing says so")
def _(vsm):
    for vehicle in vsm.vehicles:
        def fail(why, v=vehicle):
            holder = v.authority.holder()
            v.authority.wish, v.authority.handover = None, Handover()
            if holder is not None:
                v.authority.take_from(holder)
        vehicle.fail_handover = fail


@fault("HAND-006", "a change of control puts the vehicle on hold")
def _(vsm):
    for vehicle in vsm.vehicles:
        def changed(_result, cucs, granted, holder, handover, v=vehicle):
            if v.authority.holder() != holder and v.aircraft.airborne:
                v.aircraft.hold()
        after(vehicle, "after_change", changed)


@fault("HB-001", "heartbeats come every 3 s")
def _(vsm):
    vsm.heartbeat_s = 3.0


def silence(vehicle, now, heartbeats_needed, limit, say):
    """Control taken from a holder that sends nothing."""
    holder = vehicle.authority.holder()
    peer = vehicle.vsm.peers.get(holder)
    if peer and (peer.heartbeats or not heartbeats_needed) and now - peer.received > limit:
        vehicle.authority.take_from(holder)
        if say:
            vehicle.send_report(holder, 2)


@fault("HB-002", "a quiet CUCS without heartbeats loses control after 10 s")
def _(vsm):
    for vehicle in vsm.vehicles:
        before(vehicle, "watch_station", lambda now, v=vehicle: silence(v, now, False, 10, True))


@fault("HB-003", "a holder that stops its heartbeats is never noticed")
def _(vsm):
    each(vsm, "", "watch_station", lambda old: lambda now: None)


@fault("HB-004", "a heartbeat before any grant raises an alert and locks the CUCS out")
def _(vsm):
    out = set()

    def take(message, address):
        if message.id == 16002 and not any(v.authority.granted(message.source) for v in vsm.vehicles):
            out.add(message.source)
    before(vsm, "take", take)
    for vehicle in vsm.vehicles:
        replace(vehicle.authority, "request", lambda old: lambda cucs, *rest: None if cucs in out else old(cucs, *rest))


# Missions

def change_store(vsm, action):
    for vehicle in vsm.vehicles:
        before(vehicle.mission, "store", lambda id, fields, m=vehicle.mission: action(m, id, fields))


@fault("ROUTE-003", "13001 begins a new upload: waypoints before it are lost")
def _(vsm):
    change_store(vsm, lambda m, id, fields: m.drop_upload() if id == 13001 else None)


@fault("ROUTE-005", "waypoints 0 and 65535 are accepted")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.mission, "problem_of", lambda old: lambda id, fields: (
            None if id == 13002 and fields.get("Waypoint Number") in (0, 65535) else old(id, fields)))


@fault("ROUTE-009", "the download of one waypoint returns all of them")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.mission, "command", lambda old: lambda cucs, fields, now: old(
            cucs, {**fields, "Mission Plan Mode": DOWNLOAD} if fields.get("Mission Plan Mode") == 4 else fields, now))


@fault("ROUTE-010", "clear is confirmed, and the mission stays")
def _(vsm):
    for vehicle in vsm.vehicles:
        def clear(cucs, mission, m=vehicle.mission):
            m.status(cucs, 1, 100, 1, mission)
        vehicle.mission.clear = clear


@fault("ROUTE-011", "cancel is ignored")
def _(vsm):
    for vehicle in vsm.vehicles:
        vehicle.mission.cancel = lambda cucs: None


@fault("ROUTE-012", "Percent Complete falls during an upload")
def _(vsm):
    for vehicle in vsm.vehicles:
        def status(cucs, state, percent, mode, mission, lawful=vehicle.mission.status):
            if state == 1:
                for wrong in (60, 30):
                    lawful(cucs, 0, wrong, mode, mission)
            lawful(cucs, state, percent, mode, mission)
        vehicle.mission.status = status


@fault("ROUTE-013", "every route comes back as type flight")
def _(vsm):
    change_reports(vsm, 13001, lambda f: {**f, "Route Type": 2})


@fault("ROUTE-014", "13001 with initial waypoint 0 deletes the waypoints as well")
def _(vsm):
    for vehicle in vsm.vehicles:
        def complete(upload, m=vehicle.mission, lawful=vehicle.mission.complete):
            gone = [f for f in upload.routes.values() if not f.get("Initial Waypoint Number")]
            plan = lawful(upload)
            if gone and not upload.waypoints:
                plan = Plan(waypoints=dict(list(plan.waypoints.items())[-1:]))
                plan.waypoints = {n: {**f, "Next Waypoint": 0} for n, f in plan.waypoints.items()}
            return plan
        vehicle.mission.complete = complete


@fault("ROUTE-017", "fly-over waypoints are cut like the others, by 40 m")
def _(vsm):
    for vehicle in vsm.vehicles:
        def point(number, fields, lawful=vehicle.mission.point):
            made = lawful(number, fields)
            north, east = units.offset(vehicle.aircraft.home, made.place)
            if made.over:
                far = math.hypot(north, east) or 1.0
                made.place = units.moved(made.place, -40 * north / far, -40 * east / far)
            return made
        vehicle.mission.point = point


@fault("ROUTE-020", "14000 has no Mission ID, and always plan mode 2")
def _(vsm):
    change_reports(vsm, 14000, lambda f: {**f, "Mission ID": "", "Mission Plan Mode": 2})


@fault("ROUTE-021", "a loop is flown without an end")
def _(vsm):
    for vehicle in vsm.vehicles:
        mission = vehicle.mission
        replace(mission, "problem_of_waypoint", lambda old: lambda fields: old({**fields, "Waypoint Type": 0}))
        replace(mission, "problem_of_leg", lambda old: lambda plan, number, fields: None)

        def flown(start, m=mission):
            numbers = [start]
            while len(numbers) < 400 and m.aboard.waypoints[numbers[-1]].get("Next Waypoint", 0) in m.aboard.waypoints:
                numbers.append(m.aboard.waypoints[numbers[-1]]["Next Waypoint"])
            return numbers
        mission.flown_order = flown


# Flight commands

@fault("MODE-001", "3001 keeps the mode before the last")
def _(vsm):
    for vehicle in vsm.vehicles:
        seen = [steering.NO_MODE, steering.NO_MODE]

        def reported(s=seen, lawful=vehicle.steering.reported_mode):
            if lawful() != s[-1]:
                s.append(lawful())
            return s[-2]
        vehicle.steering.reported_mode = reported


@fault("MODE-005", "loiters where it is instead of at the commanded place")
def _(vsm):
    each(vsm, "steering", "loiter_place", lambda old: lambda fields: None)


@fault("MODE-006", "the heading is used whatever the heading command type")
def _(vsm):
    for vehicle in vsm.vehicles:
        def make(fields, lawful=vehicle.steering.steering):
            return lawful({**fields, "Heading Command Type": 1} if "Commanded Heading" in fields else fields)
        vehicle.steering.steering = make


@fault("MODE-015", "a command with an altitude alone ends the route")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.steering, "commanded_mode", lambda old, v=vehicle: lambda fields: (
            steering.LOITER if v.aircraft.mode in flight.ON_ROUTE and "Commanded Altitude" in fields and old(fields) is None else old(fields)))


@fault("MODE-007", "a turn rate of 0 means that it does not turn")
def _(vsm):
    for vehicle in vsm.vehicles:
        def make(fields, lawful=vehicle.steering.steering):
            made = lawful(fields)
            if "Commanded Turn Rate" in fields and not fields["Commanded Turn Rate"]:
                made.turn_limit = 1e-9
            return made
        vehicle.steering.steering = make


@fault("MODE-008", "airspeeds are flown as ground speeds")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.aircraft, "_ground_speed", lambda old: lambda speed, course, airspeed: speed)


@fault("MODE-010", "no 3005 after a termination command")
def _(vsm):
    for vehicle in vsm.vehicles:
        vehicle.terminate = lambda message, v=vehicle: v.steering.terminate(message.fields)


@fault("MODE-011", "the launch ends at 10 m whatever altitude was commanded")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.aircraft, "launch", lambda old, a=vehicle.aircraft: lambda altitude=None: old(a.ground + 10))


@fault("MODE-013", "the reported engine command stays 0")
def _(vsm):
    change_reports(vsm, 3007, lambda f: {**f, "Reported Engine Command": 0})


@fault("MODE-014", "lights are switched on, never off")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.steering, "switch_lights", lambda old, a=vehicle.aircraft: lambda fields: old(
            {**fields, "Set Lights": fields.get("Set Lights", 0) | a.lights}))


# Status

@fault("STAT-001", "no status without a schedule")
def _(vsm):
    vsm.default_schedules = lambda *_: None


@fault("STAT-004", "a schedule cannot be ended")
def _(vsm):
    replace(vsm, "schedule", lambda old: lambda cucs, vehicle, id, frequency: old(cucs, vehicle, id, frequency) if frequency else None)


@fault("STAT-005", "3000 comes unasked every second")
def _(vsm):
    for vehicle in vsm.vehicles:
        last = [0.0]

        def advance(_result, _dt, v=vehicle, last=last):
            if v.now() - last[0] > 1:
                last[0] = v.now()
                for cucs in v.authority.watching():
                    v.send_report(cucs, 3000)
        after(vehicle, "advance", advance)


@fault("STAT-006", "a CUCS with LOI 2 that asks for more loses it")
def _(vsm):
    for vehicle in vsm.vehicles:
        def answer(message, v=vehicle):
            f = message.fields
            if f.get("Message Type", f.get("Requested Message Type")) in (3002, 3007) and not v.authority.controls(message.source):
                v.authority.held[message.source] = 0
        before(vehicle, "answer", answer)
        before(vehicle, "schedule", answer)


@fault("STAT-009", "4001 names waypoint 1 while no route is flown")
def _(vsm):
    change_reports(vsm, 4001, lambda f: {**f, "To Waypoint Number": f["To Waypoint Number"] if f["To Waypoint Number"] not in (0, 65535) else 1,
                                         "Next Waypoint Number": f["Next Waypoint Number"] or 2})


@fault("STAT-010", "4001 counts waypoints by the autopilot's own items")
def _(vsm):
    for vehicle in vsm.vehicles:
        def renumber(fields, m=vehicle.mission):
            items = {number: k for k, number in enumerate(m.aboard.waypoints, 1)}
            names = ("From Waypoint Number", "To Waypoint Number", "Next Waypoint Number")
            return {**fields, **{n: items.get(fields[n], fields[n]) for n in names if n in fields}}
        change_reports(vsm, 4001, renumber)


@fault("STAT-011", "To Waypoint Time says how long it takes")
def _(vsm):
    change_reports(vsm, 4001, lambda f: {**f, "To Waypoint Time": max(0, f["To Waypoint Time"] - f["Time Stamp"])})


@fault("STAT-012", "3002 shows the values of refused commands")
def _(vsm):
    for vehicle in vsm.vehicles:
        before(vehicle.steering, "command_mode", vehicle.steering.accept)


@fault("STAT-013", "one 3007 for all engines")
def _(vsm):
    change_answers(vsm, 3007, lambda reports: reports[:1])


def change_answers(vsm, id, alter):
    """Changes the list of what is sent for one request: `alter(list of fields)` gives a new one."""
    for vehicle in vsm.vehicles:
        def send_report(cucs, asked, mask=0, wanted=0, v=vehicle, lawful=vehicle.send_report):
            if asked != id:
                return lawful(cucs, asked, mask, wanted)
            for fields in alter(REPORTS[id](v, cucs, mask)):
                v.report(cucs, id, {"Time Stamp": v.stamp_of(id), **fields})
            return True
        vehicle.send_report = send_report


@fault("STAT-016", "every subsystem is reported whichever was asked for")
def _(vsm):
    for vehicle in vsm.vehicles:
        def report(message, lawful=vehicle.report_subsystems):
            message.fields["Subsystem ID"] = 0xFFFFFFFF
            return lawful(message)
        vehicle.report_subsystems = report
