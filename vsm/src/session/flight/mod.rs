//! Flying one vehicle: commands of a CUCS, and what the VSM flies without them.
//!
//! A 2016 becomes a [task](situation::Task), usually a [maneuver](super::maneuver): a sequence of steps, each confirmed by
//! reports of the vehicle. One maneuver is in progress at a time; a later command supersedes it. Parts:
//!
//! - `commands`: carries out, or refuses, what a CUCS commands
//! - `mode_command`: turns a 2016 into steps for PX4, or gives the reason why PX4 cannot do it; pure. `wings`: differences
//!   for fixed wings. `situation`: the input of that decision
//! - `running`: the maneuver in progress; `repeated`: a command that its station sends again and again; `taken`: who has
//!   taken the vehicle out of its mode meanwhile
//! - `streams`: what must not starve while its mode is flown: `sticks` (2010), `steering` (mode 15)
//! - `curve_stream`: curves of a mission flown by set points, where that is configured; `streamed`: what it reads and commands
//! - `settings` (2017, altimeter), `engine` (2008)
//! - [`contingency`](crate::session::contingency): actions for faults of the vehicle, and their priority, also over the loss
//!   action; `provision`: contingencies set by 50023
//! - `loss_action`: what is flown after the loss of the controlling CUCS; `by_itself`: flies these actions when neither a
//!   pilot nor a failsafe has the vehicle

mod by_itself;
mod commands;
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
mod streams;
mod taken;
#[cfg(test)]
mod tests;
mod unexplained;
mod watched;
mod wings;

use std::time::Duration;

use mapping::altitude::Altimeter;
use mapping::mode::Px4Mode;
use mapping::report::Commanded;
use mapping::telemetry::Telemetry;
use mavlink_link::service::command;
use mavlink_link::service::mission;
use mavlink_link::store::StoreError;
use stanag_msgs::Message;
use stanag_msgs::enums::{CommandedEngineState, FlightPathControlMode as Mode};
use stanag_msgs::messages::{LoiterConfiguration, VehicleOperatingModeCommand};

use self::curve_stream::CurveStream;
use self::loss_action::LossAction;
use self::repeated::Repeated;
use self::situation::UnderWay;
use self::steering::Steering;
use self::sticks::Sticks;
use self::unexplained::Unexplained;
use self::watched::Watched;
use self::wings::BreakOff;
use super::context::{self, FlightView, MissionView, Origin, ParameterView};
use super::contingency::Contingencies;
use super::contingency::priority::Turn;
use super::duplicates::Seen;
use super::effects::{Effects, Request};
use super::link::services::Services;
use super::maneuver::{self, Maneuver, Progress};
use crate::config::OnLoss;

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
        self.repeated.restore(effects)
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
        for maneuver in self.waits() {
            maneuver.postpone(stopped);
        }
        if let Some(unexplained) = &mut self.unexplained {
            unexplained.refusal.postpone(stopped);
        }
    }

    /// The bridge did not run for too long: what was commanded before is not carried out any more.
    pub(crate) fn lapse(&mut self, now: Duration, services: &mut Services) {
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
        self.repeated.store(effects);
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

fn select(mode: Mode) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        select_flight_path_control_mode: Some(mode),
        ..VehicleOperatingModeCommand::default()
    }
}

const TERMINATING: &str = "a flight termination is commanded";
const LOST: &str = "its CUCS is lost, and the loss action (authority.on_loss) goes first";
