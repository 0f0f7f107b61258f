//! Other people's programs that a test needs: tshark, dpkg-deb, a C compiler, name spaces of the kernel.
//!
//! On a developer's machine a test whose tool is missing is left out, and prints that. With `CI` set it fails: a
//! check that did not run must not pass.
//!
//! ```no_run
//! # fn test() {
//! if !kit::tools::is_installed("tshark") {
//!     return; // left out, or failed where `CI` is set
//! }
//! # }
//! ```
#![allow(
    clippy::print_stderr,
    reason = "a test that was left out has to show in its output"
)]

use std::process::{Command, Stdio};

/// Whether a program can be started; where not, see [`leave_out`].
pub fn is_installed(tool: &str) -> bool {
    let started = Command::new(tool)
        .arg("--version")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    match started {
        Ok(_) => true,
        Err(error) => leave_out(tool, &error.to_string()),
    }
}

/// Whether a command that proves a tool succeeds here; where not, see [`leave_out`].
pub fn works(tool: &str, probe: &mut Command) -> bool {
    match probe.output() {
        Ok(output) if output.status.success() => true,
        Ok(output) => leave_out(tool, String::from_utf8_lossy(&output.stderr).trim()),
        Err(error) => leave_out(tool, &error.to_string()),
    }
}

/// Reports that a test is left out because a tool is missing; always returns false.
///
/// # Panics
///
/// The environment variable `CI` is set.
pub fn leave_out(tool: &str, why: &str) -> bool {
    let on_ci = std::env::var_os("CI").is_some_and(|value| !value.is_empty());
    assert!(
        !on_ci,
        "{tool} is missing, and CI has to run this test: {why}"
    );
    let test = std::thread::current();
    let test = test.name().unwrap_or("a test").to_owned();
    eprintln!("LEFT OUT: {test} needs {tool}: {why}");
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_that_is_there_is_found() {
        assert!(is_installed("sh"));
        assert!(works("sh", Command::new("sh").args(["-c", "exit 0"])));
    }

    /// This test starts itself with and without `CI`.
    #[test]
    fn a_missing_tool_fails_with_ci_and_is_left_out_without() {
        if std::env::var_os("KIT_MISSING_TOOL").is_some() {
            assert!(!is_installed("there-is-no-such-program"));
            return;
        }
        for (ci, passes) in [("true", false), ("", true)] {
            let output = Command::new(std::env::current_exe().expect("its path"))
                .args(["a_missing_tool", "--nocapture"])
                .env("KIT_MISSING_TOOL", "1")
                .env("CI", ci)
                .output()
                .expect("this very program");
            assert_eq!(output.status.success(), passes, "CI={ci}");
            let printed = String::from_utf8_lossy(&output.stderr).into_owned();
            assert!(printed.contains("there-is-no-such-program"), "{printed}");
        }
    }
}
