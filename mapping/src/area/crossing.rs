//! Places and ways compared with areas: what breaches or crosses one.

use mavlink_link::service::mission::Item;

use super::shape::{Area, Bound};
use crate::limits::disc;
use crate::route::DO_JUMP;

/// How a way crosses an area.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Crossing {
    /// Area ID; 0 is one of the configuration.
    pub area: u16,
    /// Whether the vehicle stays inside, else outside.
    pub keep_in: bool,
}

impl std::fmt::Display for Crossing {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (verb, side) = match self.keep_in {
            true => ("leaves", "inside"),
            false => ("enters", "outside of"),
        };
        match self.area {
            0 => write!(out, "{verb} an area of the configuration to stay {side}"),
            area => write!(out, "{verb} area {area}, to stay {side}"),
        }
    }
}

/// The first area that a circle around a place crosses. What is within the circle is not flown over: a vehicle may circle around an
/// area to stay outside.
#[must_use]
pub fn circle_crossing(
    areas: &[(u16, Area)],
    centre: (f64, f64),
    radius_m: f64,
) -> Option<Crossing> {
    // Chords: they leave out 0.4 % of the radius.
    way_crossing(areas, &disc(centre, radius_m).split_off(1))
}

/// The first area that a way through these places, and back to the first, crosses.
#[must_use]
pub fn way_crossing(areas: &[(u16, Area)], places: &[(f64, f64)]) -> Option<Crossing> {
    let bounds = numbered(areas);
    let next = places.iter().cycle().skip(1);
    let mut chords = places.iter().zip(next);
    chords.find_map(|(from, to)| crossed(&bounds, *from, *to))
}

fn numbered(areas: &[(u16, Area)]) -> Vec<(u16, Bound)> {
    let bound = |(id, area): &(u16, Area)| (*id, area.bound());
    areas.iter().map(bound).collect()
}

fn crossed(bounds: &[(u16, Bound)], from: (f64, f64), to: (f64, f64)) -> Option<Crossing> {
    let crossed = |(_, bound): &&(u16, Bound)| bound.is_crossed(from, to);
    bounds.iter().find(crossed).map(|(id, bound)| Crossing {
        area: *id,
        keep_in: bound.keep_in,
    })
}

/// Whether a place, degrees north and east, is outside of an area to stay inside, or inside of one to stay outside.
#[must_use]
pub fn is_breached(areas: &[Area], at: (f64, f64)) -> bool {
    breaches(&bounds(areas), at)
}

/// The first of a mission's items with a place that breaches the areas, as an index: PX4 flies no such mission.
#[must_use]
pub fn first_breach(areas: &[Area], items: &[Item]) -> Option<usize> {
    let bounds = bounds(areas);
    items
        .iter()
        .position(|item| item.is_flown_to() && breaches(&bounds, place(item)))
}

/// The first straight leg of a mission that crosses an area, by the items at its ends, as indices, and the area. PX4 compares only
/// the places of the items, and flies such a mission until it breaches the area.
#[must_use]
pub fn first_leg_across(
    areas: &[(u16, Area)],
    items: &[Item],
) -> Option<((usize, usize), Crossing)> {
    let bounds = numbered(areas);
    let place_from = |first: usize| {
        let mut places = items.iter().enumerate().skip(first);
        places.find(|(_, item)| item.is_flown_to())
    };
    let mut before = None;
    for (at, item) in items.iter().enumerate() {
        let to = match item.command {
            DO_JUMP => place_from(item.params[0] as usize),
            _ if item.is_flown_to() => Some((at, item)),
            _ => continue,
        };
        if let Some(((from, start), (to, end))) = before.zip(to)
            && let Some(crossing) = crossed(&bounds, place(start), place(end))
        {
            return Some(((from, to), crossing));
        }
        // Behind the last round of a loop the mission continues from where it jumps.
        if item.command != DO_JUMP {
            before = to;
        }
    }
    None
}

/// The place of an item, degrees north and east.
fn place(item: &Item) -> (f64, f64) {
    (f64::from(item.x) / 1e7, f64::from(item.y) / 1e7)
}

fn bounds(areas: &[Area]) -> Vec<Bound> {
    areas.iter().map(Area::bound).collect()
}

fn breaches(bounds: &[Bound], at: (f64, f64)) -> bool {
    bounds
        .iter()
        .any(|bound| bound.contains(at) != bound.keep_in)
}

#[cfg(test)]
mod tests {
    use stanag_msgs::enums::AreaType;

    use super::super::shape::Shape;
    use super::super::testing::square;
    use super::*;
    use crate::route::degrees_e7;

