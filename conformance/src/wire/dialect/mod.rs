//! Edition 2.5 at the border of the wire: the rules are written in messages of Edition 4, whatever edition is judged.
//!
//! [`encode`](writing::encode) turns a draft into the messages of Edition 2.5 with the same meaning; [`counterparts`]
//! turns a message of Edition 2.5 into the messages of Edition 4 that the rules read, each with the original behind
//! it for the evidence. Most fields are mapped by the place that the table of Edition 2.5 names for them
//! (`stanag_msgs::ed25`, which is checked against an oracle of its own). What has another form is written here and
//! shares nothing with the translator of the bridge, so that an error of the bridge is not hidden by the same error
//! here:
//!
//! - Messages that name messages and fields do so by the numbers of their edition ([`places`]).
//! - 2016 is the mode (#42), the demands (#43) and which of them rules (#48).
//! - 3004 does not exist: nothing reports the loiter of #41. The harmless setting by which the suite sees whose commands are
//!   obeyed is the mode preference instead, which #48 sets and #109 reports ([`marker`]).
//! - An acknowledgement is requested by message type (#1401), and #1400 only reports that a message arrived.
//!
//! What has no place is always reported: a draft names what it could not send ([`writing::Made::missing`]), and a
//! rule that reads a field without a place leaves a note ([`take_unplaced`]).

pub mod marker;
pub mod places;
mod reading;
pub mod writing;

use std::cell::RefCell;
use std::collections::BTreeSet;

pub use reading::counterparts;

/// Which side the suite plays: fields 2 and 3 of a message that goes both ways do not show who sent it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// A CUCS; in a recording the CUCS's side counts as the suite's.
    Cucs,
    /// The scripted vehicle.
    Vehicle,
}

/// Seconds from 1970 to 2000.
const EPOCH_2000_S: f64 = 946_684_800.0;
/// A message has arrived.
pub const ACKNOWLEDGEMENT: u16 = 1400;
/// A message type is to be acknowledged from now on.
pub const ACKNOWLEDGE: u16 = 1401;
/// A message is requested.
pub const REQUEST: u16 = 1403;
/// What a CUCS can display, on request.
pub const RESOURCES: u16 = 1202;
/// Vehicle Operating Mode Command: the mode.
const MODE_COMMAND: u16 = 42;
/// What is demanded: altitude, heading, speed, waypoint.
pub const STEERING: u16 = 43;
/// Which of configuration and steering rules, and its report.
pub const PREFERENCE: u16 = 48;
/// The report of the preference.
pub const PREFERENCE_REPORT: u16 = 109;
/// Message of Edition 4 (with 3004) for which [`PREFERENCE`] and its report stand in.
const LOITER: u16 = 2017;
/// #201, which commands what a camera does.
const PAYLOAD_COMMAND: u16 = 201;
/// Message of Edition 4 for which [`PREFERENCE_REPORT`] stands in.
const LOITER_REPORT: u16 = 3004;

thread_local! {
    /// Fields that were read on this thread though Edition 2.5 has none for them.
    static UNPLACED: RefCell<BTreeSet<(u16, String)>> = RefCell::default();
}

/// Notes that a field was read that Edition 2.5 lacks.
pub(super) fn looked_at(kind: u16, field: &str) {
    UNPLACED.with_borrow_mut(|fields| fields.insert((kind, field.to_owned())));
}

