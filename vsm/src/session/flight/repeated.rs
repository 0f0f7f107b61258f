//! A 2016 that its station sends again and again, each time with a new Time Stamp, as some do once a second and more often.
//!
//! It is one command. Decided again each time, it would fly a route once more as soon as that has ended, send the vehicle back to a
//! waypoint that it has passed, have a wing begin its circle where it is at that moment, and stop the motors of a launch to start them
//! again. So what a command leads to once is not done again by one of the same station with the same fields within
//! [`REPEATED_WITHIN`] of the one before.
//!
//! Nor is it a decision against whoever has the vehicle since: a pilot, a failsafe of PX4, another station, a contingency or a hold of
//! this VSM. There the mode alone counts, since a stream of steering commands has other values each time: one of the same mode within
//! that time is refused with the reason for as long as the vehicle is not back in the mode.
//!
//! A station goes on repeating while the VSM is restarted. So what is known of its stream is recorded at each change, and a stream that
//! continues within [`REPEATED_WITHIN`] of the start is the one of before: who had taken the vehicle from it still has it.
//!
//! An operator who sees the vehicle leave its hold, its return or its landing commands that again, more than once and at once. Where the
//! vehicle flies on, and is not flown by hand, that is carried out each time: it takes nothing from anybody that is safer.

use std::time::Duration;

use mapping::mode::Px4Mode;
use mavlink_link::store::{Store as _, StoreError};
use serde::{Deserialize, Serialize};
use stanag_msgs::Id;
use stanag_msgs::enums::FlightPathControlMode as Mode;
use stanag_msgs::messages::VehicleOperatingModeCommand;

use super::Context;
use super::situation::names_mode;
use crate::session::context::{MissionView, Origin};
use crate::session::effects::Effects;
use crate::session::log::LogLevel;
use crate::session::other::{Other, flies_on};
use crate::session::station::GroundStation;
use crate::session::store::vehicle_record;

/// The last 2016 of a CUCS that names a mode.
#[derive(Debug, Default)]
pub(super) struct Repeated {
    pub(super) latest: Option<Latest>,
    /// What the disk has of it, or should have.
    stored: Option<Record>,
}

/// What is known of a stream, over a restart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
struct Record {
    station: u32,
    mode: u8,
    mission_id: Option<u32>,
    over_other: Option<bool>,
    reached: Option<u32>,
}

// A station that repeats over the start of a computer too has paused for longer than that takes; what a command leads to waits for no disk.
vehicle_record!(Record, "repeated", Process);

#[derive(Debug)]
pub(super) struct Latest {
    station: Id,
    command: Box<VehicleOperatingModeCommand>,
    /// The mission aboard, in which its waypoint number has its meaning.
    mission_id: Option<u32>,
    /// When it came last.
    at: Duration,
    state: State,
    /// Whether somebody else had the vehicle as its station began to command the mode; `None` where that is not known.
    over_other: Option<bool>,
    /// The mode of the vehicle in which one of the stream was carried out.
    pub(super) reached: Option<Px4Mode>,
}

#[derive(Debug, PartialEq, Eq)]
enum State {
    /// It was refused, waits for its route, or would lead to something else now.
    Open,
    /// It is the maneuver in progress.
    Running,
    CarriedOut,
}

/// What a 2016 is beside the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Repetition {
    /// Another command, or one after a pause.
    None,
    /// The same mode, with other values or not begun.
    OfMode,
    /// The same, which is being carried out.
    OfRunning,
    /// The same, which was carried out.
    OfDone,
}

impl Repeated {
    /// Whether a 2016 that comes now belongs to the stream of the one before.
    pub(super) fn is_continued(
        &self,
        context: &Context<'_>,
        origin: Option<Origin>,
        command: &VehicleOperatingModeCommand,
    ) -> bool {
        let now = context.mono();
        sender(context.stations, origin, command).is_some_and(|by| match &self.latest {
            Some(latest) => {
                let same = by == latest.station && mode(command) == latest.mode();
                same && now.saturating_sub(latest.at) < REPEATED_WITHIN
            }
            // The time is counted from the start of the process: the stream may be older than that.
            None => now < REPEATED_WITHIN,
        })
    }

    /// A 2016 comes; without origin it is a command of the VSM. `over_other`: whether somebody else has the vehicle.
    pub(super) fn note(
        &mut self,
        context: &Context<'_>,
        origin: Option<Origin>,
        command: &VehicleOperatingModeCommand,
        over_other: Option<bool>,
    ) -> Repetition {
        let continued = self.is_continued(context, origin, command);
        let Some(station) = sender(context.stations, origin, command) else {
            return Repetition::None;
        };
        let now = context.mono();
        let (command, mission_id) = (without_stamp(command), mission_id(&context.mission));
        if let Some(latest) = self.latest.as_mut().filter(|_| continued) {
            latest.at = now;
            // Just after a start of the VSM the one aboard is not known.
            let mission_id = mission_id.or(latest.mission_id);
            if mission_id != latest.mission_id {
                // Its operator has loaded another route, for which the vehicle was put on hold.
                latest.reached = None;
            } else if command == *latest.command {
                return match latest.state {
                    State::Open => Repetition::OfMode,
                    State::Running => Repetition::OfRunning,
                    State::CarriedOut => Repetition::OfDone,
                };
            }
            *latest.command = command;
            (latest.mission_id, latest.state) = (mission_id, State::Open);
            return Repetition::OfMode;
        }
        self.latest = Some(Latest {
            station,
            command: Box::new(command),
            mission_id,
            at: now,
            state: State::Open,
            over_other: over_other.filter(|_| !continued),
            reached: None,
        });
        if continued {
            Repetition::OfMode
        } else {
            Repetition::None
        }
    }

