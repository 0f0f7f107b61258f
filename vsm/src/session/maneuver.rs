//! A mode command (2016) while it is carried out: steps, each confirmed by what the vehicle shows.
//!
//! An accepted COMMAND_ACK proves nothing: PX4 accepts modes that it does not enter. A maneuver is done when the
//! vehicle's own messages, made after the command was sent, show it; else it is refused with the vehicle's reason.

use std::collections::VecDeque;
use std::ops::RangeInclusive;
use std::time::Duration;

use mapping::mode::Px4Mode;
use mapping::report::Commanded;
use mapping::route::metres;
use mapping::telemetry::Place;
use mavlink_link::dialect::{MavCmd, MavFrame, MavLandedState, MavResult};
use mavlink_link::service::command::{self, Command, Outcome, Payload, Repetition, Ticket};
use mavlink_link::service::mission;

use super::vehicle::VehicleLink;

/// One step of a maneuver.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Step {
    /// Sends a command; a temporary rejection is tried again for so long.
    Command {
        command: Command,
        what: &'static str,
        patience: Duration,
    },
    /// Makes the first of these mission items the current one; the vehicle may go on to the last of them at once.
    SetCurrent(RangeInclusive<u16>),
    /// Lets the vehicle take notice of what is sent beside.
    Pause(Duration),
    /// Waits until the vehicle shows it.
    Confirm { sight: Sight, within: Duration },
}

/// What the vehicle must show.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Sight {
    /// One of these modes.
    Mode(&'static [Px4Mode]),
    /// Motors armed.
    Armed,
    /// Motors disarmed.
    Disarmed,
    /// Off the ground.
    OffTheGround,
    /// It flies this circle: centre, and radius, negative counter-clockwise.
    Orbit { centre: (f64, f64), radius_m: f64 },
    /// It flies about as fast as this, m/s over ground.
    Speed(f64),
    /// It flies to this place, or to this altitude only.
    Target {
        place: Option<(f64, f64)>,
        amsl_m: Option<f64>,
    },
}

/// What became of a maneuver.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Progress {
    Going,
    Done,
    Refused(String),
}

/// The machine.
#[derive(Debug)]
pub(crate) struct Maneuver {
    steps: VecDeque<Step>,
    waiting: Waiting,
    /// What 3002 reports as commanded, once it is done.
    pub(crate) commanded: Commanded,
    /// Sent when the maneuver fails: a launch that fails leaves no running motors.
    undo: Option<Command>,
    armed_by_us: bool,
}

#[derive(Debug)]
enum Waiting {
    /// The next step has not begun.
    Nothing,
    Answer {
        ticket: Ticket,
        patient_until: Duration,
    },
    Again {
        at: Duration,
        patient_until: Duration,
    },
    Current,
    Pause {
        until: Duration,
    },
    Sight {
        deadline: Duration,
    },
}

impl Maneuver {
    pub(crate) fn new(steps: impl IntoIterator<Item = Step>, commanded: Commanded) -> Maneuver {
        Maneuver {
            steps: steps.into_iter().collect(),
            waiting: Waiting::Nothing,
            commanded,
            undo: None,
            armed_by_us: false,
        }
    }

    /// A command sent when the maneuver fails after its arming step.
    pub(crate) fn undone_by(mut self, command: Command) -> Maneuver {
        self.undo = Some(command);
        self
    }

    /// The end of a command of this maneuver, or of another.
    pub(crate) fn handle_command(
        &mut self,
        now: Duration,
        event: &command::Event,
        vehicle: &VehicleLink,
    ) -> Progress {
        let command::Event::Done {
            ticket, outcome, ..
        } = event
        else {
            return Progress::Going;
        };
        let Waiting::Answer {
            ticket: ours,
            patient_until,
        } = self.waiting
        else {
            return Progress::Going;
        };
        if *ticket != ours {
            return Progress::Going;
        }
        let Some(Step::Command { what, command, .. }) = self.steps.front() else {
            return Progress::Going;
        };
        match *outcome {
            Outcome::Answered {
                result: MavResult::MAV_RESULT_ACCEPTED,
                ..
            } => {
                self.armed_by_us |= command.command == MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;
                self.next();
                Progress::Going
            }
            Outcome::Answered {
                result: MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
                ..
            } if now < patient_until => {
                self.waiting = Waiting::Again {
                    at: now + PAUSE,
                    patient_until,
                };
                Progress::Going
            }
            Outcome::Answered { result, .. } => {
                let why = vehicle.latest_complaint(now).unwrap_or_default();
                Progress::Refused(format!("{what}: the vehicle says {}{why}", name(result)))
            }
            Outcome::NoAnswer { tries } => {
                Progress::Refused(format!("{what}: no answer of the vehicle to {tries} tries"))
            }
            Outcome::Withdrawn => Progress::Refused(format!("{what}: withdrawn")),
        }
    }

