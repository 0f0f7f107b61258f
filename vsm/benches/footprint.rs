//! What a bridge of one vehicle with files costs before it has anything to do: how long `vsm run` takes until it is ready, its
//! memory, and the size of the program. Prints a Markdown table; `cargo bench -p vsm --bench footprint`, `-- --before PROGRAM` with
//! another build of `vsm` in the same turns.

#![allow(missing_docs, reason = "a bench has no callers")]
#![allow(clippy::print_stdout, reason = "figures are printed")]

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use kit::Random;
use kit::measure::{Spread, given, in_turns, memory_kb, own_memory_kb};
use kit::process::{KillOnDrop, free_udp_port, write_key};

fn main() {
    // `cargo test --benches` asks for nothing to be measured.
    if !std::env::args().any(|argument| argument == "--bench") {
        return;
    }
    let mut subjects = vec![("`vsm run`", PathBuf::from(env!("CARGO_BIN_EXE_vsm")))];
    subjects.extend(given("--before").map(|path| ("before", PathBuf::from(path))));
    let measured = in_turns(TURNS, &mut Random::new(), &mut subjects, |(_, program)| {
        start(program)
    });
    println!(
        "| one vehicle, files | start, to \"ready\", ms | memory of its own, MB | with the program's pages, MB | program, stripped, MB |"
    );
    println!("|---|---|---|---|---|");
    for ((name, program), turns) in subjects.iter().zip(&measured) {
        let of = |part: usize| Spread::of(&turns.iter().map(|turn| turn[part]).collect::<Vec<_>>());
        println!(
            "| {name} | {:.1} | {:.1} | {:.1} | {:.1} |",
            of(0),
            of(1),
            of(2),
            stripped_mb(program)
        );
    }
    println!();
}

/// Starts it once: ms until it is ready, and its memory after [`SETTLES`], its own and all, MB.
fn start(program: &Path) -> [f64; 3] {
    let folder = tempfile::tempdir().expect("a folder");
    write_key(&folder.path().join("uav.key"), &[0x5a; 32]);
    let config = folder.path().join("vsm.toml");
    let text = format!(
        "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:{}\"\n[[cucs]]\nid = \"1b:00:00:a0\"\nloi = [2, 4, 5]\n\
         address = \"127.0.0.1\"\n[[vehicle]]\nid = \"1b:00:01:01\"\nlink = \"udpin:127.0.0.1:{}\"\nsystem_id = 1\n\
         signing = {{ key_file = \"uav.key\" }}\n[store]\ndir = \"state\"\n",
        free_udp_port(),
        free_udp_port()
    );
    fs::write(&config, text).expect("the configuration");
    let mut command = Command::new(program);
    command.args(["run", "--config"]).arg(&config);
    command.stdout(Stdio::null()).stderr(Stdio::piped());
    let begun = Instant::now();
    let mut vsm = KillOnDrop(command.spawn().expect("vsm run"));
    // It stays open: what follows is logged too.
    let mut log = BufReader::new(vsm.0.stderr.take().expect("its log")).lines();
    let ready = log.any(|line| line.is_ok_and(|line| line.contains("ready")));
    let took = begun.elapsed();
    assert!(ready, "it ended before it was ready");
    std::thread::sleep(SETTLES);
    let process = vsm.0.id();
    let [own, all] = [own_memory_kb(process), memory_kb(process)].map(|kb| kb / 1_000.0);
    [took.as_secs_f64() * 1e3, own, all]
}

/// What is left of a program without what only a debugger reads; MB.
fn stripped_mb(program: &Path) -> f64 {
    let folder = tempfile::tempdir().expect("a folder");
    let stripped = folder.path().join("vsm");
    let mut command = Command::new("strip");
    let done = command.arg("-o").arg(&stripped).arg(program).status();
    if !done.is_ok_and(|status| status.success()) {
        println!("note: LEFT OUT: the program's size: no `strip`");
        return f64::NAN;
    }
    fs::metadata(&stripped).expect("its size").len() as f64 / 1e6
}

const TURNS: usize = 15;
const SETTLES: Duration = Duration::from_millis(500);
