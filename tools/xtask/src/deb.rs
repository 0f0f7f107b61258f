//! `cargo xtask deb`: programs, units, configuration and documents as a Debian package, by `dpkg-deb`.
//!
//! `lintian` has nothing to say against it: programs without symbols, manual pages and changelog compressed, a copyright file
//! that a machine can read, checksums of all files.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail};

use crate::sbom;
use crate::steps::{FLIGHT, Steps, cargo, generate, is_there, option, root};

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
            "--profile",
            FLIGHT,
            "--package",
            "vsm",
            "--bin",
            "vsm",
            "--no-default-features",
            "--features",
            "klv",
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
    let flight = bins
        .clone()
        .unwrap_or_else(|| root().join("target").join(FLIGHT));
    lay_out(&tree, &programs, &flight)?;
    let beside = programs.join("generate");
    let mut manual = if beside.exists() {
        Command::new(beside)
    } else {
        generate()
    };
    steps.run(manual.arg("man").arg(&tree).args(PROGRAMS))?;
    let own = architecture()?;
    let architecture =
        option("--architecture").map_or_else(|| own.clone(), |path| path.display().to_string());
    if architecture == own {
        strip(steps, &tree)?;
    }
    documents(steps, &tree)?;
    open_to_all(&tree.join("usr/share"))?;
    let version = env!("CARGO_PKG_VERSION");
    put(
        &tree,
        "DEBIAN/control",
        &control(version, &architecture, installed_kib(&tree.join("usr"))?),
        PLAIN,
    )?;
    let own = "/etc/vsm/vsm.toml\n/etc/vsm/airside.toml\n";
    put(&tree, "DEBIAN/conffiles", own, PLAIN)?;
    put(&tree, "DEBIAN/md5sums", &md5sums(&tree)?, PLAIN)?;
    let package = out.join(format!("vsm_{version}_{architecture}.deb"));
    let mut pack = Command::new("dpkg-deb");
    pack.args(["--root-owner-group", "--build"]);
    if bins.is_some() {
        pack.arg("-Znone");
    }
    steps.run(pack.arg(&tree).arg(&package))?;
    if !is_there(Command::new("lintian").arg("--version")) {
        steps.leave_out("lintian is not installed: the package is not checked");
    } else if bins.is_none() {
        let mut lintian = Command::new("lintian");
        steps.run(lintian.args(["--fail-on", "error,warning"]).arg(&package))?;
    }
    Ok(package)
}

/// The name that Debian has for this machine's processor.
fn architecture() -> Result<String> {
    let output = Command::new("dpkg").arg("--print-architecture").output();
    let printed = output.context("dpkg")?.stdout;
    Ok(String::from_utf8_lossy(&printed).trim().to_owned())
}

/// Takes the symbols off the packed programs; those that were built keep theirs.
fn strip(steps: &mut Steps, tree: &Path) -> Result<()> {
    let mut strip = Command::new("strip");
    strip.args([
        "--strip-all",
        "--remove-section=.comment",
        "--remove-section=.note",
    ]);
    for name in PROGRAMS {
        strip.arg(tree.join("usr/bin").join(name));
    }
    steps.run(&mut strip)
}

/// All documents with their pictures, as they lie in the repository, so that the links between them hold; what the programs
/// are made of; changelog and manual pages, compressed.
fn documents(steps: &mut Steps, tree: &Path) -> Result<()> {
    for folder in ["docs", "examples"] {
        copy_tree(&root().join(folder), tree, &format!("{DOCUMENTS}/{folder}"))?;
    }
    let list = tree.join(DOCUMENTS).join("vsm.cdx.json");
    steps.step("what the flight binary is made of", || {
        sbom::write_to(&list)
    })?;
    let licence = fs::read_to_string(root().join("LICENSE-MIT"))?;
    put(
        tree,
        &format!("{DOCUMENTS}/copyright"),
        &copyright(&licence),
        PLAIN,
    )?;
    put(
        tree,
        &format!("{DOCUMENTS}/changelog"),
        &changelog(&date()?),
        PLAIN,
    )?;
    let mut gzip = Command::new("gzip");
    gzip.args(["-9", "-n", "--recursive"])
        .arg(tree.join("usr/share/man/man1"));
    steps.run(gzip.arg(tree.join(DOCUMENTS).join("changelog")))
}

