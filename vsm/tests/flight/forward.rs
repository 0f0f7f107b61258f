//! Another ground station beside the bridge (`[[forward]]`): it receives what is verified, under its own key, and commands
//! what the configuration lets it, signed, once, and not while a CUCS controls the vehicle.

use std::net::SocketAddr;
use std::time::Duration;

use kit::bridge::{FORWARD_KEYS, Rig, Setup, key, orders};
use mavlink_link::dialect::{
    HEARTBEAT_DATA, MavCmd, MavMessage, MavResult, PARAM_REQUEST_LIST_DATA, PARAM_SET_DATA,
    TERRAIN_DATA_DATA, TIMESYNC_DATA,
};
use mavlink_link::frame::{FrameView, Header, INCOMPAT_SIGNED, MAX_FRAME, encode};
use mavlink_link::service::{Node, command};
use mavlink_link::signing::{SigningKey, Stamp, sign, verify};
use vsm::session::{ForwardStatus, Peer};

fn at(port: u16) -> Peer {
    Peer::Udp(SocketAddr::from(([127, 0, 0, 1], port)))
}

/// A frame of ground station 255, signed with a key where there is one.
fn frame(rig: &Rig, key: Option<&SigningKey>, message: &MavMessage) -> Vec<u8> {
    stamped(rig.now().wall, key, message)
}

fn stamped(wall: Duration, key: Option<&SigningKey>, message: &MavMessage) -> Vec<u8> {
    let incompat = if key.is_some() { INCOMPAT_SIGNED } else { 0 };
    let header = Header {
        system_id: 255,
        component_id: 190,
        incompat,
        ..Header::default()
    };
    let mut bytes = [0; MAX_FRAME];
    let mut length = encode(message, header, &mut bytes);
    if let Some(key) = key {
        let stamp = Stamp::from_unix(wall);
        length = sign(key, 0, stamp, &mut bytes, length).expect("signed");
    }
    bytes[..length].to_vec()
}

fn deliver(rig: &mut Rig, index: usize, from: Peer, bytes: &[u8]) {
    let now = rig.now();
    let bridge = rig.bridge.as_mut().expect("it runs");
    bridge.handle_forward(now, index, from, bytes, &mut rig.store);
}

/// Sends a message of the ground station with this index of `[[forward]]`, signed with its own key.
fn send(rig: &mut Rig, index: usize, message: &MavMessage) -> Vec<u8> {
    // Each stamp is newer than the last.
    rig.run(0.1);
    let bytes = frame(rig, Some(&key(FORWARD_KEYS + index)), message);
    deliver(rig, index, at(50_000), &bytes);
    bytes
}

fn heartbeat() -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA::default())
}

fn command(command: MavCmd, target_system: u8, param1: f32) -> MavMessage {
    command::long(Node::new(target_system, 1), command, [param1])
}

fn arm() -> MavMessage {
    command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 1, 1.0)
}

fn status(rig: &Rig, index: usize) -> ForwardStatus {
    let bridge = rig.bridge.as_ref().expect("it runs");
    let status = bridge.status(String::new(), rig.now().mono);
    status
        .forwards
        .into_iter()
        .nth(index)
        .expect("it is served")
}

fn accepted(rig: &Rig) -> u64 {
    rig.vehicles[0].vehicle().counters().commands_accepted
}

/// Results of the COMMAND_ACKs to the ground station since.
fn results(rig: &Rig, since: usize) -> Vec<(MavCmd, MavResult)> {
    let acks = rig.forwarded[since..].iter().filter_map(|(_, sent)| {
        match FrameView::parse(sent.bytes()).ok()?.message().ok()? {
            MavMessage::COMMAND_ACK(ack) if ack.target_system == 255 => {
                Some((ack.command, ack.result))
            }
            _ => None,
        }
    });
    acks.collect()
}

fn rig(tables: &'static str) -> Rig {
    let mut rig = Rig::new(Setup {
        tables,
        ..Setup::default()
    });
    rig.run(9.0);
    rig
}

const LISTENER: &str = "[[forward]]\nname = \"qgc\"\nlink = \"udpin:127.0.0.1:14560\"\n";
const COMMANDER: &str = "[[forward]]\nname = \"qgc\"\nlink = \"udpin:0.0.0.0:14560\"\nkey_file = \"q.key\"\ncommands = true\n";

