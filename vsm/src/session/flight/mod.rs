//! Flying one vehicle: commands of a CUCS, and what the VSM flies without them.
//!
//! A 2016 becomes a [task](situation::Task), usually a [maneuver](super::maneuver): a sequence of steps, each confirmed by
//! reports of the vehicle. One maneuver is in progress at a time; a later command supersedes it. Parts:
//!
//! - `mode_command`: turns a 2016 into steps for PX4, or gives the reason why PX4 cannot do it; pure. `wings`: differences
//!   for fixed wings. `situation`: the input of that decision
//! - `running`: the maneuver in progress; `repeated`: a command that its station sends again and again; `taken`: who has
//!   taken the vehicle out of its mode meanwhile
//! - `sticks` (2010), `steering` (mode 15): streams that must not starve while their mode is flown
//! - `curve_stream`: curves of a mission flown by set points, where that is configured; `streamed`: what it reads and commands
//! - `settings` (2017, altimeter), `engine` (2008)
//! - [`contingency`](crate::session::contingency): actions for faults of the vehicle, and their priority, also over the loss
//!   action; `provision`: contingencies set by 50023
//! - `loss_action`: what is flown after the loss of the controlling CUCS; `by_itself`: flies these actions when neither a
//!   pilot nor a failsafe has the vehicle

mod by_itself;
mod curve_stream;
mod engine;
mod loss_action;
mod mode_command;
mod provision;
mod repeated;
mod running;
mod settings;
mod situation;
mod steering;
mod sticks;
mod streamed;
mod taken;
#[cfg(test)]
mod tests;
mod unexplained;
mod watched;
mod wings;

use std::time::Duration;

use mapping::altitude::{Agl, Altimeter};
use mapping::configuration::changes;
use mapping::mode::Px4Mode;
use mapping::report::Commanded;
use mapping::telemetry::{Health, Telemetry};
use mavlink_link::dialect::MavMessage;
use mavlink_link::service::command;
use mavlink_link::service::mission;
use mavlink_link::store::StoreError;
use stanag_msgs::Message;
use stanag_msgs::enums::{
    AckType, AltitudeType, CommandedEngineState, FlightPathControlMode as Mode, RouteType,
};
use stanag_msgs::messages::{
    EngineCommand, LoiterConfiguration, UaStickCommand, VehicleOperatingModeCommand,
};

use self::curve_stream::CurveStream;
use self::loss_action::LossAction;
use self::repeated::{NOT_NEW, Repeated, Repetition};
use self::situation::{Situation, Task, UnderWay};
use self::steering::{Steering, Taken};
use self::sticks::{Due, SEEN_WITHIN, Sticks, lost_within};
use self::unexplained::Unexplained;
use self::watched::Watched;
use self::wings::BreakOff;
use super::context::{self, FlightView, MissionView, Origin, ParameterView};
use super::contingency::Contingencies;
use super::contingency::priority::Turn;
use super::duplicates::Seen;
use super::effects::{Effects, Request};
use super::ignored_fields;
use super::link::services::Services;
use super::link::state::VehicleState;
use super::maneuver::{self, Maneuver, Progress, Step};
use super::other::Other;
use crate::config::{LinkAddress, OnLoss};

/// The machine.
#[derive(Debug, Default)]
pub(crate) struct Flight {
    /// The maneuver in progress and the command that it carries out; without origin for the VSM itself.
    maneuver: Option<(Option<Origin>, Maneuver)>,
    /// Other commands that the maneuver carries out too, because they continue its command.
    joined: Vec<Origin>,
    /// A maneuver that has ended, and is answered once the vehicle's reason has come.
    unexplained: Option<Unexplained>,
    /// Waits for a report that confirms the state requested by a 2008, which the vehicle had already; it commands nothing.
    look: Option<(Origin, Maneuver)>,
    /// What 3002 and 3004 report as commanded.
    commanded: Commanded,
    /// The last commanded value of each, regardless of mode changes since.
    last: Commanded,
    /// The mode of the vehicle at that time.
    commanded_in: Option<Px4Mode>,
    loiter: LoiterConfiguration,
    /// That none has been configured has been said.
    unconfigured_named: bool,
    altimeter: Altimeter,
    sticks: Sticks,
    steering: Steering,
    curve_stream: CurveStream,
    /// The last 2008.
    engine_command: Option<CommandedEngineState>,
    loss_action: LossAction,
    contingencies: Contingencies,
    repeated: Repeated,
    /// When the command arrived whose route is, or was, being uploaded.
    load_commanded: Option<Duration>,
    watched: Watched,
    /// A wing is commanded off its final approach, and has not reported that it left it.
    breaks_off: Option<BreakOff>,
    /// Where AUTO.LAND began, while the vehicle is in it, m above mean sea level.
    landing_from_m: Option<f64>,
    /// A restart of the VSM interrupted a launch whose outcome is not known yet.
    launch_cut_off: bool,
    /// A flight termination is in effect: nothing is flown, and no timed action is due.
    held: bool,
    /// Control was lost during the termination: what must be flown if it ends with the vehicle in the air, since the loss is
    /// reported only once.
    lost_while_held: Option<OnLoss>,
}

/// What it reads.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Context<'a> {
    pub(crate) common: context::Context<'a>,
    pub(crate) mission: MissionView<'a>,
    pub(crate) parameters: ParameterView<'a>,
}

context::deref_to_common!(Context);

