//! The active alerts and their ids: an alert is raised once, updated when it changes, and cleared when its cause is gone.

use std::collections::VecDeque;
use std::time::Duration;

use mapping::alert::{Alert, count};
use mapping::health::HealthFault;
use stanag_msgs::Id;
use stanag_msgs::enums::{AlertPriority, SubsystemId};

use super::allowance::Allowance;
use super::findings::Code;
use super::limits::{ALERTS, NOTICES, REFUSALS, SAME_REFUSAL};
use super::trigger::Trigger;

/// A lasting cause. Each has at most one active alert per vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cause {
    /// No verified data from the vehicle.
    VehicleSilent,
    /// Signing is off by configuration.
    SigningOff,
    /// The controlling CUCS is silent.
    CucsSilent,
    /// The controlling CUCS is lost, and the vehicle does not carry out the configured loss action.
    LossAction,
    /// The cause of a contingency, and the action flown for it.
    Contingency(Trigger),
    /// The vehicle does not report the values that a contingency needs.
    ContingencyUnwatched,
    /// The state of a contingency cannot be stored.
    ContingencyRecord,
    /// A record could not be written.
    Store,
    /// Written data cannot be made durable on the disk.
    Disk,
    /// Commands cannot be logged.
    CommandLog,
    /// Held commands cannot be stored.
    HeldCommands,
    /// What the vehicle does by itself when its link to the ground is lost.
    OwnFailsafe,
    /// Another MAVLink system has operator control of the vehicle.
    OperatorControl,
    /// The mission makes no progress, and the vehicle was commanded to hold.
    Stalled,
    /// The vehicle makes no progress in its landing pattern.
    LandingPattern,
    /// The vehicle sank below its mission and was commanded to hold.
    Sinking,
    /// The audit log's hash chain is broken.
    Audit,
    /// A new key is waiting, or the key exchange fails.
    KeyExchange,
    /// The vehicle is outside its altitude limits.
    AltitudeBand,
    /// The geofence aboard is not the loaded one.
    Fence,
    /// The vehicle holds a route whose load ended early.
    EndedLoad,
    /// The vehicle finds the route aboard infeasible within its fence.
    Infeasible,
    /// A leg of the route aboard crosses an area of the fence.
    LegAcross,
    /// The rally points aboard are not those of the configuration.
    Rally,
    /// The vehicle's RTL_TYPE ignores the rally points.
    RallyIgnored,
    /// A flight termination is armed, commanded or executed.
    Termination,
    /// The vehicle's own checks prevent arming.
    ArmingChecks,
    /// The vehicle no longer reports its position.
    Unreported,
    /// A zeroize is armed or ordered.
    Zeroize,
    /// A fault that the vehicle itself reports.
    HealthFault(HealthFault),
    /// A finding; the number distinguishes several with the same code.
    Finding(Code, u32),
}

impl Cause {
    /// Whether it explains why no data of the vehicle is received. (A vehicle that does not receive us is itself received.)
    fn explains_silence(self) -> bool {
        matches!(
            self,
            Cause::Finding(
                Code::MavlinkNone
                    | Code::MavlinkUnreadable
                    | Code::MavlinkVersion
                    | Code::MavlinkOtherSystem
                    | Code::MavlinkUnsigned
                    | Code::MavlinkOtherKey
                    | Code::MavlinkLinkId
                    | Code::MavlinkStale
                    | Code::MavlinkAhead
                    | Code::MavlinkTwoSenders,
                _
            )
        )
    }
}

