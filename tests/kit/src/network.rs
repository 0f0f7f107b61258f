//! A simulated network under virtual time: packets are lost, duplicated, delayed, reordered and damaged, by a seed.
//!
//! It carries whatever a test sends: datagrams (`Vec<u8>`, by [`Network::send`], which can be damaged too) or messages of
//! any other type (by [`Network::send_intact`]). The addresses are the test's own as well: `SocketAddr`, a number, an
//! enum of two ends.

use std::collections::BTreeMap;
use std::time::Duration;

use crate::Random;

/// How bad a network is. Rates are probabilities, 0 to 1, for each packet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Faults {
    /// Probability that a packet is lost.
    pub loss: f64,
    /// Probability that it is delivered twice.
    pub duplicate: f64,
    /// Probability that it is held back for [`HELD_BACK`] or the longest delay, so that later packets overtake it.
    pub reorder: f64,
    /// Probability that one bit is inverted.
    pub flip: f64,
    /// Probability that its end is cut off.
    pub truncate: f64,
    /// Travel time: shortest and longest.
    pub delay: (Duration, Duration),
    /// Whether the spread of `delay` alone lets packets overtake each other, as on a mesh of paths. On a single queue,
    /// such as a radio link, a late packet also delays those behind it.
    pub overtaking: bool,
    /// Bytes a second that a line carries each way, one datagram after the other; what would wait longer than
    /// [`LINE_HOLDS`] is lost. `None`: no limit.
    /// `None`: any number at once.
    pub bytes_s: Option<f64>,
}

impl Faults {
    /// A good link: everything arrives after 2 ms.
    pub const NONE: Faults = Faults {
        loss: 0.0,
        duplicate: 0.0,
        reorder: 0.0,
        flip: 0.0,
        truncate: 0.0,
        delay: (Duration::from_millis(2), Duration::from_millis(2)),
        overtaking: false,
        bytes_s: None,
    };

    /// A link that loses this part of its packets, and duplicates, reorders, damages and delays some of the others.
    pub fn lossy(loss: f64) -> Faults {
        Faults {
            loss,
            duplicate: loss / 2.0,
            reorder: loss / 2.0,
            flip: loss / 20.0,
            truncate: loss / 20.0,
            ..Faults::NONE.delayed_ms(2, 60)
        }
    }

    /// A link that loses a tenth of its packets and delivers the others up to `max_s` seconds late.
    pub fn late(max_s: f64) -> Faults {
        Faults {
            delay: (Duration::from_millis(2), Duration::from_secs_f64(max_s)),
            ..Faults::lossy(0.1)
        }
    }

    /// The same with another travel time, in milliseconds.
    pub const fn delayed_ms(self, shortest: u64, longest: u64) -> Faults {
        Faults {
            delay: (
                Duration::from_millis(shortest),
                Duration::from_millis(longest),
            ),
            ..self
        }
    }
}

/// A datagram that a line has carried (`Faults::bytes_s`).
#[derive(Debug, Clone, Copy)]
pub struct Carried<A> {
    /// Its destination.
    pub to: A,
    /// Its bytes.
    pub bytes: usize,
    /// When it was sent, and when the line began to carry it.
    pub waited: (Duration, Duration),
}

/// A packet on its way.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Packet<A, T> {
    /// Its sender.
    pub from: A,
    /// Its destination.
    pub to: A,
    /// Its content.
    pub payload: T,
}

/// Both directions of a network.
#[derive(Debug, Clone)]
pub struct Network<A, T> {
    /// How bad it is from now on; packets on their way keep the faults they were given.
    pub faults: Faults,
    random: Random,
    in_flight: BTreeMap<(Duration, u64), Packet<A, T>>,
    /// The datagrams carried while a line has a rate, in the order of sending.
    pub carried: Vec<Carried<A>>,
    /// When the line to each end is free.
    free_at: BTreeMap<A, Duration>,
    /// When the last packet to each end arrives.
    last_arrival: BTreeMap<A, Duration>,
    /// Number of packets sent: of those that arrive at the same time the first sent arrives first.
    sent: u64,
    lost: u64,
}

