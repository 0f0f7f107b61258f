//! `/control`: the WebSocket by which web clients are ground stations (docs/guide/websocket.md).
//!
//! | part | does |
//! |---|---|
//! | this file | lets a connection in: the request, and the thread of all connections |
//! | `connection` | one connection: opening, frames both ways, its limits |
//! | `report` | what a connection and the bridge give each other |
//! | `route` | a file of a route into the datagrams of its client, on a thread beside |
//! | [`Clients`] (`clients`) | the bridge's side: a queue for each client |
//!
//! The connections have a thread of their own. What does not verify ends there, and so does the work that JSON and HMACs are: the
//! bridge's thread takes datagrams from a queue ([`Report`]) and puts datagrams into queues, and waits for none of them.

mod clients;
mod connection;
mod report;
mod route;

use std::collections::VecDeque;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

use axum::Router;
use axum::body::Body;
use axum::extract::ws::{WebSocket, WebSocketUpgrade, rejection::WebSocketUpgradeRejection};
use axum::extract::{Extension, State};
use axum::http::{Response, StatusCode};
use axum::routing::get;
use stanag_msgs::Id;
use tokio::sync::mpsc;
use tokio::task::{AbortHandle, JoinSet};

pub use self::clients::{ClientEnds, Clients};
pub use self::report::{Admitted, Report};
use super::places::makes_room;
use super::routes;
use crate::session::computer_of;
use crate::session::web::{MAX_FRAME, WebRefusal};

/// Where the reports of all connections arrive.
pub type Reports = mpsc::Receiver<Report>;

/// By which connections come in.
#[derive(Debug, Clone)]
pub struct Door {
    connections: mpsc::Sender<(WebSocket, SocketAddr)>,
    reports: mpsc::Sender<Report>,
}

/// Where a request comes from.
#[derive(Debug, Clone, Copy)]
pub(super) struct From(pub(super) SocketAddr);

/// Begins the thread of the connections. It ends when the door is gone.
///
/// # Errors
/// There is no thread.
pub fn open(vsm: Id) -> io::Result<(Door, Reports)> {
    let (connections, arriving) = mpsc::channel(ARRIVING);
    let (reports, reported) = mpsc::channel(REPORTS);
    let door = Door {
        connections,
        reports: reports.clone(),
    };
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_time()
        .max_blocking_threads(IMPORTS)
        .build()?;
    thread::Builder::new()
        .name("web clients".to_owned())
        .spawn(move || {
            // Of this thread alone, on Linux. Where the cores are few, JSON for fifty clients must not take turns with the
            // thread that flies.
            let _ = rustix::process::nice(NICE);
            runtime.block_on(serve(vsm, arriving, reports));
        })?;
    Ok((door, reported))
}

/// The route. `None`: control is off.
pub(super) fn routes(door: Option<Door>) -> Router {
    Router::new().route(PATH, get(enter)).with_state(door)
}

