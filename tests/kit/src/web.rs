//! A web client as a script would be one: the WebSocket of docs/guide/websocket.md, frame by frame, for correct and
//! misbehaving clients.

use std::io;
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use stanag_msgs::guard::{ConnectionKey, Direction, GuardKey, Opening, SealedText};
use stanag_msgs::{Id, TimeStamp};
use tungstenite::handshake::HandshakeError;
use tungstenite::{ClientRequestBuilder, Error, Message, WebSocket};

use crate::clock::wall;

/// A client whose connection is open.
#[derive(Debug)]
pub struct WebClient {
    socket: WebSocket<TcpStream>,
    key: ConnectionKey,
    next: u64,
    expected: u64,
    stamp: u64,
    beat: Instant,
    /// The station in whose name it is connected.
    pub cucs: Id,
    /// VSM ID.
    pub vsm: Id,
    /// Everything that it has sent, sealed.
    pub sent: Vec<String>,
}

/// How a connection was refused, or ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Refused {
    /// By an HTTP status: it did not become a WebSocket.
    Http(u16),
    /// By a close frame with this code.
    Closed(u16),
    /// Closed without a close frame.
    Dropped,
}

impl WebClient {
    /// Opens a connection in the name of a station, with its key or a wrong one.
    ///
    /// # Errors
    /// It is refused.
    pub fn connect(page: SocketAddr, cucs: Id, key: &[u8; 32]) -> Result<WebClient, Refused> {
        let mut socket = open(page, None)?;
        let (vsm, of_vsm) = challenge(&mut socket)?;
        let opening = Opening {
            vsm,
            cucs,
            of_vsm,
            of_client: crate::Random::new().u64(..).to_be_bytes().repeat(4)[..]
                .try_into()
                .expect("32 bytes"),
        };
        let mut client = WebClient {
            socket,
            key: GuardKey::new(key).connection(&opening),
            next: 0,
            expected: 0,
            stamp: now_stamp(),
            beat: Instant::now(),
            cucs,
            vsm,
            sent: Vec::new(),
        };
        let random = crate::process::hex(&opening.of_client);
        client.send(json!({
            "hello": { "version": 1, "cucs": cucs.to_string(), "random": random }
        }));
        let welcome = client.receive(Duration::from_secs(10))?;
        let welcome = welcome.expect("an answer within 10 s");
        assert!(welcome["welcome"].is_object(), "{welcome}");
        Ok(client)
    }

    /// Seals and sends a frame with the next number.
    pub fn send(&mut self, body: Value) {
        let number = self.next;
        self.send_numbered(number, body);
    }

    /// Seals and sends a frame with this number, whatever the next number is.
    pub fn send_numbered(&mut self, number: u64, mut body: Value) {
        body["n"] = number.into();
        self.next = number + 1;
        let frame = self.key.seal(Direction::ToVsm, &body.to_string());
        self.send_raw(frame);
    }

    /// Sends a frame unchanged.
    pub fn send_raw(&mut self, frame: impl Into<String>) {
        let frame = frame.into();
        self.sent.push(frame.clone());
        // Where the connection was closed meanwhile, the next read reports it.
        let _ = self.socket.send(Message::Text(frame.into()));
    }

    /// Sends a binary frame, which is not text.
    pub fn send_binary(&mut self) {
        let _ = self.socket.send(Message::Binary(vec![1, 2, 3].into()));
    }

    /// Sends a message of the DLI, stamped now; returns its stamp.
    pub fn message(&mut self, id: u16, destination: Id, mut fields: Value) -> u64 {
        self.stamp = now_stamp().max(self.stamp + 1);
        fields["Time Stamp"] = self.stamp.into();
        let ack = id != 16002;
        self.send(json!({
            "message": { "id": id, "destination": destination.to_string(), "ack": ack, "fields": fields }
        }));
        self.stamp
    }

