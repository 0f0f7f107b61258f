//! UDP datagrams as a pcapng file: one section, one interface of IP packets, one enhanced packet block for each datagram.
//!
//! Blocks are appended to a buffer; their names and those of their fields are from the pcapng specification. The
//! program receives datagrams and not packets, so the IP and UDP headers are made here from the addresses. The IPv4
//! header has its checksum; UDP has one in IPv6 only, where it is mandatory.
//!
//! ```
//! use std::net::SocketAddr;
//! use std::time::Duration;
//!
//! let (from, to) = (SocketAddr::from(([10, 0, 0, 1], 4586)), SocketAddr::from(([10, 0, 0, 2], 4586)));
//! let mut file = stanag_msgs::pcapng::header();
//! stanag_msgs::pcapng::datagram(&mut file, Duration::from_secs(1_700_000_000), from, to, b"payload");
//! assert_eq!(file.len() % 4, 0);
//! ```

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::time::Duration;

/// Section Header Block and Interface Description Block: the start of a file.
#[must_use]
pub fn header() -> Vec<u8> {
    let mut out = Vec::new();
    let mut section = Vec::new();
    section.extend(BYTE_ORDER_MAGIC.to_le_bytes());
    section.extend(1_u16.to_le_bytes());
    section.extend(0_u16.to_le_bytes());
    // All ones: the section's length is not known before the section ends.
    section.extend(u64::MAX.to_le_bytes());
    block(&mut out, SECTION_HEADER, &section);
    let mut interface = Vec::new();
    interface.extend(LINKTYPE_RAW.to_le_bytes());
    interface.extend([0; 2]);
    interface.extend(0_u32.to_le_bytes());
    block(&mut out, INTERFACE_DESCRIPTION, &interface);
    out
}

/// Enhanced Packet Block of a datagram, added to `out`. `wall` is the time since 1970.
pub fn datagram(out: &mut Vec<u8>, wall: Duration, from: SocketAddr, to: SocketAddr, bytes: &[u8]) {
    let packet = packet(from, to, bytes);
    let micros = u64::try_from(wall.as_micros()).unwrap_or(u64::MAX);
    let length = u32::try_from(packet.len()).unwrap_or(u32::MAX);
    let mut body = Vec::with_capacity(packet.len() + 20);
    body.extend(0_u32.to_le_bytes());
    // The upper half of the time stamp comes first, although each half is little-endian like the rest of the file.
    body.extend(((micros >> 32) as u32).to_le_bytes());
    body.extend((micros as u32).to_le_bytes());
    body.extend(length.to_le_bytes());
    body.extend(length.to_le_bytes());
    body.extend(packet);
    block(out, ENHANCED_PACKET, &body);
}

fn block(out: &mut Vec<u8>, kind: u32, body: &[u8]) {
    let padding = body.len().next_multiple_of(4) - body.len();
    let length = u32::try_from(body.len() + padding + 12).unwrap_or(u32::MAX);
    out.extend(kind.to_le_bytes());
    out.extend(length.to_le_bytes());
    out.extend(body);
    out.extend(std::iter::repeat_n(0, padding));
    out.extend(length.to_le_bytes());
}

fn packet(from: SocketAddr, to: SocketAddr, bytes: &[u8]) -> Vec<u8> {
    let length = u16::try_from(bytes.len() + UDP_HEADER).unwrap_or(u16::MAX);
    let mut udp = Vec::with_capacity(bytes.len() + UDP_HEADER);
    udp.extend(from.port().to_be_bytes());
    udp.extend(to.port().to_be_bytes());
    udp.extend(length.to_be_bytes());
    udp.extend([0; 2]);
    udp.extend(bytes);
    match (from.ip(), to.ip()) {
        (IpAddr::V4(from), IpAddr::V4(to)) => {
            let mut ip = vec![0x45, 0];
            ip.extend((length.saturating_add(20)).to_be_bytes());
            ip.extend([0, 0, 0, 0, HOPS, UDP, 0, 0]);
            ip.extend(from.octets());
            ip.extend(to.octets());
            let sum = checksum(&[&ip]);
            if let Some(place) = ip.get_mut(10..12) {
                place.copy_from_slice(&sum.to_be_bytes());
            }
            ip.extend(udp);
            ip
        }
        (from, to) => {
            let (from, to) = (as_v6(from), as_v6(to));
            let pseudo = [0, 0, 0, UDP];
            let sum = checksum(&[&from, &to, &u32::from(length).to_be_bytes(), &pseudo, &udp]);
            if let Some(place) = udp.get_mut(6..8) {
                // A sum of 0 would mean "no checksum"; all ones is the same number in ones' complement.
                place.copy_from_slice(&if sum == 0 {
                    [0xff; 2]
                } else {
                    sum.to_be_bytes()
                });
            }
            let mut ip = vec![0x60, 0, 0, 0];
            ip.extend(length.to_be_bytes());
            ip.extend([UDP, HOPS]);
            ip.extend(from);
            ip.extend(to);
            ip.extend(udp);
            ip
        }
    }
}

