//! Contingencies: what is flown while the battery is low, the position is lost, the fence is left or a motor has failed.
//! The VSM flies them (`vehicle.contingency`, or 50023); without a link to the ground the air-side agent does
//! (`contingency` of `airside.toml`). One machine for both, which writes through an [`Outlet`].
//!
//! PX4 has its own failsafes for each of these, which take precedence, as does a pilot. A contingency adds what PX4's
//! parameters cannot do: a route home instead of a straight line, or an action before PX4's own thresholds. The controlling
//! CUCS is notified and has the final decision: a new command, 3 s or more after the alert, ends the action, and it is not
//! flown again until the cause was gone, unless that CUCS is lost or releases control.
//!
//! ```text
//! clear --confirmed by reports--> stands --commanded--> trying(action, n) --shown / a pilot's / an operator's--> handled
//!   ^                                                       |  n = MAX_TRIES                                        |
//!   |                                                       +--> trying(return, 1); land where the position is lost |
//!   +------------------------- the cause is gone for CLEAR_AFTER, or the vehicle is on the ground ------------------+
//! ```
//!
//! A completed contingency route is not flown again: the vehicle holds at its end for the controlling CUCS, or returns if
//! nobody is in control. Handled causes are stored on disk: a restart neither flies an action again nor forgets one that
//! has not been flown. A PX4 failsafe does not end a contingency: the action waits for the end of the failsafe, but only
//! for a limited time if that merely holds. The parts: `priority` decides whether this or the loss action is flown;
//! `cause`: whether a cause is active; `attempt`: which action is tried, and how often; `operator`: who decides instead;
//! `reported`: what a vehicle reports about each cause; `setting`: what CUCSs have set; `outlet`: what the machine needs from
//! its host; `provision`: the action for each cause; `record`: what is kept over a restart.

mod attempt;
mod cause;
mod operator;
mod outlet;
pub(crate) mod priority;
mod provision;
mod record;
mod reported;
mod setting;
#[cfg(test)]
mod tests;

pub(crate) use self::cause::{Seen, What};
pub(crate) use self::outlet::Outlet;
pub(crate) use self::provision::Provision;
pub(crate) use self::record::{Record, Setting};
pub(crate) use self::reported::reported;

use std::time::Duration;

use mapping::mode::Px4Mode;
use mavlink_link::store::StoreError;
use stanag_msgs::enums::{AlertPriority, RouteType, SubsystemId};

use self::cause::Watch;
use self::priority::{Urgency, is_shown};
use self::record::{End, Handled};
use crate::config::ContingencyAction as Action;
use crate::session::alerts::Cause;
use crate::session::other::Other;
use crate::session::trigger::Trigger;

/// The machine.
#[derive(Debug, Default)]
pub(crate) struct Contingencies {
    watches: [Watch; Trigger::ALL.len()],
    handled: Vec<Handled>,
    /// Settings of CUCSs (50023), which override the configuration.
    set: Vec<Setting>,
    trying: Option<Trying>,
    /// When the first alert about each active cause was raised.
    alerted: [Option<Duration>; Trigger::ALL.len()],
    /// When to retry writing the record; `None` if it is stored.
    unsaved: Option<Duration>,
    /// Since when data is received from the vehicle.
    live_since: Option<Duration>,
}

/// The state of a contingency, for 50023.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Standing {
    Absent,
    Commanded,
    Flown,
    Ended,
}

#[derive(Debug, Clone, Copy)]
struct Trying {
    trigger: Trigger,
    action: Action,
    tries: u32,
    next_at: Duration,
    /// The CUCS in control has since sent a command that waits for its route: that ends this action once it is flown.
    yields: bool,
}

