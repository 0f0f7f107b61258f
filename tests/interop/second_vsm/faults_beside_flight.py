"""Those of `faults_by_rule` that are about other things than rights and flight: configuration, alerts, acknowledgements, payload,
links, time, malformed input, load, curves.
"""
import time

from . import alerts as alert
from . import configuration, steering, units
from .authority import Access
from .change import each, replace
from .faults_by_rule import after, before, change_answers, change_reports, fault
from .mission import Plan
from .reports import OF_VEHICLE
from .steering import DONE
from .wire import BROADCAST, HEADER, NULL_ID


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


@fault("CONF-011", "an alert of its own for an energy level below the declared limit")
def _(vsm):
    for vehicle in vsm.vehicles:
        def tick(_result, _dt, vehicle=vehicle):
            if vehicle.aircraft.battery < 30:
                vehicle.alerts.raise_("energy", alert.CAUTION, alert.ENERGY, "battery low", vehicle.now())
            else:
                vehicle.alerts.clear("energy")
        after(vehicle, "advance", tick)


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
