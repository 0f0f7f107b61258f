//! Handing over a key: each step, and every history of one or two faults, against a vehicle that does
//! with SETUP_SIGNING what PX4 was seen to do.

mod support;

use std::collections::HashMap;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::clock::{CeilingStore, Origin, StoreError};
use mavlink_link::dialect::{
    HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, STATUSTEXT_DATA,
};
use mavlink_link::frame::{FrameView, Header, INCOMPAT_SIGNED, MAX_FRAME, encode};
use mavlink_link::link::{Endpoint, LinkConfig, Security};
use mavlink_link::provisioning::{Event, Handover, HandoverConfig, Outcome, StartError, State};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::{KeyId, SigningKey, Stamp, sign, verify};
use support::{BUILD, STRANGER, VEHICLE, at, key, ms, other_key};

/// The vehicle's side: key in memory and in its file, one table of streams for its life.
struct Px4 {
    system: u8,
    running: Option<SigningKey>,
    file: Option<(SigningKey, Stamp)>,
    clock: Stamp,
    streams: HashMap<(u8, u8, u8), Stamp>,
    armed: bool,
    can_sign: bool,
    seq: u8,
    to_say: Vec<MavMessage>,
}

impl Px4 {
    fn new(key: Option<SigningKey>) -> Self {
        let clock = Stamp::new(1);
        Self {
            system: 1,
            running: key.as_ref().map(SigningKey::duplicate),
            file: key.map(|key| (key, clock)),
            clock,
            streams: HashMap::new(),
            armed: false,
            can_sign: true,
            seq: 0,
            to_say: vec![],
        }
    }

    fn reboot(&mut self) {
        self.running = self.file.as_ref().map(|(key, _)| key.duplicate());
        self.clock = self.file.as_ref().map_or(Stamp::ZERO, |(_, stamp)| *stamp);
        self.streams.clear();
        self.armed = false;
    }

    fn receive(&mut self, bytes: &[u8]) {
        let frame = FrameView::parse(bytes).expect("a frame of ours");
        let header = frame.header();
        if let Some(key) = &self.running {
            let Some(signature) = frame.signature() else {
                return;
            };
            let stream = (header.system_id, header.component_id, signature.link_id);
            if verify(key, &frame).is_err() {
                return;
            }
            match self.streams.get(&stream) {
                Some(&last) if signature.stamp <= last => return,
                None if signature.stamp.plus(Duration::from_secs(60)) < self.clock => return,
                _ => {}
            }
            self.streams.insert(stream, signature.stamp);
            self.clock = self.clock.max(signature.stamp);
        }
        if header.message_id == 256 && self.can_sign {
            if self.armed {
                let text = "MAVLink signing: rejected while armed";
                self.to_say.push(MavMessage::STATUSTEXT(STATUSTEXT_DATA {
                    text: text.into(),
                    ..STATUSTEXT_DATA::default()
                }));
                return;
            }
            let Ok(MavMessage::SETUP_SIGNING(setup)) = frame.message() else {
                panic!("SETUP_SIGNING")
            };
            assert_eq!((setup.target_system, setup.target_component), (1, 1));
            assert_ne!(setup.secret_key, [0; 32]);
            let stamp = Stamp::new(setup.initial_timestamp);
            assert!(stamp > self.clock, "first stamp above all seen");
            let key = SigningKey::new(setup.secret_key).unwrap();
            self.running = Some(key.duplicate());
            self.file = Some((key, stamp));
            self.clock = stamp;
        }
    }

    fn send(&mut self, message: &MavMessage) -> Vec<u8> {
        let header = Header {
            seq: self.seq,
            system_id: self.system,
            component_id: 1,
            incompat: if self.running.is_some() {
                INCOMPAT_SIGNED
            } else {
                0
            },
            ..Header::default()
        };
        self.seq = self.seq.wrapping_add(1);
        let mut out = [0; MAX_FRAME];
        let mut len = encode(message, header, &mut out);
        if let Some(key) = &self.running {
            len = sign(key, 0, self.clock, &mut out, len).unwrap();
            self.clock = self.clock.next().unwrap();
        }
        out[..len].to_vec()
    }

