//! The MAVLink side of one vehicle: which frames are accepted, what is sent, and under which key.
//!
//! Promised: only verified frames of the vehicle's autopilot (component 1) update [its state](state), and only fresh ones
//! confirm a command. If signing is off by configuration, every frame with its system id is accepted. Parts:
//!
//! - [`state`]: the vehicle's reported state; [`measured`]: when it was measured; [`services`]: commands, missions,
//!   parameters and other requests to the vehicle. The router lends state and services to the other machines
//! - `intake`: bytes become state, answers and [events](event); `sending`: messages become signed frames
//! - `budget` and `rates`: how a slow link is used
//! - `key_agreement`: looks for a key agreed over the air in the vehicle's frames; `key_recovery`: finds out which of two
//!   keys the vehicle has, after a restart interrupted a rollover
//! - `encryption_status`: the state of the encrypted link below, which is kept by the shell
//! - `ground`: terrain heights, for a vehicle that requests them
//! - `operator_control`: MAVLink's operator control of the vehicle; `link_id`: its signing link id, stored over restarts

mod budget;
pub(crate) mod encryption_status;
pub(crate) mod event;
pub(crate) mod frame;
mod ground;
mod intake;
pub(crate) mod key_agreement;
pub(crate) mod key_recovery;
mod link_id;
mod loss;
pub(crate) mod measured;
mod operator_control;
mod rates;
mod sending;
pub(crate) mod services;
pub(crate) mod state;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use mapping::data_link::DataLink;
use mavlink_link::Now;
use mavlink_link::dialect::{MavMessage, MavSeverity};
use mavlink_link::link::{Alert, Auth, Endpoint, Event, Link, LinkState, LinkStats, Security};
use mavlink_link::provisioning::StartError;
use mavlink_link::receiver::{AUTOPILOT, KeyState};
use mavlink_link::service::text::Texts;
use mavlink_link::service::timesync;
use mavlink_link::service::{Node, command};
use mavlink_link::signing::{KeyId, SigningKey, Stamp};
use mavlink_link::store::{Disk, Store as _, StoreError};
use stanag_msgs::enums::{AlertPriority, SubsystemId};

use self::budget::Budget;
use self::event::VehicleEvent;
use self::frame::{OutFrame, Peer};
use self::key_agreement::Agreement;
use self::key_recovery::KeyRecovery;
use self::loss::Loss;
use self::operator_control::OperatorControl;
use self::services::Services;
use self::state::VehicleState;
use super::alerts::Cause;
use super::counters::ByType;
use super::effects::Effects;
use super::findings::vehicle::{Arrivals, EncryptedArrivals, Evidence, FRESH, Kind};
use super::log::LogLevel;

pub(crate) use budget::Capacity;
pub(crate) use intake::is_of_payload;
pub(crate) use link_id::LinkId;
pub(crate) use rates::needed_every_us;

/// The machine.
#[derive(Debug)]
pub(crate) struct VehicleLink {
    vehicle: Node,
    pub(super) link: Link<Peer>,
    pub(super) key: Option<KeyState>,
    pub(super) key_recovery: KeyRecovery,
    pub(super) agreement: Agreement,
    pub(super) operator_control: OperatorControl,
    /// System ids under which other ground stations command it through this VSM.
    pub(super) commanders: Vec<u8>,
    /// The vehicle's signing link id as it is stored.
    stored_link_id: Option<u8>,
    /// Since when frames have been accepted without interruption, or were until the link fell silent.
    live_since: Option<Duration>,
    /// That it is live is reported once the vehicle is: its frames verify up to a second before the HEARTBEAT that shows its
    /// state, and commands are refused until then.
    live_is_due: bool,
    /// When the bridge last ran again after it did not.
    ran_again: Option<Duration>,
    /// For how long it did not run since a frame was last accepted.
    stopped: Duration,
    /// When a frame last verified and was accepted, and under which key.
    verified: Option<(Duration, KeyId)>,
    /// Frames and bytes that arrived but were not accepted.
    pub(super) arrivals: Arrivals,
    /// What arrives around them, where the link is encrypted.
    packets: EncryptedArrivals,
    /// Frames with stale timestamps from before the vehicle's clock was raised to ours.
    stale_at_start: StaleAtStart,
    /// When this computer's clock was last found to be far ahead of the signing clock.
    wall_far_ahead: Option<Duration>,
    texts: Texts,
    asked: Asked,
    /// The timestamp of the first attempt of the running command, by component.
    asked_components: BTreeMap<u8, Stamp>,
    /// Loss of the autopilot's frames.
    loss: Loss,
    /// A value was forgotten because it is no longer reported; an alert may be active.
    unreported: bool,
    accepted: Vec<(Node, MavMessage, Fresh)>,
    events: VecDeque<VehicleEvent>,
    budget: Budget,
    out: VecDeque<OutFrame>,
    pub(super) received: ByType,
    pub(super) sent: ByType,
}

