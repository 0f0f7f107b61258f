//! The encrypted link between a bridge and an agent, each a process of its own: paired and flown over UDP and over a serial
//! line, through restarts of each, over a radio that loses 40 %, while somebody records and joins in.

use std::net::UdpSocket;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use kit::network::Faults;
use kit::relay::Relay;
use mavlink_link::dialect::{HEARTBEAT_DATA, MavCmd, MavMessage};
use mavlink_link::frame::{FrameView, Header, KEY_EXCHANGE_ID, MAX_FRAME, STX, encode};
use mavlink_link::service::{Node, command};

use super::airside::Parts;
use super::field::Field;

type Tape = Arc<Mutex<Vec<Vec<u8>>>>;

/// A field whose radio is recorded.
fn recorded(faults: Faults) -> (Field, Relay, Tape) {
    let tape = Tape::default();
    let sniffer = tape.clone();
    let (field, relay) = Field::encrypted(|agent| {
        Relay::observed(agent, faults, 7, move |_, bytes| {
            sniffer.lock().expect("no panic").push(bytes.to_vec());
        })
    });
    (field, relay, tape)
}

impl Field {
    /// Agent, then pairing, then the rest, until PX4 signs and both ends see encrypted packets of the other.
    fn fly_encrypted(&self) -> Parts {
        let agent = Some(self.agent());
        self.pair();
        let parts = Parts {
            agent,
            aircraft: Some(self.aircraft("1")),
            bridge: Some(self.bridge()),
        };
        self.wait_until_signed();
        self.wait_until_encrypted();
        self.launch();
        parts
    }

    fn wait_until_encrypted(&self) -> Duration {
        self.wait("encrypted", Duration::from_secs(10), |field| {
            let ends = [
                &field.vehicle()["link"]["encryption"],
                &field.air()["encryption"],
            ];
            ends.iter().all(|end| end["state"] == "encrypted")
        })
    }

    fn dropped(&self, why: &str) -> u64 {
        let air = self.air();
        air["encryption"]["packets"][why].as_u64().unwrap_or(0)
    }
}

/// The ids of what is MAVLink in the clear, at any offset of any datagram.
fn overheard(tape: &Tape) -> Vec<u32> {
    let mut found = vec![];
    for bytes in tape.lock().expect("no panic").iter() {
        let starts = (0..bytes.len()).filter(|&at| bytes[at] == STX);
        let frames = starts.filter_map(|at| FrameView::parse(&bytes[at..]).ok());
        // What has an id of no message has no checksum to tell it by: of random bytes some look like it.
        let whole = frames.filter(FrameView::is_checked);
        found.extend(whole.map(|frame| frame.header().message_id));
    }
    found
}

fn in_the_clear(message: &MavMessage) -> Vec<u8> {
    let header = Header {
        system_id: 245,
        component_id: 190,
        ..Header::default()
    };
    let mut out = [0; MAX_FRAME];
    let len = encode(message, header, &mut out);
    out[..len].to_vec()
}

#[test]
fn a_flight_over_udp_shows_a_sniffer_nothing_and_takes_nothing_from_it() {
    let (field, _relay, tape) = recorded(Faults::NONE);
    let parts = field.fly_encrypted();
    let disarm = command::long(
        Node::new(1, 1),
        MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
        [0.0, 21_196.0],
    );
    let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
    let stranger = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let agent = ("127.0.0.1", field.radio);
    let recording = tape.lock().expect("no panic").clone();
    for message in [&disarm, &heartbeat] {
        let frame = in_the_clear(message);
        let framed = [&[0x7e, 0][..], &frame, &[0x7e]].concat();
        for bytes in [&frame, &framed] {
            stranger.send_to(bytes, agent).expect("sent");
        }
    }
    // All of the flight once more.
    for bytes in &recording {
        stranger.send_to(bytes, agent).expect("sent");
    }
    field.wait("counted", Duration::from_secs(5), |field| {
        field.dropped("plaintext") > 0
            && field.dropped("length") > 0
            && field.dropped("replayed") > 0
    });
    let vehicle = field.vehicle();
    assert_eq!(vehicle["armed"], true, "{vehicle:#}");
    field.cucs(&["land"]);
    let parts = field.restart_each(parts);
    field.wait_until_encrypted();
    // What was recorded under keys of before brings nothing either.
    let believed = field.air()["to_px4"].as_u64();
    for bytes in &recording {
        stranger.send_to(bytes, agent).expect("sent");
    }
    field.wait("counted", Duration::from_secs(5), |field| {
        field.dropped("forged") > 0
    });
    assert!(field.air()["to_px4"].as_u64() >= believed);
    drop(parts);
    let overheard = overheard(&tape);
    assert!(
        overheard.iter().all(|&id| id == KEY_EXCHANGE_ID),
        "{overheard:?}"
    );
    assert!(!overheard.is_empty(), "the exchange itself is in the clear");
    assert!(tape.lock().expect("no panic").len() > 500);
}

#[test]
fn a_flight_over_a_radio_that_loses_40_percent_is_encrypted_too() {
    let (field, relay, tape) = recorded(Faults {
        loss: 0.4,
        flip: 0.02,
        ..Faults::NONE.delayed_ms(5, 40)
    });
    let _parts = field.fly_encrypted();
    assert!(relay.lost() > 100);
    assert!(overheard(&tape).iter().all(|&id| id == KEY_EXCHANGE_ID));
}

#[test]
fn over_a_serial_line_both_sides_pair_fly_encrypted_and_come_back() {
    let field = Field::encrypted_on_serial_lines();
    let parts = field.fly_encrypted();
    drop(parts.bridge);
    let _bridge = field.bridge();
    field.wait_until_encrypted();
}
