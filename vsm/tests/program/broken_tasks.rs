//! `vsm run` and `vsm airside` with a task that panics, ends, waits for ever or keeps the thread: the process ends, or, where
//! nothing in it can run any more, nothing reports to the service manager or the vehicle that all is well.
//!
//! PX4 starts its failsafe when heartbeats stop. A bridge that is half dead and sends them keeps an aircraft in the air that
//! nobody commands.

use std::fs;
use std::io::Write as _;
use std::net::{TcpStream, UdpSocket};
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::{Command, ExitStatus};
use std::thread;
use std::time::{Duration, Instant};

use kit::process::{Running, free_tcp_port, free_udp_port, program};
use tempfile::TempDir;

/// A bridge with this fault, its unsigned vehicle, and its service manager.
struct Broken {
    fault: String,
    bridge: Running,
    vehicle: UdpSocket,
    manager: UnixDatagram,
    page: u16,
    _folder: TempDir,
}

impl Broken {
    fn start(fault: &str) -> Broken {
        let folder = tempfile::tempdir().unwrap();
        let vehicle = UdpSocket::bind("127.0.0.1:0").unwrap();
        let (dli, page) = (free_udp_port(), free_tcp_port());
        let config = format!(
            "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:{dli}\"\n[[vehicle]]\nid = \"1b:00:01:01\"\n\
             link = \"udpout:{}\"\nsystem_id = 1\nsigning = \"off\"\n[store]\ndir = \"state\"\n\
             [http]\nlisten = \"127.0.0.1:{page}\"\n",
            vehicle.local_addr().unwrap()
        );
        fs::write(folder.path().join("vsm.toml"), config).unwrap();
        Broken::launch(fault, "run --config vsm.toml", folder, vehicle, page)
    }

    fn launch(
        fault: &str,
        command: &str,
        folder: TempDir,
        vehicle: UdpSocket,
        page: u16,
    ) -> Broken {
        let manager = UnixDatagram::bind(folder.path().join("notify")).unwrap();
        manager.set_nonblocking(true).unwrap();
        vehicle.set_nonblocking(true).unwrap();
        // The shell becomes the bridge, as a service manager's child does: its process id is the bridge's.
        let script = format!(
            "WATCHDOG_PID=$$ exec '{}' {command}",
            program("vsm").display()
        );
        let mut bridge = Running::spawn(
            Command::new(Path::new("sh"))
                .args(["-c", &script])
                .current_dir(folder.path())
                .env("NOTIFY_SOCKET", folder.path().join("notify"))
                .env("WATCHDOG_USEC", "400000")
                .env("VSM_TEST_FAULT", fault),
        );
        bridge.wait_for("ready", Duration::from_secs(60));
        Broken {
            fault: fault.to_owned(),
            bridge,
            vehicle,
            manager,
            page,
            _folder: folder,
        }
    }

    /// How it ended, and what it printed.
    fn end(mut self) -> (ExitStatus, String) {
        let ended = self.bridge.wait(Duration::from_secs(30));
        let printed = self.bridge.output();
        let Broken { fault, .. } = self;
        let status = ended.unwrap_or_else(|| panic!("{fault}: it lives on\n{printed}"));
        (status, printed)
    }

    /// Pings to the service manager and datagrams to the vehicle that have come in since the last look.
    fn signs_of_life(&self) -> (usize, usize) {
        let mut bytes = [0; 512];
        let mut counts = (0, 0);
        while let Ok(length) = self.manager.recv(&mut bytes) {
            counts.0 += usize::from(bytes[..length].starts_with(b"WATCHDOG=1"));
        }
        while self.vehicle.recv(&mut bytes).is_ok() {
            counts.1 += 1;
        }
        counts
    }
}

const TASKS: [&str; 8] = [
    "DLI receiver",
    "vehicle receiver",
    "sender",
    "clock",
    "disk",
    "status socket",
    "settings socket",
    "status page",
];

/// Side by side: each mostly waits.
fn ends_of(kind: &str) -> Vec<(&'static str, ExitStatus, String)> {
    let bridges = TASKS.map(|task| (task, Broken::start(&format!("{kind} {task}"))));
    let ended = bridges.map(|(task, bridge)| {
        let (status, printed) = bridge.end();
        (task, status, printed)
    });
    ended.into()
}

