//! Steering (2016 mode 15): speed, course, heading, turn rate, altitude and vertical speed as OFFBOARD set points.
//!
//! Set points are sent 20 times a second, from before the mode is entered until the vehicle reports another one: PX4 treats
//! a gap of a second as a loss and returns. While no data of the vehicle arrives they continue, level, for at most
//! [`LONGEST_BLIND`]; after a stop of the bridge there are none before the vehicle has shown its mode. Where PX4's failsafe puts the
//! vehicle on hold, as at a fence with GF_ACTION 2, it keeps OFFBOARD as the mode that was chosen, and would return for want of set
//! points: they continue, and stand still ([`Phase::Aside`]). Not where COM_OBL_RC_ACT is 5, or is not known: there it holds for want of
//! set points too, and would leave that for new ones. Values that a command
//! leaves out stay unchanged; on entering the mode they are the vehicle's present ones. Multicopters only: PX4 does not steer a fixed wing by such set points.
//!
//! | 2016 | flown as |
//! |---|---|
//! | Heading Command Type 1, heading | nose and track that way |
//! | 2, course | track and nose that way |
//! | 3, heading and course | nose by the heading, track by the course |
//! | 5, turn rate | nose and track turn, clockwise positive |
//! | 4, roll | refused |
//! | Altitude Command Type 1, 3 | climbs or sinks to the altitude; 3 with Commanded Vertical Speed at most |
//! | 2, vertical speed | up positive, within the height limits of the vehicle |
//! | Commanded Speed | speed over ground |

use std::f64::consts::TAU;
use std::time::Duration;

use mapping::limits::Limits;
use mapping::mode::Px4Mode;
use mapping::report::CommandedDirection;
use mapping::telemetry::Telemetry;
use mavlink_link::dialect::{
    MavFrame, MavMessage, PositionTargetTypemask, SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use stanag_msgs::enums::{HeadingCommandType, HeadingReference};
use stanag_msgs::messages::VehicleOperatingModeCommand;

use crate::session::link::state::VehicleState;

/// The changes in one command.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Order {
    pub(crate) speed_m_s: Option<f64>,
    pub(crate) direction: Option<Direction>,
    pub(crate) vertical: Option<Vertical>,
}

/// Directions of nose and track, rad from true north.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Direction {
    Steady {
        nose: f64,
        track: f64,
    },
    /// Both turn, rad/s, clockwise positive.
    Turning(f64),
}

/// The vertical demand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Vertical {
    /// Fly to an altitude, with at most this rate.
    Altitude { amsl_m: f64, most_m_s: f64 },
    /// Vertical speed, up positive.
    Rate(f64),
}

/// The direction demanded by a command.
///
/// # Errors
/// The reason, for the operator.
pub(crate) fn direction(
    command: &VehicleOperatingModeCommand,
) -> Result<Option<Direction>, String> {
    let kind = command
        .heading_command_type
        .unwrap_or(HeadingCommandType::None);
    let absolute = !matches!(
        kind,
        // A turn rate has no reference direction, so a full presence vector may carry any Heading Reference with it.
        HeadingCommandType::None | HeadingCommandType::TurnRate
    );
    match command.heading_reference {
        Some(HeadingReference::Magnetic) if absolute => {
            return Err(
                "mode 15 (autopilot): magnetic headings are not supported, the vehicle reports no declination"
                    .to_owned(),
            );
        }
        Some(HeadingReference::Unknown(value)) if absolute => {
            return Err(format!(
                "mode 15 (autopilot): Heading Reference {value} is not known"
            ));
        }
        _ => {}
    }
    let missing = |field: &str| format!("mode 15 (autopilot): {field} is missing");
    let heading = || {
        let angle = command.commanded_heading.map(|angle| angle.radians());
        angle.ok_or_else(|| missing("Commanded Heading"))
    };
    let course = || {
        let angle = command.commanded_course.map(|angle| angle.radians());
        angle.ok_or_else(|| missing("Commanded Course"))
    };
    let steady = |nose, track| Ok(Some(Direction::Steady { nose, track }));
    match kind {
        HeadingCommandType::None => Ok(None),
        HeadingCommandType::Heading => steady(heading()?, heading()?),
        HeadingCommandType::Course => steady(course()?, course()?),
        HeadingCommandType::HeadingAndCourse => steady(heading()?, course()?),
        HeadingCommandType::TurnRate => {
            let rate = command.commanded_turn_rate.map(|rate| rate.si());
            Ok(Some(Direction::Turning(
                rate.ok_or_else(|| missing("Commanded Turn Rate"))?,
            )))
        }
        other => Err(format!(
            "mode 15 (autopilot): Heading Command Type {} is not flown",
            other.raw()
        )),
    }
}