/// The alerts (16000) of one vehicle.
#[derive(Debug, Default)]
pub(crate) struct Alerts {
    next_id: i32,
    standing: Vec<(Cause, Alert)>,
    /// Texts sent recently, so that a repeated text is not sent a hundred times.
    lately: Vec<(Duration, AlertPriority, String)>,
    /// Answers that are shown, the oldest first.
    answers: VecDeque<Answered>,
    /// Refusals, by station.
    refusals: Vec<Refusals>,
    /// Whether the notice was sent that AGL is flown as height above home.
    agl_sent: bool,
    /// The alert that the vehicle is silent, while a finding that explains the silence is shown in its place: one fault, one
    /// alert.
    silence: Option<Alert>,
    /// Active alerts that a station has acknowledged.
    acknowledged: Vec<Acknowledged>,
    /// Rate limits of one-time notices: emergencies, and all others.
    notices: [Allowance; 2],
    left_out: u32,
    /// Rate limit of alerts that begin, change and end.
    changes: Allowance,
    /// Changes delayed by the rate limit, so that one vehicle changing with every frame cannot crowd out other vehicles'
    /// alerts.
    late: Vec<Raised>,
}

/// An alert that a station has acknowledged.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Acknowledged {
    id: i32,
    pub(crate) cucs: Id,
    /// By the wall clock.
    pub(crate) at: Duration,
}

/// The rate-limited refusals sent to a group of stations.
#[derive(Debug, Default)]
struct Refusals {
    to: Vec<usize>,
    /// Rate limit of all texts.
    all: Allowance,
    /// Rate limit of each text that was sent recently.
    texts: Vec<(String, Allowance)>,
    left_out: u32,
}

impl Refusals {
    /// Whether another refusal with this text may be sent.
    fn takes(&mut self, now: Duration, text: &str) -> bool {
        self.texts.retain(|(_, same)| !same.is_full(now));
        let known = self.texts.iter().position(|(known, _)| known == text);
        let mut same = known.map_or_else(Allowance::default, |at| self.texts.swap_remove(at).1);
        let sent = same.take(now, SAME_REFUSAL) && self.all.take(now, REFUSALS);
        // Store only texts that were sent: the other rate limit then bounds their number.
        if sent || known.is_some() {
            self.texts.push((text.to_owned(), same));
        }
        sent
    }
}

/// An answer to one message.
#[derive(Debug)]
struct Answered {
    /// When it is cleared.
    until: Duration,
    id: i32,
    /// The stations that were notified.
    to: Vec<usize>,
}

/// An alert to send.
#[derive(Debug, Clone)]
pub(crate) struct Raised {
    pub(crate) alert: Alert,
    /// Whether it is the first message with this id.
    pub(crate) first: bool,
}

impl Alerts {
    /// `seed` keeps the alert ids of the vehicles of one VSM apart.
    pub(crate) fn new(seed: i32) -> Alerts {
        Alerts {
            next_id: seed * IDS_A_VEHICLE + 1,
            ..Alerts::default()
        }
    }

    /// Returns the change if the rate limit allows it now; otherwise its latest state is sent later. An alert that ends
    /// before its start was sent is never sent.
    pub(crate) fn paced(&mut self, now: Duration, raised: Raised) -> Option<Raised> {
        if let Some(at) = self
            .late
            .iter()
            .position(|one| one.alert.id == raised.alert.id)
        {
            let first = self.late[at].first;
            if first && raised.alert.priority == AlertPriority::Cleared {
                self.late.remove(at);
            } else {
                self.late[at] = Raised { first, ..raised };
            }
            return None;
        }
        let messages = count(&raised.alert.text);
        if self.late.is_empty() && self.changes.take_all(now, ALERTS, messages) {
            return Some(raised);
        }
        self.late.push(raised);
        None
    }

    /// The next delayed change, once the rate limit allows it.
    pub(crate) fn next_late(&mut self, now: Duration) -> Option<Raised> {
        let messages = count(&self.late.first()?.alert.text);
        let due = self.changes.take_all(now, ALERTS, messages);
        due.then(|| self.late.remove(0))
    }

    /// Whether it is the first time that altitude type 2 (AGL) is flown as height above home.
    pub(crate) fn first_agl(&mut self) -> bool {
        !std::mem::replace(&mut self.agl_sent, true)
    }

