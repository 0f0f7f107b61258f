//! The MAVLink recording of one vehicle: a .tlog, keys blanked and signatures stripped. And how any recording is written: by a
//! thread for all of them ([`Recorder`]), so that nobody waits for the disk.

use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use mavlink_link::frame::FrameView;
use mavlink_link::store::remedy;
use mavlink_link::tlog;

use super::disk;
use super::ownership;
use crate::session::Counters;

/// How much a recording may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Quota {
    /// All its files together, those of earlier runs included, bytes.
    pub total: u64,
}

impl Quota {
    /// An equal share of `[record] max_mb` for each recording: flooding one takes no room from the others.
    #[must_use]
    pub fn share(max_mb: u32, recordings: usize) -> Quota {
        let total = u64::from(max_mb) << 20;
        let recordings = u64::try_from(recordings).unwrap_or(u64::MAX).max(1);
        Quota {
            total: total / recordings,
        }
    }

    /// The size at which the next file begins: the oldest part of a full quota is then an eighth of it.
    fn file(self) -> u64 {
        self.total / 8
    }
}

/// The thread that writes recordings. It is there once one was begun, until the last one and all clones of this are dropped.
#[derive(Debug, Clone, Default)]
pub struct Recorder {
    thread: Arc<Mutex<Option<Sender<Work>>>>,
    /// Bytes and pieces of work that wait for it.
    waiting: Arc<AtomicU64>,
}

/// What the thread does next.
#[derive(Debug)]
struct Work {
    series: Arc<Mutex<Series>>,
    /// Another file of the series begins before this.
    next: bool,
    bytes: Vec<u8>,
}

impl Work {
    fn size(&self) -> u64 {
        self.bytes.len() as u64 + 1
    }
}

impl Recorder {
    /// Waits until all that was passed on is written; false if that takes longer.
    pub fn wait(&self, until: Instant) -> bool {
        while self.waiting.load(Ordering::Acquire) > 0 {
            if Instant::now() >= until {
                return false;
            }
            std::thread::sleep(LOOK_AGAIN);
        }
        true
    }

    fn start(&self) -> io::Result<Sender<Work>> {
        let mut thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(work) = &*thread {
            return Ok(work.clone());
        }
        let (work, receiver) = channel();
        let waiting = self.waiting.clone();
        std::thread::Builder::new()
            .name("recorder".to_owned())
            .spawn(move || record(&receiver, &waiting))?;
        *thread = Some(work.clone());
        Ok(work)
    }
}

/// The thread.
fn record(work: &Receiver<Work>, waiting: &AtomicU64) {
    for one in work {
        let mut series = locked(&one.series);
        if one.next {
            let begun = series.next_file();
            series.see(begun);
        }
        series.write(&one.bytes);
        drop(series);
        waiting.fetch_sub(one.size(), Ordering::Release);
    }
}

fn locked(series: &Mutex<Series>) -> MutexGuard<'_, Series> {
    // A panic of the thread leaves a recording that is cut off.
    series.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A series of files, written for as long as that works: a recording must not stop a flight.
///
/// Anyone who can send to this computer influences the size of a recording, so its rate and total size are bounded. Beyond
/// [`RATE`] bytes a second datagrams are not recorded, and the oldest files of the series make room for new ones.
#[derive(Debug)]
pub(super) struct RecordFile {
    recorder: Recorder,
    thread: Sender<Work>,
    series: Arc<Mutex<Series>>,
    counts: Arc<Counts>,
    /// The first file of this run, to name the recording by.
    first: PathBuf,
    /// Whole records that the thread does not have yet, and how many.
    buffer: Vec<u8>,
    records: u64,
    /// Another file begins with them.
    next: bool,
    /// The length of the present file, once all is written.
    written: u64,
    /// The length of what each file begins with.
    head: u64,
    quota: Quota,
    /// Bytes that may be written at once, and when that was computed.
    allowance: (u64, Duration),
    dropped: u64,
    /// Records that the disk was too slow for.
    late: u64,
    reported_at: Option<Duration>,
}

/// What becomes of a series.
#[derive(Debug, Default)]
struct Counts {
    failed: AtomicBool,
    removed: AtomicU64,
}

/// The files, which the thread writes.
#[derive(Debug)]
struct Series {
    folder: PathBuf,
    /// `1b000101-1767225600`; behind it each file but the first of the series has its number, `-1` and so on.
    run: String,
    /// `1b000101-`, the prefix of all files of the series.
    series: String,
    extension: &'static str,
    /// The first bytes of each file.
    head: Vec<u8>,
    quota: Quota,
    path: PathBuf,
    file: File,
    /// The number of the next file.
    next: u64,
    counts: Arc<Counts>,
}

