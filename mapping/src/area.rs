//! Areas to stay inside or outside, as they come (50016, or the configuration), and as PX4's geofence.
//!
//! | area | PX4 |
//! |---|---|
//! | polygon to stay inside, outside | NAV_FENCE_POLYGON_VERTEX_INCLUSION, _EXCLUSION, one item a corner |
//! | circle to stay inside, outside | NAV_FENCE_CIRCLE_INCLUSION, _EXCLUSION |
//!
//! PX4 holds 64 corners in all. It allows only where all areas to stay inside overlap (geofence.cpp, since v1.15): a further one
//! makes the space smaller. As it reads its fence it leaves out an area that home breaches, and one that the vehicle breaches in the
//! air, and it reads a polygon after a circle wrongly: circles come last.

use std::collections::BTreeMap;

use geo::{Contains, Coord, Intersects, Line, LineString, Point, Polygon, Validation};
use mavlink_link::service::mission::{FRAME_GLOBAL, Item};
use stanag_msgs::Message;
use stanag_msgs::enums::AreaType;
use stanag_msgs::messages::AreaVertex;

use crate::limits::{disc, metres};
use crate::route::{DO_JUMP, degrees_e7};

/// What PX4 holds of a geofence: corners and circles together.
pub const MAX_VERTICES: usize = 64;

/// One area, whole.
#[derive(Debug, Clone, PartialEq)]
pub struct Area {
    /// Whether the vehicle stays inside, else outside.
    pub keep_in: bool,
    /// Its outline.
    pub shape: Shape,
}

/// The outline of an area, degrees north and east.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// The corners in turn, 3 and more.
    Polygon(Vec<(f64, f64)>),
    /// A circle.
    Circle {
        /// Its centre.
        centre: (f64, f64),
        /// Metres, above 0.
        radius_m: f64,
    },
}

impl Area {
    /// Whether a place, degrees north and east, lies within the outline.
    #[must_use]
    pub fn contains(&self, at: (f64, f64)) -> bool {
        self.bound().contains(at)
    }

    fn bound(&self) -> Bound {
        let inside = match &self.shape {
            Shape::Polygon(corners) => Inside::Polygon(outline(corners)),
            Shape::Circle { centre, radius_m } => Inside::Circle {
                centre: *centre,
                radius_m: *radius_m,
            },
        };
        Bound {
            keep_in: self.keep_in,
            inside,
        }
    }
}

/// An area to test places against: its polygon is built once for all of them.
struct Bound {
    keep_in: bool,
    inside: Inside,
}

enum Inside {
    Polygon(Polygon),
    Circle { centre: (f64, f64), radius_m: f64 },
}

impl Bound {
    fn contains(&self, at: (f64, f64)) -> bool {
        match &self.inside {
            Inside::Polygon(outline) => outline.contains(&Point::new(at.1, at.0)),
            Inside::Circle { centre, radius_m } => metres(*centre, at) <= *radius_m,
        }
    }

    /// Whether a straight way lies on the wrong side of it, or a part of the way does.
    fn is_crossed(&self, from: (f64, f64), to: (f64, f64)) -> bool {
        let ends = [from, to];
        if ends.iter().any(|at| self.contains(*at) != self.keep_in) {
            return true;
        }
        match &self.inside {
            Inside::Polygon(outline) => {
                let crosses = |way: &Line| {
                    let mut sides = outline.exterior().lines();
                    sides.any(|side| side.intersects(way))
                };
                plain(from, to).iter().any(crosses)
            }
            // No straight way between two places inside of a circle leaves it.
            Inside::Circle { .. } if self.keep_in => false,
            Inside::Circle { centre, .. } => self.contains(nearest(*centre, from, to)),
        }
    }
}

/// Degrees of longitude eastward from one to another, the shorter way around.
fn eastward(from: f64, to: f64) -> f64 {
    (to - from + 540.0).rem_euclid(360.0) - 180.0
}

/// The way between two places in plain longitudes, as polygons have them: one across 180 degrees once on either side.
fn plain(from: (f64, f64), to: (f64, f64)) -> [Line; 2] {
    let east = eastward(from.1, to.1);
    let way = |first: f64, last: f64| {
        let ends = [(from.0, first), (to.0, last)];
        let [start, end] = ends.map(|(y, x)| Coord { x, y });
        Line::new(start, end)
    };
    [way(from.1, from.1 + east), way(to.1 - east, to.1)]
}

/// The place of a straight way that is nearest to a place, on a plane that touches the globe there.
fn nearest(to: (f64, f64), start: (f64, f64), end: (f64, f64)) -> (f64, f64) {
    let shrinks = to.0.to_radians().cos();
    let east = eastward(start.1, end.1);
    let way = (end.0 - start.0, shrinks * east);
    let here = (start.0 - to.0, shrinks * eastward(to.1, start.1));
    let length2 = way.0 * way.0 + way.1 * way.1;
    let part = if length2 > 0.0 {
        (-(here.0 * way.0 + here.1 * way.1) / length2).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (start.0 + part * way.0, start.1 + part * east)
}

/// How a way crosses an area.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Crossing {
    /// Area ID; 0 is one of the configuration.
    pub area: u16,
    /// Whether the vehicle stays inside, else outside.
    pub keep_in: bool,
}

