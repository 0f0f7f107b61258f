//! Zeroize (50024): two orders of a CUCS with LOI 5, on the ground, have the bridge store an order and end; nothing else does.

use std::time::Duration;

use kit::bridge::{Rig, Setup, cucs, orders, vehicle_id};
use stanag_msgs::enums::{AckType, FtState, LoiBitmap, RequestedAccess};
use stanag_msgs::messages::{CucsAuthorisationRequest, ZeroizeCommand};
use stanag_msgs::{Envelope, MAX_DATAGRAM, Message, TimeStamp};

const DONE: Option<AckType> = Some(AckType::CarriedOut);
const NO: Option<AckType> = Some(AckType::Refused);
const ALLOWED: &str = "[zeroize]\nby_message = true\n";
const IN_FLIGHT: &str = "[zeroize]\nby_message = true\nin_flight = true\n";

/// On the ground, controlled by station 0, whose clock is measured; station 1 listens.
fn controlled(tables: &'static str, vehicles: usize) -> Rig {
    let systems = (1..).take(vehicles);
    let mut rig = Rig::ready_with(Setup {
        stations: 2,
        tables,
        vehicles: systems
            .map(|system_id| px4_sim::Config {
                system_id,
                ..px4_sim::Config::default()
            })
            .collect(),
        ..Setup::default()
    });
    for station in &mut rig.stations {
        station.heartbeats = true;
    }
    rig.done(orders::request_control());
    let listen = CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::LOI2),
        ..orders::request_control()
    };
    let ticket = rig.send_as(1, 0, listen);
    assert_eq!(rig.end_as(1, ticket), DONE);
    rig.run(5.0);
    rig
}

fn order(state: FtState) -> ZeroizeCommand {
    ZeroizeCommand {
        commanded_zeroize_state: Some(state),
        ..ZeroizeCommand::default()
    }
}

/// The bytes of an order made so long ago; `None`: without a Time Stamp.
fn recorded(rig: &Rig, state: FtState, ago: Option<Duration>) -> Vec<u8> {
    let wall = rig.station_now().wall;
    let message = Message::from(ZeroizeCommand {
        time_stamp: ago.map(|ago| TimeStamp::from_unix_ms((wall - ago).as_millis() as u64)),
        ..order(state)
    });
    let envelope = Envelope::new(rig.station().id, vehicle_id(0)).requesting_ack();
    let mut bytes = [0; MAX_DATAGRAM];
    let length = message.encode(&envelope, &mut bytes).expect("it fits");
    bytes[..length].to_vec()
}

/// Whether the shell is to store an order.
fn is_ordered(rig: &Rig) -> bool {
    rig.bridge.as_ref().expect("a bridge").zeroize_to_store()
}

/// What the shell does of it, here without a file.
fn store(rig: &mut Rig, stored: Result<Option<String>, String>) {
    let now = rig.now();
    let Rig { bridge, store, .. } = rig;
    let bridge = bridge.as_mut().expect("a bridge");
    bridge.zeroize_stored(now, stored, store);
    rig.run(0.5);
}

fn audited(rig: &Rig) -> String {
    let name = format!("audit-{:08x}.log", vehicle_id(0).0);
    String::from_utf8_lossy(&rig.store.records[&name]).into_owned()
}

#[test]
fn two_orders_on_the_ground_zeroize_and_every_station_knows() {
    let mut rig = controlled(ALLOWED, 1);
    rig.done(order(FtState::Arm));
    rig.run(0.5);
    for station in &rig.stations {
        assert!(station.has_alert("ZEROIZE ARMED by 1b:00:00:a0"));
    }
    assert!(!is_ordered(&rig));
    let ticket = rig.send(order(FtState::Execute));
    rig.run(0.5);
    assert!(is_ordered(&rig));
    for station in &rig.stations {
        assert!(station.has_alert("ZEROIZE ORDERED by 1b:00:00:a0"));
    }
    // A second one, and a reset, change nothing any more.
    assert_eq!(rig.carry_out(order(FtState::Reset)), NO);
    assert_eq!(rig.carry_out(order(FtState::Arm)), NO);
    assert!(rig.station().has_alert("it is ordered already"));
    let log = audited(&rig);
    let place = |what: &str| {
        log.find(what)
            .unwrap_or_else(|| panic!("no {what} in {log}"))
    };
    assert!(place("zeroize armed") < place("zeroize ordered"));
    // It is carried out for its CUCS once it is stored, and not before.
    store(&mut rig, Ok(None));
    assert_eq!(rig.end(ticket), DONE);
    assert!(!is_ordered(&rig), "stored once");
}