/// An input.
#[derive(Debug)]
pub(crate) enum Input<'a> {
    /// 2007, 2008, 2010, 2016, 2017 or 50023 of a CUCS that holds the right.
    Command {
        origin: Origin,
        message: &'a Message,
    },
    /// A 2016 whose route was just uploaded (`just_loaded`), or a command of the VSM itself, without origin.
    Fly {
        origin: Option<Origin>,
        command: &'a VehicleOperatingModeCommand,
        just_loaded: bool,
    },
    /// The mission watchdog stops the vehicle: with a hold, if an operator is there to see it.
    Hold,
    /// Control has passed to another CUCS, or to nobody.
    ControlChanged,
    /// The controlling CUCS was lost, and nobody has control.
    ControllerLost,
    /// A flight termination is commanded: nothing else is flown.
    YieldToTermination,
    /// A command to the vehicle ended.
    CommandEnded(&'a command::Event),
    /// An operation of the mission service ended or progressed.
    MissionServiceEnded(&'a mission::Event),
    /// The vehicle reports a new mode.
    ModeChanged,
    /// Sends due set points and sticks, and advances the maneuver.
    Advance,
    /// Retries the loss action until the vehicle reports it.
    WatchLossAction,
    /// Ends a launch that a restart interrupted, so that no motors keep running on the ground.
    EndCutOffLaunch,
    /// 17002 for 50023.
    ListContingencies { station: usize },
}

/// The mode of a 2016: the commanded one, or the present one if it names none; `None` for other messages.
pub(crate) fn mode_of(message: &Message, telemetry: &Telemetry) -> Option<Mode> {
    match message {
        Message::VehicleOperatingModeCommand(command) => situation::mode_of(command, telemetry),
        _ => None,
    }
}

impl Flight {
    /// Restores the record after a restart.
    ///
    /// # Errors
    /// A record exists and cannot be read.
    pub(crate) fn restore(&mut self, effects: &mut Effects<'_>) -> Result<(), StoreError> {
        self.altimeter = settings::stored_altimeter(effects)?;
        self.contingencies.restore(effects)?;
        self.loss_action.restore(effects)?;
        Ok(())
    }

    /// A restart has interrupted this command.
    pub(crate) fn cut_off(&mut self, seen: &Seen) {
        self.launch_cut_off |=
            seen.message_type == 2016 && Mode::from_raw(seen.mode) == Mode::Launch;
    }

    /// A restart has interrupted a launch that came from a held command.
    pub(crate) fn cut_off_launch(&mut self) {
        self.launch_cut_off = true;
    }

    /// A restart has interrupted a held contingency of this number.
    pub(crate) fn cut_off_held(&mut self, number: u16) {
        self.loss_action.cut_off_held(number);
    }

    /// Reports a loss action or a held contingency that a restart has cut off; `controlled`: a CUCS has control, and decides.
    pub(crate) fn report_cut_off(&mut self, controlled: bool, effects: &mut Effects<'_>) {
        self.loss_action.report_cut_off(controlled, effects);
    }

    /// The state that other machines may read.
    pub(crate) fn view(&self) -> FlightView<'_> {
        FlightView {
            maneuver: self.maneuver.is_some(),
            streams_curve: self.curve_stream.is_flown(),
            loss_action: self.loss_action.is_active(),
            contingency: self.contingencies.stands(),
            item_unknown_until: self.item_unknown_until(),
            commands_by_itself: self.loss_action.is_active()
                || self.contingencies.urgency().is_some(),
            commanded: self.commanded,
            altimeter: self.altimeter,
            loiter: &self.loiter,
            engine_command: self.engine_command,
            sticks: self.sticks.latest(),
        }
    }

    /// The last commanded values, also from an earlier mode.
    pub(crate) fn last_commanded(&self) -> &Commanded {
        &self.last
    }

    /// Whether the vehicle is, or is about to be, steered (mode 15): by set points, or by GUIDED_COURSE for fixed wings.
    /// Left alone it would fly straight on forever: set points end with this VSM, but PX4 keeps a course by itself.
    pub(crate) fn steers(&self, telemetry: &Telemetry) -> bool {
        let enters = |(_, maneuver): &(_, Maneuver)| maneuver.enters(Px4Mode::COURSE);
        self.steering.engaged()
            || telemetry.mode == Some(Px4Mode::COURSE)
            || self.maneuver.as_ref().is_some_and(enters)
    }

    /// Earlier commands whose effect the vehicle may not report yet.
    fn under_way(&self, context: &Context<'_>) -> UnderWay {
        let (vehicle, mission) = (context.vehicle, &context.mission);
        let maneuver = self.maneuver.as_ref().map(|(_, maneuver)| maneuver);
        let item = maneuver.and_then(Maneuver::sends_to);
        let lands_at = |item: u16| {
            mission
                .uploaded
                .is_some_and(|uploaded| uploaded.compiled.lands(item))
        };
        let current = vehicle.telemetry.mission.map(|mission| mission.seq);
        let enters = |mode| maneuver.is_some_and(|maneuver| maneuver.enters(mode));
        let waits = mission.waiting_command().is_some();
        UnderWay {
            enters: waits || maneuver.is_some_and(Maneuver::enters_a_mode),
            unseen: !vehicle.state_is_newer_than_command(),
            acts: maneuver.is_some(),
            // Every stage of a landing counts: AUTO.LAND is being entered, landing items are flown to, or an approach route
            // is still being uploaded.
            lands: enters(Px4Mode::LAND)
                || (enters(Px4Mode::MISSION) && item.or(current).is_some_and(lands_at))
                || (waits && mission.waiting_mode == Some(Mode::AutolandEngage)),
            item,
            turns: maneuver.is_some_and(Maneuver::turns) || vehicle.telemetry.transits(),
        }
    }

    /// The vehicle's mode, if no other mode is or may be being entered.
    fn settled_mode(&self, context: &Context<'_>) -> Option<Px4Mode> {
        let enters = |(_, maneuver): &(_, Maneuver)| maneuver.enters_a_mode();
        let enters = self.maneuver.as_ref().is_some_and(enters);
        context.vehicle.settled_mode().filter(|_| !enters)
    }

    /// The bridge did not run for so long: nothing has lasted by that, and nobody has had that time to pause or to read an alert.
    pub(crate) fn note_stop(&mut self, stopped: Duration) {
        self.watched.note_stop(stopped);
        self.contingencies.note_stop(stopped);
        self.repeated.note_stop(stopped);
        self.load_commanded = self.load_commanded.map(|at| at + stopped);
    }

    /// The bridge did not run for so long: what the vehicle has shown meanwhile is not read yet.
    pub(crate) fn postpone(&mut self, stopped: Duration) {
        self.steering.note_gap();
        for maneuver in self.waits() {
            maneuver.postpone(stopped);
        }
        if let Some(unexplained) = &mut self.unexplained {
            unexplained.refusal.postpone(stopped);
        }
    }

    /// The bridge did not run for too long: what was commanded before is not carried out any more.
    pub(crate) fn lapse(&mut self, now: Duration, services: &mut Services) {
        self.steering.note_gap();
        for maneuver in self.waits() {
            maneuver.lapse(now, services);
        }
    }

    fn waits(&mut self) -> impl Iterator<Item = &mut Maneuver> {
        let running = self.maneuver.iter_mut().map(|(_, maneuver)| maneuver);
        running.chain(self.look.iter_mut().map(|(_, seen)| seen))
    }

    /// Takes an input.
    pub(crate) fn handle(
        &mut self,
        context: &Context<'_>,
        input: Input<'_>,
        effects: &mut Effects<'_>,
    ) {
        self.take(context, input, effects);
        // Together with what was commanded, which does not wait for the disk: the vehicle must not fly on uncontrolled meanwhile.
        self.loss_action.store(effects);
    }

    fn take(&mut self, context: &Context<'_>, input: Input<'_>, effects: &mut Effects<'_>) {
        // On every input, also during a termination: its durations must not restart when the termination ends.
        self.watched.note(context.vehicle, context.mono());
        self.explain(context, effects);
        self.held = context.termination.holds;
        if self.held {
            match input {
                Input::Fly { origin, .. } => return effects.refuse(origin, TERMINATING),
                // The termination has already ended the mission, the loss action and the streams: there is nothing to do.
                Input::Hold | Input::Advance | Input::WatchLossAction | Input::EndCutOffLaunch => {
                    return;
                }
                Input::ControllerLost => {
                    self.lost_while_held = Some(context.settings.authority.on_loss);
                    return;
                }
                // After a release, a steered vehicle must not fly straight on, as without a termination.
                Input::ControlChanged if context.controller.is_none() => {
                    self.lost_while_held = Some(OnLoss::Continue);
                }
                Input::ControlChanged => self.lost_while_held = None,
                _ => {}
            }
        } else if let Some(on_loss) = self.lost_while_held.take() {
            self.take_up_loss(context, on_loss, effects);
        }
        match input {
            Input::Command { origin, message } => self.command(context, origin, message, effects),
            Input::Fly {
                origin,
                command,
                just_loaded,
            } => {
                // A failsafe that holds does not change the mode while the vehicle is on hold for the upload.
                if let (None, true, Some(other)) = (
                    origin,
                    just_loaded,
                    self.other(context.vehicle, context.mono()),
                ) {
                    return effects.refuse(None, other.to_string());
                }
                self.operate(context, origin, command, just_loaded, effects);
            }
            Input::Hold if self.returns_instead(context) => self.fly_by_itself(context, effects),
            Input::Hold => {
                let hold = maneuver::enter(&[Px4Mode::LOITER]);
                let maneuver = Maneuver::new(hold, Commanded::default());
                self.begin(context, None, maneuver, effects);
            }
            Input::ControlChanged => self.control_changed(context, effects),
            Input::ControllerLost => {
                let on_loss = context.settings.authority.on_loss;
                // Also if the change of control that came with it has started to put a steered vehicle on hold.
                let steered =
                    self.steers(&context.vehicle.telemetry) || self.loss_action.is_active();
                self.contingencies.controller_lost(effects);
                self.loss_action.begin(on_loss, steered, context.mono());
                if self.loss_action.is_active() {
                    // A held contingency keeps its right without a controller, but not before the loss action.
                    self.end_running(context, LOST, |origin| origin.is_some(), effects);
                    if context.mission.waiting_command().flatten().is_some() {
                        effects.request(Request::DropWaitingCommand {
                            why: LOST.to_owned(),
                            without_right: false,
                        });
                    }
                }
                self.fly_by_itself(context, effects);
            }
            Input::YieldToTermination => {
                self.contingencies.yield_to_termination(effects);
                self.end_running(context, TERMINATING, |_| true, effects);
                // End the whole stream: sticks that still arrive would take the vehicle out of the commanded mode.
                self.still_sticks(context, effects);
                self.sticks.forget();
                self.sticks.release();
                self.steering.release();
                self.stream_curve(context, curve_stream::Input::Release, effects);
            }
            Input::CommandEnded(event) => {
                let (now, vehicle) = (context.mono(), context.vehicle);
                if let Some((origin, maneuver)) = &mut self.maneuver
                    && let Progress::Refused(why) = maneuver.handle_command(now, event, vehicle)
                {
                    let origin = *origin;
                    self.fail(context, origin, why, effects);
                }
            }
            Input::MissionServiceEnded(event) => {
                let (now, vehicle) = (context.mono(), context.vehicle);
                if let Some((origin, maneuver)) = &mut self.maneuver
                    && let Progress::Refused(why) = maneuver.handle_mission(now, event, vehicle)
                {
                    let origin = *origin;
                    // It stays on its item; PX4 may break its landing off by itself.
                    self.breaks_off = self.breaks_off.take().and_then(BreakOff::refused);
                    self.fail(context, origin, why, effects);
                }
            }
            Input::ModeChanged => {
                self.forget_commanded(context);
                self.watched.mode_changed = true;
                self.give_way(context, effects);
                // Also if PX4's own failsafe lands.
                let telemetry = &context.vehicle.telemetry;
                let lands = telemetry.mode == Some(Px4Mode::LAND);
                let here = telemetry.position.filter(|_| lands);
                self.landing_from_m = here.map(|place| place.amsl_m);
            }
            Input::Advance => {
                // Streams before modes: PX4 rejects POSCTL without sticks and OFFBOARD without set points.
                self.stream_sticks(context, effects);
                self.stream_set_points(context, effects);
                self.stream_curve(context, curve_stream::Input::Advance, effects);
                self.give_way(context, effects);
                self.advance(context, effects);
            }
            Input::WatchLossAction => {
                self.watch_cut_off_loss(context, effects);
                self.fly_by_itself(context, effects);
            }
            Input::EndCutOffLaunch => self.end_cut_off_launch(context, effects),
            Input::ListContingencies { station } => {
                self.list_contingencies(context, station, effects);
            }
        }
    }

    /// When a timed input is next due.
    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        let unexplained = self.unexplained.as_ref();
        let unexplained = unexplained.and_then(|one| one.refusal.poll_timeout());
        // A deadline that is not acted on would stay in the past, and the machine would be polled in a busy loop.
        if self.held {
            return unexplained;
        }
        let maneuver = self.maneuver.as_ref();
        [
            unexplained,
            maneuver.and_then(|(_, maneuver)| maneuver.poll_timeout()),
            self.look.as_ref().and_then(|(_, seen)| seen.poll_timeout()),
            self.sticks.poll_timeout(),
            self.steering.poll_timeout(),
            self.curve_stream.poll_timeout(),
            // A blocked action is not due either, for the same reason.
            match self.turn() {
                Turn::Nobody => None,
                Turn::Loss => self.loss_action.poll_timeout(),
                Turn::Contingency => self.contingencies.poll_timeout(),
            },
            self.contingencies.save_timeout(),
            self.loss_action.save_timeout(),
        ]
        .into_iter()
        .flatten()
        .min()
    }
}