impl std::fmt::Display for Crossing {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (verb, side) = match self.keep_in {
            true => ("leaves", "inside"),
            false => ("enters", "outside of"),
        };
        match self.area {
            0 => write!(out, "{verb} an area of the configuration to stay {side}"),
            area => write!(out, "{verb} area {area}, to stay {side}"),
        }
    }
}

/// The first area that a circle around a place crosses. What is within the circle is not flown over: a vehicle may circle around an
/// area to stay outside.
#[must_use]
pub fn circle_crossing(
    areas: &[(u16, Area)],
    centre: (f64, f64),
    radius_m: f64,
) -> Option<Crossing> {
    let bounds = numbered(areas);
    // Chords: they leave out 0.4 % of the radius.
    let rim = disc(centre, radius_m).split_off(1);
    let next = rim.iter().cycle().skip(1);
    let mut chords = rim.iter().zip(next);
    chords.find_map(|(from, to)| crossed(&bounds, *from, *to))
}

fn numbered(areas: &[(u16, Area)]) -> Vec<(u16, Bound)> {
    let bound = |(id, area): &(u16, Area)| (*id, area.bound());
    areas.iter().map(bound).collect()
}

fn crossed(bounds: &[(u16, Bound)], from: (f64, f64), to: (f64, f64)) -> Option<Crossing> {
    let crossed = |(_, bound): &&(u16, Bound)| bound.is_crossed(from, to);
    bounds.iter().find(crossed).map(|(id, bound)| Crossing {
        area: *id,
        keep_in: bound.keep_in,
    })
}

/// Whether a place, degrees north and east, is outside of an area to stay inside, or inside of one to stay outside.
#[must_use]
pub fn is_breached(areas: &[Area], at: (f64, f64)) -> bool {
    breaches(&bounds(areas), at)
}

/// The first of a mission's items with a place that breaches the areas, as an index: PX4 flies no such mission.
#[must_use]
pub fn first_breach(areas: &[Area], items: &[Item]) -> Option<usize> {
    let bounds = bounds(areas);
    items
        .iter()
        .position(|item| item.is_flown_to() && breaches(&bounds, place(item)))
}

/// The first straight leg of a mission that crosses an area, by the items at its ends, as indices, and the area. PX4 compares only
/// the places of the items, and flies such a mission until it breaches the area.
#[must_use]
pub fn first_leg_across(
    areas: &[(u16, Area)],
    items: &[Item],
) -> Option<((usize, usize), Crossing)> {
    let bounds = numbered(areas);
    let place_from = |first: usize| {
        let mut places = items.iter().enumerate().skip(first);
        places.find(|(_, item)| item.is_flown_to())
    };
    let mut before = None;
    for (at, item) in items.iter().enumerate() {
        let to = match item.command {
            DO_JUMP => place_from(item.params[0] as usize),
            _ if item.is_flown_to() => Some((at, item)),
            _ => continue,
        };
        if let Some(((from, start), (to, end))) = before.zip(to)
            && let Some(crossing) = crossed(&bounds, place(start), place(end))
        {
            return Some(((from, to), crossing));
        }
        // Behind the last round of a loop the mission continues from where it jumps.
        if item.command != DO_JUMP {
            before = to;
        }
    }
    None
}

/// The place of an item, degrees north and east.
fn place(item: &Item) -> (f64, f64) {
    (f64::from(item.x) / 1e7, f64::from(item.y) / 1e7)
}

fn bounds(areas: &[Area]) -> Vec<Bound> {
    areas.iter().map(Area::bound).collect()
}

fn breaches(bounds: &[Bound], at: (f64, f64)) -> bool {
    bounds
        .iter()
        .any(|bound| bound.contains(at) != bound.keep_in)
}

fn outline(corners: &[(f64, f64)]) -> Polygon {
    let ring = corners.iter().map(|(north, east)| (*east, *north));
    Polygon::new(ring.collect::<LineString>(), Vec::new())
}

/// The first corner from which a side leads over more than half the globe, and how far, degrees of longitude: the area that was
/// meant crosses 180 degrees. PX4 compares plain longitudes (geofence.cpp, `insidePolygon`), and so does [`Area::contains`]: inside
/// and outside would be exchanged.
fn across_180(corners: &[(f64, f64)]) -> Option<(usize, f64)> {
    let next = corners.iter().cycle().skip(1);
    let sides = corners.iter().zip(next);
    let spans_deg = sides.map(|((_, from), (_, to))| (to - from).abs());
    spans_deg
        .enumerate()
        .find(|(_, span_deg)| *span_deg > 180.0)
}

/// The areas that a CUCS has sent, as it sent them, by Area ID and Vertex Number.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Areas(BTreeMap<u16, BTreeMap<u8, AreaVertex>>);

