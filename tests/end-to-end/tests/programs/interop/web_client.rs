//! The example of a web client, which shares no code with the bridge, flies from take to release; and with another key it is nobody.

use std::time::Duration;

use kit::process::{Running, write_key};
use vsm_tests::ground::Ground;
use vsm_tests::peers_python;

const CLIENT: &str = "1b:00:00:b0";

#[test]
fn the_example_takes_control_launches_loiters_lands_and_releases() {
    let ground = Ground::with_tables(
        "[web]\ncontrol = true\n[[cucs]]\nid = \"1b:00:00:b0\"\nloi = [2, 4, 5]\n\
         guard = { key_file = \"b0.key\" }\nweb = true\n",
    );
    write_key(&ground.path("b0.key"), &[0x5a; 32]);
    write_key(&ground.path("other.key"), &[0x5b; 32]);
    let bridge = ground.bridge();
    let _aircraft = ground.aircraft();
    let example = kit::workspace().join("examples/web_client.py");
    let run = |key: &str| {
        let (example, key) = (example.display().to_string(), ground.path(key));
        let page = ground.page().replace("http://", "").replace('/', "");
        let key = key.display().to_string();
        let arguments = [example.as_str(), &page, CLIENT, &key];
        let mut flight = Running::start(&peers_python(), arguments);
        let status = flight.wait(Duration::from_secs(120));
        (
            status.is_some_and(|status| status.success()),
            flight.output(),
        )
    };
    let (flown, output) = run("other.key");
    assert!(!flown && output.contains("4003"), "{output}");
    let (flown, output) = run("b0.key");
    assert!(flown, "{output}\n----\n{}", bridge.output());
    assert!(output.contains("landed and released"), "{output}");
}
