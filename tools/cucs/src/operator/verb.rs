//! The subcommands of `cucs`, which are also the lines of its scripts.

use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, Subcommand, ValueEnum};
use stanag_msgs::Id;
use stanag_msgs::enums::{AltitudeType, FlightPathControlMode, LoiBitmap, StationBitmap1To16};

use super::argument::{Expected, altitude_type, degrees, speed};
use super::payload::PayloadArguments;
use super::until::Until;
use crate::formats::{Import, Output};

/// One thing to do.
#[derive(Clone, Debug, Subcommand)]
pub enum Verb {
    /// Discover vehicles and the levels of interoperability on offer.
    Discover,
    /// Request rights over the vehicle, such as `take --loi 2,4,5`.
    Take {
        /// Levels of interoperability, such as 2,4,5 (default: all that this CUCS may hold).
        #[arg(long, value_name = "LEVELS")]
        loi: Option<LoiList>,
        /// Payload stations to control by LOI 3, such as 1,2 (default: all that there are).
        #[arg(long, value_name = "NUMBERS", value_parser = stations)]
        stations: Option<StationBitmap1To16>,
        /// Override a CUCS that holds them.
        #[arg(long = "override")]
        override_holder: bool,
    },
    /// Release all rights over the vehicle.
    Release,
    /// Hand over rights, with the consent of both CUCSs (messages 4 and 5).
    #[command(flatten)]
    Handover(HandoverVerb),
    /// Upload a route and load it aboard.
    Send {
        /// The route: a route file (.toml), or .plan, .waypoints, .txt, .kml, .kmz, .gpx, .geojson, .csv.
        file: PathBuf,
        /// Options for reading the file.
        #[command(flatten)]
        import: Import,
        /// Mission ID to use instead of the one in the file (at most 19 characters).
        #[arg(long)]
        mission_id: Option<String>,
    },
    /// Delete the plan, in the VSM and aboard.
    Clear,
    /// Cancel a transfer in progress, or a held command, such as `cancel --held 3`.
    Cancel {
        /// Number of the held command (50021); 0 for all of this CUCS.
        #[arg(long, value_name = "NUMBER")]
        held: Option<u16>,
    },
    /// Hold a mode command until a condition (50020), such as `hold 1 --until battery=25 contingency-a`.
    Hold(HoldArguments),
    /// Show the held commands, and how the latest ones ended (50022).
    Held,
    /// Show the contingencies, or set one before the flight (50023), such as `contingency battery return --percent 30`.
    Contingency {
        /// Cause of the contingency.
        #[arg(requires = "action")]
        cause: Option<ContingencyCause>,
        /// Action to fly for this cause; `as-configured` restores the configured one.
        action: Option<ContingencyAction>,
        /// Cause battery only: remaining energy below which the action is flown, per cent, 1 to 90 (default: as configured).
        #[arg(long, value_name = "PERCENT")]
        percent: Option<u8>,
    },
    /// Download the plan as a route file.
    #[command(mut_arg("written", |to| to.help("Write to this file (default: standard output)")))]
    Download {
        /// The file to write.
        #[command(flatten)]
        output: Output,
    },
    /// Command a mode (2016), such as `mode loiter --altitude 40`.
    Mode(ModeArguments),
    /// Arm and take off (mode 21), such as `launch 30`.
    Launch {
        /// Altitude to climb to, metres.
        #[arg(allow_negative_numbers = true)]
        altitude: f64,
        /// Datum of the altitude: agl, wgs84, amsl, pressure.
        #[arg(long, default_value = "agl", value_name = "TYPE", value_parser = altitude_type)]
        altitude_type: AltitudeType,
    },
    /// Fly the loaded route (mode 11), such as `fly --from 10 --speed 5`.
    Fly {
        /// Number of the waypoint to start from.
        #[arg(long, value_name = "WAYPOINT")]
        from: Option<u16>,
        /// Speed over ground, m/s.
        #[arg(long, allow_negative_numbers = true, value_parser = speed)]
        speed: Option<f64>,
    },
    /// Loiter, here or at a position (mode 12).
    Loiter {
        /// Position, degrees north and east, such as -33.9,18.4.
        #[arg(long, value_name = "LAT,LON", value_parser = degrees, allow_hyphen_values = true)]
        position: Option<(f64, f64)>,
        /// Altitude, metres.
        #[arg(long, allow_negative_numbers = true)]
        altitude: Option<f64>,
        /// Datum of the altitude: agl, wgs84, amsl, pressure.
        #[arg(long, default_value = "agl", value_name = "TYPE", value_parser = altitude_type)]
        altitude_type: AltitudeType,
        /// Speed over ground, m/s.
        #[arg(long, allow_negative_numbers = true, value_parser = speed)]
        speed: Option<f64>,
    },
    /// Change the speed over ground in the present mode.
    Speed {
        /// Speed over ground, m/s.
        #[arg(allow_negative_numbers = true, value_parser = speed)]
        metres_per_second: f64,
    },
    /// Land here (mode 19).
    Land,
    /// End the flight in two steps, such as `terminate arm`, then `terminate execute` (2005).
    Terminate {
        /// Which step.
        #[command(subcommand)]
        step: TwoSteps,
    },
    /// Erase keys, plans, recordings and logs of the whole VSM in two steps: `zeroize arm`, then `zeroize execute` (50024).
    Zeroize {
        /// Which step.
        #[command(subcommand)]
        step: TwoSteps,
    },
    /// Operate a payload station, such as `payload point 30 -45` (19001, 19100).
    Payload(PayloadArguments),
    /// Wait until the vehicle reports a condition, such as `wait waypoint 20 --within 60`.
    Wait {
        /// Condition to wait for.
        #[command(subcommand)]
        condition: Condition,
        /// Longest time to wait, seconds.
        #[arg(
            long,
            default_value_t = 120.0,
            value_name = "SECONDS",
            global = true,
            allow_negative_numbers = true
        )]
        within: f64,
    },
    /// Print the vehicle's state periodically, and its alerts.
    Watch {
        /// Duration, seconds.
        #[arg(long, default_value_t = 10.0, allow_negative_numbers = true)]
        seconds: f64,
        /// Time between lines, seconds.
        #[arg(long, default_value_t = 1.0, allow_negative_numbers = true)]
        every: f64,
    },
    /// Pause a script; the station keeps receiving.
    Sleep {
        /// Duration, seconds.
        seconds: f64,
    },
    /// Switch heartbeats (16002, 1 Hz) on or off.
    Heartbeats {
        /// on or off.
        #[arg(value_parser = ["on", "off"])]
        switch: String,
    },
    /// Select the vehicle to command from now on.
    Vehicle {
        /// Id of the vehicle, such as 1b:00:01:01.
        // Not `id`: that is the option of the program for its own, and clap would take this value for it.
        #[arg(value_name = "ID")]
        selected: Id,
    },
    /// Show how many messages were sent and received, by type.
    Traffic,
    /// Show the vehicle's configuration as a table (40000).
    Config {
        /// Level of interoperability, 2 to 5 (default: all).
        #[arg(long, value_name = "LEVEL", value_parser = clap::value_parser!(u8).range(2..=5))]
        loi: Option<u8>,
    },
    /// Show the vehicle's parameters, or one of them (50010).
    Parameters {
        /// Name of the parameter (default: all).
        name: Option<String>,
    },
    /// Write a parameter of the vehicle (50011).
    Set {
        /// Name of the parameter.
        name: String,
        /// New value, in the parameter's own unit.
        #[arg(allow_negative_numbers = true)]
        value: f64,
    },
    /// Show the controls that the VSM offers of the vehicle, or set one (40000, 50011).
    Controls {
        /// Name of the control (default: all).
        name: Option<String>,
        /// New value, in the control's own unit; refused outside its range.
        #[arg(allow_negative_numbers = true)]
        value: Option<f64>,
    },
    /// Show the software versions of VSM and vehicle (50013).
    Software,
    /// Measure the round-trip time (50014).
    Ping {
        /// Without an id: measure to the vehicle, through the VSM.
        // Of the same name and type as the option of the program that selects the vehicle: clap keeps one value for both.
        #[arg(long, value_name = "ID", num_args = 0..=1)]
        vehicle: Option<Option<Id>>,
    },
    /// Upload a geofence, download it, or delete it (50016, 50017).
    Fence {
        /// Fence file to upload (TOML), or a .plan, .kml, .kmz or .geojson with a geofence; without one, the areas are downloaded.
        #[arg(conflicts_with_all = ["clear", "output"])]
        file: Option<PathBuf>,
        /// Delete all areas, in the VSM and aboard.
        #[arg(long, conflicts_with = "output")]
        clear: bool,
        /// File to write downloaded areas to (default: standard output).
        // By its option alone: a file without one is what replaces the areas aboard.
        #[arg(short, long, value_name = "FILE")]
        output: Option<PathBuf>,
    },
}

