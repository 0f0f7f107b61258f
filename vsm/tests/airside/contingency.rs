//! What the agent flies by itself while nothing is received of the ground, and what it leaves alone.

use mavlink_link::dialect::{HEARTBEAT_DATA, MANUAL_CONTROL_DATA, MavCmd, MavMessage};
use mavlink_link::frame::{FrameView, Header, INCOMPAT_SIGNED, MAX_FRAME, encode};
use mavlink_link::service::{Node, command};
use mavlink_link::signing::sign;

use px4_sim::{Autopilot, Config, HealthFaults, Mode as Px4, Param, Signing};
use vsm::airside::Settings;
use vsm::config::airside::AirsideConfig;

use crate::world::{Disk, GROUND, World, at, key, settings};

/// An agent with this `[contingency]`, in the air and on hold, with its ground.
fn flying(contingency: &str) -> World {
    flying_with(contingency, Disk::with(Some(key(5))), Config::default())
}

fn flying_with(contingency: &str, disk: Disk, px4: Config) -> World {
    let text = format!(
        "[agent]\nvehicle_id = \"1b:00:01:01\"\nvsm_id = \"1b:00:00:01\"\nkey_file = \"k\"\n\
         [radio]\nlink = \"udpin:127.0.0.1:1\"\n[px4]\nlink = \"udpin:127.0.0.1:2\"\nsystem_id = 1\n\
         {contingency}\n[store]\ndir = \"state\"\n"
    );
    let config = AirsideConfig::parse(&text, std::path::Path::new("/")).unwrap();
    let settings = Settings {
        contingency: config.contingency.map(|one| one.get_ref().clone()),
        ..settings()
    };
    let mut world = World::with(settings, disk, Signing::with_key(key(5), 0));
    world.px4 = Autopilot::new(px4, Signing::with_key(key(5), 0), vec![Some(at(9))]);
    world.take_off();
    world.to_px4.clear();
    world
}

const HOME: &str = "[contingency]\nlink_lost_s = 8.0\nlink = \"rtl\"";

fn mode(world: &World) -> Px4 {
    world.px4.vehicle().truth().mode
}

/// The agent's own mode commands: PX4's modes by their sub modes.
fn commanded(world: &World) -> Vec<f32> {
    let own = world.to_px4.iter().filter_map(|bytes| {
        let frame = FrameView::parse(bytes).unwrap();
        match frame.message() {
            Ok(MavMessage::COMMAND_LONG(command))
                if frame.header().system_id == 246
                    && command.command == MavCmd::MAV_CMD_DO_SET_MODE =>
            {
                assert!(frame.is_signed());
                Some(command.param3)
            }
            _ => None,
        }
    });
    own.collect()
}

fn battery(world: &mut World, percent: u8) {
    let faults = HealthFaults {
        battery: Some(percent),
        ..HealthFaults::default()
    };
    world.px4.vehicle_mut().set_health_faults(faults);
}

fn cut(world: &mut World, seconds: f64) {
    world.uplink_cut = true;
    world.run(seconds);
}

fn contingency(world: &World) -> String {
    let status = world.agent.status(String::new(), world.now.mono);
    format!("{:?}", status.contingency)
}

const LOITER: f32 = 3.0;
const RTL: f32 = 5.0;
const LAND: f32 = 6.0;

#[test]
fn a_vehicle_whose_ground_is_lost_returns_and_the_ground_learns_of_it() {
    let mut world = flying(HOME);
    cut(&mut world, 7.5);
    assert_eq!((mode(&world), commanded(&world)), (Px4::Loiter, vec![]));
    world.run(5.0);
    assert_eq!(mode(&world), Px4::Rtl, "{:?}", world.log);
    // Commanded once, and confirmed by the mode that the vehicle shows.
    assert_eq!(commanded(&world), [RTL]);
    let stands = contingency(&world);
    assert!(
        stands.contains("the vehicle is in AUTO.RTL, as for return"),
        "{stands}"
    );
    // The ground is back, decides otherwise, and is sent what was done, twice.
    world.uplink_cut = false;
    world.run(1.5);
    let texts = &world.ground.as_ref().unwrap().texts;
    let sent = |text: &str| texts.iter().filter(|one| one.contains(text)).count();
    assert!(sent("the ground was lost for 1") >= 1, "{texts:?}");
    assert!(sent("the ground is lost: return flown") >= 1, "{texts:?}");
    world.command(MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 4.0, LOITER], 0.0);
    world.to_px4.clear();
    world.run(20.0);
    assert_eq!((mode(&world), commanded(&world)), (Px4::Loiter, vec![]));
    let texts = &world.ground.as_ref().unwrap().texts;
    let again = texts.iter().filter(|one| one.contains("return flown"));
    assert_eq!(again.count(), 2, "{texts:?}");
    // Lost a second time it is flown again.
    cut(&mut world, 14.0);
    assert_eq!(mode(&world), Px4::Rtl, "{:?}", world.log);
}

