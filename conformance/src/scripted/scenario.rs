//! A scenario as TOML: what the scripted vehicle does to the CUCS, and what its operator is asked to do.
//!
//! The built-in ones are the files of `conformance/scenarios`; a user's own file has the same keys. Values of fields
//! are integers as on the wire, numbers with a decimal point in the unit of the table, or texts (`1b:00:00:b7` for an
//! id). A file is checked as a whole before anything is sent, so that a mistake in it does not first show in front of
//! an operator.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;
use stanag_msgs::{Id, table};

use crate::catalogue::Catalogue;
use crate::wire::{Draft, Seen};

/// What the vehicle does, and the steps of the operator.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Its name: that of the file.
    #[serde(skip)]
    pub name: String,
    /// What it is about, in a sentence.
    pub about: String,
    /// Levels of interoperability.
    #[serde(default)]
    pub authority: Authority,
    /// How a route is answered.
    #[serde(default)]
    pub upload: Upload,
    /// Messages that are lost.
    #[serde(default)]
    pub lose: Vec<Times>,
    /// Commands that are refused by 17000 type 3.
    #[serde(default)]
    pub refuse: Vec<Times>,
    /// Messages of the vehicle that are delayed.
    #[serde(default)]
    pub delay: Vec<Delay>,
    /// Answers to 40000 before 41005.
    #[serde(default)]
    pub declare: Vec<Values>,
    /// Reports with other values than those of a healthy vehicle on the ground.
    #[serde(default)]
    pub report: Vec<Values>,
    /// Events: what happens to a CUCS.
    #[serde(default)]
    pub event: Vec<Event>,
    /// The operator's steps, in this order.
    #[serde(default)]
    pub step: Vec<Step>,
}

/// Levels of interoperability.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Authority {
    /// Levels that the CUCS may have, 2 to 5.
    pub authorised: Vec<u8>,
    /// Whether a grant of LOI 4 or 5 has a wrong checksum.
    pub damaged: bool,
}

impl Default for Authority {
    fn default() -> Self {
        Self {
            authorised: vec![2, 3, 4, 5],
            damaged: false,
        }
    }
}

/// How 13000 mode 2 is answered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Upload {
    /// 50 %, then complete.
    #[default]
    Loaded,
    /// 50 %, and nothing after that.
    Stuck,
    /// 50 %, then rejected (status 2).
    Rejected,
}

/// The first few of a message are lost.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Times {
    /// Message type.
    pub message: u16,
    /// How many of each CUCS.
    #[serde(default = "once")]
    pub times: u32,
}

/// A message of the vehicle that is delayed.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Delay {
    /// Message type.
    pub message: u16,
    /// The delay in seconds.
    pub seconds: f64,
}

/// A message with values.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Values {
    /// Message type.
    pub message: u16,
    /// Values by the names of the table.
    pub fields: BTreeMap<String, toml::Value>,
    /// Fields that are left out.
    pub absent: Vec<String>,
}

/// Something that happens once to each CUCS.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Event {
    /// What it waits for.
    pub after: After,
    /// The step, where it waits for one.
    pub step: Option<String>,
    /// Seconds after that.
    #[serde(default)]
    pub seconds: f64,
    /// What happens.
    pub action: Action,
    /// Message type to `send`, or to `report` with other values from then on.
    #[serde(default)]
    pub message: u16,
    /// Its values.
    #[serde(default)]
    pub fields: BTreeMap<String, toml::Value>,
    /// Fields that a `report` leaves out.
    #[serde(default)]
    pub absent: Vec<String>,
    /// Whether it requests an acknowledgement.
    #[serde(default)]
    pub ack: bool,
    /// Whether its checksum is wrong.
    #[serde(default)]
    pub damaged: bool,
    /// Bytes of a datagram, in hexadecimal.
    #[serde(default)]
    pub hex: String,
    /// The number of bytes to which it is filled with zeros.
    #[serde(default)]
    pub length: usize,
    /// How long a restart or a silence lasts, in seconds.
    #[serde(default)]
    pub lasts_s: f64,
}

