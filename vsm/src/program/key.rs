//! `vsm key` and `vsm keygen`: generate, provision, rotate, revoke and list signing keys, and show their clocks.

use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use crate::config::{Config, Exchange, Signing, Stored, Vehicle};
use crate::key_exchange::ExchangeRecord;
use crate::shell::disk::{FileDisk, folder_of, peek, peek_identity};
use crate::shell::key_file;
use crate::shell::key_link::{Ending, KeyLink, KeyLinkError, Progress, Trust, UNKNOWN_FOR, What};
use crate::shell::key_store::{KeyStore, real_path};
use anyhow::{Context as _, anyhow, bail};
use clap::{Args, Subcommand};
use mavlink_link::clock::Ceiling;
use mavlink_link::provisioning::{Event, Outcome, State};
use mavlink_link::signing::{SigningKey, Stamp};
use mavlink_link::store::Store as _;

use super::config_arg::ConfigArg;
use super::process::{
    Failure, act_for, bad, failed, load, load_stored, print, print_line, report_line, runtime,
};

#[derive(Debug, Subcommand)]
pub(crate) enum Action {
    /// Provision a vehicle that has no key with its first one
    Provision {
        #[command(flatten)]
        vehicle: Which,
        /// Take the key from this file (64 hex digits) instead of a new random one
        #[arg(long, value_name = "FILE")]
        from: Option<PathBuf>,
        /// Write PX4's own key file (mavlink/mavlink-signing-key.bin) while PX4 is off, instead of sending the key
        #[arg(long, value_name = "FILE")]
        sitl_file: Option<PathBuf>,
        #[command(flatten)]
        over: Over,
    },
    /// Replace the key of a vehicle by a new one
    Rotate {
        #[command(flatten)]
        vehicle: Which,
        #[command(flatten)]
        over: Over,
    },
    /// Replace the key of a vehicle by a random one that nobody else holds, and delete the old one
    Revoke {
        #[command(flatten)]
        vehicle: Which,
        #[command(flatten)]
        over: Over,
    },
    /// Show the signing clocks beside the wall clock
    Clock {
        #[command(flatten)]
        vehicle: Which,
        /// Accept this computer's wall clock where it is over a year ahead of the signing clock
        #[arg(long)]
        accept: bool,
    },
    /// List the keys on disk by their ids, and the paired air-side agents
    List {
        #[command(flatten)]
        config: ConfigArg,
    },
}

#[derive(Debug, Args)]
pub(crate) struct Which {
    #[command(flatten)]
    config: ConfigArg,
    /// Select the vehicle by its id, such as 1b:00:01:01, where the configuration has several
    #[arg(long, value_name = "ID")]
    vehicle: Option<String>,
}

#[derive(Debug, Args)]
pub(crate) struct Over {
    /// Send the key in clear over a link that is neither a serial line nor loopback
    #[arg(long)]
    i_trust_this_link: bool,
    /// Trust unsigned frames in the vehicle's name on this link: it has lost its key, and is given it again
    #[arg(long)]
    vehicle_is_unsigned: bool,
    /// Wait at most this long for frames of the vehicle that show it disarmed, s
    #[arg(long, default_value_t = 120)]
    wait_s: u64,
}

impl Over {
    fn trust(&self) -> Trust {
        Trust {
            open_link: self.i_trust_this_link,
            lost_key: self.vehicle_is_unsigned,
        }
    }
}

pub(crate) fn run(action: Action) -> Result<(), Failure> {
    match action {
        Action::Provision {
            vehicle,
            from,
            sitl_file,
            over,
        } => provision(&vehicle, from.as_deref(), sitl_file.as_deref(), &over),
        Action::Rotate { vehicle, over } => replace(&vehicle, &over, false),
        Action::Revoke { vehicle, over } => replace(&vehicle, &over, true),
        Action::Clock { vehicle, accept } => clock(&vehicle, accept),
        Action::List { config } => list(config.path()),
    }
}

/// `vsm keygen`: a key for a vehicle that is given it by other means.
pub(crate) fn generate(path: &Path) -> Result<(), Failure> {
    act_for(folder_of(path), &[])?;
    key_file::generate(path).map_err(failed)?;
    let key = key_file::read(path).map_err(failed)?;
    let text = format!("{}: a new key, id {}\n", path.display(), key.id());
    print(&text)
}

