//! The key exchange as a symbolic model, searched through every reachable state beside an attacker who owns the network
//! (Dolev and Yao): he records, drops, replays and reorders everything, puts messages together from what he has, and is
//! given static keys, the pairing code or a signing key at any moment.
//!
//! **What is modelled**: both suites token by token (`messages`); what each end stores and when, what replaces it, counters,
//! epochs, confirmations, repeated outcomes, the pairing window (`ends`); restarts of both ends, an autopilot that takes a key, does
//! not, or falls back to the one before, a ground computer that was stolen and is replaced by pairing again (`search`).
//! **What must hold** is in the constants below, for every state of the bounds in the tests.
//! **What ties it to the code**: a term has a value. `code` leads the real machines along histories of the model; each
//! message must have the bytes of its term, each disk the keys of the model, and what the model refuses must change
//! no disk. So a field, a label, an order or a check that changes in the code alone fails there.
//! **That it can fail**: each [`Flaw`] is found.
//! **The order to zeroize**, steps 6 and 7, has a model of its own (`orders`): it shares nothing with these but the static keys.
//!
//! **Not shown**: anything of real cryptography. A secret cannot be guessed, a seal cannot be bent, there are no points of low order,
//! and what is wiped is gone. No time: an attempt may be given up at any moment, and only where the design leans on time (a ground that pairs
//! waits until an earlier session must be over) is it modelled as such. No rate limits, no cookie (step 5), hints or
//! rejections, which change no key; no failing disks (`faults`); not the legacy exchange, which nothing falls back to (`attacks`).
//! More sessions than the bounds: `mavlink-link/formal` has the handshakes for ProVerif, with any number of them.

mod code;
mod ends;
mod messages;
mod orders;
mod search;
mod terms;

use std::time::Instant;

use search::{Explored, Scope};
use terms::Name;

const SECRET: &str = "nobody else can make a key, whatever leaks later";
const GENUINE: &str = "an end takes nothing in the other's name but what that has sent";
const ONCE: &str = "no key is staged twice, and no completed exchange begins again";
const STAGED: &str = "what the agent stages the ground has stored";
const AGREED: &str = "what the ground takes for agreed the agent has staged";
const IN_FORCE: &str =
    "both ends have the key that is in force, and any that the autopilot may be given";

/// A mistake that somebody could make in the protocol: the search must find each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Flaw {
    /// No Diffie-Hellman of both ephemeral keys.
    NoEphemerals,
    /// None of the initiator's static key.
    NoInitiatorKey,
    /// The code is not mixed into the handshake, and makes no gate.
    NoCode,
    /// The code makes no gate: anybody may answer a ground that pairs, and make it replace its `next`.
    NoGate,
    /// The responder takes any counter.
    NoCounter,
    /// The responder stages the key at step 1.
    StagesUnconfirmed,
    /// The ground believes step 4 without its proof.
    BelievesOutcome,
    /// The ground stores `next` only when step 4 is there.
    GroundStoresLate,
    /// The ground deletes the key in force when it stores `next`.
    DeletesEarly,
    /// The ground does not keep the key before.
    DropsPrevious,
    /// Step 1 does not withdraw a staged key.
    KeepsNext,
    /// A staged key is replaced that the autopilot may have.
    ReplacesSent,
    /// The ground replaces a `next` that the responder reports as its key in force.
    DoesNotPromote,
    /// The ground pairs again while an earlier session may be open at the agent.
    DoesNotWait,
}

const REKEY: Scope = Scope {
    peer: Some(Name::Ground),
    sessions: 2,
    answers: 2,
    restarts: 1,
    windows: 0,
    falls: 1,
    leaks: &[Name::Ground, Name::Air, Name::FirstKey],
    most_leaks: 0,
    // Between pinned ends nothing rests on the gate.
    open_gate: true,
    flaw: None,
};

/// Two sessions: a pairing and another, or a pairing and a rekey.
const PAIRING: Scope = Scope {
    peer: None,
    windows: 1,
    leaks: &[Name::Ground, Name::Air, Name::Code, Name::FirstKey],
    open_gate: false,
    ..REKEY
};

/// The thief has the static key of the old ground computer and the signing key in force.
const REVOCATION: Scope = Scope {
    peer: Some(Name::Stolen),
    ..PAIRING
};

fn holds(scope: Scope, min_states: usize) -> Explored {
    let found = scope.explore();
    if let Some((promise, trace)) = &found.broken {
        panic!("not so: {promise}, after {trace:#?}");
    }
    assert!(
        found.states() >= min_states,
        "only {} states: it does not move",
        found.states()
    );
    assert!(found.in_force, "no agreed key comes into force");
    assert!(
        found.most_keys >= scope.sessions.into(),
        "a session that gives no key"
    );
    found
}

#[test]
fn a_rekey_holds_over_two_sessions_a_restart_a_fallback_and_a_leak() {
    let found = holds(
        Scope {
            most_leaks: 1,
            ..REKEY
        },
        40_000,
    );
    assert!(found.posed, "who has a static key can pose as its owner");
}

