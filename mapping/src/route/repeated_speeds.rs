//! Speeds that a route repeats, left out where it has more items than the vehicle stores.
//!
//! A route that fits sets the speed of each leg that names one (13002.09). Where it does not fit, each item is left out that
//! sets the speed which is in force already. Such an item does two things more, which the bridge then does in its place:
//!
//! - It ends a speed that a 2016 commanded on an earlier leg. A 2016 is refused where its speed could last over such a leg
//!   ([`CompiledMission::speed_left_out_after`]).
//! - It sets the speed after a jump. PX4 v1.18 repeats the last speed before the current item when AUTO.MISSION is entered
//!   (mission_base.cpp, `replayCachedSpeedChangeItems`), but not on MISSION_SET_CURRENT within it, so the bridge sends the speed
//!   with the jump, as that of each leg without a speed of its own ([`CompiledMission::speed_of_jump`]).

use std::collections::BTreeSet;

use mavlink_link::service::mission::Item;

use super::error::{Reason, RouteError};
use super::item::{DO_CHANGE_SPEED, DO_JUMP, DO_LAND_START, DO_VTOL_TRANSITION};
use super::mission::{CompiledMission, touches_down};

impl CompiledMission {
    /// The first waypoint flown after a leg, an index of `order`, whose speed no item sets.
    ///
    /// Also one behind the route's next speed: a speed that is commanded on this leg may reach the vehicle behind that, after
    /// retries.
    #[must_use]
    pub fn speed_left_out_after(&self, leg: usize) -> Option<u16> {
        let runs = self.runs().filter(|(_, items)| sets_no_speed(items));
        let unset: BTreeSet<u16> = runs.map(|(number, _)| number).collect();
        // A loop leads back to legs that were flown before.
        let from = self
            .circuit()
            .map_or(leg + 1, |(_, start, _)| start.min(leg + 1));
        let mut after = self.order.iter().skip(from);
        after
            .find(|leg| leg.speed_m_s.is_some() && unset.contains(&leg.number))
            .map(|leg| leg.number)
    }

    /// Leaves out repeated speeds if there are more items than `limit`, and adds a note.
    ///
    /// # Errors
    /// Even then there are more: the waypoint of the first item beyond the limit.
    pub(super) fn fit(&mut self, limit: usize) -> Result<(), RouteError> {
        if self.items.len() <= limit {
            return Ok(());
        }
        let repeated = self.repeated_speeds();
        for item in &mut self.items {
            // A jump names an item by its index.
            if item.command == DO_JUMP {
                let to = item.params[0] as usize;
                item.params[0] -= repeated.partition_point(|at| *at < to) as f32;
            }
        }
        for at in repeated.iter().rev() {
            self.items.remove(*at);
            self.waypoint_of.remove(*at);
        }
        if let Some(waypoint) = self.waypoint_of.get(limit).copied() {
            return Err(RouteError {
                waypoint,
                reason: Reason::TooManyItems(limit),
            });
        }
        self.notes.push(format!(
            "{} speeds that repeat the one before are left out, so that the route fits {limit} items: a Commanded Speed (2016) that \
             could last over a leg without its own is refused",
            repeated.len()
        ));
        Ok(())
    }

    /// The items that set the speed which is in force already, rising.
    ///
    /// Only those of plain legs that follow plain legs: one place, at most one speed, and no jump or transition, with which PX4
    /// may have another speed than the items before name. The start of a loop is reached from its end too.
    fn repeated_speeds(&self) -> Vec<usize> {
        let jumps = self.items.iter().filter(|item| item.command == DO_JUMP);
        let starts: BTreeSet<usize> = jumps.map(|item| item.params[0] as usize).collect();
        let mut repeated = Vec::new();
        let mut in_force = None;
        let mut begun_at = 0;
        for (_, items) in self.runs() {
            let leg = begun_at..begun_at + items.len();
            begun_at = leg.end;
            if starts.range(leg.clone()).next().is_some() {
                in_force = None;
            }
            let places = items.iter().filter(|item| item.is_flown_to()).count();
            let set = |item: &&Item| item.command == DO_CHANGE_SPEED;
            let speeds = items.iter().filter(set).count();
            let turns = [DO_JUMP, DO_LAND_START, DO_VTOL_TRANSITION];
            if places != 1 || speeds > 1 || items.iter().any(|item| turns.contains(&item.command)) {
                in_force = None;
                continue;
            }
            let Some((at, speed)) = leg.zip(items).find(|(_, item)| set(item)) else {
                continue;
            };
            // The first item of a route has another flag.
            let speed = Item {
                current: false,
                ..*speed
            };
            if in_force == Some(speed) {
                repeated.push(at);
            }
            in_force = Some(speed);
        }
        repeated
    }