    /// The end of a mission operation.
    pub(crate) fn handle_mission(&mut self, event: &mission::Event) -> Progress {
        let (Waiting::Current, Some(Step::SetCurrent(items))) = (&self.waiting, self.steps.front())
        else {
            return Progress::Going;
        };
        match event {
            mission::Event::CurrentSet { seq } if seq == items.start() => {
                self.next();
                Progress::Going
            }
            mission::Event::Failed {
                operation: mission::Operation::SetCurrent,
                ..
            } => Progress::Refused(format!(
                "the vehicle does not go to mission item {}",
                items.end()
            )),
            _ => Progress::Going,
        }
    }

    /// Begins what can begin, looks at what is awaited.
    pub(crate) fn advance(&mut self, now: Duration, vehicle: &mut VehicleLink) -> Progress {
        loop {
            let Some(step) = self.steps.front() else {
                return Progress::Done;
            };
            match (&self.waiting, step) {
                (
                    Waiting::Nothing,
                    Step::Command {
                        command,
                        what,
                        patience,
                    },
                ) => {
                    let patient_until = now + *patience;
                    match vehicle.commands.submit(now, *command) {
                        Ok(ticket) => {
                            self.waiting = Waiting::Answer {
                                ticket,
                                patient_until,
                            }
                        }
                        Err(full) => return Progress::Refused(format!("{what}: {full}")),
                    }
                }
                (Waiting::Again { at, patient_until }, Step::Command { command, what, .. })
                    if *at <= now =>
                {
                    let patient_until = *patient_until;
                    match vehicle.commands.submit(now, *command) {
                        Ok(ticket) => {
                            self.waiting = Waiting::Answer {
                                ticket,
                                patient_until,
                            }
                        }
                        Err(full) => return Progress::Refused(format!("{what}: {full}")),
                    }
                }
                (Waiting::Nothing, Step::SetCurrent(items)) => {
                    match vehicle.missions.set_current(now, items.clone()) {
                        Ok(()) => self.waiting = Waiting::Current,
                        Err(busy) => {
                            return Progress::Refused(format!("the mission service is {busy}"));
                        }
                    }
                }
                (Waiting::Nothing, Step::Pause(span)) => {
                    self.waiting = Waiting::Pause { until: now + *span };
                }
                (Waiting::Pause { until }, Step::Pause(_)) if *until <= now => self.next(),
                (Waiting::Nothing, Step::Confirm { within, .. }) => {
                    self.waiting = Waiting::Sight {
                        deadline: now + *within,
                    };
                }
                (Waiting::Sight { deadline }, Step::Confirm { sight, .. }) => {
                    if seen(sight, vehicle) {
                        self.next();
                    } else if *deadline <= now {
                        let why = vehicle.latest_complaint(now).unwrap_or_default();
                        return Progress::Refused(format!(
                            "the vehicle does not show {}{why}",
                            awaited(sight, vehicle)
                        ));
                    } else {
                        return Progress::Going;
                    }
                }
                _ => return Progress::Going,
            }
        }
    }

