//! `vsm reload` and SIGHUP to a running `vsm run`: links open and close while the others continue, a bad file changes nothing,
//! and the command says what the bridge answered.

use std::fs;
use std::io::{Read as _, Write as _};
use std::net::{TcpStream, UdpSocket};
use std::os::unix::fs::PermissionsExt as _;
use std::path::PathBuf;
use std::process::{Command, Output};
use std::thread::sleep;
use std::time::{Duration, Instant};

use kit::process::{Running, free_udp_port, program, write_key};
use mavlink_link::dialect::{HEARTBEAT_DATA, MavMessage};
use mavlink_link::frame::{Header, MAX_FRAME, encode};
use serde_json::Value;
use tempfile::TempDir;

struct World {
    folder: TempDir,
    ports: [u16; 3],
    bridge: Running,
    simulators: Vec<Running>,
}

impl World {
    /// A bridge that serves the first of two vehicles; both fly.
    fn new() -> World {
        let folder = TempDir::new().expect("a folder");
        let ports = [0; 3].map(|_| free_udp_port());
        for index in [1_u8, 2] {
            write_key(&folder.path().join(format!("uav{index}.key")), &[index; 32]);
        }
        fs::write(folder.path().join("vsm.toml"), text(ports, 1)).expect("written");
        let config = folder.path().join("vsm.toml");
        let arguments = ["run".as_ref(), "--config".as_ref(), config.as_os_str()];
        let mut bridge = Running::start(&program("vsm"), arguments);
        bridge.wait_for("ready", Duration::from_secs(20));
        let simulators = [1_u8, 2].map(|index| {
            let key = folder.path().join(format!("uav{index}.key"));
            let link = format!("udpout:127.0.0.1:{}", ports[usize::from(index)]);
            let (key, index) = (key.display().to_string(), index.to_string());
            let options = ["--link", &link, "--key-file", &key, "--system-id", &index];
            Running::start(&program("px4-sim"), options)
        });
        World {
            folder,
            ports,
            bridge,
            simulators: simulators.into(),
        }
    }

    fn config(&self) -> PathBuf {
        self.folder.path().join("vsm.toml")
    }

    fn write(&self, text: &str) {
        fs::write(self.config(), text).expect("written");
    }

    fn vsm(&self, command: &str) -> Output {
        let mut vsm = Command::new(program("vsm"));
        vsm.arg(command).arg("--config").arg(self.config());
        vsm.arg("--json").output().expect("it runs")
    }

    fn status(&self) -> Value {
        serde_json::from_slice(&self.vsm("status").stdout).expect("JSON")
    }

    /// The report of `vsm reload`, and its status.
    fn reload(&self) -> (Value, Option<i32>) {
        let output = self.vsm("reload");
        let report = serde_json::from_slice(&output.stdout).expect("JSON");
        (report, output.status.code())
    }

    fn until(&self, what: &str, so: impl Fn(&Value) -> bool) {
        let end = Instant::now() + Duration::from_secs(20);
        while !so(&self.status()) {
            assert!(
                Instant::now() < end,
                "{what}: {}\n{}",
                self.status(),
                self.bridge.output()
            );
            sleep(Duration::from_millis(200));
        }
    }
}

fn text(ports: [u16; 3], vehicles: u8) -> String {
    let mut text = format!(
        "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:{}\"\n\
         [[cucs]]\nid = \"1b:00:00:a0\"\nloi = [2, 3, 4, 5]\n[store]\ndir = \"state\"\n",
        ports[0]
    );
    for index in 1..=vehicles {
        text += &format!(
            "[[vehicle]]\nid = \"1b:00:01:0{index}\"\nlink = \"udpin:127.0.0.1:{}\"\nsystem_id = {index}\n\
             signing = {{ key_file = \"uav{index}.key\" }}\n",
            ports[usize::from(index)]
        );
    }
    text
}

fn is_live(status: &Value, vehicle: usize) -> bool {
    status["vehicles"][vehicle]["link"]["state"] == "live"
}

