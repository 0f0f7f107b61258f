//! The track that wings fly along the items of a route: PX4's guidance law, a bank that is limited and lags, a wind.
//!
//! Promised: the same items, airframe and wind give the same track; it ends, whatever the items are. The track
//! arrives along the extension of the first leg, begins beside the first item, and ends where the last one counts as
//! reached.

use super::npfg::{NorthEast, dot, minus, norm, plus, unit};
use super::vehicle::{FixedWing, G};

/// An item that is flown to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mark {
    pub(super) place: NorthEast,
    /// Air speed on the leg to it, m/s.
    pub(super) speed_mps: f64,
}

/// A place every [`STEP_S`].
pub(super) fn fly(marks: &[Mark], wing: &FixedWing, wind: NorthEast) -> Vec<NorthEast> {
    let [first, second, ..] = marks else {
        return Vec::new();
    };
    let along = unit(minus(second.place, first.place));
    let lead_m = wing.switch_m(first.speed_mps + norm(wind)) + LEAD_S * first.speed_mps;
    let mut at = plus(first.place, along, -lead_m);
    let mut from = at;
    let mut speed_mps = first.speed_mps;
    // Trimmed: with this heading the wind leaves the vehicle on the line.
    let mut heading = trimmed(along, speed_mps, wind);
    let (mut bank, mut commanded_bank) = (0.0_f64, 0.0_f64);
    let bank_rate = BANK_RATE_RAD_S * STEP_S;
    let mut track = Vec::new();
    for mark in marks {
        let mut left = steps(minus(mark.place, at), mark.speed_mps, norm(wind));
        loop {
            let air = [speed_mps * heading.cos(), speed_mps * heading.sin()];
            let ground = plus(air, wind, 1.0);
            let ground_mps = norm(ground);
            let to = minus(mark.place, at);
            let leg = minus(mark.place, from);
            let past = norm(leg) > f64::EPSILON && leg[0] * to[0] + leg[1] * to[1] < 0.0;
            if norm(to) <= wing.switch_m(ground_mps) || past || left == 0 {
                break;
            }
            left -= 1;
            let course = wing.npfg.course(at, from, mark.place, ground_mps);
            let turn = wing.npfg.acceleration(course, air, wind);
            let limit = wing.bank_rad;
            let wanted = (turn / G).atan().clamp(-limit, limit);
            commanded_bank += (wanted - commanded_bank).clamp(-bank_rate, bank_rate);
            bank += (commanded_bank - bank) * (STEP_S / wing.roll_s).min(1.0);
            heading += G * bank.tan() / speed_mps * STEP_S;
            let push = SPEED_RATE * STEP_S;
            speed_mps += (mark.speed_mps - speed_mps).clamp(-push, push);
            at = plus(at, ground, STEP_S);
            // What is flown before the first item is not part of the route.
            if !track.is_empty() || dot(minus(at, first.place), along) >= 0.0 {
                track.push(at);
            }
        }
        from = mark.place;
    }
    track
}

/// Ten times what a leg needs: a vehicle that the wind carries away never arrives.
fn steps(leg: NorthEast, speed_mps: f64, wind_mps: f64) -> u32 {
    let slowest_mps = (speed_mps - wind_mps).max(1.0);
    (10.0 * (norm(leg) / slowest_mps + LEAD_S) / STEP_S).min(MAX_STEPS) as u32
}

/// The heading that keeps a line in this direction in a wind.
fn trimmed(along: NorthEast, speed_mps: f64, wind: NorthEast) -> f64 {
    let across = wind[1] * along[0] - wind[0] * along[1];
    along[1].atan2(along[0]) - (across / speed_mps).clamp(-1.0, 1.0).asin()
}

/// Time of one step, s: PX4's navigator reads the position, and so reaches a waypoint, at most every 50 ms.
const STEP_S: f64 = 0.05;
/// How long the extension of the first leg is flown, s.
const LEAD_S: f64 = 3.0;
/// PX4's default of FW_PN_R_SLEW_MAX, 90 degrees a second, in rad/s.
const BANK_RATE_RAD_S: f64 = std::f64::consts::FRAC_PI_2;
/// How fast the air speed follows a command, m/s^2: about what TECS (PX4's speed and height control) achieves.
const SPEED_RATE: f64 = 0.7;
/// A limit for a leg of 50 km at 2 m/s.
const MAX_STEPS: f64 = 500_000.0;
