//! What the threads leave on a disk that fails, and after a power cut.

use std::collections::HashMap;
use std::ffi::OsString;
use std::fs::File;
use std::os::fd::AsRawFd as _;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex};

use super::*;
use crate::shell::disk::{Added, FileSystem, NativeFileSystem, OpenError};

fn disk(folder: &Path) -> QueuedDisk {
    let disk = FileDisk::open(folder).expect("a store");
    QueuedDisk::new(disk, Arc::new(Notify::new())).expect("a thread")
}

/// Makes a change; its progress as soon as that is no longer [`Progress::Waiting`].
fn outcome(disk: &mut QueuedDisk, change: impl FnOnce(&mut QueuedDisk)) -> Progress {
    let after = disk.queued();
    change(disk);
    let until = disk.queued();
    wait(disk, Changes { after, until })
}

fn wait(disk: &mut QueuedDisk, of: Changes) -> Progress {
    let end = Instant::now() + Duration::from_secs(20);
    while disk.progress(of) == Progress::Waiting && Instant::now() < end {
        disk.poll();
        std::thread::sleep(Duration::from_millis(2));
    }
    disk.progress(of)
}

fn save(name: &'static str) -> impl FnOnce(&mut QueuedDisk) {
    move |disk| {
        disk.replace(name, name.as_bytes(), Durability::Power)
            .unwrap();
    }
}

#[test]
fn one_record_that_became_a_folder_holds_back_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let store = folder.path().join("state");
    let mut disk = disk(&store);
    std::fs::create_dir(store.join("authority-1.json")).unwrap();
    let after = disk.queued();
    save("authority-1.json")(&mut disk);
    let stuck = Changes {
        after,
        until: disk.queued(),
    };
    // Side by side, and once the fault is known.
    for _ in 0..2 {
        let clock = outcome(&mut disk, save("clock-0102030405060708"));
        assert_eq!(clock, Progress::Durable);
        assert_eq!(
            outcome(&mut disk, save("authority-2.json")),
            Progress::Durable
        );
        let line = outcome(&mut disk, |disk| {
            disk.append("audit-2.log", b"line", Durability::Power)
                .unwrap();
        });
        assert_eq!(line, Progress::Durable);
        assert_eq!(wait(&mut disk, stuck), Progress::Failing);
        // What is refused never takes effect.
        disk.replace("authority-1.json", b"3", Durability::Power)
            .unwrap_err();
    }
    // What was taken does, as soon as it can.
    std::fs::remove_dir(store.join("authority-1.json")).unwrap();
    assert!(!disk.wait(Duration::ZERO));
    let end = Instant::now() + Duration::from_secs(20);
    while disk.progress(stuck) != Progress::Durable && Instant::now() < end {
        disk.poll();
        std::thread::sleep(Duration::from_millis(10));
    }
    assert!(disk.wait(Duration::ZERO));
    let written = std::fs::read(store.join("authority-1.json")).unwrap();
    assert_eq!(written, b"authority-1.json");
    assert_eq!(
        outcome(&mut disk, save("authority-1.json")),
        Progress::Durable
    );
}

/// A disk that fails as Linux reports it: what a failed synchronisation could not write counts as written from then on, and
/// the next one succeeds without it. Files are on a real disk; this knows what of them a power cut would leave.
#[derive(Debug, Clone, Default)]
struct Forgetful(Arc<Mutex<Platter>>);

#[derive(Debug, Default)]
struct Platter {
    /// Synchronisations of files fail, or those of the folder.
    files_fail: bool,
    folder_fails: bool,
    /// Other nodes begin with what is stored.
    shared: bool,
    /// By inode: up to where memory counts as written, and what was.
    files: HashMap<u64, (usize, Vec<u8>)>,
    names: BTreeMap<OsString, u64>,
    /// The names that count as written.
    clean: BTreeMap<OsString, u64>,
    /// Open, so that no inode is used twice.
    held: Vec<File>,
    /// The thread of each file that was created, renamed or deleted.
    writers: Vec<Option<String>>,
}

impl Forgetful {
    fn set(&self, change: impl FnOnce(&mut Platter)) {
        change(&mut self.0.lock().unwrap());
    }

    fn note_writer(&self) {
        let thread = std::thread::current();
        let name = thread.name().map(str::to_owned);
        self.set(|platter| platter.writers.push(name));
    }

    /// What a power cut would leave of a file.
    fn left(&self, name: &str) -> Option<Vec<u8>> {
        let platter = self.0.lock().unwrap();
        let inode = platter.names.get(&OsString::from(name))?;
        Some(platter.files.get(inode)?.1.clone())
    }

