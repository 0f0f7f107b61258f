//! Mistakes that people make in a configuration: each is answered with the line, the key, its value, what was expected, and
//! an example of it.

use std::path::Path;
use std::process::Command;

use kit::process::program;
use vsm::config::Config;

/// What `vsm init` writes.
const GOOD: &str = include_str!("../../../examples/vsm.toml");

/// What is replaced, by what, and what the answer holds.
type Mistake = (&'static str, &'static str, &'static [&'static str]);

const MISTAKES: &[Mistake] = &[
    // Tables.
    (
        "[[vehicle]]",
        "[vehicle]",
        &[
            "line 13",
            "vehicle is one table [vehicle]",
            "write [[vehicle]]",
        ],
    ),
    ("[[cucs]]", "[cucs]", &["line 8", "write [[cucs]]"]),
    (
        "[dli]",
        "[[dli]]",
        &["line 4", "dli is a list [[dli]]", "write [dli]"],
    ),
    ("[store]", "[[store]]", &["line 21", "write [store]"]),
    (
        "[store]",
        "[stores]",
        &["line 21", "stores is not known", "`store`"],
    ),
    ("[store]", "[store", &["line 21", "unclosed table"]),
    ("[dli] ", "[DLI] ", &["line 4", "DLI is not known", "`dli`"]),
    (
        "[store]",
        "[[vehicle]]\n[store]",
        &["line 21", "vehicle.id is missing", "id = \"1b:00:01:01\""],
    ),
    // An encrypted link has its keys from an agent, and only that agent on it.
    (
        "[store]",
        "encrypt = true\n[store]",
        &[
            "vehicle.encrypt is true",
            "vehicle.signing with exchange = \"on\" beside it",
        ],
    ),
    // Addresses.
    (
        "\"127.0.0.1:4586\"",
        "\"localhost:4586\"",
        &[
            "line 6",
            "dli.listen is \"localhost:4586\"",
            "an IP address, which is no name, and a port of 1 to 65535",
        ],
    ),
    (
        "\"127.0.0.1:4586\"",
        "\"127.0.0.1:99999\"",
        &["line 6", "a port of 1 to 65535"],
    ),
    // What is not quoted, or quoted for nothing.
    (
        "\"127.0.0.1:4586\"",
        "127.0.0.1:4586",
        &[
            "line 6",
            "dli.listen is 127.0.0.1:4586",
            "\"127.0.0.1:4586\"",
            "UDP address for CUCSs",
        ],
    ),
    (
        "\"1b:00:00:a0\"",
        "1b:00:00:a0",
        &[
            "line 9",
            "cucs.id is 1b:00:00:a0",
            "in quotes",
            "such as: id = \"1b:00:00:a0\"",
        ],
    ),
    (
        "\"udpin:127.0.0.1:14550\"",
        "udpin:127.0.0.1:14550",
        &[
            "line 15",
            "vehicle.link is udpin:127.0.0.1:14550",
            "in quotes",
        ],
    ),
    (
        "\"state\"",
        "state",
        &[
            "line 22",
            "store.dir is state",
            "in quotes",
            "dir = \"state\"",
        ],
    ),
    (
        "key_file = \"uav1.key\"",
        "key_file = uav1.key",
        &[
            "line 18",
            "vehicle.signing.key_file is uav1.key",
            "in quotes",
        ],
    ),
    (
        "system_id = 1 ",
        "system_id = \"1\" ",
        &[
            "line 16",
            "vehicle.system_id is \"1\"",
            "a whole number",
            "system_id = 1",
        ],
    ),
    (
        "[2, 3, 4, 5]",
        "\"2,3,4,5\"",
        &[
            "line 10",
            "cucs.loi is \"2,3,4,5\"",
            "a list in brackets",
            "loi = [2, 3, 4, 5]",
        ],
    ),
    // Kinds of values.
    (
        "[2, 3, 4, 5]",
        "5",
        &["line 10", "cucs.loi is 5", "a list in brackets"],
    ),
    (
        "[2, 3, 4, 5]",
        "[\"2\"]",
        &["line 10", "cucs.loi is ", "a whole number"],
    ),
    (
        "system_id = 1 ",
        "system_id = 1.0 ",
        &["line 16", "vehicle.system_id is 1.0", "a whole number"],
    ),
    (
        "\"1b:00:00:a0\"",
        "0x1b0000a0",
        &["line 9", "cucs.id is 0x1b0000a0", "a text in quotes"],
    ),
    (
        "\"PX4-1\"",
        "1",
        &[
            "line 17",
            "vehicle.tail_number is 1",
            "a text in quotes",
            "such as: tail_number",
        ],
    ),
    (
        "\"127.0.0.1:4586\"",
        "4586",
        &[
            "line 6",
            "dli.listen is 4586",
            "an address and a port in quotes",
        ],
    ),
    (
        "{ tolerance_m = 1.0 }",
        "1.0",
        &["line 19", "vehicle.curve is 1.0", "a table"],
    ),
    (
        "tolerance_m = 1.0",
        "tolerance_m = \"1 m\"",
        &[
            "line 19",
            "vehicle.curve.tolerance_m is \"1 m\"",
            "a number",
            "0.1 to 100 m",
            "tolerance_m = 1.0",
        ],
    ),
    (
        "{ key_file = \"uav1.key\" }",
        "\"uav1.key\"",
        &[
            "line 18",
            "vehicle.signing is \"uav1.key\"",
            "signing = { key_file = \"uav1.key\" }",
        ],
    ),
    (
        "{ key_file = \"uav1.key\" }",
        "true",
        &["line 18", "vehicle.signing is true", "or \"off\""],
    ),
    (
        "\"state\"",
        "true",
        &["line 22", "store.dir is true", "file or folder in quotes"],
    ),
    // Words of which one is chosen, as something else.
    (
        "\"127.0.0.1:4586\"",
        "\"127.0.0.1:4586\"\nprovisional = 4",
        &[
            "line 7",
            "dli.provisional is 4",
            "a text in quotes, one of `off`, `status`, `all`",
            "such as: provisional = \"status\"",
        ],
    ),
    (
        "key_file = \"uav1.key\"",
        "key_file = \"uav1.key\", exchange = true",
        &[
            "line 18",
            "vehicle.signing.exchange is true",
            "one of `off`, `on`, `legacy`",
        ],
    ),
    (
        "tolerance_m = 1.0",
        "policy = [\"slow\"]",
        &[
            "line 19",
            "vehicle.curve.policy is [\"slow\"]",
            "a text in quotes, `slow` or `refuse`",
        ],
    ),
    (
        "tolerance_m = 1.0",
        "policy = \"fast\"",
        &["line 19", "vehicle.curve.policy is \"fast\"", "`refuse`"],
    ),
    // Values out of range.
    (
        "system_id = 1 ",
        "system_id = 300 ",
        &[
            "line 16",
            "vehicle.system_id is 300",
            "MAVLink system id of the vehicle, 1 to 255",
            "such as: system_id = 1",
        ],
    ),
    (
        "system_id = 1 ",
        "system_id = 0 ",
        &["line 16", "vehicle.system_id is 0", "1 to 255"],
    ),
    (
        "\"127.0.0.1:4586\"",
        "\"localhost:4586\"",
        &[
            "line 6",
            "dli.listen is \"localhost:4586\"",
            "listen = \"127.0.0.1:4586\"",
        ],
    ),
    (
        "\"127.0.0.1:4586\"",
        "\"127.0.0.1\"",
        &[
            "line 6",
            "dli.listen is \"127.0.0.1\"",
            "listen = \"127.0.0.1:4586\"",
        ],
    ),
    (
        "udpin:127.0.0.1:14550",
        "tcp:127.0.0.1:5760",
        &["line 15", "vehicle.link is", "udpin:ADDRESS:PORT"],
    ),
    (
        "udpin:127.0.0.1:14550",
        "/dev/ttyUSB0",
        &["line 15", "vehicle.link is", "serial:DEVICE:BAUD"],
    ),
    (
        "\"1b:00:01:01\"",
        "\"1b:00:00:a0\"",
        &[
            "line 14",
            "vehicle.id is 1b:00:00:a0",
            "nothing else in this file has",
        ],
    ),
    (
        "tolerance_m = 1.0",
        "tolerance_m = 1000.0",
        &["line 19", "vehicle.curve.tolerance_m is 1000", "0.1 to 100"],
    ),
    (
        "# [http]",
        "[record]\ndir = \"r\"\nmax_mb = 1\n# [http]",
        &["line 26", "record.max_mb is 1", "8 or more"],
    ),
    (
        "# [http]",
        "[http]\nlisten = \"8586\"\n# [http]",
        &[
            "line 25",
            "http.listen is \"8586\"",
            "listen = \"127.0.0.1:8586\"",
        ],
    ),
    // Names.
    (
        "vsm_id",
        "vsm-id",
        &["line 5", "dli.vsm-id is not known", "`vsm_id`"],
    ),
    (
        "dir = ",
        "path = ",
        &["line 22", "store.path is not known", "`dir`"],
    ),
    (
        "[store] ",
        "[store]\nsystem_id = 1 # ",
        &[
            "line 22",
            "store.system_id is not known here",
            "belongs in [vehicle]",
        ],
    ),
    (
        "link = ",
        "# link = ",
        &[
            "line 13",
            "vehicle.link is missing",
            "such as: link = \"udpin:127.0.0.1:14550\"",
        ],
    ),
    (
        "dir = ",
        "# dir = ",
        &["store.dir is missing", "such as: dir = \"state\""],
    ),
    (
        "[store] ",
        "# [store] ",
        &["dir is not known here; dir belongs in [store]"],
    ),
];

