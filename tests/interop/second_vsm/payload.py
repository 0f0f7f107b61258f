"""Simulated camera stations: a gimbal with a laser, seen from the vehicle that carries it."""
import math
from dataclasses import dataclass

from .authority import bits
from .steering import DONE, refused
from .units import ALTITUDE_STEP_M, clamp, from_bam, moved, offset, to_bam, wrap_angle

NONE, ANGLES, RATES, INERTIAL_RATES, PLACE = 0, 1, 2, 3, 4
EO_IR, ACTIVE = 3, 5
SLEW = math.radians(60)
RATE_STEP = 0.005
LOWEST, HIGHEST = -math.pi / 2, math.pi / 6
FIRE, PULSE = 238, 85
OFF, ON, LASING = 0, 1, 3
ACTIVATED = 2


@dataclass
class Station:
    bit: int
    azimuth: float = 0.0
    elevation: float = 0.0
    mode: int = ANGLES
    system: int = ACTIVE
    aim: tuple = (0.0, 0.0)
    rates: tuple = (0.0, 0.0)
    target: tuple | None = None
    view: int = 3641
    pointer: int = OFF
    rangefinder: int = OFF
    designator: int = OFF
    code: int = 0
    pulse: int = 1
    eo: int = 1
    polarity: int = 0
    output: int = 3
    sensor: int = 3
    preplan: int = 1


