//! Who controls one vehicle: messages 1, 2, 4, 5, 34000 and 35000, the silence of holders, and what of it is stored.
//!
//! The rules are a pure machine ([`rules`]), checked over every reachable state. This machine asks them, stores what they
//! decide before it is answered ([`record`]; [`trail`] and [`audit`] its logs), and sends what follows ([`messages`] composes it). Whatever
//! leads to a decision goes the same way, [`AuthorityMachine::decide`].
//!
//! The order of the actors in a handover is not documented in public sources: this one is ours, drawn in
//! docs/guide/authority.md. A wish (4 of the acquirer) is passed on to the holder as message 4 that names the acquirer; the
//! holder consents with the same. What a holder offers to its successor is sent to it as message 5. The acquirer is sent
//! the end of every handover by message 5: LOI Authorized is what was handed over, none where nothing was. 35000 reports
//! it to all who listen.

pub(crate) mod audit;
mod messages;
pub(crate) mod record;
pub(crate) mod rules;
#[cfg(test)]
mod tests;
pub(crate) mod trail;

use std::ops::Deref;
use std::time::Duration;

use mapping::mode::Px4Mode;
use mavlink_link::dialect::MavLandedState;
use mavlink_link::store::StoreError;
use stanag_msgs::enums::{
    AckType, AlertPriority, FlightPathControlMode as Mode, HandoverStatus, LoiBitmap,
    RequestedAccess, RouteType, SubsystemId, WaitTransition,
};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, PositiveHandoverAuthorisationRequest,
    VehicleDataLinkTransitionCoordination,
};
use stanag_msgs::{Id, Message};

use self::record::{AuthorityRecord, KnownStation};
use self::rules::{
    Access, Answer, Authority, CONTROL, Change, Circumstances, Decision, Handover, Outcome, Reason,
    Refusal, Rights, Silence, Stage, Stations,
};
use super::alerts::{Cause, Raised};
use super::context::{self, MissionView, Origin, Transfer, WATCH_SLACK};
use super::effects::{Effects, Request};
use super::log::LogLevel;
use super::station::GroundStation;
use crate::config::{self, OnLoss, Provisional};

/// The machine.
#[derive(Debug, Default)]
pub(crate) struct AuthorityMachine {
    rights: Authority,
    record: AuthorityRecord,
}

/// What it reads.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Context<'a> {
    pub(crate) common: context::Context<'a>,
    pub(crate) mission: MissionView<'a>,
    /// Set points for mode 15 go out.
    pub(crate) steering: bool,
}

impl<'a> Deref for Context<'a> {
    type Target = context::Context<'a>;

    fn deref(&self) -> &context::Context<'a> {
        &self.common
    }
}

/// What happens to it.
#[derive(Debug)]
pub(crate) enum Input<'a> {
    /// Message 1, to this vehicle or `to_all`.
    Authorise {
        origin: &'a Origin,
        request: &'a CucsAuthorisationRequest,
        to_all: bool,
    },
    /// Message 1 again, byte for byte, or a request for message 2.
    Again {
        station: usize,
        request: Option<&'a CucsAuthorisationRequest>,
    },
    /// Message 4.
    HandOver {
        origin: &'a Origin,
        request: &'a PositiveHandoverAuthorisationRequest,
    },
    /// Message 4 again, byte for byte: an answer to it may have been lost on either side.
    HandOverAgain { station: usize },
    /// 34000: the holder hands control to the acquiring CUCS, or the acquiring CUCS requests it.
    Transition {
        origin: Origin,
        message: &'a VehicleDataLinkTransitionCoordination,
    },
    /// Time has passed: how long is each holder silent?
    WatchSilence,
    /// A load may have ended, or the vehicle flies otherwise: what waited for that is decided.
    Settle,
}

