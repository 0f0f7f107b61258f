//! Many vehicles of one `[[vehicle]]` table: they are checked, run and reloaded like vehicles with a table each, and `vsm status` sums
//! them up, or shows those of a pattern.

use std::fs;
use std::process::{Command, Output};
use std::time::Duration;

use kit::process::{Running, free_udp_port, program, write_key};
use serde_json::Value;
use tempfile::TempDir;

struct World {
    folder: TempDir,
    ports: [u16; 2],
}

impl World {
    fn new() -> World {
        let folder = TempDir::new().expect("a folder");
        for n in 1..=41_u8 {
            write_key(&folder.path().join(format!("uav{n}.key")), &[n; 32]);
        }
        let world = World {
            folder,
            ports: [0; 2].map(|_| free_udp_port()),
        };
        world.write(40);
        world
    }

    fn write(&self, count: u8) {
        let [dli, link] = self.ports;
        let text = format!(
            r#"
[dli]
vsm_id = "1b:00:00:01"
listen = "127.0.0.1:{dli}"
[[cucs]]
id = "1b:00:00:a0"
loi = [2]
[[vehicle]]
id = "1b:00:01:01"
link = "udpin:127.0.0.1:{link}"
system_id = 1
count = {count}
tail_number = "UAV-{{n}}"
signing = {{ key_file = "uav{{n}}.key" }}
[store]
dir = "state"
"#
        );
        fs::write(self.folder.path().join("vsm.toml"), text).expect("written");
    }

    fn vsm(&self, arguments: &[&str]) -> Output {
        let mut vsm = Command::new(program("vsm"));
        vsm.args(arguments).current_dir(self.folder.path());
        vsm.output().expect("it runs")
    }

    fn done(&self, arguments: &[&str]) -> String {
        let output = self.vsm(arguments);
        let printed = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{arguments:?}: {printed}");
        String::from_utf8(output.stdout).expect("text")
    }

    fn run(&self) -> Running {
        let config = self.folder.path().join("vsm.toml");
        let arguments = ["run".as_ref(), "--config".as_ref(), config.as_os_str()];
        let mut bridge = Running::start(&program("vsm"), arguments);
        bridge.wait_for("ready", LIMIT);
        bridge
    }
}

#[test]
fn counted_vehicles_are_checked_run_and_reloaded_like_any_other() {
    let world = World::new();
    let checked = world.done(&["check-config"]);
    for n in 1..=40 {
        let line = format!("vehicle 1b:00:01:{n:02x} (system {n}) on udpin:");
        assert!(checked.contains(&line), "{line}: {checked}");
    }
    assert!(!checked.contains("1b:00:01:29"), "{checked}");
    let _bridge = world.run();
    world.write(41);
    let report: Value = serde_json::from_str(&world.done(&["reload", "--json"])).expect("a report");
    assert_eq!(
        report["applied"],
        serde_json::json!(["vehicle 1b:00:01:29 added"])
    );
    world.write(2);
    let report: Value = serde_json::from_str(&world.done(&["reload", "--json"])).expect("a report");
    let applied = report["applied"].as_array().expect("a list");
    assert_eq!(applied.len(), 39, "{report}");
    assert!(
        world
            .done(&["status"])
            .contains("vehicle 1b:00:01:02 SILENT")
    );
}

#[test]
fn the_status_of_many_vehicles_is_a_summary_and_of_a_pattern_the_whole() {
    let world = World::new();
    let _bridge = world.run();
    let many = world.done(&["status"]);
    let summary =
        "vehicles: 40; 0 live, 40 silent (40 not received yet), 0 in the air, 0 not signed";
    assert_eq!(many.lines().nth(1), Some(summary), "{many}");
    let lines =
        |text: &str, begin: &str| text.lines().filter(|line| line.starts_with(begin)).count();
    assert_eq!(lines(&many, "vehicle 1b:"), 40, "{many}");
    assert!(
        !many.contains("rights:") && !many.contains("frame has verified"),
        "{many}"
    );

    let one = world.done(&["status", "--vehicle", "uav-7"]);
    let never = "vehicle 1b:00:01:07 SILENT, no data received yet, ";
    assert_eq!(lines(&one, never), 1, "{one}");
    assert_eq!(lines(&one, "vehicle 1b:"), 1, "{one}");
    assert!(one.contains("no frame has verified yet"), "{one}");
    // Its rights, too, and nobody else's.
    assert_eq!(lines(&one, "  1b:00:00:a0  1b:00:01:"), 1, "{one}");

    let some = world.done(&["status", "--json", "--vehicle", "UAV-3*"]);
    let some: Value = serde_json::from_str(&some).expect("JSON");
    let ids = some["vehicles"].as_array().expect("a list").iter();
    let ids: Vec<_> = ids.map(|one| one["tail_number"].as_str()).collect();
    assert_eq!(ids.len(), 11, "{ids:?}");
    // Everything else is as without a pattern.
    assert!(
        some["vsm"].is_string() && some["stations"].is_array(),
        "{some}"
    );

    let none = world.vsm(&["status", "--vehicle", "UAV-99"]);
    let printed = String::from_utf8_lossy(&none.stderr);
    assert_eq!(none.status.code(), Some(1), "{printed}");
    for part in ["uav-99", "there are 40, 1b:00:01:01 to 1b:00:01:28"] {
        assert!(printed.contains(part), "{printed}");
    }
}

const LIMIT: Duration = Duration::from_secs(30);
