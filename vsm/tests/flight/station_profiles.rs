//! Stations of several makes at once: each is answered in its edition, with its checksum and its readings, where its
//! profile says; nothing of that can be changed, or made to flood a group, by who only writes a station's id.

use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;

use kit::bridge::{Rig, Setup, orders, vehicle_id};
use mavlink_link::Now;
use mavlink_link::store::MemoryDisk;
use stanag_msgs::enums::{AckType, LoiBitmap, RequestedAccess};
use stanag_msgs::messages::{CucsAuthorisationRequest, FieldConfigurationRequest, Heartbeat};
use stanag_msgs::wrapper::Header;
use stanag_msgs::{ChecksumStyle, Envelope, Id, MAX_DATAGRAM, Message, Profile, TimeStamp, frames};
use vsm::config::Config;
use vsm::session::{Bridge, Destination, LinkEnd};

const VSM: Id = Id(0x1b00_0001);
const VEHICLE: Id = Id(0x1b00_0101);
const FIRST: Id = Id(0x1b00_00a0);
const SECOND: Id = Id(0x1b00_00a1);
const START: Duration = Duration::from_secs(1_795_219_200);

/// A bridge with two stations and a vehicle, and what it sends.
struct Scene {
    bridge: Bridge,
    disk: MemoryDisk,
    at: Duration,
    stamp: u64,
}

fn config(dli: &str, first: &str, second: &str) -> Config {
    let text = format!(
        "[dli]\nvsm_id = \"{VSM}\"\nlisten = \"127.0.0.1:4586\"\n{dli}\n\
         [[cucs]]\nid = \"{FIRST}\"\nloi = [2, 3, 4, 5]\n{first}\n\
         [[cucs]]\nid = \"{SECOND}\"\nloi = [2, 3, 4, 5]\n{second}\n\
         [[vehicle]]\nid = \"{VEHICLE}\"\nlink = \"udpin:127.0.0.1:14550\"\nsystem_id = 1\nsigning = \"off\"\n\
         [store]\ndir = \"state\"\n"
    );
    Config::parse(&text, Path::new("/nowhere")).expect("a configuration")
}

fn address(of: Id) -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], 40_000 + (of.0 & 0xff) as u16))
}

impl Scene {
    fn new(dli: &str, first: &str, second: &str) -> Scene {
        let mut disk = MemoryDisk::default();
        let config = config(dli, first, second);
        let now = Now {
            mono: Duration::from_secs(5),
            wall: START,
        };
        let ends = vec![LinkEnd {
            key: None,
            peer: None,
        }];
        let bridge = Bridge::new(&config, ends, now, START, &mut disk).expect("a bridge");
        Scene {
            bridge,
            disk,
            at: Duration::ZERO,
            stamp: 0,
        }
    }

    fn now(&self) -> Now {
        Now {
            mono: Duration::from_secs(5) + self.at,
            wall: START + self.at,
        }
    }

    fn stamp(&mut self) -> TimeStamp {
        self.stamp += 1;
        let ms = u64::try_from((START + self.at).as_millis()).unwrap_or(u64::MAX);
        TimeStamp(TimeStamp::from_unix_ms(ms).0 + self.stamp)
    }

    /// What is sent where, where this arrives from a station.
    fn deliver(&mut self, from: Id, bytes: &[u8]) -> Vec<(Destination, Vec<u8>)> {
        let now = self.now();
        self.bridge
            .handle_dli(now, address(from), bytes, &mut self.disk);
        self.sent()
    }

    fn sent(&mut self) -> Vec<(Destination, Vec<u8>)> {
        let each = std::iter::from_fn(|| self.bridge.poll_dli());
        each.map(|one| (one.to, one.bytes().to_vec())).collect()
    }

    /// Time passes, in steps of 10 ms.
    fn wait(&mut self, s: u64) -> Vec<(Destination, Vec<u8>)> {
        let mut sent = vec![];
        for _ in 0..s * 100 {
            self.at += Duration::from_millis(10);
            let now = self.now();
            self.bridge.handle_timeout(now, &mut self.disk);
            sent.extend(self.sent());
        }
        sent
    }

