//! One connection of a web client: which of its frames are accepted, and how messages are sent to it. The contract is
//! docs/guide/websocket.md.
//!
//! - [`Hello`] is what a client opens with. Whose it is, and whether it verifies, is the bridge's to say, which has the guard
//!   keys (`bridge::web`).
//! - [`WebEnd`] is this end from then on: it verifies a frame before anything of it is read, counts, and writes frames. It belongs to the
//!   connection, so that what does not verify costs the bridge nothing.
//! - [`Request`] (in `request`) is what a client wants: a message of the DLI as the datagram that it would have sent, or a route.
//! - `link` is what the bridge knows of a connection; [`WebRefusal`] names every way to be refused.
//!
//! Nothing of this has a stamp on disk, as the guard of datagrams has: the keys of a connection are made of random bytes of both
//! ends, so that nothing which was recorded verifies again, after a restart or a crash either.

mod link;
mod refusal;
mod request;

use std::time::Duration;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use stanag_msgs::Id;
use stanag_msgs::guard::{ConnectionKey, Direction, GuardKey, Opening, SealedText};

pub(crate) use self::link::WebLink;
pub use self::link::WebStatus;
pub use self::refusal::WebRefusal;
pub use self::request::{Request, RouteFile, Unusable};
use super::allowance::Allowance;
use super::limits::WEB_FRAMES;

/// The first frame of a client.
#[derive(Debug)]
pub struct Hello<'a> {
    opening: Opening,
    sealed: SealedText<'a>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct HelloFrame {
    n: u64,
    hello: HelloBody,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct HelloBody {
    version: u32,
    cucs: String,
    random: Hex,
}

impl<'a> Hello<'a> {
    /// Reads it. `of_vsm`: the random bytes that the client was sent.
    ///
    /// # Errors
    /// It is none, or of another version.
    pub fn parse(frame: &'a str, vsm: Id, of_vsm: [u8; 32]) -> Result<Hello<'a>, WebRefusal> {
        if frame.len() > MAX_HELLO {
            return Err(WebRefusal::TooLarge);
        }
        let sealed = SealedText::parse(frame).ok_or(WebRefusal::Form)?;
        let read: HelloFrame = serde_json::from_str(sealed.text).map_err(|_| WebRefusal::Form)?;
        let HelloFrame { n: 0, hello } = read else {
            return Err(WebRefusal::Counter);
        };
        if hello.version != VERSION {
            return Err(WebRefusal::Form);
        }
        let cucs = hello.cucs.parse().map_err(|_| WebRefusal::Form)?;
        let opening = Opening {
            vsm,
            cucs,
            of_vsm,
            of_client: hello.random.0,
        };
        Ok(Hello { opening, sealed })
    }

    /// In whose name.
    #[must_use]
    pub fn cucs(&self) -> Id {
        self.opening.cucs
    }

    /// The keys of the connection, where the client has this key.
    pub(crate) fn verify(&self, key: &GuardKey) -> Option<ConnectionKey> {
        let key = key.connection(&self.opening);
        key.verifies(Direction::ToVsm, &self.sealed).then_some(key)
    }
}

/// What the VSM sends first of all: JSON without an HMAC, since there is no key yet.
#[must_use]
pub fn challenge(vsm: Id, of_vsm: &[u8; 32]) -> String {
    let body = serde_json::json!({
        "challenge": { "version": VERSION, "vsm": vsm.to_string(), "random": Hex(*of_vsm) }
    });
    body.to_string()
}

/// This end of a connection that has verified.
#[derive(Debug)]
pub struct WebEnd {
    key: ConnectionKey,
    cucs: Id,
    /// The number of the next frame of the client, and of the next one to it.
    next: u64,
    number: u64,
    /// Of the frames of the client.
    allowance: Allowance,
}

/// What a client is sent.
#[derive(Debug, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Body<'a> {
    /// Its key has verified, and this is ours.
    Welcome {
        /// VSM ID.
        vsm: String,
        /// CUCS ID.
        cucs: String,
        /// Of the guard key.
        key_id: String,
        /// Levels that it may hold by the configuration.
        loi: Vec<u8>,
    },
    /// A message of the DLI.
    Message(Value),
    /// A route that was taken.
    Route {
        /// The number of its frame.
        of: u64,
        /// How many messages it became.
        messages: usize,
        /// The Time Stamp of the last of them, the 13000.
        load: u64,
        /// What of the file is not in them.
        lost: &'a [String],
    },
    /// A frame that could not be used.
    Error {
        /// Its number.
        of: u64,
        /// What was found, and what was expected.
        why: &'a str,
    },
}

