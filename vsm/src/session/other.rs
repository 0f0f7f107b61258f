//! Who else has the vehicle: a pilot, or PX4's own failsafe.
//!
//! An operator who commands a mode sees what the vehicle does and may take it from either. What this VSM commands by itself,
//! or was given earlier, may not: a safety pilot who has taken the vehicle must not lose it to a mode that nobody commands at
//! that moment, and PX4 knows more of a fault than is reported. So the loss action, the hold of a vehicle that was steered, a
//! command that was held or has waited for its route, a 2016 that its station only repeats, and the end of a launch that was cut off ask
//! here first.
//!
//! PX4 does not report who chose a mode. A mode that nothing enters from here has been chosen by somebody else: a pilot with
//! a switch or sticks, another ground station, a failsafe. A pilot who chooses hold or the mission by a switch is not seen.

use std::fmt;
use std::time::Duration;

use mapping::mode::Px4Mode;
use mapping::telemetry::Telemetry;
use mavlink_link::dialect::MavState;

/// Who has the vehicle, and the mode that it is in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Other {
    /// PX4 flies a failsafe.
    Failsafe(Px4Mode),
    /// It returns or lands: by a command, or by its pilot or failsafe.
    Ending(Px4Mode),
    /// A pilot or another station: nothing enters this mode from here.
    Pilot(Px4Mode),
}

impl Other {
    /// As the vehicle showed it last; nothing where its mode is not known.
    pub(crate) fn of(telemetry: &Telemetry) -> Option<Other> {
        let mode = telemetry.mode?;
        if in_failsafe(telemetry) {
            Some(Other::Failsafe(mode))
        } else if [Px4Mode::LAND, Px4Mode::RTL].contains(&mode) {
            Some(Other::Ending(mode))
        } else {
            (!is_commanded_from_here(mode)).then_some(Other::Pilot(mode))
        }
    }
}

impl Other {
    /// Whether it is a failsafe of PX4 that may lead nowhere: it holds, or continues with what was flown. What it was to do may
    /// follow, or nothing ever.
    pub(crate) fn may_stay(self) -> bool {
        matches!(self, Other::Failsafe(mode) if is_commanded_from_here(mode))
    }
}

/// For how long a failsafe of PX4 only holds, or continues.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Holding {
    since: Option<Duration>,
}

impl Holding {
    /// Who has the vehicle, by a report that is newer than the last command.
    pub(crate) fn note(&mut self, other: Option<Other>, now: Duration) {
        let holds = other.is_some_and(Other::may_stay);
        self.since = holds.then(|| self.since.unwrap_or(now));
    }

    /// The bridge did not run for so long.
    pub(crate) fn note_stop(&mut self, stopped: Duration) {
        self.since = self.since.map(|since| since + stopped);
    }

    /// Whether it has for so long that nothing follows from it.
    pub(crate) fn leads_nowhere(self, now: Duration) -> bool {
        self.since
            .is_some_and(|since| now.saturating_sub(since) >= FAILSAFE_ACTS_WITHIN)
    }
}

/// PX4 holds for COM_FAIL_ACT_T, 25 s at most, before it does what a failsafe is to do.
const FAILSAFE_ACTS_WITHIN: Duration = Duration::from_secs(30);

impl fmt::Display for Other {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Other::Failsafe(mode) => {
                write!(out, "the vehicle flies {} as its failsafe", mode.name())
            }
            Other::Ending(mode) | Other::Pilot(mode) => {
                write!(
                    out,
                    "the vehicle is in {}, by its pilot or a failsafe",
                    mode.name()
                )
            }
        }
    }
}

/// Whether a vehicle in this mode was commanded there through a VSM, as far as the mode shows it: in any other a pilot or a
/// failsafe has it.
fn is_commanded_from_here(mode: Px4Mode) -> bool {
    [
        Px4Mode::LOITER,
        Px4Mode::ORBIT,
        Px4Mode::MISSION,
        Px4Mode::TAKEOFF,
        Px4Mode::VTOL_TAKEOFF,
        Px4Mode::COURSE,
        Px4Mode::OFFBOARD,
    ]
    .contains(&mode)
}

/// Whether a vehicle in this mode flies somewhere by itself: it neither holds, returns nor lands, and has no pilot.
pub(crate) fn flies_on(mode: Px4Mode) -> bool {
    is_commanded_from_here(mode) && mode != Px4Mode::LOITER
}

/// Whether PX4 flies a failsafe: HEARTBEAT says so, or the mode that its operator has chosen is another than it flies.
fn in_failsafe(telemetry: &Telemetry) -> bool {
    let critical = matches!(
        telemetry.system_status,
        Some(MavState::MAV_STATE_CRITICAL | MavState::MAV_STATE_EMERGENCY)
    );
    let other = (telemetry.intended_mode).is_some_and(|mode| Some(mode) != telemetry.mode);
    critical || other
}
