//! A disk that takes its time to synchronise: no right is granted, or holds, before it is durable, and who has requested it
//! learns at once that the message has arrived; a station that keeps the disk busy delays and loses nothing but its own
//! messages; what waits has a bound.

use std::collections::BTreeMap;
use std::time::Duration;

use kit::bridge::parties::bridge_dli;
use kit::bridge::{Setup, Ticket, orders, vehicle_id};
use stanag_msgs::enums::{AckType, LoiBitmap, RequestedAccess};
use stanag_msgs::messages::{CucsAuthorisationRequest, LoiterConfiguration};
use stanag_msgs::{Envelope, MAX_DATAGRAM, Message, Scaled, TimeStamp};
use vsm::session::{Chain, Stations, Status};

use crate::scene::{A, B, C, CONTROL, Scene, TABLES};

/// A controls, and from now on a synchronisation takes so long.
fn slow(sync: Duration) -> Scene {
    let mut scene = Scene::with(Setup {
        tables: Box::leak(
            format!(
                "{TABLES}[authority]\nwarn_s = 1.0\noffer_s = 2.0\nact_s = 3.0\non_loss = \"rtl\"\n"
            )
            .into_boxed_str(),
        ),
        ..Setup::default()
    });
    scene.take(A);
    scene.rig.store.queues = true;
    scene.rig.sync = sync;
    scene.rig.run(1.0);
    scene
}

fn loiter(radius_m: f64) -> LoiterConfiguration {
    LoiterConfiguration {
        loiter_radius: Some(Scaled::saturating_from_si(radius_m)),
        ..LoiterConfiguration::default()
    }
}

fn status(scene: &Scene) -> Status {
    let bridge = scene.rig.bridge.as_ref().expect("it runs");
    bridge.status(String::new(), scene.rig.now().mono)
}

fn granted(scene: &Scene, station: usize) -> LoiBitmap {
    let pick = |message: &Message| match message {
        Message::VsmAuthorisationResponse(response) => response.loi_granted,
        _ => None,
    };
    let last = scene.rig.stations[station].last(vehicle_id(0), 2, pick);
    last.unwrap_or_default()
}

/// Whether a station was sent that its message has arrived, and nothing else about it.
fn has_only_arrived(scene: &Scene, station: usize, ticket: Ticket) -> bool {
    let answers = scene.rig.stations[station].answers(ticket);
    !answers.is_empty() && answers.iter().all(|one| *one == AckType::Received)
}

#[test]
fn a_right_is_answered_and_holds_once_it_is_durable() {
    let mut scene = slow(Duration::from_secs(2));
    let taken = scene.ask(B, RequestedAccess::Override, CONTROL);
    scene.rig.run(0.1);
    assert_eq!(scene.rig.stations[B].answers(taken), [AckType::Received]);
    scene.rig.run(0.9);
    // Until then A commands, B does not, and nobody is sent anything else.
    assert_eq!(scene.controller(), Some(A));
    assert!(has_only_arrived(&scene, B, taken));
    assert_eq!(granted(&scene, B), LoiBitmap::NONE);
    let of_a = scene.rig.send_as(A, 0, loiter(60.0));
    let of_b = scene.rig.send_as(B, 0, loiter(70.0));
    scene.rig.run(0.2);
    assert_eq!(scene.rig.stations[A].end(of_a), Some(AckType::CarriedOut));
    assert!(granted(&scene, A).contains(LoiBitmap::from_raw(CONTROL)));
    // What B is answered keeps its order: its refusal comes behind the grant.
    assert!(scene.rig.stations[B].answers(of_b).is_empty());
    let asked = scene.ask(A, RequestedAccess::Request, 0);
    scene.rig.run(0.2);
    assert_eq!(scene.rig.stations[A].end(asked), Some(AckType::CarriedOut));
    // The ceiling of the signing clock may have been on its way to the disk before.
    scene.rig.run(4.0);
    assert_eq!(scene.rig.stations[B].end(taken), Some(AckType::CarriedOut));
    assert_eq!(scene.rig.stations[B].end(of_b), Some(AckType::Refused));
    assert_eq!(scene.controller(), Some(B));
    assert!(!granted(&scene, A).contains(LoiBitmap::from_raw(CONTROL)));
    assert_eq!(status(&scene).held, 0);
}

#[test]
fn a_right_that_was_not_durable_is_gone_with_the_process_and_was_never_granted() {
    let mut scene = slow(Duration::from_secs(2));
    let taken = scene.ask(B, RequestedAccess::Override, CONTROL);
    scene.rig.run(0.2);
    scene.rig.stations[B].give_up(taken);
    scene.rig.run(0.8);
    scene.rig.restart_bridge();
    scene.rig.run(4.0);
    let alerts = scene.rig.stations[B].alerts();
    assert!(has_only_arrived(&scene, B, taken), "{alerts:?}");
    assert_eq!(scene.controller(), Some(A));
    // The log has a line too many at most, and its chain is whole.
    let log = Chain::verify(&scene.rig.store.records["audit-1b000101.log"], None);
    assert!(log.broken.is_none() && !log.torn);
    // The same message is not taken for one that was carried out.
    scene.rig.stations[B].repeat(taken);
    scene.rig.run(5.0);
    assert_eq!(scene.rig.stations[B].end(taken), Some(AckType::CarriedOut));
    assert_eq!(scene.controller(), Some(B));
}

