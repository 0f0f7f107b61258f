//! KEY: SETUP_SIGNING. Every scene ends with the key with which the run began.

use std::time::Duration;

use conformance::verdict::{Judged, Precondition, Stop};
use conformance::wire::Direction;
use sha2::{Digest, Sha256};

use super::{command, signing};
use crate::bench::Trial;
use crate::scene::Scene;
use crate::wire::{Draft, Key};

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "KEY-001",
        play: new_key_at_once,
    },
    Scene {
        rule: "KEY-002",
        play: unsigned_setup,
    },
    Scene {
        rule: "KEY-003",
        play: other_target,
    },
    Scene {
        rule: "KEY-004",
        play: old_key_refused,
    },
    Scene {
        rule: "KEY-005",
        play: zero_key_with_stamp,
    },
    Scene {
        rule: "KEY-006",
        play: while_armed,
    },
    Scene {
        rule: "KEY-007",
        play: survives_restart,
    },
];

/// The key that scenes change to. It is derived from the run's key, so that a later run can restore a subject on
/// which a run was interrupted.
#[must_use]
pub(crate) fn other_key(key: Key) -> Key {
    let digest = Sha256::new()
        .chain_update(b"mavlink-check: other key")
        .chain_update(key.0)
        .finalize();
    Key(std::array::from_fn(|index| digest[index]))
}

fn setup(t: &Trial<'_>, key: Key, target: (u8, u8)) -> Draft {
    Draft::new("SETUP_SIGNING")
        .to(target)
        .text("secret_key", key.0)
        .bits("initial_timestamp", t.bench.net.stamp())
}

/// Whether the subject's frames verify under this key within two seconds.
fn signs_with(t: &Trial<'_>, key: Key, time: Duration) -> bool {
    let mark = t.bench.net.mark();
    let own = t.bench.subject;
    t.bench
        .net
        .wait(mark, t.bench.net.now() + time, |seen| {
            seen.direction == Direction::Received
                && (seen.frame.system, seen.frame.component) == own
                && seen.frame.verifies(&key) == Some(true)
        })
        .is_some()
}

/// Plays a scene, then restores the run's key whatever its result.
fn preserving(t: &Trial<'_>, play: impl FnOnce(Key, Key) -> Judged) -> Judged {
    let key = t.key()?;
    t.alive()?;
    let other = other_key(key);
    let judged = play(key, other);
    bring_back(t, key, other)?;
    judged
}

/// Restores `key` on a subject that has `key`, `other`, or a key of zeros.
pub(crate) fn bring_back(t: &Trial<'_>, key: Key, other: Key) -> Judged {
    for current in [key, other, Key([0; 32])] {
        t.bench.net.set_key(Some(current));
        if signs_with(t, current, t.seconds(1.5)) && t.answers(&t.peer) {
            if current != key {
                for _ in 0..3 {
                    t.peer.send(&setup(t, key, t.bench.subject));
                    t.bench.net.set_key(Some(key));
                    if signs_with(t, key, t.seconds(2.0)) && t.answers(&t.peer) {
                        return Ok(());
                    }
                    t.bench.net.set_key(Some(current));
                }
            } else {
                return Ok(());
            }
        }
    }
    t.bench.net.set_key(Some(key));
    Err(Stop::inconclusive(
        "the subject could not be brought back to the run's key: give it that key by other means",
    ))
}

fn new_key_at_once(t: &Trial<'_>) -> Judged {
    preserving(t, |_, other| {
        t.peer.send(&setup(t, other, t.bench.subject));
        t.bench.net.set_key(Some(other));
        t.expect(signs_with(t, other, t.seconds(2.5)), || "expected frames signed with the new key within 2.5 s of a signed SETUP_SIGNING; none came".into())?;
        t.expect(t.answers(&t.peer), || {
            "the subject signs with the new key, but does not answer frames that are signed with it"
                .into()
        })?;
        // From here every frame has to carry the new key: a subject that changed only some of its links would send
        // both.
        let mark = t.bench.net.mark();
        t.pause(t.seconds(1.2))?;
        let stale = t
            .from_subject(mark, |seen| seen.frame.verifies(&other) != Some(true))
            .len();
        t.expect(stale == 0, || {
            format!("{stale} frames after the change were not signed with the new key")
        })
    })
}