/// The right that a message needs; `None` where it is none that a CUCS commands with. `mode`: what a 2016 is about.
pub(crate) fn right_for(message: &Message, mode: Option<Mode>) -> Option<LoiBitmap> {
    match message {
        Message::VehicleOperatingModeCommand(_) => Some(match mode {
            Some(Mode::Launch | Mode::AutolandEngage | Mode::AutolandWaveOff) => LoiBitmap::LOI5,
            _ => LoiBitmap::LOI4,
        }),
        Message::EngineCommand(_) => Some(LoiBitmap::LOI5),
        Message::LoiterConfiguration(_)
        | Message::UaStickCommand(_)
        | Message::UnmannedAircraftLights(_)
        | Message::MissionTransferCommand(_)
        | Message::UaRoute(_)
        | Message::UaPositionWaypoint(_)
        | Message::UaLoiterWaypoint(_)
        | Message::CurveSegment(_)
        | Message::CurveSegmentPaper(_)
        | Message::ParameterSetCommand(_)
        | Message::AreaVertex(_)
        | Message::AreaTransferCommand(_) => Some(LoiBitmap::LOI4),
        Message::ParameterRequest(_)
        | Message::PingRequest(_)
        | Message::SubsystemStatusRequest(_)
        | Message::SubsystemStatusDetailRequest(_) => Some(LoiBitmap::LOI2),
        _ => None,
    }
}

/// Whether a message moves the aircraft, changes what it will fly, or says who may: such a message needs a Time Stamp,
/// and comes in time. Of message 1 only what requests a right to command: a question changes nothing, and a release is
/// granted always.
pub(crate) fn commands(message: &Message) -> bool {
    match message {
        Message::CucsAuthorisationRequest(request) => {
            let levels = request.requested_handover_loi.unwrap_or(LoiBitmap::NONE);
            let relinquishes =
                request.requested_handover_access == Some(RequestedAccess::Relinquish);
            !relinquishes && levels.raw() & !LoiBitmap::LOI2.raw() != 0
        }
        Message::PositiveHandoverAuthorisationRequest(_)
        | Message::VehicleDataLinkTransitionCoordination(_) => true,
        // By the right that it needs: a message that is added there is covered here.
        other => right_for(other, None).is_some_and(|right| right != LoiBitmap::LOI2),
    }
}

impl AuthorityMachine {
    /// What a restart finds.
    ///
    /// # Errors
    /// A record exists and cannot be read.
    pub(crate) fn restore(
        &mut self,
        context: &context::Context<'_>,
        effects: &mut Effects<'_>,
    ) -> Result<Vec<KnownStation>, StoreError> {
        let (rights, known) = self.record.restore(context, effects)?;
        self.rights = rights;
        self.update_listeners(context, effects);
        self.record.restore_audit(&self.rights, context, effects)?;
        Ok(known)
    }

    /// A message that a restart has cut off: true where it still waits for a decision, and will be answered.
    pub(crate) fn resume(&mut self, context: &context::Context<'_>, origin: Origin) -> bool {
        let Some(id) = context.asker(origin.station).map(|asker| asker.id) else {
            return false;
        };
        let mut pending = self.rights.pending().iter();
        let waits = pending.any(|handover| handover.to == id || handover.from == Some(id));
        if waits {
            self.record.wait(id, origin);
        }
        waits
    }

    /// The rights.
    pub(crate) fn rights(&self) -> &Authority {
        &self.rights
    }

    /// The CUCS that holds LOI 4 or 5.
    pub(crate) fn controller(&self) -> Option<Id> {
        self.rights.controller()
    }

    /// Since when, on the clock since 1970, a CUCS has held what it holds.
    pub(crate) fn since(&self, id: Id) -> Option<Duration> {
        self.record.since(id)
    }