impl Areas {
    /// Stores one corner; a later one of the same numbers replaces it.
    ///
    /// # Errors
    /// By itself it is none: the areas are as before.
    pub fn store(&mut self, vertex: &AreaVertex) -> Result<(), AreaError> {
        let id = vertex.area_id.unwrap_or(0);
        let number = vertex.vertex_number;
        let fault = |reason| AreaError {
            area: id,
            configured: None,
            vertex: number,
            reason,
        };
        checked(vertex).map_err(fault)?;
        let total: usize = self.0.values().map(BTreeMap::len).sum();
        let area = self.0.get(&id);
        let known = area
            .zip(number)
            .is_some_and(|(area, number)| area.contains_key(&number));
        // A bound on memory: what no vehicle holds need not be stored.
        if total >= MAX_VERTICES && !known {
            return Err(fault(Reason::TooMany(total + 1)));
        }
        let area = self.0.entry(id).or_default();
        let what = |vertex: &AreaVertex| (vertex.area_type, vertex.vertex_count);
        // Corners of what the area was before are none of what it is now.
        area.retain(|_, known| what(known) == what(vertex));
        area.insert(number.unwrap_or(1), vertex.clone());
        Ok(())
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// As messages, by area and vertex.
    pub fn messages(&self) -> impl Iterator<Item = Message> + '_ {
        let vertices = self.0.values().flat_map(BTreeMap::values);
        vertices.cloned().map(Message::AreaVertex)
    }

    /// The fence that they make with areas of the configuration: these alone where one that was sent is not whole.
    #[must_use]
    pub fn with(&self, configured: &[Area]) -> Vec<Area> {
        let all = self.numbered_with(configured).into_iter();
        all.map(|(_, area)| area).collect()
    }

    /// The same with the Area ID of each; 0 is one of the configuration.
    #[must_use]
    pub fn numbered_with(&self, configured: &[Area]) -> Vec<(u16, Area)> {
        let sent = self.whole().unwrap_or_default();
        let configured = configured.iter().cloned().map(|area| (0, area));
        configured.chain(sent).collect()
    }

    /// The areas, whole.
    ///
    /// # Errors
    /// The first that is not whole.
    pub fn whole(&self) -> Result<Vec<(u16, Area)>, AreaError> {
        self.0
            .iter()
            .map(|(id, vertices)| Ok((*id, whole(*id, vertices)?)))
            .collect()
    }
}

/// What can be checked of one corner by itself.
fn checked(vertex: &AreaVertex) -> Result<(), Reason> {
    if vertex.area_id.is_none_or(|id| id == 0) {
        return Err(Reason::Missing("Area ID above 0"));
    }
    let kind = vertex.area_type.ok_or(Reason::Missing("Area Type"))?;
    let count = vertex.vertex_count.ok_or(Reason::Missing("Vertex Count"))?;
    let number = vertex
        .vertex_number
        .ok_or(Reason::Missing("Vertex Number"))?;
    let latitude = vertex.latitude.ok_or(Reason::Missing("Latitude"))?;
    let latitude = latitude.degrees();
    vertex.longitude.ok_or(Reason::Missing("Longitude"))?;
    if !(-90.0..=90.0).contains(&latitude) {
        return Err(Reason::Latitude(latitude));
    }
    match kind {
        AreaType::KeepInPolygon | AreaType::KeepOutPolygon => {
            if count < 3 || usize::from(count) > MAX_VERTICES {
                return Err(Reason::Count(count, "3 to 64"));
            }
        }
        AreaType::KeepInCircle | AreaType::KeepOutCircle => {
            if count != 1 {
                return Err(Reason::Count(count, "1 of a circle"));
            }
            radius(vertex.radius)?;
        }
        AreaType::Unknown(value) => return Err(Reason::Type(value)),
    }
    if !(1..=count).contains(&number) {
        return Err(Reason::Number(number, count));
    }
    Ok(())
}

fn radius(radius: Option<f32>) -> Result<f64, Reason> {
    let radius_m = f64::from(radius.ok_or(Reason::Missing("Radius"))?);
    if radius_m > 0.0 && radius_m <= WIDEST_M {
        Ok(radius_m)
    } else {
        Err(Reason::Radius(radius_m))
    }
}

fn whole(area: u16, vertices: &BTreeMap<u8, AreaVertex>) -> Result<Area, AreaError> {
    let fault = |vertex, reason| AreaError {
        area,
        configured: None,
        vertex: Some(vertex),
        reason,
    };
    let any = vertices.values().next();
    let count = any.and_then(|vertex| vertex.vertex_count).unwrap_or(1);
    let kind = any.and_then(|vertex| vertex.area_type);
    let mut corners = Vec::with_capacity(usize::from(count));
    for number in 1..=count {
        let vertex = vertices
            .get(&number)
            .ok_or(fault(number, Reason::NotReceived))?;
        let (Some(latitude), Some(longitude)) = (vertex.latitude, vertex.longitude) else {
            return Err(fault(number, Reason::Missing("Latitude or Longitude")));
        };
        corners.push((latitude.degrees(), longitude.degrees()));
    }
    let keep_in = matches!(kind, Some(AreaType::KeepInPolygon | AreaType::KeepInCircle));
    let shape = match (kind, corners.first()) {
        (Some(AreaType::KeepInCircle | AreaType::KeepOutCircle), Some(centre)) => Shape::Circle {
            centre: *centre,
            radius_m: radius(any.and_then(|vertex| vertex.radius))
                .map_err(|reason| fault(1, reason))?,
        },
        _ => Shape::Polygon(corners),
    };
    Ok(Area { keep_in, shape })
}

