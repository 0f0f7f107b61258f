//! The machine alone: what is tried, and what a restart has cut off.

use mavlink_link::store::MemoryDisk;

use super::*;
use crate::session::store::Boot;
use crate::session::testing::World;

/// In the air, in a mode that no action leads to, with nobody in control.
fn flying(world: &World) -> LossContext {
    LossContext {
        now: world.now.mono,
        live: true,
        on_ground: false,
        controlled: false,
        mode: Some(Px4Mode::POSCTL),
        awaits_mode: false,
        carries_contingency: false,
        completed: false,
        busy: false,
        on_final: false,
        may_change_mission: true,
        other: None,
    }
}

fn poll(world: &mut World, machine: &mut LossAction, context: LossContext) -> Option<Action> {
    world.act(|_, _, effects| machine.poll(&context, effects))
}

fn begun(world: &World, on_loss: OnLoss, steered: bool) -> LossAction {
    let mut machine = LossAction::default();
    machine.begin(on_loss, steered, world.now.mono);
    machine
}

/// Another process finds the record of an action that was begun.
fn cut_off(world: &mut World, on_loss: OnLoss) -> LossAction {
    let mut before = begun(world, on_loss, false);
    let mut after = LossAction::default();
    world.act(|_, _, effects| {
        before.store(effects);
        after.restore(effects).expect("the record is read");
        after.report_cut_off(false, effects);
    });
    assert!(!after.is_active());
    after
}

/// What is commanded with this shown, a second apart.
fn commanded(
    world: &mut World,
    machine: &mut LossAction,
    context: LossContext,
    looks: u32,
) -> Vec<Action> {
    let looks = 0..looks;
    let look = |_| {
        let now = world.now.mono;
        let action = world.act(|_, _, effects| {
            let context = LossContext { now, ..context };
            machine.watch_cut_off(&context, effects);
            let action = machine.poll(&context, effects);
            machine.store(effects);
            action
        });
        world.advance(Duration::from_secs(1));
        action
    };
    looks.filter_map(look).collect()
}

fn standing(world: &World) -> Vec<String> {
    let standing = world.alerts.standing();
    standing.map(|alert| alert.text.clone()).collect()
}

#[test]
fn what_a_restart_has_cut_off_is_reported_and_a_vehicle_that_only_holds_returns() {
    let mut world = World::new();
    let mut machine = cut_off(&mut world, OnLoss::Contingency);
    let holds = LossContext {
        mode: Some(Px4Mode::LOITER),
        ..flying(&world)
    };
    let silent = LossContext {
        live: false,
        ..holds
    };
    assert_eq!(commanded(&mut world, &mut machine, silent, 30), []);
    let texts = standing(&world);
    assert!(texts[0].starts_with("the loss action (fly contingency A) was cut off by a restart"));
    // The hold of before the restart is shown late.
    let before = LossContext {
        mode: Some(Px4Mode::MISSION),
        ..holds
    };
    assert_eq!(commanded(&mut world, &mut machine, before, 2), []);
    assert_eq!(
        commanded(&mut world, &mut machine, holds, 1),
        [Action::Return]
    );
    assert_eq!(
        standing(&world),
        [
            "the loss action (fly contingency A) was cut off by a restart of the VSM, and the vehicle only holds: \
             commanding return"
        ]
    );
    let returns = LossContext {
        mode: Some(Px4Mode::RTL),
        ..holds
    };
    assert_eq!(commanded(&mut world, &mut machine, returns, 1), []);
    assert_eq!(standing(&world).len(), 0);
    let mut again = LossAction::default();
    let restored = world.act(|_, _, effects| again.restore(effects));
    restored.expect("the record is read");
    assert!(again.cut_off.is_none(), "it has ended");
}

#[test]
fn what_a_restart_has_cut_off_is_not_flown_in_another_mode_nor_where_a_station_controls() {
    let mut world = World::new();
    for mode in [Px4Mode::MISSION, Px4Mode::POSCTL] {
        let mut machine = cut_off(&mut world, OnLoss::Contingency);
        let elsewhere = LossContext {
            mode: Some(mode),
            ..flying(&world)
        };
        assert_eq!(commanded(&mut world, &mut machine, elsewhere, 7), []);
        assert!(standing(&world)[0].ends_with("nothing is commanded"));
        // Whoever puts it on hold now does not have it taken from them.
        let holds = LossContext {
            mode: Some(Px4Mode::LOITER),
            ..elsewhere
        };
        assert_eq!(commanded(&mut world, &mut machine, holds, 7), []);
        let taken = LossContext {
            controlled: true,
            ..holds
        };
        assert_eq!(commanded(&mut world, &mut machine, taken, 1), []);
        assert_eq!(standing(&world).len(), 0);
    }
    let mut machine = cut_off(&mut world, OnLoss::Contingency);
    let taken = LossContext {
        mode: Some(Px4Mode::LOITER),
        controlled: true,
        ..flying(&world)
    };
    assert_eq!(commanded(&mut world, &mut machine, taken, 7), []);
}

