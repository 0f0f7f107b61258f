//! A mode that the vehicle accepts and leaves again at once: a take-off that ends in that moment puts PX4 into AUTO.LOITER
//! whatever it has just accepted. It is commanded once more; where another mode shows, a failsafe's or a pilot's, it is not.

use kit::bridge::{Rig, orders};
use px4_sim::{HealthFaults, Mode as Px4};
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode};

/// A route loaded, the vehicle at 20 m; mode 11 is commanded and accepted, and this mode entered instead.
fn entering_instead(mode: Px4) -> (Rig, Option<AckType>) {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.take_off(20.0);
    rig.vehicles[0]
        .vehicle_mut()
        .set_health_faults(HealthFaults {
            instead: Some(mode),
            ..HealthFaults::default()
        });
    let end = rig.carry_out(orders::mode(Mode::Waypoint));
    (rig, end)
}

#[test]
fn a_vehicle_that_holds_instead_is_commanded_again() {
    let (rig, end) = entering_instead(Px4::Loiter);
    assert_eq!(
        end,
        Some(AckType::CarriedOut),
        "{:?}",
        rig.station().alerts()
    );
    assert_eq!(rig.truth().mode, Px4::Mission);
}

#[test]
fn a_vehicle_that_returns_instead_is_left_to_it() {
    let (rig, end) = entering_instead(Px4::Rtl);
    assert_eq!(end, Some(AckType::Refused), "{:?}", rig.station().alerts());
    assert_eq!(rig.truth().mode, Px4::Rtl);
    assert!(rig.station().has_alert("it is in AUTO.RTL"));
}
