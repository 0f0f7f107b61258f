//! Commands, message intervals and texts, against a vehicle written line by line.

use std::time::Duration;

use mavlink::dialects::development::{
    COMMAND_ACK_DATA, MISSION_ACK_DATA, MISSION_CURRENT_DATA, MavCmd, MavMessage, MavMissionResult,
    MavMissionType, MavResult, MavSeverity, STATUSTEXT_DATA,
};
use mavlink_link::service::Node;
use mavlink_link::service::command::{
    Client, Command, Event, Outcome, Payload, Repetition, SubmitError, Timing,
};
use mavlink_link::service::interval::{Intervals, Rate, RequestState};
use mavlink_link::service::mission;
use mavlink_link::service::text::Texts;

const US: Node = Node::new(255, 190);
const PX4: Node = Node::new(1, 1);
const ARM: MavCmd = MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;
const MODE: MavCmd = MavCmd::MAV_CMD_DO_SET_MODE;

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

fn command(command: MavCmd, repetition: Repetition) -> Command {
    Command {
        command,
        payload: Payload::Long([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        repetition,
    }
}

fn ack_to(to: Node, command: MavCmd, result: MavResult) -> MavMessage {
    MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
        command,
        result,
        progress: 40,
        result_param2: 7,
        target_system: to.system,
        target_component: to.component,
    })
}

fn ack(command: MavCmd, result: MavResult) -> MavMessage {
    ack_to(US, command, result)
}

fn client() -> Client {
    Client::new(US, PX4, Timing::default())
}

/// The confirmation fields of the COMMAND_LONGs that are due.
fn sent(client: &mut Client) -> Vec<u8> {
    std::iter::from_fn(|| client.poll_transmit())
        .map(|message| match message {
            MavMessage::COMMAND_LONG(m) => m.confirmation,
            message => panic!("{message:?}"),
        })
        .collect()
}

fn outcome(client: &mut Client) -> Option<Outcome> {
    match client.poll_event()? {
        Event::Done { outcome, from, .. } => {
            assert_eq!(from, PX4);
            Some(outcome)
        }
        event @ Event::InProgress { .. } => panic!("{event:?}"),
    }
}

const ACCEPTED: MavResult = MavResult::MAV_RESULT_ACCEPTED;
const OK: Outcome = Outcome::Answered {
    result: ACCEPTED,
    result_param2: 7,
};

#[test]
fn a_safe_command_is_repeated_with_a_rising_confirmation_and_then_given_up() {
    let mut client = client();
    client
        .submit(ms(0), command(ARM, Repetition::Safe))
        .unwrap();
    assert_eq!(sent(&mut client), [0]);
    for confirmation in 1..6 {
        let due = client.poll_timeout().unwrap();
        assert_eq!(due, ms(500 * u64::from(confirmation)));
        client.handle_timeout(due - ms(1));
        assert!(sent(&mut client).is_empty());
        client.handle_timeout(due);
        assert_eq!(sent(&mut client), [confirmation]);
    }
    // The last one may be on its way for long.
    client.handle_timeout(ms(5499));
    assert_eq!(outcome(&mut client), None);
    client.handle_timeout(ms(5500));
    assert_eq!(outcome(&mut client), Some(Outcome::NoAnswer { tries: 6 }));
    assert_eq!(client.pending(), 0);
}

#[test]
fn a_command_that_is_not_safe_to_repeat_goes_out_once() {
    let mut client = client();
    client
        .submit(ms(0), command(ARM, Repetition::Never))
        .unwrap();
    assert_eq!(sent(&mut client), [0]);
    for at in (0..=2000).step_by(100) {
        client.handle_timeout(ms(at));
    }
    assert!(sent(&mut client).is_empty());
    assert_eq!(outcome(&mut client), Some(Outcome::NoAnswer { tries: 1 }));
}

