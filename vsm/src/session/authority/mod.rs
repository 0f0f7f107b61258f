//! Who controls one vehicle: messages 1, 2, 4, 5, 34000 and 35000, the silence of holders, and what of it is stored.
//!
//! The rules are a pure machine ([`rules`]), checked over every reachable state. This machine asks them, stores what they
//! decide before it is answered ([`record`]; [`trail`] and [`audit`] its logs), and sends what follows ([`messages`] composes it). Whatever
//! leads to a decision goes the same way, [`AuthorityMachine::decide`].
//!
//! A disk can take its time. The rules go on deciding meanwhile ([`AuthorityMachine::decided`]), and what they decide
//! waits in order: until it is durable nobody but its asker's held answers shows it, nobody commands by it, and who
//! loses a right by it keeps that right ([`AuthorityMachine::rights`]).
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

use std::collections::{BTreeMap, VecDeque};
use std::ops::Deref;
use std::time::Duration;

use mapping::mode::Px4Mode;
use mavlink_link::dialect::MavLandedState;
use mavlink_link::store::{Changes, Disk, Durability, Progress, StoreError};
use stanag_msgs::enums::{
    AckType, AlertPriority, FlightPathControlMode as Mode, HandoverStatus, LoiBitmap,
    RequestedAccess, RouteType, SubsystemId, WaitTransition,
};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, PositiveHandoverAuthorisationRequest,
    VehicleDataLinkTransitionCoordination,
};
use stanag_msgs::{Id, Message};

use self::record::{AuthorityRecord, KnownStation, durability};
use self::rules::{
    Access, Answer, Authority, CONTROL, Change, Circumstances, Decision, Handover, Outcome, Reason,
    Refusal, Rights, Silence, Stage, Stations,
};
use super::alerts::{Cause, Raised};
use super::allowance::{Allowance, Rate};
use super::context::{self, MissionView, Origin, Transfer, WATCH_SLACK};
use super::effects::{Effects, Request};
use super::log::LogLevel;
use super::station::GroundStation;
use super::store::record_fault;
use crate::config::{self, OnLoss, Provisional};

/// The machine.
#[derive(Debug, Default)]
pub(crate) struct AuthorityMachine {
    /// The rights that hold: durable.
    rights: Authority,
    /// The rights by the latest decision, which may be on its way to the disk.
    decided: Authority,
    /// The decisions from `rights` to `decided`, in order.
    unstored: VecDeque<Unstored>,
    /// What each CUCS of the configuration may still change.
    allowances: BTreeMap<Id, Allowance>,
    record: AuthorityRecord,
}

/// A decision that takes effect once the disk has it.
#[derive(Debug)]
struct Unstored {
    /// The changes of the disk that it waits for.
    stored: Changes,
    /// The rights after it.
    rights: Authority,
    decision: Decision,
    of: Of,
    /// It changed the record.
    changed: bool,
    since: Duration,
}

/// What a decision came of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Of {
    /// Message 1: its sender is sent message 2 by who handles the message, which repeats the access that was requested.
    Request(Id),
    /// Message 4 or 34000, which have no answer of their own: their sender is sent message 2 where its rights change.
    Handover(Id),
    /// The silence of a holder, or its end.
    Silence(Id, Silence),
    /// Time has passed, or the vehicle flies otherwise.
    Waiting,
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
    /// The station is somewhere else, or may have missed something: it is sent what a new listener is.
    Returned { station: usize },
    /// Time has passed: how long is each holder silent?
    WatchSilence,
    /// A load may have ended, or the vehicle flies otherwise: what waited for that is decided.
    Settle,
    /// The disk has made changes durable: decisions that waited for it take effect.
    Stored,
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
        Message::CucsAuthorisationRequest(request) => requests_control(request),
        Message::PositiveHandoverAuthorisationRequest(_)
        | Message::VehicleDataLinkTransitionCoordination(_) => true,
        // By the right that it needs: a message that is added there is covered here.
        other => right_for(other, None).is_some_and(|right| right != LoiBitmap::LOI2),
    }
}

/// Whether a message 1 requests a right to command.
pub(crate) fn requests_control(request: &CucsAuthorisationRequest) -> bool {
    let levels = request.requested_handover_loi.unwrap_or(LoiBitmap::NONE);
    !releases(request) && levels.raw() & !LoiBitmap::LOI2.raw() != 0
}

