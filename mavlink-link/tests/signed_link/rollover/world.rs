//! Our disk, our end and the vehicle's under one clock, and the faults between them.

use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::clock::Origin;
use mavlink_link::frame::{FrameView, MAX_FRAME};
use mavlink_link::link::{Endpoint, LinkConfig, Security};
use mavlink_link::provisioning::{Event, KeyRollover, KeyRolloverConfig, Outcome, State};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::SigningKey;
use mavlink_link::store::MemoryDisk;

use super::px4::Px4;
use crate::support::{BUILD, VEHICLE, at, ms, other_key};

/// Our keys.
#[derive(Default)]
pub(super) struct Keys {
    pub(super) current: Option<SigningKey>,
    pub(super) next: Option<SigningKey>,
    pub(super) previous: Option<SigningKey>,
}

impl Keys {
    pub(super) fn commit(&mut self) {
        if let Some(next) = self.next.take() {
            self.previous = self.current.replace(next);
        }
    }

    pub(super) fn holds(&self, key: &SigningKey) -> bool {
        [&self.current, &self.next, &self.previous]
            .into_iter()
            .flatten()
            .any(|held| held.same_as(key))
    }
}

/// Both ends under one clock, and the faults between them.
pub(super) struct World {
    pub(super) px4: Px4,
    pub(super) keys: Keys,
    pub(super) disk: MemoryDisk,
    pub(super) ours: KeyRollover<u16>,
    pub(super) now: Now,
    pub(super) tick: u64,
    /// Datagrams so far, both ways, to name the one that is lost.
    pub(super) datagrams: usize,
    pub(super) lost: Vec<usize>,
    pub(super) history: Vec<Event>,
    pub(super) secrets: usize,
    /// It arms between its word and our answer.
    pub(super) arms: bool,
    /// All that we send is lost.
    pub(super) mute: bool,
}

pub(super) fn config() -> KeyRolloverConfig<u16> {
    KeyRolloverConfig {
        link: LinkConfig::new(1, Security::Signed, Endpoint::Fixed(VEHICLE)),
        not_before: BUILD,
        may_send_key: true,
        believe_unsigned: false,
    }
}

pub(super) fn start(keys: &Keys, disk: &mut MemoryDisk, now: Now) -> KeyRollover<u16> {
    let old = keys.current.as_ref().map(SigningKey::duplicate);
    let old = old.map(|old| KeyState::start(old, Origin::KeyFile, BUILD, now, disk).unwrap());
    let new = keys.next.as_ref().unwrap().duplicate();
    KeyRollover::start(config(), old, new, now, disk).unwrap()
}

impl World {
    pub(super) fn new(current: Option<SigningKey>) -> Self {
        let keys = Keys {
            current: current.as_ref().map(SigningKey::duplicate),
            next: Some(other_key()),
            ..Keys::default()
        };
        let mut disk = MemoryDisk::default();
        let now = at(0);
        Self {
            px4: Px4::new(current),
            ours: start(&keys, &mut disk, now),
            keys,
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

    pub(super) fn arrives(&mut self) -> bool {
        self.datagrams += 1;
        !self.lost.contains(&self.datagrams)
    }

    /// A tenth of a second.
    pub(super) fn step(&mut self) {
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
                Event::Commit => self.keys.commit(),
                Event::Ended(Outcome::RolledBack) => self.keys.next = None,
                _ => {}
            }
            self.history.push(event);
        }
        // The promise: whatever key the vehicle has, we have it too.
        let file = self.px4.file.as_ref().map(|(key, _)| key);
        for key in self.px4.running.iter().chain(file) {
            assert!(
                self.keys.holds(key),
                "a key of the vehicle is lost: {:?}",
                self.history
            );
        }
    }

    /// Until the key has been sent.
    pub(super) fn until_sent(&mut self) {
        for _ in 0..600 {
            if self.secrets > 0 {
                return;
            }
            self.step();
        }
        panic!("never sent: {:?}", self.history);
    }

    pub(super) fn run(&mut self, seconds: u64) {
        for _ in 0..seconds * 10 {
            self.step();
        }
    }

    /// Until it has ended, or so long.
    pub(super) fn settle(&mut self, seconds: u64) -> Option<Outcome> {
        for _ in 0..seconds * 10 {
            self.step();
            if self.ours.outcome().is_some() {
                break;
            }
        }
        self.ours.outcome()
    }

    /// We are killed and start again with what is on the disk; where nothing is staged, there is
    /// nothing to continue with.
    pub(super) fn kill(&mut self) {
        if self.keys.next.is_some() {
            self.now.mono = Duration::from_secs(1);
            self.ours = start(&self.keys, &mut self.disk, self.now);
        }
    }

    pub(super) fn states(&self) -> Vec<State> {
        self.history
            .iter()
            .filter_map(|event| match event {
                Event::State(state) => Some(*state),
                _ => None,
            })
            .collect()
    }
}
