//! Judges of the places and altitudes that a CUCS commands, compared with where the vehicle says that it is.
//!
//! In these views the CUCS is the subject. The cards of a session ask for a route near the vehicle and at its altitude, so
//! that a wrong sign, unit or kind of place shows; what an operator does otherwise is no fault, and is not judged.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use super::view::{Found, Judge, View};
use crate::bench::fix::wrapped;
use crate::wire::{Direction, Seen};

pub(super) const JUDGES: &[Judge] = &[
    Judge {
        rule: "SCALAR-003",
        judge: waypoints_in_the_west,
    },
    Judge {
        rule: "ROUTE-025",
        judge: altitudes_are_metres,
    },
    Judge {
        rule: "ROUTE-026",
        judge: location_type_says_which_place,
    },
];

/// The first place that the vehicle reported, in radians; an impossible one is no place, nor is 0, 0, which many fill in
/// before they have one.
fn vehicle_place(view: &View<'_>) -> Option<(f64, f64)> {
    view.requests()
        .filter(|seen| seen.kind() == 4000 && seen.sound())
        .filter(|seen| [seen.raw("Latitude"), seen.raw("Longitude")] != [Some(0); 2])
        .filter_map(|seen| Some((seen.value("Latitude")?, seen.value("Longitude")?)))
        .find(|(latitude, _)| latitude.abs() < FRAC_PI_2)
}

fn waypoints_in_the_west(view: &View<'_>, found: &mut Found) {
    let Some((latitude, longitude)) = vehicle_place(view) else {
        return;
    };
    let degrees = |angle: f64| angle.to_degrees();
    for seen in view.messages().filter(|seen| seen.kind() == 13_002) {
        let (Some(north), Some(east)) = (
            seen.value("Waypoint to Latitude or Relative Y"),
            seen.value("Waypoint to Longitude or Relative X"),
        ) else {
            continue;
        };
        // A relative position is not a place on the globe.
        if seen.raw("Location Type").unwrap_or_default() != 0 {
            continue;
        }
        found.check(seen, north.abs() <= FRAC_PI_2 + 1e-9, || {
            format!(
                "expected a latitude of -90 to 90 degrees, got {:.1}",
                degrees(north)
            )
        });
        let raw = seen
            .raw("Waypoint to Longitude or Relative X")
            .unwrap_or_default();
        found.check(seen, raw != i64::from(i32::MAX), || {
            "expected a longitude in two's complement; the largest angle was sent, as where a longitude beyond 180 degrees is cut off".into()
        });
        // A route near the vehicle, tried with each of the usual mistakes with angles.
        let near = |a: f64, b: f64| (a - b).abs() < 0.02;
        for (what, wrong_north, wrong_east) in [
            ("latitude and longitude exchanged", longitude, latitude),
            ("the opposite sign of the longitude", latitude, -longitude),
            ("the opposite sign of the latitude", -latitude, longitude),
            ("half of each angle", latitude / 2.0, longitude / 2.0),
            ("twice each angle", latitude * 2.0, wrapped(longitude * 2.0)),
        ] {
            found.check(seen, !(near(north, wrong_north) && near(east, wrong_east)), || {
                format!(
                    "expected a waypoint near the vehicle at {:.1}, {:.1} degrees; {:.1}, {:.1} is {what}",
                    degrees(latitude),
                    degrees(longitude),
                    degrees(north),
                    degrees(east)
                )
            });
        }
        if near(north, latitude) {
            found.check(seen, (east - longitude).abs() < 0.5, || {
                format!(
                    "expected a longitude near {:.1} degrees, where the vehicle is; got {:.1}",
                    degrees(longitude),
                    degrees(east)
                )
            });
        }
    }
}

