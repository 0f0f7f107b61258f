//! Both ends with their files, a network that can do its worst, disks that end their process at any write, and a person who pairs
//! again: under a virtual clock.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;
use std::{fs, io};

use mavlink_link::Now;
use mavlink_link::exchange::{Identity, NoRandom, PairingCode};
use mavlink_link::signing::{KeyId, SigningKey};
use mavlink_link::store::{Disk, Durability, MemoryDisk, StoreError};
use stanag_msgs::Id;
use stanag_msgs::guard::{Direction, ExchangeDatagram, Guarded, MAX_GUARDED};
use vsm::guard_exchange::{CucsEnd, CucsFiles, CucsNews, VsmEnd, VsmNews};
use vsm::session::{GuardEnd, GuardKeyUntil};
use vsm::shell::disk::{FileSystem, NativeFileSystem};
use vsm::shell::guard_agreed::AgreedFiles;
use vsm::shell::guard_file;
use vsm::shell::key_store::KeyStore;
use zeroize::Zeroizing;

pub(super) const VSM: Id = Id(0x1b00_0001);
pub(super) const CUCS: Id = Id(0x1b00_00a0);
pub(super) const AT: ([u8; 4], u16) = ([127, 0, 0, 1], 4_000);

/// The writes of one process: the `left`-th ends it, and all that follow fail.
#[derive(Debug, Clone)]
pub(super) struct Writes(Arc<AtomicUsize>);

impl Writes {
    pub(super) fn new(left: usize) -> Writes {
        Writes(Arc::new(AtomicUsize::new(left)))
    }

    fn take(&self) -> io::Result<()> {
        let left = self
            .0
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| {
                Some(left.saturating_sub(1))
            });
        match left {
            Ok(0) | Err(_) => Err(io::Error::other("the process has ended")),
            Ok(_) => Ok(()),
        }
    }

    /// Whether there is none left: the process is to be started again.
    pub(super) fn are_over(&self) -> bool {
        self.0.load(Ordering::Relaxed) == 0
    }
}

/// Files that are not synchronised: no power is cut here.
impl FileSystem for Writes {
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        self.take()?;
        NativeFileSystem.write(path, bytes)
    }

    fn sync(&self, _: &Path) -> io::Result<()> {
        Ok(())
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.take()?;
        NativeFileSystem.rename(from, to)
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        self.take()?;
        NativeFileSystem.remove(path)
    }

    fn read(&self, path: &Path, most: u64) -> io::Result<Option<Zeroizing<Vec<u8>>>> {
        NativeFileSystem.read(path, most)
    }
}

/// A store of records, whose writes count too.
#[derive(Debug)]
struct Records(MemoryDisk, Writes);

impl Records {
    fn take(&self, name: &str) -> Result<(), StoreError> {
        self.1.take().map_err(|cause| StoreError::new(name, cause))
    }
}

impl Disk for Records {
    fn read(&self, name: &str, most: u64) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError> {
        self.0.read(name, most)
    }

    fn replace(
        &mut self,
        name: &str,
        bytes: &[u8],
        durability: Durability,
    ) -> Result<(), StoreError> {
        self.take(name)?;
        self.0.replace(name, bytes, durability)
    }

    fn append(
        &mut self,
        name: &str,
        bytes: &[u8],
        durability: Durability,
    ) -> Result<(), StoreError> {
        self.take(name)?;
        self.0.append(name, bytes, durability)
    }

    fn rename(&mut self, from: &str, to: &str) -> Result<(), StoreError> {
        self.take(from)?;
        self.0.rename(from, to)
    }

    fn remove(&mut self, name: &str) -> Result<(), StoreError> {
        self.take(name)?;
        self.0.remove(name)
    }
}

/// Random bytes that a test can have again.
#[derive(Debug, Clone)]
pub(super) struct Dice(pub(super) fastrand::Rng);

impl Dice {
    fn another(&mut self) -> Dice {
        Dice(fastrand::Rng::with_seed(self.0.u64(..)))
    }

    pub(super) fn fill(&mut self) -> impl FnMut(&mut [u8]) -> Result<(), NoRandom> {
        |out: &mut [u8]| {
            self.0.fill(out);
            Ok(())
        }
    }
}

/// The VSM, as `vsm run` has it.
pub(super) struct Vsm {
    pub(super) end: VsmEnd,
    pub(super) files: AgreedFiles,
    guard: Option<GuardEnd>,
    stamps: MemoryDisk,
    pub(super) writes: Writes,
}

