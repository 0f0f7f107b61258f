//! Reports to the stations of one vehicle: on schedule, on request and on change; and the configuration messages.
//!
//! - `compose`: composes the reports from the vehicle's state; `push`: when each is due, for each station (17001)
//! - `requests`: requests to the vehicle for a single answer: its software versions, a ping
//! - `answers`: answers of many messages, a few at a time
//! - `configuration`: the configuration phase (40000), and changes of what it has reported
//! - `controls`: parameters that stations are offered as controls
//! - `parameters`: the vehicle's parameters for stations (50010 to 50012); `settings`: for `vsm check-vehicle`
//! - `data_link`: the link as stations see it (28000 to 32400)
//! - `events`: the vehicle's EVENTs and STATUSTEXTs, each reported once
//! - `health`: the vehicle's reported health, as alerts and as subsystem status (15000, 15001)

mod answers;
mod compose;
mod configuration;
mod controls;
mod data_link;
mod events;
mod health;
mod parameters;
mod push;
mod requests;
mod settings;
#[cfg(test)]
mod tests;

use std::collections::BTreeSet;
use std::time::Duration;

use mapping::configuration::changes;
use mapping::data_link::DataLink;
use mapping::event::Catalogue;
use mapping::mode::Px4Mode;
use mapping::parameter_metadata::ParameterMetadata;
use mapping::{hardening, parameter};
use mavlink_link::service::param::{self, Event};
use mavlink_link::service::{event, text};
use stanag_msgs::enums::{AlertPriority, SubsystemId};
use stanag_msgs::messages::{
    FieldConfigurationRequest, GenericInformationRequestMessage, ScheduleMessageUpdateCommand,
    SoftwareVersionReport, SubsystemStatusReport,
};
use stanag_msgs::{Message, table};

use self::answers::AnswerQueue;
use self::compose::{DETAILS, REPORTS, Sources};
use self::configuration::Configuration;
use self::events::{AUTOPILOT_SUBSYSTEM, EventAlerts};
use self::health::HealthWatch;
use self::parameters::{ParameterRequests, Purpose};
use self::push::{Period, Push};
use self::requests::Requests;
use self::settings::SettingsReading;
pub use self::settings::VehicleSettings;
use super::alerts::{Alerts, Cause};
use super::allowance::Allowance;
use super::context::{self, FlightView, MissionView, Origin, ParameterView};
use super::effects::Effects;
use super::ignored_fields;
use super::limits::MODES;
use super::payload::PayloadView;
use super::station::GroundStation;
use crate::config::Provisional;

/// The machine.
#[derive(Debug, Default)]
pub(crate) struct Reports {
    push: Push,
    /// The listener at which publishing on schedule stopped, and when: it continues there at once.
    unfinished: Option<(usize, Duration)>,
    requests: Requests,
    answers: AnswerQueue,
    configuration: Configuration,
    parameters: ParameterRequests,
    settings: SettingsReading,
    health: HealthWatch,
    events: EventAlerts,
    identity: Option<Identity>,
    /// Fields without effect that were already reported to stations: station, message, field.
    ignored: BTreeSet<(usize, u16, u8)>,
    /// Reports of a change of mode.
    modes: Allowance,
    /// Reports of a change of UA State.
    states: Allowance,
}

/// The changeable values last reported by message 3: tail number and Mission ID.
type Identity = (String, Option<String>);

/// What it reads.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Context<'a> {
    pub(crate) common: context::Context<'a>,
    pub(crate) mission: MissionView<'a>,
    pub(crate) flight: FlightView<'a>,
    pub(crate) payload: PayloadView<'a>,
    pub(crate) link: DataLink,
}

context::deref_to_common!(Context);