    fn sync_file(&self, file: File, path: &Path) -> io::Result<()> {
        let inode = file.metadata()?.ino();
        let mut platter = self.0.lock().unwrap();
        // The thread of a disk that was dropped may be at it too: what it has read before would replace what is newer.
        let content = std::fs::read(path)?;
        let fails = platter.files_fail;
        platter.held.push(file);
        let (clean, written) = platter.files.entry(inode).or_default();
        let from = std::mem::replace(clean, content.len());
        if fails {
            return Err(io::Error::other("Input/output error"));
        }
        written.resize(content.len(), 0);
        written[from.min(content.len())..].copy_from_slice(&content[from.min(content.len())..]);
        Ok(())
    }
}

fn names(folder: &Path) -> io::Result<BTreeMap<OsString, u64>> {
    let entries = std::fs::read_dir(folder)?;
    entries
        .map(|one| one.and_then(|one| Ok((one.file_name(), one.metadata()?.ino()))))
        .collect()
}

impl FileSystem for Forgetful {
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        // The folder has changed, even where the name goes again.
        self.set(|platter| platter.clean.clear());
        self.note_writer();
        NativeFileSystem.write(path, bytes)
    }

    fn add(&self, path: &Path, bytes: &[u8]) -> io::Result<Added> {
        let added = NativeFileSystem.add(path, bytes)?;
        if added.new {
            self.note_writer();
        }
        Ok(added)
    }

    fn sync(&self, path: &Path) -> io::Result<()> {
        if !path.is_dir() {
            return self.sync_file(File::open(path)?, path);
        }
        let now = names(path)?;
        let mut platter = self.0.lock().unwrap();
        let dirty = platter.clean != now;
        platter.clean.clone_from(&now);
        if platter.folder_fails {
            return Err(io::Error::other("Input/output error"));
        }
        if dirty {
            platter.names = now;
        }
        Ok(())
    }

    fn sync_open(&self, file: &File) -> io::Result<()> {
        let path = format!("/proc/self/fd/{}", file.as_raw_fd());
        self.sync_file(file.try_clone()?, Path::new(&path))
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.note_writer();
        NativeFileSystem.rename(from, to)
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        self.note_writer();
        NativeFileSystem.remove(path)
    }

    fn read(&self, path: &Path, most: u64) -> io::Result<Option<Zeroizing<Vec<u8>>>> {
        NativeFileSystem.read(path, most)
    }

    fn is_shared(&self) -> bool {
        self.0.lock().unwrap().shared
    }
}

fn on(folder: &Path, system: &Forgetful) -> QueuedDisk {
    let disk = free(folder, || Box::new(system.clone()));
    QueuedDisk::new(disk, Arc::new(Notify::new())).expect("a thread")
}

/// The store, once no thread of a disk that was dropped is at a change any more.
fn free(folder: &Path, system: impl Fn() -> Box<dyn FileSystem>) -> FileDisk {
    let end = Instant::now() + Duration::from_secs(20);
    loop {
        match FileDisk::open_on(folder, system()) {
            Err(OpenError::Locked { .. }) if Instant::now() < end => {
                std::thread::sleep(LOOK_AGAIN);
            }
            opened => return opened.expect("a store"),
        }
    }
}

fn line(name: &'static str, text: &'static str) -> impl FnOnce(&mut QueuedDisk) {
    move |disk| {
        disk.append(name, text.as_bytes(), Durability::Power)
            .unwrap();
    }
}

fn heal(disk: &mut QueuedDisk) {
    let end = Instant::now() + Duration::from_secs(20);
    while !disk.wait(Duration::from_millis(10)) && Instant::now() < end {
        std::thread::sleep(LOOK_AGAIN);
    }
    assert!(disk.wait(Duration::ZERO));
    disk.poll();
    assert_eq!(disk.failing(), None);
}

