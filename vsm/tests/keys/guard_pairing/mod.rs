//! The guard of a CUCS and its VSM pair by a code and replace their key over the air: under loss, restarts at any write, replay,
//! and everybody else.

mod world;

use std::time::Duration;

use mavlink_link::exchange::{Identity, PairingCode};
use stanag_msgs::Id;
use stanag_msgs::guard::{Direction, ExchangeDatagram};
use vsm::guard_exchange::{CucsNews, OpenError, VsmNews};
use vsm::shell::guard_file;

use self::world::{AT, CUCS, World};

fn another_code(world: &mut World) -> PairingCode {
    PairingCode::generate(&mut world.dice.fill()).unwrap()
}

/// The CUCS's datagrams arrive, and it is sent what is for it.
fn assert_they_speak(world: &mut World) {
    // What was on its way, or is lifted after a restart.
    world.run(1);
    (world.taken, world.refused, world.answered) = (0, 0, 0);
    world.run(5);
    assert!(world.taken >= 20, "{} taken", world.taken);
    assert!(world.answered >= 20, "{} answered", world.answered);
    assert_eq!(world.refused, 0);
}

#[test]
fn a_code_leaves_both_ends_with_one_key_and_a_request_with_another() {
    let mut world = World::paired(1);
    assert_they_speak(&mut world);
    let first = world.key();
    assert!(first.is_some());
    (world.taken, world.refused) = (0, 0);
    world.rotate();
    assert!(world.run_until(5, |world| world.is_settled() && world.key() != first));
    world.run(5);
    assert_eq!(world.refused, 0, "nothing is lost by it");
    assert!(world.taken >= 20);
    assert!(
        world
            .news
            .iter()
            .any(|news| matches!(news, VsmNews::Agreed(_)))
    );
    assert_they_speak(&mut world);
    // Over restarts of both.
    let second = world.key();
    world.restart_vsm(usize::MAX);
    world.restart_cucs(usize::MAX);
    world.run(3);
    assert!(world.is_settled());
    assert_eq!(world.key(), second);
    assert_they_speak(&mut world);
    // Both files, and nobody else may read them.
    for name in [".previous", ".pairing", ""] {
        let path = format!("{}{name}", world.vsm_key().display());
        let mode = std::os::unix::fs::PermissionsExt::mode(
            &std::fs::metadata(path).unwrap().permissions(),
        );
        assert_eq!(mode & 0o777, 0o600, "{name}");
    }
}

#[test]
fn each_step_may_be_lost_and_four_in_ten_of_all_datagrams() {
    for lose in 1..=4 {
        let mut world = World::strangers(lose);
        world.lose = Some(lose as usize);
        assert!(world.run_until(60, World::is_settled), "step {lose}");
        let first = world.key();
        world.rotate();
        // The request itself is the person's to repeat.
        world.steps = 0;
        let done = |world: &World| world.is_settled() && world.key() != first;
        assert!(world.run_until(60, done), "step {lose} of a rotation");
        world.lose = None;
        assert_they_speak(&mut world);
    }
    for seed in 0..20 {
        let mut world = World::strangers(100 + seed);
        (world.loss, world.double) = (40, 20);
        assert!(world.run_until(200, World::is_settled), "seed {seed}");
    }
}

#[test]
fn an_end_that_is_ended_at_any_write_of_a_pairing_finds_the_other_again() {
    let mut ended = 0;
    for writes in 1..12 {
        // The guard: started by a person, with so many writes before it is ended.
        let mut world = World::strangers(writes as u64);
        world.leave_alone(Some(30));
        world.open_window();
        let code = world.code.duplicate();
        world.pair_cucs(code, writes);
        world.run(5);
        ended += usize::from(!world.is_settled());
        assert!(
            world.run_until(150, World::is_settled),
            "guard, write {writes}"
        );
        assert_they_speak(&mut world);
        // The VSM.
        let mut world = World::strangers(50 + writes as u64);
        world.restart_vsm(writes);
        assert!(
            world.run_until(150, World::is_settled),
            "VSM, write {writes}"
        );
        assert_they_speak(&mut world);
    }
    assert!(ended > 3, "the first writes end it: {ended}");
}

#[test]
fn an_end_that_is_ended_at_any_write_of_a_rotation_costs_the_cucs_nothing() {
    for writes in 1..12 {
        for vsm in [false, true] {
            let mut world = World::paired(200 + writes as u64);
            let first = world.key();
            match vsm {
                true => world.restart_vsm(writes),
                false => world.restart_cucs(writes),
            }
            world.run(2);
            (world.taken, world.refused, world.answered) = (0, 0, 0);
            world.rotate();
            world.run(100);
            let place = format!(
                "write {writes} of {}",
                if vsm { "the VSM" } else { "the guard" }
            );
            assert!(world.is_settled(), "{place}");
            // At most what was on its way when a process ended, out of 500; a restart lifts the stamps.
            assert!(
                world.taken > 480,
                "{place}: {} taken, {} refused",
                world.taken,
                world.refused
            );
            assert!(world.answered > 480, "{place}: {} answered", world.answered);
            // Cut off before its first write it may be asked again.
            if world.key() == first {
                world.rotate();
                assert!(
                    world.run_until(20, |world| world.is_settled() && world.key() != first),
                    "{place}"
                );
            }
            assert_they_speak(&mut world);
        }
    }
}

