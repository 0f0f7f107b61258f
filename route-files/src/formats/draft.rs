//! A route as a file has it: points with what is done there, curves between them, what the altitudes are above, and
//! what else the file holds. Altitudes may be absent.

use std::path::{Path, PathBuf};

use clap::Args;
use curve_paths::{BezierLeg, Control, Leg, Options, Position, densify};
use stanag_msgs::enums::{AltitudeType, LimitType, TurnType, WaypointSpeedType};

use super::fault::FormatError;
use super::losses::Losses;
use super::terrain::{Clearance, Terrain};
use crate::fence::Area;
use crate::route::model::{Loiter, Route};

/// A route or a track.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Draft {
    /// Its name; that of the file where it has none.
    pub name: String,
    /// Whether the last point's leg leads back to the first.
    pub closed: bool,
    /// The path.
    pub points: Vec<Point>,
    /// What the altitudes are above.
    pub datum: Datum,
    /// Its heights are above the ground below each point, which without terrain is taken as home's.
    pub over_ground: bool,
    /// How far it is above the ground, where that is known.
    pub clearance: Option<Clearance>,
    /// Where the file expects the vehicle to start.
    pub home: Option<Position>,
    /// The geofence.
    pub areas: Vec<Area>,
    /// Places to return to instead of home.
    pub rally: Vec<Position>,
    /// Cruise and hover speed that a .plan estimates its times by, m/s: commanded to nobody, and only there.
    pub planned_m_s: Option<[f64; 2]>,
    /// Mission items that are no part of the path: only mission files hold them.
    pub extras: Vec<Extra>,
    /// What of the file is not in here.
    pub losses: Losses,
    /// The ground station's route that it was read from, with its own numbers.
    pub plan: Option<Route>,
}

/// A point of the path and, where the leg to the next one is curved, its control points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Where.
    pub position: Position,
    /// The line of the file that it stood on, where there is one to name.
    pub line: Option<u64>,
    /// P2 and P3 of the leg that starts here.
    pub curve: Option<[Control; 2]>,
    /// Why `position.alt_m` means nothing.
    pub no_altitude: Option<NoAltitude>,
    /// How the file calls it: its number among the items.
    pub item: usize,
    /// What is done there.
    pub conduct: Conduct,
}

/// How a point is flown to, and what is done there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Conduct {
    /// Speed of the leg to it, m/s; absent: as before.
    pub speed_m_s: Option<f64>,
    /// What that speed is measured against; absent is the ground.
    pub speed_type: Option<WaypointSpeedType>,
    /// Short turn or fly over.
    pub turn: Option<TurnType>,
    /// What is done there.
    pub loiter: Option<Loiter>,
    /// From here back to an earlier point.
    pub repeat: Option<Repeat>,
    /// It is where a take-off ends.
    pub take_off: Option<TakeOff>,
    /// How a loiter is left, where the file says so.
    pub exit: Option<LoiterExit>,
}

/// How a loiter is left: parameters of a mission item that no waypoint of a ground station has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoiterExit {
    /// Param2 of a loiter by time or turns: other than 0, only once the vehicle heads for the next waypoint.
    pub heading: f64,
    /// Param4: 1 on the tangent to the next waypoint, 0 from the middle.
    pub tangent: f64,
}

impl LoiterExit {
    /// `None` for what is the vehicle's own way: 0, or nothing.
    #[must_use]
    pub fn of(heading: f64, tangent: f64) -> Option<Self> {
        let given = |x: f64| x.is_finite() && x != 0.0;
        let finite = |x: f64| if x.is_finite() { x } else { 0.0 };
        (given(heading) || given(tangent)).then(|| Self {
            heading: finite(heading),
            tangent: finite(tangent),
        })
    }
}

/// The end of a loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Repeat {
    /// The point that it leads back to, an index.
    pub to: usize,
    /// What the limit counts.
    pub limit_type: LimitType,
    /// The limit: rounds or seconds.
    pub limit: u16,
}

/// A take-off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TakeOff {
    /// MAV_CMD_NAV_TAKEOFF.
    Plain,
    /// MAV_CMD_NAV_VTOL_TAKEOFF, with the transition after it.
    Vtol,
}

