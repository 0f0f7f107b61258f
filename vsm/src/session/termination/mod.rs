//! Flight termination (2005, 3005; #46 and #108 of Edition 2.5): two orders of a CUCS that holds LOI 5, and nothing else.
//!
//! [`rules`] decides, without messages, clock or vehicle, and lists its promises. This module converts orders to its inputs
//! and its decisions to messages: first an entry of the audit log, then, once that is on the disk, the command to the
//! vehicle; an alert to every station; and 3005 on every change, and twice a second while anything is armed.
//!
//! The command does not use the queue of other commands (`mavlink_link::service::command`), where it would wait behind an
//! unanswered command. It is sent directly, every second, until the vehicle reports it. COMMAND_ACK is ignored: PX4 executes
//! the command once and answers retries with TEMPORARILY_REJECTED. It is also sent to a vehicle of which no data arrives,
//! since a failed downlink is a reason to end a flight. But a mode that a pilot can leave is commanded at most five times
//! without data of the vehicle.
//!
//! A landing or return that PX4 leaves for a hold as its failsafe is commanded again, at most three times.
//!
//! Only a report after the last command counts as the vehicle's answer: it may have been landing or returning before.
//!
//! While it is commanded, and while the vehicle lands or returns by it, nothing else is flown: maneuvers and streams end,
//! uploads are dropped, and every other command is refused until a reset. A restart of the VSM does not end that ([`record`]).

mod record;
mod rules;
#[cfg(test)]
mod tests;
mod text;

use std::time::Duration;

use mapping::mode::Px4Mode;
use mapping::status;
use mavlink_link::dialect::{MavCmd, MavMessage};
use mavlink_link::service::{Node, command};
use mavlink_link::store::{Changes, Progress, StoreError};
use stanag_msgs::Message;
use stanag_msgs::enums::{AckType, AlertPriority, FtMode, FtState, SubsystemId};
use stanag_msgs::messages::FlightTerminationCommand;

use self::record::Found;
use self::rules::{Circumstances, Outcome, Plan, Refusal, Rules, Shows, Stage};
use super::alerts::Cause;
use super::context::{Context, Origin, TerminationView};
use super::effects::{Effects, Request};
use super::log::LogLevel;
use super::maneuver::set_mode;
use super::other::Other;
use super::two_steps::{self, Order};
use crate::config::{Provisional, TerminationAction as Action};

/// The machine.
#[derive(Debug, Default)]
pub(crate) struct Termination {
    rules: Rules,
    /// The order to execute, which is answered with its outcome.
    commanded: Option<(Origin, Action)>,
    /// The order to arm, which is answered once its entry of the audit log is queued.
    armed: Option<Origin>,
    /// The entry that the command waits for, and until when at the latest.
    audit: Option<(Option<Changes>, Duration)>,
    /// When the command is next sent.
    send_at: Option<Duration>,
    /// When it was last sent; `None` before the first time of an order.
    sent_at: Option<Duration>,
    /// How often it was sent since the vehicle last reported its mode.
    unseen: u32,
    /// How often it was sent since the vehicle showed it, because a failsafe held the vehicle.
    again: u32,
    /// When 3005 is next sent.
    report_at: Option<Duration>,
    /// What 3005 last reported to all listeners; `None` after a start.
    published: Option<FtState>,
    stored: record::Stored,
    /// What a restart has found and not taken up, to be said once the vehicle is there.
    not_taken_up: Option<String>,
}

/// An input.
#[derive(Debug)]
pub(crate) enum Input<'a> {
    /// 2005 of a CUCS that holds the right. `handover`: that CUCS is handing control over to another one.
    Command {
        origin: Origin,
        command: &'a FlightTerminationCommand,
        handover: bool,
    },
    /// The entry of the audit log is written with this change of the disk, or cannot be written.
    Audited(Result<Changes, String>),
    /// Control has passed to another CUCS, or to nobody.
    ControlChanged,
    /// The configuration was read again.
    Reconfigured,
    /// A station has begun to listen.
    ListenerChanged { station: usize },
    /// Time has passed, the vehicle has shown something, or the disk has stored something.
    Watch,
}