/// Commands, as they arrive.
impl Flight {
    fn command(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        message: &Message,
        effects: &mut Effects<'_>,
    ) {
        match message {
            Message::VehicleOperatingModeCommand(command) => {
                // 17000 type 1 at once; type 2 or 3 follows when the vehicle has reported the outcome.
                effects.acknowledge(&origin, AckType::Received);
                self.operate(context, Some(origin), command, false, effects);
            }
            Message::LoiterConfiguration(new) => {
                self.configure_loiter(context, origin, new, effects);
            }
            Message::UaStickCommand(sticks) => {
                self.take_sticks(context, origin, sticks, effects);
            }
            Message::EngineCommand(command) => {
                self.command_engine(context, origin, command, effects);
            }
            Message::Contingency(set) => {
                self.provision_contingency(context, origin, set, effects);
            }
            _ => {
                let why = mapping::support::why_refused(message.id());
                effects.refuse(Some(origin), why.unwrap_or("it is not supported"));
            }
        }
    }

    /// 2017.
    fn configure_loiter(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        new: &LoiterConfiguration,
        effects: &mut Effects<'_>,
    ) {
        let airframe = context.vehicle.telemetry.airframe();
        let merged = match settings::merged(&self.loiter, new, airframe) {
            Ok(merged) => merged,
            Err(why) => return effects.refuse(Some(origin), why),
        };
        if merged != self.loiter {
            self.repeated.reopen();
        }
        let changed = changes::loiter(&merged, &self.loiter).collect();
        // A setting is only stored: 17000 type 2 comes at once, and the next loiter (2016 mode 12) flies by it.
        self.loiter = merged;
        effects.acknowledge(&origin, AckType::CarriedOut);
        effects.request(Request::Configured {
            changed,
            by: Some(origin.station),
        });
    }