/// An input.
#[derive(Debug)]
pub(crate) enum Input<'a> {
    /// 50010, 50011, 50014, 15000 or 15001 of a CUCS that holds the right.
    Command {
        origin: Origin,
        message: &'a Message,
    },
    /// 40000.
    Configure {
        origin: Origin,
        request: &'a FieldConfigurationRequest,
    },
    /// 17001 of a station that holds LOI 2.
    Schedule {
        station: usize,
        command: &'a ScheduleMessageUpdateCommand,
    },
    /// 17002 of a station that holds LOI 2.
    ReportOnce {
        station: usize,
        request: &'a GenericInformationRequestMessage,
    },
    /// A command is about to be carried out: reports once to its station the fields that never have an effect.
    NoteIgnored {
        origin: &'a Origin,
        message: &'a Message,
    },
    /// The station has gained or lost LOI 2: its schedule is forgotten.
    ListenerChanged {
        station: usize,
    },
    /// A heartbeat after silence, or the first.
    LinkUp,
    /// The vehicle is silent.
    LinkDown,
    /// The vehicle has restarted.
    Restarted,
    ModeChanged,
    /// UA State alone has changed.
    StateChanged,
    ParameterServiceEnded(param::Event),
    /// The vehicle reports an unrequested parameter: another system has changed it.
    ParameterReported(param::Name, param::Value),
    /// `vsm check-vehicle`.
    ReadSettings,
    PingReturned(u32),
    /// A text of the vehicle.
    Text(text::Text),
    /// An event of the vehicle.
    Event(event::Event),
    /// The definitions of the vehicle's events.
    DefineEvents(Catalogue),
    /// The metadata of the vehicle's parameters.
    DefineParameters(ParameterMetadata),
    /// These configuration values have changed; `by` already knows.
    Configured {
        changed: Vec<Message>,
        by: Option<usize>,
    },
    /// Send these a few at a time, then acknowledge `origin` as carried out.
    AnswerLater {
        station: usize,
        answers: Vec<Message>,
        origin: Option<Origin>,
    },
    /// Reports by 44003 which modes can be commanded now, if that has changed.
    WatchModes,
    /// Sends message 3 if tail number or Mission ID has changed.
    WatchIdentity,
    SendConfiguration,
    WatchRequests,
    WatchHealth,
    ClearAnswers,
    /// Sends the reports that are due.
    PushDue,
}

impl Reports {
    /// The bridge did not run for so long.
    pub(crate) fn note_stop(&mut self, stopped: Duration) {
        self.health.note_stop(stopped);
    }