#[test]
fn a_log_that_could_not_be_synchronised_is_written_whole_before_its_lines_count() {
    let (folder, system) = (tempfile::tempdir().unwrap(), Forgetful::default());
    let mut disk = on(&folder.path().join("state"), &system);
    assert_eq!(
        outcome(&mut disk, line("audit-1.log", "1\n")),
        Progress::Durable
    );
    assert_eq!(
        outcome(&mut disk, line("audit-1.log", "2\n")),
        Progress::Durable
    );
    assert_eq!(system.left("audit-1.log").unwrap(), b"1\n2\n");

    system.set(|platter| platter.files_fail = true);
    let after = disk.queued();
    line("audit-1.log", "3\n")(&mut disk);
    // Before it is known that the disk fails.
    line("audit-1.log", "4\n")(&mut disk);
    disk.replace("authority-1.json", b"of 4", Durability::Power)
        .unwrap();
    let taken = Changes {
        after,
        until: disk.queued(),
    };
    assert_eq!(wait(&mut disk, taken), Progress::Failing);
    assert_eq!(disk.failing().unwrap().name, "audit-1.log");
    disk.append("audit-1.log", b"refused\n", Durability::Power)
        .unwrap_err();
    disk.append("audit-1.log", b"5\n", Durability::Process)
        .unwrap();
    disk.rotate("audit-1.log", 2).unwrap_err();
    assert_eq!(
        **disk.read("audit-1.log", 99).unwrap().unwrap(),
        *b"1\n2\n3\n4\n5\n"
    );

    system.set(|platter| platter.files_fail = false);
    let end = Instant::now() + Duration::from_secs(20);
    while disk.progress(taken) != Progress::Durable && Instant::now() < end {
        disk.poll();
        // A record is never there without its line.
        if system.left("authority-1.json").is_some() {
            assert!(
                system
                    .left("audit-1.log")
                    .unwrap()
                    .starts_with(b"1\n2\n3\n4\n")
            );
        }
        std::thread::sleep(LOOK_AGAIN);
    }
    heal(&mut disk);
    assert_eq!(system.left("authority-1.json").unwrap(), b"of 4");
    assert_eq!(
        outcome(&mut disk, line("audit-1.log", "6\n")),
        Progress::Durable
    );
    assert_eq!(system.left("audit-1.log").unwrap(), b"1\n2\n3\n4\n5\n6\n");
}

#[test]
fn a_record_of_a_shared_store_waits_for_the_line_of_its_log_whatever_it_must_survive() {
    let (folder, system) = (tempfile::tempdir().unwrap(), Forgetful::default());
    system.set(|platter| platter.shared = true);
    let mut disk = on(&folder.path().join("state"), &system);
    let first = line("audit-1.log", "1\n");
    assert_eq!(outcome(&mut disk, first), Progress::Durable);

    system.set(|platter| platter.files_fail = true);
    // As a right to monitor is stored: its loss commands nothing.
    disk.append("audit-1.log", b"2\n", Durability::Process)
        .unwrap();
    disk.replace("authority-1.json", b"of 2", Durability::Process)
        .unwrap();
    // Whatever is stored next would take it along, and another node would find it without its line.
    let record = folder.path().join("state/authority-1.json");
    assert!(!record.exists());
    let read = disk.read("authority-1.json", 100).unwrap().unwrap();
    assert_eq!(read.as_slice(), b"of 2", "this process reads it");

    system.set(|platter| platter.files_fail = false);
    heal(&mut disk);
    assert_eq!(system.left("audit-1.log").unwrap(), b"1\n2\n");
    assert_eq!(system.left("authority-1.json").unwrap(), b"of 2");
}

#[test]
fn a_log_that_was_put_aside_while_its_synchronisation_failed_is_written_whole_there() {
    let (folder, system) = (tempfile::tempdir().unwrap(), Forgetful::default());
    let mut disk = on(&folder.path().join("state"), &system);
    assert_eq!(outcome(&mut disk, line("log", "1\n")), Progress::Durable);
    system.set(|platter| platter.files_fail = true);
    line("log", "2\n")(&mut disk);
    disk.rename("log", "log.1").unwrap();
    line("log", "3\n")(&mut disk);
    assert!(!disk.wait(Duration::from_secs(2)));
    system.set(|platter| platter.files_fail = false);
    heal(&mut disk);
    assert_eq!(system.left("log.1").unwrap(), b"1\n2\n");
    assert_eq!(system.left("log").unwrap(), b"3\n");
}

#[test]
fn nobody_but_its_thread_writes_what_a_link_lives_by() {
    let (folder, system) = (tempfile::tempdir().unwrap(), Forgetful::default());
    let mut disk = on(&folder.path().join("state"), &system);
    for link in ["clock-0102030405060708", "encrypted-1b000101"] {
        // A new one is refused at once by a full disk.
        assert_eq!(outcome(&mut disk, save(link)), Progress::Durable);
        system.set(|platter| platter.writers.clear());
        for _ in 0..3 {
            let newer = outcome(&mut disk, |disk| {
                disk.replace(link, b"1", Durability::Power).unwrap();
                disk.replace(link, b"2", Durability::Power).unwrap();
            });
            assert_eq!(newer, Progress::Durable);
        }
        let writers = std::mem::take(&mut system.0.lock().unwrap().writers);
        assert!(!writers.is_empty());
        for writer in writers {
            assert_eq!(writer.as_deref(), Some("clock-writer"));
        }
        assert_eq!(system.left(link).unwrap(), b"2");
    }
}

