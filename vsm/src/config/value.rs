//! Values of the configuration that are more than text or a number.

use std::fmt;
use std::net::SocketAddr;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use dli_group::Interface;
use serde::de::value::MapAccessDeserializer;
use serde::de::{self, Deserializer, MapAccess, Visitor};
use serde::{Deserialize, Serialize};
use stanag_msgs::Id;
use stanag_msgs::enums::LoiBitmap;

use super::key::WhenAbsent::{Required, Value};
use super::key::table;

/// Where a vehicle's MAVLink is: `udpin:127.0.0.1:14550`, `udpout:host:port` or `serial:/dev/ttyACM0:57600`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LinkAddress {
    /// Bind and wait for the vehicle.
    UdpIn(SocketAddr),
    /// Send to host and port, from a port that the system chooses.
    UdpOut(String),
    /// A serial device and its speed in baud.
    Serial {
        /// The device file.
        device: String,
        /// Baud.
        baud: u32,
    },
}

impl LinkAddress {
    /// Host and port to send to, whose name has to be resolved.
    #[must_use]
    pub fn host(&self) -> Option<&str> {
        match self {
            LinkAddress::UdpOut(host) => Some(host),
            LinkAddress::UdpIn(_) | LinkAddress::Serial { .. } => None,
        }
    }

    /// The address at which it waits for the vehicle.
    pub(super) fn waits_at(&self) -> Option<SocketAddr> {
        match self {
            LinkAddress::UdpIn(address) => Some(*address),
            LinkAddress::UdpOut(_) | LinkAddress::Serial { .. } => None,
        }
    }

    /// Whether it leads out of this computer, as far as that shows without a name server.
    pub(super) fn leads_away(&self) -> bool {
        let address = match self {
            LinkAddress::UdpIn(address) => Some(*address),
            LinkAddress::UdpOut(host) => host.parse().ok(),
            LinkAddress::Serial { .. } => None,
        };
        address.is_some_and(|address| !address.ip().is_loopback())
    }

    /// The device file of a serial line.
    #[must_use]
    pub fn device(&self) -> Option<&Path> {
        match self {
            LinkAddress::Serial { device, .. } => Some(Path::new(device)),
            LinkAddress::UdpIn(_) | LinkAddress::UdpOut(_) => None,
        }
    }
}

impl fmt::Display for LinkAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            LinkAddress::UdpIn(address) => write!(f, "udpin:{address}"),
            LinkAddress::UdpOut(address) => write!(f, "udpout:{address}"),
            LinkAddress::Serial { device, baud } => write!(f, "serial:{device}:{baud}"),
        }
    }
}

impl LinkAddress {
    const EXPECTED: &'static str = "\"udpin:ADDRESS:PORT\", \"udpout:HOST:PORT\" or \"serial:DEVICE:BAUD\", such as \"udpin:127.0.0.1:14550\"";

    /// Whether both are one serial device.
    pub(super) fn is_device_of(&self, other: &LinkAddress) -> bool {
        match (self, other) {
            (LinkAddress::Serial { device, .. }, LinkAddress::Serial { device: other, .. }) => {
                device == other
            }
            _ => false,
        }
    }

    fn parse(text: &str) -> Option<LinkAddress> {
        let (kind, rest) = text.split_once(':')?;
        let (place, number) = rest.rsplit_once(':')?;
        match kind {
            "udpin" => rest.parse().ok().map(LinkAddress::UdpIn),
            "udpout" if !place.is_empty() && number.parse::<u16>().is_ok_and(|port| port > 0) => {
                Some(LinkAddress::UdpOut(rest.to_owned()))
            }
            "serial" if !place.is_empty() => match number.parse() {
                Ok(baud) if baud > 0 => Some(LinkAddress::Serial {
                    device: place.to_owned(),
                    baud,
                }),
                _ => None,
            },
            _ => None,
        }
    }
}

impl FromStr for LinkAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        LinkAddress::parse(text)
            .ok_or_else(|| format!("{text:?} is no link: expected {}", LinkAddress::EXPECTED))
    }
}

