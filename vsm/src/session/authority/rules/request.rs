//! Message 1: relinquish, request, override.

use stanag_msgs::Id;

use super::decision::{Answer, Decision, Outcome, Reason, Refusal, Stage};
use super::rights::Rights;
use super::{Asker, Authority, Circumstances, Silence};

/// Requested Access (0001.10).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Access {
    /// 0: release these rights; all held rights if none is named.
    Release,
    /// 1: request these rights.
    Control,
    /// 2: take these rights even if another CUCS holds them.
    Override,
}

/// Intermediate results while a request is decided.
pub(super) struct Tally {
    missing: Rights,
    why: Option<Refusal>,
    waits: bool,
}

impl Authority {
    /// Decides message 1. `explicit`: the payload stations were named by number; the controller gets those.
    pub fn request(
        &mut self,
        at: &Circumstances<'_>,
        asker: &Asker,
        access: Access,
        wanted: Rights,
        explicit: bool,
    ) -> Decision {
        let mut decision = Decision::default();
        if access == Access::Release {
            self.release(asker.id, wanted, &mut decision);
            self.settle(at, &mut decision);
            return decision;
        }
        let mut tally = Tally::new(asker, wanted);
        let wanted = wanted.both(asker.may_hold());
        // Requesting an offered right accepts it, by message 1 as by message 4.
        self.accept_offers(at, asker.id, wanted, &mut tally, &mut decision);
        // Control first: the controller may then take a station by number.
        for part in parts(wanted) {
            self.grant_free(at, asker.id, part, &mut tally, &mut decision);
            for (holder, part) in self.by_holder(part, asker.id) {
                match self.may_take(at, asker, access, holder, part, explicit) {
                    Ok(why) => {
                        self.seize(at, asker.id, holder, part, why, &mut tally, &mut decision)
                    }
                    // An offer or a request to the holder may still succeed.
                    Err(_) if self.is_pending(asker.id, part) => tally.waits = true,
                    Err(why) => tally.refuse(part, why),
                }
            }
        }
        decision.answer = tally.answer();
        self.settle(at, &mut decision);
        decision
    }

    /// A release is always granted. It also withdraws pending requests of its sender for these rights.
    fn release(&mut self, asker: Id, wanted: Rights, decision: &mut Decision) {
        let wanted = if wanted.is_empty() {
            // Not only held rights: pending requests are withdrawn too.
            self.held(asker).with(EVERYTHING)
        } else {
            wanted
        };
        self.end_where(Outcome::Withdrawn, decision, |handover| {
            handover.to == asker && handover.rights.collides(wanted)
        });
        self.take(asker, wanted, Reason::Released, decision);
    }

    /// Grants rights that nobody else holds, unless they are being handed over to another CUCS.
    pub(super) fn grant_free(
        &mut self,
        at: &Circumstances<'_>,
        to: Id,
        wanted: Rights,
        tally: &mut Tally,
        decision: &mut Decision,
    ) {
        let mut free = wanted.without(self.held_by_others(to));
        let claimed = self.pending.iter().find(|handover| {
            handover.to != to
                && matches!(handover.stage, Stage::Load(_))
                && handover.rights.collides(free)
        });
        if let Some(claim) = claimed {
            let refused = free.both(EVERYTHING.without(self.held(to)));
            // Control is requested as a whole.
            let control = if claim.rights.control().is_empty() {
                Rights::NONE
            } else {
                Rights::of_control(super::CONTROL)
            };
            let busy = refused.both(claim.rights.with(control));
            if !busy.is_empty() {
                tally.refuse(busy, Refusal::Busy(claim.to));
                free = free.without(busy);
            }
        }
        let news = free.without(self.held(to));
        // Free control also waits for another CUCS's load, so that two plans are never mixed.
        if !news.control().is_empty() && self.controller().is_none() && at.load_of_another(to) {
            let control = Rights::of_control(news.control());
            tally.waits = true;
            if !self.is_pending(to, control) {
                self.begin(None, to, control, Stage::Load(Reason::Requested), decision);
            }
            free = free.without(control);
        }
        self.give(to, free, Reason::Requested, decision);
    }

    /// Whether rights that another CUCS holds may be taken without its consent.
    fn may_take(
        &self,
        at: &Circumstances<'_>,
        asker: &Asker,
        access: Access,
        holder: Id,
        part: Rights,
        explicit: bool,
    ) -> Result<Reason, Refusal> {
        let control = !part.control().is_empty();
        let holds = at.asker(holder);
        if access == Access::Override {
            let rank = holds.map_or(0, |holder| holder.rank);
            if asker.may_override && asker.rank >= rank {
                return Ok(Reason::Overridden);
            }
        }
        // LOI 3 without a station number means every free station: it takes none from a holder, not even for the controller.
        let fit = at.is_fit(asker.id, holder);
        if fit && !control && explicit && self.controller() == Some(asker.id) {
            return Ok(Reason::Controller);
        }
        if fit && self.silence(holder) >= Silence::Offered {
            // During launch and landing control passes only by override, whether its holder is silent or not.
            return if control && at.launch_or_landing {
                Err(Refusal::LaunchOrLanding)
            } else {
                Ok(Reason::OfferedInSilence)
            };
        }
        Err(match access {
            Access::Override if asker.may_override => Refusal::Rank(holder),
            Access::Override => Refusal::NoOverride(holder),
            Access::Control | Access::Release => Refusal::Held(holder),
        })
    }

