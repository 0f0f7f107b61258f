//! `vsm guard`: the guard beside a CUCS, and its keys.

use std::io::{BufRead as _, Read as _};
use std::net::{SocketAddr, ToSocketAddrs as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use clap::{Args, Subcommand};
use dli_group::{Group, Interface};
use mavlink_link::exchange::PairingCode;
use mavlink_link::signing::SigningKey;
use stanag_msgs::Id;
use zeroize::Zeroizing;

use crate::guard_exchange::CucsNews;
use crate::shell::disk::folder_of;
use crate::shell::guard_file;
use crate::shell::guard_link::{GuardEnding, GuardError, GuardPairing, GuardSide};
use crate::shell::guard_proxy::{GuardConfig, GuardProxy};
use crate::shell::key_file::KeyFileError;
use crate::shell::key_store::KeyStoreError;
use crate::shell::{memory, pairing_socket, service};

use super::config_arg::ConfigArg;
use super::key;
use super::process::{
    Failure, LogFormat, act_for, announce, bad, failed, load_stored, log, print, print_line,
    runtime, stop_signal,
};
use super::status;

#[derive(Debug, Subcommand)]
pub(crate) enum Action {
    /// Run the guard beside a CUCS, until SIGTERM or SIGINT: set the CUCS to send to LISTEN instead of to the VSM
    Run(Run),
    /// Pair the guard of a CUCS with the VSM by a code: on the VSM's computer it opens the window of the running bridge and shows the
    /// code, on the CUCS's, with --vsm, it takes the code from standard input. Both have the same key then
    Pair(Pair),
    /// Write a new random guard key (32 bytes in hex, mode 0600) to a file that must not exist; copy it to the other end
    Keygen {
        /// The key file to write
        file: PathBuf,
    },
    /// Show which keys the CUCSs of a running bridge have, when they last verified, and what was refused in their names
    Status {
        #[command(flatten)]
        config: ConfigArg,
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Replace a guard key by a new one; the old one is accepted for 24 h more. With --cucs the running bridge agrees about it with
    /// the paired guard, with FILE it is copied to the CUCS by hand
    Rotate {
        /// The key file of the VSM
        #[arg(required_unless_present = "cucs", conflicts_with = "cucs")]
        file: Option<PathBuf>,
        /// Id of the CUCS whose guard is paired, such as 1b:00:00:a0
        #[arg(long, value_name = "ID")]
        cucs: Option<Id>,
        /// Configuration of the bridge, with --cucs
        #[arg(
            long,
            value_name = "FILE",
            default_value = "vsm.toml",
            requires = "cucs"
        )]
        config: PathBuf,
    },
    /// Replace a guard key by a new one and delete the old one, and the pairing: its holder is locked out with the next `vsm reload`
    Revoke {
        /// The key file of the VSM
        file: PathBuf,
    },
}

#[derive(Debug, Args)]
pub(crate) struct Pair {
    /// Id of the CUCS, such as 1b:00:00:a0
    #[arg(long, value_name = "ID")]
    cucs: Id,
    /// On the CUCS's computer: host and port of the VSM, its dli.listen
    #[arg(long, value_name = "HOST:PORT", requires = "vsm_id")]
    vsm: Option<String>,
    /// On the CUCS's computer: id of the VSM, its dli.vsm_id
    #[arg(long, value_name = "ID", requires = "vsm")]
    vsm_id: Option<Id>,
    /// On the CUCS's computer: key file, which is made or replaced
    #[arg(long, value_name = "FILE", default_value = "guard.key")]
    key_file: PathBuf,
    /// On the CUCS's computer: folder of what must survive a restart, that of `vsm guard run`
    #[arg(long, value_name = "DIR", default_value = "guard-state")]
    store: PathBuf,
    /// On the CUCS's computer: try for at most this long, s; the window is open for 10 minutes (600 s)
    #[arg(long, value_name = "S", default_value_t = 600)]
    wait_s: u64,
    #[command(flatten)]
    config: ConfigArg,
}

