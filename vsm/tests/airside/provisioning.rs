//! The air-side agent gives PX4 its keys: from its disk alone, disarmed, and without a state that needs a person.

use std::time::Duration;

use crate::world::{
    Disk, GROUND, Ground, Mishap, PX4, VSM, World, at, encoded, frame, key, settings, start,
};
use mavlink_link::dialect::{MavCmd, MavMessage};
use mavlink_link::frame::FrameView;
use mavlink_link::link::Endpoint;
use mavlink_link::receiver::Stream;
use mavlink_link::service::{Node, command};
use mavlink_link::signing::Stamp;
use px4_sim::Signing;
use vsm::airside::Settings;

fn arm() -> MavMessage {
    let px4 = Node::new(1, 1);
    command::long(px4, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0])
}

/// A first key is on the agent's disk, as an exchange leaves it there.
fn first() -> World {
    let disk = Disk {
        next: Some(key(6)),
        ..Disk::default()
    };
    World::with(settings(), disk, Signing::off())
}

/// PX4 signs with one key, and another is on the agent's disk.
fn rotation() -> World {
    let disk = Disk {
        current: Some(key(5)),
        next: Some(key(6)),
        ..Disk::default()
    };
    World::with(settings(), disk, Signing::with_key(key(5), 0))
}

fn has(world: &World, expected: u8) -> bool {
    let current = world.disk.current.as_ref();
    world.state() == "relaying"
        && world.px4_has(&key(expected))
        && current.is_some_and(|current| current.same_as(&key(expected)))
        && world.disk.next.is_none()
}

#[test]
fn a_px4_without_a_key_is_given_its_first() {
    let mut world = first();
    world.run(8.0);
    assert_eq!((world.state(), world.secrets), ("staged", 0));
    world.run(12.0);
    assert!(has(&world, 6), "{:?}", world.log);
    assert_eq!(world.secrets, 1);
}

#[test]
fn the_link_keeps_the_old_key_until_px4_has_the_new_one() {
    let mut world = rotation();
    world.run(6.0);
    assert_eq!(world.state(), "staged");
    let received = world.received().len();
    assert!(received > 0);
    let now = world.now;
    let bytes = world.ground.as_mut().unwrap().frame(now, &arm());
    assert!(world.passes(GROUND, &bytes));
    world.run(1.0);
    assert!(world.received().len() > received);
}

#[test]
fn a_rotation_keeps_the_previous_key_until_px4_has_restarted() {
    let mut world = rotation();
    world.run(25.0);
    assert!(has(&world, 6), "{:?}", world.log);
    assert!(world.disk.previous.is_some());
    world.px4.restart();
    world.run(8.0);
    assert!(has(&world, 6));
    assert!(world.disk.previous.is_none(), "{:?}", world.log);
}

#[test]
fn an_armed_px4_is_not_sent_a_key_and_flies_on_under_the_old_one() {
    let mut world = rotation();
    world.run(6.0);
    let now = world.now;
    let bytes = world.ground.as_mut().unwrap().frame(now, &arm());
    world.radio(GROUND, &bytes);
    world.run(6.0);
    assert!(world.px4.vehicle().truth().armed);
    assert_eq!((world.state(), world.secrets), ("waits for disarmed", 0));
    let now = world.now;
    let bytes = world.ground.as_mut().unwrap().frame(now, &arm());
    assert!(world.passes(GROUND, &bytes));
    // It disarms by itself on the ground after a while.
    world.run(15.0);
    assert!(has(&world, 6), "{:?}", world.log);
}

