//! Network namespaces of `cargo xtask faults`: hosts on three switches, and cables that can be pulled.
//!
//! The switches (bridges) stand in a namespace of their own, so that nothing of it is seen in the machine's own network, and
//! one deletion takes everything away. A cut is a port that leaves its switch: what is sent into it disappears without an
//! error, as behind a cable that was pulled elsewhere. A link that is down, or a blackhole route, would be an error of the
//! sender, which it does not see in the field.

use std::fs::{self, File};
use std::os::fd::AsFd as _;
use std::process::{Command, Stdio};
use std::thread;

use anyhow::{Context as _, Result, anyhow, bail};
use rustix::thread::{LinkNameSpaceType, move_into_link_name_space};

/// A switch, and with it a subnet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Net {
    /// Nodes and vehicles: 10.77.0.0.
    Air,
    /// Nodes and members of etcd: 10.78.0.0.
    Store,
    /// Nodes and stations: 10.79.0.0.
    Dli,
}

impl Net {
    pub(super) const ALL: [Net; 3] = [Net::Air, Net::Store, Net::Dli];

    pub(super) fn name(self) -> &'static str {
        match self {
            Net::Air => "air",
            Net::Store => "store",
            Net::Dli => "dli",
        }
    }

    fn subnet(self) -> u8 {
        match self {
            Net::Air => 77,
            Net::Store => 78,
            Net::Dli => 79,
        }
    }

    /// The address of a host in it.
    pub(super) fn address(self, host: Host) -> String {
        format!("10.{}.0.{}", self.subnet(), host.number())
    }
}

/// A computer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Host {
    /// One that can serve the VSM.
    Node(usize),
    /// A member of etcd.
    Member(usize),
    /// All vehicles.
    Vehicles,
    /// The stations.
    Station,
    /// Where `vsm fleet list` is asked.
    Operator,
}

impl Host {
    fn all() -> Vec<Host> {
        let nodes = (0..NODES).map(Host::Node);
        let members = (0..NODES).map(Host::Member);
        let others = [Host::Vehicles, Host::Station, Host::Operator];
        nodes.chain(members).chain(others).collect()
    }

    fn name(self) -> String {
        match self {
            Host::Node(node) => format!("n{node}"),
            Host::Member(member) => format!("e{member}"),
            Host::Vehicles => "v".to_owned(),
            Host::Station => "s".to_owned(),
            Host::Operator => "m".to_owned(),
        }
    }

    fn number(self) -> usize {
        match self {
            Host::Node(node) => 11 + node,
            Host::Member(member) => 21 + member,
            Host::Vehicles => 31,
            Host::Station => 41,
            Host::Operator => 51,
        }
    }

    fn nets(self) -> &'static [Net] {
        match self {
            Host::Node(_) => &Net::ALL,
            Host::Member(_) | Host::Operator => &[Net::Store],
            Host::Vehicles => &[Net::Air],
            Host::Station => &[Net::Dli],
        }
    }
}

/// The node that a frame with this source address was sent by: addresses of IP move, those of Ethernet do not.
pub(super) fn node_of(mac: &[u8]) -> Option<usize> {
    let number = usize::from(*mac.get(5)?);
    let ours = mac.starts_with(&[2, 0, 0, 0]);
    (ours && (11..11 + NODES).contains(&number)).then(|| number - 11)
}

fn mac(host: Host, net: Net) -> String {
    format!("02:00:00:00:{:02x}:{:02x}", net.subnet(), host.number())
}

/// The network of one world. Dropped, it is gone, with whatever still runs in it.
#[derive(Debug)]
pub(super) struct Network {
    prefix: String,
}

impl Network {
    /// Lays it out.
    pub(super) fn new(prefix: String) -> Result<Network> {
        let network = Network { prefix };
        network.add("sw")?;
        for net in Net::ALL {
            // Without snooping, which would keep the group from members that have not reported themselves yet.
            let bridge = format!(
                "link add {} type bridge mcast_snooping 0 forward_delay 0",
                net.name()
            );
            network.inside("sw", &bridge)?;
            network.inside("sw", &format!("link set {} up", net.name()))?;
        }
        for host in Host::all() {
            network.add(&host.name())?;
            for net in host.nets() {
                network.plug_in(host, *net)?;
            }
        }
        Ok(network)
    }

    fn add(&self, name: &str) -> Result<()> {
        ip(&format!("netns add {}{name}", self.prefix))?;
        self.inside(name, "link set lo up")
    }

    fn plug_in(&self, host: Host, net: Net) -> Result<()> {
        let (name, on) = (host.name(), net.name());
        let mac = mac(host, net);
        let switch = format!("{}sw", self.prefix);
        let link =
            format!("link add {on} address {mac} type veth peer name {name}{on} netns {switch}");
        self.inside(&name, &link)?;
        self.inside(
            &name,
            &format!("addr add {}/24 dev {on}", net.address(host)),
        )?;
        self.inside(&name, &format!("link set {on} up"))?;
        self.inside("sw", &format!("link set {name}{on} master {on} up"))
    }

