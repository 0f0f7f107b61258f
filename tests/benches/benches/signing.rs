//! What other signatures cost on the same bytes: those of signed frames of 40 and 266 bytes (ATTITUDE and FILE_TRANSFER_PROTOCOL
//! without their trailers). The frames themselves, beside the C library and pymavlink: `cargo bench -p mavlink-link --bench frames`.

use std::hint::black_box;
use std::time::Duration;

use blake2::digest::Mac as _;
use criterion::{Criterion, criterion_group, criterion_main};
use ed25519_dalek::Signer as _;
use poly1305::universal_hash::KeyInit as _;
use sha2::{Digest as _, Sha256};

/// Other ways to sign the same bytes; for those with two keys, verifying is what a receiver pays.
fn others(c: &mut Criterion) {
    let key: [u8; 32] = core::array::from_fn(|at| at as u8 + 1);
    for bytes in [40, 266] {
        // With link id and timestamp, which are signed too.
        let signed = &vec![0x5a; bytes + 7][..];
        c.bench_function(&format!("SHA-256 {bytes}"), |b| {
            b.iter(|| {
                Sha256::new()
                    .chain_update(key)
                    .chain_update(black_box(signed))
                    .finalize()
            });
        });
        c.bench_function(&format!("BLAKE2s {bytes}"), |b| {
            b.iter(|| {
                let mut mac =
                    <blake2::Blake2sMac256 as blake2::digest::KeyInit>::new_from_slice(&key)
                        .unwrap();
                mac.update(black_box(signed));
                mac.finalize()
            });
        });
        c.bench_function(&format!("Poly1305 {bytes}"), |b| {
            b.iter(|| poly1305::Poly1305::new((&key).into()).compute_unpadded(black_box(signed)));
        });
        let ed = ed25519_dalek::SigningKey::from_bytes(&key);
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
        let p256 = p256::ecdsa::SigningKey::from_slice(&key).unwrap();
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

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20).warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_millis(900));
    targets = others
}
criterion_main!(benches);
