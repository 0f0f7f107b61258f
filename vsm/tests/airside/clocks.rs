//! Steps of the wall clocks of ground and agent, up to ten years either way, with and without restarts: the link heals by
//! itself, a command is carried out again within a bounded time, and nothing recorded meanwhile is accepted.
//!
//! Bounds, from the end of the last step or restart: the link is live at both ends within [`HEALED_S`], and a launch that is
//! sent then is carried out within [`CARRIED_OUT_S`].

use std::time::Duration;

use kit::bridge::orders;
use mavlink_link::receiver::Stream;
use mavlink_link::signing::Stamp;
use stanag_msgs::enums::AckType;

use crate::chain::Chain;
use crate::world::{at, frame, key};

/// A challenge goes out within two seconds, and the status believes in an answer five seconds long.
const HEALED_S: f64 = 8.0;
/// From the order to armed and climbing, confirmed.
const CARRIED_OUT_S: f64 = 20.0;

const HOUR: f64 = 3_600.0;
const DAY: f64 = 86_400.0;
const TEN_YEARS: f64 = 3_653.0 * DAY;

/// Whose wall clock is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Whose {
    Ground,
    Air,
    Both,
}

const ALL: [Whose; 3] = [Whose::Ground, Whose::Air, Whose::Both];

/// Who starts again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Restart {
    Nobody,
    Bridge,
    Agent,
    Vehicle,
    All,
}

fn step(chain: &mut Chain, whose: Whose, seconds: f64) {
    if whose != Whose::Air {
        chain.ground.set_wall_step(seconds);
    }
    if whose != Whose::Ground {
        chain.air.set_wall_step(seconds);
    }
}

fn restart(chain: &mut Chain, who: Restart) {
    if matches!(who, Restart::Bridge | Restart::All) {
        chain.restart_bridge();
    }
    if matches!(who, Restart::Agent | Restart::All) {
        chain.restart_agent();
    }
    if matches!(who, Restart::Vehicle | Restart::All) {
        chain.px4.restart();
    }
}

/// Live, answered, safe against all that was recorded, and it flies.
fn assert_healed(chain: &mut Chain, what: &str) {
    chain.run(HEALED_S);
    assert_eq!(chain.states(), ("live", "live"), "{what}: {:#?}", chain.log);
    assert_eq!(chain.replay(), 0, "{what}: a recording was accepted");
    let end = chain.carry_out(orders::launch(20.0), CARRIED_OUT_S);
    assert_eq!(end, Some(AckType::CarriedOut), "{what}: {:#?}", chain.log);
    assert_eq!(chain.replay(), 0, "{what}: a recording was accepted");
}

#[test]
fn a_wall_clock_that_is_wrong_for_5_s_costs_nothing() {
    for seconds in [2.0 * HOUR, 300.0 * DAY, TEN_YEARS, -TEN_YEARS] {
        for whose in ALL {
            let mut chain = Chain::ready();
            step(&mut chain, whose, seconds);
            chain.run(5.0);
            let during = chain.states();
            step(&mut chain, whose, 0.0);
            let what = format!("{whose:?} wrong by {seconds} s for 5 s");
            assert_eq!(during, ("live", "live"), "{what}: {:#?}", chain.log);
            assert_healed(&mut chain, &what);
        }
    }
}

#[test]
fn a_start_with_a_wrong_wall_clock_heals_without_a_person() {
    for seconds in [2.0 * HOUR, 300.0 * DAY, TEN_YEARS, -TEN_YEARS] {
        for (whose, who) in [
            (Whose::Ground, Restart::Bridge),
            (Whose::Air, Restart::Agent),
            (Whose::Air, Restart::All),
        ] {
            let mut chain = Chain::ready();
            step(&mut chain, whose, seconds);
            chain.run(1.0);
            restart(&mut chain, who);
            let what = format!("{whose:?} wrong by {seconds} s at a start of {who:?}");
            chain.run(HEALED_S);
            assert_eq!(chain.states(), ("live", "live"), "{what}: {:#?}", chain.log);
            // Right again, and everything is started once more: what was stored meanwhile does no harm.
            step(&mut chain, whose, 0.0);
            chain.run(1.0);
            restart(&mut chain, Restart::All);
            chain.run(HEALED_S);
            let control = chain.carry_out(orders::request_control(), CARRIED_OUT_S);
            assert_eq!(
                control,
                Some(AckType::CarriedOut),
                "{what}: {:#?}",
                chain.log
            );
            assert_healed(&mut chain, &what);
        }
    }
}

/// Frames of the vehicle arrive and are accepted all the time: only its answers show whether it receives the ground.
#[test]
fn a_link_on_which_nothing_is_answered_is_not_live() {
    let mut chain = Chain::ready();
    chain.uplink_cut = true;
    chain.run(12.0);
    assert_eq!(chain.states(), ("unanswered", "not live"));
    let reported = |line: &&String| line.contains("receives nothing from us");
    assert!(
        chain.log.iter().any(|line| reported(&line)),
        "{:#?}",
        chain.log
    );
    chain.uplink_cut = false;
    assert_healed(&mut chain, "the uplink was cut");
}

/// Somebody who has the key signs a year ahead, on a stream of his own: PX4 follows at once, and both ends follow PX4.
#[test]
fn a_vehicle_whose_clock_a_key_holder_has_dragged_is_met() {
    let mut chain = Chain::ready();
    let thief = Stream {
        system: 77,
        component: 1,
        link: 3,
    };
    let ahead = Stamp::from_unix(chain.air.now().wall + Duration::from_secs(366 * 86_400));
    let bytes = frame(thief, 0, &[0; 9], Some((&key(5), ahead)));
    chain.px4.handle_datagram(0, at(9), &bytes);
    chain.run(1.0);
    assert!(chain.refused_of_px4() > 0, "PX4 followed");
    assert_healed(&mut chain, "PX4 was dragged");
}

/// Random histories of all three: any order of steps and restarts, at any moment.
#[test]
fn random_steps_of_all_wall_clocks_with_restarts_heal() {
    for seed in 0..6 {
        let mut random = fastrand::Rng::with_seed(seed);
        let mut chain = Chain::ready();
        let mut history = Vec::new();
        for _ in 0..14 {
            let what = if random.bool() {
                let whose = ALL[random.usize(..ALL.len())];
                let most = [90.0, 2.0 * HOUR, 400.0 * DAY, TEN_YEARS][random.usize(..4)];
                let seconds = (random.f64() * 2.0 - 1.0) * most;
                step(&mut chain, whose, seconds);
                format!("{whose:?} {seconds:.0} s")
            } else {
                let who = [
                    Restart::Bridge,
                    Restart::Agent,
                    Restart::Vehicle,
                    Restart::All,
                ][random.usize(..4)];
                restart(&mut chain, who);
                format!("restart {who:?}")
            };
            history.push(what);
            chain.run(random.f64() * 4.0);
        }
        restart(&mut chain, Restart::Nobody);
        chain.run(HEALED_S);
        let control = chain.carry_out(orders::request_control(), CARRIED_OUT_S);
        let what = format!("seed {seed}: {history:?}");
        assert_eq!(
            control,
            Some(AckType::CarriedOut),
            "{what}: {:#?}",
            chain.log
        );
        assert_healed(&mut chain, &what);
    }
}
