//! What arrived from ground stations and could not be used, and why.
//!
//! [`DliEvidence`] keeps a little of each kind, so that nobody who sends garbage can hide what somebody else's shows, and
//! nothing of it grows: [`PLACES`] of a kind, forgotten [`LIFE`] after they were last seen.

use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use stanag_msgs::wrapper::{
    ChecksumStyle, HEADER_BYTES, Header, MAX_DATA, Sum16Variant, WrapperError,
};
use stanag_msgs::{Id, ed25};

use super::{Code, Finding, key_of};
use crate::config::{Checksum, Edition};
use crate::session::guard::GuardRefusal;
use crate::session::station::EDITION_CHANGES_AFTER;

/// Why a frame or a datagram could not be used.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    /// Its source is not listed; the edition and the checksum that it speaks with.
    NotListed(Id, Edition, ChecksumStyle),
    /// Its source is listed with another address.
    Address(Id, IpAddr),
    /// Its source came in this edition, and is listed with this other one.
    OtherEdition(Id, Edition, Edition),
    /// Its source has spoken in another edition than this one until now, and it is not long enough since.
    ChangedEdition(Id, Edition),
    /// Its source has a guard, which it did not come from: by this counter.
    Guard(Id, &'static str),
    /// It is a web client, and a datagram in its name was dropped: with this counter.
    WebDatagram(Id, &'static str),
    /// It is a web client, and a connection in its name was refused or ended: with this counter.
    Web(Id, &'static str),
    /// Its source is listed; nobody here has its destination's id.
    Misaddressed(Id, Id),
    /// Its source is listed; its messages of this type cannot be decoded, or only a VSM sends them. The reason.
    Undecodable(Id, u32, String),
    /// Its checksum does not fit, under this style; and how it would.
    Checksum(ChecksumStyle, Option<Fits>),
    /// Its IDD version.
    Edition(u8),
    /// The version string of Edition 2.5 and before.
    VersionString,
    /// Its numbers have their lowest byte first.
    LittleEndian,
    /// It is MAVLink.
    MavLink,
    /// Nothing that is known.
    Unreadable,
}

/// How a checksum was computed that does not fit as its style requires.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fits {
    /// Style 1 read in the other way.
    Style1(Sum16Variant),
    /// As another style.
    As(ChecksumStyle),
    /// With its lowest byte first.
    LittleEndian,
}

impl Fault {
    /// What a wrapper that cannot be read shows of its sender.
    pub(crate) fn of(datagram: &[u8], fault: &WrapperError) -> Fault {
        match *fault {
            WrapperError::Checksum { offset, value, .. } => {
                let style = datagram.get(15).map_or(0, |bits| bits >> 6);
                let style = ChecksumStyle::from_code(style);
                // Only of the first message of a datagram is it known where it begins.
                let summed = datagram.get(..offset).unwrap_or_default();
                Fault::Checksum(style, fits(style, value, summed))
            }
            _ if is_version_string(datagram) => Fault::VersionString,
            _ if matches!(datagram.first(), Some(0xfd | 0xfe)) => Fault::MavLink,
            _ if is_little_endian(datagram) => Fault::LittleEndian,
            WrapperError::Idd { value, .. } => Fault::Edition(value),
            WrapperError::ChecksumStyle { .. } => Fault::Edition(Header::IDD_ED3),
            _ => Fault::Unreadable,
        }
    }

    /// Seen so often without anything good of the same address, or of the same type, it is a fault of the sender and no damage on the way.
    fn needs(&self) -> u32 {
        match self {
            Fault::NotListed(..)
            | Fault::Address(..)
            | Fault::OtherEdition(..)
            | Fault::ChangedEdition(..)
            | Fault::Guard(..)
            | Fault::WebDatagram(..)
            | Fault::Web(..)
            | Fault::Misaddressed(..) => 1,
            _ => 3,
        }
    }

    /// Whether both take a place of the same few. Of listed stations each has its own: none hides what another sends.
    fn shares_places(&self, other: &Fault) -> bool {
        match (self, other) {
            (Fault::Undecodable(one, ..), Fault::Undecodable(other, ..)) => one == other,
            (one, other) => std::mem::discriminant(one) == std::mem::discriminant(other),
        }
    }
}

fn fits(style: ChecksumStyle, value: u32, summed: &[u8]) -> Option<Fits> {
    let of = |style: ChecksumStyle, variant| {
        let sum = style.of(variant, summed);
        if style.bytes() == 2 {
            sum & 0xFFFF
        } else {
            sum
        }
    };
    let swapped = if style.bytes() == 2 {
        (value << 16).swap_bytes()
    } else {
        value.swap_bytes()
    };
    use Sum16Variant::{Crc16, Sum};
    if style == ChecksumStyle::Sum16 {
        // Which of the two is in force does not fit, so the other one is what fits.
        for variant in [Sum, Crc16] {
            if of(style, variant) == value {
                return Some(Fits::Style1(variant));
            }
        }
    }
    for other in [ChecksumStyle::Sum32, ChecksumStyle::Crc32] {
        if style.bytes() == 4 && other != style && of(other, Sum) == value {
            return Some(Fits::As(other));
        }
    }
    (of(style, Sum) == swapped).then_some(Fits::LittleEndian)
}

/// The wrapper of Edition 2.5 begins with its version as text, such as "2.5".
fn is_version_string(datagram: &[u8]) -> bool {
    matches!(datagram, [major, b'.', minor, ..] if major.is_ascii_digit() && minor.is_ascii_digit())
}

/// Whether length and properties make a wrapper where they are read with their lowest byte first.
fn is_little_endian(datagram: &[u8]) -> bool {
    let word = |at: usize| {
        let bytes = datagram.get(at..)?.first_chunk()?;
        Some(u16::from_le_bytes(*bytes))
    };
    let (Some(length), Some(properties)) = (word(2), word(14)) else {
        return false;
    };
    let style = ChecksumStyle::from_code((properties >> 6) as u8);
    let version = (properties >> 8) as u8 & 0x7F;
    let length = usize::from(length);
    (1..=MAX_DATA).contains(&length)
        && (Header::IDD_ED3..=Header::IDD_ED4).contains(&version)
        && HEADER_BYTES + length + style.bytes() <= datagram.len()
}

#[derive(Debug)]
struct Seen {
    fault: Fault,
    from: SocketAddr,
    count: u32,
    last: Duration,
}

impl Seen {
    /// Of the same sender, as far as that can be believed: the port proves nothing.
    fn is_same(&self, from: SocketAddr, fault: &Fault) -> bool {
        match (&self.fault, fault) {
            (Fault::NotListed(one, ..), Fault::NotListed(other, ..))
            | (Fault::Address(one, _), Fault::Address(other, _))
            | (Fault::OtherEdition(one, ..), Fault::OtherEdition(other, ..))
            | (Fault::ChangedEdition(one, _), Fault::ChangedEdition(other, _))
            | (Fault::Misaddressed(one, _), Fault::Misaddressed(other, _)) => one == other,
            // The first reason stays: a text that changed with every message would be a new alert each time.
            (Fault::Undecodable(one, of, _), Fault::Undecodable(other, other_of, _)) => {
                (one, of) == (other, other_of)
            }
            // A forger's one reason hides no other, which may be an honest guard's.
            (Fault::Guard(..), Fault::Guard(..))
            | (Fault::WebDatagram(..), Fault::WebDatagram(..))
            | (Fault::Web(..), Fault::Web(..)) => self.fault == *fault,
            (one, other) => {
                std::mem::discriminant(one) == std::mem::discriminant(other)
                    && self.from.ip() == from.ip()
            }
        }
    }
}

/// What was seen lately.
#[derive(Debug, Default)]
pub(crate) struct DliEvidence {
    seen: Vec<Seen>,
    /// Since when datagrams that cannot be read have been looked into, and how many.
    window: Option<Duration>,
    looks: u32,
    /// Datagrams of the group arrived on this interface, which has not joined it, from there.
    elsewhere: Option<(Duration, IpAddr, SocketAddr)>,
}

impl DliEvidence {
    /// A datagram that cannot be read. A flood of them is looked into now and then.
    pub(crate) fn note_broken(
        &mut self,
        mono: Duration,
        from: SocketAddr,
        datagram: &[u8],
        fault: &WrapperError,
    ) {
        if self
            .window
            .is_none_or(|began| mono.saturating_sub(began) >= LOOK_EVERY)
        {
            (self.window, self.looks) = (Some(mono), 0);
        }
        if self.looks < MAX_LOOKS {
            self.looks += 1;
            self.note(mono, from, Fault::of(datagram, fault));
        }
    }

    /// A frame that is not for here, or of nobody who may send it.
    pub(crate) fn note(&mut self, mono: Duration, from: SocketAddr, fault: Fault) {
        // Keep the first one: a sender that varies the rest, or forges its source address, makes no new finding.
        if let Some(known) = self.seen.iter_mut().find(|one| one.is_same(from, &fault)) {
            known.last = mono;
            known.count = known.count.saturating_add(1);
            return;
        }
        self.seen.retain(|one| mono.saturating_sub(one.last) < LIFE);
        let rivals = self
            .seen
            .iter()
            .filter(|one| fault.shares_places(&one.fault));
        // Of guards there are as many as there are stations with one and reasons, however many forge.
        let bounded = matches!(
            fault,
            Fault::Guard(..) | Fault::WebDatagram(..) | Fault::Web(..)
        );
        if bounded || rivals.count() < PLACES {
            self.seen.push(Seen {
                fault,
                from,
                count: 1,
                last: mono,
            });
        }
    }

    /// A frame of a listed station that can be read: what was broken from its address was damaged on the way, or is
    /// mended.
    pub(crate) fn note_good(&mut self, source: Id, from: SocketAddr) {
        if self.seen.is_empty() {
            return;
        }
        self.seen.retain(|one| match one.fault {
            Fault::NotListed(id, ..)
            | Fault::Address(id, _)
            | Fault::OtherEdition(id, ..)
            | Fault::ChangedEdition(id, _)
            | Fault::Misaddressed(id, _) => id != source,
            // A forger's beside its own: shown as long as it lasts. What cannot be decoded had a wrapper that can be read:
            // `note_decoded` clears it.
            Fault::Guard(..) | Fault::WebDatagram(..) | Fault::Web(..) | Fault::Undecodable(..) => {
                true
            }
            // Of the wrapper: nothing of it can be believed of who sent it.
            _ => one.from.ip() != from.ip(),
        });
    }

    /// A message of a listed station that can be decoded: its type is mended, if it was not.
    pub(crate) fn note_decoded(&mut self, source: Id, message_type: u32) {
        self.seen.retain(|one| {
            !matches!(one.fault, Fault::Undecodable(id, of, _) if (id, of) == (source, message_type))
        });
    }

    /// The group's datagrams arrive on another interface.
    pub(crate) fn note_elsewhere(&mut self, mono: Duration, interface: IpAddr, from: SocketAddr) {
        self.elsewhere = Some((mono, interface, from));
    }

    /// What does not work.
    pub(crate) fn judge(
        &self,
        mono: Duration,
        group: Option<SocketAddr>,
        found: &mut Vec<Finding>,
    ) {
        let fresh = |at: Duration| mono.saturating_sub(at) < LIFE;
        for one in self.seen.iter().filter(|one| fresh(one.last)) {
            if one.count >= one.fault.needs() {
                let finding = finding(one);
                // Two of one code from one address would take turns as one alert.
                let known =
                    |other: &Finding| (other.code, other.key) == (finding.code, finding.key);
                if !found.iter().any(known) {
                    found.push(finding);
                }
            }
        }
        if let (Some((at, interface, from)), Some(group)) = (self.elsewhere, group)
            && fresh(at)
        {
            found.push(elsewhere(group, interface, from));
        }
    }
}

/// The group's datagrams arrive on an interface that has not joined it.
pub(crate) fn elsewhere(group: SocketAddr, interface: IpAddr, from: SocketAddr) -> Finding {
    Finding::new(
        Code::GroupInterface,
        group,
        format!(
            "datagrams of the group {group} arrive from {} on the interface {interface}, which has not joined it",
            from.ip()
        ),
        format!("set dli.interface = \"{interface}\""),
    )
}

/// What a station sends from an address at which it has proved nothing for a while; where it is sent to meanwhile.
pub(crate) fn unproven(station: Id, at: SocketAddr, current: Option<SocketAddr>) -> Finding {
    let (cause, or) = match current {
        Some(current) => (
            format!("what it sends is held back, and answers go to {current}"),
            "; where it has not moved, somebody else uses its id",
        ),
        None => ("it is sent at most three times its bytes".to_owned(), ""),
    };
    let mut finding = Finding::new(
        Code::CucsUnproven,
        station,
        format!("CUCS {station} sends from {at}, and has not proved to be there: {cause}"),
        format!(
            "let it answer our heartbeats (16002 by 17000, in Edition 2.5 #1403 by #1400), or give its [[cucs]] an address{or}"
        ),
    );
    finding.key = station.0;
    finding
}

/// The clock of a station that is off from this computer's, by its stamps.
pub(crate) fn station_clock(station: Id, ahead_ms: i64) -> Finding {
    let off = Duration::from_millis(ahead_ms.unsigned_abs());
    let way = if ahead_ms > 0 { "ahead of" } else { "behind" };
    let mut finding = Finding::new(
        Code::CucsClock,
        station,
        format!(
            "the time stamps of CUCS {station} are {} {way} this computer's clock",
            span(off)
        ),
        "set both clocks (NTP): stamps count UTC, milliseconds since 2000, in Edition 2.5 seconds since 1970",
    );
    finding.key = station.0;
    finding
}

/// Rounded, so that the text does not change from message to message.
fn span(off: Duration) -> String {
    let (seconds, minutes) = (off.as_secs(), off.as_secs() / 60);
    match minutes {
        0 if seconds < 10 => format!("over {seconds} s"),
        0..5 => format!("over {} s", seconds / 10 * 10),
        5..120 => format!("over {} min", minutes / 5 * 5),
        120..2_880 => format!("over {} h", minutes / 60),
        _ => format!("over {} days", minutes / 1_440),
    }
}

/// `why`: the counter.
fn guard_cure(why: &str) -> &'static str {
    let is = |reason: GuardRefusal| why == reason.name();
    if is(GuardRefusal::Disk) {
        "this computer's disk is full or slow, and its guard is at no fault: make room in the store, or give it a faster disk"
    } else if is(GuardRefusal::Ahead) {
        "if it lasts, set the clocks of this computer and of the guard's, and update both; if that is done, somebody sends recordings in its \
         name"
    } else if is(GuardRefusal::Old) || is(GuardRefusal::Late) {
        "if it lasts, see that this VSM's answers reach the guard, and that the clock of its computer has not been set back; if both is \
         so, somebody sends recordings in its name"
    } else {
        "have it send through `vsm guard`, of the version of this VSM and with the key file that its [[cucs]] names; if \
         it does, somebody else writes in its name"
    }
}

