//! A curved leg (50001, 50002) as the straight chords that a stock PX4 flies, within a proven tolerance.
//!
//! [`curve_paths`] defines the meaning of a curve message, and why the deviation is bounded. Here a curve gets its ends
//! from the waypoints, its altitudes a common reference, and its vertices become items of the waypoint that it leads to.

use curve_paths::flight::{
    CURVE_SWING_S, FlownItem, NotFlyable, Tight, chord_acceptance_m, climbing_mps, climbs,
    flown_bound_m, plan_flight,
};
use curve_paths::terrain::Terrain;
use curve_paths::{
    BezierLeg, Control, Densified, DensifyError, Options, Position, Vertex, densify,
};
use mavlink_link::service::mission::Item;
use stanag_msgs::messages::UaPositionWaypoint;

use super::clearance::{self, Slopes};
use super::error::{CurveError, Reason, RouteError, TerrainError};
use super::item::{self, DO_CHANGE_SPEED, NAV_WAYPOINT, change_speed};
use super::mission::{CompiledMission, Curved, Leg};
use super::site::Site;
use crate::altitude::Level;
use crate::limits::Performance;
use crate::plan::{Curve, Plan};

/// Checks the curves that start at a waypoint: at most one, and to its Next Waypoint.
pub(super) fn check(plan: &Plan, number: u16, waypoint: &UaPositionWaypoint) -> Result<(), Reason> {
    let mut curves = plan.curves_from(number).map(|(p4, _)| p4);
    let Some(to) = curves.next() else {
        return Ok(());
    };
    if let Some(other) = curves.next() {
        return Err(Reason::TwoCurves(to, other));
    }
    let next = crate::plan::next(waypoint);
    if next == to {
        Ok(())
    } else {
        Err(Reason::CurveEnd { to, next })
    }
}

/// The ground below a curve.
pub(super) struct Ground<'a> {
    /// The commanded heights above it at both ends, m; `None` if one end has another kind of altitude.
    pub(super) heights_m: Option<(f64, f64)>,
    /// Places sampled so far.
    pub(super) looked_at: &'a mut usize,
}

/// Adds the chords of the curved leg from P1 to P4, if there is one.
pub(super) fn fly(
    plan: &Plan,
    (p1, p4): (&Leg, &Leg),
    compiled: &mut CompiledMission,
    ground: &mut Ground<'_>,
    site: &Site,
) -> Result<Option<Chords>, RouteError> {
    let Some((_, curve)) = plan.curves_from(p1.number).find(|(to, _)| *to == p4.number) else {
        return Ok(None);
    };
    let speed_m_s = p4.speed_m_s.unwrap_or_else(|| compiled.speed_m_s(site));
    let refused = |fault| RouteError {
        waypoint: p1.number,
        reason: Reason::Curve {
            to: p4.number,
            fault,
        },
    };
    let chords = chords((p1, p4), curve, speed_m_s, ground, site).map_err(refused)?;
    // A straight leg is nowhere lower than the lower of its ends; a curve between two high waypoints can dip.
    for chord in &chords.vertices {
        let checked = site.limits.check_height(chord.level, site.home.amsl_m);
        checked.map_err(|fault| {
            refused(CurveError::Height {
                latitude: chord.latitude,
                longitude: chord.longitude,
                fault,
            })
        })?;
    }
    let tolerance_m = site.curving.tolerance_m;
    compiled.curved = Some(with(compiled.curved, &chords, tolerance_m));
    // Some stations interpolate in latitude and longitude: their operator sees another line than the one that is flown.
    if chords.reads_differently {
        let text = format!(
            "curve {} to {} is flown as defined; drawn in latitude and longitude it is another line",
            p1.number, p4.number
        );
        compiled.notes.push(text);
    }
    if let Some(speed_m_s) = chords.speed_at_start_m_s {
        compiled.push(p4.number, change_speed(speed_m_s, site.hovers()));
    }
    for chord in &chords.vertices {
        let place = (chord.latitude, chord.longitude);
        let params = [0.0, chords.acceptance_m, 0.0, f32::NAN];
        let item = item::placed(place, chord.level, NAV_WAYPOINT, params);
        compiled.push(p4.number, item);
        if let Some(speed_m_s) = chord.speed_m_s {
            compiled.push(p4.number, change_speed(speed_m_s, site.hovers()));
        }
    }
    Ok(Some(chords))
}

