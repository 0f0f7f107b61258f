//! Packing several messages into one datagram, as the standard allows.

use crate::error::EncodeError;
use crate::table::Message;
use crate::wrapper::{Envelope, MAX_DATAGRAM};

/// Packs messages into datagrams of at most [`MAX_DATAGRAM`] bytes, in their order.
///
/// ```
/// use stanag_msgs::{Envelope, Id, Message, Packer, TimeStamp, messages::Heartbeat};
///
/// let envelope = Envelope::new(Id(0x1b00_0101), Id::BROADCAST);
/// let beat = Message::from(Heartbeat { time_stamp: Some(TimeStamp(1)) });
/// let mut sent = Vec::new();
/// let mut packer = Packer::new();
/// for _ in 0..30 {
///     packer.push(&envelope, &beat, |datagram| sent.push(datagram.len()))?;
/// }
/// packer.flush(|datagram| sent.push(datagram.len()));
/// assert_eq!(sent, [24 * 22, 6 * 22]);
/// # Ok::<(), stanag_msgs::EncodeError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Packer {
    datagram: [u8; MAX_DATAGRAM],
    length: usize,
}

impl Packer {
    /// An empty packer.
    pub const fn new() -> Self {
        Self {
            datagram: [0; MAX_DATAGRAM],
            length: 0,
        }
    }

    /// Adds a message. If it does not fit after those before it, they are sent first.
    ///
    /// # Errors
    /// The message cannot be written; then nothing is sent or changed.
    pub fn push(
        &mut self,
        envelope: &Envelope,
        message: &Message,
        send: impl FnOnce(&[u8]),
    ) -> Result<(), EncodeError> {
        match message.encode(envelope, &mut self.datagram[self.length..]) {
            Ok(bytes) => {
                self.length += bytes;
                Ok(())
            }
            Err(EncodeError::BufferTooSmall { .. }) if self.length > 0 => {
                // Written separately first, so that a message that fits no datagram does not flush the others.
                let mut alone = [0; MAX_DATAGRAM];
                let bytes = message.encode(envelope, &mut alone)?;
                self.flush(send);
                self.datagram = alone;
                self.length = bytes;
                Ok(())
            }
            Err(error) => Err(error),
        }
    }

    /// Sends the remaining messages, if there are any.
    pub fn flush(&mut self, send: impl FnOnce(&[u8])) {
        if self.length > 0 {
            send(&self.datagram[..self.length]);
            self.length = 0;
        }
    }

    /// Whether nothing is waiting to be sent.
    pub const fn is_empty(&self) -> bool {
        self.length == 0
    }
}

impl Default for Packer {
    fn default() -> Self {
        Self::new()
    }
}
