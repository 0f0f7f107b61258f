//! `vsm zeroize` on what real programs have written, the start that finds an order, and the secrets in what they print.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use kit::process::{Running, free_udp_port, program};
use tempfile::TempDir;

const BRIDGE: &str = r#"
[dli]
vsm_id = "1b:00:00:01"
listen = "127.0.0.1:0"
[[vehicle]]
id = "1b:00:01:01"
link = "udpin:127.0.0.1:0"
system_id = 1
signing = { key_file = "uav1.key" }
[record]
dir = "record"
[store]
dir = "state"
"#;

const AGENT: &str = r#"
[agent]
vehicle_id = "1b:00:01:01"
vsm_id = "1b:00:00:01"
key_file = "airside.key"
[radio]
link = "udpin:127.0.0.1:0"
[px4]
link = "serial:/dev/none:57600"
system_id = 1
[store]
dir = "state"
"#;

fn folder(name: &str, config: &str, key: &str) -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    fs::write(folder.path().join(name), config).expect("the configuration");
    let made = vsm(folder.path(), &["keygen", key]);
    assert!(made.status.success(), "{made:?}");
    folder
}

fn vsm(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(program("vsm"));
    command
        .args(arguments)
        .current_dir(folder)
        .stdin(Stdio::null());
    command.output().expect("vsm")
}

fn text(output: &Output) -> String {
    let both = [&output.stdout, &output.stderr];
    both.map(|one| String::from_utf8_lossy(one).into_owned())
        .concat()
}

/// Everything in a folder, by name.
fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("a folder");
    let mut names: Vec<String> = entries
        .map(|one| {
            one.expect("an entry")
                .file_name()
                .to_string_lossy()
                .into_owned()
        })
        .collect();
    names.sort();
    names
}

#[test]
fn what_a_bridge_has_written_is_listed_and_erased_once_it_is_confirmed() {
    let folder = folder("vsm.toml", BRIDGE, "uav1.key");
    let dir = folder.path();
    let key = fs::read_to_string(dir.join("uav1.key")).expect("the key");
    let mut bridge = Running::spawn(Command::new(program("vsm")).arg("run").current_dir(dir));
    bridge.wait_for("ready", LIMIT);
    bridge.terminate();
    assert!(bridge.wait(LIMIT).is_some());
    assert!(names(&dir.join("state")).contains(&"audit.key".to_owned()));
    assert_eq!(names(&dir.join("record")).len(), 2);
    // Nobody confirms.
    let refused = vsm(dir, &["zeroize"]);
    assert_eq!(refused.status.code(), Some(2), "{}", text(&refused));
    for part in [
        "uav1.key",
        "audit.key",
        "dli-",
        "nothing is erased",
        "1b:00:00:01",
    ] {
        assert!(text(&refused).contains(part), "{part}: {}", text(&refused));
    }
    assert_eq!(
        fs::read_to_string(dir.join("uav1.key")).expect("the key"),
        key
    );

    let done = vsm(dir, &["zeroize", "--yes"]);
    assert!(done.status.success(), "{}", text(&done));
    for part in ["wear levelling", "mavlink-signing-key.bin", "backups"] {
        assert!(text(&done).contains(part), "{part}: {}", text(&done));
    }
    assert!(!text(&done).contains(key.trim()));
    assert_eq!(names(&dir.join("state")), ["lock", "zeroized"]);
    assert_eq!(names(&dir.join("record")), [""; 0]);
    assert_eq!(names(dir), ["record", "state", "uav1.key.lock", "vsm.toml"]);
    // What is gone is not served, and a bridge with a new key is, once a person has cleared it.
    let cleared = vsm(dir, &["zeroize", "--clear"]);
    assert!(cleared.status.success(), "{}", text(&cleared));
    let refused = vsm(dir, &["run"]);
    assert!(
        text(&refused).contains("there is no key file"),
        "{}",
        text(&refused)
    );
    assert!(vsm(dir, &["keygen", "uav1.key"]).status.success());
    // A recording of somebody else's is left, and that is no failure.
    let theirs = dir.join("record/1b000101-1.tlog");
    fs::write(&theirs, "theirs").expect("a recording");
    let given = std::os::unix::fs::chown(&theirs, Some(12_345), None).is_ok();
    let again = vsm(dir, &["zeroize", "--config", "vsm.toml", "--yes"]);
    assert!(again.status.success(), "{}", text(&again));
    let erased = if given {
        "erased 1 files"
    } else {
        "erased 2 files"
    };
    assert!(text(&again).contains(erased), "{}", text(&again));
    assert_eq!(given, theirs.exists());
}

