//! The configuration file of the air-side agent, `airside.toml`: a separate file, since it is on another computer.

use std::path::{Path, PathBuf};

use mavlink_link::receiver::{AllowedStreams, Stream};
use serde::Deserialize;
use stanag_msgs::Id;
use toml::Spanned;

use super::agent_contingency::AgentContingency;
use super::error::{ConfigError, Fault, fault};
use super::explain;
use super::forward::Relay;
use super::key::WhenAbsent::{Required, Table, Value};
use super::key::table;
use super::value::{LinkAddress, id};

table! {
    /// The whole of an `airside.toml`.
    #[derive(Debug, Clone, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct AirsideConfig {
        /// Who it is, and its key.
        pub agent: Spanned<Agent> => Table(Agent::KEYS),
        /// The link to the ground.
        pub radio: Spanned<Radio> => Table(Radio::KEYS),
        /// The link to PX4.
        pub px4: Spanned<Px4> => Table(Px4::KEYS),
        /// What the ground may ask of PX4.
        #[serde(default)]
        pub relay: Relay => Table(Relay::KEYS),
        /// What a zeroize does.
        #[serde(default)]
        pub zeroize: AgentZeroize => Table(AgentZeroize::KEYS),
        /// What it flies while nothing is received of the ground.
        pub contingency: Option<Spanned<AgentContingency>> => Table(AgentContingency::KEYS),
        /// Where state lives that must survive a restart.
        pub store: AgentStore => Table(AgentStore::KEYS),
    }
}

table! {
    /// `[store]` of an agent
    #[derive(Debug, Clone, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct AgentStore {
        /// Folder of signing clocks and keys; made with mode 0700, refused when open to others
        pub dir: PathBuf => Required,
    }
}

table! {
    /// `[agent]`
    #[derive(Debug, Clone, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Agent {
        /// The vehicle's identification number, as the VSM has it
        #[serde(deserialize_with = "id")]
        pub vehicle_id: Id => Required,
        /// The VSM's identification number
        #[serde(deserialize_with = "id")]
        pub vsm_id: Id => Required,
        /// The signing key that PX4 shares; it need not exist before the first agreement
        pub key_file: PathBuf => Required,
        /// The agent's own MAVLink system id towards PX4, 1 to 255, and not the vehicle's
        #[serde(default = "own_system")]
        pub system_id: u8 => Value("246"),
        /// Its component id on both sides, 2 to 255. Towards the ground it is a component of the vehicle
        #[serde(default = "own_component")]
        pub component_id: u8 => Value("191"),
        /// Its link id on both sides, 0 to 255
        #[serde(default)]
        pub link_id: u8 => Value("0"),
    }
}

table! {
    /// `[radio]`
    #[derive(Debug, Clone, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Radio {
        /// Where the ground is: `udpin:ADDRESS:PORT`, `udpout:HOST:PORT` or `serial:DEVICE:BAUD`
        pub link: LinkAddress => Required,
        /// Who may speak to PX4, the VSM first; 1 to 8, with system ids that are neither the vehicle's nor the agent's
        #[serde(default = "vsm_alone")]
        pub talkers: Vec<Talker> => Value("[{ system_id = 245, component_id = 190 }]"),
        /// Whether all of the link is encrypted, as `encrypt` of the VSM's `[[vehicle]]`: nothing is taken or sent in the clear
        /// then but KEY_EXCHANGE
        #[serde(default)]
        pub encrypt: bool => Value("false"),
    }
}

/// One of `radio.talkers`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Talker {
    /// MAVLink system id.
    pub system_id: u8,
    /// MAVLink component id.
    pub component_id: u8,
    /// Link id of its signatures.
    #[serde(default)]
    pub link_id: u8,
}

impl From<Talker> for Stream {
    fn from(talker: Talker) -> Stream {
        Stream {
            system: talker.system_id,
            component: talker.component_id,
            link: talker.link_id,
        }
    }
}

table! {
    /// `[px4]`
    #[derive(Debug, Clone, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Px4 {
        /// Where PX4 is. Nobody else may listen on this link: keys go over it
        pub link: LinkAddress => Required,
        /// PX4's MAVLink system id, 1 to 255
        pub system_id: u8 => Required,
        /// Whether PX4 is given the same key with a new stamp after each start, disarmed: recordings from before die
        #[serde(default = "yes")]
        pub restamp: bool => Value("true"),
        /// On UDP: which users' programs may be PX4 beside the agent's own user and root, by their numbers. PX4 takes its first
        /// key unsigned, so that on loopback any program of this computer could pose as it
        #[serde(default)]
        pub users: Vec<u32> => Value("[]"),
        /// Vouches for a link that is neither serial nor loopback, and for every program on it
        #[serde(default)]
        pub i_trust_this_link: bool => Value("false"),
    }
}

