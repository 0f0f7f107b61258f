//! What is kept of a termination over a restart: that it was commanded, by whom, and what.
//!
//! Without it, the next command of a station, or one that it only repeats, would take the vehicle out of the landing or the return. It
//! commands nothing: what the vehicle shows decides what becomes of it ([`Stage::CutOff`](super::rules::Stage::CutOff)).

use mavlink_link::store::{Store as _, StoreError};
use serde::{Deserialize, Serialize};
use stanag_msgs::enums::{AlertPriority, SubsystemId};
use stanag_msgs::{Id, TimeStamp};

use super::rules::Rules;
use crate::config::TerminationAction as Action;
use crate::session::effects::Effects;
use crate::session::store::vehicle_record;

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
struct Record {
    commanded: Option<Commanded>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
struct Commanded {
    /// The CUCS.
    by: u32,
    action: Action,
    /// The latest order that was taken: its CUCS, and its Time Stamp.
    ordered: Option<(u32, u64)>,
}

vehicle_record!(Record, "termination", Power);

/// What the disk has, or should have.
#[derive(Debug, Default)]
pub(super) struct Stored(Record);

impl Stored {
    /// Stores what has changed.
    pub(super) fn keep(&mut self, rules: &Rules, effects: &mut Effects<'_>) {
        let commanded = rules.ordered().map(|(by, action, ordered)| Commanded {
            by: by.0,
            action,
            ordered: ordered.map(|(by, stamp)| (by.0, stamp.0)),
        });
        let record = Record { commanded };
        if record == self.0 {
            return;
        }
        self.0 = record;
        let vehicle = effects.id;
        if let Err(fault) = effects.disk().save(&vehicle, &record) {
            let text =
                format!("{fault}; a restart of the VSM would not know of this flight termination");
            effects.notify(AlertPriority::Warning, SubsystemId::VsmStatus, text);
        }
    }

    /// The rules as they were before a restart, where one was commanded.
    ///
    /// # Errors
    /// The record exists and cannot be read.
    pub(super) fn restore(
        &mut self,
        effects: &mut Effects<'_>,
    ) -> Result<Option<Rules>, StoreError> {
        let vehicle = effects.id;
        self.0 = effects.disk().load::<Record>(&vehicle)?.unwrap_or_default();
        Ok(self.0.commanded.map(|commanded| {
            let ordered = commanded
                .ordered
                .map(|(by, stamp)| (Id(by), TimeStamp(stamp)));
            Rules::restored((Id(commanded.by), commanded.action, ordered))
        }))
    }
}
