//! The configuration phase: 40000 to 49999.

use crate::support::row::{NULL_LINK, RECEIVED_STAMP, STAMP, facts};

facts! {
    40000 taken "answered by 41000 to 41005, 43000, 43001 and 44003, unless dli.provisional is off" {
        "Time Stamp": RECEIVED_STAMP;
        "VSM ID": "refused unless this VSM's, everybody's or none";
        "Request Type": "0 one message or field, 1 to 4 LOI 2 to 5, 5 data link, 6 no more answers";
        "Requested Message": "of Request Type 0";
        "Requested Field": "of Request Type 0, from 1; absent or 0: all; of 50011 from 11 on the vehicle's controls";
    }
    41000 sends "in answer to 40000, and when a parameter changes: signed integers and angles, in steps on the wire; and each control of the vehicle that is an integer, as a field of 50011 from 11 on, also when it is new or described again" {
        "Time Stamp": STAMP;
        "VSM ID": "dli.vsm_id";
        "Data Link ID": NULL_LINK;
        "Requested Message": "what it is about";
        "Requested Field": "what it is about, from 1";
        "Field Supported": "whether the field is used";
        "Default Value": "what a command may start from";
        "Max Value": "the vehicle's parameters and the configured limits";
        "Min Value": "the vehicle's parameters and the configured limits";
        "Help Text": "the unit, and where the bounds are from; of a control its parameter to the colon, unit and meaning";
        "Subsystem ID": "not assigned";
    }
    41001 sends "in answer to 40000: floats, which nothing bounds here; and each control of the vehicle that is a float, as a field of 50011 from 11 on, also when it is new or described again" {
        "Time Stamp": STAMP;
        "VSM ID": "dli.vsm_id";
        "Data Link ID": NULL_LINK;
        "Requested Message": "what it is about";
        "Requested Field": "what it is about, from 1";
        "Field Supported": "whether the field is used";
        "Default Value": "of a control: the firmware's, by the vehicle's metadata";
        "Max Value": "of a control: by the vehicle's metadata, absent without it";
        "Min Value": "of a control: by the vehicle's metadata, absent without it";
        "Minimum Display Resolution": "of a control: by the vehicle's metadata";
        "Help Text": "of a control its parameter to the colon, unit and meaning; else empty";
        "Subsystem ID": "not assigned";
    }
    41002 sends "in answer to 40000: enumerations, one for each value of this VSM's own" {
        "Time Stamp": STAMP;
        "VSM ID": "dli.vsm_id";
        "Data Link ID": NULL_LINK;
        "Station Number 1-16": "0";
        "Requested Message": "what it is about";
        "Requested Field": "what it is about, from 1";
        "Field Supported": "whether the field is used";
        "Default Value": "what a command may start from";
        "Vehicle Specific Enumeration Count": "how many there are";
        "Vehicle Specific Enumeration Index": "the value";
        "Vehicle Specific Enumeration Text": "its name";
        "Vehicle Specific Help Text": "its name in full";
    }
    41003 sends "in answer to 40000, and when a parameter changes: unsigned integers, in steps on the wire" {
        "Time Stamp": STAMP;
        "VSM ID": "dli.vsm_id";
        "Data Link ID": NULL_LINK;
        "Requested Message": "what it is about";
        "Requested Field": "what it is about, from 1";
        "Field Supported": "whether the field is used";
        "Default Value": "what a command may start from";
        "Max Value": "the vehicle's parameters and the configured limits";
        "Min Value": "the vehicle's parameters and the configured limits";
        "Low Caution Limit": "of the energy level: BAT_LOW_THR";
        "Low Warning Limit": "of the energy level: BAT_CRIT_THR";
        "Help Text": "the unit, and where the bounds are from";
        "Subsystem ID": "not assigned";
    }
    41004 sends "in answer to 40000: texts" {
        "Time Stamp": STAMP;
        "VSM ID": "dli.vsm_id";
        "Data Link ID": NULL_LINK;
        "Station Number 1-16": "0";
        "Requested Message": "what it is about";
        "Requested Field": "what it is about, from 1";
        "Field Supported": "whether the field is used";
        "Help Text": "empty";
        "Subsystem ID": "not assigned";
    }
    41005 sends "after the last answer to a 40000" {
        "Time Stamp": STAMP;
        "VSM ID": "dli.vsm_id";
        "Data Link ID": NULL_LINK;
        "Station Number 1-16": "0";
        "Vehicle Type": "HEARTBEAT.type, 0 before the first one";
        "Vehicle Subtype": "0";
    }
    43000 sends "in answer to 40000 for LOI 2" {
        "Time Stamp": STAMP;
        "VSM Home Web Page URL": "of http.listen; empty without it";
        "FTP URL": "empty";
    }
    43001 sends "in answer to 40000 for LOI 4, one a route type" {
        "Time Stamp": STAMP;
        "Route Type": "0 to 4";
        "Instances": "routes that a plan holds";
        "Maximum Number of Waypoints": "vehicle.curve.max_items";
        "Location Type Support": "0: absolute only";
    }
    44000 sends "to those that 40000 has configured, when another has set it: Altimeter Setting of 2016, Loiter Radius of 2017; and the value of each control that is an integer, after its 41000 and when it is another" {
        "Time Stamp": STAMP;
        "Requested Message": "what it is about";
        "Requested Field": "what it is about, from 1";
        "Commanded Value": "what it is now";
    }
    44001 sends "to those that 40000 has configured: the value of each control that is a float, after its 41001 and when it is another" {
        "Time Stamp": STAMP;
        "Requested Message": "50011";
        "Requested Field": "the control, from 11";
        "Commanded Value": "PARAM_VALUE.param_value";
    }
    44002 sends "to those that 40000 has configured: the mode of 2016, when the vehicle enters another; Loiter Type and Loiter Direction of 2017, when another has set them" {
        "Time Stamp": STAMP;
        "Requested Message": "what it is about";
        "Requested Field": "what it is about, from 1";
        "Commanded Enumeration Index Value": "what it is now";
    }
    44003 sends "in answer to 40000: what is not supported; and when a mode or a control comes or goes" {
        "Time Stamp": STAMP;
        "Station Number 1-16": "0";
        "Reported Message": "what it is about";
        "Reported Field": "what it is about, from 1; 0: the whole message";
        "Field Available": "whether the field is used";
        "Reported Enumerated Index": "the value that it is about";
        "Enumerated Index Enable": "-2 refused always, -1 now, 0 taken";
    }
}
