//! Silent holders, rights withdrawn by the configuration, and the passing of time.

use std::time::Duration;

use stanag_msgs::Id;

use super::decision::{Decision, Outcome, Reason, Stage};
use super::rights::Rights;
use super::{Asker, Authority, Circumstances, Silence};

impl Authority {
    /// The silence of a CUCS has reached this stage. At [`Silence::Lost`] it loses control, its payload stations and its
    /// pending requests; it keeps LOI 2, which commands nothing. A CUCS that comes back must request its rights again.
    pub fn silence_of(&mut self, at: &Circumstances<'_>, id: Id, silence: Silence) -> Decision {
        let mut decision = Decision::default();
        if silence == Silence::None || self.held(id).is_empty() {
            self.silent.remove(&id);
        } else if silence == Silence::Lost {
            self.silent.remove(&id);
            self.end_where(Outcome::Overtaken, &mut decision, |handover| {
                let asked =
                    handover.from == Some(id) && matches!(handover.stage, Stage::Consent(_));
                // If a guarded holder is lost, a request by a CUCS without a guard is not served first.
                handover.to == id || (asked && !at.is_fit(handover.to, id))
            });
            let held = self.held(id);
            let monitor = held.both(Rights::monitor());
            self.take(id, held.without(monitor), Reason::Lost, &mut decision);
        } else {
            self.silent.insert(id, silence);
        }
        self.settle(at, &mut decision);
        decision
    }

    /// The configuration has changed: withdraws rights that it no longer allows, and ends handovers of them.
    pub fn reconfigured(&mut self, at: &Circumstances<'_>) -> Decision {
        let mut decision = Decision::default();
        let allowed = |id| at.asker(id).map_or(Rights::NONE, Asker::may_hold);
        let holders: Vec<_> = self.holders().collect();
        for (id, held) in holders {
            let kept = held.both(allowed(id));
            self.take(id, held.without(kept), Reason::Withdrawn, &mut decision);
        }
        self.end_where(Outcome::Overtaken, &mut decision, |handover| {
            handover.rights.both(allowed(handover.to)) != handover.rights
        });
        self.settle(at, &mut decision);
        decision
    }

    /// Time has passed, a load has ended, or the vehicle's mode has changed.
    pub fn look_again(&mut self, at: &Circumstances<'_>) -> Decision {
        let mut decision = Decision::default();
        self.settle(at, &mut decision);
        decision
    }

    /// When [`Authority::look_again`] is next needed.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Duration> {
        let deadlines = self
            .pending
            .iter()
            .filter_map(|handover| match handover.stage {
                Stage::Consent(until) | Stage::Acceptance(until) => Some(until),
                Stage::Load(_) => None,
            });
        deadlines.min()
    }
}
