//! The Mission Transfer Command (13000), and the transfers to the vehicle for it or for a mode command.
//!
//! One load or clearing at a time, and one download. Each is answered by 14000, and refused with the reason. `load`: a load
//! and what follows from it; `clear`: a clearing.

mod clear;
mod load;

use std::time::Duration;

use mavlink_link::dialect::MissionState;
use mavlink_link::service::{command, mission};
use stanag_msgs::Id;
use stanag_msgs::enums::{
    AckType, AlertPriority, FlightPathControlMode, MissionPlanMode as Mode, RouteType, SubsystemId,
};
use stanag_msgs::messages::{MissionTransferCommand, VehicleOperatingModeCommand};

use super::download::{Download, Part};
use super::input::Context;
use super::progress::RouteProgress;
use super::route_upload::RouteUpload;
use super::status;
use super::store::MissionStore;
use super::upload::{Progress, Upload};
use crate::session::alerts::Cause;
use crate::session::context::{Origin, Transfer};
use crate::session::effects::{Effects, Request};

/// The machine.
#[derive(Debug, Default)]
pub(super) struct Transfers {
    load: Option<Load>,
    download: Option<Download>,
    /// The ids of routes whose load ended early, the latest last: the vehicle may have taken the last item just before, and may hold
    /// an earlier one where a later load has not replaced it.
    ended_early: Vec<u32>,
}

/// A load or a clearing.
#[derive(Debug)]
struct Load {
    work: Work,
    /// The requesting 13000; `None` if a mode command needs another route.
    origin: Option<Origin>,
    mission_name: String,
    /// Flown once the route is uploaded.
    then: Option<(Option<Origin>, Box<VehicleOperatingModeCommand>)>,
    /// It waits for a maneuver to end, or for the areas that the vehicle should hold.
    blocked: bool,
}

#[expect(clippy::large_enum_variant, reason = "one a vehicle, and rare")]
#[derive(Debug)]
enum Work {
    Load(RouteUpload),
    /// Clears everything, or the route with this name, which the vehicle carries.
    Clear {
        route_id: Option<String>,
        upload: Upload,
    },
}

/// A mode command, with its sender, that waits for the upload of a route of this type or of the loaded one.
pub(super) type WaitingCommand = (
    Option<Origin>,
    Option<RouteType>,
    Box<VehicleOperatingModeCommand>,
);
/// Whether the vehicle's mission store can be changed now, or why not.
pub(super) type Free = Result<(), &'static str>;

/// Checks whether the mission aboard can be replaced or cleared. The vehicle is put on hold for that, or PX4 does so when
/// its mission is gone; on its final approach a fixed wing would circle at its present low height.
fn replaceable(context: &Context<'_>, store: &MissionStore) -> Free {
    let telemetry = &context.vehicle.telemetry;
    let aboard = store.uploaded.as_ref();
    if aboard.is_some_and(|aboard| aboard.is_on_final(telemetry)) {
        return Err(
            "the vehicle is on its final approach: abort the landing first (2016 mode 20, wave-off), or let it end",
        );
    }
    let unknown = context.flight.item_unknown_until;
    if unknown.is_some_and(|until| context.mono() < until) {
        return Err(
            "it is not known yet after a silence whether the vehicle is on its final approach: try again in 5 s",
        );
    }
    Ok(())
}

