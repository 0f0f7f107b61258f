"""A ground station in Python: takes control of the quick start's vehicle, flies a triangle and lands.

    python3 -m venv .venv                           # the Python of a distribution takes no packages beside its own
    .venv/bin/pip install ./bindings/python
    .venv/bin/python examples/fly.py [HOST:PORT]    # `vsm run` and `px4-sim` run, as in docs/guide/quick-start.md
"""
import math
import socket
import sys
import time

import stanag_msgs as dli

CUCS, VEHICLE = "1b:00:00:a0", "1b:00:01:01"
host, port = (sys.argv[1] if len(sys.argv) > 1 else "127.0.0.1:4586").rsplit(":", 1)
udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
udp.connect((host, int(port)))
udp.settimeout(0.2)
last_stamp = 0


def new_stamp():
    """The clock, in milliseconds since 2000; none is used twice."""
    global last_stamp
    last_stamp = max(last_stamp + 1, int((time.time() - 946_684_800) * 1000))
    return last_stamp


def send(id, fields, ack=False, to=VEHICLE):
    stamp = new_stamp()
    message = {"id": id, "source": CUCS, "destination": to, "ack": ack, "fields": {"Time Stamp": stamp, **fields}}
    udp.send(dli.encode(message))
    return stamp


def wait(what, accept, seconds=60):
    """The first message that is accepted. A heartbeat each second keeps control, and proves that we are here."""
    end, beat = time.monotonic() + seconds, 0.0
    while time.monotonic() < end:
        if time.monotonic() >= beat:
            beat = time.monotonic() + 1
            send(16002, {})
        try:
            received = dli.decode(udp.recv(65536))
        except (TimeoutError, ConnectionRefusedError):
            continue
        for message in received:
            # What asks for it is acknowledged: by that the VSM knows that this CUCS is at this address.
            if message.get("ack"):
                send(17000, {"Original Message Time Stamp": message["fields"].get("Time Stamp"),
                             "Original Message Type": message["id"], "Acknowledgement Type": 1}, to=message["source"])
            if message["id"] == 16000 and message["fields"].get("Text"):
                print("alert:", message["fields"]["Text"])
            if accept(message["id"], message["fields"]):
                return message["fields"]
    sys.exit(f"not seen within {seconds} s: {what}")


def command(what, id, fields):
    """Sends a command and waits until the vehicle has carried it out (17000 type 2) or refused it (3)."""
    stamp = send(id, fields, ack=True)
    answer = wait(what, lambda id, f: id == 17000 and f.get("Original Message Time Stamp") == stamp
                  and f.get("Acknowledgement Type") in (2, 3, "carried out", "refused"))
    if answer["Acknowledgement Type"] in (3, "refused"):
        sys.exit(f"{what} was refused")
    print(what, "- done")


levels = ["LOI 4", "LOI 5"]
send(1, {"Requested/Handover LOI": levels, "Requested/Handover Access": "request control"})
wait("control", lambda id, f: id == 2 and "LOI 5" in f.get("LOI Granted", []))
home = wait("a position", lambda id, f: id == 4000 and "Latitude" in f)

for number, (north_m, east_m) in enumerate([(60, 0), (60, 60), (0, 0)], start=1):
    command(f"waypoint {number}", 13002, {
        "Waypoint Number": number, "Next Waypoint": number % 3 + 1 if number < 3 else 0,
        "Waypoint to Latitude or Relative Y": home["Latitude"] + north_m / 6_371_000,
        "Waypoint to Longitude or Relative X": home["Longitude"] + east_m / 6_371_000 / math.cos(home["Latitude"]),
        "Location Type": "absolute", "Waypoint to Altitude": 30, "Waypoint Altitude Type": "AGL"})
command("route", 13001, {"Initial Waypoint Number": 1, "Route ID": "triangle", "Route Type": "flight (default)"})
command("upload", 13000, {"Mission ID": "triangle", "Mission Plan Mode": 2, "Route ID": "triangle"})
command("launch", 2016, {"Select Flight Path Control Mode": "launch", "Altitude Command Type": "altitude",
                         "Commanded Altitude": 30, "Altitude Type": "AGL"})
command("route begun", 2016, {"Select Flight Path Control Mode": "waypoint"})
wait("the last waypoint", lambda id, f: id == 4001 and f.get("To Waypoint Number") == 3)
wait("the route's end", lambda id, f: id == 3001 and f.get("Select Flight Path Control Mode") == "loiter", 120)
command("landing begun", 2016, {"Select Flight Path Control Mode": "autoland engage"})
# On the ground it is "pre-launch" until it has disarmed, some seconds later.
wait("the ground", lambda id, f: id == 3002 and f.get("UA State") in ("power up", "pre-start"), 120)
# Everything, what an earlier program took with this id too: whoever keeps some has to keep sending heartbeats.
send(1, {"Requested/Handover LOI": ["LOI 2", "LOI 3", *levels], "Requested/Handover Access": "relinquish / hand off control"})
wait("the release", lambda id, f: id == 2 and not f.get("LOI Granted"))
print("landed and released")