    /// The vehicle's parameters, as far as they have been read.
    pub(crate) fn parameters(&self) -> ParameterView<'_> {
        self.configuration.parameters()
    }

    /// Takes an input.
    ///
    /// # Errors
    /// The reason, for the operator; for 17001 and 17002 only. The caller answers.
    pub(crate) fn handle(
        &mut self,
        context: &Context<'_>,
        input: Input<'_>,
        effects: &mut Effects<'_>,
    ) -> Result<(), String> {
        let (common, mission) = (&context.common, &context.mission);
        let answers = &mut self.answers;
        match input {
            Input::Command { origin, message } => self.command(context, origin, message, effects),
            Input::Configure { origin, request } => {
                let configuration = &mut self.configuration;
                configuration.configure(common, mission, origin, request, answers, effects);
            }
            Input::Schedule { station, command } => {
                return self.schedule(context, station, command);
            }
            Input::ReportOnce { station, request } => {
                return self.report_once(context, station, request, effects);
            }
            Input::NoteIgnored { origin, message } => self.note_ignored(origin, message, effects),
            Input::ListenerChanged { station } => {
                self.push.forget(station);
                if effects.listeners.contains(&station) {
                    self.push.begin(common.mono(), station);
                }
                self.ignored.retain(|(of, _, _)| *of != station);
                self.parameters.forget(station);
            }
            Input::LinkUp => {
                effects.clear(Cause::VehicleSilent, "link to the vehicle is up");
                self.report_changed(context, &[3001, 3002], effects);
                // They may have changed during the silence, or by a restart.
                self.read_parameters(context, effects);
            }
            Input::LinkDown => {
                let configuration = &mut self.configuration;
                configuration.stop_reading(common, mission, answers, effects);
                self.parameters.drop_configuration();
                self.parameters.drop_controls();
                self.settings.give_up();
                effects.raise(
                    Cause::VehicleSilent,
                    AlertPriority::Warning,
                    SubsystemId::Comms,
                    "no data from the vehicle: state unknown",
                );
                self.report_changed(context, &[3001, 3002], effects);
            }
            Input::Restarted => {
                self.read_parameters(context, effects);
                self.events.restart(effects);
                let text = "the autopilot has restarted";
                effects.notify(AlertPriority::Warning, AUTOPILOT_SUBSYSTEM, text);
            }
            // If a vehicle changes its mode or state with every frame, the scheduled reports are enough.
            Input::StateChanged if !self.states.take(common.mono(), MODES) => {}
            // A transition of a VTOL may begin and end between two scheduled reports.
            Input::StateChanged => self.report_changed(context, &[3002], effects),
            Input::ModeChanged if !self.modes.take(common.mono(), MODES) => {}
            Input::ModeChanged => {
                self.report_changed(context, &[3001, 3002], effects);
                let mode = common.vehicle.telemetry.mode.map(Px4Mode::reported);
                if let Some(changed) = mode.and_then(changes::mode) {
                    self.configuration
                        .report_changes(&[changed], None, &mut self.answers, effects);
                }
            }
            Input::ParameterServiceEnded(event) => self.parameter_ended(context, event, effects),
            Input::ParameterReported(name, value) => {
                let before = self.learn_parameter(context, name, value, None, effects);
                // A first value is not a change; a later, unrequested one was set by another station.
                if let Some(before) = before.filter(|before| *before != value) {
                    effects.advise(parameters::foreign_change(name, value, before));
                }
            }
            Input::ReadSettings => self.read_settings(context, effects),
            Input::PingReturned(seq) => self.requests.ping_returned(seq, effects),
            Input::Text(text) => self.events.text(common, text, effects),
            Input::Event(event) => self.events.event(common, &event, effects),
            Input::DefineEvents(catalogue) => self.events.define(catalogue),
            Input::DefineParameters(metadata) => {
                // Names of another firmware are no longer read.
                self.parameters.drop_controls();
                let configuration = &mut self.configuration;
                configuration.define_parameters(common, metadata, answers, effects);
                self.read_controls(context, effects);
            }
            Input::Configured { changed, by } => {
                self.configuration
                    .report_changes(&changed, by, answers, effects);
            }
            Input::AnswerLater {
                station,
                answers: all,
                origin,
            } => answers.answer(station, all, origin, effects),
            Input::WatchModes => {
                self.configuration
                    .watch_modes(common, mission, answers, effects);
                self.configuration.watch_state(common, answers, effects);
                self.configuration
                    .watch_parameters(common, answers, effects);
            }
            Input::WatchIdentity => self.watch_identity(context, effects),
            Input::SendConfiguration => answers.send_due(effects),
            Input::WatchRequests => self.requests.watch(common, effects),
            Input::WatchHealth => {
                let parameters = self.configuration.parameters().values;
                self.health.watch(common, parameters, effects);
                self.events.watch(common, effects);
            }
            Input::ClearAnswers => {
                effects.show_late();
                while let Some((to, raised)) = effects.alerts.next_over(common.mono()) {
                    effects.dli.show(common.id(), &to, &raised);
                }
            }
            Input::PushDue => self.push_due(context, effects),
        }
        Ok(())
    }

    /// When a timed input is next due.
    pub(crate) fn poll_timeout(&self, alerts: &Alerts) -> Option<Duration> {
        // By name, as in the router.
        let Reports {
            push,
            requests,
            answers,
            health,
            events,
            unfinished,
            configuration: _,
            parameters: _,
            settings: _,
            identity: _,
            ignored: _,
            modes: _,
            states: _,
        } = self;
        [
            push.poll_timeout(),
            unfinished.map(|(_, at)| at),
            requests.poll_timeout(),
            answers.poll_timeout(),
            health.poll_timeout(),
            events.poll_timeout(),
            alerts.poll_timeout(),
        ]
        .into_iter()
        .flatten()
        .min()
    }

    /// A load or a new configuration has changed message 3; a new listener receives it with its grant.
    fn watch_identity(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let tail_number = &context.config.tail_number;
        let mission_id = context
            .mission
            .uploaded
            .map(|uploaded| &uploaded.mission_name);
        let known = self.identity.as_ref();
        if known
            .is_some_and(|(tail, mission)| tail == tail_number && mission.as_ref() == mission_id)
        {
            return;
        }
        let now = (tail_number.clone(), mission_id.cloned());
        if self.identity.replace(now).is_some() {
            let report = context.vehicle_id(&context.mission, effects.stamp());
            effects.publish_to_listeners(&report.into());
        }
    }

    fn sources<'a>(&'a self, context: &Context<'a>) -> Sources<'a> {
        Sources {
            common: context.common,
            mission: context.mission,
            flight: context.flight,
            payload: context.payload,
            link: context.link,
            parameters: self.configuration.parameters().values,
        }
    }
}