/// Who jams the radio and lets one recorded frame through now and then does not keep the vehicle from coming home: each verifies,
/// and none of them was made within the last minute.
#[test]
fn frames_that_were_held_back_do_not_stand_for_the_ground() {
    let mut world = flying("[contingency]\nlink_lost_s = 100.0\nlink = \"rtl\"");
    world.uplink_cut = true;
    let mut held_back = vec![];
    for _ in 0..60 {
        world.run(1.0);
        let now = world.now;
        let beat = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
        held_back.push(world.ground.as_mut().unwrap().frame(now, &beat));
    }
    for frame in held_back.iter().step_by(10) {
        world.run(15.0);
        assert!(world.passes(GROUND, frame), "it verifies");
    }
    let log = world.log.join("\n");
    assert!(
        log.contains("the ground is lost: the vehicle is in AUTO.RTL"),
        "{log}"
    );
    // The ground itself ends it.
    world.uplink_cut = false;
    world.run(2.0);
    assert!(contingency(&world).contains("ground_lost_s: None"));
}

#[test]
fn while_the_ground_is_there_nothing_is_commanded_whatever_is_wrong() {
    let mut world = flying(
        "[contingency]\nlink_lost_s = 5.0\nlink = \"rtl\"\nbattery = \"land\"\nposition = \"land\"\nengine = \"land\"",
    );
    let faults = HealthFaults {
        battery: Some(3),
        estimator: u16::MAX,
        ..HealthFaults::default()
    };
    world.px4.vehicle_mut().set_health_faults(faults);
    world.run(40.0);
    assert_eq!(commanded(&world), [] as [f32; 0]);
    assert!(contingency(&world).contains("ground_lost_s: None"));
    // One frame in less than link_lost_s is enough.
    for _ in 0..10 {
        cut(&mut world, 4.5);
        world.uplink_cut = false;
        world.run(1.1);
    }
    assert_eq!(commanded(&world), [] as [f32; 0]);
    // And where nothing is configured nothing ever is.
    let mut world = flying("");
    battery(&mut world, 3);
    cut(&mut world, 60.0);
    assert_eq!(commanded(&world), [] as [f32; 0]);
    assert_eq!(contingency(&world), "None");
}

#[test]
fn of_several_causes_the_most_urgent_is_flown() {
    let mut world = flying(
        "[contingency]\nlink_lost_s = 5.0\nlink = \"hold\"\nbattery = \"rtl\"\nbattery_percent = 40\nposition = \"land\"",
    );
    cut(&mut world, 10.0);
    // It holds already.
    assert_eq!((mode(&world), commanded(&world)), (Px4::Loiter, vec![]));
    battery(&mut world, 39);
    world.run(8.0);
    assert_eq!(
        (mode(&world), commanded(&world)),
        (Px4::Rtl, vec![RTL]),
        "{:?}",
        world.log
    );
    let lost = HealthFaults {
        battery: Some(39),
        estimator: u16::MAX,
        ..HealthFaults::default()
    };
    world.px4.vehicle_mut().set_health_faults(lost);
    world.run(14.0);
    assert_eq!(mode(&world), Px4::Land, "{:?}", world.log);
    assert_eq!(commanded(&world), [RTL, LAND]);
    world.uplink_cut = false;
    world.run(3.0);
    let texts = world.ground.as_ref().unwrap().texts.join("\n");
    for done in [
        "the position is lost: landing flown",
        "battery below 40 %: return flown",
        "the ground is lost: hold flown",
    ] {
        assert!(texts.contains(done), "{done}: {texts}");
    }
}

#[test]
fn outside_of_its_areas_it_comes_back() {
    let mut world = flying(
        "[contingency]\nlink_lost_s = 5.0\nfence = \"rtl\"\n[[contingency.area]]\nkeep = \"in\"\ncentre = [10.0, 10.0]\nradius_m = 100.0",
    );
    cut(&mut world, 12.0);
    assert_eq!(
        (mode(&world), commanded(&world)),
        (Px4::Rtl, vec![RTL]),
        "{:?}",
        world.log
    );
}

#[test]
fn what_px4_does_not_enter_is_tried_again_and_then_it_returns() {
    let mut world = flying("[contingency]\nlink_lost_s = 5.0\nlink = \"land\"");
    let elsewhere = HealthFaults {
        instead: Some(Px4::Loiter),
        ..HealthFaults::default()
    };
    world.px4.vehicle_mut().set_health_faults(elsewhere);
    cut(&mut world, 13.0);
    assert_eq!(
        (mode(&world), commanded(&world)),
        (Px4::Land, vec![LAND, LAND]),
        "{:?}",
        world.log
    );
    // A cut line to PX4: no try is counted as one that PX4 could refuse, and nothing is sent on.
    let mut world = flying(HOME);
    world.px4_connected = false;
    cut(&mut world, 30.0);
    assert!(commanded(&world).len() <= 1, "{:?}", commanded(&world));
}

