//! The manual page and the shell completions of each program, made from its command line; the pages also have examples, which
//! the command line must take, the exit statuses and the files.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};
use clap::Command;
use clap_complete::Shell;

/// Writes them into `tree`, as into the root of a file system: of these programs, or of all where none is named.
pub(crate) fn write(tree: &Path, programs: &[&str]) -> Result<()> {
    for program in programs {
        let known = commands().iter().any(|one| one.get_name() == *program);
        ensure!(known, "there is no program {program}");
    }
    let is_asked =
        |command: &Command| programs.is_empty() || programs.contains(&command.get_name());
    for command in commands().into_iter().filter(is_asked) {
        let name = command.get_name().to_owned();
        let pages = folder(tree, "usr/share/man/man1")?;
        clap_mangen::generate_to(command.clone(), &pages)
            .with_context(|| format!("the manual page of {name}"))?;
        let more = more(&name).with_context(|| format!("{name} is not in PROGRAMS"))?;
        for page in page_names(&command) {
            let path = pages.join(format!("{page}.1"));
            let text = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
            let text = text + &sections(&page, more);
            fs::write(&path, text).with_context(|| path.display().to_string())?;
        }
        for (shell, place) in SHELLS {
            let into = folder(tree, place)?;
            let path = clap_complete::generate_to(shell, &mut command.clone(), &name, &into)
                .with_context(|| format!("completions of {name}"))?;
            if shell == Shell::Bash {
                // Bash loads them by the program's own name.
                fs::rename(&path, into.join(&name)).with_context(|| path.display().to_string())?;
            }
        }
    }
    Ok(())
}

fn commands() -> [Command; 6] {
    [
        // The packaged program is built without its demo.
        vsm::program::command().mut_subcommand("demo", |demo| demo.hide(true)),
        cucs::program::command(),
        px4_sim::program::command(),
        curve_plan::command(),
        conformance::command(),
        mavlink_check::command(),
    ]
}

/// What the pages of a program have in common.
struct More {
    program: &'static str,
    /// From 0 on.
    statuses: &'static [&'static str],
    files: &'static [(&'static str, &'static str)],
}

const PROGRAMS: &[More] = &[
    More {
        program: "vsm",
        statuses: &[
            "Done",
            "Failed",
            "Wrong arguments or configuration; nothing was done",
            "Zeroized: what it would serve is erased",
        ],
        files: &[
            (
                "vsm.toml",
                "Configuration of the bridge where none is named; of the packaged service /etc/vsm/vsm.toml",
            ),
            (
                "airside.toml",
                "Configuration of the agent beside PX4 where none is named",
            ),
            (
                "key_file of [[vehicle]]",
                "Signing key: 32 bytes in hex, mode 0600; beside it .next and .previous while it is replaced",
            ),
            (
                "dir of [store]",
                "What survives a restart: signing clocks, plans, authority, audit logs; mode 0700",
            ),
        ],
    },
    More {
        program: "cucs",
        statuses: &[
            "Done",
            "Refused, with the reason, or not answered",
            "Wrong arguments, or a faulty file; nothing was sent",
        ],
        files: &[
            ("*.route.toml", "Routes for send; download writes them"),
            ("*.fence.toml", "Areas of a geofence for fence"),
            ("*.cucs", "Scripts: subcommands, one a line, # for remarks"),
        ],
    },
    More {
        program: "px4-sim",
        statuses: &[
            "Ended by SIGTERM or SIGINT",
            "Failed, as where its port is in use",
            "Wrong arguments, or a faulty key file",
        ],
        files: &[
            ("--key-file FILE", "Signing key: 32 bytes in hex, mode 0600"),
            (
                "--signing-file FILE",
                "PX4's own key file, mavlink/mavlink-signing-key.bin: 32 bytes of key, 8 of a stamp",
            ),
        ],
    },
    More {
        program: "curve-plan",
        statuses: &[
            "Done",
            "The answer is no: the route cannot be flown, or not within the bounds",
            "Wrong arguments, or a faulty file",
        ],
        files: &[(
            "*.toml, *.plan, *.waypoints, *.kml, *.gpx, *.geojson, *.csv",
            "Routes and tracks, by their endings; *.hex and *.pcapng are messages, which are only written",
        )],
    },
    More {
        program: "dli-check",
        statuses: JUDGED,
        files: &[
            (
                "--profile FILE",
                "What the subject claims, in TOML; dli-check init writes it",
            ),
            EXPECTED,
            REPORT,
        ],
    },
    More {
        program: "mavlink-check",
        statuses: JUDGED,
        files: &[
            (
                "--key-file FILE",
                "Signing key of the subject: 64 hexadecimal digits, or 32 bytes",
            ),
            EXPECTED,
            REPORT,
        ],
    },
];

