//! Against an etcd of its own: what one node has stored is what the next continues with, and a node that is not the owner any more
//! stores nothing.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use kit::Random;
use kit::etcd::Etcd;
use mavlink_link::signing::SigningKey;
use mavlink_link::store::{Changes, Disk as _, Durability, Progress};
use stanag_msgs::Id;
use tokio::sync::Notify;

use super::files::is_stored;
use super::operator::Operator;
use super::{FleetError, Held, Stop, check_state, stand_by};
use crate::config::SharedStore;
use crate::shell::disk::{FileDisk, NativeFileSystem};
use crate::shell::queued_disk::QueuedDisk;

const VSM: Id = Id(0x1b00_0001);

fn store(etcd: &Etcd, node: &str) -> SharedStore {
    SharedStore {
        endpoints: etcd.urls(),
        node: node.to_owned(),
        key_file: "unused".into(),
        // Long enough for alpha not to look between the end of its lease and the next owner's beginning.
        lease_s: 9,
    }
}

fn own(etcd: &Etcd, node: &str, folder: &Path, key: u8) -> Result<(FileDisk, Held), FleetError> {
    let disk = FileDisk::open_on(&folder.join(node), Box::new(NativeFileSystem)).unwrap();
    let key = SigningKey::new([key; 32]).unwrap();
    let held = stand_by(
        (&store(etcd, node), VSM),
        &key,
        disk,
        &Stop::default(),
        &mut |_| {},
    )?;
    Ok(held.expect("nobody stops it"))
}

/// The files of a folder that belong into etcd.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = fs::read_dir(folder).unwrap().map(Result::unwrap);
    let name = |entry: &fs::DirEntry| entry.file_name().into_string().unwrap();
    let stored = entries.filter(|entry| is_stored(&name(entry)));
    stored
        .map(|entry| (name(&entry), fs::read(entry.path()).unwrap()))
        .collect()
}

fn durable(disk: &mut QueuedDisk) {
    let until = disk.queued();
    assert!(disk.wait(Duration::from_secs(20)), "{:?}", disk.failing());
    assert_eq!(
        disk.progress(Changes { after: 0, until }),
        Progress::Durable
    );
}

#[test]
fn what_is_durable_at_one_node_is_what_the_next_begins_with() {
    if !kit::tools::is_installed("etcd") {
        return;
    }
    let (etcd, folder) = (Etcd::start(1), tempfile::tempdir().unwrap());
    // What lies in the folder of the first owner is taken over.
    fs::create_dir(folder.path().join("n0")).unwrap();
    fs::write(folder.path().join("n0/old.json"), b"from before").unwrap();
    let modes = |name: &str, mode| {
        let to = std::os::unix::fs::PermissionsExt::from_mode(mode);
        fs::set_permissions(folder.path().join(name), to).unwrap();
    };
    modes("n0", 0o700);
    modes("n0/old.json", 0o600);
    // A folder by another name, as systemd makes /var/lib/vsm with DynamicUser.
    fs::create_dir(folder.path().join("private")).unwrap();
    modes("private", 0o700);
    std::os::unix::fs::symlink(folder.path().join("private"), folder.path().join("n1")).unwrap();
    let mut random = Random::with_seed(4_586);
    let mut last = BTreeMap::new();
    for turn in 0..6 {
        let node = ["n0", "n1", "n2"][turn % 3];
        let (store, mut held) = own(&etcd, node, folder.path(), 7).unwrap();
        assert_eq!(held.epoch, turn as u64 + 1);
        let now = files(&folder.path().join(node));
        if turn > 0 {
            assert_eq!(now, last, "turn {turn}");
        } else {
            assert_eq!(now["old.json"], b"from before");
        }
        let mut disk = QueuedDisk::new(store, Arc::new(Notify::new())).unwrap();
        for _ in 0..60 {
            let name = [
                "a.json",
                "b.log",
                "c.log",
                "clock-0011223344556677.ceiling",
                "plan",
            ][random.usize(0..5)];
            // Some are longer than a piece.
            let bytes: Vec<u8> = (0..random.usize(0..6_000)).map(|_| random.u8(..)).collect();
            let how = [Durability::Process, Durability::Power][random.usize(0..2)];
            // What is refused has changed nothing.
            let _ = match random.u8(0..10) {
                0..4 => disk.append(name, &bytes, how),
                4..7 => disk.replace(name, &bytes, how),
                7 => disk.remove(name),
                8 => disk.rename(name, &format!("{name}.aside")),
                _ => disk.rotate(name, 2),
            };
            if random.bool() {
                disk.poll();
            }
        }
        durable(&mut disk);
        last = files(&folder.path().join(node));
        assert!(held.ended().try_recv().is_err());
    }
    // Nobody without the key can continue, and etcd was not changed by the attempt.
    let fault = own(&etcd, "n3", folder.path(), 8).unwrap_err();
    assert!(fault.to_string().contains("store.key_file"), "{fault}");
    drop(own(&etcd, "n0", folder.path(), 7).unwrap());
    assert_eq!(files(&folder.path().join("n0")), last);
}