/// A level curve's vertex is passed within at most the curve's radius, a climbing curve's within at least that.
pub(super) fn accept(item: &mut Item, chords: &Chords) {
    let acceptance_m = chords.acceptance_m;
    let closer = item.params[1] > 0.0 && item.params[1] < acceptance_m;
    if item.command == NAV_WAYPOINT && (chords.climbs || !closer) {
        item.params[1] = acceptance_m;
    }
}

/// Widens the end of a curve before an item at another altitude: a multicopter swings about its altitude on the way, and
/// must stay within the radius for as long as that takes (`CURVE_SWING_S`).
pub(super) fn widen(items: &mut [Item], end: usize, performance: &Performance) {
    let z = |item: &Item| (item.frame, item.z);
    let speed_m_s = item::speed_before(items, end).unwrap_or(performance.cruise_m_s as f32);
    let next = items.iter().skip(end + 1).find(|item| item.is_flown_to());
    let differs = items
        .get(end)
        .zip(next)
        .is_some_and(|(item, next)| z(item) != z(next));
    if let Some(item) = items.get_mut(end)
        && item.command == NAV_WAYPOINT
        && differs
    {
        let wide_m = (0.5 * CURVE_SWING_S as f32 * speed_m_s).min(WIDEST_M);
        item.params[1] = item.params[1].max(wide_m);
    }
}

/// The summary of the curved legs so far, with the chords of one more.
fn with(before: Option<Curved>, chords: &Chords, tolerance_m: f64) -> Curved {
    let so_far = before.unwrap_or(Curved {
        legs: 0,
        chords: 0,
        tolerance_m,
        bound_m: 0.0,
        predicted_m: None,
        time_s: 0.0,
    });
    Curved {
        legs: so_far.legs + 1,
        chords: so_far.chords + chords.vertices.len() + 1,
        tolerance_m,
        bound_m: so_far.bound_m.max(chords.bound_m),
        predicted_m: None,
        time_s: so_far.time_s + chords.time_s,
    }
}

/// A curved leg as chords.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Chords {
    /// The vertices between P1 and P4, and the speed from each on where it changes there.
    pub vertices: Vec<Chord>,
    /// The speed from P1 on, if it differs from the requested one.
    pub speed_at_start_m_s: Option<f64>,
    /// Acceptance radius for all vertices and both ends, m.
    pub acceptance_m: f32,
    /// A hovering vehicle climbs or descends along it.
    pub climbs: bool,
    /// The speed was lowered somewhere and must be set again after P4.
    pub slowed: bool,
    /// A station that draws the cubic in latitude and longitude shows another line.
    pub reads_differently: bool,
    /// Proven deviation of the chords, m.
    pub bound_m: f64,
    /// Predicted time on the curve, s.
    pub time_s: f64,
}

/// One vertex of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Chord {
    /// Degrees north.
    pub latitude: f64,
    /// Degrees east.
    pub longitude: f64,
    /// Its altitude, in the reference of both ends.
    pub level: Level,
    /// The speed from there on, m/s, where it changes.
    pub speed_m_s: Option<f64>,
}