/// Commands and requests.
impl Reports {
    fn command(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        message: &Message,
        effects: &mut Effects<'_>,
    ) {
        let common = &context.common;
        match message {
            Message::ParameterRequest(request) => {
                self.parameters.request(common, origin, request, effects);
            }
            Message::ParameterSetCommand(command) => {
                let controls = self.configuration.controls();
                self.parameters
                    .set(common, origin, command, controls, effects);
            }
            Message::PingRequest(request) => {
                self.requests.ping(common, origin, request, effects);
            }
            Message::DataLinkControlRequest(request) => {
                data_link::control_request(common, origin, request, effects);
            }
            Message::SubsystemStatusRequest(request) => {
                compose::request_streams(SubsystemStatusReport::ID, effects);
                let parameters = self.configuration.parameters().values;
                health::subsystem_status(common, parameters, origin, request, effects);
            }
            Message::SubsystemStatusDetailRequest(request) => {
                health::subsystem_detail(common, origin, request, effects);
            }
            other => debug_assert!(false, "message {} is not a report request", other.id()),
        }
    }

    /// 17001.
    fn schedule(
        &mut self,
        context: &Context<'_>,
        station: usize,
        command: &ScheduleMessageUpdateCommand,
    ) -> Result<(), String> {
        let message = command
            .requested_message_type
            .ok_or("Requested Message Type is missing")?;
        let hertz = command.frequency.ok_or("Frequency is missing")?;
        known_report(message)?;
        in_use(context, station, message)?;
        if hertz > MAX_HERTZ {
            return Err(format!(
                "Frequency {hertz} Hz, expected 1 to {MAX_HERTZ}, or 0 to stop"
            ));
        }
        let period = match hertz {
            0 => Period::Never,
            hertz => Period::Every(Duration::from_secs(1) / u32::from(hertz)),
        };
        self.push.schedule(station, message, period);
        Ok(())
    }

    /// 17002: a report, at once, of all its fields or those requested.
    fn report_once(
        &mut self,
        context: &Context<'_>,
        station: usize,
        request: &GenericInformationRequestMessage,
        effects: &mut Effects<'_>,
    ) -> Result<(), String> {
        let message = request.message_type.ok_or("Message Type is missing")?;
        let fields = request.requested_field_presence_vector.map(|all| all.get());
        if message == SoftwareVersionReport::ID {
            self.requests
                .software(&context.common, station, fields, effects);
            return Ok(());
        }
        known_report(message)?;
        in_use(context, station, message)?;
        let mut reports = compose::all(&self.sources(context), station, message, effects);
        let named = request.station_number_1_16.map_or(0, |named| named.raw());
        if named != 0 {
            reports.retain(|report| {
                compose::station_bits(report).is_none_or(|bits| bits & named != 0)
            });
        }
        for report in &reports {
            match fields {
                // An empty vector requests nothing in particular.
                None | Some(0) => effects.send(station, report),
                Some(fields) => effects.send(station, &table::select(report, fields)),
            }
        }
        if reports.is_empty() {
            return Err(format!(
                "no data received yet for message {}",
                table::named(message)
            ));
        }
        Ok(())
    }

    /// Reports once to a station each used field of its messages that never has an effect in this VSM.
    fn note_ignored(&mut self, origin: &Origin, message: &Message, effects: &mut Effects<'_>) {
        let unused = ignored_fields::unused_fields(message).into_iter();
        let names: Vec<&str> = unused
            .filter(|field| {
                self.ignored
                    .insert((origin.station, message.id(), field.bit))
            })
            .map(|field| field.name)
            .collect();
        if let Some(text) = ignored_fields::report(origin.message_type, &names, "") {
            effects.answer(&[origin.station], text);
        }
    }
}