    /// A 2016 has begun a maneuver.
    pub(super) fn begun(
        &mut self,
        context: &Context<'_>,
        origin: Option<Origin>,
        command: &VehicleOperatingModeCommand,
        repetition: Repetition,
    ) {
        // One without a mode changes values in the mode that is flown.
        let by = sender(context.stations, origin, command);
        let is_latest =
            |latest: &&mut Latest| by == Some(latest.station) && mode(command) == latest.mode();
        if let Some(latest) = self.latest.as_mut().filter(is_latest) {
            latest.mission_id = mission_id(&context.mission);
            // Else it only continues what was carried out.
            if repetition != Repetition::OfDone {
                latest.state = State::Running;
            }
        }
    }

    /// The maneuver in progress has ended as commanded, with the vehicle in this mode.
    pub(super) fn carried_out(&mut self, mode: Option<Px4Mode>) {
        if let Some(latest) = self.running() {
            (latest.state, latest.reached) = (State::CarriedOut, mode);
        }
    }

    /// The maneuver in progress has ended otherwise: the next command is a new attempt.
    pub(super) fn ended(&mut self) {
        if let Some(latest) = self.running() {
            latest.state = State::Open;
        }
    }

    fn running(&mut self) -> Option<&mut Latest> {
        let running = |latest: &&mut Latest| latest.state == State::Running;
        self.latest.as_mut().filter(running)
    }

    /// What it would lead to has changed.
    pub(super) fn reopen(&mut self) {
        if let Some(latest) = &mut self.latest {
            latest.state = State::Open;
        }
    }

    /// Records what has changed; every input ends here.
    pub(super) fn store(&mut self, effects: &mut Effects<'_>) {
        let Some(record) = self.latest.as_ref().and_then(Latest::record) else {
            return;
        };
        if self.stored == Some(record) {
            return;
        }
        // Once for each change: a disk that keeps nothing has alerts of its own.
        self.stored = Some(record);
        let vehicle = effects.id;
        if let Err(fault) = effects.disk().save(&vehicle, &record) {
            let text = format!(
                "{fault}; a 2016 that is repeated over a restart of the VSM would be taken for a new one"
            );
            effects.note(LogLevel::Warning, text);
        }
    }

    /// Continues the stream of before a restart.
    ///
    /// # Errors
    /// Its record exists and cannot be read.
    pub(super) fn restore(&mut self, effects: &mut Effects<'_>) -> Result<(), StoreError> {
        let (vehicle, now) = (effects.id, effects.dli.now.mono);
        self.stored = effects.disk().load::<Record>(&vehicle)?;
        self.latest = self.stored.map(|record| Latest {
            station: Id(record.station),
            // Its values are not known: the first one that comes has others.
            command: Box::new(VehicleOperatingModeCommand {
                select_flight_path_control_mode: Some(Mode::from_raw(record.mode)),
                ..VehicleOperatingModeCommand::default()
            }),
            mission_id: record.mission_id,
            at: now,
            state: State::Open,
            over_other: record.over_other,
            reached: record.reached.map(Px4Mode),
        });
        Ok(())
    }

    /// The bridge did not run for so long: no station has paused by that.
    pub(super) fn note_stop(&mut self, stopped: Duration) {
        if let Some(latest) = &mut self.latest {
            latest.at += stopped;
        }
    }
}

impl Latest {
    fn record(&self) -> Option<Record> {
        Some(Record {
            station: self.station.0,
            mode: self.mode()?.raw(),
            mission_id: self.mission_id,
            over_other: self.over_other,
            reached: self.reached.map(|mode| mode.0),
        })
    }

    pub(super) fn mode(&self) -> Option<Mode> {
        mode(&self.command)
    }

    /// Whether it stops a vehicle in this mode, or has it return or land, while it flies on: not by hand, nor to an end of its own.
    pub(super) fn stops(&self, mode: Px4Mode) -> bool {
        const STOPS: [Mode; 5] = [
            Mode::Loiter,
            Mode::AutolandEngage,
            Mode::AutolandWaveOff,
            Mode::ContingencyA,
            Mode::ContingencyB,
        ];
        self.mode().is_some_and(|mode| STOPS.contains(&mode)) && flies_on(mode)
    }

    /// Whether somebody has the vehicle who did not have it as the station began to command a mode that was not reached since.
    pub(super) fn is_met_by(&self, other: Other) -> bool {
        match other {
            Other::Pilot(_) | Other::Failsafe(_) => self.over_other != Some(true),
            // It may be what was commanded, shown late, or was commanded before the VSM was started.
            Other::Ending(_) => {
                const END: [Mode; 3] =
                    [Mode::AutolandEngage, Mode::ContingencyA, Mode::ContingencyB];
                let ends = self.mode().is_some_and(|mode| END.contains(&mode));
                self.over_other == Some(false) && !ends
            }
        }
    }
}

/// The station of a command with a mode, as it arrives: a held one is carried out once.
fn sender(
    stations: &[GroundStation],
    origin: Option<Origin>,
    command: &VehicleOperatingModeCommand,
) -> Option<Id> {
    let by = origin.filter(|origin| origin.held.is_none() && names_mode(command));
    by.and_then(|origin| stations.get(origin.station))
        .map(GroundStation::id)
}

fn mode(command: &VehicleOperatingModeCommand) -> Option<Mode> {
    command.select_flight_path_control_mode
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
pub(super) const NOT_NEW: &str =
    "this only continues or repeats an earlier command: command another mode, or pause for 5 s";
