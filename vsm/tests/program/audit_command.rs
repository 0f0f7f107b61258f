//! `vsm audit` on a real store: verifies, names what is wrong by its exit status too, and prints the logs.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use kit::process::program;
use mavlink_link::Now;
use vsm::config::Config;
use vsm::session::{AuditKey, Bridge, Chain, Entry, LinkEnd};
use vsm::shell::disk::FileDisk;
use vsm::shell::key_file::system_random;

const CONFIG: &str = r#"
[dli]
vsm_id = "1b:00:00:01"
listen = "127.0.0.1:4586"
[[vehicle]]
id = "1b:00:01:01"
link = "udpin:127.0.0.1:14550"
system_id = 1
signing = "off"
[store]
dir = "state"
"#;

/// A start of the bridge: one line, `started`.
fn start(folder: &Path) {
    let config = Config::parse(CONFIG, folder).unwrap();
    let mut disk = FileDisk::open(&folder.join("state")).unwrap();
    AuditKey::load_or_make(&mut disk, &mut system_random).unwrap();
    let now = Now {
        mono: Duration::ZERO,
        wall: Duration::from_secs(1_795_219_200),
    };
    let end = LinkEnd {
        key: None,
        peer: None,
    };
    Bridge::new(&config, vec![end], now, Duration::ZERO, &mut disk).unwrap();
}

fn done(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(program("vsm"));
    command.arg("audit").args(arguments).arg("--config");
    command.arg(folder.join("vsm.toml")).output().unwrap()
}

/// Its exit status, and what it prints.
fn audit(folder: &Path, arguments: &[&str]) -> (i32, String) {
    let done = done(folder, arguments);
    let text = String::from_utf8(done.stdout).unwrap();
    (done.status.code().unwrap(), text)
}

#[test]
fn the_audit_logs_are_verified_and_printed() {
    let folder = tempfile::tempdir().unwrap();
    let (folder, log) = (folder.path(), "state/audit-1b000101.log");
    fs::write(folder.join("vsm.toml"), CONFIG).unwrap();
    start(folder);
    let key = fs::metadata(folder.join("state/audit.key")).unwrap();
    assert_eq!(key.permissions().mode() & 0o777, 0o600);
    let (status, text) = audit(folder, &["verify"]);
    assert_eq!(status, 0, "{text}");
    let head = text
        .lines()
        .find_map(|line| line.rsplit_once("head "))
        .unwrap()
        .1
        .to_owned();
    let earlier = fs::read(folder.join(log)).unwrap();
    let record = fs::read(folder.join("state/authority-1b000101.json")).unwrap();
    start(folder);
    let (status, text) = audit(folder, &["verify", "--head", &head]);
    assert_eq!(status, 0, "{text}");
    let head = text
        .lines()
        .find_map(|line| line.rsplit_once("head "))
        .unwrap()
        .1
        .to_owned();

    let (status, json) = audit(folder, &["export"]);
    assert_eq!((status, json.lines().count()), (0, 3), "{json}");
    let row: serde_json::Value = serde_json::from_str(json.lines().last().unwrap()).unwrap();
    assert_eq!(
        (&row["what"], &row["log"]),
        (&"started".into(), &"control".into())
    );
    let (_, csv) = audit(
        folder,
        &["export", "--format", "csv", "--vehicle", "1b:00:01:01"],
    );
    assert!(csv.starts_with("log,line,time_ms,vehicle,what,"), "{csv}");
    assert_eq!(csv.lines().count(), 4);
    // Of a vehicle that there is not nothing is printed, not even a head.
    let other = ["export", "--format", "csv", "--vehicle", "1b:00:01:77"];
    let other = done(folder, &other);
    let text = String::from_utf8_lossy(&other.stderr);
    assert_eq!((other.status.code(), other.stdout.len()), (Some(2), 0));
    assert!(
        text.contains("1b:00:01:77 is not in the configuration")
            && text.contains("its vehicles: 1b:00:01:01"),
        "{text}"
    );

    // An older copy of the log, then of the whole folder: the latter is known by a head that was kept elsewhere.
    fs::write(folder.join(log), &earlier).unwrap();
    let (status, text) = audit(folder, &["verify"]);
    assert_eq!(status, 1);
    assert!(text.contains("it is an older copy"), "{text}");
    // A start finds it, continues, and leaves that in the log.
    start(folder);
    let (status, text) = audit(folder, &["verify"]);
    assert!(
        status == 1 && text.contains("line 3: a start of the VSM found"),
        "{text}"
    );
    let seen = text
        .lines()
        .find_map(|line| line.rsplit_once("head "))
        .unwrap()
        .1
        .to_owned();
    assert_eq!(audit(folder, &["verify", "--head", &seen]).0, 0);
    fs::write(folder.join(log), &earlier).unwrap();
    fs::write(folder.join("state/authority-1b000101.json"), record).unwrap();
    assert_eq!(audit(folder, &["verify"]).0, 0);
    let (status, text) = audit(folder, &["verify", "--head", &head]);
    assert!(
        status == 1 && text.contains("no log has the line"),
        "{text}"
    );
    // Its digits alone are no line, behind which whatever a crash may have left.
    for torn in [" {", " {\n", " {}", ""] {
        let with = [&*earlier, head.as_bytes(), torn.as_bytes()].concat();
        fs::write(folder.join(log), with).unwrap();
        let (status, text) = audit(folder, &["verify", "--head", &head]);
        assert!(
            status == 1 && text.contains("no log has the line"),
            "{torn:?}: {text}"
        );
    }
    fs::remove_file(folder.join(log)).unwrap();
    let (status, text) = audit(folder, &["verify"]);
    assert!(status == 1 && text.contains("is deleted"), "{text}");
    assert_eq!(audit(folder, &["verify", "--head", "12"]).0, 2);
}

