//! The machine without the others: parameters and their followers, schedules, the silence of the vehicle.

use mavlink_link::dialect::MavMessage;
use mavlink_link::service::param::{Name, Value};
use stanag_msgs::enums::AckType;
use stanag_msgs::messages::{ParameterRequest, ParameterSetCommand};

use super::*;
use crate::session::authority::rules::Authority;
use crate::session::payload::Payload;
use crate::session::testing::{World, acknowledgements, origin};

const NAME: &str = "MPC_XY_CRUISE";

fn handle(world: &mut World, reports: &mut Reports, input: Input<'_>) -> Result<(), String> {
    let (idle, nobody) = (Payload::default(), Authority::default());
    world.act(|common, views, effects| {
        let context = Context {
            common,
            mission: views.mission,
            flight: views.flight,
            payload: idle.view(&nobody),
            link: mapping::data_link::DataLink::default(),
        };
        reports.handle(&context, input, effects)
    })
}

fn observe(world: &mut World, reports: &mut Reports, input: Input<'_>) {
    handle(world, reports, input).expect("an input that is answered by the machine");
}

fn command(world: &mut World, reports: &mut Reports, station: usize, message: impl Into<Message>) {
    let message = message.into();
    let input = Input::Command {
        origin: Origin {
            station,
            ..origin(&message)
        },
        message: &message,
    };
    observe(world, reports, input);
}

/// Ids of what a station was sent.
fn sent(world: &mut World, station: usize) -> Vec<u16> {
    world.sent_to(station).iter().map(Message::id).collect()
}

fn name() -> Name {
    Name::new(NAME).expect("a name")
}

fn read(value: f32) -> Input<'static> {
    Input::ParameterServiceEnded(Event::Read {
        name: name(),
        value: Value::Real(value),
    })
}

fn reported(value: f32) -> Input<'static> {
    Input::ParameterReported(name(), Value::Real(value))
}

/// Station 0 has read a parameter, which is 5.
fn followed() -> (World, Reports) {
    let (mut world, mut reports) = (World::new(), Reports::default());
    let request = ParameterRequest {
        parameter_name: Some(stanag_msgs::Text::new(NAME)),
        ..ParameterRequest::default()
    };
    command(&mut world, &mut reports, 0, request);
    assert_eq!(acknowledgements(&world.sent_to(0)), [AckType::Received]);
    observe(&mut world, &mut reports, read(5.0));
    assert_eq!(sent(&mut world, 0), [50012, 17000]);
    (world, reports)
}

#[test]
fn who_has_read_a_parameter_is_sent_its_changes_and_all_are_warned_of_a_foreign_one() {
    for (station, expected) in [(0, &[50012, 16000][..]), (1, &[16000])] {
        let (mut world, mut reports) = followed();
        world.advance(Duration::from_secs(1));
        observe(&mut world, &mut reports, reported(6.0));
        assert_eq!(sent(&mut world, station), expected);
        world.advance(Duration::from_secs(1));
        observe(&mut world, &mut reports, reported(6.0));
        assert!(sent(&mut world, station).is_empty(), "it is as it was");
    }
}

#[test]
fn a_parameter_that_flutters_does_not_fill_the_log() {
    let (mut world, mut reports) = followed();
    let changes = |world: &World| {
        let texts = world.log.iter().map(|entry| entry.text.as_str());
        let of_it = texts.filter(|text| text.starts_with("the vehicle's parameter "));
        of_it.map(str::to_owned).collect::<Vec<_>>()
    };
    for number in 0..5_000_u16 {
        world.advance(Duration::from_millis(1));
        observe(&mut world, &mut reports, reported(f32::from(number)));
    }
    let logged = changes(&world);
    assert!((100..=106).contains(&logged.len()), "{}", logged.len());
    world.advance(Duration::from_secs(2));
    observe(&mut world, &mut reports, reported(0.5));
    let last = changes(&world).pop().expect("it is logged");
    assert!(
        last.starts_with("the vehicle's parameter MPC_XY_CRUISE is now 0.5 (")
            && last.ends_with(" changes before it are not logged)"),
        "{last}"
    );
}

