#!/usr/bin/env python3
"""The operator of the second CUCS: does the steps of `dli-check cucs` and answers its questions, over the control port.

    cucs_operator.py PORT STEP                 ends with 0: done, or yes; 1: no; 2: the CUCS does not answer
    cucs_operator.py --profile PORT [FAULT]    the profile that has the second CUCS judged without a person

A question is answered by the picture that the CUCS returns. What has to be tried first is tried: `radius-outside` orders a
radius of 10 m and looks whether it was refused.
"""
import json
import socket
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
WARNING, CAUTION, UPDATED = "FIRST WARNING", "A CAUTION", "NOW A WARNING"
UNAVAILABLE, LOITER = {16, 17, 22}, 12
# Where the scripted vehicle is, in rad, and five degrees away from it.
LATITUDE, NEAR = 0.679, 0.02
# A route there, at the vehicle's altitude.
UPLOAD = "upload:38.9,-77.06,120"


def texts(picture):
    return sorted(alert["text"] for alert in picture["alerts"].values() if alert["text"] != "SCRIPTED ALERT")


def in_control(picture):
    return bool(picture["loi"] & 12)


def near(picture):
    return picture["position"] is not None and abs(picture["position"][0] - LATITUDE) < NEAR


EYES = {
    "radius-outside": ("radius:10", lambda p: not p["done"]),
    "radius-beyond": ("radius:900", lambda p: not p["done"]),
    "mode-unavailable": ("show", lambda p: not UNAVAILABLE & set(p["offered_modes"])),
    "mode-withdrawn": ("show", lambda p: LOITER not in p["offered_modes"]),
    "mode-returned": ("show", lambda p: LOITER in p["offered_modes"]),
    "alerts": ("show", lambda p: texts(p) == sorted((WARNING, CAUTION))),
    "alert-updated": ("show", lambda p: texts(p) == sorted((WARNING, UPDATED))),
    "alert-removed": ("show", lambda p: texts(p) == [UPDATED]),
    "low-energy": ("show", lambda p: any("warning" in warning for warning in p["warnings"])),
    "position-lost": ("show", lambda p: near(p) and not p["fresh"]),
    "upload-stuck": (UPLOAD, lambda p: p["mission"] == "loaded"),
    "upload-rejected": (UPLOAD, lambda p: p["mission"] == "loaded"),
    "not-in-control": ("show", in_control),
    "still-in-control": ("show", in_control),
    "damaged-grant": ("show", lambda p: in_control(p) or p["position"] is not None and not near(p)),
    "asked": ("show", lambda p: p["handover_requested_by"] == 0x1B0000B7 and in_control(p)),
    "mode-unconfirmed": ("mode:12", lambda p: not p["done"] and 2016 in p["not_confirmed"]),
}
# What the CUCS itself is ordered to do. What a scenario does not grant is left out by a lawful station.
ORDERS = {
    "search": ["discover"], "take": ["discover", "take:4", "station:1"], "take-again": ["take:4"], "station": ["discover", "station:1"],
    "configure": ["configure"], "upload": [UPLOAD], "radius": ["radius:180"], "mode": ["mode:12"],
    "try-commands": ["radius:180", "mode:12"], "refuse": ["refuse"], "release": ["release"],
}


def order(port, step, seconds=20.0):
    """Has the running CUCS do a step; its answer with the picture. One that has just been started is waited for."""
    begun = time.monotonic()
    while True:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
            s.settimeout(seconds)
            s.connect(("127.0.0.1", port))
            try:
                s.send(step.encode())
                return json.loads(s.recv(65535))
            except ConnectionRefusedError:
                if time.monotonic() - begun > seconds:
                    raise
                time.sleep(0.05)


def profile(port, faults):
    """The commands of `[on]`, one for each step."""
    python, cucs, own = sys.executable, HERE / "second_cucs.py", Path(__file__).resolve()
    options = " ".join(f"--fault {fault}" for fault in faults)
    lines = ["[subject]", 'name = "second CUCS"', "[on]", f'start = "exec {python} {cucs} --vsm {{vsm}} --control {port} {options}"']
    return "\n".join(lines + [f'{step} = "{python} {own} {port} {step}"' for step in (*ORDERS, *EYES)]) + "\n"


def do(port, step):
    """The exit status of a step."""
    if step in ORDERS:
        for what in ORDERS[step]:
            # Not being able to do what a scenario denies is lawful; the wire says what was done.
            order(port, what)
        return 0
    what, seen = EYES[step]
    try:
        # A lawful station waits a minute for a load that never ends: one that answers at once took it for done.
        return 0 if seen(order(port, what, 4.0 if step == "upload-stuck" else 20.0)) else 1
    except TimeoutError:
        return 1 if step == "upload-stuck" else 2


def main():
    if sys.argv[1] == "--profile":
        print(profile(int(sys.argv[2]), sys.argv[3:]), end="")
        return
    try:
        sys.exit(do(int(sys.argv[1]), sys.argv[2]))
    except (OSError, ValueError) as error:
        print(f"cucs_operator: {sys.argv[2]}: {error}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
