//! What a signed frame costs, for frames of 40 and 266 bytes (ATTITUDE and FILE_TRANSFER_PROTOCOL without their trailers): ours, the
//! C library and pymavlink in turns of random order. Prints a Markdown table; `cargo bench -p mavlink-link --bench frames`.
//!
//! The C library is the one that pymavlink generates, compiled twice: by `cc -O2`, and by `cc -O3 -march=native`. Its SHA-256 is
//! portable C; ours is the crate `sha2`'s, which uses the processor's SHA instructions where it has them. Without `cc` or pymavlink
//! these are left out, which is printed.
//!
//! `-- --check` is for CI: it compares the receive path with SHA-256 and CRC of the same bytes in the same run, and fails where the
//! ratio is above a bound. Both are of one machine and one moment, so that the ratio is steady where times are not.

#![allow(missing_docs, reason = "a bench has no callers")]
#![allow(clippy::print_stdout, reason = "figures are printed")]

use std::hint::black_box;
use std::path::PathBuf;
use std::process::{Command, ExitCode};
use std::time::Duration;

use comparison_benches::Peer;
use crc::{CRC_16_MCRF4XX, Crc, Table};
use kit::Random;
use kit::measure::{Spread, in_turns, thread_time};
use mavlink_link::Now;
use mavlink_link::clock::Origin;
use mavlink_link::dialect::{ATTITUDE_DATA, FILE_TRANSFER_PROTOCOL_DATA, MavMessage};
use mavlink_link::frame::{Header, INCOMPAT_SIGNED, MAX_FRAME, encode};
use mavlink_link::link::{Auth, Endpoint, Link, LinkConfig, Security};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::{SigningKey, Stamp, sign};
use mavlink_link::store::MemoryDisk;
use sha2::{Digest as _, Sha256};

fn main() -> ExitCode {
    let has = |option: &str| std::env::args().any(|argument| argument == option);
    // `cargo test --benches` asks for nothing to be measured.
    match (has("--bench"), has("--check")) {
        (true, true) => check(),
        (true, false) => {
            compare();
            ExitCode::SUCCESS
        }
        (false, _) => ExitCode::SUCCESS,
    }
}

/// The receive path and what it cannot do without, in the same run.
fn check() -> ExitCode {
    let mut passed = true;
    for ((bytes, message), bound) in messages().into_iter().zip(BOUNDS) {
        let mut subjects: [fn(&MavMessage) -> f64; 2] = [receive, digest];
        let times = in_turns(CHECKS, &mut Random::new(), &mut subjects, |subject| {
            subject(&message)
        });
        // What disturbs only adds: the least is the steadiest.
        let least = |times: &[f64]| Spread::of(times).min;
        let (ours, digests) = (least(&times[0]), least(&times[1]));
        let ratio = ours / digests;
        println!(
            "receive {bytes} bytes: {ours:.0} ns, SHA-256 and CRC of them {digests:.0} ns: {ratio:.2}, expected at most {bound}"
        );
        passed &= ratio <= bound;
    }
    match passed {
        true => ExitCode::SUCCESS,
        false => ExitCode::FAILURE,
    }
}