/// Of the programs that judge others.
const JUDGED: &[&str] = &[
    "As expected",
    "A fail that is not expected",
    "Wrong arguments, or a faulty file",
    "Nothing could be judged",
];
const EXPECTED: (&str, &str) = (
    "--expected FILE",
    "Departures that are expected, each with its reason, in TOML; --write-expected writes it",
);
const REPORT: (&str, &str) = (
    "--out DIR",
    "Folder of the report: report.json, report.html, junit.xml, run.pcapng, statement.md",
);

fn more(program: &str) -> Option<&'static More> {
    PROGRAMS.iter().find(|more| more.program == program)
}

/// The names of the pages that are written for a program: `vsm`, `vsm-key`, `vsm-key-list`.
fn page_names(command: &Command) -> Vec<String> {
    fn collect(name: String, command: &Command, names: &mut Vec<String>) {
        for sub in command.get_subcommands().filter(|sub| !sub.is_hide_set()) {
            collect(format!("{name}-{}", sub.get_name()), sub, names);
        }
        names.push(name);
    }
    let mut names = Vec::new();
    collect(command.get_name().to_owned(), command, &mut names);
    names
}

/// `EXAMPLES`, `EXIT STATUS` and `FILES` in roff.
fn sections(page: &str, more: &More) -> String {
    let plain = |text: &str| text.replace('\\', "\\e").replace('-', "\\-");
    let mut text = String::new();
    let examples: Vec<&str> = examples(page).collect();
    if !examples.is_empty() {
        text += ".SH EXAMPLES\n.EX\n";
        for example in examples {
            text += &format!("{}\n", plain(example));
        }
        text += ".EE\n";
    }
    text += ".SH \"EXIT STATUS\"\n";
    for (status, meaning) in more.statuses.iter().enumerate() {
        text += &format!(".TP\n{status}\n{}.\n", plain(meaning));
    }
    text += ".SH FILES\n";
    for (file, meaning) in more.files {
        text += &format!(".TP\n{}\n{}.\n", plain(file), plain(meaning));
    }
    text
}

/// The command lines that begin with the words of a page; that of a group has those of its subcommands.
fn examples(page: &str) -> impl Iterator<Item = &'static str> {
    let words = page.to_owned() + "-";
    EXAMPLES.iter().copied().filter(move |example| {
        let example = example.replace(' ', "-") + "-";
        example.starts_with(&words)
    })
}

fn folder(tree: &Path, place: &str) -> Result<PathBuf> {
    let folder = tree.join(place);
    fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    Ok(folder)
}