/// Timestamps of requests: an answer never has an older timestamp than its request.
#[derive(Debug, Clone, Copy, Default)]
struct Asked {
    /// First message of the running mission operation.
    mission: Option<Stamp>,
    /// First attempt of the running command.
    command: Option<Stamp>,
    /// First of the requested parameters.
    parameter: Option<Stamp>,
    /// First message of the running file operation.
    file: Option<Stamp>,
    /// The last command that may change the vehicle's state.
    last: Option<Stamp>,
    /// The oldest unanswered time request.
    clock: Option<Stamp>,
}

/// Which requests a message can be an answer to.
#[derive(Debug, Clone, Copy)]
struct Fresh {
    mission: bool,
    command: bool,
    /// An answer to a command for the payload.
    payload: bool,
    parameter: bool,
    file: bool,
    state: bool,
    clock: bool,
}

impl VehicleLink {
    /// `capacity`: what the link carries, where that is little.
    pub(crate) fn new(
        link: Link<Peer>,
        key: Option<KeyState>,
        capacity: Option<Capacity>,
    ) -> VehicleLink {
        let vehicle = Node::new(link.config().vehicle_system, AUTOPILOT);
        VehicleLink {
            vehicle,
            stored_link_id: link.config().known_link_id,
            link,
            key,
            key_recovery: KeyRecovery::default(),
            agreement: Agreement::default(),
            operator_control: OperatorControl::default(),
            commanders: Vec::new(),
            live_since: None,
            live_is_due: false,
            ran_again: None,
            stopped: Duration::ZERO,
            verified: None,
            arrivals: Arrivals::default(),
            packets: EncryptedArrivals::default(),
            stale_at_start: StaleAtStart::default(),
            wall_far_ahead: None,
            texts: Texts::new(vehicle.system),
            asked: Asked::default(),
            asked_components: BTreeMap::new(),
            unreported: false,
            loss: Loss::default(),
            accepted: Vec::new(),
            events: VecDeque::new(),
            budget: Budget::new(capacity),
            out: VecDeque::new(),
            received: ByType::default(),
            sent: ByType::default(),
        }
    }

    /// The autopilot whose frames are accepted.
    pub(crate) fn autopilot(&self) -> Node {
        self.vehicle
    }

    pub(crate) fn peer(&self) -> Option<Peer> {
        self.link.peer()
    }

    pub(crate) fn stats(&self) -> LinkStats {
        self.link.stats()
    }

