//! Payload stations (19001, 19100, 21101): what an EO/IR operator with LOI 3 of a station does.

use std::io::Write;
use std::str::FromStr;

use clap::{Args, Subcommand, ValueEnum};
use serde_json::{Value, json};
use stanag_msgs::enums::{
    AltitudeType, EoirPointingMode as Pointing, EoirSystemMode as System, FocusType, ImageOutput,
    SetFocus, SetZoom, StationBitmap1To16,
};
use stanag_msgs::messages::{
    EoIrLaserOperatingState, EoIrLaserPayloadCommand, GenericInformationRequestMessage,
    PayloadSteeringCommand, VideoStreamReport,
};
use stanag_msgs::{Bam16, Bam32, Id, Message, Scaled};

use super::argument::{Expected, altitude_type, degrees};
use super::console::{Done, Operator};
use crate::session::machine::Session;
use crate::session::sender::Edition;
use crate::session::vehicle::Vehicle;
use crate::station::endpoint::Station;
use crate::station::outcome::{Outcome, StationError};
use route_files::route::form::altitude_type_name;

/// A payload station, and what it is to do.
#[derive(Clone, Debug, Args)]
pub struct PayloadArguments {
    /// Number of the payload station, 1 to 16 (default: 1; for `state` all that there are).
    #[arg(long, value_name = "NUMBER", global = true, value_parser = clap::value_parser!(u8).range(1..=16))]
    station: Option<u8>,
    /// What to do.
    #[command(subcommand)]
    verb: PayloadVerb,
}

/// What `payload` does.
#[derive(Clone, Debug, Subcommand)]
enum PayloadVerb {
    #[command(flatten)]
    Command(PayloadAction),
    /// Show what the station does and where it really looks (21101).
    State,
    /// Show the video streams of the stations: what they are, and their addresses (50025).
    Streams,
}

/// A command to a payload station.
#[derive(Clone, Debug, PartialEq, Subcommand)]
pub enum PayloadAction {
    /// Point by angles relative to the vehicle, such as `payload point 30 -45`.
    Point {
        /// Right of the vehicle's nose, degrees, -180 to 180.
        #[arg(allow_negative_numbers = true, value_parser = within::<180>)]
        azimuth: f64,
        /// Above the vehicle's waterline, degrees, -90 to 90.
        #[arg(allow_negative_numbers = true, value_parser = within::<90>)]
        elevation: f64,
    },
    /// Turn at a rate, until another command, such as `payload rate 5 0`.
    Rate {
        /// To the right, degrees a second.
        #[arg(allow_negative_numbers = true, value_parser = within::<180>)]
        right: f64,
        /// Upwards, degrees a second.
        #[arg(allow_negative_numbers = true, value_parser = within::<180>)]
        up: f64,
        /// Turn relative to the ground in place of the vehicle.
        #[arg(long)]
        inertial: bool,
    },
    /// Look at a place while the vehicle moves, such as `payload at 47.3990,8.5472`.
    At {
        /// Degrees north and east.
        #[arg(value_name = "LAT,LON", value_parser = degrees, allow_hyphen_values = true)]
        place: (f64, f64),
        /// Altitude of the place, metres.
        #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
        altitude: f64,
        /// Datum of the altitude: agl, wgs84, amsl, pressure.
        #[arg(long, default_value = "agl", value_name = "TYPE", value_parser = altitude_type)]
        altitude_type: AltitudeType,
    },
    /// Stow the gimbal.
    Stow,
    /// Look ahead, level.
    Cage,
    /// Zoom, such as `payload zoom 20` or `payload zoom in`.
    Zoom {
        /// in, out or stop, or a horizontal field of view in degrees.
        to: ZoomTo,
    },
    /// Focus a step closer or farther, or let the camera focus by itself.
    Focus {
        /// Which.
        to: FocusTo,
    },
    /// Take one photograph.
    Photo,
    /// Record video.
    Record {
        /// Begin or end.
        switch: Switch,
    },
    /// Select the sensor whose image is sent.
    Image {
        /// Which.
        sensor: Sensor,
    },
}

