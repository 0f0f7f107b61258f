#!/usr/bin/env python3
"""Times the upload of a long route through the bridge beside pymavlink's own upload and read-back of the same items.

    upload_time.py --bin target/release [--waypoints 500] [--turns 5] [--baud 57600]

Each has a `px4-sim` of its own, and they take turns; nothing is signed. Through the bridge the time runs from the first 13001 to the
14000 that reports the route as loaded, for pymavlink from MISSION_COUNT to its last MISSION_ACK. Prints medians, fastest and
slowest, and the bytes of the mission frames on the way to the vehicle and back. With `--baud` both run over a pseudo terminal that
carries so much each way, and the bridge has it as `rate_bps`. Ends with 1 where the bridge takes over 1.3 times as long,
without `--baud`.
"""
import argparse
import ctypes
import multiprocessing
import os
import select
import socket
import statistics
import subprocess
import sys
import tempfile
import time
import tty
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil  # noqa: E402
from pymavlink.dialects.v20 import common as m  # noqa: E402

import cucs as dli  # noqa: E402
from cucs import Cucs, Failure, reference  # noqa: E402
from route import AGL, Point, Route, rad_to_bam  # noqa: E402

ALLOWED = 1.3
CUCS_ID, SPEED_MS, STEP_M = 0x1B0000A0, 5.0, 20.0
MISSION_FRAMES = {39, 40, 43, 44, 45, 47, 51, 73}
# What a line holds that waits for its turn, s; more is lost.
HOLDS_S = 1.0
# PX4's streams to a ground station on its simulator's link, which no radio carries.
FAST_STREAMS = (24, 30, 31, 32, 33, 36, 74, 83, 85)


@dataclass
class Way:
    """One direction of a line: the frames that wait, and the bytes counted (of missions, of all)."""

    bytes_s: float
    counted: object
    at: int
    waiting: deque = field(default_factory=deque)
    rest: bytes = b""
    free_at: float = 0.0

    def take(self, data, now):
        """Splits a stream into MAVLink 2 frames, so that a datagram never ends inside one."""
        self.rest += data
        while True:
            begin = self.rest.find(b"\xfd")
            self.rest = self.rest[begin:] if begin >= 0 else b""
            if len(self.rest) < 12:
                return
            length = 12 + self.rest[1] + 13 * (self.rest[2] & 1)
            if len(self.rest) < length:
                return
            frame, self.rest = self.rest[:length], self.rest[length:]
            if self.free_at > now + HOLDS_S:
                continue
            self.free_at = max(now, self.free_at) + length / self.bytes_s
            self.waiting.append((self.free_at, frame))
            self.counted[self.at + 1] += length
            if int.from_bytes(frame[7:10], "little") in MISSION_FRAMES:
                self.counted[self.at] += length

    def due(self, now):
        """The frames that have left the line."""
        while self.waiting and self.waiting[0][0] <= now:
            yield self.waiting.popleft()[1]


def carry(vehicle, near, counted, bytes_s):
    """The line, a process of its own: between the vehicle's datagrams and a socket or terminal, until it is killed."""
    up, down = (Way(bytes_s, counted, at) for at in (0, 2))
    peer = None
    fd = near if isinstance(near, int) else near.fileno()
    while True:
        now = time.monotonic()
        waits = [way.waiting[0][0] - now for way in (up, down) if way.waiting]
        for ready in select.select([vehicle, near], [], [], max(0.0, min(waits, default=0.5)))[0]:
            try:
                if ready is vehicle:
                    data, peer = vehicle.recvfrom(4096)
                    down.take(data, time.monotonic())
                else:
                    up.take(os.read(fd, 4096), time.monotonic())
            # A program that is not there yet.
            except OSError:
                pass
        now = time.monotonic()
        for frame in up.due(now):
            if peer:
                vehicle.sendto(frame, peer)
        for frame in down.due(now):
            try:
                os.write(fd, frame)
            except OSError:
                pass