/// Makes the chords of the curve from `p1` to `p4`, flown at `speed_m_s`.
///
/// # Errors
/// A field is missing or not finite, a control point is over 50 km from its end, or the curve is too tight.
fn chords(
    (p1, p4): (&Leg, &Leg),
    curve: &Curve,
    speed_m_s: f64,
    ground: &mut Ground<'_>,
    site: &Site,
) -> Result<Chords, CurveError> {
    let over = ground.heights_m.zip(site.terrain);
    let (leg, above_home) = bezier((p1, p4), curve, ground.heights_m, site)?;
    let legs = [curve_paths::Leg::Bezier(leg)];
    let tolerance_m = site.curving.tolerance_m;
    let options = Options {
        vertices: site.curving.vertices,
        ..Options::flight(tolerance_m)
    };
    let mut densified = densify(&legs, &options).map_err(too_sharp)?;
    if let Some((_, terrain)) = over {
        let slopes = site.wings.as_ref();
        let slopes = slopes.map(|wings| Slopes::of(wings, speed_m_s));
        lay_over(&mut densified, slopes, terrain, ground.looked_at)?;
        if let Some(wings) = &site.wings {
            for pair in densified.vertices.windows(2) {
                let [from, to] = [pair[0].position, pair[1].position];
                let distance_m = from.ground().distance_m(to.ground());
                let steep = wings.check_climb(to.alt_m - from.alt_m, distance_m, speed_m_s);
                steep.map_err(|fault| CurveError::Shape(fault.to_string()))?;
            }
        }
    }
    let airframe = site.airframe();
    let climbs = site.hovers() && climbs(&densified.vertices);
    let flown = plan_flight(
        &legs,
        &densified,
        &airframe,
        &[speed_m_s],
        site.curving.policy,
    )
    .map_err(not_flyable)?;
    let speed_at = |vertex: usize| {
        let change = flown.changes.iter().find(|change| change.vertex == vertex);
        change.map(|change| change.speed_mps)
    };
    // The first and last vertex are the waypoints P1 and P4, which have their own items.
    let last = densified.vertices.len().saturating_sub(1);
    let vertices = densified
        .vertices
        .iter()
        .enumerate()
        .take(last)
        .skip(1)
        .map(|(index, vertex)| {
            let Position {
                lat_deg,
                lon_deg,
                alt_m,
            } = vertex.position;
            let level = if above_home {
                Level::AboveHome(alt_m)
            } else {
                Level::Amsl(alt_m)
            };
            Chord {
                latitude: lat_deg,
                longitude: lon_deg,
                level,
                speed_m_s: speed_at(index),
            }
        });
    let mut acceptance_m = chord_acceptance_m(densified.shortest_chord_m);
    // Half a chord at most: with a larger radius PX4 would skip vertices.
    if climbs {
        let half_m = 0.5 * densified.shortest_chord_m;
        let climbing_m_s = climbing_mps(speed_m_s, densified.shortest_chord_m);
        acceptance_m =
            (0.5 * CURVE_SWING_S * climbing_m_s).clamp(acceptance_m, half_m.max(acceptance_m));
    }
    Ok(Chords {
        vertices: vertices.collect(),
        speed_at_start_m_s: speed_at(0),
        acceptance_m: acceptance_m as f32,
        climbs,
        slowed: !flown.changes.is_empty(),
        reads_differently: leg.reads_differently(tolerance_m),
        bound_m: densified.bound_m,
        time_s: flown.curves_s,
    })
}

/// The geometry numbers the legs of a route, and is given one: which, the route's error says by its waypoints. What is left to say is where
/// on it, and what can be changed on a bridge.
fn too_sharp(fault: DensifyError) -> CurveError {
    CurveError::Shape(match fault {
        DensifyError::ChordTooShort {
            at,
            min_chord_m,
            tolerance_m,
            ..
        } => format!(
            "{}: it turns or climbs too sharply for chords of {min_chord_m} m or longer within {tolerance_m} m: make it wider or \
             less steep there, or raise vehicle.curve.tolerance_m",
            place(at)
        ),
        fault => fault.to_string(),
    })
}

