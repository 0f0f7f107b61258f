use std::collections::BTreeSet;

use mavlink_link::store::MemoryDisk;

use super::*;

const CUCS: Id = Id(0x1b00_00a0);
const VSM: Id = Id(0x1b00_0001);
const WALL: Duration = Duration::from_secs(1_795_219_200);
const YEAR: i64 = 366 * 86_400;

fn key(byte: u8) -> SigningKey {
    SigningKey::new([byte; 32]).unwrap()
}

/// One computer: its end, its disk, and what it takes for the time.
struct Host {
    ids: (Id, Id),
    sends: Direction,
    keys: Vec<u8>,
    end: GuardEnd,
    disk: MemoryDisk,
    started: Duration,
    /// How far its wall clock is off, s.
    off: i64,
}

impl Host {
    fn new(ids: (Id, Id), sends: Direction, off: i64) -> Host {
        let mut disk = MemoryDisk::default();
        let now = Host::clocks(Duration::ZERO, Duration::ZERO, off);
        let keys = vec![(key(1), None)];
        let end = GuardEnd::new(ids, sends, keys, Duration::ZERO, now, &mut disk).unwrap();
        Host {
            ids,
            sends,
            keys: vec![1],
            end,
            disk,
            started: Duration::ZERO,
            off,
        }
    }

    fn clocks(at: Duration, started: Duration, off: i64) -> Now {
        let wall = (WALL + at).as_micros() as i64 + off * 1_000_000;
        Now {
            mono: at.saturating_sub(started),
            wall: Duration::from_micros(wall.max(0) as u64),
        }
    }

    fn now(&self, at: Duration) -> Now {
        Host::clocks(at, self.started, self.off)
    }

    /// As after `kill -9`.
    fn restart(&mut self, at: Duration) {
        self.started = at;
        let now = self.now(at);
        let keys = self.keys.iter().map(|byte| (key(*byte), None)).collect();
        let end = GuardEnd::new(
            self.ids,
            self.sends,
            keys,
            Duration::ZERO,
            now,
            &mut self.disk,
        );
        self.end = end.unwrap();
    }

    fn seal(&mut self, at: Duration, datagram: &[u8]) -> Vec<u8> {
        let mut out = [0; MAX_GUARDED];
        let now = self.now(at);
        let sealed = self.end.seal(now, datagram, &mut out, &mut self.disk);
        out[..sealed.unwrap()].to_vec()
    }

    fn open(&mut self, at: Duration, bytes: &[u8]) -> Result<Vec<u8>, GuardRefusal> {
        let now = self.now(at);
        let guarded = Guarded::parse(bytes).expect("a trailer");
        let opened = self.end.open(now, &guarded, &mut self.disk);
        opened.map(<[u8]>::to_vec)
    }

    fn lift(&mut self, at: Duration) -> Option<Vec<u8>> {
        let mut out = [0; MAX_GUARDED];
        let now = self.now(at);
        let length = self.end.lift(now, &mut out, &mut self.disk)?;
        Some(out[..length].to_vec())
    }
}

/// The guard of a CUCS, whose clock is off by so many seconds, and a VSM.
fn ends(off: i64) -> (Host, Host) {
    let cucs = Host::new((CUCS, VSM), Direction::ToVsm, off);
    (cucs, Host::new((VSM, CUCS), Direction::ToCucs, 0))
}

/// One datagram from one to the other, by lifting where that is needed; false where it does not get through.
fn passes(from: &mut Host, to: &mut Host, at: Duration) -> bool {
    for n in 0..3 {
        let at = at + n * LIFT_EVERY;
        let sealed = from.seal(at, b"x");
        match to.open(at, &sealed) {
            Ok(inside) => return inside == b"x",
            Err(why) if why.wants_lift() => {
                let lift = to.lift(at).expect("time for it");
                assert!(lift.len() <= sealed.len());
                if let Ok(inside) = from.open(at, &lift) {
                    assert_eq!(inside, b"");
                }
            }
            Err(_) => return false,
        }
    }
    false
}

