//! One connection of a web client, from its challenge to its last frame.
//!
//! Each connection serves one client. While the client does not read, its own frames are not read either, and frames for it
//! wait in a bounded queue. Every end of a connection is reported with its reason.

use std::collections::VecDeque;
use std::future::pending;
use std::net::SocketAddr;
use std::time::Duration;

use axum::extract::ws::{CloseFrame, Message, WebSocket};
use futures_util::SinkExt as _;
use stanag_msgs::Id;
use tokio::sync::{mpsc, oneshot};
use tokio::task::{JoinHandle, spawn_blocking};
use tokio::time::{Instant, MissedTickBehavior, interval, timeout};

use super::report::{Admitted, Report};
use super::route::{self, Taken};
use crate::session::web::{Body, Hello, Request, Unusable, WebRefusal, challenge};
use crate::shell::key_file::system_random;

/// Serves a connection to its end. `verified` is called once its client has shown its key.
pub(super) async fn run(
    mut socket: WebSocket,
    (number, from): (u64, SocketAddr),
    vsm: Id,
    reports: mpsc::Sender<Report>,
    verified: impl FnOnce(),
) {
    let opened = timeout(
        HELLO_WITHIN,
        open(&mut socket, (number, from), vsm, &reports),
    );
    let why = match opened
        .await
        .unwrap_or(Err(Ended::Refused(WebRefusal::NoHello)))
    {
        Ok(admitted) => {
            verified();
            admitted.ends.begin();
            let ended = Connection::new((number, from), admitted, reports.clone())
                .serve(&mut socket)
                .await;
            let why = ended.refusal();
            let _ = reports.send(Report::Closed { number, why }).await;
            ended
        }
        Err(ended) => {
            if let Ended::Refused(why) = ended {
                let _ = reports.send(Report::Refused { from, why }).await;
            }
            ended
        }
    };
    if let Ended::Refused(why) | Ended::ByBridge(why) = why {
        let frame = CloseFrame {
            code: why.code(),
            reason: why.reason().into(),
        };
        // If a connection closes with unread data, the system resets it and the client never receives the reason.
        let _ = timeout(CLOSE_WITHIN, async {
            let _ = socket.send(Message::Close(Some(frame))).await;
            while let Some(Ok(_)) = socket.recv().await {}
        })
        .await;
    }
}

/// How a connection ends.
#[derive(Debug, Clone, Copy)]
enum Ended {
    /// The client has left.
    Left,
    /// This module refuses it, and the refusal is counted.
    Refused(WebRefusal),
    /// The bridge ends it and has already counted that.
    ByBridge(WebRefusal),
}

impl Ended {
    fn refusal(self) -> Option<WebRefusal> {
        match self {
            Ended::Refused(why) => Some(why),
            Ended::Left | Ended::ByBridge(_) => None,
        }
    }
}

/// Challenge, hello and welcome.
async fn open(
    socket: &mut WebSocket,
    (number, from): (u64, SocketAddr),
    vsm: Id,
    reports: &mpsc::Sender<Report>,
) -> Result<Admitted, Ended> {
    let mut of_vsm = [0; 32];
    system_random(&mut of_vsm).map_err(|_| Ended::Refused(WebRefusal::NoHello))?;
    send(socket, [challenge(vsm, &of_vsm)]).await?;
    let frame = loop {
        match receive(socket).await? {
            Received::Frame(frame) => break frame,
            Received::Other => {}
        }
    };
    // A frame that is not a hello is refused here: the bridge never receives it.
    Hello::parse(&frame, vsm, of_vsm).map_err(Ended::Refused)?;
    let (answer, answered) = oneshot::channel();
    let hello = Report::Hello {
        number,
        from,
        of_vsm,
        frame,
        answer,
    };
    let ends = Ended::ByBridge(WebRefusal::Ends);
    reports.send(hello).await.map_err(|_| ends)?;
    let admitted = answered.await.map_err(|_| ends)?;
    // A refusal by the bridge is already counted there.
    let admitted = admitted.map_err(Ended::ByBridge)?;
    send(socket, [admitted.welcome.clone()]).await?;
    Ok(admitted)
}

struct Connection {
    number: u64,
    from: SocketAddr,
    admitted: Admitted,
    reports: mpsc::Sender<Report>,
    opened: Instant,
    pings: Pings,
    /// A file of a route that is being read, and the number of its frame.
    import: Option<(u64, JoinHandle<Result<Taken, String>>)>,
    /// Messages of a route that have not gone to the bridge yet.
    route: VecDeque<Vec<u8>>,
}