#[test]
fn a_disk_that_fails_at_once_refuses_and_one_that_never_ends_promises_nothing() {
    let mut scene = slow(Duration::from_secs(1_000));
    let first = scene.ask(B, RequestedAccess::Override, CONTROL);
    scene.rig.run(0.5);
    scene.rig.store.full = Some("authority");
    let release = scene.ask(A, RequestedAccess::Relinquish, CONTROL);
    scene.rig.run(5.0);
    assert!(has_only_arrived(&scene, B, first));
    assert_eq!(scene.controller(), Some(A));
    assert_ne!(
        scene.rig.stations[A].end(release),
        Some(AckType::CarriedOut)
    );
}

#[test]
fn a_record_that_cannot_be_made_durable_keeps_no_station_from_its_other_answers() {
    let mut scene = slow(Duration::from_millis(300));
    scene.rig.store.stuck = Some("authority");
    let taken = scene.ask(B, RequestedAccess::Override, CONTROL);
    scene.rig.run(1.0);
    // Nobody controls by it, and B is granted nothing; what else B asks is answered.
    assert!(has_only_arrived(&scene, B, taken));
    assert_eq!(scene.controller(), Some(A));
    // Operators learn that, and once it is over.
    assert!(scene.rig.stations[A].has_alert("cannot store record authority"));
    let of_b = scene.rig.send_as(B, 0, loiter(70.0));
    let of_a = scene.rig.send_as(A, 0, loiter(60.0));
    scene.rig.run(0.2);
    assert_eq!(scene.rig.stations[B].end(of_b), Some(AckType::Refused));
    assert_eq!(scene.rig.stations[A].end(of_a), Some(AckType::CarriedOut));
    // Once it is durable, it takes effect.
    scene.rig.store.stuck = None;
    scene.rig.store.queued += 1;
    scene.rig.run(1.0);
    assert_eq!(scene.rig.stations[B].end(taken), Some(AckType::CarriedOut));
    assert_eq!(scene.controller(), Some(B));
    assert!(scene.rig.stations[A].has_alert("the VSM stores records again"));
}

#[test]
fn what_is_flown_for_a_lost_controller_does_not_wait_for_a_disk_that_never_ends_or_is_full() {
    for full in [None, Some("authority"), Some("audit")] {
        let mut scene = slow(Duration::from_millis(300));
        scene.rig.stations[A].heartbeats = true;
        scene.rig.run(2.0);
        scene.rig.done(orders::launch(20.0));
        scene.rig.run(20.0);
        assert_eq!(scene.rig.truth().mode, px4_sim::Mode::Loiter);
        scene.rig.dli.faults.loss = 1.0;
        match full {
            None => scene.rig.sync = Duration::from_secs(1_000),
            full => scene.rig.store.full = full,
        }
        let returns = |rig: &kit::bridge::Rig| rig.truth().mode == px4_sim::Mode::Rtl;
        assert!(
            scene.rig.until(8.0, returns),
            "{full:?}: {:?}",
            scene.rig.truth().mode
        );
    }
}

/// Its sender repeats it meanwhile, and "received" is never the last answer.
type Step = fn(&mut Scene) -> Ticket;

#[test]
fn whatever_disposes_of_rights_is_acknowledged_at_once_and_ends_with_its_decision() {
    let released = |scene: &mut Scene| scene.ask(A, RequestedAccess::Relinquish, CONTROL);
    let named = |scene: &mut Scene| scene.hand_over(A, B, CONTROL);
    let query = |scene: &mut Scene| {
        scene.ask(A, RequestedAccess::Relinquish, CONTROL);
        scene.ask(A, RequestedAccess::Request, 0)
    };
    let each: [(&str, Step); 3] = [("1", released), ("4", named), ("1 after 1", query)];
    for (what, send) in each {
        let mut scene = slow(Duration::from_secs(2));
        let ticket = send(&mut scene);
        scene.rig.run(0.1);
        let answers = scene.rig.stations[A].answers(ticket);
        assert_eq!(answers, [AckType::Received], "{what}");
        scene.rig.run(1.4);
        assert!(has_only_arrived(&scene, A, ticket), "{what}");
        scene.rig.run(6.0);
        let answers = scene.rig.stations[A].answers(ticket);
        let last = answers.last().copied();
        // What a named successor has not accepted yet is still received.
        let expected = match what {
            "4" => AckType::Received,
            _ => AckType::CarriedOut,
        };
        assert_eq!(last, Some(expected), "{what}: {answers:?}");
        assert_eq!(status(&scene).held, 0, "{what}");
    }
}

