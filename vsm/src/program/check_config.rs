//! `vsm check-config`.

use std::path::Path;

use anyhow::anyhow;
use mavlink_link::signing::KeyId;
use stanag_msgs::Id;
use toml::Spanned;

use crate::config::airside::AirsideConfig;
use crate::config::{
    Config, ContingencyAction, ExchangeMode, Signing, Vehicle, line_in, owner_name,
};
use crate::shell::clock::Clock;
use crate::shell::server::StartError;
use crate::shell::server::checks::{self, NamedFile};
use crate::shell::{disk, key_file, key_store};

use super::process::{Failure, bad, load, load_airside, print};

/// Who owns an id, where that is known.
fn owner(id: Id) -> String {
    owner_name(id).map_or_else(String::new, |name| format!(", owned by {name}"))
}

pub(crate) fn check(path: &Path) -> Result<(), Failure> {
    // If the file cannot be read, loading it below reports that.
    if AirsideConfig::is_at(path) {
        return check_airside(path);
    }
    let mut config = load(path)?;
    if let Err(fault) = config.read_terrain(None) {
        let of = |one: &Spanned<Vehicle>| {
            let terrain = one.get_ref().terrain.as_ref();
            terrain.is_some_and(|terrain| fault.path().starts_with(&terrain.dir))
        };
        let at = config.vehicle.iter().find(|one| of(one));
        let at = at.map_or(0, |one| one.span().start);
        return Err(bad(in_file(path, (at, "vehicle.terrain"), &fault)));
    }
    let files = checks::named_files(&config, Some(path));
    let held = keys(path, &files)?;
    check_store(path, &config.store.dir)?;
    let key_of = |whose: String| held.iter().find(|(file, _)| file.whose == whose);
    let list = checks::look_at_access(&config)
        .map_err(|fault| bad(in_file(path, (0, "access.list"), &fault)))?;
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
        let guard = match key_of(format!("CUCS {}", station.id)) {
            Some((_, Some(key))) => format!(", guarded with key id {key}"),
            _ => String::new(),
        };
        text += &format!(
            "  CUCS {} from {from}: LOI {}{overrides}{}{guard}\n",
            station.id,
            station.loi.0.in_words(),
            owner(station.id)
        );
    }
    for warning in config.warnings().iter().chain(&list) {
        text += &format!("  WARNING: {warning}\n");
    }
    if config.cucs.is_empty() {
        text += "  no CUCS is listed: nobody may connect\n";
    }
    for vehicle in config.vehicles() {
        let key = key_of(format!("vehicle {}", vehicle.id));
        let signing = match (&vehicle.signing, key) {
            (Signing::KeyFile(..), Some((file, Some(key)))) => {
                let place = file.copied_to.as_ref().map_or_else(String::new, |to| {
                    let (from, to) = (file.path.display(), to.display());
                    format!(", in {from}: vsm.service copies it to {to} at its first start")
                });
                format!("signed, key id {key}{place}")
            }
            (Signing::KeyFile(_, exchange), _) if exchange.mode == ExchangeMode::On => {
                "signed, no key yet: begin with `vsm pair`".to_owned()
            }
            (Signing::KeyFile(..), _) => {
                "signed, no key yet: the start makes one that nobody has, until one is agreed on"
                    .to_owned()
            }
            (Signing::Off, _) => "NOT SIGNED: anyone in range can command it".to_owned(),
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
        let signing = match key_of(format!("[[forward]] {}", forward.name)) {
            Some((_, Some(key))) => format!("signed, key id {key}"),
            _ => "not signed".to_owned(),
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

/// The key in force of each file, where it has one.
fn keys<'a>(
    path: &Path,
    files: &'a [NamedFile],
) -> Result<Vec<(&'a NamedFile, Option<KeyId>)>, Failure> {
    let looked = checks::look(files, Clock::default().now());
    let each = files.iter().zip(looked).map(|(file, held)| match held {
        Ok(held) => Ok((file, held.first().copied())),
        // The first agreement makes it.
        Err(StartError::NotPaired { .. }) => Ok((file, None)),
        Err(fault) => Err(bad(in_file(path, (file.at, file.key), &fault))),
    });
    each.collect()
}

/// What is wrong with what a key of the file names, with the key and its line. `at`: the byte at which its table begins.
fn in_file(path: &Path, (at, key): (usize, &str), fault: &impl std::fmt::Display) -> anyhow::Error {
    let line = line_in(path, at, key).map_or_else(String::new, |line| format!("line {line}: "));
    let text = fault.to_string();
    // Some name their key themselves.
    let text = text.strip_prefix(&format!("{key}: ")).unwrap_or(&text);
    anyhow!("{}: {line}{key}: {text}", path.display())
}

/// Whether every record of the store can be replaced.
fn check_store(path: &Path, store: &Path) -> Result<(), Failure> {
    disk::check_names(store).map_err(|fault| bad(in_file(path, (0, "store.dir"), &fault)))
}

/// Why a start has failed, with the key and line of the file that it could not use, where it is one.
pub(super) fn located(path: &Path, config: &Config, fault: StartError) -> anyhow::Error {
    let files = checks::named_files(config, None);
    let text = fault.to_string();
    let looked = checks::look(&files, Clock::default().now());
    let is_it = |held: &Result<_, StartError>| {
        let cause = held.as_ref().err().map(ToString::to_string);
        cause.as_ref() == Some(&text)
    };
    match files.iter().zip(looked).find(|(_, held)| is_it(held)) {
        Some((file, _)) => in_file(path, (file.at, file.key), &fault),
        None => fault.into(),
    }
}

fn check_airside(path: &Path) -> Result<(), Failure> {
    let config = load_airside(path)?;
    let (agent, radio, px4) = (
        config.agent.get_ref(),
        config.radio.get_ref(),
        config.px4.get_ref(),
    );
    check_store(path, &config.store.dir)?;
    key_store::check_names(&agent.key_file)
        .map_err(|fault| bad(in_file(path, (0, "agent.key_file"), &fault)))?;
    let key = if agent.key_file.exists() {
        let key = key_file::read(&agent.key_file)
            .map_err(|fault| bad(in_file(path, (0, "agent.key_file"), &fault)))?;
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
