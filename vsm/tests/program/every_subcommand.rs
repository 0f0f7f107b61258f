//! Every subcommand of `vsm` and `cucs` is run: those of `cucs` alone, with `--json` and in a script. They are counted by the
//! command lines themselves, so that one that is added without a run here fails.
//!
//! What a subcommand does in detail is tested elsewhere. Here none panics, hangs, or is mistaken for another, its exit status is one
//! of those documented, and with `--json` each line that it prints is JSON.

use std::collections::BTreeSet;
use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use kit::bridge::memory_folder;
use kit::process::{Running, free_udp_port, program};
use tempfile::TempDir;

/// How a subcommand ends.
#[derive(Debug, Clone, Copy)]
enum Ends {
    /// Status 0.
    Done,
    /// Status 1, with this in the reason.
    Refused(&'static str),
    /// Either: alone, without another station, a handover may be refused.
    Either,
}
use Ends::{Done, Either, Refused};

/// A flight, each line a subcommand of `cucs`.
const FLIGHT: &[(&str, Ends)] = &[
    ("discover", Done),
    ("vehicle 1b:00:01:01", Done),
    ("launch 30", Refused("run `cucs take` first")),
    ("take", Done),
    ("wait holds 2,4,5", Done),
    ("heartbeats off", Done),
    ("software", Done),
    ("ping", Done),
    ("ping --vehicle", Done),
    ("config --loi 4", Done),
    ("parameters NAV_DLL_ACT", Done),
    ("set NAV_DLL_ACT 0", Done),
    ("controls", Done),
    (
        "controls MPC_XY_CRUISE 6",
        Refused("no control MPC_XY_CRUISE"),
    ),
    ("contingency battery land --percent 5", Done),
    ("contingency", Done),
    ("contingency battery as-configured", Done),
    ("fence area.fence.toml", Done),
    ("fence", Done),
    ("fence --clear", Done),
    ("send square.route.toml", Done),
    ("download", Done),
    ("wait landed", Done),
    ("launch 30", Done),
    ("wait airborne", Done),
    ("wait mode loiter --within 60", Done),
    ("payload point 30 -40", Done),
    ("payload state", Done),
    ("payload rate 4 0", Done),
    ("payload at 47.3990,8.5472", Done),
    ("payload zoom 20", Done),
    ("payload zoom stop", Done),
    ("payload focus closer", Done),
    ("payload image ir", Done),
    ("payload photo", Done),
    ("payload record on", Done),
    ("payload record off", Done),
    ("payload cage", Done),
    ("payload stow", Refused("it can retract")),
    ("payload --station 2 photo", Refused("station 2")),
    ("mode loiter --altitude 40", Done),
    ("hold 1 --until battery=5 loiter", Done),
    ("held", Done),
    ("cancel --held 1", Done),
    ("loiter --altitude 40", Done),
    ("wait above 100", Done),
    ("wait below 9000", Done),
    ("fly --from 10", Done),
    ("wait waypoint 40 --within 60", Done),
    ("speed 8", Done),
    ("wait route-end --within 100", Done),
    ("watch --seconds 0.3 --every 0.1", Done),
    // Cameras are asked for theirs some seconds after the first station listens.
    ("payload streams", Done),
    ("sleep 0.1", Done),
    (
        "wait asked --within 0.5",
        Refused("no request from another CUCS"),
    ),
    (
        "wait offered --within 0.5",
        Refused("no offer from the holder"),
    ),
    (
        "wait alert nothing-like-it --within 0.5",
        Refused("no alert"),
    ),
    ("ask --loi 4", Either),
    (
        "consent 1b:00:00:b0 --within 0.3",
        Refused("no handover request"),
    ),
    ("refuse --within 0.3", Refused("no handover request")),
    ("successor 1b:00:00:b0", Either),
    ("accept --within 0.3", Refused("no offer received")),
    ("decline", Either),
    ("terminate cancel", Either),
    ("terminate arm", Refused("[vehicle.termination]")),
    ("terminate execute", Refused("[vehicle.termination]")),
    ("zeroize cancel", Either),
    ("zeroize arm", Refused("zeroize by message is off")),
    ("zeroize execute", Refused("zeroize by message is off")),
    ("land", Done),
    ("wait landed --within 120", Done),
    ("cancel", Either),
    ("clear", Done),
    ("traffic", Done),
    ("release", Done),
    ("wait lacks 4,5", Done),
];

/// The leaves of a command line, such as `wait landed`.
fn leaves(command: &clap::Command) -> BTreeSet<String> {
    fn collect(path: &str, command: &clap::Command, found: &mut BTreeSet<String>) {
        for sub in command.get_subcommands() {
            let path = format!("{path} {}", sub.get_name());
            // One with subcommands of its own may also be run without: `vsm airside`.
            if sub.get_subcommands().next().is_none() || !sub.is_subcommand_required_set() {
                found.insert(path.trim().to_owned());
            }
            collect(&path, sub, found);
        }
    }
    let mut found = BTreeSet::new();
    collect("", command, &mut found);
    found
}

/// The leaves that take `--json`.
fn json_leaves(command: &clap::Command) -> Vec<String> {
    let of = |leaf: &String| {
        let mut words = leaf.split_whitespace();
        let found = words.try_fold(command, |at, word| at.find_subcommand(word));
        found.is_some_and(|sub| {
            sub.get_arguments()
                .any(|one| one.get_long() == Some("json"))
        })
    };
    leaves(command).into_iter().filter(of).collect()
}

/// The leaves that no line begins with.
fn missing<'a>(leaves: &BTreeSet<String>, lines: impl Iterator<Item = &'a str>) -> Vec<String> {
    let lines: Vec<String> = lines.map(|line| line.to_owned() + " ").collect();
    let run = |leaf: &str| {
        lines
            .iter()
            .any(|line| line.starts_with(&format!("{leaf} ")))
    };
    leaves.iter().filter(|leaf| !run(leaf)).cloned().collect()
}

