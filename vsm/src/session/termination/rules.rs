//! The rules of a flight termination: a machine without messages, clock, disk or vehicle.
//!
//! It promises, checked by `every_state` over every state that can be reached:
//! - It is commanded only by two orders, to arm and then to execute, the second later than the first by the station's own
//!   stamps, of one CUCS that holds LOI 5 in control at an address that it has proven, each fresh, with no handover in
//!   progress, within [`Plan::armed`] of each other.
//! - It is disarmed if it is not commanded in time, if control changes, or if a reloaded configuration plans it differently.
//!   A restart arms nothing. One that was commanded is remembered over it, and never commanded again by itself: what the vehicle shows
//!   decides whether it is still being done.
//! - [`Stage::Executing`] is the vehicle's reported state, never the commanded one.
//! - PX4 does not leave a flight termination: then no reset is granted.

#[cfg(test)]
mod every_state;

use std::time::Duration;

use stanag_msgs::Id;
use stanag_msgs::enums::FtState;

use crate::config::TerminationAction as Action;
use crate::session::two_steps::{self, Latest, Order};

/// The stage of a termination.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub(crate) enum Stage {
    /// Nothing is armed.
    #[default]
    Safe,
    /// A CUCS has armed it.
    Armed {
        /// The CUCS.
        by: Id,
        /// What will be done.
        action: Action,
        /// When it is disarmed again.
        until: Duration,
    },
    /// It is commanded, but not confirmed by the vehicle.
    Commanded {
        /// The CUCS.
        by: Id,
        /// What is commanded.
        action: Action,
        /// When it is given up.
        until: Duration,
        /// The command was sent to the vehicle.
        sent: bool,
    },
    /// It was commanded before a restart of the VSM; what the vehicle does is not known yet.
    CutOff {
        /// The CUCS.
        by: Id,
        /// What was commanded.
        action: Action,
        /// The vehicle had shown it.
        shown: bool,
        /// Since when the vehicle shows something else.
        left: Option<Duration>,
    },
    /// The vehicle shows it.
    Executing {
        /// The commanding CUCS; `None`: the vehicle itself, its pilot or another station.
        by: Option<Id>,
        /// What it does.
        action: Action,
        /// Since when it has shown something else. It is not left at once: a report of its mode may be newer than that of
        /// its motors.
        left: Option<Duration>,
    },
}

/// The configured plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Plan {
    pub(crate) action: Action,
    /// How long it stays armed.
    pub(crate) armed: Duration,
    /// How long the command is repeated until the vehicle shows it.
    pub(crate) confirm: Duration,
}

/// The state in which an order is decided.
pub(crate) type Circumstances = two_steps::Circumstances<Plan, Shows>;

/// What the vehicle shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Shows {
    /// No data from the vehicle.
    Nothing,
    /// Motors disarmed.
    Disarmed,
    /// Motors armed, in another mode than those below.
    Flying,
    /// TERMINATION, which PX4 leaves only by a restart.
    Terminated,
    /// AUTO.LAND.
    Landing,
    /// AUTO.RTL.
    Returning,
}

impl Shows {
    /// Whether this is what the action leads to.
    pub(crate) fn does(self, action: Action) -> bool {
        matches!(
            (self, action),
            (Shows::Terminated, Action::Terminate)
                | (Shows::Landing, Action::Land)
                | (Shows::Returning, Action::Return)
        )
    }

    /// The same, once the vehicle has shown it: PX4 returns and then lands by itself.
    pub(crate) fn continues(self, action: Action) -> bool {
        self.does(action) || (self, action) == (Shows::Landing, Action::Return)
    }
}

/// Why an order is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Refusal {
    /// The two steps.
    Steps(two_steps::Refusal),
    Disarmed,
    AlreadyCommanded,
    AlreadyExecuting,
    Final,
}

impl From<two_steps::Refusal> for Refusal {
    fn from(refusal: two_steps::Refusal) -> Refusal {
        Refusal::Steps(refusal)
    }
}

