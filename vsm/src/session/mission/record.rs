//! The format of plans on disk: messages of a CUCS, and the mission uploaded to the vehicle.
//!
//! Messages are stored as received, as DLI bytes in hex, so that fields unknown to this program are not lost.

use data_encoding::{HEXLOWER, HEXLOWER_PERMISSIVE};
use mapping::altitude::Level;
use mapping::area::{self, Area};
use mapping::mode::Px4Mode;
use mapping::plan::Plan;
use mapping::route::{CompiledMission, Curved, Leg};
use mapping::telemetry::Telemetry;
use mavlink_link::service::mission::Item;
use serde::{Deserialize, Serialize};
use stanag_msgs::enums::RouteType;
use stanag_msgs::messages::MissionTransferCommand;
use stanag_msgs::{EncodeError, Envelope, Id, MAX_DATAGRAM, Message, frames};

use super::received::ReceivedPlan;
use super::staged::StagedUpload;
use crate::session::store::{from_json, to_json};

/// The route that the vehicle carries, as it was read back from it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct UploadedMission {
    pub(crate) compiled: CompiledMission,
    /// Its MISSION_CURRENT.mission_id, 0 if the vehicle has none.
    pub(crate) mission_id: u32,
    pub(crate) route_type: RouteType,
    /// 13000's Mission ID, for 14000 and 3.
    pub(crate) mission_name: String,
    /// The messages that it was compiled from; empty in a record of an earlier version.
    pub(crate) plan: Plan,
}

impl UploadedMission {
    /// Whether the vehicle, which reports this mission id, flies it; 0 is no id.
    pub(crate) fn is_aboard(&self, mission_id: u32) -> bool {
        self.mission_id == 0 || mission_id == 0 || self.mission_id == mission_id
    }

    /// The current item of AUTO.MISSION, if it is one of this mission.
    fn current_item(&self, telemetry: &Telemetry) -> Option<u16> {
        let flown = telemetry.mode == Some(Px4Mode::MISSION);
        let mission = telemetry.mission.filter(|_| flown)?;
        self.is_aboard(mission.mission_id).then_some(mission.seq)
    }

    /// Whether the vehicle flies its landing: the touch-down or the approach.
    pub(crate) fn lands(&self, telemetry: &Telemetry) -> bool {
        let seq = self.current_item(telemetry);
        seq.is_some_and(|seq| self.compiled.lands(seq))
    }

    /// Whether a fixed wing flies to its touch-down: a hold would make it circle at its present low height.
    pub(crate) fn is_on_final(&self, telemetry: &Telemetry) -> bool {
        let seq = self.current_item(telemetry);
        telemetry.airframe().has_wings() && seq.is_some_and(|seq| self.compiled.is_touch_down(seq))
    }

    /// Its first item that breaches these areas, as an index.
    pub(crate) fn breach_of(&self, areas: &[Area]) -> Option<usize> {
        area::first_breach(areas, &self.compiled.items)
    }

    /// Its first leg that crosses one of these areas, between places that breach none, in words with the area.
    pub(crate) fn leg_across(&self, areas: &[(u16, Area)]) -> Option<String> {
        let ((from, to), crossing) = area::first_leg_across(areas, &self.compiled.items)?;
        let to = self.compiled.item_in_words(to)?;
        let from = self.compiled.item_in_words(from)?;
        Some(match from == to {
            // Chords of one curve, or the way to the first waypoint.
            true => format!("the leg to {to} {crossing}"),
            false => format!("the leg from {from} to {to} {crossing}"),
        })
    }

    /// That the vehicle finds it infeasible, and what to do, for an operator. `breach`: the item that breaches its fence, if one does.
    pub(crate) fn infeasible(&self, breach: Option<usize>) -> String {
        let Some(item) = breach else {
            return "the vehicle finds the route aboard infeasible, and does not fly it as it is: load it again, or another route (13000)"
                .to_owned();
        };
        let of = self.compiled.item_in_words(item);
        let breach = of.map_or_else(String::new, |of| format!(" ({of} breaches it)"));
        format!(
            "the vehicle finds the route aboard infeasible within its fence{breach}, and does not fly it: load another route (13000), or \
             other areas (50017)"
        )
    }

