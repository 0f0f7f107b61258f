//! `vsm replay`: shows a recording on the operator's page, with a time line.

use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use tokio::net::TcpListener;

use super::process::{Failure, announce, bad, failed, runtime, stop_signal};
use crate::config::Config;
use crate::shell::replay::{self, ReplayError};
use crate::shell::web::Tiles;

/// Show a recording on the operator's page, with a time line: until Ctrl-C
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Recordings: folders, or files .tlog and .pcapng (default: [record] dir of the configuration)
    records: Vec<PathBuf>,
    /// Configuration whose recordings are shown where none are named
    #[arg(long, value_name = "FILE", default_value = "vsm.toml")]
    config: PathBuf,
    /// Serve the page on this address; port 0 is any
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:8587")]
    listen: SocketAddr,
    /// Show this PMTiles file of pictures under the map
    #[arg(long, value_name = "FILE")]
    tiles: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let records = if arguments.records.is_empty() {
        vec![configured(&arguments.config)?]
    } else {
        arguments.records.clone()
    };
    let timeline = replay::read(&records).map_err(|fault| advised(fault, arguments))?;
    let tiles = (arguments.tiles.as_deref().map(Tiles::open)).transpose();
    let tiles = tiles.map_err(bad)?;
    let runtime = runtime()?;
    runtime.block_on(async {
        let stop = stop_signal()?;
        let listener = TcpListener::bind(arguments.listen).await;
        let listener = listener
            .with_context(|| format!("--listen {} cannot be had", arguments.listen))
            .map_err(failed)?;
        let page = listener.local_addr().map_err(failed)?;
        announce(
            "INFO",
            &format!("ready: the recording is at http://{page}/ until Ctrl-C"),
        );
        replay::serve(listener, timeline, tiles, stop).await;
        Ok(())
    })
}

/// The fault, with the ways to name recordings where what was named is not there.
fn advised(fault: ReplayError, arguments: &Arguments) -> Failure {
    let is_missing = |cause: &io::Error| cause.kind() == io::ErrorKind::NotFound;
    let advice = match &fault {
        ReplayError::Io { cause, .. } if is_missing(cause) && arguments.records.is_empty() => {
            "`vsm run` with this configuration makes the folder"
        }
        ReplayError::Io { cause, .. } if is_missing(cause) => {
            "without a name it takes [record] dir of vsm.toml (--config)"
        }
        _ => return failed(fault),
    };
    failed(anyhow!("{fault}; {advice}"))
}

/// The folder that a bridge with this configuration records to.
fn configured(path: &Path) -> Result<PathBuf, Failure> {
    let config = Config::load(path).map_err(bad)?;
    let record = config.record.ok_or_else(|| {
        bad(anyhow!(
            "{} has no [record]: name the recordings, vsm replay FOLDER",
            path.display()
        ))
    })?;
    Ok(record.dir)
}
