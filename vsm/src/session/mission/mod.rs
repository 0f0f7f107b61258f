//! The mission of one vehicle: the plan that CUCSs send, its upload and download, and the geofence.
//!
//! A plan is staged as it arrives (13001 to 13004, 13006, curves). 13000 compiles one complete route of it, uploads it,
//! reads it back, compares it, and waits until the vehicle reports it as its mission. Only then is the route loaded and the
//! staged plan stored. An upload that is refused, cancelled or abandoned leaves nothing behind. Parts, in the order of a
//! route's life:
//!
//! - [`input`]: what the machine reads, and its inputs
//! - [`staged`]: an upload of a CUCS; [`received`]: the upload beside the stored plan, and how it ends
//! - [`payload_action`]: whether a payload station can carry out a 13004
//! - [`store`]: the plan, the loaded route and the uploaded mission, in memory and on disk ([`plan_files`], [`record`])
//! - [`transfer`]: 13000, the load or clearing that it begins, and its result, reported by 14000 ([`status`]); [`download`]:
//!   downloads to a station
//! - [`route_upload`]: compiles a route and holds the vehicle if needed; [`upload`]: uploads items to the vehicle, for
//!   routes, the fence and rally points
//! - [`progress`]: the vehicle's position along its route; [`watchdog`]: whether it makes progress; [`landing`]: the same in
//!   the landing pattern of a wing; [`approach`]: the flight to one item, as both follow it; [`descent`]: whether it sinks
//!   below the route; [`band`]: whether it leaves its altitude band; [`resync`]: whether it still carries the loaded mission
//! - [`fence`]: areas of the configuration and of a CUCS; [`rally`]: rally points to return to; [`kept`]: the common part of
//!   both

mod approach;
mod band;
mod descent;
mod download;
mod fence;
mod input;
mod kept;
mod landing;
mod payload_action;
mod plan_files;
pub(crate) mod progress;
mod rally;
mod received;
pub(crate) mod record;
mod resync;
mod route_upload;
mod staged;
mod status;
mod store;
mod transfer;
mod upload;
mod watchdog;

pub(crate) use input::{Context, Input};

use std::time::Duration;

use mapping::area::Area;
use mapping::plan::Plan;
use mapping::rally::RallyPoint;
use mapping::telemetry::Telemetry;
use mavlink_link::service::mission;
use mavlink_link::store::StoreError;
use stanag_msgs::enums::{AckType, AreaPlanMode, MissionPlanMode};
use stanag_msgs::messages::{AreaTransferCommand, MissionTransferCommand};
use stanag_msgs::{Id, Message, TimeStamp};

use self::band::BandWatch;
use self::descent::DescentWatch;
use self::fence::Fence;
use self::landing::LandingWatch;
use self::progress::RouteProgress;
use self::rally::Rally;
use self::record::UploadedMission;
use self::resync::Resync;
use self::store::MissionStore;
use self::transfer::{Free, Transfers};
use self::watchdog::MissionWatchdog;
use super::context::{MissionView, Origin};
use super::duplicates::Seen;
use super::editions::Unfit;
use super::effects::Effects;
use super::link::services::Services;
use super::link::state::VehicleState;

/// The machine.
#[derive(Debug)]
pub(crate) struct Mission {
    store: MissionStore,
    transfers: Transfers,
    progress: RouteProgress,
    watchdog: MissionWatchdog,
    landing: LandingWatch,
    descent: DescentWatch,
    band: BandWatch,
    resync: Resync,
    fence: Fence,
    rally: Rally,
}

impl Mission {
    /// The fence areas of the configuration have changed.
    pub(crate) fn set_areas(&mut self, areas: Vec<Area>, now: Duration) {
        self.fence.set_configured(areas, now);
    }

    /// The rally points of the configuration have changed.
    pub(crate) fn set_rally(&mut self, points: Vec<RallyPoint>, now: Duration) {
        self.rally.set_configured(points, now);
    }

    /// The rally points of the configuration, and the vehicle's id for them once it holds them.
    pub(crate) fn rally(&self) -> (&[RallyPoint], Option<u32>) {
        (self.rally.points(), self.rally.id())
    }

