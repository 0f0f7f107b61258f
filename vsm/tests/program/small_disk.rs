//! `vsm run` with its store on a real file system that is full, then read-only: what was accepted is kept, what cannot be
//! kept is refused with the reason, the vehicle is flown all the same.
//!
//! The file system is a small one in memory in a mount namespace of the test's own. Where the system gives none the tests
//! are left out; with `CI` set they fail.

use std::fs;
use std::process::Command;

use kit::process::program;
use kit::tools::works;

use kit::bridge::Processes;
use kit::bridge::flight::{World as _, hold_at, is_known};
use kit::bridge::{Faults, orders};
use stanag_msgs::Message;
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode};

fn end(processes: &mut Processes, order: impl Into<Message>) -> AckType {
    let ticket = processes.give(order.into());
    let end = processes.ended(ticket);
    processes.ground_mut().give_up(ticket);
    end.expect("an end")
}

/// Whether a process may mount file systems that only it and its children see.
fn has_mount_namespace() -> bool {
    let mount = "mount -t tmpfs tmpfs /mnt && command -v nsenter";
    let mut probe = Command::new("unshare");
    works(
        "a mount namespace (unshare -rm)",
        probe.args(["-rm", "sh", "-c", mount]),
    )
}

/// Runs a command where the bridge's file systems are.
fn within(processes: &Processes, command: &str) {
    let id = processes.bridge_id().to_string();
    let done = Command::new("nsenter")
        .args([
            "-t",
            &id,
            "-U",
            "-m",
            "--preserve-credentials",
            "sh",
            "-c",
            command,
        ])
        .status();
    assert!(done.is_ok_and(|status| status.success()), "{command}");
}

#[test]
fn a_full_and_a_read_only_disk_accept_nothing_and_lose_nothing() {
    if !has_mount_namespace() {
        return;
    }
    let mut processes = Processes::laid_out(3, Faults::NONE, 4.0);
    let state = processes.path("state");
    fs::create_dir(&state).expect("the folder");
    let state = state.display().to_string();
    processes.shell = Some(format!(
        "exec unshare -rm sh -c \"mount -t tmpfs -o size=512k,mode=0700 tmpfs '{state}' && exec '{}' run --config '{}'\"",
        program("vsm").display(),
        processes.path("vsm.toml").display()
    ));
    processes.start_bridge();
    processes.pass(4.0);
    assert_eq!(
        end(&mut processes, orders::request_control()),
        AckType::CarriedOut
    );
    for message in orders::square() {
        assert_eq!(end(&mut processes, message), AckType::CarriedOut);
    }
    assert_eq!(end(&mut processes, orders::load()), AckType::CarriedOut);
    assert_eq!(
        end(&mut processes, orders::launch(20.0)),
        AckType::CarriedOut
    );

    let moved = || orders::waypoint(102, 103, 40.0, 40.0, 60.0);
    for (make, mend, full) in [
        (
            format!("cat /dev/zero > '{state}/filler' 2>/dev/null; true"),
            format!("rm '{state}/filler'"),
            true,
        ),
        (
            // Over it, since the bridge holds its lock open: what is asked for by name is read-only.
            format!("mount -t tmpfs -o ro,mode=0700 tmpfs '{state}'"),
            format!("umount '{state}'"),
            false,
        ),
    ] {
        within(&processes, &make);
        assert_eq!(end(&mut processes, moved()), AckType::Refused, "{make}");
        assert!(
            processes.ground().has_alert("it cannot be stored"),
            "{make}"
        );
        // A flight continues.
        assert_eq!(
            end(&mut processes, hold_at(25.0)),
            AckType::CarriedOut,
            "{make}"
        );
        assert!(is_known(&mut processes, 102), "{make}");
        if full {
            // Longer than the signing clock is written ahead: it is written over in its place.
            processes.pass(15.0);
            let held = end(&mut processes, hold_at(30.0));
            assert_eq!(held, AckType::CarriedOut, "{make}");
            // What must be kept is refused all the same.
            assert_eq!(end(&mut processes, moved()), AckType::Refused, "{make}");
        }
        within(&processes, &mend);
        assert_eq!(end(&mut processes, moved()), AckType::CarriedOut, "{mend}");
        processes.ground_mut().received.clear();
    }
    let land = orders::mode(Mode::AutolandEngage);
    assert_eq!(end(&mut processes, land), AckType::CarriedOut);
}

#[test]
fn a_read_only_store_is_refused_at_the_start() {
    if !has_mount_namespace() {
        return;
    }
    let mut processes = Processes::laid_out(4, Faults::NONE, 1.0);
    let state = processes.path("state").display().to_string();
    fs::create_dir(&state).expect("the folder");
    processes.shell = Some(format!(
        "exec unshare -rm sh -c \"mount -t tmpfs -o mode=0700,ro tmpfs '{state}' && exec '{}' run --config '{}'\"",
        program("vsm").display(),
        processes.path("vsm.toml").display()
    ));
    let printed = processes.try_bridge().expect_err("it cannot serve");
    assert!(
        printed.contains("[store] dir") && printed.contains("ead-only"),
        "{printed}"
    );
}

/// What each program says of a disk that takes no byte more, one command each.
#[test]
fn a_full_disk_is_answered_with_what_to_do() {
    if !has_mount_namespace() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let init = Command::new(program("vsm"))
        .args(["init", "--sitl", "before.toml"])
        .current_dir(folder.path())
        .output();
    assert!(init.is_ok_and(|done| done.status.success()));
    let route = kit::workspace().join("examples/curve.route.toml");
    let route = route.display();
    for (name, arguments) in [
        ("vsm", "init --sitl other/vsm.toml".to_owned()),
        ("vsm", "keygen new.key".to_owned()),
        ("vsm", "run before.toml".to_owned()),
        (
            "vsm",
            "key provision --config before.toml --sitl-file signing.bin".to_owned(),
        ),
        ("curve-plan", format!("plot {route} -o curve.svg")),
        ("curve-plan", format!("convert {route} curve.kml")),
    ] {
        let inside = format!(
            "mount -t tmpfs -o size=64k,mode=0700 tmpfs full && cp before.toml uav1.key full && cd full && \
             cat /dev/zero > filler 2>/dev/null; exec timeout 5 '{}' {arguments}",
            program(name).display()
        );
        std::fs::create_dir_all(folder.path().join("full")).expect("the folder");
        let done = Command::new("unshare")
            .args(["-rm", "sh", "-c", &inside])
            .current_dir(folder.path())
            .output()
            .expect("unshare");
        let printed = String::from_utf8_lossy(&done.stderr).into_owned();
        assert!(!done.status.success(), "{name} {arguments}: {printed}");
        assert!(
            printed.contains("No space left on device") && printed.contains("free space"),
            "{name} {arguments}: {printed}"
        );
    }
}
