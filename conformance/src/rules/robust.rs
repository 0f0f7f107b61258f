//! ROBUST: malformed and hostile input.
//!
//! After each input the subject has to answer a discovery, and its status has to have continued.

use std::time::Duration;

use stanag_msgs::Id;

use super::scene::Scene;
use crate::bench::discovery::alive;
use crate::bench::flight::{
    Plan, clear, difference, download, home, mode_command, reported_mode, run_transfer, transfer,
    waypoint,
};
use crate::bench::station::{Access, Station, authorisation, discovery, information_request, loi};
use crate::bench::trial::{Player, Trial};
use crate::verdict::{Judged, Stop};
use crate::wire::Draft;

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "ROBUST-001",
        play: truncated_messages,
    },
    Scene {
        rule: "ROBUST-002",
        play: lying_lengths,
    },
    Scene {
        rule: "ROBUST-003",
        play: unknown_and_private_messages,
    },
    Scene {
        rule: "ROBUST-004",
        play: random_bytes,
    },
    Scene {
        rule: "ROBUST-005",
        play: datagrams_of_unusual_size,
    },
    Scene {
        rule: "ROBUST-006",
        play: nan_and_infinities,
    },
    Scene {
        rule: "ROBUST-007",
        play: text_without_an_end,
    },
    Scene {
        rule: "ROBUST-008",
        play: messages_the_wrong_way_round,
    },
    Scene {
        rule: "ROBUST-009",
        play: impossible_senders,
    },
    Scene {
        rule: "ROBUST-010",
        play: duplicated_and_reordered_datagrams,
    },
];

/// A monitor whose status shows that the subject lives: the station, and the mark from which gaps are measured.
fn watched(t: &Trial) -> Judged<(Player, usize)> {
    let station = match t.controller() {
        Ok(station) => station,
        Err(Stop::NotApplicable(_)) => t.monitor()?,
        Err(stop) => return Err(stop),
    };
    t.pause(Duration::from_millis(600))?;
    Ok((station, t.bench.net.mark()))
}

/// Fails unless the subject answers a discovery, and its status had no gap.
fn unharmed(t: &Trial, station: &Station, mark: usize, what: &str) -> Judged {
    t.pause(Duration::from_millis(600))?;
    if !alive(&t.bench) {
        return Err(Stop::fail(format!(
            "expected a discovery to be answered after {what}; nothing came"
        )));
    }
    let times: Vec<f64> = station
        .received(mark, |seen| matches!(seen.kind(), 3001 | 3002 | 4000))
        .iter()
        .map(|seen| seen.at.as_secs_f64())
        .collect();
    let gap = times
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .fold(0.0, f64::max);
    if times.len() > 3 && gap > 2.0 {
        return Err(Stop::fail(format!(
            "expected status without a gap over 2 s during {what}, got {gap:.1} s"
        )));
    }
    if times.len() > 3 {
        let last = times.last().copied().unwrap_or_default();
        let silent = t.bench.net.now().as_secs_f64() - last;
        t.expect(silent < 3.0, || {
            format!("expected status to continue after {what}; none for {silent:.1} s")
        })?;
    }
    Ok(())
}

/// A deterministic sequence of numbers: the same seed gives the same bytes, so that a fail can be repeated.
struct Sequence(u64);

impl Sequence {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn below(&mut self, limit: usize) -> usize {
        (self.next() % limit.max(1) as u64) as usize
    }
}

