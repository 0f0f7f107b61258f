//! `vsm guard pair` at both ends, by the commands of docs/guide/guard.md: a code, a line of configuration, a flight with status by the
//! group too, another key over the air in flight, and a guard that is locked out.

use std::fs;
use std::io::Write as _;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use kit::process::{Running, free_udp_port, program};
use vsm_tests::ground::Ground;

const LIMIT: Duration = Duration::from_secs(20);
const CUCS: &str = "1b:00:00:a0";

fn vsm(ground: &Ground, line: &str, typed: &str) -> Output {
    let mut command = Command::new(program("vsm"))
        .args(line.split(' '))
        .current_dir(ground.path(""))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program runs");
    let input = command.stdin.take();
    // It may end before it has read all.
    let _ = input.expect("a pipe").write_all(typed.as_bytes());
    command.wait_with_output().expect("it ends")
}

fn text(output: &Output) -> String {
    assert!(output.status.success(), "{output:?}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The word behind a name at the beginning of a line.
fn named<'a>(text: &'a str, name: &str) -> &'a str {
    let line = text.lines().find_map(|line| line.strip_prefix(name));
    line.unwrap_or_else(|| panic!("no {name} in {text}")).trim()
}

/// The program in the folder, as a process of its own.
fn start(ground: &Ground, line: &str) -> Running {
    let mut command = Command::new(program("vsm"));
    command.args(line.split(' ')).current_dir(ground.path(""));
    Running::spawn(&mut command)
}

#[test]
fn a_guard_is_paired_by_a_code_and_its_key_replaced_in_flight_without_a_copy() {
    let (ground, group) = Ground::in_group("");
    let _bridge = ground.bridge();
    let _aircraft = ground.aircraft();
    let dli = ground.dli();
    let asks =
        format!("guard pair --vsm {dli} --vsm-id 1b:00:00:01 --cucs {CUCS} --key-file copy.key");

    // Nobody pairs before a person has opened the window, and nobody without the code.
    let mut window = start(&ground, &format!("guard pair --cucs {CUCS}"));
    window.wait_for("the window is open", LIMIT);
    let shown = window.output();
    let code = named(&shown, "pairing code");
    let wrong = vsm(&ground, &format!("{asks} --wait-s 2"), &"A".repeat(32));
    assert!(!wrong.status.success(), "{wrong:?}");
    assert!(!ground.path("copy.key").exists());
    let second = vsm(&ground, &format!("guard pair --cucs {CUCS}"), "");
    assert!(
        String::from_utf8_lossy(&second.stdout).contains("refused: another"),
        "{second:?}"
    );

    let paired = text(&vsm(&ground, &asks, &format!("{code}\n")));
    window.wait_for("guard = {", LIMIT);
    let ended = window.wait(LIMIT).expect("it ends");
    let shown = window.output();
    assert!(ended.success(), "{shown}");
    assert!(
        shown.contains("pairing attempt with a wrong code"),
        "{shown}"
    );
    // Each shows the other's fingerprint.
    assert_eq!(named(&paired, "paired with"), named(&shown, "this VSM"));
    assert_eq!(named(&shown, "paired with"), named(&paired, "this guard"));

    let line = shown
        .lines()
        .find(|line| line.starts_with("guard = "))
        .expect("the line");
    let config = ground.path("vsm.toml");
    let before = fs::read_to_string(&config).expect("the configuration");
    fs::write(&config, before.replace("address = \"127.0.0.1\"", line)).expect("the configuration");
    let reloaded = text(&vsm(&ground, "reload", ""));
    assert!(reloaded.contains("guard key"), "{reloaded}");

    // The VSM's status shows with whom.
    let status = text(&vsm(&ground, "guard status", ""));
    let with = named(&paired, "this guard");
    assert!(status.contains(&format!("fingerprint {with}")), "{status}");

    let near = format!("127.0.0.1:{}", free_udp_port());
    let run = format!(
        "guard run --vsm {dli} --vsm-id 1b:00:00:01 --cucs {CUCS} --key-file copy.key --listen {near} --multicast {group} \
         --interface 127.0.0.1"
    );
    let mut guard = start(&ground, &run);
    guard.wait_for("ready", LIMIT);
    let cucs = |line: &str| {
        let done = Command::new(program("cucs"))
            .args(["--vsm", &near])
            .args(line.split(' '))
            .output()
            .expect("it runs");
        done.status.success().then_some(()).ok_or(done)
    };
    for line in [
        "discover",
        "take",
        "wait landed --within 30",
        "launch 30",
        "wait airborne",
    ] {
        cucs(line).unwrap_or_else(|done| panic!("{line}: {done:?}"));
    }
    guard.wait_for("the key of its group", LIMIT);

    // Another key, over the air and in the air.
    let rotated = text(&vsm(&ground, &format!("guard rotate --cucs {CUCS}"), ""));
    assert!(rotated.contains("in force"), "{rotated}");
    guard.wait_for("is in force", LIMIT);
    cucs("ping").expect("under the new key");
    // A restart of the guard: what it has agreed about is on its disk.
    guard.terminate();
    guard.wait(LIMIT).expect("it ends");
    let mut guard = start(&ground, &run);
    guard.wait_for("ready", LIMIT);
    for line in ["ping", "land", "wait landed --within 60", "release"] {
        cucs(line).unwrap_or_else(|done| panic!("{line}: {done:?}"));
    }

    // Locked out: the key and the pairing.
    let file = line.split('"').nth(1).expect("a path");
    text(&vsm(&ground, &format!("guard revoke {file}"), ""));
    text(&vsm(&ground, "reload", ""));
    assert!(cucs("ping").is_err(), "its key counts no more");
    let rotated = vsm(&ground, &format!("guard rotate --cucs {CUCS}"), "");
    assert!(!rotated.status.success(), "{rotated:?}");
    let said = String::from_utf8_lossy(&rotated.stdout);
    assert!(said.contains("is not paired"), "{said}");
    // Nothing that was shown has a key in it.
    for key in ["copy.key", file] {
        let key = fs::read_to_string(ground.path(key)).expect("a key");
        for shown in [&paired, &shown, &guard.output()] {
            assert!(!shown.contains(key.trim()), "{shown}");
        }
    }
}
