//! The table of handover cases: each a test by its name, its sequence drawn in docs/guide/authority.md from its own trace.

use crate::scene::{A, B, C, CONTROL, Scene, TABLES};
use kit::bridge::{Setup, orders};
use stanag_msgs::Message;
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode, HandoverStatus, RequestedAccess};
use stanag_msgs::messages::GenericInformationRequestMessage;
use vsm::session::Stations;

const DONE: Option<AckType> = Some(AckType::CarriedOut);
const NO: Option<AckType> = Some(AckType::Refused);

fn reported(scene: &Scene, by: usize, status: HandoverStatus) -> bool {
    scene.received(
        by,
        |m| matches!(m, Message::HandoverStatusReport(m) if m.status == Some(status)),
    )
}

#[test]
fn free_control_is_granted_at_once() {
    let mut scene = Scene::new();
    let wish = scene.hand_over(B, B, CONTROL);
    assert_eq!(scene.end(B, wish), DONE);
    assert_eq!(scene.controller(), Some(B));
    scene.drawn("free_control_is_granted_at_once");
}

#[test]
fn the_holder_consents() {
    let mut scene = Scene::controlled();
    let wish = scene.hand_over(B, B, CONTROL);
    scene.rig.run(0.3);
    assert_eq!(scene.controller(), Some(A), "control stays until it passes");
    assert!(scene.received(A, |m| matches!(
        m,
        Message::PositiveHandoverAuthorisationRequest(_)
    )));
    let consent = scene.hand_over(A, B, CONTROL);
    assert_eq!((scene.end(A, consent), scene.end(B, wish)), (DONE, DONE));
    assert_eq!(scene.controller(), Some(B));
    assert!(reported(&scene, A, HandoverStatus::Successful));
    scene.drawn("the_holder_consents");
}

#[test]
fn the_holder_refuses() {
    let mut scene = Scene::controlled();
    let wish = scene.hand_over(B, B, CONTROL);
    scene.rig.run(0.3);
    let refusal = scene.hand_over(A, B, 0);
    assert_eq!((scene.end(A, refusal), scene.end(B, wish)), (DONE, NO));
    assert_eq!(scene.controller(), Some(A));
    scene.drawn("the_holder_refuses");
}

#[test]
fn the_holder_lets_it_lapse() {
    let mut scene = Scene::controlled();
    let wish = scene.hand_over(B, B, CONTROL);
    scene.rig.run(19.0);
    assert_eq!(scene.pending(), 1);
    scene.note_event("20 s without an answer");
    assert_eq!(scene.end(B, wish), NO);
    assert_eq!((scene.controller(), scene.pending()), (Some(A), 0));
    scene.drawn("the_holder_lets_it_lapse");
}

#[test]
fn a_named_successor_accepts() {
    let mut scene = Scene::controlled();
    let offer = scene.hand_over(A, C, CONTROL);
    scene.rig.run(0.3);
    assert_eq!(scene.controller(), Some(A), "an offer moves nothing");
    let acceptance = scene.hand_over(C, C, CONTROL);
    assert_eq!(
        (scene.end(C, acceptance), scene.end(A, offer)),
        (DONE, DONE)
    );
    assert_eq!(scene.controller(), Some(C));
    scene.drawn("a_named_successor_accepts");
}

#[test]
fn a_named_successor_declines() {
    let mut scene = Scene::controlled();
    let offer = scene.hand_over(A, C, CONTROL);
    scene.rig.run(0.3);
    let refusal = scene.hand_over(C, C, 0);
    assert_eq!((scene.end(C, refusal), scene.end(A, offer)), (DONE, NO));
    assert_eq!(scene.controller(), Some(A));
    scene.drawn("a_named_successor_declines");
}

#[test]
fn a_higher_rank_overrides() {
    let mut scene = Scene::controlled();
    let taken = scene.ask(B, RequestedAccess::Override, CONTROL);
    assert_eq!(scene.end(B, taken), DONE);
    assert_eq!(scene.controller(), Some(B));
    scene.drawn("a_higher_rank_overrides");
}

#[test]
fn an_override_without_the_rank_is_refused() {
    let mut scene = Scene::new();
    scene.take(B);
    let refused = scene.ask(C, RequestedAccess::Override, CONTROL);
    assert_eq!(scene.end(C, refused), NO);
    let refused = scene.ask(A, RequestedAccess::Override, CONTROL);
    assert_eq!(scene.end(A, refused), NO);
    assert_eq!(scene.controller(), Some(B));
    scene.drawn("an_override_without_the_rank_is_refused");
}

