//! The audit log: put aside when it has grown, its chain unbroken over files and restarts; status alone costs no wait
//! for the disk.

use crate::scene::{A, B, CONTROL, Scene};
use stanag_msgs::enums::{AckType, RequestedAccess};
use vsm::session::Chain;

const LOG: &str = "audit-1b000101.log";

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
    let length = scene.rig.store.records[LOG].len();
    for _ in 0..20 {
        let ticket = scene.ask(B, RequestedAccess::Request, 0x01);
        assert_eq!(scene.end(B, ticket), Some(AckType::CarriedOut));
    }
    assert_eq!(scene.rig.store.records[LOG].len(), length);
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
        let mut chain = Chain::verify(&bytes).chain;
        let vehicle = kit::bridge::vehicle_id(0);
        while bytes.len() < 1 << 20 {
            let entry = vsm::session::Entry::NotKept;
            let (next, line) = chain.extended(scene.rig.now().wall, vehicle, &entry);
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
        let verified = Chain::verify(&scene.rig.store.records[&name]);
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
