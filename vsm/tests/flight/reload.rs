//! Another configuration while the bridge runs: what has not changed keeps rights, links and missions; what is taken away is
//! taken at once, with a line in the audit log; what cannot be applied leaves everything as it was.

use kit::bridge::{Rig, Setup, orders, vehicle_id};
use mavlink_link::dialect::MavMissionType;
use stanag_msgs::Message;
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode, LoiBitmap};
use vsm::session::Status;

const AUDIT: &str = "audit-1b000101.log";
const LOI: &str = "id = \"1b:00:00:a0\"\nloi = [2, 3, 4, 5]";

fn status(rig: &Rig) -> Status {
    let bridge = rig.bridge.as_ref().expect("it runs");
    bridge.status("vsm".to_owned(), rig.now().mono)
}

fn audit(rig: &Rig) -> String {
    String::from_utf8(rig.store.records[AUDIT].clone()).expect("text")
}

/// What message 2 last said that a station holds of vehicle 0.
fn granted(rig: &Rig, station: usize) -> Option<LoiBitmap> {
    rig.stations[station].last(vehicle_id(0), 2, |message| match message {
        Message::VsmAuthorisationResponse(response) => response.loi_granted,
        _ => None,
    })
}

fn changed(rig: &mut Rig, from: &str, to: &str) -> vsm::config::Report {
    let text = rig.text.replacen(from, to, 1);
    assert_ne!(text, rig.text, "{from}");
    rig.reload(&text).expect("applied")
}

fn without_table(text: &str, start: &str) -> String {
    let at = text.find(start).expect("the table");
    let length = text[at + 1..]
        .find("\n[")
        .map_or(text.len() - at, |end| end + 2);
    format!("{}{}", &text[..at], &text[at + length..])
}

#[test]
fn a_mission_flies_on_and_rights_and_links_stay_through_a_reload() {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Waypoint));
    let live = status(&rig).vehicles[0].link.live_s.expect("live");
    let lines = audit(&rig).lines().count();

    let report = changed(
        &mut rig,
        "[[vehicle]]",
        "[[cucs]]\nid = \"1b:00:00:b0\"\nloi = [2]\n[[vehicle]]",
    );
    assert_eq!(report.applied, ["cucs 1b:00:00:b0 added"]);
    assert!(report.restart.is_empty() && report.refused.is_none());
    rig.run(5.0);

    let after = &status(&rig).vehicles[0];
    assert!(
        after.link.live_s.expect("live") > live + 4.0,
        "the link was lost"
    );
    assert_eq!(after.mode, Some("AUTO.MISSION"));
    assert_eq!(after.controller.as_deref(), Some("1b:00:00:a0"));
    assert_eq!(
        audit(&rig).lines().count(),
        lines,
        "nobody's rights have changed"
    );
    rig.done(orders::mode(Mode::Loiter));
}

#[test]
fn who_loses_levels_loses_control_at_once_and_it_is_in_the_audit_log() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    let report = changed(&mut rig, LOI, "id = \"1b:00:00:a0\"\nloi = [2]");
    assert_eq!(report.applied, ["cucs 1b:00:00:a0: loi"]);
    // In the same moment, before anything else happens.
    let now = &status(&rig).vehicles[0];
    assert_eq!(
        (now.controller.as_deref(), now.rights["1b:00:00:a0"]),
        (None, 1)
    );
    let log = audit(&rig);
    let last = log.lines().last().expect("a line");
    assert!(last.contains("withdrawn by the configuration"), "{last}");
    assert!(rig.bridge.is_some());
    rig.run(1.0);
    assert_eq!(granted(&rig, 0), Some(LoiBitmap::LOI2));
    assert!(
        rig.station()
            .has_alert("nobody controls the vehicle; take control"),
        "{:?}",
        rig.station().alerts()
    );
    assert_eq!(
        rig.carry_out(orders::mode(Mode::Loiter)),
        Some(AckType::Refused)
    );
    assert_eq!(
        rig.carry_out(orders::request_control()),
        Some(AckType::Refused)
    );

    rig.restart_bridge();
    rig.run(3.0);
    assert_eq!(status(&rig).vehicles[0].controller, None);
    // Given back, it is requested again.
    changed(&mut rig, "id = \"1b:00:00:a0\"\nloi = [2]", LOI);
    assert_eq!(status(&rig).vehicles[0].controller, None);
    rig.done(orders::request_control());
}

#[test]
fn a_level_is_taken_also_where_the_disk_fails() {
    let mut rig = Rig::ready();
    rig.store.full = Some("");
    changed(&mut rig, LOI, "id = \"1b:00:00:a0\"\nloi = [2]");
    assert_eq!(status(&rig).vehicles[0].controller, None);
    assert_eq!(rig.carry_out(orders::launch(20.0)), Some(AckType::Refused));
}

