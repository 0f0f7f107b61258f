//! What it costs to authenticate one message: the guard's HMAC-SHA256 beside signatures with two keys, Ed25519, ECDSA P-256
//! and RSA-2048, in one run, with the figures of the HMAC framework for drones (Sensors 2021) beside them. Prints a
//! Markdown table; `cargo bench -p comparison-benches --bench per_message`.
//!
//! RSA is OpenSSL's, and so is a second line of each of the others: the Rust crate for RSA (`rsa` 0.9) has an advisory
//! without a remedy, RUSTSEC-2023-0071. Without the program `openssl` these lines are left out, which is printed.

#![allow(clippy::print_stdout, reason = "figures are printed")]

use std::hint::black_box;
use std::process::{Command, Stdio};
use std::time::Duration;

use ed25519_dalek::Signer as _;
use kit::measure::thread_time;
use p256::ecdsa::signature::Verifier as _;
use stanag_msgs::Id;
use stanag_msgs::guard::{Direction, GuardKey, Guarded, MAX_GUARDED, Trailer};

fn main() {
    // `cargo test --benches` asks for nothing to be measured.
    if !std::env::args().any(|argument| argument == "--bench") {
        return;
    }
    println!(
        "| authenticating one message of {BYTES} bytes | bytes more | sign | verify | the paper's, to sign |"
    );
    println!("|---|---|---|---|---|");
    for Row { name, more, ns } in rust() {
        let [sign, verify] = ns.map(time);
        println!("| {name} | {more} | {sign} | {verify} | {} |", papers(name));
    }
    match openssl() {
        Some(rows) => {
            for Row { name, more, ns } in rows {
                let [sign, verify] = ns.map(time);
                println!("| {name} | {more} | {sign} | {verify} | {} |", papers(name));
            }
        }
        None => println!(
            "| RSA-2048 and the others by OpenSSL | LEFT OUT: no program `openssl` | | | |"
        ),
    }
}

/// How long it takes, in ns, to sign and to verify.
struct Row {
    name: &'static str,
    more: u32,
    ns: [f64; 2],
}

/// In rounds, each of which has all of them: what the machine does meanwhile falls on each alike.
fn rust() -> [Row; 3] {
    let bytes: Vec<u8> = (0..BYTES).map(|at| at as u8).collect();
    let guard = GuardKey::new(&KEY);
    let ed = ed25519_dalek::SigningKey::from_bytes(&KEY);
    let ed_signature = ed.sign(&bytes);
    let ed_public = ed.verifying_key();
    let p256 = p256::ecdsa::SigningKey::from_slice(&KEY).expect("a key");
    let p256_signature: p256::ecdsa::Signature = p256.sign(&bytes);
    let p256_public = *p256.verifying_key();
    let trailer = Trailer {
        direction: Direction::ToVsm,
        sender: Id(0x1b00_00a0),
        key_id: guard.id(),
        stamp_us: 1_795_219_200_000_000,
    };
    let receiver = Id(0x1b00_0001);
    let mut sealed = [0; MAX_GUARDED];
    let length = guard
        .seal(&trailer, receiver, &bytes, &mut sealed)
        .expect("it fits");
    let mut out = [0; MAX_GUARDED];
    let mut works: [&mut dyn FnMut(); 6] = [
        &mut || {
            let sealed = guard.seal(&trailer, receiver, black_box(&bytes), &mut out);
            black_box(sealed).expect("it fits");
        },
        &mut || {
            let guarded = Guarded::parse(black_box(&sealed[..length])).expect("a trailer");
            assert!(guard.verifies(&guarded, receiver));
        },
        &mut || {
            black_box(ed.sign(black_box(&bytes)));
        },
        &mut || {
            let verified = ed_public.verify_strict(black_box(&bytes), &ed_signature);
            verified.expect("its own");
        },
        &mut || {
            let signature: p256::ecdsa::Signature = p256.sign(black_box(&bytes));
            black_box(signature);
        },
        &mut || {
            let verified = p256_public.verify(black_box(&bytes), &p256_signature);
            verified.expect("its own");
        },
    ];
    let mut times = [const { Vec::new() }; 6];
    for _ in 0..ROUNDS {
        for (work, times) in works.iter_mut().zip(&mut times) {
            times.push(one(work));
        }
    }
    let medians = times.map(|mut times| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    });
    let [a, b, c, d, e, f] = medians;
    [
        Row {
            name: "HMAC-SHA256: the guard's whole trailer",
            more: 52,
            ns: [a, b],
        },
        Row {
            name: "Ed25519 (`ed25519-dalek`)",
            more: 64,
            ns: [c, d],
        },
        Row {
            name: "ECDSA P-256 (`p256`)",
            more: 64,
            ns: [e, f],
        },
    ]
}

/// ns a call, of as many as take a few milliseconds: processor time, as `openssl speed` has it too.
fn one(work: &mut dyn FnMut()) -> f64 {
    let begun = thread_time();
    let mut calls = 0_u32;
    while thread_time() - begun < ROUND {
        for _ in 0..8 {
            work();
        }
        calls += 8;
    }
    (thread_time() - begun).as_nanos() as f64 / f64::from(calls)
}

/// By `openssl speed`, which signs a digest: lines such as `+F2:2:2048:3589.58:46064.83`, operations a second.
fn openssl() -> Option<[Row; 3]> {
    let output = Command::new("openssl")
        .args(["speed", "-mr", "-seconds", "2"])
        .args(["rsa2048", "ecdsap256", "ed25519"])
        .stderr(Stdio::null())
        .output()
        .ok()?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let row = |name, more, kind: &str| {
        let line = text.lines().find(|line| line.starts_with(kind))?;
        let mut figures = line.rsplit(':');
        let (verify, sign) = (figures.next()?, figures.next()?);
        let ns = [sign, verify].map(|text| text.trim().parse::<f64>().map(|rate| 1e9 / rate));
        let [Ok(sign), Ok(verify)] = ns else {
            return None;
        };
        Some(Row {
            name,
            more,
            ns: [sign, verify],
        })
    };
    Some([
        row("Ed25519 (OpenSSL)", 64, "+F6:")?,
        row(
            "ECDSA P-256 (OpenSSL, hand-written for this processor)",
            64,
            "+F4:",
        )?,
        row("RSA-2048 (OpenSSL)", 256, "+F2:")?,
    ])
}

/// What the paper gives for a signature; for HMAC it says microseconds.
fn papers(name: &str) -> &'static str {
    match name {
        _ if name.starts_with("RSA") => "2.32 ms",
        _ if name.starts_with("ECDSA") => "1.03 ms",
        _ if name.starts_with("HMAC") => "microseconds",
        _ => "",
    }
}

fn time(ns: f64) -> String {
    if ns < 1e3 {
        format!("{ns:.0} ns")
    } else {
        format!("{:.1} us", ns / 1e3)
    }
}

const KEY: [u8; 32] = [0x5a; 32];
/// About what 4000 has, the position and attitude report.
const BYTES: usize = 100;
const ROUNDS: usize = 41;
const ROUND: Duration = Duration::from_millis(4);