#[test]
fn a_start_that_finds_an_order_finishes_it_and_serves_nothing() {
    for (name, config, key, command) in [
        ("vsm.toml", BRIDGE, "uav1.key", "run"),
        ("airside.toml", AGENT, "airside.key", "airside"),
    ] {
        let folder = folder(name, config, key);
        let dir = folder.path();
        fs::create_dir(dir.join("state")).expect("the store");
        let private = fs::Permissions::from_mode(0o700);
        fs::set_permissions(dir.join("state"), private).expect("its mode");
        fs::write(dir.join("state/exchange-identity"), "5a".repeat(32)).expect("a secret");
        // As a power cut leaves it, just after the order was stored; an earlier version wrote no more.
        let mut order = serde_json::json!({
            "keys": [dir.join(key)], "recordings": null, "keep_audit": false
        });
        fs::write(dir.join("state/zeroize.order"), order.to_string()).expect("an order");
        let ended = vsm(dir, &[command]);
        assert!(!text(&ended).contains("NOT reached"), "{}", text(&ended));
        assert_eq!(ended.status.code(), Some(3), "{}", text(&ended));
        assert!(
            text(&ended).contains("nothing is served"),
            "{}",
            text(&ended)
        );
        assert!(!text(&ended).contains("ready"), "{}", text(&ended));
        assert!(!dir.join(key).exists());
        assert_eq!(names(&dir.join("state")), ["lock", "zeroized"]);
        // Each later start, too, until a person clears it: by then another process may have finished it.
        let ended = vsm(dir, &[command]);
        assert_eq!(ended.status.code(), Some(3), "{}", text(&ended));
        assert!(text(&ended).contains("--clear"), "{}", text(&ended));
        // By the other way, too, and after what is beyond this computer has been tried: once, so that nobody keeps the keys by
        // cutting the power again and again.
        for (beyond, tries) in [("Due", name == "airside.toml"), ("Tried", false)] {
            fs::write(dir.join("state/exchange-identity"), "5a".repeat(32)).expect("a secret");
            order["beyond"] = beyond.into();
            fs::write(dir.join("state/zeroize.order"), order.to_string()).expect("an order");
            let ended = vsm(dir, &[command]);
            let printed = text(&ended);
            assert_eq!(ended.status.code(), Some(3), "{printed}");
            // The line to PX4 cannot be opened here.
            assert_eq!(printed.contains("PX4 was NOT reached"), tries, "{printed}");
            assert_eq!(names(&dir.join("state")), ["lock", "zeroized"]);
        }
        fs::write(dir.join("state/exchange-identity"), "5a".repeat(32)).expect("a secret");
        fs::write(dir.join("state/zeroize.order"), order.to_string()).expect("an order");
        let ended = vsm(dir, &["zeroize", name]);
        assert!(
            text(&ended).contains("finished an earlier zeroize"),
            "{}",
            text(&ended)
        );
        assert_eq!(names(&dir.join("state")), ["lock", "zeroized"]);
    }
}

/// Starts it, and waits until it serves.
fn serving(dir: &Path, name: &str, command: &str) -> Running {
    let mut running = Running::spawn(
        Command::new(program("vsm"))
            .args([command, name])
            .current_dir(dir),
    );
    running.wait_for("ready", LIMIT);
    running
}

/// It has ended by itself, and left neither files nor a secret in its log.
fn has_erased_itself(dir: &Path, mut running: Running, key: &str) {
    let status = running.wait(LIMIT).expect("it ends");
    let log = running.output();
    assert_eq!(status.code(), Some(3), "{log}");
    assert!(log.contains("ZEROIZE ORDERED by"), "{log}");
    assert!(!log.contains(key.trim()), "{log}");
    assert_eq!(names(&dir.join("state")), ["lock", "zeroized"]);
    assert!(names(dir).iter().all(|name| !name.ends_with(".key")));
}

#[test]
fn a_running_bridge_and_a_running_agent_erase_themselves_and_end() {
    let agent = AGENT
        .replace("127.0.0.1:0", &format!("127.0.0.1:{}", free_udp_port()))
        .replace(
            "serial:/dev/none:57600",
            &format!("udpin:127.0.0.1:{}", free_udp_port()),
        );
    for (name, config, key, command) in [
        ("vsm.toml", BRIDGE, "uav1.key", "run"),
        ("airside.toml", &agent, "airside.key", "airside"),
    ] {
        let folder = folder(name, config, key);
        let dir = folder.path();
        let secret = fs::read_to_string(dir.join(key)).expect("the key");
        let running = serving(dir, name, command);
        // Nothing is received of the vehicle: it may fly.
        let refused = vsm(dir, &["zeroize", name, "--yes"]);
        assert_eq!(refused.status.code(), Some(1), "{}", text(&refused));
        assert!(
            text(&refused).contains("not known to be disarmed"),
            "{}",
            text(&refused)
        );
        assert!(dir.join(key).exists());
        let done = vsm(dir, &["zeroize", name, "--yes", "--in-flight"]);
        assert!(
            done.status.success(),
            "{}\n{}",
            text(&done),
            running.output()
        );
        assert!(text(&done).contains("wear levelling"), "{}", text(&done));
        has_erased_itself(dir, running, &secret);
    }
}

#[test]
fn a_cucs_with_loi_5_has_a_bridge_erase_itself_in_two_steps() {
    let dli = format!("127.0.0.1:{}", free_udp_port());
    let config = BRIDGE.replacen("127.0.0.1:0", &dli, 1)
        + "[[cucs]]\nid = \"1b:00:00:a0\"\nloi = [2, 3, 4, 5]\n[zeroize]\nby_message = true\nin_flight = true\n";
    let folder = folder("vsm.toml", &config, "uav1.key");
    let dir = folder.path();
    let secret = fs::read_to_string(dir.join("uav1.key")).expect("the key");
    let running = serving(dir, "vsm.toml", "run");
    let script = "take\nzeroize arm\nzeroize execute\n";
    fs::write(dir.join("lines.cucs"), script).expect("the script");
    let mut cucs = Command::new(program("cucs"));
    cucs.args(["--vsm", &dli, "script", "lines.cucs"])
        .current_dir(dir);
    let ordered = cucs.output().expect("cucs");
    let printed = text(&ordered);
    assert!(ordered.status.success(), "{printed}\n{}", running.output());
    assert!(printed.contains("zeroize executed"), "{printed}");
    has_erased_itself(dir, running, &secret);
}

const LIMIT: Duration = Duration::from_secs(30);
