#!/usr/bin/env python3
"""The proof of `mavlink-check`: judges the lawful autopilot, router and ground station of `mavlink_peers`, then each of their faults by the rule that it breaks.

    prove_mavlink.py --mavlink-check target/debug/mavlink-check [--only SIGN-003] [--out docs/reference/mavlink-conformance-proof.md]

Every run has a subject and ports of its own. Ends with 0 where nothing fails on the lawful one and each fault is found.
"""
import argparse
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from mavlink_peers.faults import FAULTS
from mavlink_peers.router import FAULTS as ROUTER_FAULTS
from mavlink_peers.station import FAULTS as STATION_FAULTS
from mavlink_peers.station import key_of_phrase

HERE = Path(__file__).resolve().parent
HEAD = """# The proof of mavlink-check

Written by `tests/interop/prove_mavlink.py`: `mavlink-check` judges the Python autopilot of `tests/interop/mavlink_peers`, which has a codec of its own,
and the router and the ground station beside it.
Nothing may fail on the lawful one; each fault has to make its own rule fail (with `--strict`).
"""


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        return sock.getsockname()[1]


def start(folder):
    """Starts the subject of a folder; its options are kept there for a restart."""
    options = json.loads((folder / "options.json").read_text())
    log = open(folder / "subject.log", "a")
    process = subprocess.Popen([sys.executable, "-m", "mavlink_peers", "autopilot", *options], cwd=HERE, stderr=log, start_new_session=True)
    (folder / "pid").write_text(str(process.pid))
    return process


def stop(folder):
    try:
        os.kill(int((folder / "pid").read_text()), signal.SIGKILL)
    except (OSError, ValueError):
        pass