#[test]
fn of_two_wishes_at_once_the_first_counts() {
    let mut scene = Scene::controlled();
    let first = scene.hand_over(B, B, CONTROL);
    scene.rig.run(0.1);
    let second = scene.hand_over(C, C, CONTROL);
    assert_eq!(scene.end(C, second), NO);
    let consent = scene.hand_over(A, B, CONTROL);
    assert_eq!((scene.end(A, consent), scene.end(B, first)), (DONE, DONE));
    assert_eq!(scene.controller(), Some(B));
    scene.drawn("of_two_wishes_at_once_the_first_counts");
}

#[test]
fn a_transfer_waits_until_the_upload_has_ended() {
    let mut scene = Scene::controlled();
    let waypoints: Vec<Message> = orders::square();
    for message in waypoints {
        scene.rig.done(message);
    }
    let load = scene.rig.send(orders::load());
    scene.rig.run(0.02);
    let taken = scene.ask(B, RequestedAccess::Override, CONTROL);
    assert!(
        scene
            .rig
            .until(5.0, |rig| !rig.stations[B].answers(taken).is_empty())
    );
    assert_eq!(scene.rig.stations[B].end(taken), None, "it waits");
    assert_eq!(scene.controller(), Some(A));
    scene.note_event("the load of A ends");
    assert_eq!(scene.end(B, taken), DONE);
    assert_eq!(
        scene.rig.stations[A].end(load),
        DONE,
        "the upload was finished first"
    );
    assert_eq!(scene.controller(), Some(B));
    scene.drawn("a_transfer_waits_until_the_upload_has_ended");
}

#[test]
fn during_launch_control_passes_by_override_only() {
    let mut scene = Scene::controlled();
    scene.rig.send(orders::launch(40.0));
    assert!(scene.rig.until(20.0, |rig| rig.truth().position.d < -3.0));
    scene.note_event("A launches");
    let wish = scene.hand_over(C, C, CONTROL);
    assert_eq!(scene.end(C, wish), NO);
    let offer = scene.hand_over(A, C, CONTROL);
    assert_eq!(scene.end(A, offer), NO);
    assert_eq!(scene.controller(), Some(A));
    let taken = scene.ask(B, RequestedAccess::Override, CONTROL);
    assert_eq!(scene.end(B, taken), DONE);
    assert_eq!(scene.controller(), Some(B));
    scene.drawn("during_launch_control_passes_by_override_only");
}

#[test]
fn a_release_during_launch_is_granted_and_the_vehicle_continues() {
    let mut scene = Scene::controlled();
    scene.rig.send(orders::launch(20.0));
    assert!(scene.rig.until(20.0, |rig| rig.truth().position.d < -3.0));
    scene.note_event("A launches");
    let release = scene.ask(A, RequestedAccess::Relinquish, 0);
    assert_eq!(scene.end(A, release), DONE);
    assert_eq!(scene.controller(), None);
    assert!(
        scene.rig.until(30.0, |rig| rig.truth().position.d < -19.0),
        "the launch continues"
    );
    scene.drawn("a_release_during_launch_is_granted_and_the_vehicle_continues");
}

#[test]
fn a_silent_holder_is_succeeded_and_gets_nothing_back() {
    let mut scene = Scene::controlled();
    scene.rig.stations[A].heartbeats = true;
    scene.rig.run(2.0);
    scene.rig.stations[A].heartbeats = false;
    scene.note_event("A falls silent");
    let early = scene.ask(C, RequestedAccess::Request, CONTROL);
    assert_eq!(scene.end(C, early), NO, "its last heartbeat is recent");
    scene.rig.run(5.5);
    let taken = scene.ask(C, RequestedAccess::Request, CONTROL);
    assert_eq!(scene.end(C, taken), DONE);
    scene.rig.stations[A].heartbeats = true;
    scene.rig.run(3.0);
    assert_eq!(
        scene.controller(),
        Some(C),
        "who comes back gets nothing by itself"
    );
    let command = scene.rig.send_as(A, 0, orders::mode(Mode::Loiter));
    assert_eq!(scene.end(A, command), NO);
    scene.drawn("a_silent_holder_is_succeeded_and_gets_nothing_back");
}

