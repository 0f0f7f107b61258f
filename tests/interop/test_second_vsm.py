#!/usr/bin/env python3
"""The second VSM and its faults: a flight from discovery to landing, then one scenario for each fault.

    python3 -m unittest test_second_vsm         all of it, in about a minute

A scenario returns what it observed; it has to be the same twice on the lawful VSM and different on the
faulty one, so that a switch that does nothing does not pass for a fault.
"""
import socket
import time
import tomllib
import unittest
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cucs as dli
import reference_ed25 as ed25
from cucs import Failure
from second_scenarios import HOME, SCENARIOS, VEHICLE, Subject
from second_vsm.mutants import MUTANTS
from second_vsm.program import FAULTS, STATIONS, Options, build, parse_access
from second_vsm.variants import VARIANTS

# Scenarios mostly wait.
AT_ONCE = 12


class TheFlight(unittest.TestCase):
    def test_discovery_to_landing(self):
        with Subject(["--speed", "10"]) as subject:
            a = subject.cucs(0xA0)
            answer = a.discover(2)
            self.assertEqual((answer.fields["LOI Authorized"], answer.fields["LOI Granted"]), (15, 0))
            self.assertEqual(a.authority(15, dli.REQUEST, 2).fields["LOI Granted"], 15)
            subject.upload(a, [(10, 20, 120, 0), (20, 30, 120, 120), (30, 0, 0, 120)])
            self.assertEqual(subject.load(a), 1)
            self.assertEqual(a.command(2016, {"Select Flight Path Control Mode": 21, "Commanded Altitude": 26_500, "Altitude Type": 1}, 20)[1], [1, 2])
            a.wait(lambda m: m.id == 3001 and m.fields["Select Flight Path Control Mode"] == 12, 20)
            self.assertEqual(a.command(2016, {"Select Flight Path Control Mode": 11}, 5)[1], [1, 2])
            begun = a.mark()
            a.wait(lambda m: m.id == 3001 and m.fields["Select Flight Path Control Mode"] == 12, 60)
            numbers = [m.fields["To Waypoint Number"] for m in a.inbox[begun:] if m.id == 4001]
            self.assertEqual([n for k, n in enumerate(numbers) if n in (10, 20, 30) and n not in numbers[:k]], [10, 20, 30])
            self.assertEqual(a.command(2016, {"Select Flight Path Control Mode": 19}, 5)[1], [1, 2])
            a.wait(lambda m: m.id == 3001 and m.fields["Select Flight Path Control Mode"] == 0, 60)
            self.assertEqual(a.authority(15, dli.RELEASE, 2).fields["LOI Granted"], 0)
            self.assertEqual(a.unreadable, [])

    def test_killed_and_started_again_it_has_given_nothing_away(self):
        with Subject(["--store", "{dir}"]) as subject:
            a = subject.taken(0xA0)
            subject.kill()
            subject.start()
            b = subject.cucs(0xA2)
            b.vehicle, b.vsm_id = a.vehicle, a.vsm_id
            self.assertEqual(b.authority(4, dli.REQUEST, 2).fields["LOI Granted"], 0)
            self.assertEqual(a.command(2017, {"Loiter Radius": 77}, 2)[1], [2])


class Faults(unittest.TestCase):
    """Each fault shows in the scenario that is named for it, and the lawful VSM shows the same twice."""

    def test_every_fault_has_a_scenario(self):
        self.assertEqual(set(MUTANTS), set(SCENARIOS))

    def test_faults_differ_and_the_lawful_do_not(self):
        with ThreadPoolExecutor(AT_ONCE) as pool:
            runs = {id: [pool.submit(self.observe, options, scenario), pool.submit(self.observe, options, scenario),
                         pool.submit(self.observe, [*options, "--mutant", id], scenario)] for id, (options, scenario) in SCENARIOS.items()}
        for id, observed in runs.items():
            lawful, again, faulty = (run.result() for run in observed)
            if lawful != again or lawful == faulty:
                # On a busy machine a datagram may be late: once more, alone.
                options, scenario = SCENARIOS[id]
                lawful, again, faulty = (self.observe([*options, *more], scenario) for more in ([], [], ["--mutant", id]))
            with self.subTest(id, title=MUTANTS[id].title):
                self.assertNotEqual(lawful[:1] if isinstance(lawful, tuple) else lawful, ("broken off",))
                self.assertEqual(lawful, again, "the scenario is not repeatable")
                self.assertNotEqual(lawful, faulty, "the fault does not show")

    @staticmethod
    def observe(options, scenario):
        """What a scenario observes; where it cannot be played to its end, that is what is observed."""
        with Subject(["--speed", "10", *options]) as subject:
            try:
                return scenario(subject)
            except Failure as failure:
                return "broken off", str(failure)


class AllFaults(unittest.TestCase):
    """Their judge is the suite; here they have to fit the parts that they change."""

    def test_each_is_of_a_rule_for_a_vsm(self):
        catalogue = tomllib.loads((Path(__file__).resolve().parents[2] / "conformance" / "rules.toml").read_text())
        rules = {rule["id"] for rule in catalogue["rule"] if rule["subject"] != "cucs"}
        self.assertLessEqual({rule for fault in FAULTS.values() for rule in fault.caught_by}, rules)

    def test_each_can_be_built(self):
        for id in FAULTS:
            with self.subTest(id):
                build(Options(access=dict(map(parse_access, STATIONS)), vehicles=2), [id])


