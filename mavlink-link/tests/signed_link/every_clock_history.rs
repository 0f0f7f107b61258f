//! Every history of the signing clock up to a length: frames sent and received, time that passes, wall clocks that step
//! by ten years, disks that are full or late, kills, from clocks that begin anywhere in the 48 bits. No stamp is used
//! twice, none falls, none is beyond the ceiling on disk, and the ceiling on disk never falls.
//!
//! Longer histories: `cargo test --release -p mavlink-link --test signed_link every_clock_history -- --ignored`.

use core::time::Duration;

use mavlink_link::Now;
use mavlink_link::clock::{Ceiling, Origin, SigningClock};
use mavlink_link::signing::{KeyId, Stamp};
use mavlink_link::store::{MemoryDisk, Store as _};

/// What may happen next.
#[derive(Debug, Clone, Copy)]
enum Step {
    Send,
    /// A verified frame of a peer whose clock is so many units of 10 us ahead.
    Receive(u64),
    /// A challenge answered by a peer who is 100 days ahead.
    Meet,
    /// A stamp that was used under another key of the link.
    Carry,
    Pass(Duration),
    /// The wall clock is set, s forward or back.
    SetWall(i64),
    /// The disk takes nothing, or takes it again.
    Fill,
    /// What a disk that queues has been given becomes durable.
    Complete,
    Kill,
}

const STEPS: [Step; 12] = [
    Step::Send,
    Step::Receive(1),
    Step::Receive(359_000_000),
    Step::Receive(361_000_000),
    Step::Meet,
    Step::Carry,
    Step::Pass(Duration::from_millis(7)),
    Step::Pass(Duration::from_secs(11)),
    Step::SetWall(315_360_000),
    Step::SetWall(-315_360_000),
    Step::Fill,
    Step::Kill,
];

#[derive(Clone)]
struct World {
    disk: MemoryDisk,
    now: Now,
    /// The last stamp that was sent.
    sent: Option<u64>,
    /// The highest that was sent or accepted.
    used: u64,
    ceiling: u64,
}

const KEY: KeyId = KeyId::from_bytes([7; 8]);

impl World {
    fn start(&self) -> SigningClock {
        let stored = self.disk.load::<Ceiling>(&KEY).expect("it is readable");
        let stored = stored.map(|Ceiling(stamp)| stamp);
        let clock = SigningClock::start(KEY, Origin::KeyFile, stored, BUILT, self.now);
        assert!(
            clock.floor().get() >= self.used,
            "what was used before the restart would be accepted again"
        );
        clock
    }

    /// Does a step; the clock after it.
    fn step(&mut self, clock: &mut SigningClock, step: Step) {
        let ahead =
            |units: u64| Stamp::new((clock.base(self.now).get() + units).min(Stamp::MAX.get()));
        match step {
            Step::Send => {
                if let Ok(stamp) = clock.take(self.now, &mut self.disk) {
                    assert!(
                        self.sent.is_none_or(|sent| stamp.get() > sent) && stamp.get() > self.used,
                        "{stamp:?} after {:?}, {}",
                        self.sent,
                        self.used
                    );
                    self.sent = Some(stamp.get());
                    self.note_used(stamp);
                }
            }
            Step::Receive(units) => {
                let stamp = ahead(units);
                if clock.allows(stamp, self.now)
                    && clock.follow(stamp, self.now, &mut self.disk).is_ok()
                {
                    self.note_used(stamp);
                }
            }
            Step::Meet => {
                let stamp = ahead(864_000_000_000);
                if clock.meet(stamp, self.now, &mut self.disk).is_ok() {
                    self.note_used(stamp);
                }
            }
            Step::Carry => {
                let stamp = ahead(100_000);
                if clock.carry(stamp, self.now, &mut self.disk).is_ok() {
                    self.note_used(stamp);
                }
            }
            Step::Pass(span) => self.now = self.now.after(span),
            Step::SetWall(seconds) => {
                let by = Duration::from_secs(seconds.unsigned_abs());
                self.now.wall = if seconds > 0 {
                    self.now.wall + by
                } else {
                    self.now.wall.saturating_sub(by)
                };
                clock.watch_wall(self.now);
            }
            Step::Fill => {
                self.disk.full = match self.disk.full {
                    None => Some("clock"),
                    Some(_) => None,
                }
            }
            Step::Complete => self.disk.complete(self.disk.queued),
            Step::Kill => {
                self.disk.kill();
                *clock = self.start();
            }
        }
        // What is durable: not what a disk that queues still has to write.
        let bytes = self.disk.records.get(&format!("clock-{KEY}"));
        let durable = bytes.map_or(0, |bytes| {
            let text = String::from_utf8_lossy(bytes);
            text.trim().parse::<u64>().expect("a number")
        });
        assert!(durable >= self.ceiling, "the ceiling on disk fell");
        assert!(self.used <= durable, "{} is beyond {durable}", self.used);
        self.ceiling = durable;
    }

    fn note_used(&mut self, stamp: Stamp) {
        self.used = self.used.max(stamp.get());
    }
}

/// Every history of `length` steps; how many there were.
fn every_history(steps: &[Step], length: u32, queues: bool, stored: Option<u64>) -> usize {
    let disk = MemoryDisk {
        queues,
        ..MemoryDisk::default()
    };
    let mut begin = World {
        disk,
        now: Now {
            mono: Duration::from_secs(5),
            wall: Stamp::new(WALL).to_unix(),
        },
        sent: None,
        used: 0,
        ceiling: 0,
    };
    if let Some(stored) = stored {
        let name = format!("clock-{KEY}");
        begin
            .disk
            .records
            .insert(name, format!("{stored}\n").into());
        (begin.used, begin.ceiling) = (stored, stored);
    }
    let all = steps.len().pow(length);
    for number in 0..all {
        let mut world = begin.clone();
        let mut clock = world.start();
        let mut rest = number;
        for _ in 0..length {
            let step = steps[rest % steps.len()];
            rest /= steps.len();
            world.step(&mut clock, step);
        }
    }
    all
}

fn all_beginnings(length: u32) -> usize {
    let mut with_queue = STEPS.to_vec();
    with_queue.push(Step::Complete);
    // Nothing stored, a usual ceiling, one ahead of the wall clock by more than a year, and the last of the 48 bits.
    let last = Stamp::MAX.get();
    let stored = [
        None,
        Some(WALL - 1_000),
        Some(2 * WALL),
        Some(last - 500_000),
        Some(last),
    ];
    stored
        .into_iter()
        .map(|stored| {
            every_history(&STEPS, length, false, stored)
                + every_history(&with_queue, length, true, stored)
        })
        .sum()
}

#[test]
fn in_no_short_history_does_a_clock_repeat_or_fall() {
    assert_eq!(all_beginnings(4), 246_485);
}

#[test]
#[ignore = "minutes in a release build"]
fn in_no_longer_history_does_a_clock_repeat_or_fall() {
    all_beginnings(6);
}

/// The date of the build, and the wall clock at the start, in units of 10 us since 2015.
const BUILT: Stamp = Stamp::new(WALL - 3_000_000_000_000);
const WALL: u64 = 37_000_000_000_000;
