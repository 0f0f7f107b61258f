//! The configuration file: every key, its default, its range, and errors that name line, key and expectation.
//!
//! Parsing ends in values that cannot be illegal: identification numbers are [`Id`]s, links and addresses are parsed,
//! relative paths are resolved against the folder of the file. Unknown keys are refused.

pub mod airside;
mod area;
mod disputed;
mod error;
pub mod reference;
mod value;

use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};

use serde::Deserialize;
use stanag_msgs::Id;
use toml::Spanned;

pub use area::{Area, Keep};
pub use disputed::Readings;
pub use error::ConfigError;
pub use value::{Exchange, ExchangeMode, LinkAddress, LoiSet, OnLoss, Signing};

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

/// `[[vehicle]]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vehicle {
    /// Its identification number (the wrapper's destination of commands).
    #[serde(deserialize_with = "id")]
    pub id: Id,
    /// Where its MAVLink is.
    pub link: LinkAddress,
    /// Its MAVLink system id, 1 to 255.
    pub system_id: u8,
    /// Tail Number of message 3, at most 15 characters.
    #[serde(default)]
    pub tail_number: String,
    /// The signing key, or `"off"`.
    pub signing: Signing,
    /// The MAVLink signing link id of this VSM on that link.
    #[serde(default)]
    pub link_id: u8,
    /// The MAVLink signing link id of the vehicle's autopilot on that link; learned, and kept, where absent.
    pub vehicle_link_id: Option<u8>,
    /// How curved legs are flown.
    #[serde(default)]
    pub curve: Curve,
    /// How altitude type 2 (AGL) is flown.
    #[serde(default)]
    pub agl: Agl,
    /// Bounds of a route.
    #[serde(default)]
    pub limits: Limits,
    /// Areas of its geofence, which no CUCS can take away.
    #[serde(default)]
    pub area: Vec<Area>,
    /// Longest time, s, that a mission may get no nearer to its waypoint, 10 to 3600: then the vehicle is told to
    /// hold. `None`, as `0` in the file, for ever.
    #[serde(default = "value::default_stall", deserialize_with = "value::stall")]
    pub stall_s: Option<f64>,
}

/// `vehicle.curve`
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Curve {
    /// Largest planned deviation from the curve, m, 0.1 to 100.
    pub tolerance_m: f64,
    /// Most items that a route may become, 2 to 10000: where it would become more, its curves are flown within the
    /// smallest tolerance that these allow.
    pub max_items: u16,
    /// What is done where the curve is too tight for the speed.
    pub policy: CurvePolicy,
    /// Where the vertices of the straight legs lie.
    pub vertices: CurveVertices,
}

impl Default for Curve {
    fn default() -> Self {
        Curve {
            tolerance_m: 1.0,
            max_items: 500,
            policy: CurvePolicy::Slow,
            vertices: CurveVertices::On,
        }
    }
}

/// `vehicle.curve.vertices`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CurveVertices {
    /// On the curve.
    On,
    /// Off it by up to the tolerance: about a quarter fewer items, proven all the same.
    Free,
}

/// `vehicle.curve.policy`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CurvePolicy {
    /// Slow down before the tight part, and speed up after.
    Slow,
    /// Refuse the route.
    Refuse,
}

/// `vehicle.agl`
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Agl {
    /// Flown as height above home (MAVLink frame 6).
    #[default]
    Home,
    /// Refused.
    Refuse,
}

/// `vehicle.limits`: a route beyond these is refused whole.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// Farthest first waypoint from home, m.
    pub first_m: f64,
    /// Longest leg, m.
    pub leg_m: f64,
    /// Lowest waypoint, m above home.
    pub lowest_m: f64,
    /// Highest waypoint, m above home.
    pub highest_m: f64,
    /// Fastest commanded speed, m/s.
    pub speed_m_s: f64,
}

impl Default for Limits {
    fn default() -> Self {
        let mapping::route::Limits {
            first_m,
            leg_m,
            lowest_m,
            highest_m,
            speed_m_s,
            ..
        } = mapping::route::Limits::default();
        Limits {
            first_m,
            leg_m,
            lowest_m,
            highest_m,
            speed_m_s,
        }
    }
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

