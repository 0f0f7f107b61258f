//! The documents: the commands of the README, of the quick start and of the first tasks do what is written, in their order;
//! every link leads somewhere; every `cargo xtask` task, source file and test that is named is there.
//! The files of a row of ARCHITECTURE.md hold what the row names.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread;
use std::time::{Duration, Instant};

use kit::bridge::memory_folder;
use kit::process::{Running, free_udp_port, program};
use resvg::tiny_skia::Rect;
use resvg::usvg::{Group, Node, Options, Tree};
use serde_json::{Value, json};
use vsm_tests::here;

#[test]
fn the_commands_of_the_readme_fly_the_vehicle() {
    run_all("README.md");
}

#[test]
fn the_commands_of_the_quick_start_fly_the_vehicle() {
    run_all("docs/guide/quick-start.md");
}

/// A task as a stranger does it who has just read how the tasks begin.
#[test]
fn each_first_task_typed_to_the_letter() {
    let (start, tasks) = first_tasks();
    thread::scope(|scope| {
        for (title, lines) in &tasks {
            let lines = [start.clone(), lines.clone()].concat();
            scope.spawn(move || type_all(title, &lines));
        }
    });
}

/// The whole page in one shell: a task leaves the vehicle so that the next can launch it.
#[test]
fn the_first_tasks_in_their_order_typed_to_the_letter() {
    let (start, tasks) = first_tasks();
    let lines = tasks.into_iter().flat_map(|(_, lines)| lines);
    type_all(
        "the whole page",
        &start.into_iter().chain(lines).collect::<Vec<_>>(),
    );
}

/// The lines before the first task, and those of each task with its title, but of the one that needs PX4's source.
fn first_tasks() -> (Vec<String>, Vec<(String, Vec<String>)>) {
    let text = fs::read_to_string(root().join("docs/guide/tasks.md")).expect("the page");
    let mut parts = text.split("\n## ");
    let start = lines_of_blocks(parts.next().expect("the beginning"));
    let tasks = parts.filter(|part| part.starts_with(|c: char| c.is_ascii_digit()));
    let tasks = tasks.map(|part| {
        assert!(
            !part.contains("\n    "),
            "a command outside of a block: {part}"
        );
        let title = part.lines().next().unwrap_or_default().to_owned();
        (title, lines_of_blocks(part))
    });
    let mut tasks: Vec<_> = tasks.collect();
    assert_eq!(tasks.len(), 10);
    tasks.retain(|(title, _)| title != "2. Your own PX4 SITL");
    assert_eq!(tasks.len(), 9, "task 2 has another title");
    (start, tasks)
}

/// Types lines at a shell with job control, and judges the status of each.
fn type_all(title: &str, lines: &[String]) {
    if lines.iter().any(|line| line.starts_with("tshark ")) && !kit::tools::is_installed("tshark") {
        return;
    }
    let scratch = Scratch::new();
    let folder = scratch.folder.path();
    let mut script = String::from("exec >transcript 2>&1\ntrap 'kill $(jobs -p)' EXIT\n");
    for line in lines {
        script += &scratch.typed(line);
        script += "\necho $? >>statuses\n";
    }
    let mut shell = Command::new("bash");
    let shell = shell.args(["-m", "-c", &script]).current_dir(folder);
    shell.status().expect("bash");
    let read = |name: &str| fs::read_to_string(folder.join(name)).unwrap_or_default();
    let transcript = read("transcript");
    let statuses = read("statuses");
    assert_eq!(
        statuses.lines().count(),
        lines.len(),
        "{title}: {transcript}"
    );
    let mut unlisted = false;
    for (line, status) in lines.iter().zip(statuses.lines()) {
        // What the page says of an id that is not listed.
        unlisted |= line.contains("1b:00:00:ff");
        let expected = match line {
            _ if line.contains("1b:00:00:ff") => "1",
            _ if unlisted && line.ends_with("vsm doctor") => "1",
            _ => "0",
        };
        assert_eq!(status, expected, "{title}: `{line}`\n{transcript}");
    }
    let named = "CUCS 1b:00:00:ff sends from 127.0.0.1, but is not listed";
    assert!(
        !unlisted || transcript.contains(named),
        "{title}: {transcript}"
    );
}

