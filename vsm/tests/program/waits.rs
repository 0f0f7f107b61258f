//! No wait is silent, and none is for what cannot come: a command that lasts says what it waits for and until when, on standard
//! error; the two ends of a handover may be typed in either order; a wait for a route that is not flown fails at once.

use std::fs;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use kit::process::{KillOnDrop, Running, free_udp_port, program, write_key};
use tempfile::TempDir;

const A: &str = "1b:00:00:a0";
const B: &str = "1b:00:00:b0";

/// A bridge with two ground stations.
struct Scene {
    folder: TempDir,
    dli: String,
    link: String,
    running: Vec<Running>,
}

impl Scene {
    fn new() -> Scene {
        let folder = tempfile::tempdir().expect("a folder");
        let (dli, link) = (free_udp_port(), free_udp_port());
        write_key(&folder.path().join("uav1.key"), &[1; 32]);
        let stations = [A, B].map(|id| format!("[[cucs]]\nid = \"{id}\"\nloi = [2, 3, 4, 5]\n"));
        let text = format!(
            "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:{dli}\"\n{}[store]\ndir = \"state\"\n[[vehicle]]\nid = \"1b:00:01:01\"\n\
             link = \"udpin:127.0.0.1:{link}\"\nsystem_id = 1\nsigning = {{ key_file = \"uav1.key\" }}\n",
            stations.concat()
        );
        fs::write(folder.path().join("vsm.toml"), text).expect("the configuration");
        let route = kit::workspace().join("examples/square.route.toml");
        fs::copy(route, folder.path().join("square.route.toml")).expect("the route");
        Scene {
            folder,
            dli: format!("127.0.0.1:{dli}"),
            link: format!("127.0.0.1:{link}"),
            running: Vec::new(),
        }
    }

    fn start(&mut self, name: &str, words: &str) {
        let mut command = Command::new(program(name));
        command
            .args(words.split(' '))
            .current_dir(self.folder.path());
        let mut started = Running::spawn(&mut command);
        started.wait_for("ready", Duration::from_secs(20));
        self.running.push(started);
    }

    fn command(&self, name: &str, words: &str) -> Command {
        let mut command = Command::new(program(name));
        command
            .args(words.split(' '))
            .current_dir(self.folder.path());
        command
    }

    fn cucs(&self, id: &str, words: &str) -> Command {
        self.command("cucs", &format!("--vsm {} --id {id} {words}", self.dli))
    }
}

fn texts(output: &Output) -> (Option<i32>, String, String) {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (
        output.status.code(),
        text(&output.stdout),
        text(&output.stderr),
    )
}

fn done(mut command: Command) -> String {
    let output = command.output().expect("it runs");
    let (code, out, error) = texts(&output);
    assert_eq!(code, Some(0), "{command:?}: {out}{error}");
    out
}

#[test]
fn the_answer_to_a_handover_may_be_typed_before_it() {
    let mut scene = Scene::new();
    scene.start("vsm", "run");
    done(scene.cucs(A, "take"));
    for (early, late) in [
        (
            scene.cucs(A, &format!("consent {B}")),
            scene.cucs(B, "ask --loi 4,5"),
        ),
        (
            scene.cucs(A, "accept"),
            scene.cucs(B, &format!("successor {A}")),
        ),
        (scene.cucs(A, "consent"), scene.cucs(B, "ask --loi 4,5")),
    ] {
        let mut early = early;
        let child = early
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("it runs");
        std::thread::sleep(Duration::from_millis(900));
        done(late);
        let (code, out, error) = texts(&child.wait_with_output().expect("its end"));
        assert_eq!(code, Some(0), "{early:?}: {out}{error}");
        assert!(error.contains("cucs: waiting for the "), "{error}");
        assert!(error.contains(" s at most"), "{error}");
        assert!(!out.contains("waiting"), "{out}");
    }
    done(scene.cucs(B, "wait holds 4,5"));

    // Nobody asks: no message 4, which would be an offer, and what to do.
    let nobody = scene
        .cucs(B, "--json consent --within 1")
        .output()
        .expect("it runs");
    let (code, out, error) = texts(&nobody);
    assert_eq!(code, Some(1), "{out}{error}");
    assert!(
        error.contains("no handover request of another CUCS received within 1 s")
            && error.contains("cucs successor ID"),
        "{error}"
    );
    assert!(
        error.contains("cucs: waiting for the handover request"),
        "{error}"
    );
    for line in out.lines() {
        serde_json::from_str::<serde_json::Value>(line)
            .unwrap_or_else(|fault| panic!("{fault}: {out}"));
    }
    let offered = scene
        .cucs(A, "wait offered --within 0.5")
        .output()
        .expect("it runs");
    assert_eq!(offered.status.code(), Some(1), "nothing was offered");
}

