//! No message in any order makes a service panic, send without bound, or wait for ever.
#![allow(
    deprecated,
    reason = "MISSION_REQUEST and MISSION_ITEM are messages like any other"
)]

use std::time::Duration;

use mavlink::dialects::development::{MavCmd, MavMessage, MavMissionType};
use mavlink::{MavlinkVersion, Message};
use mavlink_link::service::mission::Item;
use mavlink_link::service::text::Texts;
use mavlink_link::service::{command, mission, param};
use proptest::prelude::*;
use px4_sim::services::mission::Limits;
use px4_sim::services::mission_rules::{Airframe, Px4Rules};
use px4_sim::services::{mission as mission_server, param as param_server};

use super::{PX4, US};

/// The ids that some service reads.
const IDS: [u32; 19] = [
    20, 21, 22, 23, 39, 40, 41, 42, 43, 44, 45, 47, 51, 73, 75, 76, 77, 253, 345,
];

#[derive(Clone, Debug)]
enum Step {
    Receive {
        id: u32,
        payload: Vec<u8>,
        to_us: bool,
        fresh: bool,
    },
    Wait(u64),
    Start(u8),
    Send,
}

fn step() -> impl Strategy<Value = Step> {
    let byte = prop_oneof![2 => 0u8..4, 1 => any::<u8>()];
    let receive = (
        proptest::sample::select(&IDS[..]),
        proptest::collection::vec(byte, 0..60),
        any::<bool>(),
        proptest::bool::weighted(0.9),
    )
        .prop_map(|(id, payload, to_us, fresh)| Step::Receive {
            id,
            payload,
            to_us,
            fresh,
        });
    prop_oneof![
        8 => receive,
        2 => (0u64..2000).prop_map(Step::Wait),
        1 => (0u8..8).prop_map(Step::Start),
        1 => Just(Step::Send),
    ]
}

/// A message of this id; the target fields, wherever they are, are found by trial.
fn message(id: u32, payload: &[u8], to: mavlink_link::service::Node) -> Option<MavMessage> {
    let mut message = MavMessage::parse(MavlinkVersion::V2, id, payload).ok()?;
    macro_rules! aim {
        ($($name:ident),*) => {
            match &mut message {
                $(MavMessage::$name(m) => {
                    m.target_system = to.system;
                    m.target_component = to.component;
                })*
                _ => {}
            }
        };
    }
    aim!(
        MISSION_ITEM,
        MISSION_ITEM_INT,
        MISSION_REQUEST,
        MISSION_REQUEST_INT,
        MISSION_COUNT,
        MISSION_ACK,
        MISSION_CLEAR_ALL,
        MISSION_REQUEST_LIST,
        MISSION_SET_CURRENT,
        COMMAND_ACK,
        PARAM_ERROR,
        PARAM_SET,
        PARAM_REQUEST_READ,
        PARAM_REQUEST_LIST
    );
    Some(message)
}

struct Everything {
    missions: mission::Client,
    commands: command::Client,
    params: param::Client,
    texts: Texts,
    mission_server: mission_server::Server<Px4Rules>,
    param_server: param_server::Server,
}

impl Everything {
    fn new() -> Self {
        let rules = Px4Rules {
            airframe: Airframe::RotaryWing,
        };
        let parameter = param_server::Parameter {
            name: param::Name::new("A").unwrap(),
            value: param::Value::Int(1),
            used: false,
            read_only: false,
        };
        Self {
            missions: mission::Client::new(US, PX4, mission::Timing::default()),
            commands: command::Client::new(US, PX4, command::Timing::default()),
            params: param::Client::new(US, PX4, param::Timing::default()),
            texts: Texts::new(1),
            mission_server: mission_server::Server::new(PX4, Limits::PX4_SITL, rules),
            param_server: param_server::Server::new(PX4, [parameter]),
        }
    }

