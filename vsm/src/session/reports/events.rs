//! The vehicle's events and texts as alerts: each is raised once, whichever form arrives first.
//!
//! PX4 sends most reports twice: as an EVENT, which has a number, and as a STATUSTEXT that ends with a tab, for ground
//! stations without events. Some reports have only one of these forms. So:
//! - with the vehicle's event definitions an event is alerted with its own text and level; of an event and a text with the
//!   same priority and meaning, the later one is dropped;
//! - without definitions a text replaces the event with the same priority that arrives with it. An event without a text is
//!   alerted by its numbers, 3 s later, unless its definition has been read by then;
//! - errors and anything more urgent are never dropped: better twice than not at all;
//! - reports of health and arming checks, which PX4 repeats completely whenever one of them changes, are one alert, active
//!   while a check prevents a disarmed vehicle from arming. In flight only new faults are alerted.

use std::collections::{BTreeSet, VecDeque};
use std::time::Duration;

use mapping::event::{self, CHECKS_BEGIN, CHECKS_END, Catalogue, Described, Group};
use mavlink_link::service::event::{Event, Received};
use mavlink_link::service::text::Text;
use stanag_msgs::enums::{AlertPriority, SubsystemId};

use crate::session::alerts::Cause;
use crate::session::context::Context;
use crate::session::effects::Effects;

/// The machine.
#[derive(Debug, Default)]
pub(super) struct EventAlerts {
    catalogue: Option<Catalogue>,
    /// Recent alerts whose other form may still arrive.
    alerted: VecDeque<Alerted>,
    /// Events without definition, each waiting for its text.
    unnamed: VecDeque<(Duration, Received)>,
    /// The report on health and arming checks that is arriving.
    report: Option<(Duration, Vec<Check>)>,
    /// The last complete report.
    checks: Vec<Check>,
}

#[derive(Debug)]
struct Alerted {
    until: Duration,
    priority: AlertPriority,
    text: String,
    as_text: bool,
}

#[derive(Debug, PartialEq)]
struct Check {
    priority: AlertPriority,
    id: u32,
    text: String,
    /// Whether the text is the vehicle's own.
    named: bool,
}

impl EventAlerts {
    /// The definitions of the vehicle's events.
    pub(super) fn define(&mut self, catalogue: Catalogue) {
        self.catalogue = Some(catalogue);
    }

    /// The vehicle has restarted: its earlier checks no longer apply.
    pub(super) fn restart(&mut self, effects: &mut Effects<'_>) {
        (self.report, self.checks) = (None, Vec::new());
        self.unnamed.clear();
        let text = "the vehicle has restarted: it checks itself again before arming";
        effects.clear(Cause::ArmingChecks, text);
    }

    /// A text of the vehicle.
    pub(super) fn text(&mut self, context: &Context<'_>, text: Text, effects: &mut Effects<'_>) {
        let text = Text {
            text: mapping::alert::shortened(text.text),
            ..text
        };
        let now = context.mono();
        let priority = mapping::alert::priority(text.severity);
        if text.is_event_twin {
            if self.take(now, priority, |one| {
                !one.as_text && event::says_the_same(&one.text, &text.text)
            }) {
                return;
            }
            let mut unnamed = self.unnamed.iter();
            match unnamed.position(|(_, one)| event::priority(one.level) == Some(priority)) {
                Some(twin) => drop(self.unnamed.remove(twin)),
                None => self.remember(now, priority, text.text.clone(), true),
            }
        }
        effects.notify(priority, AUTOPILOT_SUBSYSTEM, text.text);
    }

    /// An event of the vehicle.
    pub(super) fn event(
        &mut self,
        context: &Context<'_>,
        event: &Event,
        effects: &mut Effects<'_>,
    ) {
        match event {
            Event::Received(event) => self.received(context, event, effects),
            Event::Lost(count) => {
                // Its end or one of its checks may be lost: the next report will be complete.
                self.report = None;
                let text = format!("{count} events of the vehicle were lost");
                effects.notify(AlertPriority::Caution, AUTOPILOT_SUBSYSTEM, text);
            }
            Event::Restarted => self.report = None,
        }
    }