/// Positive handover (messages 4 and 5).
#[derive(Clone, Debug, Subcommand)]
pub enum HandoverVerb {
    /// Request rights from the CUCS that holds them, and wait for the answer.
    Ask {
        /// Levels, such as 4,5 (default: all that this CUCS may hold).
        #[arg(long, value_name = "LEVELS")]
        loi: Option<LoiList>,
    },
    /// Hand over to a CUCS that requests it, such as `consent 1b:00:00:b0`; wait for its request if none has arrived yet.
    Consent {
        /// Id of that CUCS (default: the one that requests).
        cucs: Option<Id>,
        /// Levels (default: those requested).
        #[arg(long, value_name = "LEVELS")]
        loi: Option<LoiList>,
        /// Longest time to wait for the request, seconds.
        #[arg(long, default_value_t = REQUEST_WITHIN_S, value_name = "SECONDS", allow_negative_numbers = true)]
        within: f64,
    },
    /// Refuse a CUCS that requests a handover; wait for its request if none has arrived yet.
    Refuse {
        /// Id of that CUCS (default: the one that requests).
        cucs: Option<Id>,
        /// Longest time to wait for the request, seconds.
        #[arg(long, default_value_t = REQUEST_WITHIN_S, value_name = "SECONDS", allow_negative_numbers = true)]
        within: f64,
    },
    /// Offer rights to another CUCS, and wait until it accepts or declines.
    Successor {
        /// Id of that CUCS.
        cucs: Id,
        /// Levels (default: all that this CUCS holds).
        #[arg(long, value_name = "LEVELS")]
        loi: Option<LoiList>,
    },
    /// Accept the rights offered to this CUCS; wait for the offer if none has arrived yet.
    Accept {
        /// Levels (default: those offered). If levels are given, do not wait for an offer: without one, request them as `ask` does.
        #[arg(long, value_name = "LEVELS")]
        loi: Option<LoiList>,
        /// Longest time to wait for the offer, seconds.
        #[arg(long, default_value_t = REQUEST_WITHIN_S, value_name = "SECONDS", allow_negative_numbers = true)]
        within: f64,
    },
    /// Decline an offer, or withdraw a request.
    Decline,
}

