//! A station that is a web client: its messages are JSON in sealed frames, without a socket. The work of its
//! connection's thread in the shell is done here by the same state machine.

use std::net::SocketAddr;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::signing::SigningKey;
use mavlink_link::store::Disk;
use serde_json::{Value, json};
use stanag_msgs::Id;
use stanag_msgs::guard::{ConnectionKey, Direction, GuardKey, Opening, SealedText};
use vsm::session::Bridge;
use vsm::session::web::{Hello, Request, WebEnd, WebRefusal};

use super::parties::VSM;

/// An open connection: both its ends.
#[derive(Debug)]
pub struct WebParty {
    /// The number by which the bridge knows it.
    pub number: u64,
    key: ConnectionKey,
    next: u64,
    end: WebEnd,
    opened: Duration,
    /// Everything that the client has sent, sealed.
    pub sent: Vec<String>,
    /// Why its last frame was refused; the connection has ended then.
    pub refused: Option<WebRefusal>,
}

impl WebParty {
    /// Opens a connection; the random bytes of both ends are derived from `number`, which must be unique.
    ///
    /// # Errors
    /// The client's proof of its key is refused.
    pub fn open(
        bridge: &mut Bridge,
        now: Now,
        (number, from): (u64, SocketAddr),
        (cucs, key): (Id, &SigningKey),
        disk: &mut dyn Disk,
    ) -> Result<WebParty, WebRefusal> {
        let mut of_vsm = [0x5a; 32];
        of_vsm[..8].copy_from_slice(&number.to_be_bytes());
        let opening = Opening {
            vsm: VSM,
            cucs,
            of_vsm,
            of_client: of_vsm.map(|byte| !byte),
        };
        let key = GuardKey::new(key.expose()).connection(&opening);
        let random = crate::process::hex(&opening.of_client);
        let hello = json!({
            "n": 0, "hello": { "version": 1, "cucs": cucs.to_string(), "random": random }
        });
        let frame = key.seal(Direction::ToVsm, &hello.to_string());
        let hello = Hello::parse(&frame, VSM, of_vsm)?;
        let opened = bridge.open_web(now, (number, from), &hello, disk)?;
        let mut end = WebEnd::new(opened.key, cucs);
        let welcome = end.seal(&opened.welcome);
        let party = WebParty {
            number,
            key,
            next: 1,
            end,
            opened: now.mono,
            sent: vec![frame.clone()],
            refused: None,
        };
        let welcome = party.read(&welcome).expect("it verifies");
        assert_eq!(welcome["n"], 0, "{welcome}");
        Ok(party)
    }

    /// The messages of a datagram, one frame for each.
    pub fn frames(&mut self, datagram: &[u8]) -> Vec<String> {
        let messages = stanag_msgs::json::decode(datagram, false).into_iter();
        let frames = messages.map(|message| {
            let text = json!({ "n": self.next, "message": message }).to_string();
            self.next += 1;
            self.key.seal(Direction::ToVsm, &text)
        });
        let frames: Vec<String> = frames.collect();
        self.sent.extend(frames.iter().cloned());
        frames
    }

    /// Gives a frame to the bridge's end, and what that makes of it to the bridge.
    pub fn deliver(&mut self, bridge: &mut Bridge, now: Now, frame: &str, disk: &mut dyn Disk) {
        if self.refused.is_some() {
            return;
        }
        match self.end.open(now.mono.saturating_sub(self.opened), frame) {
            Ok(Ok((_, Request::Message(bytes)))) => {
                bridge.handle_web(now, self.number, &bytes, disk);
            }
            Ok(other) => panic!("{other:?}"),
            Err(why) => {
                self.refused = Some(why);
                bridge.close_web(now.mono, self.number, Some(why));
            }
        }
    }

    /// The datagrams that the client reads from a datagram of the bridge.
    pub fn receive(&mut self, datagram: &[u8]) -> Vec<Vec<u8>> {
        let frames = self.end.seal_datagram(datagram).into_iter();
        let each = frames.map(|frame| {
            let read = self.read(&frame).expect("it verifies");
            stanag_msgs::json::encode(&read["message"], false).expect("a message")
        });
        each.collect()
    }

    fn read(&self, frame: &str) -> Option<Value> {
        let sealed = SealedText::parse(frame)?;
        let verifies = self.key.verifies(Direction::ToCucs, &sealed);
        verifies.then(|| serde_json::from_str(sealed.text).expect("JSON"))
    }
}
