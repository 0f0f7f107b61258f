//! MAVProxy and the bridge share a vehicle: both read it and command it, and the bridge reports whose commands were not
//! its own.

use std::fs;
use std::time::Duration;

use sha2::{Digest as _, Sha256};

use kit::process::{Running, free_udp_port};
use vsm_tests::ground::Ground;
use vsm_tests::{here, peers_python};

#[test]
fn mavproxy_and_the_bridge_share_a_vehicle() {
    let ground = Ground::new();
    ground.set_key(&Sha256::digest(PASSPHRASE).into());
    let bridge = ground.bridge();
    let link = format!("127.0.0.1:{}", free_udp_port());
    // In real time: MAVProxy waits by its own clock.
    let aircraft = ground.aircraft_with(&["--link", &format!("udpout:{link}")]);
    let folder = ground.path("mavproxy");
    fs::create_dir(&folder).expect("a folder for MAVProxy");

    let script = here()
        .join("interop/mavproxy_shares.py")
        .display()
        .to_string();
    let (dli, folder) = (ground.dli(), folder.display().to_string());
    let arguments = [
        script.as_str(),
        "--vsm",
        &dli,
        "--link",
        &link,
        "--passphrase",
        PASSPHRASE,
        "--folder",
        &folder,
    ];
    let mut station = Running::start(&peers_python(), arguments);
    let status = station.wait(SHARING);
    assert!(
        status.is_some_and(|s| s.success()),
        "{status:?}\n{}\n----\n{}\n----\n{}",
        station.output(),
        bridge.output(),
        aircraft.output()
    );
}

/// MAVProxy makes its key from one word.
const PASSPHRASE: &str = "sesame";
/// It takes 40 s; a busy machine may need more.
const SHARING: Duration = Duration::from_secs(180);
