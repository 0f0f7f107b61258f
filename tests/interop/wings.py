#!/usr/bin/env python3
"""Flies a fixed wing or a VTOL through a VSM as a CUCS would, from launch to landing.

    wings.py --vsm 127.0.0.1:4586 --airframe plane|vtol [--fast 10] [--report FILE]

Has routes refused that a wing cannot fly or land from, uploads an approach and a route of ten waypoints, launches, flies,
steers by course, loiters, changes speed and altitude, flies to the end, lands, and goes around once (fixed wing). It needs
an aircraft on the ground, disarmed, with 1000 m free around it; `--fast` is how much faster than time the vehicle is.
Ends with 0 where every check held, else with 1. THE AIRCRAFT WILL ARM AND FLY.
"""
import argparse
import json
import math
import sys
import time

import cucs as dli
from checks import Checks
from cucs import Cucs, Failure
from fly import address, identity
from route import AGL, Point, Route, closest, distance, metres

FLIGHT, APPROACH, CONTINGENCY_A = 2, 1, 3
STEERED, WAVE_OFF, FLY_CONTINGENCY_A = 15, 20, 23
COURSE_COMMAND, HEADING_COMMAND = 2, 1
INDICATED = 0
HOVER, CIRCLE, RACETRACK, FIGURE_EIGHT = 4, 1, 2, 3
# MPC_XY_VEL_MAX of the VTOL is 8.
HOVER_SPEED = 5.0


def survey(speed, up, leg, hovered):
    """Ten waypoints in legs that a wing can turn between; two end in a climb or a descent, one is hovered to by a VTOL."""
    places = [(1, 0, 0), (2, 0, 0), (2, 1, 15), (1, 1, 15), (0, 1, 15),
              (-1, 1, 0), (-1, 0, 0), (-1, -1, 0), (0, -1, 0), (1, -1, 0)]
    points = [Point(n + 1, n + 2 if n < 9 else 0, leg * north, leg * east, up + climb, HOVER_SPEED if n + 1 == hovered else speed)
              for n, (north, east, climb) in enumerate(places)]
    return Route("WINGS", 1, tuple(points))


def approach(base, entry_m, entry_up):
    """From the west to the start."""
    return Route("LANDING", base, (Point(base, base + 1, 0, -entry_m, entry_up, 0.0),
                                   Point(base + 1, 0, 0, 0, 2.0, 0.0)))