table! {
    /// `[zeroize]` of an agent
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub struct AgentZeroize {
        /// Give PX4 a random key that nobody keeps, while it is disarmed: it obeys nobody over MAVLink until
        /// `mavlink/mavlink-signing-key.bin` is removed from its card ([zeroize.md](../guide/zeroize.md)). With `false` it keeps the
        /// key that whoever has a copy can command it with
        pub px4_key: bool => Value("true"),
    }
}

impl Default for AgentZeroize {
    fn default() -> AgentZeroize {
        AgentZeroize { px4_key: true }
    }
}

impl AirsideConfig {
    /// Reads and checks a file.
    ///
    /// # Errors
    /// The file cannot be read, is not TOML, has an unknown or missing key, or a value out of its range.
    pub fn load(path: &Path) -> Result<AirsideConfig, ConfigError> {
        let text = ConfigError::read(path, "examples/airside.toml is one to begin with")?;
        let folder = path.parent().unwrap_or(Path::new(""));
        AirsideConfig::parse(&text, folder).map_err(|cause| {
            match explain::other_kind(&text, true) {
                Some((kind, command)) => ConfigError::OtherKind {
                    path: path.to_owned(),
                    kind,
                    expected: "the configuration of an agent",
                    command,
                },
                None => cause.in_file(path),
            }
        })
    }

    /// Parses and checks the text of a file whose relative paths start at `folder`.
    ///
    /// # Errors
    /// As [`AirsideConfig::load`].
    pub fn parse(text: &str, folder: &Path) -> Result<AirsideConfig, ConfigError> {
        let mut config: AirsideConfig =
            toml::from_str(text).map_err(|cause| explain::explain::<Self>(&cause, text, &[]))?;
        config.check().map_err(|fault| fault.located(text, &[]))?;
        config.store.dir = folder.join(&config.store.dir);
        let agent = config.agent.get_mut();
        agent.key_file = folder.join(&agent.key_file);
        Ok(config)
    }

    /// Whether a text is meant as such a file: it has an `[agent]`, which the bridge's has not.
    #[must_use]
    pub fn is_meant_by(text: &str) -> bool {
        toml::from_str::<toml::Table>(text).is_ok_and(|table| table.contains_key("agent"))
    }

    /// Whether a file is meant as one, as far as it can be read.
    #[must_use]
    pub fn is_at(path: &Path) -> bool {
        ConfigError::read(path, "").is_ok_and(|text| AirsideConfig::is_meant_by(&text))
    }

    /// What a single value cannot show: relations between keys.
    fn check(&self) -> Result<(), Fault> {
        let (agent, radio, px4) = (
            self.agent.get_ref(),
            self.radio.get_ref(),
            self.px4.get_ref(),
        );
        let (agent_at, radio_at, px4_at) = (
            self.agent.span().start,
            self.radio.span().start,
            self.px4.span().start,
        );
        if px4.system_id == 0 {
            return fault(px4_at, "px4.system_id", "0".to_owned(), "1 to 255");
        }
        if agent.system_id == 0 || agent.system_id == px4.system_id {
            let found = agent.system_id.to_string();
            let expected = "1 to 255, and not the vehicle's (px4.system_id)";
            return fault(agent_at, "agent.system_id", found, expected);
        }
        if agent.component_id < 2 {
            let found = agent.component_id.to_string();
            let expected = "2 to 255: 1 is the autopilot's";
            return fault(agent_at, "agent.component_id", found, expected);
        }
        if agent.vehicle_id == agent.vsm_id {
            let found = agent.vsm_id.to_string();
            return fault(
                agent_at,
                "agent.vsm_id",
                found,
                "another id than the vehicle's",
            );
        }
        if radio.link == px4.link {
            let found = px4.link.to_string();
            return fault(px4_at, "px4.link", found, "another link than radio.link");
        }
        if px4.link.leads_away() && !px4.i_trust_this_link {
            let found = px4.link.to_string();
            let expected = "a serial line or a loopback address: PX4's keys go over it; or vouch for it with \
                            px4.i_trust_this_link = true";
            return fault(px4_at, "px4.link", found, expected);
        }
        if radio.talkers.is_empty() || radio.talkers.len() > AllowedStreams::MAX {
            let found = format!("a list of {}", radio.talkers.len());
            return fault(radio_at, "radio.talkers", found, "1 to 8 talkers");
        }
        for talker in &radio.talkers {
            let taken = [0, px4.system_id, agent.system_id];
            if taken.contains(&talker.system_id) || talker.component_id == 0 {
                let found = format!("{}/{}", talker.system_id, talker.component_id);
                let expected = "system ids that are neither 0, the vehicle's nor the agent's, and components from 1";
                return fault(radio_at, "radio.talkers", found, expected);
            }
        }
        if let Some(contingency) = &self.contingency {
            contingency.get_ref().check(contingency.span().start)?;
        }
        Ok(())
    }
}

fn own_system() -> u8 {
    246
}

fn own_component() -> u8 {
    191
}

fn yes() -> bool {
    true
}

/// The VSM with the ids that it has by default.
fn vsm_alone() -> Vec<Talker> {
    vec![Talker {
        system_id: 245,
        component_id: 190,
        link_id: 0,
    }]
}
