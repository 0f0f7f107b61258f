//! `vsm run`.

use std::io::{self, IsTerminal as _, Write};
use std::path::Path;

use crate::config::{Config, Signing};
use crate::shell::server::{Server, StartError};
use crate::shell::service;
use anyhow::{Context as _, anyhow};
use tokio::signal::unix::{SignalKind, signal};
use tracing_subscriber::EnvFilter;

use super::Failure;

pub(crate) fn run(path: &Path) -> Result<(), Failure> {
    let config = Config::load(path).map_err(|fault| Failure::Bad(anyhow!(fault)))?;
    log();
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .context("no asynchronous runtime")
        .map_err(Failure::Failed)?;
    runtime.block_on(async {
        let server = Server::open(&config).map_err(|fault| match fault {
            StartError::Key(_) | StartError::Keys(_) | StartError::SameKey { .. } => {
                Failure::Bad(anyhow!(fault))
            }
            other => Failure::Failed(anyhow!(other)),
        })?;
        let mut terminate =
            signal(SignalKind::terminate()).map_err(|fault| Failure::Failed(fault.into()))?;
        let mut interrupt =
            signal(SignalKind::interrupt()).map_err(|fault| Failure::Failed(fault.into()))?;
        for vehicle in config
            .vehicles()
            .filter(|vehicle| vehicle.signing == Signing::Off)
        {
            tracing::warn!(
                "{}: MAVLink signing is OFF: anyone in range can command this vehicle",
                vehicle.id
            );
        }
        if config.cucs.is_empty() {
            tracing::warn!("no [[cucs]] is listed: nobody may connect");
        }
        let vehicles = config.vehicle.len();
        let ready = format!(
            "vsm: ready: DLI on {}, {vehicles} vehicle(s)\n",
            config.dli.listen
        );
        let _ = io::stderr().write_all(ready.as_bytes());
        service::ready();
        server
            .serve(async {
                tokio::select! {
                    _ = terminate.recv() => {}
                    _ = interrupt.recv() => {}
                }
            })
            .await;
        service::stopping();
        tracing::info!("stopped");
        Ok(())
    })
}

/// To standard error; RUST_LOG chooses how much, default info.
pub(super) fn log() {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("info"));
    // A second call in one process finds a log already: that is fine.
    let _ = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(io::stderr)
        .with_ansi(io::stderr().is_terminal())
        .with_target(false)
        .try_init();
}
