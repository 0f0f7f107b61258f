//! Judges of WRAP: header, lengths, checksums, versions, sources and destinations of all recorded messages.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::time::Duration;

use super::view::{Found, Judge, View};
use crate::wire::{Direction, HEADER, Seen, checksum, trailer};
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

/// The versions of the interface that a receiver at each socket has spoken itself, and so may be sent.
struct Spoken {
    by_socket: BTreeMap<usize, Vec<(Duration, u8)>>,
    live: bool,
    expected: u8,
}

impl Spoken {
    fn of(view: &View<'_>) -> Self {
        let mut by_socket: BTreeMap<usize, Vec<(Duration, u8)>> = BTreeMap::new();
        for seen in view.requests() {
            let of_socket = by_socket.entry(seen.socket).or_default();
            of_socket.push((seen.at, seen.piece.idd()));
        }
        Self {
            by_socket,
            live: view.live,
            expected: view.profile.idd(),
        }
    }

    /// Whether this message may have another version than that of the profile. A CUCS that sent a request in it may be
    /// answered in it: for a while, and until it sends one in the profile's version. Before a recording begins it may have
    /// sent one, and of who only listens in it nothing is known.
    fn may_be_sent(&self, seen: &Seen) -> bool {
        let idd = seen.piece.idd();
        let Some(of_socket) = self.by_socket.get(&seen.socket) else {
            return !self.live && [EDITION_3, EDITION_4].contains(&idd);
        };
        let before = of_socket.iter().rev().filter(|(then, _)| *then <= seen.at);
        let mut before = before.enumerate().peekable();
        if !self.live && before.peek().is_none() {
            return of_socket.first().is_some_and(|(_, by)| *by == idd);
        }
        before.any(|(k, (then, by))| *by == idd && (k == 0 || seen.at - *then <= ANSWERED_WITHIN))
    }

    /// The version that the message has to have, and that its first word goes by.
    fn expected_in(&self, seen: &Seen) -> u8 {
        if self.may_be_sent(seen) {
            seen.piece.idd()
        } else {
            self.expected
        }
    }
}

/// Versions of the interface in the properties.
const EDITION_3: u8 = 30;
const EDITION_4: u8 = 32;

fn version_number(view: &View<'_>, found: &mut Found) {
    let spoken = Spoken::of(view);
    for seen in view.messages() {
        let expected = spoken.expected;
        if seen.piece.idd() != expected && spoken.may_be_sent(seen) {
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
    let spoken = Spoken::of(view);
    for seen in view.messages() {
        // The first word is that of the edition which the message has, as where the receiver speaks another one.
        let edition_3 = spoken.expected_in(seen) == EDITION_3;
        let expected = if edition_3 { 0xFFFF } else { 0 };
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
            // In a recording the #2 of a vehicle may be missing.
            let vehicle = vehicles.contains(&source) || !view.live;
            found.check(seen, vehicle && !only_vsm, || {
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
        // Only where nothing of it can be read: what is cut off behind a message fits by chance.
        let unread = datagram.fault.is_some() && datagram.originals.is_empty();
        if unread && left.is_some_and(|left| [0, 2, 4].contains(&left)) {
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

    /// A CUCS that connects in one version, and a report in another, with that one's first word.
    fn answered(asked: u8, answered: u8, datagrams: &[usize]) -> Vec<Datagram> {
        let of = |message: u16, idd: u8| {
            let mut draft = Draft::new(message);
            draft.idd = Some(idd);
            draft
        };
        let all = [
            sent(0, of(1, asked)),
            received(10, of(3001, answered)),
            sent(60_000, of(1, asked)),
        ];
        datagrams.iter().map(|&place| all[place].clone()).collect()
    }

    #[test]
    fn a_cucs_is_answered_in_its_own_edition() {
        for judge in [version_number as fn(&View<'_>, &mut Found), reserved_parts] {
            let both = |run: &[Datagram]| [verdict_on(run, judge), verdict_on_recorded(run, judge)];
            assert_eq!(both(&answered(32, 32, &[0, 1])), [Verdict::Pass; 2]);
            assert_eq!(both(&answered(32, 30, &[0, 1])), [Verdict::Fail; 2]);
            // It has asked, or will: before the recording it may have.
            let own = answered(30, 30, &[0, 1]);
            assert!(!both(&own).contains(&Verdict::Fail));
            let later = answered(30, 30, &[1, 2]);
            assert_eq!(verdict_on(&later, judge), Verdict::Fail);
            assert_ne!(verdict_on_recorded(&later, judge), Verdict::Fail);
            let listens = answered(30, 30, &[1]);
            assert_ne!(verdict_on_recorded(&listens, judge), Verdict::Fail);
            let unknown = answered(30, 31, &[1]);
            assert_eq!(verdict_on_recorded(&unknown, version_number), Verdict::Fail);
        }
    }

    #[test]
    fn in_a_recording_the_response_of_a_vehicle_may_be_missing() {
        let mut report = Draft::new(3001);
        report.source = Some(Id(0x1b00_0102));
        let of_another = [
            sent(0, Draft::new(1)),
            received(10, Draft::new(2).id("VSM ID", Id(0x1b00_0001))),
            received(20, report.clone()),
        ];
        let recorded = |run: &[Datagram]| verdict_on_recorded(run, sources_and_destinations);
        assert_eq!(recorded(&of_another), Verdict::Pass);
        // The VSM is none.
        report.source = Some(Id(0x1b00_0001));
        let mut of_vsm = of_another.to_vec();
        of_vsm.push(received(30, report));
        assert_eq!(recorded(&of_vsm), Verdict::Fail);
    }

    #[test]
    fn bytes_behind_a_message_are_no_other_byte_order() {
        let datagram = |mut bytes: Vec<u8>, behind: &[u8]| {
            bytes.extend(behind);
            let ends = (([127, 0, 0, 1], 1).into(), ([127, 0, 0, 1], 2).into());
            let at = (Duration::ZERO, Duration::ZERO);
            Datagram::new(at, Direction::Received, 0, ends, bytes, None)
        };
        let whole = Draft::new(3001).encode(Id(1), Id(2), 32, 0);
        let mut exchanged = whole.clone();
        exchanged.swap(2, 3);
        // As many bytes that are no message as the length has the other way round.
        let behind = vec![0; 255 * (whole.len() - HEADER)];
        let judged = |one: Datagram| verdict_on(&[one], header_byte_order);
        assert_eq!(judged(datagram(exchanged, &[])), Verdict::Fail);
        assert_ne!(judged(datagram(whole, &behind)), Verdict::Fail);
    }

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
