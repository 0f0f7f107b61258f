//! Logs that are read back, and stations over years of their clocks: at random, with losses, replays and restarts.

use mavlink_link::store::MemoryDisk;
use zeroize::Zeroizing;

use super::*;

fn seen(number: u8, answer: Option<AckType>) -> Seen {
    Seen {
        digest: Digest([number; 16]),
        stamp: TimeStamp(7_000 + u64::from(number)),
        message_type: 2016,
        destination: Id(0x1b00_0101),
        ack_requested: number % 2 == 1,
        mode: 21,
        answer,
        question: false,
        accepted: true,
        came: None,
    }
}

const STATION: Id = Id(0x1b00_00a0);

fn line(seen: &Seen) -> String {
    let mut line = String::new();
    write_line(&mut line, seen);
    line
}

fn read(bytes: &[u8]) -> Remembered {
    let mut remembered = Remembered::default();
    remembered.read_log(bytes);
    remembered
}

#[test]
fn a_log_reads_back_with_the_latest_answers_and_without_a_torn_line() {
    let (one, two) = (seen(1, None), seen(2, None));
    let answered = seen(1, Some(AckType::CarriedOut));
    let mut bytes = [one, two, answered].iter().map(line).collect::<String>();
    bytes.push_str(&line(&seen(3, None))[..50]);
    let known = read(bytes.as_bytes());
    assert_eq!(known.recent.commands, [answered, two]);
    assert_eq!(known.used, UsedStamps::default());
}

#[test]
fn of_what_is_no_longer_remembered_the_stamp_stays() {
    let bytes: String = (0..MAX_COMMANDS + 10)
        .map(|n| {
            let mut one = seen(1, None);
            one.digest.0[..8].copy_from_slice(&n.to_be_bytes());
            one.stamp = TimeStamp(1_000_000 * n as u64);
            line(&one)
        })
        .collect();
    let known = read(bytes.as_bytes());
    let commands = &known.recent.commands;
    assert_eq!(commands.len(), MAX_COMMANDS);
    assert_eq!(commands[0].digest.0[..8], 10_usize.to_be_bytes());
    let used = |n: u64| known.used.contains(TimeStamp(1_000_000 * n));
    assert!((0..10).all(used) && !(10..4_000).any(used));
}

/// A disk that makes no log shorter, as one without room beside it.
#[derive(Default)]
struct Longer(MemoryDisk);

impl Disk for Longer {
    fn read(&self, name: &str, most: u64) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError> {
        self.0.read(name, most)
    }

    fn replace(&mut self, name: &str, _: &[u8], _: Durability) -> Result<(), StoreError> {
        Err(StoreError::new(name, "No space left on device"))
    }

    fn append(&mut self, name: &str, bytes: &[u8], of: Durability) -> Result<(), StoreError> {
        self.0.append(name, bytes, of)
    }

    fn rename(&mut self, from: &str, to: &str) -> Result<(), StoreError> {
        self.0.rename(from, to)
    }

    fn remove(&mut self, name: &str) -> Result<(), StoreError> {
        self.0.remove(name)
    }
}

#[test]
fn every_line_is_in_a_log_that_cannot_be_made_shorter() {
    let (mut remembered, mut disk) = (Remembered::default(), Longer::default());
    let count = MAX_LINES + 5;
    for n in 0..count {
        let mut one = seen(1, None);
        one.digest.0[..8].copy_from_slice(&n.to_be_bytes());
        remembered.log(STATION, &one, &mut disk).unwrap();
    }
    let log = String::from_utf8_lossy(&disk.0.records[&log_file(STATION)]).into_owned();
    assert_eq!(log.lines().count(), count);
}

/// A station over years of its clock, recorded by somebody: what it sends, when it arrives, what is lost, replayed and
/// repeated, its clock and the restarts of the VSM are drawn at random.
struct History {
    random: kit::Random,
    remembered: Remembered,
    disk: MemoryDisk,
    now: Duration,
    /// Of this run of the VSM.
    started: Duration,
    /// The station's clock beside `now`, ms.
    clock_ms: u64,
    last_stamp: u64,
    recorded: Vec<Seen>,
    /// How often each was carried out.
    carried_out: HashMap<[u8; 16], u32>,
}

impl History {
    fn new(seed: u64) -> History {
        History {
            random: kit::Random::with_seed(seed),
            remembered: Remembered::default(),
            disk: MemoryDisk::default(),
            now: Duration::ZERO,
            started: Duration::ZERO,
            clock_ms: 850_000_000_000,
            last_stamp: 0,
            recorded: Vec::new(),
            carried_out: HashMap::new(),
        }
    }

    fn stamp(&self) -> TimeStamp {
        let now = u64::try_from(self.now.as_millis()).unwrap();
        TimeStamp((self.clock_ms + now) % TimeStamp::PERIOD_MS)
    }

    fn make(&mut self, message_type: u16) -> Seen {
        let mut digest = [0; 16];
        digest[..8].copy_from_slice(&(self.recorded.len() as u64).to_be_bytes());
        let mut stamp = self.stamp();
        if stamp.0 == self.last_stamp {
            // Stamps rise strictly while the clock does not step.
            stamp.0 += 1;
        }
        self.last_stamp = stamp.0;
        let new = Seen {
            digest: Digest(digest),
            stamp,
            message_type,
            destination: Id(0x1b00_0101),
            ack_requested: true,
            mode: 0,
            answer: None,
            question: false,
            accepted: false,
            came: None,
        };
        self.recorded.push(new);
        new
    }