/// What an event waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum After {
    /// The first message of the CUCS.
    Contact,
    /// The first grant of LOI 4 or 5.
    Control,
    /// The first 13000 mode 2.
    Load,
    /// The first 2016 or 2017 with control.
    Command,
    /// The beginning of a step.
    Step,
}

/// What happens.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Action {
    /// A message is sent.
    Send,
    /// A report has other values from then on.
    Report,
    /// Bytes are sent that are no message.
    Datagram,
    /// Control is revoked, and denied to all from then on: another CUCS has it.
    Revoke,
    /// The vehicle is silent for a while, and has forgotten every CUCS afterwards.
    Restart,
    /// The vehicle is silent for a while, and forgets nothing.
    Silence,
}

/// What is asked of the operator, or of a command of the profile's `[on]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// Its name, by which `[on]` finds its command.
    pub id: String,
    /// What to do, in one sentence.
    pub card: String,
    /// What on the wire shows that it was done.
    pub done: Option<Done>,
    /// A question that only eyes can answer.
    pub question: Option<String>,
    /// The answer that a correct CUCS gives.
    #[serde(default)]
    pub expect: Answer,
    /// Rules that the question is about; without a question, rules that pass where the wire shows the step done, and
    /// fail where it does not.
    #[serde(default)]
    pub rules: Vec<String>,
    /// How long the step lasts at least, in seconds, so that there is something to see.
    #[serde(default)]
    pub lasts_s: f64,
    /// How long the CUCS has at most, in seconds.
    #[serde(default = "patience")]
    pub within_s: f64,
}

/// What on the wire shows that a step was done.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Done {
    /// Message type of the CUCS.
    pub message: u16,
    /// Values as on the wire.
    #[serde(default)]
    pub fields: BTreeMap<String, i64>,
    /// Whether a message from before the step, in the same scenario, counts too.
    #[serde(default)]
    pub earlier: bool,
}

/// An answer to a question.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Answer {
    /// Yes.
    #[default]
    Yes,
    /// No.
    No,
}

impl Answer {
    /// The answer as it is written in files and reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Yes => "yes",
            Self::No => "no",
        }
    }
}

impl Done {
    /// Whether this message of the CUCS shows it.
    #[must_use]
    pub fn shown_by(&self, seen: &Seen) -> bool {
        seen.kind() == self.message
            && (self.fields.iter()).all(|(name, &value)| seen.raw(name) == Some(value))
    }
}

fn once() -> u32 {
    1
}

fn patience() -> f64 {
    180.0
}

