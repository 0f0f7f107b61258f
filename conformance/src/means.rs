//! Means of the profile: shell commands that change the subject's surroundings.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// How long such a command may take.
const PATIENCE: Duration = Duration::from_secs(30);

/// Runs a command of the profile and waits for its end.
///
/// # Errors
/// It cannot be run, fails, or takes too long; in a sentence.
pub fn shell(command: &str) -> Result<(), String> {
    let mut child = Command::new("sh")
        .args(["-c", command])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .map_err(|error| format!("{command:?} cannot be run: {error}"))?;
    let began = Instant::now();
    loop {
        match child.try_wait() {
            Ok(Some(status)) if status.success() => return Ok(()),
            Ok(Some(status)) => return Err(format!("{command:?} ended with {status}")),
            Ok(None) if began.elapsed() > PATIENCE => {
                let _ = child.kill();
                let _ = child.wait();
                return Err(format!(
                    "{command:?} took longer than {} s",
                    PATIENCE.as_secs()
                ));
            }
            Ok(None) => std::thread::sleep(Duration::from_millis(20)),
            Err(error) => return Err(format!("{command:?}: {error}")),
        }
    }
}
