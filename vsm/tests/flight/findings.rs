//! What does not work is raised as an alert to who listens, once, and cleared when it is gone; and this computer's clock.

use std::net::SocketAddr;

use kit::bridge::{Rig, Setup, Station, bridge_mav, cucs, orders, vehicle_address, vehicle_id};
use mavlink_link::dialect::{ATTITUDE_DATA, MavMessage};
use mavlink_link::frame::{self, Header, MAX_FRAME};
use stanag_msgs::enums::AlertPriority;
use stanag_msgs::{Envelope, MAX_DATAGRAM, Message, wrapper};
use vsm::session::LogLevel;
use vsm::session::findings::Code;
use vsm::session::findings::host::{KeyFault, StoreFact};

const HEARTBEAT: u32 = 0;
const CURRENT_MODE: u32 = 436;

/// The priorities of the 16000s that begin like this, in their order.
fn alerts(rig: &Rig, words: &str) -> Vec<AlertPriority> {
    let mut found = vec![];
    for (_, _, message) in &rig.station().received {
        if let Message::SubsystemStatusAlert(alert) = message
            && alert
                .text
                .as_ref()
                .is_some_and(|text| text.as_str().starts_with(words))
        {
            found.extend(alert.priority);
        }
    }
    found
}

fn logged(rig: &Rig, level: LogLevel, words: &str) -> usize {
    let log = rig.log.iter();
    log.filter(|entry| entry.level == level && entry.text.contains(words))
        .count()
}

#[test]
fn a_fault_is_raised_once_and_cleared_when_it_is_gone() {
    let mut rig = Rig::ready();
    rig.run(20.0);
    let words = "data no longer arrives on udpin:";
    assert_eq!(alerts(&rig, words), []);
    let vehicles = std::mem::take(&mut rig.vehicles);
    rig.run(60.0);
    assert_eq!(alerts(&rig, words), [AlertPriority::Warning]);
    assert_eq!(logged(&rig, LogLevel::Warning, words), 1);
    // It stands in place of the alert that the vehicle is silent, under its id: one fault is one alert, which ends once.
    let id = ids(&rig, words);
    assert_eq!(
        ids(&rig, "no data from the vehicle: state unknown").last(),
        id.last()
    );
    rig.vehicles = vehicles;
    rig.run(5.0);
    assert_eq!(
        priorities(&rig, id[0]).last(),
        Some(&AlertPriority::Cleared)
    );
}

/// Seen with a second PX4 of the same system id, which has no key. Anybody can send what it sends.
#[test]
fn unsigned_frames_in_the_name_of_a_vehicle_that_is_received_are_a_finding_and_no_alert() {
    let attitude = MavMessage::ATTITUDE(ATTITUDE_DATA::default());
    let header = Header {
        seq: 7,
        system_id: 1,
        component_id: 1,
        message_id: 0,
        incompat: 0,
        compat: 0,
    };
    let mut bytes = [0; MAX_FRAME];
    let length = frame::encode(&attitude, header, &mut bytes);
    let mut rig = Rig::ready();
    rig.run(20.0);
    let before = rig.station().alerts();
    for _ in 0..20 {
        for _ in 0..50 {
            let now = rig.clock.elapsed();
            let unsigned = bytes[..length].to_vec();
            rig.mav
                .send(now, vehicle_address(0), bridge_mav(0), unsigned);
        }
        rig.run(3.0);
    }
    let codes = |rig: &Rig| -> Vec<Code> {
        let bridge = rig.bridge.as_ref().expect("it runs");
        let found = bridge.status(String::new(), rig.now().mono).findings;
        found.iter().map(|finding| finding.code).collect()
    };
    assert_eq!(codes(&rig), [Code::MavlinkUnsignedBeside]);
    assert_eq!(rig.station().alerts(), before);
    let words = "something else sends unsigned frames as system 1";
    assert_eq!(logged(&rig, LogLevel::Warning, words), 1);
    // It does not take the place of the reason why the vehicle's state is unknown.
    rig.lost = vec![HEARTBEAT, CURRENT_MODE];
    rig.run(6.0);
    let silent = [Code::MavlinkUnsignedBeside, Code::MavlinkSilent];
    assert_eq!(codes(&rig), silent);
}

/// Nobody answers a bridge that does not run, nor over a link that is cut both ways.
#[test]
fn time_in_which_nothing_could_be_answered_is_not_held_against_the_vehicle() {
    let mut rig = Rig::ready();
    rig.run(20.0);
    for timers_first in [true, false] {
        rig.suspend_bridge(13.0, timers_first);
        rig.run(5.0);
    }
    let words = "MAVLink system 1 is received, but has received nothing";
    let none: [AlertPriority; 0] = [];
    assert_eq!(alerts(&rig, words), none);
    assert_eq!(alerts(&rig, "data no longer arrives on"), none);
    assert_eq!(alerts(&rig, "no data from the vehicle"), none);
    rig.mav.faults.loss = 1.0;
    rig.run(13.0);
    rig.mav.faults.loss = 0.0;
    rig.run(5.0);
    assert_eq!(alerts(&rig, words), none);
}