/// The files of a folder that are in the index: neither keys nor states of whoever tried the examples.
fn copy_tree(from: &Path, tree: &Path, to: &str) -> Result<()> {
    let output = Command::new("git")
        .args(["ls-files", "-z", "."])
        .current_dir(from)
        .output();
    let list = output.context("git ls-files")?;
    if !list.status.success() {
        bail!(
            "git ls-files in {}: {}",
            from.display(),
            String::from_utf8_lossy(&list.stderr)
        );
    }
    let names = String::from_utf8_lossy(&list.stdout).into_owned();
    for name in names.split_terminator('\0') {
        copy(&from.join(name), tree, &format!("{to}/{name}"), PLAIN)?;
    }
    Ok(())
}

/// The moment of the last commit, as a changelog writes it: the same source gives the same package.
fn date() -> Result<String> {
    let output = Command::new("git")
        .args(["log", "-1", "--format=%cD"])
        .current_dir(root())
        .output();
    let printed = output.context("git log")?.stdout;
    Ok(String::from_utf8_lossy(&printed).trim().to_owned())
}

fn changelog(date: &str) -> String {
    format!(
        "vsm ({}) unstable; urgency=medium\n\n  * The changes are in CHANGELOG.md beside this file.\n\n -- {MAINTAINER}  {date}\n",
        env!("CARGO_PKG_VERSION"),
    )
}

/// As <https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/> has it.
fn copyright(mit: &str) -> String {
    let mit: String = mit
        .lines()
        .map(|line| {
            if line.is_empty() {
                " .\n".to_owned()
            } else {
                format!(" {line}\n")
            }
        })
        .collect();
    format!(
        "Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/\nUpstream-Name: vsm\n\
         Comment: The libraries that are linked into the programs, each with version and licence, are in vsm.cdx.json.\n\n\
         Files: *\nCopyright: the vsm project\nLicense: Expat or Apache-2.0\n\n\
         License: Expat\n{mit}\n\
         License: Apache-2.0\n On Debian systems the text is in /usr/share/common-licenses/Apache-2.0.\n"
    )
}

/// Every packed file but the configuration, as `md5sum` prints it.
fn md5sums(tree: &Path) -> Result<String> {
    let output = Command::new("sh")
        .args([
            "-c",
            "find usr -type f -print0 | LC_ALL=C sort -z | xargs -0 md5sum",
        ])
        .current_dir(tree)
        .output();
    Ok(String::from_utf8(output.context("md5sum")?.stdout)?)
}

fn installed_kib(folder: &Path) -> Result<u64> {
    let mut bytes = 0;
    for entry in fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let entry = entry?;
        bytes += if entry.path().is_dir() {
            installed_kib(&entry.path())? * 1024
        } else {
            entry.metadata()?.len()
        };
    }
    Ok(bytes.div_ceil(1024))
}

/// `flight` is the folder of the flight binary, `programs` that of the others.
fn lay_out(tree: &Path, programs: &Path, flight: &Path) -> Result<()> {
    for name in PROGRAMS {
        let folder = if name == "vsm" { flight } else { programs };
        copy(
            &folder.join(name),
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

fn control(version: &str, architecture: &str, kib: u64) -> String {
    format!(
        "Package: vsm\nVersion: {version}\nArchitecture: {architecture}\nMaintainer: {MAINTAINER}\nInstalled-Size: {kib}\n\
         Depends: libc6, libgcc-s1\nSection: net\nPriority: optional\n\
         Description: Bridge from STANAG 4586 to PX4 over signed MAVLink 2\n \
         A Vehicle Specific Module: ground stations use the Data Link Interface, and\n \
         it flies a stock PX4. With a simulated PX4, a ground station and a planner\n \
         of curved routes.\n"
    )
}

const PROGRAMS: [&str; 4] = ["vsm", "cucs", "px4-sim", "curve-plan"];
const FILES: [(&str, &str); 10] = [
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
    ("CHANGELOG.md", "usr/share/doc/vsm/CHANGELOG.md"),
    ("ARCHITECTURE.md", "usr/share/doc/vsm/ARCHITECTURE.md"),
    ("CONTRIBUTING.md", "usr/share/doc/vsm/CONTRIBUTING.md"),
];
const DOCUMENTS: &str = "usr/share/doc/vsm";
/// Nobody receives mail there: the project has no address of its own.
const MAINTAINER: &str = "vsm project <vsm@packages.invalid>";
const PLAIN: u32 = 0o644;
const PROGRAM: u32 = 0o755;
