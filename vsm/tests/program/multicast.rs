//! Bridges and ground stations in one multicast group, in two network namespaces joined by a veth pair: by IPv4 and IPv6,
//! with two bridges, two stations, two sockets at each, a source filter, and loss.
//!
//! The test starts itself in a namespace of its own; the stations run in a second one, which is a child of it.

use std::net::{SocketAddr, UdpSocket};
use std::path::PathBuf;
use std::process::{Command, Output};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use dli_group::{Group, Interface};
use kit::process::{Running, program};
use kit::tools;
use tempfile::TempDir;

const INSIDE: &str = "VSM_TEST_FAR_NAMESPACE";
const LIMIT: Duration = Duration::from_secs(20);

/// Two namespaces: `near` is here, `far` with process `$FAR`. Addresses of IPv6 are usable at once (`nodad`).
const SET_UP: &str = "ip link set lo up && { unshare -n sleep 100 & } && FAR=$! && \
    until [ \"$(readlink /proc/$FAR/ns/net)\" != \"$(readlink /proc/self/ns/net)\" ]; do sleep 0.02; done && \
    ip link add near type veth peer name far && ip link set far netns $FAR && \
    ip addr add 10.77.86.1/24 dev near && ip -6 addr add fd00:4586::1/64 dev near nodad && \
    ip link set near up multicast on && \
    nsenter -t $FAR -n sh -c 'ip link set lo up && ip addr add 10.77.86.2/24 dev far && \
    ip addr add 10.77.86.3/24 dev far && ip -6 addr add fd00:4586::2/64 dev far nodad && ip link set far up multicast on'";

#[test]
fn a_group_joins_bridges_and_stations_of_two_namespaces() {
    let Ok(far) = std::env::var(INSIDE) else {
        return start_inside();
    };
    let scene = Scene::new(far);
    scene.as_typed_in_the_guide();
    scene.ipv4_with_two_bridges_and_two_stations();
    scene.each_edition_in_one_group();
    scene.ipv6();
    scene.one_socket_for_ipv4_and_ipv6();
    scene.sources_are_those_that_are_listed();
    scene.through_loss();
    scene.two_makes_through_loss();
}

fn start_inside() {
    let mut probe = Command::new("unshare");
    probe.args([
        "-rn",
        "sh",
        "-c",
        &format!("{SET_UP}; ENDED=$?; kill $FAR; exit $ENDED"),
    ]);
    let needed = "two network namespaces (unshare -rn, nsenter) with a pair of interfaces (ip link add type veth)";
    if !tools::works(needed, &mut probe) {
        return;
    }
    let test = std::env::current_exe().expect("this test");
    let script = format!(
        "{SET_UP} && {INSIDE}=$FAR '{}' a_group_joins_bridges_and_stations --nocapture; ENDED=$?; kill $FAR; exit $ENDED",
        test.display()
    );
    let output = Command::new("unshare")
        .args(["-rn", "sh", "-c", &script])
        .output();
    let output = output.expect("unshare starts");
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    let faults = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success() && printed.contains("1 passed"),
        "{printed}{faults}"
    );
}

struct Scene {
    far: String,
    folder: TempDir,
}

impl Scene {
    fn new(far: String) -> Scene {
        let folder = tempfile::tempdir().expect("a folder");
        Scene { far, folder }
    }

    /// A bridge with this number and one vehicle, in the group; two stations may connect.
    fn bridge(&self, number: u8, group: &str, keys: &str) -> Running {
        self.bridge_at("127.0.0.1:0", number, group, keys)
    }

    /// The same with further keys of each station.
    fn bridge_of_makes(&self, group: &str, of_stations: [&str; 2]) -> Running {
        self.started("127.0.0.1:0", 1, group, "", of_stations)
    }

    /// The same that listens elsewhere; where stations can reach it, they are answered at their own addresses too.
    fn bridge_at(&self, listen: &str, number: u8, group: &str, keys: &str) -> Running {
        self.started(listen, number, group, keys, ["", ""])
    }