#[test]
fn a_node_that_lost_its_vsm_stores_nothing_and_ends() {
    if !kit::tools::is_installed("etcd") {
        return;
    }
    let (etcd, folder) = (Etcd::start(1), tempfile::tempdir().unwrap());
    let (store, mut alpha) = own(&etcd, "alpha", folder.path(), 7).unwrap();
    let mut ended = alpha.ended();
    let mut disk = QueuedDisk::new(store, Arc::new(Notify::new())).unwrap();
    disk.replace("plan", b"of alpha", Durability::Process)
        .unwrap();
    durable(&mut disk);
    // As if it had stood still for longer than its lease: etcd ends it, and another node comes first.
    etcd.end_leases();
    let (store, mut beta) = own(&etcd, "beta", folder.path(), 7).unwrap();
    let lost = disk.replace("plan", b"of alpha, too late", Durability::Process);
    let refused = lost.is_err() || !disk.wait(Duration::from_millis(500));
    assert!(refused, "it is not the owner any more");
    let why = ended.blocking_recv().expect("it has the reason");
    assert!(why.contains("beta has taken over"), "{why}");
    let mut other = QueuedDisk::new(store, Arc::new(Notify::new())).unwrap();
    let plan = other.read("plan", 100).unwrap().unwrap();
    assert_eq!(&**plan, b"of alpha");
    other
        .replace("plan", b"of beta", Durability::Process)
        .unwrap();
    durable(&mut other);
    assert!(beta.ended().try_recv().is_err());
}

/// Restored from a backup that is younger than the last take-over, by somebody who has raised its revision, or beside others who have
/// written to the same cluster since.
#[test]
fn an_etcd_that_lacks_changes_is_not_served_whatever_its_revision() {
    if !kit::tools::is_installed("etcd") {
        return;
    }
    let (etcd, folder) = (Etcd::start(1), tempfile::tempdir().unwrap());
    let begin = || {
        let (store, alpha) = own(&etcd, "alpha", folder.path(), 7)?;
        let mut disk = QueuedDisk::new(store, Arc::new(Notify::new())).unwrap();
        disk.replace("plan", b"a plan", Durability::Process)
            .unwrap();
        durable(&mut disk);
        Ok::<_, FleetError>((disk, alpha))
    };
    drop(begin().unwrap());
    // Its start notes how many changes there are.
    let (mut disk, mut alpha) = begin().unwrap();
    for lane in 0..2 {
        etcd.delete(&format!("vsm/1b000001/last/{lane}"));
    }
    // What serves stores nothing on top of an earlier state, and ends.
    let lost = disk.replace("plan", b"on top", Durability::Process);
    assert!(lost.is_err() || !disk.wait(Duration::from_millis(500)));
    let why = alpha.ended().blocking_recv().expect("it has the reason");
    assert!(why.contains("etcd was set back"), "{why}");
    drop((disk, alpha));
    let fault = begin().map(drop).unwrap_err();
    assert!(matches!(fault, FleetError::SetBack { .. }), "{fault}");
}