fn finding(one: &Seen) -> Finding {
    let ip = one.from.ip();
    let of_ip = match ip {
        IpAddr::V4(ip) => ip.to_bits(),
        IpAddr::V6(ip) => ip.to_bits() as u32,
    };
    let broken = |code, cause: String, cure: String| {
        let mut finding = Finding::new(code, ip, format!("datagrams from {ip} {cause}"), cure);
        finding.key = of_ip;
        finding
    };
    let of_cucs = |code, id: Id, cause: String, cure: String| {
        let mut finding = Finding::new(code, id, format!("CUCS {id} {cause}"), cure);
        finding.key = id.0;
        finding
    };
    let of_key = |id: Id, why: &str, cause: String, cure: &str| {
        let mut finding = of_cucs(Code::CucsGuard, id, cause, cure.to_owned());
        finding.key = key_of(id.0, why);
        finding
    };
    match one.fault {
        Fault::NotListed(id, edition, style) => {
            // In Edition 2.5 nothing but the edition can be set.
            let checksum = match edition {
                Edition::Ed25 => String::new(),
                _ => format!(" and checksum = \"{}\"", Checksum(style).text()),
            };
            of_cucs(
                Code::CucsNotListed,
                id,
                format!("sends from {ip}, but is not listed"),
                format!(
                    "to let it in, add [[cucs]] with id = \"{id}\" and the LOI that it may have, such as loi = [2]; as it speaks \
                     now, edition = \"{}\"{checksum} would fit, and needs no line",
                    edition.text(),
                ),
            )
        }
        Fault::Address(id, expected) => of_cucs(
            Code::CucsAddress,
            id,
            format!("sends from {ip}, but its address is configured as {expected}"),
            format!("if it has moved, set address = \"{ip}\" in its [[cucs]]; if not, somebody else uses its id"),
        ),
        Fault::Guard(id, why) => of_key(
            id,
            why,
            format!("has a guard, and datagrams in its name from {ip} are dropped ({why})"),
            guard_cure(why),
        ),
        Fault::WebDatagram(id, why) => of_key(
            id,
            why,
            format!("is a web client, and datagrams in its name from {ip} are dropped ({why})"),
            "have it connect to the page's address by /control, with the key file that its [[cucs]] names; if it does, \
             somebody else uses its name",
        ),
        Fault::Web(id, why) => of_key(
            id,
            why,
            format!("is a web client, and a connection in its name from {ip} was refused or ended ({why})"),
            "have it connect with the key file that its [[cucs]] names, and as a client of the version of this VSM; if it does, \
             somebody else uses its name",
        ),
        Fault::OtherEdition(id, edition, only) => of_cucs(
            Code::DliEdition,
            id,
            format!(
                "sends in Edition {} from {ip}, but is configured with edition = \"{}\"",
                edition.text(),
                only.text()
            ),
            format!(
                "if it speaks that, set edition = \"{}\" in its [[cucs]], or leave the key out; if not, somebody else uses \
                 its id",
                edition.text()
            ),
        ),
        Fault::ChangedEdition(id, edition) => of_cucs(
            Code::DliEdition,
            id,
            format!(
                "sends in Edition {new} from {ip}, and spoke another edition here until now: what comes in Edition {new} is dropped \
                 until {} s after its last message in the other",
                EDITION_CHANGES_AFTER.as_secs(),
                new = edition.text(),
            ),
            format!(
                "if it has changed, wait; where it always speaks this one, set edition = \"{}\" in its [[cucs]]; if neither, \
                 somebody else uses its id",
                edition.text()
            ),
        ),
        Fault::Misaddressed(id, to) => of_cucs(
            Code::CucsMisaddressed,
            id,
            format!("sends to {to}, and no vehicle here has that id"),
            "have it send to the id of a [[vehicle]], to dli.vsm_id or to ff:ff:ff:ff, or correct the id in the configuration"
                .to_owned(),
        ),
        Fault::Undecodable(id, message_type, ref why) => {
            let named = u16::try_from(message_type)
                .map_or_else(|_| message_type.to_string(), ed25::named);
            let mut finding = of_cucs(
                Code::DliUndecodable,
                id,
                format!("sends message {named} from {ip}, and it is dropped: {why}"),
                "correct the CUCS: `echo HEX | vsm decode` reads one message, docs/reference/dli has the presence vector, the fields and \
                 the direction of each"
                    .to_owned(),
            );
            // Two types of one station stand beside each other.
            finding.key = id.0.rotate_left(16) ^ message_type;
            finding
        }
        Fault::Checksum(style, fits) => {
            let (how, cure) = match fits {
                Some(Fits::Style1(Sum16Variant::Crc16)) => (
                    "it is a CRC-16".to_owned(),
                    "set disputed = { checksum_1 = \"crc16\" } in its [[cucs]], or dli.disputed.checksum_1 = \"crc16\" for all".to_owned(),
                ),
                Some(Fits::Style1(Sum16Variant::Sum)) => (
                    "it is a sum of bytes".to_owned(),
                    "set dli.disputed.checksum_1 = \"sum\", its default".to_owned(),
                ),
                Some(Fits::As(other)) => (
                    format!("it is that of style {}", other.code()),
                    "have the CUCS name the style that it uses, or use none (style 0)".to_owned(),
                ),
                Some(Fits::LittleEndian) => (
                    "its bytes are in reverse order".to_owned(),
                    "have the CUCS send numbers with the highest byte first, or use no checksum (style 0)".to_owned(),
                ),
                None => (
                    "it fits no known style".to_owned(),
                    "the CUCS computes it in another way, or the network damages datagrams: have it use no checksum (style 0), \
                     which UDP has anyway"
                        .to_owned(),
                ),
            };
            let cause = format!("have a wrong checksum of style {}: {how}", style.code());
            broken(Code::DliChecksum, cause, cure)
        }
        Fault::Edition(version) => broken(
            Code::DliEdition,
            format!(
                "are of IDD version {version}, expected {} (Edition 3) to {} (Edition 4)",
                Header::IDD_ED3,
                Header::IDD_ED4
            ),
            "set the CUCS to Edition 4 or 3 of the DLI".to_owned(),
        ),
        Fault::VersionString => broken(
            Code::DliEdition,
            "have the wrapper of Edition 2.5 or before, expected that of Edition 3 or 4".to_owned(),
            "set the CUCS to Edition 4 or 3 of the DLI".to_owned(),
        ),
        Fault::LittleEndian => broken(
            Code::DliByteOrder,
            "are in little-endian byte order, expected the highest byte first (big-endian)".to_owned(),
            "set the CUCS to network byte order: the DLI has no other".to_owned(),
        ),
        Fault::MavLink => broken(
            Code::DliUnreadable,
            "are MAVLink, on the DLI port".to_owned(),
            "the vehicle sends to the wrong port: have it send to that of vehicle.link".to_owned(),
        ),
        Fault::Unreadable => broken(
            Code::DliUnreadable,
            "are no messages of the DLI".to_owned(),
            "another program sends to dli.listen, or the CUCS uses another wrapper: record them ([record] dir) and look with \
             Wireshark"
                .to_owned(),
        ),
    }
}