fn truncated_messages(t: &Trial) -> Judged {
    let (a, mark) = watched(t)?;
    let (radius, mode) = (a.radius().ok().flatten(), reported_mode(&a).ok().flatten());
    let messages = [
        a.stamped(authorisation(
            loi::LOI2 | loi::LOI3 | loi::LOI4,
            Access::Release,
        )),
        a.stamped(
            Draft::new(2017)
                .set("Loiter Radius", t.bench.fresh_radius())
                .acked(),
        ),
        a.stamped(mode_command(12).acked()),
        a.stamped(Draft::new(13002).raw("Waypoint Number", 1).acked()),
        a.stamped(transfer(3, "CUT")),
        a.stamped(information_request(3)),
        a.stamped(super::configuration::request(0)),
    ];
    for message in &messages {
        let bytes = a.encode(message);
        for end in 0..bytes.len() {
            a.send_bytes(&bytes[..end]);
            if end % 8 == 0 {
                t.pause(Duration::from_millis(2))?;
            }
        }
    }
    t.pause(t.timers().quiet)?;
    let answers = a.received(mark, |seen| {
        seen.kind() == 17000 && seen.raw("Acknowledgement Type") == Some(2)
    });
    t.expect(answers.is_empty(), || {
        "expected no 'carried out' for a truncated message; 17000 type 2 came".into()
    })?;
    unharmed(t, &a, mark, "truncated messages")?;
    let after = (a.radius().ok().flatten(), reported_mode(&a).ok().flatten());
    t.expect(after == (radius, mode), || format!("expected truncated messages to change nothing; radius and mode went from {:?} to {after:?}", (radius, mode)))
}

fn lying_lengths(t: &Trial) -> Judged {
    let (a, mark) = watched(t)?;
    let before = a.radius().ok().flatten();
    let radius = t.bench.fresh_radius();
    let command = a.stamped(Draft::new(2017).set("Loiter Radius", radius).acked());
    for base in [a.stamped(discovery()), command] {
        let right = a.data_length(&base);
        for wrong in [0, 1, right - 1, right + 1, 514, 515, 528, 529, 65_535] {
            let mut draft = base.clone();
            draft.length = Some(wrong);
            a.send_bytes(&a.encode(&draft));
            // As the first of two messages: neither may be read as part of the other.
            let mut both = a.encode(&draft);
            both.extend(a.encode(&a.stamped(discovery())));
            a.send_bytes(&both);
            t.pause(Duration::from_millis(5))?;
        }
    }
    t.pause(t.timers().quiet)?;
    let done = a.received(mark, |seen| {
        seen.kind() == 17000
            && seen.raw("Acknowledgement Type") == Some(2)
            && seen.raw("Original Message Type") == Some(2017)
    });
    t.expect(done.is_empty(), || {
        "expected no 'carried out' for a 2017 with a wrong length; 17000 type 2 came".into()
    })?;
    unharmed(t, &a, mark, "messages with wrong lengths")?;
    let after = a.radius().ok().flatten();
    t.expect(after == before, || format!("expected 2017s with wrong lengths to change nothing; the radius went from {before:?} to {after:?}"))
}

fn unknown_and_private_messages(t: &Trial) -> Judged {
    let (a, mark) = watched(t)?;
    for kind in [0, 6, 999, 24_001, 49_999, 50_555, 65_535] {
        let mut unknown = Draft::new(kind);
        unknown.data = Some(vec![0x80, 1, 2, 3, 4, 5, 6, 7]);
        a.send_bytes(&a.encode(&unknown));
        let mut answered = false;
        for _ in 0..2 {
            let sent = a.send_together(vec![unknown.clone(), information_request(3)]);
            if a.wait(sent, t.timers().answer, |seen| seen.kind() == 3)
                .is_some()
            {
                answered = true;
                break;
            }
        }
        t.expect(answered, || format!("expected the 17002 behind a message of type {kind} in one datagram to be answered; #3 did not come"))?;
    }
    unharmed(t, &a, mark, "unknown messages")
}

fn random_bytes(t: &Trial) -> Judged {
    let (a, mark) = watched(t)?;
    let before = a.radius().ok().flatten();
    let mut random = Sequence(0x5747_4e41_4734_3538);
    let valid = a.encode(&a.stamped(discovery()));
    for round in 0..4_000_u32 {
        let bytes = if round % 2 == 0 {
            let length = random.below(600);
            (0..length).map(|_| random.next() as u8).collect()
        } else {
            let mut bytes = valid.clone();
            for _ in 0..=random.below(8) {
                let place = random.below(bytes.len());
                bytes[place] ^= 1 << random.below(8);
            }
            bytes
        };
        a.flood(&bytes);
        if round % 5 == 4 {
            t.pause(Duration::from_millis(8))?;
        }
    }
    unharmed(t, &a, mark, "random datagrams")?;
    let after = a.radius().ok().flatten();
    t.expect(after == before, || format!("expected random datagrams to change nothing; the radius went from {before:?} to {after:?}"))
}

