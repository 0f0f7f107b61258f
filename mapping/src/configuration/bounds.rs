//! The bounds of a field, from the vehicle's parameters, its airframe and the configured limits.

use std::f64::consts::PI;

use stanag_msgs::Id;
use stanag_msgs::enums::{AltitudeType, FlightPathControlMode, LoiterType, SpeedType};

use super::controls::{Controls, ValuesBy};
use crate::altitude::Agl;
use crate::limits::{Limits, Performance, WIDEST_CIRCLE_M};
use crate::parameter::Parameters;
use crate::telemetry::Place;

/// What the bounds are computed from.
#[derive(Debug, Clone, Copy)]
pub struct Subject<'a> {
    /// VSM ID.
    pub vsm: Id,
    /// HEARTBEAT.type; 0 before one is received.
    pub vehicle_type: u16,
    /// Whether it can hover as it flies now: a multicopter, or a VTOL on its rotors.
    pub hovers: bool,
    /// Whether it is a VTOL: along a route it hovers and flies on wings.
    pub vtol: bool,
    /// Home, once the vehicle has reported one.
    pub home: Option<Place>,
    /// Bounds of routes, narrowed by those of the vehicle itself ([`Limits::of`]).
    pub limits: Limits,
    /// Whether heights above home are flown.
    pub agl: Agl,
    /// The vehicle's parameters, as far as they have been read.
    pub parameters: &'a Parameters,
    /// The status page, where one is served.
    pub web_page: Option<&'a str>,
    /// The vehicle's parameters that are offered as controls.
    pub controls: &'a Controls,
    /// How the values of controls are reported to the CUCS that requested them.
    pub values_by: ValuesBy,
}

/// Bounds of a field in its unit; an unknown bound is absent.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Bounds {
    /// The value with which a CUCS may initialise its display.
    pub default: Option<f64>,
    /// The lowest value that is accepted or reported.
    pub low: Option<f64>,
    /// The highest.
    pub high: Option<f64>,
    /// Below it the CUCS cautions its operator.
    pub low_caution: Option<f64>,
    /// Below it the CUCS warns its operator.
    pub low_warning: Option<f64>,
    /// What the value is, and where the bounds come from; at most 79 characters.
    pub help: &'static str,
}

impl Bounds {
    fn between(
        low: impl Into<Option<f64>>,
        high: impl Into<Option<f64>>,
        help: &'static str,
    ) -> Bounds {
        Bounds {
            low: low.into(),
            high: high.into(),
            help,
            ..Bounds::default()
        }
    }

    fn starting_at(mut self, default: impl Into<Option<f64>>) -> Bounds {
        self.default = default.into();
        self
    }
}

/// The bounds of a field of a message, as 41000, 41001 and 41003 report them; `None` where nothing bounds it.
#[must_use]
pub fn bounds(subject: &Subject<'_>, message: u16, field: &str) -> Option<Bounds> {
    let found = match (message, field) {
        (2016, "Commanded Altitude") | (13002, "Waypoint to Altitude") => altitude(subject),
        (13002, "Waypoint to Speed") if subject.vtol => route_speed(subject),
        (2016, "Commanded Speed") | (13002, "Waypoint to Speed") => speed(subject),
        (2016, "Commanded Waypoint Number") => {
            Bounds::between(0.0, LAST_WAYPOINT, "waypoint of the route aboard; 0: none")
                .starting_at(0.0)
        }
        (2016, "Loiter Position Latitude") | (13002, "Waypoint to Latitude or Relative Y") => {
            latitude(subject)
        }
        (2016, "Loiter Position Longitude") | (13002, "Waypoint to Longitude or Relative X") => {
            longitude(subject)
        }
        (2017 | 13003, "Loiter Radius") => radius(subject),
        (13003, "Loiter Duration") => {
            Bounds::between(0.0, 65_535.0, "s; 0: no loiter; absent: without an end")
                .starting_at(0.0)
        }
        (13000 | 13002 | 13003, "Waypoint Number") | (13001, "Initial Waypoint Number") => {
            // In 13001 a waypoint 0 deletes the route; no waypoint has that number.
            let low = if message == 13001 { 0.0 } else { 1.0 };
            Bounds::between(low, LAST_WAYPOINT, "number of a waypoint").starting_at(1.0)
        }
        (13002, "Next Waypoint") => {
            Bounds::between(0.0, LAST_WAYPOINT, "number of a waypoint; 0 ends the route")
                .starting_at(0.0)
        }
        (3002, "Current Propulsion Energy Level") => energy(subject),
        // A report has no value for a CUCS to start from.
        (3002, "Commanded Speed") => Bounds {
            default: None,
            ..speed(subject)
        },
        (3002, "Power Level") => Bounds::between(0.0, 100.0, "%; VFR_HUD.throttle"),
        (4000, "U_Speed" | "V_Speed") => {
            let max = performance(subject).fastest_m_s;
            Bounds::between(-max, max, "m/s; fastest level flight")
        }
        (4000, "W_Speed") => {
            let of = |name| subject.parameters.above_zero(name);
            // W_Speed is positive down.
            let up = of("MPC_Z_VEL_MAX_UP").map(|up| -up);
            Bounds::between(
                up,
                of("MPC_Z_VEL_MAX_DN"),
                "m/s down; MPC_Z_VEL_MAX_UP, MPC_Z_VEL_MAX_DN",
            )
        }
        (17001, "Frequency") => Bounds::between(0.0, 100.0, "Hz; 0: stop").starting_at(2.0),
        _ => return None,
    };
    Some(found)
}

