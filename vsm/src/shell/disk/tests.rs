//! What of a store is shown beside the process that has it, and what is in the way of its files.

use mavlink_link::store::Store as _;
use stanag_msgs::Id;

use super::*;
use crate::key_exchange::{ExchangeRecord, identity};
use crate::shell::key_file::system_random;

#[test]
fn a_folder_in_the_way_of_a_file_is_named_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("state");
    let mut disk = FileDisk::open(&dir).unwrap();
    let mut refused = |name: &str| {
        fs::create_dir(dir.join(name)).unwrap();
        let written = disk.replace("plan-1.json", b"1", Durability::Power);
        fs::remove_dir(dir.join(name)).unwrap();
        written.unwrap_err().to_string()
    };
    // While the store is used.
    let text = refused("plan-1.json.new");
    assert!(
        text.contains("plan-1.json.new is a folder") && text.contains("remove the folder"),
        "{text}"
    );
    let text = refused("plan-1.json");
    assert!(
        text.contains("plan-1.json is a folder, expected a file"),
        "{text}"
    );
    disk.replace("plan-1.json", b"1", Durability::Power)
        .unwrap();
    drop(disk);
    // At the next start.
    for name in [
        "plan-1.json.new",
        "clock-0102030405060708.new-7",
        "names.new-0",
    ] {
        fs::create_dir(dir.join(name)).unwrap();
        let text = FileDisk::open(&dir).unwrap_err().to_string();
        assert!(
            text.contains(&format!("{name} is a folder")) && text.contains("remove the folder"),
            "{text}"
        );
        fs::remove_dir(dir.join(name)).unwrap();
    }
    // What only looks so is in nobody's way: no file is written under such a name.
    for name in ["missions.newer", "a.new.d", "notes.new-year", "x.new-"] {
        fs::create_dir(dir.join(name)).unwrap();
        FileDisk::open(&dir).unwrap();
    }
}

#[test]
fn what_another_process_holds_can_be_shown() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("state");
    let vehicle = Id(0x1b00_0101);
    let mut disk = FileDisk::open(&dir).unwrap();
    assert_eq!(peek::<ExchangeRecord>(&dir, &vehicle).unwrap(), None);
    assert_eq!(peek_identity(&dir), None);
    let record = ExchangeRecord {
        counter: u64::MAX,
        ..ExchangeRecord::default()
    };
    disk.save(&vehicle, &record).unwrap();
    assert_eq!(peek(&dir, &vehicle).unwrap(), Some(record));
    let made = identity(&mut disk, &mut system_random).unwrap().public();
    assert_eq!(peek_identity(&dir), Some(made));
}

#[test]
fn a_disk_without_room_is_known_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let free = free_bytes(&rustix::fs::statvfs(folder.path()).unwrap()).unwrap();
    assert!(free > 4 * MIN_FREE_BYTES, "{free} bytes free for this test");
    let room = |bytes: u64| NativeFileSystem.check_room(folder.path(), bytes);
    room(MIN_FREE_BYTES).unwrap();
    for bytes in [2 * free, u64::MAX] {
        let text = room(bytes).unwrap_err().to_string();
        assert!(text.contains("No space left on device"), "{text}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn a_line_is_added_to_a_log_that_is_there_or_begins_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log");
    for (line, new, start) in [("1\n", true, 0), ("2\n", false, 2)] {
        let added = NativeFileSystem.add(&path, line.as_bytes()).unwrap();
        assert_eq!((added.new, added.start), (new, start));
    }
    assert_eq!(fs::read(&path).unwrap(), b"1\n2\n");
    // Not where a link leads to.
    let link = folder.path().join("link");
    std::os::unix::fs::symlink(folder.path().join("target"), &link).unwrap();
    NativeFileSystem.add(&link, b"1\n").unwrap_err();
    assert!(!folder.path().join("target").exists());
}
