//! `generate`: what is made from the code by running it. It links the whole workspace, so it is a program of its own, and
//! `cargo xtask gen`, `man` and `deb` start it.
//!
//!     generate files [--check]    tables, references and the Wireshark dissector, checked in for readers without a build
//!     generate man TREE           manual pages and shell completions, below TREE as below the root of a file system

#![expect(clippy::print_stderr, reason = "a program for people to read")]

mod dissector;
mod lua;
mod man;
mod reference;
mod support;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, anyhow, bail};

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    let root = own.ancestors().nth(2).unwrap_or(own);
    let result = match arguments[..] {
        ["files"] => run(root, false),
        ["files", "--check"] => run(root, true),
        ["man", tree] => man::write(Path::new(tree)),
        _ => Err(anyhow!("usage: generate files [--check] | man TREE")),
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
    let made = outputs();
    let stale: Vec<&Output> = made
        .iter()
        .filter(|output| !output.is_current(root))
        .collect();
    let leftovers = leftovers(root, &made)?;
    if check {
        if stale.is_empty() && leftovers.is_empty() {
            return Ok(());
        }
        let names = stale.iter().map(|output| output.path.display().to_string());
        let leftovers = leftovers.iter().map(|path| path.display().to_string());
        let list: Vec<String> = names.chain(leftovers).collect();
        bail!(
            "stale, run `cargo xtask gen` and commit:\n  {}",
            list.join("\n  ")
        );
    }
    for output in stale {
        output.write(root)?;
    }
    for leftover in leftovers {
        fs::remove_file(root.join(&leftover)).with_context(|| leftover.display().to_string())?;
    }
    Ok(())
}

/// A generated file.
struct Output {
    /// From the root of the repository.
    path: PathBuf,
    text: String,
}

impl Output {
    fn new(path: impl Into<PathBuf>, text: String) -> Output {
        Output {
            path: path.into(),
            text,
        }
    }

    fn is_current(&self, root: &Path) -> bool {
        fs::read_to_string(root.join(&self.path)).is_ok_and(|found| found == self.text)
    }

    fn write(&self, root: &Path) -> Result<()> {
        let path = root.join(&self.path);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
        }
        fs::write(&path, &self.text).with_context(|| path.display().to_string())
    }
}

fn outputs() -> Vec<Output> {
    let mut made = vec![
        Output::new("packaging/wireshark/stanag4586.lua", dissector::script()),
        Output::new("docs/reference/support.md", support::markdown()),
        Output::new(
            "docs/reference/configuration.md",
            vsm::config::reference::markdown(),
        ),
    ];
    made.extend(
        reference::pages()
            .into_iter()
            .map(|(name, text)| Output::new(Path::new(REFERENCE).join(name), text)),
    );
    made
}

/// Pages of groups that no longer exist.
fn leftovers(root: &Path, made: &[Output]) -> Result<Vec<PathBuf>> {
    let folder = root.join(REFERENCE);
    if !folder.exists() {
        return Ok(Vec::new());
    }
    let mut leftovers = Vec::new();
    for entry in fs::read_dir(&folder).with_context(|| folder.display().to_string())? {
        let path = Path::new(REFERENCE).join(entry?.file_name());
        if made.iter().all(|output| output.path != path) {
            leftovers.push(path);
        }
    }
    Ok(leftovers)
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
    fn what_was_made_is_current_and_what_was_changed_is_not() {
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