/// Reports on schedule and on change.
impl Reports {
    /// Publishes what is due, [`MAX_AT_ONCE`] at most: with fifty stations that began to listen together all would be due together,
    /// and a command would wait behind them. The rest is still due, at once, after what has arrived meanwhile; it begins with the station
    /// that is next, so that none is always the last.
    fn push_due(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let listeners = effects.listeners.len();
        let first = self.unfinished.take().map_or(0, |(listener, _)| listener);
        let mut published = 0;
        for turn in 0..listeners {
            let index = (first + turn) % listeners;
            let station = effects.listeners[index];
            let steers = |one: &GroundStation| context.payload.steers(one.id());
            let payload = (context.stations.get(station)).is_some_and(steers)
                && context.provisional(station) != Provisional::Off;
            loop {
                if published == MAX_AT_ONCE {
                    self.unfinished = Some((index, context.mono()));
                    return;
                }
                let Some(message) = self.push.next_due(context.mono(), station, payload) else {
                    break;
                };
                published += 1;
                if DETAILS.contains(&message) {
                    for report in compose::all(&self.sources(context), station, message, effects) {
                        effects.publish(station, &report);
                    }
                    continue;
                }
                // Do not use `all`: the regularly pushed reports must not allocate.
                let sources = self.sources(context);
                let stamp = compose::stamp(&sources, station, message, effects);
                if let Some(report) = compose::one(&sources, message, stamp) {
                    effects.publish(station, &report);
                }
            }
        }
    }

    /// Of 3001 and 3002 what has changed, in addition to their schedule.
    fn report_changed(&self, context: &Context<'_>, messages: &[u16], effects: &mut Effects<'_>) {
        for message in messages {
            let stamp = effects.stamp();
            if let Some(report) = compose::one(&self.sources(context), *message, stamp) {
                effects.publish_to_listeners(&report);
            }
        }
    }
}

/// The vehicle's parameters.
impl Reports {
    fn read_parameters(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let names = self.configuration.names_to_read();
        if names.is_empty() {
            return;
        }
        self.configuration.begin_reading(names.len());
        self.parameters
            .read_for_configuration(&context.common, names, effects);
        self.read_controls(context, effects);
    }

    fn read_controls(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        // With a silent vehicle each would wait for its retries; they are read once its link is up.
        if !context.vehicle.live() {
            return;
        }
        let common = &context.common;
        let names = self.configuration.controls_to_read(common, effects);
        self.parameters.read_controls(common, names, effects);
        if !self.configuration.controls().is_reading() {
            let (mission, answers) = (&context.mission, &mut self.answers);
            // Nothing has to be read, so no answer of the vehicle would release the requests that wait for the controls.
            (self.configuration).answer_waiting(common, mission, answers, effects);
        }
    }

    fn read_settings(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let names = hardening::SETTINGS.iter().map(|setting| setting.name);
        self.settings
            .begin(names.filter_map(|name| param::Name::new(name).ok()));
        // A silent vehicle would cost each of them its retries.
        if !context.vehicle.live() {
            self.settings.give_up();
        }
        self.read_next_setting(context, effects);
    }

    fn read_next_setting(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        if let Some(name) = self.settings.next() {
            (self.parameters).read_setting(&context.common, name, effects);
        }
    }

    /// What the vehicle has answered about its settings so far.
    pub(crate) fn settings(&self) -> VehicleSettings {
        self.settings.found()
    }

    fn count_read(&mut self, context: &Context<'_>, count: usize, effects: &mut Effects<'_>) {
        let (common, mission) = (&context.common, &context.mission);
        self.configuration
            .count_read(common, mission, count, &mut self.answers, effects);
    }

    /// The end of a request, or its progress.
    fn parameter_ended(&mut self, context: &Context<'_>, event: Event, effects: &mut Effects<'_>) {
        if let Event::Progress { .. } = event {
            return;
        }
        let (purpose, sets) = self.parameters.ended().unzip();
        let ended = (purpose, sets == Some(true));
        self.answer_parameter(context, ended, event, effects);
        self.parameters.advance(&context.common, effects);
    }