/// The ids of the 16000s that begin like this, and the priorities of those of an id, in their order.
fn ids(rig: &Rig, words: &str) -> Vec<i32> {
    let begins = |text: &str| text.starts_with(words);
    let found = shown(rig).filter(|(_, _, text)| begins(text));
    found.map(|(id, ..)| id).collect()
}

fn priorities(rig: &Rig, of: i32) -> Vec<AlertPriority> {
    let found = shown(rig).filter(|(id, ..)| *id == of);
    found.map(|(_, priority, _)| priority).collect()
}

fn shown(rig: &Rig) -> impl Iterator<Item = (i32, AlertPriority, String)> + '_ {
    let received = rig.station().received.iter();
    received.filter_map(|(_, _, message)| match message {
        Message::SubsystemStatusAlert(alert) => {
            let text = alert.text.as_ref()?.as_str().to_owned();
            // The first instance of an id has its negative.
            Some((alert.alert_warning_id?.abs(), alert.priority?, text))
        }
        _ => None,
    })
}

#[test]
fn a_station_that_begins_to_listen_is_sent_what_stands_of_the_vsm_itself() {
    let mut rig = Rig::new(Setup::default());
    rig.clock.set_wall_step(-86_400.0 * 400.0);
    rig.run(9.0);
    let words = "this computer's clock reads";
    assert_eq!(logged(&rig, LogLevel::Warning, words), 1);
    assert_eq!(alerts(&rig, words), []);
    rig.done(orders::request_control());
    rig.run(3.0);
    assert_eq!(alerts(&rig, words), [AlertPriority::Warning]);
    rig.clock.set_wall_step(0.0);
    rig.run(3.0);
    assert_eq!(
        alerts(&rig, "cleared: this computer's clock"),
        [AlertPriority::Cleared]
    );
}

/// A station that starts again is another program at another port, and has not seen what stands.
#[test]
fn a_station_that_comes_back_is_sent_what_stands_of_the_vsm_itself_again() {
    let mut rig = Rig::new(Setup::default());
    rig.stations[0].heartbeats = true;
    rig.clock.set_wall_step(-86_400.0 * 400.0);
    rig.run(9.0);
    rig.done(orders::request_control());
    rig.run(3.0);
    let words = "this computer's clock reads";
    assert_eq!(alerts(&rig, words), [AlertPriority::Warning]);
    let elsewhere = SocketAddr::from(([127, 0, 0, 1], 41_234));
    rig.stations[0] = Station::new(cucs(0), elsewhere);
    rig.stations[0].heartbeats = true;
    rig.run(5.0);
    assert_eq!(alerts(&rig, words), [AlertPriority::Warning]);
    // Once, however long it stands.
    rig.run(10.0);
    assert_eq!(alerts(&rig, words).len(), 1);
}

#[test]
fn a_clock_far_ahead_of_the_signing_clock_is_named() {
    let mut rig = Rig::ready();
    rig.clock.set_wall_step(86_400.0 * 800.0);
    rig.restart_bridge();
    rig.run(10.0);
    let words = "over a year ahead of the signing clock in the store";
    assert_eq!(logged(&rig, LogLevel::Warning, words), 1, "{:?}", rig.log);
    let status = rig
        .bridge
        .as_ref()
        .map(|one| one.status(String::new(), rig.now().mono));
    let found = status.expect("it runs").findings;
    assert!(
        found
            .iter()
            .any(|one| one.cure.contains("vsm key clock --accept")),
        "{found:?}"
    );
}

#[test]
fn no_sender_can_fill_the_log_with_findings() {
    let mut rig = Rig::ready();
    rig.log.clear();
    let from = "127.0.0.9:4000".parse().expect("an address");
    for n in 0..2_000_u32 {
        let mut bytes = [0; MAX_DATAGRAM];
        let envelope = Envelope::new(stanag_msgs::Id(0x2000_0000 + n), vehicle_id(0));
        let beat = Message::from(stanag_msgs::messages::Heartbeat::default());
        let length = beat.encode(&envelope, &mut bytes).expect("it fits");
        rig.deliver_from(from, &bytes[..length]);
        if n % 100 == 0 {
            rig.run(1.0);
        }
    }
    rig.run(2.0);
    assert_eq!(logged(&rig, LogLevel::Warning, "is not listed"), 4);
    assert_eq!(alerts(&rig, "CUCS 20:00").len(), 4);
}

