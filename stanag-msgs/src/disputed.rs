//! What sources are silent on or disagree about, what this project took, and how to change it.
//!
//! Each entry of [`DISPUTED`] has a key `dli.disputed.<name>` in the configuration. A CUCS that
//! reads the standard otherwise is met by setting it: [`Profile`](crate::Profile) translates
//! between the wire and the values below, which are all that the rest of the program knows.

use crate::table::Confidence::{self, B, C, NotFound};

/// A question that the sources leave open.
#[derive(Debug)]
pub struct Disputed {
    /// Its name; see [`Disputed::key`].
    pub name: &'static str,
    /// What is open.
    pub question: &'static str,
    /// What is taken unless the configuration says otherwise.
    pub default: &'static str,
    /// What may be configured.
    pub choices: Choices,
    /// What the sources say, by their tags.
    pub sources: &'static str,
    /// How sure the default is.
    pub confidence: Confidence,
}

/// What a configuration may choose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Choices {
    /// One of these.
    OneOf(&'static [&'static str]),
    /// The values on the wire of these meanings, in their order, separated by commas.
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

/// All open questions.
pub static DISPUTED: &[Disputed] = &[
    Disputed {
        name: "loi_bits",
        question: "the bits of LOI 2, 3, 4, 5 in messages 1, 2, 4, 5",
        default: "ed2",
        choices: Choices::OneOf(&["ed2", "m"]),
        sources: "E2 and F: 1, 2, 4, 8; M, perhaps after Edition 3: 2, 4, 8, 16, and 1 for none",
        confidence: C,
    },
    Disputed {
        name: "checksum_1",
        question: "what checksum code 1 means",
        default: "sum",
        choices: Choices::OneOf(&["sum", "crc16"]),
        sources: "E3, KP and M: bytes added, 2 bytes; T: CRC-16-CCITT (taken with initial value 0xFFFF)",
        confidence: B,
    },
    Disputed {
        name: "turn_rate_step",
        question: "the step in rad/s of Commanded Turn Rate in 2016 and 3002",
        default: "0.0001",
        choices: Choices::OneOf(&["0.0001", "0.005"]),
        sources: "E3 text of 0104.08: 0.0001; T: 0.005",
        confidence: C,
    },
    Disputed {
        name: "message_5_presence_bytes",
        question: "bytes of message 5's presence vector",
        default: "2",
        choices: Choices::OneOf(&["2", "3"]),
        sources: "the rule of one bit a field for 16 fields: 2; T: 3",
        confidence: B,
    },
    Disputed {
        name: "ack_type",
        question: "17000 Acknowledgement Type",
        default: "1,2,3",
        choices: Choices::Values(&["received", "carried out", "refused"]),
        sources: "T's code: 1 received; the others are of this project",
        confidence: NotFound,
    },
    Disputed {
        name: "heading_reference",
        question: "2016 Heading Reference",
        default: "0,1",
        choices: Choices::Values(&["true", "magnetic"]),
        sources: "none; new since Edition 3",
        confidence: NotFound,
    },
    Disputed {
        name: "waypoint_type",
        question: "13002 Waypoint Type",
        default: "0,1",
        choices: Choices::Values(&["normal", "end of a loop"]),
        sources: "none; exists since Edition 2 Amendment 2 (0802.17)",
        confidence: NotFound,
    },
    Disputed {
        name: "limit_type",
        question: "13002 Limit Type: what Loop Limit counts",
        default: "0,1,2",
        choices: Choices::Values(&["none", "count", "time"]),
        sources: "none; exists since Edition 2 Amendment 2 (0802.18)",
        confidence: NotFound,
    },
    Disputed {
        name: "loiter_duration_units",
        question: "Loiter Duration Units in 2017, 3004 and 13003",
        default: "0,1",
        choices: Choices::Values(&["seconds", "turns"]),
        sources: "K names both, no values",
        confidence: NotFound,
    },
    Disputed {
        name: "loiter_length_units",
        question: "Loiter Length Units in 2017, 3004 and 13003",
        default: "0",
        choices: Choices::Values(&["distance"]),
        sources: "T: a length in metres where it says distance; no values",
        confidence: NotFound,
    },
    Disputed {
        name: "presence_vector_support",
        question: "Presence Vector Support in 1, 2, 4 and 5",
        default: "0,1",
        choices: Choices::Values(&["full vectors only", "partial vectors"]),
        sources: "none",
        confidence: NotFound,
    },
    Disputed {
        name: "contingency_modes",
        question: "the flight modes new in Edition 4, in 1, 2, 2016 and 3001",
        default: "23,24,25",
        choices: Choices::Values(&["contingency A", "contingency B", "slave to location"]),
        sources: "KP: the names; the values follow on from E2's 22",
        confidence: C,
    },
    Disputed {
        name: "altitude_type_3",
        question: "the datum of altitude type 3, WGS-84",
        default: "ellipsoid",
        choices: Choices::OneOf(&["ellipsoid"]),
        sources: "E2, E3 and F: WGS-84; E3's text adds the word geoid",
        confidence: B,
    },
    Disputed {
        name: "heartbeat_type",
        question: "the Message Type of the heartbeat",
        default: "16002",
        choices: Choices::OneOf(&["16002"]),
        sources: "T, with a table reference that cannot be right; K does not list it",
        confidence: C,
    },
];

