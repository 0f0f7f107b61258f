//! The last reports of one vehicle. Messages are kept whole; accessors return their fields in common units.

use std::collections::BTreeMap;
use std::time::Duration;

use route_files::Download;
use stanag_msgs::enums::{
    AltitudeType, FlightPathControlMode, HandoverStatus, LoiBitmap, MissionTransferStatus, UaState,
};
use stanag_msgs::messages::{
    EoIrLaserOperatingState, FromToNextWaypointStates, InertialStates, MissionUploadDownloadStatus,
    PositiveHandoverAuthorisationGranted, PositiveHandoverAuthorisationRequest, VehicleId,
    VehicleOperatingModeReport, VehicleOperatingStates, VsmAuthorisationResponse,
};
use stanag_msgs::{Id, Message, TimeStamp};

use super::alert::{Alert, Alerts, Taken};

/// A vehicle as this CUCS knows it: the latest message of each type by its stamp.
#[derive(Clone, Debug, Default)]
pub struct Vehicle {
    /// Its id: the source of its messages.
    pub id: Id,
    /// Message 2: the rights of this CUCS. Only messages addressed to it count.
    pub authorisation: Option<VsmAuthorisationResponse>,
    /// Message 3: tail number, mission.
    pub identity: Option<VehicleId>,
    /// Message 3001: the mode.
    pub mode_report: Option<VehicleOperatingModeReport>,
    /// Message 3002: the operating states.
    pub states: Option<VehicleOperatingStates>,
    /// Message 4000: position, velocity, attitude.
    pub inertial: Option<InertialStates>,
    /// Message 4001: the waypoints before and after the vehicle.
    pub waypoints: Option<FromToNextWaypointStates>,
    /// Message 14000: the state of a mission transfer.
    pub transfer: Option<MissionUploadDownloadStatus>,
    /// Message 21101 of each payload station, by its number.
    payloads: BTreeMap<u8, EoIrLaserOperatingState>,
    /// Message 4: what another CUCS requests; `None` once that is decided.
    handover_request: Option<PositiveHandoverAuthorisationRequest>,
    /// Message 5: what the holder offers; `None` once that is decided.
    handover_offer: Option<PositiveHandoverAuthorisationGranted>,
    /// How many messages 2 have arrived: an answer raises it.
    pub authorisations: u64,
    /// How many messages 14000 have arrived.
    pub transfers: u64,
    /// When anything was last received from it, on the session's clock.
    pub last_received: Duration,
    /// The parts of its plan that it has sent.
    pub download: Download,
    alerts: Alerts,
}

/// Where a vehicle is, by message 4000.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Position {
    /// Degrees north, WGS-84.
    pub latitude_deg: f64,
    /// Degrees east, WGS-84.
    pub longitude_deg: f64,
    /// Metres above the datum of `altitude_type`.
    pub altitude_m: f64,
    /// 3: ellipsoid; 1: mean sea level.
    pub altitude_type: AltitudeType,
}

/// The effect of a message.
#[derive(Debug)]
pub(crate) enum Change {
    /// It is the latest of its type.
    Taken,
    /// An alert is complete.
    Alert(Alert),
    /// Older than the known one, or the same.
    Late,
    /// Another CUCS has begun to request this.
    HandoverRequested(Id, LoiBitmap),
    /// The holder has begun to offer this.
    HandoverOffered(LoiBitmap),
    /// Not a message that is kept.
    Unused,
}

impl Vehicle {
    pub(crate) fn new(id: Id, now: Duration) -> Vehicle {
        Vehicle {
            id,
            last_received: now,
            ..Vehicle::default()
        }
    }

