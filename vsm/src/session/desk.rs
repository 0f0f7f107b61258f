//! What every machine of the DLI side needs to answer: the time, the stations, the queue, the store, the log.

use std::collections::VecDeque;

use mapping::alert;
use mavlink_link::Now;
use stanag_msgs::enums::{AckType, LoiBitmap};
use stanag_msgs::messages::MessageAcknowledgement;
use stanag_msgs::{Id, Message, TimeStamp};

use super::alerts::{Alerts, Raised};
use super::authority::Authority;
use super::counters::Counters;
use super::log::{LogEntry, LogLevel};
use super::outbox::{Destination, Outbox};
use super::station::Station;
use mavlink_link::store::Disk;

/// Borrowed for one call.
pub(crate) struct Desk<'a> {
    pub(crate) now: Now,
    pub(crate) vsm: Id,
    pub(crate) multicast: bool,
    pub(crate) loss: crate::config::Authority,
    pub(crate) provisional: crate::config::Provisional,
    pub(crate) stations: &'a mut [Station],
    /// Of the VSM itself, not of a vehicle.
    pub(crate) alerts: &'a mut Alerts,
    pub(crate) outbox: &'a mut Outbox,
    pub(crate) counters: &'a mut Counters,
    pub(crate) log: &'a mut VecDeque<LogEntry>,
    pub(crate) store: &'a mut dyn Disk,
}

/// A message of a CUCS that wants an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Origin {
    /// Index of the station.
    pub(crate) station: usize,
    pub(crate) message_type: u16,
    pub(crate) stamp: Option<TimeStamp>,
    pub(crate) ack_requested: bool,
}

impl Desk<'_> {
    /// The stamp of a message made now.
    pub(crate) fn stamp(&mut self) -> TimeStamp {
        self.outbox.stamp(self.now.wall)
    }

    /// Sends to one station, where it has been heard.
    pub(crate) fn send(&mut self, station: usize, source: Id, message: &Message) {
        if let Some(station) = self.stations.get(station)
            && let Some(peer) = station.peer
        {
            self.outbox
                .push(Destination::Unicast(peer), source, station.id(), message);
        }
    }

    /// Sends what nobody asked for just now to a station, and the same to the group where there is one: addressed to the
    /// station there too, so that it can be told from what another has scheduled.
    pub(crate) fn publish(&mut self, station: usize, source: Id, message: &Message) {
        self.send(station, source, message);
        if self.multicast
            && let Some(station) = self.stations.get(station)
        {
            self.outbox
                .push(Destination::Multicast, source, station.id(), message);
        }
    }

    /// Whether a message that names a VSM in a field is for this one: it, everybody or nobody in particular is named.
    pub(crate) fn is_meant(&self, vsm: Option<Id>) -> bool {
        vsm.is_none_or(|id| [self.vsm, Id::BROADCAST, Id::NULL, Id(0)].contains(&id))
    }

    /// Answers with 17000 where one was asked for, and remembers it for duplicates.
    pub(crate) fn acknowledge(&mut self, vehicle: Id, origin: &Origin, answer: AckType) {
        if answer == AckType::Refused {
            self.counters.count("refused");
        }
        if let (Some(station), Some(stamp)) = (self.stations.get_mut(origin.station), origin.stamp)
        {
            let seen = station.recent.answered(origin.message_type, stamp, answer);
            if let Some(seen) = seen {
                self.note_answer(origin.station, &seen);
            }
        }
        if !origin.ack_requested {
            return;
        }
        let message = MessageAcknowledgement {
            time_stamp: Some(self.stamp()),
            original_message_time_stamp: origin.stamp,
            original_message_type: Some(origin.message_type),
            acknowledgement_type: Some(answer),
        };
        self.send(
            origin.station,
            vehicle,
            &Message::MessageAcknowledgement(message),
        );
    }

    /// Whether a station holds LOI 2.
    pub(crate) fn listens(&self, authority: &Authority, station: usize) -> bool {
        let station = self.stations.get(station);
        station.is_some_and(|station| authority.holds(station.id(), LoiBitmap::LOI2))
    }

    /// The stations that hold LOI 2, and `also`.
    pub(crate) fn listeners(&self, authority: &Authority, also: Option<usize>) -> Vec<usize> {
        (0..self.stations.len())
            .filter(|index| self.listens(authority, *index) || also == Some(*index))
            .collect()
    }

    /// Sends an alert (16000) to these stations, by the group too, and writes it to the log.
    pub(crate) fn alert(&mut self, vehicle: Id, to: &[usize], raised: Option<Raised>) {
        let Some(Raised { alert, first }) = raised else {
            return;
        };
        self.note(LogLevel::of(alert.priority), vehicle, alert.text.clone());
        self.show(vehicle, to, &Raised { alert, first });
    }

    /// Sends an alert (16000) to these stations, by the group too.
    pub(crate) fn show(&mut self, vehicle: Id, to: &[usize], raised: &Raised) {
        let Raised { alert, first } = raised;
        let (outbox, wall) = (&mut *self.outbox, self.now.wall);
        let messages: Vec<Message> = alert::messages(alert, *first, || outbox.stamp(wall))
            .map(Message::SubsystemStatusAlert)
            .collect();
        for message in &messages {
            for station in to {
                self.publish(*station, vehicle, message);
            }
        }
    }

    /// Refuses, in the name of the VSM, a message that is for no vehicle in particular.
    pub(crate) fn refuse(&mut self, origin: &Origin, why: &str) {
        let vsm = self.vsm;
        self.acknowledge(vsm, origin, AckType::Refused);
        let text = format!("{} refused: {why}", origin.message_type);
        let to = [origin.station];
        let raised = self.alerts.answer_sometimes(self.now.mono, &to, text);
        self.alert(vsm, &to, raised);
    }

    /// Clears the VSM's own answers that have stood long enough.
    pub(crate) fn clear_answers(&mut self) {
        while let Some((to, raised)) = self.alerts.next_over(self.now.mono) {
            self.show(self.vsm, &to, &raised);
        }
    }

    /// A line of the log.
    pub(crate) fn note(&mut self, level: LogLevel, about: Id, text: String) {
        if self.log.len() < MAX_LOGGED {
            self.log.push_back(LogEntry { level, about, text });
        }
    }
}

const MAX_LOGGED: usize = 1_024;
