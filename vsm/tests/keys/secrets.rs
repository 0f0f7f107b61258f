//! A bridge is run from its first key to its second, by command and over the air, and everything that it and the air-side
//! agent write or print is searched for the keys, and for what the keys come from.

use std::fs;
use std::io::Write as _;
use std::net::UdpSocket;
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use kit::process::{KillOnDrop, free_udp_port, program, run_in};
use mavlink_link::Now;
use mavlink_link::clock::Origin;
use mavlink_link::link::{Auth, Endpoint, Link, LinkConfig, Security};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::{SigningKey, Stamp};
use mavlink_link::store::MemoryDisk;
use px4_sim::{LinkAddress, Simulator, SimulatorConfig};

/// The forms in which a key could show up.
fn forms(hex: &str) -> Vec<Vec<u8>> {
    let bytes: Vec<u8> = (0..32)
        .map(|at| u8::from_str_radix(&hex[2 * at..2 * at + 2], 16).unwrap())
        .collect();
    let list = format!("{bytes:?}");
    vec![
        hex.as_bytes()[..24].to_vec(),
        hex.as_bytes()[40..].to_vec(),
        hex[..24].to_uppercase().into_bytes(),
        bytes[..8].to_vec(),
        bytes[24..].to_vec(),
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
    let port = free_udp_port();
    let link: LinkAddress = format!("udpin:127.0.0.1:{port}").parse().unwrap();
    let vehicle = Simulator::spawn(SimulatorConfig::on(link)).await.unwrap();
    let folder = tempfile::tempdir().unwrap();
    let config = format!(
        "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:{}\"\n[[vehicle]]\nid = \"1b:00:01:01\"\n\
         link = \"udpout:127.0.0.1:{port}\"\nsystem_id = 1\nsigning = {{ key_file = \"uav1.key\" }}\n\
         [store]\ndir = \"state\"\n[record]\ndir = \"tlog\"\n",
        free_udp_port()
    );
    fs::write(folder.path().join("vsm.toml"), config).unwrap();
    let folder_path = folder.path().to_owned();
    tokio::task::spawn_blocking(move || search(&folder_path))
        .await
        .unwrap();
    replay_at_vehicle(folder.path(), &vehicle).await;
}

fn search(folder: &Path) {
    let mut printed = vec![];
    let key_path = folder.join("uav1.key");
    let (done, text) = run_in(folder, "vsm", &["key", "provision", "--wait-s", "60"]);
    assert!(done, "{}", String::from_utf8_lossy(&text));
    assert!(String::from_utf8_lossy(&text).contains("DO NOT cut"));
    printed.extend(text);
    let first = fs::read_to_string(&key_path).unwrap();

    let (done, text) = run_in(folder, "vsm", &["key", "provision"]);
    assert!(!done, "a second first key");
    printed.extend(text);
    let (done, text) = run_in(folder, "vsm", &["key", "rotate", "--wait-s", "60"]);
    assert!(done, "{}", String::from_utf8_lossy(&text));
    printed.extend(text);
    let second = fs::read_to_string(&key_path).unwrap();
    assert_ne!(first, second);

    let log = fs::File::create(folder.join("run.log")).unwrap();
    let bridge = Command::new(program("vsm"))
        .args(["run", "--config", "vsm.toml"])
        .env("RUST_LOG", "trace")
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(log)
        .spawn()
        .unwrap();
    let bridge = KillOnDrop(bridge);
    let end = Instant::now() + Duration::from_secs(20);
    let status = loop {
        let (_, text) = run_in(folder, "vsm", &["status"]);
        let readable = String::from_utf8_lossy(&text).into_owned();
        printed.extend(text);
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
    let id = SigningKey::from_hex(second.trim()).unwrap().id();
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
        printed.extend(run_in(folder, "vsm", arguments).1);
    }
    let limits = fs::read_to_string(format!("/proc/{}/limits", bridge.0.id())).unwrap();
    let core = limits
        .lines()
        .find(|line| line.starts_with("Max core file size"))
        .unwrap();
    assert!(core.split_whitespace().nth(4) == Some("0"), "{core}");
    std::thread::sleep(Duration::from_millis(1_500));
    drop(bridge);

    fs::write(folder.join("printed"), &printed).unwrap();
    let forms: Vec<_> = [&first, &second]
        .into_iter()
        .flat_map(|hex| forms(hex.trim()))
        .collect();
    assert_absent(folder, &forms);
    replay_at_ground(folder);
}

/// In none of the files below the folder, those apart that hold keys and nothing else.
fn assert_absent(folder: &Path, forms: &[Vec<u8>]) {
    let mut searched = 0;
    for file in files(folder) {
        let name = file.file_name().unwrap().to_string_lossy().into_owned();
        if name.starts_with("uav1.key") || name == "exchange-identity" {
            continue;
        }
        let content = fs::read(&file).unwrap();
        searched += content.len();
        for form in forms {
            let found = content.windows(form.len()).any(|window| window == form);
            assert!(!found, "a secret is in {}", file.display());
        }
    }
    assert!(searched > 10_000, "only {searched} bytes were searched");
}

/// The frames of the recording of that flight, as they stand there.
fn recorded(folder: &Path) -> Vec<Vec<u8>> {
    let recording = files(&folder.join("tlog"))
        .into_iter()
        .find(|path| path.extension().is_some_and(|e| e == "tlog"))
        .expect("a recording");
    let records = fs::read(recording).unwrap();
    let mut frames = vec![];
    let mut rest = &records[..];
    while rest.len() > 20 {
        assert_eq!(rest[10] & 1, 0, "a signature was recorded");
        let len = (8 + 12 + usize::from(rest[9])).min(rest.len());
        frames.push(rest[8..len].to_vec());
        rest = &rest[len..];
    }
    assert!(frames.len() > 50, "{} frames", frames.len());
    frames
}

/// The recording of that flight, played at a signed receiver with the same key: nothing gets in.
fn replay_at_ground(folder: &Path) {
    let mut link = Link::<u8>::new(LinkConfig::new(1, Security::Signed, Endpoint::Listen));
    let key = fs::read_to_string(folder.join("uav1.key")).unwrap();
    let key = SigningKey::from_hex(key.trim()).unwrap();
    let mut now = Now {
        mono: Duration::ZERO,
        wall: Duration::from_secs(1_795_219_200),
    };
    let mut store = MemoryDisk::default();
    let mut keys = KeyState::start(key, Origin::KeyFile, Stamp::ZERO, now, &mut store).unwrap();
    for frame in recorded(folder) {
        now = now.after(Duration::from_millis(1));
        let auth = Auth::Signed {
            key: &mut keys,
            store: &mut store,
        };
        link.handle_datagram(now, 1, &frame, auth, &mut |d| {
            panic!("{:?} got in", d.header)
        });
    }
    assert_eq!(link.peer(), None);
}

/// And played at the vehicle itself, which has that key: it takes what it takes of anyone, and no more.
async fn replay_at_vehicle(folder: &Path, vehicle: &Simulator) {
    let before = vehicle.counters().links[0];
    let done = format!("{:?}", vehicle.counters().vehicle);
    let stranger = UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut played = 0;
    for frame in recorded(folder) {
        stranger
            .send_to(&frame, vehicle.address(0).unwrap())
            .unwrap();
        let heartbeat = frame[7..10] == [0, 0, 0];
        played += u64::from(!heartbeat);
        // As fast as a busy machine takes them: what a full socket loses proves nothing.
        tokio::time::sleep(Duration::from_millis(1)).await;
    }
    let end = Instant::now() + Duration::from_secs(10);
    loop {
        let after = vehicle.counters().links[0];
        assert_eq!(
            after.verified, before.verified,
            "a frame passed for a signed one"
        );
        if after.dropped_unsigned - before.dropped_unsigned >= played {
            break;
        }
        assert!(Instant::now() < end, "{played} played: {after:?}");
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    assert_eq!(format!("{:?}", vehicle.counters().vehicle), done);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_secret_of_an_exchange_is_in_any_log_record_status_recording_or_core_file() {
    let port = free_udp_port();
    let link: LinkAddress = format!("udpout:127.0.0.1:{port}").parse().unwrap();
    let _vehicle = Simulator::spawn(SimulatorConfig::on(link)).await.unwrap();
    tokio::task::spawn_blocking(move || agree_and_search(port))
        .await
        .unwrap();
}

/// Pairs, agrees, lets a second key follow the first, and has both processes end as by a fault.
fn agree_and_search(px4: u16) {
    let folder = tempfile::tempdir().unwrap();
    let (air, ground, radio) = (
        folder.path().join("air"),
        folder.path().join("ground"),
        free_udp_port(),
    );
    for side in [&air, &ground] {
        fs::create_dir(side).unwrap();
    }
    let text = format!(
        "[agent]\nvehicle_id = \"1b:00:01:01\"\nvsm_id = \"1b:00:00:01\"\nkey_file = \"uav1.key\"\n\
         [radio]\nlink = \"udpin:127.0.0.1:{radio}\"\n[px4]\nlink = \"udpin:127.0.0.1:{px4}\"\nsystem_id = 1\n\
         [store]\ndir = \"state\"\n"
    );
    fs::write(air.join("airside.toml"), text).unwrap();
    let text = format!(
        "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:{}\"\n[[vehicle]]\nid = \"1b:00:01:01\"\n\
         link = \"udpout:127.0.0.1:{radio}\"\nsystem_id = 1\n\
         signing = {{ key_file = \"uav1.key\", exchange = \"on\", rotate_days = 0.0001 }}\n\
         [store]\ndir = \"state\"\n[record]\ndir = \"tlog\"\n",
        free_udp_port()
    );
    fs::write(ground.join("vsm.toml"), text).unwrap();

    let mut agent = talkative(&air, &["airside"], Stdio::null());
    await_text(&air.join("airside.log"), "ready");
    // The window shows the code to whoever opened it: its output is not searched.
    let code = "ABCD-EFGH-IJKL-MNOP-QRST-UVWX-YZ23-4567";
    let mut window = Command::new(program("vsm"))
        .args(["airside", "pair", "--code", "-"])
        .current_dir(&air)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .map(KillOnDrop)
        .unwrap();
    let typed = |to: &mut KillOnDrop| writeln!(to.0.stdin.take().unwrap(), "{code}").unwrap();
    typed(&mut window);
    await_text(&air.join("airside.log"), "window is open");
    let mut pair = talkative(&ground, &["pair", "--code", "-"], Stdio::piped());
    typed(&mut pair);
    let log = || fs::read_to_string(ground.join("pair.log")).unwrap_or_default();
    assert!(pair.0.wait().unwrap().success(), "{}", log());

    let mut bridge = talkative(&ground, &["run"], Stdio::null());
    let mut keys: Vec<String> = vec![];
    let end = Instant::now() + Duration::from_secs(90);
    while keys.len() < 2 {
        assert!(Instant::now() < end, "{} keys were in use", keys.len());
        std::thread::sleep(Duration::from_millis(200));
        for (side, words) in [
            (&air, &["airside", "status"][..]),
            (&ground, &["status", "--json"]),
        ] {
            let (_, text) = run_in(side, "vsm", words);
            let mut printed = fs::OpenOptions::new();
            let mut printed = printed
                .append(true)
                .create(true)
                .open(side.join("printed"))
                .unwrap();
            printed.write_all(&text).unwrap();
        }
        let [up, down] = [&ground, &air]
            .map(|side| fs::read_to_string(side.join("uav1.key")).unwrap_or_default());
        if up == down && !up.is_empty() && !keys.contains(&up) {
            keys.push(up);
        }
    }
    fs::write(
        ground.join("listed"),
        run_in(&ground, "vsm", &["key", "list"]).1,
    )
    .unwrap();
    // As a fault in the program would end it, where the system writes core files.
    for process in [&mut agent, &mut bridge] {
        let sent = Command::new("kill")
            .args(["-ABRT", &process.0.id().to_string()])
            .status();
        assert!(sent.unwrap().success());
        let ended = process.0.wait().unwrap();
        assert_eq!((ended.signal(), ended.core_dumped()), (Some(6), false));
    }

    let mut secrets: Vec<_> = keys.iter().flat_map(|hex| forms(hex.trim())).collect();
    for side in [&air, &ground] {
        let identity = fs::read_to_string(side.join("state/exchange-identity")).unwrap();
        secrets.extend(forms(identity.trim()));
    }
    let letters = code.replace('-', "");
    for part in [&code[..14], &code[25..], &letters[..12], &letters[20..]] {
        secrets.extend([part.as_bytes().to_vec(), part.to_lowercase().into_bytes()]);
    }
    assert_absent(folder.path(), &secrets);
}

/// A program of this name with its configuration in that folder, at the most talkative, its words in `<name>.log`; core
/// files are wanted of it.
fn talkative(folder: &Path, arguments: &[&str], input: Stdio) -> KillOnDrop {
    let log = fs::File::create(folder.join(format!("{}.log", arguments[0]))).unwrap();
    let child = Command::new("sh")
        .args(["-c", "ulimit -c unlimited; exec \"$@\"", "sh"])
        .arg(program("vsm"))
        .args(arguments)
        .args(if arguments == ["run"] {
            &["--config", "vsm.toml"][..]
        } else {
            &[]
        })
        .env("RUST_LOG", "trace")
        .env("RUST_BACKTRACE", "full")
        .current_dir(folder)
        .stdin(input)
        .stdout(log.try_clone().unwrap())
        .stderr(log)
        .spawn();
    KillOnDrop(child.unwrap())
}

fn await_text(log: &Path, text: &str) {
    let end = Instant::now() + Duration::from_secs(20);
    while !fs::read_to_string(log).is_ok_and(|printed| printed.contains(text)) {
        assert!(Instant::now() < end, "{text} is not in {}", log.display());
        std::thread::sleep(Duration::from_millis(50));
    }
}
