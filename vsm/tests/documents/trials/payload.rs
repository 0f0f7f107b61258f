//! Payload stations: steering, sensors.

use kit::bridge::{Rig, Setup, orders};
use stanag_msgs::enums::{
    AltitudeType, EoirPointingMode as Pointing, EoirSystemMode, FocusType, SetFocus, SetZoom,
    StationBitmap1To16,
};
use stanag_msgs::messages::{
    EoIrLaserPayloadCommand, GenericInformationRequestMessage, PayloadSteeringCommand,
};
use stanag_msgs::{Bam16, Bam32, Scaled};

use super::scenes::then_5_s;
use crate::scene::Trial;

pub(crate) fn two_payloads() -> Setup {
    Setup {
        vehicles: vec![px4_sim::Config {
            payloads: 2,
            ..px4_sim::Config::default()
        }],
        dli_keys: "provisional = \"all\"",
        ..Setup::default()
    }
}

/// All rights, and the devices known.
pub(super) fn control(rig: &mut Rig) {
    rig.run(3.0);
    rig.done(orders::request_control());
    rig.run(6.0);
}

fn in_mode(rig: &mut Rig, mode: Pointing) {
    control(rig);
    rig.done(by(mode));
}

fn by_angle(rig: &mut Rig) {
    in_mode(rig, Pointing::AngleToUa);
}

fn by_rate(rig: &mut Rig) {
    in_mode(rig, Pointing::SlewRateToUa);
}

fn by_place(rig: &mut Rig) {
    control(rig);
    rig.take_off(20.0);
    rig.done(by(Pointing::AngleToUa));
    rig.done(angles(0.0, -40.0));
    rig.done(by(Pointing::LatLongSlaved));
}

fn focused_by_hand(rig: &mut Rig) {
    control(rig);
    rig.done(PayloadSteeringCommand {
        set_focus: Some(SetFocus::FocusCloser),
        ..steer()
    });
}

fn by(mode: Pointing) -> EoIrLaserPayloadCommand {
    EoIrLaserPayloadCommand {
        set_eo_ir_pointing_mode: Some(mode),
        ..sensor()
    }
}

fn steer() -> PayloadSteeringCommand {
    PayloadSteeringCommand {
        station_number_1_16: Some(StationBitmap1To16::from_raw(2)),
        ..PayloadSteeringCommand::default()
    }
}

fn angles(azimuth: f64, elevation: f64) -> PayloadSteeringCommand {
    PayloadSteeringCommand {
        set_centreline_azimuth_angle: Some(Bam16::from_degrees(azimuth)),
        set_centreline_elevation_angle: Some(Bam16::from_degrees(elevation)),
        ..steer()
    }
}

fn sensor() -> EoIrLaserPayloadCommand {
    EoIrLaserPayloadCommand {
        station_number_1_16: Some(StationBitmap1To16::from_raw(2)),
        ..EoIrLaserPayloadCommand::default()
    }
}

pub(super) fn payload() -> Vec<Trial> {
    vec![
        trial!(
            two_payloads,
            by_angle,
            then_5_s,
            PayloadSteeringCommand {
                set_zoom: Some(SetZoom::UseFieldsOfView),
                set_focus: Some(SetFocus::NoChange),
                ..angles(20.0, -30.0)
            },
            [
                "Station Number 1-16" = "0" refused "refused",
                "Set Centreline Azimuth Angle" = "32000" refused "refused",
                "Set Centreline Elevation Angle" = "-9000",
                "Set Zoom" = "2",
                "Set Horizontal Field of View" = "4000",
                "Set Focus" = "2",
            ]
        ),
        trial!(
            two_payloads,
            by_rate,
            then_5_s,
            PayloadSteeringCommand {
                horizontal_slew_rate: Some(Scaled::saturating_from_si(0.1)),
                vertical_slew_rate: Some(Scaled::saturating_from_si(-0.05)),
                ..steer()
            },
            ["Horizontal Slew Rate" = "-20", "Vertical Slew Rate" = "-20",]
        ),
        trial!(
            two_payloads,
            by_place,
            then_5_s,
            PayloadSteeringCommand {
                latitude: Some(Bam32::from_degrees(orders::place(40.0, 0.0).0)),
                longitude: Some(Bam32::from_degrees(orders::place(0.0, 10.0).1)),
                altitude: Some(Scaled::saturating_from_si(0.0)),
                altitude_type: Some(AltitudeType::Agl),
                ..steer()
            },
            [
                "Latitude" = "+3000",
                "Longitude" = "+3000",
                "Altitude" = "null" refused "needed",
                "Altitude Type" = "9" refused "others are refused",
            ]
        ),
        trial!(
            two_payloads,
            focused_by_hand,
            then_5_s,
            PayloadSteeringCommand {
                focus_type: Some(FocusType::Manual),
                ..steer()
            },
            ["Focus Type" = "0"]
        ),
        trial!(
            two_payloads,
            control,
            then_5_s,
            EoIrLaserPayloadCommand {
                system_operating_mode: Some(EoirSystemMode::Active),
                ..sensor()
            },
            [
                "Station Number 1-16" = "3" refused "refused",
                "System Operating Mode" = "10",
                "Image Output" = "2" refused "others are refused",
                "Set EO/IR Pointing Mode" = "1",
                "Fire Laser Pointer" = "51" refused "others are refused",
                "Fire Laser Rangefinder" = "51" refused "others are refused",
                "Initiate Laser Designator" = "51" refused "others are refused",
            ]
        ),
        trial!(
            two_payloads,
            control,
            then_5_s,
            GenericInformationRequestMessage {
                message_type: Some(21100),
                ..GenericInformationRequestMessage::default()
            },
            ["Station Number 1-16" = "2"]
        ),
    ]
}
