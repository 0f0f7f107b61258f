//! Payloads, 200 to 308: commands and states.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::rows::messages;
use crate::ed25::values::{
    ADDRESSED_SENSOR, ALTITUDE_TYPE, ATTACK_MODE, BAY_DOORS, CLEARANCE, EJECTOR_CMD, EJECTOR_STATE,
    EO_MODE, EOIR_POINTING_MODE, EOIR_SYSTEM_MODE, FIRST_LAST_PULSE, FOCUS_TYPE, IMAGE_OUTPUT,
    IMAGE_POSITION, IR_POLARITY, LAR_STATUS, LASER_DESIGNATOR_CMD, LASER_DESIGNATOR_STATUS,
    LASER_FIRE_CMD, LASER_FIRE_STATUS, MTI_MODE, NO_YES, PAYLOAD_TYPE, PREPLAN_MODE, RADAR_STATE,
    RADAR_STATUS, RECORDING_INDEX_CMD, RECORDING_INDEX_TYPE, RECORDING_MODE_CMD, RECORDING_STATUS,
    RELAY_STATE, REPLAY_MODE_CMD, REPLAY_STATUS, SAFETY_DISCRETE, SEPARATION_STATUS, SET_FOCUS,
    SET_ZOOM, STATION_BITMAP, STORES_POWER_CMD, TARGET_ACQUISITION_MODE, WEAPON_INITIALISING,
    WEAPON_MODE_CMD, WEAPON_POWER, WEAPON_SENSORS, WEAPON_STATUS, WEAPON_TYPE,
};
use crate::field::Wire::{Char, F32, F64, I16, I32, U8, U16, U32};

