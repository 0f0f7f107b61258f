//! Mission transfers, both ends.

use std::time::Duration;

use kit::Random;
use kit::network::Faults;
use mavlink::dialects::development::{
    MISSION_ACK_DATA, MISSION_REQUEST_INT_DATA, MavMessage, MavMissionResult, MavMissionType,
};
use mavlink_link::service::Node;
use mavlink_link::service::mission::{
    self, Event, Failure, Item, Operation, StartError, plan_id, verify,
};
use px4_sim::services::mission::{Limits, Server, ServerEvent};
use px4_sim::services::mission_rules::{Airframe, Px4Rules};

use super::{PX4, US};
use crate::services::network::{BAD, DEAD, End, FAIR, Network, RADIO, WILD, clear};

const MISSION: MavMissionType = MavMissionType::MAV_MISSION_TYPE_MISSION;
const FENCE: MavMissionType = MavMissionType::MAV_MISSION_TYPE_FENCE;

struct World {
    now: Duration,
    network: Network,
    client: mission::Client,
    server: Server<Px4Rules>,
    texts: Vec<&'static str>,
    /// Every plan of items that the vehicle ever stored.
    stored: Vec<Vec<Item>>,
}

impl World {
    fn new(faults: Faults, seed: u64) -> Self {
        let rules = Px4Rules {
            airframe: Airframe::RotaryWing,
        };
        Self {
            now: Duration::from_secs(100),
            network: Network::new(seed, faults),
            client: mission::Client::new(US, PX4, mission::Timing::default()),
            server: Server::new(PX4, Limits::PX4_SITL, rules),
            texts: Vec::new(),
            stored: Vec::new(),
        }
    }

    /// Runs until the client's operation ends; returns its last event.
    fn run(&mut self) -> Event {
        let start = self.now;
        loop {
            self.exchange();
            while let Some(event) = self.client.poll_event() {
                if !matches!(event, Event::Progress { .. }) {
                    assert_eq!(self.client.busy(), None);
                    return event;
                }
            }
            self.step();
            assert!(
                self.now - start < Duration::from_secs(600),
                "no end in ten minutes"
            );
        }
    }

    /// Lets `time` pass.
    fn wait(&mut self, time: Duration) {
        let end = self.now + time;
        self.exchange();
        while self.next_at().is_some_and(|at| at <= end) {
            self.step();
            self.exchange();
        }
        self.now = end;
    }

    fn next_at(&self) -> Option<Duration> {
        let (client, server) = (self.client.poll_timeout(), self.server.poll_timeout());
        [client, server, self.network.next_arrival()]
            .into_iter()
            .flatten()
            .min()
    }

    fn step(&mut self) {
        let next = self
            .next_at()
            .expect("something is due while an operation runs");
        self.now = self.now.max(next);
        while let Some(packet) = self.network.receive(self.now) {
            let message = &packet.payload;
            match packet.to {
                End::Vehicle => self.server.handle_message(self.now, US, message),
                End::Ground => self.client.handle_message(self.now, PX4, message, true),
            };
            self.exchange();
        }
        self.client.handle_timeout(self.now);
        self.server.handle_timeout(self.now);
    }

    fn exchange(&mut self) {
        while let Some(message) = self.client.poll_transmit() {
            self.network
                .send_intact(self.now, End::Ground, End::Vehicle, message);
        }
        while let Some(message) = self.server.poll_transmit() {
            self.network
                .send_intact(self.now, End::Vehicle, End::Ground, message);
        }
        while let Some(event) = self.server.poll_event() {
            match event {
                ServerEvent::Stored { kind, .. } => {
                    self.stored.push(self.server.items(kind).to_vec());
                }
                ServerEvent::Text(text) => self.texts.push(text),
                ServerEvent::CurrentSet(_) => {}
            }
        }
    }
}

