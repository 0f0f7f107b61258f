//! Judges of WRAP: header, lengths, checksums, versions, sources and destinations of all recorded messages.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::time::Duration;

use super::view::{Found, Judge, View};
use crate::wire::{Direction, HEADER, checksum, trailer};
use stanag_msgs::Id;

pub(super) const JUDGES: &[Judge] = &[
    Judge {
        rule: "WRAP-001",
        judge: header_of_16_bytes,
    },
    Judge {
        rule: "WRAP-003",
        judge: length_counts_data_only,
    },
    Judge {
        rule: "WRAP-004",
        judge: no_datagram_over_548_bytes,
    },
    Judge {
        rule: "WRAP-007",
        judge: checksum_style_is_named,
    },
    Judge {
        rule: "WRAP-008",
        judge: crc_32,
    },
    Judge {
        rule: "WRAP-012",
        judge: version_number,
    },
    Judge {
        rule: "WRAP-014",
        judge: reserved_parts,
    },
    Judge {
        rule: "WRAP-016",
        judge: sources_and_destinations,
    },
    Judge {
        rule: "SCALAR-001",
        judge: header_byte_order,
    },
];

/// Bytes after the last message that match a checksum, though its properties name none.
fn unnamed_checksum(bytes: &[u8]) -> Option<u8> {
    let length = usize::from(u16::from_be_bytes([*bytes.get(2)?, *bytes.get(3)?]));
    let style = bytes.get(15)? >> 6;
    let end = HEADER + length;
    let left = bytes.len().checked_sub(end)?;
    (1..=3).find(|&other| {
        other != style && left == trailer(other) && checksum(other, &bytes[..end]) == bytes[end..]
    })
}

fn header_of_16_bytes(view: &View<'_>, found: &mut Found) {
    for datagram in view
        .of_subject()
        .filter(|datagram| !datagram.bytes.is_empty())
    {
        found.saw();
        if unnamed_checksum(&datagram.bytes).is_some() {
            continue;
        }
        if let Some(fault) = &datagram.fault {
            let length = datagram.bytes.get(2..4).map_or(0, |word| {
                usize::from(u16::from_be_bytes([word[0], word[1]]))
            });
            // Reading T of the header: four bytes longer.
            let reading = if datagram.bytes.len() >= 20
                && length + 20 <= datagram.bytes.len()
                && datagram.bytes.len() - length - 20 <= 4
            {
                "; a header of 20 bytes (reading T) would fit"
            } else {
                ""
            };
            found.fail_at(
                datagram,
                format!(
                    "expected datagrams that split into header, data and checksum; {fault}{reading}"
                ),
            );
        }
    }
}

fn length_counts_data_only(view: &View<'_>, found: &mut Found) {
    for datagram in view.of_subject() {
        let bytes = &datagram.bytes;
        if datagram.fault.is_none() {
            if !datagram.messages.is_empty() {
                found.saw();
            }
            continue;
        }
        let Some(word) = bytes.get(2..4) else {
            continue;
        };
        let length = usize::from(u16::from_be_bytes([word[0], word[1]]));
        // The checksum at the end shows where the data really end.
        let sum = bytes
            .get(15)
            .map_or(0, |properties| trailer(properties >> 6));
        if let Some(end) = bytes
            .len()
            .checked_sub(sum)
            .filter(|&end| sum > 0 && end > HEADER)
            && checksum(bytes[15] >> 6, &bytes[..end]) == bytes[end..]
            && length != end - HEADER
        {
            found.fail_at(
                datagram,
                format!(
                    "expected Message Length to be that of the data, {} bytes; it is {length}",
                    end - HEADER
                ),
            );
            continue;
        }
        if length >= HEADER && length <= bytes.len() && HEADER + length > bytes.len() {
            found.fail_at(
                datagram,
                format!("expected Message Length to count the data only; it is {length} in a datagram of {} bytes, so header or checksum are counted", bytes.len()),
            );
        }
    }
}

fn no_datagram_over_548_bytes(view: &View<'_>, found: &mut Found) {
    for datagram in view.of_subject() {
        found.saw();
        if datagram.bytes.len() > 548 {
            found.fail_at(
                datagram,
                format!(
                    "expected at most 548 bytes of UDP payload, got {}",
                    datagram.bytes.len()
                ),
            );
        }
    }
}