#[test]
fn nobody_but_the_threads_creates_renames_or_deletes_a_file() {
    let (folder, system) = (tempfile::tempdir().unwrap(), Forgetful::default());
    let store = folder.path().join("state");
    let mut disk = on(&store, &system);
    // As a start leaves it.
    let commands = "commands-1.log";
    disk.append(commands, b"1\n", Durability::Process).unwrap();
    system.set(|platter| platter.writers.clear());
    for durability in [Durability::Answered, Durability::Power] {
        for name in ["authority-1.json", "clock-0102030405060708"] {
            disk.replace(name, b"1", durability).unwrap();
            disk.replace(name, b"2", durability).unwrap();
        }
        for line in ["1\n", "2\n"] {
            disk.append("audit-1.log", line.as_bytes(), durability)
                .unwrap();
            disk.rotate("audit-1.log", 2).unwrap();
        }
        disk.remove("plan-1.log").unwrap();
        // Behind a change of the same files, though it would be written at once otherwise.
        disk.replace("plan-1.log", b"1", Durability::Process)
            .unwrap();
    }
    disk.append(commands, b"2\n", Durability::Process).unwrap();
    disk.compact(commands, b"12\n").unwrap();
    heal(&mut disk);
    let writers = std::mem::take(&mut system.0.lock().unwrap().writers);
    assert!(writers.len() > 10, "{writers:?}");
    for writer in writers {
        let name = writer.as_deref();
        assert!(
            [Some("clock-writer"), Some("disk-writer")].contains(&name),
            "{name:?}"
        );
    }
    let read = |name: &str| std::fs::read_to_string(store.join(name)).unwrap();
    assert_eq!(read("authority-1.json"), "2");
    assert_eq!(read("plan-1.log"), "1");
    assert_eq!(read(commands), "12\n");
    assert!(!store.join("audit-1.log").exists());
    // Of four, two are kept.
    assert_eq!(
        (read("audit-1.log.1"), read("audit-1.log.2")),
        ("2\n".into(), "1\n".into())
    );
}

#[test]
fn what_only_an_answer_follows_is_in_its_file_and_not_synchronised() {
    let (folder, system) = (tempfile::tempdir().unwrap(), Forgetful::default());
    let store = folder.path().join("state");
    let mut disk = on(&store, &system);
    let (log, record) = ("audit-monitors-1.log", "authority-1.json");
    let answered = outcome(&mut disk, |disk| {
        disk.append(log, b"1\n", Durability::Answered).unwrap();
        disk.replace(record, b"1", Durability::Answered).unwrap();
    });
    assert_eq!(answered, Progress::Durable);
    let read = |name: &str| std::fs::read_to_string(store.join(name)).unwrap();
    assert_eq!((read(log), read(record)), ("1\n".into(), "1".into()));
    assert_eq!((system.left(log), system.left(record)), (None, None));
    // What must survive a power cut takes what was before with it.
    assert_eq!(outcome(&mut disk, save(record)), Progress::Durable);
    assert_eq!(outcome(&mut disk, line(log, "2\n")), Progress::Durable);
    assert_eq!(system.left(record).unwrap(), record.as_bytes());
    assert_eq!(system.left(log).unwrap(), b"1\n2\n");
}

#[test]
fn a_power_cut_leaves_no_file_empty_that_was_replaced_for_an_answer_or_made_shorter() {
    let (folder, system) = (tempfile::tempdir().unwrap(), Forgetful::default());
    let mut disk = on(&folder.path().join("state"), &system);
    let (record, commands) = ("authority-1.json", "commands-1.log");
    assert_eq!(outcome(&mut disk, save(record)), Progress::Durable);
    let replaced = outcome(&mut disk, |disk| {
        disk.replace(record, b"2", Durability::Answered).unwrap();
    });
    assert_eq!(replaced, Progress::Durable);
    // Its name may reach the disk at any time: here with another file's.
    assert_eq!(
        outcome(&mut disk, save("altimeter-1.json")),
        Progress::Durable
    );
    assert_eq!(system.left(record).unwrap(), b"2");
    disk.append(commands, b"long 1\n2\n", Durability::Process)
        .unwrap();
    disk.compact(commands, b"1\n2\n").unwrap();
    heal(&mut disk);
    assert_eq!(
        outcome(&mut disk, save("altimeter-1.json")),
        Progress::Durable
    );
    assert_eq!(system.left(commands).unwrap(), b"1\n2\n");
}