/// A plan of `count` items in which every item differs, and differs from those of another `salt`.
fn plan(count: u16, salt: i32) -> Vec<Item> {
    (0..count)
        .map(|seq| Item {
            frame: if seq % 3 == 0 { 0 } else { 6 },
            command: 16,
            current: seq == 0,
            autocontinue: true,
            params: [f32::from(seq % 7), 2.0, 0.0, f32::NAN],
            x: 473_977_418 + i32::from(seq) * 1000 + salt,
            y: -85_455_938 - i32::from(seq) * 777,
            z: 20.0 + f32::from(seq) / 4.0,
        })
        .collect()
}

#[test]
fn an_upload_ends_right_or_with_a_stated_failure_and_stores_no_other_plan() {
    let mut uploaded = 0;
    let mut runs = 0;
    for (faults, seeds) in [(FAIR, 2), (RADIO, 20), (BAD, 30), (WILD, 60)] {
        for seed in 0..seeds {
            let mut world = World::new(faults, seed);
            let items = plan(1 + (seed % 25) as u16, 0);
            let id = plan_id(&items);
            world
                .client
                .upload(world.now, MISSION, items.clone())
                .unwrap();
            runs += 1;
            match world.run() {
                Event::Uploaded { kind, opaque_id } => {
                    assert_eq!((kind, opaque_id), (MISSION, id), "{faults:?} {seed}");
                    assert_eq!(world.server.items(MISSION), items);
                    uploaded += 1;
                }
                Event::Failed {
                    operation: Operation::Upload,
                    ..
                } => {}
                event => panic!("{faults:?} {seed}: {event:?}"),
            }
            assert!(
                world.stored.iter().all(|stored| *stored == items),
                "{faults:?} {seed}"
            );
        }
    }
    // Most uploads succeed; every other one is reported as failed.
    assert!(uploaded * 100 >= runs * 97, "{uploaded} of {runs}");
}

#[test]
fn plan_after_plan_over_a_wild_network_never_takes_one_for_another() {
    let mut confirmed = 0;
    for seed in 0..25 {
        let mut world = World::new(WILD, 7000 + seed);
        let mut random = Random::with_seed(seed);
        for round in 0..6 {
            let items = plan(random.u16(1..=9), round + 1);
            world
                .client
                .upload(world.now, MISSION, items.clone())
                .unwrap();
            if let Event::Uploaded { opaque_id, .. } = world.run() {
                assert_eq!(opaque_id, plan_id(&items), "{seed} {round}");
                assert_eq!(world.server.items(MISSION), items, "{seed} {round}");
                confirmed += 1;
            }
            let pause = random.u64(..400);
            world.wait(Duration::from_millis(pause));
        }
    }
    assert!(confirmed > 130, "{confirmed} of 150");
}

#[test]
fn a_download_brings_what_the_vehicle_holds_and_verifies() {
    let mut downloaded = 0;
    for (faults, seeds) in [(FAIR, 2), (RADIO, 15), (BAD, 20), (WILD, 30)] {
        for seed in 0..seeds {
            let mut world = World::new(faults, 500 + seed);
            world.network.faults = FAIR;
            let items = plan(1 + (seed % 12) as u16, 3);
            world
                .client
                .upload(world.now, MISSION, items.clone())
                .unwrap();
            assert!(matches!(world.run(), Event::Uploaded { .. }));
            world.wait(Duration::from_secs(1));

            world.network.faults = faults;
            world.client.download(world.now, MISSION).unwrap();
            match world.run() {
                Event::Downloaded {
                    kind,
                    items: read,
                    opaque_id,
                } => {
                    assert_eq!((kind, opaque_id), (MISSION, plan_id(&items)));
                    assert_eq!(verify(MISSION, &items, &read), Ok(()), "{faults:?} {seed}");
                    downloaded += 1;
                }
                Event::Failed {
                    operation: Operation::Download,
                    ..
                } => {}
                event => panic!("{faults:?} {seed}: {event:?}"),
            }
        }
    }
    assert!(downloaded >= 60, "{downloaded} of 67");
}