    /// When [`Maneuver::advance`] is next needed.
    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        match self.waiting {
            Waiting::Again { at, .. } => Some(at),
            Waiting::Pause { until } => Some(until),
            Waiting::Sight { deadline } => Some(deadline),
            Waiting::Nothing => Some(Duration::ZERO),
            Waiting::Answer { .. } | Waiting::Current => None,
        }
    }

    /// Ends it before its end: withdraws what waits, and undoes what must not stay.
    pub(crate) fn abandon(&mut self, now: Duration, vehicle: &mut VehicleLink) {
        if let Waiting::Answer { ticket, .. } = self.waiting {
            vehicle.commands.withdraw(now, ticket);
        }
        if matches!(self.waiting, Waiting::Current) {
            vehicle.missions.cancel();
        }
        let on_ground =
            vehicle.telemetry.landed == Some(MavLandedState::MAV_LANDED_STATE_ON_GROUND);
        if let (true, true, Some(undo)) = (self.armed_by_us, on_ground, self.undo) {
            // Full means that the vehicle does not answer; it disarms by itself on the ground.
            let _ = vehicle.commands.submit(now, undo);
        }
    }

    fn next(&mut self) {
        self.steps.pop_front();
        self.waiting = Waiting::Nothing;
    }
}

fn seen(sight: &Sight, vehicle: &VehicleLink) -> bool {
    let telemetry = &vehicle.telemetry;
    match sight {
        Sight::Mode(modes) => {
            vehicle.state_is_newer_than_command()
                && telemetry.mode.is_some_and(|mode| modes.contains(&mode))
        }
        Sight::Armed => vehicle.state_is_newer_than_command() && telemetry.armed == Some(true),
        Sight::Disarmed => vehicle.state_is_newer_than_command() && telemetry.armed == Some(false),
        Sight::OffTheGround => telemetry.airborne(),
        Sight::Orbit { centre, radius_m } => telemetry.orbit.is_some_and(|orbit| {
            let flown = (orbit.centre.latitude, orbit.centre.longitude);
            metres(*centre, flown) < TARGET_SLACK_M
                && (orbit.radius_m - radius_m).abs() < RADIUS_SLACK_M
        }),
        Sight::Speed(wanted) => telemetry
            .groundspeed
            .is_some_and(|flown| (flown - wanted).abs() < speed_slack(*wanted)),
        Sight::Target { place, amsl_m } => telemetry.target.is_some_and(|target: Place| {
            let there = place.is_none_or(|place| {
                metres(place, (target.latitude, target.longitude)) < TARGET_SLACK_M
            });
            there && amsl_m.is_none_or(|wanted| (wanted - target.amsl_m).abs() < TARGET_SLACK_M)
        }),
    }
}

fn awaited(sight: &Sight, vehicle: &VehicleLink) -> String {
    match sight {
        Sight::Mode(modes) => {
            let wanted = modes.first().map_or("", |mode| mode.name());
            let present = vehicle.telemetry.mode.map_or("no mode", Px4Mode::name);
            format!("{wanted}, it is in {present}")
        }
        Sight::Armed => "armed motors".to_owned(),
        Sight::Disarmed => "disarmed motors".to_owned(),
        Sight::OffTheGround => "that it has left the ground".to_owned(),
        Sight::Orbit { .. } => "that it flies the commanded circle".to_owned(),
        Sight::Speed(wanted) => {
            let flown = vehicle.telemetry.groundspeed.unwrap_or(0.0);
            format!("{wanted:.1} m/s, it flies {flown:.1}")
        }
        Sight::Target { .. } => "that it flies to the commanded place".to_owned(),
    }
}

fn name(result: MavResult) -> &'static str {
    match result {
        MavResult::MAV_RESULT_ACCEPTED => "accepted",
        MavResult::MAV_RESULT_TEMPORARILY_REJECTED => "temporarily rejected",
        MavResult::MAV_RESULT_DENIED => "denied",
        MavResult::MAV_RESULT_UNSUPPORTED => "unsupported",
        MavResult::MAV_RESULT_FAILED => "failed",
        MavResult::MAV_RESULT_IN_PROGRESS => "in progress",
        MavResult::MAV_RESULT_CANCELLED => "cancelled",
        MavResult::MAV_RESULT_NOT_IN_CONTROL => "that this VSM has no operator control",
        _ => "no",
    }
}