#[test]
fn lines_of_a_log_that_is_put_aside_while_they_wait_are_where_they_belong() {
    let (folder, system) = (tempfile::tempdir().unwrap(), Forgetful::default());
    let mut disk = on(&folder.path().join("state"), &system);
    let lines = ["1\n", "2\n", "3\n"];
    for (number, text) in lines.into_iter().enumerate() {
        if number == 1 {
            // From here on nothing is synchronised, and it is not known yet.
            system.set(|platter| (platter.files_fail, platter.folder_fails) = (true, true));
        }
        line("audit-1.log", text)(&mut disk);
        disk.rotate("audit-1.log", 8).unwrap();
    }
    line("audit-1.log", "4\n")(&mut disk);
    assert!(!disk.wait(Duration::from_secs(2)));
    system.set(|platter| (platter.files_fail, platter.folder_fails) = (false, false));
    heal(&mut disk);
    for (number, text) in lines.into_iter().rev().enumerate() {
        let name = format!("audit-1.log.{}", number + 1);
        assert_eq!(system.left(&name).unwrap(), text.as_bytes(), "{name}");
    }
    assert_eq!(system.left("audit-1.log").unwrap(), b"4\n");
}

#[test]
fn names_that_could_not_be_synchronised_are_written_again() {
    let (folder, system) = (tempfile::tempdir().unwrap(), Forgetful::default());
    let mut disk = on(&folder.path().join("state"), &system);
    assert_eq!(outcome(&mut disk, line("log", "1\n")), Progress::Durable);
    system.set(|platter| platter.folder_fails = true);
    let moved = outcome(&mut disk, |disk| disk.rename("log", "log.1").unwrap());
    assert_eq!(moved, Progress::Failing);
    system.set(|platter| platter.folder_fails = false);
    heal(&mut disk);
    assert_eq!(system.left("log"), None);
    assert_eq!(system.left("log.1").unwrap(), b"1\n");
}

#[test]
fn a_start_trusts_no_log_of_the_process_before() {
    let (folder, system) = (tempfile::tempdir().unwrap(), Forgetful::default());
    let store = folder.path().join("state");
    let mut disk = on(&store, &system);
    assert_eq!(outcome(&mut disk, line("log", "1\n")), Progress::Durable);
    system.set(|platter| platter.files_fail = true);
    assert_eq!(outcome(&mut disk, line("log", "2\n")), Progress::Failing);
    drop(disk);
    system.set(|platter| platter.files_fail = false);
    let mut disk = on(&store, &system);
    // What it reads, and so builds on, is not on the disk.
    assert_eq!(**disk.read("log", 99).unwrap().unwrap(), *b"1\n2\n");
    assert_eq!(outcome(&mut disk, line("log", "3\n")), Progress::Durable);
    assert_eq!(system.left("log").unwrap(), b"1\n2\n3\n");
}

#[test]
fn a_line_that_is_refused_is_not_in_the_log() {
    let (folder, system) = (tempfile::tempdir().unwrap(), Forgetful::default());
    let store = folder.path().join("state");
    let mut disk = FileDisk::open_on(&store, Box::new(system.clone())).expect("a store");
    disk.append("log", b"1\n", Durability::Power).unwrap();
    system.set(|platter| platter.files_fail = true);
    disk.append("log", b"2\n", Durability::Power).unwrap_err();
    assert_eq!(std::fs::read(store.join("log")).unwrap(), b"1\n");
}

/// A disk that has no room for a new file, nor for more of a log, once it is full; what its synchronisations and renames wait
/// for; and whether something else takes its room just now, so that there seems to be some.
#[derive(Debug, Clone, Default)]
struct Full(Arc<AtomicBool>, Arc<Mutex<()>>, Arc<AtomicBool>);

impl FileSystem for Full {
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        if self.0.load(Ordering::Relaxed) {
            return Err(io::ErrorKind::StorageFull.into());
        }
        NativeFileSystem.write(path, bytes)
    }

    fn check_room(&self, _: &Path, bytes: u64) -> io::Result<()> {
        let is_full = self.0.load(Ordering::Relaxed) && !self.2.load(Ordering::Relaxed);
        match is_full && bytes > 0 {
            true => Err(io::ErrorKind::StorageFull.into()),
            false => Ok(()),
        }
    }

    fn write_over(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        NativeFileSystem.write_over(path, bytes)
    }

    fn sync(&self, path: &Path) -> io::Result<()> {
        let _turn = self.1.lock().unwrap();
        NativeFileSystem.sync(path)
    }

    // As a file server finds it, which has taken the line.
    fn sync_open(&self, file: &File) -> io::Result<()> {
        if self.0.load(Ordering::Relaxed) {
            return Err(io::ErrorKind::StorageFull.into());
        }
        NativeFileSystem.sync_open(file)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        let _turn = self.1.lock().unwrap();
        NativeFileSystem.rename(from, to)
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        NativeFileSystem.remove(path)
    }

    fn read(&self, path: &Path, most: u64) -> io::Result<Option<Zeroizing<Vec<u8>>>> {
        NativeFileSystem.read(path, most)
    }
}

