"""Faults where two things have to agree and do not: two messages about one state, a station and the others, what is sent and what was
asked for, a command and the next one.

They were thought of from the messages and their receivers, after the rules had been widened for all other tables. The id of a fault is
that of the rule that has to fail, with a letter from `u` on.
"""
from . import aircraft as flight
from . import mission as plans
from .authority import CONTROL, LOI_4, LOI_5
from .change import each, replace, table
from .faults_by_rule import after, before, change_reports
from .mutants import change_sent
from .steering import DONE, LOITER, WAYPOINT
from .wire import BROADCAST

OF_AGREEMENT, _entry = table()


def fault(id, title, *beside):
    """`beside` are rules whose play shows what this one looks at."""
    return _entry(id, title, " ".join((id[:-1], *beside)))


def scaled(names, factor):
    return lambda f: f | {n: round(f[n] * factor) for n in names if n in f}


# Id, title, message, and what becomes of its fields.
REPORTS = (
    ("STAT-007u", "Roll of 4000 is positive to the left", 4000, lambda f: f | {"Roll": -f["Roll"]}),
    ("STAT-007v", "Barometric Altitude Rate of 3009 is positive down", 3009, lambda f: f | {"Barometric Altitude Rate": -f["Barometric Altitude Rate"]}),
    ("STAT-007w", "airspeeds of 3009 are in steps of 0.1 m/s", 3009, scaled(("True Airspeed", "Indicated Airspeed"), 0.5)),
    ("STAT-008u", "AGL Altitude of 3009 is the altitude above the sea", 3009, lambda f: f | {"AGL Altitude": f["Barometric Altitude"]}),
    ("STAT-008v", "altitudes of 4000 are above the ground, under type 3", 4000, lambda f: f | {"Altitude": f["Altitude"] - 26_750} if "Altitude" in f else f),
    ("CONF-011u", "the energy level of 3002 is 100 % whatever is left", 3002, lambda f: f | {"Current Propulsion Energy Level": 62_500}),
    ("STAT-012v", "Speed Type of 3002 is always 0", 3002, lambda f: f | {"Speed Type": 0}),
    ("STAT-012w", "Altitude Type of 3002 is always 0", 3002, lambda f: f | {"Altitude Type": 0}),
    ("STAT-012x", "UA State of 3002 is that of a vehicle on the ground", 3002, lambda f: f | {"UA State": 3}),
    ("STAT-012y", "Heading Command Type of 3002 is always 0", 3002, lambda f: f | {"Heading Command Type": 0}),
    ("STAT-010u", "To Waypoint Altitude of 4001 is 0", 4001, lambda f: f | {"To Waypoint Altitude": 0}),
    ("STAT-010v", "places of 4001 are those of the waypoint before", 4001, lambda f: f | {
        f"To Waypoint - {n}": f[f"From Waypoint - {n}"] for n in ("Latitude", "Longitude") if f["From Waypoint Number"]}),
    ("STAT-013u", "3000 names four engines where 3007 reports two", 3000, lambda f: f | {"Number of Engines": 4}),
    ("STAT-015x", "every subsystem is nominal, whatever happens", 16001, lambda f: f | {"Subsystem State": 1}),
    ("ALERT-003u", "alerts have no text", 16000, lambda f: f | {"Text": ""}),
    ("ALERT-003v", "alerts that are shown for a time name no time", 16000, lambda f: f | {"Persistence": 0}),
    ("ALERT-002u", "the end of an alert has the priority that it had", 16000, lambda f: f | {"Priority": f["Priority"] or 2}),
    ("DISC-009u", "3 cuts the Tail Number after five characters", 3, lambda f: f | {"Tail Number": f["Tail Number"][:5]}),
    ("DISC-006u", "3 has no subtype", 3, lambda f: f | {"Vehicle Subtype": 0}),
    ("CONF-007u", "a radius of 0 is the default where 15 m is the least", 41003, lambda f: f | {"Default Value": 0}),
    ("CONF-008u", "the declared maxima are half as high again as what is accepted", 41003, lambda f: f | {"Max Value": f["Max Value"] * 3 // 2} if f.get("Max Value", 2**32) < 2**14 else f),
    ("CONF-004u", "44003 calls what is not implemented available", 44003, lambda f: f | {"Enumerated Index Enable": 0} if f.get("Enumerated Index Enable") == -2 else f),
    ("PAYL-004u", "21101 has fields of view in degrees", 21101, scaled(("Actual Vertical Field of View", "Actual Horizontal Field of View"), 180 / 32768)),
    ("PAYL-004v", "Pointing Mode State is always 1", 21101, lambda f: f | {"Pointing Mode State": 1}),
    ("PAYL-007u", "the image centre is 100 m above the ground", 21101, lambda f: f | {"Altitude": f["Altitude"] + 5_000} if "Altitude" in f else f),
    ("PAYL-005u", "21100 has its azimuth limits exchanged", 21100, lambda f: f | {
        "Field of Regard - Azimuth Min": f["Field of Regard - Azimuth Max"], "Field of Regard - Azimuth Max": f["Field of Regard - Azimuth Min"]}),
    ("MODE-010u", "3005 names mode 0 whichever was commanded", 3005, lambda f: f | {"Reported Flight Termination Mode": 0}),
    ("AUTH-016u", "Access Requested of 2 is always 0", 2, lambda f: f | {"Access Requested": 0}),
    ("AUTH-003u", "Access Authorized of 2 is 2 for everybody", 2, lambda f: f | {"Access Authorized": 2}),
    ("SCALAR-004u", "altitudes of a download are kept in 16 bits", 13002, lambda f: f | {"Waypoint to Altitude": f["Waypoint to Altitude"] & 0xFFFF}),
)
for _id, _title, _message, _alter in REPORTS:
    fault(_id, _title, *(["MODE-004"] if _id == "STAT-012x" else []))(lambda vsm, message=_message, alter=_alter: change_reports(vsm, message, alter))


# Who speaks, and to whom

def change_ends(vsm, alter):
    """Changes source and destination: `alter(id, source, destination)` gives new ones."""
    replace(vsm.codec, "encode", lambda old: lambda id, source, destination, fields, ack=False: old(id, *alter(id, source, destination), fields, ack))


@fault("AUTH-001w", "grants go to everybody")
def _(vsm):
    change_ends(vsm, lambda id, source, destination: (source, BROADCAST if id == 2 else destination))


@fault("WRAP-016v", "acknowledgements come from the VSM's id")
def _(vsm):
    change_ends(vsm, lambda id, source, destination: (vsm.options.vsm_id if id == 17000 else source, destination))


@fault("ACK-003u", "acknowledgements request to be acknowledged")
def _(vsm):
    replace(vsm.codec, "encode", lambda old: lambda id, source, destination, fields, ack=False: old(id, source, destination, fields, ack or id == 17000))


@fault("WRAP-014u", "messages with a reserved property bit are dropped")
def _(vsm):
    replace(vsm.codec, "decode", lambda old: lambda raw: None if raw[15] & 0x3F else old(raw))


@fault("WRAP-007u", "messages with a sum of style 2 are dropped")
def _(vsm):
    replace(vsm.codec, "checksum_matches", lambda old: lambda style, covered, trailer: style != 2 and old(style, covered, trailer))


@fault("PV-002v", "3001 and 4000 have no time stamp")
def _(vsm):
    change_sent(vsm, lambda id, fields: {n: v for n, v in fields.items() if n != "Time Stamp" or id not in (3001, 4000)})


@fault("DISC-001u", "a discovery that is addressed to the vehicle is not answered")
def _(vsm):
    def take(message, address, lawful=vsm.take):
        if message.id != 1 or message.destination == BROADCAST or message.fields.get("Requested/Handover LOI"):
            lawful(message, address)
    vsm.take = take


# Rights

@fault("AUTH-001v", "a grant of LOI 4 takes LOI 2 away")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.authority, "give", lambda old, a=vehicle.authority: lambda cucs, loi: [a.held.pop(cucs, None), old(cucs, loi)])


@fault("AUTH-005v", "a release of LOI 4 keeps LOI 5")
def _(vsm):
    for vehicle in vsm.vehicles:
        def release(cucs, loi, stations, now, a=vehicle.authority, lawful=vehicle.authority.release):
            kept = a.held.get(cucs, 0) & LOI_5
            lawful(cucs, loi, stations, now)
            if loi & CONTROL:
                a.held[cucs] = a.held.get(cucs, 0) | kept
        vehicle.authority.release = release


@fault("AUTH-002u", "a request that is denied costs the levels that were held")
def _(vsm):
    for vehicle in vsm.vehicles:
        def make(old, a=vehicle.authority):
            def take_control(cucs, loi, access, now):
                if a.holder() not in (None, cucs):
                    a.held[cucs] = 0
                old(cucs, loi, access, now)
            return take_control
        replace(vehicle.authority, "_take_control", make)


@fault("AUTH-002v", "who may override takes control by a plain request")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.authority, "_take_control", lambda old, a=vehicle.authority: lambda cucs, loi, access, now: old(
            cucs, loi, 2 if a.may_override(cucs) else access, now))


