//! Control of one vehicle: messages 1, 2, 4, 5, 34000 and 35000, silent holders, and the stored record.
//!
//! The rules are a pure machine ([`rules`]), checked over every reachable state. This machine asks them, stores their
//! decision before it answers, and sends the resulting messages. Its parts, in the order in which an input passes through
//! them:
//!
//! 1. Causes of a decision: [`authorisation`], message 1; [`positive_handover`], messages 4 and 34000; [`silence`] of a
//!    holder.
//! 2. [`decisions`]: each of them is decided by [`AuthorityMachine::decide`].
//! 3. [`record`]: the stored record of a decision; [`trail`] and [`audit`] are its logs.
//! 4. [`messages`]: composes the messages to send.
//!
//! This file has their shared state, and the right that each message needs ([`right_for`]).

pub(crate) mod audit;
mod authorisation;
mod decisions;
mod messages;
mod positive_handover;
pub(crate) mod record;
pub(crate) mod rules;
mod silence;
#[cfg(test)]
mod tests;
pub(crate) mod trail;

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use mavlink_link::store::{Changes, StoreError};
use stanag_msgs::enums::{
    AckType, FlightPathControlMode as Mode, HandoverStatus, LoiBitmap, RequestedAccess,
};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, PositiveHandoverAuthorisationRequest,
    VehicleDataLinkTransitionCoordination,
};
use stanag_msgs::{Id, Message};

use self::record::{AuthorityRecord, KnownStation};
use self::rules::{Authority, Circumstances, Decision, Handover, Silence};
use super::alerts::Raised;
use super::allowance::Allowance;
use super::context::{self, MissionView, Origin, WATCH_SLACK};
use super::effects::{Effects, Request};
use super::other::Other;
use super::station::GroundStation;
use crate::config;

/// The machine.
#[derive(Debug, Default)]
pub(crate) struct AuthorityMachine {
    /// The rights in force: durable.
    rights: Authority,
    /// The rights after the latest decision, which may not be durable yet.
    decided: Authority,
    /// The decisions from `rights` to `decided`, in order.
    unstored: VecDeque<Unstored>,
    /// Rate limits of the changes of each configured CUCS. Limits for decisions about LOI 2 alone, and for all others.
    allowances: BTreeMap<Id, (Allowance, Allowance)>,
    record: AuthorityRecord,
    passed: LastHandover,
    /// Pending handovers that were passed on just now.
    conveyed: Vec<(Handover, Allowance)>,
}

/// How control last passed, for later requests: the 35000 that was sent may have been lost. Not kept over a restart.
#[derive(Debug, Default)]
struct LastHandover {
    /// The last controller.
    holder: Option<Id>,
    /// The latest handover that has ended: relinquishing, acquiring, and how.
    ended: Option<(Option<Id>, Id, HandoverStatus)>,
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

/// The cause of a decision.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Of {
    /// Message 1: the handler of the message sends message 2 to its sender, which repeats the requested access.
    Request(Id),
    /// Message 4 or 34000, which have no answer of their own: their sender receives message 2 if its rights change.
    Handover(Id),
    /// A holder has become silent, or is no longer silent.
    Silence(Id, Silence),
    /// A reloaded configuration.
    Configuration,
    /// Time has passed, or the vehicle's mode has changed.
    Waiting,
}

impl Of {
    /// Whether it takes rights away even if the disk fails: a restart would take them away too.
    fn cannot_wait(self) -> bool {
        matches!(self, Of::Silence(_, Silence::Lost) | Of::Configuration)
    }
}

/// What it reads.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Context<'a> {
    pub(crate) common: context::Context<'a>,
    pub(crate) mission: MissionView<'a>,
    /// Set points for mode 15 are being sent.
    pub(crate) steering: bool,
    /// Who else flies the vehicle.
    pub(crate) other: Option<Other>,
    /// A contingency is commanded before the loss action.
    pub(crate) contingency_first: bool,
    /// The vehicle already flies what would be commanded for a lost controller.
    pub(crate) shows_loss_action: bool,
    /// The number of the held command that the vehicle is moved by once the controller is lost.
    pub(crate) held_for_loss: Option<u16>,
}

context::deref_to_common!(Context);

