//! Payload stations: 19000 to 27999.

use crate::support::row::{MEASURED, RECEIVED_STAMP, STAMP, facts};

facts! {
    19001 taken "dli.provisional = all: the gimbal or camera of a station does it, carried out once it shows that; needs LOI 3 of the station" {
        "Time Stamp": RECEIVED_STAMP;
        "Station Number 1-16": "one station; with none or several it is refused";
        "Set Centreline Azimuth Angle": "pointing mode 1: DO_GIMBAL_MANAGER_PITCHYAW, shown by GIMBAL_DEVICE_ATTITUDE_STATUS; beyond the gimbal's range it is refused";
        "Set Centreline Elevation Angle": "pointing mode 1: DO_GIMBAL_MANAGER_PITCHYAW, shown by GIMBAL_DEVICE_ATTITUDE_STATUS; beyond the gimbal's range it is refused";
        "Set Zoom": "SET_CAMERA_ZOOM, shown by CAMERA_SETTINGS.zoomLevel; 0: by the field of view; 1: stops zooming";
        "Set Horizontal Field of View": "with zoom 0 or none: as a focal length, shown by CAMERA_FOV_STATUS";
        "Horizontal Slew Rate": "pointing modes 2 and 3: GIMBAL_MANAGER_SET_ATTITUDE each second";
        "Vertical Slew Rate": "pointing modes 2 and 3: GIMBAL_MANAGER_SET_ATTITUDE each second";
        "Latitude": "pointing mode 4: GIMBAL_MANAGER_SET_ATTITUDE towards it";
        "Longitude": "pointing mode 4: GIMBAL_MANAGER_SET_ATTITUDE towards it";
        "Altitude": "pointing mode 4: of the point that is looked at; needed";
        "Altitude Type": "pointing mode 4: 0 to 3; others are refused";
        "Set Focus": "SET_CAMERA_FOCUS by a step, shown by CAMERA_SETTINGS.focusLevel";
        "Focus Type": "0 after a focus by hand: SET_CAMERA_FOCUS automatic, by its COMMAND_ACK alone";
    }
    19100 taken "dli.provisional = all: the gimbal or camera of a station does it, carried out once it shows that; needs LOI 3 of the station" {
        "Time Stamp": RECEIVED_STAMP;
        "Station Number 1-16": "one station; with none or several it is refused";
        "System Operating Mode": "0 retracts the gimbal, 2 centres it, 5 ends recording, 10 records video, 11 takes a photograph; others are refused";
        "Image Output": "1 and 2: SET_CAMERA_SOURCE, shown by VIDEO_STREAM_STATUS; others are refused";
        "Set EO/IR Pointing Mode": "which fields of 19001 count: 0 none, 1 angles, 2 and 3 rates, 4 a place, at once the one in view; others are refused";
        "Fire Laser Pointer": "0; others are refused: MAVLink has no command for a laser";
        "Fire Laser Rangefinder": "0; others are refused: MAVLink has no command for a laser";
        "Initiate Laser Designator": "0; others are refused: MAVLink has no command for a laser";
    }
    21000 sends "at the grant of LOI 2, when a payload station appears, by 17001 and on 17002, one a station, unless dli.provisional is off" {
        "Time Stamp": STAMP;
        "VSM ID": "dli.vsm_id";
        "Payload Stations Available 1-16": "vehicle.payload, or the gimbals and cameras that the vehicle shows";
        "Station Number 1-16": "the station";
        "Payload Type": "1 EO, 3 EO/IR, 5 a camera without gimbal, 0 a gimbal without camera";
        "Number of Payload Recording Devices": "1 where CAMERA_INFORMATION.flags has video";
    }
    21100 sends "by 17001 and on 17002, one a station, unless dli.provisional is off" {
        "Time Stamp": STAMP;
        "VSM ID": "dli.vsm_id";
        "Station Number 1-16": "the station";
        "EO Vertical Image Dimension": "CAMERA_INFORMATION.resolution_v";
        "EO Horizontal Image Dimension": "CAMERA_INFORMATION.resolution_h";
        "Field of Regard - Elevation Min": "GIMBAL_MANAGER_INFORMATION.pitch_min";
        "Field of Regard - Elevation Max": "GIMBAL_MANAGER_INFORMATION.pitch_max";
        "Field of Regard - Azimuth Min": "GIMBAL_MANAGER_INFORMATION.yaw_min";
        "Field of Regard - Azimuth Max": "GIMBAL_MANAGER_INFORMATION.yaw_max";
    }
    21101 sends "at 2 Hz to who holds LOI 3 of a station, by 17001 and on 17002, one a station, unless dli.provisional is off" {
        "Time Stamp": MEASURED;
        "Station Number 1-16": "the station";
        "Addressed Sensor": "VIDEO_STREAM_STATUS.flags: EO or IR";
        "System Operating Mode State": "0 stowed, 5 active, 10 active and recording: GIMBAL_DEVICE_ATTITUDE_STATUS.flags, CAMERA_CAPTURE_STATUS.video_status";
        "Image Output State": "VIDEO_STREAM_STATUS.flags: none, EO or IR";
        "Actual Centreline Elevation Angle": "GIMBAL_DEVICE_ATTITUDE_STATUS.q and ATTITUDE, brought to the Time Stamp by its rates";
        "Actual Vertical Field of View": "CAMERA_FOV_STATUS.vfov";
        "Actual Centreline Azimuth Angle": "GIMBAL_DEVICE_ATTITUDE_STATUS.q and ATTITUDE, brought to the Time Stamp by its rates";
        "Actual Horizontal Field of View": "CAMERA_FOV_STATUS.hfov";
        "Image Position": "1 where the next three are known: of one moment, that of GLOBAL_POSITION_INT";
        "Latitude of image centre": "where the line of sight meets the ground: vehicle.terrain, else flat at home's height";
        "Longitude of image centre": "where the line of sight meets the ground: vehicle.terrain, else flat at home's height";
        "Altitude": "of that ground, above the ellipsoid; known with the geoid separation";
        "Pointing Mode State": "the mode commanded by 19100 that the gimbal has shown";
        "Reported Range": "distance to where the line of sight meets the ground";
    }
}
