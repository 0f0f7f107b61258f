//! Reports of the aircraft: on request, by schedule, on change.

use std::time::Duration;

use mapping::report;
use mavlink_link::dialect::MavType;
use stanag_msgs::messages::{
    GenericInformationRequestMessage, Heartbeat, ScheduleMessageUpdateCommand,
    SoftwareVersionReport, VehicleId, VsmAuthorisationResponse,
};
use stanag_msgs::{Message, Text, table};

use super::aircraft::Aircraft;
use super::desk::Desk;
use super::detail::DETAILS;
use super::station::Period;

impl Aircraft {
    /// 17001.
    ///
    /// # Errors
    /// The reason, for the operator.
    pub(super) fn schedule(
        &mut self,
        desk: &mut Desk<'_>,
        station: usize,
        command: &ScheduleMessageUpdateCommand,
    ) -> Result<(), String> {
        let message = command
            .requested_message_type
            .ok_or("Requested Message Type is missing")?;
        let hertz = command.frequency.ok_or("Frequency is missing")?;
        if !(REPORTS.contains(&message) || DETAILS.contains(&message)) {
            return Err(format!("message {message} is no report of this VSM"));
        }
        if hertz > MAX_HERTZ {
            return Err(format!(
                "Frequency {hertz} Hz, expected 1 to {MAX_HERTZ}, or 0 for no longer"
            ));
        }
        let period = match hertz {
            0 => Period::Never,
            hertz => Period::Every(Duration::from_secs(1) / u32::from(hertz)),
        };
        let id = self.id();
        if let Some(of) = desk.stations.get_mut(station) {
            of.schedule.insert((id, message), period);
        }
        self.push.reset(station);
        Ok(())
    }

    /// Forgets what a station has scheduled of this vehicle: it listens no longer, and begins anew when it does again.
    pub(super) fn forget_schedule(&mut self, desk: &mut Desk<'_>, station: usize) {
        self.push.reset(station);
        if let Some(of) = desk.stations.get_mut(station) {
            of.schedule
                .retain(|(vehicle, _), _| *vehicle != self.config.id);
        }
    }

    /// 17002: a report, at once, of all its fields or those asked for.
    ///
    /// # Errors
    /// The reason, for the operator.
    pub(super) fn report_once(
        &mut self,
        desk: &mut Desk<'_>,
        station: usize,
        request: &GenericInformationRequestMessage,
    ) -> Result<(), String> {
        let message = request.message_type.ok_or("Message Type is missing")?;
        let fields = request.requested_field_presence_vector.map(|all| all.get());
        if message == VsmAuthorisationResponse::ID {
            self.answer_authorisation(desk, station, None);
            return Ok(());
        }
        if message == SoftwareVersionReport::ID {
            self.request_software(desk, station, fields);
            return Ok(());
        }
        if !(REPORTS.contains(&message) || DETAILS.contains(&message)) {
            return Err(format!("message {message} is no report of this VSM"));
        }
        let reports = self.compose_all(desk, message);
        for report in &reports {
            match fields {
                // An empty vector asks for nothing in particular.
                None | Some(0) => desk.send(station, self.id(), report),
                Some(fields) => {
                    let report = table::select(report, fields);
                    desk.send(station, self.id(), &report);
                }
            }
        }
        if reports.is_empty() {
            return Err(format!("of {message} the vehicle has told nothing yet"));
        }
        Ok(())
    }

    /// The messages of a report: several where each is about an engine or a subsystem.
    fn compose_all(&mut self, desk: &mut Desk<'_>, message: u16) -> Vec<Message> {
        if DETAILS.contains(&message) {
            self.want_sources_of(message);
            return self.details(desk, message);
        }
        self.compose(desk, message).into_iter().collect()
    }

    pub(super) fn compose(&mut self, desk: &mut Desk<'_>, message: u16) -> Option<Message> {
        let stamp = desk.stamp();
        let (vehicle, live) = (&self.mav.telemetry, self.mav.live());
        let compiled = self.aboard.as_ref().map(|aboard| &aboard.compiled);
        match message {
            3 => Some(Message::VehicleId(self.vehicle_id(desk))),
            3001 if live => {
                report::operating_mode(vehicle, stamp).map(Message::VehicleOperatingModeReport)
            }
            3001 => Some(Message::VehicleOperatingModeReport(
                report::no_operating_mode(stamp),
            )),
            3002 => {
                let states =
                    report::operating_states(vehicle, &self.commanded, compiled, !live, stamp);
                Some(Message::VehicleOperatingStates(states))
            }
            // What a silent vehicle said last is no state of now: it is not repeated.
            4000 if live => report::inertial_states(vehicle, stamp).map(Message::InertialStates),
            4001 if live => {
                let along = compiled.map(|compiled| self.route_progress.along(compiled, vehicle));
                let along = along.unwrap_or_default();
                Some(Message::FromToNextWaypointStates(report::waypoint_states(
                    vehicle, compiled, along, stamp,
                )))
            }
            16002 => Some(Message::Heartbeat(Heartbeat {
                time_stamp: Some(stamp),
            })),
            _ => None,
        }
    }
    /// 3001 and 3002 on change, beside their period.
    pub(super) fn report_on_change(&mut self, desk: &mut Desk<'_>) {
        for message in [3001, 3002] {
            let Some(report) = self.compose(desk, message) else {
                continue;
            };
            for station in 0..desk.stations.len() {
                if desk.listens(&self.authority, station) {
                    desk.publish(station, self.id(), &report);
                }
            }
        }
    }

    pub(super) fn push_due(&mut self, desk: &mut Desk<'_>) {
        for index in 0..desk.stations.len() {
            if !desk.listens(&self.authority, index) {
                continue;
            }
            while let Some(message) = desk.stations.get(index).and_then(|station| {
                self.push
                    .next_due(desk.now.mono, index, station, self.config.id)
            }) {
                if !DETAILS.contains(&message) {
                    if let Some(report) = self.compose(desk, message) {
                        desk.publish(index, self.id(), &report);
                    }
                    continue;
                }
                for report in self.compose_all(desk, message) {
                    desk.publish(index, self.id(), &report);
                }
            }
        }
    }

    pub(super) fn vehicle_id(&self, desk: &mut Desk<'_>) -> VehicleId {
        VehicleId {
            time_stamp: Some(desk.stamp()),
            vsm_id: Some(desk.vsm),
            vehicle_id_update: Some(self.id()),
            vehicle_type: Some(self.vehicle_type()),
            vehicle_subtype: Some(0),
            owning_id: Some((self.id().0 >> 24) as u8),
            tail_number: Some(Text::new(&self.config.tail_number)),
            mission_id: self
                .aboard
                .as_ref()
                .map(|aboard| Text::new(&aboard.mission_name)),
            ..VehicleId::default()
        }
    }

    /// The custodian's list of vehicle types is not public: MAVLink's MAV_TYPE stands in, 0 before it is heard.
    pub(super) fn vehicle_type(&self) -> u16 {
        self.mav
            .telemetry
            .vehicle_type
            .map_or(0, |kind: MavType| kind as u16)
    }
}

/// What 17001 and 17002 can ask for.
const REPORTS: &[u16] = &[3, 3001, 3002, 4000, 4001, 16002];
/// The range that Edition 2 gives for 17001's Frequency.
const MAX_HERTZ: u16 = 100;