    /// The items of each leg, with its waypoint.
    fn runs(&self) -> impl Iterator<Item = (u16, &[Item])> {
        let mut rest = self.items.as_slice();
        let runs = self.waypoint_of.chunk_by(|one, next| one == next);
        runs.map_while(move |run| {
            let (items, after) = rest.split_at_checked(run.len())?;
            rest = after;
            Some((*run.first()?, items))
        })
    }
}

/// Whether the place of a leg is reached without a speed of its own. The touch-down of an approach route is none: it takes the
/// place of its leg's items.
fn sets_no_speed(items: &[Item]) -> bool {
    let mut items = items.iter();
    let first = items.find(|item| item.is_flown_to() || item.command == DO_CHANGE_SPEED);
    first.is_some_and(|item| item.command != DO_CHANGE_SPEED && !touches_down(item))
}

#[cfg(test)]
mod tests {
    use stanag_msgs::enums::{AltitudeType, LimitType, WaypointType};
    use stanag_msgs::messages::{CurveSegment, UaPositionWaypoint};
    use stanag_msgs::{Bam32, Id, Scaled};

    use super::super::compile;
    use super::super::curves_become_chords::site;
    use super::super::item::{NAV_WAYPOINT, change_speed, placed, transition};
    use super::*;
    use crate::altitude::Level;
    use crate::plan::Plan;

    const CUCS: Id = Id(0x1b00_00a0);
    const VEHICLE: Id = Id(0x1b00_0101);

    /// Waypoints from 1 on, 100 m apart to the north, with these speeds, changed by `change`.
    fn plan(speeds_m_s: &[f64], change: impl Fn(&mut UaPositionWaypoint)) -> Plan {
        let mut plan = Plan::default();
        for (number, speed_m_s) in (1_u16..).zip(speeds_m_s) {
            let is_last = usize::from(number) == speeds_m_s.len();
            let north = 47.3977 + 0.0009 * f64::from(number);
            let mut waypoint = UaPositionWaypoint {
                waypoint_number: Some(number),
                waypoint_to_latitude_or_relative_y: Some(Bam32::from_degrees(north)),
                waypoint_to_longitude_or_relative_x: Some(Bam32::from_degrees(8.5456)),
                waypoint_to_altitude: Scaled::from_si(30.0).ok(),
                waypoint_altitude_type: Some(AltitudeType::Agl),
                waypoint_to_speed: Scaled::from_si(*speed_m_s).ok(),
                next_waypoint: Some(if is_last { 0 } else { number + 1 }),
                ..UaPositionWaypoint::default()
            };
            change(&mut waypoint);
            plan.store(&waypoint.into(), CUCS, VEHICLE).expect("stored");
        }
        plan
    }

    fn within(items: usize, plan: &Plan) -> Result<CompiledMission, RouteError> {
        let mut site = site();
        site.limits.items = items;
        compile(plan, 1, &site)
    }

    /// The waypoints of the items that set a speed.
    fn set_at(compiled: &CompiledMission) -> Vec<u16> {
        let items = compiled.items.iter().zip(&compiled.waypoint_of);
        items
            .filter(|(item, _)| item.command == DO_CHANGE_SPEED)
            .map(|(_, number)| *number)
            .collect()
    }

    /// The speed that a jump to each leg must bring along.
    fn of_jumps(compiled: &CompiledMission) -> Vec<Option<f64>> {
        let legs = compiled.order.iter();
        let items = legs.map(|leg| compiled.first_item_of(leg.number).expect("an item"));
        items
            .map(|item| compiled.speed_of_jump(item, 3.0))
            .collect()
    }

    #[test]
    fn a_route_of_251_waypoints_with_one_speed_fits_into_500_items() {
        let compiled = within(500, &plan(&[5.0; 251], |_| {})).expect("it fits");
        assert_eq!((compiled.items.len(), set_at(&compiled)), (252, vec![1]));
        assert!(compiled.items[0].current);
        assert_eq!(compiled.items[0].command, DO_CHANGE_SPEED);
        assert_eq!(of_jumps(&compiled)[..2], [None, Some(5.0)]);
        let [note] = compiled.notes.as_slice() else {
            panic!("{:?}", compiled.notes)
        };
        assert!(note.starts_with("250 speeds that repeat the one before are left out"));
    }

