#!/usr/bin/env python3
"""Flies curves (50002) through a VSM as a CUCS would, and has them measured against what is predicted.

    curve_flights.py --vsm 127.0.0.1:4586 --airframe plane --speed 15 --speed 20 [--bank 50] [--fast 4] [--out DIR]
                     [--recording DIR --curve-plan PROGRAM]
    curve_flights.py --vsm 127.0.0.1:4586 --airframe quad --speed 5 --speed 10 ...

On wings, for each speed a route of three half circles of 1.2, 2 and 4 times the least radius at that speed and bank, right,
left and right, with straights of 400 m between them; each is measured from 150 m before it to 150 m behind. The vehicle needs
a landing in its configuration (`vehicle.landing`), and stays in the loiter at the end of the last route. A multicopter flies
bends that tighten, an S and a hook, each a route. The wind is the simulator's.
The vehicle stands on the ground, disarmed, with 2000 m free around it; `--fast` is how much faster than time it is. With
`--recording`, the folder of the bridge's recordings, `curve-plan check --flown` measures, and the flown deviation must be
within the predicted one. Ends with 0 where all held, else with 1. THE AIRCRAFT WILL ARM AND FLY.
"""
import argparse
import glob
import json
import math
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import cucs as dli
from checks import Checks
from cucs import Cucs, Failure, rad_to_bam
from fly import address, identity
from route import AGL, EARTH_M, Point

# The arm of a quarter circle, as a part of its radius.
ARM = 0.5522847498
STRAIGHT_M, MEASURED_M = 400.0, 150.0
G = 9.80665
TIMES = (1.2, 2.0, 4.0)


@dataclass(frozen=True)
class Part:
    """A part of a route that is measured: its waypoints, and the curves by the index of their P1."""

    name: str
    places: list
    curves: dict


@dataclass(frozen=True)
class Course:
    """A route in metres north and east of the start."""

    speed: float
    places: list
    curves: dict
    parts: list


def turns(speed, bank):
    """Three half circles, each of two curves."""
    least = speed * speed / (G * math.tan(math.radians(bank)))
    at, north = (300.0, 0.0), 1.0
    places, curves, parts = [at], {}, []
    for times in TIMES:
        radius = times * least
        at = (at[0] + north * STRAIGHT_M, at[1])
        arm = ARM * radius
        middle, end = (at[0] + north * radius, at[1] + radius), (at[0], at[1] + 2 * radius)
        arms = [((at[0] + north * arm, at[1]), (middle[0], middle[1] - arm)),
                ((middle[0], middle[1] + arm), (end[0] + north * arm, end[1]))]
        curves |= {len(places): arms[0], len(places) + 1: arms[1]}
        places += [at, middle, end]
        before, after = ((p[0] - north * MEASURED_M, p[1]) for p in (at, end))
        parts.append(Part(f"{times:g} times the least radius ({radius:.0f} m)", [before, at, middle, end, after],
                          {1: arms[0], 2: arms[1]}))
        # To the east each time: right, left, right.
        at, north = end, -north
    places.append((at[0] + north * STRAIGHT_M, at[1]))
    return Course(speed, places, curves, parts)


def bends(speed):
    """Of a multicopter: the routes of the bridge's own tests that turn the most."""
    def tightening(drawn_out):
        return [[(30, 0), (90, 0), (120, 40), (120, 100)], [(120, 100), (120, 160 + drawn_out), (60, 150), (60, 210)]]

    shapes = {"two bends": tightening(0), "a bend that tightens by 30 m": tightening(30),
              "a bend that tightens by 40 m": tightening(40), "S": [[(20, 0), (120, 90), (60, -90), (200, 0)]],
              "hook": [[(20, 0), (220, 0), (230, 120), (110, 120)]]}
    for name, shape in shapes.items():
        places = [shape[0][0], *(leg[3] for leg in shape)]
        curves = {i: (leg[1], leg[2]) for i, leg in enumerate(shape)}
        yield Course(speed, places, curves, [Part(name, places, curves)])


