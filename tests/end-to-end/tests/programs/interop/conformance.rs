//! The fast set of the conformance suite, and of that for MAVLink endpoints: a handful of rules on the bridge and on the second VSM, three faults that have to
//! fail, and both ground stations without an operator. `cargo xtask conform` runs the full set.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use kit::process::{Running, free_udp_port, program};
use serde_json::Value;
use tempfile::TempDir;
use vsm_tests::ground::Ground;
use vsm_tests::{here, plain_python};

/// Discovery, rights, acknowledgement, the form of messages: what everything else rests on.
const FEW: [&str; 7] = [
    "DISC-001", "DISC-003", "AUTH-001", "AUTH-002", "ACK-001", "WRAP-003", "PV-003",
];
/// A busy machine needs several times what it takes alone.
const LIMIT: Duration = Duration::from_secs(170);

/// What `dli-check` found: its exit status, and its report.
struct Judged {
    status: Option<i32>,
    report: Value,
    output: String,
}

impl Judged {
    fn verdict(&self, rule: &str) -> &str {
        let rules = self.report["rules"].as_array().expect("rules");
        let found = rules.iter().find(|found| found["id"] == rule);
        found.map_or("not judged", |found| {
            found["verdict"].as_str().expect("a verdict")
        })
    }

    fn passes(&self, rules: &[&str]) {
        for rule in rules {
            assert_eq!(self.verdict(rule), "pass", "{rule}\n{}", self.output);
        }
    }
}

/// Runs it to its end in this folder, with our programs on the path.
fn dli_check(folder: &Path, arguments: &[&str]) -> Judged {
    check("dli-check", folder, arguments)
}

fn check(judge: &str, folder: &Path, arguments: &[&str]) -> Judged {
    let own = program(judge);
    let beside = own.parent().expect("the folder of the programs");
    let path = std::env::var("PATH").unwrap_or_default();
    let report = tempfile::tempdir().expect("a folder");
    let json = report.path().join("report.json");
    let mut run = Running::spawn(
        Command::new(&own)
            .args(arguments)
            .arg("--json")
            .arg(&json)
            .env("PATH", format!("{}:{path}", beside.display()))
            .current_dir(folder),
    );
    let status = run.wait(LIMIT).and_then(|status| status.code());
    let output = run.output();
    let text = fs::read(&json).unwrap_or_else(|error| panic!("{error}: {output}"));
    Judged {
        status,
        report: serde_json::from_slice(&text).expect("report.json"),
        output,
    }
}

/// The few rules on a VSM.
fn judge_vsm(address: &str) -> Judged {
    judge_in("4", address, &FEW)
}

fn judge_in(edition: &str, address: &str, rules: &[&str]) -> Judged {
    let mut arguments = vec!["vsm", address, "--edition", edition];
    arguments.extend(["--simulated", "--speed", "10", "--quiet"]);
    for rule in rules {
        arguments.extend(["--rule", rule]);
    }
    dli_check(here(), &arguments)
}

/// The same in Edition 2.5, where a message type is acknowledged after #1401 and nothing has a presence vector.
const FEW_25: [&str; 8] = [
    "DISC-001", "DISC-003", "AUTH-001", "AUTH-002", "ACK-004", "WRAP-002", "WRAP-003", "WRAP-006",
];

#[test]
fn the_bridge_passes_the_few_rules_in_each_edition() {
    let editions: [(&str, &[&str]); 3] = [("4", &FEW), ("3", &FEW), ("2.5", &FEW_25)];
    std::thread::scope(|scope| {
        for (edition, rules) in editions {
            scope.spawn(move || {
                let ground =
                    Ground::with_tables("[[cucs]]\nid = \"1b:00:00:a1\"\nloi = [2, 3, 4, 5]\n");
                let _bridge = ground.bridge();
                let _aircraft = ground.aircraft();
                let judged = judge_in(edition, &ground.dli(), rules);
                judged.passes(rules);
                assert_eq!(judged.status, Some(0), "{edition} {}", judged.output);
            });
        }
    });
}