    /// Raises a lasting cause; returns `None` if it is already active with this text.
    pub(crate) fn raise(
        &mut self,
        cause: Cause,
        priority: AlertPriority,
        subsystem: SubsystemId,
        text: String,
    ) -> Option<Raised> {
        if let Some((_, standing)) = self.standing.iter_mut().find(|(known, _)| *known == cause) {
            if standing.text == text && standing.priority == priority {
                return None;
            }
            // The station acknowledged another text.
            self.acknowledged.retain(|one| one.id != standing.id);
            // The id stays: a CUCS updates the alert that it shows instead of adding another.
            standing.text = text;
            standing.priority = priority;
            return Some(Raised {
                alert: standing.clone(),
                first: false,
            });
        }
        let mut alert = Alert {
            id: 0,
            priority,
            subsystem,
            text,
            lasting: true,
        };
        if let Some((_, finding)) = self
            .standing
            .iter()
            .find(|(known, _)| cause == Cause::VehicleSilent && known.explains_silence())
        {
            alert.id = finding.id;
            self.silence = Some(alert);
            return None;
        }
        let silent = |(known, _): &(Cause, Alert)| *known == Cause::VehicleSilent;
        if let (true, Some(at)) = (
            cause.explains_silence(),
            self.standing.iter().position(silent),
        ) {
            let (_, silence) = self.standing.remove(at);
            alert.id = silence.id;
            self.silence = Some(silence);
            self.standing.push((cause, alert.clone()));
            return Some(Raised {
                alert,
                first: false,
            });
        }
        alert.id = self.take_id();
        self.standing.push((cause, alert.clone()));
        Some(Raised { alert, first: true })
    }

    /// Clears a cause; returns `None` if it was not active.
    pub(crate) fn clear(&mut self, cause: Cause, text: &str) -> Option<Raised> {
        if cause == Cause::VehicleSilent {
            // The finding in its place is checked separately, within a second.
            self.silence = None;
        }
        let at = self
            .standing
            .iter()
            .position(|(known, _)| *known == cause)?;
        let (_, mut alert) = self.standing.remove(at);
        if cause.explains_silence()
            && let Some(silence) = self.silence.take()
        {
            // The reason is gone, but the vehicle is still silent.
            self.standing.push((Cause::VehicleSilent, silence.clone()));
            return Some(Raised {
                alert: silence,
                first: false,
            });
        }
        alert.priority = AlertPriority::Cleared;
        text.clone_into(&mut alert.text);
        Some(Raised {
            alert,
            first: false,
        })
    }

    /// Reports a one-time event; returns `None` if the same text was sent less than [`QUIET`] ago. If there are too many at
    /// once, those that need no action are dropped first. The rest is limited to [`NOTICES`], separately for emergencies,
    /// and the next notice says how many were dropped: a vehicle that sends thousands of texts must not use up the rate at
    /// which a station receives alerts of other vehicles.
    pub(crate) fn notice(
        &mut self,
        now: Duration,
        priority: AlertPriority,
        subsystem: SubsystemId,
        text: String,
    ) -> Option<Raised> {
        if self.was_said_lately(now, priority, &text) {
            return None;
        }
        if self.lately.len() >= MAX_LATELY {
            if !matters(priority) {
                self.left_out += 1;
                return None;
            }
            // The forgotten text has been sent; it may only be sent a second time.
            let lesser = |(_, known, _): &(Duration, AlertPriority, String)| !matters(*known);
            let forgotten = self.lately.iter().position(lesser).unwrap_or(0);
            self.lately.remove(forgotten);
        }
        let whole = match self.left_out {
            0 => text.clone(),
            left_out => format!("{text} ({left_out} texts and events before it are not reported)"),
        };
        let of = usize::from(priority != AlertPriority::Emergency);
        if !self.notices[of].take_all(now, NOTICES, count(&whole)) {
            self.left_out += 1;
            return None;
        }
        self.left_out = 0;
        self.lately.push((now, priority, text));
        let text = whole;
        Some(Raised {
            alert: Alert {
                id: self.take_id(),
                priority,
                subsystem,
                text,
                lasting: false,
            },
            first: true,
        })
    }

