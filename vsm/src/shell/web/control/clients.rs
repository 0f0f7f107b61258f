//! The bridge's side of the connections: what is for a client goes into its queue, and a full one ends its connection. Nothing here
//! waits.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use tokio::sync::mpsc::error::TrySendError;
use tokio::sync::{mpsc, oneshot};

use crate::session::web::WebRefusal;

/// The clients that are connected, by the numbers of their connections.
#[derive(Debug, Default)]
pub struct Clients(BTreeMap<u64, Client>);

#[derive(Debug)]
struct Client {
    queue: mpsc::Sender<Box<[u8]>>,
    ends: oneshot::Sender<WebRefusal>,
    /// Its connection serves it, and will report its own end. Before that it may end without a word: it makes room for another, or
    /// its client reads nothing.
    served: Arc<AtomicBool>,
}

/// The connection's ends of what the bridge keeps of it.
#[derive(Debug)]
pub struct ClientEnds {
    /// What the client is to be sent.
    pub queue: mpsc::Receiver<Box<[u8]>>,
    /// Ends it.
    pub ends: oneshot::Receiver<WebRefusal>,
    served: Arc<AtomicBool>,
}

impl ClientEnds {
    /// The client is served from here on, and the end of that will be reported.
    pub(super) fn begin(&self) {
        self.served.store(true, Ordering::Relaxed);
    }
}

impl Clients {
    /// One more.
    pub fn add(&mut self, number: u64) -> ClientEnds {
        let (queue, queued) = mpsc::channel(QUEUE);
        let (ends, ended) = oneshot::channel();
        let served = Arc::new(AtomicBool::default());
        let client = Client {
            queue,
            ends,
            served: served.clone(),
        };
        self.0.insert(number, client);
        ClientEnds {
            queue: queued,
            ends: ended,
            served,
        }
    }

    /// Puts a datagram into a client's queue.
    ///
    /// # Errors
    /// It is not connected any more: the queue was full, since the client reads slower than it is sent messages, and it is dropped
    /// for that; or, with no reason, its connection ended before it was served.
    pub fn send(&mut self, number: u64, datagram: &[u8]) -> Result<(), Option<WebRefusal>> {
        let Some(client) = self.0.get(&number) else {
            return Ok(());
        };
        match client.queue.try_send(datagram.into()) {
            Ok(()) => Ok(()),
            Err(TrySendError::Closed(_)) if client.served.load(Ordering::Relaxed) => Ok(()),
            Err(TrySendError::Closed(_)) => {
                self.remove(number);
                Err(None)
            }
            Err(TrySendError::Full(_)) => {
                self.end(number, WebRefusal::TooSlow);
                Err(Some(WebRefusal::TooSlow))
            }
        }
    }

    /// Ends a connection.
    pub fn end(&mut self, number: u64, why: WebRefusal) {
        if let Some(client) = self.0.remove(&number) {
            let _ = client.ends.send(why);
        }
    }

    /// Ends all connections.
    pub fn end_all(&mut self, why: WebRefusal) {
        for client in std::mem::take(&mut self.0).into_values() {
            let _ = client.ends.send(why);
        }
    }

    /// It has ended.
    pub fn remove(&mut self, number: u64) {
        self.0.remove(&number);
    }
}

/// Four seconds of the most that a station is sent (`dli.max_messages_s`), which is what may come at once.
const QUEUE: usize = 4_096;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_connection_that_ends_before_it_is_served_is_noticed_and_a_served_one_reports_itself() {
        let mut clients = Clients::default();
        drop(clients.add(1));
        assert_eq!(clients.send(1, b"status"), Err(None));
        assert_eq!(clients.send(1, b"status"), Ok(()), "it is known to be gone");
        let served = clients.add(2);
        served.begin();
        assert_eq!(clients.send(2, b"status"), Ok(()));
        drop(served);
        // Its report, with the reason, is on its way.
        assert_eq!(clients.send(2, b"status"), Ok(()));
    }
}
