//! The machine without the others: what it flies for what a vehicle reports, second by second.

use super::*;
use crate::session::testing::World;

const CONFIG: Provision = Provision {
    battery: Some(Action::ContingencyA),
    battery_percent: 25,
    position: Some(Action::Land),
    fence: None,
    engine: Some(Action::Land),
    link: None,
};

/// On hold in the air; these causes are reported.
fn flying(world: &World, causes: &[Trigger]) -> ContingencyContext {
    // A report a second.
    let number = u32::try_from(world.now.mono.as_secs()).unwrap_or(0);
    let seen = Trigger::ALL.map(|one| {
        let what = match causes.contains(&one) {
            true => What::Present,
            false => What::Absent,
        };
        (one != Trigger::Link).then_some(Seen { number, what })
    });
    ContingencyContext {
        now: world.now.mono,
        config: CONFIG,
        live: true,
        airborne: true,
        down: false,
        mode: Some(Px4Mode::LOITER),
        other: None,
        seen,
        carries: None,
        flies: None,
        completed: None,
        controlled: true,
        lands: false,
        busy: false,
        operator_waits: false,
        on_final: false,
        stored: [true, false],
        may_change_mission: true,
    }
}

const LOW: &[Trigger] = &[Trigger::Battery];

/// What is flown now, a second later.
fn next(
    world: &mut World,
    machine: &mut Contingencies,
    with: impl Fn(ContingencyContext) -> ContingencyContext,
    causes: &[Trigger],
) -> Option<Action> {
    world.advance(Duration::from_secs(1));
    let context = with(flying(world, causes));
    world.act(|_, _, effects| {
        machine.watch(&context, effects);
        let action = machine.poll(&context, effects);
        if action.is_some() {
            machine.announce(&context.config, effects);
        }
        action
    })
}

/// What is flown within ten seconds of that.
fn within_ten_s(
    world: &mut World,
    machine: &mut Contingencies,
    with: impl Fn(ContingencyContext) -> ContingencyContext,
    causes: &[Trigger],
) -> Vec<Action> {
    (0..10)
        .filter_map(|_| next(world, machine, &with, causes))
        .collect()
}

fn has_alert(world: &World, text: &str) -> bool {
    world.alerts.standing().any(|one| one.text.contains(text))
}

fn same<T>(context: T) -> T {
    context
}

#[test]
fn an_action_that_the_vehicle_does_not_show_becomes_a_return() {
    let (mut world, mut machine) = (World::new(), Contingencies::default());
    let flown = within_ten_s(&mut world, &mut machine, same, LOW);
    use Action::{ContingencyA as A, Rtl};
    assert_eq!(flown, [A, A, Rtl, Rtl]);
    assert!(has_alert(&world, "is not shown: commanding return"));
    // And a landing where no position is known.
    let lost = &[Trigger::Battery, Trigger::Position];
    let flown = within_ten_s(&mut world, &mut machine, same, lost);
    assert_eq!(flown.last(), Some(&Action::Land));
    let shown = |context| ContingencyContext {
        mode: Some(Px4Mode::LAND),
        ..context
    };
    assert_eq!(within_ten_s(&mut world, &mut machine, shown, lost), []);
    assert!(machine.urgency().is_none() && machine.stands());
}

#[test]
fn a_route_that_is_not_stored_or_cannot_be_uploaded_is_a_return() {
    for stored in [true, false] {
        let (mut world, mut machine) = (World::new(), Contingencies::default());
        let with = |context| ContingencyContext {
            stored: [stored; 2],
            may_change_mission: !stored,
            ..context
        };
        let flown = within_ten_s(&mut world, &mut machine, with, LOW);
        assert_eq!(flown.first(), Some(&Action::Rtl));
    }
}

#[test]
fn a_failsafe_handles_nothing_and_a_pilot_does() {
    let (mut world, mut machine) = (World::new(), Contingencies::default());
    let failsafe = |mode| {
        move |context| ContingencyContext {
            mode: Some(mode),
            other: Some(Other::Failsafe(mode)),
            ..context
        }
    };
    // Waits for its end, however long that takes.
    let holds = failsafe(Px4Mode::LOITER);
    assert_eq!(within_ten_s(&mut world, &mut machine, holds, LOW), []);
    assert!(has_alert(&world, "contingency A waits for its end"));
    let flown = within_ten_s(&mut world, &mut machine, same, LOW);
    assert_eq!(flown.first(), Some(&Action::ContingencyA));
    // It returns by itself: that is what is wanted, or more.
    let returns = failsafe(Px4Mode::RTL);
    assert_eq!(within_ten_s(&mut world, &mut machine, returns, LOW), []);
    assert_eq!(within_ten_s(&mut world, &mut machine, same, LOW), []);

    let (mut world, mut machine) = (World::new(), Contingencies::default());
    let pilot = |context| ContingencyContext {
        mode: Some(Px4Mode::POSCTL),
        other: Some(Other::Pilot(Px4Mode::POSCTL)),
        ..context
    };
    assert_eq!(within_ten_s(&mut world, &mut machine, pilot, LOW), []);
    assert!(has_alert(&world, "nothing is commanded") && !machine.stands());
    assert_eq!(within_ten_s(&mut world, &mut machine, same, LOW), []);
}

