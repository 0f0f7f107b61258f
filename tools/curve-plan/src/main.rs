//! The program `curve-plan`; see the library beside it.
#![forbid(unsafe_code)]

use std::process::ExitCode;

fn main() -> ExitCode {
    curve_plan::run()
}