/// What it reads.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ContingencyContext {
    pub(crate) now: Duration,
    pub(crate) config: Provision,
    /// Data is received from the vehicle.
    pub(crate) live: bool,
    pub(crate) airborne: bool,
    /// Disarmed: the flight is over. A vehicle that reports for a moment that it is on the ground may still fly.
    pub(crate) down: bool,
    /// By a report that is newer than the last command.
    pub(crate) mode: Option<Px4Mode>,
    pub(crate) other: Option<Other>,
    /// What the vehicle reports about each cause, in the order of [`Trigger::ALL`]; `None` if it does not report it.
    pub(crate) seen: [Option<Seen>; Trigger::ALL.len()],
    /// The route that the vehicle carries.
    pub(crate) carries: Option<RouteType>,
    /// The route that it flies, if it names the mission that was read back from it.
    pub(crate) flies: Option<RouteType>,
    /// The route that it has flown to its end, if it holds there now.
    pub(crate) completed: Option<RouteType>,
    /// A CUCS holds LOI 4 or 5.
    pub(crate) controlled: bool,
    /// It flies the landing of a mission.
    pub(crate) lands: bool,
    /// An action that the VSM has started is not completed yet.
    pub(crate) busy: bool,
    /// A command of a CUCS waits for its route.
    pub(crate) operator_waits: bool,
    /// A fixed wing flies to its touch-down, or may do so.
    pub(crate) on_final: bool,
    /// Whether contingency routes A and B are stored.
    pub(crate) stored: [bool; 2],
    /// A route can be uploaded now.
    pub(crate) may_change_mission: bool,
}

impl Trigger {
    pub(crate) fn index(self) -> usize {
        self as usize
    }

    fn subsystem(self) -> SubsystemId {
        match self {
            Trigger::Engine => SubsystemId::Engine,
            Trigger::Position | Trigger::Fence => SubsystemId::Navigation,
            Trigger::Battery => SubsystemId::PropulsionEnergy,
            Trigger::Link => SubsystemId::Comms,
        }
    }

    fn text(self, config: &Provision) -> String {
        match self {
            Trigger::Engine => "a motor has failed".to_owned(),
            Trigger::Position => "the position is lost".to_owned(),
            Trigger::Fence => "the vehicle has left its fence".to_owned(),
            Trigger::Battery => format!("battery below {} %", config.battery_percent),
            Trigger::Link => "the ground is lost".to_owned(),
        }
    }

    /// The missing value if the vehicle does not report the cause.
    fn unreported(self) -> &'static str {
        match self {
            Trigger::Engine => "engine (SYS_STATUS does not watch the motors)",
            Trigger::Position => "position (no ESTIMATOR_STATUS)",
            Trigger::Fence => "fence (no area is configured or loaded, or no position)",
            Trigger::Battery => "battery (no level in SYS_STATUS or BATTERY_STATUS)",
            Trigger::Link => "link",
        }
    }
}

impl ContingencyContext {
    fn shows(&self, action: Action) -> bool {
        let shown = |mode| is_shown(action, mode, self.flies, self.lands);
        self.mode.is_some_and(shown)
    }
}

impl Contingencies {
    /// Restores the record after a restart.
    pub(crate) fn restore(&mut self, effects: &mut dyn Outlet) -> Result<(), StoreError> {
        let record = effects.load()?.unwrap_or_default();
        (self.handled, self.set) = (record.handled, record.set);
        Ok(())
    }

    /// The state of a cause.
    pub(crate) fn standing(&self, trigger: Trigger) -> Standing {
        match self.end_of(trigger) {
            _ if !self.is_present(trigger) => Standing::Absent,
            None => Standing::Commanded,
            Some(End::Shown(_) | End::Completed(_)) => Standing::Flown,
            Some(End::Pilot | End::Operator) => Standing::Ended,
        }
    }

    /// The urgency of the action being tried.
    pub(crate) fn urgency(&self) -> Option<Urgency> {
        self.trying
            .map(|trying| Urgency::of_contingency(trying.action))
    }

    /// The urgency of what the vehicle flies, if that is the action of a contingency whose cause persists.
    pub(crate) fn flown(
        &self,
        mode: Option<Px4Mode>,
        flies: Option<RouteType>,
        lands: bool,
    ) -> Option<Urgency> {
        let mode = mode?;
        let flown = self.handled.iter().filter_map(|one| match one.end {
            End::Shown(action) if is_shown(action, mode, flies, lands) => {
                Some(Urgency::of_contingency(action))
            }
            _ => None,
        });
        flown.max()
    }

