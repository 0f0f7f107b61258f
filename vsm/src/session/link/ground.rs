//! MAVLink's terrain protocol: terrain heights for a vehicle that requests them (TERRAIN_REQUEST), from the elevation files
//! of `vehicle.terrain`.
//!
//! A request names a grid of 7 by 8 blocks by its south-western corner, with a bit for each block that is missing. Each
//! block is answered by one TERRAIN_DATA with 4 by 4 heights. A block with an unknown height is not answered, so that the
//! vehicle never flies by a guess; it requests the block again. PX4 does not use this protocol; ArduPilot does while it
//! follows the terrain.
//!
//! One block is sent each [`PACE`]: 56 at once would fill a radio link for a second.

use std::sync::Arc;
use std::time::Duration;

use curve_paths::terrain::Terrain;
use mavlink_link::dialect::{MavMessage, TERRAIN_DATA_DATA, TERRAIN_REQUEST_DATA};

/// The machine.
#[derive(Debug, Default)]
pub(crate) struct GroundService {
    ground: Option<Arc<Terrain>>,
    pending: Option<Pending>,
}

#[derive(Debug)]
struct Pending {
    request: TERRAIN_REQUEST_DATA,
    /// Blocks that are still to be sent.
    mask: u64,
    due: Duration,
}

impl GroundService {
    /// The terrain data; `None` if no elevation files are configured.
    pub(crate) fn serve(&mut self, ground: Option<Arc<Terrain>>) {
        self.ground = ground;
        self.pending = None;
    }

    /// TERRAIN_REQUEST: replaces the request that is being answered, since the vehicle names all blocks that it still needs.
    pub(super) fn take(&mut self, now: Duration, request: &TERRAIN_REQUEST_DATA) {
        let mask = request.mask & ALL_BLOCKS;
        let due = self.pending.as_ref().map_or(now, |pending| pending.due);
        let served = self.ground.is_some() && mask != 0 && request.grid_spacing > 0;
        self.pending = served.then(|| Pending {
            request: request.clone(),
            mask,
            due,
        });
    }

    /// The block that is due; an error if one of its heights is unknown.
    pub(super) fn advance(&mut self, now: Duration) -> Option<Result<MavMessage, ()>> {
        let pending = self.pending.as_mut().filter(|pending| pending.due <= now)?;
        let bit = pending.mask.trailing_zeros() as u8;
        pending.mask &= pending.mask - 1;
        pending.due = now + PACE;
        let block = block(&pending.request, bit, self.ground.as_deref()?);
        self.pending.take_if(|pending| pending.mask == 0);
        Some(block.map(MavMessage::TERRAIN_DATA).ok_or(()))
    }

    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        self.pending.as_ref().map(|pending| pending.due)
    }
}

/// One block of a request; `None` if one of its heights is unknown.
fn block(request: &TERRAIN_REQUEST_DATA, bit: u8, ground: &Terrain) -> Option<TERRAIN_DATA_DATA> {
    let spacing_m = f64::from(request.grid_spacing);
    let (south, west) = (f64::from(request.lat) * 1e-7, f64::from(request.lon) * 1e-7);
    let corner = (
        f64::from(bit / BLOCKS_EAST) * SIDE as f64,
        f64::from(bit % BLOCKS_EAST) * SIDE as f64,
    );
    let mut data = [0; SIDE * SIDE];
    for (at, height) in data.iter_mut().enumerate() {
        // Rows run eastwards, starting in the south.
        let north_m = spacing_m * (corner.0 + (at / SIDE) as f64);
        let east_m = spacing_m * (corner.1 + (at % SIDE) as f64);
        let lat = south + north_m / METRES_A_DEGREE;
        let lon = west + east_m / (METRES_A_DEGREE * lat.to_radians().cos().max(0.01));
        let lon = (lon + 540.0).rem_euclid(360.0) - 180.0;
        *height = ground.height_m(lat, lon)?.round() as i16;
    }
    Some(TERRAIN_DATA_DATA {
        lat: request.lat,
        lon: request.lon,
        grid_spacing: request.grid_spacing,
        gridbit: bit,
        data,
    })
}

