//! Each step of a rollover, and what delays it.

use std::time::Duration;

use mavlink_link::clock::Origin;
use mavlink_link::provisioning::{
    Event, KeyRollover, KeyRolloverConfig, Outcome, StartError, State,
};
use mavlink_link::receiver::KeyState;
use mavlink_link::store::MemoryDisk;

use super::px4::Px4;
use super::world::{World, config, start};
use crate::support::{BUILD, at, key, other_key};

#[test]
fn a_first_key_goes_to_an_unsigned_vehicle() {
    let mut world = World::new(None);
    assert_eq!(world.settle(30), Some(Outcome::Committed));
    assert!(world.px4.has(&other_key()));
    assert!(world.keys.current.as_ref().unwrap().same_as(&other_key()));
    use State::{Committed, Sent, Staged, WaitDisarm};
    assert_eq!(world.states(), [Staged, WaitDisarm, Sent, Committed]);
    assert!(
        world.now.mono >= Duration::from_secs(10),
        "the line was watched first"
    );
    assert_eq!(world.secrets, 1);
}

#[test]
fn a_key_is_rotated_and_the_link_goes_on_under_the_new_one() {
    let mut world = World::new(Some(key()));
    assert_eq!(world.settle(30), Some(Outcome::Committed));
    assert!(world.px4.has(&other_key()));
    assert!(world.keys.previous.as_ref().unwrap().same_as(&key()));
    let keys = world.ours.into_key_in_force().unwrap();
    assert_eq!(keys.id(), other_key().id());
    assert!(keys.clock().floor() < keys.clock().reading(world.now));
}

#[test]
fn pitfall_14_signing_is_not_switched_over_before_the_vehicle_has_taken_the_key() {
    let mut world = World::new(Some(key()));
    world.run(9);
    // The key is lost on its way: nothing is committed on hope.
    world.mute = true;
    world.until_sent();
    assert_eq!(world.ours.state(), State::Sent);
    assert!(world.keys.current.as_ref().unwrap().same_as(&key()));
    world.mute = false;
    assert_eq!(world.settle(60), Some(Outcome::Committed));
    assert!(
        world.states().contains(&State::NotTaken),
        "and sent again: {:?}",
        world.states()
    );
    assert!(world.keys.current.as_ref().unwrap().same_as(&other_key()));
}

#[test]
fn pitfall_23_a_power_cut_that_leaves_the_vehicle_unsigned_is_mended() {
    let mut world = World::new(Some(key()));
    assert_eq!(world.settle(30), Some(Outcome::Committed));
    // Its file was truncated, and not yet written.
    world.px4.file = None;
    world.px4.reboot();
    world.run(30);
    assert!(world.history.contains(&Event::FellBack));
    assert_eq!(world.ours.outcome(), Some(Outcome::Committed));
    assert!(world.px4.has(&other_key()));
}

#[test]
fn pitfall_27_silence_is_no_refusal_and_the_key_that_was_taken_is_kept() {
    let mut world = World::new(Some(key()));
    world.until_sent();
    assert!(world.px4.has(&other_key()), "it took the key at once");
    // From here on nothing of it reaches us, for a quarter of an hour.
    world.lost = (world.datagrams + 1..world.datagrams + 20_000).collect();
    world.run(900);
    assert_eq!(
        (world.ours.state(), world.ours.outcome()),
        (State::Unknown, None)
    );
    assert!(world.keys.holds(&key()) && world.keys.holds(&other_key()));
    world.lost.clear();
    assert_eq!(world.settle(15), Some(Outcome::Committed));
    assert_eq!(world.secrets, 1, "nothing was sent into the silence");
}

#[test]
fn an_armed_vehicle_is_not_sent_a_key() {
    let mut world = World::new(Some(key()));
    world.px4.armed = true;
    world.run(60);
    assert_eq!((world.ours.state(), world.secrets), (State::WaitDisarm, 0));
    world.px4.armed = false;
    assert_eq!(world.settle(5), Some(Outcome::Committed));
}