/// The direction that 3002 reports for a command.
pub(crate) fn reported(command: &VehicleOperatingModeCommand) -> Option<CommandedDirection> {
    use HeadingCommandType as H;
    let kind = command.heading_command_type?;
    if kind == H::TurnRate {
        let rate = command.commanded_turn_rate?;
        return Some(CommandedDirection::Turning(rate.si()));
    }
    let heading = command.commanded_heading;
    let course = command.commanded_course;
    Some(CommandedDirection::Steady {
        heading: heading.filter(|_| matches!(kind, H::Heading | H::HeadingAndCourse)),
        course: course.filter(|_| matches!(kind, H::Course | H::HeadingAndCourse)),
    })
}

/// The machine.
#[derive(Debug, Clone, Default)]
pub(crate) struct Steering {
    flown: Option<Flown>,
}

#[derive(Debug, Clone, Copy)]
struct Flown {
    speed_m_s: f64,
    direction: Direction,
    /// Present nose and track.
    nose: f64,
    track: f64,
    vertical: Vertical,
    due: Duration,
    last: Duration,
    phase: Phase,
    /// The mode was given up; the vehicle may still receive its command until this time.
    given_up: Option<Duration>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// The mode is commanded; `aside`: from [`Phase::Aside`], where a refusal leads back to.
    Entering { aside: bool },
    /// The vehicle has shown the mode.
    Flying,
    /// PX4's failsafe holds the vehicle, and would return for want of set points: these stand still.
    Aside,
    /// After that, the vehicle shows the mode again, by itself or by a pilot. They still stand still.
    Back,
}

/// Who has the vehicle after a call, where that has changed without a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Taken {
    /// PX4's failsafe, which holds.
    ByFailsafe,
    /// The set points, which stand still.
    Back,
}

impl Steering {
    /// Whether set points are being sent.
    pub(crate) fn engaged(&self) -> bool {
        self.flown.is_some()
    }

    /// The mode is to be entered, whatever the vehicle reported last: earlier steering no longer applies, but orders
    /// received while entering the mode do.
    pub(super) fn enter_again(&mut self) {
        self.flown = self.flown.and_then(|flown| match flown.phase {
            Phase::Flying => None,
            Phase::Back => Some(flown.aside()),
            Phase::Entering { .. } | Phase::Aside => Some(flown),
        });
    }

    /// The mode is commanded once more after the vehicle has shown it: a report of another one does not end the set points.
    pub(super) fn enter_once_more(&mut self) {
        if let Some(flown) = &mut self.flown {
            (flown.phase, flown.given_up) = (Phase::Entering { aside: false }, None);
        }
    }

    /// Entering the mode was superseded or not confirmed: the vehicle may still enter it, and would return home without set
    /// points. In other modes it ignores them. So they continue until a report after the last command shows another mode and
    /// any command in transit has arrived.
    pub(super) fn give_up(&mut self, now: Duration) {
        if let Some(flown) = &mut self.flown {
            flown.given_up.get_or_insert(now + ON_ITS_WAY);
        }
    }

    /// Applies an order on top of the present steering or motion.
    ///
    /// # Errors
    /// A needed value that the vehicle has not reported yet, for the operator.
    pub(super) fn take(
        &mut self,
        now: Duration,
        order: Order,
        vehicle: &Telemetry,
    ) -> Result<(), String> {
        let mut flown = match self.flown {
            Some(flown) if flown.phase != Phase::Aside => flown,
            // It has moved since by PX4's hold.
            aside => {
                let mut flown = present(now, vehicle)?;
                flown.phase = Phase::Entering {
                    aside: aside.is_some(),
                };
                flown
            }
        };
        if flown.phase == Phase::Back {
            flown.phase = Phase::Flying;
        }
        // A new order wants the mode after all: its set points must not end with those of the earlier one.
        flown.given_up = None;
        flown.speed_m_s = order.speed_m_s.unwrap_or(flown.speed_m_s);
        flown.vertical = order.vertical.unwrap_or(flown.vertical);
        if let Some(direction) = order.direction {
            flown.direction = direction;
            if let Direction::Steady { nose, track } = direction {
                (flown.nose, flown.track) = (nose, track);
            }
        }
        self.flown = Some(flown);
        Ok(())
    }

    /// Ends the set points.
    pub(crate) fn release(&mut self) {
        self.flown = None;
    }

    /// PX4's failsafe holds a vehicle that was in the mode by the set points of a curve.
    pub(super) fn stand_aside(&mut self, now: Duration, vehicle: &Telemetry) {
        self.flown = present(now, vehicle).ok().map(Flown::aside);
    }

