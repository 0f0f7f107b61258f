#!/usr/bin/env python3
"""MAVProxy beside the bridge (`[[forward]]` with a key): it reads a parameter, arms nothing while a CUCS holds control, and arms after that.

    mavproxy_beside.py --vsm HOST:PORT --link HOST:PORT --passphrase WORD --folder DIR

`--link` is that of the `[[forward]]`, whose key is SHA-256 of the passphrase. Ends with 0 where every check held. THE AIRCRAFT WILL ARM.
"""
import sys
import time

import cucs as dli
from cucs import Failure
from mavproxy_shares import BesideCucs


class Beside(BesideCucs):
    """Behind the bridge."""

    steps = ("reads", "is_refused_beside_a_controller", "arms")

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


if __name__ == "__main__":
    sys.exit(Beside.main(__doc__))