fn s(seconds: u64) -> Duration {
    Duration::from_secs(seconds)
}

#[test]
fn both_ways_and_nothing_twice() {
    let (mut cucs, mut vsm) = ends(0);
    assert!(passes(&mut cucs, &mut vsm, s(1)) && passes(&mut vsm, &mut cucs, s(2)));
    let sealed = cucs.seal(s(3), b"command");
    assert_eq!(vsm.open(s(3), &sealed), Ok(b"command".to_vec()));
    assert_eq!(vsm.open(s(3), &sealed), Err(GuardRefusal::Replayed));
    assert_eq!(cucs.open(s(3), &sealed), Err(GuardRefusal::Direction));
    let status = vsm.end.status(s(4));
    assert_eq!((status.verified, status.verified_s), (2, Some(1.0)));
    assert_eq!(status.refused.get(GuardRefusal::Replayed.name()), 1);
    assert_eq!(status.key_id, Some(key(1).id().to_string()));
}

#[test]
fn another_order_is_taken_and_what_was_held_back_is_not() {
    let (mut cucs, mut vsm) = ends(0);
    let mut sent: Vec<_> = (0..100).map(|n| cucs.seal(s(1), &[n])).collect();
    sent.reverse();
    for sealed in &sent {
        assert_eq!(vsm.open(s(2), sealed).map(|inside| inside.len()), Ok(1));
    }
    assert!(
        sent.iter()
            .all(|sealed| vsm.open(s(2), sealed) == Err(GuardRefusal::Replayed))
    );
    let (held, longer) = (cucs.seal(s(10), b"held"), cucs.seal(s(11), b"longer"));
    assert!(passes(&mut cucs, &mut vsm, s(20)));
    assert_eq!(vsm.open(s(39), &held), Ok(b"held".to_vec()));
    // Also where the station is silent meanwhile: its newest is carried on.
    assert_eq!(vsm.open(s(42), &longer), Err(GuardRefusal::Late));
    // Behind a thousand others what was never delivered looks like what was.
    let old = cucs.seal(s(60), b"old");
    for n in 0..=WINDOW as u64 {
        let at = s(60) + Duration::from_millis(n);
        let sealed = cucs.seal(at, b"x");
        vsm.open(at, &sealed).unwrap();
    }
    assert_eq!(vsm.open(s(62), &old), Err(GuardRefusal::Old));
}

#[test]
fn a_hundred_thousand_forged_trailers_change_nothing() {
    forge(100_000);
}

#[test]
#[ignore = "a million: `cargo nextest run -p vsm --lib --run-ignored all -E 'test(forged)'`"]
fn a_million_forged_trailers_change_nothing() {
    forge(1_000_000);
}

fn forge(count: u64) {
    let (mut cucs, mut vsm) = ends(0);
    let good = cucs.seal(s(1), b"override, and land");
    let mut random = fastrand::Rng::with_seed(20);
    let stored = vsm.disk.records.clone();
    for n in 0..count {
        let mut forged = good.clone();
        let length = forged.len();
        match n % 4 {
            // Any MAC, one bit of it, one bit of what it is about, another stamp.
            0 => random.fill(&mut forged[length - 32..]),
            1 => forged[length - 1 - random.usize(..32)] ^= 1 << random.u8(..8),
            2 => forged[random.usize(..length - TRAILER)] ^= 1 << random.u8(..8),
            _ => forged[length - 33 - random.usize(..6)] ^= 1 << random.u8(..8),
        }
        let refused = vsm.open(s(2), &forged).unwrap_err();
        assert_eq!(refused, GuardRefusal::Forged, "{n}");
    }
    let status = vsm.end.status(s(2));
    assert_eq!(status.refused.get(GuardRefusal::Forged.name()), count);
    assert_eq!((status.verified, status.verified_s), (0, None));
    assert_eq!(vsm.disk.records, stored, "nothing was written for them");
    assert_eq!(vsm.open(s(2), &good).unwrap(), b"override, and land");
}

