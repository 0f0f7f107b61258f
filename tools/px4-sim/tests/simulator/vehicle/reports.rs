//! Units, signs and frames of the reports, compared with the true state.

use crate::vehicle::support::*;
use mavlink::dialects::development::{MavLandedState, MavMessage};
use px4_sim::Config;

#[test]
fn positions_velocities_and_attitude_agree() {
    let mut flight = Flight::ready();
    let plan = [
        takeoff(30.0),
        waypoint(200.0, 150.0, 60.0),
        waypoint(400.0, 300.0, 60.0),
    ];
    assert_eq!(flight.upload(&plan), Some(0));
    assert_eq!(flight.command(300, &[0.0]), Some(0));
    assert!(flight.until(120.0, |t| t.mission_seq == 1 && t.position.n > 60.0));
    flight.run(0.02);
    let truth = flight.vehicle.truth();
    let near = |a: f64, b: f64, by: f64, what: &str| assert!((a - b).abs() < by, "{what}: {a} {b}");
    let home = Config::default().home;
    let last = |pick: fn(&MavMessage) -> bool| flight.last(|m| pick(m).then(|| m.clone())).unwrap();

    let MavMessage::GLOBAL_POSITION_INT(g) =
        last(|m| matches!(m, MavMessage::GLOBAL_POSITION_INT(_)))
    else {
        unreachable!()
    };
    near(
        f64::from(g.lat) * 1e-7,
        truth.place.latitude_deg,
        1e-5,
        "latitude",
    );
    near(
        f64::from(g.lon) * 1e-7,
        truth.place.longitude_deg,
        1e-5,
        "longitude",
    );
    near(
        f64::from(g.alt) * 1e-3,
        truth.place.altitude_m,
        0.8,
        "altitude AMSL",
    );
    near(
        f64::from(g.relative_alt) * 1e-3,
        truth.place.altitude_m - home.altitude_m,
        0.8,
        "above home",
    );
    near(f64::from(g.vx) * 1e-2, truth.velocity.n, 0.2, "north");
    near(f64::from(g.vy) * 1e-2, truth.velocity.e, 0.2, "east");
    near(f64::from(g.vz) * 1e-2, truth.velocity.d, 0.2, "down");
    let heading = truth.attitude[2].to_degrees().rem_euclid(360.0);
    near(f64::from(g.hdg) * 1e-2, heading, 1.0, "heading");
    near(heading, 36.9, 6.0, "toward the waypoint");
    assert!(
        truth.attitude[1] < -0.1,
        "nose down when flying forward: {:?}",
        truth.attitude
    );

    let MavMessage::GPS_RAW_INT(r) = last(|m| matches!(m, MavMessage::GPS_RAW_INT(_))) else {
        unreachable!()
    };
    near(
        f64::from(r.alt_ellipsoid - r.alt) * 1e-3,
        47.4,
        1e-3,
        "geoid separation",
    );
    near(
        f64::from(r.vel) * 1e-2,
        truth.velocity.horizontal(),
        0.5,
        "ground speed",
    );
    near(
        f64::from(r.cog) * 1e-2,
        truth.velocity.bearing().to_degrees(),
        10.0,
        "course",
    );

    let MavMessage::LOCAL_POSITION_NED(l) =
        last(|m| matches!(m, MavMessage::LOCAL_POSITION_NED(_)))
    else {
        unreachable!()
    };
    near(f64::from(l.z), truth.position.d, 0.8, "down is positive");
    let MavMessage::ATTITUDE(a) = last(|m| matches!(m, MavMessage::ATTITUDE(_))) else {
        unreachable!()
    };
    near(f64::from(a.roll), truth.attitude[0], 0.05, "roll");
    near(f64::from(a.pitch), truth.attitude[1], 0.05, "pitch");
    let MavMessage::EXTENDED_SYS_STATE(e) =
        last(|m| matches!(m, MavMessage::EXTENDED_SYS_STATE(_)))
    else {
        unreachable!()
    };
    assert_eq!(e.landed_state, MavLandedState::MAV_LANDED_STATE_IN_AIR);
    let MavMessage::VFR_HUD(v) = last(|m| matches!(m, MavMessage::VFR_HUD(_))) else {
        unreachable!()
    };
    near(f64::from(v.alt), truth.place.altitude_m, 2.0, "AMSL again");
    assert!(v.airspeed.is_nan(), "no airspeed sensor");
}

#[test]
fn the_streams_have_the_rates_of_the_reference() {
    let mut flight = Flight::ready();
    let mark = flight.received.len();
    flight.run(20.0);
    let count = |pick: fn(&MavMessage) -> bool| {
        flight.received[mark..]
            .iter()
            .filter(|(_, m)| pick(m))
            .count()
    };
    for (what, got, expected) in [
        (
            "ATTITUDE",
            count(|m| matches!(m, MavMessage::ATTITUDE(_))),
            1000,
        ),
        (
            "GLOBAL_POSITION_INT",
            count(|m| matches!(m, MavMessage::GLOBAL_POSITION_INT(_))),
            1000,
        ),
        (
            "GPS_RAW_INT",
            count(|m| matches!(m, MavMessage::GPS_RAW_INT(_))),
            100,
        ),
        (
            "VFR_HUD",
            count(|m| matches!(m, MavMessage::VFR_HUD(_))),
            80,
        ),
        (
            "HEARTBEAT",
            count(|m| matches!(m, MavMessage::HEARTBEAT(_))),
            20,
        ),
        (
            "MISSION_CURRENT",
            count(|m| matches!(m, MavMessage::MISSION_CURRENT(_))),
            20,
        ),
        (
            "HOME_POSITION",
            count(|m| matches!(m, MavMessage::HOME_POSITION(_))),
            10,
        ),
        (
            "CURRENT_MODE",
            count(|m| matches!(m, MavMessage::CURRENT_MODE(_))),
            10,
        ),
    ] {
        assert!(
            got.abs_diff(expected) <= 1 + expected / 100,
            "{what}: {got}, expected {expected}"
        );
    }
}
