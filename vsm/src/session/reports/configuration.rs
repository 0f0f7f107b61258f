//! The configuration phase: reads the vehicle's parameters once its link is up, answers 40000 from them, and sends later
//! changes to configured stations.
//!
//! No right is needed: configuration comes before a grant.

use std::collections::BTreeSet;
use std::time::Duration;

use mapping::airframe::Airframe;
use mapping::configuration::changes::Available;
use mapping::configuration::{self, Level, Request, Scope, Subject, ValuesBy};
use mapping::limits::Performance;
use mapping::mode::Px4Mode;
use mapping::parameter::{NAMES, Parameters};
use mapping::parameter_metadata::ParameterMetadata;
use mavlink_link::service::param::{Name, Value};
use stanag_msgs::Message;
use stanag_msgs::enums::{AckType, AlertPriority, SubsystemId};
use stanag_msgs::messages::FieldConfigurationRequest;

use super::answers::AnswerQueue;
use super::controls::{ControlWatch, values_by};
use crate::config::Provisional;
use crate::session::alerts::Cause;
use crate::session::allowance::Allowance;
use crate::session::context::{Context, MissionView, Origin, ParameterView};
use crate::session::effects::Effects;
use crate::session::limits::PARAMETER_NOTES;
use crate::session::log::LogLevel;

/// The machine.
#[derive(Debug, Default)]
pub(super) struct Configuration {
    parameters: Parameters,
    reading: Reading,
    /// Requests that wait until the parameters are read.
    waiting: Vec<(Origin, Request)>,
    /// Stations that have been configured: they are sent changes.
    configured: BTreeSet<usize>,
    /// The commandable modes last sent to them.
    modes: Option<Available>,
    /// Whether the vehicle hovered at the last check.
    hovered: Option<bool>,
    /// Parameters have changed since the last check: what they had bounded before the first change, and whether the vehicle
    /// hovered then.
    changed: Option<(bool, Vec<Message>)>,
    /// Rate limit of changes in the log.
    notes: Allowance,
    left_out: u32,
    controls: ControlWatch,
}

#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
enum Reading {
    #[default]
    NotYet,
    /// Number of parameters still to be read.
    Left(usize),
    Done,
}

