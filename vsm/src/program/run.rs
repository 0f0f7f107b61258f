//! `vsm run`.

use std::path::Path;
use std::sync::Arc;

use crate::config::Config;
use crate::shell::disk::{FileDisk, NativeFileSystem};
use crate::shell::server::{Gathering, Server, StartError};
use crate::shell::{memory, service};

use super::check_config::located;
use super::process::{
    Failure, LogFormat, announce, bad, failed, gathering_runtime, load, log, stop_signal,
};
use super::zeroize;

pub(crate) fn run(path: &Path, format: LogFormat) -> Result<(), Failure> {
    let mut config = load(path)?;
    let _log = log(format)?;
    memory::lock();
    // Before any key is read and any socket is open: after an order to zeroize, nothing may be served.
    zeroize::finish(
        &config.store.dir,
        Some(&|store, in_flight, report| {
            zeroize::beyond_bridge(&config, &store, in_flight, report);
        }),
    )?;
    // This can take minutes, so it is done now, and not when a vehicle waits for a node that takes over.
    service::while_busy(|| config.read_terrain(None)).map_err(bad)?;
    let gathering = Arc::<Gathering>::default();
    let runtime = gathering_runtime(gathering.clone())?;
    runtime.block_on(async {
        // The store's lock is taken first: a second bridge stops here, before it touches keys or sockets.
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
        let mut server = opened.map_err(|fault| {
            let of_the_file = matches!(
                fault,
                StartError::Key(_)
                    | StartError::Keys(_)
                    | StartError::SameKey { .. }
                    | StartError::GuardKey { .. }
                    | StartError::Terrain(_)
            );
            let fault = located(path, &config, fault);
            if of_the_file {
                bad(fault)
            } else {
                failed(fault)
            }
        })?;
        server.reload_from(path).map_err(failed)?;
        server.serve_until(owned.lease.clone());
        server.gather_by(gathering);
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
        // The lock is kept: a process that waits for it would erase the keys before `discard_keys` has used them.
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
            // The keeper of the lease writes into the folder too, which is about to be erased.
            owned = owned.given_up();
        }
        zeroize::discard_keys(&config, store).await;
        // Before the process reports that it is stopping: erasing may take longer than a service manager then waits.
        zeroize::finish(&config.store.dir, None)?;
        service::stopping();
        // Everything that was promised is stored, so the next node need not wait for the lease to expire.
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

/// Ownership of the store: it belongs to this computer alone.
#[cfg(not(feature = "etcd"))]
mod owned {
    use std::future::Pending;
    use std::pin::Pin;
    use std::time::Instant;

    use tokio::sync::watch;

    use super::{Config, Failure, FileDisk};

    pub(super) struct Owned {
        pub(super) ended: Pending<String>,
        pub(super) lease: watch::Receiver<Option<Instant>>,
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
        let (ended, lease) = (std::future::pending(), watch::channel(None).1);
        Ok(Some((disk, Owned { ended, lease })))
    }
}

/// Ownership of the store: it belongs to this computer alone, or to the node that owns the VSM.
#[cfg(feature = "etcd")]
mod owned {
    use std::pin::Pin;
    use std::time::Instant;

    use tokio::sync::watch;

    use super::super::process::{announce, bad, failed};
    use super::{Config, Failure, FileDisk, service};
    use crate::shell::fleet::{Held, Stop, stand_by};
    use crate::shell::key_file;

    pub(super) struct Owned {
        /// Resolves, with the reason, when this node must no longer serve.
        pub(super) ended: Pin<Box<dyn Future<Output = String>>>,
        /// When the lease ends.
        pub(super) lease: watch::Receiver<Option<Instant>>,
        /// Released when this is dropped.
        held: Option<Held>,
    }

    impl Owned {
        /// Gives up the ownership of the VSM.
        pub(super) fn given_up(mut self) -> Owned {
            self.held = None;
            self
        }
    }

    /// Waits until this node owns the VSM; `None` if it was stopped before.
    pub(super) async fn own(
        config: &Config,
        disk: FileDisk,
        stop: &mut Pin<Box<impl Future<Output = ()>>>,
    ) -> Result<Option<(FileDisk, Owned)>, Failure> {
        let Some(store) = config.store.shared() else {
            let owned = Owned {
                ended: Box::pin(std::future::pending()),
                lease: watch::channel(None).1,
                held: None,
            };
            return Ok(Some((disk, owned)));
        };
        let key = key_file::read(&store.key_file).map_err(bad)?;
        let (vsm, stopped) = (config.dli.vsm_id, Stop::default());
        let of_thread = stopped.clone();
        // It blocks on etcd, which no task of this runtime may.
        let mut standing = tokio::task::spawn_blocking(move || {
            let mut report = |line: &str| announce("INFO", line);
            // Report the start now: what it waits for may be months away.
            service::ready();
            service::while_busy(|| stand_by((&store, vsm), &key, disk, &of_thread, &mut report))
        });
        let held = tokio::select! {
            () = stop => {
                stopped.set();
                // If it has just become the owner, it gives that up.
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
            let owned = Owned {
                ended,
                lease: held.lease(),
                held: Some(held),
            };
            (disk, owned)
        }))
    }
}