#[test]
fn a_removed_station_is_not_listened_to_and_another_takes_over() {
    let mut rig = Rig::new(Setup {
        stations: 2,
        ..Setup::default()
    });
    rig.run(9.0);
    let ticket = rig.send_as(0, 0, orders::request_control());
    assert_eq!(rig.end_as(0, ticket), Some(AckType::CarriedOut));
    // Its address is proven by then.
    rig.run(5.0);
    let text = without_table(&rig.text, "[[cucs]]");
    let report = rig.reload(&text).expect("applied");
    assert_eq!(report.applied, ["cucs 1b:00:00:a0 removed"]);
    rig.run(1.0);
    assert_eq!(granted(&rig, 0), Some(LoiBitmap::NONE));
    let received = rig.station().received.len();
    let ticket = rig.send(orders::launch(20.0));
    rig.run(15.0);
    assert!(rig.station().answers(ticket).is_empty());
    assert_eq!(
        rig.station().received.len(),
        received,
        "it is sent nothing more"
    );
    assert!(rig.truth().landed);
    let after = status(&rig);
    assert!(after.stations.iter().all(|one| one.id != "1b:00:00:a0"));
    assert!(after.refused.get("unauthorised source") > 0);
    let ticket = rig.send_as(1, 0, orders::request_control());
    assert_eq!(rig.end_as(1, ticket), Some(AckType::CarriedOut));
}

#[test]
fn a_vehicle_is_added_on_the_same_link_and_removed_again() {
    let mut rig = Rig::new(Setup {
        vehicles: vec![px4_sim::Config::default(); 2],
        stations: 2,
        one_link: true,
        ..Setup::default()
    });
    // The bridge begins with the second alone.
    let both = rig.text.clone();
    let second = without_table(&both, "[[vehicle]]");
    rig.reload(&second).expect("applied");
    rig.run(9.0);
    let ticket = rig.send_as(1, 1, orders::request_control());
    assert_eq!(rig.end_as(1, ticket), Some(AckType::CarriedOut));
    let live = status(&rig).vehicles[0].link.live_s.expect("live");

    let report = rig.reload(&both).expect("applied");
    assert_eq!(report.applied, ["vehicle 1b:00:01:01 added"]);
    rig.run(9.0);
    let ids: Vec<_> = status(&rig)
        .vehicles
        .into_iter()
        .map(|one| (one.id, one.live))
        .collect();
    assert_eq!(
        ids,
        [
            ("1b:00:01:02".to_owned(), true),
            ("1b:00:01:01".to_owned(), true)
        ]
    );
    assert!(status(&rig).vehicles[0].link.live_s.expect("live") > live + 8.0);
    let ticket = rig.send_as(0, 0, orders::request_control());
    assert_eq!(rig.end_as(0, ticket), Some(AckType::CarriedOut));
    let ticket = rig.send_as(0, 0, orders::launch(20.0));
    assert_eq!(rig.end_as(0, ticket), Some(AckType::CarriedOut));
    assert!(
        rig.bridge
            .as_ref()
            .is_some_and(|one| one.is_flying(vehicle_id(0)))
    );
    assert!(
        rig.bridge
            .as_ref()
            .is_some_and(|one| !one.is_flying(vehicle_id(1)))
    );

    let report = rig
        .reload(&without_table(&both, "[[vehicle]]"))
        .expect("applied");
    assert_eq!(report.applied, ["vehicle 1b:00:01:01 removed"]);
    rig.run(1.0);
    assert_eq!(granted(&rig, 0), Some(LoiBitmap::NONE));
    let left = status(&rig).vehicles;
    assert_eq!((left.len(), left[0].id.as_str()), (1, "1b:00:01:02"));
    assert_eq!(left[0].controller.as_deref(), Some("1b:00:00:a1"));
    let ticket = rig.send_as(1, 1, orders::launch(20.0));
    assert_eq!(rig.end_as(1, ticket), Some(AckType::CarriedOut));
    // Who held it before asks again.
    rig.reload(&both).expect("applied");
    assert_eq!(status(&rig).vehicles[1].controller, None);
}

