//! What an end of an encrypted link is given at its start.

use core::time::Duration;

use super::exchange::Role;
use crate::exchange::{Identity, Parties, PublicKey};

/// What carries the frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Carrier {
    /// A serial line: bytes in order, some lost or changed; a frame may arrive in pieces.
    Stream,
    /// UDP: each datagram stands alone, and may be lost, doubled or late.
    Datagrams,
}

/// The settings of one end.
#[derive(Debug)]
pub struct EncryptedConfig<A> {
    /// Which end.
    pub role: Role,
    /// Both ends' ids; the policy is the link's own.
    pub parties: Parties,
    /// This end's static key.
    pub identity: Identity,
    /// The other end's, where they are paired.
    pub peer: Option<PublicKey>,
    /// What carries the frames.
    pub carrier: Carrier,
    /// Where the other end is, where that is known before it has sent anything.
    pub at: Option<A>,
    /// Otherwise where an earlier process has found it: what
    /// [`found_at`](super::EncryptedLink::found_at) returned last.
    pub before: Option<A>,
    /// How long bytes may wait for a packet to be full; zero for an end that sends commands.
    pub linger: Duration,
}
