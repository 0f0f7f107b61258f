//! Values of payload commands and states.

use super::values;

values! {
    SET_ZOOM = "set_zoom", Enumeration, "" {
        0 UseTheFieldsOfViewSet "use the fields of view set";
        1 NoChange "no change";
        2 ZoomInUntilToldToStop "zoom in until told to stop";
        3 ZoomOutUntilToldToStop "zoom out until told to stop";
    }

    SET_FOCUS = "set_focus", Enumeration, "" {
        0 NoChange "no change";
        1 Closer "closer";
        2 Farther "farther";
    }

    FOCUS_TYPE = "focus_type", Enumeration, "" {
        0 Auto "auto";
        1 Manual "manual";
    }

    ADDRESSED_SENSOR = "addressed_sensor", Bitmap, "" {
        0x01 EO "EO";
        0x02 IR "IR";
        0x04 PAYLOAD_SPECIFIC "payload specific";
    }

    EOIR_SYSTEM_MODE = "eoir_system_mode", Enumeration, "" {
        0 Stow "stow";
        1 Off "off";
        2 Cage "cage";
        3 Initialise "initialise";
        4 Standby "standby";
        5 Active "active";
        6 Calibrate "calibrate";
        .. "7-9" "reserved";
        .. "10-255" "payload specific";
    }

    EO_MODE = "eo_mode", Enumeration, "" {
        0 BlackAndWhite "black and white";
        1 Colour "colour";
    }

    IR_POLARITY = "ir_polarity", Enumeration, "" {
        0 BlackHot "black hot";
        1 WhiteHot "white hot";
    }

    IMAGE_OUTPUT = "image_output", Enumeration, "" {
        0 None "none";
        1 EO "EO";
        2 IR "IR";
        3 Both "both";
        4 PayloadSpecific "payload specific";
    }

    EOIR_POINTING_MODE = "eoir_pointing_mode", Enumeration, "" {
        0 NoValue "no value";
        1 AngleRelativeToTheVehicle "angle relative to the vehicle";
        2 SlewRateRelativeToTheVehicle "slew rate relative to the vehicle";
        3 SlewRateRelativeToInertial "slew rate relative to inertial";
        4 SlavedToAPosition "slaved to a position";
        5 SlavedToATargetTrack "slaved to a target (track)";
        .. "6-9" "reserved";
        .. "10-255" "payload specific";
    }

    LASER_FIRE_CMD = "laser_fire_cmd", Enumeration, "printed as bit patterns: 0000 0000, 0011 0011, 0101 0101, 1110 1110" {
        0x00 Off "off";
        0x33 OnDoNotFire "on, do not fire";
        0x55 FireOnePulse "fire one pulse";
        0xEE Fire "fire";
    }

    LASER_FIRE_STATUS = "laser_fire_status", Enumeration, "" {
        0 Off "off";
        1 OnNotFiring "on, not firing";
        2 OnRecharging "on, recharging";
        3 Lasing "lasing";
        4 LaserMasked "laser masked";
    }

    FIRST_LAST_PULSE = "first_last_pulse", Enumeration, "" {
        1 First "first";
        2 Last "last";
    }

    LASER_DESIGNATOR_CMD = "laser_designator_cmd", Enumeration, "printed as bit patterns: 0000 0000, 0011 0011, 0100 0100, 0101 0101" {
        0x00 Off "off";
        0x33 On "on";
        0x44 DeactivateLaser "deactivate laser";
        0x55 ActivateLaser "activate laser";
    }

    LASER_DESIGNATOR_STATUS = "laser_designator_status", Enumeration, "" {
        0 Off "off";
        1 OnDeactivated "on, deactivated";
        2 OnActivated "on, activated";
    }

    PREPLAN_MODE = "preplan_mode", Enumeration, "" {
        0 Preplanned "preplanned";
        1 Manual "manual";
    }

    IMAGE_POSITION = "image_position", Enumeration, "" {
        0 Fields1617And18NotValid "fields 16, 17 and 18 not valid";
        1 Fields1617And18Valid "fields 16, 17 and 18 valid";
    }

    RADAR_STATE = "radar_state", Enumeration, "" {
        0 TurnOff "turn off";
        1 TurnOn "turn on";
        2 GoToStandby "go to standby";
        3 Deploy "deploy";
        4 Activate "activate";
        5 Deactivate "deactivate";
        6 Stow "stow";
        .. "7-9" "reserved";
        .. "10-255" "payload specific";
    }

    RADAR_STATUS = "radar_status", Enumeration, "" {
        0 PoweredOff "powered off";
        1 PoweredOn "powered on";
        2 Standby "standby";
        3 Deployed "deployed";
        4 Activated "activated";
        5 Deactivated "deactivated";
        6 Stowed "stowed";
        .. "7-9" "reserved";
        .. "10-255" "payload specific";
    }

    MTI_MODE = "mti_mode", Enumeration, "" {
        1 ClutterMap "clutter map";
        2 MovingTarget "moving target";
        .. "3-9" "reserved";
        .. "10-255" "payload specific";
    }

    STORES_POWER_CMD = "stores_power_cmd", Enumeration, "" {
        0 NA "N/A";
        1 PowerOff "power off";
        2 PowerOn "power on";
    }

    WEAPON_MODE_CMD = "weapon_mode_cmd", Enumeration, "printed as bit patterns; disarm really is 0000 0001, the others repeat a nibble" {
        0x00 NA "N/A";
        0x01 Disarm "disarm";
        0x22 Initialise "initialise";
        0x33 Arm "arm";
        0x44 Jettison "jettison";
        0x55 Launch "launch";
    }

    TARGET_ACQUISITION_MODE = "target_acquisition_mode", Enumeration, "" {
        0 NA "N/A";
        1 Coordinates "coordinates";
        2 SensorBasedTracking "sensor based tracking";
        .. "3-9" "reserved";
        .. "10-255" "payload specific";
    }

    ATTACK_MODE = "attack_mode", Enumeration, "" {
        0 NA "N/A";
        1 Time "time";
        2 Heading "heading";
        3 Window "window";
        4 Altitude "altitude";
        .. "5-9" "reserved";
        .. "10-255" "payload specific";
    }

    EJECTOR_CMD = "ejector_cmd", Enumeration, "" {
        0 NA "N/A";
        1 Lock "lock";
        2 Unlock "unlock";
    }

    EJECTOR_STATE = "ejector_state", Enumeration, "" {
        0 Unlocked "unlocked";
        1 Locked "locked";
    }

    SAFETY_DISCRETE = "safety_discrete", Enumeration, "" {
        0 NA "N/A";
        1 Enable "enable";
        2 Inhibit "inhibit";
    }

    WEAPON_TYPE = "weapon_type", Enumeration, "" {
        0 NoMode "no mode";
        1 AirToAir "air to air";
        2 AirToGround "air to ground";
        3 AirToSurface "air to surface";
    }

    WEAPON_SENSORS = "weapon_sensors", Enumeration, "" {
        0 NoMode "no mode";
        1 EO "EO";
        2 Laser "laser";
        3 EM "EM";
        4 IR "IR";
    }

    WEAPON_INITIALISING = "weapon_initialising", Enumeration, "" {
        0 NoMode "no mode";
        1 InitialAlignmentOfSensors "initial alignment of sensors";
        2 SeekerSteering "seeker steering";
        3 LoadingNavigationData "loading navigation data";
        4 LoadingTargetData "loading target data";
    }

    CLEARANCE = "clearance", Enumeration, "" {
        0 NotClear "not clear";
        1 Clear "clear";
    }

    WEAPON_POWER = "weapon_power", Enumeration, "" {
        0 Unpowered "unpowered";
        1 Powered "powered";
    }

    WEAPON_STATUS = "weapon_status", Enumeration, "" {
        0 NA "N/A";
        1 Ready "ready";
        2 Armed "armed";
    }

    LAR_STATUS = "lar_status", Enumeration, "" {
        0 NA "N/A";
        1 GreenAcceptable "green (acceptable)";
        2 YellowMarginal "yellow (marginal)";
        3 RedNotAcceptable "red (not acceptable)";
    }

    SEPARATION_STATUS = "separation_status", Enumeration, "" {
        0 NA "N/A";
        1 GreenReleased "green (released)";
        2 RedHungStore "red (hung store)";
    }

    RELAY_STATE = "relay_state", Enumeration, "" {
        0 TurnOff "turn off";
        1 TurnOn "turn on";
        2 GoToStandby "go to standby";
        3 Deploy "deploy";
        4 Activate "activate";
        5 Deactivate "deactivate";
        6 Stow "stow";
        .. "7-9" "reserved";
        .. "10-255" "payload specific";
    }

    RECORDING_INDEX_CMD = "recording_index_cmd", Enumeration, "" {
        0 Time "time";
        1 BlockNumber "block number";
        2 EventMark "event mark";
        3 SessionNumber "session number";
    }

    RECORDING_INDEX_TYPE = "recording_index_type", Enumeration, "" {
        0 Time "time";
        1 BlockNumber "block number";
        2 EventMark "event mark";
        3 SessionNumber "session number";
        .. "4-9" "reserved";
        .. "10-255" "payload specific";
    }

    RECORDING_MODE_CMD = "recording_mode_cmd", Enumeration, "" {
        0 Stop "stop";
        1 Ready "ready";
        2 Recording "recording";
        3 Play "play";
        4 Seek "seek";
        .. "5-9" "reserved";
        .. "10-255" "payload specific";
    }

    RECORDING_STATUS = "recording_status", Enumeration, "" {
        0 Stop "stop";
        1 ActiveNotReady "active, not ready";
        2 ReadyOrPause "ready or pause";
        3 Recording "recording";
    }

    REPLAY_MODE_CMD = "replay_mode_cmd", Enumeration, "" {
        0 Stop "stop";
        1 Ready "ready";
        2 Reading "reading";
        .. "3-9" "reserved";
        .. "10-255" "payload specific";
    }

    REPLAY_STATUS = "replay_status", Enumeration, "" {
        0 Stop "stop";
        1 ActiveNotReady "active, not ready";
        2 ReadyOrPause "ready or pause";
        3 Reading "reading";
    }

    BAY_DOORS = "bay_doors", Enumeration, "" {
        0 Closed "closed";
        1 Open "open";
    }

    PAYLOAD_TYPE = "payload_type", Enumeration, "the last range is printed as 51-256, in a field of 16 bits" {
        0 NotSpecified "not specified";
        1 EO "EO";
        2 IR "IR";
        3 EOIR "EO/IR";
        4 SAR "SAR";
        5 FixedCamera "fixed camera";
        6 CommsRelay "comms relay";
        7 DispensablePayload "dispensable payload";
        .. "8-50" "reserved";
        .. "51-256" "VSM specific";
    }

    NO_YES = "no_yes", Enumeration, "" {
        0 No "no";
        1 Yes "yes";
    }
}