/// Why a scenario cannot be played.
#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    /// The file cannot be read.
    #[error("scenario {path}: {source}")]
    Read {
        /// The file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// It is not a scenario.
    #[error("scenario {name}: {source}")]
    Form {
        /// The scenario.
        name: String,
        /// Where and why.
        source: Box<toml::de::Error>,
    },
    /// A value cannot be used.
    #[error("scenario {name}: {key} is {found}, expected {expected}")]
    Value {
        /// The scenario.
        name: String,
        /// The key.
        key: String,
        /// Its value.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// There is neither a built-in scenario nor a file of this name.
    #[error("scenario {name:?} is neither a file that exists nor one of {known}")]
    Unknown {
        /// What was requested.
        name: String,
        /// The built-in ones.
        known: String,
    },
}

macro_rules! embedded {
    ($($name:literal),* $(,)?) => {
        /// The built-in scenarios, in the order of a session.
        const EMBEDDED: &[(&str, &str)] = &[$(($name, include_str!(concat!("../../scenarios/", $name, ".toml")))),*];
    };
}
embedded!(
    "normal",
    "unloaded",
    "rejected",
    "deny",
    "payload",
    "damaged",
    "handover",
    "odd",
    "malformed",
    "late",
    "restart",
    "revoke"
);

impl Scenario {
    /// Names of the built-in scenarios, in the order of a session.
    pub fn names() -> impl Iterator<Item = &'static str> {
        EMBEDDED.iter().map(|(name, _)| *name)
    }

    /// A built-in scenario by its name, or that of a file.
    ///
    /// # Errors
    /// It is neither, or cannot be played.
    pub fn named(name: &str) -> Result<Self, ScenarioError> {
        match EMBEDDED.iter().find(|(known, _)| *known == name) {
            Some((_, text)) => Self::parse(name, text),
            None if Path::new(name).exists() => Self::read(Path::new(name)),
            None => Err(ScenarioError::Unknown {
                name: name.to_owned(),
                known: Self::names().collect::<Vec<_>>().join(", "),
            }),
        }
    }

    fn read(path: &Path) -> Result<Self, ScenarioError> {
        let text = std::fs::read_to_string(path).map_err(|source| ScenarioError::Read {
            path: path.display().to_string(),
            source,
        })?;
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        Self::parse(&name, &text)
    }

    /// A scenario of a text.
    ///
    /// # Errors
    /// It is not a scenario, or a value in it cannot be used.
    pub fn parse(name: &str, text: &str) -> Result<Self, ScenarioError> {
        let mut scenario: Self = toml::from_str(text).map_err(|source| ScenarioError::Form {
            name: name.to_owned(),
            source: Box::new(source),
        })?;
        name.clone_into(&mut scenario.name);
        scenario
            .check()
            .map_err(|(key, found, expected)| ScenarioError::Value {
                name: name.to_owned(),
                key,
                found,
                expected,
            })?;
        Ok(scenario)
    }

    fn check(&self) -> Result<(), Wrong> {
        for (index, &level) in self.authority.authorised.iter().enumerate() {
            if !(2..=5).contains(&level) {
                return wrong(format!("authority.authorised[{index}]"), level, "2 to 5");
            }
        }
        for (list, name) in [(&self.lose, "lose"), (&self.refuse, "refuse")] {
            for (index, times) in list.iter().enumerate() {
                known(&format!("{name}[{index}].message"), times.message)?;
            }
        }
        for (index, delay) in self.delay.iter().enumerate() {
            known(&format!("delay[{index}].message"), delay.message)?;
            span(&format!("delay[{index}].seconds"), delay.seconds)?;
        }
        for (list, name) in [(&self.declare, "declare"), (&self.report, "report")] {
            for (index, values) in list.iter().enumerate() {
                values.check(&format!("{name}[{index}]"))?;
            }
        }
        for (index, event) in self.event.iter().enumerate() {
            self.check_event(&format!("event[{index}]"), event)?;
        }
        self.check_steps()
    }

    fn check_event(&self, place: &str, event: &Event) -> Result<(), Wrong> {
        span(&format!("{place}.seconds"), event.seconds)?;
        span(&format!("{place}.lasts_s"), event.lasts_s)?;
        match (&event.step, event.after) {
            (Some(id), After::Step) if !self.step.iter().any(|step| step.id == *id) => {
                return wrong(
                    format!("{place}.step"),
                    format!("{id:?}"),
                    "the id of a step of this file",
                );
            }
            (None, After::Step) => {
                return wrong(
                    format!("{place}.step"),
                    "absent",
                    "the id of a step, which after = \"step\" needs",
                );
            }
            (Some(id), after) if after != After::Step => {
                return wrong(
                    format!("{place}.step"),
                    format!("{id:?}"),
                    "no step, or after = \"step\"",
                );
            }
            _ => {}
        }
        match event.action {
            Action::Send | Action::Report => event.values().check(place),
            Action::Datagram => {
                if bytes(&event.hex).is_none() {
                    return wrong(
                        format!("{place}.hex"),
                        format!("{:?}", event.hex),
                        "an even number of hexadecimal digits",
                    );
                }
                if event.length > MAX_PAYLOAD {
                    return wrong(
                        format!("{place}.length"),
                        event.length,
                        "at most 65507 bytes, the largest UDP payload",
                    );
                }
                Ok(())
            }
            Action::Revoke | Action::Restart | Action::Silence if event.message != 0 => wrong(
                format!("{place}.message"),
                event.message,
                "no message for this action",
            ),
            Action::Revoke | Action::Restart | Action::Silence => Ok(()),
        }
    }

    fn check_steps(&self) -> Result<(), Wrong> {
        let catalogue = Catalogue::embedded();
        for (index, step) in self.step.iter().enumerate() {
            let place = format!("step[{index}]");
            if self.step[..index].iter().any(|other| other.id == step.id) {
                return wrong(
                    format!("{place}.id"),
                    format!("{:?}", step.id),
                    "an id that no step before it has",
                );
            }
            span(&format!("{place}.lasts_s"), step.lasts_s)?;
            span(&format!("{place}.within_s"), step.within_s)?;
            if let Some(rule) = step.rules.iter().find(|id| catalogue.find(id).is_none()) {
                return wrong(
                    format!("{place}.rules"),
                    format!("{rule:?}"),
                    "ids of rules, which `dli-check list` shows",
                );
            }
            match (&step.done, &step.question) {
                (Some(_), Some(_)) => {
                    return wrong(
                        format!("{place}.question"),
                        "there beside done",
                        "one of the two: either the wire or the operator says",
                    );
                }
                (Some(done), None) => {
                    known(&format!("{place}.done.message"), done.message)?;
                    for field in done.fields.keys() {
                        named_field(&format!("{place}.done.fields"), done.message, field)?;
                    }
                }
                (None, Some(_)) if step.rules.is_empty() => {
                    return wrong(
                        format!("{place}.rules"),
                        "empty",
                        "the rules that the question is about",
                    );
                }
                (None, None) if !step.rules.is_empty() => {
                    return wrong(
                        format!("{place}.rules"),
                        format!("{:?}", step.rules),
                        "done or question, by which they are judged",
                    );
                }
                _ => {}
            }
        }
        Ok(())
    }
}

