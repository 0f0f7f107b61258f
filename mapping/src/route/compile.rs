//! Compiles a route waypoint by waypoint, in the order that they are flown.

use std::collections::BTreeMap;

use curve_paths::Position;
use curve_paths::flight::MIN_ACCEPTANCE_M;
use mavlink_link::service::mission::Item;
use stanag_msgs::enums::LoiterType;
use stanag_msgs::messages::{UaLoiterWaypoint, UaPositionWaypoint};

use super::clearance::{self, Slopes};
use super::error::{Reason, RouteError};
use super::item::{self, NAV_WAYPOINT, change_speed};
use super::mission::{CompiledMission, Leg};
use super::site::{Curving, Site};
use super::{brake, curve, loiter, stream, waypoint};
use crate::action::{Action, Transition};
use crate::altitude::{AltitudeError, Level};
use crate::limits::{Performance, metres};
use crate::payload::waypoint::{Pointing, camera_of};
use crate::plan::Plan;

/// Makes the mission of the route that starts at `initial`. Where it becomes too many items, repeated speeds are left out;
/// where its curves are still too many, they are flown within the smallest tolerance that the items allow. A note reports it.
///
/// The first waypoint, in flying order, that cannot be flown, and why. No partial mission is returned.
pub fn compile(plan: &Plan, initial: u16, site: &Site) -> Result<CompiledMission, RouteError> {
    let mut compiled = match compile_within(plan, initial, site) {
        Err(RouteError {
            waypoint,
            reason: Reason::TooManyItems(items),
        }) => within_items(plan, initial, site)?.ok_or(RouteError {
            waypoint,
            reason: Reason::TooManyItems(items),
        })?,
        other => other?,
    };
    if let Some(mut curved) = compiled.curved {
        curved.predicted_m = curve::flown_m(plan, &compiled, site);
        compiled.curved = Some(curved);
        let note = curved.note(site.curving.tolerance_m, site.limits.items);
        compiled.notes.push(note);
        if site.curving.streamed {
            if !site.hovers() {
                return Err(RouteError {
                    waypoint: initial,
                    reason: Reason::StreamOnWings,
                });
            }
            let (streamed, notes) = stream::runs(plan, &compiled, site);
            compiled.streamed = streamed;
            compiled.notes.extend(notes);
        }
    }
    Ok(compiled)
}

/// The mission, its curves within the tolerance of the site.
pub(crate) fn compile_within(
    plan: &Plan,
    initial: u16,
    site: &Site,
) -> Result<CompiledMission, RouteError> {
    // A curve that has lost an end would be left out without a word, and the leg flown straight.
    if let Some((p1, p4)) = plan.curve_without_end() {
        let (waypoint, reason) = match plan.waypoint(p1) {
            None => (p1, Reason::CurveWithoutEnd(p4)),
            Some(start) if start.next_waypoint == Some(p4) => (p4, Reason::CurveWithoutP4(p1)),
            Some(_) => (p4, Reason::CurveWithoutEnd(p1)),
        };
        return Err(RouteError { waypoint, reason });
    }
    let mut draft = Draft::new(plan, site);
    let mut next = initial;
    while next != 0 {
        next = draft.add(next)?;
    }
    let mut compiled = draft.finish().ok_or(RouteError {
        waypoint: initial,
        reason: Reason::Unknown,
    })?;
    compiled.fit(site.limits.items)?;
    Ok(compiled)
}

