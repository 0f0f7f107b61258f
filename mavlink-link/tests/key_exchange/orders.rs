//! An order to zeroize between paired ends: that it arrives, and that nobody else's does.

use core::time::Duration;

use mavlink_link::exchange::{
    AutopilotKey, Identity, Ignored, Inbound, Initiator, InitiatorConfig, InitiatorEvent,
    InitiatorMemory, Message, Parties, Received, Responder, ResponderConfig, ResponderEvent,
    ResponderMemory, Step, Trust, ZeroizeRefusal, ZeroizeReport,
};

use crate::disks::GroundDisk;
use crate::world::{AIR, Dice, GROUND, HONEST, Parcel, WANTED, Weather, World, ms, parties, wire};

fn order(world: &mut World, in_flight: bool) {
    let now = world.now;
    let ground = world.ground.as_mut().unwrap();
    let ordered = ground.order_zeroize(now, in_flight, &mut world.dice.fill());
    assert_eq!(ordered, Ok(true));
}

/// Paired, settled, and ordered.
fn ordered(seed: u64) -> World {
    let mut world = World::paired(seed);
    world.run_until_settled(Duration::from_secs(60)).unwrap();
    world.tape.clear();
    order(&mut world, false);
    world
}

fn run(world: &mut World, span: Duration) {
    let end = world.now + span;
    world.run_until(end);
}

/// How often the agent was ordered to erase itself.
fn orders(world: &World) -> usize {
    let events = world.air_events.iter();
    events
        .filter(|event| matches!(event, ResponderEvent::Zeroize { .. }))
        .count()
}

fn reports(world: &World) -> Vec<Option<ZeroizeReport>> {
    let events = world.events.iter();
    events
        .filter_map(|event| match event {
            InitiatorEvent::Zeroize { report } => Some(*report),
            _ => None,
        })
        .collect()
}

fn report(world: &mut World, report: ZeroizeReport) {
    world.air.as_mut().unwrap().report_zeroize(report);
    run(world, ms(100));
}

fn ignored(world: &World, reason: Ignored) -> u64 {
    world.air.as_ref().unwrap().stats().count_of(reason)
}

/// All that the ground has sent of it.
fn recorded(world: &World) -> Vec<Vec<u8>> {
    let tape = world.tape.iter();
    tape.filter_map(|parcel| match parcel {
        Parcel::Up(payload) if step(payload) == Step::Order => Some(payload.clone()),
        _ => None,
    })
    .collect()
}

fn step(payload: &[u8]) -> Step {
    match Message::parse(payload).unwrap() {
        Received::Exchange(message) => message.step,
        Received::Legacy(_) => panic!("legacy"),
    }
}

const PENDING: ZeroizeReport = ZeroizeReport::Stored(AutopilotKey::Pending);
const DONE: ZeroizeReport = ZeroizeReport::Stored(AutopilotKey::Replaced);
const REFUSED: ZeroizeReport = ZeroizeReport::Refused(ZeroizeRefusal::InFlight);

#[test]
fn an_order_arrives_once_and_what_comes_of_it_comes_back() {
    let mut world = ordered(1);
    run(&mut world, ms(3_000));
    // Sent again and again until the agent has decided.
    assert!(recorded(&world).len() > 3);
    assert_eq!(orders(&world), 1);
    assert!(
        world
            .air_events
            .contains(&ResponderEvent::Zeroize { in_flight: false })
    );
    report(&mut world, PENDING);
    assert!(world.ground.as_ref().unwrap().is_ordering());
    run(&mut world, ms(12_000));
    report(&mut world, DONE);
    assert_eq!(reports(&world), [Some(PENDING), Some(DONE)]);
    assert!(!world.ground.as_ref().unwrap().is_ordering());
    // And that it is meant in flight, too.
    order(&mut world, true);
    run(&mut world, ms(500));
    assert!(
        world
            .air_events
            .contains(&ResponderEvent::Zeroize { in_flight: true })
    );
}