#[derive(Serialize)]
struct Numbered<'a> {
    n: u64,
    #[serde(flatten)]
    body: &'a Body<'a>,
}

impl WebEnd {
    /// Of the connection of a client whose hello has verified.
    #[must_use]
    pub fn new(key: ConnectionKey, cucs: Id) -> WebEnd {
        WebEnd {
            key,
            cucs,
            next: 1,
            number: 0,
            allowance: Allowance::default(),
        }
    }

    /// What a frame asks for: nothing of it is read before it has verified, and it counts once. `now`: by a monotonic clock.
    ///
    /// # Errors
    /// The frame is not accepted, and the connection ends. The inner error is for an accepted frame that cannot be used:
    /// that is answered.
    pub fn open(
        &mut self,
        now: Duration,
        frame: &str,
    ) -> Result<Result<(u64, Request), Unusable>, WebRefusal> {
        if !self.allowance.take(now, WEB_FRAMES) {
            return Err(WebRefusal::Flood);
        }
        if frame.len() > MAX_FRAME {
            return Err(WebRefusal::TooLarge);
        }
        let sealed = SealedText::parse(frame).ok_or(WebRefusal::Form)?;
        if !self.key.verifies(Direction::ToVsm, &sealed) {
            return Err(WebRefusal::Mac);
        }
        let value: Value = serde_json::from_str(sealed.text).map_err(|_| WebRefusal::Form)?;
        if value["n"].as_u64() != Some(self.next) {
            return Err(WebRefusal::Counter);
        }
        let number = self.next;
        self.next += 1;
        let request = Request::read(&value, self.cucs);
        Ok(request
            .map(|request| (number, request))
            .map_err(|why| Unusable { of: number, why }))
    }

    /// The next frame to the client.
    #[must_use]
    pub fn seal(&mut self, body: &Body<'_>) -> String {
        let numbered = Numbered {
            n: self.number,
            body,
        };
        self.number += 1;
        // Nothing here has a key that is no text, or a number that is not finite.
        let text = serde_json::to_string(&numbered).unwrap_or_default();
        self.key.seal(Direction::ToCucs, &text)
    }

    /// The messages of a datagram for this client, a frame each.
    pub fn seal_datagram(&mut self, datagram: &[u8]) -> Vec<String> {
        let messages = stanag_msgs::json::decode(datagram, false).into_iter();
        messages
            .map(|message| self.seal(&Body::Message(message)))
            .collect()
    }
}

/// 32 bytes as lower-case hex digits.
struct Hex([u8; 32]);

impl Serialize for Hex {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let digits = self.0.iter().map(|byte| format!("{byte:02x}"));
        serializer.serialize_str(&digits.collect::<String>())
    }
}

impl<'de> Deserialize<'de> for Hex {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Hex, D::Error> {
        let text = String::deserialize(deserializer)?;
        // A frame's digits are read as these are.
        let sealed = format!("{text} ");
        let read = SealedText::parse(&sealed).filter(|read| read.text.is_empty());
        read.map(|read| Hex(*read.mac()))
            .ok_or_else(|| serde::de::Error::custom("expected 64 lower-case hex digits"))
    }
}

/// Of the protocol.
const VERSION: u32 = 1;
/// The longest first frame: it has some 200 bytes.
pub const MAX_HELLO: usize = 1_024;
/// The longest frame: a route as a file of text.
pub const MAX_FRAME: usize = 262_144;

#[cfg(test)]
mod tests;
