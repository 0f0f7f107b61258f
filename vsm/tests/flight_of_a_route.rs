//! A route is sent, loaded, launched into, flown and landed from: everything a ground station sees of it.

mod support;

use sim::px4::Mode as Px4;
use stanag_msgs::Message;
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode, MissionTransferStatus};
use support::{Rig, orders, vehicle_id};

/// Sends every message, then waits until each is carried out.
fn send_plan(rig: &mut Rig, plan: Vec<Message>) {
    let tickets: Vec<_> = plan.into_iter().map(|message| rig.tell(message)).collect();
    for ticket in tickets {
        assert_eq!(rig.end(ticket), Some(AckType::CarriedOut));
    }
}

fn reported_mode(rig: &Rig) -> Option<Mode> {
    rig.station().last(vehicle_id(0), 3001, |message| match message {
        Message::VehicleOperatingModeReport(report) => report.select_flight_path_control_mode,
        _ => None,
    })
}

fn to_waypoint(rig: &Rig) -> Option<u16> {
    rig.station().last(vehicle_id(0), 4001, |message| match message {
        Message::FromToNextWaypointStates(states) => states.to_waypoint_number,
        _ => None,
    })
}

#[test]
fn a_square_is_launched_flown_and_landed() {
    let mut rig = Rig::ready();
    send_plan(&mut rig, orders::square());
    assert_eq!(rig.carry_out(orders::load()), Some(AckType::CarriedOut));
    let status = rig.station().last(vehicle_id(0), 14000, |message| match message {
        Message::MissionUploadDownloadStatus(status) => status.status.zip(status.percent_complete),
        _ => None,
    });
    assert_eq!(status, Some((MissionTransferStatus::Complete, 100)));

    assert_eq!(
        rig.carry_out(orders::launch(20.0)),
        Some(AckType::CarriedOut),
        "{:?}",
        rig.station().alerts()
    );
    assert!(rig.until(30.0, |rig| rig.truth().position.d < -19.0));
    assert_eq!(
        rig.carry_out(orders::mode(Mode::Waypoint)),
        Some(AckType::CarriedOut)
    );
    assert!(rig.until(2.0, |rig| reported_mode(rig) == Some(Mode::Waypoint)));
    for number in 101..=104 {
        assert!(
            rig.until(60.0, |rig| to_waypoint(rig) == Some(number)),
            "never flew to {number}"
        );
    }
    assert!(rig.until(90.0, |rig| rig.truth().mode == Px4::Loiter));
    assert!(rig.truth().position.horizontal() < 10.0);

    assert_eq!(
        rig.carry_out(orders::mode(Mode::AutolandEngage)),
        Some(AckType::CarriedOut)
    );
    assert!(rig.until(60.0, |rig| !rig.truth().armed));
    assert!(rig.truth().landed);
}
