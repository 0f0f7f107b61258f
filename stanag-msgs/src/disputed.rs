//! What sources do not give or disagree about, what this project chose, and how to change it.
//!
//! Each entry of [`DISPUTED`] has a key `dli.disputed.<name>` in the configuration. A CUCS that
//! reads the standard differently is supported by setting it: [`Profile`](crate::Profile) translates
//! between the wire and the values that the messages have here, so nothing else ever sees them.
//!
//! A point with a single reading is not a setting: [`SETTLED`] lists these, each with its clause. A configuration
//! that names such a point is accepted where it names this reading, and refused with the clause where it names
//! another.

use crate::field::Confidence::{self, B, C, NotFound};

/// A question that the sources leave open.
#[derive(Debug)]
pub struct Disputed {
    /// Its name in a configuration; see [`Disputed::key`].
    pub name: &'static str,
    /// What is open.
    pub question: &'static str,
    /// The reading used unless the configuration sets another.
    pub default: &'static str,
    /// What may be configured.
    pub choices: Choices,
    /// The least wire value of [`Choices::Values`]: what is below it is settled, and has another meaning.
    pub lowest: u8,
    /// What the sources give, by their tags.
    pub sources: &'static str,
    /// How sure the default is.
    pub confidence: Confidence,
}

/// What a configuration may choose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choices {
    /// One of these.
    OneOf(&'static [&'static str]),
    /// The wire values of these meanings, in this order, separated by commas.
    Values(&'static [&'static str]),
}

impl Disputed {
    /// The key in the configuration.
    pub fn key(&self) -> String {
        format!("dli.disputed.{}", self.name)
    }

    /// The entry of this name.
    pub fn find(name: &str) -> Option<&'static Disputed> {
        DISPUTED.iter().find(|disputed| disputed.name == name)
    }
}

/// A point that was open, or seems to be, and has a single reading.
#[derive(Debug)]
pub struct Settled {
    /// Its name in a configuration.
    pub name: &'static str,
    /// What the reading decides.
    pub question: &'static str,
    /// The reading, as a configuration may name it.
    pub reading: &'static str,
    /// What it means.
    pub meaning: &'static str,
    /// The clause that decides it, or the source that is used for lack of a clause.
    pub by: &'static str,
}

impl Settled {
    /// The entry of this name.
    pub fn find(name: &str) -> Option<&'static Settled> {
        SETTLED.iter().find(|settled| settled.name == name)
    }
}

/// All points that have a single reading.
pub static SETTLED: &[Settled] = &[
    Settled {
        name: "loi_bits",
        question: "the bits of LOI 2, 3, 4, 5 in messages 1, 2, 4, 5",
        reading: "ed2",
        meaning: "1, 2, 4, 8",
        by: "Edition 2.5, #1 field 8 (0001.08) and #21 fields 6 and 7 (0021.06, 0021.07): the same fields, which Edition 4 keeps",
    },
    Settled {
        name: "altitude_type_3",
        question: "the datum of altitude type 3, WGS-84",
        reading: "ellipsoid",
        meaning: "height above the ellipsoid",
        by: "Edition 2.5 names it WGS-84 wherever an altitude is commanded (0043.17, 0802.09); the word geoid of 0101.07 is the \
             height that types 0 and 1 have",
    },
    Settled {
        name: "heartbeat_type",
        question: "the Message Type of the heartbeat",
        reading: "16002",
        meaning: "16002",
        by: "no source names another; Edition 2.5 has no heartbeat",
    },
];

