//! The air-side agent as a process between a bridge and a simulated PX4: it relays and drops, keys are agreed through
//! it, and whatever of the three is restarted, the link is up again within 5 s.

use std::fs;
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread::sleep;
use std::time::{Duration, Instant};

use kit::process::{Running, free_udp_port, program, write_key};
use kit::serial::Line;
use mavlink_link::dialect::{COMMAND_LONG_DATA, MavCmd, MavMessage};
use mavlink_link::frame::{Header, INCOMPAT_SIGNED, MAX_FRAME, encode, encode_raw};
use mavlink_link::signing::{SigningKey, Stamp, sign};
use serde_json::Value;
use tempfile::TempDir;

/// A ground, an air side and a PX4, each with its own folder and configuration.
struct Field {
    folder: TempDir,
    dli: u16,
    radio: u16,
    px4: u16,
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
    fn new(signing: &str) -> Field {
        let (radio, px4) = (free_udp_port(), free_udp_port());
        let links = Links {
            ground: format!("udpout:127.0.0.1:{radio}"),
            radio: format!("udpin:127.0.0.1:{radio}"),
            px4: format!("udpin:127.0.0.1:{px4}"),
        };
        Field::linked(signing, radio, px4, links, Vec::new())
    }

    /// The same with a serial line between ground and agent, and one between agent and PX4.
    fn on_serial_lines(signing: &str) -> Field {
        let px4 = free_udp_port();
        let (radio, [ground, air]) = Line::between_devices();
        let (cable, device) = Line::to_udp(px4);
        let links = Links {
            ground: format!("serial:{ground}:57600"),
            radio: format!("serial:{air}:57600"),
            px4: format!("serial:{device}:921600"),
        };
        Field::linked(signing, 0, px4, links, vec![radio, cable])
    }

    fn linked(signing: &str, radio: u16, px4: u16, links: Links, lines: Vec<Line>) -> Field {
        let folder = tempfile::tempdir().expect("a folder");
        let field = Field {
            folder,
            dli: free_udp_port(),
            radio,
            px4,
            links,
            _lines: lines,
        };
        fs::create_dir(field.path("ground")).expect("a folder");
        fs::create_dir(field.path("air")).expect("a folder");
        field.write_ground(signing);
        let Links { radio, px4, .. } = &field.links;
        let air = format!(
            r#"
[agent]
vehicle_id = "1b:00:01:01"
vsm_id = "1b:00:00:01"
key_file = "uav1.key"
[radio]
link = "{radio}"
[px4]
link = "{px4}"
system_id = 1
[store]
dir = "state"
"#
        );
        fs::write(field.path("air/airside.toml"), air).expect("the configuration");
        field
    }

