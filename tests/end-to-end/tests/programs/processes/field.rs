//! A ground, an agent and a PX4 as processes of their own, paired and with their own folders: for the tests of the agent
//! and of `kill -9`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread::sleep;
use std::time::{Duration, Instant};

use kit::process::{Running, free_udp_port, program, write_key};
use kit::relay::Relay;
use kit::serial::Line;
use serde_json::Value;
use tempfile::TempDir;

/// A ground, an air side and a PX4, each with its own folder and configuration.
pub(super) struct Field {
    folder: TempDir,
    pub(super) dli: u16,
    /// Further tables of the ground's configuration.
    tables: &'static str,
    pub(super) radio: u16,
    /// A line of `[[vehicle]]` and of `[radio]`.
    encrypt: &'static str,
    /// Where the agent waits for PX4.
    pub(super) px4: u16,
    links: Links,
    /// Where links are serial lines.
    _lines: Vec<Line>,
}

/// The links of the configurations.
struct Links {
    /// `vehicle.link` of the ground.
    ground: String,
    /// `radio.link` of the agent.
    radio: String,
    /// `px4.link` of the agent.
    px4: String,
}

impl Field {
    /// `signing` is what the ground's configuration has beside the key file.
    pub(super) fn new(signing: &str) -> Field {
        Field::with_tables(signing, "")
    }

    /// The same with further tables of the ground's configuration.
    pub(super) fn with_tables(signing: &str, tables: &'static str) -> Field {
        let (radio, px4) = (free_udp_port(), free_udp_port());
        let links = Links {
            ground: format!("udpout:127.0.0.1:{radio}"),
            radio: format!("udpin:127.0.0.1:{radio}"),
            px4: format!("udpin:127.0.0.1:{px4}"),
        };
        Field::linked(signing, tables, ([radio, px4], ""), links, Vec::new())
    }

    /// The same with a serial line between ground and agent, and one between agent and PX4.
    pub(super) fn on_serial_lines(signing: &str) -> Field {
        let px4 = free_udp_port();
        let (radio, [ground, air]) = Line::between_devices();
        let (cable, device) = Line::to_udp(px4);
        let links = Links {
            ground: format!("serial:{ground}:57600"),
            radio: format!("serial:{air}:57600"),
            px4: format!("serial:{device}:921600"),
        };
        Field::linked(signing, "", ([0, px4], ""), links, vec![radio, cable])
    }

    /// Paired, with an encrypted link that this relay carries: it is given the address of the agent.
    pub(super) fn encrypted(relay: impl FnOnce(&str) -> Relay) -> (Field, Relay) {
        let (radio, px4) = (free_udp_port(), free_udp_port());
        let relay = relay(&format!("127.0.0.1:{radio}"));
        let links = Links {
            ground: format!("udpout:{}", relay.address()),
            radio: format!("udpin:127.0.0.1:{radio}"),
            px4: format!("udpin:127.0.0.1:{px4}"),
        };
        let ports = ([radio, px4], ENCRYPT);
        let field = Field::linked(AGREED, "", ports, links, Vec::new());
        (field, relay)
    }

    /// The same over a serial line.
    pub(super) fn encrypted_on_serial_lines() -> Field {
        let field = Field::on_serial_lines(AGREED);
        let field = Field {
            encrypt: ENCRYPT,
            ..field
        };
        field.write_configurations(AGREED);
        field
    }

