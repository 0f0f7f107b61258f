//! The bridge on a thread of its own and the simulated vehicles of the demo on another.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::sync::mpsc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::config::Config;
use crate::session::Status;
use crate::shell::guard_link::GuardSide;
use crate::shell::guard_proxy::{GuardConfig, GuardProxy};
use crate::shell::key_file;
use crate::shell::server::Server;
use crate::shell::tasks::TaskFault;
use anyhow::{Context as _, anyhow};
use px4_sim::{Counters, LinkAddress, Simulator, SimulatorConfig, Truth};
use rustix::time::{ClockId, clock_gettime};
use stanag_msgs::Id;
use tempfile::TempDir;
use tokio::runtime::Runtime;
use tokio::sync::oneshot;

use super::agent::AgentBeside;
use super::story::CUCS;

/// How a world is made.
pub(super) struct Setup<'a> {
    pub(super) speed: f64,
    /// One or more, on one link.
    pub(super) vehicles: Vec<px4_sim::Config>,
    /// Whether the vehicle's link is signed. Without, in the demo's own world on loopback and nowhere else.
    pub(super) signed: bool,
    pub(super) stations: Stations,
    pub(super) radio: Radio,
    /// Added to the configuration of the bridge.
    pub(super) more: &'a str,
}

/// Whom the bridge takes for its CUCS.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stations {
    /// Who sends from its address, as a user without a guard would have it.
    Address,
    /// Who says so.
    Anywhere,
    /// Who has its guard key.
    Guard,
    /// The same key, by the WebSocket of the page alone.
    Web,
}

/// What is between the bridge and its vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Radio {
    /// Nothing: one socket to the other.
    None,
    /// The air-side agent, behind a radio that somebody records.
    Agent { encrypt: bool },
}

impl Default for Setup<'_> {
    /// As a user would have it: signed, and a CUCS is taken from its address alone.
    fn default() -> Self {
        Setup {
            speed: 1.0,
            vehicles: vec![px4_sim::Config::default()],
            signed: true,
            stations: Stations::Address,
            radio: Radio::None,
            more: "",
        }
    }
}

/// What runs.
pub(crate) struct World {
    /// Where the bridge listens for a CUCS.
    pub(crate) vsm: SocketAddr,
    /// Where the operator's page is, where there is one.
    pub(super) page: Option<SocketAddr>,
    /// The key of who flies from the page, in hex: of this demo alone.
    pub(super) pilot_key: String,
    bridge: JoinHandle<Option<Served>>,
    stop: oneshot::Sender<()>,
    agent: Option<AgentBeside>,
    simulator: Simulator,
    /// The rest of a fleet.
    others: Vec<Simulator>,
    /// Runs the simulators, and carries the radio.
    background: Runtime,
    recording: Option<String>,
    /// Keys and state of the demo: gone with it.
    private: TempDir,
}

/// How a bridge has ended, and what it took.
type Served = (Result<Status, TaskFault>, Spent);

/// Time that passed, and time on a processor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spent {
    pub(super) took: Duration,
    pub(super) cpu: Duration,
}

impl Spent {
    /// Since then; `clock` is that of a thread, which must be the same one, or of the process.
    pub(super) fn since((began, cpu): (Instant, Duration), clock: ClockId) -> Spent {
        Spent {
            took: began.elapsed(),
            cpu: cpu_time(clock).saturating_sub(cpu),
        }
    }

    /// Per cent of one core.
    pub(super) fn percent(&self) -> f64 {
        100.0 * self.cpu.as_secs_f64() / self.took.as_secs_f64().max(f64::MIN_POSITIVE)
    }
}

/// What a clock of processor time shows now.
pub(super) fn cpu_time(clock: ClockId) -> Duration {
    // Neither is ever negative.
    Duration::try_from(clock_gettime(clock)).unwrap_or_default()
}