    fn write_ground(&self, signing: &str) {
        let Field { dli, links, .. } = self;
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
[store]
dir = "state"
"#
        );
        fs::write(self.path("ground/vsm.toml"), ground).expect("the configuration");
    }

    /// A person on either side pairs them.
    fn pair(&self) {
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
        let status = pair.wait(Duration::from_secs(30));
        assert!(status.is_some_and(|s| s.success()), "{}", pair.output());
        let status = window.wait(Duration::from_secs(5));
        assert!(status.is_some_and(|s| s.success()), "{}", window.output());
        // Each side shows the other's fingerprint as its own side does.
        let air = self.air();
        let identity = air["identity"].as_str().expect("a fingerprint");
        let ground = air["ground"].as_str().expect("a fingerprint");
        assert!(pair.output().contains(identity) && pair.output().contains(ground));
    }

    /// Until PX4 signs with what was agreed, and the bridge flies by it.
    fn wait_until_signed(&self) {
        self.wait("PX4 signs", Duration::from_secs(30), |field| {
            field.is_live() && field.air()["state"] == "relaying"
        });
        let vehicle = self.vehicle();
        assert_eq!(vehicle["link"]["key_id"], self.air()["key_id"]);
        assert_eq!(vehicle["link"]["signed"], true, "{vehicle:#}");
    }

    /// One key on both sides, copied by hand.
    fn share_key(&self) -> [u8; 32] {
        let seed = vsm_tests::seed_from_clock().to_le_bytes();
        let key: [u8; 32] = core::array::from_fn(|i| seed[i % 8] ^ (i as u8).wrapping_mul(29) | 1);
        write_key(&self.path("ground/uav1.key"), &key);
        write_key(&self.path("air/uav1.key"), &key);
        key
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn vsm(&self, arguments: &[&str]) -> Running {
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

    fn bridge(&self) -> Running {
        let mut bridge = self.vsm(&["run"]);
        bridge.wait_for("ready", START);
        bridge
    }

    fn agent(&self) -> Running {
        let mut agent = self.vsm(&["airside"]);
        agent.wait_for("ready", START);
        agent
    }

    /// A PX4 that keeps the keys that it is given in its own file.
    fn aircraft(&self, speed: &str) -> Running {
        let link = format!("udpout:127.0.0.1:{}", self.px4);
        let file = self.path("px4.bin").display().to_string();
        let arguments = ["--link", &link, "--signing-file", &file, "--speed", speed];
        let mut aircraft = Running::start(&program("px4-sim"), arguments);
        aircraft.wait_for("ready", START);
        aircraft
    }

    /// PX4's own file, as if it had been given this key long ago.
    fn px4_has(&self, key: &[u8; 32]) {
        let mut bytes = key.to_vec();
        bytes.extend(1_u64.to_le_bytes());
        fs::write(self.path("px4.bin"), bytes).expect("PX4's key file");
    }

    fn cucs(&self, words: &[&str]) {
        if let Err(printed) = self.try_cucs(words) {
            panic!("cucs {words:?}: {printed}");
        }
    }

    fn try_cucs(&self, words: &[&str]) -> Result<(), String> {
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
    fn launch(&self) {
        self.cucs(&["take", "--loi", "2,4,5"]);
        self.wait("launched", Duration::from_secs(30), |field| {
            field.try_cucs(&["launch", "10"]).is_ok()
        });
        self.cucs(&["wait", "airborne", "--within", "30"]);
    }

    /// What a command of the program prints as JSON; `Null` where nobody answers.
    fn status(&self, of: &[&str]) -> Value {
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

    fn air(&self) -> Value {
        self.status(&["airside", "status"])
    }

    /// The vehicle as the bridge sees it.
    fn vehicle(&self) -> Value {
        self.status(&["status"])["vehicles"][0].take()
    }

    /// Verified frames that the bridge has taken since its start; 0 where there is none.
    fn believed(&self) -> u64 {
        self.vehicle()["link"]["frames"]["delivered_verified"]
            .as_u64()
            .unwrap_or(0)
    }

    /// Waits until it holds; how long that took.
    fn wait(&self, what: &str, limit: Duration, mut holds: impl FnMut(&Field) -> bool) -> Duration {
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

    fn is_live(&self) -> bool {
        let vehicle = self.vehicle();
        vehicle["live"] == true && vehicle["link"]["state"] == "live"
    }

    /// How long until the bridge accepts the vehicle's frames again.
    fn up_again(&self) -> Duration {
        let mut before = self.believed();
        self.wait("the link is up again", Duration::from_secs(20), |field| {
            let now = field.believed();
            // A bridge that has restarted counts from zero.
            before = before.min(now);
            now > before + 20 && field.is_live()
        })
    }

    /// Each of the three is killed and restarted, then all of them, in the least fitting order. Nobody lends a hand,
    /// and the link is up within 5 s.
    #[allow(
        clippy::print_stderr,
        reason = "what was measured is printed for whoever reads the test"
    )]
    fn restart_each(&self, mut parts: Parts) -> Parts {
        let mut took = vec![];
        for what in ["PX4", "agent", "bridge", "all"] {
            let is = |part: &str| what == part || what == "all";
            // Dropped means killed: nothing can be written any more.
            if is("PX4") {
                drop(parts.aircraft.take());
            }
            if is("agent") {
                drop(parts.agent.take());
            }
            if is("bridge") {
                drop(parts.bridge.take());
                parts.bridge = Some(self.bridge());
            }
            if is("agent") {
                parts.agent = Some(self.agent());
            }
            if is("PX4") {
                parts.aircraft = Some(self.aircraft("1"));
            }
            let up = self.up_again();
            eprintln!("{what} restarted: up again after {:.2} s", up.as_secs_f64());
            took.push((what, up));
        }
        for (what, up) in took {
            assert!(up < Duration::from_secs(5), "{what}: {up:?}");
        }
        parts
    }
}

/// What runs: ended where it is dropped.
struct Parts {
    aircraft: Option<Running>,
    agent: Option<Running>,
    bridge: Option<Running>,
}

#[test]
fn the_agent_relays_and_drops_what_must_not_reach_px4() {
    let field = Field::new("");
    let key = field.share_key();
    field.px4_has(&key);
    let _aircraft = field.aircraft("4");
    let _agent = field.agent();
    let _bridge = field.bridge();
    field.wait("live", Duration::from_secs(15), Field::is_live);

    let attacker = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let key = SigningKey::new(key).expect("a key");
    let other = SigningKey::new([9; 32]).expect("a key");
    let now = Stamp::from_unix(
        std::time::SystemTime::now()
            .duration_since(std::time::UNIX_EPOCH)
            .expect("a time"),
    );
    let year = now.plus(Duration::from_secs(366 * 86_400));
    let arm = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        command: MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
        target_system: 1,
        target_component: 1,
        param1: 1.0,
        ..COMMAND_LONG_DATA::default()
    });
    // Who, under which key and stamp, and the counter that must show it.
    let attacks = [
        (245, 190, None, "unsigned_vehicle"),
        (245, 190, Some((&other, now)), "bad_signature"),
        (1, 191, Some((&key, now)), "reflected"),
        (245, 77, Some((&key, now)), "not_listed"),
        (44, 190, Some((&key, now)), "unexpected_system"),
        (245, 190, Some((&key, year)), "future"),
    ];
    let refused = |name: &str| field.air()["radio"]["frames"][name].as_u64().unwrap_or(0);
    for (system, component, signature, counter) in attacks {
        let before = refused(counter);
        let bytes = signed(system, component, &arm, signature);
        attacker
            .send_to(&bytes, ("127.0.0.1", field.radio))
            .expect("sent");
        field.wait(counter, Duration::from_secs(5), |_| {
            refused(counter) > before
        });
    }
    let setup = setup_signing(&key, now.plus(Duration::from_secs(60)));
    attacker
        .send_to(&setup, ("127.0.0.1", field.radio))
        .expect("sent");
    let held = "SETUP_SIGNING from the ground";
    field.wait(held, Duration::from_secs(5), |field| {
        field.air()["held_back"][held] == 1
    });
    let vehicle = field.vehicle();
    assert_eq!(vehicle["armed"], false, "{vehicle:#}");

    // And the bridge's own commands pass: it flies.
    field.launch();
}