    /// The answer to one command: always sent, even if the same text was sent just now. It is shown for [`ANSWER_STANDS`],
    /// so that it can be read, and cleared by [`Alerts::next_over`].
    pub(crate) fn answer(&mut self, now: Duration, to: &[usize], text: String) -> Raised {
        let id = self.take_id();
        self.answers.push_back(Answered {
            until: now + ANSWER_STANDS,
            id,
            to: to.to_vec(),
        });
        Raised {
            alert: Alert {
                id,
                priority: AlertPriority::Caution,
                subsystem: SubsystemId::VsmStatus,
                text,
                lasting: false,
            },
            first: true,
        }
    }

    /// The reason why a command is refused. In a storm of refusals only some are sent, so that an alarm among them is seen:
    /// `None` for the others, which the next refusal counts. Each command is still answered by 17000.
    pub(crate) fn refusal(&mut self, now: Duration, to: &[usize], text: String) -> Option<Raised> {
        self.paced_answer(now, to, text, "refusals")
    }

    /// What has become of a handover, for its parties. One who may request rights may do so without end, so these texts have the
    /// rate of refusals; the messages 2, 4, 5 and 17000 do not depend on them.
    pub(crate) fn handover(&mut self, now: Duration, to: &[usize], text: String) -> Option<Raised> {
        self.paced_answer(now, to, text, "texts")
    }

    fn paced_answer(
        &mut self,
        now: Duration,
        to: &[usize],
        mut text: String,
        what: &str,
    ) -> Option<Raised> {
        let at = self.refusals.iter().position(|one| one.to == to);
        let at = at.unwrap_or_else(|| {
            self.refusals.push(Refusals {
                to: to.to_vec(),
                ..Refusals::default()
            });
            self.refusals.len() - 1
        });
        let one = self.refusals.get_mut(at)?;
        if !one.takes(now, &text) {
            one.left_out += 1;
            return None;
        }
        match std::mem::take(&mut one.left_out) {
            0 => {}
            left_out => text += &format!(" ({left_out} {what} before it are not reported)"),
        }
        Some(self.answer(now, to, text))
    }

    /// The same for messages that a station may repeat without limit: `None` if the same text was sent less than [`QUIET`]
    /// ago.
    pub(crate) fn answer_sometimes(
        &mut self,
        now: Duration,
        to: &[usize],
        text: String,
    ) -> Option<Raised> {
        if self.was_said_lately(now, AlertPriority::Caution, &text)
            || self.lately.len() >= MAX_LATELY
        {
            return None;
        }
        self.lately
            .push((now, AlertPriority::Caution, text.clone()));
        Some(self.answer(now, to, text))
    }

    /// The next answer that was shown long enough, and the stations that received it.
    pub(crate) fn next_over(&mut self, now: Duration) -> Option<(Vec<usize>, Raised)> {
        let full = self.answers.len() > MAX_ANSWERS;
        let over = self
            .answers
            .front()
            .is_some_and(|oldest| oldest.until <= now);
        let answered = (full || over).then(|| self.answers.pop_front()).flatten()?;
        let alert = Alert {
            id: answered.id,
            priority: AlertPriority::Cleared,
            subsystem: SubsystemId::VsmStatus,
            text: "an earlier answer no longer stands".to_owned(),
            lasting: false,
        };
        let raised = Raised {
            alert,
            first: false,
        };
        Some((answered.to, raised))
    }