/// An address that has proven nothing is sent three times what came from it at most, and that is for what was decided.
#[test]
fn an_address_that_has_proven_nothing_is_sent_the_decision_alone() {
    let mut scene = slow(Duration::from_millis(300));
    scene.rig.stations[C].acknowledges = false;
    let taken = scene.ask_stations(C, RequestedAccess::Request, 0x02, Stations::one(1));
    scene.rig.run(20.0);
    let answers = scene.rig.stations[C].answers(taken);
    assert_eq!(answers.first(), Some(&AckType::CarriedOut), "{answers:?}");
    assert!(!answers.contains(&AckType::Received), "{answers:?}");
}

#[test]
fn an_upload_is_answered_once_it_is_durable_and_what_follows_keeps_its_order() {
    let mut scene = slow(Duration::from_secs(2));
    scene.rig.send_plan(orders::square());
    let load = scene.rig.send(orders::load());
    assert!(scene.rig.until(30.0, |rig| {
        rig.stations[A].answers(load).contains(&AckType::Received)
    }));
    assert!(
        scene
            .rig
            .until(30.0, |rig| rig.stations[A].end(load).is_some())
    );
    assert_eq!(scene.rig.stations[A].end(load), Some(AckType::CarriedOut));
    assert!(scene.rig.store.waiting.is_empty() || status(&scene).held == 0);
}

/// B takes and gives up LOI 3 so often a second for ten seconds, while A commands five times a second: the longest time
/// that A waited for an answer, and what was most in any queue.
fn attack(scene: &mut Scene, rate: u32) -> (Duration, usize) {
    let mut open = BTreeMap::new();
    let (mut longest, mut most, mut sent) = (Duration::ZERO, 0, 0_u64);
    let begun = scene.rig.clock.elapsed();
    let mut next = begun;
    while scene.rig.clock.elapsed() < begun + Duration::from_secs(10) {
        let clock = scene.rig.clock.elapsed();
        while sent < u64::from(rate) * (clock - begun).as_millis() as u64 / 1_000 {
            // Stamps by B's clock, two in a millisecond where that must be.
            let stamp = scene.rig.station_now().wall.as_millis() as u64;
            flood(scene, sent, stamp - 9 + sent * 1_000 / u64::from(rate) % 10);
            sent += 1;
        }
        if clock >= next {
            next += Duration::from_millis(200);
            let ticket = scene.rig.send_as(A, 0, loiter(50.0 + next.as_secs_f64()));
            open.insert(next, (clock, ticket));
        }
        scene.rig.run(0.01);
        let clock = scene.rig.clock.elapsed();
        open.retain(|_, (at, ticket)| {
            let waits = scene.rig.stations[A].end(*ticket).is_none();
            longest = longest.max(clock - *at);
            waits
        });
        most = most.max(status(scene).held + scene.rig.store.waiting.len());
        scene.rig.stations[B].received.clear();
    }
    assert!(
        open.len() <= 1,
        "{} of A's commands are not answered",
        open.len()
    );
    (longest, most)
}

fn flood(scene: &mut Scene, number: u64, stamp_ms: u64) {
    let access = match number % 2 {
        0 => RequestedAccess::Request,
        _ => RequestedAccess::Relinquish,
    };
    let message = Message::from(CucsAuthorisationRequest {
        time_stamp: Some(TimeStamp::from_unix_ms(stamp_ms)),
        requested_handover_loi: Some(LoiBitmap::from_raw(0x03)),
        requested_handover_access: Some(access),
        controlled_station_1_16: Some(Stations::one(1).low()),
        ..CucsAuthorisationRequest::default()
    });
    let station = &scene.rig.stations[B];
    let envelope = Envelope::new(station.id, vehicle_id(0)).requesting_ack();
    let mut bytes = [0; MAX_DATAGRAM];
    let length = message.encode(&envelope, &mut bytes).expect("it fits");
    let (clock, from) = (scene.rig.clock.elapsed(), station.address);
    let bytes = bytes[..length].to_vec();
    scene.rig.dli.send(clock, from, bridge_dli(), bytes);
}

#[test]
fn a_station_that_keeps_the_disk_busy_delays_nobody_and_loses_its_own_messages_alone() {
    for (rate, over) in [(30, false), (2_000, true)] {
        let mut scene = slow(Duration::from_millis(300));
        let (longest, most) = attack(&mut scene, rate);
        // Two steps of the clock there and back.
        assert!(
            longest <= Duration::from_millis(30),
            "{rate}/s: {longest:?}"
        );
        assert!(most <= 512, "{rate}/s: {most} wait");
        let refused = status(&scene).refused;
        assert!(refused.get("too many changes of rights") > 0, "{rate}/s");
        assert_eq!(refused.get("over the station's rate") > 0, over, "{rate}/s");
        // It gets what it asks for again as soon as it asks like anybody else.
        scene.rig.run(10.0);
        let ticket = scene.ask_stations(B, RequestedAccess::Request, 0x02, Stations::one(2));
        assert_eq!(scene.end(B, ticket), Some(AckType::CarriedOut));
        assert_eq!(status(&scene).held, 0);
    }
}
