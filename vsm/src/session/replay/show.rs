//! What the page shows of a moment.

use std::cmp::Reverse;
use std::time::Duration;

use mapping::altitude::Level;
use mapping::mode::Px4Mode;
use mavlink_link::dialect::MavMissionType;
use mavlink_link::service::mission::Item;
use serde::Serialize;
use stanag_msgs::Id;
use stanag_msgs::enums::LoiBitmap;

use super::Timeline;
use super::stations::OfVehicle;
use super::vehicle::{Sample, Vehicle};
use crate::session::authority::rules::CONTROL;
use crate::session::bridge::map::{
    AreaMap, FenceMap, PlaceMap, RouteMap, VehicleMap, WaypointMap, flown_to, place,
};
use crate::session::bridge::status::{
    AlertStatus, BandStatus, HandoverStatus, HolderStatus, LinkStatus, StationStatus, Status,
    VehicleStatus,
};
use crate::session::link::state::SILENCE;

/// A place of a track: ms since 1970, degrees north and east, metres above mean sea level.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TrackPoint(pub u64, pub f64, pub f64, pub f64);

impl Timeline {
    /// How everything stood.
    #[must_use]
    pub fn status(&self, moment: Duration) -> Status {
        let stations = self.stations.known.iter().filter_map(|(id, known)| {
            let (at, address) = known.at(moment)?;
            Some(StationStatus {
                id: id.to_string(),
                address: Some(address.to_string()),
                proof: "recorded",
                silent_s: Some(moment.saturating_sub(*at).as_secs_f64()),
                guard: None,
                web: None,
                profile: Vec::new(),
            })
        });
        let begun = self.span.map_or(moment, |(first, _)| first);
        Status {
            vsm: self
                .stations
                .vsm
                .map_or_else(|| "of a recording".to_owned(), |id| id.to_string()),
            uptime_s: moment.saturating_sub(begun).as_secs_f64(),
            warnings: self.notes.clone(),
            stations: stations.collect(),
            vehicles: self.ids().map(|id| self.vehicle(id, moment)).collect(),
            ..Status::default()
        }
    }

    /// What a map showed beside it.
    #[must_use]
    pub fn map(&self, moment: Duration) -> Vec<VehicleMap> {
        self.ids().map(|id| self.shapes(id, moment)).collect()
    }

    /// Where each vehicle was, from the first to the last moment, in at most so many points.
    #[must_use]
    pub fn tracks(&self, max_points: usize) -> Vec<(String, Vec<TrackPoint>)> {
        let tracks = self.vehicles.iter().map(|(id, vehicle)| {
            let mut points: Vec<TrackPoint> = Vec::new();
            for (at, sample) in &vehicle.samples.0 {
                let Some(place) = sample.position else {
                    continue;
                };
                let ms = u64::try_from(at.as_millis()).unwrap_or(u64::MAX);
                let next = TrackPoint(ms, place.latitude, place.longitude, place.amsl_m);
                if points
                    .last()
                    .is_none_or(|last| (last.1, last.2) != (next.1, next.2))
                {
                    points.push(next);
                }
            }
            let step = points.len().div_ceil(max_points.max(1)).max(1);
            (id.to_string(), points.into_iter().step_by(step).collect())
        });
        tracks.collect()
    }

    /// Of vehicles with a recording of their own, and of those that stations alone were sent something of.
    fn ids(&self) -> impl Iterator<Item = Id> {
        let mut ids: Vec<Id> = self.vehicles.keys().copied().collect();
        ids.extend(
            self.stations
                .vehicles
                .keys()
                .filter(|id| !self.vehicles.contains_key(id)),
        );
        ids.into_iter()
    }