    /// What was done about each cause, in a few words.
    pub(crate) fn summary(&self, config: &Provision) -> Vec<String> {
        let each = Trigger::ALL.into_iter().filter_map(|one| {
            let trying = self.trying.filter(|trying| trying.trigger == one);
            let what = match (self.end_of(one), trying) {
                (Some(End::Shown(action) | End::Completed(action)), _) => {
                    format!("{} flown", action.name())
                }
                (Some(End::Pilot), _) => "left to a pilot".to_owned(),
                (Some(End::Operator), _) => "left to the ground".to_owned(),
                (None, Some(trying)) => format!("{} commanded", trying.action.name()),
                (None, None) => return None,
            };
            Some(format!("{}: {what}", one.text(config)))
        });
        each.collect()
    }

    /// Whether an earlier process has handled anything, or this one.
    pub(crate) fn has_handled(&self) -> bool {
        !self.handled.is_empty()
    }

    /// A cause is active, and neither a pilot nor an operator has taken over.
    pub(crate) fn stands(&self) -> bool {
        let flown = |one: &Handled| one.end.flown().is_some() && self.is_present(one.trigger);
        self.trying.is_some() || self.handled.iter().any(flown)
    }

    fn is_present(&self, trigger: Trigger) -> bool {
        self.watches
            .get(trigger.index())
            .is_some_and(|watch| watch.stands)
    }

    fn end_of(&self, trigger: Trigger) -> Option<End> {
        let found = self.handled.iter().find(|one| one.trigger == trigger);
        found.map(|one| one.end)
    }

    /// Checks the vehicle's reports: determines the active causes and their actions.
    pub(crate) fn watch(&mut self, context: &ContingencyContext, effects: &mut dyn Outlet) {
        if self.unsaved.is_some_and(|at| at <= context.now) {
            self.save(effects);
        }
        if !context.live {
            // Before it is received again much may happen: a landing, another battery. Active causes must be confirmed
            // again.
            self.live_since = None;
            self.trying = None;
            self.watches = Default::default();
            self.alerted = Default::default();
            return;
        }
        self.report_unwatched(context, effects);
        if context.down {
            return self.land(effects);
        }
        if !context.airborne {
            return;
        }
        for trigger in Trigger::ALL {
            self.watch_one(context, trigger, effects);
        }
        self.complete(context, effects);
        self.select(context);
        self.finish(context, effects);
    }

    fn watch_one(
        &mut self,
        context: &ContingencyContext,
        trigger: Trigger,
        effects: &mut dyn Outlet,
    ) {
        let index = trigger.index();
        let (Some(watch), Some(seen)) = (self.watches.get_mut(index), context.seen.get(index))
        else {
            return;
        };
        let before = watch.stands;
        let gone = seen.is_some_and(|seen| watch.look(context.now, seen));
        // Also if it was removed from the configuration.
        let gone = gone || trigger.action(&context.config).is_none();
        if let (false, true, Some(end)) = (before, watch.stands, self.end_of(trigger)) {
            let how = match end {
                End::Shown(action) | End::Completed(action) => {
                    format!("the vehicle was brought to {}", action.name())
                }
                End::Pilot => "it was left to a pilot".to_owned(),
                End::Operator => "a CUCS has sent another command".to_owned(),
            };
            let text = format!(
                "{}: {how} for that; nothing more is commanded",
                trigger.text(&context.config)
            );
            self.raise(trigger, AlertPriority::Warning, text, effects);
        }
        if gone {
            self.forget(trigger, "the cause of the contingency is gone", effects);
        }
    }

    /// The bridge did not run for so long: no cause has lasted by that, the vehicle has not had that time to report its values, nor an
    /// operator to read an alert.
    pub(crate) fn note_stop(&mut self, stopped: Duration) {
        for watch in &mut self.watches {
            watch.note_stop(stopped);
        }
        for alerted in self.alerted.iter_mut().flatten() {
            *alerted += stopped;
        }
        self.live_since = self.live_since.map(|since| since + stopped);
    }