    /// Takes an input. The answer of [`Input::Authorise`] and [`Input::HandOver`] is for the caller to acknowledge.
    pub(crate) fn handle(
        &mut self,
        context: &Context<'_>,
        input: Input<'_>,
        effects: &mut Effects<'_>,
    ) -> AckType {
        match input {
            Input::Authorise {
                origin,
                request,
                to_all,
            } => {
                let answer = if to_all {
                    self.authorise_to_all(context, origin, request, effects)
                } else {
                    self.authorise(context, origin, request, effects)
                };
                return answer;
            }
            Input::HandOver { origin, request } => {
                return self.hand_over(context, origin, request, effects);
            }
            Input::Again { station, request } => self.answer(context, station, request, effects),
            Input::HandOverAgain { station } => {
                self.answer(context, station, None, effects);
                self.convey_pending(context, station, effects);
            }
            Input::Transition { origin, message } => {
                self.coordinate_transition(context, origin, message, effects);
            }
            Input::WatchSilence => self.watch_silence(context, effects),
            Input::Settle => self.settle(context, effects),
        }
        AckType::CarriedOut
    }

    /// When [`Input::Settle`] or [`Input::WatchSilence`] is next needed.
    pub(crate) fn poll_timeout(
        &self,
        now: Duration,
        stations: &[GroundStation],
        limits: &config::Authority,
    ) -> Option<Duration> {
        // Only the silence of who commands something leads to anything.
        let commands = |id| {
            let held = self.rights.held(id);
            !held.control().is_empty() || !held.stations().is_empty()
        };
        let silences = stations
            .iter()
            .filter(|station| commands(station.id()))
            .filter_map(|station| {
                let known = self.rights.silence(station.id());
                station.silence_changes_at(known, now, limits)
            })
            .map(|at| at + WATCH_SLACK);
        let due = silences
            .chain(self.rights.poll_timeout())
            .chain(self.record.poll_timeout())
            .min()?;
        // A decision that could not be stored is still due: it is tried again from time to time, not as fast as it fails.
        let failed = due + WATCH_SLACK < now;
        Some(if failed { now + WATCH_SLACK } else { due })
    }
}

/// Message 1.
impl AuthorityMachine {
    /// To this vehicle: a request, a release, or a question where it names no access.
    fn authorise(
        &mut self,
        context: &Context<'_>,
        origin: &Origin,
        request: &CucsAuthorisationRequest,
        effects: &mut Effects<'_>,
    ) -> AckType {
        let Some(asker) = context.asker(origin.station) else {
            return AckType::Refused;
        };
        let levels = request.requested_handover_loi.unwrap_or(LoiBitmap::NONE);
        // A release is always granted, whatever else the message says.
        let releases = request.requested_handover_access == Some(RequestedAccess::Relinquish);
        if let (false, Err(why)) = (releases, understood(context, request, levels)) {
            self.answer(context, origin.station, Some(request), effects);
            effects.answer(&[origin.station], format!("message 1 refused: {why}"));
            return AckType::Refused;
        }
        let stations = Stations::from_bitmaps(
            request.controlled_station_1_16,
            request.controlled_station_17_32,
        );
        let access = match request.requested_handover_access {
            Some(RequestedAccess::Relinquish) => Access::Release,
            Some(RequestedAccess::Request) if !levels.is_empty() => Access::Control,
            Some(RequestedAccess::Override) if !levels.is_empty() => Access::Override,
            _ => return self.question(context, origin.station, request, effects),
        };
        let wanted = Rights::named(levels, stations);
        let waits_for_transition = request
            .wait_for_vehicle_data_link_transition_coordination_message
            == Some(WaitTransition::Wait);
        let answer = self.decide(context, Some(asker.id), effects, |authority, at| {
            // With "wait for the transition" it is a wish, as by message 4; an override asks for nobody's consent.
            if waits_for_transition && access == Access::Control {
                authority.handover(at, &asker, asker.id, wanted)
            } else {
                authority.request(at, &asker, access, wanted, !stations.is_empty())
            }
        });
        self.answer(context, origin.station, Some(request), effects);
        self.acknowledgement(origin, asker.id, &answer, effects)
    }