/// The mission with the smallest tolerance that its items allow; `None` where even the coarsest needs more.
///
/// # Errors
/// Anything but too many items: a coarser tolerance does not help with it.
fn within_items(
    plan: &Plan,
    initial: u16,
    site: &Site,
) -> Result<Option<CompiledMission>, RouteError> {
    let try_with = |tolerance_m| {
        let curving = Curving {
            tolerance_m,
            ..site.curving
        };
        match compile_within(plan, initial, &Site { curving, ..*site }) {
            Ok(compiled) => Ok(Some(compiled)),
            Err(RouteError {
                reason: Reason::TooManyItems(_),
                ..
            }) => Ok(None),
            Err(other) => Err(other),
        }
    };
    let mut low_m = site.curving.tolerance_m;
    let (mut best, mut high_m) = loop {
        // A straight route gains nothing, and a curve this coarse is not the one that was drawn.
        if low_m >= COARSEST_M {
            return Ok(None);
        }
        let tried_m = (2.0 * low_m).min(COARSEST_M);
        match try_with(tried_m)? {
            Some(compiled) => break (compiled, tried_m),
            None => low_m = tried_m,
        }
    };
    // Bisection on a logarithmic scale: the number of chords goes with the square root of the tolerance.
    while high_m > CLOSE * low_m {
        let tried_m = (low_m * high_m).sqrt();
        match try_with(tried_m)? {
            Some(compiled) => (best, high_m) = (compiled, tried_m),
            None => low_m = tried_m,
        }
    }
    Ok(Some(best))
}

/// The mission so far.
#[derive(Debug)]
struct Draft<'a> {
    plan: &'a Plan,
    site: &'a Site<'a>,
    compiled: CompiledMission,
    /// The commanded heights above the ground, m, by waypoint, and how many places have been sampled for them.
    heights: BTreeMap<u16, f64>,
    looked_at: usize,
    /// The items at the ends of curves.
    ends: Vec<usize>,
    /// The items of waypoints that end no curve.
    straight: Vec<usize>,
    /// For a VTOL, the vehicle while it hovers.
    hover: Option<Site<'a>>,
    /// A VTOL hovers from here on.
    hovers: bool,
    /// Whether it hovers along the leg to each waypoint.
    hovered: BTreeMap<u16, bool>,
}

impl<'a> Draft<'a> {
    fn new(plan: &'a Plan, site: &'a Site<'a>) -> Draft<'a> {
        Draft {
            plan,
            site,
            compiled: CompiledMission::default(),
            heights: BTreeMap::new(),
            looked_at: 0,
            ends: Vec::new(),
            straight: Vec::new(),
            hover: site.hovering(),
            hovers: false,
            hovered: BTreeMap::new(),
        }
    }

    /// The vehicle in the state in which it flies the leg that is being added.
    fn site(&self) -> &Site<'a> {
        let hover = self.hover.as_ref().filter(|_| self.hovers);
        hover.unwrap_or(self.site)
    }

