"""The simulated aircraft: a point mass with the modes of a small vehicle that can hover and circle.

It knows nothing of the DLI. Positions are radians, altitudes metres above mean sea level, speeds m/s; time
is the aircraft's own, so that a speed factor is no more than larger steps.
"""
import math
from dataclasses import dataclass, field

from .units import clamp, distance, moved, offset, wrap_angle

IDLE, MANUAL, ROUTE, LOITER, STEER = "idle", "manual", "route", "loiter", "steer"
LAND, CLIMB_AWAY, LAUNCH, RETURN, CONTINGENCY_A, CONTINGENCY_B = "land", "climb away", "launch", "return", "contingency a", "contingency b"
ON_ROUTE = (ROUTE, CONTINGENCY_A, CONTINGENCY_B)
STEP_S = 0.05
ACCELERATION = 5.0
CLIMB, DESCENT, TOUCH_DOWN = 5.0, 3.0, 2.0
CRUISE, FASTEST = 12.0, 25.0
TURN_RATE = 0.4
CUT_M, OVER_M = 15.0, 3.0
HOVER_M = 2.0
RETURN_HEIGHT_M, CLIMB_AWAY_M, LAUNCH_HEIGHT_M = 30.0, 30.0, 30.0
ENDURANCE_S = 7200.0
GRAVITY = 9.81
STICK_SPEED, STICK_TIMEOUT_S = 10.0, 1.0
# How long roll and pitch take to follow, and the pitch that a metre per second through the air takes.
TILT_S, DRAG_RAD = 0.5, 0.008


@dataclass
class Loiter:
    """A place to stay at: a circle where `radius` is given, else a hover."""

    place: tuple
    radius: float = 0.0
    clockwise: bool = True
    duration: float | None = None
    turns: float | None = None
    since: float | None = None
    turned: float = 0.0
    bearing: float | None = None


@dataclass
class Point:
    """One place of a route. `number` 0 is a point between waypoints, of a curve."""

    number: int
    place: tuple
    altitude: float
    speed: float | None = None
    over: bool = False
    loiter: Loiter | None = None
    airspeed: bool = False


@dataclass
class Sticks:
    forward: float = 0.0
    right: float = 0.0
    turn: float = 0.0
    up: float = 0.0
    at: float = -1e9


@dataclass
class Steering:
    """What mode 15 holds; None leaves it alone."""

    altitude: float | None = None
    vertical_speed: float | None = None
    climb_limit: float | None = None
    heading: float | None = None
    course: float | None = None
    roll: float | None = None
    turn_rate: float | None = None
    turn_limit: float = 0.0


@dataclass
class Engine:
    command: int = 0
    status: int = 0


class Refused(Exception):
    """The aircraft cannot do what was commanded; the text says why."""