/// Of each kind this many at most, and of what cannot be decoded of each station.
const PLACES: usize = 4;
/// How long evidence lasts.
const LIFE: Duration = Duration::from_secs(300);
/// Of the datagrams that cannot be read so many are looked into in this time. Several at once may be of several senders.
const MAX_LOOKS: u32 = 16;
const LOOK_EVERY: Duration = Duration::from_millis(100);

#[cfg(test)]
mod tests {
    use super::*;
    use stanag_msgs::messages::Heartbeat;
    use stanag_msgs::{Envelope, MAX_DATAGRAM, Message, Profile, frames};

    const CUCS: Id = Id(0x1b00_00a0);
    const VSM: Id = Id(0x1b00_0001);

    fn address(last: u8) -> SocketAddr {
        SocketAddr::from(([10, 0, 0, last], 4000))
    }

    fn datagram(checksum: ChecksumStyle) -> Vec<u8> {
        let mut bytes = [0; MAX_DATAGRAM];
        let envelope = Envelope::new(CUCS, VSM).summed(checksum);
        let message = Message::from(Heartbeat::default());
        let length = message.encode(&envelope, &mut bytes).expect("it fits");
        bytes[..length].to_vec()
    }

    #[test]
    fn each_reason_of_a_guard_is_a_finding_of_its_own() {
        let mut evidence = DliEvidence::default();
        let reasons = ["a", "b", "c", "d", "e", "f"];
        for (n, why) in reasons.into_iter().enumerate() {
            // As many as it needs, whatever else is in the station's name; and of another station too.
            for _ in 0..5 {
                for id in [CUCS, VSM] {
                    evidence.note(Duration::ZERO, address(n as u8), Fault::Guard(id, why));
                }
            }
        }
        let mut found = vec![];
        evidence.judge(Duration::ZERO, None, &mut found);
        assert_eq!(found.len(), 2 * reasons.len());
    }

