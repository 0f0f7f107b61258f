//! How a route ends: PX4 flies no mission of a wing without a landing (MIS_TKO_LAND_REQ), and uses it when a landing is
//! commanded.
//!
//! | airframe | the mission is |
//! |---|---|
//! | multicopter | the route; of an approach route, NAV_LAND at its last waypoint after it |
//! | fixed wing | the route, NAV_LOITER_UNLIM at its end, then DO_LAND_START and the pattern |
//! | VTOL | DO_VTOL_TRANSITION to wings, then as a fixed wing, with NAV_VTOL_LAND |
//!
//! The pattern is the approach route (13001, Route Type approach) if one was sent: its last waypoint is the touch-down, at
//! home's altitude. Otherwise it is the configured one (`vehicle.landing`): a loiter down to its height, then straight to
//! the touch-down. The vehicle stays in the loiter at the end of its route until mode 19 is commanded: a route that ended
//! in a landing would land a vehicle whose operator only wanted the route.
//!
//! Items of the pattern belong to no waypoint of the route (number 0): a CUCS sees its own route, without our additions.
//!
//! PX4's own checks are made here, before anything is sent (FeasibilityChecker.cpp of v1.18): the item before NAV_LAND is
//! above it, far enough for FW_LND_ANG, and the touch-down lies outside a loiter's circle.

use mavlink_link::service::mission::{FRAME_MISSION, Item};
use stanag_msgs::enums::RouteType;

use super::compile::compile;
use super::error::{Reason, RouteError};
use super::item::{
    DO_JUMP, DO_LAND_START, NAV_LAND, NAV_LOITER_TO_ALT, NAV_LOITER_UNLIM, NAV_VTOL_LAND,
    NAV_WAYPOINT, placed, transition,
};
use super::mission::{CompiledMission, Leg};
use super::site::Site;
use super::wings::{Pattern, Wings};
use crate::altitude::Level;
use crate::limits::{metres, moved};
use crate::plan::Plan;

/// Ends a compiled route as this vehicle needs it. `plan` holds everything that was sent, perhaps an approach route too.
///
/// # Errors
/// A wing has no landing, or one that it cannot fly: the waypoint of the approach, or the first of the route.
pub fn complete(
    compiled: &mut CompiledMission,
    plan: &Plan,
    route_type: RouteType,
    site: &Site,
) -> Result<(), RouteError> {
    let Some(wings) = &site.wings else {
        if route_type == RouteType::Approach {
            compiled.land_at_the_end();
        }
        return Ok(());
    };
    let Some((first, last)) = compiled
        .order
        .first()
        .copied()
        .zip(compiled.order.last().copied())
    else {
        return Ok(());
    };
    if route_type == RouteType::Approach {
        let pattern = approach(compiled.clone(), wings, site)?;
        compiled.items.clear();
        compiled.waypoint_of.clear();
        append(compiled, pattern);
    } else {
        let at = |reason| RouteError {
            waypoint: first.number,
            reason,
        };
        if wings.vtol {
            transition_first(compiled, first.number);
        }
        let sent = plan.route_of_type(RouteType::Approach);
        let pattern = match (sent, &wings.landing) {
            (Some(route), _) => {
                let initial = route.initial_waypoint_number.unwrap_or(0);
                let mut pattern = approach(compile(plan, initial, site)?, wings, site)?;
                // The approach's waypoint numbers are not those of this route, even if they are equal.
                pattern.iter_mut().for_each(|(number, _)| *number = 0);
                pattern
            }
            (None, Some(pattern)) => configured(pattern, wings, site).map_err(at)?,
            (None, None) if wings.needs_landing => return Err(at(Reason::NoLanding)),
            (None, None) => return Ok(()),
        };
        let stay = placed(
            last.place(),
            last.level,
            NAV_LOITER_UNLIM,
            [0.0, 0.0, 0.0, f32::NAN],
        );
        compiled.push(0, stay);
        append(compiled, pattern);
    }
    // The pattern belongs to no waypoint that could be named.
    let fitted = compiled.fit(site.limits.items);
    fitted.map_err(|fault| RouteError {
        waypoint: last.number,
        ..fault
    })?;
    mark_first(compiled);
    Ok(())
}