    /// Other MAVLink systems that sent frames on this link, with the number of frames of each.
    pub(crate) fn other_systems(&self) -> impl Iterator<Item = (u8, u32)> + '_ {
        self.link.other_systems()
    }

    /// Whether frames of this other system arrive.
    pub(crate) fn is_sending(&self, system: u8, mono: Duration) -> bool {
        self.arrivals.is_sending(system, mono)
    }

    /// What the encrypted link, in which this one is, has counted.
    pub(crate) fn note_packets(&mut self, packets: EncryptedArrivals) {
        self.packets = packets;
    }

    /// The bridge did not run in between: nobody was silent to it for that time, or left it unanswered. Returns whether the vehicle
    /// counts as the one of before: see [`VehicleState::note_stop`].
    pub(crate) fn note_stop(
        &mut self,
        vehicle: &mut VehicleState,
        from: Duration,
        until: Duration,
    ) -> bool {
        let stopped = until.saturating_sub(from);
        let known = vehicle.note_stop(from, until);
        self.arrivals.note_stop(stopped);
        self.stale_at_start.note_stop(stopped);
        self.live_since = self.live_since.map(|since| since + stopped);
        self.stopped += stopped;
        self.ran_again = Some(until);
        known
    }

    /// When a frame was last accepted: as long ago as the bridge has run since.
    fn accepted_at(&self) -> Option<Duration> {
        self.link.accepted_at().map(|at| at + self.stopped)
    }

    /// Whether frames were accepted, and none is now. The state of the link itself stays live: only other frames end it, and a vehicle
    /// that flew out of range sends none.
    fn is_silent(&self, mono: Duration) -> bool {
        (self.accepted_at()).is_some_and(|at| mono.saturating_sub(at) > FRESH)
    }

    /// How long nothing has shown that the vehicle receives us, as far as the bridge ran.
    fn unanswered(&self, mono: Duration) -> Option<Duration> {
        let ran_for = mono.saturating_sub(self.ran_again.unwrap_or_default());
        self.link.unanswered(mono).map(|age| age.min(ran_for))
    }

    pub(crate) fn key(&self) -> Option<&KeyState> {
        self.key.as_ref()
    }

    /// Does what is due.
    pub(crate) fn handle_timeout(&mut self, vehicle: &mut VehicleState, effects: &mut Effects<'_>) {
        let now = effects.dli.now;
        self.key_recovery.handle_timeout(now);
        self.advance_key_recovery(effects);
        self.link.handle_timeout(now);
        let unanswered = (self.unanswered(now.mono)).is_some_and(|age| age > UNANSWERED);
        let (current, out) = (self.key.as_ref(), &mut self.out);
        self.agreement
            .handle_timeout(now, unanswered, current, out, effects.dli.disk);
        Self::send_ground(effects);
        let Services {
            missions,
            commands,
            parameters,
            files,
            events,
            components,
            intervals,
            clock,
            ..
        } = &mut *effects.vehicle;
        files.handle_timeout(now.mono);
        events.handle_timeout(now.mono);
        missions.handle_timeout(now.mono);
        commands.handle_timeout(now.mono);
        for commands in components.values_mut() {
            commands.handle_timeout(now.mono);
        }
        parameters.handle_timeout(now.mono);
        self.texts.handle_timeout(now.mono);
        let silent = vehicle.silent_at().is_none_or(|at| at <= now.mono);
        if silent && !vehicle.silent {
            vehicle.silent = true;
            self.events.push_back(VehicleEvent::Silent);
        }
        // While the vehicle is silent every rate request would time out; all are requested again once it is back.
        if vehicle.live() {
            let (measured, shown) = (&mut vehicle.measured, &mut vehicle.telemetry);
            if measured.forget_stale(now.mono, shown) {
                // Another program on the vehicle may have switched the message off.
                intervals.request_again();
                self.unreported = true;
            }
            intervals.advance(now.mono, commands);
            clock.handle_timeout(now.mono);
        }
        self.report_missing(vehicle, effects);
        let searched = self.key_recovery.refused_frames();
        let (stats, others) = (self.link.stats(), self.link.other_systems());
        (self.arrivals).look(now.mono, &stats, searched, self.packets, others);
        self.collect(vehicle, effects);
        self.flush(vehicle, effects);
    }

    /// Raises or clears the alert that a live vehicle no longer reports its position.
    fn report_missing(&mut self, vehicle: &VehicleState, effects: &mut Effects<'_>) {
        if !self.unreported {
            return;
        }
        if !vehicle.live() || vehicle.telemetry.position.is_some() {
            self.unreported = false;
            let text = "position reported again, or link to the vehicle lost";
            return effects.clear(Cause::Unreported, text);
        }
        if vehicle.measured.had_position() {
            let (priority, about) = (AlertPriority::Warning, SubsystemId::Comms);
            let text = "vehicle stopped reporting its position: it is not sent or used for checks until it returns; it is requested again";
            effects.raise(Cause::Unreported, priority, about, text);
        }
    }

    /// When [`VehicleLink::handle_timeout`] is next needed.
    pub(crate) fn poll_timeout(&self, vehicle: &VehicleState, services: &Services) -> Duration {
        let silence = vehicle.silent_at().filter(|_| vehicle.live());
        let intervals = services.intervals.poll_timeout().filter(|_| vehicle.live());
        let clock = vehicle.live().then(|| services.clock.poll_timeout());
        let components = services.components.values();
        [
            components.filter_map(command::Client::poll_timeout).min(),
            services.missions.poll_timeout(),
            services.commands.poll_timeout(),
            services.parameters.poll_timeout(),
            services.ground.poll_timeout(),
            services.files.poll_timeout(),
            services.events.poll_timeout(),
            self.texts.poll_timeout(),
            silence,
            intervals,
            clock,
            self.key_recovery.poll_timeout(),
            self.operator_control.poll_timeout(),
            self.budget.poll_timeout(),
        ]
        .into_iter()
        .flatten()
        .fold(self.link.poll_timeout(), Duration::min)
    }

    pub(crate) fn poll_event(&mut self) -> Option<VehicleEvent> {
        self.events.pop_front()
    }

    /// Whether an event is pending.
    pub(crate) fn has_events(&self) -> bool {
        !self.events.is_empty()
    }

    pub(crate) fn poll_transmit(&mut self) -> Option<OutFrame> {
        self.out.pop_front()
    }

    pub(crate) fn has_frame(&self) -> bool {
        !self.out.is_empty()
    }

    /// Whether a frame of the link waits for the disk to store the ceiling of the signing clock.
    pub(crate) fn awaits_disk(&self) -> bool {
        self.link.has_due()
    }

    /// Turns reports of the services and the link into events and alerts.
    fn collect(&mut self, vehicle: &mut VehicleState, effects: &mut Effects<'_>) {
        let now = effects.dli.now.mono;
        while let Some(event) = effects.vehicle.missions.poll_event() {
            self.events.push_back(VehicleEvent::Mission(event));
        }
        while let Some(event) = effects.vehicle.parameters.poll_event() {
            self.events.push_back(VehicleEvent::Parameter(event));
        }
        while let Some(text) = self.texts.poll_event() {
            // PX4 gives the reason for a refused command only by STATUSTEXT. A lower number is more severe. What a camera or a
            // companion computer warns of is no reason of the autopilot.
            if text.from == self.vehicle
                && text.severity as u32 <= MavSeverity::MAV_SEVERITY_WARNING as u32
            {
                vehicle.complain(now, &text.text);
            }
            self.events.push_back(VehicleEvent::Text(text));
        }
        while let Some(event) = effects.vehicle.events.poll_event() {
            self.events.push_back(VehicleEvent::Event(event));
        }
        while let Some(event) = self.link.poll_event() {
            match event {
                Event::Live => {
                    self.live_since = Some(now);
                    self.stale_at_start.live(self.link.stats().stale);
                    self.live_is_due = true;
                    continue;
                }
                Event::Behind => {
                    (self.live_since, self.live_is_due) = (None, false);
                    self.stale_at_start.behind(now);
                }
                Event::Ahead => (self.live_since, self.live_is_due) = (None, false),
                Event::Alert(Alert::WallFarAhead) => self.wall_far_ahead = Some(now),
                Event::KeyExchange(frame) if self.agreement.wanted => {
                    self.agreement.queue(frame);
                    continue;
                }
                _ => {}
            }
            self.events.push_back(VehicleEvent::Link(event));
        }
        if self.live_is_due && vehicle.live() {
            self.live_is_due = false;
            self.events.push_back(VehicleEvent::Link(Event::Live));
        }
    }

    /// Reports a link event to operators and the log.
    pub(crate) fn report(&self, event: Event<Peer>, effects: &mut Effects<'_>) {
        match event {
            Event::PeerChanged { from, to } => {
                let text = match from {
                    None => format!("the vehicle's address is {to}"),
                    Some(from) => format!("the vehicle's address is {to}, it was {from}"),
                };
                effects.note(LogLevel::Info, text);
            }
            Event::Behind => {
                effects.note(
                    LogLevel::Info,
                    "the vehicle's timestamps are behind: it or this bridge has restarted",
                );
            }
            Event::Ahead => {
                effects.note(
                    LogLevel::Warning,
                    "the vehicle's timestamps are over an hour ahead: asking it for a proof that they are its own",
                );
            }
            Event::ClockMet(ahead) => {
                let text = format!(
                    "the signing clock moved {:.0} s ahead, to that of the vehicle: one of the two computers started \
                     with a wrong clock",
                    ahead.as_secs_f64()
                );
                effects.note(LogLevel::Warning, text);
            }
            Event::Live => {
                effects.note(LogLevel::Info, "the link is live");
                if let Some(key) = self.key.as_ref().map(KeyState::id) {
                    let text = format!("MAVLink is signed and verified, key {key}");
                    effects.notify(AlertPriority::Nominal, SubsystemId::Comms, text);
                }
            }
            // The agent drops unsigned frames, and itself reports when PX4 has lost its key.
            Event::Alert(Alert::VehicleUnsigned) if self.agent_is_here(effects.dli.now.mono) => {
                effects
                    .dli
                    .counters
                    .count("unsigned beside a verified agent");
            }
            Event::Alert(alert) => effects.warn_of_link(alert_text(alert)),
            // No exchange is configured for this vehicle.
            Event::KeyExchange(_) => effects.dli.counters.count("key exchange ignored"),
        }
    }
}

