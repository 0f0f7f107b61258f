//! `vsm run`: the bridge between its sockets. One thread, one machine; tasks only move bytes to and from it, a second thread
//! writes the disk, and a third agrees on keys with the guards of CUCSs (`guard_thread`; `pairing` is the socket for
//! such requests).

mod batch;
pub mod checks;
mod encryption;
mod error;
mod file_changes;
mod files;
mod forward;
mod gathering;
mod guard_thread;
mod guards;
mod inbox;
mod open;
mod pairing;
mod read_ahead;
mod reload;
mod shared;
mod tasks;
pub mod trial;
mod vehicle;
mod web;
mod zeroize;

pub use error::StartError;
pub use gathering::Gathering;

use std::future::Future;
use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::net::{TcpListener, UnixListener};
use tokio::sync::mpsc::UnboundedReceiver;
use tokio::sync::{Notify, watch};
use tokio::task::LocalSet;

use self::forward::ForwardReader;
use self::guard_thread::Done;
use self::shared::Shared;
use self::tasks::{
    keep_time, receive_dli, receive_forward, receive_vehicle, send, send_settings, send_status,
    take_stored, watch_files, watch_group,
};
use super::disk::FileDisk;
use super::sockets::{DliSockets, Resolver, VehicleReader};
use super::status_socket;
use super::tasks::{TaskFault, Tasks};
use super::timer::Timer;
use super::web::control::{Door, Reports};
use super::web::{self as page, Page};
use crate::session::Status;

/// A bridge with its sockets open, ready to serve.
#[derive(Debug)]
pub struct Server {
    shared: Rc<Shared>,
    dli: DliSockets,
    /// One for each link: its index, and what ends its task.
    readers: Vec<(usize, VehicleReader, Rc<Notify>)>,
    /// One for each other ground station.
    forwards: Vec<ForwardReader>,
    status: UnixListener,
    settings: UnixListener,
    files: UnixListener,
    zeroize: UnixListener,
    /// Where a person pairs the guard of a CUCS.
    pairing: UnixListener,
    /// The results of pairings.
    agreed: UnboundedReceiver<Done>,
    page: Option<(TcpListener, Page)>,
    /// The WebSocket of the page, where web clients may control.
    control: Option<(Door, Reports)>,
    /// The configuration that is read again, and where that is requested.
    reload: Option<(PathBuf, UnixListener)>,
    /// Resolves the host names of a reloaded configuration.
    resolver: Resolver,
    /// Of the task that keeps time.
    timer: Timer,
}

impl Server {
    /// The address at which stations reach it.
    ///
    /// # Errors
    /// The system's.
    pub fn dli_address(&self) -> io::Result<SocketAddr> {
        self.dli.unicast.local_addr()
    }

    /// Its store, which stays locked as long as this is held.
    #[must_use]
    pub fn store(&self) -> FileDisk {
        self.shared.core.borrow().store.files().shared()
    }

    /// The address of the operator's page; `None` if none is served.
    #[must_use]
    pub fn page_address(&self) -> Option<SocketAddr> {
        self.page.as_ref()?.0.local_addr().ok()
    }

    /// The address for the vehicle with this index; `None` for a serial line.
    #[must_use]
    pub fn vehicle_address(&self, index: usize) -> Option<SocketAddr> {
        let core = self.shared.core.borrow();
        core.writers.get(index)?.local_addr()
    }

    /// Allows reloads of the configuration file while it serves: by SIGHUP, and by `vsm reload`.
    ///
    /// # Errors
    /// The socket for `vsm reload` cannot be opened.
    pub fn reload_from(&mut self, path: &Path) -> Result<(), StartError> {
        let listener = {
            let core = self.shared.core.borrow();
            status_socket::listen(&core.config.store.dir, status_socket::RELOAD)
                .map_err(StartError::Status)?
        };
        self.reload = Some((path.to_owned(), listener));
        Ok(())
    }

    /// Answers no station and commands no vehicle after the time that this shows, which another thread moves: the end of this
    /// node's lease of the VSM.
    pub fn serve_until(&mut self, lease: watch::Receiver<Option<Instant>>) {
        self.shared.core.borrow_mut().lease = lease;
    }

    /// Lets frames of vehicles gather by this, which the runtime that serves calls before it waits.
    pub fn gather_by(&mut self, gathering: Arc<Gathering>) {
        self.shared.core.borrow_mut().gathering = gathering;
    }

    /// Resolves the host names of a reload, on a separate thread, in place of the system's resolver.
    pub fn resolve_by(&mut self, resolver: Resolver) {
        self.resolver = resolver;
    }