#[test]
fn without_a_key_it_receives_while_it_is_there_and_commands_nothing() {
    let mut rig = rig(LISTENER);
    assert!(rig.forwarded.is_empty(), "nobody has called yet");
    let beat = frame(&rig, None, &heartbeat());
    deliver(&mut rig, 0, at(50_000), &beat);
    rig.run(5.0);
    let messages: std::collections::BTreeSet<u32> = rig
        .forwarded
        .iter()
        .map(|(_, sent)| {
            assert_eq!(sent.to, at(50_000));
            let frame = FrameView::parse(sent.bytes()).expect("a good checksum");
            assert!(!frame.is_signed());
            assert!([1, 245].contains(&frame.header().system_id));
            frame.header().message_id
        })
        .collect();
    // Of the vehicle: state, position, attitude.
    assert!(
        [0, 30, 33].iter().all(|id| messages.contains(id)),
        "{messages:?}"
    );
    let (before, arming) = (accepted(&rig), frame(&rig, None, &arm()));
    deliver(&mut rig, 0, at(50_000), &arming);
    rig.run(1.0);
    assert_eq!(accepted(&rig), before);
    assert_eq!(
        status(&rig, 0)
            .refused
            .get("this ground station may not command"),
        1
    );

    rig.run(12.0);
    let count = rig.forwarded.len();
    rig.run(3.0);
    let of_vehicle = |sent: &[(usize, vsm::session::OutFrame)]| {
        let frames = sent
            .iter()
            .filter_map(|(_, sent)| FrameView::parse(sent.bytes()).ok());
        frames.filter(|frame| frame.header().system_id == 1).count()
    };
    assert_eq!(
        of_vehicle(&rig.forwarded[count..]),
        0,
        "nobody is there any more"
    );
}

#[test]
fn what_it_is_sent_is_signed_with_its_key_and_goes_to_who_has_it_only() {
    let mut rig = rig(COMMANDER);
    for bytes in [
        frame(&rig, None, &heartbeat()),
        frame(&rig, Some(&key(0)), &heartbeat()),
    ] {
        deliver(&mut rig, 0, at(6_666), &bytes);
    }
    rig.run(2.0);
    assert!(rig.forwarded.is_empty(), "a stranger is sent something");
    assert_eq!(
        status(&rig, 0)
            .refused
            .get("signature does not fit the key"),
        1
    );
    assert_eq!(status(&rig, 0).refused.get("not signed"), 1);
    send(&mut rig, 0, &heartbeat());
    rig.run(2.0);
    assert!(rig.forwarded.len() > 50);
    for (_, sent) in &rig.forwarded {
        assert_eq!(sent.to, at(50_000));
        let frame = FrameView::parse(sent.bytes()).expect("a frame");
        assert!(verify(&key(FORWARD_KEYS), &frame).is_ok());
        assert!(verify(&key(0), &frame).is_err());
    }
    assert!(
        rig.log
            .iter()
            .any(|line| line.text == "ground station qgc is at 127.0.0.1:50000")
    );
}

#[test]
fn it_commands_once_and_a_recording_of_it_never() {
    let mut rig = rig(COMMANDER);
    send(&mut rig, 0, &heartbeat());
    let (before, since) = (accepted(&rig), rig.forwarded.len());
    let recorded = send(&mut rig, 0, &arm());
    rig.run(0.5);
    assert_eq!(
        results(&rig, since),
        [(
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
            MavResult::MAV_RESULT_ACCEPTED
        )]
    );
    assert!(rig.vehicles[0].vehicle().truth().armed);
    assert_eq!(status(&rig, 0).taken, 1);
    // The vehicle answers it, and nobody is alarmed by what the configuration allows.
    assert!(
        rig.log
            .iter()
            .all(|line| !line.text.contains("commands the vehicle too")),
        "{:?}",
        rig.log
    );
    let once = accepted(&rig);
    assert!(once > before);

    deliver(&mut rig, 0, at(50_000), &recorded);
    rig.restart_bridge();
    rig.run(3.0);
    let steady = accepted(&rig);
    deliver(&mut rig, 0, at(50_000), &recorded);
    rig.run(0.5);
    assert_eq!(accepted(&rig), steady);
    assert_eq!(status(&rig, 0).refused.get("stale timestamp"), 1);
    assert_eq!(status(&rig, 0).taken, 0);
}