#[test]
fn who_does_not_know_the_code_is_named_and_keeps_nobody_from_pairing() {
    let mut world = World::strangers(7);
    world.leave_alone(None);
    world.open_window();
    let wrong = another_code(&mut world);
    world.pair_cucs(wrong, usize::MAX);
    world.run(25);
    assert!(world.news.contains(&VsmNews::WrongCode));
    assert_eq!(world.key(), None);
    assert!(!world.cucs_has_next());
    assert!(world.cucs_news.contains(&CucsNews::NotAnswered));
    // The window is still open for who knows it.
    let code = world.code.duplicate();
    world.pair_cucs(code, usize::MAX);
    assert!(world.run_until(10, World::is_settled));
    assert_they_speak(&mut world);
}

#[test]
fn without_a_window_the_code_is_worth_nothing_and_a_window_is_for_one_pairing() {
    let mut world = World::strangers(8);
    world.leave_alone(None);
    let code = world.code.duplicate();
    world.pair_cucs(code, usize::MAX);
    for n in 0..100 {
        let step = first_step(&mut world);
        world.arrive_at_vsm(([10, 0, 0, n], 1).into(), &step);
    }
    world.run(20);
    assert_eq!(world.key(), None);
    let answers = |(way, bytes): &&(Direction, Vec<u8>)| {
        *way == Direction::ToCucs && ExchangeDatagram::parse(bytes).is_some()
    };
    // At most a refusal, which proves nothing and is shorter than what it answers.
    for (_, answer) in world.tape.iter().filter(answers) {
        assert!(answer.len() < 60, "{}", answer.len());
    }

    let mut world = World::paired(9);
    let first = world.key();
    // The code was used: whoever reads it now, from the screen or the tape, is somebody else.
    let code = world.code.duplicate();
    world.pair_cucs(code, usize::MAX);
    world.run(25);
    assert_eq!(world.key(), first);
    assert!(
        !world
            .news
            .iter()
            .any(|news| matches!(news, VsmNews::Agreed(_)))
    );
}

/// Step 1 of a guard that knows the code.
fn first_step(world: &mut World) -> Vec<u8> {
    use mavlink_link::exchange::{Initiator, InitiatorConfig, Parties, Trust, Wanted};
    struct Nothing;
    impl mavlink_link::exchange::InitiatorStore for Nothing {
        fn store_counter(&mut self, _: u64) -> Result<(), mavlink_link::exchange::StoreError> {
            Ok(())
        }
        fn promote_next(&mut self) -> Result<(), mavlink_link::exchange::StoreError> {
            Ok(())
        }
        fn store_next(
            &mut self,
            _: &mavlink_link::exchange::Agreed,
        ) -> Result<(), mavlink_link::exchange::StoreError> {
            Ok(())
        }
        fn drop_next(&mut self) -> Result<(), mavlink_link::exchange::StoreError> {
            Ok(())
        }
        fn pin(
            &mut self,
            _: &mavlink_link::exchange::PublicKey,
        ) -> Result<(), mavlink_link::exchange::StoreError> {
            Ok(())
        }
    }
    let config = InitiatorConfig {
        parties: Parties::of_guard(world::VSM.0, CUCS.0),
        identity: Identity::generate(&mut world.dice.fill()).unwrap(),
        trust: Trust::Pairing(world.code.duplicate()),
        wanted: Wanted {
            signing: true,
            confidential: false,
        },
    };
    let now = world.clock();
    let mut initiator = Initiator::new(
        config,
        mavlink_link::exchange::InitiatorMemory::default(),
        now.mono,
    );
    initiator.want();
    initiator.handle_timeout(now, &mut world.dice.fill(), &mut Nothing);
    let step = initiator.poll_transmit().expect("step 1");
    let step = ExchangeDatagram {
        direction: Direction::ToVsm,
        cucs: CUCS,
        vsm: world::VSM,
        payload: &step.to_payload(),
    };
    step.to_bytes()
}

#[test]
fn a_second_window_is_refused_while_one_is_open() {
    let mut world = World::strangers(10);
    world.leave_alone(None);
    let other = Id(0x1b00_00a1);
    let code = world.code.duplicate();
    let now = world.now;
    let vsm = world.vsm.as_mut().unwrap();
    vsm.end.set(other, Default::default(), now);
    assert_eq!(
        vsm.end.open_window(now, other, &code, &mut vsm.files),
        Ok(())
    );
    assert_eq!(
        vsm.end.open_window(now, CUCS, &code, &mut vsm.files),
        Err(OpenError::Open(other))
    );
    assert_eq!(
        vsm.end
            .open_window(now + Duration::from_secs(601), Id(5), &code, &mut vsm.files),
        Err(OpenError::Unknown(Id(5)))
    );
    // A code for one CUCS is none for another: the ids are what both ends must know alike.
    world.pair_cucs(code, usize::MAX);
    world.run_until(1, |_| false);
    assert_eq!(world.key(), None);
}

