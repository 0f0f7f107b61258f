//! The program itself, run by a test: it ends with the test, by its process id.

#![allow(dead_code, reason = "each test file uses its part")]

use std::path::Path;
use std::process::{Child, Command};

/// The program.
pub(crate) const VSM: &str = env!("CARGO_BIN_EXE_vsm");

/// Ends with the test, by its id.
pub(crate) struct Running(pub(crate) Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Runs it to its end in this folder, at the most talkative: whether it succeeded, and all that it said.
pub(crate) fn run(folder: &Path, arguments: &[&str]) -> (bool, Vec<u8>) {
    let output = Command::new(VSM)
        .args(arguments)
        .env("RUST_LOG", "trace")
        .current_dir(folder)
        .output()
        .unwrap();
    let said = [output.stdout, output.stderr].concat();
    (output.status.success(), said)
}

/// A UDP port of loopback that nobody has now.
pub(crate) fn free_port() -> u16 {
    let socket = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.local_addr().unwrap().port()
}