#[test]
fn while_a_cucs_controls_it_can_only_ask() {
    for (tables, moves) in [
        (COMMANDER, false),
        (
            "[[forward]]\nname = \"qgc\"\nlink = \"udpin:127.0.0.1:14560\"\nkey_file = \"q.key\"\ncommands = true\nwhile_controlled = true\n",
            true,
        ),
    ] {
        let mut rig = Rig::ready_with(Setup {
            tables,
            ..Setup::default()
        });
        send(&mut rig, 0, &heartbeat());
        let since = rig.forwarded.len();
        send(
            &mut rig,
            0,
            &command(MavCmd::MAV_CMD_REQUEST_MESSAGE, 1, 242.0),
        );
        rig.run(0.5);
        assert_eq!(
            results(&rig, since),
            [(
                MavCmd::MAV_CMD_REQUEST_MESSAGE,
                MavResult::MAV_RESULT_ACCEPTED
            )]
        );
        let since = rig.forwarded.len();
        send(&mut rig, 0, &arm());
        rig.run(0.5);
        let result = if moves {
            MavResult::MAV_RESULT_ACCEPTED
        } else {
            MavResult::MAV_RESULT_DENIED
        };
        assert_eq!(
            results(&rig, since),
            [(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, result)]
        );
        assert_eq!(rig.vehicles[0].vehicle().truth().armed, moves);
        let refused = status(&rig, 0).refused.get("a CUCS controls the vehicle");
        assert_eq!(refused, u64::from(!moves));
    }
}

/// Sends a message so many times at once.
fn send_at_once(rig: &mut Rig, message: &MavMessage, times: u32) {
    rig.run(0.1);
    let begun = rig.now().wall;
    for number in 0..times {
        // Each stamp is newer than the last.
        let wall = begun + number * Duration::from_micros(100);
        let bytes = stamped(wall, Some(&key(FORWARD_KEYS)), message);
        deliver(rig, 0, at(50_000), &bytes);
    }
    rig.run(0.1);
}

fn list() -> MavMessage {
    MavMessage::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA {
        target_system: 1,
        target_component: 1,
    })
}

#[test]
fn what_it_asks_has_a_rate_and_what_it_commands_has_none() {
    let mut rig = rig(COMMANDER);
    send(&mut rig, 0, &heartbeat());
    let since = rig.forwarded.len();
    let ask = command(MavCmd::MAV_CMD_REQUEST_MESSAGE, 1, 242.0);
    send_at_once(&mut rig, &ask, 300);
    let (taken, refused) = (status(&rig, 0).taken, status(&rig, 0).refused);
    assert!((200..=210).contains(&taken), "{taken}");
    let too_many = "too many questions at once";
    assert_eq!(refused.get(too_many), 300 - taken);
    let rejected = results(&rig, since);
    let rejected = rejected
        .iter()
        .filter(|(_, result)| *result == MavResult::MAV_RESULT_TEMPORARILY_REJECTED);
    assert_eq!(rejected.count() as u64, 300 - taken);
    send_at_once(&mut rig, &list(), 20);
    assert_eq!(status(&rig, 0).taken, taken + 4);
    send(&mut rig, 0, &arm());
    rig.run(0.5);
    assert!(rig.vehicles[0].vehicle().truth().armed);
    // Later it may ask again.
    let taken = status(&rig, 0).taken;
    rig.run(6.0);
    send(&mut rig, 0, &ask);
    send(&mut rig, 0, &list());
    assert_eq!(status(&rig, 0).taken, taken + 2);
}

