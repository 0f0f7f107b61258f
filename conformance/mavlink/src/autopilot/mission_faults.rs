//! MISS, continued: losses, disorder, refusals, and a second station.

use std::cell::{Cell, RefCell};

use conformance::verdict::{Judged, Precondition, Stop};

use super::mission::{
    Item, aboard, count_draft, expect_aboard, is_ack, is_request, plan, preserving, upload,
    upload_with,
};
use crate::bench::Trial;
use crate::scene::Scene;
use crate::wire::Draft;

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "MISS-003",
        play: lost_item,
    },
    Scene {
        rule: "MISS-004",
        play: repeated_count,
    },
    Scene {
        rule: "MISS-005",
        play: wrong_sequence,
    },
    Scene {
        rule: "MISS-006",
        play: disorder,
    },
    Scene {
        rule: "MISS-007",
        play: unsupported_frame,
    },
    Scene {
        rule: "MISS-008",
        play: unsupported_command,
    },
    Scene {
        rule: "MISS-009",
        play: too_many,
    },
    Scene {
        rule: "MISS-011",
        play: second_station,
    },
    Scene {
        rule: "MISS-012",
        play: stalled,
    },
    Scene {
        rule: "MISS-013",
        play: other_system,
    },
    Scene {
        rule: "MISS-014",
        play: unknown_type,
    },
    Scene {
        rule: "MISS-016",
        play: current_out_of_range,
    },
    Scene {
        rule: "MISS-017",
        play: impossible_place,
    },
    Scene {
        rule: "MISS-020",
        play: item_without_upload,
    },
    Scene {
        rule: "MISS-021",
        play: refused_upload_keeps_the_plan,
    },
];

fn send_item(t: &Trial<'_>, peer: &crate::bench::Peer, items: &[Item], seq: i64) {
    if let Some(item) = usize::try_from(seq).ok().and_then(|seq| items.get(seq)) {
        peer.send(&item.draft(t, seq as usize, 0));
    }
}

fn lost_item(t: &Trial<'_>) -> Judged {
    preserving(t, || {
        let items = plan(t, 4);
        let lost = Cell::new(false);
        let done = upload_with(t, &t.peer, 4, 0, |peer, seq| {
            if seq == 2 && !lost.replace(true) {
                return;
            }
            send_item(t, peer, &items, seq);
        });
        t.expect(done.requested.iter().filter(|seq| **seq == 2).count() > 1, || {
            format!("item 2 was lost: expected a second request for it within 2 s; requested were {:?}", done.requested)
        })?;
        t.expect(done.accepted(), || {
            format!(
                "item 2 was lost once and sent again: expected MISSION_ACK type 0; got {}",
                done.outcome()
            )
        })?;
        expect_aboard(t, &items)
    })
}

fn repeated_count(t: &Trial<'_>) -> Judged {
    preserving(t, || {
        let items = plan(t, 3);
        // As if the answer to the first count had been lost, the station sends it again.
        t.peer.send(&count_draft(t, 3, 0));
        t.pause(t.quiet() / 2)?;
        let done = upload(t, &t.peer, &items, 0);
        t.expect(done.accepted(), || {
            format!(
                "MISSION_COUNT was sent twice, then all items: expected MISSION_ACK type 0; got {}",
                done.outcome()
            )
        })?;
        expect_aboard(t, &items)
    })
}

fn wrong_sequence(t: &Trial<'_>) -> Judged {
    preserving(t, || {
        let items = plan(t, 4);
        let once = Cell::new(false);
        let done = upload_with(t, &t.peer, 4, 0, |peer, seq| {
            if seq == 1 && !once.replace(true) {
                // Item 3 in place of item 1, as a network that reorders delivers it.
                send_item(t, peer, &items, 3);
            }
            send_item(t, peer, &items, seq);
        });
        if !done.accepted() {
            t.warn(format!(
                "an item out of order ended the upload with {}; PX4 ignores it",
                done.outcome()
            ));
            aboard(t, &items, 0)?;
        }
        expect_aboard(t, &items)
    })
}

fn disorder(t: &Trial<'_>) -> Judged {
    preserving(t, || {
        let items = plan(t, 20);
        let held: RefCell<Option<i64>> = RefCell::new(None);
        let step = Cell::new(0_u32);
        let done = upload_with(t, &t.peer, 20, 0, |peer, seq| {
            step.set(step.get() + 1);
            match step.get() % 5 {
                // This answer is lost.
                1 if step.get() > 1 => {}
                // This one is doubled.
                2 => {
                    send_item(t, peer, &items, seq);
                    send_item(t, peer, &items, seq);
                }
                // This one comes behind an older, delayed one. A signed receiver drops the overtaken frame, and the
                // station sends it again.
                3 => {
                    if let Some(old) = held.borrow_mut().replace(seq) {
                        send_item(t, peer, &items, old);
                    }
                    send_item(t, peer, &items, seq);
                }
                4 => {
                    // Two frames are swapped: the later timestamp arrives first.
                    let _held = t.bench.net.hold();
                    let first = peer
                        .craft(&items[seq as usize].draft(t, seq as usize, 0))
                        .bytes();
                    let second = peer
                        .craft(&items[seq as usize].draft(t, seq as usize, 0))
                        .bytes();
                    peer.send_bytes(&second);
                    peer.send_bytes(&first);
                }
                _ => send_item(t, peer, &items, seq),
            }
        });
        t.expect(done.accepted(), || {
            format!("20 items over a network that loses, doubles and reorders them, each sent again on request: expected MISSION_ACK type 0; got {}", done.outcome())
        })?;
        expect_aboard(t, &items)
    })
}