/// What to zoom to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ZoomTo {
    /// Narrower, until stopped.
    In,
    /// Wider, until stopped.
    Out,
    /// No further.
    Stop,
    /// A horizontal field of view, degrees.
    Field(f64),
}

impl FromStr for ZoomTo {
    type Err = Expected;

    fn from_str(text: &str) -> Result<ZoomTo, Expected> {
        let field = || {
            text.parse()
                .ok()
                .filter(|field| (0.1..180.0).contains(field))
        };
        match text {
            "in" => Ok(ZoomTo::In),
            "out" => Ok(ZoomTo::Out),
            "stop" => Ok(ZoomTo::Stop),
            _ => field().map(ZoomTo::Field).ok_or(Expected(
                "in, out, stop or a horizontal field of view of 0.1 to 180 degrees",
            )),
        }
    }
}

/// How to focus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FocusTo {
    /// A step closer.
    Closer,
    /// A step farther.
    Farther,
    /// By itself.
    Auto,
}

/// On or off.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Switch {
    /// Begin.
    On,
    /// End.
    Off,
}

/// A sensor of a station.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Sensor {
    /// The camera of visible light.
    Eo,
    /// The thermal camera.
    Ir,
}

/// Degrees to either side of 0.
fn within<const LIMIT: u16>(text: &str) -> Result<f64, String> {
    let limit = f64::from(LIMIT);
    let number = text.parse().ok();
    number
        .filter(|number| (-limit..=limit).contains(number))
        .ok_or_else(|| format!("expected -{LIMIT} to {LIMIT} degrees"))
}

impl PayloadAction {
    /// Commands a payload station of a vehicle, and waits until the VSM has seen the result. A pointing mode is
    /// commanded before what depends on it.
    ///
    /// # Errors
    /// There is no final answer within [`Timeouts::command`](crate::Timeouts), or a value that its field cannot
    /// express.
    pub async fn carry_out(
        &self,
        station: &mut Station,
        vehicle: Id,
        number: u8,
    ) -> Result<Outcome, StationError> {
        for message in self.messages(number)? {
            let outcome = station.operate_payload(vehicle, message).await?;
            if !outcome.is_carried_out() {
                return Ok(outcome);
            }
        }
        Ok(Outcome::CarriedOut)
    }

