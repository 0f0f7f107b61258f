//! How much may be sent to a station: three times what came from an address that has not proved itself, and a rate for
//! every other; and what waits until it may go.

use std::time::Duration;

use stanag_msgs::ed25;

use super::proof::question_bytes;
use super::rate::{Kind, Limits};
use super::{Path, Paths, Station};
use crate::session::outbox::{Datagram, Destination};

/// What becomes of a datagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    Send,
    Wait,
    Drop(&'static str),
}

impl Paths {
    /// What the configuration allows has changed.
    pub(crate) fn set_limits(&mut self, limits: Limits) {
        self.limits = limits;
    }

    /// How many bytes a datagram has once it leaves, as far as that is known before.
    pub(crate) fn bytes_of(&self, index: usize, datagram: &Datagram) -> usize {
        let station = self.stations.get(index);
        station.map_or(datagram.bytes().len(), |one| one.bytes_of(datagram))
    }

    /// How many bytes a question was charged as.
    pub(crate) fn question_bytes(&self, index: usize) -> usize {
        let station = self.stations.get(index);
        question_bytes(station.is_some_and(|one| one.ed25))
    }

    /// What was charged as so many bytes has become so many: false where the address may not be sent them.
    pub(crate) fn settle(
        &mut self,
        index: usize,
        to: Destination,
        charged: usize,
        bytes: usize,
    ) -> bool {
        let limits = self.limits;
        let Some(station) = self.stations.get_mut(index) else {
            return true;
        };
        let (path, rate) = match to {
            Destination::Unicast(address) => {
                let all = station.current.iter_mut().chain(&mut station.candidates);
                let path = all.into_iter().find(|path| path.address == address);
                (path, &mut station.unicast)
            }
            Destination::Multicast => (station.current.as_mut(), &mut station.group),
        };
        rate.settle(charged, bytes, &limits);
        let Some(path) = path.filter(|path| !path.trusted && path.proven.is_none()) else {
            return true;
        };
        let credit = match to {
            Destination::Unicast(_) => &mut path.credit,
            Destination::Multicast => &mut path.group_credit,
        };
        let available = *credit + charged;
        // What may not go has cost nothing.
        *credit = available.checked_sub(bytes).unwrap_or(available);
        station.missed |= available < bytes;
        available >= bytes
    }

    /// Whether the station has missed something since this was last asked.
    pub(crate) fn take_missed(&mut self, index: usize) -> bool {
        let station = self.stations.get_mut(index);
        station.is_some_and(|station| std::mem::take(&mut station.missed))
    }

    /// What becomes of a datagram of `bytes` to a station.
    pub(crate) fn admit(
        &mut self,
        now: Duration,
        index: usize,
        bytes: usize,
        kind: Kind,
    ) -> Verdict {
        let limits = self.limits;
        // A station that is not kept here is none of the configuration: tests of one machine.
        let Some(station) = self.stations.get_mut(index) else {
            return Verdict::Send;
        };
        let verdict = station.admit(now, bytes, kind, &limits);
        if !matches!(kind, Kind::Report(_)) && matches!(verdict, Verdict::Drop(_)) {
            station.missed = true;
        }
        verdict
    }

    /// Whether a copy to the group is within the rate of its station, and within three times what has come from it where
    /// that has not proved itself: whoever writes its id makes the VSM send to all who listen.
    pub(crate) fn admit_to_group(
        &mut self,
        now: Duration,
        index: usize,
        bytes: usize,
        kind: Kind,
    ) -> bool {
        let limits = self.limits;
        let station = self.stations.get_mut(index);
        station.is_none_or(|station| station.admit_to_group(now, bytes, kind, &limits))
    }

    /// Lets an answer wait for its credit.
    pub(crate) fn wait(&mut self, now: Duration, index: usize, datagram: Datagram) {
        if let Some(station) = self.stations.get_mut(index) {
            if station.waiting.len() == MAX_WAITING {
                station.waiting.pop_front();
                station.missed = true;
            }
            // An acknowledgement overtakes alerts here, as it does where it has credit at once.
            let is_first = |one: &Datagram| Kind::of_answer(one) == Kind::Acknowledgement;
            let ahead = if is_first(&datagram) {
                let mut waiting = station.waiting.iter();
                waiting.position(|(_, other)| !is_first(other))
            } else {
                None
            };
            let place = ahead.unwrap_or(station.waiting.len());
            station
                .waiting
                .insert(place, (now + LONGEST_WAIT, datagram));
        }
    }

    /// What waits for the station was written as it does not read any more.
    pub(crate) fn drop_waiting(&mut self, index: usize) {
        if let Some(station) = self.stations.get_mut(index) {
            station.missed |= !station.waiting.is_empty();
            station.waiting.clear();
        }
    }

    /// The next answer that has waited and may go now.
    pub(crate) fn next_waiting(&mut self, now: Duration, index: usize) -> Option<Datagram> {
        let limits = self.limits;
        let station = self.stations.get_mut(index)?;
        loop {
            let (until, datagram) = station.waiting.pop_front()?;
            if until < now {
                station.missed = true;
                continue;
            }
            let rest = std::mem::take(&mut station.waiting);
            let kind = Kind::of_answer(&datagram);
            let verdict = station.admit(now, station.bytes_of(&datagram), kind, &limits);
            station.waiting = rest;
            match verdict {
                Verdict::Send => return Some(datagram),
                Verdict::Wait => {
                    station.waiting.push_front((until, datagram));
                    return None;
                }
                Verdict::Drop(_) => station.missed = true,
            }
        }
    }
}

