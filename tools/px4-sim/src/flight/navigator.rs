//! The automatic modes: take-off, hold, mission, return, land, orbit.
//!
//! One step takes a view of the vehicle and returns the guidance, the heading, and the mode that follows.

use mavlink_link::service::mission::Item;

use crate::config::{Airframe, Param};
use crate::flight::items;
use crate::flight::mission::Mission;
use crate::flight::mode::Mode;
use crate::flight::view::{Note, View, loiter};
use crate::physics::motion::{Ned, wrap_pi};
use crate::physics::trajectory::{Circle, Guidance, Heading, Leg};

/// The target of DO_REPOSITION.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Reposition {
    /// Local target; a component that is NaN keeps the present value.
    pub target: Ned,
    /// Heading, radians; NaN means toward the target.
    pub yaw: f64,
    /// Ground speed, m/s, where given.
    pub speed: Option<f64>,
    /// Loiter radius of a plane, m, where given; positive is clockwise.
    pub radius: Option<f64>,
    /// A figure eight of a plane: half its length and the radius of its ends, m, and the direction of its long axis, radians.
    pub eight: Option<[f64; 3]>,
}

impl Reposition {
    /// A flight to this place, and nothing else.
    pub(crate) fn to(target: Ned) -> Self {
        Self {
            target,
            yaw: f64::NAN,
            speed: None,
            radius: None,
            eight: None,
        }
    }
}

/// The result of a step.
#[derive(Debug)]
pub(crate) struct Step {
    /// How to move.
    pub guidance: Guidance,
    /// Where to point the nose.
    pub heading: Heading,
    /// The mode is finished; this one follows.
    pub then: Option<Mode>,
}

#[derive(Debug, Clone, Copy, Default, PartialEq)]
enum Return {
    Climb(f64),
    Back(f64),
    Down,
    #[default]
    Land,
}

/// The phase of a VTOL's take-off.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
enum VtolTakeoff {
    /// Climbing on its rotors to this height (local down), before a transition toward this place.
    Hover(f64, Ned),
    Transition(Ned),
    /// Climbing to its loiter.
    Climb(Ned),
    #[default]
    Done,
}

/// The navigator; the default has no active mode and no mission.
#[derive(Debug, Clone, Default)]
pub(crate) struct Navigator {
    /// The mission and its progress.
    pub mission: Mission,
    active: Option<Mode>,
    hold: Ned,
    reposition: Option<Reposition>,
    takeoff_altitude: Option<f64>,
    takeoff_target: Ned,
    takeoff_place: Option<Ned>,
    vtol_takeoff: VtolTakeoff,
    course: f64,
    course_d: f64,
    lobe: bool,
    homeward: Return,
    /// Rally points, as uploaded.
    rally: Vec<Item>,
    /// The destination of a return: home, or a rally point.
    destination: Ned,
    orbit: Option<Circle>,
    speed: Option<f64>,
}

impl Navigator {
    /// NAV_TAKEOFF's altitude, AMSL; `None` means MIS_TAKEOFF_ALT above the present place. A plane then loiters
    /// around `place`.
    pub(crate) fn set_takeoff(&mut self, amsl: Option<f64>, place: Option<Ned>) {
        self.takeoff_altitude = amsl;
        self.takeoff_place = place;
    }

    /// NAV_VTOL_TAKEOFF: the altitude of the transition, AMSL, and the place of the loiter.
    pub(crate) fn set_vtol_takeoff(&mut self, amsl: Option<f64>, place: Ned) {
        self.takeoff_altitude = amsl;
        self.takeoff_place = Some(place);
    }

    /// GUIDED_CHANGE_HEADING: a course over ground, radians.
    pub(crate) fn set_course(&mut self, course: f64) {
        self.course = course;
    }

    /// DO_CHANGE_ALTITUDE in the course mode, local down.
    pub(crate) fn set_course_height(&mut self, d: f64) {
        self.course_d = d;
    }

