//! The configuration file: every key, its default, its range, and errors that name line, key and expectation.
//!
//! Parsing ends in values that cannot be illegal: identification numbers are [`Id`]s, links and addresses are parsed,
//! relative paths are resolved against the folder of the file. Unknown keys are refused.

pub mod airside;
mod area;
mod check;
mod disputed;
mod error;
pub mod reference;
mod value;
mod vehicle;

use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};

use serde::Deserialize;
use stanag_msgs::Id;
use toml::Spanned;

pub use area::{Area, Keep};
pub use disputed::Readings;
pub use error::ConfigError;
pub use value::{Exchange, ExchangeMode, LinkAddress, LoiSet, OnLoss, Signing};
pub use vehicle::{Agl, Curve, CurvePolicy, CurveVertices, Limits, Vehicle};

use value::{group, id, silence};

/// The whole of a `vsm.toml`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The DLI side.
    pub dli: Dli,
    /// The ground stations that may connect; none listed, none may.
    #[serde(default)]
    pub cucs: Vec<Spanned<Cucs>>,
    /// The vehicles that this VSM serves.
    #[serde(default)]
    pub vehicle: Vec<Spanned<Vehicle>>,
    /// Where state lives that must survive a restart.
    pub store: Store,
    /// The status page; without it none is served.
    pub http: Option<Http>,
    /// What silence of the controlling CUCS leads to.
    #[serde(default = "Authority::unspanned")]
    pub authority: Spanned<Authority>,
    /// Who this VSM is on MAVLink.
    #[serde(default)]
    pub mavlink: Mavlink,
    /// Recordings; without it none are made.
    pub record: Option<Record>,
}

/// `[dli]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dli {
    /// The identification number of this VSM (field VSM ID of messages 1 to 5).
    #[serde(deserialize_with = "id")]
    pub vsm_id: Id,
    /// UDP address that datagrams are received on; answers go to where a CUCS sends from.
    pub listen: SocketAddr,
    /// Group that status is sent to beside the unicast copies, and that is listened to.
    #[serde(default, deserialize_with = "group")]
    pub multicast: Option<SocketAddr>,
    /// Local interface of the group.
    pub interface: Option<IpAddr>,
    /// What layouts that are only derived from Edition 2 are used for.
    #[serde(default)]
    pub provisional: Provisional,
    /// How peers read what the sources leave open.
    #[serde(default)]
    pub disputed: Readings,
}

/// `dli.provisional`: the use of message layouts derived from Edition 2.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Provisional {
    /// Not sent, and refused on receipt.
    Off,
    /// Answers and reports use them; those that command the aircraft are refused.
    #[default]
    Status,
    /// Commands are carried out too.
    All,
}

/// `[[cucs]]`: one ground station and its rights.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cucs {
    /// Its identification number (the wrapper's source).
    #[serde(deserialize_with = "id")]
    pub id: Id,
    /// The levels of interoperability that it may hold.
    pub loi: LoiSet,
    /// Where it must send from; anywhere when absent.
    pub address: Option<IpAddr>,
    /// Whether it may take control from another.
    #[serde(default, rename = "override")]
    pub override_control: bool,
    /// 0 to 255: an override takes control from this rank and below.
    #[serde(default)]
    pub rank: u8,
}

/// `[store]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Store {
    /// Folder of signing clocks, plans and authority; made when missing, mode 0700.
    pub dir: PathBuf,
}

/// `[http]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Http {
    /// TCP address of the status page.
    pub listen: SocketAddr,
}

/// `[record]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// Folder that a `.tlog` a vehicle and a run is written to (keys blanked, signatures stripped), and a `.pcapng` of
    /// the DLI.
    pub dir: PathBuf,
}

/// `[authority]`: a CUCS that has sent heartbeats and falls silent.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Authority {
    /// Silence before operators are warned, s.
    #[serde(deserialize_with = "silence")]
    pub warn_s: f64,
    /// Silence before control is free for another to take, s.
    #[serde(deserialize_with = "silence")]
    pub offer_s: f64,
    /// Silence before control is taken away and `on_loss` is done, s.
    #[serde(deserialize_with = "silence")]
    pub act_s: f64,
    /// What the vehicle is told at `act_s`.
    pub on_loss: OnLoss,
}

impl Default for Authority {
    fn default() -> Self {
        Authority {
            warn_s: 3.0,
            offer_s: 5.0,
            act_s: 10.0,
            on_loss: OnLoss::Continue,
        }
    }
}

impl Authority {
    fn unspanned() -> Spanned<Authority> {
        Spanned::new(0..0, Authority::default())
    }
}

/// `[mavlink]`
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Mavlink {
    /// System id of this VSM, 1 to 255.
    pub system_id: u8,
    /// Component id of this VSM.
    pub component_id: u8,
}

impl Default for Mavlink {
    fn default() -> Self {
        Mavlink {
            system_id: 245,
            component_id: 190,
        }
    }
}

impl Config {
    /// Reads and checks a file.
    ///
    /// # Errors
    /// The file cannot be read, is not TOML, has an unknown or missing key, or a value out of its range.
    pub fn load(path: &Path) -> Result<Config, ConfigError> {
        let text = std::fs::read_to_string(path).map_err(|cause| ConfigError::Unreadable {
            path: path.to_owned(),
            cause,
        })?;
        let folder = path.parent().unwrap_or(Path::new(""));
        Config::parse(&text, folder).map_err(|cause| cause.in_file(path))
    }

    /// Parses and checks the text of a file whose relative paths start at `folder`.
    ///
    /// # Errors
    /// As [`Config::load`].
    pub fn parse(text: &str, folder: &Path) -> Result<Config, ConfigError> {
        let mut config: Config = toml::from_str(text).map_err(ConfigError::syntax)?;
        config.check().map_err(|fault| fault.located(text))?;
        config.resolve(folder);
        Ok(config)
    }

    /// The vehicles, without their places in the file.
    pub fn vehicles(&self) -> impl Iterator<Item = &Vehicle> {
        self.vehicle.iter().map(Spanned::get_ref)
    }

    /// The ground stations, without their places in the file.
    pub fn stations(&self) -> impl Iterator<Item = &Cucs> {
        self.cucs.iter().map(Spanned::get_ref)
    }

    fn resolve(&mut self, folder: &Path) {
        self.store.dir = folder.join(&self.store.dir);
        if let Some(record) = &mut self.record {
            record.dir = folder.join(&record.dir);
        }
        for vehicle in &mut self.vehicle {
            if let Signing::KeyFile(file, _) = &mut vehicle.get_mut().signing {
                *file = folder.join(&*file);
            }
        }
    }
}
