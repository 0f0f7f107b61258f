//! The machine without the others: what stations ask for, the disk and the time are played by the test.

use mavlink_link::store::MemoryDisk;
use stanag_msgs::TimeStamp;
use stanag_msgs::enums::{AlertPriority, SubsystemId};
use stanag_msgs::messages::{
    EngineCommand, ParameterRequest, UaRoute, VehicleOperatingModeCommand,
};

use super::rules::CONTROL;
use super::*;
use crate::session::alerts::Cause;
use crate::session::effects::Request;
use crate::session::testing::{CUCS, World, acknowledgements, origin};

/// The station with the index 1.
const SECOND: Id = Id(CUCS.0 + 1);
const LOI4_5: LoiBitmap = CONTROL;
/// What who controls holds: it listens, too.
const GRANTED: LoiBitmap = LOI4_5.union(LoiBitmap::LOI2);

/// Two stations, none of which holds anything.
fn start() -> (World, AuthorityMachine) {
    let mut world = World::new();
    world.controller = None;
    world.listeners.clear();
    (world, AuthorityMachine::default())
}

fn handle(world: &mut World, machine: &mut AuthorityMachine, input: Input<'_>) -> AckType {
    world.act(|common, views, effects| {
        let context = Context {
            common,
            mission: views.mission,
            steering: false,
            other: None,
            contingency_first: false,
            shows_loss_action: false,
            held_for_loss: None,
        };
        machine.handle(&context, input, effects)
    })
}

/// A message 1 of a station.
fn authorise(
    world: &mut World,
    machine: &mut AuthorityMachine,
    station: usize,
    access: RequestedAccess,
    levels: LoiBitmap,
) -> AckType {
    let request = CucsAuthorisationRequest {
        requested_handover_loi: Some(levels),
        requested_handover_access: Some(access),
        ..CucsAuthorisationRequest::default()
    };
    let origin = Origin {
        station,
        ..origin(&request.clone().into())
    };
    let input = Input::Authorise {
        origin: &origin,
        request: &request,
        to_all: false,
    };
    handle(world, machine, input)
}

fn request(
    world: &mut World,
    machine: &mut AuthorityMachine,
    station: usize,
    levels: LoiBitmap,
) -> AckType {
    authorise(world, machine, station, RequestedAccess::Request, levels)
}

/// What the 2s among these messages name as granted.
fn granted(messages: &[Message]) -> Vec<LoiBitmap> {
    let granted = |message: &Message| match message {
        Message::VsmAuthorisationResponse(response) => response.loi_granted,
        _ => None,
    };
    messages.iter().filter_map(granted).collect()
}

fn priorities(world: &World) -> Vec<AlertPriority> {
    let standing = world.alerts.standing();
    standing.map(|alert| alert.priority).collect()
}

#[test]
fn a_grant_is_stored_so_that_a_restart_finds_what_was_answered() {
    let (mut world, mut machine) = start();
    let answer = request(&mut world, &mut machine, 0, LOI4_5);
    assert_eq!(answer, AckType::CarriedOut);
    assert_eq!(granted(&world.sent_to(0)), [GRANTED]);
    assert_eq!(machine.controller(), Some(CUCS));
    assert!(matches!(
        world.requests.pop_front(),
        Some(Request::ControlChanged)
    ));

    let mut restarted = AuthorityMachine::default();
    let restored = world.act(|context, _, effects| restarted.restore(&context, effects));
    let known = restored.expect("the record is read");
    assert_eq!(restarted.rights().record(), machine.rights().record());
    assert_eq!(known.first().map(|station| station.id), Some(CUCS));
    assert_eq!(restarted.since(CUCS), Some(world.now.wall));
}

