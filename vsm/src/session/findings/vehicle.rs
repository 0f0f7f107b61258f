//! What arrives on a vehicle's link in place of verified frames, and why none verifies.
//!
//! [`Arrivals`] looks at the counters of the link once in a while, which costs the frames nothing; [`judge`] makes of it at
//! most one reason why the vehicle is not received, the most specific one, and whether it receives us.

use std::collections::BTreeMap;
use std::time::Duration;

use mavlink_link::link::LinkStats;
use mavlink_link::signing::KeyId;

use super::{Code, Finding};
use crate::config::LinkAddress;

/// What became of frames, or why they were refused; the most specific one first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Unstored,
    OtherKey,
    Unsigned,
    Stale,
    Ahead,
    LinkId,
    TwoSenders,
    OtherSystem,
    Version1,
    Unreadable,
}

impl Kind {
    const ALL: [Kind; 10] = [
        Kind::Unstored,
        Kind::OtherKey,
        Kind::Unsigned,
        Kind::Stale,
        Kind::Ahead,
        Kind::LinkId,
        Kind::TwoSenders,
        Kind::OtherSystem,
        Kind::Version1,
        Kind::Unreadable,
    ];

    /// For the status.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Kind::Unstored => "signing clock not stored",
            Kind::OtherKey => "signed with another key",
            Kind::Unsigned => "not signed",
            Kind::Stale => "stale timestamps",
            Kind::Ahead => "timestamps over an hour ahead",
            Kind::LinkId => "another link id",
            Kind::TwoSenders => "from another address",
            Kind::OtherSystem => "another system",
            Kind::Version1 => "MAVLink 1",
            Kind::Unreadable => "no MAVLink 2",
        }
    }

    /// How many there were. `searched`: not signed, and signed with neither key, while the key was searched for.
    fn count(self, stats: &LinkStats, searched: (u64, u64)) -> u64 {
        match self {
            Kind::Unstored => stats.ceiling_not_stored,
            Kind::OtherKey => stats.bad_signature + searched.1,
            Kind::Unsigned => stats.unsigned_vehicle + searched.0,
            Kind::Stale => stats.stale,
            Kind::Ahead => stats.future,
            Kind::LinkId => stats.unexpected_link + stats.not_listed,
            Kind::TwoSenders => stats.wrong_peer,
            Kind::OtherSystem => stats.unexpected_system,
            Kind::Version1 => stats.mavlink1,
            Kind::Unreadable => stats.garbage_bytes + stats.bad_crc + stats.truncated,
        }
    }
}

/// What an encrypted link has counted of what arrives on it. The frames in packets that verify are counted by the link inside.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EncryptedArrivals {
    /// Packets that verified.
    pub opened: u64,
    /// Packets that did not: under other keys, changed, played again, or before keys were agreed on.
    pub refused: u64,
    /// Frames of MAVLink in the clear.
    pub plain: u64,
    /// What is no packet.
    pub noise: u64,
}

/// The most specific kind of what arrives on an encrypted link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Packets {
    Opened,
    Refused,
    Plain,
    Noise,
}

impl EncryptedArrivals {
    fn by_kind(&self) -> [(Packets, u64); 4] {
        [
            (Packets::Opened, self.opened),
            (Packets::Refused, self.refused),
            (Packets::Plain, self.plain),
            (Packets::Noise, self.noise),
        ]
    }
}

/// What has arrived, and when each kind last did.
#[derive(Debug, Default)]
pub(crate) struct Arrivals {
    counts: [u64; Kind::ALL.len()],
    last: [Option<Duration>; Kind::ALL.len()],
    packets: EncryptedArrivals,
    packets_last: [Option<Duration>; 4],
    /// How many frames each other system has sent, and when the last ones arrived.
    others: BTreeMap<u8, (u32, Duration)>,
    /// Since when this is looked at.
    began: Option<Duration>,
    datagrams: u64,
    any: Option<Duration>,
}

