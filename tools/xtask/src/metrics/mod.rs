//! `cargo xtask metrics`: the size and the order of the code as tables in Markdown.
//!
//! Sizes by crate, cycles of modules, test binaries, words that the vocabulary of CONTRIBUTING.md replaces. `--root DIR`
//! measures another checkout, `--edges` lists what makes up each cycle, and `--check` fails where there is one.

mod modules;
mod source;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail};
use serde_json::Value;

use crate::steps::{cargo, option, root};
use modules::Tree;
use source::{Lines, Source};

/// Prints the tables to standard output.
#[expect(clippy::print_stdout, reason = "the tables are the product")]
pub(crate) fn run() -> Result<()> {
    let given = |name: &str| std::env::args().any(|argument| argument == name);
    let root = match option("--root") {
        Some(root) => root
            .canonicalize()
            .with_context(|| root.display().to_string())?,
        None => root(),
    };
    let measured = Measured::of(&root)?;
    println!("{}", measured.tables(&root)?);
    if given("--edges") {
        for cycle in &measured.cycles {
            println!(
                "{}\n",
                cycle
                    .join("\n")
                    .replace(&format!("{}/", root.display()), "")
            );
        }
    }
    if given("--check") {
        measured.refuse_cycles()?;
    }
    Ok(())
}

/// No modules of a crate use each other in a cycle.
pub(crate) fn check() -> Result<()> {
    Measured::of(&root())?.refuse_cycles()
}

/// Product code of a crate, or of all.
#[derive(Default)]
struct Code {
    lines: Lines,
    files: Vec<usize>,
    files_in_cycles: usize,
}

#[derive(Default)]
struct Measured {
    crates: BTreeMap<String, Code>,
    tests: Lines,
    test_files: usize,
    test_binaries: usize,
    cycles: Vec<Vec<String>>,
}

impl Measured {
    fn of(root: &Path) -> Result<Self> {
        let mut measured = Self::default();
        let mut product = BTreeSet::new();
        for package in packages(root)? {
            let manifest =
                PathBuf::from(package["manifest_path"].as_str().context("manifest_path")?);
            let tests = manifest.strip_prefix(root)?.starts_with("tests");
            for target in package["targets"].as_array().context("targets")? {
                let kind = target["kind"][0].as_str().unwrap_or_default();
                measured.test_binaries += usize::from(target["test"] == true);
                if matches!(kind, "lib" | "cdylib" | "bin" | "proc-macro") && !tests {
                    let name = package["name"].as_str().unwrap_or_default();
                    let tree =
                        Tree::read(Path::new(target["src_path"].as_str().context("src_path")?));
                    measured.add(name, tree, &mut product);
                }
            }
        }
        for file in files(root, "*.rs")?
            .into_iter()
            .filter(|file| !product.contains(file))
        {
            let source = Source::read(&fs::read_to_string(&file).unwrap_or_default());
            measured.tests += source.product;
            measured.tests += source.tests;
            measured.test_files += 1;
        }
        Ok(measured)
    }

    fn add(&mut self, name: &str, tree: Tree, product: &mut BTreeSet<PathBuf>) {
        let code = self.crates.entry(name.to_owned()).or_default();
        let cycles = tree.cycles();
        code.files_in_cycles += Tree::files_in_cycles(&cycles);
        for module in tree.modules {
            code.lines += module.source.product;
            code.files.push(module.source.product.all);
            self.tests += module.source.tests;
            product.insert(module.file);
        }
        self.cycles.extend(cycles);
    }

    fn refuse_cycles(&self) -> Result<()> {
        if self.cycles.is_empty() {
            return Ok(());
        }
        bail!("modules use each other in a cycle: `cargo xtask metrics --edges` shows them")
    }

    fn tables(&self, root: &Path) -> Result<String> {
        let mut rows = String::from(
            "| crate | files | median | lines | code | doc comments | `//` | `//` per 100 code | files in cycles |\n\
             |---|---|---|---|---|---|---|---|---|\n",
        );
        let mut all = Code::default();
        for (name, code) in &self.crates {
            rows += &row(name, code);
            if name != "xtask" {
                all.lines += code.lines;
                all.files.extend(&code.files);
                all.files_in_cycles += code.files_in_cycles;
            }
        }
        rows += &row("**product** (all but xtask)", &all);
        let (written, generated) = pages(root)?;
        rows += &format!(
            "\n| | |\n|---|---|\n| tests, benches and their kit: files, lines, code | {}, {}, {} |\n\
             | test binaries | {} |\n| documents: lines written, generated | {written}, {generated} |\n\
             | cycles of modules | {} |\n",
            self.test_files,
            self.tests.all,
            self.tests.code,
            self.test_binaries,
            self.cycles.len(),
        );
        rows += "\n| word replaced | .rs | .md |\n|---|---|---|\n";
        let (code, text) = (words(root, "*.rs")?, words(root, "*.md")?);
        for (index, word) in WORDS.iter().enumerate() {
            rows += &format!(
                "| {} | {} | {} |\n",
                word.join(", "),
                code[index],
                text[index]
            );
        }
        Ok(rows)
    }
}