/// The items of a landing, with the waypoint that each belongs to.
type Items = Vec<(u16, Item)>;

fn append(compiled: &mut CompiledMission, pattern: Items) {
    for (number, item) in pattern {
        compiled.push(number, item);
    }
}

fn mark_first(compiled: &mut CompiledMission) {
    for item in &mut compiled.items {
        item.current = false;
    }
    if let Some(item) = compiled.items.first_mut() {
        item.current = true;
    }
}

/// Starts with a transition to wings; PX4 skips it if the vehicle flies on them already.
fn transition_first(compiled: &mut CompiledMission, number: u16) {
    for item in &mut compiled.items {
        // A jump names an item by its index, which the inserted item shifts.
        if item.command == DO_JUMP {
            item.params[0] += 1.0;
        }
    }
    compiled.items.insert(0, transition(false));
    compiled.waypoint_of.insert(0, number);
}

fn land_start() -> (u16, Item) {
    let item = Item {
        frame: FRAME_MISSION,
        command: DO_LAND_START,
        autocontinue: true,
        ..Item::default()
    };
    (0, item)
}

/// The approach route as a landing pattern: its last waypoint is the touch-down.
fn approach(route: CompiledMission, wings: &Wings, site: &Site) -> Result<Items, RouteError> {
    let [.., before, last] = route.order.as_slice() else {
        return Err(RouteError {
            waypoint: route.order.last().map_or(0, |leg| leg.number),
            reason: Reason::ShortApproach,
        });
    };
    let at = |reason| RouteError {
        waypoint: before.number,
        reason,
    };
    let pairs = route
        .waypoint_of
        .iter()
        .copied()
        .zip(route.items.iter().copied());
    let mut items: Items = pairs.filter(|(number, _)| *number != last.number).collect();
    for (_, item) in &mut items {
        item.current = false;
        // It was compiled as a separate route, so its jumps would lead elsewhere here.
        if item.command == DO_JUMP {
            return Err(at(Reason::LoopInApproach));
        }
    }
    // A loiter without end would never let the vehicle land: descend to its altitude, then continue.
    if let Some((_, item)) = items.iter_mut().rev().find(|(_, item)| item.is_flown_to())
        && item.command == NAV_LOITER_UNLIM
    {
        let radius = item.params[2];
        item.command = NAV_LOITER_TO_ALT;
        item.params = [1.0, radius, 0.0, 1.0];
    }
    let entry = items.iter().rev().find(|(_, item)| item.is_flown_to());
    let (_, entry) = entry.ok_or_else(|| at(Reason::ShortApproach))?;
    let entry = Entry {
        command: entry.command,
        place: before.place(),
        height_m: before.level.above_home(site.home.amsl_m),
        radius_m: f64::from(entry.params[1]),
    };
    check(&entry, last.place(), wings).map_err(at)?;
    items.insert(0, land_start());
    items.push((last.number, touch_down(last, wings)));
    Ok(items)
}

fn touch_down(last: &Leg, wings: &Wings) -> Item {
    land_at(last.place(), wings)
}

fn land_at(place: (f64, f64), wings: &Wings) -> Item {
    let command = if wings.vtol { NAV_VTOL_LAND } else { NAV_LAND };
    placed(
        place,
        Level::AboveHome(0.0),
        command,
        [0.0, 0.0, 0.0, f32::NAN],
    )
}

