//! How a slow link (`vehicle.rate_bps`) is shared, in order of need.
//!
//! - 55 % is for the vehicle's reports: the requested [rates](super::rates) are lowered together until they fit.
//! - 25 % is for what the bridge sends, and for the answers to it. Commands to the autopilot, heartbeats, sticks and key exchanges
//!   are sent at once. Missions, parameters, files and the frames of other ground stations wait until everything sent
//!   before is paid for, so a command waits behind one such frame at most.
//! - 20 % stays free for texts, events and the exchange of keys, and because the overhead of a radio is not known to the byte.
//!
//! A byte counts as ten bits, as on a serial line. Both directions count, because a radio sends them in turn. On an encrypted link
//! each frame counts as the whole packets that it takes alone: on a slow link the next one comes too late to share them.

use std::time::Duration;

use mavlink_link::dialect::{MavCmd, MavMessage};
use mavlink_link::encrypted::bytes_on_radio;

use crate::config;

/// What a link carries, where that is little.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Capacity {
    rate_bps: u32,
    encrypted: bool,
}

impl Capacity {
    /// That of a vehicle's link; `None`: no limit.
    pub(crate) fn of(vehicle: &config::Vehicle) -> Option<Capacity> {
        let encrypted = vehicle.encrypt;
        vehicle.rate_bps.map(|rate_bps| Capacity {
            rate_bps,
            encrypted,
        })
    }

    /// Share of the link for the vehicle's reports, bytes a second.
    pub(super) fn reported_bytes_s(self) -> f64 {
        f64::from(self.rate_bps) / BITS_A_BYTE * OF_REPORTS
    }

    /// Bytes on the radio for a frame.
    pub(super) fn on_radio(self, frame: usize) -> usize {
        if self.encrypted {
            bytes_on_radio(frame)
        } else {
            frame
        }
    }

    /// Whether an agent is at the other end, whose heartbeats are on the radio too.
    pub(super) fn has_agent(self) -> bool {
        self.encrypted
    }

    #[cfg(test)]
    pub(super) fn new(rate_bps: u32, encrypted: bool) -> Capacity {
        Capacity {
            rate_bps,
            encrypted,
        }
    }
}

/// Accounts for what was sent.
#[derive(Debug)]
pub(super) struct Budget {
    /// The link, and the time that one byte costs; `None`: no limit.
    per_byte: Option<(Capacity, Duration)>,
    paid_at: Duration,
    /// Something may be waiting for room, and since when.
    held_back: bool,
    held_since: Option<Duration>,
}

impl Budget {
    pub(super) fn new(capacity: Option<Capacity>) -> Budget {
        let per_byte = |one: Capacity| {
            let bytes_s = f64::from(one.rate_bps) / BITS_A_BYTE * OF_SENDING;
            (one, Duration::from_secs_f64(1.0 / bytes_s))
        };
        Budget {
            per_byte: capacity.map(per_byte),
            paid_at: Duration::ZERO,
            held_back: false,
            held_since: None,
        }
    }

    /// Whether a frame that can wait may be sent now. If not, [`Budget::poll_timeout`] returns when.
    pub(super) fn has_room(&mut self, now: Duration) -> bool {
        self.held_back = !self.is_free(now) && {
            let since = *self.held_since.get_or_insert(now);
            // Beside sticks there is never room: one frame has its turn every now and then all the same.
            now.saturating_sub(since) < MAX_OWED
        };
        !self.held_back
    }

    /// Whether the link is a slow one.
    pub(super) fn is_limited(&self) -> bool {
        self.per_byte.is_some()
    }

    /// Whether everything sent before is paid for.
    pub(super) fn is_free(&self, now: Duration) -> bool {
        self.per_byte.is_none() || self.paid_at <= now
    }

    /// A frame that can wait is sent: the next one waits from here on.
    pub(super) fn take_turn(&mut self) {
        self.held_since = None;
    }

    /// Accounts for a frame of `bytes` bytes, and for the `answer` bytes that come back.
    pub(super) fn spend(&mut self, now: Duration, bytes: usize, answer: usize) {
        if let Some((capacity, per_byte)) = self.per_byte {
            let bytes = capacity.on_radio(bytes) + capacity.on_radio(answer);
            let bytes = u32::try_from(bytes).unwrap_or(u32::MAX);
            // Urgent frames are sent whatever they cost, so their debt is bounded: what can wait must not wait for ever.
            let owed = self.paid_at.max(now) + per_byte.saturating_mul(bytes);
            self.paid_at = owed.min(now + MAX_OWED);
        }
    }