#[test]
fn a_grant_that_the_disk_refuses_is_taken_back_and_the_audit_log_reports_it() {
    let (mut world, mut machine) = start();
    world.disk = Box::new(MemoryDisk {
        full: Some("authority"),
        ..MemoryDisk::default()
    });
    let levels = GRANTED;
    let answer = request(&mut world, &mut machine, 0, levels);
    assert_eq!(answer, AckType::Refused);
    assert_eq!(granted(&world.sent_to(0)), [LoiBitmap::NONE]);
    assert_eq!(machine.controller(), None);
    assert!(world.listeners.is_empty() && world.requests.is_empty());
    assert_eq!(machine.since(CUCS), None);
    assert_eq!(priorities(&world), [AlertPriority::Warning]);
    let log = world.disk.read("audit-1b000101.log", u64::MAX);
    let log = log.expect("it can be read").expect("it was written");
    let verified = audit::Chain::verify(&log, None);
    assert_eq!(verified.broken, None);
    assert_eq!(
        verified.chain.lines(),
        2,
        "the change, and that it does not hold"
    );

    // Once there is room again the same request is granted, and the alert is cleared.
    world.disk = Box::new(MemoryDisk::default());
    let answer = request(&mut world, &mut machine, 0, levels);
    assert_eq!(answer, AckType::CarriedOut);
    assert_eq!(world.listeners, [0]);
    assert_eq!(priorities(&world), []);
}

#[test]
fn a_release_that_the_disk_refuses_holds_and_is_stored_once_there_is_room() {
    let (mut world, mut machine) = start();
    request(&mut world, &mut machine, 0, LOI4_5);
    let release = RequestedAccess::Relinquish;
    world.fill_disk();
    let answer = authorise(&mut world, &mut machine, 0, release, LOI4_5);
    assert_eq!(answer, AckType::CarriedOut);
    assert_eq!(machine.controller(), None);
    assert_eq!(priorities(&world), [AlertPriority::Warning]);
    // What must be stored to be granted is refused.
    let answer = request(&mut world, &mut machine, 1, LOI4_5);
    assert_eq!(answer, AckType::Refused);

    // Nothing is lost by a disk that is full for longer.
    let limits = world.settings.authority;
    let due = machine.poll_timeout(world.now.mono, &world.stations, &limits);
    assert!(due.is_some());
    world.advance(Duration::from_secs(2));
    handle(&mut world, &mut machine, Input::WatchSilence);
    assert_eq!(priorities(&world), [AlertPriority::Warning]);
    let happened = world.now.wall - Duration::from_secs(2);

    world.disk = Box::new(MemoryDisk::default());
    world.advance(Duration::from_secs(2));
    handle(&mut world, &mut machine, Input::WatchSilence);
    assert_eq!(priorities(&world), []);
    let due = machine.poll_timeout(world.now.mono, &world.stations, &limits);
    assert_eq!(due, None);
    let mut restarted = AuthorityMachine::default();
    let restored = world.act(|context, _, effects| restarted.restore(&context, effects));
    restored.expect("the record is read");
    assert_eq!(restarted.controller(), None);
    // The line has the time at which it happened.
    let log = world.disk.read("audit-1b000101.log", u64::MAX);
    let log = log.expect("it can be read").expect("it was written");
    let log = String::from_utf8_lossy(&log).into_owned();
    let line = log.lines().find(|line| line.contains("released"));
    let line = line.unwrap_or_else(|| panic!("{log}"));
    let at = format!("\"time_ms\":{},", happened.as_millis());
    assert!(line.contains(&at), "{line}");
}