#[test]
fn on_a_slow_link_what_it_asks_waits_for_room_and_what_it_commands_does_not() {
    let mut rig = Rig::new(Setup {
        tables: COMMANDER,
        vehicle_keys: "rate_bps = 57600\n",
        ..Setup::default()
    });
    rig.run(20.0);
    send(&mut rig, 0, &heartbeat());
    let no_room = |rig: &Rig| {
        let refused = status(rig, 0).refused;
        refused.get("no room on the vehicle's link (rate_bps)")
    };
    let ask = command(MavCmd::MAV_CMD_REQUEST_MESSAGE, 1, 242.0);
    send_at_once(&mut rig, &ask, 100);
    assert!(no_room(&rig) >= 98, "{}", no_room(&rig));
    rig.run(5.0);
    let before = no_room(&rig);
    send_at_once(&mut rig, &list(), 4);
    assert!(no_room(&rig) >= before + 3, "{}", no_room(&rig));
    send(&mut rig, 0, &arm());
    rig.run(0.5);
    assert!(rig.vehicles[0].vehicle().truth().armed);
}

/// The bridge sends these, and an agent passes them: that is no reason to take them of others.
#[test]
fn what_only_the_bridge_needs_is_not_on_the_list_of_a_ground_station() {
    let mut rig = rig(COMMANDER);
    send(&mut rig, 0, &heartbeat());
    let clock = TIMESYNC_DATA::default();
    send(&mut rig, 0, &MavMessage::TIMESYNC(clock));
    let ground = TERRAIN_DATA_DATA::default();
    send(&mut rig, 0, &MavMessage::TERRAIN_DATA(ground));
    let zoom = command(MavCmd::MAV_CMD_SET_CAMERA_ZOOM, 1, 1.0);
    send(&mut rig, 0, &zoom);
    rig.run(0.5);
    let refused = status(&rig, 0).refused;
    assert_eq!(refused.get("message not allowed"), 2, "{refused:?}");
    assert_eq!(refused.get("command not allowed"), 1, "{refused:?}");
    assert_eq!(status(&rig, 0).taken, 0);
}

#[test]
fn what_is_not_on_the_list_is_refused_and_answered() {
    let mut rig = rig(COMMANDER);
    send(&mut rig, 0, &heartbeat());
    let since = rig.forwarded.len();
    send(
        &mut rig,
        0,
        &command(MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1, 1.0),
    );
    let mut name = [0; 16];
    name[..13].copy_from_slice(b"COM_DL_LOSS_T");
    let set = PARAM_SET_DATA {
        target_system: 1,
        target_component: 1,
        param_id: name.into(),
        ..PARAM_SET_DATA::default()
    };
    send(&mut rig, 0, &MavMessage::PARAM_SET(set));
    send(
        &mut rig,
        0,
        &command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 9, 1.0),
    );
    rig.run(0.5);
    assert_eq!(
        results(&rig, since),
        [(
            MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN,
            MavResult::MAV_RESULT_DENIED
        )]
    );
    let refused = status(&rig, 0).refused;
    for name in [
        "command not allowed",
        "parameter protected (relay.protected_parameters)",
        "no vehicle of this system id, or no link to it",
    ] {
        assert_eq!(refused.get(name), 1, "{name}: {refused:?}");
    }
    assert_eq!(status(&rig, 0).taken, 0);

    let short = "[[forward]]\nname = \"qgc\"\nlink = \"udpin:127.0.0.1:14560\"\nkey_file = \"q.key\"\ncommands = { commands = [512] }\n";
    let mut rig = self::rig(short);
    send(&mut rig, 0, &heartbeat());
    send(&mut rig, 0, &arm());
    rig.run(0.5);
    assert_eq!(status(&rig, 0).refused.get("command not allowed"), 1);
    assert!(!rig.vehicles[0].vehicle().truth().armed);
}

#[test]
fn each_has_its_own_vehicles() {
    let mut rig = Rig::new(Setup {
        vehicles: vec![px4_sim::Config::default(); 2],
        one_link: true,
        tables: "[[forward]]\nname = \"a\"\nlink = \"udpin:127.0.0.1:14560\"\nkey_file = \"a.key\"\ncommands = true\n\
                 vehicles = [\"1b:00:01:02\"]\n",
        ..Setup::default()
    });
    rig.run(9.0);
    send(&mut rig, 0, &heartbeat());
    send(&mut rig, 0, &arm());
    send(
        &mut rig,
        0,
        &command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, 2, 1.0),
    );
    rig.run(1.0);
    let armed = |index: usize| rig.vehicles[index].vehicle().truth().armed;
    assert_eq!((armed(0), armed(1)), (false, true));
    let systems = rig.forwarded.iter().map(|(_, sent)| sent.bytes()[5]);
    assert!(systems.clone().any(|system| system == 2));
    assert!(systems.clone().all(|system| system != 1));
}

