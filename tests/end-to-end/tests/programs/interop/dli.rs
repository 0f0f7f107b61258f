//! `vsm decode` and `vsm encode` agree with the reference codec on messages nobody has seen before.

use std::path::PathBuf;

use serde_json::{Map, Value};

use kit::process::{filter, filter_with_status, program};
use vsm_tests::{here, plain_python, seed_from_clock};

/// Random messages of every layout whose lengths are known, with the bytes the reference makes of them.
fn vectors() -> Vec<Map<String, Value>> {
    let seed = seed_from_clock().to_string();
    let reference: PathBuf = here().join("data/dli/reference.py");
    let arguments = [
        reference.as_os_str(),
        "vectors".as_ref(),
        "--seed".as_ref(),
        seed.as_ref(),
        "--count".as_ref(),
        "4".as_ref(),
    ];
    let lines = filter(&plain_python(), arguments, String::new());
    let vectors: Vec<_> = lines.lines().map(|line| object(line, line)).collect();
    let layouts = vectors.iter().map(|v| v["id"].as_u64()).fold(
        std::collections::BTreeSet::new(),
        |mut ids, id| {
            ids.insert(id);
            ids
        },
    );
    assert!(
        layouts.len() >= 60 && vectors.len() == 4 * layouts.len(),
        "{} layouts, {} vectors",
        layouts.len(),
        vectors.len()
    );
    vectors
}

fn wire(vector: &Map<String, Value>) -> &str {
    vector["wire"].as_str().expect("the bytes in hex")
}

fn object(line: &str, of: &str) -> Map<String, Value> {
    serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}\nfor {of}"))
}

#[test]
fn decode_agrees_with_the_reference() {
    let vectors = vectors();
    let input: String = vectors.iter().map(|v| format!("{}\n", wire(v))).collect();
    let output = filter(&program("vsm"), ["decode", "--raw"], input);
    assert_eq!(output.lines().count(), vectors.len(), "a line for a line");

    for (vector, line) in vectors.iter().zip(output.lines()) {
        let decoded = object(line, wire(vector));
        for key in ["id", "source", "destination", "ack", "idd", "checksum"] {
            assert_eq!(
                decoded.get(key),
                vector.get(key),
                "{key} of {}",
                wire(vector)
            );
        }
        let (ours, theirs) = (&decoded["fields"], &vector["fields"]);
        let (ours, theirs) = (
            ours.as_object().expect("fields"),
            theirs.as_object().expect("fields"),
        );
        assert_eq!(ours.len(), theirs.len(), "{line}\nagainst {theirs:?}");
        for (name, value) in theirs {
            assert!(
                same(ours.get(name), value),
                "message {} field {name}: {:?}, expected {value}",
                vector["id"],
                ours.get(name)
            );
        }
    }
}

#[test]
fn encode_agrees_with_the_reference() {
    let vectors = vectors();
    let input: String = vectors
        .iter()
        .map(|vector| {
            let mut value = vector.clone();
            value.remove("wire");
            format!("{}\n", Value::Object(value))
        })
        .collect();
    let output = filter(&program("vsm"), ["encode", "--raw"], input);
    assert_eq!(output.lines().count(), vectors.len(), "a line for a line");
    for (vector, line) in vectors.iter().zip(output.lines()) {
        assert_eq!(
            line.trim().to_ascii_lowercase(),
            wire(vector),
            "message {}",
            vector["id"]
        );
    }
}

#[test]
fn a_bad_line_is_reported_and_the_next_one_is_read() {
    let vectors = vectors();
    let good = wire(&vectors[0]);
    let short = &good[..good.len() - 2];
    let input = format!("{short}\nnot hex\n{good}\n");
    let (output, status) = filter_with_status(&program("vsm"), ["decode", "--raw"], input);
    assert_eq!(status.code(), Some(1), "{output}");
    let lines: Vec<_> = output.lines().map(|line| object(line, line)).collect();
    assert_eq!(lines.len(), 3, "{output}");
    assert!(lines[0].contains_key("error"), "{output}");
    assert!(lines[1].contains_key("error"), "{output}");
    assert_eq!(lines[2]["id"], vectors[0]["id"], "{output}");
}

/// Integers and texts alike; reals as numbers, since 1 and 1.0 are the same bytes.
fn same(ours: Option<&Value>, theirs: &Value) -> bool {
    match (ours, theirs) {
        (Some(Value::Number(a)), Value::Number(b)) if a.is_f64() || b.is_f64() => {
            a.as_f64().map(f64::to_bits) == b.as_f64().map(f64::to_bits)
        }
        (ours, theirs) => ours == Some(theirs),
    }
}
