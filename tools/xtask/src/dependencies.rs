//! Dependencies that are declared and not used: what cargo-machete finds, without having to install it.
//!
//! A dependency counts as used where its name stands in the code of its package; a dev-dependency also in tests, benches,
//! examples and documentation. One that is there only for its features is listed under
//! `package.metadata.cargo-machete.ignored`, as for cargo-machete.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result, bail};
use serde_json::Value;

use crate::metrics::{files, packages, product_code};
use crate::steps::root;

/// Every dependency of every package, and every one of the workspace, is used.
pub(crate) fn check() -> Result<()> {
    let mut unused = Vec::new();
    let mut declared = BTreeSet::new();
    for package in packages(&root())? {
        let name = text(&package["name"]);
        let ignored = package["metadata"]["cargo-machete"]["ignored"].as_array();
        let (product, all) = code(&package)?;
        for dependency in package["dependencies"].as_array().into_iter().flatten() {
            let given = text(&dependency["name"]);
            declared.insert(given.to_owned());
            let alias = dependency["rename"].as_str().unwrap_or(given);
            let development = dependency["kind"] == "dev";
            let within = if development { &all } else { &product };
            if ignored.is_none_or(|list| list.iter().all(|one| one != given))
                && !names(within, &alias.replace('-', "_"))
            {
                let kind = if development {
                    "dev-dependency"
                } else {
                    "dependency"
                };
                unused.push(format!("{name}: {kind} {given}"));
            }
        }
    }
    let manifest = fs::read_to_string(root().join("Cargo.toml")).context("Cargo.toml")?;
    let manifest: toml::Table = manifest.parse().context("Cargo.toml")?;
    let shared = manifest["workspace"]
        .get("dependencies")
        .and_then(toml::Value::as_table);
    for name in shared.into_iter().flat_map(toml::Table::keys) {
        if !declared.contains(name) {
            unused.push(format!("workspace: dependency {name}"));
        }
    }
    if unused.is_empty() {
        return Ok(());
    }
    bail!("declared and not used:\n  {}", unused.join("\n  "))
}

/// The product code of a package, and everything in it.
fn code(package: &Value) -> Result<(String, String)> {
    let (mut product, mut all) = (String::new(), String::new());
    for target in package["targets"].as_array().context("targets")? {
        let kind = text(&target["kind"][0]);
        if matches!(
            kind,
            "lib" | "cdylib" | "bin" | "proc-macro" | "custom-build"
        ) {
            product += &product_code(Path::new(text(&target["src_path"])));
        }
    }
    let manifest = Path::new(text(&package["manifest_path"]));
    let folder = manifest.parent().context("manifest_path")?;
    for file in files(folder, "*.rs")? {
        all += &fs::read_to_string(&file).with_context(|| file.display().to_string())?;
    }
    Ok((product, all))
}

fn text(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

/// Whether an identifier stands in some code.
fn names(code: &str, name: &str) -> bool {
    let is_part = |c: char| c.is_alphanumeric() || c == '_';
    code.match_indices(name).any(|(at, _)| {
        !code[..at].ends_with(is_part) && !code[at + name.len()..].starts_with(is_part)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_found_as_a_whole_only() {
        assert!(names("use geo::Polygon;", "geo"));
        assert!(!names(
            "use geographiclib_rs::Geodesic; fn a_geo() {}",
            "geo"
        ));
    }
}
