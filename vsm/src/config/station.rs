//! `[[cucs]]`: one ground station, its rights, and how it is spoken to.
//!
//! Stations of different makes are served at once: each is answered, and sent its status, by its own entry. A key that an
//! entry does not set is `auto`: as the station itself sends, or as `[dli]` sets for all.

use std::net::IpAddr;
use std::path::PathBuf;

use serde::de::{self, Deserializer, Unexpected};
use serde::{Deserialize, Serialize};
use stanag_msgs::wrapper::Header;
use stanag_msgs::{ChecksumStyle, Id};

use super::disputed::Readings;
use super::error::{Fault, fault};
use super::key::WhenAbsent::{Nothing, Required, Table, Value};
use super::key::table;
use super::value::{LoiSet, Provisional, id};

table! {
    /// `[[cucs]]`: one ground station and its rights.
    #[derive(Debug, Clone, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Cucs {
        /// In a `[[cucs]]`, identification number of a ground station that may connect (the wrapper's source); with none
        /// listed, none may
        #[serde(deserialize_with = "id")]
        pub id: Id => Required,
        /// Levels of interoperability that it may hold, from 2, 3, 4, 5
        pub loi: LoiSet => Required,
        /// Address that it must send from. It counts as proven: without it a CUCS that never sends acknowledgements (17000) is
        /// sent at most three times the bytes that it sends
        pub address: Option<IpAddr> => Nothing("any"),
        /// Its guard: what arrives in its name is taken from `vsm guard` with the same key alone
        pub guard: Option<Guard> => Table(Guard::KEYS),
        /// Whether it is a web client: it comes by the WebSocket of the page alone, under its guard key, and not by datagrams. Needs
        /// `web.control` and `guard`
        #[serde(default)]
        pub web: bool => Value("false"),
        /// Whether it may take control from another
        #[serde(default, rename = "override")]
        pub override_control["override"]: bool => Value("false"),
        /// 0 to 255: an override takes control from holders of this rank and below
        #[serde(default)]
        pub rank: u8 => Value("0"),
        /// Edition of the DLI that it speaks: `"2.5"`, `"3"`, `"4"`, or `"auto"`, answered as it speaks. Where one is named,
        /// what arrives in its name in another edition is dropped
        #[serde(default, deserialize_with = "auto")]
        pub edition: Option<Edition> => Value("\"auto\""),
        /// Checksum of what it is sent: `"none"`, `"sum16"`, `"sum32"`, `"crc32"` (Edition 4 only), or `"auto"`, as it sends
        #[serde(default, deserialize_with = "auto")]
        pub checksum: Option<Checksum> => Value("\"auto\""),
        /// Presence vectors of what it is sent in Edition 3 or 4: `"full"`, `"partial"`, or `"auto"`: full until it has said that it
        /// supports partial ones (Presence Vector Support of messages 1 and 4), or has sent one
        #[serde(default, deserialize_with = "auto")]
        pub presence: Option<Presence> => Value("\"auto\""),
        /// Where answers and reports for it go: `"unicast"` to its address, `"group"` to `dli.multicast`, `"both"`, which is
        /// unicast alone where there is no group. For a CUCS with a guard the group's copy is sealed under the group's key
        #[serde(default)]
        pub delivery: Delivery => Value("\"both\""),
        /// Whether messages that are due for it together come in one datagram, one behind the other, up to 548 bytes: less work for
        /// both ends. A CUCS has to read all of them (some read the first alone). Edition 2.5 has one in each
        #[serde(default)]
        pub pack: bool => Value("false"),
        /// As `dli.provisional`, for this station: `"off"`, `"status"`, `"all"`
        pub provisional: Option<Provisional> => Nothing("`dli.provisional`"),
        /// As `dli.disputed`, for this station: what it reads in another way than `[dli.disputed]` says
        #[serde(default)]
        pub disputed: Readings => Table(Readings::OF_STATION),
    }
}

table! {
    /// `cucs.guard`
    #[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Guard {
        /// File of the key that the CUCS's guard has too: 32 bytes in hex, mode 0600, written by `vsm guard pair` or
        /// `vsm guard keygen`
        pub key_file: PathBuf => Required,
    }
}

/// `cucs.edition`: an edition of the DLI.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Edition {
    /// Edition 2.5, and Edition 2 with its Amendment 1.
    #[serde(rename = "2.5")]
    Ed25,
    /// Edition 3: IDD version 30.
    #[serde(rename = "3")]
    Ed3,
    /// Edition 4: IDD versions 31 and 32.
    #[serde(rename = "4")]
    Ed4,
}