    fn started(
        &self,
        listen: &str,
        number: u8,
        group: &str,
        keys: &str,
        of_stations: [&str; 2],
    ) -> Running {
        let delivery = if listen.starts_with("127.") {
            "group"
        } else {
            "both"
        };
        let path = self
            .folder
            .path()
            .join(format!("vsm-{number}-{}", group.len()));
        std::fs::create_dir_all(&path).expect("a folder");
        let station = |id, keys: &str| {
            format!(
                "[[cucs]]\nid = \"1b:00:00:{id}\"\nloi = [2, 3, 4, 5]\ndelivery = \"{delivery}\"\n{keys}\n"
            )
        };
        let text = format!(
            "[dli]\nvsm_id = \"1b:00:00:0{number}\"\nlisten = \"{listen}\"\nmulticast = \"{group}\"\n\
             interface = \"near\"\n{keys}\n{}{}[[vehicle]]\nid = \"1b:00:01:0{number}\"\nlink = \"udpin:127.0.0.1:0\"\n\
             system_id = 1\nsigning = \"off\"\n[store]\ndir = \"state\"\n",
            station("a0", of_stations[0]),
            station("a1", of_stations[1]),
        );
        let config: PathBuf = path.join("vsm.toml");
        std::fs::write(&config, text).expect("a file");
        let mut command = Command::new(program("vsm"));
        let mut running = Running::spawn(command.arg("run").arg(&config));
        running.wait_for("ready", LIMIT);
        running
    }

    /// What a station on the other side does.
    fn cucs(&self, id: &str, group: &str, interface: &str, words: &str) -> Output {
        let mut command = Command::new("nsenter");
        command.args(["-t", &self.far, "-n"]).arg(program("cucs"));
        command.args(["--multicast", group, "--interface", interface, "--id"]);
        command.arg(format!("1b:00:00:{id}")).args(words.split(' '));
        command.output().expect("nsenter starts")
    }

    fn done(&self, id: &str, group: &str, words: &str) -> String {
        let output = self.cucs(id, group, "far", words);
        let printed = text(&output);
        assert!(output.status.success(), "{id} {words}: {printed}");
        printed
    }

    fn ipv4_with_two_bridges_and_two_stations(&self) {
        const GROUP: &str = "239.45.86.1:26001";
        let _bridges = [1, 2].map(|number| self.bridge(number, GROUP, ""));
        for station in ["a0", "a1"] {
            let printed = self.done(station, GROUP, "discover");
            for vehicle in ["1b:00:01:01", "1b:00:01:02"] {
                assert!(printed.contains(vehicle), "{station}: {printed}");
            }
        }
        // Each controls one; the answers of one are not the other's.
        self.done("a0", GROUP, "--vehicle 1b:00:01:01 take");
        self.done("a1", GROUP, "--vehicle 1b:00:01:02 take");
        let refused = self.cucs("a1", GROUP, "far", "--vehicle 1b:00:01:01 take");
        assert_eq!(refused.status.code(), Some(1), "{}", text(&refused));
        self.done("a0", GROUP, "--vehicle 1b:00:01:01 release");
        // An interface by its address is the same one; one that is not there is named with those that are.
        let by_address = self.cucs("a0", GROUP, "10.77.86.2", "discover");
        assert!(by_address.status.success(), "{}", text(&by_address));
        let unknown = self.cucs("a0", GROUP, "eth9", "discover");
        assert_eq!(unknown.status.code(), Some(2));
        assert!(
            text(&unknown).contains("eth9 is no interface of this computer: expected one of"),
            "{}",
            text(&unknown)
        );
    }

