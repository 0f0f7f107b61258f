//! What other senders on the line can achieve, and to whom a key is not sent.

use mavlink_link::clock::{Ceiling, Origin};
use mavlink_link::frame::MAX_FRAME;
use mavlink_link::link::{Endpoint, LinkConfig, Security};
use mavlink_link::provisioning::{KeyRollover, KeyRolloverConfig, Outcome, State};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::{SigningKey, Stamp};
use mavlink_link::store::Store as _;

use super::px4::Px4;
use super::world::{World, config};
use crate::support::{BUILD, STRANGER, VEHICLE, ack, at, heartbeat, key, ms, other_key};

/// On a link that listens, what is sent arrives only where it was sent to.
impl World {
    fn listening(may_send_key: bool) -> Self {
        let mut world = Self::new(Some(key()));
        let ceiling = Stamp::from_unix(at(0).wall);
        world.disk.save(&key().id(), &Ceiling(ceiling)).unwrap();
        let (now, disk) = (world.now, &mut world.disk);
        let old = KeyState::start(key(), Origin::KeyFile, BUILD, now, disk).unwrap();
        let listens = KeyRolloverConfig {
            link: LinkConfig::new(1, Security::Signed, Endpoint::Listen),
            may_send_key,
            ..config()
        };
        world.ours = KeyRollover::start(listens, Some(old), other_key(), now, disk).unwrap();
        world
    }

    /// A tenth of a second; gives to whom SETUP_SIGNING went.
    fn step_by_address(&mut self, vehicle_is_on: bool) -> Option<u16> {
        self.tick += 1;
        self.now = self.now.after(ms(100));
        if vehicle_is_on {
            for frame in self.px4.speak(self.tick) {
                self.ours
                    .handle_datagram(self.now, VEHICLE, &frame, &mut self.disk);
            }
        }
        self.ours.handle_timeout(self.now);
        self.transmit(vehicle_is_on)
    }

    /// Sends what is due; gives to whom SETUP_SIGNING went.
    fn transmit(&mut self, vehicle_is_on: bool) -> Option<u16> {
        let mut out = [0; MAX_FRAME];
        let mut secret_to = None;
        while let Some(sent) = self.ours.poll_transmit(self.now, &mut self.disk, &mut out) {
            secret_to = sent.secret.then_some(sent.to).or(secret_to);
            if sent.to == VEHICLE && vehicle_is_on {
                self.px4.receive(&out[..sent.len]);
            }
        }
        secret_to
    }

    /// A datagram arrives, and what is due goes out at once, as in the shell.
    fn arrives_from(&mut self, from: u16, frame: &[u8]) {
        self.ours
            .handle_datagram(self.now, from, frame, &mut self.disk);
        assert_eq!(self.transmit(true), None);
    }
}

#[test]
fn nothing_is_sent_while_two_autopilots_are_on_the_line() {
    let mut world = World::new(None);
    world.run(5);
    let mut second = Px4 {
        system: 2,
        ..Px4::new(None)
    };
    let hello = second.heartbeat();
    let frame = second.send(&hello);
    world
        .ours
        .handle_datagram(world.now, VEHICLE, &frame, &mut world.disk);
    world.run(60);
    assert_eq!(world.ours.outcome(), Some(Outcome::SeveralAutopilots));
    assert_eq!(world.secrets, 0);
}

#[test]
fn strangers_frames_decide_nothing() {
    let mut world = World::new(Some(key()));
    world.until_sent();
    let mut forger = Px4::new(Some(SigningKey::new([0x33; 32]).unwrap()));
    let mut bare = Px4::new(None);
    for _ in 0..100 {
        for frame in [forger.send(&ack()), forger.send(&heartbeat())] {
            world
                .ours
                .handle_datagram(world.now, VEHICLE, &frame, &mut world.disk);
        }
        let frame = bare.send(&heartbeat());
        world
            .ours
            .handle_datagram(world.now, VEHICLE, &frame, &mut world.disk);
    }
    assert_eq!(world.ours.state(), State::Sent);
    assert!(world.ours.foreign_frames() >= 200);
    assert_eq!(world.settle(5), Some(Outcome::Committed));
}

