//! Missions: routes, waypoints and their transfer, 13000 to 14000.

use std::f64::consts::FRAC_PI_2;

use super::codec::messages;
use crate::enums::{
    AirframeFunction, AirframeState, AltitudeChangeBehaviour, AltitudeType, FlyingBehaviour,
    LimitType, LocationType, LoiterDirection, LoiterDurationUnits, LoiterLengthUnits, LoiterType,
    MissionPlanMode, MissionTransferStatus, PointingModeWp, RouteType, SensorModeCmd, SensorOutput,
    SpeedType, StationBitmap1To16, TurnType, WaypointSpeedType, WaypointType,
};
use crate::scalar::{Altitude, Bam16, Bam32, Distance, Speed, Text, TimeStamp, U24};

messages! {
    MissionTransferCommand = 13000, "Mission Transfer Command", presence bytes 1
        sent(ToVsm, Push) layout(Ed4, B) latency_ms(1000) table("4-92?") ed2_message("800")
        source("K (order, uids) + E2/P (enums, lengths)")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0800.01");
        mission_id: Text<20> = 1, "Mission ID", uid("0800.04");
        mission_plan_mode: MissionPlanMode = 2, "Mission Plan Mode", uid("0800.05");
        waypoint_number: u16 = 3, "Waypoint Number", uid("0800.06");
        route_id: Text<33> = 4, "Route ID", uid("13000.01"), conf(C), width_inferred();
        activity_id: U24 = 5, "Activity ID", uid("13000.02");
    }

    UaRoute = 13001, "UA Route", presence bytes 1
        sent(Both, PushPull) layout(Ed4, B) latency_ms(2000) table("4-93?") ed2_message("801")
        source("K + E2/P")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0801.01");
        initial_waypoint_number: u16 = 1, "Initial Waypoint Number",
            uid("0801.04"), note("0 deletes the route definition (not its waypoints)");
        route_id: Text<33> = 2, "Route ID",
            uid("0801.05"), conf(B), width_inferred(), note("33 in E2 and P");
        route_type: RouteType = 3, "Route Type", uid("0801.06");
        activity_id: U24 = 4, "Activity ID", uid("13001.01");
    }

    UaPositionWaypoint = 13002, "UA Position Waypoint", presence bytes 3
        sent(Both, PushPull) layout(Ed4, A) latency_ms(1000) table("4-94") ed2_message("802")
        source("T+K agree on all 18; P confirms the 0802 fields")
        corroboration("T+K")
        note("Ed2 contingency waypoint A/B fields (0802.13/.14) are gone; contingency is by route type")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0802.01");
        waypoint_number: u16 = 1, "Waypoint Number",
            uid("0802.04"), range(1.0, 65534.0), note("1..65534");
        waypoint_to_latitude_or_relative_y: Bam32 = 2, "Waypoint to Latitude or Relative Y",
            uid("0802.05"), note("bam32 when absolute; encoding of a relative Y in metres not found");
        waypoint_to_longitude_or_relative_x: Bam32 = 3, "Waypoint to Longitude or Relative X",
            uid("0802.06");
        location_type: LocationType = 4, "Location Type", uid("0802.07");
        waypoint_to_altitude: Altitude = 5, "Waypoint to Altitude", uid("0802.08");
        waypoint_altitude_type: AltitudeType = 6, "Waypoint Altitude Type", uid("0802.09");
        altitude_change_behaviour: AltitudeChangeBehaviour = 7, "Altitude Change Behaviour",
            uid("0802.20");
        waypoint_to_speed: Speed = 8, "Waypoint to Speed", uid("0802.10");
        waypoint_speed_type: WaypointSpeedType = 9, "Waypoint Speed Type", uid("0802.11");
        next_waypoint: u16 = 10, "Next Waypoint", uid("0802.12"), note("0 = last of the series");
        turn_type: TurnType = 11, "Turn Type", uid("0802.16");
        optional_messages_for_waypoint: u8 = 12, "Optional Messages for Waypoint",
            uid("13002.01"), note("bitmap: which of 13003..13006 follow; bits not found");
        waypoint_type: WaypointType = 13, "Waypoint Type", uid("0802.17");
        limit_type: LimitType = 14, "Limit Type", uid("0802.18");
        loop_limit: u16 = 15, "Loop Limit", uid("0802.19");
        arrival_time: TimeStamp = 16, "Arrival Time", uid("0802.15");
        activity_id: U24 = 17, "Activity ID", uid("13002.02");
    }

    UaLoiterWaypoint = 13003, "UA Loiter Waypoint", presence bytes 2
        sent(Both, PushPull) layout(Ed4, B) latency_ms(2000) table("4-95?") ed2_message("803")
        source("K (order, widths) + T's scales on the twin 2017/3004 + E2 enums")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0803.01");
        waypoint_number: u16 = 1, "Waypoint Number", uid("0803.04");
        waypoint_loiter_type: LoiterType = 2, "Waypoint Loiter Type", uid("0803.06");
        loiter_radius: Distance = 3, "Loiter Radius", uid("0803.07");
        loiter_length: Distance = 4, "Loiter Length", uid("0803.08");
        loiter_length_units: LoiterLengthUnits = 5, "Loiter Length Units", uid("13003.02");
        loiter_bearing: Bam16 = 6, "Loiter Bearing", uid("0803.09");
        loiter_direction: LoiterDirection = 7, "Loiter Direction", uid("0803.10");
        loiter_speed: Speed = 8, "Loiter Speed", uid("13003.03");
        speed_type: SpeedType = 9, "Speed Type", uid("13003.04");
        flying_behaviour: FlyingBehaviour = 10, "Flying Behaviour", uid("13003.01");
        loiter_duration: u16 = 11, "Loiter Duration", uid("13003.05");
        loiter_duration_units: LoiterDurationUnits = 12, "Loiter Duration Units", uid("13003.06");
        activity_id: U24 = 13, "Activity ID", uid("13003.07");
    }

    PayloadActionWaypoint = 13004, "Payload Action Waypoint", presence bytes 2
        sent(Both, PushPull) layout(Ed2Derived, C) latency_ms(2000) table("4-96?") ed2_message("804")
        source("E2 #804")
        note("Ed4 certainly inserts Component/Sub-Component Number and appends Activity ID and Station 17-32: layout NOT trustworthy")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0804.01");
        waypoint_number: u16 = 1, "Waypoint Number", uid("0804.04");
        station_number_1_16: StationBitmap1To16 = 2, "Station Number (1-16)", uid("0804.05");
        set_sensor_1_mode: SensorModeCmd = 3, "Set Sensor 1 Mode", uid("0804.06");
        set_sensor_2_mode: SensorModeCmd = 4, "Set Sensor 2 Mode", uid("0804.07");
        sensor_output: SensorOutput = 5, "Sensor Output", uid("0804.08");
        set_sensor_pointing_mode: PointingModeWp = 6, "Set Sensor Pointing Mode", uid("0804.09");
        starepoint_latitude: Bam32 = 7, "Starepoint Latitude",
            uid("0804.10"), range(-FRAC_PI_2, FRAC_PI_2);
        starepoint_longitude: Bam32 = 8, "Starepoint Longitude", uid("0804.11");
        starepoint_altitude: Altitude = 9, "Starepoint Altitude", uid("0804.12");
        starepoint_altitude_type: AltitudeType = 10, "Starepoint Altitude Type", uid("0804.13");
        payload_az_wrt_ua: Bam16 = 11, "Payload Az (wrt UA)", uid("0804.14");
        payload_el_wrt_ua: Bam16 = 12, "Payload El (wrt UA)", uid("0804.15");
        payload_sensor_rotation_angle: Bam16 = 13, "Payload Sensor Rotation Angle", uid("0804.16");
    }

    AirframeActionWaypoint = 13005, "Airframe Action Waypoint", presence bytes 1
        sent(Both, PushPull) layout(Ed2Derived, C) latency_ms(2000) table("4-97?") ed2_message("805")
        source("E2 #805")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0805.01");
        waypoint_number: u16 = 1, "Waypoint Number", uid("0805.04");
        function: AirframeFunction = 2, "Function", uid("0805.05");
        enumerated_state: AirframeState = 3, "Enumerated State", uid("0805.06");
        activity_id: U24 = 4, "Activity ID", conf(C), note("inferred by analogy");
    }

    VehicleSpecificWaypoint = 13006, "Vehicle Specific Waypoint", presence bytes 1
        sent(Both, PushPull) layout(Ed2Derived, C) latency_ms(2000) table("4-98?") ed2_message("806")
        source("E2 #806")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0806.01");
        waypoint_number: u16 = 1, "Waypoint Number",
            uid("0806.04"), note("0 = mission generic data");
        tag_type: u8 = 2, "Tag Type", uid("0806.05"), note("0 none, 1 start tag, 2 stop tag");
        tag_data: Text<20> = 3, "Tag/Data", uid("0806.06");
        activity_id: U24 = 4, "Activity ID", conf(C), note("inferred by analogy");
    }

    MissionUploadDownloadStatus = 14000, "Mission Upload / Download Status", presence bytes 1
        sent(ToCucs, Push) layout(Ed4, B) latency_ms(2000) table("4-99?") ed2_message("900")
        source("K + E2")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0900.01");
        mission_id: Text<20> = 1, "Mission ID", uid("14000.01"), conf(B), width_inferred();
        status: MissionTransferStatus = 2, "Status", uid("0900.04");
        percent_complete: u8 = 3, "Percent Complete", uid("0900.05"), unit("%");
        waypoint_request: u16 = 4, "Waypoint Request",
            uid("14000.02"), note("waypoint the VSM asks the CUCS to (re)send");
        mission_plan_mode: MissionPlanMode = 5, "Mission Plan Mode",
            uid("14000.03"), note("echo of the mode this status answers");
    }
}