#[test]
fn a_panic_of_any_task_is_the_end_of_the_bridge() {
    for (task, status, printed) in ends_of("panic") {
        assert!(!status.success(), "{task}: {status}");
        assert!(printed.contains(&format!("{task} panics")), "{printed}");
        assert!(
            printed.contains("a panic ends the whole program"),
            "{printed}"
        );
    }
}

#[test]
fn the_end_of_any_task_is_the_end_of_the_bridge() {
    for (task, status, printed) in ends_of("end") {
        assert_eq!(status.code(), Some(1), "{task}: {printed}");
        let why = format!("the task \"{task}\" ended while it was needed");
        assert!(printed.contains(&why), "{printed}");
    }
}

#[test]
fn a_task_that_waits_for_ever_is_the_end_of_the_bridge() {
    for (task, status, printed) in ends_of("block") {
        assert_eq!(status.code(), Some(1), "{task}: {printed}");
        let why = format!("the task \"{task}\" has not answered for");
        assert!(printed.contains(&why), "{printed}");
    }
}

#[test]
fn a_panic_on_the_status_page_is_the_end_of_the_bridge() {
    let bridge = Broken::start("panic page connection");
    let mut reader = TcpStream::connect(("127.0.0.1", bridge.page)).unwrap();
    // A request that is not finished keeps the connection's task until it panics.
    reader.write_all(b"GET / HTTP/1.1\r\n").unwrap();
    let (status, printed) = bridge.end();
    assert!(!status.success(), "{status}");
    assert!(printed.contains("page connection panics"), "{printed}");
}

#[test]
fn a_thread_that_is_kept_sends_neither_pings_nor_heartbeats() {
    let bridges = ["DLI receiver", "clock", "status page"]
        .map(|task| Broken::start(&format!("freeze {task}")));
    for bridge in bridges {
        // Both came before the fault.
        let (mut pings, mut heartbeats) = (0, 0);
        let end = Instant::now() + Duration::from_secs(30);
        let mut quiet = 0;
        while quiet < 30 {
            assert!(Instant::now() < end, "{}: it lives on", bridge.fault);
            thread::sleep(Duration::from_millis(100));
            let (more_pings, more_heartbeats) = bridge.signs_of_life();
            (pings, heartbeats) = (pings + more_pings, heartbeats + more_heartbeats);
            let alive = more_pings + more_heartbeats > 0 || pings == 0 || heartbeats == 0;
            quiet = if alive { 0 } else { quiet + 1 };
        }
    }
}

#[test]
fn the_agent_feeds_the_watchdog_and_a_frozen_one_does_not() {
    let folder = tempfile::tempdir().unwrap();
    let px4 = UdpSocket::bind("127.0.0.1:0").unwrap();
    let config = format!(
        "[agent]\nvehicle_id = \"1b:00:01:01\"\nvsm_id = \"1b:00:00:01\"\nkey_file = \"airside.key\"\n\
         [radio]\nlink = \"udpin:127.0.0.1:{}\"\ntalkers = [{{ system_id = 245, component_id = 190 }}]\n\
         [px4]\nlink = \"udpout:{}\"\nsystem_id = 1\n[store]\ndir = \"state\"\n",
        free_udp_port(),
        px4.local_addr().unwrap()
    );
    fs::write(folder.path().join("airside.toml"), config).unwrap();
    let agent = Broken::launch("", "airside --config airside.toml", folder, px4, 0);
    let mut pings = 0;
    let end = Instant::now() + Duration::from_secs(30);
    while pings < 5 {
        assert!(
            Instant::now() < end,
            "{pings} pings:\n{}",
            agent.bridge.output()
        );
        thread::sleep(Duration::from_millis(50));
        pings += agent.signs_of_life().0;
    }
    agent.bridge.signal("STOP");
    thread::sleep(Duration::from_millis(500));
    agent.signs_of_life();
    thread::sleep(Duration::from_millis(1_000));
    assert_eq!(agent.signs_of_life().0, 0);
}

#[test]
fn release_builds_abort_on_a_panic_and_on_an_overflow() {
    let manifest = concat!(env!("CARGO_MANIFEST_DIR"), "/../Cargo.toml");
    let manifest: toml::Table = fs::read_to_string(manifest).unwrap().parse().unwrap();
    let release = &manifest["profile"]["release"];
    assert_eq!(release["panic"].as_str(), Some("abort"));
    assert_eq!(release["overflow-checks"].as_bool(), Some(true));
}
