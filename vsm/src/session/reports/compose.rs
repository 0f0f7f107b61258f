//! Composes the reports from the vehicle's state: 3, 3001, 3002, 4000, 4001 and 16002, which are pushed; and detailed
//! status, only on request by 17001 or 17002: 3000, 3004 to 3007, 3009 to 3011, 3016, 12001, 12101, 16001, 18300, 18500,
//! 28001 to 32400, 50025.
//!
//! The MAVLink messages for the latter are requested of the vehicle only when needed: a radio has no room for them all the
//! time.

use mapping::data_link::DataLink;
use mapping::equipment_reports as equipment;
use mapping::mode::Px4Mode;
use mapping::parameter::Parameters;
use mapping::payload::report::{self as payload, Station};
use mapping::{report, status};
use stanag_msgs::enums::CommandedEngineState;
use stanag_msgs::messages::{Heartbeat, UaStickStatus};
use stanag_msgs::{Message, TimeStamp};

use super::data_link;
use super::health::detail_reference;
use crate::session::context::{Context, FlightView, MissionView};
use crate::session::effects::Effects;
use crate::session::mission::record::UploadedMission;
use crate::session::payload::{PayloadView, ground};

/// What 17001 and 17002 can request, and the reports that are made on request only.
pub(super) const REPORTS: &[u16] = &[3, 3001, 3002, 4000, 4001, 16002];
pub(super) const DETAILS: &[u16] = &[
    3000, 3004, 3005, 3006, 3007, 3009, 3010, 3011, 3016, 12001, 12101, 16001, 18300, 18500, 21000,
    21100, 21101, 28001, 32000, 32003, 32005, 32006, 32200, 32302, 32400, 50025,
];
/// Of these, those about payload stations.
pub(super) const PAYLOAD: &[u16] = &[21000, 21100, 21101];

/// What reports are made of.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sources<'a> {
    pub(super) common: Context<'a>,
    pub(super) mission: MissionView<'a>,
    pub(super) flight: FlightView<'a>,
    pub(super) payload: PayloadView<'a>,
    pub(super) link: DataLink,
    pub(super) parameters: &'a Parameters,
}

/// The messages of a report: several where each is about an engine or a subsystem.
pub(super) fn all(
    sources: &Sources<'_>,
    station: usize,
    message: u16,
    effects: &mut Effects<'_>,
) -> Vec<Message> {
    if DETAILS.contains(&message) {
        request_streams(message, effects);
        return details(sources, station, message, effects);
    }
    let stamp = stamp(sources, station, message, effects);
    one(sources, message, stamp).into_iter().collect()
}

/// The stamp of a report to one station: when it was valid.
pub(super) fn stamp(
    sources: &Sources<'_>,
    station: usize,
    message: u16,
    effects: &mut Effects<'_>,
) -> TimeStamp {
    let vehicle = sources.common.vehicle;
    let at = vehicle
        .measured
        .of(message, sources.common.mono(), &vehicle.telemetry);
    effects.stamp_measured(station, message, at)
}

/// A report that is pushed.
pub(super) fn one(sources: &Sources<'_>, message: u16, stamp: TimeStamp) -> Option<Message> {
    let context = &sources.common;
    let (vehicle, live) = (&context.vehicle.telemetry, context.vehicle.live());
    // While another route takes its place aboard, the current item is one of that.
    let is_aboard = |uploaded: &&UploadedMission| {
        let reported = vehicle.mission;
        reported.is_none_or(|mission| uploaded.is_aboard(mission.mission_id))
    };
    let uploaded = sources.mission.uploaded.filter(is_aboard);
    let compiled = uploaded.map(|uploaded| &uploaded.compiled);
    match message {
        3 => Some(context.vehicle_id(&sources.mission, stamp).into()),
        3001 if live => {
            report::operating_mode(vehicle, stamp).map(Message::VehicleOperatingModeReport)
        }
        3001 => Some(report::no_operating_mode(stamp).into()),
        3002 => {
            let commanded = &sources.flight.commanded;
            Some(report::operating_states(vehicle, commanded, compiled, !live, stamp).into())
        }
        // The last report of a silent vehicle is not its present state: do not repeat it.
        4000 if live => report::inertial_states(vehicle, stamp).map(Message::InertialStates),
        4001 if live => {
            // Only once it has left the route, for AUTO.LOITER or an orbit: until then it still flies to a waypoint.
            if vehicle.mode != Some(Px4Mode::MISSION)
                && let Some(states) =
                    report::loiter_place_states(vehicle, &sources.flight.commanded, stamp)
            {
                return Some(states.into());
            }
            let along = compiled.map(|compiled| sources.mission.progress.along(compiled, vehicle));
            let along = along.unwrap_or_default();
            Some(report::waypoint_states(vehicle, compiled, along, stamp).into())
        }
        16002 => Some(Message::Heartbeat(Heartbeat {
            time_stamp: Some(stamp),
        })),
        _ => None,
    }
}

