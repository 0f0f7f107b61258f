//! A 2016 that its station sends again and again, each time with a new Time Stamp, as some do once a second and more often.
//!
//! It is one command. Decided again each time, it would fly a route once more as soon as that has ended, send the vehicle back to a
//! waypoint that it has passed, have a wing begin its circle where it is at that moment, and stop the motors of a launch to start them
//! again. So what a command leads to once is not done again by one of the same station with the same fields within
//! [`REPEATED_WITHIN`] of the one before. A mode that the vehicle was taken out of since is entered again.

use std::time::Duration;

use stanag_msgs::messages::VehicleOperatingModeCommand;

use super::situation::names_mode;
use crate::session::context::{MissionView, Origin};

/// The last 2016 of a CUCS that names a mode and has begun a maneuver: while it is not carried out, that is the one in progress.
#[derive(Debug, Default)]
pub(super) struct Repeated(Option<Latest>);

#[derive(Debug)]
struct Latest {
    station: usize,
    command: Box<VehicleOperatingModeCommand>,
    /// The mission aboard, in which its waypoint number has its meaning.
    mission_id: Option<u32>,
    /// When it came last.
    at: Duration,
    carried_out: bool,
}

/// What a 2016 is beside the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Repetition {
    /// Another command, or one after a pause.
    None,
    /// The same, which is being carried out.
    OfRunning,
    /// The same, which was carried out.
    OfDone,
}

impl Repeated {
    /// A 2016 comes; without origin it is a command of the VSM.
    pub(super) fn note(
        &mut self,
        now: Duration,
        origin: Option<Origin>,
        command: &VehicleOperatingModeCommand,
        mission: &MissionView<'_>,
    ) -> Repetition {
        let Some((by, latest)) = sender(origin).zip(self.0.as_mut()) else {
            return Repetition::None;
        };
        let same = by == latest.station
            && without_stamp(command) == *latest.command
            && mission_id(mission) == latest.mission_id;
        if !same || now.saturating_sub(latest.at) >= REPEATED_WITHIN {
            return Repetition::None;
        }
        latest.at = now;
        if latest.carried_out {
            Repetition::OfDone
        } else {
            Repetition::OfRunning
        }
    }

    /// A 2016 has begun a maneuver.
    pub(super) fn begun(
        &mut self,
        now: Duration,
        origin: Option<Origin>,
        command: &VehicleOperatingModeCommand,
        mission: &MissionView<'_>,
        repetition: Repetition,
    ) {
        // One without a mode changes values in the mode that is flown.
        if let Some(station) = sender(origin).filter(|_| names_mode(command)) {
            self.0 = Some(Latest {
                station,
                command: Box::new(without_stamp(command)),
                mission_id: mission_id(mission),
                at: now,
                // It only continues what was carried out.
                carried_out: repetition == Repetition::OfDone,
            });
        }
    }

    /// The maneuver in progress has ended as commanded.
    pub(super) fn carried_out(&mut self) {
        if let Some(latest) = &mut self.0 {
            latest.carried_out = true;
        }
    }

    /// The maneuver in progress has ended otherwise: the next command is a new attempt.
    pub(super) fn ended(&mut self) {
        self.0.take_if(|latest| !latest.carried_out);
    }

    /// A CUCS commands something else, or what it would lead to has changed.
    pub(super) fn forget(&mut self) {
        self.0 = None;
    }

    /// The bridge did not run for so long: no station has paused by that.
    pub(super) fn note_stop(&mut self, stopped: Duration) {
        if let Some(latest) = &mut self.0 {
            latest.at += stopped;
        }
    }
}

/// The station of a command as it arrives: a held one is carried out once.
fn sender(origin: Option<Origin>) -> Option<usize> {
    let by = origin.filter(|origin| origin.held.is_none());
    by.map(|origin| origin.station)
}

fn without_stamp(command: &VehicleOperatingModeCommand) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        time_stamp: None,
        ..command.clone()
    }
}

fn mission_id(mission: &MissionView<'_>) -> Option<u32> {
    mission.uploaded.map(|uploaded| uploaded.mission_id)
}

/// The same command within this time after the last one is part of a stream.
pub(super) const REPEATED_WITHIN: Duration = Duration::from_secs(5);
