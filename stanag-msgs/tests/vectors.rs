//! The codec and an independent implementation agree, both ways, on every layout.

use std::collections::BTreeSet;
use std::io::Read;

use stanag_msgs::table::MESSAGES;
use stanag_msgs::vectors::{Mismatch, check};

fn vectors() -> String {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../tests/data/dli/vectors-4586.jsonl.gz"
    );
    let mut text = String::new();
    let file = std::fs::File::open(path).unwrap();
    flate2::read::GzDecoder::new(file)
        .read_to_string(&mut text)
        .unwrap();
    text
}

#[test]
fn every_vector_is_met_both_ways() {
    let mut seen = BTreeSet::new();
    for line in vectors().lines() {
        check(line).unwrap_or_else(|mismatch| panic!("{mismatch}\n{line}"));
        let value: serde_json::Value = serde_json::from_str(line).unwrap();
        seen.insert(value["id"].as_u64().unwrap());
    }
    let known = MESSAGES.iter().filter(|info| info.has_known_lengths());
    assert_eq!(seen, known.map(|info| u64::from(info.id)).collect());
}

#[test]
fn a_vector_that_is_wrong_is_found_out() {
    let vectors = vectors();
    let line = vectors
        .lines()
        .find(|line| line.contains("\"id\": 4000,"))
        .unwrap();
    assert_eq!(check(line), Ok(()));
    let mut value: serde_json::Value = serde_json::from_str(line).unwrap();
    value["fields"]["Altitude"] = 1.into();
    assert!(matches!(
        check(&value.to_string()),
        Err(Mismatch::Differs { .. })
    ));
    value["fields"]["Altitude"] = (1 << 23).into();
    assert!(matches!(check(&value.to_string()), Err(Mismatch::Json(_))));
    assert!(matches!(check("{}"), Err(Mismatch::Vector { .. })));
}
