//! `vsm guard` between `cucs` and `vsm run`: a flight from discovery to release, after a restart of the bridge and of the guard,
//! under a key that was rotated, by an access list that is renewed for that key; and nothing without them.

use std::fs;
use std::process::{Command, Output};
use std::time::Duration;

use serde_json::Value;

use kit::process::{Running, filter, free_udp_port, program};
use vsm_tests::ground::Ground;

fn run(ground: &Ground, name: &str, arguments: &[&str]) -> Output {
    Command::new(program(name))
        .args(arguments)
        .current_dir(ground.path(""))
        .output()
        .expect("the program runs")
}

fn guard(ground: &Ground, listen: &str) -> Running {
    let key = ground.path("copy.key").display().to_string();
    let store = ground.path("guard-state").display().to_string();
    let dli = ground.dli();
    let arguments = [
        "guard",
        "run",
        "--cucs",
        "1b:00:00:a0",
        "--vsm-id",
        "1b:00:00:01",
        "--vsm",
        &dli,
        "--listen",
        listen,
        "--key-file",
        &key,
        "--store",
        &store,
    ];
    let mut guard = Running::start(&program("vsm"), arguments);
    guard.wait_for("ready", Duration::from_secs(10));
    guard
}

/// Has the access list give this guard key everything, and signs it.
fn grant(ground: &Ground, made: &Output) {
    let text = String::from_utf8_lossy(&made.stdout).into_owned();
    let id = text.split("id ").nth(1).expect("the id of a key");
    let id = id.get(..16).expect("16 digits");
    let grant = "access grant access.list --vsm-id 1b:00:00:01 --cucs 1b:00:00:a0 --vehicle 1b:00:01:01 --until never \
                 --groups payload,fly,launch --guard-key";
    let mut grant: Vec<&str> = grant.split_whitespace().collect();
    grant.push(id);
    let sign = ["access", "sign", "access.list", "--key-file", "access.key"];
    for line in [&grant[..], &sign] {
        let done = run(ground, "vsm", line);
        assert!(done.status.success(), "{line:?}: {done:?}");
    }
}

#[test]
fn a_guarded_station_flies_and_its_id_is_worth_nothing_without_the_key() {
    let ground = Ground::new();
    let config = ground.path("vsm.toml");
    let text = fs::read_to_string(&config).expect("the configuration");
    let text = text.replace(
        "address = \"127.0.0.1\"",
        "guard = { key_file = \"a0.key\" }",
    );
    let access = "[access]\nlist = \"access.list\"\nkey_file = \"access.key\"\n";
    fs::write(&config, text + access).expect("the configuration");
    let access_key = run(&ground, "vsm", &["keygen", "access.key"]);
    assert!(access_key.status.success(), "{access_key:?}");
    let keygen = run(&ground, "vsm", &["guard", "keygen", "a0.key"]);
    assert!(keygen.status.success(), "{keygen:?}");
    fs::copy(ground.path("a0.key"), ground.path("copy.key")).expect("the other end's");
    grant(&ground, &keygen);

    let bridge = ground.bridge();
    let _aircraft = ground.aircraft();
    let near = format!("127.0.0.1:{}", free_udp_port());
    let first = guard(&ground, &near);
    let cucs = |line: &str| {
        let words = line.split(' ');
        let verb: Vec<&str> = ["--vsm", &near].into_iter().chain(words).collect();
        let done = run(&ground, "cucs", &verb);
        assert!(done.status.success(), "{line}: {done:?}");
    };
    for line in [
        "discover",
        "take",
        "wait landed --within 30",
        "launch 30",
        "wait airborne",
    ] {
        cucs(line);
    }

    // The id without the key: not even discovered.
    let dli = ground.dli();
    let forged = run(&ground, "cucs", &["--vsm", &dli, "discover"]);
    assert!(!forged.status.success(), "{forged:?}");

    // In flight: another key, a restart of the bridge, and one of the guard.
    let rotated = run(&ground, "vsm", &["guard", "rotate", "a0.key"]);
    assert!(rotated.status.success(), "{rotated:?}");
    grant(&ground, &rotated);
    let reloaded = run(&ground, "vsm", &["reload"]);
    assert!(reloaded.status.success(), "{reloaded:?}");
    let text = String::from_utf8_lossy(&reloaded.stdout);
    assert!(text.contains("access list version 1 -> 2"), "{text}");
    cucs("ping");
    drop(bridge);
    let _bridge = ground.bridge();
    cucs("ping");
    drop(first);
    fs::copy(ground.path("a0.key"), ground.path("copy.key")).expect("the other end's");
    let second = guard(&ground, &near);
    for line in ["ping", "land", "wait landed --within 60", "release"] {
        cucs(line);
    }

    let arguments = [
        "status",
        "--json",
        "--config",
        &config.display().to_string(),
    ]
    .map(String::from);
    let status = filter(&program("vsm"), &arguments, String::new());
    let status: Value = serde_json::from_str(&status).expect("a status in JSON");
    let shown = &status["stations"][0]["guard"];
    assert!(shown["verified"].as_u64() > Some(3), "{shown}");
    assert_eq!(shown["uses_previous"], false, "{shown}");
    assert!(shown["previous_key_id"].is_string(), "{shown}");
    assert_eq!(status["access"]["version"], 2, "{status}");
    for file in ["a0.key", "access.key"] {
        let key = fs::read_to_string(ground.path(file)).expect("the key");
        for text in [status.to_string(), second.output()] {
            assert!(!text.contains(key.trim()), "{text}");
        }
    }
}