impl VehicleLink {
    /// Whether keys are agreed with an agent on the vehicle, and frames verify.
    fn agent_is_here(&self, mono: Duration) -> bool {
        let accepted = self.accepted_at();
        self.agreement.wanted && accepted.is_some_and(|at| mono.saturating_sub(at) < AGENT_HERE)
    }
}

/// Keys that the vehicle may have in place of the one in force.
impl VehicleLink {
    /// Starts the key recovery: the vehicle may have `next` instead of its key. No frame is delivered until its key is
    /// known.
    ///
    /// # Errors
    /// The disk cannot be read, or both are the same key.
    pub(crate) fn begin_key_recovery(
        &mut self,
        next: SigningKey,
        not_before: Stamp,
        now: Now,
        store: &mut dyn Disk,
    ) -> Result<(), StartError> {
        let (config, current) = (*self.link.config(), self.key.take());
        self.key_recovery
            .begin(config, current, next, not_before, now, store)
    }

    fn advance_key_recovery(&mut self, effects: &mut Effects<'_>) {
        let (key, out, events) = (&mut self.key, &mut self.out, &mut self.events);
        self.key_recovery
            .advance(effects.dli.now, key, out, events, effects.dli.disk);
    }

    /// Starts to look for this key in the vehicle's frames: the vehicle may start to sign with it at any moment.
    ///
    /// # Errors
    /// The clock of the key cannot be read.
    pub(crate) fn offer_next_key(
        &mut self,
        key: SigningKey,
        now: Now,
        not_before: Duration,
        store: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        let mut config = *self.link.config();
        // Heartbeats under the next key go to the vehicle's known address.
        if let Some(peer) = self.link.peer() {
            config.endpoint = Endpoint::Fixed(peer);
        }
        let current = self.key.as_ref();
        self.agreement
            .offer(config, key, current, now, not_before, store)
    }

