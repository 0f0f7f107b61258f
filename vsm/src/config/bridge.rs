//! `vsm.toml`: the bridge's configuration.

use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};

use dli_group::{Group, Interface};
use serde::Deserialize;
use stanag_msgs::Id;
use stanag_msgs::enums::LoiBitmap;
use toml::Spanned;

use super::access::Access;
use super::counted;
use super::disputed::Readings;
use super::error::{ConfigError, Fault, fault};
use super::explain;
use super::forward::Forward;
use super::key::WhenAbsent::{Nothing, Required, Table, Value};
use super::key::table;
use super::station::{Cucs, Edition};
use super::terrain::{self, TerrainFault};
use super::value::{
    ExchangeMode, LinkAddress, OnLoss, Provisional, Signing, StoreKind, bytes_a_second, group,
    hops, id, interface, lease, messages_a_second, silence, store_lease,
};
use super::vehicle::Vehicle;
use super::web::{Http, Web};
use super::zeroize::Zeroize;

table! {
    /// The whole of a `vsm.toml`.
    #[derive(Debug, Clone, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Config {
        /// The DLI side.
        pub dli: Dli => Table(Dli::KEYS),
        /// The ground stations that may connect; with none listed, none may.
        #[serde(default)]
        pub cucs: Vec<Spanned<Cucs>> => Table(Cucs::KEYS),
        /// The vehicles that this VSM serves.
        #[serde(default)]
        pub vehicle: Vec<Spanned<Vehicle>> => Table(Vehicle::KEYS),
        /// Other ground stations that the frames of vehicles are passed on to.
        #[serde(default)]
        pub forward: Vec<Spanned<Forward>> => Table(Forward::KEYS),
        /// Where state lives that must survive a restart.
        pub store: Store => Table(Store::KEYS),
        /// The status page; without it none is served.
        pub http: Option<Http> => Table(Http::KEYS),
        /// Stations that come by a WebSocket of the page.
        #[serde(default)]
        pub web: Web => Table(Web::KEYS),
        /// What silence of the controlling CUCS leads to.
        #[serde(default = "Authority::unspanned")]
        pub authority: Spanned<Authority> => Table(Authority::KEYS),
        /// Who this VSM is on MAVLink.
        #[serde(default)]
        pub mavlink: Mavlink => Table(Mavlink::KEYS),
        /// Recordings; without it none are made.
        pub record: Option<Record> => Table(Record::KEYS),
        /// Erasing keys, plans, recordings and logs on order.
        #[serde(default)]
        pub zeroize: Zeroize => Table(Zeroize::KEYS),
        /// The signed access list; without it `[[cucs]]` alone says what a CUCS may do.
        pub access: Option<Access> => Table(Access::KEYS),
    }
}