class Flight:
    """The steps in their order; each leaves its verdicts in `checks`."""

    def __init__(self, options):
        self.options, self.checks = options, Checks()
        self.cucs = Cucs(options.vsm, options.id, bind=(options.bind, 0))
        self.wings = options.airframe != "quad"
        self.up = 80.0 if self.wings else 30.0
        self.start, self.rows = None, []

    def run(self):
        try:
            self.discover()
            for number, course in enumerate(self.courses()):
                self.checks.step(f"{course.speed:g} m/s")
                self.fly(number, course)
        except Failure as failure:
            self.check(str(failure), False)
            for m in self.cucs.inbox:
                if m.id == 16000:
                    self.checks.say(f"16000: {m.fields.get('Text')}")
        finally:
            self.cucs.close()
        return self.checks.passed()

    def courses(self):
        for speed in self.options.speed:
            if self.wings:
                yield turns(speed, self.options.bank)
            else:
                yield from bends(speed)

    def s(self, seconds):
        """Wall time for so many seconds of the vehicle, and some for the rest."""
        return 2.0 * seconds / self.options.fast + 15.0

    def check(self, what, held, found=""):
        self.checks.check(what, held, found)

    def discover(self):
        c = self.cucs
        c.discover(10)
        f = c.authority(0xC | dli.LOI_2, dli.REQUEST, 5).fields
        self.check("#2 grants LOI 2, 4 and 5", f.get("LOI Granted") == 0xD, f)
        c.wait(lambda m: m.id == 4000 and "Altitude" in m.fields and "Latitude" in m.fields, 60, 0, "a position")
        c.pump(2.0)
        self.start = c.position()

    def place(self, at):
        return (self.start[0] + at[0] / EARTH_M, self.start[1] + at[1] / (EARTH_M * math.cos(self.start[0])))

    def fly(self, number, course):
        c, base = self.cucs, 100 * (number + 1)
        self.load(base, course)
        if number == 0:
            self.launch()
        since, recorded = c.mark(), self.recorded()
        _, kinds = c.command(2016, {"Select Flight Path Control Mode": dli.WAYPOINT}, self.s(75))
        self.check("fly: 17000 type 1, then 2", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        last = base + len(course.places) - 1
        c.wait(lambda m: m.id == 4001 and m.fields.get("From Waypoint Number") == last, self.s(400), since, "the end of the route")
        c.pump(10 / self.options.fast)
        log = Path(self.options.out, "flight.tlog")
        if recorded:
            # Not what was flown before, past the same places: a reader finds the next frame by itself.
            log.write_bytes(recorded[0].read_bytes()[recorded[1]:])
        for part in course.parts:
            self.measure(course.speed, part, log)

    def recorded(self):
        """The newest recording, and how long it is by now."""
        logs = sorted(glob.glob(f"{self.options.recording}/*.tlog")) if self.options.recording else []
        return (Path(logs[-1]), Path(logs[-1]).stat().st_size) if logs else None

    def load(self, base, course):
        c, since = self.cucs, self.cucs.mark()
        name = f"TURNS{base}"
        c.transmit(c.make(13001, {"Initial Waypoint Number": base, "Route ID": name, "Route Type": 2}))
        for k, (p2, p3) in course.curves.items():
            (a, b), (d, e) = self.place(p2), self.place(p3)
            c.transmit(c.make(50002, {"P1 Waypoint No": base + k, "P4 Waypoint No": base + k + 1,
                                      "P2 Latitude": rad_to_bam(a, 32), "P2 Longitude": rad_to_bam(b, 32),
                                      "P3 Latitude": rad_to_bam(d, 32), "P3 Longitude": rad_to_bam(e, 32)}))
        for k, (north, east) in enumerate(course.places):
            following = base + k + 1 if k + 1 < len(course.places) else 0
            c.transmit(Point(base + k, following, north, east, self.up, course.speed, AGL).message(c, self.start, ack=True))
            c.pump(0.05)
        c.transmit(c.make(13000, {"Mission ID": "TURNS", "Mission Plan Mode": 2, "Waypoint Number": 0, "Route ID": name}, ack=True))
        f = c.wait(lambda m: m.id == 14000 and m.fields.get("Status") in (1, 2), self.s(60), since, "the end of the upload").fields
        c.pump(0.4)
        said = " ".join(m.fields.get("Text", "") for m in c.inbox[since:] if m.id == 16000)
        self.check("the route of curves is loaded", f.get("Status") == 1, said)
        self.checks.say(said)

    def launch(self):
        c, since = self.cucs, self.cucs.mark()
        kinds, begun = [], time.monotonic()
        while time.monotonic() - begun < self.s(60):
            _, kinds = c.command(2016, {"Select Flight Path Control Mode": dli.LAUNCH, "Altitude Command Type": 1,
                                        "Commanded Altitude": round(self.up / 0.02), "Altitude Type": AGL}, self.s(90))
            if kinds[-1:] != [dli.REFUSED]:
                break
            c.pump(1.0)
        self.check("launch: 17000 type 1, then 2", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        flies = 4.0 if self.wings else 0.0
        c.wait(lambda m: m.id == 4000 and dli.ground_speed(m) >= flies and c.mode() == dli.LOITER, self.s(240), since,
               "3001 = 12 after the climb")
        # PX4's altitude reference is behind for a while after the climb.
        c.pump(60 / self.options.fast)

    def measure(self, speed, part, log):
        """A part as a route file, and what the recording shows of it."""
        text = f'id = "part"\n[defaults]\naltitude = {self.up}\naltitude_type = "agl"\nspeed = {speed}\n'
        for k, at in enumerate(part.places):
            lat, lon = (math.degrees(x) for x in self.place(at))
            text += f"[[waypoint]]\nnumber = {k + 1}\nlatitude = {lat:.8f}\nlongitude = {lon:.8f}\n"
        for k, arms in part.curves.items():
            p2, p3 = ([round(math.degrees(x), 8) for x in self.place(at)] for at in arms)
            text += f"[[curve]]\nfrom = {k + 1}\nto = {k + 2}\np2 = {p2}\np3 = {p3}\n"
        file = Path(self.options.out) / f"part-{len(self.rows)}.toml"
        file.write_text(text)
        row = {"name": part.name, "speed": speed}
        self.rows.append(row)
        if not self.options.recording:
            return
        command = [self.options.curve_plan, "check", str(file), "--speed", str(speed), "--airframe", self.options.vehicle
                   or ("plane" if self.wings else "quad"), "--flown", str(log), "--json"]
        if self.wings:
            command += ["--bank", str(self.options.bank)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        what = f"{part.name} at {speed:g} m/s"
        if done.returncode:
            self.check(what, False, done.stdout + done.stderr)
            return
        found = json.loads(done.stdout)
        flown, bound = found["flown"]["deviation_m"], found["predicted_deviation_m"]
        row |= {"flown": flown, "bound": bound}
        self.check(f"{what}: {flown:.2f} m flown, within {bound:.2f} m", flown <= bound)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vsm", required=True, type=address, metavar="HOST:PORT")
    parser.add_argument("--airframe", required=True, choices=["plane", "vtol", "quad"])
    parser.add_argument("--speed", type=float, action="append", required=True, metavar="M/S", help="speed of a route; again for another")
    parser.add_argument("--bank", type=float, default=50.0, metavar="DEG", help="FW_R_LIM of the vehicle")
    parser.add_argument("--id", type=identity, default="1b:00:00:a0", help="our id, four bytes in hex")
    parser.add_argument("--bind", default="0.0.0.0", help="our address")
    parser.add_argument("--fast", type=float, default=1.0, metavar="FACTOR", help="how much faster than time the vehicle is")
    parser.add_argument("--out", default=".", metavar="DIR", help="where the route files and the report go")
    parser.add_argument("--recording", metavar="DIR", help="the bridge's record.dir")
    parser.add_argument("--curve-plan", default="curve-plan", metavar="PROGRAM")
    parser.add_argument("--vehicle", metavar="FILE", help="the vehicle file that curve-plan predicts for")
    options = parser.parse_args()
    # Before the flight: what cannot be written after it would cost the flight.
    Path(options.out).mkdir(parents=True, exist_ok=True)
    flight = Flight(options)
    held = flight.run()
    Path(options.out, "curve-flights.json").write_text(json.dumps(flight.rows, indent=1))
    flight.checks.close()
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