#[test]
fn a_log_that_a_full_disk_does_not_take_holds_back_nothing_that_a_link_lives_by() {
    const LINKS: [&str; 2] = ["clock-0102030405060708", "encrypted-1b000101"];
    let (folder, system) = (tempfile::tempdir().unwrap(), Full::default());
    let store = FileDisk::open_on(&folder.path().join("state"), Box::new(system.clone()));
    let store = store.expect("a store");
    let mut disk = QueuedDisk::new(store, Arc::new(Notify::new())).expect("a thread");
    for link in LINKS {
        assert_eq!(outcome(&mut disk, save(link)), Progress::Durable);
    }
    let first = line("audit-1.log", "1\n");
    assert_eq!(outcome(&mut disk, first), Progress::Durable);

    // All of it gathers behind this one, and is written together.
    let turn = system.1.lock().unwrap();
    save("plan-1.json")(&mut disk);
    system.0.store(true, Ordering::Relaxed);
    system.2.store(true, Ordering::Relaxed);
    let after = disk.queued();
    line("audit-1.log", "2\n")(&mut disk);
    let log = Changes {
        after,
        until: disk.queued(),
    };
    for link in LINKS {
        save(link)(&mut disk);
    }
    let links = Changes {
        after: log.until,
        until: disk.queued(),
    };
    drop(turn);
    assert_eq!(wait(&mut disk, log), Progress::Failing);
    assert_eq!(wait(&mut disk, links), Progress::Durable);
}

#[test]
fn a_full_disk_refuses_every_change_but_those_that_no_link_works_without() {
    const CLOCK: &str = "clock-0102030405060708";
    const LINK: &str = "encrypted-1b000101";
    let (folder, system) = (tempfile::tempdir().unwrap(), Full::default());
    let open = |name: &str| {
        let disk = FileDisk::open_on(&folder.path().join(name), Box::new(system.clone()));
        disk.expect("a store")
    };
    let put = |name: &'static str, text: &'static str| {
        move |disk: &mut QueuedDisk| {
            disk.replace(name, text.as_bytes(), Durability::Power)
                .unwrap();
        }
    };
    let mut disk = QueuedDisk::new(open("state"), Arc::new(Notify::new())).expect("a thread");
    // As the guard of a CUCS has it.
    let mut plain = open("guard");
    for (name, text) in [(CLOCK, "100\n"), (LINK, "12 7\n")] {
        assert_eq!(outcome(&mut disk, put(name, text)), Progress::Durable);
        plain
            .replace(name, text.as_bytes(), Durability::Power)
            .unwrap();
    }

    system.0.store(true, Ordering::Relaxed);
    // The clock of a new key has no place yet.
    for name in ["authority-1b000101.json", "clock-0807060504030201"] {
        disk.replace(name, b"1\n", Durability::Power).unwrap_err();
        plain.replace(name, b"1\n", Durability::Power).unwrap_err();
    }
    disk.append("audit-1b000101.log", b"1\n", Durability::Power)
        .unwrap_err();
    for (name, text, left) in [
        (CLOCK, "200\n", "200\n"),
        (CLOCK, "1000\n", "1000\n"),
        (LINK, "1 8\n", "1 8\n\n"),
    ] {
        assert_eq!(outcome(&mut disk, put(name, text)), Progress::Durable);
        plain
            .replace(name, text.as_bytes(), Durability::Power)
            .unwrap();
        for store in ["state", "guard"] {
            let path = folder.path().join(store).join(name);
            assert_eq!(std::fs::read_to_string(path).unwrap(), left, "{store}");
        }
    }
    assert_eq!(disk.failing(), None);

    system.0.store(false, Ordering::Relaxed);
    assert_eq!(outcome(&mut disk, put(CLOCK, "1100\n")), Progress::Durable);
    let left = names(&folder.path().join("state")).unwrap();
    let left: Vec<OsString> = left.into_keys().collect();
    assert_eq!(left, [CLOCK, LINK, "lock"]);
}

/// A disk on which so many more synchronisations end; `None`: each of them.
#[derive(Debug, Clone, Default)]
struct Hanging(Arc<(Mutex<Option<usize>>, Condvar)>);

impl Hanging {
    fn leave(&self, turns: Option<usize>) {
        *self.0.0.lock().unwrap() = turns;
        self.0.1.notify_all();
    }
}

