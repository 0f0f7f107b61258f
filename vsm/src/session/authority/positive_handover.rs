//! Positive handover: messages 4, 5, 34000, 35000.
//!
//! Public sources do not document the order of messages in a handover. The order used here is drawn in
//! docs/guide/authority.md. A request (message 4 of the acquirer) is passed on to the holder as a message 4 that names the
//! acquirer; the holder consents with the same message. An offer of a holder is sent to its successor as message 5. The
//! acquirer receives the end of every handover by message 5: LOI Authorized has the rights handed over, or none. 35000
//! reports it to all listening stations.

use std::time::Duration;

use stanag_msgs::Id;
use stanag_msgs::enums::{AckType, HandoverStatus, LoiBitmap};
use stanag_msgs::messages::{
    PositiveHandoverAuthorisationRequest, VehicleDataLinkTransitionCoordination,
};

use super::authorisation::with_stations;
use super::rules::{
    Answer, CONTROL, Decision, Handover, Outcome, Refusal, Rights, Stage, Stations,
};
use super::{AuthorityMachine, Context, Of, messages};
use crate::config::Provisional;
use crate::session::allowance::Allowance;
use crate::session::context::Origin;
use crate::session::effects::Effects;
use crate::session::limits::CONVEYED;

impl AuthorityMachine {
    pub(super) fn hand_over(
        &mut self,
        context: &Context<'_>,
        origin: &Origin,
        request: &PositiveHandoverAuthorisationRequest,
        effects: &mut Effects<'_>,
    ) -> AckType {
        let Some(by) = context.sender(origin.station) else {
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
        let named = Rights::named(levels, stations);
        let (wanted, absent) = with_stations(context, named, !stations.is_empty());
        if !absent.is_empty() {
            let answer = Answer::Refused {
                missing: absent,
                why: Refusal::NoStation,
            };
            return self.acknowledgement(origin, by.id, &answer, effects);
        }
        if (acquirer != by.id || wanted.is_empty())
            && let Err(refused) = self.may_dispose(context, origin, wanted, effects)
        {
            return refused;
        }
        let answer = self.decide(context, Of::Handover(by.id), effects, |authority, at| {
            authority.handover(at, &by, acquirer, wanted)
        });
        self.acknowledgement(origin, by.id, &answer, effects)
    }

    /// The link to the vehicle stays as it is: a message that would set the radio is refused.
    pub(super) fn coordinate_transition(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        message: &VehicleDataLinkTransitionCoordination,
        effects: &mut Effects<'_>,
    ) {
        let Some(by) = context.sender(origin.station) else {
            return;
        };
        let why = if context.provisional(origin.station) != Provisional::All {
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
        // 34000 is treated as message 4 with LOI 4 and 5, which pass together.
        let wanted = Rights::of_control(CONTROL);
        if acquirer != by.id
            && let Err(refused) = self.may_dispose(context, &origin, wanted, effects)
        {
            return effects.acknowledge(&origin, refused);
        }
        let answer = self.decide(context, Of::Handover(by.id), effects, |authority, at| {
            authority.handover(at, &by, acquirer, wanted)
        });
        let answer = self.acknowledgement(&origin, by.id, &answer, effects);
        let vehicle = effects.id;
        effects.dli.acknowledge_decision(vehicle, &origin, answer);
    }

    /// Reports the handovers that began and ended.
    pub(super) fn report_handovers(
        &mut self,
        context: &Context<'_>,
        decision: &Decision,
        effects: &mut Effects<'_>,
    ) {
        for handover in &decision.begun {
            is_due(&mut self.conveyed, context.mono(), handover);
            convey(context, handover, effects);
            let Handover {
                from, to, rights, ..
            } = *handover;
            let status = HandoverStatus::InProgress;
            self.report_handover(context, from, Some(to), status, effects);
            let holder = from.map_or_else(|| "nobody".to_owned(), |id| id.to_string());
            let rights = rights.in_words();
            let text = match handover.stage {
                Stage::Consent(_) => format!("{to} requests {rights} from {holder}"),
                Stage::Acceptance(_) => format!("{holder} offers {rights} to {to}"),
                Stage::Load(_) => format!("{rights} passes to {to} once the load has ended"),
            };
            effects.explain_handover(&parties(context, handover), text);
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
            effects.explain_handover(&parties(context, handover), text);
            // A requester whose message is pending is answered once all parts of its request are decided.
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

    /// Resends requests and offers that a station has not answered, since they may have been lost; each no more often than its rate.
    pub(super) fn convey_pending(
        &mut self,
        context: &Context<'_>,
        station: usize,
        effects: &mut Effects<'_>,
    ) {
        let Some(by) = context.asker(station) else {
            return;
        };
        let now = context.mono();
        for handover in self.rights.pending() {
            let takes_part = handover.to == by.id || handover.from == Some(by.id);
            if takes_part && is_due(&mut self.conveyed, now, handover) {
                convey(context, handover, effects);
            }
        }
    }

    /// 35000 on request: the handover of control in progress, otherwise the outcome of the latest one.
    pub(super) fn answer_handover(&self, station: usize, effects: &mut Effects<'_>) {
        let mut pending = self.rights.pending().iter();
        let pending = pending.rfind(|one| !one.rights.control().is_empty());
        let (from, to, status) = match (pending, self.passed.ended) {
            (Some(one), _) => (one.from, Some(one.to), HandoverStatus::InProgress),
            (None, Some((from, to, status))) => (from, Some(to), status),
            (None, None) => (None, None, HandoverStatus::NotRequested),
        };
        let report = messages::handover_status(from, to, status, effects.stamp());
        effects.send(station, &report);
    }

    /// Records how a decision has passed control: handed over, or taken after another CUCS released or lost it.
    pub(super) fn note_handover(&mut self, decision: &Decision) {
        for ended in &decision.ended {
            let Handover {
                from, to, rights, ..
            } = ended.handover;
            if !rights.control().is_empty() {
                let status = match ended.outcome {
                    Outcome::Completed(_) => HandoverStatus::Successful,
                    _ => HandoverStatus::Failed,
                };
                self.passed.ended = Some((from, to, status));
            }
        }
        let Some(holder) = self.rights.controller() else {
            return;
        };
        if let Some(from) = self.passed.holder.filter(|from| *from != holder) {
            self.passed.ended = Some((Some(from), holder, HandoverStatus::Successful));
        }
        self.passed.holder = Some(holder);
    }

    /// Sends 35000 to both parties and to all listening stations. The null id means nobody.
    pub(super) fn report_handover(
        &self,
        context: &Context<'_>,
        from: Option<Id>,
        to: Option<Id>,
        status: HandoverStatus,
        effects: &mut Effects<'_>,
    ) {
        let message = messages::handover_status(from, to, status, effects.stamp());
        // The parties may not be listening: an acquirer may hold nothing yet, and a holder may have just lost everything.
        let mut stations = effects.listeners.clone();
        for party in [from, to].into_iter().flatten() {
            let station = context.station_of(party);
            stations.extend(station.filter(|index| !stations.contains(index)));
        }
        stations.retain(|station| context.provisional(*station) != Provisional::Off);
        for station in stations {
            effects.publish(station, &message);
        }
    }
}

/// Passes a request on to the holder, or an offer on to the successor.
fn convey(context: &Context<'_>, handover: &Handover, effects: &mut Effects<'_>) {
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
        // Nobody has to answer: the end of the load decides.
        Stage::Load(_) => {}
    }
}

/// Whether a handover may be passed on now, which counts as done. What was passed on long ago is forgotten.
fn is_due(conveyed: &mut Vec<(Handover, Allowance)>, now: Duration, handover: &Handover) -> bool {
    conveyed.retain(|(_, lately)| !lately.is_full(now));
    if conveyed.iter().any(|(known, _)| known == handover) {
        return false;
    }
    let mut lately = Allowance::default();
    lately.take(now, CONVEYED);
    conveyed.push((*handover, lately));
    true
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