    fn vehicle(&self, id: Id, moment: Duration) -> VehicleStatus {
        let sample = self
            .vehicles
            .get(&id)
            .and_then(|one| one.samples.at(moment));
        let sample = sample.map(|(_, sample)| sample);
        let known = self.stations.vehicles.get(&id);
        let mode_at = sample.and_then(|sample| sample.mode_at);
        let age = mode_at.map(|at| moment.saturating_sub(at));
        let live = age.is_some_and(|age| age < SILENCE);
        let holders = known.map_or_else(Vec::new, |known| holders(known, moment));
        let controls = |one: &&HolderStatus| LoiBitmap::from_raw(one.loi).intersects(CONTROL);
        let mode = sample.and_then(|sample| sample.mode);
        VehicleStatus {
            whole: true,
            id: id.to_string(),
            tail_number: known
                .and_then(|known| known.tail_number.at(moment))
                .map_or_else(String::new, |(_, tail)| tail.clone()),
            live,
            mode: mode.map(Px4Mode::name),
            armed: sample.and_then(|sample| sample.armed),
            position: sample
                .and_then(|sample| sample.position)
                .map(|at| [at.latitude, at.longitude, at.amsl_m]),
            motion: sample.map(|sample| sample.motion).unwrap_or_default(),
            battery_percent: sample.and_then(|sample| sample.battery),
            on_ground: sample.and_then(|sample| sample.on_ground),
            flies_to: known
                .filter(|_| mode == Some(Px4Mode::MISSION))
                .and_then(|known| known.flies_to.at(moment)?.1),
            alerts: known.map_or_else(Vec::new, |known| alerts(known, moment)),
            looks_at: sample
                .filter(|_| live)
                .map_or_else(Vec::new, |sample: &Sample| sample.looks_at.clone()),
            controller: holders.iter().find(controls).map(|one| one.id.clone()),
            operator_control: None,
            rights: holders
                .iter()
                .map(|one| (one.id.clone(), one.loi))
                .collect(),
            holders,
            handovers: known.map_or_else(Vec::new, |known| handovers(known, moment)),
            mission_items: None,
            mission_curves: None,
            // By the configuration, which is not recorded.
            altitude_band: BandStatus {
                lowest_m: None,
                highest_m: None,
                outside: false,
            },
            rally_points: None,
            link: LinkStatus::recorded(age),
        }
    }

    fn shapes(&self, id: Id, moment: Duration) -> VehicleMap {
        let vehicle = self.vehicles.get(&id);
        let sample = vehicle.and_then(|one| one.samples.at(moment));
        let home = sample.and_then(|(_, sample)| sample.home);
        let home_m = home.map(|home| home.amsl_m);
        let plan = |kind| vehicle.and_then(|one: &Vehicle| one.plan(kind, moment));
        let known = self.stations.vehicles.get(&id);
        let route = plan(MavMissionType::MAV_MISSION_TYPE_MISSION).map(|items| {
            let path: Vec<PlaceMap> = items
                .iter()
                .filter_map(|one| flown_to(one, home_m))
                .collect();
            let mission = known.and_then(|known| known.mission.at(moment));
            RouteMap {
                name: mission.map_or_else(String::new, |(_, name)| name.clone()),
                aboard: None,
                waypoints: known.map_or_else(Vec::new, |known| waypoints(known, &path, moment)),
                path,
            }
        });
        let fence = plan(MavMissionType::MAV_MISSION_TYPE_FENCE).unwrap_or_default();
        let rally = plan(MavMissionType::MAV_MISSION_TYPE_RALLY).unwrap_or_default();
        VehicleMap {
            id: id.to_string(),
            home: home.map(|home| [home.latitude, home.longitude, home.amsl_m]),
            route,
            fence: FenceMap {
                aboard: None,
                areas: areas(fence),
            },
            rally: rally
                .iter()
                .filter_map(|item| {
                    let level = Level::of_frame(item.frame, item.z.into())?;
                    Some(place(degrees(item), level, home_m))
                })
                .collect(),
        }
    }
}