/// What a newcomer copies into a program of his own is what the page calls it.
#[test]
fn the_datagrams_of_the_first_tasks_are_what_they_are_called() {
    let all = json!(["LOI 2", "LOI 4", "LOI 5"]);
    let expected = [
        ("discover", 1, json!({})),
        (
            "take LOI 2, 4 and 5",
            1,
            json!({ "Requested/Handover LOI": all, "Requested/Handover Access": "request control" }),
        ),
        ("stay: a heartbeat each second", 16002, json!({})),
        (
            "acknowledge what asks for it",
            17000,
            json!({ "Original Message Time Stamp": 849_223_472_045_u64, "Original Message Type": 16002,
                    "Acknowledgement Type": "received (T)" }),
        ),
        (
            "launch to 30 m",
            2016,
            json!({ "Select Flight Path Control Mode": "launch", "Altitude Command Type": "altitude",
                    "Commanded Altitude": 30.0, "Altitude Type": "AGL" }),
        ),
        (
            "land",
            2016,
            json!({ "Select Flight Path Control Mode": "autoland engage" }),
        ),
        (
            "release",
            1,
            json!({ "Requested/Handover LOI": all, "Requested/Handover Access": "relinquish / hand off control" }),
        ),
    ];
    let text = fs::read_to_string(root().join("docs/guide/tasks.md")).expect("the page");
    let rows: Vec<_> = text
        .lines()
        .filter(|line| line.contains("| `0000"))
        .collect();
    assert_eq!(rows.len(), expected.len(), "{rows:#?}");
    for (row, (name, id, mut fields)) in rows.iter().zip(expected) {
        let datagram = row.strip_prefix(&format!("| {name} | `"));
        let datagram = datagram.and_then(|rest| rest.strip_suffix("` |"));
        let mut hex = datagram.expect(name).to_owned();
        // A `T` is in two of the other words too.
        for (word, bytes) in [
            ("SOURCE", "1b000101"),
            ("STAMP", "c5b9a9d3ad"),
            ("TYPE", "3e82"),
            ("T", "c5b9a9d3ad"),
            (" ", ""),
        ] {
            hex = hex.replace(word, bytes);
        }
        fields["Time Stamp"] = 849_223_472_045_u64.into();
        let decoded = stanag_msgs::json::decode_line(&hex, false);
        assert_eq!(decoded.len(), 1, "{name}: {decoded:?}");
        assert_eq!(decoded[0]["id"], id, "{name}: {decoded:?}");
        assert_eq!(decoded[0]["source"], 0x1b00_00c0_u32, "{name}: {decoded:?}");
        assert_eq!(decoded[0]["fields"], fields, "{name}: {decoded:?}");
    }
}

#[test]
fn the_five_commands_of_the_officers_page_switch_everything_on() {
    run_all("docs/guide/officer.md");
}

/// The demo is what a newcomer builds first, and waits for. Cargo builds a crate again for other features, and which it has depends on the
/// packages that are selected.
#[test]
fn what_the_demo_has_built_is_not_built_again() {
    let text = fs::read_to_string(root().join("README.md")).expect("the page");
    let commands = commands(&text);
    let at = |line: &str| commands.iter().position(|one| one == line);
    let (demo, rest) = (
        at("cargo run --release -- demo"),
        at("cargo build --release"),
    );
    assert!(demo.is_some() && demo < rest, "{commands:?}");
    // `cargo run` builds one program of the same packages: `default-run`.
    let (demo, rest) = (planned(&["--bin", "vsm"]), planned(&[]));
    let again: Vec<_> = demo.iter().filter(|unit| !rest.contains(*unit)).collect();
    assert!(
        again.is_empty() && demo.len() > 100,
        "built twice: {again:#?}"
    );
    let programs = [
        "cucs",
        "curve-plan",
        "dli-check",
        "mavlink-check",
        "px4-sim",
        "vsm",
    ];
    for program in programs {
        let is_built = |unit: &String| unit.contains(&format!("\"name\":\"{program}\""));
        assert!(rest.iter().any(is_built), "{program} is not built");
    }
}

