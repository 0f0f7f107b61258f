//! 14000: the progress of a plan's transfer, and its result.

use stanag_msgs::enums::{AckType, MissionPlanMode as Mode, MissionTransferStatus as Status};
use stanag_msgs::messages::{MissionTransferCommand, MissionUploadDownloadStatus};
use stanag_msgs::{Message, Text};

use crate::session::context::Origin;
use crate::session::effects::Effects;

/// 14000 with status 0. This is a report, dropped if a station's rate limit is exhausted, so that the final result can still
/// be sent.
pub(super) fn report(effects: &mut Effects<'_>, station: usize, name: &str, percent: u8) {
    let status = (Status::InProgress, percent);
    let message = message(effects, name, Mode::Load, status, None);
    effects.publish(station, &message);
}

/// 17000, and 14000 with status 1 at 100 per cent.
pub(super) fn complete(effects: &mut Effects<'_>, origin: &Origin, name: &str, mode: Mode) {
    effects.acknowledge(origin, AckType::CarriedOut);
    let status = (Status::Complete, 100);
    let message = message(effects, name, mode, status, None);
    effects.send(origin.station, &message);
}

/// 14000 with status 2, and 16000 with the reason.
pub(super) fn reject(
    effects: &mut Effects<'_>,
    origin: Origin,
    name: &str,
    mode: Mode,
    waypoint: Option<u16>,
    why: impl Into<String>,
) {
    let status = (Status::Aborted, 0);
    let message = message(effects, name, mode, status, waypoint);
    effects.send(origin.station, &message);
    effects.refuse(Some(origin), why);
}

/// 14000 with status 2 for a 13000 that a restart of the VSM has cut off. `command`: itself, where it is known. The caller
/// refuses it.
pub(super) fn cut_off(
    effects: &mut Effects<'_>,
    station: usize,
    mode: Option<Mode>,
    command: Option<&MissionTransferCommand>,
) {
    let message = MissionUploadDownloadStatus {
        time_stamp: Some(effects.stamp()),
        mission_id: command.and_then(|command| command.mission_id),
        status: Some(Status::Aborted),
        percent_complete: Some(0),
        mission_plan_mode: mode,
        ..MissionUploadDownloadStatus::default()
    };
    effects.send(station, &message.into());
}

/// Why a route is refused.
pub(super) fn not_received(route_id: &str) -> String {
    format!("route {route_id:?} has not been received (13001)")
}

fn message(
    effects: &mut Effects<'_>,
    name: &str,
    mode: Mode,
    (status, percent): (Status, u8),
    waypoint: Option<u16>,
) -> Message {
    let message = MissionUploadDownloadStatus {
        time_stamp: Some(effects.stamp()),
        mission_id: Some(Text::new(name)),
        status: Some(status),
        percent_complete: Some(percent),
        waypoint_request: waypoint,
        mission_plan_mode: Some(mode),
    };
    message.into()
}