table! {
    /// `[dli]`
    #[derive(Debug, Clone, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Dli {
        /// Identification number of the VSM (field VSM ID of messages 1 to 5): four bytes in hex, the owning nation
        /// first; not `ff:..`
        #[serde(deserialize_with = "id")]
        pub vsm_id: Id => Required,
        /// UDP address for CUCSs; answers go to the address that a CUCS sends from
        pub listen: SocketAddr => Required,
        /// Multicast group and port that is listened to, and that answers and status go to for each CUCS whose `delivery` says
        /// so. It is this one only: none is learnt from what arrives
        #[serde(default, deserialize_with = "group")]
        pub multicast: Option<SocketAddr> => Nothing("none"),
        /// Interface of the group: its name, such as `"eth0"`, or an address of it
        #[serde(default, deserialize_with = "interface")]
        pub interface: Option<Interface> => Nothing("the system's"),
        /// Maximum number of hops of datagrams to the group, 0 to 255: 0 stays on this computer, 1 in the network at hand
        #[serde(default = "ttl", deserialize_with = "hops")]
        pub ttl: u8 => Value("1"),
        /// Addresses that may send to the group; with none, all. IPv4: the network is asked for these alone (IGMPv3)
        #[serde(default)]
        pub sources: Vec<IpAddr> => Value("[]"),
        /// Whether other programs of this computer receive what is sent to the group
        #[serde(default = "loopback")]
        pub loopback: bool => Value("true"),
        /// Use of layouts derived from Edition 2: `"off"`, `"status"` (answers and reports), `"all"` (commands too)
        #[serde(default)]
        pub provisional: Provisional => Value("\"status\""),
        /// Status goes to a CUCS for this long after its last message, s, 10 to 3600: one that only listens acknowledges the
        /// VSM's heartbeats, or sends heartbeats (16002) of its own
        #[serde(default = "lease_s", deserialize_with = "lease")]
        pub lease_s: f64 => Value("60.0"),
        /// What one CUCS is sent at most, bytes a second, 1000 to 100000000
        #[serde(default = "max_bytes_s", deserialize_with = "bytes_a_second")]
        pub max_bytes_s: u32 => Value("65536"),
        /// What one CUCS is sent at most, messages a second, 50 to 1000000
        #[serde(default = "max_messages_s", deserialize_with = "messages_a_second")]
        pub max_messages_s: u32 => Value("1000"),
        /// How peers read what the sources leave open.
        #[serde(default)]
        pub disputed: Readings => Table(Readings::KEYS),
    }
}

fn ttl() -> u8 {
    1
}

fn loopback() -> bool {
    true
}

impl Dli {
    /// The group, and how it is taken part in.
    #[must_use]
    pub fn group(&self) -> Option<Group> {
        Some(Group {
            interface: self.interface.clone(),
            ttl: self.ttl,
            sources: self.sources.clone(),
            loopback: self.loopback,
            ..Group::new(self.multicast?)
        })
    }

    /// Whether the group stays within this computer by its interface.
    fn group_is_local(&self) -> bool {
        match &self.interface {
            Some(Interface::Address(ip)) => ip.is_loopback(),
            Some(Interface::Name(name)) => name == "lo",
            None => false,
        }
    }

    /// The addresses at which others than programs of this computer reach it.
    #[must_use]
    pub fn open_at(&self) -> Vec<SocketAddr> {
        let listen = Some(self.listen).filter(|at| !at.ip().is_loopback());
        let group = self.multicast.filter(|_| !self.group_is_local());
        listen.into_iter().chain(group).collect()
    }
}

fn lease_s() -> f64 {
    60.0
}

fn max_bytes_s() -> u32 {
    65_536
}

fn max_messages_s() -> u32 {
    1_000
}

table! {
    /// `[store]`
    #[derive(Debug, Clone, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Store {
        /// Folder of signing clocks, plans and authority; made with mode 0700, refused when open to others
        pub dir: PathBuf => Required,
        /// `"files"`: in this folder alone. `"etcd"`: each change is stored in etcd, too, so that another computer can continue
        /// ([fleet.md](../guide/fleet.md)); needs a `vsm` that was built with the feature `etcd`
        #[serde(default)]
        pub kind: StoreKind => Value("\"files\""),
        /// With `"etcd"`: members of the cluster, such as `["http://10.0.0.1:2379"]`
        #[serde(default)]
        pub endpoints: Vec<String> => Value("[]"),
        /// With `"etcd"`: this computer's name, which no other has: 1 to 32 letters, digits, `-` and `_`
        pub node: Option<String> => Nothing("none"),
        /// With `"etcd"`: file of the key that seals what etcd is given: 32 bytes in hex, mode 0600, written by `vsm keygen`, the same
        /// on each computer
        pub key_file: Option<PathBuf> => Nothing("none"),
        /// With `"etcd"`: another computer takes over when this one has been silent for so long, whole s, 2 to 60
        #[serde(default = "store_lease_s", deserialize_with = "store_lease")]
        pub lease_s: u64 => Value("3"),
    }
}

