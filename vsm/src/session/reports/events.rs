//! The vehicle's events and texts as alerts: each once, whichever form of it arrives first.
//!
//! PX4 sends most of what it reports twice: as an EVENT, which names it by a number, and as a STATUSTEXT that ends with a tab,
//! for ground stations without events. Some is sent as one of the two alone. Here:
//! - with the vehicle's definitions an event is alerted by its own text and level, and the text that says the same is
//!   dropped, if it comes after; where it came before, the event is;
//! - without definitions the text stands for the event that comes with it. An event without one is alerted by its numbers;
//! - reports on health and on the checks before arming, which PX4 repeats whole whenever one of them changes, are one alert
//!   that stands while something keeps a disarmed vehicle from arming. In flight what is new in them is alerted.

use std::collections::VecDeque;
use std::time::Duration;

use mapping::event::{self, CHECKS_BEGIN, CHECKS_END, Catalogue, Group};
use mavlink_link::service::event::{Event, Received};
use mavlink_link::service::text::Text;
use stanag_msgs::enums::{AlertPriority, SubsystemId};

use crate::session::alerts::Cause;
use crate::session::allowance::{Allowance, Rate};
use crate::session::context::Context;
use crate::session::effects::Effects;

/// The machine.
#[derive(Debug, Default)]
pub(super) struct EventAlerts {
    catalogue: Option<Catalogue>,
    /// What was alerted just now, and may come again in its other form.
    alerted: VecDeque<Alerted>,
    /// Events without definition, each until its text would have come.
    unnamed: VecDeque<(Duration, Received)>,
    /// The report on health and arming checks that is arriving.
    report: Option<Vec<Check>>,
    /// The last one.
    checks: Vec<Check>,
    allowance: Allowance,
    left_out: u32,
}

#[derive(Debug)]
struct Alerted {
    until: Duration,
    text: String,
    as_text: bool,
}

type Check = (AlertPriority, String);

impl EventAlerts {
    /// What the vehicle's events mean.
    pub(super) fn define(&mut self, catalogue: Catalogue) {
        self.catalogue = Some(catalogue);
    }

    /// The vehicle has restarted: what it reported of its checks is over.
    pub(super) fn restart(&mut self, effects: &mut Effects<'_>) {
        (self.report, self.checks) = (None, Vec::new());
        self.unnamed.clear();
        effects.clear(Cause::ArmingChecks, CHECKS_OVER);
    }

