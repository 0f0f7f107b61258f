//! Faults of a vehicle by its own messages, subsystem by subsystem, in words that an operator can act on: the source of
//! 16000 for lasting causes, and of the states in 16001.

use mavlink_link::dialect::MavState;
use stanag_msgs::enums::{AlertPriority, SubsystemId};

use crate::airframe::refused_autopilot;
use crate::evidence::{MOTOR_OUTPUTS, POSITION};
use crate::parameter::Parameters;
use crate::telemetry::{BATTERY, Telemetry};

/// The possible faults. Each has at most one alert at a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum HealthFault {
    /// SYS_STATUS: motor outputs.
    Motors,
    /// SYS_STATUS: gyroscopes or accelerometers.
    InertialSensors,
    /// SYS_STATUS: magnetometer.
    Compass,
    /// SYS_STATUS: barometer.
    Barometer,
    /// SYS_STATUS: GPS, or GPS_RAW_INT without a 3-D fix.
    Gps,
    /// ESTIMATOR_STATUS: no position, or an unreliable one.
    Estimator,
    /// SYS_STATUS: the battery, for another cause than a low charge that is reported.
    BatterySensor,
    /// SYS_STATUS, BATTERY_STATUS: the remaining charge.
    Charge,
    /// HEARTBEAT: a failsafe controls the vehicle, or it reports an emergency.
    Failsafe,
    /// EXTENDED_SYS_STATE: a VTOL fell back to hovering without a transition to it (PX4's quad-chute).
    Transition,
    /// HEARTBEAT: another autopilot than PX4.
    Autopilot,
}

/// A fault that was found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// Which fault.
    pub fault: HealthFault,
    /// How urgent.
    pub priority: AlertPriority,
    /// Which part of the aircraft.
    pub subsystem: SubsystemId,
    /// What is wrong, and what to do.
    pub text: String,
}

impl HealthFault {
    /// All of them.
    pub const ALL: [HealthFault; 11] = [
        HealthFault::Motors,
        HealthFault::InertialSensors,
        HealthFault::Compass,
        HealthFault::Barometer,
        HealthFault::Gps,
        HealthFault::Estimator,
        HealthFault::BatterySensor,
        HealthFault::Charge,
        HealthFault::Failsafe,
        HealthFault::Transition,
        HealthFault::Autopilot,
    ];

    /// The text of the alert that clears it.
    #[must_use]
    pub fn over(self) -> &'static str {
        match self {
            HealthFault::Motors => "motor outputs recovered",
            HealthFault::InertialSensors => "gyroscopes and accelerometers recovered",
            HealthFault::Compass => "compass recovered",
            HealthFault::Barometer => "barometer recovered",
            HealthFault::Gps => "GPS recovered",
            HealthFault::Estimator => "position estimate valid again",
            HealthFault::BatterySensor => "battery reported healthy again",
            HealthFault::Charge => "battery no longer low",
            HealthFault::Failsafe => "no failsafe controls the vehicle any longer",
            HealthFault::Transition => {
                "the failed transition is over: on the ground, or on wings again"
            }
            HealthFault::Autopilot => "the vehicle's autopilot is PX4",
        }
    }
}

