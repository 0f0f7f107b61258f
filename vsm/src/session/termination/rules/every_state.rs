//! Every state that the machine can reach, every input in each of them, and what must never be.

use std::collections::{HashSet, VecDeque};

use stanag_msgs::TimeStamp;

use super::*;
use crate::session::duplicates::Delay;
use crate::session::two_steps::MAX_DELAY;

const US: Id = Id(0x1b00_00a0);
const OTHER: Id = Id(0x1b00_00a1);
const NOW: Duration = Duration::from_secs(1_000);
const STAMP: u64 = 1_000_000;
const PLANS: [Option<Plan>; 4] = [
    None,
    Some(plan(Action::Terminate)),
    Some(plan(Action::Land)),
    Some(plan(Action::Return)),
];
const SHOWN: [Shows; 6] = [
    Shows::Nothing,
    Shows::Disarmed,
    Shows::Flying,
    Shows::Terminated,
    Shows::Landing,
    Shows::Returning,
];

const fn plan(action: Action) -> Plan {
    Plan {
        action,
        armed: Duration::from_secs(2),
        confirm: Duration::from_secs(3),
    }
}

#[derive(Debug, Clone, Copy)]
enum Input {
    Order(Order, Circumstances),
    Sent,
    Control(Option<Id>),
    /// This one is in control, and has no layout of 2005.
    WithoutLayout(Id),
    Replanned(Option<Plan>),
    /// So much later, with this shown.
    Watch(Duration, Shows),
    /// Of the VSM.
    Restart,
}

fn inputs() -> Vec<Input> {
    let mut all = vec![Input::Sent, Input::Restart];
    for order in [Order::Reset, Order::Arm, Order::Execute] {
        for by in [US, OTHER] {
            for stamp in [STAMP - 1, STAMP, STAMP + 1] {
                for plan in PLANS {
                    for vehicle in SHOWN {
                        let good = Circumstances::good(NOW, by, stamp, plan, vehicle);
                        let mut at = good.flawed();
                        at.push(Circumstances {
                            layout: false,
                            ..good
                        });
                        all.extend(at.into_iter().map(|at| Input::Order(order, at)));
                    }
                }
            }
        }
    }
    all.extend([None, Some(US), Some(OTHER)].map(Input::Control));
    all.push(Input::WithoutLayout(OTHER));
    all.extend(PLANS.map(Input::Replanned));
    for later in [0, 1, 3] {
        let later = Duration::from_secs(later);
        all.extend(SHOWN.map(|shown| Input::Watch(later, shown)));
    }
    all
}

fn apply(rules: &mut Rules, input: Input) -> Result<Option<Outcome>, Refusal> {
    match input {
        Input::Order(order, at) => rules.order(order, &at).map(Some),
        Input::Sent => {
            rules.sent();
            Ok(None)
        }
        Input::Control(controller) => Ok(rules.control_passed(controller)),
        Input::WithoutLayout(id) => Ok(rules.controlled_without_layout(id)),
        Input::Replanned(plan) => Ok(rules.replanned(plan)),
        Input::Watch(later, shown) => Ok(rules.watch(NOW + later, shown)),
        Input::Restart => {
            *rules = rules.ordered().map(Rules::restored).unwrap_or_default();
            Ok(None)
        }
    }
}

/// The same state as if it were seen at `NOW`, and the latest order had the stamp `STAMP`.
fn seen_now(mut rules: Rules, later: Duration) -> Rules {
    if let Stage::Armed { until, .. } | Stage::Commanded { until, .. } = &mut rules.stage {
        *until = until
            .saturating_sub(later)
            .max(NOW - Duration::from_secs(1));
    }
    if let Stage::Executing {
        left: Some(since), ..
    }
    | Stage::CutOff {
        left: Some(since), ..
    } = &mut rules.stage
    {
        *since = NOW - (NOW + later - *since).min(Duration::from_secs(4));
    }
    if let Some((_, stamp)) = &mut rules.ordered {
        *stamp = TimeStamp(STAMP);
    }
    rules
}

fn action_of(stage: Stage) -> Option<Action> {
    match stage {
        Stage::Safe => None,
        Stage::Armed { action, .. }
        | Stage::Commanded { action, .. }
        | Stage::CutOff { action, .. }
        | Stage::Executing { action, .. } => Some(action),
    }
}

fn is_good(at: &Circumstances) -> bool {
    at.controls
        && !at.handover
        && at.proven
        && at.layout
        && at.delay == Delay::Behind(MAX_DELAY)
        && at.vehicle != Shows::Disarmed
}