#[test]
fn a_follower_is_sent_what_another_station_sets_and_that_one_its_own_answer() {
    for (station, expected) in [(0, &[50012][..]), (1, &[17000, 50012, 17000])] {
        let (mut world, mut reports) = followed();
        world.advance(Duration::from_secs(1));
        world.controller = Some(world.stations[1].id());
        let set = ParameterSetCommand {
            parameter_name: Some(stanag_msgs::Text::new(NAME)),
            commanded_value: Some(7.0),
            ..ParameterSetCommand::default()
        };
        command(&mut world, &mut reports, 1, set);
        let ended = Event::Set {
            name: name(),
            value: Value::Real(7.0),
        };
        world.advance(Duration::from_secs(1));
        observe(
            &mut world,
            &mut reports,
            Input::ParameterServiceEnded(ended),
        );
        assert_eq!(sent(&mut world, station), expected);
    }
}

#[test]
fn a_schedule_of_what_is_no_report_or_of_too_many_a_second_is_refused() {
    let (mut world, mut reports) = (World::new(), Reports::default());
    for (message, hertz, accepted) in [
        (4000, MAX_HERTZ, true),
        (4000, 0, true),
        (4000, MAX_HERTZ + 1, false),
        (13000, 1, false),
        (32301, 1, false),
    ] {
        let command = ScheduleMessageUpdateCommand {
            requested_message_type: Some(message),
            frequency: Some(hertz),
            ..ScheduleMessageUpdateCommand::default()
        };
        let input = Input::Schedule {
            station: 0,
            command: &command,
        };
        let answer = handle(&mut world, &mut reports, input);
        assert_eq!(answer.is_ok(), accepted, "{message} at {hertz} Hz");
        // Which streams there are would be a report, if its layout were known.
        let named = answer.is_err_and(|why| why.contains("Uniform Resource Identifier"));
        assert_eq!(named, message == 32301);
    }
}

#[test]
fn a_station_that_begins_to_listen_is_sent_reports_until_it_ceases() {
    let (mut world, mut reports) = (World::airborne(Px4Mode::LOITER), Reports::default());
    world.listeners = vec![1];
    observe(
        &mut world,
        &mut reports,
        Input::ListenerChanged { station: 1 },
    );
    let due = reports.poll_timeout(&world.alerts);
    assert_eq!(due, Some(world.now.mono));
    observe(&mut world, &mut reports, Input::PushDue);
    let messages = sent(&mut world, 1);
    assert!(
        messages.contains(&3001) && messages.contains(&3002),
        "{messages:?}"
    );
    world.listeners.clear();
    observe(
        &mut world,
        &mut reports,
        Input::ListenerChanged { station: 1 },
    );
    world.advance(Duration::from_secs(10));
    observe(&mut world, &mut reports, Input::PushDue);
    assert!(sent(&mut world, 1).is_empty());
    assert_eq!(reports.poll_timeout(&world.alerts), None);
}

#[test]
fn many_reports_that_are_due_together_are_sent_in_parts_each_once() {
    let (mut world, mut reports) = (World::airborne(Px4Mode::LOITER), Reports::default());
    world.listeners = vec![0, 1];
    let now = world.now.mono;
    let each = Period::Every(Duration::from_secs(1));
    for station in [0, 1] {
        reports.push.begin(now, station);
        for message in DETAILS {
            reports.push.schedule(station, *message, each);
        }
    }
    let mut messages = [Vec::new(), Vec::new()];
    let mut calls = 0;
    while calls == 0
        || reports
            .poll_timeout(&world.alerts)
            .is_some_and(|at| at <= now)
    {
        observe(&mut world, &mut reports, Input::PushDue);
        let sent = world.sent();
        for (of, station) in messages.iter_mut().zip([0, 1]) {
            let own = world.stations[station].id();
            of.extend(
                sent.iter()
                    .filter(|(to, _)| *to == own)
                    .map(|(_, one)| one.id()),
            );
        }
        calls += 1;
        assert!(calls < 9, "it ends");
    }
    assert!(calls > 1, "{calls}");
    for messages in messages {
        for message in [3001, 3002, 4000, 16002] {
            let times = messages.iter().filter(|one| **one == message).count();
            assert_eq!(times, 1, "{message}: {messages:?}");
        }
    }
}

