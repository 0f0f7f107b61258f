//! Findings: for each fault, one line with the cause and one with the remedy.
//!
//! Findings are derived by pure functions from counters and other evidence only, so that `vsm doctor`, the status, the log
//! and the alerts all show the same. A finding is active as long as its evidence is fresh. Parts:
//!
//! - `dli`: unusable data from ground stations; recorded as datagrams arrive
//! - `vehicle`: what arrives on a vehicle's link in place of verified frames
//! - `host`: this computer: clock, store, ports, interfaces, key files; looked at by the shell, the key files beside a
//!   running bridge too
//!
//! `bridge/watch.rs` reports each finding once.

pub(crate) mod dli;
pub mod host;
pub(crate) mod vehicle;

use std::fmt;

use mavlink_link::store::StoreError;
use serde::{Deserialize, Serialize};

use super::dates::day;

/// Which fault it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Code {
    /// A ground station that is not listed sends.
    CucsNotListed,
    /// A listed ground station sends from another address than the configured one.
    CucsAddress,
    /// Datagrams in the name of a ground station with a guard do not verify and are dropped.
    CucsGuard,
    /// A listed ground station sends to ids that are not here.
    CucsMisaddressed,
    /// A listed ground station sends from where it has not proved to be.
    CucsUnproven,
    /// The clock of a ground station differs from that of this computer.
    CucsClock,
    /// Datagrams with a checksum that is computed in another way.
    DliChecksum,
    /// Datagrams of another edition.
    DliEdition,
    /// Datagrams in the other byte order.
    DliByteOrder,
    /// Datagrams that are no DLI.
    DliUnreadable,
    /// Messages of a listed ground station that cannot be decoded, or that only a VSM sends.
    DliUndecodable,
    /// The group's datagrams arrive on another interface than the one that joined it.
    GroupInterface,
    /// Nothing arrives on a vehicle's link.
    MavlinkNone,
    /// Bytes arrive on a vehicle's link, and no frame of MAVLink 2.
    MavlinkUnreadable,
    /// MAVLink 1 arrives.
    MavlinkVersion,
    /// Another system speaks in place of the configured one.
    MavlinkOtherSystem,
    /// The vehicle sends unsigned, though a key is configured.
    MavlinkUnsigned,
    /// The vehicle is received, signed, and something else sends unsigned frames with its system id.
    MavlinkUnsignedBeside,
    /// The vehicle signs with another key.
    MavlinkOtherKey,
    /// The vehicle signs with another link id than the one it is known by.
    MavlinkLinkId,
    /// The vehicle's frames verify, and their timestamps stay behind.
    MavlinkStale,
    /// The vehicle's frames verify, and are stamped too far ahead.
    MavlinkAhead,
    /// Frames of the vehicle come from two addresses on an unsigned link.
    MavlinkTwoSenders,
    /// The vehicle is received, and receives nothing.
    MavlinkUnanswered,
    /// The vehicle was received but no longer reports its state, for a reason that is not known yet or not visible from
    /// here.
    MavlinkSilent,
    /// This computer's clock cannot be right.
    Clock,
    /// Another process uses the store.
    StoreInUse,
    /// The store cannot be used.
    Store,
    /// The bridge that answers is another one than the configuration describes.
    OtherVsm,
    /// A port or address cannot be used.
    Port,
    /// The interface of the group does not exist on this computer.
    Interface,
    /// The file of the access list is not in force, or a CUCS has another guard key than its entries.
    AccessList,
    /// The last reload of the configuration was refused.
    Reload,
    /// The lease of this node of a fleet has ended.
    Lease,
    /// etcd, which the nodes of a fleet share, does not answer.
    Etcd,
    /// The store was zeroized, and serves nothing until a person clears it.
    Zeroized,
    /// A file or folder of the configuration other than a key file cannot be used.
    File,
    /// `vsm run` would not start, for a reason that has no code of its own.
    Start,
    /// A key file cannot be used, or holds another key than the one in force. The last one: a test counts up to it.
    KeyFile,
}

impl fmt::Display for Code {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// One fault that was found.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finding {
    /// Which.
    pub code: Code,
    /// The vehicle, CUCS, address or file that it is about.
    pub about: String,
    /// What happens, with what was expected.
    pub cause: String,
    /// What to do.
    pub cure: String,
    /// Distinguishes findings of one code.
    #[serde(skip)]
    pub(crate) key: u32,
}

impl Finding {
    pub(crate) fn new(
        code: Code,
        about: impl ToString,
        cause: impl Into<String>,
        cure: impl Into<String>,
    ) -> Finding {
        Finding {
            code,
            about: about.to_string(),
            cause: cause.into(),
            cure: cure.into(),
            key: 0,
        }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}; {}", self.cause, self.cure)
    }
}