/// The outcome.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Outcome {
    Armed(Id, Action),
    Commanded(Id, Action),
    /// Reset before it was commanded, or although nothing was armed (`false`).
    Reset(Id, bool),
    /// Reset while it was commanded: the vehicle may have received it.
    Withdrawn(Id, Action),
    /// Reset while the vehicle lands or returns: other commands are accepted again.
    Released(Id, Action),
    ArmedTooLong(Id),
    ControlPassed(Id),
    Replanned(Id),
    Confirmed(Id, Action),
    /// The vehicle does what was commanded before a restart.
    Resumed(Id, Action),
    /// It does not.
    NotResumed(Id, Action),
    /// The vehicle reports it without a command of this VSM.
    ByItself,
    Unconfirmed(Id, Action),
    /// The vehicle was disarmed before it showed the action.
    DisarmedFirst(Id, Action),
    /// It landed, or returned, and is disarmed.
    Done(Action),
    /// The CUCS in control cannot send the order to reset: other commands are accepted again.
    ReleasedTo(Id, Action),
    /// It has left the commanded state.
    Left(Action),
    /// It no longer reports a termination: PX4 has restarted.
    Restarted,
}

/// An order that was sent to the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Ordered {
    /// The CUCS.
    pub(crate) by: Id,
    pub(crate) action: Action,
    /// The vehicle has shown it.
    pub(crate) shown: bool,
    /// The latest order that was taken.
    pub(crate) latest: Latest,
}

/// The machine.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub(crate) struct Rules {
    stage: Stage,
    /// The latest accepted order to arm or to execute: its CUCS and its Time Stamp.
    ordered: Latest,
}

impl Rules {
    pub(crate) fn stage(&self) -> Stage {
        self.stage
    }

    /// Reported Flight Termination State of 3005.
    pub(crate) fn reported(&self) -> FtState {
        match self.stage {
            Stage::Safe => FtState::Reset,
            // Commanded does not mean executed: a range officer must not read that a vehicle is falling while it is still
            // flying.
            Stage::Armed { .. } | Stage::Commanded { .. } | Stage::CutOff { .. } => FtState::Arm,
            Stage::Executing { .. } => FtState::Execute,
        }
    }

    /// Whether nothing else may be flown: it is commanded, or the vehicle does what was commanded.
    pub(crate) fn holds(&self) -> bool {
        matches!(
            self.stage,
            Stage::Commanded { .. } | Stage::CutOff { .. } | Stage::Executing { by: Some(_), .. }
        )
    }

    /// What a restart must not forget. An order of which nothing has left yet is not among it: what the vehicle does is not by it.
    pub(crate) fn ordered(&self) -> Option<Ordered> {
        let (by, action, shown) = match self.stage {
            Stage::Commanded {
                by,
                action,
                sent: true,
                ..
            } => (by, action, false),
            Stage::CutOff {
                by, action, shown, ..
            } => (by, action, shown),
            Stage::Executing {
                by: Some(by),
                action,
                ..
            } => (by, action, true),
            _ => return None,
        };
        Some(Ordered {
            by,
            action,
            shown,
            latest: self.ordered,
        })
    }

    /// After a restart, with what [`Rules::ordered`] was before it.
    pub(crate) fn restored(ordered: Ordered) -> Rules {
        let Ordered {
            by, action, shown, ..
        } = ordered;
        Rules {
            stage: Stage::CutOff {
                by,
                action,
                shown,
                left: None,
            },
            ordered: ordered.latest,
        }
    }

    /// The VSM did not run: what the vehicle showed before that is no reason to take it for left.
    pub(crate) fn note_stop(&mut self) {
        if let Stage::CutOff { left, .. } | Stage::Executing { left, .. } = &mut self.stage {
            *left = None;
        }
    }

    /// A 2005.
    pub(crate) fn order(&mut self, order: Order, at: &Circumstances) -> Result<Outcome, Refusal> {
        let plan = two_steps::may_order(order, at)?;
        let (stage, outcome) = match order {
            Order::Reset => self.reset(at)?,
            Order::Arm => self.arm(plan.ok_or(two_steps::Refusal::NotPlanned)?, at)?,
            Order::Execute => self.execute(plan.ok_or(two_steps::Refusal::NotPlanned)?, at)?,
        };
        self.ordered = Some((at.by, at.stamp));
        self.stage = stage;
        Ok(outcome)
    }

