//! `cargo xtask deb`: the programs, the unit and an example configuration as a Debian package, by `dpkg-deb`.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail};

use crate::steps::{Steps, cargo, generate, is_there, option, root};

/// Builds release programs and packs them into `target/deb`; `--bins DIR` packs those of a folder, uncompressed, and
/// `--out DIR` puts the package elsewhere.
pub(crate) fn build(steps: &mut Steps) -> Result<PathBuf> {
    let bins = option("--bins");
    if !is_there(Command::new("dpkg-deb").arg("--version")) {
        bail!("dpkg-deb is not installed");
    }
    if bins.is_none() {
        steps.run(&mut cargo([
            "build",
            "--release",
            "--workspace",
            "--bins",
            "--locked",
        ]))?;
        // Once more for the flight binary, which has no simulator in it: in one build with the tools the feature is on.
        steps.run(&mut cargo([
            "build",
            "--release",
            "--package",
            "vsm",
            "--bin",
            "vsm",
            "--no-default-features",
            "--locked",
        ]))?;
    }
    let out = option("--out").unwrap_or_else(|| root().join("target/deb"));
    let tree = out.join("tree");
    if tree.exists() {
        fs::remove_dir_all(&tree).context("the old tree")?;
    }
    let programs = bins
        .clone()
        .unwrap_or_else(|| root().join("target/release"));
    lay_out(&tree, &programs)?;
    let beside = programs.join("generate");
    let mut manual = if beside.exists() {
        Command::new(beside)
    } else {
        generate()
    };
    steps.run(manual.arg("man").arg(&tree))?;
    open_to_all(&tree.join("usr/share"))?;
    let architecture = Command::new("dpkg").arg("--print-architecture").output();
    let architecture = architecture.context("dpkg")?.stdout;
    let architecture = String::from_utf8_lossy(&architecture).trim().to_owned();
    let version = env!("CARGO_PKG_VERSION");
    put(
        &tree,
        "DEBIAN/control",
        &control(version, &architecture),
        PLAIN,
    )?;
    let own = "/etc/vsm/vsm.toml\n/etc/vsm/airside.toml\n";
    put(&tree, "DEBIAN/conffiles", own, PLAIN)?;
    let package = out.join(format!("vsm_{version}_{architecture}.deb"));
    let mut pack = Command::new("dpkg-deb");
    pack.args(["--root-owner-group", "--build"]);
    if bins.is_some() {
        pack.arg("-Znone");
    }
    steps.run(pack.arg(&tree).arg(&package))?;
    Ok(package)
}

fn lay_out(tree: &Path, programs: &Path) -> Result<()> {
    for name in PROGRAMS {
        copy(
            &programs.join(name),
            tree,
            &format!("usr/bin/{name}"),
            PROGRAM,
        )?;
    }
    for (from, to) in FILES {
        copy(&root().join(from), tree, to, PLAIN)?;
    }
    Ok(())
}

fn copy(from: &Path, tree: &Path, to: &str, mode: u32) -> Result<()> {
    let target = target(tree, to)?;
    fs::copy(from, &target).with_context(|| from.display().to_string())?;
    set_mode(&target, mode)
}

fn put(tree: &Path, to: &str, text: &str, mode: u32) -> Result<()> {
    let target = target(tree, to)?;
    fs::write(&target, text).with_context(|| target.display().to_string())?;
    set_mode(&target, mode)
}

fn target(tree: &Path, to: &str) -> Result<PathBuf> {
    let target = tree.join(to);
    let folder = target.parent().unwrap_or(tree);
    fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    // Whatever the umask of who builds it.
    let mut within = folder;
    while within.starts_with(tree) {
        set_mode(within, PROGRAM)?;
        within = within.parent().unwrap_or(Path::new("/"));
    }
    Ok(target)
}

/// What is below `folder` can be read by everyone, whatever the umask of who builds it.
fn open_to_all(folder: &Path) -> Result<()> {
    set_mode(folder, PROGRAM)?;
    for entry in fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let path = entry?.path();
        if path.is_dir() {
            open_to_all(&path)?;
        } else {
            set_mode(&path, PLAIN)?;
        }
    }
    Ok(())
}

fn set_mode(path: &Path, mode: u32) -> Result<()> {
    fs::set_permissions(path, fs::Permissions::from_mode(mode))
        .with_context(|| path.display().to_string())
}

fn control(version: &str, architecture: &str) -> String {
    format!(
        "Package: vsm\nVersion: {version}\nArchitecture: {architecture}\nMaintainer: the vsm project <vsm@localhost>\n\
         Depends: libc6\nSection: net\nPriority: optional\n\
         Description: Bridge from STANAG 4586 to PX4 over signed MAVLink 2\n \
         A Vehicle Specific Module: ground stations use the Data Link Interface (Edition 4), and it flies a\n \
         stock PX4. With a simulated PX4, a ground station and a planner of curved routes.\n"
    )
}

const PROGRAMS: [&str; 4] = ["vsm", "cucs", "px4-sim", "curve-plan"];
const FILES: [(&str, &str); 9] = [
    (
        "packaging/vsm.service",
        "usr/lib/systemd/system/vsm.service",
    ),
    (
        "packaging/vsm-airside.service",
        "usr/lib/systemd/system/vsm-airside.service",
    ),
    ("packaging/vsm.toml", "etc/vsm/vsm.toml"),
    ("packaging/airside.toml", "etc/vsm/airside.toml"),
    (
        "packaging/wireshark/stanag4586.lua",
        "usr/share/vsm/stanag4586.lua",
    ),
    ("README.md", "usr/share/doc/vsm/README.md"),
    ("SECURITY.md", "usr/share/doc/vsm/SECURITY.md"),
    ("LICENSE-MIT", "usr/share/doc/vsm/LICENSE-MIT"),
    ("LICENSE-APACHE", "usr/share/doc/vsm/LICENSE-APACHE"),
];
const PLAIN: u32 = 0o644;
const PROGRAM: u32 = 0o755;
