//! `vsm files` beside a running `vsm run` and a simulated vehicle: each verb, a transfer that is continued, and what is refused.

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use kit::process::{Running, free_udp_port, program, write_key};
use serde_json::Value;
use tempfile::TempDir;

struct World {
    folder: TempDir,
    // Ended with the test, in this order.
    _vehicle: Running,
    _bridge: Running,
}

impl World {
    fn new(log: &[u8]) -> World {
        let folder = TempDir::new().expect("a folder");
        let [dli, link] = [0; 2].map(|_| free_udp_port());
        write_key(&folder.path().join("uav1.key"), &[1; 32]);
        let config = format!(
            "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:{dli}\"\n\
             [[vehicle]]\nid = \"1b:00:01:01\"\nlink = \"udpin:127.0.0.1:{link}\"\nsystem_id = 1\n\
             signing = {{ key_file = \"uav1.key\" }}\n[store]\ndir = \"state\"\n"
        );
        fs::write(folder.path().join("vsm.toml"), config).expect("written");
        let logs = folder.path().join("card/fs/microsd/log");
        fs::create_dir_all(&logs).expect("made");
        fs::write(logs.join("a.ulg"), log).expect("written");
        let spawn = |name: &str, words: &str| {
            let mut command = Command::new(program(name));
            Running::spawn(command.args(words.split(' ')).current_dir(folder.path()))
        };
        let mut bridge = spawn("vsm", "run");
        bridge.wait_for("ready", LIMIT);
        let words = format!("--link udpout:127.0.0.1:{link} --key-file uav1.key --files card");
        let mut vehicle = spawn("px4-sim", &words);
        vehicle.wait_for("ready", LIMIT);
        let world = World {
            folder,
            _vehicle: vehicle,
            _bridge: bridge,
        };
        let end = Instant::now() + LIMIT;
        while !world.files("ls").status.success() {
            assert!(Instant::now() < end, "{}", text(&world.files("ls")));
            std::thread::sleep(Duration::from_millis(100));
        }
        world
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn files(&self, words: &str) -> Output {
        let mut command = Command::new(program("vsm"));
        command
            .arg("files")
            .args(words.split(' '))
            .current_dir(self.folder.path());
        command.output().expect("it runs")
    }

    fn done(&self, words: &str) -> String {
        let output = self.files(words);
        assert!(output.status.success(), "{words}: {}", text(&output));
        String::from_utf8(output.stdout).expect("text")
    }

    fn refused(&self, words: &str, status: i32, why: &str) {
        let output = self.files(words);
        assert_eq!(
            output.status.code(),
            Some(status),
            "{words}: {}",
            text(&output)
        );
        assert!(text(&output).contains(why), "{words}: {}", text(&output));
    }
}

fn text(output: &Output) -> String {
    let both = [output.stdout.as_slice(), &output.stderr].concat();
    String::from_utf8_lossy(&both).into_owned()
}

#[test]
fn files_are_listed_read_written_and_removed_through_the_running_bridge() {
    let log: Vec<u8> = (0..700_000_u32).map(|at| ((at * 31) >> 3) as u8).collect();
    let world = World::new(&log);
    assert!(world.done("ls @MAV_LOG").contains("700000  a.ulg"));
    let listed: Value = serde_json::from_str(&world.done("ls /fs/microsd --json")).expect("JSON");
    assert_eq!(listed[0]["name"], "log");

    // What an earlier transfer has left is continued.
    fs::write(world.path("a.ulg.part"), &log[..400_000]).expect("written");
    let report = world.done("get @MAV_LOG/a.ulg --json");
    let report: Value = serde_json::from_str(&report).expect("JSON");
    assert_eq!(
        (&report["bytes"], &report["continued_at"]),
        (&700_000.into(), &400_000.into())
    );
    assert!(fs::read(world.path("a.ulg")).expect("the file") == log);
    assert!(!world.path("a.ulg.part").exists());
    world.refused("get @MAV_LOG/a.ulg", 2, "is there already");

    // What it has left belongs to another file: found out at the end, and not kept.
    fs::write(world.path("b.ulg.part"), vec![0; 1_000]).expect("written");
    world.refused(
        "get @MAV_LOG/a.ulg b.ulg",
        1,
        "transfer it again from its beginning",
    );
    assert!(!world.path("b.ulg").exists() && !world.path("b.ulg.part").exists());
    world.done("get @MAV_LOG/a.ulg b.ulg");
    assert!(fs::read(world.path("b.ulg")).expect("the file") == log);

    world.done("mkdir /fs/microsd/etc");
    fs::write(world.path("rc.txt"), "set X 1\n").expect("written");
    world.done("put rc.txt /fs/microsd/etc/");
    world.done("get /fs/microsd/etc/rc.txt again.txt");
    assert_eq!(
        fs::read_to_string(world.path("again.txt")).expect("the file"),
        "set X 1\n"
    );
    world.refused("rm /fs/microsd/etc --folder", 1, "not empty");
    world.done("rm /fs/microsd/etc/rc.txt");
    world.done("rm /fs/microsd/etc --folder");
    world.refused(
        "get /fs/microsd/etc/rc.txt gone.txt",
        1,
        "no such file or folder",
    );
    world.refused("get /fs/microsd/../etc/passwd", 2, "has a component \"..\"");
    world.refused(
        "get /fs/microsd/mavlink/mavlink-signing-key.bin",
        1,
        "vsm key",
    );
    world.refused("put rc.txt /etc/init.d/rcS", 1, "read-only");
    world.refused("ls --vehicle 1b:00:01:09", 1, "expected one of 1b:00:01:01");
}

const LIMIT: Duration = Duration::from_secs(30);