impl Arrivals {
    /// Looks at the counters; what they have grown by has arrived since the last look. `packets`: of an encrypted link. `others`:
    /// frames of other systems than the vehicle.
    pub(crate) fn look(
        &mut self,
        mono: Duration,
        stats: &LinkStats,
        searched: (u64, u64),
        packets: EncryptedArrivals,
        others: impl Iterator<Item = (u8, u32)>,
    ) {
        self.began.get_or_insert(mono);
        if stats.unexpected_system > self.counts[Kind::OtherSystem as usize] {
            for (system, frames) in others {
                let known = self.others.entry(system).or_default();
                if frames > known.0 {
                    *known = (frames, mono);
                }
            }
        }
        let kinds = packets.by_kind().into_iter().zip(self.packets.by_kind());
        for (index, ((_, now), (_, before))) in kinds.enumerate() {
            if now > before {
                self.packets_last[index] = Some(mono);
            }
        }
        self.packets = packets;
        for (index, kind) in Kind::ALL.into_iter().enumerate() {
            let count = kind.count(stats, searched);
            if count > self.counts[index] {
                self.last[index] = Some(mono);
            }
            // The search for a key ends with its counts.
            self.counts[index] = count;
        }
        if stats.datagrams > self.datagrams {
            (self.datagrams, self.any) = (stats.datagrams, Some(mono));
        }
    }

    /// The bridge did not run for so long, and so could not find what arrived.
    pub(crate) fn note_stop(&mut self, stopped: Duration) {
        let kinds = self.last.iter_mut().chain(&mut self.packets_last);
        let all = kinds.chain([&mut self.began, &mut self.any]);
        for at in all.flatten() {
            *at += stopped;
        }
        for (_, at) in self.others.values_mut() {
            *at += stopped;
        }
    }

    /// The most specific kind of what has arrived within [`FRESH`].
    pub(crate) fn refused(&self, mono: Duration) -> Option<Kind> {
        self.refused_within(mono, FRESH)
    }

    fn refused_within(&self, mono: Duration, span: Duration) -> Option<Kind> {
        let mut kinds = Kind::ALL.into_iter().zip(&self.last);
        let found = kinds.find(|(kind, at)| {
            let span = match kind {
                // They occur at each start, until the clocks have met: no reason of a silence after it.
                Kind::Stale | Kind::Ahead => span.min(STILL),
                _ => span,
            };
            at.is_some_and(|at| mono.saturating_sub(at) <= span)
        });
        found.map(|(kind, _)| kind)
    }

    /// Whether anything at all has arrived within [`NOTHING_FOR`]; on an encrypted link in a packet that verified.
    pub(crate) fn any(&self, mono: Duration) -> bool {
        self.any
            .is_some_and(|at| mono.saturating_sub(at) <= NOTHING_FOR)
    }

    /// Whether frames of this other system have arrived within [`NOTHING_FOR`]: the one in place of the vehicle, and not one that
    /// has sent the more of them before.
    pub(crate) fn is_sending(&self, system: u8, mono: Duration) -> bool {
        let last = self.others.get(&system).map(|(_, at)| *at);
        last.is_some_and(|at| mono.saturating_sub(at) <= NOTHING_FOR)
    }

    /// What has arrived of late on an encrypted link.
    fn packets(&self, mono: Duration) -> Option<Packets> {
        let fresh =
            |at: &Option<Duration>| at.is_some_and(|at| mono.saturating_sub(at) <= NOTHING_FOR);
        let mut kinds = self.packets.by_kind().into_iter().zip(&self.packets_last);
        kinds.find(|(_, at)| fresh(at)).map(|((kind, _), _)| kind)
    }
}

/// What is known of a link.
#[derive(Debug)]
pub(crate) struct Evidence<'a> {
    pub(crate) mono: Duration,
    pub(crate) vehicle: stanag_msgs::Id,
    pub(crate) address: &'a LinkAddress,
    pub(crate) system: u8,
    /// The key's id; `None` where signing is off.
    pub(crate) key: Option<KeyId>,
    pub(crate) arrivals: &'a Arrivals,
    /// A system that sends on the link instead of the vehicle and is not a configured vehicle of the link.
    pub(crate) other: Option<u8>,
    /// Other vehicles have the same link.
    pub(crate) shared: bool,
    /// The link is encrypted: what its agent sends of its own is no MAVLink.
    pub(crate) encrypted: bool,
    /// When a frame was last accepted.
    pub(crate) accepted: Option<Duration>,
    /// Since when frames are accepted without interruption.
    pub(crate) live_since: Option<Duration>,
    /// How old the newest frame of ours is that was answered.
    pub(crate) unanswered: Option<Duration>,
}