/// An input.
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
    /// A request for 35000.
    ReportHandover { station: usize },
    /// Message 4.
    HandOver {
        origin: &'a Origin,
        request: &'a PositiveHandoverAuthorisationRequest,
    },
    /// Message 4 again, byte for byte: an answer to it may have been lost in either direction.
    HandOverAgain { station: usize },
    /// 34000: the holder hands control to the acquiring CUCS, or the acquiring CUCS requests it.
    Transition {
        origin: Origin,
        message: &'a VehicleDataLinkTransitionCoordination,
    },
    /// The station has moved, or may have missed messages: it receives the same messages as a new listener, and where it has
    /// `missed` answers, message 2.
    Returned { station: usize, missed: bool },
    /// The configuration, in the context, has changed.
    Reconfigured,
    /// This vehicle was removed from the configuration: all its rights end.
    Removed,
    /// An entry about a flight termination for the audit log.
    Audit {
        what: &'static str,
        by: Option<Id>,
        why: &'a str,
    },
    /// Time has passed: check for silent holders.
    WatchSilence,
    /// A load may have ended, or the vehicle's mode has changed: decide what waited for that.
    Settle,
    /// The disk has made changes durable: apply the decisions that waited for it.
    Stored,
}

/// The right that a message needs; `None` if the message is not a command of a CUCS. `mode`: the mode of a 2016.
pub(crate) fn right_for(message: &Message, mode: Option<Mode>) -> Option<LoiBitmap> {
    match message {
        Message::VehicleOperatingModeCommand(_) => Some(match mode {
            Some(Mode::Launch | Mode::AutolandEngage | Mode::AutolandWaveOff) => LoiBitmap::LOI5,
            _ => LoiBitmap::LOI4,
        }),
        Message::EngineCommand(_) | Message::FlightTerminationCommand(_) => Some(LoiBitmap::LOI5),
        Message::LoiterConfiguration(_)
        | Message::UaStickCommand(_)
        | Message::UnmannedAircraftLights(_)
        | Message::MissionTransferCommand(_)
        | Message::UaRoute(_)
        | Message::UaPositionWaypoint(_)
        | Message::UaLoiterWaypoint(_)
        // It also needs a payload station; the mission machine checks that.
        | Message::PayloadActionWaypoint(_)
        | Message::VehicleSpecificWaypoint(_)
        | Message::CurveSegment(_)
        | Message::CurveSegmentPaper(_)
        | Message::ParameterSetCommand(_)
        | Message::AreaVertex(_)
        | Message::AreaTransferCommand(_)
        | Message::Contingency(_)
        // As for the command in it, if that can be decoded: the caller checks it.
        | Message::HoldCommand(_) => Some(LoiBitmap::LOI4),
        Message::ZeroizeCommand(_) => Some(LoiBitmap::LOI5),
        // For the payload station that it names; the payload machine checks that.
        Message::PayloadSteeringCommand(_) | Message::EoIrLaserPayloadCommand(_) => {
            Some(LoiBitmap::LOI3)
        }
        // A CUCS may cancel its own commands with any right that it still holds.
        Message::HeldCommandCancel(_)
        | Message::ParameterRequest(_)
        | Message::PingRequest(_)
        | Message::DataLinkControlRequest(_)
        | Message::SubsystemStatusRequest(_)
        | Message::SubsystemStatusDetailRequest(_) => Some(LoiBitmap::LOI2),
        _ => None,
    }
}

