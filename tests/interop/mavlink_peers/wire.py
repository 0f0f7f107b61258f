"""MAVLink 2 on the wire: frames, checksums, signatures. The table of messages is `conformance/mavlink/messages.txt`."""
import hashlib
import struct
import time
from dataclasses import dataclass, field
from pathlib import Path

EPOCH_2015_S = 1_420_070_400
CODES = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i", "u64": "Q", "i64": "q", "f32": "f", "f64": "d", "char": "s"}


def now_stamp():
    return int((time.time() - EPOCH_2015_S) * 100_000)


def crc(data):
    value = 0xFFFF
    for byte in data:
        byte ^= value & 0xFF
        byte = (byte ^ byte << 4) & 0xFF
        value = (value >> 8) ^ (byte << 8) ^ (byte << 3) ^ (byte >> 4)
    return value


class Message:
    """One line of the table."""

    def __init__(self, line):
        number, self.name, extra, *fields = line.split()
        self.id, self.extra, self.fields, code = int(number), int(extra), [], "<"
        for one in fields:
            if one == "|":
                continue
            name, kind = one.split(":")
            kind, _, count = kind.partition("[")
            count = int(count.rstrip("]") or 1)
            scalar = count == 1 or kind == "char"
            code += f"{count}s" if kind == "char" or (kind == "u8" and count > 1) else CODES[kind] * count
            self.fields.append((name, 1 if scalar or kind == "u8" else count))
        self.layout = struct.Struct(code)

    def pack(self, values):
        flat = []
        for name, count in self.fields:
            value = values.get(name, 0)
            if count > 1:
                flat += list(value) if value else [0] * count
            elif isinstance(value, str):
                flat.append(value.encode())
            else:
                flat.append(value)
        codes = [c for c in self.layout.format if c in "BbHhIiQqfds"]
        flat = [b"" if code == "s" and value == 0 else value for code, value in zip(codes, flat)]
        return self.layout.pack(*flat)

    def unpack(self, payload):
        flat = iter(self.layout.unpack((payload + bytes(self.layout.size))[: self.layout.size]))
        values = {}
        for name, count in self.fields:
            value = [next(flat) for _ in range(count)] if count > 1 else next(flat)
            values[name] = value.rstrip(b"\0").decode(errors="replace") if isinstance(value, bytes) and name != "secret_key" else value
        return values


TABLE = Path(__file__).resolve().parents[3] / "conformance/mavlink/messages.txt"
BY_NAME = {m.name: m for m in (Message(line) for line in TABLE.read_text().splitlines() if line[0].isdigit())}
BY_ID = {m.id: m for m in BY_NAME.values()}


@dataclass
class Frame:
    """A frame as it came."""

    id: int
    system: int
    component: int
    seq: int
    incompat: int
    payload: bytes
    raw: bytes
    version: int = 2
    link: int = 0
    stamp: int = 0
    signature: bytes = b""
    values: dict = field(default_factory=dict)

    @property
    def name(self):
        return BY_ID[self.id].name if self.id in BY_ID else str(self.id)

    @property
    def signed(self):
        return bool(self.incompat & 1)

    def verifies(self, key, link=None):
        trailer = bytes([self.link if link is None else link]) + self.raw[-12:-6]
        return self.signed and hashlib.sha256(key + self.raw[:-13] + trailer).digest()[:6] == self.signature


def crc_holds(frame):
    message = BY_ID.get(frame.id)
    if message is None:
        return None
    end = len(frame.raw) - 2 - (13 if frame.signed else 0)
    return crc(frame.raw[1:end] + bytes([message.extra])) == int.from_bytes(frame.raw[end : end + 2], "little")


def parse(data):
    """Frames of a buffer and the rest that may begin one; garbage is passed over, and so is what has no right checksum."""
    frames, at = [], 0
    while at < len(data):
        if data[at] == 0xFD:
            if len(data) - at < 12:
                return frames, data[at:]
            length, incompat, _, seq, system, component = data[at + 1 : at + 7]
            size = 12 + length + (13 if incompat & 1 else 0)
            if len(data) - at < size:
                return frames, data[at:]
            raw = data[at : at + size]
            frame = Frame(int.from_bytes(raw[7:10], "little"), system, component, seq, incompat, raw[10 : 10 + length], raw)
            if frame.signed:
                frame.link, frame.stamp, frame.signature = raw[-13], int.from_bytes(raw[-12:-6], "little"), raw[-6:]
        elif data[at] == 0xFE and len(data) - at >= 8 and len(data) - at >= 8 + data[at + 1]:
            size = 8 + data[at + 1]
            raw = data[at : at + size]
            frame = Frame(raw[5], raw[3], raw[4], raw[2], 0, raw[6:-2], raw, version=1)
        else:
            at += 1
            continue
        yield_it = frame.id in BY_ID or frame.id > 0
        if yield_it:
            frame.values = BY_ID[frame.id].unpack(frame.payload) if frame.id in BY_ID else {}
            frames.append(frame)
        at += size
    return frames, b""


def pack(name, values, system, component, seq, key=None, link=0, stamp=0, truncate=True, crc_flip=0, version=2):
    message = BY_NAME[name]
    payload = message.pack(values)
    if truncate:
        payload = payload.rstrip(b"\0") or b"\0"
    if version == 1:
        body = bytes([len(payload), seq, system, component, message.id]) + payload
        return b"\xfe" + body + crc(body + bytes([message.extra])).to_bytes(2, "little")
    head = bytes([len(payload), 1 if key else 0, 0, seq, system, component]) + message.id.to_bytes(3, "little")
    body = b"\xfd" + head + payload
    body += (crc(body[1:] + bytes([message.extra])) ^ crc_flip).to_bytes(2, "little")
    if key:
        body += bytes([link]) + stamp.to_bytes(6, "little")
        body += hashlib.sha256(key + body).digest()[:6]
    return body
