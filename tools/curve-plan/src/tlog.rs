//! The flown track in a .tlog: GLOBAL_POSITION_INT of a recorded MAVLink stream.
//!
//! Each record is a time stamp of 8 bytes (microseconds, most significant first) and a frame of MAVLink 1 or 2. Bytes
//! that are not a frame with a correct checksum are skipped, time stamps among them.

use std::io::Read as _;
use std::path::Path;

use curve_paths::Position;
use mavlink::MavlinkReader;
use mavlink::error::MessageReadError;
use mavlink_link::dialect::MavMessage;

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
    // The reader waits until it has the longest possible frame: zeros behind the last record supply that. Without
    // them a byte of a time stamp that looks like the start of a frame would hide the frames behind it.
    let padding = std::io::repeat(0).take(MAX_FRAME);
    let mut reader = MavlinkReader::new(bytes.chain(padding));
    let mut out = Vec::new();
    loop {
        match reader.read_any_message::<MavMessage>() {
            Ok((_, MavMessage::GLOBAL_POSITION_INT(m))) if (m.lat, m.lon) != (0, 0) => {
                out.push(Position::new(
                    f64::from(m.lat) * 1e-7,
                    f64::from(m.lon) * 1e-7,
                    f64::from(m.alt) * 1e-3,
                ));
            }
            Ok(_) | Err(MessageReadError::Parse(_)) => {}
            Err(MessageReadError::Io(_)) => return out,
        }
    }
}

/// The longest frame of MAVLink 2: header, payload, checksum, signature.
const MAX_FRAME: u64 = 10 + 255 + 2 + 13;

#[cfg(test)]
mod tests {
    use mavlink_link::frame::checksum;

    use super::*;

    const STAMP: usize = 8;
    const V1: u8 = 0xfe;
    const V2: u8 = 0xfd;
    const CRC_EXTRA: u8 = 104;
    const PAYLOAD: usize = 28;

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
