//! Every history up to a length of three orders about one thing, each delivered as often as somebody likes, at once, late
//! and after restarts of the bridge: none is ever carried out twice, and none that was carried out is answered as
//! refused.
//!
//! Written against datagrams and files alone. Longer histories:
//! `cargo test --release -p vsm --test any_input every_replay -- --ignored`.

use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::store::MemoryDisk;
use stanag_msgs::enums::{AckType, LoiBitmap, RequestedAccess};
use stanag_msgs::messages::{CucsAuthorisationRequest, Heartbeat, UaPositionWaypoint};
use stanag_msgs::wrapper::frames;
use stanag_msgs::{Bam32, Envelope, Id, MAX_DATAGRAM, Message, TimeStamp};
use vsm::config::Config;
use vsm::session::{Bridge, LinkEnd};

/// What may happen next.
#[derive(Debug, Clone, Copy)]
enum Step {
    /// The order of this number arrives.
    Order(usize),
    /// A heartbeat with the station's time of now.
    Beat,
    Pass(Duration),
    Restart,
}

const STEPS: [Step; 7] = [
    Step::Order(0),
    Step::Order(1),
    Step::Order(2),
    Step::Beat,
    Step::Pass(Duration::from_secs(25)),
    Step::Pass(Duration::from_secs(70)),
    Step::Restart,
];

/// When each order was stamped, ms after the start: two within the time in which one overtakes the other, one later.
const STAMPED_MS: [u64; 3] = [1_000, 2_000, 40_000];

struct World<'a> {
    config: &'a Config,
    bridge: Bridge,
    disk: MemoryDisk,
    clock: Duration,
    started: Duration,
    orders: &'a [Vec<u8>],
    carried_out: [u32; 3],
    answers: [Option<AckType>; 3],
}

impl<'a> World<'a> {
    fn new(config: &'a Config, orders: &'a [Vec<u8>]) -> World<'a> {
        let mut disk = MemoryDisk::default();
        let bridge = start(config, Duration::ZERO, &mut disk);
        let mut world = World {
            config,
            bridge,
            disk,
            clock: Duration::from_secs(3),
            started: Duration::ZERO,
            orders,
            carried_out: [0; 3],
            answers: [None; 3],
        };
        let request = CucsAuthorisationRequest {
            time_stamp: Some(stamp(0)),
            requested_handover_loi: Some(LoiBitmap::from_raw(0x0f)),
            requested_handover_access: Some(RequestedAccess::Request),
            ..CucsAuthorisationRequest::default()
        };
        world.receive(&encoded(request.into()));
        world
    }

    fn step(&mut self, step: Step, history: &[Step]) {
        match step {
            Step::Order(number) => {
                let before = self.plan();
                let orders = self.orders;
                self.receive(&orders[number]);
                if self.plan() != before {
                    self.carried_out[number] += 1;
                    assert_eq!(self.carried_out[number], 1, "{history:?}");
                }
            }
            Step::Beat => {
                let beat = Heartbeat {
                    time_stamp: Some(stamp(self.clock.as_millis() as u64)),
                };
                self.receive(&encoded(beat.into()));
            }
            Step::Pass(span) => {
                self.clock += span;
                self.bridge.handle_timeout(self.now(), &mut self.disk);
            }
            Step::Restart => {
                self.disk.kill();
                self.started = self.clock;
                self.bridge = start(self.config, self.clock, &mut self.disk);
            }
        }
        self.drain(history);
    }

    fn now(&self) -> Now {
        // The monotonic clock of a process begins with it.
        Now {
            mono: self.clock - self.started,
            wall: EPOCH + self.clock,
        }
    }

    fn receive(&mut self, bytes: &[u8]) {
        let now = self.now();
        self.bridge
            .handle_dli(now, station(), bytes, &mut self.disk);
    }

    /// What is stored of the plan: each order that is carried out changes it.
    fn plan(&self) -> Vec<Vec<u8>> {
        let files = self.disk.records.iter();
        let files = files.filter(|(name, _)| name.starts_with("plan-"));
        files.map(|(_, bytes)| bytes.clone()).collect()
    }

    fn drain(&mut self, history: &[Step]) {
        while let Some(datagram) = self.bridge.poll_dli() {
            for frame in frames(datagram.bytes()).flatten() {
                let Ok(Message::MessageAcknowledgement(answer)) =
                    Message::decode(frame.header.message_type, frame.data)
                else {
                    continue;
                };
                let about = answer.original_message_time_stamp;
                let number = STAMPED_MS.iter().position(|ms| about == Some(stamp(*ms)));
                let (Some(number), Some(kind)) = (number, answer.acknowledgement_type) else {
                    continue;
                };
                let done = self.carried_out[number] > 0;
                assert_eq!(done, kind == AckType::CarriedOut, "{number}: {history:?}");
                self.answers[number] = Some(kind);
            }
        }
        while self.bridge.poll_vehicle().is_some() || self.bridge.poll_log().is_some() {}
    }
}

