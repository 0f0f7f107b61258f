//! The MAVLink recording of one vehicle: a .tlog, keys blanked and signatures stripped.

use std::fs::{DirBuilder, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

use mavlink_link::frame::FrameView;
use mavlink_link::tlog;

/// A file that is written for as long as that works: a recording must not stop a flight.
#[derive(Debug)]
pub(super) struct RecordFile {
    path: PathBuf,
    file: BufWriter<File>,
    failed: bool,
}

impl RecordFile {
    /// Makes a file of this name in `folder`, readable for its owner alone.
    ///
    /// # Errors
    /// The folder or the file cannot be made.
    pub(super) fn begin(folder: &Path, name: &str) -> io::Result<RecordFile> {
        DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(folder)?;
        let path = folder.join(name);
        let file = OpenOptions::new()
            .write(true)
            .create(true)
            .truncate(true)
            .mode(0o600)
            .open(&path)?;
        Ok(RecordFile {
            path,
            file: BufWriter::new(file),
            failed: false,
        })
    }

    /// After the first failure nothing more is written.
    pub(super) fn write(&mut self, bytes: &[u8]) {
        if !self.failed {
            let done = self.file.write_all(bytes);
            self.see(done);
        }
    }

    /// Brings it to the disk.
    pub(super) fn flush(&mut self) {
        if !self.failed {
            let done = self.file.flush();
            self.see(done);
        }
    }

    fn see(&mut self, done: io::Result<()>) {
        if let Err(cause) = done {
            // No retry: a disk that is full would log an error for every frame.
            self.failed = true;
            tracing::error!("the recording {} ends: {cause}", self.path.display());
        }
    }
}

/// An open recording.
#[derive(Debug)]
pub struct Recording {
    file: RecordFile,
}

impl Recording {
    /// Begins a file in `folder`, named by the vehicle and the time.
    ///
    /// # Errors
    /// The folder or the file cannot be made.
    pub fn begin(folder: &Path, name: &str, wall: Duration) -> io::Result<Recording> {
        let file = RecordFile::begin(folder, &format!("{name}-{}.tlog", wall.as_secs()))?;
        Ok(Recording { file })
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.file.path
    }

    /// Writes a frame.
    pub fn write(&mut self, wall: Duration, frame: &FrameView<'_>) {
        let mut record = [0; tlog::MAX_RECORD];
        let length = tlog::record(wall, frame, &mut record);
        self.file.write(record.get(..length).unwrap_or_default());
    }

    /// Brings it to the disk.
    pub fn flush(&mut self) {
        self.file.flush();
    }
}
