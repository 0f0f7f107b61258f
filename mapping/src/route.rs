//! A route becomes mission items for PX4, or a refusal that names the waypoint.
//!
//! Everything is validated here, since PX4 is no check: it takes latitude 200, a NaN altitude and a jump to item 99.
//!
//! | DLI | PX4 |
//! |---|---|
//! | waypoint (13002) | NAV_WAYPOINT, the altitude in the frame of its type |
//! | Waypoint to Speed (0802.10) | DO_CHANGE_SPEED before it: the speed of the leg to it |
//! | Turn Type (0802.16) 0 or absent | acceptance radius 0: the vehicle's own, NAV_ACC_RAD |
//! | Turn Type 1, fly over | acceptance radius 3 m: PX4 misses smaller ones for good |
//! | loiter (13003) | NAV_LOITER_TIME or NAV_LOITER_UNLIM: `loiter` |
//! | Waypoint Type (0802.17) 1, end of a loop | DO_JUMP after it: `loops` |

use geo::{Distance, Haversine, Point};
use mavlink_link::service::mission::Item;
use stanag_msgs::enums::{LocationType, LoiterType, TurnType, WaypointSpeedType};
use stanag_msgs::messages::{UaLoiterWaypoint, UaPositionWaypoint};

use crate::altitude::{self, Agl, Altimeter, AltitudeError, Level};
use crate::brake;
use crate::budget;
use crate::curve::{self, Chords, CurveError, Curved, Curving};
use crate::loiter::{self, WIDEST_CIRCLE_M};
use crate::loops::{self, DO_JUMP};
use crate::plan::Plan;
use crate::telemetry::Place;

/// What a route must stay within.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Farthest first waypoint from home, m.
    pub first_m: f64,
    /// Longest leg, m.
    pub leg_m: f64,
    /// Lowest waypoint, m above home.
    pub lowest_m: f64,
    /// Highest waypoint, m above home.
    pub highest_m: f64,
    /// Fastest commanded speed, m/s.
    pub speed_m_s: f64,
    /// Most mission items.
    pub items: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Limits {
            first_m: 5_000.0,
            leg_m: 50_000.0,
            lowest_m: -500.0,
            highest_m: 5_000.0,
            speed_m_s: 100.0,
            items: 500,
        }
    }
}

/// What must be known of the vehicle to fly a route.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Site {
    /// Home.
    pub home: Place,
    /// Height of the geoid above the ellipsoid, m, once the vehicle has told it.
    pub geoid_m: Option<f64>,
    /// How AGL is flown.
    pub agl: Agl,
    /// What pressure altitudes are flown by.
    pub altimeter: Altimeter,
    /// Whether it can stand still.
    pub hovers: bool,
    /// Bounds.
    pub limits: Limits,
    /// How curved legs are flown.
    pub curving: Curving,
}

/// A route as it goes to PX4, and whose waypoint each item is.
#[derive(Debug, Clone, PartialEq)]
pub struct Flight {
    /// The items, the first with `current` set.
    pub items: Vec<Item>,
    /// The CUCS's waypoint number of each item.
    pub waypoint_of: Vec<u16>,
    /// The waypoints in the order that they are flown.
    pub order: Vec<Leg>,
    /// What became of its curved legs, where it has any.
    pub curved: Option<Curved>,
    /// What the operator should know of it.
    pub notes: Vec<String>,
}

/// A waypoint of a route with what 4001 reports of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leg {
    /// The CUCS's number.
    pub number: u16,
    /// Where; the altitude as `level`.
    pub latitude: f64,
    /// Degrees east.
    pub longitude: f64,
    /// Its altitude.
    pub level: Level,
    /// Commanded speed of the leg to it, m/s.
    pub speed_m_s: Option<f64>,
}

