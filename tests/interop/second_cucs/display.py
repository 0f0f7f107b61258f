"""What the operator of the second CUCS sees: a picture of the vehicle that a test can read."""
import math
from dataclasses import dataclass, field

MODE = "Select Flight Path Control Mode"
MODES = {2: "flight director", 11: "waypoint", 12: "loiter", 15: "autopilot", 16: "terrain avoidance", 17: "navaid", 19: "autoland", 20: "wave-off",
         21: "launch", 22: "slave to sensor", 23: "contingency A", 24: "contingency B"}
STALE_S = 3.0
NOT_CLEARABLE, CLEARABLE, TIMED = 1, 2, 3


@dataclass
class Limits:
    """What 41000, 41001 and 41003 said of one field."""

    low: float | None = None
    high: float | None = None
    low_caution: float | None = None
    low_warning: float | None = None
    supported: bool = True


@dataclass
class Alert:
    priority: int
    kind: int
    text: str
    until: float


@dataclass
class Display:
    """Everything is as the VSM reported it last; what it never reported is None."""

    loi: int = 0
    authorised: int = 0
    position: tuple | None = None
    position_at: float = -1e9
    mode: int | None = None
    mission: str = "none"
    alerts: dict = field(default_factory=dict)
    unconfirmed: list = field(default_factory=list)
    handover: int | None = None
    limits: dict = field(default_factory=dict)
    unavailable: set = field(default_factory=set)
    names: dict = field(default_factory=dict)
    own_warnings: set = field(default_factory=set)

    def show_position(self, fields, now):
        """Latitude and longitude in rad; an impossible or absent position leaves the last one, which ages."""
        lat, lon = fields.get("Latitude"), fields.get("Longitude")
        if lat is not None and lon is not None and abs(lat) <= 2**30:
            self.position = (lat * math.pi / 2**31, lon * math.pi / 2**31)
            self.position_at = now

    def show_mode(self, fields):
        self.mode = fields.get(MODE, self.mode)

    def mode_name(self):
        if self.mode is None:
            return "unknown"
        return self.names.get(self.mode) or MODES.get(self.mode) or f"unknown mode {self.mode}"

    def offered_modes(self):
        """The modes that the operator can choose."""
        return sorted(mode for mode in (*MODES, *self.names) if mode not in self.unavailable)

    def show_alert(self, fields, now):
        id = abs(fields.get("Alert (Warning) ID", 0))
        if fields.get("Priority") == 0:
            self.alerts.pop(id, None)
            return
        kind, persistence = fields.get("Type", NOT_CLEARABLE), max(0, fields.get("Persistence", 0))
        until = now + persistence if kind == TIMED else math.inf
        self.alerts[id] = Alert(fields.get("Priority", 1), kind, fields.get("Text", ""), until)

    def clear_alert(self, id):
        """By the operator: only where the VSM lets him."""
        if id in self.alerts and self.alerts[id].kind == CLEARABLE:
            del self.alerts[id]

    def expire(self, now):
        self.alerts = {id: alert for id, alert in self.alerts.items() if alert.until > now}

    def learn(self, id, fields):
        """One message of the configuration phase."""
        if id == 44003:
            self.learn_availability(fields)
            return
        key = fields.get("Requested Message"), fields.get("Requested Field")
        if id == 41002 and fields.get("Vehicle Specific Enumeration Text") and key[0] in (2016, 3001):
            self.names[fields["Vehicle Specific Enumeration Index"]] = fields["Vehicle Specific Enumeration Text"]
        elif id in (41000, 41001, 41003):
            self.limits[key] = Limits(fields.get("Min Value"), fields.get("Max Value"), fields.get("Low Caution Limit"), fields.get("Low Warning Limit"),
                                      fields.get("Field Supported", 1) == 1)

    def learn_availability(self, fields):
        if (fields.get("Reported Message"), fields.get("Reported Field")) == (2016, 2) and "Reported Enumerated Index" in fields:
            index = fields["Reported Enumerated Index"]
            (self.unavailable.add if fields.get("Enumerated Index Enable", 0) < 0 else self.unavailable.discard)(index)

    def within(self, message, number, value):
        """Whether a value may be sent in a field, by what was declared of it."""
        limits = self.limits.get((message, number))
        return limits is None or (limits.supported and (limits.low is None or value >= limits.low) and (limits.high is None or value <= limits.high))

    def watch(self, message, number, value):
        """Cautions and warnings of this station's own, by the limits that the VSM declared."""
        limits = self.limits.get((message, number))
        if limits is None or limits.low_warning is None:
            return
        level = "warning" if value <= limits.low_warning else "caution" if limits.low_caution is not None and value <= limits.low_caution else None
        self.own_warnings = {w for w in self.own_warnings if w[:2] != (message, number)}
        if level:
            self.own_warnings.add((message, number, level))

    def picture(self, now):
        """The same as plain values."""
        return {"loi": self.loi, "authorised": self.authorised, "position": self.position, "fresh": now - self.position_at < STALE_S,
                "mode": self.mode_name(), "mission": self.mission, "offered_modes": self.offered_modes(),
                "alerts": {id: {"priority": a.priority, "type": a.kind, "text": a.text} for id, a in self.alerts.items()},
                "warnings": sorted(f"{m}.{n}: {level}" for m, n, level in self.own_warnings), "not_confirmed": self.unconfirmed,
                "handover_requested_by": self.handover}
