//! CUCSs with a guard: what is forged, replayed, or sent without it in their names leads to nothing, whatever it is.

use std::net::SocketAddr;
use std::time::Duration;

use kit::attacks;
use kit::bridge::{
    Rig, Setup, StationGuard, VSM, cucs, guard_key, orders, station_address, vehicle_id,
};
use mavlink_link::Now;
use mavlink_link::signing::SigningKey;
use serde_json::{Value, json};
use stanag_msgs::enums::{FlightPathControlMode, LoiBitmap, RequestedAccess};
use stanag_msgs::guard::TRAILER_BYTES;
use stanag_msgs::messages::{
    CucsAuthorisationRequest, Heartbeat, PositiveHandoverAuthorisationRequest,
};
use stanag_msgs::{ChecksumStyle, Envelope, Id, MAX_DATAGRAM, Message, TimeStamp};

pub(super) const ELSEWHERE: ([u8; 4], u16) = ([127, 0, 0, 9], 9_999);

/// Stations that may all override; those of `guarded` have a guard.
pub(super) fn rig(stations: u8, guarded: &[usize]) -> Rig {
    let setup = Setup {
        stations,
        ..Setup::default()
    };
    let mut rig = Rig::new(setup);
    let mut text = rig.text.clone();
    for index in 0..usize::from(stations) {
        let id = format!("id = \"{}\"\n", cucs(index));
        let guard = match guarded.contains(&index) {
            true => "guard = { key_file = \"a.key\" }\n",
            false => "",
        };
        text = text.replace(&id, &format!("{id}override = true\n{guard}"));
    }
    rig.restart_with(&text);
    rig.run(9.0);
    rig
}

fn status(rig: &Rig) -> Value {
    let bridge = rig.bridge.as_ref().expect("it runs");
    let status = bridge.status(String::new(), rig.now().mono);
    serde_json::to_value(status).expect("JSON")
}

pub(super) fn refused(rig: &Rig, name: &str) -> u64 {
    status(rig)["refused"][name].as_u64().unwrap_or(0)
}

fn controller(rig: &Rig) -> Option<String> {
    let status = status(rig);
    status["vehicles"][0]["controller"]
        .as_str()
        .map(str::to_owned)
}

/// A datagram in the name of a station, as whoever knows its id can write it.
pub(super) fn forged(rig: &Rig, station: Id, to: Id, message: impl Into<Message>) -> Vec<u8> {
    let stamp = TimeStamp::from_unix_ms(rig.station_now().wall.as_millis() as u64);
    let message = message.into().stamped(stamp);
    let envelope = Envelope::new(station, to).summed(ChecksumStyle::Crc32);
    let mut bytes = [0; MAX_DATAGRAM];
    let length = message.encode(&envelope, &mut bytes).expect("it fits");
    bytes[..length].to_vec()
}

fn take_by_override() -> CucsAuthorisationRequest {
    CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::from_raw(0x0f)),
        requested_handover_access: Some(RequestedAccess::Override),
        ..CucsAuthorisationRequest::default()
    }
}

#[test]
fn two_forged_datagrams_take_over_without_a_guard_and_with_one_nothing_does() {
    // The attack of docs/guide/guard.md: an override, and a landing, from the very address of another station.
    for guarded in [&[][..], &[0, 1]] {
        let mut rig = rig(2, guarded);
        rig.done(orders::request_control());
        rig.take_off(20.0);
        let from = station_address(1);
        for message in [
            Message::from(take_by_override()),
            orders::mode(FlightPathControlMode::AutolandEngage).into(),
        ] {
            let bytes = forged(&rig, cucs(1), vehicle_id(0), message);
            rig.deliver_from(from, &bytes);
            rig.run(1.0);
        }
        rig.run(30.0);
        if guarded.is_empty() {
            assert_eq!(controller(&rig), Some(cucs(1).to_string()));
            assert!(
                rig.truth().landed,
                "the attack works where nothing is configured"
            );
        } else {
            assert_eq!(controller(&rig), Some(cucs(0).to_string()));
            assert!(!rig.truth().landed);
            assert_eq!(refused(&rig, "guard: no trailer"), 2);
            let found = &status(&rig)["findings"];
            assert!(found.to_string().contains("cucs-guard"), "{found}");
            rig.done(orders::mode(FlightPathControlMode::AutolandEngage));
        }
    }
}

