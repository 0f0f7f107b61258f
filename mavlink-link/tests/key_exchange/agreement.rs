//! The result of an exchange without faults, and its events.

use core::time::Duration;
use std::collections::VecDeque;

use mavlink_link::exchange::{
    InitiatorEvent, KeyInForce, Message, Received, ResponderEvent, Status, Step,
};

use crate::disks::id;
use crate::world::{AIR, Parcel, World, ms};

fn steps(world: &World) -> Vec<(Step, usize)> {
    world
        .tape
        .iter()
        .filter_map(|parcel| match parcel {
            Parcel::Up(payload) | Parcel::Down(payload) => match Message::parse(payload) {
                Ok(Received::Exchange(message)) => {
                    Some((message.step, message.data.as_slice().len()))
                }
                other => panic!("{other:?}"),
            },
            Parcel::Telemetry(_) => None,
        })
        .collect()
}

#[test]
fn four_messages_of_the_stated_sizes_agree_about_a_key_and_the_vehicle_signs_with_it() {
    let mut world = World::paired(1);
    let old = world.autopilot;
    world.run_until(ms(1_200));
    let sizes = [
        // Each with its authenticators, 32 bytes from the ground and 16 from the air, since version 2.
        (Step::Offer, 40 + 32),
        (Step::Answer, 40 + 16),
        (Step::Confirm, 32 + 32),
        (Step::Outcome, 40 + 16),
    ];
    assert_eq!(steps(&world), sizes);
    assert!(world.run_until_settled(Duration::from_secs(10)).is_some());
    assert_ne!(world.autopilot, old);
    let key = id(&world.autopilot.unwrap());
    assert!(world.events.iter().any(
        |event| matches!(event, InitiatorEvent::Agreed { key: agreed, .. } if *agreed == key)
    ));
    assert!(
        world
            .air_events
            .contains(&ResponderEvent::Staged { key, epoch: 1 })
    );
    assert!(!world.ground.as_ref().unwrap().is_busy());
}

#[test]
fn a_pairing_has_four_messages_too_and_pins_both_ends() {
    let mut world = World::pairing(2);
    world.run_until(ms(1_200));
    let sizes = [
        (Step::Offer, 16 + 32),
        (Step::Answer, 88 + 16),
        (Step::Confirm, 88 + 32),
        (Step::Outcome, 40 + 16),
    ];
    assert_eq!(steps(&world), sizes);
    assert!(world.is_paired());
    assert!(world.run_until_settled(Duration::from_secs(10)).is_some());
    assert!(
        world
            .tape
            .iter()
            .all(|parcel| matches!(parcel, Parcel::Up(p) | Parcel::Down(p) if p.len() <= 203))
    );
}

#[test]
fn after_a_pairing_only_the_pinned_keys_count() {
    let mut world = World::pairing(3);
    assert!(world.run_until_settled(Duration::from_secs(30)).is_some());
    let first = world.autopilot;
    let before = world.tape.len();
    world.ground.as_mut().unwrap().want();
    world.run_until(world.now + ms(500));
    assert!(world.run_until_settled(Duration::from_secs(30)).is_some());
    assert_ne!(world.autopilot, first);
    let sizes: Vec<_> = steps(&world)[before..].iter().take(2).copied().collect();
    assert_eq!(sizes, [(Step::Offer, 40 + 32), (Step::Answer, 40 + 16)]);
}

#[test]
fn in_flight_the_key_waits_and_the_ground_is_told_until_it_is_disarmed() {
    let mut world = World::paired(4);
    let old = world.autopilot;
    world.armed = true;
    world.run_until(Duration::from_secs(120));
    assert_eq!(world.autopilot, old);
    assert_eq!(world.ground_disk.current, old);
    let reported: Vec<_> = world
        .events
        .iter()
        .filter_map(|event| match event {
            InitiatorEvent::Status { status, .. } => Some(*status),
            _ => None,
        })
        .collect();
    assert_eq!(reported, [Status::Ok, Status::WaitDisarm]);
    world.armed = false;
    assert!(world.run_until_settled(Duration::from_secs(10)).is_some());
    assert_ne!(world.autopilot, old);
}

#[test]
fn a_key_that_the_autopilot_does_not_take_is_dropped_at_both_ends() {
    let mut world = World::paired(5);
    world.autopilot_refuses = true;
    let old = world.autopilot;
    world.run_until(Duration::from_secs(60));
    assert!(world.is_settled());
    assert_eq!(world.autopilot, old);
    let status = Status::RolledBack;
    assert!(world.events.contains(&InitiatorEvent::Dropped { status }));
    // And another one can be agreed about.
    world.autopilot_refuses = false;
    world.ground.as_mut().unwrap().want();
    world.run_until(Duration::from_secs(70));
    assert!(world.is_settled());
    assert_ne!(world.autopilot, old);
}

#[test]
fn a_hint_starts_an_exchange_at_most_once_in_ten_seconds() {
    let mut world = World::paired(6);
    assert!(world.run_until_settled(Duration::from_secs(30)).is_some());
    world.run_until(world.now + ms(500));
    let begun = |world: &World| {
        let count = world.events.iter();
        count
            .filter(|event| matches!(event, InitiatorEvent::Begun { .. }))
            .count()
    };
    let hint = world.air.as_mut().unwrap().please(world.now).unwrap();
    assert!(world.air.as_mut().unwrap().please(world.now).is_none());
    // What the key in force is, whether the frame was verified under it, and how many attempts 10 s of hints start.
    for (key, verified, attempts) in [
        (KeyInForce::Settled, false, 0),
        (KeyInForce::Young, false, 0),
        (KeyInForce::Young, true, 0),
        (KeyInForce::Settled, true, 1),
        (KeyInForce::None, false, 1),
    ] {
        let before = begun(&world);
        world.ground.as_mut().unwrap().set_key_in_force(key);
        for _ in 0..49 {
            world.ground_hears_as(AIR, verified, &hint.to_payload());
            world.run_until(world.now + ms(200));
        }
        assert_eq!(begun(&world) - before, attempts, "{key:?}, {verified}");
        world.run_until(world.now + Duration::from_secs(10));
    }
}

#[test]
fn an_attempt_that_anybody_may_have_asked_for_ends_with_the_first_proof_of_a_key() {
    let mut world = World::paired(6);
    assert!(world.run_until_settled(Duration::from_secs(30)).is_some());
    world.run_until(world.now + ms(500));
    let hint = world.air.as_mut().unwrap().please(world.now).unwrap();
    world.held = Some(VecDeque::new());
    let ground = world.ground.as_mut().unwrap();
    ground.set_key_in_force(KeyInForce::None);
    world.ground_hears_as(AIR, false, &hint.to_payload());
    world.run_until(world.now + ms(10));
    assert!(world.ground.as_ref().unwrap().is_busy());
    let ground = world.ground.as_mut().unwrap();
    ground.set_key_in_force(KeyInForce::Settled);
    assert!(!ground.is_busy());
    // An honest wish stays.
    ground.want();
    ground.set_key_in_force(KeyInForce::Settled);
    assert!(ground.is_busy());
}

#[test]
fn two_exchanges_never_give_the_same_key() {
    let mut keys = std::collections::BTreeSet::new();
    let mut world = World::paired(7);
    for _ in 0..5 {
        assert!(world.run_until_settled(Duration::from_secs(30)).is_some());
        assert!(keys.insert(world.autopilot));
        world.run_until(world.now + ms(500));
        world.ground.as_mut().unwrap().want();
        world.run_until(world.now + ms(500));
    }
}