impl Flight {
    /// The first item made for a waypoint: where a flight to it starts.
    #[must_use]
    pub fn first_item_of(&self, waypoint: u16) -> Option<u16> {
        let leg = self.order.iter().find(|leg| leg.number == waypoint)?;
        let (x, y) = (degrees_e7(leg.latitude), degrees_e7(leg.longitude));
        // The chords of a curve that leads to it are passed over: a flight to the waypoint goes straight there.
        let mut at = self
            .items
            .iter()
            .zip(&self.waypoint_of)
            .position(|(item, number)| {
                *number == waypoint && item.is_global() && (item.x, item.y) == (x, y)
            })?;
        while let Some(before) = at.checked_sub(1)
            && self.waypoint_of.get(before) == Some(&waypoint)
            && self
                .items
                .get(before)
                .is_some_and(|item| item.command == DO_CHANGE_SPEED)
        {
            at = before;
        }
        u16::try_from(at).ok()
    }

    /// Makes PX4 stop at those of these items that it could miss for good, and says so.
    fn brake(&mut self, straight: &[usize]) {
        let braked = brake::where_height_changes(&mut self.items, straight);
        let mut numbers: Vec<u16> = braked
            .iter()
            .skip(1)
            .filter_map(|at| self.waypoint_of.get(*at).copied())
            .collect();
        numbers.dedup();
        if !numbers.is_empty() {
            let numbers: Vec<String> = numbers.iter().map(u16::to_string).collect();
            self.notes.push(format!(
                "it climbs or descends fast or at small radii, to or from waypoint {}: the vehicle stops at each \
                 point there, or it could miss one and fly on",
                numbers.join(", ")
            ));
        }
    }

    /// The first item with a place at or after this one: PX4 does the ones before it at once.
    #[must_use]
    pub fn place_from(&self, seq: u16) -> u16 {
        let on = self.items.iter().skip(usize::from(seq));
        let steps = on.take_while(|item| !item.is_global()).count();
        seq.saturating_add(u16::try_from(steps).unwrap_or(0))
    }

    /// The leg that has been flown to its end where this item is reached, as an index of `order`: `None` for the
    /// chords of a curve on the way to its end, and for items without a place.
    #[must_use]
    pub fn leg_ended_by(&self, seq: u16) -> Option<usize> {
        let at = usize::from(seq);
        let number = self.waypoint_of.get(at)?;
        let mut after = self.items.iter().zip(&self.waypoint_of).skip(at + 1);
        let more = after.any(|(item, of)| of == number && item.is_global());
        (self.items.get(at)?.is_global() && !more).then(|| self.leg_of_item(seq))?
    }

    /// The loop of the route: (its last leg, its first leg, how often it leads back), legs as indices of `order`.
    #[must_use]
    pub fn circuit(&self) -> Option<(usize, usize, u16)> {
        let at = self.items.iter().position(|item| item.command == DO_JUMP)?;
        let [first, times, ..] = self.items.get(at)?.params;
        let end = self.leg_of_item(u16::try_from(at).ok()?)?;
        Some((end, self.leg_of_item(first as u16)?, times as u16))
    }

    /// The leg that an item belongs to, as an index of `order`.
    #[must_use]
    pub fn leg_of_item(&self, seq: u16) -> Option<usize> {
        let number = self.waypoint_of.get(usize::from(seq))?;
        self.order.iter().position(|leg| leg.number == *number)
    }
}

/// Why a route cannot be flown, and at which waypoint.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("waypoint {waypoint}: {reason}")]
pub struct RouteError {
    /// The offending waypoint, as the CUCS numbers it.
    pub waypoint: u16,
    /// Why.
    pub reason: Reason,
}

