//! Flight commands: 40 to 48.

use std::f64::consts::{FRAC_PI_2, PI};

use super::rows::messages;
use crate::ed25::values::{
    ALTITUDE_COMMAND_TYPE, ALTITUDE_TYPE, ENGINE_COMMAND, FLIGHT_PATH_CONTROL_MODE, FT_MODE,
    FT_STATE, HEADING_COMMAND_TYPE, LIGHTS_BITMAP, LOITER_DIRECTION, LOITER_TYPE, MODE_PREFERENCE,
    SPEED_TYPE,
};
use crate::field::Wire::{Char, F32, F64, I32, U8, U16};

messages! {
    VehicleConfigurationCommand = 40, "Vehicle Configuration Command"
        sent(ToVsm, Push) latency_ms(2000) loi(&[4])
        text("4.1.2.1", "B1-13") ed4(&[2000])
        note("initial state of the vehicle, usually before launch; sent on every configuration change")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0040.01"), unit("s since 1970"), ed4(2000, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0040.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0040.03"), identification();
        initial_propulsion_energy: F32 = 4, "Initial Propulsion Energy",
            uid("0040.04"), unit("%"), ed4(2000, 3), note("range as configured; of the maximum usable energy");
    }

    LoiterConfiguration = 41, "Loiter Configuration"
        sent(ToVsm, Push) latency_ms(2000) loi(&[4])
        text("4.1.2.2", "B1-14") ed4(&[2017])
        note("pattern for flight mode 12; the loiter point comes with #43; altitude and speed here count only when #48 says 'configuration'")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0041.01"), unit("s since 1970"), ed4(2017, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0041.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0041.03"), identification();
        loiter_type: U8 = 4, "Loiter Type", uid("0041.04"), values(&LOITER_TYPE), ed4(2017, 2);
        loiter_radius: F32 = 5, "Loiter Radius",
            uid("0041.05"), unit("m"), range(1.0, 100000.0), ed4(2017, 3),
            note("circle radius, or radius of the half circles at both ends");
        loiter_length: F32 = 6, "Loiter Length",
            uid("0041.06"), unit("m"), range(1.0, 100000.0), ed4(2017, 4),
            note("racetrack and figure 8: length along the bearing, centred on the loiter point; figure B1-7 draws it between the centres of the end circles");
        loiter_bearing: F32 = 7, "Loiter Bearing",
            uid("0041.07"), unit("rad"), range(-PI, PI), ed4(2017, 6), note("of the pattern, from true north");
        loiter_direction: U8 = 8, "Loiter Direction", uid("0041.08"), values(&LOITER_DIRECTION), ed4(2017, 7);
        loiter_altitude: F32 = 9, "Loiter Altitude", uid("0041.09"), unit("m"), range(-1000.0, 100000.0);
        altitude_type: U8 = 10, "Altitude Type", uid("0041.10"), values(&ALTITUDE_TYPE);
        loiter_speed: F32 = 11, "Loiter Speed", uid("0041.11"), unit("m/s"), range(0.0, 10000.0);
        speed_type: U8 = 12, "Speed Type", uid("0041.12"), values(&SPEED_TYPE);
    }

    VehicleOperatingModeCommand = 42, "Vehicle Operating Mode Command"
        sent(ToVsm, Push) latency_ms(1000) loi(&[4])
        text("4.1.2.3", "B1-15") ed4(&[2016])
        note("the flight mode; echoed by #106; configured by the VSM to the authorised LOI")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0042.01"), unit("s since 1970"), ed4(2016, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0042.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0042.03"), identification();
        select_flight_path_control_mode: U8 = 4, "Select Flight Path Control Mode",
            uid("0042.04"), values(&FLIGHT_PATH_CONTROL_MODE), ed4(2016, 2);
    }

    VehicleSteeringCommand = 43, "Vehicle Steering Command"
        sent(ToVsm, Push) latency_ms(1000) loi(&[4])
        text("4.1.2.4", "B1-16") ed4(&[2016])
        note("a new flight vector at once, from manual input; which fields count depends on #42, #48 and the two command types")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0043.01"), unit("s since 1970"), ed4(2016, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0043.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0043.03"), identification();
        altitude_command_type: U8 = 4, "Altitude Command Type",
            uid("0043.04"), values(&ALTITUDE_COMMAND_TYPE), ed4(2016, 3);
        commanded_altitude: F32 = 5, "Commanded Altitude",
            uid("0043.05"), unit("m"), range(-1000.0, 100000.0), ed4(2016, 4),
            note("ignored for altitude command type 2; clearance distance in flight mode 16");
        commanded_vertical_speed: F32 = 6, "Commanded Vertical Speed",
            uid("0043.06"), unit("m/s"), range(-1000.0, 1000.0), ed4(2016, 5),
            note("value for type 2, limit for type 3, ignored for type 1; sign not stated");
        heading_command_type: U8 = 7, "Heading Command Type",
            uid("0043.07"), values(&HEADING_COMMAND_TYPE), ed4(2016, 6);
        commanded_heading: F32 = 8, "Commanded Heading",
            uid("0043.08"), unit("rad"), range(-PI, PI), ed4(2016, 8), note("heading types 1 and 3");
        commanded_course: F32 = 9, "Commanded Course",
            uid("0043.09"), unit("rad"), range(-PI, PI), ed4(2016, 9), note("heading types 2 and 3");
        commanded_turn_rate: F32 = 10, "Commanded Turn Rate",
            uid("0043.10"), unit("rad/s"), ed4(2016, 10),
            note("range as configured; heading types 1, 2, 3 and 5; 0 = default rate of the vehicle, except for type 5");
        commanded_roll_rate: F32 = 11, "Commanded Roll Rate",
            uid("0043.11"), unit("rad/s"), ed4(2016, 11),
            note("range as configured; heading type 4; 0 = default rate");
        commanded_roll: F32 = 12, "Commanded Roll",
            uid("0043.12"), unit("rad"), range(-PI, PI), ed4(2016, 12), note("heading type 4");
        commanded_speed: F32 = 13, "Commanded Speed", uid("0043.13"), unit("m/s"), range(0.0, 10000.0), ed4(2016, 13);
        speed_type: U8 = 14, "Speed Type", uid("0043.14"), values(&SPEED_TYPE), ed4(2016, 14);
        commanded_waypoint_number: U16 = 15, "Commanded Waypoint Number",
            uid("0043.15"), range(1.0, 65535.0), ed4(2016, 15), note("waypoint of #802; Amendment 1: 1..<65535");
        altimeter_setting: F32 = 16, "Altimeter Setting",
            uid("0043.16"), unit("Pa"), range(0.0, 107500.0), ed4(2016, 16),
            note("sea level pressure, for barometric altitude");
        altitude_type: U8 = 17, "Altitude Type", uid("0043.17"), values(&ALTITUDE_TYPE), ed4(2016, 17);
        loiter_position_latitude: F64 = 18, "Loiter Position Latitude",
            uid("0043.18"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2), ed4(2016, 18), note("manual loiter point");
        loiter_position_longitude: F64 = 19, "Loiter Position Longitude",
            uid("0043.19"), unit("rad"), range(-PI, PI), ed4(2016, 19);
    }

    AirVehicleLights = 44, "Air Vehicle Lights"
        sent(ToVsm, Push) latency_ms(500) loi(&[4])
        text("4.1.2.5", "B1-17") ed4(&[2007])
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0044.01"), unit("s since 1970"), ed4(2007, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0044.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0044.03"), identification();
        set_lights: U16 = 4, "Set Lights",
            uid("0044.04"), values(&LIGHTS_BITMAP), ed4(2007, 2), note("set = on, clear = off");
    }

    EngineCommand = 45, "Engine Command"
        sent(ToVsm, Push) latency_ms(500) loi(&[4])
        text("4.1.2.6", "B1-18") ed4(&[2008])
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0045.01"), unit("s since 1970"), ed4(2008, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0045.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0045.03"), identification();
        engine_number: I32 = 4, "Engine Number",
            uid("0045.04"), ed4(2008, 2), note("range as configured; id of the engine commanded");
        engine_command: U8 = 5, "Engine Command", uid("0045.05"), values(&ENGINE_COMMAND), ed4(2008, 3);
    }

    FlightTerminationCommand = 46, "Flight Termination Command"
        sent(ToVsm, Push) latency_ms(500) loi(&[4])
        text("4.1.2.7", "B1-19") ed4(&[2005])
        note("takes two messages: arm, then execute")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0046.01"), unit("s since 1970"), ed4(2005, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0046.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0046.03"), identification();
        commanded_flight_termination_state: U8 = 4, "Commanded Flight Termination State",
            uid("0046.04"), values(&FT_STATE), ed4(2005, 2);
        flight_termination_mode: U8 = 5, "Flight Termination Mode", uid("0046.05"), values(&FT_MODE), ed4(2005, 3);
    }

    RelativeRouteWaypointAbsoluteReferenceMessage = 47, "Relative Route/Waypoint Absolute Reference Message"
        sent(ToVsm, Push) latency_ms(1000) loi(&[3, 4])
        text("4.1.2.8", "B1-20")
        note("origin and orientation for relative routes (moving platforms, route templates); needed before such a route is flown, repeated when it moves; the table heads the number column 'Position'")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0047.01"), unit("s since 1970");
        vehicle_id: I32 = 2, "Vehicle ID", uid("0047.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0047.03"), identification();
        latitude: F64 = 4, "Latitude (Y-axis zero)", uid("0047.04"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2);
        longitude: F64 = 5, "Longitude (X-axis zero)", uid("0047.05"), unit("rad"), range(-PI, PI);
        altitude_type: U8 = 6, "Altitude Type", uid("0047.06"), values(&ALTITUDE_TYPE);
        altitude: F32 = 7, "Altitude", uid("0047.07"), unit("m"), range(-1000.0, 100000.0);
        orientation: F32 = 8, "Orientation",
            uid("0047.08"), unit("rad"), range(-PI, PI), note("heading of the Y axis");
        route_id: Char(20) = 9, "Route ID",
            uid("0047.09"), note("empty = all routes; only 20 octets although the route id of #801 has 33");
    }

    ModePreferenceCommand = 48, "Mode Preference Command"
        sent(ToVsm, Push) latency_ms(2000) loi(&[4])
        text("4.1.2.9", "B1-21")
        note("for altitude, speed and course: take the demand from the configuration message of the flight mode (#41, #802) or from #43; tables B1-22 and B1-23 give the source for each mode")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0048.01"), unit("s since 1970");
        vehicle_id: I32 = 2, "Vehicle ID", uid("0048.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0048.03"), identification();
        altitude_mode: U8 = 4, "Altitude Mode", uid("0048.04"), values(&MODE_PREFERENCE);
        speed_mode: U8 = 5, "Speed Mode", uid("0048.05"), values(&MODE_PREFERENCE);
        course_heading_mode: U8 = 6, "Course/Heading Mode", uid("0048.06"), values(&MODE_PREFERENCE);
    }
}
