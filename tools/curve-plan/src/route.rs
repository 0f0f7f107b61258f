//! A route as the commands have it: waypoints, curves between them, what the altitudes are above; and its way to a
//! ground station's route and back.

use std::path::Path;

use clap::Args;
use curve_paths::fit::Fitted;
use curve_paths::{BezierLeg, Control, Densified, Leg, Position};
use stanag_msgs::enums::AltitudeType;

use crate::failure::Failure;

/// A waypoint and, where the leg to the next one is curved, its control points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Waypoint {
    pub(crate) position: Position,
    /// The line of the file that it stood on, where there is one to name.
    pub(crate) line: Option<u64>,
    /// P2 and P3 of the leg that starts here.
    pub(crate) curve: Option<[Control; 2]>,
    /// Why `position.alt_m` means nothing.
    pub(crate) no_altitude: Option<NoAltitude>,
}

/// Why a waypoint has no altitude to fly at.
#[derive(Clone, Copy, Debug, Eq, PartialEq, thiserror::Error)]
pub(crate) enum NoAltitude {
    /// The file gives none there.
    #[error("no altitude")]
    Missing,
    /// The file's is that of the ground, or is drawn on the ground.
    #[error("its altitude is the ground's, which is none to fly at")]
    Ground,
}

impl Waypoint {
    pub(crate) const fn straight(position: Position, line: Option<u64>) -> Self {
        Self {
            position,
            line,
            curve: None,
            no_altitude: None,
        }
    }

    /// A waypoint of a file in which the altitude may be absent: the number beside it is never used then.
    pub(crate) fn found(
        lat_deg: f64,
        lon_deg: f64,
        alt_m: Result<f64, NoAltitude>,
        line: Option<u64>,
    ) -> Self {
        Self {
            no_altitude: alt_m.err(),
            ..Self::straight(
                Position::new(lat_deg, lon_deg, alt_m.unwrap_or_default()),
                line,
            )
        }
    }
}

/// The altitude of all waypoints, where a file does not give it.
#[derive(Clone, Copy, Debug, Default, Args)]
pub(crate) struct Level {
    /// Put a route without altitudes at this altitude, m above mean sea level.
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    altitude: Option<f64>,
    /// Put a route without altitudes at this height above home, m.
    #[arg(long, value_name = "M", conflicts_with = "altitude")]
    height: Option<f64>,
}

/// What altitudes are above.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub(crate) enum Datum {
    /// Mean sea level.
    #[default]
    SeaLevel,
    /// Home, which is what the DLI's AGL is flown as.
    Home,
    /// The WGS-84 ellipsoid.
    Ellipsoid,
    /// Not stated.
    Unstated,
}

impl Datum {
    pub(crate) fn of(kind: Option<AltitudeType>) -> Self {
        match kind {
            Some(AltitudeType::Barometric | AltitudeType::Pressure) => Self::SeaLevel,
            Some(AltitudeType::Agl) => Self::Home,
            Some(AltitudeType::Wgs84) => Self::Ellipsoid,
            _ => Self::Unstated,
        }
    }

    /// Of heights above home, or of altitudes.
    pub(crate) const fn above_home(is: bool) -> Self {
        if is { Self::Home } else { Self::SeaLevel }
    }

    const fn altitude_type(self) -> Option<AltitudeType> {
        match self {
            Self::SeaLevel => Some(AltitudeType::Barometric),
            Self::Home => Some(AltitudeType::Agl),
            Self::Ellipsoid => Some(AltitudeType::Wgs84),
            Self::Unstated => None,
        }
    }
}

/// A route.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Route {
    pub(crate) name: String,
    /// Whether the last waypoint's leg leads back to the first.
    pub(crate) closed: bool,
    pub(crate) waypoints: Vec<Waypoint>,
    /// Items of the file that are no part of the path, and were left out.
    pub(crate) skipped: usize,
    pub(crate) datum: Datum,
    /// The ground station's route that it was read from, with all that a path does not show: numbers, speeds, loiters.
    pub(crate) plan: Option<cucs::Route>,
}

