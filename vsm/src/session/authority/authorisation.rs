//! Message 1 and its answer, message 2: requests, releases and queries.

use mavlink_link::store::Changes;
use stanag_msgs::enums::{AckType, LoiBitmap, RequestedAccess, WaitTransition};
use stanag_msgs::messages::CucsAuthorisationRequest;
use stanag_msgs::{Id, table};

use super::rules::{Access, Answer, CONTROL, Refusal, Rights, Stations};
use super::{AuthorityMachine, Context, Of, Unstored, messages, releases};
use crate::session::access::Permitted;
use crate::session::context::Origin;
use crate::session::effects::Effects;

impl AuthorityMachine {
    /// A message 1 to this vehicle: a request, a release, or a query if it names no access.
    pub(super) fn authorise(
        &mut self,
        context: &Context<'_>,
        origin: &Origin,
        request: &CucsAuthorisationRequest,
        effects: &mut Effects<'_>,
    ) -> AckType {
        let Some(asker) = context.sender(origin.station) else {
            return AckType::Refused;
        };
        let levels = request.requested_handover_loi.unwrap_or(LoiBitmap::NONE);
        // A release is always granted, whatever else the message requests.
        if let (false, Err(why)) = (releases(request), understood(context, request, levels)) {
            return self.refuse(context, origin.station, request, &why, effects);
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
        // A payload station that is gone can still be released.
        let (wanted, absent) = match access {
            Access::Release => (wanted, Rights::NONE),
            _ => with_stations(context, wanted, !stations.is_empty()),
        };
        if access == Access::Release
            && let Err(refused) = self.may_dispose(context, origin, wanted, effects)
        {
            self.answer(context, origin.station, Some(request), effects);
            return refused;
        }
        let waits_for_transition = request
            .wait_for_vehicle_data_link_transition_coordination_message
            == Some(WaitTransition::Wait);
        let answer = self.decide(context, Of::Request(asker.id), effects, |authority, at| {
            // With "wait for the transition" it is a handover request, as by message 4; an override needs no consent.
            if waits_for_transition && access == Access::Control {
                authority.handover(at, &asker, asker.id, wanted)
            } else {
                authority.request(at, &asker, access, wanted, !stations.is_empty())
            }
        });
        let answer = match answer {
            Answer::Granted if !absent.is_empty() => Answer::Refused {
                missing: absent,
                why: Refusal::NoStation,
            },
            decided => decided,
        };
        if !is_too_often(&answer) {
            self.answer(context, origin.station, Some(request), effects);
        }
        self.acknowledgement(origin, asker.id, &answer, effects)
    }

    /// Checks whether the guard key of a message may release or hand over its sender's rights. A replaced guard key cannot
    /// give up rights that the access list grants to the new key. Otherwise refuses, with the reason.
    pub(super) fn may_dispose(
        &self,
        context: &Context<'_>,
        origin: &Origin,
        named: Rights,
        effects: &mut Effects<'_>,
    ) -> Result<(), AckType> {
        let may = context.disposes_of(origin.station);
        let asker = context.asker(origin.station);
        let held = asker.map_or(Rights::NONE, |asker| self.decided.held(asker.id));
        let Some((counter, why)) = Permitted::OtherKey.refusal() else {
            return Ok(());
        };
        if may.contains(held.both(named).levels()) && !(named.is_empty() && may.is_empty()) {
            return Ok(());
        }
        effects.dli.counters.count(counter);
        let text = format!("message {}: {why}", table::named(origin.message_type));
        effects.explain_refusal(origin.station, text);
        Err(AckType::Refused)
    }

    /// A message 1 to all, or to the VSM. It is a query to each vehicle, like a discovery, and a release of named levels
    /// applies to each vehicle. Rights are granted by single vehicles only.
    pub(super) fn authorise_to_all(
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
            // A discovery requests no acknowledgement. A station that requests one and holds rights intended a release.
            Some(RequestedAccess::Relinquish) if origin.ack_requested && holds_something() => {
                "nothing is released: name the levels, or send it to the vehicle"
            }
            Some(RequestedAccess::Request | RequestedAccess::Override) if named => {
                "rights must be requested from a single vehicle"
            }
            Some(RequestedAccess::Unknown(_)) if named => {
                "Requested/Handover Access is out of range: expected 0 to 2"
            }
            _ => return self.question(context, origin.station, request, effects),
        };
        self.refuse(context, origin.station, request, why, effects)
    }