    /// Takes rights from their holder, at once or after another CUCS's load.
    #[expect(
        clippy::too_many_arguments,
        reason = "one step of a request, with what it reports to"
    )]
    fn seize(
        &mut self,
        at: &Circumstances<'_>,
        to: Id,
        from: Id,
        part: Rights,
        why: Reason,
        tally: &mut Tally,
        decision: &mut Decision,
    ) {
        let control = !part.control().is_empty();
        // Payload stations do not wait: a load concerns the holder of control alone.
        if !(control && at.load_of_another(to)) {
            return self.give(to, part, why, decision);
        }
        let is_override = |stage| stage == Stage::Load(Reason::Overridden);
        let mut standing = self
            .pending
            .iter()
            .filter(|other| other.rights.collides(part));
        if standing
            .clone()
            .any(|other| other.to == to && other.stage == Stage::Load(why))
        {
            tally.waits = true;
            return;
        }
        // An override ends an agreed handover, but not an override by a CUCS of the same rank or above.
        let rank = |id: Id| at.asker(id).map_or(0, |asker| asker.rank);
        let stays = standing.find(|other| {
            other.to != to
                && matches!(other.stage, Stage::Load(_))
                && (why != Reason::Overridden
                    || (is_override(other.stage) && rank(other.to) >= rank(to)))
        });
        if let Some(other) = stays {
            return tally.refuse(part, Refusal::Busy(other.to));
        }
        self.end_where(Outcome::Overtaken, decision, |other| {
            other.rights.collides(part)
        });
        tally.waits = true;
        self.begin(Some(from), to, part, Stage::Load(why), decision);
    }

    pub(super) fn is_pending(&self, to: Id, part: Rights) -> bool {
        self.pending
            .iter()
            .any(|handover| handover.to == to && handover.rights.collides(part))
    }
}

impl Tally {
    pub(super) fn new(asker: &Asker, wanted: Rights) -> Tally {
        let beyond = wanted.without(asker.may_hold());
        Tally {
            missing: beyond,
            why: (!beyond.is_empty()).then_some(Refusal::NotAuthorised),
            waits: false,
        }
    }

    pub(super) fn refuse(&mut self, part: Rights, why: Refusal) {
        self.missing = self.missing.with(part);
        self.why = self.why.or(Some(why));
    }

    pub(super) fn wait(&mut self) {
        self.waits = true;
    }

    pub(super) fn answer(self) -> Answer {
        match self.why {
            // A pending request is answered when it is decided; LOI Granted then shows which part was refused.
            _ if self.waits => Answer::Waits,
            Some(why) => Answer::Refused {
                missing: self.missing,
                why,
            },
            None => Answer::Granted,
        }
    }
}

/// LOI 2 and control, then payload stations.
fn parts(wanted: Rights) -> [Rights; 2] {
    let stations = Rights::of_stations(wanted.stations());
    [wanted.without(stations), stations]
}

/// All rights.
const EVERYTHING: Rights = Rights::everything();

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use stanag_msgs::enums::LoiBitmap;

    use super::super::rights::Stations;
    use super::super::{CONTROL, GUARDED_RANK};
    use super::*;

    #[test]
    fn a_controller_without_a_guard_takes_no_payload_station_of_one_with() {
        for (rank, taken) in [(0, true), (GUARDED_RANK, false)] {
            let asker = |id, rank| Asker {
                id: Id(id),
                authorised: LoiBitmap::LOI3.union(CONTROL),
                may_override: false,
                rank,
            };
            let roster = [asker(1, 0), asker(2, rank)];
            let at = Circumstances {
                now: Duration::ZERO,
                roster: &roster,
                loading: None,
                launch_or_landing: false,
            };
            let mut authority = Authority::default();
            let payload = Rights::of_stations(Stations::one(1));
            let control = Rights::of_control(CONTROL);
            authority.request(&at, &roster[0], Access::Control, control, false);
            authority.request(&at, &roster[1], Access::Control, payload, true);
            assert!(authority.holds_station(Id(2), 1));
            authority.request(&at, &roster[0], Access::Control, payload, true);
            assert_eq!(authority.holds_station(Id(1), 1), taken);
        }
    }
}
