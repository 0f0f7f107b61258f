//! QGroundControl's .plan (JSON): mission, geofence, rally points.

use std::path::Path;

use curve_paths::Position;
use serde_json::{Value, json};

use super::draft::{Datum, Draft};
use super::fault::FormatError;
use super::items::{FRAME_MISSION, MissionItem, Reader, items};
use super::json_line::Document;
use super::losses::Losses;
use crate::fence::{Area, Keep, Shape};

/// Reads a .plan.
pub(super) fn read(file: &Path, text: &str) -> Result<Draft, FormatError> {
    let document = Document::read(file, text)?;
    let plan = &document.value;
    let fault = |field: &str, problem: &str| document.fault(field, problem);
    if plan["fileType"] != "Plan" {
        let problem = format!("{}, expected \"Plan\"", plan["fileType"]);
        return Err(fault("fileType", &problem));
    }
    let mut reader = Reader::default();
    let list = plan["mission"]["items"]
        .as_array()
        .ok_or_else(|| fault("mission.items", "missing, expected an array"))?;
    for (k, item) in list.iter().enumerate() {
        let path = format!("mission.items[{k}]");
        if item["type"] == "ComplexItem" {
            complex(&document, &path, item, &mut reader)?;
        } else {
            simple(&document, &path, item, &mut reader)?;
        }
    }
    let home = place(&plan["mission"]["plannedHomePosition"]);
    let mut draft = reader.finish(home).ok_or_else(|| {
        let problem =
            "missing, expected an altitude: some items are relative to home and some are not";
        fault("mission.plannedHomePosition[2]", problem)
    })?;
    let speed = |name: &str| plan["mission"][name].as_f64();
    match (speed("cruiseSpeed"), speed("hoverSpeed")) {
        (Some(cruise), Some(hover)) => draft.planned_m_s = Some([cruise, hover]),
        (None, None) => {}
        (Some(one), None) => draft.losses.add_whole(planned("cruise", one)),
        (None, Some(one)) => draft.losses.add_whole(planned("hover", one)),
    }
    fence(&document, &mut draft)?;
    let rally = plan["rallyPoints"]["points"].as_array();
    for (k, point) in rally.into_iter().flatten().enumerate() {
        let field = format!("rallyPoints.points[{k}]");
        let problem = format!("{point}, expected [latitude, longitude, altitude]");
        draft
            .rally
            .push(place(point).ok_or_else(|| fault(&field, &problem))?);
    }
    Ok(draft)
}

fn simple(
    document: &Document<'_>,
    path: &str,
    item: &Value,
    reader: &mut Reader,
) -> Result<(), FormatError> {
    let fault = |name: &str, problem: &str| document.fault(&format!("{path}.{name}"), problem);
    if item["type"] != "SimpleItem" {
        let problem = format!(
            "{}, expected \"SimpleItem\" or \"ComplexItem\"",
            item["type"]
        );
        return Err(fault("type", &problem));
    }
    let command = item["command"].as_u64().and_then(|n| u16::try_from(n).ok());
    let command =
        command.ok_or_else(|| fault("command", "missing, expected a whole number to 65535"))?;
    let frame = item["frame"].as_u64().and_then(|n| u8::try_from(n).ok());
    let frame = frame.ok_or_else(|| fault("frame", "missing, expected a whole number to 255"))?;
    let mut params = [f64::NAN; 7];
    for (n, param) in params.iter_mut().enumerate() {
        let value = &item["params"][n];
        *param = match value.as_f64() {
            Some(number) => number,
            // None, as QGroundControl writes it.
            None if value.is_null() && item["params"].is_array() => f64::NAN,
            None => {
                let problem = format!("{value}, expected a number or null");
                return Err(fault(&format!("params[{n}]"), &problem));
            }
        };
    }
    let number = reader.next();
    let taken = reader.take(&MissionItem {
        item: number,
        id: item["doJumpId"].as_i64().unwrap_or(number as i64),
        command,
        frame,
        params,
        line: Some(document.line_of(path)),
    });
    taken.map_err(|problem| fault("frame", &problem))
}

/// A survey, a corridor or a structure has its items within; a landing pattern has none that a route could fly.
fn complex(
    document: &Document<'_>,
    path: &str,
    item: &Value,
    reader: &mut Reader,
) -> Result<(), FormatError> {
    let kind = item["complexItemType"].as_str().unwrap_or("of no type");
    let within = item["TransectStyleComplexItem"]["Items"].as_array();
    let Some(within) = within.filter(|items| !items.is_empty()) else {
        let landing = kind.to_ascii_lowercase().contains("landing");
        if landing {
            reader.lose("landing pattern");
        } else {
            reader.lose(&format!("complex item {kind}"));
        }
        return Ok(());
    };
    for (k, item) in within.iter().enumerate() {
        let path = format!("{path}.TransectStyleComplexItem.Items[{k}]");
        simple(document, &path, item, reader)?;
    }
    Ok(())
}