#[test]
fn a_rekey_holds_whatever_leaks() {
    holds(
        Scope {
            sessions: 1,
            most_leaks: 3,
            ..REKEY
        },
        10_000,
    );
}

#[test]
fn a_pairing_and_what_follows_hold_over_two_sessions_a_restart_and_a_leak() {
    let found = holds(
        Scope {
            most_leaks: 1,
            ..PAIRING
        },
        20_000,
    );
    assert!(found.posed, "who has the code can pair");
    holds(
        Scope {
            windows: 2,
            answers: 3,
            ..PAIRING
        },
        10_000,
    );
}

#[test]
fn a_pairing_holds_whatever_leaks() {
    holds(
        Scope {
            sessions: 1,
            most_leaks: 4,
            ..PAIRING
        },
        20_000,
    );
}

#[test]
fn who_has_stolen_a_ground_computer_has_nothing_once_another_is_paired() {
    let found = holds(REVOCATION, 5_000);
    assert!(found.posed, "until then he can pose as it");
}

#[test]
fn every_mistake_is_found() {
    let mut silent = Vec::new();
    for (flaw, scope, leaks, promise) in [
        (Flaw::NoEphemerals, REKEY, 2, SECRET),
        (Flaw::NoInitiatorKey, REKEY, 1, GENUINE),
        (Flaw::NoCode, PAIRING, 0, GENUINE),
        (Flaw::NoGate, PAIRING, 0, IN_FORCE),
        (Flaw::NoCounter, REKEY, 0, ONCE),
        (Flaw::StagesUnconfirmed, REKEY, 0, STAGED),
        (Flaw::BelievesOutcome, REKEY, 0, AGREED),
        (Flaw::GroundStoresLate, REKEY, 0, STAGED),
        (Flaw::DeletesEarly, REKEY, 0, IN_FORCE),
        (Flaw::DropsPrevious, REKEY, 0, IN_FORCE),
        (Flaw::KeepsNext, REKEY, 0, IN_FORCE),
        (Flaw::ReplacesSent, REKEY, 0, IN_FORCE),
        (Flaw::DoesNotPromote, REKEY, 0, IN_FORCE),
        (Flaw::DoesNotWait, PAIRING, 0, IN_FORCE),
    ] {
        let scope = Scope {
            flaw: Some(flaw),
            most_leaks: leaks,
            ..scope
        };
        let found = scope.explore().broken.map(|(promise, _)| promise);
        if found != Some(promise) {
            silent.push((flaw, found));
        }
    }
    assert!(silent.is_empty(), "{silent:?}");
}

/// Every history of a small bound, and every so many of the larger ones.
#[test]
fn the_code_sends_accepts_and_stores_what_the_model_does() {
    for (scope, every) in [
        (
            Scope {
                sessions: 1,
                answers: 1,
                ..REKEY
            },
            1,
        ),
        (
            Scope {
                sessions: 1,
                answers: 1,
                ..PAIRING
            },
            1,
        ),
        (
            Scope {
                most_leaks: 1,
                falls: 0,
                ..REKEY
            },
            97,
        ),
        (
            Scope {
                most_leaks: 1,
                falls: 0,
                ..PAIRING
            },
            97,
        ),
        (REVOCATION, 97),
    ] {
        let found = scope.explore();
        assert!(found.broken.is_none());
        for number in (0..found.states()).step_by(every) {
            code::follow(&scope, &found.trace(number));
        }
    }
}

/// Larger bounds, for a change of the protocol: minutes. The figures are in docs/guide/reliability.md.
///
/// ```text
/// cargo test -p mavlink-link --test key_exchange larger_bounds -- --ignored --nocapture
/// ```
#[test]
#[ignore = "minutes; by hand, after a change of the protocol"]
#[allow(clippy::print_stdout, reason = "its figures are its product")]
fn larger_bounds() {
    for (name, scope) in [
        (
            "three rekeys",
            Scope {
                sessions: 3,
                answers: 3,
                ..REKEY
            },
        ),
        (
            "two rekeys, two restarts, two leaks",
            Scope {
                restarts: 2,
                most_leaks: 2,
                answers: 3,
                ..REKEY
            },
        ),
        (
            "a pairing, two windows, a leak",
            Scope {
                windows: 2,
                answers: 3,
                most_leaks: 1,
                ..PAIRING
            },
        ),
        (
            "a pairing, two rekeys",
            Scope {
                sessions: 3,
                answers: 3,
                ..PAIRING
            },
        ),
        (
            "a revocation, two windows, a leak",
            Scope {
                windows: 2,
                most_leaks: 1,
                ..REVOCATION
            },
        ),
    ] {
        let begun = Instant::now();
        let found = holds(scope, 10_000);
        println!("{name}: {} states, {:?}", found.states(), begun.elapsed());
    }
}
