//! FRAME and HB: which frames a subject must accept, and which it must drop before it checks any signature.

use conformance::verdict::{Judged, Stop};

use crate::bench::Trial;
use crate::scene::Scene;
use crate::wire::Draft;

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "FRAME-002",
        play: wrong_checksum,
    },
    Scene {
        rule: "FRAME-003",
        play: unknown_incompatibility,
    },
    Scene {
        rule: "FRAME-004",
        play: unknown_compatibility,
    },
    Scene {
        rule: "FRAME-005",
        play: garbage_before,
    },
    Scene {
        rule: "FRAME-006",
        play: several_frames,
    },
    Scene {
        rule: "FRAME-007",
        play: untruncated,
    },
    Scene {
        rule: "FRAME-010",
        play: unknown_message,
    },
    Scene {
        rule: "FRAME-011",
        play: longer_payload,
    },
    Scene {
        rule: "FRAME-012",
        play: split_frame,
    },
    Scene {
        rule: "FRAME-013",
        play: empty_and_huge,
    },
];

fn wrong_checksum(t: &Trial<'_>) -> Judged {
    // For unsigned subjects, which have only the checksum. On signed ones the signature would hide whether the
    // checksum is verified: SIGN-009 judges those.
    t.refuses("a frame with a wrong checksum", |craft| {
        craft.crc_flip = 0x0101
    })
}

fn unknown_incompatibility(t: &Trial<'_>) -> Judged {
    t.refuses(
        "a frame with the unknown incompatibility flag 0x80",
        |craft| craft.incompat = 0x80,
    )
}

fn unknown_compatibility(t: &Trial<'_>) -> Judged {
    t.takes(
        "a frame with the unknown compatibility flag 0x80",
        |craft| craft.compat = 0x80,
    )
}

/// Sends honest probes with other bytes around them in one datagram; returns how many of `count` are answered.
fn answered_within(
    t: &Trial<'_>,
    count: usize,
    wrap: impl Fn(Vec<Vec<u8>>) -> Vec<Vec<u8>>,
) -> Judged<usize> {
    t.alive()?;
    let mut best = 0;
    for _ in 0..3 {
        let probes: Vec<_> = (0..count).map(|_| t.probe()).collect();
        let mark = t.bench.net.mark();
        {
            let _held = t.bench.net.hold();
            let frames = probes
                .iter()
                .map(|(draft, _)| t.peer.craft(draft).bytes())
                .collect();
            for datagram in wrap(frames) {
                t.peer.send_bytes(&datagram);
            }
        }
        t.pause(t.quiet())?;
        // Answers to COMMAND carry no number, so they are counted.
        let answered = if t.bench.probe == crate::bench::trial::Probe::Command {
            t.from_subject(mark, |seen| {
                t.peer.is_mine(seen) && t.bench.probe.is_answer(0, seen)
            })
            .len()
            .min(count)
        } else {
            let own = |number: u32| {
                t.answered(&t.peer, mark, number, std::time::Duration::ZERO)
                    .is_some()
            };
            probes.iter().filter(|(_, number)| own(*number)).count()
        };
        best = best.max(answered);
        if best == count {
            break;
        }
    }
    Ok(best)
}

fn garbage_before(t: &Trial<'_>) -> Judged {
    let noise: Vec<u8> = (0..23_u8)
        .map(|byte| byte.wrapping_mul(37) & 0x7F)
        .collect();
    let answered = answered_within(t, 1, |frames| {
        vec![[noise.clone(), frames.concat()].concat()]
    })?;
    t.expect(answered == 1, || "expected an answer to a frame behind 23 bytes of garbage in one datagram; none came in three tries".into())
}

fn several_frames(t: &Trial<'_>) -> Judged {
    let answered = answered_within(t, 3, |frames| vec![frames.concat()])?;
    t.expect(answered == 3, || {
        format!("expected an answer to each of three frames in one datagram; {answered} came")
    })
}

fn split_frame(t: &Trial<'_>) -> Judged {
    let answered = answered_within(t, 1, |frames| {
        let bytes = frames.concat();
        let (head, tail) = bytes.split_at(bytes.len() / 2);
        vec![head.to_vec(), tail.to_vec()]
    })?;
    t.expect(answered == 1, || {
        "expected an answer to a frame that came in two datagrams; none came in three tries".into()
    })
}

fn untruncated(t: &Trial<'_>) -> Judged {
    t.takes(
        "a frame whose payload ends with the zeros that a sender may leave out",
        |craft| *craft = craft.clone().untruncated(),
    )
}

fn unknown_message(t: &Trial<'_>) -> Judged {
    t.alive()?;
    for id in [54_321, 0x00FF_FFFF, 180] {
        t.peer
            .send_with(&Draft::new("HEARTBEAT").set("type", 6), |craft| {
                craft.id = id;
                craft.crc_extra = 0;
                craft.payload = vec![1; 20];
            });
    }
    if t.answers(&t.peer) {
        Ok(())
    } else {
        Err(Stop::fail(
            "after messages of unknown ids the subject answers honest frames no more",
        ))
    }
}

fn longer_payload(t: &Trial<'_>) -> Judged {
    // A later revision of a message may have more extension fields than the receiver knows.
    t.takes(
        "a message that is 12 bytes longer than its definition",
        |craft| {
            *craft = craft.clone().untruncated();
            craft.payload.extend([7; 12]);
        },
    )
}

fn empty_and_huge(t: &Trial<'_>) -> Judged {
    t.alive()?;
    for bytes in [
        vec![],
        vec![0xFD],
        vec![0xFD, 255, 0],
        vec![0xFD; 1_200],
        vec![0xFE; 600],
        vec![0; 9_000],
    ] {
        t.peer.send_bytes(&bytes);
    }
    t.pause(t.quiet())?;
    if t.answers(&t.peer) {
        Ok(())
    } else {
        Err(Stop::fail(
            "after empty, cut and oversized datagrams the subject answers honest frames no more",
        ))
    }
}
