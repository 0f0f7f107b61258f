//! `run.pcapng`: every datagram of the run, with rule and verdict as the packet's comment; and reading captures.

use std::collections::BTreeMap;
use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use super::{Report, RuleReport};
use crate::bench::net::Datagram;
use crate::verdict::Verdict;

/// The recording as a pcapng file.
#[must_use]
pub fn pcapng(report: &Report, datagrams: &[Datagram]) -> Vec<u8> {
    let cited = cited(report);
    let mut out = stanag_msgs::pcapng::header();
    for (index, datagram) in datagrams.iter().enumerate() {
        let (from, to) = match datagram.direction {
            crate::wire::Direction::Sent => (datagram.local, datagram.remote),
            crate::wire::Direction::Received => (datagram.remote, datagram.local),
        };
        let mut block = Vec::new();
        stanag_msgs::pcapng::datagram(&mut block, datagram.wall, from, to, &datagram.bytes);
        let scene = report.rules.iter().find(|rule| {
            rule.datagrams
                .is_some_and(|(first, last)| (first..last).contains(&index))
        });
        let mut remarks: Vec<String> = scene.into_iter().map(remark).collect();
        let micros = (datagram.at.as_secs_f64() * 1e6).round() as u64;
        for remark in cited.get(&micros).into_iter().flatten() {
            if !remarks.contains(remark) {
                remarks.push(remark.clone());
            }
        }
        if !remarks.is_empty() {
            comment(&mut block, &remarks.join(", "));
        }
        out.extend(block);
    }
    out
}

fn remark(rule: &RuleReport) -> String {
    format!("{} {}", rule.id, rule.verdict.name())
}

/// The rules that fail or warn and cite a datagram, by its time in microseconds: rules that read all traffic have no
/// datagrams of their own.
fn cited(report: &Report) -> BTreeMap<u64, Vec<String>> {
    let mut cited: BTreeMap<u64, Vec<String>> = BTreeMap::new();
    let judged = |rule: &&RuleReport| rule.verdict.is_fail() || rule.verdict == Verdict::Warning;
    for rule in report.rules.iter().filter(judged) {
        if rule.datagrams.is_none() {
            for message in &rule.evidence {
                let micros = message["time"].as_f64().unwrap_or_default() * 1e6;
                let remarks = cited.entry(micros.round() as u64).or_default();
                if !remarks.contains(&remark(rule)) {
                    remarks.push(remark(rule));
                }
            }
        }
    }
    cited
}

/// Adds an opt_comment to an enhanced packet block: options lie between the padded packet and the closing length.
fn comment(block: &mut Vec<u8>, text: &str) {
    let Some(end) = block.len().checked_sub(4) else {
        return;
    };
    block.truncate(end);
    block.extend(1_u16.to_le_bytes());
    block.extend((text.len() as u16).to_le_bytes());
    block.extend(text.as_bytes());
    block.resize(block.len().next_multiple_of(4), 0);
    block.extend([0; 4]);
    let length = (block.len() + 4) as u32;
    block.extend(length.to_le_bytes());
    block[4..8].copy_from_slice(&length.to_le_bytes());
}

/// A UDP datagram of a capture file.
#[derive(Clone, Debug, PartialEq)]
pub struct Captured {
    /// Time since 1970.
    pub wall: Duration,
    /// From.
    pub from: SocketAddr,
    /// To.
    pub to: SocketAddr,
    /// Payload.
    pub bytes: Vec<u8>,
}

/// What a capture file contains.
#[derive(Debug, Default)]
pub struct Capture {
    /// Its UDP datagrams.
    pub datagrams: Vec<Captured>,
    /// How many packets have a part of a datagram only: fragments, and what the recorder cut off. Whoever sent them is not to
    /// blame.
    pub cut: usize,
}

impl Capture {
    fn take(&mut self, wall: Duration, link: u32, packet: &[u8]) {
        match udp(wall, link, packet) {
            Some(Ok(captured)) => self.datagrams.push(captured),
            Some(Err(Cut)) => self.cut += 1,
            None => {}
        }
    }
}

/// A packet has a part of a datagram only.
struct Cut;