#[test]
fn an_upload_right_after_a_download_whose_last_word_was_lost_succeeds() {
    let mut world = World::new(FAIR, 1);
    world.client.upload(world.now, MISSION, plan(3, 0)).unwrap();
    assert!(matches!(world.run(), Event::Uploaded { .. }));
    world.client.download(world.now, MISSION).unwrap();
    assert!(matches!(world.run(), Event::Downloaded { .. }));
    clear(&mut world.network);
    while world.client.poll_transmit().is_some() {}
    assert!(world.server.is_busy());

    let next = plan(2, 9);
    world
        .client
        .upload(world.now, MISSION, next.clone())
        .unwrap();
    assert!(matches!(world.run(), Event::Uploaded { .. }));
    assert_eq!(world.server.items(MISSION), next);
}

#[test]
fn clearing_works_over_a_bad_network_and_clears_only_what_it_names() {
    for seed in 0..20 {
        let mut world = World::new(BAD, 900 + seed);
        world.client.clear(world.now, MISSION).unwrap();
        assert_eq!(world.run(), Event::Cleared { kind: MISSION }, "{seed}");
        assert_eq!(world.server.opaque_id(MISSION), 0);
    }
    let mut world = World::new(FAIR, 0);
    world.client.upload(world.now, MISSION, plan(3, 0)).unwrap();
    assert!(matches!(world.run(), Event::Uploaded { .. }));
    world.client.clear(world.now, FENCE).unwrap();
    assert_eq!(world.run(), Event::Cleared { kind: FENCE });
    assert_eq!(world.server.items(MISSION).len(), 3);
    world
        .client
        .clear(world.now, MavMissionType::MAV_MISSION_TYPE_ALL)
        .unwrap();
    assert!(matches!(world.run(), Event::Cleared { .. }));
    assert!(world.server.items(MISSION).is_empty());
}

#[test]
fn a_refused_item_is_named_and_the_plan_aboard_stays() {
    let mut world = World::new(RADIO, 4);
    let held = plan(4, 0);
    world
        .client
        .upload(world.now, MISSION, held.clone())
        .unwrap();
    assert!(matches!(world.run(), Event::Uploaded { .. }));
    let mut bad = plan(6, 5);
    bad[3].command = 18;
    world.client.upload(world.now, MISSION, bad).unwrap();
    let result = MavMissionResult::MAV_MISSION_UNSUPPORTED;
    assert_eq!(
        world.run(),
        Event::Failed {
            operation: Operation::Upload,
            kind: MISSION,
            reason: Failure::Refused {
                result,
                seq: Some(3)
            },
        }
    );
    assert_eq!(world.server.items(MISSION), held);
}

#[test]
fn too_many_items_are_refused_before_any_is_sent() {
    let mut world = World::new(FAIR, 4);
    world.client.upload(world.now, FENCE, plan(65, 0)).unwrap();
    let result = MavMissionResult::MAV_MISSION_NO_SPACE;
    assert_eq!(
        world.run(),
        Event::Failed {
            operation: Operation::Upload,
            kind: FENCE,
            reason: Failure::Refused { result, seq: None },
        }
    );
}

#[test]
fn a_silent_vehicle_fails_every_operation_in_ten_seconds() {
    let start = |world: &mut World, operation: Operation| match operation {
        Operation::Upload => world.client.upload(world.now, MISSION, plan(2, 0)),
        Operation::Download => world.client.download(world.now, MISSION),
        Operation::Clear => world.client.clear(world.now, MISSION),
        Operation::SetCurrent => world.client.set_current(world.now, 1..=1),
    };
    for requested in [
        Operation::Upload,
        Operation::Download,
        Operation::Clear,
        Operation::SetCurrent,
    ] {
        let mut world = World::new(DEAD, 1);
        let begun = world.now;
        start(&mut world, requested).unwrap();
        assert_eq!(
            start(&mut world, Operation::Clear),
            Err(StartError::Busy(requested))
        );
        let Event::Failed {
            operation, reason, ..
        } = world.run()
        else {
            panic!("{requested:?} cannot succeed");
        };
        assert_eq!(operation, requested);
        assert!(matches!(reason, Failure::NoAnswer { .. }), "{reason:?}");
        assert!(world.now - begun <= Duration::from_secs(10));
    }
}

