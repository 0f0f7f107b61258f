//! CUCSs with a guard: a datagram in their name is accepted only if its trailer verifies, and datagrams to them are sealed.
//!
//! Only the configuration decides whether a station has a guard. Without keys here, nothing of such a station is accepted.
//!
//! A key that was replaced by hand is accepted for a day, by the wall clock where the bridge starts or reads its configuration
//! again. That clock may be wrong by any time, and the station may fly with the old copy. So until it has used the key in force once,
//! which is on disk then, the one before is accepted for at least [`GRACE`] from there.

use std::net::SocketAddr;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::signing::KeyId;
use mavlink_link::store::{Disk, Store as _, StoreError};
use serde::{Deserialize, Serialize};
use stanag_msgs::Id;
use stanag_msgs::guard::{ClockDatagram, Direction, ExchangeDatagram, Guarded, MAX_GUARDED};

use super::Bridge;
use crate::session::findings::dli::Fault;
use crate::session::guard::{GroupSender, GuardEnd, GuardKeyUntil, GuardStatus};
use crate::session::log::{LogEntry, LogLevel};
use crate::session::outbox::{Datagram, Destination};
use crate::session::station::GroundStation;
use crate::session::store::vehicle_record;

/// The latest key that a CUCS has used while it was in force.
#[derive(Debug, Serialize, Deserialize)]
struct UsedKey {
    id: String,
}

// Nothing follows from it but the next start.
vehicle_record!(UsedKey, "guard-used", Answered);

/// A datagram, before its content is read.
pub(super) enum Opened<'a> {
    /// It has no trailer.
    Plain(&'a [u8]),
    /// The content of a verified one, and the index of its station.
    Verified(&'a [u8], usize),
    /// It is dropped.
    Dropped,
}

impl Opened<'_> {
    /// The station whose trailer has verified.
    pub(super) fn station(&self) -> Option<usize> {
        match self {
            Opened::Verified(_, index) => Some(*index),
            Opened::Plain(_) | Opened::Dropped => None,
        }
    }
}

impl Bridge {
    /// Gives the group of CUCSs with a guard its keys; random, and for this run only.
    pub fn set_group_secret(&mut self, secret: [u8; 32], now: Now) {
        self.guards.group = Some(GroupSender::new(self.vsm, secret, now));
    }

    /// Sets the guard keys of the CUCSs, the one in force first. The state of a key that stays is kept.
    ///
    /// # Errors
    /// The clock of a key cannot be read: then its station has no key, and nothing of it is accepted. The others have
    /// theirs.
    pub fn set_guard_keys(
        &mut self,
        keys: Vec<(Id, Vec<GuardKeyUntil>)>,
        now: Now,
        not_before: Duration,
        disk: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        let mut renews_group = false;
        for station in self.stations.iter_mut() {
            let lost = station.config.guard.is_none() || station.removed;
            if lost && station.guard.take().is_some() {
                renews_group = true;
            }
        }
        let mut given = Ok(());
        for (id, keys) in keys {
            let mut stations = self.stations.iter_mut().enumerate();
            let guarded = |(_, one): &(usize, &mut GroundStation)| {
                one.id() == id && one.config.guard.is_some()
            };
            let Some((index, station)) = stations.find(guarded) else {
                continue;
            };
            let stays = |end: &GuardEnd| {
                end.key_ids()
                    .all(|known| keys.iter().any(|(key, _)| key.id() == known))
            };
            if !station.guard.as_ref().is_some_and(stays) {
                // Messages were held back without a guard, or under a key that is no longer valid.
                self.paths.forget_candidates(index);
                renews_group = true;
            }
            let set = station.set_guard_keys(self.vsm, keys, not_before, now, disk);
            given = set.and(given);
        }
        // The holder of a revoked key may have the group's key too.
        if renews_group && let Some(group) = &mut self.guards.group {
            group.renew();
        }
        given
    }