#[test]
fn an_order_passes_a_link_that_loses_four_of_ten() {
    for seed in 0..20 {
        let mut world = ordered(100 + seed);
        world.weather = Weather {
            loss: 40,
            double: 10,
            late: 20,
            most_late: ms(1_500),
        };
        for _ in 0..80 {
            run(&mut world, ms(100));
            if orders(&world) == 1 && reports(&world).is_empty() {
                world.air.as_mut().unwrap().report_zeroize(DONE);
            }
        }
        assert_eq!(orders(&world), 1, "seed {seed}");
        assert_eq!(reports(&world), [Some(DONE)], "seed {seed}");
    }
}

#[test]
fn an_agent_that_does_not_answer_is_reported_and_nobody_waits_for_it() {
    let mut world = ordered(2);
    world.air = None;
    run(&mut world, ms(7_900));
    assert_eq!(reports(&world), []);
    run(&mut world, ms(200));
    assert_eq!(reports(&world), [None]);
    // One that falls silent after it has stored the order: that stands.
    let mut world = ordered(3);
    run(&mut world, ms(500));
    report(&mut world, PENDING);
    world.air = None;
    run(&mut world, Duration::from_secs(9));
    let lost = ZeroizeReport::Stored(AutopilotKey::NotReached);
    assert_eq!(reports(&world), [Some(PENDING), Some(lost)]);
    assert!(!world.ground.as_ref().unwrap().is_ordering());
}

#[test]
fn a_recorded_order_orders_nothing() {
    let mut world = ordered(4);
    run(&mut world, ms(1_000));
    // Refused in the air, and played again once the vehicle has landed.
    report(&mut world, REFUSED);
    assert_eq!(reports(&world), [Some(REFUSED)]);
    let tape = recorded(&world);
    for payload in &tape {
        for (from, verified) in [(HONEST, false), (99, false), (HONEST, true)] {
            world.air_hears(from, GROUND, verified, payload);
        }
    }
    assert_eq!(orders(&world), 1);
    // Its challenge holds no more.
    run(&mut world, Duration::from_secs(21));
    let before = ignored(&world, Ignored::Challenge);
    tape.iter()
        .for_each(|payload| world.air_hears(HONEST, GROUND, false, payload));
    assert!(ignored(&world, Ignored::Challenge) > before);
    // Nor after a restart, which forgets what was refused.
    world.start_air();
    tape.iter()
        .for_each(|payload| world.air_hears(HONEST, GROUND, true, payload));
    assert!(ignored(&world, Ignored::Challenge) > 0);
    assert_eq!(orders(&world), 1);
}

#[test]
fn an_order_that_was_held_back_orders_nothing_later() {
    let mut world = ordered(5);
    world.held.get_or_insert_default();
    // The attacker passes on all but the order itself.
    let mut caught = vec![];
    for _ in 0..60 {
        run(&mut world, ms(100));
        let parcels: Vec<Parcel> = world.held.as_mut().unwrap().drain(..).collect();
        for parcel in parcels {
            let is_order = matches!(&parcel, Parcel::Up(payload) if payload.len() > 80
                && payload[43 + 16..43 + 32] != [0; 16]);
            match is_order {
                true => caught.push(parcel),
                false => world.deliver(&parcel),
            }
        }
    }
    assert!(!caught.is_empty());
    assert_eq!(orders(&world), 0);
    run(&mut world, Duration::from_secs(21));
    assert_eq!(reports(&world), [None]);
    caught.iter().for_each(|parcel| world.deliver(parcel));
    assert_eq!(orders(&world), 0);
    assert_eq!(ignored(&world, Ignored::Challenge), caught.len() as u64);
}

fn initiator(identity: Identity, parties: Parties, world: &World) -> Initiator {
    let config = InitiatorConfig {
        parties,
        identity,
        trust: Trust::Pinned(world.air_identity().public()),
        wanted: WANTED,
    };
    Initiator::new(config, InitiatorMemory::default(), world.now)
}

