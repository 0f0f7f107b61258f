//! `vsm init`: from nothing to a flight; what it asks, what it refuses, and what it writes.

use std::fs::{self, File};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use kit::process::{Running, free_udp_port, program};
use kit::serial::Device;

fn vsm(folder: &Path, words: &str) -> Output {
    let mut command = Command::new(program("vsm"));
    command.args(words.split_whitespace()).current_dir(folder);
    command.stdin(Stdio::null()).output().expect("vsm")
}

fn done(folder: &Path, words: &str) -> String {
    let output = vsm(folder, words);
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(output.status.success(), "{words}: {}", text(&output.stderr));
    text(&output.stdout)
}

/// The reason, of a command line or a file that is wrong.
fn refused(folder: &Path, words: &str) -> String {
    let output = vsm(folder, words);
    assert_eq!(output.status.code(), Some(2), "{words}");
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn mode(path: &Path) -> u32 {
    let metadata = fs::metadata(path).expect("the file");
    metadata.permissions().mode() & 0o777
}

#[test]
fn init_run_fly() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let (dli, mavlink) = (free_udp_port(), free_udp_port());
    let printed = done(
        folder,
        &format!("init --sitl --listen 127.0.0.1:{dli} --link udpin:127.0.0.1:{mavlink}"),
    );
    assert!(done(folder, "check-config").contains("signed, key id"));

    // The commands that it prints are those that fly.
    let mut running = Vec::new();
    for name in ["vsm run", "px4-sim"] {
        let line = printed
            .lines()
            .map(str::trim)
            .find(|line| line.contains(&format!("/{name}")));
        // Each with the folder in which vsm was found: where it is built, none of them is found by its name.
        let words: Vec<&str> = line.expect(name).split(' ').collect();
        let mut command = Command::new(words[0]);
        let mut started = Running::spawn(command.args(&words[1..]).current_dir(folder));
        started.wait_for("ready", Duration::from_secs(10));
        running.push(started);
    }
    let last = printed.lines().last().expect("the ground station").trim();
    let (cucs, options) = last.split_once(" discover ").expect(last);
    for verb in [
        "discover",
        "take",
        "launch 10",
        "wait airborne",
        "land",
        "wait landed",
        "release",
    ] {
        let words = format!("{options} {verb}");
        // Until PX4 has booted it refuses, with its reason: who types takes longer than that.
        let end = Instant::now() + Duration::from_secs(60);
        loop {
            let mut cucs = Command::new(cucs);
            let output = cucs.args(words.split(' ')).output().expect("cucs");
            if output.status.success() {
                break;
            }
            let reason = String::from_utf8_lossy(&output.stderr);
            let late = Instant::now() > end;
            assert!(!late, "{verb}: {reason}\n{}", running[0].output());
            std::thread::sleep(Duration::from_millis(500));
        }
    }
    // PX4's own file holds the key of the bridge, and only its owner reads either.
    let (key, px4) = (
        folder.join("uav1.key"),
        folder.join("mavlink/mavlink-signing-key.bin"),
    );
    assert_eq!((mode(&key), mode(&px4)), (0o600, 0o600));
    let px4 = fs::read(px4).expect("PX4's key");
    let key = fs::read_to_string(key).expect("the key");
    assert_eq!(
        (px4.len(), kit::process::hex(&px4[..32])),
        (40, key.trim().to_owned())
    );
}

#[test]
fn nothing_is_overwritten() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    done(folder, "init --sitl fly/vsm.toml");
    let there = [
        "fly/vsm.toml",
        "fly/uav1.key",
        "fly/mavlink/mavlink-signing-key.bin",
    ];
    let before = there.map(|name| fs::read(folder.join(name)).expect(name));
    for name in there {
        // Each alone is enough.
        for other in there.iter().filter(|other| **other != name) {
            fs::rename(folder.join(other), folder.join("aside")).expect("moved");
            let reason = refused(folder, "init --sitl --config fly/vsm.toml");
            assert!(
                reason.contains("exists") && reason.contains("another folder"),
                "{reason}"
            );
            fs::rename(folder.join("aside"), folder.join(other)).expect("moved back");
        }
    }
    assert_eq!(
        there.map(|name| fs::read(folder.join(name)).expect(name)),
        before
    );
    done(folder, "init --sitl other/vsm.toml");
}

#[test]
fn without_a_terminal_what_decides_over_an_aircraft_is_an_option() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let options = [
        "--link serial:/dev/ttyUSB0:57600",
        "--vehicle-id 1b:00:01:07",
        "--cucs-id 1b:00:00:b0",
        "--airframe plane",
    ];
    for missing in options {
        let given: Vec<&str> = options.into_iter().filter(|one| *one != missing).collect();
        let reason = refused(folder, &format!("init {}", given.join(" ")));
        let name = missing.split(' ').next().expect("a name");
        assert!(
            reason.contains(name) && reason.contains("--sitl"),
            "{reason}"
        );
    }
    for (wrong, expected) in [
        ("--link tcp:1.2.3.4:5", "udpin:ADDRESS:PORT"),
        (
            "--vehicle-id 1b:00",
            "2 bytes, expected 4 as in 1b:00:00:01",
        ),
        (
            "--vehicle-id 1b:00:00:a0",
            "an id that nothing else in this file has",
        ),
        ("--cucs-id ff:00:00:01", "ff is reserved"),
        ("--airframe car", "quad, plane, vtol"),
    ] {
        let reason = refused(folder, &format!("init --sitl {wrong}"));
        assert!(reason.contains(expected), "{wrong}: {reason}");
    }
    assert_eq!(fs::read_dir(folder).expect("the folder").count(), 0);

    let printed = done(folder, &format!("init {}", options.join(" ")));
    assert!(
        printed.contains("vsm key provision --sitl-file SDCARD"),
        "{printed}"
    );
    assert!(
        printed.contains("cucs discover --id 1b:00:00:b0"),
        "{printed}"
    );
    let checked = done(folder, "check-config");
    assert!(
        checked.contains("1b:00:01:07") && checked.contains("/dev/ttyUSB0"),
        "{checked}"
    );
    // The command that it prints for the card does what it says.
    done(folder, "key provision --sitl-file card.bin");
    assert_eq!(
        fs::read(folder.join("card.bin")).expect("the card's").len(),
        40
    );
}

#[test]
fn on_a_terminal_it_asks() {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let mut terminal = Device::new();
    let mut child = Command::new(program("vsm"));
    child.arg("init").current_dir(folder).stdout(Stdio::piped());
    let child = child.stdin(File::open(&terminal.name).expect("the terminal"));
    let child = child.spawn().expect("vsm");
    terminal.port.write(b"sitl\n\n1b:00:00:b0\nquad\n");
    let output = child.wait_with_output().expect("its end");
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{printed}");
    assert!(
        printed.contains("ground station (CUCS)") && printed.contains("[1b:00:00:a0]"),
        "{printed}"
    );
    assert!(done(folder, "check-config").contains("CUCS 1b:00:00:b0"));
}