/// All faults of a vehicle with a live link, by its latest messages.
#[must_use]
pub fn findings(vehicle: &Telemetry, parameters: &Parameters) -> Vec<Finding> {
    use AlertPriority as P;
    use SubsystemId as S;
    let health = vehicle.sensed.health;
    let fails = |sensors: u32| health.is_some_and(|health| health.fails(sensors));
    let mut all = Vec::new();
    let mut found = |fault, priority, subsystem, text: &str| {
        all.push(Finding {
            fault,
            priority,
            subsystem,
            text: text.to_owned(),
        });
    };
    if let Some(why) = vehicle.autopilot.and_then(refused_autopilot) {
        found(HealthFault::Autopilot, P::Failed, S::VsmStatus, why);
    }
    if vehicle.transition_failed {
        let text = "transition failed: the VTOL fell back to hovering (quad-chute); land it or return, by hover";
        found(HealthFault::Transition, P::Emergency, S::Engine, text);
    }
    if fails(MOTOR_OUTPUTS) {
        found(
            HealthFault::Motors,
            P::Failed,
            S::Engine,
            "motor output failure: land immediately",
        );
    }
    if fails(GYRO | ACCELEROMETER) {
        let text = "gyroscope or accelerometer failure: land as soon as possible";
        found(
            HealthFault::InertialSensors,
            P::Warning,
            S::Navigation,
            text,
        );
    }
    if fails(MAGNETOMETER) {
        let text = "compass failure: the heading drifts; return by route or land";
        found(HealthFault::Compass, P::Warning, S::Navigation, text);
    }
    if fails(BAROMETER) {
        let text = "barometer failure: altitudes are from GPS only; keep clear of the ground";
        found(HealthFault::Barometer, P::Warning, S::Navigation, text);
    }
    // One finding for each fault: a failed receiver has no position either. PX4 may fly on by its estimate, and what of it is
    // lost is the estimator's finding.
    if fails(GPS) {
        let text = "GPS failure: the position may drift, modes that need it be refused; land";
        found(HealthFault::Gps, P::Warning, S::Navigation, text);
    } else if vehicle.gps_fix == Some(false) {
        let text = "no GPS position: the position may drift, modes that need it be refused";
        found(HealthFault::Gps, P::Warning, S::Navigation, text);
    }
    match vehicle.sensed.estimator {
        Some(flags) if flags & POSITION != POSITION => {
            let text = "vehicle position unknown: routes and loiters cannot be flown";
            found(HealthFault::Estimator, P::Warning, S::Navigation, text);
        }
        Some(flags) if flags & GLITCHES != 0 => {
            let text = "GPS or accelerometer glitches: watch the position";
            found(HealthFault::Estimator, P::Caution, S::Navigation, text);
        }
        _ => {}
    }
    let charge = charge(vehicle, parameters);
    // PX4 v1.18 clears the bit for a low charge too (batteryCheck.cpp), and for one that is too low to arm.
    if fails(BATTERY) && charge.is_none() {
        let (priority, text) = if vehicle.battery.is_none() {
            let text = "battery not measured: its charge is unknown; return";
            (P::Failed, text)
        } else {
            let text = "battery failure, or too little charge by the vehicle's checks: return";
            (P::Warning, text)
        };
        found(
            HealthFault::BatterySensor,
            priority,
            S::PropulsionEnergy,
            text,
        );
    }
    if let Some((priority, text)) = charge {
        found(HealthFault::Charge, priority, S::PropulsionEnergy, &text);
    }
    match vehicle.system_status {
        Some(MavState::MAV_STATE_EMERGENCY) => {
            found(
                HealthFault::Failsafe,
                P::Emergency,
                S::Engine,
                "the autopilot reports an emergency",
            );
        }
        Some(MavState::MAV_STATE_CRITICAL) => {
            let text = "a failsafe controls the vehicle: command a mode to regain control";
            found(HealthFault::Failsafe, P::Warning, S::Engine, text);
        }
        _ => {}
    }
    all
}

fn charge(vehicle: &Telemetry, parameters: &Parameters) -> Option<(AlertPriority, String)> {
    let percent = f64::from(vehicle.battery?);
    let threshold = |name, otherwise: f64| {
        parameters
            .above_zero(name)
            .map_or(otherwise, |share| share * 100.0)
    };
    // The most urgent first: only the worst threshold is reported.
    let levels = [
        (
            AlertPriority::Emergency,
            "BAT_EMERGEN_THR",
            5.0,
            "land immediately",
        ),
        (AlertPriority::Warning, "BAT_CRIT_THR", 7.0, "return now"),
        (
            AlertPriority::Caution,
            "BAT_LOW_THR",
            15.0,
            "consider returning",
        ),
    ];
    levels.iter().find_map(|(priority, name, otherwise, what)| {
        let below = threshold(name, *otherwise);
        // A float has more digits than a battery's threshold.
        let shown = (below * 10.0).round() / 10.0;
        (percent <= below).then(|| {
            let text = format!("battery at {shown} % or less ({name}): {what}");
            (*priority, text)
        })
    })
}