impl Event {
    /// Its message with values.
    #[must_use]
    pub fn values(&self) -> Values {
        Values {
            message: self.message,
            fields: self.fields.clone(),
            absent: self.absent.clone(),
        }
    }

    /// Bytes of a datagram.
    #[must_use]
    pub fn datagram(&self) -> Vec<u8> {
        let mut datagram = bytes(&self.hex).unwrap_or_default();
        datagram.resize(datagram.len().max(self.length), 0);
        datagram
    }
}

impl Values {
    /// Sets the fields of a draft of this message.
    #[must_use]
    pub fn apply(&self, mut draft: Draft) -> Draft {
        for (name, value) in &self.fields {
            draft = match value {
                toml::Value::Integer(raw) => draft.raw(name, *raw),
                toml::Value::Float(value) => draft.set(name, *value),
                toml::Value::String(text) => match text.parse::<Id>() {
                    Ok(id) if identification(self.message, name) => draft.id(name, id),
                    _ => draft.text(name, text.as_bytes()),
                },
                _ => draft,
            };
        }
        for name in &self.absent {
            draft = draft.without(name);
        }
        draft
    }

    fn check(&self, place: &str) -> Result<(), Wrong> {
        known(&format!("{place}.message"), self.message)?;
        for (name, value) in &self.fields {
            named_field(&format!("{place}.fields"), self.message, name)?;
            check_value(
                &format!("{place}.fields.{name:?}"),
                self.message,
                name,
                value,
            )?;
        }
        for name in &self.absent {
            named_field(&format!("{place}.absent"), self.message, name)?;
        }
        Ok(())
    }
}

/// Key, value, and what was expected.
type Wrong = (String, String, String);