    /// When the next answer is cleared, or a delayed change may be sent.
    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        let over = self.answers.front().map(|oldest| oldest.until);
        let late = self.late.first();
        let late = late.map(|one| self.changes.next_at(ALERTS, count(&one.alert.text)));
        over.into_iter().chain(late).min()
    }

    fn was_said_lately(&mut self, now: Duration, priority: AlertPriority, text: &str) -> bool {
        self.lately
            .retain(|(at, ..)| now.saturating_sub(*at) < QUIET);
        let mut lately = self.lately.iter();
        lately.any(|(_, known, same)| *known == priority && same == text)
    }

    /// An active finding that is no longer in `found`: its cause and its text.
    pub(crate) fn ended_finding(&self, found: &[(Code, u32)]) -> Option<(Cause, String)> {
        let ended = self.standing.iter().find(|(cause, _)| match cause {
            Cause::Finding(code, key) => !found.contains(&(*code, *key)),
            _ => false,
        });
        ended.map(|(cause, alert)| (*cause, alert.text.clone()))
    }

    /// A station acknowledges an active alert. Returns the alert's text if this station had not acknowledged it before.
    pub(crate) fn acknowledge(&mut self, id: i32, cucs: Id, at: Duration) -> Option<&str> {
        let (standing, acknowledged) = (&self.standing, &mut self.acknowledged);
        acknowledged.retain(|one| standing.iter().any(|(_, alert)| alert.id == one.id));
        let (_, alert) = standing.iter().find(|(_, alert)| alert.id == id)?;
        let known = |one: &Acknowledged| (one.id, one.cucs) == (id, cucs);
        if acknowledged.iter().any(known) {
            return None;
        }
        acknowledged.push(Acknowledged { id, cucs, at });
        Some(&alert.text)
    }

    /// The stations that have acknowledged an active alert, in order.
    pub(crate) fn acknowledged(&self, alert: &Alert) -> impl Iterator<Item = &Acknowledged> {
        let id = alert.id;
        self.acknowledged.iter().filter(move |one| one.id == id)
    }

    /// Whether an alert of this cause is active.
    pub(crate) fn stands(&self, cause: Cause) -> bool {
        self.standing.iter().any(|(known, _)| *known == cause)
    }

    /// The active alerts, for a CUCS that starts to listen.
    pub(crate) fn standing(&self) -> impl Iterator<Item = &Alert> {
        self.standing.iter().map(|(_, alert)| alert)
    }

    fn take_id(&mut self) -> i32 {
        let id = self.next_id;
        let base = (id - 1) / IDS_A_VEHICLE * IDS_A_VEHICLE;
        // After its last id a vehicle starts again with its first one, so it never uses an id of another vehicle.
        self.next_id = base + 1 + (id - base) % (IDS_A_VEHICLE - 1);
        id
    }
}

/// Whether an operator must see it: every priority but nominal and cleared.
fn matters(priority: AlertPriority) -> bool {
    !matches!(priority, AlertPriority::Cleared | AlertPriority::Nominal)
}

/// Ids reserved for each vehicle. (Stations know an alert's vehicle from the source in the wrapper.)
const IDS_A_VEHICLE: i32 = 1_000_000;
/// The same text is not repeated within this time.
const QUIET: Duration = Duration::from_secs(2);
/// Maximum number of different texts within [`QUIET`].
const MAX_LATELY: usize = 50;
/// How long the answer to a command is shown.
const ANSWER_STANDS: Duration = Duration::from_secs(15);
/// Maximum number of answers shown at once: beyond it the oldest is cleared early.
const MAX_ANSWERS: usize = 256;

#[cfg(test)]
mod tests {
    use super::*;

    fn notice(alerts: &mut Alerts, priority: AlertPriority, text: String) -> bool {
        alerts
            .notice(Duration::ZERO, priority, SubsystemId::VsmStatus, text)
            .is_some()
    }

    #[test]
    fn of_many_texts_none_that_warns_is_left_out() {
        let mut alerts = Alerts::new(0);
        for n in 0..MAX_LATELY {
            assert!(notice(
                &mut alerts,
                AlertPriority::Nominal,
                format!("info {n}")
            ));
        }
        assert!(!notice(
            &mut alerts,
            AlertPriority::Nominal,
            "one more".to_owned()
        ));
        for n in 0..3 * MAX_LATELY {
            let priority = [
                AlertPriority::Caution,
                AlertPriority::Warning,
                AlertPriority::Emergency,
            ][n % 3];
            assert!(notice(&mut alerts, priority, format!("warning {n}")), "{n}");
        }
        assert!(!notice(
            &mut alerts,
            AlertPriority::Nominal,
            "and one".to_owned()
        ));
        assert_eq!(alerts.lately.len(), MAX_LATELY);
    }

