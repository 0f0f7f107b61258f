//! A release is never passed over: to the vehicle, to the VSM or to everybody it is done, or refused with the reason.

use std::time::Duration;

use crate::scene::{A, B, CONTROL, Scene};
use kit::bridge::{Ticket, VSM, orders, vehicle_id};
use stanag_msgs::enums::{AckType, FlightPathControlMode, LoiBitmap, RequestedAccess};
use stanag_msgs::messages::CucsAuthorisationRequest;
use stanag_msgs::{Id, Message};

fn send(scene: &mut Scene, by: usize, to: Id, loi: u8, access: RequestedAccess) -> Ticket {
    let request = CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::from_raw(loi)),
        requested_handover_access: Some(access),
        ..CucsAuthorisationRequest::default()
    };
    let now = scene.rig.station_now();
    scene.rig.stations[by].send(now, to, request.into())
}

#[test]
fn levels_that_are_named_are_released_by_the_vsm_and_by_everybody() {
    for to in [VSM, Id::BROADCAST] {
        let mut scene = Scene::controlled();
        let release = send(&mut scene, A, to, CONTROL, RequestedAccess::Relinquish);
        assert_eq!(scene.end(A, release), Some(AckType::CarriedOut));
        assert_eq!(scene.controller(), None, "{to}");
        // Again: there is nothing left, and that is no fault.
        let release = send(&mut scene, A, to, CONTROL, RequestedAccess::Relinquish);
        assert_eq!(scene.end(A, release), Some(AckType::CarriedOut));
    }
}

#[test]
fn a_release_of_no_level_to_all_is_refused_to_a_holder_and_is_a_question_of_others() {
    let mut scene = Scene::controlled();
    let release = send(&mut scene, A, VSM, 0, RequestedAccess::Relinquish);
    assert_eq!(scene.end(A, release), Some(AckType::Refused));
    assert!(scene.rig.stations[A].has_alert("nothing is released: name the levels"));
    assert_eq!(scene.controller(), Some(A));
    let question = send(&mut scene, B, VSM, 0, RequestedAccess::Relinquish);
    assert_eq!(scene.end(B, question), Some(AckType::CarriedOut));
}

/// Each grant of LOI 2 is a file, a line and a welcome: of a flood in the name of a station that only listens few are given, and
/// who controls is answered as ever.
#[test]
fn monitoring_that_is_requested_and_released_in_a_flood_delays_nobody() {
    let mut scene = Scene::controlled();
    let seen = scene.rig.stations[B].received.len();
    for _ in 0..1_000 {
        for access in [RequestedAccess::Request, RequestedAccess::Relinquish] {
            send(&mut scene, B, vehicle_id(0), 1, access);
        }
        scene.rig.run(0.005);
    }
    let given = scene.rig.stations[B].received[seen..]
        .iter()
        .filter(|(_, _, message)| {
            matches!(message, Message::VsmAuthorisationResponse(answer)
            if answer.loi_granted.is_some_and(|levels| levels.contains(LoiBitmap::LOI2)))
        });
    let given = given.count();
    assert!((40..=150).contains(&given), "{given}");
    let command = scene
        .rig
        .send_as(A, 0, orders::mode(FlightPathControlMode::Loiter));
    let before = scene.rig.clock.elapsed();
    assert!(scene.end(A, command).is_some());
    let took = scene.rig.clock.elapsed() - before;
    assert!(took < Duration::from_secs(3), "{took:?}");
    assert_eq!(scene.controller(), Some(A));
}

#[test]
fn rights_are_not_given_over_all_vehicles_at_once() {
    let mut scene = Scene::new();
    let request = send(
        &mut scene,
        B,
        Id::BROADCAST,
        CONTROL,
        RequestedAccess::Override,
    );
    assert_eq!(scene.end(B, request), Some(AckType::Refused));
    assert!(scene.rig.stations[B].has_alert("rights must be requested from a single vehicle"));
    assert_eq!(scene.controller(), None);
}

#[test]
fn a_question_brings_what_is_pending_again() {
    let mut scene = Scene::controlled();
    scene.hand_over(B, B, CONTROL);
    scene.rig.run(0.3);
    scene.rig.stations[A].latest.clear();
    let question = send(&mut scene, A, Id::BROADCAST, 0, RequestedAccess::Unknown(9));
    assert_eq!(scene.end(A, question), Some(AckType::CarriedOut));
    let asked = scene.rig.stations[A]
        .latest
        .contains_key(&(kit::bridge::vehicle_id(0), 4));
    assert!(asked, "A may never have received the request");
}

#[test]
fn a_station_that_returns_without_heartbeats_loses_nothing_by_silence() {
    let mut scene = Scene::controlled();
    scene.rig.stations[A].heartbeats = true;
    scene.rig.run(3.0);
    scene.rig.stations[A].heartbeats = false;
    let vehicle = kit::bridge::vehicle_id(0);
    let release = send(&mut scene, A, vehicle, 0, RequestedAccess::Relinquish);
    assert_eq!(scene.end(A, release), Some(AckType::CarriedOut));
    let request = send(&mut scene, A, vehicle, CONTROL, RequestedAccess::Request);
    assert_eq!(scene.end(A, request), Some(AckType::CarriedOut));
    scene.rig.run(30.0);
    assert_eq!(scene.controller(), Some(A));
    // A restart has not remembered the heartbeats of before either.
    scene.rig.restart_bridge();
    scene.rig.run(30.0);
    assert_eq!(scene.controller(), Some(A));
}