    /// The file and the command of docs/guide/connecting-a-cucs.md, letter by letter.
    fn as_typed_in_the_guide(&self) {
        let guide = include_str!("../../../docs/guide/connecting-a-cucs.md");
        let (_, section) = guide
            .split_once("## In a multicast group")
            .expect("the section");
        let (_, config) = section.split_once("```toml\n").expect("the file");
        let (config, rest) = config.split_once("```").expect("its end");
        let line = rest
            .lines()
            .find_map(|line| line.trim().strip_prefix("cucs "));
        let folder = self.folder.path().join("guide");
        std::fs::create_dir_all(&folder).expect("a folder");
        std::fs::write(folder.join("vsm.toml"), config).expect("a file");
        let mut command = Command::new(program("vsm"));
        let mut bridge = Running::spawn(command.args(["run", "vsm.toml"]).current_dir(&folder));
        bridge.wait_for("ready", LIMIT);
        let words = line.expect("the command").split(' ');
        let output = Command::new(program("cucs"))
            .args(words)
            .output()
            .expect("it starts");
        let printed = text(&output);
        assert!(
            output.status.success() && printed.contains("1b:00:01:01"),
            "{printed}"
        );
    }

    /// Stations of three editions share the group and the bridge; each is answered in its own.
    fn each_edition_in_one_group(&self) {
        const GROUP: &str = "239.45.86.5:26008";
        let _bridge = self.bridge(1, GROUP, "");
        for (station, edition) in [("a0", "2.5"), ("a1", "3")] {
            let words = |words: &str| format!("--edition {edition} {words}");
            let printed = self.done(station, GROUP, &words("discover"));
            assert!(printed.contains("1b:00:01:01"), "{edition}: {printed}");
            self.done(station, GROUP, &words("take"));
            self.done(station, GROUP, &words("release"));
        }
        // Its id in another edition, from the same address, while it speaks its own.
        let other = self.cucs("a0", GROUP, "far", "--edition 4 discover");
        assert!(!other.status.success(), "{}", text(&other));
        let unknown = self.cucs("a0", GROUP, "far", "--edition 2 discover");
        assert_eq!(unknown.status.code(), Some(2));
        assert!(
            text(&unknown).contains("expected 2.5, 3 or 4"),
            "{}",
            text(&unknown)
        );
    }

    fn ipv6(&self) {
        for group in ["[ff15::4586]:26002", "[ff12::45:86]:26003"] {
            let _bridge = self.bridge(1, group, "ttl = 2");
            let hops = self.hops(group, 2);
            let printed = self.done("a0", group, "discover");
            assert!(printed.contains("1b:00:01:01"), "{printed}");
            hops.arrived();
        }
    }

    /// `[::]` is every address of both kinds; each station is answered where it is, and the group as configured.
    fn one_socket_for_ipv4_and_ipv6(&self) {
        const GROUP: &str = "239.45.86.6:26009";
        let _bridge = self.bridge_at("[::]:26010", 1, GROUP, "ttl = 7");
        let hops = self.hops(GROUP, 7);
        for vsm in ["10.77.86.1:26010", "[fd00:4586::1]:26010"] {
            for edition in ["2.5", "4"] {
                let id = if edition == "4" { "a0" } else { "a1" };
                let mut command = Command::new("nsenter");
                command.args(["-t", &self.far, "-n"]).arg(program("cucs"));
                command.args(["--vsm", vsm, "--edition", edition, "--id"]);
                command.arg(format!("1b:00:00:{id}")).arg("discover");
                let output = command.output().expect("nsenter starts");
                let printed = text(&output);
                assert!(output.status.success(), "{vsm} {edition}: {printed}");
                assert!(
                    printed.contains("1b:00:01:01"),
                    "{vsm} {edition}: {printed}"
                );
            }
        }
        hops.arrived();
    }

    /// Waits on the other side for a datagram of the group that has taken this many hops from its start: none, so that it
    /// arrives with all of them.
    fn hops(&self, group: &str, hops: u8) -> Hops {
        let mut command = Command::new("nsenter");
        command.args(["-t", &self.far, "-n", "python3", "-c", HOPS, group]);
        let mut listens = Running::spawn(command.arg(hops.to_string()));
        listens.wait_for("listens", LIMIT);
        Hops(listens)
    }