#[test]
fn what_a_restart_has_cut_off_does_not_wait_for_its_return_in_another_mode() {
    let failsafe = Some(Other::Failsafe(Px4Mode::LOITER));
    for (other, on_final, busy) in [
        (failsafe, false, false),
        (None, true, false),
        (None, false, true),
    ] {
        for still_holds in [false, true] {
            let mut world = World::new();
            let mut machine = cut_off(&mut world, OnLoss::Contingency);
            let waits = LossContext {
                mode: Some(Px4Mode::LOITER),
                other,
                on_final,
                busy,
                ..flying(&world)
            };
            assert_eq!(commanded(&mut world, &mut machine, waits, 2), []);
            assert!(machine.is_cut_off() && !machine.is_active());
            let mode = if still_holds {
                Px4Mode::LOITER
            } else {
                Px4Mode::MISSION
            };
            let free = LossContext {
                mode: Some(mode),
                ..flying(&world)
            };
            let actions = commanded(&mut world, &mut machine, free, 1);
            assert_eq!(actions == [Action::Return], still_holds);
            if !still_holds {
                assert_eq!(commanded(&mut world, &mut machine, free, 7), []);
                assert!(standing(&world)[0].ends_with("nothing is commanded"));
            }
        }
    }
}

/// A contingency goes first, and takes the vehicle out of its hold.
#[test]
fn what_a_restart_has_cut_off_is_decided_again_where_it_was_not_its_turn() {
    let mut world = World::new();
    let mut machine = cut_off(&mut world, OnLoss::Contingency);
    let holds = LossContext {
        mode: Some(Px4Mode::LOITER),
        ..flying(&world)
    };
    world.act(|_, _, effects| {
        machine.watch_cut_off(&holds, effects);
        machine.store(effects);
    });
    assert!(machine.is_active() && machine.is_cut_off());
    let before = Some(Pending::LossAction(Action::Contingency));
    assert_eq!(machine.stored, before);
    let flown = LossContext {
        mode: Some(Px4Mode::MISSION),
        ..holds
    };
    assert_eq!(poll(&mut world, &mut machine, flown), None);
    assert!(!machine.is_active() && machine.is_cut_off());
}

#[test]
fn what_a_restart_has_cut_off_stays_reported_where_a_later_loss_flies_nothing() {
    for (on_loss, stays) in [(OnLoss::Continue, true), (OnLoss::Rtl, false)] {
        let mut world = World::new();
        let mut machine = cut_off(&mut world, OnLoss::Contingency);
        machine.begin(on_loss, false, world.now.mono);
        assert_eq!(machine.is_cut_off(), stays);
        let elsewhere = flying(&world);
        commanded(&mut world, &mut machine, elsewhere, 1);
        assert_eq!(standing(&world).len(), usize::from(stays));
    }
}

#[test]
fn a_return_that_a_restart_has_cut_off_is_not_named_as_refused() {
    let mut world = World::new();
    let mut machine = cut_off(&mut world, OnLoss::Rtl);
    let holds = LossContext {
        mode: Some(Px4Mode::LOITER),
        ..flying(&world)
    };
    let actions = commanded(&mut world, &mut machine, holds, 1);
    assert_eq!(actions, [Action::Return]);
    assert!(standing(&world)[0].ends_with("and the vehicle only holds: commanding return"));
    let returns = LossContext {
        mode: Some(Px4Mode::RTL),
        ..holds
    };
    let of_held = finished(&returns, None);
    assert_eq!(of_held, Some("the vehicle returns or lands"));
}

/// What is commanded, and reported, where the vehicle holds, this long after the record was written and in this boot.
fn holds_after(later: Duration, wall: Duration, boot: Option<u64>) -> (Vec<Action>, String) {
    let mut world = World::new();
    let mut machine = cut_off(&mut world, OnLoss::Contingency);
    world.now.wall = wall;
    world.boot = boot.map(|id| Boot { id, zero: later });
    let holds = LossContext {
        mode: Some(Px4Mode::LOITER),
        ..flying(&world)
    };
    let actions = commanded(&mut world, &mut machine, holds, 7);
    (actions, standing(&world).concat())
}

