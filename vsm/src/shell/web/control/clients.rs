//! The bridge's side of the connections: what is for a client goes into its queue, and a full one ends its connection. Nothing here
//! waits.

use std::collections::BTreeMap;

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
}

impl Clients {
    /// One more: the other ends of what it is sent, and of what ends it.
    pub fn add(
        &mut self,
        number: u64,
    ) -> (mpsc::Receiver<Box<[u8]>>, oneshot::Receiver<WebRefusal>) {
        let (queue, queued) = mpsc::channel(QUEUE);
        let (ends, ended) = oneshot::channel();
        self.0.insert(number, Client { queue, ends });
        (queued, ended)
    }

    /// Puts a datagram into a client's queue.
    ///
    /// # Errors
    /// The queue is full: the client reads slower than it is sent messages, and is dropped.
    pub fn send(&mut self, number: u64, datagram: &[u8]) -> Result<(), WebRefusal> {
        let Some(client) = self.0.get(&number) else {
            return Ok(());
        };
        match client.queue.try_send(datagram.into()) {
            // Of one whose connection has ended that is reported too.
            Ok(()) | Err(TrySendError::Closed(_)) => Ok(()),
            Err(TrySendError::Full(_)) => {
                self.end(number, WebRefusal::TooSlow);
                Err(WebRefusal::TooSlow)
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
