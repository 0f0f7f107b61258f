"""Angles, altitudes, times and places on the earth: the scales of the DLI, and the geometry of the flight."""
import math
import time

EPOCH_2000_S = 946_684_800
ALTITUDE_STEP_M = 0.02
SPEED_STEP = 0.5
FINE_STEP = 0.05
RADIUS_STEP_M = 1.5
TURN_RATE_STEP = 0.0001
ENERGY_STEP = 0.0016
EQUATOR_M = 6_378_137.0
FLATTENING = 1 / 298.257223563
ECCENTRICITY_2 = FLATTENING * (2 - FLATTENING)


def stamp(at=None):
    """Milliseconds since 2000."""
    return int(((time.time() if at is None else at) - EPOCH_2000_S) * 1000)


def to_bam(rad, bits):
    """The nearest raw value of a binary angle; half a turn becomes minus half a turn."""
    half = 2 ** (bits - 1)
    return (round(rad * half / math.pi) + half) % (2 * half) - half


def from_bam(raw, bits):
    return raw * math.pi / 2 ** (bits - 1)


def clamp(value, low, high):
    return max(low, min(high, value))


def fine(value):
    """m/s or the like as an Integer 2 in steps of 0.05."""
    return int(clamp(round(value / FINE_STEP), -32768, 32767))


def radii(lat):
    """Metres for a radian of latitude and of longitude."""
    w = math.sqrt(1 - ECCENTRICITY_2 * math.sin(lat) ** 2)
    return EQUATOR_M * (1 - ECCENTRICITY_2) / w**3, EQUATOR_M / w * max(math.cos(lat), 1e-9)


def offset(origin, place):
    """Metres north and east from one (latitude, longitude) to another; for distances of a flight."""
    per_lat, per_lon = radii((origin[0] + place[0]) / 2)
    east = (place[1] - origin[1] + math.pi) % (2 * math.pi) - math.pi
    return (place[0] - origin[0]) * per_lat, east * per_lon


def moved(origin, north, east):
    per_lat, per_lon = radii(origin[0])
    lon = origin[1] + east / per_lon
    return origin[0] + north / per_lat, (lon + math.pi) % (2 * math.pi) - math.pi


def distance(a, b):
    return math.hypot(*offset(a, b))


def wrap_angle(rad):
    return (rad + math.pi) % (2 * math.pi) - math.pi


def to_ecef(lat, lon):
    """A point at height 0 on the ellipsoid."""
    n = EQUATOR_M / math.sqrt(1 - ECCENTRICITY_2 * math.sin(lat) ** 2)
    return (n * math.cos(lat) * math.cos(lon), n * math.cos(lat) * math.sin(lon), n * (1 - ECCENTRICITY_2) * math.sin(lat))


def from_ecef(x, y, z):
    """Latitude and longitude, to well under a millimetre, of a point within kilometres of the ellipsoid."""
    p, lat = math.hypot(x, y), math.atan2(z, math.hypot(x, y) * (1 - ECCENTRICITY_2))
    for _ in range(6):
        n = EQUATOR_M / math.sqrt(1 - ECCENTRICITY_2 * math.sin(lat) ** 2)
        lat = math.atan2(z + n * ECCENTRICITY_2 * math.sin(lat), p)
    return lat, math.atan2(y, x)


def bezier(a, b, c, d, t):
    u = 1 - t
    return u**3 * a + 3 * u * u * t * b + 3 * u * t * t * c + t**3 * d


def curve(p1, p2, p3, p4, count):
    """Places along a curve leg without its first: the cubic of the four points, taken on the ellipsoid."""
    ends = [to_ecef(*p) for p in (p1, p2, p3, p4)]
    return [from_ecef(*(bezier(*(e[k] for e in ends), i / count) for k in range(3))) for i in range(1, count + 1)]