    /// The vehicle already signs with the next key: puts it in force.
    pub(crate) fn adopt_next_key(&mut self, now: Now, store: &mut dyn Disk) {
        if let Some(next) = self.agreement.adopt(now, self.key.as_ref(), store) {
            self.key = Some(next);
        }
    }

    /// Stores the learned link id if it differs from the stored one.
    pub(crate) fn store_link_id(&mut self, effects: &mut Effects<'_>) {
        let learned = self.link.learned_link_id();
        // A learned id is replaced only by another one, so that a restart begins with the last known id.
        if learned.is_none() || self.stored_link_id == learned {
            return;
        }
        // No retry: a failing disk is logged once, and the id is learned again at the next start.
        self.stored_link_id = learned;
        let vehicle = effects.id;
        if let Err(fault) = effects.disk().save(&vehicle, &LinkId(learned)) {
            let text = format!("the vehicle's link id cannot be stored: {fault}");
            effects.note(LogLevel::Warning, text);
        }
    }
}

/// For the status.
impl VehicleLink {
    /// The age of our newest frame that the vehicle has certainly received; `None` on an unsigned link.
    pub(crate) fn last_answer(&self, mono: Duration) -> Option<Duration> {
        self.link.unanswered(mono)
    }

    /// The state of the link, for the status.
    pub(crate) fn link_state_name(&self, mono: Duration) -> &'static str {
        if self.key_recovery.is_open() {
            return "settling";
        }
        // Frames that are refused show that the vehicle is there only while they arrive.
        let refused = matches!(self.link.state(), LinkState::Behind | LinkState::Ahead);
        if refused && self.arrives(mono).is_none() {
            return "silent";
        }
        let unanswered = (self.unanswered(mono)).is_some_and(|age| age > UNANSWERED);
        state_name(self.link.state(), self.is_silent(mono), unanswered)
    }

    /// How long frames have been accepted without interruption; `None` if none is accepted now.
    pub(crate) fn live_for(&self, mono: Duration) -> Option<Duration> {
        let since = self.live_since.filter(|_| !self.is_silent(mono))?;
        Some(mono.saturating_sub(since))
    }

    /// How long ago a frame was last accepted.
    pub(crate) fn accepted_for(&self, mono: Duration) -> Option<Duration> {
        let at = self.link.accepted_at()?;
        Some(mono.saturating_sub(at))
    }

    /// The fraction of its frames that did not arrive; `None` of a silent link, whose measurement is of the time before.
    pub(crate) fn lost(&self, mono: Duration) -> Option<f64> {
        (self.loss.part()).filter(|_| !self.is_silent(mono))
    }

    /// Its state as a data link of the DLI.
    pub(crate) fn data_link(
        &self,
        mono: Duration,
        vehicle: &VehicleState,
        clock: &timesync::Client,
    ) -> DataLink {
        let signed = self.link.config().security == Security::Signed;
        let fresh = |at: Duration| mono.saturating_sub(at + self.stopped) <= FRESH;
        let verified = (self.verified).is_some_and(|(at, _)| fresh(at));
        DataLink {
            received: vehicle.live(),
            // Signatures prove it with every frame. Without signing, answers to TIMESYNC do, if the vehicle sends any.
            answered: match self.unanswered(mono) {
                Some(age) => Some(age <= UNANSWERED),
                None => clock.answers(),
            },
            signed,
            verified,
            lost: self.loss.part(),
            round_trip: clock.round_trip(),
            radio: vehicle.telemetry.equipment.radio,
        }
    }

    /// When a frame last verified and was accepted, and under which key.
    pub(crate) fn verified(&self) -> Option<(Duration, KeyId)> {
        self.verified
    }

    /// What arrives: verified frames, unverified ones, or the kind of refused data; `None` if nothing arrives.
    pub(crate) fn arrives(&self, mono: Duration) -> Option<&'static str> {
        let accepted = self.accepted_at();
        if accepted.is_some_and(|at| mono.saturating_sub(at) <= FRESH) {
            let signed = self.link.config().security == Security::Signed;
            return Some(if signed { "verified" } else { "not verified" });
        }
        // Where the clock cannot be stored, verified ones are refused: the finding names that.
        let refused = self.arrivals.refused(mono);
        refused
            .filter(|kind| *kind != Kind::Unstored)
            .map(Kind::name)
    }

    /// Whether this computer's clock is far ahead of the signing clock.
    pub(crate) fn wall_is_far_ahead(&self, mono: Duration) -> bool {
        // The link repeats this report every ten seconds while the condition lasts.
        self.wall_far_ahead
            .is_some_and(|at| mono.saturating_sub(at) < 2 * WALL_REPORTED_EVERY)
    }

    /// Evidence of why the vehicle is not received.
    pub(crate) fn evidence<'a>(
        &'a self,
        mono: Duration,
        config: &'a crate::config::Vehicle,
        (other, shared): (Option<u8>, bool),
    ) -> Evidence<'a> {
        // A vehicle that is received again has not had the time to answer.
        let received_for = mono.saturating_sub(self.live_since.unwrap_or_default());
        let unanswered = self.unanswered(mono);
        Evidence {
            mono,
            vehicle: config.id,
            address: &config.link,
            system: self.vehicle.system,
            key: self.key.as_ref().map(KeyState::id),
            arrivals: &self.arrivals,
            other,
            shared,
            encrypted: config.encrypt,
            accepted: self.accepted_at(),
            live_since: self.live_since,
            unanswered: unanswered.map(|age| age.min(received_for)),
        }
    }

    /// Stale frames from before the vehicle's clock was raised to ours. They occur at each start of PX4 and are not a fault.
    pub(crate) fn stale_at_start(&self, mono: Duration) -> u64 {
        self.stale_at_start.count(mono, self.stats().stale)
    }

    /// Frames that verified under the key but were refused, by reason.
    pub(crate) fn refused_though_verified(&self, mono: Duration) -> BTreeMap<&'static str, u64> {
        let stats = self.stats();
        [
            (
                "stale timestamp",
                stats.stale.saturating_sub(self.stale_at_start(mono)),
            ),
            ("stamp over an hour ahead", stats.future),
            ("another link's stream", stats.unexpected_link),
            ("too many streams", stats.stream_table_full),
            ("signing clock not stored", stats.ceiling_not_stored),
        ]
        .into_iter()
        .filter(|&(_, count)| count > 0)
        .collect()
    }

    /// Refused frames with the vehicle's system id, by reason.
    pub(crate) fn refused_frames(&self, mono: Duration) -> BTreeMap<&'static str, u64> {
        let stats = self.stats();
        let (unsigned, foreign) = self.key_recovery.refused_frames();
        [
            ("not signed", stats.unsigned_vehicle + unsigned),
            (
                "signature does not fit the key",
                stats.bad_signature + foreign,
            ),
            (
                "stale timestamp",
                stats.stale.saturating_sub(self.stale_at_start(mono)),
            ),
            ("stamp over an hour ahead", stats.future),
            ("another link's stream", stats.unexpected_link),
            ("stream not on the list", stats.not_listed),
            ("too many streams", stats.stream_table_full),
            ("signing clock not stored", stats.ceiling_not_stored),
            ("our own frame, reflected", stats.reflected),
            ("not from the peer", stats.wrong_peer),
        ]
        .into_iter()
        .filter(|&(_, count)| count > 0)
        .collect()
    }
}

