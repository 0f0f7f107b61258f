"""Faults of what a VSM keeps: rights and status that outlive their end, answers that come twice, long texts that are cut, reports
that no longer follow what they report.

The last that were thought of; by reading, the rules of that time passed each. The id of a fault is that of the rule that has to fail,
with a letter from `s` on.
"""
from . import aircraft as flight
from . import units
from .authority import IN_PROGRESS, LOI_3, NOT_REQUESTED
from .change import each, replace, table
from .faults_by_rule import after, change_reports
from .wire import BROADCAST, reference

OF_MEMORY, _entry = table()


def fault(id, title):
    return _entry(id, title, id[:-1])


# Id, title, message, and what becomes of its fields.
REPORTS = (
    ("AUTH-008s", "a grant of one station names all stations", 2,
     lambda f: f | {"Controlled Station 1-16": 0xFFFF if f["Controlled Station 1-16"] else 0}),
    ("ROUTE-012s", "a transfer is complete at 60 %", 14000, lambda f: f | {"Percent Complete": min(f["Percent Complete"], 60)}),
    ("ROUTE-020s", "14000 cuts a Mission ID after 8 characters", 14000, lambda f: f | {"Mission ID": f["Mission ID"][:8]}),
    ("ROUTE-008s", "a download cuts a Route ID after 12 characters", 13001, lambda f: f | {"Route ID": f.get("Route ID", "")[:12]}),
    ("PAYL-001s", "21000 offers a station more than there is", 21000,
     lambda f: f | {"Payload Stations Available 1-16": f["Payload Stations Available 1-16"] << 1 | 1}),
    ("SCALAR-009s", "Yaw_Rate of 3010 is positive to the left", 3010, lambda f: f | {"Yaw_Rate": -f["Yaw_Rate"]}),
    ("LINK-004s", "alerts about the link name the engine", 16000, lambda f: f | {"Subsystem ID": 0} if f["Subsystem ID"] == 3 else f),
)
for _id, _title, _message, _alter in REPORTS:
    fault(_id, _title)(lambda vsm, message=_message, alter=_alter: change_reports(vsm, message, alter))


# Wrapper, acknowledgements

@fault("PV-001s", "the vector of 3007 has four bytes")
def _(vsm):
    layout = reference.MESSAGES[3007]
    short = {f["name"] for f in layout["fields"] if f["bit"] < 32}

    def make(old):
        def encode(id, source, destination, fields, ack=False):
            if id != 3007:
                return old(id, source, destination, fields, ack)
            layout["pv_bytes"] = 4
            try:
                return old(id, source, destination, {n: v for n, v in fields.items() if n in short}, ack)
            finally:
                layout["pv_bytes"] = 5
        return encode
    replace(vsm.codec, "encode", make)


@fault("ACK-001s", "acknowledgements go to everybody")
def _(vsm):
    replace(vsm.codec, "encode", lambda old: lambda id, source, destination, fields, ack=False: old(
        id, source, BROADCAST if id == 17000 else destination, fields, ack))


# Rights

@fault("AUTH-005s", "status continues after everything is given back")
def _(vsm):
    replace(vsm, "default_schedules", lambda old: lambda peer, vehicle, granted, now: granted and old(peer, vehicle, granted, now))


@fault("AUTH-008t", "a station stays with its holder after a release")
def _(vsm):
    each(vsm, "authority", "release", lambda old: lambda cucs, loi, stations, now: old(cucs, loi & ~LOI_3, stations, now))


@fault("PAYL-002s", "who holds any station may command all")
def _(vsm):
    for vehicle in vsm.vehicles:
        vehicle.payloads.may_command = lambda cucs, mask, a=vehicle.authority: bool(a.stations_of(cucs))


@fault("HAND-001s", "35000 says in progress where nothing is handed over")
def _(vsm):
    change_reports(vsm, 35000, lambda f: f | {"Status": IN_PROGRESS} if f["Status"] == NOT_REQUESTED else f)


@fault("HAND-005s", "a handover that lapses stays in progress for 35000")
def _(vsm):
    for vehicle in vsm.vehicles:
        def fail(_why, v=vehicle):
            v.authority.wish = None
        vehicle.fail_handover = fail


@fault("HB-003s", "the alert about a silent CUCS stays when it is back")
def _(vsm):
    each(vsm, "alerts", "clear", lambda old: lambda cause: None if cause == "silence" else old(cause))


@fault("HB-003t", "control stays on offer when its holder is back")
def _(vsm):
    for vehicle in vsm.vehicles:
        def watch(now, v=vehicle, lawful=vehicle.watch_station):
            offered = v.authority.offered
            lawful(now)
            v.authority.offered |= offered and v.authority.holder() is not None
        vehicle.watch_station = watch


