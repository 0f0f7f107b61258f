//! A square of a CUCS, for tests.

use stanag_msgs::Bam32;
use stanag_msgs::enums::AreaType;
use stanag_msgs::messages::AreaVertex;

use super::received::Areas;

pub(super) fn vertex(
    area: u16,
    kind: AreaType,
    count: u8,
    number: u8,
    at: (f64, f64),
) -> AreaVertex {
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

pub(super) const CORNERS: [(f64, f64); 4] = [(47.0, 8.0), (47.0, 8.1), (47.1, 8.1), (47.1, 8.0)];

pub(super) fn square(kind: AreaType) -> Areas {
    let mut areas = Areas::default();
    // In any order.
    for number in [3, 1, 4, 2] {
        let at = CORNERS[usize::from(number) - 1];
        areas.store(&vertex(7, kind, 4, number, at)).unwrap();
    }
    areas
}
