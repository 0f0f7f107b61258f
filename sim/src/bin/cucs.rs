//! The `cucs` program: a scriptable STANAG 4586 ground station.

use std::process::ExitCode;

fn main() -> ExitCode {
    sim::cucs::program::main()
}
