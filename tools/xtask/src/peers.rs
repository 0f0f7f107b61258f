//! Other people's programs that tests talk to: Python packages, pinned, in an environment of their own.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail};

use crate::steps::{Steps, is_there, root};

/// Makes `tests/interop/.venv` with the pinned packages, unless it is there already, and installs the project's own package
/// as it is now.
pub(crate) fn install(steps: &mut Steps) -> Result<PathBuf> {
    let python = environment(steps)?;
    let mut own = Command::new(&python);
    // Without isolation: what builds it is among the pinned packages, so that no index is needed but for those.
    own.args([
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
    ])
    .args(["--no-build-isolation", "--no-deps", "bindings/python"])
    // pip looks for the build's tools by name.
    .env("PATH", path_with(&python)?)
    // The crates are small; nothing is gained by the optimisations of the programs, which take minutes.
    .env("CARGO_PROFILE_RELEASE_LTO", "off")
    .env("CARGO_PROFILE_RELEASE_CODEGEN_UNITS", "16");
    steps
        .run(&mut own)
        .context("the Python package of bindings/python could not be built")?;
    Ok(python)
}

/// The search path with the environment's programs first.
fn path_with(python: &Path) -> Result<OsString> {
    let programs = python.parent().map(Path::to_owned).into_iter();
    let path = std::env::var_os("PATH").unwrap_or_default();
    Ok(std::env::join_paths(
        programs.chain(std::env::split_paths(&path)),
    )?)
}

fn environment(steps: &mut Steps) -> Result<PathBuf> {
    let interop = root().join("tests/interop");
    let environment = interop.join(".venv");
    let python = environment.join("bin/python");
    let mut wanted = String::new();
    for (file, _) in LISTS {
        let list = fs::read_to_string(root().join(file)).context(file)?;
        wanted.push_str(&list);
    }
    // Written last, so that an environment broken off half-way is made again.
    let mark = environment.join("installed.txt");
    let installed = fs::read_to_string(&mark).unwrap_or_default();
    if installed == wanted && is_there(Command::new(&python).arg("--version")) {
        return Ok(python);
    }

    let system = find_python()?;
    if environment.exists() {
        fs::remove_dir_all(&environment).context("the old tests/interop/.venv")?;
    }
    steps.run(Command::new(system).args(["-m", "venv", "tests/interop/.venv"]))?;
    for (file, how) in LISTS {
        let mut install = Command::new(&python);
        install.args(["-m", "pip", "install", "--quiet"]);
        install.arg("--disable-pip-version-check").args(how);
        steps
            .run(install.args(["--requirement", file]))
            .context("the Python peers could not be installed: pip needs its package index once")?;
    }
    fs::write(&mark, wanted).context("tests/interop/.venv/installed.txt")?;
    Ok(python)
}

/// Lists of packages, and how each is installed.
const LISTS: [(&str, &[&str]); 2] = [
    ("tests/interop/requirements.txt", &[]),
    ("tests/interop/requirements-alone.txt", &["--no-deps"]),
];

/// A Python that is new enough for the reference codec (tomllib).
fn find_python() -> Result<&'static str> {
    let new_enough = "import sys, tomllib, venv, ensurepip; assert sys.version_info >= (3, 11)";
    for name in ["python3", "python3.13", "python3.12", "python3.11"] {
        if is_there(Command::new(name).args(["-c", new_enough])) {
            return Ok(name);
        }
    }
    bail!("no Python 3.11 or newer with venv was found; the interoperability tests need one");
}