    /// Whether it is the route with this name.
    pub(crate) fn is_of(&self, route_id: &str) -> bool {
        self.plan.route_named(route_id).is_some()
    }
}

/// A record that cannot be decoded.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the stored plan cannot be read: {0}")]
pub(crate) struct RecordError(String);

#[derive(Serialize, Deserialize)]
struct PlanRecord {
    /// The stored plan: one message a line, as DLI bytes in hex.
    messages: Vec<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    staged: Option<StagedRecord>,
    /// Why the latest upload was dropped.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    dropped: Option<String>,
    /// Written by versions that kept the upload in `messages`.
    #[serde(default, skip_serializing)]
    upload: Option<OldUploadRecord>,
}

/// The upload that will change the plan.
#[derive(Serialize, Deserialize)]
struct StagedRecord {
    owner: u32,
    /// The plan as the upload changes it.
    plan: Vec<String>,
    sent: Vec<String>,
    failed: bool,
}

/// The upload that has changed `messages` already.
#[derive(Deserialize)]
struct OldUploadRecord {
    /// The plan before it.
    base: Vec<String>,
    /// Its messages so far.
    sent: Vec<String>,
    failed: bool,
}

/// The bytes of a plan's record.
///
/// # Errors
/// A message of it cannot be encoded.
pub(super) fn encode_plan(
    received: &ReceivedPlan,
    cucs: Id,
    vehicle: Id,
) -> Result<Vec<u8>, EncodeError> {
    let received = received.at_restart(vehicle);
    let lines = |plan: &Plan, cucs: Id| encode_messages(plan.messages(), cucs, vehicle);
    let staged = received.staged.map(|staged| -> Result<_, EncodeError> {
        Ok(StagedRecord {
            owner: staged.owner.0,
            plan: lines(&staged.plan, staged.owner)?,
            sent: lines(&staged.sent, staged.owner)?,
            failed: staged.failed,
        })
    });
    Ok(to_json(&PlanRecord {
        messages: lines(&received.stored, cucs)?,
        staged: staged.transpose()?,
        dropped: received.dropped,
        upload: None,
    }))
}

/// Decodes the plan of a record; also returns its number of messages.
pub(super) fn decode_plan(bytes: &[u8], vehicle: Id) -> Result<(ReceivedPlan, usize), RecordError> {
    let record: PlanRecord = from_json(bytes).map_err(RecordError)?;
    let plan = |lines: &[String]| {
        let mut plan = Plan::default();
        store_all(&mut plan, lines, vehicle).map(|()| plan)
    };
    let mut lines = record.messages.len();
    let mut received = ReceivedPlan::settled(plan(&record.messages)?);
    if let Some(staged) = record.staged {
        lines = staged.plan.len();
        received.staged = Some(StagedUpload {
            owner: Id(staged.owner),
            plan: plan(&staged.plan)?,
            sent: plan(&staged.sent)?,
            failed: staged.failed,
        });
    } else if let Some(upload) = record.upload {
        // Its owner is known only from the source of its messages.
        let of_upload = upload.sent.last().or(record.messages.last());
        let sent_by = of_upload.and_then(|line| sources(line).ok()?.pop());
        received.staged = Some(StagedUpload {
            owner: sent_by.unwrap_or(Id::NULL),
            plan: std::mem::replace(&mut received.stored, plan(&upload.base)?),
            sent: plan(&upload.sent)?,
            failed: upload.failed,
        });
    }
    received.dropped = record.dropped;
    Ok((received, lines))
}

