//! Every message of the edition there and back, by vectors of another codec; and what is never sent.

use std::io::Read as _;

use stanag_msgs::ed25::{self, Value, Version};
use stanag_msgs::field::FieldInfo;
use stanag_msgs::table::{self, MESSAGES};

use super::*;

/// Messages that another codec has made: data and row.
fn vectors() -> Vec<(Vec<u8>, Vec<u8>)> {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../tests/data/dli/vectors-ed25-4586.jsonl.gz"
    );
    let (file, mut text) = (std::fs::File::open(path).unwrap(), String::new());
    flate2::read::GzDecoder::new(file)
        .read_to_string(&mut text)
        .unwrap();
    let wires = text.lines().map(|line| {
        let value: serde_json::Value = serde_json::from_str(line).unwrap();
        let hex = value["wire"].as_str().unwrap();
        let bytes = (0..hex.len() / 2).map(|at| u8::from_str_radix(&hex[2 * at..2 * at + 2], 16));
        bytes.collect::<Result<Vec<u8>, _>>().unwrap()
    });
    wires
        .map(|wire| {
            let frame = ed25::frames(&wire).next().unwrap().unwrap();
            (frame.data.to_vec(), wire.clone())
        })
        .collect()
}

/// How far a field may be off after it went through Edition 4.
fn tolerance(field: &FieldInfo, place: &FieldInfo) -> f64 {
    if field.unit == Some("s since 1970") {
        return 0.000_6;
    }
    place.step() * 0.51 + 1e-6
}

fn close(field: &FieldInfo, place: &FieldInfo, sent: &Value, back: &Value) -> bool {
    let (Value::Number(sent), Value::Number(back)) = (sent, back) else {
        return sent == back;
    };
    let mut apart = (sent - back).abs();
    if field.unit == Some("s since 1970") {
        // Edition 4 counts modulo its period.
        let period = TimeStamp::PERIOD_MS as f64 / 1e3;
        apart -= (apart / period).round() * period;
        return apart.abs() <= tolerance(field, place);
    }
    let turns = field.unit == Some("rad");
    let within = |apart: f64| apart <= tolerance(field, place) + sent.abs() * 1e-6;
    within(apart) || turns && within((apart - std::f64::consts::TAU).abs())
}

/// Two stations are sent #21 by the same vehicle: their instances differ whatever the clock, and the vehicle is one.
#[test]
fn the_first_instance_is_the_stamp_of_its_message_and_a_holder_is_shown_of_the_vehicles_type() {
    for ms in [800_000_000_000_u64, 800_000_000_000 + (1 << 31)] {
        let mut instances = Vec::new();
        for later in 0..2 {
            let mut translator = Translator::default();
            let stamp = TimeStamp(ms + later);
            let (vehicle, holder) = (Id(0x1b00_0101), Id(0x1b00_00a0));
            let line = (LoiBitmap::LOI4, 13);
            let bytes = translator.holder(Id(0x1b00_0001), vehicle, holder, line, stamp);
            let frame = ed25::frames(&bytes).next().unwrap().unwrap();
            let info = ed25::message(21, Version::Ed25).unwrap();
            assert_eq!(
                Record::read(info, frame.data).unwrap().number(10),
                Some(13.0)
            );
            instances.push(frame.header.instance);
        }
        assert_eq!(instances[0], ms as u32);
        assert_eq!(instances[1], ms as u32 + 1);
    }
}