    /// Adds the leg to a waypoint, and returns the number of the next one; 0 after the last.
    ///
    /// # Errors
    /// It, or the curved leg to it, cannot be flown.
    fn add(&mut self, number: u16) -> Result<u16, RouteError> {
        let at = |reason| RouteError {
            waypoint: number,
            reason,
        };
        let (plan, site) = (self.plan, *self.site());
        let site = &site;
        self.hovered.insert(number, self.hovers);
        let waypoint = plan.waypoint(number).ok_or_else(|| at(Reason::Unknown))?;
        // PX4 would fly an endless loop by DO_JUMP only, which a route asks for by Waypoint Type (0802.17).
        if self.compiled.order.iter().any(|leg| leg.number == number) {
            return Err(at(Reason::Loop));
        }
        let loiter = loiter::flown_at(plan, number);
        let leg = waypoint::leg(number, waypoint, loiter, site).map_err(at)?;
        let before = self.compiled.order.last().copied();
        distance(&leg, before.as_ref(), site).map_err(at)?;
        self.on_wings(&leg).map_err(at)?;
        let planned_m_s = leg.speed_m_s;
        let planned_m_s = planned_m_s.unwrap_or_else(|| self.compiled.speed_m_s(site));
        curve::check(plan, number, waypoint).map_err(at)?;
        let begun_at = self.compiled.items.len();
        // Before the speed: a sensor points where it must as soon as the leg begins.
        self.point(number, site).map_err(at)?;
        // Before the leg's own items: PX4 applies a speed to the leg it is on.
        if let Some(speed_m_s) = leg.speed_m_s {
            self.compiled
                .push(number, change_speed(speed_m_s, site.hovers()));
        }
        let height = waypoint::above_ground(waypoint, site);
        self.heights
            .extend(height.map(|height_m| (number, height_m)));
        let curve = match before {
            Some(p1) => {
                let over = self.heights_of(&p1, &leg);
                let mut ground = curve::Ground {
                    heights_m: over,
                    looked_at: &mut self.looked_at,
                };
                curve::fly(plan, (&p1, &leg), &mut self.compiled, &mut ground, site)?
            }
            None => None,
        };
        if let (None, Some(from)) = (&curve, before) {
            for point in self.over_ground(&from, &leg).map_err(at)? {
                let here = self.compiled.items.len();
                self.straight.extend(site.hovers().then_some(here));
                self.compiled.push(number, item::over(point));
            }
        }
        self.arrive(&leg, waypoint, curve.as_ref()).map_err(at)?;
        if let Some(chords) = &curve {
            self.end_curve(&leg, chords, begun_at, planned_m_s);
        }
        self.act(&leg, loiter).map_err(at)?;
        self.turn(&leg).map_err(at)?;
        self.compiled.order.push(leg);
        let next = self.lead_on(&leg, waypoint).map_err(at)?;
        // At most one item of each leg can be left out: more of the route would be compiled in vain.
        if self.compiled.items.len() - self.compiled.order.len() > site.limits.items {
            self.compiled.fit(site.limits.items)?;
        }
        Ok(next)
    }

    /// Adds what a payload station does from the leg to this waypoint on (13004). These items come before the leg's.
    ///
    /// # Errors
    /// The altitude of a place that is looked at has no usable reference.
    fn point(&mut self, number: u16, site: &Site<'_>) -> Result<(), Reason> {
        let Some(action) = self.plan.payload_action(number) else {
            return Ok(());
        };
        match action.pointing {
            Some(Pointing::Angles(direction)) => {
                for item in item::point_gimbal(direction) {
                    self.compiled.push(number, item);
                }
            }
            Some(Pointing::Place(at)) => {
                let level = site
                    .datum()
                    .level(at.altitude_m, at.altitude_type, [at.place]);
                let level = level.map_err(|fault| match fault {
                    // A missing geoid is reported within seconds, so the load waits for it.
                    AltitudeError::NoGeoid => Reason::Altitude(fault),
                    other => Reason::StarePoint(other),
                })?;
                self.compiled.push(number, item::take_gimbal());
                self.compiled.push(number, item::look_at(at.place, level));
                // MIS_MNT_YAW_CTL is 0 by default in PX4.
                if site.hovers() {
                    self.compiled.notes.push(format!(
                        "waypoint {number}: the vehicle turns its nose to its starepoint (13004) until another one or ROI OFF, \
                         unless MIS_MNT_YAW_CTL is 1"
                    ));
                }
            }
            None => {}
        }
        if let Some(thermal) = action.thermal {
            let camera = item::show_sensor(camera_of(action.station), thermal);
            self.compiled.push(number, camera);
        }
        Ok(())
    }

    /// Adds the actions at a waypoint, for after it is reached and its loiter is over.
    ///
    /// # Errors
    /// PX4 would never get there, or cannot do it with this airframe.
    fn act(&mut self, leg: &Leg, loiter: Option<&UaLoiterWaypoint>) -> Result<(), Reason> {
        let endless = loiter.is_some_and(|loiter| loiter.loiter_duration.is_none());
        let actions = self.plan.actions(leg.number);
        let actions = actions
            .iter()
            .filter(|one| !matches!(one, Action::Transition(_)));
        for action in actions {
            if endless {
                return Err(Reason::ActionAfterLoiter);
            }
            if matches!(action, Action::Delay(_)) && !self.site().hovers() {
                return Err(Reason::DelayOnWings);
            }
            for item in item::action(action) {
                self.compiled.push(leg.number, item);
            }
        }
        Ok(())
    }