impl Connection {
    fn new(
        (number, from): (u64, SocketAddr),
        admitted: Admitted,
        reports: mpsc::Sender<Report>,
    ) -> Connection {
        Connection {
            number,
            from,
            admitted,
            reports,
            opened: Instant::now(),
            pings: Pings::default(),
            import: None,
            route: VecDeque::new(),
        }
    }

    async fn serve(mut self, socket: &mut WebSocket) -> Ended {
        let mut pings = interval(PING_EVERY);
        pings.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut pace = interval(ROUTE_PACE);
        pace.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            let done = tokio::select! {
                received = receive(socket) => match received {
                    Ok(received) => self.take(socket, received).await,
                    Err(ended) => Err(ended),
                },
                Some(datagram) = self.admitted.ends.queue.recv() => self.pass(socket, &datagram).await,
                ended = &mut self.admitted.ends.ends => {
                    return Ended::ByBridge(ended.unwrap_or(WebRefusal::Ends));
                }
                taken = imported(&mut self.import) => self.answer_route(socket, taken).await,
                _ = pings.tick() => self.ping(socket).await,
                _ = pace.tick(), if !self.route.is_empty() => self.send_route().await,
            };
            if let Err(ended) = done {
                return ended;
            }
        }
    }

    /// A datagram of the bridge to the client.
    async fn pass(&mut self, socket: &mut WebSocket, datagram: &[u8]) -> Result<(), Ended> {
        let frames = self.admitted.end.seal_datagram(datagram);
        self.send(socket, frames).await
    }

    /// The bridge may end it meanwhile, such as for a full queue: a client that reads nothing is not waited for.
    async fn send(
        &mut self,
        socket: &mut WebSocket,
        frames: impl IntoIterator<Item = String>,
    ) -> Result<(), Ended> {
        tokio::select! {
            sent = timeout(SILENCE, send(socket, frames)) => {
                sent.unwrap_or(Err(Ended::Refused(WebRefusal::TooSlow)))
            }
            ended = &mut self.admitted.ends.ends => Err(Ended::ByBridge(ended.unwrap_or(WebRefusal::Ends))),
        }
    }

    async fn take(&mut self, socket: &mut WebSocket, received: Received) -> Result<(), Ended> {
        let frame = match received {
            Received::Frame(frame) => frame,
            Received::Other => {
                self.pings.answered();
                return Ok(());
            }
        };
        self.pings.received();
        let since = self.opened.elapsed();
        let opened = self.admitted.end.open(since, &frame);
        match opened.map_err(Ended::Refused)? {
            Ok((_, Request::Message(bytes))) => self.report(bytes).await,
            Ok((of, Request::Route(_))) if self.import.is_some() || !self.route.is_empty() => {
                let why = "route: the previous route is still being sent";
                self.answer_error(socket, of, why).await
            }
            Ok((of, Request::Route(file))) => {
                // On a thread of its own: whatever is in the file, no other client's messages and no heartbeat wait for it.
                let cucs = self.admitted.cucs;
                let read = spawn_blocking(move || route::datagrams(&file, cucs));
                self.import = Some((of, read));
                Ok(())
            }
            Err(Unusable { of, why }) => self.answer_error(socket, of, &why).await,
        }
    }

    async fn answer_route(
        &mut self,
        socket: &mut WebSocket,
        (of, taken): (u64, Result<Taken, String>),
    ) -> Result<(), Ended> {
        match taken {
            Ok(taken) => {
                let frame = self.admitted.end.seal(&Body::Route {
                    of,
                    messages: taken.datagrams.len(),
                    load: taken.load,
                    lost: &taken.lost,
                });
                self.route = taken.datagrams.into();
                self.send(socket, [frame]).await
            }
            Err(why) => self.answer_error(socket, of, &why).await,
        }
    }

    async fn answer_error(
        &mut self,
        socket: &mut WebSocket,
        of: u64,
        why: &str,
    ) -> Result<(), Ended> {
        let frame = self.admitted.end.seal(&Body::Error { of, why });
        self.send(socket, [frame]).await
    }

    async fn report(&mut self, bytes: Vec<u8>) -> Result<(), Ended> {
        let report = Report::Datagram {
            number: self.number,
            from: self.from,
            bytes,
        };
        let sent = self.reports.send(report).await;
        sent.map_err(|_| Ended::ByBridge(WebRefusal::Ends))
    }

    /// The next messages of a route: only as many as the station's rate limit allows, since others would be dropped.
    async fn send_route(&mut self) -> Result<(), Ended> {
        for _ in 0..ROUTE_BATCH {
            let Some(bytes) = self.route.pop_front() else {
                break;
            };
            self.report(bytes).await?;
        }
        Ok(())
    }

    async fn ping(&mut self, socket: &mut WebSocket) -> Result<(), Ended> {
        self.pings.sends().map_err(Ended::Refused)?;
        let ping = Message::Ping(bytes::Bytes::new());
        match timeout(SILENCE, socket.send(ping)).await {
            Ok(Ok(())) => Ok(()),
            Ok(Err(_)) => Err(Ended::Left),
            Err(_) => Err(Ended::Refused(WebRefusal::Dead)),
        }
    }
}