fn store_lease_s() -> u64 {
    3
}

/// A store that several computers share: `[store]` with `kind = "etcd"`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SharedStore {
    /// Members of the cluster.
    pub endpoints: Vec<String>,
    /// This computer's name.
    pub node: String,
    /// The key that seals what etcd is given.
    pub key_file: PathBuf,
    /// The time of a lease, s.
    pub lease_s: u64,
}

impl Store {
    /// How it is shared; `None` where one computer has it.
    #[must_use]
    pub fn shared(&self) -> Option<SharedStore> {
        let (StoreKind::Etcd, Some(node), Some(key_file)) = (self.kind, &self.node, &self.key_file)
        else {
            return None;
        };
        Some(SharedStore {
            endpoints: self.endpoints.clone(),
            node: node.clone(),
            key_file: key_file.clone(),
            lease_s: self.lease_s,
        })
    }

    /// Members of etcd on other computers.
    fn far_endpoints(&self) -> Vec<&str> {
        let is_far = |endpoint: &&str| {
            let address = endpoint.strip_prefix("http://").unwrap_or(endpoint);
            let host = address.rsplit_once(':').map_or(address, |(host, _)| host);
            let host = host.trim_matches(|c: char| matches!(c, '[' | ']'));
            let is_here = host.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback());
            host != "localhost" && !is_here
        };
        let all = self.endpoints.iter().map(String::as_str);
        all.filter(is_far).collect()
    }

    /// What a single value of `[store]` cannot show.
    fn check(&self) -> Result<(), Fault> {
        if self.kind == StoreKind::Files {
            let given = [
                ("store.endpoints", !self.endpoints.is_empty()),
                ("store.node", self.node.is_some()),
                ("store.key_file", self.key_file.is_some()),
            ];
            if let Some((key, _)) = given.iter().find(|(_, given)| *given) {
                let expected = "nothing with kind = \"files\"; with it set kind = \"etcd\"";
                return fault(0, key, "given", expected);
            }
            return Ok(());
        }
        if !cfg!(feature = "etcd") {
            let expected = "\"files\": this vsm was built without etcd (cargo build --release --features etcd)";
            return fault(0, "store.kind", "\"etcd\"", expected);
        }
        let good = |one: &&String| {
            let rest = one.strip_prefix("http://").unwrap_or_default();
            rest.rsplit_once(':').is_some_and(|(host, port)| {
                !host.is_empty() && !host.contains('/') && port.parse::<u16>().is_ok()
            })
        };
        let expected =
            "members of the cluster as http://HOST:PORT, such as [\"http://10.0.0.1:2379\"]";
        match self.endpoints.iter().find(|one| !good(one)) {
            Some(bad) => return fault(0, "store.endpoints", bad, expected),
            None if self.endpoints.is_empty() => {
                return fault(0, "store.endpoints", "[]", expected);
            }
            None => {}
        }
        let node = self.node.as_deref().unwrap_or_default();
        let letter = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if !(1..=32).contains(&node.len()) || !node.chars().all(letter) {
            let expected =
                "this computer's name with kind = \"etcd\": 1 to 32 letters, digits, - and _";
            return fault(0, "store.node", format!("{node:?}"), expected);
        }
        if self.key_file.is_none() {
            let expected =
                "a key file with kind = \"etcd\": `vsm keygen fleet.key`, copied to each computer";
            return fault(0, "store.key_file", "absent", expected);
        }
        Ok(())
    }
}

table! {
    /// `[record]`
    #[derive(Debug, Clone, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct Record {
        /// Folder of recordings: a `.tlog` for each vehicle and run (keys blanked, signatures stripped), and a `.pcapng` of
        /// the DLI
        pub dir: PathBuf => Nothing("none"),
        /// What all recordings in the folder take, MiB, 8 or more, those of earlier runs included: an equal share for each
        /// vehicle and for the DLI. The oldest files of a recording are removed for new ones
        #[serde(default = "max_mb")]
        pub max_mb: u32 => Value("2048"),
    }
}