    #[test]
    fn the_first_place_of_a_mission_outside_of_its_areas_is_named() {
        let sent = square(AreaType::KeepInPolygon);
        let item = |frame, north, east| Item {
            frame,
            command: 16,
            x: degrees_e7(north),
            y: degrees_e7(east),
            ..Item::default()
        };
        let global = |north, east| item(6, north, east);
        // Of an item without a place, x and y are parameters.
        let mut items = vec![global(47.05, 8.05), item(2, 0.0, 0.0), global(47.05, 8.06)];
        let areas = sent.with(&[]);
        assert_eq!(first_breach(&areas, &items), None);
        items.push(global(47.2, 8.05));
        assert_eq!(first_breach(&areas, &items), Some(3));
        assert_eq!(first_breach(&[], &items), None);
        let keep_out = Area {
            keep_in: false,
            shape: Shape::Circle {
                centre: (47.05, 8.06),
                radius_m: 100.0,
            },
        };
        let areas = sent.with(std::slice::from_ref(&keep_out));
        assert_eq!(first_breach(&areas, &items), Some(2));
    }

    /// A circle about the middle of the square, which measures 11 km by 7.6 km.
    fn in_the_middle(keep_in: bool, radius_m: f64) -> Area {
        let centre = (47.05, 8.05);
        let shape = Shape::Circle { centre, radius_m };
        Area { keep_in, shape }
    }

    #[test]
    fn an_eight_is_flown_along_both_ends_and_through_its_middle() {
        let middle = (47.05, 8.05);
        // 2 km long to the north-east, with ends of 300 m.
        let bearing = std::f64::consts::FRAC_PI_4;
        let way = crate::limits::eight(middle, 1_000.0, 300.0, bearing);
        let from_middle = |at: &(f64, f64)| crate::limits::metres(middle, *at);
        let farthest = way.iter().map(from_middle).fold(0.0, f64::max);
        assert!((farthest - 1_000.0).abs() < 5.0, "{farthest}");
        let crosses =
            |areas: &[(u16, Area)]| way_crossing(areas, &way).map(|crossing| crossing.to_string());
        assert_eq!(crosses(&[(9, in_the_middle(true, 1_010.0))]), None);
        let leaves = "leaves area 9, to stay inside";
        let bounded = [(9, in_the_middle(true, 900.0))];
        assert_eq!(crosses(&bounded).as_deref(), Some(leaves));
        let enters = "enters area 3, to stay outside of";
        let at = |course: f64, distance_m: f64| {
            let centre = crate::limits::moved(middle, course, distance_m);
            let shape = Shape::Circle {
                centre,
                radius_m: 50.0,
            };
            let keep_in = false;
            [(3, Area { keep_in, shape })]
        };
        // On its middle and its tips; not within its ends, nor beside its middle.
        for (course, distance_m) in [(0.0, 0.0), (bearing, 1_000.0), (bearing, -1_000.0)] {
            assert_eq!(crosses(&at(course, distance_m)).as_deref(), Some(enters));
        }
        for (course, distance_m) in [
            (bearing, 700.0),
            (bearing, -700.0),
            (bearing + 1.6, 200.0),
            (bearing + 1.6, -200.0),
            (bearing + 1.6, 1_000.0),
        ] {
            assert_eq!(
                crosses(&at(course, distance_m)),
                None,
                "{course} {distance_m}"
            );
        }
    }

    #[test]
    fn a_circle_is_flown_along_its_rim_alone() {
        let crosses = |areas: &[(u16, Area)], centre, radius_m| {
            circle_crossing(areas, centre, radius_m).map(|crossing| crossing.to_string())
        };
        let (middle, leaves) = ((47.05, 8.05), "leaves area 7, to stay inside");
        let stays_in = square(AreaType::KeepInPolygon).whole().unwrap();
        assert_eq!(crosses(&[], middle, 1_000.0), None);
        assert_eq!(crosses(&stays_in, middle, 3_000.0), None);
        // The sides are 3.8 km away in the east and west.
        assert_eq!(crosses(&stays_in, middle, 4_000.0).as_deref(), Some(leaves));
        assert_eq!(
            crosses(&stays_in, (47.2, 8.05), 10.0).as_deref(),
            Some(leaves)
        );
        let stays_out = [(0, in_the_middle(false, 500.0))];
        assert_eq!(
            crosses(&stays_out, middle, 600.0),
            None,
            "it lies within the rim"
        );
        let enters = "enters an area of the configuration to stay outside of";
        assert_eq!(crosses(&stays_out, middle, 400.0).as_deref(), Some(enters));
        assert_eq!(
            crosses(&stays_out, (47.06, 8.05), 700.0).as_deref(),
            Some(enters)
        );
        assert_eq!(crosses(&stays_out, (47.06, 8.05), 500.0), None);
        let round = [(9, in_the_middle(true, 500.0))];
        assert_eq!(crosses(&round, middle, 490.0), None);
        let leaves = "leaves area 9, to stay inside";
        assert_eq!(crosses(&round, middle, 510.0).as_deref(), Some(leaves));
        // A spike between two of the places on the rim, 174 m apart: its tip is 956 m away from the centre.
        let spike = Shape::Polygon(vec![
            (47.030075, 8.047741),
            (47.030075, 8.047141),
            (47.041435, 8.0489),
        ]);
        let keep_in = false;
        let spike = [(
            3,
            Area {
                keep_in,
                shape: spike,
            },
        )];
        assert!(crosses(&spike, middle, 1_000.0).is_some());
        assert_eq!(crosses(&spike, middle, 900.0), None);
    }

