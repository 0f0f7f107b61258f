//! Flying the mission: which item is current, where it leads, and when it is done.
//!
//! Items are flown in order of their index; DO_JUMP counts its repeats. Like PX4, it adopts a plan that is uploaded
//! in flight at once and at the same index; and on a multicopter nothing tests whether an item was passed without
//! being reached.

use mavlink_link::service::mission::{Item, plan_id};

use super::feasibility;
use super::items::{
    CHANGE_SPEED, DELAY, GIMBAL_CONFIGURE, GIMBAL_PITCHYAW, JUMP, LAND, LOITER_TIME, LOITER_TO_ALT,
    LOITER_UNLIM, RETURN_TO_LAUNCH, SET_ROI_LOCATION, SET_ROI_NONE, TAKEOFF, TRANSITION, VTOL_LAND,
    VTOL_TAKEOFF, acceptance, has_place, hold_time, loiter_radius, place, turn_switch_distance,
};
use super::view::{Note, View, loiter};
use crate::config::{Airframe, Param};
use crate::physics::motion::{Ned, wrap_pi};
use crate::physics::trajectory::{Circle, Guidance, Heading, Leg};
use crate::physics::vtol::BRAKE_M_S2;

/// The phase within an item.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
enum Work {
    /// Flying the item itself.
    #[default]
    Item,
    /// First climbing to this height (local down), over this place.
    Climb(Ned),
    /// First flying to above the landing point, at this height (local down).
    ToLand(f64),
    /// Descending.
    Landing,
}

/// The mission and its progress; the default is none.
#[derive(Debug, Clone, Default)]
pub(crate) struct Mission {
    items: Vec<Item>,
    id: u32,
    feasible: Option<String>,
    index: usize,
    jumps: Vec<u32>,
    finished: bool,
    activated: bool,
    running: bool,
    reached: Option<u16>,
    work: Work,
    from: Ned,
    reached_at: Option<f64>,
    speed: Option<f64>,
    hold: Option<Ned>,
    disarmed_inactive: bool,
    /// The place to which a multicopter points its nose.
    roi: Option<Ned>,
}

impl Mission {
    /// Number of items.
    pub(crate) fn count(&self) -> usize {
        self.items.len()
    }

    /// MISSION_CURRENT.seq.
    pub(crate) fn index(&self) -> usize {
        self.index
    }

    /// True when there is a mission that passed the checks.
    pub(crate) fn is_valid(&self) -> bool {
        !self.items.is_empty() && self.feasible.is_none()
    }

    /// The mission was flown to its end.
    pub(crate) fn is_finished(&self) -> bool {
        self.finished
    }

    /// The last item reached in this activation.
    pub(crate) fn reached(&self) -> Option<u16> {
        self.reached
    }

    /// MISSION_CURRENT also calls a take-off by command a finished mission.
    pub(crate) fn set_finished(&mut self, finished: bool) {
        self.finished = finished;
    }

    /// Sets the ground speed of DO_CHANGE_SPEED for the rest of the activation; `None` restores the default.
    pub(crate) fn set_speed(&mut self, speed: Option<f64>) {
        self.speed = speed;
    }

    /// A plan has been uploaded. While the mission is flown, another plan is flown at once from
    /// the same index, or from the item marked current; the same plan changes nothing.
    pub(crate) fn replace(
        &mut self,
        items: Vec<Item>,
        current: Option<usize>,
        active: bool,
        view: &View<'_>,
        notes: &mut Vec<Note>,
    ) {
        let id = plan_id(&items);
        let last = items.len().saturating_sub(1);
        let index = current.unwrap_or(self.index).min(last);
        let same = id == self.id && items.len() == self.items.len();
        if same && index == self.index {
            return;
        }
        self.items = items;
        self.id = id;
        self.index = index;
        self.reached = None;
        if !same {
            self.jumps = vec![0; self.items.len()];
            self.finished = false;
            self.check(view, notes);
        }
        if active {
            self.begin(view, notes);
        } else if !same {
            self.activated = false;
        }
    }