@fault("MULTI-002s", "who releases one vehicle has released all")
def _(vsm):
    lawful = [v.authority.release for v in vsm.vehicles]
    for vehicle in vsm.vehicles:
        vehicle.authority.release = lambda *args: [release(*args) for release in lawful]


# Status and schedules

@fault("STAT-003s", "a message that is scheduled twice comes twice as often")
def _(vsm):
    asked = set()

    def schedule(cucs, vehicle, id, frequency, lawful=vsm.schedule):
        key = (cucs, vehicle.number, id, frequency)
        lawful(cucs, vehicle, id, frequency * 2 if key in asked else frequency)
        asked.add(key)
    vsm.schedule = schedule


@fault("STAT-009s", "4001 names the last waypoint when its plan is gone")
def _(vsm):
    for vehicle in vsm.vehicles:
        last = {}

        def encode(fields, v=vehicle, last=last):
            if v.aircraft.mode in flight.ON_ROUTE:
                last.update({n: x for n, x in fields.items() if n.startswith("To ")})
                return fields
            return fields | last
        change_reports(vsm, 4001, encode)


@fault("STAT-012s", "3002 shows course and speed of a refused command")
def _(vsm):
    names = ("Commanded Course", "Commanded Speed", "Speed Type", "Heading Command Type")
    for vehicle in vsm.vehicles:
        def command(fields, s=vehicle.steering, lawful=vehicle.steering.command_mode):
            outcome = lawful(fields)
            if outcome.reason:
                s.commanded |= {n: fields[n] for n in names if n in fields}
            return outcome
        vehicle.steering.command_mode = command


@fault("MODE-004s", "the speeds of waypoints are not flown")
def _(vsm):
    each(vsm, "aircraft", "fly", lambda old: lambda points, *rest: old([_slow(p) for p in points], *rest))


def _slow(point):
    point.speed = 5.0
    return point


@fault("STAT-015s", "4001 continues with new stamps after the vehicle fell silent")
def _(vsm):
    for vehicle in vsm.vehicles:
        def send_report(cucs, id, mask=0, wanted=0, v=vehicle, lawful=vehicle.send_report):
            if id != 4001 or not v.link_lost:
                return lawful(cucs, id, mask, wanted)
            v.link_lost = False
            try:
                return lawful(cucs, id, mask, wanted)
            finally:
                v.link_lost = True
        vehicle.send_report = send_report
        replace(vehicle, "stamp_of", lambda old: lambda id: units.stamp() if id == 4001 else old(id))


@fault("STAT-016s", "each subsystem is reported twice")
def _(vsm):
    for vehicle in vsm.vehicles:
        def report(message, lawful=vehicle.report_subsystems):
            lawful(message)
            return lawful(message)
        vehicle.report_subsystems = report


@fault("CONF-005s", "44003 says of everything that changes that it is available")
def _(vsm):
    each(vsm, "configuration", "changed", lambda old: lambda: [(id, f | {"Enumerated Index Enable": 0}) for id, f in old()])


@fault("CONF-005t", "44003 comes when a mode comes, not when it goes")
def _(vsm):
    each(vsm, "configuration", "changed", lambda old: lambda: [m for m in old() if m[1].get("Enumerated Index Enable") == 0])


@fault("ALERT-002s", "an alert is cleared after two seconds, its cause gone or not")
def _(vsm):
    for vehicle in vsm.vehicles:
        own = vehicle.alerts
        raised, over = {}, set()

        def raise_(cause, *args, raised=raised, over=over, v=vehicle, lawful=own.raise_, **named):
            if cause in over:
                return
            raised.setdefault(cause, v.now())
            lawful(cause, *args, **named)

        def tick(now, own=own, raised=raised, over=over, lawful=own.tick):
            lawful(now)
            for cause in [c for c, at in raised.items() if c == "link" and now - at > 2]:
                raised.pop(cause)
                over.add(cause)
                own.clear(cause)
            if not any(v.link_lost for v in vsm.vehicles):
                over.clear()
        own.raise_, own.tick = raise_, tick


# Missions, payloads

@fault("ROUTE-008t", "a download has each waypoint twice")
def _(vsm):
    each(vsm, "mission", "download_of", lambda old: lambda plan: [m for m in old(plan) for _ in range(2 if m[0] == 13002 else 1)])


@fault("PAYL-004s", "vertical slew rates are positive down")
def _(vsm):
    for vehicle in vsm.vehicles:
        def steer(_result, fields, own=vehicle.payloads):
            for station in own.stations:
                station.rates = (station.rates[0], -station.rates[1])
        after(vehicle.payloads, "steer", steer)


@fault("PAYL-004t", "the commanded field of view is the half of it")
def _(vsm):
    for vehicle in vsm.vehicles:
        def steer(_result, fields, own=vehicle.payloads):
            if fields.get("Set Horizontal Field of View"):
                for station in own.stations:
                    station.view = fields["Set Horizontal Field of View"] // 2
        after(vehicle.payloads, "steer", steer)
