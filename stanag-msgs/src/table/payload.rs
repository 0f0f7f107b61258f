//! Payload commands and status: 19001 to 21101.

use std::f64::consts::FRAC_PI_2;

use super::codec::messages;
use crate::enums::{
    AddressedSensor, AltitudeType, EoMode, EoirPointingMode, EoirSystemMode, FirstLastPulse,
    FocusType, ImageOutput, IrPolarity, LaserDesignatorCmd, LaserPointerCmd, LaserRfCmd,
    PayloadType, PreplanMode, SetFocus, SetZoom, StationBitmap1To16,
};
use crate::id::Id;
use crate::scalar::{Altitude, AngularRate, Bam16, Bam32, Text, TimeStamp};

messages! {
    PayloadSteeringCommand = 19001, "Payload Steering Command", presence bytes 2
        sent(ToVsm, Push) layout(Ed2Derived, C) latency_ms(200) ed2_message("200")
        source("E2 #200 = F = P")
        note("Ed4 order unknown: Component/Sub-Component, Activity ID, Station 17-32 are missing here")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0200.01");
        station_number_1_16: StationBitmap1To16 = 1, "Station Number 1-16", uid("0200.04");
        set_centreline_azimuth_angle: Bam16 = 2, "Set Centreline Azimuth Angle",
            uid("0200.05"), note("right +");
        set_centreline_elevation_angle: Bam16 = 3, "Set Centreline Elevation Angle",
            uid("0200.06"), note("up +");
        set_zoom: SetZoom = 4, "Set Zoom", uid("0200.17");
        set_horizontal_field_of_view: Bam16 = 5, "Set Horizontal Field of View",
            uid("0200.07"), note("Ed2 0..2pi, so an Unsigned 2 BAM in Ed3/4");
        set_vertical_field_of_view: Bam16 = 6, "Set Vertical Field of View", uid("0200.08");
        horizontal_slew_rate: AngularRate = 7, "Horizontal Slew Rate",
            uid("0200.09"), note("scale not found");
        vertical_slew_rate: AngularRate = 8, "Vertical Slew Rate",
            uid("0200.10"), note("scale not found");
        latitude: Bam32 = 9, "Latitude", uid("0200.11"), range(-FRAC_PI_2, FRAC_PI_2);
        longitude: Bam32 = 10, "Longitude", uid("0200.12");
        altitude: Altitude = 11, "Altitude", uid("0200.13");
        altitude_type: AltitudeType = 12, "Altitude Type", uid("0200.14");
        set_focus: SetFocus = 13, "Set Focus", uid("0200.15");
        focus_type: FocusType = 14, "Focus Type", uid("0200.16");
    }

    EoIrLaserPayloadCommand = 19100, "EO/IR/Laser Payload Command", presence bytes 2
        sent(ToVsm, Push) layout(Ed2Derived, C) latency_ms(1000) ed2_message("201")
        source("F (AEP-84 era order) / E2 #201")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0201.01");
        station_number_1_16: StationBitmap1To16 = 1, "Station Number 1-16", uid("0201.04");
        addressed_sensor: AddressedSensor = 2, "Addressed Sensor", uid("0201.05");
        system_operating_mode: EoirSystemMode = 3, "System Operating Mode", uid("0201.06");
        set_eo_sensor_mode: EoMode = 4, "Set EO Sensor Mode", uid("0201.07");
        set_ir_polarity: IrPolarity = 5, "Set IR Polarity", uid("0201.08");
        image_output: ImageOutput = 6, "Image Output", uid("0201.09");
        set_eo_ir_pointing_mode: EoirPointingMode = 7, "Set EO/IR Pointing Mode", uid("0201.10");
        fire_laser_pointer: LaserPointerCmd = 8, "Fire Laser Pointer", uid("0201.11");
        fire_laser_rangefinder: LaserRfCmd = 9, "Fire Laser Rangefinder",
            note("separate in F, merged in E2");
        select_laser_rangefinder_first_last_pulse: FirstLastPulse = 10, "Select Laser Rangefinder First/Last Pulse",
            uid("0201.12");
        set_laser_designator_code: u16 = 11, "Set Laser Designator Code", uid("0201.13");
        initiate_laser_designator: LaserDesignatorCmd = 12, "Initiate Laser Designator",
            uid("0201.14");
        preplan_mode: PreplanMode = 13, "Preplan Mode", uid("0201.15");
    }

    SarPayloadCommand = 19200, "SAR Payload Command", presence bytes 1
        sent(ToVsm, Push) layout(Ed2Derived, C) latency_ms(1000) ed2_message("202")
        source("E2 #202")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0202.01");
        station_number_1_16: StationBitmap1To16 = 1, "Station Number 1-16", uid("0202.04");
        set_radar_state: u8 = 2, "Set Radar State", uid("0202.05");
        set_mti_radar_mode: u8 = 3, "Set MTI Radar Mode", uid("0202.06");
        set_sar_modes: Text<6> = 4, "Set SAR Modes", uid("0202.07");
        set_radar_resolution: i16 = 5, "Set Radar Resolution", uid("0202.08"), unit("cm");
    }

    PayloadConfiguration = 21000, "Payload Configuration", presence bytes 1
        sent(ToCucs, PushPull) layout(Ed2Derived, C) latency_ms(1000) ed2_message("300")
        source("E2 #300 / F; the id 21000 is by group start")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0300.01");
        vsm_id: Id = 1, "VSM ID", uid("0300.04");
        payload_stations_available_1_16: StationBitmap1To16 = 2, "Payload Stations Available 1-16",
            uid("0300.05");
        station_number_1_16: StationBitmap1To16 = 3, "Station Number 1-16", uid("0300.06");
        payload_type: PayloadType = 4, "Payload Type", uid("0300.07");
        station_door: u8 = 5, "Station Door", uid("0300.08");
        number_of_payload_recording_devices: u8 = 6, "Number of Payload Recording Devices",
            uid("0300.09");
    }

    EoIrConfigurationState = 21100, "EO/IR Configuration State", presence bytes 2
        sent(ToCucs, Pull) layout(Ed2Derived, C) latency_ms(200) ed2_message("301")
        source("E2 #301 / F; id guessed")
        note("id not established (pattern guess)")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0301.01");
        vsm_id: Id = 1, "VSM ID", uid("0301.04");
        station_number_1_16: u16 = 2, "Station Number 1-16", uid("0301.05");
        eo_ir_type: Text<14> = 3, "EO/IR Type", uid("0301.06");
        eo_ir_type_revision_level: u8 = 4, "EO/IR Type Revision Level", uid("0301.07");
        eo_vertical_image_dimension: i16 = 5, "EO Vertical Image Dimension", uid("0301.08");
        eo_horizontal_image_dimension: i16 = 6, "EO Horizontal Image Dimension", uid("0301.09");
        ir_vertical_image_dimension: i16 = 7, "IR Vertical Image Dimension", uid("0301.10");
        ir_horizontal_image_dimension: i16 = 8, "IR Horizontal Image Dimension", uid("0301.11");
        field_of_regard_elevation_min: Bam16 = 9, "Field of Regard - Elevation Min", uid("0301.12");
        field_of_regard_elevation_max: Bam16 = 10, "Field of Regard - Elevation Max",
            uid("0301.13");
        field_of_regard_azimuth_min: Bam16 = 11, "Field of Regard - Azimuth Min", uid("0301.14");
        field_of_regard_azimuth_max: Bam16 = 12, "Field of Regard - Azimuth Max", uid("0301.15");
    }

    EoIrLaserOperatingState = 21101, "EO/IR/Laser Operating State", presence bytes 3
        sent(ToCucs, PushPull) layout(Ed2Derived, C) latency_ms(2000) ed2_message("302")
        source("E2 #302 / F; id guessed")
        note("id not established (pattern guess)")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0302.01");
        station_number_1_16: u16 = 1, "Station Number 1-16", uid("0302.04");
        addressed_sensor: AddressedSensor = 2, "Addressed Sensor", uid("0302.05");
        system_operating_mode_state: EoirSystemMode = 3, "System Operating Mode State",
            uid("0302.06");
        eo_sensor_mode_status: EoMode = 4, "EO Sensor Mode Status", uid("0302.07");
        ir_polarity_status: IrPolarity = 5, "IR Polarity Status", uid("0302.08");
        image_output_state: ImageOutput = 6, "Image Output State", uid("0302.09");
        actual_centreline_elevation_angle: Bam16 = 7, "Actual Centreline Elevation Angle",
            uid("0302.10");
        actual_vertical_field_of_view: Bam16 = 8, "Actual Vertical Field of View", uid("0302.11");
        actual_centreline_azimuth_angle: Bam16 = 9, "Actual Centreline Azimuth Angle",
            uid("0302.12");
        actual_horizontal_field_of_view: Bam16 = 10, "Actual Horizontal Field of View",
            uid("0302.13");
        actual_sensor_rotation_angle: Bam16 = 11, "Actual Sensor Rotation Angle", uid("0302.14");
        image_position: u8 = 12, "Image Position", uid("0302.15"), note("1 = lat/lon/alt valid");
        latitude_of_image_centre: Bam32 = 13, "Latitude of image centre",
            uid("0302.16"), range(-FRAC_PI_2, FRAC_PI_2);
        longitude_of_image_centre: Bam32 = 14, "Longitude of image centre", uid("0302.17");
        altitude: Altitude = 15, "Altitude", uid("0302.18");
        pointing_mode_state: EoirPointingMode = 16, "Pointing Mode State", uid("0302.19");
        preplan_mode: PreplanMode = 17, "Preplan Mode", uid("0302.20");
        reported_range: f32 = 18, "Reported Range", uid("0302.21"), unit("m");
        fire_laser_pointer_status: u8 = 19, "Fire Laser Pointer Status", uid("0302.22");
        fire_laser_rangefinder_status: u8 = 20, "Fire Laser Rangefinder Status";
        selected_laser_rangefinder_first_last_pulse: FirstLastPulse = 21, "Selected Laser Rangefinder First/Last Pulse",
            uid("0302.23");
        laser_designator_code: u16 = 22, "Laser Designator Code", uid("0302.24");
        laser_designator_status: u8 = 23, "Laser Designator Status", uid("0302.25");
    }
}