impl Termination {
    /// The state that other machines may read.
    pub(crate) fn view(&self, live: bool) -> TerminationView {
        // A silent vehicle may have been terminated by somebody else: "reset" must not be reported for it.
        let known = live || self.rules.stage() != Stage::Safe;
        TerminationView {
            reported: known.then(|| self.rules.reported()),
            holds: self.rules.holds(),
        }
    }

    /// Whether a command waits until its entry of the audit log is stored.
    pub(crate) fn awaits_disk(&self) -> bool {
        self.audit.is_some()
    }

    /// When [`Input::Watch`] is next due.
    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        let audit = self.audit.map(|(_, until)| until);
        [
            self.rules.poll_timeout(),
            audit,
            self.send_at,
            self.report_at,
        ]
        .into_iter()
        .flatten()
        .min()
    }

    /// Takes an input.
    pub(crate) fn handle(
        &mut self,
        context: &Context<'_>,
        input: Input<'_>,
        effects: &mut Effects<'_>,
    ) {
        match input {
            Input::Command {
                origin,
                command,
                handover,
            } => self.command(context, origin, command, handover, effects),
            Input::Audited(written) => self.audited(context, written, effects),
            Input::ControlChanged => {
                let outcome = self.rules.control_passed(context.controller);
                self.conclude(context, outcome, effects);
                self.release_where_no_reset_can_come(context, effects);
            }
            Input::Reconfigured => {
                let outcome = self.rules.replanned(plan(context));
                self.conclude(context, outcome, effects);
                self.release_where_no_reset_can_come(context, effects);
            }
            Input::ListenerChanged { station } => {
                let offered = context.config.termination.is_some();
                if (offered || self.rules.stage() != Stage::Safe)
                    && effects.listeners.contains(&station)
                    && let Some(report) = self.report(context, effects)
                {
                    effects.publish(station, &report);
                }
            }
            Input::Watch => self.watch(context, effects),
        }
        self.stored.keep(&self.rules, effects);
    }
}

/// Over a restart.
impl Termination {
    /// Takes up what was commanded before a restart.
    ///
    /// # Errors
    /// Its record exists and cannot be read.
    pub(crate) fn restore(&mut self, effects: &mut Effects<'_>) -> Result<(), StoreError> {
        match self.stored.restore(effects)? {
            Found::Nothing => {}
            Found::Recent(rules) => {
                self.rules = rules;
                if let Some(ordered) = rules.ordered() {
                    let words = text::cut_off(ordered.by, ordered.action);
                    let priority = AlertPriority::Emergency;
                    effects.raise(Cause::Termination, priority, SUBSYSTEM, words);
                }
            }
            Found::Old(by, action) => {
                self.not_taken_up = Some(text::of_another_time(by, action));
            }
        }
        Ok(())
    }

    /// The VSM did not run for some time.
    pub(crate) fn note_stop(&mut self) {
        self.rules.note_stop();
    }
}

/// Orders.
impl Termination {
    fn command(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        command: &FlightTerminationCommand,
        handover: bool,
        effects: &mut Effects<'_>,
    ) {
        let order = match order(command) {
            Ok(order) => order,
            Err(why) => return effects.refuse(Some(origin), why),
        };
        let vehicle = self.shows(context);
        let Some(at) = circumstances(context, &origin, handover, vehicle) else {
            return effects.refuse(Some(origin), "it needs its Time Stamp (field 1)");
        };
        match self.rules.order(order, &at) {
            Ok(outcome) => {
                match order {
                    Order::Arm => {
                        if let Some(before) = self.armed.replace(origin) {
                            effects.acknowledge(&before, AckType::CarriedOut);
                        }
                    }
                    Order::Execute => {
                        // 17000 type 1 at once; type 2 or 3 follows when the vehicle has shown the outcome.
                        effects.acknowledge(&origin, AckType::Received);
                        self.commanded = planned_action(context).map(|action| (origin, action));
                        (self.sent_at, self.unseen, self.again) = (None, 0, 0);
                        self.audit = Some((None, context.mono() + AUDITED_WITHIN));
                        effects.request(Request::YieldToTermination);
                    }
                    Order::Reset => effects.acknowledge(&origin, AckType::CarriedOut),
                }
                self.conclude(context, Some(outcome), effects);
            }
            Err(refusal) => {
                let armed_s = armed_s(context);
                let why = text::refusal(refusal, armed_s);
                if refusal != Refusal::Steps(two_steps::Refusal::NotPlanned) {
                    // All stations are notified of an attempt to end a flight.
                    let id = context.asker(origin.station).map(|asker| asker.id);
                    let by = id.map_or_else(String::new, |id| format!(" of {id}"));
                    let others: Vec<usize> = effects.listeners.clone();
                    let others = others.into_iter().filter(|one| *one != origin.station);
                    let others: Vec<usize> = others.collect();
                    let text = format!("flight termination{by} refused: {why}");
                    effects.answer_sometimes(&others, text);
                }
                effects.refuse(Some(origin), why);
            }
        }
    }