fn unsigned_setup(t: &Trial<'_>) -> Judged {
    preserving(t, |key, other| {
        for spoilt in [
            (|craft| craft.key = None) as fn(&mut crate::wire::Craft),
            |craft| craft.hash_flip = 1,
        ] {
            t.peer.send_with(&setup(t, other, t.bench.subject), spoilt);
            t.pause(t.quiet())?;
            t.expect(
                !signs_with(t, other, t.seconds(1.2)) && signs_with(t, key, t.seconds(1.2)),
                || {
                    "a SETUP_SIGNING that was not signed with the key in force has changed the key"
                        .into()
                },
            )?;
        }
        // Signing is switched off by a key of zeros, here sent unsigned.
        t.peer
            .send_with(&Draft::new("SETUP_SIGNING").to(t.bench.subject), |craft| {
                craft.key = None
            });
        t.pause(t.quiet())?;
        t.expect(signs_with(t, key, t.seconds(2.0)), || {
            "an unsigned SETUP_SIGNING of zeros has switched signing off".into()
        })
    })
}

fn other_target(t: &Trial<'_>) -> Judged {
    preserving(t, |key, other| {
        let target = (if t.bench.subject.0 == 199 { 198 } else { 199 }, 9);
        t.peer.send(&setup(t, other, target));
        t.pause(t.quiet())?;
        t.expect(
            !signs_with(t, other, t.seconds(1.2)) && signs_with(t, key, t.seconds(1.2)),
            || {
                format!(
                    "a SETUP_SIGNING for system {} component 9 has changed the key of the subject",
                    target.0
                )
            },
        )
    })
}

fn old_key_refused(t: &Trial<'_>) -> Judged {
    preserving(t, |key, other| {
        t.peer.send(&setup(t, other, t.bench.subject));
        t.bench.net.set_key(Some(other));
        if !signs_with(t, other, t.seconds(2.5)) {
            return Err(Stop::inconclusive("the new key was not taken: KEY-001"));
        }
        t.refuses("a frame signed with the key before", |craft| {
            craft.key = Some(key)
        })
    })
}

fn zero_key_with_stamp(t: &Trial<'_>) -> Judged {
    preserving(t, |key, _| {
        t.peer.send(&setup(t, Key([0; 32]), t.bench.subject));
        t.pause(t.quiet())?;
        t.expect(signs_with(t, key, t.seconds(2.0)), || {
            "a SETUP_SIGNING with a key of zeros was taken: everyone knows that key".into()
        })
    })
}

fn while_armed(t: &Trial<'_>) -> Judged {
    let arm =
        |on: f64| command::acknowledged(t, &t.peer, 400, &command::long(t, 400).set("param1", on));
    preserving(t, |key, other| {
        let mut armed = false;
        for _ in 0..20 {
            if arm(1.0)?.frame.int("result") == 0 {
                armed = true;
                break;
            }
            t.pause(t.seconds(1.0))?;
        }
        if !armed {
            return Err(Stop::inconclusive(
                "the vehicle could not be armed within 20 s",
            ));
        }
        t.peer.send(&setup(t, other, t.bench.subject));
        t.pause(t.quiet())?;
        let kept = !signs_with(t, other, t.seconds(1.2)) && signs_with(t, key, t.seconds(1.2));
        if !kept {
            t.bench.net.set_key(Some(other));
        }
        arm(0.0).precondition("the vehicle can be disarmed")?;
        // The next scene waits for a HEARTBEAT, which comes once a second.
        t.pause(t.seconds(1.5))?;
        t.expect(kept, || {
            "SETUP_SIGNING was taken while the vehicle is armed".into()
        })
    })
}

fn survives_restart(t: &Trial<'_>) -> Judged {
    preserving(t, |_, other| {
        t.peer.send(&setup(t, other, t.bench.subject));
        t.bench.net.set_key(Some(other));
        if !signs_with(t, other, t.seconds(2.5)) {
            return Err(Stop::inconclusive("the new key was not taken: KEY-001"));
        }
        // Restarted at once, while the subject may still be writing its key file.
        let restarted = signing::restart(t);
        signing::resume(t);
        restarted?;
        t.expect(signs_with(t, other, t.seconds(5.0)), || "after a restart that followed SETUP_SIGNING at once the subject does not sign with the new key".into())
    })
}