impl<A: Copy + Ord, T: Clone> Network<A, T> {
    /// A network whose faults are drawn from this seed.
    pub fn new(seed: u64, faults: Faults) -> Self {
        Network {
            faults,
            random: Random::with_seed(seed),
            in_flight: BTreeMap::new(),
            carried: Vec::new(),
            free_at: BTreeMap::new(),
            last_arrival: BTreeMap::new(),
            sent: 0,
            lost: 0,
        }
    }

    /// Sends a packet that cannot be damaged: it is lost, duplicated, delayed or reordered.
    pub fn send_intact(&mut self, now: Duration, from: A, to: A, payload: T) {
        self.put(now, Packet { from, to, payload }, 0, |_, _, _| {});
    }

    fn put(
        &mut self,
        now: Duration,
        packet: Packet<A, T>,
        bytes: usize,
        damage: impl Fn(&Faults, &mut Random, &mut T),
    ) {
        let faults = self.faults;
        let Some(now) = self.carry(now, packet.to, bytes) else {
            self.lost += 1;
            return;
        };
        let copies = if happens(&mut self.random, faults.duplicate) {
            2
        } else {
            1
        };
        for _ in 0..copies {
            // Each copy separately: of a duplicated packet one copy may be lost and the other damaged.
            if happens(&mut self.random, faults.loss) {
                self.lost += 1;
                continue;
            }
            let mut copy = packet.clone();
            damage(&faults, &mut self.random, &mut copy.payload);
            let (shortest, longest) = faults.delay;
            let mut due = now + shortest + (longest - shortest).mul_f64(self.random.f64());
            if happens(&mut self.random, faults.reorder) {
                due += longest.max(HELD_BACK);
            } else if !faults.overtaking {
                let last = self.last_arrival.entry(copy.to).or_default();
                due = due.max(*last);
                *last = due;
            }
            self.sent += 1;
            self.in_flight.insert((due, self.sent), copy);
        }
    }

    /// When the packet has left the line; `None` where its buffer is full.
    fn carry(&mut self, now: Duration, to: A, bytes: usize) -> Option<Duration> {
        let Some(bytes_s) = self.faults.bytes_s else {
            return Some(now);
        };
        let free_at = self.free_at.entry(to).or_default();
        let begun = now.max(*free_at);
        if begun > now + LINE_HOLDS {
            return None;
        }
        *free_at = begun + Duration::from_secs_f64(bytes as f64 / bytes_s);
        let left = *free_at;
        self.carried.push(Carried {
            to,
            bytes,
            waited: (now, begun),
        });
        Some(left)
    }

    /// The next packet that has arrived by `now`.
    pub fn receive(&mut self, now: Duration) -> Option<Packet<A, T>> {
        let entry = self.in_flight.first_entry()?;
        (entry.key().0 <= now).then(|| entry.remove())
    }

    /// When the next packet arrives.
    pub fn next_arrival(&self) -> Option<Duration> {
        self.in_flight.keys().next().map(|(at, _)| *at)
    }

    /// The packets on their way, in the order of their arrival.
    pub fn in_flight(&self) -> impl Iterator<Item = &Packet<A, T>> {
        self.in_flight.values()
    }

    /// How many packets were lost so far; each copy of a duplicated packet counts.
    pub fn lost(&self) -> u64 {
        self.lost
    }
}

impl<A: Copy + Ord> Network<A, Vec<u8>> {
    /// Sends a datagram, which may also be damaged: a bit inverted, or its end cut off.
    pub fn send(&mut self, now: Duration, from: A, to: A, payload: Vec<u8>) {
        let bytes = payload.len();
        self.put(
            now,
            Packet { from, to, payload },
            bytes,
            |faults, random, bytes| {
                if happens(random, faults.flip) && !bytes.is_empty() {
                    let bit = random.usize(..bytes.len() * 8);
                    bytes[bit / 8] ^= 1 << (bit % 8);
                }
                if happens(random, faults.truncate) {
                    bytes.truncate(random.usize(..bytes.len().max(1)));
                }
            },
        );
    }
}

