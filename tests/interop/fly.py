#!/usr/bin/env python3
"""Flies one route through a VSM as a CUCS would, and says what was promised and not kept.

    fly.py --vsm 127.0.0.1:4586 [--id 1b:00:00:a0] [--report FILE]

Discovers, takes control, has faulty routes refused, uploads a good one, launches, flies it, changes speed
and altitude on the way, lands and gives control back. It acknowledges no heartbeat, which is what proves a
station's address: the `[[cucs]]` of the VSM needs `address = "127.0.0.1"`, or its reports are rationed and
some checks fail. It needs an aircraft on the ground, disarmed, in a
place where 400 m north and 150 m east of it are free; `--slow 10` allows ten times the time of each step.
Ends with 0 where every check held, else with 1. THE AIRCRAFT WILL ARM AND FLY.
"""
import argparse
import json
import sys
import time
from collections import Counter

import cucs as dli
from checks import Checks
from cucs import Cucs, Failure, reference
from route import AGL, WGS84, closest, distance, faulty, metres, survey

ROUTE_MISSION = "SURVEY FLIGHT"
LAUNCH_HEIGHT_M = 30.0
LOITER_HEIGHT_M = 45.0
FASTER_MS = 8.0
STRANGER = 0x1B0000EE


class Flight:
    """The steps in their order; each leaves its verdicts in `checks`."""

    def __init__(self, options):
        self.options, self.checks = options, Checks()
        self.cucs = Cucs(options.vsm, options.id, bind=(options.bind, 0))
        self.stranger = Cucs(options.vsm, STRANGER, bind=(options.bind, 0), heartbeat=False)
        self.start = self.route = None
        self.loiter_command = None
        self.airborne = False

    def run(self):
        """All steps; True where every check held."""
        try:
            for step in (self.discover, self.no_authority, self.listen, self.take_control, self.talk_nonsense, self.refuse_routes,
                         self.upload, self.launch, self.fly, self.faster, self.loiter_higher, self.fly_on,
                         self.repeat_an_old_command, self.refuse_in_flight, self.finish, self.land, self.release):
                self.checks.step(step.__name__.replace("_", " "))
                step()
        except Failure as failure:
            self.check(str(failure), False)
            self.come_down()
        finally:
            self.checks.step("in all that was received")
            self.whole()
            self.cucs.close()
            self.stranger.close()
        return self.checks.passed()

    def come_down(self):
        """Whatever went wrong, nothing is left in the air."""
        if self.airborne:
            self.checks.step("come down")
            _, kinds = self.cucs.command(2016, {"Select Flight Path Control Mode": dli.AUTOLAND}, self.s(20))
            self.say(f"17000 types for the landing: {kinds}")

    def s(self, seconds):
        """A time-out for something that depends on the aircraft."""
        return seconds * self.options.slow

    def discover(self):
        self.greet_as_stranger(0xFFFFFFFF)
        answer = self.cucs.discover(self.s(10))
        f = answer.fields
        self.say(f"vehicle {dli.text(self.cucs.vehicle)} behind VSM {dli.text(self.cucs.vsm_id & 0xFFFFFFFF)}")
        self.check("#2 offers LOI 4 and 5", f.get("LOI Authorized", 0) & 0xC == 0xC, f)
        self.check("#2 grants nothing that was not asked for", f.get("LOI Granted", 0) == 0, f)
        self.greet_as_stranger(self.cucs.vehicle)

    def greet_as_stranger(self, destination):
        for _ in range(2):
            self.stranger.send(1, {"VSM ID": -1, "Requested/Handover LOI": 0xD, "Requested/Handover Access": 1,
                                   "Controlled Station 1-16": 0}, ack=True, to=destination)
            self.stranger.pump(0.2)

    def no_authority(self):
        self.check_refused("a launch without any LOI")
        self.cucs.pump(1.2)
        pushed = Counter(m.id for m in self.cucs.inbox if m.id in (3001, 3002, 4000, 4001))
        self.check("no state is pushed before LOI 2 is granted", not pushed, dict(pushed))

    def listen(self):
        f = self.cucs.authority(dli.LOI_2, dli.REQUEST, 5).fields
        self.check("LOI 2 is granted, and nothing more", f.get("LOI Granted") == dli.LOI_2, f)
        self.check("a grant of LOI 2 is not control", f.get("Access Granted") in (0, 1), f)
        self.cucs.wait(lambda m: m.id == 4000 and "Latitude" in m.fields, self.s(60), what="a position")
        # The geoid separation comes with a slower message of the vehicle: type 3 once it is known.
        try:
            self.cucs.wait(lambda m: m.id == 4000 and m.fields.get("Altitude Type") == WGS84, self.s(10))
        except Failure:
            pass
        self.start = self.cucs.position()
        self.say("on the ground at {:.7f}, {:.7f} deg, {:.1f} m, altitude type {}".format(
            self.start[0] * 57.29577951308232, self.start[1] * 57.29577951308232, *self.start[2:]))
        self.check("4000 gives the WGS-84 height", self.start[3] == WGS84, f"altitude type {self.start[3]}")
        if self.options.home:
            lat, lon, alt = self.options.home
            off = distance(self.start, (lat / 57.29577951308232, lon / 57.29577951308232))
            self.check("4000 is where the vehicle stands", off < 10, f"{off:.1f} m off")
            self.check("4000's height is plausible", abs(self.start[2] - alt) < 120,
                       f"{self.start[2]:.1f} m, {alt:.1f} m AMSL")
        self.check_rates("on the ground")
        self.check_refused("a launch with LOI 2 only")
        self.check_stays("3001 is unchanged by what was refused", lambda mode: mode not in (dli.LAUNCH,), 1.0)

    def take_control(self):
        f = self.cucs.authority(dli.LOI_4 | dli.LOI_5, dli.REQUEST, 5).fields
        self.check("#2 grants LOI 4 and 5 beside LOI 2", f.get("LOI Granted") == 0xD, f)
        self.check("#2 says in control", f.get("Access Granted") == 1, f)

    def talk_nonsense(self):
        """Launches that must not be understood as such; one of them to an address that is nobody's."""
        c, since = self.cucs, self.cucs.mark()
        fields = {"Select Flight Path Control Mode": dli.LAUNCH, "Altitude Command Type": 1, "Commanded Altitude": 1500,
                  "Altitude Type": AGL}
        whole = reference.encode(c.make(2016, fields, ack=True, style=(32, 3)))
        other_sum = whole[:-1] + bytes([whole[-1] ^ 1])
        plain = reference.encode(c.make(2016, fields, ack=True, style=(32, 0)))
        unknown = plain[:12] + (60000).to_bytes(2, "big") + plain[14:]
        for datagram in (whole[:-1], whole[:15], other_sum, unknown, whole[:2] + b"\xff\xff" + whole[4:], b"\0" * 1400, b"",
                       reference.encode(c.make(2016, fields, ack=True, to=c.vehicle ^ 0x55, style=(32, 0)))):
            c.transmit_bytes(datagram)
        self.check_stays("nothing that is broken or meant for others is carried out", lambda mode: mode != dli.LAUNCH, 1.0)
        # A type that nobody knows may be refused with an alert.
        answers = [m.value for m in c.inbox[since:] if m.id == 17000 and (
            m.fields.get("Original Message Type") != 60000 or m.fields.get("Acknowledgement Type") != dli.REFUSED)]
        self.check("nothing that is broken or meant for others is acknowledged", not answers, answers[:1])

    def refuse_routes(self):
        for wrong, number, route in faulty(200):
            self.check_route_refused(wrong, number, route)

    def check_route_refused(self, wrong, number, route):
        c, since = self.cucs, self.cucs.mark()
        load = route.load(c, "BAD")
        c.transmit(route.definition(c), *(p.message(c, self.start, ack=False) for p in route.points))
        # Its stamp must be the youngest of the datagrams.
        load["fields"]["Time Stamp"] = c.stamp()
        c.transmit(load)
        status = c.wait(lambda m: m.id == 14000 and m.fields.get("Status") in (1, 2), self.s(10), since,
                        f"14000 about {wrong}").fields
        c.wait_for_ends([load], since)
        c.pump(0.3)
        alerts = [m.fields.get("Text", "") for m in c.inbox[since:] if m.id == 16000]
        self.check(f"{wrong}: 14000 status 2", status.get("Status") == 2, status)
        self.check(f"{wrong}: Waypoint Request names {number}", status.get("Waypoint Request") == number, status)
        self.check(f"{wrong}: 16000 says why", any(alerts), alerts)
        self.check(f"{wrong}: 17000 type 3 for the 13000", c.acknowledgements(load, since)[-1:] == [dli.REFUSED],
                   c.acknowledgements(load, since))
        c.send(13001, {"Initial Waypoint Number": 0, "Route ID": route.name, "Route Type": 2})

    def upload(self):
        c, since = self.cucs, self.cucs.mark()
        self.route = survey(self.start[3] == WGS84)
        points = [p.message(c, self.start, ack=True) for p in self.route.points]
        definition = self.route.definition(c)
        datagrams = c.transmit(points[0], points[1]) + c.transmit(definition, *points[2:])
        self.check("several messages share a datagram", len(datagrams) == 2, [len(d) for d in datagrams])
        c.wait_for_ends(points, since)
        for point in points:
            kinds = c.acknowledgements(point, since)
            self.check(f"13002 number {point['fields']['Waypoint Number']} is acknowledged and stored",
                       kinds and kinds[-1] == dli.CARRIED_OUT and dli.REFUSED not in kinds, kinds)
        load = self.route.load(c, ROUTE_MISSION)
        c.transmit(load)
        done = c.wait(lambda m: m.id == 14000 and m.fields.get("Status") in (1, 2), self.s(20), since, "the end of the upload")
        f = done.fields
        self.check("14000 says complete", f.get("Status") == 1, f)
        if f.get("Status") != 1:
            raise Failure("the route was not taken: " + "; ".join(m.fields.get("Text", "") for m in c.inbox[since:] if m.id == 16000))
        self.check("14000 echoes the mission id and the plan mode",
                   (f.get("Mission ID"), f.get("Mission Plan Mode")) == (ROUTE_MISSION, 2), f)
        self.check("14000's percentage ends at 100", f.get("Percent Complete") == 100, f)
        c.wait_for_ends([load], since)
        kinds = c.acknowledgements(load, since)
        self.check("13000: 17000 type 1, then 2", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        self.download()

    def download(self):
        c, since = self.cucs, self.cucs.mark()
        c.send(13000, {"Mission ID": ROUTE_MISSION, "Mission Plan Mode": 3, "Waypoint Number": 0}, ack=True)
        c.wait(lambda m: m.id == 14000 and m.fields.get("Status") in (1, 2), self.s(20), since, "the end of the download")
        c.pump(0.3)
        back = {m.fields["Waypoint Number"]: m.fields for m in c.inbox[since:] if m.id == 13002}
        for point in self.route.points:
            got = back.get(point.number, {})
            sent = point.message(c, self.start, ack=False)["fields"]
            names = ("Waypoint to Latitude or Relative Y", "Waypoint to Longitude or Relative X", "Waypoint to Altitude",
                     "Waypoint Altitude Type", "Next Waypoint")
            self.check(f"the download gives waypoint {point.number} as it was sent",
                       all(got.get(n) == sent[n] for n in names), {n: (sent[n], got.get(n)) for n in names})

    def launch(self):
        c, since = self.cucs, self.cucs.mark()
        begun = time.monotonic()
        kinds = []
        self.airborne = True
        # A vehicle may refuse to arm for some seconds after its start.
        while time.monotonic() - begun < self.s(30):
            _, kinds = c.command(2016, {"Select Flight Path Control Mode": dli.LAUNCH, "Altitude Command Type": 1,
                                        "Commanded Altitude": round(LAUNCH_HEIGHT_M / 0.02), "Altitude Type": AGL}, self.s(30))
            if kinds[-1:] != [dli.REFUSED]:
                break
            c.pump(1.0)
        self.check("launch: 17000 type 1, then 2", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        c.wait(lambda m: m.id == 3001 and m.fields.get("Select Flight Path Control Mode") in (dli.LAUNCH, dli.LOITER),
               self.s(20), since, "3001 = 21 or 12")
        self.wait_height(LAUNCH_HEIGHT_M, 2.0, since)
        m = c.wait(lambda m: m.id == 3002 and "UA State" in m.fields, 3, what="3002 with the UA State")
        self.say(f"in the air at {self.height():.1f} m, mode {c.mode()}, UA State {m.fields['UA State']}")
        self.check("3002's UA State in the air is not one of the ground", m.fields["UA State"] not in (1, 2, 3, 4), m.fields)

    def fly(self):
        self.flying_since = self.cucs.mark()
        self.check_mode(dli.WAYPOINT, "fly")
        first = self.route.first
        m = self.cucs.wait(lambda m: m.id == 4001 and m.fields.get("To Waypoint Number", 0) in (first, self.route.flown()[1].number),
                           self.s(10), what="4001 towards the route")
        self.say(f"4001: from {m.fields.get('From Waypoint Number')} to {m.fields.get('To Waypoint Number')}, "
                 f"next {m.fields.get('Next Waypoint Number')}")

    def faster(self):
        second = self.route.flown()[1].number
        self.cucs.wait(lambda m: m.id == 4001 and m.fields.get("To Waypoint Number") == second, self.s(60),
                       self.flying_since, f"4001 towards waypoint {second}")
        self.check_mode(dli.WAYPOINT, "faster", {"Commanded Speed": round(FASTER_MS / 0.5), "Speed Type": 2})
        m = self.cucs.wait(lambda m: m.id == 4000 and abs(dli.ground_speed(m) - FASTER_MS) < 0.8, self.s(30),
                           what=f"a ground speed of {FASTER_MS:g} m/s")
        self.say(f"{dli.ground_speed(m):.1f} m/s over the ground")

    def loiter_higher(self):
        since = self.cucs.mark()
        self.loiter_command = self.check_mode(dli.LOITER, "loiter", {
            "Altitude Command Type": 1, "Commanded Altitude": round(LOITER_HEIGHT_M / 0.02), "Altitude Type": AGL})
        self.wait_height(LOITER_HEIGHT_M, 2.0, since)
        self.check_stays("3001 stays 12", lambda mode: mode == dli.LOITER, 1.0)
        self.check_rates("in the air")

    def fly_on(self):
        third = self.route.flown()[2].number
        since = self.cucs.mark()
        self.check_mode(dli.WAYPOINT, f"fly on from {third}", {"Commanded Waypoint Number": third})
        m = self.cucs.wait(lambda m: m.id == 4001 and m.fields.get("To Waypoint Number") == third, self.s(10), since,
                           f"4001 towards waypoint {third}")
        self.say(f"4001: to {m.fields['To Waypoint Number']}")

    def repeat_an_old_command(self):
        c, since = self.cucs, self.cucs.mark()
        c.transmit(self.loiter_command)
        self.check_stays("a repeated datagram is not carried out again", lambda mode: mode == dli.WAYPOINT, 1.5)
        kinds = c.acknowledgements(self.loiter_command, since)
        self.check("a repeated datagram is acknowledged again", bool(kinds), kinds)

    def refuse_in_flight(self):
        wrong, number, route = faulty(300)[0]
        self.check_route_refused(f"{wrong}, sent in flight", number, route)
        self.check_stays("the flight continues after a refused route", lambda mode: mode == dli.WAYPOINT, 0.5)

    def finish(self):
        last = self.route.flown()[-1]
        goal = last.place(self.start)
        c = self.cucs
        c.wait(lambda m: m.id == 4000 and "Latitude" in m.fields and distance(dli.place(m), goal) < 6.0, self.s(150),
               what=f"arrival at waypoint {last.number}")
        track = [dli.place(m) for m in c.inbox[self.flying_since:] if m.id == 4000 and "Latitude" in m.fields]
        # The second was given up for the third on the way to it.
        for point in [p for i, p in enumerate(self.route.flown()) if i != 1]:
            off = closest(track, point.place(self.start))
            self.check(f"waypoint {point.number} is passed", off < self.options.near, f"{off:.1f} m")
        flown = [p.number for p in self.route.flown()]
        seen = [m.fields.get("To Waypoint Number", 0) for m in c.inbox[self.flying_since:] if m.id == 4001]
        seen = [n for i, n in enumerate(seen) if i == 0 or seen[i - 1] != n]
        self.check("4001 knows only the numbers of the route", set(seen) <= {0, 65535, *flown}, seen)
        order = [n for n in seen if n in flown]
        self.check("4001 names each waypoint on the way", set(order) == set(flown), seen)
        self.check("4001 follows the chain", all(flown.index(b) - flown.index(a) in (0, 1) for a, b in zip(order, order[1:])), seen)
        passed = [m for m in c.inbox[self.flying_since:] if m.id == 4001 and m.fields.get("To Waypoint Number") in flown]
        wrong = [m.fields for m in passed if m.fields.get("To Waypoint - Latitude") is not None and distance(
            (dli.bam_to_rad(m.fields["To Waypoint - Latitude"], 32), dli.bam_to_rad(m.fields["To Waypoint - Longitude"], 32)),
            next(p for p in self.route.points if p.number == m.fields["To Waypoint Number"]).place(self.start)) > 1.0]
        self.check("4001's To Waypoint is where it was put", not wrong, wrong[:1])

    def land(self):
        c = self.cucs
        since = c.mark()
        self.check_mode(dli.AUTOLAND, "land")
        c.wait(lambda m: m.id == 4000 and "Altitude" in m.fields and abs(m.fields["Altitude"] * 0.02 - self.start[2]) < 1.5
               and dli.ground_speed(m) < 0.3 and abs(m.fields.get("W_Speed", 0)) * 0.05 < 0.3, self.s(120), since, "the touch-down")
        m = c.wait(lambda m: m.id == 3002 and m.fields.get("UA State") in (1, 2, 3), self.s(20), since,
                   "3002 with the UA State of an aircraft on the ground")
        self.airborne = False
        self.say(f"landed {distance(c.position(), self.start):.0f} m from the start, UA State {m.fields['UA State']}")

    def release(self):
        c = self.cucs
        f = c.authority(0xD, dli.RELEASE, 5).fields
        self.check("#2 confirms the release", f.get("LOI Granted") == 0 and f.get("Access Granted") == 0, f)
        c.pump(0.3)
        since = c.mark()
        c.pump(1.5)
        pushed = Counter(m.id for m in c.inbox[since:] if m.id in (3001, 3002, 4000, 4001))
        self.check("nothing is pushed after the release", not pushed, dict(pushed))
        self.check_refused("a launch after the release")

    def whole(self):
        c = self.cucs
        self.check("everything received can be decoded, and encodes to the same bytes", not c.unreadable, c.unreadable[:3])
        stamps = {}
        for m in c.inbox:
            # A measurement is older than an answer of now: stamps rise in each message type.
            stamps.setdefault((m.value["source"], m.id), []).append((m.fields.get("Time Stamp"), m.id))
        falls = [(a, b) for s in stamps.values() for a, b in zip(s, s[1:]) if a[0] is None or b[0] is None or b[0] <= a[0]]
        self.check("stamps rise strictly", not falls, falls[:3])
        now = (time.time() - dli.EPOCH_2000_S) * 1000
        late = [s[-1][0] for s in stamps.values() if s[-1][0] is not None and abs(now - s[-1][0]) > 600_000]
        self.check("stamps are of today", not late, late)
        others = [m.value for m in c.inbox if m.value["destination"] not in (c.id, 0xFFFFFFFF) or m.value["idd"] not in (30, 32)]
        # It speaks both in turn, and is answered as it spoke last.
        self.check("all is addressed to this CUCS, in edition 3 or 4", not others, others[:1])
        sources = {m.value["source"] for m in c.inbox}
        self.check("all comes from the vehicle", sources <= {c.vehicle}, [dli.text(s) for s in sources])
        addresses = {m.address for m in c.inbox}
        self.check("all comes from the address that was written to", addresses <= {self.options.vsm}, sorted(addresses))
        self.stranger.pump(0.2)
        heard = [m.value for m in self.stranger.inbox] + self.stranger.unreadable
        self.check("a stranger gets nothing", not heard, heard[:1])

    # What several steps need

    def check_refused(self, what):
        value, kinds = self.cucs.command(2016, {"Select Flight Path Control Mode": dli.LAUNCH, "Altitude Command Type": 1,
                                                "Commanded Altitude": 1500, "Altitude Type": AGL}, 3)
        self.check(f"{what} is refused by 17000 type 3", kinds[-1:] == [dli.REFUSED] and dli.CARRIED_OUT not in kinds, kinds)

    def check_mode(self, mode, name, fields=None):
        since = self.cucs.mark()
        value, kinds = self.cucs.command(2016, {"Select Flight Path Control Mode": mode, **(fields or {})}, self.s(20))
        self.check(f"{name}: 17000 type 1, then 2", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        self.cucs.wait(lambda m: m.id == 3001 and m.fields.get("Select Flight Path Control Mode") == mode, self.s(10), since,
                       f"3001 = {mode}")
        self.say(f"mode {mode}, {self.height():.1f} m up")
        return value

    def check_rates(self, where):
        c, since, window = self.cucs, self.cucs.mark(), 4.0
        begun = time.monotonic()
        c.pump(window)
        for id in (3001, 3002, 4000, 4001):
            times = [begun] + [m.at for m in c.inbox[since:] if m.id == id] + [begun + window]
            gap, rate = max(b - a for a, b in zip(times, times[1:])), (len(times) - 2) / window
            self.check(f"{id} comes at 2 Hz or faster {where}", rate >= 1.75 and gap < 0.9, f"{rate:.1f} Hz, longest gap {gap:.2f} s")

    def check_stays(self, what, allowed, seconds):
        since = self.cucs.mark()
        self.cucs.pump(seconds)
        modes = [m.fields.get("Select Flight Path Control Mode") for m in self.cucs.inbox[since:] if m.id == 3001]
        self.check(what, modes and all(allowed(m) for m in modes), modes)

    def wait_height(self, height, within, since):
        self.cucs.wait(lambda m: m.id == 4000 and "Altitude" in m.fields
                       and abs(m.fields["Altitude"] * 0.02 - self.start[2] - height) < within,
                       self.s(60), since, f"{height:g} m above the start")

    def height(self):
        return self.cucs.position()[2] - self.start[2]

    def say(self, line):
        self.checks.say(line)

    def check(self, what, held, found=""):
        self.checks.check(what, held, found)

    def report(self):
        """What a machine wants to know of the flight."""
        track = [(m.at, *dli.place(m)) for m in self.cucs.inbox if m.id == 4000 and "Latitude" in m.fields]
        return {"ok": self.checks.passed(), "checks": self.checks.results,
                "sent": {str(k): n for k, n in sorted(self.cucs.sent.items())},
                "received": {str(k): n for k, n in sorted(Counter(m.id for m in self.cucs.inbox).items())},
                "alerts": [m.fields.get("Text") for m in self.cucs.inbox if m.id == 16000],
                "track": [[round(t - track[0][0], 2), *(round(v, 2) for v in metres(self.start, (la, lo))), round(al - self.start[2], 2)]
                          for t, la, lo, al, _ in track] if self.start else []}


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vsm", required=True, type=address, metavar="HOST:PORT")
    parser.add_argument("--id", type=identity, default="1b:00:00:a0", help="our id, four bytes in hex")
    parser.add_argument("--bind", default="0.0.0.0", help="our address")
    parser.add_argument("--home", type=position, metavar="LAT,LON,ALT", help="where the vehicle stands, if that is known")
    parser.add_argument("--slow", type=float, default=1.0, metavar="FACTOR", help="more time for each step; 10 for a real aircraft")
    parser.add_argument("--near", type=float, default=15.0, metavar="M", help="how near a waypoint must be passed")
    parser.add_argument("--report", metavar="FILE", help="write a report in JSON; - is standard output")
    return parser.parse_args()


def main():
    options = arguments()
    flight = Flight(options)
    held = flight.run()
    report = json.dumps(flight.report(), default=str)
    if options.report == "-":
        print(report)
    elif options.report:
        with open(options.report, "w", encoding="utf-8") as file:
            file.write(report + "\n")
    flight.checks.close()
    return 0 if held else 1


def address(text):
    host, _, port = text.rpartition(":")
    return host, int(port)


def identity(text):
    return int.from_bytes(bytes.fromhex(text.replace(":", "")).rjust(4, b"\0")[-4:], "big")


def position(text):
    latitude, longitude, altitude = map(float, text.split(","))
    return latitude, longitude, altitude


if __name__ == "__main__":
    sys.exit(main())
