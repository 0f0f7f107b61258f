"""An autopilot on the ground: heartbeat, commands, parameters, missions, signing. A fault is named after the rule that it breaks."""
import select
import socket
import struct
import time

from .wire import BY_ID, crc_holds, now_stamp, pack, parse

LOITER, MISSION = 0x03040000, 0x04040000
SECOND, MINUTE, HOUR = 100_000, 6_000_000, 360_000_000
PARAMETERS = {"MIS_TAKEOFF_ALT": (9, 2.5), "NAV_ACC_RAD": (9, 10.0), "SYS_AUTOSTART": (6, 4001), "COM_RC_IN_MODE": (6, 1), "COM_ARM_CHECKS_X": (9, 1.0)}
PARAMETERS.update({f"ZZ_FILL_{n:02}": (9, float(n)) for n in range(40)})
REPEATED = 0.25
GIVE_UP = 4.0
MAX_ITEMS = 2000


class Autopilot:
    def __init__(self, links, key, faults, system=1, ports=()):
        self.links, self.key, self.faults, self.system = links, key, faults, system
        self.sockets = []
        for number, _ in enumerate(links):
            sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            # Fixed, so that a restart is at the same address.
            sock.bind(("127.0.0.1", ports[number] if ports else 0))
            sock.setblocking(False)
            self.sockets.append(sock)
        self.peers, self.rest, self.seq = list(links), [b""] * len(links), [0] * len(links)
        self.stamp, self.offset, self.streams, self.first_seen, self.boot = now_stamp(), 0, {}, set(), time.monotonic()
        self.mode, self.armed, self.parameters = LOITER, False, dict(PARAMETERS)
        self.plans, self.transfer, self.intervals, self.current, self.plan_id = {0: [], 1: [], 2: []}, None, {}, 0, 0
        self.ground, self.lost, self.last_ack, self.acks, self.dead = time.monotonic(), False, 0.0, [], False
        self.at_once, self.verified_raw = set(), set()

    def has(self, fault):
        return fault in self.faults

    # Sending

    def next_stamp(self):
        rate = 1 if not self.has("SIGN-040") else 0
        follow = now_stamp() if rate else 0
        self.stamp = max(self.stamp + 1, follow + self.offset)
        if self.has("SIGN-002") and self.seq[0] % 7 == 0:
            return self.stamp - 6000
        return self.stamp + (50 * 365 * 24 * HOUR if self.has("SIGN-010") else 0)

    def send(self, name, values, link=None, key=...):
        key = self.key if key is ... else key
        for n, sock in enumerate(self.sockets):
            if link is not None and n != link:
                continue
            flip = 0x33 if self.has("FRAME-001") and name == "ATTITUDE" else 0
            unsigned = self.has("SIGN-015") and name == "HEARTBEAT"
            used = bytes(b ^ 1 for b in key) if key and self.has("SIGN-014") and name == "SYS_STATUS" else key
            frame = pack(name, values, self.system, 1, self.seq[n], None if unsigned else used, n, self.next_stamp() if key else 0, not self.has("FRAME-009"), flip)
            self.seq[n] = (self.seq[n] + (1 if not self.has("FRAME-008") else 3)) % 256
            sock.sendto(frame, self.peers[n])

    def run(self):
        beat, fast, slow = 0, 0, 0
        while True:
            now = time.monotonic()
            if now >= beat:
                beat = now + (3.0 if self.has("HB-001") else 1.0)
                self.heartbeat()
            if now >= slow:
                slow = now + 1.0
                self.send("SYS_STATUS", {"onboard_control_sensors_health": 0x10000000})
                self.send("MISSION_CURRENT", {"seq": self.current, "total": len(self.plans[0]) or 65535, "mission_state": 2 if self.plans[0] else 1, "mission_id": self.plan_id + self.has("MISS-015")})
                self.send("GLOBAL_POSITION_INT", {"lat": 473977434, "lon": 85455939})
                if self.has("SIGN-016"):
                    self.send("SETUP_SIGNING", {"secret_key": self.key or bytes(32)}, 0)
                if self.has("SIGN-028") and self.key:
                    self.twin()
            if now >= fast:
                fast = now + self.intervals.get(30, 0.04)
                self.send("ATTITUDE", {"time_boot_ms": int((now - self.boot) * 1000), "roll": 0.5})
            if now - self.ground > 10 and not self.lost:
                self.lost = True
            self.watch_transfer(now)
            due = [ack for ack in self.acks if ack[0] <= now]
            self.acks = [ack for ack in self.acks if ack[0] > now]
            for _, values in due:
                self.send("COMMAND_ACK", values)
            for sock in select.select(self.sockets, [], [], 0.004)[0]:
                try:
                    data, address = sock.recvfrom(65536)
                except OSError:
                    continue
                self.receive(self.sockets.index(sock), data, address)

    def twin(self):
        """Another process with the same key and stream."""
        if not hasattr(self, "other"):
            self.other = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.other.sendto(pack("HEARTBEAT", {"type": 2, "autopilot": 12, "mavlink_version": 3}, self.system, 1, 0, self.key, 0, self.next_stamp()), self.peers[0])

    def heartbeat(self):
        self.send("HEARTBEAT", {"type": 2, "autopilot": 12, "base_mode": 0x1D | (0x80 if self.armed else 0), "custom_mode": self.mode, "system_status": 3, "mavlink_version": 3})

    # Receiving

    def receive(self, link, data, address):
        if self.dead or (self.has("FRAME-013") and (not data or len(data) > 1000)):
            self.dead = True
            return
        if self.has("FRAME-005") and data[:1] not in (b"\xfd", b"\xfe"):
            return
        before, stolen = self.rest[link], self.has("SIGN-021") or (self.has("SIGN-032") and not self.first_seen)
        frames, rest = parse(before + data if len(before) < 300 else data)
        if not frames and before:
            frames, rest = parse(data)
        self.rest[link] = b"" if self.has("FRAME-012") else rest[-280:]
        if self.has("FRAME-006"):
            frames = frames[:1]
        for frame in frames:
            if self.admit(link, frame):
                if not self.has("SIGN-032"):
                    self.peers[link] = address
                self.handle(link, frame)
            elif stolen:
                self.peers[link] = address
                self.first_seen.add(address)

    def admit(self, link, frame):
        if frame.version == 1:
            return not self.key or self.has("SIGN-033")
        if frame.incompat & ~1 and not self.has("FRAME-003"):
            return False
        if frame.raw[3] and self.has("FRAME-004"):
            return False
        known = BY_ID.get(frame.id)
        if known is None:
            self.dead = self.has("FRAME-010")
            return False
        if not crc_holds(frame) and not self.has("FRAME-002" if not frame.signed else "SIGN-009") and not (frame.signed and self.has("FRAME-002")):
            return False
        if self.has("FRAME-007") and len(frame.payload) > 1 and frame.payload[-1] == 0 or self.has("FRAME-011") and len(frame.payload) > known.layout.size:
            return False
        if frame.name == "HEARTBEAT" and frame.system == 201 and self.has("SIGN-024"):
            for n, sock in enumerate(self.sockets):
                if n != link:
                    sock.sendto(frame.raw, self.peers[n])
        return self.verified(link, frame) if self.key else True

    def verified(self, link, frame):
        if not frame.signed:
            if frame.name in ("HEARTBEAT", "RADIO_STATUS"):
                return False
            return self.has("SIGN-030") or (self.has("SIGN-036") and frame.name == "PARAM_SET") or (self.has("KEY-002") and frame.name == "SETUP_SIGNING")
        stream = (frame.system, frame.component, frame.link)
        if self.has("SIGN-013"):
            if frame.stamp <= self.streams.get(stream, -1):
                return False
            self.streams[stream] = frame.stamp
        good = frame.verifies(self.key) or self.has("SIGN-035") and frame.verifies(bytes(32)) or self.has("KEY-004") and frame.verifies(getattr(self, "old_key", self.key))
        if self.has("SIGN-029") and not good:
            good = any(frame.verifies(self.key, other) for other in range(256))
        if not good and not self.has("SIGN-031"):
            if self.has("SIGN-008") and frame.name == "HEARTBEAT":
                self.heard_ground()
            return False
        if self.has("SIGN-013"):
            return True
        return self.fresh(link, frame, stream)

    def fresh(self, link, frame, stream):
        last = self.streams.get(stream)
        if (frame.system, frame.component) == (self.system, 1) and not (self.has("SIGN-022") or self.has("SIGN-026")):
            return False
        if self.has("SIGN-006") and frame.raw not in self.at_once and last is not None and frame.stamp == last:
            # Both threads looked before either stored.
            self.at_once.add(frame.raw)
            return True
        if self.has("SIGN-005"):
            stream = (*stream, link)
            last = self.streams.get(stream)
        if last is None:
            if self.has("SIGN-007") and len(self.streams) >= 16:
                return False
            if self.has("SIGN-037") and frame.stamp > now_stamp() + 1_000_000:
                return False
            # A new stream: not older than a minute, as of the clock that no peer can shift far.
            reference = self.stamp if self.has("SIGN-012") else now_stamp()
            if self.has("SIGN-034"):
                reference = 0
            if frame.stamp + MINUTE < reference:
                return False
            # After a restart nothing of before it is taken.
            if frame.stamp <= self.floor() and not (self.has("SIGN-019") or self.has("SIGN-034")):
                return False
            self.streams[stream] = frame.stamp
        elif frame.stamp <= last:
            if self.has("SIGN-004") and last - frame.stamp < 1_000_000 and frame.raw not in self.verified_raw:
                self.verified_raw.add(frame.raw)
                return True
            return self.has("SIGN-003")
        elif not self.has("SIGN-003"):
            self.streams[stream] = frame.stamp
        if self.has("SIGN-004"):
            self.verified_raw.add(frame.raw)
        if self.has("SIGN-012") or frame.stamp < now_stamp() + HOUR:
            self.stamp = max(self.stamp, frame.stamp)
            if frame.stamp > self.stored:
                # Ahead of time, so that not every frame is a write.
                self.stored = frame.stamp + SECOND // 2
                self.store_stamp(self.stored)
        return True

    def floor(self):
        """What was stored ahead of time, so that it is there after a power cut."""
        return self.started

    started = stored = 0

    def store_stamp(self, stamp):
        pass

    def heard_ground(self):
        self.ground = time.monotonic()
        if self.lost:
            self.lost = False
            self.send("STATUSTEXT", {"severity": 6, "text": "GCS connection regained"})

    # Messages

    def handle(self, link, frame):
        v, sender = frame.values, {"target_system": frame.system, "target_component": frame.component}
        target = v.get("target_system")
        mine = target is None or target in (0, self.system) and v.get("target_component", 0) in (0, 1)
        name = frame.name
        if not mine:
            allowed = {"CMD-003": name.startswith("COMMAND") and target != self.system, "CMD-004": name.startswith("COMMAND") and target == self.system,
                       "PARAM-007": name == "PARAM_REQUEST_READ", "MISS-013": name == "MISSION_COUNT", "KEY-003": name == "SETUP_SIGNING"}
            if not any(self.has(fault) and holds for fault, holds in allowed.items()):
                return
        if name == "HEARTBEAT" and v["type"] == 6:
            self.heard_ground()
        elif name == "TIMESYNC" and v["tc1"] == 0:
            self.send("TIMESYNC", {"tc1": time.monotonic_ns(), "ts1": v["ts1"]}, link)
        elif name == "SYSTEM_TIME" and self.has("SIGN-011"):
            self.offset = int((v["time_unix_usec"] / 1e6 - time.time()) * 100_000)
        elif name in ("COMMAND_LONG", "COMMAND_INT"):
            own = (frame.system, frame.component) == (self.system, 1)
            if not (own and self.has("SIGN-022")):
                self.command(link, name, v, sender)
        elif name == "SETUP_SIGNING":
            self.setup(v)
        elif name.startswith("PARAM"):
            if not ((frame.system, frame.component) == (self.system, 1) and self.has("SIGN-026")):
                self.parameter(link, name, v)
        elif name.startswith("MISSION"):
            self.mission(link, name, v, (frame.system, frame.component))

    def setup(self, v):
        key = v["secret_key"].ljust(32, b"\0")
        if (self.armed and not self.has("KEY-006")) or (not any(key) and not self.has("KEY-005")):
            return
        if self.has("KEY-001"):
            return
        self.old_key, self.key = self.key, key
        self.store_key()

    def store_key(self):
        pass

    def command(self, link, name, v, sender):
        number, result = v["command"], 3
        if name == "COMMAND_INT" and self.has("CMD-005"):
            return
        if number == 512:
            wanted = BY_ID.get(int(v["param1"]))
            known = wanted is not None and wanted.name in ("AUTOPILOT_VERSION", "PROTOCOL_VERSION", "HEARTBEAT", "HOME_POSITION")
            result = 0 if known or self.has("CMD-006") else 2
            if self.has("CMD-007") and v.get("confirmation"):
                return
            if known and wanted.name == "AUTOPILOT_VERSION":
                both = 16 | 131072 if self.has("PARAM-008") else 16
                self.send("AUTOPILOT_VERSION", {"capabilities": 0xE8EF & ~131072 | both, "flight_sw_version": 0x010000FF}, link)
        elif number == 511:
            result = 0
            if int(v["param1"]) == 30 and not self.has("CMD-008"):
                self.intervals[30] = v["param2"] / 1e6 if v["param2"] > 0 else 0.04
        elif number == 176:
            custom = int(v["param2"]) << 16 | int(v["param3"]) << 24
            if v["param7"] and not self.has("CMD-012"):
                result = 2
            elif custom in (LOITER, MISSION) or self.has("CMD-010"):
                result, self.mode = 0, self.mode if self.has("CMD-011") else custom
            else:
                result = 2
        elif number == 300:
            result = 0 if self.plans[0] or self.has("CMD-014") else 2
        elif number == 400:
            result, self.armed = 0, v["param1"] == 1
        elif self.has("CMD-002"):
            result = 0
        values = {"command": number, "result": result, **(sender if not self.has("CMD-001") else {"target_system": 9, "target_component": 9})}
        if self.has("CMD-013") and time.monotonic() - self.last_ack < 0.002:
            return
        self.last_ack = time.monotonic()
        if self.has("CMD-009"):
            self.acks.append((time.monotonic() + 0.7, values))
        else:
            self.send("COMMAND_ACK", values, link)

    # Parameters

    def value(self, link, name, index=None):
        names = list(self.parameters)
        kind, value = self.parameters[name]
        coded = struct.unpack("<f", struct.pack("<i", int(value)))[0] if kind == 6 else value
        number = names.index(name) if index is None else index
        self.send("PARAM_VALUE", {"param_value": coded, "param_count": len(names), "param_index": number, "param_id": name, "param_type": kind}, link)

    def parameter(self, link, name, v):
        names, wanted = list(self.parameters), v.get("param_id", "")
        if name == "PARAM_REQUEST_LIST":
            for number, one in enumerate(names):
                if not (self.has("PARAM-003") and number % 3 == 1):
                    self.value(link, one)
        elif name == "PARAM_REQUEST_READ" and v["param_index"] >= 0:
            if v["param_index"] < len(names) and not (self.has("PARAM-003") and v["param_index"] % 3 == 1):
                self.value(link, names[0] if self.has("PARAM-002") else names[v["param_index"]], v["param_index"])
        elif name == "PARAM_REQUEST_READ":
            if self.has("PARAM-001") or self.has("PARAM-010") and len(wanted) == 16:
                return
            if wanted in self.parameters:
                self.value(link, wanted)
            elif not self.has("PARAM-009"):
                self.send("PARAM_ERROR", {"param_id": wanted, "param_index": -1, "error": 1}, link)
        elif name == "PARAM_SET":
            self.set_parameter(link, wanted, v)

    def set_parameter(self, link, wanted, v):
        if wanted not in self.parameters:
            if self.has("PARAM-005"):
                self.parameters[wanted] = (9, v["param_value"])
                self.value(link, wanted)
            return
        kind, _ = self.parameters[wanted]
        if v["param_type"] != kind and not self.has("PARAM-006"):
            return
        value = struct.unpack("<i", struct.pack("<f", v["param_value"]))[0] if kind == 6 else v["param_value"]
        old = self.parameters[wanted]
        self.parameters[wanted] = (kind, value)
        self.value(link, wanted)
        if self.has("PARAM-004"):
            self.parameters[wanted] = old

    # Missions

    def ack(self, link, to, result, kind):
        self.send("MISSION_ACK", {"target_system": to[0], "target_component": to[1], "type": result, "mission_type": kind, "opaque_id": self.plan_id if kind == 0 else 0}, link)

    def request(self, again=False):
        t = self.transfer
        if not again or not self.has("MISS-003"):
            self.send("MISSION_REQUEST_INT", {"target_system": t["to"][0], "target_component": t["to"][1], "seq": t["next"], "mission_type": t["kind"]}, t["link"])
        t["asked"] = time.monotonic()

    def watch_transfer(self, now):
        t = self.transfer
        if t is None:
            return
        if now - t["progress"] > GIVE_UP:
            if not self.has("MISS-012"):
                self.transfer = None
        elif now - t["asked"] > REPEATED:
            self.request(again=True)

    def mission(self, link, name, v, sender):
        kind = v.get("mission_type", 0)
        if name == "MISSION_COUNT":
            self.begin(link, v, sender, kind)
        elif name == "MISSION_ITEM_INT":
            self.item(link, v, sender)
        elif name == "MISSION_CLEAR_ALL":
            for one in (0, 1, 2):
                if (one == kind or kind == 255 or self.has("MISS-019")) and not self.has("MISS-010"):
                    self.plans[one] = []
            self.ack(link, sender, 0, kind)
        elif name == "MISSION_REQUEST_LIST":
            if kind in self.plans:
                wrong = 7 if self.has("MISS-015") else 0
                self.send("MISSION_COUNT", {"target_system": sender[0], "target_component": sender[1], "count": len(self.plans[kind]), "mission_type": kind, "opaque_id": (self.plan_id if kind == 0 else 0) + wrong}, link)
                self.sent = set()
        elif name in ("MISSION_REQUEST_INT", "MISSION_REQUEST"):
            self.give(link, v["seq"], sender, kind)
        elif name == "MISSION_SET_CURRENT" and (v["seq"] < len(self.plans[0]) or self.has("MISS-016")):
            self.current = v["seq"]

    def give(self, link, seq, sender, kind):
        plan = self.plans.get(kind, [])
        if self.has("MISS-022"):
            if seq in self.sent:
                return
            self.sent.add(seq)
        if seq < len(plan) or self.has("MISS-018") and plan:
            item = {**plan[min(seq, len(plan) - 1)], "seq": seq}
            if self.has("MISS-002"):
                item["x"] += 40
            self.send("MISSION_ITEM_INT", {**item, "target_system": sender[0], "target_component": sender[1], "mission_type": kind}, link)

    def begin(self, link, v, sender, kind):
        if kind not in self.plans and not self.has("MISS-014"):
            self.ack(link, sender, 3, kind)
        elif v["count"] > MAX_ITEMS and not self.has("MISS-009"):
            self.ack(link, sender, 4, kind)
        elif self.transfer and self.transfer["to"] != sender and not self.has("MISS-011"):
            self.ack(link, sender, 1, kind)
        elif self.transfer and self.has("MISS-004"):
            self.ack(link, sender, 1, kind)
            self.transfer = None
        elif v["count"] == 0:
            self.plans[kind] = []
            self.ack(link, sender, 0, kind)
        else:
            if self.has("MISS-012"):
                self.plans[kind] = []
            now = time.monotonic()
            self.transfer = {"link": link, "to": sender, "kind": kind, "count": v["count"], "next": 1 if self.has("MISS-001") and v["count"] > 4 else 0, "items": [], "progress": now, "asked": now}
            self.request()

    def item(self, link, v, sender):
        t = self.transfer
        if t is None:
            if self.has("MISS-020") and v["seq"] < len(self.plans[0]):
                self.plans[0][v["seq"]] = v
            return
        if t["to"] != sender:
            return
        if v["seq"] != t["next"] and not self.has("MISS-005"):
            if self.has("MISS-006"):
                self.transfer = None
                self.ack(link, sender, 13, t["kind"])
            return
        reason = 0
        if v["frame"] not in (0, 3, 5, 6) and not self.has("MISS-007"):
            reason = 2
        elif v["command"] not in (16, 21, 22, 20, 5001, 5002) and not self.has("MISS-008"):
            reason = 3
        elif abs(v["x"]) > 900_000_000 and not self.has("MISS-017"):
            reason = 10
        if reason:
            if self.has("MISS-021"):
                self.plans[t["kind"]] = t["items"]
            self.transfer = None
            self.ack(link, sender, reason, t["kind"])
            return
        t["items"].append({k: v[k] for k in v if not k.startswith("target")})
        t["next"], t["progress"] = t["next"] + 1, time.monotonic()
        if t["next"] < t["count"]:
            self.request()
            return
        self.transfer = None
        if t["kind"] in self.plans:
            self.plans[t["kind"]] = t["items"]
        if t["kind"] == 0:
            self.plan_id, self.current = hash(str(t["items"])) & 0x7FFFFFFF | 1, 0
        self.ack(link, sender, 0, t["kind"])