/// The pattern of the configuration.
fn configured(pattern: &Pattern, wings: &Wings, site: &Site) -> Result<Items, Reason> {
    let home = (site.home.latitude, site.home.longitude);
    let place = pattern.place.unwrap_or(home);
    let radius_m = pattern.radius_m.unwrap_or(wings.loiter_radius_m);
    let glide_deg = pattern.glide_deg.unwrap_or(wings.glide_deg);
    // A VTOL approaches level, and lands vertically.
    let final_m = if wings.vtol {
        (2.0 * radius_m.abs()).max(VTOL_FINAL_M)
    } else {
        pattern.height_m / glide_deg.to_radians().tan()
    };
    wings.check_circle(radius_m, site.performance.cruise_m_s)?;
    // The tangent of the circle leads to the touch-down, so its centre is beside the start of the final approach.
    let begin = moved(place, pattern.course_rad + std::f64::consts::PI, final_m);
    let side = std::f64::consts::FRAC_PI_2.copysign(radius_m);
    let centre = moved(begin, pattern.course_rad + side, radius_m.abs());
    let entry = Entry {
        command: NAV_LOITER_TO_ALT,
        place: centre,
        height_m: pattern.height_m,
        radius_m,
    };
    check(&entry, place, wings)?;
    let level = Level::AboveHome(pattern.height_m);
    // Param1 and param4: leave the circle heading to the touch-down, on the tangent.
    let params = [1.0, radius_m as f32, 0.0, 1.0];
    Ok(vec![
        land_start(),
        (0, placed(centre, level, NAV_LOITER_TO_ALT, params)),
        (0, land_at(place, wings)),
    ])
}

/// The item before the touch-down.
struct Entry {
    command: u16,
    place: (f64, f64),
    /// Above home, and so above the touch-down.
    height_m: f64,
    radius_m: f64,
}

/// PX4's own checks of a landing, made before the upload: PX4 reports a failure only after it.
fn check(entry: &Entry, place: (f64, f64), wings: &Wings) -> Result<(), Reason> {
    if wings.vtol {
        return wings.check_transition(entry.height_m);
    }
    let away_m = metres(entry.place, place);
    let final_m = match entry.command {
        NAV_LOITER_TO_ALT if away_m <= entry.radius_m.abs() => {
            return Err(Reason::LandingInsideLoiter {
                away_m,
                radius_m: entry.radius_m.abs(),
            });
        }
        NAV_LOITER_TO_ALT => (away_m * away_m - entry.radius_m * entry.radius_m).sqrt(),
        NAV_WAYPOINT => away_m,
        _ => return Err(Reason::ApproachLoiter),
    };
    // PX4 allows a tenth of a degree for rounding.
    let steepest = (wings.glide_deg + 0.1).to_radians().tan();
    if entry.height_m <= steepest * final_m {
        return Ok(());
    }
    Err(Reason::GlideSlope {
        height_m: entry.height_m,
        final_m,
        glide_deg: (entry.height_m / final_m).atan().to_degrees(),
        most_deg: wings.glide_deg,
        needed_m: entry.height_m / wings.glide_deg.to_radians().tan(),
    })
}

/// Shortest final approach of a VTOL, in which it slows down to a hover, m.
const VTOL_FINAL_M: f64 = 200.0;

#[cfg(test)]
mod tests {
    use stanag_msgs::enums::AltitudeType;
    use stanag_msgs::messages::{UaPositionWaypoint, UaRoute, VehicleSpecificWaypoint};
    use stanag_msgs::{Bam32, Id, Scaled};

    use super::*;
    use crate::altitude::{Agl, Altimeter};
    use crate::limits::{Limits, Performance, moved};
    use crate::parameter::Parameters;
    use crate::route::Curving;
    use crate::telemetry::Place;

    const HOME: (f64, f64) = (47.397_7, 8.545_6);

    /// A waypoint: its number, and north, east and height in metres of home.
    type Point = (u16, f64, f64, f64);