    /// 2010.
    fn take_sticks(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        sticks: &UaStickCommand,
        effects: &mut Effects<'_>,
    ) {
        // No message of the vehicle confirms MANUAL_CONTROL: storing the sticks is all that can be answered.
        match self.sticks.take(context.mono(), sticks) {
            Ok(()) => effects.acknowledge(&origin, AckType::CarriedOut),
            Err(why) => effects.refuse(Some(origin), why),
        }
    }

    /// 2008.
    fn command_engine(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        command: &EngineCommand,
        effects: &mut Effects<'_>,
    ) {
        effects.acknowledge(&origin, AckType::Received);
        if !context.vehicle.live() {
            return effects.refuse(Some(origin), SILENT);
        }
        match engine::steps(command, context.vehicle) {
            Ok((wanted, task)) => {
                self.engine_command = Some(wanted);
                // Arming and disarming do not change the commanded values in 3002.
                let maneuver = |steps| Maneuver::new(steps, self.commanded);
                let running = self.maneuver.as_ref();
                let stops = running.is_some_and(|(_, running)| running.disarms());
                match task {
                    engine::Task::Steps(steps) => {
                        let maneuver = maneuver(steps);
                        self.begin(context, Some(origin), maneuver, effects);
                    }
                    // An earlier stop in progress is no longer wanted.
                    engine::Task::Look(step) if stops => {
                        let maneuver = maneuver(vec![step]);
                        self.begin(context, Some(origin), maneuver, effects);
                    }
                    engine::Task::Look(step) => {
                        let seen = maneuver(vec![step]);
                        self.look_for(context, origin, seen, effects);
                    }
                }
            }
            Err(why) => effects.refuse(Some(origin), why),
        }
    }