#[test]
fn an_answer_that_waits_while_nothing_runs_is_taken_afterwards() {
    let mut client = client();
    client
        .submit(ms(0), command(ARM, Repetition::Never))
        .unwrap();
    assert_eq!(sent(&mut client), [0]);
    client.postpone(ms(60_000));
    client.handle_timeout(ms(60_001));
    assert_eq!(outcome(&mut client), None);
    assert!(client.handle_message(ms(60_002), PX4, &ack(ARM, ACCEPTED), true));
    assert_eq!(outcome(&mut client), Some(OK));
}

#[test]
fn only_the_vehicles_fresh_answer_to_us_for_this_command_counts() {
    let mut client = client();
    client
        .submit(ms(0), command(ARM, Repetition::Safe))
        .unwrap();
    let right = ack(ARM, ACCEPTED);
    assert!(!client.handle_message(ms(1), PX4, &ack(MODE, ACCEPTED), true));
    assert!(!client.handle_message(ms(1), Node::new(1, 100), &right, true));
    assert!(!client.handle_message(ms(1), Node::new(2, 1), &right, true));
    let others = [Node::new(254, 190), Node::new(255, 191), Node::new(0, 0)];
    for other in others {
        assert!(!client.handle_message(ms(1), PX4, &ack_to(other, ARM, ACCEPTED), true));
    }
    assert!(!client.handle_message(ms(1), PX4, &right, false));
    assert_eq!(outcome(&mut client), None);
    assert!(client.handle_message(ms(2), PX4, &right, true));
    assert_eq!(outcome(&mut client), Some(OK));
    assert!(!client.handle_message(ms(3), PX4, &right, true));
}

#[test]
fn one_command_is_outstanding_and_the_queue_is_bounded() {
    let mut client = client();
    let mut taken = 0;
    let full = loop {
        match client.submit(ms(0), command(MODE, Repetition::Safe)) {
            Ok(_) => taken += 1,
            Err(error) => break error,
        }
    };
    assert_eq!((taken, full), (16, SubmitError::Full(16)));
    for _ in 0..16 {
        assert_eq!(sent(&mut client).len(), 1);
        assert!(client.handle_message(ms(5), PX4, &ack(MODE, ACCEPTED), true));
        assert_eq!(outcome(&mut client), Some(OK));
    }
    assert!(sent(&mut client).is_empty());
}

#[test]
fn the_late_answer_to_a_repeat_is_not_taken_for_the_next_command_of_that_number() {
    let mut client = client();
    client
        .submit(ms(0), command(ARM, Repetition::Safe))
        .unwrap();
    client
        .submit(ms(0), command(ARM, Repetition::Safe))
        .unwrap();
    client.handle_timeout(ms(500));
    assert_eq!(sent(&mut client), [0, 1]);
    client.handle_message(ms(510), PX4, &ack(ARM, ACCEPTED), true);
    assert_eq!(outcome(&mut client), Some(OK));
    // One more answer may come: the second command waits for it, or for the time it may take.
    assert!(sent(&mut client).is_empty());
    let denied = MavResult::MAV_RESULT_DENIED;
    assert!(!client.handle_message(ms(520), PX4, &ack(ARM, denied), true));
    assert_eq!(outcome(&mut client), None);
    assert_eq!(sent(&mut client), [0]);
}

#[test]
fn a_lost_second_answer_holds_the_next_command_for_one_wait_only() {
    let mut client = client();
    client
        .submit(ms(0), command(ARM, Repetition::Safe))
        .unwrap();
    client
        .submit(ms(0), command(ARM, Repetition::Safe))
        .unwrap();
    client.handle_timeout(ms(500));
    assert_eq!(sent(&mut client), [0, 1]);
    client.handle_message(ms(510), PX4, &ack(ARM, ACCEPTED), true);
    assert_eq!(client.poll_timeout(), Some(ms(1010)));
    client.handle_timeout(ms(1010));
    assert_eq!(sent(&mut client), [0]);
}