/// Each field with a place in Edition 4 comes back from there as it was, for every message and every vector.
#[test]
fn fields_survive_the_way_through_edition_4() {
    let mut ways = 0;
    for (data, wire) in vectors() {
        let frame = ed25::frames(&wire).next().unwrap().unwrap();
        let header = frame.header;
        let info = ed25::message(header.message_type, header.version).unwrap();
        // Vectors keep to the ranges, but for times, which are moments from 2000 on.
        let Ok(record) = Record::read(info, &data) else {
            continue;
        };
        for target in info.ed4_messages {
            let target = table::message(*target).unwrap();
            let Ok(there) = record.to_ed4(target).and_then(|there| there.message()) else {
                continue;
            };
            let there = Record::of(&there);
            let mut back = Record::new(info);
            back.take_from(&there);
            ways += 1;
            for field in info.fields {
                let Some((message, number)) = field.ed4.filter(|(id, _)| *id == target.id) else {
                    continue;
                };
                let place = &table::message(message).unwrap().fields[usize::from(number) - 1];
                let of = |record: &Record| record.value(field.bit + 1);
                match (of(&record), of(&back)) {
                    (Some(sent), Some(back)) => assert!(
                        close(field, place, &sent, &back),
                        "{} {}: {sent:?} came back as {back:?}",
                        info.id,
                        field.name
                    ),
                    (sent, back) => assert_eq!(sent, back, "{} {}", info.id, field.name),
                }
            }
        }
    }
    assert!(ways > 80, "{ways}");
}

/// Every message that a VSM sends is whole: it has its length, its sum, and every field within its range.
#[test]
fn whatever_edition_4_says_is_a_whole_message_of_edition_25_or_none() {
    let mut made = std::collections::BTreeSet::new();
    for info in MESSAGES {
        let mut translator = Translator::default();
        let Some(message) = Message::empty(info.id) else {
            continue;
        };
        let envelope = Envelope::new(Id(0x1b00_0101), Id(0x1b00_00a0));
        let message = message.stamped(TimeStamp(800_000_000_000));
        if Record::of(&message).number(1).is_none() {
            // Of a kind that this VSM never sends.
            continue;
        }
        for bytes in translator.outbound(&envelope, envelope.source, &message) {
            for frame in ed25::frames(&bytes) {
                let frame = frame.unwrap();
                let info = ed25::message(frame.header.message_type, Version::Ed25).unwrap();
                assert_eq!(frame.data.len(), info.full_bytes());
                Record::read(info, frame.data)
                    .unwrap_or_else(|fault| panic!("{}: {fault}", info.id));
                made.insert(info.id);
            }
        }
    }
    // What needs more than an empty message: an acknowledgement of something, a position, a waypoint of a plan.
    for number in [
        20, 21, 100, 102, 103, 105, 106, 107, 108, 110, 700, 900, 1100, 1101, 1203, 1304,
    ] {
        assert!(made.contains(&number), "{number} of {made:?}");
    }
}

#[test]
fn nothing_is_reported_before_it_is_known_and_what_is_absent_keeps_its_last_value() {
    use stanag_msgs::messages::InertialStates;
    use stanag_msgs::scalar::Altitude;
    use stanag_msgs::{Bam16, Bam32};
    let mut translator = Translator::default();
    let envelope = Envelope::new(Id(0x1b00_0101), Id(0x1b00_00a0));
    let mut ms = 800_000_000_000;
    let mut report = |translator: &mut Translator, states: InertialStates| {
        ms += 1;
        let message = Message::from(states).stamped(TimeStamp(ms));
        let all = translator.outbound(&envelope, envelope.source, &message);
        all.first().map(|bytes| {
            let frame = ed25::frames(bytes).next().unwrap().unwrap();
            Record::read(ed25::message(101, Version::Ed25).unwrap(), frame.data).unwrap()
        })
    };
    let attitude = InertialStates {
        roll: Some(Bam16::from_radians(0.25)),
        ..InertialStates::default()
    };
    assert!(
        report(&mut translator, attitude).is_none(),
        "no position is known"
    );
    let place = InertialStates {
        latitude: Some(Bam32::from_degrees(47.0)),
        longitude: Some(Bam32::from_degrees(8.0)),
        altitude: Some(Altitude::from_si(500.0).unwrap()),
        ..InertialStates::default()
    };
    let known = report(&mut translator, place).expect("a position");
    assert!((known.number(4).unwrap() - 47_f64.to_radians()).abs() < 1e-8);
    assert!(
        (known.number(14).unwrap() - 0.25).abs() < 1e-4,
        "roll as it was last"
    );
    assert!(
        report(&mut translator, InertialStates::default()).is_none(),
        "an old position is none"
    );
}