    /// The entry of the audit log is queued for the disk, stored, or failed.
    fn audited(
        &mut self,
        context: &Context<'_>,
        written: Result<Changes, String>,
        effects: &mut Effects<'_>,
    ) {
        if let Some(origin) = self.armed.take() {
            effects.acknowledge(&origin, AckType::CarriedOut);
        }
        match (&mut self.audit, written) {
            (Some((stored, _)), Ok(changes)) if stored.is_none() => *stored = Some(changes),
            (Some((_, until)), Err(_)) => *until = context.mono(),
            _ => {}
        }
        self.send_when_audited(context, effects);
    }

    /// Sends the command once its entry of the audit log is on the disk. A failing disk must not keep an aircraft in the air
    /// that must be ended: then the command is still sent, and an alert is raised.
    fn send_when_audited(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let Some((stored, until)) = self.audit else {
            return;
        };
        let durable =
            stored.is_some_and(|changes| effects.disk().progress(changes) == Progress::Durable);
        if !durable && context.mono() < until {
            return;
        }
        self.audit = None;
        if !durable {
            effects.notify(
                AlertPriority::Warning,
                SubsystemId::VsmStatus,
                "the audit log has no entry of this flight termination: the disk of the VSM does not keep it; commanded \
                 all the same",
            );
        }
        self.send_at = Some(context.mono());
    }
}

/// Progress of the termination.
impl Termination {
    fn watch(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        if context.vehicle.live()
            && let Some(words) = self.not_taken_up.take()
        {
            effects.notify(AlertPriority::Warning, SUBSYSTEM, words);
        }
        self.send_when_audited(context, effects);
        // First check what the vehicle has shown since the last command: if it shows the termination, nothing more is sent.
        let shown = self.shows(context);
        let outcome = self.rules.watch(context.mono(), shown);
        self.conclude(context, outcome, effects);
        self.send(context, effects);
        self.release_where_no_reset_can_come(context, effects);
        let due = self.report_at.is_some_and(|at| at <= context.mono());
        // After a restart, a CUCS that had armed it before must learn that nothing is armed.
        let reported = self.view(context.vehicle.live()).reported;
        let news = context.config.termination.is_some() && reported != self.published;
        if due || news {
            self.publish(context, effects);
        }
    }

    fn send(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let stage = self.rules.stage();
        let action = match stage {
            Stage::Commanded { action, .. } => action,
            Stage::Executing {
                by: Some(_),
                action,
                left: Some(_),
            } if self.again < AGAINST_HOLD && holds_as_failsafe(context) => {
                let now = context.mono();
                self.send_at = Some(self.sent_at.map_or(now, |sent| sent + AGAIN));
                action
            }
            _ => {
                self.send_at = None;
                return;
            }
        };
        if self.send_at.is_none_or(|at| at > context.mono()) {
            return;
        }
        self.send_at = Some(context.mono() + AGAIN);
        if self.has_reported_since(context) {
            self.unseen = 0;
        }
        // A pilot who takes the vehicle over meanwhile cannot be detected, and each of these commands would take it from
        // them again. It continues once the vehicle reports its mode, which shows what it does.
        if action != Action::Terminate && self.unseen >= UNSEEN {
            return;
        }
        effects
            .vehicle
            .post(command_of(action, context.config.system_id));
        self.rules.sent();
        self.unseen += 1;
        if matches!(stage, Stage::Executing { .. }) {
            self.again += 1;
            effects.notify(
                AlertPriority::Warning,
                SUBSYSTEM,
                "flight termination commanded again: the vehicle holds as its failsafe",
            );
        }
        self.sent_at = Some(context.mono());
    }

    /// Whether the vehicle has reported its mode since the last command, if there was one.
    fn has_reported_since(&self, context: &Context<'_>) -> bool {
        self.sent_at
            .is_none_or(|sent| context.vehicle.mode_at().is_some_and(|at| at > sent))
    }