    /// A text of the vehicle.
    pub(super) fn text(&mut self, context: &Context<'_>, text: Text, effects: &mut Effects<'_>) {
        let now = context.mono();
        if text.is_event_twin {
            if self.take(now, |one| {
                !one.as_text && event::says_the_same(&one.text, &text.text)
            }) {
                return;
            }
            if self.unnamed.pop_front().is_none() {
                self.remember(now, text.text.clone(), true);
            }
        }
        let priority = mapping::alert::priority(text.severity);
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
                // It may have lost its end, or one of its checks: the next one is whole.
                self.report = None;
                let text = format!("{count} events of the vehicle were lost");
                self.alert(context.mono(), AlertPriority::Caution, text, effects);
            }
        }
    }

    /// Alerts what no text has come for, and clears what a take-off has answered.
    pub(super) fn watch(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let now = context.mono();
        while self.unnamed.front().is_some_and(|(due, _)| *due <= now)
            && let Some((_, event)) = self.unnamed.pop_front()
        {
            self.alert_plain(now, &event, effects);
        }
        if context.vehicle.telemetry.armed == Some(true) {
            effects.clear(Cause::ArmingChecks, CHECKS_OVER);
        }
    }

    /// When [`EventAlerts::watch`] is next needed.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        self.unnamed.front().map(|(due, _)| *due)
    }

    fn received(&mut self, context: &Context<'_>, event: &Received, effects: &mut Effects<'_>) {
        match event.id {
            CHECKS_BEGIN => self.report = Some(Vec::new()),
            CHECKS_END => {
                if let Some(checks) = self.report.take() {
                    self.judge_checks(context, checks, effects);
                }
            }
            _ => {}
        }
        let Some(priority) = event::priority(event.level) else {
            return;
        };
        let now = context.mono();
        let known = self.catalogue.as_ref().and_then(|all| all.describe(event));
        match (known, &mut self.report) {
            (Some(known), _) if known.group == Group::Other => {}
            (Some(known), None) if known.group == Group::Check => {}
            (Some(known), _) if known.group == Group::Default => {
                let twin =
                    |one: &Alerted| one.as_text && event::says_the_same(&one.text, &known.text);
                if !self.take(now, twin) {
                    self.remember(now, known.text.clone(), false);
                    self.alert(now, priority, known.text, effects);
                }
            }
            (known, Some(report)) => {
                // Its first argument is the modes that it keeps from being flown: most vehicles have no sticks, and need none.
                let [a, b, c, d, ..] = event.arguments;
                let modes = u32::from_le_bytes([a, b, c, d]);
                if modes & COMMANDED_MODES != 0 && report.len() < MAX_CHECKS {
                    let text = known.map_or_else(|| event::plain(event), |known| known.text);
                    report.push((priority, text));
                }
            }
            // Its text may have come, or be on its way.
            (_, None) => {
                if !self.take(now, |one| one.as_text) {
                    if self.unnamed.len() >= MAX_WAITING
                        && let Some((_, oldest)) = self.unnamed.pop_front()
                    {
                        self.alert_plain(now, &oldest, effects);
                    }
                    self.unnamed.push_back((now + TWIN_WITHIN, *event));
                }
            }
        }
    }

    /// A whole report on health and arming checks.
    fn judge_checks(
        &mut self,
        context: &Context<'_>,
        checks: Vec<Check>,
        effects: &mut Effects<'_>,
    ) {
        let fails = |check: &&Check| check.0 != AlertPriority::Nominal;
        if context.vehicle.telemetry.armed == Some(true) {
            for check in checks.iter().filter(fails) {
                if !self.checks.contains(check) {
                    self.alert(context.mono(), check.0, check.1.clone(), effects);
                }
            }
        } else {
            let mut texts: Vec<&str> = checks
                .iter()
                .filter(fails)
                .map(|one| one.1.as_str())
                .collect();
            // One is reported for each group of modes that it keeps from being flown.
            texts.dedup();
            match texts.split_at_checked(NAMED_CHECKS) {
                _ if texts.is_empty() => effects.clear(Cause::ArmingChecks, CHECKS_OVER),
                Some((named, more)) if !more.is_empty() => {
                    let text = format!("{}; and {} more", named.join("; "), more.len());
                    Self::raise_checks(&text, effects);
                }
                _ => Self::raise_checks(&texts.join("; "), effects),
            }
        }
        self.checks = checks;
    }

    fn raise_checks(texts: &str, effects: &mut Effects<'_>) {
        let text = format!("checks of the vehicle before arming fail: {texts}");
        let priority = AlertPriority::Caution;
        effects.raise(Cause::ArmingChecks, priority, AUTOPILOT_SUBSYSTEM, text);
    }

    fn alert_plain(&mut self, now: Duration, event: &Received, effects: &mut Effects<'_>) {
        if let Some(priority) = event::priority(event.level) {
            self.alert(now, priority, event::plain(event), effects);
        }
    }

    /// Alerts, but of a storm only some, so that other alarms are seen; never fewer emergencies.
    fn alert(
        &mut self,
        now: Duration,
        priority: AlertPriority,
        mut text: String,
        effects: &mut Effects<'_>,
    ) {
        if !self.allowance.take(now, EVENTS) && priority != AlertPriority::Emergency {
            self.left_out += 1;
            return;
        }
        match std::mem::take(&mut self.left_out) {
            0 => {}
            left_out => text += &format!(" ({left_out} events before it are not reported)"),
        }
        effects.notify(priority, AUTOPILOT_SUBSYSTEM, text);
    }

    fn remember(&mut self, now: Duration, text: String, as_text: bool) {
        if self.alerted.len() >= MAX_WAITING {
            self.alerted.pop_front();
        }
        let until = now + TWIN_WITHIN;
        self.alerted.push_back(Alerted {
            until,
            text,
            as_text,
        });
    }

    /// Whether one like this was alerted just now. It answers for one twin.
    fn take(&mut self, now: Duration, like: impl Fn(&Alerted) -> bool) -> bool {
        self.alerted.retain(|one| one.until > now);
        let place = self.alerted.iter().position(like);
        place.is_some_and(|place| self.alerted.remove(place).is_some())
    }
}

/// Subsystem ID of what the autopilot reports of itself: VSM specific.
pub(super) const AUTOPILOT_SUBSYSTEM: SubsystemId = SubsystemId::from_raw(20);
/// PX4 sends both in the same round of its loop; a lost event is requested again for up to 2.5 s.
const TWIN_WITHIN: Duration = Duration::from_secs(3);
/// Events, and texts, that wait for their twins.
const MAX_WAITING: usize = 32;
/// PX4's navigation states that a CUCS commands, as bits: mission, loiter, return, take-off, land.
const COMMANDED_MODES: u32 = 1 << 3 | 1 << 4 | 1 << 5 | 1 << 17 | 1 << 18;
/// PX4 keeps a report to 14.
const MAX_CHECKS: usize = 64;
const NAMED_CHECKS: usize = 3;
const CHECKS_OVER: &str = "the vehicle's checks before arming no longer fail";
/// Four a second, 32 at once.
const EVENTS: Rate = Rate {
    cost: Duration::from_millis(250),
    burst: Duration::from_secs(8),
};