#[test]
fn an_agent_that_restarts_in_flight_with_a_key_waiting_still_relays_commands() {
    for px4 in [Endpoint::Fixed(at(PX4)), Endpoint::Listen] {
        let disk = Disk {
            current: Some(key(5)),
            next: Some(key(6)),
            ..Disk::default()
        };
        let settings = Settings { px4, ..settings() };
        let mut world = World::with(settings, disk, Signing::with_key(key(5), 0));
        world.run(6.0);
        let arming = |world: &mut World| {
            let now = world.now;
            world.ground.as_mut().unwrap().frame(now, &arm())
        };
        let bytes = arming(&mut world);
        world.radio(GROUND, &bytes);
        world.run(2.0);
        assert!(world.px4.vehicle().truth().armed, "{px4:?}");
        world.restart_agent();
        world.run(4.0);
        let waits = ["staged", "waits for disarmed"].contains(&world.state());
        assert!(waits, "{px4:?}");
        let bytes = arming(&mut world);
        assert!(world.passes(GROUND, &bytes), "{px4:?}");
    }
}

#[test]
fn an_unsigned_px4_after_a_power_cut_gets_its_key_again_and_no_command_before() {
    let mut world = World::live();
    // Its power is cut, and the card has lost the file: it starts unsigned.
    world.px4_connected = false;
    world.run(2.0);
    world.px4_connected = true;
    world.px4 = px4_sim::Autopilot::new(
        px4_sim::Config::default(),
        Signing::off(),
        vec![Some(crate::world::at(9))],
    );
    let mut asked = 0;
    let mut passed_while_open = 0;
    for _ in 0..200 {
        world.tick();
        let now = world.now;
        let bytes = world.ground.as_mut().unwrap().frame(now, &arm());
        let open = world.px4.signing().key().is_none();
        asked += 1;
        if world.passes(GROUND, &bytes) && open {
            passed_while_open += 1;
        }
        if world.state() == "relaying" && !open {
            break;
        }
    }
    assert!(has(&world, 5), "{asked} {:?}", world.log);
    assert_eq!(passed_while_open, 0);
    let alert = world.log.iter().any(|line| line.contains("UNSIGNED"));
    assert!(alert, "{:?}", world.log);
    // And so is the ground.
    world.run(1.0);
    let texts = &world.ground.as_ref().unwrap().texts;
    let reported: Vec<bool> = ["UNSIGNED", "again"]
        .iter()
        .map(|word| texts.iter().any(|text| text.contains(word)))
        .collect();
    assert_eq!(reported, [true, true], "{texts:?}");
}

#[test]
fn frames_of_a_px4_that_reverts_to_the_previous_key_are_not_delivered_and_it_gets_the_new_one_again()
 {
    let mut world = rotation();
    world.run(25.0);
    assert!(has(&world, 6));
    let above = Stamp::from_unix(world.now.after(Duration::from_secs(60)).wall);
    world.px4 = px4_sim::Autopilot::new(
        px4_sim::Config::default(),
        Signing::with_key(key(5), above.get()),
        vec![Some(crate::world::at(9))],
    );
    // Its stamps are above all that the ground has seen: what keeps it away is the key alone.
    let now = world.now;
    let before = world.ground.replace(Ground::new(key(5), now));
    world.run(1.9);
    assert!(world.received().is_empty());
    world.ground = before;
    world.run(10.0);
    assert!(has(&world, 6), "{:?}", world.log);
    // The key before is kept until a start that PX4 comes out of with the one in force.
    assert!(world.disk.previous.is_some());
    world.px4.restart();
    world.run(10.0);
    assert!(has(&world, 6) && world.disk.previous.is_none());
}

#[test]
fn a_px4_that_cannot_sign_is_recognised_and_retried() {
    let mut world = first();
    world.cannot_sign = true;
    world.run(40.0);
    assert_eq!(world.state(), "PX4 cannot sign");
    assert!(world.disk.next.is_some(), "the key stays on disk");
    assert_eq!(world.secrets, 3);
    assert!(!world.passes(GROUND, &encoded(VSM, &arm())));
    world.cannot_sign = false;
    world.run(70.0);
    assert!(has(&world, 6), "{:?}", world.log);
}

#[test]
fn silence_is_no_refusal() {
    let mut world = rotation();
    world.on_secret = Some(Mishap::LineCut);
    world.run(300.0);
    assert_eq!(world.secrets, 1);
    assert_eq!(world.state(), "asks which key PX4 has");
    assert!(world.disk.next.is_some() && world.disk.current.is_some());
    world.px4_connected = true;
    world.run(20.0);
    assert!(has(&world, 6), "{:?}", world.log);
}

