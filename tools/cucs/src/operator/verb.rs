//! The subcommands of `cucs`, which are also the lines of its scripts.

use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, Subcommand};
use stanag_msgs::Id;
use stanag_msgs::enums::{AltitudeType, FlightPathControlMode, LoiBitmap};

use crate::route::form::altitude_type_named;

/// One thing to do.
#[derive(Clone, Debug, Subcommand)]
pub enum Verb {
    /// Tell which vehicles are there, and what this CUCS may have.
    Discover,
    /// Take rights over the vehicle.
    Take {
        /// Levels, such as 2,4,5; without it everything that this CUCS may have.
        #[arg(long, value_name = "LEVELS")]
        loi: Option<LoiList>,
        /// Also where another CUCS holds them.
        #[arg(long = "override")]
        override_holder: bool,
    },
    /// Give all rights back.
    Release,
    /// Handing rights over.
    #[command(flatten)]
    Handover(HandoverVerb),
    /// Send a route file and load it aboard.
    Send {
        /// The route file (TOML).
        file: PathBuf,
        /// Mission ID instead of the file's.
        #[arg(long)]
        mission_id: Option<String>,
    },
    /// Forget the plan, in the VSM and aboard.
    Clear,
    /// End a transfer that is under way.
    Cancel,
    /// Fetch the plan back as a route file.
    Download {
        /// Where to write it; without it, to standard output.
        #[arg(short, long, value_name = "FILE")]
        output: Option<PathBuf>,
    },
    /// Command a mode (2016).
    Mode(ModeArguments),
    /// Arm and take off (mode 21).
    Launch {
        /// Metres.
        #[arg(allow_negative_numbers = true)]
        altitude: f64,
        /// Above what: agl, wgs84, amsl, pressure.
        #[arg(long, default_value = "agl", value_name = "TYPE")]
        altitude_type: AltitudeName,
    },
    /// Fly the route that is loaded (mode 11).
    Fly {
        /// From this waypoint.
        #[arg(long, value_name = "WAYPOINT")]
        from: Option<u16>,
        /// At this speed over ground, m/s.
        #[arg(long)]
        speed: Option<f64>,
    },
    /// Loiter, here or there (mode 12).
    Loiter {
        /// Degrees north and east.
        #[arg(long, value_name = "LAT,LON", allow_hyphen_values = true)]
        position: Option<Degrees>,
        /// Metres.
        #[arg(long, allow_negative_numbers = true)]
        altitude: Option<f64>,
        /// Above what: agl, wgs84, amsl, pressure.
        #[arg(long, default_value = "agl", value_name = "TYPE")]
        altitude_type: AltitudeName,
        /// Speed over ground, m/s.
        #[arg(long)]
        speed: Option<f64>,
    },
    /// Change the speed over ground in the present mode.
    Speed {
        /// Metres a second.
        metres_per_second: f64,
    },
    /// Land here (mode 19).
    Land,
    /// Wait until the vehicle reports it.
    Wait {
        /// What to wait for.
        #[command(subcommand)]
        condition: Condition,
        /// For how many seconds at most.
        #[arg(long, default_value_t = 120.0, value_name = "SECONDS", global = true)]
        within: f64,
    },
    /// Print the vehicle's state, a line each time, and its alerts.
    Watch {
        /// For how long.
        #[arg(long, default_value_t = 10.0)]
        seconds: f64,
        /// Seconds between lines.
        #[arg(long, default_value_t = 1.0)]
        every: f64,
    },
    /// Do nothing for a while.
    Sleep {
        /// How long.
        seconds: f64,
    },
    /// Send heartbeats (16002) from now on, or no more.
    Heartbeats {
        /// on or off.
        #[arg(value_parser = ["on", "off"])]
        switch: String,
    },
    /// Command this vehicle from now on.
    Vehicle {
        /// Its id.
        id: Id,
    },
    /// Print how many messages went each way, by type.
    Traffic,
    /// Ask what the vehicle is (40000), and print the answers as a table.
    Config {
        /// For this level of interoperability alone, 2 to 5.
        #[arg(long, value_name = "LEVEL", value_parser = clap::value_parser!(u8).range(2..=5))]
        loi: Option<u8>,
    },
    /// Tell the vehicle's parameters, or one of them (50010).
    Parameters {
        /// Its name; without it, all.
        name: Option<String>,
    },
    /// Write a parameter of the vehicle (50011).
    Set {
        /// Its name.
        name: String,
        /// The value.
        #[arg(allow_negative_numbers = true)]
        value: f64,
    },
    /// Tell the software of VSM and vehicle (50013).
    Software,
    /// Measure how long an answer takes (50014).
    Ping {
        /// Of the vehicle too, through the VSM.
        #[arg(long)]
        vehicle: bool,
    },
    /// Send a file of areas to stay inside or outside; without one, fetch them back (50016, 50017).
    Fence {
        /// The fence file (TOML).
        #[arg(conflicts_with_all = ["clear", "output"])]
        file: Option<PathBuf>,
        /// Forget all areas, in the VSM and aboard.
        #[arg(long, conflicts_with = "output")]
        clear: bool,
        /// Where to write the areas that are fetched; without it, to standard output.
        #[arg(short, long, value_name = "FILE")]
        output: Option<PathBuf>,
    },
}

