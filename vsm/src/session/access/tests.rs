use std::num::NonZeroU64;

use mavlink_link::store::MemoryDisk;
use stanag_msgs::enums::LoiBitmap;

use super::*;

const VSM: Id = Id(0x1b00_0001);
const CUCS: Id = Id(0x1b00_00a0);
const VEHICLE: Id = Id(0x1b00_0101);
const WALL: Duration = Duration::from_secs(1_795_219_200);
const DAY: u64 = 86_400;

fn key(byte: u8) -> SigningKey {
    SigningKey::new([byte; 32]).unwrap()
}

fn guard(byte: u8) -> KeyId {
    KeyId::from_bytes([byte; 8])
}

/// A list of one entry: to fly, for a day.
fn file(version: u64) -> Vec<u8> {
    let mut list = AccessList::new(VSM);
    let entry = AccessEntry {
        cucs: CUCS,
        vehicle: VEHICLE,
        group: Group::Fly,
        key: guard(7),
        until: NonZeroU64::new(WALL.as_secs() + DAY),
    };
    list.grant(entry).unwrap();
    let signed = list.signed(version, &AccessKey::new(&key(1)));
    signed.into_bytes()
}

/// A process that starts `after` seconds with its wall clock `off`.
fn clocks(after: u64, mono: u64, off: i64) -> Now {
    let wall = (WALL.as_secs() + after + mono) as i64 + off;
    Now {
        mono: Duration::from_secs(mono),
        wall: Duration::from_secs(wall as u64),
    }
}

fn start(
    file: Result<Vec<u8>, String>,
    now: Now,
    disk: &mut MemoryDisk,
) -> Result<Access, AccessError> {
    Access::start(&key(1), VSM, file, now, Duration::ZERO, disk)
}

fn is_over(access: &Access, now: Now) -> bool {
    let permits = access.permits(CUCS, now);
    assert_eq!(permits.len(), 1);
    permits[0].over
}

#[test]
fn an_older_list_is_not_taken_over_a_restart_and_the_newest_stays_in_force() {
    let mut disk = MemoryDisk::default();
    let now = clocks(0, 0, 0);
    let none = start(Err("access.list: no such file".into()), now, &mut disk);
    assert!(none.unwrap_err().to_string().contains("no such file"));
    let mut access = start(Ok(file(5)), now, &mut disk).unwrap();
    assert_eq!(access.version(), 5);
    // While it runs.
    let older = RenewError::Older {
        found: 4,
        in_force: 5,
    };
    let found = access.prepare(&file(4)).unwrap_err();
    assert_eq!(found, older);
    let text = found.to_string();
    for part in ["version 4, older than version 5", "sign --version 6"] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let last = RenewError::Another { version: u64::MAX }.to_string();
    assert!(last.contains("there is no greater version"), "{last}");
    assert!(access.prepare(&file(5)).unwrap().is_none());
    let new = access.prepare(&file(7)).unwrap().expect("it is newer");
    access.store(&new, &mut disk).unwrap();
    let text = access.take(new);
    assert_eq!(text, "access list version 5 -> 7, 1 entries");
    // After a start: from the file that was put back, from one that is damaged, gone, or another of the same version.
    let mut other = AccessList::new(VSM);
    let other = other.signed(7, &AccessKey::new(&key(1)));
    let files = [
        (Ok(file(5)), "version 5"),
        (Ok(file(7)[1..].to_vec()), "line 1"),
        (Err("gone".to_owned()), "gone"),
        (Ok(other.into_bytes()), "has the same version (7)"),
    ];
    for (file, why) in files {
        let access = start(file, now, &mut disk).unwrap();
        assert_eq!(access.version(), 7, "{why}");
        assert!(
            access.refused().unwrap().contains(why),
            "{:?}",
            access.refused()
        );
    }
    assert_eq!(start(Ok(file(7)), now, &mut disk).unwrap().refused(), None);
    assert_eq!(start(Ok(file(8)), now, &mut disk).unwrap().version(), 8);
    // What the store has is verified too, and its key is another's with another name.
    let name = format!("access-{}", key(1).id());
    let stored = disk.records.get_mut(&name).unwrap();
    let last = stored.len() - 2;
    stored[last] ^= 1;
    let fault = start(Ok(file(9)), now, &mut disk).unwrap_err();
    assert!(matches!(fault, AccessError::Stored(_)), "{fault}");
}

