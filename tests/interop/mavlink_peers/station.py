"""A MAVLink 2 ground station, lawful or with a fault for each rule of a station: it reads the parameters, requests the version twice,
uploads a plan, and with `rotate` gives the vehicle a new key."""
import hashlib
import select
import socket
import time

from .autopilot import HOUR
from .wire import BY_ID, crc_holds, now_stamp, pack, parse

FAULTS = {
    "FRAME-001": "sends heartbeats with a wrong checksum",
    "FRAME-008": "counts frames by three",
    "FRAME-009": "does not truncate",
    "HB-001": "sends a heartbeat every three seconds",
    "CMD-101": "sends a command once",
    "CMD-102": "repeats a command that was answered",
    "CMD-103": "addresses commands to a system that is not there",
    "PARAM-101": "does not request a parameter that was lost",
    "MISS-101": "answers the request of each item once",
    "MISS-102": "sends MISSION_COUNT once",
    "SIGN-001": "counts frames in place of time",
    "SIGN-002": "goes back with every seventh timestamp",
    "SIGN-010": "stamps by another epoch",
    "SIGN-011": "sets its signing clock by SYSTEM_TIME",
    "SIGN-012": "follows any verified timestamp",
    "SIGN-014": "signs requests for parameters with another key",
    "SIGN-015": "sends heartbeats unsigned",
    "SIGN-016": "sends its key every two seconds",
    "SIGN-018": "takes the SHA-256 of the pass phrase for its key",
    "SIGN-020": "records frames with their signatures",
    "SIGN-024": "reads the parameters of systems that do not verify",
    "SIGN-025": "takes old acknowledgements",
    "SIGN-027": "takes silence for a refusal of the new key",
    "SIGN-028": "sends from two sockets in turn",
}
REPEATED, PAUSE = 1.0, 1.5
AGAIN_AT, ROTATE_AT = 8.0, 3.0
VERSION = 148
# Two waypoints, the first requested twice by the suite's vehicle.
ITEMS = [{"seq": n, "frame": 6, "command": 16, "autocontinue": 1, "x": 473_977_434 + 900 * n, "y": 85_455_939, "z": 30.0} for n in range(3)]


def key_of_phrase(phrase):
    """What a station must not do: a key that is as easy to guess as the phrase."""
    return hashlib.sha256(phrase).digest()