/// MAV_SYS_STATUS_SENSOR_3D_GYRO.
const GYRO: u32 = 0x1;
/// MAV_SYS_STATUS_SENSOR_3D_ACCEL.
const ACCELEROMETER: u32 = 0x2;
/// MAV_SYS_STATUS_SENSOR_3D_MAG.
const MAGNETOMETER: u32 = 0x4;
/// MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE.
const BAROMETER: u32 = 0x8;
/// MAV_SYS_STATUS_SENSOR_GPS.
const GPS: u32 = 0x20;
/// ESTIMATOR_STATUS_FLAGS: GPS glitch, accelerometer error.
const GLITCHES: u16 = 0x400 | 0x800;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::telemetry::Health;

    fn found(vehicle: &Telemetry) -> Vec<(HealthFault, AlertPriority)> {
        let findings = findings(vehicle, &Parameters::default());
        let all = findings.iter();
        all.map(|finding| (finding.fault, finding.priority))
            .collect()
    }

    #[test]
    fn each_sensor_of_sys_status_has_a_fault_of_its_own() {
        for (bit, fault) in [
            (GYRO, HealthFault::InertialSensors),
            (ACCELEROMETER, HealthFault::InertialSensors),
            (MAGNETOMETER, HealthFault::Compass),
            (BAROMETER, HealthFault::Barometer),
            (GPS, HealthFault::Gps),
            (MOTOR_OUTPUTS, HealthFault::Motors),
            (BATTERY, HealthFault::BatterySensor),
        ] {
            let mut vehicle = Telemetry::default();
            vehicle.sensed.health = Some(Health {
                enabled: bit,
                healthy: !bit,
            });
            let found = found(&vehicle);
            assert_eq!(found.len(), 1, "{bit:#x}");
            assert_eq!(found[0].0, fault);
            vehicle.sensed.health = Some(Health {
                enabled: 0,
                healthy: 0,
            });
            assert!(
                self::found(&vehicle).is_empty(),
                "one that is not used is not missed"
            );
        }
    }

    #[test]
    fn the_charge_is_judged_by_the_vehicles_own_thresholds() {
        let mut parameters = Parameters::default();
        let vehicle = |percent| Telemetry {
            battery: Some(percent),
            ..Telemetry::default()
        };
        let priority = |percent, parameters: &Parameters| {
            let findings = findings(&vehicle(percent), parameters);
            findings.first().map(|finding| finding.priority)
        };
        assert_eq!(priority(16, &parameters), None);
        assert_eq!(priority(15, &parameters), Some(AlertPriority::Caution));
        assert_eq!(priority(7, &parameters), Some(AlertPriority::Warning));
        assert_eq!(priority(5, &parameters), Some(AlertPriority::Emergency));
        assert!(parameters.set("BAT_LOW_THR", 0.4));
        assert_eq!(priority(40, &parameters), Some(AlertPriority::Caution));
    }

    #[test]
    fn a_low_battery_that_is_measured_is_not_called_unmeasured() {
        let mut vehicle = Telemetry::default();
        vehicle.sensed.health = Some(Health {
            enabled: BATTERY,
            healthy: 0,
        });
        let mut at = |percent| {
            vehicle.battery = percent;
            found(&vehicle)
        };
        let sensor = HealthFault::BatterySensor;
        assert_eq!(at(None), [(sensor, AlertPriority::Failed)]);
        assert_eq!(at(Some(80)), [(sensor, AlertPriority::Warning)]);
        for (percent, priority) in [
            (12, AlertPriority::Caution),
            (6, AlertPriority::Warning),
            (3, AlertPriority::Emergency),
        ] {
            assert_eq!(at(Some(percent)), [(HealthFault::Charge, priority)]);
        }
    }

    #[test]
    fn every_text_fits_one_message_of_16000() {
        let mut vehicle = Telemetry {
            gps_fix: Some(false),
            system_status: Some(MavState::MAV_STATE_CRITICAL),
            ..Telemetry::default()
        };
        for (enabled, estimator, battery) in [
            (u32::MAX, 0, Some(1)),
            (!GPS, 0xffff, Some(90)),
            (BATTERY, 0, None),
        ] {
            vehicle.battery = battery;
            vehicle.sensed.health = Some(Health {
                enabled,
                healthy: 0,
            });
            vehicle.sensed.estimator = Some(estimator);
            for finding in findings(&vehicle, &Parameters::default()) {
                assert!(finding.text.len() <= crate::alert::TEXT, "{}", finding.text);
                assert!(finding.fault.over().len() <= crate::alert::TEXT);
            }
        }
    }
}
