//! The loss action: what the VSM flies after the loss of the controlling CUCS (`authority.on_loss`).
//!
//! The aircraft must never be left uncontrolled because one action failed, for example because the vehicle refuses it or a
//! contingency route cannot be flown. Each action is tried `MAX_TRIES` times, then the next one: first the configured
//! action, then AUTO.RTL, which is retried until the vehicle reports it, is on the ground, or a CUCS takes control. While
//! the vehicle is silent no command can be sent: it flies its own failsafe, and the action resumes when the link is back. A
//! fixed wing on its final approach is left to land: any other mode would turn or circle it a few metres above the ground.
//! If PX4 aborts that landing, the action is flown. A pilot who has taken the vehicle keeps it and the action ends: they see
//! the vehicle and must not lose it to a mode that nobody commands. While PX4 flies a failsafe the action waits for its end,
//! but only for a limited time if the failsafe merely holds (`by_itself`).
//!
//! ```text
//! idle --begin--> trying(action, n) --shown / on the ground / controlled / a pilot's--> idle
//!                     |  n = MAX_TRIES
//!                     +----------------> trying(Return, 1)
//! ```

use std::time::Duration;

use mapping::mode::Px4Mode;
use stanag_msgs::enums::{AlertPriority, SubsystemId};

use crate::config::OnLoss;
use crate::session::alerts::Cause;
use crate::session::contingency::priority::Urgency;
use crate::session::effects::Effects;
use crate::session::other::Other;

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
    /// It has flown that route to its end and holds there.
    pub(super) completed: bool,
    /// A maneuver is in progress, or a route is being uploaded for a mode command: another command would conflict with it.
    pub(super) busy: bool,
    /// A fixed wing is, or may be, on its final approach.
    pub(super) on_final: bool,
    /// A route can be uploaded now.
    pub(super) may_change_mission: bool,
    /// Who else flies the vehicle.
    pub(super) other: Option<Other>,
}

impl Action {
    /// The action for a lost CUCS; `steered`: it was steering by set points.
    pub(super) fn of(on_loss: OnLoss, steered: bool) -> Option<Action> {
        match on_loss {
            OnLoss::Continue if !steered => None,
            // Without steering it would fly straight on forever.
            OnLoss::Continue | OnLoss::Hold => Some(Action::Hold),
            OnLoss::Contingency => Some(Action::Contingency),
            OnLoss::Rtl => Some(Action::Return),
        }
    }

    pub(super) fn urgency(self) -> Urgency {
        match self {
            Action::Hold => Urgency::Hold,
            Action::Contingency => Urgency::Route,
            Action::Return => Urgency::Return,
        }
    }

    /// Whether a vehicle in this mode flies the action or its equivalent. A route that was flown to its end (`completed`) is
    /// not flown again from its start.
    pub(super) fn is_shown(
        self,
        mode: Option<Px4Mode>,
        carries_contingency: bool,
        completed: bool,
    ) -> bool {
        match mode {
            // Its own failsafe also brings it down.
            Some(Px4Mode::RTL | Px4Mode::LAND) => true,
            Some(Px4Mode::LOITER | Px4Mode::ORBIT) => {
                self == Action::Hold || (self == Action::Contingency && completed)
            }
            Some(Px4Mode::MISSION) => self == Action::Contingency && carries_contingency,
            _ => false,
        }
    }
}

impl LossAction {
    /// Whether an action is being flown, or tried.
    pub(super) fn is_active(&self) -> bool {
        self.trying.is_some()
    }

    /// The urgency of the action being tried.
    pub(super) fn urgency(&self) -> Option<Urgency> {
        self.trying.map(|trying| trying.action.urgency())
    }

    /// Another action of at least the same urgency is flown.
    pub(super) fn end(&mut self, why: &str, effects: &mut Effects<'_>) {
        self.trying = None;
        effects.clear(Cause::LossAction, why);
    }