/// Fails where a plan that must be refused is accepted; `what` describes the plan.
fn refused(
    t: &Trial<'_>,
    what: &str,
    expected: i64,
    change: impl FnOnce(&mut Vec<Item>),
) -> Judged {
    preserving(t, || {
        let mut items = plan(t, 3);
        change(&mut items);
        let done = upload(t, &t.peer, &items, 0);
        let Some(ack) = &done.ack else {
            return Err(Stop::fail(format!(
                "expected MISSION_ACK type {expected} for {what}; none came"
            )));
        };
        let found = ack.frame.int("type");
        t.expect_of(ack, found != 0, || {
            format!("expected MISSION_ACK type {expected} for {what}; it was accepted (0)")
        })?;
        if found != expected {
            t.warn(format!(
                "{what} was refused with MISSION_ACK type {found}; type {expected} says why"
            ));
        }
        Ok(())
    })
}

fn unsupported_frame(t: &Trial<'_>) -> Judged {
    refused(t, "a waypoint in MAV_FRAME_LOCAL_NED", 2, |items| {
        items[1].frame = 1
    })
}

fn unsupported_command(t: &Trial<'_>) -> Judged {
    refused(t, "an item with the unknown command 59999", 3, |items| {
        items[1].command = 59_999
    })
}

fn impossible_place(t: &Trial<'_>) -> Judged {
    refused(t, "a waypoint at latitude 200 degrees", 10, |items| {
        items[1].x = 2_000_000_000
    })
}

fn too_many(t: &Trial<'_>) -> Judged {
    preserving(t, || {
        let kept = plan(t, 2);
        aboard(t, &kept, 0).precondition("a plan of two items is taken")?;
        let mark = t.peer.send(&count_draft(t, 65_000, 0));
        let answer = t.peer.wait(mark, t.answer(), |seen| {
            is_ack(seen, 0) || is_request(seen, 0)
        });
        match answer {
            Some(ack) if ack.frame.is("MISSION_ACK") => {
                t.expect_of(&ack, ack.frame.int("type") != 0, || {
                    "MISSION_COUNT of 65000 was answered with MISSION_ACK type 0".into()
                })?;
                if ack.frame.int("type") != 4 {
                    t.warn(format!(
                        "65000 items were refused with type {}; NO_SPACE (4) says why",
                        ack.frame.int("type")
                    ));
                }
                expect_aboard(t, &kept)
            }
            Some(request) => {
                t.peer.send(
                    &Draft::new("MISSION_ACK")
                        .to(t.bench.subject)
                        .set("type", 15),
                );
                t.cite(&request);
                t.pause(t.seconds(6.0))?;
                Err(Stop::fail(
                    "expected MISSION_ACK type 4 (NO_SPACE) for 65000 items; the subject began to request them",
                ))
            }
            None => Err(Stop::fail(
                "expected MISSION_ACK type 4 (NO_SPACE) for 65000 items; no answer came",
            )),
        }
    })
}

fn second_station(t: &Trial<'_>) -> Judged {
    preserving(t, || {
        let items = plan(t, 4);
        let other = t.other();
        let tried = Cell::new(None);
        let done = upload_with(t, &t.peer, 4, 0, |peer, seq| {
            if seq == 2 && tried.get().is_none() {
                let mark = other.send(&count_draft(t, 2, 0));
                let answer = other.wait(mark, t.quiet(), |seen| {
                    seen.frame.target() == Some((other.system, other.component))
                        && (is_request(seen, 0) || is_ack(seen, 0) && seen.frame.int("type") == 0)
                });
                tried.set(Some(answer.is_some()));
            }
            send_item(t, peer, &items, seq);
        });
        t.expect(tried.get() != Some(true), || "while one station uploads, a second one's MISSION_COUNT was answered with a request: two plans would be mixed".into())?;
        t.expect(done.accepted(), || format!("the upload that a second station disturbed ended with {}; expected MISSION_ACK type 0", done.outcome()))?;
        expect_aboard(t, &items)
    })
}

