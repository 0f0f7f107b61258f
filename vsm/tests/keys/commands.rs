//! The commands by themselves: what each leaves in the folder, and what it refuses.

use std::fs;
use std::io::{PipeReader, PipeWriter, Write as _, pipe};
use std::os::unix::fs::PermissionsExt as _;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use mavlink_link::signing::SigningKey;
use rustix::fs::{OFlags, fcntl_setfl};

use crate::ground::{FIRST, Ground, SECOND, id, is_live_under, key};
use kit::process::{KillOnDrop, free_udp_port, program};

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_key_file_for_a_simulated_px4_brings_up_a_signed_link() {
    let ground = Ground::new();
    // A card that is not mounted, or whose name is mistyped: no key is left in its place.
    let (done, printed) = ground
        .command(&[
            "key",
            "provision",
            "--sitl-file",
            "card/mavlink/mavlink-signing-key.bin",
        ])
        .await;
    assert!(
        !done && printed.contains("no folder card to make card/mavlink in"),
        "{printed}"
    );
    assert!(!ground.has("card") && !ground.has("uav1.key"));
    fs::write(ground.path().join("file"), "").unwrap();
    let (done, printed) = ground
        .command(&["key", "provision", "--sitl-file", "file/key.bin"])
        .await;
    assert!(!done && printed.contains("file is a file"), "{printed}");
    let (done, printed) = ground
        .command(&[
            "key",
            "provision",
            "--sitl-file",
            "rootfs/mavlink-signing-key.bin",
        ])
        .await;
    assert!(done, "{printed}");

    let folder = fs::metadata(ground.path().join("rootfs")).unwrap();
    assert_eq!(folder.permissions().mode() & 0o777, 0o700);
    // PX4's own format: the key, and the first stamp.
    let file = fs::read(ground.path().join("rootfs/mavlink-signing-key.bin")).unwrap();
    assert_eq!(file.len(), 40);
    let key: [u8; 32] = file[..32].try_into().unwrap();
    let first = u64::from_le_bytes(file[32..].try_into().unwrap());
    assert!(
        ground
            .key("uav1.key")
            .same_as(&SigningKey::new(key).unwrap())
    );
    assert!(printed.contains(&id(key)), "{printed}");

    let _vehicle = ground.vehicle(Some(key), first).await;
    let _bridge = ground.start_bridge();
    let link = ground
        .link_status("a signed link", |link| is_live_under(link, &id(key)))
        .await;
    assert!(link["live_s"].as_f64().unwrap() >= 0.0, "{link:#}");
}

/// As after `vsm init`: a key is there, and no vehicle has it.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_key_that_was_never_used_is_given_to_the_vehicle_and_one_in_use_is_not() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    ground.write_key("other.key", SECOND);
    let (done, printed) = ground
        .command(&["key", "provision", "--from", "other.key"])
        .await;
    assert!(
        !done && printed.contains("--from names other.key"),
        "{printed}"
    );
    let _vehicle = ground.vehicle(None, 0).await;
    let (done, printed) = ground
        .command(&["key", "provision", "--wait-s", "60"])
        .await;
    assert!(done, "{printed}");
    assert!(ground.key("uav1.key").same_as(&key(FIRST)));
    let (done, printed) = ground.command(&["key", "provision"]).await;
    assert!(
        !done && printed.contains("this VSM has signed with it"),
        "{printed}"
    );
    let _bridge = ground.start_bridge();
    ground
        .link_status("a signed link", |link| is_live_under(link, &id(FIRST)))
        .await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_revoked_key_is_gone_at_both_ends() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    let _vehicle = ground.vehicle(Some(FIRST), 0).await;
    let (done, printed) = ground.command(&["key", "revoke", "--wait-s", "60"]).await;
    assert!(done, "{printed}");
    assert!(printed.contains("the old key is deleted"), "{printed}");
    let key = ground.key("uav1.key");
    assert!(!key.same_as(&SigningKey::new(FIRST).unwrap()));
    assert!(!ground.has("uav1.key.previous") && !ground.has("uav1.key.next"));
    let (_, listed) = ground.command(&["key", "list"]).await;
    assert!(listed.contains(&key.id().to_string()), "{listed}");
    assert!(!listed.contains(&id(FIRST)), "{listed}");

    let _bridge = ground.start_bridge();
    let new_id = key.id().to_string();
    ground
        .link_status("a link under the new key", |link| {
            is_live_under(link, &new_id)
        })
        .await;
}

/// The key was changed long ago, and a power cut brings PX4's old file back.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_vehicle_that_fell_back_to_the_key_before_is_given_the_key_again() {
    let ground = Ground::new();
    ground.write_key("uav1.key", SECOND);
    ground.write_key("uav1.key.previous", FIRST);
    let _vehicle = ground.vehicle(Some(FIRST), 0).await;
    let (done, printed) = ground.command(&["key", "rotate", "--wait-s", "15"]).await;
    assert!(done, "{printed}");
    assert!(printed.contains("has the key in force again"), "{printed}");
    let new = ground.key("uav1.key");
    assert!(!new.same_as(&key(FIRST)) && !new.same_as(&key(SECOND)));
    assert!(ground.key("uav1.key.previous").same_as(&key(SECOND)));
}

