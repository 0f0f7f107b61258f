//! Plans on their way to a station (13000 modes 3 and 4): the messages as they were sent, a few at a time.

use std::collections::VecDeque;
use std::time::Duration;

use stanag_msgs::enums::MissionPlanMode as Mode;
use stanag_msgs::messages::CurveSegmentPaper;
use stanag_msgs::{Id, Message};

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

impl Aircraft {
    /// The plan as the CUCS sent it, in its own numbers; one waypoint where a number is given. Of the route that 13000
    /// has loaded it is what went aboard, not what has been sent since; of the others what they would be loaded as.
    pub(super) fn download(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        name: &str,
        waypoint: Option<u16>,
    ) {
        let mode = if waypoint.is_some() {
            Mode::DownloadWaypoint
        } else {
            Mode::Download
        };
        let chosen = self.chosen.as_ref().map(|chosen| &chosen.plan);
        let beside = chosen
            .filter(|chosen| !chosen.is_empty())
            .map(|chosen| self.plan.beside(chosen));
        let plan = beside.as_ref().unwrap_or(&self.plan);
        let wanted: VecDeque<Message> = match waypoint {
            None => plan.messages().collect(),
            Some(number) if plan.waypoint(number).is_some() => {
                plan.messages_about(number).collect()
            }
            // Received, and no route leads to it yet.
            Some(number) => self.plan.messages_about(number).collect(),
        };
        if wanted.is_empty() {
            let why = match waypoint {
                Some(number) => format!("waypoint {number} has not been received"),
                None => "there is no plan".to_owned(),
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
