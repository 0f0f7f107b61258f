"""The configuration phase: what 40000 is answered with, and 44003 when something becomes available or goes.

Numbers are those of the wire, in steps of the field that they describe; a field's number is its place in
its message, the time stamp being 1.
"""
from dataclasses import dataclass

from . import mission, steering
from .wire import reference

SINGLE, OF_LOI_2, OF_LOI_3, OF_LOI_4, OF_LOI_5, OF_LINK, ABORT = range(7)
AVAILABLE, UNAVAILABLE, NOT_IMPLEMENTED = 0, -1, -2
PER_TICK = 4
AIRBORNE_STATE, AIRBORNE_TEXT = 10, "AIRBORNE"
MODE_FIELD = "Select Flight Path Control Mode"


@dataclass(frozen=True)
class Range:
    """The limits of one numeric field, in steps on the wire."""

    level: int
    message: int
    field: str
    low: int
    high: int
    default: int
    help: str = ""
    low_caution: int | None = None
    low_warning: int | None = None


@dataclass(frozen=True)
class Named:
    """A vehicle-specific value of an enumerated field."""

    level: int
    message: int
    field: str
    index: int
    text: str
    help: str


ALTITUDES = (steering.LOWEST_ALTITUDE, steering.HIGHEST_ALTITUDE)
RANGES = (
    Range(OF_LOI_2, 3002, "Current Propulsion Energy Level", 0, 62_500, 62_500, "battery charge", 18_750, 9_375),
    Range(OF_LOI_2, 4000, "Altitude", *ALTITUDES, 25_000, "height above the ellipsoid"),
    Range(OF_LOI_3, 19001, "Set Centreline Azimuth Angle", -32_768, 32_767, 0, "to the right of the nose"),
    Range(OF_LOI_3, 19001, "Set Centreline Elevation Angle", -16_384, 5_461, 0, "up from the horizon"),
    Range(OF_LOI_4, 2016, "Commanded Altitude", *ALTITUDES, 25_000, "in the reference of Altitude Type"),
    Range(OF_LOI_4, 2016, "Commanded Speed", 0, steering.HIGHEST_SPEED, 24, "0: none"),
    Range(OF_LOI_4, 2017, "Loiter Radius", steering.LOWEST_RADIUS, steering.HIGHEST_RADIUS, 40, "of a circular loiter"),
    Range(OF_LOI_4, 13002, "Waypoint to Altitude", *ALTITUDES, 25_000, "in the reference of its type"),
    Range(OF_LOI_4, 13002, "Waypoint to Speed", 0, steering.HIGHEST_SPEED, 24, "0: as commanded"),
    Range(OF_LOI_4, 13003, "Loiter Radius", steering.LOWEST_RADIUS, steering.HIGHEST_RADIUS, 40, "of a circular loiter"),
    Range(OF_LOI_5, 2008, "Engine Number", 1, 2, 1, "from the left"),
)
NAMES = (
    Named(OF_LOI_2, 3001, MODE_FIELD, steering.RETURN_MODE, steering.RETURN_TEXT, "flies home and lands"),
    Named(OF_LOI_2, 3002, "UA State", AIRBORNE_STATE, AIRBORNE_TEXT, "the vehicle is in the air"),
    Named(OF_LOI_4, 2016, MODE_FIELD, steering.RETURN_MODE, steering.RETURN_TEXT, "flies home and lands"),
)
# Fields that the vehicle does not have.
LACKING = ((OF_LOI_4, 2017, "Loiter Length"), (OF_LOI_4, 2016, "Thrust"), (OF_LOI_4, 13002, "Loop Limit"),
           (OF_LOI_5, 2008, "Reverse Thrust"))
