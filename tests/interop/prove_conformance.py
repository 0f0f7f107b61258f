#!/usr/bin/env python3
"""The conformance suite's own proof: judges the lawful VSM, its lawful departures, its faults, a dead port and a bad network.

    prove_conformance.py --dli-check target/debug/dli-check [--only V32 --only lawful] [--all-rules] [--out TABLE.md]

Every run has a second VSM of its own and a limit of time. A fault has to make the first rule fail that it
names; nothing may fail on what is lawful, on a dead port or with 5 % of the datagrams lost. By default a
fault is judged by the rules that it names and by a few that it must not touch; `--all-rules` judges all.
Ends with 0 where all of this holds, 1 where there is a gap, which the table names.
"""
import argparse
import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from cucs_operator import profile as cucs_profile
from lossy_relay import Relay
from second_cucs.program import FAULTS as CUCS_FAULTS
from second_scenarios import PROGRAM, free_port
from second_vsm.mutants import MUTANTS
from second_vsm.program import CIRCUMSTANCES, FAULTS
from second_vsm.variants import VARIANTS

# More than a run takes for itself at most (`--within`): L01, which has each #2 half a second late, takes 1,400 s of that.
LIMIT_S = 2400
HEAD_CUCS = """# On a CUCS

Written by `tests/interop/prove_conformance.py --cucs`: `dli-check cucs` plays a vehicle to the second CUCS of `tests/interop`, whose steps and
eyes are `tests/interop/cucs_operator.py`. C01 to C25 are the faults of the suite's own table; the others are named after the rule that has to
find them.
"""
HEAD = """# The proof of the conformance suite

Written by `tests/interop/prove_conformance.py`: `dli-check` judges the second VSM of `tests/interop`, which was written from the oracles
alone. Nothing may fail on what is lawful; each fault has to make the rule fail that is named first in its row, and may make the others
fail. V01 to V60 are the faults of the suite's own table; the others are named after the rule that has to find them. A gap is a fault
that its first rule does not find, with the verdict and its reason.
"""
LOSS = 0.05
# Rules that hold on most faulty VSMs: where they fail as well, the reason is looked for.
UNTOUCHED = ("DISC-001", "AUTH-001", "ACK-001")
TWO_VEHICLES = {"MULTI-002", "MULTI-002b", "MULTI-002p", "MULTI-002s", "MULTI-002u", "MULTI-002v", "MULTI-002w", "MULTI-002x", "MULTI-002z", "V12", "V13", "V27", "two-vehicles"}
# Rules that need more reports in a second of the vehicle's time than a fast aircraft gives: the speed at which their faults fly.
SLOWER = {"STAT-017": 2.0, "ROUTE-024": 1.0}
STATIONS = (("1b:00:00:a0", "2345", True), ("1b:00:00:a1", "2345", True), ("1b:00:00:a2", "2345", False), ("1b:00:00:a3", "24", False),
            ("1b:00:00:a4", "2", False))


@dataclass
class Run:
    """One judgement: what was judged, and what came out."""

    id: str
    title: str
    options: list = field(default_factory=list)
    caught_by: tuple = ()
    rules: tuple = ()
    loss: float = 0.0
    dead: bool = False
    seconds: float = 0.0
    verdicts: dict = field(default_factory=dict)
    reasons: dict = field(default_factory=dict)
    error: str = ""

    @property
    def failed(self):
        return sorted(rule for rule, verdict in self.verdicts.items() if verdict in ("fail", "flaky"))

    @property
    def faulty(self):
        return bool(self.caught_by)

    def gap(self):
        """What is wrong with this run, or nothing."""
        if self.error:
            return self.error
        if not self.faulty:
            return "failed on what is lawful: " + ", ".join(self.failed) if self.failed else ""
        first = self.caught_by[0]
        if first in self.failed:
            return ""
        verdict, reason = self.verdicts.get(first, "not judged"), self.reasons.get(first, "")
        others = [rule for rule in self.caught_by[1:] if rule in self.failed]
        why = f" ({reason[:120]})" if reason and verdict != "pass" else ""
        return f"{first}: {verdict}{why}" + (f"; caught by {', '.join(others)}" if others else "; **not caught**" if not self.failed else "")


