//! Downloads of plans to a station (13000 modes 3 and 4): the messages as they were received, a few at a time.

use std::collections::VecDeque;
use std::time::Duration;

use mapping::plan::Plan;
use stanag_msgs::enums::MissionPlanMode as Mode;
use stanag_msgs::messages::CurveSegmentPaper;
use stanag_msgs::{Id, Message, TimeStamp};

use super::status::{self, not_received};
use super::store::MissionStore;
use crate::session::context::{Context, Origin};
use crate::session::effects::Effects;

/// A download in progress.
#[derive(Debug)]
pub(super) struct Download {
    origin: Origin,
    name: String,
    mode: Mode,
    left: VecDeque<Message>,
    next_at: Duration,
}

/// The part of a plan to download.
#[derive(Debug, Clone, Copy)]
pub(super) enum Part<'a> {
    All,
    /// The route of this name.
    Route(&'a str),
    /// The waypoint of this number.
    Waypoint(u16),
}

impl Download {
    /// The stored plan as its CUCS sent it, with its own numbers, or a part of it: the loaded route as it was uploaded, and
    /// the other routes. An upload that is not loaded is not part of it.
    ///
    /// Refused if there is nothing to send, or if `busy`.
    pub(super) fn begin(
        context: &Context<'_>,
        store: &MissionStore,
        (origin, name): (Origin, &str),
        part: Part<'_>,
        busy: bool,
        effects: &mut Effects<'_>,
    ) -> Option<Download> {
        let (mode, waypoint) = match part {
            Part::Waypoint(number) => (Mode::DownloadWaypoint, Some(number)),
            Part::All | Part::Route(_) => (Mode::Download, None),
        };
        let left = messages(store, part);
        let fault = if left.is_empty() {
            Some(match part {
                Part::Waypoint(number) => format!("waypoint {number} has not been loaded"),
                Part::Route(id) => not_received(id),
                Part::All => "there is no plan".to_owned(),
            })
        } else {
            busy.then(|| "another download is in progress".to_owned())
        };
        if let Some(why) = fault {
            status::reject(effects, origin, name, mode, waypoint, why);
            return None;
        }
        Some(Download {
            origin,
            name: name.to_owned(),
            mode,
            left,
            next_at: context.mono(),
        })
    }

    /// Sends the next few messages: a full plan at once would overflow the station's socket. Returns true at the end.
    pub(super) fn advance(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) -> bool {
        if self.next_at > context.mono() {
            return false;
        }
        self.next_at = context.mono() + DOWNLOAD_PAUSE;
        let station = context.stations.get(self.origin.station);
        // Removed from the configuration meanwhile: another station's download need not wait for this one.
        let Some(station) = station.filter(|station| !station.removed) else {
            return true;
        };
        let few = self.left.len().min(DOWNLOAD_BURST);
        for message in self.left.drain(..few) {
            let message = restamped(message, effects.stamp(), station.id(), context.id());
            effects.send(self.origin.station, &message);
        }
        if self.left.is_empty() {
            status::complete(effects, &self.origin, &self.name, self.mode);
        }
        self.left.is_empty()
    }

    /// Ends it (13000 mode 5).
    pub(super) fn cancel(self, effects: &mut Effects<'_>) {
        let (name, mode) = (self.name.as_str(), self.mode);
        status::reject(effects, self.origin, name, mode, None, "cancelled");
    }

    /// When [`Download::advance`] is next needed.
    pub(super) fn poll_timeout(&self) -> Duration {
        self.next_at
    }
}

fn messages(store: &MissionStore, part: Part<'_>) -> VecDeque<Message> {
    let stored = store.plan();
    let loaded = store.loaded.as_ref().map(|loaded| &loaded.plan);
    // A record of an earlier version holds no messages: then only the stored plan can be sent.
    let loaded = loaded.filter(|loaded| !loaded.is_empty());
    let beside = loaded.map(|loaded| stored.beside(loaded));
    let plan = beside.as_ref().unwrap_or(stored);
    match part {
        Part::All => plan.messages().collect(),
        Part::Route(id) => {
            let route = plan.route_named(id).map(|route| plan.part(route));
            route.iter().flat_map(Plan::messages).collect()
        }
        Part::Waypoint(number) if plan.waypoint(number).is_some() => {
            plan.messages_about(number).collect()
        }
        // Stored, but not part of any route.
        Part::Waypoint(number) => stored.messages_about(number).collect(),
    }
}

/// A stored message as the VSM sends it: with a new Time Stamp, and the vehicle and CUCS of its wrapper in 50001.
fn restamped(message: Message, stamp: TimeStamp, cucs: Id, vehicle: Id) -> Message {
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
        Message::PayloadActionWaypoint(mut action) => {
            action.time_stamp = Some(stamp);
            Message::PayloadActionWaypoint(action)
        }
        Message::VehicleSpecificWaypoint(mut specific) => {
            specific.time_stamp = Some(stamp);
            Message::VehicleSpecificWaypoint(specific)
        }
        Message::CurveSegment(mut curve) => {
            curve.time_stamp = Some(stamp);
            Message::CurveSegment(curve)
        }
        // The ids in 50001 must equal the wrapper's, and the stored one may have come from another CUCS.
        Message::CurveSegmentPaper(curve) => Message::CurveSegmentPaper(CurveSegmentPaper {
            time_stamp: Some(stamp.0 as f64),
            vehicle_id: Some(vehicle),
            cucs_id: Some(cucs),
            ..curve
        }),
        other => other,
    }
}

/// Messages of a download that are sent at once, and the pause after them: 800 a second.
const DOWNLOAD_BURST: usize = 8;
const DOWNLOAD_PAUSE: Duration = Duration::from_millis(10);