/// What is left when all has stopped.
pub(crate) struct Remains {
    pub(crate) status: Status,
    pub(crate) counters: Counters,
    pub(crate) track: Vec<Truth>,
    /// The same of the rest of a fleet.
    pub(super) others: Vec<(Counters, Vec<Truth>)>,
    /// The bridge's own thread: how long it ran, and its time on a processor.
    pub(super) bridge: Spent,
    /// None of a fleet: a file for each vehicle would be most of what the bridge does.
    pub(crate) recording: Option<String>,
    /// Every datagram that was on the radio.
    pub(super) radio: Vec<Vec<u8>>,
}

impl World {
    pub(super) fn start(out: &Path, setup: &Setup<'_>) -> anyhow::Result<World> {
        std::fs::create_dir_all(out)
            .with_context(|| format!("the folder {} cannot be made", out.display()))?;
        let private = TempDir::new().context("a folder for the demo's key and state")?;
        for (nth, _) in setup.vehicles.iter().enumerate() {
            key_file::generate(&private.path().join(key_name(nth)))?;
        }
        let pilot = private.path().join("pilot.key");
        key_file::generate(&pilot)?;
        let pilot_key = std::fs::read_to_string(&pilot)?.trim().to_owned();
        let background = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .enable_all()
            .build()?;
        let agent = match setup.radio {
            Radio::None => None,
            Radio::Agent { encrypt } => {
                Some(AgentBeside::start(private.path(), encrypt, &background)?)
            }
        };
        let config = Config::parse(&configuration(out, setup, agent.as_ref())?, private.path())?;
        if matches!(setup.stations, Stations::Guard | Stations::Web) {
            key_file::generate(&private.path().join(GUARD_KEY))?;
        }
        let (sender, opened) = mpsc::channel();
        let (stop, stopped) = oneshot::channel();
        let bridge = std::thread::Builder::new()
            .name("bridge".to_owned())
            .spawn(move || serve(&config, &sender, stopped))?;
        // The bridge binds first: its port is not known before, and the simulator needs it.
        let addresses = opened.recv().context("the bridge's thread has ended")??;
        let px4 = agent.as_ref().map_or(addresses.vehicle, |agent| agent.px4);
        let mut simulators = Vec::new();
        for (nth, vehicle) in setup.vehicles.iter().enumerate() {
            let mut simulation = SimulatorConfig::on(LinkAddress::UdpOut(px4));
            simulation.key = match setup.signed {
                true => Some(key_file::read(&private.path().join(key_name(nth)))?),
                false => None,
            };
            simulation.speed = setup.speed;
            simulation.vehicle = vehicle.clone();
            simulators.push(background.block_on(Simulator::spawn(simulation))?);
        }
        let mut simulators = simulators.into_iter();
        let simulator = simulators.next().context("a world without a vehicle")?;
        Ok(World {
            vsm: addresses.dli,
            page: addresses.page,
            pilot_key,
            bridge,
            stop,
            agent,
            simulator,
            others: simulators.collect(),
            background,
            recording: addresses.recording,
            private,
        })
    }

    /// The guard beside the CUCS, which sends to this address in place of the bridge's.
    pub(super) async fn guard(&self, to: SocketAddr) -> anyhow::Result<GuardProxy> {
        let config = GuardConfig {
            side: GuardSide {
                cucs: CUCS,
                vsm: VSM,
                to,
                key_file: self.guard_key(),
                store: self.private.path().join("guard-state"),
            },
            listen: (Ipv4Addr::LOCALHOST, 0).into(),
            group: None,
            users: Vec::new(),
        };
        Ok(GuardProxy::open(config).await?)
    }

    /// The key of the CUCS, where it has one.
    pub(super) fn guard_key(&self) -> std::path::PathBuf {
        self.private.path().join(GUARD_KEY)
    }

    /// What is really so with the vehicle now.
    pub(crate) fn truth(&self) -> Truth {
        self.simulator.truth()
    }

    /// When it was armed, in the vehicle's time.
    pub(crate) fn armed_at(&self) -> Option<Duration> {
        self.simulator.armed_at()
    }

    /// What was flown so far is no part of the flight.
    pub(super) fn forget_track(&self) {
        drop(self.simulator.take_track());
    }

    /// Where the vehicle's own MAVLink socket is, for whoever is on the link.
    pub(crate) fn px4(&self) -> anyhow::Result<SocketAddr> {
        self.simulator.address(0).context("the vehicle has no link")
    }