/// Feet in a metre.
const FEET: f64 = 1.0 / 0.3048;
/// How close to the vehicle's altitude one is that was meant to be it, and to the same number in feet: feet are rounded
/// to whole ones, while 400 m, which an operator may prefer to the vehicle's 120 m, are 1.6 % beside its 394 ft.
const SAME: f64 = 0.05;
const CONVERTED: f64 = 0.01;
/// Lower altitudes are not judged, m: there some metres are a large part.
const LOWEST_M: f64 = 50.0;
/// Altitudes of one kind of message that are enough: of a single one the operator may have chosen the number.
const ENOUGH: usize = 2;

/// What the altitudes of one kind of message are, beside the vehicle's.
#[derive(Default)]
struct Altitudes {
    metres: usize,
    feet: usize,
    other: usize,
    last: Option<(Arc<Seen>, f64, f64)>,
}

/// An altitude, its type, and the waypoint that has it.
fn altitude_of(seen: &Seen) -> Option<(f64, i64, Option<i64>)> {
    let (altitude, kind, waypoint) = match seen.kind() {
        13_002 => (
            "Waypoint to Altitude",
            "Waypoint Altitude Type",
            seen.raw("Waypoint Number"),
        ),
        2016 => ("Commanded Altitude", "Altitude Type", None),
        _ => return None,
    };
    Some((seen.value(altitude)?, seen.raw(kind)?, waypoint))
}

/// Altitudes that are the vehicle's own times 3.28, or divided by it, and none that is the vehicle's: they are in feet, or
/// were taken for feet. Only in the altitude type of 4000, since no other can be compared. A pass needs waypoints: flight
/// commands alone do not show in which unit a route is.
fn altitudes_are_metres(view: &View<'_>, found: &mut Found) {
    let mut vehicle: Option<(f64, i64)> = None;
    let mut kinds: BTreeMap<u16, Altitudes> = BTreeMap::new();
    let mut known = BTreeSet::new();
    let all = view.datagrams.iter();
    for seen in all.flat_map(|datagram| &datagram.messages) {
        if seen.direction == Direction::Sent {
            if seen.kind() == 4000 && seen.sound() {
                vehicle = seen.value("Altitude").zip(seen.raw("Altitude Type"));
            }
            continue;
        }
        let (Some((at, reference)), Some((altitude, kind, waypoint))) =
            (vehicle, altitude_of(seen))
        else {
            continue;
        };
        if kind != reference || at < LOWEST_M {
            continue;
        }
        // The same altitude again is no further one, whatever the stamp: the operator has entered it once.
        let of = (seen.kind(), seen.piece.destination.0, waypoint);
        if !known.insert((of, altitude.to_bits())) {
            continue;
        }
        let altitudes = kinds.entry(seen.kind()).or_default();
        let is = |factor: f64, within: f64| (altitude / at / factor - 1.0).abs() <= within;
        if is(1.0, SAME) {
            altitudes.metres += 1;
        } else if is(FEET, CONVERTED) || is(1.0 / FEET, CONVERTED) {
            altitudes.feet += 1;
            altitudes.last = Some((seen.clone(), altitude, at));
        } else {
            altitudes.other += 1;
        }
    }
    for (kind, altitudes) in &kinds {
        let converted = altitudes.metres == 0 && altitudes.feet > altitudes.other;
        match &altitudes.last {
            Some((seen, altitude, at)) if converted => {
                let reason = format!(
                    "expected altitudes of message {kind} in metres; {altitude:.1} m is the vehicle's {at:.1} m converted to feet, or from feet"
                );
                // In a recording nobody asked for the vehicle's altitude.
                if view.live && altitudes.feet >= ENOUGH {
                    found.fail(seen, reason);
                } else {
                    found.warn(seen, reason);
                }
            }
            _ if *kind == 13_002 && altitudes.metres >= ENOUGH => found.saw(),
            _ => {}
        }
    }
    if !found.looked().0 {
        found.missed(format!(
            "fewer than {ENOUGH} altitudes of waypoints near the vehicle's, in the altitude type of 4000"
        ));
    }
}

/// How near to the vehicle an absolute place is, rad: 300 km.
const NEAR: f64 = 0.05;
/// How near to 0, 0 an offset in metres is that is taken for an absolute place, rad: 13 km.
const ORIGIN: f64 = 0.002;

