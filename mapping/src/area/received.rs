//! The areas that a CUCS has sent (50016), vertex by vertex, and whether they are whole.

use std::collections::BTreeMap;

use stanag_msgs::Message;
use stanag_msgs::enums::AreaType;
use stanag_msgs::messages::AreaVertex;

use super::error::{AreaError, Reason};
use super::fence::MAX_VERTICES;
use super::shape::{Area, Shape};

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

#[cfg(test)]
mod tests {
    use super::super::fence::{Holder, fence};
    use super::super::testing::{CORNERS, vertex};
    use super::*;

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
            fence(&[], &areas.whole().unwrap(), &Holder::default())
                .unwrap()
                .len(),
            3
        );
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