#[test]
fn what_had_no_room_to_leave_does_not_leave_after_its_end() {
    let mut client = client();
    let ticket = client
        .submit(ms(0), command(ARM, Repetition::Safe))
        .unwrap();
    client.withdraw(ms(10), ticket);
    assert_eq!(outcome(&mut client), Some(Outcome::Withdrawn));
    assert!(sent(&mut client).is_empty());
}

#[test]
fn progress_extends_the_wait_but_not_for_ever() {
    let mut client = client();
    let ticket = client
        .submit(ms(0), command(ARM, Repetition::Safe))
        .unwrap();
    let progress = ack(ARM, MavResult::MAV_RESULT_IN_PROGRESS);
    let mut now = ms(100);
    assert!(client.handle_message(now, PX4, &progress, true));
    assert_eq!(
        client.poll_event(),
        Some(Event::InProgress {
            ticket,
            percent: Some(40)
        })
    );
    let mut rounds = 0;
    while client.pending() > 0 {
        client.handle_message(now, PX4, &progress, true);
        now = client.poll_timeout().unwrap() - ms(1);
        client.handle_timeout(now);
        rounds += 1;
        assert!(rounds < 200 && sent(&mut client).len() <= 1);
        now += ms(1);
        if now >= ms(120_100) {
            client.handle_timeout(now);
        }
    }
    let outcome = std::iter::from_fn(|| client.poll_event()).last();
    assert!(matches!(
        outcome,
        Some(Event::Done {
            outcome: Outcome::NoAnswer { tries: 1 },
            ..
        })
    ));
    assert_eq!(now, ms(120_100));
}

#[test]
fn a_withdrawn_command_says_so_and_lets_the_next_go() {
    let mut client = client();
    let first = client
        .submit(ms(0), command(ARM, Repetition::Safe))
        .unwrap();
    client
        .submit(ms(0), command(MODE, Repetition::Safe))
        .unwrap();
    sent(&mut client);
    client.withdraw(ms(10), first);
    assert_eq!(outcome(&mut client), Some(Outcome::Withdrawn));
    assert_eq!(sent(&mut client), [0]);
}

// ---- intervals ----

fn drive(
    intervals: &mut Intervals,
    commands: &mut Client,
    now: Duration,
    answer: impl Fn(f32) -> Option<MavResult>,
) -> Vec<(f32, f32)> {
    let mut asked = Vec::new();
    loop {
        intervals.advance(now, commands);
        let Some(message) = commands.poll_transmit() else {
            return asked;
        };
        let MavMessage::COMMAND_LONG(m) = message else {
            panic!("{message:?}");
        };
        asked.push((m.param1, m.param2));
        if let Some(result) = answer(m.param1) {
            let command = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL;
            commands.handle_message(now, PX4, &ack(command, result), true);
        }
        while let Some(event) = commands.poll_event() {
            assert!(intervals.handle_event(now, &event));
        }
    }
}

#[test]
fn intervals_are_asked_for_one_by_one_and_refusals_are_remembered() {
    let mut commands = client();
    let mut intervals =
        Intervals::new([(33, Rate::Hz(4.0)), (9999, Rate::Hz(1.0)), (30, Rate::Off)]);
    let failed = MavResult::MAV_RESULT_FAILED;
    let answer = |id: f32| Some(if id == 9999.0 { failed } else { ACCEPTED });
    let asked = drive(&mut intervals, &mut commands, ms(0), answer);
    assert_eq!(asked, [(33.0, 250_000.0), (9999.0, 1e6), (30.0, -1.0)]);
    assert!(intervals.is_settled());
    let refused = intervals.states().nth(1).unwrap().2;
    assert_eq!(refused, RequestState::Refused(failed));

    intervals.request_again();
    assert!(!intervals.is_settled());
    let asked = drive(&mut intervals, &mut commands, ms(1), answer);
    assert_eq!(asked, [(33.0, 250_000.0), (30.0, -1.0)]);
    intervals.request_all_again();
    let asked = drive(&mut intervals, &mut commands, ms(2), answer);
    assert_eq!(asked.len(), 3);
}

