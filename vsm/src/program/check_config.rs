//! `vsm check-config`.

use std::path::Path;

use crate::config::airside::AirsideConfig;
use crate::config::{Config, ContingencyAction, ExchangeMode, Signing, owner_name};
use crate::shell::key_file::{self, KeyFileError};
use crate::shell::server::StartError;
use crate::shell::web::Tiles;
use mavlink_link::signing::KeyId;
use stanag_msgs::Id;

use super::process::{Failure, bad, print};

/// Who owns an id, where that is known.
fn owner(id: Id) -> String {
    owner_name(id).map_or_else(String::new, |name| format!(", owned by {name}"))
}

pub(crate) fn check(path: &Path) -> Result<(), Failure> {
    // If the file cannot be read, loading it below reports that.
    if std::fs::read_to_string(path).is_ok_and(|text| AirsideConfig::is_meant_by(&text)) {
        return check_airside(path);
    }
    let mut config = Config::load(path).map_err(bad)?;
    config.read_terrain(None).map_err(bad)?;
    if let Some(tiles) = &config.web.tiles {
        Tiles::open(tiles).map_err(StartError::from).map_err(bad)?;
    }
    let mut text = format!("{}: good\n", path.display());
    text += &format!("  VSM {} on {}", config.dli.vsm_id, config.dli.listen);
    if let Some(group) = config.dli.group() {
        text += &format!(", in group {}", group.address);
        if let Some(interface) = &group.interface {
            text += &format!(" on {interface}");
        }
        text += &format!(", TTL {}", group.ttl);
    }
    text += "\n  what sources leave open is read so (dli.disputed):\n";
    for (name, reading, set) in config.dli.disputed.all() {
        let set = if set { ", by this file" } else { "" };
        text += &format!("    {name} = {reading:?}{set}\n");
    }
    text += &format!("  state in {}\n", config.store.dir.display());
    for station in config.stations() {
        let from = station
            .address
            .map_or_else(|| "any address".to_owned(), |address| address.to_string());
        let overrides = if station.override_control {
            ", may override"
        } else {
            ""
        };
        let guard = match &station.guard {
            Some(guard) => {
                let key = key_file::read(&guard.key_file).map_err(bad)?;
                format!(", guarded with key id {}", key.id())
            }
            None => String::new(),
        };
        text += &format!(
            "  CUCS {} from {from}: LOI {}{overrides}{}{guard}\n",
            station.id,
            station.loi.0.in_words(),
            owner(station.id)
        );
    }
    for warning in config.warnings() {
        text += &format!("  WARNING: {warning}\n");
    }
    if config.cucs.is_empty() {
        text += "  no CUCS is listed: nobody may connect\n";
    }
    let mut keys: Vec<(Id, KeyId)> = vec![];
    for vehicle in config.vehicles() {
        let signing = match &vehicle.signing {
            Signing::KeyFile(file, exchange)
                if exchange.mode == ExchangeMode::On && !file.exists() =>
            {
                "signed, no key yet: begin with `vsm pair`".to_owned()
            }
            Signing::KeyFile(file, _) => {
                let (key, place) = read_key(file, path).map_err(bad)?;
                if let Some((one, _)) = keys.iter().find(|(_, known)| *known == key) {
                    let (one, other) = (*one, vehicle.id);
                    let fault = StartError::SameKey { one, other, key };
                    return Err(bad(fault));
                }
                keys.push((vehicle.id, key));
                format!("signed, key id {key}{place}")
            }
            Signing::Off => "NOT SIGNED: anyone in range can command it".to_owned(),
        };
        text += &format!(
            "  vehicle {} (system {}) on {}: {signing}{}\n",
            vehicle.id,
            vehicle.system_id,
            vehicle.link,
            owner(vehicle.id)
        );
        if let Some(terrain) = &vehicle.terrain {
            let (files, dir) = (terrain.ground().grids(), terrain.dir.display());
            text +=
                &format!("    routes are compared with the terrain of {files} files in {dir}\n");
        }
    }
    for forward in config.forwards() {
        let signing = match &forward.key_file {
            Some(file) => {
                let key = key_file::read(file).map_err(bad)?.id();
                if let Some((one, _)) = keys.iter().find(|(_, known)| *known == key) {
                    return Err(bad(StartError::ForwardKey {
                        name: forward.name.clone(),
                        other: format!("vehicle {one}"),
                        key,
                    }));
                }
                format!("signed, key id {key}")
            }
            None => "not signed".to_owned(),
        };
        let may = match (&forward.commands.0, forward.while_controlled) {
            (None, _) => "only receives",
            (Some(_), false) => "may command while no CUCS controls",
            (Some(_), true) => "may command at any time",
        };
        text += &format!(
            "  ground station {} (system {}) on {}: {signing}; {may}\n",
            forward.name, forward.system_id, forward.link
        );
    }
    print(&text)
}

