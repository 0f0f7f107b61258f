//! The whole bridge as one machine: datagrams of both sides and the time go in, datagrams and log lines come out.
//!
//! `arrival`: the sender of a DLI datagram, and whether it is accepted; `dispatch`: the destination of its message. Each
//! vehicle is an [`Aircraft`]; `port`: a link; `vehicles`: the vehicle for a frame of a link. `reach`: the address of a
//! station, and its proof. `keys`: connects the shell's key exchange with a vehicle's link; `forwards`: other ground
//! stations; `files`: files of a vehicle; `guards`: CUCSs with a guard key; `web`: CUCSs on a WebSocket; `access`: the
//! access list; `zeroize`: orders to erase all data of this VSM; `editions`: stations of Edition 2.5; `status`: the status
//! of the bridge; `map`: the map's data; `reload`: a changed configuration while it runs.

mod access;
mod arrival;
mod contingencies;
mod dispatch;
mod editions;
mod files;
mod forwards;
mod guards;
mod keys;
pub(crate) mod map;
mod port;
mod reach;
mod reload;
pub(crate) mod status;
mod vehicles;
mod watch;
mod web;
mod zeroize;

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::frame::FrameView;
use mavlink_link::service::Node;
use mavlink_link::store::{Changes, Disk, StoreError};
use stanag_msgs::enums::LoiBitmap;
use stanag_msgs::{Id, Profile};

pub use self::forwards::PreparedForwards;
use self::port::Links;
pub use self::vehicles::link_config;
pub use self::web::{WebOpened, WebWay};
use super::access::Gate;
use super::aircraft::Aircraft;
use super::alerts::Alerts;
use super::allowance::Allowance;
use super::authority::Input;
use super::authority::record::KnownStation;
use super::authority::rules::Silence;
use super::context::{Settings, WATCH_SLACK};
use super::counters::{ByType, Counters};
use super::duplicates::{Remembered, Seen};
use super::effects::DliEffects;
use super::findings::Finding;
use super::findings::dli::DliEvidence;
use super::findings::host::KeyFiles;
use super::fleet::Fleet;
use super::forward::Forward;
use super::guard::GroupSender;
use super::limits::Limits;
use super::link::frame::{OutFrame, Peer};
use super::log::{LogEntry, LogLevel};
use super::logical::LogicalIds;
use super::outbox::{Datagram, Outbox};
use super::paths::Paths;
use super::reports::VehicleSettings;
use super::station::GroundStation;
use super::store::Boot;
use super::trace;
use super::web::WebRefusal;
use super::zeroize::Zeroize;
use crate::config::Config;

/// The machine.
#[derive(Debug)]
pub struct Bridge {
    vsm: Id,
    boot: Option<Boot>,
    setup: Setup,
    stations: Vec<GroundStation>,
    /// The recent messages of each station.
    remembered: Vec<Remembered>,
    /// Commands, each with its station, that a restart has cut off and that were refused at the start, before anything was received
    /// from the station: where it is then received from another address, it is sent that again, for it may have moved meanwhile.
    cut_off: Vec<(usize, Seen)>,
    aircraft: Fleet,
    links: Links,
    /// Other ground stations.
    forwards: Vec<Forward>,
    outbox: Outbox,
    paths: Paths,
    /// Alerts of the VSM itself, not of a vehicle.
    alerts: Alerts,
    logical: LogicalIds,
    counters: Counters,
    records: Records,
    checks: Checks,
    handled: Handled,
    guards: Guards,
    web: WebClients,
    ed25: Ed25,
    zeroize: Zeroize,
    access: Gate,
}

/// What the configuration sets for the VSM as a whole.
#[derive(Debug)]
struct Setup {
    /// Our MAVLink ids.
    own: Node,
    settings: Settings,
    /// The readings of disputed values for an unknown station.
    readings: Profile,
    /// The multicast group for status, which is also received.
    group: Option<SocketAddr>,
    /// Alerts caused by the configuration.
    warnings: Vec<String>,
}

impl Setup {
    fn of(config: &Config) -> Setup {
        Setup {
            own: Node::new(config.mavlink.system_id, config.mavlink.component_id),
            settings: Settings::of(config),
            readings: config.dli.disputed.profile.clone(),
            group: config.dli.multicast,
            warnings: config.warnings(),
        }
    }
}