#[test]
fn who_it_is_is_the_key_and_not_the_name() {
    let (mut cucs, mut vsm) = ends(0);
    // Another station with a key of its own, in the name of this one: the id of the key selects, and the MAC decides.
    let other = GuardKey::new(key(2).expose());
    let mut trailer = Guarded::parse(&cucs.seal(s(1), b"x")).unwrap().trailer;
    let mut out = [0; MAX_GUARDED];
    for (named, expected) in [
        (other.id(), GuardRefusal::Key),
        (GuardKey::new(key(1).expose()).id(), GuardRefusal::Forged),
    ] {
        trailer.key_id = named;
        let length = other.seal(&trailer, VSM, b"x", &mut out).unwrap();
        assert_eq!(vsm.open(s(1), &out[..length]), Err(expected));
    }
    // The right key, for another VSM, and of another sender.
    let mut elsewhere = Host::new((Id(7), CUCS), Direction::ToCucs, 0);
    let sealed = cucs.seal(s(1), b"x");
    assert_eq!(elsewhere.open(s(1), &sealed), Err(GuardRefusal::Forged));
    let mut stranger = Host::new((Id(8), VSM), Direction::ToVsm, 0);
    let sealed = stranger.seal(s(1), b"x");
    assert_eq!(vsm.open(s(1), &sealed), Err(GuardRefusal::Sender));
}

#[test]
fn nothing_is_taken_twice_over_restarts_of_both_ends_and_steps_of_their_clocks() {
    let mut total = 0;
    for seed in 0..40 {
        let mut random = fastrand::Rng::with_seed(seed);
        let (mut cucs, mut vsm) = ends(random.i64(-600..600));
        let (mut at, mut recorded, mut taken) = (s(1), Vec::new(), BTreeSet::new());
        for n in 0_u16..300 {
            at += Duration::from_millis(random.u64(1..3_000));
            match random.u8(..12) {
                0 => cucs.restart(at),
                1 => vsm.restart(at),
                2 => cucs.off = random.i64(-YEAR..YEAR),
                3 => vsm.off = random.i64(-YEAR..YEAR),
                4 => {
                    for host in [&mut cucs, &mut vsm] {
                        let now = host.now(at);
                        host.end.keep(now, &mut host.disk);
                    }
                }
                _ => recorded.push(cucs.seal(at, &n.to_be_bytes())),
            }
            for _ in 0..3 {
                let Some(sealed) = random.choice(&recorded) else {
                    continue;
                };
                if let Ok(inside) = vsm.open(at, sealed) {
                    assert!(taken.insert(inside), "seed {seed}, step {n}");
                }
            }
        }
        total += taken.len();
    }
    // Not in every history: where the clocks are years apart nothing is believed.
    assert!(total > 40, "{total}");
}

#[test]
fn ends_whose_clocks_differ_by_minutes_serve_each_other_after_any_restart() {
    for off in [0, 45, -45, 1_800, -1_800] {
        let (mut cucs, mut vsm) = ends(off);
        let mut at = s(1);
        for round in 0..60 {
            let both = passes(&mut cucs, &mut vsm, at) && passes(&mut vsm, &mut cucs, at);
            assert!(both, "{off} s, round {round}");
            at += s(2);
            // A program that a service manager starts again and again, each time before the ceiling is reached.
            match round % 3 {
                0 => cucs.restart(at),
                1 => vsm.restart(at),
                _ => at += s(25),
            }
        }
    }
}