    /// A 2016; without origin it is a command of the VSM. `just_loaded`: its route was uploaded for it.
    fn operate(
        &mut self,
        context: &Context<'_>,
        origin: Option<Origin>,
        command: &VehicleOperatingModeCommand,
        just_loaded: bool,
        effects: &mut Effects<'_>,
    ) {
        let (now, vehicle, mission) = (context.mono(), context.vehicle, &context.mission);
        // What was uploaded for a command is not another one.
        let repeats = !just_loaded && self.repeated.is_continued(now, origin, command);
        let undecided =
            origin.and_then(|by| self.is_undecided(context, by, command, just_loaded, repeats));
        // Before all refusals: what repeats a refused command is part of a stream too, and no station pauses by a silence of the
        // vehicle. Not where it is refused as too early: sent again after the alert, it is the decision that `TOO_EARLY` requests.
        let repetition = if just_loaded || (undecided.is_some() && !repeats) {
            Repetition::None
        } else {
            let other = || self.shown_other(vehicle, now).is_some();
            let over_other = vehicle.live().then(other);
            self.repeated
                .note(now, origin, command, mission, over_other)
        };
        if !vehicle.live() {
            return effects.refuse(origin, SILENT);
        }
        if let Some(why) = undecided {
            return effects.refuse(origin, why);
        }
        let repetition = if repetition == Repetition::OfDone && self.is_left(context) {
            // Once: the next repeats the one that is carried out now.
            self.repeated.reopen();
            Repetition::OfMode
        } else {
            repetition
        };
        let telemetry = &context.vehicle.telemetry;
        let altimeter = match settings::altimeter_of(command, self.altimeter) {
            Ok(altimeter) => altimeter,
            Err(why) => return effects.refuse(origin, why),
        };
        let situation = Situation {
            telemetry,
            uploaded: context.mission.uploaded,
            infeasible: context.mission.why_infeasible(telemetry),
            progress: context.mission.progress,
            loaded: context.mission.loaded,
            plan: context.mission.plan,
            fence: context.mission.fence,
            unfenced: context.mission.unfenced,
            just_loaded,
            repeats: repetition == Repetition::OfDone,
            under_way: self.under_way(context),
            landing_from_m: self.landing_from_m,
            loiter: &self.loiter,
            commanded: self.commanded,
            agl: context.bounds.agl,
            altimeter,
            limits: context.parameters.limits(context),
            terrain: context.bounds.terrain.as_deref(),
            performance: context.parameters.performance(context),
            route_performance: context.parameters.route_performance(context),
            wings: context.parameters.wings(context),
            vtol_loiter_m: context.parameters.get("VTO_LOITER_ALT"),
        };
        if repetition != Repetition::None
            && let Some(by) = self.taken_by(context, mode_command::is_over(&situation))
        {
            return effects.refuse(origin, format!("{by}, and {NOT_NEW}"));
        }
        if let (Repetition::OfDone, Some(origin)) = (repetition, origin)
            && self.is_still_flown(context)
        {
            return effects.acknowledge(&origin, AckType::CarriedOut);
        }
        let winged = situation.wings.is_some();
        let hovers_instead = mode_command::hovers_instead(command, &situation);
        let unconfigured = mode_command::is_unconfigured(command, &situation);
        let unconfigured = unconfigured.filter(|_| !self.unconfigured_named);
        let continues_instead = mode_command::continues_instead(command, &situation);
        let restarts = mode_command::restarts_route(command, &situation)
            && command.select_flight_path_control_mode == Some(Mode::Waypoint);
        // A refused command changes nothing: the altimeter setting is stored only if the rest can be flown.
        let task = mode_command::task(command, &situation).and_then(|task| {
            self.set_altimeter(altimeter, origin, effects)
                .map(|()| task)
        });
        let task = match task {
            Ok(task) => task,
            Err(why) => return effects.refuse(origin, why),
        };
        // PX4 refuses the terrain frame (11): without elevation files AGL is flown as height above home, which is reported.
        if command.commanded_altitude.is_some()
            && command.altitude_type == Some(AltitudeType::Agl)
            && context.bounds.agl == Agl::AboveHome
        {
            effects.advise_agl();
        }
        // Unused fields are reported, not refused: a station may send every field every time, and a commanded hold must be
        // carried out.
        if let Some((origin, mode)) = origin.zip(situation::mode_of(command, telemetry)) {
            let routed = task.flies_a_route(telemetry.mode);
            let climbs = task.climbs();
            let names = ignored_fields::ignored_fields(command, mode, routed, winged, climbs);
            let place = format!(" in mode {}", mode.in_words());
            let text = ignored_fields::report(origin.message_type, &names, &place);
            self.unconfigured_named |= unconfigured.is_some();
            let notices = [hovers_instead, unconfigured].into_iter().flatten();
            for text in text.into_iter().chain(notices.map(str::to_owned)) {
                effects.answer(&[origin.station], text);
            }
            if let Some(text) = continues_instead {
                effects.answer_sometimes(&[origin.station], text);
            }
        }
        match task {
            Task::Nothing => {
                if let Some(origin) = origin {
                    effects.acknowledge(&origin, AckType::CarriedOut);
                }
            }
            Task::Steps(steps, commanded) => {
                // What begins again before the vehicle has shown it would never be shown.
                if let (Repetition::OfRunning, Some(by)) = (repetition, origin) {
                    return self.join(by, effects);
                }
                if let Some(why) = waits_for_transfer(&steps, context) {
                    return effects.refuse(origin, why);
                }
                if restarts && context.mission.progress.was_flown() {
                    report_restart(context, effects);
                }
                self.begin(context, origin, Maneuver::new(steps, commanded), effects);
            }
            Task::Launch(steps, commanded) => {
                // Begun again, it would first be ended, which stops the motors.
                if let (Repetition::OfRunning, Some(by)) = (repetition, origin) {
                    return self.join(by, effects);
                }
                if let Some(why) = waits_for_transfer(&steps, context) {
                    return effects.refuse(origin, why);
                }
                // If a step after arming fails, the motors must not keep running on the ground.
                let maneuver = Maneuver::new(steps, commanded).undone_by(maneuver::arm(false));
                self.begin(context, origin, maneuver, effects);
            }
            Task::Manual => self.fly_manually(context, origin, effects),
            Task::Steer(order, commanded) => {
                self.steer(context, origin, repetition, (order, commanded), effects);
            }
            Task::Load(route_type) => {
                self.load_and_fly(context, origin, Some(route_type), command, effects);
            }
            Task::Reload => self.load_and_fly(context, origin, None, command, effects),
        }
        let running = self.maneuver.as_ref().and_then(|(by, _)| *by);
        if origin.is_some_and(|by| running == Some(by) || self.joined.last() == Some(&by)) {
            self.repeated.begun(origin, command, mission, repetition);
        }
    }

