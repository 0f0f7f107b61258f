//! What `check` finds about a route's heights: above home, above the ground, and how steep.

use std::fmt::Write;
use std::str::FromStr;

use cucs::formats::{Clearance, Datum};
use curve_paths::flight::Airframe;
use curve_paths::{Densified, Position};
use serde_json::json;

use crate::failure::Failure;
use crate::load::Loaded;

/// Where the vehicle starts, on the command line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Home(Position);

impl FromStr for Home {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|n| n.trim().parse()).collect();
        match numbers.as_deref() {
            Ok(&[lat_deg, lon_deg, alt_m])
                if lat_deg.abs() <= 90.0 && lon_deg.abs() <= 180.0 && alt_m.is_finite() =>
            {
                Ok(Self(Position::new(lat_deg, lon_deg, alt_m)))
            }
            _ => Err("expected LAT,LON,ALT: degrees, degrees, m above mean sea level".into()),
        }
    }
}

/// The findings.
#[derive(Debug)]
pub(crate) struct Heights {
    home: Option<Position>,
    /// Lowest and highest, m above home; `None` where they cannot be compared with it.
    above_home_m: Option<(f64, f64)>,
    /// The leg with the greatest change of height, and that change, m.
    largest: (usize, f64),
    /// Legs that need more climb or descent than the vehicle has at the speed.
    steep: Vec<Steep>,
    clearance: Option<Clearance>,
}

#[derive(Debug)]
struct Steep {
    leg: usize,
    rise_m: f64,
    ground_m: f64,
    /// Climb or descent that the steepest part needs, m/s.
    rate_mps: f64,
    limit_mps: f64,
}

impl Heights {
    /// Checks the heights of a route, with a speed for each leg, from `home`, or from its file's own.
    ///
    /// # Errors
    /// Home is needed and not known; or a part of the route is below home, unless that is `allowed`, or below the
    /// ground.
    pub(crate) fn of(
        loaded: &Loaded,
        densified: &Densified,
        home: Option<Home>,
        allowed: bool,
        speeds_mps: &[f64],
        airframe: &Airframe,
    ) -> Result<Self, Failure> {
        let (route, home_alt_m) = (&loaded.route, loaded.home_alt_m);
        let home = home.map(|Home(at)| at).or(route.home);
        let home_m = match route.datum {
            Datum::Home => Some(0.0),
            Datum::SeaLevel => Some(home_alt_m.or(home.map(|home| home.alt_m)).ok_or_else(
                || {
                    Failure::file(
                        &loaded.file,
                        "home is not known, and altitudes above sea level are compared with it: give --home LAT,LON,ALT",
                    )
                },
            )?),
            // Not compared here: the VSM compares these, by the geoid separation that the vehicle reports and by the altimeter
            // setting.
            Datum::Ellipsoid | Datum::Pressure | Datum::Unstated => None,
        };
        let vertices = &densified.vertices;
        if let Some(home_m) = home_m.filter(|_| !allowed)
            && let Some(low) = vertices.iter().find(|v| v.position.alt_m <= home_m)
        {
            let (at, from) = (low.position, route.number(low.leg));
            let problem = format!(
                "leg from waypoint {from}: {:.1} m below home at {:.6}, {:.6} ({:.1} m, home {home_m:.1} m): raise it, or \
                 allow it by --below-home, and to the VSM by vehicle.limits.below_home = true",
                home_m - at.alt_m,
                at.lat_deg,
                at.lon_deg,
                at.alt_m,
            );
            return Err(Failure::answer(&loaded.file, problem));
        }
        let heights = || vertices.iter().map(|v| v.position.alt_m);
        let (lowest, highest) = (
            heights().fold(f64::INFINITY, f64::min),
            heights().fold(f64::NEG_INFINITY, f64::max),
        );
        let steps = steps(loaded);
        let largest = steps.iter().copied().enumerate();
        let largest = largest.fold((0, 0.0), |so_far: (usize, f64), (leg, rise_m)| {
            if rise_m.abs() > so_far.1.abs() {
                (leg, rise_m)
            } else {
                so_far
            }
        });
        let steep = (0..loaded.legs.len())
            .filter_map(|leg| steep(densified, leg, steps[leg], speeds_mps[leg], airframe))
            .collect();
        Ok(Self {
            home,
            above_home_m: home_m.map(|home_m| (lowest - home_m, highest - home_m)),
            largest,
            steep,
            clearance: route.clearance,
        })
    }