    #[test]
    fn a_disk_and_a_clock_are_no_stranger_in_the_name_of_a_cucs() {
        for (why, words) in [
            (GuardRefusal::Disk, "make room in the store"),
            (GuardRefusal::Ahead, "set the clock"),
            (GuardRefusal::Old, "has not been set back"),
            (GuardRefusal::Forged, "somebody else writes in its name"),
        ] {
            let mut evidence = DliEvidence::default();
            evidence.note(Duration::ZERO, address(1), Fault::Guard(CUCS, why.name()));
            let mut found = vec![];
            evidence.judge(Duration::ZERO, None, &mut found);
            let [finding] = &found[..] else {
                panic!("{found:?}");
            };
            assert!(finding.cure.contains(words), "{finding}");
        }
    }

    /// What is found where this datagram arrives so often.
    fn found(datagram: &[u8], times: u64) -> Vec<Finding> {
        let mut evidence = DliEvidence::default();
        for n in 0..times {
            let at = Duration::from_secs(n);
            let fault = Profile::default().frames(datagram).find_map(Result::err);
            let fault = fault.expect("it cannot be read");
            evidence.note_broken(at, address(1), datagram, &fault);
        }
        let mut found = vec![];
        evidence.judge(Duration::from_secs(times), None, &mut found);
        found
    }

