//! Three ground stations as processes of their own, each behind a network that loses, doubles and reorders, take
//! turns at one aircraft: requests, consent, refusal, a named successor, override, silence; and the bridge is killed
//! while one of them is in control.

use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::Value;

use kit::network::Faults;
use kit::process::{Running, program};
use kit::relay::Relay;
use vsm_tests::ground::Ground;
use vsm_tests::seed_from_clock;

const A: &str = "1b:00:00:a0";
/// May override, of a higher rank.
const B: &str = "1b:00:00:b0";
const C: &str = "1b:00:00:c0";

const TABLES: &str = r#"
[[cucs]]
id = "1b:00:00:b0"
loi = [2, 3, 4, 5]
override = true
rank = 1
[[cucs]]
id = "1b:00:00:c0"
loi = [2, 3, 4, 5]
"#;

const NETWORK: Faults = Faults {
    loss: 0.1,
    duplicate: 0.05,
    reorder: 0.05,
    overtaking: true,
    ..Faults::NONE.delayed_ms(5, 20)
};

/// A ground station at its prompt.
struct Console {
    id: &'static str,
    shell: Running,
    network: Relay,
}

impl Console {
    fn open(ground: &Ground, id: &'static str, seed: u64) -> Console {
        let network = Relay::start(&ground.dli(), NETWORK, seed);
        let address = network.address();
        let arguments = ["--vsm", address.as_str(), "--id", id, "shell"];
        let shell = Running::start_shell(&program("cucs"), arguments);
        Console { id, shell, network }
    }

    fn mark(&self) -> usize {
        self.shell.output().len()
    }