/// The sender of the messages of a line.
fn sources(line: &str) -> Result<Vec<Id>, RecordError> {
    let bytes = unhex(line)?;
    let mut sources = Vec::new();
    for frame in frames(&bytes) {
        sources.push(frame.map_err(fault)?.header.source);
    }
    Ok(sources)
}

/// Messages of a record, one a line.
///
/// # Errors
/// One of them cannot be encoded: a record without it would be another plan.
pub(super) fn encode_messages(
    messages: impl Iterator<Item = Message>,
    cucs: Id,
    vehicle: Id,
) -> Result<Vec<String>, EncodeError> {
    messages
        .map(|message| encode_message(&message, cucs, vehicle))
        .collect()
}

/// A message as DLI bytes in hex.
///
/// # Errors
/// It cannot be encoded.
pub(super) fn encode_message(
    message: &Message,
    cucs: Id,
    vehicle: Id,
) -> Result<String, EncodeError> {
    let mut bytes = [0; MAX_DATAGRAM];
    let envelope = Envelope::new(cucs, vehicle);
    let length = message.encode(&envelope, &mut bytes)?;
    Ok(HEXLOWER.encode(bytes.get(..length).unwrap_or_default()))
}

/// The messages of a record, each with the CUCS that sent it.
pub(super) fn decode_messages(
    lines: impl IntoIterator<Item = impl AsRef<str>>,
) -> Result<Vec<(Id, Message)>, RecordError> {
    let mut messages = Vec::new();
    for line in lines {
        let line = line.as_ref();
        let bytes = unhex(line)?;
        for frame in frames(&bytes) {
            let frame = frame.map_err(fault)?;
            let message = Message::decode(frame.header.message_type, frame.data).map_err(fault)?;
            // 50001 names the CUCS that sent it; the record may have been written for another CUCS since.
            let cucs = match &message {
                Message::CurveSegmentPaper(curve) => curve.cucs_id,
                _ => None,
            };
            messages.push((cucs.unwrap_or(frame.header.source), message));
        }
    }
    Ok(messages)
}

/// Stores the messages of a record in a plan, in their order.
fn store_all(
    plan: &mut Plan,
    lines: impl IntoIterator<Item = impl AsRef<str>>,
    vehicle: Id,
) -> Result<(), RecordError> {
    for (cucs, message) in decode_messages(lines)? {
        plan.store(&message, cucs, vehicle).map_err(fault)?;
    }
    Ok(())
}

/// Stores the messages of a log: they continue the upload of the record, up to a 13000 that was cut off. Returns the last
/// such 13000.
pub(super) fn store_log<'l>(
    received: &mut ReceivedPlan,
    lines: impl Iterator<Item = &'l str>,
    vehicle: Id,
) -> Result<Option<MissionTransferCommand>, RecordError> {
    let mut cut_off = None;
    for (cucs, message) in decode_messages(lines)? {
        if let Message::MissionTransferCommand(command) = message {
            received.begin_load(cucs);
            received.load_failed(vehicle);
            // `admit_load` let it begin, so nothing that was dropped before forbids it.
            received.dropped = None;
            cut_off = Some(command);
        } else {
            received.store(&message, cucs, vehicle).map_err(fault)?;
        }
    }
    Ok(cut_off)
}

fn unhex(line: &str) -> Result<Vec<u8>, RecordError> {
    let bytes = HEXLOWER_PERMISSIVE.decode(line.as_bytes());
    bytes.map_err(|_| RecordError(format!("not hex: {line}")))
}

fn fault(cause: impl std::fmt::Display) -> RecordError {
    RecordError(cause.to_string())
}

#[derive(Serialize, Deserialize)]
struct UploadedRecord {
    mission_id: u32,
    mission_name: String,
    route_type: u8,
    items: Vec<ItemRecord>,
    waypoint_of: Vec<u16>,
    legs: Vec<LegRecord>,
    #[serde(default)]
    curved: Option<Curved>,
    /// As in the record of a plan.
    #[serde(default)]
    messages: Vec<String>,
    /// The vehicle has flown it to its end.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    ended: bool,
}

