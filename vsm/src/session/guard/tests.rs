use std::collections::BTreeSet;

use mavlink_link::store::MemoryDisk;
use stanag_msgs::guard::ClockDatagram;

use super::clock::ANSWER_WITHIN;
use super::*;

const CUCS: Id = Id(0x1b00_00a0);
const VSM: Id = Id(0x1b00_0001);
const WALL: Duration = Duration::from_secs(1_795_219_200);
const YEAR: i64 = 366 * 86_400;
const HOUR: i64 = 3_600;

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

    fn reply(&mut self, at: Duration) -> Option<Vec<u8>> {
        let mut out = [0; MAX_GUARDED];
        let now = self.now(at);
        let length = self.end.reply(now, &mut out, &mut self.disk)?;
        Some(out[..length].to_vec())
    }

    /// A challenge, whose answer is returned, or an answer.
    fn take_clock(&mut self, at: Duration, bytes: &[u8]) -> Result<Option<Vec<u8>>, GuardRefusal> {
        let mut out = [0; MAX_GUARDED];
        let now = self.now(at);
        let about = ClockDatagram::parse(bytes).expect("about clocks");
        let length = self.end.take_clock(now, &about, &mut out, &mut self.disk)?;
        Ok(length.map(|length| out[..length].to_vec()))
    }

    /// Whatever it is; what is not believed is returned with what is sent for it.
    fn take(&mut self, at: Duration, bytes: &[u8]) -> Result<Vec<u8>, Option<Vec<u8>>> {
        if ClockDatagram::parse(bytes).is_some() {
            return Err(self.take_clock(at, bytes).ok().flatten());
        }
        match self.open(at, bytes) {
            Ok(inside) => Ok(inside),
            Err(why) if why.wants_reply() => Err(self.reply(at)),
            Err(_) => Err(None),
        }
    }

    fn floor(&self) -> Stamp {
        self.end.keys[0].clock.floor()
    }

    /// Whether anything of a datagram is believed, or moves the clock.
    fn believes(&mut self, at: Duration, bytes: &[u8]) -> bool {
        let floor = self.floor();
        self.take(at, bytes).is_ok() || self.floor() != floor
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
                let lift = to.reply(at).expect("time for it");
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

/// One datagram from one to the other, and all that both send for it; whether it was believed.
fn one_way(from: &mut Host, to: &mut Host, at: Duration, sent: &mut Vec<Vec<u8>>) -> bool {
    let sealed = from.seal(at, b"x");
    sent.push(sealed.clone());
    let Err(mut next) = to.take(at, &sealed) else {
        return true;
    };
    let (mut here, mut there) = (&mut *from, &mut *to);
    let mut length = sealed.len();
    while let Some(bytes) = next {
        assert!(bytes.len() <= length, "no longer than what it answers");
        length = bytes.len();
        next = here.take(at, &bytes).err().flatten();
        sent.push(bytes);
        std::mem::swap(&mut here, &mut there);
    }
    false
}

/// Both send three times a second: how many rounds it takes until each believes the other.
fn meet(cucs: &mut Host, vsm: &mut Host, at: Duration, sent: &mut Vec<Vec<u8>>) -> Option<u32> {
    (0..30).find(|round| {
        let at = at + *round * Duration::from_millis(300);
        let up = one_way(cucs, vsm, at, sent);
        one_way(vsm, cucs, at, sent) && up
    })
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
                match vsm.open(at, sealed) {
                    Ok(inside) => assert!(taken.insert(inside), "seed {seed}, step {n}"),
                    // A lift or a challenge, and what comes back.
                    Err(why) if why.wants_reply() => {
                        if let Some(reply) = vsm.reply(at)
                            && let Err(Some(back)) = cucs.take(at, &reply)
                        {
                            drop(vsm.take(at, &back));
                        }
                    }
                    Err(_) => {}
                }
            }
        }
        total += taken.len();
    }
    // Not in every history: few of the recorded ones are of now.
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
            lifts += usize::from(vsm.reply(s(at)).is_some());
        }
        // What nobody has verified is lifted by nobody.
        assert!(vsm.reply(s(at) + LIFT_EVERY).is_none());
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
    assert!(vsm.reply(s(301)).is_some());
    let sealed = cucs.seal(s(301), b"x");
    assert_eq!(vsm.open(s(301), &sealed), Err(GuardRefusal::Old));
    assert!(vsm.reply(s(301)).is_some(), "at once");
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