/// The guard, as `vsm guard run` or `vsm guard pair` has it.
pub(super) struct Cucs {
    pub(super) end: CucsEnd,
    keys: KeyStore,
    guard: Option<GuardEnd>,
    store: Records,
    stamps: MemoryDisk,
    pub(super) writes: Writes,
}

pub(super) struct World {
    folder: tempfile::TempDir,
    pub(super) now: Duration,
    pub(super) dice: Dice,
    identities: [Identity; 2],
    pub(super) code: PairingCode,
    pub(super) vsm: Option<Vsm>,
    pub(super) cucs: Option<Cucs>,
    pub(super) news: Vec<VsmNews>,
    pub(super) cucs_news: Vec<CucsNews>,
    pub(super) loss: u32,
    pub(super) double: u32,
    /// The number of a step that is lost, of those of the exchange in their order.
    pub(super) lose: Option<usize>,
    pub(super) steps: usize,
    /// Every datagram that was sent, for an attacker who records.
    pub(super) tape: Vec<(Direction, Vec<u8>)>,
    under_way: VecDeque<(Duration, Direction, Vec<u8>)>,
    /// Datagrams of the CUCS that were taken, and that were not, since they were last looked at.
    pub(super) taken: usize,
    pub(super) refused: usize,
    pub(super) answered: usize,
    speak_at: Duration,
    person_at: Option<Duration>,
}

impl World {
    /// Two that do not know each other; a person opens the window and starts `vsm guard pair`, again where that is of no avail.
    pub(super) fn strangers(seed: u64) -> World {
        let mut dice = Dice(fastrand::Rng::with_seed(seed));
        let identities = [(); 2].map(|()| Identity::generate(&mut dice.fill()).unwrap());
        let code = PairingCode::generate(&mut dice.fill()).unwrap();
        let mut world = World {
            folder: tempfile::tempdir().unwrap(),
            now: Duration::from_secs(1),
            dice,
            identities,
            code,
            vsm: None,
            cucs: None,
            news: Vec::new(),
            cucs_news: Vec::new(),
            loss: 0,
            double: 0,
            lose: None,
            steps: 0,
            tape: Vec::new(),
            under_way: VecDeque::new(),
            taken: 0,
            refused: 0,
            answered: 0,
            speak_at: Duration::ZERO,
            person_at: Some(Duration::ZERO),
        };
        for name in ["vsm", "cucs"] {
            fs::create_dir(world.folder.path().join(name)).unwrap();
        }
        world.start_vsm(usize::MAX, MemoryDisk::default());
        world
    }

    /// Two that are paired, and speak.
    pub(super) fn paired(seed: u64) -> World {
        let mut world = World::strangers(seed);
        assert!(world.run_until(20, World::is_settled));
        (world.news, world.cucs_news, world.steps) = (vec![], vec![], 0);
        world.person_at = None;
        world
    }

    /// The person comes later, or never.
    pub(super) fn leave_alone(&mut self, seconds: Option<u64>) {
        self.person_at = seconds.map(|seconds| self.now + Duration::from_secs(seconds));
    }

    /// Everything that was sent, once it has arrived.
    pub(super) fn whole_tape(&mut self) -> Vec<(Direction, Vec<u8>)> {
        self.speak_at = Duration::MAX;
        self.run(1);
        self.speak_at = self.now;
        self.tape.clone()
    }

    pub(super) fn clock(&self) -> Now {
        Now {
            mono: self.now,
            wall: Duration::from_secs(1_800_000_000) + self.now,
        }
    }

    pub(super) fn vsm_key(&self) -> std::path::PathBuf {
        self.folder.path().join("vsm/a0.key")
    }

    fn start_vsm(&mut self, writes: usize, stamps: MemoryDisk) {
        let writes = Writes::new(writes);
        let files = AgreedFiles::new_on(&self.vsm_key(), Arc::new(writes.clone()));
        let mut end = VsmEnd::new(VSM, self.identities[0].duplicate());
        end.set(CUCS, files.memory().unwrap(), self.now);
        let mut vsm = Vsm {
            end,
            files,
            guard: None,
            stamps,
            writes,
        };
        vsm.take_keys(self.clock());
        self.vsm = Some(vsm);
    }

    /// `vsm run` is ended and started again; the `writes`-th write ends it next.
    pub(super) fn restart_vsm(&mut self, writes: usize) {
        let stamps = self.vsm.take().unwrap().stamps;
        self.start_vsm(writes, stamps);
    }

