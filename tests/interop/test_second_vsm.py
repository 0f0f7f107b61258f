#!/usr/bin/env python3
"""The second VSM and its faults: a flight from discovery to landing, then one scenario for each fault.

    python3 -m unittest test_second_vsm         all of it, in about a minute

A scenario returns what it observed; it has to be the same twice on the lawful VSM and different on the
faulty one, so that a switch that does nothing does not pass for a fault.
"""
import tomllib
import unittest
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cucs as dli
from second_scenarios import SCENARIOS, Subject
from second_vsm.faults_by_rule import BY_RULE
from second_vsm.mutants import MUTANTS
from second_vsm.program import STATIONS, Options, build, parse_access
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
            for id, (lawful, again, faulty) in runs.items():
                with self.subTest(id, title=MUTANTS[id].title):
                    self.assertEqual(lawful.result(), again.result(), "the scenario is not repeatable")
                    self.assertNotEqual(lawful.result(), faulty.result(), "the fault does not show")

    @staticmethod
    def observe(options, scenario):
        with Subject(["--speed", "10", *options]) as subject:
            return scenario(subject)


class FaultsByRule(unittest.TestCase):
    """Their judge is the suite; here they have to be of a rule of the catalogue, and to fit the parts that they change."""

    def test_each_is_of_a_rule_and_can_be_built(self):
        catalogue = tomllib.loads((Path(__file__).resolve().parents[2] / "conformance" / "rules.toml").read_text())
        rules = {rule["id"] for rule in catalogue["rule"] if rule["subject"] != "cucs"}
        self.assertLessEqual(set(BY_RULE), rules)
        self.assertLessEqual({rule for fault in MUTANTS.values() for rule in fault.caught_by}, rules)
        for id in BY_RULE:
            with self.subTest(id):
                build(Options(access=dict(map(parse_access, STATIONS)), vehicles=2), [id])


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