/// Heights along a side of a block.
const SIDE: usize = 4;
/// Blocks in a row of a request, which has 7 of them.
const BLOCKS_EAST: u8 = 8;
const ALL_BLOCKS: u64 = (1 << 56) - 1;
/// Time between two blocks.
const PACE: Duration = Duration::from_millis(50);
/// Radius of the sphere that ArduPilot uses for the offsets in a request.
const METRES_A_DEGREE: f64 = 111_318.845;

#[cfg(test)]
mod tests {
    use curve_paths::terrain::Grid;

    use super::*;

    /// 1 m higher each 0.001 degrees east, 10 m each 0.001 degrees north.
    fn slope() -> Arc<Terrain> {
        let rows = (0..100).rev().map(|north| {
            let row = (0..100).map(|east| format!("{} ", 10 * north + east));
            row.collect::<String>()
        });
        let rows: String = rows.collect();
        let text = format!("ncols 100 nrows 100 xllcenter 8 yllcenter 0 cellsize 0.001 {rows}");
        let grid = Grid::read("slope.asc", text.into_bytes()).expect("a grid");
        Arc::new(Terrain::new(vec![grid]))
    }

    fn request(lon: i32, mask: u64) -> TERRAIN_REQUEST_DATA {
        TERRAIN_REQUEST_DATA {
            lat: 0,
            lon,
            grid_spacing: 111,
            mask,
        }
    }

    fn answers(service: &mut GroundService) -> Vec<TERRAIN_DATA_DATA> {
        let mut sent = Vec::new();
        while let Some(due) = service.poll_timeout() {
            if let Some(Ok(MavMessage::TERRAIN_DATA(data))) = service.advance(due) {
                sent.push(data);
            }
        }
        sent
    }

    #[test]
    fn the_blocks_that_are_missing_are_sent_one_by_one_and_where_they_belong() {
        let mut service = GroundService::default();
        service.serve(Some(slope()));
        // The first block, its neighbour in the east, the first of the second row; a bit beyond the grid is none.
        service.take(
            Duration::ZERO,
            &request(80_000_000, 0b1_0000_0011 | 1 << 60),
        );
        assert_eq!(service.poll_timeout(), Some(Duration::ZERO));
        let first = service.advance(Duration::ZERO);
        assert!(matches!(first, Some(Ok(MavMessage::TERRAIN_DATA(_)))));
        assert!(
            service.advance(Duration::ZERO).is_none(),
            "the next is not due"
        );
        service.take(Duration::ZERO, &request(80_000_000, 0b1_0000_0011));
        let sent = answers(&mut service);
        let bits: Vec<u8> = sent.iter().map(|data| data.gridbit).collect();
        assert_eq!(bits, [0, 1, 8]);
        assert_eq!(sent[0].data[..5], [0, 1, 2, 3, 10]);
        assert_eq!(sent[1].data[..5], [4, 5, 6, 7, 14]);
        assert_eq!(sent[2].data[..5], [40, 41, 42, 43, 50]);
    }

    #[test]
    fn a_block_that_is_not_known_whole_is_not_answered() {
        let mut service = GroundService::default();
        service.serve(Some(slope()));
        // The files end within the fourth block.
        service.take(Duration::ZERO, &request(80_850_000, 0b1111));
        let sent = answers(&mut service);
        let bits: Vec<u8> = sent.iter().map(|data| data.gridbit).collect();
        assert_eq!(bits, [0, 1, 2]);
        // Without files nothing is answered at all.
        let mut none = GroundService::default();
        none.take(Duration::ZERO, &request(80_000_000, 1));
        assert_eq!(none.poll_timeout(), None);
    }
}