/// Why a waypoint cannot be flown.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Reason {
    /// A Next Waypoint or an Initial Waypoint Number that no 13002 has described.
    #[error("not received")]
    Unknown,
    /// A Next Waypoint leads back, and not from the end of a loop.
    #[error("the route comes back to it: only Waypoint Type 1 (end of a loop) may lead back")]
    Loop,
    /// The end of a loop leads nowhere, to itself, or on.
    #[error("the end of a loop leads to {0}, expected a waypoint flown before it")]
    LoopStart(u16),
    /// A loop that is never flown.
    #[error("Loop Limit 0, expected 1 to 65535")]
    LoopLimit,
    /// A loop limited by time.
    #[error("Limit Type 2 (time): PX4 counts loops, it does not time them")]
    LoopTime,
    /// A field that cannot be done without.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// Latitude beyond the poles.
    #[error("latitude {0:.4} deg, expected -90 to 90")]
    Latitude(f64),
    /// Coordinates relative to the route's reference.
    #[error("relative coordinates (Location Type {0}) are not flown")]
    Relative(u8),
    /// The altitude has no usable reference.
    #[error(transparent)]
    Altitude(#[from] AltitudeError),
    /// Too low or too high.
    #[error("{height_m:.0} m above home, expected {lowest_m:.0} to {highest_m:.0}")]
    Height {
        /// Metres above home.
        height_m: f64,
        /// Lowest allowed.
        lowest_m: f64,
        /// Highest allowed.
        highest_m: f64,
    },
    /// AGL at or below the ground.
    #[error("{0:.1} m above ground, expected more than 0")]
    InTheGround(f64),
    /// The first waypoint is too far from home.
    #[error("{distance_m:.0} m from home, at most {most_m:.0}")]
    FarFromHome {
        /// Metres.
        distance_m: f64,
        /// Metres.
        most_m: f64,
    },
    /// A leg is too long.
    #[error("{distance_m:.0} m from the waypoint before, at most {most_m:.0}")]
    LongLeg {
        /// Metres.
        distance_m: f64,
        /// Metres.
        most_m: f64,
    },
    /// A speed that cannot be flown.
    #[error("speed {speed_m_s:.1} m/s, expected above 0, at most {most_m_s:.0}")]
    Speed {
        /// m/s
        speed_m_s: f64,
        /// m/s
        most_m_s: f64,
    },
    /// An arrival time: PX4 flies speeds only.
    #[error("Waypoint Speed Type 3 (arrival time): PX4 flies speeds only")]
    ArrivalTime,
    /// A value that no source names.
    #[error("{field} {value} is not known")]
    UnknownValue {
        /// The field.
        field: &'static str,
        /// Its value.
        value: u8,
    },
    /// A pattern that PX4 cannot fly.
    #[error("PX4 cannot loiter in a {0}")]
    LoiterType(&'static str),
    /// A circle that is too wide.
    #[error("Loiter Radius {0:.0} m, at most {most:.0}", most = WIDEST_CIRCLE_M)]
    LoiterRadius(f64),
    /// A number of turns: PX4 has no such item.
    #[error(
        "a loiter of so many turns: PX4 flies times only, and a fixed wing's turns as a time where radius and speed \
         are given"
    )]
    LoiterTurns,
    /// A curved leg that cannot be flown.
    #[error("its curved leg to {to}: {fault}")]
    Curve {
        /// P4, as the CUCS numbers it.
        to: u16,
        /// Why.
        fault: CurveError,
    },
    /// A curved leg to another waypoint than the next.
    #[error("its curved leg leads to {to}, its Next Waypoint is {next}")]
    CurveEnd {
        /// P4.
        to: u16,
        /// The waypoint that follows.
        next: u16,
    },
    /// A curved leg names it, and no 13002 has described it.
    #[error("not received, and a curved leg joins it to {0}")]
    CurveWithoutEnd(u16),
    /// Two curved legs from one waypoint.
    #[error("two curved legs start at it, to {0} and to {1}")]
    TwoCurves(u16, u16),
    /// More items than the vehicle takes.
    #[error("the route needs more than {0} items")]
    TooManyItems(usize),
}

/// Makes the mission of the route that starts at `initial`. Where its curves become too many items, they are flown
/// within the smallest tolerance that the items allow, and the notes say so.
///
/// # Errors
/// The first waypoint, in flying order, that cannot be flown, and why. Nothing is half done.
pub fn flight(plan: &Plan, initial: u16, site: &Site) -> Result<Flight, RouteError> {
    let mut flight = match flight_within(plan, initial, site) {
        Err(RouteError {
            waypoint,
            reason: Reason::TooManyItems(items),
        }) => budget::flight(plan, initial, site)?.ok_or(RouteError {
            waypoint,
            reason: Reason::TooManyItems(items),
        })?,
        other => other?,
    };
    if let Some(curved) = flight.curved {
        let note = curved.note(site.curving.tolerance_m, site.limits.items);
        flight.notes.push(note);
    }
    Ok(flight)
}

