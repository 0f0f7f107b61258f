//! What is kept of a termination over a restart: that it was sent to the vehicle, by whom, and what.
//!
//! Without it, the next command of a station, or one that it only repeats, would take the vehicle out of the landing or the return. It
//! commands nothing: what the vehicle shows decides what becomes of it ([`Stage::CutOff`](super::rules::Stage::CutOff)). Nor does it
//! apply to another flight: one of before the computer was restarted is only named.

use std::time::Duration;

use mavlink_link::store::{Record as _, Store as _, StoreError};
use serde::{Deserialize, Serialize};
use stanag_msgs::enums::{AlertPriority, SubsystemId};
use stanag_msgs::{Id, TimeStamp};

use super::rules::{Ordered, Rules};
use crate::config::TerminationAction as Action;
use crate::session::effects::Effects;
use crate::session::store::{Uptime, vehicle_record};

#[derive(Debug, Default, Serialize, Deserialize)]
struct Record {
    commanded: Option<Commanded>,
    written: Option<Uptime>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
struct Commanded {
    /// The CUCS.
    by: u32,
    action: Action,
    /// The vehicle has shown it.
    shown: bool,
    /// The latest order that was taken: its CUCS, and its Time Stamp.
    latest: Option<(u32, u64)>,
}

vehicle_record!(Record, "termination", Power);

/// What the disk has.
#[derive(Debug, Default)]
pub(super) struct Stored {
    commanded: Option<Commanded>,
    /// When a change is tried again, after a fault of the disk.
    unsaved: Option<Duration>,
}

/// What a restart has found.
#[derive(Debug)]
pub(super) enum Found {
    Nothing,
    /// One that may still be under way.
    Recent(Rules),
    /// One of another boot of the computer, or of long ago.
    Old(Id, Action),
}

impl Stored {
    /// Stores what has changed.
    pub(super) fn keep(&mut self, rules: &Rules, effects: &mut Effects<'_>) {
        let commanded = rules.ordered().map(|ordered| Commanded {
            by: ordered.by.0,
            action: ordered.action,
            shown: ordered.shown,
            latest: ordered.latest.map(|(by, stamp)| (by.0, stamp.0)),
        });
        let now = effects.dli.now.mono;
        if commanded == self.commanded {
            self.unsaved = None;
            return;
        }
        if self.unsaved.is_some_and(|again| now < again) {
            return;
        }
        let record = Record {
            commanded,
            written: effects.dli.uptime(),
        };
        let vehicle = effects.id;
        match effects.disk().save(&vehicle, &record) {
            Ok(()) => (self.commanded, self.unsaved) = (commanded, None),
            Err(fault) => {
                if self.unsaved.replace(now + RETRY_INTERVAL).is_none() {
                    let follows = match commanded {
                        Some(_) => "would not know of this flight termination",
                        None => "would take up a flight termination that is over",
                    };
                    let text = format!("{fault}; a restart of the VSM {follows}");
                    effects.notify(AlertPriority::Warning, SubsystemId::VsmStatus, text);
                }
            }
        }
    }

    /// What was commanded before a restart.
    ///
    /// # Errors
    /// The record exists and cannot be read.
    pub(super) fn restore(&mut self, effects: &mut Effects<'_>) -> Result<Found, StoreError> {
        let (vehicle, now) = (effects.id, effects.dli.uptime());
        let record = effects.disk().load::<Record>(&vehicle)?;
        let record = record.unwrap_or_default();
        self.commanded = record.commanded;
        let Some(commanded) = record.commanded else {
            return Ok(Found::Nothing);
        };
        let of_this_boot = now
            .zip(record.written)
            .and_then(|(now, written)| written.age(now));
        // The node of a fleet that takes over knows how old it is at most, if it stood by when this began.
        let age = of_this_boot.or_else(|| effects.disk().written_within(&Record::name(&vehicle)));
        let (by, action) = (Id(commanded.by), commanded.action);
        if age.is_none_or(|age| age > LASTS) {
            return Ok(Found::Old(by, action));
        }
        let latest = commanded.latest;
        Ok(Found::Recent(Rules::restored(Ordered {
            by,
            action,
            shown: commanded.shown,
            latest: latest.map(|(by, stamp)| (Id(by), TimeStamp(stamp))),
        })))
    }
}

/// No return takes longer; a vehicle that is flown again after it would be taken for one that still returns.
const LASTS: Duration = Duration::from_secs(3_600);
/// After a fault of the disk.
const RETRY_INTERVAL: Duration = Duration::from_secs(5);
