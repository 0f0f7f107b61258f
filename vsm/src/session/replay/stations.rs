//! What the recorded datagrams of the DLI show: who held what, which alerts stood, what was commanded and refused.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::time::Duration;

use stanag_msgs::enums::{
    AckType, AlertPriority, AlertType, HandoverStatus, MissionPlanMode, MissionTransferStatus,
};
use stanag_msgs::messages::{SubsystemStatusAlert, UaPositionWaypoint, VsmAuthorisationResponse};
use stanag_msgs::{Id, Message, Profile, ed25, table};

use super::changes::{Changes, entry};
use crate::session::authority::rules::Stations as Payload;
use crate::session::bridge::status::AlertStatus;
use crate::session::log::{LogEntry, LogLevel};

type Events = Vec<(Duration, LogEntry)>;

/// Where a waypoint is, degrees north and east, and the speed to it, m/s.
type Sent = (f64, f64, Option<f64>);

/// All of the DLI.
#[derive(Debug, Default)]
pub(super) struct Stations {
    pub(super) vsm: Option<Id>,
    pub(super) vehicles: BTreeMap<Id, OfVehicle>,
    pub(super) known: BTreeMap<Id, Changes<SocketAddr>>,
    pub(super) of_edition_25: u64,
    received: u64,
}

/// What stations know of a vehicle.
#[derive(Debug, Default)]
pub(super) struct OfVehicle {
    pub(super) tail_number: Changes<String>,
    pub(super) mission: Changes<String>,
    /// LOI bits and payload stations by CUCS.
    pub(super) holders: BTreeMap<Id, Changes<(u8, Vec<u8>)>>,
    pub(super) handover: Changes<Option<(Id, Id)>>,
    /// Alerts that stand, with their priority.
    pub(super) alerts: Changes<Vec<(u8, AlertStatus)>>,
    pub(super) flies_to: Changes<Option<u16>>,
    /// Waypoints that stations sent, by number.
    pub(super) waypoints: BTreeMap<u16, Changes<Sent>>,
    /// Parts of texts that are longer than a message, by receiver and alert.
    parts: BTreeMap<(Id, i32), BTreeMap<u8, String>>,
}

impl Stations {
    /// Whether there is a recording of the DLI.
    pub(super) fn any(&self) -> bool {
        self.received > 0
    }

    pub(super) fn take(
        &mut self,
        wall: Duration,
        from: SocketAddr,
        bytes: &[u8],
        events: &mut Events,
    ) {
        self.received += 1;
        if ed25::is_ed25(bytes) {
            self.of_edition_25 += 1;
            return;
        }
        let profile = Profile::default();
        for frame in profile.frames(bytes).flatten() {
            let header = frame.header;
            let (source, destination) = (header.source, header.destination);
            if let Ok(message) = profile.decode(header.message_type, frame.data) {
                let of_vehicle = matches!(
                    message,
                    Message::VsmAuthorisationResponse(_) | Message::VehicleId(_)
                );
                if of_vehicle {
                    self.vehicles.entry(source).or_default();
                }
                if self.vehicles.contains_key(&source) {
                    self.of_vehicle(wall, source, destination, &message, events);
                } else if Some(source) != self.vsm {
                    let changes = self.known.entry(source).or_default();
                    changes.push(wall, from);
                    self.of_station(wall, source, destination, &message, events);
                }
            }
        }
    }

    /// What a vehicle sends by its VSM.
    fn of_vehicle(
        &mut self,
        wall: Duration,
        id: Id,
        to: Id,
        message: &Message,
        events: &mut Events,
    ) {
        let vehicle = self.vehicles.entry(id).or_default();
        let mut report = |level, about, text| events.push((wall, entry(level, about, text)));
        match message {
            Message::VehicleId(one) => {
                if let Some(vsm) = one.vsm_id.filter(|vsm| *vsm != Id::NULL) {
                    self.vsm = Some(vsm);
                }
                if let Some(tail) = &one.tail_number {
                    vehicle.tail_number.set(wall, tail.as_str().to_owned());
                }
                if let Some(mission) = &one.mission_id {
                    vehicle.mission.set(wall, mission.as_str().to_owned());
                }
            }
            Message::VsmAuthorisationResponse(one) => {
                let (loi, stations) = granted(one);
                let words = one.loi_granted.map(|loi| loi.in_words());
                let changes = vehicle.holders.entry(to).or_default();
                let first = changes.0.is_empty();
                if changes.set(wall, (loi, stations)) && !(first && loi == 0) {
                    let words = words.filter(|_| loi != 0);
                    let text = match words {
                        Some(words) => format!("{to} holds LOI {words}"),
                        None => format!("{to} holds no LOI"),
                    };
                    report(LogLevel::Info, id, text);
                }
            }
            Message::HandoverStatusReport(one) => {
                let between = one
                    .cucs_id_relinquishing_control
                    .zip(one.cucs_id_acquiring_control);
                let under_way = one.status == Some(HandoverStatus::InProgress);
                let changed = vehicle.handover.set(wall, between.filter(|_| under_way));
                if let (true, Some((from, by)), Some(status)) = (changed, between, one.status) {
                    report(
                        LogLevel::Info,
                        id,
                        format!("handover from {from} to {by}: {status}"),
                    );
                }
            }
            Message::FromToNextWaypointStates(one) => {
                let number = one.to_waypoint_number.filter(|number| *number != 0);
                vehicle.flies_to.set(wall, number);
            }
            Message::SubsystemStatusAlert(one) => vehicle.alert(wall, id, to, one, events),
            Message::MessageAcknowledgement(one)
                if one.acknowledgement_type == Some(AckType::Refused) =>
            {
                let of = one.original_message_type.map_or_else(String::new, name);
                report(LogLevel::Warning, to, format!("refused: {of}"));
            }
            Message::MissionUploadDownloadStatus(one) => {
                if let Some(status) = one.status.filter(|_| one.percent_complete != Some(0)) {
                    let level = match status {
                        MissionTransferStatus::Aborted => LogLevel::Warning,
                        _ => LogLevel::Info,
                    };
                    if status != MissionTransferStatus::InProgress {
                        report(level, id, format!("mission transfer for {to}: {status}"));
                    }
                }
            }
            _ => {}
        }
    }

