//! Areas as the fence that is sent to PX4, once nothing speaks against any of them.

use geo::Validation;
use mavlink_link::service::mission::{FRAME_GLOBAL, Item};

use super::{Area, AreaError, MAX_VERTICES, Reason, Shape, outline};
use crate::route::degrees_e7;

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

/// The fence of the configured areas and those of a CUCS, checked: what is sent to PX4.
///
/// `vehicle` is where it is, where it has told so.
///
/// # Errors
/// The first area that cannot be flown with, and its vertex.
pub fn fence(
    configured: &[Area],
    sent: &[(u16, Area)],
    vehicle: Option<(f64, f64)>,
) -> Result<Vec<FencePoint>, AreaError> {
    let all = configured.iter().map(|area| (0, area));
    let all: Vec<(u16, &Area)> = all
        .chain(sent.iter().map(|(id, area)| (*id, area)))
        .collect();
    let mut items: Vec<FencePoint> = Vec::new();
    for (id, area) in &all {
        let fault = |vertex, reason| AreaError {
            area: *id,
            vertex,
            reason,
        };
        if *id != 0 && area.keep_in && configured.iter().any(|area| area.keep_in) {
            return Err(fault(None, Reason::Widens));
        }
        if let Shape::Polygon(corners) = &area.shape
            && !outline(corners).is_valid()
        {
            return Err(fault(None, Reason::Outline));
        }
        if let (Some(at), false) = (vehicle, area.keep_in)
            && area.contains(at)
        {
            return Err(fault(None, Reason::Breached("inside")));
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
    let inside: Vec<_> = all.iter().filter(|(_, area)| area.keep_in).collect();
    if let (Some(at), Some((id, _))) = (vehicle, inside.last())
        && !inside.iter().any(|(_, area)| area.contains(at))
    {
        return Err(AreaError {
            area: *id,
            vertex: None,
            reason: Reason::Breached("outside"),
        });
    }
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