table! {
    /// `[authority]`: a CUCS that has sent heartbeats and falls silent.
    #[derive(Debug, Clone, Copy, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub struct Authority {
        /// Silence of the controlling CUCS before operators are warned, s, 0.5 to 3600; counts once it has sent heartbeats
        /// (16002)
        #[serde(deserialize_with = "silence")]
        pub warn_s: f64 => Value("3.0"),
        /// Silence before another may take control, s, 0.5 to 3600, and not below `warn_s`
        #[serde(deserialize_with = "silence")]
        pub offer_s: f64 => Value("5.0"),
        /// Silence before control is taken away and `on_loss` is done, s, 0.5 to 3600, and not below `offer_s`
        #[serde(deserialize_with = "silence")]
        pub act_s: f64 => Value("10.0"),
        /// What the vehicle is commanded at `act_s`: `"continue"` (nothing), `"hold"`, `"contingency"`, `"rtl"`
        pub on_loss: OnLoss => Value("\"continue\""),
        /// Whether a CUCS without a guard may be listed with LOI 2 alone
        pub guarded_only: bool => Value("false"),
    }
}

impl Default for Authority {
    fn default() -> Self {
        Authority {
            warn_s: 3.0,
            offer_s: 5.0,
            act_s: 10.0,
            on_loss: OnLoss::Continue,
            guarded_only: false,
        }
    }
}

impl Authority {
    fn unspanned() -> Spanned<Authority> {
        Spanned::new(0..0, Authority::default())
    }
}