/// Requests the messages that a report needs in addition to those always streamed.
pub(super) fn request_streams(report: u16, effects: &mut Effects<'_>) {
    match report {
        3009 => effects.vehicle.request_rate(WIND_COV, 1.0),
        3010 => effects.vehicle.request_rate(HIGHRES_IMU, 5.0),
        3007 => {
            effects.vehicle.request_rate(ESC_STATUS, 1.0);
            effects.vehicle.request_rate(EFI_STATUS, 1.0);
        }
        16001 => effects.vehicle.request_rate(ESTIMATOR_STATUS, 1.0),
        12001 => effects.vehicle.request_rate(GENERATOR_STATUS, 1.0),
        18300 => {
            effects.vehicle.request_rate(WIND_COV, 1.0);
            effects.vehicle.request_rate(SCALED_PRESSURE, 1.0);
        }
        _ => {}
    }
}

/// Detailed status; for a silent vehicle only what the VSM itself knows.
fn details(
    sources: &Sources<'_>,
    station: usize,
    report: u16,
    effects: &mut Effects<'_>,
) -> Vec<Message> {
    let Sources {
        common: context,
        flight,
        ..
    } = sources;
    let (vehicle, live) = (&context.vehicle.telemetry, context.vehicle.live());
    match report {
        3000 => vec![status::configuration(vehicle, effects.stamp()).into()],
        3004 => {
            let stamp = effects.stamp();
            vec![
                status::loiter_configuration(vehicle, flight.loiter, &flight.commanded, stamp)
                    .into(),
            ]
        }
        3005 => {
            let state = context.termination.reported;
            let report = state.map(|state| status::termination(state, effects.stamp()).into());
            report.into_iter().collect()
        }
        3006 => vec![status::lights(effects.stamp()).into()],
        3007 if live => {
            // A command that the vehicle refused is not reported as commanded to the engines.
            let followed = flight
                .engine_command
                .filter(|command| vehicle.armed == Some(*command != CommandedEngineState::Stop));
            (1..=status::engines(vehicle))
                .map(|number| status::engine(vehicle, number, followed, effects.stamp()).into())
                .collect()
        }
        3009 if live => {
            let place = vehicle.position;
            let ground_m = context.bounds.terrain.as_ref().zip(place);
            let ground_m = ground_m
                .and_then(|(terrain, place)| terrain.height_m(place.latitude, place.longitude));
            let (altimeter, agl) = (flight.altimeter, (context.bounds.agl, ground_m));
            let stamp = stamp(sources, station, report, effects);
            vec![status::air_and_ground(vehicle, altimeter, agl, stamp).into()]
        }
        3010 if live => {
            let stamp = stamp(sources, station, report, effects);
            vec![status::body_sensed(vehicle, stamp).into()]
        }
        3011 => {
            // Nothing is flown by sticks that have stopped, or that the vehicle ignores.
            let now = context.mono();
            let ignored = sources.parameters.ignores_sticks().is_some();
            let arriving = flight.sticks.filter(|(_, until)| now < *until && !ignored);
            let report = arriving.map(|(sticks, _)| sticks_status(sticks, effects.stamp()));
            report.into_iter().collect()
        }
        21000 | 21100 | 21101 | 50025 => payload_reports(sources, station, report, effects),
        3016 => {
            let route = sources
                .mission
                .uploaded
                .map(|one| one.mission_name.as_str());
            let agl = context.bounds.agl;
            let stamp = stamp(sources, station, report, effects);
            equipment::relative_location(vehicle, route, agl, stamp)
                .map(Message::from)
                .into_iter()
                .collect()
        }
        12001 if live => equipment::electrical(vehicle, || effects.stamp())
            .map(Message::from)
            .collect(),
        18300 if live => {
            let measured = stamp(sources, station, report, effects);
            equipment::weather(vehicle, measured, effects.stamp())
                .map(Message::from)
                .into_iter()
                .collect()
        }
        18500 if live => equipment::gps_status(vehicle, effects.stamp())
            .map(Message::from)
            .into_iter()
            .collect(),
        28001..=32400 => {
            data_link::report(context, &sources.flight, &sources.link, report, effects)
                .into_iter()
                .collect()
        }
        12101 if live => vec![status::battery(vehicle, effects.stamp()).into()],
        16001 => status::subsystems(vehicle, sources.parameters, live)
            .into_iter()
            .map(|state| {
                let reference = detail_reference(effects.alerts, state.0);
                status::subsystem_report(state, reference, effects.stamp()).into()
            })
            .collect(),
        _ => Vec::new(),
    }
}

