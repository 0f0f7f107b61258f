//! pymavlink as a ground station beside the bridge (`[[forward]]`): it verifies what it is sent under its own key, and
//! commands the vehicle with it; with the vehicle's key, and with what is on no list, it commands nothing. Without a key, on loopback, it
//! commands what is listed (`unsigned`).

use std::time::Duration;

use kit::process::{Running, free_udp_port, hex, write_key};
use vsm_tests::ground::Ground;
use vsm_tests::{here, peers_python};

#[test]
fn pymavlink_receives_and_commands_beside_the_bridge() {
    let listen = format!("127.0.0.1:{}", free_udp_port());
    let ground = Ground::with_tables(&format!(
        "[[forward]]\nname = \"pymavlink\"\nlink = \"udpout:{listen}\"\nkey_file = \"forward.key\"\ncommands = true\n"
    ));
    let (own, vehicles) = ([0x51; 32], [0x52; 32]);
    ground.set_key(&vehicles);
    write_key(&ground.path("forward.key"), &own);
    let bridge = ground.bridge();
    let aircraft = ground.aircraft_with(&[]);
    let script = here().join("interop/forward_client.py");
    let (script, own, vehicles) = (script.display().to_string(), hex(&own), hex(&vehicles));
    let arguments = [
        script.as_str(),
        "--listen",
        &listen,
        "--key",
        &own,
        "--refused-key",
        &vehicles,
    ];
    let mut client = Running::start(&peers_python(), arguments);
    let status = client.wait(Duration::from_secs(90));
    assert!(
        status.is_some_and(|status| status.success()),
        "{status:?}\n{}\n----\n{}\n----\n{}",
        client.output(),
        bridge.output(),
        aircraft.output()
    );
}

#[test]
fn pymavlink_without_a_key_commands_what_is_listed_for_it() {
    let at = format!("127.0.0.1:{}", free_udp_port());
    let ground = Ground::with_tables(&format!(
        "[[forward]]\nname = \"pymavlink\"\nlink = \"udpin:{at}\"\nunsigned = true\nlink_id = 7\n\
         commands = {{ commands = [400] }}\n"
    ));
    let bridge = ground.bridge();
    let aircraft = ground.aircraft_with(&[]);
    let script = here().join("interop/forward_client.py");
    let script = script.display().to_string();
    let arguments = [script.as_str(), "--unsigned", &at];
    let mut client = Running::start(&peers_python(), arguments);
    let status = client.wait(Duration::from_secs(90));
    assert!(
        status.is_some_and(|status| status.success()),
        "{status:?}\n{}\n----\n{}\n----\n{}",
        client.output(),
        bridge.output(),
        aircraft.output()
    );
}