    pub(super) fn reload_vsm(&mut self) {
        let (now, mono) = (self.clock(), self.now);
        let vsm = self.vsm.as_mut().unwrap();
        vsm.end.set(CUCS, vsm.files.memory().unwrap(), mono);
        vsm.take_keys(now);
    }

    fn start_cucs(
        &mut self,
        code: Option<PairingCode>,
        writes: usize,
        disks: (MemoryDisk, MemoryDisk),
    ) {
        let writes = Writes::new(writes);
        let path = self.folder.path().join("cucs/a0.key");
        let keys = KeyStore::open_on(&path, Box::new(writes.clone())).unwrap();
        let (store, stamps) = disks;
        let mut store = Records(store, writes.clone());
        let mut files = CucsFiles {
            store: &mut store,
            records: None,
            keys: &keys,
        };
        let own = self.identities[1].duplicate();
        let end = CucsEnd::new((CUCS, VSM), own, code, self.clock(), &mut files).unwrap();
        let mut cucs = Cucs {
            end,
            keys,
            guard: None,
            store,
            stamps,
            writes,
        };
        cucs.take_keys(self.clock());
        self.cucs = Some(cucs);
    }

    fn stop_cucs(&mut self) -> (MemoryDisk, MemoryDisk) {
        let stopped = self.cucs.take();
        stopped.map_or_else(Default::default, |cucs| (cucs.store.0, cucs.stamps))
    }

    /// `vsm guard run`.
    pub(super) fn restart_cucs(&mut self, writes: usize) {
        let disks = self.stop_cucs();
        self.start_cucs(None, writes, disks);
    }

    /// `vsm guard pair` with this code.
    pub(super) fn pair_cucs(&mut self, code: PairingCode, writes: usize) {
        let disks = self.stop_cucs();
        self.start_cucs(Some(code), writes, disks);
    }

    /// `vsm guard pair` at the VSM.
    pub(super) fn open_window(&mut self) -> bool {
        let (now, code) = (self.now, self.code.duplicate());
        let Some(vsm) = &mut self.vsm else {
            return false;
        };
        let opened = vsm.end.open_window(now, CUCS, &code, &mut vsm.files);
        if opened.is_ok() {
            vsm.files.set_pairing(true);
        }
        opened.is_ok()
    }

    /// `vsm guard rotate --cucs`.
    pub(super) fn rotate(&mut self) {
        let now = self.clock();
        let vsm = self.vsm.as_mut().unwrap();
        let please = vsm.end.please(now.mono, CUCS).expect("it is paired");
        let mut out = [0; MAX_GUARDED];
        let guard = vsm.guard.as_mut().unwrap();
        let length = guard.seal(now, &please, &mut out, &mut vsm.stamps).unwrap();
        self.send(Direction::ToCucs, out[..length].to_vec());
    }

    /// The same keys at both ends, none that waits, and each knows the other.
    pub(super) fn is_settled(&self) -> bool {
        let (Some(vsm), Some(cucs)) = (&self.vsm, &self.cucs) else {
            return false;
        };
        let of = |keys: &KeyStore| keys.current().unwrap().map(|key| key.id());
        let vsm_key = vsm.files.memory().unwrap().current;
        vsm_key.is_some()
            && vsm_key == of(&cucs.keys)
            && cucs.keys.next().unwrap().is_none()
            && cucs.end.peer() == Some(self.identities[0].public())
            && vsm.files.peer() == Some(self.identities[1].public())
            && !cucs.end.is_busy()
            && cucs.guard.as_ref().and_then(GuardEnd::in_force) == vsm_key
            && vsm.guard.as_ref().and_then(GuardEnd::in_force) == vsm_key
    }

    pub(super) fn key(&self) -> Option<KeyId> {
        self.vsm.as_ref().unwrap().files.memory().unwrap().current
    }

    pub(super) fn cucs_has_next(&self) -> bool {
        let cucs = self.cucs.as_ref().unwrap();
        cucs.keys.next().unwrap().is_some()
    }

    /// Lets time pass, at most so many seconds.
    pub(super) fn run_until(&mut self, seconds: u64, done: impl Fn(&World) -> bool) -> bool {
        let end = self.now + Duration::from_secs(seconds);
        while self.now < end {
            if done(self) {
                return true;
            }
            self.now += Duration::from_millis(50);
            self.step();
        }
        done(self)
    }

    pub(super) fn run(&mut self, seconds: u64) {
        self.run_until(seconds, |_| false);
    }

