//! Status on request: messages 3000, 3004 to 3007, 3009, 3010, 12101, 16001 and 50013.
//!
//! None is pushed: a CUCS requests them by 17001 or 17002. A field that the vehicle has not reported is absent, never zero.
//! Angles and velocities over ground are true, not magnetic; 3010 is in the body's axes.

use std::f64::consts::TAU;

use mavlink_link::dialect::MavType;
use stanag_msgs::enums::{
    AlertPriority, CommandedEngineState, EngineStatus, FlightPathControlMode, FtMode, FtState,
    LoiterType, SpeedType, SubsystemId,
};
use stanag_msgs::messages::{
    AirAndGroundRelativeStates, BatteryReport, BodyRelativeSensedStates, EngineOperatingStates,
    FlightTerminationModeReport, LoiterConfiguration, LoiterConfigurationReport,
    SoftwareVersionReport, SubsystemStatusReport, VehicleConfiguration, VehicleLightsState,
};
use stanag_msgs::{Scaled, Text, TimeStamp};

use crate::altitude::{Agl, Altimeter};
use crate::health;
use crate::mode::Px4Mode;
use crate::parameter::Parameters;
use crate::report::{Commanded, reference, scaled};
use crate::telemetry::{Software, Telemetry};

/// How many motors a vehicle of this type has; 0 where the type does not define it.
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

/// 3000: what is known about the airframe. It burns no fuel: a capacity below 0 means "not applicable".
#[must_use]
pub fn configuration(vehicle: &Telemetry, stamp: TimeStamp) -> VehicleConfiguration {
    VehicleConfiguration {
        time_stamp: Some(stamp),
        propulsion_fuel_capacity: Some(-1.0),
        number_of_engines: Some(engines(vehicle)).filter(|engines| *engines > 0),
        ..VehicleConfiguration::default()
    }
}

/// 3004: the loiter that 2017 has configured, as this vehicle flies it.
///
/// What is not flown is absent. Reported back, a duration would read as if the loiter ended by itself: PX4 ends none that a
/// mode has begun, and Flying Behaviour and Loiter Length Units are not used either.
#[must_use]
pub fn loiter_configuration(
    vehicle: &Telemetry,
    loiter: &LoiterConfiguration,
    commanded: &Commanded,
    stamp: TimeStamp,
) -> LoiterConfigurationReport {
    let (altitude_type, offset_m) = reference(vehicle);
    // Those of another mode end with it: a loiter begins at the altitude that the vehicle has, and at its own speed.
    let mode = vehicle.mode.map(Px4Mode::reported);
    let loiters = matches!(
        mode,
        Some(FlightPathControlMode::Loiter | FlightPathControlMode::Launch)
    );
    let altitude_m = commanded.altitude_amsl_m.filter(|_| loiters);
    let altitude = scaled(altitude_m.map(|m| m + offset_m));
    let speed = scaled(commanded.speed_m_s.filter(|_| loiters));
    // Only a figure eight has a length and an axis, and it alone turns to both sides.
    let eight = loiter.loiter_type == Some(LoiterType::Figure8);
    LoiterConfigurationReport {
        time_stamp: Some(stamp),
        loiter_type: loiter.loiter_type,
        loiter_radius: loiter.loiter_radius,
        loiter_length: loiter.loiter_length.filter(|_| eight),
        loiter_bearing: loiter.loiter_bearing.filter(|_| eight),
        loiter_direction: loiter.loiter_direction.filter(|_| !eight),
        loiter_altitude: altitude,
        altitude_type: altitude.and(Some(altitude_type)),
        loiter_speed: speed,
        speed_type: speed.and(commanded.speed_type.or(Some(SpeedType::Ground))),
        ..LoiterConfigurationReport::default()
    }
}

/// 3005: the state of the termination, which has no modes.
#[must_use]
pub fn termination(state: FtState, stamp: TimeStamp) -> FlightTerminationModeReport {
    FlightTerminationModeReport {
        time_stamp: Some(stamp),
        reported_flight_termination_state: Some(state),
        reported_flight_termination_mode: Some(FtMode::NotSpecified),
    }
}