impl Transfers {
    /// 13000.
    pub(super) fn command(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        command: &MissionTransferCommand,
        store: &mut MissionStore,
        free: Free,
        effects: &mut Effects<'_>,
    ) {
        effects.acknowledge(&origin, AckType::Received);
        let (name, route_id) = (mission_name(command), route_name(command));
        let part = match command.mission_plan_mode {
            Some(Mode::Load) => {
                let free = free.and(replaceable(context, store));
                return self.load(context, origin, command, store, free, effects);
            }
            Some(Mode::Clear) => {
                let free = free.and(replaceable(context, store));
                return self.clear(context, (origin, name), route_id, store, free, effects);
            }
            Some(Mode::Cancel) => return self.cancel(context, (origin, &name), store, effects),
            Some(Mode::Download) => route_id.map_or(Part::All, Part::Route),
            Some(mode @ Mode::DownloadWaypoint) => match command.waypoint_number {
                Some(number) => Part::Waypoint(number),
                None => {
                    let why = "Waypoint Number is missing";
                    return status::reject(effects, origin, &name, mode, None, why);
                }
            },
            Some(mode @ Mode::Unknown(value)) => {
                // It ends the messages of its upload, as any 13000 that loads nothing: their 13001 may come last when they
                // are sent again.
                store.load_failed(false, cucs_of(context, &origin), effects);
                let why = format!("Mission Plan Mode {value}, expected 1 to 5");
                return status::reject(effects, origin, &name, mode, None, why);
            }
            None => {
                store.load_failed(false, cucs_of(context, &origin), effects);
                return effects.refuse(Some(origin), "Mission Plan Mode is missing");
            }
        };
        let (busy, to) = (self.download.is_some(), (origin, name.as_str()));
        if let Some(download) = Download::begin(context, store, to, part, busy, effects) {
            self.download = Some(download);
            self.advance_download(context, effects);
        }
    }

    fn cancel(
        &mut self,
        context: &Context<'_>,
        (origin, name): (Origin, &str),
        store: &mut MissionStore,
        effects: &mut Effects<'_>,
    ) {
        // This also drops the upload, loaded or not: otherwise the next 13000 would load it.
        let sender = (cucs_of(context, &origin), origin.stamp);
        let dropped = store.cancel_upload(context.mono(), sender, effects);
        self.end_load(context, "cancelled", store, effects);
        if let Some(download) = self.download.take() {
            download.cancel(effects);
        }
        match dropped {
            // Also if nothing is in progress: the state that mode 5 requests is then already reached.
            Ok(()) => status::complete(effects, &origin, name, Mode::Cancel),
            Err(why) => status::reject(effects, origin, name, Mode::Cancel, None, why),
        }
    }

    /// Ends a load or a clearing.
    pub(super) fn end_load(
        &mut self,
        context: &Context<'_>,
        why: &str,
        store: &mut MissionStore,
        effects: &mut Effects<'_>,
    ) {
        let Some(mut load) = self.load.take() else {
            return;
        };
        match &mut load.work {
            Work::Load(upload) => {
                if upload.cancel(context.mono(), context.vehicle, effects.vehicle) {
                    self.note_ended_early(upload.mission_id, store);
                    store.forget_uploaded(effects);
                }
            }
            Work::Clear { upload, .. } => {
                upload.cancel(effects.vehicle);
                // The vehicle was requested to clear at once, and its answer is not awaited.
                store.forget_uploaded(effects);
            }
        }
        load.end(None, why.to_owned(), effects);
    }

    /// The load of the route with this id has ended early. The loaded route is the one that the vehicle is to hold.
    fn note_ended_early(&mut self, id: Option<u32>, store: &MissionStore) {
        let loaded = store.loaded.as_ref().map(|loaded| loaded.mission_id);
        let Some(id) = id.filter(|id| loaded != Some(*id)) else {
            return;
        };
        self.ended_early.retain(|known| *known != id);
        if self.ended_early.len() == MAX_ENDED_EARLY {
            self.ended_early.remove(0);
        }
        self.ended_early.push(id);
    }

