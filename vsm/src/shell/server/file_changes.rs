//! Changes of files, as the system reports them (inotify): a task that waits for them costs nothing while there are none.
//!
//! The files themselves are watched, and not their folders: a folder may be one that is written all the time. So a file that
//! is missing is not watched, nor one on a file server that another computer changes: who watches looks now and then, too.

use std::future;
use std::io;
use std::os::fd::OwnedFd;
use std::path::Path;

use rustix::fs::inotify::{self, CreateFlags, WatchFlags};
use tokio::io::unix::AsyncFd;

use crate::shell::timer::readable;

/// Reports changes of files.
#[derive(Debug)]
pub(super) struct FileChanges(Option<AsyncFd<OwnedFd>>);

impl FileChanges {
    /// Watches nothing yet. Where the system has no more of these, nothing is ever reported. Must be called within a tokio
    /// runtime.
    pub(super) fn new() -> FileChanges {
        let opened = inotify::init(CreateFlags::NONBLOCK | CreateFlags::CLOEXEC)
            .map_err(io::Error::from)
            .and_then(readable);
        FileChanges(match opened {
            Ok(opened) => Some(opened),
            Err(cause) => {
                tracing::debug!("changes of files are not reported: {cause}");
                None
            }
        })
    }

    /// From now on the next change of each of these is reported, once.
    pub(super) fn watch<'a>(&self, files: impl IntoIterator<Item = &'a Path>) {
        let Some(opened) = &self.0 else {
            return;
        };
        for file in files {
            // One that is missing, or may not be read.
            let _ = inotify::add_watch(opened.get_ref(), file, CHANGED);
        }
    }

    /// Waits until one has changed.
    pub(super) async fn changed(&self) {
        let Some(opened) = &self.0 else {
            return future::pending().await;
        };
        let mut events = [0_u8; ROOM];
        loop {
            let Ok(mut ready) = opened.readable().await else {
                return future::pending().await;
            };
            // Which it was does not matter: who waits looks at all of them.
            let read = ready.try_io(|opened| {
                let length = rustix::io::read(opened.get_ref(), &mut events)?;
                Ok(length)
            });
            match read {
                Ok(Ok(_)) => return,
                Ok(Err(cause)) => {
                    tracing::debug!("changes of files are not reported: {cause}");
                    return future::pending().await;
                }
                // There were none: the next wait is for the next one.
                Err(_) => {}
            }
        }
    }
}

/// Its content, its mode or owner, its name, and that another file has its name: ATTRIB is the last link to it that is gone,
/// while a process has it open.
const CHANGED: WatchFlags = WatchFlags::MODIFY
    .union(WatchFlags::ATTRIB)
    .union(WatchFlags::MOVE_SELF)
    .union(WatchFlags::DELETE_SELF)
    .union(WatchFlags::ONESHOT);
/// For some two hundred events at once; what finds no room is read by the next call.
const ROOM: usize = 4_096;

#[cfg(test)]
mod tests {
    use std::fs;
    use std::time::Duration;

    use super::*;

    async fn has_changed(changes: &FileChanges) -> bool {
        let within = Duration::from_millis(300);
        tokio::time::timeout(within, changes.changed())
            .await
            .is_ok()
    }

    #[tokio::test]
    async fn a_change_of_a_watched_file_is_reported_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let (one, other) = (path("1.key"), path("2.key"));
        fs::write(&one, "1").unwrap();
        let changes = FileChanges::new();
        let watch = || changes.watch([one.as_path(), other.as_path()]);
        watch();
        // Another file of the folder, and a look at this one.
        fs::write(path("record"), "1").unwrap();
        fs::read(&one).unwrap();
        assert!(!has_changed(&changes).await);
        // As every key is replaced, while a process has it open for its lock.
        let held = fs::File::open(&one).unwrap();
        fs::write(path("1.key.new"), "2").unwrap();
        fs::rename(path("1.key.new"), &one).unwrap();
        assert!(has_changed(&changes).await);
        drop(held);
        // Once for each watch; its end may be reported, too.
        while has_changed(&changes).await {}
        fs::write(&one, "3").unwrap();
        assert!(!has_changed(&changes).await);
        watch();
        fs::remove_file(&one).unwrap();
        assert!(has_changed(&changes).await);
    }
}