    fn only(datagram: &[u8]) -> (Code, String) {
        assert_eq!(
            found(datagram, 2),
            [],
            "damage on the way is no fault of the sender"
        );
        let [finding] = &found(datagram, 3)[..] else {
            panic!("{:?}", found(datagram, 3));
        };
        (finding.code, finding.to_string())
    }

    #[test]
    fn a_checksum_that_is_computed_in_another_way_is_named() {
        let mut crc16 = datagram(ChecksumStyle::Sum16);
        let at = crc16.len() - 2;
        let sum = ChecksumStyle::Sum16.of(Sum16Variant::Crc16, &crc16[..at]);
        crc16[at..].copy_from_slice(&(sum as u16).to_be_bytes());
        let (code, line) = only(&crc16);
        assert_eq!(code, Code::DliChecksum);
        assert!(line.contains("checksum_1 = \"crc16\""), "{line}");

        for style in [
            ChecksumStyle::Sum16,
            ChecksumStyle::Sum32,
            ChecksumStyle::Crc32,
        ] {
            let mut reversed = datagram(style);
            let at = reversed.len() - style.bytes();
            reversed[at..].reverse();
            let (code, line) = only(&reversed);
            assert_eq!(code, Code::DliChecksum);
            assert!(line.contains("reverse order"), "{style:?}: {line}");
        }

        let mut other = datagram(ChecksumStyle::Sum32);
        let at = other.len() - 4;
        let crc = ChecksumStyle::Crc32.of(Sum16Variant::Sum, &other[..at]);
        other[at..].copy_from_slice(&crc.to_be_bytes());
        assert!(
            only(&other).1.contains("that of style 3"),
            "{:?}",
            only(&other)
        );

        let mut none = datagram(ChecksumStyle::Crc32);
        *none.last_mut().expect("a byte") ^= 0x55;
        assert!(only(&none).1.contains("fits no known style"));
    }