/// A mission item that is no part of the path, as it stands in its file.
#[derive(Clone, Debug, PartialEq)]
pub struct Extra {
    /// The number of points before it.
    pub after: usize,
    /// How the file calls it: its number among the items.
    pub item: usize,
    /// MAV_CMD.
    pub command: u16,
    /// MAV_FRAME.
    pub frame: u8,
    /// The seven parameters; NaN is none.
    pub params: [f64; 7],
}

/// Why a point has no altitude to fly at.
#[derive(Clone, Copy, Debug, Eq, PartialEq, thiserror::Error)]
pub enum NoAltitude {
    /// The file gives none there.
    #[error("no altitude")]
    Missing,
    /// The file's is that of the ground, or is drawn on the ground.
    #[error("its altitude is the ground's, which is none to fly at")]
    Ground,
}

impl Point {
    /// A point that is flown to on a straight leg.
    #[must_use]
    pub fn straight(position: Position, line: Option<u64>) -> Self {
        Self {
            position,
            line,
            curve: None,
            no_altitude: None,
            item: 0,
            conduct: Conduct::default(),
        }
    }

    /// A point of a file in which the altitude may be absent: the number beside it is never used then.
    #[must_use]
    pub fn found(
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

/// Takes the last point of a ring away where it repeats the first, as rings of KML and GeoJSON do. A ring that was left open
/// ends with a point of its own.
pub(super) fn open_ring(ring: &mut Vec<Point>) {
    let place = |point: &Point| (point.position.lat_deg, point.position.lon_deg);
    if let [first, .., last] = ring.as_slice()
        && place(first) == place(last)
    {
        ring.pop();
    }
}

/// The altitude of all points, where a file does not give it, and the ground below them.
#[derive(Clone, Debug, Default, Args)]
pub struct Level {
    /// Put a route without altitudes at this altitude, m above mean sea level.
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    altitude: Option<f64>,
    /// Put a route without altitudes at this height, m: above home, or above the ground with --terrain.
    #[arg(
        long,
        value_name = "M",
        conflicts_with = "altitude",
        allow_negative_numbers = true
    )]
    height: Option<f64>,
    /// Read the ground from this file (.hgt, .asc) or folder of SRTM tiles, and refuse a route below it.
    #[arg(long, value_name = "PATH")]
    terrain: Option<PathBuf>,
}

impl Level {
    /// At this altitude above mean sea level, or this height above home, m.
    pub(super) const fn at(altitude: Option<f64>, height: Option<f64>) -> Self {
        Self {
            altitude,
            height,
            terrain: None,
        }
    }

    /// Whether the command line gives one.
    pub(super) const fn is_given(&self) -> bool {
        self.altitude.is_some() || self.height.is_some() || self.terrain.is_some()
    }

    /// The ground, where it is given.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn terrain(&self) -> Result<Option<Terrain>, FormatError> {
        self.terrain.as_deref().map(Terrain::open).transpose()
    }
}

/// What altitudes are above.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum Datum {
    /// Mean sea level.
    #[default]
    SeaLevel,
    /// Home, which is what the DLI's AGL is flown as.
    Home,
    /// The WGS-84 ellipsoid.
    Ellipsoid,
    /// 1013.25 hPa in the standard atmosphere: how far that is from mean sea level depends on the weather.
    Pressure,
    /// Not stated.
    Unstated,
}

impl Datum {
    /// That of an altitude type of the DLI.
    #[must_use]
    pub fn of(kind: Option<AltitudeType>) -> Self {
        match kind {
            Some(AltitudeType::Barometric) => Self::SeaLevel,
            Some(AltitudeType::Pressure) => Self::Pressure,
            Some(AltitudeType::Agl) => Self::Home,
            Some(AltitudeType::Wgs84) => Self::Ellipsoid,
            _ => Self::Unstated,
        }
    }

    /// Of heights above home, or of altitudes.
    #[must_use]
    pub const fn above_home(is: bool) -> Self {
        if is { Self::Home } else { Self::SeaLevel }
    }