/// MAV_CMD_DO_SET_MODE to a mode of PX4, and the sight of it.
pub(crate) fn enter(modes: &'static [Px4Mode]) -> [Step; 2] {
    let mode = modes.first().copied().unwrap_or(Px4Mode::LOITER);
    let params = [
        CUSTOM_MODE_ENABLED,
        f32::from(mode.main()),
        f32::from(mode.sub()),
        0.0,
        0.0,
        0.0,
        0.0,
    ];
    let command = long(MavCmd::MAV_CMD_DO_SET_MODE, params);
    [
        Step::Command {
            command,
            what: mode.name(),
            patience: MODE_PATIENCE,
        },
        Step::Confirm {
            sight: Sight::Mode(modes),
            within: STATE_WITHIN,
        },
    ]
}

/// Whether steps end in a mode.
pub(crate) fn enters(steps: &[Step], mode: Px4Mode) -> bool {
    steps.iter().any(
        |step| matches!(step, Step::Confirm { sight: Sight::Mode(modes), .. } if **modes == [mode]),
    )
}

/// Arms, and takes off to an altitude above mean sea level.
pub(crate) fn launch(amsl_m: f64) -> Vec<Step> {
    const TAKEN_OFF: &[Px4Mode] = &[Px4Mode::TAKEOFF, Px4Mode::LOITER];
    let mut steps: Vec<Step> = enter(&[Px4Mode::LOITER]).into();
    // PX4 takes plain AUTO.TAKEOFF to MIS_TAKEOFF_ALT: the altitude must be in the command. Unused parameters that
    // are neither 0 nor NaN are denied.
    let take_off = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, amsl_m as f32];
    steps.extend([
        Step::Command {
            command: arm(true),
            what: "arming",
            patience: ARM_PATIENCE,
        },
        Step::Confirm {
            sight: Sight::Armed,
            within: STATE_WITHIN,
        },
        Step::Command {
            command: long(MavCmd::MAV_CMD_NAV_TAKEOFF, take_off),
            what: "take-off",
            patience: Duration::ZERO,
        },
        Step::Confirm {
            sight: Sight::Mode(TAKEN_OFF),
            within: STATE_WITHIN,
        },
        Step::Confirm {
            sight: Sight::OffTheGround,
            within: LIFT_OFF_WITHIN,
        },
    ]);
    steps
}

/// Disarms, and waits until that is seen.
pub(crate) fn disarm() -> [Step; 2] {
    [
        Step::Command {
            command: arm(false),
            what: "disarming",
            patience: Duration::ZERO,
        },
        Step::Confirm {
            sight: Sight::Disarmed,
            within: STATE_WITHIN,
        },
    ]
}