    #[test]
    fn another_edition_or_byte_order_is_named() {
        let mut edition = datagram(ChecksumStyle::None);
        edition[14] = 20;
        let (code, line) = only(&edition);
        assert!(
            code == Code::DliEdition && line.contains("IDD version 20"),
            "{line}"
        );

        let mut old = b"2.5".to_vec();
        old.resize(64, 0);
        let (code, line) = only(&old);
        assert!(
            code == Code::DliEdition && line.contains("Edition 2.5"),
            "{line}"
        );

        let mut little = datagram(ChecksumStyle::None);
        for (at, bytes) in [(2, 2), (4, 4), (8, 4), (12, 2), (14, 2)] {
            little[at..at + bytes].reverse();
        }
        let (code, line) = only(&little);
        assert!(
            code == Code::DliByteOrder && line.contains("little-endian"),
            "{line}"
        );

        let mavlink = [
            0xfd, 9, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
        ];
        let (code, line) = only(&mavlink);
        assert!(
            code == Code::DliUnreadable && line.contains("are MAVLink"),
            "{line}"
        );
        assert_eq!(only(b"hello").0, Code::DliUnreadable);
    }

    #[test]
    fn what_is_good_clears_what_was_damaged_and_time_clears_the_rest() {
        let mut evidence = DliEvidence::default();
        let fault = frames(b"").find_map(Result::err).expect("an error");
        for n in 0..5 {
            evidence.note_broken(Duration::from_secs(n), address(1), b"", &fault);
        }
        evidence.note(
            Duration::ZERO,
            address(2),
            Fault::NotListed(Id(7), Edition::Ed4, ChecksumStyle::None),
        );
        let at = |s, evidence: &DliEvidence| {
            let mut found = vec![];
            evidence.judge(Duration::from_secs(s), None, &mut found);
            found.iter().map(|one| one.code).collect::<Vec<_>>()
        };
        assert_eq!(at(5, &evidence), [Code::DliUnreadable, Code::CucsNotListed]);
        evidence.note_good(CUCS, address(3));
        assert_eq!(at(5, &evidence).len(), 2, "of another address");
        evidence.note_good(CUCS, address(1));
        assert_eq!(at(5, &evidence), [Code::CucsNotListed]);
        assert_eq!(at(299, &evidence).len(), 1);
        assert_eq!(at(300, &evidence), []);
    }

