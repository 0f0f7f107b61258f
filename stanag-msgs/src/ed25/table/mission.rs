//! Missions: routes, waypoints and their transfer, 800 to 900.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::rows::messages;
use crate::ed25::values::{
    AIRFRAME_FUNCTION, AIRFRAME_STATE, ALTITUDE_TYPE, LOCATION_TYPE, LOITER_DIRECTION, LOITER_TYPE,
    MISSION_PLAN_MODE, MISSION_TRANSFER_STATUS, POINTING_MODE_WP, ROUTE_TYPE, SENSOR_MODE_CMD,
    SENSOR_OUTPUT, STATION_BITMAP, TAG_TYPE, TURN_TYPE, WAYPOINT_SPEED_TYPE,
};
use crate::field::Wire::{Char, F32, F64, I32, U8, U16, U32};

messages! {
    MissionUploadCommand = 800, "Mission Upload Command"
        sent(ToVsm, Push) latency_ms(1000) loi(&[4])
        text("4.1.5.1", "B1-63") ed4(&[13000])
        note("mode 2 says that every waypoint has been sent; the VSM then loads the vehicle. Waypoint number only matters for mode 4")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0800.01"), unit("s since 1970"), ed4(13000, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0800.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0800.03"), identification();
        mission_id: Char(20) = 4, "Mission ID", uid("0800.04"), ed4(13000, 2);
        mission_plan_mode: U8 = 5, "Mission Plan Mode", uid("0800.05"), values(&MISSION_PLAN_MODE), ed4(13000, 3);
        waypoint_number: U16 = 6, "Waypoint Number", uid("0800.06"), range(1.0, 65534.0), ed4(13000, 4);
    }

    AvRoute = 801, "AV Route"
        sent(Both, PushPull) latency_ms(2000) loi(&[4])
        text("4.1.5.2", "B1-64") ed4(&[13001])
        note("gives a route a role; initial waypoint 0 deletes the route but not its waypoints; a route without one is type 2; sent by the VSM on download")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0801.01"), unit("s since 1970"), ed4(13001, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0801.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0801.03"), identification();
        initial_waypoint_number: U16 = 4, "Initial Waypoint Number",
            uid("0801.04"), range(0.0, 65534.0), ed4(13001, 2);
        route_id: Char(33) = 5, "Route ID", uid("0801.05"), ed4(13001, 3);
        route_type: U8 = 6, "Route Type", uid("0801.06"), values(&ROUTE_TYPE), ed4(13001, 4);
    }

    AvPositionWaypoint = 802, "AV Position Waypoint"
        sent(Both, PushPull) latency_ms(2000) loi(&[4])
        text("4.1.5.3", "B1-65") ed4(&[13002])
        note("numbers in a route should, but need not, be contiguous; sent by the VSM on download")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0802.01"), unit("s since 1970"), ed4(13002, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0802.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0802.03"), identification();
        waypoint_number: U16 = 4, "Waypoint Number", uid("0802.04"), range(1.0, 65534.0), ed4(13002, 2);
        waypoint_to_latitude_or_relative_y: F64 = 5, "Waypoint to Latitude or Relative Y",
            uid("0802.05"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2), ed4(13002, 3),
            note("relative: offset in the frame of #47, in radians by the unit cell");
        waypoint_to_longitude_or_relative_x: F64 = 6, "Waypoint to Longitude or Relative X",
            uid("0802.06"), unit("rad"), range(-PI, PI), ed4(13002, 4);
        location_type: U8 = 7, "Location Type", uid("0802.07"), values(&LOCATION_TYPE), ed4(13002, 5);
        waypoint_to_altitude: F32 = 8, "Waypoint to Altitude",
            uid("0802.08"), unit("m"), range(-1000.0, 100000.0), ed4(13002, 6);
        waypoint_altitude_type: U8 = 9, "Waypoint Altitude Type",
            uid("0802.09"), values(&ALTITUDE_TYPE), ed4(13002, 7), note("for all messages of this waypoint");
        waypoint_to_speed: F32 = 10, "Waypoint to Speed",
            uid("0802.10"), unit("m/s"), range(0.0, 10000.0), ed4(13002, 9);
        waypoint_speed_type: U8 = 11, "Waypoint Speed Type",
            uid("0802.11"), values(&WAYPOINT_SPEED_TYPE), ed4(13002, 10);
        next_waypoint: U16 = 12, "Next Waypoint",
            uid("0802.12"), range(0.0, 65535.0), ed4(13002, 11),
            note("0 = last of the series; Amendment 1: 0..<65535");
        contingency_waypoint_a: U16 = 13, "Contingency Waypoint A",
            uid("0802.13"), range(0.0, 65535.0),
            note("where to go on contingency A; 0 = carry on; Amendment 1: 0..<65535");
        contingency_waypoint_b: U16 = 14, "Contingency Waypoint B",
            uid("0802.14"), range(0.0, 65535.0),
            note("where to go on contingency B; 0 = carry on; Amendment 1: 0..<65535");
        arrival_time: F64 = 15, "Arrival Time",
            uid("0802.15"), unit("s since 1970"), ed4(13002, 17), note("used with speed type 3");
        turn_type: U8 = 16, "Turn Type", uid("0802.16"), values(&TURN_TYPE), ed4(13002, 12);
    }

    AvLoiterWaypoint = 803, "AV Loiter Waypoint"
        sent(Both, PushPull) latency_ms(2000) loi(&[4])
        text("4.1.5.4", "B1-66") ed4(&[13003])
        note("loiter at the waypoint with this number, on arrival")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0803.01"), unit("s since 1970"), ed4(13003, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0803.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0803.03"), identification();
        waypoint_number: U16 = 4, "Waypoint Number", uid("0803.04"), range(1.0, 65534.0), ed4(13003, 2);
        waypoint_loiter_time: U16 = 5, "Waypoint Loiter Time",
            uid("0803.05"), unit("s"), ed4(13003, 12), note("0 = no loiter");
        waypoint_loiter_type: U8 = 6, "Waypoint Loiter Type", uid("0803.06"), values(&LOITER_TYPE), ed4(13003, 3);
        loiter_radius: F32 = 7, "Loiter Radius",
            uid("0803.07"), unit("m"), range(1.0, 100000.0), ed4(13003, 4),
            note("for non-circular patterns the width across the line between the loiter points (#41 says half-circle radius)");
        loiter_length: F32 = 8, "Loiter Length",
            uid("0803.08"), unit("m"), range(1.0, 100000.0), ed4(13003, 5), note("as #41");
        loiter_bearing: F64 = 9, "Loiter Bearing",
            uid("0803.09"), unit("rad"), range(0.0, TAU), ed4(13003, 7),
            note("double and 0..2pi here, float and -pi..pi in #41");
        loiter_direction: U8 = 10, "Loiter Direction", uid("0803.10"), values(&LOITER_DIRECTION), ed4(13003, 8);
    }

    PayloadActionWaypoint = 804, "Payload Action Waypoint"
        sent(Both, PushPull) latency_ms(2000) loi(&[3, 4])
        text("4.1.5.5", "B1-67") ed4(&[13004])
        note("done when the vehicle starts flying to the waypoint")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0804.01"), unit("s since 1970"), ed4(13004, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0804.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0804.03"), identification();
        waypoint_number: U16 = 4, "Waypoint Number", uid("0804.04"), range(1.0, 65534.0), ed4(13004, 2);
        station_number: U32 = 5, "Station Number", uid("0804.05"), values(&STATION_BITMAP), ed4(13004, 3);
        set_sensor_1_mode: U8 = 6, "Set Sensor 1 Mode", uid("0804.06"), values(&SENSOR_MODE_CMD), ed4(13004, 4);
        set_sensor_2_mode: U8 = 7, "Set Sensor 2 Mode", uid("0804.07"), values(&SENSOR_MODE_CMD), ed4(13004, 5);
        sensor_output: U8 = 8, "Sensor Output", uid("0804.08"), values(&SENSOR_OUTPUT), ed4(13004, 6);
        set_sensor_pointing_mode: U8 = 9, "Set Sensor Pointing Mode",
            uid("0804.09"), values(&POINTING_MODE_WP), ed4(13004, 7);
        starepoint_latitude: F64 = 10, "Starepoint Latitude",
            uid("0804.10"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2), ed4(13004, 8);
        starepoint_longitude: F64 = 11, "Starepoint Longitude",
            uid("0804.11"), unit("rad"), range(-PI, PI), ed4(13004, 9);
        starepoint_altitude: F32 = 12, "Starepoint Altitude",
            uid("0804.12"), unit("m"), range(-1000.0, 100000.0), ed4(13004, 10);
        starepoint_altitude_type: U8 = 13, "Starepoint Altitude Type",
            uid("0804.13"), values(&ALTITUDE_TYPE), ed4(13004, 11);
        payload_az: F32 = 14, "Payload Az (wrt AV)", uid("0804.14"), unit("rad"), range(-PI, PI), ed4(13004, 12);
        payload_el: F32 = 15, "Payload El (wrt AV)",
            uid("0804.15"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2), ed4(13004, 13);
        payload_sensor_rotation_angle: F32 = 16, "Payload Sensor Rotation Angle",
            uid("0804.16"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2), ed4(13004, 14);
    }

    AirframeActionWaypoint = 805, "Airframe Action Waypoint"
        sent(Both, PushPull) latency_ms(2000) loi(&[4])
        text("4.1.5.6", "B1-68") ed4(&[13005])
        note("done when the vehicle starts flying to the waypoint")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0805.01"), unit("s since 1970"), ed4(13005, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0805.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0805.03"), identification();
        waypoint_number: U16 = 4, "Waypoint Number", uid("0805.04"), range(1.0, 65534.0), ed4(13005, 2);
        function_: U8 = 5, "Function", uid("0805.05"), values(&AIRFRAME_FUNCTION), ed4(13005, 3);
        enumerated_state: U8 = 6, "Enumerated State", uid("0805.06"), values(&AIRFRAME_STATE), ed4(13005, 4);
    }

    VehicleSpecificWaypoint = 806, "Vehicle Specific Waypoint"
        sent(Both, PushPull) latency_ms(2000) loi(&[4])
        text("4.1.5.7", "B1-69") ed4(&[13006])
        note("carries Common Route Definition data that the other waypoints cannot; waypoint 0 = data of the mission as a whole")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0806.01"), unit("s since 1970"), ed4(13006, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0806.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0806.03"), identification();
        waypoint_number: U16 = 4, "Waypoint Number", uid("0806.04"), range(0.0, 65534.0), ed4(13006, 2);
        tag_type: U8 = 5, "Tag Type", uid("0806.05"), values(&TAG_TYPE), ed4(13006, 3);
        tag_data: Char(20) = 6, "Tag/Data", uid("0806.06"), ed4(13006, 4);
    }

    MissionUploadDownloadStatus = 900, "Mission Upload/Download Status"
        sent(ToCucs, Push) latency_ms(2000) loi(&[3, 4])
        text("4.1.5.8", "B1-70") ed4(&[14000])
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0900.01"), unit("s since 1970"), ed4(14000, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0900.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0900.03"), identification();
        status: U8 = 4, "Status", uid("0900.04"), values(&MISSION_TRANSFER_STATUS), ed4(14000, 3);
        percent_complete: U8 = 5, "Percent Complete", uid("0900.05"), unit("%"), range(0.0, 100.0), ed4(14000, 4);
    }
}
