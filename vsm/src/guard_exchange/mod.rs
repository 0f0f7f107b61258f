//! The guard of a CUCS and the VSM agree about their key over the DLI's own port: by a code once, then by their static keys.
//!
//! It is the exchange of [`mavlink_link::exchange`], carried in [`ExchangeDatagram`]s. The guard starts it, since it knows where the
//! VSM is; the VSM answers, with the limits and cookies that a port which anybody reaches needs. Both ends are sans-I/O: time,
//! random bytes, disk and keys are handed in.
//!
//! Promised, and tested under loss, replay and a restart of either end at any write (`vsm/tests/keys/guard_pairing`):
//! - Who has neither the code nor a static key changes nothing but counters. A window is opened at the VSM's computer only, for one
//!   pairing.
//! - A key that the VSM takes is always on the guard's disk: the guard stores it before the VSM can have it.
//! - The key before is taken for a day more at the VSM, so that no step costs a CUCS its aircraft.
//!
//! Once the VSM has a new key, it is in force there; the guard puts it in force as soon as it is told so under the keys of the exchange,
//! or anything of the VSM verifies under it. An end that was ended in between finds out by itself: the guard sends an empty
//! datagram under a key that it is not sure of, which the VSM answers under the same.
//!
//! In this order: `vsm_end` answers, `cucs_end` asks.

mod cucs_end;
mod vsm_end;

pub use cucs_end::{CucsEnd, CucsFiles, CucsNews};
pub use vsm_end::{OpenError, VsmEnd, VsmNews};

use mavlink_link::exchange::{Message, Parties, Wanted};
use stanag_msgs::Id;
use stanag_msgs::guard::{Direction, ExchangeDatagram};

/// What the keys are for: nothing beside the one key.
const WANTED: Wanted = Wanted {
    signing: true,
    confidential: false,
};

fn parties(vsm: Id, cucs: Id) -> Parties {
    Parties::of_guard(vsm.0, cucs.0)
}

fn datagram(direction: Direction, cucs: Id, vsm: Id, message: &Message) -> Vec<u8> {
    let step = ExchangeDatagram {
        direction,
        cucs,
        vsm,
        payload: &message.to_payload(),
    };
    step.to_bytes()
}
