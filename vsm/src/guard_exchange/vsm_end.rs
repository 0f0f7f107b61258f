//! The VSM's end: it answers the guards of its CUCSs, and opens a window for one of them where a person asks for it.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::time::Duration;

use mavlink_link::exchange::{
    Identity, Ignored, Inbound, PairingCode, PublicKey, Random, Responder, ResponderConfig,
    ResponderEvent, ResponderMemory, ResponderStore, StoreError, WindowError,
};
use mavlink_link::signing::KeyId;
use stanag_msgs::Id;
use stanag_msgs::guard::{Direction, ExchangeDatagram};

use super::{WANTED, datagram, parties};

/// What has happened.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum VsmNews {
    /// A key is agreed about and on the disk: it is in force from now on.
    Agreed(KeyId),
    /// The guard has proved to know the code; the window is closed.
    Paired(PublicKey),
    /// Somebody did not know it.
    WrongCode,
    /// The window has closed without a pairing.
    Closed,
    /// The guard speaks another version.
    OtherVersion(u8),
    /// The disk failed; nothing was answered.
    NotStored(StoreError),
}

/// The machine.
#[derive(Debug)]
pub struct VsmEnd {
    vsm: Id,
    identity: Identity,
    ends: Vec<(Id, Responder<SocketAddr>)>,
    out: VecDeque<(SocketAddr, Vec<u8>)>,
    news: VecDeque<(Id, VsmNews)>,
}

impl VsmEnd {
    /// An end that answers nobody yet.
    #[must_use]
    pub fn new(vsm: Id, identity: Identity) -> VsmEnd {
        VsmEnd {
            vsm,
            identity,
            ends: Vec::new(),
            out: VecDeque::new(),
            news: VecDeque::new(),
        }
    }

    /// What the people at both ends compare.
    #[must_use]
    pub fn own_key(&self) -> PublicKey {
        self.identity.public()
    }

    /// The guard that a CUCS is paired with, as it is on the disk; what is known already stays as it is, with its window.
    pub fn set(&mut self, cucs: Id, memory: ResponderMemory, now: Duration) {
        let same = |one: &Responder<SocketAddr>| {
            one.memory().peer.map(|peer| peer.key) == memory.peer.map(|peer| peer.key)
        };
        match self.ends.iter().position(|(id, _)| *id == cucs) {
            Some(place) if same(&self.ends[place].1) => {}
            // Its pairing was ended: who knows nothing but the old static key gets no further.
            Some(place) => self.ends[place].1 = self.end(cucs, memory, now),
            None => {
                let end = self.end(cucs, memory, now);
                self.ends.push((cucs, end));
            }
        }
    }

    fn end(&self, cucs: Id, memory: ResponderMemory, now: Duration) -> Responder<SocketAddr> {
        let config = ResponderConfig {
            parties: parties(self.vsm, cucs),
            identity: self.identity.duplicate(),
            wanted: WANTED,
        };
        Responder::new(config, memory, now)
    }

    /// Forgets those that are none of these.
    pub fn retain(&mut self, listed: impl Fn(Id) -> bool) {
        self.ends.retain(|(id, _)| listed(*id));
    }

    fn of(&mut self, cucs: Id) -> Option<&mut Responder<SocketAddr>> {
        let mut ends = self.ends.iter_mut();
        ends.find(|(id, _)| *id == cucs).map(|(_, end)| end)
    }

    /// The guard of a CUCS, where it is paired.
    #[must_use]
    pub fn peer(&self, cucs: Id) -> Option<PublicKey> {
        let (_, end) = self.ends.iter().find(|(id, _)| *id == cucs)?;
        end.memory().peer.map(|peer| peer.key)
    }

    /// Opens the window of a CUCS for one pairing, for 10 minutes. Only a person at this computer may cause it.
    ///
    /// # Errors
    /// The CUCS is not known, or another window is open.
    pub fn open_window(
        &mut self,
        now: Duration,
        cucs: Id,
        code: &PairingCode,
        store: &mut dyn ResponderStore,
    ) -> Result<(), OpenError> {
        let mut ends = self.ends.iter();
        if let Some((other, _)) = ends.find(|(_, end)| end.window(now).is_some()) {
            return Err(OpenError::Open(*other));
        }
        let end = self.of(cucs).ok_or(OpenError::Unknown(cucs))?;
        Ok(end.open_window(now, code, store)?)
    }