    /// Requests the upload of a route, of this type or the loaded one again, to be flown afterwards.
    fn load_and_fly(
        &mut self,
        context: &Context<'_>,
        origin: Option<Origin>,
        route_type: Option<RouteType>,
        command: &VehicleOperatingModeCommand,
        effects: &mut Effects<'_>,
    ) {
        if origin.is_some_and(|origin| origin.held.is_none()) {
            self.contingencies.operator_loads();
            // The upload takes seconds, and a contingency may begin meanwhile: what counts is whether its operator knew of
            // it when the command was sent.
            self.load_commanded = Some(context.mono());
        }
        effects.request(Request::LoadAndFly {
            origin,
            route_type,
            command: Box::new(command.clone()),
        });
    }

    fn set_altimeter(
        &mut self,
        altimeter: Altimeter,
        by: Option<Origin>,
        effects: &mut Effects<'_>,
    ) -> Result<(), String> {
        if altimeter != self.altimeter {
            // Stored first: if that fails, the setting in use is still the one on disk.
            settings::store_altimeter(altimeter, effects)?;
            self.altimeter = altimeter;
            effects.request(Request::Configured {
                changed: changes::altimeter(altimeter).into_iter().collect(),
                by: by.map(|origin| origin.station),
            });
        }
        Ok(())
    }