/// A bridge that was off for days finds a hold of somebody else.
#[test]
fn what_a_restart_has_cut_off_long_ago_is_only_reported() {
    let wall = World::new().now.wall;
    let minute = Duration::from_secs(60);
    let (actions, _) = holds_after(minute, wall, Some(1));
    assert_eq!(actions.first(), Some(&Action::Return));
    for later in [minute + RETRY_INTERVAL, 100 * minute] {
        let (actions, text) = holds_after(later, wall, Some(1));
        assert_eq!(actions, []);
        assert!(text.contains("AUTO.LOITER, nothing is commanded"), "{text}");
    }
}

#[test]
fn the_wall_clock_does_not_show_how_old_a_cut_off_action_is() {
    let (now, moment) = (World::new().now.wall, Duration::from_secs(2));
    let years = Duration::from_secs(10 * 365 * 86_400);
    for wall in [Duration::ZERO, now - years, now - moment, now + years] {
        let (actions, text) = holds_after(moment, wall, Some(1));
        assert_eq!(actions.first(), Some(&Action::Return), "{wall:?}: {text}");
    }
    // It shows two seconds, as after a restart of a computer that keeps no time while it is off.
    for boot in [Some(2), None] {
        let (actions, text) = holds_after(moment, now + moment, boot);
        assert_eq!(actions, []);
        let why = "after a restart of the computer, or at another one";
        assert!(text.ends_with(why), "{text}");
    }
}

/// As the disk of the node that takes over knows, or does not know.
#[test]
fn what_another_node_has_begun_is_taken_up_only_where_it_is_known_to_be_recent() {
    let s = Duration::from_secs;
    for (within, acts, why) in [
        (Some(s(5)), true, "it does not return"),
        (Some(s(61)), false, "it was begun over 60 s ago"),
        (None, false, "or at another one"),
    ] {
        let mut world = World::new();
        world.disk = Box::new(MemoryDisk {
            written_within: within,
            ..MemoryDisk::default()
        });
        let mut before = begun(&world, OnLoss::Contingency, false);
        world.act(|_, _, effects| before.store(effects));
        world.boot = Some(Boot {
            id: 2,
            zero: s(1_000),
        });
        let mut machine = LossAction::default();
        world.act(|_, _, effects| {
            machine.restore(effects).expect("the record is read");
            machine.report_cut_off(false, effects);
        });
        let holds = LossContext {
            mode: Some(Px4Mode::LOITER),
            ..flying(&world)
        };
        let actions = commanded(&mut world, &mut machine, holds, 7);
        assert_eq!(actions.first() == Some(&Action::Return), acts, "{within:?}");
        let text = standing(&world).concat();
        assert!(text.contains(why), "{text}");
    }
}

#[test]
fn a_held_contingency_that_a_restart_has_cut_off_is_only_reported() {
    let mut world = World::new();
    let mut machine = LossAction::default();
    machine.cut_off_held(3);
    world.act(|_, _, effects| machine.report_cut_off(false, effects));
    let holds = LossContext {
        mode: Some(Px4Mode::LOITER),
        ..flying(&world)
    };
    assert_eq!(commanded(&mut world, &mut machine, holds, 7), []);
    assert!(standing(&world)[0].starts_with("held command 3, a contingency, was cut off"));
    machine.cut_off_held(3);
    world.act(|_, _, effects| machine.report_cut_off(true, effects));
    assert!(machine.cut_off.is_none(), "who controls decides");
}

/// A write may take long where the disk fails, and the bridge waits for it.
#[test]
fn a_record_that_the_disk_refuses_is_written_again_two_seconds_later() {
    let mut world = World::new();
    let mut machine = begun(&world, OnLoss::Rtl, false);
    let working = std::mem::replace(&mut world.disk, Box::new(MemoryDisk::default()));
    world.fill_disk();
    world.act(|_, _, effects| machine.store(effects));
    let again = machine.save_timeout().expect("it is not stored");
    assert_eq!(again, world.now.mono + RETRY_INTERVAL);
    world.disk = working;
    world.act(|_, _, effects| machine.store(effects));
    assert!(machine.stored.is_none(), "not on every input");
    world.advance(RETRY_INTERVAL);
    world.act(|_, _, effects| machine.store(effects));
    assert_eq!(machine.stored, Some(Pending::LossAction(Action::Return)));
    assert_eq!(machine.save_timeout(), None);
    // It has ended before the disk has refused it twice: there is nothing to write.
    let mut machine = begun(&world, OnLoss::Rtl, false);
    world.fill_disk();
    world.act(|_, _, effects| {
        machine.store(effects);
        machine.end("", effects);
        machine.store(effects);
    });
    assert_eq!(machine.save_timeout(), None);
}

