//! `[[forward]]`: other ground stations besides the bridge, what they receive and whether they may command.

use std::fmt;
use std::net::SocketAddr;
use std::path::PathBuf;

use serde::de::value::MapAccessDeserializer;
use serde::de::{self, Deserializer, MapAccess, Visitor};
use serde::{Deserialize, Serialize};
use stanag_msgs::Id;

use super::error::{Fault, fault};
use super::key::WhenAbsent::{Nothing, Required, Value};
use super::key::table;
use super::value::{LinkAddress, ids};
use crate::relay_policy::RelayPolicy;

table! {
    /// `[[forward]]`
    #[derive(Debug, Clone, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Forward {
        /// In a `[[forward]]`, which passes the verified frames of vehicles on to another ground station such as QGroundControl: its
        /// name in log, status and store, 1 to 32 letters, digits, `-` and `_`
        pub name: String => Required,
        /// Where the ground station is: `udpout:HOST:PORT`, `udpin:ADDRESS:PORT`, `tcpout:HOST:PORT`, `tcpin:ADDRESS:PORT` or
        /// `serial:DEVICE:BAUD`. Without `key_file` a `udpin` or `tcpin` is on a loopback address only: it would send to whoever asks
        pub link: ForwardLink => Required,
        /// Identification numbers of the vehicles whose frames are passed on, at least one
        #[serde(default, deserialize_with = "some_ids")]
        pub vehicles: Vec<Id> => Nothing("all"),
        /// Key of this ground station and no other: what it is sent is signed with it, and only what is signed with it is taken
        pub key_file: Option<PathBuf> => Nothing("none: nothing is signed, nothing is taken"),
        /// Whether it may command: `false`; `true`, what a ground station flies by ([beside-others.md](../guide/beside-others.md)); or a table of
        /// lists as in `[relay]` of `airside.toml` (`messages`, `commands`, `protected_parameters`), each in place of that. Needs `key_file`
        #[serde(default)]
        pub commands: Commands => Value("false"),
        /// Whether it is a program of this computer that cannot sign, such as one of MAVSDK or pymavlink: what it sends is taken unsigned
        /// from programs of the bridge's own user, root and `users`, and signed for the vehicle under `link_id`. Needs a `udpin` link on a
        /// loopback address, and no `key_file`; it may command what `commands` lists and nothing else (`commands = true` is refused)
        #[serde(default)]
        pub unsigned: bool => Value("false"),
        /// With `unsigned`: further users, by their numbers, whose programs may be this one
        #[serde(default)]
        pub users: Vec<u32> => Nothing("none"),
        /// Whether it may also move the aircraft, or change what it will fly, while a CUCS holds LOI 4 or 5
        #[serde(default)]
        pub while_controlled: bool => Value("false"),
        /// MAVLink system id of the ground station, 1 to 255, and neither `mavlink.system_id` nor a vehicle's
        #[serde(default = "ground_station")]
        pub system_id: u8 => Value("255"),
        /// MAVLink signing link id of the VSM on this link, 0 to 255; with `unsigned`, of what is signed for the vehicle: another than the vehicle's
        /// `link_id`
        #[serde(default)]
        pub link_id: u8 => Value("0"),
    }
}

/// An empty list would read as none, and a list that is left out means all.
fn some_ids<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Id>, D::Error> {
    let ids = ids(deserializer)?;
    if ids.is_empty() {
        let expected = "the ids of [[vehicle]]s of this file; without the key, all";
        return Err(de::Error::invalid_length(0, &expected));
    }
    Ok(ids)
}

fn ground_station() -> u8 {
    255
}

