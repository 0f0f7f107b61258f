//! `cargo xtask sbom`: what the flight binary is made of, as a CycloneDX 1.5 document.
//!
//! Its components are the dependencies that the program `vsm` is linked from, without the demo's and the tests': followed
//! in the graph that cargo resolved, each with its version, licence, place in the registry and the checksum of `Cargo.lock`.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use serde_json::{Value, json};

use crate::steps::{cargo, option, root};

/// Writes `target/vsm.cdx.json`, or the file of `--out`.
pub(crate) fn write() -> Result<PathBuf> {
    let out = option("--out").unwrap_or_else(|| root().join("target/vsm.cdx.json"));
    write_to(&out)?;
    Ok(out)
}

/// Writes it into this file.
pub(crate) fn write_to(out: &Path) -> Result<()> {
    let metadata = metadata()?;
    let lock: toml::Table = fs::read_to_string(root().join("Cargo.lock"))?.parse()?;
    let document = document(&metadata, &checksums(&lock))?;
    let text = serde_json::to_string_pretty(&document)?;
    fs::write(out, text + "\n").with_context(|| out.display().to_string())
}

fn metadata() -> Result<Value> {
    let manifest = root().join("vsm/Cargo.toml");
    // What is for other systems is not linked.
    let platform = format!("{}-unknown-linux-gnu", std::env::consts::ARCH);
    let output = cargo(["metadata", "--format-version", "1", "--locked"])
        .args([
            "--no-default-features",
            "--features",
            "klv",
            "--manifest-path",
        ])
        .arg(manifest)
        .args(["--filter-platform", &platform])
        .output()
        .context("cargo metadata")?;
    if !output.status.success() {
        bail!(
            "cargo metadata: {}",
            String::from_utf8_lossy(&output.stderr)
        );
    }
    serde_json::from_slice(&output.stdout).context("cargo metadata")
}

/// SHA-256 of the packages from the registry, by name and version.
fn checksums(lock: &toml::Table) -> BTreeMap<(String, String), String> {
    let packages = lock.get("package").and_then(toml::Value::as_array);
    let text = |package: &toml::Value, key: &str| Some(package.get(key)?.as_str()?.to_owned());
    packages
        .into_iter()
        .flatten()
        .filter_map(|package| {
            let of = (text(package, "name")?, text(package, "version")?);
            Some((of, text(package, "checksum")?))
        })
        .collect()
}

fn document(metadata: &Value, checksums: &BTreeMap<(String, String), String>) -> Result<Value> {
    let packages = metadata["packages"].as_array().context("no packages")?;
    let by_id: BTreeMap<&str, &Value> = packages
        .iter()
        .filter_map(|package| Some((package["id"].as_str()?, package)))
        .collect();
    let nodes = metadata["resolve"]["nodes"]
        .as_array()
        .context("no graph")?;
    let edges: BTreeMap<&str, Vec<&str>> = nodes
        .iter()
        .filter_map(|node| Some((node["id"].as_str()?, linked(node))))
        .collect();
    let program = packages
        .iter()
        .find(|package| package["name"] == "vsm")
        .and_then(|package| package["id"].as_str())
        .context("no package vsm")?;

    let (mut reached, mut open) = (BTreeSet::new(), vec![program]);
    while let Some(id) = open.pop() {
        if reached.insert(id) {
            open.extend(edges.get(id).into_iter().flatten());
        }
    }
    let component = |id: &str| by_id.get(id).map(|package| component(package, checksums));
    let dependencies: Vec<Value> = reached
        .iter()
        .map(|id| json!({ "ref": id, "dependsOn": edges.get(id).cloned().unwrap_or_default() }))
        .collect();
    let components: Vec<Value> = reached
        .iter()
        .filter(|id| **id != program)
        .filter_map(|id| component(id))
        .collect();
    Ok(json!({
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": { "component": component(program) },
        "components": components,
        "dependencies": dependencies,
    }))
}

/// What a package is linked with: neither for its tests nor for its build script.
fn linked(node: &Value) -> Vec<&str> {
    let of = |dependency: &Value| {
        let mut kinds = dependency["dep_kinds"].as_array().into_iter().flatten();
        kinds.any(|kind| kind["kind"].is_null())
    };
    let all = node["deps"].as_array().into_iter().flatten();
    all.filter(|dependency| of(dependency))
        .filter_map(|dependency| dependency["pkg"].as_str())
        .collect()
}

fn component(package: &Value, checksums: &BTreeMap<(String, String), String>) -> Value {
    let text = |key: &str| package[key].as_str().unwrap_or_default().to_owned();
    let (name, version) = (text("name"), text("version"));
    let kind = if name == "vsm" {
        "application"
    } else {
        "library"
    };
    let mut component = json!({
        "type": kind,
        "bom-ref": package["id"],
        "name": name,
        "version": version,
        "licenses": [{ "expression": package["license"] }],
    });
    if package["source"].is_string() {
        component["purl"] = json!(format!("pkg:cargo/{name}@{version}"));
    }
    if let Some(sha) = checksums.get(&(name, version)) {
        component["hashes"] = json!([{ "alg": "SHA-256", "content": sha }]);
    }
    component
}
