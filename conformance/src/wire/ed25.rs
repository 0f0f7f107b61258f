//! Edition 2.5 byte by byte: its wrapper, of which nothing but lengths is trusted. The codec of `stanag_msgs::ed25`
//! refuses what has to be judged here, as in Edition 4.

use stanag_msgs::ed25;
use stanag_msgs::table::{self, Direction, MessageInfo};
use stanag_msgs::{DecodeError, Id};

/// Bytes of the wrapper before and behind the data.
pub const WRAPPER: usize = ed25::HEADER_BYTES + ed25::TRAILER_BYTES;

/// The fields of the wrapper of Edition 2.5 that later editions lack.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Wrapped {
    /// The ten bytes of the version.
    pub version: [u8; 10],
    /// Message Instance ID.
    pub instance: u32,
    /// Message Type in its full width.
    pub message_type: u32,
    /// Stream ID.
    pub stream: u32,
    /// Packet Sequence Number.
    pub sequence: u32,
}

impl Wrapped {
    /// The version up to its NUL.
    #[must_use]
    pub fn text(&self) -> String {
        let text = self.version.iter().take_while(|&&byte| byte != 0);
        text.map(|&byte| char::from(byte)).collect()
    }
}

/// One message: wrapper, data, and all of its bytes.
pub(super) type Part = (Wrapped, Vec<u8>, Vec<u8>);

/// The messages of a datagram, and why the rest of it is not one.
pub(super) fn split(datagram: &[u8]) -> (Vec<Part>, Option<String>) {
    let mut parts = Vec::new();
    let mut rest = datagram;
    while !rest.is_empty() {
        let offset = datagram.len() - rest.len();
        if rest.len() < WRAPPER {
            let fault = format!(
                "{} bytes at offset {offset}, expected a wrapper of {WRAPPER} bytes",
                rest.len()
            );
            return (parts, Some(fault));
        }
        let word = |at: usize| number(&rest[at..at + 4]) as u32;
        let length = word(18) as usize;
        let Some(bytes) = rest.get(..WRAPPER + length) else {
            let fault = format!(
                "message at offset {offset} says {length} bytes of data, which is {} bytes with its wrapper; the datagram has {} left",
                WRAPPER + length,
                rest.len()
            );
            return (parts, Some(fault));
        };
        let mut version = [0; 10];
        version.copy_from_slice(&rest[..10]);
        let wrapped = Wrapped {
            version,
            instance: word(10),
            message_type: word(14),
            stream: word(22),
            sequence: word(26),
        };
        let data = bytes[ed25::HEADER_BYTES..bytes.len() - ed25::TRAILER_BYTES].to_vec();
        parts.push((wrapped, data, bytes.to_vec()));
        rest = &rest[bytes.len()..];
    }
    (parts, None)
}

/// The row of a message of this type.
pub(super) fn info(wrapped: &Wrapped) -> Option<&'static MessageInfo> {
    let version = ed25::Version::from_text(&wrapped.text()).unwrap_or(ed25::Version::Ed25);
    ed25::message(wrapped.message_type, version)
}

/// Source and destination: fields of the data; the row of the table shows which field is whose.
pub(super) fn ends(info: Option<&'static MessageInfo>, data: &[u8]) -> (Id, Id) {
    let id = |name: &str| -> Id {
        let found: Option<Result<_, DecodeError>> = info.and_then(|info| {
            table::walk(info, data)
                .find(|step| step.as_ref().is_ok_and(|(field, _)| field.name == name))
        });
        match found {
            Some(Ok((_, bytes))) if bytes.len() == 4 => Id(number(bytes) as u32),
            _ => Id::NULL,
        }
    };
    let named = |name: &str| info.is_some_and(|info| info.field(name).is_some());
    let cucs = if named("CUCS ID") {
        id("CUCS ID")
    } else if named("CUCS ID (Controlling)") {
        id("CUCS ID (Controlling)")
    } else {
        // #700 names the parties of a handover, and is for both of them.
        Id::BROADCAST
    };
    let vehicle = id("Vehicle ID");
    match info.map(|info| info.direction) {
        Some(Direction::ToVsm) => (cucs, vehicle),
        _ => (vehicle, cucs),
    }
}

/// The unsigned integer of these bytes, the most significant first.
pub(super) fn number(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0, |value, &byte| value << 8 | u64::from(byte))
}