fn holders(known: &OfVehicle, moment: Duration) -> Vec<HolderStatus> {
    let holders = known.holders.iter().filter_map(|(id, changes)| {
        let (since, (loi, stations)) = changes.at(moment)?;
        let levels = LoiBitmap::from_raw(*loi);
        (*loi != 0).then(|| HolderStatus {
            id: id.to_string(),
            loi: *loi,
            levels: levels.in_words(),
            stations: stations.clone(),
            since_ms: u64::try_from(since.as_millis()).ok(),
        })
    });
    holders.collect()
}

fn handovers(known: &OfVehicle, moment: Duration) -> Vec<HandoverStatus> {
    let between = known.handover.at(moment).and_then(|(_, between)| *between);
    let shown = between.map(|(from, to)| HandoverStatus {
        from: (from != Id::NULL).then(|| from.to_string()),
        to: to.to_string(),
        rights: "what it holds".to_owned(),
        waits_for: "its decision",
    });
    shown.into_iter().collect()
}

fn alerts(known: &OfVehicle, moment: Duration) -> Vec<AlertStatus> {
    let standing = known
        .alerts
        .at(moment)
        .map(|(_, standing)| standing.clone());
    let mut standing = standing.unwrap_or_default();
    standing.sort_by_key(|(priority, _)| Reverse(*priority));
    standing.into_iter().map(|(_, alert)| alert).collect()
}

/// The waypoints of stations that the plan which was read back flies to, in its order.
fn waypoints(known: &OfVehicle, path: &[PlaceMap], moment: Duration) -> Vec<WaypointMap> {
    let mut found: Vec<WaypointMap> = Vec::new();
    for place in path {
        let here = known.waypoints.iter().find_map(|(number, changes)| {
            let (_, (latitude, longitude, speed)) = changes.at(moment)?;
            let off = (latitude - place.at[0])
                .abs()
                .max((longitude - place.at[1]).abs());
            (off < SAME_PLACE_DEG).then_some((*number, *speed))
        });
        if let Some((number, speed_m_s)) = here
            && !found.iter().any(|one| one.number == number)
        {
            found.push(WaypointMap {
                number,
                place: *place,
                speed_m_s,
            });
        }
    }
    found
}

/// The areas of a fence that was read back: corners follow each other, their number in the first parameter.
fn areas(items: &[Item]) -> Vec<AreaMap> {
    let mut areas: Vec<AreaMap> = Vec::new();
    let mut left = 0;
    for item in items {
        let (north, east) = degrees(item);
        let keep_in = matches!(item.command, POLYGON_INCLUSION | CIRCLE_INCLUSION);
        match item.command {
            CIRCLE_INCLUSION | CIRCLE_EXCLUSION => areas.push(AreaMap {
                keep_in,
                corners: vec![[north, east]],
                radius_m: item.params.first().map(|radius| f64::from(*radius)),
            }),
            POLYGON_INCLUSION | POLYGON_EXCLUSION => {
                if left == 0 {
                    left = item.params.first().map_or(0, |count| *count as usize);
                    areas.push(AreaMap {
                        keep_in,
                        corners: Vec::new(),
                        radius_m: None,
                    });
                }
                left = left.saturating_sub(1);
                if let Some(area) = areas.last_mut() {
                    area.corners.push([north, east]);
                }
            }
            _ => {}
        }
    }
    areas
}

fn degrees(item: &Item) -> (f64, f64) {
    (f64::from(item.x) * 1e-7, f64::from(item.y) * 1e-7)
}

/// A waypoint's place on the wire of the DLI and of MAVLink differ by their steps, some centimetres.
const SAME_PLACE_DEG: f64 = 1e-6;
/// MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION and its like.
const POLYGON_INCLUSION: u16 = 5001;
const POLYGON_EXCLUSION: u16 = 5002;
const CIRCLE_INCLUSION: u16 = 5003;
const CIRCLE_EXCLUSION: u16 = 5004;