#[test]
fn returns_home_after_the_hold_was_refused_twice() {
    let mut world = World::new();
    let mut machine = begun(&world, OnLoss::Hold, false);
    let expected = [Action::Hold, Action::Hold, Action::Return, Action::Return];
    for (tries, action) in expected.into_iter().enumerate() {
        let context = flying(&world);
        assert_eq!(poll(&mut world, &mut machine, context), Some(action));
        assert_eq!(poll(&mut world, &mut machine, context), None, "not at once");
        let emergency = world.alerts.standing().next().map(|alert| alert.priority);
        assert_eq!(emergency.is_some(), tries > 0);
        assert!(emergency.is_none_or(|priority| priority == AlertPriority::Emergency));
        assert_eq!(
            machine.poll_timeout(),
            Some(world.now.mono + RETRY_INTERVAL)
        );
        world.advance(RETRY_INTERVAL);
    }
    let returning = LossContext {
        mode: Some(Px4Mode::RTL),
        ..flying(&world)
    };
    assert_eq!(poll(&mut world, &mut machine, returning), None);
    assert!(!machine.is_active() && machine.poll_timeout().is_none());
    assert_eq!(world.alerts.standing().count(), 0);
}

#[test]
fn tries_are_not_counted_while_the_vehicle_is_silent_or_busy() {
    let mut world = World::new();
    let mut machine = begun(&world, OnLoss::Hold, false);
    for round in 0..10 {
        let context = LossContext {
            live: round % 2 == 0,
            busy: true,
            ..flying(&world)
        };
        assert_eq!(poll(&mut world, &mut machine, context), None);
        assert!(machine.is_active());
        world.advance(RETRY_INTERVAL);
    }
    assert_eq!(world.alerts.standing().count(), 0, "it has refused nothing");
    for action in [Action::Hold, Action::Hold, Action::Return] {
        let context = flying(&world);
        assert_eq!(poll(&mut world, &mut machine, context), Some(action));
        world.advance(RETRY_INTERVAL);
    }
}

#[test]
fn a_pilot_keeps_the_vehicle_and_the_end_of_a_failsafe_is_waited_for() {
    let mut world = World::new();
    let mut machine = begun(&world, OnLoss::Rtl, false);
    for round in 0..5 {
        let context = LossContext {
            mode: Some(Px4Mode::LOITER),
            other: Some(Other::Failsafe(Px4Mode::LOITER)),
            ..flying(&world)
        };
        assert_eq!(poll(&mut world, &mut machine, context), None, "{round}");
        assert_eq!(world.alerts.standing().count(), 1, "it is reported");
        world.advance(RETRY_INTERVAL);
    }
    let after_it = flying(&world);
    let action = poll(&mut world, &mut machine, after_it);
    assert_eq!(action, Some(Action::Return));
    assert_eq!(world.alerts.standing().count(), 0);
    // A pilot takes it while that is tried: nothing is commanded on an older report, and nothing any more on a later one.
    world.advance(RETRY_INTERVAL);
    let unseen = LossContext {
        mode: None,
        ..flying(&world)
    };
    assert_eq!(poll(&mut world, &mut machine, unseen), None);
    assert!(machine.is_active());
    world.advance(RETRY_INTERVAL);
    let taken = LossContext {
        other: Some(Other::Pilot(Px4Mode::POSCTL)),
        ..flying(&world)
    };
    assert_eq!(poll(&mut world, &mut machine, taken), None);
    assert!(!machine.is_active());
}