#[test]
fn a_station_without_a_guard_takes_nothing_from_one_with() {
    let mut rig = rig(2, &[0]);
    rig.stations[0].heartbeats = true;
    rig.done(orders::request_control());
    let asked = rig.send_as(1, 0, take_by_override());
    rig.run(3.0);
    rig.stations[1].give_up(asked);
    assert_eq!(controller(&rig), Some(cucs(0).to_string()));
    // Who can cut off a guarded station gains nothing while it would be offered to others.
    rig.stations[0].heartbeats = false;
    rig.run(6.0);
    let asked = rig.send_as(1, 0, orders::request_control());
    rig.run(1.0);
    rig.stations[1].give_up(asked);
    assert_eq!(controller(&rig), Some(cucs(0).to_string()));
}

fn wish(acquirer: usize) -> PositiveHandoverAuthorisationRequest {
    PositiveHandoverAuthorisationRequest {
        requesting_cucs_id: Some(cucs(acquirer)),
        requested_handover_loi: Some(LoiBitmap::from_raw(0x0c)),
        ..PositiveHandoverAuthorisationRequest::default()
    }
}

/// A datagram once, which nobody sends again.
fn forge(rig: &mut Rig, station: usize, message: impl Into<Message>) {
    let bytes = forged(rig, cucs(station), vehicle_id(0), message);
    rig.deliver_from(station_address(station), &bytes);
    rig.run(0.5);
}

#[test]
fn a_wish_without_a_guard_is_fulfilled_neither_by_the_silence_nor_by_the_loss_of_a_guarded_holder()
{
    // Without any guard the silence of the holder is consent: the wish is one that can be fulfilled.
    for guarded in [&[][..], &[0]] {
        let mut rig = rig(2, guarded);
        rig.stations[0].heartbeats = true;
        rig.done(orders::request_control());
        rig.run(3.0);
        forge(&mut rig, 1, wish(1));
        rig.stations[0].heartbeats = false;
        rig.run(6.5);
        let silent = controller(&rig);
        rig.run(12.0);
        if guarded.is_empty() {
            assert_eq!(silent, Some(cucs(1).to_string()));
        } else {
            assert_eq!(silent, Some(cucs(0).to_string()));
            assert_eq!(controller(&rig), None, "free, and of nobody who was first");
        }
    }
}

#[test]
fn a_wish_without_a_guard_is_in_the_way_of_no_guarded_station() {
    let mut rig = rig(3, &[0, 2]);
    rig.done(orders::request_control());
    // The holder names its successor, while another is wished for in the name of who has no guard.
    forge(&mut rig, 1, wish(1));
    rig.send(wish(2));
    rig.run(1.0);
    rig.send_as(2, 0, wish(2));
    rig.run(2.0);
    assert_eq!(controller(&rig), Some(cucs(2).to_string()));
    // And one with a guard wishes it back.
    forge(&mut rig, 1, wish(1));
    rig.send(wish(0));
    rig.run(1.0);
    rig.send_as(2, 0, wish(0));
    rig.run(2.0);
    assert_eq!(controller(&rig), Some(cucs(0).to_string()));
}

