//! Loss, duplication, reordering, delay, and death of either process at every step: [`World`] checks after every event
//! that the ground has every key that the vehicle could come to sign with; here it is checked that one key remains.

use core::time::Duration;

use crate::disks::Fault;
use crate::world::{Treatment, Weather, World, ms};

/// All faults heal, with time and, for a pairing, a person who tries again.
fn heals(world: &mut World, what: impl Fn() -> String) {
    world.weather = Weather::default();
    let healed = world.run_until_settled(Duration::from_secs(400));
    assert!(healed.is_some(), "{} never heals", what());
    // And it stays so.
    world.run_until(world.now + Duration::from_secs(90));
    assert!(world.is_settled(), "{} does not stay healed", what());
}

type Begin = fn(u64) -> World;

/// Two begin differently: an exchange between pinned keys, and a pairing.
const BEGINNINGS: [(&str, Begin); 2] = [("exchange", World::paired), ("pairing", World::pairing)];

#[test]
fn no_treatment_of_any_one_message_leaves_the_ends_apart() {
    let treatments = [
        Treatment::Lose,
        Treatment::Double,
        Treatment::Delay(ms(700)),
        Treatment::Delay(ms(9_500)),
        Treatment::Delay(ms(15_000)),
    ];
    for (name, begin) in BEGINNINGS {
        for at in 0..8 {
            for treatment in treatments {
                let mut world = begin(11);
                world.treatments.insert(at, treatment);
                heals(&mut world, || format!("{name}: {treatment:?} of {at}"));
            }
        }
    }
}

#[test]
fn no_pair_of_lost_or_late_messages_leaves_the_ends_apart() {
    for (name, begin) in BEGINNINGS {
        for first in 0..9 {
            for second in first + 1..10 {
                for treatments in [
                    [Treatment::Lose, Treatment::Lose],
                    [Treatment::Lose, Treatment::Delay(ms(9_900))],
                    [Treatment::Delay(ms(12_000)), Treatment::Lose],
                ] {
                    let mut world = begin(12);
                    world.treatments.insert(first, treatments[0]);
                    world.treatments.insert(second, treatments[1]);
                    heals(&mut world, || {
                        format!("{name}: {treatments:?} of {first} and {second}")
                    });
                }
            }
        }
    }
}

#[test]
fn death_or_failure_at_any_write_of_either_end_heals() {
    for (name, begin) in BEGINNINGS {
        for fault in [Fault::DiesBefore, Fault::DiesAfter, Fault::Fails] {
            for write in 0..8 {
                let mut world = begin(13);
                world.ground_disk.writes.fault = Some((write, fault));
                heals(&mut world, || {
                    format!("{name}: ground {fault:?} at {write}")
                });
                let mut world = begin(13);
                world.air_disk.writes.fault = Some((write, fault));
                heals(&mut world, || format!("{name}: air {fault:?} at {write}"));
            }
        }
    }
}

#[test]
fn death_at_any_write_and_a_lost_message_heal() {
    for (name, begin) in BEGINNINGS {
        for fault in [Fault::DiesBefore, Fault::DiesAfter] {
            for write in 0..5 {
                for lost in 0..6 {
                    for ground in [true, false] {
                        let mut world = begin(14);
                        world.treatments.insert(lost, Treatment::Lose);
                        let disk = if ground {
                            &mut world.ground_disk.writes
                        } else {
                            &mut world.air_disk.writes
                        };
                        disk.fault = Some((write, fault));
                        heals(&mut world, || {
                            format!("{name}: ground {ground} {fault:?} at {write}, {lost} lost")
                        });
                    }
                }
            }
        }
    }
}

#[test]
fn a_restart_of_either_or_both_at_any_moment_heals() {
    for (name, begin) in BEGINNINGS {
        for at in (0..2_000).step_by(10) {
            for (ground, air) in [(true, false), (false, true), (true, true)] {
                let mut world = begin(15);
                world.run_until(ms(1_000 + at));
                if ground {
                    world.kill_ground(ms(300));
                }
                if air {
                    world.kill_air(ms(400));
                }
                heals(&mut world, || {
                    format!("{name}: ground {ground}, air {air} at {at} ms")
                });
            }
        }
    }
}

#[test]
fn random_histories_of_a_bad_network_and_dying_processes_heal() {
    for seed in 0..400 {
        let (name, begin) = BEGINNINGS[seed as usize % 2];
        let mut world = begin(1_000 + seed);
        world.weather = Weather {
            loss: world.dice.below(60),
            double: world.dice.below(30),
            late: world.dice.below(50),
            most_late: Duration::from_secs(world.dice.below(20)),
        };
        let faults = [Fault::DiesBefore, Fault::DiesAfter, Fault::Fails];
        for _ in 0..world.dice.below(12) {
            let until = world.now + ms(world.dice.below(8_000));
            world.run_until(until);
            world.armed = world.dice.chance(30);
            let down = ms(world.dice.below(15_000));
            let fault = faults[world.dice.below(3) as usize];
            let write = world.dice.below(4) as usize;
            match world.dice.below(6) {
                0 => world.kill_ground(down),
                1 => world.kill_air(down),
                2 => {
                    let at = world.ground_disk.writes.count + write;
                    world.ground_disk.writes.fault = Some((at, fault));
                }
                3 => {
                    let at = world.air_disk.writes.count + write;
                    world.air_disk.writes.fault = Some((at, fault));
                }
                4 => {
                    if let Some(ground) = &mut world.ground {
                        ground.want();
                    }
                }
                _ => {}
            }
        }
        world.armed = false;
        heals(&mut world, || format!("{name}: history {seed}"));
    }
}