    /// The stations with a guard, and the id of the key that each has in force.
    #[must_use]
    pub fn guard_key_ids(&self) -> Vec<(Id, Option<String>)> {
        let guarded = self.stations.iter().enumerate();
        let guarded = guarded.filter(|(_, one)| one.config.guard.is_some() && !one.removed);
        let key = |index| self.guard_status(index, Duration::ZERO)?.key_id;
        guarded.map(|(index, one)| (one.id(), key(index))).collect()
    }

    /// Whether a CUCS with a guard may use this key, so that it is in force, or the one before it. False where it has no guard.
    #[must_use]
    pub fn has_guard_key(&self, cucs: Id, key: KeyId) -> bool {
        let station = self.listed(cucs).and_then(|index| self.stations.get(index));
        let guard = station.and_then(|one| one.guard.as_ref());
        guard.is_some_and(|guard| guard.has(key))
    }

    /// Looks for a trailer, and verifies it.
    pub(super) fn open_guarded<'a>(
        &mut self,
        now: Now,
        from: SocketAddr,
        bytes: &'a [u8],
        disk: &mut dyn Disk,
    ) -> Opened<'a> {
        let Some(guarded) = Guarded::parse(bytes) else {
            if let Some(about) = ClockDatagram::parse(bytes) {
                self.take_clock(now, from, &about, disk);
                return Opened::Dropped;
            }
            let Some(step) = ExchangeDatagram::parse(bytes) else {
                return Opened::Plain(bytes);
            };
            self.queue_step(from, &step, bytes);
            return Opened::Dropped;
        };
        let sender = guarded.trailer.sender;
        if guarded.trailer.direction == Direction::ToGroup {
            // Every guard of the group has this key, so datagrams sealed with it are status and command nothing. That
            // includes our own.
            let ours = sender == self.vsm;
            self.counters
                .count(if ours { OUR_OWN } else { UNDER_GROUP_KEY });
            return Opened::Dropped;
        }
        let mut stations = self.stations.iter_mut().enumerate();
        let found = stations.find_map(|(index, one)| {
            let listed = one.config.id == sender && !one.removed;
            let end = one.guard.as_mut().filter(|_| listed)?;
            Some((index, end, one.config.address, one.config.web))
        });
        let Some((index, end, address, web)) = found else {
            self.counters.count(WITHOUT_KEY);
            return Opened::Dropped;
        };
        // Each station has one way in: a key that is in a browser must not be valid for datagrams too.
        if web {
            self.counters.count(DATAGRAM_OF_WEB);
            let fault = Fault::WebDatagram(sender, DATAGRAM_OF_WEB);
            self.checks.evidence.note(now.mono, from, fault);
            return Opened::Dropped;
        }
        // Checked before its stamp is used up: a faster copy from elsewhere must not cost the station its own datagram.
        if let Some(expected) = address.filter(|one| *one != from.ip()) {
            self.counters.count(UNAUTHORISED_ADDRESS);
            let fault = Fault::Address(sender, expected);
            self.checks.evidence.note(now.mono, from, fault);
            return Opened::Dropped;
        }
        let peer = self.paths.peer(index);
        match end.open_from(now, &guarded, (from, peer), disk) {
            // It has only raised our stamps.
            Ok(([], _)) => Opened::Dropped,
            Ok((inside, key)) => {
                self.stations[index].sealed_under = Some(key);
                Opened::Verified(inside, index)
            }
            Err(why) => {
                self.counters.count(why.name());
                if !why.wants_lift() {
                    // A datagram that is too old may be the station's own, after a start of this end.
                    let fault = Fault::Guard(sender, why.name());
                    self.checks.evidence.note(now.mono, from, fault);
                }
                if why.wants_reply() {
                    let mut out = [0; MAX_GUARDED];
                    if let Some(length) = end.reply(now, &mut out, disk) {
                        self.guards.lifts.push((from, out[..length].into()));
                    }
                }
                Opened::Dropped
            }
        }
    }

    /// Handles a challenge about clocks, or an answer to one, if it comes from an address of its station.
    fn take_clock(
        &mut self,
        now: Now,
        from: SocketAddr,
        about: &ClockDatagram,
        disk: &mut dyn Disk,
    ) {
        let sender = about.trailer.sender;
        let listed = self.listed(sender).map(|index| &mut self.stations[index]);
        let found = listed.filter(|one| !one.config.web);
        let found = found.and_then(|one| Some((one.config.address, one.guard.as_mut()?)));
        let Some((address, end)) = found else {
            return self.counters.count(WITHOUT_KEY);
        };
        if address.is_some_and(|expected| expected != from.ip()) {
            return self.counters.count(UNAUTHORISED_ADDRESS);
        }
        let mut out = [0; MAX_GUARDED];
        match end.take_clock(now, about, &mut out, disk) {
            Ok(Some(length)) => self.guards.lifts.push((from, out[..length].into())),
            Ok(None) => self.records.log.extend(end.take_met().map(|text| LogEntry {
                level: LogLevel::Warning,
                about: sender,
                text,
            })),
            Err(why) => self.counters.count(why.name()),
        }
    }

    /// Passes a step of an exchange to the exchange machine, which verifies it. It changes nothing here.
    fn queue_step(&mut self, from: SocketAddr, step: &ExchangeDatagram<'_>, bytes: &[u8]) {
        if step.vsm != self.vsm {
            self.counters.count("guard: exchange with another VSM");
        } else if self.listed(step.cucs).is_none() {
            self.counters
                .count("guard: exchange of a CUCS that is not listed");
        } else if self.guards.steps.len() >= MAX_STEPS {
            self.counters
                .count("guard: too many steps of exchanges at once");
        } else {
            self.guards.steps.push_back((from, bytes.into()));
        }
    }

    /// The next step of an exchange about a guard key, for the machine that answers it.
    pub fn poll_guard_step(&mut self) -> Option<(SocketAddr, Box<[u8]>)> {
        if self.outbox.is_paused() {
            // A key that only this node has would shut the guard out at the next one.
            self.guards.steps.clear();
        }
        self.guards.steps.pop_front()
    }

    /// Sends a CUCS's guard bytes that are not of the DLI, sealed, to the address of the CUCS. Returns false if that is
    /// unknown, there is no key for it, or the bridge is paused.
    pub fn send_guard(&mut self, now: Now, cucs: Id, bytes: &[u8], disk: &mut dyn Disk) -> bool {
        let Some(index) = self.listed(cucs).filter(|_| !self.outbox.is_paused()) else {
            return false;
        };
        let mut out = [0; MAX_GUARDED];
        let end = self.stations[index].guard.as_mut();
        let sealed = end.and_then(|end| end.seal(now, bytes, &mut out, disk).ok());
        let Some((to, length)) = self.paths.peer(index).zip(sealed) else {
            return false;
        };
        self.guards.lifts.push((to, out[..length].into()));
        true
    }

    /// The next datagram for a guard itself, such as one that raises its stamps, and its address. It is sent as it is, in
    /// addition to [`Bridge::poll_dli`].
    pub fn poll_lift(&mut self) -> Option<(SocketAddr, Box<[u8]>)> {
        if self.outbox.is_paused() {
            // Made again: any of them may be lost on its way.
            self.guards.lifts.clear();
        }
        self.guards.lifts.pop()
    }

    /// A datagram as it is sent: sealed if it is for a CUCS with a guard. `None` if it must not be sent, because there is
    /// no key, or the disk has no stamp for it.
    pub fn sealed<'a>(
        &mut self,
        now: Now,
        datagram: &'a Datagram,
        out: &'a mut [u8; MAX_GUARDED],
        disk: &mut dyn Disk,
    ) -> Option<&'a [u8]> {
        let id = datagram.destination();
        let group = self.guards.group.as_mut();
        let mut stations = self.stations.iter_mut();
        let Some(station) = stations.find(|one| one.id() == id && one.config.guard.is_some())
        else {
            return Some(datagram.bytes());
        };
        let end = station.guard.as_mut();
        let sealed = match datagram.to {
            Destination::Unicast(_) => {
                end.and_then(|end| end.seal(now, datagram.bytes(), out, disk).ok())
            }
            Destination::Multicast => {
                group.and_then(|group| group.seal(now, datagram.bytes(), out))
            }
        };
        let Some(length) = sealed else {
            self.counters.count("guard: not sent, no key or no stamp");
            return None;
        };
        out.get(..length)
    }

    /// Once a second: keeps the ceilings of the guards' clocks ahead, and ends replaced keys.
    pub(super) fn keep_guards(&mut self, now: Now, disk: &mut dyn Disk) {
        for station in &mut self.stations {
            let id = station.id();
            let Some(end) = &mut station.guard else {
                continue;
            };
            end.keep(now, disk);
            let used = end.used().filter(|key| station.used_key != Some(*key));
            if let Some(key) = used {
                let record = UsedKey {
                    id: key.to_string(),
                };
                // Where the disk refuses it, again in a second.
                if disk.save(&id, &record).is_ok() {
                    station.used_key = Some(key);
                }
            }
        }
        self.offer_group(now, disk);
    }

    /// Sends the group's key to each guard whose CUCS receives the group, repeatedly, since an offer may be lost.
    fn offer_group(&mut self, now: Now, disk: &mut dyn Disk) {
        let to_group = self.setup.group.is_some();
        let Some(group) = self.guards.group.as_mut().filter(|_| to_group) else {
            return;
        };
        let offer = group.offer();
        for (index, station) in self.stations.iter_mut().enumerate() {
            let id = station.id();
            let due = group.offer_is_due(id, now.mono);
            let takes = station.profile.delivery.to_group() && !station.removed;
            let peer = self.paths.peer(index).filter(|_| takes && due);
            if let (Some(end), Some(peer)) = (station.guard.as_mut(), peer) {
                let mut out = [0; MAX_GUARDED];
                if let Ok(length) = end.seal_offer(now, &offer, &mut out, disk) {
                    self.guards.lifts.push((peer, out[..length].into()));
                    group.note_offered(id, now.mono);
                }
            }
        }
    }

    /// The status of a station's guard.
    pub(super) fn guard_status(&self, index: usize, now: Duration) -> Option<GuardStatus> {
        self.stations
            .get(index)?
            .guard
            .as_ref()
            .map(|end| end.status(now))
    }
}