    /// What a single value cannot tell: relations between keys.
    fn check(&self) -> Result<(), error::Fault> {
        let fault = |span: std::ops::Range<usize>, key: &str, found: String, expected: &str| {
            Err(error::Fault {
                at: span.start,
                key: key.to_owned(),
                found,
                expected: expected.to_owned(),
            })
        };
        let mut ids = vec![self.dli.vsm_id];
        for station in &self.cucs {
            let id = station.get_ref().id;
            if ids.contains(&id) {
                return fault(
                    station.span(),
                    "cucs.id",
                    id.to_string(),
                    "an id that nothing else in this file has",
                );
            }
            ids.push(id);
        }
        let mut links: Vec<&LinkAddress> = Vec::new();
        for spanned in &self.vehicle {
            let (vehicle, span) = (spanned.get_ref(), spanned.span());
            if ids.contains(&vehicle.id) {
                let id = vehicle.id.to_string();
                return fault(
                    span,
                    "vehicle.id",
                    id,
                    "an id that nothing else in this file has",
                );
            }
            ids.push(vehicle.id);
            if links.contains(&&vehicle.link) {
                let link = vehicle.link.to_string();
                return fault(
                    span,
                    "vehicle.link",
                    link,
                    "a link of its own for each vehicle",
                );
            }
            links.push(&vehicle.link);
            if vehicle.system_id == 0 || vehicle.system_id == self.mavlink.system_id {
                let found = vehicle.system_id.to_string();
                return fault(
                    span,
                    "vehicle.system_id",
                    found,
                    "1 to 255, and not the VSM's own (mavlink.system_id)",
                );
            }
            if vehicle.tail_number.len() > 15 || !vehicle.tail_number.is_ascii() {
                return fault(
                    span,
                    "vehicle.tail_number",
                    vehicle.tail_number.clone(),
                    "at most 15 ASCII characters",
                );
            }
            if let Signing::KeyFile(_, exchange) = &vehicle.signing {
                if exchange.agent < 2 {
                    return fault(
                        span,
                        "vehicle.signing.agent",
                        exchange.agent.to_string(),
                        "a component id of 2 to 255: 1 is the autopilot",
                    );
                }
                if !(0.0001..=3650.0).contains(&exchange.rotate_days) {
                    return fault(
                        span,
                        "vehicle.signing.rotate_days",
                        exchange.rotate_days.to_string(),
                        "0.0001 to 3650 (days)",
                    );
                }
            }
            let curve = vehicle.curve;
            if !(0.1..=100.0).contains(&curve.tolerance_m) {
                return fault(
                    span,
                    "vehicle.curve.tolerance_m",
                    curve.tolerance_m.to_string(),
                    "0.1 to 100 (metres)",
                );
            }
            if !(2..=10_000).contains(&curve.max_items) {
                return fault(
                    span,
                    "vehicle.curve.max_items",
                    curve.max_items.to_string(),
                    "2 to 10000",
                );
            }
            if let Err(fault) = area::check(&vehicle.area) {
                return Err(error::Fault {
                    at: span.start,
                    key: "vehicle.area".to_owned(),
                    found: fault,
                    expected: "areas that make a fence".to_owned(),
                });
            }
            let limits = vehicle.limits;
            for (key, value) in [
                ("vehicle.limits.first_m", limits.first_m),
                ("vehicle.limits.leg_m", limits.leg_m),
                ("vehicle.limits.speed_m_s", limits.speed_m_s),
            ] {
                if !(value.is_finite() && value > 0.0) {
                    return fault(span, key, value.to_string(), "a number above 0");
                }
            }
            if !(limits.lowest_m.is_finite()
                && limits.highest_m.is_finite()
                && limits.lowest_m < limits.highest_m)
            {
                let found = format!(
                    "lowest_m {} and highest_m {}",
                    limits.lowest_m, limits.highest_m
                );
                return fault(span, "vehicle.limits", found, "lowest_m below highest_m");
            }
        }
        let Authority {
            warn_s,
            offer_s,
            act_s,
            ..
        } = *self.authority.get_ref();
        if !(warn_s <= offer_s && offer_s <= act_s) {
            let found = format!("warn_s {warn_s}, offer_s {offer_s}, act_s {act_s}");
            return fault(
                self.authority.span(),
                "authority",
                found,
                "warn_s <= offer_s <= act_s",
            );
        }
        if self.mavlink.system_id == 0 {
            return fault(0..0, "mavlink.system_id", "0".to_owned(), "1 to 255");
        }
        Ok(())
    }
}