/// What `cargo build --release` would compile, each unit with its features and profile.
fn planned(selection: &[&str]) -> BTreeSet<String> {
    let output = Command::new(env!("CARGO"))
        .args([
            "build",
            "--release",
            "--offline",
            "--unit-graph",
            "-Zunstable-options",
        ])
        .args(selection)
        // The plan is not shown by a stable Cargo otherwise; nothing is compiled.
        .env("RUSTC_BOOTSTRAP", "1")
        .current_dir(root())
        .output()
        .expect("cargo");
    let why = String::from_utf8_lossy(&output.stderr);
    let graph: Value =
        serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {why}"));
    let units = graph["units"].as_array().expect("units");
    let parts = [
        "pkg_id", "target", "mode", "features", "platform", "profile",
    ];
    let unit = |unit: &Value| parts.map(|part| unit[part].to_string()).join(" ");
    units.iter().map(unit).collect()
}

/// Where somebody reads which Rust to install.
const NAME_RUST: [&str; 6] = [
    "README.md",
    "docs/guide/install.md",
    "stanag-msgs/README.md",
    "mavlink-link/README.md",
    "bindings/python/README.md",
    "examples/dli-check/Dockerfile",
];

#[test]
fn the_rust_that_is_named_is_the_one_that_the_workspace_needs() {
    for page in NAME_RUST {
        let text = fs::read_to_string(root().join(page)).expect(page);
        let named = rust_versions(&text);
        let needed = env!("CARGO_PKG_RUST_VERSION");
        assert!(!named.is_empty(), "{page} names no version of Rust");
        assert!(
            named.iter().all(|one| one == needed),
            "{page}: {named:?}, Cargo.toml: {needed}"
        );
    }
    assert_eq!(
        rust_versions("PX4 1.18, Rust 1.9 and Rust version: 2.0."),
        ["1.9", "2.0"]
    );
}

/// The versions that follow the word, as in "Rust 1.88", "Rust version: 1.88" and "rust:1.88-alpine".
fn rust_versions(text: &str) -> Vec<String> {
    let text = text.to_ascii_lowercase();
    let after = text.split("rust").skip(1);
    let version = |rest: &str| {
        let near: String = rest.chars().take(20).collect();
        let mut words = near.split(|c: char| c != '.' && !c.is_ascii_digit());
        let dotted = words.find(|word| word.trim_matches('.').contains('.'))?;
        Some(dotted.trim_matches('.').to_owned())
    };
    after.filter_map(version).collect()
}

/// How many times faster than real time the vehicle of a page flies.
const SPEED: u32 = 5;

/// For what a page waits 10 s: the vehicle has booted, and the link is live.
const BOOT: Duration = Duration::from_secs(3);

/// For what takes its time: keys are agreed on, and the vehicle is given them.
const PATIENCE: Duration = Duration::from_secs(60);

