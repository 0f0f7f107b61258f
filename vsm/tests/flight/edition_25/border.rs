//! What is dropped and refused by name, and that no edition is a way around the rules of another.

use std::net::SocketAddr;

use kit::bridge::vehicle_id;
use serde_json::json;
use stanag_msgs::ed25;
use vsm::session::findings::Code;

use super::*;

pub(super) fn count(rig: &Rig, name: &str) -> u64 {
    let bridge = rig.bridge.as_ref().unwrap();
    bridge
        .status(String::new(), rig.now().mono)
        .refused
        .get(name)
}

#[test]
fn malformed_datagrams_are_dropped_by_name() {
    let (mut rig, mut station) = rig();
    let good = station.datagram(&rig, vehicle_id(0), 1, &json!({ "VSM ID": -1 }));
    let sum = |bytes: &mut Vec<u8>| {
        let end = bytes.len() - 4;
        let sum: u32 = bytes[..end].iter().map(|byte| u32::from(*byte)).sum();
        bytes[end..].copy_from_slice(&sum.to_be_bytes());
    };
    let changed = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = good.clone();
        change(&mut bytes);
        let end = bytes.len() - 4;
        let sum: u32 = bytes[..end].iter().map(|byte| u32::from(*byte)).sum();
        bytes[end..].copy_from_slice(&sum.to_be_bytes());
        bytes
    };
    let mut wrong_sum = good.clone();
    *wrong_sum.last_mut().unwrap() ^= 1;
    let mut text = station.datagram(&rig, vehicle_id(0), 800, &json!({ "Mission Plan Mode": 5 }));
    text[30 + 16..30 + 36].fill(b'A');
    sum(&mut text);
    let mut nan = station.datagram(&rig, vehicle_id(0), 43, &json!({}));
    nan[30 + 17..30 + 21].copy_from_slice(&f32::NAN.to_be_bytes());
    sum(&mut nan);
    let far = station.datagram(
        &rig,
        vehicle_id(0),
        43,
        &json!({ "Commanded Altitude": 2e5 }),
    );
    let down = station.datagram(&rig, vehicle_id(0), 101, &json!({}));
    let stranger = changed(&|bytes| bytes[30 + 15] ^= 0x40);
    let other_vehicle = changed(&|bytes| bytes[30 + 11] ^= 0x40);
    let unknown = changed(&|bytes| bytes[14..18].copy_from_slice(&1999_u32.to_be_bytes()));
    let version = changed(&|bytes| bytes[..3].copy_from_slice(b"2.7"));
    let mut short = good.clone();
    short.truncate(50);
    for (bytes, name) in [
        (wrong_sum, "wrong checksum"),
        (short, "truncated"),
        (version, "unknown IDD version"),
        (unknown, "unknown message type"),
        (stranger, "unauthorised source"),
        (other_vehicle, "misaddressed"),
        (text, "unterminated text"),
        (nan, "not a number"),
        (far, "out of range"),
        (down, "our own"),
    ] {
        let before = count(&rig, name);
        rig.deliver_from(station.address, &bytes);
        rig.run(0.3);
        assert_eq!(count(&rig, name), before + 1, "{name}");
    }
    // A length that is not the message's.
    let mut long = good.clone();
    long.splice(65..65, [0; 4]);
    long[18..22].copy_from_slice(&39_u32.to_be_bytes());
    let end = long.len() - 4;
    let total: u32 = long[..end].iter().map(|byte| u32::from(*byte)).sum();
    long[end..].copy_from_slice(&total.to_be_bytes());
    rig.deliver_from(station.address, &long);
    rig.run(0.3);
    assert_eq!(count(&rig, "bad length"), 1);
    let alerts = station.alerts(&rig).concat();
    assert!(
        alerts.contains("Commanded Altitude 200000, expected -1000 to 100000 m"),
        "{alerts}"
    );
}

