//! Every rate limit of the VSM: how much, of what, and why that much.
//!
//! They bound what a flood of one sender costs all others. What is beyond its rate is dropped, refused or left out by whoever
//! applies the limit. `allowance` has the buckets of a [`Rate`], `paths` those of [`Limits`]. How much may wait in a queue stands
//! beside the queue, and `link/budget.rs` keeps to `vehicle.rate_bps`.

use std::time::Duration;

use crate::config::Dli;

/// How fast messages may come.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rate {
    /// One in this time.
    pub(crate) cost: Duration,
    /// So many at once after a pause.
    pub(crate) at_once: u32,
}

impl Rate {
    pub(crate) const fn one_in(cost: Duration, at_once: u32) -> Rate {
        Rate { cost, at_once }
    }

    /// What is used at once comes in this time otherwise.
    pub(crate) fn burst(self) -> Duration {
        self.cost * self.at_once
    }

    /// The time that so many together cost.
    pub(crate) fn cost_of(self, count: u32) -> Duration {
        self.cost * count.min(self.at_once)
    }
}

// What one station may send, counted apart for its own address and for others in its name (`paths/senders.rs`).

/// Commands, which are logged each. An upload of 10,000 waypoints is slowed down, and sent again where it was cut.
pub(crate) const COMMANDS: Rate = Rate::one_in(Duration::from_millis(1), 2_000);
/// Queries, sticks and heartbeats, which cost no write.
pub(crate) const QUESTIONS: Rate = Rate::one_in(Duration::from_micros(250), 8_000);
/// The parts of all computers, each of which may send as much in a station's name as the station itself.
pub(crate) const COMPUTERS: usize = 8;
/// Frames of one web client, before they are verified.
pub(crate) const WEB_FRAMES: Rate = Rate::one_in(Duration::from_millis(2), 1_000);

// What one station may cause.

/// Changes of its rights that are synchronised, each of which may take the disk 100 ms.
pub(crate) const RIGHTS: Rate = Rate::one_in(Duration::from_millis(250), 32);
/// Changes of LOI 2 alone, which are written but not synchronised, and each start with a set of reports.
pub(crate) const MONITORS: Rate = Rate::one_in(Duration::from_millis(100), 40);
/// The same pending handover, passed on again to who has to answer it: a station repeats its request each 0.5 s, and one that repeats it
/// without pause must not flood the holder.
pub(crate) const CONVEYED: Rate = Rate::one_in(Duration::from_millis(400), 1);
/// Single parameters: at once as many as a vehicle has.
pub(crate) const PARAMETERS: Rate = Rate::one_in(Duration::from_millis(10), 1_000);
/// Pings of the vehicle (50014): each is a frame on its link, before commands.
pub(crate) const PINGS: Rate = Rate::one_in(Duration::from_millis(500), 16);
/// Complete lists of parameters: each takes the vehicle some seconds.
pub(crate) const PARAMETER_LISTS: Rate = Rate::one_in(Duration::from_secs(5), 4);

// What one ground station beside the bridge (`[[forward]]`) may ask of each vehicle. Lists have the rate of `PARAMETER_LISTS`.

/// Questions: at once what a ground station asks as it connects, then as fast as it reads a mission. A command of a CUCS never waits
/// behind more than that.
pub(crate) const FORWARDED_QUESTIONS: Rate = Rate::one_in(Duration::from_millis(20), 200);

// What stations are sent of one vehicle.

/// The same refusal to one station.
pub(crate) const SAME_REFUSAL: Rate = Rate::one_in(Duration::from_secs(1), 2);
/// All refusals to one station.
pub(crate) const REFUSALS: Rate = Rate::one_in(Duration::from_millis(250), 32);
/// Messages of texts and events, emergencies apart from all others: a long text is several.
pub(crate) const NOTICES: Rate = Rate::one_in(Duration::from_millis(125), 240);
/// Messages of alerts that begin, change or end.
pub(crate) const ALERTS: Rate = Rate::one_in(Duration::from_millis(50), 200);
/// Changes of the vehicle's own parameters in the log: a ground station that loads a file of them is logged whole, and a value that
/// flutters does not push everything else out of the page's events.
pub(crate) const PARAMETER_NOTES: Rate = Rate::one_in(Duration::from_secs(1), 100);
/// Changes of mode that are reported by themselves, and as many of UA State.
pub(crate) const MODES: Rate = Rate::one_in(Duration::from_millis(100), 40);

/// Refusals of web clients in the log. Whoever is refused without end must not push everything else out of the page's events;
/// the counters have all of them.
pub(crate) const WEB_REFUSALS: Rate = Rate::one_in(Duration::from_secs(10), 6);

/// File transfers in flight, bytes a second on the wire: a seventh of a 57,600 baud radio downlink, and less of the uplink.
pub(crate) const FILES_IN_FLIGHT_BYTES_S: u32 = 8_000;

// What one address is sent.

/// Bytes and messages to one address.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    /// How long status is sent to an address from which nothing comes.
    pub(crate) lease: Duration,
    /// Bytes a second to one station.
    pub(crate) bytes_s: u32,
    /// Messages a second to one station.
    pub(crate) messages_s: u32,
    /// How much of the rate may be used at once.
    pub(crate) burst: Duration,
}

impl Limits {
    /// To a proven address: as configured.
    pub(crate) fn of(dli: &Dli) -> Limits {
        Limits {
            lease: Duration::from_secs_f64(dli.lease_s),
            bytes_s: dli.max_bytes_s,
            messages_s: dli.max_messages_s,
            burst: Duration::from_secs(4),
        }
    }
}

/// The parts of the rate to all unproven addresses together (`paths/unproven.rs`). With [`UNPROVEN_EACH`], [`UNPROVEN_COMPUTER`] and
/// [`UNPROVEN_REST`]: with every part in use a burst of 193 datagrams, then 88 a second. What is sent within three seconds takes some 350 kB of the
/// 416 kB that Linux gives a socket where `net.core.wmem_max` was not raised: it counts 768 bytes for a small datagram.
pub(crate) const UNPROVEN_PARTS: usize = 16;
pub(crate) const UNPROVEN_EACH: Limits = Limits {
    lease: Duration::ZERO,
    bytes_s: u32::MAX,
    messages_s: 3,
    burst: Duration::from_secs(1),
};
pub(crate) const UNPROVEN_COMPUTER: Limits = Limits {
    messages_s: 1,
    ..UNPROVEN_EACH
};
/// Enough for a station that never acknowledges and steers: its commands are acknowledged as received and as carried out.
pub(crate) const UNPROVEN_REST: Limits = Limits {
    messages_s: 24,
    burst: Duration::from_secs(4),
    ..UNPROVEN_EACH
};
/// Status and alerts to the group for an unproven station, bytes a second: enough for some vehicles at their usual rates, but no
/// flood.
pub(crate) const UNPROVEN_GROUP_BYTES_S: u32 = 8_192;
