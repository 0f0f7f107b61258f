//! Rules that are judged from the frames that the subject has sent, whatever was played: for autopilots and stations
//! alike.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD_NO_PAD;
use conformance::verdict::{Judgement, Verdict};
use sha2::{Digest, Sha256};

use crate::bench::Seen;
use crate::catalogue::Role;
use crate::wire::{Key, STAMP_HZ, table};

/// What the judges are given.
pub struct View<'a> {
    /// Frames of the subject, in the order of time.
    pub frames: &'a [Arc<Seen>],
    /// Who is judged.
    pub role: Role,
    /// The key at the beginning of the run.
    pub key: Option<Key>,
    /// When the suite first changed keys, or restarted the subject: from then on not every frame verifies with the
    /// run's key.
    pub rekeyed: Option<Duration>,
    /// When the suite first sent times in the future: from then on the subject's timestamps may be ahead.
    pub shifted: Option<Duration>,
    /// Files of the subject.
    pub logs: &'a [PathBuf],
    /// The pass phrase of the key.
    pub phrase: Option<&'a str>,
}

/// A rule with its judge.
pub struct Judge {
    /// Rule id.
    pub rule: &'static str,
    /// Judges; returns the frames that are evidence.
    pub judge: fn(&View<'_>) -> (Judgement, Vec<Arc<Seen>>),
}

/// All judges.
pub const JUDGES: &[Judge] = &[
    Judge {
        rule: "FRAME-001",
        judge: whole_frames,
    },
    Judge {
        rule: "FRAME-008",
        judge: sequence,
    },
    Judge {
        rule: "FRAME-009",
        judge: truncation,
    },
    Judge {
        rule: "HB-001",
        judge: heartbeats,
    },
    Judge {
        rule: "SIGN-001",
        judge: time_passes,
    },
    Judge {
        rule: "SIGN-002",
        judge: rising,
    },
    Judge {
        rule: "SIGN-010",
        judge: epoch,
    },
    Judge {
        rule: "SIGN-014",
        judge: one_key,
    },
    Judge {
        rule: "SIGN-015",
        judge: all_signed,
    },
    Judge {
        rule: "SIGN-016",
        judge: key_not_shown,
    },
    Judge {
        rule: "SIGN-018",
        judge: no_plain_phrase,
    },
    Judge {
        rule: "SIGN-020",
        judge: no_replayable_log,
    },
    Judge {
        rule: "SIGN-028",
        judge: one_source,
    },
];

type Found = (Judgement, Vec<Arc<Seen>>);

fn fail(reason: impl Into<String>, seen: &[&Arc<Seen>]) -> Found {
    (
        Judgement::new(Verdict::Fail, reason),
        seen.iter().map(|seen| (*seen).clone()).collect(),
    )
}

fn pass() -> Found {
    (Judgement::pass(), Vec::new())
}

fn unseen(reason: &str) -> Found {
    (
        Judgement::new(Verdict::Inconclusive, format!("not seen: {reason}")),
        Vec::new(),
    )
}

fn lacking(reason: &str) -> Found {
    (Judgement::new(Verdict::NotApplicable, reason), Vec::new())
}

/// Frames by sequence: a sender numbers each of its links separately.
fn by_sender(frames: &[Arc<Seen>]) -> BTreeMap<(usize, u8, u8), Vec<&Arc<Seen>>> {
    let mut senders: BTreeMap<_, Vec<_>> = BTreeMap::new();
    for seen in frames {
        senders
            .entry((seen.socket, seen.frame.system, seen.frame.component))
            .or_default()
            .push(seen);
    }
    senders
}

fn whole_frames(view: &View<'_>) -> Found {
    if let Some(seen) = view.frames.iter().find(|seen| seen.frame.version == 1) {
        return fail(
            format!(
                "{} was sent as MAVLink 1; expected MAVLink 2",
                seen.frame.name()
            ),
            &[seen],
        );
    }
    if let Some(seen) = view
        .frames
        .iter()
        .find(|seen| seen.frame.crc_holds == Some(false))
    {
        return fail(
            format!("the checksum of {} does not hold", seen.frame.name()),
            &[seen],
        );
    }
    if let Some(seen) = view
        .frames
        .iter()
        .find(|seen| seen.frame.incompat & !1 != 0)
    {
        return fail(
            format!(
                "{} has the unknown incompatibility flags 0x{:02x}",
                seen.frame.name(),
                seen.frame.incompat
            ),
            &[seen],
        );
    }
    if view.frames.is_empty() {
        unseen("no frame of the subject")
    } else {
        pass()
    }
}

fn sequence(view: &View<'_>) -> Found {
    let (mut steps, mut odd) = (0, Vec::new());
    for frames in by_sender(view.frames).values() {
        for pair in frames.windows(2) {
            steps += 1;
            if pair[1].frame.seq != pair[0].frame.seq.wrapping_add(1) {
                odd.push(pair[1]);
            }
        }
    }
    if steps < 20 {
        return unseen("fewer than 20 frames in sequence");
    }
    // Lost datagrams and restarts leave single gaps; a sender that does not count leaves one at each frame.
    if odd.len() * 10 > steps {
        return fail(
            format!(
                "{} of {steps} frames do not carry the number after that of the frame before",
                odd.len()
            ),
            &odd[..odd.len().min(4)],
        );
    }
    pass()
}

fn truncation(view: &View<'_>) -> Found {
    let long = view.frames.iter().find(|seen| {
        seen.frame.version == 2
            && seen.frame.payload.len() > 1
            && seen.frame.payload.last() == Some(&0)
    });
    if let Some(seen) = long {
        return fail(
            format!(
                "{} ends with zeros, which a sender of MAVLink 2 leaves out",
                seen.frame.name()
            ),
            &[seen],
        );
    }
    let oversized = view.frames.iter().find(|seen| {
        table::by_id(seen.frame.id)
            .is_some_and(|message| seen.frame.payload.is_empty() && message.length > 0)
    });
    if let Some(seen) = oversized {
        return fail(
            format!(
                "{} has no payload; at least its first byte is sent",
                seen.frame.name()
            ),
            &[seen],
        );
    }
    if view.frames.is_empty() {
        unseen("no frame of the subject")
    } else {
        pass()
    }
}

fn heartbeats(view: &View<'_>) -> Found {
    let beats: Vec<_> = view
        .frames
        .iter()
        .filter(|seen| seen.frame.is("HEARTBEAT"))
        .cloned()
        .collect();
    if beats.is_empty() {
        return if view.frames.is_empty() {
            unseen("no frame of the subject")
        } else {
            fail("no HEARTBEAT was sent", &[])
        };
    }
    let mut judged = unseen("less than 4 s of heartbeats");
    for beats in by_sender(&beats).values() {
        let (Some(first), Some(last)) = (beats.first(), beats.last()) else {
            continue;
        };
        if last.at.saturating_sub(first.at).as_secs_f64() < 4.0 {
            continue;
        }
        let mut gaps: Vec<f64> = beats
            .windows(2)
            .map(|pair| pair[1].at.saturating_sub(pair[0].at).as_secs_f64())
            .collect();
        gaps.sort_by(f64::total_cmp);
        // Restarts make single gaps long, so the median counts.
        let median = gaps[gaps.len() / 2];
        if !(0.05..1.6).contains(&median) {
            return fail(
                format!("HEARTBEATs come every {median:.2} s; expected every second"),
                &[last],
            );
        }
        judged = pass();
    }
    judged
}

fn stamp(seen: &Seen) -> u64 {
    seen.frame.signature.map_or(0, |signature| signature.stamp)
}

fn signed<'a>(view: &'a View<'_>) -> Vec<&'a Arc<Seen>> {
    view.frames
        .iter()
        .filter(|seen| seen.frame.signature.is_some())
        .collect()
}

fn before(mut frames: Vec<&Arc<Seen>>, time: Option<Duration>) -> Vec<&Arc<Seen>> {
    frames.retain(|seen| time.is_none_or(|time| seen.at < time));
    frames
}

fn time_passes(view: &View<'_>) -> Found {
    if view.role == Role::Autopilot {
        // The suite's frames raise an autopilot's timestamps; SIGN-040 judges them while the suite is silent.
        return lacking("judged of an autopilot by SIGN-040");
    }
    let frames = signed(view);
    let (Some(first), Some(last)) = (frames.first(), frames.last()) else {
        return unseen("no signed frame of the subject");
    };
    let elapsed = last.at.saturating_sub(first.at).as_secs_f64();
    if elapsed < 4.0 {
        return unseen("less than 4 s of signed frames");
    }
    let advance = stamp(last).saturating_sub(stamp(first)) as f64 / STAMP_HZ as f64;
    if advance < elapsed * 0.5 {
        return fail(
            format!(
                "in {elapsed:.1} s the timestamps rose by {advance:.3} s: they do not follow time, and after a minute of silence the peer refuses every frame"
            ),
            &[last],
        );
    }
    pass()
}

fn rising(view: &View<'_>) -> Found {
    let mut streams: BTreeMap<_, &Arc<Seen>> = BTreeMap::new();
    let frames = before(signed(view), view.rekeyed);
    for seen in &frames {
        let signature = seen.frame.signature.map(|signature| signature.link);
        if let Some(before) = streams.insert(
            (
                seen.socket,
                seen.frame.system,
                seen.frame.component,
                signature,
            ),
            seen,
        ) && stamp(seen) <= stamp(before)
        {
            // After a restart PX4 begins with a lower timestamp: SIGN-019 judges that. It shows as a step back by
            // more than single packets.
            if view.role == Role::Autopilot && stamp(before) - stamp(seen) > STAMP_HZ / 10 {
                continue;
            }
            return fail(
                format!(
                    "the timestamp of {} is {}, that of the frame before on this stream {}: a receiver drops it as a replay",
                    seen.frame.name(),
                    stamp(seen),
                    stamp(before)
                ),
                &[before, seen],
            );
        }
    }
    if frames.len() < 2 {
        unseen("fewer than two signed frames")
    } else {
        pass()
    }
}

fn epoch(view: &View<'_>) -> Found {
    let frames = before(before(signed(view), view.shifted), view.rekeyed);
    // The last frame: PX4 begins low, and the first signed frame of its peer raises its timestamp.
    let Some(seen) = frames.last() else {
        return unseen("no signed frame of the subject");
    };
    let difference = (stamp(seen) as i64).abs_diff(seen.wall_stamp as i64) / STAMP_HZ;
    if difference > 3_600 {
        return fail(
            format!(
                "the timestamp {} is {} hours from the time of this computer; expected units of 10 us since 2015-01-01 UTC",
                stamp(seen),
                difference / 3_600
            ),
            &[seen],
        );
    }
    pass()
}

fn one_key(view: &View<'_>) -> Found {
    let Some(key) = view.key else {
        return lacking("needs the subject's signing key (--key-file)");
    };
    let frames = before(signed(view), view.rekeyed);
    let wrong = frames
        .iter()
        .find(|seen| seen.frame.verifies(&key) == Some(false));
    if let Some(seen) = wrong {
        return fail(
            format!(
                "{} is signed with another key than the one both sides have",
                seen.frame.name()
            ),
            &[seen],
        );
    }
    if frames.is_empty() {
        unseen("no signed frame of the subject")
    } else {
        pass()
    }
}

fn all_signed(view: &View<'_>) -> Found {
    if view.key.is_none() {
        return lacking("needs the subject's signing key (--key-file)");
    }
    match view
        .frames
        .iter()
        .find(|seen| seen.frame.signature.is_none())
    {
        // RADIO_STATUS is made by the radio, which has no key.
        Some(seen) if !seen.frame.is("RADIO_STATUS") => fail(
            format!(
                "{} was sent unsigned: whether signing is on cannot be told from the link",
                seen.frame.name()
            ),
            &[seen],
        ),
        _ if view.frames.is_empty() => unseen("no frame of the subject"),
        _ => pass(),
    }
}

/// The spellings in which a key may occur in a log.
fn spellings(key: &Key) -> Vec<Vec<u8>> {
    let hex = conformance::wire::hex(&key.0);
    vec![
        key.0.to_vec(),
        hex.to_uppercase().into_bytes(),
        hex.into_bytes(),
        STANDARD_NO_PAD.encode(key.0).into_bytes(),
    ]
}

fn holds(text: &[u8], wanted: &[u8]) -> bool {
    text.windows(wanted.len()).any(|window| window == wanted)
}

fn key_not_shown(view: &View<'_>) -> Found {
    if let Some(seen) = view
        .frames
        .iter()
        .find(|seen| seen.frame.is("SETUP_SIGNING"))
    {
        return fail(
            "the subject sends SETUP_SIGNING, which holds a key, over this link",
            &[seen],
        );
    }
    let Some(key) = view.key else {
        return lacking("needs the subject's signing key (--key-file)");
    };
    let spellings = spellings(&key);
    if let Some(seen) = view.frames.iter().find(|seen| {
        spellings
            .iter()
            .any(|text| holds(&seen.frame.payload, text))
    }) {
        return fail(
            format!("the payload of {} holds the signing key", seen.frame.name()),
            &[seen],
        );
    }
    for path in view.logs {
        match std::fs::read(path) {
            Ok(bytes) if spellings.iter().any(|text| holds(&bytes, text)) => {
                return fail(format!("{} holds the signing key", path.display()), &[]);
            }
            Ok(_) => {}
            Err(error) => {
                return (
                    Judgement::new(
                        Verdict::Inconclusive,
                        format!("{}: {error}", path.display()),
                    ),
                    Vec::new(),
                );
            }
        }
    }
    if view.frames.is_empty() {
        unseen("no frame of the subject")
    } else {
        pass()
    }
}

fn no_plain_phrase(view: &View<'_>) -> Found {
    let (Some(key), Some(phrase)) = (view.key, view.phrase) else {
        return lacking(
            "needs the pass phrase from which the key was made (--phrase-file), and the key",
        );
    };
    let digest: [u8; 32] = Sha256::digest(phrase.as_bytes()).into();
    if digest == key.0 {
        return fail(
            "the key is the SHA-256 of the pass phrase: every capture of the link is an offline dictionary attack",
            &[],
        );
    }
    pass()
}

fn no_replayable_log(view: &View<'_>) -> Found {
    if view.logs.is_empty() {
        return lacking("needs files of the subject: recordings (--logs)");
    }
    let sent: BTreeSet<&[u8]> = view
        .frames
        .iter()
        .filter(|seen| seen.frame.signature.is_some())
        .map(|seen| seen.frame.bytes.as_slice())
        .collect();
    for path in view.logs {
        let Ok(bytes) = std::fs::read(path) else {
            continue;
        };
        let (frames, _) = crate::wire::frame::split(&bytes);
        let found = frames
            .iter()
            .filter(|frame| frame.signature.is_some() && frame.crc_holds == Some(true))
            .count();
        if found > 0
            || frames
                .iter()
                .any(|frame| sent.contains(frame.bytes.as_slice()))
        {
            return fail(
                format!(
                    "{} holds {found} signed frames, which can be replayed: a recording clears the flag and strips the trailer",
                    path.display()
                ),
                &[],
            );
        }
    }
    pass()
}

fn one_source(view: &View<'_>) -> Found {
    let mut sources: BTreeMap<_, BTreeSet<SocketAddr>> = BTreeMap::new();
    let mut alternations = 0;
    let mut last: BTreeMap<_, SocketAddr> = BTreeMap::new();
    for seen in signed(view) {
        let stream = (
            seen.socket,
            seen.frame.system,
            seen.frame.component,
            seen.frame.signature.map(|signature| signature.link),
        );
        let known = sources.entry(stream).or_default();
        // One change of address may be a restart on a new port; two senders alternate.
        if last
            .insert(stream, seen.remote)
            .is_some_and(|before| before != seen.remote)
            && !known.insert(seen.remote)
        {
            alternations += 1;
            if alternations > 2 {
                return fail(
                    format!(
                        "one stream (system {}, component {}) comes from two addresses in turn: two senders share a key and a stream",
                        stream.1, stream.2
                    ),
                    &[seen],
                );
            }
        }
        known.insert(seen.remote);
    }
    if sources.is_empty() {
        unseen("no signed frame of the subject")
    } else {
        pass()
    }
}