    /// The messages for it, in order.
    ///
    /// # Errors
    /// A value that its field cannot express.
    pub fn messages(&self, number: u8) -> Result<Vec<Message>, StationError> {
        let station = Some(bit(number));
        let sensor = EoIrLaserPayloadCommand {
            station_number_1_16: station,
            ..EoIrLaserPayloadCommand::default()
        };
        let steering = PayloadSteeringCommand {
            station_number_1_16: station,
            ..PayloadSteeringCommand::default()
        };
        let system = |mode| {
            let command = EoIrLaserPayloadCommand {
                system_operating_mode: Some(mode),
                ..sensor.clone()
            };
            vec![command.into()]
        };
        // 19100 selects the pointing mode by which the values of 19001 count, so it is sent first.
        let pointing = |mode, steering: PayloadSteeringCommand| {
            let command = EoIrLaserPayloadCommand {
                set_eo_ir_pointing_mode: Some(mode),
                ..sensor.clone()
            };
            vec![command.into(), steering.into()]
        };
        let rate = |degrees: f64| Scaled::from_si(degrees.to_radians());
        Ok(match self {
            PayloadAction::Point { azimuth, elevation } => pointing(
                Pointing::AngleToUa,
                PayloadSteeringCommand {
                    set_centreline_azimuth_angle: Some(Bam16::from_degrees(*azimuth)),
                    set_centreline_elevation_angle: Some(Bam16::from_degrees(*elevation)),
                    ..steering
                },
            ),
            PayloadAction::Rate {
                right,
                up,
                inertial,
            } => {
                let mode = if *inertial {
                    Pointing::SlewRateInertial
                } else {
                    Pointing::SlewRateToUa
                };
                let steering = PayloadSteeringCommand {
                    horizontal_slew_rate: Some(rate(*right)?),
                    vertical_slew_rate: Some(rate(*up)?),
                    ..steering
                };
                pointing(mode, steering)
            }
            PayloadAction::At {
                place: (latitude, longitude),
                altitude,
                altitude_type,
            } => pointing(
                Pointing::LatLongSlaved,
                PayloadSteeringCommand {
                    latitude: Some(Bam32::from_degrees(*latitude)),
                    longitude: Some(Bam32::from_degrees(*longitude)),
                    altitude: Some(Scaled::from_si(*altitude)?),
                    altitude_type: Some(*altitude_type),
                    ..steering
                },
            ),
            PayloadAction::Stow => system(System::Stow),
            PayloadAction::Cage => system(System::Cage),
            PayloadAction::Photo => system(PHOTOGRAPH),
            PayloadAction::Record { switch: Switch::On } => system(RECORDING),
            PayloadAction::Record {
                switch: Switch::Off,
            } => system(System::Active),
            PayloadAction::Zoom { to } => {
                let (zoom, field) = match to {
                    ZoomTo::In => (SetZoom::ZoomIn, None),
                    ZoomTo::Out => (SetZoom::ZoomOut, None),
                    ZoomTo::Stop => (SetZoom::NoChange, None),
                    ZoomTo::Field(degrees) => (SetZoom::UseFieldsOfView, Some(*degrees)),
                };
                let command = PayloadSteeringCommand {
                    set_zoom: Some(zoom),
                    set_horizontal_field_of_view: field.map(Bam16::from_degrees),
                    ..steering
                };
                vec![command.into()]
            }
            PayloadAction::Focus { to } => {
                let (set, by) = match to {
                    FocusTo::Closer => (SetFocus::FocusCloser, FocusType::Manual),
                    FocusTo::Farther => (SetFocus::FocusFarther, FocusType::Manual),
                    FocusTo::Auto => (SetFocus::NoChange, FocusType::Auto),
                };
                let command = PayloadSteeringCommand {
                    set_focus: Some(set),
                    focus_type: Some(by),
                    ..steering
                };
                vec![command.into()]
            }
            PayloadAction::Image { sensor: which } => {
                let command = EoIrLaserPayloadCommand {
                    image_output: Some(match which {
                        Sensor::Eo => ImageOutput::Eo,
                        Sensor::Ir => ImageOutput::Ir,
                    }),
                    ..sensor
                };
                vec![command.into()]
            }
        })
    }

    /// The text that is printed once it is done.
    fn done(&self) -> String {
        match self {
            PayloadAction::Point { azimuth, elevation } => {
                format!("looks {azimuth} degrees right of the nose, {elevation} degrees up")
            }
            PayloadAction::Rate { right, up, .. } => {
                format!("turns {right} degrees/s to the right, {up} degrees/s up")
            }
            PayloadAction::At { place, .. } => format!("looks at {},{}", place.0, place.1),
            PayloadAction::Stow => "is stowed".to_owned(),
            PayloadAction::Cage => "looks ahead".to_owned(),
            PayloadAction::Zoom { to } => match to {
                ZoomTo::In => "zooms in".to_owned(),
                ZoomTo::Out => "zooms out".to_owned(),
                ZoomTo::Stop => "has stopped zooming".to_owned(),
                ZoomTo::Field(field) => format!("has a field of view of {field} degrees"),
            },
            PayloadAction::Focus { to } => match to {
                FocusTo::Closer => "is focused a step closer".to_owned(),
                FocusTo::Farther => "is focused a step farther".to_owned(),
                FocusTo::Auto => "focuses by itself".to_owned(),
            },
            PayloadAction::Photo => "has taken a photograph".to_owned(),
            PayloadAction::Record { switch: Switch::On } => "records".to_owned(),
            PayloadAction::Record {
                switch: Switch::Off,
            } => "does not record".to_owned(),
            PayloadAction::Image { sensor: Sensor::Eo } => "sends the EO image".to_owned(),
            PayloadAction::Image { sensor: Sensor::Ir } => "sends the IR image".to_owned(),
        }
    }
}

