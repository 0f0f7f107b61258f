//! `check`: whether a route can be flown at its speeds, where it is too tight or too low, and what the flight adds to
//! its deviation.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use curve_paths::flight::{Airframe, FlightPlan, Flown, Policy, measure, plan_flight};
use curve_paths::{Densified, Leg, Position};
use serde_json::json;

use crate::airframe::Vehicle;
use crate::failure::Failure;
use crate::heights::{Heights, Home};
use crate::load::{Densify, Loaded};
use crate::output::print;
use crate::tlog;

/// What to do about a turn that is too tight.
#[derive(Clone, Copy, Debug, Eq, PartialEq, ValueEnum)]
enum Tightness {
    Slow,
    Refuse,
}

/// Arguments of `check`.
#[derive(Debug, Args)]
pub(crate) struct Command {
    /// Read this route.
    file: PathBuf,
    #[command(flatten)]
    how: Densify,
    /// Compare heights with this home: degrees north and east, m above mean sea level (default: the file's own).
    // A route whose heights are above home needs no altitude of it.
    #[arg(
        long,
        value_name = "LAT,LON,ALT",
        allow_hyphen_values = true,
        conflicts_with = "home_alt"
    )]
    home: Option<Home>,
    /// Allow a route below home.
    #[arg(long)]
    below_home: bool,
    /// Fly at this speed where the file has named none yet, m/s.
    #[arg(
        long,
        value_name = "M/S",
        default_value_t = 5.0,
        value_parser = speed,
        allow_negative_numbers = true
    )]
    speed: f64,
    /// Check for quad or plane as PX4 comes, or by a vehicle file: PX4's parameters by name in a .toml, or as saved in
    /// a .params.
    #[arg(long, value_name = "quad|plane|FILE", default_value = "quad")]
    airframe: Vehicle,
    /// Limit the bank of a plane to this, degrees (FW_R_LIM).
    #[arg(long, value_name = "DEG", value_parser = bank, allow_negative_numbers = true)]
    bank: Option<f64>,
    /// Keep a plane at or above this speed, m/s (FW_AIRSPD_MIN).
    #[arg(long, value_name = "M/S", value_parser = positive, allow_negative_numbers = true)]
    slowest: Option<f64>,
    /// Predict for a plane in this wind from any direction, m/s [default: 5].
    #[arg(long, value_name = "M/S", value_parser = wind, allow_negative_numbers = true)]
    wind: Option<f64>,
    /// Limit the horizontal acceleration of a quad to this, m/s^2 (MPC_ACC_HOR).
    #[arg(long, value_parser = positive, allow_negative_numbers = true)]
    acceleration: Option<f64>,
    /// Limit the jerk of a quad to this, m/s^3 (MPC_JERK_AUTO).
    #[arg(long, value_parser = positive, allow_negative_numbers = true)]
    jerk: Option<f64>,
    /// Fly a turn that is too tight slower, or refuse the route.
    #[arg(long, value_enum, default_value_t = Tightness::Slow)]
    policy: Tightness,
    /// Compare with a .tlog of the flight: print the flown deviation beside the predicted one. Its altitudes count from
    /// the height of the route's start.
    #[arg(long, value_name = "FILE")]
    flown: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Command {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let loaded = Loaded::read(&self.file, &self.how)?;
        loaded.report_losses(&self.how)?;
        let (densified, tolerance_m) = loaded.densify(&self.how)?;
        let airframe = self.airframe()?;
        let speeds = loaded.speeds(self.speed);
        let heights = Heights::of(
            &loaded,
            &densified,
            self.home,
            self.below_home,
            &speeds,
            &airframe,
        )?;
        let policy = if self.policy == Tightness::Slow {
            Policy::Slow
        } else {
            Policy::Refuse
        };
        let plan = plan_flight(&loaded.legs, &densified, &airframe, &speeds, policy)
            .map_err(|fault| Failure::answer(&self.file, fault))?;
        let misread = misread(&loaded.legs, tolerance_m);
        let flown = self
            .flown
            .as_deref()
            .map(|file| measured(file, &loaded, &densified))
            .transpose()?;
        if self.json {
            let mut report = self.report(&plan, densified.bound_m, &misread, flown.as_ref());
            report["speeds_mps"] = json!(speeds);
            report["heights"] = heights.json();
            report["losses"] = loaded.route.losses.to_json();
            return print(&format!("{report}\n"));
        }
        let mut text = text(&plan, &densified, &speeds, &misread);
        text += &heights.text();
        if let Some(flown) = flown {
            let _ = writeln!(
                text,
                "flown: {:.2} m off at most, {} of {} points passed within {ACCEPTANCE_M} m",
                flown.deviation_m, flown.passed, flown.points
            );
        }
        print(&text)
    }

    /// The airframe of the file, with the limits of the command line.
    fn airframe(&self) -> Result<Airframe, Failure> {
        let mut airframe = self.airframe.airframe()?;
        for (name, value) in [
            ("FW_R_LIM", self.bank),
            ("FW_AIRSPD_MIN", self.slowest),
            ("wind_m_s", self.wind),
            ("MPC_ACC_HOR", self.acceleration),
            ("MPC_JERK_AUTO", self.jerk),
        ] {
            if let Some(value) = value {
                let set = airframe.set(name, value);
                set.map_err(|fault| Failure::Usage(fault.to_string()))?;
            }
        }
        Ok(airframe)
    }

    fn report(
        &self,
        plan: &FlightPlan,
        bound_m: f64,
        misread: &[(usize, f64)],
        flown: Option<&Flown>,
    ) -> serde_json::Value {
        let finite = |x: f64| Some(x).filter(|x| x.is_finite());
        let tight: Vec<_> = plan
            .tight
            .iter()
            .map(|t| {
                json!({ "leg": t.leg, "t": t.t, "lat_deg": t.position.lat_deg, "lon_deg": t.position.lon_deg,
                        "radius_m": t.radius_m, "fastest_mps": t.fastest_mps })
            })
            .collect();
        let changes: Vec<_> = plan
            .changes
            .iter()
            .map(|c| json!({ "vertex": c.vertex, "speed_mps": c.speed_mps }))
            .collect();
        let misread: Vec<_> = misread
            .iter()
            .map(|(leg, off)| json!({ "leg": leg, "difference_m": off }))
            .collect();
        json!({
            "bound_m": bound_m, "speed_mps": self.speed, "fastest_mps": finite(plan.fastest_mps), "tight": tight,
            "changes": changes, "slowest_chord_mps": finite(plan.slowest_chord_mps), "time_s": plan.time_s,
            "curves_s": plan.curves_s,
            "predicted_deviation_m": plan.predicted_deviation_m, "read_differently": misread,
            "flown": flown.map(|f| json!({ "deviation_m": f.deviation_m, "points": f.points, "passed": f.passed })),
        })
    }
}