    #[test]
    fn a_text_without_room_among_those_of_now_is_counted_by_the_next_one() {
        let mut alerts = Alerts::new(0);
        for n in 0..=MAX_LATELY {
            let sent = notice(&mut alerts, AlertPriority::Nominal, format!("info {n}"));
            assert_eq!(sent, n < MAX_LATELY);
        }
        let (priority, of) = (AlertPriority::Warning, SubsystemId::VsmStatus);
        let raised = alerts.notice(Duration::ZERO, priority, of, "low battery".to_owned());
        let text = raised.expect("it warns").alert.text;
        assert_eq!(
            text,
            "low battery (1 texts and events before it are not reported)"
        );
    }

    #[test]
    fn of_a_flood_of_warnings_some_are_sent_and_the_next_one_counts_the_rest() {
        let mut alerts = Alerts::new(0);
        let mut sent = 0;
        for n in 0..20_000_u32 {
            let now = Duration::from_micros(500) * n;
            let text = format!("warning {n}");
            sent += u32::from(
                alerts
                    .notice(now, AlertPriority::Warning, SubsystemId::VsmStatus, text)
                    .is_some(),
            );
        }
        // In ten seconds.
        assert!((240..=340).contains(&sent), "{sent}");
        let later = Duration::from_secs(60);
        let last = alerts.notice(
            later,
            AlertPriority::Warning,
            SubsystemId::VsmStatus,
            "the last".to_owned(),
        );
        let text = last.expect("it is sent").alert.text;
        assert!(
            text.starts_with("the last (")
                && text.ends_with(" texts and events before it are not reported)"),
            "{text}"
        );
        // What is an emergency does not wait for the others.
        let now = Duration::from_secs(10);
        assert!(
            alerts
                .notice(
                    now,
                    AlertPriority::Emergency,
                    SubsystemId::VsmStatus,
                    "fire".to_owned()
                )
                .is_some()
        );
    }

    #[test]
    fn a_long_text_takes_as_much_of_the_rate_as_its_messages() {
        let mut alerts = Alerts::new(0);
        let mut messages = 0;
        for n in 0..10_000_u32 {
            let now = Duration::from_millis(1) * n;
            let text = format!("{n} {}", "x".repeat(230));
            let raised = alerts.notice(now, AlertPriority::Warning, SubsystemId::VsmStatus, text);
            messages += raised.map_or(0, |raised| count(&raised.alert.text));
        }
        // In ten seconds.
        assert!((240..=330).contains(&messages), "{messages}");
        let mut alerts = Alerts::new(0);
        let mut messages = 0;
        for n in 0..10_000_u32 {
            let now = Duration::from_millis(1) * n;
            let text = format!("{n} {}", "x".repeat(700));
            let caution = AlertPriority::Caution;
            let raised = alerts.raise(Cause::ArmingChecks, caution, SubsystemId::Comms, text);
            let raised = raised.and_then(|raised| alerts.paced(now, raised));
            for one in raised.into_iter().chain(alerts.next_late(now)) {
                messages += count(&one.alert.text);
            }
        }
        assert!((200..=410).contains(&messages), "{messages}");
        let due = alerts.poll_timeout().expect("the latest text is delayed");
        assert!(alerts.next_late(due).is_some());
    }

    #[test]
    fn what_flutters_is_sent_at_a_rate_and_in_the_end_as_it_stands() {
        let mut alerts = Alerts::new(0);
        let (mut sent, mut shown) = (0, false);
        let mut take = |raised: Option<Raised>| {
            if let Some(raised) = raised {
                sent += 1;
                shown = raised.alert.priority != AlertPriority::Cleared;
            }
        };
        for n in 0..10_001_u32 {
            let now = Duration::from_millis(1) * n;
            while let Some(late) = alerts.next_late(now) {
                take(Some(late));
            }
            let raised = if n % 2 == 0 {
                alerts.raise(
                    Cause::Fence,
                    AlertPriority::Warning,
                    SubsystemId::Comms,
                    format!("outside {n}"),
                )
            } else {
                alerts.clear(Cause::Fence, "inside")
            };
            take(raised.and_then(|raised| alerts.paced(now, raised)));
        }
        assert_eq!(alerts.standing().count(), 1);
        while let Some(due) = alerts.poll_timeout() {
            take(alerts.next_late(due));
        }
        assert!(shown, "what stands was sent");
        assert!((200..=420).contains(&sent), "{sent}");
    }