#[test]
fn a_link_that_dies_in_the_middle_is_stated_and_px4_gives_up_after_five_seconds() {
    let mut world = World::new(FAIR, 1);
    world
        .client
        .upload(world.now, MISSION, plan(50, 0))
        .unwrap();
    world.wait(Duration::from_millis(100));
    assert!(world.server.is_busy());
    world.network.faults = DEAD;
    let Event::Failed { reason, .. } = world.run() else {
        panic!("a dead link cannot succeed");
    };
    assert!(matches!(reason, Failure::NoAnswer { .. }), "{reason:?}");
    world.wait(Duration::from_secs(6));
    assert_eq!(world.texts, ["Mission sync timeout\t"]);
    assert!(world.stored.is_empty());
}

#[test]
fn a_cancelled_upload_frees_the_vehicle_at_once() {
    let mut world = World::new(FAIR, 1);
    world
        .client
        .upload(world.now, MISSION, plan(50, 0))
        .unwrap();
    world.wait(Duration::from_millis(100));
    world.client.cancel();
    // Another operation may have begun: the end of this one is not to be taken for that one's.
    while let Some(event) = world.client.poll_event() {
        assert!(matches!(event, Event::Progress { .. }), "{event:?}");
    }
    world.wait(Duration::from_millis(50));
    assert!(!world.server.is_busy());
    assert!(world.texts.is_empty() && world.stored.is_empty());
}

#[test]
fn a_plan_that_another_program_left_half_sent_is_not_finished_with_ours() {
    // The other station has the same ids, as an earlier process of this one would after a restart.
    let mut world = World::new(FAIR, 1);
    world.client.upload(world.now, MISSION, plan(9, 1)).unwrap();
    world.wait(Duration::from_millis(45));
    assert!(world.server.is_busy());
    world.client = mission::Client::new(US, PX4, mission::Timing::default());
    let ours = plan(9, 2);
    world
        .client
        .upload(world.now, MISSION, ours.clone())
        .unwrap();
    assert!(matches!(world.run(), Event::Uploaded { .. }));
    assert_eq!(world.stored, [ours]);
}

#[test]
fn a_transfer_that_another_station_left_is_waited_for() {
    let other = Node::new(254, 190);
    let mut world = World::new(FAIR, 1);
    let mut rival = mission::Client::new(other, PX4, mission::Timing::default());
    rival.upload(world.now, MISSION, plan(3, 1)).unwrap();
    let count = rival.poll_transmit().unwrap();
    world.server.handle_message(world.now, other, &count);
    while world.server.poll_transmit().is_some() {}
    world.client.upload(world.now, MISSION, plan(2, 2)).unwrap();
    // The rival stops, PX4 drops its transfer after 5 s, and then this upload succeeds. A client that sends requests
    // more often than that keeps the dead transfer alive.
    assert!(matches!(world.run(), Event::Uploaded { .. }));
    assert_eq!(world.texts, ["Mission sync timeout\t"]);
}

