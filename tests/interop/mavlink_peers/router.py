"""A MAVLink 2 router between two UDP ends, lawful or with faults: each end is a port to which whoever speaks there sends."""
import select
import socket

from .wire import BY_ID, crc_holds, parse

FAULTS = {
    "ROUTE-001": "keeps broadcasts of the station to itself, but for the first two",
    "ROUTE-002": "passes nothing that is addressed",
    "ROUTE-003": "takes signatures off",
    "ROUTE-004": "sends frames back as well",
    "ROUTE-005": "drops messages that it does not know",
    "ROUTE-006": "passes frames with a wrong checksum",
    "ROUTE-007": "passes the first frame of a datagram",
    "ROUTE-008": "stops at a datagram that is no frame",
    "ROUTE-009": "sends each frame twice",
    "ROUTE-010": "passes SETUP_SIGNING to all",
    "ROUTE-011": "sends to whoever sent last, frame or not",
    "ROUTE-013": "lets every second frame overtake the one before",
}


class Router:
    """Two ends; a frame goes to the other one, if who it is for is there."""

    def __init__(self, ports, faults):
        self.faults = faults
        self.ends = []
        for port in ports:
            end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            end.bind(("127.0.0.1", port))
            self.ends.append(end)
        self.peers, self.systems = [None, None], [set(), set()]
        self.held, self.broken, self.broadcasts = None, False, 0

    def has(self, fault):
        return fault in self.faults

    def run(self):
        while True:
            ready = select.select(self.ends, [], [], 0.05)[0]
            if not ready and self.held:
                self.send(*self.held)
                self.held = None
            for end in ready:
                try:
                    data, sender = end.recvfrom(65536)
                except OSError:
                    continue
                self.take(self.ends.index(end), data, sender)

    def take(self, end, data, sender):
        frames = [] if self.broken else parse(data)[0]
        if not frames:
            self.broken |= self.has("ROUTE-008")
        if frames and self.peers[end] is None or self.has("ROUTE-011"):
            self.peers[end] = sender
        for frame in frames[:1] if self.has("ROUTE-007") else frames:
            holds = crc_holds(frame)
            if holds is False and not self.has("ROUTE-006") or holds is None and self.has("ROUTE-005"):
                continue
            self.systems[end].add(frame.system)
            if self.passes(end, frame):
                self.hand_on(end, frame)

    def passes(self, end, frame):
        target = frame.values.get("target_system", 0)
        if frame.id in BY_ID and frame.name == "SETUP_SIGNING" and self.has("ROUTE-010"):
            return True
        if target == 0:
            self.broadcasts += end == 1
            return not (self.has("ROUTE-001") and end == 1 and self.broadcasts > 2)
        return target in self.systems[1 - end] and not self.has("ROUTE-002")

    def hand_on(self, end, frame):
        raw = frame.raw
        if frame.signed and self.has("ROUTE-003"):
            raw = raw[:2] + bytes([raw[2] & 0xFE]) + raw[3:-13]
        if self.has("ROUTE-013"):
            if self.held is None:
                self.held = (1 - end, raw)
                return
            self.send(1 - end, raw)
            self.send(*self.held)
            self.held = None
            return
        for _ in range(2 if self.has("ROUTE-009") else 1):
            self.send(1 - end, raw)
        if self.has("ROUTE-004"):
            self.send(end, raw)

    def send(self, end, raw):
        if self.peers[end]:
            self.ends[end].sendto(raw, self.peers[end])