    /// The loiter of now, as a target.
    pub(crate) fn kept_loiter(&self) -> Reposition {
        let kept = self.reposition.unwrap_or(Reposition::to(self.hold));
        Reposition {
            target: self.hold,
            ..kept
        }
    }

    /// DO_REPOSITION. One with an altitude and without a place keeps the place that is flown to, be it a waypoint of the mission; one
    /// without either stops (navigator_main.cpp).
    pub(crate) fn set_reposition(&mut self, mut reposition: Reposition, view: &View<'_>) {
        let kept = match self.active {
            Some(Mode::Loiter) => Some(self.hold),
            Some(Mode::Mission) => self.mission.flown_to(view),
            _ => None,
        };
        let target = &mut reposition.target;
        if target.d.is_finite()
            && let Some(kept) = kept
        {
            *target = target.or(kept);
        }
        self.reposition = Some(reposition);
        if self.active == Some(Mode::Loiter) {
            self.apply_reposition(view);
        }
    }

    /// A new plan of rally points is stored.
    pub(crate) fn set_rally(&mut self, items: &[Item]) {
        self.rally = items.to_vec();
    }

    /// DO_ORBIT.
    pub(crate) fn set_orbit(&mut self, orbit: Circle) {
        self.orbit = Some(orbit);
    }

    /// The present orbit.
    pub(crate) fn orbit(&self) -> Option<Circle> {
        self.orbit
    }

    /// The centre of the figure eight that is flown.
    pub(crate) fn eight(&self) -> Option<Ned> {
        let loiters = self.active == Some(Mode::Loiter);
        let reposition = self.reposition.filter(|_| loiters)?;
        reposition.eight.map(|_| self.hold)
    }

    /// DO_CHANGE_SPEED by command: for the mode that is active.
    pub(crate) fn set_speed(&mut self, speed: Option<f64>) {
        self.speed = speed;
        self.mission.set_speed(speed);
    }

    /// One step in `mode`; `armed` decides whether anything moves at all.
    pub(crate) fn step(
        &mut self,
        mode: Mode,
        armed: bool,
        view: &View<'_>,
        notes: &mut Vec<Note>,
    ) -> Step {
        let active = armed.then_some(mode);
        if active != self.active {
            if self.active == Some(Mode::Mission) {
                self.mission.deactivate();
                // Also by a disarming, which is on the ground.
                if !view.landed {
                    notes.push(Note::CentreGimbal);
                }
            }
            self.active = active;
            if let Some(mode) = active {
                self.enter(mode, view, notes);
            }
        }
        if active != Some(Mode::Mission) {
            self.mission.idle(armed);
        }
        if !armed {
            return Step {
                guidance: Guidance::Ground,
                heading: Heading::Hold,
                then: None,
            };
        }
        let mut then = None;
        let (guidance, heading) = match mode {
            Mode::Mission => {
                let flown = self.mission.step(view, notes);
                if notes.contains(&Note::ReturnHome) {
                    then = Some(Mode::Rtl);
                } else if !self.mission.is_valid() || (self.mission.is_finished() && !view.landed) {
                    // As observed, a mission that ends in the air leaves PX4 in AUTO.LOITER, and so does one that is
                    // cleared.
                    then = Some(Mode::Loiter);
                }
                flown
            }
            Mode::Takeoff => self.take_off(view, &mut then),
            Mode::VtolTakeoff => self.vtol_take_off(view, notes, &mut then),
            Mode::Course => self.keep_course(view),
            Mode::Rtl => self.return_home(view, notes),
            Mode::Land if view.airframe == Airframe::Plane && view.vtol.is_some() => {
                notes.push(Note::Transition { to_wings: false });
                (loiter(self.hold, view), Heading::Hold)
            }
            Mode::Land => {
                // PX4 calls the mission complete, whatever item is the current one (land.cpp, `on_active`).
                if view.landed {
                    self.mission.set_finished(true);
                }
                (self.land(self.hold, view), Heading::Hold)
            }
            Mode::Orbit => self.fly_orbit(view),
            _ if view.landed => (Guidance::Ground, Heading::Hold),
            _ => self.stay(view),
        };
        Step {
            guidance,
            heading,
            then,
        }
    }