# Generic values that the vehicle does not have: level, message, field, indices.
MISSING = (
    (OF_LOI_4, 2016, MODE_FIELD, steering.NEVER_MODES),
    (OF_LOI_4, 2016, "Speed Type", (3,)),
    (OF_LOI_4, 2007, "Set Lights", (1, 3, 4, 7)),
    (OF_LOI_4, 2017, "Loiter Type", (2, 3)),
    (OF_LOI_4, 2017, "Loiter Direction", (3,)),
    (OF_LOI_4, 13002, "Location Type", (1,)),
    (OF_LOI_4, 13003, "Waypoint Loiter Type", (2, 3)),
    (OF_LOI_4, 13003, "Loiter Direction", (3,)),
)
# Messages that the vehicle does not take at all.
NO_MESSAGES = ((OF_LOI_3, 19200), (OF_LOI_4, 5000), (OF_LOI_4, 5001), (OF_LOI_4, 13004), (OF_LOI_4, 13005), (OF_LOI_4, 13006))


def number_of(message, field):
    return next(f["bit"] for f in reference.MESSAGES[message]["fields"] if f["name"] == field) + 1


class Configuration:
    """One configuration phase for each CUCS; `send(cucs, [(id, fields)])` sends messages together."""

    def __init__(self, vehicle, send):
        self.vehicle, self._send = vehicle, send
        self.running = {}
        self.described = set()
        self.ranges, self.names = RANGES, NAMES
        self._known = None

    def request(self, cucs, fields):
        """Begins, or aborts, the answer to a 40000; a reason where it makes no sense."""
        kind = fields.get("Request Type")
        if kind == ABORT:
            self.running.pop(cucs, None)
            return None
        if kind not in range(ABORT):
            return f"40000: Request Type {kind} is out of range: expected 0 to 6"
        stations = fields.get("Station Number 1-16", 0)
        if kind == SINGLE:
            self._send(cucs, [self.single(fields.get("Requested Message", 0), fields.get("Requested Field", 0), stations)])
            return None
        self.running[cucs] = self.phase(kind, stations)
        return None

    def phase(self, kind, stations):
        """All messages of a configuration phase in their order."""
        return [*self.answers(kind, stations), self.complete(stations)]

    def answers(self, kind, stations):
        answers = [self.range(r, stations) for r in self.ranges if r.level == kind]
        answers += [self.name(n, stations) for n in self.names if n.level == kind]
        answers += [self.lacking(m, f, stations) for level, m, f in LACKING if level == kind]
        answers += [self.value(m, f, index, NOT_IMPLEMENTED) for level, m, f, indices in MISSING if level == kind for index in indices]
        answers += [self.availability(m, 0, 0, None, AVAILABLE) for level, m in NO_MESSAGES if level == kind]
        if kind in (OF_LOI_4, OF_LOI_5):
            five = kind == OF_LOI_5
            answers += [self.value(2016, MODE_FIELD, mode, AVAILABLE if now else UNAVAILABLE)
                        for mode, now in self.vehicle.steering.availability().items() if (mode in steering.NEEDS_LOI_5) == five]
        if kind == OF_LOI_4:
            answers += [(43001, {"Route Type": kind, "Instances": 4, "Maximum Number of Waypoints": mission.MAX_WAYPOINTS,
                                 "Location Type Support": 0}) for kind in range(5)]
        if kind == OF_LOI_3:
            answers += [(21000, fields) for fields in self.vehicle.payloads.configuration(stations)]
        return answers

    def tick(self):
        for cucs, queue in list(self.running.items()):
            self._send(cucs, queue[:PER_TICK])
            del queue[:PER_TICK]
            if not queue:
                del self.running[cucs]

    def changed(self):
        """The 44003s about what has become available, or gone, since the last question."""
        now = self.vehicle.steering.availability()
        before, self._known = self._known, now
        if before is None:
            return []
        return [self.value(2016, MODE_FIELD, mode, AVAILABLE if now[mode] else UNAVAILABLE) for mode in now if now[mode] != before[mode]]

    def describing(self, cucs, id, fields):
        """41002s for vehicle-specific values that this CUCS has not been given a name for yet."""
        new = [n for n in self.names if n.message == id and fields.get(n.field) == n.index and (cucs, n) not in self.described]
        self.described |= {(cucs, n) for n in new}
        return [self.name(n, 0) for n in new]

    # Messages

    def common(self, stations):
        return {"VSM ID": self.vehicle.vsm_id_field, "Data Link ID": 0, "Station Number 1-16": stations, "Component Number": 0,
                "Sub-Component Number": 0, "Station Number 17-32": 0}

    def about(self, message, field, stations, supported=1):
        return {**self.common(stations), "Requested Message": message, "Requested Field": number_of(message, field), "Field Supported": supported}

    def range(self, r, stations):
        fields = {**self.about(r.message, r.field, stations), "Default Value": r.default, "Max Value": r.high, "Min Value": r.low,
                  "Max Display Value": r.high, "Min Display Value": r.low, "Minimum Display Resolution": 1, "Help Text": r.help, "Subsystem ID": 19,
                  "Route Type": 2, "Warning and Caution Limits Usage": 0 if r.low_caution is None else 1, "Disable Alert/Caution": 0}
        if r.low_caution is not None:
            fields |= {"Low Caution Limit": r.low_caution, "Low Warning Limit": r.low_warning, "High Caution Limit": r.high, "High Warning Limit": r.high}
        return self.kind_of(r.message, r.field), fields

    @staticmethod
    def kind_of(message, field):
        """Which answer describes a field of this type."""
        kind = next(f["type"] for f in reference.MESSAGES[message]["fields"] if f["name"] == field)
        return 41004 if kind.startswith("char") else 41001 if kind.startswith("f") else 41003 if kind.startswith("u") else 41000

    def name(self, n, stations):
        return 41002, {**self.about(n.message, n.field, stations), "Default Value": 0,
                       "Vehicle Specific Enumeration Count": sum(o.message == n.message and o.field == n.field for o in self.names),
                       "Vehicle Specific Enumeration Index": n.index, "Vehicle Specific Enumeration Text": n.text,
                       "Vehicle Specific Help Text": n.help, "Remove Enumerated Index": 0, "Route Type": 2}

    def lacking(self, message, field, stations):
        id = self.kind_of(message, field)
        fields = self.about(message, field, stations, supported=0)
        if "enum" in next(f for f in reference.MESSAGES[message]["fields"] if f["name"] == field):
            id = 41002
        return id, fields

    def value(self, message, field, index, enable):
        return self.availability(message, number_of(message, field), 1, index, enable)

    def availability(self, message, number, available, index, enable):
        fields = {"Station Number 1-16": 0, "Component Number": 0, "Sub-Component Number": 0, "Reported Message": message, "Reported Field": number,
                  "Field Available": available, "Station Number 17-32": 0, "Route Type": 2}
        if index is not None:
            fields |= {"Reported Enumerated Index": index, "Enumerated Index Enable": enable}
        return 44003, fields

    def complete(self, stations):
        fields = self.common(stations) | {"Vehicle Type": self.vehicle.type, "Vehicle Subtype": self.vehicle.subtype}
        return 41005, fields

    def single(self, message, number, stations):
        """The answer about one field."""
        layout = reference.MESSAGES.get(message)
        known = layout and next((f for f in layout["fields"] if f["bit"] + 1 == number), None)
        if not known or message in (m for _, m in NO_MESSAGES):
            return self.availability(message, number, 0, None, AVAILABLE)
        for r in self.ranges:
            if (r.message, r.field) == (message, known["name"]):
                return self.range(r, stations)
        for n in self.names:
            if (n.message, n.field) == (message, known["name"]):
                return self.name(n, stations)
        if (message, known["name"]) in ((m, f) for _, m, f in LACKING):
            return self.lacking(message, known["name"], stations)
        if "enum" in known:
            return self.availability(message, number, 1, None, AVAILABLE)
        return self.full_range(message, known, stations)

    def full_range(self, message, known, stations):
        """A field that the vehicle takes in all its width."""
        if known["type"].startswith(("char", "f")):
            return self.kind_of(message, known["name"]), self.about(message, known["name"], stations)
        size, is_signed = reference.width(known["type"])
        low, high = (-(256**size) // 2, 256**size // 2 - 1) if is_signed else (0, 256**size - 1)
        low, high = max(low, -(2**31)), min(high, 2**31 - 1 if is_signed else 2**32 - 1)
        return self.range(Range(SINGLE, message, known["name"], low, high, 0), stations)
