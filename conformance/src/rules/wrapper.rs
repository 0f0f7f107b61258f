//! WRAP, wrapper and checksum: lengths, several messages in a datagram, checksum styles, versions, and addresses.

use stanag_msgs::Id;

use super::scene::Scene;
use crate::bench::flight::{mode_command, reported_mode};
use crate::bench::station::{Access, authorisation, discovery, information_request, loi};
use crate::bench::trial::{Player, Trial};
use crate::verdict::{Judged, Precondition, Stop};
use crate::wire::{Draft, trailer};

/// The largest datagram that every side has to accept, bytes.
const MAX_DATAGRAM: usize = 548;

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "WRAP-003",
        play: length_counts_data_only,
    },
    Scene {
        rule: "WRAP-004",
        play: no_datagram_over_548_bytes,
    },
    Scene {
        rule: "WRAP-005",
        play: several_messages_in_one_datagram,
    },
    Scene {
        rule: "WRAP-007",
        play: every_style_is_understood,
    },
    Scene {
        rule: "WRAP-008",
        play: crc_32_is_understood,
    },
    Scene {
        rule: "WRAP-009",
        play: damaged_message_is_dropped,
    },
    Scene {
        rule: "WRAP-013",
        play: foreign_version_is_not_guessed_at,
    },
    Scene {
        rule: "WRAP-014",
        play: reserved_parts_are_ignored,
    },
    Scene {
        rule: "WRAP-017",
        play: only_what_is_addressed_to_it,
    },
];

/// Bytes before the data in the wrapper of Edition 2.5.
const HEADER_25: usize = stanag_msgs::ed25::HEADER_BYTES;

/// Whether any message 2 is sent to the station within `quiet` of these bytes.
fn answered(t: &Trial, station: &Player, bytes: &[u8]) -> bool {
    let mark = station.send_bytes(bytes);
    station
        .wait(mark, t.timers().quiet, |seen| seen.kind() == 2)
        .is_some()
}

fn discovery_of(station: &Player) -> Draft {
    station.stamped(authorisation(0, Access::Release))
}

fn length_counts_data_only(t: &Trial) -> Judged {
    let station = t.any()?;
    let right = discovery_of(&station);
    let mut wrong = right.clone();
    wrong.length = Some(station.data_length(&wrong) + station.wrapper_bytes() as u16);
    t.expect(!answered(t, &station, &station.encode(&wrong)), || {
        "expected no answer to #1 whose length counts the header as well; message 2 came".into()
    })?;
    let found = station.request(0, Access::Release)?;
    t.cite(&found);
    Ok(())
}

fn no_datagram_over_548_bytes(t: &Trial) -> Judged {
    let station = t.monitor()?;
    let mark = t.bench.net.mark();
    for kind in [43000, 3, 3000, 21000] {
        station.send(information_request(kind));
    }
    station.send(super::configuration::request(1));
    let complete = station.wait(mark, t.timers().config / 2, |seen| seen.kind() == 41005);
    t.note(format!(
        "a full configuration was {}",
        if complete.is_some() {
            "received"
        } else {
            "not completed"
        }
    ));
    let longest = {
        let recording = t.bench.net.recording();
        let of_subject = recording.datagrams[mark..]
            .iter()
            .filter(|datagram| datagram.direction == crate::wire::Direction::Received);
        of_subject
            .map(|datagram| datagram.bytes.len())
            .max()
            .unwrap_or(0)
    };
    t.expect(longest <= 548, || {
        format!("expected at most 548 bytes of UDP payload, got {longest}")
    })
}