#[test]
fn vehicles_come_and_go_while_the_others_fly_on() {
    let world = World::new();
    world.until("the first is live", |status| is_live(status, 0));
    let live = world.status()["vehicles"][0]["link"]["live_s"].as_f64();

    world.write(&text(world.ports, 2));
    let (report, code) = world.reload();
    assert_eq!(
        (report["applied"][0].as_str(), code),
        (Some("vehicle 1b:00:01:02 added"), Some(0))
    );
    world.until("both are live", |status| {
        is_live(status, 0) && is_live(status, 1)
    });
    // The signing clock, and the key's lock, of the new one are in the store.
    sleep(Duration::from_secs(1));
    let now = world.status()["vehicles"][0]["link"]["live_s"].as_f64();
    assert!(now > live, "the first has lost its link: {live:?}, {now:?}");

    world.write(&text(world.ports, 1));
    let (report, code) = world.reload();
    assert_eq!(
        (report["applied"][0].as_str(), code),
        (Some("vehicle 1b:00:01:02 removed"), Some(0))
    );
    assert_eq!(world.status()["vehicles"].as_array().map(Vec::len), Some(1));
    let end = Instant::now() + Duration::from_secs(5);
    while UdpSocket::bind(("127.0.0.1", world.ports[2])).is_err() {
        assert!(
            Instant::now() < end,
            "the link of the removed vehicle is still open"
        );
        sleep(Duration::from_millis(50));
    }
    assert!(is_live(&world.status(), 0));
    // And again, with the key and the port that were given back.
    world.write(&text(world.ports, 2));
    assert_eq!(world.reload().1, Some(0));
    world.until("both are live again", |status| {
        is_live(status, 0) && is_live(status, 1)
    });
    assert_eq!(world.simulators.len(), 2);
}

#[test]
fn a_bad_file_changes_nothing_and_is_named_by_the_command_and_in_the_log() {
    let mut world = World::new();
    world.until("the first is live", |status| is_live(status, 0));
    let good = text(world.ports, 1);

    world.write(&good.replace("loi = [2, 3, 4, 5]", "loi = [9]"));
    let (report, code) = world.reload();
    let why = report["refused"].as_str().expect("refused");
    assert!(
        why.contains("line 6") && why.contains("levels of interoperability from 2 to 5"),
        "{why}"
    );
    assert_eq!(code, Some(2));
    // A vehicle whose key is missing: nothing of the file counts, though the rest is good.
    let missing = text(world.ports, 2).replace("uav2.key", "uav9.key");
    world.write(&missing.replace("loi = [2, 3, 4, 5]", "loi = [2]"));
    let (report, _) = world.reload();
    let why = report["refused"].as_str().expect("refused");
    assert!(why.contains("uav9.key"), "{why}");
    assert_eq!(world.status()["vehicles"].as_array().map(Vec::len), Some(1));
    // Another program has the port.
    let taken = UdpSocket::bind(("127.0.0.1", world.ports[2])).expect("free");
    world.write(&text(world.ports, 2));
    let (report, _) = world.reload();
    let why = report["refused"].as_str().expect("refused");
    assert!(why.contains("cannot listen on vehicle.link"), "{why}");
    drop(taken);

    // As the service manager does it: the unit's own line fails where the file is refused, and is done where it is not.
    let unit =
        fs::read_to_string(kit::workspace().join("packaging/vsm.service")).expect("the unit");
    let line = unit
        .lines()
        .find_map(|line| line.strip_prefix("ExecReload="));
    let line = line.expect("ExecReload").split(' ').map(|word| match word {
        "/usr/bin/vsm" => program("vsm"),
        "/etc/vsm/vsm.toml" => world.config(),
        other => other.into(),
    });
    let words: Vec<PathBuf> = line.collect();
    for (text, succeeds) in [("[dli]\nvsm_id = 7\n", false), (&good, true)] {
        world.write(text);
        let output = Command::new(&words[0])
            .args(&words[1..])
            .output()
            .expect("it runs");
        assert_eq!(output.status.success(), succeeds, "{words:?}: {output:?}");
    }

    let id = world.bridge.id().to_string();
    let hang_up = |world: &World, text: &str| {
        world.write(text);
        let sent = Command::new("kill").args(["-HUP", &id]).status();
        assert!(sent.is_ok_and(|status| status.success()));
    };
    hang_up(&world, "[dli]\nvsm_id = 7\n");
    world.bridge.wait_for(
        "vsm.toml is refused, nothing has changed",
        Duration::from_secs(10),
    );
    let other = good.replace(
        &format!("127.0.0.1:{}\"\n[[cucs]]", world.ports[0]),
        "127.0.0.1:9\"\n[[cucs]]",
    );
    assert_ne!(other, good);
    hang_up(&world, &(other + "[authority]\nwarn_s = 4.0\n"));
    world
        .bridge
        .wait_for("read again: authority.warn_s", Duration::from_secs(10));
    world.bridge.wait_for(
        "these wait for a restart: dli.listen",
        Duration::from_secs(10),
    );
    assert!(is_live(&world.status(), 0));
}