#[test]
fn a_recording_of_pairing_and_rotation_changes_nothing_over_restarts_of_both() {
    let mut world = World::paired(11);
    world.rotate();
    world.run(5);
    let (tape, key) = (world.whole_tape(), world.key());
    assert!(tape.len() > 50);
    for round in 0..4 {
        match round {
            1 => world.restart_vsm(usize::MAX),
            2 => world.restart_cucs(usize::MAX),
            // While a window is open for somebody else.
            3 => assert!(world.open_window()),
            _ => {}
        }
        (world.taken, world.answered) = (0, 0);
        world.news.clear();
        for (way, bytes) in &tape {
            match way {
                Direction::ToVsm => drop(world.arrive_at_vsm(AT.into(), bytes)),
                _ => world.arrive_at_cucs(bytes),
            }
        }
        assert_eq!((world.taken, world.answered), (0, 0), "round {round}");
        world.whole_tape();
        assert_eq!(world.key(), key, "round {round}");
        assert!(!world.cucs_has_next(), "round {round}");
        assert!(
            !world
                .news
                .iter()
                .any(|news| matches!(news, VsmNews::Agreed(_)))
        );
    }
    world.vsm.as_mut().unwrap().end.close_window();
    assert_they_speak(&mut world);
}

#[test]
fn whoever_is_in_the_middle_can_only_be_in_the_way() {
    // Each byte of each step bent once, and each step cut: nothing but the honest bytes get anywhere.
    let mut world = World::paired(12);
    world.rotate();
    world.run(5);
    let steps: Vec<_> = world
        .tape
        .clone()
        .into_iter()
        .filter(|(_, bytes)| ExchangeDatagram::parse(bytes).is_some())
        .collect();
    assert!(steps.len() >= 8, "{}", steps.len());
    let key = world.key();
    for (way, bytes) in steps {
        for at in 0..bytes.len() {
            let mut bent = bytes.clone();
            bent[at] ^= 1 << world.dice.0.u32(0..8);
            let cut = &bytes[..at];
            for bytes in [&bent[..], cut] {
                match way {
                    Direction::ToVsm => drop(world.arrive_at_vsm(AT.into(), bytes)),
                    _ => world.arrive_at_cucs(bytes),
                }
            }
        }
    }
    world.run(1);
    assert_eq!(world.key(), key);
    assert!(!world.cucs_has_next());
    // One who answers in the VSM's place, with a key of his own, and does not know the code.
    let mut world = World::strangers(13);
    world.leave_alone(None);
    let mut thief = World::strangers(14);
    thief.open_window();
    let code = world.code.duplicate();
    world.pair_cucs(code, usize::MAX);
    for _ in 0..200 {
        world.now += Duration::from_millis(50);
        thief.now = world.now;
        let step = first_step(&mut world);
        thief.arrive_at_vsm(AT.into(), &step);
        let vsm = thief.vsm.as_mut().unwrap();
        while let Some((_, answer)) = vsm.end.poll_transmit() {
            world.arrive_at_cucs(&answer);
        }
    }
    assert!(!world.cucs_has_next());
    assert_eq!(thief.key(), None);
}

#[test]
fn a_request_for_another_key_counts_only_where_the_key_in_force_has_sealed_it_and_once() {
    let mut world = World::paired(15);
    let key = world.key();
    world.restart_cucs(usize::MAX);
    world.run(2);
    world.rotate();
    let sealed = world.tape.last().expect("it was sent").1.clone();
    let please = vsm_please(&sealed);
    world.run(5);
    let second = world.key();
    assert_ne!(second, key);
    // The recording, and what is inside without its seal.
    for _ in 0..3 {
        world.run(15);
        world.arrive_at_cucs(&sealed);
        world.arrive_at_cucs(&please);
        world.run(1);
        assert_eq!(world.key(), second);
    }
}

/// What a sealed datagram carries: everything but its trailer.
fn vsm_please(sealed: &[u8]) -> Vec<u8> {
    sealed[..sealed.len() - stanag_msgs::guard::TRAILER_BYTES].to_vec()
}

#[test]
fn a_key_that_is_revoked_ends_the_pairing_too() {
    let mut world = World::paired(16);
    let path = world.vsm_key();
    let revoked = guard_file::revoke(&path).unwrap().id();
    // Before the VSM reads its files again it still knows the guard, which begins an exchange: it gets no key.
    world.cucs.as_mut().unwrap().end.want();
    world.run(5);
    assert_eq!(world.key(), Some(revoked));
    assert!(
        world
            .news
            .iter()
            .any(|news| matches!(news, VsmNews::NotStored(_)))
    );
    world.reload_vsm();
    (world.taken, world.answered) = (0, 0);
    world.run(60);
    assert_eq!(world.key(), Some(revoked));
    assert_eq!((world.taken, world.answered), (0, 0), "it is locked out");
    // A person pairs it again.
    assert!(world.open_window());
    let code = world.code.duplicate();
    world.pair_cucs(code, usize::MAX);
    assert!(world.run_until(30, World::is_settled));
    assert_they_speak(&mut world);
}
