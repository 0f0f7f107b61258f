//! Messages 3016, 12001, 18300 and 18500. A field that the vehicle has not reported is absent, and without any of its values so
//! is the message.

use stanag_msgs::enums::AltitudeType;
use stanag_msgs::messages::{
    ElectricalReport, GpsStatusReport, MeteorologicalTableReport,
    RelativeRouteWaypointLocationReport,
};
use stanag_msgs::scalar::U24;
use stanag_msgs::{Bam32, Text, TimeStamp};

use crate::altitude::Agl;
use crate::report::{reference, scaled};
use crate::telemetry::Telemetry;

/// 18500. No source gives the values of mode and status, or the scale of the dilutions.
///
/// Here the mode is MAVLink's GPS_FIX_TYPE, the status 1 with a position in three dimensions, and dilutions are in steps of 0.1.
#[must_use]
pub fn gps_status(vehicle: &Telemetry, stamp: TimeStamp) -> Option<GpsStatusReport> {
    let gps = vehicle.equipment.gps?;
    let both = gps.hdop.zip(gps.vdop);
    Some(GpsStatusReport {
        time_stamp: Some(stamp),
        number_of_satellites: gps.satellites,
        gps_mode: Some(gps.fix),
        gps_status: Some(u8::from(gps.is_fixed())),
        pdop: both.and_then(|(h, v)| tenths(h.hypot(v))),
        hdop: gps.hdop.and_then(tenths),
        vdop: gps.vdop.and_then(tenths),
        gps_time: gps.utc_ms.map(TimeStamp::from_unix_ms),
        ..GpsStatusReport::default()
    })
}

/// 12001, one a bus that the vehicle has reported. No source gives its scales.
///
/// Here it has volts, hundredths of an ampere as 12101, and seconds. Bus IDs 0 to 3 are batteries, 4 is a generator.
pub fn electrical(
    vehicle: &Telemetry,
    mut stamp: impl FnMut() -> TimeStamp,
) -> impl Iterator<Item = ElectricalReport> {
    let buses = (0_u8..).zip(vehicle.equipment.buses);
    buses.filter_map(move |(id, bus)| {
        let bus = bus?;
        Some(ElectricalReport {
            time_stamp: Some(stamp()),
            bus_id: Some(id),
            bus_voltage: whole(bus.volts, 1.0).and_then(|volts| u8::try_from(volts).ok()),
            bus_current: whole(bus.amperes, 0.01).and_then(|steps| u16::try_from(steps).ok()),
            battery_time_remaining: bus.remaining_s.and_then(U24::new),
        })
    })
}

/// 18300: the air where the vehicle is, as it estimates it, as a table of one level.
///
/// No source gives the scale of the wind: here it is in steps of 0.05 m/s, as velocities are elsewhere.
#[must_use]
pub fn weather(
    vehicle: &Telemetry,
    measured: TimeStamp,
    stamp: TimeStamp,
) -> Option<MeteorologicalTableReport> {
    let (wind, air) = (vehicle.sensed.wind_ne, vehicle.equipment.air);
    let kelvin = air.kelvin.or(air.barometer_kelvin);
    let place = vehicle.located()?;
    if wind.is_none() && kelvin.is_none() {
        return None;
    }
    let velocity = |m_s: f64| i16::try_from((m_s / 0.05).round() as i64).ok();
    let (_, offset_m) = reference(vehicle);
    Some(MeteorologicalTableReport {
        time_stamp: Some(measured),
        publish_time: Some(stamp),
        forecast_time: Some(measured),
        latitude: Some(Bam32::from_degrees(place.latitude)),
        longitude: Some(Bam32::from_degrees(place.longitude)),
        number_of_levels: Some(1),
        altitude: scaled(Some(place.amsl_m + offset_m)),
        u_speed: wind.and_then(|[north, _]| velocity(north)),
        v_speed: wind.and_then(|[_, east]| velocity(east)),
        temperature: scaled(kelvin),
        humidity: None,
    })
}