/// A [`Finding::key`] of a text: two findings of one code and key would take turns as one alert.
fn key_of(begin: u32, text: &str) -> u32 {
    let mixed = |key: u32, byte| key.rotate_left(5) ^ u32::from(byte);
    text.bytes().fold(begin, mixed)
}

/// A configuration that was to be applied, and is not: why.
pub(crate) fn reload(why: &str) -> Finding {
    Finding::new(
        Code::Reload,
        "reload",
        format!("the last reload was refused, and what was in force before is in force: {why}"),
        "mend that, then run vsm reload again",
    )
}

/// The bridge is paused, since its node may no longer serve.
pub(crate) fn lease() -> Finding {
    Finding::new(
        Code::Lease,
        "lease",
        "the lease of this node has ended, and etcd has not renewed it: it answers no station and commands no vehicle",
        "see that this node reaches etcd, and which node serves (vsm fleet list)",
    )
}

/// A record of the store that cannot be made durable: which, and why. `shared`: only once it is in etcd, too.
pub(crate) fn failing(cause: &StoreError, shared: bool) -> Finding {
    let cure = if shared {
        "see that this node reaches etcd, that etcd takes changes (etcdctl alarm list), and that the disk of [store] dir has room; what is not \
         stored is refused, and vehicles fly on"
    } else {
        "free space on its disk, or mend it; what is not stored is refused, and vehicles fly on"
    };
    let cause = format!("the store cannot be written: {cause}");
    Finding::new(Code::Store, "store", cause, cure)
}

/// What of this computer's clock shows that it is wrong. `before` is a date that it cannot be before; `far_ahead`: it is over
/// a year ahead of a signing clock.
pub(crate) fn clock(wall_s: u64, before_s: u64, far_ahead: bool) -> Option<Finding> {
    // Looked at once a second: nothing is allocated where nothing is wrong.
    let (what, cure) = if wall_s < before_s {
        (
            "before this program was built",
            "set the clock (timedatectl set-time, or NTP), then restart vsm: messages to ground stations carry this time",
        )
    } else if far_ahead {
        (
            "over a year ahead of the signing clock in the store",
            "set the clock if it is wrong; if it is right, run \"vsm key clock --accept\"",
        )
    } else {
        return None;
    };
    // A day, and no time: a text that changes would be a new alert each minute.
    let cause = format!("this computer's clock reads {}, {what}", day(wall_s));
    Some(Finding::new(Code::Clock, "clock", cause, cure))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_is_wrong_before_the_build_or_far_ahead_of_the_signing_clock() {
        let unset = clock(100, 1_767_225_600, false).expect("1970");
        assert!(unset.cause.contains("1970-01-01"), "{unset}");
        let ahead = clock(4_000_000_000, 1_767_225_600, true).expect("2096");
        assert!(ahead.cause.contains("over a year ahead"), "{ahead}");
        assert_eq!(clock(1_795_219_200, 1_767_225_600, false), None);
    }

    #[test]
    fn a_record_that_is_not_stored_is_cured_where_the_store_is() {
        let cause = StoreError::new("authority", "connection refused");
        let disk = failing(&cause, false).to_string();
        assert!(disk.contains("free space on its disk"), "{disk}");
        let etcd = failing(&cause, true).to_string();
        assert!(
            etcd.contains("reaches etcd") && !etcd.contains("free space"),
            "{etcd}"
        );
        let full = StoreError::new("authority", "etcdserver: mvcc: database space exceeded");
        let full = failing(&full, true).to_string();
        assert!(full.contains("etcdctl alarm disarm"), "{full}");
    }

    #[test]
    fn a_code_is_shown_as_the_page_lists_it() {
        assert_eq!(Code::KeyFile.to_string(), "key-file");
        assert_eq!(Code::MavlinkTwoSenders.to_string(), "mavlink-two-senders");
    }

    #[test]
    fn the_page_lists_every_code_and_no_other() {
        let page = include_str!("../../../../docs/guide/troubleshooting.md");
        let (_, table) = page.split_once("## What doctor finds").expect("a section");
        let (table, _) = table.split_once("## ").expect("a section behind it");
        let rows = table.lines().filter_map(|line| line.strip_prefix("| `"));
        let mut listed: Vec<usize> = rows
            .map(|row| {
                let name = row.split('`').next().unwrap_or_default();
                let code = serde_json::from_value::<Code>(name.into());
                code.unwrap_or_else(|fault| panic!("{name}: {fault}")) as usize
            })
            .collect();
        listed.sort_unstable();
        let all: Vec<usize> = (0..=Code::KeyFile as usize).collect();
        assert_eq!(listed, all);
    }
}
