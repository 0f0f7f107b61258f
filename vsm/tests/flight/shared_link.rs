//! Several vehicles on one link, distinguished by their system ids: each keeps its key, its address and its state.

use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;

use kit::bridge::{Rig, Setup, VSM, bridge_mav, key, vehicle_address, vehicle_id};
use mavlink_link::Now;
use mavlink_link::frame::{Header, INCOMPAT_SIGNED, MAX_FRAME, encode_raw};
use mavlink_link::signing::{Stamp, sign};
use mavlink_link::store::MemoryDisk;
use px4_sim::{Autopilot, Signing};
use vsm::config::Config;
use vsm::session::{Bridge, LinkEnd, LogLevel, Peer, Status};

fn heartbeat(system_id: u8, incompat: u8, out: &mut [u8; MAX_FRAME]) -> usize {
    let header = Header {
        system_id,
        component_id: 1,
        incompat,
        ..Header::default()
    };
    encode_raw(header, &[2, 0, 0, 0, 2, 12, 0, 4, 3], out).expect("a frame")
}

fn rig() -> Rig {
    let mut rig = Rig::new(Setup {
        vehicles: vec![px4_sim::Config::default(); 2],
        one_link: true,
        ..Setup::default()
    });
    rig.run(9.0);
    rig
}

fn status(rig: &Rig) -> Status {
    let bridge = rig.bridge.as_ref().expect("it runs");
    bridge.status("vsm".to_owned(), rig.now().mono)
}

#[test]
fn each_vehicle_is_received_under_its_key_and_sent_to_at_its_address() {
    let rig = rig();
    let status = status(&rig);
    for (index, vehicle) in status.vehicles.iter().enumerate() {
        assert_eq!(vehicle.link.state, "live", "{vehicle:?}");
        let address = vehicle_address(index).to_string();
        assert_eq!(vehicle.link.peer.as_deref(), Some(&*address));
        let own = key(index).id().to_string();
        assert_eq!(vehicle.link.key_id.as_deref(), Some(&*own));
        // Nothing of the other one gets as far as its parser.
        for counter in ["unexpected_system", "bad_signature"] {
            assert_eq!(vehicle.link.frames[counter], 0, "{vehicle:?}");
        }
        assert_eq!(
            (vehicle.link.strangers, vehicle.link.other_systems.len()),
            (0, 0)
        );
    }
    for vehicle in &rig.vehicles {
        // Our frames reach the vehicle that they are signed for, and it alone.
        assert_eq!(vehicle.counters(0).dropped_bad_signature, 0);
        assert!(vehicle.counters(0).verified > 5);
    }
}

#[test]
fn a_key_counts_for_its_own_vehicle_only() {
    let mut rig = rig();
    let mut frame = [0; MAX_FRAME];
    let length = heartbeat(1, INCOMPAT_SIGNED, &mut frame);
    let stamp = Stamp::from_unix(rig.now().wall);
    let length = sign(&key(1), 0, stamp, &mut frame, length).expect("signed");
    let now = rig.clock.elapsed();
    rig.mav.send(
        now,
        vehicle_address(1),
        bridge_mav(0),
        frame[..length].to_vec(),
    );
    rig.run(0.1);
    let status = status(&rig);
    let refused = |index: usize| status.vehicles[index].link.frames["bad_signature"];
    assert_eq!((refused(0), refused(1)), (1, 0));
    let address = vehicle_address(0).to_string();
    assert_eq!(status.vehicles[0].link.peer.as_deref(), Some(&*address));
}