fn not_flyable(fault: NotFlyable) -> CurveError {
    let turn = |tight: &Tight| format!("{}: radius {:.1} m", place(tight.position), tight.radius_m);
    match fault {
        NotFlyable::ClimbsTooFast {
            speed_mps,
            chord_m,
            fastest_mps,
            ..
        } => CurveError::ClimbsTooFast {
            speed_m_s: speed_mps,
            chord_m,
            fastest_m_s: fastest_mps,
        },
        NotFlyable::TooFast(tight, speed_mps) => CurveError::Shape(format!(
            "{}, {speed_mps} m/s requested, at most {:.1} m/s: fly slower, make it wider there, or set vehicle.curve.policy to \"slow\"",
            turn(&tight),
            tight.fastest_mps
        )),
        NotFlyable::TooTight(tight, slowest_mps) => CurveError::Shape(format!(
            "{} allows {:.1} m/s, the slowest is {slowest_mps} m/s: make it wider there",
            turn(&tight),
            tight.fastest_mps
        )),
        NotFlyable::Speed { .. } => CurveError::Shape(fault.to_string()),
    }
}

fn place(at: Position) -> String {
    format!("at {:.6}, {:.6}", at.lat_deg, at.lon_deg)
}

/// The curve from `p1` to `p4`, and whether its altitudes are heights above home; otherwise they are above mean sea level, or
/// above the ground where `heights_m` gives those of both ends.
///
/// # Errors
/// A field is missing or not finite, or a control point is over 50 km from its end.
pub(super) fn bezier(
    (p1, p4): (&Leg, &Leg),
    curve: &Curve,
    heights_m: Option<(f64, f64)>,
    site: &Site<'_>,
) -> Result<(BezierLeg, bool), CurveError> {
    // Heights stay relative if both ends are; a leg of mixed references is converted to altitudes above sea level.
    let above_home = matches!(
        (p1.level, p4.level),
        (Level::AboveHome(_), Level::AboveHome(_))
    );
    let over = heights_m.zip(site.terrain);
    let metres = |level: Level, place: (f64, f64)| {
        let base_m = match over {
            // Heights above the ground are planned as the curve describes them over a level plane; the plane then takes the
            // shape of the ground.
            Some(_) => site.datum().ground_m(place)?,
            None if above_home => site.home.amsl_m,
            None => 0.0,
        };
        Ok(level.amsl(site.home.amsl_m) - base_m)
    };
    let (p2, p3) = controls(curve, site, &metres)?;
    let position = |leg: &Leg, height_m: Option<f64>| {
        let alt_m = match height_m {
            Some(height_m) => height_m,
            None => metres(leg.level, leg.place())?,
        };
        Ok::<_, CurveError>(Position::new(leg.latitude, leg.longitude, alt_m))
    };
    let [first_m, last_m] = [
        over.map(|((first_m, _), _)| first_m),
        over.map(|((_, last_m), _)| last_m),
    ];
    let leg = BezierLeg::new(position(p1, first_m)?, p2, p3, position(p4, last_m)?)
        .map_err(|fault| CurveError::Shape(fault.to_string()))?;
    Ok((leg, above_home))
}

/// Turns heights above the ground into altitudes above mean sea level, and adds the points that the ground between two
/// vertices requires. In the plane the chords stay where they are.
fn lay_over(
    densified: &mut Densified,
    slopes: Option<Slopes>,
    terrain: &Terrain,
    looked_at: &mut usize,
) -> Result<(), TerrainError> {
    let vertices = std::mem::take(&mut densified.vertices);
    let nodes: Vec<Position> = vertices.iter().map(|vertex| vertex.position).collect();
    for point in clearance::follow(&nodes, slopes, terrain, looked_at)? {
        let Some(vertex) = vertices.get(point.node) else {
            continue;
        };
        let next = vertices.get(point.node + 1).unwrap_or(vertex);
        let position = point.position;
        if let Some(before) = densified.vertices.last() {
            let before: Position = before.position;
            let chord_m = before.ground().distance_m(position.ground());
            densified.shortest_chord_m = densified.shortest_chord_m.min(chord_m);
        }
        densified.vertices.push(Vertex {
            position,
            t: vertex.t + point.part * (next.t - vertex.t),
            ..*vertex
        });
    }
    Ok(())
}