    /// Closes it.
    pub fn close_window(&mut self) {
        self.ends.iter_mut().for_each(|(_, end)| end.close_window());
    }

    /// The datagram that asks a paired guard to agree about another key; at most one in 10 s. It counts only where it arrives sealed
    /// under the key in force.
    pub fn please(&mut self, now: Duration, cucs: Id) -> Option<Vec<u8>> {
        let vsm = self.vsm;
        let message = self.of(cucs)?.please(now)?;
        Some(datagram(Direction::ToCucs, cucs, vsm, &message))
    }

    /// Takes what has arrived. `store`: of the CUCS that it names.
    ///
    /// # Errors
    /// Why it was ignored.
    pub fn handle(
        &mut self,
        now: Duration,
        from: SocketAddr,
        step: &ExchangeDatagram<'_>,
        random: &mut dyn Random,
        store: &mut dyn ResponderStore,
    ) -> Result<(), Ignored> {
        let (vsm, cucs) = (self.vsm, step.cucs);
        if step.direction != Direction::ToVsm {
            return Err(Ignored::Reflected);
        }
        if step.vsm != vsm {
            return Err(Ignored::Target);
        }
        let Some(end) = self.of(cucs) else {
            return Err(Ignored::Source);
        };
        let inbound = Inbound {
            from,
            source: parties(vsm, cucs).initiator,
            verified: false,
            payload: step.payload,
        };
        let taken = end.handle(now, inbound, random, store);
        self.settle(cucs);
        taken
    }

    /// What follows from it: answers and news. A key is in force here as soon as it is stored.
    fn settle(&mut self, cucs: Id) {
        let vsm = self.vsm;
        let Some(end) = self.of(cucs) else { return };
        let (mut news, mut out) = (Vec::new(), Vec::new());
        while let Some(event) = end.poll_event() {
            news.push(match event {
                ResponderEvent::Staged { key, .. } => {
                    end.key_active();
                    VsmNews::Agreed(key)
                }
                ResponderEvent::Paired { peer } => VsmNews::Paired(peer),
                ResponderEvent::WindowClosed => VsmNews::Closed,
                ResponderEvent::WrongCode => VsmNews::WrongCode,
                ResponderEvent::OtherVersion { version, .. } => VsmNews::OtherVersion(version),
                ResponderEvent::NotStored(cause) => VsmNews::NotStored(cause),
                // No key waits here for anything.
                ResponderEvent::Withdrawn => continue,
                // A zeroize of the whole VSM is 50024, under the rules of the authority: no pairing gives a right to it.
                ResponderEvent::Zeroize { .. } => continue,
            });
        }
        while let Some(answer) = end.poll_transmit() {
            let bytes = datagram(Direction::ToCucs, cucs, vsm, &answer.message);
            out.push((answer.to, bytes));
        }
        self.out.extend(out);
        self.news.extend(news.into_iter().map(|one| (cucs, one)));
        // Strangers cause some of these.
        while self.news.len() > MAX_NEWS {
            self.news.pop_front();
        }
    }

    /// Drops what has expired.
    pub fn handle_timeout(&mut self, now: Duration) {
        let ids: Vec<Id> = self.ends.iter().map(|(id, _)| *id).collect();
        for id in ids {
            if let Some(end) = self.of(id) {
                end.handle_timeout(now);
            }
            self.settle(id);
        }
    }

    /// When [`handle_timeout`](Self::handle_timeout) is next needed.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Duration> {
        let ends = self.ends.iter();
        ends.filter_map(|(_, end)| end.poll_timeout()).min()
    }

    /// The next datagram to send, and where it goes.
    pub fn poll_transmit(&mut self) -> Option<(SocketAddr, Vec<u8>)> {
        self.out.pop_front()
    }

    /// What has happened since the last call, and of which CUCS.
    pub fn poll_news(&mut self) -> Option<(Id, VsmNews)> {
        self.news.pop_front()
    }
}

/// Why a window cannot be opened.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum OpenError {
    /// It is in no `[[cucs]]`.
    #[error(
        "CUCS {0} is in no [[cucs]] of the running configuration: add it with the levels that it may hold, and `vsm reload`"
    )]
    Unknown(Id),
    /// One at a time.
    #[error("the window for CUCS {0} is open: end that `vsm guard pair` first, or let it succeed")]
    Open(Id),
    /// The machine or the disk.
    #[error(transparent)]
    Window(#[from] WindowError),
}

const MAX_NEWS: usize = 64;