fn datagrams_of_unusual_size(t: &Trial) -> Judged {
    let (a, mark) = watched(t)?;
    let sizes = [0, 1, 15, 549, 1_472, 65_507];
    for round in 0..20 {
        for size in sizes {
            let mut bytes = a.encode(&a.stamped(discovery()));
            bytes.resize(size, 0);
            if round == 0 {
                let _ = a.send_bytes(&bytes);
            } else {
                a.flood(&bytes);
            }
        }
        t.pause(Duration::from_millis(50))?;
    }
    unharmed(t, &a, mark, "empty and oversized datagrams")
}

/// A curve with one coordinate set to this value.
fn curve(a: &Station, value: f64) -> Draft {
    Draft::new(50001)
        .set("Time Stamp", 1.0)
        .id("Vehicle ID", a.vehicle)
        .id("CUCS ID", a.id)
        .raw("P1 Waypoint No", 1)
        .raw("P4 Waypoint No", 2)
        .set("P2 Latitude", value)
        .set("P2 Longitude", 0.1)
        .set("P3 Latitude", 0.8)
        .set("P3 Longitude", 0.1)
        .acked()
}

fn nan_and_infinities(t: &Trial) -> Judged {
    let (a, mark) = watched(t)?;
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let sent = a.send(
            Draft::new(34000)
                .set("Set Forward Link Carrier Frequency (ADT)", value)
                .acked(),
        );
        // Edition 2.5 has floats in every waypoint, and no curve messages.
        let route = if t.of_edition_25() {
            Draft::new(13002)
                .raw("Waypoint Number", 1)
                .set("Waypoint to Latitude or Relative Y", value)
                .set("Waypoint to Longitude or Relative X", 0.1)
                .set("Waypoint to Altitude", value)
                .acked()
        } else {
            curve(&a, value)
        };
        a.send(route);
        t.pause(t.timers().quiet / 2)?;
        let done = a.received(sent.mark, |seen| {
            seen.kind() == 17000 && seen.raw("Acknowledgement Type") == Some(2)
        });
        if let Some(done) = done.first() {
            t.expect_of(done, false, || {
                format!("expected a field of {value} to be refused; 17000 type 2 came")
            })?;
        }
    }
    unharmed(t, &a, mark, "fields that are no number")
}

fn text_without_an_end(t: &Trial) -> Judged {
    let (a, mark) = watched(t)?;
    for byte in [b'A', 0xFF] {
        a.send(
            Draft::new(13000)
                .text("Mission ID", &[byte; 20])
                .raw("Mission Plan Mode", 3),
        );
        a.send(
            Draft::new(13001)
                .raw("Initial Waypoint Number", 0)
                .text("Route ID", &[byte; 33])
                .raw("Route Type", 2),
        );
        t.pause(t.timers().answer / 2)?;
    }
    a.send(transfer(5, "TEXT"));
    a.send(information_request(3));
    t.pause(t.timers().answer / 4)?;
    for seen in a.received(mark, |seen| seen.kind() == 14000) {
        let text = seen.text("Mission ID").unwrap_or_default();
        t.expect_of(&seen, text.len() <= 20 && seen.fields.is_ok(), || {
            format!("expected at most 20 characters of Mission ID in 14000, got {text:?}")
        })?;
    }
    unharmed(t, &a, mark, "texts without NUL")
}

