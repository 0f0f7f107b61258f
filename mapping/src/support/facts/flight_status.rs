//! Status of the flight vehicle: 3000 to 12999.

use crate::support::row::{MEASURED, STAMP, facts};

facts! {
    3000 sends "by 17001, on 17002" {
        "Time Stamp": STAMP;
        "Propulsion Fuel Capacity": "-1: it burns none";
        "Number of Engines": "from HEARTBEAT.type";
    }
    3001 sends "every 400 ms and on change from LOI 2 on, by 17001, on 17002" {
        "Time Stamp": STAMP;
        "Select Flight Path Control Mode": "the mode that the vehicle is in (HEARTBEAT, CURRENT_MODE); 0 when it is silent";
    }
    3002 sends "every 400 ms and on change from LOI 2 on, by 17001, on 17002" {
        "Time Stamp": STAMP;
        "Commanded Altitude": "the last command that the vehicle took";
        "Altitude Type": "3 once the geoid separation is known (GPS_RAW_INT), else 1";
        "Commanded Heading": "in mode 15, where 2016 has commanded it";
        "Commanded Course": "in mode 15, where 2016 has commanded it";
        "Commanded Turn Rate": "in mode 15, where 2016 has commanded it";
        "Commanded Speed": "the last command that the vehicle took";
        "Speed Type": "as it is flown: 2 of a multicopter, 0 of a fixed wing";
        "Power Level": "VFR_HUD.throttle";
        "Current Propulsion Energy Level": "SYS_STATUS, BATTERY_STATUS";
        "Altitude Command Type": "1 where an altitude is commanded in the present mode";
        "Heading Command Type": "in mode 15, where 2016 has commanded a direction: 1 heading, 2 course, 3 both, 5 turn rate";
        "UA State": "EXTENDED_SYS_STATE.landed_state, vtol_state, HEARTBEAT: armed, failsafe, system_status; on the ground 2, 1 while it cannot be armed, armed 3; 0 where it is armed and has not reported whether it flies; 10 in the air, 11 taking off, 12 landing, 13 a failsafe, 14 and 15 a VTOL in a transition (41002 names 10 and up)";
        "Commanded Loiter Position Latitude": "the last command that the vehicle took";
        "Commanded Loiter Position Longitude": "the last command that the vehicle took";
        "Commanded Waypoint Number": "the waypoint that the mission flies to";
    }
    3004 sends "by 17001, on 17002" {
        "Time Stamp": STAMP;
        "Loiter Type": "of 2017";
        "Loiter Radius": "of 2017";
        "Loiter Length": "of 2017, of a figure 8";
        "Loiter Bearing": "of 2017, of a figure 8";
        "Loiter Direction": "of 2017, not of a figure 8";
        "Loiter Altitude": "commanded in the loiter that is flown, or for the launch";
        "Altitude Type": "3 once the geoid separation is known (GPS_RAW_INT), else 1";
        "Loiter Speed": "commanded in the loiter that is flown";
        "Speed Type": "as it is flown: 2 of a multicopter, 0 of a fixed wing";
    }
    3005 sends "by 17001, on 17002; where vehicle.termination is set to whoever begins to listen and on every change, twice a second while armed, commanded or shown; never of a silent vehicle that nothing is armed for" {
        "Time Stamp": STAMP;
        "Reported Flight Termination State": "1 armed, or commanded and not shown yet; 2 once HEARTBEAT shows it, whoever has commanded it; else 0";
        "Reported Flight Termination Mode": "0";
    }
    3006 sends "by 17001, on 17002; without lights: PX4 does not report them" {
        "Time Stamp": STAMP;
    }
    3007 sends "by 17001, on 17002, one a motor; never of a silent vehicle" {
        "Time Stamp": STAMP;
        "Engine Number": "from 1";
        "Engine Status": "EFI_STATUS: turning or not; without it HEARTBEAT: armed or not";
        "Reported Engine Command": "the last 2008";
        "Engine Power Setting": "EFI_STATUS.throttle_position; else VFR_HUD.throttle, 0 when disarmed";
        "Engine Speed 1": "EFI_STATUS of a vehicle with one engine; else ESC_STATUS, where the controllers of the motors report it";
    }
    3009 sends "by 17001, on 17002; never of a silent vehicle" {
        "Time Stamp": MEASURED;
        "Indicated Airspeed": "VFR_HUD.airspeed";
        "U_Wind": "WIND_COV";
        "V_Wind": "WIND_COV";
        "Altimeter Setting": "of 2016";
        "Barometric Altitude": "GLOBAL_POSITION_INT";
        "Barometric Altitude Rate": "GLOBAL_POSITION_INT, without a fix LOCAL_POSITION_NED";
        "Pressure Altitude": "by the altimeter setting";
        "AGL Altitude": "height above home; above the ground of vehicle.terrain with vehicle.agl terrain; absent with refuse";
        "WGS-84 Altitude": "once the geoid separation is known";
        "U_Ground": "GLOBAL_POSITION_INT, without a fix LOCAL_POSITION_NED";
        "V_Ground": "GLOBAL_POSITION_INT, without a fix LOCAL_POSITION_NED";
    }
    3010 sends "by 17001, on 17002; never of a silent vehicle" {
        "Time Stamp": MEASURED;
        "X_Body_Accel": "HIGHRES_IMU";
        "Y_Body_Accel": "HIGHRES_IMU";
        "Z_Body_Accel": "HIGHRES_IMU";
        "Roll_Rate": "ATTITUDE";
        "Pitch_Rate": "ATTITUDE";
        "Yaw_Rate": "ATTITUDE";
    }
    3011 sends "by 17001, on 17002, while sticks (2010) come that the vehicle does not ignore" {
        "Time Stamp": STAMP;
        "Lateral Stick": "the last 2010";
        "Longitudinal Stick": "the last 2010";
        "Rotational Stick (Rudder)": "the last 2010";
        "Throttle Stick - Engine 1": "the last 2010";
    }
    3016 sends "by 17001, on 17002, once home is known; routes have no reference of their own" {
        "Time Stamp": MEASURED;
        "Location Latitude (Y-axis zero)": "HOME_POSITION: what altitudes above ground are flown above";
        "Location Longitude (X-axis zero)": "HOME_POSITION";
        "Location Altitude Type": "3 once the geoid separation is known (GPS_RAW_INT), else 1";
        "Location Altitude": "HOME_POSITION";
        "Route ID": "of the route aboard";
        "UA Relative Altitude Type": "2";
        "UA Relative Altitude": "GLOBAL_POSITION_INT, unless vehicle.agl is refuse";
    }
    4000 sends "every 200 ms from LOI 2 on, by 17001, on 17002; never of a silent vehicle" {
        "Time Stamp": MEASURED;
        "Latitude": "GLOBAL_POSITION_INT, absent without a fix";
        "Longitude": "GLOBAL_POSITION_INT, absent without a fix";
        "Altitude": "GLOBAL_POSITION_INT and the geoid separation";
        "Altitude Type": "3 once the geoid separation is known (GPS_RAW_INT), else 1";
        "U_Speed": "GLOBAL_POSITION_INT, without a fix LOCAL_POSITION_NED, north";
        "V_Speed": "GLOBAL_POSITION_INT, without a fix LOCAL_POSITION_NED, east";
        "W_Speed": "GLOBAL_POSITION_INT, without a fix LOCAL_POSITION_NED, down";
        "Roll": "ATTITUDE, brought to the Time Stamp by its rates";
        "Pitch": "ATTITUDE, brought to the Time Stamp by its rates";
        "Heading": "ATTITUDE, true, brought to the Time Stamp by its rates";
        "Roll Rate": "ATTITUDE, the rate of Roll; absent near the vertical";
        "Pitch Rate": "ATTITUDE, the rate of Pitch; absent near the vertical";
        "Turn Rate": "ATTITUDE, the rate of Heading; absent near the vertical";
    }
    4001 sends "every 400 ms from LOI 2 on, by 17001, on 17002; never of a silent vehicle" {
        "Time Stamp": MEASURED;
        "Altitude Type": "3 once the geoid separation is known (GPS_RAW_INT), else 1";
        "Speed Type": "2";
        "From Waypoint - Latitude": "the route aboard, once MISSION_ITEM_REACHED";
        "From Waypoint - Longitude": "the route aboard";
        "From Waypoint Altitude": "the route aboard, HOME_POSITION";
        "From Waypoint Number": "0: none";
        "To Waypoint - Latitude": "the route aboard";
        "To Waypoint - Longitude": "the route aboard";
        "To Waypoint Altitude": "the route aboard";
        "To Waypoint Speed": "where the route gives one";
        "To Waypoint Time": "distance over present ground speed (VFR_HUD)";
        "To Waypoint Number": "MISSION_CURRENT; 65535: the commanded loiter place; 0: none";
        "Next Waypoint - Latitude": "the route aboard";
        "Next Waypoint - Longitude": "the route aboard";
        "Next Waypoint Altitude": "the route aboard";
        "Next Waypoint Speed": "where the route gives one";
        "Next Waypoint Time": "from the time before by the leg's speed";
        "Next Waypoint Number": "0: none";
    }
    12001 sends "by 17001, on 17002, one a bus; never of a silent vehicle" {
        "Time Stamp": STAMP;
        "Bus ID": "0 to 3: BATTERY_STATUS.id; 4: GENERATOR_STATUS";
        "Bus Voltage": "in volts: no source gives a scale";
        "Bus Current": "steps of 0.01 A: no source gives one";
        "Battery Time Remaining": "s";
    }
    12101 sends "by 17001, on 17002; never of a silent vehicle" {
        "Time Stamp": STAMP;
        "Bus Voltage": "BATTERY_STATUS, SYS_STATUS; steps of 0.01 V: no source gives one";
        "Battery Current": "BATTERY_STATUS; steps of 0.01 A: no source gives one";
        "Battery Charge Remaining": "steps of 0.0016 %";
        "Battery Temperature": "steps of 0.5 K";
    }
}