#[test]
fn limits_and_areas_count_from_the_reload_on() {
    let mut rig = Rig::ready();
    let key = "signing = { key_file = \"uav.key\" }\n";
    let area = "area = [{ keep = \"in\", centre = [47.3977434, 8.5455939], radius_m = 400 }]\n";
    let limits = "limits = { highest_m = 10 }\n";
    let report = changed(&mut rig, key, &format!("{key}{limits}{area}"));
    assert_eq!(report.applied, ["vehicle 1b:00:01:01: limits, area"]);
    rig.send_plan(orders::square());
    assert_eq!(rig.carry_out(orders::load()), Some(AckType::Refused));
    rig.run(10.0);
    let aboard = |rig: &Rig| {
        rig.vehicles[0]
            .vehicle()
            .plan(MavMissionType::MAV_MISSION_TYPE_FENCE)
            .len()
    };
    assert_eq!(aboard(&rig), 1, "{:?}", rig.station().alerts());
    let text = rig.text.replacen(&format!("{limits}{area}"), "", 1);
    rig.reload(&text).expect("applied");
    rig.run(10.0);
    assert_eq!(aboard(&rig), 0);
    // The upload that was refused was dropped whole.
    rig.send_plan(orders::square());
    rig.done(orders::load());
}

#[test]
fn what_waits_for_a_restart_is_named_each_time_and_the_rest_applied() {
    let mut rig = Rig::ready();
    let text = rig
        .text
        .replacen(
            "listen = \"127.0.0.1:4586\"",
            "listen = \"127.0.0.1:4587\"",
            1,
        )
        .replacen("udpin:127.0.0.1:14550", "udpin:127.0.0.1:14551", 1)
        .replacen("dir = \"state\"", "dir = \"other\"", 1)
        + "[authority]\nwarn_s = 4.0\n[mavlink]\nsystem_id = 244\n";
    for applied in [&["authority.warn_s"][..], &[]] {
        let report = rig.reload(&text).expect("applied");
        assert_eq!(report.applied, applied);
        assert_eq!(
            report.restart,
            [
                "dli.listen",
                "store",
                "mavlink",
                "vehicle 1b:00:01:01: link"
            ]
        );
    }
    rig.run(2.0);
    assert_eq!(status(&rig).vehicles[0].link.state, "live");
    // A new vehicle where the running one still is, that would be gone after a restart.
    let second = "[[vehicle]]\nid = \"1b:00:01:02\"\nlink = \"udpin:127.0.0.1:14550\"\nsystem_id = 1\n\
                  signing = { key_file = \"uav2.key\" }\n";
    let why = rig.reload(&format!("{text}{second}")).expect_err("refused");
    assert!(
        why.contains("vehicle.system_id") && why.contains("until a restart"),
        "{why}"
    );
    assert_eq!(status(&rig).vehicles.len(), 1);
}

#[test]
fn what_cannot_be_read_of_a_new_vehicle_leaves_everything_as_it_was() {
    let mut rig = Rig::ready();
    let good = rig.text.clone();
    let text = without_table(&good, "[[cucs]]")
        + "[[cucs]]\nid = \"1b:00:00:b0\"\nloi = [2]\n\
           [[vehicle]]\nid = \"1b:00:01:02\"\nlink = \"udpin:127.0.0.1:14551\"\nsystem_id = 2\n\
           signing = { key_file = \"uav2.key\" }\n";
    let record = ("authority-1b000102.json".to_owned(), b"{".to_vec());
    rig.store.records.insert(record.0.clone(), record.1);
    let why = rig.reload(&text).expect_err("refused");
    assert!(why.contains("authority-1b000102"), "{why}");
    let after = status(&rig);
    let stations: Vec<_> = after.stations.iter().map(|one| one.id.as_str()).collect();
    assert_eq!((stations, after.vehicles.len()), (vec!["1b:00:00:a0"], 1));
    rig.done(orders::launch(20.0));
    rig.store.records.remove(&record.0);
    rig.reload(&text).expect("applied");
}

#[test]
fn a_command_that_a_restart_cut_off_counts_as_refused_when_its_station_is_listed_again() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    let hold = rig.send(orders::mode(Mode::Loiter));
    rig.run(0.02);
    assert_eq!(rig.station().end(hold), None, "too late for this test");
    rig.stations[0].give_up(hold);
    let with = rig.text.clone();
    let other = with.replacen("1b:00:00:a0", "1b:00:00:c0", 1);
    let log = |rig: &Rig| {
        let bytes = rig.store.records["commands-1b0000a0.log"].clone();
        String::from_utf8(bytes).expect("text")
    };
    rig.restart_with(&other);
    rig.run(2.0);
    let last = log(&rig).lines().last().expect("a line").to_owned();
    assert!(last.ends_with(" 1 12 -"), "it was cut off: {last}");
    rig.reload(&with).expect("applied");
    // Who repeats it is answered so, with rights or without.
    let refused = last.replace(" 1 12 -", " 1 12 3");
    assert!(
        log(&rig).lines().any(|line| line == refused),
        "{}",
        log(&rig)
    );
}