    /// The controlling CUCS was lost; `steered`: it was steering by set points.
    pub(super) fn begin(&mut self, on_loss: OnLoss, steered: bool, now: Duration) {
        self.trying = Action::of(on_loss, steered).map(|action| Trying {
            action,
            tries: 0,
            next_at: now,
        });
    }

    /// The action to command now, if one is due.
    pub(super) fn poll(
        &mut self,
        context: &LossContext,
        effects: &mut Effects<'_>,
    ) -> Option<Action> {
        let before = self.trying?;
        // Checked before the next attempt is due, so that the alert is cleared as soon as the vehicle reports the action.
        if let Some(reason) = finished(context, before.action) {
            self.trying = None;
            effects.clear(Cause::LossAction, reason);
            return None;
        }
        let other = context.other.filter(|_| context.live);
        if let Some(other @ Other::Pilot(_)) = other {
            self.trying = None;
            effects.clear(Cause::LossAction, "a pilot has the vehicle");
            effects.warn_of_link(format!(
                "nobody controls the vehicle, and {other}: no loss action is flown"
            ));
            return None;
        }
        if before.next_at > context.now {
            return None;
        }
        let next_at = context.now + RETRY_INTERVAL;
        if let Some(other) = other {
            let (priority, comms) = (AlertPriority::Warning, SubsystemId::Comms);
            let held = if other.may_stay() {
                ", 30 s at most"
            } else {
                ""
            };
            let text = format!(
                "nobody controls the vehicle, and {other}: the loss action waits for its end{held}"
            );
            effects.raise(Cause::LossAction, priority, comms, text);
        }
        // A pilot may have taken it since the last attempt, which only a later report shows.
        let unseen = before.tries > 0 && context.mode.is_none();
        if !context.live || context.busy || context.on_final || other.is_some() || unseen {
            // Not counted as an attempt: the vehicle had no chance to refuse.
            self.trying = Some(Trying { next_at, ..before });
            return None;
        }
        let (mut action, tries) = match before.action {
            Action::Return => (Action::Return, before.tries + 1),
            _ if before.tries >= MAX_TRIES => (Action::Return, 1),
            other => (other, before.tries + 1),
        };
        // Another transfer, perhaps of the lost CUCS, blocks the upload of the contingency route: command AUTO.RTL, which
        // needs no upload.
        if action == Action::Contingency && !context.may_change_mission {
            action = Action::Return;
        }
        if before.tries == 0 {
            effects.clear(Cause::LossAction, "PX4's failsafe has ended, or only holds");
        } else {
            let text = if before.action == action {
                format!(
                    "nobody controls the vehicle and it does not {}: attempt {tries}",
                    name(before.action)
                )
            } else {
                format!(
                    "nobody controls the vehicle and it does not {}: commanding {}",
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

    /// When it must be polled next.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        self.trying.map(|trying| trying.next_at)
    }
}

/// Why the action has ended, for the text of the cleared alert.
fn finished(context: &LossContext, action: Action) -> Option<&'static str> {
    // With or without a link, the CUCS in control decides.
    if context.controlled {
        return Some("another CUCS controls the vehicle");
    }
    // The last report of a silent vehicle may no longer hold.
    if !context.live {
        return None;
    }
    if context.on_ground {
        return Some("vehicle is on the ground");
    }
    let shown = action.is_shown(context.mode, context.carries_contingency, context.completed);
    shown.then_some("the vehicle carries out the loss action")
}

fn name(action: Action) -> &'static str {
    match action {
        Action::Hold => "hold",
        Action::Contingency => "fly contingency A",
        Action::Return => "return",
    }
}

/// Attempts of an action before the next one.
const MAX_TRIES: u32 = 2;
/// Time between two attempts or checks.
const RETRY_INTERVAL: Duration = Duration::from_secs(2);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::testing::World;

    /// In the air, in a mode that no action leads to, with nobody in control.
    fn flying(world: &World) -> LossContext {
        LossContext {
            now: world.now.mono,
            live: true,
            on_ground: false,
            controlled: false,
            mode: Some(Px4Mode::POSCTL),
            carries_contingency: false,
            completed: false,
            busy: false,
            on_final: false,
            may_change_mission: true,
            other: None,
        }
    }

