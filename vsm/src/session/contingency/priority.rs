//! The priority of the VSM's own actions: the one place that decides which of them is flown.
//!
//! Above all of them are, in this order: a flight termination (`Flight::handle`), a pilot and PX4's own failsafes
//! ([`Other`](crate::session::other::Other)), and a command of the CUCS in control. Among themselves the more urgent action
//! is flown: hold, a contingency route, return, landing. Of two equally urgent ones the contingency's is flown, since it
//! knows what is wrong. A less urgent action does not end what is flown as long as its cause persists and the vehicle shows
//! it: a vehicle on its way home with an empty battery is not put on hold because its CUCS is lost too.

use mapping::mode::Px4Mode;
use stanag_msgs::enums::RouteType;

use crate::config::ContingencyAction;

/// The urgency of an action, the least urgent first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Urgency {
    Hold,
    Route,
    Return,
    Land,
}

/// Which machine flies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Turn {
    Nobody,
    Loss,
    Contingency,
}

impl Urgency {
    pub(crate) fn of_contingency(action: ContingencyAction) -> Urgency {
        match action {
            ContingencyAction::Hold => Urgency::Hold,
            ContingencyAction::ContingencyA | ContingencyAction::ContingencyB => Urgency::Route,
            ContingencyAction::Rtl => Urgency::Return,
            ContingencyAction::Land => Urgency::Land,
        }
    }
}

/// Decides which machine flies, by the urgency of the loss action and of the most urgent contingency.
pub(crate) fn turn(termination: bool, loss: Option<Urgency>, contingency: Option<Urgency>) -> Turn {
    match (termination, loss, contingency) {
        (true, ..) | (_, None, None) => Turn::Nobody,
        (_, Some(loss), Some(contingency)) if loss > contingency => Turn::Loss,
        (_, _, Some(_)) => Turn::Contingency,
        (_, Some(_), None) => Turn::Loss,
    }
}

/// Whether a vehicle in this mode, with this route aboard, flies the action or a more urgent one. `lands`: it flies the
/// landing of a mission.
pub(crate) fn is_shown(
    action: ContingencyAction,
    mode: Px4Mode,
    carries: Option<RouteType>,
    lands: bool,
) -> bool {
    let landing = mode == Px4Mode::LAND || (mode == Px4Mode::MISSION && lands);
    let returning = mode == Px4Mode::RTL || landing;
    let flies = |route| mode == Px4Mode::MISSION && carries == Some(route);
    let (a, b) = (
        flies(RouteType::ContingencyA),
        flies(RouteType::ContingencyB),
    );
    match action {
        ContingencyAction::Hold => {
            [Px4Mode::LOITER, Px4Mode::ORBIT].contains(&mode) || a || b || returning
        }
        ContingencyAction::ContingencyA => a || returning,
        ContingencyAction::ContingencyB => b || returning,
        ContingencyAction::Rtl => returning,
        ContingencyAction::Land => landing,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Option<Urgency>; 5] = [
        None,
        Some(Urgency::Hold),
        Some(Urgency::Route),
        Some(Urgency::Return),
        Some(Urgency::Land),
    ];

    #[test]
    fn every_combination_of_termination_loss_action_and_contingency_is_decided() {
        // Rows: the loss action; columns: the contingency. N nobody, L loss action, C contingency.
        let expected = ["NCCCC", "LCCCC", "LLCCC", "LLLCC", "LLLLC"];
        for (loss, row) in ALL.into_iter().zip(expected) {
            for (contingency, letter) in ALL.into_iter().zip(row.chars()) {
                let turns = turn(false, loss, contingency);
                let shown = match turns {
                    Turn::Nobody => 'N',
                    Turn::Loss => 'L',
                    Turn::Contingency => 'C',
                };
                assert_eq!(shown, letter, "{loss:?} {contingency:?}");
                assert_eq!(turn(true, loss, contingency), Turn::Nobody);
            }
        }
    }

    #[test]
    fn an_action_is_shown_by_its_mode_and_by_what_is_more_urgent() {
        use ContingencyAction as A;
        let modes = [
            Px4Mode::LOITER,
            Px4Mode::MISSION,
            Px4Mode::RTL,
            Px4Mode::LAND,
        ];
        for (action, expected) in [
            (A::Hold, [true, true, true, true]),
            (A::ContingencyA, [false, true, true, true]),
            (A::ContingencyB, [false, false, true, true]),
            (A::Rtl, [false, false, true, true]),
            (A::Land, [false, false, false, true]),
        ] {
            let carries = Some(RouteType::ContingencyA);
            let shown = modes.map(|mode| is_shown(action, mode, carries, false));
            assert_eq!(shown, expected, "{action:?}");
            assert!(!is_shown(action, Px4Mode::POSCTL, carries, false));
            assert!(!is_shown(
                action,
                Px4Mode::MISSION,
                Some(RouteType::Flight),
                false
            ));
        }
        let carries = Some(RouteType::Flight);
        assert!(is_shown(A::Land, Px4Mode::MISSION, carries, true));
        assert!(is_shown(A::Rtl, Px4Mode::MISSION, carries, true));
        assert!(!is_shown(A::Land, Px4Mode::MISSION, carries, false));
    }
}