fn several_messages_in_one_datagram(t: &Trial) -> Judged {
    let station = t.any()?;
    for attempt in 1..=3 {
        let mark = station.send_together(vec![
            discovery(),
            information_request(3),
            authorisation(loi::LOI2, Access::Request),
        ]);
        let granted = station.wait(mark, t.timers().answer, |seen| {
            seen.kind() == 2 && seen.raw("LOI Granted").unwrap_or_default() & loi::LOI2 != 0
        });
        let vehicle = station.wait(mark, t.timers().answer / 2, |seen| seen.kind() == 3);
        let discovered = !station.received(mark, |seen| seen.kind() == 2).is_empty();
        if granted.is_some() && vehicle.is_some() {
            break;
        }
        if attempt == 3 {
            return Err(Stop::fail(format!(
                "expected answers to all three messages of one datagram; discovery answered: {discovered}, #3 came: {}, LOI 2 granted: {}",
                vehicle.is_some(),
                granted.is_some()
            )));
        }
    }
    // As many as fit in a datagram: the last of them counts like the first.
    for attempt in 1..=2 {
        let last = information_request(3);
        let room =
            MAX_DATAGRAM.saturating_sub(station.encode(&station.stamped(last.clone())).len());
        let fit = room / station.encode(&station.stamped(discovery())).len().max(1);
        let mut many = vec![discovery(); fit.min(7)];
        many.push(last);
        let mark = station.send_together(many);
        let last = station.wait(mark, t.timers().answer, |seen| seen.kind() == 3);
        if last.is_some() {
            break;
        }
        t.expect(attempt == 1, || {
            "expected the last of the messages that fit into one datagram to be answered; #3 did not come"
                .into()
        })?;
    }
    Ok(())
}

fn ask_in_style(t: &Trial, station: &Player, style: u8) -> Judged {
    let mut draft = authorisation(0, Access::Release);
    draft.style = Some(style);
    let found = station.ask(
        draft,
        t.timers().answer,
        &format!("message 2 to #1 in checksum style {style}"),
        |seen| seen.kind() == 2,
    )?;
    t.cite(&found);
    let (value, expected) = found.piece.checksums();
    t.expect(value == expected, || {
        format!(
            "expected checksum 0x{expected:x} of style {} over header and data, got 0x{value:x}",
            found.piece.style()
        )
    })
}

fn every_style_is_understood(t: &Trial) -> Judged {
    let station = t.any()?;
    for style in [0, 1, 2] {
        ask_in_style(t, &station, style)?;
    }
    // A byte sum beyond 16 bits in style 2: an unknown message of bytes 0xFF before a good one. The same with bytes 0
    // shows whether the subject reads past an unknown message at all.
    let behind = |byte: u8| {
        let mut long = Draft::new(50_555);
        long.data = Some(vec![byte; 480]);
        long.style = Some(2);
        let mut question = information_request(3);
        question.style = Some(2);
        let mark = station.send_together(vec![long, question]);
        station
            .wait(mark, t.timers().answer, |seen| seen.kind() == 3)
            .is_some()
    };
    if behind(0) && !behind(0xFF) && !behind(0xFF) {
        return Err(Stop::fail(
            "expected a 17002 behind a message with a byte sum above 65,535 (style 2) to be answered, as it is behind one with a small sum; it is not: the sum is kept in 16 bits",
        ));
    }
    Ok(())
}

fn crc_32_is_understood(t: &Trial) -> Judged {
    let station = t.any()?;
    ask_in_style(t, &station, 3)?;
    let mut draft = discovery_of(&station);
    draft.style = Some(3);
    let mut bytes = station.encode(&draft);
    if let Some(last) = bytes.last_mut() {
        *last ^= 0x40;
    }
    t.expect(!answered(t, &station, &bytes), || {
        "expected nothing to #1 with a wrong CRC-32; message 2 came".into()
    })
}