/// Why the vehicle is not received, or receives nothing; or what else sends in its name while it is.
pub(crate) fn judge(evidence: &Evidence<'_>) -> Option<Finding> {
    let mono = evidence.mono;
    let for_long = |at: Duration, span| mono.saturating_sub(at) > span;
    let last = evidence.accepted.or(evidence.arrivals.began)?;
    if !for_long(last, SILENT_FOR) {
        let unanswered = evidence.unanswered.filter(|age| *age > UNANSWERED);
        unanswered
            .and_then(|_| evidence.accepted.map(|_| unanswered_finding(evidence)))
            .or_else(|| unsigned_beside(evidence))
    // What arrived last is the reason until nothing has arrived for long: between the two there would be none.
    } else if let Some(kind) = (evidence.arrivals.refused(mono))
        .or_else(|| evidence.arrivals.refused_within(mono, NOTHING_FOR))
        // On a serial line each vehicle sees the frames of those beside it.
        && (kind != Kind::OtherSystem || evidence.other.is_some())
    {
        Some(refused_finding(evidence, kind))
    } else if (evidence.shared || !evidence.arrivals.any(mono)) && for_long(last, NOTHING_FOR) {
        Some(match evidence.encrypted {
            true => no_packet_finding(evidence),
            false => nothing_finding(evidence),
        })
    } else {
        None
    }
}

fn finding(
    evidence: &Evidence<'_>,
    code: Code,
    cause: impl std::fmt::Display,
    cure: impl Into<String>,
) -> Finding {
    let cause = format!("vehicle {}: {cause}", evidence.vehicle);
    Finding::new(code, evidence.vehicle, cause, cure)
}

fn refused_finding(evidence: &Evidence<'_>, kind: Kind) -> Finding {
    let (system, vehicle, link) = (evidence.system, evidence.vehicle, evidence.address);
    let key = evidence
        .key
        .map_or_else(|| "none".to_owned(), |key| key.to_string());
    match kind {
        Kind::Unstored => finding(
            evidence,
            Code::Store,
            format!(
                "frames of MAVLink system {system} verify under key {key}, but the signing clock cannot be stored: nothing is sent to the \
                 vehicle, and nothing of it believed"
            ),
            "see that the disk of [store] dir takes writes (one with faults is mounted read-only by itself: look at dmesg); with \
             store.kind = \"etcd\" that this node reaches etcd, and which node serves (\"vsm fleet list\")",
        ),
        Kind::OtherKey => finding(
            evidence,
            Code::MavlinkOtherKey,
            format!("MAVLink system {system} signs with another key than {key}"),
            format!(
                "configure the key that PX4 has as signing.key_file, or give PX4 this one (\"vsm key provision --vehicle \
                 {vehicle} --from FILE\", or --sitl-file while PX4 is off)"
            ),
        ),
        Kind::Unsigned => finding(
            evidence,
            Code::MavlinkUnsigned,
            format!("MAVLink system {system} sends unsigned, expected signatures of key {key}"),
            "PX4 has no key, or has lost it: on the ground, with \"vsm run\" stopped and nobody else on its link, \"vsm key \
             rotate --vehicle-is-unsigned\" gives it a new one; PX4 before v1.18 cannot sign"
                .to_owned(),
        ),
        Kind::Stale => finding(
            evidence,
            Code::MavlinkStale,
            format!(
                "frames of MAVLink system {system} verify under key {key}, but their timestamps stay behind"
            ),
            format!(
                "what is sent from {link} does not reach the vehicle, which would bring its timestamps up: check the way back \
                 (firewall, one-way radio, another ground station on PX4's port); or somebody plays a recording"
            ),
        ),
        Kind::Ahead => finding(
            evidence,
            Code::MavlinkAhead,
            format!(
                "frames of MAVLink system {system} verify under key {key}, but are stamped over an hour ahead of this VSM's \
                 signing clock"
            ),
            "this computer or the vehicle's started with a wrong clock: set it; check that the way back to the vehicle is open, \
             since clocks are compared over it (\"vsm key clock\" shows this end's)",
        ),
        Kind::LinkId => finding(
            evidence,
            Code::MavlinkLinkId,
            format!("MAVLink system {system} signs with another link id than expected on {link}"),
            "PX4's link was moved to another port, or frames of another link are forwarded here: remove vehicle_link_id from \
             the configuration, or correct it",
        ),
        Kind::TwoSenders => finding(
            evidence,
            Code::MavlinkTwoSenders,
            format!("frames of MAVLink system {system} arrive from another address than expected"),
            "correct the address of vehicle.link, or find out who else sends in its name: without signing the address is all \
             that counts",
        ),
        Kind::OtherSystem => {
            let other = evidence.other.unwrap_or_default();
            finding(
                evidence,
                Code::MavlinkOtherSystem,
                format!(
                    "MAVLink system {other} speaks on {link}, and system {system} is silent"
                ),
                format!(
                    "set system_id = {other} for this vehicle, or MAV_SYS_ID = {system} on PX4, whichever is wrong"
                ),
            )
        }
        Kind::Version1 => finding(
            evidence,
            Code::MavlinkVersion,
            format!("MAVLink 1 arrives on {link}, expected MAVLink 2"),
            "set MAV_PROTO_VER = 2 on PX4: MAVLink 1 cannot be signed",
        ),
        Kind::Unreadable => {
            let cure = match link {
                LinkAddress::Serial { baud, .. } => format!(
                    "the baud rate differs ({baud} is configured; SER_TEL1_BAUD or alike on PX4), or another program has the \
                     port open"
                ),
                _ => "another program sends to this port, or the sender encrypts: check who sends there".to_owned(),
            };
            finding(
                evidence,
                Code::MavlinkUnreadable,
                format!("bytes arrive on {link}, but no frame of MAVLink 2"),
                cure,
            )
        }
    }
}

