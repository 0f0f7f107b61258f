#!/usr/bin/env python3
"""MAVProxy beside the bridge (`[[forward]]` with a key): it reads a parameter, arms nothing while a CUCS holds control, and arms after that.

    mavproxy_beside.py --vsm HOST:PORT --link HOST:PORT --passphrase WORD --folder DIR

`--link` is that of the `[[forward]]`, whose key is SHA-256 of the passphrase. Ends with 0 where every check held. THE AIRCRAFT WILL ARM.
"""
import argparse
import sys
import time

import cucs as dli
from checks import Checks
from cucs import Cucs, Failure
from fly import address
from mavproxy_shares import SYSTEM, Mavproxy


class Beside:
    """The steps in their order."""

    def __init__(self, options):
        self.options, self.checks = options, Checks()
        self.cucs = Cucs(options.vsm, 0x1B0000A0, bind=("127.0.0.1", 0))
        self.proxy = Mavproxy(options.link, options.folder)

    def run(self):
        try:
            for step in (self.reads, self.is_refused_beside_a_controller, self.arms):
                self.checks.step(step.__name__.replace("_", " "))
                step()
        except Failure as failure:
            self.checks.check(str(failure), False)
        finally:
            self.proxy.close()
            self.cucs.close()
            for line in [] if self.checks.passed() else self.proxy.lines:
                self.checks.say(f"MAVProxy: {line}")
        return self.checks.passed()

    def reads(self):
        self.proxy.tell(f"signing key {self.options.passphrase}")
        self.until(lambda: self.proxy.said("online system 1"), 30, "MAVProxy sees the vehicle")
        self.repeat("param fetch MPC_XY_CRUISE", "MPC_XY_CRUISE = 5.0", 30, "MAVProxy reads a parameter")

    def is_refused_beside_a_controller(self):
        self.cucs.discover(10)
        granted = self.cucs.authority(dli.LOI_2 | dli.LOI_4 | dli.LOI_5, dli.REQUEST, 5).fields.get("LOI Granted")
        self.checks.check("the CUCS is granted control", granted == 0xD, granted)
        at = len(self.proxy.lines)
        self.repeat("arm throttle", "DENIED", 30, "MAVProxy is denied")
        self.checks.check("nothing has armed", not self.proxy.said("ARMED", at), self.proxy.lines[at:])

    def arms(self):
        self.cucs.authority(dli.LOI_2 | dli.LOI_4 | dli.LOI_5, dli.RELEASE, 5)
        self.repeat("arm throttle", "ARMED", 40, "MAVProxy arms without a controller")

    def repeat(self, line, sign, timeout, what):
        """Types a line again until its effect shows: a vehicle that has just started refuses for some seconds."""
        end = time.monotonic() + timeout
        at = len(self.proxy.lines)
        while not self.proxy.said(sign, at):
            if time.monotonic() > end:
                raise Failure(f"not within {timeout} s: {what}")
            self.proxy.tell(line)
            self.pump_until(lambda: self.proxy.said(sign, at), 3)
        self.checks.check(what, True)

    def until(self, so, timeout, what):
        self.pump_until(so, timeout)
        self.checks.check(what, so())
        if not so():
            raise Failure(f"not within {timeout} s: {what}")

    def pump_until(self, so, timeout):
        end = time.monotonic() + timeout
        while not so() and time.monotonic() < end:
            self.cucs.pump(0.1)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vsm", required=True, type=address, metavar="HOST:PORT")
    parser.add_argument("--link", required=True, type=address, metavar="HOST:PORT")
    parser.add_argument("--passphrase", required=True)
    parser.add_argument("--folder", required=True)
    beside = Beside(parser.parse_args())
    held = beside.run()
    beside.checks.close()
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
