//! The `px4-sim` program: a simulated PX4 on UDP.

use std::process::ExitCode;

fn main() -> ExitCode {
    px4_sim::program::main()
}