#[test]
fn the_silence_of_the_vehicle_stands_as_an_alert_until_it_is_received_again() {
    let (mut world, mut reports) = (World::airborne(Px4Mode::LOITER), Reports::default());
    observe(&mut world, &mut reports, Input::LinkDown);
    let standing: Vec<AlertPriority> = world.alerts.standing().map(|one| one.priority).collect();
    assert_eq!(standing, [AlertPriority::Warning]);
    let messages = sent(&mut world, 0);
    assert!(
        messages.contains(&3001) && messages.contains(&3002),
        "on change"
    );
    observe(&mut world, &mut reports, Input::LinkUp);
    assert_eq!(world.alerts.standing().count(), 0);
}

/// A transition of a VTOL may be shorter than the period of 3002.
#[test]
fn a_change_of_ua_state_is_reported_at_once_and_not_with_every_frame() {
    let (mut world, mut reports) = (World::airborne(Px4Mode::LOITER), Reports::default());
    observe(&mut world, &mut reports, Input::StateChanged);
    assert_eq!(sent(&mut world, 0), [3002]);
    for _ in 0..100 {
        observe(&mut world, &mut reports, Input::StateChanged);
    }
    let messages = sent(&mut world, 0);
    assert!(messages.len() < 40, "{}", messages.len());
    // One has nothing of the other's allowance.
    observe(&mut world, &mut reports, Input::ModeChanged);
    assert!(sent(&mut world, 0).starts_with(&[3001, 3002]));
}

/// Names of parameters that nobody has, one after the other.
fn invented(world: &mut World, reports: &mut Reports, count: usize) {
    for number in 0..count {
        let request = ParameterRequest {
            parameter_name: Some(stanag_msgs::Text::new(&format!("NONE_{number}"))),
            ..ParameterRequest::default()
        };
        command(world, reports, 0, request);
    }
}

/// The parameter that the vehicle is asked for, which is then answered.
fn asked(world: &mut World, reports: &mut Reports) -> Option<Name> {
    let message = world.services.parameters.poll_transmit()?;
    let MavMessage::PARAM_REQUEST_READ(request) = message else {
        panic!("{message:?}")
    };
    let name = Name::from_wire(&request.param_id).expect("a name");
    // It does not have it.
    world.advance(Duration::from_secs(60));
    while world.services.parameters.pending() > 0 {
        world.advance(Duration::from_secs(1));
        world.services.parameters.handle_timeout(world.now.mono);
        while world.services.parameters.poll_transmit().is_some() {}
    }
    while let Some(event) = world.services.parameters.poll_event() {
        observe(world, reports, Input::ParameterServiceEnded(event));
    }
    Some(name)
}

#[test]
fn a_station_that_fills_its_places_delays_another_and_the_bridge_itself_by_one_request() {
    let (mut world, mut reports) = (World::new(), Reports::default());
    invented(&mut world, &mut reports, 500);
    let answers = acknowledgements(&world.sent_to(0));
    let received = answers.iter().filter(|one| **one == AckType::Received);
    // One is on its way.
    assert_eq!(received.count(), parameters::MAX_PLACES + 1);
    let refused = answers.iter().filter(|one| **one == AckType::Refused);
    assert_eq!(refused.count(), 499 - parameters::MAX_PLACES);
    let request = ParameterRequest {
        parameter_name: Some(stanag_msgs::Text::new(NAME)),
        ..ParameterRequest::default()
    };
    command(&mut world, &mut reports, 1, request);
    // The vehicle is there: what bounds routes is read, all of it.
    observe(&mut world, &mut reports, Input::LinkUp);
    let mut order = vec![];
    while let Some(name) = asked(&mut world, &mut reports) {
        order.push(name.as_str().to_owned());
    }
    let own = mapping::parameter::NAMES.len();
    assert_eq!(order.len(), own + parameters::MAX_PLACES + 2);
    assert_eq!(order[0], "NONE_0");
    assert!(order[1..=own].iter().all(|name| !name.starts_with("NONE_")));
    assert_eq!(order[own + 1], NAME, "{order:?}");
    assert!(!reports.parameters().reading);
}