    /// The vehicle has refused a command, in another mode than that of the set points, which it was not to enter or has not.
    pub(super) fn refused(&mut self) {
        self.flown = self.flown.and_then(|flown| match flown.phase {
            Phase::Aside | Phase::Back | Phase::Entering { aside: true } => Some(flown.aside()),
            Phase::Entering { aside: false } | Phase::Flying => None,
        });
    }

    /// The vehicle has entered the mode of a command: its failsafe does not miss set points any more.
    pub(super) fn end_aside(&mut self) {
        self.flown = self.flown.filter(|flown| flown.phase != Phase::Aside);
    }

    /// Whether a failsafe has taken the vehicle, and nobody has commanded the mode since.
    pub(super) fn is_aside(&self) -> bool {
        (self.flown).is_some_and(|flown| matches!(flown.phase, Phase::Aside | Phase::Back))
    }

    /// Notes the mode that the vehicle shows; `holds`: by a failsafe of PX4 that would act for want of set points. The stream ends when
    /// the vehicle has left the mode otherwise.
    pub(super) fn note_mode(
        &mut self,
        now: Duration,
        state: &VehicleState,
        holds: bool,
    ) -> Option<Taken> {
        let flown = self.flown?;
        let steered = state.telemetry.mode == Some(Px4Mode::OFFBOARD);
        let (flown, taken) = match flown.phase {
            // HEARTBEAT shows the previous mode for up to a second, and may show an earlier OFFBOARD.
            Phase::Entering { .. } if steered && state.state_is_newer_than_command() => {
                (flown.in_phase(Phase::Flying), None)
            }
            Phase::Entering { aside } => {
                let arrived = flown.given_up.is_some_and(|until| until <= now);
                let mode = state.settled_mode();
                match arrived && mode.is_some_and(|mode| mode != Px4Mode::OFFBOARD) {
                    false => return None,
                    true if aside && holds => (flown.aside(), None),
                    true => return self.end(),
                }
            }
            _ if state.telemetry.armed == Some(false) => return self.end(),
            Phase::Flying | Phase::Back if steered => return None,
            Phase::Aside if steered => (flown.in_phase(Phase::Back), Some(Taken::Back)),
            Phase::Flying | Phase::Back if holds => (flown.aside(), Some(Taken::ByFailsafe)),
            Phase::Aside if holds => return None,
            Phase::Flying | Phase::Aside | Phase::Back => return self.end(),
        };
        self.flown = Some(flown);
        taken
    }

    fn end<T>(&mut self) -> Option<T> {
        self.release();
        None
    }

    /// The set point that is due.
    pub(super) fn advance(
        &mut self,
        now: Duration,
        state: &VehicleState,
        limits: &Limits,
        system: u8,
    ) -> Option<MavMessage> {
        let silent_for = state
            .mode_at()
            .map_or(Duration::MAX, |at| now.saturating_sub(at));
        if silent_for > LONGEST_BLIND {
            // A vehicle that is silent for long cannot be steered: the set points end, and PX4 returns.
            self.release();
        }
        let vehicle = &state.telemetry;
        let flown = self.flown.as_mut()?;
        // PX4 has taken the gap for a loss, and would leave its failsafe for these set points.
        if state.awaits_mode() {
            (flown.due, flown.last) = (now + PERIOD, now);
        }
        if flown.due > now {
            return None;
        }
        let span = now.saturating_sub(flown.last).as_secs_f64();
        flown.last = now;
        // Counted from the due time, so that late calls keep the rate; a longer gap is not made up for.
        flown.due = if flown.due + PERIOD > now {
            flown.due + PERIOD
        } else {
            now + PERIOD
        };
        // A turn begins with the mode, not with the set points that precede it.
        if let Direction::Turning(rate) = flown.direction
            && flown.phase == Phase::Flying
        {
            flown.nose = (flown.nose + rate * span).rem_euclid(TAU);
            flown.track = (flown.track + rate * span).rem_euclid(TAU);
        }
        // Without a reported height, heights cannot be flown.
        let climb_m_s = if !state.live() {
            0.0
        } else {
            climb(flown.vertical, vehicle, limits)
        };
        Some(set_point(flown, climb_m_s, system))
    }

    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        self.flown.map(|flown| flown.due)
    }
}

