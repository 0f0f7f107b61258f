//! Routes and their transfer: 13000 to 14999.

use crate::support::row::{AS_RECEIVED, RECEIVED_STAMP, STAMP, facts};

facts! {
    13000 taken "clears (MISSION_CLEAR_ALL), loads (MISSION_COUNT, MISSION_ITEM_INT, read back by MISSION_REQUEST_LIST, MISSION_REQUEST_INT; then MISSION_CURRENT shows it), downloads or cancels; answered by 14000" {
        "Time Stamp": RECEIVED_STAMP;
        "Mission ID": "returned in 14000 and 3";
        "Mission Plan Mode": "1 to 5";
        "Waypoint Number": "mode 4: the waypoint to download";
        "Route ID": "mode 1: the route to forget, absent: all; mode 2: the route to load, absent: the latest flight route; mode 3: the route to download, absent: all";
    }
    13001 taken "stored; flown after 13000" {
        "Time Stamp": RECEIVED_STAMP;
        "Initial Waypoint Number": "where the route starts; 0 deletes its definition";
        "Route ID": "names it for 13000; routes without one are distinguished by their type";
        "Route Type": "flown by 2016: 0 launch by 21, 1 approach by 19, and the landing of every route of wings, 2 flight by 11, 3, 4 contingency A, B by 23, 24";
    } sends "on download" {
        "Time Stamp": STAMP;
        "Initial Waypoint Number": AS_RECEIVED;
        "Route ID": AS_RECEIVED;
        "Route Type": AS_RECEIVED;
        "Activity ID": AS_RECEIVED;
    }
    13002 taken "stored; checked and flown after 13000 as NAV_WAYPOINT" {
        "Time Stamp": RECEIVED_STAMP;
        "Waypoint Number": "1 to 65534";
        "Waypoint to Latitude or Relative Y": "where it lies";
        "Waypoint to Longitude or Relative X": "where it lies";
        "Location Type": "0 absolute; others are refused";
        "Waypoint to Altitude": "how high; refused below home unless vehicle.limits.below_home is true";
        "Waypoint Altitude Type": "datum of the altitude: 0 and 1 by the altimeter setting, 2 above home, 3 ellipsoid";
        "Waypoint to Speed": "DO_CHANGE_SPEED before it; 0: none; a repeated one is left out where the items are too many";
        "Waypoint Speed Type": "0, 1 and 2 alike; arrival time is refused";
        "Next Waypoint": "0 ends the route; of the end of a loop: its start";
        "Turn Type": "1 flies over, within 3 m; 0 takes the vehicle's own radius";
        "Waypoint Type": "0 normal, 1 the end of a loop (DO_JUMP)";
        "Limit Type": "0 endless, 1 a count; a time is refused";
        "Loop Limit": "how often the loop is flown";
    } sends "on download" {
        "Time Stamp": STAMP;
        "Waypoint Number": AS_RECEIVED;
        "Waypoint to Latitude or Relative Y": AS_RECEIVED;
        "Waypoint to Longitude or Relative X": AS_RECEIVED;
        "Location Type": AS_RECEIVED;
        "Waypoint to Altitude": AS_RECEIVED;
        "Waypoint Altitude Type": AS_RECEIVED;
        "Altitude Change Behaviour": AS_RECEIVED;
        "Waypoint to Speed": AS_RECEIVED;
        "Waypoint Speed Type": AS_RECEIVED;
        "Next Waypoint": AS_RECEIVED;
        "Turn Type": AS_RECEIVED;
        "Optional Messages for Waypoint": AS_RECEIVED;
        "Waypoint Type": AS_RECEIVED;
        "Limit Type": AS_RECEIVED;
        "Loop Limit": AS_RECEIVED;
        "Arrival Time": AS_RECEIVED;
        "Activity ID": AS_RECEIVED;
    }
    13003 taken "stored; makes a loiter of the waypoint with its number" {
        "Time Stamp": RECEIVED_STAMP;
        "Waypoint Number": "1 to 65534";
        "Waypoint Loiter Type": "1 circle, 4 hover (a multicopter hovers at both); others are refused";
        "Loiter Radius": "of the circle of a fixed wing; above 1000 m it is refused";
        "Loiter Direction": "of a fixed wing: 1 clockwise, 2 counter-clockwise; of any vehicle others but 0 are refused, into the wind too";
        "Loiter Speed": "within the circle of a fixed wing";
        "Speed Type": "0, 1 and 2 alike; others are refused";
        "Loiter Duration": "NAV_LOITER_TIME, which a multicopter counts from NAV_ACC_RAD before the place; 0: no loiter; absent: unlimited (NAV_LOITER_UNLIM)";
        "Loiter Duration Units": "0 seconds; 1 turns of a fixed wing, where radius and speed are given";
    } sends "on download" {
        "Time Stamp": STAMP;
        "Waypoint Number": AS_RECEIVED;
        "Waypoint Loiter Type": AS_RECEIVED;
        "Loiter Radius": AS_RECEIVED;
        "Loiter Length": AS_RECEIVED;
        "Loiter Length Units": AS_RECEIVED;
        "Loiter Bearing": AS_RECEIVED;
        "Loiter Direction": AS_RECEIVED;
        "Loiter Speed": AS_RECEIVED;
        "Speed Type": AS_RECEIVED;
        "Flying Behaviour": AS_RECEIVED;
        "Loiter Duration": AS_RECEIVED;
        "Loiter Duration Units": AS_RECEIVED;
        "Activity ID": AS_RECEIVED;
    }
    13004 taken "dli.provisional = all: stored; what a payload station does from the leg to the waypoint with its number on: \
                 DO_GIMBAL_MANAGER_CONFIGURE, DO_GIMBAL_MANAGER_PITCHYAW, DO_SET_ROI_LOCATION, SET_CAMERA_SOURCE; needs LOI 3 of the station \
                 beside LOI 4, and a gimbal that PX4's own manager steers" {
        "Time Stamp": RECEIVED_STAMP;
        "Waypoint Number": "1 to 65534";
        "Station Number (1-16)": "one station, which the sender holds";
        "Set Sensor 1 Mode": "1 (on); off and standby are refused: no mission item switches a sensor off";
        "Set Sensor 2 Mode": "1 (on); off and standby are refused: no mission item switches a sensor off";
        "Sensor Output": "0 none, 1 sensor 1 (EO), 2 sensor 2 (IR): SET_CAMERA_SOURCE; both is refused";
        "Set Sensor Pointing Mode": "0 nil, 1 angles, 4 place; the others are refused: slew rates, target, stow and line search have no mission item";
        "Starepoint Latitude": "in mode 4: DO_SET_ROI_LOCATION, to which a multicopter turns its nose too";
        "Starepoint Longitude": "in mode 4";
        "Starepoint Altitude": "in mode 4";
        "Starepoint Altitude Type": "in mode 4, as of a waypoint";
        "Payload Az (wrt UA)": "in mode 1, right of the x axis; beyond the gimbal's range it is refused";
        "Payload El (wrt UA)": "in mode 1, above the waterline; beyond the gimbal's range it is refused";
        "Payload Sensor Rotation Angle": "0 in mode 1; others are refused";
    } sends "on download" {
        "Time Stamp": STAMP;
        "Waypoint Number": AS_RECEIVED;
        "Station Number (1-16)": AS_RECEIVED;
        "Set Sensor 1 Mode": AS_RECEIVED;
        "Set Sensor 2 Mode": AS_RECEIVED;
        "Sensor Output": AS_RECEIVED;
        "Set Sensor Pointing Mode": AS_RECEIVED;
        "Starepoint Latitude": AS_RECEIVED;
        "Starepoint Longitude": AS_RECEIVED;
        "Starepoint Altitude": AS_RECEIVED;
        "Starepoint Altitude Type": AS_RECEIVED;
        "Payload Az (wrt UA)": AS_RECEIVED;
        "Payload El (wrt UA)": AS_RECEIVED;
        "Payload Sensor Rotation Angle": AS_RECEIVED;
    }
    13006 taken "stored; what is done at the waypoint with its number: camera (IMAGE_START_CAPTURE, VIDEO_START_CAPTURE), camera trigger \
                 (DO_SET_CAM_TRIGG_DIST, DO_SET_CAM_TRIGG_INTERVAL), NAV_DELAY, and a transition of a VTOL \
                 (DO_VTOL_TRANSITION), which flies the legs from there so" {
        "Time Stamp": RECEIVED_STAMP;
        "Waypoint Number": "1 to 65534; 0, mission generic data, is refused";
        "Tag Type": "0; others are refused";
        "Tag/Data": "PHOTO, VIDEO, TRIGGER, ROI OFF, DELAY, TRANSITION (mapping.md), divided by semicolons; empty takes an earlier one back, others are refused, SERVO too (PX4 would move outputs 5 and 6)";
    } sends "on download" {
        "Time Stamp": STAMP;
        "Waypoint Number": AS_RECEIVED;
        "Tag Type": AS_RECEIVED;
        "Tag/Data": AS_RECEIVED;
        "Activity ID": AS_RECEIVED;
    }
    14000 sends "during and after a 13000" {
        "Time Stamp": STAMP;
        "Mission ID": "of the 13000";
        "Status": "MISSION_ACK; complete once the vehicle holds the plan, read back";
        "Percent Complete": "items transferred";
        "Waypoint Request": "the waypoint that a refusal is about";
        "Mission Plan Mode": "of the 13000";
    }
}
