//! What a signed frame costs, for frames of 40 and 266 bytes (ATTITUDE and FILE_TRANSFER_PROTOCOL without
//! their trailers): ours, the C library and pymavlink in one run, and other signatures on the same bytes.
//!
//! The C library and pymavlink are measured where `cc` and pymavlink are at hand; what is left out is printed.

#![allow(clippy::print_stdout, reason = "figures are printed")]

use std::hint::black_box;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use blake2::digest::Mac as _;
use criterion::{Criterion, criterion_group, criterion_main};
use ed25519_dalek::Signer as _;
use mavlink_link::Now;
use mavlink_link::clock::Origin;
use mavlink_link::dialect::{ATTITUDE_DATA, FILE_TRANSFER_PROTOCOL_DATA, MavMessage};
use mavlink_link::frame::{Header, INCOMPAT_SIGNED, MAX_FRAME, encode};
use mavlink_link::link::{Auth, Endpoint, Link, LinkConfig, Security};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::{SigningKey, Stamp, sign};
use mavlink_link::store::MemoryDisk;
use poly1305::universal_hash::KeyInit as _;
use sha2::{Digest as _, Sha256};

fn now() -> Now {
    Now {
        mono: Duration::ZERO,
        wall: Duration::from_secs(1_795_219_200),
    }
}

