//! Waypoints at which a multicopter must stop, or it could miss them for good.
//!
//! PX4 controls height and horizontal position independently. If the next waypoint is at another height, it passes a
//! waypoint while still climbing, and its height oscillates there; or the climb takes longer than the way. If it leaves the
//! acceptance radius while the height is more than NAV_MC_ALT_RAD (0.8 m) off, PX4 does not turn back, and the vehicle
//! flies on along the leg without end, climbing. This was seen on v1.18 with a radius of 3 m at 5 m/s and a climb of 1.5 m
//! in 25 m, and with PX4's own radius (NAV_ACC_RAD, 10 m) at 10 m/s and a climb of 5 m in 100 m. A hold of any length makes
//! PX4 brake for the waypoint, and then none is missed. At 5 m/s there is time enough inside a radius of 10 m, however
//! steep the climb. The radius and the cruise speed are those that the vehicle reports ([`Performance`]).

use curve_paths::flight::CURVE_SWING_S;
use mavlink_link::service::mission::Item;

use super::item::{DO_CHANGE_SPEED, DO_JUMP, NAV_WAYPOINT, speed_before};
use crate::limits::{ACCEPTANCE_M, Performance};

/// Makes PX4 brake for each of these waypoints that it reaches or leaves with a climb or a descent, if the waypoint has its
/// own radius or is passed in less time than the height oscillates. The first waypoint is reached from anywhere; PX4 climbs
/// to its height on the spot before it flies there. Returns the indices of the waypoints it brakes for.
///
/// Points of a curve are excluded: they are slowed and widened instead ([`super::curve`]).
pub(crate) fn where_height_changes(
    items: &mut [Item],
    waypoints: &[usize],
    performance: &Performance,
) -> Vec<usize> {
    // A vehicle whose own radius is smaller than PX4's default counts as if each item had that radius.
    let narrow = performance.acceptance_m < ACCEPTANCE_M;
    let mut braked = Vec::new();
    for &at in waypoints {
        let Some(item) = items.get(at) else { break };
        if !is_passed(item) {
            continue;
        }
        let own = item.params[1] <= 0.0;
        let speed_m_s = speed_before(items, at).map_or(performance.cruise_m_s, f64::from);
        let fast = !own || is_fast(speed_m_s, performance);
        if fast && changes_height(items, at, own && !narrow) {
            braked.push(at);
        }
    }
    for at in &braked {
        if let Some(item) = items.get_mut(*at) {
            item.params[0] = HOLD_S;
        }
    }
    braked
}

/// The first item from `start` on that a multicopter could miss for good at this commanded speed, up to the route's
/// next speed: one that is passed with a climb or a descent faster than it was planned for. `level` is whether the
/// first place is reached without a climb or descent, for a vehicle that does not come from the route's previous
/// waypoint.
pub(crate) fn missed_at(
    items: &[Item],
    start: usize,
    level: Option<bool>,
    speed_m_s: f64,
    performance: &Performance,
) -> Option<usize> {
    let mut places = items.iter().enumerate().skip(start);
    let first = places.find_map(|(at, item)| item.is_flown_to().then_some(at));
    let changes = |at: usize| match level.filter(|_| first == Some(at)) {
        Some(level) => !level || next_differs(items, at),
        None => changes_height(items, at, false),
    };
    let too_fast = |at: usize| {
        items.get(at).is_some_and(|item| {
            let radius_m = f64::from(item.params[1]);
            let fast = if radius_m <= 0.0 {
                is_fast(speed_m_s, performance)
            } else {
                // A point of a climbing curve is as wide as half a swing at the planned speed.
                0.5 * CURVE_SWING_S * speed_m_s > radius_m + 0.01
            };
            is_passed(item) && fast && changes(at)
        })
    };
    let until_speed_change = |from: usize| {
        let on = items.iter().enumerate().skip(from);
        on.take_while(|(_, item)| item.command != DO_CHANGE_SPEED)
    };
    // The waypoints that a loop leads back to follow later, at the same speed.
    let back = until_speed_change(start)
        .filter(|(_, item)| item.command == DO_JUMP)
        .map(|(_, item)| item.params[0] as usize);
    let again = back.flat_map(until_speed_change);
    until_speed_change(start)
        .chain(again)
        .map(|(at, _)| at)
        .find(|at| too_fast(*at))
}

