"""What shows each fault of the second VSM: short scenarios that return what was observed."""
import itertools
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import cucs as dli
from cucs import Cucs, Failure, reference

PROGRAM = Path(__file__).resolve().parent / "second_vsm.py"
EARTH_M = 6_371_000.0
HOME = (0.8272468, 0.1491488)
VEHICLE, OTHER_VEHICLE = 0x1B000101, 0x1B000102
MODE = "Select Flight Path Control Mode"
QUIET_S = 0.6


class Subject:
    """A second VSM in a process of its own, and the stations that talk to it."""

    def __init__(self, options):
        self.directory = tempfile.TemporaryDirectory()
        self.port, self.control = free_port(), free_port()
        self.options = [option.replace("{dir}", self.directory.name) for option in options]
        self.stations = []

    def __enter__(self):
        self.start()
        return self

    def __exit__(self, *_):
        for station in self.stations:
            station.close()
        self.kill()
        self.directory.cleanup()

    def start(self):
        self.process = subprocess.Popen([sys.executable, str(PROGRAM), "--port", str(self.port), "--control", str(self.control), *self.options],
                                        stderr=subprocess.PIPE, text=True)
        line = self.process.stderr.readline()
        if "ready" not in line:
            raise RuntimeError(f"the second VSM did not start: {line}{self.process.stderr.read()}")

    def kill(self):
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()
        self.process.stderr.close()

    def order(self, words):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
            s.settimeout(2)
            s.sendto(words.encode(), ("127.0.0.1", self.control))
            assert s.recv(1000) == b"done"

    # Stations

    def cucs(self, last, style=None):
        station = Cucs(("127.0.0.1", self.port), 0x1B000000 | last, heartbeat=False)
        station.vehicle, station.vsm_id = VEHICLE, -1
        if style is not None:
            make = station.make
            station.make = lambda id, fields, ack=False, to=None, style=style: make(id, fields, ack, to, style)
        self.stations.append(station)
        return station

    def taken(self, last, loi=15, style=(32, 2)):
        station = self.cucs(last, style)
        station.authority(loi, dli.REQUEST, 2)
        return station

    @staticmethod
    def waypoint(number, following, north, east, **more):
        return {"Waypoint Number": number, "Waypoint to Latitude or Relative Y": dli.rad_to_bam(HOME[0] + north / EARTH_M, 32),
                "Waypoint to Longitude or Relative X": dli.rad_to_bam(HOME[1] + east / EARTH_M / 0.677, 32), "Location Type": 0,
                "Waypoint to Altitude": 25_999, "Waypoint Altitude Type": 1, "Waypoint to Speed": 24, "Waypoint Speed Type": 2,
                "Next Waypoint": following, "Turn Type": 0, **more}

    def upload(self, station, points, first=None, **more):
        station.send(13001, {"Initial Waypoint Number": first or points[0][0], "Route ID": "R", "Route Type": 2})
        for point in points:
            station.send(13002, self.waypoint(*point, **more))

    def load(self, station, mission="M"):
        """The status that ends a load, 1 or 2; None where none comes."""
        since = station.mark()
        station.send(13000, {"Mission ID": mission, "Mission Plan Mode": 2})
        try:
            return station.wait(lambda m: m.id == 14000 and m.fields["Status"] != 0, 4, since).fields["Status"]
        except Failure:
            return None

    def plan(self, station, mode=3):
        """What a download gives: the waypoints, without stamps."""
        since = station.mark()
        station.send(13000, {"Mission ID": "D", "Mission Plan Mode": mode})
        try:
            station.wait(lambda m: m.id == 14000 and m.fields["Status"] != 0 and m.fields["Mission Plan Mode"] == mode, 4, since)
        except Failure:
            return None
        return sorted((sorted((k, v) for k, v in m.fields.items() if k != "Time Stamp") for m in station.inbox[since:] if m.id == 13002), key=str)

    def launch(self, station):
        station.command(2016, {MODE: 21, "Commanded Altitude": 26_500, "Altitude Type": 1}, 10)
        station.wait(lambda m: m.id == 3001 and m.fields[MODE] == 12, 20)


# Below the ports that the system hands out: one that was asked for and closed again would be given to the next socket of anybody.
FIRST_PORT, LAST_PORT = 22_000, 31_999
_ports, _taking = itertools.count(os.getpid() * 7919), threading.Lock()


def free_port():
    """A port that nobody has, and that nobody else in this process is given."""
    with _taking:
        for _ in range(LAST_PORT - FIRST_PORT):
            port = FIRST_PORT + next(_ports) % (LAST_PORT - FIRST_PORT)
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
                try:
                    s.bind(("127.0.0.1", port))
                except OSError:
                    continue
                return port
    raise RuntimeError(f"no free port from {FIRST_PORT} to {LAST_PORT}")


