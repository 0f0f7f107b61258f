//! The MAVLink recording of one vehicle: a .tlog, keys blanked and signatures stripped.

use std::fs::{DirBuilder, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::Duration;

use mavlink_link::frame::FrameView;
use mavlink_link::tlog;

/// An open recording.
#[derive(Debug)]
pub struct Recording {
    path: PathBuf,
    file: BufWriter<File>,
    failed: bool,
}

impl Recording {
    /// Begins a file in `folder`, named by the vehicle and the time.
    ///
    /// # Errors
    /// The folder or the file cannot be made.
    pub fn begin(folder: &Path, name: &str, wall: Duration) -> io::Result<Recording> {
        DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(folder)?;
        let path = folder.join(format!("{name}-{}.tlog", wall.as_secs()));
        let file = OpenOptions::new()
            .write(true)
            .create(true)
            .truncate(true)
            .mode(0o600)
            .open(&path)?;
        Ok(Recording {
            path,
            file: BufWriter::new(file),
            failed: false,
        })
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes a frame. After the first failure nothing more is written: a recording must not stop a flight.
    pub fn write(&mut self, wall: Duration, frame: &FrameView<'_>) {
        if self.failed {
            return;
        }
        let mut record = [0; tlog::MAX_RECORD];
        let length = tlog::record(wall, frame, &mut record);
        if let Err(cause) = self
            .file
            .write_all(record.get(..length).unwrap_or_default())
        {
            self.failed = true;
            tracing::error!("the recording {} ends: {cause}", self.path.display());
        }
    }

    /// Brings it to the disk.
    pub fn flush(&mut self) {
        if !self.failed
            && let Err(cause) = self.file.flush()
        {
            self.failed = true;
            tracing::error!("the recording {} ends: {cause}", self.path.display());
        }
    }
}
