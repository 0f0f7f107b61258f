//! `vsm init --protect`: guard, access list, encrypted link and key exchange from the first start on, and the file of the
//! agent.
//!
//! No signing key is written: the pairing creates the first one. The access list gives the one station every group except
//! termination and zeroize, for its guard key, until it is changed.

use std::fs::{self, File};
use std::io::Write as _;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use stanag_msgs::Id;

use crate::config::LinkAddress;
use crate::config::airside::AirsideConfig;
use crate::session::{AccessEntry, AccessGroup, AccessKey, AccessList};
use crate::shell::disk::folder_of;
use crate::shell::key_file;

/// What was asked for, and where the files are to be.
pub(super) struct Protected<'a> {
    pub(super) vsm_id: Id,
    pub(super) vehicle_id: Id,
    pub(super) cucs_id: Id,
    pub(super) system_id: u8,
    /// Where the VSM listens for its ground station.
    pub(super) listen: SocketAddr,
    /// The ground's end of the radio.
    pub(super) link: &'a LinkAddress,
    /// PX4 is simulated, on this computer.
    pub(super) sitl: bool,
    pub(super) config: &'a Path,
    /// Its name is the one that every command takes by itself.
    pub(super) is_default: bool,
    pub(super) agent: &'a Path,
    pub(super) guard: &'a Path,
    pub(super) access_key: &'a Path,
    pub(super) access_list: &'a Path,
}

/// Writes all files; what was made before a failure is in `made`.
pub(super) fn write(
    of: &Protected<'_>,
    config: &str,
    made: &mut Vec<PathBuf>,
) -> anyhow::Result<()> {
    let folder = folder_of(of.config);
    let agent = agent(of);
    AirsideConfig::parse(&agent, folder).context("the agent's configuration")?;
    fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    for key in [of.guard, of.access_key] {
        key_file::generate(key)?;
        made.push(key.to_owned());
    }
    let list = list(of)?;
    // The configuration is written last: if it exists, so does everything that it names.
    for (path, text) in [
        (of.access_list, list.as_str()),
        (of.agent, &agent),
        (of.config, config),
    ] {
        let place = || path.display().to_string();
        let mut file = File::create_new(path).with_context(place)?;
        made.push(path.to_owned());
        file.write_all(text.as_bytes())
            .and_then(|()| file.sync_all())
            .with_context(place)?;
    }
    Ok(())
}

/// Version 1 of the access list, signed.
fn list(of: &Protected<'_>) -> anyhow::Result<String> {
    let guard = key_file::read(of.guard)?.id();
    let mut list = AccessList::new(of.vsm_id);
    for group in GROUPS {
        let entry = AccessEntry {
            cucs: of.cucs_id,
            vehicle: of.vehicle_id,
            group,
            key: guard,
            until: None,
        };
        list.grant(entry).map_err(|fault| anyhow!("{fault}"))?;
    }
    let key = AccessKey::new(&key_file::read(of.access_key)?);
    Ok(list.signed(1, &key))
}

/// The text of the agent's file.
fn agent(of: &Protected<'_>) -> String {
    let quoted = |value: &dyn std::fmt::Display| toml::Value::String(value.to_string()).to_string();
    let px4 = match of.sitl {
        true => "udpin:127.0.0.1:14550",
        false => "serial:/dev/ttyS0:921600",
    };
    [
        ("{vehicle_id}", quoted(&of.vehicle_id)),
        ("{vsm_id}", quoted(&of.vsm_id)),
        ("{radio}", quoted(&other_end(of.link))),
        ("{px4}", quoted(&px4)),
        ("{system_id}", of.system_id.to_string()),
    ]
    .into_iter()
    .fold(AGENT.to_owned(), |text, (name, value)| {
        text.replace(name, &value)
    })
}

/// What the agent has where the ground has this link; a device or the ground's address is a guess, which the report names.
fn other_end(link: &LinkAddress) -> String {
    match link {
        LinkAddress::UdpIn(address) => format!("udpout:192.0.2.1:{}", address.port()),
        LinkAddress::UdpOut(host) => {
            let (host, port) = host.rsplit_once(':').unwrap_or((host, "14560"));
            match host {
                "127.0.0.1" | "localhost" => format!("udpin:127.0.0.1:{port}"),
                _ => format!("udpin:0.0.0.0:{port}"),
            }
        }
        LinkAddress::Serial { baud, .. } => format!("serial:/dev/ttyS1:{baud}"),
    }
}