/// Runs the commands of a page's `sh` blocks in a copy of the examples, on ports of its own; a command that is not known
/// here is a failure, so that none goes untried.
fn run_all(page: &str) {
    let scratch = Scratch::new();
    let text = fs::read_to_string(root().join(page)).expect(page);
    let lines = commands(&text);
    assert!(lines.len() > 5, "{page}: {lines:?}");
    let (mut running, mut code) = (Vec::new(), String::new());
    for line in lines {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["cargo", "build", ..] => {}
            ["sleep", _] => thread::sleep(BOOT),
            ["cargo", "xtask", task, ..] => assert!(tasks().contains(&task.to_owned()), "{line}"),
            ["cargo", "run", "--release", "--", "demo"] => {
                let printed = scratch.run("vsm", &["demo"]);
                let folder = printed.lines().last().expect("the folder");
                assert!(Path::new(folder).is_dir(), "{printed}");
            }
            [name, ref rest @ ..] if name.starts_with("./target/release/") => {
                let name = &name["./target/release/".len()..];
                match (name, rest.first()) {
                    ("vsm", Some(&"run" | &"airside" | &"guard")) | ("px4-sim", _) => {
                        let mut started = scratch.start(name, rest);
                        started.wait_for("ready", Duration::from_secs(10));
                        if rest.contains(&"--pair") {
                            started.wait_for("pairing code", Duration::from_secs(10));
                            code = pairing_code(&started.output());
                        }
                        running.push(started);
                    }
                    ("vsm", Some(&"pair")) => {
                        let rest = rest.iter().map(|word| word.replace("CODE", &code));
                        let rest: Vec<String> = rest.collect();
                        let rest: Vec<&str> = rest.iter().map(String::as_str).collect();
                        drop(scratch.run(name, &rest));
                    }
                    // What a page of a protected vehicle ends with: all of it is on.
                    ("vsm", Some(&"status")) if !code.is_empty() => scratch.await_protection(),
                    // Until keys are agreed on and the vehicle signs, nothing is discovered.
                    ("cucs", _) if !code.is_empty() => scratch.try_until(name, rest),
                    _ => drop(scratch.run(name, rest)),
                }
            }
            _ => panic!("{page}: nobody tries `{line}`"),
        }
    }
    // With an agent and a guard where there is a pairing.
    let expected = if code.is_empty() { 2 } else { 4 };
    assert_eq!(running.len(), expected, "{page}: a bridge and a vehicle");
}

/// What an agent shows at its open window.
fn pairing_code(printed: &str) -> String {
    let line = printed
        .lines()
        .find_map(|line| line.strip_prefix("pairing code"));
    line.expect("a code").trim().to_owned()
}

/// The lines of a page's `sh` blocks, without remarks and the `&` of what runs beside.
fn commands(text: &str) -> Vec<String> {
    let lines = lines_of_blocks(text).into_iter().map(|line| {
        let command = line.split(" #").next().unwrap_or_default().trim();
        command.trim_end_matches('&').trim().to_owned()
    });
    lines.filter(|line| !line.is_empty()).collect()
}

/// The lines of a page's `sh` blocks.
fn lines_of_blocks(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut within = false;
    for line in text.lines() {
        match line.trim() {
            "```sh" => within = true,
            "```" => within = false,
            line if within && !line.is_empty() => found.push(line.to_owned()),
            _ => {}
        }
    }
    found
}

/// A copy of the examples whose ports nobody has.
struct Scratch {
    folder: tempfile::TempDir,
    dli: String,
    mavlink: String,
    /// Between ground and agent, and where a guard listens.
    radio: String,
    guard: String,
}

impl Scratch {
    fn new() -> Scratch {
        let scratch = Scratch {
            folder: memory_folder(),
            dli: format!("127.0.0.1:{}", free_udp_port()),
            mavlink: format!("127.0.0.1:{}", free_udp_port()),
            radio: format!("127.0.0.1:{}", free_udp_port()),
            guard: format!("127.0.0.1:{}", free_udp_port()),
        };
        let to = scratch.folder.path().join("examples");
        fs::create_dir(&to).expect("the folder");
        for entry in fs::read_dir(root().join("examples")).expect("the examples") {
            let path = entry.expect("an entry").path();
            let text_of = ["toml", "cucs", "plan", "kml", "py"];
            if path
                .extension()
                .is_some_and(|e| text_of.iter().any(|kind| e == *kind))
            {
                let text = fs::read_to_string(&path).expect("an example");
                let name = path.file_name().expect("a name");
                fs::write(to.join(name), scratch.here(&text)).expect("its copy");
            }
        }
        // What else a clone has that the commands name.
        let at = |name: &str| scratch.folder.path().join(name);
        symlink(root().join("packaging"), at("packaging")).expect("the packaging");
        fs::create_dir(at("target")).expect("the folder");
        let built = program("vsm").parent().map(Path::to_owned);
        symlink(built.expect("a folder"), at("target/release")).expect("the programs");
        scratch
    }

