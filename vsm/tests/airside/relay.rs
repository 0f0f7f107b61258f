//! The air-side agent as a relay: what passes, byte by byte, and each thing that does not.

use crate::world::{Disk, GROUND, STRANGER, VSM, World, at, encoded, frame, key, settings};
use mavlink_link::dialect::{MavCmd, MavMessage};
use mavlink_link::receiver::Stream;
use mavlink_link::service::{Node, command};
use mavlink_link::signing::Stamp;
use px4_sim::Signing;

const COMMAND_LONG: u32 = 76;
const SETUP_SIGNING: u32 = 256;
const KEY_EXCHANGE: u32 = 229;

fn command() -> MavMessage {
    let px4 = Node::new(1, 1);
    command::long(px4, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0])
}

/// How many PX4 has answered.
fn commands(world: &World) -> u64 {
    let counters = world.px4.vehicle().counters();
    counters.commands_accepted + counters.commands_refused
}

fn forged(world: &mut World, stream: Stream, id: u32) -> Vec<u8> {
    let now = world.now;
    let stamp = world.ground.as_mut().unwrap().stamp(now);
    frame(stream, id, &[1; 42], Some((&key(5), stamp)))
}

#[test]
fn a_signed_command_of_the_listed_talker_passes_unaltered() {
    let mut world = World::live();
    let now = world.now;
    let bytes = world.ground.as_mut().unwrap().frame(now, &command());
    assert!(world.passes(GROUND, &bytes));
    world.run(0.2);
    assert_eq!(commands(&world), 1);
}

#[test]
fn frames_of_the_autopilot_pass_to_the_ground_and_lift_its_clock() {
    let world = World::live();
    assert!(world.received().contains(&0), "{:?}", world.received());
    assert_eq!(world.state(), "relaying");
}

#[test]
fn an_unsigned_frame_is_dropped() {
    let mut world = World::live();
    let bytes = encoded(VSM, &command());
    assert!(!world.passes(GROUND, &bytes));
    assert_eq!(world.refused("unsigned_vehicle"), 1);
    // Not even the four that PX4 takes unsigned.
    for id in [0, 109, 246, 247] {
        let bytes = frame(VSM, id, &[3; 9], None);
        assert!(!world.passes(GROUND, &bytes), "{id}");
    }
}

#[test]
fn a_frame_under_another_key_is_dropped() {
    let mut world = World::live();
    let now = world.now;
    let stamp = world.ground.as_mut().unwrap().stamp(now);
    let bytes = frame(VSM, COMMAND_LONG, &[1; 33], Some((&key(6), stamp)));
    assert!(!world.passes(GROUND, &bytes));
    assert_eq!(world.refused("bad_signature"), 1);
}

#[test]
fn a_bent_frame_is_dropped_wherever_it_is_bent() {
    let mut world = World::live();
    let now = world.now;
    let bytes = world.ground.as_mut().unwrap().frame(now, &command());
    for at in 0..bytes.len() {
        let mut bent = bytes.clone();
        bent[at] ^= 0x10;
        assert!(!world.passes(GROUND, &bent), "byte {at}");
    }
    assert!(world.passes(GROUND, &bytes), "and unbent it passes");
}

#[test]
fn mavlink_1_is_dropped() {
    let mut world = World::live();
    let mut bytes = vec![0xfe, 9, 0, 245, 190, 0, 0, 0, 0, 0, 6, 8, 0, 4, 3];
    let crc = mavlink_link::frame::checksum(&bytes[1..], 50);
    bytes.extend(crc.to_le_bytes());
    assert!(!world.passes(GROUND, &bytes));
    assert_eq!(world.refused("mavlink1"), 1);
}

#[test]
fn setup_signing_never_passes_however_well_signed() {
    let mut world = World::live();
    let bytes = forged(&mut world, VSM, SETUP_SIGNING);
    assert!(!world.passes(GROUND, &bytes));
    assert_eq!(world.held_back("SETUP_SIGNING from the ground"), 1);
    assert!(world.px4_has(&key(5)));
}