table! {
    /// `forward.commands`, and `[relay]` of `airside.toml`: what is passed on to PX4, each list in place of its default. That of the
    /// agent is what the bridge itself sends, that of a `[[forward]]` is shorter.
    #[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize, Serialize)]
    #[serde(deny_unknown_fields)]
    pub struct Relay {
        /// MAVLink message ids that the ground may send to PX4
        pub messages: Option<Vec<u32>> => Nothing("what the bridge sends"),
        /// Commands of COMMAND_LONG and COMMAND_INT, by their numbers, and of items of a mission that PX4 carries out as commands
        pub commands: Option<Vec<u16>> => Nothing("what the bridge sends"),
        /// Parameters that are not written; `*` stands for any characters
        pub protected_parameters: Option<Vec<String>> => Nothing("PX4's failsafes, checks, fence, outputs, sensors, ports and signing"),
    }
}

impl Relay {
    /// The lists of an agent, with its defaults where there is none.
    #[must_use]
    pub fn policy(&self) -> RelayPolicy {
        self.policy_over(RelayPolicy::default())
    }

    /// The lists alone, and commands in their messages where some are listed: of a program that proves nothing of itself.
    fn listed(&self) -> RelayPolicy {
        let commands = self.commands.as_ref().is_some_and(|one| !one.is_empty());
        let messages = commands.then_some([COMMAND_INT, COMMAND_LONG]);
        let mut policy = self.policy_over(RelayPolicy {
            messages: Vec::new(),
            commands: Vec::new(),
            ..RelayPolicy::default()
        });
        policy.messages.extend(messages.into_iter().flatten());
        policy
    }

    fn policy_over(&self, absent: RelayPolicy) -> RelayPolicy {
        let Relay {
            messages,
            commands,
            protected_parameters,
        } = self.clone();
        RelayPolicy {
            messages: messages.unwrap_or(absent.messages),
            commands: commands.unwrap_or(absent.commands),
            protected_parameters: protected_parameters.unwrap_or(absent.protected_parameters),
        }
    }
}

/// `forward.commands`: `None` where it may not command.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Commands(pub Option<Relay>);

impl<'de> Deserialize<'de> for Commands {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = Commands;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("true, false, or a table such as { commands = [176, 400] }")
            }

            fn visit_bool<E: de::Error>(self, may: bool) -> Result<Commands, E> {
                Ok(Commands(may.then(Relay::default)))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Commands, A::Error> {
                let lists = Relay::deserialize(MapAccessDeserializer::new(map))?;
                Ok(Commands(Some(lists)))
            }
        }
        deserializer.deserialize_any(Either)
    }
}

/// `forward.link`: those of vehicles, and TCP, which is for other ground stations alone.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ForwardLink {
    /// As a vehicle's.
    Shared(LinkAddress),
    /// Wait for connections.
    TcpIn(SocketAddr),
    /// Connect to host and port.
    TcpOut(String),
}

impl ForwardLink {
    /// As [`LinkAddress::host`].
    #[must_use]
    pub fn host(&self) -> Option<&str> {
        match self {
            ForwardLink::Shared(link) => link.host(),
            ForwardLink::TcpOut(host) => Some(host),
            ForwardLink::TcpIn(_) => None,
        }
    }
}

impl fmt::Display for ForwardLink {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ForwardLink::Shared(link) => link.fmt(f),
            ForwardLink::TcpIn(address) => write!(f, "tcpin:{address}"),
            ForwardLink::TcpOut(host) => write!(f, "tcpout:{host}"),
        }
    }
}

impl ForwardLink {
    const EXPECTED: &'static str = "\"udpout:HOST:PORT\", \"udpin:ADDRESS:PORT\", \"tcpout:HOST:PORT\", \"tcpin:ADDRESS:PORT\" or \
                                    \"serial:DEVICE:BAUD\", such as \"udpout:127.0.0.1:14551\"";

    /// The address at which it waits to be called.
    #[must_use]
    pub fn waits_at(&self) -> Option<&SocketAddr> {
        match self {
            ForwardLink::Shared(LinkAddress::UdpIn(address)) | ForwardLink::TcpIn(address) => {
                Some(address)
            }
            ForwardLink::Shared(_) | ForwardLink::TcpOut(_) => None,
        }
    }

