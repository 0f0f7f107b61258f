//! SIGN: what a signed receiver must drop, and what it must still accept. The hash is computed here, with `sha2`
//! alone, so that no mistake is shared with the judged code.

use std::sync::Arc;
use std::time::Duration;

use conformance::means::shell;
use conformance::verdict::{Judged, Precondition, Stop};
use conformance::wire::Direction;

use crate::bench::peer::station_heartbeat;
use crate::bench::trial::Probe;
use crate::bench::{Peer, Port, Seen, Trial};
use crate::scene::Scene;
use crate::wire::{Draft, Key, STAMP_HZ, wall_stamp};

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "SIGN-030",
        play: unsigned,
    },
    Scene {
        rule: "SIGN-031",
        play: wrong_signature,
    },
    Scene {
        rule: "SIGN-035",
        play: zero_key,
    },
    Scene {
        rule: "SIGN-033",
        play: version_one,
    },
    Scene {
        rule: "SIGN-036",
        play: unsigned_setting,
    },
    Scene {
        rule: "SIGN-029",
        play: link_id_under_the_hash,
    },
    Scene {
        rule: "SIGN-003",
        play: replays,
    },
    Scene {
        rule: "SIGN-004",
        play: overtaken,
    },
    Scene {
        rule: "SIGN-005",
        play: replay_on_the_other_link,
    },
    Scene {
        rule: "SIGN-006",
        play: two_copies_at_once,
    },
    Scene {
        rule: "SIGN-009",
        play: signed_wrong_checksum,
    },
    Scene {
        rule: "SIGN-013",
        play: forged_future,
    },
    Scene {
        rule: "SIGN-034",
        play: old_new_stream,
    },
    Scene {
        rule: "SIGN-037",
        play: peer_ahead,
    },
    Scene {
        rule: "SIGN-021",
        play: stranger,
    },
    Scene {
        rule: "SIGN-022",
        play: own_identity,
    },
    Scene {
        rule: "SIGN-026",
        play: own_command,
    },
    Scene {
        rule: "SIGN-024",
        play: forwarded_stranger,
    },
    Scene {
        rule: "SIGN-008",
        play: badly_signed_heartbeat,
    },
    Scene {
        rule: "SIGN-011",
        play: system_time,
    },
    Scene {
        rule: "SIGN-040",
        play: stamps_follow_time,
    },
    Scene {
        rule: "SIGN-019",
        play: replay_after_restart,
    },
    Scene {
        rule: "SIGN-032",
        play: stranger_first,
    },
    Scene {
        rule: "SIGN-007",
        play: many_streams,
    },
    Scene {
        rule: "SIGN-012",
        play: year_ahead,
    },
];