    fn enter(&mut self, mode: Mode, view: &View<'_>, notes: &mut Vec<Note>) {
        if mode != Mode::Mission {
            self.hold = stopping_point(view);
        }
        if matches!(mode, Mode::Land | Mode::Rtl) {
            notes.push(Note::CentreGimbal);
        }
        match mode {
            Mode::Mission => self.mission.activate(view, notes),
            Mode::Loiter => {
                self.speed = None;
                self.apply_reposition(view);
            }
            Mode::Takeoff => self.prepare_takeoff(view, notes),
            Mode::VtolTakeoff => self.prepare_vtol_takeoff(view),
            Mode::Course => {
                self.speed = None;
                self.course_d = view.position.d;
                self.course = if view.velocity.horizontal() > 1.0 {
                    view.velocity.bearing()
                } else {
                    view.yaw
                };
            }
            Mode::Rtl => self.prepare_return(view, notes),
            // MISSION_CURRENT.mission_state of a completed mission is active again (land.cpp, `on_activation`).
            Mode::Land => self.mission.set_finished(false),
            _ => {}
        }
        if mode != Mode::Loiter {
            self.reposition = None;
        }
    }

    fn apply_reposition(&mut self, view: &View<'_>) {
        let Some(reposition) = self.reposition else {
            return;
        };
        self.hold = reposition.target.or(stopping_point(view));
        if reposition.speed.is_some() {
            self.speed = reposition.speed;
        }
    }

    fn stay(&mut self, view: &View<'_>) -> (Guidance, Heading) {
        let mut guidance = loiter(self.hold, view);
        let eight = self.reposition.and_then(|r| r.eight);
        if let (Some(eight), Guidance::Circle(_)) = (eight, &guidance) {
            guidance = Guidance::Circle(self.lobe_of(eight, view));
        }
        if let Guidance::Leg(leg) = &mut guidance
            && let Some(speed) = self.speed
        {
            leg.speed = speed;
        }
        if let Guidance::Circle(circle) = &mut guidance
            && let Some(radius) = self.reposition.and_then(|r| r.radius)
        {
            circle.radius = radius;
        }
        if let Guidance::Circle(circle) = &mut guidance
            && let Some(speed) = self.speed
        {
            circle.speed = speed;
        }
        let heading = match self.reposition {
            Some(reposition) if reposition.yaw.is_finite() => Heading::To(reposition.yaw),
            Some(_) => Heading::Along,
            None => Heading::Hold,
        };
        (guidance, heading)
    }

    /// The circle at the present end of a figure eight: one is clockwise, the other counter-clockwise.
    fn lobe_of(&mut self, [half, radius, axis]: [f64; 3], view: &View<'_>) -> Circle {
        let off = view.position - self.hold;
        let along = off.n * axis.cos() + off.e * axis.sin();
        let v = view.velocity;
        let towards = (v.n * axis.cos() + v.e * axis.sin()) / v.horizontal().max(1.0);
        // An end is done once the vehicle heads back past its centre: the other end follows.
        let past = half - radius + PAST_M;
        if self.lobe && towards < -STRAIGHT && along < past {
            self.lobe = false;
        } else if !self.lobe && towards > STRAIGHT && along > -past {
            self.lobe = true;
        }
        let side = if self.lobe { 1.0 } else { -1.0 };
        let reach = side * (half - radius);
        Circle {
            centre: Ned::new(
                self.hold.n + reach * axis.cos(),
                self.hold.e + reach * axis.sin(),
                self.hold.d,
            ),
            radius: side * radius,
            speed: view.cruise(),
        }
    }