    fn inside(&self, name: &str, words: &str) -> Result<()> {
        ip(&format!("-n {}{name} {words}", self.prefix))
    }

    /// The namespace of a host.
    pub(super) fn namespace(&self, host: Host) -> String {
        format!("{}{}", self.prefix, host.name())
    }

    /// A command on a host.
    pub(super) fn command(&self, host: Host, program: &std::ffi::OsStr) -> Command {
        let mut command = Command::new("ip");
        command
            .args(["netns", "exec", &self.namespace(host)])
            .arg(program);
        command
    }

    /// Pulls a cable.
    pub(super) fn cut(&self, host: Host, net: Net) -> Result<()> {
        self.inside(
            "sw",
            &format!("link set {}{} nomaster", host.name(), net.name()),
        )
    }

    /// Plugs it in again.
    pub(super) fn join(&self, host: Host, net: Net) -> Result<()> {
        let (name, on) = (host.name(), net.name());
        self.inside("sw", &format!("link set {name}{on} master {on}"))
    }

    /// Lets a cable carry 128 kbit/s towards the switch and back, or again as much as it can.
    pub(super) fn slow(&self, host: Host, net: Net, slow: bool) -> Result<()> {
        let verb = if slow { "add" } else { "del" };
        let how = if slow {
            "tbf rate 128kbit burst 4kb latency 500ms"
        } else {
            ""
        };
        for (namespace, device) in [
            (host.name(), net.name().to_owned()),
            ("sw".to_owned(), format!("{}{}", host.name(), net.name())),
        ] {
            let mut tc = Command::new("tc");
            tc.args([
                "-n",
                &format!("{}{namespace}", self.prefix),
                "qdisc",
                verb,
                "dev",
                &device,
                "root",
            ]);
            run(tc.args(how.split_whitespace()))?;
        }
        Ok(())
    }

    /// Has vehicles send to this node from now on, as the announcement of VRRP does.
    ///
    /// Every node has the address all the time, so that one that does not know that it was replaced continues to send from it:
    /// with an address that is taken away in time, the system would refuse to send, and nothing would be seen of the fence.
    pub(super) fn move_address(&self, to: usize) -> Result<()> {
        let mac = mac(Host::Node(to), Net::Air);
        self.inside(
            "v",
            &format!("neigh replace {VIP} lladdr {mac} dev air nud permanent"),
        )
    }

    /// Does something on a thread of this host: the sockets that it opens are that host's.
    pub(super) fn on<T: Send + 'static>(
        &self,
        host: Host,
        work: impl FnOnce() -> Result<T> + Send + 'static,
    ) -> Result<T> {
        let namespace = self.namespace(host);
        let thread = thread::spawn(move || {
            let file = File::open(format!("/run/netns/{namespace}")).context("the namespace")?;
            move_into_link_name_space(file.as_fd(), Some(LinkNameSpaceType::Network))
                .context("entering the namespace")?;
            work()
        });
        thread
            .join()
            .map_err(|_| anyhow!("the thread on {host:?} panicked"))?
    }

    /// Gives a node the address that vehicles send to, and has it ask for neighbours in its own name: the default is to ask
    /// as the address that the datagram is from, and the vehicle would note the wrong node for it.
    pub(super) fn give_address(&self, node: usize) -> Result<()> {
        let name = Host::Node(node).name();
        self.inside(&name, &format!("addr add {VIP}/24 dev air"))?;
        self.on(Host::Node(node), || {
            fs::write("/proc/sys/net/ipv4/conf/all/arp_announce", "2").context("arp_announce")
        })
    }
}

impl Drop for Network {
    fn drop(&mut self) {
        let names = Host::all().into_iter().map(Host::name);
        for name in names.chain(["sw".to_owned()]) {
            let namespace = format!("{}{name}", self.prefix);
            kill_all_in(&namespace);
            let _ = ip(&format!("netns del {namespace}"));
        }
    }
}

/// Ends, by their ids, what still runs in a namespace: what a process of ours has started and left.
fn kill_all_in(namespace: &str) {
    let pids = Command::new("ip")
        .args(["netns", "pids", namespace])
        .output();
    let pids = pids.map(|output| output.stdout).unwrap_or_default();
    for pid in String::from_utf8_lossy(&pids).split_whitespace() {
        let pid = pid.parse().ok().and_then(rustix::process::Pid::from_raw);
        if let Some(pid) = pid {
            let _ = rustix::process::kill_process(pid, rustix::process::Signal::KILL);
        }
    }
}

fn ip(words: &str) -> Result<()> {
    run(Command::new("ip").args(words.split_whitespace()))
}

/// Runs a command to its end; its error is what it printed.
pub(super) fn run(command: &mut Command) -> Result<()> {
    let output = command
        .stdin(Stdio::null())
        .output()
        .with_context(|| format!("{command:?}"))?;
    if !output.status.success() {
        let printed = String::from_utf8_lossy(&output.stderr);
        bail!("{command:?}: {}", printed.trim());
    }
    Ok(())
}

/// Nodes, and members of etcd.
pub(super) const NODES: usize = 3;
/// The address that vehicles send to.
pub(super) const VIP: &str = "10.77.0.100";