/// The fields that were read on this thread since the last call though Edition 2.5 has none for them.
#[must_use]
pub fn take_unplaced() -> BTreeSet<(u16, String)> {
    UNPLACED.take()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::time::Duration;

    use stanag_msgs::Id;

    use super::writing::{Made, Writer, encode};
    use super::*;
    use crate::wire::{Direction, Draft, Seen, split};

    const VEHICLE: Id = Id(0x1b00_0101);
    const STATION: Id = Id(0x1b00_00a0);

    fn made(draft: &Draft) -> Made {
        let writer = Writer {
            role: Role::Cucs,
            source: STATION,
            destination: VEHICLE,
            vsm: Id(0x1b00_0001),
            loiter: None,
        };
        let mut instance = 0;
        encode(draft, &writer, || {
            instance += 1;
            instance
        })
    }

    fn back(made: &Made) -> Vec<Arc<Seen>> {
        let (pieces, fault) = split(&made.bytes());
        assert_eq!(fault, None);
        let pieces = pieces.into_iter().map(|piece| piece.sent_by_cucs(true));
        let originals = pieces.map(|piece| Seen::new(Duration::ZERO, 0, Direction::Sent, 0, piece));
        originals
            .flat_map(|seen| counterparts(&Arc::new(seen)))
            .collect()
    }

    #[test]
    fn what_is_sent_is_seen_again() {
        let draft = Draft::new(13_002)
            .raw("Time Stamp", 1_000)
            .raw("Waypoint Number", 7)
            .set("Waypoint to Latitude or Relative Y", 0.8)
            .set("Waypoint to Altitude", 47.14);
        let made = made(&draft);
        assert!(made.missing.is_empty(), "{:?}", made.missing);
        let seen = &back(&made)[0];
        assert_eq!(
            (seen.piece.source, seen.piece.destination),
            (STATION, VEHICLE)
        );
        assert_eq!(seen.kind(), 13_002);
        for name in [
            "Time Stamp",
            "Waypoint Number",
            "Waypoint to Latitude or Relative Y",
            "Waypoint to Altitude",
        ] {
            assert_eq!(seen.raw(name), draft.seen().raw(name), "{name}");
        }
    }

    #[test]
    fn a_message_both_ways_is_of_its_sender() {
        let made = made(
            &Draft::new(17_002)
                .raw("Time Stamp", 1)
                .raw("Message Type", 4000),
        );
        let seen = &back(&made)[0];
        assert_eq!(seen.piece.source, STATION);
        assert_eq!(seen.raw("Message Type"), Some(4000));
        let original = seen.original.as_ref().unwrap();
        assert_eq!(original.raw("Message Type"), Some(101));
    }

    #[test]
    fn a_mode_with_values_is_three_messages_with_stamps_that_rise() {
        let draft = Draft::new(2016)
            .raw("Time Stamp", 9)
            .raw("Select Flight Path Control Mode", 12)
            .raw("Altitude Command Type", 1)
            .set("Commanded Altitude", 120.0);
        let seen = back(&made(&draft));
        let kinds: Vec<u16> = seen
            .iter()
            .map(|seen| seen.original.as_ref().unwrap().kind())
            .collect();
        assert_eq!(kinds, [PREFERENCE, MODE_COMMAND, STEERING]);
        let stamps: Vec<_> = seen.iter().map(|seen| seen.stamp()).collect();
        assert_eq!(stamps, [Some(7), Some(8), Some(9)]);
        assert_eq!(seen[2].value("Commanded Altitude"), Some(120.0));
        // All fields are on the wire; those that do not count must not reach the rules.
        assert!(!seen[2].has("Commanded Speed"));
    }

    #[test]
    fn what_has_no_place_is_named() {
        let heartbeat = made(&Draft::new(16_002).raw("Time Stamp", 1));
        assert!(heartbeat.messages.is_empty());
        assert_eq!(heartbeat.missing, ["message 16002"]);
        let looped = made(
            &Draft::new(13_002)
                .raw("Waypoint Number", 1)
                .raw("Loop Limit", 3),
        );
        assert_eq!(looped.missing, ["field Loop Limit of 13002"]);
        // And what was read in vain is noted.
        let _ = take_unplaced();
        let seen = back(&made(&Draft::new(13_002).raw("Waypoint Number", 1)));
        assert_eq!(seen[0].raw("Loop Limit"), None);
        assert_eq!(
            take_unplaced().into_iter().collect::<Vec<_>>(),
            [(13_002, "Loop Limit".to_owned())]
        );
    }

    #[test]
    fn values_keep_what_edition_4_would_round_away() {
        let made = made(&Draft::new(13_002).set("Waypoint to Latitude or Relative Y", f64::NAN));
        let (pieces, _) = split(&made.bytes());
        assert!(pieces[0].data[18..26] == f64::NAN.to_be_bytes());
    }
}
