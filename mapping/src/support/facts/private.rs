//! Private messages: 50000 and up: curves, parameters, software versions, ping, areas.

use crate::support::row::{AS_RECEIVED, RECEIVED_STAMP, STAMP, facts};

facts! {
    50001 taken "stored as a curved leg of the plan, flown as chords after 13000, one NAV_WAYPOINT each" {
        "Vehicle ID": "refused unless the wrapper's";
        "CUCS ID": "refused unless the wrapper's";
        "P1 Waypoint No": "where the leg starts";
        "P4 Waypoint No": "where it ends";
        "P2 Latitude": "a control point";
        "P2 Longitude": "a control point";
        "P3 Latitude": "a control point";
        "P3 Longitude": "a control point";
    } sends "on download" {
        "Time Stamp": STAMP;
        "Vehicle ID": "the wrapper's";
        "CUCS ID": "the wrapper's";
        "P1 Waypoint No": AS_RECEIVED;
        "P4 Waypoint No": AS_RECEIVED;
        "P2 Latitude": AS_RECEIVED;
        "P2 Longitude": AS_RECEIVED;
        "P3 Latitude": AS_RECEIVED;
        "P3 Longitude": AS_RECEIVED;
    }
    50002 taken "stored as a curved leg of the plan, flown as chords after 13000, one NAV_WAYPOINT each" {
        "Time Stamp": RECEIVED_STAMP;
        "P1 Waypoint No": "where the leg starts";
        "P4 Waypoint No": "where it ends";
        "P2 Latitude": "a control point";
        "P2 Longitude": "a control point";
        "P2 Altitude": "its altitude; absent: the leg climbs evenly";
        "P3 Latitude": "a control point";
        "P3 Longitude": "a control point";
        "P3 Altitude": "its altitude; absent: the leg climbs evenly";
        "Altitude Type": "datum of both altitudes";
    } sends "on download" {
        "Time Stamp": STAMP;
        "P1 Waypoint No": AS_RECEIVED;
        "P4 Waypoint No": AS_RECEIVED;
        "P2 Latitude": AS_RECEIVED;
        "P2 Longitude": AS_RECEIVED;
        "P2 Altitude": AS_RECEIVED;
        "P3 Latitude": AS_RECEIVED;
        "P3 Longitude": AS_RECEIVED;
        "P3 Altitude": AS_RECEIVED;
        "Altitude Type": AS_RECEIVED;
        "Activity ID": AS_RECEIVED;
    }
    50010 taken "one parameter of the vehicle (PARAM_REQUEST_READ), or all (PARAM_REQUEST_LIST), is read and reported by 50012; needs LOI 2" {
        "Time Stamp": RECEIVED_STAMP;
        "Parameter Name": "which; absent or empty: all";
    }
    50011 taken "a parameter of the vehicle is written: PARAM_SET, done once PARAM_VALUE returns the value; needs LOI 4" {
        "Time Stamp": RECEIVED_STAMP;
        "Parameter Name": "which; refused where its range is not known, and where vehicle.controls does not choose it";
        "Commanded Value": "refused out of its range, by the vehicle's metadata where it is read, else by the table of PX4 v1.18";
    }
    50012 sends "in answer to 50010 and 50011, and on a later change to those that have requested it" {
        "Time Stamp": STAMP;
        "Parameter Name": "PARAM_VALUE.param_id";
        "Parameter Kind": "PARAM_VALUE.param_type";
        "Value": "PARAM_VALUE.param_value";
        "Minimum": "the vehicle's metadata where it is read, else the table of PX4 v1.18";
        "Maximum": "the vehicle's metadata where it is read, else the table of PX4 v1.18";
        "Parameter Index": "where all are reported";
        "Parameter Count": "where all are reported";
    }
    50013 sends "on 17002" {
        "Time Stamp": STAMP;
        "VSM Version": "its own";
        "Autopilot Version": "AUTOPILOT_VERSION.flight_sw_version";
        "Autopilot Source": "AUTOPILOT_VERSION.flight_custom_version";
        "Board Version": "AUTOPILOT_VERSION.board_version";
        "Hardware ID": "AUTOPILOT_VERSION.uid";
    }
    50014 taken "answered by 50015; needs LOI 2" {
        "Time Stamp": "returned in 50015";
        "Ping Number": "returned in 50015";
        "Ping Target": "0 the VSM, 1 the vehicle (PING)";
    }
    50015 sends "in answer to 50014" {
        "Time Stamp": STAMP;
        "Ping Number": "of the 50014";
        "Ping Target": "who has answered";
        "Request Time Stamp": "of the 50014";
        "Vehicle Round Trip": "from PING to its return";
    }
    50016 taken "stored; part of the geofence after 50017" {
        "Time Stamp": RECEIVED_STAMP;
        "Area ID": "1 to 65535";
        "Area Type": "polygon or circle, to stay inside or outside: NAV_FENCE_POLYGON_VERTEX_INCLUSION, NAV_FENCE_POLYGON_VERTEX_EXCLUSION, NAV_FENCE_CIRCLE_INCLUSION, NAV_FENCE_CIRCLE_EXCLUSION";
        "Vertex Count": "3 to 64 of a polygon, 1 of a circle; another count starts the area again";
        "Vertex Number": "1 to Vertex Count";
        "Latitude": "where it lies";
        "Longitude": "where it lies";
        "Radius": "of a circle";
    } sends "on download" {
        "Time Stamp": STAMP;
        "Area ID": AS_RECEIVED;
        "Area Type": AS_RECEIVED;
        "Vertex Count": AS_RECEIVED;
        "Vertex Number": AS_RECEIVED;
        "Latitude": AS_RECEIVED;
        "Longitude": AS_RECEIVED;
        "Radius": AS_RECEIVED;
    }
    50017 taken "loads, clears (MISSION_CLEAR_ALL) or downloads the areas, as a mission of type fence (MISSION_COUNT, MISSION_ITEM_INT); answered by 50018; needs LOI 4" {
        "Time Stamp": RECEIVED_STAMP;
        "Area Plan Mode": "1 to 3";
    }
    50018 sends "during and after a 50017" {
        "Time Stamp": STAMP;
        "Area Plan Mode": "of the 50017";
        "Status": "MISSION_CURRENT.fence_id; complete once the vehicle holds the fence, read back";
        "Area ID": "what a refusal is about; 0: an area of the configuration, or none";
        "Vertex Number": "what a refusal is about; 0: no one vertex";
    }
}