    #[test]
    fn of_a_storm_of_refusals_some_are_sent_and_the_rest_is_counted() {
        for (differ, least, most) in [(false, 4, 6), (true, 32, 48)] {
            let mut alerts = Alerts::new(0);
            let mut sent = 0;
            for n in 0..300 {
                let text = format!("refused {}", if differ { n } else { 0 });
                let raised = alerts.refusal(Duration::from_millis(10 * n), &[0], text);
                sent += u32::from(raised.is_some());
            }
            assert!((least..=most).contains(&sent), "{differ}: {sent}");
            assert!(alerts.refusals[0].texts.len() <= 40);
            // Another reason, another station, and what matters more.
            let now = Duration::from_secs(4);
            let other = alerts.refusal(now, &[0], "another".to_owned());
            let text = other.expect("it is sent").alert.text;
            assert!(text.starts_with("another ("), "{text}");
            assert!(
                text.ends_with(" refusals before it are not reported)"),
                "{text}"
            );
            let next = alerts.refusal(now, &[1], "refused 0".to_owned());
            assert_eq!(next.expect("it is sent").alert.text, "refused 0");
            assert!(notice(
                &mut alerts,
                AlertPriority::Emergency,
                "engine".to_owned()
            ));
            alerts.refusal(Duration::from_secs(60), &[0], "late".to_owned());
            assert_eq!(alerts.refusals[0].texts.len(), 1);
        }
    }

    #[test]
    fn why_the_vehicle_is_silent_stands_in_place_of_that_it_is() {
        let mut alerts = Alerts::new(0);
        let caution = AlertPriority::Caution;
        let (silent, why) = (
            Cause::VehicleSilent,
            Cause::Finding(Code::MavlinkUnsigned, 0),
        );
        let raise = |alerts: &mut Alerts, cause, text: &str| {
            let raised = alerts.raise(cause, caution, SubsystemId::Comms, text.to_owned());
            raised.map(|raised| (raised.alert.id, raised.alert.text, raised.first))
        };
        let texts = |alerts: &Alerts| -> Vec<String> {
            alerts.standing().map(|alert| alert.text.clone()).collect()
        };
        assert_eq!(
            raise(&mut alerts, silent, "silent"),
            Some((1, "silent".into(), true))
        );
        assert_eq!(
            raise(&mut alerts, why, "unsigned"),
            Some((1, "unsigned".into(), false))
        );
        assert_eq!(texts(&alerts), ["unsigned"]);
        assert_eq!(raise(&mut alerts, silent, "silent again"), None);
        // Why is over, and it is still silent; then it is received.
        let back = alerts.clear(why, "cleared").expect("it stood").alert;
        assert_eq!(
            (back.id, back.text.as_str(), back.priority),
            (1, "silent again", caution)
        );
        assert_eq!(
            raise(&mut alerts, why, "unsigned"),
            Some((1, "unsigned".into(), false))
        );
        assert!(alerts.clear(silent, "received").is_none());
        let over = alerts.clear(why, "cleared").expect("it stood").alert;
        assert_eq!((over.id, over.priority), (1, AlertPriority::Cleared));
        assert!(texts(&alerts).is_empty());
        // Another kind of finding stands for itself.
        let other = Cause::Finding(Code::MavlinkUnanswered, 0);
        raise(&mut alerts, silent, "silent");
        assert_eq!(
            raise(&mut alerts, other, "deaf").map(|(_, _, first)| first),
            Some(true)
        );
        assert_eq!(texts(&alerts), ["silent", "deaf"]);
    }

    #[test]
    fn the_same_text_is_said_once_and_again_where_it_matters_more() {
        let mut alerts = Alerts::new(0);
        let mut raise = |priority| notice(&mut alerts, priority, "battery".to_owned());
        assert!(raise(AlertPriority::Nominal));
        assert!(!raise(AlertPriority::Nominal));
        assert!(raise(AlertPriority::Warning));
    }
}