    /// The areas of the fence, and the vehicle's id for them once it holds them.
    pub(crate) fn fence(&self) -> (Vec<Area>, Option<u32>) {
        let (configured, loaded) = self.fence.areas();
        (loaded.with(configured), self.fence.id())
    }

    /// With the fence areas and the rally points of the configuration.
    pub(crate) fn new(areas: Vec<Area>, points: Vec<RallyPoint>) -> Mission {
        Mission {
            store: MissionStore::default(),
            transfers: Transfers::default(),
            progress: RouteProgress::default(),
            watchdog: MissionWatchdog::default(),
            landing: LandingWatch::default(),
            descent: DescentWatch::default(),
            band: BandWatch::default(),
            resync: Resync::default(),
            fence: Fence::new(areas),
            rally: Rally::new(points),
        }
    }

    /// Restores the records after a restart.
    ///
    /// # Errors
    /// A record exists and cannot be read.
    pub(crate) fn restore(&mut self, effects: &mut Effects<'_>) -> Result<(), StoreError> {
        self.store.restore(effects)?;
        if let Some(uploaded) = self.store.uploaded.as_ref().filter(|_| self.store.ended) {
            self.progress = RouteProgress::ended(&uploaded.compiled);
        }
        self.fence.restore(effects)?;
        self.rally.restore(effects)
    }

    /// Reports to its sender that a transfer which a restart of the VSM has cut off is aborted (14000, 50018). The caller
    /// refuses its command.
    pub(crate) fn report_cut_off(&self, station: usize, seen: &Seen, effects: &mut Effects<'_>) {
        // 0 in a log of an earlier version.
        let mode = Some(seen.mode).filter(|mode| *mode != 0);
        match seen.message_type {
            MissionTransferCommand::ID => {
                let command = self.store.cut_off(seen.stamp);
                let mode = mode.map(MissionPlanMode::from_raw);
                status::cut_off(effects, station, mode, command);
            }
            AreaTransferCommand::ID => {
                fence::cut_off(effects, station, mode.map(AreaPlanMode::from_raw));
            }
            _ => {}
        }
    }

    /// Whether the vehicle is outside its altitude band.
    pub(crate) fn outside_band(&self) -> bool {
        self.band.outside()
    }

    /// The waypoint that the vehicle flies to, by the CUCS's number.
    pub(crate) fn flies_to(&self, telemetry: &Telemetry) -> Option<u16> {
        let compiled = &self.uploaded()?.compiled;
        let to = self.progress.along(compiled, telemetry).to?;
        compiled.order.get(to).map(|leg| leg.number)
    }

    /// The mission that the vehicle carries.
    pub(crate) fn uploaded(&self) -> Option<&UploadedMission> {
        self.store.uploaded.as_ref()
    }

    /// The plan that a 13000 of this CUCS would load, and the part of it that this CUCS has sent since its last 13000.
    pub(crate) fn upload_of(&self, cucs: Id) -> (&Plan, Option<&Plan>) {
        self.store.upload_of(cucs)
    }

    /// The 13000 of this station with this stamp, which follows, is refused: its upload in Edition 2.5 is no mission.
    pub(crate) fn refuse_load(&mut self, load: (Id, Option<TimeStamp>), unfit: Unfit) {
        self.store.unfit = Some((load, unfit));
    }

    /// The stored plan, of which a download is.
    pub(crate) fn plan(&self) -> &Plan {
        self.store.plan()
    }

    /// Whether a waypoint is in the stored plan or in an upload.
    pub(crate) fn holds(&self, cucs: Id, number: u16) -> bool {
        let (offered, _) = self.upload_of(cucs);
        let mut plans = [self.store.plan(), offered].into_iter();
        plans.any(|plan| plan.waypoint(number).is_some())
    }