/// What was written, and the commands that come next.
pub(super) fn report(of: &Protected<'_>) -> String {
    let config = of.config.display();
    let mut text = format!("{config}: the configuration, with guard, access list and encryption\n");
    for (path, what) in [
        (
            of.guard,
            "a new guard key: the ground station's computer needs a copy",
        ),
        (
            of.access_key,
            "a new access key, by which the list is signed: keep it apart",
        ),
        (
            of.access_list,
            "what the ground station may do, signed as version 1",
        ),
        (of.agent, "the configuration of the air-side agent"),
    ] {
        text += &format!("{}: {what}\n", path.display());
    }
    let file = match of.is_default {
        true => String::new(),
        false => format!(" --config {config}"),
    };
    let (agent, guard) = (of.agent.display(), of.guard.display());
    text += "next, on the vehicle's computer, with a copy of the agent's configuration whose two links are right:\n";
    text += &format!("  vsm airside --pair --config {agent}\n");
    text += "here, with the code that it shows:\n";
    text += &format!("  vsm pair{file} --code CODE\n  vsm run{file}\n");
    text += "on the ground station's computer, with a copy of the guard key; the station sends to LISTEN:\n";
    let listen = match of.listen.ip().is_loopback() {
        true => " --listen 127.0.0.1:4587",
        false => "",
    };
    text += &format!(
        "  vsm guard run --cucs {} --vsm-id {} --vsm {} --key-file {guard}{listen}\n",
        of.cucs_id, of.vsm_id, of.listen
    );
    text
}

/// The ground's end of a radio that is only simulated.
pub(super) fn sitl_link() -> LinkAddress {
    let to = SocketAddr::from((Ipv4Addr::LOCALHOST, 14_560));
    format!("udpout:{to}")
        .parse()
        .unwrap_or(LinkAddress::UdpIn(to))
}

const GROUPS: [AccessGroup; 5] = [
    AccessGroup::Payload,
    AccessGroup::Plan,
    AccessGroup::Fly,
    AccessGroup::Settings,
    AccessGroup::Launch,
];
pub(super) const GUARD_KEY: &str = "guard.key";
pub(super) const ACCESS_KEY: &str = "access.key";
pub(super) const ACCESS_LIST: &str = "access.list";
/// What stands in the configuration in place of the usual.
pub(super) const STATION: &str = "guard = { key_file = \"guard.key\" }     # nothing counts in its name without: docs/guide/guard.md";
pub(super) const SIGNING: &str = "signing = { key_file = {key_file}, exchange = \"on\" }     # agreed with the agent: docs/guide/keys.md\n\
     encrypt = true              # nobody on the radio reads it: docs/guide/encryption.md";
pub(super) const ACCESS: &str = "[access]                    # what each CUCS may do: docs/guide/guard.md\n\
     list = \"access.list\"\n\
     key_file = \"access.key\"\n\n\
     [authority]\n\
     guarded_only = true         # no other station without a guard controls anything\n\n";
pub(super) const LISTENED: &str = "Only what the guard of a CUCS has sealed counts";
const AGENT: &str = r#"# The air-side agent, as `vsm init --protect` writes it. Paths are relative to this file.

[agent]
vehicle_id = {vehicle_id}
vsm_id = {vsm_id}
key_file = "airside.key"        # made by the pairing

[radio]                         # to the ground
link = {radio}
encrypt = true

[px4]                           # to PX4: a line of its own
link = {px4}
system_id = {system_id}

[store]
dir = "airside-state"
"#;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_link_has_another_end_that_can_be_used() {
        for (ground, air) in [
            ("udpout:127.0.0.1:14560", "udpin:127.0.0.1:14560"),
            ("udpout:radio.local:7", "udpin:0.0.0.0:7"),
            ("udpin:0.0.0.0:14550", "udpout:192.0.2.1:14550"),
            ("serial:/dev/ttyUSB0:57600", "serial:/dev/ttyS1:57600"),
        ] {
            let other = other_end(&ground.parse().unwrap());
            assert_eq!(other, air);
            other.parse::<LinkAddress>().unwrap();
        }
        assert_eq!(sitl_link().to_string(), "udpout:127.0.0.1:14560");
    }
}