    /// To everybody, or to the VSM. It is a question for each vehicle, as a discovery is; a release of levels that it
    /// names is one of each vehicle. Rights are given by a vehicle alone.
    fn authorise_to_all(
        &mut self,
        context: &Context<'_>,
        origin: &Origin,
        request: &CucsAuthorisationRequest,
        effects: &mut Effects<'_>,
    ) -> AckType {
        let named = request
            .requested_handover_loi
            .is_some_and(|levels| !levels.is_empty());
        let holds_something = || {
            let asker = context.asker(origin.station);
            asker.is_some_and(|asker| !self.rights.held(asker.id).is_empty())
        };
        let why = match request.requested_handover_access {
            Some(RequestedAccess::Relinquish) if named => {
                return self.authorise(context, origin, request, effects);
            }
            // Who discovers requests no acknowledgement; who requests one, and holds something, meant to release it.
            Some(RequestedAccess::Relinquish) if origin.ack_requested && holds_something() => {
                "nothing is released: name the levels, or send it to the vehicle"
            }
            Some(RequestedAccess::Request | RequestedAccess::Override) => {
                "rights must be requested from a single vehicle"
            }
            Some(RequestedAccess::Unknown(_)) if named => {
                "Requested/Handover Access is out of range: expected 0 to 2"
            }
            _ => return self.question(context, origin.station, request, effects),
        };
        self.answer(context, origin.station, Some(request), effects);
        effects.answer(&[origin.station], format!("message 1 refused: {why}"));
        AckType::Refused
    }

    /// A message 1 that changes nothing: what the station may have and holds, and what it has not answered yet.
    fn question(
        &mut self,
        context: &Context<'_>,
        station: usize,
        request: &CucsAuthorisationRequest,
        effects: &mut Effects<'_>,
    ) -> AckType {
        self.answer(context, station, Some(request), effects);
        self.convey_pending(context, station, effects);
        AckType::CarriedOut
    }

    /// Message 2.
    fn answer(
        &self,
        context: &Context<'_>,
        station: usize,
        request: Option<&CucsAuthorisationRequest>,
        effects: &mut Effects<'_>,
    ) {
        if let Some(asker) = context.asker(station) {
            let held = self.rights.held(asker.id);
            let stamp = effects.stamp();
            let response = messages::response(context, &asker, held, request, stamp);
            effects.send(station, &response);
        }
    }

    /// What 17000 says of an answer. One that waits is acknowledged again when it is decided.
    fn acknowledgement(
        &mut self,
        origin: &Origin,
        asker: Id,
        answer: &Answer,
        effects: &mut Effects<'_>,
    ) -> AckType {
        match answer {
            Answer::Granted => AckType::CarriedOut,
            Answer::Waits => {
                self.record.wait(asker, *origin);
                AckType::Received
            }
            Answer::Refused { missing, why } => {
                let what = if *missing == Rights::NONE {
                    "refused".to_owned()
                } else {
                    format!("{missing} refused")
                };
                let text = format!("message {}: {what}: {why}", origin.message_type);
                effects.answer(&[origin.station], text);
                AckType::Refused
            }
        }
    }
}

