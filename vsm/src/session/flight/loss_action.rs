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

use std::time::Duration;

use mapping::mode::Px4Mode;
use mavlink_link::store::{Store as _, StoreError};
use serde::{Deserialize, Serialize};
use stanag_msgs::enums::{AlertPriority, SubsystemId};

use crate::config::OnLoss;
use crate::session::alerts::Cause;
use crate::session::contingency::priority::Urgency;
use crate::session::dates::wall_ms;
use crate::session::effects::Effects;
use crate::session::other::Other;
use crate::session::store::vehicle_record;

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

/// What is pending while nobody controls the vehicle, as a restart finds it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
enum Pending {
    LossAction(Action),
    /// A held contingency, by its number: its own record keeps that it is not carried out again.
    Held(u16),
}

#[derive(Debug, Default, Serialize, Deserialize)]
struct Record {
    pending: Option<Pending>,
    /// When it was written, milliseconds since 1970.
    #[serde(default)]
    written_ms: u64,
}

vehicle_record!(Record, "loss-action", Power);

#[derive(Debug, Clone, Copy)]
struct CutOff {
    pending: Pending,
    /// When that began, milliseconds since 1970.
    written_ms: u64,
    /// When the vehicle first showed its mode after the restart.
    since: Option<Duration>,
    /// It is left as it is.
    left: bool,
}

#[derive(Debug, Clone, Copy)]
struct Trying {
    action: Action,
    tries: u32,
    next_at: Duration,
}

