//! The CUCS as a web client: the datagrams of its station are sent as frames of the page's WebSocket, and received frames
//! become datagrams; and an attacker who opens that WebSocket in its name without its key.

use std::cell::Cell;
use std::io;
use std::net::{SocketAddr, TcpStream, UdpSocket};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use anyhow::{Context as _, anyhow, bail};
use serde_json::{Value, json};
use stanag_msgs::guard::{ConnectionKey, Direction, GuardKey, Opening, SealedText};
use stanag_msgs::{Id, MAX_DATAGRAM};
use tungstenite::{ClientRequestBuilder, Error, Message, WebSocket};

use crate::shell::key_file;

/// The station's end of a WebSocket, as long as it lives.
pub(super) struct WebClient {
    /// Where the station sends to, in place of the VSM.
    pub(super) near: SocketAddr,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<anyhow::Result<()>>>,
}

impl WebClient {
    /// Opens a connection in the name of this CUCS, under its key.
    pub(super) fn open(page: SocketAddr, cucs: Id, key: &Path) -> anyhow::Result<WebClient> {
        let key = GuardKey::new(key_file::read(key)?.expose());
        let (mut socket, opening, answer) = greet(page, cucs, &key)?;
        let welcome = answer.context("the connection was refused")?;
        anyhow::ensure!(welcome.contains("\"welcome\""), "no welcome: {welcome}");
        let udp = UdpSocket::bind("127.0.0.1:0")?;
        let near = udp.local_addr()?;
        udp.set_read_timeout(Some(LOOK))?;
        socket.get_mut().set_read_timeout(Some(LOOK))?;
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = stop.clone();
        let key = key.connection(&opening);
        let carry = move || carry(&mut socket, &key, &udp, &stopped);
        Ok(WebClient {
            near,
            stop,
            thread: Some(thread::spawn(carry)),
        })
    }

    /// Ends it; why it has ended before.
    pub(super) fn end(mut self) -> anyhow::Result<()> {
        self.stop.store(true, Ordering::SeqCst);
        let thread = self.thread.take().context("it has ended")?;
        let ended = thread.join();
        ended.map_err(|_| anyhow!("the web client has panicked"))?
    }
}

impl Drop for WebClient {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::SeqCst);
    }
}

/// Challenge, hello, and what is answered to it: a frame, or that the connection ends.
fn greet(
    page: SocketAddr,
    cucs: Id,
    key: &GuardKey,
) -> anyhow::Result<(WebSocket<TcpStream>, Opening, Option<String>)> {
    let stream = TcpStream::connect(page)?;
    stream.set_read_timeout(Some(ANSWER_WITHIN))?;
    let request = ClientRequestBuilder::new(format!("ws://{page}/control").parse()?);
    let (mut socket, _) = tungstenite::client(request, stream)
        .map_err(|fault| anyhow!("the page opens no WebSocket: {fault}"))?;
    let challenge: Value = serde_json::from_str(socket.read()?.to_text()?)?;
    let challenge = &challenge["challenge"];
    let text = |key: &str| challenge[key].as_str().context("no challenge");
    let mut of_client = [0; 32];
    key_file::system_random(&mut of_client).map_err(|fault| anyhow!("{fault}"))?;
    let opening = Opening {
        vsm: text("vsm")?.parse()?,
        cucs,
        of_vsm: bytes(text("random")?).context("no challenge")?,
        of_client,
    };
    let random: String = of_client.iter().map(|byte| format!("{byte:02x}")).collect();
    let hello =
        json!({ "n": 0, "hello": { "version": 1, "cucs": cucs.to_string(), "random": random } });
    let sealed = (key.connection(&opening)).seal(Direction::ToVsm, &hello.to_string());
    socket.send(Message::Text(sealed.into()))?;
    let answer = match socket.read() {
        Ok(Message::Text(text)) => Some(text.as_str().to_owned()),
        _ => None,
    };
    Ok((socket, opening, answer))
}

fn bytes(hex: &str) -> Option<[u8; 32]> {
    let mut bytes = [0; 32];
    for (byte, at) in bytes.iter_mut().zip((0..).step_by(2)) {
        *byte = u8::from_str_radix(hex.get(at..at + 2)?, 16).ok()?;
    }
    Some(bytes)
}

fn carry(
    socket: &mut WebSocket<TcpStream>,
    key: &ConnectionKey,
    udp: &UdpSocket,
    stop: &AtomicBool,
) -> anyhow::Result<()> {
    let mut station = None;
    let mut number = 0_u64;
    let mut datagram = [0; MAX_DATAGRAM];
    while !stop.load(Ordering::SeqCst) {
        match udp.recv_from(&mut datagram) {
            Ok((length, from)) => {
                station = Some(from);
                let datagram = datagram.get(..length).unwrap_or_default();
                for message in stanag_msgs::json::decode(datagram, false) {
                    number += 1;
                    let frame = json!({ "n": number, "message": message });
                    let sealed = key.seal(Direction::ToVsm, &frame.to_string());
                    socket.send(Message::Text(sealed.into()))?;
                }
            }
            Err(fault) if is_time_out(&fault) => {}
            Err(fault) => return Err(fault.into()),
        }
        loop {
            let text = match socket.read() {
                Ok(Message::Text(text)) => text,
                Ok(Message::Close(why)) => bail!("the VSM has closed the connection: {why:?}"),
                Ok(_) => continue,
                Err(Error::Io(fault)) if is_time_out(&fault) => break,
                Err(fault) => return Err(fault.into()),
            };
            let sealed = SealedText::parse(text.as_str()).context("a frame without an HMAC")?;
            anyhow::ensure!(key.verifies(Direction::ToCucs, &sealed), "a forged frame");
            let frame: Value = serde_json::from_str(sealed.text)?;
            if let (Some(station), Some(_)) = (station, frame["message"].as_object()) {
                let bytes = stanag_msgs::json::encode(&frame["message"], false);
                udp.send_to(&bytes.map_err(|fault| anyhow!("{fault}"))?, station)?;
            }
        }
    }
    Ok(())
}

fn is_time_out(fault: &io::Error) -> bool {
    matches!(
        fault.kind(),
        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut
    )
}

/// Somebody opens the WebSocket in the CUCS's name again and again, each time with a key that is a guess.
pub(super) async fn guess(page: SocketAddr, claimed: Id, sent: &Cell<u64>) -> anyhow::Result<()> {
    loop {
        let tried = tokio::task::spawn_blocking(move || {
            let key = GuardKey::new(&[0x5a; 32]);
            greet(page, claimed, &key).map(|(.., answer)| answer)
        });
        if let Some(answer) = tried.await?? {
            bail!("a guess was welcome: {answer}");
        }
        sent.set(sent.get() + 1);
        tokio::time::sleep(EVERY).await;
    }
}

/// How long one end may keep the other waiting.
const LOOK: Duration = Duration::from_millis(1);
const ANSWER_WITHIN: Duration = Duration::from_secs(10);
const EVERY: Duration = Duration::from_millis(200);