    /// The state that other machines may read.
    pub(crate) fn view(&self, vehicle: &VehicleState, services: &Services) -> MissionView<'_> {
        MissionView {
            plan: self.store.plan(),
            uploaded: self.uploaded(),
            loaded: self.store.loaded.as_ref(),
            progress: &self.progress,
            transfer: self.transfers.view(),
            waiting_mode: self.transfers.waiting_mode(),
            fence_busy: self.fence.busy() || self.rally.busy(),
            areas: self.fence.sent(),
            fence: self.fence.areas(),
            unfenced: self.fence.failed(),
            infeasible: self.fence.finds_infeasible(vehicle, self.uploaded()) == Some(true),
            may_change: self.may_send_by_itself(vehicle, services),
        }
    }

    /// Whether a route that no CUCS has requested can be sent at once: where it would have to wait for the fence, the vehicle would
    /// fly on meanwhile with nobody in control.
    fn may_send_by_itself(&self, vehicle: &VehicleState, services: &Services) -> Free {
        self.may_change(vehicle, services)?;
        match self.fence.is_aboard(vehicle) {
            Ok(true) => Ok(()),
            Ok(false) | Err(_) => Err("the vehicle is not known to hold its fence"),
        }
    }

    /// Whether an upload, a download or a clearing can begin now, or why not.
    fn may_change(&self, vehicle: &VehicleState, services: &Services) -> Free {
        self.may_bound(vehicle, services)?;
        if self.transfers.is_running() {
            return Err(BUSY);
        }
        Ok(())
    }

    /// The same for the fence and the rally points that the VSM itself sends: a load that has not begun waits for them.
    fn may_bound(&self, vehicle: &VehicleState, services: &Services) -> Free {
        if !vehicle.live() {
            return Err("no data from the vehicle: nothing can be loaded");
        }
        // Routes, fences, rally points and a maneuver's set-current share the mission service: one operation at a time.
        let busy = services.missions.busy().is_some() || self.rally.busy();
        if self.transfers.has_begun() || self.fence.busy() || busy {
            return Err(BUSY);
        }
        Ok(())
    }

    /// Whether a load can be requested now, or why not: what the VSM sends by itself for it is waited for.
    fn may_load(&self, vehicle: &VehicleState, services: &Services) -> Free {
        let waits = self.fence.is_sent_unasked() || self.rally.busy();
        if waits && vehicle.live() && !self.transfers.is_running() {
            return Ok(());
        }
        self.may_change(vehicle, services)
    }

    /// The bridge did not run for so long: nothing has lasted by that.
    pub(crate) fn note_stop(&mut self, stopped: Duration) {
        self.rally.note_stop(stopped);
    }

    /// The bridge did not run for so long: what the vehicle has reported meanwhile is not read yet.
    pub(crate) fn postpone(&mut self, stopped: Duration) {
        self.transfers.postpone(stopped);
        self.fence.postpone(stopped);
        self.rally.postpone(stopped);
    }

    /// Takes an input.
    pub(crate) fn handle(
        &mut self,
        context: &Context<'_>,
        input: Input<'_>,
        effects: &mut Effects<'_>,
    ) {
        let free = match (context.termination.holds, &input) {
            (true, _) => Err("a flight termination is commanded"),
            (false, Input::WatchFence) => self.may_bound(context.vehicle, effects.vehicle),
            // Also where the route that was aboard has changed or is lost.
            (false, Input::LoadAndFly { origin: None, .. }) => {
                self.may_send_by_itself(context.vehicle, effects.vehicle)
            }
            (false, input) if input.loads() => self.may_load(context.vehicle, effects.vehicle),
            (false, _) => self.may_change(context.vehicle, effects.vehicle),
        };
        let telemetry = &context.vehicle.telemetry;
        let Mission {
            store,
            transfers,
            progress,
            watchdog,
            landing,
            descent,
            band,
            resync,
            fence,
            rally,
        } = self;
        match input {
            Input::Command { origin, message } => {
                self.command(context, origin, message, free, effects);
            }
            Input::LoadAndFly {
                origin,
                route_type,
                command,
            } => {
                let waiting = (origin, route_type, command);
                transfers.load_and_fly(context, waiting, store, free, effects);
            }
            Input::DropWaitingCommand { why, without_right } => {
                transfers.drop_waiting_command(context, &why, without_right, effects);
            }
            Input::YieldToTermination => {
                let why = "a flight termination is commanded";
                transfers.end_load(context, why, store, effects);
            }
            Input::CommandEnded(event) => {
                transfers.handle_command(context, event, store, progress, effects);
            }
            Input::ServiceEnded(event) => {
                // MISSION_SET_CURRENT changes the target: PX4 repeats MISSION_ITEM_REACHED, and an earlier one must not
                // count.
                if let mission::Event::CurrentSet { .. } = &event {
                    progress.sent_on(telemetry);
                }
                // Never two at once (`may_change`): while a fence is being uploaded, the event belongs to it.
                if !fence.handle_service(context, &event, effects)
                    && !rally.handle_service(context, &event, effects)
                {
                    transfers.handle_service(context, &event, store, progress, effects);
                }
            }
            Input::LinkUp => {
                resync.begin();
                fence.look_again(context.mono());
                rally.look_again(context.mono());
            }
            Input::Advance => {
                let bounds = (&*fence, rally.busy());
                transfers.advance(context, store, progress, bounds, effects);
            }
            Input::WatchProgress => {
                if let Some(uploaded) = &store.uploaded {
                    let streamed = context.flight.streams_curve;
                    let wings = context.parameters.wings(context);
                    let circle_m = wings.map(|wings| wings.loiter_radius_m.abs());
                    let reported_at = context.vehicle.progress_at();
                    progress.look(
                        &uploaded.compiled,
                        telemetry,
                        streamed,
                        circle_m,
                        reported_at,
                    );
                }
                store.keep_end(progress.has_ended(), context.mono(), effects);
                let uploaded = store.uploaded.as_ref();
                let transferring = transfers.is_running();
                watchdog.watch(context, uploaded, transferring, effects);
                landing.watch(context, uploaded, transferring, effects);
                descent.watch(context, uploaded, transferring, effects);
                band.watch(context, uploaded, transferring, effects);
                if !transferring && !fence.busy() {
                    fence.watch_route(context, uploaded, effects);
                }
            }
            Input::CompareWithVehicle => {
                transfers.report_ended_early(context, effects);
                let uploaded = store.uploaded.as_ref();
                // A load that begins before would hold up those of CUCSs, and is not repeated where the fence is not taken at once.
                let free = free.is_ok() && fence.is_aboard(context.vehicle) == Ok(true);
                let may = (free, transfers.is_running());
                if resync.compare(context, uploaded, may, effects)
                    && let Some(uploaded) = uploaded
                {
                    transfers.load_again(uploaded);
                }
            }
            Input::WatchUpload => {
                store.watch_upload(context.mono(), context.controller, effects);
            }
            Input::WatchFence => {
                fence.watch(context, free, effects);
                // The fence may have begun an upload just now.
                let busy = fence.busy() || effects.vehicle.missions.busy().is_some();
                rally.watch(context, free.is_ok() && !busy, effects);
            }
            Input::AdvanceDownload => transfers.advance_download(context, effects),
        }
    }

    fn command(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        message: &Message,
        free: Free,
        effects: &mut Effects<'_>,
    ) {
        let Mission {
            store,
            transfers,
            fence,
            ..
        } = self;
        match message {
            Message::MissionTransferCommand(command) => {
                transfers.command(context, origin, command, store, free, effects);
            }
            Message::AreaVertex(vertex) => fence.store_area(origin, vertex, effects),
            Message::AreaTransferCommand(command) => {
                fence.command(context, origin, command, free, effects);
            }
            _ => {
                let Some(station) = context.stations.get(origin.station) else {
                    return;
                };
                let cucs = station.id();
                let fitted = match message {
                    Message::PayloadActionWaypoint(action) => {
                        payload_action::admit(context, &origin, action, effects)
                    }
                    _ => Ok(()),
                };
                let stored = fitted
                    .and_then(|()| store.refuse_late(context.mono(), cucs, origin.stamp))
                    .and_then(|()| store.store(message, cucs, effects));
                match stored {
                    Ok(()) => effects.acknowledge(&origin, AckType::CarriedOut),
                    Err(why) => effects.refuse(Some(origin), why),
                }
            }
        }
    }

    /// When a timed input is next due.
    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        // By name, as in the router. The watches look when something is received.
        let Mission {
            store,
            transfers,
            fence,
            rally,
            progress: _,
            watchdog: _,
            landing: _,
            descent: _,
            band: _,
            resync: _,
        } = self;
        [
            store.poll_timeout(),
            transfers.poll_timeout(),
            fence.poll_timeout(),
            rally.poll_timeout(),
        ]
        .into_iter()
        .flatten()
        .min()
    }
}

const BUSY: &str = "another transfer is in progress";

#[cfg(test)]
mod tests;