/// Enumerations whose values no source gives, or one only: the values are this project's.
pub mod values {
    use crate::enums::EnumInfo;
    use crate::enums::macros::enumerations;
    use crate::table::Confidence::NotFound;

    enumerations! {
        HeadingReference(u8) = "heading_reference", NotFound, source "none",
            description "new in Ed3/4; values not found" {
            True = 0 "true";
            Magnetic = 1 "magnetic";
        }

        LoiterLengthUnits(u8) = "loiter_length_units", NotFound, source "none",
            description "13003.02 / 3004.03, new in Ed3/4; values not found" {
            Distance = 0 "distance";
        }

        LoiterDurationUnits(u8) = "loiter_duration_units", NotFound, source "none",
            description "13003.06 / 3004.05, new in Ed3/4; values not found (the Korean text implies time vs turns?)" {
            Seconds = 0 "seconds";
            Turns = 1 "turns";
        }

        FlyingBehaviour(u8) = "flying_behaviour", NotFound, source "none",
            description "13003.01 / 3004.01, new in Ed3/4; values not found" {
        }

        AltitudeChangeBehaviour(u8) = "altitude_change_behaviour", NotFound, source "none",
            description "0802.20 (Ed2 Amd2) / 3004.02; values not found" {
        }

        WaypointType(u8) = "waypoint_type", NotFound, source "none",
            description "0802.17, exists since Ed2 Amd2; values not found" {
            Normal = 0 "normal";
            EndOfLoop = 1 "end of a loop";
        }

        LimitType(u8) = "limit_type", NotFound, source "none",
            description "0802.18 (what Loop Limit counts); values not found" {
            None = 0 "none";
            Count = 1 "count";
            Time = 2 "time";
        }

        PresenceVectorSupport(u8) = "presence_vector_support", NotFound, source "none",
            description "whether the sender supports partial presence vectors; values not found (0/1 assumed)" {
            FullOnly = 0 "full presence vectors only";
            Partial = 1 "partial presence vectors";
        }

        AckType(u8) = "ack_type", NotFound, source "T code",
            description "#17000 Acknowledgement Type 17000.01; only value 1 = received is used by T's code" {
            Received = 1 "received (T)";
            CarriedOut = 2 "carried out";
            Refused = 3 "refused";
        }
    }
}

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
        assert_eq!(DISPUTED[0].key(), "dli.disputed.loi_bits");
        assert!(Disputed::find("nothing").is_none());
    }
}