    pub(crate) fn take(&mut self, message: &Message) -> Change {
        macro_rules! latest {
            ($slot:ident, $new:expr) => {{
                let before = self.$slot.as_ref().and_then(|old| old.time_stamp);
                if is_late(before, $new.time_stamp) {
                    return Change::Late;
                }
                self.$slot = Some($new.clone());
                Change::Taken
            }};
        }
        match message {
            Message::VsmAuthorisationResponse(new) => {
                let change = latest!(authorisation, new);
                self.authorisations += 1;
                self.forget_decided();
                change
            }
            Message::VehicleId(new) => latest!(identity, new),
            Message::VehicleOperatingModeReport(new) => latest!(mode_report, new),
            Message::VehicleOperatingStates(new) => latest!(states, new),
            Message::InertialStates(new) => latest!(inertial, new),
            Message::FromToNextWaypointStates(new) => latest!(waypoints, new),
            Message::MissionUploadDownloadStatus(new) => {
                let change = latest!(transfer, new);
                self.transfers += 1;
                change
            }
            Message::EoIrLaserOperatingState(new) => {
                let bits = new.station_number_1_16.unwrap_or(0);
                if !bits.is_power_of_two() {
                    return Change::Unused;
                }
                let number = bits.trailing_zeros() as u8 + 1;
                let before = self.payloads.get(&number).and_then(|old| old.time_stamp);
                if is_late(before, new.time_stamp) {
                    return Change::Late;
                }
                self.payloads.insert(number, new.clone());
                Change::Taken
            }
            Message::PositiveHandoverAuthorisationRequest(new) => {
                let before = self.handover_request();
                let change = latest!(handover_request, new);
                match self.handover_request() {
                    Some((by, loi)) if before != Some((by, loi)) => {
                        Change::HandoverRequested(by, loi)
                    }
                    _ => change,
                }
            }
            Message::PositiveHandoverAuthorisationGranted(new) => {
                let before = self.handover_offer();
                let change = latest!(handover_offer, new);
                self.forget_decided();
                match self.handover_offer() {
                    Some(loi) if before != Some(loi) => Change::HandoverOffered(loi),
                    _ => change,
                }
            }
            Message::HandoverStatusReport(new) => {
                let over = matches!(
                    new.status,
                    Some(HandoverStatus::Successful | HandoverStatus::Failed)
                );
                let by = self.handover_request().map(|(by, _)| by);
                // The report may be about a handover between two other stations.
                if over && by.is_some() && by == new.cucs_id_acquiring_control {
                    self.handover_request = None;
                }
                Change::Taken
            }
            Message::SubsystemStatusAlert(new) => match self.alerts.take(new) {
                Taken::Whole(alert) => Change::Alert(alert),
                Taken::Part => Change::Taken,
                Taken::Duplicate => Change::Late,
            },
            other => {
                if self.download.take(other) {
                    Change::Taken
                } else {
                    Change::Unused
                }
            }
        }
    }

    /// LOI Granted: everything that this CUCS holds.
    #[must_use]
    pub fn granted(&self) -> LoiBitmap {
        self.rights(|response| response.loi_granted)
    }

    /// Which CUCS requests what this one holds (4), and which levels.
    #[must_use]
    pub fn handover_request(&self) -> Option<(Id, LoiBitmap)> {
        let handover_request = self.handover_request.as_ref()?;
        let levels = handover_request
            .requested_handover_loi
            .filter(|loi| !loi.is_empty())?;
        Some((handover_request.requesting_cucs_id?, levels))
    }

    /// What the holder offers to this CUCS (5).
    #[must_use]
    pub fn handover_offer(&self) -> Option<LoiBitmap> {
        let handover_offer = self.handover_offer.as_ref()?;
        handover_offer.loi_authorized.filter(|loi| !loi.is_empty())
    }

    /// Drops an offer of levels that are now held, and a request for levels that are no longer held.
    fn forget_decided(&mut self) {
        let held = self.granted();
        if self.handover_offer().is_some_and(|loi| held.contains(loi)) {
            self.handover_offer = None;
        }
        if self
            .handover_request()
            .is_some_and(|(_, loi)| !held.intersects(loi))
        {
            self.handover_request = None;
        }
    }

    /// LOI Authorized: what this CUCS may have.
    #[must_use]
    pub fn authorised(&self) -> LoiBitmap {
        self.rights(|response| response.loi_authorized)
    }

    fn rights(&self, of: fn(&VsmAuthorisationResponse) -> Option<LoiBitmap>) -> LoiBitmap {
        let response = self.authorisation.as_ref();
        response.and_then(of).unwrap_or(LoiBitmap::NONE)
    }