def judge(fault, args):
    """Verdicts and reasons by rule; with a fault only of its own rule."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        key = os.urandom(32).hex()
        (folder / "key").write_text(key)
        (folder / "subject.key").write_text(key)
        ports = [free_port(), free_port()]
        options = ["--key-file", str(folder / "subject.key")]
        # Where a signature would hide what is judged of frames, the subject has no key.
        unsigned = fault in ("FRAME-002",)
        if unsigned:
            options = []
        for port in ports:
            options += ["--link", f"127.0.0.1:{port}", "--port", str(free_port())]
        if fault:
            options += ["--fault", fault]
        (folder / "options.json").write_text(json.dumps(options))
        subject = start(folder)
        report = folder / "report.json"
        command = [args.mavlink_check, "autopilot", f"udpin:127.0.0.1:{ports[0]}", "--second", f"udpin:127.0.0.1:{ports[1]}", "--simulated", "--allow", "setup-signing",
                   # The clock of the subject is its own: it sets none of the computer's.
                   "--system-time", "--restart", f"{sys.executable} {HERE / 'prove_mavlink.py'} --restart {folder}", "--quiet", "--no-repeat", "--json", str(report)]
        if not unsigned:
            command += ["--key-file", str(folder / "key")]
        if fault:
            command += ["--strict"]
            for rule in wanted(fault):
                command += ["--rule", rule]
        try:
            subprocess.run(command, capture_output=True, text=True, timeout=args.limit)
        except subprocess.TimeoutExpired:
            pass
        stop(folder)
        subject.wait()
        rules = json.loads(report.read_text())["rules"] if report.exists() else []
        crash = "Traceback" in (folder / "subject.log").read_text()
    found = {rule["id"]: (rule["verdict"], rule["reason"]) for rule in rules}
    if fault:
        verdict, reason = found.get(fault, ("no end", ""))
        print(f"{fault:10} {time.monotonic() - began:5.1f} s  {verdict}{' (subject crashed)' if crash else ''}: {reason[:100]}", flush=True)
    else:
        print(f"lawful     {time.monotonic() - began:5.1f} s  fails: {[f'{k}: {v[1]}' for k, v in found.items() if v[0] in ('fail', 'flaky')]}", flush=True)
    return fault, found


def judge_router(fault, args):
    """The same of a router, between two ends of the suite."""
    ports = [free_port(), free_port()]
    options = [word for port in ports for word in ("--port", str(port))] + (["--fault", fault] if fault else [])
    with tempfile.TemporaryDirectory() as name:
        report = Path(name) / "report.json"
        command = [args.mavlink_check, "router", "--vehicle", f"udpout:127.0.0.1:{ports[0]}", "--station", f"udpout:127.0.0.1:{ports[1]}",
                   "--quiet", "--strict", "--no-repeat", "--json", str(report)]
        command += ["--rule", fault] if fault else []
        subject = subprocess.Popen([sys.executable, "-m", "mavlink_peers", "router", *options], cwd=HERE, start_new_session=True)
        try:
            subprocess.run(command, capture_output=True, text=True, timeout=args.limit)
        except subprocess.TimeoutExpired:
            pass
        subject.kill()
        subject.wait()
        rules = json.loads(report.read_text())["rules"] if report.exists() else []
    found = {rule["id"]: (rule["verdict"], rule["reason"]) for rule in rules}
    shown = {fault: found.get(fault)} if fault else {rule: verdict for rule, verdict in found.items() if verdict[0] in ("fail", "flaky")}
    print(f"router {fault or 'lawful'}: {shown}", flush=True)
    return fault, found


def judge_station(fault, args):
    """The same of a ground station, to which the suite plays a vehicle. A change of keys is a run of its own: it is no part of a lawful session."""
    port, rotate = free_port(), fault in ("SIGN-027", "rotation")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        report, key, phrase = folder / "report.json", folder / "key", folder / "phrase"
        phrase.write_text("correct horse battery staple")
        key.write_text(key_of_phrase(phrase.read_bytes()).hex() if fault == "SIGN-018" else os.urandom(32).hex())
        options = ["--port", str(port), "--key-file", str(key), "--recording", str(folder / "sent.tlog"), "--phrase-file", str(phrase)]
        options += ["--rotate"] * rotate + (["--fault", fault] if fault in STATION_FAULTS else [])
        subject = subprocess.Popen([sys.executable, "-m", "mavlink_peers", "station", *options], cwd=HERE, start_new_session=True)
        while not (folder / "sent.tlog").exists() and subject.poll() is None:
            time.sleep(0.05)
        command = [args.mavlink_check, "station", "--listen", f"udpout:127.0.0.1:{port}", "--time", "24", "--key-file", str(key), "--phrase-file", str(phrase),
                   "--logs", str(folder / "sent.tlog"), "--quiet", "--no-repeat", "--json", str(report),
                   # The clock of the subject is its own: it sets none of the computer's.
                   "--system-time", *(["--strict", "--rule", fault if fault in STATION_FAULTS else "SIGN-027"] if fault else [])]
        try:
            subprocess.run(command, capture_output=True, text=True, timeout=args.limit)
        except subprocess.TimeoutExpired:
            pass
        crashed = subject.poll() is not None
        subject.kill()
        subject.wait()
        rules = json.loads(report.read_text())["rules"] if report.exists() else []
    found = {rule["id"]: (rule["verdict"], rule["reason"]) for rule in rules}
    shown = found.get(fault) if fault in STATION_FAULTS else {rule: verdict for rule, verdict in found.items() if verdict[0] != "pass"}
    print(f"station {fault or 'lawful'}{' (subject crashed)' if crashed else ''}: {shown}", flush=True)
    return fault, found


def wanted(fault):
    """The rule of a fault, and what gives a passive rule something to look at."""
    passive = ("FRAME-001", "FRAME-008", "FRAME-009", "HB-001", "SIGN-002", "SIGN-010", "SIGN-014", "SIGN-015", "SIGN-016", "SIGN-028", "PARAM-010")
    return [fault, "SIGN-040" if fault != "PARAM-010" else "PARAM-003"] if fault in passive else [fault]


def table(done, routers, stations):
    lawful = next((found for fault, found in done if not fault), {})
    lines = [HEAD, "## The lawful autopilot", "", "| verdict | rules |", "|---|---|"]
    for verdict in ("pass", "warning", "inconclusive", "not_applicable", "fail", "flaky"):
        ids = [rule for rule, found in lawful.items() if found[0] == verdict]
        if ids:
            lines.append(f"| {verdict} | {len(ids)}{'' if verdict == 'pass' else ': ' + ', '.join(ids)} |")
    lines += ["", "## Faults", "", "| rule | the autopilot | verdict |", "|---|---|---|"]
    for fault, found in done:
        if fault:
            lines.append(f"| {fault} | {FAULTS[fault]} | {found.get(fault, ('no end',))[0]} |")
    caught = sum(found.get(fault, ("",))[0] in ("fail", "flaky") for fault, found in done if fault)
    without = sorted(set(lawful) - set(FAULTS))
    lines += ["", f"{caught} of {len([1 for fault, _ in done if fault])} faults are found.", "", "Rules of an autopilot without a fault: " + (", ".join(without) or "none") + "."]
    return "\n".join(lines) + "\n" + router_table(routers) + station_table(stations)


def router_table(done):
    lawful = next((found for fault, found in done if not fault), {})
    passed = [rule for rule, found in lawful.items() if found[0] == "pass"]
    others = [f"{rule} {found[0]}" for rule, found in lawful.items() if found[0] != "pass"]
    lines = ["", "## A router", "", f"The lawful router passes {len(passed)} rules; others: {', '.join(others) or 'none'}.", "", "| rule | the router | verdict |", "|---|---|---|"]
    lines += [f"| {fault} | {ROUTER_FAULTS[fault]} | {found.get(fault, ('no end',))[0]} |" for fault, found in done if fault]
    without = sorted(set(lawful) - set(ROUTER_FAULTS))
    lines += ["", "Rules of a router without a fault: " + (", ".join(without) or "none") + " (a *may* never fails)."]
    return "\n".join(lines) + "\n"


def station_table(done):
    lawful = next((found for fault, found in done if not fault), {})
    passed = [rule for rule, found in lawful.items() if found[0] == "pass"]
    others = [f"{rule} {found[0]}" for rule, found in lawful.items() if found[0] != "pass"]
    rotated = next((found.get("SIGN-027", ("no end",))[0] for fault, found in done if fault == "rotation"), "not run")
    lines = ["", "## A ground station", "", f"The lawful station passes {len(passed)} rules; others: {', '.join(others) or 'none'}. SIGN-027 on a lawful change of keys: {rotated}.", "",
             "| rule | the station | verdict |", "|---|---|---|"]
    lines += [f"| {fault} | {STATION_FAULTS[fault]} | {found.get(fault, ('no end',))[0]} |" for fault, found in done if fault in STATION_FAULTS]
    without = sorted(set(lawful) - set(STATION_FAULTS))
    lines += ["", "Rules of a station without a fault: " + (", ".join(without) or "none") + "."]
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description="Prove mavlink-check on a Python autopilot and its faults.")
    parser.add_argument("--mavlink-check", default="target/debug/mavlink-check", metavar="PROGRAM")
    parser.add_argument("--only", action="append", metavar="RULE", help="just this fault, or 'lawful' (repeat)")
    parser.add_argument("--routers", action="store_true", help="only the routers; --out is written with their table alone")
    parser.add_argument("--stations", action="store_true", help="only the ground stations; --out is written with their table alone")
    parser.add_argument("--at-once", type=int, default=6, help="number of runs side by side")
    parser.add_argument("--limit", type=float, default=240, metavar="S", help="time for one run")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the table here")
    parser.add_argument("--restart", type=Path, metavar="DIR", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.restart:
        stop(args.restart)
        start(args.restart)
        return
    def chosen(faults):
        return [fault for fault in (None, *faults) if not args.only or (fault or "lawful") in args.only]

    def run(judge_one, faults):
        return list(pool.map(lambda fault: judge_one(fault, args), chosen(faults)))

    with ThreadPoolExecutor(args.at_once) as pool:
        done = [] if args.routers or args.stations else run(judge, FAULTS)
        routers = [] if args.stations else run(judge_router, ROUTER_FAULTS)
        stations = [] if args.routers else run(judge_station, (*STATION_FAULTS, *([] if args.only else ["rotation"])))
    text = router_table(routers) if args.routers else station_table(stations) if args.stations else table(done, routers, stations)
    wrong = [rule for fault, found in stations if fault == "rotation" for rule, verdict in found.items() if verdict[0] != "pass"]
    done += routers + [(fault, found) for fault, found in stations if fault != "rotation"]
    if args.out:
        args.out.write_text(text)
    missed = [fault for fault, found in done if fault and found.get(fault, ("",))[0] not in ("fail", "flaky")]
    wrong += [rule for fault, found in done if not fault for rule, verdict in found.items() if verdict[0] in ("fail", "flaky")]
    print(f"missed: {missed or 'none'}; failed on the lawful: {wrong or 'none'}")
    sys.exit(1 if missed or wrong else 0)


if __name__ == "__main__":
    main()