#[test]
fn an_interval_without_answer_is_asked_for_again_after_a_pause() {
    let mut commands = client();
    let mut intervals = Intervals::new([(33, Rate::Hz(4.0))]);
    let mut now = ms(0);
    assert_eq!(drive(&mut intervals, &mut commands, now, |_| None).len(), 1);
    while let Some(due) = commands.poll_timeout() {
        now = due;
        commands.handle_timeout(now);
        drive(&mut intervals, &mut commands, now, |_| None);
        if let Some(event) = commands.poll_event() {
            assert!(intervals.handle_event(now, &event));
            break;
        }
    }
    assert_eq!(intervals.poll_timeout(), Some(now + ms(3000)));
    let asked = drive(&mut intervals, &mut commands, now + ms(2999), |_| None);
    assert!(asked.is_empty());
    let asked = drive(&mut intervals, &mut commands, now + ms(3500), |_| {
        Some(ACCEPTED)
    });
    assert_eq!(asked.len(), 1);
    assert!(intervals.is_settled());
}

// ---- texts ----

fn text(id: u16, chunk_seq: u8, text: &str) -> MavMessage {
    MavMessage::STATUSTEXT(STATUSTEXT_DATA {
        severity: MavSeverity::MAV_SEVERITY_CRITICAL,
        text: text.into(),
        id,
        chunk_seq,
    })
}

fn texts(texts: &mut Texts) -> Vec<(String, bool)> {
    std::iter::from_fn(|| texts.poll_event())
        .map(|text| (text.text, text.complete))
        .collect()
}

fn whole(text: &str, complete: bool) -> (String, bool) {
    (text.to_owned(), complete)
}

/// As recorded from PX4.
const FIRST: &str = "Arming denied: Resolve system health failures firs";

#[test]
fn chunks_make_one_text_in_any_order() {
    let mut t = Texts::new(1);
    t.handle_message(ms(0), PX4, &text(1, 1, "t\t"));
    assert!(texts(&mut t).is_empty());
    t.handle_message(ms(1), PX4, &text(1, 0, FIRST));
    assert_eq!(texts(&mut t), [whole(&format!("{FIRST}t"), true)]);
    assert_eq!(t.poll_timeout(), None);
    // A late copy of a chunk is no new text.
    t.handle_message(ms(2), PX4, &text(1, 1, "t\t"));
    assert_eq!(t.poll_timeout(), None);
}

#[test]
fn a_missing_chunk_is_marked_after_a_second() {
    let mut t = Texts::new(1);
    t.handle_message(ms(0), PX4, &text(5, 0, FIRST));
    t.handle_message(ms(0), PX4, &text(6, 1, "tail"));
    t.handle_timeout(ms(999));
    assert!(texts(&mut t).is_empty());
    assert_eq!(t.poll_timeout(), Some(ms(1000)));
    t.handle_timeout(ms(1000));
    assert_eq!(
        texts(&mut t),
        [whole(&format!("{FIRST}…"), false), whole("…tail", false)]
    );
}

#[test]
fn a_text_is_one_line_whatever_is_in_it() {
    let mut t = Texts::new(1);
    let forged = "low\r\n12:00 ERROR\u{202e}\u{2028}x\u{7}\u{2066}y";
    t.handle_message(ms(0), PX4, &text(0, 0, forged));
    assert_eq!(texts(&mut t), [whole("low  12:00 ERROR  x  y", true)]);
    t.handle_message(ms(0), PX4, &text(0, 0, "\u{202e}\n\u{7}"));
    assert!(texts(&mut t).is_empty());
    // A tab at the end still marks the twin of an event.
    t.handle_message(ms(0), PX4, &text(0, 0, "Takeoff\tdetected\t"));
    let twin = t.poll_event().expect("a text");
    assert!(twin.is_event_twin);
    assert_eq!(twin.text, "Takeoff detected");
}