/// What is flown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
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
    /// The bridge did not run, and the vehicle has not shown its mode since.
    pub(super) awaits_mode: bool,
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
            written_ms: wall_ms(effects.dli.now.wall),
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
        let vehicle = effects.id;
        let record = effects.disk().load::<Record>(&vehicle)?;
        let record = record.unwrap_or_default();
        self.stored = record.pending;
        self.cut_off = record
            .pending
            .map(|pending| CutOff::of(pending, record.written_ms));
        Ok(())
    }

    /// A restart has interrupted a held contingency of this number.
    pub(super) fn cut_off_held(&mut self, number: u16) {
        self.cut_off
            .get_or_insert(CutOff::of(Pending::Held(number), 0));
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
        let age_ms = wall_ms(effects.dli.now.wall).checked_sub(cut_off.written_ms);
        let recent = age_ms.is_some_and(|age_ms| age_ms <= RECENT_MS);
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
            let follows = format!(
                "; vehicle continues in {}, nothing is commanded",
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

impl CutOff {
    fn of(pending: Pending, written_ms: u64) -> CutOff {
        CutOff {
            pending,
            written_ms,
            since: None,
            left: false,
        }
    }

    fn what(self) -> String {
        let what = match self.pending {
            Pending::LossAction(action) => format!("the loss action ({})", name(action)),
            Pending::Held(number) => format!("held command {number}, a contingency,"),
        };
        format!("{what} was cut off by a restart of the VSM")
    }

    fn raise(self, follows: &str, effects: &mut Effects<'_>) {
        let text = format!(
            "{}, and nobody controls the vehicle: take control{follows}",
            self.what()
        );
        let (priority, comms) = (AlertPriority::Emergency, SubsystemId::Comms);
        effects.raise(Cause::LossAction, priority, comms, text);
    }
}

/// Why the action has ended, for the text of the cleared alert. Without an action (a held contingency) it ends where the vehicle
/// returns or lands.
fn finished(context: &LossContext, action: Option<Action>) -> Option<&'static str> {
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
    let (shown, reason) = match action {
        Some(action) => (action, "the vehicle carries out the loss action"),
        None => (Action::Return, "the vehicle returns or lands"),
    };
    shown
        .is_shown(context.mode, context.carries_contingency, context.completed)
        .then_some(reason)
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
/// How long after a restart the mode of the vehicle may still follow from a command of before.
const SETTLES_WITHIN: Duration = Duration::from_secs(5);
/// How old an action may be whose hold a restart ends by a return.
const RECENT_MS: u64 = 60_000;
/// Time between two attempts or checks.
const RETRY_INTERVAL: Duration = Duration::from_secs(2);

#[cfg(test)]
mod tests {
    use mavlink_link::store::MemoryDisk;

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
            awaits_mode: false,
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

    /// Another process finds the record of an action that was begun.
    fn cut_off(world: &mut World, on_loss: OnLoss) -> LossAction {
        let mut before = begun(world, on_loss, false);
        let mut after = LossAction::default();
        world.act(|_, _, effects| {
            before.store(effects);
            after.restore(effects).expect("the record is read");
            after.report_cut_off(false, effects);
        });
        assert!(!after.is_active());
        after
    }

    /// What is commanded with this shown, a second apart.
    fn commanded(
        world: &mut World,
        machine: &mut LossAction,
        context: LossContext,
        looks: u32,
    ) -> Vec<Action> {
        let looks = 0..looks;
        let look = |_| {
            let now = world.now.mono;
            let action = world.act(|_, _, effects| {
                let context = LossContext { now, ..context };
                machine.watch_cut_off(&context, effects);
                let action = machine.poll(&context, effects);
                machine.store(effects);
                action
            });
            world.advance(Duration::from_secs(1));
            action
        };
        looks.filter_map(look).collect()
    }

    fn standing(world: &World) -> Vec<String> {
        let standing = world.alerts.standing();
        standing.map(|alert| alert.text.clone()).collect()
    }

    #[test]
    fn what_a_restart_has_cut_off_is_reported_and_a_vehicle_that_only_holds_returns() {
        let mut world = World::new();
        let mut machine = cut_off(&mut world, OnLoss::Contingency);
        let holds = LossContext {
            mode: Some(Px4Mode::LOITER),
            ..flying(&world)
        };
        let silent = LossContext {
            live: false,
            ..holds
        };
        assert_eq!(commanded(&mut world, &mut machine, silent, 30), []);
        let texts = standing(&world);
        assert!(
            texts[0].starts_with("the loss action (fly contingency A) was cut off by a restart")
        );
        // The hold of before the restart is shown late.
        let before = LossContext {
            mode: Some(Px4Mode::MISSION),
            ..holds
        };
        assert_eq!(commanded(&mut world, &mut machine, before, 2), []);
        assert_eq!(
            commanded(&mut world, &mut machine, holds, 1),
            [Action::Return]
        );
        assert_eq!(
            standing(&world),
            [
                "the loss action (fly contingency A) was cut off by a restart of the VSM, and the vehicle only holds: \
                 commanding return"
            ]
        );
        let returns = LossContext {
            mode: Some(Px4Mode::RTL),
            ..holds
        };
        assert_eq!(commanded(&mut world, &mut machine, returns, 1), []);
        assert_eq!(standing(&world).len(), 0);
        let mut again = LossAction::default();
        let restored = world.act(|_, _, effects| again.restore(effects));
        restored.expect("the record is read");
        assert!(again.cut_off.is_none(), "it has ended");
    }

    #[test]
    fn what_a_restart_has_cut_off_is_not_flown_in_another_mode_nor_where_a_station_controls() {
        let mut world = World::new();
        for mode in [Px4Mode::MISSION, Px4Mode::POSCTL] {
            let mut machine = cut_off(&mut world, OnLoss::Contingency);
            let elsewhere = LossContext {
                mode: Some(mode),
                ..flying(&world)
            };
            assert_eq!(commanded(&mut world, &mut machine, elsewhere, 7), []);
            assert!(standing(&world)[0].ends_with("nothing is commanded"));
            // Whoever puts it on hold now does not have it taken from them.
            let holds = LossContext {
                mode: Some(Px4Mode::LOITER),
                ..elsewhere
            };
            assert_eq!(commanded(&mut world, &mut machine, holds, 7), []);
            let taken = LossContext {
                controlled: true,
                ..holds
            };
            assert_eq!(commanded(&mut world, &mut machine, taken, 1), []);
            assert_eq!(standing(&world).len(), 0);
        }
        let mut machine = cut_off(&mut world, OnLoss::Contingency);
        let taken = LossContext {
            mode: Some(Px4Mode::LOITER),
            controlled: true,
            ..flying(&world)
        };
        assert_eq!(commanded(&mut world, &mut machine, taken, 7), []);
    }

    #[test]
    fn what_a_restart_has_cut_off_does_not_wait_for_its_return_in_another_mode() {
        let failsafe = Some(Other::Failsafe(Px4Mode::LOITER));
        for (other, on_final, busy) in [
            (failsafe, false, false),
            (None, true, false),
            (None, false, true),
        ] {
            for still_holds in [false, true] {
                let mut world = World::new();
                let mut machine = cut_off(&mut world, OnLoss::Contingency);
                let waits = LossContext {
                    mode: Some(Px4Mode::LOITER),
                    other,
                    on_final,
                    busy,
                    ..flying(&world)
                };
                assert_eq!(commanded(&mut world, &mut machine, waits, 2), []);
                assert!(machine.is_cut_off() && !machine.is_active());
                let mode = if still_holds {
                    Px4Mode::LOITER
                } else {
                    Px4Mode::MISSION
                };
                let free = LossContext {
                    mode: Some(mode),
                    ..flying(&world)
                };
                let actions = commanded(&mut world, &mut machine, free, 1);
                assert_eq!(actions == [Action::Return], still_holds);
                if !still_holds {
                    assert_eq!(commanded(&mut world, &mut machine, free, 7), []);
                    assert!(standing(&world)[0].ends_with("nothing is commanded"));
                }
            }
        }
    }

    /// A contingency goes first, and takes the vehicle out of its hold.
    #[test]
    fn what_a_restart_has_cut_off_is_decided_again_where_it_was_not_its_turn() {
        let mut world = World::new();
        let mut machine = cut_off(&mut world, OnLoss::Contingency);
        let holds = LossContext {
            mode: Some(Px4Mode::LOITER),
            ..flying(&world)
        };
        world.act(|_, _, effects| {
            machine.watch_cut_off(&holds, effects);
            machine.store(effects);
        });
        assert!(machine.is_active() && machine.is_cut_off());
        let before = Some(Pending::LossAction(Action::Contingency));
        assert_eq!(machine.stored, before);
        let flown = LossContext {
            mode: Some(Px4Mode::MISSION),
            ..holds
        };
        assert_eq!(poll(&mut world, &mut machine, flown), None);
        assert!(!machine.is_active() && machine.is_cut_off());
    }

    #[test]
    fn what_a_restart_has_cut_off_stays_reported_where_a_later_loss_flies_nothing() {
        for (on_loss, stays) in [(OnLoss::Continue, true), (OnLoss::Rtl, false)] {
            let mut world = World::new();
            let mut machine = cut_off(&mut world, OnLoss::Contingency);
            machine.begin(on_loss, false, world.now.mono);
            assert_eq!(machine.is_cut_off(), stays);
            let elsewhere = flying(&world);
            commanded(&mut world, &mut machine, elsewhere, 1);
            assert_eq!(standing(&world).len(), usize::from(stays));
        }
    }

    #[test]
    fn a_return_that_a_restart_has_cut_off_is_not_named_as_refused() {
        let mut world = World::new();
        let mut machine = cut_off(&mut world, OnLoss::Rtl);
        let holds = LossContext {
            mode: Some(Px4Mode::LOITER),
            ..flying(&world)
        };
        let actions = commanded(&mut world, &mut machine, holds, 1);
        assert_eq!(actions, [Action::Return]);
        assert!(standing(&world)[0].ends_with("and the vehicle only holds: commanding return"));
        let returns = LossContext {
            mode: Some(Px4Mode::RTL),
            ..holds
        };
        let of_held = finished(&returns, None);
        assert_eq!(of_held, Some("the vehicle returns or lands"));
    }

    /// A bridge that was off for days, or a clock that was set back, finds a hold of somebody else.
    #[test]
    fn what_a_restart_has_cut_off_long_ago_is_only_reported() {
        let minute = Duration::from_secs(60);
        for (later, acts) in [(minute, true), (minute + RETRY_INTERVAL, false)] {
            let mut world = World::new();
            let mut machine = cut_off(&mut world, OnLoss::Contingency);
            world.now.wall += later;
            let holds = LossContext {
                mode: Some(Px4Mode::LOITER),
                ..flying(&world)
            };
            let actions = commanded(&mut world, &mut machine, holds, 1);
            assert_eq!(!actions.is_empty(), acts);
        }
        for back in [false, true] {
            let mut world = World::new();
            let mut machine = cut_off(&mut world, OnLoss::Contingency);
            world.now.wall = if back {
                world.now.wall - Duration::from_secs(10)
            } else {
                world.now.wall + Duration::from_secs(86_400)
            };
            let holds = LossContext {
                mode: Some(Px4Mode::LOITER),
                ..flying(&world)
            };
            assert_eq!(commanded(&mut world, &mut machine, holds, 7), []);
            assert!(standing(&world)[0].ends_with("AUTO.LOITER, nothing is commanded"));
        }
    }

    #[test]
    fn a_held_contingency_that_a_restart_has_cut_off_is_only_reported() {
        let mut world = World::new();
        let mut machine = LossAction::default();
        machine.cut_off_held(3);
        world.act(|_, _, effects| machine.report_cut_off(false, effects));
        let holds = LossContext {
            mode: Some(Px4Mode::LOITER),
            ..flying(&world)
        };
        assert_eq!(commanded(&mut world, &mut machine, holds, 7), []);
        assert!(standing(&world)[0].starts_with("held command 3, a contingency, was cut off"));
        machine.cut_off_held(3);
        world.act(|_, _, effects| machine.report_cut_off(true, effects));
        assert!(machine.cut_off.is_none(), "who controls decides");
    }

    /// A write may take long where the disk fails, and the bridge waits for it.
    #[test]
    fn a_record_that_the_disk_refuses_is_written_again_two_seconds_later() {
        let mut world = World::new();
        let mut machine = begun(&world, OnLoss::Rtl, false);
        let working = std::mem::replace(&mut world.disk, Box::new(MemoryDisk::default()));
        world.fill_disk();
        world.act(|_, _, effects| machine.store(effects));
        let again = machine.save_timeout().expect("it is not stored");
        assert_eq!(again, world.now.mono + RETRY_INTERVAL);
        world.disk = working;
        world.act(|_, _, effects| machine.store(effects));
        assert!(machine.stored.is_none(), "not on every input");
        world.advance(RETRY_INTERVAL);
        world.act(|_, _, effects| machine.store(effects));
        assert_eq!(machine.stored, Some(Pending::LossAction(Action::Return)));
        assert_eq!(machine.save_timeout(), None);
        // It has ended before the disk has refused it twice: there is nothing to write.
        let mut machine = begun(&world, OnLoss::Rtl, false);
        world.fill_disk();
        world.act(|_, _, effects| {
            machine.store(effects);
            machine.end("", effects);
            machine.store(effects);
        });
        assert_eq!(machine.save_timeout(), None);
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

    /// The stop of the bridge is also why the CUCS counts as lost.
    #[test]
    fn the_first_attempt_after_a_stop_of_the_bridge_waits_for_the_mode() {
        for on_loss in [OnLoss::Hold, OnLoss::Contingency, OnLoss::Rtl] {
            let mut world = World::new();
            let mut machine = begun(&world, on_loss, false);
            let stopped = LossContext {
                mode: None,
                awaits_mode: true,
                ..flying(&world)
            };
            assert_eq!(poll(&mut world, &mut machine, stopped), None);
            assert!(machine.is_active());
            world.advance(RETRY_INTERVAL);
            let flown = LossContext {
                other: Some(Other::Pilot(Px4Mode::POSCTL)),
                ..flying(&world)
            };
            assert_eq!(poll(&mut world, &mut machine, flown), None);
            assert!(!machine.is_active());
        }
        // Only a command of the VSM is younger than the report: nobody else had the time.
        let mut world = World::new();
        let mut machine = begun(&world, OnLoss::Rtl, false);
        let commanded = LossContext {
            mode: None,
            ..flying(&world)
        };
        let action = poll(&mut world, &mut machine, commanded);
        assert_eq!(action, Some(Action::Return));
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