/// The vehicle lost its key: who does not sign is believed only where the operator vouches for it.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_vehicle_that_lost_its_key_is_given_another_one_on_the_operators_word() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    let _vehicle = ground.vehicle(None, 0).await;
    let (done, printed) = ground.command(&["key", "rotate", "--wait-s", "4"]).await;
    assert!(
        !done && printed.contains("--vehicle-is-unsigned"),
        "{printed}"
    );
    let (done, printed) = ground
        .command(&["key", "rotate", "--vehicle-is-unsigned", "--wait-s", "60"])
        .await;
    assert!(done, "{printed}");
    assert!(!ground.key("uav1.key").same_as(&key(FIRST)));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_wall_clock_far_ahead_is_believed_only_when_a_person_vouches_for_it() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    let (done, printed) = ground.command(&["key", "clock"]).await;
    assert!(
        done && printed.contains("has not been used yet"),
        "{printed}"
    );
    let (done, printed) = ground.command(&["key", "clock", "--accept"]).await;
    assert!(
        done && printed.contains("the wall clock is accepted"),
        "{printed}"
    );
    let (done, printed) = ground.command(&["key", "clock"]).await;
    assert!(
        done && printed.contains("nothing is stamped beyond"),
        "{printed}"
    );
    let days: f64 = printed
        .split("the wall clock is ")
        .nth(1)
        .and_then(|rest| rest.split(' ').next())
        .and_then(|days| days.parse().ok())
        .unwrap_or_else(|| panic!("{printed}"));
    assert!((0.0..0.01).contains(&days), "{printed}");
    // While a bridge runs the clock is its own.
    let bridge = ground.start_bridge();
    ground
        .link_status("the bridge", |link| link["signed"] == true)
        .await;
    let (done, printed) = ground.command(&["key", "clock", "--accept"]).await;
    assert!(!done, "the store is in use: {printed}");
    drop(bridge);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn two_vehicles_with_one_key_are_refused_by_name() {
    let ground = Ground::new();
    let (file, link) = (ground.path().join("vsm.toml"), free_udp_port());
    let other = format!(
        "[[vehicle]]\nid = \"1b:00:01:02\"\nlink = \"udpin:127.0.0.1:{link}\"\nsystem_id = 2\n\
         signing = {{ key_file = \"uav2.key\" }}\n[store]"
    );
    let config = fs::read_to_string(&file).unwrap();
    fs::write(&file, config.replace("[store]", &other)).unwrap();
    ground.write_key("uav1.key", FIRST);
    ground.write_key("uav2.key", FIRST);
    let (good, printed) = ground.command(&["check-config", "vsm.toml"]).await;
    assert!(
        !good && printed.contains("1b:00:01:01 and 1b:00:01:02"),
        "{printed}"
    );
    let mut bridge = ground.start_bridge();
    let end = Instant::now() + Duration::from_secs(20);
    let status = loop {
        if let Some(status) = bridge.0.try_wait().unwrap() {
            break status;
        }
        assert!(Instant::now() < end, "it serves two vehicles under one key");
        tokio::time::sleep(Duration::from_millis(50)).await;
    };
    assert_eq!(status.code(), Some(2));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_key_from_a_file_is_the_one_that_the_vehicle_has_in_the_end() {
    let ground = Ground::new();
    ground.write_key("uav1.key.next", FIRST);
    ground.write_key("wanted.key", SECOND);
    let _vehicle = ground.vehicle(None, 0).await;
    let wanted = &["key", "provision", "--from", "wanted.key", "--wait-s", "60"];
    let (done, printed) = ground.command(wanted).await;
    assert!(done, "{printed}");
    assert!(ground.key("uav1.key").same_as(&key(SECOND)), "{printed}");
}

/// A command whose output nobody takes waits there, with a key in its memory.
#[test]
fn core_files_are_off_before_any_command_reads_a_key() {
    let ground = Ground::new();
    ground.write_key("wanted.key", FIRST);
    are_off(&ground, &["key", "provision", "--from", "wanted.key"]);
    ground.write_key("uav1.key", SECOND);
    for arguments in [
        &["key", "list"][..],
        &["key", "clock"],
        &["check-config", "vsm.toml"],
    ] {
        are_off(&ground, arguments);
    }
}

fn are_off(ground: &Ground, arguments: &[&str]) {
    let (_unread, output) = full_pipe();
    let mut command = Command::new(program("vsm"));
    command.args(arguments).current_dir(ground.path());
    let command = command.stdout(output).stderr(Stdio::null());
    let running = KillOnDrop(command.spawn().unwrap());
    let limits = format!("/proc/{}/limits", running.0.id());
    let end = Instant::now() + Duration::from_secs(10);
    loop {
        let text = fs::read_to_string(&limits).unwrap_or_default();
        let core = text
            .lines()
            .find(|line| line.starts_with("Max core file size"));
        let soft = core.and_then(|line| line.split_whitespace().nth(4));
        if soft == Some("0") {
            break;
        }
        assert!(Instant::now() < end, "{arguments:?}: {core:?}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// A pipe that takes no byte more.
fn full_pipe() -> (PipeReader, PipeWriter) {
    let (reader, mut writer) = pipe().unwrap();
    fcntl_setfl(&writer, OFlags::NONBLOCK).unwrap();
    // A byte at a time to the end: a page is not filled by what does not fit whole.
    for bytes in [&[0; 4_096][..], &[0]] {
        while writer.write(bytes).is_ok_and(|written| written > 0) {}
    }
    fcntl_setfl(&writer, OFlags::empty()).unwrap();
    (reader, writer)
}
