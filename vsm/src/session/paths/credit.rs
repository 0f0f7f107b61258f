//! How much may be sent to a station: three times the bytes that came from an unproven address, and a rate for every other;
//! and the messages that wait until they may be sent.

use std::time::Duration;

use stanag_msgs::ed25;

use super::rate::Kind;
use super::unproven::UnprovenRate;
use super::{Path, Paths, Station};
use crate::session::limits::{Limits, UNPROVEN_GROUP_BYTES_S};
use crate::session::outbox::{Datagram, Destination};

/// The decision about a datagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    Send,
    Wait,
    Drop(&'static str),
}

impl Paths {
    /// The configured limits have changed.
    pub(crate) fn set_limits(&mut self, limits: Limits) {
        self.limits = limits;
    }

    /// The size of a datagram when it is sent, as far as that is known before.
    pub(crate) fn bytes_of(&self, index: usize, datagram: &Datagram) -> usize {
        let station = self.stations.get(index);
        station.map_or(datagram.bytes().len(), |one| one.bytes_of(datagram))
    }

    /// Corrects what a datagram was charged to its actual size. Returns false if that must not be sent to the address.
    pub(crate) fn settle(&mut self, index: usize, datagram: &Datagram, bytes: usize) -> bool {
        let (limits, charged) = (self.limits, datagram.charged);
        let Some(station) = self.stations.get_mut(index) else {
            return true;
        };
        let (path, rate) = match datagram.to {
            Destination::Unicast(address) => {
                let all = station.current.iter_mut().chain(&mut station.candidates);
                let path = all.into_iter().find(|path| path.address == address);
                (path, &mut station.unicast)
            }
            Destination::Multicast => (station.current.as_mut(), &mut station.group),
        };
        rate.settle(charged, bytes, &limits);
        let Some(path) = path else {
            // Of an address that was displaced meanwhile there is no credit left to pay with.
            return datagram.to == Destination::Multicast || bytes <= charged;
        };
        if path.trusted || path.proven.is_some() {
            return true;
        }
        let credit = match datagram.to {
            Destination::Unicast(_) => &mut path.credit,
            Destination::Multicast => &mut path.group_credit,
        };
        let available = *credit + charged;
        // A datagram that is not sent costs nothing.
        *credit = available.checked_sub(bytes).unwrap_or(available);
        station.missed |= available < bytes;
        available >= bytes
    }

    /// Whether the station has missed something since the last call.
    pub(crate) fn take_missed(&mut self, index: usize) -> bool {
        let station = self.stations.get_mut(index);
        station.is_some_and(|station| std::mem::take(&mut station.missed))
    }

    /// Decides about a datagram of `bytes` to a station.
    pub(crate) fn admit(
        &mut self,
        now: Duration,
        index: usize,
        bytes: usize,
        kind: Kind,
    ) -> Verdict {
        // A station that is unknown here is not configured: this happens only in tests of a single machine.
        let Some(station) = self.stations.get_mut(index) else {
            return Verdict::Send;
        };
        let verdict = station.admit(now, bytes, kind, &self.limits, &mut self.unproven);
        if !matches!(kind, Kind::Report(_)) && matches!(verdict, Verdict::Drop(_)) {
            station.missed = true;
        }
        verdict
    }

    /// Whether a copy to the group is within the rate of its station. For an unproven station it must also be within three
    /// times the bytes that came from it: whoever uses its id makes the VSM send to all listeners.
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

    /// A copy to the group was dropped that reaches the station by no other way.
    pub(crate) fn note_missed(&mut self, index: usize) {
        if let Some(station) = self.stations.get_mut(index) {
            station.missed = true;
        }
    }

    /// Lets an answer wait for its credit.
    pub(crate) fn wait(&mut self, now: Duration, index: usize, datagram: Datagram) {
        if let Some(station) = self.stations.get_mut(index) {
            // An acknowledgement overtakes alerts here, as it does where it has credit at once.
            let is_first = |one: &Datagram| Kind::of_answer(one) == Kind::Acknowledgement;
            let mut waiting = station.waiting.iter();
            let after = waiting.position(|(_, other)| !is_first(other));
            if station.waiting.len() == MAX_WAITING {
                station.missed = true;
                // Alerts never take the place of an acknowledgement: there may be many more of them.
                match after {
                    Some(oldest) => drop(station.waiting.remove(oldest)),
                    None if is_first(&datagram) => drop(station.waiting.pop_front()),
                    None => return,
                }
            }
            let end = station.waiting.len();
            let place = after.filter(|_| is_first(&datagram)).unwrap_or(end);
            station
                .waiting
                .insert(place, (now + LONGEST_WAIT, datagram));
        }
    }

