#!/usr/bin/env python3
"""A ground station (CUCS) of Edition 2.5 that flies from discovery to release, by unicast or in a multicast group.

    cucs_ed25.py --vsm 127.0.0.1:4586 [--group 225.200.1.0:51017 --interface 127.0.0.1] [--id 1b:00:00:b0]

It stands on the reference codec in tests/data/dli and on nothing of this project. Everything that arrives must be a
whole message of Edition 2.5: version, length, sum, every field in its printed range. With --group it sends to the group
from one socket and receives from it on another, as the text means it. It needs an aircraft on the ground, disarmed.
Ends with 0 where every check held, else with 1. THE AIRCRAFT WILL ARM AND FLY.
"""
import argparse
import math
import select
import socket
import struct
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "data" / "dli"))
import reference_ed25 as oracle  # noqa: E402

BROADCAST, NULL = -1, -0x1000000
RELEASE, REQUEST = 0, 1
ALL_LEVELS = 0x0F
WAYPOINT, LOITER, AUTOLAND, LAUNCH = 11, 12, 19, 21
ABOVE_GROUND = 2
EARTH_M = 6_371_000.0


class Failure(Exception):
    """The other side did not do what the text says."""


class Cucs:
    """The station: fields by name out and in."""

    def __init__(self, options):
        self.id, self.vehicle, self.slow = options.id, BROADCAST, options.slow
        self.inbox, self.faults, self.sent = [], [], set()
        self.instance = int(time.time()) & 0xFFFFFF
        self.last_ms = 0
        self.sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.sender.bind((options.bind, 0))
        self.to, self.sockets = options.vsm, [self.sender]
        if options.group:
            self.to = options.group
            interface = socket.inet_aton(options.interface)
            self.sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, interface)
            receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            receiver.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if hasattr(socket, "SO_REUSEPORT"):
                receiver.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
            receiver.bind(options.group)
            receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(options.group[0]) + interface)
            self.sockets = [receiver]

    def send(self, id, **fields):
        """One message, stamped now; the keys are the names of the fields with _ for a space."""
        self.instance += 1
        self.last_ms = max(self.last_ms + 1, int(time.time() * 1000))
        named = {name.replace("_", " "): value for name, value in fields.items()}
        value = {"id": id, "instance": self.instance,
                 "fields": {"Time Stamp": self.last_ms / 1e3, "Vehicle ID": self.vehicle, "CUCS ID": self.id} | named}
        self.sent.add((id, self.instance))
        self.sender.sendto(oracle.encode(value), self.to)
        return self.instance

    def pump(self, seconds):
        end = time.monotonic() + seconds
        while (rest := end - time.monotonic()) > 0:
            for ready in select.select(self.sockets, [], [], rest)[0]:
                self.take(ready.recv(2048))

    def take(self, datagram):
        if datagram[:1] not in b"123456789":
            self.faults.append(f"not of Edition 2.5: {datagram.hex()}")
            return
        try:
            for value in oracle.decode_all(datagram):
                message = oracle.MESSAGES[value["id"]]
                if (message["direction"] == "CUCS->VSM" or (value["id"], value["instance"]) in self.sent
                        or cucs_of(value) != self.id and value["id"] not in (21, 700)):
                    continue  # its own message, or what is for others: the group carries all of them
                self.faults += [f"#{value['id']} {fault}" for fault in out_of_range(message, value["fields"])]
                self.inbox.append(value)
                # Whoever is asked to acknowledge does so (4.1.8).
                if value["id"] == 1403:
                    fields = value["fields"]
                    self.send(1400, VSM_ID=fields["VSM ID"], Data_Link_ID=NULL,
                              Original_Message_Time_Stamp=fields["Time Stamp"],
                              Original_Message_Instance_ID=value["instance"], Original_Message_Type=1403)
        except (ValueError, KeyError, struct.error) as fault:
            self.faults.append(f"{type(fault).__name__} {fault}: {datagram.hex()}")

    def latest(self, id):
        return next((m["fields"] for m in reversed(self.inbox) if m["id"] == id), None)

    def wait(self, what, wanted, timeout):
        """The first thing that `wanted` finds, by any message so far."""
        end = time.monotonic() + timeout * self.slow
        while (found := wanted()) is None or found is False:
            if time.monotonic() > end:
                texts = [m["fields"]["Text"] for m in self.inbox if m["id"] == 1100]
                raise Failure(f"{what}: not within {timeout:g} s; alerts {texts}")
            self.pump(0.05)
        print(f"ok  {what}", flush=True)
        return found

    def ask(self, what, id, timeout, answer, wanted, **fields):
        """Sends a message, again every second, until an answer that is wanted has come."""
        since, end = len(self.inbox), time.monotonic() + timeout * self.slow
        while True:
            self.send(id, **fields)
            again = time.monotonic() + 1.0
            while time.monotonic() < again:
                self.pump(0.05)
                for m in self.inbox[since:]:
                    if m["id"] == answer and wanted(m["fields"]):
                        print(f"ok  {what}", flush=True)
                        return m["fields"]
            if time.monotonic() > end:
                texts = [m["fields"]["Text"] for m in self.inbox if m["id"] == 1100]
                raise Failure(f"{what}: not within {timeout:g} s; alerts {texts}")


