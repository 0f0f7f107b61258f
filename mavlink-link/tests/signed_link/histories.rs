//! Random histories under a virtual clock: loss, reordering, replay, restarts, clocks set by years,
//! two links with one key. No frame is ever delivered twice, and an honest vehicle is received again
//! within one round trip of a heartbeat.

use std::collections::HashSet;
use std::time::Duration;

use crate::support::*;
use mavlink_link::Now;
use mavlink_link::clock::{Ceiling, Origin};
use mavlink_link::frame::MAX_FRAME;
use mavlink_link::link::{Endpoint, Link, LinkConfig, LinkState, Security};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::Stamp;
use mavlink_link::store::Store as _;
use proptest::prelude::*;

/// One thing that happens.
#[derive(Debug, Clone)]
enum Step {
    /// Time passes, in milliseconds.
    Wait(u64),
    /// The vehicle sends on one of its links.
    VehicleSends { link: usize },
    /// What flies towards us on a link arrives: which of them, and whether a copy stays in flight.
    Arrives {
        link: usize,
        which: usize,
        copy: bool,
    },
    /// What flies towards us is lost.
    Lost { link: usize, which: usize },
    /// A frame once seen by a recorder is played in, on any link, from anywhere.
    Replay {
        link: usize,
        which: usize,
        stranger: bool,
    },
    /// Our heartbeats go out, and reach the vehicle or not.
    Heartbeats { arrive: bool },
    /// We send a message, and it reaches the vehicle or not.
    WeSend { link: usize, arrive: bool },
    /// The vehicle's stamps run ahead of ours, as ArduPilot's do.
    VehicleAhead { link: usize, minutes: u64 },
    /// The vehicle restarts and its stamps fall back.
    VehicleRestarts,
    /// We are killed and start again.
    WeRestart,
    /// Our wall clock is set, by days.
    WallSet(i64),
    /// The disk fails, or works again.
    Disk { broken: bool },
}

fn step() -> impl Strategy<Value = Step> {
    let link = 0..2usize;
    let which = any::<usize>();
    prop_oneof![
        4 => prop_oneof![0..50u64, 0..5_000u64, 0..120_000u64].prop_map(Step::Wait),
        8 => link.clone().prop_map(|link| Step::VehicleSends { link }),
        8 => (link.clone(), which, any::<bool>())
            .prop_map(|(link, which, copy)| Step::Arrives { link, which, copy }),
        2 => (link.clone(), which).prop_map(|(link, which)| Step::Lost { link, which }),
        6 => (link.clone(), which, any::<bool>())
            .prop_map(|(link, which, stranger)| Step::Replay { link, which, stranger }),
        5 => any::<bool>().prop_map(|arrive| Step::Heartbeats { arrive }),
        3 => (link, any::<bool>()).prop_map(|(link, arrive)| Step::WeSend { link, arrive }),
        1 => (0..2usize, 0..50u64).prop_map(|(link, minutes)| Step::VehicleAhead { link, minutes }),
        1 => Just(Step::VehicleRestarts),
        1 => Just(Step::WeRestart),
        1 => prop_oneof![-3_653..3_653i64, -2..2i64].prop_map(Step::WallSet),
        1 => any::<bool>().prop_map(|broken| Step::Disk { broken }),
    ]
}

/// Two links to one vehicle, which has one MAVLink instance, and so one stream, for each.
struct World {
    now: Now,
    links: [Link<Addr>; 2],
    keys: KeyState,
    store: MemoryDisk,
    vehicles: [Vehicle; 2],
    in_flight: [Vec<Vec<u8>>; 2],
    recorder: Vec<Vec<u8>>,
    delivered: HashSet<Vec<u8>>,
    /// The largest stamp of ours that ever left, over all restarts.
    sent: Stamp,
    /// The largest stamp that was ever delivered.
    accepted: Stamp,
}

fn links() -> [Link<Addr>; 2] {
    [0, 1].map(|link_id| {
        Link::new(LinkConfig {
            link_id,
            ..LinkConfig::new(1, Security::Signed, Endpoint::Listen)
        })
    })
}

impl World {
    fn new() -> Self {
        let mut store = MemoryDisk::default();
        let keys = KeyState::start(key(), Origin::KeyFile, BUILD, at(0), &mut store).unwrap();
        Self {
            now: at(0),
            links: links(),
            keys,
            store,
            vehicles: [0, 1].map(|link_id| Vehicle {
                link_id,
                ..Vehicle::new(Stamp::new(1))
            }),
            in_flight: [vec![], vec![]],
            recorder: vec![],
            delivered: HashSet::new(),
            sent: Stamp::ZERO,
            accepted: Stamp::ZERO,
        }
    }

    fn receive(&mut self, link: usize, from: Addr, bytes: &[u8]) -> usize {
        let mut count = 0;
        let auth = Station::auth(&mut self.keys, &mut self.store);
        let (delivered, newest) = (&mut self.delivered, &mut self.accepted);
        self.links[link].handle_datagram(self.now, from, bytes, auth, &mut |d| {
            count += 1;
            assert!(d.verified);
            assert!(
                delivered.insert(d.frame.as_bytes().to_vec()),
                "delivered twice"
            );
            *newest = d.stamp.unwrap().max(*newest);
        });
        self.check_ceiling();
        count
    }