/// Beyond it a radius is a mistake, m.
const WIDEST_M: f64 = 100_000.0;

/// A corner or circle of a fence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FencePoint {
    /// Area ID; 0 is one of the configuration.
    pub area: u16,
    /// Vertex Number.
    pub vertex: u8,
    /// As PX4 takes it.
    pub item: Item,
}

/// The vehicle that is to hold a fence, as far as it is known.
#[derive(Debug, Clone, Copy, Default)]
pub struct Holder {
    /// Its position, degrees north and east.
    pub position: Option<(f64, f64)>,
    /// Its home.
    pub home: Option<(f64, f64)>,
    /// Whether it is one that allows every area to stay inside, as PX4 before v1.15: there a further one makes the space larger.
    pub unites: bool,
}

/// The fence of the configured areas and those of a CUCS, checked: what is sent to PX4.
///
/// # Errors
/// The first area that cannot be flown with, and its vertex.
pub fn fence(
    configured: &[Area],
    sent: &[(u16, Area)],
    holder: &Holder,
) -> Result<Vec<FencePoint>, AreaError> {
    let all = (1..).zip(configured);
    let all = all.map(|(number, area)| (0, Some(number), area));
    let all: Vec<(u16, Option<usize>, &Area)> = all
        .chain(sent.iter().map(|(id, area)| (*id, None, area)))
        .collect();
    let mut items: Vec<FencePoint> = Vec::new();
    for (id, number, area) in &all {
        let fault = |vertex, reason| AreaError {
            area: *id,
            configured: *number,
            vertex,
            reason,
        };
        if holder.unites && *id != 0 && area.keep_in && configured.iter().any(|area| area.keep_in) {
            return Err(fault(None, Reason::Widens));
        }
        if let Shape::Polygon(corners) = &area.shape {
            if let Some((at, span_deg)) = across_180(corners) {
                let vertex = u8::try_from(at + 1).ok();
                return Err(fault(vertex, Reason::Across180(span_deg)));
            }
            if !outline(corners).is_valid() {
                return Err(fault(None, Reason::Outline));
            }
        }
        for (who, place) in [("the vehicle", holder.position), ("home", holder.home)] {
            if place.is_some_and(|at| area.contains(at) != area.keep_in) {
                let side = if area.keep_in { "outside" } else { "inside" };
                return Err(fault(None, Reason::Breached(who, side)));
            }
        }
        let room = MAX_VERTICES - items.len();
        let new = area.items();
        if new.len() > room {
            let vertex = u8::try_from(room + 1).ok();
            return Err(fault(vertex, Reason::TooMany(items.len() + new.len())));
        }
        items.extend((1..).zip(new).map(|(vertex, item)| FencePoint {
            area: *id,
            vertex,
            item,
        }));
    }
    items.sort_by_key(|point| point.item.command >= CIRCLE_INCLUSION);
    Ok(items)
}

impl Area {
    fn items(&self) -> Vec<Item> {
        let item = |command: u16, first: f64, (latitude, longitude): (f64, f64)| Item {
            frame: FRAME_GLOBAL,
            command: if self.keep_in { command } else { command + 1 },
            current: false,
            autocontinue: false,
            params: [first as f32, 0.0, 0.0, 0.0],
            x: degrees_e7(latitude),
            y: degrees_e7(longitude),
            z: 0.0,
        };
        match &self.shape {
            Shape::Polygon(corners) => corners
                .iter()
                .map(|at| item(POLYGON_INCLUSION, corners.len() as f64, *at))
                .collect(),
            Shape::Circle { centre, radius_m } => {
                vec![item(CIRCLE_INCLUSION, *radius_m, *centre)]
            }
        }
    }
}

/// MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION; the exclusion is the next number.
const POLYGON_INCLUSION: u16 = 5001;
/// MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION; the exclusion is the next number.
const CIRCLE_INCLUSION: u16 = 5003;

/// Areas that make no fence, or a message that makes no area.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{}{reason}", place(.area, .configured, .vertex))]
pub struct AreaError {
    /// Area ID; 0 of one of the configuration, and where it is about none.
    pub area: u16,
    /// Which of the configuration it is, from 1.
    pub configured: Option<usize>,
    /// Vertex Number, where it is about one.
    pub vertex: Option<u8>,
    /// Why.
    pub reason: Reason,
}

/// What is wrong with an area.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Reason {
    /// A field that must be there is not.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// A type that there is not.
    #[error("Area Type {0}, expected 0 to 3")]
    Type(u8),
    /// A number of corners that the type does not have.
    #[error("Vertex Count {0}, expected {1}")]
    Count(u8, &'static str),
    /// A corner beyond the count.
    #[error("Vertex Number {0}, expected 1 to {1}")]
    Number(u8, u8),
    /// No place on earth.
    #[error("latitude {0:.4} deg, expected -90 to 90")]
    Latitude(f64),
    /// A circle without size.
    #[error("Radius {0} m, expected more than 0 and at most 100000")]
    Radius(f64),
    /// A corner that has not been received.
    #[error("it has not been received")]
    NotReceived,
    /// The same place twice in turn, or sides that cross.
    #[error("its sides cross, or it has no inside")]
    Outline,
    /// A side across 180 degrees of longitude.
    #[error(
        "its side to the next vertex spans {0:.1} deg of longitude, expected at most 180: PX4 keeps no polygon across 180 deg, use a \
         circle"
    )]
    Across180(f64),
    /// More than the vehicle holds.
    #[error("{0} vertices with the areas before it, the vehicle holds 64")]
    TooMany(usize),
    /// It would make the configured space larger.
    #[error(
        "areas to stay inside are set by the configuration of this VSM, and this vehicle allows every one of them, as PX4 before v1.15"
    )]
    Widens,
    /// The vehicle, or its home, is on the wrong side of it.
    #[error("{0} is currently {1} it: PX4 leaves such an area out")]
    Breached(&'static str, &'static str),
    /// Nothing at all to load.
    #[error("no area has been received (50016)")]
    None,
}

