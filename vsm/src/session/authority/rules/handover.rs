//! Positive handover: the holder consents to a request of another CUCS, or names a successor, which accepts.
//!
//! Both use message 4; its Requesting CUCS ID names the acquirer. Sent by the acquirer, it is a request ("wish" in this
//! module), the acceptance of an offer or, without levels, the withdrawal of either. Sent by the holder, it is the consent
//! to the acquirer's wish, its refusal if no level is named, or an offer if the acquirer has not asked.

use stanag_msgs::Id;

use super::decision::{Answer, Decision, Ended, Handover, Outcome, Reason, Refusal, Stage};
use super::request::Tally;
use super::rights::Rights;
use super::{Asker, Authority, CONSENT_WITHIN, Circumstances, Silence};

impl Authority {
    /// Decides message 4: `by` sends it, `acquirer` is its Requesting CUCS ID.
    pub fn handover(
        &mut self,
        at: &Circumstances<'_>,
        by: &Asker,
        acquirer: Id,
        wanted: Rights,
    ) -> Decision {
        let mut decision = Decision::default();
        let answer = match (acquirer == by.id, wanted.is_empty()) {
            (true, true) => self.give_up(by.id, &mut decision),
            (true, false) => self.wish(at, by, wanted, &mut decision),
            (false, true) => self.refuse(by.id, acquirer, &mut decision),
            (false, false) => self.consent_or_name(at, by.id, acquirer, wanted, &mut decision),
        };
        decision.answer = answer.unwrap_or_else(|why| Answer::Refused {
            missing: wanted,
            why,
        });
        self.settle(at, &mut decision);
        decision
    }

    /// The acquirer withdraws its wish or declines an offer.
    fn give_up(&mut self, acquirer: Id, decision: &mut Decision) -> Result<Answer, Refusal> {
        let known = decision.ended.len();
        // Offers first: the second pass would end them as withdrawn, which is the outcome only of the acquirer's own wishes.
        self.end_where(Outcome::Declined, decision, |handover| {
            handover.to == acquirer && matches!(handover.stage, Stage::Acceptance(_))
        });
        self.end_where(Outcome::Withdrawn, decision, |handover| {
            handover.to == acquirer
        });
        if decision.ended.len() == known {
            return Err(Refusal::NoHandover);
        }
        Ok(Answer::Granted)
    }

    fn wish(
        &mut self,
        at: &Circumstances<'_>,
        asker: &Asker,
        wanted: Rights,
        decision: &mut Decision,
    ) -> Result<Answer, Refusal> {
        let mut tally = Tally::new(asker, wanted);
        let wanted = wanted.both(asker.may_hold());
        self.accept_offers(at, asker.id, wanted, &mut tally, decision);
        self.grant_free(at, asker.id, wanted, &mut tally, decision);
        for (holder, part) in self.by_holder(wanted, asker.id) {
            let control = !part.control().is_empty();
            if self.is_pending(asker.id, part) {
                tally.wait();
                continue;
            }
            // One handover of a right at a time: the first is decided, the second is refused as busy.
            if let Some(other) = self.claim(at, asker.id, part) {
                tally.refuse(part, Refusal::Busy(other));
            } else if control && at.launch_or_landing {
                tally.refuse(part, Refusal::LaunchOrLanding);
            } else {
                tally.wait();
                self.overtake_wishes(at, asker.id, part, decision);
                let until = at.now + CONSENT_WITHIN;
                self.begin(
                    Some(holder),
                    asker.id,
                    part,
                    Stage::Consent(until),
                    decision,
                );
            }
        }
        Ok(tally.answer())
    }

    /// The holder refuses a wish or withdraws an offer.
    fn refuse(
        &mut self,
        holder: Id,
        acquirer: Id,
        decision: &mut Decision,
    ) -> Result<Answer, Refusal> {
        let known = decision.ended.len();
        let between =
            |handover: &Handover| handover.from == Some(holder) && handover.to == acquirer;
        self.end_where(Outcome::Refused, decision, |handover| {
            between(handover) && matches!(handover.stage, Stage::Consent(_))
        });
        self.end_where(Outcome::Withdrawn, decision, |handover| {
            between(handover) && matches!(handover.stage, Stage::Acceptance(_))
        });
        if decision.ended.len() == known {
            return Err(Refusal::NoHandover);
        }
        Ok(Answer::Granted)
    }

