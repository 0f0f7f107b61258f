//! One vehicle: the router between its eight machines.
//!
//! A machine has the form `handle(&mut self, &Context, Input, &mut Effects)` and `poll_timeout(&self)`. It knows no sibling:
//! it reads their state through [`Context`](super::context::Context), and sends them a [`Request`](super::effects::Request),
//! which the router delivers after the call.
//!
//! | machine | decides |
//! |---|---|
//! | [`authority`] | which CUCS holds which level of interoperability; handovers, silence, the audit log |
//! | [`mission`] | the stored plan, its upload, read-back and progress; the geofence |
//! | [`flight`] | what a 2016 becomes: modes, maneuvers, sticks, set points, the loss action |
//! | [`held`] | which commands are held until a condition, and when they are carried out |
//! | [`termination`] | flight termination (2005): two orders, and what the vehicle then shows |
//! | [`reports`] | what stations are sent: on schedule, on request, on change; configuration and parameters |
//! | [`payload`] | what is done for a payload command on a station: gimbals, cameras |
//! | [`link`] | MAVLink: signatures and keys, which frames are accepted and sent |
//!
//! Each input goes to one machine; then [`Aircraft::run_until_idle`] delivers the resulting requests and events until none is left.
//! `deliver`: which machine receives which of them; `machines`: what each borrows for an input; `start`: the start of a vehicle and
//! the state after a restart; `commands`: messages of a CUCS; `files`: file operations of an operator of this computer.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink_link::frame::FrameView;
use mavlink_link::service::timesync;
use stanag_msgs::Id;

use super::alerts::{Alerts, Cause};
use super::authority::{self, AuthorityMachine};
use super::context::{Bounds, Context, Settings, WATCH_SLACK};
use super::effects::{DliEffects, Effects, Request};
use super::files::FileAccess;
use super::flight::{self, Flight};
use super::held::{self, Held};
use super::link::VehicleLink;
use super::link::frame::Peer;
use super::link::services::Services;
use super::link::state::VehicleState;
use super::maneuver;
use super::metadata::MetadataReader;
use super::mission::{self, Mission};
use super::payload::{self, Payload};
use super::reports::{self, Reports, VehicleSettings};
use super::station::GroundStation;
use super::termination::{self, Termination};
use crate::config;

/// The router.
#[derive(Debug)]
pub(crate) struct Aircraft {
    pub(super) config: config::Vehicle,
    /// The index of its link.
    pub(super) port: usize,
    settings: Settings,
    pub(crate) bounds: Bounds,
    pub(super) vehicle: VehicleState,
    services: Services,
    pub(super) alerts: Alerts,
    listeners: Vec<usize>,
    requests: VecDeque<Request>,
    /// When to check silence, health and geofence again; `None` if nothing was received since the last check.
    watch_at: Option<Duration>,
    pub(super) authority: AuthorityMachine,
    pub(super) mission: Mission,
    pub(super) flight: Flight,
    pub(super) held: Held,
    pub(super) reports: Reports,
    pub(super) payload: Payload,
    pub(super) termination: Termination,
    pub(super) link: VehicleLink,
    /// A zeroize is ordered: a vehicle on the ground must no longer start.
    pub(super) zeroizing: bool,
    files: FileAccess,
    /// Metadata of events, then of parameters.
    metadata: [MetadataReader; 2],
}

// Macros, since a method would borrow all of `self`, and no machine could be borrowed mutably beside it.
macro_rules! context {
    ($self:ident, $dli:ident) => {
        Context {
            now: $dli.now,
            vsm: $dli.vsm,
            config: &$self.config,
            settings: &$self.settings,
            bounds: &$self.bounds,
            stations: $dli.stations,
            controller: $self.authority.controller(),
            vehicle: &$self.vehicle,
            termination: $self.termination.view($self.vehicle.live()),
        }
    };
}
macro_rules! effects {
    ($self:ident, $dli:ident) => {
        &mut Effects {
            dli: $dli.reborrow(),
            id: $self.config.id,
            alerts: &mut $self.alerts,
            listeners: &mut $self.listeners,
            vehicle: &mut $self.services,
            requests: &mut $self.requests,
        }
    };
}

mod commands;
mod deliver;
mod files;
mod machines;
mod start;

pub(crate) use self::start::may_come_again;

impl Aircraft {
    pub(crate) fn id(&self) -> Id {
        self.config.id
    }

    /// MAVLink system id.
    pub(super) fn system(&self) -> u8 {
        self.config.system_id
    }

    /// The vehicle's clock against ours.
    pub(super) fn clock(&self) -> &timesync::Client {
        &self.services.clock
    }