/// The mission, its curves within the tolerance of the site.
pub(crate) fn flight_within(plan: &Plan, initial: u16, site: &Site) -> Result<Flight, RouteError> {
    let mut flight = Flight {
        items: Vec::new(),
        waypoint_of: Vec::new(),
        order: Vec::new(),
        curved: None,
        notes: Vec::new(),
    };
    let mut before: Option<(f64, f64)> = None;
    // The items at the ends of curves.
    let mut ends: Vec<usize> = Vec::new();
    // Waypoints that end no curve.
    let mut straight = Vec::new();
    let mut number = initial;
    if let Some((missing, to)) = plan.curve_without_end() {
        return Err(RouteError {
            waypoint: missing,
            reason: Reason::CurveWithoutEnd(to),
        });
    }
    while number != 0 {
        let at = |reason| RouteError {
            waypoint: number,
            reason,
        };
        let waypoint = plan.waypoint(number).ok_or_else(|| at(Reason::Unknown))?;
        if flight.order.iter().any(|leg| leg.number == number) {
            return Err(at(Reason::Loop));
        }
        let leg = leg(number, waypoint, site).map_err(at)?;
        distance(&leg, before, site).map_err(at)?;
        check_curves(plan, number, waypoint).map_err(at)?;
        let here_before = flight.items.len();
        if let Some(speed_m_s) = leg.speed_m_s {
            flight.push(number, change_speed(speed_m_s));
        }
        let curved = match flight.order.last().copied() {
            Some(p1) => fly_curve(plan, &p1, &leg, &mut flight, site)?,
            None => None,
        };
        if site.hovers
            && plan
                .loiter(number)
                .is_some_and(|loiter| loiter.waypoint_loiter_type == Some(LoiterType::Circular))
        {
            flight.notes.push(format!(
                "waypoint {number}: a multicopter flies no circle in a route, it hovers there (13003)"
            ));
        }
        for mut item in position_items(&leg, waypoint, plan.loiter(number), site).map_err(at)? {
            if let Some(chords) = &curved {
                accept(&mut item, chords);
                ends.push(flight.items.len());
            } else {
                straight.push(flight.items.len());
            }
            flight.push(number, item);
        }
        if let Some(chords) = &curved {
            // P1 is a vertex of the curve too.
            let before = flight.items.iter_mut().take(here_before).enumerate();
            if let Some((p1, item)) = before.filter(|(_, item)| item.is_global()).last() {
                accept(item, chords);
                ends.push(p1);
            }
            if chords.slowed {
                let wished_m_s = leg.speed_m_s.unwrap_or_else(|| flight.speed_m_s());
                flight.push(number, change_speed(wished_m_s));
            }
        }
        let here = (leg.latitude, leg.longitude);
        flight.order.push(leg);
        let next = waypoint.next_waypoint.unwrap_or(0);
        let ends_loop = loops::ends(waypoint).map_err(at)?;
        if ends_loop {
            if let Some(jump) = loops::jump(number, waypoint, &flight).map_err(at)? {
                flight.push(number, jump);
            }
            if let Some(start) = flight.order.iter().find(|leg| leg.number == next) {
                distance(start, Some(here), site).map_err(at)?;
            }
        }
        if flight.items.len() > site.limits.items {
            return Err(at(Reason::TooManyItems(site.limits.items)));
        }
        before = Some(here);
        number = if ends_loop { 0 } else { next };
    }
    if site.hovers {
        straight.retain(|at| !ends.contains(at));
        flight.brake(&straight);
        for end in ends {
            widen(&mut flight.items, end);
        }
    }
    match flight.items.first_mut() {
        Some(first) => first.current = true,
        None => {
            return Err(RouteError {
                waypoint: initial,
                reason: Reason::Unknown,
            });
        }
    }
    Ok(flight)
}

