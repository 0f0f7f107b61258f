//! The audit log as a file: opened to append only, synchronised where that is asked for, mode 0600.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

/// Adds to the end; with `power` it returns once that is on the disk.
///
/// # Errors
/// The system's. A part may have been added: the next start finds a line without end, and closes it.
pub fn append(path: &Path, bytes: &[u8], power: bool) -> io::Result<()> {
    let new = !path.exists();
    let mut file = OpenOptions::new()
        .append(true)
        .create(true)
        .mode(0o600)
        .open(path)?;
    file.write_all(bytes)?;
    if power {
        file.sync_data()?;
    }
    if new && let Some(folder) = path.parent() {
        // The name of a new file is in its folder.
        File::open(folder)?.sync_all()?;
    }
    Ok(())
}

/// Renames each of these to the one before it, the last one first; what is not there is passed over.
///
/// # Errors
/// The system's.
pub fn shift(newest_last: &[&Path]) -> io::Result<()> {
    for pair in newest_last.windows(2) {
        let [older, newer] = pair else { continue };
        match fs::rename(newer, older) {
            Err(cause) if cause.kind() != io::ErrorKind::NotFound => return Err(cause),
            _ => {}
        }
    }
    match newest_last.first().and_then(|path| path.parent()) {
        Some(folder) => File::open(folder)?.sync_all(),
        None => Ok(()),
    }
}

/// All of it; `None` where there is none.
///
/// # Errors
/// The system's.
pub fn read(path: &Path) -> io::Result<Option<Vec<u8>>> {
    match fs::read(path) {
        Ok(bytes) => Ok(Some(bytes)),
        Err(cause) if cause.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(cause) => Err(cause),
    }
}