/// Orders from an initiator until it gives up, its messages taken for frames that verify under the signing key; what the agent
/// ignores them for.
fn plays(world: &mut World, mut ground: Initiator, dice: u64) {
    let mut dice = Dice::new(dice);
    let now = world.now;
    assert_eq!(ground.order_zeroize(now, true, &mut dice.fill()), Ok(true));
    for _ in 0..20 {
        let clock = world.clock();
        ground.handle_timeout(clock, &mut dice.fill(), &mut GroundDisk::default());
        while let Some(message) = ground.poll_transmit() {
            world.air_hears(HONEST, GROUND, true, &wire(&message.to_payload()));
        }
        run(world, ms(500));
    }
}

#[test]
fn who_has_the_signing_key_alone_orders_nothing() {
    let mut world = World::paired(6);
    world.run_until_settled(Duration::from_secs(60)).unwrap();
    // A program with the signing key, whose frames verify, and a static key of its own.
    let stranger = initiator(Identity::new([9; 32]), parties(), &world);
    plays(&mut world, stranger, 1);
    assert!(ignored(&world, Ignored::Forged) > 10);
    assert_eq!(orders(&world), 0);
    // Each byte of an honest order that is bent.
    order(&mut world, true);
    run(&mut world, ms(1_000));
    assert_eq!(orders(&world), 1);
    let good = recorded(&world).pop().unwrap();
    let before = ignored(&world, Ignored::Forged);
    for at in 43..good.len() {
        let mut bent = good.clone();
        bent[at] ^= 1;
        world.air_hears(HONEST, GROUND, true, &bent);
    }
    assert_eq!(
        ignored(&world, Ignored::Forged) - before,
        (good.len() - 43) as u64
    );
    assert_eq!(orders(&world), 1);
}

#[test]
fn an_order_to_another_vehicle_orders_nothing_here() {
    let mut world = World::paired(7);
    world.run_until_settled(Duration::from_secs(60)).unwrap();
    // The same two static keys, as where a store was copied to another vehicle's computer, and another vehicle id.
    let others = Parties::new(GROUND, AIR, 0x1b00_0001, 0x1b00_0102);
    let theirs = initiator(world.ground_identity().duplicate(), others, &world);
    plays(&mut world, theirs, 2);
    assert!(ignored(&world, Ignored::Target) > 10);
    // Another agent of the same ground has another static key.
    order(&mut world, true);
    run(&mut world, ms(1_000));
    let config = ResponderConfig {
        parties: parties(),
        identity: Identity::new([8; 32]),
        wanted: WANTED,
    };
    let memory = ResponderMemory {
        peer: world.air_disk.peer,
        ..ResponderMemory::default()
    };
    let mut other: Responder<u8> = Responder::new(config, memory, world.now);
    let tape = recorded(&world);
    for payload in &tape {
        let inbound = Inbound {
            from: HONEST,
            source: GROUND,
            verified: true,
            payload,
        };
        let (now, disk) = (world.now, &mut world.air_disk);
        let taken = other.handle(now, inbound, &mut world.dice.fill(), disk);
        assert_eq!(taken, Err(Ignored::Forged));
    }
    assert_eq!(other.stats().count_of(Ignored::Forged), tape.len() as u64);
    assert!(other.poll_event().is_none());
    assert_eq!(orders(&world), 1);
}

#[test]
fn an_earlier_report_does_not_answer_a_later_order() {
    let mut world = ordered(8);
    run(&mut world, ms(1_000));
    report(&mut world, REFUSED);
    let down: Vec<Vec<u8>> = world
        .tape
        .iter()
        .filter_map(|parcel| match parcel {
            Parcel::Down(payload) if step(payload) == Step::Report => Some(payload.clone()),
            _ => None,
        })
        .collect();
    world.air = None;
    order(&mut world, false);
    run(&mut world, ms(1_000));
    let count = |world: &World| {
        let stats = world.ground.as_ref().unwrap().stats();
        stats.count_of(Ignored::Session)
    };
    let before = count(&world);
    for payload in &down {
        world.ground_hears(AIR, payload);
    }
    assert_eq!(count(&world) - before, down.len() as u64);
    run(&mut world, ms(8_000));
    assert_eq!(reports(&world), [Some(REFUSED), None]);
}