table! {
    /// `[mavlink]`
    #[derive(Debug, Clone, Copy, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    pub struct Mavlink {
        /// MAVLink system id of the VSM, 1 to 255
        pub system_id: u8 => Value("245"),
        /// MAVLink component id of the VSM, 0 to 255
        pub component_id: u8 => Value("190"),
    }
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
        let text = ConfigError::read(path, "`vsm init` writes one to begin with")?;
        let folder = path.parent().unwrap_or(Path::new(""));
        Config::parse(&text, folder).map_err(|cause| match explain::other_kind(&text, false) {
            Some((kind, command)) => ConfigError::OtherKind {
                path: path.to_owned(),
                kind,
                expected: "the configuration of a bridge",
                command,
            },
            None => cause.in_file(path),
        })
    }

    /// Parses and checks the text of a file whose relative paths start at `folder`.
    ///
    /// # Errors
    /// As [`Config::load`].
    pub fn parse(text: &str, folder: &Path) -> Result<Config, ConfigError> {
        let mut config: Config = toml::from_str(text)
            .map_err(|cause| explain::explain::<Self>(&cause, text, Config::KEYS))?;
        let located = |fault: Fault| fault.located(text, Config::KEYS);
        config.vehicle = counted::expand(config.vehicle).map_err(located)?;
        config.check().map_err(located)?;
        config.resolve(folder);
        Ok(config)
    }

    /// The vehicles, without their places in the file.
    pub fn vehicles(&self) -> impl Iterator<Item = &Vehicle> {
        self.vehicle.iter().map(Spanned::get_ref)
    }

    /// The links of the vehicles, each once, in the order in which the file first names them.
    #[must_use]
    pub fn links(&self) -> Vec<&LinkAddress> {
        let mut links = Vec::new();
        for vehicle in self.vehicles() {
            if !links.contains(&&vehicle.link) {
                links.push(&vehicle.link);
            }
        }
        links
    }

    /// The other ground stations, without their places in the file.
    pub fn forwards(&self) -> impl Iterator<Item = &Forward> {
        self.forward.iter().map(Spanned::get_ref)
    }

    /// The ground stations, without their places in the file.
    pub fn stations(&self) -> impl Iterator<Item = &Cucs> {
        self.cucs.iter().map(Spanned::get_ref)
    }

    /// What is allowed, and weaker than it could be: for the log at each start, and for the status.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings: Vec<String> = self
            .vehicles()
            .filter(|vehicle| vehicle.signing == Signing::Off)
            .map(|vehicle| {
                format!(
                    "{}: MAVLink signing is OFF: anyone in range can command this vehicle",
                    vehicle.id
                )
            })
            .collect();
        let listen = self.dli.listen;
        let group = self.dli.multicast.filter(|_| !self.dli.group_is_local());
        let open: Vec<String> = self.dli.open_at().iter().map(ToString::to_string).collect();
        let unguarded = self.stations().filter(|cucs| cucs.guard.is_none());
        let unguarded: Vec<_> = unguarded.map(|cucs| cucs.id.to_string()).collect();
        if !open.is_empty() && !unguarded.is_empty() {
            warnings.push(format!(
                "DLI on {}: CUCSs are not authenticated without a guard: anyone who can send there from the address of {} can command \
                 its vehicles; give it a guard, or keep the DLI on loopback, or behind a tunnel or firewall",
                open.join(" and "),
                unguarded.join(", ")
            ));
        }
        let far = self.store.far_endpoints();
        if !far.is_empty() {
            warnings.push(format!(
                "store.endpoints: requests to {} are neither encrypted nor authenticated: who is on the way can end this node's lease, or \
                 hand a node that takes over an earlier right or plan; keep etcd and its nodes in a network of their own, or in a tunnel",
                far.join(" and ")
            ));
        }
        if self.zeroize.by_message && !open.is_empty() && !unguarded.is_empty() {
            warnings.push(format!(
                "zeroize.by_message: refused of {}, which have no guard, while the DLI is open on {}",
                unguarded.join(", "),
                open.join(" and ")
            ));
        }
        if self.access.is_some() && !unguarded.is_empty() {
            warnings.push(format!(
                "[access]: the access list gives {} nothing, which have no guard: an entry is for a guard key",
                unguarded.join(", ")
            ));
        }
        if self.web.control && self.stations().all(|one| !one.web) {
            warnings.push(
                "[web] control is true, and no [[cucs]] has web = true: nobody can connect"
                    .to_owned(),
            );
        }
        let unreached = |cucs: &&Cucs| cucs.delivery.to_address();
        if group.is_some()
            && listen.ip().is_loopback()
            && self.stations().any(|one| unreached(&one))
        {
            warnings.push(format!(
                "dli.listen is {listen}: stations that reach this VSM by the group are sent nothing at their addresses; listen on \
                 another address, or set delivery = \"group\" in their [[cucs]]"
            ));
        }
        let silent = |cucs: &&Cucs| {
            let controls = LoiBitmap::LOI4.union(LoiBitmap::LOI5);
            cucs.edition == Some(Edition::Ed25) && cucs.loi.0.intersects(controls)
        };
        let silent = self
            .stations()
            .filter(silent)
            .map(|cucs| cucs.id.to_string());
        let silent: Vec<_> = silent.collect();
        if !silent.is_empty() {
            warnings.push(format!(
                "{}: Edition 2.5 has no heartbeat: in control and silent it keeps control, and on_loss is not flown; give \
                 another CUCS override = true",
                silent.join(", ")
            ));
        }
        warnings
    }

    /// The first key, in the order of the file's tables, that does not fit.
    pub(super) fn check(&self) -> Result<(), Fault> {
        if let Some(group) = self.dli.multicast
            && let Some(other) = self
                .dli
                .sources
                .iter()
                .find(|one| one.is_ipv4() != group.is_ipv4())
        {
            let kind = if group.is_ipv4() { "IPv4" } else { "IPv6" };
            let expected = format!("addresses of {kind}, as the group {group} is");
            return fault(0, "dli.sources", other, &expected);
        }
        let mut ids = vec![self.dli.vsm_id];
        for station in &self.cucs {
            let id = station.get_ref().id;
            if ids.contains(&id) {
                return fault(station.span().start, "cucs.id", id, OWN_ID);
            }
            ids.push(id);
            let has_group = self.dli.multicast.is_some();
            station.get_ref().check(station.span().start, has_group)?;
        }
        self.store.check()?;
        self.check_fleet()?;
        self.check_guards()?;
        self.web.check(self.http.as_ref(), &self.cucs)?;
        let mut links: Vec<(&LinkAddress, u8)> = Vec::new();
        for spanned in &self.vehicle {
            let (vehicle, at) = (spanned.get_ref(), spanned.span().start);
            if ids.contains(&vehicle.id) {
                return fault(at, "vehicle.id", vehicle.id, OWN_ID);
            }
            ids.push(vehicle.id);
            if let Some(logical) = vehicle.logical_id {
                if ids.contains(&logical) {
                    return fault(at, "vehicle.logical_id", logical, OWN_ID);
                }
                ids.push(logical);
            }
            let system = (&vehicle.link, vehicle.system_id);
            // On a shared link only the system id tells whose a frame is.
            if links.contains(&system) {
                let expected = "a system id of its own for each vehicle of one link: set another here, by MAV_SYS_ID in \
                                that vehicle, and in its [[vehicle]]";
                let found = format!("{} twice on {}", vehicle.system_id, vehicle.link);
                return fault(at, "vehicle.system_id", found, expected);
            }
            // A device is opened once for all its vehicles, so it has one speed.
            let other_speed =
                |one: &&LinkAddress| one.is_device_of(&vehicle.link) && **one != vehicle.link;
            if let Some(other) = links.iter().map(|(link, _)| *link).find(other_speed) {
                let expected =
                    format!("{other}, the speed that this device has for another vehicle");
                return fault(at, "vehicle.link", &vehicle.link, &expected);
            }
            let alone = |link: &LinkAddress| {
                let on_it = |one: &&Spanned<Vehicle>| one.get_ref().link == *link;
                self.vehicle.iter().filter(on_it).count() == 1
            };
            if vehicle.encrypt && !alone(&vehicle.link) {
                let expected = "a link that no other vehicle is on: it is encrypted for one agent";
                return fault(at, "vehicle.encrypt", true, expected);
            }
            links.push(system);
            // 0 addresses every system, and the VSM's own id would not tell its frames from the vehicle's.
            if vehicle.system_id == 0 || vehicle.system_id == self.mavlink.system_id {
                let expected = "1 to 255, and not the VSM's own (mavlink.system_id)";
                return fault(at, "vehicle.system_id", vehicle.system_id, expected);
            }
            vehicle.check(at)?;
        }
        self.check_forwards()?;
        self.check_ports()?;
        self.zeroize.check()?;
        let Authority {
            warn_s,
            offer_s,
            act_s,
            ..
        } = *self.authority.get_ref();
        if !(warn_s <= offer_s && offer_s <= act_s) {
            let at = self.authority.span().start;
            let found = format!("warn_s {warn_s}, offer_s {offer_s}, act_s {act_s}");
            return fault(at, "authority", found, "warn_s <= offer_s <= act_s");
        }
        if let Some(record) = self.record.as_ref().filter(|record| record.max_mb < 8) {
            return fault(0, "record.max_mb", record.max_mb, "8 or more, MiB");
        }
        if self.mavlink.system_id == 0 {
            return fault(0, "mavlink.system_id", 0, "1 to 255");
        }
        Ok(())
    }

    fn check_guards(&self) -> Result<(), Fault> {
        let commands = |one: &Cucs| {
            let levels = LoiBitmap::LOI3
                .union(LoiBitmap::LOI4)
                .union(LoiBitmap::LOI5);
            one.loi.0.intersects(levels)
        };
        for spanned in &self.cucs {
            let (cucs, at) = (spanned.get_ref(), spanned.span().start);
            if self.authority.get_ref().guarded_only && cucs.guard.is_none() && commands(cucs) {
                let expected =
                    "loi = [2], or guard = { key_file = \"FILE\" }: authority.guarded_only is true";
                return fault(at, "cucs.loi", "LOI 3 to 5 without a guard", expected);
            }
        }
        Ok(())
    }

    fn check_forwards(&self) -> Result<(), Fault> {
        let links = self.links();
        let mut links: Vec<String> = links.iter().map(ToString::to_string).collect();
        let mut names = Vec::new();
        for spanned in &self.forward {
            let (forward, at) = (spanned.get_ref(), spanned.span().start);
            forward.check(at)?;
            if names.contains(&&forward.name) {
                let expected = "a name of its own for each [[forward]]";
                return fault(at, "forward.name", &forward.name, expected);
            }
            names.push(&forward.name);
            let link = forward.link.to_string();
            if links.contains(&link) {
                let expected = "a link of its own, which no vehicle and no other [[forward]] has";
                return fault(at, "forward.link", &forward.link, expected);
            }
            links.push(link);
            let known = |id: &Id| self.vehicles().any(|one| one.id == *id);
            if let Some(id) = forward.vehicles.iter().find(|id| !known(id)) {
                return fault(
                    at,
                    "forward.vehicles",
                    id,
                    "the ids of [[vehicle]]s of this file",
                );
            }
            let covers = |id| forward.vehicles.is_empty() || forward.vehicles.contains(&id);
            let mut own = self.vehicles().filter(|one| covers(one.id));
            if forward.unsigned && own.any(|one| one.link_id == forward.link_id) {
                let expected = "another than vehicle.link_id with unsigned = true, such as 7: what it sends is a stream of its own";
                return fault(at, "forward.link_id", forward.link_id, expected);
            }
            let mut taken = self.vehicles().map(|one| one.system_id);
            let system = forward.system_id;
            if system == 0 || system == self.mavlink.system_id || taken.any(|id| id == system) {
                let expected = "1 to 255, and neither the VSM's own (mavlink.system_id) nor a vehicle's: set it in that \
                                ground station";
                return fault(at, "forward.system_id", system, expected);
            }
        }
        Ok(())
    }

    /// That no two of its sockets want the same port.
    fn check_ports(&self) -> Result<(), Fault> {
        let vehicles = self.vehicle.iter().filter_map(|spanned| {
            let (link, at) = (&spanned.get_ref().link, spanned.span().start);
            Some((at, "vehicle.link", link.waits_at()?, link.to_string()))
        });
        let (tcp, udp): (Vec<_>, Vec<_>) = self
            .forward
            .iter()
            .filter_map(|spanned| {
                let (link, at) = (&spanned.get_ref().link, spanned.span().start);
                Some((at, "forward.link", *link.waits_at()?, link.to_string()))
            })
            .partition(|(_, _, _, link)| link.starts_with("tcpin:"));
        let listen = self.dli.listen;
        let page = self.http.as_ref().map(|http| http.listen);
        let page = page.map(|at| (0, "http.listen", at, at.to_string()));
        let udp = [(0, "dli.listen", listen, listen.to_string())]
            .into_iter()
            .chain(vehicles)
            .chain(udp);
        no_port_twice(udp)?;
        no_port_twice(page.into_iter().chain(tcp))
    }

    /// What a VSM cannot do that several computers can serve: what is kept elsewhere than in the store, or needs what is.
    fn check_fleet(&self) -> Result<(), Fault> {
        if self.store.kind == StoreKind::Files {
            return Ok(());
        }
        for spanned in &self.vehicle {
            let (vehicle, at) = (spanned.get_ref(), spanned.span().start);
            match &vehicle.signing {
                // Only rising signature stamps keep a node that was cut off from commanding the vehicle.
                Signing::Off => {
                    let expected = "a key with store.kind = \"etcd\": without signatures the vehicle would obey two nodes at once";
                    return fault(at, "vehicle.signing", "\"off\"", expected);
                }
                Signing::KeyFile(_, exchange) if exchange.mode != ExchangeMode::Off => {
                    let expected = "\"off\" with store.kind = \"etcd\": keys that are agreed over the air lie beside their key file, \
                                    on one computer";
                    return fault(at, "vehicle.signing.exchange", "on", expected);
                }
                Signing::KeyFile(..) => {}
            }
        }
        Ok(())
    }

    /// Reads the elevation files of its vehicles, which can take minutes; files that another configuration has read and that
    /// are unchanged are not read again.
    ///
    /// # Errors
    /// A folder cannot be read, has none or too many, or one of them is damaged.
    pub fn read_terrain(&mut self, before: Option<&Config>) -> Result<(), TerrainFault> {
        let vehicles = self.vehicle.iter_mut().map(Spanned::get_mut);
        let known = before.into_iter().flat_map(Config::vehicles);
        terrain::read(
            vehicles.filter_map(|vehicle| vehicle.terrain.as_mut()),
            known.filter_map(|vehicle| vehicle.terrain.as_ref()),
        )
    }

    fn resolve(&mut self, folder: &Path) {
        for forward in &mut self.forward {
            if let Some(file) = &mut forward.get_mut().key_file {
                *file = folder.join(&*file);
            }
        }
        for station in &mut self.cucs {
            if let Some(guard) = &mut station.get_mut().guard {
                guard.key_file = folder.join(&guard.key_file);
            }
        }
        if let Some(access) = &mut self.access {
            access.list = folder.join(&access.list);
            access.key_file = folder.join(&access.key_file);
        }
        if let Some(tiles) = &mut self.web.tiles {
            *tiles = folder.join(&*tiles);
        }
        self.store.dir = folder.join(&self.store.dir);
        if let Some(file) = &mut self.store.key_file {
            *file = folder.join(&*file);
        }
        if let Some(record) = &mut self.record {
            record.dir = folder.join(&record.dir);
        }
        for vehicle in &mut self.vehicle {
            let vehicle = vehicle.get_mut();
            if let Signing::KeyFile(file, _) = &mut vehicle.signing {
                *file = folder.join(&*file);
            }
            if let Some(terrain) = &mut vehicle.terrain {
                terrain.dir = folder.join(&terrain.dir);
            }
        }
    }
}