/// `area 7 vertex 3: `, as far as it is about one.
fn place(area: &u16, configured: &Option<usize>, vertex: &Option<u8>) -> String {
    let area = match (configured, area) {
        (Some(number), _) => Some(format!("area {number} of the configuration")),
        (None, 0) => None,
        (None, id) => Some(format!("area {id}")),
    };
    let vertex = vertex.map(|number| format!("vertex {number}"));
    let parts: Vec<String> = area.into_iter().chain(vertex).collect();
    if parts.is_empty() {
        return String::new();
    }
    format!("{}: ", parts.join(" "))
}

#[cfg(test)]
mod tests {
    use stanag_msgs::Bam32;

    use super::*;

    fn vertex(area: u16, kind: AreaType, count: u8, number: u8, at: (f64, f64)) -> AreaVertex {
        AreaVertex {
            area_id: Some(area),
            area_type: Some(kind),
            vertex_count: Some(count),
            vertex_number: Some(number),
            latitude: Some(Bam32::from_degrees(at.0)),
            longitude: Some(Bam32::from_degrees(at.1)),
            ..AreaVertex::default()
        }
    }

    const CORNERS: [(f64, f64); 4] = [(47.0, 8.0), (47.0, 8.1), (47.1, 8.1), (47.1, 8.0)];

    /// A vehicle at a place, and nothing else is known.
    fn at(position: (f64, f64)) -> Holder {
        Holder {
            position: Some(position),
            ..Holder::default()
        }
    }

    fn unknown() -> Holder {
        Holder::default()
    }

    fn square(kind: AreaType) -> Areas {
        let mut areas = Areas::default();
        // In any order.
        for number in [3, 1, 4, 2] {
            let at = CORNERS[usize::from(number) - 1];
            areas.store(&vertex(7, kind, 4, number, at)).unwrap();
        }
        areas
    }

    #[test]
    fn a_square_becomes_four_items_and_a_circle_one() {
        let mut areas = square(AreaType::KeepInPolygon);
        let circle = AreaVertex {
            radius: Some(250.0),
            ..vertex(8, AreaType::KeepOutCircle, 1, 1, (47.05, 8.05))
        };
        areas.store(&circle).unwrap();
        let items = fence(&[], &areas.whole().unwrap(), &at((47.01, 8.01))).unwrap();
        let reported: Vec<_> = items
            .iter()
            .map(|point| (point.item.command, point.item.params[0]))
            .collect();
        assert_eq!(
            reported,
            [
                (5001, 4.0),
                (5001, 4.0),
                (5001, 4.0),
                (5001, 4.0),
                (5004, 250.0)
            ]
        );
        assert!((i64::from(items[2].item.x) - 471_000_000).abs() <= 1);
    }

    #[test]
    fn the_first_place_of_a_mission_outside_of_its_areas_is_named() {
        let sent = square(AreaType::KeepInPolygon);
        let item = |frame, north, east| Item {
            frame,
            command: 16,
            x: crate::route::degrees_e7(north),
            y: crate::route::degrees_e7(east),
            ..Item::default()
        };
        let global = |north, east| item(6, north, east);
        // Of an item without a place, x and y are parameters.
        let mut items = vec![global(47.05, 8.05), item(2, 0.0, 0.0), global(47.05, 8.06)];
        let areas = sent.with(&[]);
        assert_eq!(first_breach(&areas, &items), None);
        items.push(global(47.2, 8.05));
        assert_eq!(first_breach(&areas, &items), Some(3));
        assert_eq!(first_breach(&[], &items), None);
        let keep_out = Area {
            keep_in: false,
            shape: Shape::Circle {
                centre: (47.05, 8.06),
                radius_m: 100.0,
            },
        };
        let areas = sent.with(std::slice::from_ref(&keep_out));
        assert_eq!(first_breach(&areas, &items), Some(2));
    }

    /// A circle about the middle of the square, which measures 11 km by 7.6 km.
    fn in_the_middle(keep_in: bool, radius_m: f64) -> Area {
        let centre = (47.05, 8.05);
        let shape = Shape::Circle { centre, radius_m };
        Area { keep_in, shape }
    }

