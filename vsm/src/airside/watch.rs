//! What PX4 reports about itself in verified frames: whether it is disarmed, and whether it has restarted.

use std::time::Duration;

use mavlink_link::dialect::{MavMessage, MavModeFlag};
use mavlink_link::frame::FrameView;
use mavlink_link::receiver::AUTOPILOT;

/// The latest reports of the autopilot.
#[derive(Debug, Default)]
pub(super) struct Watch {
    /// Whether it last reported that it is armed, and when.
    armed: Option<(bool, Duration)>,
    boot_ms: Option<u32>,
    /// It has started, and has not been sent a new stamp since.
    restamp_due: bool,
    /// It has restarted, and this process saw it.
    restarted: bool,
}

impl Watch {
    /// Takes a verified frame.
    pub(super) fn take(&mut self, mono: Duration, frame: &FrameView<'_>) {
        let header = frame.header();
        if header.component_id != AUTOPILOT || !WATCHED.contains(&header.message_id) {
            return;
        }
        let boot_ms = match frame.message() {
            Ok(MavMessage::HEARTBEAT(m)) => {
                let armed = m
                    .base_mode
                    .contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
                self.armed = Some((armed, mono));
                return;
            }
            Ok(MavMessage::SYSTEM_TIME(m)) => m.time_boot_ms,
            Ok(MavMessage::ATTITUDE(m)) => m.time_boot_ms,
            Ok(MavMessage::GLOBAL_POSITION_INT(m)) => m.time_boot_ms,
            _ => return,
        };
        match self.boot_ms {
            // Frames of one link may overtake each other slightly.
            Some(before) if boot_ms.saturating_add(BOOT_SLACK_MS) < before => {
                (self.restarted, self.restamp_due) = (true, true);
            }
            // The restart was not observed, so it does not prove that PX4 kept the current key over it.
            None if boot_ms < JUST_STARTED_MS => self.restamp_due = true,
            _ => {}
        }
        self.boot_ms = Some(boot_ms);
    }

    /// Whether it has recently reported that it is disarmed.
    pub(super) fn is_disarmed(&self, mono: Duration) -> bool {
        self.armed
            .is_some_and(|(armed, at)| !armed && mono.saturating_sub(at) < DISARMED_LIFE)
    }

    /// Whether it last reported that it is armed.
    pub(super) fn is_armed(&self) -> bool {
        self.armed.is_some_and(|(armed, _)| armed)
    }

    /// True once after it has restarted.
    pub(super) fn take_restart(&mut self) -> bool {
        std::mem::take(&mut self.restarted)
    }

    /// Forgets its time since boot.
    pub(super) fn forget_boot(&mut self) {
        (self.boot_ms, self.restarted) = (None, false);
    }

    /// Whether a new stamp is due to be sent.
    pub(super) fn restamp_is_due(&self, mono: Duration) -> bool {
        self.restamp_due && self.is_disarmed(mono)
    }

    /// It has been sent a new stamp.
    pub(super) fn restamped(&mut self) {
        self.restamp_due = false;
    }
}

/// HEARTBEAT, SYSTEM_TIME, ATTITUDE, GLOBAL_POSITION_INT.
const WATCHED: [u32; 4] = [0, 2, 30, 33];
/// How long a report of the vehicle that it is disarmed holds.
// PX4 sends HEARTBEAT at 1 Hz. One may be late, but none may be missing: PX4 refuses a key while armed.
const DISARMED_LIFE: Duration = Duration::from_millis(1_500);
const BOOT_SLACK_MS: u32 = 2_000;
/// If PX4 is younger than this when the agent first receives it, both were switched on together.
const JUST_STARTED_MS: u32 = 120_000;