/// Whether a file can be begun in `folder`, as [`RecordFile::begin`] does.
///
/// # Errors
/// The folder cannot be made or written, or it is open to others.
pub(super) fn check(folder: &Path) -> io::Result<()> {
    ownership::check_way(folder)?;
    if folder.exists() {
        ownership::check_folder(folder)?;
    }
    disk::probe(folder)
}

impl RecordFile {
    /// Creates a file in `folder`, named by the recording and the time, readable for its owner alone. Blocks.
    ///
    /// # Errors
    /// The folder or the file cannot be made, the folder is open to others, or there can be no thread.
    pub(super) fn begin(
        (folder, name, extension): (&Path, &str, &'static str),
        head: Vec<u8>,
        wall: Duration,
        quota: Quota,
        recorder: &Recorder,
    ) -> io::Result<RecordFile> {
        ownership::check_way(folder)?;
        DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(folder)?;
        ownership::check_folder(folder)?;
        let (run, series) = (format!("{name}-{}", wall.as_secs()), format!("{name}-"));
        // Continued over the runs: only the number shows which of two files is older, since the clock may have been wrong for
        // either.
        let before = files_of(folder, &series, extension);
        let latest = before.iter().map(|(number, ..)| *number).max();
        let number = latest.map_or(0, |number| number.saturating_add(1));
        let (path, file) = create(folder, &run, number, extension)?;
        let (first, written) = (path.clone(), head.len() as u64);
        let counts = Arc::new(Counts::default());
        let mut series = Series {
            folder: folder.to_owned(),
            run,
            series,
            extension,
            head,
            quota,
            path,
            file,
            next: number.saturating_add(1),
            counts: counts.clone(),
        };
        series.make_room();
        series.start_file();
        Ok(RecordFile {
            thread: recorder.start()?,
            recorder: recorder.clone(),
            series: Arc::new(Mutex::new(series)),
            counts,
            first,
            buffer: Vec::new(),
            records: 0,
            next: false,
            written,
            head: written,
            quota,
            allowance: (BURST, wall),
            dropped: 0,
            late: 0,
            reported_at: None,
        })
    }

    /// Writes a record. After the first failure nothing more is written.
    pub(super) fn write(&mut self, wall: Duration, bytes: &[u8]) {
        if self.counts.failed.load(Ordering::Relaxed) {
            return;
        }
        let length = bytes.len() as u64;
        if !self.allows(wall, length) {
            self.dropped = self.dropped.saturating_add(1);
            self.report_drops(wall);
            return;
        }
        if self.written.saturating_add(length) > self.quota.file() {
            self.flush();
            self.next = true;
            self.written = self.head;
        }
        self.written = self.written.saturating_add(length);
        self.buffer.extend_from_slice(bytes);
        self.records += 1;
        if self.buffer.len() >= PIECE {
            self.flush();
        }
    }

    /// Passes what is buffered to the thread, or drops it where the disk is too far behind.
    pub(super) fn flush(&mut self) {
        if self.buffer.is_empty() {
            return;
        }
        let work = Work {
            series: self.series.clone(),
            next: self.next,
            bytes: std::mem::take(&mut self.buffer),
        };
        let (records, size) = (std::mem::take(&mut self.records), work.size());
        let waiting = &self.recorder.waiting;
        if waiting.load(Ordering::Relaxed).saturating_add(size) > MAX_WAITING {
            self.late = self.late.saturating_add(records);
            return;
        }
        self.next = false;
        waiting.fetch_add(size, Ordering::Relaxed);
        // The thread ends after this.
        let _ = self.thread.send(work);
    }

    /// Adds the counts of what was not recorded, and of what was removed again.
    pub(super) fn count(&self, counters: &mut Counters) {
        let failed = self.counts.failed.load(Ordering::Relaxed);
        let removed = self.counts.removed.load(Ordering::Relaxed);
        counters.add("not recorded: too much at once", self.dropped);
        counters.add("not recorded: the disk is too slow", self.late);
        counters.add("file removed: over record.max_mb", removed);
        counters.add("recording ended: disk", u64::from(failed));
    }

    fn allows(&mut self, wall: Duration, length: u64) -> bool {
        let (left, at) = self.allowance;
        // A wall clock that steps back must not stop the recording until it has caught up.
        let passed = wall.saturating_sub(at);
        let more = u64::try_from(passed.as_millis()).unwrap_or(u64::MAX);
        let more = more.saturating_mul(RATE) / 1_000;
        // The time is kept until it is worth a byte: many short pauses would otherwise add up to nothing.
        let at = if more > 0 || wall < at { wall } else { at };
        let left = left.saturating_add(more).min(BURST);
        let allowed = left >= length;
        let left = if allowed { left - length } else { left };
        self.allowance = (left, at);
        allowed
    }

    fn report_drops(&mut self, wall: Duration) {
        let quiet = self
            .reported_at
            .is_some_and(|at| wall >= at && wall.saturating_sub(at) < REPORT_AGAIN);
        if !quiet {
            self.reported_at = Some(wall);
            tracing::warn!(
                "more than {RATE} bytes a second for {}: not recorded ({} in all)",
                self.first.display(),
                self.dropped
            );
        }
    }
}

impl Series {
    fn write(&mut self, bytes: &[u8]) {
        if !self.counts.failed.load(Ordering::Relaxed) {
            let done = self.file.write_all(bytes);
            self.see(done);
        }
    }

