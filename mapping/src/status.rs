//! Status on request: messages 3000, 3004 to 3007, 3009, 3010, 12101 and 16001.
//!
//! None is pushed: a CUCS asks by 17001 or 17002. A field that the vehicle has not told is absent, never zero.
//! Angles and velocities over ground are true, not magnetic; 3010 is in the body's axes.

use mavlink_link::dialect::{MavState, MavType};
use stanag_msgs::enums::{
    AlertPriority, AltitudeType, CommandedEngineState, EngineStatus, FtMode, FtState, SpeedType,
    SubsystemId,
};
use stanag_msgs::messages::{
    AirAndGroundRelativeStates, BatteryReport, BodyRelativeSensedStates, EngineOperatingStates,
    FlightTerminationModeReport, LoiterConfiguration, LoiterConfigurationReport,
    SubsystemStatusReport, VehicleConfiguration, VehicleLightsState,
};
use stanag_msgs::{Scaled, TimeStamp};

use crate::altitude::{Agl, Altimeter};
use crate::report::Commanded;
use crate::telemetry::Telemetry;

/// How many motors a vehicle of this type has; 0 where the type does not say.
#[must_use]
pub fn engines(vehicle: &Telemetry) -> u8 {
    match vehicle.vehicle_type {
        Some(MavType::MAV_TYPE_FIXED_WING | MavType::MAV_TYPE_HELICOPTER) => 1,
        Some(MavType::MAV_TYPE_COAXIAL) => 2,
        Some(MavType::MAV_TYPE_TRICOPTER) => 3,
        Some(MavType::MAV_TYPE_QUADROTOR) => 4,
        Some(MavType::MAV_TYPE_HEXAROTOR) => 6,
        Some(MavType::MAV_TYPE_OCTOROTOR) => 8,
        Some(MavType::MAV_TYPE_DECAROTOR) => 10,
        Some(MavType::MAV_TYPE_DODECAROTOR) => 12,
        _ => 0,
    }
}

/// 3000: what is known of the airframe. It burns no fuel: a capacity below 0 is "not applicable".
#[must_use]
pub fn configuration(vehicle: &Telemetry, stamp: TimeStamp) -> VehicleConfiguration {
    VehicleConfiguration {
        time_stamp: Some(stamp),
        propulsion_fuel_capacity: Some(-1.0),
        number_of_engines: Some(engines(vehicle)).filter(|engines| *engines > 0),
        ..VehicleConfiguration::default()
    }
}

/// 3004: the loiter that 2017 has configured, at the commanded altitude and speed.
#[must_use]
pub fn loiter_configuration(
    vehicle: &Telemetry,
    loiter: &LoiterConfiguration,
    commanded: &Commanded,
    stamp: TimeStamp,
) -> LoiterConfigurationReport {
    let (altitude_type, offset_m) = match vehicle.geoid_m {
        Some(geoid_m) => (AltitudeType::Wgs84, geoid_m),
        None => (AltitudeType::Barometric, 0.0),
    };
    let altitude = commanded
        .altitude_amsl_m
        .and_then(|m| Scaled::from_si(m + offset_m).ok());
    let speed = commanded.speed_m_s.and_then(|v| Scaled::from_si(v).ok());
    LoiterConfigurationReport {
        time_stamp: Some(stamp),
        loiter_type: loiter.loiter_type,
        loiter_radius: loiter.loiter_radius,
        loiter_length: loiter.loiter_length,
        loiter_length_units: loiter.loiter_length_units,
        loiter_bearing: loiter.loiter_bearing,
        loiter_direction: loiter.loiter_direction,
        loiter_altitude: altitude,
        altitude_type: altitude.is_some().then_some(altitude_type),
        loiter_speed: speed,
        speed_type: speed.and(commanded.speed_type.or(Some(SpeedType::Ground))),
        flying_behaviour: loiter.flying_behaviour,
        loiter_duration: loiter.loiter_duration,
        loiter_duration_units: loiter.loiter_duration_units,
    }
}

/// 3005: nothing is armed for termination as long as no 2005 has done so.
#[must_use]
pub fn termination(stamp: TimeStamp) -> FlightTerminationModeReport {
    FlightTerminationModeReport {
        time_stamp: Some(stamp),
        reported_flight_termination_state: Some(FtState::Reset),
        reported_flight_termination_mode: Some(FtMode::NotSpecified),
    }
}

/// 3006: PX4 tells nothing of its lights, and neither does this.
#[must_use]
pub fn lights(stamp: TimeStamp) -> VehicleLightsState {
    VehicleLightsState {
        time_stamp: Some(stamp),
        navigation_lights_state: None,
    }
}