/// A folder with what `vsm init` writes, on ports of its own.
struct Scene {
    folder: TempDir,
    dli: String,
    link: String,
    running: Vec<Running>,
}

impl Scene {
    fn new() -> Scene {
        let folder = memory_folder();
        for name in ["square.route.toml", "area.fence.toml"] {
            let from = kit::workspace().join("examples").join(name);
            fs::copy(from, folder.path().join(name)).expect(name);
        }
        let scene = Scene {
            folder,
            dli: format!("127.0.0.1:{}", free_udp_port()),
            link: format!("127.0.0.1:{}", free_udp_port()),
            running: Vec::new(),
        };
        let output = scene.run(
            "vsm",
            &format!(
                "init --sitl --listen {} --link udpin:{}",
                scene.dli, scene.link
            ),
        );
        assert!(output.status.success(), "{}", text(&output));
        // What is derived from Edition 2 is refused by default.
        let file = scene.path("vsm.toml");
        let config = fs::read_to_string(&file).expect("the configuration");
        let config = config.replace("[dli]", "[dli]\nprovisional = \"all\"");
        fs::write(file, config).expect("the configuration");
        scene
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn start(&mut self, name: &str, words: &str) -> &mut Running {
        let mut command = Command::new(program(name));
        command
            .args(words.split(' '))
            .current_dir(self.folder.path());
        self.running.push(Running::spawn(&mut command));
        self.running.last_mut().expect("the one just started")
    }

    /// Bridge and vehicle, which has booted.
    fn flying() -> Scene {
        let mut scene = Scene::new();
        scene.start("vsm", "run").wait_for("ready", LIMIT);
        let words = format!(
            "--link udpout:{} --key-file uav1.key --speed 10 --payloads 1",
            scene.link
        );
        scene.start("px4-sim", &words).wait_for("ready", LIMIT);
        let end = Instant::now() + LIMIT;
        while text(&scene.run("vsm", "status")).contains("mode unknown") {
            assert!(Instant::now() < end, "{}", scene.running[0].output());
            std::thread::sleep(Duration::from_millis(200));
        }
        // Home is known and it can be armed some seconds later; simulated ones are a tenth.
        std::thread::sleep(Duration::from_secs(2));
        scene
    }

    /// Runs a program to its end; one that does not end is a failure.
    fn run(&self, name: &str, words: &str) -> Output {
        self.run_with(name, words, "")
    }

    fn run_with(&self, name: &str, words: &str, input: &str) -> Output {
        let typed = self.path("typed");
        fs::write(&typed, input).expect("what is typed");
        let mut child = Command::new("timeout")
            .arg("100")
            .arg(program(name))
            .args(words.split_whitespace())
            .current_dir(self.folder.path())
            .stdin(fs::File::open(&typed).expect("what is typed"))
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect(name);
        child.stdin.take();
        child.wait_with_output().expect("its end")
    }

    fn cucs(&self, options: &str, line: &str) -> Output {
        self.run("cucs", &format!("--vsm {} {options} {line}", self.dli))
    }
}

fn text(output: &Output) -> String {
    let both = [output.stdout.as_slice(), &output.stderr].concat();
    String::from_utf8_lossy(&both).into_owned()
}

fn check(what: &str, output: &Output, ends: Ends) {
    let (status, printed) = (output.status.code(), text(output));
    let good = match ends {
        Done => status == Some(0),
        Refused(reason) => status == Some(1) && printed.contains(reason),
        Either => matches!(status, Some(0 | 1)),
    };
    assert!(good, "{what}: {status:?}, expected {ends:?}:\n{printed}");
    // A panic's exit status is another, but a thread's is not.
    assert!(!printed.contains("panicked"), "{what}: {printed}");
}

#[test]
fn every_subcommand_of_cucs_is_run_alone() {
    let all = leaves(&cucs::program::command());
    assert!(all.len() > 40, "{all:?}");
    let missing = missing(&all, FLIGHT.iter().map(|(line, _)| *line));
    // They are what runs the others, in the tests below.
    assert_eq!(missing, ["script", "shell"], "without a line in FLIGHT");
    let scene = Scene::flying();
    for (line, ends) in FLIGHT {
        check(line, &scene.cucs("", line), *ends);
    }
    // Numbers are shown by name.
    let status = text(&scene.run("vsm", "status"));
    assert!(status.contains("16002 Heartbeat: "), "{status}");
}

#[test]
fn every_subcommand_of_cucs_is_run_with_json() {
    let scene = Scene::flying();
    for (line, ends) in FLIGHT {
        let output = scene.cucs("--json", line);
        check(line, &output, *ends);
        // What is downloaded is the file itself, in its own form.
        if matches!(*line, "download" | "fence") {
            continue;
        }
        for printed in String::from_utf8_lossy(&output.stdout).lines() {
            let value = serde_json::from_str::<serde_json::Value>(printed);
            assert!(
                value.is_ok_and(|value| value.is_object()),
                "{line}: {printed}"
            );
        }
        if let Refused(reason) = ends {
            let printed = String::from_utf8_lossy(&output.stdout).into_owned();
            assert!(
                printed.contains("\"error\"") && printed.contains(reason),
                "{line}: {printed}"
            );
        }
    }
}

#[test]
fn every_subcommand_of_cucs_is_run_in_a_script_and_a_shell() {
    let scene = Scene::flying();
    let mut good = String::new();
    let script = |lines: &str| {
        fs::write(scene.path("lines.cucs"), lines).expect("the script");
        scene.cucs("", "script lines.cucs")
    };
    for (line, ends) in FLIGHT {
        if let Done = ends {
            good = good + line + "\n";
            continue;
        }
        // A script ends at the first line that fails: the lines before it are one of their own.
        check(&good, &script(&good), Done);
        good.clear();
        let output = script(line);
        check(line, &output, *ends);
        let place = format!("lines.cucs:1: {line}");
        assert!(
            output.status.success() || text(&output).contains(&place),
            "{}",
            text(&output)
        );
    }
    check(&good, &script(&good), Done);

    let shell = format!("--vsm {} shell", scene.dli);
    let output = scene.run_with("cucs", &shell, "discover\nlunch\nquit\n");
    check("shell", &output, Done);
    let printed = text(&output);
    assert!(
        printed.contains("behind VSM") && printed.contains("lunch"),
        "{printed}"
    );
}

#[test]
fn with_two_vehicles_a_command_names_the_option_that_selects_one() {
    let mut scene = Scene::new();
    let second = "[[vehicle]]\nid = \"1b:00:01:02\"\nlink = \"udpin:127.0.0.1:0\"\nsystem_id = 2\nsigning = \"off\"\n";
    let config = fs::read_to_string(scene.path("vsm.toml")).expect("the configuration");
    fs::write(scene.path("vsm.toml"), config + second).expect("the configuration");
    scene.start("vsm", "run").wait_for("ready", LIMIT);
    let output = scene.cucs("", "take");
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    for part in ["1b:00:01:01", "1b:00:01:02", "--vehicle ID"] {
        assert!(text(&output).contains(part), "{part}: {}", text(&output));
    }
    check("take", &scene.cucs("--vehicle 1b:00:01:02", "take"), Done);
    for (options, reason) in [
        ("", "--vehicle ID"),
        (
            "--vehicle 1b:00:01:09",
            "1b:00:01:09 is not in the configuration",
        ),
    ] {
        let output = scene.run("vsm", &format!("key clock {options}"));
        assert_eq!(output.status.code(), Some(2), "{}", text(&output));
        assert!(text(&output).contains(reason), "{}", text(&output));
    }
}

/// What another test runs, which has the time or the surroundings that it needs: its file and its function.
const ELSEWHERE: &[(&str, &str, &str)] = &[
    (
        "doctor --json",
        "vsm/tests/program/doctor.rs",
        "each_fault_of_a_vehicles_link_has_its_line",
    ),
    (
        "zeroize --yes",
        "vsm/tests/program/zeroize.rs",
        "what_a_bridge_has_written_is_listed_and_erased_once_it_is_confirmed",
    ),
    (
        "klv",
        "tests/end-to-end/tests/programs/interop/klv.rs",
        "the_metadata_of_a_vehicle_is_read_by_other_decoders_alone_and_beside_a_video",
    ),
    // A flight of a minute.
    (
        "demo",
        "tests/end-to-end/tests/programs/documents/pages.rs",
        "the_commands_of_the_readme_fly_the_vehicle",
    ),
    // They change a vehicle's key, and find the agent.
    (
        "key rotate",
        "vsm/tests/keys/commands.rs",
        "a_vehicle_that_lost_its_key_is_given_another_one_on_the_operators_word",
    ),
    (
        "key revoke",
        "vsm/tests/keys/commands.rs",
        "a_revoked_key_is_gone_at_both_ends",
    ),
    ("pair", AIRSIDE, PAIRS),
    ("airside pair", AIRSIDE, PAIRS),
    // With nodes, and an etcd between them.
    (
        "fleet list --json",
        "tests/end-to-end/tests/programs/processes/fleet.rs",
        "a_node_that_is_killed_is_replaced_and_nothing_acknowledged_is_lost",
    ),
];
const AIRSIDE: &str = "tests/end-to-end/tests/programs/processes/airside.rs";
const PAIRS: &str = "both_sides_pair_agree_fly_rotate_and_survive_each_restart";

/// Whether a source file has a test of this name, and not one that is ignored.
fn has_test(source: &str, name: &str) -> bool {
    let Some((before, _)) = source.split_once(&format!("fn {name}() ")) else {
        return false;
    };
    let before = before.trim_end().trim_end_matches("async").trim_end();
    let attribute = before.lines().last().unwrap_or_default();
    attribute.starts_with("#[test]") || attribute.starts_with("#[tokio::test")
}

#[test]
fn what_is_run_elsewhere_is_run_by_a_test_that_is_there() {
    for (line, file, name) in ELSEWHERE {
        let source = fs::read_to_string(kit::workspace().join(file)).expect(file);
        assert!(has_test(&source, name), "{line}: {file} has no test {name}");
    }
    let source = "#[test]\nfn a() {}\n#[test]\n#[ignore]\nfn b() {}\nfn c() {}\n";
    assert!(has_test(source, "a"));
    assert!(["b", "c", "d"].iter().all(|name| !has_test(source, name)));
}

/// Before the bridge runs, while it runs, and while the agent runs.
const GROUND: &[&[(&str, Ends)]] = &[
    &[
        ("init other/vsm.toml --sitl", Done),
        ("check-config", Done),
        ("keygen another.key", Done),
        ("guard keygen guard.key", Done),
        ("guard rotate guard.key", Done),
        ("guard revoke guard.key", Done),
        (
            "guard run --cucs 1b:00:00:a0 --vsm-id 1b:00:00:01 --vsm 127.0.0.1:9 --key-file guard.key --store vsm.toml",
            Refused("it is a file"),
        ),
        (
            "access grant access.list --cucs 1b:00:00:a0 --vehicle 1b:00:01:01 --groups fly --guard-key 0123456789abcdef --until never",
            Refused("No such file"),
        ),
        (
            "access grant access.list --vsm-id 1b:00:00:01 --cucs 1b:00:00:a0 --vehicle 1b:00:01:01 --groups fly,launch --guard-key 0123456789abcdef --until 2027-01-31T00:00:00Z",
            Done,
        ),
        (
            "access revoke access.list --cucs 1b:00:00:a0 --groups launch",
            Done,
        ),
        (
            "access revoke access.list --cucs 1b:00:00:a1",
            Refused("no such entry"),
        ),
        (
            "access list access.list --key-file another.key",
            Refused("not signed"),
        ),
        ("access sign access.list --key-file another.key", Done),
        (
            "access sign access.list --key-file another.key --version 1",
            Refused("expected more than 1"),
        ),
        (
            "access sign access.list --key-file another.key --version 18446744073709551615",
            Done,
        ),
        (
            "access sign access.list --key-file another.key",
            Refused("the last that there is: make a new list"),
        ),
        ("access list access.list --key-file another.key", Done),
        (
            "access list access.list --key-file guard.key",
            Refused("does not verify"),
        ),
        ("guard status", Refused("is it running?")),
        ("guard pair --cucs 1b:00:00:a0", Refused("is it running?")),
        ("guard rotate --cucs 1b:00:00:a0", Refused("is it running?")),
        ("key provision --sitl-file px4.bin", Done),
        ("key list", Done),
        ("key clock", Done),
        ("fleet list", Refused("store.kind is \"files\"")),
        (
            "fleet drain --node beta",
            Refused("store.kind is \"files\""),
        ),
        (
            "fleet resume --node beta",
            Refused("store.kind is \"files\""),
        ),
        ("fleet move", Refused("store.kind is \"files\"")),
        ("status", Refused("is it running?")),
        ("decode", Done),
        ("encode", Done),
    ],
    &[
        ("run", Refused("in use by another vsm")),
        ("status", Done),
        ("status --json", Done),
        ("status --vehicle 1b:*", Done),
        ("status --vehicle nowhere", Refused("no vehicle has")),
        ("guard status", Done),
        ("guard status --json", Done),
        // It answers on standard output, and then that it was not done.
        ("guard pair --cucs 1b:00:00:ee", Refused("not done")),
        ("guard rotate --cucs 1b:00:00:a0", Refused("not done")),
        // Nothing of the vehicle is there to be read.
        ("check-vehicle --wait-s 1", Either),
        ("check-vehicle --wait-s 1 --json", Either),
        // The vehicle is silent.
        ("files ls", Refused("cannot be reached")),
        ("files get /a", Refused("cannot be reached")),
        ("files put vsm.toml /a", Refused("cannot be reached")),
        ("files rm /a", Refused("cannot be reached")),
        ("files mkdir /a", Refused("cannot be reached")),
        ("reload", Done),
        (
            "replay nothing-there",
            Refused("without a name it takes [record] dir of vsm.toml (--config)"),
        ),
        ("reload --json", Done),
        ("audit verify", Done),
        ("audit export", Done),
        ("audit export --format csv", Done),
    ],
    &[
        ("airside", Refused("airside")),
        ("airside status", Done),
        ("airside status --json", Done),
    ],
];

#[test]
fn every_subcommand_of_vsm_is_run() {
    let all = leaves(&vsm::program::command());
    let here = GROUND.iter().copied().flatten().map(|(line, _)| *line);
    let lines: Vec<&str> = here
        .chain(ELSEWHERE.iter().map(|(line, ..)| *line))
        .collect();
    let missing = missing(&all, lines.iter().copied());
    assert_eq!(missing, [""; 0], "without a line in GROUND or ELSEWHERE");
    let with_json: Vec<&str> = (lines.iter())
        .filter_map(|line| line.strip_suffix(" --json"))
        .collect();
    let without: Vec<_> = json_leaves(&vsm::program::command())
        .into_iter()
        .filter(|leaf| {
            !with_json
                .iter()
                .any(|line| format!("{line} ").starts_with(&format!("{leaf} ")))
        })
        .collect();
    assert_eq!(without, [""; 0], "without a line with --json");

    let mut scene = Scene::new();
    let agent =
        fs::read_to_string(kit::workspace().join("examples/airside.toml")).expect("the agent's");
    let agent = agent
        .replace(
            "udpin:127.0.0.1:14560",
            &format!("udpin:127.0.0.1:{}", free_udp_port()),
        )
        .replace(
            "serial:/dev/ttyS0:921600",
            &format!("udpin:127.0.0.1:{}", free_udp_port()),
        );
    fs::write(scene.path("airside.toml"), agent).expect("the agent's");
    for (lines, runs) in GROUND.iter().zip(["", "run", "airside"]) {
        if !runs.is_empty() {
            scene.start("vsm", runs).wait_for("ready", LIMIT);
        }
        for (line, ends) in *lines {
            let output = scene.run("vsm", line);
            check(line, &output, *ends);
            if line.ends_with("--json") {
                let value = serde_json::from_slice::<serde_json::Value>(&output.stdout);
                assert!(value.is_ok(), "{line}: {}", text(&output));
            }
        }
    }
    let px4_sim = px4_sim::program::command();
    assert_eq!(
        px4_sim.get_subcommands().count(),
        0,
        "px4-sim is run by the flights above"
    );
}

#[test]
fn what_cannot_be_decoded_or_encoded_is_an_exit_status() {
    let scene = Scene::new();
    let good = "000000021b000101ffffffff0bb92000020c\n";
    let json = "{\"id\": 3001, \"source\": 1, \"destination\": 2, \"fields\": {}}\n";
    for (program, good) in [("decode", good), ("encode", json)] {
        check(program, &scene.run_with("vsm", program, good), Done);
        // Every line is answered, also behind the one that is junk.
        let output = scene.run_with("vsm", program, &format!("junk\n{good}"));
        check(program, &output, Refused("1 of 2 lines not"));
        let answers = String::from_utf8_lossy(&output.stdout).into_owned();
        assert_eq!(answers.lines().count(), 2, "{answers}");
        assert!(answers.starts_with("{\"error\""), "{answers}");
    }
}

const LIMIT: Duration = Duration::from_secs(30);