@fault("AUTH-002w", "whoever was denied control gets it, unasked, when it is free")
def _(vsm):
    for vehicle in vsm.vehicles:
        waiting = []

        def make(old, a=vehicle.authority, waiting=waiting):
            def take_control(cucs, loi, access, now):
                if a.holder() not in (None, cucs) and access == 1:
                    waiting[:] = [(cucs, loi)]
                old(cucs, loi, access, now)
            return take_control

        def watch(_now, v=vehicle, waiting=waiting):
            if waiting and v.authority.holder() is None:
                cucs, loi = waiting.pop()
                v.authority.give(cucs, loi)
                v.send_report(cucs, 2)
        replace(vehicle.authority, "_take_control", make)
        before(vehicle, "watch_station", watch)


@fault("AUTH-003v", "an override that is denied says 'granted'")
def _(vsm):
    for vehicle in vsm.vehicles:
        def make(old, v=vehicle):
            def granted(cucs):
                asked = v.last_request.get(cucs, {})
                return old(cucs) | (asked.get("Requested/Handover LOI", 0) if asked.get("Requested/Handover Access") == 2 else 0)
            return granted
        replace(vehicle, "granted_field", make)


@fault("AUTH-003w", "nobody says to the former holder that it is overridden")
def _(vsm):
    for vehicle in vsm.vehicles:
        def after_change(cucs, before_, holder, handover, v=vehicle, lawful=vehicle.after_change):
            lawful_send = v.send_report
            v.send_report = lambda to, id, *rest: True if to == holder and to != cucs else lawful_send(to, id, *rest)
            try:
                lawful(cucs, before_, holder, handover)
            finally:
                v.send_report = lawful_send
        vehicle.after_change = after_change