/// Decisions.
impl AuthorityMachine {
    /// Asks the rules, stores what they decide, and does what follows from it. The caller answers `asker`.
    fn decide(
        &mut self,
        context: &Context<'_>,
        asker: Option<Id>,
        effects: &mut Effects<'_>,
        ask: impl FnOnce(&mut Authority, &Circumstances<'_>) -> Decision,
    ) -> Answer {
        let roster = context.roster();
        let circumstances = Circumstances {
            now: context.mono(),
            roster: &roster,
            loading: loading(context),
            launch_or_landing: launch_or_landing(context),
        };
        let before = self.rights.clone();
        let decision = ask(&mut self.rights, &circumstances);
        self.update_listeners(context, effects);
        // What changes nothing is not stored: a repeated request costs no write and adds no line to the audit log.
        if self.rights.record() != before.record()
            && let Err(fault) =
                self.record
                    .store_decision(&self.rights, &decision, context, effects)
        {
            // A right that would not survive a restart is not granted.
            self.rights = before;
            self.update_listeners(context, effects);
            let text = format!("authority cannot be stored, nothing changes: {fault}");
            effects.warn(Cause::Store, text);
            return Answer::Refused {
                missing: Rights::NONE,
                why: Refusal::NotStored,
            };
        }
        // The caller sends the asker its message 2, which repeats the access that was requested.
        let mut informed: Vec<Id> = asker.into_iter().collect();
        for change in &decision.changes {
            for id in [change.from, change.to].into_iter().flatten() {
                if !informed.contains(&id) {
                    informed.push(id);
                    self.answer_by_id(context, id, effects);
                }
            }
        }
        let lost =
            |change: &Change| change.from == before.controller() && change.why == Reason::Lost;
        let lost = decision.changes.iter().any(lost);
        self.report_change_of_control(before.controller(), lost, effects);
        self.report_handovers(context, &decision, effects);
        for station in 0..context.stations.len() {
            let Some(asker) = context.asker(station) else {
                continue;
            };
            let listens = self.rights.holds(asker.id, LoiBitmap::LOI2);
            if listens != before.holds(asker.id, LoiBitmap::LOI2) {
                effects.request(Request::ListenerChanged { station });
                if listens {
                    welcome(context, station, effects);
                }
            }
        }
        decision.answer
    }

    fn update_listeners(&self, context: &context::Context<'_>, effects: &mut Effects<'_>) {
        effects.listeners.clear();
        let stations = context.stations.iter().enumerate();
        let listens = |station: &GroundStation| self.rights.holds(station.id(), LoiBitmap::LOI2);
        effects.listeners.extend(
            stations
                .filter(|(_, one)| listens(one))
                .map(|(index, _)| index),
        );
    }

    /// Message 2 to a CUCS whose rights have changed.
    fn answer_by_id(&self, context: &Context<'_>, id: Id, effects: &mut Effects<'_>) {
        if let Some(station) = context.station_of(id) {
            self.answer(context, station, None, effects);
        }
    }

    /// `lost`: the controller has lost control by silence, which has alerts of its own.
    fn report_change_of_control(&self, from: Option<Id>, lost: bool, effects: &mut Effects<'_>) {
        let to = self.rights.controller();
        if from == to {
            return;
        }
        let name = |id: Option<Id>| id.map_or_else(|| "nobody".to_owned(), |id| id.to_string());
        let text = format!("control passes from {} to {}", name(from), name(to));
        effects.note(LogLevel::Info, text);
        match to {
            Some(to) => effects.clear(Cause::CucsSilent, &format!("{to} controls the vehicle")),
            None if !lost => effects.clear(
                Cause::CucsSilent,
                "control was released, nobody controls the vehicle",
            ),
            None => {}
        }
        effects.request(Request::ControlChanged);
    }

    /// Lets a decision that waited be taken: a load has ended, the vehicle flies otherwise, time has passed.
    fn settle(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        if !self.rights.pending().is_empty() {
            self.decide(context, None, effects, Authority::look_again);
        }
    }
}

/// Positive handover: messages 4, 5, 34000, 35000.
impl AuthorityMachine {
    fn hand_over(
        &mut self,
        context: &Context<'_>,
        origin: &Origin,
        request: &PositiveHandoverAuthorisationRequest,
        effects: &mut Effects<'_>,
    ) -> AckType {
        let Some(by) = context.asker(origin.station) else {
            return AckType::Refused;
        };
        let acquirer = request
            .requesting_cucs_id
            .filter(|id| *id != Id::NULL)
            .unwrap_or(by.id);
        let stations = Stations::from_bitmaps(
            request.controlled_station_1_16,
            request.controlled_station_17_32,
        );
        let levels = request.requested_handover_loi.unwrap_or(LoiBitmap::NONE);
        let wanted = Rights::named(levels, stations);
        // No asker: message 4 has no answer of its own, so its sender too gets message 2 where its rights change.
        let answer = self.decide(context, None, effects, |authority, at| {
            authority.handover(at, &by, acquirer, wanted)
        });
        self.acknowledgement(origin, by.id, &answer, effects)
    }