fn wrong(
    key: impl Into<String>,
    found: impl ToString,
    expected: impl Into<String>,
) -> Result<(), Wrong> {
    Err((key.into(), found.to_string(), expected.into()))
}

fn known(key: &str, message: u16) -> Result<(), Wrong> {
    match table::message(message) {
        Some(_) => Ok(()),
        None => wrong(
            key,
            message,
            "a message type of the table (docs/reference/dli)",
        ),
    }
}

fn named_field(key: &str, message: u16, name: &str) -> Result<(), Wrong> {
    let fields = table::message(message).map_or(&[][..], |info| info.fields);
    if fields.iter().any(|field| field.name == name) {
        return Ok(());
    }
    let names: Vec<&str> = fields.iter().map(|field| field.name).collect();
    wrong(
        key,
        format!("{name:?}"),
        format!("a field of message {message}: {}", names.join(", ")),
    )
}

fn identification(message: u16, name: &str) -> bool {
    table::message(message)
        .and_then(|info| info.field(name))
        .is_some_and(|field| field.identification)
}

fn check_value(key: &str, message: u16, name: &str, value: &toml::Value) -> Result<(), Wrong> {
    let Some(field) = table::message(message).and_then(|info| info.field(name)) else {
        return Ok(());
    };
    let integers = field.wire.integers();
    match (value, integers) {
        (toml::Value::String(text), None)
            if !matches!(
                field.wire,
                stanag_msgs::table::Wire::F32 | stanag_msgs::table::Wire::F64
            ) =>
        {
            let room = field.wire.bytes().unwrap_or_default();
            if text.len() > room {
                return wrong(
                    key,
                    format!("{} bytes", text.len()),
                    format!("a text of at most {room} bytes"),
                );
            }
            Ok(())
        }
        (toml::Value::String(text), Some(_)) if field.identification => text
            .parse::<Id>()
            .map(|_| ())
            .map_err(|error| (key.to_owned(), format!("{text:?}"), error.to_string())),
        (toml::Value::Integer(raw), Some((low, high))) if !(low..=high).contains(raw) => wrong(
            key,
            raw,
            format!(
                "{low} to {high}, as on the wire (a number with a decimal point is in {})",
                field.unit.unwrap_or("its unit")
            ),
        ),
        (toml::Value::Integer(_), Some(_)) => Ok(()),
        (toml::Value::Float(value), Some((low, high))) => {
            let raw = value / field.step();
            if raw.round() < low as f64 || raw.round() > high as f64 || !raw.is_finite() {
                return wrong(
                    key,
                    value,
                    format!(
                        "{} to {} {}",
                        low as f64 * field.step(),
                        high as f64 * field.step(),
                        field.unit.unwrap_or("")
                    ),
                );
            }
            Ok(())
        }
        (toml::Value::Float(_), None)
            if matches!(
                field.wire,
                stanag_msgs::table::Wire::F32 | stanag_msgs::table::Wire::F64
            ) =>
        {
            Ok(())
        }
        (other, Some(_)) => wrong(
            key,
            other,
            "an integer as on the wire, or a number with a decimal point in the field's unit",
        ),
        (other, None) => wrong(
            key,
            other,
            "a text, or a number with a decimal point where the field is a float",
        ),
    }
}

fn span(key: &str, seconds: f64) -> Result<(), Wrong> {
    if (0.0..=3600.0).contains(&seconds) {
        Ok(())
    } else {
        wrong(key, seconds, "0 to 3600 seconds")
    }
}

/// The largest UDP payload over IPv4.
const MAX_PAYLOAD: usize = 65_507;