/// Nothing of the vehicle arrives on an encrypted link: by what else does.
fn no_packet_finding(evidence: &Evidence<'_>) -> Finding {
    let link = evidence.address;
    let (code, cause, cure) = match evidence.arrivals.packets(evidence.mono) {
        Some(Packets::Opened) => (
            Code::MavlinkNone,
            format!("the agent's packets open on {link}, and no MAVLink of the vehicle is in them"),
            "the agent is reached, and lacks PX4's MAVLink, or the key of it: see \"vsm airside status\" on its computer",
        ),
        Some(Packets::Refused) => (
            Code::MavlinkUnreadable,
            format!("encrypted packets arrive on {link}, and none of them opens"),
            "another agent than the paired one sends there, or one whose pairing is lost, or somebody plays a recording: \"vsm status\" counts \
             them by reason; pair again where one end was installed again (\"vsm airside pair\", \"vsm pair\")",
        ),
        Some(Packets::Plain) => (
            Code::MavlinkUnreadable,
            format!("MAVLink in the clear arrives on {link}, which is encrypted"),
            "set encrypt = true in [radio] of the agent, or find out who else sends there, such as PX4 itself beside the agent",
        ),
        Some(Packets::Noise) => (
            Code::MavlinkUnreadable,
            format!("bytes arrive on {link}, and no packet of an encrypted link"),
            "another program sends there, or the baud rate of a serial line differs",
        ),
        None => (
            Code::MavlinkNone,
            format!("nothing at all arrives on {link}, which is encrypted"),
            "check the link to the agent, and that \"vsm airside\" runs on its computer",
        ),
    };
    finding(evidence, code, cause, cure)
}

fn nothing_finding(evidence: &Evidence<'_>) -> Finding {
    let link = evidence.address;
    let cure = match link {
        LinkAddress::UdpIn(at) => format!(
            "have the vehicle send to this computer, port {} (PX4: \"mavlink start -u PORT -t ADDRESS -o {}\"); check a firewall; \
             a vehicle that waits itself needs link = \"udpout:HOST:PORT\"",
            at.port(),
            at.port()
        ),
        LinkAddress::UdpOut(_) => {
            "check host and port, and that PX4 runs; a vehicle that sends by itself needs link = \"udpin:ADDRESS:PORT\""
                .to_owned()
        }
        LinkAddress::Serial { .. } => {
            "check the cable (RX to TX) and that PX4 has MAVLink on that port (MAV_1_CONFIG or alike)".to_owned()
        }
    };
    let cause = match evidence.accepted {
        _ if evidence.shared => {
            format!(
                "no frame of MAVLink system {} arrives on {link}",
                evidence.system
            )
        }
        Some(_) => format!("data no longer arrives on {link}"),
        None => format!("no MAVLink at all arrives on {link}"),
    };
    finding(evidence, Code::MavlinkNone, cause, cure)
}