/// 3006: PX4 reports nothing of its lights, so the field is absent.
#[must_use]
pub fn lights(stamp: TimeStamp) -> VehicleLightsState {
    VehicleLightsState {
        time_stamp: Some(stamp),
        navigation_lights_state: None,
    }
}

/// 3007 of one motor, from 1: PX4 arms all of them together, and reports one throttle.
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
    let motor = usize::from(number).checked_sub(1);
    let rpm = motor.and_then(|motor| *vehicle.equipment.rpm.get(motor)?);
    // With several motors the combustion engine may be any of them, or drive a generator.
    let combustion = (vehicle.equipment.combustion).filter(|_| engines(vehicle) == 1);
    let turning = combustion.and_then(|engine| engine.rpm);
    // A combustion engine runs while the vehicle is disarmed, too.
    let status = match turning {
        Some(rpm) if rpm > 0.0 => Some(EngineStatus::Running),
        Some(_) => Some(EngineStatus::Stopped),
        None => status,
    };
    let power = combustion.and_then(|engine| engine.throttle).or(power);
    let rpm = turning.or(rpm);
    EngineOperatingStates {
        time_stamp: Some(stamp),
        engine_number: Some(number.into()),
        engine_status: status,
        reported_engine_command: commanded,
        engine_power_setting: scaled(power),
        engine_speed_1: scaled(rpm.map(|rpm| rpm.abs() * TAU / 60.0)),
        ..EngineOperatingStates::default()
    }
}

/// Message 3009. `agl`: whether height above home stands for height above ground, or that of elevation files is known, with
/// `ground_m` above mean sea level below the vehicle.
#[must_use]
pub fn air_and_ground(
    vehicle: &Telemetry,
    altimeter: Altimeter,
    (agl, ground_m): (Agl, Option<f64>),
    stamp: TimeStamp,
) -> AirAndGroundRelativeStates {
    let amsl_m = vehicle.located().map(|place| place.amsl_m);
    let agl_m = match agl {
        Agl::AboveHome => vehicle.above_home_m,
        Agl::Terrain => amsl_m
            .zip(ground_m)
            .map(|(amsl_m, ground_m)| amsl_m - ground_m),
        Agl::Refuse => None,
    };
    let ground = vehicle.velocity_at_place();
    let wind = vehicle.sensed.wind_ne;
    // A multicopter without an air speed sensor always reports 0.
    let airspeed = vehicle
        .airspeed
        .filter(|airspeed| !vehicle.hovers() || *airspeed > 0.0);
    AirAndGroundRelativeStates {
        time_stamp: Some(stamp),
        indicated_airspeed: scaled(airspeed),
        u_wind: scaled(wind.map(|[north, _]| north)),
        v_wind: scaled(wind.map(|[_, east]| east)),
        altimeter_setting: Scaled::from_si(altimeter.pascal()).ok(),
        barometric_altitude: scaled(amsl_m),
        barometric_altitude_rate: scaled(ground.map(|[_, _, down]| -down)),
        pressure_altitude: scaled(amsl_m.map(|m| altimeter.pressure_altitude(m))),
        agl_altitude: scaled(agl_m),
        wgs_84_altitude: scaled(amsl_m.zip(vehicle.geoid_m).map(|(m, geoid)| m + geoid)),
        u_ground: scaled(ground.map(|[north, ..]| north)),
        v_ground: scaled(ground.map(|[_, east, _]| east)),
        ..AirAndGroundRelativeStates::default()
    }
}

/// 3010, in the body's axes: specific force and rates.
#[must_use]
pub fn body_sensed(vehicle: &Telemetry, stamp: TimeStamp) -> BodyRelativeSensedStates {
    let force = vehicle.sensed.acceleration;
    let attitude = vehicle.attitude;
    BodyRelativeSensedStates {
        time_stamp: Some(stamp),
        x_body_accel: scaled(force.map(|[x, _, _]| x)),
        y_body_accel: scaled(force.map(|[_, y, _]| y)),
        z_body_accel: scaled(force.map(|[_, _, z]| z)),
        roll_rate: scaled(attitude.map(|a| a.roll_rate)),
        pitch_rate: scaled(attitude.map(|a| a.pitch_rate)),
        yaw_rate: scaled(attitude.map(|a| a.yaw_rate)),
    }
}