#[test]
fn lines_that_a_full_disk_did_not_take_are_named_until_a_later_head_is_given() {
    let folder = tempfile::tempdir().unwrap();
    let (folder, log) = (folder.path(), "state/audit-1b000101.log");
    fs::write(folder.join("vsm.toml"), CONFIG).unwrap();
    start(folder);
    let disk = FileDisk::open(&folder.join("state")).unwrap();
    let key = AuditKey::load(&disk).unwrap();
    drop(disk);
    let mut bytes = fs::read(folder.join(log)).unwrap();
    let from = Duration::from_secs(1_795_219_200);
    let entry = Entry::NotWritten {
        lines: 12,
        until: from + Duration::from_secs(60),
    };
    let chain = Chain::verify(&bytes, key.as_ref()).chain;
    let (chain, line) = chain.extended(key.as_ref(), from, kit::bridge::vehicle_id(0), &entry);
    bytes.extend_from_slice(line.as_bytes());
    fs::write(folder.join(log), bytes).unwrap();
    let (status, text) = audit(folder, &["verify"]);
    let words = format!(
        "line {}: not written: 12 lines, from 2026-11-21T00:00:00Z to 2026-11-21T00:01:00Z",
        chain.lines()
    );
    assert!(status == 1 && text.contains(&words), "{status}: {text}");
    assert!(
        text.contains(&format!("intact, {} lines", chain.lines())),
        "{text}"
    );
    let (status, text) = audit(folder, &["verify", "--head", chain.digits()]);
    assert_eq!(status, 0, "{text}");
    let (_, csv) = audit(folder, &["export", "--format", "csv"]);
    assert!(csv.contains(",not_written,until_ms,"), "{csv}");
}

#[test]
fn a_log_of_gigabytes_is_not_read_whole() {
    let folder = tempfile::tempdir().unwrap();
    let (folder, log) = (folder.path(), "state/audit-1b000101.log");
    fs::write(folder.join("vsm.toml"), CONFIG).unwrap();
    start(folder);
    let long = fs::File::options().write(true).open(folder.join(log));
    // A hole, which takes no room on the disk.
    long.unwrap().set_len(3 << 30).unwrap();
    let began = Instant::now();
    start(folder);
    let (status, text) = audit(folder, &["verify"]);
    assert_eq!(status, 1, "{text}");
    let words = "audit-1b000101.log.1 has more than 2097152 bytes";
    assert!(text.contains(words), "{text}");
    assert!(!text.contains("is broken"), "{text}");
    let (status, json) = audit(folder, &["export"]);
    assert!(status == 0 && json.lines().count() > 2, "{json}");
    // Whole it would be some gigabytes of memory, and minutes of a debug build.
    assert!(began.elapsed() < Duration::from_secs(30));
}

/// The one who looks for what happened may be the one who has just broken another table.
#[test]
fn what_shows_the_store_needs_no_other_part_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let wrong = CONFIG.to_owned() + "[http]\nlisten = \"nowhere\"\n";
    fs::write(folder.join("vsm.toml"), wrong).unwrap();
    start(folder);
    let list = || {
        let mut command = Command::new(program("vsm"));
        let command = command.args(["key", "list", "--config"]);
        command.arg(folder.join("vsm.toml")).output().unwrap()
    };
    for (done, words) in [
        (done(folder, &["verify"]), "intact"),
        (done(folder, &["export"]), "started"),
        (list(), "vehicle 1b:00:01:01: signing is off"),
    ] {
        let (out, err) = (
            String::from_utf8_lossy(&done.stdout),
            String::from_utf8_lossy(&done.stderr),
        );
        assert_eq!(done.status.code(), Some(0), "{err}");
        assert!(out.contains(words), "{out}");
        assert!(
            err.contains("WARNING") && err.contains("http.listen"),
            "{err}"
        );
    }
}
