//! `generate`: the files that are made from the code by running it. It links the whole workspace, so it is a program of its own, and
//! `cargo xtask gen`, `man` and `deb` start it.
//!
//!     generate files [--check]    tables, references and the Wireshark dissector, checked in for readers without a build
//!     generate man TREE [PROGRAM...]
//!                                 manual pages and shell completions, below TREE as below the root of a file system

#![expect(clippy::print_stderr, reason = "a program for people to read")]

mod dissector;
mod man;
mod map;
mod reference;
mod support;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, anyhow, ensure};

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let root = source_root();
    let result = match arguments[..] {
        ["files"] => run(root, false),
        ["files", "--check"] => run(root, true),
        ["man", tree, ref programs @ ..] => man::write(Path::new(tree), programs),
        _ => Err(anyhow!(
            "usage: generate files [--check] | man TREE [PROGRAM...]"
        )),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("generate: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// Writes the generated files, or with `check` only reports which are stale.
///
/// # Errors
/// A file cannot be read or written; or, with `check`, some are stale.
fn run(root: &Path, check: bool) -> Result<()> {
    let outputs = outputs()?;
    let obsolete = obsolete(root, &outputs)?;
    let stale = |path: &Path, text: &str| {
        fs::read_to_string(root.join(path)).map_or(true, |found| found != text)
    };
    let stale: Vec<_> = outputs
        .iter()
        .filter(|(path, text)| stale(path, text))
        .collect();
    if check {
        let paths = stale.iter().map(|(path, _)| *path).chain(&obsolete);
        let list: Vec<String> = paths
            .map(|path| format!("\n  {}", path.display()))
            .collect();
        ensure!(
            list.is_empty(),
            "stale, run `cargo xtask gen` and commit:{}",
            list.concat()
        );
        return Ok(());
    }
    for (path, text) in stale {
        let file = root.join(path);
        file.parent()
            .map_or(Ok(()), fs::create_dir_all)
            .and_then(|()| fs::write(&file, text))
            .with_context(|| file.display().to_string())?;
    }
    for path in obsolete {
        fs::remove_file(root.join(&path)).with_context(|| path.display().to_string())?;
    }
    Ok(())
}

/// Every generated file: its path from the root of the repository, and its text.
fn outputs() -> Result<BTreeMap<PathBuf, String>> {
    let mut outputs = BTreeMap::from(
        [
            ("packaging/wireshark/stanag4586.lua", dissector::script()),
            (
                "docs/reference/support.md",
                support::markdown(reference::place),
            ),
            (
                "docs/reference/configuration.md",
                vsm::config::reference::markdown(),
            ),
            ("docs/reference/files.md", map::markdown(source_root())?),
        ]
        .map(|(path, text)| (PathBuf::from(path), text)),
    );
    let pages = reference::pages().into_iter();
    outputs.extend(pages.map(|(name, text)| (Path::new(REFERENCE).join(name), text)));
    Ok(outputs)
}

/// The root of the repository that this program was built from.
fn source_root() -> &'static Path {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    own.ancestors().nth(2).unwrap_or(own)
}

/// Pages of the reference that are no longer generated, such as those of a renamed group.
fn obsolete(root: &Path, outputs: &BTreeMap<PathBuf, String>) -> Result<Vec<PathBuf>> {
    let folder = root.join(REFERENCE);
    if !folder.exists() {
        return Ok(Vec::new());
    }
    let mut paths = Vec::new();
    for entry in fs::read_dir(&folder).with_context(|| folder.display().to_string())? {
        paths.push(Path::new(REFERENCE).join(entry?.file_name()));
    }
    paths.retain(|path| !outputs.contains_key(path));
    Ok(paths)
}

const REFERENCE: &str = "docs/reference/dli";

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("vsm-gen-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        folder
    }

    #[test]
    fn generated_files_are_current_until_changed() {
        let root = folder("stale");
        run(&root, false).unwrap();
        run(&root, true).unwrap();
        let page = root.join("docs/reference/support.md");
        let text = fs::read_to_string(&page).unwrap();
        fs::write(&page, text.replacen("honoured", "ignored", 1)).unwrap();
        let fault = run(&root, true).unwrap_err().to_string();
        assert!(fault.ends_with("\n  docs/reference/support.md"), "{fault}");
        run(&root, false).unwrap();
        fs::write(root.join("docs/reference/dli/gone.md"), "").unwrap();
        assert!(run(&root, true).is_err());
        run(&root, false).unwrap();
        run(&root, true).unwrap();
        fs::remove_dir_all(&root).unwrap();
    }
}