/// What operators can read of this run, besides the counters.
#[derive(Debug, Default)]
struct Records {
    started: Duration,
    /// The DLI messages taken.
    received: ByType,
    log: VecDeque<LogEntry>,
    /// Whether the handling of each datagram is logged.
    trace: bool,
}

/// The checks for faults (`watch`).
#[derive(Debug, Default)]
struct Checks {
    /// A date that the clock cannot be before.
    not_before: Duration,
    /// Evidence of unusable data on the DLI side.
    evidence: DliEvidence,
    key_files: KeyFiles,
    /// What is wrong with the store's folder, or its disk.
    store: Option<Finding>,
    /// The last reload was refused.
    reload: Option<Finding>,
    /// When the bridge last ran.
    ran_at: Duration,
    /// When the next check is due.
    look_at: Duration,
    /// The findings of the last check.
    found: Vec<Finding>,
    /// The listening stations, which receive the alerts of the VSM itself.
    notified: Vec<usize>,
}

/// The datagram that is being handled.
#[derive(Debug, Default)]
struct Handled {
    /// The station whose guard sealed it.
    guarded: Option<usize>,
    /// The station whose message it is, once that is accepted.
    asker: Option<usize>,
}

/// What is for guards themselves (`guards`).
#[derive(Debug, Default)]
struct Guards {
    /// Seals datagrams to the group for CUCSs with a guard; `None` until there is a secret for its keys.
    group: Option<GroupSender>,
    /// Datagrams for guards, such as those that raise their stamps, and their addresses.
    lifts: Vec<(SocketAddr, Box<[u8]>)>,
    /// Steps of an exchange about a guard key, and where they came from.
    steps: VecDeque<(SocketAddr, Box<[u8]>)>,
}

/// What concerns no single web client (`web`).
#[derive(Debug, Default)]
struct WebClients {
    /// Connections to close.
    ends: Vec<(u64, WebRefusal)>,
    /// What refusals may be logged.
    logged: Allowance,
}

/// What stations of Edition 2.5 are sent (`editions`).
#[derive(Debug, Default)]
struct Ed25 {
    /// Messages for them.
    translated: VecDeque<Datagram>,
    /// The latest ones sent to the group, by type and instance.
    sent_to_group: VecDeque<(u32, u32)>,
    /// The holders of each vehicle, as last shown to these stations.
    shown_holders: Vec<(Id, Id, LoiBitmap)>,
    /// How often the rights had changed by then.
    shown_changes: u64,
}

/// Called with every accepted frame and the index of its vehicle, for a recording.
pub type Tap<'a> = &'a mut dyn FnMut(usize, &FrameView<'_>);

/// Who sends from an address of the DLI side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DliSender {
    /// The station of this index, which has proved that it is there, or controls a vehicle from there.
    Station(usize),
    /// Anybody else, by the part of all computers that his is in.
    Other(usize),
}

/// A bridge that cannot start.
#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    /// A stored record cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The signing clock cannot be read.
    #[error("vehicle {vehicle}: {cause}")]
    Clock {
        /// The vehicle.
        vehicle: Id,
        /// Why.
        cause: StoreError,
    },
}

/// What the shell knows of the computer's clocks.
#[derive(Debug, Clone, Copy)]
pub struct HostClocks {
    /// A date that the wall clock cannot be before, since 1970: that of the build.
    pub not_before: Duration,
    /// The present boot; `None` where the system does not name it. Nothing is done then that needs the age of a record.
    pub boot: Option<Boot>,
}

impl From<Duration> for HostClocks {
    fn from(not_before: Duration) -> HostClocks {
        HostClocks {
            not_before,
            boot: None,
        }
    }
}

/// The shell's part of a vehicle's link: its key, and where to send before any data of the vehicle is received.
#[derive(Debug)]
pub struct LinkEnd {
    /// The key; `None` where signing is off by configuration.
    pub key: Option<mavlink_link::signing::SigningKey>,
    /// The fixed peer of a udpout or serial link.
    pub peer: Option<Peer>,
}

