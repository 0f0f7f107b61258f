//! Web clients: ground stations that come by a WebSocket, under the same key, rights and refusals as by datagrams.

use std::num::NonZeroU64;

use kit::bridge::flight::hold_at;
use kit::bridge::{
    Rig, Setup, StationGuard, VSM, access_key, cucs, guard_key, orders, station_address, vehicle_id,
};
use mavlink_link::signing::SigningKey;
use serde_json::Value;
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode, RequestedAccess};
use stanag_msgs::messages::{CucsAuthorisationRequest, MessageAcknowledgement};
use stanag_msgs::{Message, TimeStamp};
use vsm::session::web::WebRefusal;
use vsm::session::{AccessEntry, AccessGroup as Group, AccessKey, AccessList, LogLevel};

use super::guarded::{ELSEWHERE, forged, refused};

/// A station that is a web client, beside others that are not, and further lines of the configuration.
pub(super) fn rig(stations: u8, access: Option<String>) -> Rig {
    let setup = Setup {
        stations,
        ..Setup::default()
    };
    let mut rig = Rig::new(setup);
    let id = format!("id = \"{}\"\n", cucs(0));
    let web = format!("{id}guard = {{ key_file = \"a.key\" }}\nweb = true\n");
    let mut text = rig.text.replace(&id, &web);
    text += "[http]\nlisten = \"127.0.0.1:8586\"\n[web]\ncontrol = true\n";
    if let Some(list) = access {
        text += "[access]\nlist = \"access.list\"\nkey_file = \"access.key\"\n";
        rig.access = list;
    }
    rig.restart_with(&text);
    rig.stations[0].heartbeats = true;
    rig.run(9.0);
    rig
}

fn status(rig: &Rig) -> Value {
    let bridge = rig.bridge.as_ref().expect("it runs");
    let status = bridge.status(String::new(), rig.now().mono);
    serde_json::to_value(status).expect("JSON")
}

fn altitude_m(rig: &Rig) -> f64 {
    -rig.truth().position.d
}

#[test]
fn a_web_client_flies_from_take_to_release() {
    let mut rig = rig(1, None);
    rig.done(orders::request_control());
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Loiter));
    let shown = status(&rig);
    let station = &shown["stations"][0];
    assert_eq!(shown["vehicles"][0]["controller"], cucs(0).to_string());
    assert_eq!(station["web"]["connected"], true, "{station}");
    assert!(
        station["guard"]["verified"].as_u64() > Some(20),
        "{station}"
    );
    assert!(
        station["guard"]["verified_s"].as_f64() < Some(1.5),
        "{station}"
    );
    rig.done(orders::mode(Mode::AutolandEngage));
    assert!(rig.until(60.0, |rig| rig.truth().landed && !rig.truth().armed));
    let release = CucsAuthorisationRequest {
        requested_handover_access: Some(RequestedAccess::Relinquish),
        ..orders::request_control()
    };
    rig.done(release);
    assert_eq!(status(&rig)["vehicles"][0]["controller"], Value::Null);
    assert_eq!(rig.web[&0].refused, None);
}

#[test]
fn what_comes_in_its_name_by_datagrams_is_dropped_sealed_or_not() {
    let mut rig = rig(1, None);
    rig.done(orders::request_control());
    rig.take_off(20.0);
    let land = |rig: &Rig| {
        forged(
            rig,
            cucs(0),
            vehicle_id(0),
            orders::mode(Mode::AutolandEngage),
        )
    };
    let plain = land(&rig);
    // The client's own key, in a datagram.
    let mut guard = StationGuard::with_key(cucs(0), guard_key(cucs(0)), rig.station_now());
    let sealed = guard.seal(rig.station_now(), &land(&rig));
    for from in [station_address(0), ELSEWHERE.into()] {
        for bytes in [&plain, &sealed] {
            rig.deliver_from(from, bytes);
            rig.run(0.5);
        }
    }
    rig.run(20.0);
    assert!(!rig.truth().landed);
    assert_eq!(refused(&rig, "web: datagram of a web client"), 4);
    let found = status(&rig)["findings"].to_string();
    assert!(found.contains("datagrams in its name"), "{found}");
    rig.done(orders::mode(Mode::Loiter));
}

