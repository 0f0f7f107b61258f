//! One vehicle between a station of Edition 4 and one of Edition 2.5.

use kit::bridge::{cucs, vehicle_id};
use serde_json::json;
use stanag_msgs::Message;
use stanag_msgs::enums::{AckType, LoiBitmap};
use stanag_msgs::messages::PositiveHandoverAuthorisationRequest;

use super::*;

/// The CUCSs that #21s name as holders of vehicle 0.
fn shown(rig: &Rig, station: &mut StationEd25) -> Vec<(u64, u64)> {
    let lines = station.take(rig, 21);
    let pairs = lines
        .iter()
        .filter_map(|one| Some((one["CUCS ID"].as_u64()?, one["LOI Granted"].as_u64()?)));
    pairs.collect()
}

#[test]
fn each_sees_the_other_hold_the_vehicle_and_hands_it_over() {
    let (mut rig, mut station) = rig();
    assert_eq!(
        rig.carry_out(orders::request_control()),
        Some(AckType::CarriedOut)
    );
    rig.run(1.0);
    // The station of Edition 2.5 finds the holder when it discovers.
    station.send(&mut rig, Id::BROADCAST, 1, &json!({ "VSM ID": -1 }));
    rig.run(0.5);
    let lines = shown(&rig, &mut station);
    assert!(lines.contains(&(cucs(0).0.into(), 0x0f)), "{lines:?}");
    // It is refused what another holds, and asks for a handover: the holder is sent its wish, and consents.
    let refused = request(&mut rig, &mut station, LOI_4_AND_5, 1);
    assert_eq!(refused[0]["LOI Granted"].as_u64().unwrap() & 0x0c, 0);
    station.send(
        &mut rig,
        vehicle_id(0),
        1,
        &json!({
            "VSM ID": -1, "Requested/Handover LOI": LOI_4_AND_5, "Controlled Station Mode": 1,
            "Wait for Vehicle Data Link Transition Coordination Message": 1,
        }),
    );
    rig.run(1.0);
    let consent = PositiveHandoverAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::from_raw(LOI_4_AND_5)),
        requesting_cucs_id: Some(CUCS),
        ..PositiveHandoverAuthorisationRequest::default()
    };
    assert_eq!(
        rig.carry_out(Message::from(consent)),
        Some(AckType::CarriedOut)
    );
    rig.run(1.0);
    let lines = shown(&rig, &mut station);
    assert!(
        lines
            .iter()
            .any(|(id, levels)| *id == u64::from(CUCS.0) && levels & 0x0c == 0x0c),
        "{lines:?}"
    );
    let statuses = station.take(&rig, 700);
    assert_eq!(statuses.last().unwrap()["Status"], 2, "successful");
    // And back: #600 names the acquiring station, which accepts by its request.
    station.send(
        &mut rig,
        vehicle_id(0),
        600,
        &json!({ "Acquiring CUCS ID": cucs(0).0 as i32 }),
    );
    rig.run(0.5);
    assert_eq!(
        rig.carry_out(orders::request_control()),
        Some(AckType::CarriedOut),
        "{:?}",
        station.alerts(&rig)
    );
    rig.run(1.0);
    let lines = shown(&rig, &mut station);
    assert!(
        lines
            .iter()
            .any(|(id, levels)| *id == u64::from(cucs(0).0) && levels & 0x0c == 0x0c),
        "{lines:?}"
    );
}