    fn take(&mut self, now: Duration, step: Step) {
        match step {
            Step::Receive {
                id,
                payload,
                to_us,
                fresh,
            } => {
                let (from, to) = if to_us { (PX4, US) } else { (US, PX4) };
                let Some(message) = message(id, &payload, to) else {
                    return;
                };
                self.missions.handle_message(now, from, &message, fresh);
                self.commands.handle_message(now, from, &message, fresh);
                self.params.handle_message(now, from, &message, fresh);
                self.texts.handle_message(now, from, &message);
                self.mission_server.handle_message(now, from, &message);
                self.param_server.handle_message(now, from, &message);
            }
            Step::Wait(_) => {}
            Step::Start(what) => self.start(now, what),
            Step::Send => {
                self.drain();
            }
        }
        self.missions.handle_timeout(now);
        self.commands.handle_timeout(now);
        self.params.handle_timeout(now);
        self.texts.handle_timeout(now);
        self.mission_server.handle_timeout(now);
        self.param_server.handle_timeout(now);
    }

    /// Starts an operation; that it cannot, because it is busy, is fine too.
    fn start(&mut self, now: Duration, what: u8) {
        let kind = MavMissionType::MAV_MISSION_TYPE_MISSION;
        let name = param::Name::new("A").unwrap();
        let safe = command::Repetition::Safe;
        let _ = match what {
            0 => self.missions.upload(now, kind, vec![item(); 5]).is_ok(),
            1 => self.missions.download(now, kind).is_ok(),
            2 => self.missions.clear(now, kind).is_ok(),
            3 => self.missions.set_current(now, 1..=1).is_ok(),
            4 => self.params.list(now).is_ok(),
            5 => self.params.read(now, name).is_ok(),
            6 => self.params.set(now, name, param::Value::Int(3)).is_ok(),
            _ => {
                let payload = command::Payload::Long([0.0; 7]);
                let command = MavCmd::MAV_CMD_NAV_WAYPOINT;
                let command = command::Command {
                    command,
                    payload,
                    repetition: safe,
                };
                self.commands.submit(now, command).is_ok()
            }
        };
    }

    /// Removes all messages and events, and returns how many there were.
    fn drain(&mut self) -> usize {
        let mut n = 0;
        while self.missions.poll_transmit().is_some() {
            n += 1
        }
        while self.missions.poll_event().is_some() {
            n += 1
        }
        while self.commands.poll_transmit().is_some() {
            n += 1
        }
        while self.commands.poll_event().is_some() {
            n += 1
        }
        while self.params.poll_transmit().is_some() {
            n += 1
        }
        while self.params.poll_event().is_some() {
            n += 1
        }
        while self.texts.poll_event().is_some() {
            n += 1
        }
        while self.mission_server.poll_transmit().is_some() {
            n += 1
        }
        while self.mission_server.poll_event().is_some() {
            n += 1
        }
        while self.param_server.poll_transmit().is_some() {
            n += 1
        }
        while self.param_server.poll_event().is_some() {
            n += 1
        }
        n
    }
}

fn item() -> Item {
    Item {
        frame: 3,
        command: 16,
        autocontinue: true,
        ..Item::default()
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_messages_in_any_order_are_borne(steps in proptest::collection::vec(step(), 0..300)) {
        let mut all = Everything::new();
        let mut now = Duration::from_secs(1);
        for step in steps {
            if let Step::Wait(ms) = step {
                now += Duration::from_millis(ms);
            }
            all.take(now, step);
        }
        // Eleven queues, none longer than 64.
        prop_assert!(all.drain() <= 11 * 64);

        // Without further input, every client ends.
        for _ in 0..4000 {
            let due = [all.missions.poll_timeout(), all.commands.poll_timeout(),
                all.params.poll_timeout(), all.texts.poll_timeout()];
            let Some(next) = due.into_iter().flatten().min() else { break };
            now = now.max(next);
            all.take(now, Step::Send);
        }
        prop_assert_eq!(all.missions.busy(), None);
        prop_assert_eq!(all.commands.pending(), 0);
        prop_assert_eq!(all.params.pending(), 0);
    }
}
