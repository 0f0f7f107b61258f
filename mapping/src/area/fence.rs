//! Areas as PX4 takes them, or the refusal of the first that cannot be flown with.

use geo::Validation;
use mavlink_link::service::mission::{FRAME_GLOBAL, Item};

use super::error::{AreaError, Reason};
use super::shape::{Area, Shape, across_180, outline};
use crate::route::degrees_e7;

/// What PX4 holds of a geofence: corners and circles together.
pub(super) const MAX_VERTICES: usize = 64;

/// A corner or circle of a fence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FencePoint {
    /// Area ID; 0 is one of the configuration.
    pub area: u16,
    /// Vertex Number.
    pub vertex: u8,
    /// As PX4 takes it.
    pub item: Item,
}

/// The vehicle that is to hold a fence, as far as it is known.
#[derive(Debug, Clone, Copy, Default)]
pub struct Holder {
    /// Its position, degrees north and east.
    pub position: Option<(f64, f64)>,
    /// Its home.
    pub home: Option<(f64, f64)>,
    /// Whether it is one that allows every area to stay inside, as PX4 before v1.15: there a further one makes the space larger.
    pub unites: bool,
}

/// The fence of the configured areas and those of a CUCS, checked: what is sent to PX4.
///
/// # Errors
/// The first area that cannot be flown with, and its vertex.
pub fn fence(
    configured: &[Area],
    sent: &[(u16, Area)],
    holder: &Holder,
) -> Result<Vec<FencePoint>, AreaError> {
    let all = (1..).zip(configured);
    let all = all.map(|(number, area)| (0, Some(number), area));
    let all: Vec<(u16, Option<usize>, &Area)> = all
        .chain(sent.iter().map(|(id, area)| (*id, None, area)))
        .collect();
    let mut items: Vec<FencePoint> = Vec::new();
    for (id, number, area) in &all {
        let fault = |vertex, reason| AreaError {
            area: *id,
            configured: *number,
            vertex,
            reason,
        };
        if holder.unites && *id != 0 && area.keep_in && configured.iter().any(|area| area.keep_in) {
            return Err(fault(None, Reason::Widens));
        }
        if let Shape::Polygon(corners) = &area.shape {
            if let Some((at, span_deg)) = across_180(corners) {
                let vertex = u8::try_from(at + 1).ok();
                return Err(fault(vertex, Reason::Across180(span_deg)));
            }
            if !outline(corners).is_valid() {
                return Err(fault(None, Reason::Outline));
            }
        }
        for (who, place) in [("the vehicle", holder.position), ("home", holder.home)] {
            if place.is_some_and(|at| area.contains(at) != area.keep_in) {
                let side = if area.keep_in { "outside" } else { "inside" };
                return Err(fault(None, Reason::Breached(who, side)));
            }
        }
        let room = MAX_VERTICES - items.len();
        let new = area.items();
        if new.len() > room {
            let vertex = u8::try_from(room + 1).ok();
            return Err(fault(vertex, Reason::TooMany(items.len() + new.len())));
        }
        items.extend((1..).zip(new).map(|(vertex, item)| FencePoint {
            area: *id,
            vertex,
            item,
        }));
    }
    items.sort_by_key(|point| point.item.command >= CIRCLE_INCLUSION);
    Ok(items)
}

impl Area {
    fn items(&self) -> Vec<Item> {
        let item = |command: u16, first: f64, (latitude, longitude): (f64, f64)| Item {
            frame: FRAME_GLOBAL,
            command: if self.keep_in { command } else { command + 1 },
            current: false,
            autocontinue: false,
            params: [first as f32, 0.0, 0.0, 0.0],
            x: degrees_e7(latitude),
            y: degrees_e7(longitude),
            z: 0.0,
        };
        match &self.shape {
            Shape::Polygon(corners) => corners
                .iter()
                .map(|at| item(POLYGON_INCLUSION, corners.len() as f64, *at))
                .collect(),
            Shape::Circle { centre, radius_m } => {
                vec![item(CIRCLE_INCLUSION, *radius_m, *centre)]
            }
        }
    }
}

/// MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION; the exclusion is the next number.
const POLYGON_INCLUSION: u16 = 5001;
/// MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION; the exclusion is the next number.
const CIRCLE_INCLUSION: u16 = 5003;

#[cfg(test)]
mod tests {
    use stanag_msgs::enums::AreaType;
    use stanag_msgs::messages::AreaVertex;

    use super::super::crossing::is_breached;
    use super::super::received::Areas;
    use super::super::testing::{CORNERS, square, vertex};
    use super::*;

    /// A vehicle at a place, and nothing else is known.
    fn at(position: (f64, f64)) -> Holder {
        Holder {
            position: Some(position),
            ..Holder::default()
        }
    }

    fn unknown() -> Holder {
        Holder::default()
    }

    #[test]
    fn a_square_becomes_four_items_and_a_circle_one() {
        let mut areas = square(AreaType::KeepInPolygon);
        let circle = AreaVertex {
            radius: Some(250.0),
            ..vertex(8, AreaType::KeepOutCircle, 1, 1, (47.05, 8.05))
        };
        areas.store(&circle).unwrap();
        let items = fence(&[], &areas.whole().unwrap(), &at((47.01, 8.01))).unwrap();
        let reported: Vec<_> = items
            .iter()
            .map(|point| (point.item.command, point.item.params[0]))
            .collect();
        assert_eq!(
            reported,
            [
                (5001, 4.0),
                (5001, 4.0),
                (5001, 4.0),
                (5001, 4.0),
                (5004, 250.0)
            ]
        );
        assert!((i64::from(items[2].item.x) - 471_000_000).abs() <= 1);
    }

    #[test]
    fn a_fence_that_the_vehicle_breaks_already_is_refused() {
        let stays_in = square(AreaType::KeepInPolygon).whole().unwrap();
        let stays_out = square(AreaType::KeepOutPolygon).whole().unwrap();
        let (inside, outside) = (at((47.05, 8.05)), at((47.2, 8.05)));
        let breached = |who, side| Err(Reason::Breached(who, side));
        let of = |areas: &[(u16, Area)], holder: Holder| {
            let made = fence(&[], areas, &holder);
            made.map(|_| ()).map_err(|fault| fault.reason)
        };
        assert_eq!(of(&stays_in, inside), Ok(()));
        assert_eq!(of(&stays_in, outside), breached("the vehicle", "outside"));
        assert_eq!(of(&stays_out, inside), breached("the vehicle", "inside"));
        assert_eq!(of(&stays_out, outside), Ok(()));
        let configured: Vec<Area> = stays_in.iter().map(|(_, area)| area.clone()).collect();
        let fault = fence(&configured, &[], &outside).unwrap_err().to_string();
        let expected = "area 1 of the configuration: the vehicle is currently outside it";
        assert!(fault.starts_with(expected), "{fault}");
        // PX4 leaves out what home breaches, and bounds the vehicle by the rest.
        let home = |holder: Holder, home: Holder| Holder {
            home: home.position,
            ..holder
        };
        assert_eq!(
            of(&stays_in, home(inside, outside)),
            breached("home", "outside")
        );
        assert_eq!(
            of(&stays_out, home(outside, inside)),
            breached("home", "inside")
        );
        // And it allows only where both overlap.
        let beyond = Area {
            keep_in: true,
            shape: Shape::Circle {
                centre: (47.2, 8.05),
                radius_m: 1000.0,
            },
        };
        let two = [stays_in, vec![(8, beyond)]].concat();
        assert_eq!(of(&two, unknown()), Ok(()));
        for holder in [inside, outside] {
            assert_eq!(of(&two, holder), breached("the vehicle", "outside"));
        }
    }