impl GroundStation {
    /// Sets its guard keys. Where that fails it has none: it does not keep the old one either, which may have been revoked.
    fn set_guard_keys(
        &mut self,
        vsm: Id,
        keys: Vec<GuardKeyUntil>,
        not_before: Duration,
        now: Now,
        disk: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        let id = self.id();
        let mut end = match self.guard.take() {
            Some(end) => end,
            None => {
                let used = disk.load::<UsedKey>(&id)?;
                self.used_key = used.and_then(|used| KeyId::parse(&used.id));
                let (ids, sends) = ((vsm, id), Direction::ToCucs);
                GuardEnd::new(ids, sends, Vec::new(), not_before, now, disk)?
            }
        };
        let in_force = keys.first().map(|(key, _)| key.id());
        let is_used = self.used_key == in_force;
        end.give_grace(if is_used {
            Duration::ZERO
        } else {
            now.mono + GRACE
        });
        end.set_keys(keys, not_before, now, disk)?;
        self.guard = Some(end);
        Ok(())
    }
}

/// How long the key before is accepted from a start or a reload on, whatever the wall clock shows, while its station has not used the
/// one in force: time to copy the new key.
const GRACE: Duration = Duration::from_secs(3_600);
const WITHOUT_KEY: &str = "guard: sender without a guard key";
const OUR_OWN: &str = "our own";
const UNDER_GROUP_KEY: &str = "guard: under a group key, which commands nothing";
/// Maximum number of steps that wait for their machine: more than an honest exchange has in transit.
const MAX_STEPS: usize = 32;
pub(super) const DATAGRAM_OF_WEB: &str = "web: datagram of a web client";
pub(super) const UNAUTHORISED_ADDRESS: &str = "unauthorised address";