fn damaged_message_is_dropped(t: &Trial) -> Judged {
    let a = t.controller()?;
    t.expect(a.commands_work()?, || {
        "expected 2017 of the holder in 3004".into()
    })
    .precondition("commands work")?;
    let before = a.radius()?;
    let radius = t.bench.fresh_radius();
    let mut draft = a
        .stamped(Draft::new(2017).set("Loiter Radius", radius))
        .acked();
    let styles: &[u8] = if t.of_edition_25() { &[2] } else { &[1, 2] };
    let mark = t.bench.net.mark();
    for &style in styles {
        draft.style = Some(style);
        let bytes = a.encode(&draft);
        for bit in 0..16 {
            // Damage in source, destination and data only: lengths, versions and styles are judged by other rules.
            let header = if t.of_edition_25() { 10..14 } else { 4..12 };
            let data = a.wrapper_bytes().min(HEADER_25)..bytes.len();
            let places = header.chain(data).collect::<Vec<_>>();
            let place = places[bit * 5 % places.len()];
            let mut damaged = bytes.clone();
            damaged[place] ^= 1 << (bit % 8);
            a.send_bytes(&damaged);
        }
        // Each byte of the sum counts, and each message of a datagram has its own sum.
        for place in bytes.len() - trailer(style)..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[place] ^= 1;
            a.send_bytes(&damaged);
            let mut second = a.encode(&a.stamped(information_request(3)));
            second.extend(damaged);
            a.send_bytes(&second);
        }
    }
    let answer = a.wait(mark, t.timers().quiet, |seen| seen.kind() == 17000);
    t.expect_none(answer, |_| {
        format!("expected nothing to a damaged 2017 (checksum styles {styles:?}); 17000 came")
    })?;
    let after = a.radius()?;
    t.expect(after == before, || format!("expected the loiter radius to stay {before:?} after damaged 2017s; 3004 shows {after:?}"))?;
    // A request for control with a wrong sum must grant nothing.
    let b = t.b().ok();
    if let Some(b) = &b {
        let mut bytes = b.encode(&b.stamped(discovery_of(b)));
        if let Some(last) = bytes.last_mut() {
            *last ^= 0x55;
        }
        let style_is_summed = t.bench.profile.subject.checksum != 0;
        t.expect(!style_is_summed || !answered(t, b, &bytes), || {
            "expected nothing to #1 with a wrong checksum; message 2 came".into()
        })?;
    }
    t.expect(a.commands_work()?, || {
        "expected the undamaged 2017 to work".into()
    })
}

fn foreign_version_is_not_guessed_at(t: &Trial) -> Judged {
    let a = t.controller()?;
    t.expect(a.commands_work()?, || {
        "expected 2017 of the holder in 3004".into()
    })
    .precondition("commands work")?;
    let before = a.radius()?;
    let sent: Vec<_> = [99, 1]
        .into_iter()
        .map(|version| {
            let mut draft = Draft::new(2017)
                .set("Loiter Radius", t.bench.fresh_radius())
                .acked();
            draft.idd = Some(version);
            (version, a.send(draft))
        })
        .collect();
    let b = t.b().ok();
    let request = b.as_ref().map(|b| {
        let mut draft = authorisation(loi::LOI2, Access::Request);
        draft.idd = Some(99);
        b.send(draft)
    });
    t.pause(t.timers().quiet)?;
    for (version, sent) in &sent {
        let done = a.received(sent.mark, |seen| {
            seen.kind() == 17000
                && seen.raw("Acknowledgement Type") == Some(2)
                && seen.raw("Original Message Time Stamp") == Some(sent.stamp)
        });
        t.expect(done.is_empty(), || {
            format!(
                "expected no 'carried out' for a 2017 of IDD version {version}; 17000 type 2 came"
            )
        })?;
    }
    let after = a.radius()?;
    t.expect(after == before, || format!("expected 2017s of IDD versions 99 and 1 to change nothing; the radius went from {before:?} to {after:?}"))?;
    if let (Some(b), Some(request)) = (&b, &request) {
        let granted = b.received(request.mark, |seen| {
            seen.kind() == 2 && seen.raw("LOI Granted").unwrap_or_default() != 0
        });
        t.expect(granted.is_empty(), || {
            "expected #1 of IDD version 99 to be granted nothing; LOI 2 was granted".into()
        })?;
    }
    t.expect(a.commands_work()?, || {
        "expected the same in the right version to work".into()
    })?;
    the_version_of_one_is_not_everybodys(t, &a)
}

