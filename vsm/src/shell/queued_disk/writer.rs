//! The thread of a queued disk: it writes, synchronises, renames, and synchronises the folder.
//!
//! Of all that it is given at once, logs come first: a crash in between leaves a line too many, never a change without its
//! line. Then the contents of all records, and only then their names, so that the folder is synchronised once for all of them.
//!
//! It never synchronises the same bytes in memory again: see the head of `queued_disk`.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

use mavlink_link::store::MAX_RECORD_BYTES;
use tokio::sync::Notify;
use zeroize::Zeroizing;

use super::compaction::{Compact, Compacted};
use super::steps::{BESIDE, Families, Family, Step, Written, beside};
use crate::shell::disk::{FileSystem, is_no_room, keeps_its_room, length, write_over};

/// What a thread is given at once.
#[derive(Debug, Default)]
pub(super) struct Batch {
    pub(super) families: Families,
    pub(super) compactions: Vec<Compact>,
    /// It was accepted before it was known that a line of a log has failed, and a record in it may be the one that the line is
    /// about.
    pub(super) blind: bool,
}

impl Batch {
    pub(super) fn is_empty(&self) -> bool {
        self.families.is_empty() && self.compactions.is_empty()
    }
}

/// Why a family cannot be written.
#[derive(Debug, Clone)]
pub(super) struct Fault {
    pub(super) file: String,
    pub(super) cause: String,
    /// There is no room for it, whatever room there seems to be.
    pub(super) no_room: bool,
}

impl Fault {
    fn new(file: &str, cause: &io::Error) -> Fault {
        Fault {
            file: file.to_owned(),
            cause: cause.to_string(),
            no_room: is_no_room(cause),
        }
    }
}

/// What a thread reports.
#[derive(Debug)]
pub(super) struct Done {
    /// Families of which all changes up to this one are done.
    pub(super) done: BTreeMap<String, u64>,
    /// These are not, and are tried again.
    pub(super) failed: BTreeMap<String, Fault>,
    /// A line of a log is among these.
    pub(super) log_failed: bool,
    pub(super) compacted: Vec<Compacted>,
    /// It was tried again, and is of no new batch.
    pub(super) again: bool,
}

/// The thread; it runs until its disk is dropped. `begun`: see [`Writer`].
pub(super) fn write(
    (system, folder): (&dyn FileSystem, &Path),
    begun: BTreeSet<String>,
    batches: &Receiver<Batch>,
    reports: &Sender<Done>,
    progress: &Notify,
) {
    let mut writer = Writer {
        system,
        folder,
        begun,
    };
    // What has failed, and when it is tried again.
    let (mut failed, mut again_at) = (Families::new(), Instant::now());
    loop {
        let batch = if failed.is_empty() {
            batches.recv().map_err(|_| RecvTimeoutError::Disconnected)
        } else {
            batches.recv_timeout(again_at.saturating_duration_since(Instant::now()))
        };
        let (mut work, compactions, again) = match batch {
            Ok(batch) => {
                let work = join(&mut failed, batch.families, batch.blind);
                (work, batch.compactions, false)
            }
            Err(RecvTimeoutError::Timeout) => (std::mem::take(&mut failed), Vec::new(), true),
            Err(RecvTimeoutError::Disconnected) => return,
        };
        let (faults, log_failed) = writer.make_durable(&mut work);
        let mut done = BTreeMap::new();
        for (name, mut family) in work {
            if faults.contains_key(&name) {
                family.fail();
                failed.insert(name, family);
            } else {
                done.insert(name, family.change);
            }
        }
        if !faults.is_empty() {
            again_at = Instant::now() + TRY_AGAIN;
        }
        let compactions = compactions.into_iter();
        let compacted = compactions.filter_map(|one| one.carry_out(system, folder));
        let _ = reports.send(Done {
            done,
            failed: faults,
            log_failed,
            compacted: compacted.collect(),
            again,
        });
        progress.notify_one();
    }
}

/// What is done now: what is new, behind what has failed of the same families; behind all of it, where it is `blind`.
fn join(failed: &mut Families, new: Families, blind: bool) -> Families {
    let mut work = match blind {
        true => std::mem::take(failed),
        false => Families::new(),
    };
    for (name, newer) in new {
        let older = work.remove(&name).or_else(|| failed.remove(&name));
        let family = match older {
            Some(mut older) => {
                older.follow(newer);
                older
            }
            None => newer,
        };
        work.insert(name, family);
    }
    work
}

/// What the thread knows.
struct Writer<'a> {
    system: &'a dyn FileSystem,
    folder: &'a Path,
    /// Logs that this process has written whole: only of these it is known that no failed synchronisation has lost their end.
    begun: BTreeSet<String>,
}