fn provision(
    which: &Which,
    from: Option<&Path>,
    sitl_file: Option<&Path>,
    over: &Over,
) -> Result<(), Failure> {
    let (config, vehicle, path, _) = open(which)?;
    let key = || match from {
        None => random(),
        Some(file) => key_file::read(file).map_err(bad),
    };
    if let Some(file) = sitl_file {
        return write_sitl_file(&config, &path, key()?, file).map_err(failed);
    }
    let link = (&config, &vehicle, path.as_path());
    if path.exists() {
        return give_existing(link, from, over);
    }
    let wish = match from {
        None => Wish::AnyNew,
        Some(_) => Wish::This,
    };
    rotate_to(link, &key, over, wish)
}

/// The key is there already, as after `vsm init`. Where nothing was ever signed with it here, the vehicle is given that one.
fn give_existing(link: Link<'_>, from: Option<&Path>, over: &Over) -> Result<(), Failure> {
    let (config, _, path) = link;
    let shown = path.display();
    if let Some(from) = from {
        return Err(bad(anyhow!(
            "{shown} exists, and --from names {}: leave --from out to give the vehicle the key that is there, or move that file away",
            from.display()
        )));
    }
    let key = key_file::read(path).map_err(bad)?;
    let used = peek::<Ceiling>(&config.store.dir, &key.id()).map_err(failed)?;
    if used.is_some() {
        return Err(bad(anyhow!(
            "{shown} exists, and this VSM has signed with it: `vsm key rotate` replaces it where the vehicle has it. A vehicle that \
             has none, or has lost it, is given a new one by `vsm key rotate --vehicle-is-unsigned`, or this one by `vsm key provision \
             --sitl-file FILE` while it is off"
        )));
    }
    match round(link, What::InForceAgain, over, Wish::AnyNew)?.0 {
        // A key that was never sent is not looked for in the vehicle's frames.
        Ending::ForeignKey => Err(failed(anyhow!(
            "nothing was sent: the vehicle signs already, with the key in {shown}, where its SD card has that, or with another; \"vsm \
             run\" and \"vsm status\" show which"
        ))),
        ending => conclude(ending, path).map_err(failed),
    }
}

fn replace(which: &Which, over: &Over, revoke: bool) -> Result<(), Failure> {
    let (config, vehicle, path, _) = open(which)?;
    if !path.exists() {
        let path = path.display();
        return Err(bad(anyhow!(
            "{path} does not exist: there is no key to replace; begin with `vsm key provision`"
        )));
    }
    let wish = if revoke { Wish::Revoke } else { Wish::AnyNew };
    let link = (&config, &vehicle, path.as_path());
    rotate_to(link, &random, over, wish)
}

fn random() -> Result<SigningKey, Failure> {
    key_file::random().map_err(failed)
}

/// Which key the vehicle must have in the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Wish {
    /// Any key other than the present one, also that of an earlier, unfinished rotation.
    AnyNew,
    /// The given one.
    This,
    /// One that nobody else holds, and the old one is deleted.
    Revoke,
}

/// The configuration, the vehicle and its key file.
type Link<'a> = (&'a Config, &'a Vehicle, &'a Path);

/// Finishes first a rotation that an earlier command left unfinished, and gives a vehicle that fell back the key in force
/// again. If the vehicle's key is then not the wished one, another rotation follows.
fn rotate_to(
    link: Link<'_>,
    key: &dyn Fn() -> Result<SigningKey, Failure>,
    over: &Over,
    wish: Wish,
) -> Result<(), Failure> {
    let path = link.2;
    let (mut ending, mut another) = round(link, What::New(key()?), over, wish)?;
    // In two rounds: a rollover knows one old key, and PX4 accepts SETUP_SIGNING only under the key that it has.
    if ending == Ending::ForeignKey && holds_previous(path)? {
        print_line(
            "the vehicle does not sign with the key in force; perhaps with the one before, as after a power cut",
        );
        (ending, _) = round(link, What::InForceAgain, over, wish)?;
        if ending == Ending::Ended(Outcome::Committed) {
            print_line("the vehicle has the key in force again; now the new one");
            (ending, another) = round(link, What::New(key()?), over, wish)?;
        }
    }
    let decided = matches!(
        ending,
        Ending::Ended(Outcome::Committed | Outcome::RolledBack)
    );
    // If any new key is enough, the key of the finished rollover is one.
    if another && decided && wish != Wish::AnyNew {
        print_line("the rollover that an earlier command began is finished; now the new key");
        (ending, _) = round(link, What::New(key()?), over, wish)?;
    }
    if wish == Wish::Revoke && ending == Ending::Ended(Outcome::Committed) {
        print_line("the old key is deleted");
    }
    conclude(ending, path).map_err(failed)
}

