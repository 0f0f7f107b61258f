"""The VSM: its socket, its stations, acknowledgements, duplicates, schedules, and the control port for tests."""
import json
import os
import random
import select
import socket
import sys
import time
from collections import OrderedDict
from dataclasses import dataclass, field
from pathlib import Path

from . import units
from .edition25 import Codec25
from .reports import PUSHED
from .steering import refused
from .vehicle import CLOCK_S, ORDERED, SAMPLE_S, Vehicle
from .wire import BROADCAST, Codec, reference

RECEIVED, CARRIED_OUT, REFUSED = 1, 2, 3
PUSH_HZ = 4.0
HEARTBEAT_S = 1.0
MAX_REMEMBERED = 10_000
MAX_BATCH = 400
# What is answered again when its request arrives again: nothing of it changes the vehicle.
QUESTIONS = {15000, 17002}


@dataclass
class Schedule:
    period: float
    due: float
    asked: bool = False


@dataclass
class Peer:
    """One CUCS as it was last received."""

    address: tuple
    received: float
    heartbeats: bool = False
    schedules: dict = field(default_factory=dict)
    newest: dict = field(default_factory=dict)
    stamps: set = field(default_factory=set)
    seen: OrderedDict = field(default_factory=OrderedDict)


class Vsm:
    """Everything of one process. `run` serves until `stop`."""

    def __init__(self, options):
        self.options, self.access = options, options.access
        self.dice = random.Random(options.seed)
        self.codec = Codec25() if options.edition == "2.5" else Codec(options.edition, options.checksum)
        self.peers, self.last_stamp = {}, {}
        self.vehicles = [Vehicle(self, k) for k in range(options.vehicles)]
        self.push_hz, self.heartbeat_s = PUSH_HZ, HEARTBEAT_S
        self._heartbeat_at = 0.0
        self.sockets = []
        self.group = None
        self.stopped = False

    def now(self):
        return time.monotonic()

    # The loop

    def open(self):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        self.socket.bind(("127.0.0.1", self.options.port))
        self.socket.setblocking(False)
        self.sockets.append(self.socket)
        self.control = None
        if self.options.control is not None:
            self.control = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self.control.bind(("127.0.0.1", self.options.control))
            self.control.setblocking(False)
            self.sockets.append(self.control)
        self.restore()

    def run(self):
        sample = self.now()
        while not self.stopped:
            due = min([sample + SAMPLE_S] + [s.due for p in self.peers.values() for s in p.schedules.values()])
            readable, _, _ = select.select(self.sockets, [], [], max(0.0, due - self.now()))
            if self.socket in readable:
                self.receive()
            if self.control in readable:
                self.obey()
            now = self.now()
            if now >= sample + SAMPLE_S:
                for vehicle in self.vehicles:
                    vehicle.advance(now - sample)
                sample = now
            self.push(now)

    def stop(self, *_):
        self.stopped = True

    def receive(self):
        for _ in range(MAX_BATCH):
            try:
                datagram, address = self.socket.recvfrom(65535)
            except BlockingIOError:
                return
            except OSError:
                continue
            self.take_datagram(datagram, address)

    def take_datagram(self, datagram, address):
        for message in self.codec.messages(datagram, self.known_source):
            self.take(message, address)

    def known_source(self, source):
        return source in self.access

    # Messages

    def take(self, message, address):
        """One message of a CUCS of the access list."""
        vehicles = self.addressed(message)
        if not vehicles or (message.id not in (1, 16002) and not vehicles[0].handles(message.id)):
            return
        peer = self.peer(message.source, address)
        if message.id == 16002:
            peer.heartbeats = True
            return
        for vehicle in vehicles:
            self.process(message, vehicle, peer)

    def addressed(self, message):
        """The vehicles that a message is for."""
        if message.destination == BROADCAST:
            return self.vehicles if message.id in (1, 28000, 16002) else []
        if message.destination == self.options.vsm_id:
            return self.vehicles if message.id in (1, 28000, 16002) else []
        return [v for v in self.vehicles if message.destination in (v.id, v.real_id)]

    def peer(self, source, address):
        peer = self.peers.setdefault(source, Peer(address, self.now()))
        if peer.address != address:
            peer.address = address
            self.save()
        peer.received = self.now()
        return peer

    def process(self, message, vehicle, peer):
        key = (vehicle.number, message.wire)
        if self.is_duplicate(peer, key):
            self.repeat(message, vehicle, peer.seen[key])
            return
        peer.seen[key] = None
        while len(peer.seen) > MAX_REMEMBERED:
            peer.seen.popitem(last=False)
        outcome = self.outcome_of(message, vehicle, peer)
        self.settle(message, vehicle, outcome)

    def is_duplicate(self, peer, key):
        return key in peer.seen

    def repeat(self, message, vehicle, acknowledged):
        """The same bytes once more: answered again, not carried out again."""
        if message.id == 1:
            vehicle.send_report(message.source, 2)
        elif message.id in QUESTIONS:
            vehicle.handle(message)
        if message.ack and acknowledged:
            self.acknowledge(message, vehicle, acknowledged)

    def outcome_of(self, message, vehicle, peer):
        if message.id == 1:
            return vehicle.authorise(message, self.is_discovery(message, vehicle))
        reason = vehicle.permits(message)
        if reason:
            return refused(reason)
        reason = self.untimely(message, vehicle, peer)
        if reason:
            vehicle.alerts.refusal((message.id, "stamp"), reason, self.now())
            return refused(reason)
        outcome = vehicle.handle(message)
        if outcome.reason and message.id not in (17002, 13000):
            vehicle.alerts.refusal(message.id, outcome.reason, self.now())
        return outcome

    def is_discovery(self, message, vehicle):
        """Every broadcast request, and a question that names no level."""
        return message.destination not in (vehicle.id, vehicle.real_id) or not message.fields.get("Requested/Handover LOI", 0)

    def untimely(self, message, vehicle, peer):
        """A reason where a later command is in force already, or the stamp is of another time."""
        stamp, key = message.stamp, (vehicle.number, message.id)
        if stamp is None or message.id not in ORDERED:
            return None
        late = (units.stamp() - stamp) / 1000
        if abs(late) > CLOCK_S:
            return f"{message.id}: Time Stamp is {abs(late):.0f} s {'behind' if late > 0 else 'ahead of'} the clock: expected within {CLOCK_S:.0f} s"
        newest = peer.newest.get(key, 0)
        if stamp < newest and (key, stamp) not in peer.stamps:
            return f"{message.id}: a later one is in force"
        peer.newest[key] = max(stamp, newest)
        peer.stamps.add((key, stamp))
        return None

    def settle(self, message, vehicle, outcome):
        """Acknowledges where it was asked for."""
        if outcome.reason:
            self.acknowledge(message, vehicle, REFUSED)
        elif outcome.shown:
            self.acknowledge(message, vehicle, RECEIVED)
            vehicle.await_state(message, outcome)
        else:
            self.acknowledge(message, vehicle, CARRIED_OUT)

    def acknowledge(self, message, vehicle, kind):
        if not message.ack:
            return
        peer = self.peers[message.source]
        peer.seen[vehicle.number, message.wire] = kind
        vehicle.report(message.source, 17000, {"Original Message Time Stamp": message.stamp or 0, "Original Message Type": message.id,
                                               "Acknowledgement Type": kind})

    # Sending

    def send(self, cucs, source, id, fields, ack=False):
        for datagram in self.codec.pack([self.wire(cucs, source, id, fields, ack)]):
            self.transmit(cucs, datagram)

    def send_together(self, cucs, source, messages):
        for datagram in self.codec.pack([self.wire(cucs, source, id, fields) for id, fields in messages]):
            self.transmit(cucs, datagram)

    def wire(self, cucs, source, id, fields, ack=False):
        stamp = self.rising(cucs, source, id, fields.get("Time Stamp", units.stamp()))
        return self.codec.encode(id, source, cucs, {**fields, "Time Stamp": stamp}, ack)

    def rising(self, cucs, source, id, stamp):
        """Stamps of one type from one source to one CUCS never fall and never repeat."""
        stamp = max(stamp, self.last_stamp.get((cucs, source, id), 0) + 1)
        self.last_stamp[cucs, source, id] = stamp
        return stamp

    def only(self, id, fields, wanted):
        """The fields that a request names by their bits."""
        named = {f["name"] for f in reference.MESSAGES[id]["fields"] if wanted >> f["bit"] & 1}
        return {name: value for name, value in fields.items() if name in named}

    def transmit(self, cucs, datagram):
        peer = self.peers.get(cucs)
        if peer is None:
            return
        try:
            self.socket.sendto(datagram, peer.address)
            if self.group:
                self.socket.sendto(datagram, self.group)
        except OSError as error:
            print(f"second_vsm: nothing sent to {peer.address}: {error}", file=sys.stderr)

    # Schedules

    def schedule(self, cucs, vehicle, id, frequency):
        """17001; a frequency of 0 leaves what is sent without any."""
        schedules = self.peers[cucs].schedules
        schedules.pop((vehicle.number, id), None)
        if frequency:
            schedules[vehicle.number, id] = Schedule(self.period(frequency), self.now(), True)

    def period(self, frequency):
        return 1.0 / min(frequency, 50)

    def push(self, now):
        for cucs, peer in list(self.peers.items()):
            for vehicle in self.vehicles:
                self.default_schedules(peer, vehicle, vehicle.authority.granted(cucs), now)
            for (number, id), schedule in peer.schedules.items():
                if now >= schedule.due:
                    self.vehicles[number].send_report(cucs, id)
                    # Behind by more than a period, what was missed is not made up for.
                    schedule.due = max(schedule.due, now - schedule.period) + schedule.period
        if self.heartbeat_s and now >= self._heartbeat_at:
            self._heartbeat_at = max(self._heartbeat_at, now - self.heartbeat_s / 2) + self.heartbeat_s
            for vehicle in self.vehicles:
                for cucs in vehicle.authority.watching():
                    vehicle.report(cucs, 16002, {})

    def default_schedules(self, peer, vehicle, granted, now):
        """The status messages that come without being asked for, from LOI 2 on."""
        for id in PUSHED:
            key = (vehicle.number, id)
            if granted and key not in peer.schedules:
                peer.schedules[key] = Schedule(1 / self.push_hz, now)
        if not granted:
            peer.schedules = {key: s for key, s in peer.schedules.items() if key[0] != vehicle.number}

    # Disk

    def save(self):
        if not self.options.store:
            return
        record = {"rights": [v.authority.record() for v in self.vehicles], "peers": {str(k): list(p.address) for k, p in self.peers.items()}}
        path = Path(self.options.store)
        path.mkdir(parents=True, exist_ok=True)
        new = path / "rights.new"
        new.write_text(json.dumps(record))
        os.replace(new, path / "rights.json")

    def restore(self):
        path = Path(self.options.store or "") / "rights.json"
        if not self.options.store or not path.exists():
            return
        record = json.loads(path.read_text())
        for vehicle, rights in zip(self.vehicles, record["rights"]):
            vehicle.authority.restore(rights)
        for id, address in record["peers"].items():
            self.peers[int(id)] = Peer(tuple(address), self.now())

    # Control for tests

    def obey(self):
        """One line from the control port: `link down`, `fix off`, `battery 15`, `place LAT LON ALT`, `wind N E`; a number of a vehicle may lead."""
        line, address = self.control.recvfrom(1000)
        words = line.decode("ascii", "replace").split()
        vehicle = self.vehicles[int(words.pop(0)) - 1] if words and words[0].isdigit() else self.vehicles[0]
        aircraft = vehicle.aircraft
        match words:
            case ["link", "down" | "up" as way]:
                vehicle.link_up = way == "up"
            case ["fix", "on" | "off" as way]:
                aircraft.fix = way == "on"
            case ["battery", percent]:
                aircraft.battery = float(percent)
            case ["wind", north, east]:
                aircraft.wind = (float(north), float(east))
            case ["place", lat, lon, alt]:
                aircraft.home = aircraft.place = (units.math.radians(float(lat)), units.math.radians(float(lon)))
                aircraft.ground = aircraft.altitude = float(alt)
            case _:
                self.control.sendto(f"not understood: {line.decode('ascii', 'replace')}".encode(), address)
                return
        self.control.sendto(b"done", address)