    /// Drops waiting messages of the station: they are in an edition that it no longer uses.
    pub(crate) fn drop_waiting(&mut self, index: usize) {
        if let Some(station) = self.stations.get_mut(index) {
            station.missed |= !station.waiting.is_empty();
            station.waiting.clear();
        }
    }

    /// The next waiting answer that may be sent now.
    pub(crate) fn next_waiting(&mut self, now: Duration, index: usize) -> Option<Datagram> {
        let station = self.stations.get_mut(index)?;
        let (limits, unproven) = (&self.limits, &mut self.unproven);
        loop {
            let (until, mut datagram) = station.waiting.pop_front()?;
            if until < now {
                station.missed = true;
                continue;
            }
            let rest = std::mem::take(&mut station.waiting);
            let kind = Kind::of_answer(&datagram);
            datagram.charged = station.bytes_of(&datagram);
            let verdict = station.admit(now, datagram.charged, kind, limits, unproven);
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
    /// The size of the first waiting message, if that is an acknowledgement.
    pub(super) fn next_answer(&self) -> Option<usize> {
        let (_, datagram) = self.waiting.front()?;
        (Kind::of_answer(datagram) == Kind::Acknowledgement).then(|| self.bytes_of(datagram))
    }

    pub(super) fn bytes_of(&self, datagram: &Datagram) -> usize {
        let bytes = datagram.bytes();
        let speaks_ed25 = self.current.as_ref().is_some_and(|path| path.ed25);
        if speaks_ed25 && !ed25::is_ed25(bytes) {
            // The largest growth of any message; `settle` corrects it.
            bytes.len() * 9 / 5
        } else {
            bytes.len()
        }
    }

    fn admit_to_group(&mut self, now: Duration, bytes: usize, kind: Kind, limits: &Limits) -> bool {
        let current = self.current.as_mut();
        let Some(path) = current.filter(|path| !path.trusted && path.proven.is_none()) else {
            return self.group.take(now, bytes, kind, limits);
        };
        if let Kind::Report(_) = kind {
            // Status and alerts for listeners: a station that proves nothing, such as one that only sends, needs them too.
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

    fn admit(
        &mut self,
        now: Duration,
        bytes: usize,
        kind: Kind,
        limits: &Limits,
        unproven: &mut UnprovenRate,
    ) -> Verdict {
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
            // In turn: otherwise the short ones would leave no credit for the position.
            let turn = TURNS[self.turn % TURNS.len()];
            let other = !TURNS.contains(&report);
            if report != turn && !(turn == OTHER && other) || !self.waiting.is_empty() {
                return Verdict::Drop("unproven address");
            }
        }
        // Keep enough credit for another challenge: a station that sends nothing more, and whose challenge was lost, would
        // otherwise never be served. For a station that does not answer challenges, acknowledgements of its commands go
        // first, before handovers and alerts of others.
        let overdue = kind == Kind::Acknowledgement && current.ask_at <= now;
        let asked = current.is_asked() && !overdue;
        let kept = match kind {
            _ if asked => 2 * current.question_bytes(),
            Kind::Acknowledgement => 0,
            _ => 2 * current.acknowledgement_bytes(),
        };
        let behind_others = behind_others && (asked || kind != Kind::Acknowledgement);
        if behind_others
            || current.credit < bytes + kept
            || !unproven.take(now, current.address, kind)
        {
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
    fn acknowledgement_bytes(&self) -> usize {
        if self.ed25 {
            ACKNOWLEDGEMENT_BYTES * 9 / 5
        } else {
            ACKNOWLEDGEMENT_BYTES
        }
    }

    pub(super) fn credit_for(&mut self, now: Duration, bytes: usize) {
        self.seen = now;
        if self.trusted || self.proven.is_some() {
            return;
        }
        self.credit = (self.credit + 3 * bytes).min(MAX_CREDIT);
        self.group_credit = (self.group_credit + 3 * bytes).min(MAX_CREDIT);
    }
}

/// A 17000 with its wrapper: a command is acknowledged as received, and as carried out.
const ACKNOWLEDGEMENT_BYTES: usize = 34;
/// Maximum number of answers that wait for credit, and for how long.
const MAX_WAITING: usize = 256;
const LONGEST_WAIT: Duration = Duration::from_secs(2);
/// Maximum credit of an unproven CUCS, bytes.
const MAX_CREDIT: usize = 32_768;
/// Reports to an unproven address, in this order: position and state most often. `OTHER`: those scheduled by 17001.
const TURNS: [u16; 6] = [4000, 3001, 4000, 3002, 4001, OTHER];
const OTHER: u16 = 0;