#[test]
fn a_list_that_cannot_be_stored_does_not_come_into_force() {
    let mut disk = MemoryDisk::default();
    let now = clocks(0, 0, 0);
    let access = start(Ok(file(5)), now, &mut disk).unwrap();
    disk.full = Some("");
    let new = access.prepare(&file(6)).unwrap().expect("it is newer");
    assert!(access.store(&new, &mut disk).is_err());
    assert_eq!(access.version(), 5);
    let mut empty = MemoryDisk {
        full: Some(""),
        ..MemoryDisk::default()
    };
    assert!(start(Ok(file(5)), now, &mut empty).is_err());
}

#[test]
fn an_entry_ends_by_time_that_passes_and_by_no_clock_that_is_set() {
    let mut disk = MemoryDisk::default();
    let mut access = start(Ok(file(1)), clocks(0, 0, 0), &mut disk).unwrap();
    // The wall clock is set ahead by a month, and back by a month, while the VSM runs.
    for (at, off) in [(10, 30), (20, -30)] {
        let now = clocks(0, at, off * DAY as i64);
        access.keep(now, &mut disk);
        assert!(!is_over(&access, now), "{off} days");
    }
    for at in 0..=DAY / 10 {
        access.keep(clocks(0, at * 10, 0), &mut disk);
    }
    assert!(!is_over(&access, clocks(0, DAY - 1, 0)));
    assert!(is_over(&access, clocks(0, DAY, 0)));
    // It does not come back by a start with a wall clock that was set back by a month.
    let now = clocks(DAY + 5, 0, -30 * DAY as i64);
    let access = start(Ok(file(1)), now, &mut disk).unwrap();
    assert!(is_over(&access, now));
    // Off for more than a year, or so it seems: nobody knows, and it counts as ended.
    let now = clocks(400 * DAY, 0, 0);
    let access = start(Ok(file(1)), now, &mut disk).unwrap();
    assert!(is_over(&access, now));
    assert_eq!(access.status(now.mono).time, None);
}

#[test]
fn levels_are_those_of_the_entries_that_count() {
    let entry = |group, key, over| Permit {
        entry: AccessEntry {
            cucs: CUCS,
            vehicle: VEHICLE,
            group,
            key,
            until: None,
        },
        over,
    };
    let permits = Permits(Some(vec![
        entry(Group::Plan, guard(1), false),
        entry(Group::Launch, guard(1), true),
        entry(Group::Payload, guard(2), false),
    ]));
    let has = |key| key == guard(1);
    let [two, three, four, five] = [
        LoiBitmap::LOI2,
        LoiBitmap::LOI3,
        LoiBitmap::LOI4,
        LoiBitmap::LOI5,
    ];
    assert_eq!(permits.levels(VEHICLE, has), two.union(four));
    assert_eq!(
        permits.kept(VEHICLE),
        two.union(three).union(four).union(five)
    );
    assert_eq!(permits.levels(Id(9), has), LoiBitmap::NONE);
    let judge = |group, key, flies| permits.judge(VEHICLE, group, key, flies);
    let (first, second) = (Some(guard(1)), Some(guard(2)));
    assert_eq!(judge(Group::Plan, first, false), Permitted::Yes);
    assert_eq!(judge(Group::Monitor, first, false), Permitted::Yes);
    assert_eq!(judge(Group::Fly, first, true), Permitted::NotListed);
    assert_eq!(judge(Group::Launch, first, false), Permitted::Ended);
    assert_eq!(judge(Group::Launch, first, true), Permitted::Yes);
    assert_eq!(judge(Group::Plan, second, true), Permitted::OtherKey);
    assert_eq!(judge(Group::Payload, None, false), Permitted::Yes);
    assert_eq!(
        permits.judge(Id(9), Group::Plan, first, true),
        Permitted::NotListed
    );
    // No list at all narrows nothing, and one without entries gives nothing.
    assert_eq!(Permits(None).levels(VEHICLE, has).raw(), u8::MAX);
    assert_eq!(Permits(Some(vec![])).kept(VEHICLE), LoiBitmap::NONE);
}
