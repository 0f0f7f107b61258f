//! The number by which PX4 names a plan.

use crc::{CRC_32_JAMCRC, Crc};

use super::Item;

/// The polynomial of CRC-32 without the initial and the final inversion, as PX4's crc32part.
const CRC: Crc<u32> = Crc::<u32>::new(&crc::Algorithm {
    init: 0,
    ..CRC_32_JAMCRC
});

/// PX4's id of a plan: MISSION_ACK.opaque_id after an upload by MISSION_ITEM_INT, and
/// MISSION_CURRENT.mission_id (fence_id, rally_points_id) from then on.
///
/// It covers what was sent, not what is stored: frame, command, autocontinue and the seven
/// parameters of every item, in order. `current` is no part of it. An empty plan has id 0.
pub fn plan_id(items: &[Item]) -> u32 {
    items.iter().fold(0, |id, item| {
        extend_plan_id(id, item, item.x.to_le_bytes(), item.y.to_le_bytes())
    })
}

/// The id of a plan one item longer; `x` and `y` are the bytes that the message carried,
/// which are floats in a MISSION_ITEM.
pub fn extend_plan_id(id: u32, item: &Item, x: [u8; 4], y: [u8; 4]) -> u32 {
    // The algorithm reflects its input, so the initial value goes in bit-reversed.
    let mut digest = CRC.digest_with_initial(id.reverse_bits());
    digest.update(&[item.frame]);
    digest.update(&item.command.to_le_bytes());
    digest.update(&[item.autocontinue.into()]);
    for param in item.params {
        digest.update(&param.to_le_bytes());
    }
    digest.update(&x);
    digest.update(&y);
    digest.update(&item.z.to_le_bytes());
    digest.finalize()
}