#[derive(Debug, Args)]
pub(crate) struct Run {
    /// Id of the CUCS, such as 1b:00:00:a0
    #[arg(long, value_name = "ID")]
    cucs: Id,
    /// Id of the VSM: its dli.vsm_id
    #[arg(long, value_name = "ID")]
    vsm_id: Id,
    /// Host and port of the VSM: its dli.listen
    #[arg(long, value_name = "HOST:PORT")]
    vsm: String,
    /// Address of loopback that the CUCS sends to
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:4586")]
    listen: SocketAddr,
    /// Key file, which the VSM has too
    #[arg(long, value_name = "FILE")]
    key_file: PathBuf,
    /// Folder of what must survive a restart; made with mode 0700
    #[arg(long, value_name = "DIR", default_value = "guard-state")]
    store: PathBuf,
    /// Receive the VSM's multicast group too, its dli.multicast: what it sends to this CUCS there goes to the CUCS as the rest does
    #[arg(long, value_name = "GROUP:PORT")]
    multicast: Option<SocketAddr>,
    /// Network interface on which the group is joined, by its name or address; without it as the system's routes say
    #[arg(long, value_name = "INTERFACE", requires = "multicast")]
    interface: Option<Interface>,
    /// Let programs of this user (by number) be the CUCS too, beside those of this user and root
    #[arg(long = "user", value_name = "UID")]
    users: Vec<u32>,
    /// Write the log as text or as JSON, one object a line; RUST_LOG chooses how much of it
    #[arg(long, value_name = "FORMAT", default_value = "text")]
    log: LogFormat,
}

pub(crate) fn run(action: Action) -> Result<(), Failure> {
    match action {
        Action::Run(arguments) => serve(arguments),
        Action::Pair(arguments) => pair(arguments),
        Action::Keygen { file } => key::generate(&file),
        Action::Status { config, json } => status::show_guards(config.path(), json),
        Action::Rotate {
            file: Some(file), ..
        } => {
            act_for(folder_of(&file), &[])?;
            let text = "the old one is accepted for 24 h; run `vsm reload`, and copy the file to the CUCS's guard";
            changed(&file, guard_file::rotate(&file), text)
        }
        Action::Rotate { cucs, config, .. } => {
            let cucs = cucs.ok_or_else(|| bad(anyhow!("neither FILE nor --cucs")))?;
            ask(&config, &format!("rotate {cucs}"), "key  ")
        }
        Action::Revoke { file } => {
            act_for(folder_of(&file), &[])?;
            let text = "the old one and the pairing are deleted; run `vsm reload`, which locks out who has it";
            changed(&file, guard_file::revoke(&file), text)
        }
    }
}

fn changed(file: &Path, key: Result<SigningKey, KeyFileError>, what: &str) -> Result<(), Failure> {
    let key = key.map_err(|fault| match fault {
        absent @ KeyFileError::Absent { .. } => bad(absent),
        other => failed(other),
    })?;
    print(&format!(
        "{}: a new key, id {}; {what}\n",
        file.display(),
        key.id()
    ))
}