#[test]
fn a_computer_that_slept_is_lifted() {
    let (mut cucs, mut vsm) = ends(0);
    assert!(passes(&mut cucs, &mut vsm, s(1)));
    // Its monotonic clock stood still for ten minutes.
    cucs.started += s(600);
    assert!(passes(&mut cucs, &mut vsm, s(605)));
    assert_eq!(
        vsm.end
            .status(s(605))
            .refused
            .get(GuardRefusal::Late.name()),
        1
    );
}

#[test]
fn recordings_do_not_take_the_lifts_of_the_sender_itself() {
    let (mut cucs, mut vsm) = ends(0);
    let recorded: Vec<_> = (1..20).map(|at| cucs.seal(s(at), b"x")).collect();
    assert!(vsm.open(s(20), recorded.last().unwrap()).is_ok());
    vsm.restart(s(21));
    let mut lifts = 0;
    for at in 22..32 {
        for sealed in recorded.iter().rev() {
            assert_eq!(vsm.open(s(at), sealed), Err(GuardRefusal::Old));
            lifts += usize::from(vsm.lift(s(at)).is_some());
        }
        // What nobody has verified is lifted by nobody.
        assert!(vsm.lift(s(at) + LIFT_EVERY).is_none());
    }
    assert_eq!(lifts, 1, "the newest of them, once");
    // A station whose clock is behind, in the very moment after a recording.
    let (mut cucs, mut vsm) = ends(-600);
    let recorded = cucs.seal(s(1), b"x");
    assert!(passes(&mut cucs, &mut vsm, s(2)));
    vsm.restart(s(300));
    cucs.disk = MemoryDisk::default();
    cucs.restart(s(300));
    assert_eq!(vsm.open(s(301), &recorded), Err(GuardRefusal::Old));
    assert!(vsm.lift(s(301)).is_some());
    let sealed = cucs.seal(s(301), b"x");
    assert_eq!(vsm.open(s(301), &sealed), Err(GuardRefusal::Old));
    assert!(vsm.lift(s(301)).is_some(), "at once");
}

#[test]
fn over_an_hour_ahead_is_refused_and_moves_nothing() {
    let (mut cucs, mut vsm) = ends(3_700);
    for _ in 0..3 {
        let sealed = cucs.seal(s(1), b"x");
        assert_eq!(vsm.open(s(1), &sealed), Err(GuardRefusal::Ahead));
    }
    cucs.off = 0;
    cucs.disk = MemoryDisk::default();
    cucs.restart(s(2));
    assert!(passes(&mut cucs, &mut vsm, s(2)));
    // The bounds of what a stamp can be.
    let mut trailer = Guarded::parse(&cucs.seal(s(3), b"x")).unwrap().trailer;
    let (key, mut out) = (GuardKey::new(key(1).expose()), [0; MAX_GUARDED]);
    for stamp_us in [0, u64::MAX] {
        trailer.stamp_us = stamp_us;
        let length = key.seal(&trailer, VSM, b"x", &mut out).unwrap();
        assert_eq!(vsm.open(s(3), &out[..length]), Err(GuardRefusal::Ahead));
    }
}

#[test]
fn two_keys_overlap_and_the_answer_has_the_one_that_the_other_end_has() {
    let (mut cucs, mut vsm) = ends(0);
    assert!(passes(&mut cucs, &mut vsm, s(1)));
    let now = vsm.now(s(10));
    let until = Some(now.mono + s(100));
    let keys = vec![(key(2), None), (key(1), until)];
    let set = vsm.end.set_keys(keys, Duration::ZERO, now, &mut vsm.disk);
    set.unwrap();
    // What was taken before stays taken, and the station continues under its old key.
    assert!(passes(&mut vsm, &mut cucs, s(11)) && passes(&mut cucs, &mut vsm, s(12)));
    assert!(vsm.end.status(s(12)).uses_previous);
    // A restart forgets which one the station has: it is lifted under that which has verified.
    vsm.keys = vec![2, 1];
    vsm.restart(s(13));
    assert!(passes(&mut cucs, &mut vsm, s(13)));
    let now = vsm.now(s(14));
    let keys = vec![(key(2), None), (key(1), Some(now.mono + s(96)))];
    let set = vsm.end.set_keys(keys, Duration::ZERO, now, &mut vsm.disk);
    set.unwrap();
    let recorded = cucs.seal(s(15), b"recorded");
    cucs.keys = vec![2];
    cucs.restart(s(20));
    assert!(passes(&mut cucs, &mut vsm, s(21)) && passes(&mut vsm, &mut cucs, s(22)));
    assert!(!vsm.end.status(s(22)).uses_previous);
    assert_eq!(vsm.open(s(111), &recorded), Err(GuardRefusal::Key));
    assert_eq!(vsm.end.status(s(111)).key_id, Some(key(2).id().to_string()));
}