fn holds_previous(path: &Path) -> Result<bool, Failure> {
    let keys = KeyStore::open(path).map_err(failed)?;
    let previous = keys.previous().map_err(failed)?;
    Ok(previous.is_some())
}

/// One rotation, from opening the link to its end; returns whether it was for another key, left by an earlier command.
fn round(
    (config, vehicle, path): Link<'_>,
    what: What,
    over: &Over,
    wish: Wish,
) -> Result<(Ending, bool), Failure> {
    let wished = match &what {
        What::New(key) => Some(key.id()),
        What::InForceAgain | What::Discarded(_) => None,
    };
    let (leftover, mut sent) = (beside(path, ".next").exists(), false);
    let runtime = runtime()?;
    let (ending, another) = runtime.block_on(async {
        let link =
            KeyLink::open(config, vehicle, path, what, over.trust()).map_err(
                |fault| match fault {
                    KeyLinkError::OpenLink { .. } | KeyLinkError::Keys(_) => bad(fault),
                    other => failed(other),
                },
            )?;
        print_line(&format!(
            "vehicle {} (system {}) on {}: key id {}",
            vehicle.id,
            vehicle.system_id,
            vehicle.link,
            link.new_id()
        ));
        let another = wished.is_some_and(|wished| wished != link.new_id());
        if wish == Wish::Revoke && wished.is_some() {
            // The program that finds out that the vehicle has the new key deletes the old one: this command, or a later
            // `vsm run`.
            link.revoke_current().map_err(failed)?;
        }
        let mut watch = |progress| {
            sent |= progress == Progress::Event(Event::State(State::Sent));
            if let Some(line) = shown(progress, over.wait_s) {
                report_line(&format!("vsm: {line}"));
            }
        };
        let ending = link
            .run(Duration::from_secs(over.wait_s), &mut watch)
            .await
            .map_err(failed)?;
        Ok((ending, another))
    })?;
    let committed = ending == Ending::Ended(Outcome::Committed);
    // A `.next` file of an earlier command may already have been sent, so it stays.
    if wished.is_some() && !sent && !leftover && !committed {
        // It was never sent to the vehicle: it must not be mistaken for a key that the vehicle may have.
        let keys = KeyStore::open(path).map_err(failed)?;
        keys.drop_next().map_err(failed)?;
    }
    Ok((ending, another))
}

/// What an operator is shown on the way: what is waited for, and until when.
fn shown(progress: Progress, wait_s: u64) -> Option<String> {
    let event = match progress {
        Progress::OtherKey => {
            return Some(
                "the vehicle signs with another key than the one in force here; still waiting for frames under that"
                    .to_owned(),
            );
        }
        Progress::Unsigned => {
            return Some(
                "frames arrive that are not signed, and are not believed: if the vehicle has lost its key, end this (Ctrl-C) and add \
                 --vehicle-is-unsigned; still waiting for signed ones"
                    .to_owned(),
            );
        }
        Progress::Event(event) => event,
    };
    let line = match event {
        Event::State(State::Staged) => format!(
            "the new key is on disk; waiting for frames of the vehicle, {wait_s} s at most (--wait-s), then 10 s more, in which \
             only this vehicle may be on the link"
        ),
        Event::State(State::WaitDisarm) => format!(
            "waiting for the vehicle's report that it is disarmed, until {wait_s} s after the start (--wait-s)"
        ),
        Event::State(State::Sent) => {
            "the key is being sent. DO NOT cut the vehicle's power for 5 s: it would start without a key".to_owned()
        }
        Event::State(State::Committed) => {
            "the vehicle signs with the new key; 5 s more, keep its power on".to_owned()
        }
        Event::State(State::NotTaken) => "the vehicle has not taken the key".to_owned(),
        Event::State(State::RolledBack) => {
            "the vehicle keeps its key; the new one is deleted if that holds for 30 s".to_owned()
        }
        Event::State(State::Unknown) => format!(
            "it is not known which key the vehicle has; asking under both, {} s at most",
            UNKNOWN_FOR.as_secs()
        ),
        Event::SeveralAutopilots { system } => format!(
            "system {system} is on the link too, and PX4 takes a key whomever it is meant for"
        ),
        Event::RefusedWhileArmed => "the vehicle refuses while it is armed".to_owned(),
        Event::FellBack => "the vehicle lost its key again; retrying".to_owned(),
        Event::Commit | Event::Ended(_) => return None,
    };
    Some(line)
}

