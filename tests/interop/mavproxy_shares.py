#!/usr/bin/env python3
"""MAVProxy and a bridge share one vehicle: both read it, both command it, and the bridge says so.

    mavproxy_shares.py --vsm HOST:PORT --link HOST:PORT --passphrase WORD --folder DIR

`--link` is where the vehicle sends a second link of its own; the signing key is SHA-256 of the passphrase, as
MAVProxy makes it. Ends with 0 where every check held. THE AIRCRAFT WILL ARM.
"""
import argparse
import math
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import cucs as dli
from checks import Checks
from cucs import Cucs, Failure
from fly import address
from route import AGL, WGS84, survey

SYSTEM = 254
NAV_WAYPOINT, ARM, SET_MODE = 16, 400, 176
LAUNCH = {"Select Flight Path Control Mode": dli.LAUNCH, "Altitude Command Type": 1, "Commanded Altitude": 1000,
          "Altitude Type": AGL}


class Mavproxy:
    """The program, told by its standard input; what it prints is kept."""

    def __init__(self, link, folder):
        program = Path(sys.executable).with_name("mavproxy.py")
        command = [sys.executable, str(program), f"--master=udpin:{link[0]}:{link[1]}", f"--source-system={SYSTEM}",
                   f"--state-basedir={folder}"]
        # Its own home: it reads and writes files there.
        self._process = subprocess.Popen(command, cwd=folder, env={**os.environ, "HOME": folder}, text=True,
                                         stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        self.lines = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self):
        for line in self._process.stdout:
            self.lines.append(line.rstrip())

    def tell(self, command):
        self._process.stdin.write(command + "\n")
        self._process.stdin.flush()

    def said(self, text, since=0):
        return any(text in line for line in self.lines[since:])

    def close(self):
        self._process.kill()
        self._process.wait()


class BesideCucs:
    """MAVProxy and a CUCS at one vehicle, and the steps of a test in their order."""

    steps = ()

    def __init__(self, options):
        self.options, self.checks = options, Checks()
        self.cucs = Cucs(options.vsm, 0x1B0000A0, bind=("127.0.0.1", 0))
        self.proxy = Mavproxy(options.link, options.folder)

    @classmethod
    def main(cls, description):
        parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
        parser.add_argument("--vsm", required=True, type=address, metavar="HOST:PORT")
        parser.add_argument("--link", required=True, type=address, metavar="HOST:PORT")
        parser.add_argument("--passphrase", required=True)
        parser.add_argument("--folder", required=True)
        test = cls(parser.parse_args())
        held = test.run()
        test.checks.close()
        return 0 if held else 1

    def run(self):
        try:
            for step in self.steps:
                self.checks.step(step.replace("_", " "))
                getattr(self, step)()
        except Failure as failure:
            self.check(str(failure), False)
        finally:
            self.proxy.close()
            self.cucs.close()
            for line in [] if self.checks.passed() else self.proxy.lines:
                self.checks.say(f"MAVProxy: {line}")
        return self.checks.passed()

    def until(self, so, timeout, what):
        self.pump_until(so, timeout)
        self.check(what, so())
        if not so():
            raise Failure(f"not within {timeout} s: {what}")

    def pump_until(self, so, timeout):
        end = time.monotonic() + timeout
        while not so() and time.monotonic() < end:
            self.cucs.pump(0.1)

    def check(self, what, held, found=""):
        self.checks.check(what, held, found)