/// The end of the key before is read from the wall clock, which may be wrong.
#[test]
fn a_key_ends_no_sooner_than_was_known_before_nor_within_a_grace_that_the_use_of_the_next_one_ends()
{
    let set = |vsm: &mut Host, at: Duration, left: Duration| {
        let now = vsm.now(at);
        let keys = vec![(key(2), None), (key(1), Some(now.mono + left))];
        let set = vsm.end.set_keys(keys, Duration::ZERO, now, &mut vsm.disk);
        set.unwrap();
    };
    let (mut cucs, mut vsm) = ends(0);
    assert!(passes(&mut cucs, &mut vsm, s(1)));
    set(&mut vsm, s(2), s(100));
    // A reload while the clock is a day ahead.
    set(&mut vsm, s(3), Duration::ZERO);
    assert!(passes(&mut cucs, &mut vsm, s(101)));
    let late = cucs.seal(s(103), b"x");
    assert_eq!(vsm.open(s(103), &late), Err(GuardRefusal::Key));

    // A start while the clock is a day ahead, twice: until the other end uses the new key, and until the grace ends.
    for uses_new in [true, false] {
        let (mut cucs, mut vsm) = ends(0);
        vsm.keys = vec![2];
        vsm.restart(s(10));
        vsm.end.give_grace(s(50));
        set(&mut vsm, s(10), Duration::ZERO);
        assert!(passes(&mut cucs, &mut vsm, s(20)));
        assert_eq!(vsm.end.used(), None);
        if uses_new {
            let mut owner = Host::new((CUCS, VSM), Direction::ToVsm, 0);
            owner.keys = vec![2];
            owner.restart(s(21));
            assert!(passes(&mut owner, &mut vsm, s(21)));
            assert_eq!(vsm.end.used(), Some(key(2).id()));
        }
        let early = cucs.seal(s(22), b"x");
        assert_eq!(vsm.open(s(22), &early).is_ok(), !uses_new);
        let late = cucs.seal(s(61), b"x");
        assert_eq!(vsm.open(s(61), &late), Err(GuardRefusal::Key));
    }
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

/// A challenge of the VSM to a guard whose clock is ahead.
fn challenged(cucs: &mut Host, vsm: &mut Host, at: Duration) -> Vec<u8> {
    let sealed = cucs.seal(at, b"x");
    assert_eq!(vsm.open(at, &sealed), Err(GuardRefusal::Ahead));
    vsm.reply(at).expect("its turn")
}

#[test]
fn a_start_with_a_wrong_clock_heals_at_once_and_so_does_one_with_the_clock_right_again() {
    let offs = [2 * HOUR, 300 * 86_400, 10 * YEAR, -2 * HOUR, -10 * YEAR];
    let cases = offs.iter().flat_map(|off| [(*off, false), (*off, true)]);
    let cases = cases.flat_map(|(off, stored)| [(off, stored, false), (off, stored, true)]);
    for (off, stored, of_vsm) in cases {
        let case = format!("{off} s, stored {stored}, of the VSM {of_vsm}");
        let (mut cucs, mut vsm) = ends(0);
        let mut sent = Vec::new();
        assert_eq!(meet(&mut cucs, &mut vsm, s(1), &mut sent), Some(0));
        let mut at = s(20);
        let mut step = |what: &str, cucs: &mut Host, vsm: &mut Host| {
            let rounds = meet(cucs, vsm, at, &mut sent);
            assert!(rounds.is_some_and(|n| n <= 3), "{case}, {what}: {rounds:?}");
            at += s(20);
            at
        };
        let wrong = if of_vsm { &mut vsm } else { &mut cucs };
        if !stored {
            wrong.disk = MemoryDisk::default();
        }
        wrong.off = off;
        wrong.restart(s(20));
        let next = step("wrong", &mut cucs, &mut vsm);
        let wrong = if of_vsm { &mut vsm } else { &mut cucs };
        wrong.off = 0;
        wrong.restart(next);
        let next = step("right again", &mut cucs, &mut vsm);
        let other = if of_vsm { &mut cucs } else { &mut vsm };
        other.restart(next);
        let next = step("the other started", &mut cucs, &mut vsm);
        // What has met the wrong clock is gone with the store: only the end that had it is ahead.
        let other = if of_vsm { &mut cucs } else { &mut vsm };
        other.disk = MemoryDisk::default();
        other.restart(next);
        step("the other with a new store", &mut cucs, &mut vsm);
    }
}

#[test]
fn an_end_that_was_off_for_days_without_a_clock_of_its_own_is_served() {
    let (mut cucs, mut vsm) = ends(0);
    let mut sent = Vec::new();
    assert_eq!(meet(&mut cucs, &mut vsm, s(1), &mut sent), Some(0));
    for vsm_was_off in [true, false] {
        let at = if vsm_was_off { s(300_000) } else { s(600_000) };
        let off = if vsm_was_off { &mut vsm } else { &mut cucs };
        // It starts where it was: before the ceiling on its disk.
        off.off = -(at.as_secs() as i64);
        off.restart(at);
        let rounds = meet(&mut cucs, &mut vsm, at + s(1), &mut sent);
        assert!(rounds.is_some_and(|n| n <= 3), "{rounds:?}");
    }
}

#[test]
fn what_was_recorded_or_withheld_while_the_clocks_were_apart_is_never_believed() {
    for (off, of_vsm) in [(2 * HOUR, false), (2 * HOUR, true), (10 * YEAR, false)] {
        let (mut cucs, mut vsm) = ends(0);
        let wrong = if of_vsm { &mut vsm } else { &mut cucs };
        wrong.disk = MemoryDisk::default();
        wrong.off = off;
        wrong.restart(s(0));
        let mut sent = Vec::new();
        for n in 0..5 {
            // Withheld, or recorded: it has reached nobody.
            sent.push(cucs.seal(s(1), &[n]));
            sent.push(vsm.seal(s(1), &[n]));
        }
        assert!(meet(&mut cucs, &mut vsm, s(2), &mut sent).is_some());
        let about = sent
            .iter()
            .filter(|one| ClockDatagram::parse(one).is_some());
        assert!(about.count() >= 2, "a challenge and its answer");
        for (round, at) in [4, 10, 20, 7_500].into_iter().enumerate() {
            for bytes in &sent {
                for host in [&mut cucs, &mut vsm] {
                    assert!(!host.believes(s(at), bytes), "{off} s, round {round}");
                }
            }
            match round {
                0 => vsm.restart(s(at) + s(1)),
                1 => cucs.restart(s(at) + s(1)),
                _ => {}
            }
        }
        // The two themselves are served after all that.
        let rounds = meet(&mut cucs, &mut vsm, s(7_510), &mut sent);
        assert!(rounds.is_some_and(|n| n <= 3), "{rounds:?}");
    }
}

#[test]
fn an_answer_counts_for_its_own_challenge_once_and_for_seconds() {
    let (mut cucs, mut vsm) = ends(2 * HOUR);
    let mut other = Host::new((VSM, CUCS), Direction::ToCucs, 0);
    let later = s(1) + 2 * LIFT_EVERY;
    let challenge = challenged(&mut cucs, &mut vsm, s(1));
    let another = challenged(&mut cucs, &mut other, later);
    let answer = cucs.take_clock(s(1), &challenge).unwrap().unwrap();
    let of_another = cucs.take_clock(later, &another).unwrap().unwrap();
    let floor = vsm.floor();
    // Of a challenge that it has not made, changed in any bit, reflected.
    let unasked = Err(GuardRefusal::Unasked);
    assert_eq!(vsm.take_clock(later, &of_another), unasked);
    for bit in 0..answer.len() * 8 {
        let mut bent = answer.clone();
        bent[bit / 8] ^= 1 << (bit % 8);
        if ClockDatagram::parse(&bent).is_some() {
            vsm.take_clock(later, &bent).unwrap_err();
        }
    }
    let reflected = vsm.take_clock(later, &challenge);
    assert_eq!(reflected, Err(GuardRefusal::Direction));
    assert_eq!(vsm.floor(), floor);
    // In time it counts, and once.
    assert_eq!(vsm.take_clock(later, &answer), Ok(None));
    assert!(vsm.floor() > floor);
    let moved = vsm.end.take_met().expect("it is reported");
    assert!(
        moved.contains("moved 7200 s ahead") || moved.contains("moved 7199 s ahead"),
        "{moved}"
    );
    assert_eq!(vsm.end.take_met(), None, "once");
    let floor = vsm.floor();
    assert_eq!(vsm.take_clock(later, &answer), unasked);
    assert_eq!(vsm.floor(), floor);
    // Too late it does not.
    let late = later + ANSWER_WITHIN + LIFT_EVERY;
    assert_eq!(other.take_clock(late, &of_another), unasked);
    // Nor after a restart, which has asked nothing.
    other.restart(late);
    assert_eq!(other.take_clock(late, &of_another), unasked);
}

#[test]
fn recordings_get_few_challenges_and_few_answers_and_do_not_keep_the_two_apart() {
    let (mut cucs, mut vsm) = ends(2 * HOUR);
    let step = Duration::from_millis(100);
    let recorded: Vec<_> = (0..100).map(|n| cucs.seal(s(1) + n * step, b"x")).collect();
    let mut challenges = Vec::new();
    for _ in 0..10 {
        for sealed in &recorded {
            assert_eq!(vsm.open(s(12), sealed), Err(GuardRefusal::Ahead));
            if let Some(challenge) = vsm.reply(s(12)) {
                assert!(challenge.len() <= sealed.len());
                challenges.push(challenge);
            }
        }
    }
    assert_eq!(challenges.len(), 3, "one for each 4 s that were recorded");
    let mut answers = 0;
    for n in 0..10 {
        for challenge in &challenges {
            let answer = cucs.take_clock(s(12) + n * step, challenge).unwrap();
            assert!(
                answer
                    .as_ref()
                    .is_none_or(|one| one.len() <= challenge.len())
            );
            answers += usize::from(answer.is_some());
        }
    }
    assert!(answers <= 3, "each once: {answers}");
    // The end itself lies above all of them.
    let floor = vsm.floor();
    for n in 0..3 {
        let at = s(13) + n * step;
        for bytes in recorded.iter().chain(&challenges) {
            assert!(!vsm.believes(at, bytes));
        }
        one_way(&mut cucs, &mut vsm, at, &mut Vec::new());
    }
    assert!(vsm.floor() > floor);
    assert_eq!(meet(&mut cucs, &mut vsm, s(14), &mut Vec::new()), Some(0));
}

#[test]
fn a_clock_is_met_once_the_disk_has_it_and_in_the_last_ten_years_never() {
    let (mut cucs, mut vsm) = ends(2 * HOUR);
    let floor = vsm.floor();
    let challenge = challenged(&mut cucs, &mut vsm, s(1));
    let answer = cucs.take_clock(s(1), &challenge).unwrap().unwrap();
    vsm.disk.full = Some("");
    assert_eq!(vsm.take_clock(s(1), &answer), Err(GuardRefusal::Disk));
    assert_eq!(vsm.floor(), floor);
    vsm.disk.full = None;
    assert!(meet(&mut cucs, &mut vsm, s(3), &mut Vec::new()).is_some_and(|n| n <= 3));
    // A disk that queues.
    let (mut cucs, mut vsm) = ends(2 * HOUR);
    vsm.disk.queues = true;
    let challenge = challenged(&mut cucs, &mut vsm, s(1));
    let answer = cucs.take_clock(s(1), &challenge).unwrap().unwrap();
    assert_eq!(vsm.take_clock(s(1), &answer), Err(GuardRefusal::Disk));
    vsm.disk.complete(u64::MAX);
    let rounds = meet(&mut cucs, &mut vsm, s(1) + 2 * LIFT_EVERY, &mut Vec::new());
    assert!(rounds.is_some_and(|n| n <= 3), "{rounds:?}");
    // Who has the key ends the life of no clock.
    let (mut cucs, mut vsm) = ends(60 * YEAR);
    let sealed = cucs.seal(s(12 * YEAR as u64), b"x");
    assert_eq!(vsm.open(s(1), &sealed), Err(GuardRefusal::Ahead));
    assert_eq!(vsm.reply(s(1)), None);
}