/// Whether a message moves the aircraft, changes what it will fly, or changes who controls it: such a message needs a Time
/// Stamp and must be recent. This includes a message 1 only if it requests a right to command: a query changes nothing, and
/// a release is always granted.
pub(crate) fn commands(message: &Message) -> bool {
    match message {
        Message::CucsAuthorisationRequest(request) => requests_control(request),
        Message::PositiveHandoverAuthorisationRequest(_)
        | Message::VehicleDataLinkTransitionCoordination(_)
        | Message::HeldCommandCancel(_) => true,
        // Decided by the needed right, so that a message added there is covered here too.
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
    /// Restores the record after a restart.
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
        self.passed.holder = rights.controller();
        self.rights = rights;
        self.update_listeners(context, effects);
        self.record.restore_audit(&self.rights, context, effects)?;
        Ok(known)
    }

    /// Resumes a message that a restart interrupted. Returns true if it still waits for a decision and will be answered.
    pub(crate) fn resume(&mut self, context: &context::Context<'_>, origin: Origin) -> bool {
        let Some(id) = context.asker(origin.station).map(|asker| asker.id) else {
            return false;
        };
        let mut pending = self.rights.pending().iter();
        let waits = pending.any(|handover| handover.to == id || handover.from == Some(id));
        // Where there is no place it is answered now, as what does not continue.
        waits && self.record.has_place(id) && self.record.wait(id, origin).is_none()
    }

    /// The rights.
    pub(crate) fn rights(&self) -> &Authority {
        &self.rights
    }

    /// Whether a CUCS holds any right, or will once a decision is durable.
    pub(crate) fn has_rights(&self, id: Id) -> bool {
        !self.rights.held(id).is_empty() || !self.decided.held(id).is_empty()
    }

    /// The CUCS that holds LOI 4 or 5.
    pub(crate) fn controller(&self) -> Option<Id> {
        self.rights.controller()
    }

    /// Whether control is about to pass to another CUCS: offered to it, or decided but not in effect yet. A mere request of
    /// another CUCS does not count: it may be repeated forever without the holder's consent.
    pub(crate) fn is_handed_over(&self) -> bool {
        let control = |handover: &rules::Handover| {
            let agreed = !matches!(handover.stage, rules::Stage::Consent(_));
            agreed && !handover.rights.control().is_empty()
        };
        self.decided.controller() != self.rights.controller()
            || self.rights.pending().iter().any(control)
            || self.decided.pending().iter().any(control)
    }

    /// When a CUCS last gained a right, since 1970.
    pub(crate) fn since(&self, id: Id) -> Option<Duration> {
        self.record.since(id)
    }

    /// Takes an input. The caller acknowledges [`Input::Authorise`] and [`Input::HandOver`] with the returned answer.
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
            Input::ReportHandover { station } => {
                self.answer_handover(station, effects);
            }
            Input::Again { station, request } => self.answer(context, station, request, effects),
            Input::HandOverAgain { station } => {
                self.answer(context, station, None, effects);
                self.convey_pending(context, station, effects);
            }
            Input::Transition { origin, message } => {
                self.coordinate_transition(context, origin, message, effects);
            }
            Input::Returned { station, missed } => {
                if effects.listeners.contains(&station) {
                    if missed {
                        self.answer(context, station, None, effects);
                    }
                    welcome(context, station, effects);
                }
            }
            Input::Reconfigured | Input::Removed => {
                let removed = matches!(input, Input::Removed);
                self.decide(context, Of::Configuration, effects, |authority, at| {
                    let roster = if removed { &[] } else { at.roster };
                    authority.reconfigured(&Circumstances { roster, ..*at })
                });
                // Apply it at once, together with all earlier decisions: a station that has lost a right can no longer
                // command by it.
                while let Some(one) = self.unstored.pop_front() {
                    self.take_effect(context, one, effects);
                }
            }
            Input::Audit { what, by, why } => {
                let written = self
                    .record
                    .write_termination(what, by, why, context, effects);
                effects.request(Request::Audited(written.map_err(|fault| fault.to_string())));
            }
            Input::WatchSilence => self.watch_silence(context, effects),
            Input::Settle => self.settle(context, effects),
            Input::Stored => self.conclude(context, effects),
        }
        AckType::CarriedOut
    }

    /// Whether a decision waits until it is stored.
    pub(crate) fn awaits_disk(&self) -> bool {
        !self.unstored.is_empty()
    }

    /// When [`Input::Settle`] or [`Input::WatchSilence`] is next needed.
    pub(crate) fn poll_timeout(
        &self,
        now: Duration,
        stations: &[GroundStation],
        limits: &config::Authority,
    ) -> Option<Duration> {
        // Silence matters only for holders of a right to command.
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
        // A decision that could not be stored is still due: retry it from time to time, not immediately.
        let failed = due + WATCH_SLACK < now;
        Some(if failed { now + WATCH_SLACK } else { due })
    }
}

/// Sends a station that begins to listen message 3 and the active alerts.
fn welcome(context: &Context<'_>, station: usize, effects: &mut Effects<'_>) {
    let stamp = effects.stamp();
    let message = context.vehicle_id(&context.mission, stamp).into();
    effects.send(station, &message);
    for alert in effects.alerts.standing().cloned().collect::<Vec<_>>() {
        // For this station it is the first message of the alert, however long the alert has been active.
        let raised = Raised { alert, first: true };
        effects.dli.show(context.id(), &[station], &raised);
    }
}