#[test]
fn one_that_takes_nothing_costs_a_bounded_queue_and_no_more() {
    let mut rig = rig(COMMANDER);
    send(&mut rig, 0, &heartbeat());
    rig.forward_is_stuck = true;
    for _ in 0..6 {
        rig.run(5.0);
        send(&mut rig, 0, &heartbeat());
    }
    let refused = status(&rig, 0).refused.get("too much at once");
    assert!(refused > 100, "{refused}");
    rig.forwarded.clear();
    rig.forward_is_stuck = false;
    rig.run(0.01);
    assert!(
        (512..=520).contains(&rig.forwarded.len()),
        "{}",
        rig.forwarded.len()
    );
    let bridge = rig.bridge.as_ref().expect("it runs");
    assert!(bridge.status(String::new(), rig.now().mono).vehicles[0].live);
    rig.done(orders::request_control());
}

#[test]
fn a_reload_changes_what_it_may_and_what_was_proven_stays() {
    let mut rig = rig(COMMANDER);
    send(&mut rig, 0, &heartbeat());
    let text = rig.text.clone();
    let listens = text.replace("commands = true", "commands = false");
    let report = rig.reload(&listens).expect("it is good");
    assert_eq!(report.applied, ["forward qgc: commands"]);
    assert!(report.restart.is_empty(), "{report:?}");
    let recorded = send(&mut rig, 0, &arm());
    rig.run(1.0);
    let armed = |rig: &Rig| rig.vehicles[0].vehicle().truth().armed;
    assert!(!armed(&rig));
    assert_eq!(
        status(&rig, 0)
            .refused
            .get("this ground station may not command"),
        1
    );
    // It is where it was: nobody has to prove anything again.
    rig.forwarded.clear();
    rig.run(0.5);
    assert!(!rig.forwarded.is_empty());
    // What was sent meanwhile is a recording now.
    rig.reload(&text).expect("it is good");
    deliver(&mut rig, 0, at(50_000), &recorded);
    rig.run(1.0);
    assert!(!armed(&rig));
    send(&mut rig, 0, &arm());
    rig.run(1.0);
    assert!(armed(&rig));
    let none = text.replace(COMMANDER, "");
    let report = rig.reload(&none).expect("it is good");
    assert_eq!(report.applied, ["forward qgc removed"]);
    rig.forwarded.clear();
    rig.run(1.0);
    assert!(rig.forwarded.is_empty());
    let report = rig.reload(&(none + LISTENER)).expect("it is good");
    assert_eq!(report.applied, ["forward qgc added"]);
    let beat = frame(&rig, None, &heartbeat());
    deliver(&mut rig, 0, at(50_001), &beat);
    rig.run(1.0);
    assert!(!rig.forwarded.is_empty());
}

/// A program of this computer that cannot sign; it may change the mode and arm, and read files.
const UNSIGNED: &str = "[[forward]]\nname = \"mavsdk\"\nlink = \"udpin:127.0.0.1:14552\"\nunsigned = true\nlink_id = 7\n\
     commands = { commands = [400, 511], messages = [20, 110] }\n";

/// Sends a message of the program, unsigned.
fn send_unsigned(rig: &mut Rig, message: &MavMessage) -> Vec<u8> {
    rig.run(0.1);
    let bytes = frame(rig, None, message);
    deliver(rig, 0, at(50_000), &bytes);
    bytes
}