@fault("AUTH-003x", "an override takes LOI 4 and leaves LOI 5 to the former holder")
def _(vsm):
    for vehicle in vsm.vehicles:
        vehicle.authority.take_from = lambda cucs, a=vehicle.authority: a.held.update({cucs: a.held.get(cucs, 0) & ~LOI_4})
        vehicle.authority.holder = lambda a=vehicle.authority: next((c for c, loi in a.held.items() if loi & LOI_4), None)


@fault("AUTH-008u", "a station is given to whoever asks last")
def _(vsm):
    for vehicle in vsm.vehicles:
        vehicle.authority._take_stations = lambda cucs, stations, access, a=vehicle.authority: a.station_holder.update(
            {1 << k: cucs for k in range(16) if stations & a.stations & 1 << k})


# The second time

@fault("ROBUST-010u", "a command that was overtaken is carried out when it arrives")
def _(vsm):
    vsm.untimely = lambda message, vehicle, peer: None


@fault("ROBUST-010v", "only the last message is known as a duplicate")
def _(vsm):
    replace(vsm, "is_duplicate", lambda old: lambda peer, key: bool(peer.seen) and next(reversed(peer.seen)) == key)


@fault("ROUTE-003u", "messages of one type with one time stamp are taken for one message")
def _(vsm):
    def make(old):
        seen = {}

        def process(message, vehicle, peer):
            key = (message.source, message.id, vehicle.number, message.stamp)
            if seen.setdefault(key, message.wire) == message.wire:
                old(message, vehicle, peer)
        return process
    replace(vsm, "process", make)


