"""Edition 2.5 on the wire, Edition 4 inside: a codec that turns the messages of one into those of the other.

The correspondence is that of the public facts about Edition 2.5 (`ed25.toml`), field by field. Numbers are
turned to steps of Edition 4 that need not be whole, so that what was uploaded comes back as it was sent.
"""
import re
import struct
import time

from . import units
from .wire import MAX_DATAGRAM, Message, reference, signed, unsigned

import reference_ed25 as ed25  # isort: skip - `wire` puts its folder on the path

OWN_HEADER = ed25.HEADER
TRAILER_BYTES = 4
VERSIONS = ("2.5", "7", "8", "9")
MAX_DATA = MAX_DATAGRAM - OWN_HEADER.size - TRAILER_BYTES
CUCS_ID = struct.Struct(">8xiI")
EPOCH_MS = units.EPOCH_2000_S * 1000
ACKNOWLEDGE = 1401
MODE, STEER = 42, 43
# How long a steering command and the mode command that belongs to it may lie apart.
TOGETHER_S = 10.0
MESSAGE_FIELDS = {"Requested Message", "Requested Message Type", "Message Type", "Original Message Type", "Reported Message"}


def edition_4(field):
    """(message, place) of the field in Edition 4 that corresponds, or None."""
    match = re.fullmatch(r"(\d+)\.(\d+)", field.get("ed4", ""))
    return (int(match[1]), int(match[2])) if match else None


FIELDS_4 = {(id, f["bit"] + 1): f for id, m in reference.MESSAGES.items() for f in m["fields"]}
TO_4 = {m["id"]: m["ed4_message"][0] for m in ed25.FACTS["message"] if m.get("ed4_message")}
FROM_4 = {}
for _id, _id_4 in TO_4.items():
    FROM_4.setdefault(_id_4, _id)
# The mode preference has no message in Edition 4. Inside it is one setting more of 2017, and 3004 reports it as #109.
PREFERENCE, PREFERENCE_REPORT, PREFERENCE_NAME = 48, 109, "Mode Preference"
TO_4 |= {PREFERENCE: 2017, PREFERENCE_REPORT: 3004}
FROM_4[3004] = PREFERENCE_REPORT
PLACES = {edition_4(f): (m["id"], f) for m in ed25.FACTS["message"] for f in m["fields"] if edition_4(f)}


def scale_of(field_4):
    """What one step of an Edition 4 field is worth, in the unit that Edition 2.5 sends."""
    kind = field_4["type"]
    if kind.startswith("bam"):
        return units.math.pi / 2 ** (int(kind[3:]) - 1)
    return field_4.get("scale", 1)


class Steps(float):
    """A number of steps that need not be whole, with the value that it was made from."""

    def __new__(cls, value, step):
        made = super().__new__(cls, value / step)
        made.sent = value
        return made


def into_4(field, field_4, value):
    """A value of Edition 2.5 in steps of Edition 4; a fraction of a step is kept."""
    if isinstance(value, str):
        return value
    if field_4["type"] == "u40" and field["type"] == "f64":
        return round(value * 1000) - EPOCH_MS
    if field["type"].startswith("f") and not field_4["type"].startswith("f"):
        return Steps(value, scale_of(field_4))
    if field["type"] == "u32" and field_4["type"] == "u16":
        return value & 0xFFFF
    return value


def from_4(field, field_4, value):
    if isinstance(value, str):
        return value
    if field_4["type"] == "u40" and field["type"] == "f64":
        return (value + EPOCH_MS) / 1000
    if field["type"].startswith("f"):
        return value.sent if isinstance(value, Steps) else float(value * scale_of(field_4))
    bits, is_signed = int(field["type"][1:]), field["type"][0] == "i"
    low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if is_signed else (0, 2**bits - 1)
    return int(units.clamp(value, low, high))