/// What a restart would give to a station is given to it again, however often, and to nobody else: otherwise a full disk would
/// leave an aircraft to nobody.
#[test]
fn a_full_disk_gives_control_again_to_the_station_that_the_record_still_has() {
    let (mut world, mut machine) = start();
    request(&mut world, &mut machine, 0, LOI4_5);
    let release = RequestedAccess::Relinquish;
    world.fill_disk();
    for _ in 0..3 {
        let answer = authorise(&mut world, &mut machine, 0, release, LOI4_5);
        assert_eq!(answer, AckType::CarriedOut);
        let answer = request(&mut world, &mut machine, 1, LOI4_5);
        assert_eq!(answer, AckType::Refused);
        // Nor more than the record has.
        let more = LOI4_5.union(LoiBitmap::LOI3);
        let answer = request(&mut world, &mut machine, 0, more);
        assert_eq!(answer, AckType::Refused);
        // LOI 2 comes with it.
        let answer = request(&mut world, &mut machine, 0, GRANTED);
        assert_eq!(answer, AckType::CarriedOut);
        assert_eq!(machine.controller(), Some(CUCS));
    }
    assert_eq!(priorities(&world), [AlertPriority::Warning]);

    world.disk = Box::new(MemoryDisk::default());
    world.advance(Duration::from_secs(2));
    handle(&mut world, &mut machine, Input::WatchSilence);
    assert_eq!(priorities(&world), []);
    let log = world.disk.read("audit-1b000101.log", u64::MAX);
    let log = log.expect("it can be read").expect("it was written");
    let log = String::from_utf8_lossy(&log).into_owned();
    let whys: Vec<bool> = log.lines().map(|line| line.contains("released")).collect();
    assert_eq!(whys, [true, false, true, false, true, false], "{log}");
    let mut restarted = AuthorityMachine::default();
    let restored = world.act(|context, _, effects| restarted.restore(&context, effects));
    restored.expect("the record is read");
    assert_eq!(restarted.controller(), Some(CUCS));
}

#[test]
fn a_station_that_could_not_be_stored_is_stored_once_there_is_room_and_the_alert_ends() {
    let (mut world, mut machine) = start();
    request(&mut world, &mut machine, 0, LOI4_5);
    world.stations[0].sends_heartbeats = true;
    world.stations[0].received = Some(world.now.mono);
    let whole = std::mem::replace(&mut world.disk, Box::new(MemoryDisk::default()));
    world.fill_disk();
    handle(&mut world, &mut machine, Input::WatchSilence);
    assert_eq!(priorities(&world), [AlertPriority::Warning]);

    world.disk = whole;
    world.advance(Duration::from_secs(2));
    world.stations[0].received = Some(world.now.mono);
    handle(&mut world, &mut machine, Input::WatchSilence);
    assert_eq!(priorities(&world), []);
    let mut restarted = AuthorityMachine::default();
    let restored = world.act(|context, _, effects| restarted.restore(&context, effects));
    let known = restored.expect("the record is read");
    assert!(
        known
            .iter()
            .any(|one| one.id == CUCS && one.sends_heartbeats)
    );
}

#[test]
fn a_release_is_granted_whatever_else_it_names() {
    let (mut world, mut machine) = start();
    request(&mut world, &mut machine, 0, LOI4_5);
    world.requests.clear();
    let release = RequestedAccess::Relinquish;
    let strange = LoiBitmap::from_raw(0xff);
    let answer = authorise(&mut world, &mut machine, 0, release, strange);
    assert_eq!(answer, AckType::CarriedOut);
    assert_eq!(machine.controller(), None);
    assert!(matches!(
        world.requests.pop_front(),
        Some(Request::ControlChanged)
    ));
    // As a request the same levels are refused, whole.
    let answer = request(&mut world, &mut machine, 0, strange);
    assert_eq!(answer, AckType::Refused);
    assert!(machine.rights().held(CUCS).is_empty());
}