impl Configuration {
    /// The parameters that have been read.
    pub(super) fn parameters(&self) -> ParameterView<'_> {
        ParameterView {
            values: &self.parameters,
            reading: self.is_reading(),
        }
    }

    fn is_reading(&self) -> bool {
        matches!(self.reading, Reading::Left(_))
    }

    /// 40000.
    pub(super) fn configure(
        &mut self,
        context: &Context<'_>,
        mission: &MissionView<'_>,
        origin: Origin,
        request: &FieldConfigurationRequest,
        answers: &mut AnswerQueue,
        effects: &mut Effects<'_>,
    ) {
        if context.provisional(origin.station) == Provisional::Off {
            let why = "its layout is derived from Edition 2, and dli.provisional is off";
            return effects.refuse(Some(origin), why);
        }
        if !context.is_addressed(request.vsm_id) {
            return effects.refuse(Some(origin), "VSM ID is another VSM's");
        }
        let request = match Request::read(request) {
            Ok(request) => request,
            Err(fault) => return effects.refuse(Some(origin), fault.to_string()),
        };
        if matches!(request.scope, Scope::Abort) {
            let mut ended = answers.abort(origin.station);
            let of_it = |(one, _): &mut (Origin, _)| one.station == origin.station;
            ended.extend(self.waiting.extract_if(.., of_it).map(|(one, _)| one));
            // An aborted request still gets a final 17000.
            for ended in ended {
                effects.acknowledge(&ended, AckType::Refused);
            }
        }
        let of_it = |one: &&(Origin, _)| one.0.station == origin.station;
        let waiting = self.waiting.iter().filter(of_it).count();
        if waiting >= MAX_REQUESTS || answers.is_full(origin.station) {
            let why = "too many configuration requests of this station are being answered";
            return effects.refuse(Some(origin), why);
        }
        effects.acknowledge(&origin, AckType::Received);
        // A silent vehicle may never send the rest: answer with what is known.
        if context.vehicle.live() && self.must_wait(&request) {
            return self.waiting.push((origin, request));
        }
        self.answer(context, mission, origin, &request, answers, effects);
    }

    fn answer(
        &mut self,
        context: &Context<'_>,
        mission: &MissionView<'_>,
        origin: Origin,
        request: &Request,
        answers: &mut AnswerQueue,
        effects: &mut Effects<'_>,
    ) {
        let (now, to) = (context.mono(), origin.station);
        let subject = Subject {
            values_by: values_by(context, to),
            ..self.subject(context)
        };
        let all = configuration::answers(&subject, request);
        answers.push(now, to, all, Some(origin));
        // The answer at this level lists the modes that can be commanded now. Changes of them follow from here on.
        if let Scope::Level(Level::Control) = request.scope {
            let available = available_modes(context, mission, &self.parameters);
            self.configured.insert(to);
            self.modes = Some(available);
            answers.push(now, to, available.all(), None);
        } else if request.is_of_controls() {
            self.configured.insert(to);
        }
        answers.send_due(effects);
    }

    /// The vehicle's link is up, for the first time or again: returns the parameters to read, in this order; none if a
    /// reading is in progress.
    pub(super) fn names_to_read(&self) -> Vec<Name> {
        if self.is_reading() {
            return Vec::new();
        }
        // Parameters that limit routes first, because a load waits for them.
        let others = NAMES
            .iter()
            .filter(|name| !Performance::NAMES.contains(name));
        let names = Performance::NAMES.iter().chain(others);
        names.filter_map(|name| Name::new(name).ok()).collect()
    }

    /// This many parameters were requested.
    pub(super) fn begin_reading(&mut self, requested: usize) {
        self.reading = Reading::Left(requested);
    }

    /// This many parameters were received or failed. Waiting requests are answered once all are done.
    pub(super) fn count_read(
        &mut self,
        context: &Context<'_>,
        mission: &MissionView<'_>,
        count: usize,
        answers: &mut AnswerQueue,
        effects: &mut Effects<'_>,
    ) {
        if let Reading::Left(left) = self.reading {
            let left = left.saturating_sub(count);
            self.reading = Reading::Left(left);
            if left == 0 {
                self.end_reading(context, mission, answers, effects);
            }
        }
    }

    /// The vehicle is silent: no further parameters will arrive.
    pub(super) fn stop_reading(
        &mut self,
        context: &Context<'_>,
        mission: &MissionView<'_>,
        answers: &mut AnswerQueue,
        effects: &mut Effects<'_>,
    ) {
        self.controls.stop_reading();
        if self.is_reading() {
            self.end_reading(context, mission, answers, effects);
        } else {
            self.answer_waiting(context, mission, answers, effects);
        }
        self.reading = Reading::NotYet;
    }

    fn end_reading(
        &mut self,
        context: &Context<'_>,
        mission: &MissionView<'_>,
        answers: &mut AnswerQueue,
        effects: &mut Effects<'_>,
    ) {
        self.reading = Reading::Done;
        self.report_own_failsafe(effects);
        self.answer_waiting(context, mission, answers, effects);
    }

    fn must_wait(&self, request: &Request) -> bool {
        self.is_reading() || request.is_of_controls() && self.controls.is_reading()
    }

    /// Answers waiting requests that no longer need to wait.
    pub(super) fn answer_waiting(
        &mut self,
        context: &Context<'_>,
        mission: &MissionView<'_>,
        answers: &mut AnswerQueue,
        effects: &mut Effects<'_>,
    ) {
        for (origin, request) in std::mem::take(&mut self.waiting) {
            if self.must_wait(&request) {
                self.waiting.push((origin, request));
            } else {
                self.answer(context, mission, origin, &request, answers, effects);
            }
        }
    }

    /// One more control was read or does not exist.
    pub(super) fn count_control(
        &mut self,
        context: &Context<'_>,
        mission: &MissionView<'_>,
        answers: &mut AnswerQueue,
        effects: &mut Effects<'_>,
    ) {
        if self.controls.count_read() {
            self.answer_waiting(context, mission, answers, effects);
        }
    }

    /// New metadata of the vehicle's parameters.
    pub(super) fn define_parameters(
        &mut self,
        context: &Context<'_>,
        metadata: ParameterMetadata,
        answers: &mut AnswerQueue,
        effects: &mut Effects<'_>,
    ) {
        let configured = &self.configured;
        self.controls
            .define(context, metadata, configured, answers, effects);
    }

    pub(super) fn controls(&self) -> &ControlWatch {
        &self.controls
    }

    pub(super) fn controls_to_read(
        &mut self,
        context: &Context<'_>,
        effects: &mut Effects<'_>,
    ) -> Vec<Name> {
        self.controls.names_to_read(context, effects)
    }

    /// Keeps a reported value. If it has changed, configured stations are sent the resulting changes at the next check: all
    /// bounds are compared once, however many parameters change. `informed`: stations that receive its 50012 for another
    /// reason.
    pub(super) fn store_parameter(
        &mut self,
        context: &Context<'_>,
        (name, value): (Name, Value),
        informed: &BTreeSet<usize>,
        answers: &mut AnswerQueue,
        effects: &mut Effects<'_>,
    ) {
        let (one, configured) = ((name, value), &self.configured);
        self.controls
            .learn(context, one, configured, informed, answers, effects);
        let value = match value {
            Value::Int(value) => f64::from(value),
            Value::Real(value) => f64::from(value),
        };
        let known = self.parameters.get(name.as_str());
        // Only a change of a known value can change what was reported.
        let changes = value.is_finite() && known.is_some() && known != Some(value);
        if changes && self.changed.is_none() && !self.configured.is_empty() {
            let hovers = context.vehicle.telemetry.hovers();
            self.changed = Some((hovers, self.bounded_as(hovers, context)));
        }
        if !self.parameters.set(name.as_str(), value) || known.is_none() {
            return;
        }
        self.note_change(name, value, effects);
        self.report_own_failsafe(effects);
    }

    fn note_change(&mut self, name: Name, value: f64, effects: &mut Effects<'_>) {
        if !self.notes.take(effects.dli.now.mono, PARAMETER_NOTES) {
            self.left_out += 1;
            return;
        }
        let more = match std::mem::take(&mut self.left_out) {
            0 => String::new(),
            left_out => format!(" ({left_out} changes before it are not logged)"),
        };
        let name = name.as_str();
        let text = format!("the vehicle's parameter {name} is now {value}{more}");
        effects.note(LogLevel::Info, text);
    }

    /// Reports the limits that changed with parameters since the last check.
    pub(super) fn watch_parameters(
        &mut self,
        context: &Context<'_>,
        answers: &mut AnswerQueue,
        effects: &mut Effects<'_>,
    ) {
        let Some((hovers, before)) = self.changed.take() else {
            return;
        };
        let now = self.bounded_as(hovers, context).into_iter();
        let changed: Vec<Message> = now.filter(|message| !before.contains(message)).collect();
        self.report_changes(&changed, None, answers, effects);
    }

    /// Reports by 44003 which modes can be commanded now, if that has changed.
    pub(super) fn watch_modes(
        &mut self,
        context: &Context<'_>,
        mission: &MissionView<'_>,
        answers: &mut AnswerQueue,
        effects: &mut Effects<'_>,
    ) {
        // Without a configured station there is nothing to update.
        if let Some(before) = self.modes {
            let available = available_modes(context, mission, &self.parameters);
            self.modes = Some(available);
            let changed: Vec<Message> = available.changes(&before).collect();
            self.report_changes(&changed, None, answers, effects);
        }
    }

    /// Reports by 41002 and 41003 the limits that change with the state of a VTOL.
    pub(super) fn watch_state(
        &mut self,
        context: &Context<'_>,
        answers: &mut AnswerQueue,
        effects: &mut Effects<'_>,
    ) {
        let hovers = context.vehicle.telemetry.hovers();
        let Some(before) = self.hovered.replace(hovers) else {
            return;
        };
        if before == hovers || self.configured.is_empty() {
            return;
        }
        let [now, before] = [hovers, before].map(|hovers| self.bounded_as(hovers, context));
        let changed: Vec<Message> = now
            .into_iter()
            .filter(|message| !before.contains(message))
            .collect();
        self.report_changes(&changed, None, answers, effects);
    }

    /// Sends changes to the configured stations, except the one that made them.
    pub(super) fn report_changes(
        &self,
        changed: &[Message],
        by: Option<usize>,
        answers: &mut AnswerQueue,
        effects: &mut Effects<'_>,
    ) {
        if changed.is_empty() {
            return;
        }
        let now: Duration = effects.dli.now.mono;
        let others = self.configured.iter().filter(|index| Some(**index) != by);
        for station in others {
            // A station that does not take its answers must not make the queue grow.
            if answers.is_full(*station) {
                continue;
            }
            answers.push(now, *station, changed.iter().cloned(), None);
        }
        answers.send_due(effects);
    }

    /// The answers that depend on parameters, in a fixed order, as of a VTOL in this state.
    fn bounded_as(&self, hovers: bool, context: &Context<'_>) -> Vec<Message> {
        let subject = Subject {
            hovers,
            ..self.subject(context)
        };
        [Level::Status, Level::Control]
            .into_iter()
            .flat_map(|level| {
                let scope = Scope::Level(level);
                configuration::answers(&subject, &Request { scope })
            })
            .collect()
    }

    fn subject<'a>(&'a self, context: &Context<'a>) -> Subject<'a> {
        let telemetry = &context.vehicle.telemetry;
        Subject {
            vsm: context.vsm,
            vehicle_type: context.vehicle.vehicle_type(),
            hovers: telemetry.hovers(),
            vtol: telemetry.airframe() == Airframe::Vtol,
            home: telemetry.home,
            limits: context.bounds.limits.of(&self.parameters),
            agl: context.bounds.agl,
            parameters: &self.parameters,
            web_page: context.settings.web_page.as_deref(),
            controls: self.controls.controls(),
            values_by: ValuesBy::Field,
        }
    }

    /// PX4's own reaction to the loss of this VSM, as set by its parameters. It is changed only on command.
    fn report_own_failsafe(&self, effects: &mut Effects<'_>) {
        let parameters = &self.parameters;
        let (Some(action), Some(after_s)) =
            (parameters.get(LOSS_ACTION), parameters.get(LOSS_TIME))
        else {
            return;
        };
        let text = format!(
            "without this link the vehicle {} after {after_s} s (NAV_DLL_ACT {action}, COM_DL_LOSS_T {after_s})",
            own_failsafe(action)
        );
        let (nominal, comms) = (AlertPriority::Nominal, SubsystemId::Comms);
        effects.raise(Cause::OwnFailsafe, nominal, comms, text);
    }
}

