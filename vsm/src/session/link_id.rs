//! The signing link id that a vehicle's autopilot uses on its link, kept over restarts: recordings of another of its
//! links, played in at a start, are then refused from the first one on.

use stanag_msgs::Id;

use super::aircraft::Aircraft;
use super::desk::Desk;
use super::log::LogLevel;
use super::store::{Durability, Store, StoreError, record_name};

/// What was learned in an earlier run. A record that cannot be understood is none: it is learned again.
///
/// # Errors
/// The store cannot be read.
pub(super) fn known(vehicle: Id, store: &dyn Store) -> Result<Option<u8>, StoreError> {
    let bytes = store.load(&record_name(KIND, vehicle))?;
    let text = bytes.and_then(|bytes| String::from_utf8(bytes).ok());
    Ok(text.and_then(|text| text.trim().parse().ok()))
}

impl Aircraft {
    /// Keeps the link id that was learned, where it is another than the stored one.
    pub(super) fn keep_link_id(&mut self, desk: &mut Desk<'_>) {
        let Some(learned) = self.mav.link.learned_link_id() else {
            return;
        };
        if self.kept_link_id == Some(learned) {
            return;
        }
        // Not asked again: a disk that fails is told of once, and costs one lookout at the next start.
        self.kept_link_id = Some(learned);
        let text = format!("{learned}\n");
        let name = record_name(KIND, self.id());
        if let Err(fault) = desk.store.save(&name, text.as_bytes(), Durability::Process) {
            let text = format!("the vehicle's link id is not kept: {fault}");
            desk.note(LogLevel::Warning, self.id(), text);
        }
    }
}

const KIND: &str = "link-id";