    /// Mode 2: the stream first, then the mode.
    fn fly_manually(
        &mut self,
        context: &Context<'_>,
        origin: Option<Origin>,
        effects: &mut Effects<'_>,
    ) {
        let now = context.mono();
        if context.vehicle.awaits_mode() {
            return effects.refuse(origin, format!("mode 2 (manual): {DID_NOT_RUN}"));
        }
        let parameters = context.parameters.values;
        // A remote control may be on: the vehicle would enter the mode, and not be flown by this CUCS.
        if let Some(why) = parameters.ignores_sticks() {
            let why = format!("mode 2 (manual): the vehicle ignores sticks (2010): its {why}");
            return effects.refuse(origin, why);
        }
        // A safety pilot's, for example: nothing would show that these move nothing.
        let health = context.vehicle.telemetry.sensed.health;
        if let Some(why) = parameters.prefers_other_sticks()
            && health.is_some_and(Health::has_sticks)
            && !self.sticks.were_shown(now, lost_within(parameters))
        {
            let why = format!(
                "mode 2 (manual): the vehicle has sticks of a remote control or another station, and would ignore these (2010): its {why}; \
                 end the others first"
            );
            return effects.refuse(origin, why);
        }
        // The next mode would be the end of the flight.
        if let Some(why) = parameters.falls_without_sticks() {
            let why = format!(
                "mode 2 (manual): the end of the sticks (2010) would bring the vehicle down in any other mode: its {why}; set that to 2, \
                 or COM_RCL_EXCEPT to 7"
            );
            return effects.refuse(origin, why);
        }
        if !self.sticks.fresh(now) {
            let why =
                "mode 2 (manual): no sticks (2010) received; send them first, at 10 Hz or more";
            return effects.refuse(origin, why);
        }
        let mut steps = Vec::new();
        if self.settled_mode(context) != Some(Px4Mode::POSCTL) {
            // PX4 refuses the mode until it has seen sticks.
            steps.push(Step::Pause(SEEN_WITHIN));
        }
        steps.extend(maneuver::enter(&[Px4Mode::POSCTL]));
        let maneuver = Maneuver::new(steps, Commanded::default());
        self.begin(context, origin, maneuver, effects);
        // After `begin`: what it superseded has released the sticks.
        let slow = matches!(context.common.config.link, LinkAddress::Serial { .. });
        self.sticks.engage(now, slow);
        self.stream_sticks(context, effects);
    }

    /// Mode 15: set points first, then the mode; within the mode the set points alone change.
    fn steer(
        &mut self,
        context: &Context<'_>,
        origin: Option<Origin>,
        repetition: Repetition,
        (order, mut commanded): (steering::Order, Commanded),
        effects: &mut Effects<'_>,
    ) {
        if context.vehicle.awaits_mode() {
            return effects.refuse(origin, format!("mode 15 (autopilot): {DID_NOT_RUN}"));
        }
        // A command that arrives while the mode is being entered adds to the one before, as its set points do.
        if let Some((_, running)) = &self.maneuver
            && running.enters(Px4Mode::OFFBOARD)
        {
            let mut both = running.commanded;
            both.keep(&commanded);
            if order.vertical.is_some() {
                // A vertical speed has replaced an altitude.
                both.altitude_amsl_m = commanded.altitude_amsl_m;
            }
            commanded = both;
        }
        let telemetry = &context.vehicle.telemetry;
        // The reported mode is not enough: a HEARTBEAT from before a hold that was just commanded still shows OFFBOARD, and
        // a change of the set points alone would be acknowledged while the vehicle holds.
        let entered =
            self.settled_mode(context) == Some(Px4Mode::OFFBOARD) && self.steering.engaged();
        // On a copy: a refused order must not disturb the present steering.
        let mut steering = self.steering.clone();
        if !entered {
            steering.enter_again();
        }
        if let Err(why) = steering.take(context.mono(), order, telemetry) {
            return effects.refuse(origin, why);
        }
        // While the mode is being entered, a demand that continues its command, or the next of a stream, changes only the set points.
        if (self.is_continued_by(origin) || repetition != Repetition::None)
            && let (Some((_, running)), Some(origin)) = (&mut self.maneuver, origin)
            && running.enters(Px4Mode::OFFBOARD)
        {
            running.commanded = commanded;
            self.steering = steering;
            return self.join(origin, effects);
        }
        self.supersede(context, origin, effects);
        // Only after the superseded maneuver has released the stream.
        self.steering = steering;
        self.stream_set_points(context, effects);
        let steps: Vec<Step> = if entered {
            Vec::new()
        } else {
            maneuver::enter(&[Px4Mode::OFFBOARD]).into()
        };
        self.begin(context, origin, Maneuver::new(steps, commanded), effects);
    }
}

/// Streams.
impl Flight {
    fn stream_sticks(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let (now, mode) = (context.mono(), context.vehicle.telemetry.mode);
        if let Some(mode) = context.vehicle.settled_mode() {
            self.sticks.note_first_mode(now, mode);
        }
        if context.vehicle.telemetry.armed == Some(false) {
            let within = lost_within(context.parameters.values);
            self.sticks.note_disarmed(now, within);
        }
        let by_hand = mode == Some(Px4Mode::POSCTL);
        let leaves = |(_, maneuver): &(_, Maneuver)| maneuver.is_leaving(Px4Mode::POSCTL);
        let leaves = by_hand && self.maneuver.as_ref().is_some_and(leaves);
        if context.vehicle.awaits_mode() {
            return self.sticks.withhold(now);
        }
        if leaves {
            if self.sticks.are_apart(now) {
                self.still_sticks(context, effects);
            }
            return self.sticks.withhold(now);
        }
        let ends = self.maneuver.as_ref();
        let ends = ends.is_some_and(|(_, maneuver)| maneuver.ends_sticks());
        if ends && self.sticks.are_aside() {
            return self.sticks.withhold(now);
        }
        self.stand_aside(context, !ends, effects);
        let system = context.config.system_id;
        let newer = context.vehicle.state_is_newer_than_command();
        match self.sticks.advance(now, (mode, newer), system) {
            Due::None => {}
            Due::Send(sticks) => effects.vehicle.post(MavMessage::MANUAL_CONTROL(sticks)),
            Due::Stopped => effects.warn_of_link(
                "the sticks (2010) have stopped: the vehicle acts by its own parameters",
            ),
        }
    }