    #[test]
    fn a_circle_is_flown_along_its_rim_alone() {
        let crosses = |areas: &[(u16, Area)], centre, radius_m| {
            circle_crossing(areas, centre, radius_m).map(|crossing| crossing.to_string())
        };
        let (middle, leaves) = ((47.05, 8.05), "leaves area 7, to stay inside");
        let stays_in = square(AreaType::KeepInPolygon).whole().unwrap();
        assert_eq!(crosses(&[], middle, 1_000.0), None);
        assert_eq!(crosses(&stays_in, middle, 3_000.0), None);
        // The sides are 3.8 km away in the east and west.
        assert_eq!(crosses(&stays_in, middle, 4_000.0).as_deref(), Some(leaves));
        assert_eq!(
            crosses(&stays_in, (47.2, 8.05), 10.0).as_deref(),
            Some(leaves)
        );
        let stays_out = [(0, in_the_middle(false, 500.0))];
        assert_eq!(
            crosses(&stays_out, middle, 600.0),
            None,
            "it lies within the rim"
        );
        let enters = "enters an area of the configuration to stay outside of";
        assert_eq!(crosses(&stays_out, middle, 400.0).as_deref(), Some(enters));
        assert_eq!(
            crosses(&stays_out, (47.06, 8.05), 700.0).as_deref(),
            Some(enters)
        );
        assert_eq!(crosses(&stays_out, (47.06, 8.05), 500.0), None);
        let round = [(9, in_the_middle(true, 500.0))];
        assert_eq!(crosses(&round, middle, 490.0), None);
        let leaves = "leaves area 9, to stay inside";
        assert_eq!(crosses(&round, middle, 510.0).as_deref(), Some(leaves));
        // A spike between two of the places on the rim, 174 m apart: its tip is 956 m away from the centre.
        let spike = Shape::Polygon(vec![
            (47.030075, 8.047741),
            (47.030075, 8.047141),
            (47.041435, 8.0489),
        ]);
        let keep_in = false;
        let spike = [(
            3,
            Area {
                keep_in,
                shape: spike,
            },
        )];
        assert!(crosses(&spike, middle, 1_000.0).is_some());
        assert_eq!(crosses(&spike, middle, 900.0), None);
    }

    #[test]
    fn the_first_leg_across_an_area_is_named_though_its_ends_are_within() {
        let item = |(north, east): (f64, f64)| Item {
            frame: 6,
            command: 16,
            x: degrees_e7(north),
            y: degrees_e7(east),
            ..Item::default()
        };
        let across = |areas: &[(u16, Area)], places: &[(f64, f64)]| {
            let items: Vec<Item> = places.iter().copied().map(item).collect();
            first_leg_across(areas, &items).map(|(ends, crossing)| (ends, crossing.area))
        };
        let stays_out = square(AreaType::KeepOutPolygon).whole().unwrap();
        let (west, east) = ((47.05, 7.9), (47.05, 8.2));
        let (north_west, north_east) = ((47.2, 7.9), (47.2, 8.2));
        let around = [west, north_west, north_east, east];
        assert_eq!(across(&stays_out, &around), None);
        assert_eq!(across(&[], &[west, east]), None);
        let straight = [north_west, west, east];
        assert_eq!(across(&stays_out, &straight), Some(((1, 2), 7)));
        // Beside a circle by 111 m, and across it; 360 m of the leg are within.
        let round = [(0, in_the_middle(false, 500.0))];
        let beside = |north| [(north, 7.9), (north, 8.2)];
        assert_eq!(across(&round, &beside(47.0555)), None);
        assert_eq!(across(&round, &beside(47.0542)), Some(((0, 1), 0)));
        assert_eq!(
            across(&round, &[(47.05, 7.9), (47.05, 8.0)]),
            None,
            "short of it"
        );
        // An L to stay inside: the straight way between its ends leaves it, as by no circle.
        let corners = [
            (47.0, 8.0),
            (47.0, 8.1),
            (47.02, 8.1),
            (47.02, 8.02),
            (47.1, 8.02),
            (47.1, 8.0),
        ];
        let shape = Shape::Polygon(corners.to_vec());
        let keep_in = true;
        let bent = [(9, Area { keep_in, shape })];
        let (far_east, corner, far_north) = ((47.01, 8.09), (47.01, 8.01), (47.09, 8.01));
        assert_eq!(across(&bent, &[far_east, corner, far_north]), None);
        assert_eq!(across(&bent, &[far_east, far_north]), Some(((0, 1), 9)));
        let round = [(8, in_the_middle(true, 5_000.0))];
        assert_eq!(across(&round, &[(47.01, 8.05), (47.09, 8.05)]), None);
        // What is between two places without being one is passed over, and a loop leads back.
        let jump = Item {
            frame: 2,
            command: DO_JUMP,
            params: [0.0, 3.0, 0.0, 0.0],
            ..Item::default()
        };
        let looped = [item(far_east), item(corner), item(far_north), jump];
        let found = first_leg_across(&bent, &looped).map(|(ends, _)| ends);
        assert_eq!(found, Some((2, 0)));
        let looped = [item(far_east), jump, item(corner), item(far_north)];
        assert_eq!(first_leg_across(&bent, &looped), None);
    }