#[test]
fn every_frame_lost_in_turn_changes_nothing_in_the_end() {
    let mut world = rotation();
    while world.state() != "waits for disarmed" && world.secrets == 0 {
        world.tick();
    }
    let from = world.datagrams;
    for nth in 0..40 {
        let mut world = rotation();
        world.lost = Some(from + nth);
        world.run(40.0);
        assert!(has(&world, 6), "datagram {nth} lost: {:?}", world.log);
        assert!((1..=3).contains(&world.secrets));
    }
}

#[test]
fn a_restart_at_each_tenth_of_a_second_changes_nothing_in_the_end() {
    for first_key in [true, false] {
        // Densely around the moment when the key goes out.
        for tenth in (0..120).step_by(15).chain((120..150).step_by(4)) {
            for agent in [true, false] {
                let mut world = if first_key { first() } else { rotation() };
                world.run(f64::from(tenth) / 10.0);
                if agent {
                    world.restart_agent();
                } else {
                    world.px4.restart();
                }
                world.run(40.0);
                assert!(
                    has(&world, 6),
                    "restart of the agent {agent} after {tenth} tenths: {} {:?}",
                    world.state(),
                    world.log
                );
            }
        }
    }
}

#[test]
fn a_key_that_is_not_on_a_slow_disk_yet_is_not_sent_and_frames_are_relayed() {
    let mut world = rotation();
    world.disk.slow = true;
    world.run(40.0);
    assert_eq!(world.secrets, 0, "{:?}", world.log);
    let received = world.received().len();
    assert!(received > 0);
    let now = world.now;
    let bytes = world.ground.as_mut().unwrap().frame(now, &arm());
    assert!(world.passes(GROUND, &bytes));
    world.run(1.0);
    assert!(world.received().len() > received);
    world.disk.slow = false;
    world.run(25.0);
    assert!(has(&world, 6), "{:?}", world.log);
}

#[test]
fn a_full_disk_delivers_nothing_under_a_key_that_is_not_in_force_there() {
    let mut world = rotation();
    let now = world.now;
    world.ground = Some(Ground::new(key(6), now));
    world.on_secret = Some(Mishap::DiskFull);
    world.run(18.0);
    assert!(world.px4_has(&key(6)));
    assert!(world.received().is_empty());
    assert!(world.disk.next.is_some());
    world.disk.full = false;
    world.run(5.0);
    assert!(has(&world, 6), "{} {:?}", world.state(), world.log);
    assert!(!world.received().is_empty());
}

#[test]
fn two_autopilots_on_the_link_are_refused() {
    let mut world = rotation();
    world.run(3.0);
    let other = MavMessage::HEARTBEAT(mavlink_link::dialect::HEARTBEAT_DATA {
        autopilot: mavlink_link::dialect::MavAutopilot::MAV_AUTOPILOT_PX4,
        ..Default::default()
    });
    let other = encoded(
        mavlink_link::receiver::Stream {
            system: 2,
            component: 1,
            link: 0,
        },
        &other,
    );
    let (now, from) = (world.now, crate::world::at(crate::world::PX4));
    world.agent.handle_px4(now, from, &other, &mut world.disk);
    world.run(20.0);
    assert_eq!(world.secrets, 0);
    assert!(has(&world, 5), "{} {:?}", world.state(), world.log);
}

