//! What a restart of the bridge knows of a station of Edition 2.5, and the ids of vehicles that are not there yet.

use kit::bridge::{Rig, Setup, VSM, vehicle_id};
use serde_json::json;
use stanag_msgs::ed25;

use super::*;

#[test]
fn a_holder_is_sent_its_edition_after_a_restart_before_it_has_spoken() {
    let (mut rig, mut station) = rig();
    // As Amendment 1 calls the edition: that is kept too.
    station.version = "9";
    let granted = request(&mut rig, &mut station, 0x0f, 1);
    assert_eq!(granted[0]["LOI Granted"], 0x0f, "{granted:?}");
    rig.run(1.0);
    rig.restart_bridge();
    let first = rig.others.len();
    rig.run(5.0);
    let of_station = || {
        let new = rig.others.get(first..).unwrap_or_default().iter();
        new.filter(|(to, _)| *to == station.address)
    };
    assert!(of_station().count() > 5, "status goes on");
    for (_, bytes) in of_station() {
        for frame in ed25::frames(bytes) {
            let header = frame.expect("Edition 2.5").header;
            assert_eq!(header.version, ed25::Version::Amendment1);
        }
    }
    assert!(!station.take(&rig, 101).is_empty());
    // Nor is its name free for another edition.
    let beat = stanag_msgs::Message::from(stanag_msgs::messages::Heartbeat::default());
    let mut bytes = [0; 548];
    let envelope = stanag_msgs::Envelope::new(CUCS, vehicle_id(0));
    let length = beat.encode(&envelope, &mut bytes).unwrap();
    rig.deliver_from(station.address, &bytes[..length]);
    rig.run(0.3);
    let bridge = rig.bridge.as_ref().unwrap();
    let status = bridge.status(String::new(), rig.now().mono);
    assert_eq!(status.refused.get("another edition"), 1);
}

#[test]
fn a_logical_id_becomes_the_real_one_by_message_20() {
    const LOGICAL: Id = Id(7);
    let mut rig = Rig::new(Setup {
        tables: TABLES,
        vehicle_keys: "logical_id = \"00:00:00:07\"",
        ..Setup::default()
    });
    let mut station = StationEd25::new(CUCS, ([127, 0, 0, 2], 41_000).into());
    // Before the vehicle has said anything it is offered and granted by its logical id.
    station.send(&mut rig, Id::BROADCAST, 1, &json!({ "VSM ID": -1 }));
    rig.run(0.1);
    let offers = station.take(&rig, 21);
    assert_eq!(offers[0]["Vehicle ID"], LOGICAL.0, "{offers:?}");
    assert_eq!(offers[0]["VSM ID"], VSM.0);
    let fields = json!({
        "VSM ID": -1, "Requested/Handover LOI": 0x0f, "Controlled Station Mode": 1,
    });
    station.send(&mut rig, LOGICAL, 1, &fields);
    rig.run(0.1);
    let granted = station.take(&rig, 21);
    assert!(
        granted
            .iter()
            .any(|one| one["LOI Granted"] == 0x0f && one["Vehicle ID"] == LOGICAL.0),
        "{granted:?}"
    );
    rig.run(12.0);
    let ids = station.take(&rig, 20);
    let change = ids.iter().position(|one| {
        one["Vehicle ID"] == LOGICAL.0 && one["Vehicle ID Update"] == vehicle_id(0).0
    });
    assert!(change.is_some(), "{ids:?}");
    let states = station.take(&rig, 101);
    assert!(
        states
            .iter()
            .all(|one| one["Vehicle ID"] == vehicle_id(0).0)
    );
    assert!(!states.is_empty());
    // Who still uses the logical id means that vehicle, with the rights that it has of it.
    let up = json!({ "Altitude Command Type": 1, "Commanded Altitude": 20.0, "Altitude Type": 2 });
    station.send(&mut rig, LOGICAL, 43, &up);
    rig.run(0.1);
    station.send(
        &mut rig,
        LOGICAL,
        42,
        &json!({ "Select Flight Path Control Mode": 21 }),
    );
    let up = rig.until(60.0, |rig| -rig.truth().position.d > 18.0);
    assert!(up, "{:?}", station.alerts(&rig));
}

#[test]
fn a_name_that_is_guarded_is_no_way_around_by_edition_2_5() {
    let of = |keys: &str| format!("[[cucs]]\nid = \"1b:00:00:b0\"\nloi = [2, 3, 4, 5]\n{keys}\n");
    for (keys, from, name) in [
        (
            "edition = \"4\"",
            [127, 0, 0, 2],
            "another edition than configured",
        ),
        (
            "edition = \"3\"",
            [127, 0, 0, 2],
            "another edition than configured",
        ),
        (
            "address = \"127.0.0.2\"",
            [127, 0, 0, 9],
            "unauthorised address",
        ),
    ] {
        let tables: &'static str = Box::leak(of(keys).into_boxed_str());
        let mut rig = Rig::new(Setup {
            tables,
            ..Setup::default()
        });
        rig.run(2.0);
        let mut station = StationEd25::new(CUCS, (from, 41_000).into());
        assert!(request(&mut rig, &mut station, 0x0f, 2).is_empty());
        let bridge = rig.bridge.as_ref().unwrap();
        let status = bridge.status(String::new(), rig.now().mono);
        assert_eq!(status.refused.get(name), 1, "{keys}: {:?}", status.refused);
        assert!(
            rig.others.iter().all(|(to, _)| *to != station.address),
            "{keys}"
        );
    }
}

/// What `vsm doctor` prints of a station, entered in its `[[cucs]]`, fixes how it is spoken to.
#[test]
fn the_profile_that_is_proposed_fixes_the_edition() {
    let (mut rig, mut station) = ready();
    let status = rig.bridge.as_ref().unwrap();
    let status = status.status(String::new(), rig.now().mono);
    let own = status
        .stations
        .iter()
        .find(|one| one.id == CUCS.to_string());
    let lines = own.expect("the station").profile.join("\n");
    assert_eq!(lines, "edition = \"2.5\"");
    let text = rig.text.replace(TABLES, &format!("{TABLES}{lines}\n"));
    assert_ne!(text, rig.text);
    rig.reload(&text).expect("a configuration");
    station.take(&rig, 101);
    rig.run(2.0);
    assert!(
        !station.take(&rig, 101).is_empty(),
        "it is served as before"
    );
    let beat = stanag_msgs::Message::from(stanag_msgs::messages::Heartbeat::default());
    let mut bytes = [0; 548];
    let envelope = stanag_msgs::Envelope::new(CUCS, vehicle_id(0));
    let length = beat.encode(&envelope, &mut bytes).unwrap();
    // Later than a station may come back in another edition by itself.
    rig.run(15.0);
    rig.deliver_from(station.address, &bytes[..length]);
    rig.run(0.3);
    let bridge = rig.bridge.as_ref().unwrap();
    let status = bridge.status(String::new(), rig.now().mono);
    assert_eq!(status.refused.get("another edition than configured"), 1);
}