/// Agents and PX4 take half a minute to follow: nobody is to take off meanwhile, and be without keys in the air.
#[test]
fn nothing_takes_off_between_the_order_and_the_end() {
    let mut rig = controlled(ALLOWED, 1);
    rig.done(order(FtState::Arm));
    rig.send(order(FtState::Execute));
    rig.run(0.5);
    assert_eq!(rig.carry_out(orders::launch(20.0)), NO);
    assert!(rig.station().has_alert("a zeroize is ordered"));
    store(&mut rig, Ok(None));
    assert_eq!(rig.carry_out(orders::launch(20.0)), NO);
    rig.run(10.0);
    assert!(!rig.vehicles[0].vehicle().truth().armed);
}

#[test]
fn an_order_that_cannot_be_stored_is_refused_and_all_is_as_it_was() {
    let mut rig = controlled(ALLOWED, 1);
    rig.done(order(FtState::Arm));
    let ticket = rig.send(order(FtState::Execute));
    rig.run(0.5);
    store(&mut rig, Err("No space left on device".into()));
    assert_eq!(rig.end(ticket), NO);
    assert!(rig.stations[1].has_alert("ZEROIZE NOT DONE: No space left on device"));
    assert!(!is_ordered(&rig));
    assert_eq!(rig.carry_out(order(FtState::Execute)), NO);
    rig.done(order(FtState::Arm));
}

#[test]
fn an_order_that_may_be_undone_by_a_power_cut_is_neither_refused_nor_promised() {
    let mut rig = controlled(ALLOWED, 1);
    rig.done(order(FtState::Arm));
    let ticket = rig.send(order(FtState::Execute));
    rig.run(0.5);
    store(&mut rig, Ok(Some("Input/output error".into())));
    assert_eq!(rig.end(ticket), None);
    assert!(rig.stations[1].has_alert("NOT SURELY STORED: Input/output error"));
    assert_eq!(rig.carry_out(order(FtState::Reset)), NO, "it stands");
}

#[test]
fn one_step_a_timeout_replays_old_orders_and_strangers_zeroize_nothing() {
    let mut rig = controlled(ALLOWED, 1);
    assert_eq!(rig.carry_out(order(FtState::Execute)), NO);
    assert!(rig.stations[1].has_alert("zeroize of 1b:00:00:a0 refused: it is not armed"));
    let arm = recorded(&rig, FtState::Arm, Some(Duration::ZERO));
    rig.deliver_from_station(&arm);
    rig.run(1.0);
    assert!(rig.station().has_alert("ZEROIZE ARMED"));
    // Without the right.
    let ticket = rig.send_as(1, 0, order(FtState::Execute));
    assert_eq!(rig.end_as(1, ticket), NO);
    // The duplicate of the first step is no second one, an old order none, and one from elsewhere, or without a Time Stamp, neither.
    rig.deliver_from_station(&arm);
    let old = recorded(&rig, FtState::Execute, Some(Duration::from_millis(2_300)));
    rig.deliver_from_station(&old);
    let fresh = recorded(&rig, FtState::Execute, Some(Duration::ZERO));
    rig.deliver_from("127.0.0.9:49000".parse().expect("an address"), &fresh);
    let stampless = recorded(&rig, FtState::Execute, None);
    rig.deliver_from_station(&stampless);
    rig.run(1.0);
    assert!(!is_ordered(&rig));
    rig.run(31.0);
    assert!(rig.station().has_alert("did not execute it within 30 s"));
    assert_eq!(rig.carry_out(order(FtState::Execute)), NO);
    // After a restart nothing is armed, and no recording counts.
    rig.done(order(FtState::Arm));
    rig.restart_bridge();
    rig.run(6.0);
    for bytes in [&arm, &fresh, &old] {
        rig.deliver_from_station(bytes);
    }
    assert_eq!(rig.carry_out(order(FtState::Execute)), NO);
    assert!(!is_ordered(&rig) && !audited(&rig).contains("zeroize ordered"));
}