    pub(super) const fn altitude_type(self) -> Option<AltitudeType> {
        match self {
            Self::SeaLevel => Some(AltitudeType::Barometric),
            Self::Home => Some(AltitudeType::Agl),
            Self::Ellipsoid => Some(AltitudeType::Wgs84),
            Self::Pressure => Some(AltitudeType::Pressure),
            Self::Unstated => None,
        }
    }
}

impl Draft {
    /// Its points, one after the other as the file has them, named by their numbers from 1.
    pub(super) fn numbered(mut self) -> Self {
        for (k, point) in self.points.iter_mut().enumerate() {
            point.item = k + 1;
        }
        self.losses.items = self.points.len();
        self
    }

    /// How a point is called: by the number of its waypoint or item in its file.
    #[must_use]
    pub fn number(&self, k: usize) -> usize {
        let item = self.points.get(k).map_or(0, |point| point.item);
        if item == 0 { k + 1 } else { item }
    }

    /// The positions of its points.
    #[must_use]
    pub fn positions(&self) -> Vec<Position> {
        self.points.iter().map(|point| point.position).collect()
    }

    /// Whether any leg is curved.
    #[must_use]
    pub fn is_curved(&self) -> bool {
        self.points.iter().any(|point| point.curve.is_some())
    }

    /// Puts all points at the altitude of the command line, where there is one; else each must have its own. Heights above
    /// ground become altitudes where the ground is known.
    ///
    /// An absent altitude is never a number: an aircraft would descend to it.
    ///
    /// # Errors
    /// A point has no altitude and the command line gives none, or both do; or the ground is not known there.
    pub fn level(
        &mut self,
        level: &Level,
        terrain: Option<&Terrain>,
        file: &Path,
    ) -> Result<(), FormatError> {
        let all_m = level.altitude.or(level.height);
        if all_m.is_none() {
            self.each_has_an_altitude(file)?;
        } else if self.plan.is_some() {
            let problem = "the route file has altitudes: --altitude and --height are for files that have none";
            return Err(FormatError::Option(problem.into()));
        }
        if let Some(all_m) = all_m {
            for w in &mut self.points {
                w.position.alt_m = all_m;
                w.no_altitude = None;
            }
            self.datum = Datum::above_home(level.height.is_some());
            self.over_ground = level.height.is_some();
        }
        if let Some(terrain) = terrain.filter(|_| self.over_ground) {
            for w in &mut self.points {
                w.position.alt_m += terrain.height_m(w.position.lat_deg, w.position.lon_deg)?;
            }
            self.datum = Datum::SeaLevel;
            self.over_ground = false;
        }
        Ok(())
    }

    /// How many points have no altitude, and the first of them.
    #[must_use]
    pub fn without_altitude(&self) -> Option<(usize, usize)> {
        let absent = |w: &Point| w.no_altitude.is_some();
        let first = self.points.iter().position(absent)?;
        Some((self.points.iter().filter(|w| absent(w)).count(), first))
    }

    fn each_has_an_altitude(&self, file: &Path) -> Result<(), FormatError> {
        let mut points = self.points.iter().enumerate();
        let absent = points.find_map(|(k, w)| Some((k, w.line, w.no_altitude?)));
        let Some((k, line, why)) = absent else {
            return Ok(());
        };
        let (all, count) = (
            self.points.len(),
            self.without_altitude().map_or(0, |(count, _)| count),
        );
        let problem = format!(
            "{why} ({count} of {all} points have none); expected one for each, or one for all by --altitude or --height, \
             above home or, with --terrain, above the ground"
        );
        Err(FormatError::at(
            file,
            line,
            format!("point {}", k + 1),
            problem,
        ))
    }

