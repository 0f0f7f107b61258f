//! A cluster of etcd as processes of its own, on free ports of the loopback interface.

use std::io::{self, Read as _, Write as _};
use std::net::TcpStream;
use std::process::Command;
use std::time::{Duration, Instant};

use crate::process::{Running, free_tcp_port};
use tempfile::TempDir;

/// The running members of a cluster.
#[derive(Debug)]
pub struct Etcd {
    folder: TempDir,
    peers: Vec<u16>,
    clients: Vec<u16>,
    members: Vec<Option<Running>>,
}

impl Etcd {
    /// Starts a cluster and waits until it has a leader.
    pub fn start(members: usize) -> Etcd {
        let ports = || (0..members).map(|_| free_tcp_port()).collect();
        let mut etcd = Etcd {
            folder: tempfile::tempdir().expect("a folder"),
            peers: ports(),
            clients: ports(),
            members: (0..members).map(|_| None).collect(),
        };
        for member in 0..members {
            etcd.start_member(member);
        }
        let end = Instant::now() + START;
        while !etcd.is_healthy() {
            assert!(Instant::now() < end, "etcd has no leader within {START:?}");
            std::thread::sleep(Duration::from_millis(100));
        }
        etcd
    }

    /// The URLs of its members, for clients.
    pub fn urls(&self) -> Vec<String> {
        let each = self.clients.iter();
        each.map(|port| format!("http://127.0.0.1:{port}"))
            .collect()
    }

    /// The same as a TOML list.
    pub fn endpoints(&self) -> String {
        format!("{:?}", self.urls())
    }

    /// Ends all leases at once, as if their time had passed.
    pub fn end_leases(&self) {
        let all = self.ask("lease/leases", "{}");
        for id in all.split("\"ID\":\"").skip(1) {
            let id = id.split('"').next().expect("its end");
            self.ask("lease/revoke", &format!("{{\"ID\":\"{id}\"}}"));
        }
    }

    /// Gives a key a value. Both are ASCII.
    pub fn put(&self, key: &str, value: &str) {
        let (key, value) = (base64(key.as_bytes()), base64(value.as_bytes()));
        let body = format!("{{\"key\":\"{key}\",\"value\":\"{value}\"}}");
        self.ask("kv/put", &body);
    }

    /// Deletes a key. Its name is ASCII.
    pub fn delete(&self, key: &str) {
        let key = base64(key.as_bytes());
        self.ask("kv/deleterange", &format!("{{\"key\":\"{key}\"}}"));
    }

    /// The first member's answer to a request to its gateway.
    fn ask(&self, path: &str, body: &str) -> String {
        let length = body.len();
        self.exchange(
            self.clients[0],
            &format!("POST /v3/{path} HTTP/1.0\r\nContent-Length: {length}\r\n\r\n{body}"),
        )
        .expect("it answers")
    }

    fn exchange(&self, port: u16, request: &str) -> io::Result<String> {
        let mut stream = TcpStream::connect(("127.0.0.1", port))?;
        stream.write_all(request.as_bytes())?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer)?;
        Ok(answer)
    }

    /// A member's process, to be stopped or continued by signals.
    pub fn member(&self, member: usize) -> &Running {
        self.members[member].as_ref().expect("it runs")
    }

    /// Kills a member (SIGKILL).
    pub fn kill_member(&mut self, member: usize) {
        self.members[member].take().expect("it runs").kill();
    }

    /// Starts a member again, with what is on its disk.
    pub fn start_member(&mut self, member: usize) {
        let url = |port: u16| format!("http://127.0.0.1:{port}");
        let peers = (self.peers.iter().enumerate()).map(|(n, port)| format!("m{n}={}", url(*port)));
        let cluster = peers.collect::<Vec<_>>().join(",");
        let (peer, client) = (url(self.peers[member]), url(self.clients[member]));
        let data = self.folder.path().join(format!("m{member}"));
        let mut command = Command::new("etcd");
        command.arg("--data-dir").arg(data);
        command.args([
            "--name",
            &format!("m{member}"),
            "--initial-cluster",
            &cluster,
        ]);
        command.args([
            "--listen-peer-urls",
            &peer,
            "--initial-advertise-peer-urls",
            &peer,
        ]);
        command.args([
            "--listen-client-urls",
            &client,
            "--advertise-client-urls",
            &client,
        ]);
        self.members[member] = Some(Running::spawn(&mut command));
    }

    fn is_healthy(&self) -> bool {
        let ask = |port: &u16| self.exchange(*port, "GET /health HTTP/1.0\r\n\r\n");
        let healthy = |port| ask(port).is_ok_and(|text| text.contains("\"health\":\"true\""));
        self.clients.iter().all(healthy)
    }
}

/// Base64, as the gateway expects keys. Written here because the kit has no crate for it, and needs it only once.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for three in bytes.chunks(3) {
        let value = three
            .iter()
            .fold(0_u32, |value, byte| value << 8 | u32::from(*byte))
            << (8 * (3 - three.len()));
        for at in 0..4 {
            let digit = DIGITS[(value >> (18 - 6 * at)) as usize & 63];
            text.push(if at <= three.len() { digit.into() } else { '=' });
        }
    }
    text
}

/// How long a cluster may take to start.
const START: Duration = Duration::from_secs(30);