#[test]
fn a_key_that_cannot_be_used_leaves_its_station_without_one_and_the_others_with_theirs() {
    let mut rig = rig(2, &[0, 1]);
    rig.done(orders::request_control());
    // Rotated and revoked: what is stored of the new key cannot be read.
    let new = |byte| SigningKey::new([byte; 32]).expect("not all zero");
    let clock = format!("clock-{}", new(1).id());
    rig.store.records.insert(clock, b"words".to_vec());
    let now = rig.now();
    let keys = vec![
        (cucs(0), vec![(new(1), None)]),
        (cucs(1), vec![(new(2), None)]),
    ];
    let bridge = rig.bridge.as_mut().expect("it runs");
    let given = bridge.set_guard_keys(keys, now, Duration::ZERO, &mut rig.store);
    assert!(given.is_err());
    let ids = bridge.guard_key_ids();
    let second = Some(new(2).id().to_string());
    assert_eq!(ids, [(cucs(0), None), (cucs(1), second)]);
    let lost = rig.send(orders::launch(20.0));
    rig.run(3.0);
    rig.stations[0].give_up(lost);
    assert!(rig.truth().landed, "not under the old key");
    assert!(refused(&rig, "guard: sender without a guard key") > 0);
}

/// Station 0 has this key in force, and by the wall clock the one before has been over since long.
fn rotated_long_ago(rig: &mut Rig, new: &SigningKey) {
    let now = rig.now();
    let keys = vec![
        (new.duplicate(), None),
        (guard_key(cucs(0)), Some(now.mono)),
    ];
    let bridge = rig.bridge.as_mut().expect("it runs");
    let given = bridge.set_guard_keys(vec![(cucs(0), keys)], now, Duration::ZERO, &mut rig.store);
    given.expect("their clocks can be read");
}

/// Whether anything of station 0 is accepted within seconds.
fn is_accepted(rig: &mut Rig) -> bool {
    let verified = |rig: &Rig| status(rig)["stations"][0]["guard"]["verified"].as_u64();
    let before = verified(rig).expect("it has a guard");
    rig.run(6.0);
    verified(rig) > Some(before)
}

#[test]
fn a_clock_that_is_ahead_locks_out_no_station_whose_new_key_is_on_its_way_and_no_old_key_comes_back()
 {
    let new = SigningKey::new([0x4e; 32]).expect("not all zero");
    let mut rig = rig(1, &[0]);
    rig.stations[0].heartbeats = true;
    assert!(is_accepted(&mut rig));
    // The key was rotated a moment ago, and the clock is a day ahead.
    rotated_long_ago(&mut rig, &new);
    assert!(is_accepted(&mut rig), "after a reload");
    rig.restart_bridge();
    rotated_long_ago(&mut rig, &new);
    assert!(is_accepted(&mut rig), "after a restart");
    // The new key has arrived: once it is used, the old one is over, after a restart too.
    let owner = StationGuard::with_key(cucs(0), new.duplicate(), rig.station_now());
    let thief = rig.guards.insert(0, owner).expect("it has one");
    assert!(is_accepted(&mut rig));
    let owner = rig.guards.insert(0, thief).expect("it has one");
    // What the owner has sent before arrives.
    rig.run(1.0);
    assert!(!is_accepted(&mut rig));
    rig.restart_bridge();
    rotated_long_ago(&mut rig, &new);
    assert!(!is_accepted(&mut rig));
    assert!(refused(&rig, "guard: unknown key") > 0);
    rig.guards.insert(0, owner);
    assert!(is_accepted(&mut rig));
}

