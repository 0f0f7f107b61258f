//! MISS: upload, download and clearing by the mission protocol. The mission that the subject had is restored.

use std::sync::Arc;
use std::time::Duration;

use conformance::verdict::{Judged, Precondition, Stop};

use crate::bench::{Peer, Seen, Trial};
use crate::scene::Scene;
use crate::wire::{Draft, Frame};

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "MISS-001",
        play: upload_in_order,
    },
    Scene {
        rule: "MISS-002",
        play: comes_back_as_sent,
    },
    Scene {
        rule: "MISS-010",
        play: cleared,
    },
    Scene {
        rule: "MISS-015",
        play: opaque_id,
    },
    Scene {
        rule: "MISS-018",
        play: request_out_of_range,
    },
    Scene {
        rule: "MISS-019",
        play: types_are_apart,
    },
    Scene {
        rule: "MISS-022",
        play: download_twice,
    },
];

/// An item as it is sent and read back.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Item {
    pub(super) command: i64,
    pub(super) frame: i64,
    pub(super) params: [f32; 4],
    pub(super) x: i64,
    pub(super) y: i64,
    pub(super) z: f32,
    pub(super) current: i64,
    pub(super) autocontinue: i64,
}

impl Item {
    fn of(frame: &Frame) -> Self {
        Self {
            command: frame.int("command"),
            frame: frame.int("frame"),
            params: ["param1", "param2", "param3", "param4"].map(|name| frame.float(name)),
            x: frame.int("x"),
            y: frame.int("y"),
            z: frame.float("z"),
            current: frame.int("current"),
            autocontinue: frame.int("autocontinue"),
        }
    }

    pub(super) fn draft(&self, t: &Trial<'_>, seq: usize, kind: u8) -> Draft {
        let mut draft = Draft::new("MISSION_ITEM_INT")
            .to(t.bench.subject)
            .set("seq", seq as f64)
            .set("command", self.command as f64)
            .set("frame", self.frame as f64)
            .set("x", self.x as f64)
            .set("y", self.y as f64)
            .set("z", self.z)
            .set("current", self.current as f64)
            .set("autocontinue", self.autocontinue as f64)
            .set("mission_type", kind);
        for (name, value) in ["param1", "param2", "param3", "param4"]
            .into_iter()
            .zip(self.params)
        {
            draft = draft.bits(name, value.to_bits().into());
        }
        draft
    }

    /// Whether both are flown alike. PX4 normalises NaN and 0, both "unchanged", in either direction; `current` and
    /// the notation of the altitude frame may differ.
    fn like(&self, other: &Self) -> bool {
        let near = |a: f32, b: f32| {
            (a.is_nan() || a == 0.0) && (b.is_nan() || b == 0.0) || (a - b).abs() < 0.01
        };
        // The _INT frames (5, 6) are the same as 0 and 3.
        let frame = |frame| match frame {
            5 => 0,
            6 => 3,
            other => other,
        };
        self.command == other.command
            && frame(self.frame) == frame(other.frame)
            && (self.x - other.x).abs() <= 2
            && (self.y - other.y).abs() <= 2
            && near(self.z, other.z)
            && self
                .params
                .iter()
                .zip(other.params)
                .all(|(a, b)| near(*a, b))
    }
}

/// A plan of `count` waypoints in a small polygon. It has no take-off, and nothing starts it.
pub(super) fn plan(t: &Trial<'_>, count: usize) -> Vec<Item> {
    let place = t.from_subject(0, |seen| seen.frame.is("GLOBAL_POSITION_INT"));
    let (lat, lon) = place
        .last()
        .map(|seen| (seen.frame.int("lat"), seen.frame.int("lon")))
        .filter(|place| *place != (0, 0))
        .unwrap_or((473_977_434, 85_455_939));
    // Different coordinates in every scene: a plan of an earlier scene must not pass for this one.
    let salt = i64::from(t.number() % 50);
    (0..count)
        .map(|index| Item {
            command: 16,
            frame: 3,
            params: [index as f32 % 3.0, 5.0, 0.0, 0.0],
            x: lat + 2_000 + 300 * index as i64 + salt,
            y: lon + 1_000 - 200 * index as i64 + 7 * salt,
            z: 30.0 + (index % 7) as f32 + salt as f32 / 4.0,
            current: i64::from(index == 0),
            autocontinue: 1,
        })
        .collect()
}

pub(super) fn count_draft(t: &Trial<'_>, count: usize, kind: u8) -> Draft {
    Draft::new("MISSION_COUNT")
        .to(t.bench.subject)
        .set("count", count as f64)
        .set("mission_type", kind)
}

