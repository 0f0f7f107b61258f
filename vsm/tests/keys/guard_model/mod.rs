//! The guard as a model, searched through every reachable state beside an attacker who owns the network: he records, drops,
//! repeats, reorders and reflects everything, writes datagrams of his own, and is given a guard key or the group's at any moment.
//!
//! **What is modelled** (`search`): trailer, direction, stamps with their ceiling on the disk, the window, restarts of both ends,
//! rotation with its overlap, revocation, the group key with its offers, an access list that is signed anew, read again, and older.
//! **What must hold** is in the constants below, for every state within the bounds of the tests. **That it can fail**: each [`Flaw`] is
//! found. **What ties it to the code** (`code`): the same promises are checked at the machines themselves, along every history of a
//! smaller bound.
//!
//! How both ends come to their keys is the machine of the key exchange, whose model has an end that puts a key in force as soon as it is
//! staged among its behaviours: `mavlink-link/tests/key_exchange/symbolic`; its steps for a guard are tested in `guard_pairing`.
//!
//! **Not shown**: anything of real cryptography; time (the delay that is allowed, lifts, clocks that are apart); addresses; the exact
//! message that is inside.

mod code;
mod search;

use search::explore;

const GENUINE: &str = "nothing is taken that its sender has not sent";
const ONCE: &str = "nothing is taken twice";
const GUARDED: &str = "nothing without a trailer is taken of a guarded CUCS";
const GROUP: &str = "nothing under a group key is taken by the VSM";
const REVOKED: &str = "nothing is taken of who was locked out";
const LIST: &str = "no list older than one that was in force is ever in force";

/// A mistake that somebody could make: the search must find each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Flaw {
    /// Stamps are compared with the floor only.
    NoWindow,
    /// A start begins at the wall clock, whatever is on the disk.
    ForgetsAtRestart,
    /// What is taken is not put on the disk before.
    CeilingLate,
    /// One key for both ways.
    NoDirection,
    /// Without a trailer it may be the CUCS, too: a downgrade.
    TakesUnguarded,
    /// A trailer is a trailer, whatever it was sealed under.
    CommandsByGroup,
    /// A key that is revoked is kept for a day, as one that is rotated.
    RevokedIsPrevious,
    /// The group keeps its key when a guard loses its own.
    GroupKeyStays,
    /// An offer does not say from when on it counts.
    OfferWithoutFloor,
    /// A reload takes any list that is signed.
    OlderList,
    /// The version in force is not on the disk.
    ListNotStored,
}

/// The bounds of a search.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scope {
    /// Datagrams of each sender.
    sends: usize,
    keys: u8,
    leaks: usize,
    group: bool,
    lists: bool,
    depth: u8,
    flaw: Option<Flaw>,
}

/// Trailer, stamps and restarts.
const STAMPS: Scope = Scope {
    sends: 2,
    keys: 1,
    leaks: 0,
    group: false,
    lists: false,
    depth: 6,
    flaw: None,
};
/// Rotation and revocation, with a key that somebody else has.
const KEYS: Scope = Scope {
    sends: 1,
    keys: 3,
    leaks: 1,
    depth: 5,
    ..STAMPS
};
const GROUPS: Scope = Scope {
    sends: 1,
    keys: 2,
    leaks: 1,
    group: true,
    depth: 5,
    ..STAMPS
};
/// A group whose key nobody else has, a step further.
const HONEST_GROUP: Scope = Scope {
    leaks: 0,
    keys: 1,
    depth: 6,
    ..GROUPS
};
const LISTS: Scope = Scope {
    sends: 0,
    lists: true,
    depth: 8,
    ..STAMPS
};

#[test]
fn the_promises_of_the_guard_hold_in_every_state() {
    for (scope, least) in [
        (STAMPS, 1_000),
        (KEYS, 1_000),
        (GROUPS, 1_000),
        (HONEST_GROUP, 1_000),
        (LISTS, 30),
    ] {
        let found = explore(&scope);
        if let Some((promise, trace)) = found.broken {
            panic!("not so: {promise}, after {trace:#?}");
        }
        assert!(
            found.states >= least,
            "{scope:?}: only {} states",
            found.states
        );
        assert!(
            found.taken >= scope.sends,
            "{scope:?}: nothing is ever taken"
        );
    }
}

#[test]
fn every_mistake_is_found() {
    let mut silent = Vec::new();
    for (flaw, scope, promise) in [
        (Flaw::NoWindow, STAMPS, ONCE),
        (Flaw::ForgetsAtRestart, STAMPS, ONCE),
        (Flaw::CeilingLate, STAMPS, ONCE),
        (Flaw::NoDirection, STAMPS, GENUINE),
        (Flaw::TakesUnguarded, STAMPS, GUARDED),
        (Flaw::CommandsByGroup, GROUPS, GROUP),
        (Flaw::RevokedIsPrevious, KEYS, REVOKED),
        (Flaw::GroupKeyStays, GROUPS, REVOKED),
        (Flaw::OfferWithoutFloor, HONEST_GROUP, ONCE),
        (Flaw::OlderList, LISTS, LIST),
        (Flaw::ListNotStored, LISTS, LIST),
    ] {
        let scope = Scope {
            flaw: Some(flaw),
            ..scope
        };
        let found = explore(&scope).broken.map(|(promise, _)| promise);
        if found != Some(promise) {
            silent.push((flaw, found));
        }
    }
    assert!(silent.is_empty(), "{silent:?}");
}
