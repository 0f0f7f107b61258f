//! The signing link id that a vehicle's autopilot uses on its link, kept over restarts: recordings of another of its
//! links, played in at a start, are then refused from the first one on.

use stanag_msgs::Id;

use super::aircraft::Aircraft;
use super::desk::Desk;
use super::log::LogLevel;
use super::store::record_name;
use mavlink_link::store::{Disk, Durability, Record, Store as _, StoreError};

/// What was learned in an earlier run. A record that cannot be understood is none: it is learned again.
///
/// # Errors
/// The store cannot be read.
pub(super) fn known(vehicle: Id, store: &dyn Disk) -> Result<Option<u8>, StoreError> {
    Ok(store.load(&vehicle)?.and_then(|LinkId(id)| id))
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
        if let Err(fault) = desk.store.save(&self.id(), &LinkId(Some(learned))) {
            let text = format!("the vehicle's link id is not kept: {fault}");
            desk.note(LogLevel::Warning, self.id(), text);
        }
    }
}

/// The record. One that cannot be understood is none.
struct LinkId(Option<u8>);

impl Record for LinkId {
    type Key = Id;
    const DURABILITY: Durability = Durability::Process;

    fn name(vehicle: &Id) -> String {
        record_name("link-id", *vehicle)
    }

    fn encode(&self) -> Vec<u8> {
        self.0
            .map_or_else(Vec::new, |id| format!("{id}\n").into_bytes())
    }

    fn decode(bytes: &[u8]) -> Result<Self, String> {
        let text = String::from_utf8_lossy(bytes);
        Ok(LinkId(text.trim().parse().ok()))
    }
}
