//! Decisions: ask the rules, store the decision, and carry out its consequences once it is durable.
//!
//! A disk can be slow. Meanwhile the rules continue to decide ([`AuthorityMachine::decided`]), and decisions wait in order.
//! Until a decision is durable it is visible only in the delayed answers to its requester, nobody can command by it, and a
//! station that loses a right by it still holds that right ([`AuthorityMachine::rights`]).

use std::collections::VecDeque;

use mapping::mode::Px4Mode;
use mavlink_link::store::{Changes, Disk, Durability, Progress};
use stanag_msgs::Id;
use stanag_msgs::enums::{AlertPriority, LoiBitmap, SubsystemId};

use super::authorisation::respond;
use super::record::durability;
use super::rules::{Answer, Authority, Change, Circumstances, Decision, Reason, Refusal, Rights};
use super::{AuthorityMachine, Context, Of, Unstored, welcome};
use crate::session::alerts::Cause;
use crate::session::context::{self, Transfer};
use crate::session::effects::{Effects, Request};
use crate::session::limits::{MONITORS, RIGHTS};
use crate::session::log::LogLevel;
use crate::session::station::GroundStation;
use crate::session::store::record_fault;

impl AuthorityMachine {
    /// Asks the rules, stores the decision, and carries out its consequences once it is durable. The caller answers the
    /// requester.
    pub(super) fn decide(
        &mut self,
        context: &Context<'_>,
        of: Of,
        effects: &mut Effects<'_>,
        ask: impl FnOnce(&mut Authority, &Circumstances<'_>) -> Decision,
    ) -> Answer {
        let roster = match of {
            Of::Configuration => context.keepers(),
            _ => context.roster(),
        };
        let circumstances = Circumstances {
            now: context.mono(),
            roster: &roster,
            loading: loading(context),
            launch_or_landing: launch_or_landing(context),
        };
        let before = self.decided.clone();
        let decision = ask(&mut self.decided, &circumstances);
        // A decision that changes nothing is not stored: a repeated request costs no write and no line in the audit log.
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
        // Rights lost by silence or withdrawn by the configuration break no promise, and a restart would decide the same
        // again. So a failing disk does not prevent the loss action. Nor does it keep control with a station that has
        // released it: a release is always granted. Nor does it keep control from the only station that a restart would give
        // it to: it has released or lost it, which could not be stored.
        let stands = of.cannot_wait()
            || (matches!(of, Of::Request(_))
                && self.record.has_what_is_given(&decision, effects.disk()));
        if changed {
            // What stands is written in any case: rights that end are few.
            let stored = if stands || self.unstored.len() < MAX_UNSTORED {
                (self.record).store_decision(&self.decided, &decision, stands, context, effects)
            } else {
                Err(record_fault(
                    "authority",
                    context.id(),
                    "the disk is too slow",
                ))
            };
            if let Err(fault) = stored {
                let effect = if !stands {
                    "nothing changes"
                } else if of.cannot_wait() || decision.gives_up() {
                    "rights end all the same"
                } else {
                    "rights that the record still has are given again"
                };
                let text = format!("authority cannot be stored, {effect}: {fault}");
                effects.warn(Cause::Store, text);
                if !stands {
                    // Do not grant a right that would not survive a restart.
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
        // A decision without a write still waits for earlier ones, since it is based on them.
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

    /// Whether the requester may cause another stored decision. Each costs a line of the audit log and a write, which is
    /// synchronised for all rights but LOI 2. Giving up rights is always allowed: they were requested, and so counted,
    /// before.
    fn may_change(&mut self, context: &Context<'_>, of: Of, decision: &Decision) -> bool {
        let (Of::Request(asker) | Of::Handover(asker)) = of else {
            return true;
        };
        if decision.gives_up() {
            return true;
        }
        let (monitors, commands) = self.allowances.entry(asker).or_default();
        if durability(decision) == Durability::Answered {
            return monitors.take(context.mono(), MONITORS);
        }
        commands.take(context.mono(), RIGHTS)
    }

    /// Applies the decisions that are durable.
    pub(super) fn conclude(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        while let Some(one) = next(&mut self.unstored, effects.disk()) {
            self.take_effect(context, one, effects);
        }
    }

    pub(super) fn take_effect(
        &mut self,
        context: &Context<'_>,
        one: Unstored,
        effects: &mut Effects<'_>,
    ) {
        let Unstored { decision, of, .. } = one;
        let before = std::mem::replace(&mut self.rights, one.rights);
        self.note_handover(&decision);
        // First: the messages below go to the listeners by the new rights.
        self.update_listeners(context, effects);
        if one.changed {
            effects.clear(Cause::Store, "authority is stored again");
        }
        let mut informed: Vec<Id> = match of {
            // The handler of message 1 answers its sender itself.
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
        for change in &decision.changes {
            if let (Some(id), Reason::Withdrawn) = (change.from, change.why) {
                let text = withdrawn_text(id, change, &before, &self.rights);
                effects.notify(AlertPriority::Warning, SubsystemId::Comms, text);
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

    pub(super) fn update_listeners(
        &self,
        context: &context::Context<'_>,
        effects: &mut Effects<'_>,
    ) {
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
    pub(super) fn inform(&self, context: &Context<'_>, id: Id, effects: &mut Effects<'_>) {
        if let Some(station) = context.station_of(id) {
            respond(context, station, self.rights.held(id), None, effects);
        }
    }

    /// `lost`: the controller has lost control by silence, which has its own alerts.
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

    /// Decides pending handovers again: a load has ended, the vehicle's mode has changed, or time has passed.
    pub(super) fn settle(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        if !self.decided.pending().is_empty() {
            self.decide(context, Of::Waiting, effects, Authority::look_again);
        }
    }
}

/// Notifies operators of rights that the configuration has withdrawn.
fn withdrawn_text(id: Id, change: &Change, before: &Authority, after: &Authority) -> String {
    let freed = before.controller() == Some(id) && after.controller().is_none();
    let follows = if freed {
        ": nobody controls the vehicle; take control"
    } else {
        ""
    };
    format!(
        "{} of CUCS {id} withdrawn by the configuration{follows}",
        change.lost
    )
}

fn next(unstored: &mut VecDeque<Unstored>, disk: &dyn Disk) -> Option<Unstored> {
    let first = unstored.front()?;
    let durable = disk.progress(first.stored) == Progress::Durable;
    durable.then(|| unstored.pop_front()).flatten()
}

/// The CUCS that is loading a mission; the null id if the VSM itself is.
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
    // By the reported mode, not the commanded one: AUTO.LAND by PX4's own failsafe counts too. A fixed wing, and an approach
    // route, land in AUTO.MISSION.
    let telemetry = &context.vehicle.telemetry;
    let by_mode = matches!(
        telemetry.mode,
        Some(Px4Mode::TAKEOFF | Px4Mode::VTOL_TAKEOFF | Px4Mode::LAND)
    );
    telemetry.armed == Some(true) && (by_mode || context.mission.lands(telemetry))
}

/// Maximum number of decisions of a vehicle that wait for the disk.
const MAX_UNSTORED: usize = 256;
