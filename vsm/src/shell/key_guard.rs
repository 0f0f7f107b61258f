//! What keeps keys of this process from being written where nobody meant to: core files, and other processes of the
//! same user that look into it.

use rustix::process::{DumpableBehavior, Resource, Rlimit, set_dumpable_behavior, setrlimit};

/// Switches core files off for this process, for good. The program calls it first of all in every command that reads
/// keys.
pub fn no_core_files() {
    let none = Rlimit {
        current: Some(0),
        maximum: Some(0),
    };
    // A system that refuses either still has the other; keys are wiped from memory in any case.
    if let Err(cause) = setrlimit(Resource::Core, none) {
        tracing::warn!("core files cannot be switched off: {cause}");
    }
    if let Err(cause) = set_dumpable_behavior(DumpableBehavior::NotDumpable) {
        tracing::debug!("the process stays open to debuggers: {cause}");
    }
}
