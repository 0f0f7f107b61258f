//! The address of a station: messages from another address wait until that is proven (see [`paths`](crate::session)).

use std::net::SocketAddr;

use mavlink_link::Now;
use mavlink_link::store::Disk;
use stanag_msgs::messages::{Heartbeat, MessageAcknowledgement};
use stanag_msgs::wrapper::Frame;
use stanag_msgs::{Message, TimeStamp, ed25};

use super::{Bridge, PAUSED};
use crate::session::authority::Input;
use crate::session::dates::wall_ms;
use crate::session::log::LogLevel;
use crate::session::outbox::{Destination, Outbox};
use crate::session::paths::{Arrival, Kind, Proof, question_bytes};

/// The parts of a message that concern its station's address.
pub(super) struct Arriving<'a> {
    /// The whole message, for a delayed delivery.
    pub(super) bytes: &'a [u8],
    /// It is of Edition 2.5.
    pub(super) ed25: bool,
    /// It is an acknowledgement without other effects.
    pub(super) acknowledges: bool,
    /// The stamp of our challenge that it answers.
    pub(super) answer: Option<TimeStamp>,
}

impl Bridge {
    /// Whether a frame comes from its station's address and may be handled. Otherwise it is held back.
    pub(super) fn is_there(
        &mut self,
        now: Now,
        from: SocketAddr,
        index: usize,
        arriving: &Arriving<'_>,
        disk: &mut dyn Disk,
    ) -> bool {
        let id = self.stations[index].id();
        let aircraft = &mut self.aircraft;
        // An attacker may send copies of sealed datagrams from elsewhere, faster than the originals: while the guard is
        // received at its address, no other computer can replace it, even if it relays our challenges.
        let peer = self.paths.peer(index);
        let copied = self.handled.guarded.is_some()
            && peer.is_some_and(|peer| peer.ip() != from.ip())
            && !self.paths.is_quiet(now.mono, index);
        let controls = || copied || aircraft.controls(id);
        let (came, at) = ((arriving.bytes.len(), arriving.ed25), (from, arriving.ed25));
        let arrival = self.paths.arrived(now.mono, index, from, came, controls);
        match arrival {
            Arrival::Moved => self.moved(now, index, disk),
            Arrival::Current => self.forget_cut_off(index),
            Arrival::Unproven => {}
        }
        let mut taken = arrival != Arrival::Unproven;
        if let Some(stamp) = arriving.answer.filter(|_| !copied) {
            let stamped = self.stamped(now);
            match self.paths.answered(stamped, index, from, stamp) {
                Proof::None => {}
                Proof::Round => self.ask(now, index, at, true),
                Proof::Proven { moved } => {
                    if moved {
                        self.moved(now, index, disk);
                        taken = true;
                    }
                    self.note_path(index);
                    if self.paths.take_missed(index) {
                        self.welcome(now, index, true, disk);
                    }
                }
            }
        }
        self.ask(now, index, at, false);
        self.send_waiting(now, index);
        if !taken && !arriving.acknowledges {
            let key = self.stations[index].sealed_under;
            self.counters.count(if self.outbox.is_paused() {
                PAUSED
            } else if self.paths.hold(index, from, arriving.bytes, key) {
                "held back until the address is proven"
            } else {
                "unproven address"
            });
        }
        taken
    }

    /// The stamp of our heartbeat that a 17000 acknowledges.
    pub(super) fn answer_in(&self, frame: &Frame<'_>) -> Option<TimeStamp> {
        if frame.header.message_type != MessageAcknowledgement::ID
            || frame.header.destination != self.vsm
        {
            return None;
        }
        let readings = self.readings_of(frame.header.source);
        match readings.decode(MessageAcknowledgement::ID, frame.data) {
            Ok(Message::MessageAcknowledgement(answer))
                if answer.original_message_type == Some(Heartbeat::ID) =>
            {
                answer.original_message_time_stamp
            }
            _ => None,
        }
    }

    /// Does what is due for the stations' addresses.
    pub(super) fn watch_paths(&mut self, now: Now, disk: &mut dyn Disk) {
        if self.outbox.is_paused() {
            return;
        }
        for index in 0..self.stations.len() {
            let station = &self.stations[index];
            if station.speaks_ed25() && self.aircraft.has_holder(station.id()) {
                self.paths.keep(now.mono, index);
            }
            if self.paths.handle_timeout(now.mono, index) {
                self.moved(now, index, disk);
                // Rare: a CUCS that never proves an address has waited for its old address to become silent.
                if self.paths.take_missed(index) {
                    self.welcome(now, index, true, disk);
                }
            }
            self.note_path(index);
            let listed = !self.stations[index].removed;
            if let Some(at) = self.paths.due_to_ask(now.mono, index).filter(|_| listed) {
                self.ask(now, index, at, false);
            }
            self.send_waiting(now, index);
        }
    }