#[test]
fn a_copy_that_is_faster_neither_silences_nor_diverts_a_station() {
    // With an address of its own in the configuration, and without.
    for address in ["", "address = \"127.0.0.10\"\n"] {
        let mut rig = rig(1, &[0]);
        let id = format!("id = \"{}\"\n", cucs(0));
        let address = address.replace("127.0.0.10", &station_address(0).ip().to_string());
        let text = rig.text.replace(&id, &format!("{id}{address}"));
        rig.restart_with(&text);
        rig.run(9.0);
        rig.stations[0].heartbeats = true;
        rig.done(orders::request_control());
        rig.run(3.0);
        let at = |rig: &Rig| status(rig)["stations"][0]["address"].clone();
        let received = |rig: &Rig| status(rig)["received"]["16002"].as_u64();
        let before = received(&rig).expect("it has heartbeats");
        // All that it sends is overtaken by its copy; what the copier is asked, he has the station answer.
        rig.stations[0].heartbeats = false;
        for n in 0..20 {
            let now = rig.station_now();
            let stamp = TimeStamp::from_unix_ms(now.wall.as_millis() as u64);
            let message = Message::from(Heartbeat::default()).stamped(stamp);
            let envelope = Envelope::new(cucs(0), VSM);
            let mut bytes = [0; MAX_DATAGRAM];
            let length = message.encode(&envelope, &mut bytes).expect("it fits");
            let guard = rig.guards.get_mut(&0).expect("it has one");
            let sealed = guard.seal(now, &bytes[..length]);
            rig.deliver_from(ELSEWHERE.into(), &sealed);
            rig.deliver_from(station_address(0), &sealed);
            // A recording of it is a recording, wherever it comes from.
            rig.run(0.2);
            rig.deliver_from(ELSEWHERE.into(), &sealed);
            rig.deliver_from(station_address(0), &sealed);
            rig.run(0.3);
            assert_eq!(at(&rig), json!(station_address(0).to_string()), "{n}");
        }
        assert_eq!(received(&rig), Some(before + 20), "{address}");
        assert_eq!(controller(&rig), Some(cucs(0).to_string()));
    }
}

#[test]
fn a_whole_flight_replayed_over_restarts_of_both_ends_is_taken_no_second_time() {
    let mut rig = rig(1, &[0]);
    rig.done(orders::request_control());
    rig.take_off(20.0);
    rig.done(orders::mode(FlightPathControlMode::AutolandEngage));
    assert!(rig.until(60.0, |rig| rig.truth().landed));
    let recorded = rig.guards[&0].sent.clone();
    assert!(recorded.len() > 5, "{}", recorded.len());
    for round in 0..3 {
        match round {
            0 => {}
            1 => rig.restart_bridge(),
            _ => {
                let now = rig.station_now();
                let guard = rig.guards.get_mut(&0).expect("it has one");
                guard.restart(now);
            }
        }
        let before = status(&rig)["received"].clone();
        for sealed in &recorded {
            rig.deliver_from(ELSEWHERE.into(), sealed);
            rig.deliver_from(station_address(0), sealed);
        }
        rig.run(1.0);
        assert!(rig.truth().landed);
        let after = status(&rig)["received"].clone();
        // What the station itself acknowledges meanwhile is not of the recording.
        let of = |status: &Value, message: &str| status[message].as_u64().unwrap_or(0);
        for message in ["1", "2016"] {
            assert_eq!(of(&after, message), of(&before, message), "round {round}");
        }
    }
    assert!(refused(&rig, "guard: too old") > 0);
    // The station itself is served after both restarts.
    rig.done(orders::request_control());
}

#[test]
fn a_guard_that_was_started_with_a_clock_two_hours_ahead_is_served_within_seconds() {
    let mut rig = rig(1, &[0]);
    rig.stations[0].heartbeats = true;
    // Wrong; right again, which its store is ahead of; and beside a VSM that was started again.
    for (ahead, restarts) in [(2 * 3_600, false), (0, false), (0, true)] {
        let now = rig.station_now();
        let wall = now.wall + Duration::from_secs(ahead);
        let guard = rig.guards.get_mut(&0).expect("it has one");
        guard.restart(Now { wall, ..now });
        if restarts {
            rig.restart_bridge();
        }
        rig.run(8.0);
        let before = refused(&rig, "guard: over an hour ahead");
        rig.done(orders::request_control());
        assert_eq!(refused(&rig, "guard: over an hour ahead"), before);
        assert!(before > 0 || ahead == 0, "it was refused at first");
    }
}