#[test]
fn a_vehicle_that_arms_just_then_is_waited_for() {
    let mut world = World::new(Some(key()));
    world.run(5);
    world.px4.armed = true;
    world.run(10);
    assert_eq!((world.ours.state(), world.secrets), (State::WaitDisarm, 0));
    // It reports disarmed; when the key arrives it is armed.
    (world.px4.armed, world.arms) = (false, true);
    while world.secrets < 2 {
        world.px4.armed = false;
        assert!(world.tick < 600);
        world.step();
    }
    world.run(20);
    world.arms = false;
    assert!(world.history.contains(&Event::RefusedWhileArmed));
    assert_eq!(world.ours.outcome(), None);
    world.px4.armed = false;
    assert_eq!(world.settle(10), Some(Outcome::Committed));
}

#[test]
fn a_vehicle_that_never_signs_is_told_apart() {
    let mut world = World::new(None);
    world.px4.can_sign = false;
    assert_eq!(world.settle(60), Some(Outcome::NeverSigns));
    assert_eq!(world.secrets, 3);
    assert!(
        world.keys.next.is_some(),
        "unsigned frames prove nothing: the key stays"
    );
}

#[test]
fn a_vehicle_that_keeps_its_key_has_the_new_one_taken_back_after_half_a_minute() {
    let mut world = World::new(Some(key()));
    world.px4.can_sign = false;
    assert_eq!(world.settle(120), Some(Outcome::RolledBack));
    assert_eq!(world.secrets, 3);
    assert!(world.keys.next.is_none() && world.keys.current.as_ref().unwrap().same_as(&key()));
    let back = world
        .states()
        .iter()
        .position(|&s| s == State::RolledBack)
        .unwrap();
    assert_eq!(world.states().len(), back + 1);
}

/// No peer would meet a clock that begins there, so the key would have to be replaced by a person.
#[test]
fn a_first_key_begins_at_no_timestamp_of_the_last_years_of_the_48_bits() {
    let mut world = World::new(None);
    // 2096.
    world.now.wall = Duration::from_secs(3_976_214_400);
    world.ours = start(&world.keys, &mut world.disk, world.now);
    assert_eq!(world.settle(30), Some(Outcome::Committed));
    let year = Duration::from_secs(366 * 86_400);
    assert!(world.px4.clock < BUILD.plus(year), "{:?}", world.px4.clock);
}

/// A process was ended before it had sent the key, or its clocks were lost after it had: a rollover that may not send
/// a key finds out which one the vehicle has.
#[test]
fn who_may_not_send_the_key_finds_out_which_one_the_vehicle_has() {
    for (vehicle_has, expected) in [
        (key(), Outcome::RolledBack),
        (other_key(), Outcome::Committed),
    ] {
        let mut world = World::new(Some(key()));
        world.px4 = Px4::new(Some(vehicle_has));
        let current = KeyState::start(key(), Origin::KeyFile, BUILD, world.now, &mut world.disk);
        let asks = KeyRolloverConfig {
            may_send_key: false,
            ..config()
        };
        let (now, disk) = (world.now, &mut world.disk);
        world.ours = KeyRollover::start(asks, current.ok(), other_key(), now, disk).unwrap();
        assert_eq!(world.settle(60), Some(expected), "{:?}", world.history);
        assert_eq!(world.secrets, 0, "no key was sent");
    }
}

#[test]
fn the_same_key_again_is_no_handover() {
    let mut disk = MemoryDisk::default();
    let old = KeyState::start(key(), Origin::KeyFile, BUILD, at(0), &mut disk).unwrap();
    let refused = KeyRollover::start(config(), Some(old), key(), at(0), &mut disk);
    assert_eq!(refused.map(|_| ()).unwrap_err(), StartError::SameKey);
}

#[test]
fn a_disk_that_fails_holds_the_key_back_until_it_works() {
    let mut world = World::new(Some(key()));
    world.run(5);
    world.disk.full = Some("");
    world.run(20);
    assert_eq!(
        world.secrets, 0,
        "a key whose clock is not stored is never sent"
    );
    world.disk.full = None;
    assert_eq!(world.settle(30), Some(Outcome::Committed));
}
