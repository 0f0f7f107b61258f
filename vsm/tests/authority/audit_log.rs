//! The audit logs: put aside when they have grown, their chains unbroken over files and restarts; status alone costs no wait
//! for the disk, and does not turn over the log of control. Whatever is done to them without the key is named.

use crate::scene::{A, B, CONTROL, Scene};
use stanag_msgs::enums::{AckType, RequestedAccess};
use vsm::session::{AuditKey, Chain};

const LOG: &str = "audit-1b000101.log";
const MONITORS: &str = "audit-monitors-1b000101.log";
const RECORD: &str = "authority-1b000101.json";

/// B takes LOI 2 and gives it up again, so often.
fn flip(scene: &mut Scene, times: usize) {
    for _ in 0..times {
        for access in [RequestedAccess::Request, RequestedAccess::Relinquish] {
            let ticket = scene.ask(B, access, 0x01);
            let answered = scene
                .rig
                .until(5.0, |rig| rig.stations[B].end(ticket).is_some());
            assert!(answered);
        }
        scene.rig.stations[B].received.clear();
        if times > 20 {
            // As often as LOI 2 is given.
            scene.rig.run(0.1);
        }
    }
}

#[test]
fn status_alone_is_not_synchronised_and_a_repeated_request_is_not_written() {
    let mut scene = Scene::controlled();
    let synced = scene.rig.store.synced;
    flip(&mut scene, 20);
    assert_eq!(scene.rig.store.synced, synced);
    let ticket = scene.ask(B, RequestedAccess::Request, 0x01);
    assert_eq!(scene.end(B, ticket), Some(AckType::CarriedOut));
    // What is still counted has its line by then.
    scene.rig.run(25.0);
    let lengths = |scene: &Scene| [LOG, MONITORS].map(|log| scene.rig.store.records[log].len());
    let length = lengths(&scene);
    for _ in 0..20 {
        let ticket = scene.ask(B, RequestedAccess::Request, 0x01);
        assert_eq!(scene.end(B, ticket), Some(AckType::CarriedOut));
    }
    scene.rig.run(25.0);
    assert_eq!(lengths(&scene), length);
    // A right to command is another matter.
    let release = scene.ask(A, RequestedAccess::Relinquish, CONTROL);
    assert_eq!(scene.end(A, release), Some(AckType::CarriedOut));
    assert!(scene.rig.store.synced > synced);
}

#[test]
fn the_chain_continues_over_files_and_the_oldest_is_removed() {
    let mut scene = Scene::controlled();
    // As if it had been written for months: the length alone counts.
    let grown = |scene: &mut Scene| {
        let mut bytes = scene.rig.store.records[LOG].clone();
        let mut chain = Chain::verify(&bytes, None).chain;
        let vehicle = kit::bridge::vehicle_id(0);
        while bytes.len() < 1 << 20 {
            let entry = vsm::session::Entry::NotKept;
            let (next, line) = chain.extended(None, scene.rig.now().wall, vehicle, &entry);
            chain = next;
            bytes.extend_from_slice(line.as_bytes());
        }
        scene.rig.store.records.insert(LOG.to_owned(), bytes);
        scene.rig.restart_bridge();
        scene.rig.run(0.5);
    };
    for _ in 0..10 {
        grown(&mut scene);
        flip(&mut scene, 1);
    }
    let kept = |number: u32| scene.rig.store.records.get(&format!("{LOG}.{number}"));
    assert!(kept(8).is_some() && kept(9).is_none());
    let broken = |scene: &Scene| {
        scene
            .rig
            .log
            .iter()
            .any(|entry| entry.text.contains("is broken"))
    };
    assert!(!broken(&scene));
    let mut before: Option<Chain> = None;
    for name in (1..=8)
        .rev()
        .map(|n| format!("{LOG}.{n}"))
        .chain([LOG.to_owned()])
    {
        let verified = Chain::verify(&scene.rig.store.records[&name], None);
        assert_eq!(verified.broken, None, "{name}");
        assert!(
            before.is_none_or(|before| before == verified.follows),
            "{name}"
        );
        before = Some(verified.chain);
    }
    // A whole file that is gone from the middle is seen.
    scene.rig.store.records.remove(&format!("{LOG}.3"));
    scene.rig.restart_bridge();
    scene.rig.run(0.1);
    assert!(broken(&scene));
}

#[test]
fn monitors_fill_a_log_of_their_own_by_a_line_in_ten_seconds() {
    let mut scene = Scene::controlled();
    let control = scene.rig.store.records[LOG].clone();
    let from = scene.rig.clock.elapsed();
    flip(&mut scene, 400);
    scene.rig.run(25.0);
    assert_eq!(scene.rig.store.records[LOG], control);
    let log = String::from_utf8_lossy(&scene.rig.store.records[MONITORS]).into_owned();
    let took_s = (scene.rig.clock.elapsed() - from).as_secs() as usize;
    assert!(log.lines().count() <= 4 + took_s / 10, "{log}");
    // No change is missing from the numbers.
    let objects = log
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(&line[65..]).unwrap());
    let (mut gained, mut lost) = (0, 0);
    for object in objects {
        gained += object["times_gained"].as_u64().unwrap_or_default();
        gained += u64::from(object["gained"].is_string());
        lost += object["times_lost"].as_u64().unwrap_or_default();
        lost += u64::from(object["lost"].is_string());
    }
    assert_eq!((gained, lost), (400, 400), "{log}");
}