    fn reset(&self, at: &Circumstances) -> Result<(Stage, Outcome), Refusal> {
        if self.stage != Stage::Safe {
            // An older, delayed order must not undo a newer one.
            two_steps::follows(self.ordered, at)?;
        }
        let outcome = match self.stage {
            Stage::Executing {
                action: Action::Terminate,
                ..
            }
            | Stage::CutOff {
                action: Action::Terminate,
                shown: true,
                ..
            } => return Err(Refusal::Final),
            Stage::Safe => Outcome::Reset(at.by, false),
            Stage::Armed { .. } => Outcome::Reset(at.by, true),
            Stage::CutOff {
                action,
                shown: true,
                ..
            } => Outcome::Released(at.by, action),
            Stage::Commanded { action, .. }
            | Stage::CutOff {
                action,
                shown: false,
                ..
            } => Outcome::Withdrawn(at.by, action),
            Stage::Executing { action, .. } => Outcome::Released(at.by, action),
        };
        Ok((Stage::Safe, outcome))
    }

    fn arm(&self, plan: Plan, at: &Circumstances) -> Result<(Stage, Outcome), Refusal> {
        let armed = match self.stage {
            Stage::Armed { by, .. } => Some(by),
            Stage::Safe => None,
            Stage::Commanded { .. } | Stage::CutOff { .. } => {
                return Err(Refusal::AlreadyCommanded);
            }
            Stage::Executing { .. } => return Err(Refusal::AlreadyExecuting),
        };
        two_steps::may_arm(armed, self.ordered, at)?;
        if at.vehicle == Shows::Disarmed {
            return Err(Refusal::Disarmed);
        }
        let stage = Stage::Armed {
            by: at.by,
            action: plan.action,
            until: at.now + plan.armed,
        };
        Ok((stage, Outcome::Armed(at.by, plan.action)))
    }

    fn execute(&self, plan: Plan, at: &Circumstances) -> Result<(Stage, Outcome), Refusal> {
        let (by, action, until) = match self.stage {
            Stage::Armed { by, action, until } => (by, action, until),
            Stage::Safe => return Err(two_steps::Refusal::NotArmed.into()),
            Stage::Commanded { .. } | Stage::CutOff { .. } => {
                return Err(Refusal::AlreadyCommanded);
            }
            Stage::Executing { .. } => return Err(Refusal::AlreadyExecuting),
        };
        two_steps::may_execute((by, until), self.ordered, at)?;
        if action != plan.action {
            return Err(two_steps::Refusal::NotArmed.into());
        }
        if at.vehicle == Shows::Disarmed {
            return Err(Refusal::Disarmed);
        }
        let stage = Stage::Commanded {
            by,
            action,
            until: at.now + plan.confirm,
            sent: false,
        };
        Ok((stage, Outcome::Commanded(by, action)))
    }

    /// The command was sent to the vehicle.
    pub(crate) fn sent(&mut self) {
        if let Stage::Commanded { sent, .. } = &mut self.stage {
            *sent = true;
        }
    }

    /// Control has passed to `controller`, or to nobody. A commanded termination continues: it was lawful when it was
    /// commanded.
    pub(crate) fn control_passed(&mut self, controller: Option<Id>) -> Option<Outcome> {
        match self.stage {
            Stage::Armed { by, .. } if controller != Some(by) => {
                self.stage = Stage::Safe;
                Some(Outcome::ControlPassed(by))
            }
            _ => None,
        }
    }

    /// The CUCS in control has no layout of 2005. It could neither reset a landing or return nor command anything else, and
    /// the vehicle would obey nobody until it has landed. A command that is not shown yet continues: it ends by itself.
    pub(crate) fn controlled_without_layout(&mut self, controller: Id) -> Option<Outcome> {
        match self.stage {
            Stage::Executing {
                by: Some(_),
                action: action @ (Action::Land | Action::Return),
                ..
            }
            | Stage::CutOff {
                action: action @ (Action::Land | Action::Return),
                ..
            } => {
                self.stage = Stage::Safe;
                Some(Outcome::ReleasedTo(controller, action))
            }
            _ => None,
        }
    }

    /// The configuration was read again.
    pub(crate) fn replanned(&mut self, plan: Option<Plan>) -> Option<Outcome> {
        match self.stage {
            Stage::Armed { by, action, .. } if plan.map(|plan| plan.action) != Some(action) => {
                self.stage = Stage::Safe;
                Some(Outcome::Replanned(by))
            }
            _ => None,
        }
    }

