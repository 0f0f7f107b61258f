//! Which file of a crate uses which other one, and the cycles among them.
//!
//! Found from `use` declarations and from paths in the code, by names: a path is followed from module to module, and
//! through `use` and `pub use` to the file that defines what it ends with. Not seen: methods that are called on a value
//! whose type is never named, names that macros make, `#[path]`. A parent that only re-exports from its child does not
//! use it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use super::source::Source;

/// The modules of one crate that are files; the first is its root.
pub(super) struct Tree {
    pub(super) modules: Vec<Module>,
}

pub(super) struct Module {
    pub(super) file: PathBuf,
    pub(super) source: Source,
    path: Vec<String>,
    children: BTreeMap<String, usize>,
    /// What `use` declares here: the name, and the path from the crate's root, if it is one of this crate.
    names: BTreeMap<String, Option<Vec<String>>>,
    globs: Vec<Vec<String>>,
    defined: BTreeSet<String>,
    used: Vec<Vec<String>>,
}

impl Tree {
    /// Reads a crate from its root file on, and leaves out what only tests see.
    pub(super) fn read(root: &Path) -> Self {
        let mut tree = Self {
            modules: Vec::new(),
        };
        let folder = root.parent().unwrap_or(root).to_owned();
        tree.add(root, &folder, Vec::new());
        for index in 0..tree.modules.len() {
            let module = &tree.modules[index];
            let found = references(module);
            let module = &mut tree.modules[index];
            (module.names, module.globs, module.used) = found;
        }
        tree
    }

    fn add(&mut self, file: &Path, folder: &Path, path: Vec<String>) -> usize {
        let source = Source::read(&fs::read_to_string(file).unwrap_or_default());
        let tokens = tokens(&source.code);
        let after = |words: &[&str]| -> Vec<String> {
            let pairs = tokens.windows(2).filter(|pair| words.contains(&pair[0]));
            pairs.map(|pair| pair[1].to_owned()).collect()
        };
        let declared: Vec<String> = tokens
            .windows(3)
            .filter(|three| three[0] == "mod" && three[2] == ";")
            .map(|three| three[1].to_owned())
            .filter(|name| !source.test_modules.contains(name))
            .collect();
        let defined = after(&[
            "struct", "enum", "fn", "trait", "type", "const", "static", "mod", "union",
        ]);
        let index = self.modules.len();
        self.modules.push(Module {
            file: file.to_owned(),
            defined: defined
                .into_iter()
                .filter(|name| !declared.contains(name))
                .collect(),
            source,
            path: path.clone(),
            children: BTreeMap::new(),
            names: BTreeMap::new(),
            globs: Vec::new(),
            used: Vec::new(),
        });
        for name in declared {
            let own = folder.join(&name);
            let flat = own.with_extension("rs");
            let file = if flat.exists() {
                flat
            } else {
                own.join("mod.rs")
            };
            if file.exists() {
                let path = path.iter().chain([&name]).cloned().collect();
                let child = self.add(&file, &own, path);
                self.modules[index].children.insert(name, child);
            }
        }
        index
    }

    /// The file that defines what a path from the crate's root names; none for a module itself.
    fn resolve(&self, path: &[String], depth: usize) -> Option<usize> {
        let mut at = 0;
        for (index, name) in path.iter().enumerate() {
            let module = &self.modules[at];
            if let Some(child) = module.children.get(name) {
                at = *child;
                continue;
            }
            if module.defined.contains(name) || depth == 0 {
                return Some(at);
            }
            let onwards = |to: &[String]| -> Option<usize> {
                let path: Vec<String> = to.iter().chain(&path[index + 1..]).cloned().collect();
                self.resolve(&path, depth - 1)
            };
            if let Some(to) = module.names.get(name) {
                return to.as_deref().and_then(onwards);
            }
            for glob in &module.globs {
                let to: Vec<String> = glob.iter().chain([name]).cloned().collect();
                if let Some(module) = self.resolve(&to, depth - 1)
                    && self.modules[module].defined.contains(name)
                {
                    return onwards(&to);
                }
            }
            return Some(at);
        }
        None
    }