    fn here(&self, text: &str) -> String {
        text.replace("127.0.0.1:4586", &self.dli)
            .replace("127.0.0.1:4587", &self.guard)
            .replace("127.0.0.1:14560", &self.radio)
            .replace("127.0.0.1:14550", &self.mavlink)
    }

    /// A line as it is typed here: at ports of its own, with programs that are built, and a vehicle that is quicker.
    fn typed(&self, line: &str) -> String {
        let line = self.here(line);
        let tool = line.trim_start().split(' ').next().unwrap_or_default();
        let tool = tool.strip_prefix("./target/release/");
        let add = |words: String| line.replacen(' ', &format!(" {words} "), 1);
        match (tool, line.as_str()) {
            (Some("cucs"), _) if !line.contains("--vsm") => add(format!("--vsm {}", self.dli)),
            (Some("px4-sim"), _) => add(format!("--speed {SPEED}")),
            (Some("vsm"), _) if line.contains("vsm init") => {
                let link = match line.contains("--protect") {
                    true => format!("udpout:{}", self.radio),
                    false => format!("udpin:{}", self.mavlink),
                };
                let init = format!("vsm init --listen {} --link {link}", self.dli);
                line.replacen("vsm init", &init, 1)
            }
            (None, line) if line.starts_with("cargo build") => "true".to_owned(),
            (None, line) if line.starts_with("sleep ") => format!("sleep {}", BOOT.as_secs()),
            // `cargo xtask peers` has installed the package from the same folder.
            (None, line) if line.starts_with("python3 -m venv .venv") => {
                let peers = here().join("interop/.venv");
                format!("ln -s '{}' .venv", peers.display())
            }
            (None, ".venv/bin/pip install ./bindings/python") => {
                ".venv/bin/python -c 'import stanag_msgs'".to_owned()
            }
            _ => line.clone(),
        }
    }

    fn arguments(&self, name: &str, rest: &[&str]) -> Vec<String> {
        let line = self.typed(&format!("./target/release/{name} {}", rest.join(" ")));
        line.split_whitespace().skip(1).map(str::to_owned).collect()
    }

    fn run(&self, name: &str, rest: &[&str]) -> String {
        let arguments = self.arguments(name, rest);
        let output = Command::new(program(name))
            .args(&arguments)
            .current_dir(self.folder.path())
            .output()
            .expect(name);
        let printed = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(
            output.status.success(),
            "{name} {arguments:?}: {printed}{}",
            String::from_utf8_lossy(&output.stderr)
        );
        // What init has written has the usual ports too.
        let agent = self.folder.path().join("airside.toml");
        if name == "vsm" && rest.first() == Some(&"init") && agent.exists() {
            let text = fs::read_to_string(&agent).expect("the agent's configuration");
            fs::write(&agent, self.here(&text)).expect("its copy");
        }
        printed
    }

    /// A person would type it again until it is done.
    fn try_until(&self, name: &str, rest: &[&str]) {
        let end = Instant::now() + PATIENCE;
        loop {
            let mut command = Command::new(program(name));
            let output = command.args(self.arguments(name, rest)).output();
            let output = output.expect(name);
            if output.status.success() {
                return;
            }
            let why = String::from_utf8_lossy(&output.stderr);
            assert!(Instant::now() < end, "{rest:?}: {why}");
            thread::sleep(Duration::from_millis(500));
        }
    }

