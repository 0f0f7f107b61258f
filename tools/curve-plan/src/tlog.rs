//! The flown track in a .tlog: GLOBAL_POSITION_INT of a recorded MAVLink stream.
//!
//! Each record is a time stamp of 8 bytes (microseconds, most significant first) and a frame. A record whose
//! checksum does not hold is passed over byte by byte until one does.

use std::path::Path;

use curve_paths::Position;
use mavlink_link::frame::checksum;

use crate::failure::Failure;

/// The positions in a file, in order; at least one.
pub(crate) fn read(file: &Path) -> Result<Vec<Position>, Failure> {
    let bytes = std::fs::read(file).map_err(|e| Failure::file(file, e))?;
    let found = positions(&bytes);
    if found.is_empty() {
        return Err(Failure::file(file, "no GLOBAL_POSITION_INT, expected some"));
    }
    Ok(found)
}

fn positions(bytes: &[u8]) -> Vec<Position> {
    let mut out = Vec::new();
    let mut at = 0;
    while at + STAMP < bytes.len() {
        match frame(&bytes[at + STAMP..]) {
            Some((length, payload)) => {
                out.extend(payload.and_then(position));
                at += STAMP + length;
            }
            None => at += 1,
        }
    }
    out
}

/// The length of the frame that the bytes start with, and its payload where it is a position with a good checksum.
fn frame(bytes: &[u8]) -> Option<(usize, Option<Vec<u8>>)> {
    let (header, payload_length, id, signature) = match *bytes.first()? {
        V1 => (6, *bytes.get(1)? as usize, u32::from(*bytes.get(5)?), 0),
        V2 => {
            let id = u32::from_le_bytes([*bytes.get(7)?, *bytes.get(8)?, *bytes.get(9)?, 0]);
            let signed = bytes.get(2)? & 1 != 0;
            (10, *bytes.get(1)? as usize, id, if signed { 13 } else { 0 })
        }
        _ => return None,
    };
    let end = header + payload_length;
    let length = end + 2 + signature;
    let sum = bytes.get(end..end + 2)?;
    if bytes.len() < length {
        return None;
    }
    if id != GLOBAL_POSITION_INT {
        return Some((length, None));
    }
    let good = checksum(&bytes[1..end], CRC_EXTRA).to_le_bytes() == *sum;
    good.then(|| {
        // MAVLink 2 cuts off trailing zeros.
        let mut payload = bytes[header..end].to_vec();
        payload.resize(PAYLOAD.max(payload_length), 0);
        (length, Some(payload))
    })
}

fn position(payload: Vec<u8>) -> Option<Position> {
    let int = |at: usize| {
        payload
            .get(at..at + 4)?
            .try_into()
            .ok()
            .map(i32::from_le_bytes)
    };
    let (lat, lon, alt) = (int(4)?, int(8)?, int(12)?);
    let fixed = (lat, lon) != (0, 0);
    fixed.then(|| {
        Position::new(
            f64::from(lat) * 1e-7,
            f64::from(lon) * 1e-7,
            f64::from(alt) * 1e-3,
        )
    })
}

const STAMP: usize = 8;
const V1: u8 = 0xfe;
const V2: u8 = 0xfd;
const GLOBAL_POSITION_INT: u32 = 33;
const CRC_EXTRA: u8 = 104;
const PAYLOAD: usize = 28;

#[cfg(test)]
mod tests {
    use super::*;

    /// A MAVLink 1 or 2 record of a position.
    fn record(v2: bool, lat: i32) -> Vec<u8> {
        let mut payload = Vec::new();
        for x in [1_000, lat, 85_455_939, 488_000] {
            payload.extend(i32::to_le_bytes(x));
        }
        payload.resize(PAYLOAD, 0);
        let mut frame = if v2 {
            payload.truncate(15);
            vec![V2, 15, 0, 0, 0, 1, 1, 33, 0, 0]
        } else {
            vec![V1, 28, 0, 1, 1, 33]
        };
        frame.extend(&payload);
        let crc = checksum(&frame[1..], CRC_EXTRA);
        frame.extend(crc.to_le_bytes());
        [vec![0; STAMP], frame].concat()
    }

    #[test]
    fn both_versions_are_read_and_damage_is_passed_over() {
        let mut bytes = record(false, 473_977_434);
        bytes.extend([0xfd, 0x01, 0x02]);
        let mut damaged = record(true, 1);
        damaged[STAMP + 12] ^= 1;
        bytes.extend(damaged);
        bytes.extend(record(true, 473_977_435));
        let found = positions(&bytes);
        assert_eq!(found.len(), 2, "{found:?}");
        assert!((found[1].lat_deg - 47.397_743_5).abs() < 1e-9 && found[0].alt_m == 488.0);
    }
}
