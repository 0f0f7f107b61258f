//! Opens the files that a configuration names, and the configuration itself.
//!
//! A pipe keeps whoever opens it waiting until somebody writes to it, and a device may never end: a start, a reload and a
//! command must not hang on either, so only regular files are read. A symbolic link that a person has named is followed.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;

use rustix::fs::OFlags;
use rustix::io::Errno;

/// Opens a regular file for reading.
///
/// # Errors
/// The system's; it is a folder, a device, a pipe or a socket.
pub(crate) fn open_file(path: &Path) -> io::Result<File> {
    let file = open_at_once(path)?;
    let about = file.metadata()?;
    if about.is_dir() {
        return Err(Errno::ISDIR.into());
    }
    if !about.is_file() {
        let cause = "it is a device, a pipe or a socket, expected a file";
        return Err(io::Error::new(io::ErrorKind::InvalidInput, cause));
    }
    Ok(file)
}

/// Opens whatever has this name for reading, without waiting for the other end of a pipe: for a caller that checks what it is.
///
/// # Errors
/// The system's.
pub(crate) fn open_at_once(path: &Path) -> io::Result<File> {
    let mut how = OpenOptions::new();
    how.read(true)
        .custom_flags(OFlags::NONBLOCK.bits().cast_signed());
    how.open(path)
}

#[cfg(test)]
mod tests {
    use std::io::Read as _;

    use super::*;

    #[test]
    fn only_a_file_is_opened_and_nothing_is_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("file"), "text").unwrap();
        std::os::unix::fs::symlink(path("file"), path("link")).unwrap();
        for name in ["file", "link"] {
            let mut text = String::new();
            open_file(&path(name))
                .unwrap()
                .read_to_string(&mut text)
                .unwrap();
            assert_eq!(text, "text", "{name}");
        }
        let made = std::process::Command::new("mkfifo")
            .arg(path("pipe"))
            .status();
        assert!(made.unwrap().success());
        for (name, words) in [
            (path("pipe"), "a device, a pipe or a socket"),
            ("/dev/zero".into(), "a device, a pipe or a socket"),
            (folder.path().to_owned(), "Is a directory"),
        ] {
            let fault = open_file(&name).unwrap_err().to_string();
            assert!(fault.contains(words), "{}: {fault}", name.display());
        }
    }
}