fn stalled(t: &Trial<'_>) -> Judged {
    preserving(t, || {
        let kept = plan(t, 2);
        aboard(t, &kept, 0).precondition("a plan of two items is taken")?;
        let mark = t.peer.send(&count_draft(t, 5, 0));
        t.peer
            .wait(mark, t.answer(), |seen| is_request(seen, 0))
            .ok_or_else(|| Stop::inconclusive("the upload was not begun"))?;
        // Half an upload, then the station stops.
        t.pause(t.seconds(6.0))?;
        expect_aboard(t, &kept).map_err(|stop| match stop {
            Stop::Fail(reason) => Stop::Fail(format!("an upload was begun and not continued for 6 s; the plan before it is gone or cannot be read: {reason}")),
            other => other,
        })?;
        let items = plan(t, 3);
        let done = upload(t, &t.peer, &items, 0);
        t.expect(done.accepted(), || {
            format!(
                "after an upload that was given up the next one ended with {}",
                done.outcome()
            )
        })
    })
}

fn other_system(t: &Trial<'_>) -> Judged {
    t.alive()?;
    let other = if t.bench.subject.0 == 199 { 198 } else { 199 };
    let mark = t.peer.send(&count_draft(t, 3, 0).to((other, 1)));
    let own = t.bench.subject;
    let answer = t.peer.wait(mark, t.quiet(), |seen| {
        (seen.frame.system, seen.frame.component) == own && (is_request(seen, 0) || is_ack(seen, 0))
    });
    if let Some(answer) = answer {
        t.cite(&answer);
        t.peer
            .send(&Draft::new("MISSION_ACK").to(own).set("type", 15));
        return Err(Stop::fail(format!(
            "expected no answer to MISSION_COUNT for system {other}; the subject answered with {}",
            answer.frame.name()
        )));
    }
    t.alive()
}

fn unknown_type(t: &Trial<'_>) -> Judged {
    t.alive()?;
    let mark = t.peer.send(&count_draft(t, 2, 77));
    let answer = t.peer.wait(mark, t.answer(), |seen| {
        is_request(seen, 77) || is_request(seen, 0) || is_ack(seen, 77) || is_ack(seen, 0)
    });
    let answer = answer.ok_or_else(|| {
        Stop::fail(
            "expected a refusal (MISSION_ACK) of the unknown mission type 77; no answer came",
        )
    })?;
    t.expect_of(
        &answer,
        answer.frame.is("MISSION_ACK") && answer.frame.int("type") != 0,
        || {
            format!(
                "expected a refusal of the unknown mission type 77; got {} type {}",
                answer.frame.name(),
                answer.frame.int("type")
            )
        },
    )
}

fn current_out_of_range(t: &Trial<'_>) -> Judged {
    preserving(t, || {
        aboard(t, &plan(t, 3), 0).precondition("a plan of three items is taken")?;
        let mark = t.bench.net.mark();
        if t.peer
            .wait(mark, t.seconds(3.0), |seen| {
                seen.frame.is("MISSION_CURRENT")
            })
            .is_none()
        {
            return Err(Stop::not_applicable("the subject sends no MISSION_CURRENT"));
        }
        t.peer.send(
            &Draft::new("MISSION_SET_CURRENT")
                .to(t.bench.subject)
                .set("seq", 500),
        );
        t.pause(t.quiet())?;
        let mark = t.bench.net.mark();
        let shown = t.peer.wait(mark, t.seconds(2.5), |seen| {
            seen.frame.is("MISSION_CURRENT") && seen.frame.int("seq") == 500
        });
        t.expect_none(shown, |_| {
            "MISSION_SET_CURRENT to item 500 of a plan of three: MISSION_CURRENT shows 500".into()
        })
    })
}

fn item_without_upload(t: &Trial<'_>) -> Judged {
    preserving(t, || {
        let kept = plan(t, 3);
        aboard(t, &kept, 0).precondition("a plan of three items is taken")?;
        let unrequested = plan(t, 3);
        t.peer.send(&unrequested[1].draft(t, 1, 0));
        t.pause(t.quiet())?;
        expect_aboard(t, &kept).map_err(|stop| match stop {
            Stop::Fail(reason) => Stop::Fail(format!(
                "a MISSION_ITEM_INT that nobody requested has changed the plan: {reason}"
            )),
            other => other,
        })
    })
}

fn refused_upload_keeps_the_plan(t: &Trial<'_>) -> Judged {
    preserving(t, || {
        let kept = plan(t, 3);
        aboard(t, &kept, 0).precondition("a plan of three items is taken")?;
        let mut broken = plan(t, 4);
        broken[2].command = 59_999;
        let done = upload(t, &t.peer, &broken, 0);
        if done.accepted() {
            return Err(Stop::not_applicable(
                "the upload that was to be refused was accepted: MISS-008",
            ));
        }
        expect_aboard(t, &kept).map_err(|stop| match stop {
            Stop::Fail(reason) => Stop::Fail(format!(
                "an upload was refused, and the plan before it is gone: {reason}"
            )),
            other => other,
        })
    })
}