class Payloads:
    """The stations of one vehicle, and the commands that they take."""

    def __init__(self, vehicle, count):
        self.vehicle = vehicle
        self.stations = [Station(1 << k) for k in range(count)]

    @property
    def mask(self):
        return sum(s.bit for s in self.stations)

    def addressed(self, mask):
        return [s for s in self.stations if s.bit & mask]

    def mask_of(self, fields):
        """The stations that a command is for."""
        return fields.get("Station Number 1-16", 0)

    def may_command(self, cucs, mask):
        return self.vehicle.authority.may_command(cucs, mask)

    def steer(self, fields):
        mask = self.mask_of(fields)
        if mask & ~self.mask or not mask:
            return refused(f"19001: stations {mask:#06x} are not aboard: expected bits of {self.mask:#06x}")
        if abs(fields.get("Latitude", 0)) > 2**30:
            return refused("19001: Latitude is out of range: expected -90 to 90 degrees")
        for station in self.addressed(mask):
            azimuth, elevation = (self.angle(fields, name, old) for name, old in
                                  (("Set Centreline Azimuth Angle", station.aim[0]), ("Set Centreline Elevation Angle", station.aim[1])))
            station.aim = azimuth, clamp(elevation, LOWEST, HIGHEST)
            station.rates = tuple(fields.get(name, 0) * RATE_STEP for name in ("Horizontal Slew Rate", "Vertical Slew Rate"))
            if "Latitude" in fields and "Longitude" in fields:
                altitude = self.vehicle.above_sea(fields.get("Altitude", 0) * ALTITUDE_STEP_M, fields.get("Altitude Type", 2))
                station.target = (from_bam(fields["Latitude"], 32), from_bam(fields["Longitude"], 32)), altitude
            station.view = fields.get("Set Horizontal Field of View", station.view) or station.view
        return DONE

    @staticmethod
    def angle(fields, name, old):
        return from_bam(fields[name], 16) if name in fields else old

    def set(self, fields):
        mask = self.mask_of(fields)
        if mask & ~self.mask or not mask:
            return refused(f"19100: stations {mask:#06x} are not aboard: expected bits of {self.mask:#06x}")
        if not (self.laser_defined(fields)):
            return refused("19100: a laser code is out of range")
        if fields.get("Set EO/IR Pointing Mode", 0) > PLACE or fields.get("System Operating Mode", 0) > 6:
            return refused("19100: the pointing mode or the system mode is not available")
        for station in self.addressed(mask):
            for name, what in (("Addressed Sensor", "sensor"), ("System Operating Mode", "system"), ("Set EO Sensor Mode", "eo"),
                               ("Set IR Polarity", "polarity"), ("Image Output", "output"), ("Set EO/IR Pointing Mode", "mode"),
                               ("Select Laser Rangefinder First/Last Pulse", "pulse"), ("Set Laser Designator Code", "code"),
                               ("Preplan Mode", "preplan")):
                # 0 is no pulse: Edition 2.5 cannot leave the field out.
                if name in fields and (what != "pulse" or fields[name]):
                    setattr(station, what, fields[name])
            self.command_lasers(station, fields)
        return DONE

    @staticmethod
    def laser_defined(fields):
        return (fields.get("Fire Laser Pointer", 0) in (0, 51, 68, FIRE) and fields.get("Fire Laser Rangefinder", 0) in (0, 51, 68, PULSE, FIRE)
                and fields.get("Initiate Laser Designator", 0) in (0, 51, 68, PULSE))

    @staticmethod
    def command_lasers(station, fields):
        if "Fire Laser Pointer" in fields:
            station.pointer = LASING if fields["Fire Laser Pointer"] == FIRE else ON if fields["Fire Laser Pointer"] else OFF
        if "Fire Laser Rangefinder" in fields:
            code = fields["Fire Laser Rangefinder"]
            station.rangefinder = LASING if code in (FIRE, PULSE) else ON if code else OFF
        if "Initiate Laser Designator" in fields:
            code = fields["Initiate Laser Designator"]
            station.designator = ACTIVATED if code == PULSE else ON if code else OFF

    def advance(self, dt):
        for s in self.stations:
            if s.mode in (RATES, INERTIAL_RATES):
                s.azimuth = wrap_angle(s.azimuth + s.rates[0] * dt)
                s.elevation = clamp(s.elevation + s.rates[1] * dt, LOWEST, HIGHEST)
                continue
            azimuth, elevation = self.toward(s.target) if s.mode == PLACE and s.target else s.aim
            s.azimuth = wrap_angle(s.azimuth + clamp(wrap_angle(azimuth - s.azimuth), -SLEW * dt, SLEW * dt))
            s.elevation += clamp(elevation - s.elevation, -SLEW * dt, SLEW * dt)

    def toward(self, target):
        aircraft = self.vehicle.aircraft
        north, east = offset(aircraft.place, target[0])
        down = aircraft.altitude - target[1]
        return (wrap_angle(math.atan2(east, north) - aircraft.heading), clamp(math.atan2(-down, math.hypot(north, east)), LOWEST, HIGHEST))

    def image_centre(self, station):
        """Where the line of sight meets the ground, or None where it does not."""
        aircraft = self.vehicle.aircraft
        if station.elevation > math.radians(-1) or aircraft.height < 1 or not aircraft.fix:
            return None
        far = aircraft.height / math.tan(-station.elevation)
        bearing = aircraft.heading + station.azimuth
        return moved(aircraft.place, far * math.cos(bearing), far * math.sin(bearing))

    # 21000, 21100, 21101

    def configuration(self, mask):
        return [{"VSM ID": self.vehicle.vsm_id_field, "Payload Stations Available 1-16": self.mask, "Station Number 1-16": s.bit,
                 "Payload Type": EO_IR, "Station Door": 0, "Number of Payload Recording Devices": 0} for s in self.chosen(mask)]

    def camera(self, mask):
        return [{"VSM ID": self.vehicle.vsm_id_field, "Station Number 1-16": s.bit, "EO/IR Type": "SIMULATED", "EO/IR Type Revision Level": 1,
                 "EO Vertical Image Dimension": 1080, "EO Horizontal Image Dimension": 1920, "IR Vertical Image Dimension": 512,
                 "IR Horizontal Image Dimension": 640, "Field of Regard - Elevation Min": to_bam(LOWEST, 16),
                 "Field of Regard - Elevation Max": to_bam(HIGHEST, 16), "Field of Regard - Azimuth Min": -32768,
                 "Field of Regard - Azimuth Max": 32767} for s in self.chosen(mask)]

    def states(self, mask):
        return [self.state(s) for s in self.chosen(mask)]

    def state(self, s):
        fields = {"Station Number 1-16": s.bit, "Addressed Sensor": s.sensor, "System Operating Mode State": s.system,
                  "EO Sensor Mode Status": s.eo, "IR Polarity Status": s.polarity, "Image Output State": s.output,
                  "Actual Centreline Elevation Angle": to_bam(s.elevation, 16), "Actual Vertical Field of View": s.view * 9 // 16,
                  "Actual Centreline Azimuth Angle": to_bam(s.azimuth, 16), "Actual Horizontal Field of View": s.view,
                  "Actual Sensor Rotation Angle": 0, "Image Position": 0, "Pointing Mode State": s.mode, "Preplan Mode": s.preplan,
                  "Reported Range": 0.0, "Fire Laser Pointer Status": s.pointer, "Fire Laser Rangefinder Status": s.rangefinder,
                  "Selected Laser Rangefinder First/Last Pulse": s.pulse, "Laser Designator Code": s.code, "Laser Designator Status": s.designator}
        centre = self.image_centre(s)
        if centre:
            fields |= {"Image Position": 1, "Latitude of image centre": to_bam(centre[0], 32), "Longitude of image centre": to_bam(centre[1], 32),
                       "Altitude": self.vehicle.reported_altitude(self.vehicle.aircraft.ground)}
        return fields

    def chosen(self, mask):
        return self.addressed(mask) if mask and bits(mask) else self.stations