impl Bridge {
    /// Starts from a configuration, one [`LinkEnd`] for each of its vehicles in order, and what was stored. `clocks`: where the boot is
    /// not known, [`HostClocks::not_before`] alone.
    ///
    /// # Errors
    /// A record of the store cannot be read.
    pub fn new(
        config: &Config,
        ends: Vec<LinkEnd>,
        now: Now,
        clocks: impl Into<HostClocks>,
        disk: &mut dyn Disk,
    ) -> Result<Bridge, BridgeError> {
        let HostClocks { not_before, boot } = clocks.into();
        let each = config.stations().cloned();
        let each = each.map(|cucs| GroundStation::new(cucs, &config.dli));
        let stations: Vec<GroundStation> = each.collect();
        let mut bridge = Bridge {
            vsm: config.dli.vsm_id,
            boot,
            setup: Setup::of(config),
            remembered: stations.iter().map(|_| Remembered::default()).collect(),
            cut_off: Vec::new(),
            stations,
            aircraft: Fleet::default(),
            links: Links::default(),
            forwards: Vec::new(),
            outbox: Outbox::default(),
            paths: Paths::new(
                Limits::of(&config.dli),
                config.stations().map(|cucs| cucs.address),
            ),
            // The alert ids of the VSM itself follow those of its vehicles, which are numbered from 0; vehicles that are
            // added later follow the VSM.
            alerts: Alerts::new(i32::try_from(config.vehicles().count()).unwrap_or(i32::MAX / 2)),
            logical: LogicalIds::default(),
            counters: Counters::default(),
            records: Records {
                started: now.mono,
                ..Records::default()
            },
            checks: Checks {
                not_before,
                ran_at: now.mono,
                look_at: now.mono,
                ..Checks::default()
            },
            handled: Handled::default(),
            guards: Guards::default(),
            web: WebClients::default(),
            ed25: Ed25::default(),
            zeroize: Zeroize::new(config.zeroize, config.dli.open_at().is_empty()),
            access: Gate::of(config),
        };
        for (vehicle, end) in config.vehicles().zip(ends) {
            bridge.add_vehicle(vehicle, end, now, not_before, disk)?;
        }
        // Holders of a vehicle already know it by its id: after a restart in flight it must not appear as another vehicle
        // for a moment.
        let held = |real: Id| {
            let one = bridge.aircraft.find(real);
            one.is_none_or(|one| one.authority.rights().holders().next().is_some())
        };
        bridge.logical.reload(config, held);
        // The VSM's own alerts have the number after the vehicles of the start.
        bridge.aircraft.next_number += 1;
        bridge.restore_commands(now, disk)?;
        bridge.restore_contingencies(disk);
        // Not before the held commands are restored: the list is applied to them once it is loaded.
        bridge.give_permits(now);
        let (mut dli, aircraft) = bridge.effects(now, disk);
        for one in aircraft.iter_mut() {
            one.show_standing(&mut dli);
        }
        Ok(bridge)
    }

    /// Makes the stamps by which CUCSs prove their addresses unpredictable; random, and for this run only.
    pub fn set_secret(&mut self, secret: [u8; 32]) {
        self.paths.set_secret(secret);
    }

    /// The time since boot at which the monotonic time was 0 ([`Boot::zero`]), which a sleep of the computer changes: a record that is
    /// written after that would pass for older, and a held command be carried out too early after a restart.
    pub fn note_zero(&mut self, zero: Duration) {
        if let Some(boot) = &mut self.boot {
            boot.zero = zero;
        }
    }

    /// Switches logging of each datagram on or off. It is off by default, since the lines cost more than the datagrams.
    pub fn set_trace(&mut self, on: bool) {
        self.records.trace = on;
    }

    /// Restores the holders of an authority record: status is sent to their earlier addresses without a new request, and the
    /// silence of a holder that sent heartbeats is detected.
    fn remember_stations(&mut self, now: Duration, known: &[KnownStation]) {
        for known in known {
            let mut stations = self.stations.iter_mut().enumerate();
            let Some((index, station)) = stations.find(|(_, station)| station.id() == known.id)
            else {
                continue;
            };
            station.restore(now, &known.shown);
            // The address of a web client is its connection.
            if let Some(peer) = known.peer.filter(|_| !station.config.web) {
                let at = (peer, station.speaks_ed25());
                self.paths.restore(now, index, at, known.proven);
                station.peer = self.paths.peer(index);
                station.proven = self.paths.is_proven(index);
            }
            if known.sends_heartbeats {
                station.sends_heartbeats = true;
                // Its silence counts from this start: its messages while the VSM was down are unknown.
                station.received = station.received.or(Some(now));
            }
        }
    }