fn text(
    plan: &FlightPlan,
    densified: &Densified,
    speeds_mps: &[f64],
    misread: &[(usize, f64)],
) -> String {
    let (items, bound_m) = (densified.vertices.len(), densified.bound_m);
    let mut out = format!(
        "{items} items, proven within {bound_m:.3} m, {:.0} s, {:.0} s of that on curves\n",
        plan.time_s, plan.curves_s
    );
    for t in &plan.tight {
        let _ = writeln!(
            out,
            "leg {} at t = {:.3} ({:.7}, {:.7}): radius {:.1} m, at most {:.1} m/s",
            t.leg, t.t, t.position.lat_deg, t.position.lon_deg, t.radius_m, t.fastest_mps
        );
    }
    for c in &plan.changes {
        let _ = writeln!(out, "from item {}: {:.1} m/s", c.vertex, c.speed_mps);
    }
    let fastest = speeds_mps.iter().copied().fold(0.0, f64::max);
    if plan.slowest_chord_mps < fastest {
        let slowest = plan.slowest_chord_mps;
        let _ = writeln!(
            out,
            "short chords hold the autopilot to {slowest:.1} m/s: a larger tolerance is faster"
        );
    }
    if let Some(deviation) = plan.predicted_deviation_m {
        let _ = writeln!(
            out,
            "flown deviation, predicted and not promised: {deviation:.1} m"
        );
    }
    for (leg, off) in misread {
        let _ = writeln!(
            out,
            "leg {leg}: a station that draws it in latitude and longitude shows a line {off:.2} m off"
        );
    }
    out
}

/// Compares the flown track of a recording with the route.
fn measured(file: &Path, loaded: &Loaded, densified: &Densified) -> Result<Flown, Failure> {
    let mut track = tlog::read(file)?;
    // A recording has heights above mean sea level, a route its own datum: both are taken as equal at the route's
    // start.
    let start = densified.vertices[0].position;
    let apart = |p: &Position| p.ground().distance_m(start.ground());
    let nearest = track.iter().min_by(|a, b| apart(a).total_cmp(&apart(b)));
    let shift_m = nearest.map_or(0.0, |p| start.alt_m - p.alt_m);
    track.iter_mut().for_each(|p| p.alt_m += shift_m);
    measure(&loaded.legs, densified, &track, ACCEPTANCE_M)
        .ok_or_else(|| Failure::answer(file, "the route was not flown from its start to its end"))
}

/// A point counts as passed within this distance, m: the acceptance radius that the bridge gives to level chords.
const ACCEPTANCE_M: f64 = 3.0;

/// Legs that the other reading draws differently, and by how much, m.
fn misread(legs: &[Leg], tolerance_m: f64) -> Vec<(usize, f64)> {
    let different = |(k, leg): (usize, &Leg)| match leg {
        Leg::Bezier(leg) if leg.reads_differently(tolerance_m) => {
            Some((k, leg.latitude_longitude_difference_m()))
        }
        _ => None,
    };
    legs.iter().enumerate().filter_map(different).collect()
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x <= 100.0 => Ok(x),
        _ => Err("expected more than 0 and at most 100".into()),
    }
}

fn speed(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x <= 200.0 => Ok(x),
        _ => Err("expected more than 0 and at most 200 m/s".into()),
    }
}

fn wind(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if (0.0..=30.0).contains(&x) => Ok(x),
        _ => Err("expected 0 to 30".into()),
    }
}

fn bank(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x <= 84.0 => Ok(x),
        _ => Err("expected more than 0 and at most 84 degrees".into()),
    }
}