impl<W: Write> Operator<W> {
    /// Commands by 19001 and 19100, or requests the state (17002 for 21101).
    pub(super) async fn payload(&mut self, arguments: &PayloadArguments) -> Done {
        let vehicle = self.find_vehicle().await?;
        match &arguments.verb {
            PayloadVerb::Command(action) => {
                let number = arguments.station.unwrap_or(1);
                self.learn_payload(vehicle, number).await?;
                let outcome = action.carry_out(&mut self.station, vehicle, number).await?;
                let what = format!("payload station {number} {}", action.done());
                self.finish(vehicle, &what, outcome)
            }
            PayloadVerb::State => self.payload_state(vehicle, arguments.station).await,
            PayloadVerb::Streams => self.payload_streams(vehicle, arguments.station).await,
        }
    }

    /// Requests the state of a station before a command in Edition 2.5: such a command also repeats what the station
    /// does already, which a new process does not know.
    async fn learn_payload(&mut self, vehicle: Id, number: u8) -> Done {
        let known = |session: &Session| {
            let state = session.vehicle(vehicle);
            state.is_some_and(|state| state.payload(number).is_some())
        };
        if self.station.session().edition() != Edition::Ed25 || known(self.station.session()) {
            return Ok(());
        }
        self.request_payload(vehicle, Some(number)).await?;
        let what = format!("state of payload station {number} (#302)");
        let within = self.station.timeouts.answer;
        Ok(self.station.wait_until(&what, within, known).await?)
    }

    /// Requests the state (17002 for 21101).
    async fn request_payload(&mut self, vehicle: Id, number: Option<u8>) -> Done {
        let request = GenericInformationRequestMessage {
            message_type: Some(EoIrLaserOperatingState::ID),
            station_number_1_16: number.map(bit),
            ..GenericInformationRequestMessage::default()
        };
        let what = "payload state (17002 for 21101)";
        self.query(vehicle, request, what).await?;
        Ok(())
    }

    async fn payload_state(&mut self, vehicle: Id, number: Option<u8>) -> Done {
        self.request_payload(vehicle, number).await?;
        // The latest report of each station, even where it came before the answer.
        let state = self.state(vehicle);
        let named = (1..=16).filter(|one| number.is_none_or(|number| number == *one));
        let known: Vec<(String, Value)> = named.filter_map(|one| described(one, state?)).collect();
        if known.is_empty() {
            let named = number.map_or_else(String::new, |number| format!(" {number}"));
            return self.print(
                &format!("{vehicle}: no state of a payload station{named} is reported"),
                json!({"payload_stations": []}),
            );
        }
        for (line, value) in known {
            self.print(&format!("{vehicle}: {line}"), value)?;
        }
        Ok(())
    }
}

impl<W: Write> Operator<W> {
    /// Requests the video streams (17002 for 50025).
    async fn payload_streams(&mut self, vehicle: Id, number: Option<u8>) -> Done {
        let request = GenericInformationRequestMessage {
            message_type: Some(VideoStreamReport::ID),
            station_number_1_16: number.map(bit),
            ..GenericInformationRequestMessage::default()
        };
        let what = "video streams (17002 for 50025)";
        let answers = self.query(vehicle, request, what).await?;
        let mut any = false;
        for answer in &answers {
            let Message::VideoStreamReport(stream) = answer else {
                continue;
            };
            any = true;
            let (line, value) = described_stream(stream);
            self.print(&format!("{vehicle}: {line}"), value)?;
        }
        if !any {
            let line = format!("{vehicle}: no video stream is reported");
            self.print(&line, json!({"video_streams": []}))?;
        }
        Ok(())
    }
}