    /// Reads back the commands of each CUCS, and answers those without a final answer.
    fn restore_commands(&mut self, now: Now, disk: &mut dyn Disk) -> Result<(), StoreError> {
        for index in 0..self.stations.len() {
            let id = self.stations[index].id();
            let open = self.remembered[index].restore(id, now.mono, disk)?;
            for seen in open {
                let (mut dli, aircraft) = self.effects(now, disk);
                let of = aircraft.find_mut(seen.destination);
                let answered =
                    of.is_some_and(|aircraft| aircraft.resume_command(&mut dli, index, &seen));
                // If it is sent again it gets the same result; it must not be answered as a duplicate then.
                if !answered {
                    self.remembered[index].forget(seen.digest);
                } else if self.remembered[index].was_refused(seen.message_type, seen.stamp) {
                    self.cut_off.push((index, seen));
                }
            }
            if let Err(fault) = self.remembered[index].compact(id, disk) {
                let vsm = self.vsm;
                let (mut dli, _) = self.effects(now, disk);
                dli.note(LogLevel::Error, vsm, fault.to_string());
            }
        }
        Ok(())
    }

    /// The station is where it was sent the ends of what a restart has cut off.
    fn forget_cut_off(&mut self, index: usize) {
        self.cut_off.retain(|(station, _)| *station != index);
    }

    /// A station has an address, or another one: sends it the ends of what a restart has cut off.
    fn end_cut_off(&mut self, now: Now, index: usize, disk: &mut dyn Disk) {
        let all = std::mem::take(&mut self.cut_off).into_iter();
        let (own, others): (Vec<_>, Vec<_>) = all.partition(|(station, _)| *station == index);
        self.cut_off = others;
        for (_, seen) in own {
            let (mut dli, aircraft) = self.effects(now, disk);
            if let Some(one) = aircraft.find_mut(seen.destination) {
                one.refuse_cut_off(&mut dli, index, &seen);
            }
        }
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Now, disk: &mut dyn Disk) {
        self.outbox.watch_time(now);
        let due = self.aircraft.find_due(now.mono, &self.stations);
        let (mut dli, aircraft) = self.effects(now, disk);
        for at in 0..due {
            if let Some(one) = aircraft.due_mut(at) {
                one.handle_timeout(&mut dli);
            }
        }
        dli.clear_answers();
        self.watch_zeroize(now, disk);
        self.forget_heartbeats(now.mono);
        self.introduce(now, disk);
        self.watch_forwards(now, disk);
        self.watch_paths(now, disk);
        self.keep_guards(now, disk);
        self.watch_web(now.mono);
        self.watch_access(now, disk);
        self.watch_findings(now, disk);
        self.show_holders(now, disk);
    }

    /// A vehicle that was offered by its logical id is received: message 3 names the id that it has from now on. It keeps
    /// that id even while its link is silent: for its controller it must not become another vehicle.
    fn introduce(&mut self, now: Now, disk: &mut dyn Disk) {
        let is_there = |real: Id| {
            let one = self.aircraft.find(real);
            one.is_some_and(|one| one.vehicle.live())
        };
        let waiting = self.logical.waiting();
        let there: Vec<Id> = waiting.filter(|real| is_there(*real)).collect();
        for real in there {
            // First under the logical id, then under its own.
            for _ in 0..2 {
                let (mut dli, aircraft) = self.effects(now, disk);
                if let Some(one) = aircraft.find_mut(real) {
                    for station in 0..dli.stations.len() {
                        one.ask_authority(
                            &mut dli,
                            Input::Returned {
                                station,
                                missed: false,
                            },
                        );
                    }
                }
                self.logical.introduce(real);
            }
        }
    }

