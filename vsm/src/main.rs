//! The `vsm` program: any STANAG 4586 ground station flies any PX4.

use std::process::ExitCode;

fn main() -> ExitCode {
    vsm::program::main()
}