    /// Adds the transition at a waypoint. A transition to the present state is left out: PX4 would skip it.
    ///
    /// # Errors
    /// It is no VTOL, or too low.
    fn turn(&mut self, leg: &Leg) -> Result<(), Reason> {
        let actions = self.plan.actions(leg.number);
        let transition = actions.iter().find_map(|action| match action {
            Action::Transition(transition) => Some(*transition),
            _ => None,
        });
        let Some(transition) = transition else {
            return Ok(());
        };
        let wings = self.site.wings.as_ref().ok_or(Reason::NoVtol)?;
        wings.check_transition(leg.level.above_home(self.site.home.amsl_m))?;
        let to_hover = transition == Transition::Hover;
        if to_hover != self.hovers {
            self.hovers = to_hover;
            self.compiled.push(leg.number, item::transition(to_hover));
            // PX4 may keep part of a speed commanded before the transition, and the limits change with it.
            let site = self.site();
            let cruise = change_speed(site.performance.cruise_m_s, site.hovers());
            self.compiled.push(leg.number, cruise);
        }
        Ok(())
    }

    /// Checks that wings can climb and turn to a waypoint from the ones before it. A curve to or from a waypoint is judged
    /// separately.
    ///
    /// # Errors
    /// They cannot.
    fn on_wings(&self, to: &Leg) -> Result<(), Reason> {
        let site = self.site();
        let (Some(wings), Some(from)) = (&site.wings, self.compiled.order.last()) else {
            return Ok(());
        };
        let speed_m_s = to
            .speed_m_s
            .unwrap_or_else(|| self.compiled.speed_m_s(site));
        let home_m = self.site.home.amsl_m;
        let climb_m = to.level.amsl(home_m) - from.level.amsl(home_m);
        wings.check_climb(climb_m, metres(from.place(), to.place()), speed_m_s)?;
        let [.., start, _] = self.compiled.order.as_slice() else {
            return Ok(());
        };
        let curved = |number: u16| self.plan.curves_from(number).next().is_some();
        // A vehicle leaves a loiter in any direction it needs; after a transition to wings PX4 first turns to the next
        // waypoint.
        let free = loiter::flown_at(self.plan, from.number).is_some()
            || self.hovered.get(&from.number) == Some(&true);
        if curved(start.number) || curved(from.number) || free {
            return Ok(());
        }
        let places = [start, from, to].map(Leg::place);
        wings.check_turn(from.number, places, speed_m_s)
    }

    /// The heights above the ground at which two waypoints are commanded, if both are.
    fn heights_of(&self, from: &Leg, to: &Leg) -> Option<(f64, f64)> {
        let of = |leg: &Leg| self.heights.get(&leg.number).copied();
        of(from).zip(of(to))
    }

    /// The points that a straight leg between two waypoints needs to keep its height above the ground; none if one of them
    /// is commanded at another kind of altitude.
    fn over_ground(&mut self, from: &Leg, to: &Leg) -> Result<Vec<Position>, Reason> {
        let site = *self.site();
        let (Some((from_m, to_m)), Some(terrain)) = (self.heights_of(from, to), site.terrain)
        else {
            return Ok(Vec::new());
        };
        let speed_m_s = to.speed_m_s;
        let speed_m_s = speed_m_s.unwrap_or_else(|| self.compiled.speed_m_s(&site));
        let slopes = site
            .wings
            .as_ref()
            .map(|wings| Slopes::of(wings, speed_m_s));
        let node = |leg: &Leg, height_m| Position::new(leg.latitude, leg.longitude, height_m);
        let nodes = [node(from, from_m), node(to, to_m)];
        let points = clearance::follow(&nodes, slopes, terrain, &mut self.looked_at)?;
        let inner = points.len().saturating_sub(1);
        let points: Vec<Position> = points.iter().map(|point| point.position).collect();
        let points = points.get(1..inner).unwrap_or_default().to_vec();
        let home_m = site.home.amsl_m;
        let level = |leg: &Leg| leg.level.amsl(home_m);
        let mut before = Position::new(from.latitude, from.longitude, level(from));
        let end = Position::new(to.latitude, to.longitude, level(to));
        for at in points.iter().chain(&[end]) {
            site.limits.check_height(Level::Amsl(at.alt_m), home_m)?;
            if let Some(wings) = &site.wings {
                let distance_m = before.ground().distance_m(at.ground());
                wings.check_climb(at.alt_m - before.alt_m, distance_m, speed_m_s)?;
            }
            before = *at;
        }
        Ok(points)
    }