fn as_v6(address: IpAddr) -> [u8; 16] {
    match address {
        IpAddr::V4(address) => address.to_ipv6_mapped().octets(),
        IpAddr::V6(address) => address.octets(),
    }
}

/// The Internet checksum over parts, of which only the last may have an odd length.
fn checksum(parts: &[&[u8]]) -> u16 {
    let mut sum = 0_u32;
    for part in parts {
        for pair in part.chunks(2) {
            let low = pair.get(1).copied().unwrap_or(0);
            sum += u32::from(pair.first().copied().unwrap_or(0)) << 8 | u32::from(low);
            sum = (sum & 0xffff) + (sum >> 16);
        }
    }
    !(sum as u16)
}

/// A datagram of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Captured<'a> {
    /// Time of the capture, since 1970.
    pub wall: Duration,
    /// Sender.
    pub from: SocketAddr,
    /// Receiver.
    pub to: SocketAddr,
    /// Payload.
    pub bytes: &'a [u8],
}

/// Why bytes are not a block of a file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReadError {
    /// They end within the block: there is more to read, or the file was cut off.
    #[error("ends within a block")]
    Cut,
    /// They are not a block of such a file.
    #[error("{0}")]
    Damaged(String),
}

/// The length of the block at the beginning of the bytes, and its datagram; `None` where it is a block of another
/// kind.
///
/// # Errors
/// The bytes do not begin with a whole block of a file as [`header`] and [`datagram`] write it.
pub fn first(bytes: &[u8]) -> Result<(usize, Option<Captured<'_>>), ReadError> {
    let damaged = |what: String| Err(ReadError::Damaged(what));
    let (Some(kind), Some(length)) = (word(bytes, 0), word(bytes, 4)) else {
        return Err(ReadError::Cut);
    };
    if !matches!(kind, SECTION_HEADER | 1..=MAX_KIND) {
        return damaged(format!(
            "a block of kind {kind:#010x}, expected those of a pcapng file"
        ));
    }
    if length < 12 || length % 4 != 0 || length > MAX_BLOCK {
        return damaged(format!(
            "a block of {length} bytes, expected 12 to {MAX_BLOCK} in steps of 4"
        ));
    }
    let length = length as usize;
    let Some(block) = bytes.get(..length) else {
        return Err(ReadError::Cut);
    };
    let body = &block[8..length - 4];
    let number = |at| word(body, at).unwrap_or(0);
    if word(block, length - 4) != Some(length as u32) {
        return damaged(format!(
            "a block of {length} bytes that does not end with its length"
        ));
    }
    match kind {
        SECTION_HEADER if number(0) != BYTE_ORDER_MAGIC => {
            damaged("a section that is not little-endian".to_owned())
        }
        INTERFACE_DESCRIPTION if number(0) & 0xffff != u32::from(LINKTYPE_RAW) => damaged(format!(
            "an interface of link type {}, expected {LINKTYPE_RAW} (IP packets alone)",
            number(0) & 0xffff
        )),
        ENHANCED_PACKET => {
            let micros = u64::from(number(4)) << 32 | u64::from(number(8));
            let packet = body
                .get(20..)
                .and_then(|rest| rest.get(..number(12) as usize));
            let Some(packet) = packet else {
                return damaged("a packet that is longer than its block".to_owned());
            };
            let captured = udp(packet).map(|(from, to, bytes)| Captured {
                wall: Duration::from_micros(micros),
                from,
                to,
                bytes,
            });
            Ok((length, captured))
        }
        _ => Ok((length, None)),
    }
}

/// The little-endian word at this offset.
fn word(bytes: &[u8], at: usize) -> Option<u32> {
    let four = bytes.get(at..).and_then(<[u8]>::first_chunk);
    four.map(|four| u32::from_le_bytes(*four))
}

/// Sender, receiver and payload of a UDP packet.
fn udp(packet: &[u8]) -> Option<(SocketAddr, SocketAddr, &[u8])> {
    let (from, to, rest): (IpAddr, IpAddr, _) = match packet.first()? >> 4 {
        4 if *packet.get(9)? == UDP => {
            let address = |at: usize| -> Option<IpAddr> {
                Some(Ipv4Addr::from(*packet.get(at..)?.first_chunk::<4>()?).into())
            };
            let header = usize::from(packet.first()? & 0x0f) * 4;
            (address(12)?, address(16)?, packet.get(header..)?)
        }
        6 if *packet.get(6)? == UDP => {
            let address = |at: usize| -> Option<IpAddr> {
                let address = Ipv6Addr::from(*packet.get(at..)?.first_chunk::<16>()?);
                Some(IpAddr::from(address).to_canonical())
            };
            (address(8)?, address(24)?, packet.get(40..)?)
        }
        _ => return None,
    };
    let number = |at: usize| Some(u16::from_be_bytes(*rest.get(at..)?.first_chunk()?));
    let bytes = rest.get(UDP_HEADER..usize::from(number(4)?))?;
    let (from, to) = ((from, number(0)?), (to, number(2)?));
    Some((from.into(), to.into(), bytes))
}

