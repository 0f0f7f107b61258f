//! The encrypted link: both ends, their disks, and a radio that loses, doubles, delays and damages, under a virtual clock.

mod attacks;
mod cost;
mod nonces;
mod passes;

use core::time::Duration;
use std::collections::BTreeMap;

use mavlink_link::Now;
use mavlink_link::encrypted::{
    Carrier, EncryptedConfig, EncryptedLink, EncryptedState, MAX_WIRE, Role,
};
use mavlink_link::exchange::Identity;
use mavlink_link::frame::{FrameView, Header, KEY_EXCHANGE_ID, MAX_FRAME, encode_raw};
use mavlink_link::store::MemoryDisk;

use crate::world::{Dice, HONEST, ms, parties};

/// What the radio does, percent of what is sent.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Radio {
    pub(crate) loss: u64,
    pub(crate) double: u64,
    /// Of each hundred thousand bits.
    pub(crate) flipped: u64,
    pub(crate) latency: Duration,
    /// Up to so much more, at random: datagrams overtake each other.
    pub(crate) jitter: Duration,
}

pub(crate) const GOOD: Radio = Radio {
    loss: 0,
    double: 0,
    flipped: 0,
    latency: Duration::from_millis(20),
    jitter: Duration::ZERO,
};

/// One end: its process, where it runs, and its disk.
pub(crate) struct End {
    pub(crate) role: Role,
    pub(crate) link: Option<EncryptedLink<u8>>,
    pub(crate) disk: MemoryDisk,
    pub(crate) dice: Dice,
    identity: Identity,
    peer: Identity,
    /// The numbers of the frames received, in order.
    pub(crate) got: Vec<u32>,
    /// Where the last packet that was opened is taken to come from.
    pub(crate) sender: Option<u8>,
    /// Where the other end was found, as its shell stores it.
    pub(crate) found: Option<u8>,
}

pub(crate) struct World {
    pub(crate) now: Duration,
    pub(crate) carrier: Carrier,
    /// The end that does not know where the other one is.
    pub(crate) listening: Option<usize>,
    /// Where either end is.
    pub(crate) from: [u8; 2],
    /// Where a copy of each comes from, before it.
    pub(crate) copier: Option<u8>,
    pub(crate) radio: Radio,
    /// Ground and air.
    pub(crate) ends: [End; 2],
    /// Everything that was sent, by whom.
    pub(crate) tape: Vec<(usize, Vec<u8>)>,
    /// What is under way: to which end.
    under_way: BTreeMap<(Duration, u64), (usize, Vec<u8>)>,
    parcels: u64,
    dice: Dice,
    next: u32,
}

pub(crate) const GROUND: usize = 0;
pub(crate) const AIR: usize = 1;

impl World {
    pub(crate) fn new(seed: u64, carrier: Carrier) -> World {
        let mut dice = Dice::new(seed);
        let (ground, air) = (dice.bytes(), dice.bytes());
        let end = |role, own, peer, dice: Dice| End {
            role,
            link: None,
            disk: MemoryDisk::default(),
            dice,
            identity: Identity::new(own),
            peer: Identity::new(peer),
            got: Vec::new(),
            sender: None,
            found: None,
        };
        let ends = [
            end(Role::Ground, ground, air, Dice::new(dice.roll())),
            end(Role::Air, air, ground, Dice::new(dice.roll())),
        ];
        let mut world = World {
            now: Duration::from_secs(5),
            carrier,
            listening: None,
            from: [HONEST; 2],
            copier: None,
            radio: GOOD,
            ends,
            tape: Vec::new(),
            under_way: BTreeMap::new(),
            parcels: 0,
            dice,
            next: 0,
        };
        world.start(AIR);
        world.start(GROUND);
        world
    }

    /// The process of this end is started, or started again: a new one, with what is on its disk.
    pub(crate) fn start(&mut self, at: usize) {
        let (now, carrier) = (self.now, self.carrier);
        let end = &mut self.ends[at];
        end.disk.kill();
        let config = EncryptedConfig {
            role: end.role,
            parties: parties(),
            identity: end.identity.duplicate(),
            peer: Some(end.peer.public()),
            carrier,
            at: (self.listening != Some(at)).then_some(HONEST),
            before: end.found,
            linger: if at == AIR { ms(5) } else { Duration::ZERO },
        };
        end.link = Some(EncryptedLink::open(config, now, &end.disk).unwrap());
    }

    pub(crate) fn clocks(&self) -> Now {
        Now {
            mono: self.now,
            wall: self.now + Duration::from_secs(1_800_000_000),
        }
    }

    pub(crate) fn state(&self, at: usize) -> EncryptedState {
        self.ends[at].link.as_ref().unwrap().state(self.now)
    }

    /// This end sends the next frame; its number.
    pub(crate) fn send(&mut self, from: usize) -> u32 {
        self.next += 1;
        let now = self.now;
        let frame = numbered(self.next);
        let end = &mut self.ends[from];
        if let Some(link) = &mut end.link {
            link.send(now, end.sender.unwrap_or(HONEST), &frame);
        }
        self.transmit(from);
        self.next
    }

