//! Reads the recordings in `tests/data/captures`.

use std::io::Read as _;
use std::path::Path;

use flate2::read::GzDecoder;

/// One recorded datagram.
pub(crate) struct Datagram {
    /// Whether the autopilot sent it.
    pub(crate) from_autopilot: bool,
    /// The datagram.
    pub(crate) bytes: Vec<u8>,
}

/// All datagrams of a recording, in order.
pub(crate) fn read(name: &str) -> Vec<Datagram> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../tests/data/captures")
        .join(format!("{name}.mvr.gz"));
    let file = std::fs::File::open(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let mut bytes = Vec::new();
    GzDecoder::new(file).read_to_end(&mut bytes).unwrap();

    let mut rest = &bytes[..];
    let mut datagrams = Vec::new();
    while let [direction, header @ ..] = rest {
        let (len, body) = header[8..].split_at(2);
        let len = usize::from(u16::from_be_bytes([len[0], len[1]]));
        let (bytes, next) = body.split_at(len);
        datagrams.push(Datagram {
            from_autopilot: *direction == b'<',
            bytes: bytes.to_vec(),
        });
        rest = next;
    }
    datagrams
}