    /// Stops both and gives what is left.
    pub(crate) fn stop(self) -> anyhow::Result<Remains> {
        let halt = async |simulator: Simulator| {
            let track = simulator.take_track();
            (simulator.stop().await, track)
        };
        let (counters, track) = self.background.block_on(halt(self.simulator));
        let others = self.others.into_iter();
        let others = others.map(|simulator| self.background.block_on(halt(simulator)));
        let others = others.collect();
        // What they have sent is still on its way: it must not count as lost.
        std::thread::sleep(ON_ITS_WAY);
        let radio = self.agent.map_or(Ok(Vec::new()), AgentBeside::stop)?;
        // A bridge that has already ended needs no stop.
        let _ = self.stop.send(());
        let served = self
            .bridge
            .join()
            .map_err(|_| anyhow!("the bridge's thread has panicked"))?;
        let (status, bridge) = served.context("the bridge did not serve")?;
        Ok(Remains {
            status: status?,
            counters,
            track,
            others,
            bridge,
            recording: self.recording,
            radio,
        })
    }
}

/// The configuration that a user would write, for this.
fn configuration(
    out: &Path,
    setup: &Setup<'_>,
    agent: Option<&AgentBeside>,
) -> anyhow::Result<String> {
    let out = std::path::absolute(out)?;
    let stations = match setup.stations {
        Stations::Address => r#"address = "127.0.0.1""#.to_owned(),
        Stations::Anywhere => String::new(),
        Stations::Guard => format!("guard = {{ key_file = \"{GUARD_KEY}\" }}"),
        Stations::Web => format!("guard = {{ key_file = \"{GUARD_KEY}\" }}\nweb = true"),
    };
    let count = setup.vehicles.len();
    let (mut dli, operator) = if setup.vehicles.iter().any(|vehicle| vehicle.payloads > 0) {
        // The layouts of the payload messages are derived from Edition 2.
        ("provisional = \"all\"".to_owned(), OPERATOR_TABLE)
    } else {
        (String::new(), "")
    };
    if count > 1 {
        // One CUCS receives the reports of all of them: eight messages a second each, and what is pushed on change.
        let (bytes_s, messages_s) = (65_536.max(3_000 * count), 1_000.max(24 * count));
        dli += &format!("max_bytes_s = {bytes_s}\nmax_messages_s = {messages_s}");
    }
    let link = match agent {
        None => "link = \"udpin:127.0.0.1:0\"".to_owned(),
        Some(agent) => format!(
            "link = \"udpout:{}\"\nencrypt = {}",
            agent.wire.near, agent.encrypt
        ),
    };
    let mut text = CONFIG
        .replace("DLI", &dli)
        .replace("OPERATOR", operator)
        .replace("ADDRESS", &stations);
    for (nth, vehicle) in setup.vehicles.iter().enumerate() {
        let key = key_name(nth);
        let signing = match (setup.signed, agent) {
            (false, _) => r#""off""#.to_owned(),
            (true, None) => format!("{{ key_file = \"{key}\" }}"),
            (true, Some(_)) => format!("{{ key_file = \"{key}\", exchange = \"on\" }}"),
        };
        text += &VEHICLE
            .replace("VEHICLE_ID", &vehicle_id(nth).to_string())
            .replace("SYSTEM_ID", &vehicle.system_id.to_string())
            .replace("TAIL", &format!("DEMO-{:02}", nth + 1))
            .replace("SIGNING", &signing)
            .replace("LINK", &link);
    }
    if count == 1 {
        text += &RECORD.replace("OUT", &toml_text(&out)?);
    }
    Ok(text + setup.more)
}

/// The key file of a vehicle, by its place in the fleet.
fn key_name(nth: usize) -> String {
    match nth {
        0 => "demo.key".to_owned(),
        nth => format!("demo-{}.key", nth + 1),
    }
}

/// The id of a vehicle, by its place in the fleet: 1b:00:01:01 and up.
pub(super) fn vehicle_id(nth: usize) -> Id {
    Id(FIRST_VEHICLE + nth as u32)
}