/// The id of a vehicle's key. The packaged unit copies the key that lies beside the configuration to its place at its first
/// start: until then that one is checked, or missing, since a second key made in that place would not be the vehicle's.
fn read_key(file: &Path, config: &Path) -> Result<(KeyId, String), KeyFileError> {
    match key_file::read(file) {
        Ok(key) => Ok((key.id(), String::new())),
        Err(KeyFileError::Absent { .. }) if file.starts_with(SERVICE_STATE) => {
            let beside = config.with_file_name(file.file_name().unwrap_or_default());
            let key = key_file::read(&beside)?;
            let (from, to) = (beside.display(), file.display());
            let place = format!(", in {from}: vsm.service copies it to {to} at its first start");
            Ok((key.id(), place))
        }
        Err(fault) => Err(fault),
    }
}

/// `StateDirectory` of the packaged unit.
const SERVICE_STATE: &str = "/var/lib/vsm";

fn check_airside(path: &Path) -> Result<(), Failure> {
    let config = AirsideConfig::load(path).map_err(bad)?;
    let (agent, radio, px4) = (
        config.agent.get_ref(),
        config.radio.get_ref(),
        config.px4.get_ref(),
    );
    let key = if agent.key_file.exists() {
        let key = key_file::read(&agent.key_file).map_err(bad)?;
        format!("key id {}", key.id())
    } else {
        "no key yet: nothing is relayed before one has been agreed".to_owned()
    };
    let mut text = format!("{}: good, for `vsm airside`\n", path.display());
    text += &format!(
        "  agent of vehicle {}, for VSM {}: {key}\n",
        agent.vehicle_id, agent.vsm_id
    );
    text += &format!(
        "  to the ground over {}; who may speak to PX4:\n",
        radio.link
    );
    for talker in &radio.talkers {
        text += &format!(
            "    system {}, component {}, link id {}\n",
            talker.system_id, talker.component_id, talker.link_id
        );
    }
    let restamp = if px4.restamp {
        "given a new stamp after each start"
    } else {
        "keeps its stamp over starts: recordings can be replayed until its first frame arrives"
    };
    text += &format!(
        "  PX4 (system {}) on {}: {restamp}\n  state in {}\n",
        px4.system_id,
        px4.link,
        config.store.dir.display()
    );
    if let Some(contingency) = &config.contingency {
        let one = contingency.get_ref();
        text += &format!(
            "  flies by itself once nothing is received of the ground for {} s:\n",
            one.link_lost_s
        );
        for (cause, action) in [
            ("for that", one.link),
            ("low battery", one.battery),
            ("no position", one.position),
            ("outside of its areas", one.fence),
            ("a failed motor", one.engine),
        ] {
            let action = action.map_or("nothing", ContingencyAction::name);
            text += &format!("    {cause}: {action}\n");
        }
    }
    if !config.zeroize.px4_key {
        text += "  a zeroize leaves PX4 its key\n";
    }
    print(&text)
}