@fault("STAT-003u", "a schedule ends after twenty messages")
def _(vsm):
    for vehicle in vsm.vehicles:
        def send_report(cucs, id, *rest, v=vehicle, lawful=vehicle.send_report):
            schedule = vsm.peers[cucs].schedules.get((v.number, id)) if cucs in vsm.peers else None
            if schedule and schedule.asked:
                schedule.count = getattr(schedule, "count", 0) + 1
                if schedule.count > 20:
                    return True
            return lawful(cucs, id, *rest)
        vehicle.send_report = send_report


@fault("STAT-003v", "scheduled messages come in bursts, once a second")
def _(vsm):
    def push(now, lawful=vsm.push):
        if int(now) != push.second:
            push.second = int(now)
            for peer in vsm.peers.values():
                for (number, id), schedule in peer.schedules.items():
                    if schedule.asked:
                        for _ in range(round(1 / schedule.period)):
                            vsm.vehicles[number].send_report(next(c for c, p in vsm.peers.items() if p is peer), id)
        for peer in vsm.peers.values():
            for schedule in peer.schedules.values():
                if schedule.asked:
                    schedule.due = now + 1
        lawful(now)
    push.second = 0
    vsm.push = push


@fault("TIME-003u", "positions are taken every two seconds, stamps every time", "MODE-004")
def _(vsm):
    for vehicle in vsm.vehicles:
        last = [0.0, {}]

        def keep(fields, v=vehicle, last=last):
            names = [n for n in ("Latitude", "Longitude", "Altitude") if n in fields]
            if v.now() - last[0] > 2:
                last[:] = [v.now(), {n: fields[n] for n in names}]
            return fields | {n: last[1].get(n, fields[n]) for n in names}
        change_reports(vsm, 4000, keep)


@fault("ACK-007u", "a question about a message that is not there is acknowledged as answered")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle, "answer", lambda old: lambda message: old(message) and DONE)


@fault("ACK-007v", "a schedule of a message that is not there is acknowledged as carried out")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle, "schedule", lambda old: lambda message: old(message) and DONE)


@fault("ROBUST-004u", "after fifty damaged datagrams a CUCS is not answered any more")
def _(vsm):
    bad = [0]

    def messages(datagram, known, lawful=vsm.codec.messages):
        found = list(lawful(datagram, known))
        bad[0] += not found and bool(datagram)
        return found if bad[0] < 50 else []
    vsm.codec.messages = messages


# Missions


@fault("ROUTE-003v", "of two messages for one waypoint the first stays")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.mission, "store", lambda old, m=vehicle.mission: lambda id, fields: (
            None if id == 13002 and fields.get("Waypoint Number") in m.upload.waypoints else old(id, fields)))


@fault("ROUTE-002u", "a route that has been loaded is flown at once")
def _(vsm):
    for vehicle in vsm.vehicles:
        def take_aboard(plan, v=vehicle, lawful=vehicle.mission.take_aboard):
            lawful(plan)
            if plan.waypoints and v.aircraft.airborne:
                v.aircraft.fly(v.mission.route_from())
        vehicle.mission.take_aboard = take_aboard


@fault("ROUTE-010u", "the download of an empty plan does not end")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.mission, "_start_download", lambda old: lambda cucs, mode, mission, queue, now: queue and old(cucs, mode, mission, queue, now) or None)


@fault("ROUTE-010v", "clear leaves the Mission ID")
def _(vsm):
    for vehicle in vsm.vehicles:
        def clear(cucs, mission, m=vehicle.mission, lawful=vehicle.mission.clear):
            name, result = m.aboard.mission, lawful(cucs, mission)
            m.aboard.mission = name
            return result
        vehicle.mission.clear = clear


@fault("ROUTE-011u", "cancel clears the plan aboard")
def _(vsm):
    for vehicle in vsm.vehicles:
        after(vehicle.mission, "cancel", lambda _r, _cucs, m=vehicle.mission: setattr(m, "aboard", plans.Plan()))


