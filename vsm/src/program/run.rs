//! `vsm run`.

use std::path::Path;

use crate::config::Config;
use crate::shell::disk::{FileDisk, NativeFileSystem};
use crate::shell::server::{Server, StartError};
use crate::shell::service;

use super::process::{Failure, LogFormat, announce, bad, failed, log, runtime, stop_signal};
use super::zeroize;

pub(crate) fn run(path: &Path, format: LogFormat) -> Result<(), Failure> {
    let mut config = Config::load(path).map_err(bad)?;
    let _log = log(format)?;
    // Before any key is read, and before a socket is open.
    zeroize::finish(
        &config.store.dir,
        Some(&|store, in_flight, report| {
            zeroize::beyond_bridge(&config, &store, in_flight, report);
        }),
    )?;
    // Minutes, at times: not while a vehicle waits for a node that has taken over.
    service::while_busy(|| config.read_terrain(None)).map_err(bad)?;
    let runtime = runtime()?;
    runtime.block_on(async {
        // The store's lock comes first: a second bridge stops here, before it touches keys or sockets.
        let opened = match config.store.shared() {
            None => FileDisk::open(&config.store.dir),
            Some(_) => FileDisk::open_on(&config.store.dir, Box::new(NativeFileSystem)),
        };
        let disk = opened.map_err(|cause| failed(StartError::from(cause)))?;
        let mut stop = Box::pin(stop_signal()?);
        let Some((disk, mut owned)) = owned::own(&config, disk, &mut stop).await? else {
            tracing::info!("stopped");
            return Ok(());
        };
        let opened = service::while_busy(|| Server::open_on(&config, disk));
        let mut server = opened.map_err(|fault| match fault {
            StartError::Key(_)
            | StartError::Keys(_)
            | StartError::SameKey { .. }
            | StartError::GuardKey { .. }
            | StartError::Terrain(_) => bad(fault),
            other => failed(other),
        })?;
        server.reload_from(path).map_err(failed)?;
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
        let mut lost = None;
        let end = async {
            tokio::select! {
                () = stop => {}
                why = &mut owned.ended => lost = Some(why),
            }
        };
        server.serve(end).await.map_err(failed)?;
        if store.is_ordered() {
            // What keeps the lease writes into the folder, too.
            owned = owned.given_up();
        }
        zeroize::discard_keys(&config, store).await;
        // Before it counts as stopping: to erase may take longer than a service manager waits then.
        zeroize::finish(&config.store.dir, None)?;
        service::stopping();
        // All that was promised is stored: the next node need not wait.
        drop(owned);
        if let Some(why) = lost {
            return Err(failed(anyhow::anyhow!(
                "this node must not serve any more: {why}"
            )));
        }
        tracing::info!("stopped");
        Ok(())
    })
}

/// Whose store it is: of this computer alone.
#[cfg(not(feature = "etcd"))]
mod owned {
    use std::future::Pending;
    use std::pin::Pin;

    use super::{Config, Failure, FileDisk};

    pub(super) struct Owned {
        pub(super) ended: Pending<String>,
    }

    impl Owned {
        pub(super) fn given_up(self) -> Owned {
            self
        }
    }

    #[expect(clippy::unused_async, reason = "as where a node stands by")]
    pub(super) async fn own(
        _: &Config,
        disk: FileDisk,
        _: &mut Pin<Box<impl Future<Output = ()>>>,
    ) -> Result<Option<(FileDisk, Owned)>, Failure> {
        let ended = std::future::pending();
        Ok(Some((disk, Owned { ended })))
    }
}

/// Whose store it is: of this computer alone, or of the node that owns the VSM.
#[cfg(feature = "etcd")]
mod owned {
    use std::pin::Pin;

    use super::super::process::{announce, bad, failed};
    use super::{Config, Failure, FileDisk, service};
    use crate::shell::fleet::{Held, Stop, stand_by};
    use crate::shell::key_file;

    pub(super) struct Owned {
        /// Done, with the reason, when this node must not serve any more.
        pub(super) ended: Pin<Box<dyn Future<Output = String>>>,
        /// Released when this is dropped.
        held: Option<Held>,
    }

    impl Owned {
        /// What is left when this node does not own the VSM any more.
        pub(super) fn given_up(mut self) -> Owned {
            self.held = None;
            self
        }
    }

    /// Waits until this node owns the VSM; `None` where it was stopped before.
    pub(super) async fn own(
        config: &Config,
        disk: FileDisk,
        stop: &mut Pin<Box<impl Future<Output = ()>>>,
    ) -> Result<Option<(FileDisk, Owned)>, Failure> {
        let Some(store) = config.store.shared() else {
            let ended = Box::pin(std::future::pending());
            return Ok(Some((disk, Owned { ended, held: None })));
        };
        let key = key_file::read(&store.key_file).map_err(bad)?;
        let (vsm, stopped) = (config.dli.vsm_id, Stop::default());
        let of_thread = stopped.clone();
        // It waits for etcd, which no task here may.
        let mut standing = tokio::task::spawn_blocking(move || {
            let mut report = |line: &str| announce("INFO", line);
            // It counts as started: what it waits for may be months away.
            service::ready();
            service::while_busy(|| stand_by((&store, vsm), &key, disk, &of_thread, &mut report))
        });
        let held = tokio::select! {
            () = stop => {
                stopped.set();
                // Where it owned the VSM just then, it gives that up.
                let held = standing.await.map_err(failed)?.map_err(failed)?;
                drop(held);
                return Ok(None);
            }
            held = &mut standing => held,
        };
        let held = held.map_err(failed)?.map_err(failed)?;
        Ok(held.map(|(disk, mut held)| {
            let mut ended = held.ended();
            let ended = Box::pin(async move {
                let why = ended.recv().await;
                why.unwrap_or_else(|| "its lease is not kept any more".to_owned())
            });
            let held = Some(held);
            (disk, Owned { ended, held })
        }))
    }
}