#[test]
fn a_station_that_continues_its_transfer_is_stated() {
    let mut world = World::new(FAIR, 1);
    let error = MavMissionResult::MAV_MISSION_ERROR;
    world.client.upload(world.now, MISSION, plan(2, 2)).unwrap();
    let end = loop {
        // A vehicle that is busy with the other station at each request.
        while let Some(message) = world.client.poll_transmit() {
            if matches!(message, MavMessage::MISSION_COUNT(_)) {
                let busy = MavMessage::MISSION_ACK(MISSION_ACK_DATA {
                    target_system: US.system,
                    target_component: US.component,
                    mavtype: error,
                    ..MISSION_ACK_DATA::default()
                });
                world.client.handle_message(world.now, PX4, &busy, true);
            }
        }
        if let Some(event) = world.client.poll_event() {
            break event;
        }
        world.now = world.client.poll_timeout().unwrap();
        world.client.handle_timeout(world.now);
    };
    assert_eq!(
        end,
        Event::Failed {
            operation: Operation::Upload,
            kind: MISSION,
            reason: Failure::Refused {
                result: error,
                seq: None
            },
        }
    );
}

#[test]
fn a_shorter_plan_whose_cancelling_was_lost_does_not_cut_the_next_one_short() {
    let mut world = World::new(FAIR, 1);
    world.client.upload(world.now, MISSION, plan(2, 1)).unwrap();
    let count = world.client.poll_transmit().unwrap();
    world.server.handle_message(world.now, US, &count);
    while world.server.poll_transmit().is_some() {}
    world.client.cancel();
    while world.client.poll_transmit().is_some() {}

    let ours = plan(5, 2);
    world
        .client
        .upload(world.now, MISSION, ours.clone())
        .unwrap();
    assert!(matches!(world.run(), Event::Uploaded { .. }));
    assert_eq!(world.stored, [ours]);
}

fn request(seq: u16) -> MavMessage {
    MavMessage::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA {
        seq,
        target_system: US.system,
        target_component: US.component,
        ..MISSION_REQUEST_INT_DATA::default()
    })
}

fn accepted(opaque_id: u32) -> MavMessage {
    MavMessage::MISSION_ACK(MISSION_ACK_DATA {
        target_system: US.system,
        target_component: US.component,
        opaque_id,
        ..MISSION_ACK_DATA::default()
    })
}

#[test]
fn an_acknowledgement_before_the_last_item_was_requested_is_an_old_one() {
    let mut world = World::new(FAIR, 1);
    let items = plan(2, 0);
    let id = plan_id(&items);
    world.client.upload(world.now, MISSION, items).unwrap();
    for message in [accepted(id), request(0), accepted(id), request(1)] {
        world.client.handle_message(world.now, PX4, &message, true);
        let event = world.client.poll_event();
        assert!(
            matches!(event, None | Some(Event::Progress { .. })),
            "{event:?}"
        );
    }
    world
        .client
        .handle_message(world.now, PX4, &accepted(id), true);
    let uploaded = Event::Uploaded {
        kind: MISSION,
        opaque_id: id,
    };
    assert_eq!(world.client.poll_event(), Some(uploaded));
}

#[test]
fn an_acknowledgement_of_another_plan_never_confirms_this_one() {
    let mut world = World::new(FAIR, 1);
    let items = plan(1, 0);
    let expected = plan_id(&items);
    world.client.upload(world.now, MISSION, items).unwrap();
    let end = loop {
        while let Some(message) = world.client.poll_transmit() {
            let answer = match message {
                MavMessage::MISSION_COUNT(_) => request(0),
                MavMessage::MISSION_ITEM_INT(_) => accepted(77),
                _ => continue,
            };
            world.client.handle_message(world.now, PX4, &answer, true);
        }
        match world.client.poll_event() {
            None | Some(Event::Progress { .. }) => {}
            Some(event) => break event,
        }
        if let Some(due) = world.client.poll_timeout() {
            world.now = due;
            world.client.handle_timeout(due);
        }
    };
    let reason = Failure::OtherPlan {
        expected,
        found: 77,
    };
    assert_eq!(
        end,
        Event::Failed {
            operation: Operation::Upload,
            kind: MISSION,
            reason
        }
    );
}
