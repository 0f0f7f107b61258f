//! What the tests between programs share: a bridge and a simulated PX4 on free ports ([`ground`]), and where the other
//! people's programs are.
//!
//! The tests themselves: `tests/programs`, with `interop` (against other people's programs), `processes` (our programs together) and
//! `documents` (what the documents and the package promise).

pub mod ground;

use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// The folder `tests/`, with the peers and the data.
pub fn here() -> &'static Path {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package.parent().expect("tests/")
}

/// The Python of the tests' environment, with the pinned peers.
///
/// # Panics
///
/// Where it was not made yet.
pub fn peers_python() -> PathBuf {
    let path = here().join("interop/.venv/bin/python");
    assert!(
        path.exists(),
        "{} is not there: `cargo xtask test` makes it, with pinned peers in it",
        path.display()
    );
    path
}

/// A Python 3.11 or newer that needs no packages: that of the environment, or the system's.
pub fn plain_python() -> PathBuf {
    let path = here().join("interop/.venv/bin/python");
    if path.exists() {
        path
    } else {
        PathBuf::from("python3")
    }
}

/// A number nobody has chosen. It is printed, so that a failure can be had again.
#[allow(
    clippy::print_stderr,
    reason = "the seed has to show in the test's output"
)]
pub fn seed_from_clock() -> u64 {
    let seed = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .map_or(1, |d| u64::from(d.subsec_nanos()) ^ d.as_secs() << 20);
    eprintln!("seed {seed}");
    seed
}
