//! Any text as a configuration: it is accepted or refused, and a refusal is a sentence.

use std::path::Path;

use vsm::config::Config;

/// Reads the bytes as a configuration file.
pub fn run(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    match Config::parse(text, Path::new("/nowhere")) {
        Ok(config) => {
            assert!(config.vehicles().all(|vehicle| vehicle.system_id > 0));
            assert!(!format!("{config:?}").is_empty());
        }
        Err(refusal) => assert!(!refusal.to_string().is_empty()),
    }
}
