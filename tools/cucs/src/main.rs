//! The `cucs` program: a scriptable STANAG 4586 ground station.

use std::process::ExitCode;

fn main() -> ExitCode {
    cucs::program::main()
}