impl Station {
    /// The bytes of the acknowledgement that waits first.
    pub(super) fn next_answer(&self) -> Option<usize> {
        let (_, datagram) = self.waiting.front()?;
        (Kind::of_answer(datagram) == Kind::Acknowledgement).then(|| self.bytes_of(datagram))
    }

    fn bytes_of(&self, datagram: &Datagram) -> usize {
        let bytes = datagram.bytes();
        if self.ed25 && !ed25::is_ed25(bytes) {
            // No message has grown by more; `settle` knows.
            bytes.len() * 9 / 5
        } else {
            bytes.len()
        }
    }

    fn acknowledgement_bytes(&self) -> usize {
        if self.ed25 {
            ACKNOWLEDGEMENT_BYTES * 9 / 5
        } else {
            ACKNOWLEDGEMENT_BYTES
        }
    }

    pub(super) fn question_bytes(&self) -> usize {
        question_bytes(self.ed25)
    }

    fn admit_to_group(&mut self, now: Duration, bytes: usize, kind: Kind, limits: &Limits) -> bool {
        let current = self.current.as_mut();
        let Some(path) = current.filter(|path| !path.trusted && path.proven.is_none()) else {
            return self.group.take(now, bytes, kind, limits);
        };
        if let Kind::Report(_) = kind {
            // Status and alerts of who listens: a station that proves nothing, as one that only sends, needs them, too.
            let slow = Limits {
                bytes_s: limits.bytes_s.min(UNPROVEN_GROUP_BYTES_S),
                ..*limits
            };
            return self.group.take(now, bytes, kind, &slow);
        }
        let may = path.group_credit >= bytes && self.group.take(now, bytes, kind, limits);
        if may {
            path.group_credit -= bytes;
        }
        may
    }

    fn admit(&mut self, now: Duration, bytes: usize, kind: Kind, limits: &Limits) -> Verdict {
        let (question, acknowledgement) = (self.question_bytes(), self.acknowledgement_bytes());
        let Some(current) = &mut self.current else {
            return Verdict::Drop("no address");
        };
        if current.has_lapsed(now, limits.lease) {
            return Verdict::Drop("lease over");
        }
        let behind_others = !matches!(kind, Kind::Report(_)) && !self.waiting.is_empty();
        if current.trusted || current.proven.is_some() {
            return if !behind_others && self.unicast.take(now, bytes, kind, limits) {
                Verdict::Send
            } else if let Kind::Report(_) = kind {
                Verdict::Drop("over the rate")
            } else {
                Verdict::Wait
            };
        }
        if let Kind::Report(report) = kind {
            // One after the other: the short ones would leave no credit for the position.
            let turn = TURNS[self.turn % TURNS.len()];
            let other = !TURNS.contains(&report);
            if report != turn && !(turn == OTHER && other) || !self.waiting.is_empty() {
                return Verdict::Drop("unproven address");
            }
        }
        // What is sent leaves enough to ask again: who sends nothing more, and lost the question, would never be served. Of
        // who does not answer questions the commands are acknowledged first, in whatever handovers and alerts of others.
        let overdue = kind == Kind::Acknowledgement && current.ask_at <= now;
        let asked = current.is_asked() && !overdue;
        let kept = match kind {
            _ if asked => 2 * question,
            Kind::Acknowledgement => 0,
            _ => 2 * acknowledgement,
        };
        let behind_others = behind_others && (asked || kind != Kind::Acknowledgement);
        if behind_others || current.credit < bytes + kept {
            return match kind {
                Kind::Report(_) => Verdict::Drop("unproven address"),
                _ => Verdict::Wait,
            };
        }
        current.credit -= bytes;
        if let Kind::Report(_) = kind {
            self.turn = (self.turn + 1) % TURNS.len();
        }
        Verdict::Send
    }
}

impl Path {
    pub(super) fn credit_for(&mut self, now: Duration, bytes: usize) {
        self.seen = now;
        if self.trusted || self.proven.is_some() {
            return;
        }
        self.credit = (self.credit + 3 * bytes).min(MAX_CREDIT);
        self.group_credit = (self.group_credit + 3 * bytes).min(MAX_CREDIT);
    }
}

/// 17000 with its wrapper: a command is acknowledged as received, and as carried out.
const ACKNOWLEDGEMENT_BYTES: usize = 34;
/// Answers that wait for credit, and for how long.
const MAX_WAITING: usize = 256;
const LONGEST_WAIT: Duration = Duration::from_secs(2);
/// What a CUCS without proof can save up, bytes.
const MAX_CREDIT: usize = 32_768;
/// Status and alerts in the group for a station that has proved nothing: some vehicles at their usual rates, and no flood.
const UNPROVEN_GROUP_BYTES_S: u32 = 8_192;
/// Reports to an address without proof, in this order: position and state most often. `OTHER`: what 17001 has scheduled.
const TURNS: [u16; 6] = [4000, 3001, 4000, 3002, 4001, OTHER];
const OTHER: u16 = 0;