impl<'de> Deserialize<'de> for LinkAddress {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        LinkAddress::parse(&text)
            .ok_or_else(|| de::Error::invalid_value(de::Unexpected::Str(&text), &Self::EXPECTED))
    }
}

/// `vehicle.signing`: `{ key_file = "uav1.key" }`, or `"off"`.
#[derive(Debug, Clone, PartialEq)]
pub enum Signing {
    /// The file that holds 32 bytes in hex.
    KeyFile(PathBuf, Exchange),
    /// Nothing is signed and nothing is verified: logged and raised as a 16000 alert.
    Off,
}

/// How keys are agreed about over the air: the rest of `vehicle.signing`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exchange {
    /// Whether, and how.
    pub mode: ExchangeMode,
    /// Component id of the air-side agent, which has the vehicle's system id.
    pub agent: u8,
    /// Days after which a key in use is replaced, 0.0001 to 3650. It is never stopped.
    pub rotate_days: f64,
}

table! {
    /// `vehicle.signing` as a table.
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    pub(super) struct SigningTable {
        /// File of the signing key: 32 bytes in hex, mode 0600, written by `vsm keygen`
        pub(super) key_file: PathBuf => Required,
        /// Keys agreed over the air (KEY_EXCHANGE 229): `"off"`, `"on"` with an air-side agent that has been paired by
        /// `vsm pair`, or `"legacy"`, the bare public keys of the older protocol, which anyone in the middle can replace:
        /// logged and raised as a 16000 alert
        #[serde(default)]
        pub(super) exchange: ExchangeMode => Value("\"off\""),
        /// Component id of the air-side agent, 2 to 255; its system id is the vehicle's
        #[serde(default = "default_agent")]
        pub(super) agent: u8 => Value("191"),
        /// Age at which a key in use is replaced by a new one, 0.0001 to 3650 days; it stays in use until the new one is
        #[serde(default = "default_rotate_days")]
        pub(super) rotate_days: f64 => Value("30.0"),
    }
}

fn default_agent() -> u8 {
    Exchange::default().agent
}

fn default_rotate_days() -> f64 {
    Exchange::default().rotate_days
}

impl Default for Exchange {
    fn default() -> Self {
        Exchange {
            mode: ExchangeMode::Off,
            agent: 191,
            rotate_days: 30.0,
        }
    }
}

/// `vehicle.signing.exchange`
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ExchangeMode {
    /// KEY_EXCHANGE frames are ignored.
    #[default]
    Off,
    /// With an air-side agent that has been paired (`vsm pair`).
    On,
    /// The bare public keys of old, which anyone in the middle can replace: logged and raised as a 16000 alert.
    Legacy,
}

impl Signing {
    /// Whether keys are agreed on with an agent that has been paired.
    #[must_use]
    pub fn agrees_with_agent(&self) -> bool {
        matches!(self, Signing::KeyFile(_, exchange) if exchange.mode == ExchangeMode::On)
    }
}

impl<'de> Deserialize<'de> for Signing {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = Signing;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("{ key_file = \"FILE\" } or \"off\"")
            }

            fn visit_str<E: de::Error>(self, text: &str) -> Result<Signing, E> {
                match text {
                    "off" => Ok(Signing::Off),
                    _ => Err(E::invalid_value(de::Unexpected::Str(text), &self)),
                }
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Signing, A::Error> {
                let table = SigningTable::deserialize(MapAccessDeserializer::new(map))?;
                let exchange = Exchange {
                    mode: table.exchange,
                    agent: table.agent,
                    rotate_days: table.rotate_days,
                };
                Ok(Signing::KeyFile(table.key_file, exchange))
            }
        }
        deserializer.deserialize_any(Either)
    }
}

/// The levels of interoperability that a CUCS may hold, from a list of numbers 2 to 5.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LoiSet(pub LoiBitmap);

impl<'de> Deserialize<'de> for LoiSet {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut set = LoiBitmap::default();
        for level in Vec::<u8>::deserialize(deserializer)? {
            set = set.union(match level {
                2 => LoiBitmap::LOI2,
                3 => LoiBitmap::LOI3,
                4 => LoiBitmap::LOI4,
                5 => LoiBitmap::LOI5,
                other => {
                    let found = de::Unexpected::Unsigned(other.into());
                    let expected = &"levels of interoperability from 2 to 5";
                    return Err(de::Error::invalid_value(found, expected));
                }
            });
        }
        Ok(LoiSet(set))
    }
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

