"""A ground station (CUCS) that speaks the DLI over UDP, for tests and for hand use.

It stands on the reference codec in tests/data/dli and on nothing of this project, so that a mistake of
the bridge cannot hide in a shared library. Everything that arrives is decoded, encoded again and kept
with its time of arrival; every message sent uses the next of all editions and checksum styles in turn.
Standard library only; Python 3.11+.
"""
import math
import select
import socket
import sys
import time
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "data" / "dli"))
import reference  # noqa: E402

BROADCAST = 0xFFFFFFFF
LOI_2, LOI_3, LOI_4, LOI_5 = 1, 2, 4, 8
RELEASE, REQUEST, OVERRIDE = 0, 1, 2
RECEIVED, CARRIED_OUT, REFUSED = 1, 2, 3
WAYPOINT, LOITER, AUTOLAND, LAUNCH = 11, 12, 19, 21
MAX_DATAGRAM = 548
EPOCH_2000_S = 946_684_800
# Edition 3 has no CRC-32.
STYLES = [(32, 0), (30, 1), (32, 3), (30, 2), (32, 1), (30, 0), (32, 2)]


class Failure(Exception):
    """The other side did not do what the contract says; there is no sense in going on."""


@dataclass
class Received:
    """One message as it came: when (monotonic seconds), from where, and what it says."""

    at: float
    address: tuple
    value: dict
    wire: bytes

    @property
    def id(self):
        return self.value["id"]

    @property
    def fields(self):
        return self.value["fields"]