#[test]
fn another_key_an_unlisted_id_and_one_that_is_no_web_client_open_nothing() {
    let mut rig = rig(2, None);
    let other = SigningKey::new([9; 32]).expect("not all zero");
    assert_eq!(rig.connect_web(0, &other), Err(WebRefusal::Key));
    // Listed, and not for the web.
    assert_eq!(
        rig.connect_web(1, &guard_key(cucs(1))),
        Err(WebRefusal::Unlisted)
    );
    rig.stations[1].id = cucs(7);
    assert_eq!(
        rig.connect_web(1, &guard_key(cucs(7))),
        Err(WebRefusal::Unlisted)
    );
    assert_eq!(refused(&rig, "web: wrong key"), 1);
    assert_eq!(refused(&rig, "web: id not listed for the web"), 2);
    rig.run(1.5);
    let found = status(&rig)["findings"].to_string();
    assert!(found.contains("a connection in its name"), "{found}");
    assert!(!found.contains("datagrams in its name"), "{found}");
    // The client itself is served all the time.
    rig.done(orders::request_control());
}

#[test]
fn the_end_of_a_connection_whose_key_has_verified_accuses_nobody() {
    let mut rig = rig(1, None);
    for why in [WebRefusal::Dead, WebRefusal::TooSlow] {
        let number = rig.web[&0].number;
        rig.web.clear();
        let now = rig.now();
        let bridge = rig.bridge.as_mut().expect("it runs");
        bridge.close_web(now.mono, number, Some(why));
        rig.run(1.5);
        assert_eq!(refused(&rig, why.name()), 1);
        let found = status(&rig)["findings"].to_string();
        assert!(!found.contains(why.name()), "{found}");
        rig.connect_web(0, &guard_key(cucs(0)))
            .expect("the key in force");
    }
    let logged = |text: &str| rig.log.iter().any(|entry| entry.text.contains(text));
    assert!(logged("web client disconnected: dead"), "{:?}", rig.log);
    assert!(!logged("web client refused"), "{:?}", rig.log);
}

#[test]
fn refusals_are_logged_and_a_flood_of_them_hides_nothing_else() {
    let mut rig = rig(1, None);
    let other = SigningKey::new([9; 32]).expect("not all zero");
    for _ in 0..100 {
        assert_eq!(rig.connect_web(0, &other), Err(WebRefusal::Key));
    }
    rig.run(1.0);
    let text = format!(
        "web client refused: wrong key, from {}",
        rig.stations[0].address
    );
    let logged = rig.log.iter().filter(|entry| entry.text == text);
    let of_it: Vec<_> = logged.map(|entry| (entry.level, entry.about)).collect();
    assert_eq!(of_it, [(LogLevel::Warning, cucs(0)); 6]);
    assert_eq!(refused(&rig, "web: wrong key"), 100);
}

#[test]
fn a_client_without_the_right_moves_nothing() {
    let mut rig = rig(2, None);
    let asked = rig.send_as(1, 0, orders::request_control());
    rig.run(3.0);
    assert_eq!(rig.stations[1].end(asked), Some(AckType::CarriedOut));
    assert_eq!(rig.carry_out(orders::launch(20.0)), Some(AckType::Refused));
    rig.run(5.0);
    assert!(rig.truth().landed);
    assert!(refused(&rig, "without the right") > 0);
}

