//! The second VSM and the second CUCS, on which the conformance suite is proved, do what they claim: each fault of
//! theirs shows, and without one they fly from discovery to landing.

use std::time::Duration;

use kit::process::Running;
use vsm_tests::{here, plain_python};

#[test]
fn the_second_vsm_and_the_second_cucs_pass_their_own_tests() {
    let tests = here().join("interop").display().to_string();
    let arguments = [
        "-m",
        "unittest",
        "discover",
        "--start-directory",
        &tests,
        "--pattern",
        "test_second_*.py",
    ];
    let mut run = Running::start(&plain_python(), arguments);
    let status = run.wait(TESTS);
    assert!(
        status.is_some_and(|s| s.success()),
        "{status:?}\n{}",
        run.output()
    );
}

/// They take two minutes, most of it waiting; a busy machine may need more.
const TESTS: Duration = Duration::from_secs(480);