    /// Raises alerts for events without a text, and clears the arming checks after a take-off.
    pub(super) fn watch(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let now = context.mono();
        while self.unnamed.front().is_some_and(|(due, _)| *due <= now)
            && let Some((_, event)) = self.unnamed.pop_front()
        {
            // Its definition may have been read meanwhile, as just after a start.
            match self.described(&event) {
                Some(known) if known.group == Group::Default => {
                    let priority = event::priority(event.level);
                    let priority = priority.unwrap_or(AlertPriority::Nominal);
                    effects.notify(priority, AUTOPILOT_SUBSYSTEM, known.text);
                }
                Some(_) => {}
                None => Self::alert_plain(&event, effects),
            }
        }
        // The end of the report was lost: later events do not belong to it.
        self.report.take_if(|(until, _)| *until <= now);
        if context.vehicle.telemetry.armed == Some(true) {
            let text = "the vehicle is armed: its earlier arming checks no longer apply";
            effects.clear(Cause::ArmingChecks, text);
        }
    }

    /// When [`EventAlerts::watch`] is next needed.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        let unnamed = self.unnamed.front().map(|(due, _)| *due);
        let report = self.report.as_ref().map(|(until, _)| *until);
        unnamed.into_iter().chain(report).min()
    }

    fn received(&mut self, context: &Context<'_>, event: &Received, effects: &mut Effects<'_>) {
        let now = context.mono();
        self.report.take_if(|(until, _)| *until <= now);
        match event.id {
            CHECKS_BEGIN => self.report = Some((now + REPORT_WITHIN, Vec::new())),
            CHECKS_END => {
                if let Some((_, checks)) = self.report.take() {
                    self.judge_checks(context, checks, effects);
                }
            }
            _ => {}
        }
        let Some(priority) = event::priority(event.level) else {
            return;
        };
        let known = self.described(event);
        match (known, &mut self.report) {
            (Some(known), _) if known.group == Group::Other => {}
            // The beginning of its report was lost; the next report is complete.
            (Some(known), None) if known.group == Group::Check => {}
            (Some(known), _) if known.group == Group::Default => {
                let twin =
                    |one: &Alerted| one.as_text && event::says_the_same(&one.text, &known.text);
                if !self.take(now, priority, twin) {
                    self.remember(now, priority, known.text.clone(), false);
                    effects.notify(priority, AUTOPILOT_SUBSYSTEM, known.text);
                }
            }
            (known, Some((_, report))) => {
                // Its first argument has the modes that it blocks. Most vehicles have no sticks and do not need them.
                let [a, b, c, d, ..] = event.arguments;
                let modes = u32::from_le_bytes([a, b, c, d]);
                if modes & COMMANDED_MODES != 0 && report.len() < MAX_CHECKS {
                    let named = known.is_some();
                    report.push(Check {
                        priority,
                        id: event.id,
                        text: known.map_or_else(|| event::plain(event), |known| known.text),
                        named,
                    });
                }
            }
            (_, None) if !may_be_dropped(priority) => Self::alert_plain(event, effects),
            // Its text may have arrived already, or may still arrive.
            (_, None) => {
                if !self.take(now, priority, |one| one.as_text) {
                    if self.unnamed.len() >= MAX_WAITING
                        && let Some((_, oldest)) = self.unnamed.pop_front()
                    {
                        Self::alert_plain(&oldest, effects);
                    }
                    self.unnamed.push_back((now + TWIN_WITHIN, *event));
                }
            }
        }
    }

    fn described(&self, event: &Received) -> Option<Described> {
        let defined = || self.catalogue.as_ref()?.describe(event);
        event::reworded(event).or_else(defined)
    }

    /// A complete report of health and arming checks.
    fn judge_checks(
        &mut self,
        context: &Context<'_>,
        checks: Vec<Check>,
        effects: &mut Effects<'_>,
    ) {
        let fails = |check: &&Check| check.priority != AlertPriority::Nominal;
        if context.vehicle.telemetry.armed == Some(true) {
            for check in checks.iter().filter(fails) {
                if !self.checks.contains(check) {
                    effects.notify(check.priority, AUTOPILOT_SUBSYSTEM, check.text.clone());
                }
            }
        } else {
            let failed = || checks.iter().filter(fails);
            let named = failed().filter(|one| one.named);
            let mut texts: Vec<&str> = named.map(|one| one.text.as_str()).collect();
            // A check is reported for each group of modes that it blocks.
            texts.dedup();
            let unnamed = failed().filter(|one| !one.named).map(|one| one.id);
            let unnamed = unnamed.collect::<BTreeSet<_>>().len();
            let shown = &texts[..texts.len().min(NAMED_CHECKS)];
            let more = texts.len() - shown.len() + unnamed;
            match (shown, more) {
                ([], 0) => effects.clear(Cause::ArmingChecks, CHECKS_OVER),
                // Event numbers are useless to an operator.
                ([], _) => {
                    let text = format!("{unnamed} (their texts have not been read)");
                    Self::raise_checks(&text, effects);
                }
                (_, 0) => Self::raise_checks(&shown.join("; "), effects),
                _ => {
                    let text = format!("{}; and {more} more", shown.join("; "));
                    Self::raise_checks(&text, effects);
                }
            }
        }
        self.checks = checks;
    }

    fn raise_checks(texts: &str, effects: &mut Effects<'_>) {
        let text = format!("checks of the vehicle before arming fail: {texts}");
        let priority = AlertPriority::Caution;
        effects.raise(Cause::ArmingChecks, priority, AUTOPILOT_SUBSYSTEM, text);
    }

    fn alert_plain(event: &Received, effects: &mut Effects<'_>) {
        if let Some(priority) = event::priority(event.level) {
            effects.notify(priority, AUTOPILOT_SUBSYSTEM, event::plain(event));
        }
    }

    fn remember(&mut self, now: Duration, priority: AlertPriority, text: String, as_text: bool) {
        if self.alerted.len() >= MAX_WAITING {
            self.alerted.pop_front();
        }
        let until = now + TWIN_WITHIN;
        self.alerted.push_back(Alerted {
            until,
            priority,
            text,
            as_text,
        });
    }

    /// Whether the other form was alerted just now, with the same priority. It is used for one match only.
    fn take(
        &mut self,
        now: Duration,
        priority: AlertPriority,
        like: impl Fn(&Alerted) -> bool,
    ) -> bool {
        self.alerted.retain(|one| one.until > now);
        if !may_be_dropped(priority) {
            return false;
        }
        let twin = |one: &Alerted| one.priority == priority && like(one);
        let place = self.alerted.iter().position(twin);
        place.is_some_and(|place| self.alerted.remove(place).is_some())
    }
}