    /// Until guard, access list, signature and encryption show in the status.
    fn await_protection(&self) {
        let end = Instant::now() + PATIENCE;
        loop {
            let status = self.run("vsm", &["status", "--json"]);
            let status: Value = serde_json::from_str(&status).expect("JSON");
            let (vehicle, station) = (&status["vehicles"][0], &status["stations"][0]);
            let link = &vehicle["link"];
            let all = link["encryption"]["state"] == "encrypted"
                && link["signed"] == true
                && link["state"] == "live"
                && station["guard"]["verified"].as_u64() > Some(0)
                && status["access"]["version"] == 1
                && vehicle["controller"] == "1b:00:00:a0";
            if all {
                return;
            }
            assert!(Instant::now() < end, "{status:#}");
            thread::sleep(Duration::from_millis(500));
        }
    }

    fn start(&self, name: &str, rest: &[&str]) -> Running {
        // A shell changes to the folder and becomes the program.
        let mut line = format!(
            "cd '{}' && exec '{}'",
            self.folder.path().display(),
            program(name).display()
        );
        for word in self.arguments(name, rest) {
            line += &format!(" '{word}'");
        }
        Running::start(Path::new("sh"), ["-c", &line])
    }
}

/// The pictures that are drawn by hand.
#[test]
fn no_text_of_a_drawing_crosses_an_edge() {
    for name in ["ports.svg", "architecture.svg"] {
        let svg = fs::read_to_string(root().join("docs/img").join(name)).expect(name);
        assert_eq!(crossings(&svg), Vec::<String>::new(), "{name}");
    }
    let crossing = r##"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 200 100" font-family="DejaVu Sans">
        <rect x="10" y="10" width="80" height="50"/><text x="20" y="40" font-size="14">far too long for it</text></svg>"##;
    assert_eq!(crossings(crossing), ["far too long for it"]);
}

/// The texts of a picture that are neither within nor outside of one of its shapes.
fn crossings(svg: &str) -> Vec<String> {
    let mut options = Options::default();
    // The letters of `curve-plan plot`, so that no computer's own decide.
    let letters = root().join("tools/curve-plan/font/DejaVuSans-Latin.ttf");
    let letters = fs::read(letters).expect("the letters");
    options.fontdb_mut().load_font_data(letters);
    options.font_family = "DejaVu Sans".to_owned();
    let tree = Tree::from_str(svg, &options).expect("a picture");
    let (mut shapes, mut texts) = (Vec::new(), Vec::new());
    parts(tree.root(), &mut shapes, &mut texts);
    assert!(!texts.is_empty(), "no text");
    let crosses = |text: &Rect| {
        shapes.iter().any(|shape: &Rect| {
            let apart = text.right() <= shape.left()
                || shape.right() <= text.left()
                || text.bottom() <= shape.top()
                || shape.bottom() <= text.top();
            let within = shape.left() <= text.left()
                && text.right() <= shape.right()
                && shape.top() <= text.top()
                && text.bottom() <= shape.bottom();
            !apart && !within
        })
    };
    let found = texts.iter().filter(|(_, place)| crosses(place));
    found.map(|(text, _)| text.clone()).collect()
}

/// Where the shapes of a group are, and its texts.
fn parts(group: &Group, shapes: &mut Vec<Rect>, texts: &mut Vec<(String, Rect)>) {
    for node in group.children() {
        match node {
            Node::Group(group) => parts(group, shapes, texts),
            Node::Path(path) => shapes.push(path.abs_bounding_box()),
            Node::Text(text) => {
                let words: Vec<&str> = text.chunks().iter().map(|one| one.text()).collect();
                texts.push((words.concat(), text.abs_bounding_box()));
            }
            Node::Image(_) => {}
        }
    }
}