fn compare() {
    let mut subjects = vec![Subject::Ours];
    let mut names = vec!["vsm"];
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("bench");
    for (name, flags) in LIBRARIES {
        match comparison_benches::harness(&folder, flags) {
            Ok(program) => {
                subjects.push(Subject::Other(Peer::start(
                    Command::new(program).arg("bench"),
                )));
                names.push(name);
            }
            Err(missing) => println!("note: LEFT OUT: {name}: {missing}"),
        }
    }
    match comparison_benches::python() {
        Ok(python) => {
            subjects.push(Subject::Other(Peer::start(
                Command::new(python).args(["-c", PYMAVLINK]),
            )));
            names.push("pymavlink");
        }
        Err(missing) => println!("note: LEFT OUT: pymavlink: {missing}"),
    }
    let rounds = in_turns(TURNS, &mut Random::new(), &mut subjects, Subject::round);
    let column = |at: usize, figure: usize| -> Vec<f64> {
        rounds[at].iter().map(|round| round[figure]).collect()
    };
    println!(
        "| a signed frame, ns of processor time | receive 40 | send 40 | receive 266 | send 266 |"
    );
    println!("|---|---|---|---|---|");
    let row = |name: &str, of: &dyn Fn(usize) -> String| {
        let cells: Vec<String> = (0..4).map(of).collect();
        println!("| {name} | {} |", cells.join(" | "));
    };
    for (at, name) in names.iter().enumerate() {
        row(name, &|figure| {
            format!("{:.0}", Spread::of(&column(at, figure)))
        });
    }
    let ratio = |at, figure| Spread::of_ratios(&column(0, figure), &column(at, figure));
    for (at, name) in names.iter().enumerate().skip(1) {
        let what = format!("vsm, as a part of {name}");
        row(&what, &|figure| format!("{:.2}", ratio(at, figure)));
    }
    println!(
        "\nnote: the SHA-256 of the C library is portable C without SHA-NI; that of vsm {}",
        sha_instructions()
    );
    for (at, name) in names.iter().enumerate() {
        for (figure, bytes) in [(0, 40), (2, 266)] {
            let of = match *name {
                "C library, `cc -O2`" => "c",
                "C library, `cc -O3 -march=native`" => "c-native",
                _ => continue,
            };
            println!(
                "{}",
                ratio(at, figure).figure(&format!("receive-{bytes}-of-{of}"))
            );
        }
    }
}

/// Of x86; others are not looked at.
fn sha_instructions() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("sha") {
        return "uses this processor's (SHA-NI)";
    }
    "finds no SHA-NI here"
}

enum Subject {
    Ours,
    /// Answers the size of a frame by two figures of a round, ns: to receive and to send one.
    Other(Peer),
}

impl Subject {
    /// Receive and send, 40 bytes, then 266; ns.
    fn round(&mut self) -> [f64; 4] {
        let [(_, short), (_, long)] = messages();
        match self {
            Subject::Ours => [receive(&short), send(&short), receive(&long), send(&long)],
            Subject::Other(peer) => {
                let mut ask = |bytes| {
                    let answer = peer.ask(bytes);
                    let mut figures = answer.split_whitespace().map(str::parse);
                    match (figures.next(), figures.next()) {
                        (Some(Ok(receive)), Some(Ok(send))) => [receive, send],
                        _ => panic!("{answer:?} is not two figures"),
                    }
                };
                let ([a, b], [c, d]): ([f64; 2], [f64; 2]) = (ask("40"), ask("266"));
                [a, b, c, d]
            }
        }
    }
}

/// ns a frame, from the datagram to the decoded message.
fn receive(message: &MavMessage) -> f64 {
    let (mut keys, mut store, mut link) = end();
    let first = Stamp::from_unix(now().wall).get() + 1;
    let frames: Vec<_> = (0..FRAMES)
        .map(|number| frame(message, Stamp::new(first + number)))
        .collect();
    let mut taken = 0;
    let begun = thread_time();
    for (frame, length) in &frames {
        let auth = Auth::Signed {
            key: &mut keys,
            store: &mut store,
        };
        link.handle_datagram(now(), 1, &frame[..*length], auth, &mut |delivery| {
            taken += u64::from(delivery.verified);
            let _ = black_box(&delivery.message);
        });
    }
    let spent = thread_time() - begun;
    assert_eq!(taken, FRAMES, "every frame was delivered");
    spent.as_nanos() as f64 / FRAMES as f64
}

/// ns a frame, from the message to the signed datagram.
fn send(message: &MavMessage) -> f64 {
    let (mut keys, mut store, mut link) = end();
    let mut out = [0; MAX_FRAME];
    let begun = thread_time();
    for _ in 0..FRAMES {
        let auth = Auth::Signed {
            key: &mut keys,
            store: &mut store,
        };
        let sent = link.send(now(), auth, black_box(message), &mut out);
        black_box(sent).expect("it is signed");
    }
    (thread_time() - begun).as_nanos() as f64 / FRAMES as f64
}

/// ns a frame, for what no receiver can do without: the hash of key and signed bytes, and the checksum.
fn digest(message: &MavMessage) -> f64 {
    let (frame, length) = frame(message, Stamp::new(1));
    let signed = &frame[..length - SIGNATURE];
    let checked = &frame[1..length - TRAILER - CHECKSUM];
    let key = key();
    let begun = thread_time();
    for _ in 0..FRAMES {
        let hash = Sha256::new()
            .chain_update(key.expose())
            .chain_update(black_box(signed))
            .finalize();
        black_box(hash);
        black_box(CRC.checksum(black_box(checked)));
    }
    (thread_time() - begun).as_nanos() as f64 / FRAMES as f64
}