    /// What it says by itself: a heartbeat each second, something else five times.
    fn speak(&mut self, tick: u64) -> Vec<Vec<u8>> {
        let mut said: Vec<_> = self.to_say.drain(..).collect();
        if tick % 10 == 3 {
            said.push(self.heartbeat());
        }
        if tick.is_multiple_of(2) {
            said.push(support::ack());
        }
        said.iter().map(|message| self.send(message)).collect()
    }

    fn heartbeat(&self) -> MavMessage {
        let mut base_mode = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
        base_mode.set(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED, self.armed);
        MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
            base_mode,
            ..HEARTBEAT_DATA::default()
        })
    }

    fn has(&self, key: &SigningKey) -> bool {
        self.running.as_ref().is_some_and(|own| own.same_as(key))
    }
}

/// What is on our disk.
#[derive(Default)]
struct Disk {
    ceilings: HashMap<KeyId, Stamp>,
    current: Option<SigningKey>,
    next: Option<SigningKey>,
    previous: Option<SigningKey>,
    full: bool,
}

impl CeilingStore for Disk {
    fn load(&mut self, key: &KeyId) -> Result<Option<Stamp>, StoreError> {
        Ok(self.ceilings.get(key).copied())
    }

    fn store(&mut self, key: &KeyId, ceiling: Stamp) -> Result<(), StoreError> {
        if self.full {
            return Err(StoreError {
                reason: "disk full".into(),
            });
        }
        self.ceilings.insert(*key, ceiling);
        Ok(())
    }
}

impl Disk {
    fn commit(&mut self) {
        if let Some(next) = self.next.take() {
            self.previous = self.current.replace(next);
        }
    }

    fn holds(&self, key: &SigningKey) -> bool {
        [&self.current, &self.next, &self.previous]
            .into_iter()
            .flatten()
            .any(|held| held.same_as(key))
    }
}

/// Both ends under one clock, and the faults between them.
struct World {
    px4: Px4,
    disk: Disk,
    ours: Handover<u16>,
    now: Now,
    tick: u64,
    /// Datagrams so far, both ways, to name the one that is lost.
    datagrams: usize,
    lost: Vec<usize>,
    history: Vec<Event>,
    secrets: usize,
    /// It arms between its word and our answer.
    arms: bool,
    /// All that we send is lost.
    mute: bool,
}

fn config() -> HandoverConfig<u16> {
    HandoverConfig {
        link: LinkConfig::new(1, Security::Signed, Endpoint::Fixed(VEHICLE)),
        not_before: BUILD,
        may_send_key: true,
        believe_unsigned: false,
    }
}

fn start(disk: &mut Disk, now: Now) -> Handover<u16> {
    let old = disk.current.as_ref().map(SigningKey::duplicate);
    let old = old.map(|old| KeyState::start(old, Origin::KeyFile, BUILD, now, disk).unwrap());
    let new = disk.next.as_ref().unwrap().duplicate();
    Handover::start(config(), old, new, now, disk).unwrap()
}

impl World {
    fn new(current: Option<SigningKey>) -> Self {
        let mut disk = Disk {
            current: current.as_ref().map(SigningKey::duplicate),
            next: Some(other_key()),
            ..Disk::default()
        };
        let now = at(0);
        Self {
            px4: Px4::new(current),
            ours: start(&mut disk, now),
            disk,
            now,
            tick: 0,
            datagrams: 0,
            lost: vec![],
            history: vec![],
            secrets: 0,
            arms: false,
            mute: false,
        }
    }

    fn arrives(&mut self) -> bool {
        self.datagrams += 1;
        !self.lost.contains(&self.datagrams)
    }