    /// Challenges an address if that is due, in Edition 2.5 where what came from there was of that: the station itself may speak
    /// another one, if it has come back there with another program, or if somebody uses its name.
    fn ask(&mut self, now: Now, index: usize, (address, ed25): (SocketAddr, bool), again: bool) {
        // A challenge that is not sent must not count as one that was not answered.
        if self.outbox.is_paused() {
            return;
        }
        let stamped = self.stamped(now);
        let Some(stamp) = self.paths.ask(stamped, index, address, again) else {
            return;
        };
        let message = Message::from(Heartbeat {
            time_stamp: Some(stamp),
        });
        let station = &mut self.stations[index];
        let envelope = station.profile.envelope(self.vsm, station.id());
        // A station with group delivery may only receive the group: its answers prove that.
        let to = if station.profile.delivery.to_address() {
            Destination::Unicast(address)
        } else {
            Destination::Multicast
        };
        let envelope = envelope.requesting_ack();
        let mut question = Outbox::compose(to, &station.profile, &envelope, &message);
        if ed25 {
            let translator = &mut station.translator;
            translator.keep_time(wall_ms(stamped.wall));
            let translated = translator.outbound(&envelope, self.vsm, &message);
            let both = question.zip(translated.first());
            question = both.and_then(|(one, bytes)| one.translated(bytes));
        }
        let Some(question) = question else { return };
        let cost = question_bytes(ed25);
        debug_assert!(question.bytes().len() <= cost, "a longer question");
        // Anyone who writes the id of a station makes the VSM send a challenge there.
        if to == Destination::Multicast
            && !(self.paths).admit_to_group(now.mono, index, cost, Kind::Answer)
        {
            return self.counters.count("group over the rate");
        }
        self.outbox.push(question);
    }

    /// Now by the clock of stamps: a challenge made before a step of the wall clock is answered after it.
    fn stamped(&mut self, now: Now) -> Now {
        let wall = self.outbox.time(now);
        Now { wall, ..now }
    }

    /// Sends messages that have waited for credit.
    fn send_waiting(&mut self, now: Now, index: usize) {
        while let Some(datagram) = self.paths.next_waiting(now.mono, index) {
            let profile = &self.stations[index].profile;
            let datagram = self.outbox.restamped(now, datagram, profile);
            self.outbox.push(datagram);
        }
    }

    /// The station has moved to a new address: handles the messages held back from there.
    fn moved(&mut self, now: Now, index: usize, disk: &mut dyn Disk) {
        let before = self.stations[index].peer;
        self.note_path(index);
        self.end_cut_off(now, index, disk);
        let station = &self.stations[index];
        // Moves without proof can happen a thousand times a second: they cause neither a log line nor an alert.
        if let (Some(before), Some(peer), true) = (before, station.peer, station.proven) {
            // Another port alone is another program there: `cucs` has one of its own at each call.
            if before.ip() != peer.ip() {
                let text = format!("CUCS {} has moved from {before} to {peer}", station.id());
                let vsm = self.vsm;
                self.effects(now, disk).0.note(LogLevel::Info, vsm, text);
            }
            // What it sent from there is handled, and answered, below.
            self.paths.take_missed(index);
            self.welcome(now, index, false, disk);
        }
        // Each is checked against the key that sealed it, including the one that led here.
        let arriving = self.stations[index].sealed_under;
        for (held, key) in self.paths.take_held(index) {
            self.stations[index].sealed_under = key;
            for frame in ed25::frames(&held).flatten() {
                self.take_ed25(now, index, &frame, disk);
            }
            let readings = self.stations[index].profile.readings.clone();
            for frame in readings.frames(&held).flatten() {
                self.take_frame(now, index, &frame, None, disk);
            }
        }
        self.stations[index].sealed_under = arriving;
    }

    /// Copies what the machines may know of a station's address.
    pub(super) fn note_path(&mut self, index: usize) {
        self.stations[index].peer = self.paths.peer(index);
        self.stations[index].proven = self.paths.is_proven(index);
    }

    /// Sends a station the messages for a new listener: the vehicles and the active alerts. `missed`: an answer to it was
    /// dropped, perhaps the one to its message 1.
    pub(super) fn welcome(&mut self, now: Now, index: usize, missed: bool, disk: &mut dyn Disk) {
        // The VSM's own active alerts follow with the next check: the program that received them earlier may be gone.
        self.checks.notified.retain(|station| *station != index);
        let (mut dli, aircraft) = self.effects(now, disk);
        for one in aircraft.iter_mut() {
            let station = index;
            one.ask_authority(&mut dli, Input::Returned { station, missed });
        }
    }
}
