//! The `vsm` program: any STANAG 4586 ground station flies any PX4.

mod program;

use std::process::ExitCode;

fn main() -> ExitCode {
    program::main()
}
