//! Datagrams to a computer that is not on the network wait three seconds for its ARP answer, in the socket that everybody is
//! answered by. Anybody there can have a bridge answer an address that nobody has: no frame to a vehicle waits for that, and
//! the other stations are served.
//!
//! The test starts itself in a namespace of its own. The far end of a pair of interfaces sends, and never answers ARP.

use std::net::UdpSocket;
use std::process::Command;
use std::time::{Duration, Instant};

use kit::process::{Running, program};
use kit::tools;

const INSIDE: &str = "VSM_TEST_DEAD_NEIGHBOUR";
const SET_UP: &str = "ip link set lo up && { unshare -n sleep 100 & } && FAR=$! && \
    until [ \"$(readlink /proc/$FAR/ns/net)\" != \"$(readlink /proc/self/ns/net)\" ]; do sleep 0.02; done && \
    ip link add near type veth peer name far && ip link set far netns $FAR && \
    ip addr add 10.77.87.1/24 dev near && ip link set near up && \
    MAC=$(ip -o link show near | sed 's/.*ether //; s/ .*//') && \
    nsenter -t $FAR -n sh -c \"ip link set lo up && ip addr add 10.77.87.2/24 dev far && ip link set far arp off up && \
    ip neigh add 10.77.87.1 lladdr $MAC dev far nud permanent\"";
/// 40000 of the CUCS, an acknowledgement requested, from eight ports in turn.
const SENDER: &str = "import socket,struct,time\n\
    s=[socket.socket(socket.AF_INET,socket.SOCK_DGRAM) for _ in range(8)]\n\
    b=struct.pack('!HHIIHH',0,2,0x1b0000a0,0x1b000101,40000,0x8000|(32<<8))+b'\\x08\\x03'\n\
    n=0\n\
    while True:\n    \
        s[n%8].sendto(b,('10.77.87.1',4586)); n+=1; time.sleep(0.003)\n";

#[test]
fn a_station_that_is_not_there_holds_up_neither_the_vehicle_nor_the_others() {
    if let Ok(far) = std::env::var(INSIDE) {
        return inside(&far);
    }
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
        "{SET_UP} && {INSIDE}=$FAR '{}' a_station_that_is_not_there --nocapture; ENDED=$?; kill $FAR; exit $ENDED",
        test.display()
    );
    let output = Command::new("unshare")
        .args(["-rn", "sh", "-c", &script])
        .output()
        .expect("unshare starts");
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    let faults = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success() && printed.contains("1 passed"),
        "{printed}{faults}"
    );
}

fn inside(far: &str) {
    let folder = tempfile::tempdir().expect("a folder");
    let vehicle = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let link = vehicle.local_addr().expect("its address");
    let config = folder.path().join("vsm.toml");
    let text = format!(
        "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"10.77.87.1:4586\"\n[[cucs]]\nid = \"1b:00:00:a0\"\nloi = [2, 3]\n\
         [[cucs]]\nid = \"1b:00:00:a1\"\nloi = [2]\n[[vehicle]]\nid = \"1b:00:01:01\"\nlink = \"udpout:{link}\"\n\
         system_id = 1\nsigning = \"off\"\n[store]\ndir = \"state\"\n"
    );
    std::fs::write(&config, text).expect("a file");
    let mut bridge = Running::spawn(Command::new(program("vsm")).arg("run").arg(&config));
    bridge.wait_for("ready", Duration::from_secs(20));
    let mut send = Command::new("nsenter");
    let mut sender = Running::spawn(send.args(["-t", far, "-n", "python3", "-c", SENDER]));
    let discover = std::thread::spawn(|| {
        std::thread::sleep(Duration::from_secs(5));
        let mut command = Command::new(program("cucs"));
        command.args([
            "--vsm",
            "10.77.87.1:4586",
            "--id",
            "1b:00:00:a1",
            "discover",
        ]);
        command.output().expect("cucs starts")
    });
    let longest = longest_gap(&vehicle, Duration::from_secs(14));
    assert!(
        longest < Duration::from_millis(1_900),
        "heartbeats are a second apart: {longest:?}"
    );
    let found = discover.join().expect("it ends");
    assert!(found.status.success(), "{found:?}");
    let ended = sender.wait(Duration::ZERO);
    assert!(ended.is_none(), "it sends all the time: {ended:?}");
}

/// The longest time between two frames of the bridge.
fn longest_gap(vehicle: &UdpSocket, span: Duration) -> Duration {
    vehicle
        .set_read_timeout(Some(Duration::from_millis(200)))
        .expect("set");
    let (begun, mut last, mut longest) = (Instant::now(), Instant::now(), Duration::ZERO);
    let mut bytes = [0; 300];
    while begun.elapsed() < span {
        let received = vehicle.recv(&mut bytes).is_ok();
        longest = longest.max(last.elapsed());
        if received {
            last = Instant::now();
        }
    }
    longest
}
