//! `vsm run`.

use std::path::Path;

use crate::config::Config;
use crate::shell::server::{Server, StartError};
use crate::shell::service;

use super::process::{Failure, LogFormat, announce, bad, failed, log, runtime, stop_signal};
use super::zeroize;

pub(crate) fn run(path: &Path, format: LogFormat) -> Result<(), Failure> {
    let config = Config::load(path).map_err(bad)?;
    let _log = log(format)?;
    // Before any key is read, and before a socket is open.
    zeroize::finish(
        &config.store.dir,
        Some(&|store, in_flight, report| {
            zeroize::beyond_bridge(&config, &store, in_flight, report);
        }),
    )?;
    let runtime = runtime()?;
    runtime.block_on(async {
        let mut server = Server::open(&config).map_err(|fault| match fault {
            StartError::Key(_)
            | StartError::Keys(_)
            | StartError::SameKey { .. }
            | StartError::GuardKey { .. }
            | StartError::Terrain(_) => bad(fault),
            other => failed(other),
        })?;
        server.reload_from(path).map_err(failed)?;
        let stop = stop_signal()?;
        for warning in config.warnings() {
            tracing::warn!("{warning}");
        }
        if config.cucs.is_empty() {
            tracing::warn!("no [[cucs]] is listed: nobody may connect");
        }
        let vehicles = config.vehicle.len();
        let ready = format!("ready: DLI on {}, {vehicles} vehicle(s)", config.dli.listen);
        announce("INFO", &ready);
        service::ready();
        // Whoever waits for its lock would erase the keys first.
        let store = server.store();
        server.serve(stop).await.map_err(failed)?;
        zeroize::discard_keys(&config, store).await;
        // Before it counts as stopping: to erase may take longer than a service manager waits then.
        zeroize::finish(&config.store.dir, None)?;
        service::stopping();
        tracing::info!("stopped");
        Ok(())
    })
}
