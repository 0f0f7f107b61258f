"""The command line: steps of a script, one after the other, or ordered by a test."""
import argparse
import json
import math
import signal
import socket
import sys
import time

from second_vsm import units
from second_vsm.wire import parse_id

from .faults import FAULTS as KNOWN
from .faults_in_detail import IN_DETAIL
from .faults_of_habit import OF_HABIT
from .faults_of_practice import OF_PRACTICE
from .faults_of_values import OF_VALUES
from .station import OVERRIDE, Impossible, Station

FAULTS = KNOWN | IN_DETAIL | OF_HABIT | OF_PRACTICE | OF_VALUES
STEPS = """steps, in the order in which they are done:
  discover              search for vehicles; the first that answers is this station's
  take[:BITS]           request LOI bits (default 4: LOI 4), such as take:15
  override[:BITS]       the same against the CUCS in control
  station:N             request LOI 3 of payload station N
  monitor[:S]           receive for so many seconds (default 5)
  configure             run the configuration phase of LOI 4
  upload[:LAT,LON,ALT]  load a route of four points, with a loiter at the third, here at 520 m or at a place in degrees and m
  radius:M              set the loiter radius in metres
  mode:N                command flight path control mode N
  launch, land          modes 21 and 19, which need LOI 5
  point:AZ,EL           point station 1, in degrees
  heartbeat             send heartbeats from here on
  consent, refuse       answer a handover request
  clear:ID              clear an alert, as the operator
  show                  print what the operator sees, as JSON
  release               give all rights back
"""


class Script:
    """Does one step after the other."""

    def __init__(self, station):
        self.station = station

    def do(self, step):
        """One step; raises `Impossible` with the reason."""
        name, _, argument = step.partition(":")
        s = self.station
        simple = {"discover": s.discover, "configure": s.configure, "release": s.release, "show": self.show,
                  "heartbeat": self.heartbeat, "consent": lambda: s.answer_handover(True), "refuse": lambda: s.answer_handover(False),
                  "launch": self.launch, "land": lambda: self.confirmed(s.fly_mode(19))}
        if name in simple:
            simple[name]()
        elif name == "upload":
            self.upload(argument)
        elif name in ("take", "override"):
            s.take_control(int(argument or 4), *((OVERRIDE,) if name == "override" else ()))
        elif name == "station":
            s.take_control(2, stations=1 << int(argument) - 1)
        elif name == "monitor":
            if not s.display.loi:
                s.take_control(1)
            s.pump(float(argument or 5))
        elif name == "radius":
            self.confirmed(s.set_loiter(float(argument)))
        elif name == "mode":
            self.confirmed(s.fly_mode(int(argument)))
        elif name == "point":
            self.point(*(float(part) for part in argument.split(",")))
        elif name == "clear":
            s.display.clear_alert(int(argument))
        else:
            raise Impossible(f"there is no step {step!r}")

    def upload(self, place):
        s = self.station
        altitude = 520.0
        if place:
            *degrees, altitude = (float(part) for part in place.split(","))
            start = tuple(math.radians(part) for part in degrees)
        else:
            if s.display.position is None:
                s.pump(2.0)
            start = s.ahead(0, 0)
        corners = ((60, 0, 0), (60, 80, 0), (0, 80, 20), (0, 0, 0))
        s.upload([(*units.moved(start, north, east), altitude, loiter) for north, east, loiter in corners])

    def launch(self):
        self.confirmed(self.station.fly_mode(21, **{"Altitude Command Type": 1, "Commanded Altitude": round(518 / 0.02), "Altitude Type": 1}))

    def point(self, azimuth, elevation):
        self.station.must_hold(2)
        raw = [round(angle / 180 * 32768) for angle in (azimuth, elevation)]
        self.station.send(19001, {"Station Number 1-16": 1, "Set Centreline Azimuth Angle": raw[0], "Set Centreline Elevation Angle": raw[1]})

    def heartbeat(self):
        self.station.heartbeat_at = self.station.now()

    def show(self):
        print(json.dumps(self.station.display.picture(self.station.now())), flush=True)

    @staticmethod
    def confirmed(acknowledgement):
        if acknowledgement is None:
            raise Impossible("the command was not confirmed")
        if acknowledgement == 3:
            raise Impossible("the vehicle refuses the command")


def serve(station, script, port):
    """Takes steps from a control port until the program is stopped; answers each with the outcome and the picture."""
    stopped = []
    signal.signal(signal.SIGTERM, lambda *_: stopped.append(True))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        control.bind(("127.0.0.1", port))
        control.setblocking(False)
        while not stopped:
            station.pump(0.05)
            try:
                line, address = control.recvfrom(1000)
            except BlockingIOError:
                continue
            answer = {"done": True}
            try:
                script.do(line.decode().strip())
            except (Impossible, ValueError) as reason:
                answer = {"done": False, "reason": str(reason)}
            control.sendto(json.dumps(answer | station.display.picture(station.now())).encode(), address)


def order(port, step, seconds=120):
    """Has a running program do one step; what it answered."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.settimeout(seconds)
        s.sendto(step.encode(), ("127.0.0.1", port))
        return json.loads(s.recv(65535))


def parser():
    p = argparse.ArgumentParser(prog="second_cucs.py", description="Play a ground station, other than the project's own: a subject for the conformance suite.",
                                epilog=STEPS, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("steps", nargs="*", metavar="STEP", help="what to do, see below")
    p.add_argument("--vsm", default="127.0.0.1:4586", metavar="HOST:PORT", help="where the VSM listens")
    p.add_argument("--id", type=parse_id, default=parse_id("1b:00:00:a0"), help="this station's id; default 1b:00:00:a0")
    p.add_argument("--control", type=int, metavar="PORT", help="after the steps, take more of them on this UDP port")
    p.add_argument("--order", nargs=2, metavar=("PORT", "STEP"), help="have a running program do a step, and exit")
    p.add_argument("--keep-going", action="store_true", help="do the next step where one cannot be done")
    p.add_argument("--fault", "--mutant", action="append", default=[], choices=sorted(FAULTS), metavar="ID", help="build in a fault (repeat)")
    p.add_argument("--list-faults", "--list-mutants", action="store_true", help="print the faults and exit")
    return p


def main(arguments=None):
    args = parser().parse_args(arguments)
    if args.list_faults:
        for id, change in FAULTS.items():
            print(f"{id}  {change.title}")
        return
    if args.order:
        answer = order(int(args.order[0]), args.order[1])
        print(json.dumps(answer))
        sys.exit(0 if answer["done"] else 1)
    host, port = args.vsm.rsplit(":", 1)
    station = Station((host, int(port)), args.id)
    for id in args.fault:
        FAULTS[id].build(station)
    script, begun = Script(station), time.monotonic()
    for step in args.steps:
        try:
            script.do(step)
        except Impossible as reason:
            print(f"second_cucs: {step}: {reason}", file=sys.stderr)
            if not args.keep_going:
                sys.exit(1)
            continue
        print(f"{time.monotonic() - begun:7.2f} {step}: done", file=sys.stderr, flush=True)
    if args.control is not None:
        print(f"second_cucs: ready on 127.0.0.1:{args.control}", file=sys.stderr, flush=True)
        serve(station, script, args.control)