class Codec25:
    """The codec of Edition 2.5, with the surface of that of Edition 4."""

    def __init__(self):
        self.instances, self.acknowledged, self.steered, self.originals = {}, {}, {}, {}
        # After a restart none is used again.
        self.first = int(time.time() * 100) % 2**31

    # Receiving

    def messages(self, datagram, known_source):
        at = 0
        while len(datagram) - at >= OWN_HEADER.size + TRAILER_BYTES and len(datagram) <= MAX_DATAGRAM:
            version, instance, id, length, _, _ = OWN_HEADER.unpack_from(datagram, at)
            end = at + OWN_HEADER.size + length + TRAILER_BYTES
            if not 0 < length <= MAX_DATA or end > len(datagram):
                return
            raw, at = datagram[at:end], end
            if not self.checksum_matches(raw):
                return
            if length < CUCS_ID.size or not known_source(self.source_of(raw)) or not self.serves(ed25.text(version)):
                continue
            message = self.decode(raw, id, instance)
            if message is not None:
                yield message

    def checksum_matches(self, raw):
        return int.from_bytes(raw[-TRAILER_BYTES:], "big") == sum(raw[:-TRAILER_BYTES]) % 2**32

    def serves(self, version):
        return version in VERSIONS

    def source_of(self, raw):
        return CUCS_ID.unpack_from(raw, OWN_HEADER.size)[1]

    def decode(self, raw, id, instance):
        """The message in Edition 4, or None where there is none that corresponds."""
        if id not in ed25.MESSAGES:
            return None
        try:
            fields = ed25.decode(raw)[0]["fields"]
        except (ValueError, KeyError, struct.error, UnicodeDecodeError):
            return None
        if not {"CUCS ID", "Vehicle ID"} <= set(fields):
            # #600 and the like name stations and vehicles by other fields, and are not served.
            return None
        source, destination = unsigned(fields["CUCS ID"]), unsigned(fields["Vehicle ID"])
        if any(isinstance(v, float) and not units.math.isfinite(v) for v in fields.values()):
            return None
        if id == ACKNOWLEDGE:
            self.acknowledged.setdefault(source, set()).add(fields["Message Type"])
            return None
        if id not in TO_4:
            return None
        made = self.preference(fields) if id == PREFERENCE else self.fields(id, fields)
        if (id == 1 and not made.get("Requested/Handover Access")) and destination != 0xFFFFFFFF or (id == 1200 and made.get("Request Type") == 6):
            self.acknowledged.pop(source, None)
        self.together(id, source, made)
        ack = id in self.acknowledged.get(source, ())
        self.originals[source, TO_4[id], made.get("Time Stamp")] = instance, id
        return Message(TO_4[id], source, destination, ack, 32, made, raw)

    @staticmethod
    def preference(values):
        """What rules over altitude, speed and course, as one number."""
        parts = [values[f["name"]] for f in ed25.MESSAGES[PREFERENCE]["fields"][3:]]
        number = sum(part * 3**k for k, part in enumerate(parts)) if max(parts) < 3 else 27
        return {"Time Stamp": round(values["Time Stamp"] * 1000) - EPOCH_MS, PREFERENCE_NAME: number}

    def fields(self, id, values):
        made = {}
        for field in ed25.MESSAGES[id]["fields"]:
            place = edition_4(field)
            if place and place[0] == TO_4[id] and field["name"] in values:
                made[FIELDS_4[place]["name"]] = into_4(field, FIELDS_4[place], values[field["name"]])
        for name in MESSAGE_FIELDS & set(made):
            made[name], number = self.message_4(made[name], made.get("Requested Field"))
            if number:
                made["Requested Field"] = number
        return made

    @staticmethod
    def message_4(id, number=None):
        """The Edition 4 message, and the place of one of its fields, that a number of Edition 2.5 means."""
        field = next((f for f in ed25.MESSAGES.get(id, {"fields": ()})["fields"] if f["n"] == number), None)
        place = field and edition_4(field)
        return place or (TO_4.get(id, 0), 0)

    def together(self, id, source, made):
        """#42 and #43 are one message in Edition 4: what says "no command" is left out, and a mode takes the steering before it."""
        if id == STEER:
            kinds = {"Altitude Command Type": ("Commanded Altitude", "Commanded Vertical Speed"),
                     "Heading Command Type": ("Commanded Heading", "Commanded Course", "Commanded Turn Rate", "Commanded Roll Rate", "Commanded Roll")}
            for kind, values in kinds.items():
                if not made.get(kind):
                    for name in (kind, *values):
                        made.pop(name, None)
            if not made.get("Loiter Position Latitude") and not made.get("Loiter Position Longitude"):
                made.pop("Loiter Position Latitude", None)
                made.pop("Loiter Position Longitude", None)
            for name in ("Commanded Waypoint Number", "Commanded Speed"):
                if not made.get(name):
                    made.pop(name, None)
            self.steered[source] = time.monotonic(), dict(made)
        elif id == MODE and source in self.steered:
            at, steering = self.steered.pop(source)
            if time.monotonic() - at < TOGETHER_S:
                made.update({**steering, **made})

    # Sending

    def encode(self, id, source, destination, fields, ack=False):
        """The message of Edition 2.5; no bytes where it has none."""
        if id in (41000, 41001, 41002, 41003, 44003):
            return self.encode_configuration(id, source, destination, fields)
        if id not in FROM_4:
            return b""
        own = FROM_4[id]
        values = self.values(own, id, fields)
        if own == PREFERENCE_REPORT:
            number = fields.get(PREFERENCE_NAME, 0)
            values = {"Time Stamp": (fields["Time Stamp"] + EPOCH_MS) / 1000}
            values |= {f["name"]: number // 3**k % 3 for k, f in enumerate(ed25.MESSAGES[own]["fields"][3:])}
        if id == 17000:
            instance, original = self.originals.get((destination, fields["Original Message Type"], fields["Original Message Time Stamp"]), (0, 0))
            values |= {"Original Message Instance ID": instance, "Original Message Type": original}
        return self.wrap(own, source, destination, values)

    def values(self, own, id, fields):
        values = {}
        for field in ed25.MESSAGES[own]["fields"]:
            place = edition_4(field)
            name = place and place[0] == id and FIELDS_4[place]["name"]
            if name and name in fields:
                values[field["name"]] = from_4(field, FIELDS_4[place], fields[name])
        return values

    def wrap(self, own, source, destination, values):
        names = {field["name"] for field in ed25.MESSAGES[own]["fields"]}
        vehicle = {name: id for name, id in (("Vehicle ID", signed(source)), ("CUCS ID", signed(destination))) if name in names}
        self.instances[own] = self.instances.get(own, self.first) + 1
        return ed25.encode({"id": own, "instance": self.instances[own], "fields": {**values, **vehicle}})

    def encode_configuration(self, id, source, destination, fields):
        """Limits go as integers or as doubles, by the type that the field has in Edition 2.5."""
        message, number = ("Reported Message", "Reported Field") if id == 44003 else ("Requested Message", "Requested Field")
        target = PLACES.get((fields[message], fields[number]))
        if target is None and not (fields[number] == 0 and fields[message] in FROM_4):
            return b""
        own_message, field = target or (FROM_4[fields[message]], None)
        scaled = field is not None and field["type"].startswith("f")
        own, like = {41002: (1302, 41002), 44003: (1303, 44003)}.get(id, (1301, 41001) if scaled else (1300, 41000))
        values = self.values(own, like, {n: v for n, v in fields.items() if n not in (message, number)})
        if scaled:
            step = scale_of(FIELDS_4[fields[message], fields[number]])
            values |= {n: float(fields[n] * step) for n in fields if n in values and n.endswith(("Value", "Limit", "Resolution"))}
        if own in (1300, 1301):
            # Every field is always there: a limit that was not given is the end of the display.
            ends = {"High": values.get("Max Display Value", 0), "Low": values.get("Min Display Value", 0)}
            values = {f"{end} {level} Limit": ends[end] for end in ends for level in ("Caution", "Warning")} | values
        return self.wrap(own, source, destination, {**values, message: own_message, number: field["n"] if field else 0})

    def pack(self, wires):
        return [wire for wire in wires if wire]