    /// A station asks for LOI 2, and for an acknowledgement.
    fn listen(
        &mut self,
        from: Id,
        profile: &Profile,
        idd: u8,
        style: ChecksumStyle,
    ) -> Vec<(Destination, Vec<u8>)> {
        let request = CucsAuthorisationRequest {
            time_stamp: Some(self.stamp()),
            requested_handover_loi: Some(LoiBitmap::LOI2),
            requested_handover_access: Some(RequestedAccess::Request),
            ..Default::default()
        };
        let bytes = encode(profile, from, VEHICLE, idd, style, &request.into());
        self.deliver(from, &bytes)
    }
}

fn encode(
    profile: &Profile,
    from: Id,
    to: Id,
    idd: u8,
    style: ChecksumStyle,
    message: &Message,
) -> Vec<u8> {
    let envelope = Envelope {
        idd,
        ..Envelope::new(from, to).summed(style).requesting_ack()
    };
    let mut bytes = [0; MAX_DATAGRAM];
    let length = profile
        .encode(message, &envelope, &mut bytes)
        .expect("it fits");
    bytes[..length].to_vec()
}

/// The messages of these types, read under a profile, with their headers.
fn read(
    profile: &Profile,
    sent: &[(Destination, Vec<u8>)],
    types: &[u16],
) -> Vec<(Header, Message)> {
    let frames = sent.iter().flat_map(|(_, bytes)| profile.frames(bytes));
    let frames = frames.map(|frame| frame.expect("a sound frame"));
    let of_types = frames.filter(|frame| types.contains(&frame.header.message_type));
    let decoded = of_types.map(|frame| {
        let message = profile.decode(frame.header.message_type, frame.data);
        (frame.header, message.expect("a message"))
    });
    decoded.collect()
}

fn types(sent: &[(Destination, Vec<u8>)], to_group: bool) -> Vec<u16> {
    let there = sent
        .iter()
        .filter(|(to, _)| (*to == Destination::Multicast) == to_group);
    let each = there.flat_map(|(_, bytes)| frames(bytes).flatten());
    each.map(|frame| frame.header.message_type).collect()
}

#[test]
fn two_makes_are_served_at_once_each_as_it_speaks() {
    let of_first = "address = \"127.0.0.1\"\ndisputed = { ack_type = \"0,1,2\" }";
    let of_second = "address = \"127.0.0.1\"\ndisputed = { checksum_1 = \"crc16\" }";
    let mut scene = Scene::new("", of_first, of_second);
    let (mut first, mut second) = (Profile::default(), Profile::default());
    first.set("ack_type", "0,1,2").expect("a reading");
    second.set("checksum_1", "crc16").expect("a reading");
    let answers = [2, 17_000];
    for _ in 0..2 {
        let sent = scene.listen(FIRST, &first, 30, ChecksumStyle::Sum16);
        let got = read(&first, &sent, &answers);
        assert!(got.len() >= 2, "{sent:?}");
        for (header, message) in got {
            assert_eq!((header.idd, header.checksum), (30, ChecksumStyle::Sum16));
            match message {
                Message::VsmAuthorisationResponse(answer) => {
                    assert_eq!(answer.loi_granted, Some(LoiBitmap::LOI2));
                }
                Message::MessageAcknowledgement(answer) => {
                    assert_eq!(answer.acknowledgement_type, Some(AckType::CarriedOut));
                }
                other => panic!("{other:?}"),
            }
        }
        // The word that Edition 3 calls a sequence number is all ones.
        let of_first = sent
            .iter()
            .find(|(to, _)| *to == Destination::Unicast(address(FIRST)));
        assert_eq!(of_first.expect("an answer").1[..2], [0xff, 0xff]);

        let sent = scene.listen(SECOND, &second, 32, ChecksumStyle::Sum16);
        let got = read(&second, &sent, &answers);
        assert!(got.len() >= 2, "{sent:?}");
        for (header, _) in got {
            assert_eq!((header.idd, header.checksum), (32, ChecksumStyle::Sum16));
        }
    }
    // The other's reading is none of the first's: its sums are no CRC.
    let sent = scene.listen(FIRST, &second, 30, ChecksumStyle::Sum16);
    assert!(read(&first, &sent, &answers).is_empty(), "{sent:?}");
}