fn end() -> (KeyState, MemoryDisk, Link<u8>) {
    let mut store = MemoryDisk::default();
    let keys = KeyState::start(key(), Origin::KeyFile, Stamp::ZERO, now(), &mut store);
    let link = Link::new(LinkConfig::new(1, Security::Signed, Endpoint::Fixed(1)));
    (keys.expect("a key"), store, link)
}

fn frame(message: &MavMessage, stamp: Stamp) -> ([u8; MAX_FRAME], usize) {
    let mut out = [0; MAX_FRAME];
    let header = Header {
        system_id: 1,
        component_id: 1,
        incompat: INCOMPAT_SIGNED,
        ..Header::default()
    };
    let length = encode(message, header, &mut out);
    let length = sign(&key(), 0, stamp, &mut out, length).expect("it fits");
    (out, length)
}

fn messages() -> [(usize, MavMessage); 2] {
    let attitude = ATTITUDE_DATA {
        time_boot_ms: 77,
        roll: 0.1,
        pitch: 0.2,
        yaw: 0.3,
        rollspeed: 0.4,
        pitchspeed: 0.5,
        yawspeed: 0.6,
    };
    let mut file = FILE_TRANSFER_PROTOCOL_DATA {
        target_system: 245,
        target_component: 190,
        ..Default::default()
    };
    file.payload.iter_mut().for_each(|byte| *byte = 0x5a);
    [
        (40, MavMessage::ATTITUDE(attitude)),
        (266, MavMessage::FILE_TRANSFER_PROTOCOL(file)),
    ]
}

fn key() -> SigningKey {
    SigningKey::new(core::array::from_fn(|at| at as u8 + 1)).expect("a key")
}

fn now() -> Now {
    Now {
        mono: Duration::ZERO,
        wall: Duration::from_secs(1_795_219_200),
    }
}

const TURNS: usize = 31;
/// Of the check: each turn takes some ms.
const CHECKS: usize = 101;
/// Of a round.
const FRAMES: u64 = 2_000;
/// What the receive path may take of the time for SHA-256 and CRC, at 40 and at 266 bytes. It hashes once, in one buffer, and so
/// takes little more than they do; a second hash or checksum, or an allocation for each frame, is beyond the bound.
const BOUNDS: [f64; 2] = [2.5, 2.0];
const LIBRARIES: [(&str, &[&str]); 2] = [
    ("C library, `cc -O2`", &["-O2"]),
    (
        "C library, `cc -O3 -march=native`",
        &["-O3", "-march=native"],
    ),
];
static CRC: Crc<u16, Table<16>> = Crc::<u16, Table<16>>::new(&CRC_16_MCRF4XX);
/// The signature's own bytes, which are not signed.
const SIGNATURE: usize = 6;
/// Link id, timestamp and signature.
const TRAILER: usize = 13;
const CHECKSUM: usize = 2;

const PYMAVLINK: &str = r"
import os, sys, time
os.environ['MAVLINK20'] = '1'
from pymavlink.dialects.v20 import common as m
def end():
    mav = m.MAVLink(None, srcSystem=1, srcComponent=1)
    mav.signing.secret_key = bytes(range(1, 33)); mav.signing.timestamp = 40000000000000
    mav.signing.sign_outgoing = True
    return mav
kinds = {40: lambda: m.MAVLink_attitude_message(77, .1, .2, .3, .4, .5, .6),
         266: lambda: m.MAVLink_file_transfer_protocol_message(0, 245, 190, bytes([0x5a] * 251))}
for line in iter(sys.stdin.readline, ''):
    make, a, b = kinds[int(line)], end(), end()
    t = time.thread_time_ns()
    frames = [make().pack(a) for _ in range(300)]
    send = (time.thread_time_ns() - t) / 300
    frames = [bytearray(f) for f in frames]
    t = time.thread_time_ns()
    for f in frames:
        b.decode(f)
    print((time.thread_time_ns() - t) / 300, send, flush=True)
";
