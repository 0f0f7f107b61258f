//! `vsm demo --attack` shows what it promises: the vehicle that is protected holds its altitude, the other one comes down.

use kit::process::run_in;

/// The number before a word, after a heading.
fn number(text: &str, heading: &str, before: &str) -> f64 {
    let part = text
        .split(heading)
        .nth(1)
        .unwrap_or_else(|| panic!("{heading}: {text}"));
    let at = part
        .find(before)
        .unwrap_or_else(|| panic!("{before}: {part}"));
    let words: Vec<&str> = part[..at].split_whitespace().collect();
    words
        .last()
        .and_then(|word| word.parse().ok())
        .unwrap_or_else(|| panic!("{before}: {part}"))
}

#[test]
fn false_commands_bring_down_the_vehicle_that_is_not_protected_and_not_the_other() {
    let folder = tempfile::tempdir().unwrap();
    let (done, printed) = run_in(
        folder.path(),
        "vsm",
        &["demo", "--attack", "--speed", "20", "--out", "out"],
    );
    let printed = String::from_utf8_lossy(&printed);
    assert!(done, "{printed}");
    let (on, off) = ("\nwith protection: ", "\nwithout protection: ");
    let protected = printed.split(off).next().unwrap();
    assert!(number(protected, on, " unsigned frames") > 100.0);
    assert!(number(protected, on, " with a wrong signature") > 100.0);
    assert!(number(protected, on, " DLI datagrams from another address") > 0.0);
    assert_eq!(number(protected, on, " of the attacker's"), 0.0);
    let lowest = |part: &str| {
        let after = part.split("lowest after that ").nth(1).unwrap();
        after
            .split_whitespace()
            .next()
            .unwrap()
            .parse::<f64>()
            .unwrap()
    };
    assert!(lowest(protected) > 9.0, "{protected}");
    let open = printed.split(off).nth(1).unwrap();
    assert!(lowest(open) < 0.5, "{open}");
    let picture = std::fs::read_to_string(folder.path().join("out/attack.svg")).unwrap();
    for part in ["with protection", "without protection", "PX4 refused"] {
        assert!(picture.contains(part), "{part}");
    }
}
