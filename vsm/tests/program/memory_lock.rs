//! The memory of a program that serves is kept out of swap where the system permits it. Where it does not, the program serves all the same,
//! and its status says so.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use kit::process::{Running, free_udp_port, program, write_key};
use kit::tools;
use serde_json::Value;
use tempfile::TempDir;

/// What is started, and what shows its status. A guard has no status of its own, only its log.
const PROGRAMS: [(&str, Option<&str>); 3] = [
    ("run vsm.toml", Some("status vsm.toml")),
    ("airside airside.toml", Some("airside status airside.toml")),
    (
        "guard run --cucs 1b:00:00:a0 --vsm-id 1b:00:00:01 --vsm 127.0.0.1:9 --listen 127.0.0.1:0 --key-file a0.key",
        None,
    ),
];

fn folder() -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let bridge = "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:0\"\n[[vehicle]]\nid = \"1b:00:01:01\"\nlink = \"udpin:127.0.0.1:0\"\n\
                  system_id = 1\nsigning = { key_file = \"uav1.key\" }\n[store]\ndir = \"state\"\n";
    let agent = format!(
        "[agent]\nvehicle_id = \"1b:00:01:01\"\nvsm_id = \"1b:00:00:01\"\nkey_file = \"airside.key\"\n[radio]\nlink = \"udpin:127.0.0.1:{}\"\n\
         [px4]\nlink = \"udpin:127.0.0.1:{}\"\nsystem_id = 1\n[store]\ndir = \"airside\"\n",
        free_udp_port(),
        free_udp_port()
    );
    fs::write(folder.path().join("vsm.toml"), bridge).expect("the bridge's");
    fs::write(folder.path().join("airside.toml"), agent).expect("the agent's");
    for name in ["uav1.key", "airside.key", "a0.key"] {
        write_key(&folder.path().join(name), &[7; 32]);
    }
    folder
}

/// Starts it by a shell, after this line, and without CAP_IPC_LOCK where `bare`.
fn started(folder: &Path, line: &str, bare: bool, words: &str) -> Running {
    let script = format!("{line}; exec \"$0\" {words}");
    let mut command = match bare {
        true => {
            let mut without = Command::new("setpriv");
            without.args(["--bounding-set=-ipc_lock", "sh"]);
            without
        }
        false => Command::new("sh"),
    };
    command.args(["-c", &script]).arg(program("vsm"));
    let mut running = Running::spawn(command.current_dir(folder));
    running.wait_for("ready", Duration::from_secs(30));
    running
}

fn status(folder: &Path, words: &str, further: &[&str]) -> String {
    let output = Command::new(program("vsm"))
        .args(words.split(' '))
        .args(further)
        .current_dir(folder)
        .output()
        .expect("it runs");
    assert!(output.status.success(), "{output:?}");
    String::from_utf8(output.stdout).expect("text")
}

/// By its status, in both forms.
fn assert_says(folder: &Path, words: &str, locked: bool) {
    let json = status(folder, words, &["--json"]);
    let json: Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!(json["memory_locked"], Value::Bool(locked), "{words}");
    let text = status(folder, words, &[]);
    assert_eq!(text.contains("memory is not locked"), !locked, "{text}");
}

/// Of /proc/PID/status, kB.
fn memory(of: &Running, what: &str) -> u64 {
    let text = fs::read_to_string(format!("/proc/{}/status", of.id())).expect("it runs");
    let line = text.lines().find(|line| line.starts_with(what));
    let number = line.and_then(|line| line.split_whitespace().nth(1));
    number.expect(what).parse().expect("a number")
}

/// Whether the kernel lets this process have its memory locked: without a limit, or by a capability that is not of a user namespace.
fn is_permitted() -> bool {
    let mut raise = Command::new("sh");
    raise
        .args(["-c", "ulimit -l unlimited"])
        .stderr(Stdio::null());
    let unlimited = raise.status().expect("a shell").success();
    unlimited || has_capability()
}

fn has_capability() -> bool {
    let map = fs::read_to_string("/proc/self/uid_map").expect("this process");
    let whole = map.split_whitespace().eq(["0", "0", "4294967295"]);
    let text = fs::read_to_string("/proc/self/status").expect("this process");
    let line = text.lines().find_map(|line| line.strip_prefix("CapEff:"));
    let set = u64::from_str_radix(line.expect("its capabilities").trim(), 16).expect("bits");
    // CAP_IPC_LOCK is bit 14.
    whole && set >> 14 & 1 == 1
}

/// Where nobody may lock memory, the next test has what happens there.
#[test]
fn the_memory_of_what_serves_is_locked_where_that_is_permitted() {
    if !is_permitted() {
        let why = "this process may lock no memory, nor lift its limit";
        tools::leave_out("RLIMIT_MEMLOCK without a limit, or CAP_IPC_LOCK", why);
        return;
    }
    for (serve, show) in PROGRAMS {
        let folder = folder();
        let raised = "ulimit -l unlimited 2>/dev/null";
        let running = started(folder.path(), raised, false, serve);
        // What was allocated since as well: all but a page or two of the kernel's.
        let (locked, all) = (memory(&running, "VmLck:"), memory(&running, "VmSize:"));
        assert!(locked + 1_024 > all, "{serve}: {locked} of {all} kB");
        if let Some(show) = show {
            assert_says(folder.path(), show, true);
        }
        assert!(!running.output().contains("memory is not locked"));
    }
}

#[test]
fn under_a_limit_nothing_is_locked_and_the_program_serves() {
    let bare = has_capability();
    if bare && !tools::works("setpriv", Command::new("setpriv").arg("--version")) {
        return;
    }
    for (serve, show) in PROGRAMS {
        // With locking under such a limit the kernel would refuse what is allocated later.
        for limit in ["ulimit -l 0", "ulimit -l 64", "ulimit -l 8192"] {
            let folder = folder();
            let mut running = started(folder.path(), limit, bare, serve);
            assert_eq!(memory(&running, "VmLck:"), 0, "{serve}, {limit}");
            if let Some(show) = show {
                assert_says(folder.path(), show, false);
            }
            running.wait_for("memory is not locked", Duration::from_secs(10));
            let ended = running.wait(Duration::from_millis(300));
            assert_eq!(ended, None, "{}", running.output());
        }
    }
}