/// MAV_CMD_COMPONENT_ARM_DISARM, never forced.
pub(crate) fn arm(armed: bool) -> Command {
    long(
        MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
        [f32::from(u8::from(armed)), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    )
}

/// MAV_CMD_DO_CHANGE_SPEED. No message of PX4 shows the commanded speed: the acknowledgement must do.
///
/// PX4 applies a speed to the present leg only when it is called a ground speed.
pub(crate) fn change_speed(speed_m_s: f64) -> Step {
    let kind = 1.0;
    Step::Command {
        command: long(
            MavCmd::MAV_CMD_DO_CHANGE_SPEED,
            [kind, speed_m_s as f32, -1.0, 0.0, 0.0, 0.0, 0.0],
        ),
        what: "speed",
        patience: Duration::ZERO,
    }
}

/// MAV_CMD_DO_REPOSITION: to a place, or to another altitude where it is. Enters AUTO.LOITER.
pub(crate) fn reposition(
    place: Option<(f64, f64)>,
    amsl_m: f64,
    speed_m_s: Option<f64>,
) -> [Step; 3] {
    const CHANGE_MODE: f32 = 1.0;
    let (x, y) = place.map_or((i32::MAX, i32::MAX), |(latitude, longitude)| {
        (e7(latitude), e7(longitude))
    });
    let command = Command {
        command: MavCmd::MAV_CMD_DO_REPOSITION,
        payload: Payload::Int {
            frame: MavFrame::MAV_FRAME_GLOBAL,
            params: [
                speed_m_s.map_or(-1.0, |speed| speed as f32),
                CHANGE_MODE,
                0.0,
                f32::NAN,
            ],
            x,
            y,
            z: amsl_m as f32,
        },
        repetition: Repetition::Safe,
    };
    [
        Step::Command {
            command,
            what: "reposition",
            patience: Duration::ZERO,
        },
        Step::Confirm {
            sight: Sight::Mode(&[Px4Mode::LOITER]),
            within: STATE_WITHIN,
        },
        Step::Confirm {
            sight: Sight::Target {
                place,
                amsl_m: Some(amsl_m),
            },
            within: STATE_WITHIN,
        },
    ]
}

/// The sight of a speed on a circle.
pub(crate) fn shows_speed(speed_m_s: f64) -> Step {
    Step::Confirm {
        sight: Sight::Speed(speed_m_s),
        within: SPEED_WITHIN,
    }
}

/// MAV_CMD_DO_ORBIT around a place; a negative radius is flown counter-clockwise. Enters ORBIT on a multicopter, whose
/// ORBIT_EXECUTION_STATUS shows the circle, AUTO.LOITER on a fixed wing.
pub(crate) fn orbit(
    place: (f64, f64),
    amsl_m: f64,
    radius_m: f64,
    speed_m_s: Option<f64>,
    hovers: bool,
) -> Vec<Step> {
    let radius = radius_m as f32;
    let command = Command {
        command: MavCmd::MAV_CMD_DO_ORBIT,
        payload: Payload::Int {
            frame: MavFrame::MAV_FRAME_GLOBAL,
            params: [
                radius,
                speed_m_s.map_or(f32::NAN, |speed| speed as f32),
                0.0,
                f32::NAN,
            ],
            x: e7(place.0),
            y: e7(place.1),
            z: amsl_m as f32,
        },
        repetition: Repetition::Safe,
    };
    const FLOWN: &[Px4Mode] = &[Px4Mode::ORBIT];
    const WINGED: &[Px4Mode] = &[Px4Mode::LOITER];
    let mut steps = vec![
        Step::Command {
            command,
            what: "orbit",
            patience: Duration::ZERO,
        },
        Step::Confirm {
            sight: Sight::Mode(if hovers { FLOWN } else { WINGED }),
            within: STATE_WITHIN,
        },
    ];
    if hovers {
        steps.push(Step::Confirm {
            sight: Sight::Orbit {
                centre: place,
                radius_m,
            },
            within: STATE_WITHIN,
        });
    }
    steps
}

fn long(command: MavCmd, params: [f32; 7]) -> Command {
    Command {
        command,
        payload: Payload::Long(params),
        repetition: Repetition::Safe,
    }
}

fn e7(degrees: f64) -> i32 {
    (degrees * 1e7).round() as i32
}

/// DO_SET_MODE param1: MAV_MODE_FLAG_CUSTOM_MODE_ENABLED.
const CUSTOM_MODE_ENABLED: f32 = 1.0;
/// HEARTBEAT comes at 1 Hz, and some of them are lost.
const STATE_WITHIN: Duration = Duration::from_secs(6);
/// PX4 spins its motors up before it lifts.
const LIFT_OFF_WITHIN: Duration = Duration::from_secs(12);
/// After its start PX4 refuses to arm for some seconds.
const ARM_PATIENCE: Duration = Duration::from_secs(8);
/// For some tenths of a second after an upload PX4 refuses to fly it.
const MODE_PATIENCE: Duration = Duration::from_secs(2);
/// Between two tries after a temporary rejection.
const PAUSE: Duration = Duration::from_millis(400);
/// How far a flown speed may be from the one commanded: on a circle PX4 lags behind its set point, by a sixth at 5 m/s on
/// 30 m, and wind makes it waver.
fn speed_slack(speed_m_s: f64) -> f64 {
    (0.25 * speed_m_s).max(0.5)
}

/// To another speed on a circle.
const SPEED_WITHIN: Duration = Duration::from_secs(15);
/// How near the radius of a circle must be to the one commanded, m.
const RADIUS_SLACK_M: f64 = 0.5;
/// How near a set point must be to the one commanded, m.
const TARGET_SLACK_M: f64 = 2.0;