    /// What the vehicle shows. What it did before the command is no answer to it.
    fn shows(&self, context: &Context<'_>) -> Shows {
        let telemetry = &context.vehicle.telemetry;
        if !context.vehicle.live() || !self.has_reported_since(context) {
            return Shows::Nothing;
        }
        match (telemetry.mode, telemetry.armed) {
            // Also if disarmed: PX4 stays in this mode. HEARTBEAT.system_status is not used: it shows
            // MAV_STATE_FLIGHT_TERMINATION for the kill switch and before a throw launch too, which a pilot can undo.
            (Some(Px4Mode::TERMINATION), _) => Shows::Terminated,
            // Before landing and returning: PX4 may stay in these modes after it has landed and disarmed.
            (_, Some(false)) => Shows::Disarmed,
            (Some(Px4Mode::LAND), _) => Shows::Landing,
            (Some(Px4Mode::RTL), _) => Shows::Returning,
            _ => Shows::Flying,
        }
    }

    /// A CUCS in control that cannot reset must not have all its commands refused.
    fn release_where_no_reset_can_come(
        &mut self,
        context: &Context<'_>,
        effects: &mut Effects<'_>,
    ) {
        let controller = context.controller.and_then(|id| {
            let station = context.stations.iter().position(|one| one.id() == id)?;
            Some((id, station))
        });
        if let Some((id, station)) = controller
            && context.provisional(station) != Provisional::All
        {
            let outcome = self.rules.controlled_without_layout(id);
            self.conclude(context, outcome, effects);
        }
    }

    fn conclude(
        &mut self,
        context: &Context<'_>,
        outcome: Option<Outcome>,
        effects: &mut Effects<'_>,
    ) {
        let Some(outcome) = outcome else {
            return;
        };
        let plan = context.config.termination.as_ref();
        let confirm_s = plan.map_or(0.0, |plan| plan.confirm_s);
        let words = text::outcome(outcome, armed_s(context), confirm_s);
        let (what, by) = text::audit(outcome);
        if outcome != Outcome::Reset(by.unwrap_or_default(), false) {
            effects.request(Request::Audit {
                what,
                by,
                why: words.clone(),
            });
        }
        self.answer(outcome, &words, effects);
        if self.audit.is_some() && !matches!(self.rules.stage(), Stage::Commanded { .. }) {
            self.audit = None;
        }
        self.alert(outcome, words, effects);
        self.publish(context, effects);
    }

    /// Answers the order to execute, once its outcome is known.
    fn answer(&mut self, outcome: Outcome, words: &str, effects: &mut Effects<'_>) {
        match outcome {
            Outcome::Armed(..) | Outcome::Commanded(..) | Outcome::Reset(..) => {}
            _ => {
                let Some((origin, action)) = self.commanded.take() else {
                    return;
                };
                match outcome {
                    Outcome::Confirmed(..) => effects.acknowledge(&origin, AckType::CarriedOut),
                    // A vehicle that terminates by itself does not land or return as ordered.
                    Outcome::ByItself if action == Action::Terminate => {
                        effects.acknowledge(&origin, AckType::CarriedOut);
                    }
                    _ => effects.refuse(Some(origin), words),
                }
            }
        }
    }

    /// One alert is active as long as anything is armed, commanded or executed, and changes with it.
    fn alert(&self, outcome: Outcome, words: String, effects: &mut Effects<'_>) {
        let priority = match (self.rules.stage(), outcome) {
            (Stage::Safe, Outcome::Reset(_, false)) => {
                return effects.note(LogLevel::Info, words);
            }
            (
                Stage::Safe,
                Outcome::Unconfirmed(..) | Outcome::NotResumed(..) | Outcome::Left(..),
            ) => {
                effects.clear(Cause::Termination, "flight termination is not armed");
                return effects.notify(AlertPriority::Emergency, SUBSYSTEM, words);
            }
            (Stage::Safe, _) => {
                effects.clear(Cause::Termination, "flight termination is not armed");
                return effects.notify(AlertPriority::Warning, SUBSYSTEM, words);
            }
            (Stage::Armed { .. }, _) => AlertPriority::Warning,
            (Stage::Commanded { .. } | Stage::CutOff { .. } | Stage::Executing { .. }, _) => {
                AlertPriority::Emergency
            }
        };
        effects.raise(Cause::Termination, priority, SUBSYSTEM, words);
    }