#[test]
fn a_ground_station_of_edition_2_5_is_judged_up_to_its_launch() {
    let listen = format!("127.0.0.1:{}", free_udp_port());
    let script = here().join("interop/cucs_ed25.py");
    let command = format!(
        "{} {} --vsm {{vsm}}",
        plain_python().display(),
        script.display()
    );
    let mut arguments = vec![
        "cucs",
        "--edition",
        "2.5",
        "--listen",
        &listen,
        "--scenario",
        "normal",
    ];
    // Enough for everything up to the launch, for which the scripted vehicle does not climb.
    arguments.extend(["--time", "5", "--command", &command]);
    let judged = dli_check(here(), &arguments);
    judged.passes(&[
        "WRAP-002",
        "WRAP-003",
        "WRAP-006",
        "WRAP-011",
        "WRAP-015",
        "SCALAR-002",
        "TIME-001",
        "DISC-008",
        "AUTH-014",
        "ROUTE-022",
    ]);
    assert_eq!(judged.status, Some(0), "{}", judged.output);
}

fn second_vsm(options: &[&str]) -> (Running, String) {
    let port = free_udp_port().to_string();
    let script = here().join("interop/second_vsm.py").display().to_string();
    let mut arguments = vec![script.as_str(), "--port", &port, "--speed", "10"];
    arguments.extend(options);
    let mut vsm = Running::start(&plain_python(), arguments);
    vsm.wait_for("ready", Duration::from_secs(30));
    (vsm, format!("127.0.0.1:{port}"))
}

#[test]
fn the_second_vsm_passes_them_and_three_faults_do_not() {
    let (_vsm, address) = second_vsm(&[]);
    let judged = judge_vsm(&address);
    judged.passes(&FEW);
    assert_eq!(judged.status, Some(0), "{}", judged.output);
    let faults = [
        ("V03", "WRAP-003"),
        ("V28", "DISC-003"),
        ("V32", "AUTH-002"),
    ];
    std::thread::scope(|scope| {
        for (fault, rule) in faults {
            scope.spawn(move || {
                let (_vsm, address) = second_vsm(&["--mutant", fault]);
                let judged = judge_vsm(&address);
                assert_eq!(judged.verdict(rule), "fail", "{fault}\n{}", judged.output);
                assert_eq!(judged.status, Some(1), "{fault}\n{}", judged.output);
            });
        }
    });
}

#[test]
fn our_ground_station_is_judged_without_an_operator() {
    let folder = here().join("../examples/dli-check");
    let scenarios: [&[&str]; 4] = [
        &["normal"],
        &["handover", "odd"],
        &["deny", "revoke"],
        &["damaged", "malformed"],
    ];
    std::thread::scope(|scope| {
        for names in scenarios {
            let folder = &folder;
            scope.spawn(move || {
                let listen = format!("127.0.0.1:{}", free_udp_port());
                let mut arguments = vec![
                    "cucs",
                    "--listen",
                    &listen,
                    "--profile",
                    "cucs.toml",
                    "--expected",
                    "cucs-known.toml",
                ];
                for name in names {
                    arguments.extend(["--scenario", name]);
                }
                let judged = dli_check(folder, &arguments);
                // What a scenario does not show is not needed there: only a step that is not done and an unexpected fail are errors.
                assert!(
                    !judged.output.contains(" came within "),
                    "{}",
                    judged.output
                );
                let unexpected: Vec<&Value> = judged.report["rules"]
                    .as_array()
                    .expect("rules")
                    .iter()
                    .filter(|rule| {
                        rule["verdict"] == "fail"
                            && !["AUTH-014", "AUTH-015", "MODE-016"]
                                .contains(&rule["id"].as_str().unwrap_or_default())
                    })
                    .collect();
                assert!(
                    unexpected.is_empty(),
                    "{names:?} {unexpected:?}\n{}",
                    judged.output
                );
                if names[0] == "normal" {
                    judged.passes(&["DISC-008", "ROUTE-022", "ACK-008", "SCALAR-003"]);
                }
                if names[0] == "damaged" {
                    judged.passes(&["WRAP-010", "ROBUST-001", "ROBUST-005"]);
                }
            });
        }
    });
}

/// The second ground station in these scenarios, with these faults.
fn judge_second_cucs(scenarios: &[&str], faults: &[&str]) -> Judged {
    let folder = TempDir::new().expect("a folder");
    let operator = here().join("interop/cucs_operator.py");
    let control = free_udp_port().to_string();
    let mut made = Command::new(plain_python());
    made.arg(&operator)
        .args(["--profile", &control])
        .args(faults);
    let profile = made.output().expect("python").stdout;
    fs::write(folder.path().join("profile.toml"), profile).expect("the profile");
    let listen = format!("127.0.0.1:{}", free_udp_port());
    let mut arguments = vec!["cucs", "--listen", &listen, "--profile", "profile.toml"];
    for scenario in scenarios {
        arguments.extend(["--scenario", scenario]);
    }
    dli_check(folder.path(), &arguments)
}