    fn poll(world: &mut World, machine: &mut LossAction, context: LossContext) -> Option<Action> {
        world.act(|_, _, effects| machine.poll(&context, effects))
    }

    fn begun(world: &World, on_loss: OnLoss, steered: bool) -> LossAction {
        let mut machine = LossAction::default();
        machine.begin(on_loss, steered, world.now.mono);
        machine
    }

    #[test]
    fn returns_home_after_the_hold_was_refused_twice() {
        let mut world = World::new();
        let mut machine = begun(&world, OnLoss::Hold, false);
        let expected = [Action::Hold, Action::Hold, Action::Return, Action::Return];
        for (tries, action) in expected.into_iter().enumerate() {
            let context = flying(&world);
            assert_eq!(poll(&mut world, &mut machine, context), Some(action));
            assert_eq!(poll(&mut world, &mut machine, context), None, "not at once");
            let emergency = world.alerts.standing().next().map(|alert| alert.priority);
            assert_eq!(emergency.is_some(), tries > 0);
            assert!(emergency.is_none_or(|priority| priority == AlertPriority::Emergency));
            assert_eq!(
                machine.poll_timeout(),
                Some(world.now.mono + RETRY_INTERVAL)
            );
            world.advance(RETRY_INTERVAL);
        }
        let returning = LossContext {
            mode: Some(Px4Mode::RTL),
            ..flying(&world)
        };
        assert_eq!(poll(&mut world, &mut machine, returning), None);
        assert!(!machine.is_active() && machine.poll_timeout().is_none());
        assert_eq!(world.alerts.standing().count(), 0);
    }

    #[test]
    fn tries_are_not_counted_while_the_vehicle_is_silent_or_busy() {
        let mut world = World::new();
        let mut machine = begun(&world, OnLoss::Hold, false);
        for round in 0..10 {
            let context = LossContext {
                live: round % 2 == 0,
                busy: true,
                ..flying(&world)
            };
            assert_eq!(poll(&mut world, &mut machine, context), None);
            assert!(machine.is_active());
            world.advance(RETRY_INTERVAL);
        }
        assert_eq!(world.alerts.standing().count(), 0, "it has refused nothing");
        for action in [Action::Hold, Action::Hold, Action::Return] {
            let context = flying(&world);
            assert_eq!(poll(&mut world, &mut machine, context), Some(action));
            world.advance(RETRY_INTERVAL);
        }
    }

    #[test]
    fn a_pilot_keeps_the_vehicle_and_the_end_of_a_failsafe_is_waited_for() {
        let mut world = World::new();
        let mut machine = begun(&world, OnLoss::Rtl, false);
        for round in 0..5 {
            let context = LossContext {
                mode: Some(Px4Mode::LOITER),
                other: Some(Other::Failsafe(Px4Mode::LOITER)),
                ..flying(&world)
            };
            assert_eq!(poll(&mut world, &mut machine, context), None, "{round}");
            assert_eq!(world.alerts.standing().count(), 1, "it is reported");
            world.advance(RETRY_INTERVAL);
        }
        let after_it = flying(&world);
        let action = poll(&mut world, &mut machine, after_it);
        assert_eq!(action, Some(Action::Return));
        assert_eq!(world.alerts.standing().count(), 0);
        // A pilot takes it while that is tried: nothing is commanded on an older report, and nothing any more on a later one.
        world.advance(RETRY_INTERVAL);
        let unseen = LossContext {
            mode: None,
            ..flying(&world)
        };
        assert_eq!(poll(&mut world, &mut machine, unseen), None);
        assert!(machine.is_active());
        world.advance(RETRY_INTERVAL);
        let taken = LossContext {
            other: Some(Other::Pilot(Px4Mode::POSCTL)),
            ..flying(&world)
        };
        assert_eq!(poll(&mut world, &mut machine, taken), None);
        assert!(!machine.is_active());
    }