/// A request for an item of this mission type, as MISSION_REQUEST or MISSION_REQUEST_INT.
pub(super) fn is_request(seen: &Seen, kind: u8) -> bool {
    (seen.frame.is("MISSION_REQUEST_INT") || seen.frame.is("MISSION_REQUEST"))
        && seen.frame.int("mission_type") == i64::from(kind)
}

pub(super) fn is_ack(seen: &Seen, kind: u8) -> bool {
    seen.frame.is("MISSION_ACK") && seen.frame.int("mission_type") == i64::from(kind)
}

/// How an upload went.
#[derive(Debug, Default)]
pub(super) struct Upload {
    /// The sequence numbers that were requested.
    pub(super) requested: Vec<i64>,
    /// The last MISSION_ACK.
    pub(super) ack: Option<Arc<Seen>>,
}

impl Upload {
    /// The type of the MISSION_ACK, or that none came.
    pub(super) fn outcome(&self) -> String {
        match &self.ack {
            Some(ack) => format!("MISSION_ACK type {}", ack.frame.int("type")),
            None => "no MISSION_ACK".into(),
        }
    }

    pub(super) fn accepted(&self) -> bool {
        self.ack
            .as_ref()
            .is_some_and(|ack| ack.frame.int("type") == 0)
    }
}

/// Uploads; `answer` answers each request through the peer, so that a scene can answer wrongly.
pub(super) fn upload_with(
    t: &Trial<'_>,
    peer: &Peer,
    count: usize,
    kind: u8,
    mut answer: impl FnMut(&Peer, i64),
) -> Upload {
    let mut done = Upload::default();
    let mut mark = peer.send(&count_draft(t, count, kind));
    let mut deadline = t.bench.net.now() + t.seconds(6.0);
    let mut counted = 1;
    let own = t.bench.subject;
    loop {
        let step = t.seconds(if done.requested.is_empty() { 1.0 } else { 2.0 });
        let next = peer.wait(
            mark,
            step.min(deadline.saturating_sub(t.bench.net.now())),
            |seen| {
                (seen.frame.system, seen.frame.component) == own
                    && (is_request(seen, kind) || is_ack(seen, kind))
            },
        );
        let Some(seen) = next else {
            // MISSION_COUNT or its answer was lost.
            if done.requested.is_empty() && counted < 3 && !t.bench.net.interrupted() {
                counted += 1;
                mark = peer.send(&count_draft(t, count, kind));
                continue;
            }
            return done;
        };
        mark = position(t, &seen) + 1;
        if is_ack(&seen, kind) {
            done.ack = Some(seen);
            return done;
        }
        let seq = seen.frame.int("seq");
        if done.requested.last() != Some(&seq) {
            // The subject made progress: a long plan may take long.
            deadline = t.bench.net.now() + t.seconds(6.0);
        }
        done.requested.push(seq);
        answer(peer, seq);
    }
}

fn position(t: &Trial<'_>, seen: &Arc<Seen>) -> usize {
    let recording = t.bench.net.recording();
    recording
        .seen
        .iter()
        .rposition(|other| Arc::ptr_eq(other, seen))
        .unwrap_or_default()
}

/// Uploads as the protocol requires.
pub(super) fn upload(t: &Trial<'_>, peer: &Peer, items: &[Item], kind: u8) -> Upload {
    upload_with(t, peer, items.len(), kind, |peer, seq| {
        if let Some(item) = usize::try_from(seq).ok().and_then(|seq| items.get(seq)) {
            peer.send(&item.draft(t, seq as usize, kind));
        }
    })
}

/// Uploads, as a precondition.
pub(super) fn aboard(t: &Trial<'_>, items: &[Item], kind: u8) -> Judged {
    let done = upload(t, &t.peer, items, kind);
    if done.accepted() {
        Ok(())
    } else {
        Err(Stop::fail(format!(
            "an upload of {} waypoints ended with {}",
            items.len(),
            done.outcome()
        )))
    }
}

