//! `cargo xtask conform`: the conformance suite against this project's own bridge and simulated PX4.
//!
//! `cargo xtask conform mavlink` does the same for the simulated PX4 alone, by `mavlink-check`.
//!
//! Each run has a folder, ports and keys of its own; the report lies in `target/conform/report`. What the bridge is known to
//! depart in is in `conformance/known.toml`, each with its reason: anything else that fails is an error.

use std::fs;
use std::io::Read as _;
use std::net::UdpSocket;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use anyhow::{Context as _, Result};

use crate::steps::{Steps, cargo, root};

/// Builds, starts bridge and vehicle, and judges. Arguments behind `conform` are passed on, such as `--rule AUTH-002`; `--docs`
/// writes the report that stands in the documents.
pub(crate) fn run(steps: &mut Steps) -> Result<()> {
    let further: Vec<String> = std::env::args().skip(2).collect();
    if further.first().is_some_and(|first| first == "mavlink") {
        return run_mavlink(steps, &further[1..]);
    }
    let folder = prepare(steps)?;
    let (dli, mavlink) = (free_port()?, free_port()?);
    let mut init = program("vsm", &folder);
    init.args([
        "init",
        "--sitl",
        "--listen",
        &dli,
        "--link",
        &format!("udpin:{mavlink}"),
    ]);
    steps.run_here(&mut init)?;
    write_key(&folder.join("uav2.key"))?;
    let configuration = folder.join("vsm.toml");
    let text = fs::read_to_string(&configuration).context("vsm.toml")?;
    // What is off as it comes: layouts of which the source is weak, and termination (a landing, should it ever be executed here).
    let text = text
        .replace("[dli]", "[dli]\nprovisional = \"all\"")
        .replace(
            "tail_number =",
            "termination = { action = \"land\" }\ntail_number =",
        );
    let second = SECOND_VEHICLE.replace("MAVLINK", &mavlink);
    fs::write(&configuration, text + FURTHER + &second).context("vsm.toml")?;

    let _bridge = Bridge::begin(&folder)?;
    let vehicles = (1..=2)
        .map(|number| {
            let mut vehicle = program("px4-sim", &folder);
            vehicle.args(["--link", &format!("udpout:{mavlink}"), "--speed", "10"]);
            vehicle.args(["--system-id", &number.to_string()]);
            vehicle.args(["--payloads", if number == 1 { "2" } else { "0" }]);
            vehicle.args(["--key-file", &format!("uav{number}.key")]);
            Started::begin(&mut vehicle)
        })
        .collect::<Result<Vec<_>>>()?;
    std::thread::sleep(BOOT);
    // The judge works in the folder of the run: no path of this computer is in the report. A stopped vehicle sends and answers nothing, as one out of range.
    let pid = vehicles[0].0.id();
    let means = format!(
        "[means]\nrestart = \"sh bridge.sh\"\ncut_vehicle_link = \"kill -STOP {pid}\"\nrestore_vehicle_link = \"kill -CONT {pid}\"\n\
         lower_energy = \"kill -USR1 {pid}\"\nrestore_energy = \"kill -USR2 {pid}\"\n"
    );
    fs::write(folder.join("profile.toml"), PROFILE.to_owned() + &means).context("profile.toml")?;
    let mut judge = program("dli-check", &folder);
    judge.args(["vsm", &dli, "--profile", "profile.toml", "--out", "report"]);
    judge
        .arg("--expected")
        .arg(root().join("conformance/known.toml"));
    for argument in further {
        if argument == "--docs" {
            judge.arg("--html").arg(root().join(REPORT));
        } else {
            judge.arg(argument);
        }
    }
    steps.run_here(&mut judge)
}

/// The simulated PX4, signed, in real time: what it is known to share with the real one is in
/// `conformance/mavlink/known.toml`.
fn run_mavlink(steps: &mut Steps, further: &[String]) -> Result<()> {
    let folder = prepare(steps)?;
    write_key(&folder.join("uav1.key"))?;
    let mavlink = free_port()?;
    let mut vehicle = program("px4-sim", &folder);
    vehicle.args([
        "--link",
        &format!("udpout:{mavlink}"),
        "--key-file",
        "uav1.key",
    ]);
    let _vehicle = Started::begin(&mut vehicle)?;
    let mut judge = program("mavlink-check", &folder);
    judge.args([
        "autopilot",
        &format!("udpin:{mavlink}"),
        "--key-file",
        "uav1.key",
    ]);
    judge.args(["--simulated", "--out", "report", "--expected"]);
    judge.arg(root().join("conformance/mavlink/known.toml"));
    judge.args(further);
    steps.run_here(&mut judge)
}

/// A signing key of its own for this run, which nobody else can read.
fn write_key(file: &Path) -> Result<()> {
    let mut key = [0_u8; 32];
    fs::File::open("/dev/urandom")
        .and_then(|mut source| source.read_exact(&mut key))
        .context("a key")?;
    let digits: String = key.iter().map(|byte| format!("{byte:02x}")).collect();
    fs::write(file, digits).context("a key file")?;
    fs::set_permissions(file, fs::Permissions::from_mode(0o600)).context("a key file")?;
    Ok(())
}

