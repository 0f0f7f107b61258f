//! What the page asks of the bridge, or of a recording.

use std::time::Duration;

use serde::Serialize;

use super::events::Event;
use super::tiles::TilesInfo;
use crate::session::replay::TrackPoint;
use crate::session::{Status, VehicleMap};

/// What the page shows: as the bridge has it now, or as it was at a moment of a recording (the time since 1970; a
/// running bridge has no other moment than now).
pub trait Source {
    /// What the page can do here.
    fn page(&self) -> PageInfo;
    /// How everything stands.
    fn status(&self, moment: Option<Duration>) -> Status;
    /// What a map shows beside it.
    fn map(&self, moment: Option<Duration>) -> Vec<VehicleMap>;
    /// What was logged of late, the oldest first.
    fn events(&self, moment: Option<Duration>) -> Vec<Event>;
    /// Where each vehicle was, by its id: of a recording alone.
    fn tracks(&self) -> Vec<(String, Vec<TrackPoint>)> {
        Vec::new()
    }
}

/// /page.json: what the page can do here.
#[derive(Debug, Clone, Default, Serialize)]
pub struct PageInfo {
    /// It shows this recording; none where it shows a running bridge.
    pub replay: Option<Span>,
    /// It takes ground stations by the WebSocket (`[web] control`).
    pub control: bool,
    /// There are tiles under the map; said by the page's server, not by a source.
    pub tiles: Option<TilesInfo>,
}

/// From when to when a recording is, ms since 1970.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Span {
    /// Its first moment.
    pub from_ms: u64,
    /// Its last.
    pub to_ms: u64,
}
