//! Loss action: what the VSM flies once the controlling CUCS is lost (`authority.on_loss`).
//!
//! The aircraft must never be left to nobody because one action failed: a vehicle that refuses it, or a contingency route
//! that turns out not to be flyable. Each action is tried `MAX_TRIES` times, then the next: the configured one, then
//! AUTO.RTL, which is tried until the vehicle shows it, is on the ground, or a CUCS has taken control. While the vehicle
//! is silent nothing can be commanded: it flies its own failsafe, and the action resumes when the link is back.
//!
//! ```text
//! idle --begin--> trying(action, n) --shown / on the ground / controlled--> idle
//!                     |  n = MAX_TRIES
//!                     +----------------> trying(Return, 0)
//! ```

use std::time::Duration;

use mapping::mode::Px4Mode;
use stanag_msgs::enums::{AlertPriority, SubsystemId};

use crate::config::OnLoss;
use crate::session::alerts::Cause;
use crate::session::effects::Effects;

/// The machine.
#[derive(Debug, Default)]
pub(super) struct LossAction {
    trying: Option<Trying>,
}

#[derive(Debug, Clone, Copy)]
struct Trying {
    action: Action,
    tries: u32,
    next_at: Duration,
}

/// What is flown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Action {
    Hold,
    Contingency,
    Return,
}

/// What it reads.
#[derive(Debug, Clone, Copy)]
pub(super) struct LossContext {
    pub(super) now: Duration,
    /// Data is received from the vehicle.
    pub(super) live: bool,
    pub(super) on_ground: bool,
    /// A CUCS holds LOI 4 or 5.
    pub(super) controlled: bool,
    pub(super) mode: Option<Px4Mode>,
    /// The vehicle carries the route of contingency A.
    pub(super) carries_contingency: bool,
    /// A maneuver or a load for one is in progress: commanding now would race with it.
    pub(super) busy: bool,
    /// A route can be uploaded now.
    pub(super) may_change_mission: bool,
}

impl LossAction {
    /// Whether an action is being flown, or tried.
    pub(super) fn is_active(&self) -> bool {
        self.trying.is_some()
    }

    /// The controlling CUCS was lost; `steered`: it was steering by set points.
    pub(super) fn begin(&mut self, on_loss: OnLoss, steered: bool, now: Duration) {
        let action = match on_loss {
            OnLoss::Continue if !steered => None,
            // Steered by nobody it would fly straight on for ever.
            OnLoss::Continue | OnLoss::Hold => Some(Action::Hold),
            OnLoss::Contingency => Some(Action::Contingency),
            OnLoss::Rtl => Some(Action::Return),
        };
        self.trying = action.map(|action| Trying {
            action,
            tries: 0,
            next_at: now,
        });
    }

    /// The action to fly now, where it is time to try one.
    pub(super) fn poll(
        &mut self,
        context: &LossContext,
        effects: &mut Effects<'_>,
    ) -> Option<Action> {
        let before = self.trying?;
        if let Some(reason) = finished(context, before.action) {
            self.trying = None;
            effects.clear(Cause::LossAction, reason);
            return None;
        }
        if before.next_at > context.now {
            return None;
        }
        let next_at = context.now + RETRY_INTERVAL;
        if !context.live || context.busy {
            // Not counted as a try: the vehicle did not get the chance to refuse.
            self.trying = Some(Trying { next_at, ..before });
            return None;
        }
        let (mut action, tries) = match before.action {
            Action::Return => (Action::Return, before.tries + 1),
            _ if before.tries >= MAX_TRIES => (Action::Return, 1),
            other => (other, before.tries + 1),
        };
        // A transfer that its owner left behind must not keep the aircraft from coming home.
        if action == Action::Contingency && !context.may_change_mission {
            action = Action::Return;
        }
        if before.tries > 0 {
            let text = if before.action == action {
                format!(
                    "the controlling CUCS is lost and the vehicle does not {}: try {tries}",
                    name(before.action)
                )
            } else {
                format!(
                    "the controlling CUCS is lost and the vehicle does not {}: it is to {}",
                    name(before.action),
                    name(action)
                )
            };
            let (priority, comms) = (AlertPriority::Emergency, SubsystemId::Comms);
            effects.raise(Cause::LossAction, priority, comms, text);
        }
        self.trying = Some(Trying {
            action,
            tries,
            next_at,
        });
        Some(action)
    }

    /// When it is polled next.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        self.trying.map(|trying| trying.next_at)
    }
}

/// Why nothing is left to be done, for the alert that is cleared.
fn finished(context: &LossContext, action: Action) -> Option<&'static str> {
    if context.controlled {
        return Some("another CUCS controls the vehicle");
    }
    if !context.live {
        return None;
    }
    if context.on_ground {
        return Some("the vehicle stands");
    }
    let shown = match context.mode {
        // Its own failsafe brings it down, too.
        Some(Px4Mode::RTL | Px4Mode::LAND) => true,
        Some(Px4Mode::LOITER | Px4Mode::ORBIT) => action == Action::Hold,
        Some(Px4Mode::MISSION) => action == Action::Contingency && context.carries_contingency,
        _ => false,
    };
    shown.then_some("the vehicle does what is to be done after the loss")
}

fn name(action: Action) -> &'static str {
    match action {
        Action::Hold => "hold",
        Action::Contingency => "fly contingency A",
        Action::Return => "return",
    }
}

/// Tries of an action before the next.
const MAX_TRIES: u32 = 2;
/// From one try, or look, to the next.
const RETRY_INTERVAL: Duration = Duration::from_secs(2);