    #[test]
    fn a_station_narrows_what_the_configuration_sets_and_does_not_widen_it() {
        let area = Area {
            keep_in: true,
            shape: Shape::Circle {
                centre: (47.05, 8.05),
                radius_m: 500.0,
            },
        };
        let configured = std::slice::from_ref(&area);
        let stays_in = square(AreaType::KeepInPolygon).whole().unwrap();
        assert_eq!(fence(configured, &stays_in, &unknown()).unwrap().len(), 5);
        let unites = Holder {
            unites: true,
            ..Holder::default()
        };
        let fault = fence(configured, &stays_in, &unites).unwrap_err();
        assert_eq!((fault.area, fault.reason), (7, Reason::Widens));
        let stays_out = square(AreaType::KeepOutPolygon).whole().unwrap();
        assert_eq!(fence(configured, &stays_out, &unites).unwrap().len(), 5);
        let both = square(AreaType::KeepInPolygon).with(configured);
        assert!(!is_breached(&both, (47.05, 8.05)));
        assert!(is_breached(&both, (47.01, 8.05)), "in one of them");
    }

    #[test]
    fn circles_come_last() {
        let circle = |keep_in| Area {
            keep_in,
            shape: Shape::Circle {
                centre: (47.05, 8.05),
                radius_m: 500.0,
            },
        };
        let mut sent = square(AreaType::KeepOutPolygon).whole().unwrap();
        sent.insert(0, (6, circle(false)));
        let points = fence(&[circle(true)], &sent, &unknown()).unwrap();
        let order: Vec<_> = points
            .iter()
            .map(|point| (point.area, point.vertex, point.item.command))
            .collect();
        assert_eq!(
            order,
            [
                (7, 1, 5002),
                (7, 2, 5002),
                (7, 3, 5002),
                (7, 4, 5002),
                (0, 1, 5003),
                (6, 1, 5004)
            ]
        );
    }

    #[test]
    fn crossed_sides_and_too_many_corners_are_refused() {
        let mut areas = Areas::default();
        for (number, corner) in [(1, 0), (2, 2), (3, 1), (4, 3)] {
            let at = CORNERS[corner];
            areas
                .store(&vertex(1, AreaType::KeepInPolygon, 4, number, at))
                .unwrap();
        }
        assert_eq!(
            fence(&[], &areas.whole().unwrap(), &unknown())
                .unwrap_err()
                .reason,
            Reason::Outline
        );
        let many = |from: usize| -> Area {
            let corner = |n: usize| {
                let angle = std::f64::consts::TAU * n as f64 / 33.0;
                (47.0 + 0.1 * angle.sin(), from as f64 + 0.1 * angle.cos())
            };
            Area {
                keep_in: false,
                shape: Shape::Polygon((0..33).map(corner).collect()),
            }
        };
        let two = [(1, many(8)), (2, many(9))];
        let fault = fence(&[], &two, &unknown()).unwrap_err();
        assert_eq!(
            (fault.area, fault.vertex, fault.reason),
            (2, Some(32), Reason::TooMany(66))
        );
    }

    #[test]
    fn a_polygon_across_180_degrees_is_refused_and_a_circle_is_not() {
        let polygon = |keep_in, corners: &[(f64, f64)]| Area {
            keep_in,
            shape: Shape::Polygon(corners.to_vec()),
        };
        let corners = [
            (-16.8, 179.9),
            (-16.8, -179.9),
            (-16.6, -179.9),
            (-16.6, 179.9),
        ];
        for keep_in in [true, false] {
            let area = polygon(keep_in, &corners);
            let fault = fence(&[], &[(7, area.clone())], &at((-16.7, 179.9995))).unwrap_err();
            let span_deg = 359.8;
            assert!(
                matches!(fault.reason, Reason::Across180(found) if (found - span_deg).abs() < 1e-6),
                "{fault}"
            );
            assert_eq!((fault.area, fault.vertex), (7, Some(1)));
            let later = polygon(keep_in, &corners[1..]);
            assert_eq!(
                fence(&[later], &[], &unknown()).unwrap_err().vertex,
                Some(2)
            );
        }
        let circle = |centre| Area {
            keep_in: true,
            shape: Shape::Circle {
                centre,
                radius_m: 500.0,
            },
        };
        let across = [(7, circle((-16.7, -179.9995)))];
        assert!(fence(&[], &across, &at((-16.7, 179.9995))).is_ok());
        let beside = polygon(true, &[(-16.8, 179.8), (-16.8, 180.0), (-16.6, 180.0)]);
        assert!(fence(&[beside], &[], &unknown()).is_ok());
    }
}