    /// The link to the vehicle stays where it is: a message that would set the radio is refused.
    fn coordinate_transition(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        message: &VehicleDataLinkTransitionCoordination,
        effects: &mut Effects<'_>,
    ) {
        let Some(by) = context.asker(origin.station) else {
            return;
        };
        let why = if context.settings.provisional != Provisional::All {
            Some(
                "34000 is derived from Edition 2: it is carried out with dli.provisional = \"all\" only",
            )
        } else if messages::sets_radio(message) {
            Some("34000: this VSM's vehicle link has no frequency and no code to set")
        } else if message.acquiring_cucs_id.is_none_or(|id| id == Id::NULL) {
            Some("34000: Acquiring CUCS ID is missing")
        } else {
            None
        };
        if let Some(why) = why {
            return effects.refuse(Some(origin), why);
        }
        let acquirer = message.acquiring_cucs_id.unwrap_or(by.id);
        // 34000 stands for message 4 with LOI 4 and 5, which move together.
        let wanted = Rights::of_control(CONTROL);
        let answer = self.decide(context, None, effects, |authority, at| {
            authority.handover(at, &by, acquirer, wanted)
        });
        let answer = self.acknowledgement(&origin, by.id, &answer, effects);
        effects.acknowledge(&origin, answer);
    }

    /// Reports the handovers that began and ended.
    fn report_handovers(
        &mut self,
        context: &Context<'_>,
        decision: &Decision,
        effects: &mut Effects<'_>,
    ) {
        for handover in &decision.begun {
            self.convey(context, handover, effects);
            let Handover {
                from, to, rights, ..
            } = *handover;
            let status = HandoverStatus::InProgress;
            self.report_handover(context, from, Some(to), status, effects);
            let holder = from.map_or_else(|| "nobody".to_owned(), |id| id.to_string());
            let text = match handover.stage {
                Stage::Consent(_) => format!("{to} requests {rights} from {holder}"),
                Stage::Acceptance(_) => format!("{holder} offers {rights} to {to}"),
                Stage::Load(_) => format!("{rights} passes to {to} once the load has ended"),
            };
            effects.answer(&parties(context, handover), text);
        }
        for ended in &decision.ended {
            let handover = &ended.handover;
            let (status, rights) = match ended.outcome {
                Outcome::Completed(rights) => (HandoverStatus::Successful, rights),
                _ => (HandoverStatus::Failed, Rights::NONE),
            };
            authorise_handover(context, handover.to, rights, effects);
            self.report_handover(context, handover.from, Some(handover.to), status, effects);
            let text = format!("handover to {}: {}", handover.to, ended.outcome);
            effects.answer(&parties(context, handover), text);
            // Who requested it by a message that waited is answered once nothing of that request is left.
            for (asker, origin) in self.record.ended(handover, self.rights.pending()) {
                let answer = match ended.outcome {
                    Outcome::Completed(_) => AckType::CarriedOut,
                    _ => AckType::Refused,
                };
                self.answer_by_id(context, asker, effects);
                effects.acknowledge(&origin, answer);
            }
        }
    }

    /// What a station is asked for, or offered, and has not answered: sent again, since it may never have arrived.
    fn convey_pending(&self, context: &Context<'_>, station: usize, effects: &mut Effects<'_>) {
        let Some(by) = context.asker(station) else {
            return;
        };
        for handover in self.rights.pending() {
            if handover.to == by.id || handover.from == Some(by.id) {
                self.convey(context, handover, effects);
            }
        }
    }

    /// Passes a wish on to the holder, an offer on to the successor.
    fn convey(&self, context: &Context<'_>, handover: &Handover, effects: &mut Effects<'_>) {
        match handover.stage {
            Stage::Consent(_) => {
                let holder = handover.from.and_then(|holder| context.station_of(holder));
                if let Some(holder) = holder {
                    let stamp = effects.stamp();
                    effects.send(holder, &messages::wish(context, handover, stamp));
                }
            }
            Stage::Acceptance(_) => {
                authorise_handover(context, handover.to, handover.rights, effects);
            }
            Stage::Load(_) => {}
        }
    }