#[test]
fn key_exchange_never_passes() {
    let mut world = World::live();
    let bytes = forged(&mut world, VSM, KEY_EXCHANGE);
    assert!(!world.passes(GROUND, &bytes));
    let bytes = frame(VSM, KEY_EXCHANGE, &[1; 50], None);
    assert!(!world.passes(GROUND, &bytes));
    assert_eq!(world.refused("key_exchange"), 2);
}

#[test]
fn the_vehicles_own_system_id_is_dropped_whatever_its_signature() {
    let mut world = World::live();
    for component in [1, 191, 7] {
        let own = Stream {
            system: 1,
            component,
            link: 0,
        };
        let bytes = forged(&mut world, own, COMMAND_LONG);
        assert!(!world.passes(GROUND, &bytes));
    }
    assert_eq!(world.refused("reflected"), 3);
}

#[test]
fn a_talker_that_is_not_listed_is_dropped() {
    let mut world = World::live();
    for (system, component, link) in [(244, 190, 0), (245, 191, 0), (245, 190, 1)] {
        let stranger = Stream {
            system,
            component,
            link,
        };
        let bytes = forged(&mut world, stranger, COMMAND_LONG);
        assert!(!world.passes(GROUND, &bytes), "{stranger:?}");
    }
    assert_eq!(world.refused("unexpected_system"), 1);
    assert_eq!(world.refused("not_listed"), 2);
}

#[test]
fn a_frame_passes_once() {
    let mut world = World::live();
    let now = world.now;
    let bytes = world.ground.as_mut().unwrap().frame(now, &command());
    assert!(world.passes(GROUND, &bytes));
    assert!(!world.passes(GROUND, &bytes));
    assert!(!world.passes(STRANGER, &bytes));
    assert_eq!(world.refused("stale"), 2);
}

#[test]
fn a_recording_passes_neither_after_a_restart_of_the_agent_nor_of_px4_nor_of_both() {
    let mut world = World::live();
    let now = world.now;
    let recorded = world.ground.as_mut().unwrap().frame(now, &command());
    world.run(1.0);
    world.px4.restart();
    assert!(!world.passes(STRANGER, &recorded));
    world.restart_agent();
    assert!(!world.passes(STRANGER, &recorded));
    world.px4.restart();
    world.restart_agent();
    assert!(!world.passes(STRANGER, &recorded));
}

#[test]
fn a_stamp_a_year_ahead_is_dropped_and_moves_nothing() {
    let mut world = World::live();
    let ahead = Stamp::new(37_517_586_000_000 + 366 * 86_400 * 100_000);
    let bytes = frame(VSM, COMMAND_LONG, &[1; 33], Some((&key(5), ahead)));
    assert!(!world.passes(GROUND, &bytes));
    assert_eq!(world.refused("future"), 1);
    let now = world.now;
    let bytes = world.ground.as_mut().unwrap().frame(now, &command());
    assert!(world.passes(GROUND, &bytes));
}

#[test]
fn a_stranger_moves_neither_peer_nor_state() {
    let mut world = World::live();
    let bytes = frame(VSM, COMMAND_LONG, &[1; 33], None);
    for _ in 0..50 {
        world.radio(STRANGER, &bytes);
    }
    let status = world.agent.status(String::new(), world.now.mono);
    assert_eq!(status.radio.peer, Some(at(GROUND).to_string()));
}

#[test]
fn px4s_unsigned_frames_and_setup_signing_do_not_reach_the_ground() {
    let mut world = World::live();
    let before = world.received().len();
    let px4 = Stream {
        system: 1,
        component: 1,
        link: 0,
    };
    // An unsigned heartbeat is anyone's.
    let unsigned = frame(px4, 0, &[2; 9], None);
    let (now, from) = (world.now, at(crate::world::PX4));
    world
        .agent
        .handle_px4(now, from, &unsigned, &mut world.disk);
    let stamp = world.ground.as_mut().unwrap().stamp(now);
    let setup = frame(px4, SETUP_SIGNING, &[2; 42], Some((&key(5), stamp)));
    world.agent.handle_px4(now, from, &setup, &mut world.disk);
    world.drain();
    assert_eq!(world.received().len(), before);
    assert_eq!(world.held_back("SETUP_SIGNING from PX4"), 1);
    assert_eq!(world.state(), "relaying");
}