/// PX4 starts its timestamps at the value in its key file, until one of our heartbeats raises them: its first frames verify
/// but are refused as stale. They differ from a replayed recording in that the link becomes live within [`LIFTED_WITHIN`].
#[derive(Debug, Default)]
struct StaleAtStart {
    /// Number of frames counted as such.
    counted: u64,
    /// Number of all stale frames when the link was last live.
    before: u64,
    /// Since when the vehicle's timestamps are behind.
    since: Option<Duration>,
}

impl StaleAtStart {
    fn behind(&mut self, mono: Duration) {
        self.since = Some(mono);
    }

    /// The bridge did not run for so long.
    fn note_stop(&mut self, stopped: Duration) {
        self.since = self.since.map(|since| since + stopped);
    }

    fn live(&mut self, stale: u64) {
        if self.since.take().is_some() {
            self.counted += stale - self.before;
        }
        self.before = stale;
    }

    fn count(&self, mono: Duration, stale: u64) -> u64 {
        let lifting = self
            .since
            .is_some_and(|at| mono.saturating_sub(at) <= LIFTED_WITHIN);
        let now = if lifting { stale - self.before } else { 0 };
        self.counted + now
    }
}

/// The same time that the link waits before it reports that the vehicle's timestamps stay behind.
const LIFTED_WITHIN: Duration = Duration::from_secs(5);
/// How often the link reports that the wall clock is far ahead.
const WALL_REPORTED_EVERY: Duration = Duration::from_secs(10);

