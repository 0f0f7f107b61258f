//! The vehicle's reported state: its telemetry, and how fresh it is.
//!
//! Only the link machine writes it, from verified frames of the autopilot; every other machine reads it.

use std::collections::VecDeque;
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
    mode_at: Option<Duration>,
    pub(super) silent: bool,
    /// When the bridge last ran again after it did not.
    ran_again: Option<Duration>,
    pub(super) boot_ms: Option<u32>,
    pub(super) progress_boot_ms: Option<u32>,
    pub(super) progress_at: Option<Duration>,
    pub(super) state_is_newer: bool,
    /// The bridge did not run, and nothing that was sent since has shown the mode.
    awaits_mode: bool,
    /// Warnings of the autopilot by STATUSTEXT, the oldest first.
    complaints: VecDeque<(Duration, String)>,
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
            awaits_mode: false,
            complaints: VecDeque::new(),
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
        self.note_mode(now, true);
    }

    /// Makes it report the progress of its mission just now, without a link.
    #[cfg(test)]
    pub(crate) fn show_progress(
        &mut self,
        now: Duration,
        progress: Option<mapping::telemetry::MissionProgress>,
    ) {
        self.telemetry.mission = progress;
        self.progress_at = Some(now);
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

    /// Its mode was reported. `fresh`: by a message made after the last command that may change it.
    pub(super) fn note_mode(&mut self, now: Duration, fresh: bool) {
        self.mode_at = Some(now);
        // Of what waited while the bridge did not run, the first shows the mode of before, which a failsafe may have ended since.
        if !self.measured.may_have_waited(now) {
            self.awaits_mode = false;
            self.state_is_newer |= fresh;
        }
    }

    /// How much longer than it lasts a stop that begins now delays what waits for the vehicle.
    pub(crate) fn reads_late_by(&self, now: Duration) -> Duration {
        self.measured.reads_late_by(now)
    }

    /// The bridge did not run in between: PX4 may have left the mode that it has shown, for want of set points or sticks.
    pub(crate) fn note_unread(&mut self, from: Duration, until: Duration) {
        self.measured.note_unread(from, until);
        (self.awaits_mode, self.state_is_newer) = (true, false);
    }

    /// The bridge did not run in between, for longer: the vehicle was not silent for that time. Returns false after a still longer
    /// one: it is treated as a vehicle that was silent, since it may be another, or have restarted.
    pub(super) fn note_stop(&mut self, from: Duration, until: Duration) -> bool {
        self.note_unread(from, until);
        // Nothing could be reported meanwhile.
        self.measured.begin_again(until, &mut self.telemetry);
        let known = until.saturating_sub(from) <= MAX_STOP;
        if known {
            self.ran_again = Some(until);
        }
        known
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

    /// Whether its mode has not been shown since the bridge did not run: nothing is streamed to it for the mode of before.
    pub(crate) fn awaits_mode(&self) -> bool {
        self.awaits_mode
    }

    /// Whether its mode was reported after the last command that may change it, and since the bridge last did not run.
    pub(crate) fn state_is_newer_than_command(&self) -> bool {
        self.state_is_newer
    }

    /// Its current mode; `None` if the last report is older than the last command that may have changed it, or of before a stop of
    /// the bridge. A decision based on an older report could be wrong for up to a second, and longer on a bad link.
    pub(crate) fn settled_mode(&self) -> Option<Px4Mode> {
        self.telemetry.mode.filter(|_| self.state_is_newer)
    }

    /// Vehicle Type of messages 2 to 5: the custodian's list of types is not public, MAVLink's MAV_TYPE stands in; 0
    /// before it is known.
    pub(crate) fn vehicle_type(&self) -> u16 {
        let kind = self.telemetry.vehicle_type;
        kind.map_or(0, |kind: MavType| kind as u16)
    }

    /// Whether a complaint has come at this time or later.
    pub(crate) fn has_complained(&self, since: Duration) -> bool {
        self.complaints.back().is_some_and(|(at, _)| *at >= since)
    }

    /// The vehicle's reason, to be appended to the refusal of what it was sent at `since` and has answered, or judged, at
    /// `answered`. PX4 sends its STATUSTEXT in the turn in which it answers, or some turns later where others wait before it, so the
    /// first complaint after the answer is the reason; a much later one only if there was none before the answer.
    pub(crate) fn complaint(&self, since: Duration, answered: Duration) -> Option<String> {
        let mut before = None;
        let mut after = None;
        for complaint in self.complaints.iter().filter(|(at, _)| *at >= since) {
            if complaint.0 < answered {
                before = Some(complaint);
            } else {
                after = after.or(Some(complaint));
            }
        }
        let late = |(at, _): &&(Duration, String)| *at > answered + REASON_WITHIN;
        let (_, text) = match before {
            Some(before) => after.filter(|after| !late(after)).unwrap_or(before),
            None => after?,
        };
        Some(format!(" ({text})"))
    }

    /// The autopilot complains. The oldest complaint is forgotten where there are many.
    pub(crate) fn complain(&mut self, now: Duration, text: &str) {
        if self.complaints.len() == MAX_COMPLAINTS {
            self.complaints.pop_front();
        }
        let text = text.chars().take(MAX_COMPLAINT).collect();
        self.complaints.push_back((now, text));
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
/// How long after its answer PX4's reason may come. In the recordings v1.18 sends it 0.06 to 0.28 ms behind its COMMAND_ACK, v1.17
/// once 130 ms; texts that are the same queue up and come up to 0.3 s late. On a radio another frame may come in between.
pub(crate) const REASON_WITHIN: Duration = Duration::from_millis(500);
/// More than PX4 sends about one command; what comes in the minutes until it is given up must not push the reason out.
const MAX_COMPLAINTS: usize = 16;
/// Characters that are kept of one. PX4's longest have 127 bytes.
const MAX_COMPLAINT: usize = 200;

#[cfg(test)]
mod tests {
    use super::*;

    /// What is given as the reason of a command sent at 10.0 s and answered at 10.1 s.
    fn reason(complaints: &[(u64, &str)]) -> Option<String> {
        let at = Duration::from_millis;
        let mut vehicle = VehicleState::default();
        for (ms, text) in complaints {
            vehicle.complain(at(*ms), text);
        }
        vehicle.complaint(at(10_000), at(10_100))
    }

    #[test]
    fn the_reason_of_an_answer_is_what_the_vehicle_says_with_it_whatever_it_says_later() {
        let reason = |complaints: &[_]| reason(complaints).unwrap_or_default();
        assert_eq!(reason(&[]), "");
        // From before the command.
        assert_eq!(reason(&[(9_900, "low battery")]), "");
        // With the answer, or just after or before it.
        for ms in [10_100, 10_150, 10_050] {
            let said = [(9_900, "wind"), (ms, "denied"), (11_000, "low battery")];
            assert_eq!(reason(&said), " (denied)", "{ms}");
        }
        assert_eq!(reason(&[(10_050, "wind"), (10_150, "denied")]), " (denied)");
        // PX4 may notice only later that it cannot do what it has accepted.
        assert_eq!(reason(&[(40_000, "failsafe")]), " (failsafe)");
    }

    #[test]
    fn however_much_a_vehicle_complains_little_is_kept() {
        let long = "x".repeat(12_000);
        let said: Vec<_> = (10_000..11_000).map(|ms| (ms, long.as_str())).collect();
        let mut vehicle = VehicleState::default();
        for (ms, text) in &said {
            vehicle.complain(Duration::from_millis(*ms), text);
        }
        assert_eq!(vehicle.complaints.len(), MAX_COMPLAINTS);
        let length = reason(&said).map(|reason| reason.len());
        assert_eq!(length, Some(MAX_COMPLAINT + " ()".len()));
    }
}
