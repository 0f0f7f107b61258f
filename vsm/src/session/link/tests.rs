//! The machine without the others: frames of an unsigned vehicle go in, events come out; and which key it signs with while
//! another waits.

use mavlink_link::clock::Origin;
use mavlink_link::dialect::{
    ATTITUDE_DATA, EXTENDED_SYS_STATE_DATA, HEARTBEAT_DATA, MavLandedState, MavMessage,
    MavVtolState, STATUSTEXT_DATA,
};
use mavlink_link::frame::{FrameView, Header, INCOMPAT_SIGNED, MAX_FRAME, encode};
use mavlink_link::link::{LinkConfig, Security};
use mavlink_link::signing::{sign, verify};

use super::state::SILENCE;
use super::*;
use crate::session::findings::vehicle::judge;
use crate::session::testing::World;

const VEHICLE: u8 = 1;

/// A link on which nothing has been received.
fn start() -> (World, VehicleLink) {
    let mut world = World::new();
    world.vehicle = VehicleState::default();
    let config = LinkConfig::new(VEHICLE, Security::Off, Endpoint::Listen);
    (world, VehicleLink::new(Link::new(config), None, None))
}

/// The vehicle with this system id sends a message. Returns the events that follow, but those about the link itself.
fn receive(
    world: &mut World,
    link: &mut VehicleLink,
    system_id: u8,
    message: &MavMessage,
) -> Vec<VehicleEvent> {
    send(world, link, system_id, message);
    events(link)
}

fn send(world: &mut World, link: &mut VehicleLink, system_id: u8, message: &MavMessage) {
    send_from(world, link, Node::new(system_id, AUTOPILOT), message);
}