    fn refuse(
        &self,
        context: &Context<'_>,
        station: usize,
        request: &CucsAuthorisationRequest,
        why: &str,
        effects: &mut Effects<'_>,
    ) -> AckType {
        self.answer(context, station, Some(request), effects);
        let name = table::named(CucsAuthorisationRequest::ID);
        effects.explain_refusal(station, format!("message {name} refused: {why}"));
        AckType::Refused
    }

    /// A message 1 that changes nothing: answers with the rights that the station may have and holds, and repeats requests
    /// that it has not answered.
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

    /// Message 2, as the answer to a message: by the latest decision, once it is durable.
    pub(super) fn answer(
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
        // A station that caused none of the pending decisions is answered at once, by the rights in force.
        let rights = if effects.answers_later() {
            &self.decided
        } else {
            &self.rights
        };
        let held = rights.held(id);
        respond(context, station, held, request, effects);
    }

    /// Answers from here on show decisions that are not durable yet.
    pub(super) fn answer_after_decisions(&self, effects: &mut Effects<'_>) {
        let stored = self.unstored.iter().map(|one| one.stored);
        if let Some(all) = stored.reduce(Changes::and) {
            effects.answer_after(all);
        }
    }

    /// The 17000 type for an answer. A pending request is acknowledged again when it is decided.
    pub(super) fn acknowledgement(
        &mut self,
        origin: &Origin,
        asker: Id,
        answer: &Answer,
        effects: &mut Effects<'_>,
    ) -> AckType {
        match answer {
            Answer::Granted => AckType::CarriedOut,
            Answer::Waits => {
                if let Some(oldest) = self.record.wait(asker, *origin) {
                    let counters = &mut effects.dli.counters;
                    counters.count("too many requests wait for a decision");
                    // It was acknowledged as received, and the decision will not answer it.
                    effects
                        .refuse_unprivileged(&oldest, "later requests wait for the same decision");
                }
                AckType::Received
            }
            Answer::Refused { missing, why } => {
                let what = if *missing == Rights::NONE {
                    "refused".to_owned()
                } else {
                    format!("{} refused", missing.in_words())
                };
                let text = format!(
                    "message {}: {what}: {why}",
                    table::named(origin.message_type)
                );
                if is_too_often(answer) {
                    // A station that asks too often does not receive more than it sends.
                    effects.answer_sometimes(&[origin.station], text);
                } else {
                    effects.explain_refusal(origin.station, text);
                }
                AckType::Refused
            }
        }
    }
}

/// Splits requested rights into those that can exist, and those that are refused because the vehicle has no such payload
/// station. LOI 3 without a station number means all present stations. Requested together with other levels, on a vehicle
/// without any station, it means stations that may appear later; the bitmaps then show none.
pub(super) fn with_stations(
    context: &Context<'_>,
    wanted: Rights,
    by_number: bool,
) -> (Rights, Rights) {
    let present = Rights::of_stations(context.payload_stations());
    let absent = Rights::of_stations(wanted.stations()).without(present);
    let possible = wanted.without(absent);
    if by_number || possible.is_empty() {
        (possible, absent)
    } else if present.is_empty() {
        (wanted, Rights::NONE)
    } else {
        (possible, Rights::NONE)
    }
}

fn is_too_often(answer: &Answer) -> bool {
    let too_often = Refusal::TooOften;
    matches!(answer, Answer::Refused { why, .. } if *why == too_often)
}

/// Message 2.
pub(super) fn respond(
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

/// Checks that every value of message 1 is known: unknown values are granted nothing.
fn understood(
    context: &Context<'_>,
    request: &CucsAuthorisationRequest,
    levels: LoiBitmap,
) -> Result<(), String> {
    if !context.is_addressed(request.vsm_id) {
        return Err("VSM ID is another VSM's".to_owned());
    }
    // Without levels it is a query, whatever access it names.
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
            "Requested/Handover LOI {:#04x}: bits {unknown:#04x} are out of range: expected LOI 2 to 5 (monitor, payload, control, launch)",
            levels.raw()
        ));
    }
    Ok(())
}
