//! The program `mavlink-check`; see the library beside it.
#![forbid(unsafe_code)]

use std::process::ExitCode;

fn main() -> ExitCode {
    mavlink_check::run()
}