    /// The files that a file uses, each with the names it uses of it.
    fn edges(&self, from: usize) -> BTreeMap<usize, BTreeSet<String>> {
        let mut edges: BTreeMap<usize, BTreeSet<String>> = BTreeMap::new();
        for path in &self.modules[from].used {
            if let Some(to) = self.resolve(path, 8).filter(|to| *to != from) {
                let last = self.modules[to]
                    .path
                    .len()
                    .min(path.len().saturating_sub(1));
                let name = path.get(last..).unwrap_or_default().join("::");
                edges.entry(to).or_default().insert(name);
            }
        }
        edges
    }

    /// The groups of files that use each other in a cycle, as lines `file -> file: names`.
    pub(super) fn cycles(&self) -> Vec<Vec<String>> {
        let edges: Vec<_> = (0..self.modules.len())
            .map(|from| self.edges(from))
            .collect();
        let reach: Vec<BTreeSet<usize>> = (0..edges.len())
            .map(|from| {
                let mut seen = BTreeSet::new();
                let mut next = vec![from];
                while let Some(at) = next.pop() {
                    next.extend(edges[at].keys().filter(|to| seen.insert(**to)));
                }
                seen
            })
            .collect();
        let mut left: BTreeSet<usize> =
            (0..edges.len()).filter(|n| reach[*n].contains(n)).collect();
        let mut cycles = Vec::new();
        while let Some(first) = left.pop_first() {
            let mut group: BTreeSet<usize> = left
                .iter()
                .copied()
                .filter(|n| reach[first].contains(n) && reach[*n].contains(&first))
                .collect();
            left.retain(|n| !group.contains(n));
            group.insert(first);
            let mut lines = Vec::new();
            for from in &group {
                for (to, names) in edges[*from].iter().filter(|(to, _)| group.contains(to)) {
                    let names: Vec<&str> = names.iter().map(String::as_str).collect();
                    let (from, to) = (&self.modules[*from].file, &self.modules[*to].file);
                    lines.push(format!(
                        "{} -> {}: {}",
                        from.display(),
                        to.display(),
                        names.join(", ")
                    ));
                }
            }
            cycles.push(lines);
        }
        cycles
    }

    /// How many files are in some cycle.
    pub(super) fn files_in_cycles(cycles: &[Vec<String>]) -> usize {
        let files = cycles
            .iter()
            .flatten()
            .filter_map(|line| line.split(" -> ").next());
        files.collect::<BTreeSet<_>>().len()
    }
}

type References = (
    BTreeMap<String, Option<Vec<String>>>,
    Vec<Vec<String>>,
    Vec<Vec<String>>,
);

/// What a file's `use` declarations name, its globs, and all the paths that it uses.
fn references(module: &Module) -> References {
    let tokens = tokens(&module.source.code);
    let (mut imports, mut paths, mut bare) = (Vec::new(), Vec::new(), BTreeSet::new());
    // Depths of the braces within which an inline module stands: `super` begins there with the file itself.
    let (mut depth, mut inline) = (0_usize, Vec::new());
    let mut at = 0;
    while at < tokens.len() {
        match tokens[at] {
            "use" => {
                let public = at > 0 && matches!(tokens[at - 1], "pub" | ")");
                let mut found = Vec::new();
                at = use_tree(&tokens, at + 1, &[], &mut found);
                imports.extend(
                    found
                        .into_iter()
                        .map(|(path, name)| (path, name, public, inline.len())),
                );
                continue;
            }
            "mod" if tokens.get(at + 2) == Some(&"{") => inline.push(depth),
            "{" => depth += 1,
            "}" => {
                depth = depth.saturating_sub(1);
                inline.pop_if(|outer| *outer == depth);
            }
            name if is_name(name) => {
                let mut path = vec![name.to_owned()];
                while tokens.get(at + 1) == Some(&"::")
                    && tokens.get(at + 2).is_some_and(|t| is_name(t))
                {
                    path.push(tokens[at + 2].to_owned());
                    at += 2;
                }
                bare.insert(path[0].clone());
                if path.len() > 1 {
                    paths.push((path, inline.len()));
                }
            }
            _ => {}
        }
        at += 1;
    }
    let mut names: BTreeMap<String, Option<Vec<String>>> = BTreeMap::new();
    let (mut globs, mut used) = (Vec::new(), Vec::new());
    for (path, name, public, inline) in imports {
        let path = absolute(module, &names, &path, inline);
        if name == "*" {
            globs.extend(path);
            continue;
        }
        // A re-export alone is no use.
        if let Some(path) = path.as_ref().filter(|_| !public || bare.contains(&name)) {
            used.push(path.clone());
        }
        names.insert(name, path);
    }
    used.extend(
        paths
            .iter()
            .filter_map(|(path, inline)| absolute(module, &names, path, *inline)),
    );
    (names, globs, used)
}

