#!/usr/bin/env python3
"""MAVSDK as the vehicle behind a bridge: it must receive the route of a CUCS item for item, and its commands.

    mavsdk_flight.py --vsm HOST:PORT --link HOST:PORT [--key-file FILE]

`--vsm` is the bridge's DLI, `--link` its MAVLink side for system 1. Without a key nothing is signed. Ends with 0
where every check held.
"""
import argparse
import math
import sys
from pathlib import Path

import cucs as dli
from checks import Checks
from cucs import Cucs, Failure
from fly import address
from mavsdk_vehicle import GEOID_M, PARAMETERS, MavsdkVehicle
from route import AGL, WGS84, survey

HOME = (47.3977434, 8.5455939, 488.0)
NAV_WAYPOINT, NAV_TAKEOFF, DO_CHANGE_SPEED = 16, 22, 178
CONTINGENCY_A, RTL = 23, 32
RELATIVE_INT, GLOBAL_INT = 6, 5
ID = 0x1B0000A0
LAUNCH = {"Select Flight Path Control Mode": dli.LAUNCH, "Altitude Command Type": 1, "Commanded Altitude": 1000,
          "Altitude Type": AGL}


class Flight:
    """The steps in their order."""

    def __init__(self, options):
        key = bytes.fromhex(Path(options.key_file).read_text()) if options.key_file else None
        self.signed = key is not None
        self.checks = Checks()
        self.cucs = Cucs(options.vsm, ID, bind=("127.0.0.1", 0))
        self.vehicle = MavsdkVehicle(options.link, key, HOME)

    def run(self):
        try:
            for step in (self.take_control, self.upload, self.replace, self.refused_by_mavsdk, self.launch, self.fly_modes, self.land,
                         self.parameters, self.wire):
                self.checks.step(step.__name__.replace("_", " "))
                step()
        except Failure as failure:
            self.check(str(failure), False)
        finally:
            told = [m.fields.get("Text") for m in self.cucs.inbox if m.id == 16000]
            self.checks.say(f"16000: {told}")
            self.cucs.close()
            self.vehicle.close()
        return self.checks.passed()

    def take_control(self):
        self.cucs.discover(10)
        granted = self.cucs.authority(dli.LOI_2 | dli.LOI_4 | dli.LOI_5, dli.REQUEST, 5).fields.get("LOI Granted")
        self.check("LOI 2, 4 and 5 are granted", granted == 0xD, granted)
        # Without HOME_POSITION a route is refused; MAVSDK tells it once a second.
        found = self.cucs.wait(lambda m: m.id == 4000 and m.fields.get("Altitude Type") == WGS84, 30,
                               what="a position with its WGS-84 height")
        self.start = dli.place(found)
        off = abs(self.start[2] - HOME[2] - GEOID_M)
        self.check("4000 has MAVSDK's height and geoid separation", off < 0.1, self.start)

    def upload(self):
        self.load(survey(True))

    def replace(self):
        self.load(survey(False))

    def load(self, route):
        c, since, plans = self.cucs, self.cucs.mark(), len(self.vehicle.plans)
        c.transmit(route.definition(c), *(p.message(c, self.start, ack=False) for p in route.points))
        load = route.load(c, "MAVSDK")
        c.transmit(load)
        done = c.wait(lambda m: m.id == 14000 and m.fields.get("Status") in (1, 2), 20, since, "the end of the upload")
        self.check("14000 says complete", done.fields.get("Status") == 1, done.fields)
        c.pump(0.5)
        self.check("13000 is carried out", c.acknowledgements(load, since)[-1:] == [dli.CARRIED_OUT])
        taken = self.vehicle.plans[plans:]
        self.check("MAVSDK takes one plan, and takes it with success", [r for r, _ in taken] == ["SUCCESS"], taken)
        if taken:
            self.compare(route, taken[0][1])

    def compare(self, route, items):
        self.check("items are numbered from 0", [i.seq for i in items] == list(range(len(items))), [i.seq for i in items])
        places = [i for i in items if i.command == NAV_WAYPOINT]
        flown = route.flown()
        self.check("there is an item for each waypoint", len(places) == len(flown), [str(i) for i in items])
        for point, item in zip(flown, places):
            latitude, longitude = (math.degrees(a) for a in point.place(self.start))
            frame, height = (RELATIVE_INT, point.up) if point.altitude_type == AGL else (GLOBAL_INT, HOME[2] + point.up)
            # BAM and 1e-7 degrees round once each; 13002 counts heights in 0.02 m.
            near = abs(item.x - latitude * 1e7) <= 2 and abs(item.y - longitude * 1e7) <= 2 and abs(item.z - height) < 0.05
            self.check(f"waypoint {point.number} is where it was put, in frame {frame}", near and item.frame == frame, item)
            self.check(f"waypoint {point.number} is flown through, with the autopilot's own radius",
                       (item.param1, item.param2, item.autocontinue) == (0, 0, 1), item)
        speeds = [i.param2 for i in items if i.command == DO_CHANGE_SPEED]
        self.check("each leg has its speed", speeds == [p.speed for p in flown], speeds)
        others = {i.command for i in items} - {NAV_WAYPOINT, DO_CHANGE_SPEED}
        self.check("there is nothing else in the plan", not others, others)

    def refused_by_mavsdk(self):
        """MAVSDK's ActionServer knows no AUTO.LOITER by command, and a launch begins with it."""
        _, kinds = self.cucs.command(2016, LAUNCH, 20)
        self.check("a launch is refused", kinds == [dli.RECEIVED, dli.REFUSED], kinds)
        self.check("with what MAVSDK answered", any("temporarily rejected" in (m.fields.get("Text") or "")
                                                    for m in self.cucs.inbox if m.id == 16000))
        self.check("and nothing was armed", not self.vehicle.armed and not self.asked("arm"), self.vehicle.asked)

    def launch(self):
        self.vehicle.holds_itself = True
        self.mode(LAUNCH, dli.LAUNCH)
        self.check("MAVSDK was told to arm, then to take off",
                   self.asked("arm", "take off") == ["arm", "take off"], self.vehicle.asked)
        heights = [c.param7 for c in self.vehicle.heard["COMMAND_LONG"] if c.command == NAV_TAKEOFF]
        self.check("the take-off names its height: 20 m above home, AMSL", heights and abs(heights[-1] - HOME[2] - 20) < 0.1,
                   heights)

    def fly_modes(self):
        self.mode({"Select Flight Path Control Mode": dli.LOITER}, dli.LOITER)
        self.mode({"Select Flight Path Control Mode": dli.WAYPOINT}, dli.WAYPOINT)
        self.check("MAVSDK was told to fly the mission", self.asked("mode MISSION"), self.vehicle.asked)
        since = self.cucs.mark()
        _, kinds = self.cucs.command(2016, {"Select Flight Path Control Mode": CONTINGENCY_A}, 20)
        self.check("contingency A without a route is AUTO.RTL", kinds == [dli.RECEIVED, dli.CARRIED_OUT]
                   and self.asked("mode RETURN_TO_LAUNCH"), (kinds, self.vehicle.asked))
        self.cucs.wait(lambda m: m.id == 3001 and m.fields.get("Select Flight Path Control Mode") == RTL, 10, since, "RTL in 3001")

    def land(self):
        self.mode({"Select Flight Path Control Mode": dli.AUTOLAND}, dli.AUTOLAND)
        self.cucs.wait(lambda m: m.id == 3002 and m.fields.get("UA State") in (1, 2, 3), 40, what="an aircraft on the ground")
        self.check("MAVSDK's vehicle has landed", self.asked("mode LAND") and self.vehicle.height <= 0.0, self.vehicle.height)

    def parameters(self):
        asked = {p.param_id for p in self.vehicle.heard.get("PARAM_REQUEST_READ", [])} & set(PARAMETERS)
        told = self.vehicle.told.get("PARAM_VALUE", 0)
        self.check("parameters were asked for, and MAVSDK answered", asked and told >= len(asked), (asked, told))

    def wire(self):
        heard = [m for kind in self.vehicle.heard.values() for m in kind]
        signed = [m.get_signed() for m in heard]
        self.check("the bridge signs all" if self.signed else "the bridge signs nothing",
                   len(heard) > 20 and all(s == self.signed for s in signed), (len(heard), sum(signed)))
        self.check("pymavlink verifies all that the bridge sends", self.vehicle.refused() == 0, self.vehicle.refused())
        self.check("the bridge is system 245, component 190",
                   {(m.get_srcSystem(), m.get_srcComponent()) for m in heard} == {(245, 190)})
        self.check("everything that the CUCS received can be decoded", not self.cucs.unreadable, self.cucs.unreadable[:3])

    def mode(self, fields, shown):
        since = self.cucs.mark()
        _, kinds = self.cucs.command(2016, fields, 20)
        self.check(f"mode {shown}: 17000 type 1, then 2", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        self.cucs.wait(lambda m: m.id == 3001 and m.fields.get("Select Flight Path Control Mode") == shown, 10, since,
                       f"3001 = {shown}")

    def asked(self, *wanted):
        """What MAVSDK was asked for and agreed to, of these."""
        return [what for what, result in self.vehicle.asked if result == "SUCCESS" and what in wanted]

    def check(self, what, held, found=""):
        self.checks.check(what, held, found)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vsm", required=True, type=address, metavar="HOST:PORT")
    parser.add_argument("--link", required=True, type=address, metavar="HOST:PORT")
    parser.add_argument("--key-file", metavar="FILE")
    flight = Flight(parser.parse_args())
    held = flight.run()
    flight.checks.close()
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