def cucs_of(value):
    return value["fields"].get("CUCS ID")


def out_of_range(message, fields):
    for field in message["fields"]:
        limits, raw = oracle.bounds(field), fields.get(field["name"])
        if limits is None or not isinstance(raw, (int, float)) or "config" in field.get("range", ""):
            continue
        low, high = limits[:2]
        value = raw * field.get("scale", 1)
        if not math.isfinite(value) or not low - 1e-6 <= value <= high + 1e-6:
            # 65535 is valid there by the field's own words (110.16).
            if (message["id"], field["n"]) != (110, 16):
                yield f"{field['name']} {value}, printed {field['range']}"


def fly(cucs):
    """From discovery to release."""
    offer = cucs.ask("discovery: #21", 1, 10, 21, lambda f: f["LOI Authorized"] != 0 and f["CUCS ID"] == cucs.id,
                     VSM_ID=BROADCAST, Data_Link_ID=NULL, Vehicle_ID=BROADCAST)
    assert offer["LOI Granted"] == 0 and offer["Controlled Station Mode"] == 0, offer
    cucs.vehicle = offer["Vehicle ID"]
    # Configuration comes before a grant.
    cucs.ask("configuration of LOI 4: #1203", 1200, 10, 1203, lambda f: True, VSM_ID=offer["VSM ID"], Request_Type=3)
    assert any(m["id"] == 1301 for m in cucs.inbox), "no #1301"
    granted = cucs.ask("control: #21", 1, 10, 21, lambda f: f["LOI Granted"] == ALL_LEVELS and f["CUCS ID"] == cucs.id,
                       VSM_ID=offer["VSM ID"], Data_Link_ID=NULL, **{"Requested/Handover_LOI": ALL_LEVELS},
                       Controlled_Station_Mode=REQUEST)
    assert granted["Controlled Station Mode"] == 1, granted
    home = cucs.wait("#101 with a position", lambda: cucs.latest(101), 10)
    latitude, longitude = home["Latitude"], home["Longitude"]

    def place(north, east):
        return latitude + north / EARTH_M, longitude + east / EARTH_M / math.cos(latitude)

    def away(north, east):
        f = cucs.latest(101)
        return math.hypot((f["Latitude"] - latitude) * EARTH_M - north,
                          (f["Longitude"] - longitude) * EARTH_M * math.cos(latitude) - east)

    # Acknowledgement by instance.
    cucs.send(1401, VSM_ID=offer["VSM ID"], Data_Link_ID=NULL, Message_Type=801)
    corners = [(101, 102, 40, 0), (102, 103, 40, 40), (103, 0, 0, 40)]
    for attempt in range(3):
        instance = cucs.send(801, Initial_Waypoint_Number=101, Route_ID="R1", Route_Type=2)
        for number, following, north, east in corners:
            y, x = place(north, east)
            cucs.send(802, Waypoint_Number=number, Waypoint_to_Latitude_or_Relative_Y=y,
                      Waypoint_to_Longitude_or_Relative_X=x, Waypoint_to_Altitude=20.0,
                      Waypoint_Altitude_Type=ABOVE_GROUND, Next_Waypoint=following)
        try:
            cucs.wait("#1400 for the route, by its instance", lambda: next(
                (m for m in cucs.inbox if m["id"] == 1400
                 and m["fields"]["Original Message Instance ID"] == instance
                 and m["fields"]["Original Message Type"] == 801), None), 3)
            break
        except Failure:
            if attempt == 2:
                raise
    cucs.ask("load: #900 complete", 800, 15, 900, lambda f: f["Status"] == 1, Mission_ID="M1", Mission_Plan_Mode=2)
    cucs.send(43, Altitude_Command_Type=1, Commanded_Altitude=20.0, Altitude_Type=ABOVE_GROUND)
    cucs.pump(0.2)
    cucs.send(42, Select_Flight_Path_Control_Mode=LAUNCH)
    ground = home["Altitude"]
    cucs.wait("launch to 20 m", lambda: cucs.latest(101)["Altitude"] - ground > 18, 20)
    cucs.send(42, Select_Flight_Path_Control_Mode=WAYPOINT)
    cucs.wait("#106 says waypoint", lambda: cucs.latest(106)["Select Flight Path Control Mode"] == WAYPOINT, 10)
    for number, _, north, east in corners:
        cucs.wait(f"waypoint {number}", lambda: away(north, east) < 8, 30)
    flown = {m["fields"]["To Waypoint Number"] for m in cucs.inbox if m["id"] == 110}
    assert {101, 102, 103} <= flown, flown
    cucs.ask("download: #900 complete", 800, 10, 900, lambda f: f["Status"] == 1, Mission_ID="M1", Mission_Plan_Mode=3)
    back = {m["fields"]["Waypoint Number"]: m["fields"] for m in cucs.inbox if m["id"] == 802}
    assert sorted(back) == [101, 102, 103], sorted(back)
    for number, following, north, east in corners:
        y, x = place(north, east)
        assert abs(back[number]["Waypoint to Latitude or Relative Y"] - y) < 3e-9, number
        assert back[number]["Next Waypoint"] == following, number
    cucs.send(41, Loiter_Type=1, Loiter_Radius=20.0, Loiter_Altitude=25.0, Altitude_Type=ABOVE_GROUND)
    cucs.pump(0.2)
    cucs.send(42, Select_Flight_Path_Control_Mode=LOITER)
    cucs.wait("loiter at the altitude of #41", lambda: cucs.latest(101)["Altitude"] - ground > 23.5, 20)
    cucs.send(48, Altitude_Mode=2, Speed_Mode=2, **{"Course/Heading_Mode": 2})
    cucs.wait("#109 reports the preference", lambda: cucs.latest(109) and cucs.latest(109)["Altitude Mode State"] == 2, 5)
    # What the VSM cannot do is refused by name.
    cucs.send(203)
    cucs.wait("a store is refused by #1100", lambda: next(
        (True for m in cucs.inbox if m["id"] == 1100 and "203" in m["fields"]["Text"]), None), 5)
    cucs.send(42, Select_Flight_Path_Control_Mode=AUTOLAND)
    cucs.wait("landed", lambda: cucs.latest(101)["Altitude"] - ground < 1 and abs(cucs.latest(101)["W_Speed"]) < 0.2, 40)
    cucs.pump(1.0)
    cucs.ask("release: #21", 1, 10, 21, lambda f: f["LOI Granted"] == 0 and f["CUCS ID"] == cucs.id,
             VSM_ID=offer["VSM ID"], Data_Link_ID=NULL, Controlled_Station_Mode=RELEASE)
    missing = {20, 21, 101, 104, 106, 110, 801, 802, 900, 1100, 1203, 1301, 1303, 1400} - {m["id"] for m in cucs.inbox}
    assert not missing, f"never received: {missing}"