    fn answer_parameter(
        &mut self,
        context: &Context<'_>,
        (purpose, sets): (Option<Purpose>, bool),
        event: Event,
        effects: &mut Effects<'_>,
    ) {
        let origin = match purpose {
            None => return,
            Some(Purpose::Nobody) => {
                if let Event::Read { name, value } = event {
                    self.learn_parameter(context, name, value, None, effects);
                }
                return;
            }
            Some(Purpose::Configuration) => {
                // A vehicle without this parameter is limited by the others.
                if let Event::Read { name, value } = event {
                    self.learn_parameter(context, name, value, None, effects);
                }
                return self.count_read(context, 1, effects);
            }
            Some(Purpose::Controls) => {
                // A name that the vehicle does not have is not a control.
                if let Event::Read { name, value } = event {
                    self.learn_parameter(context, name, value, None, effects);
                }
                let (common, mission) = (&context.common, &context.mission);
                let answers = &mut self.answers;
                return (self.configuration).count_control(common, mission, answers, effects);
            }
            Some(Purpose::Settings) => {
                self.settings.ended(&event);
                if let Event::Read { name, value } = event {
                    self.learn_parameter(context, name, value, None, effects);
                }
                return self.read_next_setting(context, effects);
            }
            Some(Purpose::Station(origin)) => origin,
        };
        let station = origin.station;
        if let Some(why) = parameters::refusal(&event, sets) {
            return effects.refuse(Some(origin), why);
        }
        match event {
            Event::Read { name, value } | Event::Set { name, value } => {
                self.learn_parameter(context, name, value, Some(station), effects);
                let described = self.metadata().get(name.as_str());
                if sets && parameter::applies_after_restart(name.as_str(), described) {
                    effects.advise(format!(
                        "parameter {name} is stored: the vehicle uses it once it has restarted"
                    ));
                }
                let report = parameters::report(name, value, self.metadata());
                self.answers
                    .answer(station, [report], Some(origin), effects);
            }
            Event::List { entries, .. } => {
                let count = u16::try_from(entries.len()).unwrap_or(u16::MAX);
                let all: Vec<Message> = (0..)
                    .zip(&entries)
                    .map(|(index, entry)| {
                        let (name, place) = (entry.name.as_str(), Some((index, count)));
                        let described = self.metadata().get(name);
                        parameter::report(name, entry.value, described, place).into()
                    })
                    .collect();
                // The requester counts as `asker`: it receives the same values in the list.
                for entry in entries {
                    let (name, value) = (entry.name, entry.value);
                    self.learn_parameter(context, name, value, Some(station), effects);
                }
                self.answers.answer(station, all, Some(origin), effects);
            }
            Event::Progress { .. } | Event::Refused { .. } | Event::ListFailed { .. } => {}
        }
    }

    fn metadata(&self) -> &ParameterMetadata {
        self.configuration.controls().controls().metadata()
    }

    /// Stores a value. If it has changed, sends it to all stations that follow the parameter, except `asker`, which follows
    /// it from now on. Returns the previous value.
    fn learn_parameter(
        &mut self,
        context: &Context<'_>,
        name: param::Name,
        value: param::Value,
        asker: Option<usize>,
        effects: &mut Effects<'_>,
    ) -> Option<param::Value> {
        let mut informed = self.parameters.followers(name);
        informed.extend(asker);
        let (common, one) = (&context.common, (name, value));
        (self.configuration).store_parameter(common, one, &informed, &mut self.answers, effects);
        let before = self.parameters.learn(name, value, asker)?;
        if before != value {
            let followers = self.parameters.followers(name);
            for station in followers.into_iter().filter(|one| Some(*one) != asker) {
                let report = parameters::report(name, value, self.metadata());
                self.answers.answer(station, [report], None, effects);
            }
        }
        Some(before)
    }
}

/// Reports whose layouts are derived from Edition 2 are sent unless the configuration switches them off.
fn in_use(context: &Context<'_>, station: usize, message: u16) -> Result<(), String> {
    if compose::PAYLOAD.contains(&message) && context.provisional(station) == Provisional::Off {
        return Err(format!(
            "message {} is derived from Edition 2, and dli.provisional is off",
            table::named(message)
        ));
    }
    Ok(())
}

fn known_report(message: u16) -> Result<(), String> {
    if REPORTS.contains(&message) || DETAILS.contains(&message) {
        return Ok(());
    }
    let named = table::named(message);
    // 17003, 32301: their layout is known except for the one field that matters.
    let fields = table::message(message).map_or(&[][..], |info| info.fields);
    let unsized_field = fields.iter().find(|field| field.wire.bytes().is_none());
    Err(match unsized_field {
        Some(field) => format!(
            "message {named} is not sent: no source establishes the length of its field {}",
            field.name
        ),
        None => format!("message {named} is not a report of this VSM"),
    })
}

/// The range that Edition 2 gives for 17001's Frequency.
const MAX_HERTZ: u16 = 100;
/// Reports published on schedule in one call.
const MAX_AT_ONCE: usize = 32;
