//! The machines themselves, along every history of a small bound: what they take is checked against what was sent.

use std::collections::HashSet;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::signing::SigningKey;
use mavlink_link::store::MemoryDisk;
use stanag_msgs::Id;
use stanag_msgs::guard::{Direction, Guarded, MAX_GUARDED};
use vsm::session::GuardEnd;

const VSM: Id = Id(0x1b00_0001);
const CUCS: Id = Id(0x1b00_00a0);

/// What may happen, of two datagrams of each end at most.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    CucsSends,
    VsmSends,
    /// The so-many-th datagram that was sent reaches an end.
    ToVsm(usize),
    ToCucs(usize),
    VsmRestarts,
    CucsRestarts,
    Rotates,
    CucsHasNewKey,
    Revokes,
}

struct World {
    now: Duration,
    vsm: GuardEnd,
    cucs: GuardEnd,
    disks: [MemoryDisk; 2],
    /// The keys that the VSM takes, the one in force first, and the one of the guard.
    keys: Vec<u8>,
    cucs_key: u8,
    made: u8,
    revoked: HashSet<u8>,
    /// Sender's way, key and bytes.
    sent: Vec<(Direction, u8, Vec<u8>)>,
    /// At which end, and which of the datagrams.
    taken: HashSet<(&'static str, usize)>,
    takes: usize,
}

fn key(number: u8) -> SigningKey {
    SigningKey::new([number + 1; 32]).expect("not all zero")
}

impl World {
    fn new() -> World {
        let mut disks = [MemoryDisk::default(), MemoryDisk::default()];
        let now = clock(Duration::from_secs(1));
        let [of_vsm, of_cucs] = &mut disks;
        let vsm = end((VSM, CUCS), Direction::ToCucs, &[0], now, of_vsm);
        let cucs = end((CUCS, VSM), Direction::ToVsm, &[0], now, of_cucs);
        World {
            now: Duration::from_secs(1),
            vsm,
            cucs,
            disks,
            keys: vec![0],
            cucs_key: 0,
            made: 1,
            revoked: HashSet::new(),
            sent: Vec::new(),
            taken: HashSet::new(),
            takes: 0,
        }
    }

    fn steps(&self) -> Vec<Step> {
        let sent = |way| self.sent.iter().filter(|(one, ..)| *one == way).count();
        let mut all = vec![Step::VsmRestarts, Step::CucsRestarts];
        if sent(Direction::ToVsm) < 2 {
            all.push(Step::CucsSends);
        }
        if sent(Direction::ToCucs) < 1 {
            all.push(Step::VsmSends);
        }
        for place in 0..self.sent.len() {
            all.extend([Step::ToVsm(place), Step::ToCucs(place)]);
        }
        if self.made < 2 {
            all.extend([Step::Rotates, Step::Revokes]);
        }
        if self.cucs_key != self.keys[0] {
            all.push(Step::CucsHasNewKey);
        }
        all
    }

    fn take(&mut self, step: Step) -> Result<(), &'static str> {
        self.now += Duration::from_millis(300);
        let now = clock(self.now);
        let mut out = [0; MAX_GUARDED];
        let [of_vsm, of_cucs] = &mut self.disks;
        match step {
            Step::CucsSends => {
                let sealed = self.cucs.seal(now, b"order", &mut out, of_cucs);
                let sealed = out[..sealed.expect("it has a key")].to_vec();
                self.sent.push((Direction::ToVsm, self.cucs_key, sealed));
            }
            Step::VsmSends => {
                let sealed = self.vsm.seal(now, b"status", &mut out, of_vsm);
                let sealed = out[..sealed.expect("it has a key")].to_vec();
                self.sent.push((Direction::ToCucs, self.keys[0], sealed));
            }
            Step::ToVsm(place) => {
                let (way, key, bytes) = &self.sent[place];
                let guarded = Guarded::parse(bytes).expect("a trailer");
                if self.vsm.open(now, &guarded, of_vsm).is_ok() {
                    self.takes += 1;
                    if *way != Direction::ToVsm {
                        return Err(super::GENUINE);
                    }
                    if self.revoked.contains(key) {
                        return Err(super::REVOKED);
                    }
                    if !self.taken.insert(("VSM", place)) {
                        return Err(super::ONCE);
                    }
                }
            }
            Step::ToCucs(place) => {
                let (way, _, bytes) = &self.sent[place];
                let guarded = Guarded::parse(bytes).expect("a trailer");
                if self.cucs.open(now, &guarded, of_cucs).is_ok() {
                    self.takes += 1;
                    if *way != Direction::ToCucs {
                        return Err(super::GENUINE);
                    }
                    if !self.taken.insert(("guard", place)) {
                        return Err(super::ONCE);
                    }
                }
            }
            Step::VsmRestarts => {
                self.vsm = end((VSM, CUCS), Direction::ToCucs, &self.keys, now, of_vsm);
            }
            Step::CucsRestarts => {
                self.cucs = end(
                    (CUCS, VSM),
                    Direction::ToVsm,
                    &[self.cucs_key],
                    now,
                    of_cucs,
                );
            }
            Step::Rotates => {
                self.keys = vec![self.made, self.keys[0]];
                self.made += 1;
                set(&mut self.vsm, &self.keys, now, of_vsm);
            }
            Step::Revokes => {
                self.revoked.extend(&self.keys);
                self.keys = vec![self.made];
                self.made += 1;
                set(&mut self.vsm, &self.keys, now, of_vsm);
            }
            Step::CucsHasNewKey => {
                self.cucs_key = self.keys[0];
                set(&mut self.cucs, &[self.cucs_key], now, of_cucs);
            }
        }
        Ok(())
    }
}

fn clock(mono: Duration) -> Now {
    Now {
        mono,
        wall: Duration::from_secs(1_800_000_000) + mono,
    }
}

fn numbered(keys: &[u8]) -> Vec<vsm::session::GuardKeyUntil> {
    keys.iter().map(|number| (key(*number), None)).collect()
}

fn end(ids: (Id, Id), sends: Direction, keys: &[u8], now: Now, disk: &mut MemoryDisk) -> GuardEnd {
    GuardEnd::new(ids, sends, numbered(keys), Duration::ZERO, now, disk).expect("a good disk")
}

fn set(end: &mut GuardEnd, keys: &[u8], now: Now, disk: &mut MemoryDisk) {
    end.set_keys(numbered(keys), Duration::ZERO, now, disk)
        .expect("a good disk");
}

/// Plays a history from the start; what may follow it, and how much was taken.
fn play(history: &[Step]) -> (Vec<Step>, usize) {
    let mut world = World::new();
    for step in history {
        if let Err(promise) = world.take(*step) {
            panic!("not so: {promise}, after {history:?}");
        }
    }
    (world.steps(), world.takes)
}

#[test]
fn the_machines_keep_the_promises_along_every_history() {
    let mut due = vec![Vec::new()];
    let (mut histories, mut taken) = (0_usize, 0);
    while let Some(history) = due.pop() {
        let (steps, takes) = play(&history);
        histories += 1;
        taken = taken.max(takes);
        if history.len() < 4 {
            for step in steps {
                let mut longer = history.clone();
                longer.push(step);
                due.push(longer);
            }
        }
    }
    assert!(histories > 1_000, "{histories}");
    assert!(taken >= 2, "{taken}");
}
