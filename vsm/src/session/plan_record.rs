//! Plans on disk: what a CUCS has sent, and what went aboard the vehicle.

use mapping::altitude::Level;
use mapping::plan::Plan;
use mapping::route::Curved;
use mapping::route::{CompiledMission, Leg};
use mavlink_link::service::mission::Item;
use serde::{Deserialize, Serialize};
use stanag_msgs::enums::RouteType;
use stanag_msgs::{Envelope, Id, MAX_DATAGRAM, Message, frames};

/// The route that the vehicle carries, as it was read back from it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct UploadedMission {
    pub(crate) compiled: CompiledMission,
    /// MISSION_CURRENT.mission_id of it, 0 where the vehicle has none.
    pub(crate) mission_id: u32,
    pub(crate) route_type: RouteType,
    /// 13000's Mission ID, for 14000 and 3.
    pub(crate) mission_name: String,
    /// The messages that it was made of; none in a record of an earlier version.
    pub(crate) plan: Plan,
}

/// A record that does not read back.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the stored plan cannot be read: {0}")]
pub(crate) struct RecordError(String);

#[derive(Serialize, Deserialize)]
struct PlanRecord {
    /// One message a line, as DLI bytes in hex.
    messages: Vec<String>,
}

/// The bytes of a plan's record.
pub(crate) fn encode_plan(plan: &Plan, cucs: Id, vehicle: Id) -> Vec<u8> {
    let messages = encode_messages(plan.messages(), cucs, vehicle);
    serde_json::to_vec(&PlanRecord { messages }).unwrap_or_default()
}

/// Messages of a record, one a line.
pub(super) fn encode_messages(
    messages: impl Iterator<Item = Message>,
    cucs: Id,
    vehicle: Id,
) -> Vec<String> {
    let mut bytes = [0; MAX_DATAGRAM];
    messages
        .filter_map(|message| {
            let length = message
                .encode(&Envelope::new(cucs, vehicle), &mut bytes)
                .ok()?;
            bytes.get(..length).map(hex)
        })
        .collect()
}

/// The messages of a record, each with its source.
pub(super) fn decode_messages(lines: &[String]) -> Result<Vec<(Id, Message)>, RecordError> {
    let mut messages = Vec::with_capacity(lines.len());
    for line in lines {
        let bytes = unhex(line).ok_or_else(|| RecordError(format!("not hex: {line}")))?;
        for frame in frames(&bytes) {
            let frame = frame.map_err(|cause| RecordError(cause.to_string()))?;
            let message = Message::decode(frame.header.message_type, frame.data)
                .map_err(|cause| RecordError(cause.to_string()))?;
            messages.push((frame.header.source, message));
        }
    }
    Ok(messages)
}

/// The plan of a record.
pub(crate) fn decode_plan(bytes: &[u8], vehicle: Id) -> Result<Plan, RecordError> {
    let record: PlanRecord =
        serde_json::from_slice(bytes).map_err(|cause| RecordError(cause.to_string()))?;
    let mut plan = Plan::default();
    store_all(&mut plan, &record.messages, vehicle)?;
    Ok(plan)
}

fn store_all(plan: &mut Plan, lines: &[String], vehicle: Id) -> Result<(), RecordError> {
    for (source, message) in decode_messages(lines)? {
        // 50001 names the CUCS that sent it; the record may have been written for another since.
        let cucs = match &message {
            Message::CurveSegmentPaper(curve) => curve.cucs_id.unwrap_or(source),
            _ => source,
        };
        plan.store(&message, cucs, vehicle)
            .map_err(|cause| RecordError(cause.to_string()))?;
    }
    Ok(())
}

#[derive(Serialize, Deserialize)]
struct AboardRecord {
    mission_id: u32,
    mission_name: String,
    route_type: u8,
    items: Vec<ItemRecord>,
    waypoint_of: Vec<u16>,
    legs: Vec<LegRecord>,
    #[serde(default)]
    curved: Option<CurvedRecord>,
    /// As in the record of a plan.
    #[serde(default)]
    messages: Vec<String>,
}

/// What was made of the curved legs.
#[derive(Serialize, Deserialize)]
struct CurvedRecord {
    legs: usize,
    chords: usize,
    tolerance_m: f64,
    bound_m: f64,
    predicted_m: Option<f64>,
    time_s: f64,
}

impl From<Curved> for CurvedRecord {
    fn from(curved: Curved) -> Self {
        let Curved {
            legs,
            chords,
            tolerance_m,
            bound_m,
            predicted_m,
            time_s,
        } = curved;
        Self {
            legs,
            chords,
            tolerance_m,
            bound_m,
            predicted_m,
            time_s,
        }
    }
}

