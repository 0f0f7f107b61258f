//! Data of a map besides the vehicles' positions: routes, fences, rally points, home. It rarely changes and is large, so it
//! has its own /map.json, apart from the status.
//!
//! A route is the one that was read back from the vehicle. A flag shows whether the vehicle still reports it, and the
//! fence.

use mapping::altitude::Level;
use mapping::area::{Area, Shape};
use mapping::rally::Height;
use mavlink_link::service::mission::Item;
use serde::Serialize;

use super::Bridge;
use crate::session::aircraft::Aircraft;

/// One vehicle on the map. Places are degrees north and east; altitudes are metres above mean sea level.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct VehicleMap {
    /// Vehicle ID.
    pub id: String,
    /// HOME_POSITION; `None` if the vehicle has not reported it.
    pub home: Option<[f64; 3]>,
    /// The route that was uploaded and read back.
    pub route: Option<RouteMap>,
    /// The geofence: areas of the configuration, and those loaded by ground stations.
    pub fence: FenceMap,
    /// The rally points of the configuration.
    pub rally: Vec<PlaceMap>,
}

/// A route.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RouteMap {
    /// 13000's Mission ID.
    pub name: String,
    /// Whether the vehicle reports it as its mission; `None` if it reports none.
    pub aboard: Option<bool>,
    /// The waypoints in the order that they are flown.
    pub waypoints: Vec<WaypointMap>,
    /// Every place that is flown to, in order: curves as chords, and landings.
    pub path: Vec<PlaceMap>,
}

/// A waypoint.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct WaypointMap {
    /// The CUCS's number.
    pub number: u16,
    /// Its place.
    #[serde(flatten)]
    pub place: PlaceMap,
    /// The speed commanded on the leg to it, m/s.
    pub speed_m_s: Option<f64>,
}

/// A place.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PlaceMap {
    /// Degrees north and east.
    pub at: [f64; 2],
    /// Metres above mean sea level; `None` for a height above home while home is not known.
    pub amsl_m: Option<f64>,
}

/// A geofence.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FenceMap {
    /// Whether the vehicle reports these areas; `None` if there are none, or it reports nothing.
    pub aboard: Option<bool>,
    /// The areas.
    pub areas: Vec<AreaMap>,
}

/// One area of a geofence.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AreaMap {
    /// Whether the vehicle must stay inside; otherwise outside.
    pub keep_in: bool,
    /// Corners in order; for a circle only its centre.
    pub corners: Vec<[f64; 2]>,
    /// Radius of a circle, m.
    pub radius_m: Option<f64>,
}

impl Bridge {
    /// The map's data of each vehicle.
    #[must_use]
    pub fn map(&self) -> Vec<VehicleMap> {
        self.aircraft.iter().map(vehicle).collect()
    }
}

fn vehicle(aircraft: &Aircraft) -> VehicleMap {
    let telemetry = &aircraft.vehicle.telemetry;
    let home = telemetry.home;
    let home_m = home.map(|home| home.amsl_m);
    let named = telemetry.mission.filter(|_| aircraft.vehicle.live());
    let route = aircraft.mission.uploaded().map(|uploaded| RouteMap {
        name: uploaded.mission_name.clone(),
        aboard: named
            .filter(|named| named.mission_id != 0 && uploaded.mission_id != 0)
            .map(|named| named.mission_id == uploaded.mission_id),
        waypoints: (uploaded.compiled.order.iter())
            .map(|leg| WaypointMap {
                number: leg.number,
                place: place((leg.latitude, leg.longitude), leg.level, home_m),
                speed_m_s: leg.speed_m_s,
            })
            .collect(),
        path: (uploaded.compiled.items.iter())
            .filter_map(|item| flown_to(item, home_m))
            .collect(),
    });
    let (areas, fence_id) = aircraft.mission.fence();
    let known = named.map(|named| named.fence_id);
    let (rally, _) = aircraft.mission.rally();
    let rally = rally.iter().map(|point| {
        let level = match point.height {
            Height::AboveHome(m) => Level::AboveHome(m),
            Height::Amsl(m) => Level::Amsl(m),
        };
        place(point.place, level, home_m)
    });
    VehicleMap {
        id: aircraft.id().to_string(),
        home: home.map(|home| [home.latitude, home.longitude, home.amsl_m]),
        route,
        fence: FenceMap {
            aboard: (fence_id.zip(known))
                .filter(|_| !areas.is_empty())
                .map(|(should, named)| should == named),
            areas: areas.iter().map(area).collect(),
        },
        rally: rally.collect(),
    }
}

pub(crate) fn place(at: (f64, f64), level: Level, home_m: Option<f64>) -> PlaceMap {
    PlaceMap {
        at: [at.0, at.1],
        amsl_m: match level {
            Level::Amsl(m) => Some(m),
            Level::AboveHome(_) => home_m.map(|home_m| level.amsl(home_m)),
        },
    }
}

/// The place that an item is flown to. A DO command has none, although it may name a place (such as what a camera looks
/// at).
pub(crate) fn flown_to(item: &Item, home_m: Option<f64>) -> Option<PlaceMap> {
    if !item.is_global() || item.command >= MAV_CMD_NAV_LAST {
        return None;
    }
    let level = Level::of_frame(item.frame, item.z.into())?;
    let at = (f64::from(item.x) * 1e-7, f64::from(item.y) * 1e-7);
    Some(place(at, level, home_m))
}

fn area(area: &Area) -> AreaMap {
    let (corners, radius_m) = match &area.shape {
        Shape::Polygon(corners) => (corners.clone(), None),
        Shape::Circle { centre, radius_m } => (vec![*centre], Some(*radius_m)),
    };
    AreaMap {
        keep_in: area.keep_in,
        corners: corners.iter().map(|at| [at.0, at.1]).collect(),
        radius_m,
    }
}

/// MAV_CMDs below this number are flown to.
const MAV_CMD_NAV_LAST: u16 = 95;
