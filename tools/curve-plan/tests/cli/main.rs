//! The program `curve-plan` from outside: output, files, errors, exit statuses.

mod checking;
mod errors;
mod every_subcommand;
mod exchange;
mod formats;
mod heights;
mod pictures;
mod planning;

use std::path::PathBuf;
use std::process::{Command, Output};

use serde_json::Value;
use tempfile::TempDir;

const ROUTE: &str = r#"id = "bend & climb"

[defaults]
altitude_type = "amsl"

[[waypoint]]
number = 10
latitude = 47.3977434
longitude = 8.5455939
altitude = 500.0

[[waypoint]]
number = 20
latitude = 47.3990
longitude = 8.5470
altitude = 510.0

[[waypoint]]
number = 30
latitude = 47.3975
longitude = 8.5490
altitude = 540.0

[[curve]]
from = 20
to = 30
p2 = [47.4000, 8.5482, 515.0]
p3 = [47.3985, 8.5510, 560.0]
altitude_type = "amsl"
"#;

struct Files(TempDir);

impl Files {
    fn new() -> Self {
        let files = Self(TempDir::new().unwrap());
        files.put("route.toml", ROUTE);
        files
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn put(&self, name: &str, text: &str) -> PathBuf {
        std::fs::write(self.path(name), text).unwrap();
        self.path(name)
    }

    fn get(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap()
    }

    fn run(&self, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_curve-plan"))
            .args(arguments)
            .current_dir(self.0.path())
            .output()
            .unwrap()
    }

    fn done(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        assert!(
            output.status.success(),
            "{arguments:?}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
        String::from_utf8(output.stdout).unwrap()
    }

    fn json(&self, arguments: &[&str]) -> Value {
        serde_json::from_str(&self.done(arguments)).unwrap()
    }

    /// The exit status and the text on standard error.
    fn refused(&self, arguments: &[&str]) -> (i32, String) {
        let output = self.run(arguments);
        assert!(
            output.stdout.is_empty(),
            "{}",
            String::from_utf8_lossy(&output.stdout)
        );
        (
            output.status.code().unwrap(),
            String::from_utf8(output.stderr).unwrap(),
        )
    }
}