@fault("ROUTE-020u", "an unknown plan mode is answered with 'complete'")
def _(vsm):
    for vehicle in vsm.vehicles:
        def command(cucs, fields, now, m=vehicle.mission, lawful=vehicle.mission.command):
            if fields.get("Mission Plan Mode") in (1, 2, 3, 4, 5):
                return lawful(cucs, fields, now)
            m.status(cucs, 1, 100, fields.get("Mission Plan Mode", 0), fields.get("Mission ID", ""))
            return None
        vehicle.mission.command = command


@fault("ROUTE-004u", "waypoint numbers are kept in one byte")
def _(vsm):
    names = ("Waypoint Number", "Next Waypoint", "Initial Waypoint Number")
    for vehicle in vsm.vehicles:
        replace(vehicle.mission, "store", lambda old: lambda id, fields: old(id, fields | {n: fields[n] & 0xFF for n in names if n in fields}))


@fault("MODE-004u", "the last waypoint is left out")
def _(vsm):
    each(vsm, "mission", "flown_order", lambda old: lambda start: old(start)[:-1] or old(start))


@fault("MODE-004v", "in mode 11 a commanded waypoint number is ignored")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.aircraft, "fly", lambda old, a=vehicle.aircraft: lambda points, *rest: None if a.mode == flight.ROUTE else old(points, *rest))


@fault("ROUTE-015u", "turns are counted as seconds")
def _(vsm):
    for vehicle in vsm.vehicles:
        def loiter_at(number, waypoint, lawful=vehicle.mission.loiter_at):
            made = lawful(number, waypoint)
            if made and made.turns:
                made.duration, made.turns = float(made.turns), None
            return made
        vehicle.mission.loiter_at = loiter_at


# Flight

@fault("AUTH-013u", "mode 11 on the ground launches")
def _(vsm):
    for vehicle in vsm.vehicles:
        def take_values(mode, fields, v=vehicle, lawful=vehicle.steering.take_values):
            if mode == WAYPOINT and not v.aircraft.airborne:
                v.aircraft.launch()
            lawful(mode, fields)
        vehicle.steering.take_values = take_values


@fault("AUTH-013v", "mode 12 on the ground launches")
def _(vsm):
    for vehicle in vsm.vehicles:
        def take_values(mode, fields, v=vehicle, lawful=vehicle.steering.take_values):
            if mode == LOITER and not v.aircraft.airborne:
                v.aircraft.launch()
            else:
                lawful(mode, fields)
        vehicle.steering.take_values = take_values


@fault("MODE-011u", "a wave-off stops the descent, and does not climb")
def _(vsm):
    for vehicle in vsm.vehicles:
        after(vehicle.aircraft, "climb_away", lambda _r, a=vehicle.aircraft: setattr(a, "target_altitude", a.altitude + 1))


@fault("MODE-006u", "Heading Reference is not looked at")
def _(vsm):
    each(vsm, "steering", "steering", lambda old: lambda fields: old(fields | {"Heading Reference": 0}))


@fault("MODE-006v", "Commanded Roll turns the other way")
def _(vsm):
    each(vsm, "steering", "steering", lambda old: lambda fields: old(fields | {"Commanded Roll": -fields["Commanded Roll"]} if "Commanded Roll" in fields else fields))


@fault("MODE-006w", "Commanded Turn Rate turns the other way")
def _(vsm):
    each(vsm, "steering", "steering", lambda old: lambda fields: old(
        fields | {"Commanded Turn Rate": -fields["Commanded Turn Rate"]} if fields.get("Heading Command Type") == 5 else fields))


@fault("MODE-011x", "Altitude Type of 2016 is not looked at")
def _(vsm):
    each(vsm, "steering", "altitude", lambda old: lambda fields: old(fields | {"Altitude Type": 1}))


@fault("MODE-006y", "Altitude Command Type 3 climbs as fast as it can")
def _(vsm):
    for vehicle in vsm.vehicles:
        after(vehicle.steering, "steering", lambda made, _fields: setattr(made, "climb_limit", None))


