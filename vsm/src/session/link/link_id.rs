//! The signing link id that a vehicle's autopilot uses on its link, stored over restarts. With it, a replay of frames
//! recorded on another of its links is refused from the first frame after a start.

use mavlink_link::store::{Durability, Record};
use stanag_msgs::Id;

/// The link id learned in an earlier run; `None` if the record could not be decoded, so that it is learned again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct LinkId(pub(crate) Option<u8>);

impl Record for LinkId {
    type Key = Id;
    const DURABILITY: Durability = Durability::Answered;

    fn name(vehicle: &Id) -> String {
        format!("link-id-{:08x}.json", vehicle.0)
    }

    fn encode(&self) -> Vec<u8> {
        self.0
            .map_or_else(Vec::new, |id| format!("{id}\n").into_bytes())
    }

    fn decode(bytes: &[u8]) -> Result<LinkId, String> {
        let text = std::str::from_utf8(bytes).ok();
        Ok(LinkId(text.and_then(|text| text.trim().parse().ok())))
    }
}