/// A path from the crate's root; none for other crates' paths.
fn absolute(
    module: &Module,
    names: &BTreeMap<String, Option<Vec<String>>>,
    path: &[String],
    inline: usize,
) -> Option<Vec<String>> {
    let first = path.first()?;
    let supers = path.iter().take_while(|part| *part == "super").count();
    let (base, rest): (&[String], _) = match first.as_str() {
        "crate" => (&[], &path[1..]),
        "self" => (&module.path, &path[1..]),
        "super" => {
            let up = supers.saturating_sub(inline);
            (
                module.path.get(..module.path.len().checked_sub(up)?)?,
                &path[supers..],
            )
        }
        name if module.children.contains_key(name) => (&module.path, path),
        name => (names.get(name)?.as_deref()?, &path[1..]),
    };
    Some(base.iter().chain(rest).cloned().collect())
}

/// Reads one tree of a `use` from `at`, and returns where it ends.
fn use_tree(
    tokens: &[&str],
    mut at: usize,
    base: &[String],
    found: &mut Vec<(Vec<String>, String)>,
) -> usize {
    let mut path = base.to_vec();
    while let Some(token) = tokens.get(at) {
        match *token {
            "{" => {
                at += 1;
                while tokens.get(at).is_some_and(|token| *token != "}") {
                    at = use_tree(tokens, at, &path, found);
                    at += usize::from(tokens.get(at) == Some(&","));
                }
                return at + 1;
            }
            "*" => {
                found.push((path, "*".to_owned()));
                return at + 1;
            }
            "as" => {
                let name = tokens.get(at + 1).copied().unwrap_or("_");
                found.push((path, name.to_owned()));
                return at + 2;
            }
            "self" if path.len() > base.len() || !base.is_empty() => {}
            "::" => {}
            name if is_name(name) => path.push(name.to_owned()),
            _ => break,
        }
        at += 1;
    }
    if let Some(name) = path.last().cloned() {
        found.push((path, name));
    }
    at
}

fn is_name(token: &str) -> bool {
    token.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
}

fn tokens(code: &str) -> Vec<&str> {
    let mut found = Vec::new();
    let mut rest = code.trim_start();
    while let Some(first) = rest.chars().next() {
        let length = if first.is_ascii_alphanumeric() || first == '_' {
            rest.find(|c: char| !c.is_ascii_alphanumeric() && c != '_')
                .unwrap_or(rest.len())
        } else if rest.starts_with("::") {
            2
        } else {
            1
        };
        found.push(&rest[..length]);
        rest = rest[length..].trim_start();
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cycles_of(name: &str, files: &[(&str, &str)]) -> Vec<Vec<String>> {
        let folder =
            std::env::temp_dir().join(format!("vsm-metrics-{name}-{}", std::process::id()));
        for (file, text) in files {
            let path = folder.join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        let cycles = Tree::read(&folder.join("lib.rs")).cycles();
        fs::remove_dir_all(&folder).unwrap();
        cycles
    }

    #[test]
    fn a_cycle_is_found_through_a_re_export() {
        let lib = ("lib.rs", "mod a;\nmod b;\npub use b::B;\n");
        let a = ("a.rs", "use crate::B;\npub struct A(B);\n");
        let b = ("b/mod.rs", "mod c;\npub use c::B;\n");
        let c = (
            "b/c.rs",
            "pub struct B;\nimpl B { fn f() { crate::a::A::g() } }\n",
        );
        let found = cycles_of("cycle", &[lib, a, b, c]);
        assert_eq!(found.len(), 1);
        assert_eq!(Tree::files_in_cycles(&found), 2, "{found:?}");
    }

    #[test]
    fn a_parent_that_re_exports_and_a_test_that_looks_back_make_no_cycle() {
        let lib = (
            "lib.rs",
            "mod a;\nmod b;\npub use self::{a::A, b::{self, B}};\n",
        );
        let a = ("a.rs", "use super::B;\npub struct A(B);\n");
        let b = (
            "b.rs",
            "pub struct B;\n#[cfg(test)]\nmod tests { use crate::a::A; }\n",
        );
        assert!(cycles_of("none", &[lib, a, b]).is_empty());
    }
}
