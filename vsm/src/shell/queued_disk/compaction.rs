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
        let Some(both) = &mut self.both else {
            add()?;
            self.since.extend_from_slice(lines);
            return Ok(());
        };
        both.iter_mut()
            .try_for_each(|file| append_to(file, lines).map(|_| ()))
    }

    /// The new file is written, and lacks only what is here.
    ///
    /// # Errors
    /// The system's.
    pub(super) fn write_both(&mut self, old: File, mut new: File) -> io::Result<()> {
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
                let placed = system.rename(&new, &folder.join(&name));
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