impl FileSystem for Hanging {
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        NativeFileSystem.write(path, bytes)
    }

    fn sync(&self, _: &Path) -> io::Result<()> {
        let (turns, left) = &*self.0;
        let turns = turns.lock().unwrap();
        let mut turns = left.wait_while(turns, |turns| *turns == Some(0)).unwrap();
        *turns = turns.map(|turns| turns - 1);
        Ok(())
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        NativeFileSystem.rename(from, to)
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        NativeFileSystem.remove(path)
    }

    fn read(&self, path: &Path, most: u64) -> io::Result<Option<Zeroizing<Vec<u8>>>> {
        NativeFileSystem.read(path, most)
    }
}

#[test]
fn a_thread_that_hangs_creates_nothing_in_a_store_that_is_given_up() {
    const LINKS: [&str; 2] = ["clock-0102030405060708", "encrypted-1b000101"];
    let (folder, system) = (tempfile::tempdir().unwrap(), Hanging::default());
    let store = folder.path().join("state");
    let disk = free(&store, || Box::new(system.clone()));
    let mut disk = QueuedDisk::new(disk, Arc::new(Notify::new())).expect("a thread");
    for link in LINKS {
        assert_eq!(outcome(&mut disk, save(link)), Progress::Durable);
    }
    // Both gather behind the first one, and are written together: one after the other.
    system.leave(Some(0));
    let after = disk.queued();
    save(LINKS[0])(&mut disk);
    let until = disk.queued();
    for link in LINKS {
        save(link)(&mut disk);
    }
    // The first one's file, and the folder.
    system.leave(Some(2));
    assert_eq!(wait(&mut disk, Changes { after, until }), Progress::Durable);
    let until_shown = |is_shown: &dyn Fn() -> bool| {
        let end = Instant::now() + Duration::from_secs(20);
        while !is_shown() && Instant::now() < end {
            std::thread::sleep(LOOK_AGAIN);
        }
        assert!(is_shown());
    };
    let beside = store.join(format!("{}.new-1", LINKS[0]));
    until_shown(&|| beside.exists());

    // It hangs there, and is not waited for: the store is erased.
    drop(disk);
    let erases = free(&store, || Box::new(NativeFileSystem));
    for name in names(&store).unwrap().into_keys() {
        if name != "lock" {
            std::fs::remove_file(store.join(name)).unwrap();
        }
    }
    system.leave(None);
    until_shown(&|| Arc::strong_count(&system.0) == 1);
    let left: Vec<OsString> = names(&store).unwrap().into_keys().collect();
    assert_eq!(left, ["lock"]);
    drop(erases);
}

#[test]
fn what_was_accepted_before_the_disk_was_full_waits_for_room_and_nothing_more_is_accepted() {
    const CLOCK: &str = "clock-0102030405060708";
    let (folder, system) = (tempfile::tempdir().unwrap(), Full::default());
    let store = folder.path().join("state");
    let disk = FileDisk::open_on(&store, Box::new(system.clone())).expect("a store");
    let mut disk = QueuedDisk::new(disk, Arc::new(Notify::new())).expect("a thread");
    assert_eq!(outcome(&mut disk, save(CLOCK)), Progress::Durable);
    assert_eq!(outcome(&mut disk, save("plan-1.json")), Progress::Durable);

    system.0.store(true, Ordering::Relaxed);
    system.2.store(true, Ordering::Relaxed);
    let after = disk.queued();
    save("authority-1.json")(&mut disk);
    let accepted = Changes {
        after,
        until: disk.queued(),
    };
    assert_eq!(wait(&mut disk, accepted), Progress::Failing);
    assert_eq!(disk.failing().unwrap().name, "authority-1.json");
    // By what the thread has found, whatever room there seems to be.
    for name in ["authority-1.json", "authority-2.json"] {
        disk.replace(name, b"refused", Durability::Power)
            .unwrap_err();
    }
    disk.append("audit-2.log", b"refused\n", Durability::Power)
        .unwrap_err();
    assert_eq!(outcome(&mut disk, save(CLOCK)), Progress::Durable);
    // That makes room.
    let removed = outcome(&mut disk, |disk| disk.remove("plan-1.json").unwrap());
    assert_eq!(removed, Progress::Durable);

    system.0.store(false, Ordering::Relaxed);
    heal(&mut disk);
    assert_eq!(disk.progress(accepted), Progress::Durable);
    let written = std::fs::read(store.join("authority-1.json")).unwrap();
    assert_eq!(written, b"authority-1.json");
    assert_eq!(
        outcome(&mut disk, save("authority-2.json")),
        Progress::Durable
    );
    let left = names(&store).unwrap();
    let left: Vec<OsString> = left.into_keys().collect();
    assert_eq!(
        left,
        ["authority-1.json", "authority-2.json", CLOCK, "lock"]
    );
}