#[test]
fn the_second_ground_station_passes_and_its_faults_do_not() {
    let lawful: [(&[&str], &[&str]); 3] = [
        (
            &["normal"],
            &[
                "DISC-008",
                "CONF-010",
                "CONF-011",
                "MODE-016",
                "ALERT-007",
                "ALERT-008",
                "PV-008",
            ],
        ),
        (&["revoke", "damaged"], &["AUTH-015", "WRAP-010"]),
        (&["handover", "odd"], &["HAND-008", "ROBUST-011"]),
    ];
    // What is found on the wire, by the operator's eyes, and by a station that no longer answers.
    let faults = [
        ("normal", "MODE-016n", "MODE-016"),
        ("normal", "MODE-016n2", "MODE-016"),
        ("damaged", "C03", "WRAP-010"),
        ("unloaded", "C16", "ROUTE-023"),
        ("odd", "C24", "ROBUST-011"),
    ];
    std::thread::scope(|scope| {
        for (scenarios, rules) in lawful {
            scope.spawn(move || {
                let judged = judge_second_cucs(scenarios, &[]);
                judged.passes(rules);
                assert_eq!(judged.status, Some(0), "{}", judged.output);
            });
        }
        for (scenario, fault, rule) in faults {
            scope.spawn(move || {
                let judged = judge_second_cucs(&[scenario], &[fault]);
                assert_eq!(judged.verdict(rule), "fail", "{fault}\n{}", judged.output);
            });
        }
    });
}

/// Frames, commands, parameters, missions and signatures.
const FEW_MAVLINK: [&str; 8] = [
    "FRAME-002",
    "CMD-002",
    "PARAM-004",
    "MISS-002",
    "SIGN-003",
    "SIGN-015",
    "SIGN-030",
    "SIGN-031",
];

/// Judges an autopilot that is begun with a port to send to and a key file.
fn judge_autopilot(rules: &[&str], begin: impl FnOnce(&str, &str) -> Running) -> Judged {
    let folder = TempDir::new().expect("a folder");
    let key = folder.path().join("uav1.key");
    fs::write(&key, "5a".repeat(32)).expect("the key");
    fs::set_permissions(&key, fs::Permissions::from_mode(0o600)).expect("the key");
    let (key, port) = (key.display().to_string(), free_udp_port().to_string());
    let _subject = begin(&port, &key);
    let link = format!("udpin:127.0.0.1:{port}");
    let mut arguments = vec!["autopilot", &link, "--key-file", &key];
    arguments.extend(["--simulated", "--strict", "--no-repeat"]);
    for rule in rules {
        arguments.extend(["--rule", rule]);
    }
    check("mavlink-check", folder.path(), &arguments)
}

/// A subject of the Python side, which has a codec of its own.
fn peer(arguments: &[&str]) -> Running {
    Running::spawn(
        Command::new(plain_python())
            .args(["-m", "mavlink_peers"])
            .args(arguments)
            .current_dir(here().join("interop")),
    )
}

#[test]
fn the_simulated_px4_passes_the_few_rules_of_mavlink_and_a_fault_does_not() {
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let judged = judge_autopilot(&FEW_MAVLINK, |port, key| {
                let link = format!("udpout:127.0.0.1:{port}");
                Running::start(&program("px4-sim"), ["--link", &link, "--key-file", key])
            });
            judged.passes(&FEW_MAVLINK);
            assert_eq!(judged.status, Some(0), "{}", judged.output);
        });
        scope.spawn(|| {
            let judged = judge_autopilot(&["SIGN-030"], |port, key| {
                let link = format!("127.0.0.1:{port}");
                let fault = ["--fault", "SIGN-030"];
                peer(
                    &[
                        &["autopilot", "--link", &link, "--key-file", key],
                        &fault[..],
                    ]
                    .concat(),
                )
            });
            assert_eq!(judged.verdict("SIGN-030"), "fail", "{}", judged.output);
        });
    });
}

