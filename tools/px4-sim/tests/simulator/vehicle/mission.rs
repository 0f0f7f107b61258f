//! A mission is uploaded, flown within its corners' width, and ends on the ground, disarmed.

use crate::vehicle::support::*;
use px4_sim::Mode;

fn square() -> Vec<mavlink_link::service::mission::Item> {
    vec![
        takeoff(20.0),
        waypoint(100.0, 0.0, 20.0),
        waypoint(100.0, 100.0, 25.0),
        waypoint(0.0, 100.0, 20.0),
        land(0.0, 0.0),
    ]
}

const CORNERS: [(f64, f64); 5] = [
    (0.0, 0.0),
    (100.0, 0.0),
    (100.0, 100.0),
    (0.0, 100.0),
    (0.0, 0.0),
];

#[test]
fn a_square_is_flown_and_landed() {
    let mut flight = Flight::ready();
    assert_eq!(flight.upload(&square()), Some(0));
    assert_eq!(flight.command(300, &[0.0]), Some(0));
    assert!(flight.vehicle.truth().armed);
    assert!(flight.until(30.0, |t| !t.landed), "took off");
    assert!(
        flight.until(300.0, |t| !t.armed),
        "{:?}",
        flight.vehicle.truth()
    );
    for text in [
        "Armed by mission start",
        "Executing Mission",
        "Climb to 20.0 meters above home",
        "Takeoff detected",
        "Landing detected",
        "Mission finished, landed",
        "Disarmed by landing",
    ] {
        assert!(flight.has_text(text), "{text}: {:?}", flight.texts());
    }
    let off = deviation(&flight.track, &CORNERS);
    // A corner is cut within the acceptance radius of 10 m, and no further.
    assert!(off > 0.5 && off < 10.0, "{off}");
    let end = flight.vehicle.truth();
    assert!(end.position.horizontal() < 1.0, "{:?}", end.position);
    assert_eq!(end.mode, Mode::Mission);
    let highest = flight
        .track
        .iter()
        .map(|t| -t.position.d)
        .fold(0.0, f64::max);
    assert!((24.0..26.5).contains(&highest), "{highest}");
}

#[test]
fn a_landing_out_of_a_mission_leads_back_to_it_once_disarmed() {
    let mut flight = Flight::ready();
    assert_eq!(flight.upload(&square()), Some(0));
    assert_eq!(flight.command(300, &[0.0]), Some(0));
    assert!(flight.until(60.0, |t| -t.position.d > 15.0));
    assert_eq!(flight.command(176, &[1.0, 4.0, 6.0]), Some(0));
    flight.run(1.0);
    assert_eq!(flight.vehicle.truth().mode, Mode::Land);
    assert!(flight.until(60.0, |t| !t.armed));
    assert_eq!(flight.vehicle.truth().mode, Mode::Mission);
}