class Sharing(BesideCucs):
    """Over a second link of the vehicle."""

    steps = ("both_see_it", "mavproxy_reads", "mavproxy_commands", "the_bridge_commands")

    def both_see_it(self):
        c = self.cucs
        c.discover(10)
        granted = c.authority(dli.LOI_2 | dli.LOI_4 | dli.LOI_5, dli.REQUEST, 5).fields.get("LOI Granted")
        self.check("the CUCS is granted control", granted == 0xD, granted)
        c.wait(lambda m: m.id == 4000 and m.fields.get("Altitude Type") == WGS84, 60, since=0, what="a position")
        self.start = c.position()
        self.until(lambda: self.proxy.said("online system 1"), 20, "MAVProxy sees the vehicle")
        self.proxy.tell(f"signing key {self.options.passphrase}")
        self.route = survey(False)
        since = c.mark()
        c.transmit(self.route.definition(c), *(p.message(c, self.start, ack=False) for p in self.route.points))
        c.transmit(self.route.load(c, "SHARED"))
        done = c.wait(lambda m: m.id == 14000 and m.fields.get("Status") in (1, 2), 20, since, "the end of the upload")
        self.check("the bridge uploads a route beside MAVProxy", done.fields.get("Status") == 1, done.fields)

    def mavproxy_reads(self):
        at = len(self.proxy.lines)
        self.proxy.tell("wp list")
        self.until(lambda: self.proxy.said("Saved", at), 20, "MAVProxy reads the plan")
        items = waypoints(self.proxy.lines[at:])
        flown = self.route.flown()
        near = len(items) == len(flown) and all(
            abs(math.degrees(a) - b) < 3e-7 for p, item in zip(flown, items) for a, b in zip(p.place(self.start), item))
        self.check("MAVProxy reads the route of the CUCS from the vehicle", near, items)
        at = len(self.proxy.lines)
        self.proxy.tell("param fetch MPC_XY_CRUISE")
        self.until(lambda: self.proxy.said("MPC_XY_CRUISE = 5.0", at), 10, "MAVProxy reads a parameter")

    def mavproxy_commands(self):
        self.foreign(ARM, "arm throttle", "ARMED")
        armed = self.cucs.latest(3001)
        self.check("the CUCS still sees its vehicle", armed is not None)
        self.foreign(SET_MODE, "long MAV_CMD_DO_SET_MODE 1 4 6", "Mode LAND")
        self.cucs.wait(lambda m: m.id == 3001 and m.fields.get("Select Flight Path Control Mode") == dli.AUTOLAND, 10, 0,
                       "3001 with the mode that MAVProxy commanded")
        at = len(self.proxy.lines)
        self.proxy.tell("disarm")
        self.until(lambda: self.proxy.said("DISARMED", at), 10, "MAVProxy disarms")

    def foreign(self, number, line, sign):
        """MAVProxy gives a command; the vehicle does it, and the bridge tells the CUCS whose it was."""
        since, at = self.cucs.mark(), len(self.proxy.lines)
        self.proxy.tell(line)
        self.until(lambda: self.proxy.said(sign, at), 10, f"`{line}` is carried out")
        told = f"MAVLink system {SYSTEM} commands the vehicle too: command {number}"
        self.until(lambda: any(told in text for text in self.alerts(since)), 5, f"16000 says who: {told}")

    def the_bridge_commands(self):
        _, kinds = self.cucs.command(2016, LAUNCH, 40)
        self.check("the CUCS launches", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        self.until(lambda: self.proxy.said("Mode TAKEOFF"), 10, "MAVProxy sees the launch")
        since = self.cucs.mark()
        _, kinds = self.cucs.command(2016, {"Select Flight Path Control Mode": dli.AUTOLAND}, 40)
        self.check("the CUCS lands it", kinds == [dli.RECEIVED, dli.CARRIED_OUT], kinds)
        self.cucs.wait(lambda m: m.id == 3002 and m.fields.get("UA State") in (1, 2, 3), 90, since, "an aircraft on the ground")
        own = [t for t in self.alerts(0) if "system 245" in t]
        self.check("the bridge's own commands are nobody else's", not own, own)
        self.check("everything that the CUCS received can be decoded", not self.cucs.unreadable, self.cucs.unreadable[:3])

    def alerts(self, since):
        """Texts of 16000; a long one comes in parts, and the next part follows at once."""
        return ["".join(m.fields.get("Text") or "" for m in self.cucs.inbox[since:] if m.id == 16000)]


def waypoints(lines):
    """Latitude and longitude of the waypoints in what MAVProxy lists."""
    rows = [line.rpartition("> ")[2].split() for line in lines]
    return [(float(row[2]), float(row[3])) for row in rows if row[:1] == [str(NAV_WAYPOINT)] and len(row) > 4]


if __name__ == "__main__":
    sys.exit(Sharing.main(__doc__))
