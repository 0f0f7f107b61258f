//! One world of `cargo xtask faults`: three nodes, three members of etcd, vehicles and stations in their network, and what
//! people and other programs do around them: a service manager that starts nodes again, and an address that follows the
//! node that serves.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};

use super::capture::{Captures, FIRST_PORT, GROUP_PORT, Shared};
use super::network::{Host, NODES, Net, Network, VIP, run};
use super::process::{Running, finish, interrupted};
use super::wire::Wire;

/// A world. Dropped, its processes and namespaces are gone; its folder stays for whoever made it.
#[derive(Debug)]
pub(super) struct World {
    pub(super) wire: Shared,
    pub(super) vehicles: usize,
    members: [Option<Running>; NODES],
    /// Ended before the network in which they run.
    _aircraft: Vec<Running>,
    follower: Option<JoinHandle<()>>,
    _captures: Captures,
    pub(super) computers: Arc<Computers>,
}

/// The nodes, as the follower sees them too.
#[derive(Debug)]
pub(super) struct Computers {
    nodes: [Mutex<Node>; NODES],
    stop: AtomicBool,
    pub(super) network: Network,
    pub(super) folder: PathBuf,
    pub(super) bins: PathBuf,
    faketime: Option<PathBuf>,
}

#[derive(Debug, Default)]
struct Node {
    running: Option<Running>,
    /// The service manager leaves it alone.
    held: bool,
}

/// What `vsm fleet list` shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Fleet {
    pub(super) owner: Option<usize>,
    pub(super) epoch: u64,
    pub(super) present: usize,
}

impl World {
    /// Starts everything, up to vehicles that are there.
    pub(super) fn start(
        prefix: String,
        folder: &Path,
        bins: &Path,
        vehicles: usize,
    ) -> Result<World> {
        let computers = Arc::new(Computers {
            nodes: Default::default(),
            stop: AtomicBool::new(false),
            network: Network::new(prefix)?,
            folder: folder.to_owned(),
            bins: bins.to_owned(),
            faketime: faketime(),
        });
        let wire: Shared = Arc::new(Mutex::new(Wire::new(vehicles)));
        computers.configure(vehicles)?;
        let mut members = [const { None }; NODES];
        for (member, slot) in members.iter_mut().enumerate() {
            *slot = Some(computers.member(member)?);
        }
        let captures = Captures::start(&computers.network, bins, &wire)?;
        for node in 0..NODES {
            computers.network.give_address(node)?;
            computers.start(node)?;
            // The first serves, and the others stand by.
            let word = if node == 0 { "ready" } else { "standing by" };
            let mut slot = computers.node(node);
            slot.running
                .as_mut()
                .context("it was started")?
                .wait_for(word, START)?;
        }
        computers.network.move_address(0)?;
        let aircraft = (0..vehicles).map(|number| computers.aircraft(number));
        let aircraft = aircraft.collect::<Result<Vec<_>>>()?;
        let follower = computers.clone();
        let follower = thread::spawn(move || follower.follow());
        Ok(World {
            wire,
            vehicles,
            members,
            _aircraft: aircraft,
            follower: Some(follower),
            _captures: captures,
            computers,
        })
    }

    pub(super) fn network(&self) -> &Network {
        &self.computers.network
    }

    /// Kills a member of etcd.
    pub(super) fn kill_member(&mut self, member: usize) {
        self.members[member] = None;
    }

    /// Starts it again, with what it has on its disk.
    pub(super) fn start_member(&mut self, member: usize) -> Result<()> {
        self.members[member] = Some(self.computers.member(member)?);
        Ok(())
    }

    pub(super) fn member_id(&self, member: usize) -> Result<u32> {
        let member = self.members[member]
            .as_ref()
            .context("no such member runs")?;
        Ok(member.id())
    }

    /// Waits until one node serves and the others stand by.
    pub(super) fn settled(&self, within: Duration) -> Result<(usize, u64)> {
        let end = Instant::now() + within;
        let mut seen = None;
        while Instant::now() < end {
            interrupted()?;
            seen = self.computers.list();
            if let Some(Fleet {
                owner: Some(owner),
                epoch,
                present: NODES,
            }) = seen
            {
                return Ok((owner, epoch));
            }
            thread::sleep(Duration::from_millis(200));
        }
        bail!("not all nodes are back within {within:?}: {seen:?}")
    }
}

impl Drop for World {
    fn drop(&mut self) {
        self.computers.stop.store(true, Ordering::Relaxed);
        if let Some(follower) = self.follower.take() {
            let _ = follower.join();
        }
        for node in 0..NODES {
            self.computers.node(node).running = None;
        }
    }
}