/// Command lines that the programs take: a test parses each.
const EXAMPLES: &[&str] = &[
    "vsm init --sitl",
    "vsm run",
    "vsm run /etc/vsm/vsm.toml",
    "vsm check-config vsm.toml",
    "vsm demo --curve",
    "vsm demo --payload",
    "vsm demo --vtol",
    "vsm status",
    "vsm status --json",
    "vsm reload",
    "vsm fleet list",
    "vsm fleet drain --node alpha",
    "vsm fleet resume --node alpha",
    "vsm fleet move",
    "vsm replay records",
    "vsm doctor",
    "vsm files ls @MAV_LOG",
    "vsm files get @MAV_LOG/2026-11-23/09_15_02.ulg",
    "vsm files put motors.txt /fs/microsd/etc/",
    "vsm files rm /fs/microsd/old.txt",
    "vsm files mkdir /fs/microsd/etc",
    "vsm klv --udp 239.45.86.2:5004",
    "vsm klv --udp 239.45.86.2:5004 --video camera.h264 --fps 25",
    "vsm check-vehicle",
    "vsm airside airside.toml",
    "vsm airside pair --config airside.toml",
    "vsm airside status",
    "vsm keygen uav1.key",
    "vsm key list",
    "vsm key provision --sitl-file mavlink/mavlink-signing-key.bin",
    "vsm key rotate --vehicle 1b:00:01:01",
    "vsm key revoke --vehicle 1b:00:01:01",
    "vsm key clock",
    "vsm guard pair --cucs 1b:00:00:a0",
    "vsm guard pair --cucs 1b:00:00:a0 --vsm-id 1b:00:00:01 --vsm 192.0.2.1:4586",
    "vsm guard rotate --cucs 1b:00:00:a0",
    "vsm guard keygen a0.key",
    "vsm guard run --cucs 1b:00:00:a0 --vsm-id 1b:00:00:01 --vsm 192.0.2.1:4586 --key-file a0.key",
    "vsm guard rotate a0.key",
    "vsm guard revoke a0.key",
    "vsm guard status",
    "vsm access grant access.list --vsm-id 1b:00:00:01 --cucs 1b:00:00:a0 --vehicle 1b:00:01:01 --groups plan,fly,launch --guard-key 3fa9c1d2e4b56789 --until 2027-01-31T00:00:00Z",
    "vsm access revoke access.list --cucs 1b:00:00:a0 --groups launch",
    "vsm access sign access.list --key-file access.key",
    "vsm access list access.list --key-file access.key",
    "vsm audit verify",
    "vsm audit export --format csv",
    "vsm zeroize --config vsm.toml",
    "vsm pair --code -",
    "vsm decode",
    "vsm encode --raw",
    "cucs discover",
    "cucs take --loi 2,4,5",
    "cucs release",
    "cucs ask --loi 4,5",
    "cucs consent 1b:00:00:b0",
    "cucs refuse 1b:00:00:b0",
    "cucs successor 1b:00:00:b0",
    "cucs accept",
    "cucs decline",
    "cucs send square.route.toml",
    "cucs clear",
    "cucs cancel",
    "cucs download -o plan.route.toml",
    "cucs mode loiter --altitude 40",
    "cucs launch 30",
    "cucs fly --from 10",
    "cucs loiter --position 47.3990,8.5472 --altitude 40",
    "cucs speed 8",
    "cucs land",
    "cucs terminate arm",
    "cucs terminate execute",
    "cucs terminate cancel",
    "cucs payload point 30 -45",
    "cucs payload rate 5 0",
    "cucs payload at 47.3990,8.5472",
    "cucs payload stow",
    "cucs payload cage",
    "cucs payload zoom 20",
    "cucs payload focus closer",
    "cucs payload photo",
    "cucs payload record on",
    "cucs payload image ir",
    "cucs payload state",
    "cucs payload streams",
    "cucs zeroize arm",
    "cucs zeroize execute",
    "cucs zeroize cancel",
    "cucs wait landed",
    "cucs wait mode loiter --within 60",
    "cucs wait waypoint 20",
    "cucs wait route-end --within 180",
    "cucs wait airborne",
    "cucs wait above 540",
    "cucs wait below 520",
    "cucs wait alert geofence",
    "cucs wait asked",
    "cucs wait offered",
    "cucs wait holds 4,5",
    "cucs wait lacks 4,5",
    "cucs watch --seconds 60",
    "cucs sleep 5",
    "cucs heartbeats on",
    "cucs vehicle 1b:00:01:01",
    "cucs traffic",
    "cucs config --loi 4",
    "cucs parameters NAV_DLL_ACT",
    "cucs set NAV_DLL_ACT 2",
    "cucs controls MPC_XY_CRUISE 6",
    "cucs software",
    "cucs ping --vehicle 1b:00:01:01",
    "cucs fence area.fence.toml",
    "cucs hold 1 --until battery=25 contingency-a",
    "cucs held",
    "cucs contingency battery return --percent 30",
    "cucs cancel --held 1",
    "cucs script square.cucs",
    "cucs shell",
    "px4-sim --link udpout:127.0.0.1:14550 --key-file uav1.key",
    "curve-plan compare track.csv --tolerance 2",
    "curve-plan densify everland.route.toml dense.csv --tolerance 1",
    "curve-plan fit track.csv fitted.route.toml --height 30 --g1",
    "curve-plan check everland.route.toml --speed 8",
    "curve-plan plot everland.route.toml everland.svg",
    "curve-plan rally field.plan",
    "curve-plan convert survey.plan survey.route.toml",
    "curve-plan send everland.route.toml --vsm 127.0.0.1:4586",
    "dli-check init 192.0.2.7:4586 --cucs 1b:00:00:a0 --cucs 1b:00:00:a1 --to acme.toml",
    "dli-check vsm --profile acme.toml --out report",
    "dli-check vsm 192.0.2.7:4586 --edition 2.5 --simulated",
    "dli-check capture run.pcapng",
    "dli-check cucs --listen 127.0.0.1:4586 --page 127.0.0.1:8080 --out report",
    "dli-check repeat AUTH-002 192.0.2.7:4586 --times 20",
    "dli-check compare before.json after.json",
    "dli-check schema",
    "dli-check list --edition 2.5",
    "dli-check explain AUTH-002",
    "mavlink-check autopilot udpin:127.0.0.1:14550 --key-file uav1.key --simulated --out report",
    "mavlink-check station --listen udpout:127.0.0.1:14550 --key-file uav1.key",
    "mavlink-check router --vehicle udpout:127.0.0.1:14560 --station udpout:127.0.0.1:14550",
    "mavlink-check repeat SIGN-003 udpin:127.0.0.1:14550 --simulated",
    "mavlink-check list",
    "mavlink-check explain SIGN-003",
];

