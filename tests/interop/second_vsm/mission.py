"""The plan of one vehicle: upload, validation, the transfer to the aircraft, download.

What is uploaded waits in `upload` until the load command; a load that is refused leaves the plan aboard as
it was, and drops the upload. Only 13001s before a load command edit the routes of the plan aboard.
"""
import math
from dataclasses import dataclass, field

from . import aircraft as flight
from .units import ALTITUDE_STEP_M, RADIUS_STEP_M, SPEED_STEP, curve, distance, from_bam

CLEAR, LOAD, DOWNLOAD, DOWNLOAD_ONE, CANCEL = 1, 2, 3, 4, 5
IN_PROGRESS, COMPLETE, REJECTED = 0, 1, 2
LAUNCH_ROUTE, APPROACH, FLIGHT, CONTINGENCY_A, CONTINGENCY_B = range(5)
LOWEST_M, HIGHEST_M, FASTEST_MPS = -500.0, 5000.0, 25.0
LONGEST_LEG_M, MAX_WAYPOINTS = 50_000.0, 600
CURVE_PARTS = 24
# The link to the aircraft: what a transfer takes.
UPLOAD_S, UPLOAD_PER_WAYPOINT_S = 0.4, 0.002
DOWNLOAD_PER_TICK = 10
STAMP = "Time Stamp"


@dataclass
class Plan:
    """Messages as they were uploaded, by what identifies them; each is its fields without the time stamp."""

    mission: str = ""
    routes: dict = field(default_factory=dict)
    waypoints: dict = field(default_factory=dict)
    loiters: dict = field(default_factory=dict)
    curves: dict = field(default_factory=dict)
    problem: str | None = None

    def __bool__(self):
        return bool(self.routes or self.waypoints or self.loiters or self.curves or self.problem)

    def of(self, numbers):
        """The messages of some waypoints, in the order of upload."""
        for number in numbers:
            yield 13002, self.waypoints[number]
            if number in self.loiters:
                yield 13003, self.loiters[number]

    def messages(self):
        for fields in self.routes.values():
            yield 13001, fields
        yield from self.of(self.waypoints)
        yield from self.curves.values()


@dataclass
class Transfer:
    """An upload to the aircraft or a download that is on its way."""

    mode: int
    mission: str
    cucs: int
    begun: float
    takes: float = 0.0
    plan: Plan | None = None
    queue: list = field(default_factory=list)
    total: int = 0
    reported: int = 0