    /// The items at the waypoint itself.
    fn arrive(
        &mut self,
        leg: &Leg,
        waypoint: &UaPositionWaypoint,
        curve: Option<&curve::Chords>,
    ) -> Result<(), Reason> {
        let number = leg.number;
        let loiter = loiter::flown_at(self.plan, number);
        let circles = |kind| kind == Some(LoiterType::Circular);
        let site = *self.site();
        if site.hovers() && loiter.is_some_and(|loiter| circles(loiter.waypoint_loiter_type)) {
            self.compiled.notes.push(format!(
                "waypoint {number}: a multicopter flies no circle in a route, it hovers there (13003)"
            ));
        }
        for mut item in waypoint::items(leg, waypoint, loiter, &site)? {
            let here = self.compiled.items.len();
            if let Some(chords) = curve {
                curve::accept(&mut item, chords);
                self.ends.extend(site.hovers().then_some(here));
            } else {
                self.straight.extend(site.hovers().then_some(here));
            }
            self.compiled.push(number, item);
        }
        Ok(())
    }

    /// Ends a curve whose items start at `begun_at`; `speed_m_s` is the requested speed.
    fn end_curve(&mut self, leg: &Leg, chords: &curve::Chords, begun_at: usize, speed_m_s: f64) {
        let site = *self.site();
        let compiled = &mut self.compiled;
        // P1 is a vertex of the curve too, so it gets the curve's acceptance radius.
        let before = compiled.items.iter_mut().take(begun_at).enumerate();
        if let Some((p1, item)) = before.filter(|(_, item)| item.is_flown_to()).last() {
            curve::accept(item, chords);
            self.ends.extend(site.hovers().then_some(p1));
        }
        // The curve was flown slower than requested: the speed after it is the requested one again.
        if chords.slowed {
            compiled.push(leg.number, change_speed(speed_m_s, site.hovers()));
        }
    }

    /// The number of the next waypoint; 0 after the last, and after the end of a loop, which jumps back.
    fn lead_on(&mut self, leg: &Leg, waypoint: &UaPositionWaypoint) -> Result<u16, Reason> {
        let next = crate::plan::next(waypoint);
        if !waypoint::ends_loop(waypoint)? {
            return Ok(next);
        }
        if let Some(jump) = waypoint::jump(leg.number, waypoint, &self.compiled)? {
            if let Some((to, _)) = self.plan.curves_from(leg.number).next() {
                return Err(Reason::CurveClosesLoop(to));
            }
            // The loop's start would be reached in the other state of a VTOL than on the first lap.
            if self.hovered.get(&next) != Some(&self.hovers) {
                return Err(Reason::TransitionInLoop(next));
            }
            self.jump_back(leg.number, jump);
        }
        let start = self.compiled.order.iter().find(|leg| leg.number == next);
        if let Some(start) = start.copied() {
            distance(&start, Some(leg), self.site)?;
            // The way back is a leg of its own, without items that could follow the ground.
            if !self.over_ground(leg, &start)?.is_empty() {
                return Err(Reason::GroundInLoop(next));
            }
        }
        Ok(0)
    }

