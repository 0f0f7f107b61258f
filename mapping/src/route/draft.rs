//! A mission while it is compiled, waypoint by waypoint in the order that they are flown.

use mavlink_link::service::mission::Item;
use stanag_msgs::enums::LoiterType;
use stanag_msgs::messages::UaPositionWaypoint;

use super::item::{NAV_WAYPOINT, change_speed};
use super::{CompiledMission, Leg, Reason, RouteError, Site, bounds, curved_leg, waypoint};
use crate::curve::{Chords, MIN_ACCEPTANCE_M};
use crate::performance::Performance;
use crate::plan::Plan;
use crate::{brake, loops};

/// What has been made so far.
#[derive(Debug)]
pub(super) struct Draft<'a> {
    plan: &'a Plan,
    site: &'a Site,
    compiled: CompiledMission,
    /// The items at the ends of curves.
    ends: Vec<usize>,
    /// The items of waypoints that end no curve.
    straight: Vec<usize>,
}

impl<'a> Draft<'a> {
    pub(super) fn new(plan: &'a Plan, site: &'a Site) -> Draft<'a> {
        Draft {
            plan,
            site,
            compiled: CompiledMission {
                items: Vec::new(),
                waypoint_of: Vec::new(),
                order: Vec::new(),
                curved: None,
                notes: Vec::new(),
            },
            ends: Vec::new(),
            straight: Vec::new(),
        }
    }

    /// Adds the leg to a waypoint, and gives the number of the one that follows; 0 after the last.
    ///
    /// # Errors
    /// It, or the curved leg to it, cannot be flown.
    pub(super) fn add(&mut self, number: u16) -> Result<u16, RouteError> {
        let at = |reason| RouteError {
            waypoint: number,
            reason,
        };
        let (plan, site) = (self.plan, self.site);
        let waypoint = plan.waypoint(number).ok_or_else(|| at(Reason::Unknown))?;
        if self.compiled.order.iter().any(|leg| leg.number == number) {
            return Err(at(Reason::Loop));
        }
        let leg = waypoint::leg(number, waypoint, site).map_err(at)?;
        let before = self.compiled.order.last().copied();
        bounds::distance(&leg, before.as_ref(), site).map_err(at)?;
        curved_leg::check(plan, number, waypoint).map_err(at)?;
        let begun_at = self.compiled.items.len();
        if let Some(speed_m_s) = leg.speed_m_s {
            self.compiled.push(number, change_speed(speed_m_s));
        }
        let curve = match before {
            Some(p1) => curved_leg::fly(plan, &p1, &leg, &mut self.compiled, site)?,
            None => None,
        };
        self.arrive(&leg, waypoint, curve.as_ref()).map_err(at)?;
        if let Some(chords) = &curve {
            self.end_curve(&leg, chords, begun_at);
        }
        self.compiled.order.push(leg);
        let next = self.lead_on(&leg, waypoint).map_err(at)?;
        if self.compiled.items.len() > site.limits.items {
            return Err(at(Reason::TooManyItems(site.limits.items)));
        }
        Ok(next)
    }

    /// The items at the waypoint itself.
    fn arrive(
        &mut self,
        leg: &Leg,
        waypoint: &UaPositionWaypoint,
        curve: Option<&Chords>,
    ) -> Result<(), Reason> {
        let number = leg.number;
        let loiter = self.plan.loiter(number);
        let circles = |kind| kind == Some(LoiterType::Circular);
        if self.site.hovers && loiter.is_some_and(|loiter| circles(loiter.waypoint_loiter_type)) {
            self.compiled.notes.push(format!(
                "waypoint {number}: a multicopter flies no circle in a route, it hovers there (13003)"
            ));
        }
        for mut item in waypoint::items(leg, waypoint, loiter, self.site)? {
            let here = self.compiled.items.len();
            if let Some(chords) = curve {
                curved_leg::accept(&mut item, chords);
                self.ends.push(here);
            } else {
                self.straight.push(here);
            }
            self.compiled.push(number, item);
        }
        Ok(())
    }

    /// Ends a curve whose items start at `begun_at`.
    fn end_curve(&mut self, leg: &Leg, chords: &Chords, begun_at: usize) {
        let compiled = &mut self.compiled;
        // P1 is a vertex of the curve too.
        let before = compiled.items.iter_mut().take(begun_at).enumerate();
        if let Some((p1, item)) = before.filter(|(_, item)| item.is_global()).last() {
            curved_leg::accept(item, chords);
            self.ends.push(p1);
        }
        if chords.slowed {
            let wished_m_s = leg
                .speed_m_s
                .unwrap_or_else(|| compiled.speed_m_s(self.site));
            compiled.push(leg.number, change_speed(wished_m_s));
        }
    }

    /// The number of the waypoint that follows; 0 after the last, and after the end of a loop, which jumps back.
    fn lead_on(&mut self, leg: &Leg, waypoint: &UaPositionWaypoint) -> Result<u16, Reason> {
        let next = waypoint.next_waypoint.unwrap_or(0);
        if !loops::ends(waypoint)? {
            return Ok(next);
        }
        if let Some(jump) = loops::jump(leg.number, waypoint, &self.compiled)? {
            if let Some((to, _)) = self.plan.curves_from(leg.number).next() {
                return Err(Reason::CurveClosesLoop(to));
            }
            self.compiled.push(leg.number, jump);
        }
        if let Some(start) = self.compiled.order.iter().find(|leg| leg.number == next) {
            bounds::distance(start, Some(leg), self.site)?;
        }
        Ok(0)
    }

    /// The whole of it; none where nothing has been added.
    pub(super) fn finish(self) -> Option<CompiledMission> {
        let Draft {
            site,
            mut compiled,
            ends,
            mut straight,
            ..
        } = self;
        if site.hovers {
            straight.retain(|at| !ends.contains(at));
            stop_where_missed(&mut compiled, &straight, &site.performance);
            for end in ends {
                curved_leg::widen(&mut compiled.items, end, &site.performance);
            }
            say_own_radius(&mut compiled, &straight, &site.performance);
        }
        compiled.items.first_mut()?.current = true;
        Some(compiled)
    }
}

/// Makes PX4 stop at those of these items that it could miss for good, and says so.
fn stop_where_missed(
    compiled: &mut CompiledMission,
    straight: &[usize],
    performance: &Performance,
) {
    let braked = brake::where_height_changes(&mut compiled.items, straight, performance);
    // The first waypoint is not braked for because of what the route does there.
    let leads_there = |at: usize| compiled.items.iter().take(at).any(Item::is_global);
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

/// Says where waypoints are taken within the vehicle's own radius, and that is too small for it.
fn say_own_radius(compiled: &mut CompiledMission, straight: &[usize], performance: &Performance) {
    let own_m = performance.acceptance_m;
    let mut items = straight.iter().filter_map(|at| compiled.items.get(*at));
    let own = items.any(|item| item.command == NAV_WAYPOINT && item.params[1] <= 0.0);
    if own && own_m < MIN_ACCEPTANCE_M {
        compiled.notes.push(format!(
            "NAV_ACC_RAD is {own_m:.1} m: under {MIN_ACCEPTANCE_M} m the vehicle can miss a waypoint and fly on"
        ));
    }
}