/// What must hold of every step.
fn check(before: Rules, input: Input, after: Rules, done: Result<Option<Outcome>, Refusal>) {
    let about = || format!("{before:?}\n{input:?}\n{after:?}\n{done:?}");
    if done.is_err() {
        assert_eq!(before, after, "a refusal changes nothing: {}", about());
    }
    let commanded = |rules: &Rules| matches!(rules.stage, Stage::Commanded { .. });
    let armed = |rules: &Rules| matches!(rules.stage, Stage::Armed { .. });
    if commanded(&after) && !commanded(&before) {
        let (Stage::Armed { by, action, until }, Input::Order(Order::Execute, at)) =
            (before.stage, input)
        else {
            panic!("commanded without two steps: {}", about());
        };
        let ordered = before.ordered.expect("the order to arm");
        assert!(is_good(&at) && at.by == by && at.now < until, "{}", about());
        assert!(ordered.0 == by && at.stamp.0 > ordered.1.0, "{}", about());
        assert_eq!(at.plan.map(|plan| plan.action), Some(action), "{}", about());
        assert_eq!(action_of(after.stage), Some(action), "{}", about());
    }
    if armed(&after) && before.stage != after.stage {
        let Input::Order(Order::Arm, at) = input else {
            panic!("armed without an order: {}", about());
        };
        assert!(is_good(&at), "{}", about());
        assert_eq!(at.plan.map(|plan| plan.action), action_of(after.stage));
    }
    // A handover arms and commands nothing, and disarms what the previous controller had armed.
    if let Input::Control(controller) = input
        && let Stage::Armed { by, .. } = after.stage
    {
        assert_eq!(controller, Some(by), "{}", about());
    }
    // What is reported as executed is what the vehicle has shown, after it was sent the command or by itself.
    let executing = |rules: &Rules| match rules.stage {
        Stage::Executing { by, action, .. } => Some((by, action)),
        _ => None,
    };
    if let Some((by, action)) = executing(&after)
        && executing(&before) != executing(&after)
    {
        let Input::Watch(_, shown) = input else {
            panic!("executed without the vehicle: {}", about());
        };
        let continues = matches!(before.stage, Stage::CutOff { .. }) && shown.continues(action);
        assert!(shown.does(action) || continues, "{}", about());
        let sent = matches!(before.stage, Stage::Commanded { sent: true, .. });
        assert!(by.is_none() || sent || continues, "{}", about());
    }
    // A restart forgets nothing that was sent, arms nothing, and reports nothing as executed.
    if let Input::Restart = input {
        assert_eq!(before.ordered(), after.ordered(), "{}", about());
        let kept = matches!(after.stage, Stage::Safe | Stage::CutOff { .. });
        let held = before.ordered().is_some();
        assert!(kept && held == after.holds(), "{}", about());
    }
    // Whoever controls can command again: by a reset in whatever layout, or at once.
    if let Input::WithoutLayout(_) = input {
        let lands = |action| matches!(action, Action::Land | Action::Return);
        let held = matches!(
            after.stage,
            Stage::Executing { by: Some(_), action, .. } | Stage::CutOff { action, .. } if lands(action)
        );
        assert!(!held, "{}", about());
    }
    // A time that is past would be polled again and again.
    if let Input::Watch(later, _) = input {
        let due = after.poll_timeout();
        assert!(due.is_none_or(|due| due > NOW + later), "{}", about());
    }
    // PX4 leaves a termination by a restart alone.
    if let (
        Stage::Executing {
            action: Action::Terminate,
            ..
        },
        false,
    ) = (before.stage, before.stage == after.stage)
    {
        let restarted = matches!(input, Input::Watch(_, shown)
            if !matches!(shown, Shows::Nothing | Shows::Terminated))
            || matches!(input, Input::Restart);
        assert!(restarted, "{}", about());
    }
    if let Input::Watch(later, _) = input
        && let Stage::Armed { until, .. } | Stage::Commanded { until, .. } = after.stage
    {
        assert!(NOW + later < until, "past its time: {}", about());
    }
    let expected = match after.stage {
        Stage::Safe => FtState::Reset,
        Stage::Armed { .. } | Stage::Commanded { .. } | Stage::CutOff { .. } => FtState::Arm,
        Stage::Executing { .. } => FtState::Execute,
    };
    assert_eq!(after.reported(), expected);
    // Nothing changes without an outcome that is reported.
    let same = before.stage == after.stage
        || executing(&before).is_some() && executing(&before) == executing(&after);
    // The time for which a vehicle shows something else is no news.
    let waits = |rules: &Rules| matches!(rules.stage, Stage::CutOff { .. });
    let same = same || (waits(&before) && waits(&after));
    if !same && !matches!(input, Input::Sent | Input::Restart) {
        assert!(matches!(done, Ok(Some(_))), "{}", about());
    }
}