fn pair(arguments: Pair) -> Result<(), Failure> {
    let Pair {
        cucs,
        vsm,
        vsm_id,
        key_file,
        store,
        wait_s,
        config,
    } = arguments;
    let (Some(vsm), Some(vsm_id)) = (vsm, vsm_id) else {
        return ask(config.path(), &format!("pair {cucs}"), "paired");
    };
    act_for(&store, &[])?;
    let to = resolve(&vsm)?;
    print_line("pairing code, as `vsm guard pair` shows it on the VSM's computer:");
    // With room for all that is read: a string that grows leaves copies of the code in memory that nothing wipes.
    let mut typed = Zeroizing::new(String::with_capacity(256));
    let read = std::io::stdin().lock().take(256).read_line(&mut typed);
    read.context("standard input").map_err(failed)?;
    let code = PairingCode::parse(typed.trim()).map_err(bad)?;
    let side = GuardSide {
        cucs,
        vsm: vsm_id,
        to,
        key_file,
        store,
    };
    let path = side.key_file.clone();
    let ending = runtime()?.block_on(async {
        let pairing = GuardPairing::open(side, code).await.map_err(refused)?;
        let own = pairing.own_key().fingerprint();
        print_line(&format!("this guard    {own}"));
        let patience = Duration::from_secs(wait_s);
        Ok(pairing.run(patience, &mut report).await)
    })?;
    match ending {
        GuardEnding::Paired { peer, key } => {
            let print = peer.map_or(String::new(), |peer| peer.fingerprint().to_string());
            print_line(&format!("paired with   {print}"));
            print_line(&format!("key           {key}, in {}", path.display()));
            print_line(
                "compare both fingerprints with what the VSM's computer shows, put the line that it shows into its configuration, and start `vsm guard run`",
            );
            Ok(())
        }
        GuardEnding::NotAnswered(unproven) => {
            let unproven = unproven.map_or(String::new(), |status| {
                format!("; last unproven answer: {status}")
            });
            Err(failed(anyhow!(
                "nobody answered with this code within {wait_s} s: is the window open (`vsm guard pair` on the VSM's computer), \
                 and the code the same{unproven}"
            )))
        }
    }
}

fn report(news: &CucsNews) {
    match news {
        CucsNews::NotAnswered => print_line("no answer yet; trying again"),
        CucsNews::Rejected(status) => print_line(&format!("unproven answer: {status}")),
        CucsNews::Failed(why) => print_line(&format!("not stored: {why}")),
        CucsNews::Dropped(status) => print_line(&format!("the VSM did not take the key: {status}")),
        CucsNews::Waiting | CucsNews::InForce(..) => {}
    }
}

/// Has the running bridge do it, and shows what comes of it. `done`: how the line begins that says that it is done.
fn ask(config: &Path, request: &str, done: &str) -> Result<(), Failure> {
    let stored = load_stored(config)?;
    let mut is_done = false;
    pairing_socket::ask(&stored.dir, request, |line| {
        is_done |= line.starts_with(done);
        print_line(line);
    })
    .map_err(|cause| failed(status::no_answer("bridge", &stored.dir, cause)))?;
    match is_done {
        true => Ok(()),
        false => Err(failed(anyhow!("it was not done"))),
    }
}

fn refused(fault: GuardError) -> Failure {
    match fault {
        GuardError::Open(_) | GuardError::Key(_) | GuardError::Keys(KeyStoreError::File(_)) => {
            bad(fault)
        }
        other => failed(other),
    }
}

fn resolve(vsm: &str) -> Result<SocketAddr, Failure> {
    let found = vsm.to_socket_addrs().with_context(|| {
        format!("--vsm {vsm} has no address, expected HOST:PORT such as 192.0.2.1:4586")
    });
    let to = found.map_err(bad)?.next();
    to.ok_or_else(|| bad(anyhow!("--vsm {vsm}: the host has no address")))
}

fn serve(arguments: Run) -> Result<(), Failure> {
    let Run {
        cucs,
        vsm_id,
        vsm,
        listen,
        key_file,
        store,
        multicast,
        interface,
        users,
        log: format,
    } = arguments;
    act_for(&store, &[])?;
    let to = resolve(&vsm)?;
    let group = multicast.map(|address| Group {
        interface,
        ..Group::new(address)
    });
    let _log = log(format)?;
    memory::lock();
    let side = GuardSide {
        cucs,
        vsm: vsm_id,
        to,
        key_file,
        store,
    };
    let config = GuardConfig {
        side,
        listen,
        group,
        users,
    };
    runtime()?.block_on(async {
        let proxy = GuardProxy::open(config).await.map_err(refused)?;
        let stop = stop_signal()?;
        let at = proxy.address().map_err(failed)?;
        announce(
            "INFO",
            &format!("guard: ready: CUCS {cucs} on {at}, VSM {vsm_id} at {to}"),
        );
        service::ready();
        proxy.serve(stop).await;
        service::stopping();
        Ok(())
    })
}