    /// Adds the jump from the end of a loop. Each lap has the speeds of the first, for which the route is planned: PX4 would keep
    /// the speed of the last leg where the start sets none.
    fn jump_back(&mut self, number: u16, jump: Item) {
        let site = *self.site();
        let cruise_m_s = site.performance.cruise_m_s;
        let compiled = &mut self.compiled;
        let present_m_s = compiled.speed_before_m_s(compiled.items.len(), cruise_m_s);
        let planned_m_s = compiled.speed_of_jump(jump.params[0] as u16, cruise_m_s);
        // Compared as items hold them.
        let differs = |planned_m_s: &f64| *planned_m_s as f32 != present_m_s as f32;
        if let Some(planned_m_s) = planned_m_s.filter(differs) {
            compiled.push(number, change_speed(planned_m_s, site.hovers()));
        }
        compiled.push(number, jump);
    }

    /// The finished mission; `None` if nothing was added.
    fn finish(self) -> Option<CompiledMission> {
        let Draft {
            site,
            mut compiled,
            ends,
            mut straight,
            hover,
            ..
        } = self;
        // For a VTOL, these lists hold only items that it hovers to; for a fixed wing, nothing.
        let hover = hover.unwrap_or(*site);
        if hover.hovers() {
            let performance = &hover.performance;
            straight.retain(|at| !ends.contains(at));
            stop_where_missed(&mut compiled, &straight, performance);
            for end in ends {
                curve::widen(&mut compiled.items, end, performance);
            }
            note_own_radius(&mut compiled, &straight, performance);
        }
        // PX4 starts an uploaded mission at the item with `current`; without one it would keep the index of the mission
        // before.
        compiled.items.first_mut()?.current = true;
        Some(compiled)
    }
}

/// Makes PX4 stop at those of these items that it could miss for good, and adds a note.
fn stop_where_missed(
    compiled: &mut CompiledMission,
    straight: &[usize],
    performance: &Performance,
) {
    let braked = brake::where_height_changes(&mut compiled.items, straight, performance);
    // The first waypoint is braked for because of the way there, not because of the route.
    let leads_there = |at: usize| compiled.items.iter().take(at).any(Item::is_flown_to);
    let mut numbers: Vec<u16> = braked
        .into_iter()
        .filter(|at| leads_there(*at))
        .filter_map(|at| compiled.waypoint_of.get(at).copied())
        .collect();
    numbers.dedup();
    if !numbers.is_empty() {
        let numbers: Vec<String> = numbers.iter().map(u16::to_string).collect();
        compiled.notes.push(format!(
            "it climbs or descends fast or at small radii, to or from waypoint {}: the vehicle stops at each point \
             there, or it could miss one and fly on",
            numbers.join(", ")
        ));
    }
}

/// Adds a note where waypoints use the vehicle's own radius and that is too small for it.
fn note_own_radius(compiled: &mut CompiledMission, straight: &[usize], performance: &Performance) {
    let own_m = performance.acceptance_m;
    let mut items = straight.iter().filter_map(|at| compiled.items.get(*at));
    let own = items.any(|item| item.command == NAV_WAYPOINT && item.params[1] <= 0.0);
    if own && own_m < MIN_ACCEPTANCE_M {
        compiled.notes.push(format!(
            "NAV_ACC_RAD is {own_m:.1} m: under {} m the vehicle can miss a waypoint and fly on",
            MIN_ACCEPTANCE_M
        ));
    }
}