    /// MISSION_SET_CURRENT; nothing where there is no such item.
    pub(crate) fn select(
        &mut self,
        index: usize,
        active: bool,
        view: &View<'_>,
        notes: &mut Vec<Note>,
    ) {
        if index >= self.items.len() {
            return;
        }
        self.index = index;
        self.finished = false;
        if active {
            self.begin(view, notes);
        }
    }

    /// PX4's own checks; they need a home.
    pub(crate) fn check(&mut self, view: &View<'_>, notes: &mut Vec<Note>) {
        self.feasible = (!self.items.is_empty())
            .then(|| feasibility::fault(&self.items, view))
            .flatten();
        if let Some(text) = &self.feasible {
            notes.push(Note::Critical(format!("{text}\t")));
        }
    }

    /// The fence check has failed, so the plan is infeasible.
    pub(crate) fn reject(&mut self, text: String) -> Note {
        self.feasible = Some(text.clone());
        Note::Critical(text)
    }

    /// Where the current item leads.
    pub(crate) fn flown_to(&self, view: &View<'_>) -> Option<Ned> {
        self.place_from(self.index, view)
    }

    /// Items with a place, for the fence check: index and position.
    pub(crate) fn places<'a>(
        &'a self,
        view: &'a View<'_>,
    ) -> impl Iterator<Item = (usize, Ned)> + 'a {
        self.items
            .iter()
            .enumerate()
            .filter(|(_, item)| has_place(item))
            .map(|(i, item)| (i, place(item, view)))
    }

    /// The mode has been entered.
    pub(crate) fn activate(&mut self, view: &View<'_>, notes: &mut Vec<Note>) {
        // A mission at its last item starts again from the first one only if the vehicle has been disarmed since. If
        // the mode is entered again in the air, the mission continues where it was.
        if self.disarmed_inactive && self.activated && self.index + 1 >= self.items.len() {
            self.index = 0;
            self.jumps.fill(0);
        }
        // PX4 resets the speed and repeats the last one before the current item (mission_base.cpp,
        // `replayCachedSpeedChangeItems`); a jump within the mission keeps the present one.
        let mut before = self.items.iter().take(self.index).rev();
        let set = before.find(|item| item.command == CHANGE_SPEED);
        self.speed = set.and_then(commanded_speed);
        // And the last of these (`replayCachedGimbalItems`): the navigator has centred the gimbal since.
        for command in [GIMBAL_CONFIGURE, GIMBAL_PITCHYAW] {
            let mut before = self.items.iter().take(self.index).rev();
            let last = before.find(|item| item.command == command);
            notes.extend(last.copied().map(Note::Action));
        }
        self.activated = true;
        self.disarmed_inactive = false;
        self.finished = false;
        self.begin(view, notes);
    }

    /// The mode has been left.
    pub(crate) fn deactivate(&mut self) {
        self.running = false;
        self.work = Work::Item;
        self.hold = None;
    }

    /// Called while another mode is active.
    pub(crate) fn idle(&mut self, armed: bool) {
        if !armed {
            self.disarmed_inactive = true;
        }
    }

    fn begin(&mut self, view: &View<'_>, notes: &mut Vec<Note>) {
        self.reached_at = None;
        self.hold = None;
        self.reached = None;
        // PX4 resets it as well, although its gimbal continues to point there (mission_base.cpp, reset_vroi).
        self.roi = None;
        if !self.is_valid() {
            let then = if view.landed {
                "refusing takeoff"
            } else {
                "loitering"
            };
            notes.push(Note::Critical(format!(
                "No valid mission available, {then}\t"
            )));
            self.running = false;
            return;
        }
        if !self.running {
            notes.push(Note::Info("Executing Mission\t".into()));
        }
        self.running = true;
        self.from = view.position;
        self.start_item(view, notes, true);
    }

    /// Prepares the current item.
    fn start_item(&mut self, view: &View<'_>, notes: &mut Vec<Note>, activation: bool) {
        self.reached_at = None;
        self.work = Work::Item;
        let Some(item) = self.items.get(self.index).copied() else {
            return;
        };
        if !has_place(&item) && !activation {
            return;
        }
        // A multicopter below the item climbs on the spot before it flies there.
        if (activation || view.landed)
            && view.airframe == Airframe::Quad
            && has_place(&item)
            && let Some(next) = self.place_from(self.index, view)
            && view.position.d - next.d > view.altitude_acceptance()
        {
            let above_home = view.home.d - next.d;
            notes.push(Note::Info(format!(
                "Climb to {above_home:.1} meters above home\t"
            )));
            self.work = Work::Climb(Ned {
                d: next.d,
                ..view.position
            });
            return;
        }
        self.from = if activation { view.position } else { self.from };
        match (item.command, view.airframe) {
            // A plane glides down from where it is; a VTOL first flies to above the point on its wings.
            (LAND, Airframe::Plane) => {
                self.from = view.position;
                self.work = Work::Landing;
            }
            (VTOL_LAND, Airframe::Plane) => self.work = Work::Landing,
            (LAND | VTOL_LAND, _) => self.work = Work::ToLand(view.position.d),
            _ => {}
        }
    }

    /// One step while the mode is active.
    pub(crate) fn step(&mut self, view: &View<'_>, notes: &mut Vec<Note>) -> (Guidance, Heading) {
        if self.running {
            self.progress(view, notes);
        }
        self.guide(view)
    }

    fn progress(&mut self, view: &View<'_>, notes: &mut Vec<Note>) {
        // One item for each step, like one for each cycle of PX4's navigator.
        let Some(item) = self.items.get(self.index).copied() else {
            return;
        };
        match self.work {
            Work::Climb(top) => {
                let margin = view
                    .altitude_acceptance()
                    .min((view.home.d - top.d).max(0.0) / 2.0 + 1e-3);
                if !view.landed && view.position.d < top.d + margin {
                    self.from = view.position;
                    self.work = if matches!(item.command, LAND | VTOL_LAND) {
                        Work::ToLand(top.d)
                    } else {
                        Work::Item
                    };
                    self.reached_at = None;
                }
            }
            Work::ToLand(height) => {
                let over = Ned {
                    d: height,
                    ..place(&item, view)
                };
                if (over - view.position).horizontal() <= view.acceptance() {
                    self.work = Work::Landing;
                }
            }
            Work::Landing => {
                // A VTOL starts its back transition early enough to stop over the place.
                if view.vtol.is_some() && view.airframe == Airframe::Plane {
                    let speed = view.velocity.horizontal();
                    let stops = speed * speed / (2.0 * BRAKE_M_S2) + view.acceptance();
                    let off = place(&item, view) - view.position;
                    if off.horizontal() < stops {
                        notes.push(Note::Transition { to_wings: false });
                    }
                }
                if view.landed {
                    self.complete(view, notes);
                }
            }
            Work::Item => {
                if item.command == TRANSITION {
                    self.transit(&item, view, notes);
                }
                if self.item_done(&item, view) {
                    self.apply(&item, view, notes);
                    self.complete(view, notes);
                }
            }
        }
    }

    /// PX4 reports an item as reached unless the next one is done at once: then that one's report takes its place.
    fn report_reached(&self, next: Option<usize>, view: &View<'_>, notes: &mut Vec<Note>) {
        let next = next.and_then(|index| self.items.get(index));
        let overtaken = next.is_some_and(|item| match item.command {
            DELAY => false,
            TRANSITION => view.vtol.is_none() || self.item_is_flown(item, view),
            _ => !has_place(item),
        });
        if let Some(seq) = self.reached.filter(|_| !overtaken) {
            notes.push(Note::Reached(seq));
        }
    }

    fn complete(&mut self, view: &View<'_>, notes: &mut Vec<Note>) {
        self.reached = u16::try_from(self.index).ok();
        let Some(item) = self.items.get(self.index).copied() else {
            return;
        };
        if has_place(&item) {
            self.from = place(&item, view);
        }
        let next = if item.autocontinue {
            self.next_index(self.index + 1)
        } else {
            None
        };
        self.report_reached(next, view, notes);
        if !item.autocontinue {
            // PX4 stays where it is until MISSION_SET_CURRENT or another mode.
            self.hold = Some(view.position);
            return;
        }
        match next {
            Some(next) => {
                self.index = next;
                self.start_item(view, notes, false);
            }
            None => {
                let how = if view.landed { "landed" } else { "loitering" };
                notes.push(Note::Info(format!("Mission finished, {how}\t")));
                self.finished = true;
                self.running = false;
                self.hold = (!view.landed).then(|| {
                    if has_place(&item) {
                        self.from
                    } else {
                        view.position
                    }
                });
                if self.index + 1 == self.items.len() {
                    self.jumps.fill(0);
                }
            }
        }
    }

    fn item_done(&mut self, item: &Item, view: &View<'_>) -> bool {
        match item.command {
            LOITER_UNLIM => false,
            LAND | VTOL_LAND => view.landed,
            TRANSITION => {
                (view.airframe == Airframe::Plane) == to_wings(item) || view.vtol.is_none()
            }
            // A plane leaves its circle once it is at the altitude and on the tangent to the next place.
            LOITER_TO_ALT if view.airframe == Airframe::Plane && item.params[0] > 0.0 => {
                self.is_near(item, view) && self.heads_on(view)
            }
            DELAY => self.waited(f64::from(item.params[0]), view),
            _ if !has_place(item) => true,
            _ => {
                if view.landed {
                    return false;
                }
                if self.reached_at.is_none() && self.is_near(item, view) {
                    self.reached_at = Some(view.now);
                }
                self.reached_at
                    .is_some_and(|at| view.now - at >= hold_time(item))
            }
        }
    }

    fn transit(&self, item: &Item, view: &View<'_>, notes: &mut Vec<Note>) {
        if !view.landed && !self.item_is_flown(item, view) {
            notes.push(Note::Transition {
                to_wings: to_wings(item),
            });
        }
    }

    fn item_is_flown(&self, item: &Item, view: &View<'_>) -> bool {
        (view.airframe == Airframe::Plane) == to_wings(item)
    }

    /// Whether it flies toward the place after the current one.
    fn heads_on(&self, view: &View<'_>) -> bool {
        let Some(next) = self.place_from(self.index + 1, view) else {
            return true;
        };
        let off = wrap_pi((next - view.position).bearing() - view.velocity.bearing());
        off.abs() < TANGENT_RAD
    }

    /// DO_GO_AROUND: the place above the touch-down around which a plane then loiters; `None` where it does not
    /// glide.
    pub(crate) fn abort_landing(&mut self, view: &View<'_>) -> Option<Ned> {
        let item = self.items.get(self.index).copied()?;
        let glides = self.running && item.command == LAND && view.airframe == Airframe::Plane;
        let at = place(&item, view);
        let climb = view.params.get(Param::MIS_LND_ABRT_ALT);
        glides.then(|| Ned {
            d: (at.d - climb).min(view.position.d),
            ..at
        })
    }

    fn waited(&mut self, seconds: f64, view: &View<'_>) -> bool {
        let since = *self.reached_at.get_or_insert(view.now);
        view.now - since >= seconds
    }

    fn is_near(&self, item: &Item, view: &View<'_>) -> bool {
        let target = place(item, view);
        let off = target - view.position;
        if off.d.abs() > view.altitude_acceptance() {
            return false;
        }
        match view.airframe {
            Airframe::Quad | Airframe::Vtol => off.horizontal() <= acceptance(item, view),
            Airframe::Plane if matches!(item.command, LOITER_TIME | LOITER_TO_ALT) => {
                off.horizontal() <= view.acceptance() + loiter_radius(item, view).abs()
            }
            Airframe::Plane => {
                let leg = target - self.from;
                let beyond = view.position - target;
                let passed = leg.horizontal() > 1e-3 && leg.n * beyond.n + leg.e * beyond.e > 0.0;
                off.horizontal() <= turn_switch_distance(view) || passed
            }
        }
    }

    /// Carries out a command without a place.
    fn apply(&mut self, item: &Item, view: &View<'_>, notes: &mut Vec<Note>) {
        match item.command {
            SET_ROI_LOCATION => self.roi = Some(place(item, view)),
            SET_ROI_NONE => self.roi = None,
            _ => {}
        }
        match item.command {
            CHANGE_SPEED => {
                self.speed = commanded_speed(item);
            }
            RETURN_TO_LAUNCH => notes.push(Note::ReturnHome),
            _ if !has_place(item) => notes.push(Note::Action(*item)),
            _ => {}
        }
    }

    fn guide(&self, view: &View<'_>) -> (Guidance, Heading) {
        let speed = self.speed.unwrap_or_else(|| view.cruise());
        let acceptance = view.acceptance();
        if let Some(hold) = self.hold {
            return (loiter(hold, view), Heading::Hold);
        }
        let item = self.items.get(self.index).filter(|_| self.running);
        let Some(item) = item else {
            let here = if view.landed {
                Guidance::Ground
            } else {
                loiter(view.position, view)
            };
            return (here, Heading::Hold);
        };
        let yaw = f64::from(item.params[3]);
        let heading = if yaw.is_finite() && has_place(item) && item.command != TAKEOFF {
            Heading::To(yaw.to_radians())
        } else {
            // MIS_MNT_YAW_CTL is 0, so PX4 turns the nose (mission_base.cpp, heading_sp_update): for multicopters
            // only, and not during take-off and landing.
            match self.roi.filter(|_| view.airframe != Airframe::Plane) {
                Some(roi) if !matches!(item.command, TAKEOFF | VTOL_TAKEOFF | TRANSITION) => {
                    Heading::To((roi - view.position).bearing())
                }
                _ => Heading::Along,
            }
        };
        match self.work {
            Work::Climb(top) => {
                let leg = Leg::to(top, acceptance, speed);
                (
                    if view.landed || view.home.d - view.position.d < 10.0 {
                        Guidance::Climb(leg)
                    } else {
                        Guidance::Leg(leg)
                    },
                    Heading::Hold,
                )
            }
            Work::ToLand(height) => {
                let over = Ned {
                    d: height,
                    ..place(item, view)
                };
                (
                    Guidance::Leg(Leg {
                        from: self.from,
                        target: over,
                        next: over,
                        acceptance,
                        speed,
                    }),
                    heading,
                )
            }
            Work::Landing => (self.come_down(item, view, speed), Heading::Hold),
            Work::Item => (self.along(item, view, speed), heading),
        }
    }

    /// A plane descends along its glide, a VTOL flies level until it hovers, all others descend vertically.
    fn come_down(&self, item: &Item, view: &View<'_>, speed: f64) -> Guidance {
        let target = place(item, view);
        let leg = Leg::to(target, view.acceptance(), speed);
        match (view.airframe, item.command) {
            (Airframe::Plane, LAND) => Guidance::Land(Leg {
                from: self.from,
                ..leg
            }),
            (Airframe::Plane, _) => Guidance::Leg(Leg {
                from: self.from,
                ..Leg::to(
                    Ned {
                        d: self.from.d,
                        ..target
                    },
                    view.acceptance(),
                    speed,
                )
            }),
            // First to above the place: the back transition ends near it.
            (_, VTOL_LAND) if (target - view.position).horizontal() > OVER_M => {
                Guidance::Leg(Leg::to(
                    Ned {
                        d: view.position.d.min(-1.0),
                        ..target
                    },
                    view.acceptance(),
                    speed,
                ))
            }
            _ => Guidance::Land(leg),
        }
    }

    fn along(&self, item: &Item, view: &View<'_>, speed: f64) -> Guidance {
        // PX4 keeps its present place, and does not look ahead to the next.
        if item.command == DELAY {
            return loiter(self.from, view);
        }
        let Some(target) = self.place_from(self.index, view) else {
            return loiter(view.position, view);
        };
        let stays = matches!(item.command, LOITER_UNLIM | LOITER_TIME | LOITER_TO_ALT);
        if view.airframe == Airframe::Plane
            && (stays || self.reached_at.is_some() && hold_time(item) > 0.0)
        {
            return Guidance::Circle(Circle {
                centre: target,
                radius: loiter_radius(item, view),
                speed,
            });
        }
        let brakes = stays || !item.autocontinue || hold_time(item) > 0.0;
        let next = if brakes { None } else { self.place_after(view) };
        Guidance::Leg(Leg {
            from: self.from,
            target,
            next: next.unwrap_or(target),
            acceptance: acceptance(item, view),
            speed,
        })
    }

    /// The place of the first item at or after `index` that has one.
    fn place_from(&self, index: usize, view: &View<'_>) -> Option<Ned> {
        self.place_index(index).map(|i| place(&self.items[i], view))
    }

    fn place_after(&self, view: &View<'_>) -> Option<Ned> {
        let here = self.place_index(self.index)?;
        let next = self.place_index(here + 1)?;
        let target = place(&self.items[next], view);
        // PX4 flies to a landing point at the height at which it arrives.
        Some(if matches!(self.items[next].command, LAND | VTOL_LAND) {
            Ned {
                d: place(&self.items[here], view).d,
                ..target
            }
        } else {
            target
        })
    }

    /// The index after jumps, without counting them as taken.
    fn place_index(&self, mut index: usize) -> Option<usize> {
        for _ in 0..=self.items.len() {
            let item = self.items.get(index)?;
            if has_place(item) {
                return Some(index);
            }
            index = match self.jump_target(index) {
                Some(to) => to,
                None => index + 1,
            };
        }
        None
    }

    fn jump_target(&self, index: usize) -> Option<usize> {
        let item = self.items.get(index).filter(|i| i.command == JUMP)?;
        let repeats = item.params[1];
        let left = repeats < 0.0
            || f64::from(self.jumps.get(index).copied().unwrap_or(0)) < f64::from(repeats);
        let to = item.params[0];
        (left && to >= 0.0 && (to as usize) < self.items.len()).then_some(to as usize)
    }

    /// The index of the item with which to continue at `index`; jumps count as taken.
    fn next_index(&mut self, mut index: usize) -> Option<usize> {
        for _ in 0..=self.items.len() {
            let item = self.items.get(index)?;
            if item.command != JUMP {
                return Some(index);
            }
            index = match self.jump_target(index) {
                Some(to) => {
                    if let Some(count) = self.jumps.get_mut(index) {
                        *count = count.saturating_add(1);
                    }
                    to
                }
                None => index + 1,
            };
        }
        None
    }
}

/// DO_CHANGE_SPEED.param2; PX4 takes one that is not above 0 for its own speed.
fn commanded_speed(item: &Item) -> Option<f64> {
    let speed = f64::from(item.params[1]);
    (speed > 0.0).then_some(speed)
}

/// DO_VTOL_TRANSITION.param1: MAV_VTOL_STATE_FW; any other value is a hover.
fn to_wings(item: &Item) -> bool {
    item.params[0].round() as i64 == 4
}

/// A plane leaves its circle this close to the tangent, rad.
const TANGENT_RAD: f64 = 0.2;
/// A VTOL descends this close to the place, m.
const OVER_M: f64 = 2.0;