#[test]
fn a_new_listener_is_sent_the_vehicle_and_the_alerts_that_stand() {
    let (mut world, mut machine) = start();
    let (warning, comms) = (AlertPriority::Warning, SubsystemId::Comms);
    let raised = world
        .alerts
        .raise(Cause::Fence, warning, comms, "the fence".to_owned());
    assert!(raised.is_some());
    for expected in [1, 0] {
        request(&mut world, &mut machine, 1, LoiBitmap::LOI2);
        let messages = world.sent_to(1);
        let count = |id| messages.iter().filter(|message| message.id() == id).count();
        assert_eq!([count(3), count(16000)], [expected; 2], "once");
        assert_eq!(world.requests.drain(..).count(), expected);
        assert_eq!(world.listeners, [1]);
    }
    // Whoever raised it has logged it: not once more for each station that begins to listen.
    assert!(world.log.is_empty(), "{:?}", world.log);
    let release = RequestedAccess::Relinquish;
    authorise(&mut world, &mut machine, 1, release, LoiBitmap::LOI2);
    assert!(world.listeners.is_empty());
    assert!(matches!(
        world.requests.pop_front(),
        Some(Request::ListenerChanged { station: 1 })
    ));
}

/// Station 0 controls, sends heartbeats, and was received just now.
fn heartbeats() -> (World, AuthorityMachine) {
    let (mut world, mut machine) = start();
    world.stations[0].sends_heartbeats = true;
    world.stations[0].received = Some(world.now.mono);
    request(&mut world, &mut machine, 0, LOI4_5);
    world.requests.clear();
    (world, machine)
}

#[test]
fn the_silence_of_the_controller_is_warned_of_offered_and_acted_on_at_its_times() {
    let (mut world, mut machine) = heartbeats();
    let limits = world.settings.authority;
    let received = world.now.mono;
    let mut standing = Vec::new();
    for (limit_s, priority) in [
        (limits.warn_s, AlertPriority::Caution),
        (limits.offer_s, AlertPriority::Warning),
        (limits.act_s, AlertPriority::Emergency),
    ] {
        let at = received + Duration::from_secs_f64(limit_s);
        let due = machine.poll_timeout(world.now.mono, &world.stations, &limits);
        assert_eq!(due, Some(at + WATCH_SLACK));
        world.now.mono = at - Duration::from_millis(1);
        handle(&mut world, &mut machine, Input::WatchSilence);
        assert_eq!(priorities(&world), standing, "not before {limit_s} s");
        assert_eq!(machine.controller(), Some(CUCS));
        world.now.mono = at;
        handle(&mut world, &mut machine, Input::WatchSilence);
        standing = vec![priority];
        assert_eq!(priorities(&world), standing);
    }
    assert_eq!(machine.controller(), None);
    let requests: Vec<Request> = world.requests.drain(..).collect();
    let passed = |request: &Request| matches!(request, Request::ControlChanged);
    let lost = |request: &Request| matches!(request, Request::ControllerLost);
    let (passed, lost) = (
        requests.iter().position(passed),
        requests.iter().position(lost),
    );
    // A steered vehicle is held when control passes to nobody: that must not supersede the action for the loss.
    assert!(passed.is_some() && lost > passed, "{requests:?}");
    let due = machine.poll_timeout(world.now.mono, &world.stations, &limits);
    assert_eq!(due, None);
}

#[test]
fn a_controller_that_is_received_again_clears_the_alert_and_keeps_control() {
    let (mut world, mut machine) = heartbeats();
    world.advance(Duration::from_secs_f64(world.settings.authority.offer_s));
    handle(&mut world, &mut machine, Input::WatchSilence);
    assert_eq!(priorities(&world), [AlertPriority::Warning]);
    world.stations[0].received = Some(world.now.mono);
    handle(&mut world, &mut machine, Input::WatchSilence);
    assert_eq!(priorities(&world), []);
    assert_eq!(machine.controller(), Some(CUCS));
    assert!(world.requests.is_empty());
}

#[test]
fn a_station_that_never_sent_heartbeats_loses_nothing_by_silence() {
    let (mut world, mut machine) = heartbeats();
    world.stations[0].sends_heartbeats = false;
    world.advance(Duration::from_secs(3_600));
    handle(&mut world, &mut machine, Input::WatchSilence);
    assert_eq!(machine.controller(), Some(CUCS));
    assert_eq!(priorities(&world), []);
}