/// The curves that start at a waypoint: at most one, and to its Next Waypoint.
fn check_curves(plan: &Plan, number: u16, waypoint: &UaPositionWaypoint) -> Result<(), Reason> {
    let mut curves = plan.curves_from(number).map(|(p4, _)| p4);
    let Some(to) = curves.next() else {
        return Ok(());
    };
    if let Some(other) = curves.next() {
        return Err(Reason::TwoCurves(to, other));
    }
    let next = waypoint.next_waypoint.unwrap_or(0);
    if next == to {
        Ok(())
    } else {
        Err(Reason::CurveEnd { to, next })
    }
}

/// Pushes the chords of the curved leg from `p1` to `p4`, where there is one.
fn fly_curve(
    plan: &Plan,
    p1: &Leg,
    p4: &Leg,
    flight: &mut Flight,
    site: &Site,
) -> Result<Option<Chords>, RouteError> {
    let Some((_, curve)) = plan.curves_from(p1.number).find(|(to, _)| *to == p4.number) else {
        return Ok(None);
    };
    let speed_m_s = p4.speed_m_s.unwrap_or_else(|| flight.speed_m_s());
    let chords = curve::chords(p1, p4, curve, speed_m_s, site).map_err(|fault| RouteError {
        waypoint: p1.number,
        reason: Reason::Curve {
            to: p4.number,
            fault,
        },
    })?;
    for chord in &chords.vertices {
        height(chord.level, site).map_err(|reason| RouteError {
            waypoint: p1.number,
            reason,
        })?;
    }
    let tolerance_m = site.curving.tolerance_m;
    flight.curved = Some(Curved::and(flight.curved, &chords, tolerance_m));
    if chords.reads_differently {
        let text = format!(
            "curve {} to {} is flown as defined; drawn in latitude and longitude it is another line",
            p1.number, p4.number
        );
        flight.notes.push(text);
    }
    if let Some(speed_m_s) = chords.speed_at_start_m_s {
        flight.push(p4.number, change_speed(speed_m_s));
    }
    for chord in &chords.vertices {
        let (frame, z) = chord.level.frame();
        flight.push(
            p4.number,
            Item {
                frame,
                command: NAV_WAYPOINT,
                current: false,
                autocontinue: true,
                params: [0.0, chords.acceptance_m, 0.0, f32::NAN],
                x: degrees_e7(chord.latitude),
                y: degrees_e7(chord.longitude),
                z: z as f32,
            },
        );
        if let Some(speed_m_s) = chord.speed_m_s {
            flight.push(p4.number, change_speed(speed_m_s));
        }
    }
    Ok(Some(chords))
}

/// A vertex of a level curve is not passed by more than the curve's radius; one of a climbing curve not by less.
fn accept(item: &mut Item, chords: &Chords) {
    let acceptance_m = chords.acceptance_m;
    let closer = item.params[1] > 0.0 && item.params[1] < acceptance_m;
    if item.command == NAV_WAYPOINT && (chords.climbs || !closer) {
        item.params[1] = acceptance_m;
    }
}

/// The end of a curve before an item at another altitude: a multicopter swings about its altitude on the way to it, and
/// must stay within its radius for as long as that takes (`curve::SWING_S`).
fn widen(items: &mut [Item], end: usize) {
    let z = |item: &Item| (item.frame, item.z);
    let speed_m_s = items
        .iter()
        .take(end)
        .rev()
        .find(|item| item.command == DO_CHANGE_SPEED)
        .map_or(CRUISE_M_S as f32, |item| item.params[1]);
    let next = items.iter().skip(end + 1).find(|item| item.is_global());
    let differs = items
        .get(end)
        .zip(next)
        .is_some_and(|(item, next)| z(item) != z(next));
    if let Some(item) = items.get_mut(end)
        && item.command == NAV_WAYPOINT
        && differs
    {
        let wide_m = (0.5 * curve::SWING_S as f32 * speed_m_s).min(WIDEST_M);
        item.params[1] = item.params[1].max(wide_m);
    }
}