    #[test]
    fn what_cannot_be_decoded_is_named_by_type_until_one_of_the_type_can() {
        let mut evidence = DliEvidence::default();
        let now = Duration::ZERO;
        let fault = |id, of: u32| Fault::Undecodable(id, of, format!("of {of}"));
        evidence.note(now, address(1), fault(CUCS, 2016));
        evidence.note(now, address(1), fault(CUCS, 2016));
        let found = |evidence: &DliEvidence| {
            let mut found = vec![];
            evidence.judge(now, None, &mut found);
            found
        };
        assert_eq!(found(&evidence), [], "once may be damage on the way");
        // However many types another station sends: each station has its own places.
        for of in 0..100 {
            for _ in 0..3 {
                evidence.note(now, address(2), fault(VSM, of));
            }
        }
        let changed = Fault::Undecodable(CUCS, 2016, "another reason".to_owned());
        evidence.note(now, address(1), changed);
        let all = found(&evidence);
        assert_eq!(all.len(), PLACES + 1);
        let named = "message 2016 (Vehicle Operating Mode Command) from 10.0.0.1, and it is dropped: of 2016";
        assert!(all[0].cause.contains(named), "{}", all[0]);
        // A frame that can be read and a message of another type mend nothing.
        evidence.note_good(CUCS, address(1));
        evidence.note_decoded(CUCS, 16002);
        assert_eq!(found(&evidence), all);
        evidence.note_decoded(CUCS, 2016);
        assert_eq!(found(&evidence), all[1..]);
    }