#[test]
fn a_system_that_nobody_has_is_counted_and_named_once() {
    let mut rig = rig();
    let mut frame = [0; MAX_FRAME];
    let length = heartbeat(7, 0, &mut frame);
    for _ in 0..3 {
        let (now, from) = (rig.clock.elapsed(), SocketAddr::from(([127, 0, 0, 1], 9)));
        rig.mav
            .send(now, from, bridge_mav(0), frame[..length].to_vec());
        rig.run(1.5);
    }
    for vehicle in status(&rig).vehicles {
        assert_eq!(vehicle.link.strangers, 3);
        assert_eq!(
            vehicle.link.other_systems.into_iter().collect::<Vec<_>>(),
            [(7, 3)]
        );
    }
    let named: Vec<_> = rig
        .log
        .iter()
        .filter(|line| line.text.contains("system 7"))
        .collect();
    assert_eq!(named.len(), 1, "{named:?}");
    let expected = format!(
        "MAVLink system 7 sends on udpin:{}, where the configuration has system 1 and 2: its frames are ignored",
        bridge_mav(0)
    );
    assert_eq!(
        (named[0].level, &named[0].text),
        (LogLevel::Warning, &expected)
    );
    // What it has sent since is named once more five minutes later, with how often, and not at each frame.
    rig.run(300.0);
    let texts = |rig: &Rig| {
        let named = rig.log.iter().filter(|line| line.text.contains("system 7"));
        named.map(|line| line.text.clone()).collect::<Vec<_>>()
    };
    assert_eq!(texts(&rig)[1..], [format!("{expected} (3 so far)")]);
    let (now, from) = (rig.clock.elapsed(), SocketAddr::from(([127, 0, 0, 1], 9)));
    rig.mav
        .send(now, from, bridge_mav(0), frame[..length].to_vec());
    rig.run(2.0);
    assert_eq!(texts(&rig).len(), 2);
}

/// Both on one line: every byte is received by all, in pieces that are no frames.
#[test]
fn two_vehicles_share_a_serial_line() {
    let vehicle = |index: usize| {
        format!(
            "[[vehicle]]\nid = \"{}\"\nlink = \"serial:/dev/ttyUSB0:57600\"\nsystem_id = {}\n\
             signing = {{ key_file = \"uav{index}.key\" }}\n",
            vehicle_id(index),
            index + 1
        )
    };
    let text = format!(
        "[dli]\nvsm_id = \"{VSM}\"\nlisten = \"127.0.0.1:4586\"\n{}{}[store]\ndir = \"state\"\n",
        vehicle(0),
        vehicle(1)
    );
    let config = Config::parse(&text, Path::new("/nowhere")).expect("good");
    let ends = [0, 1].map(|index| LinkEnd {
        key: Some(key(index)),
        peer: Some(Peer::Serial),
    });
    let now = |mono| Now {
        mono,
        wall: Duration::from_secs(1_800_000_000) + mono,
    };
    let (mut disk, not_before) = (MemoryDisk::default(), Duration::from_secs(1_767_225_600));
    let start = now(Duration::ZERO);
    let mut bridge =
        Bridge::new(&config, ends.into(), start, not_before, &mut disk).expect("a bridge");
    let mut vehicles = [0, 1].map(|index| {
        let vehicle = px4_sim::Config {
            system_id: index as u8 + 1,
            seed: index as u64,
            ..px4_sim::Config::default()
        };
        Autopilot::new(vehicle, Signing::with_key(key(index), 0), vec![Some(())])
    });
    let mut line = Vec::new();
    let step = Duration::from_millis(10);
    let mut clock = Duration::ZERO;
    while clock < Duration::from_secs(10) {
        clock += step;
        let mut frame = [0; MAX_FRAME];
        for vehicle in &mut vehicles {
            vehicle.step(step);
            while let Some(sent) = vehicle.poll_transmit(&mut frame) {
                line.extend_from_slice(&frame[..sent.len]);
            }
        }
        let whole = line.len() / 37 * 37;
        for piece in line.drain(..whole).collect::<Vec<_>>().chunks(37) {
            bridge.handle_vehicle(
                now(clock),
                0,
                Peer::Serial,
                piece,
                &mut disk,
                &mut |_, _| {},
            );
        }
        bridge.handle_timeout(now(clock), &mut disk);
        while let Some((_, frame)) = bridge.poll_vehicle() {
            for vehicle in &mut vehicles {
                vehicle.handle_datagram(0, (), frame.bytes());
            }
        }
        while bridge.poll_log().is_some() || bridge.poll_dli().is_some() {}
    }
    for vehicle in bridge.status(String::new(), clock).vehicles {
        assert!(vehicle.live && vehicle.link.state == "live", "{vehicle:?}");
        // On a line each vehicle's frames pass by the other's parser; they are no strangers there.
        assert_eq!(vehicle.link.strangers, 0);
        assert!(vehicle.link.frames["unexpected_system"] > 50);
        assert_eq!(vehicle.link.frames["bad_crc"], 0);
    }
}