    fn arrives(&mut self, mut seen: Seen) -> Verdict {
        let now = self.now - self.started;
        seen.came = Some((now, None));
        let commands = seen.commands() || seen.message_type == STICKS;
        let verdict = self.remembered.judge(&seen, commands, now);
        if commands && verdict == Verdict::New {
            let (kind, stamp) = (seen.message_type, seen.stamp);
            let disk = &mut self.disk;
            self.remembered
                .accept(STATION, kind, stamp, true, now, disk);
            let times = self.carried_out.entry(seen.digest.0).or_default();
            *times += 1;
            assert_eq!(*times, 1, "{seen:?} is carried out again");
            let answer =
                [AckType::Received, AckType::CarriedOut, AckType::Refused][self.random.usize(0..3)];
            self.remembered
                .answered(STATION, kind, stamp, answer, &mut self.disk);
        }
        verdict
    }

    fn restart(&mut self) {
        self.started = self.now;
        self.remembered = Remembered::default();
        let open = self
            .remembered
            .restore(STATION, Duration::ZERO, &self.disk)
            .unwrap();
        // Answered as cut off, as the router does with what commands a vehicle.
        for seen in open {
            let (kind, stamp) = (seen.message_type, seen.stamp);
            self.remembered
                .answered(STATION, kind, stamp, AckType::Refused, &mut self.disk);
        }
        self.remembered.compact(STATION, &mut self.disk).unwrap();
    }

    fn replay_some(&mut self) {
        for _ in 0..self.random.usize(0..30) {
            let index = self.random.usize(0..self.recorded.len().max(1));
            if let Some(seen) = self.recorded.get(index).copied() {
                // What never arrived may arrive now, once.
                self.arrives(seen);
            }
        }
    }
}

#[test]
fn no_command_is_carried_out_twice_in_any_history() {
    for seed in 0..5 {
        let mut history = History::new(seed);
        for _ in 0..3_000 {
            let step = Duration::from_millis(history.random.u64(1..4_000));
            history.now += step;
            let draw = history.random.u16(0..1_000);
            match draw {
                0..3 => history.restart(),
                3..6 => {
                    // Years, hours or seconds, either way; or a clock that begins again.
                    let far = [1 << 38, 90_000_000, 5_000][history.random.usize(0..3)];
                    let by = history.random.u64(0..far);
                    history.clock_ms = match history.random.u8(0..3) {
                        0 => history.clock_ms + by,
                        1 => history.clock_ms.saturating_sub(by),
                        _ => 0,
                    };
                }
                6..9 => {
                    for _ in 0..1_200 {
                        history.now += Duration::from_millis(20);
                        let seen = history.make(13_002);
                        history.arrives(seen);
                    }
                }
                9..60 => history.replay_some(),
                60..400 => {
                    let seen = history.make(STICKS);
                    history.arrives(seen);
                }
                400..500 => {
                    // Recorded, and never delivered.
                    history.make(2016);
                }
                500..700 => {
                    let seen = history.make(2016);
                    history.arrives(seen);
                }
                _ => {
                    let seen = history.make(16_002);
                    history.arrives(seen);
                }
            }
        }
    }
}

#[test]
fn a_station_with_a_steady_clock_is_never_refused_over_a_bad_network() {
    let mut history = History::new(1);
    let mut under_way: Vec<(Duration, Seen)> = Vec::new();
    for n in 0..12_000_u64 {
        history.now += Duration::from_millis(25);
        if n % 5_000 == 4_999 {
            history.restart();
        }
        // Heartbeats, commands of which many arrive only when they are repeated, up to 40 s later.
        let kind = if n % 40 == 0 { 16_002 } else { 2016 };
        let seen = history.make(kind);
        let first = history.now + Duration::from_millis(history.random.u64(0..1_500));
        let retries = history.random.u64(0..40) * history.random.u64(0..2);
        under_way.push((first + Duration::from_secs(retries), seen));
        let now = history.now;
        while let Some(index) = under_way.iter().position(|(at, _)| *at <= now) {
            let (_, seen) = under_way.swap_remove(index);
            assert_eq!(history.arrives(seen), Verdict::New, "{n}");
            assert!(matches!(history.arrives(seen), Verdict::Again(_)), "{n}");
        }
    }
}

#[test]
fn after_any_step_of_its_clock_a_station_commands_again_in_seconds() {
    for seed in 0..100 {
        let mut history = History::new(seed);
        for _ in 0..4 {
            for second in 0..90 {
                history.now += Duration::from_secs(1);
                let beat = history.make(16_002);
                history.arrives(beat);
                let command = history.make(2016);
                let verdict = history.arrives(command);
                if second >= 6 {
                    assert_eq!(verdict, Verdict::New, "{seed}, {second} s after the step");
                }
            }
            let far = [1 << 38, 90_000_000, 300_000][history.random.usize(0..3)];
            let by = history.random.u64(0..far);
            history.clock_ms = match history.random.bool() {
                true => history.clock_ms + by,
                false => history.clock_ms.saturating_sub(by),
            };
        }
    }
}