#[test]
fn without_a_key_nothing_passes_either_way() {
    let mut world = World::new(None, Signing::off());
    let now = world.now;
    let mut ground = crate::world::Ground::new(key(5), now);
    let bytes = ground.frame(now, &command());
    world.run(3.0);
    assert!(!world.passes(GROUND, &bytes));
    assert!(!world.passes(GROUND, &encoded(VSM, &command())));
    assert_eq!(world.state(), "no key");
    world.run(0.2);
    assert_eq!(commands(&world), 0);
}

#[test]
fn a_flood_is_bounded() {
    let mut world = World::live();
    let now = world.now;
    let mut datagram = Vec::new();
    for _ in 0..1_500 {
        datagram.extend(world.ground.as_mut().unwrap().frame(now, &command()));
    }
    world.radio(GROUND, &datagram);
    assert_eq!(world.held_back("too much at once"), 1_500 - 1_024);
}

#[test]
fn a_disk_that_is_full_lets_nothing_pass_beyond_the_stored_ceiling() {
    let mut world = World::live();
    world.disk.full = true;
    world.run(15.0);
    let now = world.now;
    let bytes = world.ground.as_mut().unwrap().frame(now, &command());
    assert!(!world.passes(GROUND, &bytes));
    world.disk.full = false;
    world.run(2.0);
    let now = world.now;
    let bytes = world.ground.as_mut().unwrap().frame(now, &command());
    assert!(world.passes(GROUND, &bytes));
}

/// A frame of the VSM, validly signed.
fn signed(world: &mut World, id: u32, payload: &[u8]) -> Vec<u8> {
    let now = world.now;
    let stamp = world.ground.as_mut().unwrap().stamp(now);
    frame(VSM, id, payload, Some((&key(5), stamp)))
}

fn command_frame(world: &mut World, id: u32, command: u16, param2: f32) -> Vec<u8> {
    let mut payload = [1; 33];
    payload[4..8].copy_from_slice(&param2.to_le_bytes());
    payload[28..30].copy_from_slice(&command.to_le_bytes());
    signed(world, id, &payload)
}

fn write_of(world: &mut World, name: &str) -> Vec<u8> {
    let mut payload = [0; 23];
    payload[4..6].copy_from_slice(&[1, 1]);
    payload[6..6 + name.len()].copy_from_slice(name.as_bytes());
    signed(world, 23, &payload)
}