    /// The mode that it reports (3001).
    #[must_use]
    pub fn mode(&self) -> Option<FlightPathControlMode> {
        self.mode_report.as_ref()?.select_flight_path_control_mode
    }

    /// UA State (3002).
    #[must_use]
    pub fn ua_state(&self) -> Option<UaState> {
        self.states.as_ref()?.ua_state
    }

    /// Whether it is on the ground: UA State 1 to 4. `None` before it is known.
    #[must_use]
    pub fn landed(&self) -> Option<bool> {
        match self.ua_state()?.raw() {
            0 => None,
            state => Some(state <= UaState::LaunchAbort.raw()),
        }
    }

    /// Where it is (4000); `None` without a fix.
    #[must_use]
    pub fn position(&self) -> Option<Position> {
        let states = self.inertial.as_ref()?;
        Some(Position {
            latitude_deg: states.latitude?.degrees(),
            longitude_deg: states.longitude?.degrees(),
            altitude_m: states.altitude?.si(),
            altitude_type: states.altitude_type?,
        })
    }

    /// The state of a payload station, and where it points (21101).
    #[must_use]
    pub fn payload(&self, station: u8) -> Option<&EoIrLaserOperatingState> {
        self.payloads.get(&station)
    }

    /// The centre of a payload station's image on the ground (21101); `None` where the vehicle reports none.
    #[must_use]
    pub fn image_center(&self, station: u8) -> Option<Position> {
        let state = self.payload(station)?;
        // Image Position 1: all three values are valid.
        (state.image_position == Some(1)).then_some(())?;
        Some(Position {
            latitude_deg: state.latitude_of_image_centre?.degrees(),
            longitude_deg: state.longitude_of_image_centre?.degrees(),
            altitude_m: state.altitude?.si(),
            altitude_type: AltitudeType::Wgs84,
        })
    }

    /// Speed over ground, m/s (4000, U and V Speed).
    #[must_use]
    pub fn ground_speed_m_s(&self) -> Option<f64> {
        let states = self.inertial.as_ref()?;
        Some(states.u_speed?.si().hypot(states.v_speed?.si()))
    }

    /// The waypoint to which it flies (4001); `None` where there is none.
    #[must_use]
    pub fn to_waypoint(&self) -> Option<u16> {
        let states = self.waypoints.as_ref()?;
        states.to_waypoint_number.filter(|number| *number != 0)
    }

    /// The waypoint from which it comes (4001).
    #[must_use]
    pub fn from_waypoint(&self) -> Option<u16> {
        let states = self.waypoints.as_ref()?;
        states.from_waypoint_number.filter(|number| *number != 0)
    }

    /// The state of the latest mission transfer, and its progress in per cent.
    #[must_use]
    pub fn transfer_status(&self) -> Option<(MissionTransferStatus, u8)> {
        let transfer = self.transfer.as_ref()?;
        Some((transfer.status?, transfer.percent_complete.unwrap_or(0)))
    }

    /// Its alerts, oldest first; the latest few hundred are kept.
    pub fn alerts(&self) -> impl DoubleEndedIterator<Item = &Alert> {
        self.alerts.iter()
    }

    /// The [`Alert::index`] that the next alert will have.
    #[must_use]
    pub fn next_alert(&self) -> u64 {
        self.alerts.next_index()
    }

    /// The alerts from this [`Alert::index`] on.
    pub fn alerts_from(&self, index: u64) -> impl Iterator<Item = &Alert> {
        self.alerts.iter().filter(move |alert| alert.index >= index)
    }
}

/// Whether it is older than the known one, or the same. A stamp far in the past comes from a sender whose clock was
/// set, or whose counter rolled over: treating it as late would ignore that vehicle from then on.
fn is_late(before: Option<TimeStamp>, new: Option<TimeStamp>) -> bool {
    match (before, new) {
        (Some(before), Some(new)) => new <= before && before.0 - new.0 <= REORDERING_MS,
        _ => false,
    }
}

/// A message that is at most this much older than the latest counts as late, ms.
const REORDERING_MS: u64 = 10_000;