/// Whether a message 1 gives up rights.
pub(crate) fn releases(request: &CucsAuthorisationRequest) -> bool {
    request.requested_handover_access == Some(RequestedAccess::Relinquish)
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
        self.decided.clone_from(&rights);
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

    /// Whether a CUCS holds anything, or will once the disk has it.
    pub(crate) fn has_rights(&self, id: Id) -> bool {
        !self.rights.held(id).is_empty() || !self.decided.held(id).is_empty()
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
            Input::Returned { station } => {
                if effects.listeners.contains(&station) {
                    welcome(context, station, effects);
                }
            }
            Input::WatchSilence => self.watch_silence(context, effects),
            Input::Settle => self.settle(context, effects),
            Input::Stored => self.conclude(context, effects),
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
            let held = self.decided.held(id);
            !held.control().is_empty() || !held.stations().is_empty()
        };
        let silences = stations
            .iter()
            .filter(|station| commands(station.id()))
            .filter_map(|station| {
                let known = self.decided.silence(station.id());
                station.silence_changes_at(known, now, limits)
            })
            .map(|at| at + WATCH_SLACK);
        let due = silences
            .chain(self.decided.poll_timeout())
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
        if let (false, Err(why)) = (releases(request), understood(context, request, levels)) {
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
        let answer = self.decide(context, Of::Request(asker.id), effects, |authority, at| {
            // With "wait for the transition" it is a wish, as by message 4; an override asks for nobody's consent.
            if waits_for_transition && access == Access::Control {
                authority.handover(at, &asker, asker.id, wanted)
            } else {
                authority.request(at, &asker, access, wanted, !stations.is_empty())
            }
        });
        if !is_too_often(&answer) {
            self.answer(context, origin.station, Some(request), effects);
        }
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

    /// Message 2, as the answer to a message: by what is decided, once that is durable.
    fn answer(
        &self,
        context: &Context<'_>,
        station: usize,
        request: Option<&CucsAuthorisationRequest>,
        effects: &mut Effects<'_>,
    ) {
        let Some(id) = context.asker(station).map(|asker| asker.id) else {
            return;
        };
        let by = |one: &Unstored| matches!(one.of, Of::Request(by) | Of::Handover(by) if by == id);
        if self.unstored.iter().any(by) {
            self.answer_after_decisions(effects);
        }
        // Who has led to none of the decisions that wait is answered at once, by the rights that hold.
        let rights = if effects.answers_later() {
            &self.decided
        } else {
            &self.rights
        };
        let held = rights.held(id);
        respond(context, station, held, request, effects);
    }

    /// What is answered from here on shows decisions that are not durable yet.
    fn answer_after_decisions(&self, effects: &mut Effects<'_>) {
        let stored = self.unstored.iter().map(|one| one.stored);
        if let Some(all) = stored.reduce(Changes::and) {
            effects.answer_after(all);
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
                if is_too_often(answer) {
                    // Who asks too often is not sent more than it sends.
                    effects.answer_sometimes(&[origin.station], text);
                } else {
                    effects.answer(&[origin.station], text);
                }
                AckType::Refused
            }
        }
    }
}

/// Decisions.
impl AuthorityMachine {
    /// Asks the rules, stores what they decide, and does what follows from it as soon as that is durable. The caller
    /// answers who asked.
    fn decide(
        &mut self,
        context: &Context<'_>,
        of: Of,
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
        let before = self.decided.clone();
        let decision = ask(&mut self.decided, &circumstances);
        // What changes nothing is not stored: a repeated request costs no write and adds no line to the audit log.
        let mut changed = self.decided.record() != before.record();
        if changed && !self.may_change(context, of, &decision) {
            self.decided = before;
            effects.dli.counters.count("too many changes of rights");
            return Answer::Refused {
                missing: Rights::NONE,
                why: Refusal::TooOften,
            };
        }
        let after = effects.disk().queued();
        if changed {
            let stored = if self.unstored.len() < MAX_UNSTORED {
                (self.record).store_decision(&self.decided, &decision, context, effects)
            } else {
                Err(record_fault(
                    "authority",
                    context.id(),
                    "the disk is too slow",
                ))
            };
            if let Err(fault) = stored {
                let text = format!("authority cannot be stored, nothing changes: {fault}");
                effects.warn(Cause::Store, text);
                // What a silent controller loses is no promise to anybody, and a restart finds it silent again: a disk
                // that fails keeps no aircraft from what is flown then.
                if !matches!(of, Of::Silence(_, Silence::Lost)) {
                    // A right that would not survive a restart is not granted.
                    self.decided = before;
                    return Answer::Refused {
                        missing: Rights::NONE,
                        why: Refusal::NotStored,
                    };
                }
                changed = false;
            }
        }
        let answer = decision.answer.clone();
        // What has not changed the disk waits for those before it all the same: it was decided by them.
        let stored = Changes {
            after,
            until: effects.disk().queued(),
        };
        self.unstored.push_back(Unstored {
            stored,
            rights: self.decided.clone(),
            decision,
            of,
            changed,
            since: context.mono(),
        });
        self.conclude(context, effects);
        if changed || answer != Answer::Granted {
            self.answer_after_decisions(effects);
        }
        answer
    }

