//! Where a demo is flown: the folder, the speed, the operator's page (`vsm demo --web`), and the runtime of its CUCS.

use std::io;
use std::path::Path;

use super::world::{Setup, World};

/// Where and how a demo is flown.
#[derive(Debug)]
pub(super) struct Stage<'a> {
    /// The folder of picture and recordings.
    pub(super) out: &'a Path,
    /// Times faster than time.
    pub(super) speed: f64,
    /// The port of the page, 0 for any; `None` where there is none.
    pub(super) page: Option<u16>,
}

impl Stage<'_> {
    /// The bridge and its vehicle, protected.
    pub(super) fn start(&self, vehicle: px4_sim::Config) -> anyhow::Result<World> {
        self.start_fleet(vec![vehicle])
    }

    /// The bridge and several vehicles on one link, each with a key of its own.
    pub(super) fn start_fleet(&self, vehicles: Vec<px4_sim::Config>) -> anyhow::Result<World> {
        // Loopback only: everybody who reaches the page can read it, and everybody with the key can fly by it.
        let more = self
            .page
            .map(|port| format!("[http]\nlisten = \"127.0.0.1:{port}\"\n{PILOT_TABLES}"));
        let more = more.unwrap_or_default();
        let setup = Setup {
            speed: self.speed,
            vehicles,
            more: &more,
            ..Setup::default()
        };
        World::start(self.out, &setup)
    }
}

/// What a CUCS runs on: one thread.
pub(super) fn runtime() -> io::Result<tokio::runtime::Runtime> {
    tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
}

pub(super) const NO_SIGNALS: &str = "the signals that end the demo cannot be received";
/// Who looks at the page may fly from there: a ground station of its own, whose key is made for this demo and goes with it.
pub(super) const PILOT: &str = "1b:00:00:b0";
const PILOT_TABLES: &str = r#"
[web]
control = true
[[cucs]]
id = "1b:00:00:b0"
loi = [2, 4, 5]
guard = { key_file = "pilot.key" }
web = true
override = true
"#;