    #[test]
    fn a_wing_on_its_final_approach_lands_whatever_is_configured() {
        for on_loss in [OnLoss::Hold, OnLoss::Contingency, OnLoss::Rtl] {
            let mut world = World::new();
            let mut machine = begun(&world, on_loss, false);
            for _ in 0..30 {
                let context = LossContext {
                    mode: Some(Px4Mode::MISSION),
                    on_final: true,
                    ..flying(&world)
                };
                assert_eq!(poll(&mut world, &mut machine, context), None, "{on_loss:?}");
                world.advance(RETRY_INTERVAL);
            }
            // PX4 has aborted the landing, and loiters above it.
            let mut aborted = machine;
            let context = LossContext {
                mode: Some(Px4Mode::LOITER),
                ..flying(&world)
            };
            let expected = match on_loss {
                OnLoss::Rtl => Some(Action::Return),
                OnLoss::Contingency => Some(Action::Contingency),
                OnLoss::Hold | OnLoss::Continue => None,
            };
            assert_eq!(poll(&mut world, &mut aborted, context), expected);
            // Or it is down.
            let mut machine = begun(&world, on_loss, false);
            let context = LossContext {
                on_ground: true,
                ..flying(&world)
            };
            assert_eq!(poll(&mut world, &mut machine, context), None);
            assert!(!machine.is_active());
        }
    }

    #[test]
    fn a_silent_vehicle_is_not_done_whatever_it_showed_last() {
        let mut world = World::new();
        let mut machine = begun(&world, OnLoss::Rtl, false);
        let last_shown = LossContext {
            live: false,
            on_ground: true,
            mode: Some(Px4Mode::RTL),
            ..flying(&world)
        };
        assert_eq!(poll(&mut world, &mut machine, last_shown), None);
        assert!(machine.is_active());
        world.advance(RETRY_INTERVAL);
        let context = flying(&world);
        assert_eq!(
            poll(&mut world, &mut machine, context),
            Some(Action::Return)
        );
    }

    #[test]
    fn a_contingency_that_cannot_be_uploaded_now_becomes_a_return() {
        let mut world = World::new();
        let mut machine = begun(&world, OnLoss::Contingency, false);
        let transferring = LossContext {
            may_change_mission: false,
            ..flying(&world)
        };
        let action = poll(&mut world, &mut machine, transferring);
        assert_eq!(action, Some(Action::Return));
    }

    #[test]
    fn a_mission_ends_the_action_only_where_it_is_the_contingency() {
        for carries_contingency in [false, true] {
            let mut world = World::new();
            let mut machine = begun(&world, OnLoss::Contingency, false);
            let context = LossContext {
                mode: Some(Px4Mode::MISSION),
                carries_contingency,
                ..flying(&world)
            };
            let action = poll(&mut world, &mut machine, context);
            let expected = (!carries_contingency).then_some(Action::Contingency);
            assert_eq!(action, expected);
            assert_eq!(machine.is_active(), !carries_contingency);
        }
    }

    #[test]
    fn it_ends_on_the_ground_and_once_a_station_controls_even_a_silent_vehicle() {
        let mut world = World::new();
        let (ground, taken) = (
            LossContext {
                on_ground: true,
                ..flying(&world)
            },
            LossContext {
                controlled: true,
                live: false,
                ..flying(&world)
            },
        );
        for context in [ground, taken] {
            let mut machine = begun(&world, OnLoss::Rtl, false);
            assert_eq!(poll(&mut world, &mut machine, context), None);
            assert!(!machine.is_active());
        }
    }

    #[test]
    fn continue_holds_only_a_vehicle_that_was_steered() {
        let mut world = World::new();
        assert!(!begun(&world, OnLoss::Continue, false).is_active());
        let mut machine = begun(&world, OnLoss::Continue, true);
        let context = flying(&world);
        assert_eq!(poll(&mut world, &mut machine, context), Some(Action::Hold));
    }
}
