//! The simulated mission server answers recorded ground stations as the recorded PX4 v1.18 did.
#![allow(
    deprecated,
    reason = "the recordings hold MISSION_REQUEST and MISSION_ITEM"
)]

use std::collections::BTreeMap;
use std::time::Duration;

use kit::captures;
use mavlink::dialects::development::{MISSION_COUNT_DATA, MavMessage};
use mavlink_link::frame::Parser;
use mavlink_link::service::Node;
use mavlink_link::service::mission::{Item, plan_id, verify};
use px4_sim::services::mission::{Limits, Server, ServerEvent};
use px4_sim::services::mission_rules::{Airframe, Px4Rules};

use super::PX4;

/// The ground station that interferes with a transfer in recording 02.
const SECOND: Node = Node::new(254, 190);

/// A mission message of a recording.
struct Recorded {
    from_px4: bool,
    at: Duration,
    from: Node,
    message: MavMessage,
}

#[test]
fn the_uploads_good_and_bad_of_recording_02() {
    let messages = read("02-params-mission-upload");
    let (recorded, ours) = replay(&messages, PX4);
    assert!(recorded.len() > 1500, "{}", recorded.len());
    compare(&recorded, &ours);
}

#[test]
fn the_flight_plan_of_recording_03() {
    let messages = read("03-arm-takeoff-mission-landa");
    let (recorded, ours) = replay(&messages, PX4);
    assert!(recorded.len() > 5, "{}", recorded.len());
    compare(&recorded, &ours);
}

#[test]
fn the_lossy_upload_and_the_uploads_in_flight_of_recording_06() {
    let messages = read("06-reupload-failsafe");
    let (recorded, ours) = replay(&messages, Node::new(6, 1));
    assert!(recorded.len() > 60, "{}", recorded.len());
    compare(&recorded, &ours);
}

#[test]
fn every_acknowledged_plan_has_the_id_that_we_compute() {
    let mut plans = 0;
    for name in [
        "02-params-mission-upload",
        "03-arm-takeoff-mission-landa",
        "06-reupload-failsafe",
        "20-px4-v1.17.0-flight",
    ] {
        let mut items: BTreeMap<u16, Item> = BTreeMap::new();
        for recorded in read(name) {
            match recorded.message {
                MavMessage::MISSION_COUNT(_) if !recorded.from_px4 => items.clear(),
                MavMessage::MISSION_ITEM_INT(m) if !recorded.from_px4 => {
                    items.insert(m.seq, (&m).into());
                }
                // The id of a plan of MISSION_ITEM covers the floats of x and y, which these items do not have.
                MavMessage::MISSION_ITEM(_) => items.clear(),
                MavMessage::MISSION_ACK(m) if m.opaque_id != 0 && !items.is_empty() => {
                    let items: Vec<_> = items.values().copied().collect();
                    assert_eq!(plan_id(&items), m.opaque_id, "{name} at {:?}", recorded.at);
                    plans += 1;
                }
                _ => {}
            }
        }
    }
    assert!(plans > 15, "{plans}");
}

#[test]
fn every_recorded_download_verifies_against_its_upload() {
    let mut downloads = 0;
    let name = "02-params-mission-upload";
    // By the plan's kind and id: what was sent; by kind: the id and what was returned so far.
    let mut sent: BTreeMap<(u32, u32), Vec<Item>> = BTreeMap::new();
    let mut sending: Vec<Item> = Vec::new();
    let mut received: BTreeMap<u32, (u32, usize, Vec<Item>)> = BTreeMap::new();
    for recorded in read(name) {
        match recorded.message {
            MavMessage::MISSION_COUNT(m) if recorded.from_px4 => {
                let kind = m.mission_type as u32;
                received.insert(kind, (m.opaque_id, m.count.into(), Vec::new()));
            }
            MavMessage::MISSION_COUNT(_) => sending.clear(),
            MavMessage::MISSION_ITEM_INT(m) if recorded.from_px4 => {
                let kind = m.mission_type as u32;
                let Some((id, count, items)) = received.get_mut(&kind) else {
                    continue;
                };
                if items.len() == usize::from(m.seq) {
                    items.push((&m).into());
                }
                if items.len() == *count
                    && let Some(sent) = sent.get(&(kind, *id))
                {
                    assert_eq!(verify(m.mission_type, sent, items), Ok(()), "{name}");
                    downloads += 1;
                }
            }
            MavMessage::MISSION_ITEM_INT(m) if sending.len() == usize::from(m.seq) => {
                sending.push((&m).into());
            }
            MavMessage::MISSION_ACK(m) if recorded.from_px4 && m.opaque_id != 0 => {
                sent.insert((m.mission_type as u32, m.opaque_id), sending.clone());
            }
            _ => {}
        }
    }
    assert_eq!(downloads, 3);
}