impl Computers {
    fn node(&self, node: usize) -> MutexGuard<'_, Node> {
        self.nodes[node]
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }

    fn log(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}.log"))
    }

    pub(super) fn program(&self, name: &str) -> PathBuf {
        self.bins.join(name)
    }

    /// What a node has on its disk: keys are locked by the process that signs with them, so each has copies of its own.
    fn disk(&self, node: usize) -> PathBuf {
        self.folder.join(format!("n{node}"))
    }

    /// Keys and configurations.
    fn configure(&self, vehicles: usize) -> Result<()> {
        let mut keys = vec!["fleet".to_owned()];
        keys.extend((1..=vehicles).map(|vehicle| format!("uav{vehicle}")));
        for key in keys {
            let mut keygen = std::process::Command::new(self.program("vsm"));
            let file = format!("{key}.key");
            run(keygen.arg("keygen").arg(self.folder.join(&file)))?;
            for node in 0..NODES {
                fs::create_dir_all(self.disk(node))?;
                // With its rights: a key that others can read is refused.
                fs::copy(self.folder.join(&file), self.disk(node).join(&file))?;
            }
        }
        for node in 0..NODES {
            fs::write(
                self.disk(node).join("vsm.toml"),
                configuration(node, vehicles)?,
            )?;
        }
        Ok(())
    }

    /// Starts a node.
    fn start(&self, node: usize) -> Result<()> {
        let mut command = self
            .network
            .command(Host::Node(node), self.program("vsm").as_os_str());
        command
            .arg("run")
            .arg("--config")
            .arg(self.disk(node).join("vsm.toml"));
        if let Some(library) = &self.faketime {
            let clock = self.clock(node);
            if !clock.exists() {
                fs::write(&clock, "+0")?;
            }
            command.env("LD_PRELOAD", library);
            // The wall clock alone: no step moves the monotonic one of a computer.
            command
                .env("FAKETIME_DONT_FAKE_MONOTONIC", "1")
                .env("FAKETIME_DISABLE_SHM", "1");
            command
                .env("FAKETIME_TIMESTAMP_FILE", clock)
                .env("FAKETIME_CACHE_DURATION", "1");
        }
        self.node(node).running = Some(Running::start(
            &mut command,
            &self.log(&format!("n{node}")),
        )?);
        Ok(())
    }

    fn clock(&self, node: usize) -> PathBuf {
        self.folder.join(format!("n{node}.clock"))
    }

    /// Sets a node's wall clock this far from the right time.
    pub(super) fn set_clock(&self, node: usize, offset_s: i64) -> Result<()> {
        let clock = self.clock(node);
        let new = clock.with_extension("new");
        // A file that is half written would be read as another time.
        fs::write(&new, format!("{offset_s:+}"))?;
        fs::rename(&new, &clock).context("the clock of a node")
    }

    fn member(&self, member: usize) -> Result<Running> {
        let at = |member, port: u16| {
            format!("http://{}:{port}", Net::Store.address(Host::Member(member)))
        };
        let all: Vec<_> = (0..NODES)
            .map(|one| format!("e{one}={}", at(one, 2_380)))
            .collect();
        let host = Host::Member(member);
        let mut command = self.network.command(host, OsStr::new("etcd"));
        // Without it a member that was cut off and is back has the others elect a leader again, and for seconds none answers.
        command.arg("--pre-vote");
        command
            .arg("--data-dir")
            .arg(self.folder.join(format!("e{member}.etcd")));
        command.args([
            "--name",
            &format!("e{member}"),
            "--initial-cluster",
            &all.join(","),
        ]);
        for (option, port) in [("peer", 2_380), ("client", 2_379)] {
            let url = at(member, port);
            command.args([format!("--listen-{option}-urls"), url.clone()]);
            let advertise = if option == "peer" {
                "initial-advertise-peer"
            } else {
                "advertise-client"
            };
            command.args([format!("--{advertise}-urls"), url]);
        }
        Running::start(&mut command, &self.log(&format!("e{member}")))
    }

    fn aircraft(&self, number: usize) -> Result<Running> {
        let mut command = self
            .network
            .command(Host::Vehicles, self.program("px4-sim").as_os_str());
        let port = usize::from(FIRST_PORT) + number;
        command.args(["--link", &format!("udpout:{VIP}:{port}")]);
        command.args(["--system-id", &(number + 1).to_string()]);
        command
            .arg("--key-file")
            .arg(self.folder.join(format!("uav{}.key", number + 1)));
        let mut aircraft = Running::start(&mut command, &self.log(&format!("v{number}")))?;
        aircraft.wait_for("ready", START)?;
        Ok(aircraft)
    }

    /// Kills a node; it is not started again before [`Computers::release`].
    pub(super) fn kill(&self, node: usize) {
        let mut node = self.node(node);
        node.held = true;
        node.running = None;
    }

    /// The service manager may start this node.
    pub(super) fn release(&self, node: usize) {
        self.node(node).held = false;
    }

    pub(super) fn signal(&self, node: usize, signal: rustix::process::Signal) {
        if let Some(running) = &self.node(node).running {
            running.signal(signal);
        }
    }

    pub(super) fn node_id(&self, node: usize) -> Result<u32> {
        let node = self.node(node);
        Ok(node.running.as_ref().context("no such node runs")?.id())
    }

    /// What the nodes have reported of audit logs that are not as they were left: the next owner reads and verifies them.
    pub(super) fn broken_audit_logs(&self) -> BTreeSet<String> {
        let logs = (0..NODES).map(|node| fs::read_to_string(self.log(&format!("n{node}"))));
        let mut broken = BTreeSet::new();
        for log in logs.map_while(Result::ok) {
            let reports = log
                .lines()
                .filter_map(|line| line.split_once("the audit log "));
            broken.extend(reports.map(|(_, what)| what.to_owned()));
        }
        broken
    }

    /// Runs `vsm fleet ...`: whether it succeeded, and what it printed.
    pub(super) fn order(&self, words: &[&str]) -> Result<(bool, String)> {
        let mut command = self
            .network
            .command(Host::Operator, self.program("vsm").as_os_str());
        command.arg("fleet").args(words);
        command.arg("--config").arg(self.disk(0).join("vsm.toml"));
        let name = format!("fleet-{}", words[0]);
        finish(&mut command, &self.log(&name), Duration::from_secs(20))
    }

    fn list(&self) -> Option<Fleet> {
        let (done, printed) = self.order(&["list", "--json"]).ok()?;
        let fleet: serde_json::Value = serde_json::from_str(&printed).ok().filter(|_| done)?;
        let number = |name: &str| name.strip_prefix('n').and_then(|text| text.parse().ok());
        let nodes = fleet["nodes"].as_array()?;
        let there = |node: &&serde_json::Value| node["present"] == true && node["drained"] == false;
        Some(Fleet {
            owner: fleet["owner"].as_str().and_then(number),
            epoch: fleet["epoch"].as_u64()?,
            present: nodes.iter().filter(there).count(),
        })
    }

    /// Starts nodes that have ended, and moves the address to the one that serves.
    fn follow(&self) {
        let mut at = Some(0);
        let mut down = [None; NODES];
        while !self.stop.load(Ordering::Relaxed) {
            for (node, down) in down.iter_mut().enumerate() {
                let mut slot = self.node(node);
                let ended = slot
                    .running
                    .as_mut()
                    .is_none_or(|running| running.ended().is_some());
                let due = down.get_or_insert_with(Instant::now).elapsed() > RESTART && !slot.held;
                drop(slot);
                if !ended {
                    *down = None;
                } else if due {
                    *down = None;
                    let _ = self.start(node);
                }
            }
            let owner = self.list().and_then(|fleet| fleet.owner);
            if owner.is_some() && owner != at {
                at = owner.filter(|owner| self.network.move_address(*owner).is_ok());
            }
            thread::sleep(Duration::from_millis(150));
        }
    }
}