class Mission:
    """`report(cucs, id, fields)` sends; `changed()` is called when another plan is aboard."""

    def __init__(self, vehicle, report, changed, alert):
        self.vehicle, self._report, self._changed, self._alert = vehicle, report, changed, alert
        self.aboard, self.upload = Plan(), Plan()
        self.transfer = None
        self.highest_m, self.fastest_mps = HIGHEST_M, FASTEST_MPS

    # Upload

    def store(self, id, fields):
        """Takes one message of an upload; a reason where it cannot be part of any plan."""
        fields = {k: v for k, v in fields.items() if k != STAMP}
        problem = self.problem_of(id, fields)
        if problem:
            self.upload.problem = problem
            return problem
        plan = self.upload
        if id == 13001:
            plan.routes[fields.get("Route ID", "")] = fields
        elif id == 13002:
            plan.waypoints[fields["Waypoint Number"]] = fields
        elif id == 13003:
            plan.loiters[fields["Waypoint Number"]] = fields
        else:
            return self._store_curve(id, fields)
        return None

    def _store_curve(self, id, fields):
        p1, p4 = fields["P1 Waypoint No"], fields["P4 Waypoint No"]
        others = [key for key in self.upload.curves if key[0] == p1 and key[1] != p4]
        if others:
            self.upload.problem = f"two curve legs begin at waypoint {p1}: to {others[0][1]} and to {p4}"
            return self.upload.problem
        self.upload.curves[p1, p4] = (id, fields)
        return None

    def problem_of(self, id, fields):
        """Why a message cannot be stored, whatever else the plan has."""
        number = fields.get("Waypoint Number")
        if id in (13002, 13003) and (number is None or not 1 <= number <= 65534):
            return f"waypoint {number}: the number is out of range: expected 1 to 65534"
        check = {13001: self.problem_of_route, 13002: self.problem_of_waypoint, 13003: self.problem_of_loiter,
                 50001: self.problem_of_curve, 50002: self.problem_of_curve}.get(id)
        return check(fields) if check else None

    def problem_of_route(self, fields):
        kind = fields.get("Route Type", FLIGHT)
        if kind > CONTINGENCY_B:
            return f"route {fields.get('Route ID', '')!r}: type {kind} is out of range: expected 0 to 4"
        return None

    def problem_of_waypoint(self, fields):
        number = fields["Waypoint Number"]
        lat, lon = fields.get("Waypoint to Latitude or Relative Y"), fields.get("Waypoint to Longitude or Relative X")
        if lat is None or lon is None or "Waypoint to Altitude" not in fields:
            return f"waypoint {number}: position or altitude is missing"
        if abs(lat) > 2**30:
            return f"waypoint {number}: latitude {math.degrees(from_bam(lat, 32)):.3f} degrees is out of range: expected -90 to 90"
        altitude = fields["Waypoint to Altitude"] * ALTITUDE_STEP_M
        if not LOWEST_M <= altitude <= self.highest_m:
            return f"waypoint {number}: altitude {altitude:.2f} m is out of range: expected {LOWEST_M:.0f} to {self.highest_m:.0f} m"
        speed = fields.get("Waypoint to Speed", 0) * SPEED_STEP
        if speed > self.fastest_mps:
            return f"waypoint {number}: speed {speed:.1f} m/s is out of range: expected up to {self.fastest_mps:.0f} m/s"
        for name, highest in (("Waypoint Altitude Type", 3), ("Location Type", 0), ("Waypoint Speed Type", 3), ("Turn Type", 1),
                              ("Waypoint Type", 0), ("Limit Type", 2)):
            if fields.get(name, 0) > highest:
                return f"waypoint {number}: {name} {fields[name]} is not supported: expected 0 to {highest}"
        return None

    def problem_of_loiter(self, fields):
        number, kind = fields["Waypoint Number"], fields.get("Waypoint Loiter Type", 1)
        if kind not in (1, 4):
            return f"waypoint {number}: loiter type {kind} is not supported: expected 1 (circular) or 4 (hover)"
        if fields.get("Loiter Direction", 0) > 2 or fields.get("Loiter Duration Units", 0) > 1:
            return f"waypoint {number}: direction or duration units of the loiter are not supported"
        return None

    def problem_of_curve(self, fields):
        if any(name not in fields for name in ("P1 Waypoint No", "P4 Waypoint No", "P2 Latitude", "P2 Longitude", "P3 Latitude", "P3 Longitude")):
            return "curve: a waypoint number or a control point is missing"
        leg = f"curve from waypoint {fields['P1 Waypoint No']} to {fields['P4 Waypoint No']}"
        for name in ("P2 Latitude", "P3 Latitude", "P2 Longitude", "P3 Longitude"):
            value = fields[name]
            rad = value if isinstance(value, float) else from_bam(value, 32)
            if not math.isfinite(rad) or abs(rad) > (math.pi / 2 if "Lat" in name else math.pi):
                return f"{leg}: {name} is out of range"
        return None

    def drop_upload(self):
        self.upload = Plan()

    # 13000

    def command(self, cucs, fields, now):
        """Carries out a Mission Transfer Command; a reason where it is refused."""
        mode, mission = fields.get("Mission Plan Mode"), fields.get("Mission ID", "")
        if mode == CLEAR:
            return self.clear(cucs, mission)
        if mode == LOAD:
            return self.load(cucs, mission, now)
        if mode == DOWNLOAD:
            return self._start_download(cucs, DOWNLOAD, mission, list(self.download_of(self.aboard)), now)
        if mode == DOWNLOAD_ONE:
            number = fields.get("Waypoint Number", 0)
            if number not in self.aboard.waypoints:
                return self.reject(cucs, mission, DOWNLOAD_ONE, f"waypoint {number} is not in the plan aboard")
            return self._start_download(cucs, DOWNLOAD_ONE, mission, list(self.aboard.of([number])), now)
        if mode == CANCEL:
            return self.cancel(cucs)
        return f"13000: Mission Plan Mode {mode} is out of range: expected 1 to 5"

    def clear(self, cucs, mission):
        if self.vehicle.aircraft.mode in flight.ON_ROUTE:
            return self.reject(cucs, mission, CLEAR, "the plan is being flown; command another mode first")
        self.transfer = None
        self.drop_upload()
        self.take_aboard(Plan())
        self.status(cucs, COMPLETE, 100, CLEAR, mission)
        return None

    def cancel(self, cucs):
        self.drop_upload()
        if self.transfer:
            ended, self.transfer = self.transfer, None
            self.status(cucs, REJECTED, 0, ended.mode, ended.mission)
        return None

    def load(self, cucs, mission, now):
        plan, self.upload = self.complete(self.upload), Plan()
        plan.mission = mission
        problem = self.problem_of_plan(plan)
        if problem:
            return self.reject(cucs, mission, LOAD, problem)
        takes = (UPLOAD_S + UPLOAD_PER_WAYPOINT_S * len(plan.waypoints)) / self.vehicle.options.speed
        self.transfer = Transfer(LOAD, mission, cucs, now, takes, plan)
        self.status(cucs, IN_PROGRESS, 0, LOAD, mission)
        return None

    def complete(self, upload):
        """The plan that a load command names: what was sent, or the plan aboard with its routes edited."""
        if upload.routes and not upload.waypoints and not upload.problem:
            plan = Plan("", dict(self.aboard.routes), self.aboard.waypoints, self.aboard.loiters, self.aboard.curves)
            plan.routes.update(upload.routes)
        else:
            plan = upload
        plan.routes = {id: fields for id, fields in plan.routes.items() if fields.get("Initial Waypoint Number", 0)}
        return plan

    def problem_of_plan(self, plan):
        """Why a plan cannot be loaded."""
        if self.vehicle.link_lost:
            return "the link to the vehicle is down"
        if plan.problem:
            return plan.problem
        if not plan.waypoints:
            return "no waypoint has been sent"
        if len(plan.waypoints) > MAX_WAYPOINTS:
            return f"{len(plan.waypoints)} waypoints: expected up to {MAX_WAYPOINTS}"
        for route, fields in plan.routes.items():
            if fields["Initial Waypoint Number"] not in plan.waypoints:
                return f"route {route!r} begins at waypoint {fields['Initial Waypoint Number']}, which has not been sent"
        for number, fields in plan.waypoints.items():
            problem = self.problem_of_leg(plan, number, fields)
            if problem:
                return problem
        for number in plan.loiters:
            if number not in plan.waypoints:
                return f"the loiter of waypoint {number} belongs to no waypoint that has been sent"
        for p1, p4 in plan.curves:
            if p1 not in plan.waypoints or plan.waypoints[p1].get("Next Waypoint", 0) != p4:
                return f"curve from waypoint {p1} to {p4}: {p4} is not the Next Waypoint of {p1}"
        return None

    def problem_of_leg(self, plan, number, fields):
        following = fields.get("Next Waypoint", 0)
        if following == 0:
            return None
        if following not in plan.waypoints:
            return f"waypoint {number} names {following} as Next Waypoint, which has not been sent"
        if len(self.chain(plan, number)) > len(plan.waypoints):
            return f"waypoint {number} is part of a loop, which this vehicle does not fly"
        leg = distance(place(fields), place(plan.waypoints[following]))
        if leg > LONGEST_LEG_M:
            return f"waypoint {following} is {leg / 1000:.0f} km from waypoint {number}: expected up to {LONGEST_LEG_M / 1000:.0f} km"
        return None

    def chain(self, plan, number):
        """The waypoints from one on, by Next Waypoint; one too many where they go round."""
        numbers = []
        while number in plan.waypoints and len(numbers) <= len(plan.waypoints):
            numbers.append(number)
            number = plan.waypoints[number].get("Next Waypoint", 0)
        return numbers

    def take_aboard(self, plan):
        self.aboard = plan
        self._changed()

    def reject(self, cucs, mission, mode, problem):
        self.status(cucs, REJECTED, 0, mode, mission)
        self._alert(13000, problem)
        return problem

    def status(self, cucs, status, percent, mode, mission):
        self._report(cucs, 14000, {"Mission ID": mission, "Status": status, "Percent Complete": percent, "Waypoint Request": 0,
                                   "Mission Plan Mode": mode})

    # Download

    def download_of(self, plan):
        return plan.messages()

    def _start_download(self, cucs, mode, mission, queue, now):
        self.transfer = Transfer(mode, mission, cucs, now, queue=queue, total=max(1, len(queue)))
        return None

    # Progress

    def tick(self, now):
        t = self.transfer
        if t is None:
            return
        if t.mode == LOAD:
            self._advance_upload(t, now)
            return
        for _ in range(min(DOWNLOAD_PER_TICK, len(t.queue))):
            id, fields = t.queue.pop(0)
            self._report(t.cucs, id, fields)
        if not t.queue:
            self.transfer = None
            self.status(t.cucs, COMPLETE, 100, t.mode, t.mission)

    def _advance_upload(self, t, now):
        if self.vehicle.link_lost:
            self.transfer = None
            self.reject(t.cucs, t.mission, LOAD, "the link to the vehicle was lost during the upload")
            return
        percent = min(100, int(100 * (now - t.begun) / t.takes))
        if percent >= 100:
            self.transfer = None
            self.take_aboard(t.plan)
            self.status(t.cucs, COMPLETE, 100, LOAD, t.mission)
        elif percent // 25 > t.reported:
            t.reported = percent // 25
            self.status(t.cucs, IN_PROGRESS, percent, LOAD, t.mission)

    # Flight

    def route_from(self, kinds=(FLIGHT, LAUNCH_ROUTE, APPROACH), start=None):
        """The points to fly: from a waypoint, or from the start of the first route of these types."""
        if start is None:
            start = self.first_waypoint(kinds)
        if start not in self.aboard.waypoints:
            raise flight.Refused(f"waypoint {start} is not in the plan aboard" if start else "no such route is aboard; load one first")
        points = []
        for number in self.flown_order(start):
            fields = self.aboard.waypoints[number]
            arriving = self.curve_to(number, points)
            points += arriving + [self.point(number, fields)]
        if distance(self.vehicle.aircraft.place, points[0].place) > LONGEST_LEG_M:
            raise flight.Refused(f"waypoint {points[0].number} is more than {LONGEST_LEG_M / 1000:.0f} km away")
        return points

    def flown_order(self, start):
        return self.chain(self.aboard, start)

    def first_waypoint(self, kinds):
        for kind in kinds:
            for fields in self.aboard.routes.values():
                if fields.get("Route Type", FLIGHT) == kind:
                    return fields["Initial Waypoint Number"]
        if FLIGHT in kinds and self.aboard.waypoints:
            named = {f.get("Next Waypoint", 0) for f in self.aboard.waypoints.values()}
            return next((n for n in self.aboard.waypoints if n not in named), next(iter(self.aboard.waypoints)))
        return None

    def point(self, number, fields):
        altitude = self.vehicle.above_sea(fields["Waypoint to Altitude"] * ALTITUDE_STEP_M, fields.get("Waypoint Altitude Type", 1))
        kind = fields.get("Waypoint Speed Type", 2)
        speed = fields.get("Waypoint to Speed", 0) * SPEED_STEP
        return flight.Point(number, place(fields), altitude, speed or None, fields.get("Turn Type", 0) == 1,
                            self.loiter_at(number, fields), kind < 2)

    def loiter_at(self, number, waypoint):
        fields = self.aboard.loiters.get(number)
        if fields is None or not fields.get("Loiter Duration", 0):
            return None
        radius = fields.get("Loiter Radius", 0) * RADIUS_STEP_M if fields.get("Waypoint Loiter Type", 1) == 1 else 0.0
        loiter = flight.Loiter(place(waypoint), radius, fields.get("Loiter Direction", 0) != 2)
        if fields.get("Loiter Duration Units", 0) == 1 and radius:
            loiter.turns = fields["Loiter Duration"]
        else:
            loiter.duration = self.loiter_seconds(fields)
        return loiter

    def loiter_seconds(self, fields):
        return float(fields["Loiter Duration"])

    def curve_to(self, number, before):
        """The points between two waypoints that a curve joins."""
        if not before or (before[-1].number, number) not in self.aboard.curves:
            return []
        _, fields = self.aboard.curves[before[-1].number, number]
        controls = [tuple(v if isinstance(v, float) else from_bam(v, 32) for v in (fields[f"{p} Latitude"], fields[f"{p} Longitude"]))
                    for p in ("P2", "P3")]
        end = self.point(number, self.aboard.waypoints[number])
        places = curve(before[-1].place, *controls, end.place, CURVE_PARTS)[:-1]
        climb = end.altitude - before[-1].altitude
        return [flight.Point(0, place, before[-1].altitude + climb * (i + 1) / CURVE_PARTS, end.speed) for i, place in enumerate(places)]


def place(fields):
    return from_bam(fields["Waypoint to Latitude or Relative Y"], 32), from_bam(fields["Waypoint to Longitude or Relative X"], 32)