/// With a log of an earlier version, then a key, and some handovers since.
fn keyed() -> Scene {
    let mut scene = Scene::controlled();
    let key = "5a".repeat(32) + "\n";
    scene
        .rig
        .store
        .records
        .insert("audit.key".to_owned(), key.into_bytes());
    scene.rig.restart_bridge();
    hand_over(&mut scene, 2);
    scene
}

fn hand_over(scene: &mut Scene, times: usize) {
    for _ in 0..times {
        for access in [RequestedAccess::Relinquish, RequestedAccess::Request] {
            let ticket = scene.ask(A, access, CONTROL);
            assert_eq!(scene.end(A, ticket), Some(AckType::CarriedOut));
        }
    }
}

/// What a start finds wrong, which then is in the log, too.
fn findings(mut scene: Scene) -> String {
    let before = scene.rig.log.len();
    scene.rig.restart_bridge();
    scene.rig.run(0.1);
    let found = scene.rig.log[before..]
        .iter()
        .filter(|entry| entry.text.contains("the audit log"))
        .map(|entry| entry.text.clone());
    let found = found.collect::<Vec<_>>().join("; ");
    let log = String::from_utf8_lossy(&scene.rig.store.records[LOG]).into_owned();
    assert_eq!(
        log.contains("\"what\":\"fault\""),
        !found.is_empty(),
        "{log}"
    );
    found
}

#[test]
fn a_log_of_an_earlier_version_is_continued_by_a_key_and_stays_whole() {
    let scene = keyed();
    let log = String::from_utf8_lossy(&scene.rig.store.records[LOG]).into_owned();
    assert_eq!(log.matches("\"what\":\"keyed\"").count(), 1, "{log}");
    assert!(
        log.starts_with(|digit: char| digit.is_ascii_hexdigit())
            && !log.lines().next().unwrap().contains("keyed")
    );
    assert_eq!(findings(scene), "");
}

#[test]
fn a_log_that_something_else_has_made_longer_is_put_aside_and_continued_from_its_recorded_end() {
    let mut scene = keyed();
    let key = AuditKey::new([0x5a; 32]);
    let end = Chain::verify(&scene.rig.store.records[LOG], Some(&key)).chain;
    let junk = format!("{}}}\n", "x".repeat(1_022)).repeat(3 << 10);
    let log = scene.rig.store.records.get_mut(LOG).unwrap();
    log.extend_from_slice(junk.as_bytes());
    for _ in 0..2 {
        let before = scene.rig.log.len();
        scene.rig.restart_bridge();
        scene.rig.run(0.1);
        let mut entries = scene.rig.log[before..].iter();
        let words = "has more than 2097152 bytes";
        assert!(entries.any(|entry| entry.text.contains(words)));
        assert!(scene.rig.store.records[&format!("{LOG}.1")].len() > 3 << 20);
        let log = Chain::verify(&scene.rig.store.records[LOG], Some(&key));
        assert_eq!((log.follows, log.broken), (end.clone(), None));
        hand_over(&mut scene, 1);
    }
}

/// What is done to the files of the store.
type Tampering = fn(&mut Scene);