fn key() -> SigningKey {
    SigningKey::new(core::array::from_fn(|i| i as u8 + 1)).unwrap()
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

fn frame(message: &MavMessage, stamp: Stamp) -> ([u8; MAX_FRAME], usize) {
    let mut out = [0; MAX_FRAME];
    let header = Header {
        system_id: 1,
        component_id: 1,
        incompat: INCOMPAT_SIGNED,
        ..Header::default()
    };
    let len = encode(message, header, &mut out);
    let len = sign(&key(), 0, stamp, &mut out, len).unwrap();
    (out, len)
}

fn ours(c: &mut Criterion) {
    for (bytes, message) in messages() {
        c.bench_function(&format!("ours receive {bytes}"), |b| {
            b.iter_custom(|iterations| {
                let mut store = MemoryDisk::default();
                let mut keys =
                    KeyState::start(key(), Origin::KeyFile, Stamp::ZERO, now(), &mut store)
                        .unwrap();
                let mut link =
                    Link::<u8>::new(LinkConfig::new(1, Security::Signed, Endpoint::Fixed(1)));
                let first = Stamp::from_unix(now().wall).get() + 1;
                let (mut spent, mut stamp, mut taken) = (Duration::ZERO, first, 0);
                let mut left = iterations;
                while left > 0 {
                    let count = left.min(2_000);
                    // Within the hour that a stamp may lead, however long the run.
                    if stamp > first + 300_000_000 {
                        stamp = first;
                        keys =
                            KeyState::start(key(), Origin::KeyFile, Stamp::ZERO, now(), &mut store)
                                .unwrap();
                    }
                    let frames: Vec<_> = (0..count)
                        .map(|n| frame(&message, Stamp::new(stamp + n)))
                        .collect();
                    stamp += count;
                    let started = Instant::now();
                    for (frame, len) in &frames {
                        let auth = Auth::Signed {
                            key: &mut keys,
                            store: &mut store,
                        };
                        link.handle_datagram(now(), 1, &frame[..*len], auth, &mut |delivery| {
                            taken += u64::from(delivery.verified);
                            let _ = black_box(&delivery.message);
                        });
                    }
                    spent += started.elapsed();
                    left -= count;
                }
                assert_eq!(taken, iterations, "every frame was delivered");
                spent
            });
        });
        c.bench_function(&format!("ours send {bytes}"), |b| {
            let mut store = MemoryDisk::default();
            let mut keys =
                KeyState::start(key(), Origin::KeyFile, Stamp::ZERO, now(), &mut store).unwrap();
            let mut link =
                Link::<u8>::new(LinkConfig::new(1, Security::Signed, Endpoint::Fixed(1)));
            let mut out = [0; MAX_FRAME];
            b.iter(|| {
                let auth = Auth::Signed {
                    key: &mut keys,
                    store: &mut store,
                };
                black_box(link.send(now(), auth, black_box(&message), &mut out)).unwrap()
            });
        });
    }
}

/// Other ways to sign the same bytes; for those with two keys, verifying is what a receiver pays.
fn others(c: &mut Criterion) {
    for (bytes, message) in messages() {
        let (frame, len) = frame(&message, Stamp::new(1));
        let signed = &frame[..len - 6];
        c.bench_function(&format!("SHA-256 {bytes}"), |b| {
            b.iter(|| {
                Sha256::new()
                    .chain_update(key().expose())
                    .chain_update(black_box(signed))
                    .finalize()
            });
        });
        c.bench_function(&format!("BLAKE2s {bytes}"), |b| {
            b.iter(|| {
                let mut mac = <blake2::Blake2sMac256 as blake2::digest::KeyInit>::new_from_slice(
                    key().expose(),
                )
                .unwrap();
                mac.update(black_box(signed));
                mac.finalize()
            });
        });
        c.bench_function(&format!("Poly1305 {bytes}"), |b| {
            b.iter(|| {
                poly1305::Poly1305::new(key().expose().into()).compute_unpadded(black_box(signed))
            });
        });
        let ed = ed25519_dalek::SigningKey::from_bytes(key().expose());
        let signature = ed.sign(signed);
        c.bench_function(&format!("Ed25519 sign {bytes}"), |b| {
            b.iter(|| ed.sign(black_box(signed)))
        });
        c.bench_function(&format!("Ed25519 verify {bytes}"), |b| {
            b.iter(|| {
                ed.verifying_key()
                    .verify_strict(black_box(signed), &signature)
                    .unwrap()
            });
        });
        let p256 = p256::ecdsa::SigningKey::from_slice(key().expose()).unwrap();
        let signature: p256::ecdsa::Signature = p256.sign(signed);
        let public = *p256.verifying_key();
        c.bench_function(&format!("ECDSA P-256 sign {bytes}"), |b| {
            b.iter(|| -> p256::ecdsa::Signature { p256.sign(black_box(signed)) });
        });
        c.bench_function(&format!("ECDSA P-256 verify {bytes}"), |b| {
            use p256::ecdsa::signature::Verifier as _;
            b.iter(|| public.verify(black_box(signed), &signature).unwrap());
        });
    }
}

/// Not criterion's own figures: these programs time themselves, in the same run.
fn other_programs(_: &mut Criterion) {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("bench");
    match comparison_benches::harness(&folder) {
        Ok(program) => {
            for line in comparison_benches::ask(&program, &["bench"], "").lines() {
                println!("C library {line} (bytes, ns a frame, median)");
            }
        }
        Err(missing) => println!("C library LEFT OUT: {missing}"),
    }
    match comparison_benches::python() {
        Ok(python) => {
            for line in comparison_benches::ask(&python, &["-c", PYMAVLINK], "").lines() {
                println!("pymavlink {line} (bytes, ns a frame, median)");
            }
        }
        Err(missing) => println!("pymavlink LEFT OUT: {missing}"),
    }
}

const PYMAVLINK: &str = r"
import os, statistics, time
os.environ['MAVLINK20'] = '1'
from pymavlink.dialects.v20 import common as m
def end():
    mav = m.MAVLink(None, srcSystem=1, srcComponent=1)
    mav.signing.secret_key = bytes(range(1, 33)); mav.signing.timestamp = 40000000000000
    mav.signing.sign_outgoing = True
    return mav
kinds = {40: lambda: m.MAVLink_attitude_message(77, .1, .2, .3, .4, .5, .6),
         266: lambda: m.MAVLink_file_transfer_protocol_message(0, 245, 190, bytes([0x5a] * 251))}
for size, make in kinds.items():
    send, receive = [], []
    for _ in range(7):
        a, b = end(), end()
        t = time.perf_counter_ns()
        frames = [make().pack(a) for _ in range(300)]
        send.append((time.perf_counter_ns() - t) / 300)
        frames = [bytearray(f) for f in frames]
        t = time.perf_counter_ns()
        for f in frames:
            b.decode(f)
        receive.append((time.perf_counter_ns() - t) / 300)
    print(size, 'receive', round(statistics.median(receive)), 'send', round(statistics.median(send)))
";

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20).warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_millis(900));
    targets = other_programs, ours, others
}
criterion_main!(benches);
