//! An earlier process was ended with a handover open: which key the vehicle has is found out.

use std::fs;
use std::time::Duration;

use serde_json::Value;

use crate::ground::{FIRST, Ground, SECOND, id, is_live_under, key};

/// An earlier process was ended with a handover open: the vehicle has the new key.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_bridge_finds_out_that_the_vehicle_has_the_next_key() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    ground.write_key("uav1.key.next", SECOND);
    let _vehicle = ground.vehicle(Some(SECOND), 0).await;
    let _bridge = ground.start_bridge();
    ground
        .link_status("the next key", |link| is_live_under(link, &id(SECOND)))
        .await;
    ground
        .files("the next one in force", |ground| {
            !ground.has("uav1.key.next") && ground.key("uav1.key").same_as(&key(SECOND))
        })
        .await;
    assert!(ground.key("uav1.key.previous").same_as(&key(FIRST)));
}

/// The same, and the vehicle has the old key: only half a minute of nothing else throws the new one away.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_bridge_finds_out_that_the_vehicle_has_kept_its_key() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    ground.write_key("uav1.key.next", SECOND);
    let _vehicle = ground.vehicle(Some(FIRST), 0).await;
    let _bridge = ground.start_bridge();
    let link = ground
        .link_status("settling", |link| link["state"] == "settling")
        .await;
    assert_eq!(link["key_id"], Value::Null, "{link:#}");
    tokio::time::sleep(Duration::from_secs(20)).await;
    assert!(ground.has("uav1.key.next"), "nothing is thrown away early");
    ground
        .link_status("the old key", |link| is_live_under(link, &id(FIRST)))
        .await;
    ground
        .files("the next one deleted", |ground| {
            !ground.has("uav1.key.next")
        })
        .await;
    assert!(ground.key("uav1.key").same_as(&key(FIRST)));
}

/// "A random one that nobody else holds": not the one that an earlier command left half-way.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_revocation_after_an_unfinished_handover_ends_with_a_key_of_its_own() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    ground.write_key("uav1.key.next", SECOND);
    let _vehicle = ground.vehicle(Some(FIRST), 0).await;
    let (done, printed) = ground.command(&["key", "revoke", "--wait-s", "60"]).await;
    assert!(done, "{printed}");
    let now = ground.key("uav1.key");
    assert!(
        !now.same_as(&key(FIRST)) && !now.same_as(&key(SECOND)),
        "{printed}"
    );
    for part in ["previous", "next", "revoked"] {
        assert!(
            !ground.has(&format!("uav1.key.{part}")),
            "{part}: {printed}"
        );
    }
}

/// The command was ended after the key had been sent.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_bridge_deletes_a_revoked_key_too() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    ground.write_key("uav1.key.next", SECOND);
    fs::write(ground.path().join("uav1.key.revoked"), id(FIRST)).unwrap();
    let _vehicle = ground.vehicle(Some(SECOND), 0).await;
    let _bridge = ground.start_bridge();
    ground
        .link_status("the next key", |link| is_live_under(link, &id(SECOND)))
        .await;
    ground
        .files("the next one in force, the revoked one deleted", |ground| {
            !["uav1.key.next", "uav1.key.previous", "uav1.key.revoked"]
                .iter()
                .any(|name| ground.has(name))
                && ground.key("uav1.key").same_as(&key(SECOND))
        })
        .await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_first_key_that_was_never_sent_is_not_taken_for_one_that_the_vehicle_has() {
    let ground = Ground::new();
    let (done, printed) = ground.command(&["key", "provision", "--wait-s", "1"]).await;
    assert!(!done && printed.contains("nothing was sent"), "{printed}");
    assert!(
        !ground.has("uav1.key") && !ground.has("uav1.key.next"),
        "{printed}"
    );
    // Killed before it could send: the bridge does not begin to live under that key.
    ground.write_key("uav1.key.next", FIRST);
    let (done, printed) = ground.command(&["run", "--config", "vsm.toml"]).await;
    assert!(!done && printed.contains("vsm key provision"), "{printed}");
    assert!(!ground.has("uav1.key"));
}
