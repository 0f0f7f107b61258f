//! MAVProxy and the bridge share a vehicle: both read it and command it, and the bridge reports whose commands were not
//! its own. Behind the bridge (`[[forward]]`) MAVProxy commands by its own key, and MAVSDK watches.

use std::fs;
use std::time::Duration;

use sha2::{Digest as _, Sha256};

use kit::process::{Running, free_udp_port, write_key};
use vsm_tests::ground::Ground;
use vsm_tests::{here, peers_python};

#[test]
fn mavproxy_and_the_bridge_share_a_vehicle() {
    let ground = Ground::new();
    ground.set_key(&Sha256::digest(PASSPHRASE).into());
    let bridge = ground.bridge();
    let link = free_link();
    // In real time: MAVProxy waits by its own clock.
    let aircraft = ground.aircraft_with(&["--link", &format!("udpout:{link}")]);
    done(&ground, "mavproxy_shares.py", &link, [&bridge, &aircraft]);
}

/// The page's `[[forward]]`: with a key of its own, made from a word as the page has it.
#[test]
fn mavproxy_reads_and_arms_over_a_forward_with_its_own_key() {
    let link = free_link();
    let ground = Ground::with_tables(&format!(
        "[[forward]]\nname = \"mavproxy\"\nlink = \"udpout:{link}\"\nkey_file = \"mavproxy.key\"\ncommands = true\nsystem_id = 254\n"
    ));
    ground.set_key(&[0x52; 32]);
    write_key(
        &ground.path("mavproxy.key"),
        &Sha256::digest(PASSPHRASE).into(),
    );
    let bridge = ground.bridge();
    let aircraft = ground.aircraft_with(&[]);
    done(&ground, "mavproxy_beside.py", &link, [&bridge, &aircraft]);
}

/// The page's lines for MAVSDK, on ports of this test.
#[test]
fn mavsdk_watches_over_a_forward_as_the_page_has_it() {
    let link = free_link();
    let ground = Ground::with_tables(&format!(
        "[[forward]]\nname = \"mavsdk\"\nlink = \"udpout:{link}\"\nsystem_id = 247\n"
    ));
    ground.set_key(&[0x52; 32]);
    let bridge = ground.bridge();
    let _aircraft = ground.aircraft_with(&[]);
    let page = kit::workspace().join("docs/guide/beside-others.md");
    let page = fs::read_to_string(page).expect("the page");
    let lines = page.split("```python\n").nth(1).expect("a block");
    let lines = lines.split("```").next().expect("its end");
    let lines = lines.replace("127.0.0.1:14551", &link);
    let mut watcher = Running::start(&peers_python(), ["-c", &lines]);
    let status = watcher.wait(Duration::from_secs(60));
    let printed = watcher.output();
    let shown = status.is_some_and(|s| s.success()) && printed.contains("47.397");
    assert!(shown, "{status:?}\n{printed}\n----\n{}", bridge.output());
}

fn free_link() -> String {
    format!("127.0.0.1:{}", free_udp_port())
}

/// Runs a script that is MAVProxy beside a CUCS, to its good end.
fn done(ground: &Ground, script: &str, link: &str, beside: [&Running; 2]) {
    let folder = ground.path("mavproxy");
    fs::create_dir(&folder).expect("a folder for MAVProxy");
    let script = here().join("interop").join(script).display().to_string();
    let (dli, folder) = (ground.dli(), folder.display().to_string());
    let arguments = [
        script.as_str(),
        "--vsm",
        &dli,
        "--link",
        link,
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
        beside[0].output(),
        beside[1].output()
    );
}

/// MAVProxy makes its key from one word.
const PASSPHRASE: &str = "sesame";
/// It takes 40 s; a busy machine may need more.
const SHARING: Duration = Duration::from_secs(180);