impl From<CurvedRecord> for Curved {
    fn from(record: CurvedRecord) -> Self {
        let CurvedRecord {
            legs,
            chords,
            tolerance_m,
            bound_m,
            predicted_m,
            time_s,
        } = record;
        Self {
            legs,
            chords,
            tolerance_m,
            bound_m,
            predicted_m,
            time_s,
        }
    }
}

/// Floats as their bits: JSON has no NaN, and an unset parameter is one.
#[derive(Serialize, Deserialize)]
struct ItemRecord {
    frame: u8,
    command: u16,
    current: bool,
    autocontinue: bool,
    params: [u32; 4],
    x: i32,
    y: i32,
    z: u32,
}

#[derive(Serialize, Deserialize)]
struct LegRecord {
    number: u16,
    latitude: f64,
    longitude: f64,
    amsl_m: Option<f64>,
    above_home_m: Option<f64>,
    speed_m_s: Option<f64>,
}

/// The bytes of the record of what is aboard.
pub(crate) fn encode_aboard(aboard: &UploadedMission, vehicle: Id) -> Vec<u8> {
    let UploadedMission {
        compiled,
        mission_id,
        route_type,
        mission_name,
        plan,
    } = aboard;
    let items = compiled.items.iter().map(|item| ItemRecord {
        frame: item.frame,
        command: item.command,
        current: item.current,
        autocontinue: item.autocontinue,
        params: item.params.map(f32::to_bits),
        x: item.x,
        y: item.y,
        z: item.z.to_bits(),
    });
    let legs = compiled.order.iter().map(|leg| {
        let (amsl_m, above_home_m) = match leg.level {
            Level::Amsl(m) => (Some(m), None),
            Level::AboveHome(m) => (None, Some(m)),
        };
        let Leg {
            number,
            latitude,
            longitude,
            speed_m_s,
            ..
        } = *leg;
        LegRecord {
            number,
            latitude,
            longitude,
            amsl_m,
            above_home_m,
            speed_m_s,
        }
    });
    let record = AboardRecord {
        mission_id: *mission_id,
        mission_name: mission_name.clone(),
        route_type: route_type.raw(),
        items: items.collect(),
        waypoint_of: compiled.waypoint_of.clone(),
        legs: legs.collect(),
        curved: compiled.curved.map(CurvedRecord::from),
        messages: encode_messages(plan.messages(), Id::NULL, vehicle),
    };
    serde_json::to_vec(&record).unwrap_or_default()
}

/// What a record says is aboard.
pub(crate) fn decode_aboard(bytes: &[u8], vehicle: Id) -> Result<UploadedMission, RecordError> {
    let record: AboardRecord =
        serde_json::from_slice(bytes).map_err(|cause| RecordError(cause.to_string()))?;
    let items = record.items.iter().map(|item| Item {
        frame: item.frame,
        command: item.command,
        current: item.current,
        autocontinue: item.autocontinue,
        params: item.params.map(f32::from_bits),
        x: item.x,
        y: item.y,
        z: f32::from_bits(item.z),
    });
    let legs: Option<Vec<Leg>> = record
        .legs
        .iter()
        .map(|leg| {
            let level = leg
                .amsl_m
                .map(Level::Amsl)
                .or(leg.above_home_m.map(Level::AboveHome))?;
            let LegRecord {
                number,
                latitude,
                longitude,
                speed_m_s,
                ..
            } = *leg;
            Some(Leg {
                number,
                latitude,
                longitude,
                level,
                speed_m_s,
            })
        })
        .collect();
    let order = legs.ok_or_else(|| RecordError("a leg without altitude".to_owned()))?;
    if record.items.len() != record.waypoint_of.len() {
        return Err(RecordError("items and waypoints do not match".to_owned()));
    }
    let mut plan = Plan::default();
    store_all(&mut plan, &record.messages, vehicle)?;
    Ok(UploadedMission {
        plan,
        compiled: CompiledMission {
            items: items.collect(),
            waypoint_of: record.waypoint_of,
            order,
            curved: record.curved.map(Curved::from),
            notes: Vec::new(),
        },
        mission_id: record.mission_id,
        route_type: RouteType::from_raw(record.route_type),
        mission_name: record.mission_name,
    })
}

fn hex(bytes: &[u8]) -> String {
    bytes
        .iter()
        .flat_map(|byte| [byte >> 4, byte & 15])
        .filter_map(|n| char::from_digit(n.into(), 16))
        .collect()
}

fn unhex(text: &str) -> Option<Vec<u8>> {
    let digits: Option<Vec<u8>> = text
        .chars()
        .map(|c| c.to_digit(16).and_then(|n| u8::try_from(n).ok()))
        .collect();
    let digits = digits?;
    (digits.len() % 2 == 0).then(|| {
        digits
            .chunks(2)
            .map(|pair| pair[0] << 4 | pair[1])
            .collect()
    })
}