/// 3007 of one motor, from 1: PX4 arms all of them together, and tells one throttle.
#[must_use]
pub fn engine(
    vehicle: &Telemetry,
    number: u8,
    commanded: Option<CommandedEngineState>,
    stamp: TimeStamp,
) -> EngineOperatingStates {
    let status = vehicle.armed.map(|armed| match armed {
        false => EngineStatus::Stopped,
        true => EngineStatus::Running,
    });
    let power = match vehicle.armed {
        Some(false) => Some(0.0),
        _ => vehicle.throttle.map(f64::from),
    };
    EngineOperatingStates {
        time_stamp: Some(stamp),
        engine_number: Some(number.into()),
        engine_status: status,
        reported_engine_command: commanded,
        engine_power_setting: power.and_then(|percent| Scaled::from_si(percent).ok()),
        ..EngineOperatingStates::default()
    }
}

/// 3009. `agl` says whether height above home may stand for height above ground.
#[must_use]
pub fn air_and_ground(
    vehicle: &Telemetry,
    altimeter: Altimeter,
    agl: Agl,
    stamp: TimeStamp,
) -> AirAndGroundRelativeStates {
    let amsl_m = vehicle
        .position
        .filter(|_| vehicle.gps_fix != Some(false))
        .map(|place| place.amsl_m);
    let altitude = |m: Option<f64>| m.and_then(|m| Scaled::from_si(m).ok());
    let velocity = |v: Option<f64>| v.and_then(|v| Scaled::from_si(v).ok());
    let ground = vehicle.velocity_ned;
    let wind = vehicle.sensed.wind_ne;
    // A multicopter without an air speed sensor tells 0 all the time.
    let airspeed = vehicle
        .airspeed
        .filter(|airspeed| !vehicle.hovers() || *airspeed > 0.0);
    AirAndGroundRelativeStates {
        time_stamp: Some(stamp),
        indicated_airspeed: airspeed.and_then(|v| Scaled::from_si(v).ok()),
        u_wind: velocity(wind.map(|[north, _]| north)),
        v_wind: velocity(wind.map(|[_, east]| east)),
        altimeter_setting: Scaled::from_si(altimeter.pascal()).ok(),
        barometric_altitude: altitude(amsl_m),
        barometric_altitude_rate: velocity(ground.map(|[_, _, down]| -down)),
        pressure_altitude: altitude(amsl_m.map(|m| altimeter.pressure_altitude(m))),
        agl_altitude: altitude(vehicle.above_home_m.filter(|_| agl == Agl::AboveHome)),
        wgs_84_altitude: altitude(amsl_m.zip(vehicle.geoid_m).map(|(m, geoid)| m + geoid)),
        u_ground: velocity(ground.map(|[north, ..]| north)),
        v_ground: velocity(ground.map(|[_, east, _]| east)),
        ..AirAndGroundRelativeStates::default()
    }
}

/// 3010, in the body's axes: specific force and rates.
#[must_use]
pub fn body_sensed(vehicle: &Telemetry, stamp: TimeStamp) -> BodyRelativeSensedStates {
    let force = vehicle.sensed.acceleration;
    let acceleration =
        |axis: usize| force.and_then(|force| Scaled::from_si(*force.get(axis)?).ok());
    let attitude = vehicle.attitude;
    BodyRelativeSensedStates {
        time_stamp: Some(stamp),
        x_body_accel: acceleration(0),
        y_body_accel: acceleration(1),
        z_body_accel: acceleration(2),
        roll_rate: attitude.and_then(|a| Scaled::from_si(a.roll_rate).ok()),
        pitch_rate: attitude.and_then(|a| Scaled::from_si(a.pitch_rate).ok()),
        yaw_rate: attitude.and_then(|a| Scaled::from_si(a.yaw_rate).ok()),
    }
}

/// 12101. No source gives its scales.
///
/// Here volts and amperes are in steps of 0.01, charge in steps of 0.0016 % as in 3002, temperature in steps of 0.5 K.
#[must_use]
pub fn battery(vehicle: &Telemetry, stamp: TimeStamp) -> BatteryReport {
    let battery = vehicle.sensed.battery;
    let steps = |value: Option<f64>, step: f64| {
        value
            .map(|value| (value / step).round())
            .filter(|steps| (0.0..=f64::from(u16::MAX)).contains(steps))
            .map(|steps| steps as u16)
    };
    BatteryReport {
        time_stamp: Some(stamp),
        bus_voltage: steps(battery.volts, 0.01),
        battery_current: battery
            .amperes
            .map(|amperes| (amperes * 100.0).round())
            .filter(|steps| steps.abs() <= f64::from(i16::MAX))
            .map(|steps| steps as i16),
        battery_charge_remaining: steps(vehicle.battery.map(f64::from), 0.0016),
        battery_temperature: steps(battery.kelvin, 0.5),
        ..BatteryReport::default()
    }
}