    fn step(&mut self) {
        self.person();
        self.deliver();
        self.run_ends();
        self.speak();
        self.revive();
    }

    /// Nobody stands at the ends but a person who sees that they are not paired.
    fn person(&mut self) {
        if self.person_at.is_none_or(|at| at > self.now) {
            return;
        }
        self.person_at = Some(self.now + Duration::from_secs(30));
        let pinned = self
            .vsm
            .as_ref()
            .is_some_and(|vsm| vsm.files.peer().is_some());
        let proven = self
            .cucs
            .as_ref()
            .is_some_and(|cucs| cucs.end.peer().is_some());
        if pinned && proven {
            self.person_at = None;
            return;
        }
        self.open_window();
        if !proven {
            let code = self.code.duplicate();
            self.pair_cucs(code, usize::MAX);
        }
    }

    /// A process that has ended is started again.
    fn revive(&mut self) {
        if self.vsm.as_ref().is_some_and(|vsm| vsm.writes.are_over()) {
            self.restart_vsm(usize::MAX);
        }
        if self
            .cucs
            .as_ref()
            .is_some_and(|cucs| cucs.writes.are_over())
        {
            self.restart_cucs(usize::MAX);
        }
    }

    pub(super) fn send(&mut self, way: Direction, bytes: Vec<u8>) {
        let is_step = ExchangeDatagram::parse(&bytes).is_some();
        self.tape.push((way, bytes.clone()));
        if is_step {
            self.steps += 1;
            if self.lose == Some(self.steps) {
                return;
            }
        }
        if self.dice.0.u32(0..100) < self.loss {
            return;
        }
        let copies = 1 + u32::from(self.dice.0.u32(0..100) < self.double);
        for _ in 0..copies {
            let late = Duration::from_millis(self.dice.0.u64(10..60));
            self.under_way
                .push_back((self.now + late, way, bytes.clone()));
        }
    }

    fn deliver(&mut self) {
        let now = self.now;
        let (due, later) = self.under_way.drain(..).partition(|(at, ..)| *at <= now);
        self.under_way = later;
        for (_, way, bytes) in Vec::from(due) {
            match way {
                Direction::ToVsm => drop(self.arrive_at_vsm(AT.into(), &bytes)),
                _ => self.arrive_at_cucs(&bytes),
            }
        }
    }

    /// As the bridge and its thread take it; whether something of the CUCS was taken.
    pub(super) fn arrive_at_vsm(&mut self, from: SocketAddr, bytes: &[u8]) -> bool {
        let (now, mut random) = (self.clock(), self.dice.another());
        let Some(vsm) = &mut self.vsm else {
            return false;
        };
        let (Some(guarded), Some(guard)) = (Guarded::parse(bytes), &mut vsm.guard) else {
            if let Some(step) = ExchangeDatagram::parse(bytes) {
                let random = &mut random.fill();
                let _ = vsm
                    .end
                    .handle(now.mono, from, &step, random, &mut vsm.files);
            }
            return false;
        };
        match guard.open(now, &guarded, &mut vsm.stamps) {
            Ok([]) => false,
            Ok(inside) => {
                assert_eq!(inside, b"status, please");
                self.taken += 1;
                true
            }
            Err(_) => {
                self.refused += 1;
                false
            }
        }
    }

    /// As the guard takes it.
    pub(super) fn arrive_at_cucs(&mut self, bytes: &[u8]) {
        let now = self.clock();
        let Some(cucs) = &mut self.cucs else { return };
        let Cucs {
            end,
            keys,
            guard,
            store,
            stamps,
            ..
        } = cucs;
        let mut files = CucsFiles {
            store,
            records: None,
            keys,
        };
        let (Some(guarded), Some(guard)) = (Guarded::parse(bytes), guard) else {
            if let Some(step) = ExchangeDatagram::parse(bytes) {
                let _ = end.handle(now, false, &step, &mut files);
            }
            return;
        };
        let opened = guard.open_from(now, &guarded, (AT.into(), None), stamps);
        let Ok((inside, key)) = opened else { return };
        end.key_in_use(now, key, &mut files);
        match ExchangeDatagram::parse(inside) {
            Some(step) => drop(end.handle(now, true, &step, &mut files)),
            None if inside.is_empty() => {}
            None => self.answered += 1,
        }
    }

