//! The recorded sessions with real autopilots in `tests/data/captures` (`.mvr.gz`; its README has the format).

use std::fs::File;
use std::io::Read as _;
use std::time::Duration;

use flate2::read::GzDecoder;

/// One recorded datagram.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Datagram {
    /// Sent by the autopilot, not by the ground station.
    pub from_autopilot: bool,
    /// Time since 1970.
    pub at: Duration,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// Every datagram of a recording, in order; `name` is that of the file without `.mvr.gz`.
pub fn read(name: &str) -> Vec<Datagram> {
    let bytes = unpack(&format!("captures/{name}.mvr.gz"));
    let mut rest = &bytes[..];
    let mut datagrams = Vec::new();
    // A record: direction, microseconds, length, bytes; numbers are big-endian.
    while let Some((direction, body)) = rest.split_first() {
        let (at, body) = body.split_first_chunk().expect("a time");
        let (length, body) = body.split_first_chunk().expect("a length");
        let (bytes, next) = body.split_at(u16::from_be_bytes(*length).into());
        datagrams.push(Datagram {
            from_autopilot: *direction == b'<',
            at: Duration::from_micros(u64::from_be_bytes(*at)),
            bytes: bytes.to_vec(),
        });
        rest = next;
    }
    assert!(!datagrams.is_empty(), "{name} holds no datagram");
    datagrams
}

/// The contents of a compressed file; `name` is its path below `tests/data`.
pub fn unpack(name: &str) -> Vec<u8> {
    let path = crate::workspace().join("tests/data").join(name);
    let file = File::open(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut bytes = Vec::new();
    GzDecoder::new(file)
        .read_to_end(&mut bytes)
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_has_both_directions_in_the_order_of_time() {
        let datagrams = read("02-params-mission-upload");
        assert!(datagrams.iter().any(|datagram| datagram.from_autopilot));
        assert!(datagrams.iter().any(|datagram| !datagram.from_autopilot));
        assert!(datagrams.is_sorted_by_key(|datagram| datagram.at));
        // MAVLink 1 or 2.
        assert!(datagrams.iter().all(|d| matches!(d.bytes[0], 0xfe | 0xfd)));
    }
}