#[test]
fn texts_name_messages_by_the_numbers_of_the_edition() {
    let requests = Requests::default();
    let own = |text: &str| requests.in_own_numbers(text);
    assert_eq!(
        own("13000 of 1b:00:00:b0 refused"),
        "#800 of 1b:00:00:b0 refused"
    );
    assert_eq!(
        own("3001 (Vehicle Operating Mode Report) refused"),
        "#106 (Vehicle Operating Mode Report) refused"
    );
    assert_eq!(
        own("message 13001 (UA Route) of 1b:00:00:b0 refused"),
        "message #801 (AV Route) of 1b:00:00:b0 refused"
    );
    assert_eq!(
        own("message 2005 is not supported"),
        "message #46 is not supported"
    );
    assert_eq!(own("load it again (13000)"), "load it again (#800)");
    assert_eq!(
        own(
            "1 (CUCS Authorisation Request) refused: message 2 (VSM Authorisation Response) is sent by a VSM"
        ),
        "#1 (CUCS Authorisation Request) refused: message #21 (VSM Authorisation Response) is sent by a VSM"
    );
    assert_eq!(
        own(
            "the upload was dropped: a 13001 has begun another: send the whole route, with its 13001, then 13000"
        ),
        "the upload was dropped: a #801 has begun another: send the whole route, with its #801, then #800"
    );
    assert_eq!(
        own("the upload was dropped: it was cancelled (13000 mode 5)"),
        "the upload was dropped: it was cancelled (#800 mode 5)"
    );
    assert_eq!(
        own("dropped: 13000 mode 1 has cleared"),
        "dropped: #800 mode 1 has cleared"
    );
    for values in [
        "climbs to 3000 m, 13002 m",
        "mode 20 (wave-off): the 3000 m, and 2000 m (4000 m above)",
        "a limit: 2000 bytes, then 3000 m/s",
        "mode 2 (flight director): LOI 2 (monitor)",
    ] {
        assert_eq!(own(values), values);
    }
}

/// #42, #43 and #48 all become a 2016: a refusal names the one that it answers, whichever was sent last.
#[test]
fn a_refusal_names_the_message_that_it_answers() {
    let mut translator = Translator::default();
    let mut stamps = Vec::new();
    for (number, seconds) in [(48, 1.7e9), (43, 1.7e9 + 1.0), (42, 1.7e9 + 2.0)] {
        let mut record = new(number);
        record.set(1, seconds);
        stamps.push(record.stamp().expect("a moment"));
        translator.requests.sent(2016, &record, 1);
    }
    let named = |stamp: &TimeStamp| translator.made_from(2016, *stamp).expect("it was sent");
    assert!(named(&stamps[0]).starts_with("#48 ("));
    assert!(named(&stamps[1]).starts_with("#43 ("));
    assert!(named(&stamps[2]).starts_with("#42 ("));
    let later = TimeStamp(stamps[2].0 + 1);
    assert_eq!(translator.made_from(2016, later), None);
}

/// A message of a station with every number in the middle of its range.
fn middling(info: &'static table::MessageInfo) -> Record {
    let mut record = Record::new(info);
    for field in info.fields {
        let number = field.bit + 1;
        match (field.wire, field.range) {
            (table::Wire::Char(_), _) => record.set_text(number, "A"),
            _ if field.unit == Some("s since 1970") => record.set(number, 1.7e9),
            (_, Some((low, high))) => record.set(number, (low + (high - low) * 0.3).round()),
            _ => record.set(number, 1),
        }
    }
    record
}

/// What it becomes for a station that controls a vehicle in this mode, with this preference.
fn becomes(record: &Record, mode: u8, preference: u8) -> Option<Vec<Message>> {
    let vehicle = Id(0x1b00_0101);
    let mut translator = Translator::default();
    let steering = translator.steering.entry(vehicle).or_default();
    steering.granted(LoiBitmap::from_raw(0x0f));
    steering.shows(Some(mode));
    steering.accept(Latch::Preference([preference; 3]), false);
    let at = Parties {
        cucs: Id(0x1b00_00a0),
        vehicle,
        info: None,
    };
    let standing = Standing {
        vsm: Id(0x1b00_0001),
        named: vehicle,
        stamp: TimeStamp(800_000_000_000),
        web_page: None,
    };
    let mut taken = Inbound::default();
    let none = mapping::plan::Plan::default();
    let upload = Upload {
        plan: &none,
        sent: None,
    };
    translator
        .take(record, &at, &standing, &upload, &mut taken)
        .ok()?;
    Some(taken.messages.into_iter().map(|(_, one)| one).collect())
}