class Edition25(unittest.TestCase):
    """The same VSM under the wrapper and the messages of Edition 2.5."""

    def setUp(self):
        self.subject = Subject(["--speed", "10", "--edition", "2.5"]).__enter__()
        self.addCleanup(self.subject.__exit__)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(0.05)
        self.addCleanup(self.socket.close)
        self.instance = 0

    def send(self, id, fields, vehicle=VEHICLE):
        self.instance += 1
        own = {"Time Stamp": time.time(), "Vehicle ID": vehicle, "CUCS ID": 0x1B0000A0}
        wire = ed25.encode({"id": id, "instance": self.instance, "fields": {**own, **fields}})
        self.socket.sendto(wire, ("127.0.0.1", self.subject.port))

    def receive(self, *ids, until=None, seconds=3.0):
        """The fields of messages of these types, up to one that is wanted."""
        got, end = [], time.monotonic() + seconds
        while time.monotonic() < end:
            try:
                datagram = self.socket.recv(2000)
            except TimeoutError:
                continue
            for message in ed25.decode_all(datagram):
                if message["id"] in ids:
                    got.append((message["id"], message["fields"]))
                    if until and until(*got[-1]):
                        return got
        return got

    def take(self):
        self.send(1, {"VSM ID": -1}, vehicle=-1)
        self.assertEqual(self.receive(21, until=lambda *_: True)[0][1]["LOI Granted"], 0)
        self.send(1, {"VSM ID": -1, "Requested/Handover LOI": 15, "Controlled Station Mode": 1})
        self.assertEqual(self.receive(21, until=lambda *_: True)[0][1]["LOI Granted"], 15)

    def test_a_route_comes_back_as_it_was_sent_and_is_flown(self):
        self.take()
        sent = [{"Waypoint Number": number, "Next Waypoint": following, "Waypoint to Latitude or Relative Y": HOME[0] + 7e-6 * number,
                 "Waypoint to Longitude or Relative X": HOME[1], "Waypoint to Altitude": 520.375, "Waypoint Altitude Type": 1,
                 "Waypoint to Speed": 11.25, "Waypoint Speed Type": 2} for number, following in ((1, 2), (2, 0))]
        self.send(801, {"Initial Waypoint Number": 1, "Route ID": "R", "Route Type": 2})
        for waypoint in sent:
            self.send(802, waypoint)
        self.send(800, {"Mission ID": "M", "Mission Plan Mode": 2})
        self.assertEqual(self.receive(900, until=lambda _, f: f["Status"] != 0)[-1][1]["Status"], 1)
        self.send(800, {"Mission ID": "M", "Mission Plan Mode": 3})
        came = [f for id, f in self.receive(802, 900, until=lambda id, _: id == 900) if id == 802]
        self.assertEqual([{name: f[name] for name in sent[0]} for f in came], sent)
        self.send(43, {"Altitude Command Type": 1, "Commanded Altitude": 520.0, "Altitude Type": 1})
        for mode, shown in ((21, 12), (11, 11), (19, 19)):
            self.send(42, {"Select Flight Path Control Mode": mode})
            reports = self.receive(106, until=lambda _, f, m=shown: f["Select Flight Path Control Mode"] == m, seconds=10)
            self.assertEqual(reports[-1][1]["Select Flight Path Control Mode"], shown)

    def test_acknowledges_the_types_that_were_named_and_limits_are_in_metres(self):
        self.take()
        self.send(41, {"Loiter Type": 1, "Loiter Radius": 90.0, "Loiter Direction": 1})
        self.assertEqual(self.receive(1400, seconds=0.5), [])
        self.send(1401, {"Message Type": 41})
        self.send(41, {"Loiter Type": 1, "Loiter Radius": 91.0, "Loiter Direction": 1})
        acknowledgement = self.receive(1400, until=lambda *_: True)[0][1]
        self.assertEqual((acknowledgement["Original Message Instance ID"], acknowledgement["Original Message Type"]), (self.instance, 41))
        self.send(1200, {"Request Type": 3})
        answers = self.receive(1301, 1203, until=lambda id, _: id == 1203)
        self.assertEqual(answers[-1][0], 1203)
        radius = next(f for id, f in answers if (f.get("Requested Message"), f.get("Requested Field")) == (41, 5))
        self.assertEqual((radius["Min Value"], radius["Max Value"]), (15.0, 30_000.0))


class Departures(unittest.TestCase):
    def test_each_lets_a_cucs_connect_upload_and_load(self):
        for id in VARIANTS:
            with self.subTest(id), Subject(["--speed", "10", "--variant", id]) as subject:
                a = subject.cucs(0xA0)
                a.discover(3)
                self.assertTrue(a.authority(4, dli.REQUEST, 2).fields["LOI Granted"] & 4)
                subject.upload(a, [(1, 2, 50, 0), (2, 0, 50, 50)])
                self.assertEqual(subject.load(a), 1)


if __name__ == "__main__":
    unittest.main()