    /// Straight on along the course, without an end.
    fn keep_course(&self, view: &View<'_>) -> (Guidance, Heading) {
        let far = Ned::new(
            view.position.n + AHEAD_M * self.course.cos(),
            view.position.e + AHEAD_M * self.course.sin(),
            self.course_d,
        );
        let mut leg = view.leg(far);
        leg.speed = self.speed.unwrap_or(leg.speed);
        (Guidance::Leg(leg), Heading::Along)
    }

    fn prepare_vtol_takeoff(&mut self, view: &View<'_>) {
        let ground = view.frame.origin().altitude_m;
        let amsl = self.takeoff_altitude.take();
        let d = amsl.map_or(view.position.d, |amsl| ground - amsl);
        let place = self.takeoff_place.take().unwrap_or(view.position);
        let loiter = Ned {
            d: view.position.d - view.params.get(Param::VTO_LOITER_ALT),
            ..place.or(view.position)
        };
        self.takeoff_target = Ned { d, ..view.position };
        self.vtol_takeoff = VtolTakeoff::Hover(d, loiter);
        self.mission.set_finished(false);
    }

    fn vtol_take_off(
        &mut self,
        view: &View<'_>,
        notes: &mut Vec<Note>,
        then: &mut Option<Mode>,
    ) -> (Guidance, Heading) {
        let up = Guidance::Climb(view.leg(self.takeoff_target));
        match self.vtol_takeoff {
            VtolTakeoff::Hover(d, loiter) => {
                let bearing = (loiter - view.position).bearing();
                let turned = wrap_pi(bearing - view.yaw).abs() < ALIGNED_RAD;
                if !view.landed && view.position.d - d < view.altitude_acceptance() && turned {
                    notes.push(Note::Transition { to_wings: true });
                    self.vtol_takeoff = VtolTakeoff::Transition(loiter);
                }
                (up, Heading::To(bearing))
            }
            VtolTakeoff::Transition(loiter) => {
                if view.airframe == Airframe::Plane {
                    self.vtol_takeoff = VtolTakeoff::Climb(loiter);
                }
                (up, Heading::Hold)
            }
            VtolTakeoff::Climb(at) => {
                let off = at - view.position;
                let near = view.acceptance() + view.params.get(Param::NAV_LOITER_RAD).abs();
                if off.d.abs() < view.altitude_acceptance() && off.horizontal() < near {
                    self.vtol_takeoff = VtolTakeoff::Done;
                    self.mission.set_finished(true);
                    self.reposition = Some(Reposition::to(at));
                    *then = Some(Mode::Loiter);
                }
                (loiter(at, view), Heading::Hold)
            }
            VtolTakeoff::Done => (loiter(view.position, view), Heading::Hold),
        }
    }

    fn prepare_takeoff(&mut self, view: &View<'_>, notes: &mut Vec<Note>) {
        let ground = view.frame.origin().altitude_m;
        let amsl = self.takeoff_altitude.take().unwrap_or_else(|| {
            let above = view.params.get(Param::MIS_TAKEOFF_ALT);
            notes.push(Note::Info(format!(
                "Using default takeoff altitude: {above:.1} m\t"
            )));
            ground - view.position.d + above
        });
        let mut d = ground - amsl;
        if !view.landed && d > view.position.d {
            notes.push(Note::Critical(
                "Already higher than takeoff altitude\t".into(),
            ));
            d = view.position.d;
        }
        // A plane cannot climb vertically: it takes off toward a point ahead.
        let ahead = if view.airframe == Airframe::Plane {
            400.0
        } else {
            0.0
        };
        self.takeoff_target = Ned::new(
            view.position.n + ahead * view.yaw.cos(),
            view.position.e + ahead * view.yaw.sin(),
            d,
        );
        self.mission.set_finished(false);
    }