    /// 35000, to the two and to all who listen. The null id stands for nobody.
    fn report_handover(
        &self,
        context: &Context<'_>,
        from: Option<Id>,
        to: Option<Id>,
        status: HandoverStatus,
        effects: &mut Effects<'_>,
    ) {
        if context.settings.provisional == Provisional::Off {
            return;
        }
        let message = messages::handover_status(from, to, status, effects.stamp());
        // The parties need not listen: an acquirer may hold nothing yet, a holder may have just lost everything.
        let mut stations = effects.listeners.clone();
        for party in [from, to].into_iter().flatten() {
            let station = context.station_of(party);
            stations.extend(station.filter(|index| !stations.contains(index)));
        }
        for station in stations {
            effects.publish(station, &message);
        }
    }
}

/// The silence of holders: warned of, offered to others, acted on. Each step goes out by 16000 and 35000.
impl AuthorityMachine {
    fn watch_silence(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        self.record.write_repetitions(context, effects);
        for station in context.stations {
            let id = station.id();
            if self.rights.held(id).is_empty() {
                continue;
            }
            let silence = station.silence(context.mono(), &context.settings.authority);
            self.record
                .store_heartbeats(&self.rights, station, context, effects);
            let controls = self.rights.controller() == Some(id);
            let commands = controls || !self.rights.held(id).stations().is_empty();
            if silence != self.rights.silence(id) && commands {
                self.decide(context, None, effects, |authority, at| {
                    authority.silence_of(at, id, silence)
                });
                if controls {
                    self.report_silence(context, id, silence, effects);
                }
            }
        }
        self.settle(context, effects);
    }