#[test]
fn answers_go_where_the_profile_says() {
    const GROUP: &str = "multicast = \"239.45.86.1:26001\"\ninterface = \"127.0.0.1\"";
    let ours = Profile::default();
    for (keys, to_address, to_group) in [
        ("delivery = \"unicast\"", true, false),
        ("delivery = \"group\"", false, true),
        ("delivery = \"both\"", true, true),
        ("", true, true),
    ] {
        let vouched = format!("address = \"127.0.0.1\"\n{keys}");
        let mut scene = Scene::new(GROUP, &vouched, "");
        let sent = scene.listen(FIRST, &ours, 32, ChecksumStyle::None);
        for answer in [2, 17_000] {
            assert_eq!(
                types(&sent, false).contains(&answer),
                to_address,
                "{keys}: {sent:?}"
            );
            assert_eq!(
                types(&sent, true).contains(&answer),
                to_group,
                "{keys}: {sent:?}"
            );
        }
        // Where nobody vouches for it, the question that proves an address goes where the station receives.
        let mut scene = Scene::new(GROUP, keys, "");
        let sent = scene.listen(FIRST, &ours, 32, ChecksumStyle::None);
        assert!(
            types(&sent, !to_address).contains(&Heartbeat::ID),
            "{keys}: {sent:?}"
        );
    }
    // Without a group there is none to send to.
    let mut scene = Scene::new("", "", "");
    let sent = scene.listen(FIRST, &ours, 32, ChecksumStyle::None);
    assert!(types(&sent, true).is_empty());
}

#[test]
fn who_only_writes_an_id_does_not_make_the_bridge_flood_a_group() {
    let group = "multicast = \"239.45.86.1:26001\"\ninterface = \"127.0.0.1\"";
    let mut scene = Scene::new(group, "delivery = \"group\"", "delivery = \"group\"");
    let ours = Profile::default();
    let (mut came, mut went) = (0, 0);
    for _ in 0..50 {
        let request = FieldConfigurationRequest {
            time_stamp: Some(scene.stamp()),
            vsm_id: Some(VSM),
            ..Default::default()
        };
        let bytes = encode(
            &ours,
            FIRST,
            VEHICLE,
            32,
            ChecksumStyle::None,
            &request.into(),
        );
        came += bytes.len();
        let mut sent = scene.deliver(FIRST, &bytes);
        sent.extend(scene.wait(1));
        let alert = |(_, bytes): &&(Destination, Vec<u8>)| {
            frames(bytes)
                .flatten()
                .all(|one| one.header.message_type != 16_000)
        };
        went += sent
            .iter()
            .filter(alert)
            .map(|(_, bytes)| bytes.len())
            .sum::<usize>();
    }
    assert!(went <= 3 * came, "{went} bytes for {came}");
    assert!(went > came, "it is answered: {went} bytes for {came}");
    // Strangers and broken datagrams lead to nothing there.
    let request = Message::from(Heartbeat {
        time_stamp: Some(TimeStamp(1)),
    });
    let stranger = encode(
        &ours,
        Id(0x1b00_00ff),
        VSM,
        32,
        ChecksumStyle::None,
        &request,
    );
    let mut broken = encode(&ours, SECOND, VSM, 32, ChecksumStyle::Sum32, &request);
    *broken.last_mut().expect("a byte") ^= 1;
    for _ in 0..1_000 {
        assert_eq!(scene.deliver(SECOND, &stranger), []);
        assert_eq!(scene.deliver(SECOND, &broken), []);
    }
}

#[test]
fn another_edition_than_the_configured_one_is_dropped_by_name() {
    let mut scene = Scene::new("", "edition = \"4\"", "edition = \"3\"");
    let ours = Profile::default();
    assert_eq!(scene.listen(FIRST, &ours, 30, ChecksumStyle::None), []);
    assert_eq!(scene.listen(SECOND, &ours, 32, ChecksumStyle::None), []);
    let status = scene.bridge.status(String::new(), scene.now().mono);
    assert_eq!(status.refused.get("another edition than configured"), 2);
    assert!(
        !scene
            .listen(FIRST, &ours, 32, ChecksumStyle::None)
            .is_empty()
    );
    assert!(
        !scene
            .listen(SECOND, &ours, 30, ChecksumStyle::None)
            .is_empty()
    );
}

