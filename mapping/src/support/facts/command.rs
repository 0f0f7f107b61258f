//! System identification and commands of the flight vehicle: 1 to 2999.

use crate::support::row::{ECHO, NULL_LINK, RECEIVED_STAMP, STAMP, facts};

facts! {
    1 taken "to everybody or the VSM: a question; to a vehicle: request, release or override of control" {
        "Time Stamp": RECEIVED_STAMP;
        "VSM ID": "refused unless this VSM's, everybody's or none";
        "Requested/Handover LOI": "the levels requested or released; with bits beyond LOI 2 to 5 nothing is granted";
        "Requested/Handover Access": "0 releases, 1 requests, 2 overrides where the configuration allows it; absent or without levels: a question; others are refused";
        "Controlled Station 1-16": "the payload stations of LOI 3; none: all that there are; refused are those that there are not";
        "Wait for Vehicle Data Link Transition Coordination Message": "1: the request waits for a handover";
        "CUCS Type": ECHO;
        "CUCS Subtype": ECHO;
        "Controlled Station 17-32": "the payload stations of LOI 3; none: all that there are; refused are those that there are not";
    }
    2 sends "in answer to 1 and 4, on 17002, and when control is taken from a CUCS" {
        "Time Stamp": STAMP;
        "VSM ID": "dli.vsm_id";
        "Data Link ID": NULL_LINK;
        "Access Authorized": "1 where the configuration gives any level, else 0";
        "Access Granted": "whether level 3, 4 or 5 is held";
        "LOI Authorized": "cucs.loi, without LOI 3 while the vehicle has no payload station";
        "LOI Granted": "everything that this CUCS now holds";
        "Controlled Station 1-16": "payload stations that there are and that it holds";
        "Access Requested": "as requested";
        "Vehicle Type": "HEARTBEAT.type, 0 before the first one";
        "Vehicle Subtype": "0";
        "CUCS Type": "as requested";
        "CUCS Subtype": "as requested";
        "Presence Vector Support": "partial vectors";
        "Controlled Station 17-32": "payload stations that there are and that it holds";
    }
    3 sends "at the grant of LOI 2, on 17001 and 17002" {
        "Time Stamp": STAMP;
        "VSM ID": "dli.vsm_id";
        "Vehicle ID Update": "vehicle.id";
        "Vehicle Type": "HEARTBEAT.type, 0 before the first one";
        "Vehicle Subtype": "0";
        "Owning ID": "the first byte of vehicle.id";
        "Tail Number": "vehicle.tail_number";
        "Mission ID": "of the route aboard";
    }
    4 taken "a handover is requested, consented to or offered; concluded by 2, 5 and 35000" {
        "Time Stamp": RECEIVED_STAMP;
        "Requested/Handover LOI": "the levels to hand over";
        "Controlled Station 1-16": "stations to hand over";
        "Requesting CUCS ID": "who acquires; absent or null: the sender";
        "Controlled Station 17-32": "stations to hand over";
    } sends "a request for control is forwarded to the holder" {
        "Time Stamp": STAMP;
        "VSM ID": "dli.vsm_id";
        "Data Link ID": NULL_LINK;
        "Vehicle Type": "HEARTBEAT.type, 0 before the first one";
        "Vehicle Subtype": "0";
        "Requested/Handover LOI": "the levels requested";
        "Controlled Station 1-16": "stations requested";
        "Requesting CUCS ID": "who requests them";
        "Presence Vector Support": "partial vectors";
        "Controlled Station 17-32": "stations requested";
    }
    5 sends "control is offered to a successor, or has been handed over" {
        "Time Stamp": STAMP;
        "VSM ID": "dli.vsm_id";
        "Data Link ID": NULL_LINK;
        "LOI Authorized": "the levels that are handed over";
        "Controlled Station 1-16 Authorized": "stations that are handed over";
        "Vehicle Type": "HEARTBEAT.type, 0 before the first one";
        "Vehicle Subtype": "0";
        "Requesting CUCS ID": "who acquires";
        "Presence Vector Support": "partial vectors";
        "Controlled Station 17-32 Authorized": "stations that are handed over";
    }
    2005 taken "two orders of the CUCS that holds LOI 5, to arm and then to execute what vehicle.termination plans: DO_FLIGHTTERMINATION, or DO_SET_MODE AUTO.LAND or AUTO.RTL, done once HEARTBEAT shows that mode; refused without that table, and to a station of Edition 4 unless provisional is all" {
        "Time Stamp": "fresh by the station's own clock: at most 2 s behind its fastest messages";
        "Commanded Flight Termination State": "1 arms for vehicle.termination.armed_s, 2 executes what is armed, 0 disarms, withdraws or releases; a termination that PX4 shows is final";
        "Flight Termination Mode": "0; others are refused: the configuration plans what is done";
    }
    2008 taken "arms and disarms, which all motors do together: COMPONENT_ARM_DISARM, after DO_SET_MODE AUTO.LOITER, done once HEARTBEAT.base_mode shows it; needs LOI 5" {
        "Time Stamp": RECEIVED_STAMP;
        "Engine Number": "refused above the number that there are";
        "Engine Command": "0 stops (disarms), 1 and 2 start (arm)";
        "Reverse Thrust Power": "1 is refused";
        "Reverse Thrust": "0 and 3; others are refused";
        "Ignition Switch Power": "1 is refused";
        "Ignition Switch Activation": "1 is refused";
    }
    2010 taken "sticks for mode 2, sent on as MANUAL_CONTROL, each as it comes (at most 66 a second, 25 on a serial line) and the last one again 25 times a second, while that mode is entered or flown" {
        "Time Stamp": "one that has been overtaken changes nothing";
        "Lateral Stick": "y";
        "Longitudinal Stick": "x";
        "Rotational Stick (Rudder)": "r";
        "Throttle Stick - Engine 1": "z; half where absent";
    }
    2016 taken "a mode, and what goes with it; answered by what the vehicle then does: HEARTBEAT, CURRENT_MODE, MISSION_CURRENT, POSITION_TARGET_GLOBAL_INT, ORBIT_EXECUTION_STATUS, EXTENDED_SYS_STATE" {
        "Time Stamp": RECEIVED_STAMP;
        "Select Flight Path Control Mode": "2 POSCTL once MANUAL_CONTROL runs; 11 MISSION_SET_CURRENT where a waypoint is commanded, AUTO.MISSION; 12 AUTO.LOITER, or DO_REPOSITION, DO_ORBIT, refused on the ground; 15 SET_POSITION_TARGET_LOCAL_NED, 20 a second, then OFFBOARD, on wings the course mode of PX4; 19 AUTO.LAND, on wings the landing pattern in AUTO.MISSION; 20 while it lands, of a multicopter up to the commanded altitude, else to where the landing began, of a fixed wing DO_GO_AROUND; 21 AUTO.LOITER, COMPONENT_ARM_DISARM, NAV_TAKEOFF, of a VTOL NAV_VTOL_TAKEOFF; 23, 24 the upload of such a route where one is stored, AUTO.MISSION, else AUTO.RTL, AUTO.LAND; others are refused; absent or 0: the present mode";
        "Altitude Command Type": "1 altitude, 0 none: the altitude is not flown; 2 and 3 in 15, elsewhere refused";
        "Commanded Altitude": "12, 15: flown to; 21: taken off to; refused in 11, and below home unless vehicle.limits.below_home is true";
        "Commanded Vertical Speed": "15: flown, or the limit of the way to an altitude; elsewhere 16000 reports that it is ignored";
        "Heading Command Type": "15: 1 heading, 2 course, 3 both, 5 turn rate, on wings 2 alone (GUIDED_CHANGE_HEADING); 4 is refused; elsewhere 0 alone";
        "Heading Reference": "15: 0 true; magnetic is refused";
        "Commanded Heading": "15: where the nose points";
        "Commanded Course": "15: where it flies";
        "Commanded Turn Rate": "15: how fast it turns";
        "Commanded Speed": "DO_CHANGE_SPEED in 11 and 12 (a multicopter's circle: DO_ORBIT), flown in 15; refused beyond the range that 41003 reports, and in 11 where repeated speeds of the route are left out; 0: none";
        "Speed Type": "0, 1 and 2 alike: over ground by a multicopter, through the air on wings; others are refused";
        "Commanded Waypoint Number": "11, and routes flown by 19, 23, 24: the flight starts at it; 0: none; elsewhere 16000 reports that it is ignored";
        "Altimeter Setting": "of pressure altitudes, from now on; 0: none";
        "Altitude Type": "datum of the altitude: 0 and 1 by the altimeter setting, 2 above home, 3 ellipsoid";
        "Loiter Position Latitude": "12: flown to; 21 on wings: loitered at after the climb; 0, 0: none";
        "Loiter Position Longitude": "12: flown to; 21 on wings: loitered at after the climb; 0, 0: none";
    }
    2017 taken "kept, field by field, for the loiters that 2016 commands" {
        "Time Stamp": RECEIVED_STAMP;
        "Loiter Type": "4 hover (not of a fixed wing), 1 circle, 3 figure 8 (on wings, DO_FIGURE_EIGHT); others are refused; a VTOL transitions for it";
        "Loiter Radius": "of the circle, or of the ends of a figure 8 (0: none); above 1000 m, and 0 of a circle, it is refused";
        "Loiter Length": "of a figure 8; 0: none";
        "Loiter Bearing": "of the long axis of a figure 8";
        "Loiter Direction": "2 counter-clockwise, 0 and 1 clockwise; others are refused";
    }
}