/// Checks that a leg is no longer than allowed: from the waypoint before, or from home for the first.
///
/// # Errors
/// It is longer.
fn distance(to: &Leg, from: Option<&Leg>, site: &Site) -> Result<(), Reason> {
    let (start, max_m) = match from {
        None => (
            (site.home.latitude, site.home.longitude),
            site.limits.first_m,
        ),
        Some(from) => (from.place(), site.limits.leg_m),
    };
    let distance_m = metres(start, to.place());
    match from {
        None if distance_m > max_m => {
            let (latitude, longitude) = to.place();
            Err(Reason::FarFromHome {
                distance_m,
                max_m,
                // Latitude and longitude exchanged are the usual mistake: if they fit, the error names that.
                swapped: metres(start, (longitude, latitude)) <= max_m,
            })
        }
        Some(_) if distance_m > max_m => Err(Reason::LongLeg { distance_m, max_m }),
        _ => Ok(()),
    }
}

/// The coarsest tolerance that a configuration may name, m.
const COARSEST_M: f64 = 100.0;
/// Relative width at which the smallest tolerance is known.
const CLOSE: f64 = 1.01;

#[cfg(test)]
mod tests {
    use stanag_msgs::enums::AltitudeType;
    use stanag_msgs::{Bam32, Id, Message, Scaled};

    use super::super::curves_become_chords::site;
    use super::*;

    /// What a full presence vector carries for nothing.
    #[test]
    fn a_speed_of_0_is_none_whatever_its_type() {
        use stanag_msgs::enums::WaypointSpeedType;
        let site = site();
        let compiled = |speed_m_s: f64, kind| {
            let mut plan = Plan::default();
            let waypoint = Message::UaPositionWaypoint(UaPositionWaypoint {
                waypoint_number: Some(1),
                waypoint_to_latitude_or_relative_y: Some(Bam32::from_degrees(
                    site.home.latitude + 1e-3,
                )),
                waypoint_to_longitude_or_relative_x: Some(Bam32::from_degrees(site.home.longitude)),
                waypoint_to_altitude: Scaled::from_si(30.0).ok(),
                waypoint_altitude_type: Some(AltitudeType::Agl),
                waypoint_to_speed: Scaled::from_si(speed_m_s).ok(),
                waypoint_speed_type: Some(kind),
                ..UaPositionWaypoint::default()
            });
            plan.store(&waypoint, Id(1), Id(2)).unwrap();
            compile_within(&plan, 1, &site).map(|compiled| compiled.order[0].speed_m_s)
        };
        let unknown = WaypointSpeedType::Unknown(9);
        for kind in [WaypointSpeedType::Indicated, unknown] {
            assert_eq!(compiled(0.0, kind).unwrap(), None);
        }
        let speed_m_s = compiled(5.0, WaypointSpeedType::Indicated).unwrap();
        assert_eq!(speed_m_s, Some(5.0));
        assert!(compiled(5.0, unknown).is_err());
    }

    #[test]
    fn a_route_ends_with_next_waypoint_0_and_with_no_other_number() {
        let site = site();
        let compiled = |last: Option<u16>| {
            let mut plan = Plan::default();
            for (number, next) in [(1, Some(2)), (2, last)] {
                let north = site.home.latitude + f64::from(number) * 1e-3;
                let waypoint = Message::UaPositionWaypoint(UaPositionWaypoint {
                    waypoint_number: Some(number),
                    waypoint_to_latitude_or_relative_y: Some(Bam32::from_degrees(north)),
                    waypoint_to_longitude_or_relative_x: Some(Bam32::from_degrees(
                        site.home.longitude,
                    )),
                    waypoint_to_altitude: Scaled::from_si(30.0).ok(),
                    waypoint_altitude_type: Some(AltitudeType::Agl),
                    next_waypoint: next,
                    ..UaPositionWaypoint::default()
                });
                plan.store(&waypoint, Id(1), Id(2)).unwrap();
            }
            compile_within(&plan, 1, &site)
        };
        for last in [None, Some(0)] {
            assert_eq!(compiled(last).unwrap().order.len(), 2);
        }
        for last in [3, u16::MAX] {
            let refused = compiled(Some(last)).unwrap_err();
            assert_eq!((refused.waypoint, refused.reason), (last, Reason::Unknown));
        }
    }
}
