//! An agent whose ground is lost, or orders it to erase itself, as processes.

use std::fs::{self, OpenOptions};
use std::io::Write as _;
use std::time::Duration;

use kit::process::Running;

use super::field::Field;

fn names(field: &Field, folder: &str) -> Vec<String> {
    let entries = fs::read_dir(field.path(folder)).expect("a folder");
    let name = |one: std::io::Result<fs::DirEntry>| one.expect("an entry").file_name();
    let mut names: Vec<String> = entries
        .map(|one| name(one).to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// It has ended by itself, and left no key.
fn is_erased(field: &Field, folder: &str, mut program: Running) {
    let status = program.wait(Duration::from_secs(30)).expect("it ends");
    assert_eq!(status.code(), Some(3), "{}", program.output());
    assert_eq!(
        names(field, &format!("{folder}/state")),
        ["lock", "zeroized"]
    );
    let keys = names(field, folder).into_iter();
    let left: Vec<String> = keys.filter(|name| name.ends_with(".key")).collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn a_zeroize_on_the_ground_erases_the_agent_and_replaces_px4s_key() {
    let field = Field::new(r#", exchange = "on""#);
    let aircraft = field.aircraft("1");
    let agent = field.agent();
    field.pair();
    let bridge = field.bridge();
    field.wait_until_signed();
    let key = fs::read_to_string(field.path("air/uav1.key")).expect("the key");
    let px4_before = fs::read(field.path("px4.bin")).expect("PX4's key");

    let mut ordered = field.vsm(&["zeroize", "--yes"]);
    let status = ordered.wait(Duration::from_secs(60));
    let printed = ordered.output();
    assert!(
        status.is_some_and(|one| one.success()),
        "{printed}\n{}",
        agent.output()
    );
    let done = "the agent erases itself; PX4 has taken a key that nobody keeps";
    assert!(printed.contains(done), "{printed}\n{}", agent.output());
    let log = agent.output();
    assert!(
        log.contains("ZEROIZE ORDERED by the paired ground"),
        "{log}"
    );
    assert!(!log.contains(key.trim()) && !printed.contains(key.trim()));
    is_erased(&field, "ground", bridge);
    is_erased(&field, "air", agent);
    // It signs still, with another key than both had.
    let px4_after = fs::read(field.path("px4.bin")).expect("PX4's key");
    assert_eq!(px4_after.len(), px4_before.len());
    assert_ne!(px4_after[..32], px4_before[..32]);
    assert_ne!(px4_after[..32], [0; 32]);
    drop(aircraft);
}

#[test]
fn a_bridge_without_an_agent_replaces_px4s_key_where_that_is_configured() {
    let field = Field::with_tables("", "[zeroize]\npx4_key = true\n");
    let key = field.share_key();
    field.px4_has(&key);
    // PX4 itself is at the other end.
    let file = field.path("ground/vsm.toml");
    let text = fs::read_to_string(&file).expect("the configuration");
    let agent = format!("udpout:127.0.0.1:{}", field.radio);
    let px4 = format!("udpin:127.0.0.1:{}", field.px4);
    fs::write(&file, text.replace(&agent, &px4)).expect("the configuration");
    let _aircraft = field.aircraft("1");
    let mut bridge = field.bridge();
    field.wait("live", Duration::from_secs(20), Field::is_live);
    let before = fs::read(field.path("px4.bin")).expect("PX4's key");
    let mut ordered = field.vsm(&["zeroize", "--yes"]);
    bridge.wait_for(
        "PX4 has taken a key that nobody keeps",
        Duration::from_secs(40),
    );
    assert!(
        ordered
            .wait(Duration::from_secs(60))
            .is_some_and(|one| one.success())
    );
    is_erased(&field, "ground", bridge);
    px4_has_another_key(&field, &before);
}

/// PX4 signs still, with a key that neither side has had.
fn px4_has_another_key(field: &Field, before: &[u8]) {
    let after = fs::read(field.path("px4.bin")).expect("PX4's key");
    assert_ne!(after[..32], before[..32]);
    assert_ne!(after[..32], [0; 32]);
}

/// What the ground has stored is carried out by its next start, beyond its own computer too.
#[test]
fn a_ground_that_dies_after_it_has_stored_the_order_orders_its_agent_at_its_next_start() {
    let field = Field::new(r#", exchange = "on""#);
    let _aircraft = field.aircraft("1");
    let agent = field.agent();
    field.pair();
    let mut bridge = field.bridge();
    field.wait_until_signed();
    let before = fs::read(field.path("px4.bin")).expect("PX4's key");
    // The agent answers nothing while the bridge lives, which therefore cannot have ordered it.
    agent.signal("STOP");
    let mut ordered = field.vsm(&["zeroize", "--yes"]);
    let order = field.path("ground/state/zeroize.order");
    field.wait_for_file(&order);
    bridge.kill();
    agent.signal("CONT");
    assert!(
        ordered
            .wait(Duration::from_secs(10))
            .is_some_and(|one| !one.success())
    );
    assert!(order.exists() && field.path("air/uav1.key").exists());
    // PX4 has reported that it is disarmed again.
    std::thread::sleep(Duration::from_secs(3));
    let again = field.vsm(&["run"]);
    is_erased(&field, "air", agent);
    is_erased(&field, "ground", again);
    px4_has_another_key(&field, &before);
}

/// What the agent has acknowledged is carried out by its next start, PX4's key first, and the ground does not wait for it for ever.
#[test]
fn an_agent_that_dies_after_it_has_stored_the_order_is_erased_at_its_next_start() {
    let field = Field::new(r#", exchange = "on""#);
    let _aircraft = field.aircraft("1");
    let mut agent = field.agent();
    field.pair();
    let bridge = field.bridge();
    field.wait_until_signed();
    let before = fs::read(field.path("px4.bin")).expect("PX4's key");
    let mut ordered = field.vsm(&["zeroize", "--yes"]);
    agent.wait_for(
        "ZEROIZE ORDERED by the paired ground",
        Duration::from_secs(20),
    );
    // Dropped means killed, before PX4 is given another key.
    drop(agent);
    let again = field.vsm(&["airside"]);
    is_erased(&field, "air", again);
    px4_has_another_key(&field, &before);
    let status = ordered.wait(Duration::from_secs(60));
    let printed = ordered.output();
    assert!(status.is_some_and(|one| one.success()), "{printed}");
    assert!(printed.contains("PX4 was NOT reached"), "{printed}");
    is_erased(&field, "ground", bridge);
}

#[test]
fn a_zeroize_without_a_bridge_orders_the_agent_itself() {
    let field = Field::new(r#", exchange = "on""#);
    let agent = field.agent();
    field.pair();
    let mut ordered = field.vsm(&["zeroize", "--yes"]);
    // No PX4 is there: it may fly.
    assert!(ordered.wait(Duration::from_secs(30)).is_some());
    let printed = ordered.output();
    assert!(
        printed.contains("PX4 is not known to be disarmed"),
        "{printed}"
    );
    assert_eq!(names(&field, "ground/state"), ["lock", "zeroized"]);
    assert!(field.air()["exchange"]["taken"].as_u64() > Some(0));
    drop(agent);
}

#[test]
fn a_zeroize_on_the_ground_is_done_without_the_agent_too_and_says_so() {
    let field = Field::new(r#", exchange = "on""#);
    let _aircraft = field.aircraft("1");
    let agent = field.agent();
    field.pair();
    let bridge = field.bridge();
    field.wait_until_signed();
    // PX4 is not known to be disarmed any more: what is meant in flight, too, is said so.
    drop(agent);
    let mut ordered = field.vsm(&["zeroize", "--yes", "--in-flight"]);
    let status = ordered.wait(Duration::from_secs(60));
    let printed = ordered.output();
    assert!(status.is_some_and(|one| one.success()), "{printed}");
    assert!(printed.contains("the agent was NOT reached"), "{printed}");
    is_erased(&field, "ground", bridge);
    assert!(field.path("air/uav1.key").exists());
}

#[test]
fn an_agent_whose_ground_is_lost_brings_the_vehicle_home_and_reports_it() {
    let field = Field::new("");
    let key = field.share_key();
    field.px4_has(&key);
    let mut air = OpenOptions::new()
        .append(true)
        .open(field.path("air/airside.toml"))
        .expect("the configuration");
    writeln!(air, "[contingency]\nlink_lost_s = 5.0\nlink = \"rtl\"").expect("written");
    let _aircraft = field.aircraft("4");
    let _agent = field.agent();
    let bridge = field.bridge();
    field.wait("live", Duration::from_secs(20), Field::is_live);
    field.launch();
    let shown = |field: &Field| field.air()["contingency"].to_string();
    assert!(field.air()["contingency"]["ground_lost_s"].is_null());

    drop(bridge);
    field.wait("a return", Duration::from_secs(20), |field| {
        shown(field).contains("AUTO.RTL, as for return")
    });
    let bridge = field.bridge();
    field.wait("the ground is back", Duration::from_secs(20), |field| {
        field.air()["contingency"]["ground_lost_s"].is_null()
    });
    assert!(
        shown(&field).contains("the ground is lost: return flown"),
        "{}",
        shown(&field)
    );
    field.wait("the bridge knows", Duration::from_secs(20), |_| {
        bridge
            .output()
            .contains("Agent: the ground is lost: return flown")
    });
}