    /// Begins to read the settings of every vehicle that [`mapping::hardening`] checks; joins a reading in progress.
    pub fn read_settings(&mut self, now: Now, disk: &mut dyn Disk) {
        let (mut dli, aircraft) = self.effects(now, disk);
        for aircraft in aircraft.iter_mut() {
            aircraft.read_settings(&mut dli);
        }
    }

    /// The vehicles' answers about their settings so far.
    #[must_use]
    pub fn vehicle_settings(&self) -> Vec<VehicleSettings> {
        self.aircraft
            .iter()
            .map(Aircraft::vehicle_settings)
            .collect()
    }

    /// The disk has made queued changes durable: decisions that waited for it take effect, and delayed messages are sent.
    pub fn handle_durable(&mut self, now: Now, disk: &mut dyn Disk) {
        let (mut dli, aircraft) = self.effects(now, disk);
        let is_failing = dli.disk.failing().is_some();
        // With many vehicles some ceiling of a clock becomes durable all the time, which concerns none of the others.
        for index in 0..aircraft.len() {
            let one = aircraft.get(index);
            if one.is_some_and(|one| is_failing || one.awaits_disk())
                && let Some(one) = aircraft.get_mut(index)
            {
                one.handle_durable(&mut dli);
            }
        }
        dli.release();
        // A release takes effect when it is durable.
        self.forget_who_left();
        self.show_holders(now, disk);
    }

    /// The silence of a CUCS counts if it has sent heartbeats while it holds a right to command. A CUCS that has released
    /// its rights, or lost them by silence, may come back without heartbeats. LOI 2 alone does not count, since silence
    /// never costs it.
    fn forget_heartbeats(&mut self, now: Duration) {
        for station in self.stations.iter_mut().filter(|one| one.sends_heartbeats) {
            let id = station.id();
            station.sends_heartbeats = match station.silence(now, &self.setup.settings.authority) {
                Silence::Lost => self.aircraft.controls(id),
                _ => self.aircraft.has_holder(id),
            };
        }
    }

    /// When [`Bridge::handle_timeout`] is next needed.
    #[must_use]
    pub fn poll_timeout(&mut self, now: Duration) -> Duration {
        let of_vehicles = self.aircraft.poll_timeout(now, &self.stations);
        (of_vehicles.into_iter())
            .chain(self.alerts.poll_timeout())
            .chain(self.zeroize.poll_timeout())
            .chain((self.paths.poll_timeout(now)).filter(|_| !self.outbox.is_paused()))
            // It shares a wake-up with the reports if there are any.
            .chain([self.checks.look_at + WATCH_SLACK])
            .chain(self.forwards.iter().map(Forward::poll_timeout))
            .fold(now + LONGEST_WAIT, Duration::min)
    }

    /// The shell has dropped a datagram, uninspected, for the reason with this name.
    pub fn count_dropped(&mut self, name: &'static str) {
        self.counters.count(name);
    }

    /// Who sends from this address, as far as it is known without reading what he sends.
    #[must_use]
    pub fn sender_at(&mut self, address: SocketAddr) -> DliSender {
        let mut stations = self.stations.iter().enumerate();
        let aircraft = &mut self.aircraft;
        let station = stations.find(|(index, station)| {
            self.paths.peer(*index) == Some(address)
                && (self.paths.is_proven(*index) || aircraft.controls(station.id()))
        });
        match station {
            Some((index, _)) => DliSender::Station(index),
            None => DliSender::Other(self.paths.computer(address)),
        }
    }

    /// The next datagram for the DLI side.
    pub fn poll_dli(&mut self) -> Option<Datagram> {
        if self.outbox.is_paused() {
            return None;
        }
        self.next_datagram()
    }

    /// Whether anything may be there to be sent: where not, [`poll_vehicle`](Self::poll_vehicle), [`poll_dli`](Self::poll_dli),
    /// [`poll_lift`](Self::poll_lift) and [`poll_forward`](Self::poll_forward) have nothing. Most frames of telemetry lead to nothing.
    pub fn may_send(&mut self) -> bool {
        self.aircraft.has_frame()
            || !self.ed25.translated.is_empty()
            || !self.outbox.is_empty()
            || !self.guards.lifts.is_empty()
            || self.forwards.iter().any(Forward::has_frame)
    }