#[test]
fn a_captured_ground_station_reaches_no_shell_no_files_and_no_failsafe() {
    let mut world = World::live();
    // SERIAL_CONTROL, FILE_TRANSFER_PROTOCOL, ENCAPSULATED_DATA, LOG_ERASE, TUNNEL, PARAM_EXT_SET.
    for id in [126, 110, 131, 121, 385, 323] {
        let bytes = signed(&mut world, id, &[1; 20]);
        assert!(!world.passes(GROUND, &bytes), "{id}");
    }
    assert_eq!(world.held_back("message not allowed (relay.messages)"), 6);
    // Reboot, storage, DO_FLIGHTTERMINATION, DO_SET_ACTUATOR, motor test, in both forms.
    for command in [246, 245, 185, 187, 209] {
        for id in [75, 76] {
            let bytes = command_frame(&mut world, id, command, 0.0);
            assert!(!world.passes(GROUND, &bytes), "{command}");
        }
    }
    assert_eq!(world.held_back("command not allowed (relay.commands)"), 10);
    // The motors are not stopped in flight by force.
    for param2 in [21_196.0, f32::NAN, 1.0] {
        let bytes = command_frame(&mut world, 76, 400, param2);
        assert!(!world.passes(GROUND, &bytes), "{param2}");
    }
    let mut written = 0;
    for name in [
        "COM_DL_LOSS_T",
        "NAV_DLL_ACT",
        "NAV_RCL_ACT",
        "GF_ACTION",
        "CBRK_FLIGHTTERM",
        "MAV_SIGN_CFG",
        "MAV_2_CONFIG",
        "COM_ARM_WO_GPS",
        "RTL_TYPE",
        "MIS_TKO_LAND_REQ",
        "NAV_FORCE_VT",
        "NAV_TRAFF_AVOID",
        "VT_QC_ALT_LOSS",
        "VT_FW_QC_P",
        "VT_FW_MIN_ALT",
        "VT_TRANS_TIMEOUT",
        "RC_MAP_KILL_SW",
        "RC_FAILS_THR",
        "RC5_REV",
        "MAN_KILL_GEST_T",
        "CA_FAILURE_MODE",
        "PCA9685_FUNC1",
        "EKF2_GPS_CHECK",
        "ASPD_DO_CHECKS",
        "MOTFAIL_TIME",
        "CAL_MAG0_ID",
        "SENS_BOARD_ROT",
        "BAT1_V_EMPTY",
        "BAT1_N_CELLS",
        "BAT2_CAPACITY",
        "LNDMC_Z_VEL_MAX",
        "CP_DIST",
        "FW_GPSF_LT",
        "RC_CRSF_PRT_CFG",
        "TEL_HOTT_CONFIG",
    ] {
        let bytes = write_of(&mut world, name);
        assert!(!world.passes(GROUND, &bytes), "{name}");
        written += 1;
    }
    let protected = "parameter protected (relay.protected_parameters)";
    assert_eq!(world.held_back(protected), written);
    let status = world.agent.status(String::new(), world.now.mono);
    let messages: Vec<_> = status.denied_messages.iter().collect();
    assert!(
        messages.contains(&(126, 1)) && messages.contains(&(110, 1)),
        "{messages:?}"
    );
    assert!(
        status
            .denied_commands
            .iter()
            .any(|(command, count)| (command, count) == (246, 2))
    );

    // What the bridge sends passes.
    for id in [4, 86, 111, 134, 282, 287, 412] {
        let bytes = signed(&mut world, id, &[1; 6]);
        assert!(world.passes(GROUND, &bytes), "{id}");
    }
    for command in [
        22, 34, 35, 84, 176, 178, 186, 191, 192, 400, 511, 512, 530, 531, 532, 534, 1_000, 1_001,
        2_000, 2_500, 2_501, 3_000, 32_100, 43_002,
    ] {
        let bytes = command_frame(&mut world, 76, command, 0.0);
        assert!(world.passes(GROUND, &bytes), "{command}");
    }
    for name in ["MPC_XY_CRUISE", "NAV_LOITER_RAD", "MIS_TAKEOFF_ALT"] {
        let bytes = write_of(&mut world, name);
        assert!(world.passes(GROUND, &bytes), "{name}");
    }
}

/// PX4 passes a write for another component on: to the node of that number on CAN, such as an ESC, or to a camera.
#[test]
fn a_captured_ground_station_writes_no_parameter_of_another_component() {
    let mut world = World::live();
    let mut write_to = |component: u8| {
        let mut payload = [0; 23];
        payload[4..6].copy_from_slice(&[1, component]);
        payload[6..15].copy_from_slice(b"MOT_POLES");
        let bytes = signed(&mut world, 23, &payload);
        (
            world.passes(GROUND, &bytes),
            world.held_back("parameter of another component than PX4"),
        )
    };
    for (before, component) in (0..).zip([2, 11, 100, 126, 127, 154, 255]) {
        assert_eq!(write_to(component), (false, before + 1), "{component}");
    }
    for component in [0, 1] {
        assert_eq!(write_to(component), (true, 7), "{component}");
    }
}