/// Places in the file, keys, addresses, and the values as the file has them. Vehicles may share a link.
fn no_port_twice(
    sockets: impl Iterator<Item = (usize, &'static str, SocketAddr, String)>,
) -> Result<(), Fault> {
    let mut known: Vec<(&str, SocketAddr, String)> = Vec::new();
    for (at, key, address, value) in sockets {
        let is_shared = |one: &(&str, SocketAddr, String)| one.0 == key && one.2 == value;
        if known.iter().any(is_shared) {
            continue;
        }
        if let Some((other, _, of)) = known.iter().find(|one| overlap(one.1, address)) {
            let expected = format!("a port that nothing else of this file has: {other} is {of}");
            return fault(at, key, value, &expected);
        }
        known.push((key, address, value));
    }
    Ok(())
}

/// Whether the system would refuse the second of two sockets at these addresses.
fn overlap(one: SocketAddr, other: SocketAddr) -> bool {
    // `[::]` is every address of IPv4 too.
    let covers = |wide: SocketAddr, narrow: SocketAddr| {
        wide.ip().is_unspecified() && (wide.is_ipv6() || narrow.is_ipv4())
    };
    // The system chooses a free port for 0.
    one.port() != 0
        && one.port() == other.port()
        && (one.ip() == other.ip() || covers(one, other) || covers(other, one))
}

fn max_mb() -> u32 {
    2_048
}

const OWN_ID: &str = "an id that nothing else in this file has";