/// 21000, 21100 or 21101 of every payload station, or 50025 of every video stream.
fn payload_reports(
    sources: &Sources<'_>,
    receiver: usize,
    message: u16,
    effects: &mut Effects<'_>,
) -> Vec<Message> {
    let context = &sources.common;
    let (vehicle, live) = (context.vehicle, context.vehicle.live());
    let all = context.equipment();
    let ground = ground(context.bounds, &context.vehicle.telemetry);
    let mut reports = Vec::new();
    for equipment in all.iter().filter(|one| one.bit() != 0) {
        let station = Station::of(*equipment, &vehicle.payloads, context.mono());
        match message {
            21000 => {
                let stamp = effects.stamp();
                let report = payload::configuration(&station, &all, context.vsm, stamp);
                reports.push(report.into());
            }
            50025 => {
                let camera = vehicle.payloads.camera(equipment.camera);
                for (number, stream) in camera.into_iter().flat_map(|camera| &camera.streams) {
                    let of = (*number, stream);
                    let report = payload::video_stream(equipment.bit(), of, effects.stamp());
                    reports.push(report.into());
                }
            }
            21100 => {
                let report = payload::sensor(&station, context.vsm, effects.stamp());
                reports.push(report.into());
            }
            _ if live => {
                let mode = sources.payload.mode(equipment.number);
                let telemetry = &vehicle.telemetry;
                let ground = ground.as_ref();
                let image = ground.and_then(|ground| station.image_centre(telemetry, ground));
                let stamp = stamp(sources, receiver, message, effects);
                let report = payload::operating(&station, telemetry, image, mode, stamp);
                reports.push(report.into());
            }
            _ => {}
        }
    }
    reports
}

/// The payload stations that a report is about, as bits; `None` of a report about none.
pub(super) fn station_bits(report: &Message) -> Option<u16> {
    match report {
        Message::PayloadConfiguration(report) => report.station_number_1_16.map(|bits| bits.raw()),
        Message::VideoStreamReport(report) => report.station_number_1_16.map(|bits| bits.raw()),
        Message::EoIrConfigurationState(report) => report.station_number_1_16,
        Message::EoIrLaserOperatingState(report) => report.station_number_1_16,
        _ => None,
    }
}

/// 3011: the sticks that arrive.
fn sticks_status(sticks: &stanag_msgs::messages::UaStickCommand, stamp: TimeStamp) -> Message {
    Message::from(UaStickStatus {
        time_stamp: Some(stamp),
        lateral_stick: sticks.lateral_stick,
        longitudinal_stick: sticks.longitudinal_stick,
        rotational_stick_rudder: sticks.rotational_stick_rudder,
        throttle_stick_engine_1: sticks.throttle_stick_engine_1,
        ..UaStickStatus::default()
    })
}

const WIND_COV: u32 = 231;
const HIGHRES_IMU: u32 = 105;
const ESTIMATOR_STATUS: u32 = 230;
const ESC_STATUS: u32 = 291;
const EFI_STATUS: u32 = 225;
const GENERATOR_STATUS: u32 = 373;
const SCALED_PRESSURE: u32 = 29;