/// 12101. No source defines its scales.
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

/// 50013. Values that the vehicle has not reported are absent.
#[must_use]
pub fn software(
    vsm_version: &str,
    vehicle: Option<&Software>,
    stamp: TimeStamp,
) -> SoftwareVersionReport {
    let hex = |number: u64| Text::new(&format!("{number:016x}"));
    SoftwareVersionReport {
        time_stamp: Some(stamp),
        vsm_version: Some(Text::new(vsm_version)),
        autopilot_version: vehicle.map(|reported| Text::new(&reported.version)),
        autopilot_source: vehicle
            .filter(|reported| reported.source != 0)
            .map(|reported| hex(reported.source)),
        board_version: vehicle.map(|reported| reported.board),
        hardware_id: vehicle
            .filter(|reported| reported.hardware != 0)
            .map(|reported| hex(reported.hardware)),
    }
}

/// 16001, one for each subsystem, by rising Subsystem ID, with its worst finding. `live`: the vehicle is received; if not,
/// only the state of the link is known.
#[must_use]
pub fn subsystems(
    vehicle: &Telemetry,
    parameters: &Parameters,
    live: bool,
) -> Vec<(SubsystemId, AlertPriority)> {
    use AlertPriority as State;
    let found = if live {
        health::findings(vehicle, parameters)
    } else {
        Vec::new()
    };
    let state = |subsystem: SubsystemId, reported: bool| {
        let here = found
            .iter()
            .filter(|finding| finding.subsystem == subsystem);
        let worst = here
            .map(|finding| finding.priority)
            .max_by_key(|state| state.raw());
        let state = match worst {
            Some(worst) => worst,
            None if live && reported => State::Nominal,
            None => State::Cleared,
        };
        (subsystem, state)
    };
    let comms = if live { State::Nominal } else { State::Failed };
    let navigation = vehicle.gps_fix.is_some() || vehicle.sensed.estimator.is_some();
    vec![
        state(SubsystemId::Engine, vehicle.system_status.is_some()),
        (SubsystemId::Comms, comms),
        state(SubsystemId::PropulsionEnergy, vehicle.battery.is_some()),
        state(SubsystemId::Navigation, navigation),
    ]
}

/// 16001 of one subsystem; `reference` is the number that a 15001 quotes to request more, -1 where there is none.
#[must_use]
pub fn subsystem_report(
    (subsystem, state): (SubsystemId, AlertPriority),
    reference: i32,
    stamp: TimeStamp,
) -> SubsystemStatusReport {
    SubsystemStatusReport {
        time_stamp: Some(stamp),
        subsystem_id: Some(subsystem),
        subsystem_state: Some(state),
        subsystem_state_report_reference: Some(reference),
        ..SubsystemStatusReport::default()
    }
}

#[cfg(test)]
mod tests {
    use stanag_msgs::Bam16;
    use stanag_msgs::enums::{
        FlyingBehaviour, LoiterDirection, LoiterDurationUnits, LoiterLengthUnits,
    };

    use super::*;