    #[test]
    fn a_route_whose_speeds_change_at_each_waypoint_is_refused_as_before() {
        let changing: Vec<f64> = [5.0, 6.0].into_iter().cycle().take(600).collect();
        for waypoints in [251, 600] {
            let fault = within(500, &plan(&changing[..waypoints], |_| {})).expect_err("too many");
            assert_eq!(
                fault.to_string(),
                "waypoint 251: the route needs more than 500 items"
            );
        }
    }

    #[test]
    fn a_route_that_fits_sets_the_speed_of_each_leg() {
        let compiled = within(500, &plan(&[5.0; 250], |_| {})).expect("it fits");
        assert_eq!(set_at(&compiled), (1..=250).collect::<Vec<u16>>());
        assert_eq!(compiled.items.len(), 500);
        assert_eq!(of_jumps(&compiled), [None; 250]);
        assert_eq!(compiled.speed_left_out_after(0), None);
        assert!(compiled.notes.is_empty(), "{:?}", compiled.notes);
    }

    #[test]
    fn a_speed_is_set_where_it_changes() {
        let sections = plan(&[5.0, 5.0, 5.0, 6.0, 6.0, 5.0], |_| {});
        let compiled = within(9, &sections).expect("it fits");
        assert_eq!(set_at(&compiled), [1, 4, 6]);
        let [slow, fast] = [Some(5.0), Some(6.0)];
        assert_eq!(of_jumps(&compiled), [None, slow, slow, None, fast, None]);
        let after = [0, 2, 3, 4, 5].map(|leg| compiled.speed_left_out_after(leg));
        assert_eq!(after, [Some(2), Some(5), Some(5), None, None]);
        let fault = within(8, &sections).expect_err("9 items remain");
        assert_eq!((fault.waypoint, fault.reason), (6, Reason::TooManyItems(8)));
    }

    #[test]
    fn the_start_of_a_loop_keeps_its_speed_and_is_found_by_the_jump() {
        let lap = plan(&[5.0; 6], |waypoint| {
            if waypoint.waypoint_number == Some(6) {
                waypoint.waypoint_type = Some(WaypointType::EndOfLoop);
                waypoint.next_waypoint = Some(3);
                waypoint.limit_type = Some(LimitType::Count);
                waypoint.loop_limit = Some(3);
            }
        });
        let compiled = within(12, &lap).expect("it fits");
        assert_eq!(
            (compiled.items.len(), set_at(&compiled)),
            (10, vec![1, 3, 6])
        );
        let jump = compiled.items[9];
        assert_eq!((jump.command, jump.params[0]), (DO_JUMP, 3.0));
        assert_eq!(compiled.first_item_of(3), Some(3));
        assert_eq!(compiled.items[3].command, DO_CHANGE_SPEED);
        // On the next lap waypoint 4 follows the end.
        assert_eq!(compiled.speed_left_out_after(5), Some(4));
    }