/// The state of a link, for the status of the agent, and of a link that others command through.
pub(crate) fn link_state_name(link: &Link<Peer>, mono: Duration) -> &'static str {
    let silent = (link.accepted_at()).is_some_and(|at| mono.saturating_sub(at) > FRESH);
    let unanswered = link.unanswered(mono).is_some_and(|age| age > UNANSWERED);
    state_name(link.state(), silent, unanswered)
}

/// `silent`: frames were accepted, and none is now. `unanswered`: the other end has not confirmed for too long that it receives us.
fn state_name(state: LinkState, silent: bool, unanswered: bool) -> &'static str {
    match state {
        LinkState::Waiting => "waiting",
        LinkState::Live if silent => "silent",
        LinkState::Live if unanswered => "unanswered",
        LinkState::Live => "live",
        LinkState::Behind => "behind",
        LinkState::Ahead => "ahead",
    }
}

/// How long our frames may remain unanswered: heartbeats are sent each second, and some are lost.
const UNANSWERED: Duration = Duration::from_secs(5);

/// How the link signs and verifies: with the key, or not at all if signing is off by configuration.
fn auth<'a>(key: Option<&'a mut KeyState>, store: &'a mut dyn Disk) -> Auth<'a> {
    match key {
        Some(key) => Auth::Signed { key, store },
        None => Auth::Off,
    }
}

/// How long an accepted frame shows that the agent is there: it sends a heartbeat each second.
const AGENT_HERE: Duration = Duration::from_secs(3);

/// The text of a link alert for operators.
pub(crate) fn alert_text(alert: Alert) -> &'static str {
    use Alert as A;
    match alert {
        A::WallFarAhead => {
            "this computer's clock is over a year ahead of the signing clock: check it"
        }
        A::CeilingNotStored => {
            "the signing clock cannot be stored: nothing is sent to the vehicle and nothing of it accepted before it can be"
        }
        A::ClockExhausted => "the signing clock is exhausted: a new key is needed",
        A::StaysBehind => "the vehicle's timestamps stay behind: its frames are refused",
        A::VehicleUnsigned => "the vehicle sends unsigned: its key may be lost",
        A::BadSignatures => "many frames with bad signatures: an attack, or two keys",
        A::Future => "frames with timestamps over an hour ahead are refused",
        A::LinkIdMoved => "the autopilot signs with another link id",
        A::StreamTableFull => "too many signing streams: one is refused",
        A::Unanswered => "the vehicle is received but receives nothing from us: commands are lost",
        A::Copied => "somebody on the way copies the vehicle's frames and delivers them first",
    }
}