/// What flight accepts now, as far as the vehicle has reported it. An unavailable mode may not be offered by a station: one
/// that is commanded and not shown yet changes nothing here before the vehicle shows it.
fn available_modes(
    context: &Context<'_>,
    mission: &MissionView<'_>,
    parameters: &Parameters,
) -> Available {
    let telemetry = &context.vehicle.telemetry;
    let route = mission.uploaded.or(mission.loaded).is_some();
    let lands = || {
        let seq = telemetry.mission?.seq;
        Some(mission.uploaded?.compiled.lands(seq))
    };
    Available {
        manual: parameters.ignores_sticks().is_none()
            && parameters.falls_without_sticks().is_none(),
        waypoint: route && !(telemetry.airframe().has_wings() && telemetry.stands()),
        autopilot: telemetry.airborne(),
        wave_off: match telemetry.mode {
            Some(Px4Mode::LAND) => !(telemetry.hovers() && telemetry.stands()),
            Some(Px4Mode::MISSION) => lands() == Some(true),
            _ => false,
        },
        // Before it has reported where it is, it may be in the air.
        launch: telemetry.stands(),
    }
}

/// NAV_DLL_ACT as PX4 documents it.
fn own_failsafe(action: f64) -> &'static str {
    match action as i64 {
        0 => "continues unchanged",
        1 => "holds",
        2 => "returns",
        3 => "lands",
        5 => "terminates its flight",
        6 => "disarms",
        _ => "takes an action unknown to this VSM",
    }
}

/// PX4's action when it loses the ground station.
const LOSS_ACTION: &str = "NAV_DLL_ACT";
/// After how long it does so, s.
const LOSS_TIME: &str = "COM_DL_LOSS_T";
/// Requests of one station that wait until the parameters are read. Each is answered by up to 200 messages.
const MAX_REQUESTS: usize = 16;
