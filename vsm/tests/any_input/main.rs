//! Any bytes at all, from golden vectors, recordings and examples bent by a seed: whole sessions with the bridge,
//! MAVLink links, configurations. Nothing panics, and what is promised of what goes out is kept.
//!
//! `VSM_MUTATIONS=1000000 cargo test --release -p vsm --test any_input` runs it for longer. The same targets are fuzzed
//! with coverage as a guide (`cargo xtask fuzz`), from the seeds that `VSM_CORPUS=DIR` writes, and from what was found before.

mod every_replay;
mod kept;
mod seeds;

use std::path::PathBuf;

use kit::any_input::{self, access_list, config, frame, ftp, route_file, session, web_frame};
use kit::{Random, attacks};

/// What is tried: its name, what it does with bytes, and the bytes that it begins with.
type Target = (&'static str, fn(&[u8]), fn() -> Vec<Vec<u8>>);

const TARGETS: [Target; 7] = [
    ("access_list", access_list::run, seeds::access_lists),
    ("mavlink_frame", frame::run, seeds::frames),
    ("ftp", ftp::run, seeds::file_answers),
    ("session", session::run, seeds::sessions),
    ("config", config::run, seeds::configurations),
    ("web_frame", web_frame::run, seeds::web_frames),
    ("route_file", route_file::run, seeds::route_files),
];

#[test]
fn every_target_holds_on_its_seeds_and_their_mutations() {
    let mutations: u64 = std::env::var("VSM_MUTATIONS")
        .ok()
        .and_then(|text| text.parse().ok())
        .unwrap_or_else(|| attacks::times(1_000, 12_000));
    for (name, run, seeds) in TARGETS {
        let seeds = seeds();
        assert!(!seeds.is_empty(), "{name} has no seeds");
        for seed in seeds.iter().step_by((seeds.len() / 200).max(1)) {
            run(seed);
        }
        let mut random = Random::with_seed(0x4586);
        for _ in 0..mutations {
            let mut bytes = seeds[random.usize(..seeds.len())].clone();
            for _ in 0..random.usize(1..=8) {
                mutate(&mut bytes, &seeds, &mut random);
            }
            run(&bytes);
        }
    }
    let held = "at each of seven targets: no panic, and what goes out is well formed, bounded, and to who may have it";
    attacks::report(attacks::MESSAGES, mutations, held);
}

#[test]
fn seeds_are_there_to_fuzz_from() {
    let datagrams: fn() -> Vec<Vec<u8>> = seeds::datagrams;
    let made = TARGETS.map(|(name, _, seeds)| (name, seeds));
    let folder = std::env::var_os("VSM_CORPUS").map(PathBuf::from);
    let write = |target: &str, name: String, bytes: &[u8]| {
        if let Some(folder) = &folder {
            let folder = folder.join(target);
            std::fs::create_dir_all(&folder).expect("the corpus' folder");
            std::fs::write(folder.join(name), bytes).expect("a seed");
        }
    };
    for (target, seeds) in made
        .into_iter()
        .chain([("dli_datagram", datagrams), ("dli_wrapper", datagrams)])
    {
        let seeds = seeds();
        assert!(!seeds.is_empty(), "{target} has no seeds");
        for (number, seed) in seeds.iter().enumerate() {
            write(target, format!("seed-{number:05}"), seed);
        }
    }
    for (target, _) in any_input::TARGETS {
        for (line, bytes) in any_input::kept(target) {
            write(target, format!("kept-{line:05}"), &bytes);
        }
    }
}

fn mutate(bytes: &mut Vec<u8>, seeds: &[Vec<u8>], random: &mut Random) {
    let at = random.usize(..bytes.len().max(1));
    match random.u8(..5) {
        0 if !bytes.is_empty() => bytes[at] ^= 1 << random.u8(..8),
        1 if !bytes.is_empty() => bytes[at] = [0, 1, 0x7f, 0x80, 0xff][random.usize(..5)],
        2 => bytes.truncate(at),
        3 => bytes.insert(at.min(bytes.len()), random.u8(..)),
        _ => {
            let other = &seeds[random.usize(..seeds.len())];
            let from = random.usize(..other.len().max(1)).min(other.len());
            bytes.truncate(at);
            bytes.extend(&other[from..]);
        }
    }
}
