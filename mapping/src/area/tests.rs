//! Areas by themselves and together, as fences.

use stanag_msgs::Bam32;
use stanag_msgs::enums::AreaType;
use stanag_msgs::messages::AreaVertex;

use super::{Area, Areas, Reason, Shape, fence};

fn vertex(area: u16, kind: AreaType, count: u8, number: u8, at: (f64, f64)) -> AreaVertex {
    AreaVertex {
        area_id: Some(area),
        area_type: Some(kind),
        vertex_count: Some(count),
        vertex_number: Some(number),
        latitude: Some(Bam32::from_degrees(at.0)),
        longitude: Some(Bam32::from_degrees(at.1)),
        ..AreaVertex::default()
    }
}

const CORNERS: [(f64, f64); 4] = [(47.0, 8.0), (47.0, 8.1), (47.1, 8.1), (47.1, 8.0)];

fn square(kind: AreaType) -> Areas {
    let mut areas = Areas::default();
    // In any order.
    for number in [3, 1, 4, 2] {
        let at = CORNERS[usize::from(number) - 1];
        areas.store(&vertex(7, kind, 4, number, at)).unwrap();
    }
    areas
}

#[test]
fn a_square_becomes_four_items_and_a_circle_one() {
    let mut areas = square(AreaType::KeepInPolygon);
    let circle = AreaVertex {
        radius: Some(250.0),
        ..vertex(8, AreaType::KeepOutCircle, 1, 1, (47.05, 8.05))
    };
    areas.store(&circle).unwrap();
    let items = fence(&[], &areas.whole().unwrap(), Some((47.01, 8.01))).unwrap();
    let told: Vec<_> = items
        .iter()
        .map(|point| (point.item.command, point.item.params[0]))
        .collect();
    assert_eq!(
        told,
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
fn what_is_not_whole_is_refused_with_its_vertex() {
    let mut areas = Areas::default();
    for number in [1, 2, 4] {
        let at = CORNERS[usize::from(number) - 1];
        areas
            .store(&vertex(7, AreaType::KeepInPolygon, 4, number, at))
            .unwrap();
    }
    let fault = areas.whole().unwrap_err();
    assert_eq!(
        (fault.area, fault.vertex, fault.reason),
        (7, Some(3), Reason::NotReceived)
    );
    assert_eq!(
        fault.to_string(),
        "area 7 vertex 3: it has not been received"
    );
    // Another definition takes the place of the first.
    for number in [3, 1, 2] {
        let at = CORNERS[usize::from(number) - 1];
        let triangle = vertex(7, AreaType::KeepInPolygon, 3, number, at);
        areas.store(&triangle).unwrap();
    }
    assert_eq!(fence(&[], &areas.whole().unwrap(), None).unwrap().len(), 3);
}

#[test]
fn a_fence_that_the_vehicle_breaks_already_is_refused() {
    let stays_in = square(AreaType::KeepInPolygon).whole().unwrap();
    let stays_out = square(AreaType::KeepOutPolygon).whole().unwrap();
    let inside = Some((47.05, 8.05));
    let outside = Some((47.2, 8.05));
    assert!(fence(&[], &stays_in, inside).is_ok());
    assert_eq!(
        fence(&[], &stays_in, outside).unwrap_err().reason,
        Reason::Breached("outside")
    );
    assert_eq!(
        fence(&[], &stays_out, inside).unwrap_err().reason,
        Reason::Breached("inside")
    );
    assert!(fence(&[], &stays_out, outside).is_ok());
}

#[test]
fn a_station_cannot_widen_what_the_configuration_sets() {
    let area = Area {
        keep_in: true,
        shape: Shape::Circle {
            centre: (47.05, 8.05),
            radius_m: 500.0,
        },
    };
    let stays_in = square(AreaType::KeepInPolygon).whole().unwrap();
    let fault = fence(std::slice::from_ref(&area), &stays_in, None).unwrap_err();
    assert_eq!((fault.area, fault.reason), (7, Reason::Widens));
    let stays_out = square(AreaType::KeepOutPolygon).whole().unwrap();
    assert_eq!(fence(&[area], &stays_out, None).unwrap().len(), 5);
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
        fence(&[], &areas.whole().unwrap(), None)
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
    let fault = fence(&[], &two, None).unwrap_err();
    assert_eq!(
        (fault.area, fault.vertex, fault.reason),
        (2, Some(32), Reason::TooMany(66))
    );
}

#[test]
fn a_corner_that_is_none_is_refused_at_once() {
    let mut areas = Areas::default();
    let good = vertex(1, AreaType::KeepInPolygon, 4, 1, CORNERS[0]);
    let refused = |areas: &mut Areas, vertex: AreaVertex| areas.store(&vertex).unwrap_err();
    for (vertex, reason) in [
        (
            AreaVertex {
                area_id: Some(0),
                ..good.clone()
            },
            Reason::Missing("Area ID above 0"),
        ),
        (
            AreaVertex {
                vertex_count: Some(2),
                ..good.clone()
            },
            Reason::Count(2, "3 to 64"),
        ),
        (
            AreaVertex {
                vertex_number: Some(5),
                ..good.clone()
            },
            Reason::Number(5, 4),
        ),
        (
            AreaVertex {
                area_type: Some(AreaType::Unknown(9)),
                ..good.clone()
            },
            Reason::Type(9),
        ),
    ] {
        assert_eq!(refused(&mut areas, vertex).reason, reason);
    }
    let circle = vertex(1, AreaType::KeepInCircle, 1, 1, CORNERS[0]);
    assert_eq!(
        refused(&mut areas, circle).reason,
        Reason::Missing("Radius")
    );
    assert!(areas.is_empty());
}