#[test]
fn a_wait_for_the_end_of_a_route_that_is_not_flown_fails_at_once() {
    let mut scene = Scene::new();
    scene.start("vsm", "run");
    let link = format!("--link udpout:{} --key-file uav1.key --speed 5", scene.link);
    scene.start("px4-sim", &link);
    scene.running[0].wait_for("the link is live", Duration::from_secs(20));
    std::thread::sleep(Duration::from_secs(2));
    done(scene.cucs(A, "take"));
    let refused = |words: &str| {
        let began = Instant::now();
        let (code, out, error) = texts(&scene.cucs(A, words).output().expect("it runs"));
        assert_eq!(code, Some(1), "{out}{error}");
        assert!(began.elapsed() < Duration::from_secs(6), "at once");
        error
    };
    let none = refused("wait route-end");
    assert!(
        none.contains("flies no route: none is loaded; `cucs send FILE`"),
        "{none}"
    );
    done(scene.cucs(A, "send square.route.toml"));
    let loaded = refused("wait route-end");
    assert!(
        loaded.contains("one is loaded, to waypoint 10") && loaded.contains("`cucs fly` begins"),
        "{loaded}"
    );
    // Who does not fly it may wait for a waypoint of it, and is warned.
    let waypoint = refused("wait waypoint 20 --within 1");
    assert!(
        waypoint.contains("flies no route: one is loaded")
            && waypoint.contains("no leg to waypoint 20"),
        "{waypoint}"
    );
}

#[test]
fn a_command_that_waits_for_a_vehicle_says_for_what_and_how_long() {
    let scene = Scene::new();
    for (words, waits) in [
        (
            "key rotate --wait-s 1",
            "waiting for frames of the vehicle, 1 s at most (--wait-s)",
        ),
        (
            "check-vehicle --wait-s 1",
            "reading settings; 1 s a vehicle at most (--wait-s)",
        ),
    ] {
        let (code, out, error) = texts(&scene.command("vsm", words).output().expect("it runs"));
        assert_eq!(code, Some(1), "{words}: {out}{error}");
        assert!(error.contains(waits), "{words}: {error}");
        assert!(!out.contains(waits), "{words}: {out}");
    }
    // Another program has the address, and answers nothing.
    let silent = std::net::UdpSocket::bind("127.0.0.1:0").expect("a port");
    let at = silent.local_addr().expect("its address").to_string();
    let output = scene
        .command("cucs", &format!("--vsm {at} --json discover"))
        .output();
    let (code, out, error) = texts(&output.expect("it runs"));
    assert_eq!(code, Some(1), "{out}{error}");
    assert!(
        error.contains("cucs: waiting for the answer of a VSM (message 2)"),
        "{error}"
    );
    assert!(!out.contains("waiting"), "{out}");
}

/// The answer comes in time for whoever asks a bridge that serves: no line for that.
#[test]
fn what_is_answered_at_once_has_no_line_about_waiting() {
    let mut scene = Scene::new();
    scene.start("vsm", "run");
    for (name, words) in [("vsm", "status"), ("vsm", "reload")] {
        let (code, out, error) = texts(&scene.command(name, words).output().expect("it runs"));
        assert_eq!(code, Some(0), "{words}: {out}{error}");
        assert!(!error.contains("waiting"), "{words}: {error}");
    }
    // A bridge that hangs: the status is waited for.
    scene.running[0].signal("STOP");
    let child = scene
        .command("vsm", "status")
        .stderr(Stdio::piped())
        .spawn();
    let mut child = KillOnDrop(child.expect("it runs"));
    let stderr = child.0.stderr.take().expect("a pipe");
    let text = std::io::read_to_string(stderr).expect("text");
    scene.running[0].signal("CONT");
    assert!(
        text.contains("vsm: waiting for the answer of the vsm; 3 s at most"),
        "{text}"
    );
}

/// Each process of `cucs` is a station that begins to listen, and is sent all that stands: that must not bury its answer.
#[test]
fn what_stood_before_a_command_is_named_in_short_before_its_answer() {
    let mut scene = Scene::new();
    scene.start("vsm", "run");
    done(scene.cucs(A, "take"));
    let answer = |words: &str| texts(&scene.cucs(A, words).output().expect("it runs"));
    let (code, out, error) = answer("wait holds 4,5");
    assert_eq!(code, Some(0), "{out}{error}");
    let standing = "1b:00:01:01: caution stands: no data from the vehicle yet: state unknown\n";
    assert!(error.contains(standing), "{out}{error}");
    assert_eq!(out.lines().count(), 1, "the answer alone: {out}");
    // Why it is silent is known after 10 s, and what to do about it is long.
    scene.running[0].wait_for("no MAVLink at all arrives", Duration::from_secs(20));
    let answer = |words: &str| texts(&scene.cucs(A, words).output().expect("it runs"));
    let (_, out, error) = answer("wait holds 4,5");
    let short = "1b:00:01:01: warning stands: no MAVLink at all arrives on udpin:";
    assert!(
        error.contains(short) && error.contains(" (whole: `cucs watch`)\n"),
        "{error}"
    );
    assert!(!error.contains("check a firewall"), "{error}");
    assert_eq!(out.lines().count(), 1, "the answer alone: {out}");

    let (_, watched, _) = answer("watch --seconds 0.5");
    assert!(
        watched.contains("no MAVLink at all arrives") && watched.contains("check a firewall"),
        "{watched}"
    );
    let (_, json, _) = answer("--json wait holds 4,5");
    assert!(json.contains("check a firewall"), "{json}");
}
