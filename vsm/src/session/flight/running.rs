//! The maneuver in progress: how it begins, supersedes an earlier one, and ends.
//!
//! There is one at a time. It ends when the vehicle reports the outcome ([`maneuver`]), which is answered to the commanding
//! CUCS. Only a wait that commands nothing can run beside it: for the confirmation of a 2008 whose state the vehicle already
//! has.

use std::{mem, slice};

use mapping::mode::Px4Mode;
use mapping::report::{self, Commanded, CommandedDirection};
use stanag_msgs::enums::{AckType, AlertPriority, FlightPathControlMode as Mode, SubsystemId};
use stanag_msgs::messages::VehicleOperatingModeCommand;

use super::repeated::NOT_NEW;
use super::situation::names_mode;
use super::sticks::lost_within;
use super::streams::{advise_centred, flies_failsafe};
use super::unexplained::Unexplained;
use super::wings::{BreakOff, Shown};
use super::{Context, Flight, curve_stream, select};
use crate::config::OnLoss;
use crate::session::context::{Continues, Origin};
use crate::session::effects::{Effects, Request};
use crate::session::maneuver::{self, Maneuver, Progress, Refusal, Step};
use crate::session::other::Other;

impl Flight {
    pub(super) fn begin(
        &mut self,
        context: &Context<'_>,
        origin: Option<Origin>,
        maneuver: Maneuver,
        effects: &mut Effects<'_>,
    ) {
        // A held command was sent without knowledge of the contingency and is refused earlier. Motors (2008) do not decide
        // what is flown.
        if origin.is_some_and(|origin| origin.held.is_none() && origin.message_type != 2008) {
            let config = self.contingencies.config(&context.config.contingency);
            self.contingencies.overridden(&config, effects);
        }
        let maneuver = self.ending_sticks(context, maneuver);
        // Whatever has commanded it: the one place that every maneuver passes. What was commanded before may still take effect.
        let breaks_off = BreakOff::by(&maneuver, &context.vehicle.telemetry, &context.mission);
        let before = self.breaks_off.take().map(BreakOff::superseded);
        self.breaks_off = match (breaks_off, before) {
            (Some(later), Some(before)) => Some(later.after(before)),
            (one, other) => one.or(other),
        };
        self.stream_curve(context, curve_stream::Input::Superseded, effects);
        self.supersede(context, origin, effects);
        self.run(context, origin, maneuver, effects);
    }

    /// The maneuver, as it ends a flight by sticks where the vehicle is in one, or has been and was commanded nothing since.
    fn ending_sticks(&self, context: &Context<'_>, maneuver: Maneuver) -> Maneuver {
        if self.sticks.are_expected() && !maneuver.enters(Px4Mode::POSCTL) {
            maneuver.ending_sticks(lost_within(context.parameters.values))
        } else {
            maneuver
        }
    }

    /// From here on this is the maneuver in progress.
    pub(super) fn run(
        &mut self,
        context: &Context<'_>,
        origin: Option<Origin>,
        maneuver: Maneuver,
        effects: &mut Effects<'_>,
    ) {
        // What the vehicle says from now on may be about this one.
        if let Some(before) = self.unexplained.take() {
            before.answer(context.vehicle, effects);
        }
        self.maneuver = Some((origin, maneuver));
    }

    /// Why a 2016 is not carried out while a contingency is active: it is not a new decision by an operator who knows of the
    /// contingency. A stream of steering commands, a repeated command, or a command sent before the alert is no such
    /// decision.
    pub(super) fn is_undecided(
        &self,
        context: &Context<'_>,
        origin: Origin,
        command: &VehicleOperatingModeCommand,
        just_loaded: bool,
        repeats: bool,
    ) -> Option<String> {
        if !self.contingencies.stands() || origin.held.is_some() {
            return None;
        }
        let now = context.mono();
        let is_demand = matches!(origin.continues, Some(Continues::Demand(_)));
        let came = match just_loaded {
            true => self.load_commanded.unwrap_or(now),
            false if !names_mode(command) || is_demand || repeats => {
                return Some(format!("a contingency is commanded, and {NOT_NEW}"));
            }
            false => now,
        };
        (!self.contingencies.knew_of(came)).then(|| TOO_EARLY.to_owned())
    }

