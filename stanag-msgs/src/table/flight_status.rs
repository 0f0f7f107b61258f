//! Status of the flight vehicle: 3000 to 3016, and 4000 and 4001, which payloads need too.

use std::f64::consts::FRAC_PI_2;

use super::codec::messages;
use crate::enums::{
    AltitudeChangeBehaviour, AltitudeCommandType, AltitudeType, CommandedEngineState, EngineStatus,
    FlightPathControlMode, FlyingBehaviour, FtMode, FtState, GaugeStatus, HeadingCommandType,
    LightsBitmap, LoiterDirection, LoiterDurationUnits, LoiterLengthUnits, LoiterType,
    OffOnNotspec, ReverseThrust, SpeedType, UaState,
};
use crate::scalar::{
    Acceleration, Airspeed, Altitude, AngularRate, Bam16, Bam32, Distance, EnergyFlow, EnergyLevel,
    EnergyRate, EngineSpeed, FineAngularRate, PowerSetting, Pressure, SmallAngle, Speed,
    Temperature, Text, TimeStamp, Velocity,
};

messages! {
    VehicleConfiguration = 3000, "Vehicle Configuration", presence bytes 2
        sent(ToCucs, Pull) layout(Ed4, B) latency_ms(10000) table("4-57?") ed2_message("100")
        source("K; units E2")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0100.01");
        configuration_id: u32 = 1, "Configuration ID",
            uid("0100.05"), conf(C), width_inferred(), note("K declares 64 bit (would mean Unsigned 5); E2 Unsigned 4");
        propulsion_fuel_capacity: f32 = 2, "Propulsion Fuel Capacity",
            uid("0100.06"), unit("kg"), note("<0 not applicable");
        propulsion_battery_capacity: f32 = 3, "Propulsion Battery Capacity",
            uid("0100.07"), unit("J"), note("<0 not applicable");
        maximum_indicated_airspeed: u16 = 4, "Maximum Indicated Airspeed",
            uid("0100.08"), unit("m/s"), note("scale not found (0.5 or 0.05)");
        optimum_cruise_indicated_airspeed: u16 = 5, "Optimum Cruise Indicated Airspeed",
            uid("0100.09"), unit("m/s"), note("scale not found");
        optimum_endurance_indicated_airspeed: u16 = 6, "Optimum Endurance Indicated Airspeed",
            uid("0100.10"), unit("m/s"), note("scale not found");
        maximum_load_factor: u8 = 7, "Maximum Load Factor",
            uid("0100.11"), unit("m/s^2"), note("scale not found");
        gross_weight: f32 = 8, "Gross Weight", uid("0100.12"), unit("kg");
        x_cg: f32 = 9, "X_CG", uid("0100.13"), unit("m"), note("aft of nose");
        number_of_engines: u8 = 10, "Number of Engines", uid("0100.14");
        fuel_density: u8 = 11, "Fuel Density", uid("3000.01"), note("unit/scale not found");
    }

    VehicleOperatingModeReport = 3001, "Vehicle Operating Mode Report", presence bytes 1
        sent(ToCucs, PushPull) layout(Ed4, A) latency_ms(100) table("4-58") ed2_message("106")
        source("T+K")
        corroboration("T+K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0106.01");
        select_flight_path_control_mode: FlightPathControlMode = 1, "Select Flight Path Control Mode",
            uid("0106.04");
    }

    VehicleOperatingStates = 3002, "Vehicle Operating States", presence bytes 3
        sent(ToCucs, PushPull) layout(Ed4, A) latency_ms(500) table("4-59") ed2_message("104")
        source("T+K agree on all 24; first 19 also E3 text")
        corroboration("T+K all 24, E3 text first 19")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0104.01");
        commanded_altitude: Altitude = 1, "Commanded Altitude", uid("0104.04");
        altitude_type: AltitudeType = 2, "Altitude Type", uid("0104.05");
        commanded_heading: Bam16 = 3, "Commanded Heading", uid("0104.06");
        commanded_course: Bam16 = 4, "Commanded Course", uid("0104.07");
        commanded_turn_rate: FineAngularRate = 5, "Commanded Turn Rate",
            uid("0104.08"), conf(C), note("E3 text 0.0001; T 0.005");
        commanded_roll_rate: AngularRate = 6, "Commanded Roll Rate", uid("0104.09");
        commanded_speed: Speed = 7, "Commanded Speed", uid("0104.10");
        speed_type: SpeedType = 8, "Speed Type", uid("0104.11");
        power_level: i8 = 9, "Power Level", uid("0104.12"), unit("%");
        bingo_energy: EnergyLevel = 10, "Bingo Energy", uid("0104.21");
        current_propulsion_energy_level: EnergyLevel = 11, "Current Propulsion Energy Level",
            uid("0104.16");
        current_propulsion_energy_usage_rate: EnergyRate = 12, "Current Propulsion Energy Usage Rate",
            uid("0104.17");
        commanded_roll: Bam16 = 13, "Commanded Roll", uid("0104.18");
        altitude_command_type: AltitudeCommandType = 14, "Altitude Command Type", uid("0104.19");
        heading_command_type: HeadingCommandType = 15, "Heading Command Type", uid("0104.20");
        ua_state: UaState = 16, "UA State", uid("3002.01");
        thrust_direction: Bam16 = 17, "Thrust Direction", uid("3002.02");
        thrust: u8 = 18, "Thrust", uid("3002.03"), unit("%");
        loiter_waypoint_validity: u8 = 19, "Loiter & Waypoint Validity",
            uid("3002.04"), note("bitmap, bits not found");
        commanded_loiter_position_latitude: Bam32 = 20, "Commanded Loiter Position Latitude",
            uid("3002.05"), range(-FRAC_PI_2, FRAC_PI_2);
        commanded_loiter_position_longitude: Bam32 = 21, "Commanded Loiter Position Longitude",
            uid("3002.06");
        altitude_change_behaviour: AltitudeChangeBehaviour = 22, "Altitude Change Behaviour",
            uid("3004.02");
        commanded_waypoint_number: u16 = 23, "Commanded Waypoint Number", uid("3002.07");
    }

    LoiterConfigurationReport = 3004, "Loiter Configuration Report", presence bytes 2
        sent(ToCucs, PushPull) layout(Ed4, A) latency_ms(100) table("4-60")
        source("T+K agree on all 14")
        corroboration("T+K all 14")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("3004.06");
        loiter_type: LoiterType = 1, "Loiter Type", uid("3004.07");
        loiter_radius: Distance = 2, "Loiter Radius", uid("3004.08");
        loiter_length: Distance = 3, "Loiter Length", uid("3004.09");
        loiter_length_units: LoiterLengthUnits = 4, "Loiter Length Units", uid("3004.03");
        loiter_bearing: Bam16 = 5, "Loiter Bearing", uid("3004.10");
        loiter_direction: LoiterDirection = 6, "Loiter Direction", uid("3004.11");
        loiter_altitude: Altitude = 7, "Loiter Altitude", uid("3004.12");
        altitude_type: AltitudeType = 8, "Altitude Type", uid("3004.13");
        loiter_speed: Speed = 9, "Loiter Speed", uid("3004.14");
        speed_type: SpeedType = 10, "Speed Type", uid("3004.15");
        flying_behaviour: FlyingBehaviour = 11, "Flying Behaviour", uid("3004.01");
        loiter_duration: u16 = 12, "Loiter Duration", uid("3004.04");
        loiter_duration_units: LoiterDurationUnits = 13, "Loiter Duration Units", uid("3004.05");
    }

    FlightTerminationModeReport = 3005, "Flight Termination Mode Report", presence bytes 1
        sent(ToCucs, PushPull) layout(Ed4, B) latency_ms(2000) table("4-61?") ed2_message("108")
        source("K+E2")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0108.01");
        reported_flight_termination_state: FtState = 1, "Reported Flight Termination State",
            uid("0108.04");
        reported_flight_termination_mode: FtMode = 2, "Reported Flight Termination Mode",
            uid("0108.05");
    }

    VehicleLightsState = 3006, "Vehicle Lights State", presence bytes 1
        sent(ToCucs, Push) layout(Ed4, A) latency_ms(1000) table("4-62") ed2_message("107")
        source("T")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0107.01");
        navigation_lights_state: LightsBitmap = 1, "Navigation Lights State", uid("0107.04");
    }

    EngineOperatingStates = 3007, "Engine Operating States", presence bytes 5
        sent(ToCucs, PushPull) layout(Ed4, A) latency_ms(500) table("4-63") ed2_message("105")
        source("T+K agree on all 37 and on the 5-byte presence vector")
        corroboration("T+K all 37")
        note("one message per engine; Engine Speed/Temperature/Pressure Type enumerations not found")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0105.01");
        engine_number: u16 = 1, "Engine Number", uid("0105.04");
        engine_status: EngineStatus = 2, "Engine Status", uid("0105.05");
        reported_engine_command: CommandedEngineState = 3, "Reported Engine Command",
            uid("0105.06");
        reverse_thrust_power_status: OffOnNotspec = 4, "Reverse Thrust Power Status",
            uid("3007.01");
        reported_reverse_thrust: ReverseThrust = 5, "Reported Reverse Thrust", uid("3007.02");
        ignition_switch_power_status: OffOnNotspec = 6, "Ignition Switch Power Status",
            uid("3007.03");
        ignition_switch_activation: OffOnNotspec = 7, "Ignition Switch Activation", uid("3007.04");
        engine_power_setting: PowerSetting = 8, "Engine Power Setting", uid("0105.07");
        engine_speed_1_type: u8 = 9, "Engine Speed 1 Type", uid("3007.12");
        engine_speed_1: EngineSpeed = 10, "Engine Speed 1", uid("0105.08");
        engine_speed_2_type: u8 = 11, "Engine Speed 2 Type", uid("3007.13");
        engine_speed_2: EngineSpeed = 12, "Engine Speed 2", uid("3007.14");
        engine_speed_3_type: u8 = 13, "Engine Speed 3 Type", uid("3007.15");
        engine_speed_3: EngineSpeed = 14, "Engine Speed 3", uid("3007.16");
        propeller_pitch_angle: SmallAngle = 15, "Propeller Pitch Angle", uid("3007.25");
        output_power_shaft_torque_status: GaugeStatus = 16, "Output Power (Shaft Torque) Status",
            uid("0105.10");
        engine_temperature_1_type: u8 = 17, "Engine Temperature 1 Type", uid("3007.18");
        engine_temperature_1: Temperature = 18, "Engine Temperature 1";
        engine_temperature_2_type: u8 = 19, "Engine Temperature 2 Type", uid("3007.19");
        engine_temperature_2: Temperature = 20, "Engine Temperature 2", uid("3007.20");
        engine_temperature_3_type: u8 = 21, "Engine Temperature 3 Type", uid("3007.21");
        engine_temperature_3: Temperature = 22, "Engine Temperature 3", uid("3007.22");
        engine_temperature_4_type: u8 = 23, "Engine Temperature 4 Type", uid("3007.23");
        engine_temperature_4: Temperature = 24, "Engine Temperature 4", uid("3007.24");
        engine_pressure_1_type: u8 = 25, "Engine Pressure 1 Type", uid("3007.05");
        engine_pressure_1: Pressure = 26, "Engine Pressure 1", uid("3007.06");
        engine_pressure_1_status: GaugeStatus = 27, "Engine Pressure 1 Status", uid("3007.07");
        engine_pressure_2_type: u8 = 28, "Engine Pressure 2 Type", uid("3007.08");
        engine_pressure_2: Pressure = 29, "Engine Pressure 2", uid("3007.09");
        engine_pressure_2_status: GaugeStatus = 30, "Engine Pressure 2 Status", uid("3007.10");
        fire_detection_sensor_status: GaugeStatus = 31, "Fire Detection Sensor Status",
            uid("0105.16");
        engine_energy_flow: EnergyFlow = 32, "Engine Energy Flow",
            uid("3007.11"), conf(C), note("unit/scale from T only and implausible; K 32-bit holder");
        engine_body_temperature_status: GaugeStatus = 33, "Engine Body Temperature Status",
            uid("0105.11");
        exhaust_gas_temperature_status: GaugeStatus = 34, "Exhaust Gas Temperature Status",
            uid("0105.12");
        coolant_temperature_status: GaugeStatus = 35, "Coolant Temperature Status", uid("0105.13");
        lubricant_temperature_status: GaugeStatus = 36, "Lubricant Temperature Status",
            uid("0105.15");
    }

    AirAndGroundRelativeStates = 3009, "Air and Ground Relative States", presence bytes 2
        sent(ToCucs, Push) layout(Ed4, A) latency_ms(1000) table("4-65?") ed2_message("102")
        source("K (Ed4) + E3 text agree on all 16")
        corroboration("K+E3 text")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0102.01");
        angle_of_attack: Bam16 = 1, "Angle of Attack", uid("0102.04");
        angle_of_sideslip: Bam16 = 2, "Angle of Sideslip", uid("0102.05");
        true_airspeed: Airspeed = 3, "True Airspeed", uid("0102.06");
        indicated_airspeed: Airspeed = 4, "Indicated Airspeed", uid("0102.07");
        outside_air_temp: Temperature = 5, "Outside Air Temp", uid("0102.08");
        u_wind: Velocity = 6, "U_Wind", uid("0102.09"), note("true north");
        v_wind: Velocity = 7, "V_Wind", uid("0102.10"), note("true east");
        altimeter_setting: Pressure = 8, "Altimeter Setting", uid("0102.11");
        barometric_altitude: Altitude = 9, "Barometric Altitude", uid("0102.12");
        barometric_altitude_rate: Velocity = 10, "Barometric Altitude Rate",
            uid("0102.13"), note("up positive");
        pressure_altitude: Altitude = 11, "Pressure Altitude", uid("0102.14");
        agl_altitude: Altitude = 12, "AGL Altitude", uid("0102.15");
        wgs_84_altitude: Altitude = 13, "WGS-84 Altitude", uid("0102.16");
        u_ground: Velocity = 14, "U_Ground", uid("0102.17"), note("north");
        v_ground: Velocity = 15, "V_Ground", uid("0102.18"), note("east");
    }

    BodyRelativeSensedStates = 3010, "Body-Relative Sensed States", presence bytes 1
        sent(ToCucs, Push) layout(Ed4, A) latency_ms(200) table("4-66?") ed2_message("103")
        source("K + E3 text")
        corroboration("K+E3 text")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0103.01"), note("K labels the uids 3010.xx");
        x_body_accel: Acceleration = 1, "X_Body_Accel", uid("0103.04"), note("forward +");
        y_body_accel: Acceleration = 2, "Y_Body_Accel", uid("0103.05"), note("right +");
        z_body_accel: Acceleration = 3, "Z_Body_Accel", uid("0103.06"), note("down +");
        roll_rate: FineAngularRate = 4, "Roll_Rate", uid("0103.07");
        pitch_rate: FineAngularRate = 5, "Pitch_Rate", uid("0103.08");
        yaw_rate: FineAngularRate = 6, "Yaw_Rate", uid("0103.09");
    }

    UaStickStatus = 3011, "UA Stick Status", presence bytes 2
        sent(ToCucs, Push) layout(Ed4, A) latency_ms(50) table("4-67")
        source("T; K identical but without Taxi Stick")
        corroboration("T+K, except Taxi Stick (T only)")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("3011.01");
        lateral_stick: i8 = 1, "Lateral Stick", uid("3011.02");
        longitudinal_stick: i8 = 2, "Longitudinal Stick", uid("3011.03");
        rotational_stick_rudder: i8 = 3, "Rotational Stick (Rudder)", uid("3011.04");
        throttle_stick_engine_1: u8 = 4, "Throttle Stick - Engine 1", uid("3011.05");
        pitch_stick_engine_1: i8 = 5, "Pitch Stick - Engine 1", uid("3011.06");
        throttle_stick_engine_2: u8 = 6, "Throttle Stick - Engine 2", uid("3011.07");
        pitch_stick_engine_2: i8 = 7, "Pitch Stick - Engine 2", uid("3011.08");
        throttle_stick_engine_3: u8 = 8, "Throttle Stick - Engine 3", uid("3011.09");
        pitch_stick_engine_3: i8 = 9, "Pitch Stick - Engine 3", uid("3011.10");
        throttle_stick_engine_4: u8 = 10, "Throttle Stick - Engine 4", uid("3011.11");
        pitch_stick_engine_4: i8 = 11, "Pitch Stick - Engine 4", uid("3011.12");
        taxi_stick: i8 = 12, "Taxi Stick",
            uid("3011.13"), conf(C), note("in T, absent in K's 3011");
    }

    RelativeRouteWaypointLocationReport = 3016, "Relative Route/Waypoint Location Report", presence bytes 2
        sent(ToCucs, PushPull) layout(Ed4, B) latency_ms(1000) table("4-72?")
        source("K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("3016.01");
        route_slave_to_location_identifier: u8 = 1, "Route/Slave-to-Location Identifier",
            uid("3016.02");
        location_latitude_y_axis_zero: Bam32 = 2, "Location Latitude (Y-axis zero)",
            uid("3016.03"), range(-FRAC_PI_2, FRAC_PI_2);
        location_longitude_x_axis_zero: Bam32 = 3, "Location Longitude (X-axis zero)",
            uid("3016.04");
        location_altitude_type: AltitudeType = 4, "Location Altitude Type", uid("3016.05");
        location_altitude: Altitude = 5, "Location Altitude", uid("3016.06");
        orientation: Bam16 = 6, "Orientation", uid("3016.07");
        route_id: Text<33> = 7, "Route ID",
            uid("3016.08"), conf(C), width_inferred(), note("length: E2/PD100 #801 = 33, E2 #47 = 20");
        slave_to_location_offset: u32 = 8, "Slave to Location Offset",
            uid("3016.09"), conf(C), width_inferred(), note("u24 or u32");
        ua_relative_altitude_type: AltitudeType = 9, "UA Relative Altitude Type", uid("3016.10");
        ua_relative_altitude: Altitude = 10, "UA Relative Altitude", uid("3016.11");
        slave_to_location_looking_angle: Bam16 = 11, "Slave to Location Looking Angle",
            uid("3016.12");
    }

    InertialStates = 4000, "Inertial States", presence bytes 3
        sent(ToCucs, Push) layout(Ed4, A) latency_ms(500) table("4-73") ed2_message("101")
        source("T+K+E3 text agree on all 18")
        corroboration("T+K+E3 text")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0101.01");
        latitude: Bam32 = 1, "Latitude", uid("0101.04"), range(-FRAC_PI_2, FRAC_PI_2);
        longitude: Bam32 = 2, "Longitude", uid("0101.05");
        altitude: Altitude = 3, "Altitude", uid("0101.06");
        altitude_type: AltitudeType = 4, "Altitude Type", uid("0101.07");
        u_speed: Velocity = 5, "U_Speed", uid("0101.08"), note("true north");
        v_speed: Velocity = 6, "V_Speed", uid("0101.09"), note("true east");
        w_speed: Velocity = 7, "W_Speed", uid("0101.10"), note("down +");
        u_accel: Acceleration = 8, "U_Accel", uid("0101.11");
        v_accel: Acceleration = 9, "V_Accel", uid("0101.12");
        w_accel: Acceleration = 10, "W_Accel", uid("0101.13");
        roll: Bam16 = 11, "Roll", uid("0101.14");
        pitch: Bam16 = 12, "Pitch", uid("0101.15");
        heading: Bam16 = 13, "Heading", uid("0101.16");
        roll_rate: AngularRate = 14, "Roll Rate", uid("0101.17");
        pitch_rate: AngularRate = 15, "Pitch Rate", uid("0101.18");
        turn_rate: AngularRate = 16, "Turn Rate", uid("0101.19");
        magnetic_variation: Bam16 = 17, "Magnetic Variation",
            uid("0101.20"), note("true = magnetic + variation");
    }

    FromToNextWaypointStates = 4001, "From-To-Next Waypoint States", presence bytes 3
        sent(ToCucs, Push) layout(Ed4, A) latency_ms(500) table("4-74") ed2_message("110")
        source("T+K agree on all 21")
        corroboration("T+K")
        note("waypoint numbers used here must not collide with mission waypoint numbers except to report those")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0110.01");
        altitude_type: AltitudeType = 1, "Altitude Type", uid("0110.04");
        speed_type: SpeedType = 2, "Speed Type", uid("0110.05");
        from_waypoint_latitude: Bam32 = 3, "From Waypoint - Latitude",
            uid("0110.06"), range(-FRAC_PI_2, FRAC_PI_2);
        from_waypoint_longitude: Bam32 = 4, "From Waypoint - Longitude", uid("0110.07");
        from_waypoint_altitude: Altitude = 5, "From Waypoint Altitude", uid("0110.08");
        from_waypoint_time: TimeStamp = 6, "From Waypoint Time",
            uid("0110.09"), note("time reached");
        from_waypoint_number: u16 = 7, "From Waypoint Number",
            uid("0110.10"), note("0 = From data invalid");
        to_waypoint_latitude: Bam32 = 8, "To Waypoint - Latitude",
            uid("0110.11"), range(-FRAC_PI_2, FRAC_PI_2);
        to_waypoint_longitude: Bam32 = 9, "To Waypoint - Longitude", uid("0110.12");
        to_waypoint_altitude: Altitude = 10, "To Waypoint Altitude", uid("0110.13");
        to_waypoint_speed: Speed = 11, "To Waypoint Speed", uid("0110.14");
        to_waypoint_time: TimeStamp = 12, "To Waypoint Time",
            uid("0110.15"), note("ETA, not a countdown");
        to_waypoint_number: u16 = 13, "To Waypoint Number",
            uid("0110.16"), note("0 invalid; 65535 = valid data without a waypoint number");
        next_waypoint_latitude: Bam32 = 14, "Next Waypoint - Latitude",
            uid("0110.17"), range(-FRAC_PI_2, FRAC_PI_2);
        next_waypoint_longitude: Bam32 = 15, "Next Waypoint - Longitude", uid("0110.18");
        next_waypoint_altitude: Altitude = 16, "Next Waypoint Altitude", uid("0110.19");
        next_waypoint_speed: Speed = 17, "Next Waypoint Speed", uid("0110.20");
        next_waypoint_time: TimeStamp = 18, "Next Waypoint Time", uid("0110.21");
        next_waypoint_number: u16 = 19, "Next Waypoint Number", uid("0110.22"), note("0 invalid");
        loiter_configuration_report_validity_for_to_waypoint: u8 = 20, "Loiter Configuration Report Validity for To Waypoint",
            uid("0110.23"), note("values not found; presumably 0 not valid / 1 valid");
    }
}