    /// The recording of the vehicle with this index.
    #[must_use]
    pub fn recording(&self, index: usize) -> Option<PathBuf> {
        let core = self.shared.core.borrow();
        core.recordings
            .get(index)?
            .as_ref()
            .map(|recording| recording.path())
    }

    /// Serves until `stop` is done, or an order to zeroize is stored, then returns the last status.
    ///
    /// # Errors
    /// A task has ended or does not answer: the rest must not continue without it.
    pub async fn serve(self, stop: impl Future<Output = ()>) -> Result<Status, TaskFault> {
        let Server {
            shared,
            dli,
            readers,
            forwards,
            status,
            settings,
            files,
            zeroize,
            pairing,
            agreed,
            page,
            control,
            reload,
            resolver,
            timer,
        } = self;
        let local = LocalSet::new();
        let mut tasks = Tasks::default();
        let unicast = Rc::new(dli.unicast);
        let group = dli.group.map(|(socket, group)| (Rc::new(socket), group));
        if let Some((_, group)) = &group {
            let (shared, group) = (shared.clone(), group.clone());
            tasks.spawn(&local, "group watch", |beat| {
                watch_group(shared, beat, group)
            });
        }
        let (of_all, socket) = (shared.clone(), unicast.clone());
        tasks.spawn(&local, "DLI receiver", |beat| {
            receive_dli(of_all, beat, socket, None)
        });
        if let Some((socket, group)) = group.clone() {
            let of_all = shared.clone();
            tasks.spawn(&local, "DLI group receiver", |beat| {
                receive_dli(of_all, beat, socket, Some(group))
            });
        }
        for (port, reader, close) in readers {
            let shared = shared.clone();
            tasks.spawn(&local, "vehicle receiver", |beat| {
                receive_vehicle(shared, beat, port, reader, close)
            });
        }
        for (number, reader, close) in forwards {
            let shared = shared.clone();
            tasks.spawn(&local, "ground station receiver", |beat| {
                receive_forward(shared, beat, number, reader, close)
            });
        }
        let (of_all, socket) = (shared.clone(), unicast.clone());
        tasks.spawn(&local, "guard keys", |beat| {
            pairing::serve(of_all, beat, socket, agreed, pairing)
        });
        let of_all = shared.clone();
        let group = group.map(|(socket, group)| (socket, group.address));
        tasks.spawn(&local, "sender", |beat| send(of_all, beat, unicast, group));
        let of_all = shared.clone();
        tasks.spawn(&local, "clock", |beat| keep_time(of_all, beat, timer));
        let of_all = shared.clone();
        tasks.spawn(&local, "disk", |beat| take_stored(of_all, beat));
        let of_all = shared.clone();
        tasks.spawn(&local, "files", |beat| watch_files(of_all, beat));
        let of_all = shared.clone();
        tasks.spawn(&local, "status socket", |beat| {
            send_status(of_all, beat, status)
        });
        let of_all = shared.clone();
        tasks.spawn(&local, "settings socket", |beat| {
            send_settings(of_all, beat, settings)
        });
        let of_all = shared.clone();
        tasks.spawn(&local, "file socket", |beat| {
            files::serve(of_all, beat, files)
        });
        let of_all = shared.clone();
        tasks.spawn(&local, "zeroize", |beat| {
            zeroize::serve(of_all, beat, zeroize)
        });
        let (door, reports) = control.unzip();
        if let Some((listener, page)) = page {
            let of_all = shared.clone();
            let page = Page { door, ..page };
            tasks.spawn(&local, "status page", |beat| {
                page::serve(listener, page, beat, of_all)
            });
        }
        if let Some(reports) = reports {
            let of_all = shared.clone();
            tasks.spawn(&local, "web clients", |beat| {
                web::serve(of_all, beat, reports)
            });
        }
        if let Some((path, listener)) = reload {
            let (of_all, later) = (shared.clone(), tasks.later());
            tasks.spawn(&local, "reload", |beat| {
                reload::serve(of_all, beat, later, (path, resolver), listener)
            });
        }
        let ended = async {
            tokio::select! {
                () = stop => {}
                () = shared.ended.notified() => {}
            }
        };
        let served = local.run_until(tasks.run(ended)).await;
        let mut core = shared.core.borrow_mut();
        core.flush();
        let end = Instant::now() + LAST_WRITES;
        core.store.wait(LAST_WRITES);
        for keys in core.key_stores.iter().flatten() {
            keys.files.wait(end);
        }
        core.recorder.wait(end);
        drop(core);
        served.map(|()| shared.status())
    }
}

/// Time limit for remaining writes at the end: longer than a slow disk takes, shorter than a service manager waits.
const LAST_WRITES: Duration = Duration::from_secs(10);
