"""A fault for every rule that the table of 60 leaves without one, or does not name first: a rule that no fault makes fail has not
been shown to be able to.

The id of a fault is that of the rule that has to fail.
"""
import math
import time

from . import aircraft as flight
from . import alerts as alert
from . import configuration, steering, units
from .authority import CONTROL, LOI_2, Access, Handover
from .change import each, replace, table
from .mission import DOWNLOAD, Plan
from .mutants import change_sent
from .reports import OF_VEHICLE, REPORTS
from .steering import DONE
from .wire import BROADCAST, HEADER, NULL_ID

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


# Configuration

@fault("CONF-002", "every field is said to be supported")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.configuration, "about", lambda old: lambda message, field, stations, supported=1: old(message, field, stations, 1))
        replace(vehicle.configuration, "availability", lambda old: lambda message, number, available, *rest: old(message, number, 1, *rest))


@fault("CONF-003", "41002 gives a generic value another name")
def _(vsm):
    for vehicle in vsm.vehicles:
        vehicle.configuration.names += (configuration.Named(configuration.OF_LOI_4, 2016, configuration.MODE_FIELD, 11, "AUTO MISSION", "flies the route"),)


@fault("CONF-004", "44003 does not list the modes and values that the vehicle lacks")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.configuration, "answers", lambda old: lambda kind, stations: [
            m for m in old(kind, stations) if m[0] != 44003 or m[1].get("Reported Message") != 2016])


@fault("CONF-005", "no 44003 when a mode comes or goes")
def _(vsm):
    each(vsm, "configuration", "changed", lambda old: lambda: [])


@fault("CONF-006", "an abort does not end the configuration phase")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.configuration, "request", lambda old: lambda cucs, fields: None if fields.get("Request Type") == 6 else old(cucs, fields))

        def slow_tick(c=vehicle.configuration, count=[0], lawful=vehicle.configuration.tick):
            count[0] += 1
            if count[0] % 8 == 0:
                lawful()
        vehicle.configuration.tick = slow_tick


@fault("CONF-007", "a default lies outside of its range")
def _(vsm):
    change_reports(vsm, 41003, lambda f: {**f, "Default Value": f["Max Value"] + 1} if f.get("Max Value", 2**32) < 2**31 else f)


@fault("CONF-008", "values beyond the declared maximum are accepted")
def _(vsm):
    each(vsm, "steering", "problem_of_loiter", lambda old: lambda settings: old(
        {**settings, "Loiter Radius": min(settings.get("Loiter Radius", 10), steering.HIGHEST_RADIUS)}))
    for vehicle in vsm.vehicles:
        vehicle.mission.highest_m = 1e9


# Alerts

@fault("ALERT-001", "an alert has a new negative id each time")
def _(vsm):
    for vehicle in vsm.vehicles:
        last = [0]

        def fields(raised, id, last=last, lawful=vehicle.alerts.fields):
            if id < 0:
                last[0] = id
            return lawful(raised, last[0] or -1)
        vehicle.alerts.fields = fields


@fault("ALERT-002", "the loss of the link is never cleared")
def _(vsm):
    each(vsm, "alerts", "clear", lambda old: lambda cause: None)


@fault("ALERT-003", "priority 9 in alerts")
def _(vsm):
    change_reports(vsm, 16000, lambda f: {**f, "Priority": 9})


@fault("ALERT-004", "refusals come without a reason")
def _(vsm):
    each(vsm, "alerts", "refusal", lambda old: lambda cause, text, now: None)


@fault("ALERT-005", "every refused command raises an alert of its own")
def _(vsm):
    for vehicle in vsm.vehicles:
        def refusal(cause, text, now, a=vehicle.alerts, count=[0]):
            count[0] += 1
            a.raise_((cause, count[0]), alert.CAUTION, alert.VSM_STATUS, text, now, alert.FOR_A_TIME)
        vehicle.alerts.refusal = refusal


@fault("ALERT-006", "a CUCS that connects is not sent the standing alerts")
def _(vsm):
    each(vsm, "alerts", "standing", lambda old: lambda: [])


# Acknowledgements

@fault("ACK-001", "the original time stamp in 17000 is one step off")
def _(vsm):
    change_reports(vsm, 17000, lambda f: {**f, "Original Message Time Stamp": f["Original Message Time Stamp"] + 1})


def always_acknowledged(vsm, *ids):
    def take(message, address):
        if message.id in ids:
            message.ack = True
    before(vsm, "take", take)


@fault("ACK-002", "settings are acknowledged unasked")
def _(vsm):
    always_acknowledged(vsm, 2017)


@fault("ACK-005", "a request is acknowledged though it did not ask for it")
def _(vsm):
    always_acknowledged(vsm, 17002)


