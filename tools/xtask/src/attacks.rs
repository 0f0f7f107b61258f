//! `cargo xtask attacks`: the attacks of the tests in one full set, at least as much of each as a hostile review of the whole program
//! once made without anything being delivered.
//!
//! The attacks are tests, of which every test run makes a part (`tests/kit/src/attacks.rs`); here they make all of it, and the table is
//! printed once the last one has passed.

use std::collections::BTreeMap;
use std::fs;

use anyhow::{Context as _, Result, bail};

use crate::steps::{Steps, cargo, root};
use crate::tests;

/// Runs each of them, and prints the table.
pub(crate) fn run(steps: &mut Steps) -> Result<()> {
    tests::build(steps)?;
    let rows = root().join("target/attacks.tsv");
    if rows.exists() {
        fs::remove_file(&rows).with_context(|| rows.display().to_string())?;
    }
    for (program, attacks) in PROGRAMS {
        let test = [
            "test",
            "--workspace",
            "--locked",
            "--test",
            program,
            "--",
            "--nocapture",
        ];
        let mut command = cargo(test);
        command.args(attacks.iter().map(|(_, name)| name));
        steps.run(command.env("VSM_ATTACKS", &rows))?;
    }
    let text = fs::read_to_string(&rows).with_context(|| rows.display().to_string())?;
    eprintln!("\n{}", table(&text)?);
    Ok(())
}

/// The rows as Markdown.
///
/// # Errors
/// A row that cannot be read, or less of something than the review made.
fn table(rows: &str) -> Result<String> {
    let mut made = BTreeMap::<&str, u64>::new();
    let mut table =
        "| attack | made | of the review | held | by |\n|---|---|---|---|---|\n".to_owned();
    for row in rows.lines() {
        let [kind, count, test, held] = row.split('\t').collect::<Vec<_>>()[..] else {
            bail!("a row of VSM_ATTACKS: {row}");
        };
        let count: u64 = count
            .parse()
            .with_context(|| format!("a row of VSM_ATTACKS: {row}"))?;
        *made.entry(kind).or_default() += count;
        let of = review(kind).with_context(|| format!("the review had no {kind}"))?;
        table += &format!(
            "| {kind} | {} | {} | {held} | `{test}` |\n",
            grouped(count),
            grouped(of)
        );
    }
    for (kind, of) in REVIEW {
        let made = made.get(kind).copied().unwrap_or(0);
        if made < of {
            bail!("{kind}: {made} made, expected at least {of}\n{table}");
        }
    }
    Ok(table)
}

fn review(kind: &str) -> Option<u64> {
    REVIEW
        .iter()
        .find(|(name, _)| *name == kind)
        .map(|(_, of)| *of)
}

/// 6700000 as 6,700,000.
fn grouped(number: u64) -> String {
    match number {
        0..1_000 => number.to_string(),
        _ => format!("{},{:03}", grouped(number / 1_000), number % 1_000),
    }
}

/// What the review made, of which nothing was delivered.
const REVIEW: [(&str, u64); 4] = [
    ("forged or replayed frames", 1_696),
    ("bad signatures", 6_700_000),
    ("flood datagrams", 748_000),
    ("random messages", 12_000),
];

/// The test programs, and of each the tests that attack: where they are, and their names.
const PROGRAMS: [(&str, &[(&str, &str)]); 3] = [
    (
        "signed_link",
        &[
            (
                "mavlink-link/tests/signed_link/every_frame.rs",
                "no_frame_with_a_changed_byte_or_two_changed_bits_is_believed",
            ),
            (
                "mavlink-link/tests/signed_link/pitfalls/replays.rs",
                "pitfall_03_the_stream_keeps_the_stamp_of_every_packet",
            ),
            (
                "mavlink-link/tests/signed_link/pitfalls/clocks.rs",
                "pitfall_13_a_forgers_stamp_is_not_kept",
            ),
        ],
    ),
    (
        "flight",
        &[(
            "vsm/tests/flight/guarded.rs",
            "a_flood_of_forged_trailers_holds_up_nobody",
        )],
    ),
    (
        "any_input",
        &[(
            "vsm/tests/any_input/main.rs",
            "every_target_holds_on_its_seeds_and_their_mutations",
        )],
    ),
];

#[cfg(test)]
mod the_full_set {
    use super::*;

    /// `cargo test` passes where a name fits no test.
    #[test]
    fn each_attack_is_a_test() {
        for (file, name) in PROGRAMS.iter().flat_map(|(_, attacks)| *attacks) {
            let text = fs::read_to_string(root().join(file)).expect(file);
            assert!(text.contains(&format!("#[test]\nfn {name}()")), "{name}");
            assert!(text.contains("attacks::report("), "{file}");
        }
    }

    #[test]
    fn the_table_has_what_was_made_and_less_than_the_review_made_is_an_error() {
        let rows: String = REVIEW
            .iter()
            .map(|(kind, of)| format!("{kind}\t{of}\ta_test\tnothing delivered\n"))
            .collect();
        let printed = table(&rows).expect("as much");
        let row = "| bad signatures | 6,700,000 | 6,700,000 | nothing delivered | `a_test` |";
        assert!(printed.contains(row), "{printed}");
        let less = table(&rows.replace("12000", "11999")).expect_err("one too few");
        assert!(
            less.to_string().contains("random messages: 11999"),
            "{less}"
        );
        assert!(table("").is_err());
        assert!(table("nonsense").is_err());
    }
}