async fn enter(
    State(door): State<Option<Door>>,
    Extension(From(from)): Extension<From>,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response<Body> {
    let Some(door) = door else {
        return routes::text(StatusCode::NOT_FOUND, OFF);
    };
    let Ok(upgrade) = upgrade else {
        return routes::text(StatusCode::UPGRADE_REQUIRED, NO_UPGRADE);
    };
    // One that is longer is named by who counts it; one that is much longer is not even kept.
    let upgrade = upgrade
        .read_buffer_size(READ_BUFFER)
        .max_message_size(2 * MAX_FRAME)
        .max_frame_size(2 * MAX_FRAME);
    upgrade.on_upgrade(move |socket| async move {
        // Nobody waits here: it would be as many as somebody connects, each with an open socket.
        if door.connections.try_send((socket, from)).is_err() {
            door.refuse(from, WebRefusal::Many);
        }
    })
}

impl Door {
    /// A request for the WebSocket is refused.
    pub(super) fn refuse(&self, from: SocketAddr, why: WebRefusal) {
        // Where the queue is full something is counted already, and nothing waits for a stranger.
        let _ = self.reports.try_send(Report::Refused { from, why });
    }
}

/// Connections that have not verified, the oldest first. When all places are taken one of them makes room, of the host that has most.
#[derive(Debug, Default)]
struct Waiting(Mutex<VecDeque<Unverified>>);

#[derive(Debug)]
struct Unverified {
    number: u64,
    host: u64,
    task: AbortHandle,
}

impl Waiting {
    /// The place of one more, and whether another had to leave for it.
    fn enter(&self, number: u64, from: IpAddr, task: AbortHandle) -> bool {
        let host = computer_of(from);
        let mut waiting = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        waiting.retain(|one| !one.task.is_finished());
        let full = waiting.len() >= MAX_WAITING;
        if full {
            let held: Vec<_> = waiting.iter().map(|one| (one.host, true)).collect();
            let least = makes_room(&held, host);
            if let Some(one) = least.and_then(|at| waiting.remove(at)) {
                one.task.abort();
            }
        }
        waiting.push_back(Unverified { number, host, task });
        full
    }

    /// It has verified and keeps its place, whatever other clients connect.
    fn leave(&self, number: u64) {
        let mut waiting = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        waiting.retain(|one| one.number != number);
    }
}

async fn serve(
    vsm: Id,
    mut arriving: mpsc::Receiver<(WebSocket, SocketAddr)>,
    reports: mpsc::Sender<Report>,
) {
    let waiting = Arc::new(Waiting::default());
    let numbers = AtomicU64::new(1);
    let mut connections = JoinSet::new();
    loop {
        let (socket, from) = tokio::select! {
            arrived = arriving.recv() => match arrived {
                Some(arrived) => arrived,
                None => break,
            },
            Some(_) = connections.join_next() => continue,
        };
        let number = numbers.fetch_add(1, Ordering::Relaxed);
        let (reports_of, leaves) = (reports.clone(), waiting.clone());
        let verified = move || leaves.leave(number);
        let ends = connection::run(socket, (number, from), vsm, reports_of, verified);
        let task = connections.spawn(ends);
        if waiting.enter(number, from.ip(), task) {
            let why = WebRefusal::Many;
            let _ = reports.try_send(Report::Refused { from, why });
        }
    }
    // Each is closed by the bridge's end of it.
    let _ = tokio::time::timeout(LAST_FRAMES, async {
        while connections.join_next().await.is_some() {}
    })
    .await;
}

/// Of the WebSocket.
pub(super) const PATH: &str = "/control";
const OFF: &str = "control is off: [web] control = true in the configuration\n";
const NO_UPGRADE: &str = "expected the upgrade to a WebSocket\n";
/// Bytes of each connection that are read at once. They are cleared before each read: with tungstenite's 128 KiB that is a sixth of
/// the thread's time.
const READ_BUFFER: usize = 4_096;
/// Connections that have not verified.
const MAX_WAITING: usize = 64;
/// Between the page's listener and the thread of the connections.
const ARRIVING: usize = 64;
/// Between all connections and the bridge: each waits for its turn here, so that a flood of one delays itself.
const REPORTS: usize = 64;
/// Files of routes that are read at once; others wait for their turn.
const IMPORTS: usize = 2;
/// How long connections may take to say that they end.
const LAST_FRAMES: std::time::Duration = std::time::Duration::from_millis(300);
/// So much lower is the priority of the connections.
const NICE: i32 = 10;

#[cfg(test)]
mod tests {
    use std::future::pending;
    use std::net::Ipv4Addr;

    use super::*;

    #[tokio::test]
    async fn one_host_takes_no_waiting_place_of_another() {
        let waiting = Waiting::default();
        let task = || tokio::spawn(pending::<()>()).abort_handle();
        let [client, stranger] = [1, 2].map(|last| IpAddr::from(Ipv4Addr::new(192, 0, 2, last)));
        let (own, first) = (task(), task());
        assert!(!waiting.enter(0, client, own.clone()));
        assert!(!waiting.enter(1, stranger, first.clone()));
        let mut left = 0;
        for number in 2..200 {
            left += usize::from(waiting.enter(number, stranger, task()));
        }
        // What is aborted ends when its turn comes.
        for _ in 0..200 {
            tokio::task::yield_now().await;
        }
        assert_eq!(left, 200 - MAX_WAITING);
        assert!(first.is_finished());
        assert!(!own.is_finished(), "it has the place that it had");
    }
}