fn send_from(world: &mut World, link: &mut VehicleLink, from: Node, message: &MavMessage) {
    let header = Header {
        seq: 0,
        system_id: from.system,
        component_id: from.component,
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

/// Commands are refused until the vehicle's HEARTBEAT, which may be a second later than its first frame.
#[test]
fn a_link_is_reported_as_live_once_commands_are_accepted() {
    let (mut world, mut link) = start();
    let mut reported = |message: &MavMessage| {
        send(&mut world, &mut link, VEHICLE, message);
        let events = std::iter::from_fn(|| link.poll_event());
        let lives = events.filter(|event| matches!(event, VehicleEvent::Link(Event::Live)));
        (lives.count(), world.vehicle.live())
    };
    assert_eq!(reported(&attitude(1_000)), (0, false));
    assert_eq!(reported(&attitude(1_200)), (0, false));
    assert_eq!(reported(&heartbeat(1)), (1, true));
    assert_eq!(reported(&heartbeat(1)), (0, true));
}

#[test]
fn a_change_of_the_state_in_one_mode_is_an_event_and_one_that_is_repeated_is_not() {
    use MavVtolState as V;
    let (mut world, mut link) = start();
    let shows = |vtol_state| {
        MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA {
            landed_state: MavLandedState::MAV_LANDED_STATE_IN_AIR,
            vtol_state,
        })
    };
    // Nothing is reported of a vehicle that is not live.
    let silent = receive(&mut world, &mut link, VEHICLE, &shows(V::MAV_VTOL_STATE_MC));
    assert_eq!(silent, []);
    receive(&mut world, &mut link, VEHICLE, &heartbeat(1));
    for (vtol_state, expected) in [
        (V::MAV_VTOL_STATE_MC, &[][..]),
        (
            V::MAV_VTOL_STATE_TRANSITION_TO_FW,
            &[VehicleEvent::StateChanged],
        ),
        (V::MAV_VTOL_STATE_TRANSITION_TO_FW, &[]),
        (V::MAV_VTOL_STATE_FW, &[VehicleEvent::StateChanged]),
    ] {
        let events = receive(&mut world, &mut link, VEHICLE, &shows(vtol_state));
        assert_eq!(events, expected, "{vtol_state:?}");
    }
}

#[test]
fn an_unsigned_link_is_silent_once_nothing_is_accepted_and_live_from_the_next_frame() {
    let (mut world, mut link) = start();
    let state = |world: &World, link: &VehicleLink| {
        let mono = world.now.mono;
        (link.link_state_name(mono), link.live_for(mono))
    };
    assert_eq!(state(&world, &link), ("waiting", None));
    for _ in 0..30 {
        receive(&mut world, &mut link, VEHICLE, &heartbeat(1));
    }
    assert_eq!(state(&world, &link), ("live", Some(Duration::ZERO)));
    wait(&mut world, &mut link, FRESH);
    assert_eq!(state(&world, &link), ("live", Some(FRESH)));
    assert_eq!(link.lost(world.now.mono), Some(0.0));
    wait(&mut world, &mut link, Duration::from_secs(8));
    assert_eq!(state(&world, &link), ("silent", None));
    let silent = FRESH + Duration::from_secs(8);
    assert_eq!(link.accepted_for(world.now.mono), Some(silent));
    assert_eq!(link.lost(world.now.mono), None);
    receive(&mut world, &mut link, VEHICLE, &heartbeat(1));
    assert_eq!(state(&world, &link), ("live", Some(Duration::ZERO)));
}

#[test]
fn a_link_whose_stale_frames_no_longer_arrive_is_silent_and_not_behind() {
    let mut world = World::new();
    let build = world.now.wall - Duration::from_secs(30 * 86_400);
    let mut link = start_signed(&mut world, build);
    for stamp in 1..=3 {
        let stale = signed_heartbeat(&key(1), Stamp::new(stamp));
        deliver(&mut world, &mut link, &stale);
    }
    wait(&mut world, &mut link, Duration::from_millis(1));
    assert_eq!(link.link_state_name(world.now.mono), "behind");
    wait(&mut world, &mut link, FRESH + Duration::from_millis(1));
    assert_eq!(link.link_state_name(world.now.mono), "silent");
}

#[test]
fn another_system_is_not_believed() {
    let (mut world, mut link) = start();
    let events = receive(&mut world, &mut link, VEHICLE + 1, &heartbeat(1));
    assert_eq!(events, []);
    assert!(!world.vehicle.live() && world.vehicle.telemetry.mode.is_none());
}

#[test]
fn only_a_warning_of_the_autopilot_is_a_reason_of_a_refusal() {
    let (mut world, mut link) = start();
    let reason = |world: &World| {
        let now = world.now.mono;
        world.vehicle.complaint(now, now).unwrap_or_default()
    };
    let mut warn = |world: &mut World, from: Node, severity, text: &str| {
        let text = MavMessage::STATUSTEXT(STATUSTEXT_DATA {
            severity,
            text: text.into(),
            ..STATUSTEXT_DATA::default()
        });
        send_from(world, &mut link, from, &text);
    };
    let (critical, info) = (
        MavSeverity::MAV_SEVERITY_CRITICAL,
        MavSeverity::MAV_SEVERITY_INFO,
    );
    let autopilot = Node::new(VEHICLE, AUTOPILOT);
    warn(&mut world, Node::new(VEHICLE, 100), critical, "card full");
    warn(&mut world, Node::new(VEHICLE + 1, AUTOPILOT), critical, "x");
    warn(&mut world, autopilot, info, "Executing Mission");
    assert_eq!(reason(&world), "");
    warn(&mut world, autopilot, critical, "No valid mission");
    assert_eq!(reason(&world), " (No valid mission)");
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

/// A link that signs, with a vehicle at the other end of a serial line; and a key that waits to follow.
fn start_signed(world: &mut World, not_before: Duration) -> VehicleLink {
    let config = LinkConfig::new(VEHICLE, Security::Signed, Endpoint::Fixed(Peer::Serial));
    let now = world.now;
    let state = world.act(|_, _, effects| {
        let not_before = Stamp::from_unix(not_before);
        KeyState::start(
            key(1),
            Origin::KeyFile,
            not_before,
            now,
            &mut *effects.dli.disk,
        )
    });
    let mut link = VehicleLink::new(Link::new(config), Some(state.unwrap()), None);
    world.act(|_, _, effects| {
        let disk = &mut *effects.dli.disk;
        link.offer_next_key(key(2), now, not_before, disk).unwrap();
    });
    link
}

fn key(byte: u8) -> SigningKey {
    SigningKey::new([byte; 32]).unwrap()
}

/// How many of the frames that wait are signed with the key, and the stamp of the last.
fn sent_under(link: &mut VehicleLink, key: &SigningKey) -> (usize, Option<Stamp>) {
    let frames: Vec<OutFrame> = std::iter::from_fn(|| link.poll_transmit()).collect();
    let stamps = frames.iter().filter_map(|frame| {
        let frame = FrameView::parse(frame.bytes()).ok()?;
        verify(key, &frame).ok()?;
        Some(frame.signature()?.stamp)
    });
    let stamps: Vec<Stamp> = stamps.collect();
    (stamps.len(), stamps.last().copied())
}

/// A heartbeat of the vehicle, signed.
fn signed_heartbeat(key: &SigningKey, stamp: Stamp) -> Vec<u8> {
    let header = Header {
        system_id: VEHICLE,
        component_id: AUTOPILOT,
        incompat: INCOMPAT_SIGNED,
        ..Header::default()
    };
    let mut bytes = [0; MAX_FRAME];
    let length = encode(&heartbeat(1), header, &mut bytes);
    let length = sign(key, 0, stamp, &mut bytes, length).unwrap();
    bytes[..length].to_vec()
}

fn deliver(world: &mut World, link: &mut VehicleLink, bytes: &[u8]) {
    let mut state = std::mem::take(&mut world.vehicle);
    world.act(|_, _, effects| {
        link.handle_datagram(Peer::Serial, bytes, &mut state, effects, &mut |_| {});
    });
    world.vehicle = state;
}

/// The vehicle has sent unsigned until it had its key, and nothing was wrong with its link when the process was stopped.
#[test]
fn a_stop_of_the_bridge_is_held_against_nobody() {
    let mut world = World::new();
    let build = world.now.wall - Duration::from_secs(30 * 86_400);
    let mut link = start_signed(&mut world, build);
    let stamp = link.key().unwrap().clock().reading(world.now);
    wait(&mut world, &mut link, Duration::ZERO);
    let signed = signed_heartbeat(&key(1), stamp.plus(Duration::from_secs(1)));
    deliver(&mut world, &mut link, &signed);
    let second = Duration::from_secs(1);
    wait(&mut world, &mut link, 2 * second);
    receive(&mut world, &mut link, VEHICLE, &heartbeat(1));
    wait(&mut world, &mut link, Duration::ZERO);
    assert_eq!(link.stats().unsigned_vehicle, 1);
    for stopped in [Duration::from_millis(3_500), 20 * second] {
        let from = world.now.mono;
        world.advance(stopped);
        let mono = world.now.mono;
        link.note_stop(&mut world.vehicle, from, mono);
        let found = judge(&link.evidence(mono, &world.config, (None, false)));
        assert_eq!(found, None);
        assert_eq!(link.link_state_name(mono), "live");
        assert_eq!(link.arrives(mono), Some("verified"));
    }
    // A silence before a stop is none that ends with it.
    let silent = FRESH + second;
    wait(&mut world, &mut link, silent);
    assert_eq!(link.link_state_name(world.now.mono), "silent");
    let from = world.now.mono;
    world.advance(20 * second);
    link.note_stop(&mut world.vehicle, from, world.now.mono);
    assert_eq!(link.link_state_name(world.now.mono), "silent");
}

/// The first of the heartbeats that waited shows the mode of before, which a failsafe may have ended since.
#[test]
fn what_waited_during_a_stop_of_the_bridge_shows_no_mode_of_now() {
    let (mut world, mut link) = start();
    receive(&mut world, &mut link, VEHICLE, &heartbeat(1));
    let mode = world.vehicle.settled_mode();
    assert!(mode.is_some());
    let from = world.now.mono;
    world.advance(Duration::from_secs(3));
    let until = world.now.mono;
    link.note_stop(&mut world.vehicle, from, until);
    receive(&mut world, &mut link, VEHICLE, &heartbeat(1));
    assert_eq!(world.vehicle.settled_mode(), None);
    assert!(world.vehicle.awaits_mode());
    world.advance(measured::CATCHES_UP + Duration::from_millis(1));
    assert_eq!(world.vehicle.settled_mode(), None);
    receive(&mut world, &mut link, VEHICLE, &heartbeat(1));
    assert_eq!(world.vehicle.settled_mode(), mode);
    assert!(!world.vehicle.awaits_mode());
}

#[test]
fn heartbeats_go_out_under_the_next_key_too_while_nothing_answers_under_the_one_in_force() {
    let mut world = World::new();
    let build = world.now.wall - Duration::from_secs(30 * 86_400);
    let mut link = start_signed(&mut world, build);
    let second = Duration::from_secs(1);
    for _ in 0..10 {
        wait(&mut world, &mut link, second);
        let mut under = [0; 2];
        let mut newest = None;
        let frames: Vec<OutFrame> = std::iter::from_fn(|| link.poll_transmit()).collect();
        for frame in &frames {
            let frame = FrameView::parse(frame.bytes()).unwrap();
            let which = usize::from(verify(&key(1), &frame).is_err());
            under[which] += 1;
            newest = newest.max(frame.signature().map(|signature| signature.stamp));
        }
        let [in_force, next] = under;
        assert!(
            in_force > 0 && next == 0,
            "it answers under the key in force"
        );
        let answer = signed_heartbeat(&key(1), newest.unwrap().next().unwrap());
        deliver(&mut world, &mut link, &answer);
    }
    assert_eq!(link.link_state_name(world.now.mono), "live");
    sent_under(&mut link, &key(2));
    // From here on it has the next key, and nothing of it has come through yet.
    let mut under_next = 0;
    let mut last = None;
    for _ in 0..12 {
        wait(&mut world, &mut link, second);
        let (count, stamp) = sent_under(&mut link, &key(2));
        under_next += count;
        last = stamp.or(last);
    }
    assert!((5..=8).contains(&under_next), "{under_next}");
    assert_eq!(link.link_state_name(world.now.mono), "silent");
    // Its answer is the proof.
    let answer = signed_heartbeat(&key(2), last.unwrap().next().unwrap());
    deliver(&mut world, &mut link, &answer);
    assert_eq!(link.key().map(KeyState::id), Some(key(2).id()));
}

#[test]
fn the_next_key_runs_by_the_clock_of_the_one_in_force_however_old_the_build_is() {
    let mut world = World::new();
    let build = world.now.wall - Duration::from_secs(3 * 366 * 86_400);
    let mut link = start_signed(&mut world, build);
    let stamp = link.key().unwrap().clock().reading(world.now);
    let proof = signed_heartbeat(&key(2), stamp.plus(Duration::from_secs(2)));
    deliver(&mut world, &mut link, &proof);
    assert_eq!(link.key().map(KeyState::id), Some(key(2).id()));
}

#[test]
fn a_command_for_the_payload_makes_no_mode_unseen_and_its_answer_finds_it() {
    use mavlink_link::dialect::{COMMAND_ACK_DATA, MavCmd};
    use mavlink_link::service::command::{Command, Event, Payload, Repetition};
    let (mut world, mut link) = start();
    receive(&mut world, &mut link, VEHICLE, &heartbeat(0));
    let command = MavCmd::MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE;
    let configure = Command {
        command,
        payload: Payload::Long([0.0; 7]),
        repetition: Repetition::Safe,
    };
    let to_manager = world.services.commands_to(AUTOPILOT);
    let ticket = to_manager.submit(world.now.mono, configure).unwrap();
    wait(&mut world, &mut link, Duration::ZERO);
    assert!(world.vehicle.state_is_newer_than_command());
    let ack = MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
        command,
        target_system: 245,
        target_component: 190,
        ..COMMAND_ACK_DATA::default()
    });
    let events = receive(&mut world, &mut link, VEHICLE, &ack);
    let answers = |event: &VehicleEvent| matches!(event, VehicleEvent::ComponentCommand(AUTOPILOT, Event::Done { ticket: of, .. }) if *of == ticket);
    assert!(events.iter().any(answers), "{events:?}");
}
