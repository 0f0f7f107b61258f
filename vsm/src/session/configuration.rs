//! The configuration phase of one vehicle: its parameters are read once it is there, 40000 is answered from them, and
//! what changes later is told to those that have asked.
//!
//! No right is needed: configuration comes before a grant. Answers go out a few at a time, so that they do not flood
//! the buffers of a small ground station; 17000 "carried out" follows the last.

use std::collections::{BTreeSet, VecDeque};
use std::time::Duration;

use mapping::configuration::changes::Available;
use mapping::configuration::{self, Level, Request, RequestError, Scope, Subject};
use mapping::limits::Performance;
use mapping::parameter::{NAMES, Parameters};
use mavlink_link::dialect::MavType;
use mavlink_link::service::param::{Name, Value};
use stanag_msgs::enums::AckType;
use stanag_msgs::messages::FieldConfigurationRequest;
use stanag_msgs::{Id, Message, TimeStamp};

use super::aircraft::Aircraft;
use super::desk::{Desk, Origin};
use super::log::LogLevel;
use crate::config::{Config, Provisional};

/// The machine.
#[derive(Debug, Default)]
pub(crate) struct Configuration {
    provisional: Provisional,
    web_page: Option<String>,
    parameters: Parameters,
    reading: Reading,
    /// Requests that wait until the parameters are read.
    waiting: Vec<(Origin, Request)>,
    queue: VecDeque<Outgoing>,
    due: Option<Duration>,
    /// Stations that have been configured: changes are told to them.
    told: BTreeSet<usize>,
    /// What they were told of the modes that can be commanded now.
    modes: Option<Available>,
}

#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
enum Reading {
    #[default]
    NotYet,
    /// So many parameters are still to come.
    Left(usize),
    Done,
}

#[derive(Debug)]
enum Outgoing {
    Answer(usize, Box<Message>),
    Done(Origin),
}

impl Configuration {
    /// What the configuration file says of it.
    pub(crate) fn of(config: &Config) -> Configuration {
        let web_page = config
            .http
            .as_ref()
            .map(|http| format!("http://{}/", http.listen));
        Configuration {
            provisional: config.dli.provisional,
            web_page,
            ..Configuration::default()
        }
    }

    /// When the next answers are due.
    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        self.due
    }
}

impl Aircraft {
    /// 40000.
    pub(super) fn configure(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        request: &FieldConfigurationRequest,
    ) {
        if self.configuration.provisional == Provisional::Off {
            let why = "its layout is derived from Edition 2, and dli.provisional is off".to_owned();
            return self.refuse(desk, Some(origin), why);
        }
        if !desk.is_meant(request.vsm_id) {
            return self.refuse(desk, Some(origin), "VSM ID is another VSM's".to_owned());
        }
        let request = match Request::read(request) {
            Ok(request) => request,
            Err(fault) => return self.refuse_configuration(desk, origin, fault),
        };
        if matches!(request.scope, Scope::Abort) {
            self.abort_configuration(desk, origin.station);
        }
        if self.configuration.queue.len() + self.configuration.waiting.len() > MAX_WAITING {
            let why = "too many configuration requests are being answered".to_owned();
            return self.refuse(desk, Some(origin), why);
        }
        desk.acknowledge(self.id(), &origin, AckType::Received);
        if self.mav.live() && matches!(self.configuration.reading, Reading::Left(_)) {
            return self.configuration.waiting.push((origin, request));
        }
        self.answer_configuration(desk, origin, &request);
    }

    fn refuse_configuration(&mut self, desk: &mut Desk<'_>, origin: Origin, fault: RequestError) {
        self.refuse(desk, Some(origin), fault.to_string());
    }

    fn answer_configuration(&mut self, desk: &mut Desk<'_>, origin: Origin, request: &Request) {
        let answers = configuration::answers(&self.subject(desk.vsm), request);
        let available = self.available_modes();
        let machine = &mut self.configuration;
        let to = origin.station;
        let answers = answers.into_iter();
        machine
            .queue
            .extend(answers.map(|answer| Outgoing::Answer(to, Box::new(answer))));
        machine.queue.push_back(Outgoing::Done(origin));
        machine.due.get_or_insert(desk.now.mono);
        if let Scope::Level(Level::Control) = request.scope {
            machine.told.insert(to);
            machine.modes = Some(available);
            let changes = available
                .all()
                .map(|said| Outgoing::Answer(to, Box::new(said)));
            machine.queue.extend(changes);
        }
        self.send_configuration(desk);
    }

