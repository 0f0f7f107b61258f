//! The vehicle's reported state: its telemetry, and how fresh it is.
//!
//! Only the link machine writes it, from verified frames of the autopilot; every other machine reads it.

use std::time::Duration;

use mapping::mode::Px4Mode;
use mapping::payload::Payloads;
use mapping::telemetry::Telemetry;
use mavlink_link::dialect::MavType;

use super::measured::Measured;

/// As last reported by the vehicle.
#[derive(Debug)]
pub(crate) struct VehicleState {
    pub(crate) telemetry: Telemetry,
    /// Its gimbals and cameras, including those that are separate components.
    pub(crate) payloads: Payloads,
    /// When its last HEARTBEAT arrived.
    pub(super) heartbeat_at: Option<Duration>,
    /// When it last reported its mode.
    pub(super) mode_at: Option<Duration>,
    pub(super) silent: bool,
    /// When the bridge last ran again after it did not.
    ran_again: Option<Duration>,
    pub(super) boot_ms: Option<u32>,
    pub(super) progress_boot_ms: Option<u32>,
    pub(super) progress_at: Option<Duration>,
    pub(super) state_is_newer: bool,
    pub(super) complaint: Option<(Duration, String)>,
    /// When its values were measured.
    pub(crate) measured: Measured,
}

impl Default for VehicleState {
    fn default() -> VehicleState {
        VehicleState {
            telemetry: Telemetry::default(),
            payloads: Payloads::default(),
            heartbeat_at: None,
            mode_at: None,
            // Nothing was received yet: its state is unknown, as for a vehicle that went silent.
            silent: true,
            ran_again: None,
            boot_ms: None,
            progress_boot_ms: None,
            progress_at: None,
            state_is_newer: true,
            complaint: None,
            measured: Measured::default(),
        }
    }
}

impl VehicleState {
    /// Makes it live, without a link.
    #[cfg(test)]
    pub(crate) fn set_live(&mut self) {
        self.silent = false;
    }

    /// Makes it silent, without a link.
    #[cfg(test)]
    pub(crate) fn set_silent(&mut self) {
        self.silent = true;
    }

    /// Makes it report a mode just now, without a link.
    #[cfg(test)]
    pub(crate) fn show_mode(&mut self, now: Duration, mode: Px4Mode) {
        self.telemetry.mode = Some(mode);
        self.mode_at = Some(now);
        self.state_is_newer = true;
    }

    /// Sends it a command that may change its mode, without a link.
    #[cfg(test)]
    pub(crate) fn command_was_sent(&mut self) {
        self.state_is_newer = false;
    }

    /// Whether data is received from it: its telemetry is not stale.
    pub(crate) fn live(&self) -> bool {
        !self.silent
    }

    /// Whether it is not known to be disarmed: also while nothing is received of it.
    pub(crate) fn may_fly(&self) -> bool {
        self.silent || self.telemetry.armed != Some(false)
    }

    /// Whether it has reported its state since the start of the VSM.
    pub(crate) fn was_live(&self) -> bool {
        self.silent_at().is_some()
    }

    /// When it last reported its mode.
    pub(crate) fn mode_at(&self) -> Option<Duration> {
        self.mode_at
    }

    /// When it will count as silent if no further data arrives.
    pub(super) fn silent_at(&self) -> Option<Duration> {
        let (mode, beat) = self.mode_at.zip(self.heartbeat_at)?;
        let again = self.ran_again.unwrap_or_default();
        Some((mode.max(again) + SILENCE).min(beat.max(again) + NO_HEARTBEAT))
    }

    /// The bridge did not run in between: the vehicle was not silent for that time.
    pub(super) fn note_stop(&mut self, from: Duration, until: Duration) {
        self.measured.note_stop(from, until, &mut self.telemetry);
        // After a longer one it is treated as a vehicle that was silent, since it may be another, or have restarted.
        if until.saturating_sub(from) <= MAX_STOP {
            self.ran_again = Some(until);
        }
    }

    /// Its time since boot, ms, from the latest message that has it.
    pub(crate) fn boot_ms(&self) -> Option<u32> {
        self.boot_ms
    }

    /// The same when it last reported the progress of its mission (MISSION_CURRENT).
    pub(crate) fn progress_boot_ms(&self) -> Option<u32> {
        self.progress_boot_ms
    }

    /// When its last report of the progress of its mission (MISSION_CURRENT) arrived.
    pub(crate) fn progress_at(&self) -> Option<Duration> {
        self.progress_at
    }

    /// Whether its mode was reported after the last command that may change it.
    pub(crate) fn state_is_newer_than_command(&self) -> bool {
        self.state_is_newer
    }

    /// Its current mode; `None` if the last report is older than the last command that may have changed it. A decision based
    /// on an older report could be wrong for up to a second, and longer on a bad link.
    pub(crate) fn settled_mode(&self) -> Option<Px4Mode> {
        self.telemetry.mode.filter(|_| self.state_is_newer)
    }

    /// Vehicle Type of messages 2 to 5: the custodian's list of types is not public, MAVLink's MAV_TYPE stands in; 0
    /// before it is known.
    pub(crate) fn vehicle_type(&self) -> u16 {
        let kind = self.telemetry.vehicle_type;
        kind.map_or(0, |kind: MavType| kind as u16)
    }

    /// The vehicle's STATUSTEXT warning, to be appended to the refusal of what was begun at `since`: the last one after that, or
    /// a recent one.
    pub(crate) fn latest_complaint(&self, now: Duration, since: Duration) -> Option<String> {
        let (at, text) = self.complaint.as_ref()?;
        let is_recent = now.saturating_sub(*at) < COMPLAINT_LIFE;
        (is_recent || *at >= since).then(|| format!(" ({text})"))
    }

    /// Makes it complain, without a link.
    #[cfg(test)]
    pub(crate) fn complain(&mut self, now: Duration, text: &str) {
        self.complaint = Some((now, text.to_owned()));
    }
}

/// A vehicle that has not reported its mode for this long, by HEARTBEAT or CURRENT_MODE, is silent, and its telemetry is
/// stale.
///
/// Heartbeats alone are not enough: they are sent once a second, and if 40 % of the packets are lost, three in a row are
/// missing every few seconds although other messages arrive.
pub(crate) const SILENCE: Duration = Duration::from_millis(3_500);
/// A vehicle without a heartbeat for this long is silent too, since no other message reports whether it is armed.
const NO_HEARTBEAT: Duration = Duration::from_secs(10);
/// The bridge knows the vehicle still after it did not run for this long.
const MAX_STOP: Duration = Duration::from_secs(60);
/// A warning is taken as the reason of a refusal that follows within this time, although what is refused began after it.
const COMPLAINT_LIFE: Duration = Duration::from_secs(3);
