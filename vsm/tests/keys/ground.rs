//! A folder with a configuration and keys, the program in it, and a simulated vehicle that calls it.

use std::fs;
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use mavlink_link::signing::SigningKey;
use px4_sim::{LinkAddress, Simulator, SimulatorConfig};
use serde_json::Value;

use kit::process::{KillOnDrop, free_tcp_port, free_udp_port, program, run_in};

pub(super) const FIRST: [u8; 32] = [0x11; 32];
pub(super) const SECOND: [u8; 32] = [0x22; 32];

/// A folder with a configuration: the bridge waits for the vehicle at `link`, and serves its page at `http`.
pub(super) struct Ground {
    folder: tempfile::TempDir,
    pub(super) link: u16,
    http: u16,
}

impl Ground {
    pub(super) fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (dli, link, http) = (free_udp_port(), free_udp_port(), free_tcp_port());
        let config = format!(
            "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:{dli}\"\n[[vehicle]]\nid = \"1b:00:01:01\"\n\
             link = \"udpin:127.0.0.1:{link}\"\nsystem_id = 1\nsigning = {{ key_file = \"uav1.key\" }}\n\
             [store]\ndir = \"state\"\n[http]\nlisten = \"127.0.0.1:{http}\"\n"
        );
        fs::write(folder.path().join("vsm.toml"), config).unwrap();
        Self { folder, link, http }
    }

    pub(super) fn path(&self) -> &Path {
        self.folder.path()
    }

    pub(super) fn write_key(&self, name: &str, key: [u8; 32]) {
        let hex: String = key.iter().map(|byte| format!("{byte:02x}")).collect();
        let mut file = fs::OpenOptions::new()
            .write(true)
            .create_new(true)
            .mode(0o600)
            .open(self.path().join(name))
            .unwrap();
        writeln!(file, "{hex}").unwrap();
    }

    pub(super) fn key(&self, name: &str) -> SigningKey {
        let text = fs::read_to_string(self.path().join(name)).unwrap();
        SigningKey::from_hex(text.trim()).unwrap()
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.path().join(name).exists()
    }

    /// Runs a command to its end, off the runtime that the vehicle lives on.
    pub(super) async fn command(&self, arguments: &'static [&'static str]) -> (bool, String) {
        let folder = self.path().to_owned();
        let (done, printed) =
            tokio::task::spawn_blocking(move || run_in(&folder, "vsm", arguments))
                .await
                .unwrap();
        (done, String::from_utf8_lossy(&printed).into_owned())
    }

    pub(super) fn start_bridge(&self) -> KillOnDrop {
        let bridge = Command::new(program("vsm"))
            .args(["run", "--config", "vsm.toml"])
            .current_dir(self.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        KillOnDrop(bridge)
    }

    /// The first vehicle's link in /status.json, once it fits `good`.
    pub(super) async fn link_status(&self, what: &str, good: impl Fn(&Value) -> bool) -> Value {
        let end = Instant::now() + Duration::from_secs(20);
        let mut last = Value::Null;
        loop {
            if let Some(status) = self.status_json() {
                let link = status["vehicles"][0]["link"].clone();
                if good(&link) {
                    return link;
                }
                last = link;
            }
            assert!(Instant::now() < end, "{what}: {last:#}");
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    }

    /// The status names a key as soon as a frame has verified under it; its files follow a moment later.
    pub(super) async fn files(&self, what: &str, good: impl Fn(&Ground) -> bool) {
        let end = Instant::now() + Duration::from_secs(10);
        while !good(self) {
            assert!(Instant::now() < end, "the key files are not so: {what}");
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }

    fn status_json(&self) -> Option<Value> {
        let mut stream = TcpStream::connect(("127.0.0.1", self.http)).ok()?;
        stream
            .write_all(b"GET /status.json HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
            .ok()?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer).ok()?;
        let (head, body) = answer.split_once("\r\n\r\n")?;
        assert!(head.starts_with("HTTP/1.1 200"), "{head}");
        serde_json::from_str(body).ok()
    }

    /// A vehicle that calls here; it signs where it has a key.
    pub(super) async fn vehicle(&self, key: Option<[u8; 32]>, first: u64) -> Simulator {
        let link: LinkAddress = format!("udpout:127.0.0.1:{}", self.link).parse().unwrap();
        Simulator::spawn(SimulatorConfig {
            key: key.map(|key| SigningKey::new(key).unwrap()),
            initial_timestamp: first,
            ..SimulatorConfig::on(link)
        })
        .await
        .unwrap()
    }
}

pub(super) fn key(bytes: [u8; 32]) -> SigningKey {
    SigningKey::new(bytes).unwrap()
}

pub(super) fn id(bytes: [u8; 32]) -> String {
    key(bytes).id().to_string()
}

pub(super) fn is_live_under(link: &Value, key_id: &str) -> bool {
    link["state"] == "live" && link["signed"] == true && link["key_id"] == key_id
}
