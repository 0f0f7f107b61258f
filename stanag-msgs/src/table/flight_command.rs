//! Commands to the flight vehicle: 2000 to 2017.

use std::f64::consts::FRAC_PI_2;

use super::codec::messages;
use crate::enums::{
    AltitudeChangeBehaviour, AltitudeCommandType, AltitudeType, CommandedEngineState,
    FlightPathControlMode, FlyingBehaviour, FtMode, FtState, HeadingCommandType, HeadingReference,
    LightsBitmap, LoiterDirection, LoiterDurationUnits, LoiterLengthUnits, LoiterType,
    OffOnNotspec, ReverseThrust, SpeedType,
};
use crate::scalar::{
    Altitude, AngularRate, Bam16, Bam32, Distance, FineAngularRate, InitialEnergy, Pressure, Speed,
    TimeStamp, U24, Velocity,
};

messages! {
    VehicleConfigurationCommand = 2000, "Vehicle Configuration Command", presence bytes 1
        sent(ToVsm, Push) layout(Ed4, A) latency_ms(1000) table("4-42") ed2_message("40")
        source("T+K")
        corroboration("T+K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0040.01");
        energy_storage_unit: u8 = 1, "Energy Storage Unit", uid("2000.01");
        initial_propulsion_energy: InitialEnergy = 2, "Initial Propulsion Energy",
            uid("0040.04"), conf(C), note("T: 0.002; every other energy percentage is 0.0016: doubtful");
    }

    FlightTerminationCommand = 2005, "Flight Termination Command", presence bytes 1
        sent(ToVsm, Push) layout(Ed2Derived, C) latency_ms(500) table("4-43?") ed2_message("46")
        source("E2 #46; the id 2005 is inferred from 3005 = report and from table order")
        note("must be sent twice, state 1 then 2, to execute. Ed4 probably appends Activity ID (u24).")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0046.01");
        commanded_flight_termination_state: FtState = 1, "Commanded Flight Termination State",
            uid("0046.04");
        flight_termination_mode: FtMode = 2, "Flight Termination Mode", uid("0046.05");
    }

    UnmannedAircraftLights = 2007, "Unmanned Aircraft Lights", presence bytes 1
        sent(ToVsm, Push) layout(Ed4, A) latency_ms(1000) table("4-44") ed2_message("44")
        source("T")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0044.01");
        set_lights: LightsBitmap = 1, "Set Lights", uid("0044.04");
        activity_id: U24 = 2, "Activity ID";
    }

    EngineCommand = 2008, "Engine Command", presence bytes 1
        sent(ToVsm, Push) layout(Ed4, A) latency_ms(100) table("4-45") ed2_message("45")
        source("T")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0045.01");
        engine_number: u8 = 1, "Engine Number",
            uid("0045.04"), note("Ed2 Integer 4; 3007 uses u16");
        engine_command: CommandedEngineState = 2, "Engine Command", uid("0045.05");
        reverse_thrust_power: OffOnNotspec = 3, "Reverse Thrust Power";
        reverse_thrust: ReverseThrust = 4, "Reverse Thrust";
        ignition_switch_power: OffOnNotspec = 5, "Ignition Switch Power";
        ignition_switch_activation: OffOnNotspec = 6, "Ignition Switch Activation";
        activity_id: U24 = 7, "Activity ID";
    }

    UaStickCommand = 2010, "UA Stick Command", presence bytes 2
        sent(ToVsm, Push) layout(Ed4, A) latency_ms(50) table("4-47")
        source("T")
        note("stick scaling (percent of travel, -100..100 / 0..100?) not found")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("2010.01");
        lateral_stick: i8 = 1, "Lateral Stick", uid("2010.02");
        longitudinal_stick: i8 = 2, "Longitudinal Stick", uid("2010.03");
        rotational_stick_rudder: i8 = 3, "Rotational Stick (Rudder)", uid("2010.04");
        throttle_stick_engine_1: u8 = 4, "Throttle Stick - Engine 1", uid("2010.05");
        pitch_stick_engine_1: i8 = 5, "Pitch Stick - Engine 1", uid("2010.06");
        throttle_stick_engine_2: u8 = 6, "Throttle Stick - Engine 2", uid("2010.07");
        pitch_stick_engine_2: i8 = 7, "Pitch Stick - Engine 2", uid("2010.08");
        throttle_stick_engine_3: u8 = 8, "Throttle Stick - Engine 3", uid("2010.09");
        pitch_stick_engine_3: i8 = 9, "Pitch Stick - Engine 3", uid("2010.10");
        throttle_stick_engine_4: u8 = 10, "Throttle Stick - Engine 4", uid("2010.11");
        pitch_stick_engine_4: i8 = 11, "Pitch Stick - Engine 4", uid("2010.12");
        taxi_stick: i8 = 12, "Taxi Stick",
            uid("2010.13"), conf(C), note("in T, absent in K's 3011");
    }

    VehicleOperatingModeCommand = 2016, "Vehicle Operating Mode Command", presence bytes 3
        sent(ToVsm, Push) layout(Ed4, A) latency_ms(100) table("4-53") ed2_message("42+43")
        source("T; semantics of 0042/0043 fields from E2")
        note("Ed4 merges Ed2 #42 (mode) and #43 (steering); the separate steering command and mode preference command are gone (no table between 3002 and 3004, one table between 2000 and 2007)")
    {
        time_stamp: TimeStamp = 0, "Time Stamp";
        select_flight_path_control_mode: FlightPathControlMode = 1, "Select Flight Path Control Mode",
            uid("0042.04");
        altitude_command_type: AltitudeCommandType = 2, "Altitude Command Type", uid("0043.04");
        commanded_altitude: Altitude = 3, "Commanded Altitude", uid("0043.05");
        commanded_vertical_speed: Velocity = 4, "Commanded Vertical Speed", uid("0043.06");
        heading_command_type: HeadingCommandType = 5, "Heading Command Type", uid("0043.07");
        heading_reference: HeadingReference = 6, "Heading Reference";
        commanded_heading: Bam16 = 7, "Commanded Heading", uid("0043.08");
        commanded_course: Bam16 = 8, "Commanded Course", uid("0043.09");
        commanded_turn_rate: FineAngularRate = 9, "Commanded Turn Rate",
            uid("0043.10"), conf(C), note("T says 0.005; E3 text of the twin field 0104.08 says 0.0001");
        commanded_roll_rate: AngularRate = 10, "Commanded Roll Rate", uid("0043.11");
        commanded_roll: Bam16 = 11, "Commanded Roll", uid("0043.12");
        commanded_speed: Speed = 12, "Commanded Speed", uid("0043.13");
        speed_type: SpeedType = 13, "Speed Type", uid("0043.14");
        commanded_waypoint_number: u16 = 14, "Commanded Waypoint Number", uid("0043.15");
        altimeter_setting: Pressure = 15, "Altimeter Setting", uid("0043.16");
        altitude_type: AltitudeType = 16, "Altitude Type", uid("0043.17");
        loiter_position_latitude: Bam32 = 17, "Loiter Position Latitude",
            uid("0043.18"), range(-FRAC_PI_2, FRAC_PI_2);
        loiter_position_longitude: Bam32 = 18, "Loiter Position Longitude", uid("0043.19");
        loiter_altitude_change_behaviour: AltitudeChangeBehaviour = 19, "Loiter Altitude Change Behaviour";
        thrust_direction: Bam16 = 20, "Thrust Direction";
        thrust: u8 = 21, "Thrust", unit("%");
        activity_id: U24 = 22, "Activity ID";
    }

    LoiterConfiguration = 2017, "Loiter Configuration", presence bytes 2
        sent(ToVsm, Push) layout(Ed4, A) latency_ms(100) table("4-54") ed2_message("41")
        source("T; order equals K's 3004/13003 pattern")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0041.01");
        loiter_type: LoiterType = 1, "Loiter Type", uid("0041.04");
        loiter_radius: Distance = 2, "Loiter Radius", uid("0041.05");
        loiter_length: Distance = 3, "Loiter Length",
            uid("0041.06"), note("metres when Loiter Length Units says distance");
        loiter_length_units: LoiterLengthUnits = 4, "Loiter Length Units";
        loiter_bearing: Bam16 = 5, "Loiter Bearing", uid("0041.07");
        loiter_direction: LoiterDirection = 6, "Loiter Direction", uid("0041.08");
        flying_behaviour: FlyingBehaviour = 7, "Flying Behaviour";
        loiter_duration: u16 = 8, "Loiter Duration";
        loiter_duration_units: LoiterDurationUnits = 9, "Loiter Duration Units";
        activity_id: U24 = 10, "Activity ID";
    }
}