    fn consent_or_name(
        &mut self,
        at: &Circumstances<'_>,
        holder: Id,
        acquirer: Id,
        wanted: Rights,
        decision: &mut Decision,
    ) -> Result<Answer, Refusal> {
        let between = self.pending.iter().position(|handover| {
            handover.from == Some(holder)
                && handover.to == acquirer
                && handover.rights.collides(wanted)
        });
        if let Some(index) = between {
            let Some(handover) = self.pending.get(index).copied() else {
                return Err(Refusal::NoHandover);
            };
            // Already offered or agreed: the same message again has no effect and extends no deadline.
            if !matches!(handover.stage, Stage::Consent(_)) {
                return Ok(Answer::Waits);
            }
            return self.agree(at, index, handover, wanted, decision);
        }
        let successor = at.asker(acquirer).ok_or(Refusal::NoSuccessor(acquirer))?;
        let held = self.held(holder);
        // Holding one of the levels is enough to offer both: LOI 4 and 5 always have the same holder.
        let control = if held.control().is_empty() {
            Rights::NONE
        } else {
            Rights::of_control(wanted.control())
        };
        let stations = Rights::of_stations(held.both(wanted).stations());
        let offered = control.with(stations);
        if offered.is_empty() {
            return Err(Refusal::NotHeld);
        }
        let offered = offered.both(successor.may_hold());
        if offered.is_empty() {
            return Err(Refusal::NoSuccessor(acquirer));
        }
        if let Some(other) = self.claim(at, holder, offered) {
            return Err(Refusal::Busy(other));
        }
        if !offered.control().is_empty() && at.launch_or_landing {
            return Err(Refusal::LaunchOrLanding);
        }
        self.overtake_wishes(at, holder, offered, decision);
        let until = at.now + CONSENT_WITHIN;
        self.begin(
            Some(holder),
            acquirer,
            offered,
            Stage::Acceptance(until),
            decision,
        );
        Ok(Answer::Waits)
    }

    /// A successor requests what it was offered: that accepts the offer.
    pub(super) fn accept_offers(
        &mut self,
        at: &Circumstances<'_>,
        acquirer: Id,
        wanted: Rights,
        tally: &mut Tally,
        decision: &mut Decision,
    ) {
        let offer = |handover: &Handover| {
            handover.to == acquirer
                && matches!(handover.stage, Stage::Acceptance(_))
                && handover.rights.collides(wanted)
        };
        while let Some(index) = self.pending.iter().position(offer) {
            let Some(handover) = self.pending.get(index).copied() else {
                return;
            };
            match self.agree(at, index, handover, wanted, decision) {
                Ok(Answer::Waits) => tally.wait(),
                Ok(_) => {}
                Err(why) => tally.refuse(handover.rights, why),
            }
        }
    }

    /// Both sides agree on this handover or a part of it: it is carried out, or waits for another CUCS's load.
    fn agree(
        &mut self,
        at: &Circumstances<'_>,
        index: usize,
        handover: Handover,
        wanted: Rights,
        decision: &mut Decision,
    ) -> Result<Answer, Refusal> {
        let stations = Rights::of_stations(handover.rights.both(wanted).stations());
        // Control is handed over as a whole: otherwise the holder of the other level would be a second controller.
        let control = if wanted.control().is_empty() {
            Rights::NONE
        } else {
            Rights::of_control(handover.rights.control())
        };
        let rights = stations.with(control);
        self.pending.remove(index);
        let agreed = Handover { rights, ..handover };
        if !control.is_empty() && at.launch_or_landing {
            let outcome = Outcome::LaunchOrLanding;
            decision.ended.push(Ended { handover, outcome });
            return Err(Refusal::LaunchOrLanding);
        }
        if !control.is_empty() && at.load_of_another(handover.to) {
            let stage = Stage::Load(Reason::HandedOver);
            self.begin(agreed.from, agreed.to, agreed.rights, stage, decision);
            return Ok(Answer::Waits);
        }
        self.complete(handover, rights, Reason::HandedOver, decision);
        Ok(Answer::Granted)
    }

    fn complete(
        &mut self,
        handover: Handover,
        rights: Rights,
        why: Reason,
        decision: &mut Decision,
    ) {
        self.give(handover.to, rights, why, decision);
        let outcome = Outcome::Completed(rights);
        decision.ended.push(Ended { handover, outcome });
    }

    pub(super) fn begin(
        &mut self,
        from: Option<Id>,
        to: Id,
        rights: Rights,
        stage: Stage,
        decision: &mut Decision,
    ) {
        let handover = Handover {
            from,
            to,
            rights,
            stage,
        };
        self.expect(handover);
        decision.begun.push(handover);
    }

    /// Inserts a pending handover in a fixed order, independent of its start: control, then stations.
    pub(super) fn expect(&mut self, handover: Handover) {
        // No two pending handovers concern the same right, so their order has no effect; a fixed order keeps the model
        // small.
        let place = |one: &Handover| (one.rights.control().is_empty(), one.rights.stations().raw());
        let index = self
            .pending
            .partition_point(|known| place(known) < place(&handover));
        self.pending.insert(index, handover);
    }

    pub(super) fn end_where(
        &mut self,
        outcome: Outcome,
        decision: &mut Decision,
        meant: impl Fn(&Handover) -> bool,
    ) {
        self.pending.retain(|handover| {
            let ends = meant(handover);
            if ends {
                let handover = *handover;
                decision.ended.push(Ended { handover, outcome });
            }
            !ends
        });
    }