#[test]
fn only_what_verifies_has_an_address() {
    let mut rig = rig(1, &[0]);
    rig.done(orders::request_control());
    let at = |rig: &Rig| status(rig)["stations"][0]["address"].clone();
    let there = json!(station_address(0).to_string());
    let elsewhere = SocketAddr::from(ELSEWHERE);
    assert_eq!(at(&rig), there);
    // Without a trailer, with one of another key, and cut: not even a question goes there.
    let plain = forged(&rig, cucs(0), vehicle_id(0), orders::request_control());
    let mut other = StationGuard::new(Id(0x1b00_00ee), rig.station_now());
    let mut of_other = other.seal(rig.station_now(), &plain);
    let sender = of_other.len() - TRAILER_BYTES + 4;
    let now = rig.station_now();
    let mut cut = rig
        .guards
        .get_mut(&0)
        .expect("it has one")
        .seal(now, &plain);
    cut.remove(0);
    rig.deliver_from(elsewhere, &plain);
    rig.deliver_from(elsewhere, &of_other);
    of_other[sender..sender + 4].copy_from_slice(&cucs(0).0.to_be_bytes());
    rig.deliver_from(elsewhere, &of_other);
    rig.deliver_from(elsewhere, &cut);
    rig.run(5.0);
    assert_eq!(at(&rig), there);
    assert_eq!(rig.sent_to.get(&elsewhere), None, "{:?}", rig.sent_to);
    for (name, count) in [
        ("guard: no trailer", 1),
        ("guard: sender without a guard key", 1),
        ("guard: unknown key", 1),
        ("guard: wrong trailer", 1),
    ] {
        assert_eq!(refused(&rig, name), count, "{name}");
    }
    // What is sealed in its name for a message of another source.
    let now = rig.station_now();
    let of_another = forged(
        &rig,
        Id(0x1b00_00b0),
        vehicle_id(0),
        orders::request_control(),
    );
    let guard = rig.guards.get_mut(&0).expect("it has one");
    let sealed = guard.seal(now, &of_another);
    rig.deliver_from(station_address(0), &sealed);
    rig.run(0.5);
    assert_eq!(refused(&rig, "unauthorised source"), 1);
    // It moves itself: its guard seals, and answers the question.
    rig.stations[0].address = elsewhere;
    rig.stations[0].heartbeats = true;
    rig.run(10.0);
    assert_eq!(at(&rig), json!(elsewhere.to_string()));
}

#[test]
fn a_guard_that_is_switched_on_while_the_bridge_runs_counts_from_then_on() {
    let mut rig = rig(1, &[]);
    rig.done(orders::request_control());
    let id = format!("id = \"{}\"\n", cucs(0));
    let plain = rig.text.clone();
    let guarded = plain.replace(&id, &format!("{id}guard = {{ key_file = \"a.key\" }}\n"));
    rig.reload(&guarded).expect("it is applied");
    rig.run(1.0);
    // The downgrade: its own datagrams, but without the guard.
    let guard = rig.guards.remove(&0).expect("it has one");
    let before = refused(&rig, "guard: no trailer");
    let lost = rig.send(orders::launch(20.0));
    rig.run(3.0);
    rig.stations[0].give_up(lost);
    assert!(rig.truth().landed);
    assert!(refused(&rig, "guard: no trailer") > before);
    rig.guards.insert(0, guard);
    rig.take_off(20.0);
    // And off again, by whoever may write the configuration.
    rig.reload(&plain).expect("it is applied");
    rig.guards.clear();
    rig.done(orders::mode(FlightPathControlMode::AutolandEngage));
}