#[test]
fn unsigned_datagrams_of_a_stranger_end_no_search_for_the_key() {
    let mut world = World::listening(false);
    let mut stranger = Px4::new(None);
    for _ in 0..200 {
        for message in [ack(), stranger.heartbeat()] {
            let frame = stranger.send(&message);
            let (now, disk) = (world.now, &mut world.disk);
            world.ours.handle_datagram(now, STRANGER, &frame, disk);
        }
        world.step_by_address(false);
    }
    assert_eq!(
        world.ours.outcome(),
        None,
        "nothing is known of the vehicle"
    );
    assert!(world.ours.disbelieved_frames() >= 400);
    for _ in 0..900 {
        world.step_by_address(true);
    }
    assert_eq!(world.ours.outcome(), Some(Outcome::RolledBack));
}

#[test]
fn a_vehicle_that_lost_its_key_ends_no_search_for_it_either() {
    let mut world = World::listening(false);
    for _ in 0..50 {
        world.step_by_address(true);
    }
    assert_eq!(world.ours.peer(), Some(VEHICLE));
    (world.px4.running, world.px4.file) = (None, None);
    for _ in 0..200 {
        world.step_by_address(true);
    }
    assert_eq!(world.ours.outcome(), None);
    assert!(
        world.ours.vehicle_is_open(world.now.mono),
        "and it is reported"
    );
}

#[test]
fn a_replay_from_elsewhere_keeps_no_fallen_vehicle_down() {
    for replayed in [false, true] {
        let mut world = World::listening(false);
        let recorded = Px4::new(Some(key())).send(&ack());
        for _ in 0..900 {
            if replayed {
                let (now, disk) = (world.now, &mut world.disk);
                world.ours.handle_datagram(now, STRANGER, &recorded, disk);
            }
            world.step_by_address(true);
        }
        assert_eq!(world.ours.outcome(), Some(Outcome::RolledBack));
        assert_eq!(world.ours.peer(), Some(VEHICLE));
    }
}

#[test]
fn a_recording_played_in_its_order_keeps_no_vehicle_down() {
    for restarted in [false, true] {
        let mut world = World::listening(false);
        let mut recorder = Px4::new(Some(key()));
        recorder.clock = Stamp::new(1_000);
        let recorded: Vec<_> = (0..4_000).map(|_| recorder.send(&ack())).collect();
        if !restarted {
            world.px4.clock = recorder.clock;
        }
        let mut played = recorded.iter();
        for tick in 0..1_000 {
            world.now = world.now.after(ms(1));
            for n in 0..3 {
                let frame = played.next().expect("no frame comes twice");
                world.arrives_from(STRANGER + n, frame);
            }
            if tick % 50 == 0 {
                let frame = world.px4.send(&ack());
                world.arrives_from(VEHICLE, &frame);
            }
        }
        assert_eq!(world.ours.peer(), Some(VEHICLE), "restarted: {restarted}");
    }
}

#[test]
fn a_rotation_sends_no_key_to_who_has_proved_nothing() {
    let mut world = World::listening(true);
    let mut stranger = Px4::new(None);
    for _ in 0..200 {
        for message in [ack(), stranger.heartbeat()] {
            let frame = stranger.send(&message);
            let (now, disk) = (world.now, &mut world.disk);
            world.ours.handle_datagram(now, STRANGER, &frame, disk);
        }
        assert_eq!(world.step_by_address(false), None);
    }
}

#[test]
fn of_two_unsigned_who_say_that_they_are_the_vehicle_neither_gets_its_first_key() {
    let mut world = World::new(None);
    world.ours = {
        let listens = KeyRolloverConfig {
            link: LinkConfig::new(1, Security::Signed, Endpoint::Listen),
            ..config()
        };
        KeyRollover::start(listens, None, other_key(), world.now, &mut world.disk).unwrap()
    };
    let mut stranger = Px4::new(None);
    for _ in 0..200 {
        let frame = stranger.send(&ack());
        let (now, disk) = (world.now, &mut world.disk);
        world.ours.handle_datagram(now, STRANGER, &frame, disk);
        assert_eq!(world.step_by_address(true), None);
    }
    assert_eq!(world.ours.outcome(), Some(Outcome::SeveralAutopilots));
}