#[test]
fn a_handover_passes_the_wish_on_and_answers_both_once_the_holder_consents() {
    let (mut world, mut machine) = start();
    request(&mut world, &mut machine, 0, LOI4_5);
    let mut hand_over = |world: &mut World, station: usize, acquirer: Option<Id>| {
        let request = PositiveHandoverAuthorisationRequest {
            requested_handover_loi: Some(LOI4_5),
            requesting_cucs_id: acquirer,
            ..PositiveHandoverAuthorisationRequest::default()
        };
        let origin = Origin {
            station,
            ..origin(&request.clone().into())
        };
        let input = Input::HandOver {
            origin: &origin,
            request: &request,
        };
        let answer = handle(world, &mut machine, input);
        (answer, machine.controller())
    };
    world.sent_to(0);
    world.requests.clear();
    let wished = hand_over(&mut world, 1, None);
    assert_eq!(wished, (AckType::Received, Some(CUCS)));
    let wishes = |message: &Message| match message {
        Message::PositiveHandoverAuthorisationRequest(wish) => wish.requesting_cucs_id,
        _ => None,
    };
    let wishes: Vec<Id> = world.sent_to(0).iter().filter_map(wishes).collect();
    assert_eq!(wishes, [SECOND]);
    assert!(world.requests.is_empty(), "nothing has passed yet");

    let consented = hand_over(&mut world, 0, Some(SECOND));
    assert_eq!(consented, (AckType::CarriedOut, Some(SECOND)));
    let sent = world.sent_to(1);
    assert_eq!(acknowledgements(&sent), [AckType::CarriedOut]);
    assert_eq!(granted(&sent).last(), Some(&GRANTED));
    assert!(matches!(
        world.requests.pop_front(),
        Some(Request::ControlChanged)
    ));
}

#[test]
fn of_many_requests_that_wait_each_is_answered_in_the_end() {
    let (mut world, mut machine) = start();
    request(&mut world, &mut machine, 0, LOI4_5);
    let wish = PositiveHandoverAuthorisationRequest {
        requested_handover_loi: Some(LOI4_5),
        ..PositiveHandoverAuthorisationRequest::default()
    };
    let mut hand_over = |world: &mut World, station: usize, acquirer: Option<Id>, stamp: u64| {
        let request = PositiveHandoverAuthorisationRequest {
            requesting_cucs_id: acquirer,
            ..wish.clone()
        };
        let origin = Origin {
            station,
            stamp: Some(TimeStamp(stamp)),
            ..origin(&request.clone().into())
        };
        let input = Input::HandOver {
            origin: &origin,
            request: &request,
        };
        handle(world, &mut machine, input)
    };
    // The stamps of what was refused and carried out, and whether a reason was sent.
    let outcomes = |messages: &[Message]| {
        let (mut refused, mut done, mut reasons) = (Vec::new(), Vec::new(), String::new());
        for message in messages {
            match message {
                Message::MessageAcknowledgement(ack) => {
                    let stamp = ack.original_message_time_stamp.expect("a stamp").0;
                    match ack.acknowledgement_type {
                        Some(AckType::Refused) => refused.push(stamp),
                        Some(AckType::CarriedOut) => done.push(stamp),
                        other => panic!("{other:?}"),
                    }
                }
                Message::SubsystemStatusAlert(alert) => {
                    // A long one comes in several parts.
                    reasons += alert.text.as_ref().map_or("", |text| text.as_str());
                }
                _ => {}
            }
        }
        let named = reasons.contains("later requests wait for the same decision");
        (refused, done, named)
    };
    world.sent_to(1);
    for stamp in 1..=18 {
        let answer = hand_over(&mut world, 1, None, stamp);
        assert_eq!(answer, AckType::Received, "{stamp}");
    }
    assert_eq!(outcomes(&world.sent_to(1)), (vec![1, 2], vec![], true));
    let consented = hand_over(&mut world, 0, Some(SECOND), 100);
    assert_eq!(consented, AckType::CarriedOut);
    let (refused, done, _) = outcomes(&world.sent_to(1));
    assert_eq!((refused, done), (vec![], (3..=18).collect()));
}