    #[test]
    fn a_leg_across_180_degrees_is_compared_on_either_side() {
        let leg = |north, from, to| {
            [from, to].map(|east| Item {
                frame: 6,
                command: 16,
                x: degrees_e7(north),
                y: degrees_e7(east),
                ..Item::default()
            })
        };
        let polygon = |east: f64| Area {
            keep_in: false,
            shape: Shape::Polygon(vec![
                (-16.8, east - 0.01),
                (-16.8, east + 0.01),
                (-16.6, east + 0.01),
                (-16.6, east - 0.01),
            ]),
        };
        let circle = Area {
            keep_in: false,
            shape: Shape::Circle {
                centre: (-16.7, 179.9995),
                radius_m: 500.0,
            },
        };
        for area in [polygon(179.95), polygon(-179.95), circle] {
            let areas = [(1, area)];
            let across = |items: [Item; 2]| first_leg_across(&areas, &items).is_some();
            assert!(across(leg(-16.7, 179.9, -179.9)), "{areas:?}");
            assert!(across(leg(-16.7, -179.9, 179.9)), "{areas:?}");
            assert!(!across(leg(-16.5, 179.9, -179.9)), "{areas:?}");
        }
        // The other way around the globe it would be crossed.
        let areas = [(1, polygon(8.0))];
        assert_eq!(first_leg_across(&areas, &leg(-16.7, 179.9, -179.9)), None);
    }

    #[test]
    fn what_is_not_whole_is_refused_with_its_vertex() {
        let mut areas = Areas::default();
        for number in [1, 2, 4] {
            let at = CORNERS[usize::from(number) - 1];
            areas
                .store(&vertex(7, AreaType::KeepInPolygon, 4, number, at))
                .unwrap();
        }
        let fault = areas.whole().unwrap_err();
        assert_eq!(
            (fault.area, fault.vertex, fault.reason),
            (7, Some(3), Reason::NotReceived)
        );
        assert_eq!(
            fault.to_string(),
            "area 7 vertex 3: it has not been received"
        );
        let unnumbered = vertex(0, AreaType::KeepInPolygon, 4, 2, CORNERS[1]);
        let fault = areas.store(&unnumbered).unwrap_err().to_string();
        assert_eq!(fault, "vertex 2: Area ID above 0 is missing");
        // Another definition takes the place of the first.
        for number in [3, 1, 2] {
            let at = CORNERS[usize::from(number) - 1];
            let triangle = vertex(7, AreaType::KeepInPolygon, 3, number, at);
            areas.store(&triangle).unwrap();
        }
        assert_eq!(
            fence(&[], &areas.whole().unwrap(), &unknown())
                .unwrap()
                .len(),
            3
        );
    }

    #[test]
    fn a_fence_that_the_vehicle_breaks_already_is_refused() {
        let stays_in = square(AreaType::KeepInPolygon).whole().unwrap();
        let stays_out = square(AreaType::KeepOutPolygon).whole().unwrap();
        let (inside, outside) = (at((47.05, 8.05)), at((47.2, 8.05)));
        let breached = |who, side| Err(Reason::Breached(who, side));
        let of = |areas: &[(u16, Area)], holder: Holder| {
            let made = fence(&[], areas, &holder);
            made.map(|_| ()).map_err(|fault| fault.reason)
        };
        assert_eq!(of(&stays_in, inside), Ok(()));
        assert_eq!(of(&stays_in, outside), breached("the vehicle", "outside"));
        assert_eq!(of(&stays_out, inside), breached("the vehicle", "inside"));
        assert_eq!(of(&stays_out, outside), Ok(()));
        let configured: Vec<Area> = stays_in.iter().map(|(_, area)| area.clone()).collect();
        let fault = fence(&configured, &[], &outside).unwrap_err().to_string();
        let expected = "area 1 of the configuration: the vehicle is currently outside it";
        assert!(fault.starts_with(expected), "{fault}");
        // PX4 leaves out what home breaches, and bounds the vehicle by the rest.
        let home = |holder: Holder, home: Holder| Holder {
            home: home.position,
            ..holder
        };
        assert_eq!(
            of(&stays_in, home(inside, outside)),
            breached("home", "outside")
        );
        assert_eq!(
            of(&stays_out, home(outside, inside)),
            breached("home", "inside")
        );
        // And it allows only where both overlap.
        let beyond = Area {
            keep_in: true,
            shape: Shape::Circle {
                centre: (47.2, 8.05),
                radius_m: 1000.0,
            },
        };
        let two = [stays_in, vec![(8, beyond)]].concat();
        assert_eq!(of(&two, unknown()), Ok(()));
        for holder in [inside, outside] {
            assert_eq!(of(&two, holder), breached("the vehicle", "outside"));
        }
    }

    #[test]
    fn a_station_narrows_what_the_configuration_sets_and_does_not_widen_it() {
        let area = Area {
            keep_in: true,
            shape: Shape::Circle {
                centre: (47.05, 8.05),
                radius_m: 500.0,
            },
        };
        let configured = std::slice::from_ref(&area);
        let stays_in = square(AreaType::KeepInPolygon).whole().unwrap();
        assert_eq!(fence(configured, &stays_in, &unknown()).unwrap().len(), 5);
        let unites = Holder {
            unites: true,
            ..Holder::default()
        };
        let fault = fence(configured, &stays_in, &unites).unwrap_err();
        assert_eq!((fault.area, fault.reason), (7, Reason::Widens));
        let stays_out = square(AreaType::KeepOutPolygon).whole().unwrap();
        assert_eq!(fence(configured, &stays_out, &unites).unwrap().len(), 5);
        let both = square(AreaType::KeepInPolygon).with(configured);
        assert!(!is_breached(&both, (47.05, 8.05)));
        assert!(is_breached(&both, (47.01, 8.05)), "in one of them");
    }