    pub(crate) fn json(&self) -> serde_json::Value {
        let home = self.home.map(
            |home| json!({ "lat_deg": home.lat_deg, "lon_deg": home.lon_deg, "alt_m": home.alt_m }),
        );
        let steep: Vec<_> = self
            .steep
            .iter()
            .map(|s| {
                let rate_mps = Some(s.rate_mps).filter(|rate| rate.is_finite());
                json!({ "leg": s.leg, "rise_m": s.rise_m, "ground_m": s.ground_m, "rate_mps": rate_mps,
                        "limit_mps": s.limit_mps })
            })
            .collect();
        let clearance = self.clearance.map(|c| {
            json!({ "clearance_m": c.clearance_m, "leg": c.leg, "lat_deg": c.at.lat_deg, "lon_deg": c.at.lon_deg })
        });
        json!({
            "home": home, "lowest_m": self.above_home_m.map(|m| m.0), "highest_m": self.above_home_m.map(|m| m.1),
            "largest_step_m": self.largest.1, "largest_step_leg": self.largest.0, "steep": steep,
            "terrain": clearance,
        })
    }

    pub(crate) fn text(&self) -> String {
        let mut out = match self.above_home_m {
            Some((lowest_m, highest_m)) => {
                format!("heights: {lowest_m:.1} to {highest_m:.1} m above home")
            }
            None => "heights: not compared with home, the VSM does that".to_owned(),
        };
        let (leg, rise_m) = self.largest;
        let _ = writeln!(out, "; largest step {rise_m:+.1} m, leg {leg}");
        for s in &self.steep {
            let what = if s.rise_m < 0.0 { "descends" } else { "climbs" };
            let _ = writeln!(
                out,
                "leg {}: {what} {:.1} m in {:.1} m: {:.1} m/s, the vehicle's is {:.1} m/s",
                s.leg,
                s.rise_m.abs(),
                s.ground_m,
                s.rate_mps,
                s.limit_mps
            );
        }
        if let Some(c) = self.clearance {
            let _ = writeln!(
                out,
                "terrain: at least {:.1} m above it, leg {} at {:.6}, {:.6}",
                c.clearance_m, c.leg, c.at.lat_deg, c.at.lon_deg
            );
        }
        out
    }
}

/// The change of height of each leg, m.
fn steps(loaded: &Loaded) -> Vec<f64> {
    let points = &loaded.route.points;
    let alt_m = |k: usize| points[k % points.len()].position.alt_m;
    (0..loaded.legs.len())
        .map(|k| alt_m(k + 1) - alt_m(k))
        .collect()
}

/// The rate that the steepest chord of a leg needs, where that is more than the vehicle has.
fn steep(
    densified: &Densified,
    leg: usize,
    rise_m: f64,
    speed_mps: f64,
    airframe: &Airframe,
) -> Option<Steep> {
    let mut worst: Option<Steep> = None;
    let mut length_m = 0.0;
    for pair in densified.vertices.windows(2).filter(|p| p[1].leg == leg) {
        let (from, to) = (pair[0].position, pair[1].position);
        let ground_m = from.ground().distance_m(to.ground());
        length_m += ground_m;
        let climbs_m = to.alt_m - from.alt_m;
        let limit_mps = match airframe {
            Airframe::Multicopter(quad) if climbs_m > 0.0 => quad.climb_mps,
            Airframe::Multicopter(quad) => quad.descent_mps,
            Airframe::FixedWing(_) => WING_MPS,
        };
        let rate_mps = climbs_m.abs() * speed_mps / ground_m;
        if climbs_m != 0.0
            && rate_mps > limit_mps
            && worst
                .as_ref()
                .is_none_or(|so_far| rate_mps > so_far.rate_mps)
        {
            worst = Some(Steep {
                leg,
                rise_m,
                ground_m: 0.0,
                rate_mps,
                limit_mps,
            });
        }
    }
    worst.map(|steep| Steep {
        ground_m: length_m,
        ..steep
    })
}

/// PX4's defaults of FW_T_CLMB_MAX and FW_T_SINK_MAX, m/s.
const WING_MPS: f64 = 5.0;