#[derive(Serialize, Deserialize)]
struct ItemRecord(#[serde(with = "ItemFields")] Item);

#[derive(Serialize, Deserialize)]
#[serde(remote = "Item")]
struct ItemFields {
    frame: u8,
    command: u16,
    current: bool,
    autocontinue: bool,
    #[serde(with = "as_bits")]
    params: [f32; 4],
    x: i32,
    y: i32,
    #[serde(with = "as_bits")]
    z: f32,
}

/// Exactly one of the two altitudes is set.
#[derive(Serialize, Deserialize)]
struct LegRecord {
    number: u16,
    latitude: f64,
    longitude: f64,
    amsl_m: Option<f64>,
    above_home_m: Option<f64>,
    speed_m_s: Option<f64>,
}

impl From<&Leg> for LegRecord {
    fn from(leg: &Leg) -> LegRecord {
        let (amsl_m, above_home_m) = match leg.level {
            Level::Amsl(m) => (Some(m), None),
            Level::AboveHome(m) => (None, Some(m)),
        };
        LegRecord {
            number: leg.number,
            latitude: leg.latitude,
            longitude: leg.longitude,
            amsl_m,
            above_home_m,
            speed_m_s: leg.speed_m_s,
        }
    }
}

impl LegRecord {
    fn leg(&self) -> Option<Leg> {
        let above_home = || self.above_home_m.map(Level::AboveHome);
        Some(Leg {
            number: self.number,
            latitude: self.latitude,
            longitude: self.longitude,
            level: self.amsl_m.map(Level::Amsl).or_else(above_home)?,
            speed_m_s: self.speed_m_s,
        })
    }
}

/// Floats as their bits: JSON has no NaN, which is the value of unset item parameters.
mod as_bits {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    /// An f32, or an array of them.
    pub(super) trait Floats: Sized {
        type Bits: Serialize + for<'de> Deserialize<'de>;
        fn bits(&self) -> Self::Bits;
        fn of(bits: Self::Bits) -> Self;
    }

    impl Floats for f32 {
        type Bits = u32;
        fn bits(&self) -> u32 {
            self.to_bits()
        }
        fn of(bits: u32) -> f32 {
            f32::from_bits(bits)
        }
    }

    impl Floats for [f32; 4] {
        type Bits = [u32; 4];
        fn bits(&self) -> [u32; 4] {
            self.map(f32::to_bits)
        }
        fn of(bits: [u32; 4]) -> [f32; 4] {
            bits.map(f32::from_bits)
        }
    }

    pub(super) fn serialize<F: Floats, S: Serializer>(
        floats: &F,
        to: S,
    ) -> Result<S::Ok, S::Error> {
        floats.bits().serialize(to)
    }

    pub(super) fn deserialize<'de, F: Floats, D: Deserializer<'de>>(
        from: D,
    ) -> Result<F, D::Error> {
        F::Bits::deserialize(from).map(F::of)
    }
}

/// The bytes of an uploaded mission's record. `ended`: the vehicle has flown it to its end.
///
/// # Errors
/// A message of its plan cannot be encoded.
pub(super) fn encode_uploaded(
    uploaded: &UploadedMission,
    ended: bool,
    vehicle: Id,
) -> Result<Vec<u8>, EncodeError> {
    let compiled = &uploaded.compiled;
    Ok(to_json(&UploadedRecord {
        mission_id: uploaded.mission_id,
        mission_name: uploaded.mission_name.clone(),
        route_type: uploaded.route_type.raw(),
        items: compiled.items.iter().copied().map(ItemRecord).collect(),
        waypoint_of: compiled.waypoint_of.clone(),
        legs: compiled.order.iter().map(LegRecord::from).collect(),
        curved: compiled.curved,
        messages: encode_messages(uploaded.plan.messages(), Id::NULL, vehicle)?,
        ended,
    }))
}

/// The uploaded mission of a record, and whether the vehicle has flown it to its end.
pub(super) fn decode_uploaded(
    bytes: &[u8],
    vehicle: Id,
) -> Result<(UploadedMission, bool), RecordError> {
    let record: UploadedRecord = from_json(bytes).map_err(RecordError)?;
    let order: Option<Vec<Leg>> = record.legs.iter().map(LegRecord::leg).collect();
    let order = order.ok_or_else(|| fault("a leg without altitude"))?;
    // MISSION_CURRENT.seq indexes both.
    if record.items.len() != record.waypoint_of.len() {
        return Err(fault("items and waypoints do not match"));
    }
    let mut plan = Plan::default();
    store_all(&mut plan, &record.messages, vehicle)?;
    let uploaded = UploadedMission {
        plan,
        compiled: CompiledMission {
            items: record.items.into_iter().map(|item| item.0).collect(),
            waypoint_of: record.waypoint_of,
            order,
            curved: record.curved,
            // Not kept: after a restart curves are flown as chords, until the route is loaded again.
            streamed: Vec::new(),
            // The operator got these when the route was loaded.
            notes: Vec::new(),
        },
        mission_id: record.mission_id,
        route_type: RouteType::from_raw(record.route_type),
        mission_name: record.mission_name,
    };
    Ok((uploaded, record.ended))
}

#[cfg(test)]
mod tests {
    use stanag_msgs::messages::{FileTransferNotification, UaRoute};
    use stanag_msgs::scalar::UnsizedText;

    use super::*;

    /// As written by earlier versions: an update must not lose a mission.
    const RECORD: &str = r#"{"mission_id":7,"mission_name":"M","route_type":8,"items":[{"frame":3,"command":16,"current":true,"autocontinue":true,"params":[0,1065353216,0,2143289344],"x":470000000,"y":-80000000,"z":1101004800}],"waypoint_of":[1],"legs":[{"number":1,"latitude":47.0,"longitude":-8.0,"amsl_m":null,"above_home_m":20.0,"speed_m_s":5.5}],"curved":{"legs":1,"chords":9,"tolerance_m":0.5,"bound_m":0.4,"predicted_m":null,"time_s":12.25},"messages":[]}"#;

    #[test]
    fn the_record_of_an_uploaded_mission_keeps_its_bytes() {
        let vehicle = Id(0x1b00_0101);
        let (uploaded, ended) = decode_uploaded(RECORD.as_bytes(), vehicle).expect("it is read");
        assert!(!ended);
        assert!(uploaded.compiled.items[0].params[3].is_nan());
        assert_eq!(uploaded.compiled.order[0].level, Level::AboveHome(20.0));
        let written = encode_uploaded(&uploaded, false, vehicle).expect("it is encoded");
        assert_eq!(String::from_utf8_lossy(&written), RECORD);
        let written = encode_uploaded(&uploaded, true, vehicle).expect("it is encoded");
        assert!(decode_uploaded(&written, vehicle).expect("it is read").1);
        let without = RECORD.replace("\"above_home_m\":20.0", "\"above_home_m\":null");
        assert!(decode_uploaded(without.as_bytes(), vehicle).is_err());
    }

    #[test]
    fn messages_of_which_one_cannot_be_encoded_make_no_record() {
        let (cucs, vehicle) = (Id(0x1b00_00a0), Id(0x1b00_0101));
        let encoded = |file_name| {
            let route = UaRoute::default().into();
            let notice = FileTransferNotification {
                file_name,
                ..FileTransferNotification::default()
            };
            encode_messages([route, notice.into()].into_iter(), cucs, vehicle)
        };
        assert_eq!(encoded(None).expect("both are encoded").len(), 2);
        // No source gives the length of that field.
        let fault = encoded(Some(UnsizedText)).expect_err("one is missing");
        assert!(fault.to_string().contains("File Name"), "{fault}");
    }
}
