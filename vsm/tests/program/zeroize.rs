//! `vsm zeroize` on what real programs have written, the start that finds an order, and the secrets in what they print.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use kit::process::{Running, program};
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
    assert_eq!(names(&dir.join("state")), ["lock"]);
    assert_eq!(names(&dir.join("record")), [""; 0]);
    assert_eq!(names(dir), ["record", "state", "uav1.key.lock", "vsm.toml"]);
    // What is gone is not served, and a bridge with a new key is.
    let refused = vsm(dir, &["run"]);
    assert!(
        text(&refused).contains("there is no key file"),
        "{}",
        text(&refused)
    );
    assert!(vsm(dir, &["keygen", "uav1.key"]).status.success());
    let again = vsm(dir, &["zeroize", "--config", "vsm.toml", "--yes"]);
    assert!(text(&again).contains("erased 1 files"), "{}", text(&again));
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
        // As a power cut leaves it, just after the order was stored.
        let order = serde_json::json!({
            "keys": [dir.join(key)], "recordings": null, "keep_audit": false
        });
        fs::write(dir.join("state/zeroize.order"), order.to_string()).expect("an order");
        let ended = vsm(dir, &[command]);
        assert_eq!(ended.status.code(), Some(3), "{}", text(&ended));
        assert!(
            text(&ended).contains("nothing is served"),
            "{}",
            text(&ended)
        );
        assert!(!text(&ended).contains("ready"), "{}", text(&ended));
        assert!(!dir.join(key).exists());
        assert_eq!(names(&dir.join("state")), ["lock"]);
        // By the other way, too.
        fs::write(dir.join("state/exchange-identity"), "5a".repeat(32)).expect("a secret");
        fs::write(dir.join("state/zeroize.order"), order.to_string()).expect("an order");
        let ended = vsm(dir, &["zeroize", name]);
        assert!(
            text(&ended).contains("finished an earlier zeroize"),
            "{}",
            text(&ended)
        );
        assert_eq!(names(&dir.join("state")), ["lock"]);
    }
}

const LIMIT: Duration = Duration::from_secs(30);