/// The stop of the bridge is also why the CUCS counts as lost.
#[test]
fn the_first_attempt_after_a_stop_of_the_bridge_waits_for_the_mode() {
    for on_loss in [OnLoss::Hold, OnLoss::Contingency, OnLoss::Rtl] {
        let mut world = World::new();
        let mut machine = begun(&world, on_loss, false);
        let stopped = LossContext {
            mode: None,
            awaits_mode: true,
            ..flying(&world)
        };
        assert_eq!(poll(&mut world, &mut machine, stopped), None);
        assert!(machine.is_active());
        world.advance(RETRY_INTERVAL);
        let flown = LossContext {
            other: Some(Other::Pilot(Px4Mode::POSCTL)),
            ..flying(&world)
        };
        assert_eq!(poll(&mut world, &mut machine, flown), None);
        assert!(!machine.is_active());
    }
    // Only a command of the VSM is younger than the report: nobody else had the time.
    let mut world = World::new();
    let mut machine = begun(&world, OnLoss::Rtl, false);
    let commanded = LossContext {
        mode: None,
        ..flying(&world)
    };
    let action = poll(&mut world, &mut machine, commanded);
    assert_eq!(action, Some(Action::Return));
}

#[test]
fn a_wing_on_its_final_approach_lands_whatever_is_configured() {
    for on_loss in [OnLoss::Hold, OnLoss::Contingency, OnLoss::Rtl] {
        let mut world = World::new();
        let mut machine = begun(&world, on_loss, false);
        for _ in 0..30 {
            let context = LossContext {
                mode: Some(Px4Mode::MISSION),
                on_final: true,
                ..flying(&world)
            };
            assert_eq!(poll(&mut world, &mut machine, context), None, "{on_loss:?}");
            world.advance(RETRY_INTERVAL);
        }
        // PX4 has aborted the landing, and loiters above it.
        let mut aborted = machine;
        let context = LossContext {
            mode: Some(Px4Mode::LOITER),
            ..flying(&world)
        };
        let expected = match on_loss {
            OnLoss::Rtl => Some(Action::Return),
            OnLoss::Contingency => Some(Action::Contingency),
            OnLoss::Hold | OnLoss::Continue => None,
        };
        assert_eq!(poll(&mut world, &mut aborted, context), expected);
        // Or it is down.
        let mut machine = begun(&world, on_loss, false);
        let context = LossContext {
            on_ground: true,
            ..flying(&world)
        };
        assert_eq!(poll(&mut world, &mut machine, context), None);
        assert!(!machine.is_active());
    }
}

#[test]
fn a_silent_vehicle_is_not_done_whatever_it_showed_last() {
    let mut world = World::new();
    let mut machine = begun(&world, OnLoss::Rtl, false);
    let last_shown = LossContext {
        live: false,
        on_ground: true,
        mode: Some(Px4Mode::RTL),
        ..flying(&world)
    };
    assert_eq!(poll(&mut world, &mut machine, last_shown), None);
    assert!(machine.is_active());
    world.advance(RETRY_INTERVAL);
    let context = flying(&world);
    assert_eq!(
        poll(&mut world, &mut machine, context),
        Some(Action::Return)
    );
}

#[test]
fn a_contingency_that_cannot_be_uploaded_now_becomes_a_return() {
    let mut world = World::new();
    let mut machine = begun(&world, OnLoss::Contingency, false);
    let transferring = LossContext {
        may_change_mission: false,
        ..flying(&world)
    };
    let action = poll(&mut world, &mut machine, transferring);
    assert_eq!(action, Some(Action::Return));
}

#[test]
fn a_mission_ends_the_action_only_where_it_is_the_contingency() {
    for carries_contingency in [false, true] {
        let mut world = World::new();
        let mut machine = begun(&world, OnLoss::Contingency, false);
        let context = LossContext {
            mode: Some(Px4Mode::MISSION),
            carries_contingency,
            ..flying(&world)
        };
        let action = poll(&mut world, &mut machine, context);
        let expected = (!carries_contingency).then_some(Action::Contingency);
        assert_eq!(action, expected);
        assert_eq!(machine.is_active(), !carries_contingency);
    }
}

#[test]
fn it_ends_on_the_ground_and_once_a_station_controls_even_a_silent_vehicle() {
    let mut world = World::new();
    let (ground, taken) = (
        LossContext {
            on_ground: true,
            ..flying(&world)
        },
        LossContext {
            controlled: true,
            live: false,
            ..flying(&world)
        },
    );
    for context in [ground, taken] {
        let mut machine = begun(&world, OnLoss::Rtl, false);
        assert_eq!(poll(&mut world, &mut machine, context), None);
        assert!(!machine.is_active());
    }
}

#[test]
fn continue_holds_only_a_vehicle_that_was_steered() {
    let mut world = World::new();
    assert!(!begun(&world, OnLoss::Continue, false).is_active());
    let mut machine = begun(&world, OnLoss::Continue, true);
    let context = flying(&world);
    assert_eq!(poll(&mut world, &mut machine, context), Some(Action::Hold));
}