fn bytes(hex: &str) -> Option<Vec<u8>> {
    let digits: Vec<u8> = hex
        .chars()
        .filter(|digit| !digit.is_whitespace())
        .map(|digit| digit.to_digit(16).map(|digit| digit as u8))
        .collect::<Option<_>>()?;
    digits
        .chunks(2)
        .map(|pair| match pair {
            [high, low] => Some(high << 4 | low),
            _ => None,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_built_in_scenario_can_be_played() {
        for name in Scenario::names() {
            let scenario = Scenario::named(name).unwrap_or_else(|error| panic!("{error}"));
            assert!(!scenario.step.is_empty(), "{name} asks for nothing");
        }
    }

    /// Each mistake, with what its error has to name.
    const MISTAKES: &[(&str, &[&str])] = &[
        ("speed = 3", &["unknown field `speed`", "line 2"]),
        (
            "[authority]\nauthorised = [2, 7]",
            &["authority.authorised[1] is 7", "expected 2 to 5"],
        ),
        (
            "[[lose]]\nmessage = 2015",
            &["lose[0].message is 2015", "docs/reference/dli"],
        ),
        (
            "[[event]]\nafter = \"lunch\"\naction = \"revoke\"",
            &["unknown variant `lunch`", "`contact`", "line 3"],
        ),
        (
            "[[event]]\nafter = \"step\"\naction = \"revoke\"",
            &["event[0].step is absent"],
        ),
        (
            "[[event]]\nafter = \"step\"\nstep = \"x\"\naction = \"revoke\"",
            &["event[0].step is \"x\"", "of this file"],
        ),
        (
            "[[event]]\nafter = \"control\"\naction = \"datagram\"\nhex = \"abc\"",
            &["event[0].hex is \"abc\"", "even number"],
        ),
        (
            "[[event]]\nafter = \"control\"\naction = \"datagram\"\nlength = 65508",
            &["event[0].length is 65508", "65507"],
        ),
        (
            "[[report]]\nmessage = 4000\nfields = { \"Latitud\" = 3.0 }",
            &["report[0].fields is \"Latitud\"", "Latitude, Longitude"],
        ),
        (
            "[[report]]\nmessage = 4000\nfields = { \"Latitude\" = 7.0 }",
            &["report[0].fields.\"Latitude\" is 7", "rad"],
        ),
        (
            "[[report]]\nmessage = 3001\nfields = { \"Select Flight Path Control Mode\" = 300 }",
            &["is 300", "0 to 255"],
        ),
        (
            "[[report]]\nmessage = 3\nfields = { \"Tail Number\" = \"SEVENTEEN LETTERS\" }",
            &["17 bytes", "at most 16 bytes"],
        ),
        (
            "[[delay]]\nmessage = 2\nseconds = -1.0",
            &["delay[0].seconds is -1", "0 to 3600"],
        ),
        (
            "[[step]]\nid = \"a\"\ncard = \"b\"\nquestion = \"c?\"",
            &["step[0].rules is empty"],
        ),
        (
            "[[step]]\nid = \"a\"\ncard = \"b\"\nquestion = \"c?\"\nrules = [\"MODE-999\"]",
            &["MODE-999", "dli-check list"],
        ),
        (
            "[[step]]\nid = \"a\"\ncard = \"b\"\n[[step]]\nid = \"a\"\ncard = \"b\"",
            &["step[1].id is \"a\""],
        ),
    ];

    #[test]
    fn a_mistake_is_named_with_its_key_value_and_expectation() {
        for (text, expected) in MISTAKES {
            let text = format!("about = \"a mistake\"\n{text}\n");
            let error = Scenario::parse("mine", &text).unwrap_err().to_string();
            for part in *expected {
                assert!(error.contains(part), "{text}\n{error}\nlacks {part:?}");
            }
            assert!(error.contains("mine"), "{error}");
        }
    }

    #[test]
    fn a_name_that_is_nothing_is_refused_with_the_names_that_are() {
        let error = Scenario::named("norml").unwrap_err().to_string();
        assert!(
            error.contains("norml") && error.contains("normal, unloaded, rejected"),
            "{error}"
        );
    }
}