#[test]
fn a_more_urgent_cause_follows_and_a_less_urgent_one_does_not() {
    let (mut world, mut machine) = (World::new(), Contingencies::default());
    assert!(!within_ten_s(&mut world, &mut machine, same, LOW).is_empty());
    let home = |context| ContingencyContext {
        mode: Some(Px4Mode::RTL),
        ..context
    };
    assert_eq!(within_ten_s(&mut world, &mut machine, home, LOW), []);
    let both = &[Trigger::Battery, Trigger::Engine];
    let flown = within_ten_s(&mut world, &mut machine, home, both);
    assert_eq!(flown.first(), Some(&Action::Land));

    let (mut world, mut machine) = (World::new(), Contingencies::default());
    let down = |context| ContingencyContext {
        mode: Some(Px4Mode::LAND),
        ..context
    };
    assert_eq!(within_ten_s(&mut world, &mut machine, down, both), []);
    let flown = machine.flown(Some(Px4Mode::LAND), None, false);
    assert_eq!(flown, Some(Urgency::Land));
    assert_eq!(machine.flown(Some(Px4Mode::LOITER), None, false), None);
}

#[test]
fn an_operator_ends_it_also_by_a_command_that_waits_for_its_route() {
    let (mut world, mut machine) = (World::new(), Contingencies::default());
    assert!(!within_ten_s(&mut world, &mut machine, same, LOW).is_empty());
    machine.operator_loads();
    let loads = |context| ContingencyContext {
        operator_waits: true,
        ..context
    };
    assert_eq!(within_ten_s(&mut world, &mut machine, loads, LOW), []);
    // That was refused.
    assert!(!within_ten_s(&mut world, &mut machine, same, LOW).is_empty());
    // And another one was not.
    world.act(|_, _, effects| machine.overridden(&CONFIG, effects));
    assert_eq!(within_ten_s(&mut world, &mut machine, same, LOW), []);
    // A restart knows of it, and the loss of that CUCS ends it.
    let mut after = Contingencies::default();
    world
        .act(|_, _, effects| after.restore(effects))
        .expect("a record");
    assert_eq!(within_ten_s(&mut world, &mut after, same, LOW), []);
    world.act(|_, _, effects| after.controller_lost(effects));
    assert!(!within_ten_s(&mut world, &mut after, same, LOW).is_empty());
}

#[test]
fn a_termination_ends_what_is_tried_and_nothing_is_due_while_it_holds() {
    let (mut world, mut machine) = (World::new(), Contingencies::default());
    assert!(!within_ten_s(&mut world, &mut machine, same, LOW).is_empty());
    world.act(|_, _, effects| machine.yield_to_termination(effects));
    assert_eq!(machine.urgency(), None);
    assert_eq!(machine.poll_timeout(), None);
    assert_eq!(world.alerts.standing().count(), 0);
    // It was reset in the air.
    assert!(!within_ten_s(&mut world, &mut machine, same, LOW).is_empty());
}

#[test]
fn nothing_is_flown_for_a_silent_vehicle_on_the_ground_or_on_its_final() {
    let cases: [fn(ContingencyContext) -> ContingencyContext; 3] = [
        |context| ContingencyContext {
            live: false,
            ..context
        },
        |context| ContingencyContext {
            airborne: false,
            down: true,
            ..context
        },
        |context| ContingencyContext {
            on_final: true,
            ..context
        },
    ];
    for with in cases {
        let (mut world, mut machine) = (World::new(), Contingencies::default());
        assert_eq!(within_ten_s(&mut world, &mut machine, with, LOW), []);
        assert!(!within_ten_s(&mut world, &mut machine, same, LOW).is_empty());
        world.fill_disk();
        within_ten_s(&mut world, &mut machine, same, LOW);
    }
}

#[test]
fn an_operator_decides_some_seconds_after_its_alert_and_a_release_ends_that() {
    let (mut world, mut machine) = (World::new(), Contingencies::default());
    while next(&mut world, &mut machine, same, LOW).is_none() {}
    let alerted = world.now.mono;
    assert!(!machine.knew_of(alerted) && !machine.knew_of(alerted + Duration::from_secs(2)));
    assert!(machine.knew_of(alerted + Duration::from_secs(3)));
    // What waited while the bridge did not run was sent without that knowledge.
    machine.note_stop(Duration::from_secs(60));
    assert!(!machine.knew_of(alerted + Duration::from_secs(62)));
    assert!(machine.knew_of(alerted + Duration::from_secs(63)));
    world.act(|_, _, effects| machine.overridden(&CONFIG, effects));
    assert!(!machine.stands());
    // Of another cause there was no alert.
    let both = &[Trigger::Battery, Trigger::Engine];
    assert!(!within_ten_s(&mut world, &mut machine, same, both).is_empty());
    world.act(|_, _, effects| machine.overridden(&CONFIG, effects));
    assert_eq!(within_ten_s(&mut world, &mut machine, same, both), []);
    world.act(|_, _, effects| machine.released(effects));
    assert!(!within_ten_s(&mut world, &mut machine, same, both).is_empty());
}

/// Another station's mission is no route of contingency, whatever was loaded before it.
#[test]
fn a_route_is_shown_only_where_the_vehicle_names_it() {
    for (flies, flown) in [(None, false), (Some(RouteType::ContingencyA), true)] {
        let (mut world, mut machine) = (World::new(), Contingencies::default());
        let with = |context| ContingencyContext {
            mode: Some(Px4Mode::MISSION),
            carries: Some(RouteType::ContingencyA),
            flies,
            ..context
        };
        let commanded = within_ten_s(&mut world, &mut machine, with, LOW);
        assert_eq!(commanded.is_empty(), flown);
    }
}