fn fence(document: &Document<'_>, draft: &mut Draft) -> Result<(), FormatError> {
    let fence = &document.value["geoFence"];
    let list = |name: &str| fence[name].as_array().into_iter().flatten().enumerate();
    let keep = |area: &Value| Keep::inside(area["inclusion"].as_bool().unwrap_or(true));
    for (k, area) in list("polygons") {
        let vertices = area["polygon"].as_array().into_iter().flatten();
        let vertices: Option<Vec<[f64; 2]>> = vertices.map(pair).collect();
        let vertices = vertices.filter(|v| v.len() >= 3).ok_or_else(|| {
            let field = format!("geoFence.polygons[{k}].polygon");
            let problem = "expected 3 or more of [latitude, longitude]";
            document.fault(&field, problem)
        })?;
        draft.areas.push(Area {
            keep: keep(area),
            shape: Shape::Polygon(vertices),
        });
    }
    for (k, area) in list("circles") {
        let circle = &area["circle"];
        let (Some(centre), Some(radius_m)) = (pair(&circle["center"]), circle["radius"].as_f64())
        else {
            let field = format!("geoFence.circles[{k}].circle");
            let problem = "expected center [latitude, longitude] and radius, m";
            return Err(document.fault(&field, problem));
        };
        draft.areas.push(Area {
            keep: keep(area),
            shape: Shape::Circle { centre, radius_m },
        });
    }
    if fence["breachReturn"].is_array() {
        draft.losses.add_whole("return point of the geofence");
    }
    Ok(())
}

fn pair(value: &Value) -> Option<[f64; 2]> {
    Some([value[0].as_f64()?, value[1].as_f64()?])
}

fn place(value: &Value) -> Option<Position> {
    let [lat_deg, lon_deg] = pair(value)?;
    Some(Position::new(lat_deg, lon_deg, value[2].as_f64()?))
}

/// Writes a .plan; home at the first point where none is known.
pub(super) fn write(draft: &Draft, losses: &mut Losses) -> String {
    // QGroundControl's altitude modes: 1 relative to home, 2 above mean sea level.
    let mode = if draft.datum == Datum::Home { 1 } else { 2 };
    let list: Vec<Value> = items(draft, losses)
        .iter()
        .map(|item| {
            let mut value = json!({
                "autoContinue": true, "command": item.command, "doJumpId": item.id, "frame": item.frame,
                "params": item.params, "type": "SimpleItem",
            });
            if item.frame != FRAME_MISSION {
                value["AMSLAltAboveTerrain"] = Value::Null;
                value["Altitude"] = json!(item.params[6]);
                value["AltitudeMode"] = json!(if item.frame == 0 { 2 } else { 1 });
            }
            value
        })
        .collect();
    let position = |p: &Position| json!([p.lat_deg, p.lon_deg, p.alt_m]);
    let version = |mut area: Value, keep: Keep| {
        area["inclusion"] = json!(keep == Keep::In);
        area["version"] = json!(1);
        area
    };
    let (mut circles, mut polygons) = (Vec::new(), Vec::new());
    for area in &draft.areas {
        match &area.shape {
            Shape::Polygon(vertices) => {
                polygons.push(version(json!({ "polygon": vertices }), area.keep));
            }
            Shape::Circle { centre, radius_m } => {
                let circle = json!({ "circle": { "center": centre, "radius": radius_m } });
                circles.push(version(circle, area.keep));
            }
        }
    }
    let [cruise, hover] = draft.planned_m_s.unwrap_or(PLANNED_M_S);
    let plan = json!({
        "fileType": "Plan", "groundStation": "QGroundControl", "version": 1,
        "geoFence": { "circles": circles, "polygons": polygons, "version": 2 },
        "mission": {
            "cruiseSpeed": cruise, "hoverSpeed": hover, "firmwareType": 12, "vehicleType": 2, "globalPlanAltitudeMode": mode,
            "items": list, "plannedHomePosition": home(draft).as_ref().map(position), "version": 2,
        },
        "rallyPoints": { "points": draft.rally.iter().map(position).collect::<Vec<_>>(), "version": 2 },
    });
    format!("{plan:#}\n")
}

/// The planned speeds, in words.
pub(super) fn planned_speeds(draft: &Draft) -> Option<String> {
    let [cruise, hover] = draft.planned_m_s?;
    Some(format!(
        "planned speeds for estimates: cruise {cruise} m/s, hover {hover} m/s"
    ))
}

/// Whether the planned speeds are those that QGroundControl writes into every file, which nobody chose.
pub(super) fn has_default_speeds(draft: &Draft) -> bool {
    draft.planned_m_s == Some(PLANNED_M_S)
}

/// One planned speed without the other, in words.
fn planned(which: &str, m_s: f64) -> String {
    format!("planned speed for estimates: {which} {m_s} m/s")
}

/// Cruise and hover speed of a new plan of QGroundControl, m/s.
const PLANNED_M_S: [f64; 2] = [15.0, 5.0];

/// Home: the file's, or else the first point; at height 0 where heights are above it.
pub(super) fn home(draft: &Draft) -> Option<Position> {
    let first = || {
        let first = draft.points.first()?.position;
        let alt_m = if draft.datum == Datum::Home {
            0.0
        } else {
            first.alt_m
        };
        Some(Position { alt_m, ..first })
    };
    draft.home.or_else(first)
}
