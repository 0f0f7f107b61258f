//! The vehicle's controls: the parameters offered to stations (`vehicle.controls`), and the reports of their values.
//!
//! They are read once the vehicle's link is up, alternating with requests of stations. Configured stations (40000) receive
//! each new or changed description, and each changed value, whatever the cause of the change.

use std::collections::BTreeSet;

use mapping::configuration::{Change, Controls, ValuesBy};
use mapping::parameter::Described;
use mapping::parameter_metadata::ParameterMetadata;
use mavlink_link::service::param::{Name, Value};
use stanag_msgs::Message;

use super::answers::AnswerQueue;
use crate::config;
use crate::session::context::Context;
use crate::session::effects::Effects;
use crate::session::log::LogLevel;

/// The machine.
#[derive(Debug, Default)]
pub(super) struct ControlWatch {
    controls: Controls,
    /// Number of controls still to be read.
    left: usize,
}

impl ControlWatch {
    pub(super) fn controls(&self) -> &Controls {
        &self.controls
    }

    pub(super) fn is_reading(&self) -> bool {
        self.left > 0
    }

    /// The vehicle's link is up, or it has new metadata: returns the controls to read; none if a reading is in progress.
    pub(super) fn names_to_read(
        &mut self,
        context: &Context<'_>,
        effects: &mut Effects<'_>,
    ) -> Vec<Name> {
        let Some(chosen) = &context.config.controls else {
            return Vec::new();
        };
        if self.is_reading() {
            return Vec::new();
        }
        let all = chosen.names(self.controls.metadata());
        if all.len() > MAX_READ {
            let text = format!(
                "{} parameters may be controls (vehicle.controls): the first {MAX_READ} by name are read, and {} offered at most",
                all.len(),
                Controls::MAX
            );
            effects.note(LogLevel::Warning, text);
        }
        let names = all.into_iter().filter_map(|name| Name::new(name).ok());
        let names: Vec<Name> = names.take(MAX_READ).collect();
        self.left = names.len();
        names
    }

    /// One more was read or does not exist. Returns whether it was the last.
    pub(super) fn count_read(&mut self) -> bool {
        self.left = self.left.saturating_sub(1);
        self.left == 0
    }

    /// The vehicle is silent.
    pub(super) fn stop_reading(&mut self) {
        self.left = 0;
    }

    /// New metadata of the vehicle; the changes are sent to configured stations.
    pub(super) fn define(
        &mut self,
        context: &Context<'_>,
        metadata: ParameterMetadata,
        configured: &BTreeSet<usize>,
        answers: &mut AnswerQueue,
        effects: &mut Effects<'_>,
    ) {
        // Ends a reading in progress, so that it begins again: the new metadata may choose other parameters.
        self.left = 0;
        let chosen = context.config.controls.as_ref();
        let offers = |name: &str, described: Option<&Described>| {
            chosen.is_some_and(|chosen| chosen.offers(name, described))
        };
        let (gone, left) = self.controls.define(metadata, offers);
        let nobody = BTreeSet::new();
        for number in gone {
            let gone = |_| vec![Controls::gone(number)];
            report(context, gone, configured, &nobody, answers, effects);
        }
        for number in left {
            let all = |by| self.controls.describe(number, context.vsm, by).collect();
            report(context, all, configured, &nobody, answers, effects);
        }
    }

    /// The vehicle reports a parameter. `informed`: stations that receive its 50012 for another reason.
    pub(super) fn learn(
        &mut self,
        context: &Context<'_>,
        (name, value): (Name, Value),
        configured: &BTreeSet<usize>,
        informed: &BTreeSet<usize>,
        answers: &mut AnswerQueue,
        effects: &mut Effects<'_>,
    ) {
        let described = self.controls.metadata().get(name.as_str());
        let chosen = context.config.controls.as_ref();
        if !chosen.is_some_and(|chosen| chosen.offers(name.as_str(), described)) {
            return;
        }
        let change = self.controls.learn(name, value);
        let messages = |by| match change {
            Some(Change::New(number)) => self.controls.describe(number, context.vsm, by).collect(),
            Some(Change::Value(number)) => self.controls.value(number, by).into_iter().collect(),
            None => Vec::new(),
        };
        report(context, messages, configured, informed, answers, effects);
    }

    /// Why a parameter must not be written: it is not one of the configured controls.
    pub(super) fn check_write(
        &self,
        chosen: Option<&config::Controls>,
        name: &str,
    ) -> Result<(), String> {
        let described = self.controls.metadata().get(name);
        if chosen.is_none_or(|chosen| chosen.offers(name, described)) {
            return Ok(());
        }
        Err(format!(
            "parameter {name} is not one of the vehicle's controls (vehicle.controls): the configuration of message 50011 lists them"
        ))
    }
}

/// How the values of controls are reported to a station.
pub(super) fn values_by(context: &Context<'_>, station: usize) -> ValuesBy {
    match context.stations.get(station) {
        Some(one) if one.speaks_ed25() => ValuesBy::Name,
        _ => ValuesBy::Field,
    }
}

/// Sends each station that was configured the messages of its edition.
fn report(
    context: &Context<'_>,
    messages: impl Fn(ValuesBy) -> Vec<Message>,
    configured: &BTreeSet<usize>,
    informed: &BTreeSet<usize>,
    answers: &mut AnswerQueue,
    effects: &mut Effects<'_>,
) {
    for station in configured.iter().copied() {
        let by = values_by(context, station);
        let mut messages = messages(by);
        if by == ValuesBy::Name && informed.contains(&station) {
            messages.retain(|message| !matches!(message, Message::ParameterReport(_)));
        }
        if !messages.is_empty() && !answers.is_full(station) {
            answers.push(effects.dli.now.mono, station, messages, None);
        }
    }
    answers.send_due(effects);
}

/// Maximum number of parameters read for the controls; most matches of a pattern belong to other boards or airframes.
const MAX_READ: usize = 2 * Controls::MAX;