/// The UDP datagrams of a pcap or pcapng file.
///
/// # Errors
/// It is neither, or is damaged; in a sentence.
pub fn read(file: &[u8]) -> Result<Capture, String> {
    match file.get(..4) {
        Some([0x0A, 0x0D, 0x0D, 0x0A]) => Ok(read_pcapng(file)),
        Some([0xD4, 0xC3, 0xB2, 0xA1]) => Ok(read_pcap(file, false, 1_000)),
        Some([0x4D, 0x3C, 0xB2, 0xA1]) => Ok(read_pcap(file, false, 1)),
        Some([0xA1, 0xB2, 0xC3, 0xD4]) => Ok(read_pcap(file, true, 1_000)),
        Some([0xA1, 0xB2, 0x3C, 0x4D]) => Ok(read_pcap(file, true, 1)),
        _ => Err("neither a pcap nor a pcapng file: expected one of their magic numbers in the first four bytes".into()),
    }
}

fn number(bytes: &[u8], big: bool) -> u32 {
    let fold = |value: u32, &byte: &u8| value << 8 | u32::from(byte);
    if big {
        bytes.iter().fold(0, fold)
    } else {
        bytes.iter().rev().fold(0, fold)
    }
}

fn read_pcap(file: &[u8], big: bool, nanos: u32) -> Capture {
    let mut found = Capture::default();
    let link = file
        .get(20..24)
        .map_or(1, |bytes| number(bytes, big) & 0xFFFF);
    let mut rest = file.get(24..).unwrap_or_default();
    while let Some(head) = rest.get(..16) {
        let word = |at: usize| number(&head[at..at + 4], big);
        let length = word(8) as usize;
        let Some(packet) = rest.get(16..16 + length) else {
            break;
        };
        let wall = Duration::from_secs(word(0).into())
            + Duration::from_nanos(u64::from(word(4)) * u64::from(nanos));
        found.take(wall, link, packet);
        rest = &rest[16 + length..];
    }
    found
}

fn read_pcapng(file: &[u8]) -> Capture {
    let mut found = Capture::default();
    let mut big = false;
    // Link type and units of a time stamp in a second, for each interface.
    let mut interfaces: Vec<(u32, f64)> = Vec::new();
    let mut rest = file;
    while rest.len() >= 12 {
        if rest[..4] == [0x0A, 0x0D, 0x0D, 0x0A] {
            big = rest[8..12] == [0x1A, 0x2B, 0x3C, 0x4D];
            interfaces.clear();
        }
        let kind = number(&rest[..4], big);
        let length = number(&rest[4..8], big) as usize;
        let Some(body) = rest
            .get(8..length.saturating_sub(4))
            .filter(|_| length >= 12)
        else {
            break;
        };
        match kind {
            1 => {
                let link = body.get(..2).map_or(1, |bytes| number(bytes, big));
                interfaces.push((link, resolution(body.get(8..).unwrap_or_default(), big)));
            }
            6 if body.len() >= 20 => {
                let word = |at: usize| number(&body[at..at + 4], big);
                let (link, units) = interfaces
                    .get(word(0) as usize)
                    .copied()
                    .unwrap_or((1, 1e6));
                let time = (u64::from(word(4)) << 32 | u64::from(word(8))) as f64 / units;
                if let Some(packet) = body.get(20..20 + word(12) as usize) {
                    found.take(Duration::from_secs_f64(time.min(1e12)), link, packet);
                }
            }
            _ => {}
        }
        rest = rest.get(length..).unwrap_or_default();
    }
    found
}

/// if_tsresol of an interface: time stamps in a second.
fn resolution(mut options: &[u8], big: bool) -> f64 {
    while options.len() >= 4 {
        let (code, length) = (
            number(&options[..2], big),
            number(&options[2..4], big) as usize,
        );
        if code == 0 {
            break;
        }
        if code == 9 {
            let value = options.get(4).copied().unwrap_or(6);
            let exponent = i32::from(value & 0x7F);
            return if value & 0x80 == 0 {
                10_f64.powi(exponent)
            } else {
                2_f64.powi(exponent)
            };
        }
        options = options
            .get(4 + length.next_multiple_of(4)..)
            .unwrap_or_default();
    }
    1e6
}

