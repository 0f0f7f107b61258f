#!/usr/bin/env python3
"""The second CUCS and its faults: a flight through the second VSM, then for each fault something that it does otherwise.

    python3 -m unittest test_second_cucs
"""
import itertools
import json
import math
import subprocess
import sys
import unittest
from pathlib import Path

from second_cucs.display import MODE
from second_cucs.faults import FAULTS
from second_cucs.station import Impossible, Station
from second_scenarios import Subject
from second_vsm.wire import Codec

PROGRAM = Path(__file__).resolve().parent / "second_cucs.py"
VEHICLE, CUCS = 0x1B000101, 0x1B0000A0


class Bench:
    """A station whose datagrams are kept instead of sent, and a codec that speaks as the VSM."""

    def __init__(self, *faults):
        self.station, self.vsm, self.sent = Station(("127.0.0.1", 9), CUCS), Codec("4", 2), []
        self.clock = itertools.count(0, 0.02)
        self.station.now = lambda: next(self.clock)
        self.station.stamp = lambda count=itertools.count(1): next(count)
        self.station.transmit = self.sent.append
        self.station.vehicle = VEHICLE
        for id in faults:
            FAULTS[id].build(self.station)

    def close(self):
        self.station.socket.close()

    def receives(self, id, ack=False, damaged=False, **fields):
        wire = bytearray(self.vsm.encode(id, VEHICLE, CUCS, {"Time Stamp": 1, **{n.replace("_", " "): v for n, v in fields.items()}}, ack))
        if damaged:
            wire[-1] ^= 1
        self.station.take_datagram(bytes(wire))

    def granted(self, loi):
        self.receives(2, LOI_Granted=loi, LOI_Authorized=15)

    def ids(self):
        return [int.from_bytes(wire[12:14], "big") for wire in self.sent]

    def tries(self, step, *args, **named):
        """Whether a step was possible; the station never waits, for its clock runs."""
        self.station.pump = lambda seconds: None
        try:
            step(*args, **named)
        except Impossible:
            return False
        return True


def commanded(b):
    """The attempts of a command that nobody acknowledges."""
    b.granted(13)
    b.tries(b.station.command, 2017, {})
    return b.sent


def raises(b, action):
    try:
        action()
    except (KeyError, ValueError, OSError):
        return True
    return False


def upload(b, lon=-1.0):
    b.granted(13)
    b.tries(b.station.upload, [(0.8, lon, 500, 0), (0.8001, lon, 500, 0)])
    return b.sent, b.station.display.mission


def levels(*grants):
    def observe(b):
        for loi in grants:
            b.granted(loi)
            b.station.tick()
        return b.tries(b.station.fly_mode, 12), b.ids()
    return observe


def alerts(b):
    b.receives(16000, **{"Alert (Warning) ID": -7, "Priority": 2, "Type": 1, "Text": "first"})
    b.receives(16000, **{"Alert (Warning) ID": 7, "Priority": 3, "Type": 1, "Text": "second"})
    shown = sorted(b.station.display.alerts)
    b.receives(16000, **{"Alert (Warning) ID": 7, "Priority": 0, "Type": 0})
    return shown, len(b.station.display.alerts)


def declared(b):
    b.receives(41003, Requested_Message=2017, Requested_Field=3, Min_Value=50, Max_Value=500)
    b.granted(4)
    return b.tries(b.station.set_loiter, 10.0)


def energy(b):
    b.receives(41003, Requested_Message=3002, Requested_Field=12, Low_Caution_Limit=20_000, Low_Warning_Limit=10_000)
    b.receives(3002, Current_Propulsion_Energy_Level=9_000)
    return b.station.display.own_warnings


def acknowledges(b):
    b.receives(16000, ack=True, Text="x")
    b.receives(17000, ack=True, Acknowledgement_Type=1)
    return b.sent


def modes(b):
    b.receives(44003, Reported_Message=2016, Reported_Field=2, Reported_Enumerated_Index=16, Enumerated_Index_Enable=-2)
    return b.station.display.offered_modes()


def damaged_grant(b):
    b.receives(2, damaged=True, LOI_Granted=4)
    return b.station.display.loi


def no_position(b):
    b.receives(4000, Heading=5)
    return b.station.display.position


OBSERVED = {
    "C03": damaged_grant, "C05": upload, "C08": no_position, "C09": lambda b: b.station.search(), "C11": levels(),
    "C12": levels(4, 0), "C13": levels(2), "C14": lambda b: (b.granted(4), b.receives(4, **{"Requesting CUCS ID": 5}), b.ids()),
    "C15": lambda b: (upload(b), b.ids())[1], "C16": lambda b: upload(b)[1], "C17": modes, "C18": declared, "C19": energy,
    "C20": lambda b: (b.tries(b.station.configure), b.ids()), "C21": acknowledges, "C22": lambda b: len(set(commanded(b))),
    "C23": alerts, "C24": lambda b: raises(b, lambda: b.receives(3001, **{MODE: 250})), "C25": lambda b: raises(b, lambda: b.station.take_datagram(b"")),
    **dict.fromkeys(("C01", "C02", "C04", "C06", "C07", "C10"), upload),
}


class Faults(unittest.TestCase):
    def test_every_fault_is_observed(self):
        self.assertEqual(set(OBSERVED), set(FAULTS))

    def test_each_does_otherwise(self):
        for id, observe in OBSERVED.items():
            with self.subTest(id, title=FAULTS[id].title):
                lawful, again, faulty = (self.observe(observe, *faults) for faults in ((), (), (id,)))
                self.assertEqual(lawful, again, "the observation is not repeatable")
                self.assertNotEqual(lawful, faulty, "the fault does not show")

    @staticmethod
    def observe(observe, *faults):
        bench = Bench(*faults)
        try:
            return repr(observe(bench))
        finally:
            bench.close()


class TheFlight(unittest.TestCase):
    def test_discovery_to_landing(self):
        with Subject(["--speed", "10"]) as subject:
            done = subprocess.run([sys.executable, str(PROGRAM), "--vsm", f"127.0.0.1:{subject.port}", "discover", "take:15", "monitor:1", "configure",
                                   "upload", "radius:60", "launch", "monitor:6", "mode:11", "monitor:3", "show", "land", "point:30,-20", "release"],
                                  capture_output=True, text=True, timeout=120)
        self.assertEqual(done.returncode, 0, done.stderr)
        picture = json.loads(done.stdout)
        self.assertEqual((picture["mission"], picture["mode"], picture["loi"], picture["not_confirmed"]), ("loaded", "waypoint", 15, []))
        self.assertTrue(math.isclose(picture["position"][0], 0.8272, abs_tol=1e-3))
        self.assertNotIn(17, picture["offered_modes"])


if __name__ == "__main__":
    unittest.main()
