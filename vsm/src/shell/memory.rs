//! Keeps a program that serves, and the keys in it, out of swap.
//!
//! All of the process is locked, what is there and what it allocates later: a key may lie on any page of the heap. Only what has been touched
//! is held (`ONFAULT`), so that stacks and reserves cost nothing.
//!
//! It is done only where no later allocation can fail because of it: where the limit of locked memory (RLIMIT_MEMLOCK) is unlimited, as the
//! units of the package set it, or the process has CAP_IPC_LOCK. Under a limit the kernel would lock what is there, and refuse memory in
//! flight.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

/// Locks the memory of this process for as long as it lives, or logs why not.
///
/// For programs that serve, before they read a key; and once they act as the user that they will be, since a change of the user takes
/// the capability away.
pub fn lock() {
    match lock_all() {
        Ok(()) => LOCKED.store(true, Ordering::Relaxed),
        Err(cause) => tracing::info!("memory is not locked ({cause}): {CURE}"),
    }
}

/// Whether [`lock`] has succeeded.
#[must_use]
pub fn is_locked() -> bool {
    LOCKED.load(Ordering::Relaxed)
}

fn lock_all() -> io::Result<()> {
    let limit = getrlimit(Resource::Memlock);
    if limit.current.is_some() {
        // With a limit of 0 the kernel goes by the capability alone, which then permits every later allocation as well. What a process reads
        // of its capabilities may be those within a user namespace, which count for nothing here.
        let none = Rlimit {
            current: Some(0),
            ..limit
        };
        setrlimit(Resource::Memlock, none)?;
    }
    let all = MlockAllFlags::CURRENT | MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT;
    let locked = mlockall(all);
    if limit.current.is_some() {
        // Nothing else locks memory here: if it stays at 0, nothing is lost.
        let _ = setrlimit(Resource::Memlock, limit);
    }
    locked.map_err(io::Error::from)
}

/// What an operator can do; also in the status.
pub const CURE: &str =
    "keys can be written to swap: give the program LimitMEMLOCK=infinity, or the computer no swap";

static LOCKED: AtomicBool = AtomicBool::new(false);