    /// The next frame for a vehicle: (index of the vehicle, frame).
    pub fn poll_vehicle(&mut self) -> Option<(usize, OutFrame)> {
        loop {
            let (index, frame) = self.aircraft.poll_transmit()?;
            if !self.outbox.is_paused() || frame.keeps_link() {
                return Some((index, frame));
            }
        }
    }

    /// Pauses the bridge, or lets it continue. Paused, it answers no station and commands no vehicle: another node may serve
    /// this VSM.
    ///
    /// It follows what it receives, so that it continues with the state of now. Heartbeats to the vehicles, and PINGs, continue:
    /// they command nothing, and without them a vehicle's failsafe would begin. Other frames are lost, as on a link that is cut.
    /// Alerts, answers to what was commanded before, and reports that are sent once wait; those that are repeated are not sent.
    ///
    /// What a station's address has proved lasts as much longer as the pause: its challenges could not be sent. What had waited for
    /// a proof as the pause began is dropped: commands would be carried out a minute late.
    pub fn pause(&mut self, now: Duration, paused: bool) {
        match (self.outbox.paused_since, paused) {
            (None, true) => {
                self.outbox.paused_since = Some(now);
                self.paths.drop_held();
            }
            (Some(since), false) => {
                self.outbox.paused_since = None;
                self.paths.extend_proofs(now, now.saturating_sub(since));
            }
            _ => {}
        }
    }

    /// The log line for a datagram that is sent to a station, if datagrams are traced.
    #[must_use]
    pub fn trace_dli(&self, to: SocketAddr, datagram: &Datagram) -> LogEntry {
        LogEntry {
            level: LogLevel::Debug,
            about: self.vsm,
            text: trace::dli_sent(
                self.readings_of(datagram.destination()),
                to,
                datagram.bytes(),
            ),
        }
    }

    /// The index of the station of the configuration with this id.
    fn listed(&self, id: Id) -> Option<usize> {
        let is_it = |one: &GroundStation| one.id() == id && !one.removed;
        self.stations.iter().position(is_it)
    }

    /// The readings of disputed values for the station with this id.
    fn readings_of(&self, id: Id) -> &Profile {
        let station = self.stations.iter().find(|station| station.id() == id);
        station.map_or(&self.setup.readings, |station| &station.profile.readings)
    }

    /// The same for a frame that is sent to the vehicle with this index.
    #[must_use]
    pub fn trace_vehicle(&self, index: usize, frame: &OutFrame) -> LogEntry {
        LogEntry {
            level: LogLevel::Debug,
            about: self.aircraft.get(index).map_or(self.vsm, Aircraft::id),
            text: trace::mavlink_sent(frame),
        }
    }

    /// The next line for the log.
    pub fn poll_log(&mut self) -> Option<LogEntry> {
        self.records.log.pop_front()
    }

    fn effects<'a>(
        &'a mut self,
        now: Now,
        disk: &'a mut dyn Disk,
    ) -> (DliEffects<'a>, &'a mut Fleet) {
        self.note_time(now.mono);
        self.outbox.answer_after = Changes::NONE;
        let effects = DliEffects {
            mark: disk.queued(),
            asker: self.handled.asker,
            now,
            boot: self.boot,
            vsm: self.vsm,
            multicast: self.setup.group.is_some(),
            stations: &self.stations,
            logical: &self.logical,
            remembered: &mut self.remembered,
            alerts: &mut self.alerts,
            outbox: &mut self.outbox,
            paths: &mut self.paths,
            counters: &mut self.counters,
            log: &mut self.records.log,
            disk,
        };
        (effects, &mut self.aircraft)
    }
}

/// An answer comes from the destination of the query; the VSM answers a query to all.
fn destination_as_source(destination: Id, vsm: Id) -> Id {
    if destination == Id::BROADCAST {
        vsm
    } else {
        destination
    }
}

/// The wake-up interval if nothing is due.
const LONGEST_WAIT: Duration = Duration::from_secs(1);
/// The counter of what is not carried out while [`Bridge::pause`] holds.
const PAUSED: &str = "the lease of this node has ended";