impl Route {
    /// The legs, each checked.
    pub(crate) fn legs(&self, file: &Path) -> Result<Vec<Leg>, Failure> {
        let n = self.waypoints.len();
        if n < 2 {
            return Err(Failure::file(
                file,
                format!("{n} waypoints, expected at least 2"),
            ));
        }
        for (k, w) in self.waypoints.iter().enumerate() {
            w.position.checked().map_err(|e| {
                Failure::at(file, w.line, format!("waypoint {}", self.number(k)), e)
            })?;
        }
        let last = if self.closed { n } else { n - 1 };
        (0..last)
            .map(|k| {
                let (from, to) = (&self.waypoints[k], &self.waypoints[(k + 1) % n]);
                match from.curve {
                    Some([p2, p3]) => {
                        BezierLeg::new(from.position, p2, p3, to.position).map(Leg::from)
                    }
                    None => Leg::straight(from.position, to.position),
                }
                .map_err(|e| {
                    let field = format!("leg from waypoint {}", self.number(k));
                    Failure::at(file, from.line, field, e)
                })
            })
            .collect()
    }

    /// How a waypoint is called: by its number, or else as the n-th.
    fn number(&self, k: usize) -> usize {
        let numbered = self.plan.as_ref().and_then(|plan| plan.waypoints.get(k));
        numbered.map_or(k + 1, |w| usize::from(w.number))
    }

    /// A route of cubic legs, as a fit yields them.
    pub(crate) fn of_fit(name: &str, fitted: &Fitted, closed: bool, datum: Datum) -> Self {
        let mut waypoints: Vec<Waypoint> = fitted
            .legs
            .iter()
            .map(|leg| Waypoint {
                curve: Some([leg.p2(), leg.p3()]),
                ..Waypoint::straight(leg.p1(), None)
            })
            .collect();
        if let (false, Some(leg)) = (closed, fitted.legs.last()) {
            waypoints.push(Waypoint::straight(leg.p4(), None));
        }
        Self {
            name: name.to_owned(),
            closed,
            waypoints,
            datum,
            ..Self::default()
        }
    }

    /// The straight legs that it is flown by.
    pub(crate) fn flown(&self, densified: &Densified) -> Self {
        let vertices = densified.vertices.iter();
        Self {
            name: self.name.clone(),
            waypoints: vertices
                .map(|v| Waypoint::straight(v.position, None))
                .collect(),
            datum: self.datum,
            ..Self::default()
        }
    }

    /// The positions of its waypoints.
    pub(crate) fn positions(&self) -> Vec<Position> {
        self.waypoints.iter().map(|w| w.position).collect()
    }

    /// Whether any leg is curved.
    pub(crate) fn is_curved(&self) -> bool {
        self.waypoints.iter().any(|w| w.curve.is_some())
    }

    /// Puts all waypoints at the altitude of the command line, where there is one; else each must have its own.
    ///
    /// An absent altitude is never a number: an aircraft would descend to it.
    pub(crate) fn level(&mut self, level: Level, file: &Path) -> Result<(), Failure> {
        let Some(alt_m) = level.altitude.or(level.height) else {
            let mut waypoints = self.waypoints.iter().enumerate();
            let absent = waypoints.find_map(|(k, w)| Some((k, w.line, w.no_altitude?)));
            return absent.map_or(Ok(()), |(k, line, why)| {
                let problem = format!(
                    "{why}; expected one for each, or one for all by --altitude or --height"
                );
                Err(Failure::at(file, line, format!("point {}", k + 1), problem))
            });
        };
        if self.plan.is_some() {
            let problem = "the route file has altitudes: --altitude and --height are for files that have none";
            return Err(Failure::Usage(problem.into()));
        }
        for w in &mut self.waypoints {
            w.position.alt_m = alt_m;
            w.no_altitude = None;
        }
        self.datum = Datum::above_home(level.height.is_some());
        Ok(())
    }