/// All open questions.
pub static DISPUTED: &[Disputed] = &[
    Disputed {
        name: "checksum_1",
        question: "what checksum code 1 means",
        default: "sum",
        choices: Choices::OneOf(&["sum", "crc16"]),
        lowest: 0,
        sources: "E3, KP and M: bytes added, 2 bytes; T: CRC-16-CCITT (taken with initial value 0xFFFF)",
        confidence: B,
    },
    Disputed {
        name: "turn_rate_step",
        question: "the step in rad/s of Commanded Turn Rate in 2016 and 3002",
        default: "0.0001",
        choices: Choices::OneOf(&["0.0001", "0.005"]),
        lowest: 0,
        sources: "E3 text of 0104.08: 0.0001; T: 0.005",
        confidence: C,
    },
    Disputed {
        name: "message_5_presence_bytes",
        question: "bytes of message 5's presence vector",
        default: "2",
        choices: Choices::OneOf(&["2", "3"]),
        lowest: 0,
        sources: "the rule of one bit a field for 16 fields: 2; T: 3",
        confidence: B,
    },
    Disputed {
        name: "ack_type",
        question: "17000 Acknowledgement Type",
        default: "1,2,3",
        choices: Choices::Values(&["received", "carried out", "refused"]),
        lowest: 0,
        sources: "T's code: 1 received; the others are of this project",
        confidence: NotFound,
    },
    Disputed {
        name: "heading_reference",
        question: "2016 Heading Reference",
        default: "0,1",
        choices: Choices::Values(&["true", "magnetic"]),
        lowest: 0,
        sources: "none; new since Edition 3",
        confidence: NotFound,
    },
    Disputed {
        name: "waypoint_type",
        question: "13002 Waypoint Type",
        default: "0,1",
        choices: Choices::Values(&["normal", "end of a loop"]),
        lowest: 0,
        sources: "none; exists since Edition 2 Amendment 2 (0802.17)",
        confidence: NotFound,
    },
    Disputed {
        name: "limit_type",
        question: "13002 Limit Type: what Loop Limit counts",
        default: "0,1,2",
        choices: Choices::Values(&["none", "count", "time"]),
        lowest: 0,
        sources: "none; exists since Edition 2 Amendment 2 (0802.18)",
        confidence: NotFound,
    },
    Disputed {
        name: "loiter_duration_units",
        question: "Loiter Duration Units in 2017, 3004 and 13003",
        default: "0,1",
        choices: Choices::Values(&["seconds", "turns"]),
        lowest: 0,
        sources: "K names both, no values",
        confidence: NotFound,
    },
    Disputed {
        name: "loiter_length_units",
        question: "Loiter Length Units in 2017, 3004 and 13003",
        default: "0",
        choices: Choices::Values(&["distance"]),
        lowest: 0,
        sources: "T: a length in metres where it says distance; no values",
        confidence: NotFound,
    },
    Disputed {
        name: "presence_vector_support",
        question: "Presence Vector Support in 1, 2, 4 and 5",
        default: "0,1",
        choices: Choices::Values(&["full vectors only", "partial vectors"]),
        lowest: 0,
        sources: "none",
        confidence: NotFound,
    },
    Disputed {
        name: "contingency_modes",
        question: "the flight modes new in Edition 4, in 1, 2, 2016 and 3001",
        default: "23,24,25",
        choices: Choices::Values(&["contingency A", "contingency B", "slave to location"]),
        // Edition 2 settles 0 to 22: under 11, a command to fly the route (2016) would be carried out as contingency A.
        lowest: 23,
        sources: "KP: the names; the values follow on from E2's 22",
        confidence: C,
    },
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_default_is_a_choice() {
        for disputed in DISPUTED {
            match disputed.choices {
                Choices::OneOf(choices) => assert!(choices.contains(&disputed.default)),
                Choices::Values(meanings) => {
                    assert_eq!(disputed.default.split(',').count(), meanings.len());
                }
            }
            assert_eq!(Disputed::find(disputed.name).unwrap().key(), disputed.key());
        }
        assert_eq!(DISPUTED[0].key(), "dli.disputed.checksum_1");
        assert!(Disputed::find("nothing").is_none());
    }

    /// A setting with a single value is not a setting.
    #[test]
    fn what_is_open_has_a_choice_and_what_is_settled_is_not_open() {
        for disputed in DISPUTED {
            if let Choices::OneOf(choices) = disputed.choices {
                assert!(choices.len() > 1, "{}", disputed.name);
            }
            assert!(Settled::find(disputed.name).is_none(), "{}", disputed.name);
        }
    }
}