/// 3016: what altitudes above ground are flown above, which is home; and how high above it the vehicle is.
///
/// Routes have no reference of their own: their waypoints are absolute.
#[must_use]
pub fn relative_location(
    vehicle: &Telemetry,
    route: Option<&str>,
    agl: Agl,
    stamp: TimeStamp,
) -> Option<RelativeRouteWaypointLocationReport> {
    let home = vehicle.home?;
    let (altitude_type, offset_m) = reference(vehicle);
    let above_home = vehicle.above_home_m.filter(|_| agl == Agl::AboveHome);
    let relative = scaled(above_home);
    Some(RelativeRouteWaypointLocationReport {
        time_stamp: Some(stamp),
        location_latitude_y_axis_zero: Some(Bam32::from_degrees(home.latitude)),
        location_longitude_x_axis_zero: Some(Bam32::from_degrees(home.longitude)),
        location_altitude_type: Some(altitude_type),
        location_altitude: scaled(Some(home.amsl_m + offset_m)),
        route_id: route.map(Text::new),
        ua_relative_altitude_type: relative.and(Some(AltitudeType::Agl)),
        ua_relative_altitude: relative,
        ..RelativeRouteWaypointLocationReport::default()
    })
}

fn tenths(dilution: f64) -> Option<u8> {
    whole(Some(dilution), 0.1).and_then(|tenths| u8::try_from(tenths).ok())
}

fn whole(value: Option<f64>, step: f64) -> Option<i64> {
    value.map(|value| (value / step).round() as i64)
}

#[cfg(test)]
mod tests {
    use mavlink_link::dialect::{
        BATTERY_STATUS_DATA, ESC_STATUS_DATA, GENERATOR_STATUS_DATA, GPS_RAW_INT_DATA, GpsFixType,
        MavMessage, RADIO_STATUS_DATA, SCALED_PRESSURE_DATA,
    };

    use core::time::Duration;

    use super::*;
    use crate::equipment::{Air, FRESH};
    use crate::telemetry::Place;

    const STAMP: TimeStamp = TimeStamp(5);
    const NOW: Duration = Duration::from_secs(100);

    fn told(messages: impl IntoIterator<Item = MavMessage>) -> Telemetry {
        let mut vehicle = Telemetry::default();
        for message in messages {
            vehicle.update(&message);
            assert!(vehicle.equipment.update(NOW, &message));
        }
        vehicle
    }

    #[test]
    fn a_receiver_is_reported_as_far_as_it_is_known() {
        let data = GPS_RAW_INT_DATA {
            time_usec: 1_767_225_600_250_000,
            fix_type: GpsFixType::GPS_FIX_TYPE_3D_FIX,
            satellites_visible: 11,
            eph: 90,
            epv: 120,
            ..GPS_RAW_INT_DATA::default()
        };
        let report =
            gps_status(&told([MavMessage::GPS_RAW_INT(data.clone())]), STAMP).expect("a receiver");
        assert_eq!(
            (
                report.number_of_satellites,
                report.gps_mode,
                report.gps_status
            ),
            (Some(11), Some(3), Some(1))
        );
        assert_eq!(
            (report.hdop, report.vdop, report.pdop),
            (Some(9), Some(12), Some(15))
        );
        assert_eq!(
            report.gps_time,
            Some(TimeStamp::from_unix_ms(1_767_225_600_250))
        );
        let unknown = GPS_RAW_INT_DATA {
            // PX4's time since boot.
            time_usec: 900_000_000,
            fix_type: GpsFixType::GPS_FIX_TYPE_NO_FIX,
            satellites_visible: u8::MAX,
            eph: u16::MAX,
            epv: 9_999,
            ..data
        };
        let report =
            gps_status(&told([MavMessage::GPS_RAW_INT(unknown)]), STAMP).expect("a receiver");
        assert_eq!(
            (report.number_of_satellites, report.gps_status),
            (None, Some(0))
        );
        assert_eq!(
            (report.hdop, report.vdop, report.pdop, report.gps_time),
            (None, None, None, None)
        );
        assert_eq!(gps_status(&Telemetry::default(), STAMP), None);
    }