/// Positive handover (messages 4 and 5).
#[derive(Clone, Debug, Subcommand)]
pub enum HandoverVerb {
    /// Ask who holds them for rights, and wait for the answer.
    Ask {
        /// Levels, such as 4,5; without it everything that this CUCS may have.
        #[arg(long, value_name = "LEVELS")]
        loi: Option<LoiList>,
    },
    /// Hand over to a CUCS that asks.
    Consent {
        /// Which; without it the one that asked last.
        cucs: Option<Id>,
        /// Levels; without it what was asked for, or where that is not known everything that this CUCS holds.
        #[arg(long, value_name = "LEVELS")]
        loi: Option<LoiList>,
    },
    /// Hand nothing over to a CUCS that asks.
    Refuse {
        /// Which; without it the one that asked last.
        cucs: Option<Id>,
    },
    /// Offer rights to another CUCS, and wait until it accepts or declines.
    Successor {
        /// Which.
        cucs: Id,
        /// Levels; without it everything that this CUCS holds.
        #[arg(long, value_name = "LEVELS")]
        loi: Option<LoiList>,
    },
    /// Take what is offered.
    Accept {
        /// Levels; without it those offered.
        #[arg(long, value_name = "LEVELS")]
        loi: Option<LoiList>,
    },
    /// Take nothing of what is offered, or wish no longer for what was asked.
    Decline,
}

/// What `wait` waits for.
#[derive(Clone, Debug, Subcommand)]
pub enum Condition {
    /// The vehicle reports this mode (3001).
    Mode {
        /// Name or number.
        mode: ModeName,
    },
    /// The vehicle flies to this waypoint (4001).
    Waypoint {
        /// Its number.
        number: u16,
    },
    /// The last waypoint has been reached: it flies to none any more.
    RouteEnd,
    /// It stands on the ground (3002).
    Landed,
    /// It is in the air (3002).
    Airborne,
    /// It is at least so high.
    Above {
        /// Metres, above the datum that 4000 reports.
        #[arg(allow_negative_numbers = true)]
        altitude: f64,
    },
    /// It is at most so high.
    Below {
        /// Metres, above the datum that 4000 reports.
        #[arg(allow_negative_numbers = true)]
        altitude: f64,
    },
    /// An alert with this text comes.
    Alert {
        /// A part of its text.
        text: String,
    },
    /// Another CUCS asks for what this one holds (4).
    Asked,
    /// The holder offers this CUCS what it holds (5).
    Offered,
    /// This CUCS holds all of these levels (2).
    Holds {
        /// Such as 4,5.
        loi: LoiList,
    },
    /// This CUCS holds none of these levels (2).
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
    pub mode: ModeName,
    /// Metres.
    #[arg(long, allow_negative_numbers = true)]
    pub altitude: Option<f64>,
    /// Above what: agl, wgs84, amsl, pressure.
    #[arg(long, default_value = "agl", value_name = "TYPE")]
    pub altitude_type: AltitudeName,
    /// Speed over ground, m/s.
    #[arg(long)]
    pub speed: Option<f64>,
    /// Commanded Waypoint Number.
    #[arg(long)]
    pub waypoint: Option<u16>,
    /// Loiter position, degrees north and east.
    #[arg(long, value_name = "LAT,LON", allow_hyphen_values = true)]
    pub position: Option<Degrees>,
}

/// Levels of interoperability: `2,4,5`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LoiList(pub LoiBitmap);

/// The datum of an altitude: `agl`, `wgs84`, `amsl` or `pressure`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AltitudeName(pub AltitudeType);

/// A mode by name or number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ModeName(pub FlightPathControlMode);

/// `LAT,LON` in degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Degrees(pub f64, pub f64);

/// An argument that is none of those expected.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected {0}")]
pub struct Expected(&'static str);

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

impl FromStr for AltitudeName {
    type Err = Expected;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        altitude_type_named(text)
            .map(AltitudeName)
            .ok_or(Expected("agl, wgs84, amsl or pressure"))
    }
}

impl FromStr for ModeName {
    type Err = Expected;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if let Ok(number) = text.parse() {
            return Ok(ModeName(FlightPathControlMode::from_raw(number)));
        }
        let found = MODES.iter().find(|(name, _)| *name == text);
        found.map(|(_, mode)| ModeName(*mode)).ok_or(Expected(
            "a number of 0 to 255, or manual, waypoint, loiter, autopilot, land, wave-off, launch, contingency-a or \
             contingency-b",
        ))
    }
}

impl FromStr for Degrees {
    type Err = Expected;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let expected = Expected("LAT,LON: -90 to 90 and -180 to 180 degrees");
        let Some((latitude, longitude)) = text.split_once(',') else {
            return Err(expected);
        };
        match (latitude.trim().parse(), longitude.trim().parse()) {
            (Ok(latitude), Ok(longitude))
                if (-90.0..=90.0).contains(&latitude) && (-180.0..=180.0).contains(&longitude) =>
            {
                Ok(Degrees(latitude, longitude))
            }
            _ => Err(expected),
        }
    }
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