/// The lease of the first lasts, and with it what needs no store: status, sticks, and what is flown for a station that is lost.
#[test]
fn a_node_whose_key_was_deleted_ends_though_its_lease_lasts() {
    if !kit::tools::is_installed("etcd") {
        return;
    }
    let (etcd, folder) = (Etcd::start(1), tempfile::tempdir().unwrap());
    let (_store, mut alpha) = own(&etcd, "alpha", folder.path(), 7).unwrap();
    let mut ended = alpha.ended();
    etcd.delete("vsm/1b000001/owner");
    let (_store, beta) = own(&etcd, "beta", folder.path(), 7).unwrap();
    assert_eq!(beta.epoch, 2);
    let why = ended.blocking_recv().expect("it has the reason");
    assert!(why.contains("beta owns the VSM"), "{why}");
    let until = alpha.lease().borrow().expect("it had a lease");
    std::thread::sleep(Duration::from_secs(4));
    assert_eq!(*alpha.lease().borrow(), Some(until), "it is not renewed");
}

#[test]
fn a_folder_of_another_vsm_is_not_overwritten_and_a_folder_of_the_fleet_not_served_alone() {
    if !kit::tools::is_installed("etcd") {
        return;
    }
    let (etcd, folder) = (Etcd::start(1), tempfile::tempdir().unwrap());
    drop(own(&etcd, "alpha", folder.path(), 7).unwrap());
    let alone = FileDisk::open(&folder.path().join("alpha")).unwrap_err();
    assert!(alone.to_string().contains("belongs to a fleet"), "{alone}");

    let mut other = FileDisk::open(&folder.path().join("beta")).unwrap();
    other
        .replace("plan", b"of another time", Durability::Power)
        .unwrap();
    // It is found without standing by; a folder of the fleet is none of another.
    let shared = store(&etcd, "beta");
    let found = check_state(&shared, VSM, &other).unwrap_err();
    assert!(matches!(found, FleetError::Foreign { .. }), "{found}");
    let alpha = folder.path().join("alpha");
    let alpha = FileDisk::open_on(&alpha, Box::new(NativeFileSystem)).unwrap();
    check_state(&shared, VSM, &alpha).unwrap();
    drop((other, alpha));
    let fault = own(&etcd, "beta", folder.path(), 7).unwrap_err();
    assert!(
        fault.to_string().contains("not made in this fleet"),
        "{fault}"
    );
    assert_eq!(
        fs::read(folder.path().join("beta/plan")).unwrap(),
        b"of another time"
    );
}

#[test]
fn a_store_that_was_begun_is_finished_by_the_node_that_began_it() {
    if !kit::tools::is_installed("etcd") {
        return;
    }
    let (etcd, folder) = (Etcd::start(1), tempfile::tempdir().unwrap());
    let mut disk = FileDisk::open(&folder.path().join("alpha")).unwrap();
    disk.replace("plan", b"of alpha", Durability::Power)
        .unwrap();
    drop(disk);
    drop(own(&etcd, "alpha", folder.path(), 7).unwrap());
    // As where alpha ended in the middle: what says that all is stored is not there.
    etcd.delete("vsm/1b000001/complete");
    etcd.delete("vsm/1b000001/head/plan");
    let stop = Stop::default();
    let (of_thread, store) = (stop.clone(), store(&etcd, "beta"));
    let beta = FileDisk::open(&folder.path().join("beta")).unwrap();
    let waits = std::thread::spawn(move || {
        let mut said = vec![];
        let mut report = |line: &str| said.push(line.to_owned());
        let key = SigningKey::new([7; 32]).unwrap();
        let held = stand_by((&store, VSM), &key, beta, &of_thread, &mut report).unwrap();
        assert!(held.is_none(), "it has nothing of alpha's");
        said
    });
    std::thread::sleep(Duration::from_secs(1));
    stop.set();
    let said = waits.join().unwrap();
    assert!(
        said[0].contains("the folder of alpha is not whole"),
        "{said:?}"
    );

    drop(own(&etcd, "alpha", folder.path(), 7).unwrap());
    drop(own(&etcd, "beta", folder.path(), 7).unwrap());
    assert_eq!(
        fs::read(folder.path().join("beta/plan")).unwrap(),
        b"of alpha"
    );
}