#[test]
fn a_program_that_cannot_sign_commands_what_is_listed_and_is_signed_as_a_stream_of_its_own() {
    let mut rig = rig(UNSIGNED);
    send_unsigned(&mut rig, &heartbeat());
    rig.run(3.0);
    assert!(rig.forwarded.len() > 20, "it receives the vehicle");
    let (before, since) = (accepted(&rig), rig.forwarded.len());
    send_unsigned(&mut rig, &arm());
    rig.run(1.0);
    assert_eq!(accepted(&rig), before + 1);
    assert_eq!(
        results(&rig, since),
        [(
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
            MavResult::MAV_RESULT_ACCEPTED
        )]
    );
    // Signed with the vehicle's key, in the program's name, under the link id of its own.
    send_unsigned(
        &mut rig,
        &command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, 1, 30.0),
    );
    let (_, sent) = rig
        .bridge
        .as_mut()
        .and_then(|bridge| bridge.poll_vehicle())
        .expect("passed on");
    let passed = FrameView::parse(sent.bytes()).expect("a frame");
    assert!(verify(&key(0), &passed).is_ok());
    assert_eq!(passed.header().system_id, 255);
    assert_eq!(
        passed.signature().map(|signature| signature.link_id),
        Some(7)
    );
    // Not listed: refused with an answer; parameters, keys and a shell get no answer either way.
    let (before, since) = (accepted(&rig), rig.forwarded.len());
    send_unsigned(&mut rig, &command(MavCmd::MAV_CMD_NAV_TAKEOFF, 1, 0.0));
    let set = PARAM_SET_DATA {
        target_system: 1,
        ..PARAM_SET_DATA::default()
    };
    send_unsigned(&mut rig, &MavMessage::PARAM_SET(set));
    rig.run(1.0);
    assert_eq!(accepted(&rig), before);
    assert_eq!(
        results(&rig, since),
        [(MavCmd::MAV_CMD_NAV_TAKEOFF, MavResult::MAV_RESULT_DENIED)]
    );
    let refused = status(&rig, 0).refused;
    assert_eq!(refused.get("command not allowed"), 1);
    assert_eq!(refused.get("message not allowed"), 1);
}

/// SET_MESSAGE_INTERVAL of a message, us.
fn interval(message: f32, us: f32) -> MavMessage {
    let px4 = Node::new(1, 1);
    command::long(px4, MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [message, us])
}

#[test]
fn beside_a_controller_no_program_takes_away_what_the_bridge_flies_by() {
    let mut rig = rig(UNSIGNED);
    send_unsigned(&mut rig, &heartbeat());
    assert!(rig.carry_out(orders::request_control()).is_some());
    // Off, slower, the vehicle's own rate; so often that it fills the link; a heartbeat.
    for (message, us) in [
        (33.0, -1.0),
        (30.0, 500_000.0),
        (32.0, 0.0),
        (33.0, 1.0),
        (105.0, 1.0),
        (0.0, -1.0),
    ] {
        let since = rig.forwarded.len();
        send_unsigned(&mut rig, &interval(message, us));
        rig.run(0.5);
        let denied = [(
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            MavResult::MAV_RESULT_DENIED,
        )];
        assert_eq!(
            results(&rig, since),
            denied,
            "message {message} each {us} us"
        );
    }
    // Faster than the bridge has it, and what the bridge does not need.
    for (message, us) in [(33.0, 100_000.0), (105.0, 20_000.0), (105.0, -1.0)] {
        let since = rig.forwarded.len();
        send_unsigned(&mut rig, &interval(message, us));
        rig.run(0.5);
        let denied = results(&rig, since)
            .iter()
            .any(|(_, result)| *result == MavResult::MAV_RESULT_DENIED);
        assert!(!denied, "message {message} each {us} us");
    }
}

#[test]
fn a_position_that_is_reported_no_more_is_not_shown_as_if_it_was_and_is_requested_again() {
    let mut rig = rig(UNSIGNED);
    send_unsigned(&mut rig, &heartbeat());
    // Nobody controls: who may command may do this too.
    send_unsigned(&mut rig, &interval(33.0, -1.0));
    rig.run(0.5);
    assert!(rig.carry_out(orders::request_control()).is_some());
    let since = rig.station().received.len();
    rig.run(12.0);
    let places =
        rig.station().received[since..]
            .iter()
            .filter_map(|(at, _, message)| match message {
                stanag_msgs::Message::InertialStates(states) => {
                    Some((*at, states.latitude.is_some()))
                }
                _ => None,
            });
    let places: Vec<_> = places.collect();
    let gone = places.iter().any(|(_, there)| !there);
    assert!(
        gone && places.last().is_some_and(|(_, there)| *there),
        "{places:?}"
    );
    let alerts = rig.station().alerts();
    assert!(
        alerts
            .iter()
            .any(|text| text.contains("stopped reporting its position")),
        "{alerts:?}"
    );
    assert!(
        alerts.iter().any(|text| text.contains("reported again")),
        "{alerts:?}"
    );
}

