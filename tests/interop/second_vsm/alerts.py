"""16000: alerts of one vehicle. The first message of an alert has a negative id, all later ones the same id
without the sign; a cause that repeats is sent once a second at most."""
from dataclasses import dataclass

from .wire import signed

CLEARED, NOMINAL, CAUTION, WARNING, EMERGENCY = 0, 1, 2, 3, 4
CLEAR, STANDING, CLEARABLE, FOR_A_TIME = 0, 1, 2, 3
ENGINE, ELECTRICAL, COMMS, ENERGY, NAVIGATION, PAYLOAD, VSM_STATUS = 0, 2, 3, 4, 5, 6, 9
SHOWN_S = 10
INTERVAL_S = 1.0


@dataclass
class Alert:
    id: int
    priority: int
    subsystem: int
    type: int
    text: str
    sent: float


class Alerts:
    """`send(fields, only)` sends to all who watch the vehicle, or to one of them."""

    def __init__(self, send, first_id=1):
        self._send, self._next = send, first_id
        self.open, self._late = {}, {}

    def raise_(self, cause, priority, subsystem, text, now, type=STANDING):
        known = self.open.get(cause)
        if known and known.type == FOR_A_TIME and now - known.sent > SHOWN_S:
            known = None
        if known is None:
            alert = self.open[cause] = Alert(self._next, priority, subsystem, type, text, now)
            self._next += 1
            self._send(self.fields(alert, -alert.id))
        elif (known.priority, known.text) != (priority, text) or type == FOR_A_TIME:
            if now - known.sent < INTERVAL_S:
                self._late[cause] = (priority, subsystem, text, type)
                return
            known.priority, known.text, known.sent = priority, text, now
            self._send(self.fields(known, known.id))

    def refusal(self, cause, text, now):
        """Why a command or a route was not carried out; the last reason of a second is not lost."""
        self.raise_(cause, CAUTION, VSM_STATUS, text, now, FOR_A_TIME)

    def tick(self, now):
        for cause, (priority, subsystem, text, type) in list(self._late.items()):
            if cause not in self.open or now - self.open[cause].sent >= INTERVAL_S:
                del self._late[cause]
                self.raise_(cause, priority, subsystem, text, now, type)

    def clear(self, cause):
        alert = self.open.pop(cause, None)
        self._late.pop(cause, None)
        if alert:
            alert.priority = CLEARED
            self._send(self.fields(alert, alert.id) | {"Type": CLEAR})

    def standing(self):
        """What somebody who has just connected has to know."""
        return [self.fields(a, a.id) for a in self.open.values() if a.type == STANDING]

    def fields(self, alert, id):
        return {"Data Link ID": 0, "Priority": alert.priority, "Subsystem State Report Reference": -1,
                "Subsystem ID": alert.subsystem, "Alert Group": 0, "Controlled Station 1-16": 0, "Component Number": 0,
                "Sub-Component Number": 0, "Type": alert.type, "Alert (Warning) ID": signed(id), "Text": alert.text[:79],
                "Persistence": SHOWN_S if alert.type == FOR_A_TIME else 0, "Controlled Station 17-32": 0, "Message Type": 0,
                "Append Order": 0, "Append Total Number": 0}