    fn next_file(&mut self) -> io::Result<()> {
        if self.counts.failed.load(Ordering::Relaxed) {
            return Ok(());
        }
        let (path, file) = create(&self.folder, &self.run, self.next, self.extension)?;
        (self.path, self.file) = (path, file);
        self.next = self.next.saturating_add(1);
        self.make_room();
        self.start_file();
        Ok(())
    }

    fn start_file(&mut self) {
        let done = self.file.write_all(&self.head);
        self.see(done);
    }

    /// Removes the oldest files of the series until a whole new one fits.
    fn make_room(&mut self) {
        let mut files = files_of(&self.folder, &self.series, self.extension);
        files.retain(|(_, _, path, _)| *path != self.path);
        files.sort();
        let mut sum: u64 = files.iter().map(|(.., length)| length).sum();
        let room = self.quota.total.saturating_sub(self.quota.file());
        for (_, _, path, length) in files {
            if sum <= room {
                break;
            }
            match fs::remove_file(&path) {
                Ok(()) => {
                    self.counts.removed.fetch_add(1, Ordering::Relaxed);
                }
                Err(cause) => tracing::warn!("{} cannot be removed: {cause}", path.display()),
            }
            sum = sum.saturating_sub(length);
        }
    }

    fn see(&mut self, done: io::Result<()>) {
        if let Err(cause) = done {
            // No retry: a full disk would log an error for every frame.
            self.counts.failed.store(true, Ordering::Relaxed);
            let remedy = remedy(&cause.to_string());
            tracing::error!(
                "the recording {} ends: {cause}{remedy}, and start the bridge again",
                self.path.display()
            );
        }
    }
}

/// The files of a series: their numbers, times, paths and lengths. Renamed files and links do not belong to it.
fn files_of(folder: &Path, series: &str, extension: &str) -> Vec<(u64, SystemTime, PathBuf, u64)> {
    let Ok(entries) = fs::read_dir(folder) else {
        return Vec::new();
    };
    let found = entries.flatten().filter_map(|entry| {
        let name = entry.file_name();
        let rest = name.to_str()?.strip_prefix(series)?;
        let rest = rest.strip_suffix(extension)?.strip_suffix('.')?;
        let numbered = !rest.is_empty() && rest.chars().all(|c| c.is_ascii_digit() || c == '-');
        let number = rest.rsplit_once('-');
        let number = number.and_then(|(_, number)| number.parse::<u64>().ok());
        let about = entry.metadata().ok()?;
        // Earlier versions began to count again with each run: of equal numbers the time decides.
        (numbered && about.is_file()).then_some((
            number.unwrap_or(0),
            about.modified().ok()?,
            entry.path(),
            about.len(),
        ))
    });
    found.collect()
}

/// Never opens an existing file, or the target of a link.
fn create(folder: &Path, run: &str, first: u64, extension: &str) -> io::Result<(PathBuf, File)> {
    let mut last = io::ErrorKind::AlreadyExists.into();
    for number in first..first.saturating_add(MAX_TAKEN) {
        let path = folder.join(match number {
            0 => format!("{run}.{extension}"),
            _ => format!("{run}-{number}.{extension}"),
        });
        match OpenOptions::new()
            .write(true)
            .create_new(true)
            .mode(0o600)
            .open(&path)
        {
            Ok(file) => return Ok((path, file)),
            Err(cause) if cause.kind() == io::ErrorKind::AlreadyExists => last = cause,
            Err(cause) => return Err(cause),
        }
    }
    Err(last)
}

/// The most that is recorded, bytes a second. A link to PX4 carries some 25 kB/s, a ground station less.
const RATE: u64 = 512 * 1024;
/// The most that is recorded at once: the answer to a request for everything, an upload.
const BURST: u64 = 8 << 20;
const REPORT_AGAIN: Duration = Duration::from_secs(60);
/// What the thread is passed at once.
const PIECE: usize = 8 << 10;
/// The most that waits for the disk, of all recordings: what a thousand vehicles send in a second.
const MAX_WAITING: u64 = 32 << 20;
/// How often the end of the program checks whether all is written.
const LOOK_AGAIN: Duration = Duration::from_millis(5);
/// Names to try if one is taken, as by a link or a folder.
const MAX_TAKEN: u64 = 1_000;

/// An open recording.
#[derive(Debug)]
pub struct Recording {
    file: RecordFile,
}

impl Recording {
    /// Begins a file in `folder`, named by the vehicle and the time.
    ///
    /// # Errors
    /// The folder or the file cannot be made, the folder is open to others, or there can be no thread.
    pub fn begin(
        folder: &Path,
        name: &str,
        wall: Duration,
        quota: Quota,
        recorder: &Recorder,
    ) -> io::Result<Recording> {
        let place = (folder, name, "tlog");
        let file = RecordFile::begin(place, Vec::new(), wall, quota, recorder)?;
        Ok(Recording { file })
    }