    fn sources_are_those_that_are_listed(&self) {
        const GROUP: &str = "239.45.86.2:26004";
        let _bridge = self.bridge(1, GROUP, "sources = [\"10.77.86.2\"]");
        self.done("a0", GROUP, "discover");
        let stranger = self.cucs("a0", GROUP, "10.77.86.3", "discover");
        assert!(!stranger.status.success(), "{}", text(&stranger));
        const SIX: &str = "[ff15::4587]:26005";
        let bridge = self.bridge(1, SIX, "sources = [\"fd00:4586::9\"]");
        let stranger = self.cucs("a0", SIX, "far", "discover");
        assert!(!stranger.status.success(), "{}", text(&stranger));
        drop(bridge);
    }

    fn through_loss(&self) {
        const HERE: &str = "239.45.86.3:26006";
        const THERE: &str = "239.45.86.4:26007";
        let lossy = Lossy::between(HERE, THERE);
        let _bridge = self.bridge(1, HERE, "");
        for _ in 0..3 {
            self.done("a0", THERE, "take");
            self.done("a0", THERE, "release");
            self.done("a1", THERE, "--edition 2.5 take");
            self.done("a1", THERE, "--edition 2.5 release");
        }
        assert!(lossy.lost.load(Relaxed) > 3, "something was lost");
    }

    /// Two makes of Edition 2.5 at once: one calls it 2.5, the other 9 (Amendment 1), each with readings of its own for what
    /// it would send in a later edition. The second listens, and sees the first take control and release it.
    fn two_makes_through_loss(&self) {
        const HERE: &str = "239.45.86.7:26011";
        const THERE: &str = "239.45.86.8:26012";
        let lossy = Lossy::between(HERE, THERE);
        let _bridge = self.bridge_of_makes(
            HERE,
            [
                "disputed = { ack_type = \"0,1,2\" }",
                "disputed = { ack_type = \"3,2,1\", turn_rate_step = \"0.005\" }",
            ],
        );
        let mut command = Command::new("nsenter");
        command.args(["-t", &self.far, "-n", "python3", "-c", OTHER_MAKE]);
        let interop = kit::workspace().join("tests/interop");
        let mut listens = Running::spawn(command.arg(interop).arg(THERE));
        listens.wait_for("listens", LIMIT);
        self.done("a0", THERE, "--edition 2.5 take");
        listens.wait_for("the other controls", LIMIT);
        self.done("a0", THERE, "--edition 2.5 release");
        let ended = listens.wait(LIMIT);
        assert!(
            ended.is_some_and(|status| status.success()),
            "{}",
            listens.output()
        );
        assert!(lossy.lost.load(Relaxed) > 3, "something was lost");
    }
}

/// Who looks at the hop limit of what arrives.
struct Hops(Running);

impl Hops {
    fn arrived(mut self) {
        self.0.wait_for("arrived", LIMIT);
    }
}

/// Of what stations send the limit is 1.
const HOPS: &str = r#"
import socket, struct, sys
host, port = sys.argv[1].rsplit(":", 1)
host, six, index = host.strip("[]"), "[" in host, socket.if_nametoindex("far")
s = socket.socket(socket.AF_INET6 if six else socket.AF_INET, socket.SOCK_DGRAM)
s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
if six:
    s.bind((host, int(port), 0, index))
    s.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_JOIN_GROUP, socket.inet_pton(socket.AF_INET6, host) + struct.pack("@I", index))
    s.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_RECVHOPLIMIT, 1)
else:
    s.bind((host, int(port)))
    s.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(host) + struct.pack("@II", 0, index))
    s.setsockopt(socket.IPPROTO_IP, 12, 1)  # IP_RECVTTL
print("listens", flush=True)
while True:
    _, control, _, _ = s.recvmsg(2048, 64)
    limits = [struct.unpack("@i", data[:4])[0] for _, _, data in control]
    if int(sys.argv[2]) in limits:
        print("arrived", flush=True)
        break
"#;