/// A request, and what answers it.
type Request = (&'static str, Draft, fn(&Seen) -> bool);

/// Requests of each protocol.
fn requests(t: &Trial<'_>) -> Vec<Request> {
    let subject = t.bench.subject;
    vec![
        (
            "PARAM_REQUEST_READ",
            Draft::new("PARAM_REQUEST_READ")
                .to(subject)
                .set("param_index", 0),
            |seen| seen.frame.is("PARAM_VALUE"),
        ),
        (
            "COMMAND_LONG",
            Draft::new("COMMAND_LONG")
                .to(subject)
                .set("command", 512)
                .set("param1", 148),
            |seen| seen.frame.is("COMMAND_ACK") && seen.frame.int("command") == 512,
        ),
        (
            "COMMAND_INT",
            Draft::new("COMMAND_INT")
                .to(subject)
                .set("command", 512)
                .set("param1", 148),
            |seen| seen.frame.is("COMMAND_ACK") && seen.frame.int("command") == 512,
        ),
        (
            "MISSION_REQUEST_LIST",
            Draft::new("MISSION_REQUEST_LIST").to(subject),
            |seen| seen.frame.is("MISSION_COUNT"),
        ),
    ]
}

/// Fails where a request of any protocol is answered although `change` has made its signature wrong.
fn all_refused(
    t: &Trial<'_>,
    what: &str,
    change: impl Fn(&mut crate::wire::Craft) + Copy,
) -> Judged {
    t.key()?;
    t.refuses(what, change)?;
    for (name, draft, answers) in requests(t) {
        let (mark, _) = t.peer.send_with(&draft, change);
        let answer = t.peer.wait(mark, t.quiet(), |seen| {
            (seen.frame.system, seen.frame.component) == t.bench.subject && answers(seen)
        });
        t.expect_none(answer, |answer| {
            format!(
                "expected no answer to {name} as {what}; the subject answered with {}",
                answer.frame.name()
            )
        })?;
    }
    t.alive()
}

fn unsigned(t: &Trial<'_>) -> Judged {
    all_refused(t, "an unsigned frame", |craft| craft.key = None)
}

fn wrong_signature(t: &Trial<'_>) -> Judged {
    let key = t.key()?;
    all_refused(t, "a frame signed with another key", |craft| {
        craft.key = Some(Key(key.0.map(|byte| byte ^ 0x5A)))
    })?;
    t.refuses("a frame with one bit of its signature wrong", |craft| {
        craft.hash_flip = 0x10
    })?;
    t.refuses("a signed frame whose payload was changed", |craft| {
        craft.signed_link = Some(craft.link ^ 0x40)
    })
}

fn zero_key(t: &Trial<'_>) -> Judged {
    t.key()?;
    t.refuses("a frame signed with a key of zeros", |craft| {
        craft.key = Some(Key([0; 32]))
    })
}

fn version_one(t: &Trial<'_>) -> Judged {
    t.key()?;
    t.alive()?;
    let draft = Draft::new("PARAM_REQUEST_READ")
        .to(t.bench.subject)
        .set("param_index", 0);
    let mut craft = t.peer.craft(&draft).untruncated();
    craft.key = None;
    let payload = craft.payload.clone();
    let mut bytes = vec![
        crate::wire::frame::MAGIC_V1,
        payload.len() as u8,
        craft.seq,
        craft.system,
        craft.component,
        craft.id as u8,
    ];
    bytes.extend(&payload);
    let sum = crate::wire::crc(bytes[1..].iter().copied().chain([craft.crc_extra]));
    bytes.extend(sum.to_le_bytes());
    let mark = t.peer.send_bytes(&bytes);
    let answer = t
        .peer
        .wait(mark, t.quiet(), |seen| seen.frame.is("PARAM_VALUE"));
    t.expect_none(answer, |_| {
        "expected no answer to a MAVLink 1 frame, which cannot be signed; the subject answered"
            .into()
    })?;
    t.alive()
}

fn unsigned_setting(t: &Trial<'_>) -> Judged {
    t.key()?;
    t.alive()?;
    let any = Draft::new("PARAM_REQUEST_READ")
        .to(t.bench.subject)
        .set("param_index", 0);
    let answer = t
        .peer
        .request(&any, t.answer(), "PARAM_VALUE", |seen| {
            seen.frame.is("PARAM_VALUE")
        })
        .precondition("a parameter can be read")?;
    let (name, kind, old) = (
        answer.frame.text("param_id"),
        answer.frame.int("param_type"),
        answer.frame.float("param_value"),
    );
    // The lowest bit of the value: no autopilot behaves differently until it is restored.
    let new = old.to_bits() ^ 1;
    let set = Draft::new("PARAM_SET")
        .to(t.bench.subject)
        .text("param_id", &name)
        .bits("param_value", new.into())
        .set("param_type", kind as f64);
    let (mark, _) = t.peer.send_with(&set, |craft| craft.key = None);
    t.peer
        .wait(mark, t.quiet(), |seen| seen.frame.is("PARAM_VALUE"));
    let after = super::param::value(t, &name)?;
    if after.frame.float("param_value").to_bits() == new {
        t.peer.send(&set.bits("param_value", old.to_bits().into()));
        t.cite(&after);
        return Err(Stop::fail(format!(
            "an unsigned PARAM_SET has changed {name}"
        )));
    }
    Ok(())
}

fn link_id_under_the_hash(t: &Trial<'_>) -> Judged {
    t.key()?;
    t.refuses(
        "a frame whose link id was changed after it was signed",
        |craft| {
            craft.signed_link = Some(craft.link);
            craft.link ^= 0x21;
        },
    )
}

/// Sends honest probes and keeps their bytes; fails unless all are answered.
fn answered_probes(t: &Trial<'_>, peer: &Peer, count: usize) -> Judged<Vec<(Vec<u8>, u32)>> {
    let mut kept = Vec::new();
    for _ in 0..count {
        let mut answered = false;
        for _ in 0..3 {
            let (draft, number) = t.probe();
            let (mark, bytes) = peer.send_with(&draft, |_| {});
            if t.answered(peer, mark, number, t.answer()).is_some() {
                kept.push((bytes, number));
                answered = true;
                break;
            }
        }
        if !answered {
            return Err(Stop::inconclusive(
                "the subject does not answer an honest request of the suite",
            ));
        }
    }
    Ok(kept)
}

fn replays(t: &Trial<'_>) -> Judged {
    t.key()?;
    let kept = answered_probes(t, &t.peer, 3)?;
    // The latest first: a receiver that stores only the first timestamp of a stream accepts all but the first again.
    for (which, (bytes, number)) in ["first", "second", "third"].into_iter().zip(&kept).rev() {
        let mark = t.peer.send_bytes(bytes);
        t.expect_none(t.answered(&t.peer, mark, *number, t.quiet()), |_| {
            format!(
                "the {which} of three requests was sent again, byte by byte, and answered again: a \
                 replay is taken"
            )
        })?;
    }
    t.alive()
}

fn overtaken(t: &Trial<'_>) -> Judged {
    t.key()?;
    t.alive()?;
    let ((late, late_number), (early, _)) = (t.probe(), t.probe());
    let mark = t.bench.net.mark();
    {
        let _held = t.bench.net.hold();
        let first = t.peer.craft(&late).bytes();
        let second = t.peer.craft(&early).bytes();
        t.peer.send_bytes(&second);
        std::thread::sleep(Duration::from_millis(30));
        t.peer.send_bytes(&first);
    }
    if t.bench.probe == Probe::Command {
        return Err(Stop::inconclusive(
            "the subject answers neither TIMESYNC nor PING: which of two frames it answered cannot be seen",
        ));
    }
    t.expect_none(t.answered(&t.peer, mark, late_number, t.quiet()), |_| {
        "a frame whose timestamp is older than the last one of its stream was answered: a window \
         for replays"
            .into()
    })?;
    t.alive()
}

/// The answers to a probe, on whatever port they came.
fn answers_anywhere(t: &Trial<'_>, mark: usize, number: u32) -> usize {
    let mut remotes: Vec<_> = t.from_subject(mark, |seen| {
        seen.direction == Direction::Received && t.bench.probe.is_answer(number, seen)
    });
    // A broadcast answer is sent on every link: it counts once.
    remotes.dedup_by_key(|seen| seen.frame.payload.clone());
    remotes.len()
}

fn second(t: &Trial<'_>) -> Judged<Arc<Port>> {
    t.bench
        .second
        .clone()
        .ok_or_else(|| Stop::not_applicable("needs a second link of the subject (--second)"))
}

fn replay_on_the_other_link(t: &Trial<'_>) -> Judged {
    t.key()?;
    let other = t.peer.on(&second(t)?);
    let kept = answered_probes(t, &t.peer, 1)?;
    let Some((bytes, number)) = kept.first() else {
        return Err(Stop::inconclusive("nothing to replay"));
    };
    let mark = other.send_bytes(bytes);
    t.pause(t.quiet())?;
    t.expect(answers_anywhere(t, mark, *number) == 0, || "a frame of one link was sent again on the other and answered: a capture of one link works on all".into())?;
    t.alive()
}

fn two_copies_at_once(t: &Trial<'_>) -> Judged {
    t.key()?;
    t.alive()?;
    if t.bench.probe == Probe::Command {
        return Err(Stop::inconclusive(
            "the subject answers neither TIMESYNC nor PING: answers cannot be told apart",
        ));
    }
    let remote = t
        .bench
        .port
        .remote()
        .ok_or_else(|| Stop::inconclusive("the subject has no address yet"))?;
    let other = match &t.bench.second {
        Some(second) => second.clone(),
        None => Arc::new(
            Port::to(&t.bench.net, remote)
                .map_err(|error| Stop::inconclusive(format!("no socket: {error}")))?,
        ),
    };
    let mut doubled = 0;
    for _ in 0..25 {
        let (draft, number) = t.probe();
        let mark = t.bench.net.mark();
        {
            let _held = t.bench.net.hold();
            let bytes = t.peer.craft(&draft).bytes();
            std::thread::scope(|scope| {
                scope.spawn(|| other.send(&bytes));
                t.peer.port.send(&bytes);
            });
        }
        t.pause(Duration::from_millis(30).mul_f64(t.bench.factor))?;
        doubled += usize::from(answers_anywhere(t, mark, number) > 1);
    }
    t.expect(doubled == 0, || format!("of 25 frames that were sent twice at the same time {doubled} were answered twice: both copies passed the replay check"))?;
    t.alive()
}

fn signed_wrong_checksum(t: &Trial<'_>) -> Judged {
    t.key()?;
    t.refuses(
        "a frame with a wrong checksum and a signature that is right over it",
        |craft| craft.crc_flip = 0x0101,
    )
}

fn forged_future(t: &Trial<'_>) -> Judged {
    t.key()?;
    t.alive()?;
    for _ in 0..3 {
        let (draft, _) = t.probe();
        t.peer.send_with(&draft, |craft| {
            craft.stamp += 3600 * STAMP_HZ;
            craft.hash_flip = 0xFF;
        });
    }
    t.expect(t.answers(&t.peer), || {
        "frames with a wrong signature and a timestamp an hour ahead were sent in the name of a station; since then the honest station is not answered".into()
    })
}

fn old_new_stream(t: &Trial<'_>) -> Judged {
    t.key()?;
    t.alive()?;
    let old = t.peer.with_link(71);
    let (draft, number) = t.probe();
    let (mark, _) = old.send_with(&draft, |craft| {
        craft.stamp = craft.stamp.saturating_sub(120 * STAMP_HZ)
    });
    t.expect_none(t.answered(&old, mark, number, t.quiet()), |_| {
        "a new stream that begins two minutes in the past was answered: the limit is 60 s".into()
    })?;
    t.alive()
}

fn peer_ahead(t: &Trial<'_>) -> Judged {
    t.key()?;
    t.alive()?;
    // ArduPilot's timestamps run minutes ahead: a peer that is ahead must not be refused.
    let ahead = t.peer.with_link(72);
    let (draft, number) = t.probe();
    let (mark, _) = ahead.send_with(&draft, |craft| craft.stamp += 30 * STAMP_HZ);
    t.expect(
        t.answered(&ahead, mark, number, t.answer()).is_some(),
        || "a new stream that begins 30 s ahead is not answered".into(),
    )?;
    t.expect(t.answers(&t.peer), || {
        "after a stream that is 30 s ahead the station with the right time is not answered".into()
    })
}

fn stranger(t: &Trial<'_>) -> Judged {
    t.key()?;
    t.alive()?;
    let remote = t
        .bench
        .port
        .remote()
        .ok_or_else(|| Stop::inconclusive("the subject has no address yet"))?;
    let port = Arc::new(
        Port::to(&t.bench.net, remote)
            .map_err(|error| Stop::inconclusive(format!("no socket: {error}")))?,
    );
    let forger = t.peer.on(&port);
    let kept = answered_probes(t, &t.peer, 1)?;
    // The honest station is silent meanwhile: a subject that sends to whoever sent last would otherwise return to it
    // at once.
    t.bench
        .paused
        .store(true, std::sync::atomic::Ordering::SeqCst);
    // Unsigned, wrongly signed, replayed, and no frame at all.
    forger.send_with(&station_heartbeat(), |craft| craft.key = None);
    forger.send_with(&station_heartbeat(), |craft| craft.hash_flip = 1);
    for (bytes, _) in &kept {
        forger.send_bytes(bytes);
    }
    forger.send_bytes(b"no frame");
    let paused = t.pause(t.quiet());
    let mark = t.bench.net.mark();
    let own = t.bench.subject;
    let deadline = t.bench.net.now() + t.seconds(2.5);
    let telemetry = t.bench.net.wait(mark, deadline, |seen| {
        seen.direction == Direction::Received
            && seen.socket == t.peer.port.number
            && (seen.frame.system, seen.frame.component) == own
    });
    resume(t);
    paused?;
    t.expect(telemetry.is_some() && t.answers(&t.peer), || {
        "after datagrams of a stranger that verify under no key, telemetry and answers do not reach the honest station: the peer was stolen".into()
    })
}

fn own_identity(t: &Trial<'_>) -> Judged {
    t.key()?;
    t.alive()?;
    let (system, component) = t.bench.subject;
    let mirror = Peer::new(&t.bench.net, &t.bench.port, (system, component), 73);
    // Its own frames are sent back to it.
    let frames = t.from_subject(t.bench.net.mark().saturating_sub(200), |seen| {
        seen.socket == t.peer.port.number
    });
    for seen in frames.iter().rev().take(20).rev() {
        mirror.send_bytes(&seen.frame.bytes);
    }
    let draft = Draft::new("PARAM_REQUEST_READ")
        .to(t.bench.subject)
        .set("param_index", 0);
    let mark = mirror.send(&draft);
    t.pause(t.quiet())?;
    let answer = t
        .from_subject(mark, |seen| seen.frame.is("PARAM_VALUE"))
        .first()
        .cloned();
    t.expect_none(answer, |_| {
        "a signed request in the subject's own name was answered: what it sends may come back to \
         it and verify"
            .into()
    })?;
    t.expect(t.answers(&t.peer), || {
        "after its own frames came back to it the subject answers honest frames no more".into()
    })
}

fn own_command(t: &Trial<'_>) -> Judged {
    t.key()?;
    t.alive()?;
    let (system, component) = t.bench.subject;
    let mirror = Peer::new(&t.bench.net, &t.bench.port, (system, component), 73);
    let mark = mirror.send(
        &Draft::new("COMMAND_LONG")
            .to(t.bench.subject)
            .set("command", 512)
            .set("param1", 148),
    );
    t.pause(t.quiet())?;
    let answer = t
        .from_subject(mark, |seen| {
            seen.frame.is("COMMAND_ACK") && seen.frame.int("command") == 512
        })
        .first()
        .cloned();
    t.expect_none(answer, |_| {
        "a signed command in the subject's own name, system and component, was carried out".into()
    })?;
    t.alive()
}

fn forwarded_stranger(t: &Trial<'_>) -> Judged {
    t.key()?;
    t.alive()?;
    let other = second(t)?;
    let foreign = Peer::new(&t.bench.net, &t.bench.port, (201, 1), 0);
    let seen_there = |mark: usize| {
        t.bench
            .net
            .all(mark, |seen| {
                seen.direction == Direction::Received
                    && seen.socket == other.number
                    && seen.frame.system == 201
            })
            .first()
            .cloned()
    };
    let vehicle = Draft::new("HEARTBEAT")
        .set("type", 2)
        .set("autopilot", 12)
        .set("mavlink_version", 3);
    for (what, change) in [
        (
            "unsigned",
            (|craft| craft.key = None) as fn(&mut crate::wire::Craft),
        ),
        ("badly signed", |craft| craft.hash_flip = 1),
    ] {
        let (mark, _) = foreign.send_with(&vehicle, change);
        t.pause(t.quiet())?;
        t.expect_none(seen_there(mark), |_| {
            format!("a stranger's {what} HEARTBEAT was forwarded to the other link")
        })?;
    }
    t.alive()
}

fn badly_signed_heartbeat(t: &Trial<'_>) -> Judged {
    t.key()?;
    t.alive()?;
    t.bench
        .paused
        .store(true, std::sync::atomic::Ordering::SeqCst);
    let judged = (|| {
        let lost = |seen: &Seen| {
            seen.frame.is("STATUSTEXT")
                && seen.frame.text("text").to_lowercase().contains("regained")
        };
        // PX4 reports the loss of the station after COM_DL_LOSS_T, 10 s by default.
        t.pause(Duration::from_secs(13))?;
        let (mark, _) = t
            .peer
            .send_with(&station_heartbeat(), |craft| craft.hash_flip = 1);
        let own = t.bench.subject;
        let regained = t.peer.wait(mark, Duration::from_secs(3), |seen| {
            (seen.frame.system, seen.frame.component) == own && lost(seen)
        });
        t.expect_none(regained, |_| {
            "a HEARTBEAT with a wrong signature counts as the ground station's: the loss of the \
             link is not noticed"
                .into()
        })?;
        let mark = t.peer.send(&station_heartbeat());
        let text = t.peer.wait(mark, Duration::from_secs(3), lost);
        if text.is_none() {
            return Err(Stop::inconclusive(
                "the subject does not report that the ground station is there again, so what counts cannot be seen",
            ));
        }
        Ok(())
    })();
    t.bench
        .paused
        .store(false, std::sync::atomic::Ordering::SeqCst);
    judged
}

/// The highest timestamp that the subject has signed since `mark`.
fn highest_stamp(t: &Trial<'_>, mark: usize) -> Option<u64> {
    t.from_subject(mark, |seen| seen.verified == Some(true))
        .iter()
        .filter_map(|seen| seen.frame.signature)
        .map(|signature| signature.stamp)
        .max()
}

fn system_time(t: &Trial<'_>) -> Judged {
    t.key()?;
    t.alive()?;
    let year = 365 * 86_400 * 1_000_000_u64;
    let now = (wall_stamp() + crate::wire::EPOCH_2015_S * STAMP_HZ) * 10;
    for (what, time) in [
        ("ten years ahead", now + 10 * year),
        ("ten years back", now - 10 * year),
    ] {
        let mark = t.bench.net.mark();
        for _ in 0..3 {
            t.peer.send(
                &Draft::new("SYSTEM_TIME")
                    .bits("time_unix_usec", time)
                    .set("time_boot_ms", 1_000),
            );
        }
        t.pause(t.seconds(1.5))?;
        let stamp = highest_stamp(t, mark)
            .ok_or_else(|| Stop::inconclusive("the subject sent no signed frame in 1.5 s"))?;
        t.expect(stamp < wall_stamp() + 86_400 * STAMP_HZ, || {
            format!(
                "after a SYSTEM_TIME of {what} the subject stamps {} days ahead",
                (stamp - wall_stamp()) / (86_400 * STAMP_HZ)
            )
        })?;
        t.expect(t.answers(&t.peer), || {
            format!("after a SYSTEM_TIME of {what} the subject does not answer honest frames")
        })?;
    }
    Ok(())
}

fn stamps_follow_time(t: &Trial<'_>) -> Judged {
    t.key()?;
    t.alive()?;
    t.bench
        .paused
        .store(true, std::sync::atomic::Ordering::SeqCst);
    let judged = (|| {
        t.pause(Duration::from_millis(1_200))?;
        let (before, began) = (t.bench.net.mark(), t.bench.net.now());
        t.pause(Duration::from_secs(5))?;
        // Each link of PX4 has a clock of its own.
        let stamps = t.from_subject(before, |seen| {
            seen.verified == Some(true) && seen.socket == t.peer.port.number
        });
        let (Some(first), Some(last)) = (stamps.first(), stamps.last()) else {
            return Err(Stop::inconclusive(
                "the subject sent no signed frame in 5 s",
            ));
        };
        let of = |seen: &Seen| seen.frame.signature.map_or(0, |signature| signature.stamp);
        let (advance, elapsed) = (
            of(last).saturating_sub(of(first)) as f64 / STAMP_HZ as f64,
            last.at.saturating_sub(first.at.max(began)).as_secs_f64(),
        );
        t.expect_of(last, advance > elapsed * 0.5, || format!("in {elapsed:.1} s without a frame of the station the subject's timestamps rose by {advance:.3} s"))
    })();
    t.bench
        .paused
        .store(false, std::sync::atomic::Ordering::SeqCst);
    judged
}

/// Restarts the subject and waits until it sends again.
pub(super) fn restart(t: &Trial<'_>) -> Judged {
    let command = t.bench.restart.as_ref().ok_or_else(|| {
        Stop::not_applicable("needs a command that restarts the subject (--restart)")
    })?;
    t.bench
        .paused
        .store(true, std::sync::atomic::Ordering::SeqCst);
    let done = shell(command)
        .map_err(|reason| Stop::inconclusive(format!("the restart failed: {reason}")));
    let mark = t.bench.net.mark();
    let own = t.bench.subject;
    done?;
    // A subject that waits for its peer sends nothing until it is sent something; an unsigned frame proves nothing to
    // it.
    for _ in 0..30 {
        let back = t
            .bench
            .net
            .wait(mark, t.bench.net.now() + t.seconds(1.0), |seen| {
                seen.direction == Direction::Received
                    && (seen.frame.system, seen.frame.component) == own
            });
        if back.is_some() || t.bench.net.interrupted() {
            return Ok(());
        }
        t.peer
            .send_with(&station_heartbeat(), |craft| craft.key = None);
    }
    Err(Stop::inconclusive(
        "the subject did not come back within 30 s of its restart",
    ))
}

/// Resumes the station's heartbeats.
pub(super) fn resume(t: &Trial<'_>) {
    t.bench
        .paused
        .store(false, std::sync::atomic::Ordering::SeqCst);
}

fn replay_after_restart(t: &Trial<'_>) -> Judged {
    t.key()?;
    let kept = answered_probes(t, &t.peer, 1)?;
    let judged = restart(t).and_then(|()| {
        let Some((bytes, number)) = kept.first() else {
            return Ok(());
        };
        let mark = t.peer.send_bytes(bytes);
        t.expect_none(t.answered(&t.peer, mark, *number, t.answer()), |_| {
            "a request from before the restart was sent again, byte by byte, and answered".into()
        })
    });
    resume(t);
    judged?;
    t.alive()
}

fn stranger_first(t: &Trial<'_>) -> Judged {
    t.key()?;
    let remote = t
        .bench
        .port
        .remote()
        .ok_or_else(|| Stop::inconclusive("the subject has no address yet"))?;
    let judged = restart(t).and_then(|()| {
        let port = Arc::new(Port::to(&t.bench.net, remote).map_err(|error| Stop::inconclusive(format!("no socket: {error}")))?);
        let forger = t.peer.on(&port);
        for _ in 0..3 {
            forger.send_with(&station_heartbeat(), |craft| craft.key = None);
            forger.send_with(&station_heartbeat(), |craft| craft.hash_flip = 1);
        }
        t.pause(t.quiet())?;
        t.expect(t.answers(&t.peer), || {
            "after a restart a stranger's unsigned datagrams came first; the honest station is not answered at its address".into()
        })
    });
    resume(t);
    if judged.is_err() && !t.answers(&t.peer) {
        // The next rules must find the subject as it was.
        let _ = restart(t);
        resume(t);
    }
    judged
}

fn many_streams(t: &Trial<'_>) -> Judged {
    t.key()?;
    t.alive()?;
    for link in 100..120 {
        let stream = t.peer.with_link(link);
        let (draft, _) = t.probe();
        stream.send(&draft);
        t.pause(Duration::from_millis(10))?;
    }
    t.expect(t.answers(&t.peer), || {
        "after 20 more signed streams the station that was there before is not answered".into()
    })?;
    let (system, component) = t.bench.identity;
    let newcomer = Peer::new(
        &t.bench.net,
        &t.bench.port,
        (system.wrapping_add(2).max(1), component),
        0,
    );
    let judged = t.expect(t.answers(&newcomer), || "after 20 signed streams a new honest station is not answered: the table of streams is full for good".into());
    if judged.is_err() && t.bench.restart.is_some() {
        let _ = restart(t);
        resume(t);
    }
    judged
}

fn year_ahead(t: &Trial<'_>) -> Judged {
    t.key()?;
    t.alive()?;
    let odd = t.peer.with_link(74);
    let mark = t.bench.net.mark();
    let (draft, _) = t.probe();
    odd.send_with(&draft, |craft| craft.stamp += 365 * 86_400 * STAMP_HZ);
    t.pause(t.seconds(1.2))?;
    let judged = (|| {
        if let Some(stamp) = highest_stamp(t, mark) {
            t.expect(stamp < wall_stamp() + 2 * 3600 * STAMP_HZ, || {
                format!("one verified frame from a year ahead carried the subject's own timestamps along: {} days ahead", (stamp - wall_stamp()) / (86_400 * STAMP_HZ))
            })?;
        }
        let (system, component) = t.bench.identity;
        let newcomer = Peer::new(
            &t.bench.net,
            &t.bench.port,
            (system.wrapping_add(3).max(1), component),
            0,
        );
        t.expect(t.answers(&newcomer), || "after one verified frame from a year ahead a new station with the right time is not answered".into())?;
        t.expect(t.answers(&t.peer), || {
            "after one verified frame from a year ahead the honest station is not answered".into()
        })
    })();
    if judged.is_err() && t.bench.restart.is_some() {
        let _ = restart(t);
        resume(t);
    }
    judged
}