messages! {
    PayloadSteeringCommand = 200, "Payload Steering Command"
        sent(ToVsm, Push) latency_ms(200) loi(&[3])
        text("4.1.3.1", "B1-35") ed4(&[19001])
        note("the unique ids do not follow the field order: Set Zoom is 0200.17 at place 7")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0200.01"), unit("s since 1970"), ed4(19001, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0200.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0200.03"), identification();
        station_number: U32 = 4, "Station Number", uid("0200.04"), values(&STATION_BITMAP), ed4(19001, 2);
        set_centreline_azimuth_angle: F32 = 5, "Set Centreline Azimuth Angle",
            uid("0200.05"), unit("rad"), range(-PI, PI), ed4(19001, 3), note("right of the x axis +");
        set_centreline_elevation_angle: F32 = 6, "Set Centreline Elevation Angle",
            uid("0200.06"), unit("rad"), range(-PI, PI), ed4(19001, 4), note("above the waterline +");
        set_zoom: U8 = 7, "Set Zoom", uid("0200.17"), values(&SET_ZOOM), ed4(19001, 5);
        set_horizontal_field_of_view: F32 = 8, "Set Horizontal Field Of View",
            uid("0200.07"), unit("rad"), range(0.0, TAU), ed4(19001, 6), note("for the sensor addressed with #201");
        set_vertical_field_of_view: F32 = 9, "Set Vertical Field Of View",
            uid("0200.08"), unit("rad"), range(0.0, TAU), ed4(19001, 7), note("for the sensor addressed with #201");
        horizontal_slew_rate: F32 = 10, "Horizontal Slew Rate",
            uid("0200.09"), unit("rad/s"), range(-TAU, TAU), ed4(19001, 8), note("right +");
        vertical_slew_rate: F32 = 11, "Vertical Slew Rate",
            uid("0200.10"), unit("rad/s"), range(-TAU, TAU), ed4(19001, 9), note("up +");
        latitude: F64 = 12, "Latitude",
            uid("0200.11"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2), ed4(19001, 10), note("stare point");
        longitude: F64 = 13, "Longitude",
            uid("0200.12"), unit("rad"), range(-PI, PI), ed4(19001, 11), note("stare point");
        altitude: F32 = 14, "Altitude",
            uid("0200.13"), unit("m"), range(-1000.0, 100000.0), ed4(19001, 12), note("stare point");
        altitude_type: U8 = 15, "Altitude Type", uid("0200.14"), values(&ALTITUDE_TYPE), ed4(19001, 13);
        set_focus: U8 = 16, "Set Focus", uid("0200.15"), values(&SET_FOCUS), ed4(19001, 14);
        focus_type: U8 = 17, "Focus Type", uid("0200.16"), values(&FOCUS_TYPE), ed4(19001, 15);
    }

    EoIrLaserPayloadCommand = 201, "EO/IR/Laser Payload Command"
        sent(ToVsm, Push) latency_ms(1000) loi(&[3])
        text("4.1.3.2", "B1-36") ed4(&[19100])
        note("everything but pointing, manual focus and field of view (#200); slaving locks on the centre of the view when the command arrives")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0201.01"), unit("s since 1970"), ed4(19100, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0201.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0201.03"), identification();
        station_number: U32 = 4, "Station Number", uid("0201.04"), values(&STATION_BITMAP), ed4(19100, 2);
        addressed_sensor: U8 = 5, "Addressed Sensor", uid("0201.05"), values(&ADDRESSED_SENSOR), ed4(19100, 3);
        system_operating_mode: U8 = 6, "System Operating Mode",
            uid("0201.06"), values(&EOIR_SYSTEM_MODE), ed4(19100, 4);
        set_eo_sensor_mode: U8 = 7, "Set EO Sensor Mode", uid("0201.07"), values(&EO_MODE), ed4(19100, 5);
        set_ir_polarity: U8 = 8, "Set IR Polarity", uid("0201.08"), values(&IR_POLARITY), ed4(19100, 6);
        image_output: U8 = 9, "Image Output", uid("0201.09"), values(&IMAGE_OUTPUT), ed4(19100, 7);
        set_eo_ir_pointing_mode: U8 = 10, "Set EO/IR Pointing Mode",
            uid("0201.10"), values(&EOIR_POINTING_MODE), ed4(19100, 8);
        fire_laser_pointer_rangefinder: U8 = 11, "Fire Laser Pointer/Rangefinder",
            uid("0201.11"), values(&LASER_FIRE_CMD), ed4(19100, 9);
        select_laser_rangefinder_first_last_pulse: U8 = 12, "Select Laser Rangefinder First/Last Pulse",
            uid("0201.12"), values(&FIRST_LAST_PULSE), ed4(19100, 11);
        set_laser_designator_code: U16 = 13, "Set Laser Designator Code",
            uid("0201.13"), ed4(19100, 12), note("illuminator code of STANAG 5516 (Link 16)");
        initiate_laser_designator: U8 = 14, "Initiate Laser Designator",
            uid("0201.14"), values(&LASER_DESIGNATOR_CMD), ed4(19100, 13);
        preplan_mode: U8 = 15, "Preplan Mode", uid("0201.15"), values(&PREPLAN_MODE), ed4(19100, 14);
    }

    SarPayloadCommand = 202, "SAR Payload Command"
        sent(ToVsm, Push) latency_ms(1000) loi(&[3])
        text("4.1.3.3", "B1-37") ed4(&[19200])
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0202.01"), unit("s since 1970"), ed4(19200, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0202.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0202.03"), identification();
        station_number: U32 = 4, "Station Number", uid("0202.04"), values(&STATION_BITMAP), ed4(19200, 2);
        set_radar_state: U8 = 5, "Set Radar State", uid("0202.05"), values(&RADAR_STATE), ed4(19200, 3);
        set_mti_radar_mode: U8 = 6, "Set MTI Radar Mode", uid("0202.06"), values(&MTI_MODE), ed4(19200, 4);
        set_sar_modes: Char(6) = 7, "Set SAR Modes",
            uid("0202.07"), ed4(19200, 5),
            note("code of the NSIF registry (AEDP-4 Annex D); #303 field 7 has one octet less");
        set_radar_resolution: I16 = 8, "Set Radar Resolution",
            uid("0202.08"), unit("cm"), range(1.0, 10000.0), ed4(19200, 6), note("0 = unknown");
    }

    StoresManagementSystemCommand = 203, "Stores Management System Command"
        sent(ToVsm, Push) latency_ms(1000) loi(&[3])
        text("4.1.3.4", "B1-38")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0203.01"), unit("s since 1970");
        vehicle_id: I32 = 2, "Vehicle ID", uid("0203.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0203.03"), identification();
        station_number: U32 = 4, "Station Number", uid("0203.04"), values(&STATION_BITMAP);
        power_command: U8 = 5, "Power Command", uid("0203.05"), values(&STORES_POWER_CMD);
        active_weapon_mode_command: U8 = 6, "Active Weapon Mode Command", uid("0203.06"), values(&WEAPON_MODE_CMD);
        active_target_acquisition_mode_select: U8 = 7, "Active Target Acquisition Mode Select",
            uid("0203.07"), values(&TARGET_ACQUISITION_MODE);
        active_attack_mode: U8 = 8, "Active Attack Mode", uid("0203.08"), values(&ATTACK_MODE);
        rack_rail_ejector_enable: U8 = 9, "Rack/Rail Ejector Enable (Hung Ordnance)",
            uid("0203.09"), values(&EJECTOR_CMD);
        safety_enable_discrete_command: U8 = 10, "Safety Enable Discrete Command",
            uid("0203.10"), values(&SAFETY_DISCRETE);
        set_target_latitude: F64 = 11, "Set Target Latitude",
            uid("0203.11"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2);
        set_target_longitude: F64 = 12, "Set Target Longitude", uid("0203.12"), unit("rad"), range(-PI, PI);
        set_target_altitude: F32 = 13, "Set Target Altitude", uid("0203.13"), unit("m"), range(-1000.0, 100000.0);
        target_altitude_type: U8 = 14, "Target Altitude Type", uid("0203.14"), values(&ALTITUDE_TYPE);
        set_target_inertial_speed: F32 = 15, "Set Target Inertial Speed (Vx)",
            uid("0203.15"), unit("m/s"), range(-1000.0, 1000.0);
        set_target_inertial_speed_2: F32 = 16, "Set Target Inertial Speed (Vy)",
            uid("0203.16"), unit("m/s"), range(-1000.0, 1000.0);
        set_target_inertial_speed_2_2: F32 = 17, "Set Target Inertial Speed (Vz)",
            uid("0203.17"), unit("m/s"), range(-1000.0, 1000.0);
    }

    CommunicationsRelayCommand = 204, "Communications Relay Command"
        sent(ToVsm, Push) latency_ms(1000) loi(&[3])
        text("4.1.3.5", "B1-39")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0204.01"), unit("s since 1970");
        vehicle_id: I32 = 2, "Vehicle ID", uid("0204.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0204.03"), identification();
        station_number: U32 = 4, "Station Number", uid("0204.04"), values(&STATION_BITMAP);
        set_relay_state: U8 = 5, "Set Relay State", uid("0204.05"), values(&RELAY_STATE);
    }

    PayloadDataRecorderControlCommand = 205, "Payload Data Recorder Control Command"
        sent(ToVsm, Push) latency_ms(1000) loi(&[3])
        text("4.1.3.6", "B1-40")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0205.01"), unit("s since 1970");
        vehicle_id: I32 = 2, "Vehicle ID", uid("0205.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0205.03"), identification();
        recording_device_number: U8 = 4, "Recording Device Number", uid("0205.04"), range(0.0, 255.0);
        set_recording_index_type: U8 = 5, "Set Recording Index Type", uid("0205.05"), values(&RECORDING_INDEX_CMD);
        set_recording_mode: U8 = 6, "Set Recording Mode", uid("0205.06"), values(&RECORDING_MODE_CMD);
        set_recording_rate: F32 = 7, "Set Recording Rate", uid("0205.07"), unit("Mbit/s"), range(0.001, 40000.0);
        initial_recording_index: I32 = 8, "Initial Recording Index",
            uid("0205.08"), range(0.0, 2147483647.0), note("0 = no active index");
        set_replay_mode: U8 = 9, "Set Replay Mode", uid("0205.09"), values(&REPLAY_MODE_CMD);
        replay_clock_rate: F32 = 10, "Replay Clock Rate", uid("0205.10"), unit("Mbit/s"), range(0.001, 40000.0);
        seek_replay_index: I32 = 11, "Seek Replay Index",
            uid("0205.11"), range(0.0, 2147483647.0), note("0 = no active index");
    }

    PayloadBayCommand = 206, "Payload Bay Command"
        sent(ToVsm, Push) latency_ms(2000) loi(&[3])
        text("4.1.3.7", "B1-41")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0206.01"), unit("s since 1970");
        vehicle_id: I32 = 2, "Vehicle ID", uid("0206.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0206.03"), identification();
        station_number: U32 = 4, "Station Number", uid("0206.04"), values(&STATION_BITMAP);
        payload_bay_doors: U8 = 5, "Payload Bay Doors", uid("0206.05"), values(&BAY_DOORS);
    }

    TerrainDataUpdate = 207, "Terrain Data Update"
        sent(ToVsm, Push) latency_ms(2000) loi(&[2, 3])
        text("4.1.3.8", "B1-42")
        note("no Edition 1 number is printed")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0207.01"), unit("s since 1970");
        vehicle_id: I32 = 2, "Vehicle ID", uid("0207.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0207.03"), identification();
        latitude_of_terrain_data_point: F64 = 4, "Latitude of Terrain Data Point",
            uid("0207.04"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2),
            note("Amendment 1: unique id printed as 207.04");
        longitude_of_terrain_data_point: F64 = 5, "Longitude of Terrain Data Point",
            uid("0207.05"), unit("rad"), range(-PI, PI);
        elevation_of_terrain_data_point: F32 = 6, "Elevation of Terrain Data Point",
            uid("0207.06"), unit("m"), range(-1000.0, 100000.0), note("above the WGS-84 'geoid'");
    }

    PayloadConfiguration = 300, "Payload Configuration"
        sent(ToCucs, PushPull) latency_ms(1000) loi(&[2, 3])
        text("4.1.3.9", "B1-43") ed4(&[21000])
        note("one message for each station in use, at start and on every change; the CUCS asks with #1403 during configuration")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0300.01"), unit("s since 1970"), ed4(21000, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0300.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0300.03"), identification();
        vsm_id: I32 = 4, "VSM ID", uid("0300.04"), identification(), ed4(21000, 2);
        payload_stations_available: U32 = 5, "Payload Stations Available",
            uid("0300.05"), values(&STATION_BITMAP), ed4(21000, 3);
        station_number: U32 = 6, "Station Number",
            uid("0300.06"), values(&STATION_BITMAP), ed4(21000, 4), note("the station described");
        payload_type: U16 = 7, "Payload Type", uid("0300.07"), values(&PAYLOAD_TYPE), ed4(21000, 5);
        station_door: U8 = 8, "Station Door", uid("0300.08"), values(&NO_YES), ed4(21000, 6);
        number_of_payload_recording_devices: U8 = 9, "Number of Payload Recording Devices",
            uid("0300.09"), range(0.0, 255.0), ed4(21000, 7);
    }

    EoIrConfigurationState = 301, "EO/IR Configuration State"
        sent(ToCucs, Pull) latency_ms(200) loi(&[2, 3])
        text("4.1.3.10", "B1-44") ed4(&[21100])
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0301.01"), unit("s since 1970"), ed4(21100, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0301.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0301.03"), identification();
        vsm_id: I32 = 4, "VSM ID", uid("0301.04"), identification(), ed4(21100, 2);
        station_number: U32 = 5, "Station Number", uid("0301.05"), values(&STATION_BITMAP), ed4(21100, 3);
        eo_ir_type: Char(14) = 6, "EO/IR Type", uid("0301.06"), ed4(21100, 4), note("NATO stock number, 13 digits");
        eo_ir_type_revision_level: U8 = 7, "EO/IR Type Revision Level",
            uid("0301.07"), range(0.0, 255.0), ed4(21100, 5);
        eo_vertical_image_dimension: I16 = 8, "EO Vertical Image Dimension",
            uid("0301.08"), range(0.0, 32767.0), ed4(21100, 6), note("pixel rows; 0 = off");
        eo_horizontal_image_dimension: I16 = 9, "EO Horizontal Image Dimension",
            uid("0301.09"), range(0.0, 32767.0), ed4(21100, 7), note("pixel columns; 0 = off");
        ir_vertical_image_dimension: I16 = 10, "IR Vertical Image Dimension",
            uid("0301.10"), range(0.0, 32767.0), ed4(21100, 8), note("pixel rows; 0 = off");
        ir_horizontal_image_dimension: I16 = 11, "IR Horizontal Image Dimension",
            uid("0301.11"), range(0.0, 32767.0), ed4(21100, 9), note("pixel columns; 0 = off");
        field_of_regard_elevation_min: F32 = 12, "Field of Regard - Elevation Min",
            uid("0301.12"), unit("rad"), range(-PI, PI), ed4(21100, 10);
        field_of_regard_elevation_max: F32 = 13, "Field of Regard - Elevation Max",
            uid("0301.13"), unit("rad"), range(-PI, PI), ed4(21100, 11);
        field_of_regard_azimuth_min: F32 = 14, "Field of Regard - Azimuth Min",
            uid("0301.14"), unit("rad"), range(-PI, PI), ed4(21100, 12);
        field_of_regard_azimuth_max: F32 = 15, "Field of Regard - Azimuth Max",
            uid("0301.15"), unit("rad"), range(-PI, PI), ed4(21100, 13);
    }

    EoIrLaserOperatingState = 302, "EO/IR/Laser Operating State"
        sent(ToCucs, PushPull) latency_ms(2000) loi(&[2, 3])
        text("4.1.3.11", "B1-45") ed4(&[21101])
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0302.01"), unit("s since 1970"), ed4(21101, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0302.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0302.03"), identification();
        station_number: U32 = 4, "Station Number", uid("0302.04"), values(&STATION_BITMAP), ed4(21101, 2);
        addressed_sensor: U8 = 5, "Addressed Sensor", uid("0302.05"), values(&ADDRESSED_SENSOR), ed4(21101, 3);
        system_operating_mode_state: U8 = 6, "System Operating Mode State",
            uid("0302.06"), values(&EOIR_SYSTEM_MODE), ed4(21101, 4);
        eo_camera_status: U8 = 7, "EO Camera Status", uid("0302.07"), values(&EO_MODE), ed4(21101, 5);
        ir_polarity_status: U8 = 8, "IR Polarity Status", uid("0302.08"), values(&IR_POLARITY), ed4(21101, 6);
        image_output_state: U8 = 9, "Image Output State", uid("0302.09"), values(&IMAGE_OUTPUT), ed4(21101, 7);
        actual_centreline_elevation_angle: F32 = 10, "Actual Centreline Elevation Angle",
            uid("0302.10"), unit("rad"), range(-PI, PI), ed4(21101, 8), note("above the waterline +");
        actual_vertical_field_of_view: F32 = 11, "Actual Vertical Field of View",
            uid("0302.11"), unit("rad"), range(0.0, TAU), ed4(21101, 9);
        actual_centreline_azimuth_angle: F32 = 12, "Actual Centreline Azimuth Angle",
            uid("0302.12"), unit("rad"), range(-PI, PI), ed4(21101, 10), note("right of the x axis +");
        actual_horizontal_field_of_view: F32 = 13, "Actual Horizontal Field of View",
            uid("0302.13"), unit("rad"), range(0.0, TAU), ed4(21101, 11);
        actual_sensor_rotation_angle: F32 = 14, "Actual Sensor Rotation Angle",
            uid("0302.14"), unit("rad"), range(-PI, PI), ed4(21101, 12), note("clockwise from aircraft up +");
        image_position: U8 = 15, "Image Position", uid("0302.15"), values(&IMAGE_POSITION), ed4(21101, 13);
        latitude_of_image_centre: F64 = 16, "Latitude of Image Centre",
            uid("0302.16"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2), ed4(21101, 14);
        longitude_of_image_centre: F64 = 17, "Longitude of Image Centre",
            uid("0302.17"), unit("rad"), range(-PI, PI), ed4(21101, 15);
        altitude: F32 = 18, "Altitude",
            uid("0302.18"), unit("m"), range(-1000.0, 100000.0), ed4(21101, 16),
            note("of the image centre above the WGS-84 'geoid'");
        pointing_mode_state: U8 = 19, "Pointing Mode State",
            uid("0302.19"), values(&EOIR_POINTING_MODE), ed4(21101, 17);
        preplan_mode: U8 = 20, "Preplan Mode", uid("0302.20"), values(&PREPLAN_MODE), ed4(21101, 18);
        reported_range: F32 = 21, "Reported Range",
            uid("0302.21"), unit("m"), range(0.0, 100000.0), ed4(21101, 19), note("0 = not valid");
        fire_laser_pointer_rangefinder_status: U8 = 22, "Fire Laser Pointer/Rangefinder Status",
            uid("0302.22"), values(&LASER_FIRE_STATUS), ed4(21101, 20);
        selected_laser_rangefinder_first_last_pulse: U8 = 23, "Selected Laser Rangefinder First/Last Pulse",
            uid("0302.23"), values(&FIRST_LAST_PULSE), ed4(21101, 22);
        laser_designator_code: U16 = 24, "Laser Designator Code",
            uid("0302.24"), ed4(21101, 23), note("illuminator code of STANAG 5516 (Link 16)");
        laser_designator_status: U8 = 25, "Laser Designator Status",
            uid("0302.25"), values(&LASER_DESIGNATOR_STATUS), ed4(21101, 24);
    }

    SarOperatingState = 303, "SAR Operating State"
        sent(ToCucs, Pull) latency_ms(2000) loi(&[2, 3])
        text("4.1.3.12", "B1-46")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0303.01"), unit("s since 1970");
        vehicle_id: I32 = 2, "Vehicle ID", uid("0303.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0303.03"), identification();
        station_number: U32 = 4, "Station Number", uid("0303.04"), values(&STATION_BITMAP);
        sar_type: Char(14) = 5, "SAR Type", uid("0303.05"), note("NATO stock number, 13 digits");
        sar_type_revision_level: U8 = 6, "SAR Type Revision Level",
            uid("0303.06"), range(0.0, 255.0), note("unit cell says enumerated, but it is a plain number");
        radar_operating_mode: Char(5) = 7, "Radar Operating Mode",
            uid("0303.07"), note("code of the NSIF registry (AEDP-4 Annex D)");
        radar_operating_status: U8 = 8, "Radar Operating Status", uid("0303.08"), values(&RADAR_STATUS);
        radar_mti_mode_status: U8 = 9, "Radar MTI Mode Status", uid("0303.09"), values(&MTI_MODE);
        resolution_current_pixel_resolution_of_sar_product: F32 = 10, "Resolution - Current Pixel Resolution of SAR Product",
            uid("0303.10"), unit("m"), range(1.0, 100.0), note("0 = unknown");
        current_field_of_view_elevation_min: F32 = 11, "Current Field of View - Elevation Min",
            uid("0303.11"), unit("rad"), range(-PI, PI), note("above the body x axis");
        current_field_of_view_elevation_max: F32 = 12, "Current Field of View - Elevation Max",
            uid("0303.12"), unit("rad"), range(-PI, PI), note("above the body x axis");
        current_field_of_view_azimuth_min: F32 = 13, "Current Field of View - Azimuth Min",
            uid("0303.13"), unit("rad"), range(-PI, PI), note("right of the body x axis");
        current_field_of_view_azimuth_max: F32 = 14, "Current Field of View - Azimuth Max",
            uid("0303.14"), unit("rad"), range(-PI, PI), note("right of the body x axis");
    }

    StoresManagementSystemStatus = 304, "Stores Management System Status"
        sent(ToCucs, Pull) latency_ms(1000) loi(&[2, 3])
        text("3.1.3.13", "B1-47")
        note("the clause is misnumbered 3.1.3.13")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0304.01"), unit("s since 1970");
        vehicle_id: I32 = 2, "Vehicle ID", uid("0304.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0304.03"), identification();
        station_number: U32 = 4, "Station Number", uid("0304.04"), values(&STATION_BITMAP);
        active_weapon_type: U8 = 5, "Active Weapon Type", uid("0304.05"), values(&WEAPON_TYPE);
        active_weapon_sensors: U8 = 6, "Active Weapon Sensors", uid("0304.06"), values(&WEAPON_SENSORS);
        active_weapon_number_per_station: U8 = 7, "Active Weapon Number per Station",
            uid("0304.07"), range(0.0, 255.0), note("0 = none selected");
        active_target_acquisition_mode: U8 = 8, "Active Target Acquisition Mode",
            uid("0304.08"), values(&TARGET_ACQUISITION_MODE), note("0 here reads no mode");
        active_attack_mode: U8 = 9, "Active Attack Mode",
            uid("0304.09"), values(&ATTACK_MODE), note("0 here reads no mode");
        weapon_initialising: U8 = 10, "Weapon Initialising", uid("0304.10"), values(&WEAPON_INITIALISING);
        weapon_release_clearance: U8 = 11, "Weapon Release Clearance", uid("0304.11"), values(&CLEARANCE);
        clearance_validity: U8 = 12, "Clearance Validity", uid("0304.12"), values(&CLEARANCE);
        weapon_power_state: U8 = 13, "Weapon Power State", uid("0304.13"), values(&WEAPON_POWER);
        weapon_status: U8 = 14, "Weapon Status", uid("0304.14"), values(&WEAPON_STATUS);
        rack_rail_ejector_unlock: U8 = 15, "Rack/Rail/Ejector Unlock",
            uid("0304.15"), values(&EJECTOR_STATE), note("the values run against the name");
        safety_enable_discrete_state: U8 = 16, "Safety Enable Discrete State",
            uid("0304.16"), values(&SAFETY_DISCRETE);
        launch_acceptable_region_status: U8 = 17, "Launch Acceptable Region (LAR) Status",
            uid("0304.17"), values(&LAR_STATUS);
        safe_separation_status: U8 = 18, "Safe Separation Status (Weapon)",
            uid("0304.18"), values(&SEPARATION_STATUS);
        number_of_stores_available: U8 = 19, "Number of Stores Available",
            uid("0304.19"), range(0.0, 255.0), note("0 = empty or N/A; 255 = 255 or more");
    }

    CommunicationsRelayStatus = 305, "Communications Relay Status"
        sent(ToCucs, Pull) latency_ms(1000) loi(&[2, 3])
        text("4.1.3.14", "B1-48")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0305.01"), unit("s since 1970");
        vehicle_id: I32 = 2, "Vehicle ID", uid("0305.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0305.03"), identification();
        station_number: U32 = 4, "Station Number", uid("0305.04"), values(&STATION_BITMAP);
        report_relay_state: U8 = 5, "Report Relay State", uid("0305.05"), values(&RELAY_STATE);
    }

    PayloadDataRecorderStatus = 306, "Payload Data Recorder Status"
        sent(ToCucs, Pull) latency_ms(1000) loi(&[2, 3])
        text("4.1.3.15", "B1-49")
        note("only on request; record and replay states are independent")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0306.01"), unit("s since 1970");
        vehicle_id: I32 = 2, "Vehicle ID", uid("0306.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0306.03"), identification();
        recording_device_number: U8 = 4, "Recording Device Number", uid("0306.04"), range(0.0, 255.0);
        active_index_type: U8 = 5, "Active Index Type", uid("0306.05"), values(&RECORDING_INDEX_TYPE);
        recording_status: U8 = 6, "Recording Status", uid("0306.06"), values(&RECORDING_STATUS);
        record_rate: F32 = 7, "Record Rate", uid("0306.07"), unit("Mbit/s"), range(0.001, 40000.0);
        current_recording_index: I32 = 8, "Current Recording Index",
            uid("0306.08"), range(0.0, 2147483647.0), note("0 = no active index");
        record_index_time_stamp: F64 = 9, "Record Index Time Stamp",
            uid("0306.09"), unit("s since 1970"), note("of the event, or the start of the block or session");
        replay_status: U8 = 10, "Replay Status", uid("0306.10"), values(&REPLAY_STATUS);
        replay_rate: F32 = 11, "Replay Rate", uid("0306.11"), unit("Mbit/s"), range(0.001, 40000.0);
        current_replay_index: I32 = 12, "Current Replay Index",
            uid("0306.12"), range(0.0, 2147483647.0), note("0 = no active index");
        health_status_code: I16 = 13, "Health Status Code", uid("0306.13"), note("range recorder specific");
    }

    VehiclePayloadRecorderConfiguration = 307, "Vehicle Payload/Recorder Configuration"
        sent(ToCucs, Pull) latency_ms(2000) loi(&[3])
        text("4.1.3.16", "B1-50")
        note("once for each payload-recorder connection")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0307.01"), unit("s since 1970");
        vehicle_id: I32 = 2, "Vehicle ID", uid("0307.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0307.03"), identification();
        station_number: U32 = 4, "Station Number", uid("0307.04"), values(&STATION_BITMAP);
        payload_recorder: U8 = 5, "Payload Recorder", uid("0307.05"), range(0.0, 255.0);
    }

    PayloadBayStatus = 308, "Payload Bay Status"
        sent(ToCucs, Pull) latency_ms(2000) loi(&[3])
        text("4.1.3.17", "B1-51")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0308.01"), unit("s since 1970");
        vehicle_id: I32 = 2, "Vehicle ID", uid("0308.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0308.03"), identification();
        station_number: U32 = 4, "Station Number", uid("0308.04"), values(&STATION_BITMAP);
        payload_bay_door_status: U8 = 5, "Payload Bay Door Status", uid("0308.05"), values(&BAY_DOORS);
    }
}
