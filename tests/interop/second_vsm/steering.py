"""Modes and settings: what the flight commands of a CUCS do to the aircraft, and when they have been carried out."""
from dataclasses import dataclass, field

from . import aircraft as flight
from .aircraft import Refused
from .units import ALTITUDE_STEP_M, FINE_STEP, RADIUS_STEP_M, SPEED_STEP, TURN_RATE_STEP, from_bam

NO_MODE, DIRECTOR, WAYPOINT, LOITER, AUTOPILOT, AUTOLAND, WAVE_OFF, LAUNCH, FLY_A, FLY_B, RETURN = 0, 2, 11, 12, 15, 19, 20, 21, 23, 24, 32
REPORTED = {flight.IDLE: NO_MODE, flight.MANUAL: DIRECTOR, flight.ROUTE: WAYPOINT, flight.LOITER: LOITER, flight.STEER: AUTOPILOT,
            flight.LAND: AUTOLAND, flight.CLIMB_AWAY: WAVE_OFF, flight.LAUNCH: LAUNCH, flight.RETURN: RETURN,
            flight.CONTINGENCY_A: FLY_A, flight.CONTINGENCY_B: FLY_B}
NEEDS_LOI_5 = (AUTOLAND, WAVE_OFF, LAUNCH)
NEVER_MODES = (16, 17, 22, 25)
RETURN_MODE, RETURN_TEXT = RETURN, "RETURN HOME"
LOWEST_RADIUS, HIGHEST_RADIUS = 10, 20_000
LOWEST_ALTITUDE, HIGHEST_ALTITUDE = -25_000, 250_000
HIGHEST_SPEED = 50
LIGHTS_ABOARD = 0x01 | 0x04 | 0x40
RESET, ARM, EXECUTE = 0, 1, 2
CONFIRM_S = 15.0
CIRCULAR, HOVER = 1, 4

LOITER_DEFAULTS = {"Loiter Type": CIRCULAR, "Loiter Radius": 40, "Loiter Length": 0, "Loiter Length Units": 0, "Loiter Bearing": 0,
                   "Loiter Direction": 1, "Flying Behaviour": 0, "Loiter Duration": 0, "Loiter Duration Units": 0,
                   # Of Edition 2.5 alone: #48 and #109.
                   "Mode Preference": 0}
COMMANDED_DEFAULTS = {"Commanded Altitude": 0, "Altitude Type": 1, "Commanded Heading": 0, "Commanded Course": 0,
                      "Commanded Turn Rate": 0, "Commanded Roll Rate": 0, "Commanded Speed": 24, "Speed Type": 2,
                      "Commanded Roll": 0, "Altitude Command Type": 0, "Heading Command Type": 0, "Thrust Direction": 0,
                      "Thrust": 0, "Loiter Position Latitude": 0, "Loiter Position Longitude": 0,
                      "Loiter Altitude Change Behaviour": 0, "Commanded Waypoint Number": 0}


@dataclass
class Outcome:
    """What became of a command: refused with a reason, done, or done once `shown` is true."""

    reason: str | None = None
    shown: object = None
    within: float = CONFIRM_S


DONE = Outcome()


def refused(reason):
    return Outcome(reason)


@dataclass
class Termination:
    """The two steps of flight termination."""

    state: int = RESET
    mode: int = 0