    /// A tenth of a second.
    fn step(&mut self) {
        self.tick += 1;
        self.now = self.now.after(ms(100));
        for frame in self.px4.speak(self.tick) {
            if self.arrives() {
                self.ours
                    .handle_datagram(self.now, VEHICLE, &frame, &mut self.disk);
            }
        }
        self.px4.armed |= self.arms;
        self.ours.handle_timeout(self.now);
        let mut out = [0; MAX_FRAME];
        while let Some(sent) = self.ours.poll_transmit(self.now, &mut self.disk, &mut out) {
            assert_eq!(
                sent.secret,
                FrameView::parse(&out[..sent.len])
                    .unwrap()
                    .header()
                    .message_id
                    == 256
            );
            self.secrets += usize::from(sent.secret);
            if self.arrives() && !self.mute {
                self.px4.receive(&out[..sent.len]);
            }
        }
        while let Some(event) = self.ours.poll_event() {
            match event {
                Event::Commit => self.disk.commit(),
                Event::Ended(Outcome::RolledBack) => self.disk.next = None,
                _ => {}
            }
            self.history.push(event);
        }
        // The promise: whatever key the vehicle has, we have it too.
        let file = self.px4.file.as_ref().map(|(key, _)| key);
        for key in self.px4.running.iter().chain(file) {
            assert!(
                self.disk.holds(key),
                "a key of the vehicle is lost: {:?}",
                self.history
            );
        }
    }

    /// Until the key has been sent.
    fn until_sent(&mut self) {
        for _ in 0..600 {
            if self.secrets > 0 {
                return;
            }
            self.step();
        }
        panic!("never sent: {:?}", self.history);
    }

    fn run(&mut self, seconds: u64) {
        for _ in 0..seconds * 10 {
            self.step();
        }
    }

    /// Until it has ended, or so long.
    fn settle(&mut self, seconds: u64) -> Option<Outcome> {
        for _ in 0..seconds * 10 {
            self.step();
            if self.ours.outcome().is_some() {
                break;
            }
        }
        self.ours.outcome()
    }

    /// We are killed and start again with what is on the disk; where nothing is staged, there is
    /// nothing to go on with.
    fn kill(&mut self) {
        if self.disk.next.is_some() {
            self.now.mono = Duration::from_secs(1);
            self.ours = start(&mut self.disk, self.now);
        }
    }

    fn states(&self) -> Vec<State> {
        self.history
            .iter()
            .filter_map(|event| match event {
                Event::State(state) => Some(*state),
                _ => None,
            })
            .collect()
    }
}

#[test]
fn a_first_key_goes_to_an_unsigned_vehicle() {
    let mut world = World::new(None);
    assert_eq!(world.settle(30), Some(Outcome::Committed));
    assert!(world.px4.has(&other_key()));
    assert!(world.disk.current.as_ref().unwrap().same_as(&other_key()));
    use State::{Committed, Sent, Staged, WaitDisarm};
    assert_eq!(world.states(), [Staged, WaitDisarm, Sent, Committed]);
    assert!(
        world.now.mono >= Duration::from_secs(10),
        "the line was watched first"
    );
    assert_eq!(world.secrets, 1);
}

#[test]
fn a_key_is_rotated_and_the_link_goes_on_under_the_new_one() {
    let mut world = World::new(Some(key()));
    assert_eq!(world.settle(30), Some(Outcome::Committed));
    assert!(world.px4.has(&other_key()));
    assert!(world.disk.previous.as_ref().unwrap().same_as(&key()));
    let keys = world.ours.into_key_in_force().unwrap();
    assert_eq!(keys.id(), other_key().id());
    assert!(keys.clock().floor() < keys.clock().reading(world.now));
}

#[test]
fn fall_14_signing_is_not_switched_over_before_the_vehicle_has_taken_the_key() {
    let mut world = World::new(Some(key()));
    world.run(9);
    // The key is lost on its way: nothing is committed on hope.
    world.mute = true;
    world.until_sent();
    assert_eq!(world.ours.state(), State::Sent);
    assert!(world.disk.current.as_ref().unwrap().same_as(&key()));
    world.mute = false;
    assert_eq!(world.settle(60), Some(Outcome::Committed));
    assert!(
        world.states().contains(&State::NotTaken),
        "and sent again: {:?}",
        world.states()
    );
    assert!(world.disk.current.as_ref().unwrap().same_as(&other_key()));
}