/// Whether an alert with this priority may be dropped in favour of one that seems to have the same meaning.
fn may_be_dropped(priority: AlertPriority) -> bool {
    matches!(priority, AlertPriority::Caution | AlertPriority::Nominal)
}

/// Subsystem ID for the autopilot's own reports: VSM specific.
pub(super) const AUTOPILOT_SUBSYSTEM: SubsystemId = SubsystemId::from_raw(20);
/// PX4 sends both in the same loop iteration; a lost event is requested again for up to 2.5 s.
const TWIN_WITHIN: Duration = Duration::from_secs(3);
/// PX4 sends a report in one burst; lost events are requested again for up to 2.5 s.
const REPORT_WITHIN: Duration = Duration::from_secs(3);
/// Maximum number of events or texts that wait for their other form.
const MAX_WAITING: usize = 32;
/// PX4's navigation states that a CUCS can command, as bits: mission, loiter, return, take-off, land.
const COMMANDED_MODES: u32 = 1 << 3 | 1 << 4 | 1 << 5 | 1 << 17 | 1 << 18;
/// PX4 limits a report to 14 checks.
const MAX_CHECKS: usize = 64;
const NAMED_CHECKS: usize = 3;
const CHECKS_OVER: &str = "the vehicle's checks before arming no longer fail";

#[cfg(test)]
mod tests {
    use stanag_msgs::Message;

    use super::*;
    use crate::session::testing::World;

    /// As after a start of the VSM.
    #[test]
    fn an_event_that_came_before_its_definition_is_alerted_with_its_text_if_that_is_read_in_time() {
        const FILE: &[u8] = br#"{"components": {"1": {"event_groups": {"default": {"events": {
            "42": {"message": "Low battery"}}}}}}}"#;
        for (is_read, expected) in [(true, "Low battery"), (false, "vehicle event 42 of")] {
            let (mut world, mut alerts) = (World::new(), EventAlerts::default());
            let event = Event::Received(Received {
                id: 1 << 24 | 42,
                sequence: 1,
                level: 4,
                arguments: [0; 40],
            });
            world.act(|context, _, effects| alerts.event(&context, &event, effects));
            if is_read {
                alerts.define(Catalogue::read(FILE).expect("a file"));
            }
            world.advance(TWIN_WITHIN);
            world.act(|context, _, effects| alerts.watch(&context, effects));
            let sent = world.sent_to(0);
            let text = sent.iter().find_map(|message| match message {
                Message::SubsystemStatusAlert(alert) => alert.text.as_ref(),
                _ => None,
            });
            let text = text.map_or("", |text| text.as_str());
            assert!(text.starts_with(expected), "{text}");
        }
    }
}
