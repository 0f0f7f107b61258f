//! A log that is written again, shorter, while lines are added to it.
//!
//! Such a line has to be in the log when its call returns, whatever becomes of the process then: a command follows. So the caller
//! writes it, and a log that is replaced must not lose it:
//!
//! 1. The thread writes the new file beside. Lines go to the old one, and are kept here too.
//! 2. The caller adds these to the new file, and has the thread rename it. From now on lines go to both.
//! 3. The new file has its name, and lines go to it alone.

use std::fs::{File, OpenOptions};
use std::io;
use std::path::Path;

use super::steps::{Content, beside};
use crate::shell::disk::{FileSystem, append_to};
use crate::shell::ownership::open_no_link;

/// The caller's part.
#[derive(Debug, Default)]
pub(super) struct Compaction {
    /// Lines that the new file lacks.
    since: Vec<u8>,
    /// There were too many of these, and the old file stays.
    ends: bool,
    /// The old file and the new one.
    both: Option<[File; 2]>,
}

impl Compaction {
    /// Adds lines; `add` adds them to the log by its name.
    ///
    /// # Errors
    /// As of [`FileSystem::add`].
    pub(super) fn append(
        &mut self,
        lines: &[u8],
        add: impl FnOnce() -> io::Result<()>,
    ) -> io::Result<()> {
        let Some([old, new]) = &mut self.both else {
            add()?;
            // A disk that hangs must not fill the memory.
            self.ends |= self.since.len() + lines.len() > MAX_SINCE;
            match self.ends {
                true => self.since = Vec::new(),
                false => self.since.extend_from_slice(lines),
            }
            return Ok(());
        };
        let start = append_to(old, lines)?;
        if let Err(cause) = append_to(new, lines) {
            // A line that is refused is in neither, whichever has the name in the end.
            let _ = old.set_len(start);
            return Err(cause);
        }
        Ok(())
    }

    /// The new file is written, and lacks only what is here.
    ///
    /// # Errors
    /// The system's, or there was no room for what it lacks.
    pub(super) fn write_both(&mut self, old: File, mut new: File) -> io::Result<()> {
        if self.ends {
            return Err(io::Error::other("the disk is too slow"));
        }
        append_to(&mut new, &self.since)?;
        self.since = Vec::new();
        self.both = Some([old, new]);
        Ok(())
    }
}

/// The thread's part.
#[derive(Debug)]
pub(super) enum Compact {
    /// Writes the new file.
    Write(String, Content),
    /// Gives it its name.
    Place(String),
    /// Deletes it.
    Drop(String),
}

/// What became of it.
#[derive(Debug)]
pub(super) enum Compacted {
    /// It is written, and open.
    Written(String, io::Result<File>),
    /// It has its name, or the old file still has.
    Placed(String, io::Result<()>),
}

impl Compact {
    pub(super) fn carry_out(self, system: &dyn FileSystem, folder: &Path) -> Option<Compacted> {
        match self {
            Compact::Write(name, content) => {
                let new = beside(folder, &name);
                let written = system
                    .write(&new, &content)
                    .and_then(|()| open_no_link(OpenOptions::new().append(true), &new));
                if written.is_err() {
                    let _ = system.remove(&new);
                }
                Some(Compacted::Written(name, written))
            }
            Compact::Place(name) => {
                let new = beside(folder, &name);
                // Otherwise a power cut could leave the name on an empty file: what was logged long before would be lost.
                let placed = system.sync(&new);
                let placed = placed.and_then(|()| system.rename(&new, &folder.join(&name)));
                if placed.is_err() {
                    let _ = system.remove(&new);
                }
                Some(Compacted::Placed(name, placed))
            }
            Compact::Drop(name) => {
                let _ = system.remove(&beside(folder, &name));
                None
            }
        }
    }
}

/// The most that is kept for a new file, bytes: more than a log has when it is rewritten.
const MAX_SINCE: usize = 1 << 20;

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn to_append(path: &Path) -> File {
        let mut how = OpenOptions::new();
        how.append(true).create(true).open(path).unwrap()
    }

    #[test]
    fn a_line_that_one_of_both_files_refuses_is_in_neither() {
        let folder = tempfile::tempdir().unwrap();
        let [old, new] = ["old", "new"].map(|name| folder.path().join(name));
        for path in [&old, &new] {
            fs::write(path, "1\n").unwrap();
        }
        let mut compaction = Compaction::default();
        let both = [to_append(&old), File::open(&new).unwrap()];
        compaction.both = Some(both);
        let refused = compaction.append(b"2\n", || unreachable!("both are open"));
        refused.unwrap_err();
        assert_eq!(fs::read(&old).unwrap(), b"1\n");
        assert_eq!(fs::read(&new).unwrap(), b"1\n");
    }

    #[test]
    fn a_disk_that_hangs_ends_the_rewriting_and_keeps_no_memory() {
        let folder = tempfile::tempdir().unwrap();
        let mut compaction = Compaction::default();
        let (line, mut added) = ([b'x'; 1_000], 0);
        while added < 2 * MAX_SINCE {
            let add = || {
                added += line.len();
                Ok(())
            };
            compaction.append(&line, add).unwrap();
            assert!(compaction.since.len() <= MAX_SINCE);
        }
        assert_eq!(compaction.since.capacity(), 0);
        let [old, new] = ["old", "new"].map(|name| to_append(&folder.path().join(name)));
        compaction.write_both(old, new).unwrap_err();
        assert!(compaction.both.is_none());
    }
}