    /// Time has passed, or the vehicle shows something else.
    pub(crate) fn watch(&mut self, now: Duration, vehicle: Shows) -> Option<Outcome> {
        let by_itself = Stage::Executing {
            by: None,
            action: Action::Terminate,
            left: None,
        };
        let (stage, outcome) = match (self.stage, vehicle) {
            (
                Stage::Commanded {
                    by,
                    action,
                    sent: true,
                    ..
                },
                vehicle,
            ) if vehicle.does(action) => {
                let by = Some(by);
                let left = None;
                let stage = Stage::Executing { by, action, left };
                (stage, Outcome::Confirmed(by?, action))
            }
            (Stage::CutOff { by, action, .. }, vehicle) if vehicle.continues(action) => {
                let (by, left) = (Some(by), None);
                let stage = Stage::Executing { by, action, left };
                (stage, Outcome::Resumed(by?, action))
            }
            (
                Stage::Safe | Stage::Armed { .. } | Stage::Commanded { .. } | Stage::CutOff { .. },
                Shows::Terminated,
            ) => (by_itself, Outcome::ByItself),
            (Stage::CutOff { .. }, Shows::Nothing) => {
                self.note_stop();
                return None;
            }
            (
                Stage::CutOff {
                    by, action, shown, ..
                },
                Shows::Disarmed,
            ) => match shown {
                true => (Stage::Safe, Outcome::Done(action)),
                false => (Stage::Safe, Outcome::DisarmedFirst(by, action)),
            },
            (
                Stage::CutOff {
                    by,
                    action,
                    shown,
                    left,
                },
                _,
            ) => match left {
                Some(since) if now >= since + LEFT_FOR => {
                    (Stage::Safe, Outcome::NotResumed(by, action))
                }
                _ => {
                    self.stage = Stage::CutOff {
                        by,
                        action,
                        shown,
                        left: left.or(Some(now)),
                    };
                    return None;
                }
            },
            (Stage::Armed { by, until, .. }, _) if now >= until => {
                (Stage::Safe, Outcome::ArmedTooLong(by))
            }
            // If it were sent any longer, it would end the next flight as soon as the vehicle is armed again.
            (Stage::Commanded { by, action, .. }, Shows::Disarmed) => {
                (Stage::Safe, Outcome::DisarmedFirst(by, action))
            }
            (
                Stage::Commanded {
                    by, action, until, ..
                },
                _,
            ) if now >= until => (Stage::Safe, Outcome::Unconfirmed(by, action)),
            // The time for which it has shown something else starts again: otherwise it would run out while nothing is
            // received.
            (Stage::Executing { by, action, .. }, Shows::Nothing) => {
                let left = None;
                self.stage = Stage::Executing { by, action, left };
                return None;
            }
            (Stage::Executing { by, action, .. }, vehicle) if vehicle.continues(action) => {
                let left = None;
                self.stage = Stage::Executing { by, action, left };
                return None;
            }
            (Stage::Executing { .. }, Shows::Terminated) => (by_itself, Outcome::ByItself),
            (
                Stage::Executing {
                    action: Action::Terminate,
                    ..
                },
                _,
            ) => (Stage::Safe, Outcome::Restarted),
            (Stage::Executing { action, .. }, Shows::Disarmed) => {
                (Stage::Safe, Outcome::Done(action))
            }
            (Stage::Executing { by, action, left }, _) => match left {
                Some(since) if now >= since + LEFT_FOR => (Stage::Safe, Outcome::Left(action)),
                _ => {
                    let left = left.or(Some(now));
                    self.stage = Stage::Executing { by, action, left };
                    return None;
                }
            },
            _ => return None,
        };
        self.stage = stage;
        Some(outcome)
    }

    /// When [`Rules::watch`] is next needed, if the vehicle shows nothing new.
    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        match self.stage {
            Stage::Armed { until, .. } | Stage::Commanded { until, .. } => Some(until),
            Stage::CutOff { left, .. } | Stage::Executing { left, .. } => {
                left.map(|since| since + LEFT_FOR)
            }
            Stage::Safe => None,
        }
    }
}

/// A vehicle that has landed may show its next mode before it shows that it is disarmed: HEARTBEAT comes once a second, and
/// some are lost.
const LEFT_FOR: Duration = Duration::from_secs(3);
