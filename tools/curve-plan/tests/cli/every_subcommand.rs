//! Every subcommand is run, with `--json` too where it has that; the command line itself provides the list.

use serde_json::Value;

use crate::Files;

/// Each with its arguments and exit status. `send` has no VSM to send to here; tests/end-to-end flies what it
/// uploads.
const RUNS: &[(&str, &str, i32)] = &[
    ("compare", "track.csv --tolerance 5", 0),
    ("densify", "route.toml dense.csv", 0),
    ("fit", "track.csv fitted.toml", 0),
    ("check", "route.toml --home 47.3977434,8.5455939,488", 0),
    ("plot", "route.toml route.svg", 0),
    ("convert", "route.toml track.csv", 0),
    ("rally", "site.plan", 0),
    ("send", "route.toml --vsm 127.0.0.1:9", 1),
];

#[test]
fn every_subcommand_is_run() {
    let command = curve_plan::command();
    let names: Vec<_> = command
        .get_subcommands()
        .map(clap::Command::get_name)
        .collect();
    let run: Vec<_> = RUNS.iter().map(|(name, _, _)| *name).collect();
    assert_eq!(names, run, "a subcommand without a line in RUNS");
    let files = Files::new();
    // The track that others read.
    files.done(&["convert", "route.toml", "track.csv"]);
    files.put("site.plan", include_str!("../data/qgroundcontrol.plan"));
    for (sub, (name, words, status)) in command.get_subcommands().zip(RUNS) {
        let json = sub
            .get_arguments()
            .any(|one| one.get_long() == Some("json"));
        for json in [false, true].into_iter().filter(|with| json || !with) {
            let words = words.split(' ').chain(json.then_some("--json"));
            let arguments: Vec<&str> = [*name].into_iter().chain(words).collect();
            let output = files.run(&arguments);
            let printed = String::from_utf8_lossy(&output.stdout).into_owned();
            let error = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(
                output.status.code(),
                Some(*status),
                "{arguments:?}: {printed}{error}"
            );
            assert!(!error.contains("panicked"), "{arguments:?}: {error}");
            if json && *status == 0 {
                assert!(
                    serde_json::from_str::<Value>(&printed).is_ok(),
                    "{arguments:?}: {printed}"
                );
            }
        }
    }
}
