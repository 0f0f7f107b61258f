//! Alerts (16000): a text longer than one message is joined from its parts.

use std::collections::{BTreeMap, VecDeque};

use stanag_msgs::TimeStamp;
use stanag_msgs::enums::{AlertPriority, SubsystemId};
use stanag_msgs::messages::SubsystemStatusAlert;

/// One alert of a vehicle, complete.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Alert {
    /// Its number among all alerts of this vehicle: rises by 1 with each.
    pub index: u64,
    /// Alert ID (1100.08) without its sign: later alerts with the same id are updates.
    pub id: u32,
    /// Whether it is the first message with this id: the field was negative.
    pub first: bool,
    /// Its urgency.
    pub priority: AlertPriority,
    /// The subsystem that it is about.
    pub subsystem: Option<SubsystemId>,
    /// The text, parts joined.
    pub text: String,
    /// The stamp of its last part.
    pub stamp: Option<TimeStamp>,
}

/// The alerts of one vehicle: the complete ones, and those with parts missing.
#[derive(Clone, Debug, Default)]
pub(crate) struct Alerts {
    whole: VecDeque<Alert>,
    partial: BTreeMap<u32, BTreeMap<u8, String>>,
    stamps: VecDeque<TimeStamp>,
    next: u64,
}

/// The result of receiving a 16000.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Taken {
    /// The last part of an alert, or the only one.
    Whole(Alert),
    /// Parts are still missing.
    Part,
    /// It was received before.
    Duplicate,
}

impl Alerts {
    pub(crate) fn take(&mut self, message: &SubsystemStatusAlert) -> Taken {
        if let Some(stamp) = message.time_stamp {
            // A retransmission has the same stamp.
            if self.stamps.contains(&stamp) {
                return Taken::Duplicate;
            }
            push_bounded(&mut self.stamps, stamp, MAX_STAMPS);
        }
        let number = message.alert_warning_id.unwrap_or(0);
        let id = number.unsigned_abs();
        let text = message.text.as_ref().map_or("", |text| text.as_str());
        let Some(text) = self.join(id, message, text) else {
            return Taken::Part;
        };
        let alert = Alert {
            index: self.next,
            id,
            first: number < 0,
            priority: message.priority.unwrap_or(AlertPriority::Nominal),
            subsystem: message.subsystem_id,
            text,
            stamp: message.time_stamp,
        };
        self.next += 1;
        push_bounded(&mut self.whole, alert.clone(), MAX_ALERTS);
        Taken::Whole(alert)
    }

    /// The whole text, once its last part has arrived.
    fn join(&mut self, id: u32, message: &SubsystemStatusAlert, text: &str) -> Option<String> {
        let total = message.append_total_number.unwrap_or(1);
        let Some(order) = message.append_order.filter(|_| total > 1) else {
            self.partial.remove(&id);
            return Some(text.to_owned());
        };
        if self.partial.len() >= MAX_PARTIAL && !self.partial.contains_key(&id) {
            self.partial.pop_first();
        }
        let parts = self.partial.entry(id).or_default();
        // The same part with a new stamp: the alert is sent again, and parts of the two must not be mixed.
        if parts.contains_key(&order) {
            parts.clear();
        }
        parts.insert(order, text.to_owned());
        if parts.len() < usize::from(total) {
            return None;
        }
        let parts = self.partial.remove(&id)?;
        Some(parts.into_values().collect())
    }

    /// All kept alerts, oldest first.
    pub(crate) fn iter(&self) -> impl DoubleEndedIterator<Item = &Alert> {
        self.whole.iter()
    }

    /// The index that the next alert will have.
    pub(crate) fn next_index(&self) -> u64 {
        self.next
    }
}

/// Drops the oldest where the queue is full.
pub(super) fn push_bounded<T>(queue: &mut VecDeque<T>, item: T, most: usize) {
    if queue.len() >= most {
        queue.pop_front();
    }
    queue.push_back(item);
}

// Limits for what a vehicle may make this station keep: alerts, alerts with parts missing, stamps of duplicates.
const MAX_ALERTS: usize = 512;
const MAX_PARTIAL: usize = 32;
const MAX_STAMPS: usize = 256;

#[cfg(test)]
mod tests {
    use super::*;

    fn part(stamp: u64, order: u8, total: u8, text: &str) -> SubsystemStatusAlert {
        SubsystemStatusAlert {
            time_stamp: Some(TimeStamp(stamp)),
            alert_warning_id: Some(-7),
            priority: Some(AlertPriority::Caution),
            text: Some(text.into()),
            append_order: Some(order),
            append_total_number: Some(total),
            ..SubsystemStatusAlert::default()
        }
    }

    #[test]
    fn parts_are_joined_in_order_however_they_arrive() {
        let mut alerts = Alerts::default();
        assert_eq!(alerts.take(&part(3, 3, 3, "c")), Taken::Part);
        assert_eq!(alerts.take(&part(1, 1, 3, "a ")), Taken::Part);
        assert_eq!(alerts.take(&part(1, 1, 3, "a ")), Taken::Duplicate);
        let Taken::Whole(alert) = alerts.take(&part(2, 2, 3, "b ")) else {
            panic!("not whole");
        };
        assert_eq!(
            (alert.text.as_str(), alert.id, alert.first),
            ("a b c", 7, true)
        );
        assert_eq!(alerts.take(&part(3, 3, 3, "c")), Taken::Duplicate);
        assert_eq!(alerts.iter().count(), 1);
    }

    #[test]
    fn a_lost_part_does_not_mix_two_alerts() {
        let mut alerts = Alerts::default();
        assert_eq!(alerts.take(&part(1, 1, 2, "old ")), Taken::Part);
        assert_eq!(alerts.take(&part(11, 1, 2, "new ")), Taken::Part);
        let Taken::Whole(alert) = alerts.take(&part(12, 2, 2, "text")) else {
            panic!("not whole");
        };
        assert_eq!(alert.text, "new text");
    }

    #[test]
    fn memory_is_bounded() {
        let mut alerts = Alerts::default();
        for stamp in 0..10_000 {
            let mut message = part(stamp, 1, 2, "x");
            message.alert_warning_id = Some(stamp as i32);
            alerts.take(&message);
            message.append_total_number = None;
            message.time_stamp = None;
            alerts.take(&message);
        }
        assert!(alerts.partial.len() <= MAX_PARTIAL);
        assert_eq!(alerts.iter().count(), MAX_ALERTS);
        assert_eq!(alerts.next_index(), 10_000);
    }
}