    fn run_ends(&mut self) {
        let (now, mut random) = (self.clock(), self.dice.another());
        let mut out = Vec::new();
        if let Some(vsm) = &mut self.vsm {
            vsm.end.handle_timeout(now.mono);
            let mut keyed = false;
            while let Some((_, news)) = vsm.end.poll_news() {
                keyed |= matches!(news, VsmNews::Agreed(_));
                if matches!(news, VsmNews::Paired(_) | VsmNews::Closed) {
                    vsm.files.set_pairing(false);
                }
                self.news.push(news);
            }
            if keyed {
                vsm.take_keys(now);
            }
            // A process that has ended answers nothing.
            while let Some((to, bytes)) = vsm.end.poll_transmit() {
                if !vsm.writes.are_over() && to == AT.into() {
                    out.push((Direction::ToCucs, bytes));
                }
            }
        }
        if let Some(cucs) = &mut self.cucs {
            let Cucs {
                end, keys, store, ..
            } = cucs;
            let mut files = CucsFiles {
                store,
                records: None,
                keys,
            };
            end.handle_timeout(now, &mut random.fill(), &mut files);
            let mut keyed = false;
            while let Some(news) = cucs.end.poll_news() {
                keyed |= !matches!(news, CucsNews::NotAnswered | CucsNews::Rejected(_));
                self.cucs_news.push(news);
            }
            if keyed {
                cucs.take_keys(now);
            }
            while let Some(step) = cucs.end.poll_transmit() {
                if !cucs.writes.are_over() {
                    out.push((Direction::ToVsm, step));
                }
            }
            if cucs.end.takes_probe(now.mono)
                && let Ok(Some(next)) = cucs.keys.next()
                && let Some(guard) = &mut cucs.guard
            {
                let mut bytes = [0; MAX_GUARDED];
                let length = guard.probe(next.id(), now, &mut bytes, &mut cucs.stamps);
                out.extend(length.map(|length| (Direction::ToVsm, bytes[..length].to_vec())));
            }
        }
        for (way, bytes) in out {
            self.send(way, bytes);
        }
    }

    /// The CUCS asks five times a second, and is sent status as often.
    fn speak(&mut self) {
        if self.speak_at > self.now {
            return;
        }
        self.speak_at = self.now + Duration::from_millis(200);
        let now = self.clock();
        let mut out = Vec::new();
        let mut bytes = [0; MAX_GUARDED];
        if let Some(Cucs {
            guard: Some(guard),
            stamps,
            ..
        }) = &mut self.cucs
            && let Ok(length) = guard.seal(now, b"status, please", &mut bytes, stamps)
        {
            out.push((Direction::ToVsm, bytes[..length].to_vec()));
        }
        if let Some(Vsm {
            guard: Some(guard),
            stamps,
            ..
        }) = &mut self.vsm
            && let Ok(length) = guard.seal(now, b"status", &mut bytes, stamps)
        {
            out.push((Direction::ToCucs, bytes[..length].to_vec()));
        }
        for (way, bytes) in out {
            self.send(way, bytes);
        }
    }
}

impl Vsm {
    fn take_keys(&mut self, now: Now) {
        let keys = match guard_file::read(self.files.path(), now) {
            Ok(keys) => keys,
            Err(_) => return,
        };
        set(
            &mut self.guard,
            (VSM, CUCS),
            Direction::ToCucs,
            keys,
            now,
            &mut self.stamps,
        );
    }
}

impl Cucs {
    fn take_keys(&mut self, now: Now) {
        let keys = [self.keys.current(), self.keys.next()];
        let keys: Vec<SigningKey> = keys.into_iter().filter_map(|key| key.unwrap()).collect();
        let mut keys: Vec<GuardKeyUntil> = keys.into_iter().map(|key| (key, None)).collect();
        let known = |id| self.guard.as_ref().is_some_and(|guard| guard.has(id));
        if let Some(before) = self.keys.previous().unwrap()
            && known(before.id())
        {
            keys.push((before, Some(now.mono + Duration::from_secs(60))));
        }
        if !keys.is_empty() {
            set(
                &mut self.guard,
                (CUCS, VSM),
                Direction::ToVsm,
                keys,
                now,
                &mut self.stamps,
            );
        }
    }
}

fn set(
    guard: &mut Option<GuardEnd>,
    ids: (Id, Id),
    sends: Direction,
    keys: Vec<GuardKeyUntil>,
    now: Now,
    stamps: &mut MemoryDisk,
) {
    match guard {
        Some(guard) => guard.set_keys(keys, Duration::ZERO, now, stamps).unwrap(),
        None => {
            let made = GuardEnd::new(ids, sends, keys, Duration::ZERO, now, stamps);
            *guard = Some(made.unwrap());
        }
    }
}
