//! Two orders of one CUCS, to arm and then to execute, and what each of them must be: for what ends a flight (2005), and for what
//! erases this VSM (50024).
//!
//! Each of these is a pure machine with stages of its own; what both ask of an order, and of the order before it, is here.

use std::time::Duration;

use stanag_msgs::enums::FtState;
use stanag_msgs::{Id, TimeStamp};

use super::duplicates::{Delay, stamps_apart_ms};

/// What is commanded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Order {
    Reset,
    Arm,
    Execute,
}

/// What is known when an order comes. `P`: what the configuration plans; `V`: what of the vehicles matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Circumstances<P, V> {
    pub(crate) now: Duration,
    pub(crate) by: Id,
    pub(crate) stamp: TimeStamp,
    /// It holds LOI 5, in control.
    pub(crate) controls: bool,
    /// Its holder hands control over to another CUCS, which is not in control yet.
    pub(crate) handover: bool,
    /// The station is where the order came from.
    pub(crate) proven: bool,
    pub(crate) delay: Delay,
    /// The layout of the message may be used with this station.
    pub(crate) layout: bool,
    /// `None`: the configuration allows none.
    pub(crate) plan: Option<P>,
    pub(crate) vehicle: V,
}

/// Why an order is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Refusal {
    NotPlanned,
    Layout,
    NoRight,
    Unproven,
    Handover,
    /// By the station's own clock.
    Late(Duration),
    Ahead,
    Unmeasured,
    /// No order to execute is taken before one to arm.
    NotArmed,
    /// It was made before the latest order of its CUCS that was taken.
    Reversed,
    /// Another CUCS has armed it.
    ArmedByAnother(Id),
}

/// The latest order that was taken: whose, and its Time Stamp.
pub(crate) type Latest = Option<(Id, TimeStamp)>;

/// Commanded state of the message, or why it is none.
pub(crate) fn order(state: Option<FtState>, field: &str) -> Result<Order, String> {
    match state {
        Some(FtState::Reset) => Ok(Order::Reset),
        Some(FtState::Arm) => Ok(Order::Arm),
        Some(FtState::Execute) => Ok(Order::Execute),
        Some(other) => Err(format!("{field} {}, expected 0 to 2", other.raw())),
        None => Err(format!("{field} is missing")),
    }
}

/// What every order needs, whatever the stage; a reset less: it is the safe direction, is judged by its stamp, and comes
/// also of a CUCS whose layout of the message is not agreed on, which could command nothing else before it.
pub(crate) fn may_order<P: Copy, V>(
    order: Order,
    at: &Circumstances<P, V>,
) -> Result<Option<P>, Refusal> {
    if !at.layout && order != Order::Reset {
        return Err(Refusal::Layout);
    }
    if !at.controls {
        return Err(Refusal::NoRight);
    }
    if !at.proven {
        return Err(Refusal::Unproven);
    }
    if order == Order::Reset {
        return Ok(at.plan);
    }
    let plan = at.plan.ok_or(Refusal::NotPlanned)?;
    if at.handover {
        return Err(Refusal::Handover);
    }
    match at.delay {
        Delay::Behind(by) if by <= MAX_DELAY => Ok(Some(plan)),
        Delay::Behind(by) => Err(Refusal::Late(by)),
        Delay::Ahead(_) => Err(Refusal::Ahead),
        Delay::Unknown => Err(Refusal::Unmeasured),
    }
}

/// Whether an order was made after the latest that was taken, by the clock of its station. Of another station, which has
/// taken control over since, nothing can be compared.
pub(crate) fn follows<P, V>(latest: Latest, at: &Circumstances<P, V>) -> Result<(), Refusal> {
    match latest {
        Some((by, stamp)) if by == at.by && stamps_apart_ms(at.stamp, stamp) <= 0 => {
            Err(Refusal::Reversed)
        }
        _ => Ok(()),
    }
}

/// Whether it may be armed; `armed`: by whom it is already.
pub(crate) fn may_arm<P, V>(
    armed: Option<Id>,
    latest: Latest,
    at: &Circumstances<P, V>,
) -> Result<(), Refusal> {
    match armed {
        Some(by) if by != at.by => Err(Refusal::ArmedByAnother(by)),
        _ => follows(latest, at),
    }
}

/// Whether what this CUCS has armed, until then, may be executed.
pub(crate) fn may_execute<P, V>(
    (by, until): (Id, Duration),
    latest: Latest,
    at: &Circumstances<P, V>,
) -> Result<(), Refusal> {
    if by != at.by {
        return Err(Refusal::ArmedByAnother(by));
    }
    if at.now >= until {
        return Err(Refusal::NotArmed);
    }
    follows(latest, at)
}

impl Refusal {
    /// For operators.
    pub(crate) fn words(self, armed_s: f64) -> String {
        match self {
            Refusal::NotPlanned => "it is off by the configuration of the VSM".into(),
            Refusal::Layout => "the layout of the message is not agreed on (dli.provisional)".into(),
            Refusal::NoRight => "it needs LOI 5 (launch) in control of the vehicle".into(),
            Refusal::Unproven => {
                "the address that it came from is not proven: acknowledge the heartbeats (16002) of the VSM, or set \
                 cucs.address"
                    .into()
            }
            Refusal::Handover => {
                "control is being handed over to another CUCS: wait for the end of the handover".into()
            }
            Refusal::Late(by) => format!(
                "it was {:.1} s on its way by this station's own clock, expected at most {} s: send it again",
                by.as_secs_f64(),
                MAX_DELAY.as_secs()
            ),
            Refusal::Ahead => {
                "its Time Stamp is ahead of this station's clock: send it again once the clock is steady".into()
            }
            Refusal::Unmeasured => {
                "this station's clock is not measured yet: send messages (16002 once a second) for 4 s, then send it \
                 again"
                    .into()
            }
            Refusal::NotArmed => format!(
                "it is not armed: arm it (state 1, arm), then execute it (state 2, execute) within {armed_s} s"
            ),
            Refusal::Reversed => "its Time Stamp is not later than that of the order before it".into(),
            Refusal::ArmedByAnother(id) => format!("{id} has armed it"),
        }
    }
}

/// Maximum delay of an order to arm or to execute.
pub(crate) const MAX_DELAY: Duration = Duration::from_secs(2);

/// For the tests of every state of either.
#[cfg(test)]
impl<P: Copy, V: Copy> Circumstances<P, V> {
    /// In which every order is taken, but for its stamp, plan and vehicle.
    pub(crate) fn good(now: Duration, by: Id, stamp: u64, plan: Option<P>, vehicle: V) -> Self {
        Circumstances {
            now,
            by,
            stamp: TimeStamp(stamp),
            controls: true,
            handover: false,
            proven: true,
            delay: Delay::Behind(MAX_DELAY),
            layout: true,
            plan,
            vehicle,
        }
    }

    /// The same, and each of what is wrong with it.
    pub(crate) fn flawed(self) -> Vec<Self> {
        let late = Duration::from_millis(2_001);
        let mut all = vec![self; 7];
        all[1].controls = false;
        all[2].handover = true;
        all[3].proven = false;
        all[4].delay = Delay::Behind(late);
        all[5].delay = Delay::Ahead(late);
        all[6].delay = Delay::Unknown;
        all
    }
}