impl Flight {
    /// The speed commanded last, m/s; PX4's own cruise speed before any.
    fn speed_m_s(&self) -> f64 {
        self.order
            .iter()
            .rev()
            .find_map(|leg| leg.speed_m_s)
            .unwrap_or(CRUISE_M_S)
    }

    /// Ends the route by landing at its last waypoint: an approach.
    pub fn land_at_the_end(&mut self) {
        let Some(last) = self.order.last().copied() else {
            return;
        };
        let (frame, z) = Level::AboveHome(0.0).frame();
        let item = Item {
            frame,
            command: NAV_LAND,
            current: false,
            autocontinue: true,
            params: [0.0, 0.0, 0.0, f32::NAN],
            x: degrees_e7(last.latitude),
            y: degrees_e7(last.longitude),
            z: z as f32,
        };
        self.push(last.number, item);
    }

    fn push(&mut self, waypoint: u16, item: Item) {
        self.items.push(item);
        self.waypoint_of.push(waypoint);
    }
}

fn leg(number: u16, waypoint: &UaPositionWaypoint, site: &Site) -> Result<Leg, Reason> {
    match waypoint.location_type {
        None | Some(LocationType::Absolute) => {}
        Some(other) => return Err(Reason::Relative(other.raw())),
    }
    let latitude = waypoint
        .waypoint_to_latitude_or_relative_y
        .ok_or(Reason::Missing("Waypoint to Latitude"))?
        .degrees();
    let longitude = waypoint
        .waypoint_to_longitude_or_relative_x
        .ok_or(Reason::Missing("Waypoint to Longitude"))?
        .degrees();
    if !(-90.0..=90.0).contains(&latitude) {
        return Err(Reason::Latitude(latitude));
    }
    let altitude_m = waypoint
        .waypoint_to_altitude
        .ok_or(Reason::Missing("Waypoint to Altitude"))?
        .si();
    let level = altitude::level(
        altitude_m,
        waypoint.waypoint_altitude_type,
        site.geoid_m,
        site.agl,
        site.altimeter,
    )?;
    height(level, site)?;
    Ok(Leg {
        number,
        latitude,
        longitude,
        level,
        speed_m_s: speed(waypoint, &site.limits)?,
    })
}

/// Whether a level lies within the limits.
///
/// # Errors
/// Too low, too high, or in the ground.
pub fn height(level: Level, site: &Site) -> Result<(), Reason> {
    if let Level::AboveHome(m) = level
        && m <= 0.0
    {
        return Err(Reason::InTheGround(m));
    }
    let Limits {
        lowest_m,
        highest_m,
        ..
    } = site.limits;
    let height_m = level.amsl(site.home.amsl_m) - site.home.amsl_m;
    if (lowest_m..=highest_m).contains(&height_m) {
        return Ok(());
    }
    Err(Reason::Height {
        height_m,
        lowest_m,
        highest_m,
    })
}

/// Metres over ground between two places given in degrees, on the sphere: for limits, not for geometry.
#[must_use]
pub fn metres(from: (f64, f64), to: (f64, f64)) -> f64 {
    Haversine.distance(Point::new(from.1, from.0), Point::new(to.1, to.0))
}

fn distance(leg: &Leg, before: Option<(f64, f64)>, site: &Site) -> Result<(), Reason> {
    let here = (leg.latitude, leg.longitude);
    match before {
        None => {
            let (distance_m, most_m) = (
                metres((site.home.latitude, site.home.longitude), here),
                site.limits.first_m,
            );
            if distance_m > most_m {
                Err(Reason::FarFromHome { distance_m, most_m })
            } else {
                Ok(())
            }
        }
        Some(before) => {
            let (distance_m, most_m) = (metres(before, here), site.limits.leg_m);
            if distance_m > most_m {
                Err(Reason::LongLeg { distance_m, most_m })
            } else {
                Ok(())
            }
        }
    }
}