    fn take_off(&mut self, view: &View<'_>, then: &mut Option<Mode>) -> (Guidance, Heading) {
        let to_go = view.position.d - self.takeoff_target.d;
        let height = view.home.d - self.takeoff_target.d;
        // Half the height for take-offs lower than the acceptance height: they would otherwise be finished on the
        // ground.
        let margin = match view.airframe {
            Airframe::Quad | Airframe::Vtol => {
                view.altitude_acceptance().min((height / 2.0).max(0.1))
            }
            Airframe::Plane => 0.0,
        };
        if !view.landed && to_go < margin {
            self.mission.set_finished(true);
            *then = Some(Mode::Loiter);
            // A plane loiters around the place in the command, where it has one.
            let place = self.takeoff_place.take();
            self.reposition = place
                .filter(|_| view.airframe == Airframe::Plane)
                .map(|at| {
                    Reposition::to(Ned {
                        d: self.takeoff_target.d,
                        ..at
                    })
                });
        }
        (
            Guidance::Climb(view.leg(self.takeoff_target)),
            Heading::Hold,
        )
    }

    fn prepare_return(&mut self, view: &View<'_>, notes: &mut Vec<Note>) {
        if view.landed {
            self.homeward = Return::Land;
            self.destination = view.home;
            return;
        }
        self.destination = destination(&self.rally, view);
        let d = return_height(self.destination, view);
        let amsl = view.frame.origin().altitude_m - d;
        let above = self.destination.d - d;
        notes.push(Note::Info(format!(
            "RTL: start return at {amsl:.0} m ({above:.0} m above destination)\t"
        )));
        self.homeward = Return::Climb(d);
    }

    fn return_home(&mut self, view: &View<'_>, notes: &mut Vec<Note>) -> (Guidance, Heading) {
        let descend = self.destination.d - view.params.get(Param::RTL_DESCEND_ALT);
        match self.homeward {
            Return::Climb(d) => {
                if view.position.d - d < view.altitude_acceptance() {
                    self.homeward = Return::Back(d);
                    self.hold = view.position;
                }
                (fly_to(Ned { d, ..self.hold }, view), Heading::Hold)
            }
            Return::Back(d) => {
                let over = Ned {
                    d,
                    ..self.destination
                };
                if (over - view.position).horizontal() < view.acceptance() {
                    self.homeward = Return::Down;
                }
                let leg = Leg {
                    from: self.hold,
                    ..view.leg(over)
                };
                (Guidance::Leg(leg), Heading::Along)
            }
            Return::Down => {
                let d = descend.max(view.position.d.min(descend));
                let over = Ned {
                    d,
                    ..self.destination
                };
                let off = over - view.position;
                let near = match view.airframe {
                    Airframe::Quad | Airframe::Vtol => off.horizontal() < 1.0,
                    Airframe::Plane => true,
                };
                // RTL_LAND_DELAY is -1 by default on wings: the vehicle loiters there.
                let lands = view.params.get(Param::RTL_LAND_DELAY) >= 0.0;
                if lands && near && view.position.d > d - view.altitude_acceptance() {
                    notes.push(Note::Info("RTL: land at destination\t".into()));
                    self.homeward = Return::Land;
                }
                (loiter(over, view), Heading::Hold)
            }
            Return::Land if view.airframe == Airframe::Plane && view.vtol.is_some() => {
                notes.push(Note::Transition { to_wings: false });
                (loiter(self.destination, view), Heading::Hold)
            }
            Return::Land => (self.land(self.destination, view), Heading::Hold),
        }
    }

    fn land(&self, at: Ned, view: &View<'_>) -> Guidance {
        if view.landed {
            return Guidance::Ground;
        }
        Guidance::Land(view.leg(Ned {
            d: view.home.d,
            ..at
        }))
    }

    fn fly_orbit(&mut self, view: &View<'_>) -> (Guidance, Heading) {
        match self.orbit.filter(|_| !view.landed) {
            Some(orbit) => (Guidance::Circle(orbit), Heading::Along),
            None => self.stay(view),
        }
    }
}