/// 16001, one a subsystem, by rising Subsystem ID. `live` is whether the vehicle is heard.
#[must_use]
pub fn subsystems(vehicle: &Telemetry, live: bool) -> Vec<(SubsystemId, AlertPriority)> {
    use AlertPriority as State;
    let comms = if live { State::Nominal } else { State::Failed };
    if !live {
        // What a silent vehicle said last is no state of now.
        let unknown = [
            SubsystemId::Engine,
            SubsystemId::PropulsionEnergy,
            SubsystemId::Navigation,
        ];
        let unknown = unknown.map(|subsystem| (subsystem, State::Cleared));
        return std::iter::once((SubsystemId::Comms, comms))
            .chain(unknown)
            .collect();
    }
    let sensed = &vehicle.sensed;
    let fails = |sensors| sensed.health.is_some_and(|health| health.fails(sensors));
    let engine = match vehicle.system_status {
        Some(MavState::MAV_STATE_EMERGENCY) => State::Emergency,
        Some(MavState::MAV_STATE_CRITICAL) => State::Warning,
        _ if fails(MOTORS) => State::Failed,
        Some(_) => State::Nominal,
        None => State::Cleared,
    };
    let energy = match vehicle.battery {
        _ if fails(BATTERY) => State::Failed,
        Some(percent) if percent <= 10 => State::Emergency,
        Some(percent) if percent <= 20 => State::Warning,
        Some(percent) if percent <= 30 => State::Caution,
        Some(_) => State::Nominal,
        None => State::Cleared,
    };
    let navigation = match (vehicle.gps_fix, sensed.estimator) {
        _ if fails(NAVIGATION) => State::Warning,
        (Some(false), _) => State::Warning,
        (_, Some(flags)) if flags & POSITION != POSITION => State::Warning,
        (_, Some(flags)) if flags & GLITCHES != 0 => State::Caution,
        (None, None) => State::Cleared,
        _ => State::Nominal,
    };
    vec![
        (SubsystemId::Engine, engine),
        (SubsystemId::Comms, comms),
        (SubsystemId::PropulsionEnergy, energy),
        (SubsystemId::Navigation, navigation),
    ]
}

/// 16001 of one subsystem.
#[must_use]
pub fn subsystem_report(
    (subsystem, state): (SubsystemId, AlertPriority),
    stamp: TimeStamp,
) -> SubsystemStatusReport {
    SubsystemStatusReport {
        time_stamp: Some(stamp),
        subsystem_id: Some(subsystem),
        subsystem_state: Some(state),
        subsystem_state_report_reference: Some(NO_MORE_INFO),
        ..SubsystemStatusReport::default()
    }
}

/// 1101.06: there is no more to be asked for.
const NO_MORE_INFO: i32 = -1;
/// MAV_SYS_STATUS_SENSOR: gyroscopes, accelerometers, magnetometer, barometer, GPS, attitude and position control.
const NAVIGATION: u32 = 0x1 | 0x2 | 0x4 | 0x8 | 0x20;
/// MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS.
const MOTORS: u32 = 0x8000;
/// MAV_SYS_STATUS_SENSOR_BATTERY.
const BATTERY: u32 = 0x200_0000;
/// ESTIMATOR_STATUS_FLAGS: attitude, both velocities, absolute horizontal position.
const POSITION: u16 = 0x1 | 0x2 | 0x4 | 0x10;
/// ESTIMATOR_STATUS_FLAGS: GPS glitch, accelerometer error.
const GLITCHES: u16 = 0x400 | 0x800;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensed::Health;

    #[test]
    fn a_silent_vehicle_has_no_state_and_a_failed_link() {
        let vehicle = Telemetry {
            battery: Some(90),
            ..Telemetry::default()
        };
        let states = subsystems(&vehicle, false);
        assert_eq!(states[0], (SubsystemId::Comms, AlertPriority::Failed));
        assert!(
            states[1..]
                .iter()
                .all(|(_, state)| *state == AlertPriority::Cleared)
        );
    }

    #[test]
    fn a_sick_sensor_a_low_battery_and_a_lost_position_each_show() {
        let mut vehicle = Telemetry {
            battery: Some(15),
            gps_fix: Some(true),
            ..Telemetry::default()
        };
        vehicle.sensed.estimator = Some(895);
        let of = |vehicle: &Telemetry, wanted| {
            let states = subsystems(vehicle, true);
            states.iter().find(|(id, _)| *id == wanted).unwrap().1
        };
        assert_eq!(
            of(&vehicle, SubsystemId::PropulsionEnergy),
            AlertPriority::Warning
        );
        assert_eq!(
            of(&vehicle, SubsystemId::Navigation),
            AlertPriority::Nominal
        );
        vehicle.sensed.estimator = Some(1);
        assert_eq!(
            of(&vehicle, SubsystemId::Navigation),
            AlertPriority::Warning
        );
        vehicle.sensed.estimator = Some(895);
        vehicle.sensed.health = Some(Health {
            enabled: 0x20,
            healthy: 0,
        });
        assert_eq!(
            of(&vehicle, SubsystemId::Navigation),
            AlertPriority::Warning
        );
    }
}