    #[test]
    fn circles_come_last() {
        let circle = |keep_in| Area {
            keep_in,
            shape: Shape::Circle {
                centre: (47.05, 8.05),
                radius_m: 500.0,
            },
        };
        let mut sent = square(AreaType::KeepOutPolygon).whole().unwrap();
        sent.insert(0, (6, circle(false)));
        let points = fence(&[circle(true)], &sent, &unknown()).unwrap();
        let order: Vec<_> = points
            .iter()
            .map(|point| (point.area, point.vertex, point.item.command))
            .collect();
        assert_eq!(
            order,
            [
                (7, 1, 5002),
                (7, 2, 5002),
                (7, 3, 5002),
                (7, 4, 5002),
                (0, 1, 5003),
                (6, 1, 5004)
            ]
        );
    }

    #[test]
    fn crossed_sides_and_too_many_corners_are_refused() {
        let mut areas = Areas::default();
        for (number, corner) in [(1, 0), (2, 2), (3, 1), (4, 3)] {
            let at = CORNERS[corner];
            areas
                .store(&vertex(1, AreaType::KeepInPolygon, 4, number, at))
                .unwrap();
        }
        assert_eq!(
            fence(&[], &areas.whole().unwrap(), &unknown())
                .unwrap_err()
                .reason,
            Reason::Outline
        );
        let many = |from: usize| -> Area {
            let corner = |n: usize| {
                let angle = std::f64::consts::TAU * n as f64 / 33.0;
                (47.0 + 0.1 * angle.sin(), from as f64 + 0.1 * angle.cos())
            };
            Area {
                keep_in: false,
                shape: Shape::Polygon((0..33).map(corner).collect()),
            }
        };
        let two = [(1, many(8)), (2, many(9))];
        let fault = fence(&[], &two, &unknown()).unwrap_err();
        assert_eq!(
            (fault.area, fault.vertex, fault.reason),
            (2, Some(32), Reason::TooMany(66))
        );
    }

    #[test]
    fn a_polygon_across_180_degrees_is_refused_and_a_circle_is_not() {
        let polygon = |keep_in, corners: &[(f64, f64)]| Area {
            keep_in,
            shape: Shape::Polygon(corners.to_vec()),
        };
        let corners = [
            (-16.8, 179.9),
            (-16.8, -179.9),
            (-16.6, -179.9),
            (-16.6, 179.9),
        ];
        for keep_in in [true, false] {
            let area = polygon(keep_in, &corners);
            let fault = fence(&[], &[(7, area.clone())], &at((-16.7, 179.9995))).unwrap_err();
            let span_deg = 359.8;
            assert!(
                matches!(fault.reason, Reason::Across180(found) if (found - span_deg).abs() < 1e-6),
                "{fault}"
            );
            assert_eq!((fault.area, fault.vertex), (7, Some(1)));
            let later = polygon(keep_in, &corners[1..]);
            assert_eq!(
                fence(&[later], &[], &unknown()).unwrap_err().vertex,
                Some(2)
            );
        }
        let circle = |centre| Area {
            keep_in: true,
            shape: Shape::Circle {
                centre,
                radius_m: 500.0,
            },
        };
        let across = [(7, circle((-16.7, -179.9995)))];
        assert!(fence(&[], &across, &at((-16.7, 179.9995))).is_ok());
        let beside = polygon(true, &[(-16.8, 179.8), (-16.8, 180.0), (-16.6, 180.0)]);
        assert!(fence(&[beside], &[], &unknown()).is_ok());
    }

    #[test]
    fn a_corner_that_is_none_is_refused_at_once() {
        let mut areas = Areas::default();
        let good = vertex(1, AreaType::KeepInPolygon, 4, 1, CORNERS[0]);
        let refused = |areas: &mut Areas, vertex: AreaVertex| areas.store(&vertex).unwrap_err();
        for (vertex, reason) in [
            (
                AreaVertex {
                    area_id: Some(0),
                    ..good.clone()
                },
                Reason::Missing("Area ID above 0"),
            ),
            (
                AreaVertex {
                    vertex_count: Some(2),
                    ..good.clone()
                },
                Reason::Count(2, "3 to 64"),
            ),
            (
                AreaVertex {
                    vertex_number: Some(5),
                    ..good.clone()
                },
                Reason::Number(5, 4),
            ),
            (
                AreaVertex {
                    area_type: Some(AreaType::Unknown(9)),
                    ..good.clone()
                },
                Reason::Type(9),
            ),
        ] {
            assert_eq!(refused(&mut areas, vertex).reason, reason);
        }
        let circle = vertex(1, AreaType::KeepInCircle, 1, 1, CORNERS[0]);
        assert_eq!(
            refused(&mut areas, circle).reason,
            Reason::Missing("Radius")
        );
        assert!(areas.is_empty());
    }
}