fn row(name: &str, code: &Code) -> String {
    let mut files = code.files.clone();
    files.sort_unstable();
    let median = files.get(files.len() / 2).copied().unwrap_or_default();
    let Lines {
        all,
        code: lines,
        comment,
        doc,
    } = code.lines;
    let tenths = 1_000 * comment / lines.max(1);
    format!(
        "| {name} | {} | {median} | {all} | {lines} | {doc} | {comment} | {}.{} | {} |\n",
        files.len(),
        tenths / 10,
        tenths % 10,
        code.files_in_cycles,
    )
}

/// The code of a crate, from its root file, without what only tests see.
pub(crate) fn product_code(src_path: &Path) -> String {
    let modules = Tree::read(src_path).modules;
    modules
        .into_iter()
        .map(|module| module.source.code)
        .collect()
}

/// The packages of the workspace.
pub(crate) fn packages(root: &Path) -> Result<Vec<Value>> {
    let output = cargo(["metadata", "--format-version", "1", "--no-deps"])
        .current_dir(root)
        .output()
        .context("cargo metadata")?;
    let metadata: Value = serde_json::from_slice(&output.stdout).context("cargo metadata")?;
    let packages = metadata["packages"].as_array().context("no packages")?;
    Ok(packages.clone())
}

/// The files that git knows or would add.
pub(crate) fn files(root: &Path, pattern: &str) -> Result<Vec<PathBuf>> {
    let list = [
        "ls-files",
        "--cached",
        "--others",
        "--exclude-standard",
        pattern,
    ];
    let output = Command::new("git")
        .current_dir(root)
        .args(list)
        .output()
        .context("git")?;
    let listed = String::from_utf8_lossy(&output.stdout).into_owned();
    Ok(listed
        .lines()
        .map(|file| root.join(file))
        .filter(|file| file.exists())
        .collect())
}

/// Lines of documents: written by hand, and generated.
fn pages(root: &Path) -> Result<(usize, usize)> {
    let (mut written, mut generated) = (0, 0);
    for file in files(root, "*.md")? {
        let text = fs::read_to_string(&file).unwrap_or_default();
        let made = text
            .lines()
            .take(5)
            .any(|line| line.contains("Generated by"));
        *(if made { &mut generated } else { &mut written }) += text.lines().count();
    }
    Ok((written, generated))
}

/// How often each of [`WORDS`] stands in the files, in names and in sentences.
fn words(root: &Path, pattern: &str) -> Result<Vec<usize>> {
    let mut counts = vec![0; WORDS.len()];
    for file in files(root, pattern)? {
        // These two list the words.
        if file.ends_with("CONTRIBUTING.md") || file.ends_with("metrics/mod.rs") {
            continue;
        }
        let text = fs::read_to_string(&file).unwrap_or_default();
        let mut spaced = String::with_capacity(text.len() * 2);
        for c in text.chars() {
            if c.is_uppercase() || !c.is_alphabetic() {
                spaced.push(' ');
            }
            if c.is_alphabetic() {
                spaced.extend(c.to_lowercase());
            }
        }
        let parts: Vec<&str> = spaced.split_whitespace().collect();
        for (count, forms) in counts.iter_mut().zip(WORDS) {
            for form in *forms {
                let form: Vec<&str> = form.split(' ').collect();
                *count += parts
                    .windows(form.len())
                    .filter(|window| *window == form)
                    .count();
            }
        }
    }
    Ok(counts)
}

/// Words of the project's first years that plain English replaces, each in its forms.
const WORDS: &[&[&str]] = &[
    &["octet", "octets"],
    &["heed", "heeds", "heeded", "unheeded", "heeding"],
    &["told"],
    &["tell", "tells", "telling"],
    &["say", "says", "said"],
    &["hear", "hears", "heard", "unheard"],
    &["anew"],
    &["aloud"],
    &["stray", "strays"],
    &["foretell", "foretold", "foretells"],
    &["by and by"],
    &["go on", "goes on", "gone on", "going on", "went on"],
    &["come to", "comes to", "came to"],
    &["desk"],
    &["custody"],
    &["passage", "passages"],
    &["recall", "recalls"],
    &["journal"],
    &["settling"],
    &["handing"],
    &["ailment", "ailments"],
    &["inquiry"],
    &["talkers"],
    &["no more"],
    &["any more"],
];