/// Whether PX4 continues to the next item without a stop.
fn is_passed(item: &Item) -> bool {
    item.command == NAV_WAYPOINT && item.params[0] <= 0.0
}

/// Whether it is reached or left by a climb or a descent. `first_is_level` applies if no waypoint is before it.
fn changes_height(items: &[Item], at: usize, first_is_level: bool) -> bool {
    let before = items.iter().take(at).rev().find(|item| item.is_flown_to());
    before.map_or(!first_is_level, |before| differs(items, at, before)) || next_differs(items, at)
}

/// Whether it is left by one. After the last one, and after a loop, the next height is unknown here.
fn next_differs(items: &[Item], at: usize) -> bool {
    let mut after = items.iter().skip(at + 1);
    let next = after.find(|item| item.is_flown_to() || item.command == DO_JUMP);
    next.is_some_and(|next| differs(items, at, next))
}

fn differs(items: &[Item], at: usize, other: &Item) -> bool {
    items.get(at).is_some_and(|item| {
        !other.is_flown_to() || other.frame != item.frame || (other.z - item.z).abs() > LEVEL_M
    })
}

/// Whether PX4's own radius is crossed in less time than a swing of the height takes.
fn is_fast(speed_m_s: f64, performance: &Performance) -> bool {
    SWING_S * speed_m_s > 2.0 * performance.acceptance_m
}

/// Heights that differ by less than this count as equal, m. PX4 reacts to 1 mm, but overshoots by at most the
/// difference.
const LEVEL_M: f32 = 0.05;
/// How long a swing takes, s. At 6.5 m/s and a radius of 10 m, 3 s to cross it, waypoints were accepted as late as 11 m
/// behind; at 5 m/s, 4 s, as late as 7 m.
const SWING_S: f64 = 4.0;
/// The shortest hold that makes PX4 brake, s.
const HOLD_S: f32 = 0.1;

#[cfg(test)]
mod tests {
    use super::*;

    fn to(z: f32, radius: f32) -> Item {
        Item {
            frame: 6,
            command: NAV_WAYPOINT,
            current: false,
            autocontinue: true,
            params: [0.0, radius, 0.0, f32::NAN],
            x: 473_977_434,
            y: 85_455_939,
            z,
        }
    }

    fn speed() -> Item {
        Item {
            frame: 2,
            command: 178,
            params: [1.0, 5.0, -1.0, 0.0],
            ..to(0.0, 0.0)
        }
    }

    fn all(items: &mut [Item]) -> Vec<usize> {
        by(items, &Performance::default())
    }

    fn by(items: &mut [Item], performance: &Performance) -> Vec<usize> {
        let every: Vec<usize> = (0..items.len()).collect();
        where_height_changes(items, &every, performance)
    }

    /// Items 100 m apart with PX4's own radius, reached at this speed.
    fn far(speed_m_s: f32, heights: &[f32]) -> Vec<Item> {
        let mut items = vec![Item {
            params: [1.0, speed_m_s, -1.0, 0.0],
            ..speed()
        }];
        items.extend((0..).zip(heights).map(|(k, z)| Item {
            x: 473_977_434 + k * 8_993,
            ..to(*z, 0.0)
        }));
        items
    }

    #[test]
    fn a_level_route_is_braked_for_at_its_first_waypoint_alone() {
        let mut items = [
            speed(),
            to(30.0, 3.0),
            to(30.0, 3.0),
            speed(),
            to(30.0, 3.0),
        ];
        assert_eq!(all(&mut items), [1]);
        let holds: Vec<f32> = items.iter().map(|item| item.params[0]).collect();
        assert_eq!(holds, [1.0, 0.1, 0.0, 1.0, 0.0]);
    }

    #[test]
    fn both_ends_of_a_climb_are_braked_for() {
        let mut items = [
            to(30.0, 3.0),
            to(30.0, 3.0),
            to(30.0, 3.0),
            speed(),
            to(31.5, 3.0),
            to(31.5, 3.0),
        ];
        assert_eq!(all(&mut items), [0, 2, 4]);
    }

    #[test]
    fn the_vehicles_own_radius_is_wide_enough_for_a_slow_vehicle() {
        assert!(all(&mut [to(30.0, 0.0), to(45.0, 0.0), to(30.0, 0.0)]).is_empty());
        assert!(all(&mut far(5.0, &[30.0, 90.0, 30.0])).is_empty());
        assert!(
            all(&mut far(12.0, &[30.0; 3])).is_empty(),
            "level at any speed"
        );
    }