    /// `uncommanded`: no other mode than that of the sticks is commanded.
    fn stand_aside(&mut self, context: &Context<'_>, uncommanded: bool, effects: &mut Effects<'_>) {
        let telemetry = &context.vehicle.telemetry;
        let failsafe = flies_failsafe(context.vehicle).filter(|_| uncommanded);
        let were_aside = self.sticks.are_aside();
        let cease = self.sticks.stand_aside(context.mono(), failsafe.is_some());
        let by_hand = telemetry.mode == Some(Px4Mode::POSCTL) && telemetry.armed != Some(false);
        match failsafe {
            Some(mode) if cease => advise_centred(mode, effects),
            None if were_aside && by_hand => effects.warn_of_link(format!(
                "the vehicle is in {} again, by itself or by a pilot: the sticks (2010) end, which would keep out a pilot's, and without \
                 any it acts by its own parameters; command mode 2 (manual) to steer by them",
                Px4Mode::POSCTL.name()
            )),
            _ => {}
        }
    }

    fn still_sticks(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let still = (self.sticks).stand_still(context.mono(), context.config.system_id);
        if let Some(still) = still {
            effects.vehicle.post(MavMessage::MANUAL_CONTROL(still));
        }
    }

    fn stream_set_points(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let limits = &context.parameters.limits(context);
        let system = context.config.system_id;
        // PX4 holds in between, for want of the sticks that this maneuver has ended.
        let again = |(_, one): &(_, Maneuver)| one.ends_sticks() && one.enters(Px4Mode::OFFBOARD);
        if self.maneuver.as_ref().is_some_and(again) {
            self.steering.enter_once_more();
        }
        let holds = holds_as_failsafe(context.vehicle);
        match (self.steering).note_mode(context.mono(), context.vehicle, holds) {
            Some(Taken::ByFailsafe) => effects.warn_of_link(STANDS_STILL),
            Some(Taken::Back) => effects.warn_of_link(
                "the vehicle is in OFFBOARD again, by itself or by a pilot: it hovers by set points that stand still; command mode 15 \
                 (autopilot) to steer it, or another mode",
            ),
            None => {}
        }
        let due = self
            .steering
            .advance(context.mono(), context.vehicle, limits, system);
        if let Some(message) = due {
            effects.vehicle.post(message);
        }
    }
}

/// Why these steps must wait for a transfer to the vehicle, if they must: while a mission is being replaced, an index could
/// mean a different item.
fn waits_for_transfer(steps: &[Step], context: &Context<'_>) -> Option<&'static str> {
    let needs_mission = steps.iter().any(|step| matches!(step, Step::SetCurrent(_)));
    // Without a step to another mode it would stay in the mission that the transfer takes it out of.
    let now = context.vehicle.telemetry.mode;
    let flies_mission = maneuver::mode_after(steps, now) == Some(Px4Mode::MISSION);
    if context.mission.is_transferring() && (needs_mission || flies_mission) {
        Some("a route is being uploaded: wait for 14000")
    } else if context.mission.fence_busy && needs_mission {
        Some("a fence is being uploaded (wait for 50018), or rally points are")
    } else {
        None
    }
}

/// Reports that a route which has been flown to its end is flown again.
fn report_restart(context: &Context<'_>, effects: &mut Effects<'_>) {
    let uploaded = context.mission.uploaded;
    let loops = uploaded.is_some_and(|uploaded| uploaded.compiled.circuit().is_some());
    let once = if loops {
        ", its loop only once: PX4 has counted it; clear and load the route for more"
    } else {
        ""
    };
    effects.advise(format!(
        "mode 11 (waypoint): the route was flown to its end, flying it again from its start{once}"
    ));
}

fn select(mode: Mode) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        select_flight_path_control_mode: Some(mode),
        ..VehicleOperatingModeCommand::default()
    }
}

/// The mode in which the vehicle flies by itself as a failsafe of PX4. What it steers by sticks alone, as without a position, is left to
/// their loss. A vehicle that is disarmed misses none.
fn flies_failsafe(vehicle: &VehicleState) -> Option<Px4Mode> {
    let by_itself = |mode: Px4Mode| mode.main() == Px4Mode::LOITER.main();
    match Other::of(&vehicle.telemetry)? {
        Other::Failsafe(mode) if by_itself(mode) && vehicle.may_fly() => Some(mode),
        _ => None,
    }
}

/// Whether PX4 holds the vehicle as its failsafe.
fn holds_as_failsafe(vehicle: &VehicleState) -> bool {
    flies_failsafe(vehicle) == Some(Px4Mode::LOITER)
}

/// Reports that centred sticks are sent in place of those that come.
fn advise_centred(failsafe: Px4Mode, effects: &mut Effects<'_>) {
    effects.advise(format!(
        "the sticks (2010) do not steer: the vehicle flies {} as its failsafe, and stays in it while they come; command mode 2 (manual) to \
         steer by them",
        failsafe.name()
    ));
}

const STANDS_STILL: &str = "the vehicle holds as its failsafe, and is not steered: set points stand still as long as it does, since it \
                            would return for want of them; command mode 15 (autopilot) again to steer it, or another mode";
const TERMINATING: &str = "a flight termination is commanded";
const LOST: &str = "its CUCS is lost, and the loss action (authority.on_loss) goes first";
const DID_NOT_RUN: &str =
    "this VSM did not run, and the vehicle has not shown its mode since: command it again";
const SILENT: &str = "no data from the vehicle: no command can be confirmed";