#[test]
fn a_node_that_stood_by_knows_how_old_a_file_is_at_most_and_one_that_begins_does_not() {
    if !kit::tools::is_installed("etcd") {
        return;
    }
    let (etcd, folder) = (Etcd::start(1), tempfile::tempdir().unwrap());
    let mut before = FileDisk::open(&folder.path().join("alpha")).unwrap();
    before
        .replace("of-days-ago", b"1", Durability::Power)
        .unwrap();
    drop(before);
    let (store_of_alpha, alpha) = own(&etcd, "alpha", folder.path(), 7).unwrap();
    let (shared, beta) = (store(&etcd, "beta"), folder.path().join("beta"));
    let stands_by = std::thread::spawn(move || {
        let disk = FileDisk::open_on(&beta, Box::new(NativeFileSystem)).unwrap();
        let (key, stop) = (SigningKey::new([7; 32]).unwrap(), Stop::default());
        stand_by((&shared, VSM), &key, disk, &stop, &mut |_| {}).unwrap()
    });
    // Some looks.
    std::thread::sleep(Duration::from_secs(1));
    let mut disk = QueuedDisk::new(store_of_alpha, Arc::new(Notify::new())).unwrap();
    disk.replace("of-a-moment-ago", b"1", Durability::Power)
        .unwrap();
    durable(&mut disk);
    drop((disk, alpha));
    let (disk, beta) = stands_by.join().unwrap().expect("nobody stops it");
    let within = disk.written_within("of-a-moment-ago");
    let within = within.expect("it was stored after a look");
    assert!(within < Duration::from_secs(30), "{within:?}");
    assert_eq!(disk.written_within("of-days-ago"), None);

    // As where the whole fleet is started.
    drop((disk, beta));
    let (disk, _gamma) = own(&etcd, "gamma", folder.path(), 7).unwrap();
    assert!(disk.read("of-a-moment-ago", 10).unwrap().is_some());
    assert_eq!(disk.written_within("of-a-moment-ago"), None);
}

#[test]
fn a_drain_of_a_move_ends_without_the_one_who_ordered_it_and_not_in_place_of_a_lasting_one() {
    if !kit::tools::is_installed("etcd") {
        return;
    }
    let (etcd, folder) = (Etcd::start(1), tempfile::tempdir().unwrap());
    let (disk, mut alpha) = own(&etcd, "alpha", folder.path(), 7).unwrap();
    let operator = Operator::new(&store(&etcd, "alpha"), VSM);
    let is_drained = || operator.fleet().unwrap().nodes[0].drained;
    // Longer than alpha takes to look, which is a third of its lease.
    let time = Duration::from_secs(6);
    assert!(operator.drain_for("alpha", time).unwrap().is_some());
    assert!(operator.drain_for("alpha", time).unwrap().is_none());
    let why = alpha.ended().blocking_recv().expect("it has the reason");
    assert!(why.contains("drained"), "{why}");
    assert!(is_drained());
    drop((disk, alpha));
    // Nobody resumes it.
    let (_disk, alpha) = own(&etcd, "alpha", folder.path(), 7).unwrap();
    assert_eq!(alpha.epoch, 2);

    let drain = operator.drain_for("alpha", time).unwrap();
    operator.end(&drain.expect("it is not drained"));
    assert!(!is_drained());
    operator.drain("alpha").unwrap();
    assert!(operator.drain_for("alpha", time).unwrap().is_none());
    assert!(is_drained());
}