/// The UDP datagram in a packet of this link type: raw IP, Ethernet, Linux cooked (1 and 2), BSD loopback.
fn udp(wall: Duration, link: u32, packet: &[u8]) -> Option<Result<Captured, Cut>> {
    let mut ip = match link {
        1 => match packet.get(12..14)? {
            [0x81, 0x00] => packet.get(18..)?,
            _ => packet.get(14..)?,
        },
        0 | 108 => packet.get(4..)?,
        113 => packet.get(16..)?,
        276 => packet.get(20..)?,
        _ => packet,
    };
    let address = |bytes: &[u8]| -> Option<IpAddr> {
        match bytes.len() {
            4 => <[u8; 4]>::try_from(bytes).ok().map(IpAddr::from),
            _ => <[u8; 16]>::try_from(bytes).ok().map(IpAddr::from),
        }
    };
    let (from, to) = match ip.first()? >> 4 {
        4 => {
            let head = usize::from(ip[0] & 0xF) * 4;
            if *ip.get(9)? != 17 {
                return None;
            }
            let addresses = (address(ip.get(12..16)?)?, address(ip.get(16..20)?)?);
            // More fragments, or the offset of one.
            if number(ip.get(6..8)?, true) & 0x3FFF != 0 {
                return Some(Err(Cut));
            }
            ip = ip.get(head..)?;
            addresses
        }
        6 => {
            if *ip.get(6)? != 17 {
                return None;
            }
            let addresses = (address(ip.get(8..24)?)?, address(ip.get(24..40)?)?);
            ip = ip.get(40..)?;
            addresses
        }
        _ => return None,
    };
    let word = |at: usize| Some(number(ip.get(at..at + 2)?, true) as u16);
    let length = usize::from(word(4)?);
    let Some(bytes) = ip.get(8..length) else {
        return Some(Err(Cut));
    };
    Some(Ok(Captured {
        wall,
        from: SocketAddr::new(from, word(0)?),
        to: SocketAddr::new(to, word(2)?),
        bytes: bytes.to_vec(),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_also_with_comments() {
        let (from, to) = (
            SocketAddr::from(([10, 0, 0, 1], 4586)),
            SocketAddr::from(([10, 0, 0, 2], 40_000)),
        );
        let mut file = stanag_msgs::pcapng::header();
        for payload in [&b"first"[..], &b"second datagram"[..]] {
            let mut block = Vec::new();
            stanag_msgs::pcapng::datagram(
                &mut block,
                Duration::from_millis(1_700_000_000_250),
                from,
                to,
                payload,
            );
            comment(&mut block, "AUTH-002 fail");
            file.extend(block);
        }
        let found = read(&file).unwrap().datagrams;
        assert_eq!(found.len(), 2);
        assert_eq!(found[1].bytes, b"second datagram");
        assert_eq!((found[0].from, found[0].to), (from, to));
        assert_eq!(found[0].wall, Duration::from_millis(1_700_000_000_250));
        assert!(read(b"hello world").is_err());
    }

    /// A packet of raw IP with these bytes of flags and offset, and as many bytes of a datagram of 20.
    fn packet(fragment: [u8; 2], bytes: usize) -> Vec<u8> {
        let mut packet = vec![0x45, 0, 0, 48, 0, 0, fragment[0], fragment[1], 64, 17, 0, 0];
        packet.extend([10, 0, 0, 1, 10, 0, 0, 2]);
        packet.extend([0x11, 0xEA, 0x11, 0xEA, 0, 28, 0, 0]);
        packet.extend(vec![7; bytes]);
        packet
    }

    #[test]
    fn a_part_of_a_datagram_is_none() {
        let mut capture = Capture::default();
        // Whole, without "may be fragmented", and with what fills up a frame behind it.
        for (fragment, bytes) in [([0, 0], 20), ([0x40, 0], 20), ([0, 0], 26)] {
            capture.take(Duration::ZERO, 101, &packet(fragment, bytes));
        }
        assert_eq!(capture.datagrams.len(), 3);
        assert!(capture.datagrams.iter().all(|one| one.bytes == [7; 20]));
        // Cut off by the recorder, the first and the last of several fragments.
        for (fragment, bytes) in [([0, 0], 12), ([0x20, 0], 20), ([0, 3], 20)] {
            capture.take(Duration::ZERO, 101, &packet(fragment, bytes));
        }
        assert_eq!((capture.datagrams.len(), capture.cut), (3, 3));
    }
}