#[test]
fn an_unsigned_program_changes_no_keys_opens_no_shell_and_writes_no_file() {
    use mavlink_link::dialect::{
        FILE_TRANSFER_PROTOCOL_DATA, SERIAL_CONTROL_DATA, SETUP_SIGNING_DATA,
    };
    let mut rig = rig(UNSIGNED);
    send_unsigned(&mut rig, &heartbeat());
    let key_before = rig.vehicles[0].vehicle().counters().commands_accepted;
    let taken = status(&rig, 0).taken;
    send_unsigned(
        &mut rig,
        &MavMessage::SETUP_SIGNING(SETUP_SIGNING_DATA {
            target_system: 1,
            target_component: 1,
            ..SETUP_SIGNING_DATA::default()
        }),
    );
    send_unsigned(
        &mut rig,
        &MavMessage::SERIAL_CONTROL(SERIAL_CONTROL_DATA::default()),
    );
    let file = |opcode: u8| {
        let mut payload = [0; 251];
        payload[3] = opcode;
        MavMessage::FILE_TRANSFER_PROTOCOL(FILE_TRANSFER_PROTOCOL_DATA {
            target_network: 0,
            target_system: 1,
            target_component: 1,
            payload,
        })
    };
    // CreateFile, WriteFile, RemoveFile, CreateDirectory, RemoveDirectory, OpenFileWO, TruncateFile, Rename.
    for opcode in [6, 7, 8, 9, 10, 11, 12, 13] {
        send_unsigned(&mut rig, &file(opcode));
    }
    let refused = status(&rig, 0).refused;
    assert_eq!(refused.get("file transfer that writes"), 8);
    assert_eq!(status(&rig, 0).taken, taken, "none of it is passed on");
    assert_eq!(
        rig.vehicles[0].vehicle().counters().commands_accepted,
        key_before
    );
    // ListDirectory.
    send_unsigned(&mut rig, &file(3));
    assert_eq!(status(&rig, 0).taken, taken + 1);
    // OpenFileRO of the vehicle's key, with which it would sign whatever it likes.
    let mut key_file = file(4);
    if let MavMessage::FILE_TRANSFER_PROTOCOL(open) = &mut key_file {
        let path = b"/fs/microsd/mavlink/mavlink-signing-key.bin";
        open.payload[12..12 + path.len()].copy_from_slice(path);
    }
    send_unsigned(&mut rig, &key_file);
    assert_eq!(status(&rig, 0).taken, taken + 1);
    let refused = status(&rig, 0).refused;
    assert_eq!(refused.get("file transfer that may reach PX4's key"), 1);
}

#[test]
fn an_unsigned_program_only_asks_while_a_cucs_controls_the_vehicle() {
    let mut rig = rig(UNSIGNED);
    send_unsigned(&mut rig, &heartbeat());
    rig.done(orders::request_control());
    let (before, since) = (accepted(&rig), rig.forwarded.len());
    send_unsigned(&mut rig, &arm());
    rig.run(1.0);
    assert_eq!(accepted(&rig), before);
    assert_eq!(
        results(&rig, since),
        [(
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
            MavResult::MAV_RESULT_DENIED
        )]
    );
    assert_eq!(
        status(&rig, 0).refused.get("a CUCS controls the vehicle"),
        1
    );
}

#[test]
fn without_a_list_an_unsigned_program_is_a_reader() {
    let mut rig = rig(
        "[[forward]]\nname = \"mavsdk\"\nlink = \"udpin:127.0.0.1:14552\"\nunsigned = true\nlink_id = 7\n",
    );
    send_unsigned(&mut rig, &heartbeat());
    rig.run(2.0);
    assert!(rig.forwarded.len() > 20);
    let before = accepted(&rig);
    send_unsigned(&mut rig, &arm());
    rig.run(1.0);
    assert_eq!(accepted(&rig), before);
    assert_eq!(
        status(&rig, 0)
            .refused
            .get("this ground station may not command"),
        1
    );
}