/// The configuration of a node.
fn configuration(node: usize, vehicles: usize) -> Result<String> {
    let interface = Net::Dli.address(Host::Node(node));
    let mut text = format!(
        "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"0.0.0.0:4586\"\nmulticast = \"{GROUP}:{GROUP_PORT}\"\ninterface = \"{interface}\"\n"
    );
    for station in STATIONS {
        writeln!(
            text,
            "[[cucs]]\nid = \"{station}\"\nloi = [2, 3, 4, 5]\ndelivery = \"group\""
        )?;
    }
    for number in 0..vehicles {
        let (one, port) = (number + 1, usize::from(FIRST_PORT) + number);
        writeln!(
            text,
            "[[vehicle]]\nid = \"{}\"\nlink = \"udpin:{VIP}:{port}\"\nsystem_id = {one}\ntail_number = \"PX4-{one:02}\"\nsigning = {{ key_file = \"uav{one}.key\" }}",
            vehicle_id(number)
        )?;
    }
    let endpoints = (0..NODES)
        .map(|member| format!("http://{}:2379", Net::Store.address(Host::Member(member))));
    let endpoints: Vec<_> = endpoints.collect();
    writeln!(
        text,
        "[store]\ndir = \"state\"\nkind = \"etcd\"\nendpoints = {endpoints:?}\nnode = \"n{node}\"\nkey_file = \"fleet.key\"\nlease_s = 2"
    )?;
    Ok(text)
}

/// The id of a vehicle on the DLI.
pub(super) fn vehicle_id(number: usize) -> String {
    format!("1b:00:01:{:02x}", number + 1)
}

/// The library that steps the clock of one process, where it is installed.
pub(super) fn faketime() -> Option<PathBuf> {
    let triplet = format!("/usr/lib/{}-linux-gnu/faketime", std::env::consts::ARCH);
    let folders = [
        triplet.as_str(),
        "/usr/lib64/faketime",
        "/usr/lib/faketime",
        "/usr/local/lib/faketime",
    ];
    let mut files = folders
        .iter()
        .map(|folder| Path::new(folder).join("libfaketimeMT.so.1"));
    files.find(|file| file.exists())
}

/// The controlling station, and one that monitors.
pub(super) const STATIONS: [&str; 2] = ["1b:00:00:a0", "1b:00:00:b0"];
/// The group of the stations.
pub(super) const GROUP: &str = "239.45.86.1";
const START: Duration = Duration::from_secs(60);
/// As RestartSec of the unit.
const RESTART: Duration = Duration::from_secs(1);
