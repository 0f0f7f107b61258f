//! Every state that the machine can reach, every input in each of them, and what must never be.

use std::collections::{HashSet, VecDeque};

use stanag_msgs::TimeStamp;

use super::*;
use crate::session::duplicates::Delay;
use crate::session::two_steps::MAX_DELAY;

const US: Id = Id(0x1b00_00a0);
const OTHER: Id = Id(0x1b00_00a1);
const VEHICLE: Id = Id(0x1b00_0101);
const NOW: Duration = Duration::from_secs(1_000);
const STAMP: u64 = 1_000_000;
const PLANS: [Option<Plan>; 4] = [
    None,
    Some(plan(false)),
    Some(plan(true)),
    Some(Plan {
        authentic: false,
        ..plan(true)
    }),
];
const FLEETS: [Fleet; 4] = [
    fleet(None, None),
    fleet(Some(VEHICLE), None),
    fleet(None, Some((VEHICLE, OTHER))),
    fleet(Some(VEHICLE), Some((VEHICLE, OTHER))),
];

const fn plan(in_flight: bool) -> Plan {
    Plan {
        armed: Duration::from_secs(2),
        in_flight,
        authentic: true,
    }
}

const fn fleet(flying: Option<Id>, of_another: Option<(Id, Id)>) -> Fleet {
    Fleet { flying, of_another }
}

#[derive(Debug, Clone, Copy)]
enum Input {
    Order(Order, Circumstances),
    Here(bool, Fleet),
    NotStored,
    /// So much later, with this CUCS in control.
    Watch(Duration, Option<Id>),
}

fn inputs() -> Vec<Input> {
    let mut all = vec![Input::NotStored];
    for order in [Order::Reset, Order::Arm, Order::Execute] {
        for by in [US, OTHER] {
            for stamp in [STAMP - 1, STAMP, STAMP + 1] {
                for plan in PLANS {
                    for vehicle in FLEETS {
                        let at = Circumstances::good(NOW, by, stamp, plan, vehicle).flawed();
                        all.extend(at.into_iter().map(|at| Input::Order(order, at)));
                    }
                }
            }
        }
    }
    for vehicle in FLEETS {
        all.extend([true, false].map(|in_flight| Input::Here(in_flight, vehicle)));
    }
    for later in [0, 1, 3] {
        let later = Duration::from_secs(later);
        all.extend([None, Some(US), Some(OTHER)].map(|by| Input::Watch(later, by)));
    }
    all
}

fn apply(rules: &mut Rules, input: Input) -> Result<Option<Outcome>, Refusal> {
    match input {
        Input::Order(order, at) => rules.order(order, &at).map(Some),
        Input::Here(in_flight, fleet) => rules.order_here(in_flight, fleet).map(Some),
        Input::NotStored => {
            rules.not_stored();
            Ok(None)
        }
        Input::Watch(later, by) => Ok(rules.watch(NOW + later, |armed| by == Some(armed))),
    }
}

/// The same state as if it were seen at `NOW`, and the latest order had the stamp `STAMP`.
fn seen_now(mut rules: Rules, later: Duration) -> Rules {
    if let Stage::Armed { until, .. } = &mut rules.stage {
        *until = until.saturating_sub(later);
    }
    if let Some((_, stamp)) = &mut rules.latest {
        *stamp = TimeStamp(STAMP);
    }
    rules
}

fn is_good(at: &Circumstances) -> bool {
    let spared = at.vehicle.of_another.is_none();
    let allowed = |plan: Plan| plan.authentic && (plan.in_flight || at.vehicle.flying.is_none());
    at.controls
        && !at.handover
        && at.proven
        && at.delay == Delay::Behind(MAX_DELAY)
        && spared
        && at.plan.is_some_and(allowed)
}

/// What must hold of every step.
fn check(before: Rules, input: Input, after: Rules, done: Result<Option<Outcome>, Refusal>) {
    let about = || format!("{before:?}\n{input:?}\n{after:?}\n{done:?}");
    if done.is_err() {
        assert_eq!(before, after, "a refusal changes nothing: {}", about());
    }
    if before.stage != after.stage {
        let silent = matches!(input, Input::NotStored);
        assert!(silent || matches!(done, Ok(Some(_))), "{}", about());
    }
    match (before.stage, after.stage) {
        (Stage::Ordered, Stage::Ordered) => {}
        (Stage::Ordered, _) => assert!(matches!(input, Input::NotStored), "{}", about()),
        (Stage::Armed { by, until }, Stage::Ordered) if matches!(input, Input::Order(..)) => {
            let Input::Order(Order::Execute, at) = input else {
                panic!("{}", about());
            };
            let (armed_by, stamp) = before.latest.expect("the order to arm");
            assert!(is_good(&at) && at.by == by && at.now < until, "{}", about());
            assert!(armed_by == by && at.stamp.0 > stamp.0, "{}", about());
        }
        (_, Stage::Ordered) => {
            let Input::Here(in_flight, fleet) = input else {
                panic!("ordered by one step: {}", about());
            };
            assert!(in_flight || fleet.flying.is_none(), "{}", about());
        }
        (was, Stage::Armed { by, until }) if was != after.stage => {
            let Input::Order(Order::Arm, at) = input else {
                panic!("armed without an order: {}", about());
            };
            assert!(is_good(&at) && at.by == by && until > NOW, "{}", about());
        }
        (_, Stage::Armed { by, until }) => {
            if let Input::Watch(later, controller) = input {
                let holds = controller == Some(by) && NOW + later < until;
                assert!(holds, "{}", about());
            }
        }
        (_, Stage::Safe) => {}
    }
    if let (Input::Watch(later, _), Some(due)) = (input, after.poll_timeout()) {
        assert!(due > NOW + later, "polled again and again: {}", about());
    }
}

#[test]
fn nothing_is_ordered_but_by_two_good_orders_or_here_in_any_reachable_state() {
    let inputs = inputs();
    let mut known = HashSet::from([Rules::default()]);
    let mut left = VecDeque::from([Rules::default()]);
    let (mut by_message, mut here) = (0, 0);
    while let Some(before) = left.pop_front() {
        for input in &inputs {
            let mut after = before;
            let done = apply(&mut after, *input);
            check(before, *input, after, done);
            if let Ok(Some(Outcome::Ordered { by, .. })) = done {
                match by {
                    Some(_) => by_message += 1,
                    None => here += 1,
                }
            }
            let later = match input {
                Input::Watch(later, _) => *later,
                _ => Duration::ZERO,
            };
            let after = seen_now(after, later);
            if known.insert(after) {
                left.push_back(after);
            }
        }
    }
    assert!(
        by_message > 0 && here > 0 && known.len() >= 8,
        "{}",
        known.len()
    );
}
