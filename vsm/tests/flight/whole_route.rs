//! A route is sent, loaded, launched into, flown and landed from: everything a ground station sees of it.

use kit::bridge::{Rig, orders, vehicle_id};
use stanag_msgs::Message;
use stanag_msgs::enums::{FlightPathControlMode as Mode, MissionTransferStatus};

fn reported_mode(rig: &Rig) -> Option<Mode> {
    rig.station()
        .last(vehicle_id(0), 3001, |message| match message {
            Message::VehicleOperatingModeReport(report) => report.select_flight_path_control_mode,
            _ => None,
        })
}

fn to_waypoint(rig: &Rig) -> Option<u16> {
    rig.station()
        .last(vehicle_id(0), 4001, |message| match message {
            Message::FromToNextWaypointStates(states) => states.to_waypoint_number,
            _ => None,
        })
}

#[test]
fn a_square_is_launched_flown_and_landed() {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    rig.done(orders::load());
    let status = rig
        .station()
        .last(vehicle_id(0), 14000, |message| match message {
            Message::MissionUploadDownloadStatus(status) => {
                status.status.zip(status.percent_complete)
            }
            _ => None,
        });
    assert_eq!(status, Some((MissionTransferStatus::Complete, 100)));

    rig.done(orders::launch(20.0));
    assert!(rig.until(30.0, |rig| rig.truth().position.d < -19.0));
    rig.done(orders::mode(Mode::Waypoint));
    assert!(rig.until(2.0, |rig| reported_mode(rig) == Some(Mode::Waypoint)));
    for number in 101..=104 {
        assert!(
            rig.until(60.0, |rig| to_waypoint(rig) == Some(number)),
            "never flew to {number}"
        );
    }
    // The route's end: it flies to nothing any more, and stays there.
    assert!(rig.until(60.0, |rig| to_waypoint(rig) == Some(0)));
    rig.run(5.0);
    assert!(rig.truth().position.horizontal() < 12.0);
    assert!(!rig.truth().landed);

    rig.done(orders::mode(Mode::AutolandEngage));
    assert!(rig.until(60.0, |rig| !rig.truth().armed));
    assert!(rig.truth().landed);
}