#[test]
fn fall_23_a_power_cut_that_leaves_the_vehicle_unsigned_is_mended() {
    let mut world = World::new(Some(key()));
    assert_eq!(world.settle(30), Some(Outcome::Committed));
    // Its file was truncated, and not yet written.
    world.px4.file = None;
    world.px4.reboot();
    world.run(30);
    assert!(world.history.contains(&Event::FellBack));
    assert_eq!(world.ours.outcome(), Some(Outcome::Committed));
    assert!(world.px4.has(&other_key()));
}

#[test]
fn fall_27_silence_is_no_refusal_and_the_key_that_was_taken_is_kept() {
    let mut world = World::new(Some(key()));
    world.until_sent();
    assert!(world.px4.has(&other_key()), "it took the key at once");
    // From here on nothing of it reaches us, for a quarter of an hour.
    world.lost = (world.datagrams + 1..world.datagrams + 20_000).collect();
    world.run(900);
    assert_eq!(
        (world.ours.state(), world.ours.outcome()),
        (State::Unknown, None)
    );
    assert!(world.disk.holds(&key()) && world.disk.holds(&other_key()));
    world.lost.clear();
    assert_eq!(world.settle(15), Some(Outcome::Committed));
    assert_eq!(world.secrets, 1, "nothing was sent into the silence");
}

#[test]
fn an_armed_vehicle_is_not_sent_a_key() {
    let mut world = World::new(Some(key()));
    world.px4.armed = true;
    world.run(60);
    assert_eq!((world.ours.state(), world.secrets), (State::WaitDisarm, 0));
    world.px4.armed = false;
    assert_eq!(world.settle(5), Some(Outcome::Committed));
}

#[test]
fn a_vehicle_that_arms_just_then_is_waited_for() {
    let mut world = World::new(Some(key()));
    world.run(5);
    world.px4.armed = true;
    world.run(10);
    assert_eq!((world.ours.state(), world.secrets), (State::WaitDisarm, 0));
    // It says disarmed; when the key arrives it is armed.
    (world.px4.armed, world.arms) = (false, true);
    while world.secrets < 2 {
        world.px4.armed = false;
        assert!(world.tick < 600);
        world.step();
    }
    world.run(20);
    world.arms = false;
    assert!(world.history.contains(&Event::RefusedWhileArmed));
    assert_eq!(world.ours.outcome(), None);
    world.px4.armed = false;
    assert_eq!(world.settle(10), Some(Outcome::Committed));
}

#[test]
fn a_vehicle_that_never_signs_is_told_apart() {
    let mut world = World::new(None);
    world.px4.can_sign = false;
    assert_eq!(world.settle(60), Some(Outcome::NeverSigns));
    assert_eq!(world.secrets, 3);
    assert!(
        world.disk.next.is_some(),
        "unsigned frames prove nothing: the key stays"
    );
}

#[test]
fn a_vehicle_that_keeps_its_key_has_the_new_one_taken_back_after_half_a_minute() {
    let mut world = World::new(Some(key()));
    world.px4.can_sign = false;
    assert_eq!(world.settle(120), Some(Outcome::RolledBack));
    assert_eq!(world.secrets, 3);
    assert!(world.disk.next.is_none() && world.disk.current.as_ref().unwrap().same_as(&key()));
    let back = world
        .states()
        .iter()
        .position(|&s| s == State::RolledBack)
        .unwrap();
    assert_eq!(world.states().len(), back + 1);
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
        for frame in [
            forger.send(&support::ack()),
            forger.send(&support::heartbeat()),
        ] {
            world
                .ours
                .handle_datagram(world.now, VEHICLE, &frame, &mut world.disk);
        }
        let frame = bare.send(&support::heartbeat());
        world
            .ours
            .handle_datagram(world.now, VEHICLE, &frame, &mut world.disk);
    }
    assert_eq!(world.ours.state(), State::Sent);
    assert!(world.ours.foreign_frames() >= 200);
    assert_eq!(world.settle(5), Some(Outcome::Committed));
}

