"""Bytes to messages and back.

Sending is the reference codec's. Receiving is more careful than an oracle has to be: a damaged message is
dropped with all that follows it in its datagram, because its length cannot be trusted to say where the
next one begins; an unknown message with a good checksum is skipped alone.
"""
import sys
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "data" / "dli"))
import reference  # noqa: E402

MAX_DATAGRAM = 548
MAX_DATA = 528
BROADCAST, NULL_ID = 0xFFFFFFFF, 0xFF000000
HEADER = reference.HEADER
TRAILER_BYTES = (0, 2, 4, 4)
EDITIONS = {"3": 30, "4": 32}
# Edition 3 ends 3002 with the commanded thrust.
EDITION_3_FIELDS = {3002: 19}


class Malformed(ValueError):
    """A message that contradicts itself."""


@dataclass
class Message:
    """One message that arrived whole."""

    id: int
    source: int
    destination: int
    ack: bool
    idd: int
    fields: dict
    wire: bytes = field(repr=False, default=b"")

    @property
    def stamp(self):
        return self.fields.get("Time Stamp")


class Codec:
    """Both directions, for one edition and one style of checksum."""

    def __init__(self, edition="4", style=2):
        self.idd, self.style = EDITIONS[edition], style

    # Receiving

    def messages(self, datagram, known_source):
        """The messages of a datagram in their order; `known_source` spares the work for strangers."""
        if len(datagram) > MAX_DATAGRAM:
            return
        for raw in self.split(datagram):
            if not known_source(self.source_of(raw)):
                continue
            try:
                message = self.decode(raw)
            except Malformed:
                return
            if message is not None:
                yield message
            elif not self.continues_after_unknown():
                return

    def split(self, datagram):
        """The messages of a datagram as bytes, as long as each is whole and its checksum right."""
        at = 0
        while len(datagram) - at >= HEADER.size:
            length = self.data_length(datagram, at)
            style = datagram[at + 15] >> 6
            end = at + HEADER.size + length
            if not 0 < length <= MAX_DATA or end + TRAILER_BYTES[style] > len(datagram):
                return
            raw = datagram[at : end + TRAILER_BYTES[style]]
            if not self.checksum_matches(style, raw[: HEADER.size + length], raw[HEADER.size + length :]):
                return
            yield raw
            at += len(raw)

    def source_of(self, raw):
        return HEADER.unpack_from(raw)[2]

    def data_length(self, datagram, at):
        return int.from_bytes(datagram[at + 2 : at + 4], "big")

    def checksum_matches(self, style, covered, trailer):
        return reference.checksum(style, covered) == trailer

    def serves(self, idd):
        return 30 <= idd <= 32

    def continues_after_unknown(self):
        return True

    def decode(self, raw):
        """The message, or None where its type or edition is not served."""
        _, length, source, destination, id, properties = HEADER.unpack_from(raw)
        layout = reference.MESSAGES.get(id)
        idd = properties >> 8 & 127
        if layout is None or not layout["fields"] or not reference.known(layout) or not self.serves(idd):
            return None
        data = raw[HEADER.size : HEADER.size + length]
        fields = self.fields(layout, data)
        return Message(id, source, destination, bool(properties >> 15), idd, fields, raw)

    def fields(self, layout, data):
        """The fields that the presence vector names; anything missing or left over makes the message malformed."""
        at = layout["pv_bytes"]
        presence = int.from_bytes(data[:at], "big")
        if len(data) < at or presence >> len(layout["fields"]):
            raise Malformed("presence vector")
        fields = {}
        for item in layout["fields"]:
            if presence >> item["bit"] & 1:
                size = reference.width(item["type"])[0]
                if at + size > len(data):
                    raise Malformed(item["name"])
                fields[item["name"]] = self.value(item["type"], data[at : at + size])
                at += size
        if at != len(data):
            raise Malformed("bytes left over")
        return fields

    def value(self, kind, data):
        if kind.startswith("char"):
            # A text without NUL ends with its field, and what is not ASCII becomes a question mark.
            text = data[: len(data) - 1].split(b"\0")[0].decode("ascii", "replace")
            return text.replace("\ufffd", "?")
        return reference.get(kind, data)

    # Sending

    def encode(self, id, source, destination, fields, ack=False):
        limit = EDITION_3_FIELDS.get(id) if self.idd == 30 else None
        if limit:
            names = [f["name"] for f in reference.MESSAGES[id]["fields"][:limit]]
            fields = {name: value for name, value in fields.items() if name in names}
        return reference.encode({"id": id, "source": source, "destination": destination, "ack": ack, "idd": self.idd,
                                 "checksum": self.style, "fields": fields})

    def pack(self, wires):
        """Datagrams for messages that leave together: one each."""
        return list(wires)


def parse_id(text):
    """An identification number from `1b:00:00:a0`."""
    parts = text.split(":")
    if len(parts) != 4:
        raise ValueError(f"{text!r} is no identification number: expected four bytes such as 1b:00:00:a0")
    return int.from_bytes(bytes(int(part, 16) for part in parts), "big")


def show_id(id):
    return ":".join(f"{byte:02x}" for byte in id.to_bytes(4, "big"))


def signed(id):
    """An identification number as the Integer 4 that fields hold."""
    return id - 2**32 if id >= 2**31 else id


def unsigned(id):
    return id & 0xFFFFFFFF