fn conclude(ending: Ending, path: &Path) -> anyhow::Result<()> {
    match ending {
        Ending::Ended(Outcome::Committed) => {
            print_line(&format!("done: {} is the key in force", path.display()));
            Ok(())
        }
        Ending::Ended(Outcome::RolledBack) => {
            bail!("the vehicle keeps its old key, and so do we: nothing has changed")
        }
        Ending::Ended(Outcome::NeverSigns) => bail!(
            "the vehicle stays unsigned: PX4 1.17 and older cannot sign. The new key stays in {}.next",
            path.display()
        ),
        Ending::Ended(Outcome::SeveralAutopilots) => {
            bail!("nothing was sent: leave only one vehicle on the link")
        }
        Ending::NotReceived => bail!("nothing was sent: no data from the vehicle"),
        Ending::ForeignKey => bail!(
            "nothing was sent: the vehicle signs with a key that is neither in {} nor the one before",
            path.display()
        ),
        Ending::Unsigned => bail!(
            "nothing was sent: who speaks in the vehicle's name does not sign, though it has a key. If the vehicle has lost \
             it, add --vehicle-is-unsigned"
        ),
        Ending::Stranger(stranger) => bail!(
            "nothing was sent: {stranger}. Run this command as the user that the vehicle's program has, or vouch for \
             every program on the link with --i-trust-this-link"
        ),
        Ending::StayedArmed => {
            bail!("nothing was sent: the vehicle did not report that it is disarmed")
        }
        Ending::Unknown => bail!(
            "the vehicle fell silent after the key was sent: both keys are kept. `vsm run` finds out which it has, and so \
             does this command, started again"
        ),
        Ending::Dragged => bail!(
            "the vehicle signs with stamps far ahead and takes nothing of ours: somebody who has its key has dragged its \
             clock, perhaps on our own stream. Both keys are kept. Restart the vehicle, disarmed, and start this command again at \
             once"
        ),
    }
}

fn write_sitl_file(
    config: &Config,
    path: &Path,
    key: SigningKey,
    file: &Path,
) -> anyhow::Result<()> {
    // The lock excludes a running bridge, which reads its keys only when it starts.
    let _store = FileDisk::open(&config.store.dir)?;
    let keys = KeyStore::open(path)?;
    // First, so that no key is made for a file that cannot be written.
    key_file::make_px4_folder(file)?;
    if keys.current()?.is_none() {
        keys.stage(&key)?;
        keys.commit()?;
    }
    let current = keys.current()?.context("the key has just been written")?;
    key_file::write_px4(file, &current, wall_stamp()?)
        .with_context(|| file.display().to_string())?;
    print_line(&format!(
        "{}: PX4's key file, key id {}; start PX4 with it",
        file.display(),
        current.id()
    ));
    Ok(())
}

