"""The command line."""
import argparse
import math
import signal
import socket
import sys
from dataclasses import dataclass, field

from . import faults_beside_flight  # noqa: F401: adds to BY_RULE
from .authority import Access
from .faults_by_rule import BY_RULE
from .faults_in_corners import IN_CORNERS
from .faults_in_detail import IN_DETAIL
from .faults_of_agreement import OF_AGREEMENT
from .faults_of_cause import OF_CAUSE
from .faults_of_memory import OF_MEMORY
from .faults_of_practice import OF_PRACTICE
from .faults_of_state import OF_STATE
from .mutants import MUTANTS
from .variants import VARIANTS
from .vsm import Vsm
from .wire import parse_id, show_id

FAULTS = MUTANTS | BY_RULE | IN_DETAIL | IN_CORNERS | OF_MEMORY | OF_AGREEMENT | OF_PRACTICE | OF_CAUSE | OF_STATE
# Options without which a fault does not show.
CIRCUMSTANCES = {"V56": ["--no-fix"], "DISC-005": ["--no-link"], "LINK-005": ["--on-loss", "hold"],
                 **dict.fromkeys(("MODE-008", "MODE-008z", "STAT-007z2"), ["--wind=8,0"])}
HOME = (47.3977434, 8.5455939, 488.0)
STATIONS = ("1b:00:00:a0:2345:override", "1b:00:00:a1:2345:override", "1b:00:00:a2:2345", "1b:00:00:a3:24", "1b:00:00:a4:2")


@dataclass
class Options:
    """What one process serves; the command line fills it, tests make it."""

    port: int = 4586
    control: int | None = None
    access: dict = field(default_factory=dict)
    speed: float = 1.0
    seed: int = 1
    edition: str = "4"
    checksum: int = 2
    vsm_id: int = parse_id("1b:00:00:01")
    vehicle_id: int = parse_id("1b:00:01:01")
    vehicle_type: int = 21
    vehicle_subtype: int = 3
    tail_number: str = "SECOND-01"
    vehicles: int = 1
    stations: int = 2
    home: tuple = (math.radians(HOME[0]), math.radians(HOME[1]), HOME[2])
    geoid: float = 47.0
    variation: float = 15.0
    wind: tuple = (0.0, 0.0)
    link: bool = True
    fix: bool = True
    on_loss: str = "continue"
    store: str | None = None


def parse_access(text):
    """A line of the access list: ID, its levels (all where left out), whether it may override."""
    parts = text.split(":")
    levels, extra = parts[4] if len(parts) > 4 else "2345", parts[5:]
    if extra not in ([], ["override"]) or not levels or set(levels) - set("2345"):
        raise argparse.ArgumentTypeError(f"{text!r}: expected ID[:LEVELS[:override]], such as 1b:00:00:a0:24:override")
    try:
        return parse_id(":".join(parts[:4])), Access(sum(1 << int(level) - 2 for level in set(levels)), bool(extra))
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def parse_home(text):
    lat, lon, altitude = (float(part) for part in text.split(","))
    return math.radians(lat), math.radians(lon), altitude


def numbers(text):
    return tuple(float(part) for part in text.split(","))