    /// The legs, each checked.
    ///
    /// # Errors
    /// There are none, or one of them cannot be flown to.
    pub fn legs(&self, file: &Path) -> Result<Vec<Leg>, FormatError> {
        let n = self.points.len();
        if n < 2 {
            return Err(FormatError::file(
                file,
                format!("{n} waypoints, expected at least 2"),
            ));
        }
        self.check_positions(file)?;
        let last = if self.closed { n } else { n - 1 };
        let next = self.points.iter().cycle().skip(1);
        let pairs = self.points.iter().zip(next).take(last).enumerate();
        pairs
            .map(|(k, (from, to))| {
                match from.curve {
                    Some([p2, p3]) => {
                        BezierLeg::new(from.position, p2, p3, to.position).map(Leg::from)
                    }
                    None => Leg::straight(from.position, to.position),
                }
                .map_err(|e| {
                    let field = format!("leg from waypoint {}", self.number(k));
                    FormatError::at(file, from.line, field, e)
                })
            })
            .collect()
    }

    /// Checks that each point is a place on the Earth: in a message an angle beyond its range would name another place, and
    /// one that is not a number 0 degrees.
    ///
    /// # Errors
    /// The first that is none, by its line.
    pub(super) fn check_positions(&self, file: &Path) -> Result<(), FormatError> {
        for (k, w) in self.points.iter().enumerate() {
            w.position.checked().map_err(|e| {
                FormatError::at(file, w.line, format!("waypoint {}", self.number(k)), e)
            })?;
        }
        Ok(())
    }

    /// Where it is nearest to the ground, between its points too.
    ///
    /// # Errors
    /// It is on the ground or below it somewhere; or its heights are not above mean sea level, as those of the ground are.
    pub fn above_ground(&self, terrain: &Terrain, file: &Path) -> Result<Clearance, FormatError> {
        let home_m = match (self.datum, self.home) {
            (Datum::SeaLevel, _) => 0.0,
            (Datum::Home, Some(home)) => home.alt_m,
            (Datum::Home, None) => {
                let problem = "heights above home are compared with the terrain by the altitude of home: give --home-alt M";
                return Err(FormatError::file(file, problem));
            }
            (Datum::Ellipsoid | Datum::Pressure | Datum::Unstated, _) => {
                let problem = "the terrain is above mean sea level, and so must the route's altitudes be (amsl)";
                return Err(FormatError::file(file, problem));
            }
        };
        let answer =
            |problem: String| FormatError::Answer(format!("{}: {problem}", file.display()));
        let mut flown = densify(&self.legs(file)?, &Options::flight(FINE_M))
            .map_err(|e| answer(e.to_string()))?;
        for vertex in &mut flown.vertices {
            vertex.position.alt_m += home_m;
        }
        let lowest = terrain.clearance(&flown)?;
        if lowest.clearance_m > 0.0 {
            return Ok(lowest);
        }
        let (at, from) = (lowest.at, self.number(lowest.leg));
        Err(answer(format!(
            "leg from waypoint {from}: {:.1} m below the ground at {:.6}, {:.6} ({:.1} m, the ground {:.1} m): raise it",
            -lowest.clearance_m,
            at.lat_deg,
            at.lon_deg,
            at.alt_m,
            at.alt_m - lowest.clearance_m
        )))
    }

    /// Turns heights above home into altitudes, home being so high.
    pub fn lift(&mut self, home_m: f64) {
        if self.datum != Datum::Home {
            return;
        }
        self.datum = Datum::SeaLevel;
        for w in &mut self.points {
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

    /// The points as a format writes them that knows no closed path: the first once more at the end of a closed one. A
    /// loop leads back by itself.
    pub(super) fn written(&self) -> Vec<Point> {
        let mut points = self.points.clone();
        let place = |point: &Point| (point.position.lat_deg, point.position.lon_deg);
        if let [.., end, copy] = points.as_slice()
            && let Some(repeat) = end.conduct.repeat
            && points.get(repeat.to).map(place) == Some(place(copy))
        {
            points.pop();
        } else if let (true, Some(first)) = (self.closed, points.first().copied())
            && points
                .last()
                .is_some_and(|last| last.conduct.repeat.is_none())
        {
            points.push(Point {
                curve: None,
                conduct: Conduct::default(),
                ..first
            });
        }
        points
    }
}

/// How closely a curve is followed over the ground, m.
const FINE_M: f64 = 1.0;