#[test]
fn a_station_that_reads_several_messages_of_a_datagram_is_sent_the_same_in_fewer() {
    const TRUSTED: &str = "address = \"127.0.0.1\"\nchecksum = \"crc32\"\ndelivery = \"unicast\"";
    let mut scene = Scene::new("", &format!("{TRUSTED}\npack = true"), TRUSTED);
    let ours = Profile::default();
    for station in [FIRST, SECOND] {
        scene.listen(station, &ours, 32, ChecksumStyle::None);
    }
    let sent = scene.wait(4);
    let of = |station: Id| {
        let to = Destination::Unicast(address(station));
        let datagrams = sent.iter().filter(move |(one, _)| *one == to);
        let each: Vec<Vec<(u16, Option<TimeStamp>)>> = datagrams
            .map(|(_, bytes)| {
                assert!(bytes.len() <= MAX_DATAGRAM);
                let messages = frames(bytes).map(|frame| {
                    let frame = frame.expect("a message");
                    assert_eq!(frame.header.destination, station);
                    let message = ours.decode(frame.header.message_type, frame.data);
                    let stamp = match message.expect("a message") {
                        Message::VehicleOperatingModeReport(report) => report.time_stamp,
                        _ => None,
                    };
                    (frame.header.message_type, stamp)
                });
                messages.collect()
            })
            .collect();
        each
    };
    let (packed, single) = (of(FIRST), of(SECOND));
    assert!(single.iter().all(|messages| messages.len() == 1));
    let types = |datagrams: &[Vec<(u16, Option<TimeStamp>)>]| {
        let all = datagrams.iter().flatten();
        all.map(|(id, _)| *id).collect::<Vec<_>>()
    };
    // The same, in the same order.
    assert_eq!(types(&packed), types(&single));
    assert!(packed.len() * 2 <= single.len(), "{packed:?}");
    let stamps: Vec<_> = packed
        .iter()
        .flatten()
        .filter(|(id, _)| *id == 3_001)
        .collect();
    assert!(stamps.len() > 4 && stamps.is_sorted_by_key(|(_, stamp)| stamp.map(|it| it.0)));
}

#[test]
fn a_reload_changes_how_a_station_is_spoken_to() {
    const TRUSTED: &str = "address = \"127.0.0.1\"";
    let mut scene = Scene::new("", TRUSTED, "");
    let mut profile = Profile::default();
    scene.listen(FIRST, &profile, 32, ChecksumStyle::None);
    let new = config(
        "",
        "address = \"127.0.0.1\"\nchecksum = \"crc32\"\ndisputed = { ack_type = \"0,1,2\" }",
        "",
    );
    let changes = config("", TRUSTED, "")
        .changes(&new)
        .expect("it can be applied");
    assert!(
        changes
            .report
            .applied
            .iter()
            .any(|line| line.contains("checksum, disputed"))
    );
    let now = scene.now();
    scene
        .bridge
        .reload(&changes.config, vec![], now, START, &mut scene.disk)
        .expect("applied");
    let _ = scene.sent();
    profile.set("ack_type", "0,1,2").expect("a reading");
    let sent = scene.listen(FIRST, &profile, 32, ChecksumStyle::None);
    let got = read(&profile, &sent, &[17_000]);
    let (header, Message::MessageAcknowledgement(answer)) = &got[0] else {
        panic!("{got:?}");
    };
    assert_eq!(header.checksum, ChecksumStyle::Crc32);
    assert_eq!(answer.acknowledgement_type, Some(AckType::CarriedOut));
}

#[test]
fn what_waits_while_readings_change_is_not_sent_in_words_that_mean_something_else() {
    let mut scene = Scene::new("", "", "");
    let ours = Profile::default();
    // Nobody vouches for its address: the answer waits for the proof.
    let sent = scene.listen(FIRST, &ours, 32, ChecksumStyle::None);
    assert!(read(&ours, &sent, &[17_000]).is_empty(), "{sent:?}");
    let new = config("", "disputed = { ack_type = \"0,1,2\" }", "");
    let now = scene.now();
    let reloaded = scene
        .bridge
        .reload(&new, vec![], now, START, &mut scene.disk);
    reloaded.expect("applied");
    let mut changed = Profile::default();
    changed.set("ack_type", "0,1,2").expect("a reading");
    let mut sent = scene.listen(FIRST, &changed, 32, ChecksumStyle::None);
    sent.extend(scene.wait(3));
    for (_, message) in read(&changed, &sent, &[17_000]) {
        let Message::MessageAcknowledgement(answer) = message else {
            panic!("{message:?}");
        };
        assert_ne!(answer.acknowledgement_type, Some(AckType::Refused));
    }
}

