//! `cargo xtask portable`: the programs as static binaries (musl), for machines without this one's libraries, and for containers.
//!
//! No cross compiler: the crates have no C, and what links them, `rust-lld`, comes with the toolchain.

use std::fs;
use std::path::PathBuf;

use anyhow::{Context as _, Result, bail};

use crate::steps::{FLIGHT, Steps, cargo, option, root};

/// Builds into `target/portable/ARCHITECTURE`, for this machine's processor or that of `--architecture`.
pub(crate) fn build(steps: &mut Steps) -> Result<PathBuf> {
    let architecture = option("--architecture").map_or_else(
        || std::env::consts::ARCH.to_owned(),
        |value| value.display().to_string(),
    );
    if !ARCHITECTURES.contains(&architecture.as_str()) {
        bail!(
            "--architecture {architecture}: expected {}",
            ARCHITECTURES.join(" or ")
        );
    }
    let target = format!("{architecture}-unknown-linux-musl");
    let linker = format!(
        "CARGO_TARGET_{}_LINKER",
        target.to_uppercase().replace('-', "_")
    );
    // The flight binary apart from the tools: built with them the simulator would be linked into it.
    let programs = [
        (
            "vsm",
            FLIGHT,
            &["--no-default-features", "--features", "klv"] as &[&str],
        ),
        ("cucs", "release", &[]),
        ("px4-sim", "release", &[]),
        ("curve-plan", "release", &[]),
    ];
    for (package, profile, more) in programs {
        let mut command = cargo([
            "build",
            "--profile",
            profile,
            "--locked",
            "--bins",
            "--target",
            &target,
        ]);
        command.args(["--package", package]).args(more);
        steps
            .run(
                command
                    .env(&linker, "rust-lld")
                    .env("CARGO_PROFILE_RELEASE_STRIP", "true"),
            )
            .with_context(|| format!("is the target there? rustup target add {target}"))?;
    }
    let out = root().join("target/portable").join(&architecture);
    fs::create_dir_all(&out).with_context(|| out.display().to_string())?;
    for (name, profile, _) in programs {
        let built = root().join("target").join(&target).join(profile).join(name);
        fs::copy(&built, out.join(name)).with_context(|| built.display().to_string())?;
    }
    Ok(out)
}

const ARCHITECTURES: [&str; 2] = ["x86_64", "aarch64"];