#[test]
fn ground_stations_beside_the_bridge_come_and_go_and_no_key_is_used_twice() {
    let world = World::new();
    world.until("the first is live", |status| is_live(status, 0));
    let port = free_udp_port();
    let forward = |keys: &str| {
        format!("[[forward]]\nname = \"qgc\"\nlink = \"udpin:127.0.0.1:{port}\"\n{keys}")
    };
    world.write(&(text(world.ports, 1) + &forward("")));
    let (report, code) = world.reload();
    assert_eq!(
        (report["applied"][0].as_str(), code),
        (Some("forward qgc added"), Some(0))
    );
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    socket
        .set_read_timeout(Some(Duration::from_secs(10)))
        .expect("it can be set");
    let header = Header {
        system_id: 255,
        component_id: 190,
        ..Header::default()
    };
    let mut bytes = [0; MAX_FRAME];
    let beat = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
    let length = encode(&beat, header, &mut bytes);
    socket
        .send_to(&bytes[..length], ("127.0.0.1", port))
        .expect("sent");
    let (received, from) = socket.recv_from(&mut bytes).expect("frames of the vehicle");
    assert!(received > 0 && from.port() == port);

    // A vehicle is added whose key the ground station has: all of it is refused.
    write_key(&world.folder.path().join("q.key"), &[2; 32]);
    world.write(&(text(world.ports, 2) + &forward("key_file = \"q.key\"\n")));
    let (report, code) = world.reload();
    let refused = report["refused"].as_str().unwrap_or_default();
    assert!(
        code != Some(0) && refused.contains("[[forward]] qgc has the key"),
        "{report}"
    );
    assert_eq!(world.status()["vehicles"].as_array().map(Vec::len), Some(1));

    world.write(&text(world.ports, 1));
    let (report, _) = world.reload();
    assert_eq!(report["applied"][0], "forward qgc removed");
    let end = Instant::now() + Duration::from_secs(5);
    while UdpSocket::bind(("127.0.0.1", port)).is_err() {
        assert!(Instant::now() < end, "its link is still open");
        sleep(Duration::from_millis(50));
    }

    // The same over TCP.
    world.write(&(text(world.ports, 1) + &forward("").replace("udpin", "tcpin")));
    assert_eq!(world.reload().1, Some(0));
    let mut stream = TcpStream::connect(("127.0.0.1", port)).expect("it listens");
    stream
        .set_read_timeout(Some(Duration::from_secs(10)))
        .expect("it can be set");
    let length = encode(&beat, header, &mut bytes);
    stream.write_all(&bytes[..length]).expect("sent");
    assert!(stream.read(&mut bytes).expect("frames of the vehicle") > 0);
}

/// A pipe would keep its reader waiting until somebody writes to it.
#[test]
fn a_pipe_in_the_place_of_an_elevation_file_is_refused_at_once() {
    let world = World::new();
    let tiles = world.folder.path().join("tiles");
    fs::create_dir(&tiles).expect("made");
    let made = Command::new("mkfifo")
        .arg(tiles.join("N47E008.hgt"))
        .status();
    assert!(made.is_ok_and(|status| status.success()));
    let good = text(world.ports, 1);
    world.write(&good.replace("system_id = 1\n", "system_id = 1\nterrain = \"tiles\"\n"));
    let began = Instant::now();
    let (report, code) = world.reload();
    let why = report["refused"].as_str().expect("refused");
    assert!(
        why.contains("N47E008.hgt") && why.contains("expected a file"),
        "{why}"
    );
    assert_eq!(code, Some(2));
    assert!(began.elapsed() < Duration::from_secs(20));
}