    /// The CUCS to which these rights are already being handed over, if any.
    fn claim(&self, at: &Circumstances<'_>, by: Id, rights: Rights) -> Option<Id> {
        self.pending
            .iter()
            .find(|handover| handover.rights.collides(rights) && !gives_way(at, handover, by))
            .map(|handover| handover.to)
    }

    /// Ends wishes that must not compete with this handover.
    fn overtake_wishes(
        &mut self,
        at: &Circumstances<'_>,
        by: Id,
        rights: Rights,
        decision: &mut Decision,
    ) {
        self.end_where(Outcome::Overtaken, decision, |handover| {
            handover.rights.collides(rights) && gives_way(at, handover, by)
        });
    }

    /// Checks every handover after a change: some can be completed now, and some never.
    pub(super) fn settle(&mut self, at: &Circumstances<'_>, decision: &mut Decision) {
        // Each iteration ends one handover or is the last one.
        while let Some((index, next)) = self.next_to_settle(at) {
            let handover = self.pending.remove(index);
            match next {
                Next::Complete(why) => self.complete(handover, handover.rights, why, decision),
                Next::End(outcome) => decision.ended.push(Ended { handover, outcome }),
                Next::AfterLoad(why) => {
                    let stage = Stage::Load(why);
                    self.begin(handover.from, handover.to, handover.rights, stage, decision);
                }
            }
        }
    }

    fn next_to_settle(&self, at: &Circumstances<'_>) -> Option<(usize, Next)> {
        let pending = self.pending.iter().enumerate();
        pending
            .filter_map(|(index, handover)| Some((index, self.next_of(at, handover)?)))
            .next()
    }

    fn next_of(&self, at: &Circumstances<'_>, handover: &Handover) -> Option<Next> {
        let Handover {
            from,
            to,
            rights,
            stage,
        } = *handover;
        let control = !rights.control().is_empty();
        let blocked = control && at.load_of_another(to);
        let holders = self.by_holder(rights, to);
        let third = holders.iter().any(|(holder, _)| Some(*holder) != from);
        let holder_has_all = holders.len() == 1 && holders.iter().all(|(_, part)| *part == rights);
        if self.held(to).contains(rights) {
            return Some(Next::Complete(Reason::HandedOver));
        }
        // Part of the rights has passed to a third CUCS: neither `from` nor its successor can decide the handover now.
        if third {
            return Some(Next::End(Outcome::Overtaken));
        }
        match stage {
            // The holder has released some of the rights: the acquirer gets those at once, and the wish covers only the
            // rest.
            Stage::Consent(_) if !holder_has_all => {
                let loses_control =
                    control && holders.iter().any(|(_, part)| !part.control().is_empty());
                Some(if !holders.is_empty() {
                    if loses_control && at.launch_or_landing {
                        Next::End(Outcome::LaunchOrLanding)
                    } else {
                        Next::End(Outcome::Overtaken)
                    }
                } else if blocked {
                    Next::AfterLoad(Reason::Requested)
                } else {
                    Next::Complete(Reason::Requested)
                })
            }
            // A silent holder cannot consent: the acquirer gets the rights, as it would by requesting them now.
            Stage::Consent(_) | Stage::Acceptance(_)
                if from.is_some_and(|from| {
                    self.silence(from) >= Silence::Offered && at.is_fit(to, from)
                }) && matches!(stage, Stage::Consent(_))
                    && !(control && at.launch_or_landing) =>
            {
                Some(if blocked {
                    Next::AfterLoad(Reason::OfferedInSilence)
                } else {
                    Next::Complete(Reason::OfferedInSilence)
                })
            }
            Stage::Acceptance(_) if !holder_has_all => Some(Next::End(Outcome::Overtaken)),
            Stage::Consent(until) | Stage::Acceptance(until) if until <= at.now => {
                Some(Next::End(Outcome::Lapsed))
            }
            Stage::Consent(_) | Stage::Acceptance(_) => None,
            Stage::Load(Reason::Requested) if !holders.is_empty() => {
                Some(Next::End(Outcome::Overtaken))
            }
            Stage::Load(_) if blocked => None,
            // This arm must come before that of launch and landing, during which control passes by override only.
            Stage::Load(Reason::Overridden) => Some(Next::Complete(Reason::Overridden)),
            Stage::Load(_) if at.launch_or_landing && !holders.is_empty() => {
                Some(Next::End(Outcome::LaunchOrLanding))
            }
            Stage::Load(why) => Some(Next::Complete(why)),
        }
    }
}

/// Whether it is a wish of an unguarded CUCS and this station has a guard. Anybody could renew such a wish forever and so
/// keep a guarded station from handing over or requesting rights.
fn gives_way(at: &Circumstances<'_>, handover: &Handover, by: Id) -> bool {
    matches!(handover.stage, Stage::Consent(_)) && !at.is_fit(handover.to, by)
}

/// The next step of a handover.
enum Next {
    Complete(Reason),
    End(Outcome),
    AfterLoad(Reason),
}