#[test]
fn several_stations_of_one_computer_are_told_apart_by_their_ids() {
    let vouched = "address = \"127.0.0.1\"";
    let mut scene = Scene::new("", vouched, vouched);
    let ours = Profile::default();
    for (index, station) in [FIRST, SECOND, FIRST].into_iter().enumerate() {
        let request = CucsAuthorisationRequest {
            time_stamp: Some(scene.stamp()),
            requested_handover_loi: Some(LoiBitmap::LOI2),
            requested_handover_access: Some(RequestedAccess::Request),
            ..Default::default()
        };
        let bytes = encode(
            &ours,
            station,
            VEHICLE,
            32,
            ChecksumStyle::None,
            &request.into(),
        );
        // One gateway: one address and port for both.
        let sent = scene.deliver(FIRST, &bytes);
        let got = read(&ours, &sent, &[2, 17_000]);
        assert!(got.len() >= 2, "{index}: {sent:?}");
        assert!(
            got.iter().all(|(header, _)| header.destination == station),
            "{got:?}"
        );
        assert!(
            sent.iter()
                .all(|(to, _)| *to == Destination::Unicast(address(FIRST)))
        );
    }
    let holders = scene.bridge.status(String::new(), scene.now().mono);
    assert_eq!(
        holders
            .stations
            .iter()
            .filter(|one| one.address.is_some())
            .count(),
        2
    );
    assert_eq!(
        holders.stations[1].profile,
        [
            "edition = \"4\"",
            "checksum = \"none\"",
            "presence = \"partial\""
        ]
    );
}

#[test]
fn a_station_that_supports_full_vectors_alone_is_sent_those() {
    let mut scene = Scene::new("", "address = \"127.0.0.1\"\npresence = \"full\"", "");
    let ours = Profile::default();
    let sent = scene.listen(FIRST, &ours, 32, ChecksumStyle::None);
    let mut seen = 0;
    for (_, bytes) in &sent {
        for frame in ours.frames(bytes).flatten() {
            let info = stanag_msgs::table::message(frame.header.message_type).expect("known");
            assert!(
                !stanag_msgs::table::is_partial(info, frame.data),
                "{}",
                info.id
            );
            seen += usize::from(info.id == 2);
        }
    }
    assert!(seen > 0, "{sent:?}");
    // The vehicle is nowhere that is known: no status puts it at 0, 0.
    assert!(!types(&scene.wait(3), false).contains(&4_000));
}

#[test]
fn a_logical_id_stands_for_a_vehicle_until_that_is_there() {
    const LOGICAL: Id = Id(7);
    let mut rig = Rig::new(Setup {
        vehicle_keys: "logical_id = \"00:00:00:07\"",
        ..Setup::default()
    });
    // Before the vehicle has said anything.
    let request = CucsAuthorisationRequest {
        time_stamp: Some(TimeStamp::from_unix_ms(
            u64::try_from(START.as_millis()).unwrap_or(0),
        )),
        ..orders::request_control()
    };
    rig.stations[0].send_as_is(LOGICAL, &request.into());
    rig.run(20.0);
    let update = |message: &Message| match message {
        Message::VehicleId(id) => id.vehicle_id_update,
        _ => None,
    };
    let received = &rig.station().received;
    let first = received
        .iter()
        .position(|(_, source, _)| *source == LOGICAL);
    let introduced = received.iter().position(|(_, source, message)| {
        *source == LOGICAL && update(message) == Some(vehicle_id(0))
    });
    let real = received
        .iter()
        .position(|(_, source, _)| *source == vehicle_id(0));
    assert!(
        first.is_some() && first <= introduced,
        "{first:?} {introduced:?}"
    );
    assert!(
        introduced.is_some() && introduced < real,
        "{introduced:?} {real:?}"
    );
    let last_logical = received
        .iter()
        .rposition(|(_, source, _)| *source == LOGICAL);
    assert!(last_logical < real, "it keeps its own id from then on");
    // Who still uses the logical one means the same vehicle.
    let before = rig.station().received.len();
    let again = CucsAuthorisationRequest {
        time_stamp: Some(TimeStamp::from_unix_ms(
            u64::try_from(START.as_millis()).unwrap_or(0) + 60_000,
        )),
        ..orders::request_control()
    };
    rig.stations[0].send_as_is(LOGICAL, &again.into());
    rig.run(1.0);
    let answered = rig.station().received[before..]
        .iter()
        .any(|(_, source, message)| {
            *source == vehicle_id(0) && matches!(message, Message::VsmAuthorisationResponse(_))
        });
    assert!(answered);
}
