//! The experiment of the HMAC framework for drones (Sensors 2021), on the DLI: a vehicle hovers at 2 m, and from 30 s of its
//! flight on somebody sends false data for 30 s, landings in the name of its ground station. Without a guard and with one.
//!
//! `vsm demo --attack` flies the same between sockets and draws it.

use kit::bridge::flight::hold_at;
use kit::bridge::{Rig, Station, cucs, orders, station_address, vehicle_id};
use stanag_msgs::enums::{AckType, FlightPathControlMode};

use super::guarded::{ELSEWHERE, forged, refused, rig};

/// Where the false data come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Attack {
    /// Another computer, which answers what it is asked as the ground station would.
    Elsewhere,
    /// The very address and port of the ground station: somebody on the way, or a forged sender.
    SameAddress,
    /// Both, with the landing that the ground station itself has sent at the end of an earlier flight.
    Replay,
}

/// A flight under attack.
struct Flown {
    rig: Rig,
    /// During the attack, m above home.
    lowest_m: f64,
    highest_m: f64,
}

impl Flown {
    fn holds(&self) -> bool {
        let [low, high] = [HOVER_M - 0.3, HOVER_M + 0.3];
        !self.rig.truth().landed && self.lowest_m > low && self.highest_m < high
    }
}

fn altitude_m(rig: &Rig) -> f64 {
    -rig.truth().position.d
}

/// Hovers for 30 s; with the landing of an earlier flight, as it was on the network.
fn hover(guarded: bool, flown_before: bool) -> (Rig, Vec<u8>) {
    let mut rig = rig(1, if guarded { &[0] } else { &[] });
    rig.stations[0].heartbeats = true;
    rig.done(orders::request_control());
    let mut landing = Vec::new();
    if flown_before {
        rig.take_off(HOVER_M);
        landing = forged(&rig, cucs(0), vehicle_id(0), orders::mode(LAND));
        let now = rig.station_now();
        if let Some(guard) = rig.guards.get_mut(&0) {
            landing = guard.seal(now, &landing);
        }
        rig.deliver_from(station_address(0), &landing);
        let down = rig.until(60.0, |rig| rig.truth().landed && !rig.truth().armed);
        assert!(down, "its own landing counts");
    }
    rig.take_off(HOVER_M);
    // A launch ends within the acceptance of its altitude, and the vehicle holds where it is then.
    rig.done(hold_at(HOVER_M));
    rig.run(30.0);
    let up_m = altitude_m(&rig);
    assert!((up_m - HOVER_M).abs() < 0.3, "it hovers: {up_m}");
    (rig, landing)
}

fn fly(guarded: bool, attack: Attack) -> Flown {
    let (mut rig, recorded) = hover(guarded, attack == Attack::Replay);
    if attack == Attack::Elsewhere {
        let mut impostor = Station::new(cucs(0), ELSEWHERE.into());
        impostor.heartbeats = true;
        rig.stations.push(impostor);
    }
    let (mut lowest_m, mut highest_m) = (f64::MAX, f64::MIN);
    for _ in 0..SHOTS {
        match attack {
            Attack::Elsewhere => {
                let now = rig.station_now();
                rig.stations[1].send_once(now, vehicle_id(0), orders::mode(LAND).into());
            }
            Attack::SameAddress => {
                let bytes = forged(&rig, cucs(0), vehicle_id(0), orders::mode(LAND));
                rig.deliver_from(station_address(0), &bytes);
            }
            Attack::Replay => {
                rig.deliver_from(station_address(0), &recorded);
                rig.deliver_from(ELSEWHERE.into(), &recorded);
            }
        }
        rig.run(0.2);
        lowest_m = lowest_m.min(altitude_m(&rig));
        highest_m = highest_m.max(altitude_m(&rig));
    }
    Flown {
        rig,
        lowest_m,
        highest_m,
    }
}

#[test]
fn false_data_bring_a_hovering_vehicle_down_without_a_guard_and_move_it_nowhere_with_one() {
    for attack in [Attack::Elsewhere, Attack::SameAddress] {
        let open = fly(false, attack);
        assert!(open.rig.truth().landed, "{attack:?} {}", open.lowest_m);
        let mut guarded = fly(true, attack);
        let (low, high) = (guarded.lowest_m, guarded.highest_m);
        assert!(guarded.holds(), "{attack:?} {low} to {high} m");
        let forgeries = refused(&guarded.rig, "guard: no trailer");
        assert!(forgeries >= SHOTS, "{attack:?} {forgeries}");
        // Its own ground station has been served all the time, and lands it.
        let end = guarded.rig.carry_out(orders::mode(LAND));
        assert_eq!(end, Some(AckType::CarriedOut), "{attack:?}");
    }
}

#[test]
fn a_recorded_landing_moves_it_nowhere_without_a_guard_either_and_with_one_is_not_even_read() {
    // Without a guard it is the time stamp that was used before: whoever writes another one into it is the attack above.
    let open = fly(false, Attack::Replay);
    assert!(open.holds(), "{} to {} m", open.lowest_m, open.highest_m);
    let guarded = fly(true, Attack::Replay);
    let (low, high) = (guarded.lowest_m, guarded.highest_m);
    assert!(guarded.holds(), "{low} to {high} m");
    let counted: u64 = [
        "guard: replayed",
        "guard: too old",
        "guard: held back on its way",
    ]
    .iter()
    .map(|name| refused(&guarded.rig, name))
    .sum();
    assert_eq!(counted, 2 * SHOTS);
}

const LAND: FlightPathControlMode = FlightPathControlMode::AutolandEngage;
const HOVER_M: f64 = 2.0;
/// Of the attack: five a second.
const SHOTS: u64 = 150;