    fn parse(text: &str) -> Option<ForwardLink> {
        match text.split_once(':')? {
            ("tcpin", rest) => rest.parse().ok().map(ForwardLink::TcpIn),
            ("tcpout", rest) => {
                let (host, port) = rest.rsplit_once(':')?;
                let good = !host.is_empty() && port.parse::<u16>().is_ok_and(|port| port > 0);
                good.then(|| ForwardLink::TcpOut(rest.to_owned()))
            }
            _ => text.parse().ok().map(ForwardLink::Shared),
        }
    }
}

impl<'de> Deserialize<'de> for ForwardLink {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        ForwardLink::parse(&text)
            .ok_or_else(|| de::Error::invalid_value(de::Unexpected::Str(&text), &Self::EXPECTED))
    }
}

impl Forward {
    /// What it may command; `None` where nothing.
    #[must_use]
    pub fn policy(&self) -> Option<RelayPolicy> {
        let lists = self.commands.0.as_ref()?;
        Some(match self.unsigned {
            true => lists.listed(),
            false => lists.policy_over(RelayPolicy::of_ground_station()),
        })
    }

    /// What of a program that cannot sign does not fit.
    fn check_unsigned(&self, at: usize) -> Result<(), Fault> {
        if self.key_file.is_some() {
            let expected = "unsigned = false, or no key_file: with a key it signs";
            return fault(at, "forward.unsigned", "true with a key_file", expected);
        }
        match &self.link {
            ForwardLink::Shared(LinkAddress::UdpIn(address)) if address.ip().is_loopback() => {}
            link => {
                let expected = "udpin on a loopback address with unsigned = true, such as \"udpin:127.0.0.1:14552\": whose program sends there is \
                                looked up";
                return fault(at, "forward.link", link, expected);
            }
        }
        match &self.commands.0 {
            // `true` permits all that a ground station flies by. A program that cannot sign must be limited to a list.
            Some(lists) if *lists == Relay::default() => {
                let expected = "lists with unsigned = true, such as { commands = [176, 400] }";
                fault(at, "forward.commands", "true", expected)
            }
            Some(lists) => {
                let mut listed = lists.messages.iter().flatten();
                match listed.find(|id| NEVER_UNSIGNED.contains(id)) {
                    Some(id) => {
                        let expected = "no SERIAL_CONTROL (126), KEY_EXCHANGE (229), SETUP_SIGNING (256) with unsigned = true";
                        fault(at, "forward.commands", id, expected)
                    }
                    None => Ok(()),
                }
            }
            None => Ok(()),
        }
    }

    /// Its ranges. `at` is where its table begins.
    pub(super) fn check(&self, at: usize) -> Result<(), Fault> {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if !(1..=32).contains(&self.name.len()) || !self.name.chars().all(is_plain) {
            let expected = "1 to 32 letters, digits, - and _";
            return fault(at, "forward.name", &self.name, expected);
        }
        if self.unsigned {
            return self.check_unsigned(at);
        }
        if !self.users.is_empty() {
            let expected = "unsigned = true beside it: otherwise nobody is looked up";
            return fault(at, "forward.users", "given", expected);
        }
        if self.key_file.is_some() {
            return Ok(());
        }
        if self.commands.0.is_some() {
            let expected = "a key_file of its own beside it: commands are taken signed only, `vsm keygen FILE` makes one; or unsigned = true for a \
                            program of this computer";
            return fault(at, "forward.commands", "given", expected);
        }
        match self.link.waits_at() {
            Some(address) if !address.ip().is_loopback() => {
                let expected = "a key_file beside it, a loopback address, or udpout or tcpout: without a key it would send to \
                                whoever asks";
                fault(at, "forward.link", &self.link, expected)
            }
            _ => Ok(()),
        }
    }
}

const COMMAND_INT: u32 = 75;
const COMMAND_LONG: u32 = 76;
/// A shell on PX4, and what changes keys.
const NEVER_UNSIGNED: [u32; 3] = [126, 229, 256];
