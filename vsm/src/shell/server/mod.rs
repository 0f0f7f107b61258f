//! `vsm run`: the bridge between its sockets. One thread, one machine; tasks only move bytes to and from it.

mod error;
mod open;
mod shared;
mod tasks;

pub use error::StartError;

use std::future::Future;
use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::rc::Rc;

use tokio::net::{TcpListener, UnixListener};
use tokio::task::LocalSet;

use self::shared::Shared;
use self::tasks::{keep_time, receive_dli, receive_vehicle, send, tell_status};
use super::sockets::{DliSockets, VehicleReader, VehicleWriter};
use super::{http, service};
use crate::session::Status;

/// A bridge with its sockets open, ready to serve.
#[derive(Debug)]
pub struct Server {
    shared: Rc<Shared>,
    dli: DliSockets,
    readers: Vec<VehicleReader>,
    writers: Vec<VehicleWriter>,
    status: UnixListener,
    page: Option<TcpListener>,
}

impl Server {
    /// Where stations reach it.
    ///
    /// # Errors
    /// The system's.
    pub fn dli_address(&self) -> io::Result<SocketAddr> {
        self.dli.unicast.local_addr()
    }

    /// Where the vehicle with this index reaches it; `None` for a serial line.
    #[must_use]
    pub fn vehicle_address(&self, index: usize) -> Option<SocketAddr> {
        match self.readers.get(index)? {
            VehicleReader::Udp(socket) => socket.local_addr().ok(),
            VehicleReader::Serial(_) => None,
        }
    }

    /// The recording of the vehicle with this index.
    #[must_use]
    pub fn recording(&self, index: usize) -> Option<PathBuf> {
        let core = self.shared.core.borrow();
        core.recordings
            .get(index)?
            .as_ref()
            .map(|recording| recording.path().to_owned())
    }

    /// Serves until `stop` is done, then gives the last status.
    pub async fn serve(self, stop: impl Future<Output = ()>) -> Status {
        let Server {
            shared,
            dli,
            readers,
            writers,
            status,
            page,
        } = self;
        let local = LocalSet::new();
        let unicast = Rc::new(dli.unicast);
        local.spawn_local(receive_dli(shared.clone(), unicast.clone()));
        let group = dli.group.map(|(socket, group)| (Rc::new(socket), group));
        if let Some((socket, _)) = &group {
            local.spawn_local(receive_dli(shared.clone(), socket.clone()));
        }
        for (index, reader) in readers.into_iter().enumerate() {
            local.spawn_local(receive_vehicle(shared.clone(), index, reader));
        }
        local.spawn_local(send(shared.clone(), unicast, group, writers));
        local.spawn_local(keep_time(shared.clone()));
        local.spawn_local(tell_status(shared.clone(), status));
        local.spawn_local(service::keep_alive());
        if let Some(listener) = page {
            let shared = shared.clone();
            local.spawn_local(http::serve(listener, move || shared.status()));
        }
        local.run_until(stop).await;
        // Only the recordings are buffered in memory: the store writes every record at once.
        shared.core.borrow_mut().flush();
        shared.status()
    }
}