/// Draws a number only where the fault is on, so that a fault that is off does not change the history of the others.
fn happens(random: &mut Random, probability: f64) -> bool {
    probability > 0.0 && random.f64() < probability
}

/// How long a datagram may wait in front of a line: more than a serial driver's buffer holds, less than a large
/// modem's.
pub const LINE_HOLDS: Duration = Duration::from_secs(1);

/// The least time by which a reordered packet is late: longer than most tests take between two packets.
pub const HELD_BACK: Duration = Duration::from_millis(80);

#[cfg(test)]
mod tests {
    use super::*;

    const LATER: Duration = Duration::from_secs(60);

    fn arrivals(faults: Faults) -> (Vec<u32>, u64) {
        let mut network = Network::new(1, faults);
        for n in 0..1_000_u32 {
            network.send_intact(Duration::from_millis(n.into()), 'a', 'b', n);
        }
        let arrived = std::iter::from_fn(|| network.receive(LATER)).map(|packet| packet.payload);
        let arrived = arrived.collect();
        (arrived, network.lost())
    }

    #[test]
    fn a_good_link_delivers_everything_once_and_in_order() {
        let (arrived, lost) = arrivals(Faults::NONE);
        assert_eq!(arrived, (0..1_000).collect::<Vec<_>>());
        assert_eq!(lost, 0);
    }

    #[test]
    fn each_fault_occurs_at_its_rate() {
        let tenth = 50..=200;
        let (arrived, lost) = arrivals(Faults {
            loss: 0.1,
            ..Faults::NONE
        });
        assert!(
            tenth.contains(&lost) && arrived.len() as u64 + lost == 1_000,
            "{lost}"
        );
        let (arrived, _) = arrivals(Faults {
            duplicate: 0.1,
            ..Faults::NONE
        });
        assert!(
            tenth.contains(&(arrived.len() as u64 - 1_000)),
            "{}",
            arrived.len()
        );
        let (arrived, _) = arrivals(Faults {
            reorder: 0.1,
            ..Faults::NONE
        });
        let late = arrived.windows(2).filter(|pair| pair[1] < pair[0]).count() as u64;
        assert!(tenth.contains(&late), "{late}");
    }

    #[test]
    fn delay_alone_reorders_only_where_overtaking_is_possible() {
        let queue = Faults::NONE.delayed_ms(2, 60);
        assert!(arrivals(queue).0.is_sorted());
        let mesh = Faults {
            overtaking: true,
            ..queue
        };
        assert!(!arrivals(mesh).0.is_sorted());
    }

    #[test]
    fn damage_inverts_one_bit_or_cuts_the_end_off() {
        let faults = Faults {
            flip: 0.5,
            truncate: 0.5,
            ..Faults::NONE
        };
        let mut network = Network::new(3, faults);
        for _ in 0..100 {
            network.send(Duration::ZERO, 0, 1, vec![0; 40]);
        }
        let arrived: Vec<_> = std::iter::from_fn(|| network.receive(LATER))
            .map(|p| p.payload)
            .collect();
        assert!(arrived.iter().any(|bytes| bytes.len() < 40));
        let set = |bytes: &Vec<u8>| bytes.iter().map(|byte| byte.count_ones()).sum::<u32>();
        assert!(
            arrived
                .iter()
                .any(|bytes| bytes.len() == 40 && set(bytes) == 1)
        );
        assert!(arrived.iter().all(|bytes| set(bytes) <= 1));
    }

    #[test]
    fn the_same_seed_gives_the_same_history() {
        assert_eq!(arrivals(Faults::lossy(0.3)), arrivals(Faults::lossy(0.3)));
    }
}
