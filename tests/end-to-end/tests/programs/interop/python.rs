//! The Python package of the codec: it agrees with the reference codecs of all editions, and the example that is written with
//! it flies.

use std::process::Command;
use std::time::Duration;

use kit::process::{Running, filter};
use vsm_tests::ground::Ground;
use vsm_tests::{here, peers_python, seed_from_clock};

#[test]
fn the_package_agrees_with_the_reference_codecs() {
    let script = here().join("interop/codec.py").display().to_string();
    let seed = seed_from_clock().to_string();
    let output = filter(&peers_python(), [script.as_str(), &seed], String::new());
    assert!(output.ends_with("messages agree\n"), "{output}");
}

#[test]
fn the_package_is_typed_throughout() {
    let package = kit::workspace().join("bindings/python");
    let mut check = Command::new(peers_python());
    let check = check.args([
        "-m",
        "mypy",
        "--strict",
        "--cache-dir",
        "/dev/null",
        "stanag_msgs",
    ]);
    let output = check.current_dir(package).output().expect("mypy");
    let found = String::from_utf8_lossy(&output.stdout).into_owned();
    let failed = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{found}{failed}");
    assert!(
        found.contains("no issues found in 2 source files"),
        "{found}"
    );
}

#[test]
fn the_example_flies_a_triangle_and_lands() {
    let ground = Ground::new();
    let bridge = ground.bridge();
    let _aircraft = ground.aircraft();
    let example = kit::workspace().join("examples/fly.py");
    let (example, dli) = (example.display().to_string(), ground.dli());
    let mut flight = Running::start(&peers_python(), [example.as_str(), &dli]);
    let status = flight.wait(Duration::from_secs(120));
    assert!(
        status.is_some_and(|status| status.success()),
        "{status:?}\n{}\n----\n{}",
        flight.output(),
        bridge.output()
    );
    assert!(
        flight.output().contains("landed and released"),
        "{}",
        flight.output()
    );
}
