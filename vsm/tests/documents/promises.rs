//! docs/reference/promises.md and the pages of the guide that promise something name the test that shows each promise. The tests of those names exist.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// Where the tests of promises about keys and links are.
const PLACES: [&str; 10] = [
    "mapping/src",
    "mavlink-link/src",
    "mavlink-link/tests",
    "route-files/src",
    "stanag-msgs/tests",
    "vsm/src",
    "vsm/tests",
    "tools/px4-sim/src",
    "tools/px4-sim/tests",
    "tests/end-to-end/tests",
];

/// The functions below a folder that bear a test's attribute.
fn tests_in(folder: &Path, found: &mut BTreeSet<String>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            tests_in(&path, found);
        } else if path.extension().is_some_and(|kind| kind == "rs") {
            let mut marked = false;
            for line in fs::read_to_string(&path).unwrap().lines().map(str::trim) {
                marked |= line.starts_with("#[test]") || line.starts_with("#[tokio::test");
                let name = line
                    .strip_prefix("fn ")
                    .or(line.strip_prefix("async fn "))
                    .and_then(|rest| rest.split('(').next());
                if let Some(name) = name {
                    if marked {
                        found.insert(name.to_owned());
                    }
                    marked = false;
                }
            }
        }
    }
}

/// The last cells of the tables "promise | shown by".
fn shown_by(page: &str) -> Vec<&str> {
    let mut rows = vec![];
    let mut within = false;
    for line in page.lines() {
        let Some(cells) = line.strip_prefix('|') else {
            within = false;
            continue;
        };
        let cells: Vec<&str> = cells.trim_end_matches('|').split('|').collect();
        let last = cells.last().map_or("", |cell| cell.trim());
        match last {
            "shown by" => within = true,
            "---" => {}
            _ if within => rows.push(last),
            _ => {}
        }
    }
    rows
}

#[test]
fn each_promise_names_tests_that_exist() {
    let root = kit::workspace();
    let mut tests = BTreeSet::new();
    for place in PLACES {
        tests_in(&root.join(place), &mut tests);
    }
    for page in [
        "docs/reference/promises.md",
        "docs/guide/autonomy.md",
        "docs/guide/keys.md",
        "docs/guide/security-design.md",
        "docs/guide/termination.md",
        "docs/guide/zeroize.md",
    ] {
        let text = fs::read_to_string(root.join(page)).unwrap();
        let rows = shown_by(&text);
        assert!(rows.len() >= 9, "{page}: {} promises", rows.len());
        for row in rows {
            // What stands between back quotes is every second part.
            let names: Vec<&str> = row.split('`').skip(1).step_by(2).collect();
            assert!(!names.is_empty(), "{page}: no test is named in: {row}");
            for name in names {
                let exists = match name.strip_suffix("..") {
                    Some(start) => tests.iter().any(|test| test.starts_with(start)),
                    None => tests.contains(name),
                };
                assert!(exists, "{page}: there is no test {name}");
            }
        }
    }
}