#[test]
fn it_is_off_as_it_comes_and_a_change_of_control_disarms_it() {
    let mut rig = controlled("", 1);
    assert_eq!(rig.carry_out(order(FtState::Arm)), NO);
    assert!(rig.station().has_alert("zeroize by message is off"));
    assert!(!rig.stations[1].has_alert("zeroize"));

    let mut rig = controlled(ALLOWED, 1);
    rig.done(order(FtState::Arm));
    let release = CucsAuthorisationRequest {
        requested_handover_access: Some(RequestedAccess::Relinquish),
        ..orders::request_control()
    };
    rig.done(release);
    rig.run(0.5);
    assert!(rig.stations[1].has_alert("no longer controls the vehicle"));
    rig.done(orders::request_control());
    assert_eq!(rig.carry_out(order(FtState::Execute)), NO);
    assert!(!is_ordered(&rig));
}

#[test]
fn no_aircraft_loses_its_link_in_flight_unless_the_configuration_allows_it_and_all_are_warned() {
    let mut rig = controlled(ALLOWED, 1);
    rig.done(order(FtState::Arm));
    rig.take_off(20.0);
    assert_eq!(rig.carry_out(order(FtState::Arm)), NO);
    assert_eq!(rig.carry_out(order(FtState::Execute)), NO);
    assert!(
        rig.station()
            .has_alert("is not known to be disarmed, and would lose its link")
    );
    let here = |rig: &mut Rig, in_flight| {
        let now = rig.now();
        let Rig { bridge, store, .. } = rig;
        let bridge = bridge.as_mut().expect("a bridge");
        bridge.zeroize_here(now, in_flight, store)
    };
    assert!(here(&mut rig, false).is_err());
    assert!(!is_ordered(&rig));
    // Who orders it on the bridge's computer may say that it is meant.
    here(&mut rig, true).expect("ordered");
    rig.run(0.5);
    assert!(is_ordered(&rig));
    assert!(rig.stations[1].has_alert("ORDERED by an operator of its computer"));

    let mut rig = controlled(IN_FLIGHT, 1);
    rig.take_off(20.0);
    rig.done(order(FtState::Arm));
    rig.run(0.5);
    assert!(rig.stations[1].has_alert("IS NOT KNOWN TO BE DISARMED"));
    rig.send(order(FtState::Execute));
    rig.run(0.5);
    assert!(is_ordered(&rig));
}

#[test]
fn where_others_reach_the_dli_only_a_station_with_a_guard_zeroizes() {
    for (guard, answer) in [("", NO), ("guard = { key_file = \"a.key\" }\n", DONE)] {
        let mut rig = controlled(ALLOWED, 1);
        let id = format!("id = \"{}\"\n", cucs(0));
        let text = rig
            .text
            .replace("listen = \"127.0.0.1:", "listen = \"0.0.0.0:");
        assert_ne!(text, rig.text);
        let text = text.replace(&id, &format!("{id}{guard}"));
        rig.restart_with(&text);
        rig.run(9.0);
        rig.done(orders::request_control());
        rig.run(5.0);
        assert_eq!(rig.carry_out(order(FtState::Arm)), answer);
        let said = rig.station().has_alert("give this station a guard");
        assert_eq!(said, guard.is_empty());
        rig.send(order(FtState::Execute));
        rig.run(0.5);
        assert_eq!(is_ordered(&rig), answer == DONE);
    }
}

#[test]
fn no_cucs_zeroizes_what_another_controls() {
    let mut rig = controlled(ALLOWED, 2);
    let take = orders::request_control();
    let ticket = rig.send_as(1, 1, take);
    assert_eq!(rig.end_as(1, ticket), DONE);
    assert_eq!(rig.carry_out(order(FtState::Arm)), NO);
    let why = format!("{} controls vehicle {}", cucs(1), vehicle_id(1));
    assert!(rig.station().has_alert(&why));
    assert!(!is_ordered(&rig));
}
