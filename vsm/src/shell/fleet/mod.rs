//! A VSM that several computers can serve: one at a time, the others stand by (`[store] kind = "etcd"`).
//!
//! Each computer runs `vsm run` with the same configuration except `store.node`. One of them owns the VSM: a key in etcd
//! that exists as long as the owner's lease. It serves as any other bridge does, from the files of `store.dir`. Each change
//! of these is stored in etcd (`files`, `remote`) before it counts as durable, that is, before anything that depends on it
//! is answered or commanded. When the owner or its computer fails, its lease ends. The next node then takes the files from
//! etcd and continues as a restarted bridge does: rights, plans, duplicates and ceilings of clocks are as they were, and
//! each stamp is above every earlier one.
//!
//! **Fencing.** Every change compares the owner of the VSM, and the change before it: a request that the network delayed is
//! applied after the one that it follows, or never. A node that is cut off from etcd can store nothing. Its lease ends by its
//! own clock before it ends in etcd, and then it answers no station and commands no vehicle, until etcd has renewed the lease.
//! It signs only up to the stored ceiling of its clock, some seconds. And the vehicle no longer accepts its frames once the
//! next owner has sent one: frames are signed with rising stamps, and those of the next owner begin above that ceiling. That
//! is why each vehicle of such a VSM has a signing key.
//!
//! The unit is the VSM with all its vehicles, since a CUCS reaches the vehicles of a VSM at one address. To spread a fleet over
//! computers, give it several VSMs.
//!
//! - `etcd`: the requests;
//! - `seal`: encrypts what is stored under a key that etcd does not have;
//! - `remote`: files as keys, and the comparison of the owner;
//! - `files`: the folder, stored as it changes;
//! - `model` (of the tests): lease, requests and crashes in every order;
//! - `node`: stands by, takes over, keeps the lease; `operator`: what `vsm fleet` shows and changes.

mod etcd;
mod files;
mod node;
pub mod operator;
mod remote;
mod seal;

pub(in crate::shell) use self::node::check_state;
pub use self::node::{FleetError, Held, Stop, stand_by};

#[cfg(test)]
mod model;
#[cfg(test)]
mod tests;
