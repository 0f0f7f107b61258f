//! What the page asks of the bridge.

use super::events::Event;
use crate::session::{Status, VehicleMap};

/// What the page shows, as the bridge has it now.
pub trait Source {
    /// How everything stands.
    fn status(&self) -> Status;
    /// What a map shows beside it.
    fn map(&self) -> Vec<VehicleMap>;
    /// What was logged of late, from this number on.
    fn events(&self, from: u64) -> Vec<Event>;
}