/// The initial value of an enumerated field.
pub(super) fn default_value(subject: &Subject<'_>, message: u16, field: &str) -> Option<u8> {
    Some(match (message, field) {
        (2016, "Select Flight Path Control Mode") => FlightPathControlMode::Loiter.raw(),
        (2016, "Altitude Command Type") => 1,
        (2016, "Speed Type") | (13002, "Waypoint Speed Type") => SpeedType::Ground.raw(),
        (2016, "Altitude Type") | (13002, "Waypoint Altitude Type") => altitude_type(subject).raw(),
        (2017, "Loiter Type") | (13003, "Waypoint Loiter Type") => {
            let loiter = if subject.hovers {
                LoiterType::Hover
            } else {
                LoiterType::Circular
            };
            loiter.raw()
        }
        (2017, "Loiter Direction") => 1,
        (13000, "Mission Plan Mode") | (13001, "Route Type") => 2,
        (2016, "Heading Command Type")
        | (13002, "Location Type" | "Turn Type" | "Waypoint Type")
        | (13003, "Loiter Duration Units") => 0,
        _ => return None,
    })
}

/// The altitude type of the bounds of altitudes.
fn altitude_type(subject: &Subject<'_>) -> AltitudeType {
    match subject.agl {
        Agl::AboveHome => AltitudeType::Agl,
        // Heights above the ground have other bounds at each place.
        Agl::Terrain | Agl::Refuse => AltitudeType::Barometric,
    }
}

fn altitude(subject: &Subject<'_>) -> Bounds {
    let limits = subject.limits;
    let high = limits.highest_m;
    let start = subject
        .parameters
        .get("MIS_TAKEOFF_ALT")
        .unwrap_or(0.0)
        .clamp(LOWEST_M.min(high), high);
    let low = if limits.below_home {
        limits.floor_m()
    } else {
        limits.floor_m().max(LOWEST_M)
    };
    if altitude_type(subject) == AltitudeType::Agl {
        return Bounds::between(
            low,
            high,
            "m above home; vehicle.limits, GF_MAX_VER_DIST, MIS_TAKEOFF_ALT",
        )
        .starting_at(start);
    }
    let Some(home) = subject.home else {
        return Bounds::between(None, None, "m above mean sea level; home is not known yet");
    };
    Bounds::between(
        low + home.amsl_m,
        high + home.amsl_m,
        "m AMSL; vehicle.limits, GF_MAX_VER_DIST, MIS_TAKEOFF_ALT",
    )
    .starting_at(start + home.amsl_m)
}

fn performance(subject: &Subject<'_>) -> Performance {
    Performance::of(subject.hovers, subject.parameters, &subject.limits)
}