fn clock(which: &Which, accept: bool) -> Result<(), Failure> {
    let (config, vehicle, path, _) = open(which)?;
    let shown = || -> anyhow::Result<()> {
        let mut store = FileDisk::open(&config.store.dir)?;
        let key = key_file::read(&path)?.id();
        let wall = wall_stamp()?;
        match store.load(&key)? {
            None => print_line(&format!(
                "vehicle {}: key {key} has not been used yet",
                vehicle.id
            )),
            Some(Ceiling(ceiling)) => {
                let days = |a: Stamp, b: Stamp| a.since(b).as_secs_f64() / 86_400.0;
                let ahead = days(wall, ceiling) - days(ceiling, wall);
                print_line(&format!(
                    "vehicle {}: key {key}, nothing is stamped beyond {} (10 us since 2015); the wall clock is {ahead:+.4} \
                     days from there",
                    vehicle.id,
                    ceiling.get()
                ));
            }
        }
        if accept {
            // Enough for the next start, which believes a wall clock that is at the ceiling or up to 366 days beyond it.
            Ceiling::raise(&mut store, &key, wall)?;
            print_line(
                "the wall clock is accepted: the signing clock continues from it, and never goes back",
            );
        }
        Ok(())
    };
    shown().map_err(failed)
}

fn list(config: &Path) -> Result<(), Failure> {
    let Stored { dir, vehicles, .. } = load_stored(config)?;
    if let Some(own) = peek_identity(&dir) {
        print_line(&format!("this VSM: fingerprint {}", own.fingerprint()));
    }
    for vehicle in &vehicles {
        let Signing::KeyFile(path, _) = &vehicle.signing else {
            print_line(&format!("vehicle {}: signing is off", vehicle.id));
            continue;
        };
        for (part, meaning) in [
            ("", "in force"),
            (".next", "rotation not finished: the vehicle may have it"),
            (".previous", "the one before"),
        ] {
            let file = beside(path, part);
            if !file.exists() {
                continue;
            }
            let key = key_file::read(&file).map_err(bad)?;
            print_line(&format!(
                "vehicle {}: key {} {meaning}",
                vehicle.id,
                key.id()
            ));
        }
        let record = peek::<ExchangeRecord>(&dir, &vehicle.id).map_err(failed)?;
        if let Some(peer) = record.as_ref().and_then(ExchangeRecord::peer) {
            print_line(&format!(
                "vehicle {}: paired with agent {}",
                vehicle.id,
                peer.fingerprint()
            ));
        } else if record.is_some_and(|record| record.pending.is_some()) {
            print_line(&format!(
                "vehicle {}: a pairing was answered and not confirmed; pair again",
                vehicle.id
            ));
        }
    }
    Ok(())
}

/// The file beside a key file, where that really is.
fn beside(path: &Path, part: &str) -> PathBuf {
    let real = real_path(path).unwrap_or_else(|_| path.to_owned());
    let mut name = real.into_os_string();
    name.push(part);
    PathBuf::from(name)
}

/// The configuration, the vehicle that is meant, its key file and how keys are agreed about.
pub(super) fn open(which: &Which) -> Result<(Config, Vehicle, PathBuf, Exchange), Failure> {
    let config = load(which.config.path())?;
    let found: Vec<Vehicle> = config
        .vehicles()
        .filter(|vehicle| {
            which
                .vehicle
                .as_ref()
                .is_none_or(|id| vehicle.id.to_string() == *id)
        })
        .cloned()
        .collect();
    let [vehicle] = &found[..] else {
        let ids: Vec<String> = config
            .vehicles()
            .map(|vehicle| vehicle.id.to_string())
            .collect();
        let ids = if ids.is_empty() {
            "none".to_owned()
        } else {
            ids.join(", ")
        };
        return Err(bad(match &which.vehicle {
            Some(named) => anyhow!(
                "vehicle {named} is not in the configuration, expected one of its vehicles: {ids}"
            ),
            None => anyhow!("which vehicle is not named, expected one of {ids}: --vehicle ID"),
        }));
    };
    let Signing::KeyFile(path, exchange) = &vehicle.signing else {
        return Err(bad(anyhow!(
            "vehicle {}: signing is \"off\" in the configuration; name a key_file there first",
            vehicle.id
        )));
    };
    Ok((config.clone(), vehicle.clone(), path.clone(), *exchange))
}

pub(super) fn wall_stamp() -> anyhow::Result<Stamp> {
    let wall = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .context("this computer's clock is before 1970")?;
    Ok(Stamp::from_unix(wall))
}