    /// The next frame of the VSM, which has to verify; `None` where none comes in time.
    ///
    /// # Errors
    /// The connection has ended.
    pub fn receive(&mut self, within: Duration) -> Result<Option<Value>, Refused> {
        let end = Instant::now() + within;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            let stream = self.socket.get_ref();
            let _ = stream.set_read_timeout(Some(left));
            let text = match self.socket.read() {
                Ok(Message::Text(text)) => text,
                Ok(Message::Close(Some(frame))) => return Err(Refused::Closed(frame.code.into())),
                Ok(_) => continue,
                Err(Error::Io(fault)) if is_time_out(&fault) => return Ok(None),
                Err(_) => return Err(Refused::Dropped),
            };
            let sealed = SealedText::parse(text.as_str()).expect("a frame with an HMAC");
            assert!(
                self.key.verifies(Direction::ToCucs, &sealed),
                "the VSM has the key"
            );
            let frame: Value = serde_json::from_str(sealed.text).expect("JSON");
            assert_eq!(frame["n"].as_u64(), Some(self.expected), "{frame}");
            self.expected += 1;
            return Ok(Some(frame));
        }
    }

    /// Reads and discards everything that has arrived; returns the number of frames.
    pub fn drain(&mut self) -> usize {
        let _ = self.socket.get_ref().set_nonblocking(true);
        let mut read = 0;
        while self.socket.read().is_ok() {
            read += 1;
        }
        let _ = self.socket.get_ref().set_nonblocking(false);
        read
    }

    /// The first frame that is accepted; sends a heartbeat each second meanwhile.
    ///
    /// # Panics
    /// None comes in time.
    pub fn wait(&mut self, what: &str, within: Duration, accept: impl Fn(&Value) -> bool) -> Value {
        let end = Instant::now() + within;
        let mut last = Value::Null;
        while Instant::now() < end {
            self.keep();
            match self.receive(Duration::from_millis(200)) {
                Ok(Some(frame)) if accept(&frame) => return frame,
                Ok(Some(frame)) => last = frame,
                Ok(None) => {}
                Err(ended) => panic!("{what}: {ended:?} after {last}"),
            }
        }
        panic!("{what}: not seen within {within:?}, last {last}");
    }

    /// Sends a heartbeat where one is due.
    pub fn keep(&mut self) {
        if self.beat <= Instant::now() {
            self.beat = Instant::now() + Duration::from_secs(1);
            self.message(16002, self.vsm, json!({}));
        }
    }

    /// Waits for the answer (17000) that ends a command: "carried out" or "refused".
    pub fn answer(&mut self, stamp: u64, within: Duration) -> String {
        let answer = self.wait("the answer to a command", within, |frame| {
            let (message, fields) = (&frame["message"], &frame["message"]["fields"]);
            message["id"] == 17000
                && fields["Original Message Time Stamp"].as_u64() == Some(stamp)
                && ["carried out", "refused"]
                    .contains(&fields["Acknowledgement Type"].as_str().unwrap_or(""))
        });
        let end = &answer["message"]["fields"]["Acknowledgement Type"];
        end.as_str().expect("a text").to_owned()
    }

    /// Requests LOI 4 and 5, and waits until they are granted.
    pub fn take(&mut self, vehicle: Id) {
        self.message(1, vehicle, request_control());
        self.wait("control", Duration::from_secs(20), |frame| {
            let granted = &frame["message"]["fields"]["LOI Granted"];
            frame["message"]["id"] == 2 && granted.to_string().contains("LOI 5")
        });
    }

    /// How the connection ends, where it does within this time.
    pub fn ended(&mut self, within: Duration) -> Option<Refused> {
        let end = Instant::now() + within;
        while Instant::now() < end {
            match self.receive(Duration::from_millis(100)) {
                Ok(_) => {}
                Err(ended) => return Some(ended),
            }
        }
        None
    }
}

/// A message 1 that requests LOI 4 and 5.
#[must_use]
pub fn request_control() -> Value {
    json!({
        "Requested/Handover LOI": ["LOI 4", "LOI 5"],
        "Requested/Handover Access": "request control",
    })
}

/// Opens the WebSocket only, with this Origin.
///
/// # Errors
/// It is refused.
pub fn open(page: SocketAddr, origin: Option<&str>) -> Result<WebSocket<TcpStream>, Refused> {
    let stream = TcpStream::connect(page).map_err(|_| Refused::Dropped)?;
    let _ = stream.set_read_timeout(Some(Duration::from_secs(10)));
    let uri = format!("ws://{page}/control")
        .parse()
        .expect("a good address");
    let mut request = ClientRequestBuilder::new(uri);
    if let Some(origin) = origin {
        request = request.with_header("Origin", origin);
    }
    match tungstenite::client(request, stream) {
        Ok((socket, _)) => Ok(socket),
        Err(HandshakeError::Failure(Error::Http(answer))) => {
            Err(Refused::Http(answer.status().as_u16()))
        }
        Err(_) => Err(Refused::Dropped),
    }
}

/// The VSM ID and the random bytes of the challenge.
///
/// # Errors
/// The connection has ended.
pub fn challenge(socket: &mut WebSocket<TcpStream>) -> Result<(Id, [u8; 32]), Refused> {
    let Ok(Message::Text(text)) = socket.read() else {
        return Err(Refused::Dropped);
    };
    let frame: Value = serde_json::from_str(text.as_str()).expect("JSON");
    let opening = &frame["challenge"];
    assert_eq!(opening["version"], 1, "{frame}");
    let text = |key: &str| opening[key].as_str().expect("a text").to_owned();
    let random = crate::process::from_hex(&text("random"));
    let vsm = text("vsm").parse().expect("an id");
    Ok((vsm, random.try_into().expect("32 bytes")))
}

fn is_time_out(fault: &io::Error) -> bool {
    matches!(
        fault.kind(),
        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut
    )
}

fn now_stamp() -> u64 {
    TimeStamp::from_unix_ms(wall().as_millis() as u64).0
}
