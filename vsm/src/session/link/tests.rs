//! The machine without the others: frames of an unsigned vehicle go in, events come out.

use mavlink_link::dialect::{ATTITUDE_DATA, HEARTBEAT_DATA, MavMessage};
use mavlink_link::frame::{Header, MAX_FRAME, encode};
use mavlink_link::link::{Endpoint, LinkConfig, Security};

use super::state::SILENCE;
use super::*;
use crate::session::testing::World;

const VEHICLE: u8 = 1;

/// A link on which nothing has been received.
fn start() -> (World, VehicleLink) {
    let mut world = World::new();
    world.vehicle = VehicleState::default();
    let config = LinkConfig::new(VEHICLE, Security::Off, Endpoint::Listen);
    (world, VehicleLink::new(Link::new(config), None))
}

/// The vehicle with this system id sends a message. Returns the events that follow, but those about the link itself.
fn receive(
    world: &mut World,
    link: &mut VehicleLink,
    system_id: u8,
    message: &MavMessage,
) -> Vec<VehicleEvent> {
    let header = Header {
        seq: 0,
        system_id,
        component_id: AUTOPILOT,
        message_id: 0,
        incompat: 0,
        compat: 0,
    };
    let mut bytes = [0; MAX_FRAME];
    let length = encode(message, header, &mut bytes);
    let mut state = std::mem::take(&mut world.vehicle);
    world.act(|_, _, effects| {
        let bytes = &bytes[..length];
        link.handle_datagram(Peer::Serial, bytes, &mut state, effects, &mut |_| {});
    });
    world.vehicle = state;
    events(link)
}

fn wait(world: &mut World, link: &mut VehicleLink, span: Duration) -> Vec<VehicleEvent> {
    world.advance(span);
    let mut state = std::mem::take(&mut world.vehicle);
    world.act(|_, _, effects| link.handle_timeout(&mut state, effects));
    world.vehicle = state;
    events(link)
}

fn events(link: &mut VehicleLink) -> Vec<VehicleEvent> {
    let events = std::iter::from_fn(|| link.poll_event());
    events
        .filter(|event| !matches!(event, VehicleEvent::Link(_)))
        .collect()
}

fn heartbeat(custom_mode: u32) -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode,
        ..HEARTBEAT_DATA::default()
    })
}

fn attitude(time_boot_ms: u32) -> MavMessage {
    MavMessage::ATTITUDE(ATTITUDE_DATA {
        time_boot_ms,
        ..ATTITUDE_DATA::default()
    })
}

#[test]
fn a_vehicle_is_live_from_its_heartbeat_until_it_is_silent() {
    use VehicleEvent::{LinkUp, ModeChanged, Silent};
    let (mut world, mut link) = start();
    let first = receive(&mut world, &mut link, VEHICLE, &heartbeat(1));
    assert_eq!(first, [LinkUp, ModeChanged]);
    assert!(world.vehicle.live());
    let next = receive(&mut world, &mut link, VEHICLE, &heartbeat(1));
    assert_eq!(next, []);
    let millisecond = Duration::from_millis(1);
    assert_eq!(wait(&mut world, &mut link, SILENCE - millisecond), []);
    assert_eq!(wait(&mut world, &mut link, millisecond), [Silent]);
    assert!(!world.vehicle.live());
    assert_eq!(wait(&mut world, &mut link, SILENCE), [], "reported once");
    let again = receive(&mut world, &mut link, VEHICLE, &heartbeat(1));
    assert_eq!(again, [LinkUp]);
}

#[test]
fn another_system_is_not_believed() {
    let (mut world, mut link) = start();
    let events = receive(&mut world, &mut link, VEHICLE + 1, &heartbeat(1));
    assert_eq!(events, []);
    assert!(!world.vehicle.live() && world.vehicle.telemetry.mode.is_none());
}

#[test]
fn a_clock_since_boot_that_goes_back_is_a_restart_unless_frames_overtook_each_other() {
    let (mut world, mut link) = start();
    receive(&mut world, &mut link, VEHICLE, &heartbeat(1));
    for (boot_ms, expected) in [
        (60_000, &[][..]),
        (59_500, &[]),
        (60_100, &[]),
        (2_000, &[VehicleEvent::Restarted]),
        (2_100, &[]),
    ] {
        let events = receive(&mut world, &mut link, VEHICLE, &attitude(boot_ms));
        assert_eq!(events, expected, "{boot_ms} ms");
    }
}
