//! Status that payloads need too: 4000 and 4001.

use std::f64::consts::FRAC_PI_2;

use super::info::Confidence::A;
use super::info::Direction::ToCucs;
use super::info::Layout::Ed4;
use super::info::Traffic::Push;
use super::info::{FieldInfo, MessageInfo};
use super::macros::messages;
use crate::codec::{DataReader, DataWriter, DecodeError, EncodeError};
use crate::enums::{AltitudeType, SpeedType};
use crate::scalar::{
    Acceleration, Altitude, AngularRate, Bam16, Bam32, Speed, TimeStamp, Velocity,
};

messages! {
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