/// The recorded answers of PX4, and those of the simulated server to the same ground stations at the same times.
fn replay(messages: &[Recorded], px4: Node) -> (Vec<String>, Vec<String>) {
    let rules = Px4Rules {
        airframe: Airframe::RotaryWing,
    };
    let mut server = Server::new(px4, Limits::PX4_SITL, rules);
    let (mut recorded, mut ours) = (Vec::new(), Vec::new());
    let drain = |answers: &mut Vec<String>, server: &mut Server<Px4Rules>| {
        while let Some(message) = server.poll_transmit() {
            note(answers, &message);
        }
        while let Some(event) = server.poll_event() {
            // The vehicle makes the first item current where the plan names none.
            if let ServerEvent::Stored { start: None, .. } = event {
                server.set_current(Some(0));
            }
        }
    };
    for entry in messages {
        while let Some(due) = server.poll_timeout().filter(|due| *due < entry.at) {
            server.handle_timeout(due);
            drain(&mut ours, &mut server);
        }
        if entry.from_px4 {
            if let MavMessage::MISSION_ACK(m) = &entry.message
                && m.target_system == SECOND.system
            {
                // The messages of that station were not recorded; PX4's answer shows when it sent one.
                server.handle_message(entry.at, SECOND, &count_for(px4));
                drain(&mut ours, &mut server);
            }
            note(&mut recorded, &entry.message);
        } else {
            server.handle_message(entry.at, entry.from, &entry.message);
            drain(&mut ours, &mut server);
        }
    }
    (recorded, ours)
}

fn count_for(px4: Node) -> MavMessage {
    MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
        count: 1,
        target_system: px4.system,
        target_component: px4.component,
        ..MISSION_COUNT_DATA::default()
    })
}

/// Adds the vehicle's answer, unless it is only a request repeated by the clock.
fn note(answers: &mut Vec<String>, message: &MavMessage) {
    let line = match message {
        MavMessage::MISSION_REQUEST(_)
        | MavMessage::MISSION_REQUEST_INT(_)
        | MavMessage::MISSION_COUNT(_)
        | MavMessage::MISSION_ACK(_) => format!("{message:?}"),
        // The current item depends on each vehicle's own progress; yaw is converted to radians and back.
        MavMessage::MISSION_ITEM_INT(m) => {
            let mut item = m.clone();
            item.current = 0;
            item.param4 = (item.param4 * 100.0).round() / 100.0;
            format!("{item:?}")
        }
        MavMessage::MISSION_ITEM(m) => {
            let mut item = m.clone();
            item.current = 0;
            format!("{item:?}")
        }
        _ => return,
    };
    if answers.last() != Some(&line) {
        answers.push(line);
    }
}

fn compare(recorded: &[String], ours: &[String]) {
    for (place, (recorded, ours)) in recorded.iter().zip(ours).enumerate() {
        assert_eq!(recorded, ours, "answer {place}");
    }
    assert_eq!(recorded.len(), ours.len());
}

/// The mission messages of a recording that the dialect can carry.
fn read(name: &str) -> Vec<Recorded> {
    let mut messages = Vec::new();
    let mut parsers = [Parser::new(), Parser::new()];
    for datagram in captures::read(name) {
        let (from_px4, at) = (datagram.from_autopilot, datagram.at);
        let mut frames = parsers[usize::from(from_px4)].feed(&datagram.bytes);
        while let Some(frame) = frames.next() {
            let Ok(frame) = frame else { continue };
            let header = frame.header();
            let mission = matches!(header.message_id, 39..=41 | 43..=45 | 47 | 51 | 73);
            if let Ok(message) = frame.message()
                && mission
            {
                messages.push(Recorded {
                    from_px4,
                    at,
                    from: Node::new(header.system_id, header.component_id),
                    message,
                });
            }
        }
    }
    assert!(!messages.is_empty(), "{name}");
    messages
}