@dataclass
class Steering:
    """The flight commands of one vehicle."""

    vehicle: object
    loiter: dict = field(default_factory=lambda: dict(LOITER_DEFAULTS))
    commanded: dict = field(default_factory=lambda: dict(COMMANDED_DEFAULTS))
    termination: Termination = field(default_factory=Termination)
    altitude_datum: float = 0.0

    @property
    def aircraft(self):
        return self.vehicle.aircraft

    def reported_mode(self):
        return REPORTED[self.aircraft.mode]

    # 2017 and 2000

    def configure_loiter(self, fields):
        settings = {name: self.setting(fields, name) for name in LOITER_DEFAULTS if self.setting(fields, name) is not None}
        problem = self.problem_of_loiter(settings)
        if problem:
            return refused(problem)
        self.loiter.update(settings)
        if self.aircraft.mode == flight.LOITER and self.aircraft.loiter.radius:
            self.aircraft.loiter.radius = self.loiter_radius()
            self.aircraft.loiter.clockwise = self.clockwise()
        return DONE

    def setting(self, fields, name):
        """The value that a field sets, None where it is absent and the last one stays."""
        return fields.get(name)

    def problem_of_loiter(self, settings):
        kind, radius = settings.get("Loiter Type", CIRCULAR), settings.get("Loiter Radius", LOWEST_RADIUS)
        if kind not in (CIRCULAR, HOVER):
            return f"2017: Loiter Type {kind} is not supported: expected 1 (circular) or 4 (hover)"
        if not LOWEST_RADIUS <= radius <= HIGHEST_RADIUS:
            return (f"2017: Loiter Radius {radius * RADIUS_STEP_M:.1f} m is out of range: "
                    f"expected {LOWEST_RADIUS * RADIUS_STEP_M:.0f} to {HIGHEST_RADIUS * RADIUS_STEP_M:.0f} m")
        for name, highest in (("Loiter Direction", 2), ("Loiter Duration Units", 1), ("Mode Preference", 26)):
            if settings.get(name, 0) > highest:
                return f"2017: {name} {settings[name]} is not supported: expected 0 to {highest}"
        return None

    def loiter_radius(self):
        return self.loiter["Loiter Radius"] * RADIUS_STEP_M if self.loiter["Loiter Type"] == CIRCULAR else 0.0

    def clockwise(self):
        return self.loiter["Loiter Direction"] != 2

    # 2016

    def loi_needed(self, fields):
        return 8 if fields.get("Select Flight Path Control Mode") in NEEDS_LOI_5 else 4

    def command_mode(self, fields):
        mode = self.commanded_mode(fields)
        problem = self.vehicle.unreachable() or self.problem_of_mode(mode) or self.problem_of_values(fields)
        if problem:
            return refused(problem)
        try:
            self.take_values(mode, self.ruling(mode, fields))
        except Refused as reason:
            return refused(f"2016: {reason}")
        self.accept(fields)
        if mode is None:
            return DONE
        wanted = (mode, LOITER) if mode in (LAUNCH, WAVE_OFF) else (mode,)
        return Outcome(shown=lambda: self.reported_mode() in wanted)

    def ruling(self, mode, fields):
        """The fields that count: in Edition 2.5 a steering command alone does not alter what the preference leaves to waypoint or loiter."""
        kept = self.vehicle.options.edition != "2.5" or mode is not None or self.aircraft.mode not in (flight.LOITER, *flight.ON_ROUTE)
        return fields if kept or self.loiter["Mode Preference"] % 3 else {n: v for n, v in fields.items() if n != "Commanded Altitude"}

    def commanded_mode(self, fields):
        return fields.get("Select Flight Path Control Mode")

    def problem_of_mode(self, mode):
        if mode in (None, DIRECTOR, WAYPOINT, LOITER, AUTOPILOT, AUTOLAND, WAVE_OFF, LAUNCH, FLY_A, FLY_B, RETURN):
            return None
        return f"2016: flight path control mode {mode} is not available"

    def problem_of_values(self, fields):
        for name, highest in (("Altitude Command Type", 3), ("Heading Command Type", 5), ("Heading Reference", 1), ("Altitude Type", 3),
                              ("Speed Type", 2)):
            if fields.get(name, 0) > highest:
                return f"2016: {name} {fields[name]} is not available: expected 0 to {highest}"
        altitude = fields.get("Commanded Altitude", 0)
        if not LOWEST_ALTITUDE <= altitude <= HIGHEST_ALTITUDE:
            return (f"2016: Commanded Altitude {altitude * ALTITUDE_STEP_M:.0f} m is out of range: "
                    f"expected {LOWEST_ALTITUDE * ALTITUDE_STEP_M:.0f} to {HIGHEST_ALTITUDE * ALTITUDE_STEP_M:.0f} m")
        if fields.get("Commanded Speed", 0) > HIGHEST_SPEED:
            return f"2016: Commanded Speed {fields['Commanded Speed'] * SPEED_STEP:.1f} m/s is out of range: expected up to 25 m/s"
        if abs(fields.get("Loiter Position Latitude", 0)) > 2**30:
            return "2016: Loiter Position Latitude is out of range: expected -90 to 90 degrees"
        if ("Loiter Position Latitude" in fields) != ("Loiter Position Longitude" in fields):
            return "2016: the loiter position lacks latitude or longitude"
        return None

    def take_values(self, mode, fields):
        """Gives the aircraft mode and values; raises where it cannot."""
        aircraft = self.aircraft
        altitude = self.altitude(fields)
        if mode == LAUNCH:
            aircraft.launch(altitude)
        elif mode == WAYPOINT:
            start = fields.get("Commanded Waypoint Number") or None
            aircraft.fly(self.vehicle.mission.route_from(start=start))
        elif mode == LOITER:
            place = self.loiter_place(fields)
            aircraft.hold(place, altitude, self.loiter_radius() if place or self.circles_here() else 0.0, self.clockwise())
        elif mode == AUTOPILOT or (mode is None and aircraft.mode == flight.STEER):
            aircraft.steer(self.steering(fields))
        elif mode == DIRECTOR:
            aircraft.manual()
        elif mode == AUTOLAND:
            aircraft.land()
        elif mode == WAVE_OFF:
            aircraft.climb_away()
        elif mode in (FLY_A, FLY_B):
            self.fly_contingency(mode)
        elif mode == RETURN:
            aircraft.return_home()
        elif mode is None and altitude is not None:
            aircraft.change_altitude(altitude)
        if mode is None and "Loiter Position Latitude" in fields and aircraft.mode == flight.LOITER:
            aircraft.hold(self.loiter_place(fields), aircraft.target_altitude, self.loiter_radius(), self.clockwise())
        speed = fields.get("Commanded Speed", 0) * SPEED_STEP
        if speed:
            aircraft.change_speed(speed, fields.get("Speed Type", self.commanded["Speed Type"]) < 2)

    def fly_contingency(self, mode):
        mission, aircraft = self.vehicle.mission, self.aircraft
        kind, own = (3, flight.CONTINGENCY_A) if mode == FLY_A else (4, flight.CONTINGENCY_B)
        if mission.first_waypoint((kind,)) is None:
            raise Refused(f"no contingency route {'A' if mode == FLY_A else 'B'} is aboard; load one first")
        aircraft.fly(mission.route_from((kind,)), own)

    def circles_here(self):
        """Whether a loiter without a place circles where the vehicle is, or hovers there."""
        return False

    def altitude(self, fields):
        """The commanded altitude above the sea, where this command has one."""
        if "Commanded Altitude" not in fields or fields.get("Altitude Command Type", 1) not in (1, 3):
            return None
        kind = fields.get("Altitude Type", self.commanded["Altitude Type"])
        return self.vehicle.above_sea(fields["Commanded Altitude"] * ALTITUDE_STEP_M, kind)

    def loiter_place(self, fields):
        if "Loiter Position Latitude" not in fields:
            return None
        return from_bam(fields["Loiter Position Latitude"], 32), from_bam(fields["Loiter Position Longitude"], 32)

    def steering(self, fields):
        """What mode 15 is to hold; of the last steering remains what this command leaves alone."""
        old = self.aircraft.steering if self.aircraft.mode == flight.STEER else flight.Steering(heading=self.aircraft.heading)
        new = flight.Steering(**vars(old))
        kind = fields.get("Altitude Command Type", 1 if "Commanded Altitude" in fields else 0)
        climb = fields.get("Commanded Vertical Speed", 0) * FINE_STEP
        if kind in (1, 3):
            new.altitude, new.vertical_speed = self.altitude(fields), None
            new.climb_limit = abs(climb) or None if kind == 3 else None
        elif kind == 2:
            new.altitude, new.vertical_speed, new.climb_limit = None, climb, None
        kind = fields.get("Heading Command Type", 0)
        if kind:
            variation = self.aircraft.variation if fields.get("Heading Reference", 0) == 1 else 0.0
            heading, course = (self.angle(fields, name) for name in ("Commanded Heading", "Commanded Course"))
            new.heading = heading + variation if kind in (1, 3) and heading is not None else None
            new.course = course + variation if kind in (2, 3) and course is not None else None
            new.roll = self.angle(fields, "Commanded Roll") if kind == 4 else None
            rate = fields.get("Commanded Turn Rate", 0) * TURN_RATE_STEP
            new.turn_rate = rate if kind == 5 else None
            new.turn_limit = abs(rate) if kind in (1, 2, 3) else 0.0
        return new

    @staticmethod
    def angle(fields, name):
        return from_bam(fields[name], 16) if name in fields else None

    def accept(self, fields):
        """Keeps what 3002 reports as commanded."""
        for name in self.commanded:
            value = self.setting(fields, name)
            if value is not None:
                self.commanded[name] = value

    # The other commands

    def move_sticks(self, fields):
        if self.aircraft.mode != flight.MANUAL:
            return refused("2010: the vehicle is not in mode 2")
        self.aircraft.sticks = flight.Sticks(
            forward=fields.get("Longitudinal Stick", 0) / 127, right=fields.get("Lateral Stick", 0) / 127,
            turn=fields.get("Rotational Stick (Rudder)", 0) / 127, up=(fields.get("Throttle Stick - Engine 1", 128) - 128) / 127,
            at=self.aircraft.time)
        return DONE

    def switch_lights(self, fields):
        if self.vehicle.unreachable():
            return refused(self.vehicle.unreachable())
        if "Set Lights" in fields:
            self.aircraft.lights = fields["Set Lights"] & LIGHTS_ABOARD
        return DONE

    def command_engine(self, fields):
        number, command = fields.get("Engine Number", 1), fields.get("Engine Command")
        if self.vehicle.unreachable():
            return refused(self.vehicle.unreachable())
        if command is None or command > 2:
            return refused(f"2008: Engine Command {command} is out of range: expected 0 to 2")
        try:
            self.aircraft.start_engine(number, command)
        except Refused as reason:
            return refused(f"2008: {reason}")
        return Outcome(shown=lambda: self.aircraft.engines[number - 1].command == command)

    def terminate(self, fields):
        state = fields.get("Commanded Flight Termination State")
        if self.vehicle.unreachable():
            return refused(self.vehicle.unreachable())
        if state not in (RESET, ARM, EXECUTE):
            return refused(f"2005: state {state} is out of range: expected 0 to 2")
        if state == EXECUTE and not self.may_execute():
            return refused("2005: flight termination is not armed; send arm first")
        if self.termination.state == EXECUTE and state == ARM:
            return refused("2005: flight termination has been executed; send reset first")
        self.termination = Termination(state, fields.get("Flight Termination Mode", 0))
        if state == EXECUTE:
            self.aircraft.terminate()
        elif state == RESET:
            self.aircraft.terminated = False
        return DONE

    def may_execute(self):
        return self.termination.state in (ARM, EXECUTE)

    # What the vehicle can do now

    def availability(self):
        """The modes that come and go: (mode, whether it can be commanded now)."""
        aircraft, mission = self.aircraft, self.vehicle.mission
        flying = aircraft.airborne
        return {DIRECTOR: flying, WAYPOINT: flying and bool(mission.aboard.waypoints), LOITER: flying, AUTOPILOT: flying, AUTOLAND: flying,
                WAVE_OFF: aircraft.mode == flight.LAND, LAUNCH: not flying, FLY_A: flying and mission.first_waypoint((3,)) is not None,
                FLY_B: flying and mission.first_waypoint((4,)) is not None}

    def lose_station(self, what):
        """The controlling CUCS is lost: flies what was provisioned."""
        if not self.aircraft.airborne:
            return
        try:
            if what == "hold":
                self.aircraft.hold()
            elif what == "rtl" or (what == "contingency" and self.vehicle.mission.first_waypoint((3,)) is None):
                self.aircraft.return_home()
            elif what == "contingency":
                self.fly_contingency(FLY_A)
        except Refused as reason:
            self.vehicle.alerts.refusal("loss", f"loss of the CUCS: {reason}", self.vehicle.now())


