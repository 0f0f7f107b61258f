//! Flight status: 100 to 110.

use std::f64::consts::{FRAC_PI_2, PI};

use super::rows::messages;
use crate::ed25::values::{
    ALTITUDE_COMMAND_TYPE, ALTITUDE_TYPE, ENGINE_COMMAND, ENGINE_STATUS, FLIGHT_PATH_CONTROL_MODE,
    FT_MODE, FT_STATE, GAUGE_STATUS, HEADING_COMMAND_TYPE, LANDING_GEAR_STATE, LIGHTS_BITMAP,
    MODE_PREFERENCE, SPEED_TYPE,
};
use crate::field::Wire::{F32, F64, I8, I16, I32, U8, U16, U32};

messages! {
    VehicleConfiguration = 100, "Vehicle Configuration"
        sent(ToCucs, Pull) latency_ms(10000) loi(&[4])
        text("4.1.2.10", "B1-24") ed4(&[3000])
        note("performance data for flight planning, by type or for the current load")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0100.01"), unit("s since 1970"), ed4(3000, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0100.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0100.03"), identification();
        vsm_id: I32 = 4, "VSM ID", uid("0100.04"), identification();
        configuration_id: U32 = 5, "Configuration ID",
            uid("0100.05"), range(0.0, 4294967295.0), ed4(3000, 2), note("maker's number of the configuration");
        propulsion_fuel_capacity: F32 = 6, "Propulsion Fuel Capacity",
            uid("0100.06"), unit("kg"), ed4(3000, 3), note("range as configured; negative = not applicable");
        propulsion_battery_capacity: F32 = 7, "Propulsion Battery Capacity",
            uid("0100.07"), unit("J"), ed4(3000, 4), note("range as configured; negative = not applicable");
        maximum_indicated_airspeed: F32 = 8, "Maximum Indicated Airspeed",
            uid("0100.08"), unit("m/s"), ed4(3000, 5), note("range as configured; never exceed");
        optimum_cruise_indicated_airspeed: F32 = 9, "Optimum Cruise Indicated Airspeed",
            uid("0100.09"), unit("m/s"), ed4(3000, 6), note("range as configured");
        optimum_endurance_indicated_airspeed: F32 = 10, "Optimum Endurance Indicated Airspeed",
            uid("0100.10"), unit("m/s"), ed4(3000, 7), note("range as configured");
        maximum_load_factor: F32 = 11, "Maximum Load Factor",
            uid("0100.11"), unit("m/s^2"), ed4(3000, 8),
            note("range as configured; an acceleration, although called load factor");
        gross_weight: F32 = 12, "Gross Weight",
            uid("0100.12"), unit("kg"), ed4(3000, 9), note("range as configured; with the fuel now on board");
        x_cg: F32 = 13, "X_CG",
            uid("0100.13"), unit("m"), ed4(3000, 10), note("range as configured; aft of the nose");
        number_of_engines: U8 = 14, "Number of Engines", uid("0100.14"), range(0.0, 255.0), ed4(3000, 11);
    }

    InertialStates = 101, "Inertial States"
        sent(ToCucs, Push) latency_ms(1000) loi(&[2, 3, 4])
        text("4.1.2.11", "B1-25") ed4(&[4000])
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0101.01"), unit("s since 1970"), ed4(4000, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0101.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0101.03"), identification();
        latitude: F64 = 4, "Latitude", uid("0101.04"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2), ed4(4000, 2);
        longitude: F64 = 5, "Longitude", uid("0101.05"), unit("rad"), range(-PI, PI), ed4(4000, 3);
        altitude: F32 = 6, "Altitude", uid("0101.06"), unit("m"), range(-1000.0, 100000.0), ed4(4000, 4);
        altitude_type: U8 = 7, "Altitude Type",
            uid("0101.07"), values(&ALTITUDE_TYPE), ed4(4000, 5), note("here value 3 is glossed 'geoid'");
        u_speed: F32 = 8, "U_Speed",
            uid("0101.08"), unit("m/s"), range(-10000.0, 10000.0), ed4(4000, 6), note("true north");
        v_speed: F32 = 9, "V_Speed",
            uid("0101.09"), unit("m/s"), range(-10000.0, 10000.0), ed4(4000, 7), note("true east");
        w_speed: F32 = 10, "W_Speed",
            uid("0101.10"), unit("m/s"), range(-10000.0, 10000.0), ed4(4000, 8), note("down");
        u_accel: F32 = 11, "U_Accel",
            uid("0101.11"), unit("m/s^2"), range(-100.0, 100.0), ed4(4000, 9), note("true north");
        v_accel: F32 = 12, "V_Accel",
            uid("0101.12"), unit("m/s^2"), range(-100.0, 100.0), ed4(4000, 10), note("true east");
        w_accel: F32 = 13, "W_Accel",
            uid("0101.13"), unit("m/s^2"), range(-100.0, 100.0), ed4(4000, 11), note("down");
        phi: F32 = 14, "Phi", uid("0101.14"), unit("rad"), range(-PI, PI), ed4(4000, 12), note("roll (Euler)");
        theta: F32 = 15, "Theta",
            uid("0101.15"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2), ed4(4000, 13), note("pitch (Euler)");
        psi: F32 = 16, "Psi",
            uid("0101.16"), unit("rad"), range(-PI, PI), ed4(4000, 14), note("yaw (Euler); heading");
        phi_dot: F32 = 17, "Phi_dot",
            uid("0101.17"), unit("rad/s"), range(-1000.0, 1000.0), ed4(4000, 15), note("roll rate (Euler)");
        theta_dot: F32 = 18, "Theta_dot",
            uid("0101.18"), unit("rad/s"), range(-1000.0, 1000.0), ed4(4000, 16), note("pitch rate (Euler)");
        psi_dot: F32 = 19, "Psi_dot",
            uid("0101.19"), unit("rad/s"), range(-1000.0, 1000.0), ed4(4000, 17), note("yaw rate (Euler)");
        magnetic_variation: F32 = 20, "Magnetic Variation",
            uid("0101.20"), unit("rad"), range(-PI, PI), ed4(4000, 18), note("true = magnetic + variation");
    }

    AirAndGroundRelativeStates = 102, "Air and Ground Relative States"
        sent(ToCucs, Push) latency_ms(1000) loi(&[4])
        text("4.1.2.12", "B1-26") ed4(&[3009])
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0102.01"), unit("s since 1970"), ed4(3009, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0102.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0102.03"), identification();
        angle_of_attack: F32 = 4, "Angle of Attack", uid("0102.04"), unit("rad"), range(-PI, PI), ed4(3009, 2);
        angle_of_sideslip: F32 = 5, "Angle of Sideslip", uid("0102.05"), unit("rad"), range(-PI, PI), ed4(3009, 3);
        true_airspeed: F32 = 6, "True Airspeed", uid("0102.06"), unit("m/s"), range(0.0, 10000.0), ed4(3009, 4);
        indicated_airspeed: F32 = 7, "Indicated Airspeed",
            uid("0102.07"), unit("m/s"), range(0.0, 10000.0), ed4(3009, 5);
        outside_air_temp: F32 = 8, "Outside Air Temp", uid("0102.08"), unit("K"), range(172.15, 372.15), ed4(3009, 6);
        u_wind: F32 = 9, "U_Wind",
            uid("0102.09"), unit("m/s"), range(-10000.0, 10000.0), ed4(3009, 7), note("true north");
        v_wind: F32 = 10, "V_Wind",
            uid("0102.10"), unit("m/s"), range(-10000.0, 10000.0), ed4(3009, 8), note("true east");
        altimeter_setting: F32 = 11, "Altimeter Setting",
            uid("0102.11"), unit("Pa"), range(0.0, 107500.0), ed4(3009, 9);
        barometric_altitude: F32 = 12, "Barometric Altitude",
            uid("0102.12"), unit("m"), range(-1000.0, 100000.0), ed4(3009, 10), note("from the altimeter setting");
        barometric_altitude_rate: F32 = 13, "Barometric Altitude Rate",
            uid("0102.13"), unit("m/s"), range(-1000.0, 1000.0), ed4(3009, 11), note("up positive");
        pressure_altitude: F32 = 14, "Pressure Altitude",
            uid("0102.14"), unit("m"), range(-1000.0, 100000.0), ed4(3009, 12);
        agl_altitude: F32 = 15, "AGL Altitude", uid("0102.15"), unit("m"), range(-1000.0, 100000.0), ed4(3009, 13);
        wgs_84_altitude: F32 = 16, "WGS-84 Altitude",
            uid("0102.16"), unit("m"), range(-1000.0, 100000.0), ed4(3009, 14);
        u_ground: F32 = 17, "U_Ground",
            uid("0102.17"), unit("m/s"), range(-10000.0, 10000.0), ed4(3009, 15), note("true north");
        v_ground: F32 = 18, "V_Ground",
            uid("0102.18"), unit("m/s"), range(-10000.0, 10000.0), ed4(3009, 16), note("true east");
    }

    BodyRelativeSensedStates = 103, "Body-Relative Sensed States"
        sent(ToCucs, Push) latency_ms(200) loi(&[4])
        text("4.1.2.13", "B1-27") ed4(&[3010])
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0103.01"), unit("s since 1970"), ed4(3010, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0103.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0103.03"), identification();
        x_body_accel: F32 = 4, "X_Body_Accel",
            uid("0103.04"), unit("m/s^2"), range(-100.0, 100.0), ed4(3010, 2), note("forward +");
        y_body_accel: F32 = 5, "Y_Body_Accel",
            uid("0103.05"), unit("m/s^2"), range(-100.0, 100.0), ed4(3010, 3), note("right +");
        z_body_accel: F32 = 6, "Z_Body_Accel",
            uid("0103.06"), unit("m/s^2"), range(-100.0, 100.0), ed4(3010, 4), note("down +");
        roll_rate: F32 = 7, "Roll_Rate", uid("0103.07"), unit("rad/s"), range(-100.0, 100.0), ed4(3010, 5);
        pitch_rate: F32 = 8, "Pitch_Rate", uid("0103.08"), unit("rad/s"), range(-100.0, 100.0), ed4(3010, 6);
        yaw_rate: F32 = 9, "Yaw_Rate", uid("0103.09"), unit("rad/s"), range(-100.0, 100.0), ed4(3010, 7);
    }

    VehicleOperatingStates = 104, "Vehicle Operating States"
        sent(ToCucs, PushPull) latency_ms(1000) loi(&[4])
        text("4.1.2.14", "B1-28") ed4(&[3002])
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0104.01"), unit("s since 1970"), ed4(3002, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0104.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0104.03"), identification();
        commanded_altitude: F32 = 4, "Commanded Altitude",
            uid("0104.04"), unit("m"), range(-1000.0, 100000.0), ed4(3002, 2);
        altitude_type: U8 = 5, "Altitude Type", uid("0104.05"), values(&ALTITUDE_TYPE), ed4(3002, 3);
        commanded_heading: F32 = 6, "Commanded Heading", uid("0104.06"), unit("rad"), range(-PI, PI), ed4(3002, 4);
        commanded_course: F32 = 7, "Commanded Course", uid("0104.07"), unit("rad"), range(-PI, PI), ed4(3002, 5);
        commanded_turn_rate: F32 = 8, "Commanded Turn Rate",
            uid("0104.08"), unit("rad/s"), ed4(3002, 6), note("range as configured");
        commanded_roll_rate: F32 = 9, "Commanded Roll Rate",
            uid("0104.09"), unit("rad/s"), ed4(3002, 7), note("range as configured");
        commanded_speed: F32 = 10, "Commanded Speed", uid("0104.10"), unit("m/s"), range(0.0, 10000.0), ed4(3002, 8);
        speed_type: U8 = 11, "Speed Type",
            uid("0104.11"), values(&SPEED_TYPE), ed4(3002, 9), note("0 here reads indicated or calibrated");
        power_level: I16 = 12, "Power Level",
            uid("0104.12"), unit("%"), ed4(3002, 10),
            note("range as configured; mean throttle of all engines, nominally 0..110");
        flap_deployment_angle: I8 = 13, "Flap Deployment Angle",
            uid("0104.13"), unit("rad"), scale(0.02), range(-FRAC_PI_2, FRAC_PI_2);
        speed_brake_deployment_angle: I8 = 14, "Speed Brake Deployment Angle",
            uid("0104.14"), unit("rad"), scale(0.02), range(-FRAC_PI_2, FRAC_PI_2);
        landing_gear_state: U8 = 15, "Landing Gear State", uid("0104.15"), values(&LANDING_GEAR_STATE);
        current_propulsion_energy_level: F32 = 16, "Current Propulsion Energy Level",
            uid("0104.16"), unit("%"), range(0.0, 100.0), ed4(3002, 12), note("of the maximum usable energy");
        current_propulsion_energy_usage_rate: F32 = 17, "Current Propulsion Energy Usage Rate",
            uid("0104.17"), unit("%/s"), ed4(3002, 13), note("range as configured; consumption");
        commanded_roll: F32 = 18, "Commanded Roll", uid("0104.18"), unit("rad"), range(-PI, PI), ed4(3002, 14);
        altitude_command_type: U8 = 19, "Altitude Command Type",
            uid("0104.19"), values(&ALTITUDE_COMMAND_TYPE), ed4(3002, 15);
        heading_command_type: U8 = 20, "Heading Command Type",
            uid("0104.20"), values(&HEADING_COMMAND_TYPE), ed4(3002, 16);
    }

    EngineOperatingStates = 105, "Engine Operating States"
        sent(ToCucs, PushPull) latency_ms(500) loi(&[4])
        text("4.1.2.15", "B1-29") ed4(&[3007])
        note("one message for each engine")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0105.01"), unit("s since 1970"), ed4(3007, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0105.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0105.03"), identification();
        engine_number: I32 = 4, "Engine Number", uid("0105.04"), ed4(3007, 2), note("range as configured");
        engine_status: U8 = 5, "Engine Status", uid("0105.05"), values(&ENGINE_STATUS), ed4(3007, 3);
        reported_engine_command: U8 = 6, "Reported Engine Command",
            uid("0105.06"), values(&ENGINE_COMMAND), ed4(3007, 4);
        engine_power_setting: F32 = 7, "Engine Power Setting",
            uid("0105.07"), unit("%"), range(0.0, 110.0), ed4(3007, 9);
        engine_speed: F32 = 8, "Engine Speed", uid("0105.08"), unit("rad/s"), range(0.0, 21000.0), ed4(3007, 11);
        engine_speed_status: U8 = 9, "Engine Speed Status", uid("0105.09"), values(&GAUGE_STATUS);
        output_power_status: U8 = 10, "Output Power (Shaft Torque) Status",
            uid("0105.10"), values(&GAUGE_STATUS), ed4(3007, 17);
        engine_body_temperature_status: U8 = 11, "Engine Body Temperature Status",
            uid("0105.11"), values(&GAUGE_STATUS), ed4(3007, 34),
            note("cylinder head temperature for piston engines");
        exhaust_gas_temperature_status: U8 = 12, "Exhaust Gas Temperature Status",
            uid("0105.12"), values(&GAUGE_STATUS), ed4(3007, 35);
        coolant_temperature_status: U8 = 13, "Coolant Temperature Status",
            uid("0105.13"), values(&GAUGE_STATUS), ed4(3007, 36);
        lubricant_pressure_status: U8 = 14, "Lubricant Pressure Status", uid("0105.14"), values(&GAUGE_STATUS);
        lubricant_temperature_status: U8 = 15, "Lubricant Temperature Status",
            uid("0105.15"), values(&GAUGE_STATUS), ed4(3007, 37);
        fire_detection_sensor_status: U8 = 16, "Fire Detection Sensor Status",
            uid("0105.16"), values(&GAUGE_STATUS), ed4(3007, 32);
    }

    VehicleOperatingModeReport = 106, "Vehicle Operating Mode Report"
        sent(ToCucs, PushPull) latency_ms(2000) loi(&[4])
        text("4.1.2.16", "B1-30") ed4(&[3001])
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0106.01"), unit("s since 1970"), ed4(3001, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0106.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0106.03"), identification();
        select_flight_path_control_mode: U8 = 4, "Select Flight Path Control Mode",
            uid("0106.04"), values(&FLIGHT_PATH_CONTROL_MODE), ed4(3001, 2), note("as commanded with #42");
    }

    VehicleLightsState = 107, "Vehicle Lights State"
        sent(ToCucs, Push) latency_ms(500) loi(&[4])
        text("4.1.2.17", "B1-31") ed4(&[3006])
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0107.01"), unit("s since 1970"), ed4(3006, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0107.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0107.03"), identification();
        navigation_lights_state: U16 = 4, "Navigation Lights State",
            uid("0107.04"), values(&LIGHTS_BITMAP), ed4(3006, 2), note("set = on");
    }

    FlightTerminationModeReport = 108, "Flight Termination Mode Report"
        sent(ToCucs, PushPull) latency_ms(2000) loi(&[4])
        text("4.1.2.18", "B1-32") ed4(&[3005])
        note("answers #46 and reports every change")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0108.01"), unit("s since 1970"), ed4(3005, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0108.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0108.03"), identification();
        reported_flight_termination_state: U8 = 4, "Reported Flight Termination State",
            uid("0108.04"), values(&FT_STATE), ed4(3005, 2);
        reported_flight_termination_mode: U8 = 5, "Reported Flight Termination Mode",
            uid("0108.05"), values(&FT_MODE), ed4(3005, 3);
    }

    ModePreferenceReport = 109, "Mode Preference Report"
        sent(ToCucs, Push) latency_ms(2000) loi(&[4])
        text("4.1.2.19", "B1-33")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0109.01"), unit("s since 1970");
        vehicle_id: I32 = 2, "Vehicle ID", uid("0109.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0109.03"), identification();
        altitude_mode_state: U8 = 4, "Altitude Mode State", uid("0109.04"), values(&MODE_PREFERENCE);
        speed_mode_state: U8 = 5, "Speed Mode State", uid("0109.05"), values(&MODE_PREFERENCE);
        course_heading_mode_state: U8 = 6, "Course/Heading Mode State", uid("0109.06"), values(&MODE_PREFERENCE);
    }

    FromToNextWaypointStates = 110, "From-To-Next Waypoint States"
        sent(ToCucs, Push) latency_ms(2000) loi(&[2, 3, 4])
        text("4.1.2.20", "B1-34") ed4(&[4001])
        note("number 0 marks a waypoint whose data is not valid; To is where the vehicle flies in modes 11, 12 and 22; From and Next in mode 11; a number of the VSM's own must not be that of a waypoint loaded with #802")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0110.01"), unit("s since 1970"), ed4(4001, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0110.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0110.03"), identification();
        altitude_type: U8 = 4, "Altitude Type", uid("0110.04"), values(&ALTITUDE_TYPE), ed4(4001, 2);
        speed_type: U8 = 5, "Speed Type", uid("0110.05"), values(&SPEED_TYPE), ed4(4001, 3);
        from_waypoint_latitude: F64 = 6, "From Waypoint - Latitude",
            uid("0110.06"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2), ed4(4001, 4);
        from_waypoint_longitude: F64 = 7, "From Waypoint - Longitude",
            uid("0110.07"), unit("rad"), range(-PI, PI), ed4(4001, 5);
        from_waypoint_altitude: F32 = 8, "From Waypoint Altitude",
            uid("0110.08"), unit("m"), range(-1000.0, 100000.0), ed4(4001, 6);
        from_waypoint_time: F64 = 9, "From Waypoint Time",
            uid("0110.09"), unit("s since 1970"), ed4(4001, 7), note("when it was reached");
        from_waypoint_number: U16 = 10, "From Waypoint Number",
            uid("0110.10"), range(0.0, 65535.0), ed4(4001, 8),
            note("0 = the From data is not valid; Amendment 1: 0..<65535");
        to_waypoint_latitude: F64 = 11, "To Waypoint - Latitude",
            uid("0110.11"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2), ed4(4001, 9);
        to_waypoint_longitude: F64 = 12, "To Waypoint - Longitude",
            uid("0110.12"), unit("rad"), range(-PI, PI), ed4(4001, 10);
        to_waypoint_altitude: F32 = 13, "To Waypoint Altitude",
            uid("0110.13"), unit("m"), range(-1000.0, 100000.0), ed4(4001, 11);
        to_waypoint_speed: F32 = 14, "To Waypoint Speed",
            uid("0110.14"), unit("m/s"), range(0.0, 10000.0), ed4(4001, 12);
        to_waypoint_time: F64 = 15, "To Waypoint Time",
            uid("0110.15"), unit("s since 1970"), ed4(4001, 13), note("when it will be reached, not a countdown");
        to_waypoint_number: U16 = 16, "To Waypoint Number",
            uid("0110.16"), range(0.0, 65534.0), ed4(4001, 14),
            note("0 = the To data is not valid; 65535 = valid, but no number (the range contradicts this); Amendment 1: 0..65535");
        next_waypoint_latitude: F64 = 17, "Next Waypoint - Latitude",
            uid("0110.17"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2), ed4(4001, 15);
        next_waypoint_longitude: F64 = 18, "Next Waypoint - Longitude",
            uid("0110.18"), unit("rad"), range(-PI, PI), ed4(4001, 16);
        next_waypoint_altitude: F32 = 19, "Next Waypoint Altitude",
            uid("0110.19"), unit("m"), range(-1000.0, 100000.0), ed4(4001, 17);
        next_waypoint_airspeed: F32 = 20, "Next Waypoint Airspeed",
            uid("0110.20"), unit("m/s"), range(0.0, 10000.0), ed4(4001, 18);
        next_waypoint_time: F64 = 21, "Next Waypoint Time",
            uid("0110.21"), unit("s since 1970"), ed4(4001, 19), note("when it will be reached, not a countdown");
        next_waypoint_number: U16 = 22, "Next Waypoint Number",
            uid("0110.22"), range(0.0, 65535.0), ed4(4001, 20),
            note("0 = the Next data is not valid; Amendment 1: 0..<65535");
    }
}
