//! `vsm guard`: the guard beside a CUCS, and its keys.

use std::net::{SocketAddr, ToSocketAddrs as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use clap::{Args, Subcommand};
use mavlink_link::signing::SigningKey;
use stanag_msgs::Id;

use crate::shell::guard_file;
use crate::shell::guard_proxy::{GuardConfig, GuardError, GuardProxy};
use crate::shell::key_file::KeyFileError;
use crate::shell::service;

use super::config_arg::ConfigArg;
use super::key;
use super::process::{Failure, LogFormat, announce, bad, failed, log, print, runtime, stop_signal};
use super::status;

#[derive(Debug, Subcommand)]
pub(crate) enum Action {
    /// Run the guard beside a CUCS, until SIGTERM or SIGINT: set the CUCS to send to LISTEN instead of to the VSM
    Run(Run),
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
    /// Replace a guard key by a new one; the old one is accepted for 24 h more, while the new one is copied to the CUCS
    Rotate {
        /// The key file of the VSM
        file: PathBuf,
    },
    /// Replace a guard key by a new one and delete the old one: its holder is locked out with the next `vsm reload`
    Revoke {
        /// The key file of the VSM
        file: PathBuf,
    },
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
        Action::Keygen { file } => key::generate(&file),
        Action::Status { config, json } => status::show_guards(config.path(), json),
        Action::Rotate { file } => {
            let text = "the old one is accepted for 24 h; run `vsm reload`, and copy the file to the CUCS's guard";
            changed(&file, guard_file::rotate(&file), text)
        }
        Action::Revoke { file } => {
            let text = "the old one is deleted; run `vsm reload`, which locks out who has it";
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

fn serve(arguments: Run) -> Result<(), Failure> {
    let Run {
        cucs,
        vsm_id,
        vsm,
        listen,
        key_file,
        store,
        users,
        log: format,
    } = arguments;
    let found = vsm.to_socket_addrs().with_context(|| {
        format!("--vsm {vsm} has no address, expected HOST:PORT such as 192.0.2.1:4586")
    });
    let to = found.map_err(bad)?.next();
    let to = to.ok_or_else(|| bad(anyhow!("--vsm {vsm}: the host has no address")))?;
    let _log = log(format)?;
    let config = GuardConfig {
        cucs,
        vsm: vsm_id,
        listen,
        to,
        key_file,
        store,
        users,
    };
    runtime()?.block_on(async {
        let proxy = GuardProxy::open(config)
            .await
            .map_err(|fault| match fault {
                GuardError::Open(_) | GuardError::Key(_) => bad(fault),
                other => failed(other),
            })?;
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