def address(text):
    host, port = text.rsplit(":", 1)
    return host, int(port)


def identification(text):
    return int.from_bytes(bytes.fromhex(text.replace(":", "")), "big", signed=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vsm", type=address, required=True)
    parser.add_argument("--id", type=identification, default=identification("1b:00:00:b0"))
    parser.add_argument("--bind", default="0.0.0.0")
    parser.add_argument("--group", type=address)
    parser.add_argument("--slow", type=float, default=1.0, help="allow so many times the time of each step")
    parser.add_argument("--interface", default="127.0.0.1")
    cucs = Cucs(parser.parse_args())
    began = time.monotonic()
    try:
        fly(cucs)
    except (Failure, AssertionError) as fault:
        print(f"FAILED  {fault}", flush=True)
        if cucs.vehicle != BROADCAST:
            # Not left hovering. Who holds no control is refused.
            cucs.send(42, Select_Flight_Path_Control_Mode=AUTOLAND)
            cucs.pump(1.0)
            print("commanded to land (#42 mode 19)", flush=True)
        sys.exit(1)
    for fault in sorted(set(cucs.faults)):
        print(f"FAULT  {fault}")
    if cucs.faults:
        sys.exit(1)
    print(f"{len(cucs.inbox)} messages, all whole; landed and released after {time.monotonic() - began:.0f} s")


if __name__ == "__main__":
    main()