/// How long the holder waits for a request, and a successor for an offer: as long as the VSM gives either for an answer.
const REQUEST_WITHIN_S: f64 = 20.0;

/// A step of a flight termination, or of a zeroize.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Subcommand)]
pub enum TwoSteps {
    /// Arm it; the VSM disarms it again unless it is executed in time.
    Arm,
    /// Execute what is armed: a termination until the vehicle shows it, final where the VSM is configured to terminate; a zeroize
    /// until the order is stored, always final.
    Execute,
    /// Disarm it, or withdraw or release a termination that was executed, where that is possible.
    Cancel,
}

/// What `wait` waits for.
#[derive(Clone, Debug, Subcommand)]
pub enum Condition {
    /// Wait until the vehicle reports this mode (3001).
    Mode {
        /// Name or number.
        #[arg(value_parser = mode)]
        mode: FlightPathControlMode,
    },
    /// Wait until the vehicle flies to this waypoint (4001).
    Waypoint {
        /// Its number.
        number: u16,
    },
    /// Wait until the last waypoint has been reached (no waypoint is being flown to).
    RouteEnd,
    /// Wait until the vehicle is on the ground (3002).
    Landed,
    /// Wait until the vehicle is in the air (3002).
    Airborne,
    /// Wait until the altitude is at least this.
    Above {
        /// Altitude, metres above the datum that 4000 reports.
        #[arg(allow_negative_numbers = true)]
        altitude: f64,
    },
    /// Wait until the altitude is at most this.
    Below {
        /// Altitude, metres above the datum that 4000 reports.
        #[arg(allow_negative_numbers = true)]
        altitude: f64,
    },
    /// Wait until an alert with this text arrives.
    Alert {
        /// A part of its text.
        text: String,
    },
    /// Wait until another CUCS requests rights that this one holds (4).
    Asked,
    /// Wait until the holder offers its rights to this CUCS (5).
    Offered,
    /// Wait until this CUCS holds all of these levels (2).
    Holds {
        /// Such as 4,5.
        loi: LoiList,
    },
    /// Wait until this CUCS holds none of these levels (2).
    Lacks {
        /// Such as 4,5.
        loi: LoiList,
    },
}