fn messages_the_wrong_way_round(t: &Trial) -> Judged {
    let (a, mark) = watched(t)?;
    let held = a.request(0, Access::Request)?.raw("LOI Granted");
    let own = a.vehicle;
    let messages = [
        Draft::new(2)
            .raw("LOI Granted", 0x0F)
            .raw("Access Granted", 1),
        Draft::new(3001).raw("Select Flight Path Control Mode", 15),
        Draft::new(4000).raw("Latitude", 1).raw("Longitude", 1),
        Draft::new(14000).raw("Status", 1),
        Draft::new(16000)
            .raw("Priority", 4)
            .raw("Alert (Warning) ID", -7_777)
            .text("Text", b"FORGED"),
    ];
    for message in messages {
        a.send(message.clone().acked());
        a.send(message.from(own).to(a.id));
    }
    t.pause(t.timers().quiet)?;
    let forged = a.received(mark, |seen| {
        seen.kind() == 16000 && seen.text("Text").is_some_and(|text| text == "FORGED")
            || seen.kind() == 4000 && seen.raw("Latitude") == Some(1)
    });
    if let Some(forged) = forged.first() {
        t.expect_of(forged, false, || {
            format!(
                "expected a forged {} not to be believed or forwarded; it came back",
                forged.kind()
            )
        })?;
    }
    let after = a.request(0, Access::Request)?.raw("LOI Granted");
    t.expect(after == held, || {
        format!(
            "expected a forged #2 to change nothing; LOI Granted went from {held:?} to {after:?}"
        )
    })?;
    unharmed(t, &a, mark, "messages the wrong way round")
}

fn impossible_senders(t: &Trial) -> Judged {
    let a = t.any()?;
    let mark = t.bench.net.mark();
    let vehicle = a.vehicle;
    for source in [Id::BROADCAST, Id::NULL, Id(0), vehicle] {
        a.send(authorisation(loi::LOI2 | loi::LOI4, Access::Request).from(source));
        a.send(discovery().from(source));
    }
    t.pause(t.timers().quiet)?;
    let recording_mark = mark;
    let granted =
        t.all_received(|seen| seen.kind() == 2 && seen.raw("LOI Granted").unwrap_or_default() != 0);
    let _ = recording_mark;
    if let Some(granted) = granted.first() {
        t.expect_of(granted, false, || {
            format!(
                "expected no grant to an impossible sender; #2 to {} grants LOI 0x{:02x}",
                granted.piece.destination,
                granted.raw("LOI Granted").unwrap_or_default()
            )
        })?;
    }
    a.take(loi::LOI2)?;
    Ok(())
}

fn duplicated_and_reordered_datagrams(t: &Trial) -> Judged {
    let a = t.controller()?;
    let home = home(t, &a)?;
    clear(t, &a)?;
    let plan = Plan::zigzag(&home, "TWICE", &[1, 2, 3, 4]);
    let bytes: Vec<Vec<u8>> = plan
        .messages()
        .into_iter()
        .map(|message| a.encode(&a.stamped(message)))
        .collect();
    for index in [1, 0, 0, 3, 2, 2, 4, 1, 3, 4, 0] {
        a.send_bytes(&bytes[index]);
        t.pause(Duration::from_millis(3))?;
    }
    t.loaded.set(true);
    let found = run_transfer(t, &a, transfer(2, &plan.mission), t.timers().load)?;
    t.expect(found.status == Some(1), || format!("expected a route whose datagrams were doubled and reordered to load, got 14000 status {:?}", found.status))?;
    let back = download(t, &a, &plan.mission)?;
    if let Some(difference) = difference(&plan, &back, &t.bench) {
        return Err(Stop::fail(format!(
            "expected the download to equal the plan whose datagrams were doubled and reordered; {difference}"
        )));
    }
    let _ = waypoint;
    // A late repetition of an older setting must not replace a newer one.
    let (r1, r2) = (t.bench.fresh_radius(), t.bench.fresh_radius());
    let first = a.set_radius(r1);
    if !a.radius_becomes(r1)? {
        return Err(Stop::inconclusive("2017 does not change 3004"));
    }
    let second = a.set_radius(r2);
    for _ in 0..3 {
        a.send_bytes(&second.bytes);
        a.send_bytes(&first.bytes);
    }
    t.pause(Duration::from_millis(400))?;
    let shown = a.radius()?;
    t.expect(shown.is_some_and(|shown| (shown - r2).abs() < 0.8), || {
        format!("expected the latest 2017 by its stamp ({r2} m) to stay, 3004 shows {shown:?}")
    })
}
