//! Parameters, both ends.

use std::time::Duration;

use mavlink_link::service::param::{self, Name, Value};
use px4_sim::services::param::{Parameter, Server};

use super::{PX4, US};
use crate::services::network::{BAD, End, FAIR, Network, RADIO, WILD, clear};

fn name(name: &str) -> Name {
    Name::new(name).unwrap()
}

fn parameters(count: u16) -> Vec<Parameter> {
    (0..count)
        .map(|number| Parameter {
            name: name(&format!("P_{number:04}")),
            value: if number % 2 == 0 {
                Value::Int(i32::from(number) - 50)
            } else {
                Value::Real(f32::from(number) / 3.0)
            },
            used: true,
            read_only: false,
        })
        .collect()
}

fn run_params(
    client: &mut param::Client,
    server: &mut Server,
    network: &mut Network,
    mut now: Duration,
) -> param::Event {
    let start = now;
    loop {
        while let Some(message) = client.poll_transmit() {
            network.send_intact(now, End::Ground, End::Vehicle, message);
        }
        while let Some(message) = server.poll_transmit() {
            network.send_intact(now, End::Vehicle, End::Ground, message);
        }
        while let Some(event) = client.poll_event() {
            if !matches!(event, param::Event::Progress { .. }) {
                return event;
            }
        }
        let due = [
            client.poll_timeout(),
            server.poll_timeout(),
            network.next_arrival(),
        ];
        now = now.max(due.into_iter().flatten().min().unwrap());
        assert!(now - start < Duration::from_secs(300));
        while let Some(packet) = network.receive(now) {
            let message = &packet.payload;
            match packet.to {
                End::Vehicle => server.handle_message(now, US, message),
                End::Ground => client.handle_message(now, PX4, message, true),
            };
        }
        client.handle_timeout(now);
        server.handle_timeout(now);
    }
}

#[test]
fn a_parameter_list_is_complete_however_bad_the_network() {
    for (faults, seeds) in [(FAIR, 1), (RADIO, 4), (BAD, 8), (WILD, 8)] {
        for seed in 0..seeds {
            let mut network = Network::new(seed, faults);
            let mut server = Server::new(PX4, parameters(300));
            let mut client = param::Client::new(US, PX4, param::Timing::default());
            let now = Duration::from_secs(5);
            client.list(now).unwrap();
            let param::Event::List { entries, .. } =
                run_params(&mut client, &mut server, &mut network, now)
            else {
                panic!("{faults:?} {seed}");
            };
            let expected = parameters(300);
            assert_eq!(entries.len(), expected.len());
            for (got, expected) in entries.iter().zip(&expected) {
                assert_eq!((got.name, got.value), (expected.name, expected.value));
            }
        }
    }
}

#[test]
fn reading_and_setting_answer_as_px4_does() {
    let mut network = Network::new(11, BAD);
    let mut server = Server::new(PX4, parameters(10));
    let mut client = param::Client::new(US, PX4, param::Timing::default());
    let mut now = Duration::from_secs(5);
    let mut ask = |start: &dyn Fn(&mut param::Client, Duration)| {
        start(&mut client, now);
        let event = run_params(&mut client, &mut server, &mut network, now);
        now += Duration::from_secs(60);
        clear(&mut network);
        event
    };
    let unknown = name("NO_SUCH");
    let (int, real) = (name("P_0002"), name("P_0003"));
    let refused = |name, error| param::Event::Refused {
        name,
        reason: param::Refusal::Error(error),
    };

    let event = ask(&|c, now| c.read(now, int).unwrap());
    assert_eq!(
        event,
        param::Event::Read {
            name: int,
            value: Value::Int(-48)
        }
    );
    let event = ask(&|c, now| c.read(now, unknown).unwrap());
    let missing = param::MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST;
    assert_eq!(event, refused(unknown, missing));
    let event = ask(&|c, now| c.set(now, int, Value::Real(1.0)).unwrap());
    let mismatch = param::MavParamError::MAV_PARAM_ERROR_TYPE_MISMATCH;
    assert_eq!(event, refused(int, mismatch));
    // Outside any sensible range, and accepted: PX4 checks no range.
    let event = ask(&|c, now| c.set(now, real, Value::Real(5e9)).unwrap());
    assert_eq!(
        event,
        param::Event::Set {
            name: real,
            value: Value::Real(5e9)
        }
    );
    assert_eq!(server.value(real), Some(Value::Real(5e9)));
}