    fn plan(routes: &[(RouteType, &[Point])]) -> Plan {
        let (cucs, vehicle) = (Id(0x1b00_00a0), Id(0x1b00_0101));
        let mut plan = Plan::default();
        for (kind, points) in routes {
            let route = UaRoute {
                initial_waypoint_number: points.first().map(|point| point.0),
                route_type: Some(*kind),
                route_id: Some(stanag_msgs::Text::new(&format!("{kind:?}"))),
                ..UaRoute::default()
            };
            plan.store(&route.into(), cucs, vehicle).expect("a route");
            for (index, (number, north, east, up)) in points.iter().enumerate() {
                let (latitude, longitude) =
                    moved(moved(HOME, 0.0, *north), std::f64::consts::FRAC_PI_2, *east);
                let waypoint = UaPositionWaypoint {
                    waypoint_number: Some(*number),
                    waypoint_to_latitude_or_relative_y: Some(Bam32::from_degrees(latitude)),
                    waypoint_to_longitude_or_relative_x: Some(Bam32::from_degrees(longitude)),
                    waypoint_to_altitude: Scaled::from_si(*up).ok(),
                    waypoint_altitude_type: Some(AltitudeType::Agl),
                    next_waypoint: Some(points.get(index + 1).map_or(0, |next| next.0)),
                    ..UaPositionWaypoint::default()
                };
                plan.store(&waypoint.into(), cucs, vehicle)
                    .expect("a waypoint");
            }
        }
        plan
    }