class Flight:
    """The steps in their order; each leaves its verdicts in `checks`."""

    def __init__(self, options):
        self.options, self.checks = options, Checks()
        self.plane = options.airframe == "plane"
        self.speed = 15.0 if self.plane else 10.0
        self.cucs = Cucs(options.vsm, options.id, bind=(options.bind, 0))
        self.airborne, self.start = False, None
        self.hovered = None if self.plane else 6
        self.route = survey(self.speed, 60.0, options.leg, self.hovered)
        leg = options.leg
        self.contingency = Route("LOST", 41, (Point(41, 42, leg, -leg / 2, 70.0, self.speed),
                                              Point(42, 0, 1.5 * leg, leg / 2, 70.0, self.speed)))
        # From waypoint 8 to 9, out to the west.
        self.bends = [(-leg, -leg), (-0.9 * leg, -1.3 * leg), (-0.3 * leg, -1.3 * leg), (0.0, -leg)]
        # At 5 degrees of glide at most.
        self.entry_m = 900.0 if self.plane else 250.0
        self.entry_up = 60.0 if self.plane else 45.0
        self.begun = time.monotonic()

    def run(self):
        try:
            for step in (self.discover, self.refuse_without_landing, self.refuse_what_wings_cannot, self.upload,
                         self.refuse_on_the_ground, self.launch, self.fly, self.steer, self.loiter,
                         *([self.figure_eight] if self.plane else []), self.refuse_in_flight, self.fly_contingency,
                         self.finish, *([self.go_around] if self.plane else [self.hover, self.fly_on]), self.land):
                self.checks.step(step.__name__.replace("_", " "))
                step()
        except Failure as failure:
            self.check(str(failure), False)
        finally:
            self.checks.step("in all that was received")
            c = self.cucs
            self.check("everything received can be decoded, and encodes to the same bytes", not c.unreadable, c.unreadable[:3])
            known = {0, 65535, *(p.number for p in (*self.route.points, *self.contingency.points))}
            seen = {m.fields.get("To Waypoint Number", 0) for m in c.inbox if m.id == 4001}
            self.check("4001 knows only the numbers of the route", seen <= known, sorted(seen))
            if self.checks.passed() is False:
                for m in c.inbox:
                    if m.id == 16000:
                        self.say(f"{m.at - self.begun:7.1f} s 16000: {m.fields.get('Text')}")
            c.close()
        return self.checks.passed()

    def s(self, seconds):
        """Wall time for so many seconds of the vehicle, and some for the rest."""
        return 2.0 * seconds / self.options.fast + 15.0

    def discover(self):
        c = self.cucs
        c.discover(10)
        f = c.authority(0xC | dli.LOI_2, dli.REQUEST, 5).fields
        self.check("#2 grants LOI 2, 4 and 5", f.get("LOI Granted") == 0xD, f)
        c.wait(lambda m: m.id == 4000 and "Altitude" in m.fields and "Latitude" in m.fields, 60, 0, "a position")
        c.pump(2.0)
        self.start = c.position()

    def store(self, route, kind):
        c, since = self.cucs, self.cucs.mark()
        definition = c.make(13001, {"Initial Waypoint Number": route.first, "Route ID": route.name, "Route Type": kind})
        points = [p.message(c, self.start, ack=True) for p in route.points]
        for point, p in zip(points, route.points):
            if p.speed == 0.0:
                del point["fields"]["Waypoint to Speed"], point["fields"]["Waypoint Speed Type"]
        c.transmit(definition, *points)
        c.wait_for_ends(points, since)
        return all(c.acknowledgements(p, since)[-1:] == [dli.CARRIED_OUT] for p in points)

    def load(self, route):
        """Status of the 14000 that ends the load, the waypoint that it names, and what 16000 says."""
        c, since = self.cucs, self.cucs.mark()
        c.transmit(route.load(c, "WINGS"))
        f = c.wait(lambda m: m.id == 14000 and m.fields.get("Status") in (1, 2), self.s(60), since, "the end of the upload").fields
        c.pump(0.4)
        parts = [m.fields.get("Text", "") for m in c.inbox[since:] if m.id == 16000]
        return f.get("Status"), f.get("Waypoint Request"), " ".join(" ".join(parts).split())

    def refused(self, what, route, number, words):
        status, waypoint, text = self.load(route)
        self.check(f"{what}: refused", status == 2, (status, text))
        self.check(f"{what}: names waypoint {number}", waypoint == number, waypoint)
        self.check(f"{what}: says why", all(word in text for word in words), text)

    def clear(self):
        c, since = self.cucs, self.cucs.mark()
        c.send(13000, {"Mission ID": "WINGS", "Mission Plan Mode": 1, "Waypoint Number": 0}, ack=True)
        c.wait(lambda m: m.id == 14000 and m.fields.get("Status") in (1, 2), self.s(30), since, "the end of the clearing")

    def refuse_without_landing(self):
        # On wings throughout: its transitions are sent in `upload`.
        self.winged = survey(self.speed, 60.0, self.options.leg, None)
        self.check("the route is stored", self.store(self.winged, FLIGHT))
        self.refused("a route without a landing", self.winged, 1, ["MIS_TKO_LAND_REQ", "13001"])

    def refuse_what_wings_cannot(self):
        steep = Route("STEEP", 201, (Point(201, 202, 300, 0, 60, self.speed), Point(202, 0, 450, 0, 260, self.speed)))
        self.store(steep, FLIGHT)
        self.refused("a leg too steep", steep, 202, ["altitude changes by 200 m"])
        tight = Route("TIGHT", 211, (Point(211, 212, 300, 0, 60, self.speed), Point(212, 213, 600, 0, 60, self.speed),
                                     Point(213, 0, 595, 20 if self.plane else 9, 60, self.speed)))
        self.store(tight, FLIGHT)
        if self.plane:
            self.refused("a turn too tight", tight, 213, ["turn circle"])
            self.store(approach(221, 250, 60), APPROACH)
            self.store(self.winged, FLIGHT)
            self.refused("a glide too steep", self.winged, 221, ["FW_LND_ANG"])
        else:
            self.store(approach(221, 250, 12), APPROACH)
            self.store(self.winged, FLIGHT)
            self.refused("a transition too low", self.winged, 221, ["transition"])
            self.store(approach(221, 250, 45), APPROACH)
            self.store(self.route, FLIGHT)
            self.refused("a leg too slow for wings", self.route, self.hovered, ["speed 5.0 m/s"])
        self.clear()

    def upload(self):
        landing = approach(31, self.entry_m, self.entry_up)
        self.store(landing, APPROACH)
        self.check("the contingency route is stored", self.store(self.contingency, CONTINGENCY_A))
        self.check("the route is stored", self.store(self.route, FLIGHT))
        c = self.cucs
        if self.hovered:
            for at, tag in ((self.hovered - 1, "TRANSITION HOVER"), (self.hovered, "TRANSITION WINGS")):
                _, kinds = c.command(13006, {"Waypoint Number": at, "Tag Type": 0, "Tag/Data": tag}, 5)
                self.check(f"a transition at waypoint {at} is stored", kinds[-1:] == [dli.CARRIED_OUT], kinds)
        p2, p3 = (Point(0, 0, *bend, 0.0).place(self.start) for bend in self.bends[1:3])
        _, kinds = c.command(50002, {"P1 Waypoint No": 8, "P4 Waypoint No": 9,
                                     "P2 Latitude": dli.rad_to_bam(p2[0], 32), "P2 Longitude": dli.rad_to_bam(p2[1], 32),
                                     "P3 Latitude": dli.rad_to_bam(p3[0], 32), "P3 Longitude": dli.rad_to_bam(p3[1], 32)}, 5)
        self.check("a curve from waypoint 8 to 9 is stored", kinds[-1:] == [dli.CARRIED_OUT], kinds)
        loiter = c.make(13003, {"Waypoint Number": 4, "Waypoint Loiter Type": CIRCLE, "Loiter Radius": round(60 / 1.5),
                                "Loiter Duration": 12, "Loiter Duration Units": 0, "Loiter Direction": 1}, ack=True)
        c.transmit(loiter)
        c.pump(0.3)
        status, _, text = self.load(self.route)
        self.check("14000 says complete", status == 1, text)
        if status != 1:
            raise Failure(f"the route was not taken: {text}")
        since = c.mark()
        c.send(13000, {"Mission ID": "WINGS", "Mission Plan Mode": 3, "Waypoint Number": 0}, ack=True)
        c.wait(lambda m: m.id == 14000 and m.fields.get("Status") in (1, 2), self.s(60), since, "the end of the download")
        c.pump(0.3)
        back = [m.fields["Waypoint Number"] for m in c.inbox[since:] if m.id == 13002]
        self.check("the download gives what was sent, and nothing of ours",
                   sorted(back) == [p.number for p in (*self.route.points, *landing.points, *self.contingency.points)], back)
        others = [m.id for m in c.inbox[since:] if m.id in (13006, 50002)]
        self.check("and its transitions and its curve", sorted(others) == [13006] * (2 if self.hovered else 0) + [50002], others)

    def refuse_on_the_ground(self):
        _, kinds = self.cucs.command(2016, {"Select Flight Path Control Mode": dli.WAYPOINT}, 10)
        self.check("mode 11 on the ground is refused", kinds[-1:] == [dli.REFUSED], kinds)

    def launch(self):
        c, since, kinds = self.cucs, self.cucs.mark(), []
        self.airborne = True
        begun = time.monotonic()
        while time.monotonic() - begun < self.s(60):
            kinds = self.mode(dli.LAUNCH, altitude=60.0 if self.plane else 40.0, within=self.s(90))
            if kinds[-1:] != [dli.REFUSED]:
                break
            c.pump(1.0)
        self.check("launch: 17000 type 1, then 2", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        # Before the take-off it was in its loiter, too.
        c.wait(lambda m: m.id == 4000 and dli.ground_speed(m) > 4.0 and c.mode() == dli.LOITER, self.s(240), since,
               "3001 = 12 after the climb")
        self.say(f"{self.height():.0f} m up, {self.ground_speed():.1f} m/s over ground")
        self.check("it flies, and does not stand", self.ground_speed() > 4.0, self.ground_speed())

    def fly(self):
        self.flying_since = self.cucs.mark()
        kinds = self.mode(dli.WAYPOINT)
        self.check("fly: 17000 type 1, then 2", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        self.towards(2, 150)

    def steer(self):
        c, east = self.cucs, dli.rad_to_bam(math.pi / 2, 16)
        kinds = self.mode(STEERED, {"Heading Command Type": HEADING_COMMAND, "Commanded Heading": east, "Heading Reference": 0})
        self.check("a heading is refused: PX4 keeps a course", kinds[-1:] == [dli.REFUSED], kinds)
        since, faster = c.mark(), self.speed + (2.0 if self.plane else 1.0)
        kinds = self.mode(STEERED, {"Heading Command Type": COURSE_COMMAND, "Commanded Course": east, "Heading Reference": 0,
                                    "Commanded Speed": round(faster / 0.5), "Speed Type": INDICATED}, altitude=80.0)
        self.check("steer: 17000 type 1, then 2", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        self.check("3001 = 15", c.mode() == STEERED, c.mode())
        self.check("it flies the course", abs(self.course() - 90.0) < 12.0, f"{self.course():.0f} deg")
        m = c.latest(3002, "Commanded Speed")
        self.check("3002 reports the speed as an air speed", m and m.fields.get("Speed Type") == INDICATED and
                   abs(m.fields["Commanded Speed"] * 0.5 - faster) < 0.3, m and m.fields)
        self.wait_height(80.0, 6.0, since, 90)
        kinds = self.mode(STEERED, {"Heading Command Type": COURSE_COMMAND, "Heading Reference": 0,
                                    "Commanded Course": dli.rad_to_bam(-math.pi / 2, 16)})
        self.check("steer back: 17000 type 1, then 2", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        self.check("it flies back", abs(self.course() - 270.0) < 12.0, f"{self.course():.0f} deg")

    def loiter(self):
        c, since = self.cucs, self.cucs.mark()
        c.command(2017, {"Loiter Type": CIRCLE, "Loiter Radius": round(100 / 1.5), "Loiter Direction": 2}, 5)
        kinds = self.mode(dli.LOITER)
        self.check("loiter: 17000 type 1, then 2", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        c.pump(40 / self.options.fast)
        turns = self.turns(since)
        self.check("it circles counter-clockwise", turns < -0.2, f"{turns:.2f} turns")
        since = c.mark()
        kinds = self.mode(0, altitude=70.0)
        self.check("another altitude in the loiter: 17000 type 1, then 2", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        self.wait_height(70.0, 6.0, since, 90)

    def figure_eight(self):
        c = self.cucs
        c.command(2017, {"Loiter Type": FIGURE_EIGHT, "Loiter Radius": round(60 / 1.5), "Loiter Length": round(300 / 1.5),
                         "Loiter Direction": 1}, 5)
        kinds = self.mode(dli.LOITER)
        self.check("figure eight: 17000 type 1, then 2", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        c.pump(20 / self.options.fast)
        since = c.mark()
        c.pump(90 / self.options.fast)
        left, right = self.bent(since)
        self.check("it turns to the left and to the right", left > 0.4 and right > 0.4, f"{left:.2f} and {right:.2f} turns")

    def fly_contingency(self):
        c, since = self.cucs, self.cucs.mark()
        kinds = self.mode(FLY_CONTINGENCY_A, within=self.s(120))
        self.check("contingency A: 17000 type 1, then 2", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        c.wait(lambda m: m.id == 4001 and m.fields.get("From Waypoint Number") == 42, self.s(240), since,
               "the end of the contingency route")
        track = [dli.place(m) for m in c.inbox[since:] if m.id == 4000 and "Latitude" in m.fields]
        for point in self.contingency.points:
            off = min(distance(at, point.place(self.start)) for at in track)
            self.check(f"waypoint {point.number} is passed", off < 45.0, f"{off:.0f} m")

    def refuse_in_flight(self):
        c = self.cucs
        if self.plane:
            _, kinds = c.command(2017, {"Loiter Type": HOVER}, 5)
            self.check("a hover of a fixed wing is refused", kinds[-1:] == [dli.REFUSED], kinds)
        _, kinds = c.command(2017, {"Loiter Type": RACETRACK}, 5)
        self.check("a racetrack is refused", kinds[-1:] == [dli.REFUSED], kinds)
        _, kinds = c.command(2017, {"Loiter Type": CIRCLE, "Loiter Radius": round(8 / 1.5)}, 5)
        kinds = self.mode(dli.LOITER) if kinds[-1:] != [dli.REFUSED] and self.plane else [dli.REFUSED]
        self.check("a circle too tight for wings is refused", kinds[-1:] == [dli.REFUSED], kinds)
        kinds = self.mode(WAVE_OFF)
        self.check("a go-around without a landing is refused", kinds[-1:] == [dli.REFUSED], kinds)

    def finish(self):
        c = self.cucs
        since = c.mark()
        kinds = self.mode(dli.WAYPOINT, {"Commanded Waypoint Number": 3})
        self.check("fly on: 17000 type 1, then 2", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        c.wait(lambda m: m.id == 4001 and m.fields.get("From Waypoint Number") == 10, self.s(500), since, "the end of the route")
        seen = [m.fields.get("To Waypoint Number", 0) for m in c.inbox[since:] if m.id == 4001]
        order = [n for i, n in enumerate(seen) if n and (i == 0 or seen[i - 1] != n)]
        # The contingency route has taken its place aboard: uploaded again, the route stands at its start for a moment.
        order = order[1:] if order[:1] == [1] else order
        self.check("4001 names each waypoint on the way", order in (list(range(3, 11)), list(range(4, 11))), order)
        track = [dli.place(m) for m in c.inbox[since:] if m.id == 4000 and "Latitude" in m.fields]
        for point in self.route.flown()[2:]:
            off = min(distance(at, point.place(self.start)) for at in track)
            near = 110.0 if point.number == 4 else 45.0
            self.check(f"waypoint {point.number} is passed", off < near, f"{off:.0f} m")
        middle = [(a + 3 * b + 3 * c + d) / 8 for a, b, c, d in zip(*self.bends)]
        off = closest(track, Point(0, 0, *middle, 0.0).place(self.start))
        self.check("the curve is flown: its middle is passed", off < 15.0, f"{off:.1f} m")
        if self.hovered:
            states = [m.fields.get("UA State") for m in c.inbox[since:] if m.id == 3002]
            turns = [s for i, s in enumerate(states) if s in (14, 15) and s != states[i - 1]]
            # A real one brakes to a hover within a second: the state between is not sent each time. At 20 times no state is.
            if self.options.fast <= 4:
                self.check("3002 reports the transitions", turns in ([15, 14], [14]), turns)
            leg = [m for m in c.inbox[since:] if m.id in (4000, 4001)]
            last = max(i for i, m in enumerate(leg) if m.id == 4001 and m.fields.get("To Waypoint Number") == self.hovered)
            # Up to the transition back, which this leg ends in.
            speeds = [dli.ground_speed(m) for m in leg[last - 16:last] if m.id == 4000 and "U_Speed" in m.fields]
            self.check(f"it hovers to waypoint {self.hovered}", speeds and min(speeds) < 5.5, speeds)
        c.pump(20 / self.options.fast)
        self.check("it stays at the end of its route, in the air", c.mode() == dli.WAYPOINT and self.height() > 40.0,
                   (c.mode(), self.height()))

    def go_around(self):
        c, since = self.cucs, self.cucs.mark()
        kinds = self.mode(dli.AUTOLAND)
        self.check("land: 17000 type 1, then 2", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        c.wait(lambda m: m.id == 4000 and "Altitude" in m.fields and m.fields["Altitude"] * 0.02 - self.start[2] < 45.0,
               self.s(240), since, "the glide")
        kinds = self.mode(WAVE_OFF)
        self.check("go around: 17000 type 1, then 2", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        self.check("3001 = 12", c.mode() == dli.LOITER, c.mode())
        c.pump(10 / self.options.fast)
        self.check("it no longer sinks", self.height() > 24.0, self.height())

    def hover(self):
        c = self.cucs
        c.command(2017, {"Loiter Type": HOVER}, 5)
        kinds = self.mode(dli.LOITER, within=self.s(90))
        self.check("a VTOL turns to a hover: 17000 type 1, then 2", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        since = c.mark()
        c.wait(lambda m: m.id == 4000 and dli.ground_speed(m) < 1.0, self.s(90), since, "a hover")

    def fly_on(self):
        c = self.cucs
        c.command(2017, {"Loiter Type": CIRCLE, "Loiter Radius": round(80 / 1.5), "Loiter Direction": 1}, 5)
        kinds = self.mode(dli.LOITER, within=self.s(90))
        self.check("and back to its wings: 17000 type 1, then 2", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        self.check("it flies", self.ground_speed() > 4.0, self.ground_speed())

    def land(self):
        c, since = self.cucs, self.cucs.mark()
        kinds = self.mode(dli.AUTOLAND)
        self.check("land: 17000 type 1, then 2", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        c.wait(lambda m: m.id == 3002 and m.fields.get("UA State") in (1, 2, 3), self.s(420), since,
               "3002 with the UA State of an aircraft on the ground")
        self.airborne = False
        off = distance(c.position(), self.start)
        self.check("it has landed where the approach ends", off < (250.0 if self.plane else 25.0), f"{off:.0f} m")
        self.say(f"landed {off:.0f} m from the start, {time.monotonic() - self.begun:.0f} s after the discovery")

    # What several steps need

    def mode(self, mode, fields=None, altitude=None, within=None):
        """Commands it, and gives the types of its 17000s."""
        fields = {"Select Flight Path Control Mode": mode, **(fields or {})}
        if altitude is not None:
            fields |= {"Altitude Command Type": 1, "Commanded Altitude": round(altitude / 0.02), "Altitude Type": AGL}
        since = self.cucs.mark()
        _, kinds = self.cucs.command(2016, fields, within or self.s(75))
        if kinds[-1:] == [dli.REFUSED]:
            self.cucs.pump(0.3)
            self.say("refused: " + " ".join(m.fields.get("Text", "") for m in self.cucs.inbox[since:] if m.id == 16000))
        # 3001 and 4000 come twice a second.
        self.cucs.pump(0.55)
        return kinds

    def towards(self, number, seconds):
        self.cucs.wait(lambda m: m.id == 4001 and m.fields.get("To Waypoint Number") == number, self.s(seconds),
                       self.flying_since, f"4001 towards waypoint {number}")

    def wait_height(self, height, within, since, seconds):
        self.cucs.wait(lambda m: m.id == 4000 and "Altitude" in m.fields
                       and abs(m.fields["Altitude"] * 0.02 - self.start[2] - height) < within,
                       self.s(seconds), since, f"{height:g} m above the start")

    def height(self):
        return self.cucs.position()[2] - self.start[2]

    def ground_speed(self):
        return dli.ground_speed(self.cucs.latest(4000, "U_Speed", "V_Speed"))

    def course(self):
        f = self.cucs.latest(4000, "U_Speed", "V_Speed").fields
        return math.degrees(math.atan2(f["V_Speed"], f["U_Speed"])) % 360.0

    def turns(self, since):
        """How often the course has turned since, clockwise positive."""
        left, right = self.bent(since)
        return right - left

    def bent(self, since):
        """How much the course has turned to the left and to the right since, in turns."""
        courses = [math.atan2(m.fields["V_Speed"], m.fields["U_Speed"]) for m in self.cucs.inbox[since:]
                   if m.id == 4000 and "V_Speed" in m.fields]
        steps = [(b - a + math.pi) % (2 * math.pi) - math.pi for a, b in zip(courses, courses[1:])]
        return (-sum(s for s in steps if s < 0) / (2 * math.pi), sum(s for s in steps if s > 0) / (2 * math.pi))

    def say(self, line):
        self.checks.say(line)

    def check(self, what, held, found=""):
        self.checks.check(what, held, found)

    def report(self):
        track = [(m.at, *dli.place(m)) for m in self.cucs.inbox if m.id == 4000 and "Latitude" in m.fields]
        return {"ok": self.checks.passed(), "checks": self.checks.results,
                "track": [[round(t - track[0][0], 2), *(round(v, 2) for v in metres(self.start, (la, lo))),
                           round(al - self.start[2], 2)] for t, la, lo, al, _ in track] if self.start else []}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vsm", required=True, type=address, metavar="HOST:PORT")
    parser.add_argument("--airframe", required=True, choices=["plane", "vtol"])
    parser.add_argument("--id", type=identity, default="1b:00:00:a0", help="our id, four bytes in hex")
    parser.add_argument("--bind", default="0.0.0.0", help="our address")
    parser.add_argument("--fast", type=float, default=1.0, metavar="FACTOR", help="how much faster than time the vehicle is")
    parser.add_argument("--leg", type=float, default=300.0, metavar="M", help="length of the legs of the route")
    parser.add_argument("--report", metavar="FILE", help="write a report in JSON")
    options = parser.parse_args()
    flight = Flight(options)
    held = flight.run()
    if options.report:
        with open(options.report, "w", encoding="utf-8") as file:
            json.dump(flight.report(), file, default=str)
    flight.checks.close()
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