    /// When a frame that was held back can be sent.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        let turn = self.held_since.map_or(self.paid_at, |at| at + MAX_OWED);
        self.held_back.then_some(self.paid_at.min(turn))
    }
}

/// Size of the signed frames that answer a message, bytes.
pub(super) fn answer_bytes(message: &MavMessage) -> usize {
    match message {
        MavMessage::FILE_TRANSFER_PROTOCOL(_) => 279,
        MavMessage::MISSION_REQUEST_INT(_) => 63,
        // The answer is the next MISSION_REQUEST_INT, or the MISSION_ACK after the last item.
        MavMessage::MISSION_ITEM_INT(_) => 30,
        MavMessage::PARAM_REQUEST_READ(_) | MavMessage::PARAM_SET(_) => 50,
        // PX4 has some 1,000 parameters in use. So much is not owed in full: it stands for as long as anything is.
        MavMessage::PARAM_REQUEST_LIST(_) => 50_000,
        MavMessage::TIMESYNC(_) => 41,
        // The acknowledgement, and a message of usual length.
        MavMessage::COMMAND_LONG(one) if one.command == MavCmd::MAV_CMD_REQUEST_MESSAGE => 135,
        MavMessage::COMMAND_LONG(_) | MavMessage::COMMAND_INT(_) => 35,
        _ => 0,
    }
}

const BITS_A_BYTE: f64 = 10.0;
const OF_REPORTS: f64 = 0.55;
const OF_SENDING: f64 = 0.25;
const MAX_OWED: Duration = Duration::from_secs(2);

#[cfg(test)]
mod tests {
    use mavlink_link::dialect::PARAM_REQUEST_LIST_DATA;

    use super::*;

    const NOW: Duration = Duration::from_secs(50);

    #[test]
    fn what_can_wait_leaves_at_its_share_and_what_cannot_is_counted() {
        let mut budget = Budget::new(Some(Capacity::new(9_600, false)));
        let (mut left, mut at) = (0, NOW);
        while at < NOW + Duration::from_secs(10) {
            if budget.has_room(at) {
                assert_eq!(budget.poll_timeout(), None);
                budget.take_turn();
                budget.spend(at, 40, 20);
                left += 60;
            } else {
                at = budget.poll_timeout().expect("when there is room");
            }
        }
        // A quarter of 960 bytes a second.
        assert!((2_340..=2_460).contains(&left), "{left}");
        // One has its turn, and then urgent frames leave no room.
        budget.take_turn();
        for _ in 0..1_000 {
            budget.spend(at, 60, 0);
        }
        assert!(!budget.has_room(at + Duration::from_millis(1_900)));
        assert!(budget.has_room(at + MAX_OWED));
        // Beside sticks that leave no room, one has its turn each two seconds.
        let (mut turns, begun) = (0, at + MAX_OWED);
        for tick in 0..250 {
            let at = begun + Duration::from_millis(40) * tick;
            budget.spend(at, 40, 0);
            if budget.has_room(at) {
                budget.take_turn();
                turns += 1;
            }
        }
        assert!((4..=6).contains(&turns), "{turns}");
    }

    #[test]
    fn on_an_encrypted_link_whole_packets_are_counted() {
        // A frame of 40 bytes and an answer of 20: two packets of 100 bytes each.
        for (encrypted, bytes) in [(false, 60), (true, 200)] {
            let mut budget = Budget::new(Some(Capacity::new(9_600, encrypted)));
            budget.spend(NOW, 40, 20);
            let paid = NOW + Duration::from_secs_f64(f64::from(bytes) / 240.0);
            let little = Duration::from_millis(1);
            assert!(!budget.is_free(paid - little), "{encrypted}");
            assert!(budget.is_free(paid + little), "{encrypted}");
        }
    }

    #[test]
    fn a_list_of_parameters_is_counted_as_what_it_brings() {
        let mut budget = Budget::new(Some(Capacity::new(57_600, false)));
        let list = MavMessage::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA::default());
        budget.spend(NOW, 27, answer_bytes(&list));
        assert!(!budget.is_free(NOW + MAX_OWED - Duration::from_millis(1)));
        assert!(budget.has_room(NOW + MAX_OWED));
    }

    #[test]
    fn without_a_budget_nothing_waits() {
        let mut budget = Budget::new(None);
        for _ in 0..1_000 {
            budget.spend(NOW, 280, 280);
        }
        assert!(budget.has_room(NOW));
        assert_eq!(budget.poll_timeout(), None);
    }
}