/// `store.kind`: where state is kept.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum StoreKind {
    /// In a folder of this computer.
    #[default]
    Files,
    /// In a folder, and in etcd, for other computers to continue with.
    Etcd,
}

/// `authority.on_loss`: what the vehicle is commanded when its controller has been silent for `act_s`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum OnLoss {
    /// Nothing: it continues in its current mode.
    Continue,
    /// AUTO.LOITER.
    Hold,
    /// The contingency route A where one is loaded, else AUTO.RTL.
    Contingency,
    /// AUTO.RTL.
    Rtl,
}

/// An identification number that something can own: neither broadcast, null, nor of the reserved owner ff. Its first byte may
/// be the country's code by name.
pub(super) fn id<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Id, D::Error> {
    const EXPECTED: &str = "four bytes in hex, the owning nation first, such as \"1b:00:00:01\" (ff is reserved), or its name in \
                            place of the first, such as \"DEU:00:00:01\"";
    let text = String::deserialize(deserializer)?;
    let named = text.split_once(':').and_then(|(name, rest)| {
        let code = u8::try_from(country_code(name)?).ok()?;
        Some(format!("{code:02x}:{rest}"))
    });
    match named.as_ref().unwrap_or(&text).parse::<Id>() {
        Ok(id) if id.0 >> 24 != 0xff => Ok(id),
        _ => Err(de::Error::invalid_value(
            de::Unexpected::Str(&text),
            &EXPECTED,
        )),
    }
}

/// The names of table B1-1 of Edition 2.5, with their codes.
fn countries() -> &'static [(i64, &'static str, &'static str)] {
    let message = stanag_msgs::ed25::message(20, stanag_msgs::ed25::Version::Ed25);
    let field = message.and_then(|info| info.field("Owning Country Code"));
    field
        .and_then(|field| field.enumeration)
        .map_or(&[], |countries| countries.values)
}

fn country_code(name: &str) -> Option<i64> {
    let mut all = countries().iter();
    all.find(|(_, _, known)| known.eq_ignore_ascii_case(name))
        .map(|(code, ..)| *code)
}

/// The name of the nation or organisation that owns an id, where table B1-1 of Edition 2.5 has it.
#[must_use]
pub fn owner_name(id: Id) -> Option<&'static str> {
    let mut all = countries().iter();
    all.find(|(code, ..)| *code == i64::from(id.owner()))
        .map(|(_, _, name)| *name)
}

/// `vehicle.logical_id`: of the owner 0, and not 0 itself, which other messages use for "none".
pub(super) fn logical_id<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<Id>, D::Error> {
    const EXPECTED: &str = "an id that no nation owns: \"00:00:00:01\" to \"00:ff:ff:ff\"";
    let text = String::deserialize(deserializer)?;
    match text.parse::<Id>() {
        Ok(id) if id.owner() == 0 && id != Id(0) => Ok(Some(id)),
        _ => Err(de::Error::invalid_value(
            de::Unexpected::Str(&text),
            &EXPECTED,
        )),
    }
}