/// A relative place is an offset, and an absolute one is not at 0, 0, where the vehicle is far from there. 0, 0 itself is
/// what a field has that was filled in by nobody: it proves no offset, and is a warning where it is said to be absolute.
fn location_type_says_which_place(view: &View<'_>, found: &mut Found) {
    let place = vehicle_place(view);
    let far = place.filter(|(latitude, longitude)| latitude.abs().max(longitude.abs()) > NEAR);
    let Some((latitude, longitude)) = far else {
        return;
    };
    for seen in view.messages().filter(|seen| seen.kind() == 13_002) {
        let (Some(north), Some(east)) = (
            seen.value("Waypoint to Latitude or Relative Y"),
            seen.value("Waypoint to Longitude or Relative X"),
        ) else {
            continue;
        };
        let at = format!("{:.4}, {:.4}", north.to_degrees(), east.to_degrees());
        if north == 0.0 && east == 0.0 {
            if seen.raw("Location Type") != Some(1) {
                found.warn(seen, "a 13002 with Location Type 0 (absolute) is at 0, 0, where no place was filled in");
            }
            continue;
        }
        if seen.raw("Location Type") == Some(1) {
            let absolute =
                (north - latitude).abs() < NEAR && wrapped(east - longitude).abs() < NEAR;
            found.check(seen, !absolute, || {
                format!("expected an offset from the route's reference in a 13002 with Location Type 1 (relative); {at} degrees is a place near the vehicle")
            });
        } else {
            let offset = north.abs() < ORIGIN && east.abs() < ORIGIN;
            found.check(seen, !offset, || {
                format!("expected a place on the globe in a 13002 with Location Type 0 (absolute); {at} degrees is what an offset of some metres reads as")
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::net::Datagram;
    use crate::passive::view::trace::{of_cucs, to_cucs};
    use crate::passive::view::verdict_on;
    use crate::verdict::Verdict;
    use crate::wire::Draft;

    fn vehicle() -> Datagram {
        let draft = Draft::new(4000)
            .set("Latitude", 0.679)
            .set("Longitude", -1.345)
            .set("Altitude", 120.0)
            .raw("Altitude Type", 1);
        to_cucs(0, draft)
    }

    fn waypoint(at_ms: u64, altitude: f64, kind: i64) -> Datagram {
        numbered(at_ms, at_ms as i64, altitude, kind)
    }

    fn numbered(at_ms: u64, number: i64, altitude: f64, kind: i64) -> Datagram {
        let draft = Draft::new(13_002)
            .raw("Waypoint Number", number)
            .set("Waypoint to Altitude", altitude)
            .raw("Waypoint Altitude Type", kind);
        of_cucs(at_ms, draft)
    }

    fn altitudes(all: &[f64], kind: i64) -> Verdict {
        let mut run = vec![vehicle()];
        run.extend(
            (1..)
                .zip(all)
                .map(|(at_ms, &altitude)| waypoint(at_ms, altitude, kind)),
        );
        verdict_on(&run, altitudes_are_metres)
    }

    #[test]
    fn altitudes_in_feet_are_found() {
        assert_eq!(altitudes(&[120.0, 121.0, 118.0], 1), Verdict::Pass);
        assert_eq!(altitudes(&[393.7, 394.0, 393.7], 1), Verdict::Fail);
        assert_eq!(altitudes(&[36.6, 36.6], 1), Verdict::Fail);
    }

    #[test]
    fn another_altitude_is_no_fault() {
        assert_eq!(altitudes(&[400.0, 400.0, 200.0], 1), Verdict::Inconclusive);
        assert_eq!(altitudes(&[393.7, 500.0, 600.0], 1), Verdict::Inconclusive);
        // Above the ellipsoid the same height has another number.
        assert_eq!(altitudes(&[393.7, 393.7], 3), Verdict::Inconclusive);
        assert_eq!(altitudes(&[], 1), Verdict::Inconclusive);
    }

    #[test]
    fn a_waypoint_that_is_sent_again_is_no_further_altitude() {
        // The stamps differ.
        let again = |altitudes: [f64; 3], number: fn(i64) -> i64| {
            let mut run = vec![vehicle()];
            for (at, altitude) in (1..).zip(altitudes) {
                run.push(numbered(at as u64, number(at), altitude, 1));
            }
            verdict_on(&run, altitudes_are_metres)
        };
        for (altitude, once, several) in [
            (120.0, Verdict::Inconclusive, Verdict::Pass),
            (393.7, Verdict::Warning, Verdict::Fail),
        ] {
            assert_eq!(again([altitude; 3], |_| 7), once, "{altitude}");
            // A route at one altitude.
            assert_eq!(again([altitude; 3], |at| at), several, "{altitude}");
            // The operator has entered another.
            let other = altitude + 1.0;
            assert_eq!(
                again([altitude, other, other], |_| 7),
                several,
                "{altitude}"
            );
        }
    }

    /// A 2016 with these altitudes, each sent twice in the same bytes, beside a route at other altitudes.
    fn commanded(all: &[f64]) -> Verdict {
        let mut run = vec![vehicle(), waypoint(1, 700.0, 1), waypoint(2, 800.0, 1)];
        for (at_ms, &altitude) in (10..).zip(all) {
            let draft = Draft::new(2016)
                .raw("Time Stamp", at_ms)
                .set("Commanded Altitude", altitude)
                .raw("Altitude Type", 1);
            run.push(of_cucs(at_ms as u64, draft.clone()));
            run.push(of_cucs(at_ms as u64 + 1_000, draft));
        }
        verdict_on(&run, altitudes_are_metres)
    }

    #[test]
    fn one_flight_command_proves_nothing() {
        // Right in a flight command, and nothing is known of the route.
        assert_eq!(commanded(&[120.0]), Verdict::Inconclusive);
        assert_eq!(commanded(&[120.0, 121.0]), Verdict::Inconclusive);
        // The operator may have chosen 394 m once.
        assert_eq!(commanded(&[393.7]), Verdict::Warning);
        assert_eq!(commanded(&[393.7, 394.0]), Verdict::Fail);
        assert_eq!(altitudes(&[120.0], 1), Verdict::Inconclusive);
    }

    fn placed(kind: i64, north: f64, east: f64) -> Verdict {
        let draft = Draft::new(13_002)
            .raw("Location Type", kind)
            .set("Waypoint to Latitude or Relative Y", north)
            .set("Waypoint to Longitude or Relative X", east);
        let run = [vehicle(), of_cucs(1, draft)];
        verdict_on(&run, location_type_says_which_place)
    }

    #[test]
    fn the_location_type_is_that_of_the_place() {
        assert_eq!(placed(0, 0.6791, -1.3451), Verdict::Pass);
        assert_eq!(placed(1, 0.6791, -1.3451), Verdict::Fail);
        assert_eq!(placed(1, 1e-5, 2e-5), Verdict::Pass);
        assert_eq!(placed(0, 1e-5, 2e-5), Verdict::Fail);
    }

    #[test]
    fn a_placeholder_of_0_0_is_no_place() {
        assert_eq!(placed(1, 0.0, 0.0), Verdict::Inconclusive);
        assert_eq!(placed(0, 0.0, 0.0), Verdict::Warning);
        // Nor is it the vehicle's, before it has a fix.
        let unfixed = Draft::new(4000).set("Latitude", 0.0).set("Longitude", 0.0);
        let relative = Draft::new(13_002)
            .raw("Location Type", 1)
            .set("Waypoint to Latitude or Relative Y", 0.6791)
            .set("Waypoint to Longitude or Relative X", -1.3451);
        let run = [to_cucs(0, unfixed), vehicle(), of_cucs(1, relative)];
        assert_eq!(
            verdict_on(&run, location_type_says_which_place),
            Verdict::Fail
        );
    }
}
