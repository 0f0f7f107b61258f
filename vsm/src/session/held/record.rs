//! The record of held commands on disk: one for each vehicle, written before a command is answered or carried out.

use std::time::Duration;

use mavlink_link::Now;
use serde::{Deserialize, Serialize};
use stanag_msgs::enums::{HeldState, HoldKind};
use stanag_msgs::messages::HeldCommandState;
use stanag_msgs::{Id, Text, TimeStamp};

use super::condition::Condition;
use crate::session::context::Origin;
use crate::session::dates::wall_ms;
use crate::session::store::{Uptime, vehicle_record};

/// One held command.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Entry {
    /// Assigned by this VSM, since CUCSs reuse their numbers.
    pub(super) serial: u32,
    /// The CUCS that sent it.
    pub(super) owner: u32,
    pub(super) number: u16,
    pub(super) message_type: u16,
    /// The command's data, hexadecimal.
    pub(super) data: String,
    pub(super) contingency: bool,
    pub(super) condition: Condition,
    pub(super) state: State,
    /// The reason of its end.
    pub(super) reason: String,
    /// When it expires, in the record: milliseconds since 1970, by the clock of this VSM.
    pub(super) until_ms: u64,
    /// By the monotonic clock.
    #[serde(skip)]
    pub(super) until: Duration,
    /// Time Stamp of the 50020, which is answered at the end.
    pub(super) stamp: u64,
    pub(super) ack_requested: bool,
}

/// The state as reported by 50022.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum State {
    Waiting,
    BeingCarriedOut,
    CarriedOut,
    Refused,
    Expired,
    Cancelled,
}

impl State {
    pub(super) fn has_ended(self) -> bool {
        !matches!(self, State::Waiting | State::BeingCarriedOut)
    }

    pub(super) fn reported(self) -> HeldState {
        match self {
            State::Waiting => HeldState::Waiting,
            State::BeingCarriedOut => HeldState::BeingCarriedOut,
            State::CarriedOut => HeldState::CarriedOut,
            State::Refused => HeldState::Refused,
            State::Expired => HeldState::Expired,
            State::Cancelled => HeldState::Cancelled,
        }
    }
}

/// All held commands of a vehicle.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct Record {
    pub(super) entries: Vec<Entry>,
    /// The latest serial number.
    pub(super) serial: u32,
    /// When it was written, milliseconds since 1970, by the clock of its times.
    pub(super) written_ms: u64,
    /// The same by the time since boot.
    #[serde(default)]
    pub(super) written: Option<Uptime>,
}

vehicle_record!(Record, "held", Power);

impl Record {
    /// What the clock of its times would show now, milliseconds since 1970. Within a boot nobody can have set that; after a
    /// restart of the computer only the wall clock is left. `None` if that was set back: a command could run long after its
    /// expiry.
    pub(super) fn now_ms(&self, now: Now, uptime: Option<Uptime>) -> Option<u64> {
        let age = uptime.zip(self.written);
        if let Some(age) = age.and_then(|(now, written)| written.age(now)) {
            let age_ms = u64::try_from(age.as_millis()).unwrap_or(u64::MAX);
            return Some(self.written_ms.saturating_add(age_ms));
        }
        let shown = wall_ms(now.wall);
        (shown.saturating_add(CLOCK_SLACK_MS) >= self.written_ms).then_some(shown)
    }
}

impl Entry {
    /// The 50020, as the origin of its answer.
    pub(super) fn origin(&self, station: usize) -> Origin {
        Origin {
            station,
            message_type: stanag_msgs::messages::HoldCommand::ID,
            stamp: Some(TimeStamp(self.stamp)),
            ack_requested: self.ack_requested,
            held: None,
            continues: None,
        }
    }

    /// 50022.
    pub(super) fn report(&self, stamp: TimeStamp) -> HeldCommandState {
        HeldCommandState {
            time_stamp: Some(stamp),
            owner_id: Some(Id(self.owner)),
            held_command_number: Some(self.number),
            held_message_type: Some(self.message_type),
            hold_condition: Some(self.condition.reported()),
            hold_kind: Some(if self.contingency {
                HoldKind::Contingency
            } else {
                HoldKind::Command
            }),
            held_state: Some(self.state.reported()),
            reason: (!self.reason.is_empty()).then(|| Text::new(&self.reason)),
        }
    }

    /// Converts its times to the wall clock, for the record: that clock may have been set since the last one.
    pub(super) fn store_clocks(&mut self, now: Now) {
        let by_wall = |at: Duration| wall_ms(now.wall + at.saturating_sub(now.mono));
        self.until_ms = by_wall(self.until);
        if let Condition::Time { at_ms, at } = &mut self.condition {
            *at_ms = by_wall(*at);
        }
    }

    /// Converts its times to the monotonic clock after a start of the VSM. `now_ms`: what the clock of the record shows now.
    pub(super) fn restart_clocks(&mut self, mono: Duration, now_ms: u64) {
        let from_now = |ms: u64| mono + Duration::from_millis(ms.saturating_sub(now_ms));
        self.until = from_now(self.until_ms);
        if let Condition::Time { at_ms, at } = &mut self.condition {
            *at = from_now(*at_ms);
        }
    }
}

/// A smaller step of the wall clock is ignored.
const CLOCK_SLACK_MS: u64 = 1_000;