fn refusal(text: &str) -> String {
    let fault = Config::parse(text, Path::new("")).expect_err(text);
    fault.to_string()
}

#[test]
fn each_mistake_is_answered_with_place_value_expectation_and_example() {
    assert!(MISTAKES.len() >= 30);
    let mut wrong = Vec::new();
    for (from, to, expected) in MISTAKES {
        let text = GOOD.replacen(from, to, 1);
        assert_ne!(text, GOOD, "{from} is not in the file");
        let answer = refusal(&text);
        for part in *expected {
            if !answer.contains(part) {
                wrong.push(format!("{to:?} without {part:?}:\n  {answer}"));
            }
        }
        for rust in ["u8", "f64", "struct ", "sequence", "invalid type", "wanted"] {
            if answer.contains(rust) {
                wrong.push(format!("{to:?} with {rust:?}:\n  {answer}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    let empty = refusal("");
    assert!(
        empty.contains("dli is missing") && empty.contains("[dli] vsm_id ="),
        "{empty}"
    );
}

#[test]
fn a_file_of_another_kind_is_named_with_the_command_that_takes_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let key = "5a".repeat(32);
    let examples = kit::workspace().join("examples");
    let example = |name: &str| std::fs::read_to_string(examples.join(name)).expect(name);
    for (text, kind, command) in [
        (example("square.route.toml"), "a route", "`cucs send`"),
        (example("area.fence.toml"), "a geofence", "`cucs fence`"),
        (example("square.cucs"), "a script", "`cucs script`"),
        (example("airside.toml"), "an agent", "`vsm airside`"),
        (key.clone(), "a signing key", "key_file"),
    ] {
        let file = folder.path().join("given");
        std::fs::write(&file, text).expect("the file");
        for subcommand in ["run", "status"] {
            let mut vsm = Command::new(program("vsm"));
            let output = vsm.arg(subcommand).arg(&file).output().expect("vsm");
            let printed = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(2), "{printed}");
            assert!(
                printed.contains(kind) && printed.contains(command),
                "{printed}"
            );
            // Not even of a key that was given by mistake.
            assert!(!printed.contains("5a5a"), "{printed}");
        }
    }
    let bridge = examples.join("vsm.toml");
    let mut vsm = Command::new(program("vsm"));
    let output = vsm.arg("airside").arg(&bridge).output().expect("vsm");
    let printed = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{printed}");
    assert!(printed.contains("`vsm run`"), "{printed}");
}

#[test]
fn a_key_written_into_the_configuration_is_not_repeated() {
    let key = "5a".repeat(32);
    for value in [
        format!("\"{key}\""),
        format!("{{ key = \"{key}\" }}"),
        key.clone(),
    ] {
        let answer = refusal(&GOOD.replace("{ key_file = \"uav1.key\" }", &value));
        assert!(!answer.contains("5a5a"), "{answer}");
        assert!(answer.contains("signing"), "{answer}");
    }
}

#[test]
fn what_is_no_text_file_is_answered_with_what_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::create_dir(path("folder")).unwrap();
    std::fs::write(path("binary.toml"), [b'a', 0xff, 0xfe]).unwrap();
    std::fs::write(path("huge.toml"), vec![b'#'; 1_000_001]).unwrap();
    for (name, parts) in [
        (
            "missing.toml",
            ["No such file", "`vsm init` writes one to begin with"],
        ),
        (
            "folder",
            ["Is a directory", "it is a folder, expected a file"],
        ),
        (
            "binary.toml",
            ["byte 1 is no text in UTF-8", "is it the right file?"],
        ),
        ("huge.toml", ["over 1000 kB", "is it the right file?"]),
    ] {
        let fault = Config::load(&path(name)).expect_err(name).to_string();
        for part in parts {
            assert!(fault.contains(part), "{name}: {part}: {fault}");
        }
        let new = fault.contains("vsm init");
        assert_eq!(new, name == "missing.toml", "{fault}");
    }
    // A device that never ends is none either, nor a pipe that nobody writes to; both are answered at once.
    let made = Command::new("mkfifo").arg(path("pipe.toml")).status();
    assert!(made.is_ok_and(|status| status.success()));
    for other in ["/dev/zero".into(), path("pipe.toml")] {
        let fault = Config::load(&other).expect_err("it is none").to_string();
        assert!(fault.contains("expected a file"), "{fault}");
    }
}

#[test]
fn elevation_files_are_checked_before_anything_is_served() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    let read = |text: &str| {
        let text = text.replace("system_id = 1", "system_id = 1\nterrain = \"tiles\"");
        let mut config = Config::parse(&text, folder.path()).expect("good");
        let read = config.read_terrain(None).map_err(|fault| fault.to_string());
        read.map(|()| config)
    };
    let fault = read(GOOD).expect_err("there is no folder");
    assert!(
        fault.contains("vehicle.terrain: ") && fault.contains("expected a folder"),
        "{fault}"
    );
    std::fs::create_dir(&tiles).unwrap();
    let fault = read(GOOD).expect_err("it is empty");
    assert!(
        fault.contains("no .hgt, .tif or .asc in it, expected"),
        "{fault}"
    );
    std::fs::write(tiles.join("N47E008.hgt"), [0; 7]).unwrap();
    let fault = read(GOOD).expect_err("it is cut short");
    assert!(fault.contains("N47E008.hgt: 7 bytes, expected "), "{fault}");
    std::fs::write(tiles.join("N47E008.hgt"), vec![0; 1_201 * 1_201 * 2]).unwrap();
    let config = read(GOOD).expect("a good tile");
    let ground = config
        .vehicles()
        .next()
        .and_then(|one| one.terrain.as_ref());
    assert_eq!(
        ground.map(|one| one.ground().height_m(47.5, 8.5)),
        Some(Some(0.0))
    );
    // What is not read is no ground that is known, and not a flat one.
    let text = GOOD.replace("system_id = 1", "system_id = 1\nterrain = \"tiles\"");
    let config = Config::parse(&text, folder.path()).expect("good");
    let ground = config
        .vehicles()
        .next()
        .and_then(|one| one.terrain.as_ref());
    assert_eq!(
        ground.map(|one| one.ground().height_m(47.5, 8.5)),
        Some(None)
    );
    let high = text.replace("terrain =", "limits.above_terrain_m = 2000\nterrain =");
    assert!(refusal(&high).contains("expected -500 to 1000 (metres)"));
}
