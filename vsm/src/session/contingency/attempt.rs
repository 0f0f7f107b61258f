//! The action that is flown: which one, until when it is tried, and what follows where it fails or has been flown.

use std::time::Duration;

use stanag_msgs::enums::{AlertPriority, RouteType};

use super::priority::Urgency;
use super::record::{End, Handled};
use super::{Contingencies, ContingencyContext, Outlet, Provision, Trying};
use crate::config::ContingencyAction as Action;
use crate::session::other::Other;
use crate::session::trigger::Trigger;

impl Contingencies {
    /// Selects the most urgent of the active causes that are not handled.
    pub(super) fn select(&mut self, context: &ContingencyContext) {
        let open = Trigger::ALL
            .into_iter()
            .filter(|one| self.is_present(*one) && self.end_of(*one).is_none());
        let open = open.filter_map(|one| Some((one, one.action(&context.config)?)));
        // `max_by_key` returns the last of equal ones: reversed, the first in the order of `Trigger::ALL`.
        let most = open
            .rev()
            .max_by_key(|(_, action)| Urgency::of_contingency(*action));
        let Some((trigger, action)) = most else {
            return;
        };
        let is_less = |trying: Trying| {
            trying.trigger != trigger
                && Urgency::of_contingency(trying.action) < Urgency::of_contingency(action)
        };
        if self.trying.is_none_or(is_less) {
            self.trying = Some(Trying::of(trigger, action, context.now));
        }
    }

    /// The action to fly now, if it is this machine's turn and time for an attempt.
    pub(crate) fn poll(
        &mut self,
        context: &ContingencyContext,
        effects: &mut dyn Outlet,
    ) -> Option<Action> {
        let before = self.trying?;
        if before.next_at > context.now {
            return None;
        }
        let next_at = context.now + RETRY_INTERVAL;
        // Its own command in progress is waited for; a command of others gives way to it.
        let waits = !context.airborne
            || context.mode.is_none()
            || context.operator_waits && before.yields
            || context.busy && before.tries > 0;
        let why = match context.other {
            Some(other) if other.may_stay() => Some(format!("{other}, for 30 s at most")),
            Some(other) => Some(other.to_string()),
            None if context.on_final => Some("the vehicle is on its final approach".to_owned()),
            None => None,
        };
        if let Some(why) = &why {
            let text = format!(
                "{}: {why}; {} waits for its end",
                before.trigger.text(&context.config),
                before.action.name()
            );
            self.raise(before.trigger, AlertPriority::Warning, text, effects);
        }
        if waits || why.is_some() {
            // Not counted as an attempt: the vehicle had no chance to refuse.
            self.trying = Some(Trying { next_at, ..before });
            return None;
        }
        let last = self.last();
        let (mut action, mut tries) = match before.action {
            same if same == last => (same, before.tries + 1),
            _ if before.tries >= MAX_TRIES => (last, 1),
            same => (same, before.tries + 1),
        };
        let [a, b] = context.stored;
        let route_type = match action {
            Action::ContingencyA => Some((RouteType::ContingencyA, a)),
            Action::ContingencyB => Some((RouteType::ContingencyB, b)),
            _ => None,
        };
        // An action is skipped if it needs an upload that cannot begin, or a position that is not known.
        let flies = route_type.is_none_or(|(route, stored)| {
            stored && (context.carries == Some(route) || context.may_change_mission)
        });
        if !flies || (last == Action::Land && action != last) {
            (action, tries) = (last, 1);
        }
        self.trying = Some(Trying {
            action,
            tries,
            next_at,
            yields: false,
            ..before
        });
        Some(action)
    }