#[test]
fn a_lost_holder_leaves_control_free() {
    let mut scene = Scene::controlled();
    scene.rig.stations[A].heartbeats = true;
    scene.rig.run(2.0);
    scene.rig.stations[A].heartbeats = false;
    scene.note_event("A falls silent");
    scene.rig.run(11.5);
    assert_eq!(scene.controller(), None);
    for status in [
        HandoverStatus::NotRequested,
        HandoverStatus::InProgress,
        HandoverStatus::Failed,
    ] {
        assert!(reported(&scene, A, status), "{status:?}");
    }
    for text in [
        "no data from the controlling CUCS",
        "another may take control",
        "is lost",
    ] {
        assert!(scene.rig.stations[A].has_alert(text), "{text}");
    }
    scene.drawn("a_lost_holder_leaves_control_free");
}

#[test]
fn heartbeats_before_the_grant_make_no_later_silence_count() {
    let mut scene = Scene::new();
    scene.rig.stations[A].heartbeats = true;
    scene.rig.run(3.0);
    scene.rig.stations[A].heartbeats = false;
    scene.take(A);
    scene.rig.run(15.0);
    assert_eq!(scene.controller(), Some(A), "it never sent one as a holder");
    scene.rig.stations[A].heartbeats = true;
    scene.rig.run(2.0);
    scene.rig.stations[A].heartbeats = false;
    scene.rig.run(11.5);
    assert_eq!(scene.controller(), None, "now it has");
}

#[test]
fn a_restart_keeps_control_and_the_pending_handover() {
    let mut scene = Scene::controlled();
    let wish = scene.hand_over(B, B, CONTROL);
    scene.rig.run(0.3);
    scene.note_event("the VSM is killed and restarted");
    scene.rig.restart_bridge();
    assert_eq!((scene.controller(), scene.pending()), (Some(A), 1));
    let consent = scene.hand_over(A, B, CONTROL);
    assert_eq!(scene.end(A, consent), DONE);
    assert_eq!(scene.controller(), Some(B));
    assert!(
        reported(&scene, B, HandoverStatus::Successful),
        "B is notified too"
    );
    scene.rig.stations[B].give_up(wish);
    scene.drawn("a_restart_keeps_control_and_the_pending_handover");
}

#[test]
fn after_a_restart_the_same_cucs_commands_within_two_seconds() {
    let mut scene = Scene::controlled();
    scene.rig.restart_bridge();
    scene.rig.run(2.0);
    assert_eq!(scene.controller(), Some(A));
    scene.rig.done(orders::launch(10.0));
}

#[test]
fn what_cannot_be_stored_is_not_granted() {
    let mut scene = Scene::new();
    scene.rig.store.full = Some("authority");
    let request = scene.ask(A, RequestedAccess::Request, CONTROL);
    assert_eq!(scene.end(A, request), NO);
    assert_eq!(scene.controller(), None);
    assert!(scene.rig.stations[A].has_alert("refused: it cannot be stored"));
    scene.rig.store.full = None;
    scene.take(A);
    assert_eq!(scene.controller(), Some(A));
}

#[test]
fn a_transition_is_refused_where_provisional_layouts_only_report() {
    let mut scene = Scene::controlled();
    let refused = scene.transition(A, B);
    assert_eq!(scene.end(A, refused), NO);
    assert_eq!((scene.controller(), scene.pending()), (Some(A), 0));
}

#[test]
fn the_vehicles_own_failsafe_is_reported_to_listeners() {
    let mut scene = Scene::controlled();
    let alerted = |rig: &kit::bridge::Rig| rig.stations[A].has_alert("NAV_DLL_ACT");
    assert!(
        scene.rig.until(20.0, alerted),
        "{:?}",
        scene.rig.stations[A].alerts()
    );
    assert!(scene.rig.stations[A].has_alert("COM_DL_LOSS_T 10"));
}