#[test]
fn a_twin_is_dropped_and_a_repeat_is_not() {
    let mut t = Texts::new(1);
    t.handle_message(ms(0), PX4, &text(0, 0, "Takeoff detected\t"));
    t.handle_message(ms(10), PX4, &text(0, 0, "Takeoff detected"));
    t.handle_message(ms(20), PX4, &text(0, 0, "Takeoff detected\t"));
    assert_eq!(texts(&mut t).len(), 2);
    t.handle_message(ms(1500), PX4, &text(0, 0, "Takeoff detected"));
    assert_eq!(texts(&mut t), [whole("Takeoff detected", true)]);
    assert!(!t.handle_message(ms(1500), Node::new(2, 1), &text(0, 0, "foreign")));
    assert!(texts(&mut t).is_empty());
}

// ---- what is not fresh ----

#[test]
fn a_mission_is_not_confirmed_by_what_may_be_a_replay() {
    let kind = MavMissionType::MAV_MISSION_TYPE_MISSION;
    let mut client = mission::Client::new(US, PX4, mission::Timing::default());
    client.clear(ms(0), kind).unwrap();
    let accepted = MavMessage::MISSION_ACK(MISSION_ACK_DATA {
        target_system: US.system,
        target_component: US.component,
        mavtype: MavMissionResult::MAV_MISSION_ACCEPTED,
        mission_type: kind,
        opaque_id: 0,
    });
    assert!(!client.handle_message(ms(1), PX4, &accepted, false));
    assert_eq!(client.poll_event(), None);
    assert!(client.handle_message(ms(2), PX4, &accepted, true));
    assert_eq!(client.poll_event(), Some(mission::Event::Cleared { kind }));
}

#[test]
fn the_current_item_is_set_when_the_vehicle_says_so() {
    let mut client = mission::Client::new(US, PX4, mission::Timing::default());
    client.set_current(ms(0), 4..=4).unwrap();
    let current = |seq| {
        MavMessage::MISSION_CURRENT(MISSION_CURRENT_DATA {
            seq,
            ..MISSION_CURRENT_DATA::default()
        })
    };
    client.handle_message(ms(10), PX4, &current(2), true);
    assert_eq!(client.poll_event(), None);
    client.handle_timeout(ms(700));
    let asked = std::iter::from_fn(|| client.poll_transmit()).count();
    assert_eq!(asked, 2);
    client.handle_message(ms(1000), PX4, &current(4), true);
    assert_eq!(
        client.poll_event(),
        Some(mission::Event::CurrentSet { seq: 4 })
    );
    assert_eq!(client.busy(), None);
}

/// PX4 is through with DO_CHANGE_SPEED at once, and names the waypoint behind it.
#[test]
#[allow(deprecated, reason = "PX4 takes this and refuses its successor")]
fn an_item_is_set_where_the_vehicle_is_through_with_it() {
    let mut client = mission::Client::new(US, PX4, mission::Timing::default());
    let current = |seq| {
        MavMessage::MISSION_CURRENT(MISSION_CURRENT_DATA {
            seq,
            ..MISSION_CURRENT_DATA::default()
        })
    };
    client.set_current(ms(0), 4..=6).unwrap();
    let asked: Vec<_> = std::iter::from_fn(|| client.poll_transmit()).collect();
    assert!(
        matches!(&asked[..], [MavMessage::MISSION_SET_CURRENT(set)] if set.seq == 4),
        "{asked:?}"
    );
    for elsewhere in [3, 7] {
        client.handle_message(ms(10), PX4, &current(elsewhere), true);
        assert_eq!(client.poll_event(), None, "{elsewhere}");
    }
    client.handle_message(ms(20), PX4, &current(6), true);
    let set = client.poll_event();
    assert_eq!(set, Some(mission::Event::CurrentSet { seq: 4 }));
}
