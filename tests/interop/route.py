"""Routes for the flight: points in metres around the start, and the messages that carry them."""
import math
from dataclasses import dataclass, replace

from cucs import rad_to_bam

AGL, WGS84 = 2, 3
EARTH_M = 6_371_000.0


@dataclass(frozen=True)
class Point:
    """A waypoint: north and east of the start and height above it in m, speed in m/s."""

    number: int
    next: int
    north: float
    east: float
    up: float
    speed: float = 5.0
    altitude_type: int = AGL
    latitude: float | None = None

    def place(self, start):
        latitude = start[0] + self.north / EARTH_M if self.latitude is None else self.latitude
        return latitude, start[1] + self.east / (EARTH_M * math.cos(start[0]))

    def message(self, cucs, start, ack):
        """The 13002. An altitude above the ellipsoid counts from that of the start."""
        latitude, longitude = self.place(start)
        altitude = self.up + (start[2] if self.altitude_type == WGS84 else 0.0)
        return cucs.make(13002, {
            "Waypoint Number": self.number,
            "Waypoint to Latitude or Relative Y": rad_to_bam(latitude, 32),
            "Waypoint to Longitude or Relative X": rad_to_bam(longitude, 32),
            "Location Type": 0,
            "Waypoint to Altitude": round(altitude / 0.02),
            "Waypoint Altitude Type": self.altitude_type,
            "Waypoint to Speed": round(self.speed / 0.5),
            "Waypoint Speed Type": 2,
            "Next Waypoint": self.next,
            "Turn Type": 0,
        }, ack=ack)


@dataclass(frozen=True)
class Route:
    """Points in the order in which they are sent, which need not be that in which they are flown."""

    name: str
    first: int
    points: tuple

    def flown(self):
        """The points in the order in which they are flown."""
        by_number, at, order = {p.number: p for p in self.points}, self.first, []
        while at in by_number and len(order) < len(by_number):
            order.append(by_number[at])
            at = by_number[at].next
        return order

    def definition(self, cucs, first=None):
        """The 13001; first = 0 deletes the definition again."""
        return cucs.make(13001, {"Initial Waypoint Number": self.first if first is None else first,
                                 "Route ID": self.name, "Route Type": 2})

    def load(self, cucs, mission):
        """The 13000 that loads the route."""
        return cucs.make(13000, {"Mission ID": mission, "Mission Plan Mode": 2, "Waypoint Number": 0,
                                 "Route ID": self.name}, ack=True)


def survey(ellipsoid):
    """The route that is flown: 9, 70, 12, 3, 41, sent in another order; one altitude above the ellipsoid."""
    over = replace(Point(3, 41, 200, 140, 35), altitude_type=WGS84 if ellipsoid else AGL)
    return Route("SURVEY", 9, (
        Point(12, 3, 320, 140, 30),
        Point(9, 70, 60, 0, 30),
        Point(41, 0, 80, 100, 30),
        Point(70, 12, 320, 0, 32),
        over,
    ))


def faulty(base):
    """Routes that must be refused: what is wrong, the number that the refusal must name, the route.

    Their numbers begin above `base`: a waypoint once sent may stay known, and would fill another's gap.
    """
    good = (Point(base + 1, base + 2, 50, 0, 30), Point(base + 2, base + 3, 100, 0, 30), Point(base + 3, 0, 100, 50, 30))
    one, two, three = good
    return [
        ("a gap in the chain", base + 2, Route("GAP", base + 1, (one, three))),
        ("an unknown first waypoint", base + 50, Route("UNKNOWN", base + 50, good)),
        ("a latitude of 100 degrees", base + 2,
         Route("LATITUDE", base + 1, (one, replace(two, latitude=math.radians(100.0)), three))),
        ("a first point 9 km from home", base + 1,
         Route("FIRST", base + 1, tuple(replace(p, north=9_000.0 + p.east) for p in good))),
        ("a leg of 80 km", base + 3, Route("LEG", base + 1, (one, two, replace(three, north=80_000.0)))),
    ]


def metres(a, b):
    """North and east from a to b, for places a few km apart."""
    return (b[0] - a[0]) * EARTH_M, (b[1] - a[1]) * EARTH_M * math.cos((a[0] + b[0]) / 2)


def distance(a, b):
    return math.hypot(*metres(a, b))


def closest(track, point):
    """The least distance between a point and the line through a track, in m."""
    best = math.inf
    for a, b in zip(track, track[1:] or track):
        an, ae = metres(point, a)
        dn, de = metres(a, b)
        length = dn * dn + de * de
        t = 0.0 if length == 0 else min(1.0, max(0.0, -(an * dn + ae * de) / length))
        best = min(best, math.hypot(an + t * dn, ae + t * de))
    return best