    #[test]
    fn the_cruise_speed_counts_where_the_route_has_no_speed() {
        let climb = [to(30.0, 0.0), to(45.0, 0.0)];
        let braked = |cruise_m_s| {
            let performance = Performance {
                cruise_m_s,
                ..Performance::default()
            };
            where_height_changes(&mut climb.clone(), &[0, 1], &performance)
        };
        assert!(braked(5.0).is_empty());
        assert_eq!(braked(12.0), [0, 1]);
    }

    fn missed(items: &[Item], start: usize, level: Option<bool>, speed_m_s: f64) -> Option<usize> {
        missed_at(items, start, level, speed_m_s, &Performance::default())
    }

    #[test]
    fn a_speed_that_is_commanded_in_flight_is_judged_until_the_route_sets_another() {
        let route = [
            to(30.0, 0.0),
            to(30.0, 0.0),
            to(40.0, 0.0),
            speed(),
            to(50.0, 0.0),
        ];
        assert_eq!(missed(&route, 0, None, 5.0), None);
        assert_eq!(missed(&route, 0, Some(false), 10.0), Some(0));
        assert_eq!(missed(&route, 0, Some(true), 10.0), Some(1));
        assert_eq!(missed(&route, 1, None, 10.0), Some(1));
        assert_eq!(missed(&route, 3, None, 10.0), None, "the route is slower");
        let level = [to(30.0, 0.0), to(30.0, 0.0), to(30.0, 0.0)];
        assert_eq!(missed(&level, 1, None, 10.0), None);
        // Points of a climbing curve, made for 4 m/s.
        let curve = [to(30.0, 6.0), to(31.0, 6.0), to(32.0, 6.0)];
        assert_eq!(missed(&curve, 1, None, 4.0), None);
        assert_eq!(missed(&curve, 1, None, 5.0), Some(1));
        // A loop leads back to a climb.
        let jump = Item {
            frame: 2,
            command: DO_JUMP,
            params: [1.0, 3.0, 0.0, 0.0],
            ..to(0.0, 0.0)
        };
        let end = to(40.0, 0.0);
        let held = Item {
            params: [1.0, 0.0, 0.0, f32::NAN],
            ..end
        };
        let lap = [to(40.0, 0.0), to(40.0, 0.0), to(50.0, 0.0), held, jump];
        assert_eq!(missed(&lap, 3, None, 10.0), Some(1));
    }

    #[test]
    fn a_fast_vehicle_brakes_even_there() {
        assert_eq!(all(&mut far(10.0, &[30.0, 35.0, 35.0, 35.0])), [1, 2]);
        assert_eq!(all(&mut far(5.5, &[30.0, 35.0])), [1, 2]);
    }

    #[test]
    fn the_vehicles_own_radius_and_cruise_speed_count() {
        let of = |acceptance_m, cruise_m_s| Performance {
            acceptance_m,
            cruise_m_s,
            ..Performance::default()
        };
        let climb = [30.0, 35.0, 35.0, 35.0];
        // 4 s at 10 m/s are 40 m.
        assert!(by(&mut far(10.0, &climb), &of(20.0, 5.0)).is_empty());
        assert_eq!(by(&mut far(5.0, &climb), &of(9.9, 5.0)), [1, 2]);
        assert_eq!(by(&mut far(5.0, &[30.0; 3]), &of(4.0, 5.0)), [1]);
        let mut cruising = far(5.0, &climb);
        cruising.remove(0);
        assert!(by(&mut cruising, &of(10.0, 5.0)).is_empty());
        assert_eq!(by(&mut cruising, &of(10.0, 8.0)), [0, 1]);
    }

    #[test]
    fn a_requested_hold_stays_and_another_frame_is_another_height() {
        let held = Item {
            params: [20.0, 3.0, 0.0, f32::NAN],
            ..to(30.0, 3.0)
        };
        let amsl = Item {
            frame: 5,
            ..to(30.0, 3.0)
        };
        let mut items = [held, amsl, to(30.0, 3.0)];
        assert_eq!(all(&mut items), [1, 2]);
        assert_eq!(items[0].params[0], 20.0);
    }
}
