#!/usr/bin/env python3
"""pymavlink uploads a mission and reads it back, signed: what `cargo bench -p vsm --bench flight` measures the bridge beside.

    mission_upload.py PORT KEY COUNT

The vehicle sends to PORT. Each line of standard input is an altitude, m above home: one turn with that many waypoints, whose
seconds are printed. The plan before it is cleared first, which is not counted.
"""
import os
import select
import sys
import time

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil  # noqa: E402

PORT, KEY, COUNT = sys.argv[1], bytes.fromhex(sys.argv[2]), int(sys.argv[3])
RELATIVE_INT, NAV_WAYPOINT, ACCEPTED = 6, 16, 0


def item(seq, altitude):
    """Ten metres apart to the north of the simulator's home."""
    return 473_977_434 + 900 * seq, 85_455_939, altitude


class Client:
    def __init__(self):
        self.link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{PORT}", source_system=245, source_component=190, dialect="common")
        self.link.setup_signing(KEY, sign_outgoing=True, allow_unsigned_callback=None)
        self.link.wait_heartbeat()

    def next_line(self):
        """Telemetry is read meanwhile: a socket that is full would lose the first answers of the next turn."""
        while True:
            readable = select.select([sys.stdin, self.link.port], [], [])[0]
            if self.link.port in readable:
                self.drain()
            if sys.stdin in readable:
                return sys.stdin.readline()

    def drain(self):
        while self.link.recv_msg() is not None:
            pass

    def receive(self, *kinds):
        message = self.link.recv_match(type=list(kinds), blocking=True, timeout=5)
        if message is None:
            sys.exit(f"no {' or '.join(kinds)} within 5 s")
        return message

    def clear(self):
        self.link.mav.mission_clear_all_send(1, 1)
        self.receive("MISSION_ACK")
        time.sleep(0.2)
        self.drain()

    def upload(self, altitude):
        self.link.mav.mission_count_send(1, 1, COUNT)
        while True:
            request = self.receive("MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK")
            if request.get_type() == "MISSION_ACK":
                assert request.type == ACCEPTED, request
                return
            place = item(request.seq, altitude)
            self.link.mav.mission_item_int_send(1, 1, request.seq, RELATIVE_INT, NAV_WAYPOINT, 0, 1, 0, 0, 0, float("nan"), *place)

    def read_back(self, altitude):
        self.link.mav.mission_request_list_send(1, 1)
        count = self.receive("MISSION_COUNT").count
        assert count == COUNT, count
        for seq in range(COUNT):
            self.link.mav.mission_request_int_send(1, 1, seq)
            aboard = self.receive("MISSION_ITEM_INT")
            assert (aboard.seq, aboard.x, aboard.y, aboard.z) == (seq, *item(seq, altitude)), aboard
        self.link.mav.mission_ack_send(1, 1, ACCEPTED)


def main():
    client = Client()
    print("ready", flush=True)
    while line := client.next_line():
        altitude = float(line)
        client.clear()
        begun = time.perf_counter()
        client.upload(altitude)
        client.read_back(altitude)
        print("seconds", time.perf_counter() - begun, flush=True)


if __name__ == "__main__":
    main()