/// A video stream, as a line and for programs; unknown values are null there.
fn described_stream(stream: &VideoStreamReport) -> (String, Value) {
    let bits = stream
        .station_number_1_16
        .map_or(0, StationBitmap1To16::raw);
    let station = bits.is_power_of_two().then(|| bits.trailing_zeros() + 1);
    let number = stream.stream_number.unwrap_or_default();
    let kind = stream.stream_type.map(|kind| kind.to_string());
    let encoding = stream.video_encoding.map(|encoding| encoding.to_string());
    let size = stream.horizontal_resolution.zip(stream.vertical_resolution);
    let uri = stream.uri.as_ref().map(|uri| uri.as_str().to_owned());
    let shown = size.map(|(columns, rows)| format!("{columns} x {rows}"));
    let parts = [uri.clone(), kind.clone(), encoding.clone(), shown];
    let parts: Vec<String> = parts.into_iter().flatten().collect();
    let of = station.map_or_else(String::new, |station| format!("payload station {station} "));
    let line = format!("{of}stream {number}: {}", parts.join(", "));
    let value = json!({
        "payload_station": station, "stream": number, "uri": uri, "type": kind, "encoding": encoding,
        "resolution": size.map(|(columns, rows)| [columns, rows]),
    });
    (line, value)
}

/// The bitmap of one station.
fn bit(number: u8) -> StationBitmap1To16 {
    StationBitmap1To16::from_raw(1 << (number.clamp(1, 16) - 1))
}

/// The name of a mode; payload-specific ones as the guide of `vsm` names them.
fn system_name(mode: System) -> String {
    if mode == RECORDING {
        "recording".to_owned()
    } else {
        mode.to_string()
    }
}

/// The state of a station, as a line and for programs; unknown values are null there.
fn described(number: u8, vehicle: &Vehicle) -> Option<(String, Value)> {
    let state = vehicle.payload(number)?;
    let center = vehicle.image_center(number);
    let azimuth = state.actual_centreline_azimuth_angle.map(Bam16::degrees);
    let elevation = state.actual_centreline_elevation_angle.map(Bam16::degrees);
    let field = state.actual_horizontal_field_of_view.map(Bam16::degrees);
    let mut parts = Vec::new();
    parts.extend(state.system_operating_mode_state.map(system_name));
    parts.extend(
        (state.pointing_mode_state).map(|mode| format!("pointing mode {} ({mode})", mode.raw())),
    );
    parts.push(azimuth.zip(elevation).map_or_else(
        || "direction unknown".to_owned(),
        |(azimuth, elevation)| format!("azimuth {azimuth:.1} elevation {elevation:.1} degrees"),
    ));
    parts.extend(field.map(|field| format!("field of view {field:.1} degrees")));
    parts.push(center.map_or_else(
        || "image centre unknown".to_owned(),
        |at| {
            format!(
                "image centre {:.7} {:.7} {:.1} m {}",
                at.latitude_deg,
                at.longitude_deg,
                at.altitude_m,
                altitude_type_name(at.altitude_type)
            )
        },
    ));
    parts.extend(
        state
            .reported_range
            .map(|range| format!("range {range:.0} m")),
    );
    parts.extend(
        state
            .image_output_state
            .map(|image| format!("image {image}")),
    );
    let line = format!("payload station {number}: {}", parts.join(", "));
    let value = json!({
        "payload_station": number,
        "system_mode": state.system_operating_mode_state.map(|mode| mode.raw()),
        "pointing_mode": state.pointing_mode_state.map(|mode| mode.raw()),
        "azimuth_deg": azimuth,
        "elevation_deg": elevation,
        "horizontal_field_of_view_deg": field,
        "image_centre_latitude_deg": center.map(|at| at.latitude_deg),
        "image_centre_longitude_deg": center.map(|at| at.longitude_deg),
        "image_centre_altitude_m": center.map(|at| at.altitude_m),
        "range_m": state.reported_range,
        "image_output": state.image_output_state.map(|image| image.raw()),
    });
    Some((line, value))
}

/// System Operating Modes 10 and 11 are payload specific; the guide of `vsm` describes them.
const RECORDING: System = System::Unknown(10);
const PHOTOGRAPH: System = System::Unknown(11);
