//! `vsm check-vehicle`: the same answer over a running bridge and without one, signed, and nothing is changed.

use px4_sim::{LinkAddress, Param, Simulator, SimulatorConfig};
use serde_json::Value;

use crate::ground::{FIRST, Ground, SECOND, id, is_live_under, key};

async fn vehicle(ground: &Ground, params: Vec<(Param, f64)>) -> Simulator {
    let link: LinkAddress = format!("udpout:127.0.0.1:{}", ground.link).parse().unwrap();
    let mut config = SimulatorConfig {
        key: Some(key(FIRST)),
        ..SimulatorConfig::on(link)
    };
    config.vehicle.params = params;
    Simulator::spawn(config).await.unwrap()
}

/// The findings by name: verdict and value.
async fn checked(ground: &Ground) -> (bool, Vec<(String, String, String)>) {
    let (good, printed) = ground.command(&["check-vehicle", "--json"]).await;
    let end = printed.rfind(']').unwrap_or_else(|| panic!("{printed}"));
    let all: Value = serde_json::from_str(&printed[..=end]).unwrap_or_else(|_| panic!("{printed}"));
    assert_eq!(all[0]["vehicle"], "1b:00:01:01", "{printed}");
    let settings = all[0]["settings"].as_array().unwrap();
    let text = |value: &Value| value.as_str().unwrap().to_owned();
    let findings = settings.iter().map(|one| {
        let shown = text(&one["shown"]);
        (text(&one["name"]), text(&one["verdict"]), shown)
    });
    (good, findings.collect())
}

fn of<'a>(all: &'a [(String, String, String)], name: &str) -> (&'a str, &'a str) {
    let found = all.iter().find(|(one, ..)| one == name);
    let (_, verdict, shown) = found.unwrap_or_else(|| panic!("{name}: {all:?}"));
    (verdict, shown)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn settings_are_judged_alike_over_a_bridge_and_without_one() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    let vehicle = vehicle(&ground, vec![(Param::COM_DLL_EXCEPT, 1.0)]).await;
    let (good, alone) = checked(&ground).await;
    assert!(!good, "some are weak");
    assert_eq!(of(&alone, "NAV_DLL_ACT"), ("weak", "0 (disabled)"));
    assert_eq!(of(&alone, "COM_DLL_EXCEPT"), ("weak", "1 (mission)"));
    assert_eq!(
        of(&alone, "COM_LOW_BAT_ACT"),
        ("good", "3 (return, then land)")
    );
    assert_eq!(of(&alone, "CBRK_IO_SAFETY").0, "decide");
    // The simulated vehicle, like PX4's own simulation, has no USB and no serial ports.
    assert_eq!(of(&alone, "SYS_USB_AUTO"), ("unknown", "unknown"));
    assert_eq!(of(&alone, "MAV_SIGN_CFG"), ("unknown", "unknown"));

    let _bridge = ground.start_bridge();
    ground
        .link_status("live", |link| is_live_under(link, &id(FIRST)))
        .await;
    assert_eq!(checked(&ground).await, (false, alone));

    // The bridge, the link alone and the readings by it have set nothing.
    let counters = vehicle.counters();
    assert_eq!(counters.vehicle.parameters_set, 0, "{counters:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_vehicle_whose_settings_are_good_ends_with_status_0() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    let params = vec![
        (Param::NAV_DLL_ACT, 2.0),
        (Param::SYS_FAILURE_EN, 0.0),
        (Param::CBRK_USB_CHK, 0.0),
        (Param::COM_ARM_WO_GPS, 0.0),
    ];
    let _vehicle = vehicle(&ground, params).await;
    let (good, printed) = ground.command(&["check-vehicle"]).await;
    assert!(good, "{printed}");
    assert!(printed.contains(": 0 weak,"), "{printed}");
    assert!(
        printed.contains("no such parameter: MAV_0_CONFIG"),
        "{printed}"
    );
}

/// Whoever does not have the key can say of himself what he likes.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nothing_is_believed_of_a_vehicle_with_another_key() {
    let ground = Ground::new();
    ground.write_key("uav1.key", SECOND);
    let _stranger = vehicle(&ground, vec![(Param::NAV_DLL_ACT, 2.0)]).await;
    let (good, printed) = ground.command(&["check-vehicle", "--wait-s", "4"]).await;
    assert!(
        !good && printed.contains("no answer that can be believed within 4 s"),
        "{printed}"
    );
    assert!(printed.contains(" 0 good,"), "{printed}");
    let bridge = ground.start_bridge();
    let refused = |link: &Value| link["frames"]["bad_signature"].as_u64() > Some(0);
    ground.link_status("refused", refused).await;
    let (good, printed) = ground.command(&["check-vehicle", "--wait-s", "2"]).await;
    assert!(!good && printed.contains(" 0 good,"), "{printed}");
    drop(bridge);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_store_in_use_names_the_cure() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    let _vehicle = vehicle(&ground, vec![]).await;
    let _bridge = ground.start_bridge();
    ground
        .link_status("live", |link| is_live_under(link, &id(FIRST)))
        .await;
    for (done, printed) in [
        ground.command(&["key", "rotate"]).await,
        ground.command(&["key", "clock"]).await,
    ] {
        assert!(!done, "{printed}");
        let cure = printed.contains("`vsm run`") && printed.contains("systemctl stop vsm");
        assert!(cure, "{printed}");
    }
}