    fn site(vtol: bool, landing: Option<Pattern>) -> Site<'static> {
        let (parameters, limits) = (Parameters::default(), Limits::default());
        Site {
            home: Place {
                latitude: HOME.0,
                longitude: HOME.1,
                amsl_m: 488.0,
            },
            geoid_m: None,
            agl: Agl::AboveHome,
            terrain: None,
            altimeter: Altimeter::STANDARD,
            wings: Some(Wings::of(vtol, &parameters, &limits, landing)),
            limits,
            performance: Performance::of(false, &parameters, &limits),
            curving: Curving::default(),
        }
    }

    fn flown(
        plan: &Plan,
        kind: RouteType,
        initial: u16,
        site: &Site,
    ) -> Result<CompiledMission, RouteError> {
        let mut compiled = compile(plan, initial, site)?;
        complete(&mut compiled, plan, kind, site)?;
        Ok(compiled)
    }

    fn commands(compiled: &CompiledMission) -> Vec<u16> {
        compiled.items.iter().map(|item| item.command).collect()
    }

    const ROUTE: (RouteType, &[Point]) = (
        RouteType::Flight,
        &[(1, 300.0, 0.0, 60.0), (2, 600.0, 300.0, 60.0)],
    );

    #[test]
    fn a_wing_without_a_landing_is_refused_with_what_to_send() {
        let refused = flown(&plan(&[ROUTE]), RouteType::Flight, 1, &site(false, None));
        let refused = refused.expect_err("it has no landing");
        assert_eq!((refused.waypoint, &refused.reason), (1, &Reason::NoLanding));
        assert!(refused.to_string().contains("vehicle.landing"), "{refused}");
        let mut optional = site(false, None);
        optional.wings.as_mut().expect("wings").needs_landing = false;
        let compiled = flown(&plan(&[ROUTE]), RouteType::Flight, 1, &optional);
        assert_eq!(commands(&compiled.expect("it is flown as it is")), [16, 16]);
    }

    #[test]
    fn the_approach_route_becomes_the_landing_and_the_cucs_sees_its_own_waypoints_only() {
        let approach: &[_] = &[(7, -800.0, 0.0, 50.0), (8, 0.0, 0.0, 5.0)];
        let sent = plan(&[ROUTE, (RouteType::Approach, approach)]);
        let compiled = flown(&sent, RouteType::Flight, 1, &site(false, None)).expect("it lands");
        assert_eq!(commands(&compiled), [16, 16, 17, 189, 16, 21]);
        assert_eq!(compiled.waypoint_of, [1, 2, 0, 0, 0, 0]);
        assert_eq!(compiled.items[5].z, 0.0);
        assert_eq!(compiled.landing_start(), Some(3));
        assert_eq!(compiled.leg_ended_by(1), Some(1));
        assert_eq!(compiled.leg_of_item(4), None);
        assert!(compiled.is_past_the_route(2) && !compiled.is_past_the_route(1));
        assert_eq!(compiled.lowest_amsl_m(488.0), Some(548.0));
        // By itself, for mode 19.
        let alone = flown(&sent, RouteType::Approach, 7, &site(false, None)).expect("it lands");
        assert_eq!(commands(&alone), [189, 16, 21]);
        assert!(alone.items[0].current);
    }

    #[test]
    fn repeated_speeds_are_left_out_where_the_landing_makes_too_many_items() {
        let approach: &[_] = &[(7, -800.0, 0.0, 50.0), (8, 0.0, 0.0, 5.0)];
        let mut sent = plan(&[ROUTE, (RouteType::Approach, approach)]);
        for number in [1, 2] {
            let waypoint = UaPositionWaypoint {
                waypoint_to_speed: Scaled::from_si(15.0).ok(),
                ..sent.waypoint(number).expect("sent").clone()
            };
            let stored = sent.store(&waypoint.into(), Id(0x1b00_00a0), Id(0x1b00_0101));
            stored.expect("a waypoint");
        }
        let within = |items| {
            let mut site = site(false, None);
            site.limits.items = items;
            flown(&sent, RouteType::Flight, 1, &site)
        };
        let items = |items| commands(&within(items).expect("it fits"));
        assert_eq!(items(8), [178, 16, 178, 16, 17, 189, 16, 21]);
        assert_eq!(items(7), [178, 16, 16, 17, 189, 16, 21]);
        let fault = within(6).expect_err("7 items remain");
        assert_eq!((fault.waypoint, fault.reason), (2, Reason::TooManyItems(6)));
    }

    /// With the last waypoint of the route, or the first of the approach, at another speed.
    #[test]
    fn a_landing_is_begun_at_the_vehicles_own_speed_unless_its_approach_has_one() {
        let approach: &[_] = &[(7, -800.0, 0.0, 50.0), (8, 0.0, 0.0, 5.0)];
        let begun = |fast: Option<u16>| {
            let mut sent = plan(&[ROUTE, (RouteType::Approach, approach)]);
            if let Some(number) = fast {
                let waypoint = UaPositionWaypoint {
                    waypoint_to_speed: Scaled::from_si(18.0).ok(),
                    ..sent.waypoint(number).expect("sent").clone()
                };
                let stored = sent.store(&waypoint.into(), Id(0x1b00_00a0), Id(0x1b00_0101));
                stored.expect("a waypoint");
            }
            let flown = flown(&sent, RouteType::Flight, 1, &site(false, None)).expect("it lands");
            [false, true].map(|jumps| flown.speed_of_landing(jumps, 15.0))
        };
        // PX4 has its own speed where it enters AUTO.MISSION, and on a jump the present one.
        assert_eq!(begun(None), [None, Some(15.0)]);
        assert_eq!(begun(Some(2)), [Some(15.0); 2]);
        assert_eq!(begun(Some(7)), [None; 2]);
    }

    #[test]
    fn a_glide_too_steep_is_refused_with_the_figures() {
        let approach: &[_] = &[(7, -300.0, 0.0, 60.0), (8, 0.0, 0.0, 5.0)];
        let sent = plan(&[ROUTE, (RouteType::Approach, approach)]);
        let refused = flown(&sent, RouteType::Flight, 1, &site(false, None));
        let refused = refused.expect_err("11 degrees");
        let text = "waypoint 7: from here to the touch-down 60 m of height on 300 m, 11.3 deg, at most 5.0 (FW_LND_ANG): place \
                    it 686 m away, or lower";
        assert_eq!(refused.to_string(), text);
        // A VTOL lands vertically.
        let compiled = flown(&sent, RouteType::Flight, 1, &site(true, None)).expect("it lands");
        assert_eq!(commands(&compiled), [3000, 16, 16, 17, 189, 16, 85]);
        assert!(compiled.items[0].current && !compiled.items[1].current);
    }

    #[test]
    fn a_configured_pattern_ends_on_the_tangent_within_the_glide() {
        let pattern = Pattern {
            course_rad: 90_f64.to_radians(),
            height_m: 50.0,
            glide_deg: None,
            radius_m: Some(-100.0),
            place: None,
        };
        let site = site(false, Some(pattern));
        let compiled = flown(&plan(&[ROUTE]), RouteType::Flight, 1, &site).expect("it lands");
        assert_eq!(commands(&compiled), [16, 16, 17, 189, 31, 21]);
        let loiter = &compiled.items[4];
        assert_eq!(loiter.params, [1.0, -100.0, 0.0, 1.0]);
        let centre = (f64::from(loiter.x) / 1e7, f64::from(loiter.y) / 1e7);
        // 50 m at 5 degrees are 571 m; counter-clockwise the centre is to the left of an approach to the east.
        let away_m = metres(centre, HOME);
        assert!((away_m - 571.5_f64.hypot(100.0)).abs() < 2.0, "{away_m}");
        assert!(centre.0 > HOME.0 && centre.1 < HOME.1, "{centre:?}");
    }

    fn transition(plan: &mut Plan, number: u16, tag: &str) {
        let specific = VehicleSpecificWaypoint {
            waypoint_number: Some(number),
            tag_data: Some(stanag_msgs::Text::new(tag)),
            ..VehicleSpecificWaypoint::default()
        };
        plan.store(&specific.into(), Id(0x1b00_00a0), Id(0x1b00_0101))
            .expect("it is stored");
    }

    const LEGS: (RouteType, &[Point]) = (
        RouteType::Flight,
        &[
            (1, 300.0, 0.0, 60.0),
            (2, 600.0, 0.0, 60.0),
            // A turn and a climb that the wings could not fly.
            (3, 590.0, 8.0, 90.0),
            (4, 300.0, 300.0, 60.0),
        ],
    );
    const SHORT: (RouteType, &[Point]) = (
        RouteType::Approach,
        &[(7, -300.0, 0.0, 50.0), (8, 0.0, 0.0, 5.0)],
    );

    #[test]
    fn a_vtol_hovers_along_the_legs_that_it_was_told_to() {
        let mut sent = plan(&[LEGS, SHORT]);
        let refused = flown(&sent, RouteType::Flight, 1, &site(true, None));
        refused.expect_err("the wings cannot turn to waypoint 3");
        transition(&mut sent, 2, "TRANSITION HOVER");
        transition(&mut sent, 3, "TRANSITION WINGS");
        let compiled = flown(&sent, RouteType::Flight, 1, &site(true, None)).expect("it hovers");
        let expected = [3000, 16, 16, 3000, 178, 16, 3000, 178, 16, 17, 189, 16, 85];
        assert_eq!(commands(&compiled), expected);
        let states = [0, 3, 6].map(|at: usize| compiled.items[at].params[0]);
        assert_eq!(states, [4.0, 3.0, 4.0]);
        // Its own speed in each state, named as PX4 takes it there.
        let speeds =
            [4, 7].map(|at: usize| [compiled.items[at].params[0], compiled.items[at].params[1]]);
        assert_eq!(speeds, [[1.0, 5.0], [0.0, 15.0]]);
        let hovers: Vec<bool> = (0..13).map(|seq| compiled.hovers_from(seq)).collect();
        let leg = |from: usize, to: usize| hovers[from..to].to_vec();
        assert_eq!(
            (leg(0, 3), leg(3, 6), leg(6, 13)),
            (vec![false; 3], vec![true; 3], vec![false; 7])
        );
        assert!(compiled.turns_at(3) && !compiled.turns_at(5));
        // The same transition twice is one.
        transition(&mut sent, 1, "TRANSITION WINGS");
        let again = flown(&sent, RouteType::Flight, 1, &site(true, None)).expect("it hovers");
        assert_eq!(again.items, compiled.items);
    }

    #[test]
    fn a_transition_that_cannot_be_is_refused_with_its_waypoint() {
        let mut sent = plan(&[ROUTE, SHORT]);
        transition(&mut sent, 1, "TRANSITION HOVER");
        let refused = flown(&sent, RouteType::Flight, 1, &site(false, None)).expect_err("a wing");
        assert_eq!(
            refused.to_string(),
            "waypoint 1: a transition (13006): the vehicle is no VTOL"
        );
        let low: &[_] = &[
            (1, 300.0, 0.0, 60.0),
            (2, 600.0, 0.0, 15.0),
            (3, 900.0, 0.0, 60.0),
        ];
        let mut sent = plan(&[(RouteType::Flight, low), SHORT]);
        transition(&mut sent, 2, "TRANSITION HOVER");
        let refused = flown(&sent, RouteType::Flight, 1, &site(true, None)).expect_err("15 m");
        assert_eq!(refused.waypoint, 2);
        assert!(
            refused
                .to_string()
                .contains("a transition 15 m above home, at least 20"),
            "{refused}"
        );
        // As fast as wings, and hovering.
        let mut sent = plan(&[LEGS, SHORT]);
        transition(&mut sent, 2, "TRANSITION HOVER");
        let mut fast = UaPositionWaypoint {
            waypoint_to_speed: Scaled::from_si(15.0).ok(),
            ..sent.waypoint(3).expect("it was sent").clone()
        };
        fast.waypoint_speed_type = Some(stanag_msgs::enums::WaypointSpeedType::Indicated);
        sent.store(&fast.into(), Id(0x1b00_00a0), Id(0x1b00_0101))
            .expect("a waypoint");
        let mut slow = site(true, None);
        let hover = slow.wings.as_mut().and_then(|wings| wings.hover.as_mut());
        hover.expect("a VTOL").fastest_m_s = 8.0;
        let refused = flown(&sent, RouteType::Flight, 1, &slow).expect_err("15 m/s");
        assert_eq!(
            (
                refused.waypoint,
                refused.to_string().contains("speed 15.0 m/s")
            ),
            (3, true),
            "{refused}"
        );
    }

    #[test]
    fn a_low_transition_a_tight_turn_and_a_steep_leg_are_refused() {
        let low: &[_] = &[(7, -300.0, 0.0, 12.0), (8, 0.0, 0.0, 5.0)];
        let sent = plan(&[ROUTE, (RouteType::Approach, low)]);
        let refused = flown(&sent, RouteType::Flight, 1, &site(true, None)).expect_err("12 m");
        assert!(
            refused
                .to_string()
                .contains("a transition 12 m above home, at least 20"),
            "{refused}"
        );
        let tight: &[_] = &[
            (1, 300.0, 0.0, 60.0),
            (2, 600.0, 0.0, 60.0),
            (3, 600.0, 15.0, 60.0),
        ];
        let refused = compile(&plan(&[(RouteType::Flight, tight)]), 1, &site(false, None));
        let refused = refused.expect_err("inside the circle");
        assert!(
            matches!(refused.reason, Reason::TightTurn { at: 2, .. }),
            "{refused}"
        );
        let steep: &[_] = &[(1, 300.0, 0.0, 60.0), (2, 500.0, 0.0, 160.0)];
        let refused = compile(&plan(&[(RouteType::Flight, steep)]), 1, &site(false, None));
        let refused = refused.expect_err("100 m on 200 m");
        let text = "waypoint 2: its altitude changes by 100 m on a leg of 200 m, at 15.0 m/s at most 67 m (FW_T_CLMB_MAX, \
                    FW_T_SINK_MAX)";
        assert_eq!(refused.to_string(), text);
    }
}