/// Lets a message of station 0 arrive that requests no acknowledgement.
fn deliver_data(rig: &mut Rig, message_type: u16, data: &[u8]) {
    let mut bytes = [0; MAX_DATAGRAM];
    let envelope = Envelope::new(cucs(0), vehicle_id(0));
    let put = |out: &mut [u8]| {
        out[..data.len()].copy_from_slice(data);
        Ok(data.len())
    };
    let length = wrapper::encode(message_type, &envelope, &mut bytes, put).expect("it fits");
    rig.deliver_from_station(&bytes[..length]);
    rig.run(0.05);
}

#[test]
fn a_message_that_cannot_be_decoded_is_named_though_it_requests_no_answer() {
    let mut rig = Rig::ready();
    rig.log.clear();
    let words = "CUCS 1b:00:00:a0 sends message 16002 ";
    let beat = |presence: u8| [presence, 0, 0, 0, 0, 9];
    for _ in 0..2 {
        deliver_data(&mut rig, 16_002, &beat(0xff));
    }
    rig.run(2.0);
    assert_eq!(alerts(&rig, words), [], "it may be damage on the way");
    for _ in 0..50 {
        deliver_data(&mut rig, 16_002, &beat(0xff));
    }
    rig.run(2.0);
    assert_eq!(alerts(&rig, words), [AlertPriority::Warning]);
    let why = "presence vector 0xff has bits beyond 0x1";
    assert_eq!(logged(&rig, LogLevel::Warning, why), 1);
    // What is good of another type mends nothing.
    rig.send_once(orders::request_control());
    rig.run(2.0);
    assert_eq!(alerts(&rig, &format!("cleared: {words}")), []);
    deliver_data(&mut rig, 16_002, &beat(1));
    rig.run(2.0);
    let cleared = alerts(&rig, &format!("cleared: {words}"));
    assert_eq!(cleared, [AlertPriority::Cleared]);

    // What only a VSM sends, and a flood of unknown types.
    for _ in 0..3 {
        deliver_data(&mut rig, 16_000, &[0, 0, 0]);
    }
    for n in 0..40 {
        for _ in 0..3 {
            deliver_data(&mut rig, 60_000 + n, &beat(1));
        }
    }
    rig.run(2.0);
    assert_eq!(logged(&rig, LogLevel::Warning, "VSM to CUCS only"), 1);
    assert_eq!(logged(&rig, LogLevel::Warning, "unknown message type"), 3);
}

#[test]
fn key_files_that_are_gone_are_alerts_of_their_own_after_two_looks() {
    let mut rig = Rig::ready();
    let gone = |id: &str| KeyFault {
        whose: format!("vehicle {id}"),
        why: "there is no key file".to_owned(),
        reload: false,
    };
    let both = vec![gone("1b:00:01:01"), gone("1b:00:01:02")];
    let words = ["vehicle 1b:00:01:01: there", "vehicle 1b:00:01:02: there"];
    let look = |rig: &mut Rig, faults: &[KeyFault]| {
        let bridge = rig.bridge.as_mut().expect("it runs");
        bridge.note_key_files(faults.to_vec());
        rig.run(10.0);
    };
    look(&mut rig, &both);
    // A file may be missing for the moment in which it is replaced.
    for words in words {
        assert_eq!(alerts(&rig, words), []);
    }
    look(&mut rig, &both);
    look(&mut rig, &both);
    for words in words {
        assert_eq!(alerts(&rig, words), [AlertPriority::Warning], "{words}");
    }
    look(&mut rig, &both[..1]);
    let cleared = |rig: &Rig, words: &str| alerts(rig, &format!("cleared: {words}"));
    assert_eq!(cleared(&rig, words[0]), []);
    assert_eq!(cleared(&rig, words[1]), [AlertPriority::Cleared]);
    look(&mut rig, &[]);
    assert_eq!(cleared(&rig, words[0]), [AlertPriority::Cleared]);
}

#[test]
fn a_refused_reload_and_a_full_disk_are_alerts_until_they_are_over() {
    let mut rig = Rig::ready();
    let note = |rig: &mut Rig, reload: Option<&str>, disk: Option<&str>| {
        let bridge = rig.bridge.as_mut().expect("it runs");
        bridge.note_reload(reload);
        let full = disk.map(|why| StoreFact::Full(why.to_owned()));
        bridge.note_store(full.as_ref());
        rig.run(3.0);
    };
    note(&mut rig, Some("vsm.toml: line 7"), Some("its disk is full"));
    let words = ["the last reload was refused", "its disk is full"];
    for words in words {
        assert_eq!(alerts(&rig, words), [AlertPriority::Warning], "{words}");
    }
    note(&mut rig, None, None);
    for words in words {
        let cleared = format!("cleared: {words}");
        assert_eq!(alerts(&rig, &cleared), [AlertPriority::Cleared], "{words}");
    }
}
