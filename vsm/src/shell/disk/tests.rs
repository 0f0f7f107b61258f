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