const SHELLS: [(Shell, &str); 3] = [
    (Shell::Bash, "usr/share/bash-completion/completions"),
    (Shell::Zsh, "usr/share/zsh/vendor-completions"),
    (Shell::Fish, "usr/share/fish/vendor_completions.d"),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_page_has_an_example_and_every_example_is_taken() {
        for command in commands() {
            let name = command.get_name().to_owned();
            assert!(more(&name).is_some(), "{name}");
            for page in page_names(&command) {
                assert!(
                    examples(&page).next().is_some(),
                    "{page}: add one to EXAMPLES"
                );
            }
            for example in examples(&name) {
                let taken = command.clone().try_get_matches_from(example.split(' '));
                assert!(taken.is_ok(), "{example}: {}", taken.unwrap_err());
            }
        }
    }

    #[test]
    fn a_package_has_the_pages_of_its_own_programs_alone() {
        let tree = std::env::temp_dir().join(format!("man-of-{}", std::process::id()));
        assert!(write(&tree, &["nobody"]).is_err());
        write(&tree, &["dli-check", "mavlink-check"]).unwrap();
        let mut names = Vec::new();
        for folder in ["usr/share/man/man1", "usr/share/zsh/vendor-completions"] {
            let entries = fs::read_dir(tree.join(folder)).unwrap();
            names.extend(entries.map(|one| one.unwrap().file_name().into_string().unwrap()));
        }
        fs::remove_dir_all(&tree).unwrap();
        for name in ["dli-check-vsm.1", "mavlink-check.1", "_dli-check"] {
            assert!(names.iter().any(|one| one == name), "{name}: {names:?}");
        }
        let foreign = |name: &&String| !name.contains("-check");
        assert_eq!(names.iter().find(foreign), None);
    }

    #[test]
    fn a_page_has_examples_exit_statuses_and_files() {
        let tree = std::env::temp_dir().join(format!("man-{}", std::process::id()));
        write(&tree, &[]).unwrap();
        let pages = tree.join("usr/share/man/man1");
        let page = |name: &str| fs::read_to_string(pages.join(name)).unwrap();
        let mut count = 0;
        for command in commands() {
            let more = more(command.get_name()).unwrap();
            for name in page_names(&command) {
                let text = page(&format!("{name}.1"));
                let part = |title: &str| {
                    let after = text.split(&format!(".SH {title}\n")).nth(1);
                    let after = after.unwrap_or_else(|| panic!("{name} has no {title}"));
                    after.split("\n.SH ").next().unwrap().to_owned()
                };
                let example = name.replace('-', "\\-");
                let words = part("EXAMPLES").replace(' ', "\\-");
                assert!(words.contains(&example), "{name}: {words}");
                let statuses = part("\"EXIT STATUS\"");
                assert_eq!(
                    statuses.matches(".TP").count(),
                    more.statuses.len(),
                    "{name}"
                );
                assert_eq!(
                    part("FILES").matches(".TP").count(),
                    more.files.len(),
                    "{name}"
                );
                count += 1;
            }
        }
        assert_eq!(fs::read_dir(&pages).unwrap().count(), count);
        let (run, landed) = (page("vsm-run.1"), page("cucs-wait-landed.1"));
        fs::remove_dir_all(&tree).unwrap();
        for part in [
            "vsm run /etc/vsm/vsm.toml",
            "airside.toml",
            ".TP\n3\nZeroized: what it would serve is erased.\n",
        ] {
            assert!(run.contains(part), "{part}: {run}");
        }
        assert!(landed.contains("cucs wait landed"), "{landed}");
        assert!(!landed.contains("cucs wait mode"), "{landed}");
    }
}
