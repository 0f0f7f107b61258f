//! Private messages of this project, the curve legs: 50001 and 50002.

use std::f64::consts::FRAC_PI_2;

use super::info::Confidence::A;
use super::info::Direction::Both;
use super::info::Layout::Ed4;
use super::info::Traffic::PushPull;
use super::info::{FieldInfo, MessageInfo};
use super::macros::messages;
use crate::codec::{DataReader, DataWriter, DecodeError, EncodeError};
use crate::enums::AltitudeType;
use crate::id::Id;
use crate::scalar::{Altitude, Bam32, TimeStamp, U24};

messages! {
    CurveSegmentPaper = 50001, "Curve Segment (paper)", presence bytes 2
        sent(Both, PushPull) layout(Ed4, A) latency_ms(1000)
        source("the project's source paper, its table of the private message, in an Edition 4 wrapper")
        corroboration("own definition")
        note("joins to Bezier control points P2, P3 the 13002 waypoints P1 and P4; Vehicle ID and CUCS ID must equal the wrapper's")
    {
        time_stamp: f64 = 0, "Time Stamp", unit("ms since 2000-01-01T00:00:00Z");
        vehicle_id: Id = 1, "Vehicle ID";
        cucs_id: Id = 2, "CUCS ID";
        p1_waypoint_no: u16 = 3, "P1 Waypoint No";
        p4_waypoint_no: u16 = 4, "P4 Waypoint No";
        p2_latitude: f64 = 5, "P2 Latitude", unit("rad"), range(-FRAC_PI_2, FRAC_PI_2);
        p2_longitude: f64 = 6, "P2 Longitude", unit("rad");
        p3_latitude: f64 = 7, "P3 Latitude", unit("rad"), range(-FRAC_PI_2, FRAC_PI_2);
        p3_longitude: f64 = 8, "P3 Longitude", unit("rad");
    }

    CurveSegment = 50002, "Curve Segment", presence bytes 2
        sent(Both, PushPull) layout(Ed4, A) latency_ms(1000)
        source("this project")
        corroboration("own definition")
        note("as 50001, in the scalars of Edition 4, with altitudes; absent altitudes: the leg climbs evenly along its length")
    {
        time_stamp: TimeStamp = 0, "Time Stamp";
        p1_waypoint_no: u16 = 1, "P1 Waypoint No";
        p4_waypoint_no: u16 = 2, "P4 Waypoint No";
        p2_latitude: Bam32 = 3, "P2 Latitude", range(-FRAC_PI_2, FRAC_PI_2);
        p2_longitude: Bam32 = 4, "P2 Longitude";
        p2_altitude: Altitude = 5, "P2 Altitude";
        p3_latitude: Bam32 = 6, "P3 Latitude", range(-FRAC_PI_2, FRAC_PI_2);
        p3_longitude: Bam32 = 7, "P3 Longitude";
        p3_altitude: Altitude = 8, "P3 Altitude";
        altitude_type: AltitudeType = 9, "Altitude Type";
        activity_id: U24 = 10, "Activity ID";
    }
}