#[test]
fn every_change_of_control_is_a_line_of_the_audit_log() {
    let mut scene = Scene::controlled();
    let taken = scene.ask(B, RequestedAccess::Override, CONTROL);
    assert_eq!(scene.end(B, taken), DONE);
    scene.rig.restart_bridge();
    let release = scene.ask(B, RequestedAccess::Relinquish, 0);
    assert_eq!(scene.end(B, release), DONE);
    let log = scene.rig.store.records["audit-1b000101.log"].clone();
    let verified = vsm::session::Chain::verify(&log, None);
    assert_eq!((verified.broken, verified.torn), (None, false));
    let text = String::from_utf8(log).expect("it is text");
    let reasons: Vec<&str> = ["requested", "overridden", "released"]
        .into_iter()
        .filter(|why| text.contains(&format!("\"why\":\"{why}\"")))
        .collect();
    assert_eq!(reasons, ["requested", "overridden", "released"]);
    assert_eq!(
        text.lines()
            .filter(|line| line.contains("\"what\":\"started\""))
            .count(),
        2
    );

    let forged = text.replacen("overridden", "handed over", 1);
    scene
        .rig
        .store
        .records
        .insert("audit-1b000101.log".to_owned(), forged.into_bytes());
    scene.rig.restart_bridge();
    scene.rig.run(0.1);
    assert!(scene.rig.log.iter().any(|entry| {
        entry
            .text
            .contains("audit log audit-1b000101.log is broken: line 3")
    }));
}

#[test]
fn the_acquirer_withdraws() {
    let mut scene = Scene::controlled();
    let wish = scene.hand_over(B, B, CONTROL);
    scene.rig.run(0.3);
    let no_more = scene.hand_over(B, B, 0);
    assert_eq!((scene.end(B, no_more), scene.end(B, wish)), (DONE, NO));
    let late = scene.hand_over(A, B, 0);
    assert_eq!(
        scene.end(A, late),
        NO,
        "there is nothing to refuse any more"
    );
    assert_eq!((scene.controller(), scene.pending()), (Some(A), 0));
    scene.drawn("the_acquirer_withdraws");
}

#[test]
fn a_named_successor_lets_it_lapse() {
    let mut scene = Scene::controlled();
    let offer = scene.hand_over(A, C, CONTROL);
    scene.rig.run(19.0);
    assert_eq!((scene.controller(), scene.pending()), (Some(A), 1));
    scene.note_event("20 s without an answer");
    assert_eq!(scene.end(A, offer), NO);
    assert_eq!((scene.controller(), scene.pending()), (Some(A), 0));
    scene.drawn("a_named_successor_lets_it_lapse");
}

#[test]
fn a_release_during_a_request_hands_over_at_once() {
    let mut scene = Scene::controlled();
    let wish = scene.hand_over(B, B, CONTROL);
    scene.rig.run(0.3);
    let release = scene.ask(A, RequestedAccess::Relinquish, 0);
    assert_eq!((scene.end(A, release), scene.end(B, wish)), (DONE, DONE));
    assert_eq!(scene.controller(), Some(B));
    scene.drawn("a_release_during_a_request_hands_over_at_once");
}

#[test]
fn what_is_lost_on_the_way_is_reported_again() {
    let mut scene = Scene::controlled();
    scene.rig.dli.faults.loss = 1.0;
    let wish = scene.hand_over(B, B, CONTROL);
    scene.rig.run(0.2);
    scene.rig.dli.faults.loss = 0.0;
    scene.note_event("the first datagram of B is lost");
    scene.rig.run(0.6);
    let consent = scene.hand_over(A, B, CONTROL);
    assert_eq!((scene.end(A, consent), scene.end(B, wish)), (DONE, DONE));
    scene.note_event("B repeats, as if it had not received the end");
    scene.rig.stations[B].repeat(wish);
    scene.rig.run(0.2);
    assert_eq!(scene.controller(), Some(B));
    scene.drawn("what_is_lost_on_the_way_is_reported_again");
}

#[test]
fn a_part_is_granted_and_the_rest_is_named() {
    let mut scene = Scene::controlled();
    let request = scene.ask_stations(C, RequestedAccess::Request, 0x0f, Stations::one(2));
    assert_eq!(scene.end(C, request), NO);
    let granted =
        scene.rig.stations[C].last(kit::bridge::vehicle_id(0), 2, |message| match message {
            Message::VsmAuthorisationResponse(response) => response.loi_granted,
            _ => None,
        });
    assert_eq!(granted.map(|levels| levels.raw()), Some(0x03));
    assert!(scene.rig.stations[C].has_alert("LOI 4, 5 (control, launch) refused"));
    assert_eq!(scene.controller(), Some(A));
    scene.drawn("a_part_is_granted_and_the_rest_is_named");
}

