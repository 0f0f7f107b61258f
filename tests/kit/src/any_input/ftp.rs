//! Any answers of a vehicle to a ground station that transfers files: no more is delivered than was announced, the
//! queue is bounded, and each operation ends once.

use core::time::Duration;

use mavlink_link::dialect::{FILE_TRANSFER_PROTOCOL_DATA, MavMessage};
use mavlink_link::service::Node;
use mavlink_link::service::ftp::payload::{LENGTH, Payload};
use mavlink_link::service::ftp::{
    Client, Event, FilePath, MAX_HELD, MAX_UNREAD, Operation, Timing,
};

/// The first byte selects the operation. Then each answer: a byte for what of it is adapted to the last request (1
/// number, 2 opcode, 4 offset, 8 an ACK) and how much time passes, the length of what follows, and the payload.
pub fn run(bytes: &[u8]) {
    let (Some((&first, mut rest)), Ok(path)) = (bytes.split_first(), FilePath::new("/a")) else {
        return;
    };
    let mut client = Client::new(US, VEHICLE, Timing::default());
    let mut now = Duration::from_secs(1);
    let operation = match first % 4 {
        0 => Operation::List(path),
        1 => Operation::Write {
            path,
            content: vec![3; usize::from(first) * 9],
        },
        2 => Operation::Remove(path),
        _ => Operation::Read { path, resume: None },
    };
    client.limit((first & 64 != 0).then_some(20_000));
    client.start(now, operation).expect("the first operation");
    let (mut announced, mut delivered, mut ended) = (0_u64, 0_u64, 0);
    let mut last = Payload::request(
        0,
        mavlink_link::service::ftp::payload::Opcode::MAV_FTP_OPCODE_NONE,
    );
    loop {
        while let Some(MavMessage::FILE_TRANSFER_PROTOCOL(sent)) = client.poll_transmit() {
            last = Payload::decode(&sent.payload).expect("our own payload");
        }
        while let Some(event) = client.poll_event() {
            match event {
                Event::Opened { size } => announced = size.into(),
                Event::Data(bytes) => {
                    assert!(bytes.len() <= MAX_UNREAD + MAX_HELD);
                    delivered += bytes.len() as u64;
                }
                Event::Ended(_) => ended += 1,
                Event::Written { .. } => {}
            }
        }
        let [how, length, data @ ..] = rest else {
            break;
        };
        let (data, left) = data.split_at(usize::from(*length).min(data.len()));
        rest = left;
        let mut payload = [0; LENGTH];
        payload[..data.len().min(LENGTH)].copy_from_slice(&data[..data.len().min(LENGTH)]);
        if how & 1 != 0 {
            payload[..2].copy_from_slice(&last.seq.wrapping_add(1).to_le_bytes());
        }
        if how & 2 != 0 {
            payload[5] = last.opcode;
        }
        if how & 4 != 0 {
            payload[8..12].copy_from_slice(&last.offset.to_le_bytes());
        }
        if how & 8 != 0 {
            payload[3] = 128;
        }
        let message = MavMessage::FILE_TRANSFER_PROTOCOL(FILE_TRANSFER_PROTOCOL_DATA {
            target_network: 0,
            target_system: US.system,
            target_component: US.component,
            payload,
        });
        client.handle_message(now, VEHICLE, &message, true);
        now += Duration::from_millis(u64::from(how >> 4) * 200);
        client.handle_timeout(now);
    }
    assert!(delivered <= announced, "{delivered} of {announced} bytes");
    // An unfinished operation ends by itself.
    for _ in 0..10_000 {
        while client.poll_transmit().is_some() {}
        while let Some(event) = client.poll_event() {
            ended += usize::from(matches!(event, Event::Ended(_)));
        }
        let Some(due) = client.poll_timeout() else {
            break;
        };
        now = now.max(due);
        client.handle_timeout(now);
    }
    while let Some(event) = client.poll_event() {
        ended += usize::from(matches!(event, Event::Ended(_)));
    }
    assert_eq!(ended, 1, "an operation ends once");
}

const US: Node = Node::new(255, 190);
const VEHICLE: Node = Node::new(1, 1);