/// What `cargo xtask` can do, by its own help.
fn tasks() -> Vec<String> {
    let output = Command::new(program("xtask")).output().expect("xtask");
    let printed = String::from_utf8_lossy(&output.stderr).into_owned();
    let words = printed.lines().filter_map(|line| {
        let rest = line.strip_prefix("  ")?;
        rest.split_whitespace().next().map(str::to_owned)
    });
    words.collect()
}

#[test]
fn every_link_and_every_file_that_a_page_names_is_there() {
    let tasks = tasks();
    let mut rust = Vec::new();
    sources(root(), &mut rust);
    for page in pages() {
        let text = fs::read_to_string(&page).expect("a page");
        let folder = page.parent().expect("a folder");
        for link in links(&text) {
            let place = link.split('#').next().unwrap_or_default();
            if place.is_empty() || place.contains("://") {
                continue;
            }
            assert!(
                folder.join(place).exists(),
                "{}: there is no {place}",
                page.display()
            );
        }
        for code in codes(&text) {
            if let Some(rest) = code.strip_prefix("cargo xtask ") {
                let task = rest.split_whitespace().next().unwrap_or_default();
                assert!(
                    tasks.iter().any(|t| t == task),
                    "{}: {code}",
                    page.display()
                );
            }
            if code.ends_with(".rs") && !code.contains(' ') {
                let there = rust.iter().any(|source| source.ends_with(code));
                assert!(there, "{}: there is no file {code}", page.display());
            }
            if let Some((name, filter)) = test_named(code) {
                let files: Vec<&PathBuf> = rust
                    .iter()
                    .filter(|source| is_test_of(source, name))
                    .collect();
                assert!(
                    !files.is_empty(),
                    "{}: there is no test {name}",
                    page.display()
                );
                let found = files.iter().any(|file| {
                    let text = fs::read_to_string(file).expect("a test");
                    file.file_stem().is_some_and(|stem| stem == filter) || text.contains(filter)
                });
                assert!(found, "{}: no test matches: {code}", page.display());
            }
        }
    }
}

/// Who moves a function, a configuration key or a message to another file moves its row of "I want to ..." too.
#[test]
fn the_files_of_a_change_hold_what_its_row_names() {
    let text = fs::read_to_string(root().join("ARCHITECTURE.md")).expect("the page");
    let (_, rows) = text.split_once("\n## I want to ").expect("the tables");
    let (rows, _) = rows.split_once("\n## ").expect("the next section");
    let is_row = |line: &&str| line.starts_with("| ") && !line.starts_with("| change | open");
    let (mut count, mut wrong) = (0, Vec::new());
    for row in rows.lines().filter(is_row) {
        let cells: Vec<&str> = row.trim_matches('|').split(" | ").collect();
        let [change, first, then] = cells[..] else {
            panic!("expected three cells: {row}");
        };
        let mut place = root().to_owned();
        let of_first = text_of_files(first, &mut place);
        let of_then = text_of_files(then, &mut place);
        let of_both = format!("{of_first}{of_then}");
        let numbers = change.split(|c: char| !c.is_ascii_digit());
        let numbers = numbers.filter(|number| number.len() >= 4);
        let symbols = |cell| codes(cell).filter(|code| !is_path(code)).collect();
        let named: [(Vec<&str>, &String); 3] = [
            (codes(change).chain(numbers).collect(), &of_both),
            (symbols(first), &of_first),
            (symbols(then), &of_then),
        ];
        for (names, text) in named {
            let absent = names.into_iter().filter(|name| !holds(text, name));
            wrong.extend(absent.map(|name| format!("{name}: {row}")));
        }
        count += 1;
    }
    assert!(count > 300, "{count} rows");
    assert!(wrong.is_empty(), "not in their files: {wrong:#?}");
}

/// What stands in a text as code.
fn codes(text: &str) -> impl Iterator<Item = &str> {
    text.split('`').skip(1).step_by(2)
}

