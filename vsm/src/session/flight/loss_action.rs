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
//! What is being tried is on disk. A restart does not begin it again: a CUCS, a pilot or a failsafe may have the vehicle since.
//! An emergency reports it until somebody decides, and only a vehicle that still holds, as it is put on hold for the upload of
//! its route, is commanded what follows where the action is refused: AUTO.RTL.
//!
//! ```text
//! idle --begin--> trying(action, n) --shown / on the ground / controlled / a pilot's--> idle
//!                     |  n = MAX_TRIES
//!                     +----------------> trying(Return, 1)
//! ```
//!
//! `action`: what is flown, and when that is done; `cut_off`: what a restart has cut off.

mod action;
mod cut_off;

use std::time::Duration;

use mapping::mode::Px4Mode;
use mavlink_link::store::{Record as _, Store as _, StoreError};
use stanag_msgs::enums::{AlertPriority, SubsystemId};

pub(super) use self::action::{Action, LossContext};
use self::action::{finished, name};
use self::cut_off::{CutOff, Pending, Record};
use crate::config::OnLoss;
use crate::session::alerts::Cause;
use crate::session::contingency::priority::Urgency;
use crate::session::effects::Effects;
use crate::session::other::Other;

/// The machine.
#[derive(Debug, Default)]
pub(super) struct LossAction {
    trying: Option<Trying>,
    /// What a restart has cut off, until somebody decides. Beside `trying` until its return is commanded.
    cut_off: Option<CutOff>,
    /// What the disk has of these.
    stored: Option<Pending>,
    /// When to write it again: the disk has refused it, which is reported once.
    unsaved: Option<Duration>,
}

#[derive(Debug, Clone, Copy)]
struct Trying {
    action: Action,
    tries: u32,
    next_at: Duration,
}

impl LossAction {
    /// Whether an action is being flown, or tried.
    pub(super) fn is_active(&self) -> bool {
        self.trying.is_some()
    }

    /// Whether it is to be decided on what a restart has cut off.
    pub(super) fn is_cut_off(&self) -> bool {
        self.cut_off.is_some()
    }

    /// The urgency of the action being tried.
    pub(super) fn urgency(&self) -> Option<Urgency> {
        self.trying.map(|trying| trying.action.urgency())
    }

    /// Another action of at least the same urgency is flown.
    pub(super) fn end(&mut self, why: &str, effects: &mut Effects<'_>) {
        (self.trying, self.cut_off) = (None, None);
        effects.clear(Cause::LossAction, why);
    }

    /// The controlling CUCS was lost; `steered`: it was steering by set points.
    pub(super) fn begin(&mut self, on_loss: OnLoss, steered: bool, now: Duration) {
        self.trying = Action::of(on_loss, steered).map(|action| Trying {
            action,
            tries: 0,
            next_at: now,
        });
        // Where nothing is flown instead, it stays reported.
        self.cut_off = self.cut_off.filter(|_| self.trying.is_none());
    }