@dataclass
class Aircraft:
    home: tuple
    ground: float
    geoid: float = 47.0
    variation: float = math.radians(15)
    wind: tuple = (0.0, 0.0)
    heading: float = 0.0
    engines: list = field(default_factory=lambda: [Engine(), Engine()])

    def __post_init__(self):
        self.place, self.altitude = self.home, self.ground
        self.north = self.east = self.up = 0.0
        self._stand()
        self.mode = IDLE
        self.time = 0.0
        self.battery = 100.0
        self.fix = True
        self.lights = 0
        self.speed, self.airspeed_held = CRUISE, False
        self.target_altitude = self.ground
        self.altitude_override = None
        self.steering, self.sticks = Steering(), Sticks()
        self.loiter = None
        self.route, self.leg = [], 0
        self.departed = None
        self.terminated = False

    # What it is asked

    @property
    def airborne(self):
        return self.altitude > self.ground + 0.3 or self.mode != IDLE

    @property
    def height(self):
        return self.altitude - self.ground

    def launch(self, altitude=None):
        if self.airborne:
            raise Refused("the vehicle is already in the air")
        if self.terminated:
            raise Refused("flight termination has been executed; reset it first")
        self.target_altitude = self.ground + LAUNCH_HEIGHT_M if altitude is None else altitude
        if self.target_altitude < self.ground + 2:
            raise Refused("the commanded altitude is on the ground")
        self.mode = LAUNCH
        self.engines = [Engine(1, 2) for _ in self.engines]

    def hold(self, place=None, altitude=None, radius=0.0, clockwise=True):
        self._must_fly()
        self.loiter = Loiter(place or self.place, radius, clockwise)
        self.target_altitude = self.altitude if altitude is None else altitude
        self.mode = LOITER

    def fly(self, points, mode=ROUTE):
        self._must_fly()
        self.route, self.leg, self.mode = points, 0, mode
        self.departed = Point(0, self.place, self.altitude), self.time
        self.altitude_override = None

    def steer(self, steering):
        self._must_fly()
        if self.mode != STEER:
            self.target_altitude = self.altitude
        self.steering, self.mode = steering, STEER

    def manual(self):
        self._must_fly()
        self.sticks, self.mode = Sticks(), MANUAL

    def land(self):
        self._must_fly()
        self.mode = LAND

    def climb_away(self):
        if self.mode != LAND:
            raise Refused("no landing is in progress")
        self.target_altitude = self.altitude + CLIMB_AWAY_M
        self.mode = CLIMB_AWAY

    def return_home(self):
        self._must_fly()
        self.target_altitude = max(self.altitude, self.ground + RETURN_HEIGHT_M)
        self.mode = RETURN

    def terminate(self):
        self.terminated = True
        self.engines = [Engine(0, 0) for _ in self.engines]

    def start_engine(self, number, command):
        if not 1 <= number <= len(self.engines):
            raise Refused(f"there is no engine {number}: expected 1 to {len(self.engines)}")
        if self.airborne and command == 0:
            raise Refused("the vehicle is in the air")
        self.engines[number - 1] = Engine(command, min(command, 2))

    def change_altitude(self, altitude):
        """In a route until the next mode command, elsewhere for good."""
        self._must_fly()
        if self.mode in ON_ROUTE:
            self.altitude_override = altitude
        elif self.mode in (LAND, CLIMB_AWAY):
            raise Refused("a landing is in progress")
        else:
            self.target_altitude = altitude
            self.steering.altitude, self.steering.vertical_speed = altitude, None

    def change_speed(self, speed, airspeed):
        self.speed, self.airspeed_held = speed, airspeed
        for point in self.route:
            point.speed = None

    def _must_fly(self):
        if not self.airborne:
            raise Refused("the vehicle is on the ground; launch it first")

    # Flight

    def advance(self, seconds):
        while seconds > 1e-9:
            step = min(STEP_S, seconds)
            self._step(step)
            seconds -= step

    def _step(self, dt):
        self.time += dt
        if self.mode == IDLE and not self.height > 0:
            self.north = self.east = self.up = 0.0
            self._stand()
            return
        self.battery = max(0.0, self.battery - 100 * dt / ENDURANCE_S)
        before = self.heading
        if self.terminated:
            north, east, up = self.north * 0.9, self.east * 0.9, -12.0
        else:
            north, east, up = self._wanted(dt)
        was = self.north, self.east, self.up
        self._accelerate(north, east, up, dt)
        self.acceleration = tuple((now - then) / dt for now, then in zip((self.north, self.east, self.up), was))
        self.place = moved(self.place, self.north * dt, self.east * dt)
        self.altitude += self.up * dt
        self._turn(dt, before)
        self._tilt(dt)
        if self.altitude <= self.ground and self.mode not in (LAUNCH, CLIMB_AWAY):
            self._touch_down()

    def _wanted(self, dt):
        """The velocity that the mode asks for."""
        if self.mode == LAUNCH or self.mode == CLIMB_AWAY:
            if abs(self.altitude - self.target_altitude) < 0.7:
                self.hold(altitude=self.target_altitude)
            return 0.0, 0.0, self._climb_to(self.target_altitude)
        if self.mode == LAND:
            return 0.0, 0.0, -DESCENT if self.height > 12 else -TOUCH_DOWN
        if self.mode == RETURN:
            if distance(self.place, self.home) < 3:
                self.mode = LAND
            return *self._toward(self.home, self.speed, True), self._climb_to(self.target_altitude)
        if self.mode == MANUAL:
            return self._by_sticks(dt)
        if self.mode == STEER:
            return self._by_steering(dt)
        if self.mode in ON_ROUTE:
            return self._along_route()
        return *self._around(self.loiter, self.speed), self._climb_to(self.target_altitude)

    def _climb_to(self, altitude, limit=None):
        error = altitude - self.altitude
        return clamp(error * 0.8, -min(limit or DESCENT, DESCENT), min(limit or CLIMB, CLIMB))

    def _ground_speed(self, speed, course, airspeed):
        """Over the ground in that direction; an airspeed is flown in the wind."""
        if not airspeed:
            return speed
        along = self.wind[0] * math.cos(course) + self.wind[1] * math.sin(course)
        across = -self.wind[0] * math.sin(course) + self.wind[1] * math.cos(course)
        return max(0.0, along + math.sqrt(max(0.0, speed**2 - across**2)))

    def _toward(self, place, speed, stop, airspeed=None):
        north, east = offset(self.place, place)
        far, course = math.hypot(north, east), math.atan2(east, north)
        speed = self._ground_speed(speed, course, self.airspeed_held if airspeed is None else airspeed)
        if stop:
            speed = min(speed, math.sqrt(2 * 2.0 * far), far)
        return speed * math.cos(course), speed * math.sin(course)

    def _around(self, loiter, speed):
        if loiter.radius <= HOVER_M:
            return self._toward(loiter.place, speed, True)
        north, east = offset(loiter.place, self.place)
        far, bearing = math.hypot(north, east), math.atan2(east, north)
        if loiter.bearing is not None and abs(far - loiter.radius) < 0.3 * loiter.radius:
            loiter.turned += abs(wrap_angle(bearing - loiter.bearing))
        loiter.bearing = bearing
        speed = min(speed, math.sqrt(3.0 * loiter.radius))
        outward = clamp((loiter.radius - far) * 0.5, -speed, speed)
        around = math.sqrt(max(0.0, speed**2 - outward**2)) * (1 if loiter.clockwise else -1)
        if far > 2 * loiter.radius:
            outward, around = -speed, 0.0
        # The turn needs this much inward acceleration in advance, or the track lags outside the circle.
        outward -= around**2 / loiter.radius * 2 * STEP_S
        return (outward * math.cos(bearing) - around * math.sin(bearing), outward * math.sin(bearing) + around * math.cos(bearing))

    def _along_route(self):
        point = self.route[self.leg]
        speed = min(point.speed or self.speed, FASTEST)
        airspeed = point.airspeed if point.speed else self.airspeed_held
        altitude = point.altitude if self.altitude_override is None else self.altitude_override
        up = self._climb_to(altitude)
        last = self.leg == len(self.route) - 1
        far = distance(self.place, point.place)
        if point.loiter and point.loiter.since is not None:
            if self._loitered_enough(point.loiter):
                self._next_leg()
            return *self._around(point.loiter, speed), up
        near = OVER_M if point.over or point.loiter or last else (2.0 if point.number == 0 else CUT_M)
        # A fast step may jump over a small circle.
        if far <= max(near, 0.6 * STEP_S * speed):
            if point.loiter:
                point.loiter.since = self.time
                point.loiter.turned = 0.0
            else:
                self._next_leg()
        return *self._toward(point.place, speed, point.over or last or bool(point.loiter), airspeed), up

    def _loitered_enough(self, loiter):
        if loiter.radius > HOVER_M and loiter.bearing is not None and loiter.turned == 0.0:
            loiter.since = self.time
        if loiter.turns is not None:
            return loiter.turned >= loiter.turns * 2 * math.pi
        return self.time - loiter.since >= loiter.duration

    def _next_leg(self):
        self.departed = self.route[self.leg], self.time
        if self.leg + 1 < len(self.route):
            self.leg += 1
        else:
            altitude = self.route[self.leg].altitude if self.altitude_override is None else self.altitude_override
            self.hold(self.route[self.leg].place, altitude)

    def _by_steering(self, dt):
        s = self.steering
        if s.vertical_speed is not None:
            up = clamp(s.vertical_speed, -DESCENT, CLIMB)
        else:
            up = self._climb_to(self.target_altitude if s.altitude is None else s.altitude, s.climb_limit)
        wanted = s.heading if s.heading is not None else s.course
        if wanted is not None:
            rate = s.turn_limit or TURN_RATE
            self.heading = wrap_angle(self.heading + clamp(wrap_angle(wanted - self.heading), -rate * dt, rate * dt))
        elif s.roll is not None:
            self.heading = wrap_angle(self.heading + GRAVITY * math.tan(clamp(s.roll, -1, 1)) / max(self.speed, 3) * dt)
        elif s.turn_rate is not None:
            self.heading = wrap_angle(self.heading + clamp(s.turn_rate, -1.5, 1.5) * dt)
        speed = self._ground_speed(min(self.speed, FASTEST), self.heading, self.airspeed_held)
        direction = s.course if s.heading is not None and s.course is not None else self.heading
        return speed * math.cos(direction), speed * math.sin(direction), up

    def _by_sticks(self, dt):
        s = self.sticks if self.time - self.sticks.at < STICK_TIMEOUT_S * 20 else Sticks()
        self.heading = wrap_angle(self.heading + s.turn * TURN_RATE * dt)
        forward, right = s.forward * STICK_SPEED, s.right * STICK_SPEED
        c, sin = math.cos(self.heading), math.sin(self.heading)
        return forward * c - right * sin, forward * sin + right * c, s.up * DESCENT

    def _accelerate(self, north, east, up, dt):
        """Toward the wanted velocity; the track turns before the speed falls off."""
        dn, de = north - self.north, east - self.east
        change, most = math.hypot(dn, de), ACCELERATION * dt
        share = 1.0 if change <= most else most / change
        self.north += dn * share
        self.east += de * share
        self.up += clamp(up - self.up, -3 * dt, 3 * dt)

    def _turn(self, dt, before):
        """`before` is the heading at the beginning of the step: steering has turned it already."""
        if self.mode not in (STEER, MANUAL) and math.hypot(self.north, self.east) > 0.5:
            self.heading = math.atan2(self.east, self.north)
        self.turn_rate = wrap_angle(self.heading - before) / dt if dt else 0.0

    def _tilt(self, dt):
        """Right wing down in a turn to the right, nose down to fly faster forward; both follow with a delay."""
        north, east, _ = self.acceleration
        forward = north * math.cos(self.heading) + east * math.sin(self.heading)
        roll = clamp(math.atan(self.ground_speed * self.turn_rate / GRAVITY), -0.6, 0.6)
        pitch = -math.atan(forward / GRAVITY) - DRAG_RAD * self.airspeed()
        share = min(1.0, dt / TILT_S)
        self.roll_rate, self.pitch_rate = (roll - self.roll) * share / dt, (pitch - self.pitch) * share / dt
        self.roll += self.roll_rate * dt
        self.pitch += self.pitch_rate * dt

    def _stand(self):
        self.acceleration = 0.0, 0.0, 0.0
        self.turn_rate = self.roll = self.pitch = self.roll_rate = self.pitch_rate = 0.0

    def _touch_down(self):
        self.altitude = self.ground
        self.north = self.east = self.up = 0.0
        self.mode = IDLE
        self._stand()
        self.engines = [Engine() for _ in self.engines]

    # What it reports of its way

    @property
    def ground_speed(self):
        return math.hypot(self.north, self.east)

    def airspeed(self):
        return math.hypot(self.north - self.wind[0], self.east - self.wind[1])
