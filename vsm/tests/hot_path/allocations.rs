//! Nothing is allocated for a message that passes through the bridge: signed telemetry in and reports out, sticks in
//! and signed MANUAL_CONTROL out. What is written to disk is apart: the signing clock's ceiling, now and then, whose
//! name and text are made for it.

use std::time::Duration;

use kit::bridge::{Rig, cucs, orders, vehicle_id};
use kit::heap::allocations;
use mavlink_link::frame::{FrameView, MAX_FRAME};
use mavlink_link::store::{Disk, Durability, MemoryDisk, StoreError};
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode};
use stanag_msgs::messages::UaStickCommand;
use stanag_msgs::{Envelope, MAX_DATAGRAM, Message, TimeStamp};
use vsm::session::Peer;
use zeroize::Zeroizing;

/// What passed through, and how much memory was asked for meanwhile.
#[derive(Debug, Default)]
struct Passed {
    frames_in: u64,
    datagrams_in: u64,
    frames_out: u64,
    sticks_out: u64,
    datagrams_out: u64,
    allocations: u64,
    written: u64,
}

impl Passed {
    /// Nothing was asked for but the texts of each record that was written.
    fn assert_nothing_allocated(&self) {
        assert!(self.written <= 2, "{self:?}");
        assert!(self.allocations <= TEXTS * self.written, "{self:?}");
    }
}

/// A store whose own use of memory does not count.
struct Apart<'a> {
    disk: &'a mut MemoryDisk,
    allocations: u64,
    written: u64,
}

impl Disk for Apart<'_> {
    fn read(&self, name: &str, max_bytes: u64) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError> {
        self.disk.read(name, max_bytes)
    }

    fn replace(&mut self, name: &str, bytes: &[u8], kept: Durability) -> Result<(), StoreError> {
        let (count, done) = allocations(|| self.disk.replace(name, bytes, kept));
        self.allocations += count;
        self.written += 1;
        done
    }

    fn append(&mut self, name: &str, bytes: &[u8], kept: Durability) -> Result<(), StoreError> {
        let (count, done) = allocations(|| self.disk.append(name, bytes, kept));
        self.allocations += count;
        self.written += 1;
        done
    }

    fn rename(&mut self, from: &str, to: &str) -> Result<(), StoreError> {
        self.disk.rename(from, to)
    }

    fn remove(&mut self, name: &str) -> Result<(), StoreError> {
        self.disk.remove(name)
    }
}

/// Lets the vehicle and the station talk to the bridge without the rig's wires, which would allocate themselves.
fn pass(rig: &mut Rig, seconds: f64, sticks: bool) -> Passed {
    let mut passed = Passed::default();
    let end = rig.clock.elapsed() + Duration::from_secs_f64(seconds);
    let mut frame = [0; MAX_FRAME];
    let from = kit::bridge::station_address(0);
    while rig.clock.elapsed() < end {
        rig.clock.advance(Duration::from_millis(10));
        let now = rig.now();
        rig.vehicles[0].step(Duration::from_millis(10));
        let tick = rig.clock.elapsed().as_millis() / 10;
        let datagram = (sticks && tick.is_multiple_of(2)).then(|| centred(now.wall));
        let bridge = rig.bridge.as_mut().expect("it runs");
        let mut store = Apart {
            disk: &mut rig.store,
            allocations: 0,
            written: 0,
        };
        while let Some(sent) = rig.vehicles[0].poll_transmit(&mut frame) {
            let peer = Peer::Udp(kit::bridge::vehicle_address(0));
            let (count, ()) = allocations(|| {
                let bytes = &frame[..sent.len];
                bridge.handle_vehicle(now, 0, peer, bytes, &mut store, &mut |_, _| {});
            });
            passed.frames_in += 1;
            passed.allocations += count;
        }
        let (count, datagrams) = allocations(|| {
            if let Some((bytes, length)) = &datagram {
                bridge.handle_dli(now, from, &bytes[..*length], &mut store);
            }
            if bridge.poll_timeout(now.mono) <= now.mono {
                bridge.handle_timeout(now, &mut store);
            }
            let mut datagrams = 0;
            while bridge.poll_dli().is_some() {
                datagrams += 1;
            }
            datagrams
        });
        loop {
            let (count, frame) = allocations(|| bridge.poll_vehicle());
            passed.allocations += count;
            let Some((_, frame)) = frame else { break };
            let view = FrameView::parse(frame.bytes()).expect("a frame");
            passed.frames_out += 1;
            passed.sticks_out += u64::from(view.header().message_id == MANUAL_CONTROL);
            // The vehicle must continue to receive them.
            rig.vehicles[0].handle_datagram(0, kit::bridge::bridge_mav(0), frame.bytes());
        }
        passed.datagrams_in += u64::from(datagram.is_some());
        passed.datagrams_out += datagrams;
        passed.allocations += count;
        passed.allocations -= store.allocations;
        passed.written += store.written;
    }
    passed
}

/// A 2010 with every stick in the middle.
fn centred(wall: Duration) -> ([u8; MAX_DATAGRAM], usize) {
    let message = Message::UaStickCommand(UaStickCommand {
        time_stamp: Some(TimeStamp::from_unix_ms(wall.as_millis() as u64)),
        lateral_stick: Some(0),
        longitudinal_stick: Some(0),
        rotational_stick_rudder: Some(0),
        throttle_stick_engine_1: Some(50),
        ..UaStickCommand::default()
    });
    let mut bytes = [0; MAX_DATAGRAM];
    let length = message
        .encode(&Envelope::new(cucs(0), vehicle_id(0)), &mut bytes)
        .expect("it fits");
    (bytes, length)
}

#[test]
fn telemetry_and_sticks_pass_without_an_allocation() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    rig.run(5.0);
    // Tables and queues have grown to what they need.
    pass(&mut rig, 20.0, false);
    let passed = pass(&mut rig, 10.0, false);
    assert!(passed.frames_in > 200, "{passed:?}");
    assert!(passed.datagrams_out > 100, "{passed:?}");
    passed.assert_nothing_allocated();

    let stick = |rig: &mut Rig| {
        let wall = rig.now().wall;
        let (bytes, length) = centred(wall);
        let from = kit::bridge::station_address(0);
        let now = rig.now();
        let bridge = rig.bridge.as_mut().expect("it runs");
        bridge.handle_dli(now, from, &bytes[..length], &mut rig.store);
    };
    // The mode is entered while sticks come.
    let ticket = rig.send(orders::mode(Mode::FlightDirector));
    for _ in 0..100 {
        stick(&mut rig);
        rig.run(0.1);
    }
    assert_eq!(rig.station().end(ticket), Some(AckType::CarriedOut));
    // The memory of duplicates is full after 1024 messages; from then on it is used again.
    pass(&mut rig, 25.0, true);
    let passed = pass(&mut rig, 10.0, true);
    assert!(passed.datagrams_in > 400, "{passed:?}");
    assert!(passed.sticks_out > 200, "{passed:?}");
    passed.assert_nothing_allocated();

    // And the counter counts.
    assert_eq!(allocations(|| std::hint::black_box(Box::new(1))).0, 1);
}

const MANUAL_CONTROL: u32 = 69;
/// Name and text of a record that is read and written, each growing once, and what was read.
const TEXTS: u64 = 7;
