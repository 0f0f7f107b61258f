//! The Debian package: unpacked into a scratch root its programs run, its configuration is good, its unit is accepted.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use kit::process::{Running, program, write_key};
use kit::tools::is_installed;
use vsm_tests::ground::Ground;

#[test]
fn the_package_unpacks_and_its_programs_run() {
    if !is_installed("dpkg-deb") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let bins = program("vsm").parent().expect("a folder").to_owned();
    let out = folder.path().join("out");
    let built = Command::new(program("xtask"))
        .args(["deb", "--bins"])
        .arg(&bins)
        .arg("--out")
        .arg(&out)
        .output()
        .expect("xtask");
    assert!(
        built.status.success(),
        "{}",
        String::from_utf8_lossy(&built.stderr)
    );
    let package = fs::read_dir(&out)
        .expect("the folder")
        .map(|entry| entry.expect("an entry").path())
        .find(|path| path.extension().is_some_and(|e| e == "deb"))
        .expect("a package");

    let root = folder.path().join("root");
    run(Command::new("dpkg-deb").arg("-x").arg(&package).arg(&root));
    for name in ["vsm", "cucs", "px4-sim", "curve-plan"] {
        let printed = run(Command::new(root.join("usr/bin").join(name)).arg("--help"));
        assert!(
            printed.contains("Usage") || printed.contains("usage"),
            "{name}: {printed}"
        );
    }
    for place in [
        "usr/share/bash-completion/completions/cucs",
        "usr/share/zsh/vendor-completions/_px4-sim",
        "usr/share/fish/vendor_completions.d/curve-plan.fish",
    ] {
        let text = fs::read_to_string(root.join(place)).expect(place);
        assert!(text.len() > 200, "{place}: {text}");
    }
    for place in [
        "usr/share/man/man1/vsm-run.1.gz",
        "usr/share/man/man1/curve-plan-send.1.gz",
        "usr/share/doc/vsm/changelog.gz",
        "usr/share/doc/vsm/copyright",
        "usr/share/doc/vsm/vsm.cdx.json",
        "usr/share/doc/vsm/docs/guide/quick-start.md",
        "usr/share/doc/vsm/docs/img/demo.svg",
        "usr/share/doc/vsm/docs/reference/support.md",
        "usr/share/doc/vsm/examples/vsm.toml",
    ] {
        assert!(root.join(place).exists(), "{place} is not in the package");
    }
    for page in fs::read_dir(root.join("usr/share/man/man1")).expect("the pages") {
        let page = page.expect("an entry").file_name();
        let name = page.to_string_lossy().into_owned();
        let of = |program: &&str| name.starts_with(*program);
        let own = ["vsm", "cucs", "px4-sim", "curve-plan"].iter().any(of);
        assert!(own, "{name}: a page without its program");
    }
    let symbols = fs::read(root.join("usr/bin/vsm")).expect("the program");
    let built = fs::read(program("vsm")).expect("the program");
    assert!(
        symbols.len() < built.len(),
        "the packed program has its symbols"
    );
    let sums = run(Command::new("dpkg-deb")
        .args(["--info"])
        .arg(&package)
        .arg("md5sums"));
    let summed = scratch_sums(&root);
    assert_eq!(sums, summed, "md5sums of the package");
    let mode = |path: &str| {
        fs::metadata(root.join(path))
            .expect(path)
            .permissions()
            .mode()
            & 0o777
    };
    assert_eq!(
        (mode("usr/bin/vsm"), mode("etc/vsm/vsm.toml")),
        (0o755, 0o644)
    );

    // The configuration, with the places of this machine's root turned into those of the scratch root.
    let state = root.join("var/lib/vsm");
    fs::create_dir_all(&state).expect("the state folder");
    write_key(&state.join("uav1.key"), &[0x5a; 32]);
    let text = fs::read_to_string(root.join("etc/vsm/vsm.toml")).expect("the configuration");
    let text = text.replace("/var/lib/vsm", &state.display().to_string());
    let config = root.join("etc/vsm/scratch.toml");
    fs::write(&config, text).expect("the configuration");
    run(Command::new(root.join("usr/bin/vsm"))
        .arg("check-config")
        .arg(&config));

    let text = fs::read_to_string(root.join("etc/vsm/airside.toml")).expect("the agent's");
    let text = text.replace("/var/lib/vsm-airside", &state.display().to_string());
    fs::write(&config, text).expect("the configuration");
    run(Command::new(root.join("usr/bin/vsm"))
        .arg("check-config")
        .arg(&config));

    verify_unit(&root, "vsm.service");
    verify_unit(&root, "vsm-airside.service");
}

