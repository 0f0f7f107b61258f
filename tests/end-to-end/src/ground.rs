//! A bridge and a simulated PX4 as processes of their own, on free ports, with a key made for the test.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tempfile::TempDir;

use kit::process::{Running, free_tcp_port, free_udp_port, program, write_key};

/// Where the simulated aircraft stands: degrees, degrees, metres AMSL.
pub const HOME: &str = "47.3977434,8.5455939,488";

/// What both programs need: a folder with key and configuration, and two ports.
pub struct Ground {
    folder: TempDir,
    dli: u16,
    mavlink: u16,
    http: u16,
    signed: bool,
}

impl Ground {
    /// Lays it out; the key is as random as a temporary folder's name and the clock.
    #[allow(
        clippy::new_without_default,
        reason = "each is another: its key and ports are drawn"
    )]
    pub fn new() -> Self {
        Self::laid_out(true, "", "")
    }

    /// The same with MAVLink signing off.
    pub fn unsigned() -> Self {
        Self::laid_out(false, "", "")
    }

    /// The same, signed, with further tables of configuration.
    pub fn with_tables(tables: &str) -> Self {
        Self::laid_out(true, "", tables)
    }

    /// The same in a multicast group of the loopback interface, with further tables; returns the group too.
    pub fn in_group(tables: &str) -> (Self, String) {
        let group = format!("225.200.1.25:{}", free_udp_port());
        let keys = format!("multicast = \"{group}\"\ninterface = \"127.0.0.1\"");
        (Self::laid_out(true, &keys, tables), group)
    }

    fn laid_out(signed: bool, dli_keys: &str, tables: &str) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let ground = Self {
            folder,
            dli: free_udp_port(),
            mavlink: free_udp_port(),
            http: free_tcp_port(),
            signed,
        };
        let seed = crate::seed_from_clock().to_le_bytes();
        let key: [u8; 32] = core::array::from_fn(|i| seed[i % 8] ^ (i as u8).wrapping_mul(167) | 1);
        write_key(&ground.path("uav1.key"), &key);
        fs::write(
            ground.path("vsm.toml"),
            ground.configuration(dli_keys) + tables,
        )
        .expect("the configuration");
        ground
    }

    fn configuration(&self, dli_keys: &str) -> String {
        let Self {
            dli, mavlink, http, ..
        } = self;
        let signing = if self.signed {
            "{ key_file = \"uav1.key\" }"
        } else {
            "\"off\""
        };
        format!(
            r#"
[dli]
vsm_id = "1b:00:00:01"
listen = "127.0.0.1:{dli}"
{dli_keys}
[[cucs]]
id = "1b:00:00:a0"
loi = [2, 3, 4, 5]
address = "127.0.0.1"
[[vehicle]]
id = "1b:00:01:01"
link = "udpin:127.0.0.1:{mavlink}"
system_id = 1
tail_number = "PX4-01"
signing = {signing}
[store]
dir = "state"
[http]
listen = "127.0.0.1:{http}"
"#
        )
    }

    /// A file beside the configuration.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Where the bridge waits for its vehicle.
    pub fn link(&self) -> String {
        format!("127.0.0.1:{}", self.mavlink)
    }

    /// Where stations find the bridge.
    pub fn dli(&self) -> String {
        format!("127.0.0.1:{}", self.dli)
    }

    /// The operator's page.
    pub fn page(&self) -> String {
        format!("http://127.0.0.1:{}/", self.http)
    }

    /// Starts the bridge and waits until it serves.
    pub fn bridge(&self) -> Running {
        let config = self.path("vsm.toml");
        let arguments: [&Path; 3] = ["run".as_ref(), "--config".as_ref(), &config];
        let mut bridge = Running::start(&program("vsm"), arguments);
        bridge.wait_for("ready", Duration::from_secs(10));
        bridge
    }

    /// Replaces the key, before anything is started.
    pub fn set_key(&self, key: &[u8; 32]) {
        write_key(&self.path("uav1.key"), key);
    }

    /// Starts the simulated aircraft, five times faster than time.
    pub fn aircraft(&self) -> Running {
        // The bridge's time is real: what PX4 gives it 10 s for, it has 2 s for here. At 10 times, a busy computer misses it.
        self.aircraft_with(&["--speed", "5"])
    }

    /// Starts the simulated aircraft with further arguments.
    pub fn aircraft_with(&self, further: &[&str]) -> Running {
        let key = self.path("uav1.key").to_string_lossy().into_owned();
        let link = format!("udpout:{}", self.link());
        let arguments = ["--link", &link, "--key-file", &key, "--home", HOME];
        let arguments = arguments.iter().chain(further);
        let mut aircraft = Running::start(&program("px4-sim"), arguments);
        aircraft.wait_for("ready", Duration::from_secs(10));
        aircraft
    }
}