    /// Reports what was commanded.
    pub(crate) fn announce(&mut self, config: &Provision, effects: &mut dyn Outlet) {
        let Some(trying) = self.trying else {
            return;
        };
        let (what, action) = (trying.trigger.text(config), trying.action.name());
        let configured = trying.trigger.action(config).map(Action::name);
        let text = match configured {
            Some(wanted) if wanted != action => {
                format!("{what}: {wanted} cannot be flown, or is not shown: commanding {action}")
            }
            _ => format!("{what}: commanding {action}"),
        };
        let text = match trying.tries {
            1 => text,
            tries => format!("{text}, attempt {tries}"),
        };
        self.raise(trying.trigger, AlertPriority::Emergency, text, effects);
    }

    /// Ends an action that the vehicle shows, or that a pilot has taken over.
    pub(super) fn finish(&mut self, context: &ContingencyContext, effects: &mut dyn Outlet) {
        let Some(trying) = self.trying else {
            return;
        };
        let trigger = trying.trigger;
        let text = trigger.text(&context.config);
        let (end, text) = match (context.mode, context.other) {
            (Some(mode), _) if context.shows(trying.action) => (
                End::Shown(trying.action),
                format!(
                    "{text}: the vehicle is in {}, as for {}",
                    mode.name(),
                    trying.action.name()
                ),
            ),
            (_, Some(other @ Other::Pilot(_))) => (
                End::Pilot,
                format!("{text}, and {other}: nothing is commanded"),
            ),
            _ => return,
        };
        self.trying = None;
        // Stored before it is reported: a restart must not fly it again.
        self.set(trigger, end);
        self.save(effects);
        self.raise(trigger, AlertPriority::Emergency, text, effects);
    }

    /// A contingency route is flown to its end, and its cause persists. The controlling CUCS decides what follows. If
    /// nobody is in control, nothing would end the hold there: the vehicle returns or lands.
    pub(super) fn complete(&mut self, context: &ContingencyContext, effects: &mut dyn Outlet) {
        let of = |action| match action {
            Action::ContingencyA => Some(RouteType::ContingencyA),
            Action::ContingencyB => Some(RouteType::ContingencyB),
            _ => None,
        };
        for trigger in Trigger::ALL {
            match self.end_of(trigger).filter(|_| self.is_present(trigger)) {
                Some(End::Shown(action))
                    if context.completed.is_some() && of(action) == context.completed =>
                {
                    self.set(trigger, End::Completed(action));
                    self.save(effects);
                    let (what, route) = (trigger.text(&context.config), action.name());
                    let text =
                        format!("{what}: {route} is flown to its end, and the vehicle holds there");
                    self.raise(trigger, AlertPriority::Emergency, text, effects);
                }
                Some(End::Completed(_)) if !context.controlled && self.trying.is_none() => {
                    self.handled.retain(|one| one.trigger != trigger);
                    self.unsaved = Some(context.now);
                    self.trying = Some(Trying::of(trigger, self.last(), context.now));
                }
                _ => {}
            }
        }
    }

    /// The vehicle makes no progress on a contingency action: it returns or lands. Returns false if it flies none.
    pub(crate) fn begin_again(&mut self, now: Duration) -> bool {
        let flown = |one: &&Handled| one.end.flown().is_some();
        let flown = self.handled.iter().find(flown).map(|one| one.trigger);
        let Some(trigger) = self.trying.map(|trying| trying.trigger).or(flown) else {
            return false;
        };
        self.handled.retain(|one| one.trigger != trigger);
        self.unsaved = Some(now);
        self.trying = Some(Trying::of(trigger, self.last(), now));
        true
    }

    /// The action that is tried until it is shown, after the configured one has failed: without a position only a landing
    /// is possible.
    fn last(&self) -> Action {
        match self.is_present(Trigger::Position) {
            true => Action::Land,
            false => Action::Rtl,
        }
    }
}

impl Trying {
    fn of(trigger: Trigger, action: Action, now: Duration) -> Trying {
        Trying {
            trigger,
            action,
            tries: 0,
            next_at: now,
            yields: false,
        }
    }
}

/// Attempts of an action before the next one.
const MAX_TRIES: u32 = 2;
/// Time between two attempts or checks.
const RETRY_INTERVAL: Duration = Duration::from_secs(2);