def rules_of(edition):
    """The rules by which an edition is judged."""
    catalogue = tomllib.loads((Path(__file__).resolve().parents[2] / "conformance" / "rules.toml").read_text())
    return {rule["id"] for rule in catalogue["rule"] if edition in rule["editions"]}


def runs(all_rules, edition="4"):
    """Everything that is to be judged; in Edition 2.5 of the faults those of the suite's own table that a rule of it is about."""
    known = rules_of(edition)
    yield Run("lawful", "the second VSM as it is")
    yield Run("two-vehicles", "the second VSM with two vehicles")
    yield Run("no-fix", "the second VSM without a position fix", ["--no-fix"], rules=("STAT-014", "DISC-001", "STAT-001"))
    for id, variant in VARIANTS.items():
        yield Run(id, variant.title, ["--variant", id])
    for id, mutant in FAULTS.items():
        caught_by = tuple(rule for rule in mutant.caught_by if rule in known)
        if not caught_by or edition == "2.5" and id not in MUTANTS:
            continue
        rules = () if all_rules else tuple(dict.fromkeys((*caught_by, *UNTOUCHED)))
        yield Run(id, mutant.title, ["--mutant", id, *CIRCUMSTANCES.get(id, ())], caught_by, rules)
    yield Run("dead-port", "nobody listens", dead=True)
    yield Run("loss", f"{LOSS:.0%} of all datagrams lost each way", loss=LOSS)


class Unbuilt(Exception):
    """A subject that does not start; the text says why."""


class Bench:
    """One subject on ports of its own, with the profile that describes it."""

    def __init__(self, run, speed, edition):
        self.edition = edition
        self.run, self.directory = run, tempfile.TemporaryDirectory()
        self.path = Path(self.directory.name)
        self.port, self.control = free_port(), free_port()
        self.options = ["--port", str(self.port), "--control", str(self.control), "--speed", str(speed), "--store", str(self.path / "store"), "--edition", edition,
                        *run.options]
        if run.id in TWO_VEHICLES:
            self.options += ["--vehicles", "2"]
        self.speed, self.relay = speed, None

    def __enter__(self):
        self.front = self.port
        if not self.run.dead:
            start(self.path, self.options)
        if self.run.loss:
            self.front = free_port()
            self.relay = Relay(("127.0.0.1", self.front), ("127.0.0.1", self.port), self.run.loss)
            threading.Thread(target=self.relay.run, daemon=True).start()
        (self.path / "profile.toml").write_text(self.profile())
        return self

    def close(self):
        if self.relay:
            self.relay.stop()
        stop(self.path)
        self.directory.cleanup()

    def __exit__(self, *_):
        self.close()

    def profile(self):
        python, here = sys.executable, Path(__file__).resolve()
        lines = ["[subject]", f'name = "second VSM, {self.run.id}"', f'address = "127.0.0.1:{self.front}"', f'edition = "{self.edition}"', 'vsm_id = "%s:00:00:01"' % self.owner()]
        for id, _, override in STATIONS:
            lines += ["[[cucs]]", f'id = "{id}"', f"override = {str(override).lower()}"]
        for number in range(2 if self.run.id in TWO_VEHICLES else 1):
            lines += ["[[vehicle]]", f'id = "{self.owner()}:00:01:0{number + 1}"', "simulated = true"]
            if number == 0:
                lines += ["position = [47.3977434, 8.5455939]", "amsl_m = 488.0", "geoid_m = 47.0", 'tail_number = "SECOND-01"']
        order = f"{python} {PROGRAM} --order {self.control}"
        lines += ["[means]", f'restart = "{python} {here} --restart {self.path}"', f'cut_vehicle_link = "{order} link down"',
                  f'restore_vehicle_link = "{order} link up"', f'lower_energy = "{order} battery 20"', f'restore_energy = "{order} battery 100"',
                  "[figures]", f"speed_factor = {float(self.speed)}", f'on_loss = "{"hold" if "--on-loss" in self.run.options else "continue"}"']
        return "\n".join(lines) + "\n"

    def owner(self):
        return "21" if self.run.id == "L09" else "1b"