    fn linked(
        signing: &str,
        tables: &'static str,
        ([radio, px4], encrypt): ([u16; 2], &'static str),
        links: Links,
        lines: Vec<Line>,
    ) -> Field {
        let folder = tempfile::tempdir().expect("a folder");
        let field = Field {
            folder,
            dli: free_udp_port(),
            tables,
            radio,
            encrypt,
            px4,
            links,
            _lines: lines,
        };
        fs::create_dir(field.path("ground")).expect("a folder");
        fs::create_dir(field.path("air")).expect("a folder");
        field.write_configurations(signing);
        field
    }

    fn write_configurations(&self, signing: &str) {
        self.write_ground(signing);
        let Links { radio, px4, .. } = &self.links;
        let encrypt = self.encrypt;
        let air = format!(
            r#"
[agent]
vehicle_id = "1b:00:01:01"
vsm_id = "1b:00:00:01"
key_file = "uav1.key"
[radio]
link = "{radio}"
{encrypt}
[px4]
link = "{px4}"
system_id = 1
[store]
dir = "state"
"#
        );
        fs::write(self.path("air/airside.toml"), air).expect("the configuration");
    }

    pub(super) fn write_ground(&self, signing: &str) {
        let Field {
            dli,
            links,
            tables,
            encrypt,
            ..
        } = self;
        let link = &links.ground;
        let ground = format!(
            r#"
[dli]
vsm_id = "1b:00:00:01"
listen = "127.0.0.1:{dli}"
[[cucs]]
id = "1b:00:00:a0"
loi = [2, 3, 4, 5]
[[vehicle]]
id = "1b:00:01:01"
link = "{link}"
system_id = 1
signing = {{ key_file = "uav1.key"{signing} }}
{encrypt}
[store]
dir = "state"
{tables}"#
        );
        fs::write(self.path("ground/vsm.toml"), ground).expect("the configuration");
    }

    /// A person on either side pairs them.
    pub(super) fn pair(&self) -> String {
        let mut window = self.vsm(&["airside", "pair"]);
        window.wait_for("pairing code", START);
        let printed = window.output();
        let code = printed
            .lines()
            .find_map(|line| line.strip_prefix("pairing code"))
            .expect("a code")
            .trim()
            .to_owned();
        let mut pair = self.vsm(&["pair", "--code", &code]);
        let status = pair.wait(PAIRED_WITHIN);
        assert!(status.is_some_and(|s| s.success()), "{}", pair.output());
        let status = window.wait(Duration::from_secs(5));
        assert!(status.is_some_and(|s| s.success()), "{}", window.output());
        // Each side shows the other's fingerprint as its own side does.
        let air = self.air();
        let identity = air["identity"].as_str().expect("a fingerprint");
        let ground = air["ground"].as_str().expect("a fingerprint");
        let printed = pair.output();
        assert!(printed.contains(identity) && printed.contains(ground));
        let (_, key) = printed.split_once("paired: key ").expect("a key");
        key.split(' ').next().expect("its id").to_owned()
    }

    /// Until PX4 signs with what was agreed, and the bridge flies by it.
    pub(super) fn wait_until_signed(&self) {
        self.wait("PX4 signs", OVER_A_BAD_RADIO, |field| {
            field.is_live() && field.air()["state"] == "relaying"
        });
        let vehicle = self.vehicle();
        assert_eq!(vehicle["link"]["key_id"], self.air()["key_id"]);
        assert_eq!(vehicle["link"]["signed"], true, "{vehicle:#}");
    }

    /// One key on both sides, copied by hand.
    pub(super) fn share_key(&self) -> [u8; 32] {
        let seed = vsm_tests::seed_from_clock().to_le_bytes();
        let key: [u8; 32] = core::array::from_fn(|i| seed[i % 8] ^ (i as u8).wrapping_mul(29) | 1);
        write_key(&self.path("ground/uav1.key"), &key);
        write_key(&self.path("air/uav1.key"), &key);
        key
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(super) fn vsm(&self, arguments: &[&str]) -> Running {
        let mut all: Vec<String> = arguments.iter().map(|word| (*word).to_owned()).collect();
        let config = if arguments.first() == Some(&"airside") {
            "air/airside.toml"
        } else {
            "ground/vsm.toml"
        };
        all.extend([
            "--config".to_owned(),
            self.path(config).display().to_string(),
        ]);
        Running::start(&program("vsm"), all)
    }

    pub(super) fn bridge(&self) -> Running {
        let mut bridge = self.vsm(&["run"]);
        bridge.wait_for("ready", START);
        bridge
    }

    pub(super) fn agent(&self) -> Running {
        let mut agent = self.vsm(&["airside"]);
        agent.wait_for("ready", START);
        agent
    }

    /// A PX4 that keeps the keys that it is given in its own file.
    pub(super) fn aircraft(&self, speed: &str) -> Running {
        self.aircraft_behind(&format!("127.0.0.1:{}", self.px4), speed)
    }

    /// The same at another address than the agent's, which carries to it.
    pub(super) fn aircraft_behind(&self, address: &str, speed: &str) -> Running {
        let link = format!("udpout:{address}");
        let file = self.path("px4.bin").display().to_string();
        let arguments = ["--link", &link, "--signing-file", &file, "--speed", speed];
        let mut aircraft = Running::start(&program("px4-sim"), arguments);
        aircraft.wait_for("ready", START);
        aircraft
    }

    /// PX4's own file, as if it had been given this key long ago.
    pub(super) fn px4_has(&self, key: &[u8; 32]) {
        let mut bytes = key.to_vec();
        bytes.extend(1_u64.to_le_bytes());
        fs::write(self.path("px4.bin"), bytes).expect("PX4's key file");
    }

    pub(super) fn cucs(&self, words: &[&str]) {
        if let Err(printed) = self.try_cucs(words) {
            panic!("cucs {words:?}: {printed}");
        }
    }

    pub(super) fn try_cucs(&self, words: &[&str]) -> Result<(), String> {
        let vsm = format!("127.0.0.1:{}", self.dli);
        let done = Command::new(program("cucs"))
            .args(["--vsm", &vsm])
            .args(words)
            .output()
            .expect("cucs");
        if done.status.success() {
            return Ok(());
        }
        Err(String::from_utf8_lossy(&done.stderr).into_owned())
    }

    /// Takes control and launches; refused until the vehicle knows its home and can arm.
    pub(super) fn launch(&self) {
        self.cucs(&["take", "--loi", "2,4,5"]);
        self.wait("launched", OVER_A_BAD_RADIO, |field| {
            field.try_cucs(&["launch", "10"]).is_ok()
        });
        self.cucs(&["wait", "airborne", "--within", "60"]);
    }

    /// What a command of the program prints as JSON; `Null` where nobody answers.
    pub(super) fn status(&self, of: &[&str]) -> Value {
        let mut command = Command::new(program("vsm"));
        command.args(of).arg("--json");
        let config: &Path = if of.first() == Some(&"airside") {
            "air/airside.toml".as_ref()
        } else {
            "ground/vsm.toml".as_ref()
        };
        command.arg("--config").arg(self.folder.path().join(config));
        let done = command.output().expect("vsm");
        serde_json::from_slice(&done.stdout).unwrap_or(Value::Null)
    }

    pub(super) fn air(&self) -> Value {
        self.status(&["airside", "status"])
    }

    /// The vehicle as the bridge sees it.
    pub(super) fn vehicle(&self) -> Value {
        self.status(&["status"])["vehicles"][0].take()
    }

    /// Verified frames that the bridge has taken since its start; 0 where there is none.
    pub(super) fn believed(&self) -> u64 {
        self.vehicle()["link"]["frames"]["delivered_verified"]
            .as_u64()
            .unwrap_or(0)
    }

    /// Waits until it holds; how long that took.
    pub(super) fn wait(
        &self,
        what: &str,
        limit: Duration,
        mut holds: impl FnMut(&Field) -> bool,
    ) -> Duration {
        let from = Instant::now();
        while !holds(self) {
            assert!(
                from.elapsed() < limit,
                "{what}, within {limit:?}\n{:#}\n{:#}",
                self.air(),
                self.vehicle()
            );
            sleep(Duration::from_millis(50));
        }
        from.elapsed()
    }

    /// Looks often: what follows must come before whoever made it continues.
    pub(super) fn wait_for_file(&self, path: &Path) {
        let end = Instant::now() + START;
        while !path.exists() {
            assert!(Instant::now() < end, "{}", path.display());
            sleep(Duration::from_millis(1));
        }
    }

    pub(super) fn is_live(&self) -> bool {
        let vehicle = self.vehicle();
        vehicle["live"] == true && vehicle["link"]["state"] == "live"
    }
}

/// What the ground's configuration has beside the key file where both are to agree.
const AGREED: &str = r#", exchange = "on""#;
const ENCRYPT: &str = "encrypt = true";
/// Over a radio that loses 40 % an attempt of 10 s fails three times in ten, and pauses follow: of 50 pairings one takes longer
/// than 30 s, of 5,000 one longer than 90 s.
const PAIRED_WITHIN: Duration = Duration::from_secs(120);
/// A launch that was refused there, since the vehicle disarmed before the second command had arrived, needs another try.
const OVER_A_BAD_RADIO: Duration = Duration::from_secs(90);
pub(super) const START: Duration = Duration::from_secs(10);