fn unanswered_finding(evidence: &Evidence<'_>) -> Finding {
    let (system, link) = (evidence.system, evidence.address);
    finding(
        evidence,
        Code::MavlinkUnanswered,
        format!("MAVLink system {system} is received, but has received nothing from {link}"),
        "check the way to the vehicle: firewall, one-way radio, another key or another ground station's address in PX4",
    )
}

/// That something else sends unsigned frames in the name of a vehicle whose own verify. Anybody can send them, so nobody is
/// alerted, and the finding stands for long after the last one: it cannot be made to come and go.
fn unsigned_beside(evidence: &Evidence<'_>) -> Option<Finding> {
    let at = evidence.arrivals.last[Kind::Unsigned as usize]?;
    // A vehicle that is given its key may have sent unsigned until then.
    let beside = at >= evidence.live_since? + SILENT_FOR;
    let fresh = evidence.mono.saturating_sub(at) <= BESIDE_FOR;
    let system = evidence.system;
    (beside && fresh).then(|| {
        finding(
            evidence,
            Code::MavlinkUnsignedBeside,
            format!(
                "MAVLink system {system} is received and its signatures verify, and something else sends unsigned frames as system {system}"
            ),
            format!(
                "they are refused, and its key is not lost; look for another PX4 with MAV_SYS_ID = {system}, a gimbal or camera of this vehicle \
                 that does not sign, or somebody who forges them (\"vsm status\" counts them: not signed)"
            ),
        )
    })
}

/// That a vehicle reports its state no more, where [`judge`] has no reason for it. The alert for that stands by itself: this
/// is for who asks, so that the answer is the one that the log has given.
pub(crate) fn silent(evidence: &Evidence<'_>) -> Option<Finding> {
    let accepted = evidence.accepted?;
    let age_s = evidence.mono.saturating_sub(accepted).as_secs();
    let (cause, cure) = match age_s {
        0..=2 => (
            "frames arrive, but none has its mode or is its HEARTBEAT: its state is unknown"
                .to_owned(),
            "check which messages PX4 sends on this link, and that the radio is not overloaded (\"vsm status\": lost)",
        ),
        _ => (
            format!("no frame of it for {age_s} s: its state is unknown"),
            "check its power, the radio and the distance; run this again in some seconds, when it is known what arrives instead",
        ),
    };
    Some(finding(evidence, Code::MavlinkSilent, cause, cure))
}

/// How fresh a kind must be to be the reason; looks at the counters are up to a second apart, and a heartbeat may be lost.
pub(crate) const FRESH: Duration = Duration::from_secs(4);
/// How fresh one must be that says what arrives now: two looks.
const STILL: Duration = Duration::from_secs(2);
/// How long nothing must have been accepted: a vehicle that has just started is lifted within a second or two.
const SILENT_FOR: Duration = Duration::from_secs(5);
/// How long nothing at all must have arrived.
const NOTHING_FOR: Duration = Duration::from_secs(10);
/// How long after the last unsigned frame beside verified ones that is a finding.
const BESIDE_FOR: Duration = Duration::from_secs(600);
/// How long the vehicle must have answered nothing.
const UNANSWERED: Duration = Duration::from_secs(10);

#[cfg(test)]
mod tests {
    use super::*;

    fn seconds(s: u64) -> Duration {
        Duration::from_secs(s)
    }

    fn look(arrivals: &mut Arrivals, at_s: u64, stats: &LinkStats) {
        let (packets, others) = (EncryptedArrivals::default(), std::iter::empty());
        arrivals.look(seconds(at_s), stats, (0, 0), packets, others);
    }

    static ADDRESS: LinkAddress = LinkAddress::UdpIn(std::net::SocketAddr::V4(
        std::net::SocketAddrV4::new(std::net::Ipv4Addr::LOCALHOST, 14_550),
    ));