/// The deviation within which the curves of a mission are flown, m; `None` without curves, and on wings in a wind too
/// strong for the speed. Computed over the whole mission, since a curve is entered in the state in which the leg before
/// ends.
pub(super) fn flown_m(plan: &Plan, compiled: &CompiledMission, site: &Site) -> Option<f64> {
    let pairs = compiled.order.windows(2);
    let curved: Vec<u16> = pairs
        .filter(|pair| {
            plan.curves_from(pair[0].number)
                .any(|(to, _)| to == pair[1].number)
        })
        .map(|pair| pair[1].number)
        .collect();
    let mut speed_mps = site.performance.cruise_m_s;
    let mut items = Vec::new();
    for (item, number) in compiled.items.iter().zip(&compiled.waypoint_of) {
        if item.command == DO_CHANGE_SPEED {
            speed_mps = f64::from(item.params[1]);
        }
        if !item.is_flown_to() {
            continue;
        }
        let own_m = f64::from(item.params[1]);
        let own = item.command == NAV_WAYPOINT && own_m > 0.0;
        let level = Level::of_frame(item.frame, item.z.into())?;
        let degrees = |e7: i32| f64::from(e7) * 1e-7;
        items.push(FlownItem {
            position: Position::new(
                degrees(item.x),
                degrees(item.y),
                level.amsl(site.home.amsl_m),
            ),
            speed_mps,
            acceptance_m: if own {
                own_m
            } else {
                site.performance.acceptance_m
            },
            curved: curved.contains(number),
        });
    }
    flown_bound_m(&items, compiled.curved?.bound_m, &site.airframe())
}

fn controls(
    curve: &Curve,
    site: &Site,
    metres: &dyn Fn(Level, (f64, f64)) -> Result<f64, CurveError>,
) -> Result<(Control, Control), CurveError> {
    match curve {
        Curve::Paper(curve) => {
            // 50001 carries radians as doubles.
            let point =
                |latitude: Option<f64>, longitude: Option<f64>, names: [&'static str; 2]| {
                    let latitude = latitude.ok_or(CurveError::Missing(names[0]))?;
                    let longitude = longitude.ok_or(CurveError::Missing(names[1]))?;
                    Ok::<_, CurveError>(Control::level(
                        latitude.to_degrees(),
                        longitude.to_degrees(),
                    ))
                };
            Ok((
                point(
                    curve.p2_latitude,
                    curve.p2_longitude,
                    ["P2 Latitude", "P2 Longitude"],
                )?,
                point(
                    curve.p3_latitude,
                    curve.p3_longitude,
                    ["P3 Latitude", "P3 Longitude"],
                )?,
            ))
        }
        Curve::Native(curve) => {
            let degrees = |bam: Option<stanag_msgs::Bam32>, name| {
                bam.map(|bam| bam.degrees())
                    .ok_or(CurveError::Missing(name))
            };
            let control =
                |lat_deg: f64, lon_deg: f64, altitude: Option<stanag_msgs::scalar::Altitude>| {
                    let place = (lat_deg, lon_deg);
                    let level = altitude.map(|altitude| {
                        let kind = curve.altitude_type;
                        site.datum().level(altitude.si(), kind, [place])
                    });
                    let level = level.transpose()?;
                    Ok::<_, CurveError>(Control {
                        lat_deg,
                        lon_deg,
                        alt_m: level.map(|level| metres(level, place)).transpose()?,
                    })
                };
            Ok((
                control(
                    degrees(curve.p2_latitude, "P2 Latitude")?,
                    degrees(curve.p2_longitude, "P2 Longitude")?,
                    curve.p2_altitude,
                )?,
                control(
                    degrees(curve.p3_latitude, "P3 Latitude")?,
                    degrees(curve.p3_longitude, "P3 Longitude")?,
                    curve.p3_altitude,
                )?,
            ))
        }
    }
}

/// The largest radius for the end of a curve, m.
const WIDEST_M: f32 = 20.0;
