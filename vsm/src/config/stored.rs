//! What a configuration has of its store: where it is, and the vehicles whose records and keys belong to it.
//!
//! A command that only shows these needs no other part of the file: where another part is wrong, it is left out, and named
//! beside. Not so where the fault may be that a vehicle is missing: a table of no known name may be a `[[vehicle]]` with a typing
//! error, and "intact" would be said of a vehicle that nobody looked at.

use std::path::{Path, PathBuf};

use super::bridge::Config;
use super::error::ConfigError;
use super::vehicle::Vehicle;

/// The store of a configuration, and its vehicles.
#[derive(Debug)]
pub struct Stored {
    /// Its folder.
    pub dir: PathBuf,
    /// The vehicles.
    pub vehicles: Vec<Vehicle>,
    /// What is wrong in another part of the file.
    pub fault: Option<ConfigError>,
}

impl Stored {
    /// Reads a file.
    ///
    /// # Errors
    /// As [`Config::load`], where the file is not TOML, or `[store]` or a `[[vehicle]]` is wrong, or may be missing.
    pub fn load(path: &Path) -> Result<Stored, ConfigError> {
        let (config, fault) = match Config::load(path) {
            Ok(config) => (config, None),
            // That of an agent has a store, too.
            Err(fault @ ConfigError::OtherKind { .. }) => return Err(fault),
            Err(fault) => match parts(path) {
                Some(config) => (config, Some(fault)),
                None => return Err(fault),
            },
        };
        Ok(Stored {
            vehicles: config.vehicles().cloned().collect(),
            dir: config.store.dir,
            fault,
        })
    }
}

/// The configuration of these parts alone.
fn parts(path: &Path) -> Option<Config> {
    let text = ConfigError::read(path, "").ok()?;
    let mut whole: toml::Table = toml::from_str(&text).ok()?;
    let mut parts: toml::Table = toml::from_str(NO_BRIDGE).ok()?;
    for name in ["store", "vehicle"] {
        parts.insert(name.to_owned(), whole.remove(name)?);
    }
    let is_known = |name: &String| Config::KEYS.iter().any(|key| key.name == name);
    if !whole.keys().all(is_known) {
        return None;
    }
    let text = toml::to_string(&parts).ok()?;
    let folder = path.parent().unwrap_or(Path::new(""));
    Config::parse(&text, folder).ok()
}

/// What every file has beside them, in place of what this one has.
const NO_BRIDGE: &str = "[dli]\nvsm_id = \"01:ff:ff:fe\"\nlisten = \"127.0.0.1:0\"\n";

#[cfg(test)]
mod tests {
    use super::*;

    const DLI: &str = "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:4586\"\n";
    const STORE: &str = "[store]\ndir = \"state\"\n";
    const VEHICLES: &str = "[[vehicle]]\nid = \"1b:00:01:01\"\nlink = \"udpin:127.0.0.1:0\"\nsystem_id = 1\n\
        signing = { key_file = \"uav{n}.key\" }\ncount = 2\n";

    fn stored(parts: &[&str]) -> Result<(Vec<String>, PathBuf, Option<String>), String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("vsm.toml");
        std::fs::write(&path, parts.concat()).unwrap();
        let stored = Stored::load(&path).map_err(|fault| fault.to_string())?;
        let dir = stored.dir.strip_prefix(folder.path()).unwrap().to_owned();
        let ids = stored.vehicles.iter().map(|one| one.id.to_string());
        let fault = stored.fault.map(|fault| fault.to_string());
        Ok((ids.collect(), dir, fault))
    }

    #[test]
    fn what_is_wrong_elsewhere_in_the_file_is_left_out_and_named() {
        let ids = ["1b:00:01:01", "1b:00:01:02"].map(str::to_owned).to_vec();
        let whole = stored(&[DLI, STORE, VEHICLES]).unwrap();
        assert_eq!(whole, (ids.clone(), "state".into(), None));
        for (dli, rest, words) in [
            (DLI, "[http]\nlisten = 7\n", "http.listen"),
            (DLI, "[http]\nlistne = 7\n", "listne"),
            ("[dli]\nlisten = \"x\"\n", "", "dli"),
            ("", "", "dli"),
        ] {
            let (found, dir, fault) = stored(&[dli, STORE, VEHICLES, rest]).unwrap();
            assert_eq!((found, dir), (ids.clone(), "state".into()), "{words}");
            let fault = fault.expect("it is named");
            assert!(
                fault.contains("vsm.toml") && fault.contains(words),
                "{fault}"
            );
        }
    }

    #[test]
    fn what_is_wrong_with_the_store_or_a_vehicle_is_an_error() {
        for (store, rest, words) in [
            ("", "", "store"),
            ("[store]\ndir = 7\n", "", "store.dir"),
            (STORE, "link_id = 256\n", "vehicle.link_id"),
            (STORE, "[http\n", "line"),
        ] {
            let fault = stored(&[DLI, store, VEHICLES, rest]).unwrap_err();
            assert!(fault.contains(words), "{words}: {fault}");
        }
        // Neither is said to have no vehicle.
        let second = VEHICLES.replace("[[vehicle]]", "[[vehicel]]");
        let id = second.replace("1b:00:01:01", "1b:00:02:01");
        for (vehicles, words) in [
            (second, "vehicel"),
            (VEHICLES.to_owned() + &id, "vehicel"),
            ("[http]\nlisten = 7\n".to_owned(), "http.listen"),
        ] {
            let fault = stored(&[DLI, STORE, &vehicles]).unwrap_err();
            assert!(fault.contains(words), "{words}: {fault}");
        }
        let agent = include_str!("../../../examples/airside.toml");
        let fault = stored(&[agent]).unwrap_err();
        assert!(fault.contains("vsm airside"), "{fault}");
    }
}
