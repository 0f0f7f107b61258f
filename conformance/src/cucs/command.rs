//! A command of the profile's `[on]`: a shell in its own process group, so that ending it ends everything that it
//! started.

use std::os::unix::process::CommandExt as _;
use std::process::{Command, Stdio};

use rustix::process::{Pid, Signal, kill_process_group};

/// A running command; dropping it ends it with everything that it started.
#[derive(Debug)]
pub(super) struct Child(std::process::Child);

impl Child {
    /// Starts it.
    pub(super) fn begin(command: &str) -> Result<Self, String> {
        Command::new("sh")
            .args(["-c", command])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .process_group(0)
            .spawn()
            .map(Self)
            .map_err(|error| format!("{command:?} cannot be run: {error}"))
    }

    /// Its exit status, where it has ended; 128 where a signal ended it.
    pub(super) fn ended(&mut self) -> Option<i32> {
        let status = self.0.try_wait().ok()??;
        Some(status.code().unwrap_or(128))
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        let group = i32::try_from(self.0.id()).ok().and_then(Pid::from_raw);
        // Only while the shell has not been waited for: after that its process group number may belong to another
        // program.
        if let (Some(group), Ok(None)) = (group, self.0.try_wait()) {
            let _ = kill_process_group(group, Signal::KILL);
        }
        let _ = self.0.wait();
    }
}