#[test]
fn a_name_that_the_vehicle_does_not_have_is_remembered_by_nobody() {
    let (mut world, mut reports) = (World::new(), Reports::default());
    for _ in 0..20 {
        invented(&mut world, &mut reports, parameters::MAX_PLACES);
        while asked(&mut world, &mut reports).is_some() {}
    }
    let name = Name::new("NONE_0").expect("a name");
    assert!(reports.parameters.followers(name).is_empty());
    assert_eq!(reports.parameters.remembered(), 0);
}

#[test]
fn a_write_of_who_has_lost_control_meanwhile_is_refused_and_never_sent() {
    let (mut world, mut reports) = (World::new(), Reports::default());
    invented(&mut world, &mut reports, 1);
    let set = ParameterSetCommand {
        parameter_name: Some(stanag_msgs::Text::new(NAME)),
        commanded_value: Some(7.0),
        ..ParameterSetCommand::default()
    };
    command(&mut world, &mut reports, 0, set);
    world.sent_to(0);
    world.controller = Some(world.stations[1].id());
    assert!(asked(&mut world, &mut reports).is_some());
    assert!(world.services.parameters.poll_transmit().is_none());
    let answers = acknowledgements(&world.sent_to(0));
    assert_eq!(answers, [AckType::Refused; 2]);
}

#[test]
fn a_flood_of_lists_is_refused_with_its_rate_and_another_station_has_its_own() {
    let (mut world, mut reports) = (World::new(), Reports::default());
    for _ in 0..9 {
        command(&mut world, &mut reports, 0, ParameterRequest::default());
    }
    let answers = acknowledgements(&world.sent_to(0));
    let received = answers.iter().filter(|one| **one == AckType::Received);
    assert_eq!(received.count(), 4, "{answers:?}");
    command(&mut world, &mut reports, 1, ParameterRequest::default());
    assert_eq!(acknowledgements(&world.sent_to(1)), [AckType::Received]);
}

/// The numbers of a text, its ranges written out: `3, 3000 to 3002`.
fn numbers(text: &str) -> Vec<u16> {
    let words = text.split(|c: char| !c.is_ascii_alphanumeric());
    let mut numbers: Vec<u16> = Vec::new();
    let mut to = false;
    for word in words.filter(|word| !word.is_empty()) {
        match word.parse::<u16>() {
            Ok(end) if to => {
                let first = numbers.last().map_or(end, |last| last + 1);
                numbers.extend(first..=end);
            }
            Ok(number) => numbers.push(number),
            Err(_) => {}
        }
        to = word == "to";
    }
    numbers
}

/// The rows of 17001 and 17002, and those of what they request, name what is answered.
#[test]
fn the_support_table_names_each_report_that_can_be_requested() {
    use mapping::support::{self, Received};
    let text = |message: u16, name: &str| {
        let info = table::message(message).expect("of the table");
        let field = info.field(name).expect("of the table");
        match support::field(info, field).received {
            Received::Honoured(text) => text,
            other => panic!("{message} {name}: {other:?}"),
        }
    };
    let scheduled = numbers(text(17_001, "Requested Message Type"));
    // Without the number of 17001, whose reports it names too.
    let mut once = numbers(text(17_002, "Message Type"));
    once.retain(|number| *number != 17_001);
    for info in table::MESSAGES {
        let id = info.id;
        let known = known_report(id).is_ok();
        assert_eq!(scheduled.contains(&id), known, "{id}");
        let sends = support::message(id).map_or("", |row| row.sends);
        assert_eq!(sends.contains("17001"), known, "{id}: {sends}");
        let answered = known || once.contains(&id);
        assert_eq!(sends.contains("17002"), answered, "{id}: {sends}");
    }
}