#[test]
fn both_sides_pair_agree_fly_rotate_and_survive_each_restart() {
    let field = Field::new(r#", exchange = "on""#);
    let aircraft = field.aircraft("4");
    let agent = field.agent();
    field.pair();

    let bridge = field.bridge();
    field.wait_until_signed();
    let first = field.air()["key_id"].clone();

    field.launch();
    field.cucs(&["land"]);
    field.cucs(&["wait", "landed", "--within", "60"]);
    field.wait("disarmed", Duration::from_secs(30), |field| {
        field.vehicle()["armed"] == false
    });
    field.cucs(&["release"]);
    drop(bridge);

    // A key that is old after a few seconds: another is agreed about, and taken over while the vehicle stands.
    field.write_ground(r#", exchange = "on", rotate_days = 0.0001"#);
    let bridge = field.bridge();
    field.wait("another key", Duration::from_secs(60), |field| {
        let air = field.air();
        air["state"] == "relaying"
            && air["key_id"] != first
            && field.vehicle()["link"]["key_id"] == air["key_id"]
            && field.is_live()
    });
    drop(bridge);
    field.write_ground(r#", exchange = "on""#);

    // Whatever is switched off and on, and though the key was agreed over the air, the link comes up by itself.
    let parts = Parts {
        aircraft: Some(aircraft),
        agent: Some(agent),
        bridge: Some(field.bridge()),
    };
    field.wait("live", Duration::from_secs(20), Field::is_live);
    let _parts = field.restart_each(parts);
    assert_ne!(field.air()["key_id"], first, "the second key is in force");
    field.launch();
}

#[test]
fn over_serial_lines_both_sides_pair_fly_signed_and_come_back() {
    let field = Field::on_serial_lines(r#", exchange = "on""#);
    let parts = Parts {
        aircraft: Some(field.aircraft("1")),
        agent: Some(field.agent()),
        bridge: None,
    };
    field.pair();
    let parts = Parts {
        bridge: Some(field.bridge()),
        ..parts
    };
    field.wait_until_signed();
    let _parts = field.restart_each(parts);
    field.launch();
}

#[test]
fn whatever_restarts_the_link_is_up_within_5_s() {
    let field = Field::new("");
    let key = field.share_key();
    field.px4_has(&key);
    let parts = Parts {
        aircraft: Some(field.aircraft("1")),
        agent: Some(field.agent()),
        bridge: Some(field.bridge()),
    };
    field.wait("live", Duration::from_secs(20), Field::is_live);
    let _parts = field.restart_each(parts);
}

fn signed(
    system: u8,
    component: u8,
    message: &MavMessage,
    signature: Option<(&SigningKey, Stamp)>,
) -> Vec<u8> {
    let header = Header {
        system_id: system,
        component_id: component,
        incompat: signature.map_or(0, |_| INCOMPAT_SIGNED),
        ..Header::default()
    };
    let mut out = [0; MAX_FRAME];
    let mut len = encode(message, header, &mut out);
    if let Some((key, stamp)) = signature {
        len = sign(key, 0, stamp, &mut out, len).expect("room");
    }
    out[..len].to_vec()
}

/// As the VSM would sign it: from the radio it must not pass all the same.
fn setup_signing(key: &SigningKey, stamp: Stamp) -> Vec<u8> {
    let header = Header {
        system_id: 245,
        component_id: 190,
        message_id: 256,
        incompat: INCOMPAT_SIGNED,
        ..Header::default()
    };
    let mut out = [0; MAX_FRAME];
    let len = encode_raw(header, &[7; 42], &mut out).expect("a frame");
    let len = sign(key, 0, stamp, &mut out, len).expect("room");
    out[..len].to_vec()
}

const START: Duration = Duration::from_secs(10);