/// A mode command.
#[derive(Clone, Debug, Args)]
pub struct ModeArguments {
    /// A name (manual, waypoint, loiter, autopilot, land, wave-off, launch, contingency-a, contingency-b) or a
    /// number.
    #[arg(value_parser = mode)]
    pub mode: FlightPathControlMode,
    /// Altitude, metres.
    #[arg(long, allow_negative_numbers = true)]
    pub altitude: Option<f64>,
    /// Datum of the altitude: agl, wgs84, amsl, pressure.
    #[arg(long, default_value = "agl", value_name = "TYPE", value_parser = altitude_type)]
    pub altitude_type: AltitudeType,
    /// Speed over ground, m/s.
    #[arg(long, allow_negative_numbers = true, value_parser = speed)]
    pub speed: Option<f64>,
    /// Waypoint to fly to (Commanded Waypoint Number).
    #[arg(long)]
    pub waypoint: Option<u16>,
    /// Loiter position, degrees north and east, such as -33.9,18.4.
    #[arg(long, value_name = "LAT,LON", value_parser = degrees, allow_hyphen_values = true)]
    pub position: Option<(f64, f64)>,
}

/// A cause of a contingency.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ContingencyCause {
    /// The battery is low.
    Battery,
    /// The position is lost.
    Position,
    /// The vehicle has left its fence.
    Fence,
    /// A motor has failed.
    Engine,
}

/// An action of a contingency.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ContingencyAction {
    /// The action in the configuration of the VSM.
    AsConfigured,
    /// Hold.
    Hold,
    /// Return.
    Return,
    /// Land.
    Land,
    /// The route of contingency A.
    ContingencyA,
    /// The route of contingency B.
    ContingencyB,
}

/// A mode command to hold.
#[derive(Clone, Debug, Args)]
pub struct HoldArguments {
    /// Number of the held command, from 1.
    #[arg(value_parser = clap::value_parser!(u16).range(1..))]
    pub number: u16,
    /// What to wait for: time=SECONDS, waypoint=NUMBER, entered=LAT,LON,METRES or entered=AREA, left=..., battery=PERCENT, link-lost,
    /// done=NUMBER.
    #[arg(long, value_name = "CONDITION")]
    pub until: Until,
    /// How long to wait for it, seconds.
    #[arg(long = "for", default_value_t = 3600, value_name = "SECONDS", value_parser = clap::value_parser!(u32).range(1..=86_400))]
    pub valid_s: u32,
    /// Keep it when control is lost, until another CUCS takes control.
    #[arg(long)]
    pub contingency: bool,
    /// The command.
    #[command(flatten)]
    pub command: ModeArguments,
}

/// Levels of interoperability: `2,4,5`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LoiList(pub LoiBitmap);

impl FromStr for LoiList {
    type Err = Expected;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let mut levels = LoiBitmap::NONE;
        for level in text.split(',') {
            levels = levels.union(match level.trim() {
                "2" => LoiBitmap::LOI2,
                "3" => LoiBitmap::LOI3,
                "4" => LoiBitmap::LOI4,
                "5" => LoiBitmap::LOI5,
                _ => return Err(Expected("levels of 2 to 5 with commas between them")),
            });
        }
        Ok(LoiList(levels))
    }
}

/// Numbers of payload stations: `1,2`.
fn stations(text: &str) -> Result<StationBitmap1To16, Expected> {
    let mut bits = 0_u16;
    for number in text.split(',') {
        match number.trim().parse() {
            Ok(number @ 1..=16_u16) => bits |= 1 << (number - 1),
            _ => {
                return Err(Expected(
                    "payload stations of 1 to 16 with commas between them",
                ));
            }
        }
    }
    Ok(StationBitmap1To16::from_raw(bits))
}

/// A mode by name or number.
fn mode(text: &str) -> Result<FlightPathControlMode, Expected> {
    if let Ok(number) = text.parse() {
        return Ok(FlightPathControlMode::from_raw(number));
    }
    let found = MODES.iter().find(|(name, _)| *name == text);
    found.map(|(_, mode)| *mode).ok_or(Expected(
        "a number of 0 to 255, or manual, waypoint, loiter, autopilot, land, wave-off, launch, contingency-a or \
         contingency-b",
    ))
}

const MODES: &[(&str, FlightPathControlMode)] = &[
    ("manual", FlightPathControlMode::FlightDirector),
    ("waypoint", FlightPathControlMode::Waypoint),
    ("loiter", FlightPathControlMode::Loiter),
    ("autopilot", FlightPathControlMode::Autopilot),
    ("land", FlightPathControlMode::AutolandEngage),
    ("wave-off", FlightPathControlMode::AutolandWaveOff),
    ("launch", FlightPathControlMode::Launch),
    ("contingency-a", FlightPathControlMode::ContingencyA),
    ("contingency-b", FlightPathControlMode::ContingencyB),
];