/// A station of Amendment 1 on the reference codec alone: LOI 2, the other in control, release.
const OTHER_MAKE: &str = r#"
import argparse, sys
sys.path.insert(0, sys.argv[1])
import cucs_ed25 as ed25
plain = ed25.oracle.encode
ed25.oracle.encode = lambda value: plain({"idd": "9", **value})
own, other = (ed25.identification(f"1b:00:00:{id}") for id in ("a1", "a0"))
cucs = ed25.Cucs(argparse.Namespace(id=own, slow=1.0, bind="10.77.86.3", vsm=None, interface="10.77.86.3",
                                    group=ed25.address(sys.argv[2])))
request = {"VSM_ID": ed25.BROADCAST, "Data_Link_ID": ed25.NULL}
offer = cucs.ask("discovery", 1, 10, 21, lambda f: f["CUCS ID"] == own, Vehicle_ID=ed25.BROADCAST, **request)
cucs.vehicle = offer["Vehicle ID"]
cucs.ask("LOI 2", 1, 10, 21, lambda f: f["CUCS ID"] == own and f["LOI Granted"] == 1,
         Controlled_Station_Mode=1, **request, **{"Requested/Handover_LOI": 1})
print("listens", flush=True)
cucs.ask("the other controls", 1, 15, 21, lambda f: f["CUCS ID"] == other and f["LOI Granted"] & 12 == 12,
         Vehicle_ID=ed25.BROADCAST, **request)
cucs.ask("release", 1, 10, 21, lambda f: f["CUCS ID"] == own and f["LOI Granted"] == 0, Controlled_Station_Mode=0, **request)
assert {m["idd"] for m in cucs.inbox if m["fields"]["CUCS ID"] == own} == {"9"}, "answered in its own version"
assert not cucs.faults, cucs.faults
"#;

fn text(output: &Output) -> String {
    let [out, err] =
        [&output.stdout, &output.stderr].map(|one| String::from_utf8_lossy(one).into_owned());
    out + &err
}

/// Carries datagrams between two groups on the interface `near`, and loses each fifth.
struct Lossy {
    ended: Arc<AtomicBool>,
    lost: Arc<AtomicU64>,
    carrier: Option<JoinHandle<()>>,
}

impl Lossy {
    fn between(here: &str, there: &str) -> Lossy {
        let groups = [here, there].map(|group| Group {
            interface: Some(Interface::Name("near".to_owned())),
            ..Group::new(group.parse().expect("a group"))
        });
        let members = groups
            .each_ref()
            .map(|group| group.receiver().expect("it joins"));
        let senders: [UdpSocket; 2] = groups
            .each_ref()
            .map(|group| group.sender(0).expect("it sends"));
        let own: [SocketAddr; 2] = senders
            .each_ref()
            .map(|one| one.local_addr().expect("an address"));
        let (ended, lost) = (
            Arc::new(AtomicBool::new(false)),
            Arc::new(AtomicU64::new(0)),
        );
        let (ends, counts) = (ended.clone(), lost.clone());
        let carrier = thread::spawn(move || {
            let (mut bytes, mut random) = ([0; 2_048], fastrand::Rng::with_seed(86));
            while !ends.load(Relaxed) {
                for side in [0, 1] {
                    while let Ok((length, from)) = members[side].recv_from(&mut bytes) {
                        if own.contains(&from) {
                            continue;
                        }
                        if random.u8(..5) == 0 {
                            counts.fetch_add(1, Relaxed);
                            continue;
                        }
                        let to = 1 - side;
                        let _ = senders[to].send_to(&bytes[..length], groups[to].address);
                    }
                }
                thread::sleep(Duration::from_millis(1));
            }
        });
        Lossy {
            ended,
            lost,
            carrier: Some(carrier),
        }
    }
}

impl Drop for Lossy {
    fn drop(&mut self) {
        self.ended.store(true, Relaxed);
        if let Some(carrier) = self.carrier.take() {
            let _ = carrier.join();
        }
    }
}