/// The pings that a client has not answered. Time says nothing of it: where the bridge itself was stopped, answers wait to be read.
#[derive(Debug, Default)]
struct Pings {
    unanswered: u32,
    /// Those since the client has sent anything.
    silent: u32,
}

impl Pings {
    /// One more is due.
    ///
    /// # Errors
    /// The client has left too many unanswered.
    fn sends(&mut self) -> Result<(), WebRefusal> {
        if self.unanswered >= MAX_UNANSWERED {
            // A client that sends but answers no ping is not reading.
            return Err(if self.silent < MAX_UNANSWERED {
                WebRefusal::TooSlow
            } else {
                WebRefusal::Dead
            });
        }
        self.unanswered += 1;
        self.silent += 1;
        Ok(())
    }

    fn received(&mut self) {
        self.silent = 0;
    }

    fn answered(&mut self) {
        *self = Pings::default();
    }
}

/// The end of a file's reading; without one this never ends. Cancelled by another branch of a `select!` it loses nothing.
async fn imported(
    import: &mut Option<(u64, JoinHandle<Result<Taken, String>>)>,
) -> (u64, Result<Taken, String>) {
    let Some((of, read)) = import else {
        return pending().await;
    };
    let of = *of;
    let taken = read.await;
    *import = None;
    (
        of,
        taken.unwrap_or_else(|cause| Err(format!("route: {cause}"))),
    )
}

enum Received {
    Frame(String),
    /// An answer to a ping, or a ping.
    Other,
}

async fn receive(socket: &mut WebSocket) -> Result<Received, Ended> {
    match socket.recv().await {
        Some(Ok(Message::Text(text))) => Ok(Received::Frame(text.as_str().to_owned())),
        Some(Ok(Message::Ping(_) | Message::Pong(_))) => Ok(Received::Other),
        Some(Ok(Message::Binary(_))) => Err(Ended::Refused(WebRefusal::Form)),
        Some(Ok(Message::Close(_))) | None => Err(Ended::Left),
        Some(Err(fault)) => Err(ended_by(fault)),
    }
}

/// A connection that breaks is no fault; what no WebSocket sends is.
fn ended_by(fault: axum::Error) -> Ended {
    use tungstenite::Error;
    match fault.into_inner().downcast_ref::<Error>() {
        Some(Error::Capacity(_)) => Ended::Refused(WebRefusal::TooLarge),
        Some(Error::Utf8(_)) => Ended::Refused(WebRefusal::Form),
        _ => Ended::Left,
    }
}

/// Frames that are there together go in one write.
async fn send(
    socket: &mut WebSocket,
    frames: impl IntoIterator<Item = String>,
) -> Result<(), Ended> {
    let sent = async {
        for frame in frames {
            socket.feed(Message::Text(frame.into())).await?;
        }
        socket.flush().await
    };
    sent.await.map_err(|_: axum::Error| Ended::Left)
}

const HELLO_WITHIN: Duration = Duration::from_secs(5);
const CLOSE_WITHIN: Duration = Duration::from_millis(500);
const PING_EVERY: Duration = Duration::from_secs(5);
/// Of so many pings without an answer a client is not there: 15 s.
const MAX_UNANSWERED: u32 = 3;
/// As long as this it may take nothing.
const SILENCE: Duration = Duration::from_secs(15);
/// Messages of a route go by so many at a time: 500 a second, half of what a station may send.
const ROUTE_BATCH: usize = 5;
const ROUTE_PACE: Duration = Duration::from_millis(10);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_client_has_ended_after_pings_that_it_left_unanswered() {
        let mut pings = Pings::default();
        for _ in 0..MAX_UNANSWERED {
            assert_eq!(pings.sends(), Ok(()));
        }
        assert_eq!(pings.sends(), Err(WebRefusal::Dead));
        pings.received();
        assert_eq!(pings.sends(), Err(WebRefusal::TooSlow), "it sends");
        // However long the bridge was stopped before this was read.
        pings.answered();
        assert_eq!(pings.sends(), Ok(()));
    }
}