#[test]
fn after_each_start_disarmed_the_same_key_gets_a_new_stamp_and_recordings_die() {
    let restamping = Settings {
        restamp: true,
        ..settings()
    };
    let disk = Disk::with(Some(key(5)));
    let mut world = World::with(restamping.clone(), disk, Signing::with_key(key(5), 0));
    world.run(5.0);
    assert_eq!(world.secrets, 1, "{:?}", world.log);
    let stored = world.px4.signing().stored_stamp();
    assert!(stored > 37_000_000_000_000);
    assert!(has(&world, 5));
    let now = world.now;
    let recorded = world.ground.as_mut().unwrap().frame(now, &arm());
    world.run(70.0);
    world.px4.restart();
    world.run(5.0);
    assert_eq!(world.secrets, 2);
    assert!(has(&world, 5));
    // Played at PX4 itself, past the agent, after yet another start.
    world.px4.restart();
    world.px4.handle_datagram(0, crate::world::at(9), &recorded);
    assert_eq!(world.px4.counters(0).dropped_old_stream, 1);
    let view = FrameView::parse(&recorded).unwrap();
    assert!(view.is_signed());
}

#[test]
fn nothing_from_the_radio_gives_px4_a_key() {
    for mut world in [World::live(), first(), rotation()] {
        let now = world.now;
        let stamp = Stamp::from_unix(now.wall);
        for signature in [None, Some((&key(5), stamp)), Some((&key(6), stamp))] {
            let mut payload = [9; 42];
            payload[..8].copy_from_slice(&stamp.get().to_le_bytes());
            let setup = frame(VSM, 256, &payload, signature);
            assert!(!world.passes(GROUND, &setup));
        }
        assert!(!world.px4_has(&key(9)));
    }
    // And an agent that begins again has nothing either.
    let mut disk = Disk::default();
    let world = World::live();
    let agent = start(settings(), &mut disk, world.now);
    assert_eq!(agent.status(String::new(), world.now.mono).state, "no key");
}

#[test]
fn a_key_that_was_replaced_never_comes_into_force_again() {
    let mut world = rotation();
    world.run(25.0);
    assert!(has(&world, 6));
    // A power cut brings PX4's old file back, and the way to PX4 loses every SETUP_SIGNING.
    let stamp = Stamp::from_unix(world.now.after(Duration::from_secs(60)).wall);
    world.px4 = px4_sim::Autopilot::new(
        px4_sim::Config::default(),
        Signing::with_key(key(5), stamp.get()),
        vec![Some(crate::world::at(9))],
    );
    world.cannot_sign = true;
    world.run(90.0);
    // Whoever holds the old key, which was replaced for that reason, speaks in the VSM's name.
    let mut thief = Ground::new(key(5), world.now.after(Duration::from_secs(5)));
    world.now = world.now.after(Duration::from_secs(10));
    let bytes = thief.frame(world.now, &arm());
    assert!(!world.passes(GROUND, &bytes), "{}", world.state());
    // The way is open again: PX4 gets the key in force, and the ground's frames arrive.
    world.cannot_sign = false;
    world.run(60.0);
    assert!(has(&world, 6), "{}", world.state());
}

#[test]
fn a_recording_from_before_a_rotation_does_not_make_the_agent_give_px4_its_key_again() {
    let mut world = rotation();
    let px4 = Stream {
        system: 1,
        component: 1,
        link: 0,
    };
    let recorded = frame(
        px4,
        253,
        &[6, 1],
        Some((&key(5), Stamp::from_unix(world.now.wall))),
    );
    world.run(25.0);
    assert!(has(&world, 6), "{:?}", world.log);
    assert!(world.disk.previous.is_some());
    let secrets = world.secrets;
    for _ in 0..3 {
        world
            .agent
            .handle_px4(world.now, at(PX4), &recorded, &mut world.disk);
        world.drain();
        world.run(1.0);
    }
    assert_eq!(
        (world.state(), world.secrets),
        ("relaying", secrets),
        "{:?}",
        world.log
    );
}

#[test]
fn a_px4_whose_old_key_file_came_back_is_given_the_key_again_however_old_its_stamps() {
    let mut world = rotation();
    world.run(25.0);
    assert!(
        has(&world, 6) && world.disk.previous.is_some(),
        "{:?}",
        world.log
    );
    world.px4 = px4_sim::Autopilot::new(
        px4_sim::Config::default(),
        Signing::with_key(key(5), 1),
        vec![Some(at(9))],
    );
    world.run(30.0);
    assert!(has(&world, 6), "{} {:?}", world.state(), world.log);
}