class Station:
    """Sends to whoever speaks to its port first."""

    def __init__(self, port, key, faults, recording=None, rotate=False):
        self.key, self.faults, self.rotate = key, faults, rotate
        self.sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
        self.sockets[0].bind(("127.0.0.1", port))
        self.recording = open(recording, "wb") if recording else None
        self.peer, self.vehicle, self.seq, self.stamp, self.count, self.offset = None, None, 0, now_stamp(), 0, 0
        self.streams, self.parameters, self.total = {}, {}, None
        self.command, self.upload, self.given, self.asked, self.strangers = None, None, set(), {}, set()
        self.begun, self.key_sent = time.monotonic(), 0.0

    def has(self, fault):
        return fault in self.faults

    def run(self):
        beat = 0.0
        while True:
            now = time.monotonic()
            if self.peer and now >= beat:
                beat = now + (3.0 if self.has("HB-001") else 1.0)
                self.send("HEARTBEAT", {"type": 6, "autopilot": 8, "mavlink_version": 3})
                if self.has("SIGN-016") and self.count % 2:
                    self.send("SETUP_SIGNING", {"target_system": 1, "target_component": 1, "secret_key": self.key})
            if self.vehicle:
                self.work(now)
            if select.select(self.sockets[:1], [], [], 0.02)[0]:
                self.receive(*self.sockets[0].recvfrom(65536))

    # Sending

    def next_stamp(self):
        clock = self.stamp + 1 if self.has("SIGN-001") else now_stamp() + self.offset
        self.stamp = max(self.stamp + 1, clock)
        if self.has("SIGN-002") and self.count % 7 == 6:
            return self.stamp - 60_000
        return self.stamp + (45 * 365 * 24 * HOUR if self.has("SIGN-010") else 0)

    def send(self, name, values):
        self.count += 1
        self.seq = (self.seq + (3 if self.has("FRAME-008") else 1)) % 256
        key = self.key
        if self.has("SIGN-015") and name == "HEARTBEAT":
            key = None
        if key and self.has("SIGN-014") and name.startswith("PARAM"):
            key = bytes(byte ^ 1 for byte in key)
        flip = 0x33 if self.has("FRAME-001") and name == "HEARTBEAT" else 0
        frame = pack(name, values, 255, 190, self.seq, key, 0, self.next_stamp() if key else 0, not self.has("FRAME-009"), flip)
        self.sockets[self.count % 2 if self.has("SIGN-028") else 0].sendto(frame, self.peer)
        self.record(frame)

    def record(self, frame):
        """A recording has no signatures: whoever reads it could send them again."""
        if self.recording:
            # The flag is cleared and the trailer left out; the checksum is then no longer right, which a reader of logs does not look at.
            kept = frame if self.has("SIGN-020") or not frame[2] & 1 else frame[:2] + bytes([frame[2] & 0xFE]) + frame[3:-13]
            self.recording.write(kept)
            self.recording.flush()

    def to_vehicle(self, **values):
        return {"target_system": 42 if self.has("CMD-103") else self.vehicle, "target_component": 1, **values}

    # What it does by itself

    def work(self, now):
        since = now - self.begun
        self.read_parameters(now)
        if self.command is None and since > 1:
            self.order(1)
        elif self.command and self.command["number"] == 1 and self.command["done"] and since > AGAIN_AT:
            self.order(2)
        if self.command:
            self.repeat_command(now)
        if self.upload is None and since > 2:
            self.upload = {"sent": 0.0, "begun": False, "done": False}
        if self.upload:
            self.repeat_count(now)
        if self.rotate and since > ROTATE_AT and not self.key_sent:
            new = bytes(byte ^ 0x5A for byte in self.key)
            self.send("SETUP_SIGNING", {"target_system": self.vehicle, "target_component": 1, "secret_key": new, "initial_timestamp": now_stamp()})
            self.key_sent = now
            if not self.has("SIGN-027"):
                self.key = new

    def read_parameters(self, now):
        if self.total is None:
            if now - self.asked.get("list", 0) > REPEATED:
                self.asked["list"] = now
                self.send("PARAM_REQUEST_LIST", self.to_vehicle())
            return
        for index in range(self.total):
            if index not in self.parameters and now - self.asked.get(index, self.asked["list"]) > PAUSE and not self.has("PARAM-101"):
                self.asked[index] = now
                self.send("PARAM_REQUEST_READ", self.to_vehicle(param_index=index))

    def order(self, number):
        self.command = {"number": number, "done": False, "sent": 0.0, "times": 0}

    def repeat_command(self, now):
        c = self.command
        if now - c["sent"] < REPEATED or (c["done"] and not self.has("CMD-102")) or (c["times"] and self.has("CMD-101")) or c["times"] > 12:
            return
        self.send("COMMAND_LONG", self.to_vehicle(command=512, confirmation=c["times"], param1=float(VERSION)))
        c["sent"], c["times"] = now, c["times"] + 1

    def repeat_count(self, now):
        u = self.upload
        if u["begun"] or now - u["sent"] < REPEATED or (u["sent"] and self.has("MISS-102")):
            return
        u["sent"] = now
        self.send("MISSION_COUNT", self.to_vehicle(count=len(ITEMS)))

    # Receiving

    def receive(self, data, address):
        for frame in parse(data)[0]:
            if frame.id not in BY_ID or not crc_holds(frame):
                continue
            self.peer = self.peer or address
            if self.has("SIGN-024") and frame.system in (77, 78) and frame.system not in self.strangers:
                self.strangers.add(frame.system)
                self.send("PARAM_REQUEST_LIST", {"target_system": frame.system, "target_component": 1})
            if self.believed(frame):
                self.take(frame)

    def believed(self, frame):
        if not self.key:
            return True
        stream = frame.system, frame.component, frame.link
        if not frame.signed or not frame.verifies(self.key):
            return False
        if self.streams.get(stream, 0) >= frame.stamp and not self.has("SIGN-025"):
            return False
        self.streams[stream] = max(self.streams.get(stream, 0), frame.stamp)
        # A peer that is ahead by more than clocks differ is no reason to be wrong as well.
        if self.has("SIGN-012") or frame.stamp < now_stamp() + HOUR and not self.has("SIGN-001"):
            self.stamp = max(self.stamp, frame.stamp)
        return True

    def take(self, frame):
        v = frame.values
        if frame.name == "HEARTBEAT" and v["autopilot"] == 12:
            self.vehicle = self.vehicle or frame.system
        elif frame.name == "SYSTEM_TIME" and self.has("SIGN-011"):
            self.offset = int((v["time_unix_usec"] / 1e6 - time.time()) * 100_000)
        elif frame.name == "PARAM_VALUE":
            self.total = v["param_count"]
            self.parameters[v["param_index"]] = v["param_value"]
        elif frame.name == "COMMAND_ACK" and self.command and v["command"] == 512 and self.command["times"]:
            self.command["done"] = True
        elif frame.name == "MISSION_REQUEST_INT" and self.upload and v["seq"] < len(ITEMS):
            self.upload["begun"] = True
            if not (self.has("MISS-101") and v["seq"] in self.given):
                self.given.add(v["seq"])
                self.send("MISSION_ITEM_INT", self.to_vehicle(**ITEMS[v["seq"]]))
        elif frame.name == "MISSION_ACK" and self.upload:
            self.upload["begun"] = self.upload["done"] = True
