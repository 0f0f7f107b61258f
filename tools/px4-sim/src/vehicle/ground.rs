//! The vehicle's end of MAVLink's terrain protocol, as in ArduPilot. PX4 has none: it sends requests only where a
//! test enables it.
//!
//! Every second it requests the missing blocks of one grid (TERRAIN_REQUEST), keeps the data of TERRAIN_DATA, and
//! reports how many blocks it has (TERRAIN_REPORT).

use mavlink::dialects::development::{
    MavMessage, TERRAIN_DATA_DATA, TERRAIN_REPORT_DATA, TERRAIN_REQUEST_DATA,
};

use crate::physics::motion::Geodetic;

/// The requested grid: 7 blocks north by 8 east, each 4 by 4 heights.
#[derive(Debug, Clone)]
pub struct GroundGrid {
    /// South-western corner, degrees times 1e7.
    corner: (i32, i32),
    spacing_m: u16,
    /// The received blocks, by their bits.
    blocks: Vec<Option<[i16; 16]>>,
    asks_at: f64,
}

impl GroundGrid {
    /// A grid north-east of a place, with heights this far apart, m; it is requested from `now` on, s.
    pub(crate) fn new(corner: Geodetic, spacing_m: u16, now: f64) -> Self {
        let e7 = |degrees: f64| (degrees * 1e7).round() as i32;
        Self {
            corner: (e7(corner.latitude_deg), e7(corner.longitude_deg)),
            spacing_m,
            blocks: vec![None; BLOCKS],
            asks_at: now,
        }
    }

    /// The messages for this time, s: the request for missing blocks, and the report.
    pub(crate) fn due(&mut self, now: f64) -> Vec<MavMessage> {
        if now < self.asks_at {
            return Vec::new();
        }
        self.asks_at = now + 1.0;
        let (lat, lon) = self.corner;
        let missing = self.missing();
        let request = TERRAIN_REQUEST_DATA {
            lat,
            lon,
            grid_spacing: self.spacing_m,
            mask: self.mask(),
        };
        let report = TERRAIN_REPORT_DATA {
            lat,
            lon,
            spacing: self.spacing_m,
            terrain_height: self.height_m(0, 0).unwrap_or(0).into(),
            pending: missing as u16,
            loaded: (BLOCKS - missing) as u16,
            ..TERRAIN_REPORT_DATA::default()
        };
        let request = (missing > 0).then_some(MavMessage::TERRAIN_REQUEST(request));
        let report = MavMessage::TERRAIN_REPORT(report);
        request.into_iter().chain([report]).collect()
    }

    /// Stores the block of a TERRAIN_DATA.
    pub(crate) fn take(&mut self, data: &TERRAIN_DATA_DATA) {
        let own = (self.corner.0, self.corner.1, self.spacing_m);
        if (data.lat, data.lon, data.grid_spacing) == own
            && let Some(block) = self.blocks.get_mut(usize::from(data.gridbit))
        {
            *block = Some(data.data);
        }
    }

    /// How many of its 56 blocks are missing.
    pub fn missing(&self) -> usize {
        self.blocks.iter().filter(|block| block.is_none()).count()
    }

    /// The height at a point of the grid, m, counted north and east from its corner.
    pub fn height_m(&self, north: usize, east: usize) -> Option<i16> {
        let bit = north / SIDE * BLOCKS_EAST + east / SIDE;
        let block = self.blocks.get(bit).copied().flatten()?;
        block.get(north % SIDE * SIDE + east % SIDE).copied()
    }

    fn mask(&self) -> u64 {
        let bits = (0..).zip(&self.blocks);
        let missing = bits.filter(|(_, block)| block.is_none());
        missing.fold(0, |mask, (bit, _)| mask | 1 << bit)
    }
}

// A block has 4 by 4 heights; the mask of TERRAIN_REQUEST has 8 blocks to the east and 7 to the north.
const SIDE: usize = 4;
const BLOCKS_EAST: usize = 8;
const BLOCKS: usize = 56;