#[test]
fn what_edition_4_has_no_message_for_is_refused_by_name() {
    let (mut rig, mut station) = ready();
    for number in [47, 203, 400, 1500, 202] {
        station.send(&mut rig, vehicle_id(0), number, &json!({}));
        rig.run(0.5);
    }
    let alerts = station.alerts(&rig).join("|");
    for number in [47, 203, 400, 1500, 202] {
        let named =
            alerts.contains(&format!("#{number} ")) || alerts.contains(&format!("{number} of"));
        assert!(named, "#{number} in {alerts}");
    }
    mode(&mut rig, &mut station, 2);
    mode(&mut rig, &mut station, 25);
    rig.run(0.5);
    let alerts = station.alerts(&rig).join("|");
    assert!(
        alerts.contains("sticks") && alerts.contains("reserved"),
        "{alerts}"
    );
}

#[test]
fn a_command_needs_its_level_and_a_repetition_does_nothing() {
    let (mut rig, mut station) = rig();
    request(&mut rig, &mut station, 1, 1);
    station.send(
        &mut rig,
        vehicle_id(0),
        42,
        &json!({ "Select Flight Path Control Mode": 21 }),
    );
    station.send(&mut rig, vehicle_id(0), 48, &json!({ "Altitude Mode": 2 }));
    rig.run(0.5);
    assert_eq!(count(&rig, "without the right"), 2);
    assert!(
        station.take(&rig, 109).is_empty(),
        "a preference without the right is none"
    );
    // Repeated: once carried out.
    request(&mut rig, &mut station, 0x0f, 1);
    let order = station.datagram(&rig, vehicle_id(0), 41, &json!({ "Loiter Type": 4 }));
    rig.deliver_from(station.address, &order);
    rig.run(0.3);
    rig.deliver_from(station.address, &order);
    rig.run(0.3);
    assert_eq!(count(&rig, "duplicate"), 1);
}

#[test]
fn a_recorded_demand_is_not_kept_for_the_next_mode() {
    let (mut rig, mut station) = ready();
    let demand =
        json!({ "Altitude Command Type": 1, "Commanded Altitude": 60.0, "Altitude Type": 2 });
    let recorded = station.datagram(&rig, vehicle_id(0), 43, &demand);
    // It was held back for over a minute; the station has sent other things since.
    for _ in 0..14 {
        rig.run(5.0);
        station.send(
            &mut rig,
            vehicle_id(0),
            1403,
            &json!({ "Message Type": 106 }),
        );
    }
    rig.deliver_from(station.address, &recorded);
    rig.run(0.3);
    let bridge = rig.bridge.as_ref().unwrap();
    let refused = bridge.status(String::new(), rig.now().mono).refused;
    assert_eq!(refused.get("late"), 1, "{refused:?}");
    mode(&mut rig, &mut station, 21);
    rig.run(5.0);
    assert!(
        rig.truth().landed,
        "a launch without an altitude of its own is refused"
    );
}

#[test]
fn a_station_speaks_one_edition_at_a_time() {
    let (mut rig, mut station) = ready();
    // Its id in Edition 4, from its own address.
    let beat = stanag_msgs::Message::from(stanag_msgs::messages::Heartbeat {
        time_stamp: Some(stanag_msgs::TimeStamp(1)),
    });
    let mut bytes = [0; 548];
    let envelope = stanag_msgs::Envelope::new(CUCS, vehicle_id(0));
    let length = beat.encode(&envelope, &mut bytes).unwrap();
    rig.deliver_from(station.address, &bytes[..length]);
    rig.run(0.3);
    assert_eq!(count(&rig, "another edition"), 1);
    // Whoever looks for the cause of its silence finds it.
    let bridge = rig.bridge.as_ref().expect("it runs");
    let findings = bridge.status(String::new(), rig.now().mono).findings;
    let found = findings.iter().find(|one| one.code == Code::DliEdition);
    let cause = found.map_or("", |one| one.cause.as_str());
    assert!(
        cause.contains("sends in Edition 4") && cause.contains("until 10 s after"),
        "{findings:?}"
    );
    // Station 0 speaks Edition 4, and nothing of Edition 2.5 is taken in its name.
    assert!(
        rig.carry_out(orders::transfer(
            stanag_msgs::enums::MissionPlanMode::Download
        ))
        .is_some()
    );
    let mut forged = StationEd25::new(rig.stations[0].id, rig.stations[0].address);
    forged.send(
        &mut rig,
        vehicle_id(0),
        1,
        &json!({ "VSM ID": -1, "Requested/Handover LOI": 15, "Controlled Station Mode": 2 }),
    );
    rig.run(0.3);
    let seen = count(&rig, "another edition");
    assert!(seen >= 1, "{seen}");
    station.receive(&rig);
}