fn checksum_style_is_named(view: &View<'_>, found: &mut Found) {
    for datagram in view.of_subject() {
        if let Some(style) = unnamed_checksum(&datagram.bytes)
            .filter(|_| datagram.fault.is_some() || datagram.messages.is_empty())
        {
            found.fail_at(
                datagram,
                format!("expected the properties to name the checksum that follows; they do not, and the {} bytes behind the data are a checksum of style {style}", trailer(style)),
            );
        }
    }
    for seen in view.messages() {
        let style = seen.piece.style();
        if style == 0 {
            found.check(seen, view.profile.subject.unsummed, || {
                "expected a checksum, since the profile does not allow style 0; the properties name none".into()
            });
            continue;
        }
        if style == 3 {
            continue;
        }
        let (value, expected) = seen.piece.checksums();
        found.check(seen, value == expected, || {
            let crc16 = view.profile.readings.get("checksum_1").is_some_and(|reading| reading == "crc16");
            let reading = if style == 1 && crc16 { " (the profile reads style 1 as CRC-16, which is not judged)" } else { "" };
            format!("expected checksum 0x{expected:x} (style {style}: sum over header and data) in message {}, got 0x{value:x}{reading}", seen.kind())
        });
    }
}

fn crc_32(view: &View<'_>, found: &mut Found) {
    for seen in view.messages().filter(|seen| seen.piece.style() == 3) {
        let (value, expected) = seen.piece.checksums();
        found.check(seen, value == expected, || {
            format!("expected CRC-32 0x{expected:08x} over header and data, got 0x{value:08x}")
        });
    }
}

fn version_number(view: &View<'_>, found: &mut Found) {
    let expected = view.profile.idd();
    // A CUCS that sent a request in another version may be answered in it: for a while, and until it sends one in the
    // profile's version.
    let mut asked: BTreeMap<usize, Vec<(Duration, u8)>> = BTreeMap::new();
    for seen in view.requests() {
        let of_socket = asked.entry(seen.socket).or_default();
        of_socket.push((seen.at, seen.piece.idd()));
    }
    let may_answer = |socket: usize, at: Duration, idd: u8| {
        let asked = asked.get(&socket).map_or(&[][..], Vec::as_slice);
        let before = asked.iter().rev().filter(|(then, _)| *then <= at);
        let mut before = before.enumerate();
        before.any(|(k, (then, by))| *by == idd && (k == 0 || at - *then <= ANSWERED_WITHIN))
    };
    for seen in view.messages() {
        if seen.piece.idd() != expected && may_answer(seen.socket, seen.at, seen.piece.idd()) {
            continue;
        }
        found.check(seen, seen.piece.idd() == expected, || {
            format!(
                "expected IDD version {expected} (Edition {}), got {} in message {}",
                view.profile.subject.edition,
                seen.piece.idd(),
                seen.kind()
            )
        });
    }
}

/// How long after a request in another version an answer in it may come.
const ANSWERED_WITHIN: Duration = Duration::from_secs(5);

fn reserved_parts(view: &View<'_>, found: &mut Found) {
    let expected = if view.profile.idd() == 30 { 0xFFFF } else { 0 };
    for seen in view.messages() {
        let bits = seen.piece.properties & 0x3F;
        found.check(seen, seen.piece.reserved == expected && bits == 0, || {
            format!("expected first word 0x{expected:04x} and property bits 5 to 0 clear, got 0x{:04x} and 0x{bits:02x}", seen.piece.reserved)
        });
    }
}