    #[test]
    fn a_loiter_is_reported_as_it_is_flown_and_what_is_ignored_is_absent() {
        let configured = |kind| LoiterConfiguration {
            loiter_type: Some(kind),
            loiter_radius: Scaled::from_si(60.0).ok(),
            loiter_length: Scaled::from_si(300.0).ok(),
            loiter_length_units: Some(LoiterLengthUnits::Distance),
            loiter_bearing: Some(Bam16::from_degrees(90.0)),
            loiter_direction: Some(LoiterDirection::CounterClockwise),
            flying_behaviour: Some(FlyingBehaviour::from_raw(1)),
            loiter_duration: Some(3),
            loiter_duration_units: Some(LoiterDurationUnits::Turns),
            ..LoiterConfiguration::default()
        };
        let commanded = Commanded {
            altitude_amsl_m: Some(530.0),
            speed_m_s: Some(4.0),
            speed_type: Some(SpeedType::Ground),
            ..Commanded::default()
        };
        let report = |mode, kind| {
            let vehicle = Telemetry {
                mode: Some(mode),
                ..Telemetry::default()
            };
            loiter_configuration(&vehicle, &configured(kind), &commanded, TimeStamp(1))
        };
        for kind in [LoiterType::Circular, LoiterType::Hover, LoiterType::Figure8] {
            let eight = kind == LoiterType::Figure8;
            let reported = report(Px4Mode::LOITER, kind);
            assert_eq!(reported.loiter_type, Some(kind));
            assert!(reported.loiter_radius.is_some(), "{kind:?}");
            assert_eq!(reported.loiter_length.is_some(), eight, "{kind:?}");
            assert_eq!(reported.loiter_bearing.is_some(), eight, "{kind:?}");
            assert_eq!(reported.loiter_direction.is_some(), !eight, "{kind:?}");
            let ignored = (
                reported.loiter_duration,
                reported.loiter_duration_units,
                reported.loiter_length_units,
                reported.flying_behaviour,
            );
            assert_eq!(ignored, (None, None, None, None), "{kind:?}");
        }
        for (mode, loiters) in [
            (Px4Mode::LOITER, true),
            (Px4Mode::ORBIT, true),
            (Px4Mode::TAKEOFF, true),
            (Px4Mode::MISSION, false),
            (Px4Mode::COURSE, false),
        ] {
            let reported = report(mode, LoiterType::Circular);
            assert_eq!(reported.loiter_altitude.is_some(), loiters, "{mode:?}");
            assert_eq!(reported.altitude_type.is_some(), loiters, "{mode:?}");
            assert_eq!(reported.loiter_speed.is_some(), loiters, "{mode:?}");
            assert_eq!(reported.speed_type.is_some(), loiters, "{mode:?}");
        }
    }

    #[test]
    fn a_silent_vehicle_has_no_state_and_a_failed_link() {
        let vehicle = Telemetry {
            battery: Some(90),
            ..Telemetry::default()
        };
        let states = subsystems(&vehicle, &Parameters::default(), false);
        assert!(states.contains(&(SubsystemId::Comms, AlertPriority::Failed)));
        let others = states
            .iter()
            .filter(|(subsystem, _)| *subsystem != SubsystemId::Comms);
        assert!(
            others
                .into_iter()
                .all(|(_, state)| *state == AlertPriority::Cleared)
        );
    }

    #[test]
    fn the_worst_of_a_subsystem_is_its_state() {
        let mut vehicle = Telemetry {
            battery: Some(80),
            gps_fix: Some(true),
            ..Telemetry::default()
        };
        vehicle.sensed.estimator = Some(895);
        let of = |vehicle: &Telemetry, wanted| {
            let states = subsystems(vehicle, &Parameters::default(), true);
            states.iter().find(|(id, _)| *id == wanted).unwrap().1
        };
        assert_eq!(
            of(&vehicle, SubsystemId::Navigation),
            AlertPriority::Nominal
        );
        assert_eq!(
            of(&vehicle, SubsystemId::PropulsionEnergy),
            AlertPriority::Nominal
        );
        vehicle.sensed.estimator = Some(895 | 0x400);
        assert_eq!(
            of(&vehicle, SubsystemId::Navigation),
            AlertPriority::Caution
        );
        vehicle.gps_fix = Some(false);
        assert_eq!(
            of(&vehicle, SubsystemId::Navigation),
            AlertPriority::Warning
        );
        vehicle.battery = Some(3);
        assert_eq!(
            of(&vehicle, SubsystemId::PropulsionEnergy),
            AlertPriority::Emergency
        );
    }
}