@fault("MODE-015u", "an altitude alone is ignored on a route")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.aircraft, "change_altitude", lambda old, a=vehicle.aircraft: lambda altitude: None if a.mode in flight.ON_ROUTE else old(altitude))


@fault("MODE-015v", "a part of a command in mode 15 ends the rest of the steering")
def _(vsm):
    for vehicle in vsm.vehicles:
        def steering(fields, v=vehicle, lawful=vehicle.steering.steering):
            made = lawful(fields)
            if "Select Flight Path Control Mode" not in fields and not fields.get("Heading Command Type"):
                made.heading = made.course = v.aircraft.heading
            return made
        vehicle.steering.steering = steering


# Configuration, alerts, links, several vehicles

@fault("CONF-001u", "the configuration goes to everybody who is connected")
def _(vsm):
    for vehicle in vsm.vehicles:
        def send(_cucs, messages, v=vehicle):
            for cucs in v.authority.watching() or [_cucs]:
                v.send_together(cucs, messages)
        vehicle.configuration._send = send


@fault("CONF-001v", "'complete' comes twice")
def _(vsm):
    each(vsm, "configuration", "phase", lambda old: lambda kind, stations: old(kind, stations) + old(kind, stations)[-1:])


@fault("CONF-002u", "a single parameter is answered by the whole configuration")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.configuration, "request", lambda old: lambda cucs, fields: old(cucs, fields | {"Request Type": fields.get("Request Type") or 3}))


@fault("STAT-015v", "alerts go to the holder only")
def _(vsm):
    for vehicle in vsm.vehicles:
        def announce(fields, v=vehicle):
            if v.authority.holder() is not None:
                v.report(v.authority.holder(), 16000, fields)
        vehicle.alerts._send = announce


@fault("ALERT-004u", "of several reasons the first is shown")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.alerts, "refusal", lambda old, a=vehicle.alerts: lambda cause, text, now: old(
            "command", a.open["command"].text if "command" in a.open else text, now))


@fault("ALERT-001u", "updates have the negative id of the first message")
def _(vsm):
    for vehicle in vsm.vehicles:
        replace(vehicle.alerts, "fields", lambda old: lambda alert, id: old(alert, -abs(id) if alert.priority else id))


@fault("LINK-004u", "control is taken from its holder when the vehicle's link is lost")
def _(vsm):
    for vehicle in vsm.vehicles:
        def watch(_r, _now, v=vehicle):
            if v.link_lost and v.authority.holder() is not None:
                holder = v.authority.holder()
                v.authority.take_from(holder)
                v.send_report(holder, 2)
        after(vehicle, "watch_link", watch)


@fault("STAT-015u", "when the link is back status does not come again by itself")
def _(vsm):
    for vehicle in vsm.vehicles:
        lost = []
        after(vehicle, "watch_link", lambda _r, _now, v=vehicle, lost=lost: lost.append(1) if v.link_lost and not lost else None)
        pushing = []

        def push(now, lawful=vsm.push, pushing=pushing):
            pushing.append(1)
            lawful(now)
            pushing.clear()

        def send_report(cucs, id, mask=0, wanted=0, lost=lost, pushing=pushing, lawful=vehicle.send_report):
            return True if lost and pushing and id in (3001, 3002, 4000, 4001) else lawful(cucs, id, mask, wanted)
        vsm.push, vehicle.send_report = push, send_report


@fault("MULTI-002u", "alerts of one vehicle are sent in the name of the other")
def _(vsm):
    change_ends(vsm, lambda id, source, destination: (vsm.vehicles[0].id if id == 16000 else source, destination))


@fault("MULTI-002v", "control of one vehicle is control of all")
def _(vsm):
    lawful = [v.authority.give for v in vsm.vehicles]
    for vehicle in vsm.vehicles:
        vehicle.authority.give = lambda *args: [give(*args) for give in lawful]


@fault("MULTI-002w", "questions are answered by the first vehicle")
def _(vsm):
    first = vsm.vehicles[0]
    for vehicle in vsm.vehicles[1:]:
        replace(vehicle, "answer", lambda old, own=vehicle: lambda message: old(message) if message.fields.get("Message Type") == 3 else first.answer(message))