/// Every history of `length` steps; how many there were, and in how many an order was carried out.
fn every_history(length: u32) -> [usize; 2] {
    let config = Config::parse(CONFIGURATION, Path::new("/nowhere")).expect("it is good");
    let orders: Vec<Vec<u8>> = STAMPED_MS
        .iter()
        .map(|ms| {
            let waypoint = UaPositionWaypoint {
                time_stamp: Some(stamp(*ms)),
                waypoint_number: Some(101),
                waypoint_to_latitude_or_relative_y: Some(Bam32::from_degrees(
                    47.0 + *ms as f64 / 1e6,
                )),
                waypoint_to_longitude_or_relative_x: Some(Bam32::from_degrees(8.5)),
                ..UaPositionWaypoint::default()
            };
            encoded(waypoint.into())
        })
        .collect();
    let (all, mut moved) = (STEPS.len().pow(length), 0);
    for number in 0..all {
        let mut world = World::new(&config, &orders);
        let mut rest = number;
        let mut history = Vec::new();
        for _ in 0..length {
            let step = STEPS[rest % STEPS.len()];
            rest /= STEPS.len();
            history.push(step);
            world.step(step, &history);
        }
        moved += usize::from(world.carried_out.iter().any(|times| *times > 0));
    }
    [all, moved]
}

#[test]
fn in_no_short_history_is_an_order_carried_out_twice() {
    let [all, moved] = every_history(4);
    assert_eq!(all, 2_401);
    assert!(moved > all / 2, "{moved} of {all}");
}

#[test]
#[ignore = "minutes in a release build"]
fn in_no_longer_history_is_an_order_carried_out_twice() {
    every_history(7);
}

fn start(config: &Config, clock: Duration, disk: &mut MemoryDisk) -> Bridge {
    let end = LinkEnd {
        key: None,
        peer: None,
    };
    let now = Now {
        mono: Duration::ZERO,
        wall: EPOCH + clock,
    };
    Bridge::new(config, vec![end], now, EPOCH, disk).expect("it starts from its own store")
}

fn encoded(message: Message) -> Vec<u8> {
    let envelope = Envelope::new(STATION, VEHICLE).requesting_ack();
    let mut out = [0; MAX_DATAGRAM];
    let length = message.encode(&envelope, &mut out).expect("it fits");
    out[..length].to_vec()
}

/// Of the station's clock.
fn stamp(ms: u64) -> TimeStamp {
    TimeStamp(850_000_000_000 + ms)
}

fn station() -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], 40_000))
}

const STATION: Id = Id(0x1b00_00a0);
const VEHICLE: Id = Id(0x1b00_0101);
/// 2026-01-01.
const EPOCH: Duration = Duration::from_secs(1_767_225_600);
const CONFIGURATION: &str = r#"
[dli]
vsm_id = "1b:00:00:01"
listen = "127.0.0.1:4586"
[[cucs]]
id = "1b:00:00:a0"
loi = [2, 3, 4, 5]
[[vehicle]]
id = "1b:00:01:01"
link = "udpin:127.0.0.1:14550"
system_id = 1
signing = "off"
[store]
dir = "state"
"#;
