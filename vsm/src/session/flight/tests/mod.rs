//! The machine without the others: commands go in, the vehicle's side is played by the test.
//!
//! In reading order: `maneuvers` (commands), `sticks` and `steering` (streams), `stops` (of the bridge), `loss` (of the controlling
//! CUCS), `landings` (of a wing), `taken` (from a station that repeats its command).

mod landings;
mod loss;
mod maneuvers;
mod steering;
mod sticks;
mod stops;
mod taken;

use mapping::route::CompiledMission;
use mapping::telemetry::{LandedState, MissionProgress};
use mavlink_link::dialect::{MavCmd, MavMessage, MavResult, MavState, MavType, MissionState};
use stanag_msgs::TimeStamp;
use stanag_msgs::enums::{AckType, HeadingCommandType, RouteType};
use stanag_msgs::messages::{EngineCommand, UaStickCommand};
use stanag_msgs::scalar::{Bam16, Scaled};

use super::sticks::SEEN_WITHIN;
use super::*;
use crate::config::OnLoss;
use crate::session::mission::record::UploadedMission;
use crate::session::testing::{World, acknowledgements, origin};

const ACCEPTED: MavResult = MavResult::MAV_RESULT_ACCEPTED;
const DENIED: MavResult = MavResult::MAV_RESULT_DENIED;
/// What the vehicle says with its answer.
const REASON: &str = "Switching to this mode is currently not available";

pub(super) fn handle(world: &mut World, flight: &mut Flight, input: Input<'_>) {
    world.act(|common, views, effects| {
        let context = Context {
            common,
            mission: views.mission,
            parameters: views.parameters,
        };
        flight.handle(&context, input, effects);
    });
}

/// A message of station 0, and what the machine does at once.
fn command(world: &mut World, flight: &mut Flight, message: impl Into<Message>) -> Vec<AckType> {
    let message = message.into();
    let input = Input::Command {
        origin: origin(&message),
        message: &message,
    };
    handle(world, flight, input);
    handle(world, flight, Input::Advance);
    acknowledgements(&world.sent_to(0))
}

/// The vehicle answers a change of mode.
fn answer_mode(world: &mut World, flight: &mut Flight, result: MavResult) -> Vec<AckType> {
    if result != ACCEPTED {
        world.vehicle.complain(world.now.mono, REASON);
    }
    for event in world.answer(MavCmd::MAV_CMD_DO_SET_MODE, result) {
        handle(world, flight, Input::CommandEnded(&event));
    }
    handle(world, flight, Input::Advance);
    acknowledgements(&world.sent_to(0))
}

fn steers(world: &World, flight: &Flight) -> bool {
    flight.steers(&world.vehicle.telemetry)
}

fn sticks() -> UaStickCommand {
    UaStickCommand {
        time_stamp: Some(TimeStamp(1)),
        longitudinal_stick: Some(50),
        ..UaStickCommand::default()
    }
}

fn turn_to(heading: f64) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        heading_command_type: Some(HeadingCommandType::Heading),
        commanded_heading: Some(Bam16::from_radians(heading)),
        ..select(Mode::Autopilot)
    }
}

/// On hold by mode 12.
fn held() -> (World, Flight) {
    let (mut world, mut flight) = (World::airborne(Px4Mode::MISSION), Flight::default());
    enters(&mut world, &mut flight, Mode::Loiter, Px4Mode::LOITER);
    (world, flight)
}

/// A mode is commanded, and carried out.
fn enters(world: &mut World, flight: &mut Flight, commanded: Mode, mode: Px4Mode) {
    let answers = command(world, flight, select(commanded));
    assert_eq!(answers, [AckType::Received]);
    assert_eq!(world.commanded_modes(), [mode]);
    world.show_mode(mode);
    let answers = answer_mode(world, flight, ACCEPTED);
    assert_eq!(answers, [AckType::CarriedOut]);
}

/// Steered by set points, in the mode for that.
fn steered() -> (World, Flight) {
    let (mut world, mut flight) = (World::airborne(Px4Mode::LOITER), Flight::default());
    let answers = command(&mut world, &mut flight, turn_to(0.0));
    assert_eq!(answers, [AckType::Received]);
    assert_eq!(world.posts().len(), 1, "a set point before the mode");
    assert_eq!(world.commanded_modes(), [Px4Mode::OFFBOARD]);
    world.show_mode(Px4Mode::OFFBOARD);
    let answers = answer_mode(&mut world, &mut flight, ACCEPTED);
    assert_eq!(answers, [AckType::CarriedOut]);
    (world, flight)
}

/// The controller is lost, and the vehicle is to return.
pub(super) fn lose(world: &mut World, flight: &mut Flight) {
    world.settings.authority.on_loss = OnLoss::Rtl;
    world.controller = None;
    handle(world, flight, Input::ControllerLost);
}

/// What is commanded in so many seconds.
pub(super) fn watch(world: &mut World, flight: &mut Flight, seconds: u64) -> Vec<Px4Mode> {
    for _ in 0..seconds {
        world.advance(Duration::from_secs(1));
        handle(world, flight, Input::WatchLossAction);
        handle(world, flight, Input::Advance);
    }
    world.commanded_modes()
}

/// How many alerts with this in their first part station 0 was sent.
fn alerts_of(world: &mut World, what: &str) -> usize {
    let says_so = |message: &&Message| match message {
        Message::SubsystemStatusAlert(alert) => {
            let text = alert.text.as_ref().map(|text| text.as_str());
            text.is_some_and(|text| text.contains(what))
        }
        _ => false,
    };
    world.sent_to(0).iter().filter(says_so).count()
}
