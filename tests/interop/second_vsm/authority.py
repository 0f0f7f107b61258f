"""Who may have which level of interoperability of one vehicle, and who holds it.

LOI 4 and 5 make up the control of the vehicle, which one CUCS has at a time; LOI 3 is held station by
station; LOI 2 by everybody who may have it and asks. The record can be written to disk, so that a restart
changes nothing.
"""
from dataclasses import dataclass, field

LOI_2, LOI_3, LOI_4, LOI_5 = 1, 2, 4, 8
CONTROL = LOI_4 | LOI_5
RELEASE, REQUEST, OVERRIDE = 0, 1, 2
NOT_REQUESTED, IN_PROGRESS, SUCCESSFUL, FAILED = 0, 1, 2, 3
WARN_S, OFFER_S, ACT_S = 3.0, 5.0, 10.0
HANDOVER_S = 10.0
# A release and a request this far apart are one handover.
RELEASE_MEMORY_S = 30.0


@dataclass(frozen=True)
class Access:
    """What the access list allows one CUCS."""

    loi: int
    override: bool = False


@dataclass
class Handover:
    """The latest change of control, as 35000 reports it."""

    status: int = NOT_REQUESTED
    giving: int = 0
    taking: int = 0


@dataclass
class Wish:
    """A handover that waits: for the holder's consent, or for the data link."""

    cucs: int
    loi: int
    stations: int
    until: float
    for_link: bool = False


@dataclass
class Authority:
    """The rights of one vehicle. `stations` are the payload stations aboard, as bits."""

    access: dict
    stations: int
    held: dict = field(default_factory=dict)
    station_holder: dict = field(default_factory=dict)
    handover: Handover = field(default_factory=Handover)
    wish: Wish | None = None
    offered: bool = False
    released: tuple | None = None

    # Questions

    def authorised(self, cucs):
        return self.access[cucs].loi if cucs in self.access else 0

    def granted(self, cucs):
        """All that this CUCS holds."""
        return self.held.get(cucs, 0) | (LOI_3 if self.stations_of(cucs) else 0)

    def stations_of(self, cucs):
        return sum(bit for bit, holder in self.station_holder.items() if holder == cucs)

    def holder(self):
        """The CUCS in control of the vehicle, or None."""
        return next((cucs for cucs, loi in self.held.items() if loi & CONTROL), None)

    def controls(self, cucs):
        return bool(self.held.get(cucs, 0) & CONTROL)

    def watching(self):
        return [cucs for cucs in self.access if self.granted(cucs)]

    def has(self, cucs, loi):
        return bool(self.granted(cucs) & loi)

    def may_command(self, cucs, stations):
        """Whether all these payload stations are this CUCS's."""
        return bool(stations) and all(self.station_holder.get(bit) == cucs for bit in bits(stations))

    def may_override(self, cucs):
        return self.access[cucs].override

    # Changes

    def request(self, cucs, loi, access, stations, now):
        """Grants what can be granted of a request."""
        allowed = loi & self.authorised(cucs)
        if allowed & LOI_2:
            self.held[cucs] = self.held.get(cucs, 0) | LOI_2
        if allowed & LOI_3:
            self._take_stations(cucs, stations or self.stations, access)
        if allowed & CONTROL:
            self._take_control(cucs, allowed & CONTROL, access, now)

    def _take_stations(self, cucs, stations, access):
        for bit in bits(stations & self.stations):
            other = self.station_holder.get(bit)
            if other in (None, cucs) or self.controls(cucs) or (access == OVERRIDE and self.may_override(cucs)):
                self.station_holder[bit] = cucs

    def _take_control(self, cucs, loi, access, now):
        holder = self.holder()
        if holder in (None, cucs):
            if holder is None and self.released and self.released[0] != cucs and now - self.released[1] < RELEASE_MEMORY_S:
                self.handover = Handover(SUCCESSFUL, self.released[0], cucs)
            self.give(cucs, loi)
        elif (access == OVERRIDE and self.may_override(cucs)) or self.offered:
            self.take_from(holder)
            self.handover = Handover(SUCCESSFUL, holder, cucs)
            self.give(cucs, loi)

    def give(self, cucs, loi):
        self.held[cucs] = self.held.get(cucs, 0) | loi
        self.offered, self.released = False, None

    def take_from(self, cucs):
        """Ends the control of a CUCS; what else it holds stays."""
        self.held[cucs] = self.held.get(cucs, 0) & ~CONTROL

    def release(self, cucs, loi, stations, now):
        if loi & CONTROL & self.held.get(cucs, 0):
            # LOI 5 is of no use without LOI 4.
            self.held[cucs] &= ~(CONTROL if loi & LOI_4 else LOI_5)
            if not self.controls(cucs):
                self.released = cucs, now
        if loi & LOI_2:
            self.held[cucs] = self.held.get(cucs, 0) & ~LOI_2
        if loi & LOI_3:
            for bit in bits(stations or self.stations):
                if self.station_holder.get(bit) == cucs:
                    del self.station_holder[bit]

    # Disk

    def record(self):
        return {"held": {str(k): v for k, v in self.held.items()}, "stations": {str(k): v for k, v in self.station_holder.items()}}

    def restore(self, record):
        self.held = {int(k): v for k, v in record["held"].items() if int(k) in self.access}
        self.station_holder = {int(k): v for k, v in record["stations"].items() if v in self.access}


def bits(mask):
    return [1 << k for k in range(32) if mask >> k & 1]