/// A CUCS may be answered in the version in which it sends; what the others are sent keeps the profile's version,
/// which WRAP-012 judges.
fn the_version_of_one_is_not_everybodys(t: &Trial, a: &Player) -> Judged {
    let version = t.bench.profile.idd();
    let Some(c) = t.b().ok().filter(|_| (31..=32).contains(&version)) else {
        return Ok(());
    };
    let mut foreign = discovery();
    foreign.idd = Some(version - 1);
    c.send(foreign);
    t.pause(t.timers().answer / 4)?;
    a.query(3)?;
    c.discover()?;
    Ok(())
}

fn reserved_parts_are_ignored(t: &Trial) -> Judged {
    let station = t.any()?;
    for (word, bits) in [(0, 0), (0xFFFF, 0), (0x1234, 0), (0, 0x3F)] {
        let mut draft = authorisation(0, Access::Release);
        draft.reserved = Some(word);
        draft.property_bits = bits;
        station.ask(
            draft,
            t.timers().answer,
            &format!("message 2 to #1 with first word 0x{word:04x} and property bits 0x{bits:02x}"),
            |seen| seen.kind() == 2,
        )?;
    }
    Ok(())
}

fn only_what_is_addressed_to_it(t: &Trial) -> Judged {
    let a = t.controller()?;
    t.expect(a.commands_work()?, || {
        "expected 2017 of the holder in 3004".into()
    })
    .precondition("commands work")?;
    let (before, mode) = (a.radius()?, reported_mode(&a)?);
    let known: Vec<Id> = t.bench.surveyed()?.vehicle_ids().collect();
    let foreign = (1..)
        .map(|step| Id(a.vehicle.0.wrapping_add(0x0000_4200 + step)))
        .find(|id| !known.contains(id))
        .unwrap_or(Id(0x1b00_7fff));
    let radius = t.bench.fresh_radius();
    let sent = a.send(
        Draft::new(2017)
            .set("Loiter Radius", radius)
            .acked()
            .to(foreign),
    );
    a.send(mode_command(12).to(foreign).acked());
    let answer = a.wait(sent.mark, t.timers().quiet, |seen| seen.kind() == 17000);
    if let Some(answer) = answer {
        t.expect_of(&answer, false, || format!("expected nothing to commands for {foreign}, which is no vehicle of the subject; 17000 came"))?;
    }
    let after = a.radius()?;
    t.expect(after == before, || format!("expected a 2017 for {foreign} to change nothing; the radius of {} went from {before:?} to {after:?}", a.vehicle))?;
    // To the broadcast id, the null id, and the station itself: a setting needs a single vehicle as destination.
    for (to, what) in [
        (Id::BROADCAST, "everybody"),
        (Id::NULL, "nobody"),
        (a.id, "the CUCS itself"),
    ] {
        let sent = a.send(
            Draft::new(2017)
                .set("Loiter Radius", t.bench.fresh_radius())
                .acked()
                .to(to),
        );
        let done = a.wait(sent.mark, t.timers().quiet / 2, |seen| {
            seen.kind() == 17000 && seen.raw("Acknowledgement Type") == Some(2)
        });
        t.expect(done.is_none(), || {
            format!(
                "expected no 'carried out' for a 2017 addressed to {what} ({to}); 17000 type 2 came"
            )
        })?;
        let after = a.radius()?;
        t.expect(after == before, || format!("expected a 2017 addressed to {what} ({to}) to change nothing; the radius of {} went from {before:?} to {after:?}", a.vehicle))?;
    }
    let now = reported_mode(&a)?;
    t.expect(now == mode || now != Some(12), || format!("expected a 2016 for {foreign} to change nothing; 3001 of {} went from {mode:?} to {now:?}", a.vehicle))
}
