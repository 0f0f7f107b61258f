//! A bridge is run from its first key to its second, and everything that it writes or says is searched for either key.

mod program_support;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use mavlink_link::link::{Endpoint, Link, LinkConfig, Security};
use program_support::{Running, VSM, free_port, run};
use sim::px4::{LinkAddress, Simulator, SimulatorConfig};

/// The forms in which a key could show up.
fn forms(hex: &str) -> Vec<Vec<u8>> {
    let octets: Vec<u8> = (0..32)
        .map(|at| u8::from_str_radix(&hex[2 * at..2 * at + 2], 16).unwrap())
        .collect();
    let list = format!("{octets:?}");
    vec![
        hex.as_bytes()[..24].to_vec(),
        hex.as_bytes()[40..].to_vec(),
        hex[..24].to_uppercase().into_bytes(),
        octets[..8].to_vec(),
        octets[24..].to_vec(),
        list.as_bytes()[1..30].to_vec(),
    ]
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = vec![];
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path));
        } else if path.metadata().unwrap().is_file() {
            found.push(path);
        }
    }
    found
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_key_is_in_any_log_record_status_or_recording() {
    let port = free_port();
    let link: LinkAddress = format!("udpin:127.0.0.1:{port}").parse().unwrap();
    let _vehicle = Simulator::spawn(SimulatorConfig::on(link)).await.unwrap();
    let folder = tempfile::tempdir().unwrap();
    let config = format!(
        "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:{}\"\n[[vehicle]]\nid = \"1b:00:01:01\"\n\
         link = \"udpout:127.0.0.1:{port}\"\nsystem_id = 1\nsigning = {{ key_file = \"uav1.key\" }}\n\
         [store]\ndir = \"state\"\n[record]\ndir = \"tlog\"\n",
        free_port()
    );
    fs::write(folder.path().join("vsm.toml"), config).unwrap();
    let folder_path = folder.path().to_owned();
    tokio::task::spawn_blocking(move || search(&folder_path))
        .await
        .unwrap();
}

fn search(folder: &Path) {
    let mut said = vec![];
    let key_path = folder.join("uav1.key");
    let (done, text) = run(folder, &["key", "provision", "--wait-s", "60"]);
    assert!(done, "{}", String::from_utf8_lossy(&text));
    assert!(String::from_utf8_lossy(&text).contains("DO NOT cut"));
    said.extend(text);
    let first = fs::read_to_string(&key_path).unwrap();

    let (done, text) = run(folder, &["key", "provision"]);
    assert!(!done, "a second first key");
    said.extend(text);
    let (done, text) = run(folder, &["key", "rotate", "--wait-s", "60"]);
    assert!(done, "{}", String::from_utf8_lossy(&text));
    said.extend(text);
    let second = fs::read_to_string(&key_path).unwrap();
    assert_ne!(first, second);

    let log = fs::File::create(folder.join("run.log")).unwrap();
    let bridge = Command::new(VSM)
        .args(["run", "--config", "vsm.toml"])
        .env("RUST_LOG", "trace")
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(log)
        .spawn()
        .unwrap();
    let bridge = Running(bridge);
    let end = Instant::now() + Duration::from_secs(20);
    let status = loop {
        let (_, text) = run(folder, &["status"]);
        let readable = String::from_utf8_lossy(&text).into_owned();
        said.extend(text);
        if readable.contains("signed with key") && readable.contains(" live for ") {
            break readable;
        }
        assert!(
            Instant::now() < end,
            "the bridge does not come up:\n{readable}"
        );
        std::thread::sleep(Duration::from_millis(200));
    };
    // Seen at a glance: which key, and since when.
    let id = mavlink_link::signing::SigningKey::from_hex(second.trim())
        .unwrap()
        .id();
    assert!(
        status.contains(&format!("signed with key {id}, live for")),
        "{status}"
    );
    for arguments in [
        &["status", "--json"][..],
        &["check-config", "vsm.toml"],
        &["key", "list"],
        &["key", "rotate"],
    ] {
        said.extend(run(folder, arguments).1);
    }
    let limits = fs::read_to_string(format!("/proc/{}/limits", bridge.0.id())).unwrap();
    let core = limits
        .lines()
        .find(|line| line.starts_with("Max core file size"))
        .unwrap();
    assert!(core.split_whitespace().nth(4) == Some("0"), "{core}");
    std::thread::sleep(Duration::from_millis(1_500));
    drop(bridge);

    fs::write(folder.join("said"), &said).unwrap();
    let forms: Vec<_> = [&first, &second]
        .into_iter()
        .flat_map(|hex| forms(hex.trim()))
        .collect();
    let mut searched = 0;
    for file in files(folder) {
        let name = file.file_name().unwrap().to_string_lossy().into_owned();
        if name.starts_with("uav1.key") {
            continue;
        }
        let content = fs::read(&file).unwrap();
        searched += content.len();
        for form in &forms {
            let found = content.windows(form.len()).any(|window| window == form);
            assert!(!found, "a key is in {}", file.display());
        }
    }
    assert!(searched > 10_000, "only {searched} octets were searched");
    replay(folder);
}

/// The recording of that flight, played at a signed receiver with the same key: nothing gets in.
fn replay(folder: &Path) {
    let recording = files(&folder.join("tlog")).pop().expect("a recording");
    let records = fs::read(recording).unwrap();
    let mut link = Link::<u8>::new(LinkConfig::new(1, Security::Signed, Endpoint::Listen));
    let mut played = 0;
    let mut rest = &records[..];
    while rest.len() > 20 {
        let signed = usize::from(rest[10] & 1) * 13;
        assert_eq!(signed, 0, "a signature was recorded");
        let len = 8 + 12 + usize::from(rest[9]);
        let (frame, left) = (&rest[8..len.min(rest.len())], &rest[len.min(rest.len())..]);
        let now = mavlink_link::Now {
            mono: Duration::from_millis(played),
            wall: Duration::from_secs(1_795_219_200),
        };
        let mut store = Nowhere;
        let key = mavlink_link::signing::SigningKey::from_hex(
            fs::read_to_string(folder.join("uav1.key")).unwrap().trim(),
        )
        .unwrap();
        let origin = mavlink_link::clock::Origin::KeyFile;
        let mut keys = mavlink_link::receiver::KeyState::start(
            key,
            origin,
            mavlink_link::signing::Stamp::ZERO,
            now,
            &mut store,
        )
        .unwrap();
        let auth = mavlink_link::link::Auth::Signed {
            key: &mut keys,
            store: &mut store,
        };
        link.handle_datagram(now, 1, frame, auth, &mut |d| {
            panic!("{:?} got in", d.header)
        });
        played += 1;
        rest = left;
    }
    assert!(played > 50, "{played} frames");
    assert_eq!(link.peer(), None);
}

struct Nowhere;

impl mavlink_link::clock::CeilingStore for Nowhere {
    fn load(
        &mut self,
        _: &mavlink_link::signing::KeyId,
    ) -> Result<Option<mavlink_link::signing::Stamp>, mavlink_link::clock::StoreError> {
        Ok(None)
    }

    fn store(
        &mut self,
        _: &mavlink_link::signing::KeyId,
        _: mavlink_link::signing::Stamp,
    ) -> Result<(), mavlink_link::clock::StoreError> {
        Ok(())
    }
}
