//! Who controls one vehicle: messages 1, 2, 4, 5, 34000 and 35000, the silence of holders, and what of it is stored.
//!
//! The rules are a pure machine ([`rules`]), checked over every reachable state. This machine asks them, stores what they
//! decide before it is answered, and sends what follows. Its parts, in the order in which an input meets them:
//!
//! 1. What leads to a decision: [`authorisation`], message 1; [`positive_handover`], messages 4 and 34000; [`silence`] of
//!    a holder.
//! 2. [`decisions`]: all of these go the same way through it, [`AuthorityMachine::decide`].
//! 3. [`record`]: what is stored of a decision; [`trail`] and [`audit`] are its logs.
//! 4. [`messages`]: what is sent, composed.
//!
//! This file has what they share, and which right each message needs ([`right_for`]).

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
use self::rules::{Authority, Circumstances, Decision, Silence};
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
    /// The rights that hold: durable.
    rights: Authority,
    /// The rights by the latest decision, which may be on its way to the disk.
    decided: Authority,
    /// The decisions from `rights` to `decided`, in order.
    unstored: VecDeque<Unstored>,
    /// What each CUCS of the configuration may still change.
    /// Of decisions about LOI 2 alone, and of all others.
    allowances: BTreeMap<Id, (Allowance, Allowance)>,
    record: AuthorityRecord,
    passed: LastHandover,
}

/// How control has passed last, for who asks later: 35000 that was sent may not have arrived. Not kept over a restart.
#[derive(Debug, Default)]
struct LastHandover {
    /// Who has had control last.
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

/// What a decision came of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Of {
    /// Message 1: its sender is sent message 2 by who handles the message, which repeats the access that was requested.
    Request(Id),
    /// Message 4 or 34000, which have no answer of their own: their sender is sent message 2 where its rights change.
    Handover(Id),
    /// The silence of a holder, or its end.
    Silence(Id, Silence),
    /// A configuration that was read again.
    Configuration,
    /// Time has passed, or the vehicle flies otherwise.
    Waiting,
}

impl Of {
    /// Whether it takes rights away however the disk does: a restart would find them taken away too.
    fn cannot_wait(self) -> bool {
        matches!(self, Of::Silence(_, Silence::Lost) | Of::Configuration)
    }
}

/// What it reads.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Context<'a> {
    pub(crate) common: context::Context<'a>,
    pub(crate) mission: MissionView<'a>,
    /// Set points for mode 15 go out.
    pub(crate) steering: bool,
    /// Who else has the vehicle.
    pub(crate) other: Option<Other>,
    /// A contingency is commanded before that.
    pub(crate) contingency_first: bool,
    /// The vehicle flies already what would be commanded for a lost controller.
    pub(crate) shows_loss_action: bool,
}

context::deref_to_common!(Context);

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
    /// A request for 35000.
    ReportHandover { station: usize },
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
    /// The configuration is another, as the context shows it.
    Reconfigured,
    /// The configuration has this vehicle no more: nobody holds anything of it.
    Removed,
    /// Something about a flight termination belongs into the audit log.
    Audit {
        what: &'static str,
        by: Option<Id>,
        why: &'a str,
    },
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
        Message::EngineCommand(_) | Message::FlightTerminationCommand(_) => Some(LoiBitmap::LOI5),
        Message::LoiterConfiguration(_)
        | Message::UaStickCommand(_)
        | Message::UnmannedAircraftLights(_)
        | Message::MissionTransferCommand(_)
        | Message::UaRoute(_)
        | Message::UaPositionWaypoint(_)
        | Message::UaLoiterWaypoint(_)
        // Its station besides: the mission machine looks at that.
        | Message::PayloadActionWaypoint(_)
        | Message::VehicleSpecificWaypoint(_)
        | Message::CurveSegment(_)
        | Message::CurveSegmentPaper(_)
        | Message::ParameterSetCommand(_)
        | Message::AreaVertex(_)
        | Message::AreaTransferCommand(_)
        | Message::Contingency(_)
        // As the command in it, where that can be read: the caller looks into it.
        | Message::HoldCommand(_) => Some(LoiBitmap::LOI4),
        Message::ZeroizeCommand(_) => Some(LoiBitmap::LOI5),
        // Of the station that it names: the payload machine looks at that.
        Message::PayloadSteeringCommand(_) | Message::EoIrLaserPayloadCommand(_) => {
            Some(LoiBitmap::LOI3)
        }
        // Its own commands a CUCS cancels with whatever right it is left.
        Message::HeldCommandCancel(_)
        | Message::ParameterRequest(_)
        | Message::PingRequest(_)
        | Message::DataLinkControlRequest(_)
        | Message::SubsystemStatusRequest(_)
        | Message::SubsystemStatusDetailRequest(_) => Some(LoiBitmap::LOI2),
        _ => None,
    }
}

/// Whether a message moves the aircraft, changes what it will fly, or decides who may: such a message needs a Time Stamp,
/// and comes in time. Of message 1 only what requests a right to command: a question changes nothing, and a release is
/// granted always.
pub(crate) fn commands(message: &Message) -> bool {
    match message {
        Message::CucsAuthorisationRequest(request) => requests_control(request),
        Message::PositiveHandoverAuthorisationRequest(_)
        | Message::VehicleDataLinkTransitionCoordination(_)
        | Message::HeldCommandCancel(_) => true,
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
        self.passed.holder = rights.controller();
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

    /// Whether control is on its way to another CUCS: offered to it, or decided and not in effect yet. What another merely
    /// asks for is not: it can ask for as long as it likes, and its holder has agreed to nothing.
    pub(crate) fn is_handed_over(&self) -> bool {
        let control = |handover: &rules::Handover| {
            let agreed = !matches!(handover.stage, rules::Stage::Consent(_));
            agreed && !handover.rights.control().is_empty()
        };
        self.decided.controller() != self.rights.controller()
            || self.rights.pending().iter().any(control)
            || self.decided.pending().iter().any(control)
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
            Input::Returned { station } => {
                if effects.listeners.contains(&station) {
                    welcome(context, station, effects);
                }
            }
            Input::Reconfigured | Input::Removed => {
                let removed = matches!(input, Input::Removed);
                self.decide(context, Of::Configuration, effects, |authority, at| {
                    let roster = if removed { &[] } else { at.roster };
                    authority.reconfigured(&Circumstances { roster, ..*at })
                });
                // At once, and what was decided before it too: who has lost a right commands nothing more by it.
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
