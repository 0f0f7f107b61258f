//! Plans of one aircraft: what a Mission Transfer Command (13000) asks, and what is on its way to the vehicle for it.
//!
//! One load or clearing at a time. Each is answered by 14000, and refused with the reason.

mod clear;
mod download;
mod load;
mod stored;

pub(super) use download::Download;

use std::time::Duration;

use mavlink_link::service::mission::{self, Failure, Operation};
use stanag_msgs::enums::{AckType, AlertPriority, MissionPlanMode as Mode, MissionTransferStatus};
use stanag_msgs::messages::{
    MissionTransferCommand, MissionUploadDownloadStatus, VehicleOperatingModeCommand,
};
use stanag_msgs::{Message, Text};

use self::download::Part;
use super::aircraft::Aircraft;
use super::desk::{Desk, Origin};
use super::plan_record::UploadedMission;
use super::transfer::{Transfer, explain};

/// What is on its way to the vehicle's mission store.
#[derive(Debug)]
pub(crate) struct Load {
    work: Work,
    /// Who asked by 13000; none where a mode command needs another route aboard.
    origin: Option<Origin>,
    mission_name: String,
    /// Flown once it is aboard.
    then: Option<(Option<Origin>, VehicleOperatingModeCommand)>,
}

#[expect(clippy::large_enum_variant, reason = "one an aircraft, and rare")]
#[derive(Debug)]
enum Work {
    Transfer(Transfer),
    /// Of everything, or of the route of this name, which is what is aboard.
    Clear(Option<String>),
}

impl Load {
    /// Of a plan that was aboard: nobody has asked for it.
    pub(super) fn again(aboard: &UploadedMission) -> Load {
        Load {
            work: Work::Transfer(Transfer::again(aboard)),
            origin: None,
            mission_name: aboard.mission_name.clone(),
            then: None,
        }
    }

    fn is_unasked(&self) -> bool {
        self.origin.is_none() && self.then.is_none()
    }

    /// Who gave the command that is carried out once this is aboard.
    pub(super) fn waiting_command(&self) -> Option<Option<Origin>> {
        self.then.as_ref().map(|(origin, _)| *origin)
    }

    /// Forgets that command.
    pub(super) fn drop_command(&mut self) -> Option<Option<Origin>> {
        self.then.take().map(|(origin, _)| origin)
    }

    /// The station that asked for it, by 13000 or by a mode command; none where the VSM does by itself.
    pub(crate) fn owner(&self) -> Option<usize> {
        let then = self.then.as_ref().and_then(|(origin, _)| origin.as_ref());
        self.origin.as_ref().or(then).map(|origin| origin.station)
    }

    /// Whether the vehicle was taken out of its mission for it.
    fn held(&self) -> bool {
        matches!(&self.work, Work::Transfer(transfer) if transfer.held)
    }

    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        match &self.work {
            Work::Transfer(transfer) => transfer.poll_timeout(),
            Work::Clear(_) => None,
        }
    }
}

impl Aircraft {
    /// 13000.
    pub(crate) fn transfer_command(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        command: &MissionTransferCommand,
    ) {
        desk.acknowledge(self.id(), &origin, AckType::Received);
        let name = command
            .mission_id
            .as_ref()
            .map_or_else(String::new, |id| id.as_str().to_owned());
        let route_id = command.route_id.as_ref().map(|id| id.as_str());
        let route_id = route_id.filter(|id| !id.is_empty());
        match command.mission_plan_mode {
            Some(Mode::Load) => self.load(desk, origin, name, route_id),
            Some(Mode::Clear) => self.clear(desk, origin, name, route_id),
            Some(Mode::Download) => self.download(desk, origin, &name, Part::of_route(route_id)),
            Some(mode @ Mode::DownloadWaypoint) => match command.waypoint_number {
                Some(number) => self.download(desk, origin, &name, Part::Waypoint(number)),
                None => {
                    let why = "Waypoint Number is missing".to_owned();
                    self.reject(desk, origin, &name, mode, None, why);
                }
            },
            Some(Mode::Cancel) => self.cancel(desk, origin, &name),
            Some(Mode::Unknown(value)) => {
                let why = format!("Mission Plan Mode {value}, expected 1 to 5");
                self.reject(desk, origin, &name, Mode::Unknown(value), None, why);
            }
            None => self.refuse(
                desk,
                Some(origin),
                "Mission Plan Mode is missing".to_owned(),
            ),
        }
    }