/// A pilot's ground station, or a switch of the remote control, on another link of PX4.
fn pilot(world: &mut World, message: &MavMessage) {
    let header = Header {
        system_id: 255,
        component_id: 190,
        incompat: INCOMPAT_SIGNED,
        ..Header::default()
    };
    let mut out = [0; MAX_FRAME];
    let len = encode(message, header, &mut out);
    let stamp = mavlink_link::signing::Stamp::from_unix(world.now.wall);
    let len = sign(&key(5), 7, stamp, &mut out, len).unwrap();
    world.px4.handle_datagram(0, at(9), &out[..len]);
}

/// Sticks, for so long.
fn sticks(world: &mut World, seconds: f64) {
    for _ in 0..(seconds * 20.0) as usize {
        let centred = MANUAL_CONTROL_DATA {
            target: 1,
            z: 500,
            ..MANUAL_CONTROL_DATA::default()
        };
        pilot(world, &MavMessage::MANUAL_CONTROL(centred));
        world.tick();
    }
}

#[test]
fn a_pilot_keeps_the_vehicle() {
    let mut world = flying(HOME);
    sticks(&mut world, 1.0);
    let position = command::long(Node::new(1, 1), MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 3.0]);
    pilot(&mut world, &position);
    sticks(&mut world, 2.0);
    assert_eq!(mode(&world), Px4::PosCtl, "{:?}", world.log);
    world.uplink_cut = true;
    sticks(&mut world, 40.0);
    assert_eq!((mode(&world), commanded(&world)), (Px4::PosCtl, vec![]));
    let stands = contingency(&world);
    assert!(stands.contains("by its pilot"), "{stands}");
}

#[test]
fn px4s_own_failsafe_goes_first() {
    let px4 = Config {
        params: vec![(Param::NAV_DLL_ACT, 3.0), (Param::COM_DL_LOSS_T, 5.0)],
        ..Config::default()
    };
    let disk = Disk::with(Some(key(5)));
    let mut world = flying_with(
        "[contingency]\nlink_lost_s = 12.0\nlink = \"rtl\"",
        disk,
        px4,
    );
    cut(&mut world, 22.0);
    assert_eq!(
        (mode(&world), commanded(&world)),
        (Px4::Land, vec![]),
        "{:?}",
        world.log
    );
}

#[test]
fn a_restart_of_the_agent_flies_nothing_twice_and_forgets_nothing() {
    // Before anything is flown.
    let mut world = flying(HOME);
    cut(&mut world, 6.0);
    world.restart_agent();
    world.run(14.0);
    assert_eq!(
        (mode(&world), commanded(&world)),
        (Px4::Rtl, vec![RTL]),
        "{:?}",
        world.log
    );
    // After it: a pilot has taken it since, and given it back on hold.
    world.restart_agent();
    let hold = command::long(
        Node::new(1, 1),
        MavCmd::MAV_CMD_DO_SET_MODE,
        [1.0, 4.0, LOITER],
    );
    pilot(&mut world, &hold);
    world.to_px4.clear();
    world.run(30.0);
    assert_eq!(
        (mode(&world), commanded(&world)),
        (Px4::Loiter, vec![]),
        "{:?}",
        world.log
    );
    // And the ground's return begins all again.
    world.uplink_cut = false;
    world.run(4.0);
    cut(&mut world, 14.0);
    assert_eq!(mode(&world), Px4::Rtl, "{:?}", world.log);
}

#[test]
fn a_vehicle_on_the_ground_is_left_there() {
    let mut world = flying(HOME);
    world.command(MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 4.0, LAND], 0.0);
    world.run(60.0);
    assert!(
        !world.px4.vehicle().truth().armed,
        "{:?}",
        world.px4.vehicle().truth()
    );
    world.to_px4.clear();
    cut(&mut world, 30.0);
    assert_eq!(commanded(&world), [] as [f32; 0]);
}

#[test]
fn a_new_key_that_waits_for_the_ground_does_not_keep_it_from_flying() {
    let mut world = flying(HOME);
    // Agreed on in flight: it comes into force when the vehicle is disarmed.
    world.disk.next = Some(key(6));
    world.restart_agent();
    world.run(12.0);
    assert_eq!(world.state(), "waits for disarmed", "{:?}", world.log);
    world.to_px4.clear();
    cut(&mut world, 14.0);
    assert_eq!(
        (mode(&world), commanded(&world)),
        (Px4::Rtl, vec![RTL]),
        "{:?}",
        world.log
    );
}