fn speed(waypoint: &UaPositionWaypoint, limits: &Limits) -> Result<Option<f64>, Reason> {
    match waypoint.waypoint_speed_type {
        Some(WaypointSpeedType::ArrivalTime) => return Err(Reason::ArrivalTime),
        Some(WaypointSpeedType::Unknown(value)) if waypoint.waypoint_to_speed.is_some() => {
            return Err(Reason::UnknownValue {
                field: "Waypoint Speed Type",
                value,
            });
        }
        _ => {}
    }
    let Some(speed_m_s) = waypoint.waypoint_to_speed.map(|speed| speed.si()) else {
        return Ok(None);
    };
    if speed_m_s > 0.0 && speed_m_s <= limits.speed_m_s {
        return Ok(Some(speed_m_s));
    }
    Err(Reason::Speed {
        speed_m_s,
        most_m_s: limits.speed_m_s,
    })
}

/// PX4 applies a speed to the present leg only when it is called a ground speed.
fn change_speed(speed_m_s: f64) -> Item {
    Item {
        frame: FRAME_MISSION,
        command: DO_CHANGE_SPEED,
        autocontinue: true,
        params: [SPEED_TYPE_GROUND, speed_m_s as f32, THROTTLE_UNCHANGED, 0.0],
        ..Item::default()
    }
}

fn position_items(
    leg: &Leg,
    waypoint: &UaPositionWaypoint,
    asked: Option<&UaLoiterWaypoint>,
    site: &Site,
) -> Result<Vec<Item>, Reason> {
    let there = |command, params| placed(leg, command, params);
    let fly_to = there(NAV_WAYPOINT, [0.0, acceptance(waypoint)?, 0.0, f32::NAN]);
    let Some(asked) = asked else {
        return Ok(vec![fly_to]);
    };
    let loiter = loiter::loiter(asked, leg.speed_m_s, site.hovers, &site.limits)?;
    let stay = there(loiter.command, loiter.params);
    match loiter
        .speed_m_s
        .filter(|speed| Some(*speed) != leg.speed_m_s)
    {
        None => Ok(vec![stay]),
        // The loiter's speed is not the speed of the leg to it, nor of the next one.
        Some(speed_m_s) => {
            let back = leg.speed_m_s.map(change_speed);
            Ok([fly_to, change_speed(speed_m_s), stay]
                .into_iter()
                .chain(back)
                .collect())
        }
    }
}

fn placed(leg: &Leg, command: u16, params: [f32; 4]) -> Item {
    let (frame, z) = leg.level.frame();
    Item {
        frame,
        command,
        current: false,
        autocontinue: true,
        params,
        x: degrees_e7(leg.latitude),
        y: degrees_e7(leg.longitude),
        z: z as f32,
    }
}

fn acceptance(waypoint: &UaPositionWaypoint) -> Result<f32, Reason> {
    match waypoint.turn_type {
        None | Some(TurnType::ShortTurn) => Ok(0.0),
        Some(TurnType::FlyOver) => Ok(FLY_OVER_M),
        Some(TurnType::Unknown(value)) => Err(Reason::UnknownValue {
            field: "Turn Type",
            value,
        }),
    }
}

/// MISSION_ITEM_INT's unit of latitude and longitude.
fn degrees_e7(degrees: f64) -> i32 {
    (degrees * 1e7).round() as i32
}

/// MPC_XY_CRUISE, m/s: what PX4 flies before any speed is commanded.
pub(crate) const CRUISE_M_S: f64 = 5.0;
const NAV_LAND: u16 = 21;
/// Most that the end of a curve is widened to, m.
const WIDEST_M: f32 = 20.0;
pub(crate) const NAV_WAYPOINT: u16 = 16;
pub(crate) const DO_CHANGE_SPEED: u16 = 178;
/// Frame 2: an item without a place.
pub(crate) const FRAME_MISSION: u8 = 2;
const SPEED_TYPE_GROUND: f32 = 1.0;
const THROTTLE_UNCHANGED: f32 = -1.0;
/// Acceptance radius of a fly-over, m: under 2 m a multicopter at 5 m/s can miss the waypoint and fly on for good.
const FLY_OVER_M: f32 = 3.0;