    /// Warns as long as the vehicle reports a route whose load has ended early. No mode of this VSM flies it, but a pilot or a failsafe
    /// may. It is not replaced without a command: that would refuse the load with which an operator follows a cancellation.
    pub(super) fn report_ended_early(&self, context: &Context<'_>, effects: &mut Effects<'_>) {
        // Not known again after a silence before the vehicle reports it. While another load or a clearing runs, it is not known
        // what that leads to.
        let Some(mission) = context.vehicle.telemetry.mission else {
            return;
        };
        if self.load.is_some() {
            return;
        }
        let holds_one = mission.state != MissionState::MISSION_STATE_NO_MISSION
            && self.ended_early.contains(&mission.mission_id);
        if holds_one {
            let text = format!(
                "the vehicle holds the route whose load was cancelled or has failed ({:08x}), and its pilot or a failsafe may fly it: \
                 load a route, or clear (13000)",
                mission.mission_id
            );
            effects.raise(
                Cause::EndedLoad,
                AlertPriority::Warning,
                SubsystemId::Comms,
                text,
            );
        } else {
            let text = "the vehicle no longer holds a route whose load was cancelled or has failed";
            effects.clear(Cause::EndedLoad, text);
        }
    }

    /// Refuses the mode command that waits for its route: it has not begun, and must not begin later.
    pub(super) fn drop_waiting_command(
        &mut self,
        context: &Context<'_>,
        why: &str,
        without_right: bool,
        effects: &mut Effects<'_>,
    ) {
        let drops = |(origin, _): &mut (Option<Origin>, _)| {
            // A command of the VSM itself, such as the loss action, needs no right.
            !without_right || origin.is_some_and(|origin| !context.keeps_right(origin))
        };
        let waiting = self.load.as_mut().map(|load| &mut load.then);
        if let Some((origin, _)) = waiting.and_then(|then| then.take_if(drops)) {
            effects.refuse(origin, why);
        }
    }

    /// The end of a command, while the vehicle is put on hold for a load.
    pub(super) fn handle_command(
        &mut self,
        context: &Context<'_>,
        event: &command::Event,
        store: &mut MissionStore,
        progress: &mut RouteProgress,
        effects: &mut Effects<'_>,
    ) {
        if let Some(Load {
            work: Work::Load(upload),
            ..
        }) = &mut self.load
        {
            let outcome = upload.handle_command(context.mono(), event, context.vehicle);
            self.follow(context, outcome, store, progress, effects);
        }
    }

    /// Handles an event of the mission service for a load or a clearing.
    pub(super) fn handle_service(
        &mut self,
        context: &Context<'_>,
        event: &mission::Event,
        store: &mut MissionStore,
        progress: &mut RouteProgress,
        effects: &mut Effects<'_>,
    ) {
        let now = context.mono();
        match self.load.as_mut().map(|load| &mut load.work) {
            Some(Work::Load(upload)) => {
                let outcome = upload.handle_service(now, event, context.vehicle, effects.vehicle);
                self.follow(context, outcome, store, progress, effects);
            }
            Some(Work::Clear { upload, .. }) => {
                match upload.handle(now, event, &[], effects.vehicle) {
                    Progress::Done(_) => self.cleared(context, store, effects),
                    Progress::Failed(fault) => self.not_cleared(&fault, store, effects),
                    Progress::Going | Progress::Percent(_) => {}
                }
            }
            None => {}
        }
    }

    /// Sends the next few messages of a download.
    pub(super) fn advance_download(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let ended = |download: &mut Download| download.advance(context, effects);
        self.download.take_if(ended);
    }

    /// The bridge did not run for so long.
    pub(super) fn postpone(&mut self, stopped: Duration) {
        if let Some(Load {
            work: Work::Load(upload),
            ..
        }) = &mut self.load
        {
            upload.postpone(stopped);
        }
    }

    /// Whether a load or a clearing has requested something of the vehicle.
    pub(super) fn has_begun(&self) -> bool {
        self.load.as_ref().is_some_and(|load| match &load.work {
            Work::Load(upload) => !upload.has_not_begun(),
            Work::Clear { .. } => true,
        })
    }

    /// Whether a load or a clearing runs.
    pub(super) fn is_running(&self) -> bool {
        self.load.is_some()
    }