#[test]
fn a_revoked_guard_key_ends_though_the_file_is_refused_and_the_refusal_stays_in_the_status() {
    let world = World::new();
    let key_file = world.folder.path().join("a0.key");
    write_key(&key_file, &[9; 32]);
    let guarded = text(world.ports, 1).replace(
        "loi = [2, 3, 4, 5]\n",
        "loi = [2, 3, 4, 5]\nguard = { key_file = \"a0.key\" }\n",
    );
    world.write(&guarded);
    assert_eq!(world.reload().1, Some(0));
    let in_force = || {
        let status = world.status();
        let key = status["stations"][0]["guard"]["key_id"].as_str();
        key.map(str::to_owned).expect("a guard key")
    };
    let is_found = |status: &Value| {
        let found = status["findings"].as_array().expect("a list");
        found.iter().any(|one| one["code"] == "reload")
    };
    let before = in_force();

    // The key is revoked, and the file has a mistake somewhere else.
    let mut revoke = Command::new(program("vsm"));
    let revoked = revoke.args(["guard", "revoke"]).arg(&key_file).output();
    assert!(revoked.is_ok_and(|done| done.status.success()));
    world.write(&guarded.replace("loi = [2, 3, 4, 5]", "loi = [9]"));
    let (report, code) = world.reload();
    assert_eq!(code, Some(2));
    assert!(report["refused"].is_string(), "{report}");
    let applied = report["applied"][0].as_str().unwrap_or_default();
    let begins = format!("cucs 1b:00:00:a0 guard key {before} -> ");
    assert!(applied.starts_with(&begins), "{report}");
    let after = in_force();
    assert_ne!(after, before);
    world.until("the refusal is found", is_found);

    // A key file that the bridge may not use: the key before it stays, and both ends say so.
    fs::set_permissions(&key_file, fs::Permissions::from_mode(0o644)).expect("set");
    let (report, _) = world.reload();
    let kept = report["kept"][0].as_str().unwrap_or_default();
    assert!(
        kept.contains(&format!("guard key {after} stays in force")) && kept.contains("chmod 600"),
        "{report}"
    );
    assert_eq!(in_force(), after);
    let printed = |words: &[&str]| {
        let mut vsm = Command::new(program("vsm"));
        let output = vsm.args(words).arg(world.config()).output();
        let output = output.expect("it runs");
        let both = [output.stdout, output.stderr].concat();
        String::from_utf8_lossy(&both).into_owned()
    };
    let text = printed(&["reload"]);
    assert!(
        text.contains("NOT APPLIED: cucs 1b:00:00:a0 guard key"),
        "{text}"
    );
    world.until("the key is found", |status| {
        status["findings"].to_string().contains("stays in force")
    });
    let text = printed(&["status"]);
    assert!(
        text.contains("FINDING: the last reload was refused") && text.contains("stays in force"),
        "{text}"
    );

    fs::set_permissions(&key_file, fs::Permissions::from_mode(0o600)).expect("set");
    world.write(&guarded);
    assert_eq!(world.reload().1, Some(0));
    world.until("the refusal is over", |status| !is_found(status));
}

#[test]
fn a_file_that_is_wrong_by_now_hides_no_running_bridge() {
    let mut world = World::new();
    world.write(&text(world.ports, 1).replace("loi = [2, 3, 4, 5]", "loi = [9]"));
    assert_eq!(world.reload().1, Some(2));
    let is_found = |report: &Value| report["findings"].to_string().contains("\"reload\"");
    world.until("the refusal is found", is_found);
    let config = world.config();
    let printed = |words: &[&str]| {
        let mut vsm = Command::new(program("vsm"));
        let output = vsm.args(words).arg(&config).output();
        let output = output.expect("it runs");
        let faults = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(faults.contains("2 to 5"), "{words:?}: {faults}");
        (
            output.status.code(),
            String::from_utf8_lossy(&output.stdout).into_owned(),
        )
    };
    for words in [&["status"][..], &["guard", "status"]] {
        let (code, text) = printed(words);
        assert_eq!(code, Some(0), "{words:?}");
        assert!(text.contains("CUCS 1b:00:00:a0"), "{words:?}: {text}");
    }
    let (code, text) = printed(&["doctor"]);
    assert_eq!(code, Some(2));
    assert!(text.contains("the last reload was refused"), "{text}");
    // Without a bridge there is the fault alone.
    world.bridge.kill();
    for words in [&["status"][..], &["guard", "status"], &["doctor"]] {
        let (code, text) = printed(words);
        assert_eq!((code, text.as_str()), (Some(2), ""), "{words:?}");
    }
}

/// The old key must not stay in force unseen where nobody reloads.
#[test]
fn a_guard_key_that_was_revoked_and_not_reloaded_is_a_finding() {
    let mut world = World::new();
    let key_file = world.folder.path().join("a0.key");
    write_key(&key_file, &[9; 32]);
    world.write(&text(world.ports, 1).replace(
        "loi = [2, 3, 4, 5]\n",
        "loi = [2, 3, 4, 5]\nguard = { key_file = \"a0.key\" }\n",
    ));
    assert_eq!(world.reload().1, Some(0));
    let mut revoke = Command::new(program("vsm"));
    let revoked = revoke.args(["guard", "revoke"]).arg(&key_file).output();
    assert!(revoked.is_ok_and(|done| done.status.success()));
    world
        .bridge
        .wait_for("which is not in force here", Duration::from_secs(40));
    assert_eq!(world.reload().1, Some(0));
    world.bridge.wait_for(
        "cleared: CUCS 1b:00:00:a0: its key file",
        Duration::from_secs(40),
    );
}