def start(path, options=None):
    """Starts a subject; its options and its process id are kept in `path`, for a restart."""
    kept = path / "options.json"
    if options is None:
        options = json.loads(kept.read_text())
    kept.write_text(json.dumps(options))
    with open(path / "subject.log", "a") as log:
        process = subprocess.Popen([sys.executable, str(PROGRAM), *options], stderr=log, start_new_session=True)
    (path / "pid").write_text(str(process.pid))
    for _ in range(600):
        if "ready" in (path / "subject.log").read_text().split("\n")[-2:][0]:
            return
        if process.poll() is not None:
            break
        time.sleep(0.05)
    raise Unbuilt((path / "subject.log").read_text().strip().split("\n")[-1][:160])


def stop(path):
    try:
        pid = int((path / "pid").read_text())
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
    except (OSError, ChildProcessError):
        pass


def restart(path):
    (path / "subject.log").write_text("")
    stop(path)
    start(path)


def judge(run, args):
    """Runs the suite against one subject."""
    began = time.monotonic()
    try:
        speed = min([args.speed, *(SLOWER[rule] for rule in run.caught_by[:1] if rule in SLOWER)])
        bench = Bench(run, speed, args.edition).__enter__()
    except Unbuilt as reason:
        run.error = f"not in Edition {args.edition}: {reason}"
        print(f"{run.id:12} {run.error}", flush=True)
        return run
    with contextlib.closing(bench):
        report = bench.path / "report.json"
        command = [args.dli_check, "vsm", "--profile", str(bench.path / "profile.toml"), "--simulated", "--quiet", "--json", str(report)]
        if run.faulty:
            # A "should" that is broken fails only then.
            command.append("--strict")
        for rule in run.rules:
            command += ["--rule", rule]
        collect(run, command, report, args.limit)
    run.seconds = time.monotonic() - began
    print(f"{run.id:12} {run.seconds:6.0f} s  {run.gap() or 'as expected'}", flush=True)
    return run


def cucs_runs():
    yield Run("lawful", "the second CUCS as it is")
    for id, fault in CUCS_FAULTS.items():
        yield Run(id, fault.title, [id], fault.caught_by)


def judge_cucs(run, args):
    """Lets the suite's scripted vehicle judge one CUCS, scenario by scenario."""
    began, port, control = time.monotonic(), free_port(), free_port()
    with tempfile.TemporaryDirectory() as directory:
        report, profile = Path(directory) / "report.json", Path(directory) / "profile.toml"
        profile.write_text(cucs_profile(control, run.options))
        command = [args.dli_check, "cucs", "--listen", f"127.0.0.1:{port}", "--profile", str(profile), "--json", str(report),
                   *(["--strict"] if run.faulty else [])]
        for rule in run.rules:
            command += ["--rule", rule]
        collect(run, command, report, args.limit)
    run.seconds = time.monotonic() - began
    print(f"{run.id:12} {run.seconds:6.0f} s  {run.gap() or 'as expected'}", flush=True)
    return run