#[test]
fn a_request_that_is_repeated_without_pause_is_passed_on_at_a_rate() {
    let (mut world, mut machine) = start();
    request(&mut world, &mut machine, 0, LOI4_5);
    let wish = PositiveHandoverAuthorisationRequest {
        requested_handover_loi: Some(LOI4_5),
        ..PositiveHandoverAuthorisationRequest::default()
    };
    let from_second = Origin {
        station: 1,
        ..origin(&wish.clone().into())
    };
    let input = Input::HandOver {
        origin: &from_second,
        request: &wish,
    };
    handle(&mut world, &mut machine, input);
    let passed_on = |world: &mut World| {
        let sent = world.sent_to(0).into_iter();
        let wishes = sent
            .filter(|message| matches!(message, Message::PositiveHandoverAuthorisationRequest(_)));
        wishes.count()
    };
    assert_eq!(passed_on(&mut world), 1);
    // As a CUCS does whose answer was lost.
    for repeat in 1..=4 {
        world.advance(Duration::from_millis(500));
        let again = Input::HandOverAgain { station: 1 };
        handle(&mut world, &mut machine, again);
        assert_eq!(passed_on(&mut world), 1, "repeat {repeat}");
    }
    // A thousand a second: as copies, and as queries.
    for repeat in 0..1_000 {
        world.advance(Duration::from_millis(1));
        let again = Input::HandOverAgain { station: 1 };
        handle(&mut world, &mut machine, again);
        if repeat % 10 == 0 {
            request(&mut world, &mut machine, 1, LoiBitmap::NONE);
        }
    }
    let passed = passed_on(&mut world);
    assert!((1..=3).contains(&passed), "{passed}");
}

/// The texts of all 16000s but the ends of earlier ones.
fn texts(messages: &[Message]) -> usize {
    let alerts = messages.iter().filter(|message| {
        matches!(message, Message::SubsystemStatusAlert(alert)
            if alert.priority != Some(AlertPriority::Cleared))
    });
    alerts.count()
}

#[test]
fn refusals_of_requests_have_a_rate_and_each_is_acknowledged() {
    let (mut world, mut machine) = start();
    let unknown = LoiBitmap::from_raw(0x80);
    for number in 0..200 {
        let answer = request(&mut world, &mut machine, 0, unknown);
        assert_eq!(answer, AckType::Refused, "{number}");
    }
    let sent = world.sent_to(0);
    assert_eq!(granted(&sent).len(), 200, "each has its message 2");
    assert!((1..=6).contains(&texts(&sent)), "{}", texts(&sent));
    assert!(world.log.len() < 10, "{}", world.log.len());
}

#[test]
fn each_message_needs_the_right_of_its_kind() {
    let fly = Message::from(VehicleOperatingModeCommand::default());
    for (mode, right) in [
        (None, LoiBitmap::LOI4),
        (Some(Mode::Loiter), LoiBitmap::LOI4),
        (Some(Mode::Autopilot), LoiBitmap::LOI4),
        (Some(Mode::Launch), LoiBitmap::LOI5),
        (Some(Mode::AutolandEngage), LoiBitmap::LOI5),
        (Some(Mode::AutolandWaveOff), LoiBitmap::LOI5),
    ] {
        assert_eq!(right_for(&fly, mode), Some(right), "{mode:?}");
    }
    for (message, right) in [
        (EngineCommand::default().into(), Some(LoiBitmap::LOI5)),
        (UaRoute::default().into(), Some(LoiBitmap::LOI4)),
        (ParameterRequest::default().into(), Some(LoiBitmap::LOI2)),
        (CucsAuthorisationRequest::default().into(), None),
    ] {
        let message: Message = message;
        assert_eq!(right_for(&message, None), right, "{}", message.id());
    }
}