class Line:
    """A vehicle behind a line that counts; `link` is the end for the bridge, `device` for pymavlink."""

    def __init__(self, options):
        vehicle = udp()
        self.counted = multiprocessing.Array(ctypes.c_uint64, 4, lock=False)
        if options.baud:
            near, self._far = os.openpty()
            tty.setraw(self._far)
            os.set_blocking(near, False)
            self.device = os.ttyname(self._far)
            self.link = f"serial:{self.device}:{options.baud}"
        else:
            port = free_port()
            near = udp()
            near.connect(("127.0.0.1", port))
            self.link = f"udpin:127.0.0.1:{port}"
            self.device = self.link
        bytes_s = options.baud / 10 if options.baud else float("inf")
        self._carrier = multiprocessing.get_context("fork").Process(
            target=carry, args=(vehicle, near, self.counted, bytes_s), daemon=True)
        self._carrier.start()
        port = vehicle.getsockname()[1]
        self.sim = subprocess.Popen([options.bin / "px4-sim", "--link", f"udpout:127.0.0.1:{port}"],
                                    stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def close(self):
        self.sim.kill()
        self.sim.wait()
        self._carrier.terminate()
        self._carrier.join()


@dataclass
class Turn:
    """One measurement: seconds, and bytes up and down as (of missions, of all)."""

    seconds: float
    bytes: tuple


def measured(line, work):
    before = list(line.counted)
    seconds = work()
    return Turn(seconds, tuple(now - then for now, then in zip(line.counted, before)))


class Direct:
    """pymavlink, as its examples do it: item by item on request, then read back and compared."""

    def __init__(self, options):
        self.line = Line(options)
        self.link = mavutil.mavlink_connection(self.line.device, baud=options.baud or 115_200, source_system=255)
        self.link.wait_heartbeat(timeout=20)
        if options.baud:
            for _ in range(3):
                for stream in FAST_STREAMS:
                    self.link.mav.command_long_send(1, 1, m.MAV_CMD_SET_MESSAGE_INTERVAL, 0, stream, -1, 0, 0, 0, 0, 0)
                    self.link.recv_match(blocking=True, timeout=0.1)
            time.sleep(2)

    def turn(self, points, start):
        items = [(m.MAV_FRAME_MISSION, m.MAV_CMD_DO_CHANGE_SPEED, (1, SPEED_MS, -1, 0), 0, 0, 0)]
        for point in points:
            latitude, longitude = (round(rad * 57.29577951308232 * 1e7) for rad in point.place(start))
            items.append((m.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, m.MAV_CMD_NAV_WAYPOINT, (0, 0, 0, float("nan")),
                          latitude, longitude, point.up))
        # What came during the other's turn is not read within this one.
        while self.link.recv_msg():
            pass
        return measured(self.line, lambda: self._upload(items))

    def _upload(self, items):
        mav, begun = self.link.mav, time.monotonic()
        mav.mission_count_send(1, 1, len(items))
        while (asked := self._next("MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK")).get_type() != "MISSION_ACK":
            frame, command, params, x, y, z = items[asked.seq]
            mav.mission_item_int_send(1, 1, asked.seq, frame, command, asked.seq == 0, 1, *params, x, y, z)
        if asked.type != m.MAV_MISSION_ACCEPTED:
            raise Failure(f"pymavlink's upload: MISSION_ACK type {asked.type}, expected 0")
        mav.mission_request_list_send(1, 1)
        count = self._next("MISSION_COUNT").count
        for seq, (_, command, _, x, y, _) in enumerate(items[:count]):
            mav.mission_request_int_send(1, 1, seq)
            while (item := self._next("MISSION_ITEM_INT")).seq != seq:
                pass
            if (item.command, item.x, item.y) != (command, x, y):
                raise Failure(f"pymavlink's read-back: item {seq} is {item}, expected command {command} at {x}, {y}")
        mav.mission_ack_send(1, 1, m.MAV_MISSION_ACCEPTED)
        if count != len(items):
            raise Failure(f"pymavlink's read-back: {count} items, expected {len(items)}")
        return time.monotonic() - begun

    def _next(self, *names):
        message = self.link.recv_match(type=list(names), blocking=True, timeout=10)
        if message is None:
            raise Failure(f"the vehicle sent no {' or '.join(names)} within 10 s")
        return message

    def close(self):
        self.link.close()
        self.line.close()


class Bridge:
    """`vsm run`, and a ground station that sends it the route."""

    def __init__(self, options, folder):
        self.line, self.waits = Line(options), 600 if options.baud else 60
        dli_port = free_port()
        rate = f"rate_bps = {options.baud}\n" if options.baud else ""
        (folder / "vsm.toml").write_text(
            f'[dli]\nvsm_id = "1b:00:00:01"\nlisten = "127.0.0.1:{dli_port}"\n[[cucs]]\nid = "{dli.text(CUCS_ID)}"\n'
            f'loi = [2, 3, 4, 5]\n[[vehicle]]\nid = "1b:00:01:01"\nlink = "{self.line.link}"\n{rate}system_id = 1\n'
            'signing = "off"\ncurve = { max_items = 2000 }\n[store]\ndir = "state"\n')
        self.log = open(folder / "vsm.log", "w")
        self.vsm = subprocess.Popen([options.bin / "vsm", "run", "--config", folder / "vsm.toml"],
                                    stdout=self.log, stderr=self.log)
        self.cucs = c = Cucs(("127.0.0.1", dli_port), CUCS_ID, bind=("127.0.0.1", 0))
        c._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        c.discover(20)
        granted = c.authority(dli.LOI_2 | dli.LOI_4 | dli.LOI_5, dli.REQUEST, 5).fields.get("LOI Granted")
        if granted != 0xD:
            raise Failure(f"#2 grants LOI bits {granted}, expected 0xd")
        c.wait(lambda received: received.id == 4000 and "Latitude" in received.fields, 60, what="a position")
        c.pump(20 if options.baud else 8)
        self.start = c.position()

    def turn(self, points):
        # The messages are made before: this measures the bridge, not the speed of Python's encoder.
        c, route = self.cucs, Route("LONG", points[0].number, tuple(points))
        values = [route.definition(c), *(point.message(c, self.start, ack=True) for point in points)]
        wires = [reference.encode(value) for value in values]
        return measured(self.line, lambda: self._load(route, wires))

    def _load(self, route, wires):
        c, since, begun = self.cucs, self.cucs.mark(), time.monotonic()
        for at in range(0, len(wires), CHUNK):
            for wire in wires[at:at + CHUNK]:
                c.transmit_bytes(wire)
            stored = min(at + CHUNK, len(wires)) - 1
            self._until(lambda: self._stored(since) >= stored, f"{stored} acknowledgements (17000)")
        c.transmit(route.load(c, "LONG"))
        ended = c.wait(lambda received: received.id == 14000 and received.fields.get("Status") in (1, 2), self.waits, since,
                       "the end of the load (14000)")
        if ended.fields["Status"] != 1:
            texts = [received.fields.get("Text", "") for received in c.inbox[since:] if received.id == 16000]
            raise Failure(f"the bridge refused the route: {texts}")
        return ended.at - begun

    def _stored(self, since):
        return sum(received.id == 17000 and received.fields.get("Acknowledgement Type") == dli.CARRIED_OUT
                   for received in self.cucs.inbox[since:])

    def _until(self, so, what):
        end = time.monotonic() + 20
        while not so():
            if time.monotonic() > end:
                raise Failure(f"{what} did not come within 20 s")
            self.cucs.pump(0.0)

    def close(self):
        self.cucs.close()
        self.vsm.terminate()
        self.vsm.wait()
        self.log.close()
        self.line.close()


# As many messages as a station may have unanswered.
CHUNK = 50


def udp():
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    s.bind(("127.0.0.1", 0))
    return s


def free_port():
    with udp() as s:
        return s.getsockname()[1]


def route(count, height_m):
    """A zigzag; another height makes another plan, since PX4 ignores one that it already holds."""
    return [Point(number, number + 1 if number < count else 0, STEP_M * number, 30.0 * (number % 2), height_m, SPEED_MS, AGL)
            for number in range(1, count + 1)]


def line(name, turns):
    """A row of the table."""
    seconds = [turn.seconds for turn in turns]
    middle = statistics.median(seconds)
    up, all_up, down, all_down = (statistics.median(turn.bytes[at] for turn in turns) for at in range(4))
    print(f"| {name} | {middle:.2f} s | {min(seconds):.2f} to {max(seconds):.2f} s | {up:.0f} | {down:.0f} | {all_up + all_down:.0f} |")
    return middle


def main():
    parser = argparse.ArgumentParser(description="Time the upload of a route through the bridge beside pymavlink's own.")
    parser.add_argument("--bin", type=Path, required=True, help="folder of vsm and px4-sim")
    parser.add_argument("--waypoints", type=int, default=500)
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--baud", type=int, help="a pseudo terminal that carries this, such as 57600, in place of UDP")
    options = parser.parse_args()
    ends = []
    with tempfile.TemporaryDirectory() as folder:
        try:
            ends.append(bridge := Bridge(options, Path(folder)))
            ends.append(direct := Direct(options))
            turns = {bridge: [], direct: []}
            for turn in range(options.turns):
                points = route(options.waypoints, 30.0 + turn)
                turns[bridge].append(bridge.turn(points))
                bridge.cucs.pump(1.0)
                turns[direct].append(direct.turn(points, bridge.start))
        finally:
            for end in ends:
                end.close()
    where = f"{options.baud} baud" if options.baud else "UDP"
    print(f"| {options.waypoints} waypoints, {where}, {options.turns} turns | median | fastest and slowest | mission bytes up | down | all bytes |")
    print("|---|---|---|---|---|---|")
    through = line("`vsm run`, first 13001 to 14000", turns[bridge])
    alone = line("pymavlink, upload and read-back", turns[direct])
    print(f"\n{through / alone:.2f} times pymavlink's")
    sys.exit(not options.baud and through > ALLOWED * alone)


if __name__ == "__main__":
    main()
