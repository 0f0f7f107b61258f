//! CUCSs with a guard in a multicast group: status reaches each under the group's key, and nothing under it commands.

use std::time::Duration;

use kit::bridge::{Rig, VSM, cucs, guard_key, orders, station_address, vehicle_id};
use mavlink_link::signing::SigningKey;
use stanag_msgs::Id;
use stanag_msgs::enums::{FlightPathControlMode, LoiBitmap};
use stanag_msgs::guard::{Direction, GuardKey, Guarded, MAX_GUARDED, TRAILER_BYTES, Trailer};
use stanag_msgs::messages::CucsAuthorisationRequest;
use vsm::session::GuardRefusal;

use crate::guarded::{ELSEWHERE, forged, refused, rig};

/// As [`rig`], in a group, with this `delivery` for all that have a guard.
fn in_group(stations: u8, guarded: &[usize], delivery: &str) -> Rig {
    let mut rig = rig(stations, guarded);
    let text = rig
        .text
        .replace("[dli]\n", "[dli]\nmulticast = \"225.200.1.0:51017\"\n");
    let guard = "guard = { key_file = \"a.key\" }\n";
    let text = text.replace(guard, &format!("{guard}delivery = \"{delivery}\"\n"));
    rig.restart_with(&text);
    rig.run(9.0);
    rig
}

fn monitor() -> CucsAuthorisationRequest {
    CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::LOI2),
        ..orders::request_control()
    }
}

/// What of the group the guard of a station takes for it from now on, in so many seconds.
fn received(rig: &mut Rig, station: usize, seconds: f64) -> usize {
    rig.group.clear();
    let taken = |rig: &Rig| rig.guards[&station].group_taken.len();
    let before = taken(rig);
    rig.run(seconds);
    taken(rig) - before
}

#[test]
fn status_reaches_a_guarded_station_by_the_group_alone_and_it_flies() {
    let mut rig = in_group(1, &[0], "group");
    rig.stations[0].heartbeats = true;
    rig.run(6.0);
    rig.done(orders::request_control());
    rig.take_off(20.0);
    assert!(received(&mut rig, 0, 5.0) > 5);
    // Nothing of it goes out in the clear, and nothing of it is readable under another key than the group's.
    assert!(
        rig.group
            .iter()
            .all(|bytes| Guarded::parse(bytes).is_some())
    );
    let key = GuardKey::new(guard_key(cucs(0)).expose());
    for bytes in &rig.group {
        let guarded = Guarded::parse(bytes).expect("a trailer");
        assert_eq!(guarded.trailer.direction, Direction::ToGroup);
        assert!(!key.verifies(&guarded, cucs(0)) && !key.verifies(&guarded, Id::BROADCAST));
    }
    // Twice it is taken once.
    let (now, sent) = (rig.station_now(), rig.group.clone());
    let guard = rig.guards.get_mut(&0).expect("it has one");
    for bytes in &sent {
        assert_eq!(
            guard.open_group(now, bytes),
            Err(Some(GuardRefusal::Replayed))
        );
    }
}

#[test]
fn both_ways_serve_and_a_restart_of_either_end_renews_the_key() {
    let mut rig = in_group(2, &[0], "both");
    for station in [0, 1] {
        rig.stations[station].heartbeats = true;
    }
    rig.done(orders::request_control());
    rig.send_as(1, 0, monitor());
    assert!(received(&mut rig, 0, 8.0) > 5);
    // The other station has no guard: what is for it goes out as it always did.
    assert!(
        rig.group
            .iter()
            .any(|bytes| Guarded::parse(bytes).is_none())
    );
    rig.restart_bridge();
    rig.run(8.0);
    assert!(received(&mut rig, 0, 5.0) > 5, "after a restart of the VSM");
    let now = rig.station_now();
    rig.guards.get_mut(&0).expect("it has one").restart(now);
    let before = rig.group.clone();
    rig.run(8.0);
    assert!(received(&mut rig, 0, 5.0) > 5, "after one of the guard");
    let now = rig.station_now();
    let guard = rig.guards.get_mut(&0).expect("it has one");
    for bytes in &before {
        assert!(
            guard.open_group(now, bytes).is_err(),
            "from before its start"
        );
    }
}

#[test]
fn a_revoked_guard_seals_nothing_that_another_takes() {
    let mut rig = in_group(2, &[0, 1], "both");
    for station in [0, 1] {
        rig.stations[station].heartbeats = true;
    }
    rig.done(orders::request_control());
    rig.send_as(1, 0, monitor());
    rig.run(8.0);
    assert!(received(&mut rig, 1, 3.0) > 0);
    let one = rig.group.last().cloned().expect("something was sent");
    let first = Guarded::parse(&one).expect("sealed").trailer.key_id;
    let new = |byte| SigningKey::new([byte; 32]).expect("not all zero");
    let now = rig.now();
    let keys = vec![
        (cucs(0), vec![(guard_key(cucs(0)), None)]),
        (cucs(1), vec![(new(9), None)]),
    ];
    let bridge = rig.bridge.as_mut().expect("it runs");
    let given = bridge.set_guard_keys(keys, now, Duration::ZERO, &mut rig.store);
    given.expect("it is good");
    rig.run(8.0);
    assert!(received(&mut rig, 0, 3.0) > 0, "who stays has the new one");
    for bytes in &rig.group {
        let guarded = Guarded::parse(bytes).expect("sealed");
        assert_ne!(guarded.trailer.key_id, first, "another key");
    }
    assert!(
        received(&mut rig, 1, 3.0) == 0,
        "who was locked out has not"
    );
}

#[test]
fn nothing_under_a_group_key_is_ever_a_command() {
    let mut rig = in_group(1, &[0], "both");
    rig.stations[0].heartbeats = true;
    rig.done(orders::request_control());
    rig.take_off(20.0);
    // Whoever has a guard of the group, or is in the VSM's place, and any key at all.
    let key = GuardKey::new(guard_key(cucs(0)).expose());
    let order = forged(
        &rig,
        cucs(0),
        vehicle_id(0),
        orders::mode(FlightPathControlMode::AutolandEngage),
    );
    let before = refused(&rig, "guard: under a group key, which commands nothing");
    for (sender, receiver) in [(cucs(0), Id::BROADCAST), (cucs(0), VSM), (Id(5), VSM)] {
        let trailer = Trailer {
            direction: Direction::ToGroup,
            sender,
            key_id: key.id(),
            stamp_us: rig.station_now().wall.as_micros() as u64 + 1_000,
        };
        let mut out = [0; MAX_GUARDED];
        let length = key
            .seal(&trailer, receiver, &order, &mut out)
            .expect("it fits");
        for from in [station_address(0), ELSEWHERE.into()] {
            rig.deliver_from(from, &out[..length]);
        }
    }
    // The VSM's own status, which comes back to it, and a command in its place.
    let mut own = rig.group.last().cloned().expect("something was sent");
    rig.deliver_from(station_address(0), &own);
    own.splice(..own.len() - TRAILER_BYTES, order.iter().copied());
    rig.deliver_from(station_address(0), &own);
    rig.run(20.0);
    assert!(!rig.truth().landed);
    let after = refused(&rig, "guard: under a group key, which commands nothing");
    assert_eq!(after, before + 6);
    rig.done(orders::mode(FlightPathControlMode::AutolandEngage));
}