    /// A vehicle on a link of its own, last accepted at this second.
    fn evidence(arrivals: &Arrivals, at_s: u64, accepted: Option<u64>) -> Evidence<'_> {
        Evidence {
            mono: seconds(at_s),
            vehicle: stanag_msgs::Id(0x1b00_0101),
            address: &ADDRESS,
            system: 7,
            key: None,
            arrivals,
            other: None,
            shared: false,
            encrypted: false,
            accepted: accepted.map(seconds),
            live_since: accepted.map(|_| seconds(0)),
            unanswered: None,
        }
    }

    /// The finding 30 s after the start, where these counters have grown a second before.
    fn found(grown: impl FnOnce(&mut LinkStats), accepted: Option<u64>) -> Option<Finding> {
        let mut stats = LinkStats::default();
        let mut arrivals = Arrivals::default();
        look(&mut arrivals, 1, &stats);
        grown(&mut stats);
        look(&mut arrivals, 29, &stats);
        judge(&Evidence {
            other: Some(1),
            ..evidence(&arrivals, 30, accepted)
        })
    }

    fn code(grown: impl FnOnce(&mut LinkStats)) -> Option<Code> {
        found(grown, None).map(|finding| finding.code)
    }

    #[test]
    fn each_kind_has_its_finding_and_the_most_telling_one_is_named() {
        assert_eq!(code(|_| {}), Some(Code::MavlinkNone));
        assert_eq!(code(|s| s.datagrams = 1), None);
        for (grown, expected) in [
            (
                (|s: &mut LinkStats| s.bad_signature = 1) as fn(&mut LinkStats),
                Code::MavlinkOtherKey,
            ),
            (|s| s.ceiling_not_stored = 1, Code::Store),
            (|s| s.unsigned_vehicle = 1, Code::MavlinkUnsigned),
            (|s| s.stale = 1, Code::MavlinkStale),
            (|s| s.future = 1, Code::MavlinkAhead),
            (|s| s.unexpected_link = 1, Code::MavlinkLinkId),
            (|s| s.wrong_peer = 1, Code::MavlinkTwoSenders),
            (|s| s.unexpected_system = 1, Code::MavlinkOtherSystem),
            (|s| s.mavlink1 = 1, Code::MavlinkVersion),
            (|s| s.garbage_bytes = 40, Code::MavlinkUnreadable),
        ] {
            assert_eq!(code(grown), Some(expected));
            // A ground station on the same port is not what keeps the vehicle out.
            let both = |s: &mut LinkStats| {
                grown(s);
                s.garbage_bytes = 40;
            };
            assert_eq!(code(both), Some(expected));
        }
    }

    #[test]
    fn a_vehicle_that_is_received_has_no_finding_whatever_else_arrives() {
        assert_eq!(found(|s| s.bad_signature = 9, Some(28)), None);
        assert!(found(|s| s.bad_signature = 9, Some(20)).is_some());
    }

    #[test]
    fn unsigned_frames_beside_verified_ones_are_a_finding_of_their_own_that_stands_for_long() {
        let beside = found(|s| s.unsigned_vehicle = 9, Some(28)).expect("a finding");
        assert_eq!(beside.code, Code::MavlinkUnsignedBeside);
        assert!(
            beside.to_string().contains("its key is not lost"),
            "{beside}"
        );
        let (mut stats, mut arrivals) = (LinkStats::default(), Arrivals::default());
        look(&mut arrivals, 1, &stats);
        stats.unsigned_vehicle = 1;
        look(&mut arrivals, 20, &stats);
        let at = |now_s, live_s| {
            judge(&Evidence {
                live_since: Some(seconds(live_s)),
                ..evidence(&arrivals, now_s, Some(now_s))
            })
        };
        // The vehicle's own, from before it had its key.
        assert_eq!(at(30, 18), None);
        assert_eq!(at(30, 25), None);
        // However seldom one comes, it does not come and go with it.
        let first = at(20, 10).expect("a finding");
        assert_eq!(at(600, 10), Some(first));
        assert_eq!(at(621, 10), None);
    }

    /// A vehicle that falls silent, and another program's bytes a moment later: from the first second in which it counts as
    /// silent on, there is always an answer why.
    #[test]
    fn there_is_no_second_of_a_silence_without_a_finding() {
        for burst_at in [None, Some(21), Some(24), Some(29)] {
            let mut stats = LinkStats::default();
            let mut arrivals = Arrivals::default();
            let mut codes = Vec::new();
            for at in 1..60 {
                // Its last frame is that of 20 s.
                stats.datagrams += u64::from(at <= 20 || burst_at == Some(at));
                stats.garbage_bytes += if burst_at == Some(at) { 40 } else { 0 };
                look(&mut arrivals, at, &stats);
                let evidence = evidence(&arrivals, at, Some(at.min(20)));
                if at >= 22 {
                    let found = judge(&evidence).or_else(|| silent(&evidence));
                    let found = found.unwrap_or_else(|| panic!("{burst_at:?}: nothing at {at} s"));
                    codes.push(found.code);
                } else {
                    assert_eq!(judge(&evidence), None, "{at} s");
                }
            }
            let named = codes.contains(&Code::MavlinkUnreadable);
            assert_eq!(named, burst_at.is_some(), "{burst_at:?}");
            assert_eq!(codes.last(), Some(&Code::MavlinkNone));
        }
    }

    #[test]
    fn timestamps_that_were_behind_before_a_silence_are_not_its_reason() {
        for still in [false, true] {
            let mut stats = LinkStats::default();
            let mut arrivals = Arrivals::default();
            let mut codes = Vec::new();
            for at in 1..40 {
                // The last accepted frame is that of 20 s.
                let behind = (17..20).contains(&at) || (still && at > 20);
                stats.datagrams += u64::from(at <= 20 || behind);
                stats.stale += u64::from(behind);
                look(&mut arrivals, at, &stats);
                let found = judge(&evidence(&arrivals, at, Some(at.min(20))));
                codes.extend(found.map(|one| one.code));
            }
            assert_eq!(codes.contains(&Code::MavlinkStale), still, "{codes:?}");
            assert_eq!(codes.contains(&Code::MavlinkNone), !still, "{codes:?}");
        }
    }

    #[test]
    fn of_an_encrypted_link_the_cause_is_what_was_counted() {
        let mut packets = EncryptedArrivals::default();
        let mut arrivals = Arrivals::default();
        let mut found = |at_s: u64, grown: fn(&mut EncryptedArrivals)| {
            grown(&mut packets);
            let stats = LinkStats::default();
            arrivals.look(seconds(at_s), &stats, (0, 0), packets, std::iter::empty());
            let finding = judge(&Evidence {
                encrypted: true,
                ..evidence(&arrivals, at_s + 1, None)
            });
            finding.map(|finding| (finding.code, finding.cause))
        };
        assert_eq!(found(1, |_| {}), None);
        for (at_s, grown, code, words) in [
            (
                30,
                (|_| {}) as fn(&mut EncryptedArrivals),
                Code::MavlinkNone,
                "nothing at all arrives on",
            ),
            (
                50,
                |one| one.noise += 1,
                Code::MavlinkUnreadable,
                "no packet of an encrypted link",
            ),
            (
                70,
                |one| one.plain += 1,
                Code::MavlinkUnreadable,
                "MAVLink in the clear",
            ),
            (
                90,
                |one| one.refused += 1,
                Code::MavlinkUnreadable,
                "none of them opens",
            ),
            (
                110,
                |one| (one.opened, one.refused) = (1, 9),
                Code::MavlinkNone,
                "no MAVLink of the vehicle is in them",
            ),
            // What was before is none of now.
            (130, |_| {}, Code::MavlinkNone, "nothing at all arrives on"),
        ] {
            let (found, cause) = found(at_s, grown).expect(words);
            assert_eq!(found, code, "{cause}");
            assert!(cause.contains(words), "{cause}");
            assert!(!cause.contains("no MAVLink at all"), "{cause}");
        }
    }

    /// A system that sent for hours, and is gone, is not the one in place of the vehicle.
    #[test]
    fn only_a_system_that_sends_now_is_named_in_place_of_the_vehicle() {
        let (mut stats, mut arrivals) = (LinkStats::default(), Arrivals::default());
        let mut look = |at_s, others: &[(u8, u32)]| {
            stats.unexpected_system = others.iter().map(|(_, n)| u64::from(*n)).sum();
            let others = others.iter().copied();
            let packets = EncryptedArrivals::default();
            arrivals.look(seconds(at_s), &stats, (0, 0), packets, others);
            [1, 3].map(|system| arrivals.is_sending(system, seconds(at_s)))
        };
        assert_eq!(look(1, &[(1, 5_000)]), [true, false]);
        assert_eq!(look(100, &[(1, 5_000), (3, 1)]), [false, true]);
        assert_eq!(look(105, &[(1, 5_000), (3, 1)]), [false, true]);
        assert_eq!(look(200, &[(1, 5_000), (3, 1)]), [false, false]);
    }

    #[test]
    fn another_system_is_named_with_both_ways_to_cure_it() {
        let finding = found(|s| s.unexpected_system = 3, None).expect("a finding");
        let line = finding.to_string();
        assert!(line.contains("system 1 speaks"), "{line}");
        assert!(line.contains("system_id = 1"), "{line}");
        assert!(line.contains("MAV_SYS_ID = 7"), "{line}");
    }
}