    /// What a ground station sends.
    fn of_station(
        &mut self,
        wall: Duration,
        id: Id,
        to: Id,
        message: &Message,
        events: &mut Events,
    ) {
        let mut report = |text| events.push((wall, entry(LogLevel::Info, id, text)));
        match message {
            Message::CucsAuthorisationRequest(one) => {
                let levels = one.requested_handover_loi.map(|loi| loi.in_words());
                let access = one
                    .requested_handover_access
                    .map(|access| access.to_string());
                if let (Some(levels), Some(access)) = (levels, access) {
                    // Discovery asks everybody for nothing.
                    if to != Id::BROADCAST {
                        report(format!("asks {to}: {access}, LOI {levels}"));
                    }
                }
            }
            Message::VehicleOperatingModeCommand(one) => {
                let mode = one.select_flight_path_control_mode;
                report(match mode {
                    Some(mode) => format!("commands {to}: mode {}", mode.in_words()),
                    None => format!("commands {to} in its mode"),
                });
            }
            Message::MissionTransferCommand(one) => {
                if let Some(mode) = one.mission_plan_mode {
                    report(format!("commands {to}: {mode}"));
                    if mode == MissionPlanMode::Clear
                        && let Some(vehicle) = self.vehicles.get_mut(&to)
                    {
                        vehicle.waypoints.clear();
                    }
                }
            }
            Message::UaPositionWaypoint(one) => {
                if let Some((number, at)) = waypoint(one) {
                    let vehicle = self.vehicles.entry(to).or_default();
                    vehicle.waypoints.entry(number).or_default().set(wall, at);
                }
            }
            _ => {}
        }
    }
}

impl OfVehicle {
    fn alert(
        &mut self,
        wall: Duration,
        id: Id,
        to: Id,
        message: &SubsystemStatusAlert,
        events: &mut Events,
    ) {
        let number = message.alert_warning_id.map_or(0, i32::abs);
        let Some(text) = self.whole(to, number, message) else {
            return;
        };
        let priority = message.priority.unwrap_or(AlertPriority::Nominal);
        let before = self
            .alerts
            .0
            .last()
            .map_or(&[][..], |(_, all)| all.as_slice());
        let same = |(_, one): &(u8, AlertStatus)| one.id == number && one.text == text;
        // The same alert goes to each station.
        let lately = events.iter().rev().take(MAX_STATIONS);
        let mut lately = lately.take_while(|(at, _)| wall.saturating_sub(*at) < LATELY);
        if before.iter().any(same)
            || lately.any(|(_, known)| known.about == id && known.text.ends_with(&text))
        {
            return;
        }
        let mut standing = before.to_vec();
        standing.retain(|(_, one)| one.id != number);
        if priority != AlertPriority::Cleared && message.alert_type == Some(AlertType::NotClearable)
        {
            let alert = AlertStatus {
                id: number,
                priority: priority.to_string(),
                text: text.clone(),
                acknowledged: Vec::new(),
            };
            standing.push((priority.raw(), alert));
        }
        self.alerts.set(wall, standing);
        events.push((wall, entry(LogLevel::of(priority), id, text)));
    }

    /// The text, once its last part is there.
    fn whole(&mut self, to: Id, id: i32, message: &SubsystemStatusAlert) -> Option<String> {
        let text = message
            .text
            .as_ref()
            .map_or("", |text| text.as_str())
            .to_owned();
        let total = message.append_total_number.unwrap_or(1);
        let Some(order) = message.append_order.filter(|_| total > 1) else {
            return Some(text);
        };
        let parts = self.parts.entry((to, id)).or_default();
        parts.insert(order, text);
        if parts.len() < usize::from(total) {
            return None;
        }
        let parts = self.parts.remove(&(to, id))?;
        Some(parts.into_values().collect())
    }
}

/// LOI bits and payload stations of a message 2.
fn granted(message: &VsmAuthorisationResponse) -> (u8, Vec<u8>) {
    let loi = message.loi_granted.map_or(0, |loi| loi.raw());
    let stations = Payload::from_bitmaps(
        message.controlled_station_1_16,
        message.controlled_station_17_32,
    );
    (loi, stations.iter().collect())
}

fn waypoint(message: &UaPositionWaypoint) -> Option<(u16, Sent)> {
    let latitude = message.waypoint_to_latitude_or_relative_y?.degrees();
    let longitude = message.waypoint_to_longitude_or_relative_x?.degrees();
    let speed = message.waypoint_to_speed.map(|speed| speed.si());
    Some((message.waypoint_number?, (latitude, longitude, speed)))
}

fn name(message_type: u16) -> String {
    let name = table::message(message_type).map_or("unknown message", |info| info.name);
    format!("{message_type} ({name})")
}

/// Copies of an alert for other stations follow within this time, and within so many events.
const LATELY: Duration = Duration::from_millis(500);
const MAX_STATIONS: usize = 32;
