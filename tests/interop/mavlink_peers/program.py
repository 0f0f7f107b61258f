"""The command line of the subjects: `python3 -m mavlink_peers autopilot --link 127.0.0.1:14550 --key-file uav1.key --fault SIGN-003`."""
import argparse
import time
from pathlib import Path

from .autopilot import Autopilot
from .faults import FAULTS
from .router import FAULTS as ROUTER_FAULTS
from .router import Router
from .station import FAULTS as STATION_FAULTS
from .station import Station, key_of_phrase
from .wire import now_stamp


def address(text):
    host, _, port = text.rpartition(":")
    return host, int(port)


def main():
    parser = argparse.ArgumentParser(description="A MAVLink 2 autopilot or ground station with signing, or a router, with a fault for each rule of mavlink-check.")
    parser.add_argument("role", choices=["autopilot", "router", "station"])
    parser.add_argument("--link", action="append", type=address, help="address that the subject sends to (repeat: a second link)")
    parser.add_argument("--port", action="append", default=[], type=int, help="own port of each link (repeat); of a router the ends: vehicle, station; of a station the one that it listens to")
    parser.add_argument("--key-file", help="64 hexadecimal digits; written when the key changes")
    parser.add_argument("--fault", action="append", default=[], choices=sorted(FAULTS | ROUTER_FAULTS | STATION_FAULTS), metavar="RULE", help="break this rule (repeat)")
    parser.add_argument("--phrase-file", help="of a station: make the key from this pass phrase")
    parser.add_argument("--recording", help="of a station: keep what it sends here")
    parser.add_argument("--rotate", action="store_true", help="of a station: give the vehicle a new key")
    args = parser.parse_args()
    if args.role == "router":
        Router(args.port, set(args.fault)).run()
    key = bytes.fromhex(open(args.key_file).read().strip()) if args.key_file else None
    if args.role == "station":
        if args.phrase_file and "SIGN-018" in args.fault:
            key = key_of_phrase(Path(args.phrase_file).read_bytes())
        Station(args.port[0], key, set(args.fault), args.recording, args.rotate).run()
    subject = Autopilot(args.link, key, set(args.fault), ports=args.port)
    if args.key_file and not subject.has("SIGN-019"):
        file = Path(args.key_file + ".stamp")
        subject.started = max(now_stamp(), int(file.read_text()) if file.exists() else 0)
        subject.store_stamp = lambda stamp: file.write_text(str(stamp))
    if args.key_file and not subject.has("KEY-007"):
        def store():
            with open(args.key_file, "w") as file:
                file.write(subject.key.hex())
        subject.store_key = store
    time.sleep(0.05)
    subject.run()