def parser():
    p = argparse.ArgumentParser(prog="second_vsm.py", description="Serve a simulated aircraft to ground stations over the DLI, as a VSM other than the "
                                "project's own: a subject for the conformance suite.")
    p.add_argument("--port", type=int, default=4586, help="UDP port on 127.0.0.1 (default 4586)")
    p.add_argument("--control", type=int, metavar="PORT", help="take orders of a test on this UDP port, such as \"link down\"")
    p.add_argument("--order", nargs="+", metavar=("PORT", "WORD"), help="send an order to a running program's control port, and exit")
    p.add_argument("--cucs", type=parse_access, action="append", metavar="ID[:LEVELS[:override]]",
                   help=f"let a CUCS connect, such as 1b:00:00:a0:24 (repeat; default {', '.join(STATIONS)})")
    p.add_argument("--speed", type=float, default=1.0, metavar="FACTOR", help="fly this many times faster than real time")
    p.add_argument("--seed", type=int, default=1, help="choose the first alert id and the first heading")
    p.add_argument("--edition", choices=["2.5", "3", "4"], default="4", help="the edition that is spoken")
    p.add_argument("--checksum", type=int, choices=range(4), default=2, help="style of the checksums that are sent")
    p.add_argument("--vsm-id", type=parse_id, default=Options.vsm_id, help=f"default {show_id(Options.vsm_id)}")
    p.add_argument("--vehicle-id", type=parse_id, default=Options.vehicle_id, help=f"of the first vehicle; default {show_id(Options.vehicle_id)}")
    p.add_argument("--vehicle-type", type=int, default=Options.vehicle_type)
    p.add_argument("--vehicle-subtype", type=int, default=Options.vehicle_subtype)
    p.add_argument("--tail-number", default=Options.tail_number)
    p.add_argument("--vehicles", type=int, default=1, help="number of vehicles, 200 m apart")
    p.add_argument("--stations", type=int, default=2, help="number of camera stations of each vehicle")
    p.add_argument("--home", type=parse_home, default=Options.home, metavar="LAT,LON,ALT", help="degrees, metres above the sea")
    p.add_argument("--geoid", type=float, default=47.0, metavar="M", help="height of the geoid above the ellipsoid")
    p.add_argument("--variation", type=float, default=15.0, metavar="DEGREES", help="magnetic variation, east positive")
    p.add_argument("--wind", type=numbers, default=(0.0, 0.0), metavar="NORTH,EAST", help="where the air moves to, in m/s")
    p.add_argument("--no-link", dest="link", action="store_false", help="start without a vehicle behind the VSM")
    p.add_argument("--no-fix", dest="fix", action="store_false", help="start without a position fix")
    p.add_argument("--on-loss", choices=["continue", "hold", "contingency", "rtl"], default="continue", help="when the controlling CUCS is lost")
    p.add_argument("--store", metavar="DIR", help="keep the rights of the stations here across restarts")
    p.add_argument("--mutant", action="append", default=[], metavar="ID", choices=sorted(FAULTS), help="build in a fault (repeat)")
    p.add_argument("--variant", action="append", default=[], metavar="ID", choices=sorted(VARIANTS), help="build in a lawful departure (repeat)")
    p.add_argument("--list-mutants", action="store_true", help="print the faults and exit")
    p.add_argument("--list-variants", action="store_true", help="print the lawful departures and exit")
    return p


def give_order(port, words):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.settimeout(2)
        s.sendto(" ".join(words).encode(), ("127.0.0.1", port))
        answer = s.recv(1000).decode()
    print(answer)
    return 0 if answer == "done" else 1


def build(options, mutants=(), variants=()):
    """A VSM with these faults and departures, not opened yet."""
    vsm = Vsm(options)
    for table, ids in ((FAULTS, mutants), (VARIANTS, variants)):
        for id in ids:
            table[id].build(vsm)
    return vsm


def main(arguments=None):
    args = vars(parser().parse_args(arguments))
    for name, table in (("list_mutants", FAULTS), ("list_variants", VARIANTS)):
        if args.pop(name):
            for id, change in table.items():
                print(f"{id}  {change.title}")
            return
    if args["order"]:
        sys.exit(give_order(int(args["order"][0]), args["order"][1:]))
    args.pop("order")
    args["access"] = dict(args.pop("cucs") or map(parse_access, STATIONS))
    mutants, variants = args.pop("mutant"), args.pop("variant")
    vsm = build(Options(**args), mutants, variants)
    signal.signal(signal.SIGTERM, vsm.stop)
    signal.signal(signal.SIGINT, vsm.stop)
    vsm.open()
    print(f"second_vsm: ready on 127.0.0.1:{vsm.options.port}", *mutants, *variants, file=sys.stderr, flush=True)
    vsm.run()