fn speed(subject: &Subject<'_>) -> Bounds {
    let Performance {
        slowest_m_s: low,
        fastest_m_s: high,
        ..
    } = performance(subject);
    let (cruise, help) = if subject.hovers {
        let help = "m/s; MPC_XY_VEL_MAX, MPC_XY_CRUISE, vehicle.limits";
        ("MPC_XY_CRUISE", help)
    } else {
        let help = "m/s; FW_AIRSPD_MIN, _TRIM, _MAX, vehicle.limits";
        ("FW_AIRSPD_TRIM", help)
    };
    // A value that the vehicle has not reported is absent, and never a default.
    let cruise = subject.parameters.above_zero(cruise);
    Bounds::between(low, high, help).starting_at(cruise.map(|own| own.clamp(low, high)))
}

/// Along the route of a VTOL: from the speed at which it hovers along a leg to the speed on its wings. A speed below
/// the caution is used only on legs that it hovers along (13006).
fn route_speed(subject: &Subject<'_>) -> Bounds {
    let [hover, wings] = [true, false].map(|hovers| speed(&Subject { hovers, ..*subject }));
    Bounds {
        default: wings.default,
        low: hover.low,
        high: wings.high.zip(hover.high).map(|(a, b)| a.max(b)),
        low_caution: wings.low,
        help: "m/s; on wings from the caution (FW_AIRSPD_MIN) to _MAX, a hover to MPC_XY_VEL_MAX",
        ..Bounds::default()
    }
}

/// How far from home a first waypoint may be, as the half side of a square within the circle of the limit.
fn reach_m(subject: &Subject<'_>) -> f64 {
    let fence = subject.parameters.above_zero("GF_MAX_HOR_DIST");
    let circle = fence.map_or(subject.limits.first_m, |fence| {
        fence.min(subject.limits.first_m)
    });
    // A little less than that, so that no corner of the square lies outside the circle.
    circle * std::f64::consts::FRAC_1_SQRT_2 * 0.99
}

fn latitude(subject: &Subject<'_>) -> Bounds {
    let Some(home) = subject.home else {
        return Bounds::between(-PI / 2.0, PI / 2.0, "rad; home is not known yet");
    };
    let (at, span) = (
        home.latitude.to_radians(),
        reach_m(subject) / EARTH_RADIUS_M,
    );
    Bounds::between(
        (at - span).max(-PI / 2.0),
        (at + span).min(PI / 2.0),
        "rad; within vehicle.limits.first_m and GF_MAX_HOR_DIST of home",
    )
    .starting_at(at)
}

fn longitude(subject: &Subject<'_>) -> Bounds {
    let whole = Bounds::between(-PI, PI, "rad; home is not known yet");
    let Some(home) = subject.home else {
        return whole;
    };
    let at = home.longitude.to_radians();
    // At the latitude of the side of the square that is further from the equator: there a metre is the most
    // longitude.
    let widest = home.latitude.abs().to_radians() + reach_m(subject) / EARTH_RADIUS_M;
    let span = reach_m(subject) / (EARTH_RADIUS_M * widest.cos().max(1e-9));
    let help = "rad; within vehicle.limits.first_m and GF_MAX_HOR_DIST of home";
    if at - span < -PI || at + span >= PI {
        // An interval across the date line cannot be expressed by a minimum and a maximum, so none is given.
        return Bounds { help, ..whole }.starting_at(at);
    }
    Bounds::between(at - span, at + span, help).starting_at(at)
}

fn radius(subject: &Subject<'_>) -> Bounds {
    let own = subject.parameters.above_zero("NAV_LOITER_RAD");
    Bounds::between(SMALLEST_CIRCLE_M, WIDEST_CIRCLE_M, "m; NAV_LOITER_RAD").starting_at(own)
}

fn energy(subject: &Subject<'_>) -> Bounds {
    let percent = |name| {
        subject
            .parameters
            .above_zero(name)
            .map(|share| share * 100.0)
    };
    Bounds {
        low_caution: percent("BAT_LOW_THR"),
        low_warning: percent("BAT_CRIT_THR"),
        ..Bounds::between(0.0, 100.0, "%; BAT_LOW_THR, BAT_CRIT_THR")
    }
}

/// The lowest height above home that survives any rounding, m: two steps of the field. A launch needs more (2016 mode
/// 21).
const LOWEST_M: f64 = 0.04;
/// One step of the field.
const SMALLEST_CIRCLE_M: f64 = 1.5;
/// The highest waypoint number: 65535 means "no waypoint" in 4001.
const LAST_WAYPOINT: f64 = 65_534.0;
/// Mean radius: for limits, not for geometry.
const EARTH_RADIUS_M: f64 = 6_371_008.8;