#[test]
fn a_disk_that_fails_lets_nothing_pass_that_a_restart_would_take_again() {
    let (mut cucs, mut vsm) = ends(0);
    assert!(passes(&mut cucs, &mut vsm, s(1)));
    vsm.disk.full = Some("");
    let sealed = cucs.seal(s(30), b"x");
    assert_eq!(vsm.open(s(30), &sealed), Err(GuardRefusal::Disk));
    let mut out = [0; MAX_GUARDED];
    let now = vsm.now(s(30));
    let sealing = vsm.end.seal(now, b"x", &mut out, &mut vsm.disk);
    assert_eq!(sealing, Err(SealError::Clock(ClockError::Ceiling)));
    vsm.disk.full = None;
    let sealed = cucs.seal(s(32), b"x");
    assert_eq!(vsm.open(s(32), &sealed), Ok(b"x".to_vec()));
    // One that queues: the ceiling is kept ahead, so that nothing waits for it.
    vsm.disk.queues = true;
    for at in 33..120 {
        let now = vsm.now(s(at));
        vsm.end.keep(now, &mut vsm.disk);
        let sealed = cucs.seal(s(at), b"x");
        assert_eq!(vsm.open(s(at), &sealed), Ok(b"x".to_vec()), "{at}");
        vsm.disk.complete(u64::MAX);
    }
}

const TRAILER: usize = stanag_msgs::guard::TRAILER_BYTES;

#[test]
fn a_copy_is_judged_by_the_key_that_has_sealed_it_whatever_has_verified_since() {
    let (mut thief, mut vsm) = ends(0);
    let mut owner = Host::new((CUCS, VSM), Direction::ToVsm, 0);
    owner.keys = vec![2];
    owner.restart(s(1));
    let now = vsm.now(s(1));
    let keys = vec![(key(2), None), (key(1), Some(s(1_000)))];
    let set = vsm.end.set_keys(keys, Duration::ZERO, now, &mut vsm.disk);
    set.unwrap();
    let at = |port: u16| SocketAddr::from(([192, 0, 2, 1], port));
    let mut open = |at_s: u64, from, bytes: &[u8]| {
        let guarded = Guarded::parse(bytes).expect("a trailer");
        let peers = (from, Some(at(1)));
        let opened = vsm
            .end
            .open_from(vsm_now(at_s), &guarded, peers, &mut vsm.disk);
        opened.map(|(_, key)| key)
    };
    // A recording under the key before, from elsewhere; then the honest one; then the recording as if from the station.
    let recorded = thief.seal(s(2), b"recorded");
    let honest = owner.seal(s(2), b"honest");
    assert_eq!(open(2, at(2), &recorded), Ok(key(1).id()));
    assert_eq!(open(3, at(1), &honest), Ok(key(2).id()));
    assert_eq!(open(4, at(1), &recorded), Ok(key(1).id()));
    assert_eq!(open(4, at(1), &recorded), Err(GuardRefusal::Replayed));
}

fn vsm_now(at_s: u64) -> Now {
    Host::clocks(s(at_s), Duration::ZERO, 0)
}