/// The place where the vehicle stops if it brakes now.
fn stopping_point(view: &View<'_>) -> Ned {
    if view.airframe == Airframe::Plane {
        return view.position;
    }
    let speed = view.velocity.horizontal();
    let acc = view.params.get(Param::MPC_ACC_HOR).max(0.5);
    let jerk = view.params.get(Param::MPC_JERK_AUTO).max(0.5);
    let time = speed / (2.0 * acc) + acc / (2.0 * jerk);
    Ned::new(
        view.position.n + view.velocity.n * time,
        view.position.e + view.velocity.e * time,
        view.position.d + view.velocity.d * 0.3,
    )
}

fn fly_to(target: Ned, view: &View<'_>) -> Guidance {
    match view.airframe {
        Airframe::Quad | Airframe::Vtol => Guidance::Leg(view.leg(target)),
        Airframe::Plane => loiter(target, view),
    }
}

/// The destination of a return in PX4 v1.18 (`RTL::findRtlDestination`), without a mission landing, which is not
/// simulated: the nearest of home and the rally points, as RTL_TYPE selects them. The first of two counts unless the
/// second is nearer by 2 m.
fn destination(rally: &[Item], view: &View<'_>) -> Ned {
    let rtl_type = view.params.int(Param::RTL_TYPE);
    if matches!(rtl_type, 2 | 4) {
        return view.home;
    }
    let away = |at: Ned| (at - view.position).horizontal();
    // RTL_TYPE 1 prefers any rally point to home, except for a VTOL that hovers.
    let hovers = view.vtol.is_some() && view.airframe != Airframe::Plane;
    let home_counts = rtl_type != 5 && (rtl_type != 1 || hovers);
    let mut nearest = if home_counts {
        away(view.home)
    } else {
        f64::INFINITY
    };
    // With RTL_TYPE 5 and no rally point it returns to where it is.
    let mut to = match rtl_type {
        5 => view.position,
        _ => view.home,
    };
    for item in rally.iter().filter(|item| item.command == RALLY_POINT) {
        let at = items::place(item, view);
        // A rally point this close to home counts as home.
        let near_home = (at - view.home).horizontal() <= 10.0 && rtl_type != 5;
        if !near_home && away(at) + 2.0 < nearest {
            (nearest, to) = (away(at), at);
        }
    }
    to
}

const RALLY_POINT: u16 = 5100;

/// The height (local down) of PX4's return: RTL_RETURN_ALT above the destination, lower close to it.
fn return_height(to: Ned, view: &View<'_>) -> f64 {
    let home = to.d;
    let highest = home - view.params.get(Param::RTL_RETURN_ALT);
    if view.airframe == Airframe::Plane || view.params.int(Param::RTL_CONE_ANG) <= 0 {
        return highest.min(view.position.d);
    }
    let distance = (to - view.position).horizontal();
    let near = view.acceptance();
    let height = if distance <= near {
        home - 2.0 * distance
    } else {
        let mut d = highest;
        if distance <= view.params.get(Param::RTL_MIN_DIST) {
            let half = f64::from(view.params.int(Param::RTL_CONE_ANG))
                .clamp(1.0, 89.0)
                .to_radians();
            d = d.max(home - distance / half.tan());
        }
        d.min(home - 2.0 * near)
    };
    // Never lower than the present height, and never higher than RTL_RETURN_ALT unless it already is.
    height.max(highest).min(view.position.d)
}

/// A course is flown toward a place this far ahead, m.
const AHEAD_M: f64 = 20_000.0;
/// A VTOL counts as turned toward its transition within this, rad: the default of MIS_YAW_ERR.
const ALIGNED_RAD: f64 = 0.21;
/// To leave an end of a figure eight, this share of the speed must point along its axis, and the vehicle may be this
/// far before the end's centre, m.
const STRAIGHT: f64 = 0.9;
const PAST_M: f64 = 5.0;