/// The largest block that is read: a datagram has at most 64 KiB, but other programs may add blocks of their own.
const MAX_BLOCK: u32 = 1 << 20;
/// Block types of the specification are small numbers, except that of the section header.
const MAX_KIND: u32 = 0xffff;
/// Block types of the pcapng specification.
const SECTION_HEADER: u32 = 0x0a0d_0d0a;
const INTERFACE_DESCRIPTION: u32 = 1;
const ENHANCED_PACKET: u32 = 6;
/// Written in the file's own byte order, by which a reader recognises that order.
const BYTE_ORDER_MAGIC: u32 = 0x1a2b_3c4d;
/// IP packets without a link layer.
const LINKTYPE_RAW: u16 = 101;
/// Bytes of a UDP header.
const UDP_HEADER: usize = 8;
/// The protocol number of UDP.
const UDP: u8 = 17;
/// TTL or hop limit of the made-up IP header.
const HOPS: u8 = 64;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_carry_their_length_twice_and_are_whole_words() {
        let mut file = header();
        let from = SocketAddr::from(([127, 0, 0, 1], 4_586));
        datagram(&mut file, Duration::from_secs(1), from, from, b"odd");
        let (mut at, mut kinds) = (0, Vec::new());
        while at < file.len() {
            let word = |at: usize| u32::from_le_bytes(file[at..at + 4].try_into().unwrap());
            let length = word(at + 4) as usize;
            assert_eq!(length % 4, 0);
            assert_eq!(word(at + length - 4) as usize, length);
            kinds.push(word(at));
            at += length;
        }
        assert_eq!(
            kinds,
            [SECTION_HEADER, INTERFACE_DESCRIPTION, ENHANCED_PACKET]
        );
    }

    #[test]
    fn what_was_written_is_read_and_a_cut_is_no_damage() {
        let four: SocketAddr = "10.0.0.1:4586".parse().unwrap();
        let six: SocketAddr = "[2001:db8::1]:7".parse().unwrap();
        let wall = Duration::from_micros(1_700_000_000_123_456);
        for (at, bytes) in [(four, &b"odd"[..]), (six, b"")] {
            let mut block = Vec::new();
            datagram(&mut block, wall, at, at, bytes);
            let (length, captured) = first(&block).unwrap();
            let expected = Captured {
                wall,
                from: at,
                to: at,
                bytes,
            };
            assert_eq!((length, captured), (block.len(), Some(expected)));
            for cut in 0..block.len() {
                assert_eq!(first(&block[..cut]), Err(ReadError::Cut), "{cut}");
            }
        }
        let head = header();
        let (length, captured) = first(&head).unwrap();
        assert_eq!((length, captured), (28, None));
        assert_eq!(first(&head[length..]).unwrap(), (20, None));
    }

    #[test]
    fn damage_is_named() {
        let from = SocketAddr::from(([127, 0, 0, 1], 4_586));
        let mut block = Vec::new();
        datagram(&mut block, Duration::ZERO, from, from, b"abcd");
        let damaged = |at: usize, value: u8| {
            let mut block = block.clone();
            block[at] = value;
            first(&block).unwrap_err().to_string()
        };
        assert!(damaged(4, 7).contains("a block of 7 bytes"));
        assert!(damaged(block.len() - 4, 1).contains("does not end with its length"));
        assert!(damaged(20, 255).contains("longer than its block"));
        let text = first(b"no capture file").unwrap_err().to_string();
        assert!(text.contains("expected those of a pcapng file"), "{text}");
        let mut head = header();
        head[36] = 1;
        let text = first(&head[28..]).unwrap_err().to_string();
        assert!(text.contains("link type 1, expected 101"), "{text}");
    }

    #[test]
    fn a_checksum_over_data_and_itself_is_zero() {
        let from = SocketAddr::from(([10, 0, 0, 1], 1));
        let ip = packet(from, from, b"");
        assert_eq!(checksum(&[&ip[..20]]), 0);
        let from: SocketAddr = "[::1]:7".parse().unwrap();
        let ip = packet(from, from, b"abc");
        let udp = &ip[40..];
        let pseudo = [0, 0, 0, udp.len() as u8, 0, 0, 0, UDP];
        assert_eq!(checksum(&[&ip[8..40], &pseudo, udp]), 0);
    }
}