/// Downloads the plan of this mission type.
pub(super) fn download(t: &Trial<'_>, peer: &Peer, kind: u8) -> Judged<Vec<Item>> {
    let own = t.bench.subject;
    let list = Draft::new("MISSION_REQUEST_LIST")
        .to(own)
        .set("mission_type", kind);
    let answer = peer.request(
        &list,
        t.answer(),
        "MISSION_COUNT after MISSION_REQUEST_LIST",
        |seen| {
            (seen.frame.system, seen.frame.component) == own
                && (seen.frame.is("MISSION_COUNT")
                    && seen.frame.int("mission_type") == i64::from(kind)
                    || is_ack(seen, kind) && seen.frame.int("type") != 0)
        },
    )?;
    if answer.frame.is("MISSION_ACK") {
        return Err(Stop::not_applicable(format!(
            "a download of type {kind} was refused with MISSION_ACK type {}",
            answer.frame.int("type")
        )));
    }
    let count = answer.frame.int("count");
    let mut items = Vec::new();
    for seq in 0..count {
        let item = request_item(t, peer, seq, kind)?;
        items.push(Item::of(&item.frame));
    }
    peer.send(&Draft::new("MISSION_ACK").to(own).set("mission_type", kind));
    Ok(items)
}

fn request_item(t: &Trial<'_>, peer: &Peer, seq: i64, kind: u8) -> Judged<Arc<Seen>> {
    let own = t.bench.subject;
    let draft = Draft::new("MISSION_REQUEST_INT")
        .to(own)
        .set("seq", seq as f64)
        .set("mission_type", kind);
    peer.request(
        &draft,
        t.answer(),
        &format!("MISSION_ITEM_INT {seq}"),
        |seen| {
            (seen.frame.system, seen.frame.component) == own
                && seen.frame.is("MISSION_ITEM_INT")
                && seen.frame.int("seq") == seq
        },
    )
}

/// Clears, as a precondition.
pub(super) fn clear(t: &Trial<'_>, kind: u8) -> Judged {
    let draft = Draft::new("MISSION_CLEAR_ALL")
        .to(t.bench.subject)
        .set("mission_type", kind);
    let ack = t.peer.request(
        &draft,
        t.answer(),
        "MISSION_ACK after MISSION_CLEAR_ALL",
        |seen| is_ack(seen, kind),
    )?;
    t.expect_of(&ack, ack.frame.int("type") == 0, || {
        format!(
            "MISSION_CLEAR_ALL was answered with MISSION_ACK type {}",
            ack.frame.int("type")
        )
    })
}

/// Restores the saved plan.
pub(super) fn restore(t: &Trial<'_>, kind: u8, saved: &[Item]) -> Judged {
    let done = if saved.is_empty() {
        clear(t, kind)
    } else {
        aboard(t, saved, kind)
    };
    if let Err(stop) = done {
        t.note(format!(
            "the plan of type {kind} that was aboard could not be put back: {}",
            stop.judgement().reason
        ));
    }
    Ok(())
}

/// Plays with the mission, then restores the one from before.
pub(super) fn preserving(t: &Trial<'_>, play: impl FnOnce() -> Judged) -> Judged {
    let saved = download(t, &t.peer, 0).precondition("the mission aboard can be saved")?;
    let judged = play();
    restore(t, 0, &saved)?;
    judged
}

/// Fails unless this plan is the one on the vehicle.
pub(super) fn expect_aboard(t: &Trial<'_>, items: &[Item]) -> Judged {
    let found = download(t, &t.peer, 0)?;
    t.expect(found.len() == items.len(), || {
        format!(
            "expected {} items aboard; a download has {}",
            items.len(),
            found.len()
        )
    })?;
    for (index, (found, sent)) in found.iter().zip(items).enumerate() {
        t.expect(found.like(sent), || {
            format!("item {index} was sent as {sent:?} and comes back as {found:?}")
        })?;
    }
    Ok(())
}

fn upload_in_order(t: &Trial<'_>) -> Judged {
    preserving(t, || {
        let items = plan(t, 5);
        let done = upload(t, &t.peer, &items, 0);
        let mut order = done.requested.clone();
        order.dedup();
        t.expect(done.accepted(), || {
            format!(
                "expected MISSION_ACK type 0 after five items; got {}, requested were {:?}",
                done.outcome(),
                done.requested
            )
        })?;
        t.expect(order == [0, 1, 2, 3, 4], || {
            format!(
                "expected requests for items 0 to 4 in order; got {:?}",
                done.requested
            )
        })
    })
}

fn comes_back_as_sent(t: &Trial<'_>) -> Judged {
    preserving(t, || {
        let mut items = plan(t, 12);
        // The fourth item has a delay, the fifth another frame and a yaw.
        items[3].params[0] = 4.0;
        items[4].params[3] = 90.0;
        items[5].x = -items[5].x;
        items[5].y = -items[5].y;
        aboard(t, &items, 0).precondition("a plan of 12 items is taken")?;
        expect_aboard(t, &items)
    })
}