impl Writer<'_> {
    /// Does all of it, and leaves what is to be tried again. Returns why, and whether a line of a log is among that.
    fn make_durable(&mut self, work: &mut Families) -> (BTreeMap<String, Fault>, bool) {
        let mut faults = BTreeMap::new();
        let again = work.values().any(|one| one.again);
        let logs = work.iter().filter(|(_, one)| one.is_log());
        let logs: BTreeSet<String> = logs.map(|(name, _)| name.clone()).collect();
        for (name, family) in work.iter_mut().filter(|(name, _)| logs.contains(*name)) {
            if let Err(fault) = self.carry_out(family) {
                faults.insert(name.clone(), fault);
            }
        }
        // Lines in a file that a power cut would leave without its name are no lines.
        if let Err(cause) = self.sync_names(work, again) {
            let all = work.iter();
            let all = all.map(|(name, family)| (name.clone(), Fault::new(&family.file, &cause)));
            return (all.collect(), true);
        }
        let of_log = faults.values().next().cloned();
        for (name, family) in work.iter_mut().filter(|(name, _)| !logs.contains(*name)) {
            let prepared = match &of_log {
                // Any of them may be the one that a failed line is about.
                Some(log) => Err(Fault {
                    file: family.file.clone(),
                    cause: format!("{}: {}", log.file, log.cause),
                    no_room: log.no_room,
                }),
                None => self.prepare_all(family),
            };
            if let Err(fault) = prepared {
                faults.insert(name.clone(), fault);
            }
        }
        for (name, family) in work.iter_mut().filter(|(name, _)| !logs.contains(*name)) {
            if !faults.contains_key(name)
                && let Err(fault) = self.carry_out(family)
            {
                faults.insert(name.clone(), fault);
            }
        }
        if let Err(cause) = self.sync_names(work, again) {
            for (name, family) in work.iter().filter(|(_, one)| one.names) {
                let fault = || Fault::new(&family.file, &cause);
                faults.entry(name.clone()).or_insert_with(fault);
            }
        }
        (faults, of_log.is_some())
    }

    /// Synchronises the folder, where names in it have changed.
    fn sync_names(&self, work: &mut Families, again: bool) -> io::Result<()> {
        if !work.values().any(|one| one.names) {
            return Ok(());
        }
        if again {
            dirty_names(self.system, self.folder)?;
        }
        self.system.sync(self.folder)?;
        work.values_mut().for_each(|one| one.names = false);
        Ok(())
    }

    fn prepare_all(&self, family: &mut Family) -> Result<(), Fault> {
        let power = family.power;
        // Behind a rename the same name may come again.
        let is_before = |step: &&mut Step| !matches!(step, Step::Rename { .. });
        let mut steps = family.steps.iter_mut().take_while(is_before);
        steps.try_for_each(|step| self.prepare(step, power))
    }

    /// Writes the new content of a file beside it.
    fn prepare(&self, step: &mut Step, power: bool) -> Result<(), Fault> {
        let Step::Replace {
            name,
            content,
            written,
        } = step
        else {
            return Ok(());
        };
        if *written != Written::No {
            return Ok(());
        }
        let (beside, path) = (self.beside(name), self.path(name));
        // Whatever it must survive: a power cut leaves the old content or the new one, never an empty file.
        let done = self.system.write(&beside, content);
        let done = done.and_then(|()| self.system.sync(&beside));
        *written = match done {
            Ok(()) => Written::Beside,
            Err(cause) => {
                // It takes room.
                let _ = self.system.remove(&beside);
                let may = keeps_its_room(name) && is_no_room(&cause);
                if !may || write_over(self.system, &path, content, power).is_err() {
                    return Err(Fault::new(name, &cause));
                }
                Written::InPlace
            }
        };
        Ok(())
    }

    /// Does the steps of a family, up to the first that fails.
    fn carry_out(&mut self, family: &mut Family) -> Result<(), Fault> {
        let power = family.power;
        while let Some(step) = family.steps.first_mut() {
            self.prepare(step, power)?;
            let changed = self.step(step, power)?;
            family.names |= changed && power;
            // What is done is not done again: a rename would replace what came since.
            family.steps.remove(0);
        }
        Ok(())
    }

    /// Returns whether names in the folder have changed.
    fn step(&mut self, step: &mut Step, power: bool) -> Result<bool, Fault> {
        match step {
            Step::Replace { name, written, .. } => {
                if *written == Written::Beside {
                    let renamed = self.system.rename(&self.beside(name), &self.path(name));
                    renamed.map_err(|cause| Fault::new(name, &cause))?;
                }
                if !power {
                    self.begun.remove(&*name);
                }
                Ok(true)
            }
            Step::Append { name, lines } => match self.append(name, lines, power) {
                Ok(new) => Ok(new),
                Err((cause, lost)) => {
                    let fault = Fault::new(name, &cause);
                    if let Some(start) = lost {
                        self.begun.remove(&*name);
                        let (name, lines) = (std::mem::take(name), std::mem::take(lines));
                        *step = Step::Mend { name, start, lines };
                    }
                    Err(fault)
                }
            },
            Step::Mend { name, start, lines } => {
                let mended = self.read_up_to(name, *start);
                let mended = mended.and_then(|before| self.write_whole(name, before, lines));
                mended.map_err(|cause| Fault::new(name, &cause))?;
                Ok(true)
            }
            Step::Rename { from, to } => {
                let renamed = self.system.rename(&self.path(from), &self.path(to));
                if let Err(cause) = renamed
                    && cause.kind() != io::ErrorKind::NotFound
                {
                    return Err(Fault::new(from, &cause));
                }
                self.begun.remove(&*to);
                if self.begun.remove(&*from) {
                    self.begun.insert(to.clone());
                }
                Ok(true)
            }
            Step::Remove { name } => {
                let removed = self.system.remove(&self.path(name));
                removed.map_err(|cause| Fault::new(name, &cause))?;
                // What it was to be replaced by, if that has failed.
                let _ = self.system.remove(&self.beside(name));
                self.begun.remove(&*name);
                Ok(true)
            }
        }
    }

    /// Adds lines to a log; returns whether it is new.
    ///
    /// # Errors
    /// The system's. With a length, the log may have lost what is behind that, or have a part of the lines.
    fn append(
        &mut self,
        name: &str,
        lines: &[u8],
        power: bool,
    ) -> Result<bool, (io::Error, Option<u64>)> {
        let path = self.path(name);
        if power && !self.begun.contains(name) {
            let before = self.read_whole(name);
            let whole = before.and_then(|before| self.write_whole(name, before, lines));
            return whole.map(|()| true).map_err(|cause| (cause, None));
        }
        let start = length(&path);
        let added = match self.system.add(&path, lines) {
            Ok(added) => added,
            // Nothing of it is there: it need not be written whole, for which a full disk has no room.
            Err(cause) if length(&path) == start => return Err((cause, None)),
            Err(cause) => return Err((cause, Some(start))),
        };
        if power && let Err(cause) = self.system.sync_open(&added.file) {
            return Err((cause, Some(added.start)));
        }
        Ok(added.new)
    }

    /// Writes a log whole, beside, and renames it.
    fn write_whole(
        &mut self,
        name: &str,
        before: Zeroizing<Vec<u8>>,
        lines: &[u8],
    ) -> io::Result<()> {
        let mut all = before;
        // A growing buffer copies its content.
        all.reserve_exact(lines.len());
        all.extend_from_slice(lines);
        let beside = self.beside(name);
        let done = self
            .system
            .write(&beside, &all)
            .and_then(|()| self.system.sync(&beside))
            .and_then(|()| self.system.rename(&beside, &self.path(name)));
        if done.is_err() {
            let _ = self.system.remove(&beside);
            return done;
        }
        self.begun.insert(name.to_owned());
        Ok(())
    }

    fn read_whole(&self, name: &str) -> io::Result<Zeroizing<Vec<u8>>> {
        let read = self.system.read(&self.path(name), MAX_RECORD_BYTES + 1)?;
        let bytes = read.unwrap_or_default();
        // One that something else has made longer than any log becomes would fill the memory.
        if bytes.len() as u64 > MAX_RECORD_BYTES {
            return Err(too_long());
        }
        Ok(bytes)
    }

    /// The first bytes of a log.
    ///
    /// # Errors
    /// The log cannot be repaired: it stays as it is, and is refused until a restart checks it.
    fn read_up_to(&self, name: &str, length: u64) -> io::Result<Zeroizing<Vec<u8>>> {
        if length > MAX_RECORD_BYTES {
            return Err(too_long());
        }
        let read = self.system.read(&self.path(name), length)?;
        let bytes = read.unwrap_or_default();
        if bytes.len() as u64 != length {
            return Err(io::Error::other("it is cut off"));
        }
        Ok(bytes)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    fn beside(&self, name: &str) -> PathBuf {
        beside(self.folder, name)
    }
}

fn too_long() -> io::Error {
    io::Error::other(format!(
        "it has more than {MAX_RECORD_BYTES} bytes: something else has written to it; keep a copy and restart"
    ))
}

/// Changes the names of a folder, so that its next synchronisation writes them: after a failed one they may count as
/// written.
///
/// # Errors
/// The system's.
pub(in crate::shell) fn dirty_names(system: &dyn FileSystem, folder: &Path) -> io::Result<()> {
    let name = folder.join(format!("names{BESIDE}0"));
    system.write(&name, b"")?;
    system.remove(&name)
}

/// The pause after a failure.
const TRY_AGAIN: Duration = Duration::from_secs(1);
