//! A link between two ends under virtual time: packets are lost, doubled, held up, overtaken, cut and bent by a seed.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::time::Duration;

/// How bad a link is. Every figure is a probability of 0 to 1 for each packet, unless it says otherwise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Faults {
    /// Lost.
    pub loss: f64,
    /// Delivered twice.
    pub duplicate: f64,
    /// Held back so long that later packets overtake it.
    pub reorder: f64,
    /// One bit is another.
    pub flip: f64,
    /// Its end is cut off.
    pub truncate: f64,
    /// Travel time of a packet that nothing befalls: shortest and longest.
    pub delay: (Duration, Duration),
}

impl Faults {
    /// A good link: 2 ms.
    pub const NONE: Faults = Faults {
        loss: 0.0,
        duplicate: 0.0,
        reorder: 0.0,
        flip: 0.0,
        truncate: 0.0,
        delay: (Duration::from_millis(2), Duration::from_millis(2)),
    };

    /// A link that loses this part of its packets, and doubles, overtakes and delays some of the others.
    pub fn lossy(loss: f64) -> Faults {
        Faults {
            loss,
            duplicate: loss / 2.0,
            reorder: loss / 2.0,
            flip: loss / 20.0,
            truncate: loss / 20.0,
            delay: (Duration::from_millis(2), Duration::from_millis(60)),
        }
    }

    /// A link that loses a tenth of its packets and delivers the others up to `most_s` seconds late.
    pub fn late(most_s: f64) -> Faults {
        Faults {
            delay: (Duration::from_millis(2), Duration::from_secs_f64(most_s)),
            ..Faults::lossy(0.1)
        }
    }
}

/// A packet on its way.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Packet {
    pub from: SocketAddr,
    pub to: SocketAddr,
    pub bytes: Vec<u8>,
}

/// Both directions of a link.
#[derive(Debug)]
pub struct Wire {
    pub faults: Faults,
    random: Random,
    under_way: BTreeMap<(Duration, u64), Packet>,
    /// When the last packet to each end arrives: a delay alone does not let packets overtake each other.
    in_order: BTreeMap<SocketAddr, Duration>,
    count: u64,
}

impl Wire {
    pub fn new(seed: u64, faults: Faults) -> Wire {
        Wire {
            faults,
            random: Random(seed),
            under_way: BTreeMap::new(),
            in_order: BTreeMap::new(),
            count: 0,
        }
    }

    /// Puts a packet on its way.
    pub fn send(&mut self, now: Duration, from: SocketAddr, to: SocketAddr, bytes: &[u8]) {
        let Faults {
            loss,
            duplicate,
            reorder,
            flip,
            truncate,
            delay,
        } = self.faults;
        let copies = if self.random.happens(duplicate) { 2 } else { 1 };
        for _ in 0..copies {
            if self.random.happens(loss) {
                continue;
            }
            let mut bytes = bytes.to_vec();
            if self.random.happens(flip) && !bytes.is_empty() {
                let at = self.random.below(bytes.len() as u64 * 8) as usize;
                bytes[at / 8] ^= 1 << (at % 8);
            }
            if self.random.happens(truncate) {
                let left = self.random.below(bytes.len() as u64) as usize;
                bytes.truncate(left);
            }
            let spread = (delay.1 - delay.0).mul_f64(self.random.unit());
            let mut due = now + delay.0 + spread;
            if self.random.happens(reorder) {
                due += delay.1.max(HELD_BACK);
            } else {
                let last = self.in_order.entry(to).or_default();
                due = due.max(*last);
                *last = due;
            }
            self.count += 1;
            let packet = Packet { from, to, bytes };
            self.under_way.insert((due, self.count), packet);
        }
    }

    /// The next packet that has arrived.
    pub fn receive(&mut self, now: Duration) -> Option<Packet> {
        let entry = self.under_way.first_entry()?;
        (entry.key().0 <= now).then(|| entry.remove())
    }
}

/// SplitMix64: a seed and nothing else.
#[derive(Debug, Clone)]
pub struct Random(pub u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn happens(&mut self, probability: f64) -> bool {
        probability > 0.0 && self.unit() < probability
    }

    fn below(&mut self, bound: u64) -> u64 {
        self.next() % bound.max(1)
    }
}

const HELD_BACK: Duration = Duration::from_millis(80);
