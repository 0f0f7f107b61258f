"""STANAG 4586 DLI messages of Editions 2.5, 3 and 4: encode, decode, look up.

    >>> import stanag_msgs as dli
    >>> wire = dli.encode({"id": 3001, "source": "1b:00:01:01", "destination": "ff:ff:ff:ff",
    ...                    "fields": {"Select Flight Path Control Mode": "loiter"}})
    >>> wire.hex()
    '000000021b000101ffffffff0bb92000020c'
    >>> dli.decode(wire)[0]["fields"]
    {'Select Flight Path Control Mode': 'loiter'}

A message is a dictionary, the same that `vsm decode` prints. Of Editions 3 and 4: `id`, `source`, `destination`, `fields`
and, where they are not False, 32 and 0, `ack`, `idd` (30 to 32) and `checksum` (style 0 to 3). Of Edition 2.5: `id`, `idd`
(the text of its wrapper, "2.5"), `instance` and `fields`, among which are sender and receiver. Fields have the names of the
table, in SI units, enumerations by their text, bitmaps as lists of texts (`["LOI 2", "LOI 4"]`); with `raw=True` the integers
of the wire. Ids may be given as text or as integers everywhere; `decode` gives integers, unsigned for source and destination,
signed in fields (-1 is broadcast, "ff:ff:ff:ff"). A field that is not sent is not
in the dictionary. JSON has no NaN: it is the text "NaN", infinities "Infinity" and "-Infinity".
"""
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

from . import _native

__all__ = ["Message", "DliError", "Field", "MessageInfo", "decode", "encode", "messages"]

Message = dict[str, Any]
Edition = Literal["2.5", "3", "4"]


class DliError(ValueError):
    """What is no message: the reason, and for a datagram where in it (`offset`, in bytes) and the messages beside it."""

    def __init__(self, reason: str, offset: int | None = None, messages: list[Message] | None = None) -> None:
        super().__init__(reason)
        self.offset = offset
        self.messages = messages or []


def decode(datagram: bytes, *, raw: bool = False) -> list[Message]:
    """The messages of a datagram; its edition is known from its first byte.

    Raises DliError where a part of it is no message; the error has those that are.
    """
    found: list[Message] = json.loads(_native.decode(bytes(datagram), raw))
    good = [message for message in found if "error" not in message]
    for message in found:
        if "error" in message:
            raise DliError(message["error"], message["offset"], good)
    return good


def encode(message: Mapping[str, Any], *, raw: bool = False) -> bytes:
    """The datagram of a message. Raises DliError that names the field, its value and what was expected."""
    try:
        text = json.dumps(message, allow_nan=False)
    except TypeError as error:
        raise DliError(str(error)) from None
    except ValueError:
        raise DliError("a value is not finite: JSON has no such numbers, use the text 'NaN' or 'Infinity'") from None
    try:
        return bytes(_native.encode(text, raw))
    except ValueError as error:
        raise DliError(str(error)) from None


@dataclass(frozen=True)
class Field:
    """A field: its number (from 1), its type on the wire, what a step of it is worth, and what values it may have."""

    number: int
    name: str
    type: str
    step: float
    unit: str | None
    range: tuple[float, float] | None
    values: dict[int, str] | None
    bitmap: bool


@dataclass(frozen=True)
class MessageInfo:
    """A message of the table. `confidence` is A (text), B (one source), C (inferred) or ?."""

    id: int
    name: str
    direction: str
    confidence: str
    fields: tuple[Field, ...]


@cache
def messages(edition: Edition = "4") -> dict[int, MessageInfo]:
    """The message table of an edition, by type; Editions 3 and 4 share one. Raises DliError for another."""
    if edition not in ("2.5", "3", "4"):
        raise DliError(f"edition {edition!r}, expected '2.5', '3' or '4'")
    rows = json.loads(_native.table(edition == "2.5"))
    return {row["id"]: _message(row) for row in rows}


def _message(row: dict[str, Any]) -> MessageInfo:
    fields = tuple(_field(field) for field in row["fields"])
    return MessageInfo(row["id"], row["name"], row["direction"], row["confidence"], fields)


def _field(row: dict[str, Any]) -> Field:
    enumeration = row["enumeration"]
    low_high = row["range"]
    return Field(
        number=row["number"],
        name=row["name"],
        type=row["type"],
        step=row["step"],
        unit=row["unit"],
        range=(low_high[0], low_high[1]) if low_high else None,
        values={value: text for value, text in enumeration["values"]} if enumeration else None,
        bitmap=bool(enumeration and enumeration["bitmap"]),
    )