    /// Sends 3005 to all listeners, and again in half a second while there is anything to report.
    fn publish(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let standing = self.rules.stage() != Stage::Safe;
        self.report_at = standing.then(|| context.mono() + REPORT_EVERY);
        self.published = self.view(context.vehicle.live()).reported;
        if let Some(report) = self.report(context, effects) {
            effects.publish_to_listeners(&report);
        }
    }

    fn report(&self, context: &Context<'_>, effects: &mut Effects<'_>) -> Option<Message> {
        let state = self.view(context.vehicle.live()).reported?;
        Some(status::termination(state, effects.stamp()).into())
    }
}

/// The order of a 2005.
fn order(command: &FlightTerminationCommand) -> Result<Order, String> {
    if let Some(mode) = command.flight_termination_mode
        && mode != FtMode::NotSpecified
    {
        return Err(format!(
            "Flight Termination Mode {}, expected 0: the configuration plans what is done",
            mode.raw()
        ));
    }
    two_steps::order(
        command.commanded_flight_termination_state,
        "Commanded Flight Termination State",
    )
}

fn circumstances(
    context: &Context<'_>,
    origin: &Origin,
    handover: bool,
    vehicle: Shows,
) -> Option<Circumstances> {
    let station = context.stations.get(origin.station)?;
    Some(Circumstances {
        now: context.mono(),
        by: station.id(),
        stamp: origin.stamp?,
        controls: context.controller == Some(station.id()),
        handover,
        proven: station.proven,
        delay: station.delay,
        layout: context.provisional(origin.station) == Provisional::All,
        plan: plan(context),
        vehicle,
    })
}

fn plan(context: &Context<'_>) -> Option<Plan> {
    let planned = context.config.termination.as_ref()?;
    Some(Plan {
        action: planned.action,
        armed: planned.armed(),
        confirm: planned.confirm(),
    })
}

fn planned_action(context: &Context<'_>) -> Option<Action> {
    context.config.termination.as_ref().map(|plan| plan.action)
}

fn armed_s(context: &Context<'_>) -> f64 {
    let planned = context.config.termination.as_ref();
    planned.map_or(0.0, |planned| planned.armed_s)
}

/// The command as a message, sent regardless of other commands that wait for an answer.
fn command_of(action: Action, system: u8) -> MavMessage {
    let to = Node::new(system, AUTOPILOT);
    let enter = |mode| command::long(to, MavCmd::MAV_CMD_DO_SET_MODE, set_mode(mode));
    match action {
        Action::Terminate => command::long(to, MavCmd::MAV_CMD_DO_FLIGHTTERMINATION, [1.0]),
        Action::Land => enter(Px4Mode::LAND),
        Action::Return => enter(Px4Mode::RTL),
    }
}

/// Whether PX4 holds as its failsafe, as it does in a landing once it misses the sticks that the termination has ended. It is no pilot
/// who has chosen that, and what it leads to, if anything, is not what was commanded. A hold that one has chosen is none, whatever
/// failsafe would hold too.
fn holds_as_failsafe(context: &Context<'_>) -> bool {
    let telemetry = &context.vehicle.telemetry;
    let is_chosen = telemetry.intended_mode == Some(Px4Mode::LOITER);
    !is_chosen && Other::of(telemetry) == Some(Other::Failsafe(Px4Mode::LOITER))
}

/// Time between two commands, until the vehicle shows it.
const AGAIN: Duration = Duration::from_secs(1);
/// Maximum number of commands to land or return without a report of the vehicle's mode.
const UNSEEN: u32 = 5;
/// Maximum number of commands against a hold of PX4 after the vehicle has shown the landing or return. One ends a failsafe.
const AGAINST_HOLD: u32 = 3;
/// How long the command waits for its entry of the audit log.
const AUDITED_WITHIN: Duration = Duration::from_secs(1);
/// Period of 3005 while anything is armed, commanded or executed.
const REPORT_EVERY: Duration = Duration::from_millis(500);
const SUBSYSTEM: SubsystemId = SubsystemId::RecoverySystem;
/// MAV_COMP_ID_AUTOPILOT1.
const AUTOPILOT: u8 = 1;