    /// Whether who asks may have another decision stored: each costs a line of the audit log and a synchronised write.
    /// What only gives up rights is always allowed; what can be given up was requested before.
    fn may_change(&mut self, context: &Context<'_>, of: Of, decision: &Decision) -> bool {
        let (Of::Request(asker) | Of::Handover(asker)) = of else {
            return true;
        };
        let gives_up = decision.begun.is_empty() && decision.changes.iter().all(|c| c.to.is_none());
        if gives_up || durability(decision) == Durability::Process {
            return true;
        }
        let allowance = self.allowances.entry(asker).or_default();
        allowance.take(context.mono(), CHANGES)
    }

    /// Lets the decisions that are durable take effect.
    fn conclude(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        while let Some(one) = next(&mut self.unstored, effects.disk()) {
            self.take_effect(context, one, effects);
        }
    }

    fn take_effect(&mut self, context: &Context<'_>, one: Unstored, effects: &mut Effects<'_>) {
        let Unstored { decision, of, .. } = one;
        let before = std::mem::replace(&mut self.rights, one.rights);
        self.update_listeners(context, effects);
        if one.changed {
            effects.clear(Cause::Store, "authority is stored again");
        }
        let mut informed: Vec<Id> = match of {
            Of::Request(asker) => vec![asker],
            _ => Vec::new(),
        };
        for change in &decision.changes {
            for id in [change.from, change.to].into_iter().flatten() {
                if !informed.contains(&id) {
                    informed.push(id);
                    self.inform(context, id, effects);
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
        if let Of::Silence(id, silence) = of
            && before.controller() == Some(id)
        {
            self.report_silence(context, id, silence, effects);
        }
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
    fn inform(&self, context: &Context<'_>, id: Id, effects: &mut Effects<'_>) {
        if let Some(station) = context.station_of(id) {
            respond(context, station, self.rights.held(id), None, effects);
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
        if !self.decided.pending().is_empty() {
            self.decide(context, Of::Waiting, effects, Authority::look_again);
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
        let answer = self.decide(context, Of::Handover(by.id), effects, |authority, at| {
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
        let answer = self.decide(context, Of::Handover(by.id), effects, |authority, at| {
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
                self.inform(context, asker, effects);
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
            let takes_part = |one: &Handover| one.to == id || one.from == Some(id);
            let holds = !self.decided.held(id).is_empty();
            if holds || self.decided.pending().iter().any(takes_part) {
                self.record
                    .store_station(&self.decided, station, context, effects);
            }
            if !holds {
                continue;
            }
            let silence = station.silence(context.mono(), &context.settings.authority);
            let controls = self.decided.controller() == Some(id);
            let commands = controls || !self.decided.held(id).stations().is_empty();
            if silence != self.decided.silence(id) && commands {
                self.decide(
                    context,
                    Of::Silence(id, silence),
                    effects,
                    |authority, at| authority.silence_of(at, id, silence),
                );
            }
        }
        // Nor does a disk that takes its time, or never ends.
        let overdue = |one: &Unstored| {
            let waited = context.mono().saturating_sub(one.since);
            waited > DISK_WITHIN && matches!(one.of, Of::Silence(_, Silence::Lost))
        };
        while self.unstored.iter().any(overdue)
            && let Some(one) = self.unstored.pop_front()
        {
            self.take_effect(context, one, effects);
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

fn is_too_often(answer: &Answer) -> bool {
    let too_often = Refusal::TooOften;
    matches!(answer, Answer::Refused { why, .. } if *why == too_often)
}

/// Message 2.
fn respond(
    context: &Context<'_>,
    station: usize,
    held: Rights,
    request: Option<&CucsAuthorisationRequest>,
    effects: &mut Effects<'_>,
) {
    if let Some(asker) = context.asker(station) {
        let stamp = effects.stamp();
        let response = messages::response(context, &asker, held, request, stamp);
        effects.send(station, &response);
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

fn next(unstored: &mut VecDeque<Unstored>, disk: &dyn Disk) -> Option<Unstored> {
    let first = unstored.front()?;
    let durable = disk.progress(first.stored) == Progress::Durable;
    durable.then(|| unstored.pop_front()).flatten()
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

/// Changes of rights of one CUCS that are synchronised: four a second, 32 at once.
const CHANGES: Rate = Rate {
    cost: Duration::from_millis(250),
    burst: Duration::from_secs(8),
};
/// How long what is flown for a lost controller waits for the disk.
const DISK_WITHIN: Duration = Duration::from_secs(1);
/// Decisions that wait for the disk at most, of a vehicle.
const MAX_UNSTORED: usize = 256;