@fault("ACK-003", "acknowledgements are acknowledged")
def _(vsm):
    def make(old):
        def take(message, address):
            old(message, address)
            if message.id == 17000 and message.ack and message.source in vsm.peers:
                vsm.peers[message.source].seen.setdefault((0, message.wire), None)
                vsm.acknowledge(message, vsm.vehicles[0], 1)
        return take
    replace(vsm, "take", make)


# Payload and data link

@fault("PAYL-001", "21000 comes for the first station only")
def _(vsm):
    change_answers(vsm, 21000, lambda reports: reports[:1])


@fault("PAYL-004", "payload elevation is positive down")
def _(vsm):
    change_reports(vsm, 21101, lambda f: {**f, "Actual Centreline Elevation Angle": -f["Actual Centreline Elevation Angle"]})


@fault("PAYL-005", "21100 and 21101 are not answered")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle, "send_report", lambda old: lambda cucs, id, *rest: False if id in (21100, 21101) else old(cucs, id, *rest))


@fault("PAYL-006", "the laser fires on any code but 0")
def _(vsm):
    for vehicle in vsm.vehicles:
        vehicle.payloads.laser_defined = lambda fields: True

        def command(station, fields):
            if "Fire Laser Pointer" in fields:
                station.pointer = 3 if fields["Fire Laser Pointer"] else 0
            if "Fire Laser Rangefinder" in fields:
                station.rangefinder = 3 if fields["Fire Laser Rangefinder"] else 0
            if "Initiate Laser Designator" in fields:
                station.designator = 2 if fields["Initiate Laser Designator"] else 0
        vehicle.payloads.command_lasers = command


@fault("PAYL-007", "the image centre is called valid above the horizon")
def _(vsm):
    change_reports(vsm, 21101, lambda f: {"Latitude of image centre": 0, "Longitude of image centre": 0, "Altitude": 0, **f, "Image Position": 1})


@fault("LINK-001", "a broadcast data link request is answered with 'granted'")
def _(vsm):
    change_reports(vsm, 28001, lambda f: {**f, "Data Link Control Availability": 2})


@fault("LINK-002", "28000 requests with 1 and releases with 0, like #1")
def _(vsm):
    for vehicle in vsm.vehicles:
        def assign(message, lawful=vehicle.assign_link):
            message.fields["Control Assignment Request"] = 1 - message.fields.get("Control Assignment Request", 0)
            return lawful(message)
        vehicle.assign_link = assign


@fault("LINK-003", "32005 for one terminal only")
def _(vsm):
    change_answers(vsm, 32005, lambda reports: reports[:1])


@fault("LINK-004", "commands are queued while the vehicle is silent, and carried out later")
def _(vsm):
    for vehicle in vsm.vehicles:
        waiting = []

        def command(fields, v=vehicle, waiting=waiting, lawful=vehicle.steering.command_mode):
            if v.link_lost:
                waiting.append(fields)
                return DONE
            return lawful(fields)

        def advance(_result, _dt, v=vehicle, waiting=waiting):
            while waiting and not v.link_lost:
                v.steering.command_mode(waiting.pop(0))
        vehicle.steering.command_mode = command
        after(vehicle, "advance", advance)


@fault("LINK-005", "the provisioned action is not flown when the CUCS is lost")
def _(vsm):
    each(vsm, "steering", "lose_station", lambda old: lambda what: None)


# Time

@fault("TIME-002", "stamps are in GPS time, 18 s ahead")
def _(vsm):
    replace(vsm, "rising", lambda old: lambda cucs, source, id, stamp: old(cucs, source, id, stamp + 18_000))


@fault("TIME-003", "stamps of 4000 lie half a second after it was sent")
def _(vsm):
    each(vsm, "", "stamp_of", lambda old: lambda id: old(id) + (600 if id in OF_VEHICLE else 0))


@fault("TIME-004", "stamps fall back now and then")
def _(vsm):
    count = [0]

    def rising(cucs, source, id, stamp):
        count[0] += 1
        return stamp - (700 if count[0] % 3 == 0 else 0)
    vsm.rising = rising


@fault("TIME-005", "a command with a stamp of another time is dropped without a word")
def _(vsm):
    def make(old):
        def process(message, vehicle, peer):
            if message.stamp is None or abs(units.stamp() - message.stamp) < 60_000 or message.id == 1:
                old(message, vehicle, peer)
        return process
    replace(vsm, "process", make)


# Malformed and hostile input

@fault("ROBUST-001", "a datagram that is cut ends the process")
def _(vsm):
    def split(datagram):
        length = int.from_bytes(datagram[2:4], "big") if len(datagram) >= 4 else 0
        if 0 < length <= 528 and len(datagram) < HEADER.size + length:
            raise SystemExit(1)
    before(vsm.codec, "split", split)


@fault("ROBUST-004", "flipped bits in a presence vector end the process")
def _(vsm):
    def fields(layout, data):
        if int.from_bytes(data[: layout["pv_bytes"]], "big") >> len(layout["fields"]):
            raise SystemExit(1)
    before(vsm.codec, "fields", fields)
    replace(vsm.codec, "checksum_matches", lambda old: lambda style, covered, trailer: True)


