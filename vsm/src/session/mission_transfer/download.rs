//! Plans on their way to a station (13000 modes 3 and 4): the messages as they were sent, a few at a time.

use std::collections::VecDeque;
use std::time::Duration;

use stanag_msgs::enums::MissionPlanMode as Mode;
use stanag_msgs::messages::CurveSegmentPaper;
use stanag_msgs::{Id, Message};

use super::not_received;
use crate::session::aircraft::Aircraft;
use crate::session::desk::{Desk, Origin};

/// A plan on its way to a station.
#[derive(Debug)]
pub(crate) struct Download {
    origin: Origin,
    name: String,
    mode: Mode,
    left: VecDeque<Message>,
    pub(in crate::session) next_at: Duration,
}

/// What of a plan is downloaded.
#[derive(Debug, Clone, Copy)]
pub(super) enum Part<'a> {
    All,
    /// The route of this name.
    Route(&'a str),
    /// The waypoint of this number.
    Waypoint(u16),
}

impl<'a> Part<'a> {
    pub(super) fn of_route(id: Option<&'a str>) -> Part<'a> {
        id.map_or(Part::All, Part::Route)
    }
}

impl Aircraft {
    /// The plan as the CUCS sent it, in its own numbers, or a part of it. Of the route that 13000 has loaded it is what
    /// went aboard, not what has been sent since; of the others what they would be loaded as.
    pub(super) fn download(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        name: &str,
        part: Part<'_>,
    ) {
        let (mode, waypoint) = match part {
            Part::Waypoint(number) => (Mode::DownloadWaypoint, Some(number)),
            Part::All | Part::Route(_) => (Mode::Download, None),
        };
        let loaded_mission = self
            .loaded_mission
            .as_ref()
            .map(|loaded_mission| &loaded_mission.plan);
        let beside = loaded_mission
            .filter(|loaded_mission| !loaded_mission.is_empty())
            .map(|loaded_mission| self.plan.beside(loaded_mission));
        let plan = beside.as_ref().unwrap_or(&self.plan);
        let wanted: VecDeque<Message> = match part {
            Part::All => plan.messages().collect(),
            Part::Route(id) => {
                let route = plan.route_named(id).map(|route| plan.part(route));
                route
                    .iter()
                    .flat_map(mapping::plan::Plan::messages)
                    .collect()
            }
            Part::Waypoint(number) if plan.waypoint(number).is_some() => {
                plan.messages_about(number).collect()
            }
            // Received, and no route leads to it yet.
            Part::Waypoint(number) => self.plan.messages_about(number).collect(),
        };
        if wanted.is_empty() {
            let why = match part {
                Part::Waypoint(number) => format!("waypoint {number} has not been received"),
                Part::Route(id) => not_received(id),
                Part::All => "there is no plan".to_owned(),
            };
            return self.reject(desk, origin, name, mode, waypoint, why);
        }
        if self.download.is_some() {
            return self.reject(
                desk,
                origin,
                name,
                mode,
                waypoint,
                "another download is in progress".to_owned(),
            );
        }
        self.download = Some(Download {
            origin,
            name: name.to_owned(),
            mode,
            left: wanted,
            next_at: desk.now.mono,
        });
        self.advance_download(desk);
    }

    /// Sends the next few messages of a download: a full plan at once would overflow the station's socket.
    pub(in crate::session) fn advance_download(&mut self, desk: &mut Desk<'_>) {
        let id = self.id();
        let Some(download) = &mut self.download else {
            return;
        };
        if download.next_at > desk.now.mono {
            return;
        }
        download.next_at = desk.now.mono + DOWNLOAD_PAUSE;
        let origin = download.origin;
        let few = download.left.len().min(DOWNLOAD_BURST);
        let burst: Vec<Message> = download.left.drain(..few).collect();
        let Some(cucs) = desk
            .stations
            .get(origin.station)
            .map(|station| station.id())
        else {
            return;
        };
        for message in burst {
            let message = restamped(message, desk, cucs, id);
            desk.send(origin.station, id, &message);
        }
        if download.left.is_empty()
            && let Some(Download {
                origin, name, mode, ..
            }) = self.download.take()
        {
            self.complete(desk, &origin, &name, mode);
        }
    }
}

/// A stored message as the VSM sends it: its own stamp; 50001 names vehicle and CUCS as its wrapper does.
fn restamped(message: Message, desk: &mut Desk<'_>, cucs: Id, vehicle: Id) -> Message {
    let stamp = desk.stamp();
    match message {
        Message::UaRoute(mut route) => {
            route.time_stamp = Some(stamp);
            Message::UaRoute(route)
        }
        Message::UaPositionWaypoint(mut waypoint) => {
            waypoint.time_stamp = Some(stamp);
            Message::UaPositionWaypoint(waypoint)
        }
        Message::UaLoiterWaypoint(mut loiter) => {
            loiter.time_stamp = Some(stamp);
            Message::UaLoiterWaypoint(loiter)
        }
        Message::CurveSegment(mut curve) => {
            curve.time_stamp = Some(stamp);
            Message::CurveSegment(curve)
        }
        Message::CurveSegmentPaper(curve) => Message::CurveSegmentPaper(CurveSegmentPaper {
            time_stamp: Some(stamp.0 as f64),
            vehicle_id: Some(vehicle),
            cucs_id: Some(cucs),
            ..curve
        }),
        other => other,
    }
}

/// Messages of a download that go out at once, and the pause after them: 800 a second.
const DOWNLOAD_BURST: usize = 8;
const DOWNLOAD_PAUSE: Duration = Duration::from_millis(10);