    /// The action to command now, if one is due.
    pub(super) fn poll(
        &mut self,
        context: &LossContext,
        effects: &mut Effects<'_>,
    ) -> Option<Action> {
        let before = self.trying?;
        if self.cut_off.is_some() && context.mode != Some(Px4Mode::LOITER) {
            // A contingency went first, and the vehicle no longer holds: it is decided again.
            self.trying = None;
            return None;
        }
        // Checked before the next attempt is due, so that the alert is cleared as soon as the vehicle reports the action.
        if let Some(reason) = finished(context, Some(before.action)) {
            self.end(reason, effects);
            return None;
        }
        let other = context.other.filter(|_| context.live);
        if let Some(other @ Other::Pilot(_)) = other {
            self.end("a pilot has the vehicle", effects);
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
        // A pilot may have taken it since the last attempt, or while the bridge did not run, which only a later report shows.
        let unseen = context.mode.is_none() && (before.tries > 0 || context.awaits_mode);
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
        let cut_off = self.cut_off.take();
        if before.tries == 0 && cut_off.is_none() {
            effects.clear(Cause::LossAction, "the loss action is commanded");
        } else {
            let text = if let Some(cut_off) = cut_off {
                format!(
                    "{}, and the vehicle only holds: commanding {}",
                    cut_off.what(),
                    name(action)
                )
            } else if before.action == action {
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

    /// Stores what is pending. An action is flown also where the disk refuses that: only a restart would not report it.
    pub(super) fn store(&mut self, effects: &mut Effects<'_>) {
        let tried = self.trying.map(|trying| Pending::LossAction(trying.action));
        // What was cut off keeps its age until its return is commanded.
        let pending = self.cut_off.map(|cut_off| cut_off.pending).or(tried);
        if pending == self.stored {
            self.unsaved = None;
            return;
        }
        let (vehicle, now) = (effects.id, effects.dli.now.mono);
        // The write is synchronous, and every input ends here.
        if self.unsaved.is_some_and(|again| now < again) {
            return;
        }
        let record = Record {
            pending,
            written: effects.dli.uptime(),
        };
        match effects.disk().save(&vehicle, &record) {
            Ok(()) => (self.stored, self.unsaved) = (pending, None),
            Err(fault) => {
                if self.unsaved.replace(now + RETRY_INTERVAL).is_some() {
                    return;
                }
                let text = format!(
                    "the state of the loss action cannot be stored: {fault}; a restart of the VSM would report it wrongly"
                );
                effects.notify(AlertPriority::Warning, SubsystemId::VsmStatus, text);
            }
        }
    }

    /// Restores the record after a restart.
    ///
    /// # Errors
    /// A record exists and cannot be read.
    pub(super) fn restore(&mut self, effects: &mut Effects<'_>) -> Result<(), StoreError> {
        let (vehicle, now) = (effects.id, effects.dli.uptime());
        let record = effects.disk().load::<Record>(&vehicle)?;
        let record = record.unwrap_or_default();
        let of_this_boot = now.zip(record.written);
        let of_this_boot = of_this_boot.filter(|(now, written)| written.age(*now).is_some());
        let written = match of_this_boot {
            Some((_, written)) => Some(written),
            // The node of a fleet that takes over knows how old it is at most, if it stood by when this began.
            None => {
                let within = effects.disk().written_within(&Record::name(&vehicle));
                now.zip(within).map(|(now, within)| now.before(within))
            }
        };
        self.stored = record.pending;
        self.cut_off = record.pending.map(|pending| CutOff::of(pending, written));
        Ok(())
    }

    /// A restart has interrupted a held contingency of this number.
    pub(super) fn cut_off_held(&mut self, number: u16) {
        self.cut_off
            .get_or_insert(CutOff::of(Pending::Held(number), None));
    }

    /// Reports what a restart has cut off; `controlled`: a CUCS has control, and decides.
    pub(super) fn report_cut_off(&mut self, controlled: bool, effects: &mut Effects<'_>) {
        self.cut_off = self.cut_off.filter(|_| !controlled);
        if let Some(cut_off) = self.cut_off {
            cut_off.raise("", effects);
        }
    }

    /// Decides on what a restart has cut off.
    pub(super) fn watch_cut_off(&mut self, context: &LossContext, effects: &mut Effects<'_>) {
        let Some(mut cut_off) = self.cut_off else {
            return;
        };
        // What was taken up and could not be commanded is decided again.
        self.trying = None;
        let action = match cut_off.pending {
            Pending::LossAction(action) => Some(action),
            Pending::Held(_) => None,
        };
        if let Some(reason) = finished(context, action) {
            return self.end(reason, effects);
        }
        let (true, Some(mode)) = (context.live, context.mode) else {
            return;
        };
        // A hold that was commanded just before the restart is shown a little later.
        let since = *cut_off.since.get_or_insert(context.now);
        let settles = context.now < since + SETTLES_WITHIN;
        // A bridge that was off for long, or was given the record of another, finds a hold that somebody else commanded.
        let age = effects.dli.uptime().zip(cut_off.written);
        let age = age.and_then(|(now, written)| written.age(now));
        let recent = age.is_some_and(|age| age <= RECENT);
        // What would make it wait may lead to another mode: then the vehicle no longer only holds.
        let free = context.other.is_none() && !context.on_final && !context.busy;
        let holds = mode == Px4Mode::LOITER && action.is_some();
        if settles && recent && free && holds {
            self.trying = Some(Trying {
                action: Action::Return,
                tries: 0,
                next_at: context.now,
            });
        }
        if !settles && !cut_off.left {
            cut_off.left = true;
            let why = match age {
                _ if !holds => "",
                None => {
                    ": how old the action is cannot be known after a restart of the computer, or at another one"
                }
                Some(age) if age > RECENT + SETTLES_WITHIN => ": it was begun over 60 s ago",
                Some(_) => "",
            };
            let follows = format!(
                "; vehicle continues in {}, nothing is commanded{why}",
                mode.name()
            );
            cut_off.raise(&follows, effects);
        }
        self.cut_off = Some(cut_off);
    }

    /// When a record that the disk has refused is written again.
    pub(super) fn save_timeout(&self) -> Option<Duration> {
        self.unsaved
    }

    /// When it must be polled next.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        self.trying.map(|trying| trying.next_at)
    }
}

/// Attempts of an action before the next one.
const MAX_TRIES: u32 = 2;
/// How long after a restart the mode of the vehicle may still follow from a command of before.
const SETTLES_WITHIN: Duration = Duration::from_secs(5);
/// How old an action may be whose hold a restart ends by a return.
const RECENT: Duration = Duration::from_secs(60);
/// Time between two attempts or checks.
const RETRY_INTERVAL: Duration = Duration::from_secs(2);

#[cfg(test)]
mod tests;