    #[test]
    fn the_first_leg_across_an_area_is_named_though_its_ends_are_within() {
        let item = |(north, east): (f64, f64)| Item {
            frame: 6,
            command: 16,
            x: degrees_e7(north),
            y: degrees_e7(east),
            ..Item::default()
        };
        let across = |areas: &[(u16, Area)], places: &[(f64, f64)]| {
            let items: Vec<Item> = places.iter().copied().map(item).collect();
            first_leg_across(areas, &items).map(|(ends, crossing)| (ends, crossing.area))
        };
        let stays_out = square(AreaType::KeepOutPolygon).whole().unwrap();
        let (west, east) = ((47.05, 7.9), (47.05, 8.2));
        let (north_west, north_east) = ((47.2, 7.9), (47.2, 8.2));
        let around = [west, north_west, north_east, east];
        assert_eq!(across(&stays_out, &around), None);
        assert_eq!(across(&[], &[west, east]), None);
        let straight = [north_west, west, east];
        assert_eq!(across(&stays_out, &straight), Some(((1, 2), 7)));
        // Beside a circle by 111 m, and across it; 360 m of the leg are within.
        let round = [(0, in_the_middle(false, 500.0))];
        let beside = |north| [(north, 7.9), (north, 8.2)];
        assert_eq!(across(&round, &beside(47.0555)), None);
        assert_eq!(across(&round, &beside(47.0542)), Some(((0, 1), 0)));
        assert_eq!(
            across(&round, &[(47.05, 7.9), (47.05, 8.0)]),
            None,
            "short of it"
        );
        // An L to stay inside: the straight way between its ends leaves it, as by no circle.
        let corners = [
            (47.0, 8.0),
            (47.0, 8.1),
            (47.02, 8.1),
            (47.02, 8.02),
            (47.1, 8.02),
            (47.1, 8.0),
        ];
        let shape = Shape::Polygon(corners.to_vec());
        let keep_in = true;
        let bent = [(9, Area { keep_in, shape })];
        let (far_east, corner, far_north) = ((47.01, 8.09), (47.01, 8.01), (47.09, 8.01));
        assert_eq!(across(&bent, &[far_east, corner, far_north]), None);
        assert_eq!(across(&bent, &[far_east, far_north]), Some(((0, 1), 9)));
        let round = [(8, in_the_middle(true, 5_000.0))];
        assert_eq!(across(&round, &[(47.01, 8.05), (47.09, 8.05)]), None);
        // What is between two places without being one is passed over, and a loop leads back.
        let jump = Item {
            frame: 2,
            command: DO_JUMP,
            params: [0.0, 3.0, 0.0, 0.0],
            ..Item::default()
        };
        let looped = [item(far_east), item(corner), item(far_north), jump];
        let found = first_leg_across(&bent, &looped).map(|(ends, _)| ends);
        assert_eq!(found, Some((2, 0)));
        let looped = [item(far_east), jump, item(corner), item(far_north)];
        assert_eq!(first_leg_across(&bent, &looped), None);
    }

    #[test]
    fn a_leg_across_180_degrees_is_compared_on_either_side() {
        let leg = |north, from, to| {
            [from, to].map(|east| Item {
                frame: 6,
                command: 16,
                x: degrees_e7(north),
                y: degrees_e7(east),
                ..Item::default()
            })
        };
        let polygon = |east: f64| Area {
            keep_in: false,
            shape: Shape::Polygon(vec![
                (-16.8, east - 0.01),
                (-16.8, east + 0.01),
                (-16.6, east + 0.01),
                (-16.6, east - 0.01),
            ]),
        };
        let circle = Area {
            keep_in: false,
            shape: Shape::Circle {
                centre: (-16.7, 179.9995),
                radius_m: 500.0,
            },
        };
        for area in [polygon(179.95), polygon(-179.95), circle] {
            let areas = [(1, area)];
            let across = |items: [Item; 2]| first_leg_across(&areas, &items).is_some();
            assert!(across(leg(-16.7, 179.9, -179.9)), "{areas:?}");
            assert!(across(leg(-16.7, -179.9, 179.9)), "{areas:?}");
            assert!(!across(leg(-16.5, 179.9, -179.9)), "{areas:?}");
        }
        // The other way around the globe it would be crossed.
        let areas = [(1, polygon(8.0))];
        assert_eq!(first_leg_across(&areas, &leg(-16.7, 179.9, -179.9)), None);
    }
}