/// PX4 gives its key file to whoever may read files: where they are listed, the key does not leave by them.
#[test]
fn where_files_pass_none_by_which_px4s_key_can_be_read_does() {
    let mut settings = settings();
    settings.policy.messages.push(110);
    let disk = Disk::with(Some(key(5)));
    let mut world = World::with(settings, disk, Signing::with_key(key(5), 0));
    world.run(3.0);
    let mut passes = |opcode: u8, path: &str| {
        let mut payload = [0; 254];
        payload[6..8].copy_from_slice(&[opcode, path.len() as u8]);
        payload[15..15 + path.len()].copy_from_slice(path.as_bytes());
        let bytes = signed(&mut world, 110, &payload);
        (
            world.passes(GROUND, &bytes),
            world.held_back("file transfer that may reach PX4's key"),
        )
    };
    // OpenFileRO, OpenFileWO, Rename, CalcFileCRC32.
    let mut held_back = 0;
    for opcode in [4, 11, 13, 14] {
        for path in [
            "/fs/microsd/mavlink/mavlink-signing-key.bin",
            "fs/microsd/./MAVLINK//x",
            "/fs/microsd/Mavlink./x",
            "/fs/microsd/log/a\0/fs/microsd/mavlink",
            "/fs/microsd/x/MAVLIN~1.BIN",
            "/dev/mmcsd0",
            "//DEV/mmcsd0",
            "/proc/1/mem",
        ] {
            held_back += 1;
            assert_eq!(passes(opcode, path), (false, held_back), "{opcode} {path}");
        }
        for path in [
            "/fs/microsd/log/2026-11-30/10_00_00.ulg",
            "/etc/extras/parameters.json.xz",
            "/fs/microsd/device/process",
            "",
        ] {
            assert_eq!(passes(opcode, path), (true, held_back), "{opcode} {path}");
        }
    }
    // WriteFile has no path.
    assert_eq!(passes(7, "of mavlink"), (true, held_back));
}

/// An item of a mission, in place of a command. PX4 v1.18 carries it out as one when the mission reaches it.
fn item(world: &mut World, id: u32, command: u16, param2: f32) -> Vec<u8> {
    let mut payload = [0; 38];
    payload[4..8].copy_from_slice(&param2.to_le_bytes());
    payload[30..32].copy_from_slice(&command.to_le_bytes());
    payload[32..35].copy_from_slice(&[1, 1, 2]);
    signed(world, id, &payload)
}

#[test]
fn a_captured_ground_station_reaches_nothing_by_a_mission_that_it_may_not_command() {
    let mut world = World::live();
    // MISSION_ITEM, MISSION_ITEM_INT.
    for id in [39, 73] {
        // DO_SET_HOME, DO_SET_ACTUATOR, DO_GRIPPER, DO_AUTOTUNE_ENABLE, DO_WINCH, DO_FLIGHTTERMINATION, and one that nobody knows.
        for command in [179, 187, 211, 212, 42_600, 185, 9_999] {
            let bytes = item(&mut world, id, command, 0.0);
            assert!(!world.passes(GROUND, &bytes), "{command}");
        }
        // The motors are not stopped in flight by an item that disarms by force either.
        for param2 in [21_196.0, f32::NAN] {
            let bytes = item(&mut world, id, 400, param2);
            assert!(!world.passes(GROUND, &bytes), "{param2}");
        }
        for command in [
            16, 17, 20, 21, 22, 31, 85, 93, 112, 114, 177, 178, 189, 195, 197, 206, 3_000, 5_001,
            5_100, 400,
        ] {
            let bytes = item(&mut world, id, command, 0.0);
            assert!(world.passes(GROUND, &bytes), "{command}");
        }
    }
    assert_eq!(world.held_back("command not allowed (relay.commands)"), 14);
    assert_eq!(world.held_back("forced arming or disarming"), 4);
}

#[test]
fn a_mission_carries_out_what_is_listed_and_no_reboot_in_flight() {
    let mut settings = settings();
    settings.policy.commands.extend([211, 246]);
    let disk = Disk::with(Some(key(5)));
    let mut world = World::with(settings, disk, Signing::with_key(key(5), 0));
    world.run(3.0);
    let bytes = item(&mut world, 73, 211, 0.0);
    assert!(world.passes(GROUND, &bytes));
    let bytes = item(&mut world, 73, 246, 0.0);
    assert!(!world.passes(GROUND, &bytes), "the mission may be flown");
}

#[test]
fn a_reboot_that_is_on_the_list_passes_only_while_px4_reports_that_it_is_disarmed() {
    let mut settings = settings();
    settings.policy.commands.push(246);
    let disk = Disk::with(Some(key(5)));
    let mut world = World::with(settings, disk, Signing::with_key(key(5), 0));
    world.run(3.0);
    let bytes = command_frame(&mut world, 76, 246, 0.0);
    assert!(world.passes(GROUND, &bytes), "on the ground");
    // PX4 falls silent: whether it is armed is not known any more.
    world.px4_connected = false;
    world.run(2.0);
    let bytes = command_frame(&mut world, 76, 246, 0.0);
    assert!(!world.passes(GROUND, &bytes));
}
