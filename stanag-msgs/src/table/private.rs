//! Private messages of this project: curve legs (50001, 50002), and what MAVLink has and STANAG 4586 lacks (50010 to 50018):
//! parameters, software versions, ping, areas that the vehicle stays inside or outside, and zeroize (50024). None is sent unsolicited.

use std::f64::consts::FRAC_PI_2;

use super::codec::messages;
use crate::enums::{
    AltitudeType, AreaPlanMode, AreaType, MissionTransferStatus, ParameterKind, PingTarget,
};
use crate::id::Id;
use crate::scalar::{Altitude, Bam32, Text, TimeStamp, U24};

messages! {
    CurveSegmentPaper = 50001, "Curve Segment (paper)", presence bytes 2
        sent(Both, PushPull) own_definition() latency_ms(1000)
        source("the project's source paper, its table of the private message, in an Edition 4 wrapper")
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
        sent(Both, PushPull) own_definition() latency_ms(1000)
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

    ParameterRequest = 50010, "Parameter Request", presence bytes 1
        sent(ToVsm, Push) own_definition() latency_ms(1000)
        note("answered by 50012: one parameter, or all if no name is given")
    {
        time_stamp: TimeStamp = 0, "Time Stamp";
        parameter_name: Text<17> = 1, "Parameter Name", note("absent or empty: all");
    }

    ParameterSetCommand = 50011, "Parameter Set Command", presence bytes 1
        sent(ToVsm, Push) own_definition() latency_ms(1000)
        note("refused outside the range reported by 50012; carried out once the vehicle reports the new value")
    {
        time_stamp: TimeStamp = 0, "Time Stamp";
        parameter_name: Text<17> = 1, "Parameter Name";
        commanded_value: f64 = 2, "Commanded Value", note("a whole number where the parameter is an integer");
        activity_id: U24 = 3, "Activity ID";
    }

    ParameterReport = 50012, "Parameter Report", presence bytes 1
        sent(ToCucs, Pull) own_definition() latency_ms(1000)
        note("in answer to 50010 and 50011, and on a change to those that requested the parameter")
    {
        time_stamp: TimeStamp = 0, "Time Stamp";
        parameter_name: Text<17> = 1, "Parameter Name";
        parameter_kind: ParameterKind = 2, "Parameter Kind";
        value: f64 = 3, "Value";
        minimum: f64 = 4, "Minimum", note("absent: only its kind bounds it");
        maximum: f64 = 5, "Maximum", note("absent: only its kind bounds it");
        parameter_index: u16 = 6, "Parameter Index", note("within an answer that lists all parameters, from 0");
        parameter_count: u16 = 7, "Parameter Count", note("number of parameters in an answer that lists all");
    }

    SoftwareVersionReport = 50013, "Software Version Report", presence bytes 1
        sent(ToCucs, Pull) own_definition() latency_ms(1000)
        note("requested by 17002")
    {
        time_stamp: TimeStamp = 0, "Time Stamp";
        vsm_version: Text<20> = 1, "VSM Version";
        autopilot_version: Text<20> = 2, "Autopilot Version", note("such as 1.18.0-beta");
        autopilot_source: Text<17> = 3, "Autopilot Source", note("first bytes of the hash of its source, hexadecimal");
        board_version: u32 = 4, "Board Version";
        hardware_id: Text<17> = 5, "Hardware ID", note("hexadecimal");
    }

    PingRequest = 50014, "Ping Request", presence bytes 1
        sent(ToVsm, Push) own_definition() latency_ms(1000)
    {
        time_stamp: TimeStamp = 0, "Time Stamp";
        ping_number: u32 = 1, "Ping Number", note("returned in the answer");
        ping_target: PingTarget = 2, "Ping Target", note("absent: the VSM");
    }

    PingResponse = 50015, "Ping Response", presence bytes 1
        sent(ToCucs, Pull) own_definition() latency_ms(1000)
    {
        time_stamp: TimeStamp = 0, "Time Stamp";
        ping_number: u32 = 1, "Ping Number";
        ping_target: PingTarget = 2, "Ping Target";
        request_time_stamp: TimeStamp = 3, "Request Time Stamp", note("of the 50014");
        vehicle_round_trip: f32 = 4, "Vehicle Round Trip",
            unit("s"), note("from the VSM to the vehicle and back; absent if the VSM itself was the target");
    }

    AreaVertex = 50016, "Area Vertex", presence bytes 1
        sent(Both, PushPull) own_definition() latency_ms(1000)
        note("one corner of a polygon, or the centre of a circle; in any order, loaded by 50017")
    {
        time_stamp: TimeStamp = 0, "Time Stamp";
        area_id: u16 = 1, "Area ID", note("chosen by the CUCS");
        area_type: AreaType = 2, "Area Type";
        vertex_count: u8 = 3, "Vertex Count", note("of the area: 3 or more for a polygon, 1 for a circle");
        vertex_number: u8 = 4, "Vertex Number", note("from 1");
        latitude: Bam32 = 5, "Latitude", range(-FRAC_PI_2, FRAC_PI_2);
        longitude: Bam32 = 6, "Longitude";
        radius: f32 = 7, "Radius", unit("m"), note("of a circle");
    }

    AreaTransferCommand = 50017, "Area Transfer Command", presence bytes 1
        sent(ToVsm, Push) own_definition() latency_ms(1000)
        note("answered by 50018")
    {
        time_stamp: TimeStamp = 0, "Time Stamp";
        area_plan_mode: AreaPlanMode = 1, "Area Plan Mode";
        activity_id: U24 = 2, "Activity ID";
    }

    AreaTransferStatus = 50018, "Area Transfer Status", presence bytes 1
        sent(ToCucs, Push) own_definition() latency_ms(2000)
    {
        time_stamp: TimeStamp = 0, "Time Stamp";
        area_plan_mode: AreaPlanMode = 1, "Area Plan Mode";
        status: MissionTransferStatus = 2, "Status";
        area_id: u16 = 3, "Area ID", note("what a refusal is about");
        vertex_number: u8 = 4, "Vertex Number", note("what a refusal is about");
    }
}
