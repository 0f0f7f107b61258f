//! Who decides instead of the contingency: the CUCS in control, its successor, a flight termination, or somebody else.

use std::time::Duration;

use stanag_msgs::enums::AlertPriority;

use super::record::End;
use super::{Contingencies, Outlet, Provision};
use crate::session::alerts::Cause;
use crate::session::trigger::Trigger;

impl Contingencies {
    /// Whether the sender of a command `at` this time may have decided against what is flown: the alerts about all of it
    /// were raised some seconds before.
    pub(crate) fn knew_of(&self, at: Duration) -> bool {
        let concerns = |one: &Trigger| {
            self.trying.is_some_and(|trying| trying.trigger == *one)
                || (self.is_present(*one) && self.end_of(*one).and_then(End::flown).is_some())
        };
        Trigger::ALL.into_iter().filter(concerns).all(|one| {
            let alerted = self.alerted.get(one.index()).copied().flatten();
            // `None` after a restart, for a cause whose action was flown before it. That is known, and must not refuse
            // commands forever.
            alerted.is_none_or(|alerted| alerted + READ_WITHIN <= at)
        })
    }

    /// The CUCS in control, which knows of the contingency, sends another command: its decision applies.
    pub(crate) fn overridden(&mut self, config: &Provision, effects: &mut dyn Outlet) {
        let standing = Trigger::ALL
            .into_iter()
            .filter(|one| self.is_present(*one) && one.action(config).is_some())
            // The CUCS does not know about the others yet.
            .filter(|one| self.alerted.get(one.index()).is_some_and(Option::is_some));
        let standing: Vec<Trigger> = standing
            .filter(|one| self.end_of(*one) != Some(End::Operator))
            .collect();
        self.trying = None;
        if standing.is_empty() {
            return;
        }
        for trigger in &standing {
            self.set(*trigger, End::Operator);
        }
        self.save(effects);
        for trigger in standing {
            let text = format!(
                "{}: the CUCS in control has sent another command",
                trigger.text(config)
            );
            self.raise(trigger, AlertPriority::Warning, text, effects);
        }
    }

    /// A command of the CUCS in control waits for its route: if that is refused, the action is tried again.
    pub(crate) fn operator_loads(&mut self) {
        if let Some(trying) = &mut self.trying {
            trying.yields = true;
        }
    }

    /// The CUCS in control is lost: an operator who decided otherwise can no longer see the vehicle.
    pub(crate) fn controller_lost(&mut self, effects: &mut dyn Outlet) {
        let before = self.handled.len();
        // An action that the vehicle still shows is handled again at once. A completed route is not flown again from its
        // start.
        let stays = |end| matches!(end, End::Pilot | End::Completed(_));
        self.handled.retain(|one| stays(one.end));
        if self.handled.len() != before {
            self.save(effects);
        }
    }

    /// The CUCS in control has released the vehicle and nobody has taken it: actions that it ended are flown again.
    pub(crate) fn released(&mut self, effects: &mut dyn Outlet) {
        let before = self.handled.len();
        self.handled.retain(|one| one.end != End::Operator);
        if self.handled.len() != before {
            self.save(effects);
        }
    }

    /// Another CUCS has taken control: it must know which persisting causes its predecessor or a pilot has ended.
    pub(crate) fn taken_over(&self, config: &Provision, effects: &mut dyn Outlet) {
        for trigger in Trigger::ALL.into_iter().filter(|one| self.is_present(*one)) {
            let ended = match self.end_of(trigger) {
                Some(End::Operator) => {
                    "the CUCS that controlled the vehicle before has sent another command; no action is flown for this unless \
                     control is lost or released"
                }
                Some(End::Pilot) => "it was left to a pilot, and no action is flown for this",
                Some(End::Shown(_) | End::Completed(_)) | None => continue,
            };
            let text = format!("{}: {ended}", trigger.text(config));
            effects.notify(AlertPriority::Warning, trigger.subsystem(), text);
        }
    }

    /// A flight termination is commanded: actions that were not shown begin again after it, if it is reset in the air.
    pub(crate) fn yield_to_termination(&mut self, effects: &mut dyn Outlet) {
        if let Some(trying) = self.trying.take() {
            effects.clear(
                Cause::Contingency(trying.trigger),
                "a flight termination is commanded",
            );
        }
        self.watches = Default::default();
        self.alerted = Default::default();
    }

    /// Somebody else, who knows what was flown, decides from now on: active causes begin again once that is over.
    pub(crate) fn stand_down(&mut self, why: &str, effects: &mut dyn Outlet) {
        self.live_since = None;
        self.begin_afresh(why, effects);
    }
}

/// The minimum time to read an alert and decide.
const READ_WITHIN: Duration = Duration::from_secs(3);
