//! Two computers that can serve one VSM, as two programs with folders of their own, and an etcd that Debian packs: whoever is
//! killed, stopped or cut off, one node serves, and what was acknowledged is kept.
//!
//! Both nodes have the same addresses, as two computers have that share one by VRRP: a node binds them when it takes over.

use std::fs;
use std::process::Command;
use std::time::{Duration, Instant};

use kit::etcd::Etcd;
use kit::process::{Running, program, write_key};
use vsm_tests::ground::Ground;

use super::survives::station;

/// Two nodes with their cluster.
struct Fleet {
    ground: Ground,
    etcd: Etcd,
}

impl Fleet {
    /// `None` where there is no etcd on this computer.
    fn new(members: usize) -> Option<Fleet> {
        if !kit::tools::is_installed("etcd") {
            return None;
        }
        let (ground, etcd) = (Ground::new(), Etcd::start(members));
        write_key(&ground.path("fleet.key"), &[0x5a; 32]);
        let text = fs::read_to_string(ground.path("vsm.toml")).expect("the configuration");
        for node in NODES {
            let store = format!(
                "dir = \"{node}\"\nkind = \"etcd\"\nendpoints = {}\nnode = \"{node}\"\nkey_file = \"fleet.key\"\nlease_s = 2\n",
                etcd.endpoints()
            );
            let text = text.replace("dir = \"state\"\n", &store);
            fs::write(ground.path(&format!("{node}.toml")), text).expect("a configuration");
        }
        Some(Fleet { ground, etcd })
    }

    fn node(&self, node: &str) -> Running {
        let config = self.ground.path(&format!("{node}.toml"));
        let mut command = Command::new(program("vsm"));
        command.arg("run").arg("--config").arg(config);
        Running::spawn(&mut command)
    }

    /// `vsm fleet move`, under way.
    fn moving(&self) -> Running {
        let mut command = Command::new(program("vsm"));
        command.args(["fleet", "move", "--config"]);
        command.arg(self.ground.path("alpha.toml"));
        Running::spawn(&mut command)
    }

    /// `vsm fleet ...`, to its end: whether it succeeded, and what it printed.
    fn order(&self, words: &[&str]) -> (bool, String) {
        let config = self.ground.path("alpha.toml").display().to_string();
        let mut arguments = vec!["fleet"];
        arguments.extend(words);
        arguments.extend(["--config", &config]);
        let (done, printed) = kit::process::run_in(&self.ground.path(""), "vsm", &arguments);
        (done, String::from_utf8_lossy(&printed).into_owned())
    }
}