impl Edition {
    /// The edition of a wrapper with this IDD version.
    #[must_use]
    pub const fn of_idd(idd: u8) -> Edition {
        if idd == Header::IDD_ED3 {
            Edition::Ed3
        } else {
            Edition::Ed4
        }
    }

    /// As the configuration has it.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Edition::Ed25 => "2.5",
            Edition::Ed3 => "3",
            Edition::Ed4 => "4",
        }
    }
}

/// `cucs.checksum`: how what a station is sent is summed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Checksum(pub ChecksumStyle);

impl Checksum {
    /// As the configuration has it.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self.0 {
            ChecksumStyle::None => "none",
            ChecksumStyle::Sum16 => "sum16",
            ChecksumStyle::Sum32 => "sum32",
            ChecksumStyle::Crc32 => "crc32",
        }
    }
}

/// `cucs.presence`: presence vectors of what a station is sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Presence {
    /// Every field is sent.
    Full,
    /// What is not known is absent.
    Partial,
}

/// `cucs.delivery`: where answers and reports for a station go.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Delivery {
    /// To its address.
    Unicast,
    /// To the group alone: a station that receives on another socket than it sends from.
    Group,
    /// To its address, and to the group where there is one.
    #[default]
    Both,
}

impl Delivery {
    /// Whether its address is sent to.
    #[must_use]
    pub const fn to_address(self) -> bool {
        !matches!(self, Delivery::Group)
    }

    /// Whether the group is sent to, where there is one.
    #[must_use]
    pub const fn to_group(self) -> bool {
        !matches!(self, Delivery::Unicast)
    }
}

impl Cucs {
    /// What of it does not fit: each other, or the rest of the file.
    pub(super) fn check(&self, at: usize, has_group: bool) -> Result<(), Fault> {
        if self.delivery == Delivery::Group && !has_group {
            let expected =
                "\"unicast\", or a group to send to: dli.multicast = \"225.200.1.0:51017\"";
            return fault(at, "cucs.delivery", "group without dli.multicast", expected);
        }
        let summed = self.checksum.map(|Checksum(style)| style);
        match (self.edition, summed) {
            (Some(Edition::Ed3), Some(ChecksumStyle::Crc32)) => {
                let expected = "\"none\", \"sum16\" or \"sum32\": Edition 3 has no CRC-32";
                fault(at, "cucs.checksum", "crc32", expected)
            }
            (Some(Edition::Ed25), Some(_)) => {
                let expected = "no such key: every message of Edition 2.5 has a sum of 4 bytes";
                let found = "a checksum with edition = \"2.5\"";
                fault(at, "cucs.checksum", found, expected)
            }
            _ => Ok(()),
        }
    }
}

/// A value of a key that may also be `"auto"`.
trait Choice: Sized + 'static {
    const EXPECTED: &'static str;
    const ALL: &'static [(&'static str, Self)];
}

impl Choice for Edition {
    const EXPECTED: &'static str = "\"auto\", \"2.5\", \"3\" or \"4\", in quotes";
    const ALL: &'static [(&'static str, Self)] = &[
        ("2.5", Edition::Ed25),
        ("3", Edition::Ed3),
        ("4", Edition::Ed4),
    ];
}

impl Choice for Presence {
    const EXPECTED: &'static str = "\"auto\", \"full\" or \"partial\"";
    const ALL: &'static [(&'static str, Self)] =
        &[("full", Presence::Full), ("partial", Presence::Partial)];
}

impl Choice for Checksum {
    const EXPECTED: &'static str = "\"auto\", \"none\", \"sum16\", \"sum32\" or \"crc32\"";
    const ALL: &'static [(&'static str, Self)] = &[
        ("none", Checksum(ChecksumStyle::None)),
        ("sum16", Checksum(ChecksumStyle::Sum16)),
        ("sum32", Checksum(ChecksumStyle::Sum32)),
        ("crc32", Checksum(ChecksumStyle::Crc32)),
    ];
}

fn auto<'de, D: Deserializer<'de>, T: Choice + Copy>(
    deserializer: D,
) -> Result<Option<T>, D::Error> {
    let text = String::deserialize(deserializer)?;
    if text == "auto" {
        return Ok(None);
    }
    let chosen = T::ALL.iter().find(|(name, _)| *name == text);
    chosen
        .map(|(_, value)| Some(*value))
        .ok_or_else(|| de::Error::invalid_value(Unexpected::Str(&text), &T::EXPECTED))
}
