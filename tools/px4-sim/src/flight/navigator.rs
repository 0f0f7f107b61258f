//! The modes in which the vehicle finds its own way: take-off, hold, mission, return, land, orbit.
//!
//! One step takes a view of the vehicle and returns where to go, where to look, and the mode that follows.

use crate::config::{Airframe, Param};
use crate::flight::mission::Mission;
use crate::flight::mode::Mode;
use crate::flight::view::{Note, View, loiter};
use crate::physics::motion::Ned;
use crate::physics::trajectory::{Circle, Guidance, Heading, Leg};

/// The target of DO_REPOSITION.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Reposition {
    /// Local target; a component that is NaN stays as it is.
    pub target: Ned,
    /// Heading, radians, NaN for toward the target.
    pub yaw: f64,
    /// Ground speed, m/s, where given.
    pub speed: Option<f64>,
    /// Loiter radius of a plane, m, where given; positive is clockwise.
    pub radius: Option<f64>,
}

impl Reposition {
    /// To this place, and nothing more.
    pub(crate) fn to(target: Ned) -> Self {
        Self {
            target,
            yaw: f64::NAN,
            speed: None,
            radius: None,
        }
    }
}

/// The result of a step.
#[derive(Debug)]
pub(crate) struct Step {
    /// Where to go.
    pub guidance: Guidance,
    /// Where to look.
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

/// The navigator; the default has nothing active and no mission.
#[derive(Debug, Clone, Default)]
pub(crate) struct Navigator {
    /// The mission and its progress.
    pub mission: Mission,
    active: Option<Mode>,
    hold: Ned,
    reposition: Option<Reposition>,
    takeoff_altitude: Option<f64>,
    takeoff_target: Ned,
    homeward: Return,
    orbit: Option<Circle>,
    speed: Option<f64>,
}

impl Navigator {
    /// NAV_TAKEOFF's altitude, AMSL; none is MIS_TAKEOFF_ALT above here.
    pub(crate) fn set_takeoff_altitude(&mut self, amsl: Option<f64>) {
        self.takeoff_altitude = amsl;
    }

    /// DO_REPOSITION.
    pub(crate) fn set_reposition(&mut self, reposition: Reposition, view: &View<'_>) {
        self.reposition = Some(reposition);
        if self.active == Some(Mode::Loiter) {
            self.apply_reposition(view);
        }
    }

    /// DO_ORBIT.
    pub(crate) fn set_orbit(&mut self, orbit: Circle) {
        self.orbit = Some(orbit);
    }

    /// The orbit that is flown.
    pub(crate) fn orbit(&self) -> Option<Circle> {
        self.orbit
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
                    // As observed: a mission that ends in the air leaves PX4 in AUTO.LOITER, and so does one that is cleared.
                    then = Some(Mode::Loiter);
                }
                flown
            }
            Mode::Takeoff => self.take_off(view, &mut then),
            Mode::Rtl => self.return_home(view, notes),
            Mode::Land => (self.land(self.hold, view), Heading::Hold),
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
        match mode {
            Mode::Mission => self.mission.activate(view, notes),
            Mode::Loiter => {
                self.speed = None;
                self.apply_reposition(view);
            }
            Mode::Takeoff => self.prepare_takeoff(view, notes),
            Mode::Rtl => self.prepare_return(view, notes),
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

    fn stay(&self, view: &View<'_>) -> (Guidance, Heading) {
        let mut guidance = loiter(self.hold, view);
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
        let heading = match self.reposition {
            Some(reposition) if reposition.yaw.is_finite() => Heading::To(reposition.yaw),
            Some(_) => Heading::Along,
            None => Heading::Hold,
        };
        (guidance, heading)
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
        // A plane cannot climb on the spot: it takes off toward a point ahead.
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
        // Half the height, for take-offs lower than the acceptance: they would be finished on the ground.
        let margin = match view.airframe {
            Airframe::Quad => view.altitude_acceptance().min((height / 2.0).max(0.1)),
            Airframe::Plane => 0.0,
        };
        if !view.landed && to_go < margin {
            self.mission.set_finished(true);
            *then = Some(Mode::Loiter);
        }
        (
            Guidance::Climb(view.leg(self.takeoff_target)),
            Heading::Hold,
        )
    }

    fn prepare_return(&mut self, view: &View<'_>, notes: &mut Vec<Note>) {
        if view.landed {
            self.homeward = Return::Land;
            return;
        }
        let d = return_height(view);
        let amsl = view.frame.origin().altitude_m - d;
        let above = view.home.d - d;
        notes.push(Note::Info(format!(
            "RTL: start return at {amsl:.0} m ({above:.0} m above destination)\t"
        )));
        self.homeward = Return::Climb(d);
    }

    fn return_home(&mut self, view: &View<'_>, notes: &mut Vec<Note>) -> (Guidance, Heading) {
        let descend = view.home.d - view.params.get(Param::RTL_DESCEND_ALT);
        match self.homeward {
            Return::Climb(d) => {
                if view.position.d - d < view.altitude_acceptance() {
                    self.homeward = Return::Back(d);
                    self.hold = view.position;
                }
                (fly_to(Ned { d, ..self.hold }, view), Heading::Hold)
            }
            Return::Back(d) => {
                let over = Ned { d, ..view.home };
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
                let over = Ned { d, ..view.home };
                let off = over - view.position;
                let near = match view.airframe {
                    Airframe::Quad => off.horizontal() < 1.0,
                    Airframe::Plane => true,
                };
                if near && view.position.d > d - view.altitude_acceptance() {
                    notes.push(Note::Info("RTL: land at destination\t".into()));
                    self.homeward = Return::Land;
                }
                (loiter(over, view), Heading::Hold)
            }
            Return::Land => (self.land(view.home, view), Heading::Hold),
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

    fn fly_orbit(&self, view: &View<'_>) -> (Guidance, Heading) {
        match self.orbit.filter(|_| !view.landed) {
            Some(orbit) => (Guidance::Circle(orbit), Heading::Along),
            None => self.stay(view),
        }
    }
}

/// Where the vehicle comes to rest if it brakes now.
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
        Airframe::Quad => Guidance::Leg(view.leg(target)),
        Airframe::Plane => loiter(target, view),
    }
}

/// The height (local down) at which PX4 returns: RTL_RETURN_ALT above home, lower close to it.
fn return_height(view: &View<'_>) -> f64 {
    let home = view.home.d;
    let highest = home - view.params.get(Param::RTL_RETURN_ALT);
    if view.airframe == Airframe::Plane || view.params.int(Param::RTL_CONE_ANG) <= 0 {
        return highest.min(view.position.d);
    }
    let distance = (view.home - view.position).horizontal();
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
    // Never lower than now, never higher than RTL_RETURN_ALT unless it is already.
    height.max(highest).min(view.position.d)
}