#[test]
fn the_controller_is_given_the_station_that_it_names() {
    let mut scene = Scene::controlled();
    let request = scene.ask_stations(C, RequestedAccess::Request, 0x02, Stations::one(1));
    assert_eq!(scene.end(C, request), DONE);
    let request = scene.ask_stations(A, RequestedAccess::Request, 0x02, Stations::one(1));
    assert_eq!(scene.end(A, request), DONE);
    scene.drawn("the_controller_is_given_the_station_that_it_names");
}

#[test]
fn a_transition_hands_over() {
    let mut scene = Scene::with(Setup {
        tables: TABLES,
        dli_keys: "provisional = \"all\"",
        ..Setup::default()
    });
    scene.take(A);
    let wish = scene.transition(B, B);
    scene.rig.run(0.3);
    let transition = scene.transition(A, B);
    assert_eq!((scene.end(A, transition), scene.end(B, wish)), (DONE, DONE));
    assert_eq!(scene.controller(), Some(B));
    scene.drawn("a_transition_hands_over");
}

/// The page draws what is tested here, and no case that is not.
#[test]
fn every_case_of_the_page_is_a_test_that_draws_it() {
    let page = include_str!("../../../docs/guide/authority.md");
    let tests = include_str!("handover.rs");
    let cases: Vec<&str> = page
        .lines()
        .filter_map(|line| line.strip_prefix("### `")?.strip_suffix('`'))
        .collect();
    assert!(cases.len() > 20, "{cases:?}");
    for case in &cases {
        assert!(
            tests.contains(&format!("scene.drawn(\"{case}\")")),
            "{case} is not drawn"
        );
        let row = format!("](#{case})");
        assert!(page.contains(&row), "{case} is not in the table");
    }
    let drawn = tests.matches("\n    scene.drawn(\"").count();
    assert_eq!(drawn, cases.len());
}

#[test]
fn who_asks_is_sent_how_control_has_passed_last() {
    let mut scene = Scene::new();
    let asked = |scene: &mut Scene, by: usize| {
        let mark = scene.rig.stations[by].received.len();
        let request = GenericInformationRequestMessage {
            message_type: Some(35_000),
            ..GenericInformationRequestMessage::default()
        };
        let ticket = scene.rig.send_as(by, 0, request);
        assert_eq!(scene.end(by, ticket), DONE);
        let id = |by: usize| scene.rig.stations[by].id;
        let mut received = scene.rig.stations[by].received[mark..].iter();
        let report = received.find_map(|(_, _, message)| match message {
            Message::HandoverStatusReport(report) => Some(report.clone()),
            _ => None,
        });
        let report = report.expect("35000");
        let station = |named| [A, B, C].into_iter().find(|by| Some(id(*by)) == named);
        (
            report.status.expect("a status"),
            station(report.cucs_id_relinquishing_control),
            station(report.cucs_id_acquiring_control),
        )
    };
    let listen = scene.ask(C, RequestedAccess::Request, 1);
    assert_eq!(scene.end(C, listen), DONE);
    assert_eq!(
        asked(&mut scene, C),
        (HandoverStatus::NotRequested, None, None)
    );
    scene.take(A);
    assert_eq!(
        asked(&mut scene, A),
        (HandoverStatus::NotRequested, None, None)
    );
    // Released, and taken by another.
    let release = scene.ask(A, RequestedAccess::Relinquish, CONTROL);
    assert_eq!(scene.end(A, release), DONE);
    scene.take(B);
    let passed = (HandoverStatus::Successful, Some(A), Some(B));
    assert_eq!(asked(&mut scene, B), passed);
    assert_eq!(asked(&mut scene, C), passed);
    let wish = scene.hand_over(A, A, CONTROL);
    scene.rig.run(0.3);
    let asks = (HandoverStatus::InProgress, Some(B), Some(A));
    assert_eq!(asked(&mut scene, C), asks);
    let refusal = scene.hand_over(B, A, 0);
    assert_eq!((scene.end(B, refusal), scene.end(A, wish)), (DONE, NO));
    let refused = (HandoverStatus::Failed, Some(B), Some(A));
    assert_eq!(asked(&mut scene, C), refused);
}
