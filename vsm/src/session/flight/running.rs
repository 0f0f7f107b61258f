//! The maneuver in progress: how it begins, supersedes the one before it, and ends.
//!
//! There is one at a time. Its end is seen in what the vehicle shows ([`maneuver`]), and answered to the CUCS that commanded
//! it. Beside it runs only what commands nothing: a look for motors that a 2008 wants and the vehicle has shown already.

use std::mem;
use std::time::Duration;

use mapping::mode::Px4Mode;
use mapping::report::{self, Commanded};
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode};
use stanag_msgs::messages::VehicleOperatingModeCommand;

use super::{Context, Flight, select};
use crate::config::OnLoss;
use crate::session::context::Origin;
use crate::session::effects::{Effects, Request};
use crate::session::maneuver::{Maneuver, Progress};

impl Flight {
    pub(super) fn begin(
        &mut self,
        context: &Context<'_>,
        origin: Option<Origin>,
        maneuver: Maneuver,
        effects: &mut Effects<'_>,
    ) {
        // One that was held until now does not know what stands, and is refused before that. Motors (2008) are no decision of
        // what is flown.
        if origin.is_some_and(|origin| origin.held.is_none() && origin.message_type != 2008) {
            let config = self.contingencies.config(&context.config.contingency);
            self.contingencies.overridden(&config, effects);
        }
        self.supersede(context, origin, effects);
        self.maneuver = Some((origin, maneuver));
    }