/// The checksums of what was unpacked, as the package lists them.
fn scratch_sums(root: &Path) -> String {
    let list = "find usr -type f -print0 | LC_ALL=C sort -z | xargs -0 md5sum";
    run(Command::new("sh").args(["-c", list]).current_dir(root))
}

/// systemd reads the unit without a word; where it rates it, it rates it safe.
fn verify_unit(root: &Path, name: &str) {
    if !is_installed("systemd-analyze") {
        return;
    }
    let unit = root.join("usr/lib/systemd/system").join(name);
    // It looks for the program where the unit names it: in the scratch root.
    let text = fs::read_to_string(&unit).expect("the unit");
    let program = root.join("usr/bin/vsm").display().to_string();
    let scratch = root.join(name);
    fs::write(&scratch, text.replace("/usr/bin/vsm", &program)).expect("the unit");
    let verified = Command::new("systemd-analyze")
        .args(["verify", "--man=no"])
        .arg(&scratch)
        .output()
        .expect("systemd-analyze");
    let printed = String::from_utf8_lossy(&verified.stderr);
    let ours: Vec<_> = printed.lines().filter(|line| line.contains(name)).collect();
    assert!(verified.status.success() && ours.is_empty(), "{printed}");

    let rated = Command::new("systemd-analyze")
        .args(["security", "--offline=true", "--threshold=20"])
        .arg(&scratch)
        .output()
        .expect("systemd-analyze");
    assert!(
        rated.status.success(),
        "an exposure above 2.0:\n{}{}",
        String::from_utf8_lossy(&rated.stdout),
        String::from_utf8_lossy(&rated.stderr)
    );
}

/// With `dli.multicast` or `dli.interface` the bridge lists the addresses of its interfaces, for which libc opens a socket of
/// AF_NETLINK. The agent joins no group.
#[test]
fn the_units_permit_the_families_of_sockets_that_their_programs_open() {
    let families = |name: &str| -> Vec<String> {
        let unit = fs::read_to_string(kit::workspace().join("packaging").join(name));
        let unit = unit.expect("the unit");
        let mut lines = unit.lines();
        let found = lines.find_map(|line| line.strip_prefix("RestrictAddressFamilies="));
        let found = found.expect("RestrictAddressFamilies").split(' ');
        found.map(str::to_owned).collect()
    };
    let agent = ["AF_INET", "AF_INET6", "AF_UNIX"];
    assert_eq!(families("vsm-airside.service"), agent);
    let bridge = [&agent[..], &["AF_NETLINK"]].concat();
    assert_eq!(families("vsm.service"), bridge);
}

#[test]
fn the_service_manager_is_notified_ready_and_alive() {
    let ground = Ground::new();
    let socket = ground.path("notify");
    let manager = UnixDatagram::bind(&socket).expect("a socket");
    let wait = Some(Duration::from_secs(10));
    manager.set_read_timeout(wait).expect("a time-out");
    // The shell becomes the bridge, as a service manager's child does: its process id is the bridge's.
    let script = format!(
        "NOTIFY_SOCKET='{}' WATCHDOG_USEC=200000 WATCHDOG_PID=$$ exec '{}' run --config '{}'",
        socket.display(),
        program("vsm").display(),
        ground.path("vsm.toml").display()
    );
    let bridge = Running::start(Path::new("sh"), ["-c", &script]);
    let mut printed = Vec::new();
    while printed.iter().filter(|text| *text == "WATCHDOG=1").count() < 5
        || !printed.iter().any(|text| text == "READY=1")
    {
        let mut bytes = [0; 256];
        let length = manager
            .recv(&mut bytes)
            .expect("a word of the bridge within 10 s");
        printed.extend(
            String::from_utf8_lossy(&bytes[..length])
                .lines()
                .map(str::to_owned),
        );
    }
    bridge.terminate();
    while printed.last().is_some_and(|text| text != "STOPPING=1") {
        let mut bytes = [0; 256];
        let length = manager.recv(&mut bytes).expect("its last word within 10 s");
        printed.extend(
            String::from_utf8_lossy(&bytes[..length])
                .lines()
                .map(str::to_owned),
        );
    }
}

fn run(command: &mut Command) -> String {
    let output = command
        .output()
        .unwrap_or_else(|e| panic!("{command:?}: {e}"));
    let printed = format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    assert!(output.status.success(), "{command:?}: {printed}");
    printed
}