/// What nothing bounds is uploaded for minutes, fills etcd's quota, and holds up every other file of the node.
#[test]
fn a_log_of_gigabytes_costs_etcd_and_the_other_files_nothing_and_its_next_line_is_stored() {
    if !kit::tools::is_installed("etcd") {
        return;
    }
    let (etcd, folder) = (Etcd::start(1), tempfile::tempdir().unwrap());
    let alpha = folder.path().join("alpha");
    let grow = |name: &str| {
        let file = fs::File::options().write(true).open(alpha.join(name));
        let file = file.unwrap();
        // A hole, which takes no room on the disk.
        let length = file.metadata().unwrap().len();
        file.set_len(length + (3 << 30)).unwrap();
    };
    // Put aside by a version before, and taken over by the first owner.
    let mut before = FileDisk::open(&alpha).unwrap();
    for name in ["audit-1b000101.log.1", "plan"] {
        before
            .append(name, b"first line\n", Durability::Power)
            .unwrap();
    }
    drop(before);
    grow("audit-1b000101.log.1");
    let began = std::time::Instant::now();
    let (store, held) = own(&etcd, "alpha", folder.path(), 7).unwrap();
    let mut disk = QueuedDisk::new(store, Arc::new(Notify::new())).unwrap();
    let log = "audit-1b000102.log";
    // Each leaves a megabyte more in etcd, until beginning and end are stored again.
    for line in ["one\n", "two\n", "2a\n", "2b\n", "2c\n"] {
        disk.append(log, line.as_bytes(), Durability::Power)
            .unwrap();
        durable(&mut disk);
        // Something writes to the log while it is used.
        grow(log);
    }
    disk.append(log, b"three\n", Durability::Power).unwrap();
    disk.replace("plan", b"of alpha", Durability::Power)
        .unwrap();
    durable(&mut disk);
    drop((disk, held));
    let (store, _held) = own(&etcd, "beta", folder.path(), 7).unwrap();
    assert!(began.elapsed() < Duration::from_secs(60));
    assert_eq!(&**store.read("plan", 100).unwrap().unwrap(), b"of alpha");
    let files = files(&folder.path().join("beta"));
    let aside = &files["audit-1b000101.log.1"];
    assert!(aside.starts_with(b"first line\n") && aside.len() == (2 << 20) + 1);
    let log = &files[log];
    assert!(log.starts_with(b"one\n") && log.ends_with(b"\0three\n"));
    assert!(log.len() <= 4 << 20, "{}", log.len());
    drop(store);

    // A file that no start could read is not made a damaged record: the first owner names it.
    let (etcd, other) = (Etcd::start(1), tempfile::tempdir().unwrap());
    let dir = other.path().join("alpha");
    drop(FileDisk::open(&dir).unwrap());
    let core = fs::File::create(dir.join("core")).unwrap();
    core.set_len(3 << 30).unwrap();
    let fault = own(&etcd, "alpha", other.path(), 7)
        .unwrap_err()
        .to_string();
    assert!(
        fault.contains("core in [store] dir has 3221225472 bytes")
            && fault.contains("Move it away"),
        "{fault}"
    );
    // Nor is it left out: the next start would delete it.
    assert!(dir.join("core").exists());
}

#[test]
fn what_is_of_one_computer_alone_stays_there_and_an_order_to_erase_does_not_wait_for_etcd() {
    for name in [
        "guard-1b0000a0.key",
        "guard-1b0000a0.key.pairing",
        "lock",
        "status.sock",
        "zeroize.order",
        "a.json.new-3",
        "uav1.key.new",
    ] {
        assert!(!is_stored(name), "{name}");
    }
    for name in [
        "authority-1b000101.json",
        "audit-1b000101.log.1",
        "a.newer.json",
    ] {
        assert!(is_stored(name), "{name}");
    }
    if !kit::tools::is_installed("etcd") {
        return;
    }
    let (mut etcd, folder) = (Etcd::start(1), tempfile::tempdir().unwrap());
    let (mut disk, _held) = own(&etcd, "alpha", folder.path(), 7).unwrap();
    etcd.kill_member(0);
    assert!(
        disk.replace("plan", b"of alpha", Durability::Power)
            .is_err()
    );
    disk.replace("zeroize.order", b"{}", Durability::Power)
        .unwrap();
}