    #[test]
    fn each_lap_has_the_speeds_of_the_first() {
        // Of each leg, and where the loop starts; 0 is none.
        let lap = |speeds_m_s: &[f64], start: u16| {
            plan(speeds_m_s, |waypoint| {
                if waypoint
                    .waypoint_to_speed
                    .is_some_and(|speed| speed.si() == 0.0)
                {
                    waypoint.waypoint_to_speed = None;
                }
                if waypoint.next_waypoint == Some(0) {
                    waypoint.waypoint_type = Some(WaypointType::EndOfLoop);
                    waypoint.next_waypoint = Some(start);
                    waypoint.limit_type = Some(LimitType::Count);
                    waypoint.loop_limit = Some(3);
                }
            })
        };
        let cruise_m_s = site().performance.cruise_m_s;
        let before_the_jump = |plan: &Plan| {
            let compiled = within(500, plan).expect("it fits");
            let [.., before, jump] = compiled.items.as_slice() else {
                panic!("{:?}", compiled.items)
            };
            assert_eq!(jump.command, DO_JUMP);
            assert!(compiled.circuit().is_some());
            (before.command == DO_CHANGE_SPEED).then(|| f64::from(before.params[1]))
        };
        let cases: [(&[f64], u16, Option<f64>); 5] = [
            // The speed in force before the start is the vehicle's own, or that of a leg before it.
            (&[0.0, 0.0, 12.0], 1, Some(cruise_m_s)),
            (&[7.0, 0.0, 0.0, 12.0], 2, Some(7.0)),
            // The start sets its own speed, or no leg has another one.
            (&[6.0, 0.0, 12.0], 1, None),
            (&[7.0, 0.0, 0.0, 0.0], 2, None),
            (&[0.0; 3], 1, None),
        ];
        for (speeds_m_s, start, expected) in cases {
            let found = before_the_jump(&lap(speeds_m_s, start));
            assert_eq!(found, expected, "{speeds_m_s:?} from {start}");
        }
        // It is an item too, and is never left out.
        let long = lap(&[5.0, 0.0, 12.0, 12.0, 12.0], 2);
        let fitted = within(10, &long).expect("it fits");
        assert_eq!(fitted.items[8], change_speed(5.0, true));
        assert_eq!(fitted.items[9].params[0], 2.0);
        let fault = within(9, &long).expect_err("10 items remain");
        assert_eq!(fault.reason, Reason::TooManyItems(9));
    }

    #[test]
    fn a_jump_brings_the_speed_along_that_no_item_sets() {
        let route = plan(&[0.0, 0.0, 12.0, 0.0], |waypoint| {
            if waypoint
                .waypoint_to_speed
                .is_some_and(|speed| speed.si() == 0.0)
            {
                waypoint.waypoint_to_speed = None;
            }
        });
        let compiled = within(500, &route).expect("it fits");
        let own = Some(3.0);
        assert_eq!(of_jumps(&compiled), [own, own, None, Some(12.0)]);
    }

    #[test]
    fn a_curve_and_the_leg_behind_it_keep_their_speeds() {
        let mut bow = plan(&[2.0; 5], |_| {});
        let degrees = |degrees| Some(Bam32::from_degrees(degrees));
        let curve = CurveSegment {
            p1_waypoint_no: Some(2),
            p4_waypoint_no: Some(3),
            p2_latitude: degrees(47.3998),
            p2_longitude: degrees(8.5460),
            p3_latitude: degrees(47.4001),
            p3_longitude: degrees(8.5460),
            ..CurveSegment::default()
        };
        bow.store(&curve.into(), CUCS, VEHICLE).expect("stored");
        let whole = within(500, &bow).expect("it fits");
        let compiled = within(whole.items.len() - 1, &bow).expect("it fits");
        assert_eq!(compiled.items.len(), whole.items.len() - 2);
        let mut kept = set_at(&compiled);
        kept.dedup();
        assert_eq!(kept, [1, 3, 4]);
        let tolerance_m = |compiled: &CompiledMission| compiled.curved.map(|c| c.tolerance_m);
        assert_eq!(tolerance_m(&compiled), tolerance_m(&whole));
    }

    #[test]
    fn a_speed_is_kept_behind_another_speed_of_a_leg_and_behind_a_transition() {
        let repeated = |legs: &[&[Item]]| {
            let mut compiled = CompiledMission::default();
            for (number, items) in (1..).zip(legs) {
                items.iter().for_each(|item| compiled.push(number, *item));
            }
            compiled.repeated_speeds()
        };
        let place = placed((47.0, 8.0), Level::AboveHome(30.0), NAV_WAYPOINT, [0.0; 4]);
        let [speed, other, air] = [(5.0, true), (6.0, true), (5.0, false)]
            .map(|(speed_m_s, hovers)| change_speed(speed_m_s, hovers));
        let plain: &[Item] = &[speed, place];
        assert_eq!(repeated(&[plain, plain, plain]), [2, 4]);
        let turning: &[Item] = &[speed, place, transition(true)];
        assert_eq!(repeated(&[plain, turning, plain, plain]), [7]);
        let loitering: &[Item] = &[speed, place, other, place, speed];
        assert_eq!(repeated(&[plain, loitering, plain, plain]), [9]);
        let by_air_speed: &[Item] = &[air, place];
        assert_eq!(repeated(&[plain, by_air_speed, by_air_speed, plain]), [4]);
        // A leg without a speed has the one before it.
        assert_eq!(repeated(&[plain, &[place], plain]), [3]);
    }
}