#[test]
fn what_was_held_back_before_a_guard_is_not_taken_after_it() {
    for guarded in [false, true] {
        let mut rig = rig(1, &[]);
        rig.done(orders::request_control());
        let forged = forged(&rig, cucs(0), vehicle_id(0), orders::launch(20.0));
        rig.deliver_from(ELSEWHERE.into(), &forged);
        rig.run(0.1);
        if guarded {
            let id = format!("id = \"{}\"\n", cucs(0));
            let text =
                (rig.text).replace(&id, &format!("{id}guard = {{ key_file = \"a.key\" }}\n"));
            rig.reload(&text).expect("it is applied");
        }
        // The station itself moves there, and answers the question: what has waited there is taken with it.
        rig.stations[0].address = ELSEWHERE.into();
        rig.stations[0].heartbeats = true;
        rig.run(20.0);
        let at = status(&rig)["stations"][0]["address"].clone();
        assert_eq!(at, json!(SocketAddr::from(ELSEWHERE).to_string()));
        assert_eq!(rig.truth().landed, guarded);
    }
}

#[test]
fn editions_2_5_and_3_are_guarded_alike() {
    let mut rig = rig(1, &[0]);
    let fields = json!({
        "Time Stamp": rig.station_now().wall.as_secs_f64(), "Vehicle ID": vehicle_id(0).0 as i32,
        "CUCS ID": cucs(0).0 as i32, "VSM ID": -1, "Requested/Handover LOI": 0x0f,
        "Controlled Station Mode": 1,
    });
    let request = json!({ "id": 1, "idd": "2.5", "instance": 100, "fields": fields });
    let request = stanag_msgs::json::encode(&request, true).expect("a message of Edition 2.5");
    let third = Envelope {
        idd: stanag_msgs::Header::IDD_ED3,
        ..Envelope::new(cucs(0), vehicle_id(0))
    };
    let mut bytes = [0; MAX_DATAGRAM];
    let stamp = TimeStamp::from_unix_ms(rig.station_now().wall.as_millis() as u64);
    let message = Message::from(orders::request_control()).stamped(stamp);
    let length = message.encode(&third, &mut bytes).expect("it fits");
    for (edition, datagram) in [("2.5", &request[..]), ("3", &bytes[..length])] {
        let before = refused(&rig, "guard: no trailer");
        rig.deliver_from(station_address(0), datagram);
        rig.run(0.5);
        assert_eq!(refused(&rig, "guard: no trailer"), before + 1, "{edition}");
        assert_eq!(controller(&rig), None, "{edition}");
        let now = rig.station_now();
        let guard = rig.guards.get_mut(&0).expect("it has one");
        let sealed = guard.seal(now, datagram);
        rig.deliver_from(station_address(0), &sealed);
        rig.run(0.5);
        assert_eq!(controller(&rig), Some(cucs(0).to_string()), "{edition}");
        let give_up = rig.text.clone();
        // Another edition, and nothing held: a new start.
        rig.store = Default::default();
        rig.restart_with(&give_up);
        rig.run(9.0);
    }
}

#[test]
fn a_flood_of_forged_trailers_holds_up_nobody() {
    let mut rig = rig(1, &[0]);
    rig.done(orders::request_control());
    rig.take_off(20.0);
    let genuine = rig.guards[&0].sent.last().expect("it has sent").clone();
    let mut sealed = genuine.clone();
    let last = sealed.len() - 1;
    let count = attacks::times(2_000, 760_000);
    for n in 0..count {
        sealed[last] = sealed[last].wrapping_add(1 + (n % 200) as u8);
        if sealed == genuine {
            continue;
        }
        rig.deliver_from(ELSEWHERE.into(), &sealed);
        if n % 100 == 0 {
            rig.run(0.01);
        }
    }
    rig.done(orders::mode(FlightPathControlMode::AutolandEngage));
    let refused = refused(&rig, "guard: wrong trailer");
    assert!(refused > count * 95 / 100, "{refused} of {count}");
    assert_eq!(rig.sent_to.get(&SocketAddr::from(ELSEWHERE)), None);
    let held = "in flight; none taken, none answered, the next command carried out";
    attacks::report(attacks::DATAGRAMS, refused, held);
}