    /// Turns heights above home into altitudes, home being so high.
    pub(crate) fn lift(&mut self, home_m: f64) {
        if self.datum != Datum::Home {
            return;
        }
        self.datum = Datum::SeaLevel;
        for w in &mut self.waypoints {
            w.position.alt_m += home_m;
            for control in w.curve.iter_mut().flatten() {
                control.alt_m = control.alt_m.map(|m| m + home_m);
            }
        }
        if let Some(plan) = &mut self.plan {
            for w in &mut plan.waypoints {
                w.altitude_m += home_m;
                w.altitude_type = self.datum.altitude_type();
            }
            for curve in &mut plan.curves {
                for place in [&mut curve.p2, &mut curve.p3] {
                    place.altitude_m = place.altitude_m.map(|m| m + home_m);
                }
                curve.altitude_type = curve.altitude_type.and(self.datum.altitude_type());
            }
        }
    }

    /// The ground station's route: the one that it was read from, or one with waypoints numbered 10, 20 and so on. A
    /// closed one ends where it began, by a waypoint of its own.
    pub(crate) fn to_plan(&self) -> Result<cucs::Route, Failure> {
        if let Some(plan) = &self.plan {
            return Ok(plan.clone());
        }
        let ends = self.waypoints.len() + usize::from(self.closed);
        let step = if ends <= usize::from(MAX_NUMBER / 10) {
            10
        } else {
            1
        };
        let number = |k: usize| {
            let number = u16::try_from((k + 1) * step).ok();
            number.filter(|n| *n <= MAX_NUMBER).ok_or_else(|| {
                Failure::Answer(format!("{ends} waypoints, expected at most {MAX_NUMBER}"))
            })
        };
        let altitude_type = self.datum.altitude_type();
        let mut plan = cucs::Route {
            id: Some(printable(&self.name)),
            ..cucs::Route::default()
        };
        for k in 0..ends {
            let w = &self.waypoints[k % self.waypoints.len()];
            let next = if k + 1 < ends { number(k + 1)? } else { 0 };
            plan.waypoints.push(cucs::Waypoint {
                number: number(k)?,
                latitude_deg: w.position.lat_deg,
                longitude_deg: w.position.lon_deg,
                altitude_m: w.position.alt_m,
                altitude_type,
                next,
                ..cucs::Waypoint::default()
            });
            if let (Some([p2, p3]), true) = (w.curve, k + 1 < ends) {
                let place = |c: Control| cucs::Place {
                    latitude_deg: c.lat_deg,
                    longitude_deg: c.lon_deg,
                    altitude_m: c.alt_m,
                };
                plan.curves.push(cucs::Curve {
                    from: number(k)?,
                    to: next,
                    p2: place(p2),
                    p3: place(p3),
                    altitude_type: p2.alt_m.and(altitude_type),
                    form: cucs::CurveForm::Native,
                });
            }
        }
        Ok(plan)
    }
}

/// P1 to P4 of each leg of a fit, degrees north and east.
pub(crate) fn ground_points(fitted: &Fitted) -> Vec<[[f64; 2]; 4]> {
    let points = |leg: &BezierLeg| {
        let (p1, p4) = (leg.p1().ground(), leg.p4().ground());
        [p1, leg.p2().ground(), leg.p3().ground(), p4].map(|g| [g.lat_deg, g.lon_deg])
    };
    fitted.legs.iter().map(points).collect()
}

/// A name as a Route ID carries it.
fn printable(name: &str) -> String {
    let seven_bits = |c: char| {
        if c == ' ' || c.is_ascii_graphic() {
            c
        } else {
            '?'
        }
    };
    name.chars().map(seven_bits).take(ROUTE_ID).collect()
}

/// Waypoint Number: 0 and 65535 are none.
const MAX_NUMBER: u16 = 65_534;
/// Characters of a Route ID.
const ROUTE_ID: usize = 32;