/// A field that Edition 4 honours, and that has a place here, changes what the bridge is commanded, in some state at least.
#[test]
fn every_honoured_field_of_a_station_reaches_the_bridge() {
    use mapping::support::{Received, field as supported};
    let mut seen = 0;
    for info in ed25::messages().filter(|info| info.direction != Direction::ToCucs) {
        for field in info.fields {
            let Some((message, number)) = field.ed4 else {
                continue;
            };
            let target = table::message(message).unwrap();
            let place = &target.fields[usize::from(number) - 1];
            // The mode of #43 is that of #42, and an acknowledgement proves an address.
            if !matches!(supported(target, place).received, Received::Honoured(_))
                || info.id == 1400
            {
                continue;
            }
            let changed_number = field.bit + 1;
            let selectors = info.fields.iter().filter(|one| one.wire == table::Wire::U8);
            let selectors: Vec<u8> = selectors.map(|one| one.bit + 1).collect();
            let mut states = vec![(0, 0)];
            states.extend(
                selectors
                    .iter()
                    .flat_map(|one| (0..6).map(|value| (*one, value))),
            );
            let reaches = states.iter().any(|(selector, value)| {
                [(15, 0), (12, 2), (11, 2)]
                    .iter()
                    .any(|(mode, preference)| {
                        let mut base = middling(info);
                        if *selector != 0 {
                            base.set(*selector, *value);
                        }
                        // Messages are named, where one is, by one that this VSM sends.
                        match info.id {
                            1200 => base.set(7, 43),
                            1402 => base.set(4, 101),
                            1403 => base.set(7, 101),
                            _ => {}
                        }
                        (0..8).any(|step| {
                            let mut other = base.clone();
                            match base.value(changed_number) {
                                Some(Value::Text(_)) => other.set_text(changed_number, "B"),
                                Some(Value::Number(was)) if field.unit == Some("rad") => {
                                    other.set(changed_number, was + 0.1);
                                }
                                Some(Value::Number(was)) => {
                                    other.set(changed_number, was + f64::from(1 << step));
                                }
                                None => return false,
                            }
                            let (one, two) = (
                                becomes(&base, *mode, *preference),
                                becomes(&other, *mode, *preference),
                            );
                            one.is_some() && two.is_some() && one != two
                        })
                    })
            });
            assert!(reaches, "#{}.{:02} {}", info.id, changed_number, field.name);
            seen += 1;
        }
    }
    assert!(seen > 60, "{seen}");
}

/// A station that commands the loiter which the vehicle shows already, and the place at once after it: the place is not lost in
/// the moment in which the vehicle enters the mode again.
#[test]
fn a_place_right_after_a_loiter_names_the_mode_again() {
    let mut steering = Steering::default();
    let record = |number: u16, fields: &[(u8, f64)]| {
        let mut record = new(number);
        for (field, value) in fields {
            record.set(*field, *value);
        }
        record
    };
    let seconds = 1_163_000_000.0;
    steering.shows(Some(12));
    steering.accept(Latch::Preference([2, 2, 2]), false);
    steering.accept(Latch::Mode(12, seconds), false);
    let demand = |at: f64| {
        record(
            43,
            &[(1, at), (4, 0.0), (7, 0.0), (13, 0.0), (18, 0.8), (19, 0.1)],
        )
    };
    let mode = |steering: &Steering, at: f64| {
        let order = steering
            .order(&demand(at))
            .unwrap_or_else(|_| panic!("refused"));
        Record::of(&order.message).number(2)
    };
    assert_eq!(mode(&steering, seconds + 0.1), Some(12.0));
    steering.shows(Some(12));
    assert_eq!(mode(&steering, seconds + 0.2), Some(12.0));
    // Later it is a demand within the mode.
    assert_eq!(mode(&steering, seconds + 60.0), None);
}