fn cleared(t: &Trial<'_>) -> Judged {
    preserving(t, || {
        aboard(t, &plan(t, 2), 0).precondition("a plan of two items is taken")?;
        clear(t, 0)?;
        let found = download(t, &t.peer, 0)?;
        t.expect(found.is_empty(), || {
            format!(
                "expected no items after MISSION_CLEAR_ALL; a download has {}",
                found.len()
            )
        })
    })
}

fn opaque_id(t: &Trial<'_>) -> Judged {
    preserving(t, || {
        let done = upload(t, &t.peer, &plan(t, 3), 0);
        let Some(ack) = done.ack.filter(|ack| ack.frame.int("type") == 0) else {
            return Err(Stop::inconclusive("the upload was not accepted"));
        };
        let given = ack.frame.int("opaque_id");
        if given == 0 {
            return Err(Stop::not_applicable(
                "the subject gives plans no id (opaque_id is 0)",
            ));
        }
        let list = Draft::new("MISSION_REQUEST_LIST").to(t.bench.subject);
        let count = t.peer.request(&list, t.answer(), "MISSION_COUNT", |seen| {
            seen.frame.is("MISSION_COUNT")
        })?;
        t.peer.send(&Draft::new("MISSION_ACK").to(t.bench.subject));
        t.expect_of(&count, count.frame.int("opaque_id") == given, || {
            format!(
                "MISSION_ACK names the plan {given}, MISSION_COUNT {}",
                count.frame.int("opaque_id")
            )
        })?;
        let mark = t.bench.net.mark();
        let current = t.peer.wait(mark, t.seconds(3.0), |seen| {
            seen.frame.is("MISSION_CURRENT")
        });
        let Some(current) = current else {
            return Err(Stop::inconclusive("no MISSION_CURRENT within 3 s"));
        };
        t.expect_of(&current, current.frame.int("mission_id") == given, || {
            format!(
                "MISSION_ACK names the plan {given}, MISSION_CURRENT {}",
                current.frame.int("mission_id")
            )
        })
    })
}

fn request_out_of_range(t: &Trial<'_>) -> Judged {
    preserving(t, || {
        aboard(t, &plan(t, 2), 0).precondition("a plan of two items is taken")?;
        let list = Draft::new("MISSION_REQUEST_LIST").to(t.bench.subject);
        t.peer.request(&list, t.answer(), "MISSION_COUNT", |seen| {
            seen.frame.is("MISSION_COUNT")
        })?;
        let mark = t.peer.send(
            &Draft::new("MISSION_REQUEST_INT")
                .to(t.bench.subject)
                .set("seq", 7),
        );
        let item = t.peer.wait(mark, t.quiet(), |seen| {
            seen.frame.is("MISSION_ITEM_INT") && seen.frame.int("seq") == 7
        });
        t.expect_none(item, |_| {
            "expected no item 7 of a plan of two; one was sent".into()
        })?;
        t.peer.send(&Draft::new("MISSION_ACK").to(t.bench.subject));
        // The disturbed transfer must have ended before the next begins.
        t.pause(t.quiet())?;
        download(t, &t.peer, 0).map(|_| ())
    })
}

fn types_are_apart(t: &Trial<'_>) -> Judged {
    preserving(t, || {
        let items = plan(t, 3);
        aboard(t, &items, 0).precondition("a plan of three items is taken")?;
        let fence = download(t, &t.peer, 1)?;
        clear(t, 1)?;
        let rest = expect_aboard(t, &items);
        restore(t, 1, &fence)?;
        rest.map_err(|stop| match stop {
            Stop::Fail(reason) => Stop::Fail(format!(
                "after the geofence was cleared the mission is another: {reason}"
            )),
            other => other,
        })
    })
}

fn download_twice(t: &Trial<'_>) -> Judged {
    preserving(t, || {
        let items = plan(t, 4);
        aboard(t, &items, 0).precondition("a plan of four items is taken")?;
        // The last MISSION_ACK is lost: the subject must accept a new download all the same.
        let list = Draft::new("MISSION_REQUEST_LIST").to(t.bench.subject);
        t.peer.request(&list, t.answer(), "MISSION_COUNT", |seen| {
            seen.frame.is("MISSION_COUNT")
        })?;
        for seq in 0..4 {
            request_item(t, &t.peer, seq, 0)?;
            // The same item once more, as if it had been lost.
            request_item(t, &t.peer, seq, 0)?;
        }
        t.pause(Duration::from_millis(100))?;
        expect_aboard(t, &items)
    })
}