    /// Why a 2016 is not carried out while a contingency stands: it is not a new decision, taken by somebody who knows of it. A
    /// station that steers, or repeats what it commands, has not decided anything; nor has who commanded before the alert.
    pub(super) fn is_undecided(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        command: &VehicleOperatingModeCommand,
        just_loaded: bool,
    ) -> Option<&'static str> {
        let now = context.mono();
        let mode = command.select_flight_path_control_mode;
        let mode = mode.filter(|mode| *mode != Mode::NoMode);
        let before = self.mode_commanded;
        let repeats = before.is_some_and(|(before, at)| {
            Some(before) == mode && now.saturating_sub(at) < REPEATED_WITHIN
        });
        let stands = self.contingencies.stands();
        if let Some(mode) = mode.filter(|_| repeats || !stands) {
            self.mode_commanded = Some((mode, now));
        }
        if !stands || origin.held.is_some() {
            return None;
        }
        if just_loaded {
            let came = self.load_commanded.unwrap_or(now);
            return (!self.contingencies.knew_of(came)).then_some(TOO_EARLY);
        }
        if mode.is_none() || origin.continues.is_some() || repeats {
            return Some(NOT_NEW);
        }
        (!self.contingencies.knew_of(now)).then_some(TOO_EARLY)
    }

    /// Whether a command continues the one that is being carried out: it is answered with it, and supersedes nothing.
    pub(super) fn is_continued_by(&self, origin: Option<Origin>) -> bool {
        let running = self.maneuver.as_ref().and_then(|(origin, _)| *origin);
        let both = running.zip(origin.filter(|origin| origin.continues.is_some()));
        both.is_some_and(|(running, later)| running.station == later.station)
    }

    /// A command whose end is that of the maneuver in progress, too. Demands of other values are superseded by it.
    pub(super) fn join(&mut self, origin: Origin, effects: &mut Effects<'_>) {
        if let Some((Some(running), _)) = &mut self.maneuver
            && is_outdated(running, origin)
        {
            let before = mem::replace(running, origin);
            self.drop_outdated(origin, effects);
            return effects.refuse(Some(before), SUPERSEDED);
        }
        self.drop_outdated(origin, effects);
        self.answer_together(origin, effects);
    }

    fn answer_together(&mut self, origin: Origin, effects: &mut Effects<'_>) {
        // A station that repeats its demand ten times a second, and a mode that is entered within six.
        if self.joined.len() == MAX_JOINED {
            effects.acknowledge(&self.joined.remove(0), AckType::Refused);
        }
        self.joined.push(origin);
    }

    /// Refuses demands whose values are not flown any more. A command of the mode (#42) stays: that is entered.
    fn drop_outdated(&mut self, by: Origin, effects: &mut Effects<'_>) {
        let is_old = |one: &mut Origin| is_outdated(one, by);
        for old in self.joined.extract_if(.., is_old).collect::<Vec<_>>() {
            effects.refuse(Some(old), SUPERSEDED);
        }
    }

    /// Ends what runs, for a later command `by` this station.
    pub(super) fn supersede(
        &mut self,
        context: &Context<'_>,
        by: Option<Origin>,
        effects: &mut Effects<'_>,
    ) {
        let why = SUPERSEDED;
        if self.is_continued_by(by)
            && let Some((Some(before), mut running)) = self.maneuver.take()
        {
            running.abandon(context.mono(), context.vehicle, effects.vehicle);
            self.give_up_streams(context);
            self.answer_together(before, effects);
            if let Some(by) = by {
                self.drop_outdated(by, effects);
            }
        }
        self.end_running(context, why, |_| true, effects);
        // A command that waits for its route to be uploaded has not begun, and must not begin later.
        if context.mission.waiting_command().is_some() {
            effects.request(Request::DropWaitingCommand {
                why: why.to_owned(),
                without_right: false,
            });
        }
    }

    /// Control has passed to another CUCS, or to nobody: what its sender could not command now is not continued.
    pub(super) fn control_changed(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let controller = context.controller;
        // Before what its sender began is ended: the vehicle may enter the mode all the same.
        let steered = self.steers(&context.vehicle.telemetry);
        let why = match controller {
            Some(id) => format!("{id} controls the vehicle now"),
            None => "its sender no longer controls the vehicle, nobody does".to_owned(),
        };
        let without_right = |origin: Option<Origin>| {
            origin.is_some_and(|origin| {
                context.asker(origin.station).map(|asker| asker.id) != controller
            })
        };
        self.end_running(context, &why, without_right, effects);
        if context.mission.waiting_command().is_some() {
            effects.request(Request::DropWaitingCommand {
                why,
                without_right: true,
            });
        }
        self.sticks.forget();
        match controller {
            None => self.contingencies.released(effects),
            Some(_) => {
                let config = self.contingencies.config(&context.config.contingency);
                self.contingencies.taken_over(&config, effects);
            }
        }
        if controller.is_none() && steered && !context.termination.holds {
            // Steered by nobody it would fly straight on for ever.
            let other = self.other(context.vehicle, context.mono());
            if context.vehicle.telemetry.airborne() && other.is_none() {
                self.operate(context, None, &select(Mode::Loiter), false, effects);
            }
            // Tried again, as after a loss, where the vehicle is silent at the moment or refuses it.
            if !self.loss_action.is_active() {
                let on_loss = OnLoss::Continue;
                self.loss_action.begin(on_loss, steered, context.mono());
            }
        }
    }

    pub(super) fn end_running(
        &mut self,
        context: &Context<'_>,
        why: &str,
        ends: impl Fn(Option<Origin>) -> bool,
        effects: &mut Effects<'_>,
    ) {
        if let Some((origin, mut running)) = self.maneuver.take_if(|(origin, _)| ends(*origin)) {
            running.abandon(context.mono(), context.vehicle, effects.vehicle);
            self.give_up_streams(context);
            self.forget_commanded(context);
            self.refuse(origin, why, effects);
        }
        if let Some((origin, _)) = self.look.take_if(|(origin, _)| ends(Some(*origin))) {
            effects.refuse(Some(origin), why);
        }
    }

    /// Ends streams whose mode is given up; within their mode they must not starve.
    fn give_up_streams(&mut self, context: &Context<'_>) {
        // Not so long as the vehicle might still enter the mode: sticks that move take it from what superseded them
        // (COM_RC_OVERRIDE).
        if context.vehicle.telemetry.mode != Some(Px4Mode::POSCTL) {
            self.sticks.release();
        }
        self.steering.give_up(context.mono());
    }

    pub(super) fn advance(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        self.advance_look(context, effects);
        let Some((origin, maneuver)) = &mut self.maneuver else {
            return;
        };
        let origin = *origin;
        match maneuver.advance(context.mono(), context.vehicle, effects.vehicle) {
            Progress::Going => {}
            Progress::Done => {
                // What it commanded goes with the mode that the vehicle shows now.
                let telemetry = &context.vehicle.telemetry;
                let uploaded = context.mission.uploaded;
                self.commanded = maneuver.commanded;
                self.last.keep(&maneuver.commanded);
                self.commanded_in = telemetry.mode;
                self.watched.entered = telemetry.mode;
                // In mode 11 a speed of the route takes the place of one commanded on an earlier leg.
                self.commanded.speed_leg =
                    uploaded.and_then(|uploaded| report::to_index(telemetry, &uploaded.compiled));
                self.maneuver = None;
                for origin in origin.into_iter().chain(std::mem::take(&mut self.joined)) {
                    effects.acknowledge(&origin, AckType::CarriedOut);
                }
            }
            Progress::Refused(why) => self.fail(context, origin, why, effects),
        }
    }

    /// Looks for what the vehicle has shown already: it is answered by a report that is newer than the last command.
    pub(super) fn look_for(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        seen: Maneuver,
        effects: &mut Effects<'_>,
    ) {
        if let Some((before, _)) = self.look.replace((origin, seen)) {
            effects.refuse(Some(before), SUPERSEDED);
        }
        self.advance_look(context, effects);
    }

    fn advance_look(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let Some((origin, seen)) = &mut self.look else {
            return;
        };
        let origin = *origin;
        match seen.advance(context.mono(), context.vehicle, effects.vehicle) {
            Progress::Going => return,
            Progress::Done => effects.acknowledge(&origin, AckType::CarriedOut),
            Progress::Refused(why) => effects.refuse(Some(origin), why),
        }
        self.look = None;
    }

    /// The vehicle answered that it does not do what the maneuver commands: a mode that is refused is not entered.
    pub(super) fn refused(
        &mut self,
        context: &Context<'_>,
        origin: Option<Origin>,
        why: String,
        effects: &mut Effects<'_>,
    ) {
        if context.vehicle.telemetry.mode != Some(Px4Mode::OFFBOARD) {
            self.steering.release();
        }
        self.fail(context, origin, why, effects);
    }

    pub(super) fn fail(
        &mut self,
        context: &Context<'_>,
        origin: Option<Origin>,
        why: String,
        effects: &mut Effects<'_>,
    ) {
        if let Some((_, mut maneuver)) = self.maneuver.take() {
            maneuver.abandon(context.mono(), context.vehicle, effects.vehicle);
        }
        self.give_up_streams(context);
        self.forget_commanded(context);
        self.refuse(origin, why, effects);
    }

    fn refuse(
        &mut self,
        origin: Option<Origin>,
        why: impl Into<String>,
        effects: &mut Effects<'_>,
    ) {
        effects.refuse(origin, why);
        // With the same reason, which is stated once.
        for joined in std::mem::take(&mut self.joined) {
            effects.acknowledge(&joined, AckType::Refused);
        }
    }

    /// Forgets what was commanded in another mode: PX4 forgets speeds, places and altitudes when its mode changes; so
    /// does this VSM, whoever has changed it. What a maneuver leads to is known at its end.
    pub(super) fn forget_commanded(&mut self, context: &Context<'_>) {
        let mode = context.vehicle.telemetry.mode;
        if self.maneuver.is_some() || self.commanded_in == mode {
            return;
        }
        // It hovers, or loiters, where it has taken off to.
        let taken_off = [Some(Px4Mode::TAKEOFF), Some(Px4Mode::VTOL_TAKEOFF)]
            .contains(&self.commanded_in)
            && mode == Some(Px4Mode::LOITER);
        if !taken_off {
            self.commanded = Commanded::default();
        }
        self.commanded_in = mode;
    }
}

/// Whether a demand (#43) commands other values than a later one: what it commanded is not carried out.
fn is_outdated(demand: &Origin, later: Origin) -> bool {
    let both = demand.continues.zip(later.continues);
    both.is_some_and(|(before, after)| before != after)
}

/// Commands that are answered with one maneuver at most.
const MAX_JOINED: usize = 64;
const TOO_EARLY: &str =
    "a contingency is commanded since less than 3 s: command again, in knowledge of its alert";
const NOT_NEW: &str = "a contingency is commanded, and this only continues or repeats an earlier command: command another mode, \
                       or pause for 5 s";
/// A command of the same mode so soon after the last one is one of a stream.
const REPEATED_WITHIN: Duration = Duration::from_secs(5);
const SUPERSEDED: &str = "superseded by a later command";
