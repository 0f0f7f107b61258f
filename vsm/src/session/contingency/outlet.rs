//! What the machine needs from its host: the bridge provides it by its effects, the air-side agent by its reports.

use std::time::Duration;

use mavlink_link::store::{Store as _, StoreError};
use stanag_msgs::enums::{AlertPriority, SubsystemId};

use super::record::Record;
use crate::session::alerts::Cause;
use crate::session::effects::Effects;

/// Time, disk and alerts of one vehicle.
pub(crate) trait Outlet {
    /// Monotonic time.
    fn now(&self) -> Duration;

    /// The record of an earlier process.
    ///
    /// # Errors
    /// It exists but cannot be read.
    fn load(&mut self) -> Result<Option<Record>, StoreError>;

    /// Stores it, before anything about it is reported.
    ///
    /// # Errors
    /// It is not durable.
    fn save(&mut self, record: &Record) -> Result<(), StoreError>;

    /// Raises an alert, in place of an earlier one for that cause.
    fn raise(
        &mut self,
        cause: Cause,
        priority: AlertPriority,
        subsystem: SubsystemId,
        text: String,
    );

    /// Clears an alert.
    fn clear(&mut self, cause: Cause, text: &str);

    /// Raises a warning.
    fn warn(&mut self, cause: Cause, text: String);

    /// Reports a single event.
    fn notify(&mut self, priority: AlertPriority, subsystem: SubsystemId, text: String);
}

impl Outlet for Effects<'_> {
    fn now(&self) -> Duration {
        self.dli.now.mono
    }

    fn load(&mut self) -> Result<Option<Record>, StoreError> {
        let vehicle = self.id;
        self.disk().load(&vehicle)
    }

    fn save(&mut self, record: &Record) -> Result<(), StoreError> {
        let vehicle = self.id;
        self.disk().save(&vehicle, record)
    }

    fn raise(
        &mut self,
        cause: Cause,
        priority: AlertPriority,
        subsystem: SubsystemId,
        text: String,
    ) {
        Effects::raise(self, cause, priority, subsystem, text);
    }

    fn clear(&mut self, cause: Cause, text: &str) {
        Effects::clear(self, cause, text);
    }

    fn warn(&mut self, cause: Cause, text: String) {
        Effects::warn(self, cause, text);
    }

    fn notify(&mut self, priority: AlertPriority, subsystem: SubsystemId, text: String) {
        Effects::notify(self, priority, subsystem, text);
    }
}