class Cucs:
    """One station with a socket of its own. `vsm` is the address that it talks to."""

    def __init__(self, vsm, id, bind=("0.0.0.0", 0), heartbeat=True):
        self.vsm, self.id = vsm, id
        self.vehicle = self.vsm_id = None
        self.heartbeat_at = time.monotonic() if heartbeat else math.inf
        self.inbox = []
        self.unreadable = []
        self.sent = {}
        self._last_stamp = 0
        self._style = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(bind)
        self._socket.setblocking(False)

    def close(self):
        self._socket.close()

    # Sending

    def stamp(self):
        """Milliseconds since 2000, and always more than the last."""
        self._last_stamp = max(self._last_stamp + 1, int((time.time() - EPOCH_2000_S) * 1000))
        return self._last_stamp

    def make(self, id, fields, ack=False, to=None, style=None):
        """A message, not sent yet; `to` is the vehicle where nothing else is said."""
        if style is None:
            self._style += 1
            style = STYLES[self._style % len(STYLES)]
        destination = to if to is not None else self.vehicle
        if destination is None:
            raise Failure("no vehicle is known yet")
        return {"id": id, "source": self.id, "destination": destination, "ack": ack, "idd": style[0],
                "checksum": style[1], "fields": {"Time Stamp": self.stamp(), **fields}}

    def transmit(self, *values):
        """Sends messages, as many in a datagram as fit; returns the datagrams."""
        datagrams = [b""]
        for value in values:
            wire = reference.encode(value)
            self.sent[value["id"]] = self.sent.get(value["id"], 0) + 1
            if len(datagrams[-1]) + len(wire) > MAX_DATAGRAM:
                datagrams.append(b"")
            datagrams[-1] += wire
        for datagram in datagrams:
            self.transmit_bytes(datagram)
        return datagrams

    def transmit_bytes(self, datagram):
        self._socket.sendto(datagram, self.vsm)

    def send(self, id, fields, ack=False, to=None):
        value = self.make(id, fields, ack, to)
        self.transmit(value)
        return value

    # Receiving

    def pump(self, seconds):
        """Sends heartbeats and takes in what comes, for so long."""
        end = time.monotonic() + seconds
        while True:
            now = time.monotonic()
            if now >= self.heartbeat_at and self.vehicle is not None:
                self.heartbeat_at = now + 1.0
                self.send(16002, {})
            rest = end - now
            readable, _, _ = select.select([self._socket], [], [], max(0.0, min(rest, 0.2)))
            while readable:
                try:
                    datagram, address = self._socket.recvfrom(65536)
                except BlockingIOError:
                    break
                except ConnectionRefusedError:
                    continue
                self._take(datagram, address)
            if rest <= 0:
                return

    def _take(self, datagram, address):
        at, rest = time.monotonic(), datagram
        if len(datagram) > MAX_DATAGRAM:
            self.unreadable.append(f"a datagram of {len(datagram)} bytes")
        while rest:
            try:
                length, properties = int.from_bytes(rest[2:4], "big"), int.from_bytes(rest[14:16], "big")
                end = reference.HEADER.size + length + (0, 2, 4, 4)[properties >> 6 & 3]
                wire, rest = rest[:end], rest[end:]
                value = reference.decode(wire)
                if reference.encode(value) != wire:
                    raise ValueError("encodes to other bytes")
                self.inbox.append(Received(at, address, value, wire))
            except Exception as error:
                self.unreadable.append(f"{type(error).__name__}: {error}: {datagram.hex()}")
                return

    def mark(self):
        """The place in the inbox from which on something is new."""
        return len(self.inbox)

    def find(self, wanted, since=0):
        return next((m for m in self.inbox[since:] if wanted(m)), None)

    def wait(self, wanted, timeout, since=None, what="the message"):
        """The first message from `since` on that is wanted; a failure after `timeout` seconds."""
        at = self.mark() if since is None else since
        end = time.monotonic() + timeout
        while True:
            while at < len(self.inbox):
                if wanted(self.inbox[at]):
                    return self.inbox[at]
                at += 1
            if time.monotonic() >= end:
                raise Failure(f"{what} did not come within {timeout:g} s")
            self.pump(0.05)

    def latest(self, id, *names):
        """The newest message of a type that has all these fields."""
        return next((m for m in reversed(self.inbox) if m.id == id and all(n in m.fields for n in names)), None)

    # What a station does

    def discover(self, timeout):
        """Asks everybody; the first vehicle that answers is ours from here on."""
        since = self.mark()
        for _ in range(max(1, int(timeout))):
            self.send(1, {"VSM ID": -1, "Data Link ID": 0, "Requested/Handover LOI": 0, "Requested/Handover Access": 0,
                          "Controlled Station 1-16": 0}, to=BROADCAST)
            try:
                answer = self.wait(lambda m: m.id == 2, 1.0, since, "the answer to the discovery")
            except Failure:
                continue
            self.vehicle, self.vsm_id = answer.value["source"], answer.fields.get("VSM ID", -1)
            return answer
        raise Failure(f"no vehicle answered the discovery within {timeout:g} s")

    def authority(self, loi, access, timeout):
        """Asks for levels of interoperability, or gives them back; returns the answer, a #2."""
        since = self.mark()
        self.send(1, {"VSM ID": self.vsm_id, "Data Link ID": 0, "Requested/Handover LOI": loi,
                      "Requested/Handover Access": access, "Controlled Station 1-16": 0,
                      "Wait for Vehicle Data Link Transition Coordination Message": 0})
        return self.wait(lambda m: m.id == 2, timeout, since, f"the answer (#2) to a request for LOI bits {loi:#x}")

    def acknowledgements(self, value, since=0):
        """The types of all 17000 for one message, in order of arrival."""
        return [m.fields.get("Acknowledgement Type") for m in self.inbox[since:] if self._acknowledges(m, value)]

    def command(self, id, fields, timeout):
        """Sends a command with acknowledgement and waits for its end; returns it and all its 17000s."""
        since = self.mark()
        value = self.send(id, fields, ack=True)
        try:
            self.wait(lambda m: self._acknowledges(m, value) and m.fields.get("Acknowledgement Type") != RECEIVED,
                      timeout, since, f"the end (17000 type 2 or 3) of the {id}")
        except Failure:
            pass
        return value, self.acknowledgements(value, since)

    def wait_for_ends(self, values, since, timeout=5.0):
        """Waits until each of these messages has its end (17000 type 2 or 3), as long as a busy computer, a slow disk or a poor link may take."""
        ended = lambda value: any(kind != RECEIVED for kind in self.acknowledgements(value, since))
        until = time.monotonic() + timeout
        while not all(map(ended, values)) and time.monotonic() < until:
            self.pump(0.05)

    @staticmethod
    def _acknowledges(m, value):
        return (m.id == 17000 and m.fields.get("Original Message Type") == value["id"]
                and m.fields.get("Original Message Time Stamp") == value["fields"]["Time Stamp"])

    def mode(self):
        m = self.latest(3001)
        return m and m.fields.get("Select Flight Path Control Mode")

    def position(self):
        """Latitude and longitude in rad, altitude in m, altitude type; from the newest 4000 that has them."""
        m = self.latest(4000, "Latitude", "Longitude", "Altitude", "Altitude Type")
        return m and place(m)


def place(m):
    f = m.fields
    return bam_to_rad(f["Latitude"], 32), bam_to_rad(f["Longitude"], 32), f["Altitude"] * 0.02, f["Altitude Type"]


def ground_speed(m):
    """m/s, of a 4000."""
    return math.hypot(m.fields["U_Speed"], m.fields["V_Speed"]) * 0.05


def bam_to_rad(raw, bits):
    return raw * math.pi / 2 ** (bits - 1)


def rad_to_bam(rad, bits):
    """The nearest raw value; pi itself becomes the same direction, minus pi."""
    half = 2 ** (bits - 1)
    return (round(rad * half / math.pi) + half) % (2 * half) - half


def text(id):
    return ":".join(f"{byte:02x}" for byte in id.to_bytes(4, "big"))
