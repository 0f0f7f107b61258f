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
//! A station repeats its 2016 while the VSM is restarted too. So what is known of a stream is on the disk for as long as it lasts, and one
//! that continues within [`REPEATED_WITHIN`] of the start is the one of before: who had taken the vehicle from it still has it. Any
//! other 2016 of that time may belong to a stream that is not known.
//!
//! An operator who sees the vehicle leave its hold, its return or its landing commands that again, more than once and at once. Where the
//! vehicle flies on, and is not flown by hand, that is carried out each time: it takes nothing from anybody that is safer.

use std::time::Duration;

use mapping::mode::Px4Mode;
use mavlink_link::store::{Record as _, Store as _, StoreError};
use serde::{Deserialize, Serialize};
use stanag_msgs::Id;
use stanag_msgs::enums::FlightPathControlMode as Mode;
use stanag_msgs::messages::VehicleOperatingModeCommand;

use super::situation::names_mode;
use crate::session::context::{Context, MissionView, Origin};
use crate::session::effects::Effects;
use crate::session::log::LogLevel;
use crate::session::other::{Other, flies_on};
use crate::session::station::GroundStation;
use crate::session::store::{Uptime, vehicle_record};

/// The last 2016 of a CUCS that names a mode.
#[derive(Debug, Default)]
pub(super) struct Repeated {
    pub(super) latest: Option<Latest>,
    /// When the VSM was started; `None` once a 2016 has come.
    started: Option<Duration>,
    /// What the disk has.
    stored: Option<Stream>,
    /// When that is tried again, after a fault of the disk.
    unsaved: Option<Duration>,
}

/// What is known of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
struct Stream {
    station: u32,
    mode: u8,
    mission_id: Option<u32>,
    over_other: Option<bool>,
    reached: Option<u32>,
}

#[derive(Debug, Default, Serialize, Deserialize)]
struct Record {
    stream: Option<Stream>,
    /// When it was written: before the computer was restarted it may have been another stream, since nothing waits until the disk has it.
    written: Option<Uptime>,
}

// A command must not wait for the disk; as with the log of commands, the end of this process alone is survived.
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
        let starts = |started| now.saturating_sub(started) < REPEATED_WITHIN;
        sender(context, origin, command).is_some_and(|by| {
            // The stream may be older than this process.
            self.continues(now, by, command) || self.started.is_some_and(starts)
        })
    }

    fn continues(&self, now: Duration, by: Id, command: &VehicleOperatingModeCommand) -> bool {
        self.latest.as_ref().is_some_and(|latest| {
            let same = by == latest.station && mode(command) == latest.mode();
            same && !latest.has_ended(now)
        })
    }

    /// A 2016 comes; without origin it is a command of the VSM. `over_other`: whether somebody else has the vehicle.
    pub(super) fn note(
        &mut self,
        context: &Context<'_>,
        origin: Option<Origin>,
        command: &VehicleOperatingModeCommand,
        mission: &MissionView<'_>,
        over_other: Option<bool>,
    ) -> Repetition {
        let Some(station) = sender(context, origin, command) else {
            return Repetition::None;
        };
        let now = context.mono();
        let may_continue = self.is_continued(context, origin, command);
        let continues = self.continues(now, station, command);
        self.started = None;
        let (command, mission_id) = (without_stamp(command), mission_id(mission));
        if let Some(latest) = self.latest.as_mut().filter(|_| continues) {
            latest.at = now;
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
            over_other: over_other.filter(|_| !may_continue),
            reached: None,
        });
        if may_continue {
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
        mission: &MissionView<'_>,
        repetition: Repetition,
    ) {
        // One without a mode changes values in the mode that is flown.
        let by = sender(context, origin, command);
        let is_latest =
            |latest: &&mut Latest| by == Some(latest.station) && mode(command) == latest.mode();
        if let Some(latest) = self.latest.as_mut().filter(is_latest) {
            latest.mission_id = mission_id(mission);
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

    /// Stores what has changed; every input ends here.
    pub(super) fn store(&mut self, effects: &mut Effects<'_>) {
        let now = effects.dli.now.mono;
        // What has ended must not refuse a command after the next start.
        let lasts = self.latest.as_ref().filter(|one| !one.has_ended(now));
        let stream = lasts.and_then(Latest::stream);
        if stream == self.stored {
            self.unsaved = None;
            return;
        }
        if self.unsaved.is_some_and(|again| now < again) {
            return;
        }
        let record = Record {
            stream,
            written: effects.dli.uptime(),
        };
        let vehicle = effects.id;
        match effects.disk().save(&vehicle, &record) {
            Ok(()) => (self.stored, self.unsaved) = (stream, None),
            Err(fault) => {
                if self.unsaved.replace(now + RETRY_INTERVAL).is_none() {
                    let text = format!(
                        "{fault}; a 2016 that is repeated over a restart of the VSM may be taken for a new one"
                    );
                    effects.note(LogLevel::Warning, text);
                }
            }
        }
    }

    /// Continues the stream of before a restart.
    ///
    /// # Errors
    /// Its record exists and cannot be read.
    pub(super) fn restore(&mut self, effects: &mut Effects<'_>) -> Result<(), StoreError> {
        let (vehicle, now, uptime) = (effects.id, effects.dli.now.mono, effects.dli.uptime());
        self.started = Some(now);
        let record = effects.disk().load::<Record>(&vehicle)?;
        let record = record.unwrap_or_default();
        self.stored = record.stream;
        let of_this_boot = uptime
            .zip(record.written)
            .is_some_and(|(now, written)| written.age(now).is_some());
        // The node of a fleet that stood by knows that the one before has written it.
        let is_last = of_this_boot
            || effects
                .disk()
                .written_within(&Record::name(&vehicle))
                .is_some();
        self.latest = record.stream.filter(|_| is_last).map(|stream| Latest {
            station: Id(stream.station),
            // Its values are not known: the first one that comes has others.
            command: Box::new(VehicleOperatingModeCommand {
                select_flight_path_control_mode: Some(Mode::from_raw(stream.mode)),
                ..VehicleOperatingModeCommand::default()
            }),
            mission_id: stream.mission_id,
            at: now,
            state: State::Open,
            over_other: stream.over_other,
            reached: stream.reached.map(Px4Mode),
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
    fn stream(&self) -> Option<Stream> {
        Some(Stream {
            station: self.station.0,
            mode: self.mode()?.raw(),
            mission_id: self.mission_id,
            over_other: self.over_other,
            reached: self.reached.map(|mode| mode.0),
        })
    }

    fn has_ended(&self, now: Duration) -> bool {
        now.saturating_sub(self.at) >= REPEATED_WITHIN
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
    context: &Context<'_>,
    origin: Option<Origin>,
    command: &VehicleOperatingModeCommand,
) -> Option<Id> {
    let by = origin.filter(|origin| origin.held.is_none() && names_mode(command));
    by.and_then(|origin| context.stations.get(origin.station))
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
/// After a fault of the disk.
const RETRY_INTERVAL: Duration = Duration::from_secs(5);
pub(super) const NOT_NEW: &str =
    "this only continues or repeats an earlier command: command another mode, or pause for 5 s";