#[test]
fn a_key_that_is_replaced_ends_the_connection_and_a_connection_that_ends_leaves_the_rights_to_silence()
 {
    let mut rig = rig(1, None);
    rig.done(orders::request_control());
    rig.take_off(20.0);
    let new = SigningKey::new([9; 32]).expect("not all zero");
    let now = rig.now();
    let bridge = rig.bridge.as_mut().expect("it runs");
    let keys = vec![(cucs(0), vec![(new.duplicate(), None)])];
    bridge
        .set_guard_keys(keys, now, kit::clock::START, &mut rig.store)
        .expect("its clock can be read");
    rig.run(2.0);
    let bridge = rig.bridge.as_mut().expect("it runs");
    let ended = bridge.poll_web_end();
    assert_eq!(ended, Some((rig.web[&0].number, WebRefusal::KeyGone)));
    assert_eq!(status(&rig)["stations"][0]["web"]["connected"], false);
    assert_eq!(
        status(&rig)["vehicles"][0]["controller"],
        cucs(0).to_string()
    );
    // It comes back under the new key within the time of silence.
    rig.connect_web(0, &new).expect("the key in force");
    rig.done(orders::mode(Mode::Loiter));
    // And without: lost as any station is.
    let number = rig.web[&0].number;
    rig.web.clear();
    let now = rig.now();
    let bridge = rig.bridge.as_mut().expect("it runs");
    bridge.close_web(now.mono, number, None);
    rig.run(12.0);
    assert_eq!(status(&rig)["vehicles"][0]["controller"], Value::Null);
}

#[test]
fn the_access_list_counts_for_the_key_of_a_web_client() {
    let list = |groups: &[Group], key| {
        let mut list = AccessList::new(VSM);
        for group in groups {
            let entry = AccessEntry {
                cucs: cucs(0),
                vehicle: vehicle_id(0),
                group: *group,
                key,
                until: None::<NonZeroU64>,
            };
            list.grant(entry).expect("there is room");
        }
        list.signed(1, &AccessKey::new(&access_key()))
    };
    let key = guard_key(cucs(0)).id();
    let mut listed = rig(1, Some(list(&[Group::Fly, Group::Launch], key)));
    // LOI 3 is requested too, and no entry gives it; 4 and 5 are given.
    listed.carry_out(orders::request_control());
    listed.take_off(20.0);
    // Outside of its groups.
    let mut narrow = rig(1, Some(list(&[Group::Fly], key)));
    narrow.carry_out(orders::request_control());
    assert_eq!(
        narrow.carry_out(orders::launch(20.0)),
        Some(AckType::Refused)
    );
    // For another key: nothing of it.
    let other = SigningKey::new([9; 32]).expect("not all zero").id();
    let mut none = rig(1, Some(list(&[Group::Fly, Group::Launch], other)));
    none.carry_out(orders::request_control());
    assert_eq!(none.carry_out(orders::launch(20.0)), Some(AckType::Refused));
    assert!(none.truth().landed && narrow.truth().landed);
}

#[test]
fn an_alert_that_a_person_has_seen_names_who_it_was() {
    let mut rig = rig(2, None);
    rig.done(orders::request_control());
    // Silence of the vehicle is an alert that stands.
    rig.mav.faults.loss = 1.0;
    rig.run(8.0);
    let alert =
        rig.stations[0]
            .received
            .iter()
            .rev()
            .find_map(|(_, source, message)| match message {
                Message::SubsystemStatusAlert(alert) => Some((*source, alert.clone())),
                _ => None,
            });
    let (source, alert) = alert.expect("an alert");
    let seen = MessageAcknowledgement {
        original_message_type: Some(16000),
        original_message_time_stamp: alert.time_stamp,
        acknowledgement_type: Some(AckType::CarriedOut),
        ..MessageAcknowledgement::default()
    };
    assert_eq!(source, vehicle_id(0));
    let now = rig.station_now();
    rig.stations[0].send_once(now, source, seen.clone().into());
    rig.run(1.0);
    let shown = status(&rig)["vehicles"][0]["alerts"].clone();
    let by = |shown: &Value| {
        let of = shown.as_array().into_iter().flatten();
        let mut of = of.filter(|one| {
            one["id"].as_i64() == alert.alert_warning_id.map(|id| i64::from(id.abs()))
        });
        of.next().map(|one| one["acknowledged"].clone())
    };
    let by = by(&shown).expect("it stands");
    assert_eq!(by[0]["cucs"], cucs(0).to_string(), "{shown}");
    assert!(
        rig.log
            .iter()
            .any(|entry| entry.text.contains("has acknowledged the alert"))
    );
    // A stamp that no alert has.
    let other = MessageAcknowledgement {
        original_message_time_stamp: Some(TimeStamp(5)),
        ..seen
    };
    rig.stations[0].send_once(now, source, other.into());
    rig.run(1.0);
    assert_eq!(refused(&rig, "acknowledges an unknown alert"), 1);
}