    /// Whether a command continues the one in progress: it is answered together with it and supersedes nothing.
    pub(super) fn is_continued_by(&self, origin: Option<Origin>) -> bool {
        let running = self.maneuver.as_ref().and_then(|(origin, _)| *origin);
        running.zip(origin).is_some_and(|(running, later)| {
            let is_demand = |one: Origin| matches!(one.continues, Some(Continues::Demand(_)));
            let is_one_command = match later.continues {
                Some(Continues::Demand(_)) => true,
                // What it has of the demand is flown in its mode.
                Some(Continues::ModeOfDemand) => is_demand(running),
                None => false,
            };
            is_one_command && running.station == later.station
        })
    }

    /// Adds a command that ends together with the maneuver in progress. It supersedes demands with other values.
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
        // Enough for a station that repeats its demand ten times a second while a mode takes six seconds to enter.
        if self.joined.len() == MAX_JOINED {
            effects.acknowledge(&self.joined.remove(0), AckType::Refused);
        }
        self.joined.push(origin);
    }

    /// Refuses demands whose values are no longer flown. A command of the mode (#42) stays, since the mode is entered.
    fn drop_outdated(&mut self, by: Origin, effects: &mut Effects<'_>) {
        let is_old = |one: &mut Origin| is_outdated(one, by);
        for old in self.joined.extract_if(.., is_old).collect::<Vec<_>>() {
            effects.refuse(Some(old), SUPERSEDED);
        }
    }

    /// Ends the maneuver in progress because of a later command `by` this station.
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
        // A command that waits for the upload of its route has not begun, and must not begin later.
        if context.mission.waiting_command().is_some() {
            effects.request(Request::DropWaitingCommand {
                why: why.to_owned(),
                without_right: false,
            });
        }
    }

    /// Control has passed to another CUCS or to nobody: a maneuver that its sender could no longer command is ended.
    pub(super) fn control_changed(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let controller = context.controller;
        // Before ending the sender's maneuver: the vehicle may still enter the mode.
        let steered = self.steers(&context.vehicle.telemetry);
        let why = match controller {
            Some(id) => format!("{id} controls the vehicle now"),
            None => "its sender no longer controls the vehicle, nobody does".to_owned(),
        };
        let without_right =
            |origin: Option<Origin>| origin.is_some_and(|origin| !context.keeps_right(origin));
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
            // Without steering it would fly straight on forever.
            let other = self.other(context.vehicle, context.mono());
            // A pilot may have taken it while the bridge did not run: what is retried below waits for its mode.
            let known = !context.vehicle.awaits_mode();
            if context.vehicle.telemetry.airborne() && other.is_none() && known {
                self.operate(context, None, &select(Mode::Loiter), false, effects);
            }
            // Retried, as after a loss, if the vehicle is silent at the moment or refuses it.
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
            self.repeated.ended();
            self.give_up_streams(context);
            self.forget_commanded(context);
            if !running.stays() {
                self.refuse(context, origin, why.to_owned().into(), effects);
            }
        }
        if let Some((origin, _)) = self.look.take_if(|(origin, _)| ends(Some(*origin))) {
            effects.refuse(Some(origin), why);
        }
    }

    /// Ends streams whose mode is left; within their mode they must not be interrupted. Returns the failsafe of PX4 for which centred
    /// sticks follow those of a mode 2 that was not entered.
    fn give_up_streams(&mut self, context: &Context<'_>) -> Option<Px4Mode> {
        self.steering.give_up(context.mono());
        // Sticks end even if the vehicle might still enter the mode: moving sticks would override the new command
        // (MAN_OVERRIDE_SPD, before v1.18 COM_RC_OVERRIDE). Centred ones do not.
        if context.vehicle.telemetry.mode == Some(Px4Mode::POSCTL) {
            return None;
        }
        let failsafe = flies_failsafe(context.vehicle);
        let centred = self.sticks.give_up(failsafe.is_some());
        failsafe.filter(|_| centred)
    }

    /// Warns of a landing that was broken off, once the vehicle reports it: PX4 may refuse what was commanded.
    fn report_break_off(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let Some(breaks_off) = &self.breaks_off else {
            return;
        };
        let text = match breaks_off.shown_by(context.vehicle, &context.mission) {
            Shown::NotYet => return,
            Shown::Otherwise => None,
            Shown::BrokenOff(text) => Some(text),
        };
        self.breaks_off = None;
        if let Some(text) = text {
            effects.notify(AlertPriority::Warning, SubsystemId::VsmStatus, text);
        }
    }

    pub(super) fn advance(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        self.advance_look(context, effects);
        self.report_break_off(context, effects);
        let Some((origin, maneuver)) = &mut self.maneuver else {
            return;
        };
        let origin = *origin;
        let enters = maneuver.enters_a_mode();
        let progress = maneuver.advance(context.mono(), context.vehicle, effects.vehicle);
        if enters && !maneuver.enters_a_mode() {
            self.steering.end_aside();
        }
        match progress {
            Progress::Going => {}
            Progress::Done => {
                // Its commanded values belong to the mode that the vehicle reports now.
                let telemetry = &context.vehicle.telemetry;
                let uploaded = context.mission.uploaded;
                self.commanded = maneuver.commanded;
                self.last.keep(&maneuver.commanded);
                self.commanded_in = telemetry.mode;
                self.watched.entered = telemetry.mode;
                // A landing or a return only outlasts the failsafe for lost sticks, which the next mode would meet.
                let outlasts = [Some(Px4Mode::LAND), Some(Px4Mode::RTL)].contains(&telemetry.mode);
                if maneuver.ends_sticks() {
                    self.sticks.end_aside();
                    if !outlasts {
                        self.sticks.are_ended();
                    }
                }
                // In mode 11 a speed of the route replaces one commanded on an earlier leg.
                self.commanded.speed_leg =
                    uploaded.and_then(|uploaded| report::to_index(telemetry, &uploaded.compiled));
                self.maneuver = None;
                self.repeated.carried_out(telemetry.mode);
                for origin in origin.into_iter().chain(mem::take(&mut self.joined)) {
                    effects.acknowledge(&origin, AckType::CarriedOut);
                }
            }
            Progress::Refused(why) => self.fail(context, origin, why, effects),
        }
    }

    /// Waits for a state that the vehicle already reports, confirmed by a report newer than the last command.
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
            Progress::Refused(why) => effects.refuse(Some(origin), why.text(context.vehicle)),
        }
        self.look = None;
    }

    pub(super) fn fail(
        &mut self,
        context: &Context<'_>,
        origin: Option<Origin>,
        why: Refusal,
        effects: &mut Effects<'_>,
    ) {
        // An answer proves that the mode was not entered, so its set points can end at once. Without an answer the vehicle may
        // still enter it.
        if why.is_by_vehicle() {
            if context.vehicle.telemetry.mode != Some(Px4Mode::OFFBOARD) {
                self.steering.refused();
            }
            self.breaks_off = self.breaks_off.take().and_then(BreakOff::refused);
        }
        if let Some((_, mut maneuver)) = self.maneuver.take() {
            maneuver.abandon(context.mono(), context.vehicle, effects.vehicle);
        }
        self.repeated.ended();
        if let Some(failsafe) = self.give_up_streams(context) {
            advise_centred(failsafe, effects);
        }
        self.forget_commanded(context);
        self.refuse(context, origin, why, effects);
        // Not by `run`: what the vehicle says is about what has failed.
        if origin.is_some() {
            self.maneuver = self.staying(context).map(|staying| (None, staying));
        }
    }

    /// What keeps the vehicle in its mode where it was sent sticks for a mode 2 that it did not enter: it would leave that for their loss.
    fn staying(&self, context: &Context<'_>) -> Option<Maneuver> {
        let telemetry = &context.vehicle.telemetry;
        let within = lost_within(context.parameters.values);
        let misses = self.sticks.will_be_missed(context.mono(), within);
        if !misses || !context.vehicle.may_fly() || context.vehicle.awaits_mode() {
            return None;
        }
        if matches!(Other::of(telemetry), Some(Other::Failsafe(_))) {
            return None;
        }
        let mode = telemetry.mode?;
        let mut commanded = self.commanded;
        let steps = if mode == Px4Mode::ORBIT {
            let circle = telemetry.orbit?;
            let centre = (circle.centre.latitude, circle.centre.longitude);
            let altitude = commanded.altitude_amsl_m;
            let speed = commanded.speed_m_s;
            maneuver::orbit(centre, altitude, circle.radius_m, speed, true, None)
        } else {
            let mode = STAYED_IN.iter().find(|one| **one == mode)?;
            if *mode == Px4Mode::MISSION {
                // PX4 forgets a speed as it leaves the route.
                commanded = Commanded::default();
            }
            let mut steps: Vec<Step> = maneuver::enter(slice::from_ref(mode)).into();
            // It enters the mode along the course that it has by then.
            if *mode == Px4Mode::COURSE
                && let Some(CommandedDirection::Steady { heading, course }) = commanded.direction
                && let Some(course) = course.or(heading)
            {
                steps.extend(maneuver::course(course.radians()));
            }
            steps
        };
        Some(Maneuver::new(steps, commanded).staying(within))
    }

    /// Answers the commands of the maneuver, or lets them wait for the vehicle's reason.
    fn refuse(
        &mut self,
        context: &Context<'_>,
        origin: Option<Origin>,
        refusal: Refusal,
        effects: &mut Effects<'_>,
    ) {
        let unexplained = Unexplained {
            origin,
            joined: mem::take(&mut self.joined),
            refusal,
        };
        // One waits at most: what follows so soon is not to pile up.
        if let Some(before) = self.unexplained.replace(unexplained) {
            before.answer(context.vehicle, effects);
        }
        self.explain(context, effects);
    }

    /// Answers a refused maneuver once it is explained.
    pub(super) fn explain(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let explained =
            |one: &mut Unexplained| !one.refusal.awaits_reason(context.mono(), context.vehicle);
        if let Some(one) = self.unexplained.take_if(explained) {
            one.answer(context.vehicle, effects);
        }
    }

    /// Forgets values commanded in another mode. PX4 forgets speeds, positions and altitudes when its mode changes, and so
    /// does this VSM, whatever caused the change. The values of a maneuver are recorded at its end.
    pub(super) fn forget_commanded(&mut self, context: &Context<'_>) {
        let mode = context.vehicle.telemetry.mode;
        if self.maneuver.is_some() || self.commanded_in == mode {
            return;
        }
        // It hovers or loiters at the end of its take-off.
        let taken_off = [Some(Px4Mode::TAKEOFF), Some(Px4Mode::VTOL_TAKEOFF)]
            .contains(&self.commanded_in)
            && mode == Some(Px4Mode::LOITER);
        if !taken_off {
            self.commanded = Commanded::default();
        }
        self.commanded_in = mode;
    }
}

/// Whether a demand (#43) differs from a later one, so that it is not carried out.
fn is_outdated(demand: &Origin, later: Origin) -> bool {
    match (demand.continues, later.continues) {
        (Some(Continues::Demand(before)), Some(Continues::Demand(after))) => before != after,
        _ => false,
    }
}

/// The modes that a vehicle is sent back to by their number alone, not a take-off, whose climb is commanded with it.
static STAYED_IN: [Px4Mode; 6] = [
    Px4Mode::LOITER,
    Px4Mode::MISSION,
    Px4Mode::OFFBOARD,
    Px4Mode::COURSE,
    Px4Mode::LAND,
    Px4Mode::RTL,
];
/// Maximum number of commands that are answered with one maneuver.
const MAX_JOINED: usize = 64;
const TOO_EARLY: &str =
    "a contingency is commanded since less than 3 s: command again, in knowledge of its alert";
const SUPERSEDED: &str = "superseded by a later command";