fn sources_and_destinations(view: &View<'_>, found: &mut Found) {
    let (vehicles, vsm_ids) = (view.vehicles(), view.vsm_ids());
    let mut cucs: Vec<Id> = view.requests().map(|seen| seen.piece.source).collect();
    cucs.sort();
    cucs.dedup();
    // By address and not by socket: the system may give a released port to the next socket, which then receives late
    // datagrams for the one before.
    let senders: BTreeSet<(SocketAddr, Id)> = view
        .datagrams
        .iter()
        .filter(|datagram| datagram.direction == Direction::Sent)
        .flat_map(|datagram| {
            let seen = datagram.seen(view.as_they_are).iter();
            seen.map(move |seen| (datagram.local, seen.piece.source))
        })
        .collect();
    let mut misdirected: BTreeMap<(usize, Id, u16), usize> = BTreeMap::new();
    let received = view.of_subject().flat_map(|datagram| {
        let seen = datagram.seen(view.as_they_are).iter();
        seen.map(move |seen| (datagram.local, seen))
    });
    for (local, seen) in received {
        let (source, destination) = (seen.piece.source, seen.piece.destination);
        let place = format!("message {} from {source} to {destination}", seen.kind());
        found.check(
            seen,
            ![Id::NULL, Id::BROADCAST, Id(0)].contains(&source),
            || format!("expected the vehicle or VSM as source; got {place}"),
        );
        // Not 2 and 16002: responses to an unrecorded flood go to ids that occur nowhere else, and those of a
        // restarted subject, or late ones, may reach the socket that the id had before.
        if destination != Id::BROADCAST && !cucs.is_empty() && !matches!(seen.kind(), 2 | 16002) {
            // In a recording a CUCS may only listen.
            let of_vsm = vehicles.contains(&destination) || vsm_ids.contains(&destination);
            let listens = !view.live && destination != Id::NULL && !of_vsm;
            found.check(seen, cucs.contains(&destination) || listens, || {
                format!("expected a CUCS or the broadcast id as destination; got {place}")
            });
            let there = senders.contains(&(local, destination));
            found.check(seen, there || !view.live, || {
                format!("expected messages for {destination} at its own address only; got {place} at that of another CUCS")
            });
        }
        // A response to a damaged request, or a heartbeat that checks an address, may reach a wrong address twice,
        // but not more often.
        if view.live && matches!(seen.kind(), 2 | 16002) && cucs.contains(&destination) {
            let key = (seen.socket, destination, seen.kind());
            let count = misdirected.entry(key).or_default();
            *count += usize::from(!senders.contains(&(local, destination)));
            found.check(seen, *count < 3, || {
                format!("expected messages to {destination} at its own address only; got {place} at that of another CUCS")
            });
        }
        // Reports about a vehicle: a CUCS draws the vehicle that is the source.
        if matches!(seen.kind(), 3000..=4001 | 13001..=14000) && !vehicles.is_empty() {
            let only_vsm = vsm_ids.contains(&source) && !vsm_ids.contains(&Id::NULL);
            found.check(seen, vehicles.contains(&source) && !only_vsm, || {
                format!("expected the vehicle that a report is about as its source; got {place}")
            });
        }
    }
}

fn header_byte_order(view: &View<'_>, found: &mut Found) {
    for datagram in view.of_subject() {
        let bytes = &datagram.bytes;
        let Some(head) = bytes.get(..HEADER) else {
            continue;
        };
        let other = usize::from(u16::from_le_bytes([head[2], head[3]]));
        let left = bytes.len().checked_sub(HEADER + other);
        if datagram.fault.is_some() && left.is_some_and(|left| [0, 2, 4].contains(&left)) {
            found.fail_at(datagram, format!("expected the most significant byte first; the header's length fits only the other way round ({other} bytes)"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::net::Datagram;
    use crate::passive::view::trace::{received, sent};
    use crate::passive::view::{verdict_on, verdict_on_recorded};
    use crate::verdict::Verdict;
    use crate::wire::Draft;

    /// A CUCS that connects, and a report to this destination.
    fn reported_to(destination: Id) -> [Datagram; 3] {
        let mut report = Draft::new(3001);
        report.destination = Some(destination);
        [
            sent(0, Draft::new(1)),
            received(10, Draft::new(2)),
            received(20, report),
        ]
    }

    #[test]
    fn in_a_recording_a_cucs_may_only_listen() {
        let listener = reported_to(Id(0x1b00_00a1));
        assert_eq!(
            verdict_on(&listener, sources_and_destinations),
            Verdict::Fail
        );
        assert_eq!(
            verdict_on_recorded(&listener, sources_and_destinations),
            Verdict::Pass
        );
        // The vehicle itself, and nobody.
        for destination in [Id(0x1b00_0101), Id::NULL] {
            let run = reported_to(destination);
            let recorded = verdict_on_recorded(&run, sources_and_destinations);
            assert_eq!(recorded, Verdict::Fail, "{destination}");
        }
    }
}