/// The experiment of false data (`false_data`), flown by a web client: the vehicle hovers at 2 m, and for 30 s somebody has it land. Where
/// it was meanwhile, m above home: lowest and highest.
fn attacked(attack: impl Fn(&mut Rig, u64)) -> (Rig, f64, f64) {
    let mut rig = rig(1, None);
    rig.done(orders::request_control());
    rig.take_off(HOVER_M);
    rig.done(hold_at(HOVER_M));
    rig.run(10.0);
    let (mut lowest_m, mut highest_m) = (f64::MAX, f64::MIN);
    for shot in 0..SHOTS {
        attack(&mut rig, shot);
        rig.run(0.2);
        lowest_m = lowest_m.min(altitude_m(&rig));
        highest_m = highest_m.max(altitude_m(&rig));
    }
    (rig, lowest_m, highest_m)
}

/// A landing in the name of the client.
fn landing(rig: &Rig) -> Vec<u8> {
    forged(
        rig,
        cucs(0),
        vehicle_id(0),
        orders::mode(Mode::AutolandEngage),
    )
}

#[test]
fn false_data_of_forged_web_clients_move_a_hovering_vehicle_nowhere() {
    let recorded = std::cell::RefCell::new(Vec::new());
    let attack = |rig: &mut Rig, shot: u64| match shot % 4 {
        // A page that has no key, and one that has another.
        0 => {
            let other = SigningKey::new([9; 32]).expect("not all zero");
            assert_eq!(rig.connect_web(0, &other), Err(WebRefusal::Key));
        }
        // By datagrams, as it works without a guard.
        1 => {
            let bytes = landing(rig);
            rig.deliver_from(station_address(0), &bytes);
        }
        // What the client has sent in earlier connections, in a new one.
        2 => {
            let frames = rig.web[&0].sent.clone();
            recorded.borrow_mut().extend(frames);
            rig.connect_web(0, &guard_key(cucs(0)))
                .expect("the client itself");
            let frame = recorded.borrow().last().cloned().expect("one at least");
            rig.deliver_frame(0, &frame);
            assert_eq!(rig.web[&0].refused, Some(WebRefusal::Mac));
            rig.connect_web(0, &guard_key(cucs(0)))
                .expect("it comes back");
        }
        // What the client has sent just now, again: that ends the connection, and it comes back.
        _ => {
            let frame = rig.web[&0].sent.last().cloned().expect("one at least");
            rig.deliver_frame(0, &frame);
            let refused = rig.web[&0].refused;
            assert!(
                matches!(refused, Some(WebRefusal::Counter | WebRefusal::Mac)),
                "{refused:?}"
            );
            rig.connect_web(0, &guard_key(cucs(0)))
                .expect("it comes back");
        }
    };
    let (mut rig, lowest_m, highest_m) = attacked(attack);
    assert!(!rig.truth().landed);
    let held = lowest_m > HOVER_M - 0.3 && highest_m < HOVER_M + 0.3;
    assert!(held, "{lowest_m} to {highest_m} m");
    for name in [
        "web: wrong key",
        "web: datagram of a web client",
        "web: wrong MAC",
    ] {
        assert!(refused(&rig, name) >= SHOTS / 4, "{name}");
    }
    rig.done(orders::mode(Mode::AutolandEngage));
}

#[test]
fn whoever_has_the_key_of_a_web_client_is_the_client() {
    // What the protection rests on: the same landing, from a connection with the key.
    let (rig, lowest_m, _) = attacked(|rig, shot| {
        if shot == 0 {
            rig.connect_web(0, &guard_key(cucs(0))).expect("its key");
        }
        let frames = {
            let bytes = landing(rig);
            rig.web.get_mut(&0).map(|party| party.frames(&bytes))
        };
        for frame in frames.unwrap_or_default() {
            rig.deliver_frame(0, &frame);
        }
    });
    assert!(rig.truth().landed, "{lowest_m}");
}

const HOVER_M: f64 = 2.0;
const SHOTS: u64 = 150;