/// Whether a code of a row is a file or a folder; any other is a name in one.
fn is_path(code: &str) -> bool {
    let endings = ["rs", "py", "js", "html", "css", "toml"];
    let ends = |e: &OsStr| endings.iter().any(|ending| e == *ending);
    let in_folder = code.contains('/') && !code.starts_with('/');
    !code.contains(' ') && (in_folder || Path::new(code).extension().is_some_and(ends))
}

/// The files of a cell, each after its path, since a subcommand is often named by its file alone. A bare name is beside the file
/// before it, which is `place`.
fn text_of_files(cell: &str, place: &mut PathBuf) -> String {
    let mut text = String::new();
    for code in codes(cell).filter(|code| is_path(code)) {
        let beside = place.parent().unwrap_or(place).join(code);
        let mut places = vec![root().join(code), root().join("vsm/src").join(code)];
        places.insert(if code.contains('/') { 2 } else { 0 }, beside);
        let found = places.into_iter().find(|path| path.exists());
        *place = found.unwrap_or_else(|| panic!("there is no {code}: {cell}"));
        let mut files = Vec::new();
        if place.is_dir() {
            sources(place, &mut files);
        } else {
            files.push(place.clone());
        }
        for file in files {
            let path = file.strip_prefix(root()).unwrap_or(&file);
            let content = fs::read_to_string(&file).expect("a file of a row");
            text += &format!("{}\n{content}\n", path.display());
        }
    }
    text
}

/// Whether the last word of a name is in a text, as a word: `--test-cases` as `test_cases` too.
fn holds(text: &str, name: &str) -> bool {
    let is_part = |c: char| c.is_alphanumeric() || c == '_' || c == '-';
    let name = name.split('(').next().unwrap_or_default();
    let mut words = name.rsplit(|c: char| !is_part(c));
    let word = words.find(|word| !word.is_empty()).unwrap_or_default();
    let word = word.trim_matches('-');
    let symbol = word.replace('-', "_");
    let mut parts = text
        .split(|c: char| !is_part(c))
        .map(|part| part.trim_matches('-'));
    let mut numbers = text.split(|c: char| !c.is_ascii_digit());
    !word.is_empty()
        && (parts.any(|part| part == word || part == symbol) || numbers.any(|part| part == word))
}

/// The name after `--test`, and the word behind it that selects tests, or nothing.
fn test_named(code: &str) -> Option<(&str, &str)> {
    let mut words = code.split_whitespace().skip_while(|word| *word != "--test");
    let name = words.nth(1)?;
    let filter = words.next().filter(|word| !word.starts_with('-'));
    Some((name, filter.unwrap_or_default()))
}

/// Whether a source file belongs to the test program of this name.
fn is_test_of(source: &Path, name: &str) -> bool {
    let mut folders = source.ancestors().skip(1);
    source.ends_with(format!("tests/{name}.rs"))
        || folders.any(|folder| folder.ends_with(format!("tests/{name}")))
}

/// The Rust files of the workspace.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if path.is_dir() && name != "target" && !name.starts_with('.') {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

fn links(text: &str) -> Vec<&str> {
    let after = text.split("](").skip(1);
    let found = after.filter_map(|rest| rest.split_once(')').map(|(link, _)| link));
    // Code in a page is no link.
    found
        .filter(|link| !link.contains([' ', '\n', '`']))
        .collect()
}

fn pages() -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md"]
        .iter()
        .map(|page| root().join(page))
        .collect();
    for folder in ["docs/guide", "docs/reference", "docs/reference/dli"] {
        for entry in fs::read_dir(root().join(folder)).expect("the documents") {
            let path = entry.expect("an entry").path();
            if path.extension().is_some_and(|e| e == "md") {
                found.push(path);
            }
        }
    }
    found
}

fn root() -> &'static Path {
    kit::workspace()
}
