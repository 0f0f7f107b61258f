//! What may be done towards a zeroize, and when: a machine without messages, clock, disk or vehicle.
//!
//! Promised, and checked by `every_state` over every state that can be reached:
//! - A CUCS orders it only by two orders, to arm and then to execute, as [`two_steps`] has them: LOI 5 in control, from a
//!   proven address, fresh, in order, within [`Plan::armed`] of each other; and whose guard has verified both, where others than
//!   programs of this computer reach the DLI.
//! - No order is taken while another CUCS controls any vehicle of this VSM, or one of them is not known to be disarmed, unless the
//!   configuration allows that: the link of each ends with it.
//! - It is disarmed if it is not executed in time or if control changes. A restart arms nothing.
//! - What is ordered stays ordered: no reset takes it back.

#[cfg(test)]
mod every_state;

use std::time::Duration;

use stanag_msgs::Id;

use crate::session::two_steps::{self, Latest, Order};

/// How far it has gone.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub(crate) enum Stage {
    /// Nothing is armed.
    #[default]
    Safe,
    /// A CUCS has armed it.
    Armed {
        /// Which.
        by: Id,
        /// Until it is disarmed.
        until: Duration,
    },
    /// It is to be stored, and then carried out.
    Ordered,
}

/// What the configuration allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Plan {
    /// How long it stays armed.
    pub(crate) armed: Duration,
    /// Also while a vehicle is not known to be disarmed.
    pub(crate) in_flight: bool,
    /// The sender is who it says: its guard has verified the order, or none but programs of this computer can send one.
    pub(crate) authentic: bool,
}

/// The vehicles of this VSM.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub(crate) struct Fleet {
    /// One that is not known to be disarmed.
    pub(crate) flying: Option<Id>,
    /// One that another CUCS controls, and that CUCS.
    pub(crate) of_another: Option<(Id, Id)>,
}

pub(crate) type Circumstances = two_steps::Circumstances<Plan, Fleet>;

/// Why an order is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Refusal {
    /// The two steps.
    Steps(two_steps::Refusal),
    Unguarded,
    InFlight(Id),
    /// Another CUCS controls a vehicle.
    OfAnother(Id, Id),
    AlreadyOrdered,
}

impl From<two_steps::Refusal> for Refusal {
    fn from(refusal: two_steps::Refusal) -> Refusal {
        Refusal::Steps(refusal)
    }
}

/// What has become of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Outcome {
    /// `flying`: a vehicle that will lose its link in flight.
    Armed {
        by: Id,
        flying: Option<Id>,
    },
    /// Of nobody: of an operator of this computer.
    Ordered {
        by: Option<Id>,
        flying: Option<Id>,
    },
    /// `false`: nothing was armed.
    Reset(Id, bool),
    ArmedTooLong(Id),
    ControlPassed(Id),
}

/// The machine.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub(crate) struct Rules {
    stage: Stage,
    /// The latest order that was taken.
    latest: Latest,
}

impl Rules {
    pub(crate) fn stage(&self) -> Stage {
        self.stage
    }

    /// A 50024.
    pub(crate) fn order(&mut self, order: Order, at: &Circumstances) -> Result<Outcome, Refusal> {
        let plan = two_steps::may_order(order, at)?;
        if self.stage == Stage::Ordered {
            return Err(Refusal::AlreadyOrdered);
        }
        let armed = match self.stage {
            Stage::Armed { by, until } => Some((by, until)),
            _ => None,
        };
        let (stage, outcome) = match order {
            Order::Reset => {
                if armed.is_some() {
                    two_steps::follows(self.latest, at)?;
                }
                (Stage::Safe, Outcome::Reset(at.by, armed.is_some()))
            }
            Order::Arm => {
                let plan = authentic(plan)?;
                two_steps::may_arm(armed.map(|(by, _)| by), self.latest, at)?;
                spares(&at.vehicle, plan.in_flight)?;
                let (by, until) = (at.by, at.now + plan.armed);
                let flying = at.vehicle.flying;
                (Stage::Armed { by, until }, Outcome::Armed { by, flying })
            }
            Order::Execute => {
                let plan = authentic(plan)?;
                let armed = armed.ok_or(two_steps::Refusal::NotArmed)?;
                two_steps::may_execute(armed, self.latest, at)?;
                spares(&at.vehicle, plan.in_flight)?;
                let (by, flying) = (Some(at.by), at.vehicle.flying);
                (Stage::Ordered, Outcome::Ordered { by, flying })
            }
        };
        self.latest = Some((at.by, at.stamp));
        self.stage = stage;
        Ok(outcome)
    }

    /// An operator of this computer orders it, who could delete the files anyway: whoever controls a vehicle is alerted.
    pub(crate) fn order_here(&mut self, in_flight: bool, fleet: Fleet) -> Result<Outcome, Refusal> {
        if self.stage == Stage::Ordered {
            return Err(Refusal::AlreadyOrdered);
        }
        let of_another = None;
        spares(
            &Fleet {
                of_another,
                ..fleet
            },
            in_flight,
        )?;
        self.stage = Stage::Ordered;
        let flying = fleet.flying;
        Ok(Outcome::Ordered { by: None, flying })
    }

    /// The order could not be stored: nothing is erased.
    pub(crate) fn not_stored(&mut self) {
        self.stage = Stage::Safe;
    }

    /// Time has passed, or control has; `controls`: whether this CUCS still has it of the vehicle by which it was armed.
    pub(crate) fn watch(
        &mut self,
        now: Duration,
        controls: impl FnOnce(Id) -> bool,
    ) -> Option<Outcome> {
        let Stage::Armed { by, until } = self.stage else {
            return None;
        };
        let outcome = match controls(by) {
            false => Outcome::ControlPassed(by),
            true if now >= until => Outcome::ArmedTooLong(by),
            true => return None,
        };
        self.stage = Stage::Safe;
        Some(outcome)
    }

    /// When [`Rules::watch`] is next needed.
    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        match self.stage {
            Stage::Armed { until, .. } => Some(until),
            Stage::Safe | Stage::Ordered => None,
        }
    }
}

/// What is allowed, of a sender that cannot be another: what is erased by two forged datagrams is gone for good.
fn authentic(plan: Option<Plan>) -> Result<Plan, Refusal> {
    let plan = plan.ok_or(two_steps::Refusal::NotPlanned)?;
    plan.authentic.then_some(plan).ok_or(Refusal::Unguarded)
}

/// Whether nobody loses a vehicle by it that is not theirs to give up, and none loses its link in flight.
fn spares(fleet: &Fleet, in_flight: bool) -> Result<(), Refusal> {
    match (fleet.of_another, fleet.flying) {
        (Some((vehicle, by)), _) => Err(Refusal::OfAnother(vehicle, by)),
        (None, Some(vehicle)) if !in_flight => Err(Refusal::InFlight(vehicle)),
        _ => Ok(()),
    }
}