/// The vehicle's present motion as an order.
fn present(now: Duration, vehicle: &Telemetry) -> Result<Flown, String> {
    let [north, east, _] = vehicle
        .velocity_ned
        .ok_or("mode 15 (autopilot): the vehicle has not reported a velocity yet")?;
    let nose = vehicle
        .attitude
        .ok_or("mode 15 (autopilot): the vehicle has not reported a heading yet")?
        .yaw;
    let place = vehicle
        .position
        .ok_or("mode 15 (autopilot): the vehicle has not reported a position yet")?;
    let speed_m_s = north.hypot(east);
    let moves = speed_m_s > SLOWEST_M_S;
    let track = if moves { east.atan2(north) } else { nose };
    Ok(Flown {
        // A hovering vehicle drifts a little, and that must not become a commanded speed.
        speed_m_s: if moves { speed_m_s } else { 0.0 },
        direction: Direction::Steady { nose, track },
        nose,
        track,
        vertical: Vertical::Altitude {
            amsl_m: place.amsl_m,
            most_m_s: CLIMB_M_S,
        },
        due: now,
        last: now,
        phase: Phase::Entering { aside: false },
        given_up: None,
    })
}

impl Flown {
    fn in_phase(self, phase: Phase) -> Flown {
        Flown { phase, ..self }
    }

    /// It stands still, and keeps its nose.
    fn aside(self) -> Flown {
        let (nose, track) = (self.nose, self.track);
        Flown {
            speed_m_s: 0.0,
            direction: Direction::Steady { nose, track },
            vertical: Vertical::Rate(0.0),
            phase: Phase::Aside,
            given_up: None,
            ..self
        }
    }
}

/// Metres a second upwards.
fn climb(vertical: Vertical, vehicle: &Telemetry, limits: &Limits) -> f64 {
    let (Some(place), Some(home)) = (vehicle.position, vehicle.home) else {
        return 0.0;
    };
    let (low, high) = (
        home.amsl_m + limits.floor_m(),
        home.amsl_m + limits.highest_m,
    );
    let towards = |amsl_m: f64| (amsl_m - place.amsl_m) * APPROACH_PER_S;
    match vertical {
        Vertical::Altitude { amsl_m, most_m_s } => towards(amsl_m).clamp(-most_m_s, most_m_s),
        // Slow down before the limits.
        Vertical::Rate(rate) => rate.min(towards(high).max(0.0)).max(towards(low).min(0.0)),
    }
}

fn set_point(flown: &Flown, climb_m_s: f64, system: u8) -> MavMessage {
    let (sin, cos) = flown.track.sin_cos();
    MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
        target_system: system,
        target_component: AUTOPILOT,
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
        type_mask: PositionTargetTypemask::from_bits_retain(VELOCITY_AND_YAW),
        vx: (flown.speed_m_s * cos) as f32,
        vy: (flown.speed_m_s * sin) as f32,
        // Down is positive in LOCAL_NED.
        vz: -climb_m_s as f32,
        yaw: flown.nose as f32,
        ..SET_POSITION_TARGET_LOCAL_NED_DATA::default()
    })
}

/// How long level set points continue without data of the vehicle: a bad link alone is no reason to return.
const LONGEST_BLIND: Duration = Duration::from_secs(10);
/// The vehicle may still receive a given-up command within this time.
const ON_ITS_WAY: Duration = Duration::from_secs(2);
/// Period of the set points: PX4 needs 2 a second.
const PERIOD: Duration = Duration::from_millis(50);
/// Ignore position, acceleration and yaw rate.
const VELOCITY_AND_YAW: u16 = 0x9c7;
const AUTOPILOT: u8 = 1;
/// Default climb and sink rates to an altitude: within PX4's own defaults.
pub(super) const CLIMB_M_S: f64 = 1.5;
/// Rate of approach to an altitude, 1/s.
const APPROACH_PER_S: f64 = 0.7;
/// Below this speed a track is meaningless.
const SLOWEST_M_S: f64 = 0.5;

#[cfg(test)]
mod tests {
    use mapping::telemetry::Place;

    use super::*;

    #[test]
    fn a_vertical_speed_ends_at_homes_height_unless_below_is_allowed() {
        let at = |amsl_m| Place {
            latitude: 47.0,
            longitude: 8.0,
            amsl_m,
        };
        let sinks_m_s = |height_m: f64, below_home| {
            let vehicle = Telemetry {
                home: Some(at(488.0)),
                position: Some(at(488.0 + height_m)),
                ..Telemetry::default()
            };
            let limits = Limits {
                below_home,
                ..Limits::default()
            };
            -climb(Vertical::Rate(-3.0), &vehicle, &limits)
        };
        assert_eq!(sinks_m_s(20.0, false), 3.0);
        assert!((0.0..1.0).contains(&sinks_m_s(1.0, false)));
        assert_eq!(sinks_m_s(-2.0, false), 0.0);
        assert_eq!(sinks_m_s(-2.0, true), 3.0);
    }
}