#[test]
fn nothing_is_commanded_but_by_two_good_orders_in_any_reachable_state() {
    let inputs = inputs();
    let mut known = HashSet::from([Rules::default()]);
    let mut left = VecDeque::from([Rules::default()]);
    let (mut executed, mut steps) = (HashSet::new(), 0_usize);
    while let Some(before) = left.pop_front() {
        for input in &inputs {
            let mut after = before;
            let done = apply(&mut after, *input);
            check(before, *input, after, done);
            if let Stage::Executing {
                by: Some(_),
                action,
                ..
            } = after.stage
            {
                executed.insert(action);
            }
            let later = match input {
                Input::Watch(later, _) => *later,
                _ => Duration::ZERO,
            };
            let after = seen_now(after, later);
            if known.insert(after) {
                left.push_back(after);
            }
            steps += 1;
        }
    }
    assert_eq!(executed.len(), 3, "each action can be executed");
    assert!(
        known.len() >= 60 && steps > 100_000,
        "{}, {steps}",
        known.len()
    );
}

#[test]
fn a_reset_needs_no_layout_and_everything_else_does() {
    let at = |stamp| Circumstances::good(NOW, US, stamp, PLANS[2], Shows::Flying);
    let mut rules = Rules::default();
    let without = |stamp| Circumstances {
        layout: false,
        ..at(stamp)
    };
    assert_eq!(
        rules.order(Order::Arm, &without(1)),
        Err(two_steps::Refusal::Layout.into())
    );
    assert!(rules.order(Order::Arm, &at(1)).is_ok());
    assert_eq!(
        rules.order(Order::Execute, &without(2)),
        Err(two_steps::Refusal::Layout.into())
    );
    assert!(rules.order(Order::Execute, &at(2)).is_ok());
    assert_eq!(
        rules.order(Order::Reset, &without(3)),
        Ok(Outcome::Withdrawn(US, Action::Land))
    );
}

/// The shortest way there, and each of its steps left out, doubled or exchanged.
#[test]
fn one_step_alone_twice_or_in_reverse_commands_nothing() {
    let land = PLANS[2];
    let at = |stamp| Circumstances::good(NOW, US, stamp, land, Shows::Flying);
    let play = |orders: &[(Order, u64)]| {
        let mut rules = Rules::default();
        for (order, stamp) in orders {
            let _ = rules.order(*order, &at(*stamp));
        }
        matches!(rules.stage, Stage::Commanded { .. })
    };
    assert!(play(&[(Order::Arm, 1), (Order::Execute, 2)]));
    assert!(play(&[
        (Order::Arm, 1),
        (Order::Arm, 2),
        (Order::Execute, 3)
    ]));
    assert!(!play(&[(Order::Arm, 1)]));
    assert!(!play(&[(Order::Execute, 1)]));
    assert!(!play(&[(Order::Execute, 1), (Order::Execute, 2)]));
    assert!(!play(&[(Order::Arm, 1), (Order::Arm, 2)]));
    assert!(!play(&[(Order::Execute, 1), (Order::Arm, 2)]));
    assert!(!play(&[(Order::Arm, 2), (Order::Execute, 1)]));
    assert!(!play(&[
        (Order::Arm, 1),
        (Order::Reset, 2),
        (Order::Execute, 3)
    ]));
    // The order that withdraws came before, and was longer on its way.
    assert!(play(&[
        (Order::Arm, 2),
        (Order::Execute, 3),
        (Order::Reset, 1)
    ]));
}

#[test]
fn what_a_restart_takes_up_is_what_was_sent_and_final_where_it_was_shown() {
    let at = |stamp, plan| Circumstances::good(NOW, US, stamp, plan, Shows::Flying);
    for plan in [PLANS[1], PLANS[2]] {
        let mut rules = Rules::default();
        assert!(rules.order(Order::Arm, &at(1, plan)).is_ok());
        assert!(rules.order(Order::Execute, &at(2, plan)).is_ok());
        assert_eq!(rules.ordered(), None, "nothing was sent yet");
        rules.sent();
        let sent = rules.ordered().expect("it was sent");
        let action = sent.action;
        // Not shown: the vehicle may never have received it.
        let mut cut_off = Rules::restored(sent);
        let reset = cut_off.order(Order::Reset, &at(3, plan));
        assert_eq!(reset, Ok(Outcome::Withdrawn(US, action)));
        let mut cut_off = Rules::restored(sent);
        let disarmed = cut_off.watch(NOW, Shows::Disarmed);
        assert_eq!(disarmed, Some(Outcome::DisarmedFirst(US, action)));
        let shows = match action {
            Action::Terminate => Shows::Terminated,
            _ => Shows::Landing,
        };
        assert_eq!(
            rules.watch(NOW, shows),
            Some(Outcome::Confirmed(US, action))
        );
        let mut cut_off = Rules::restored(rules.ordered().expect("it is shown"));
        let reset = cut_off.order(Order::Reset, &at(3, plan));
        if action == Action::Terminate {
            assert_eq!(reset, Err(Refusal::Final));
        } else {
            assert_eq!(reset, Ok(Outcome::Released(US, action)));
        }
    }
}