    fn stored(&self) -> Stamp {
        let stored = self.store.load(&key().id()).unwrap();
        stored.map_or(Stamp::ZERO, |Ceiling(stamp)| stamp)
    }

    /// Everything sent or accepted lies at or below what is on the disk.
    fn check_ceiling(&self) {
        let stored = self.stored();
        assert!(self.sent <= stored && self.accepted <= stored);
    }

    fn note_sent(&mut self, stamp: Stamp) {
        assert!(stamp > self.sent, "a stamp of ours was used again");
        self.sent = stamp;
        self.check_ceiling();
    }

    fn heartbeats(&mut self, arrive: bool) {
        for link in 0..2 {
            self.links[link].handle_timeout(self.now);
            let mut out = [0; MAX_FRAME];
            loop {
                let auth = Station::auth(&mut self.keys, &mut self.store);
                let Some(sent) = self.links[link].poll_transmit(self.now, auth, &mut out) else {
                    break;
                };
                self.note_sent(sent.stamp.unwrap());
                if arrive && sent.to == VEHICLE {
                    self.vehicles[link].receive(&out[..sent.len]);
                }
            }
        }
    }

    fn step(&mut self, step: &Step) {
        match *step {
            Step::Wait(time) => self.now = self.now.after(ms(time)),
            Step::VehicleSends { link } => {
                let frame = self.vehicles[link].heartbeat();
                self.recorder.push(frame.clone());
                self.in_flight[link].push(frame);
            }
            Step::Arrives { link, which, copy } => {
                let flying = &mut self.in_flight[link];
                if !flying.is_empty() {
                    let at = which % flying.len();
                    let frame = if copy {
                        flying[at].clone()
                    } else {
                        flying.remove(at)
                    };
                    self.receive(link, VEHICLE, &frame);
                }
            }
            Step::Lost { link, which } => {
                let flying = &mut self.in_flight[link];
                if !flying.is_empty() {
                    flying.remove(which % flying.len());
                }
            }
            Step::Replay {
                link,
                which,
                stranger,
            } => {
                if !self.recorder.is_empty() {
                    let frame = self.recorder[which % self.recorder.len()].clone();
                    self.receive(link, if stranger { STRANGER } else { VEHICLE }, &frame);
                }
            }
            Step::Heartbeats { arrive } => self.heartbeats(arrive),
            Step::WeSend { link, arrive } => {
                let mut out = [0; MAX_FRAME];
                let auth = Station::auth(&mut self.keys, &mut self.store);
                if let Ok(sent) = self.links[link].send(self.now, auth, &ack(), &mut out) {
                    self.note_sent(sent.stamp.unwrap());
                    if arrive && sent.to == VEHICLE {
                        self.vehicles[link].receive(&out[..sent.len]);
                    }
                }
            }
            Step::VehicleAhead { link, minutes } => {
                let stored = self.stored();
                // Less than an hour ahead of any base of ours, now or after a restart: one that pushes
                // further is refused, and that is meant.
                let ours = stored.min(self.keys.clock().base(self.now));
                let ahead = ours.plus(Duration::from_secs(60 * minutes));
                self.vehicles[link].stamp = self.vehicles[link].stamp.max(ahead);
            }
            Step::VehicleRestarts => self.vehicles.iter_mut().for_each(Vehicle::restart),
            Step::WeRestart => {
                self.now.mono = Duration::ZERO;
                self.links = links();
                self.keys =
                    KeyState::start(key(), Origin::KeyFile, BUILD, self.now, &mut self.store)
                        .unwrap();
            }
            Step::WallSet(days) => {
                let span = DAY * u32::try_from(days.unsigned_abs()).unwrap();
                self.now.wall = if days < 0 {
                    self.now.wall.saturating_sub(span)
                } else {
                    self.now.wall + span
                };
            }
            Step::Disk { broken } => self.store.full = broken.then_some(""),
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000,
        failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_frame_is_delivered_twice_and_no_stamp_is_used_twice(
        steps in prop::collection::vec(step(), 1..150),
    ) {
        let mut world = World::new();
        for step in &steps {
            world.step(step);
        }
    }

    #[test]
    fn after_any_history_the_vehicle_is_heard_within_a_round_trip_of_a_heartbeat(
        steps in prop::collection::vec(step(), 0..120),
    ) {
        let mut world = World::new();
        for step in &steps {
            world.step(step);
        }
        // The line is clean and the disk works from here on; what was in flight is gone.
        world.store.full = None;
        world.in_flight = [vec![], vec![]];
        // As long as a failed store is not tried again, and as somebody whose replay arrived before the vehicle's own frame is
        // taken for it.
        world.now = world.now.after(Duration::from_secs(3));
        for link in 0..2 {
            // Whoever replayed a frame before may have been sent the heartbeat of this turn; the next one is a fifth of a second later.
            world.now = world.now.after(ms(200));
            // The vehicle speaks, as it does all the time; that is all we need to know where it is.
            let hello = world.vehicles[link].heartbeat();
            world.receive(link, VEHICLE, &hello);
            world.heartbeats(true);
            let answer = world.vehicles[link].heartbeat();
            prop_assert_eq!(world.receive(link, VEHICLE, &answer), 1);
            prop_assert_eq!(world.links[link].state(), LinkState::Live);
            prop_assert_eq!(world.links[link].peer(), Some(VEHICLE));
        }
    }
}