    /// When it is next polled, if it is its turn.
    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        self.trying.map(|trying| trying.next_at)
    }

    /// When it is next polled in any case.
    pub(crate) fn save_timeout(&self) -> Option<Duration> {
        self.unsaved
    }

    /// The vehicle is on the ground: active causes begin again in the next flight.
    fn land(&mut self, effects: &mut dyn Outlet) {
        self.begin_afresh("the vehicle is on the ground", effects);
    }

    fn begin_afresh(&mut self, why: &str, effects: &mut dyn Outlet) {
        self.trying = None;
        self.watches = Default::default();
        self.alerted = Default::default();
        for trigger in Trigger::ALL {
            effects.clear(Cause::Contingency(trigger), why);
        }
        if !self.handled.is_empty() {
            self.handled.clear();
            self.save(effects);
        }
    }

    fn forget(&mut self, trigger: Trigger, why: &str, effects: &mut dyn Outlet) {
        let before = self.handled.len();
        self.handled.retain(|one| one.trigger != trigger);
        if self.handled.len() != before {
            self.save(effects);
        }
        self.trying = self.trying.filter(|trying| trying.trigger != trigger);
        if let Some(alerted) = self.alerted.get_mut(trigger.index()) {
            *alerted = None;
        }
        effects.clear(Cause::Contingency(trigger), why);
    }

    fn set(&mut self, trigger: Trigger, end: End) {
        self.handled.retain(|one| one.trigger != trigger);
        self.handled.push(Handled { trigger, end });
    }

    fn store(&mut self, effects: &mut dyn Outlet) -> Result<(), StoreError> {
        let record = Record {
            handled: self.handled.clone(),
            set: self.set.clone(),
        };
        effects.save(&record)?;
        self.unsaved = None;
        Ok(())
    }

    fn save(&mut self, effects: &mut dyn Outlet) {
        let now = effects.now();
        match self.store(effects) {
            Ok(()) => {
                effects.clear(Cause::ContingencyRecord, "contingencies are stored again");
            }
            Err(fault) => {
                self.unsaved = Some(now + SAVE_AGAIN);
                let text = format!(
                    "the state of a contingency cannot be stored: {fault}; a restart of the VSM would command it again"
                );
                effects.warn(Cause::ContingencyRecord, text);
            }
        }
    }

    /// A contingency whose cause the vehicle does not report has no effect: operators who rely on it must know before the
    /// flight.
    fn report_unwatched(&mut self, context: &ContingencyContext, effects: &mut dyn Outlet) {
        let since = *self.live_since.get_or_insert(context.now);
        let unseen = |one: &Trigger| {
            let seen = context.seen.get(one.index());
            one.action(&context.config).is_some() && seen.is_none_or(Option::is_none)
        };
        let unseen: Vec<&str> = Trigger::ALL
            .into_iter()
            .filter(unseen)
            .map(Trigger::unreported)
            .collect();
        if unseen.is_empty() {
            effects.clear(
                Cause::ContingencyUnwatched,
                "the vehicle reports all values that its contingencies need",
            );
        } else if context.now.saturating_sub(since) >= REPORTED_WITHIN {
            let text = format!("contingencies are not watched: {}", unseen.join(", "));
            effects.warn(Cause::ContingencyUnwatched, text);
        }
    }

    fn raise(
        &mut self,
        trigger: Trigger,
        priority: AlertPriority,
        text: String,
        effects: &mut dyn Outlet,
    ) {
        if let Some(alerted) = self.alerted.get_mut(trigger.index()) {
            alerted.get_or_insert(effects.now());
        }
        let cause = Cause::Contingency(trigger);
        effects.raise(cause, priority, trigger.subsystem(), text);
    }
}

/// The PX4 modes of an action, except for routes.
pub(crate) fn modes(action: Action) -> &'static [Px4Mode] {
    match action {
        Action::Hold => &[Px4Mode::LOITER],
        Action::Land => &[Px4Mode::LAND],
        Action::Rtl | Action::ContingencyA | Action::ContingencyB => &[Px4Mode::RTL],
    }
}

const SAVE_AGAIN: Duration = Duration::from_secs(1);
/// ESTIMATOR_STATUS comes every two seconds, and may be lost.
const REPORTED_WITHIN: Duration = Duration::from_secs(10);