    fn abort_configuration(&mut self, desk: &mut Desk<'_>, station: usize) {
        let machine = &mut self.configuration;
        let mut ended = Vec::new();
        machine.queue.retain(|outgoing| match outgoing {
            Outgoing::Answer(to, _) => *to != station,
            Outgoing::Done(origin) => {
                if origin.station == station {
                    ended.push(*origin);
                }
                origin.station != station
            }
        });
        machine.waiting.retain(|(origin, _)| {
            if origin.station == station {
                ended.push(*origin);
            }
            origin.station != station
        });
        for origin in ended {
            desk.acknowledge(self.id(), &origin, AckType::Refused);
        }
    }

    /// Sends what is due.
    pub(super) fn send_configuration(&mut self, desk: &mut Desk<'_>) {
        if self.configuration.due.is_none_or(|due| due > desk.now.mono) {
            return;
        }
        let id = self.id();
        for _ in 0..BURST {
            match self.configuration.queue.pop_front() {
                None => break,
                Some(Outgoing::Answer(to, answer)) => {
                    let answer = stamped(*answer, desk.stamp());
                    desk.send(to, id, &answer);
                }
                Some(Outgoing::Done(origin)) => {
                    desk.acknowledge(id, &origin, AckType::CarriedOut);
                }
            }
        }
        self.configuration.due = if self.configuration.queue.is_empty() {
            None
        } else {
            Some(desk.now.mono + PAUSE)
        };
    }

    /// The vehicle is there, or there again: its parameters are read.
    pub(super) fn read_parameters(&mut self, desk: &mut Desk<'_>) {
        if matches!(self.configuration.reading, Reading::Left(_)) {
            return;
        }
        // What bounds routes first: a load waits for it.
        let others = NAMES
            .iter()
            .filter(|name| !Performance::NAMES.contains(name));
        let names = Performance::NAMES.iter().chain(others);
        let names = names.filter_map(|name| Name::new(name).ok());
        let mut asked = 0;
        for name in names {
            asked += usize::from(self.read_for_configuration(desk, name));
        }
        self.configuration.reading = Reading::Left(asked);
        self.parameters_came(desk, 0);
    }

    /// So many of the parameters that the configuration phase needs have come, or will not.
    pub(super) fn parameters_came(&mut self, desk: &mut Desk<'_>, count: usize) {
        let Reading::Left(left) = self.configuration.reading else {
            return;
        };
        let left = left.saturating_sub(count);
        self.configuration.reading = Reading::Left(left);
        if left == 0 {
            self.end_reading(desk);
        }
    }

    /// The parameters that the configuration phase has read.
    pub(super) fn configured_parameters(&self) -> &Parameters {
        &self.configuration.parameters
    }

    /// A parameter of the vehicle, where it is known.
    pub(super) fn parameter(&self, name: &str) -> Option<f64> {
        self.configuration.parameters.get(name)
    }

    /// All parameters have come, or no more will: who has waited is answered.
    fn end_reading(&mut self, desk: &mut Desk<'_>) {
        self.configuration.reading = Reading::Done;
        self.say_own_failsafe(desk);
        for (origin, request) in std::mem::take(&mut self.configuration.waiting) {
            self.answer_configuration(desk, origin, &request);
        }
    }

    /// The vehicle is silent: what is known is all that will be.
    pub(super) fn stop_reading(&mut self, desk: &mut Desk<'_>) {
        if let Reading::Left(_) = self.configuration.reading {
            self.end_reading(desk);
        }
        self.configuration.reading = Reading::NotYet;
    }

    /// A value that the vehicle has told; where it is another, those that were configured are told what it changes.
    pub(super) fn keep_parameter(&mut self, desk: &mut Desk<'_>, name: Name, value: Value) {
        let value = match value {
            Value::Int(value) => f64::from(value),
            Value::Real(value) => f64::from(value),
        };
        let known = self.configuration.parameters.get(name.as_str()).is_some();
        let before = self.bounded(desk.vsm);
        if !self.configuration.parameters.set(name.as_str(), value) {
            return;
        }
        self.bounds.curving.know(&self.configuration.parameters);
        if !known {
            return;
        }
        let text = format!("the vehicle's parameter {} is now {value}", name.as_str());
        desk.note(LogLevel::Info, self.id(), text);
        self.say_own_failsafe(desk);
        let now = self.bounded(desk.vsm);
        let changed: Vec<Message> = now
            .into_iter()
            .zip(before)
            .filter(|(now, before)| now != before)
            .map(|(now, _)| now)
            .collect();
        self.tell_the_configured(desk, &changed, None);
    }

    /// Says by 44003 which modes can be commanded now, where that has changed.
    pub(super) fn watch_modes(&mut self, desk: &mut Desk<'_>) {
        let available = self.available_modes();
        let Some(before) = self.configuration.modes.replace(available) else {
            // Nobody has asked yet: there is nothing to change.
            self.configuration.modes = None;
            return;
        };
        let changed: Vec<Message> = available.changes(&before).collect();
        self.tell_the_configured(desk, &changed, None);
    }