/// Degrees north and east of a place near where the simulator stands.
pub(super) fn north_east_deg(north_m: f64, east_m: f64) -> (f64, f64) {
    (
        HOME.0 + north_m / METRES_A_DEGREE,
        HOME.1 + east_m / (METRES_A_DEGREE * HOME.0.to_radians().cos()),
    )
}

/// The reverse: metres north and east of where the simulator stands.
pub(super) fn north_east_m(latitude_deg: f64, longitude_deg: f64) -> (f64, f64) {
    (
        (latitude_deg - HOME.0) * METRES_A_DEGREE,
        (longitude_deg - HOME.1) * METRES_A_DEGREE * HOME.0.to_radians().cos(),
    )
}

struct Addresses {
    dli: SocketAddr,
    page: Option<SocketAddr>,
    vehicle: SocketAddr,
    recording: Option<String>,
}

type AddressSender = mpsc::Sender<anyhow::Result<Addresses>>;

fn serve(
    config: &Config,
    sender: &AddressSender,
    stopped: oneshot::Receiver<()>,
) -> Option<Served> {
    let runtime = match tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
    {
        Ok(runtime) => runtime,
        Err(cause) => {
            let _ = sender.send(Err(cause.into()));
            return None;
        }
    };
    runtime.block_on(async {
        let server = match open(config) {
            Ok((server, addresses)) => {
                let _ = sender.send(Ok(addresses));
                server
            }
            Err(cause) => {
                let _ = sender.send(Err(cause));
                return None;
            }
        };
        let begun = (Instant::now(), cpu_time(ClockId::ThreadCPUTime));
        let status = server
            .serve(async {
                // A closed channel means stop too.
                let _ = stopped.await;
            })
            .await;
        Some((status, Spent::since(begun, ClockId::ThreadCPUTime)))
    })
}

fn open(config: &Config) -> anyhow::Result<(Server, Addresses)> {
    let server = Server::open(config)?;
    let addresses = Addresses {
        dli: server.dli_address()?,
        page: server.page_address(),
        vehicle: server
            .vehicle_address(0)
            .context("the vehicle's link has no address")?,
        recording: server.recording(0).map(|path| path.display().to_string()),
    };
    Ok((server, addresses))
}

fn toml_text(path: &Path) -> anyhow::Result<String> {
    let text = path
        .to_str()
        .with_context(|| format!("{} is not Unicode", path.display()))?;
    Ok(text.replace('\\', "\\\\").replace('"', "\\\""))
}

/// The guard key of the CUCS, in the demo's folder.
const GUARD_KEY: &str = "guard.key";
const VSM: Id = Id(0x1b00_0001);
/// Where px4-sim stands by default, degrees north and east.
const HOME: (f64, f64) = (47.397_743_4, 8.545_593_9);
const METRES_A_DEGREE: f64 = 111_194.93;
/// Who operates a payload, beside who flies.
pub(super) const OPERATOR: Id = Id(0x1b00_00a1);
const OPERATOR_TABLE: &str = r#"[[cucs]]
id = "1b:00:00:a1"
loi = [2, 3]
ADDRESS"#;
/// The configuration that a user would write, on ports that the system chooses.
// Port 0 lets the system choose: the demo can run beside a bridge that holds the usual ports.
const CONFIG: &str = r#"
[dli]
vsm_id = "1b:00:00:01"
listen = "127.0.0.1:0"
DLI
[[cucs]]
id = "1b:00:00:a0"
loi = [2, 3, 4, 5]
ADDRESS
OPERATOR
[store]
dir = "state"
"#;
const VEHICLE: &str = r#"
[[vehicle]]
id = "VEHICLE_ID"
LINK
system_id = SYSTEM_ID
tail_number = "TAIL"
signing = SIGNING
"#;
const RECORD: &str = r#"
[record]
dir = "OUT"
"#;
/// Of the first vehicle.
const FIRST_VEHICLE: u32 = 0x1b00_0101;
/// From a vehicle's socket to the bridge's counters, also on a busy machine.
const ON_ITS_WAY: Duration = Duration::from_millis(100);