#[test]
fn a_clock_that_was_dragged_years_ahead_is_mended_by_a_new_key() {
    let mut world = World::new(Some(key()));
    // Somebody with the key has pushed the vehicle's clock where no honest receiver follows.
    world.px4.clock = Stamp::from_unix(at(0).wall + Duration::from_secs(86_400));
    world.px4.streams.insert((245, 190, 0), Stamp::new(1));
    // It takes the new stamp, below its own clock: that is what sets the clock back.
    let mut out = [0; MAX_FRAME];
    for _ in 0..200 {
        world.tick += 1;
        world.now = world.now.after(ms(100));
        for frame in world.px4.speak(world.tick) {
            world
                .ours
                .handle_datagram(world.now, VEHICLE, &frame, &mut world.disk);
        }
        world.ours.handle_timeout(world.now);
        while let Some(sent) = world
            .ours
            .poll_transmit(world.now, &mut world.disk, &mut out)
        {
            if sent.secret {
                world.px4.clock = Stamp::new(1);
            }
            world.px4.receive(&out[..sent.len]);
        }
    }
    assert_eq!(world.ours.outcome(), Some(Outcome::Committed));
}

/// A process was ended before it had sent the key, or its clocks were lost after it had: whoever may not send
/// a key finds out which one the vehicle has.
#[test]
fn who_may_not_send_the_key_finds_out_which_one_the_vehicle_has() {
    for (vehicle_has, expected) in [
        (key(), Outcome::RolledBack),
        (other_key(), Outcome::Committed),
    ] {
        let mut world = World::new(Some(key()));
        world.px4 = Px4::new(Some(vehicle_has));
        let current = KeyState::start(key(), Origin::KeyFile, BUILD, world.now, &mut world.disk);
        let asks = HandoverConfig {
            may_send_key: false,
            ..config()
        };
        let (now, disk) = (world.now, &mut world.disk);
        world.ours = Handover::start(asks, current.ok(), other_key(), now, disk).unwrap();
        assert_eq!(world.settle(60), Some(expected), "{:?}", world.history);
        assert_eq!(world.secrets, 0, "no key was sent");
    }
}

#[test]
fn the_same_key_again_is_no_handover() {
    let mut disk = Disk::default();
    let old = KeyState::start(key(), Origin::KeyFile, BUILD, at(0), &mut disk).unwrap();
    let refused = Handover::start(config(), Some(old), key(), at(0), &mut disk);
    assert_eq!(refused.map(|_| ()).unwrap_err(), StartError::SameKey);
}

#[test]
fn a_disk_that_fails_holds_the_key_back_until_it_works() {
    let mut world = World::new(Some(key()));
    world.run(5);
    world.disk.full = true;
    world.run(20);
    assert_eq!(
        world.secrets, 0,
        "a key whose clock is not stored is never sent"
    );
    world.disk.full = false;
    assert_eq!(world.settle(30), Some(Outcome::Committed));
}

/// One thing that goes wrong.
#[derive(Debug, Clone, Copy)]
enum Fault {
    Lost(usize),
    /// The vehicle restarts at this tick, with the file that it has.
    VehicleRestarts(u64),
    /// Its power is cut at this tick: the file is empty.
    VehicleEmptied(u64),
    /// Its power is cut at this tick, and the old file is back.
    VehicleForgets(u64),
    /// We are killed at this tick.
    Killed(u64),
    /// Nothing passes either way for ten seconds from this tick.
    Cut(u64),
    /// Our disk is full for five seconds from this tick.
    Full(u64),
}