    /// Waits until it has printed one of these since the mark; which one.
    fn prints(&self, since: usize, expected: &[&str]) -> usize {
        let end = Instant::now() + PATIENCE;
        loop {
            let output = self.shell.output();
            let printed = output.get(since..).unwrap_or_default();
            if let Some(which) = expected.iter().position(|text| printed.contains(text)) {
                return which;
            }
            assert!(
                Instant::now() < end,
                "{}: none of {expected:?} within {PATIENCE:?}:\n{output}",
                self.id
            );
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Types a line, and waits until one of these is printed.
    fn does(&mut self, line: &str, expected: &[&str]) -> usize {
        let since = self.mark();
        self.shell.type_line(line);
        self.prints(since, expected)
    }

    /// Types a line that leads to this: again where the network has swallowed every try.
    fn succeeds(&mut self, line: &str, expected: &str) {
        for _ in 0..3 {
            if self.does(line, &[expected, "within", "refused"]) == 0 {
                return;
            }
        }
        panic!("{}: {line}:\n{}", self.id, self.shell.output());
    }

    /// Types a line that is refused, until the reason comes through.
    fn is_refused(&mut self, line: &str, reason: &str) {
        for _ in 0..8 {
            let which = self.does(line, &["this CUCS may hold", "within", "granted\n"]);
            assert_ne!(which, 2, "{}: {line}:\n{}", self.id, self.shell.output());
            if self.shell.output().contains(reason) {
                return;
            }
        }
        panic!(
            "{}: {line} without reason:\n{}",
            self.id,
            self.shell.output()
        );
    }
}

/// Who controls, by `vsm status`; `None` while it does not answer.
fn controller(ground: &Ground) -> Option<Value> {
    let config = ground.path("vsm.toml");
    let output = Command::new(program("vsm"))
        .args(["status", "--json", "--config"])
        .arg(config)
        .output()
        .ok()?;
    let status: Value = serde_json::from_slice(&output.stdout).ok()?;
    Some(status["vehicles"].as_array()?.first()?["controller"].clone())
}

#[test]
fn three_stations_take_turns_over_a_bad_network() {
    let seed = seed_from_clock();
    let ground = Ground::with_tables(TABLES);
    let bridge = ground.bridge();
    let _aircraft = ground.aircraft();
    let [mut a, mut b, mut c] = [(A, 1), (B, 2), (C, 3)]
        .map(|(id, n)| Console::open(&ground, id, seed.wrapping_mul(31).wrapping_add(n)));
    a.succeeds(
        "take --loi 2,4,5",
        "LOI 2, 4, 5 (monitor, control, launch) granted",
    );
    a.does("heartbeats on", &["heartbeats on"]);

    // Asked, and consented to.
    let (asked, answered) = (a.mark(), b.mark());
    b.shell.type_line("ask --loi 4,5");
    // The message 4, not the alert about it, which may come first: without it there is nothing to answer.
    a.prints(
        asked,
        &["1b:00:00:b0 requests LOI 4, 5 (control, launch): `consent`"],
    );
    assert_eq!(controller(&ground), Some(A.into()), "control stays so far");
    a.succeeds("consent", "handed over to 1b:00:00:b0");
    b.prints(answered, &["LOI 4, 5 (control, launch) is ours"]);
    assert_eq!(controller(&ground), Some(B.into()));

    // Named, and accepted.
    let (offered, answered) = (c.mark(), b.mark());
    c.succeeds(
        "discover",
        "LOI 2, 3, 4, 5 (monitor, payload, control, launch) authorised, none granted",
    );
    b.shell.type_line("successor 1b:00:00:c0 --loi 4,5");
    c.prints(offered, &["LOI 4, 5 (control, launch) is offered"]);
    c.succeeds("accept", "LOI 4, 5 (control, launch) is ours");
    b.prints(answered, &["1b:00:00:c0 has accepted"]);
    assert_eq!(controller(&ground), Some(C.into()));

    // Asked, and refused.
    let (asked, answered) = (c.mark(), a.mark());
    a.shell.type_line("ask --loi 4,5");
    c.prints(
        asked,
        &["1b:00:00:a0 requests LOI 4, 5 (control, launch): `consent`"],
    );
    c.succeeds("refuse", "refused to 1b:00:00:a0");
    a.prints(answered, &["handover (message 4) is refused"]);
    assert_eq!(controller(&ground), Some(C.into()));

    // By rank, and not without.
    a.is_refused("take --loi 4,5 --override", "may not override");
    b.succeeds(
        "take --loi 4,5 --override",
        "LOI 2, 4, 5 (monitor, control, launch) granted",
    );
    assert_eq!(controller(&ground), Some(B.into()));

    // The holder falls silent: another may take, and who comes back gets nothing by itself.
    b.does("heartbeats on", &["heartbeats on"]);
    std::thread::sleep(Duration::from_millis(2_500));
    drop(b);
    a.is_refused("take --loi 4,5", "1b:00:00:b0 holds it");
    let silent = Instant::now();
    while a.does(
        "take --loi 4,5",
        &[
            "granted; this CUCS may",
            "LOI 2, 4, 5 (monitor, control, launch) granted",
            "within",
        ],
    ) != 1
    {
        assert!(silent.elapsed() < PATIENCE, "{}", a.shell.output());
    }
    assert_eq!(controller(&ground), Some(A.into()));
    let mut b = Console::open(&ground, B, seed.wrapping_add(4));
    b.succeeds("discover", "none granted");

    // Nobody else is ever in control, before the kill or after it.
    drop(bridge);
    let killed = Instant::now();
    let bridge = ground.bridge();
    let back = loop {
        match controller(&ground) {
            Some(controller) => {
                assert_eq!(controller, Value::from(A));
                break killed.elapsed();
            }
            None => assert!(killed.elapsed() < Duration::from_secs(2)),
        }
    };
    print_figure(&format!(
        "after kill -9 in control again within {} ms",
        back.as_millis()
    ));
    assert!(back < Duration::from_secs(2), "{back:?}");
    c.is_refused("take --loi 4,5", "1b:00:00:a0 holds it");
    // It commands as before, and has not asked again.
    a.succeeds("launch 20", "launched");
    a.succeeds("wait airborne --within 20", "airborne,");
    assert_eq!(controller(&ground), Some(A.into()));
    let lost: Vec<u64> = [&a, &b, &c].map(|one| one.network.lost()).into();
    print_figure(&format!("datagrams lost on the way: {lost:?}"));
    assert!(lost.iter().any(|lost| *lost > 20), "{lost:?}");
    drop(bridge);
}

#[expect(
    clippy::print_stderr,
    reason = "figures are printed for whoever reads the test"
)]
fn print_figure(line: &str) {
    eprintln!("{line}");
}

/// Longer than a command's timeout (40 s), so that `cucs` itself says what is missing.
const PATIENCE: Duration = Duration::from_secs(60);