#[test]
fn a_node_that_is_killed_is_replaced_and_nothing_acknowledged_is_lost() {
    let Some(fleet) = Fleet::new(1) else { return };
    let mut alpha = fleet.node("alpha");
    alpha.wait_for("ready", START);
    let mut beta = fleet.node("beta");
    beta.wait_for("standing by: alpha serves", START);
    let aircraft = fleet.ground.aircraft();
    station(&fleet.ground, "prepare", &[&alpha, &aircraft]);

    let killed = Instant::now();
    alpha.kill();
    beta.wait_for("ready", START);
    let took = killed.elapsed();
    assert!(took < TAKEN_OVER, "{took:?}");
    // Plan, right, duplicates and the clock of the signatures are those of alpha.
    station(&fleet.ground, "resume", &[&beta, &aircraft]);

    // Alpha's folder is older by now: it takes beta's state, not its own.
    let mut alpha = fleet.node("alpha");
    alpha.wait_for("standing by: beta serves", START);
    let (done, printed) = fleet.order(&["move"]);
    assert!(done, "{printed}");
    assert!(
        printed.contains("alpha serves in place of beta"),
        "{printed}"
    );
    assert!(
        beta.wait(START).is_some(),
        "it was drained: {}",
        beta.output()
    );
    alpha.wait_for("ready", START);
    let (done, printed) = fleet.order(&["list"]);
    assert!(
        done && printed.contains("alpha serves (epoch 3)"),
        "{printed}"
    );
    let (done, printed) = fleet.order(&["list", "--json"]);
    assert!(
        done && printed.contains(r#"{"owner":"alpha","epoch":3,"#),
        "{printed}"
    );
    alpha.terminate();
    assert!(
        alpha.wait(START).is_some_and(|status| status.success()),
        "{}",
        alpha.output()
    );
}

#[test]
fn a_move_that_is_killed_leaves_no_vehicle_without_a_ground() {
    let Some(fleet) = Fleet::new(1) else { return };
    let mut alpha = fleet.node("alpha");
    alpha.wait_for("ready", START);
    // A node that takes part, and never takes over: the move waits for it.
    fleet.etcd.put("vsm/1b000001/node/beta", "{}");
    let mut order = fleet.moving();
    fails(&mut alpha, "this node is drained");
    order.kill();
    // As the service manager does. Nobody resumes it.
    let mut alpha = fleet.node("alpha");
    alpha.wait_for("ready", START);
}

/// `VSM_TAKE_OVERS=50` measures: from the kill of the node that serves until the next one does.
#[test]
#[expect(clippy::print_stderr, reason = "figures are printed")]
fn one_node_after_the_other_is_killed_and_replaced() {
    let Some(fleet) = Fleet::new(1) else { return };
    let times = std::env::var("VSM_TAKE_OVERS")
        .ok()
        .and_then(|text| text.parse().ok());
    let times: usize = times.unwrap_or(2);
    let mut serves = fleet.node("alpha");
    serves.wait_for("ready", START);
    let mut took = Vec::new();
    for turn in 0..times {
        let mut next = fleet.node(NODES[(turn + 1) % 2]);
        next.wait_for("standing by", START);
        let killed = Instant::now();
        serves.kill();
        next.wait_for("ready", START);
        took.push(killed.elapsed());
        serves = next;
    }
    took.sort();
    let at = |part: usize| took[(took.len() - 1) * part / 100];
    eprintln!(
        "{times} take-overs: p50 {:?}, p99 {:?}, longest {:?}",
        at(50),
        at(99),
        at(100)
    );
    assert!(at(100) < TAKEN_OVER, "{took:?}");
}

#[test]
fn a_node_that_stood_still_ends_when_it_finds_another_in_its_place() {
    let Some(fleet) = Fleet::new(1) else { return };
    let mut alpha = fleet.node("alpha");
    alpha.wait_for("ready", START);
    let mut beta = fleet.node("beta");
    beta.wait_for("standing by", START);
    alpha.signal("STOP");
    // The addresses are alpha's as long as its process is there: beta owns the VSM, and reports why it cannot serve yet.
    beta.wait_for("alpha", START);
    fails(&mut beta, "in use");
    alpha.signal("CONT");
    // Beta's lease ended with it, and the epoch is another.
    fails(&mut alpha, "another node has served since");
}

#[test]
fn without_etcd_a_node_takes_no_command_and_continues_when_it_is_back() {
    let Some(mut fleet) = Fleet::new(3) else {
        return;
    };
    let mut alpha = fleet.node("alpha");
    alpha.wait_for("ready", START);
    let aircraft = fleet.ground.aircraft();
    // One member of three is none too many.
    fleet.etcd.kill_member(0);
    station(&fleet.ground, "prepare", &[&alpha, &aircraft]);
    fleet.etcd.kill_member(1);
    alpha.wait_for(
        "it answers no station and commands no vehicle until there is one",
        START,
    );
    let discover = ["--vsm", &fleet.ground.dli(), "discover"];
    let (answered, printed) = kit::process::run_in(&fleet.ground.path(""), "cucs", &discover);
    assert!(!answered, "{}", String::from_utf8_lossy(&printed));
    fleet.etcd.start_member(0);
    alpha.wait_for("etcd has renewed the lease of this node", START);
    // Its own state, and the same link: nothing was started again.
    station(&fleet.ground, "resume", &[&alpha, &aircraft]);
}

#[test]
fn two_nodes_of_one_name_and_an_etcd_that_was_set_back_are_refused() {
    let Some(fleet) = Fleet::new(1) else { return };
    let mut alpha = fleet.node("alpha");
    alpha.wait_for("ready", START);
    // The same name on another computer: another folder.
    let text = fs::read_to_string(fleet.ground.path("alpha.toml")).expect("its configuration");
    let text = text.replace("dir = \"alpha\"", "dir = \"copy\"");
    fs::write(fleet.ground.path("copy.toml"), text).expect("a configuration");
    let mut copy = fleet.node("copy");
    fails(&mut copy, "a node \"alpha\" takes part already");
    alpha.terminate();
    assert!(alpha.wait(START).is_some());

    // Another cluster knows nothing of what alpha has served.
    let empty = Etcd::start(1);
    let text = fs::read_to_string(fleet.ground.path("alpha.toml")).expect("its configuration");
    let text = text.replace(&fleet.etcd.endpoints(), &empty.endpoints());
    fs::write(fleet.ground.path("alpha.toml"), text).expect("a configuration");
    let mut alpha = fleet.node("alpha");
    fails(&mut alpha, "etcd was set back");
}

/// Waits until a node ends with an error, and with this in what it printed.
fn fails(node: &mut Running, why: &str) {
    let end = node.wait(START);
    let printed = node.output();
    assert!(end.is_some_and(|status| !status.success()), "{printed}");
    assert!(printed.contains(why), "{printed}");
}

const NODES: [&str; 2] = ["alpha", "beta"];
/// A lease of 2 s, and the start of a bridge, on a computer that does much else. docs/guide/fleet.md has what it takes with nothing else to do.
const TAKEN_OVER: Duration = Duration::from_secs(15);
const START: Duration = Duration::from_secs(60);