@fault("ROBUST-005", "an oversized or empty datagram ends the process")
def _(vsm):
    def take(datagram, address):
        if not 0 < len(datagram) <= 548:
            raise SystemExit(1)
    before(vsm, "take_datagram", take)


@fault("ROBUST-006", "NaN passes as a frequency or a position")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.mission, "problem_of_curve", lambda old: lambda fields: None)
        replace(vehicle, "transit", lambda old: lambda message: DONE)


@fault("ROBUST-007", "a text that is not ASCII ends the process")
def _(vsm):
    replace(vsm.codec, "value", lambda old: lambda kind, data: data.split(b"\0")[0].decode("ascii") if kind.startswith("char") else old(kind, data))


@fault("ROBUST-008", "status from a CUCS is believed and passed on")
def _(vsm):
    def known(source):
        return source in vsm.access or source in {v.id for v in vsm.vehicles}

    def take(message, address, lawful=vsm.take):
        if message.id in (2, 3001, 4000, 14000, 16000):
            for vehicle in vsm.vehicles:
                for cucs in vehicle.authority.watching():
                    vehicle.report(cucs, message.id, message.fields)
        elif message.source in vsm.access:
            lawful(message, address)
    vsm.known_source, vsm.take = known, take


@fault("ROBUST-009", "the broadcast id, the null id, 0 and the vehicle itself may take control")
def _(vsm):
    for id in (0, BROADCAST, NULL_ID, vsm.options.vehicle_id):
        vsm.access[id] = Access(15, True)


# Load

@fault("LOAD-001", "commands beyond 50 in a second are lost")
def _(vsm):
    window = [0, 0]

    def make(old):
        def process(message, vehicle, peer):
            second = int(vsm.now())
            window[:] = [second, window[1] + 1 if window[0] == second else 1]
            if window[1] <= 50:
                old(message, vehicle, peer)
        return process
    replace(vsm, "process", make)


@fault("LOAD-002", "a route is cut after 64 waypoints, and called complete")
def _(vsm):
    for vehicle in vsm.vehicles:
        def complete(upload, lawful=vehicle.mission.complete):
            plan = lawful(upload)
            kept = dict(list(plan.waypoints.items())[:64])
            plan.waypoints = {n: f if f.get("Next Waypoint", 0) in kept else {**f, "Next Waypoint": 0} for n, f in kept.items()}
            return plan
        vehicle.mission.complete = complete


@fault("LOAD-003", "each message of a stranger costs 5 ms")
def _(vsm):
    def known(source):
        if source not in vsm.access:
            time.sleep(0.005)
            return False
        return True
    vsm.known_source = known


# Several vehicles

@fault("MULTI-002", "2017 to one vehicle changes the other as well")
def _(vsm):
    for vehicle in vsm.vehicles:
        before(vehicle.steering, "configure_loiter", lambda fields, own=vehicle: [
            v.steering.loiter.update({n: x for n, x in fields.items() if n in v.steering.loiter}) for v in vsm.vehicles if v is not own])


# Curves

@fault("CURVE-001", "a curve to a waypoint that does not follow is accepted")
def _(vsm):
    for vehicle in vsm.vehicles:
        def problem(plan, lawful=vehicle.mission.problem_of_plan):
            curves, plan.curves = plan.curves, {}
            found, plan.curves = lawful(plan), curves
            return found
        vehicle.mission.problem_of_plan = problem


@fault("CURVE-002", "a download returns the points of the curve as waypoints")
def _(vsm):
    for vehicle in vsm.vehicles:
        def download(plan, m=vehicle.mission):
            for id, fields in plan.messages():
                if id in (50001, 50002):
                    end = plan.waypoints[fields["P4 Waypoint No"]]
                    for k in range(3):
                        yield 13002, {**end, "Waypoint Number": 60_000 + k, "Next Waypoint": fields["P4 Waypoint No"]}
                else:
                    yield id, fields
        vehicle.mission.download_of = download


@fault("CURVE-003", "of two curves for the same ends the first stays, and two legs from one waypoint are accepted")
def _(vsm):
    for vehicle in vsm.vehicles:
        def store(id, fields, m=vehicle.mission):
            m.upload.curves.setdefault((fields["P1 Waypoint No"], fields["P4 Waypoint No"]), (id, fields))
        vehicle.mission._store_curve = store
        replace(vehicle.mission, "problem_of_plan", lambda old: lambda plan: old(Plan(
            plan.mission, plan.routes, plan.waypoints, plan.loiters, {}, plan.problem)))


@fault("CURVE-004", "curve legs are flown straight")
def _(vsm):
    each(vsm, "mission", "curve_to", lambda old: lambda number, before: [])


@fault("CURVE-005", "unknown private messages are acknowledged as carried out")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle, "store", lambda old, m=vehicle.mission: lambda message: DONE if message.id in (50001, 50002) else old(message))