    pub(super) fn may_change_mission(&self) -> Result<(), String> {
        if !self.mav.live() {
            return Err("the vehicle is silent: nothing can be loaded".to_owned());
        }
        if self.load.is_some() || self.fence.busy() || self.mav.missions.busy().is_some() {
            return Err("another transfer is in progress".to_owned());
        }
        Ok(())
    }

    fn cancel(&mut self, desk: &mut Desk<'_>, origin: Origin, name: &str) {
        if let Some(mut load) = self.load.take() {
            match &mut load.work {
                Work::Transfer(transfer) => {
                    if transfer.cancel(desk.now.mono, &mut self.mav) {
                        self.forget_aboard(desk);
                    }
                }
                Work::Clear(_) => self.mav.missions.cancel(),
            }
            self.end_load(desk, load, None, "cancelled".to_owned());
        }
        self.complete(desk, &origin, name, Mode::Cancel);
    }

    /// What the mission service has done for a load or a clearing.
    pub(crate) fn load_sees_mission(&mut self, desk: &mut Desk<'_>, event: mission::Event) {
        match (&mut self.load, event) {
            (
                Some(Load {
                    work: Work::Transfer(transfer),
                    ..
                }),
                event,
            ) => {
                let course = transfer.handle_mission(desk.now.mono, event, &mut self.mav);
                self.follow(desk, course);
            }
            (
                Some(Load {
                    work: Work::Clear(_),
                    ..
                }),
                mission::Event::Cleared { .. },
            ) => self.cleared(desk),
            (
                Some(Load {
                    work: Work::Clear(_),
                    ..
                }),
                mission::Event::Failed {
                    operation: Operation::Clear,
                    reason,
                    ..
                },
            ) => {
                if let Some(load) = self.load.take() {
                    self.end_load(desk, load, None, format!("clear: {}", explain(&reason)));
                }
                if reason != Failure::Cancelled {
                    self.forget_aboard(desk);
                }
            }
            _ => {}
        }
    }

    fn end_load(&mut self, desk: &mut Desk<'_>, load: Load, waypoint: Option<u16>, why: String) {
        let why = if load.held() {
            format!("{why}; the vehicle was put on hold (mode 12) for it")
        } else {
            why
        };
        let mode = match load.work {
            Work::Transfer(_) => Mode::Load,
            Work::Clear(_) => Mode::Clear,
        };
        if load.is_unasked() {
            let text = format!("the loaded plan is not aboard any more: {why}");
            self.tell_once(desk, AlertPriority::Warning, text);
        }
        if let Some((origin, _)) = load.then {
            self.refuse(desk, origin, why.clone());
        }
        if let Some(origin) = load.origin {
            self.reject(desk, origin, &load.mission_name, mode, waypoint, why);
        }
    }

    /// 17000, and 14000 with status 1 at 100 per cent.
    fn complete(&mut self, desk: &mut Desk<'_>, origin: &Origin, name: &str, mode: Mode) {
        desk.acknowledge(self.id(), origin, AckType::CarriedOut);
        let status = MissionTransferStatus::Complete;
        self.report(desk, origin.station, name, mode, status, 100, None);
    }

    /// 14000 with status 2, and 16000 with the reason.
    fn reject(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        name: &str,
        mode: Mode,
        waypoint: Option<u16>,
        why: String,
    ) {
        self.report(
            desk,
            origin.station,
            name,
            mode,
            MissionTransferStatus::Aborted,
            0,
            waypoint,
        );
        self.refuse(desk, Some(origin), why);
    }

    #[expect(clippy::too_many_arguments, reason = "the fields of 14000")]
    fn report(
        &mut self,
        desk: &mut Desk<'_>,
        station: usize,
        name: &str,
        mode: Mode,
        status: MissionTransferStatus,
        percent: u8,
        waypoint: Option<u16>,
    ) {
        let message = MissionUploadDownloadStatus {
            time_stamp: Some(desk.stamp()),
            mission_id: Some(Text::new(name)),
            status: Some(status),
            percent_complete: Some(percent),
            waypoint_request: waypoint,
            mission_plan_mode: Some(mode),
        };
        desk.send(
            station,
            self.id(),
            &Message::MissionUploadDownloadStatus(message),
        );
    }
}

fn not_received(route_id: &str) -> String {
    format!("route {route_id:?} has not been received (13001)")
}
