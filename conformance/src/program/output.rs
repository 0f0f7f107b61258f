//! What the subcommands share: lines of output, and the profile of a file.

use crate::profile::Profile;

/// The profile of a file, or the default.
pub(super) fn profile(file: Option<&std::path::Path>) -> Result<Profile, String> {
    match file {
        Some(file) => Profile::read(file).map_err(|error| error.to_string()),
        None => Ok(Profile::default()),
    }
}

#[allow(clippy::print_stdout, reason = "the program's output")]
pub(super) fn print(line: &str) {
    use std::io::Write;
    // A closed pipe (`| head`) is no reason to panic.
    let _ = writeln!(std::io::stdout(), "{line}");
}

#[allow(clippy::print_stderr, reason = "the program's errors")]
pub(super) fn eprint(line: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "{line}");
}