#[test]
fn a_line_is_in_its_log_whenever_the_process_ends_while_that_is_made_shorter() {
    const LOG: &str = "commands-1b0000a0.log";
    let (folder, system) = (tempfile::tempdir().unwrap(), Full::default());
    let store = folder.path().join("state");
    let disk = FileDisk::open_on(&store, Box::new(system.clone())).expect("a store");
    let mut disk = QueuedDisk::new(disk, Arc::new(Notify::new())).expect("a thread");
    // What `kill -9` would leave.
    let left = || std::fs::read_to_string(store.join(LOG)).unwrap();
    let add = |disk: &mut QueuedDisk, text: &str| {
        disk.append(LOG, text.as_bytes(), Durability::Process)
            .unwrap();
        assert!(left().ends_with(text), "{}", left());
    };
    add(&mut disk, "long 1\n");
    // The new file gets no name before that.
    let turn = system.1.lock().unwrap();
    disk.compact(LOG, b"1\n").unwrap();
    add(&mut disk, "2\n");
    let new = store.join(format!("{LOG}.new-1"));
    let end = Instant::now() + Duration::from_secs(20);
    while !std::fs::read(&new).is_ok_and(|new| new == b"1\n2\n") && Instant::now() < end {
        std::thread::sleep(LOOK_AGAIN);
        disk.poll();
    }
    // Both are whole.
    add(&mut disk, "3\n");
    assert_eq!(left(), "long 1\n2\n3\n");
    assert_eq!(std::fs::read(&new).unwrap(), b"1\n2\n3\n");
    // Another time while it is under way changes nothing.
    disk.compact(LOG, b"?").unwrap();
    drop(turn);
    add(&mut disk, "4\n");
    heal(&mut disk);
    add(&mut disk, "5\n");
    assert_eq!(left(), "1\n2\n3\n4\n5\n");
    assert!(!new.exists());

    // A full disk leaves the log as it is.
    system.0.store(true, Ordering::Relaxed);
    disk.compact(LOG, b"?").unwrap_err();
    system.2.store(true, Ordering::Relaxed);
    disk.compact(LOG, b"?").unwrap();
    heal(&mut disk);
    add(&mut disk, "6\n");
    assert_eq!(left(), "1\n2\n3\n4\n5\n6\n");
}

#[test]
fn what_is_on_its_way_is_waited_for_beside_what_cannot_be_written() {
    let (folder, system) = (tempfile::tempdir().unwrap(), Full::default());
    let store = folder.path().join("state");
    let disk = FileDisk::open_on(&store, Box::new(system.clone())).expect("a store");
    let mut disk = QueuedDisk::new(disk, Arc::new(Notify::new())).expect("a thread");
    std::fs::create_dir(store.join("authority-1.json")).unwrap();
    let stuck = outcome(&mut disk, save("authority-1.json"));
    assert_eq!(stuck, Progress::Failing);
    assert!(disk.is_tried(disk.queued()));
    let turn = system.1.lock().unwrap();
    save("authority-2.json")(&mut disk);
    let until = disk.queued();
    assert!(!disk.wait(Duration::from_millis(20)) && !disk.is_tried(until));
    drop(turn);
    assert!(!disk.wait(Duration::from_secs(20)), "one is stuck");
    assert!(disk.is_tried(until));
    let written = std::fs::read(store.join("authority-2.json")).unwrap();
    assert_eq!(written, b"authority-2.json");
}

#[test]
fn a_start_leaves_a_log_that_something_else_has_made_longer_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let store = folder.path().join("state");
    drop(disk(&store));
    let inode = |name: &str| std::fs::metadata(store.join(name)).unwrap().ino();
    let (long, short) = ("audit-1b000101.log", "audit-1b000102.log");
    for (name, length) in [(long, MAX_LOG_BYTES + 1), (short, MAX_LOG_BYTES)] {
        let log = File::create(store.join(name)).unwrap();
        log.set_len(length).unwrap();
    }
    let before = [long, short].map(inode);
    drop(disk(&store));
    assert_eq!(inode(long), before[0]);
    assert_ne!(inode(short), before[1]);
}

#[test]
fn a_start_removes_what_was_being_written_and_no_file_of_a_like_name() {
    let folder = tempfile::tempdir().unwrap();
    let store = folder.path().join("state");
    drop(disk(&store));
    let of_a_person = ["notes.new-year.txt", "plan-1.json.new-7b", "x.new-"];
    for name in of_a_person.iter().chain(&["plan-1.json.new-7"]) {
        std::fs::write(store.join(name), name).unwrap();
    }
    drop(disk(&store));
    for name in of_a_person {
        assert_eq!(std::fs::read_to_string(store.join(name)).unwrap(), name);
    }
    assert!(!store.join("plan-1.json.new-7").exists());
}