#[test]
fn whatever_is_done_to_a_log_without_its_key_is_named_by_the_next_start() {
    fn log(scene: &mut Scene) -> &mut Vec<u8> {
        scene.rig.store.records.get_mut(LOG).unwrap()
    }
    fn cut_tail(scene: &mut Scene, lines: usize) {
        let text = String::from_utf8(log(scene).clone()).unwrap();
        let kept = text.lines().count() - lines;
        *log(scene) = text
            .lines()
            .take(kept)
            .map(|line| format!("{line}\n"))
            .collect::<String>()
            .into_bytes();
    }
    /// The log as it could be written by whoever has no key: from its fourth line on.
    fn rewritten(scene: &mut Scene) {
        let lines = String::from_utf8(log(scene).clone())
            .unwrap()
            .lines()
            .count();
        let mut chain = Chain::default();
        log(scene).clear();
        for _ in 0..lines {
            let (next, line) = chain.extended(
                None,
                std::time::Duration::from_secs(1_800_000_000),
                kit::bridge::vehicle_id(0),
                &vsm::session::Entry::NotKept,
            );
            chain = next;
            log(scene).extend_from_slice(line.as_bytes());
        }
    }
    fn without_end(scene: &mut Scene, name: &str) {
        let record = scene.rig.store.records.get_mut(RECORD).unwrap();
        let mut value: serde_json::Value = serde_json::from_slice(record).unwrap();
        value.as_object_mut().unwrap().remove(name).unwrap();
        *record = serde_json::to_vec(&value).unwrap();
    }
    let cases: [(&str, Tampering); 12] = [
        ("its end was cut off", |scene| cut_tail(scene, 1)),
        ("its end was cut off", |scene| {
            // An older copy.
            let older = log(scene).clone();
            hand_over(scene, 1);
            *log(scene) = older;
        }),
        ("is deleted", |scene| {
            scene.rig.store.records.remove(LOG);
        }),
        ("is broken: line", |scene| {
            let text = String::from_utf8(log(scene).clone()).unwrap();
            *log(scene) = text.replacen("released", "granted", 1).into_bytes();
        }),
        ("is not the line that was recorded", rewritten),
        ("is not by the key", |scene| {
            // The record follows the log that was cut.
            cut_tail(scene, 1);
            let text = String::from_utf8(log(scene).clone()).unwrap();
            let last = text.lines().last().unwrap()[..64].to_owned();
            let record = scene.rig.store.records.get_mut(RECORD).unwrap();
            let mut value: serde_json::Value = serde_json::from_slice(record).unwrap();
            value["audit"]["lines"] = text.lines().count().into();
            value["audit"]["digits"] = last.into();
            *record = serde_json::to_vec(&value).unwrap();
        }),
        ("no end of it is recorded", |scene| {
            cut_tail(scene, 1);
            without_end(scene, "audit");
        }),
        ("no end of it is recorded", |scene| {
            scene.rig.store.records.remove(LOG);
            without_end(scene, "audit");
            without_end(scene, "monitors");
        }),
        ("audit-monitors-1b000101.log: no end", |scene| {
            flip(scene, 1);
            let log = scene.rig.store.records.get_mut(MONITORS).unwrap();
            let last = log[..log.len() - 1].iter().rposition(|byte| *byte == b'\n');
            log.truncate(last.unwrap() + 1);
            without_end(scene, "monitors");
        }),
        ("audit-monitors-1b000101.log: no end", |scene| {
            flip(scene, 1);
            scene.rig.store.records.remove(MONITORS);
            without_end(scene, "monitors");
        }),
        ("lines by another key", |scene| {
            let key = "a5".repeat(32).into_bytes();
            scene.rig.store.records.insert("audit.key".to_owned(), key);
        }),
        ("is deleted", |scene| {
            flip(scene, 1);
            scene.rig.store.records.remove(MONITORS);
        }),
    ];
    for (number, (expected, tamper)) in cases.into_iter().enumerate() {
        let mut scene = keyed();
        tamper(&mut scene);
        let found = findings(scene);
        assert!(
            found.contains(expected),
            "case {number}: {expected}: {found}"
        );
    }
}

/// A log of control over ten files, of which eight and the one being written are kept, with a key.
fn over_ten_files() -> Scene {
    let mut scene = keyed();
    let key = AuditKey::new([0x5a; 32]);
    for _ in 0..10 {
        let mut bytes = scene.rig.store.records[LOG].clone();
        let mut chain = Chain::verify(&bytes, Some(&key)).chain;
        let (wall, vehicle) = (scene.rig.now().wall, kit::bridge::vehicle_id(0));
        while bytes.len() < 1 << 20 {
            let entry = vsm::session::Entry::NotKept;
            let (next, line) = chain.extended(Some(&key), wall, vehicle, &entry);
            chain = next;
            bytes.extend_from_slice(line.as_bytes());
        }
        scene.rig.store.records.insert(LOG.to_owned(), bytes);
        scene.rig.restart_bridge();
        scene.rig.run(0.1);
    }
    scene
}

/// The chain of what is left shows no older file: only their number does, and the names are whoever deletes files free to choose.
#[test]
fn no_file_is_deleted_unnoticed_by_giving_its_name_to_another() {
    let whole = over_ten_files();
    let copy = || {
        let mut scene = keyed();
        let records = &mut scene.rig.store.records;
        records.clone_from(&whole.rig.store.records);
        scene
    };
    assert_eq!(findings(copy()), "");

    // All but the newest two.
    let mut scene = copy();
    let records = &mut scene.rig.store.records;
    let newest = records.remove(&format!("{LOG}.1")).unwrap();
    for number in 2..=8 {
        records.remove(&format!("{LOG}.{number}")).unwrap();
    }
    records.insert(format!("{LOG}.8"), newest);
    let found = findings(scene);
    assert!(found.contains("a file was changed or deleted"), "{found}");

    // All but the newest, with what a crash could have left of a line in their place.
    let mut scene = copy();
    let records = &mut scene.rig.store.records;
    let first = String::from_utf8_lossy(&records[LOG]).into_owned();
    let first = first.lines().next().unwrap();
    for number in 1..=8 {
        let torn = format!("{first} \n").into_bytes();
        records.insert(format!("{LOG}.{number}"), torn).unwrap();
    }
    let found = findings(scene);
    assert!(found.contains("a file was changed or deleted"), "{found}");
}