    /// Adds the counts of what was not recorded, and of what was removed again.
    pub fn count(&self, counters: &mut Counters) {
        self.file.count(counters);
    }

    /// The file that is being written.
    #[must_use]
    pub fn path(&self) -> PathBuf {
        locked(&self.file.series).path.clone()
    }

    /// Writes a frame.
    pub fn write(&mut self, wall: Duration, frame: &FrameView<'_>) {
        let mut record = [0; tlog::MAX_RECORD];
        let length = tlog::record(wall, frame, &mut record);
        self.file
            .write(wall, record.get(..length).unwrap_or_default());
    }

    /// Passes what is buffered to the thread.
    pub fn flush(&mut self) {
        self.file.flush();
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    const QUOTA: Quota = Quota { total: 80_000 };

    fn series(folder: &Path, wall_s: u64) -> RecordFile {
        let wall = Duration::from_secs(wall_s);
        begin(folder, b"head".to_vec(), wall, QUOTA)
    }

    fn begin(folder: &Path, head: Vec<u8>, wall: Duration, quota: Quota) -> RecordFile {
        let place = (folder, "dli", "pcapng");
        RecordFile::begin(place, head, wall, quota, &Recorder::default()).unwrap()
    }

    /// Until all is written.
    fn flush(record: &mut RecordFile) {
        record.flush();
        let until = Instant::now() + Duration::from_secs(20);
        assert!(record.recorder.wait(until));
    }

    fn counted(record: &RecordFile, what: &str) -> u64 {
        let mut counters = Counters::default();
        record.count(&mut counters);
        counters.get(what)
    }

    fn bytes_in(folder: &Path) -> u64 {
        let files = fs::read_dir(folder).unwrap();
        files
            .map(|file| file.unwrap().metadata().unwrap().len())
            .sum()
    }

    #[test]
    fn a_recording_keeps_to_its_quota_whatever_comes_and_over_restarts() {
        let folder = tempfile::tempdir().unwrap();
        // A person's, and another recording's.
        for name in ["dli-kept.pcapng", "1b000101-1.tlog"] {
            fs::write(folder.path().join(name), "x").unwrap();
        }
        let mut removed = 0;
        for run in 1..=20 {
            let mut record = series(folder.path(), 1_000 + run);
            for at in 0..100 {
                let wall = Duration::from_secs(1_000 + run + at);
                record.write(wall, &[7; 1_000]);
                // What waits in memory is not in the folder yet.
                flush(&mut record);
                assert!(bytes_in(folder.path()) <= QUOTA.total + 2);
            }
            let newest = fs::read(&locked(&record.series).path).unwrap();
            assert!(newest.starts_with(b"head") && newest.len() > 1_000);
            removed += counted(&record, "file removed: over record.max_mb");
        }
        assert!(removed > 100, "{removed}");
        assert!(
            bytes_in(folder.path()) > QUOTA.total / 2,
            "what fits is kept"
        );
        for name in ["dli-kept.pcapng", "1b000101-1.tlog"] {
            assert!(folder.path().join(name).exists(), "{name}");
        }
    }

    #[test]
    fn what_a_wrong_clock_has_dated_ahead_makes_room_for_what_is_recorded_later() {
        let folder = tempfile::tempdir().unwrap();
        let write = |record: &mut RecordFile, from_s: u64, seconds: u64| {
            for at in from_s..from_s + seconds {
                record.write(Duration::from_secs(at), &[7; 1_000]);
            }
            flush(record);
        };
        let files = || {
            let files = fs::read_dir(folder.path()).unwrap();
            files.map(|file| file.unwrap().path()).collect::<Vec<_>>()
        };
        // 60 of 80 kB, by a clock that is a year ahead.
        let (year, ahead) = (Duration::from_secs(366 * 86_400), 40_000_000);
        write(&mut series(folder.path(), ahead), ahead, 60);
        let dated_ahead = files();
        for path in &dated_ahead {
            let file = File::options().write(true).open(path).unwrap();
            file.set_modified(SystemTime::now() + year).unwrap();
        }
        // The clock is right again, and the bridge is started twice.
        let mut kept = Vec::new();
        for run in [1_000, 2_000] {
            let mut record = series(folder.path(), run);
            kept.push(locked(&record.series).path.clone());
            write(&mut record, run, 30);
        }
        assert!(kept.iter().all(|path| path.exists()), "{:?}", files());
        let left = dated_ahead.iter().filter(|path| path.exists()).count();
        assert!(left < dated_ahead.len() / 2, "{left} of those ahead");
    }

    #[test]
    fn a_flood_is_not_recorded_and_is_counted() {
        let folder = tempfile::tempdir().unwrap();
        let wall = Duration::from_secs(1_000);
        let quota = Quota { total: 1 << 30 };
        let mut record = begin(folder.path(), vec![], wall, quota);
        // A second of it, in steps that are each shorter than a byte takes.
        for at in 0..20_000_u64 {
            record.write(wall + Duration::from_micros(50 * at), &[7; 1_000]);
        }
        flush(&mut record);
        let dropped = counted(&record, "not recorded: too much at once");
        let written = bytes_in(folder.path());
        assert!((BURST..=BURST + RATE).contains(&written), "{written}");
        assert_eq!(written / 1_000 + dropped, 20_000);
        // The clock of the computer is set back by a year: the recording continues a second later.
        let back = Duration::from_secs(10);
        record.write(back, &[7; 1_000]);
        record.write(back + Duration::from_secs(1), &[7; 1_000]);
        flush(&mut record);
        assert!(bytes_in(folder.path()) >= written + 1_000);
    }

    #[test]
    fn a_link_in_the_place_of_a_recording_is_not_written_to() {
        let folder = tempfile::tempdir().unwrap();
        let records = folder.path().join("records");
        DirBuilder::new().mode(0o700).create(&records).unwrap();
        let target = folder.path().join("target");
        fs::write(&target, "somebody's").unwrap();
        symlink(&target, records.join("dli-7.pcapng")).unwrap();
        let mut record = series(&records, 7);
        let path = locked(&record.series).path.clone();
        assert_eq!(path, records.join("dli-7-1.pcapng"));
        record.write(Duration::from_secs(7), b"bytes");
        flush(&mut record);
        assert_eq!(fs::read(&target).unwrap(), b"somebody's");
    }

    #[test]
    fn a_disk_that_hangs_delays_nobody_and_fills_no_memory() {
        let folder = tempfile::tempdir().unwrap();
        let quota = Quota { total: 1 << 30 };
        let at = |second: u64| Duration::from_secs(1_000 + second);
        let mut record = begin(folder.path(), b"head".to_vec(), at(0), quota);
        // What the disk holds up the thread with, it holds while it writes.
        let series = record.series.clone();
        let hangs = locked(&series);
        // 32 MB, and more; a new file of the series begins after 128 MB.
        let (seconds, size) = (300, 500_000);
        for second in 0..seconds {
            record.write(at(second), &vec![7; size]);
        }
        record.flush();
        let late = counted(&record, "not recorded: the disk is too slow");
        let waits = (seconds - late) * size as u64;
        assert!(waits <= MAX_WAITING && waits > MAX_WAITING / 2, "{waits}");
        assert_eq!(bytes_in(folder.path()), 4);
        drop(hangs);
        flush(&mut record);
        assert_eq!(bytes_in(folder.path()), 4 + waits);
        record.write(at(seconds), &vec![7; size]);
        flush(&mut record);
        // The file that was to begin meanwhile.
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
        assert_eq!(bytes_in(folder.path()), 8 + waits + size as u64);
    }

    #[test]
    fn every_recording_has_its_share() {
        assert_eq!(Quota::share(2_048, 2).total, 1 << 30);
        assert_eq!(Quota::share(1, 0).total, 1 << 20);
    }
}