/// Builds the programs, and empties the folder of the run.
fn prepare(steps: &mut Steps) -> Result<PathBuf> {
    // Of the whole workspace: with its features nothing is compiled twice.
    steps.run(&mut cargo(["build", "--workspace", "--bins", "--locked"]))?;
    let folder = root().join("target/conform");
    if folder.exists() {
        fs::remove_dir_all(&folder).context("the folder of an earlier run")?;
    }
    fs::create_dir_all(&folder).context("target/conform")?;
    Ok(folder)
}

/// The report of the full run that stands in the documents.
const REPORT: &str = "docs/reference/conformance-report.html";

fn program(name: &str, folder: &Path) -> Command {
    let mut command = Command::new(root().join("target/debug").join(name));
    command.current_dir(folder);
    command
}

fn free_port() -> Result<String> {
    let socket = UdpSocket::bind("127.0.0.1:0").context("a free port")?;
    Ok(socket.local_addr()?.to_string())
}

/// A process that ends with this.
struct Started(Child);

impl Started {
    fn begin(command: &mut Command) -> Result<Self> {
        let log = fs::File::options()
            .create(true)
            .append(true)
            .open(root().join("target/conform/log.txt"))?;
        let child = command.stdout(Stdio::null()).stderr(log).spawn();
        Ok(Self(child.context("a program cannot be started")?))
    }
}

impl Drop for Started {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The bridge, which the judge may end and start again: by a script that keeps its process id in a file.
struct Bridge {
    script: PathBuf,
}

impl Bridge {
    fn begin(folder: &Path) -> Result<Self> {
        let script = folder.join("bridge.sh");
        let program = root().join("target/debug/vsm");
        let text = format!(
            "cd {} || exit 1\n{END_BRIDGE}{} run </dev/null >>log.txt 2>&1 &\necho $! >bridge.pid\n",
            folder.display(),
            program.display()
        );
        fs::write(&script, text).context("bridge.sh")?;
        let bridge = Self { script };
        bridge
            .sh(&["bridge.sh"])
            .context("the bridge cannot be started")?;
        Ok(bridge)
    }

    fn sh(&self, arguments: &[&str]) -> Result<()> {
        let folder = self.script.parent().context("bridge.sh has no folder")?;
        Command::new("sh")
            .args(arguments)
            .current_dir(folder)
            .status()?;
        Ok(())
    }
}

impl Drop for Bridge {
    fn drop(&mut self) {
        let _ = self.sh(&["-c", END_BRIDGE]);
    }
}

/// Ends the bridge as a service manager does, and by force after five seconds.
const END_BRIDGE: &str = "if [ -s bridge.pid ]; then
  old=$(cat bridge.pid); kill $old; left=100
  while [ $left -gt 0 ] && kill -0 $old 2>/dev/null; do sleep 0.05; left=$((left - 1)); done
  kill -9 $old 2>/dev/null; rm -f bridge.pid
fi
";

/// Beside the station that `vsm init` lists: another, and one that may override. Silence is acted on sooner than by default, since the
/// suite waits for it.
const FURTHER: &str = "
[authority]
warn_s = 1.0
offer_s = 2.0
act_s = 4.0
[[cucs]]
id = \"1b:00:00:a1\"
loi = [2, 3, 4, 5]
override = true
[[cucs]]
id = \"1b:00:00:a2\"
loi = [2, 3, 4, 5]
";
/// On the link of the first: what is addressed to one must not reach the other.
const SECOND_VEHICLE: &str = "
[[vehicle]]
id = \"1b:00:01:02\"
link = \"udpin:MAVLINK\"
system_id = 2
tail_number = \"SITL-02\"
signing = { key_file = \"uav2.key\" }
";
/// What `dli-check` has to know of them. The place is that of px4-sim. Over loopback silence needs no longer look than this.
const PROFILE: &str = "
[subject]
name = \"vsm run and px4-sim\"
edition = \"4\"
project = true
[[cucs]]
id = \"1b:00:00:a0\"
loi = [2, 3, 4, 5]
[[cucs]]
id = \"1b:00:00:a1\"
loi = [2, 3, 4, 5]
override = true
[[cucs]]
id = \"1b:00:00:a2\"
loi = [2, 3, 4, 5]
[[vehicle]]
id = \"1b:00:01:01\"
simulated = true
position = [47.397742, 8.545594]
amsl_m = 488.0
geoid_m = 47.4
[[vehicle]]
id = \"1b:00:01:02\"
simulated = true
[timers]
quiet = 0.5
status = 5.0
[figures]
speed_factor = 10.0
offer_s = 2.0
act_s = 4.0
on_loss = \"continue\"
";
/// Until the vehicle has a position and can be armed, ten times faster than time.
const BOOT: Duration = Duration::from_secs(6);