SCENARIOS = {}


def shows(*ids, options=()):
    def add(scenario):
        for id in ids:
            SCENARIOS[id] = (list(options), scenario)
        return scenario
    return add


def ask(station, id, **more):
    """The fields that 17002 brings, without their stamp; None where nothing comes."""
    since = station.mark()
    station.send(17002, {"Message Type": id, **more})
    try:
        m = station.wait(lambda m: m.id == id, 1.5, since)
    except Failure:
        return None
    return {k: v for k, v in m.fields.items() if k != "Time Stamp"}


def raw_datagrams(subject, *wires, seconds=QUIET_S):
    """The datagrams that come back for these, from a bare socket."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.settimeout(seconds)
        got = []
        for wire in wires:
            s.sendto(wire, ("127.0.0.1", subject.port))
        try:
            while True:
                got.append(s.recv(65535))
        except TimeoutError:
            return got


def discovery(source=0x1B0000A0, destination=0xFFFFFFFF, style=2, idd=32, **fields):
    return reference.encode({"id": 1, "source": source, "destination": destination, "ack": False, "idd": idd, "checksum": style,
                             "fields": {"Time Stamp": int((time.time() - dli.EPOCH_2000_S) * 1000), "VSM ID": -1,
                                        "Requested/Handover LOI": 0, "Requested/Handover Access": 0, **fields}})


def radius(station):
    report = ask(station, 3004)
    return report and report["Loiter Radius"]


# Wrapper

@shows("V01", "V03", "V05", "V07", "V13", "V18")
def header(subject):
    answer = raw_datagrams(subject, discovery())[0]
    blank = bytearray(answer)
    blank[19:24] = bytes(5)
    return bytes(blank[:40]), len(answer) - 16 - int.from_bytes(answer[2:4], "big"), sum(answer[:-4]) == int.from_bytes(answer[-4:], "big")


@shows("V02")
def vehicle_type(subject):
    return subject.cucs(0xA0).discover(2).fields["Vehicle Type"]


@shows("V04")
def damaged(subject):
    a = subject.taken(0xA0)
    wire = bytearray(reference.encode(a.make(2017, {"Loiter Radius": 99}, style=(32, 2))))
    wire[-1] ^= 1
    a.transmit_bytes(bytes(wire))
    return radius(a)


@shows("V06")
def large_sum(subject):
    a = subject.taken(0xA0)
    # 480 bytes of 255 add up to more than 65,535.
    unknown = reference.HEADER.pack(0, 480, a.id, a.vehicle, 50555, 0x2080) + b"\xff" * 480
    good = reference.encode(a.make(17002, {"Message Type": 3}, style=(32, 0)))
    since = a.mark()
    a.transmit_bytes(unknown + sum(unknown).to_bytes(4, "big") + good)
    a.pump(QUIET_S)
    return any(m.id == 3 for m in a.inbox[since:])


@shows("V08")
def two_in_one(subject):
    a = subject.taken(0xA0)
    since = a.mark()
    a.transmit(a.make(17002, {"Message Type": 3}), a.make(17002, {"Message Type": 3004}))
    a.pump(QUIET_S)
    return sorted({m.id for m in a.inbox[since:]} & {3, 3004})


@shows("V09")
def unknown_first(subject):
    a = subject.taken(0xA0)
    since = a.mark()
    a.transmit_bytes(reference.HEADER.pack(0, 2, a.id, a.vehicle, 24001, 0x2000) + b"\0\0" + reference.encode(a.make(17002, {"Message Type": 3})))
    a.pump(QUIET_S)
    return any(m.id == 3 for m in a.inbox[since:])


def configuration(subject):
    a = subject.taken(0xA0)
    since = a.mark()
    a.send(40000, {"Request Type": 3})
    a.pump(2.0)
    return a, [m for m in a.inbox[since:] if 41000 <= m.id <= 44003]


@shows("V10")
def longest(subject):
    return configuration(subject)[0].unreadable != []


@shows("V57")
def complete_last(subject):
    return configuration(subject)[1][0].id


@shows("V11")
def other_version(subject):
    a = subject.taken(0xA0)
    a.transmit(a.make(2017, {"Loiter Radius": 99}) | {"idd": 99})
    return radius(a)


@shows("V12")
def other_vehicle(subject):
    a = subject.taken(0xA0)
    a.send(2017, {"Loiter Radius": 99}, to=0x1B00EEEE)
    return radius(a)


# Numbers

def placed(subject):
    a = subject.taken(0xA0)
    return a, a.wait(lambda m: m.id == 4000, 2).fields


@shows("V14", "V15", options=["--home=-33.5,-70.6,500"])
def position(subject):
    fields = placed(subject)[1]
    return fields["Latitude"], fields["Longitude"]


@shows("V16", "V25")
def altitude(subject):
    return placed(subject)[1]["Altitude"]


@shows("V56")
def no_fix(subject):
    a, _ = placed(subject)
    subject.order("fix off")
    a.pump(0.5)
    return "Latitude" in a.wait(lambda m: m.id == 4000, 2).fields


@shows("V17", "V46")
def download(subject):
    a = subject.taken(0xA0)
    subject.upload(a, [(10, 40, 50.3, 0), (40, 20, 50.3, 50.7), (20, 0, 0, 33.3)])
    subject.load(a)
    return subject.plan(a)


@shows("V19")
def only_direction(subject):
    a = subject.taken(0xA0)
    a.send(2017, {"Loiter Direction": 2})
    return ask(a, 3004)


@shows("V20")
def radius_then_direction(subject):
    a = subject.taken(0xA0)
    a.send(2017, {"Loiter Radius": 100})
    a.send(2017, {"Loiter Direction": 2})
    return radius(a)


@shows("V21")
def text_filled(subject):
    a = subject.taken(0xA0)
    ask(a, 3)
    return len(a.unreadable)


@shows("V22")
def mode_on_the_ground(subject):
    return ask(subject.taken(0xA0), 3001)


@shows("V23")
def heading(subject):
    a = subject.taken(0xA0)
    return a.wait(lambda m: m.id == 4000, 2).fields["Heading"]


@shows("V24")
def climbing(subject):
    a = subject.taken(0xA0)
    since = a.mark()
    subject.launch(a)
    return any(m.fields["W_Speed"] < -20 for m in a.inbox[since:] if m.id == 4000)


# Discovery and authority

@shows("V26")
def broadcast_answered(subject):
    return len(raw_datagrams(subject, discovery()))


@shows("V27", options=["--vehicles", "2"])
def answers_of_two(subject):
    return len(raw_datagrams(subject, discovery()))


@shows("V28")
def granted_before(subject):
    return subject.cucs(0xA0).discover(2).fields["LOI Granted"]


@shows("V29")
def unlisted(subject):
    return len(raw_datagrams(subject, discovery(source=0x1B0000EE)))


@shows("V30")
def discovery_of_the_holder(subject):
    a = subject.taken(0xA0)
    return a.discover(2).fields["LOI Granted"]


@shows("V31")
def authorised(subject):
    return subject.cucs(0xA4).discover(2).fields["LOI Authorized"]


def takes_over(subject, access, last):
    subject.taken(0xA0)
    return subject.cucs(last).authority(4, access, 2).fields["LOI Granted"]


@shows("V32")
def second_request(subject):
    return takes_over(subject, dli.REQUEST, 0xA2)


@shows("V33")
def second_override(subject):
    return takes_over(subject, dli.OVERRIDE, 0xA2)


@shows("V34")
def after_override(subject):
    a = subject.taken(0xA0)
    subject.cucs(0xA1).authority(4, dli.OVERRIDE, 2)
    return a.command(2017, {"Loiter Radius": 99}, 1)[1]


@shows("V35")
def quiet_holder(subject):
    a = subject.taken(0xA0)
    for _ in range(8):
        a.pump(4.0)
        ask(a, 3)
    return a.command(2017, {"Loiter Radius": 99}, 1)[1]


@shows("V36")
def release_by_another(subject):
    a = subject.taken(0xA0)
    subject.cucs(0xA2).authority(4, dli.RELEASE, 2)
    return a.command(2017, {"Loiter Radius": 99}, 1)[1]


@shows("V37")
def command_without_right(subject):
    return subject.taken(0xA2, loi=1).command(2017, {"Loiter Radius": 99}, 1)[1]


def steer(station, stations):
    return station.command(19001, {"Station Number 1-16": stations, "Set Centreline Azimuth Angle": 5000}, 1)[1]


@shows("V38")
def payload_with_four(subject):
    return steer(subject.taken(0xA0, loi=4), 1)


@shows("V39")
def payload_of_the_other(subject):
    a = subject.cucs(0xA0)
    a.send(1, {"Requested/Handover LOI": 2, "Requested/Handover Access": 1, "Controlled Station 1-16": 1})
    a.pump(0.2)
    return steer(a, 2)


@shows("V40")
def launch_with_four(subject):
    return subject.taken(0xA0, loi=4).command(2016, {MODE: 21}, 1)[1]


@shows("V41")
def another_port(subject):
    subject.taken(0xA0)
    return subject.cucs(0xA0).command(2017, {"Loiter Radius": 99}, 1)[1]


# Missions

def with_plan(subject, points=((1, 2, 60, 0), (2, 0, 60, 60)), **more):
    a = subject.taken(0xA0)
    subject.upload(a, list(points), **more)
    assert subject.load(a) == 1
    return a


@shows("V42")
def waypoints_alone(subject):
    a = with_plan(subject)
    subject.upload(a, [(7, 8, 10, 0), (8, 0, 10, 10)])
    return subject.plan(a)


@shows("V43")
def order_of_flight(subject):
    a = with_plan(subject, [(30, 10, 60, 0), (10, 20, 60, 60), (20, 0, 0, 60)])
    subject.launch(a)
    a.command(2016, {MODE: 11}, 3)
    since = a.mark()
    return a.wait(lambda m: m.id == 4001 and m.fields["To Waypoint Number"] in (10, 20, 30), 3, since).fields["To Waypoint Number"]


def after_gap(subject):
    a = with_plan(subject)
    subject.upload(a, [(5, 6, 10, 0), (7, 0, 10, 10)])
    return subject.load(a), subject.plan(a)


@shows("V44", "V45")
def gap(subject):
    return after_gap(subject)


@shows("V47")
def loiter_in_a_route(subject):
    a = subject.taken(0xA0)
    a.send(13003, {"Waypoint Number": 1, "Waypoint Loiter Type": 4, "Loiter Duration": 10})
    subject.upload(a, [(1, 2, 40, 0), (2, 0, 40, 40)])
    subject.load(a)
    subject.launch(a)
    a.command(2016, {MODE: 11}, 3)
    a.pump(4.0)
    return a.latest(4001).fields["To Waypoint Number"] == 1


@shows("V48")
def above_ground(subject):
    a = subject.taken(0xA0)
    a.command(2016, {MODE: 21, "Commanded Altitude": 2000, "Altitude Type": 2}, 2)
    a.pump(2.0)
    return a.mode()


@shows("V49")
def complete_means_aboard(subject):
    a = with_plan(subject)
    subject.upload(a, [(5, 6, 10, 0), (6, 0, 10, 10)])
    subject.load(a)
    return subject.plan(a)


# Modes

@shows("V50")
def refused_mode(subject):
    a = subject.taken(0xA0)
    a.command(2016, {MODE: 12}, 1)
    a.pump(0.3)
    return a.mode()


@shows("V51")
def unsupported_mode(subject):
    a = subject.taken(0xA0)
    subject.launch(a)
    return a.command(2016, {MODE: 17}, 2)[1]


@shows("V52")
def execute_alone(subject):
    return subject.taken(0xA0).command(2005, {"Commanded Flight Termination State": 2}, 1)[1]


# Status

@shows("V53")
def rate(subject):
    a = subject.taken(0xA0)
    a.send(17001, {"Requested Message Type": 4000, "Frequency": 10})
    a.pump(0.3)
    since = a.mark()
    a.pump(2.0)
    return sum(m.id == 4000 for m in a.inbox[since:]) > 15


@shows("V54")
def cancel_of_another(subject):
    a, b = subject.taken(0xA0), subject.taken(0xA2, loi=1)
    for station in (a, b):
        station.send(17001, {"Requested Message Type": 3, "Frequency": 5})
    b.send(17001, {"Requested Message Type": 3, "Frequency": 0})
    a.pump(0.3)
    since = a.mark()
    a.pump(1.0)
    return any(m.id == 3 for m in a.inbox[since:])


@shows("V55")
def silent_vehicle(subject):
    a = subject.taken(0xA0)
    subject.order("link down")
    a.pump(3.0)
    since = a.mark()
    a.pump(1.0)
    return any(m.id == 4000 for m in a.inbox[since:])


@shows("V58")
def acknowledged(subject):
    return subject.taken(0xA0).command(2016, {MODE: 12}, 1)[1]


@shows("V59")
def repeated(subject):
    a = subject.taken(0xA0)
    first = a.make(2017, {"Loiter Radius": 50})
    a.transmit(first, a.make(2017, {"Loiter Radius": 60}), first)
    return radius(a)


@shows("V60")
def length_zero(subject):
    a = subject.taken(0xA0)
    a.transmit_bytes(reference.HEADER.pack(0, 0, a.id, a.vehicle, 1, 0x2000))
    return radius(a)