/// What counts of an address that proves nothing is what is sent there, in the edition in which it is sent.
#[test]
fn an_unproven_address_is_sent_three_times_what_it_sent_at_most_in_its_own_edition() {
    let sequences: [(&str, &[(u16, Value)]); 5] = [
        ("discovery", &[(1, json!({ "VSM ID": -1 }))]),
        (
            "LOI 2 to 5",
            &[(
                1,
                json!({ "Requested/Handover LOI": 0x0f, "Controlled Station Mode": 1 }),
            )],
        ),
        ("configuration", &[(1403, json!({ "Message Type": 101 }))]),
        (
            "LOI and a download",
            &[
                (
                    1,
                    json!({ "Requested/Handover LOI": 0x0f, "Controlled Station Mode": 1 }),
                ),
                (800, json!({ "Mission Plan Mode": 2 })),
                (1403, json!({ "Message Type": 101 })),
            ],
        ),
        (
            "a refused mode",
            &[(42, json!({ "Select Flight Path Control Mode": 2 }))],
        ),
    ];
    for (what, messages) in sequences {
        let tables = TABLES.replace("address = \"127.0.0.2\"\n", "");
        let mut rig = Rig::new(Setup {
            tables: Box::leak(tables.into_boxed_str()),
            ..Setup::default()
        });
        rig.run(9.0);
        let mut station = StationEd25::new(CUCS, ([127, 0, 0, 2], 41_000).into());
        let mut paid = 0;
        for (number, fields) in messages {
            let to = if what == "discovery" {
                Id::BROADCAST
            } else {
                vehicle_id(0)
            };
            let bytes = station.datagram(&rig, to, *number, fields);
            paid += bytes.len() as u64;
            rig.deliver_from(station.address, &bytes);
            rig.run(0.5);
        }
        rig.run(60.0);
        let sent = rig
            .sent_to
            .get(&station.address)
            .map_or(0, |(_, bytes)| *bytes);
        assert!(sent > 0, "{what}");
        assert!(sent <= 3 * paid, "{what}: {sent} bytes for {paid}");
    }
}

/// The shortest that names a station, and a discovery: at its address, and in the group.
#[test]
fn a_question_for_a_proof_counts_too_at_an_address_and_in_the_group() {
    let forged = SocketAddr::from(([192, 0, 2, 7], 7));
    for keys in ["", "edition = \"2.5\"\n", "delivery = \"group\"\n"] {
        for discovers in [false, true] {
            let tables = format!("[[cucs]]\nid = \"1b:00:00:b0\"\nloi = [2, 3, 4, 5]\n{keys}");
            let mut rig = Rig::new(Setup {
                tables: Box::leak(tables.into_boxed_str()),
                dli_keys: "multicast = \"239.45.86.1:26001\"\ninterface = \"127.0.0.1\"",
                ..Setup::default()
            });
            rig.run(9.0);
            let mut station = StationEd25::new(CUCS, forged);
            let discovery = station.datagram(&rig, Id::BROADCAST, 1, &json!({ "VSM ID": -1 }));
            let bytes = if discovers {
                discovery
            } else {
                shortest(&discovery)
            };
            rig.deliver_from(forged, &bytes);
            rig.run(60.0);
            let group = rig.group.iter().map(Vec::len).sum::<usize>();
            let addressed = rig
                .sent_to
                .get(&forged)
                .map_or(0, |(_, sent)| *sent as usize);
            for sent in [group, addressed] {
                assert!(
                    sent <= 3 * bytes.len(),
                    "{sent} for {}: {keys}",
                    bytes.len()
                );
            }
            assert!(group + addressed > 0, "{keys}");
        }
    }
}

/// A message of a type that is not known, with the first three fields of another.
fn shortest(of: &[u8]) -> Vec<u8> {
    let header = ed25::Header {
        version: ed25::Version::Ed25,
        instance: 1,
        message_type: 1999,
    };
    let mut out = [0; 64];
    let length = ed25::encode(&header, &of[30..46], &mut out).expect("it fits");
    out[..length].to_vec()
}