/// Runs one handover with these faults, then a clean line, and asks that both ends agree by themselves.
fn must_come_back(current: Option<&SigningKey>, faults: &[Fault]) {
    let mut world = World::new(current.map(SigningKey::duplicate));
    world.lost = faults
        .iter()
        .filter_map(|fault| match fault {
            Fault::Lost(n) => Some(*n),
            _ => None,
        })
        .collect();
    let old_file = world
        .px4
        .file
        .as_ref()
        .map(|(key, stamp)| (key.duplicate(), *stamp));
    let mut cut_until = 0;
    let mut full_until = 0;
    for tick in 1..=2_000 {
        for fault in faults {
            match *fault {
                Fault::VehicleRestarts(when) if when == tick => world.px4.reboot(),
                Fault::VehicleEmptied(when) if when == tick => {
                    // Only a file that is being written can be lost.
                    if world.secrets > 0 && world.px4.has(&other_key()) {
                        world.px4.file = None;
                    }
                    world.px4.reboot();
                }
                Fault::VehicleForgets(when) if when == tick => {
                    world.px4.file = old_file.as_ref().map(|(key, s)| (key.duplicate(), *s));
                    world.px4.reboot();
                }
                Fault::Killed(when) if when == tick => world.kill(),
                Fault::Cut(when) if when == tick => cut_until = tick + 100,
                Fault::Full(when) if when == tick => full_until = tick + 50,
                _ => {}
            }
        }
        world.disk.full = tick < full_until;
        if tick < cut_until {
            world.lost.extend(world.datagrams + 1..world.datagrams + 20);
        }
        world.step();
        if tick > 400 && world.ours.outcome().is_some() && tick % 100 == 0 {
            break;
        }
    }
    let both = match world.ours.outcome() {
        Some(Outcome::Committed) => world.px4.has(&other_key()),
        Some(Outcome::RolledBack) => world.px4.has(&key()),
        _ => false,
    };
    assert!(
        both,
        "{faults:?}: {:?} {:?}",
        world.ours.outcome(),
        world.history
    );
    let current = world.disk.current.as_ref().expect("a key in force");
    assert!(world.px4.has(current), "{faults:?}");
}

/// The datagrams and ticks at which anything can matter, from the end of the watch on.
fn window(current: Option<&SigningKey>) -> (std::ops::Range<usize>, std::ops::Range<u64>) {
    let mut world = World::new(current.map(SigningKey::duplicate));
    while world.ours.state() == State::Staged && world.secrets == 0 {
        world.step();
    }
    let (datagrams, tick) = (world.datagrams, world.tick);
    world.settle(30);
    (
        datagrams.saturating_sub(4)..world.datagrams + 12,
        tick.saturating_sub(2)..world.tick + 40,
    )
}

fn single_faults(current: Option<&SigningKey>) -> Vec<Fault> {
    let (datagrams, ticks) = window(current);
    let mut faults: Vec<_> = datagrams.map(Fault::Lost).collect();
    for tick in ticks {
        faults.extend([
            Fault::VehicleRestarts(tick),
            Fault::VehicleEmptied(tick),
            Fault::VehicleForgets(tick),
            Fault::Killed(tick),
            Fault::Cut(tick),
            Fault::Full(tick),
        ]);
    }
    faults
}

#[test]
fn no_single_fault_leaves_a_link_that_needs_a_person() {
    for current in [None, Some(key())] {
        for fault in single_faults(current.as_ref()) {
            must_come_back(current.as_ref(), &[fault]);
        }
    }
}

/// Every pair of faults, from no key or from another one.
fn no_pair_of_faults(current: Option<&SigningKey>) {
    let faults = single_faults(current);
    let mut pairs = 0;
    for (n, first) in faults.iter().enumerate() {
        for second in &faults[n + 1..] {
            must_come_back(current, &[*first, *second]);
            pairs += 1;
        }
    }
    assert!(pairs > 30_000, "only {pairs} pairs");
}

#[test]
fn no_pair_of_faults_with_a_first_key_leaves_a_link_that_needs_a_person() {
    no_pair_of_faults(None);
}

#[test]
fn no_pair_of_faults_with_another_key_leaves_a_link_that_needs_a_person() {
    no_pair_of_faults(Some(&key()));
}

/// On a link that listens, what is sent arrives only where it was sent to.
impl World {
    fn listening(may_send_key: bool) -> Self {
        let mut world = Self::new(Some(key()));
        let ceiling = Stamp::from_unix(at(0).wall);
        world.disk.ceilings.insert(key().id(), ceiling);
        let (now, disk) = (world.now, &mut world.disk);
        let old = KeyState::start(key(), Origin::KeyFile, BUILD, now, disk).unwrap();
        let listens = HandoverConfig {
            link: LinkConfig::new(1, Security::Signed, Endpoint::Listen),
            may_send_key,
            ..config()
        };
        world.ours = Handover::start(listens, Some(old), other_key(), now, disk).unwrap();
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
        let mut out = [0; MAX_FRAME];
        let mut told = None;
        while let Some(sent) = self.ours.poll_transmit(self.now, &mut self.disk, &mut out) {
            told = sent.secret.then_some(sent.to).or(told);
            if sent.to == VEHICLE && vehicle_is_on {
                self.px4.receive(&out[..sent.len]);
            }
        }
        told
    }
}