    #[test]
    fn each_bus_is_reported_and_none_that_was_not() {
        let mut voltages = [u16::MAX; 10];
        voltages[..2].copy_from_slice(&[12_100, 12_200]);
        let battery = BATTERY_STATUS_DATA {
            id: 1,
            voltages,
            current_battery: 1_250,
            time_remaining: 600,
            ..BATTERY_STATUS_DATA::default()
        };
        let generator = GENERATOR_STATUS_DATA {
            bus_voltage: 48.4,
            load_current: f32::NAN,
            ..GENERATOR_STATUS_DATA::default()
        };
        let vehicle = told([
            MavMessage::BATTERY_STATUS(battery),
            MavMessage::GENERATOR_STATUS(generator),
        ]);
        let reports: Vec<ElectricalReport> = electrical(&vehicle, || STAMP).collect();
        let of =
            |report: &ElectricalReport| (report.bus_id, report.bus_voltage, report.bus_current);
        assert_eq!(
            reports.iter().map(of).collect::<Vec<_>>(),
            [(Some(1), Some(24), Some(1_250)), (Some(4), Some(48), None),]
        );
        assert_eq!(reports[0].battery_time_remaining.map(U24::get), Some(600));
        // PX4 has four at most: another id is no place.
        let other = BATTERY_STATUS_DATA {
            id: 9,
            ..BATTERY_STATUS_DATA::default()
        };
        assert!(
            !Telemetry::default()
                .equipment
                .update(NOW, &MavMessage::BATTERY_STATUS(other))
        );
    }

    #[test]
    fn what_has_fallen_silent_is_absent() {
        let gps = MavMessage::GPS_RAW_INT(GPS_RAW_INT_DATA::default());
        let radio = MavMessage::RADIO_STATUS(RADIO_STATUS_DATA::default());
        let bus = MavMessage::GENERATOR_STATUS(GENERATOR_STATUS_DATA::default());
        let motors = MavMessage::ESC_STATUS(ESC_STATUS_DATA::default());
        let air = MavMessage::SCALED_PRESSURE(SCALED_PRESSURE_DATA::default());
        let mut equipment = told([gps, radio, bus.clone(), motors, air]).equipment;
        let all = equipment.clone();
        equipment.forget(NOW + FRESH - Duration::from_millis(1));
        assert_eq!(equipment, all);
        equipment.update(NOW + FRESH, &bus);
        equipment.forget(NOW + FRESH);
        assert!(equipment.gps.is_none() && equipment.radio.is_none());
        assert_eq!(equipment.rpm.iter().flatten().count(), 0);
        assert_eq!(equipment.air, Air::default());
        assert_eq!(equipment.buses.iter().flatten().count(), 1, "it is new");
    }

    #[test]
    fn motors_beyond_the_last_are_left_out() {
        for index in [0, 4, 8, 12, 255] {
            let motors = ESC_STATUS_DATA {
                index,
                rpm: [1, 2, 3, 4],
                ..ESC_STATUS_DATA::default()
            };
            let vehicle = told([MavMessage::ESC_STATUS(motors)]);
            let known = vehicle.equipment.rpm.iter().flatten().count();
            assert_eq!(known, if index < 12 { 4 } else { 0 });
        }
    }

    #[test]
    fn weather_is_where_the_vehicle_is_and_absent_where_nothing_is_known() {
        let mut vehicle = Telemetry::default();
        vehicle.sensed.wind_ne = Some([-4.0, 2.5]);
        assert_eq!(weather(&vehicle, STAMP, STAMP), None, "no place");
        vehicle.position = Some(Place {
            latitude: 47.0,
            longitude: 8.0,
            amsl_m: 500.0,
        });
        let report = weather(&vehicle, TimeStamp(4), STAMP).expect("wind");
        assert_eq!(
            (report.u_speed, report.v_speed, report.temperature),
            (Some(-80), Some(50), None)
        );
        assert_eq!(
            (report.forecast_time, report.publish_time),
            (Some(TimeStamp(4)), Some(STAMP))
        );
        vehicle.sensed.wind_ne = None;
        assert_eq!(weather(&vehicle, STAMP, STAMP), None);
        vehicle.equipment.air.barometer_kelvin = Some(300.0);
        vehicle.equipment.air.kelvin = Some(288.0);
        let report = weather(&vehicle, STAMP, STAMP).expect("a temperature");
        assert_eq!(report.temperature.map(|t| t.si()), Some(288.0));
    }
}