    /// The stations that hold LOI 2.
    pub(super) fn listeners(&self) -> &[usize] {
        &self.listeners
    }

    /// Bytes from the vehicle's side. `tap` is called with every accepted frame, for a recording.
    pub(super) fn handle_datagram(
        &mut self,
        dli: &mut DliEffects<'_>,
        from: Peer,
        bytes: &[u8],
        tap: &mut dyn FnMut(&FrameView<'_>),
    ) {
        let (link, vehicle) = (&mut self.link, &mut self.vehicle);
        link.handle_datagram(from, bytes, vehicle, effects!(self, dli), tap);
        self.watch_file();
        self.read_metadata(dli);
        self.run_until_idle(dli);
        self.terminate(dli, termination::Input::Watch);
        // After all received frames are delivered: they may have ended the load or the launch that a handover waits for.
        self.mission(dli, mission::Input::WatchProgress);
        self.watch_held(dli);
        self.authority(dli, authority::Input::Settle);
        self.run_until_idle(dli);
        self.watch_soon(dli.now.mono);
    }

    /// The bridge did not run in between, too shortly for anything but the vehicle's own reaction to it.
    pub(super) fn note_unread(&mut self, from: Duration, until: Duration) {
        let late_by = self.vehicle.reads_late_by(from);
        self.vehicle.note_unread(from, until);
        self.postpone(until.saturating_sub(from) + late_by);
    }

    /// What waits for the vehicle's mode waits for one that it shows after the stop.
    fn postpone(&mut self, by: Duration) {
        self.flight.postpone(by);
        self.mission.postpone(by);
    }

    /// The bridge did not run in between: nothing has lasted by that. What the vehicle has answered and shown meanwhile is read after
    /// this, so whoever waits for that waits as much longer; not after a long stop, since a command must not take effect minutes later.
    pub(super) fn note_stop(&mut self, from: Duration, until: Duration) {
        let stopped = until.saturating_sub(from);
        let late_by = self.vehicle.reads_late_by(from);
        self.flight.note_stop(stopped);
        self.termination.note_stop();
        self.mission.note_stop(stopped);
        self.held.note_stop(stopped);
        self.reports.note_stop(stopped);
        if self.link.note_stop(&mut self.vehicle, from, until) {
            self.services.postpone(stopped);
            self.postpone(stopped + late_by);
            self.payload.postpone(stopped);
            return;
        }
        self.flight.lapse(until, &mut self.services);
        // A load continues, but what a CUCS wanted to fly with it is not flown minutes later. A contingency is, while its cause lasts.
        let mission = self.mission.view(&self.vehicle, &self.services);
        if mission.waiting_command().flatten().is_some() {
            self.requests.push_back(Request::DropWaitingCommand {
                why: maneuver::LAPSED.to_owned(),
                without_right: false,
            });
        }
    }

    /// Does what is due. Stations see the results in the order of these steps.
    pub(super) fn handle_timeout(&mut self, dli: &mut DliEffects<'_>) {
        self.watch_at = None;
        let (link, vehicle) = (&mut self.link, &mut self.vehicle);
        link.handle_timeout(vehicle, effects!(self, dli));
        self.watch_file();
        self.read_metadata(dli);
        self.vehicle.telemetry.equipment.forget(dli.now.mono);
        // Before anything else is flown.
        self.terminate(dli, termination::Input::Watch);
        self.authority(dli, authority::Input::WatchSilence);
        // At once: the loss of the controller is flown in this call, not at the next timeout.
        self.watch_held(dli);
        self.flight(dli, flight::Input::WatchLossAction);
        self.run_until_idle(dli);
        self.observe(dli, reports::Input::WatchModes);
        self.observe(dli, reports::Input::WatchIdentity);
        self.mission(dli, mission::Input::CompareWithVehicle);
        self.flight(dli, flight::Input::EndCutOffLaunch);
        self.hold_operator_control(dli);
        self.observe(dli, reports::Input::SendConfiguration);
        self.observe(dli, reports::Input::WatchRequests);
        self.mission(dli, mission::Input::WatchUpload);
        self.mission(dli, mission::Input::WatchFence);
        self.observe(dli, reports::Input::WatchHealth);
        self.observe(dli, reports::Input::ClearAnswers);
        self.mission(dli, mission::Input::AdvanceDownload);
        self.authority(dli, authority::Input::Settle);
        self.payload(dli, payload::Input::Poll);
        self.observe(dli, reports::Input::PushDue);
        self.link.store_link_id(effects!(self, dli));
        self.run_until_idle(dli);
    }

    /// Whether [`Aircraft::handle_durable`] would change anything, other than with a disk that fails.
    pub(super) fn awaits_disk(&self) -> bool {
        // Every field by its name: a new machine compiles only among these, or `_` where it waits for no disk.
        let Aircraft {
            authority,
            termination,
            held,
            link,
            alerts,
            watch_at: _,
            vehicle: _,
            services: _,
            settings: _,
            mission: _,
            flight: _,
            reports: _,
            payload: _,
            metadata: _,
            config: _,
            port: _,
            bounds: _,
            listeners: _,
            requests: _,
            zeroizing: _,
            files: _,
        } = self;
        authority.awaits_disk()
            || termination.awaits_disk()
            || held.awaits_disk()
            || link.awaits_disk()
            || alerts.stands(Cause::Disk)
    }

    /// The disk has made queued changes durable, or has failed to.
    pub(super) fn handle_durable(&mut self, dli: &mut DliEffects<'_>) {
        let effects = effects!(self, dli);
        match effects.disk().failing() {
            Some(fault) => effects.warn(
                Cause::Disk,
                format!(
                    "cannot store {fault}; retrying. Commands that depend on it are delayed or refused: see vsm doctor"
                ),
            ),
            None => effects.clear(Cause::Disk, "the VSM stores records again"),
        }
        self.authority(dli, authority::Input::Stored);
        self.terminate(dli, termination::Input::Watch);
        self.watch_held(dli);
        self.run_until_idle(dli);
    }

    /// Begins to read the settings that [`mapping::hardening`] checks.
    pub(super) fn read_settings(&mut self, dli: &mut DliEffects<'_>) {
        self.observe(dli, reports::Input::ReadSettings);
        self.run_until_idle(dli);
    }

    /// The vehicle's answers so far.
    pub(super) fn vehicle_settings(&self) -> VehicleSettings {
        VehicleSettings {
            id: self.config.id.to_string(),
            tail_number: self.config.tail_number.clone(),
            live: self.vehicle.live(),
            ..self.reports.settings()
        }
    }

    /// When [`Aircraft::handle_timeout`] is next needed by any machine.
    pub(super) fn poll_timeout(
        &self,
        now: Duration,
        stations: &[GroundStation],
    ) -> Option<Duration> {
        // Every field by its name: a new machine compiles only with its time among these, or `_` where it has none.
        let Aircraft {
            watch_at,
            vehicle,
            services,
            alerts,
            settings,
            authority,
            mission,
            flight,
            held,
            reports,
            payload,
            termination,
            link,
            metadata,
            config: _,
            port: _,
            bounds: _,
            listeners: _,
            requests: _,
            zeroizing: _,
            files: _,
        } = self;
        [
            *watch_at,
            Some(link.poll_timeout(vehicle, services)),
            authority.poll_timeout(now, stations, &settings.authority),
            mission.poll_timeout(),
            flight.poll_timeout(),
            held.poll_timeout(),
            termination.poll_timeout(),
            reports.poll_timeout(alerts),
            payload.poll_timeout(),
        ]
        .into_iter()
        .chain(metadata.each_ref().map(MetadataReader::poll_timeout))
        .flatten()
        .min()
    }

    /// Delivers requests, answers of the vehicle and due streams, until nothing is left to do now.
    ///
    /// The loop ends: a further round needs a new event of the vehicle or a [`Request`], and no machine makes a second
    /// request for the same event.
    fn run_until_idle(&mut self, dli: &mut DliEffects<'_>) {
        loop {
            self.deliver_requests(dli);
            let mut idle = true;
            while let Some(event) = self.link.poll_event() {
                idle = false;
                self.deliver(dli, event);
                self.deliver_requests(dli);
            }
            self.flight(dli, flight::Input::Advance);
            self.mission(dli, mission::Input::Advance);
            self.link.flush(&mut self.vehicle, effects!(self, dli));
            if idle && self.requests.is_empty() && !self.link.has_events() {
                return;
            }
        }
    }

    /// Begins held commands that are due, after each machine has what the authority has decided: the end of control ends
    /// commands and may lead to a loss action, before one that is for that loss is begun.
    fn watch_held(&mut self, dli: &mut DliEffects<'_>) {
        self.deliver_requests(dli);
        self.held(dli, held::Input::Watch);
    }

    fn watch_soon(&mut self, now: Duration) {
        // Keep the first deadline: a stream of datagrams must not postpone the checks.
        self.watch_at.get_or_insert(now + WATCH_SLACK);
    }
}