#[test]
fn a_lawful_router_passes_its_rules_and_its_faults_do_not() {
    let judge = |fault: Option<&str>| {
        let ports = [free_udp_port().to_string(), free_udp_port().to_string()];
        let mut options = vec!["router", "--port", &ports[0], "--port", &ports[1]];
        let mut arguments = vec!["router".to_owned(), "--no-repeat".into()];
        for (end, port) in ["--vehicle", "--station"].iter().zip(&ports) {
            arguments.extend([(*end).to_owned(), format!("udpout:127.0.0.1:{port}")]);
        }
        if let Some(fault) = fault {
            options.extend(["--fault", fault]);
            arguments.extend(["--rule".into(), fault.to_owned()]);
        }
        let _router = peer(&options);
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        check("mavlink-check", here(), &arguments)
    };
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let judged = judge(None);
            judged.passes(&[
                "ROUTE-001",
                "ROUTE-002",
                "ROUTE-003",
                "ROUTE-009",
                "ROUTE-013",
            ]);
            assert_eq!(judged.status, Some(0), "{}", judged.output);
        });
        for fault in ["ROUTE-003", "ROUTE-009"] {
            scope.spawn(move || {
                let judged = judge(Some(fault));
                assert_eq!(judged.verdict(fault), "fail", "{fault} {}", judged.output);
            });
        }
    });
}

/// Subcommands of the two judges that need no subject, or find none here; the exit status, and what is printed.
const WITHOUT_SUBJECT: &[(&str, i32, &str)] = &[
    ("dli-check list", 0, "AUTH-002 "),
    ("dli-check list --json", 0, "\"AUTH-002\""),
    ("dli-check list --edition 2.5", 0, "not applicable"),
    ("dli-check explain AUTH-002", 0, "Judged by"),
    ("dli-check explain NONE-1", 2, "`dli-check list` shows all"),
    ("dli-check schema", 0, "\"$schema\""),
    ("dli-check capture nothing-there", 2, "nothing-there"),
    ("dli-check compare a.json b.json", 2, "a.json"),
    ("dli-check init 127.0.0.1:9", 3, "--cucs"),
    (
        "dli-check repeat AUTH-002 127.0.0.1:9 --times 1",
        0,
        "inconclusive",
    ),
    ("mavlink-check list", 0, "SIGN-003 "),
    ("mavlink-check list --json", 0, "\"SIGN-003\""),
    ("mavlink-check explain SIGN-003", 0, "Pitfall"),
    (
        "mavlink-check explain NONE-1",
        2,
        "`mavlink-check list` shows all",
    ),
    (
        "mavlink-check repeat SIGN-003 udpin:127.0.0.1:0 --times 1",
        0,
        "inconclusive",
    ),
];

/// What is judged in the tests above.
const WITH_SUBJECT: [&str; 5] = [
    "dli-check vsm",
    "dli-check cucs",
    "mavlink-check autopilot",
    "mavlink-check station",
    "mavlink-check router",
];

#[test]
fn every_subcommand_of_the_judges_is_run() {
    for command in [conformance::command(), mavlink_check::command()] {
        for sub in command.get_subcommands() {
            let line = format!("{} {}", command.get_name(), sub.get_name());
            let here = WITHOUT_SUBJECT.iter();
            let mut here =
                here.filter(|(one, ..)| format!("{one} ").starts_with(&format!("{line} ")));
            assert!(
                here.clone().next().is_some() != WITH_SUBJECT.contains(&line.as_str()),
                "{line}"
            );
            let json = (sub.get_arguments()).find(|one| one.get_long() == Some("json"));
            // With a file behind it, it is a report.
            if json.is_some_and(|json| !json.get_action().takes_values()) {
                assert!(
                    here.any(|(one, ..)| one.ends_with(" --json")),
                    "{line} --json"
                );
            }
        }
    }
    let folder = TempDir::new().expect("a folder");
    std::thread::scope(|scope| {
        for (line, status, shown) in WITHOUT_SUBJECT {
            let folder = folder.path();
            scope.spawn(move || {
                let (name, rest) = line.split_once(' ').expect("words");
                let mut command = Command::new(program(name));
                let command = command.args(rest.split(' ')).current_dir(folder);
                let output = command.output().expect(name);
                let printed = String::from_utf8_lossy(&output.stdout).into_owned();
                let both = printed.clone() + &String::from_utf8_lossy(&output.stderr);
                assert_eq!(output.status.code(), Some(*status), "{line}: {both}");
                assert!(
                    both.contains(shown) && !both.contains("panicked"),
                    "{line}: {both}"
                );
                if line.ends_with("--json") {
                    assert!(serde_json::from_str::<Value>(&printed).is_ok(), "{line}");
                }
            });
        }
    });
}