#[test]
fn unsigned_datagrams_of_a_stranger_end_no_search_for_the_key() {
    let mut world = World::listening(false);
    let mut stranger = Px4::new(None);
    for _ in 0..200 {
        for message in [support::ack(), stranger.heartbeat()] {
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
    assert!(world.ours.vehicle_is_open(world.now.mono), "and it is told");
}

#[test]
fn a_replay_from_elsewhere_keeps_no_fallen_vehicle_down() {
    for replayed in [false, true] {
        let mut world = World::listening(false);
        let recorded = Px4::new(Some(key())).send(&support::ack());
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
fn a_rotation_sends_no_key_to_who_has_proved_nothing() {
    let mut world = World::listening(true);
    let mut stranger = Px4::new(None);
    for _ in 0..200 {
        for message in [support::ack(), stranger.heartbeat()] {
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
        let listens = HandoverConfig {
            link: LinkConfig::new(1, Security::Signed, Endpoint::Listen),
            ..config()
        };
        Handover::start(listens, None, other_key(), world.now, &mut world.disk).unwrap()
    };
    let mut stranger = Px4::new(None);
    for _ in 0..200 {
        let frame = stranger.send(&support::ack());
        let (now, disk) = (world.now, &mut world.disk);
        world.ours.handle_datagram(now, STRANGER, &frame, disk);
        assert_eq!(world.step_by_address(true), None);
    }
    assert_eq!(world.ours.outcome(), Some(Outcome::SeveralAutopilots));
}

#[test]
fn a_dragged_clock_and_a_lost_datagram_are_mended_over_a_restart_too() {
    for killed_at in [None, Some(50), Some(600)] {
        let mut world = World::new(Some(key()));
        world.px4.clock = Stamp::from_unix(at(0).wall + Duration::from_secs(86_400));
        let mut out = [0; MAX_FRAME];
        let mut sent_keys = 0;
        for tick in 0..3_000 {
            if killed_at == Some(tick) {
                world.kill();
            }
            world.tick += 1;
            world.now = world.now.after(ms(100));
            for frame in world.px4.speak(world.tick) {
                let (now, disk) = (world.now, &mut world.disk);
                world.ours.handle_datagram(now, VEHICLE, &frame, disk);
            }
            world.ours.handle_timeout(world.now);
            while let Some(sent) = world
                .ours
                .poll_transmit(world.now, &mut world.disk, &mut out)
            {
                sent_keys += usize::from(sent.secret);
                let lost = sent.secret && sent_keys == 1;
                if sent.secret && !lost {
                    // PX4 sets its clock to the key's first stamp, whatever it was before.
                    world.px4.clock = Stamp::new(1);
                }
                if !lost {
                    world.px4.receive(&out[..sent.len]);
                }
            }
            while let Some(event) = world.ours.poll_event() {
                assert_ne!(event, Event::Ended(Outcome::RolledBack));
                if event == Event::Commit {
                    world.disk.commit();
                }
            }
        }
        let state = world.ours.state();
        let end = world.ours.outcome();
        assert_eq!(
            end,
            Some(Outcome::Committed),
            "{killed_at:?}: {state:?}, {sent_keys}"
        );
    }
}

#[test]
fn a_wall_clock_ten_years_ahead_is_not_believed_by_way_of_a_new_key() {
    let mut world = World::new(Some(key()));
    let ceiling = Stamp::from_unix(at(0).wall);
    world.disk.ceilings.insert(key().id(), ceiling);
    world.now.wall += Duration::from_secs(3_652 * 86_400);
    world.ours = start(&mut world.disk, world.now);
    assert_eq!(world.settle(30), Some(Outcome::Committed));
    for id in [key().id(), other_key().id()] {
        let ahead = world.disk.ceilings[&id].since(ceiling);
        assert!(ahead < Duration::from_secs(120), "{ahead:?}");
    }
}