    /// The state that other machines may read.
    pub(super) fn view(&self) -> Transfer {
        let Some(load) = &self.load else {
            return Transfer::None;
        };
        let waiting_command = load.then.as_ref().map(|(origin, _)| *origin);
        Transfer::Running {
            owner: load
                .origin
                .or(waiting_command.flatten())
                .map(|origin| origin.station),
            waiting_command,
        }
    }

    /// The mode of the command that waits for its route.
    pub(super) fn waiting_mode(&self) -> Option<FlightPathControlMode> {
        let (_, command) = self.load.as_ref()?.then.as_ref()?;
        command.select_flight_path_control_mode
    }

    /// When a load or a download needs its next step.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        let load = self.load.as_ref().and_then(|load| match &load.work {
            Work::Load(upload) if !load.blocked => upload.poll_timeout(),
            // The end of the maneuver, of the fence's upload or of the clearing is an event.
            Work::Load(_) | Work::Clear { .. } => None,
        });
        let download = self.download.as_ref().map(Download::poll_timeout);
        load.into_iter().chain(download).min()
    }
}

impl Load {
    /// The load of a route without a request by a CUCS.
    fn of(upload: RouteUpload, mission_name: String) -> Load {
        Load {
            work: Work::Load(upload),
            origin: None,
            mission_name,
            then: None,
            blocked: false,
        }
    }

    /// Whether no CUCS requested it: the vehicle had lost its loaded mission.
    fn is_own(&self) -> bool {
        self.origin.is_none() && self.then.is_none()
    }

    /// Whether the vehicle was taken out of its mission for it.
    fn held(&self) -> bool {
        matches!(&self.work, Work::Load(upload) if upload.held)
    }

    /// Answers the requester, and flies the route if a mode was commanded.
    fn done(self, effects: &mut Effects<'_>) {
        if self.then.is_none() && self.held() {
            effects.advise(
                "another plan is uploaded, and the vehicle holds (mode 12, loiter): mode 11 (waypoint) flies it",
            );
        }
        if self.is_own() {
            effects.advise("the loaded plan is uploaded again");
        }
        if let Some(origin) = self.origin {
            status::complete(effects, &origin, &self.mission_name, Mode::Load);
        }
        if let Some((origin, command)) = self.then {
            // The command is checked again; `just_loaded` prevents another load if the plan has changed during the upload.
            effects.request(Request::Fly {
                origin,
                command,
                just_loaded: true,
            });
        }
    }

    /// Answers that it has failed.
    fn end(self, waypoint: Option<u16>, why: String, effects: &mut Effects<'_>) {
        let why = if self.held() {
            format!("{why}; the vehicle was put on hold (mode 12, loiter) for it")
        } else {
            why
        };
        let mode = match self.work {
            Work::Load(_) => Mode::Load,
            Work::Clear { .. } => Mode::Clear,
        };
        if self.is_own() {
            effects.warn_of_link(format!(
                "the vehicle no longer holds the loaded plan: {why}"
            ));
        }
        if let Some((origin, _)) = self.then {
            effects.refuse(origin, why.clone());
        }
        if let Some(origin) = self.origin {
            status::reject(effects, origin, &self.mission_name, mode, waypoint, why);
        }
    }
}

fn mission_name(command: &MissionTransferCommand) -> String {
    let mission_id = command.mission_id.as_ref();
    mission_id.map_or_else(String::new, |id| id.as_str().to_owned())
}

fn route_name(command: &MissionTransferCommand) -> Option<&str> {
    let route_id = command.route_id.as_ref().map(|id| id.as_str());
    route_id.filter(|id| !id.is_empty())
}

fn cucs_of(context: &Context<'_>, origin: &Origin) -> Id {
    let asker = context.asker(origin.station);
    asker.map_or(Id::NULL, |asker| asker.id)
}

/// Routes whose load ended early that are remembered: each is one that the vehicle may still hold.
const MAX_ENDED_EARLY: usize = 8;