    fn report_silence(
        &self,
        context: &Context<'_>,
        id: Id,
        silence: Silence,
        effects: &mut Effects<'_>,
    ) {
        let (priority, text, status) = match silence {
            Silence::None => {
                effects.clear(Cause::CucsSilent, "link to the controlling CUCS restored");
                let status = HandoverStatus::NotRequested;
                return self.report_handover(context, Some(id), None, status, effects);
            }
            Silence::Warned => (
                AlertPriority::Caution,
                format!("no data from the controlling CUCS {id}"),
                HandoverStatus::NotRequested,
            ),
            Silence::Offered => (
                AlertPriority::Warning,
                format!("no data from the controlling CUCS {id}: another may take control"),
                HandoverStatus::InProgress,
            ),
            Silence::Lost => (
                AlertPriority::Emergency,
                format!(
                    "the controlling CUCS {id} is lost, nobody controls the vehicle: {}",
                    what_follows(context)
                ),
                HandoverStatus::Failed,
            ),
        };
        // Who asked before has it already: nothing is offered, and nothing is flown.
        let taken = self.rights.controller().is_some_and(|holder| holder != id);
        if taken {
            return;
        }
        // The silent one too: it may still receive.
        let mut to = effects.listeners.clone();
        to.extend(context.station_of(id));
        to.sort_unstable();
        to.dedup();
        let raised = effects
            .alerts
            .raise(Cause::CucsSilent, priority, SubsystemId::Comms, text);
        effects.dli.alert(context.id(), &to, raised);
        self.report_handover(context, Some(id), None, status, effects);
        if silence == Silence::Lost {
            // After `ControlChanged`, which the decision has requested: that puts a steered vehicle on hold, and would
            // supersede the action if it came second.
            effects.request(Request::ControllerLost);
        }
    }
}

/// What is flown now that nobody controls the vehicle, as far as it is known before the vehicle shows it.
fn what_follows(context: &Context<'_>) -> &'static str {
    let on_loss = context.settings.authority.on_loss;
    let telemetry = &context.vehicle.telemetry;
    if !context.vehicle.live() {
        return match on_loss {
            OnLoss::Continue => "no data from the vehicle either",
            _ => "no data from the vehicle either, it is commanded once its link is restored",
        };
    }
    if telemetry.landed == Some(MavLandedState::MAV_LANDED_STATE_ON_GROUND) {
        return "vehicle is on the ground, nothing is commanded";
    }
    let mission = &context.mission;
    let stored = mission
        .plan
        .route_of_type(RouteType::ContingencyA)
        .is_some();
    match on_loss {
        // A vehicle that was steered (mode 15) would fly straight on: it is held even where nothing is to be flown.
        OnLoss::Continue if context.steering => "steering stopped; commanding hold",
        OnLoss::Continue => "vehicle continues in its current mode",
        OnLoss::Hold => "commanding hold",
        OnLoss::Contingency if stored && mission.may_change.is_err() => {
            "another transfer is in progress; commanding return"
        }
        OnLoss::Contingency if stored => "commanding contingency A",
        OnLoss::Contingency => "no contingency A is stored; commanding return",
        OnLoss::Rtl => "commanding return",
    }
}

/// What a station that begins to listen is sent first: message 3, and the alerts that stand.
fn welcome(context: &Context<'_>, station: usize, effects: &mut Effects<'_>) {
    let stamp = effects.stamp();
    let message = context.vehicle_id(&context.mission, stamp).into();
    effects.send(station, &message);
    for alert in effects.alerts.standing().cloned().collect::<Vec<_>>() {
        // For this station it is the first instance, however long the alert has stood.
        let raised = Raised { alert, first: true };
        effects.dli.alert(context.id(), &[station], Some(raised));
    }
}

/// Message 5.
fn authorise_handover(
    context: &Context<'_>,
    acquirer: Id,
    rights: Rights,
    effects: &mut Effects<'_>,
) {
    if let Some(station) = context.station_of(acquirer) {
        let stamp = effects.stamp();
        effects.send(
            station,
            &messages::authorised(context, acquirer, rights, stamp),
        );
    }
}

fn parties(context: &Context<'_>, handover: &Handover) -> Vec<usize> {
    let ids = [handover.from, Some(handover.to)].into_iter().flatten();
    ids.filter_map(|id| context.station_of(id)).collect()
}

/// Who loads a mission just now; the null id where the VSM does by itself.
fn loading(context: &Context<'_>) -> Option<Id> {
    match context.mission.transfer {
        Transfer::None => None,
        Transfer::Running { owner, .. } => {
            let station = owner.and_then(|index| context.asker(index));
            Some(station.map_or(Id::NULL, |station| station.id))
        }
    }
}

fn launch_or_landing(context: &Context<'_>) -> bool {
    // By what the vehicle shows, not what was commanded: AUTO.LAND by PX4's own failsafe counts too.
    let telemetry = &context.vehicle.telemetry;
    telemetry.armed == Some(true)
        && matches!(telemetry.mode, Some(Px4Mode::TAKEOFF | Px4Mode::LAND))
}

/// Whether every value of message 1 is one that is known: of what is not nothing is granted.
fn understood(
    context: &Context<'_>,
    request: &CucsAuthorisationRequest,
    levels: LoiBitmap,
) -> Result<(), String> {
    if !context.is_addressed(request.vsm_id) {
        return Err("VSM ID is another VSM's".to_owned());
    }
    // Without levels it is a question, whatever it names as access.
    if let Some(RequestedAccess::Unknown(access)) = request.requested_handover_access
        && !levels.is_empty()
    {
        return Err(format!(
            "Requested/Handover Access {access}, expected 0 to 2"
        ));
    }
    let unknown = levels.raw() & !LoiBitmap::LOI2.union(LoiBitmap::LOI3).union(CONTROL).raw();
    if unknown != 0 {
        return Err(format!(
            "Requested/Handover LOI {:#04x}: bits {unknown:#04x} are out of range: expected LOI 2 to 5",
            levels.raw()
        ));
    }
    Ok(())
}
