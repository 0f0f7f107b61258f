//! What this VSM does with those messages of Edition 2.5 that are not just another form of one of Edition 4.
//!
//! All others are translated field by field, and the table for Edition 4 applies to them.

use stanag_msgs::table::{Direction, MessageInfo};

use super::lookup::message;

/// One message of Edition 2.5.
#[derive(Debug, Clone, Copy)]
pub struct Edition25 {
    /// Its Message Type.
    pub id: u16,
    /// Its effect, or when it is sent.
    pub does: &'static str,
    /// Numbers of fields that have an effect although Edition 4 has no place for them.
    pub honoured: &'static [u8],
}

/// The row of a message, where it has one.
#[must_use]
pub fn edition_25(id: u16) -> Option<&'static Edition25> {
    EDITION_25.iter().find(|row| row.id == id)
}

/// All rows, in the order of their types.
#[must_use]
pub fn edition_25_rows() -> &'static [Edition25] {
    EDITION_25
}

/// How a message of Edition 2.5 is handled.
#[derive(Debug, Clone, Copy)]
pub enum In25 {
    /// As its row describes.
    ByHand(&'static Edition25),
    /// Field by field, as the table has it for the corresponding messages of Edition 4.
    FieldByField,
    /// It is refused by name, for this reason.
    Refused(&'static str),
    /// A VSM may send it, and this one never does, for this reason.
    Never(&'static str),
}

/// How a message of Edition 2.5 is handled, by the rows of both editions.
#[must_use]
pub fn in_edition_25(info: &MessageInfo) -> In25 {
    if let Some(row) = edition_25(info.id) {
        return In25::ByHand(row);
    }
    let uses =
        |id: &u16| message(*id).is_some_and(|row| !row.taken.is_empty() || !row.sends.is_empty());
    if info.ed4_messages.iter().any(uses) {
        In25::FieldByField
    } else if info.direction == Direction::ToCucs {
        In25::Never(reason(NEVER, info.id))
    } else {
        In25::Refused(reason(REFUSED, info.id))
    }
}

type Reasons = &'static [(&'static [u16], &'static str)];

fn reason(of: Reasons, id: u16) -> &'static str {
    let mut reasons = of.iter();
    let found = reasons.find(|(ids, _)| ids.contains(&id));
    found.map_or("", |(_, why)| why)
}

/// Why a message that a VSM may send is never sent.
static NEVER: Reasons = &[
    (
        &[303],
        "no radar is connected to this VSM: MAVLink has no message of one that makes images",
    ),
    (
        &[304],
        "MAVLink has no message of stores: what a gripper or a winch does is not reported as theirs",
    ),
    (
        &[305],
        "PX4 relays nothing but MAVLink, and reports no relay and no state of one",
    ),
    (
        &[308],
        "PX4 reports no doors of a bay: an output that moves them shows no position",
    ),
    (
        &[503],
        "an antenna on a pedestal is no part of a MAVLink link: PX4 reports none, and this VSM drives none",
    ),
    (
        &[1600],
        "PX4 drives transponders, and reports the state of none over MAVLink",
    ),
];

/// Why a message that a CUCS may send is refused.
static REFUSED: Reasons = &[
    (
        &[40],
        "the configuration of the vehicle is set in its parameters",
    ),
    (&[44], "PX4 reports no lights, so none could be confirmed"),
    (
        &[47],
        "a route is flown at the places that its waypoints name, and is not moved",
    ),
    (
        &[202, 203, 204, 206, 207],
        "payloads are gimbals and cameras: radars, stores, relays, bays and terrain data have no MAVLink command here",
    ),
    (
        &[400, 401, 402, 403],
        "data links are the link's own matter, no radio is connected to this VSM",
    ),
    (
        &[805],
        "PX4's missions switch no lights and no data links, and their actuator items would move the outputs 5 and 6 too",
    ),
    (&[1500, 1501], "no transponder is connected to this VSM"),
];

macro_rules! rows {
    ($($id:literal $does:literal $([$($field:literal),*])?;)*) => {
        static EDITION_25: &[Edition25] = &[$(
            Edition25 { id: $id, does: $does, honoured: &[$($($field),*)?] },
        )*];
    };
}

rows! {
    1 "1; a broadcast is a question whatever levels it names, and its mode must be 0";
    20 "3";
    21 "2; in answer to #1 and on every change also one line for each other holder, with its id in field 3";
    41 "2017; altitude and speed are flown in mode 12, unless #48 says manual" [9, 10, 11, 12];
    42 "2016, with what the #43 before it commands for that mode; mode 2 is refused, since it is flown by sticks";
    43 "2016 where #48 and the mode let it rule, else kept for the next #42: an altitude or a heading whose command type is \
        not 0, a speed and an altimeter setting that are not 0, and a waypoint that is new";
    48 "kept, and reported by #109; 1 becomes 0 when a waypoint is reached" [4, 5, 6];
    101 "4000, once position and altitude are known; not while they are not";
    104 "3002, once the altitude and the energy level are known, with what was commanded last where nothing is, or what is flown; flaps, brakes and gear are 0";
    109 "after #48, on #1403, and when a preference ends" [4, 5, 6];
    205 "19100 of the station that has the device's number, whose camera records: 0 ends a recording (system mode 12), 2 begins one (10); \
         play, seek, ready and replay are refused, rate and indices ignored" [4, 6, 9];
    306 "on #1403, one for each station whose camera reports whether it records: recording, or ready; no index, no rate and no replay" [4, 6];
    307 "on #1403, one for each such station: its recorder has its number" [4, 5];
    802 "13002; contingency waypoints become contingency routes, which must be the same for all waypoints of a flight route; \
         a speed of 0 and a time without speed type 3 fill their places" [13, 14];
    803 "13003 with seconds; a time of 0 is no loiter";
    900 "14000";
    1100 "16000, with the numbers of Edition 2.5; each part of a long text is an alert with a number of its own";
    1200 "40000, by the numbers of Edition 2.5; #1303 at once for what has no place in Edition 4";
    1201 "acknowledged: there are no remote displays beside the status page";
    1202 "answered by #1304 with the status page, whatever it lists";
    1300 "41000 and 41003, in the units of the field; a control of unknown range has that of the type";
    1301 "41000, 41001 and 41003 of a field that is a float here, in its unit; a control of unknown range has that of the type";
    1302 "41002";
    1303 "44003, and for each message of the level that has none in Edition 4" [4, 5];
    1400 "17000 types 1 and 2, once for each message; not of one that is refused, which #1100 says. Of a station it proves an \
          address";
    1401 "its message is acknowledged from then on, until a release or an abort; sent with #1403 to ask an address for a proof" [6];
    1402 "17001; less than 1 Hz is 1 Hz";
    1403 "17002";
    2012 "50012 without the range; also the value of each control after its #1300 or #1301, and when it is another";
}

#[cfg(test)]
mod tests {
    use super::*;
    use stanag_msgs::ed25;

    #[test]
    fn every_message_that_is_refused_or_never_sent_says_why_and_no_other() {
        let (mut refused, mut never) = (Vec::new(), Vec::new());
        for info in ed25::messages() {
            let (why, of) = match in_edition_25(info) {
                In25::Refused(why) => (why, &mut refused),
                In25::Never(why) => (why, &mut never),
                In25::ByHand(_) | In25::FieldByField => continue,
            };
            assert!(!why.is_empty(), "{}", info.id);
            of.push(info.id);
        }
        let named = |reasons: Reasons| -> Vec<u16> {
            reasons.iter().flat_map(|(ids, _)| *ids).copied().collect()
        };
        assert_eq!((named(REFUSED), named(NEVER)), (refused, never));
    }

    #[test]
    fn rows_name_messages_of_the_edition_and_fields_without_a_place() {
        assert!(EDITION_25.is_sorted_by(|one, next| one.id < next.id));
        for row in EDITION_25 {
            let info = ed25::message(row.id.into(), ed25::Version::Ed25).expect("a message");
            for number in row.honoured {
                let field = &info.fields[usize::from(*number) - 1];
                assert!(field.ed4.is_none(), "{} {}", row.id, field.name);
            }
        }
    }
}