    /// Answers a station a few at a time, then carries out what it asked with `origin`.
    pub(super) fn answer_later(
        &mut self,
        desk: &mut Desk<'_>,
        station: usize,
        answers: impl IntoIterator<Item = Message>,
        origin: Option<Origin>,
    ) {
        let machine = &mut self.configuration;
        if machine.queue.len() > MAX_WAITING {
            if let Some(origin) = origin {
                let why = "too many answers wait to be sent".to_owned();
                self.refuse(desk, Some(origin), why);
            }
            return;
        }
        let answers = answers.into_iter();
        machine
            .queue
            .extend(answers.map(|answer| Outgoing::Answer(station, Box::new(answer))));
        machine.queue.extend(origin.map(Outgoing::Done));
        machine.due.get_or_insert(desk.now.mono);
        self.send_configuration(desk);
    }

    /// Tells a change to the stations that 40000 has configured, but for the one that made it.
    pub(super) fn tell_the_configured(
        &mut self,
        desk: &mut Desk<'_>,
        messages: &[Message],
        by: Option<usize>,
    ) {
        if messages.is_empty() {
            return;
        }
        let machine = &mut self.configuration;
        if machine.queue.len() > MAX_WAITING {
            return;
        }
        for station in machine.told.iter().filter(|index| Some(**index) != by) {
            let all = messages.iter().cloned();
            machine
                .queue
                .extend(all.map(|message| Outgoing::Answer(*station, Box::new(message))));
        }
        if !machine.queue.is_empty() {
            machine.due.get_or_insert(desk.now.mono);
        }
        self.send_configuration(desk);
    }

    /// The answers that parameters bound, in an order that is always the same.
    fn bounded(&self, vsm: Id) -> Vec<Message> {
        let subject = self.subject(vsm);
        [Level::Status, Level::Control]
            .into_iter()
            .flat_map(|level| {
                let scope = Scope::Level(level);
                configuration::answers(&subject, &Request { scope })
            })
            .collect()
    }

    /// How fast it may be commanded to fly, as 41003 tells it, and what it does by itself.
    pub(super) fn performance(&self) -> Performance {
        let hovers = self.mav.telemetry.hovers();
        Performance::of(hovers, &self.configuration.parameters, &self.bounds.limits)
    }

    /// Whether what that is made of is on its way.
    pub(super) fn learns_performance(&self) -> bool {
        let mut names = Performance::NAMES.iter();
        matches!(self.configuration.reading, Reading::Left(_))
            && names.any(|name| self.parameter(name).is_none())
    }

    fn available_modes(&self) -> Available {
        Available {
            launch: !self.mav.telemetry.airborne(),
            waypoint: self.aboard.is_some(),
        }
    }

    fn subject(&self, vsm: Id) -> Subject<'_> {
        let telemetry = &self.mav.telemetry;
        Subject {
            vsm,
            vehicle_type: telemetry
                .vehicle_type
                .map_or(0, |kind: MavType| kind as u16),
            hovers: telemetry.hovers(),
            home: telemetry.home,
            limits: self.bounds.limits,
            agl: self.bounds.agl,
            parameters: &self.configuration.parameters,
            web_page: self.configuration.web_page.as_deref(),
        }
    }
}

/// An answer with its time.
fn stamped(mut answer: Message, stamp: TimeStamp) -> Message {
    let place = match &mut answer {
        Message::FieldConfigurationIntegerResponse(m) => &mut m.time_stamp,
        Message::FieldConfigurationFloatResponse(m) => &mut m.time_stamp,
        Message::FieldConfigurationEnumeratedResponse(m) => &mut m.time_stamp,
        Message::FieldConfigurationUnsignedResponse(m) => &mut m.time_stamp,
        Message::FieldConfigurationCharacterResponse(m) => &mut m.time_stamp,
        Message::ConfigurationComplete(m) => &mut m.time_stamp,
        Message::VsmServicesReportMessage(m) => &mut m.time_stamp,
        Message::UaRouteConfiguration(m) => &mut m.time_stamp,
        Message::MessageParameterAvailability(m) => &mut m.time_stamp,
        Message::FieldChangeIntegerCommand(m) => &mut m.time_stamp,
        Message::FieldChangeEnumeratedCommand(m) => &mut m.time_stamp,
        Message::ParameterReport(m) => &mut m.time_stamp,
        Message::AreaVertex(m) => &mut m.time_stamp,
        Message::AreaTransferStatus(m) => &mut m.time_stamp,
        _ => return answer,
    };
    *place = Some(stamp);
    answer
}

/// Messages of one go, and the pause after it.
const BURST: usize = 16;
const PAUSE: Duration = Duration::from_millis(20);
/// Answers and requests that may wait; a level of interoperability has some 200.
const MAX_WAITING: usize = 4_096;