/// A list of identification numbers.
pub(super) fn ids<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Id>, D::Error> {
    #[derive(Deserialize)]
    struct One(#[serde(deserialize_with = "id")] Id);
    let all = Vec::<One>::deserialize(deserializer)?;
    Ok(all.into_iter().map(|One(id)| id).collect())
}

/// A multicast group and port.
pub(super) fn group<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<SocketAddr>, D::Error> {
    let address = SocketAddr::deserialize(deserializer)?;
    if address.ip().is_multicast() {
        return Ok(Some(address));
    }
    let text = address.to_string();
    let expected =
        "a multicast group and port, such as \"225.200.1.0:51017\" or \"[ff15::4586]:51017\"";
    Err(de::Error::invalid_value(
        de::Unexpected::Str(&text),
        &expected,
    ))
}

/// A network interface, by its name or an address of it.
pub(super) fn interface<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<Interface>, D::Error> {
    let text = String::deserialize(deserializer)?;
    // Linux allows these names: no blank, no slash, 15 bytes.
    let is_name = !text.is_empty() && text.len() < 16 && !text.contains([' ', '/', ':']);
    match text.parse() {
        Ok(Interface::Name(_)) if !is_name => {
            let expected =
                "the name or an address of a network interface, such as \"eth0\" or \"10.0.0.5\"";
            let found = de::Unexpected::Str(&text);
            Err(de::Error::invalid_value(found, &expected))
        }
        Ok(interface) => Ok(Some(interface)),
        Err(never) => match never {},
    }
}

/// `dli.ttl`: 0 to 255.
pub(super) fn hops<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u8, D::Error> {
    let found = i64::deserialize(deserializer)?;
    u8::try_from(found).map_err(|_| {
        let expected = "0 to 255 (hops), such as 1 for the network at hand";
        de::Error::invalid_value(de::Unexpected::Signed(found), &expected)
    })
}

/// A time of silence in seconds, 0.5 to 3600.
pub(super) fn silence<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    seconds(deserializer, "0.5 to 3600 (seconds)", |s| {
        (0.5..=3600.0).contains(&s)
    })
}

/// `dli.lease_s`: 10 to 3600 s.
pub(super) fn lease<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    seconds(deserializer, "10 to 3600 (seconds)", |s| {
        (10.0..=3600.0).contains(&s)
    })
}

/// `store.lease_s`. etcd ends no lease sooner than after 2 s.
pub(super) fn store_lease<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u64, D::Error> {
    within(deserializer, 2..=60, "2 to 60 (whole seconds)").map(u64::from)
}

/// `dli.max_bytes_s`. Below it not even the status of one vehicle would fit.
pub(super) fn bytes_a_second<'de, D: Deserializer<'de>>(deserializer: D) -> Result<u32, D::Error> {
    within(
        deserializer,
        1_000..=100_000_000,
        "1000 to 100000000 (bytes a second)",
    )
}

/// `dli.max_messages_s`.
pub(super) fn messages_a_second<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<u32, D::Error> {
    within(
        deserializer,
        50..=1_000_000,
        "50 to 1000000 (messages a second)",
    )
}

fn within<'de, D: Deserializer<'de>>(
    deserializer: D,
    range: RangeInclusive<u32>,
    expected: &'static str,
) -> Result<u32, D::Error> {
    let found = u32::deserialize(deserializer)?;
    if range.contains(&found) {
        Ok(found)
    } else {
        Err(de::Error::invalid_value(
            de::Unexpected::Unsigned(found.into()),
            &expected,
        ))
    }
}

/// `vehicle.stall_s`: 10 to 3600 s, 0 for never.
pub(super) fn stall<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<f64>, D::Error> {
    let expected = "10 to 3600 (seconds), or 0 for no watch";
    let found = seconds(deserializer, expected, |s| {
        s == 0.0 || (10.0..=3600.0).contains(&s)
    })?;
    Ok((found > 0.0).then_some(found))
}

#[expect(clippy::unnecessary_wraps, reason = "what serde takes as a default")]
pub(super) const fn default_stall() -> Option<f64> {
    Some(30.0)
}

fn seconds<'de, D: Deserializer<'de>>(
    deserializer: D,
    expected: &'static str,
    good: fn(f64) -> bool,
) -> Result<f64, D::Error> {
    struct Seconds(&'static str, fn(f64) -> bool);
    impl Visitor<'_> for Seconds {
        type Value = f64;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str(self.0)
        }

        fn visit_f64<E: de::Error>(self, value: f64) -> Result<f64, E> {
            if (self.1)(value) {
                return Ok(value);
            }
            Err(E::invalid_value(de::Unexpected::Float(value), &self))
        }

        fn visit_i64<E: de::Error>(self, value: i64) -> Result<f64, E> {
            self.visit_f64(value as f64)
        }
    }
    deserializer.deserialize_any(Seconds(expected, good))
}