    #[test]
    fn no_number_of_senders_fills_it_or_hides_another_kind() {
        let mut evidence = DliEvidence::default();
        for n in 0..10_000 {
            evidence.note(
                Duration::ZERO,
                address(1),
                Fault::NotListed(Id(n), Edition::Ed4, ChecksumStyle::None),
            );
        }
        for n in 0..100 {
            evidence.note(
                Duration::ZERO,
                address(n),
                Fault::Misaddressed(CUCS, Id(n.into())),
            );
            evidence.note(Duration::ZERO, address(1), Fault::Edition(n));
        }
        assert_eq!(evidence.seen.len(), PLACES + 2);
        let mut found = vec![];
        evidence.judge(Duration::ZERO, None, &mut found);
        assert!(found.iter().any(|one| one.code == Code::CucsMisaddressed));
    }

    #[test]
    fn a_clock_that_is_off_is_named_in_round_numbers() {
        for (ahead_ms, words) in [
            (1_400, "over 1 s ahead of"),
            (-18_000, "over 10 s behind"),
            (299_000, "over 290 s ahead of"),
            (400_000, "over 5 min ahead of"),
            (-7_300_000, "over 2 h behind"),
        ] {
            let finding = station_clock(CUCS, ahead_ms);
            assert!(finding.cause.contains(words), "{finding}");
        }
    }
}
