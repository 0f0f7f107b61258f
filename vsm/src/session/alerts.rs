//! Which alerts stand, and which id each has: raised once, updated when it changes, cleared when its cause goes.

use std::time::Duration;

use mapping::alert::Alert;
use stanag_msgs::enums::{AlertPriority, SubsystemId};

/// A cause that lasts. One alert stands for each at a time, per vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cause {
    /// No verified heartbeat of the vehicle.
    VehicleSilent,
    /// Signing is off by configuration.
    SigningOff,
    /// The controlling CUCS is silent.
    CucsSilent,
    /// A record could not be written.
    Store,
    /// What the vehicle does by itself when it hears no ground station.
    OwnFailsafe,
    /// The audit log does not follow from itself.
    Audit,
    /// A key that waits, or an exchange that cannot be.
    KeyExchange,
}

/// The alerts of one vehicle.
#[derive(Debug)]
pub(crate) struct Alerts {
    next_id: i32,
    standing: Vec<(Cause, Alert)>,
    /// Texts sent lately, so that a repeated one is not sent a hundred times.
    lately: Vec<(Duration, String)>,
}

/// An alert to send.
#[derive(Debug, Clone)]
pub(crate) struct Raised {
    pub(crate) alert: Alert,
    /// The first instance of its id.
    pub(crate) first: bool,
}

impl Alerts {
    /// `seed` sets ids of different vehicles of one VSM apart.
    pub(crate) fn new(seed: i32) -> Alerts {
        Alerts {
            next_id: seed * IDS_A_VEHICLE + 1,
            standing: Vec::new(),
            lately: Vec::new(),
        }
    }

    /// A cause that lasts; `None` where it already stands with this text.
    pub(crate) fn raise(
        &mut self,
        cause: Cause,
        priority: AlertPriority,
        subsystem: SubsystemId,
        text: String,
    ) -> Option<Raised> {
        if let Some((_, standing)) = self.standing.iter_mut().find(|(known, _)| *known == cause) {
            if standing.text == text && standing.priority == priority {
                return None;
            }
            standing.text = text;
            standing.priority = priority;
            return Some(Raised {
                alert: standing.clone(),
                first: false,
            });
        }
        let alert = Alert {
            id: self.take_id(),
            priority,
            subsystem,
            text,
        };
        self.standing.push((cause, alert.clone()));
        Some(Raised { alert, first: true })
    }

    /// The cause is gone; `None` where it did not stand.
    pub(crate) fn clear(&mut self, cause: Cause, text: &str) -> Option<Raised> {
        let at = self
            .standing
            .iter()
            .position(|(known, _)| *known == cause)?;
        let (_, mut alert) = self.standing.remove(at);
        alert.priority = AlertPriority::Cleared;
        text.clone_into(&mut alert.text);
        Some(Raised {
            alert,
            first: false,
        })
    }

    /// Something that happened; `None` where the same text went out less than [`QUIET`] ago.
    pub(crate) fn notice(
        &mut self,
        now: Duration,
        priority: AlertPriority,
        subsystem: SubsystemId,
        text: String,
    ) -> Option<Raised> {
        self.lately
            .retain(|(at, _)| now.saturating_sub(*at) < QUIET);
        if self.lately.len() >= MOST_LATELY || self.lately.iter().any(|(_, known)| *known == text) {
            return None;
        }
        self.lately.push((now, text.clone()));
        Some(Raised {
            alert: Alert {
                id: self.take_id(),
                priority,
                subsystem,
                text,
            },
            first: true,
        })
    }

    /// The answer to one command: never held back, also where the same text went out just now.
    pub(crate) fn answer(
        &mut self,
        priority: AlertPriority,
        subsystem: SubsystemId,
        text: String,
    ) -> Raised {
        Raised {
            alert: Alert {
                id: self.take_id(),
                priority,
                subsystem,
                text,
            },
            first: true,
        }
    }

    /// What stands, for a CUCS that starts to listen.
    pub(crate) fn standing(&self) -> impl Iterator<Item = &Alert> {
        self.standing.iter().map(|(_, alert)| alert)
    }

    fn take_id(&mut self) -> i32 {
        let id = self.next_id;
        let base = (id - 1) / IDS_A_VEHICLE * IDS_A_VEHICLE;
        self.next_id = base + 1 + (id - base) % (IDS_A_VEHICLE - 1);
        id
    }
}

/// The vehicle that a text is about is the wrapper's source; this only keeps ids apart.
const IDS_A_VEHICLE: i32 = 1_000_000;
/// The same text is not repeated within this time.
const QUIET: Duration = Duration::from_secs(2);
/// Most different texts within [`QUIET`].
const MOST_LATELY: usize = 50;