    fn transmit(&mut self, from: usize) {
        let mut out = [0; MAX_WIRE];
        loop {
            let end = &mut self.ends[from];
            let Some(link) = &mut end.link else { return };
            let Some((to, len)) = link.poll_transmit(self.now, &mut end.disk, &mut out) else {
                return;
            };
            let bytes = out[..len].to_vec();
            self.tape.push((from, bytes.clone()));
            if to != self.from[1 - from] {
                continue;
            }
            if self.dice.chance(self.radio.loss) {
                continue;
            }
            let copies = 1 + u64::from(self.dice.chance(self.radio.double));
            for _ in 0..copies {
                let mut bytes = bytes.clone();
                for byte in &mut bytes {
                    for bit in 0..8 {
                        *byte ^= u8::from(self.dice.below(100_000) < self.radio.flipped) << bit;
                    }
                }
                let late = self.dice.below(self.radio.jitter.as_millis() as u64 + 1);
                self.post(self.radio.latency + ms(late), 1 - from, bytes);
            }
        }
    }

    /// These bytes arrive at this end after a while.
    pub(crate) fn post(&mut self, after: Duration, to: usize, bytes: Vec<u8>) {
        self.parcels += 1;
        self.under_way
            .insert((self.now + after, self.parcels), (to, bytes));
    }

    /// These bytes arrive now: what came out of them.
    pub(crate) fn arrive(&mut self, at: usize, bytes: &[u8]) -> Vec<u8> {
        self.arrive_from(self.from[1 - at], at, bytes)
    }

    pub(crate) fn arrive_from(&mut self, from: u8, at: usize, bytes: &[u8]) -> Vec<u8> {
        let now = self.clocks();
        let end = &mut self.ends[at];
        let Some(link) = &mut end.link else {
            return Vec::new();
        };
        let mut random = end.dice.fill();
        let inner = link
            .handle(now, from, bytes, &mut random, &mut end.disk)
            .to_vec();
        drop(random);
        end.found = link.found_at().or(end.found);
        if !numbers(&inner).is_empty() {
            end.sender = Some(link.sender(from));
        }
        end.got.extend(numbers(&inner));
        self.transmit(at);
        inner
    }

    /// Runs for so long; each end sends a frame each `every`.
    pub(crate) fn run(&mut self, span: Duration, every: Duration) {
        let end = self.now + span;
        let mut send_at = self.now;
        while self.now < end {
            while let Some(entry) = self.under_way.first_entry()
                && entry.key().0 <= self.now
            {
                let (to, bytes) = entry.remove();
                if let Some(copier) = self.copier {
                    self.arrive_from(copier, to, &bytes);
                }
                self.arrive(to, &bytes);
            }
            for at in [GROUND, AIR] {
                let now = self.clocks();
                let one = &mut self.ends[at];
                if let Some(link) = &mut one.link {
                    link.handle_timeout(now, &mut one.dice.fill(), &mut one.disk);
                }
                self.transmit(at);
            }
            if self.now >= send_at {
                send_at += every;
                self.send(GROUND);
                self.send(AIR);
            }
            // A disk that queues is slow, and done now and then.
            for end in &mut self.ends {
                if end.disk.queues && self.dice.chance(30) {
                    end.disk.complete(end.disk.queued);
                }
            }
            self.now += ms(5);
        }
    }

    /// How long until both ends receive again what is sent from now on, at most `within`.
    pub(crate) fn recovery(&mut self, within: Duration) -> Duration {
        let (begin, first) = (self.now, self.next);
        while self.now < begin + within {
            self.run(ms(20), ms(20));
            let fresh = |end: &End| end.got.last().is_some_and(|&last| last > first);
            if self.ends.iter().all(fresh) {
                return self.now - begin;
            }
        }
        panic!(
            "not within {within:?}: {:?}",
            self.ends
                .each_ref()
                .map(|end| end.link.as_ref().map(|l| l.state(self.now)))
        );
    }

    pub(crate) fn count(&self, at: usize, name: &str) -> u64 {
        let stats = self.ends[at].link.as_ref().unwrap().stats();
        stats.iter().find(|(one, _)| *one == name).unwrap().1
    }

    /// Each frame at most once; at the end only those of the other, as no two frames have one number.
    pub(crate) fn check_once(&self) {
        for end in &self.ends {
            let mut got = end.got.clone();
            got.sort_unstable();
            assert!(got.windows(2).all(|two| two[0] != two[1]), "twice");
        }
        let [ground, air] = self.ends.each_ref().map(|end| &end.got);
        assert!(ground.iter().all(|one| !air.contains(one)), "reflected");
    }

    /// What somebody on the radio can read: MAVLink in the clear, by its message ids.
    pub(crate) fn overheard(&self) -> Vec<u32> {
        let mut found = Vec::new();
        for (_, bytes) in &self.tape {
            for at in 0..bytes.len() {
                if let Ok(frame) = FrameView::parse(&bytes[at..]) {
                    found.push(frame.header().message_id);
                }
            }
        }
        found
    }
}

/// A frame that holds a number.
pub(crate) fn numbered(number: u32) -> Vec<u8> {
    let header = Header {
        system_id: 9,
        component_id: 1,
        message_id: 0,
        ..Header::default()
    };
    let mut payload = [1; 9];
    payload[..4].copy_from_slice(&number.to_le_bytes());
    let mut out = [0; MAX_FRAME];
    let len = encode_raw(header, &payload, &mut out).unwrap();
    out[..len].to_vec()
}

fn numbers(mut bytes: &[u8]) -> Vec<u32> {
    let mut found = Vec::new();
    while !bytes.is_empty() {
        let frame = FrameView::parse(bytes).expect("whole frames only");
        if frame.header().message_id != KEY_EXCHANGE_ID {
            assert_eq!(frame.payload().len(), 9);
            let number = frame.payload()[..4].try_into().unwrap();
            found.push(u32::from_le_bytes(number));
        }
        bytes = &bytes[frame.as_bytes().len()..];
    }
    found
}