def collect(run, command, report, limit):
    """Runs the suite, and takes its verdicts."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=limit)
        # 0 as expected, 1 fails, 3 nothing judged, which a dead port is.
        if done.returncode not in (0, 1, 3) or not report.exists():
            run.error = f"dli-check: status {done.returncode}: {done.stderr.strip()[:200]}"
    except subprocess.TimeoutExpired:
        run.error = f"no end within {limit:.0f} s"
    if report.exists():
        for rule in json.loads(report.read_text())["rules"]:
            run.verdicts[rule["id"]] = rule["verdict"]
            run.reasons[rule["id"]] = rule.get("reason") or ""


def row(run):
    """A run as a row of the table."""
    if run.faulty:
        return f"| {run.id} | {run.title} | {', '.join(run.caught_by)} | {', '.join(run.failed) or 'none'} | {run.gap()} |"
    count = [sum(v == verdict for v in run.verdicts.values()) for verdict in ("pass", "warning", "inconclusive")]
    return f"| {run.id} | {run.title} | {count[0]} | {count[1]} | {count[2]} | {run.error or ', '.join(run.failed) or 'none'} |"


def table(every, done, head, rows):
    """The proof as Markdown: the rows of what was judged, and of the others those that stood there before."""
    rows = rows | {run.id: row(run) for run in done}
    known = {faulty: [run for run in every if run.faulty == faulty and run.id in rows] for faulty in (False, True)}
    lines = [head.rstrip("\n") + "\n", "## What is lawful", "", "| subject | | pass | warning | inconclusive | fail |", "|---|---|---|---|---|---|"]
    lines += [rows[run.id] for run in known[False]]
    lines += ["", "## Faults", "", "| fault | | must fail | failed | gap |", "|---|---|---|---|---|"]
    lines += [rows[run.id] for run in known[True]]
    columns = [[part.strip() for part in rows[run.id].split("|")] for run in known[True]]
    named = {rule for part in columns for rule in part[4].split(", ")}
    missing = [run.id for run in every if run.id not in rows]
    lines += ["", f"{sum(part[4] != 'none' for part in columns)} of {len(columns)} faults are caught, {sum(not part[5] for part in columns)} of them by the rule that is named first.",
              "", "Rules that are named first and that no fault makes fail: "
              + (", ".join(sorted({run.caught_by[0] for run in every if run.faulty} - named)) or "none") + "."]
    if missing:
        lines += ["", "Not judged: " + ", ".join(missing) + "."]
    return "\n".join(lines) + "\n"


def rows_of(text):
    """The rows of a table that was written before, by what they are about; the second of two tables begins with its own heading."""
    rows = {}
    for line in text.split("\n"):
        if line.startswith("| ") and line.count("|") >= 6:
            rows[line.split("|")[1].strip()] = line
    return rows


def of_file(path, head):
    """What stands in a file before the table of this heading, its own introduction with its rows, and what stands behind it."""
    text = path.read_text() if path.exists() else ""
    title = head.split("\n", 1)[0]
    begin = text.find(title + "\n")
    if begin < 0:
        return text and text.rstrip("\n") + "\n\n", head, {}, ""
    end = text.find("\n# ", begin + 1)
    own, behind = (text[begin:], "") if end < 0 else (text[begin:end], text[end:])
    return text[:begin], own.split("## What is lawful", 1)[0], rows_of(own), behind


def main():
    parser = argparse.ArgumentParser(description="Prove the conformance suite on a second VSM and its faults.")
    parser.add_argument("--dli-check", default="target/debug/dli-check", metavar="PROGRAM")
    parser.add_argument("--only", action="append", metavar="ID", help="judge just this subject: lawful, V01, L01, dead-port, loss (repeat)")
    parser.add_argument("--cucs", action="store_true", help="judge the second CUCS and its faults instead, with the scripted vehicle")
    parser.add_argument("--faults", action="store_true", help="judge the faulty only")
    parser.add_argument("--all-rules", action="store_true", help="judge the faulty by all rules")
    parser.add_argument("--rule", action="append", default=[], metavar="ID", help="judge by this rule only (repeat)")
    parser.add_argument("--speed", type=float, default=10.0, metavar="FACTOR", help="of the simulated aircraft")
    parser.add_argument("--edition", choices=["2.5", "3", "4"], default="4", help="of the second VSM and of the suite")
    parser.add_argument("--at-once", type=int, default=8, help="number of runs side by side")
    parser.add_argument("--limit", type=float, default=LIMIT_S, metavar="S", help="time for one run")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the rows of what was judged into the table of this file; the others stay, and so does its introduction")
    parser.add_argument("--details", type=Path, metavar="FILE", help="write every verdict with its reason here, as JSON")
    parser.add_argument("--restart", type=Path, metavar="DIR", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.restart:
        restart(args.restart)
        return
    every, do = (list(cucs_runs()), judge_cucs) if args.cucs else (list(runs(args.all_rules, args.edition)), judge)
    chosen = [run for run in every if (not args.only or run.id in args.only) and (run.faulty or not args.faults)]
    for run in chosen:
        run.rules = tuple(args.rule) or run.rules
    with ThreadPoolExecutor(args.at_once) as pool:
        done = list(pool.map(lambda run: do(run, args), chosen))
    head = HEAD_CUCS if args.cucs else HEAD
    if args.edition != "4":
        head = head.replace("# The proof of the conformance suite", f"# The proof in Edition {args.edition}", 1)
    print(table([run for run in every if run in done], done, head, {}))
    if args.out:
        before, own, rows, behind = of_file(args.out, head)
        args.out.write_text(before + table(every, done, own, rows) + behind)
    if args.details:
        args.details.write_text(json.dumps([{"id": r.id, "verdicts": r.verdicts, "reasons": r.reasons} for r in done], indent=1))
    sys.exit(1 if any(run.gap() for run in done) else 0)


if __name__ == "__main__":
    main()
