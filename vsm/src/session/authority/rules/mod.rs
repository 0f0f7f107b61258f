//! The rights over one vehicle: a machine without clock, messages or store.
//!
//! Promised, and checked by `tests/authority/every_state.rs` over every state that can be reached:
//! - LOI 4 and 5 have one holder, the controller. LOI 3 has one holder per payload station. Any number of CUCSs may hold LOI
//!   2.
//! - Rights change hands in one step, reported as a [`Change`]: the changes alone show the holders at any moment.
//! - A release is always granted. A present holder loses a right only by its consent, by an override, or when the controller
//!   requests a payload station by number.
//! - While a mission is loaded for one CUCS, control does not pass to another: a decided handover waits for the end of the
//!   load.
//! - While the vehicle takes off or lands, control passes from its holder to another by override only.
//!
//! Inputs are requests ([`Authority::request`], [`Authority::handover`]), the silence of a CUCS and the time; each
//! yields a [`Decision`]. What must survive a restart is [`Authority::record`].

mod decision;
mod handover;
mod loss;
mod record;
mod request;
mod rights;

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use stanag_msgs::Id;
use stanag_msgs::enums::LoiBitmap;

pub use decision::{Answer, Change, Decision, Ended, Handover, Outcome, Reason, Refusal, Stage};
pub use record::Record;
pub use request::Access;
pub use rights::{CONTROL, Rights, Stations};

/// The rights over one vehicle. Its form allows only one holder for each right.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub struct Authority {
    /// The controller, and which of LOI 4 and 5 it requested.
    control: Option<(Id, LoiBitmap)>,
    /// LOI 3: the holder of each payload station that has one.
    stations: BTreeMap<u8, Id>,
    /// Explicitly requested LOI 2.
    monitors: BTreeSet<Id>,
    /// Pending handovers: control first, then by station. No two concern the same single-holder right.
    pending: Vec<Handover>,
    /// Holders that are silent.
    silent: BTreeMap<Id, Silence>,
}

/// A requester, and its rights by the configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Asker {
    /// The CUCS.
    pub id: Id,
    /// `cucs.loi`.
    pub authorised: LoiBitmap,
    /// `cucs.override`.
    pub may_override: bool,
    /// `cucs.rank`, plus [`GUARDED_RANK`] with a guard: an override can take rights from the same rank and below.
    pub rank: u16,
}

/// Any station with a guard ranks above all without one: anybody can send requests in the name of an unguarded station.
pub const GUARDED_RANK: u16 = 0x100;

impl Asker {
    /// Everything that it may hold.
    #[must_use]
    pub fn may_hold(&self) -> Rights {
        Rights::named(self.authorised, Stations::NONE)
    }

    fn is_guarded(&self) -> bool {
        self.rank >= GUARDED_RANK
    }
}

/// The stage of a CUCS's silence: `authority.warn_s`, `offer_s`, `act_s`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Silence {
    /// Received recently, or it never sent heartbeats.
    #[default]
    None,
    /// Operators are warned.
    Warned,
    /// Another CUCS may take its rights.
    Offered,
    /// It loses its rights.
    Lost,
}

/// The inputs of a decision.
#[derive(Debug, Clone, Copy)]
pub struct Circumstances<'a> {
    /// The time, by the monotonic clock.
    pub now: Duration,
    /// Every CUCS of the configuration.
    pub roster: &'a [Asker],
    /// The CUCS that is loading a mission; the null id if the VSM itself is.
    pub loading: Option<Id>,
    /// The vehicle is taking off or landing.
    pub launch_or_landing: bool,
}

impl Circumstances<'_> {
    fn asker(&self, id: Id) -> Option<&Asker> {
        self.roster.iter().find(|asker| asker.id == id)
    }

    /// Whether one CUCS may take rights from the other without its consent. An unguarded one may not take from a guarded
    /// one: an attacker who keeps a guarded station silent could send requests in the name of an unguarded station.
    fn is_fit(&self, to: Id, holder: Id) -> bool {
        let is_guarded = |id| self.asker(id).is_some_and(Asker::is_guarded);
        is_guarded(to) || !is_guarded(holder)
    }

    /// Whether control must not pass to this CUCS before the load has ended.
    fn load_of_another(&self, to: Id) -> bool {
        self.loading.is_some_and(|owner| owner != to)
    }
}

impl Authority {
    /// All rights of a CUCS, as shown by LOI Granted: LOI 3 to 5 imply LOI 2.
    #[must_use]
    pub fn granted(&self, id: Id) -> LoiBitmap {
        self.held(id).levels()
    }

    /// Whether a CUCS holds all of these levels; LOI 3 with any station.
    #[must_use]
    pub fn holds(&self, id: Id, levels: LoiBitmap) -> bool {
        self.granted(id).contains(levels)
    }

    /// Whether a CUCS holds LOI 3 of a payload station, 1 to 32.
    #[must_use]
    pub fn holds_station(&self, id: Id, station: u8) -> bool {
        self.stations.get(&station) == Some(&id)
    }

    /// The explicit rights of a CUCS.
    #[must_use]
    pub fn held(&self, id: Id) -> Rights {
        let mut levels = LoiBitmap::NONE;
        if let Some((holder, control)) = self.control
            && holder == id
        {
            levels = control;
        }
        if self.monitors.contains(&id) {
            levels = levels.union(LoiBitmap::LOI2);
        }
        let stations = self
            .stations
            .iter()
            .filter(|(_, holder)| **holder == id)
            .fold(0, |raw, (number, _)| raw | Stations::one(*number).raw());
        Rights::named(levels, Stations::NONE)
            .with(Rights::of_stations(Stations::from_raw(stations)))
    }

    /// Every CUCS that holds rights, with its rights.
    pub fn holders(&self) -> impl Iterator<Item = (Id, Rights)> + '_ {
        let all: BTreeSet<Id> = self
            .monitors
            .iter()
            .copied()
            .chain(self.stations.values().copied())
            .chain(self.control.map(|(id, _)| id))
            .collect();
        all.into_iter().map(|id| (id, self.held(id)))
    }

    /// Every right by itself, in an order that changes only with them: LOI 2, LOI 3 of a station, control.
    pub(crate) fn each_right(&self) -> impl Iterator<Item = (Id, LoiBitmap)> + Clone + '_ {
        let monitors = self.monitors.iter().map(|id| (*id, LoiBitmap::LOI2));
        let stations = self.stations.values().map(|id| (*id, LoiBitmap::LOI3));
        monitors.chain(stations).chain(self.control)
    }

    /// The CUCS that holds LOI 4 or 5.
    #[must_use]
    pub fn controller(&self) -> Option<Id> {
        self.control.map(|(id, _)| id)
    }

    /// Whether a CUCS holds a right to command the vehicle or a payload station: only these are lost by silence.
    #[must_use]
    pub fn commands(&self, id: Id) -> bool {
        self.controller() == Some(id) || self.stations.values().any(|holder| *holder == id)
    }

    /// Handovers that are not decided yet or wait for a load to end.
    #[must_use]
    pub fn pending(&self) -> &[Handover] {
        &self.pending
    }

    /// The stage of a holder's silence.
    #[must_use]
    pub fn silence(&self, id: Id) -> Silence {
        self.silent.get(&id).copied().unwrap_or_default()
    }

    /// Whether nobody holds a right and no handover is pending.
    #[must_use]
    pub fn is_free(&self) -> bool {
        self.control.is_none()
            && self.stations.is_empty()
            && self.monitors.is_empty()
            && self.pending.is_empty()
    }

    /// Single-holder rights that other CUCSs hold. Control is held as a whole.
    fn held_by_others(&self, id: Id) -> Rights {
        let control = match self.control {
            Some((holder, _)) if holder != id => CONTROL,
            _ => LoiBitmap::NONE,
        };
        let stations = self
            .stations
            .iter()
            .filter(|(_, holder)| **holder != id)
            .fold(0, |raw, (number, _)| raw | Stations::one(*number).raw());
        Rights::of_control(control).with(Rights::of_stations(Stations::from_raw(stations)))
    }

    /// The holders of the requested rights, and the part that each holds.
    fn by_holder(&self, wanted: Rights, asker: Id) -> Vec<(Id, Rights)> {
        let others = self.holders().filter(|(id, _)| *id != asker);
        others
            .filter_map(|(id, held)| {
                let stations = Rights::of_stations(wanted.both(held).stations());
                // Control is held as a whole: a request for one level concerns the holder of the other level too.
                let control = if held.control().is_empty() {
                    LoiBitmap::NONE
                } else {
                    wanted.control()
                };
                let part = stations.with(Rights::of_control(control));
                (!part.is_empty()).then_some((id, part))
            })
            .collect()
    }

    /// Sets rights without reporting a change.
    fn put(&mut self, id: Id, rights: Rights) {
        if rights.monitors() {
            self.monitors.insert(id);
        }
        for station in rights.stations().iter() {
            self.stations.insert(station, id);
        }
        if !rights.control().is_empty() {
            let before = match self.control {
                Some((holder, levels)) if holder == id => levels,
                _ => LoiBitmap::NONE,
            };
            self.control = Some((id, before.union(rights.control())));
        }
    }

    /// Moves rights to one CUCS in one step, whether they are free, its own, or held by others.
    fn give(&mut self, to: Id, rights: Rights, why: Reason, decision: &mut Decision) {
        let gained = rights.without(self.held(to));
        if gained.is_empty() {
            return;
        }
        // Find the losers before moving anything: afterwards they no longer hold the rights.
        let losers: Vec<(Id, Rights)> = self
            .by_holder(gained, to)
            .into_iter()
            .map(|(id, part)| {
                // A CUCS that loses control loses both levels.
                let held = self.held(id);
                let control = if part.control().is_empty() {
                    LoiBitmap::NONE
                } else {
                    held.control()
                };
                let lost = Rights::of_stations(part.stations());
                (id, lost.with(Rights::of_control(control)))
            })
            .collect();
        self.put(to, gained);
        let mut rest = gained;
        for (from, lost) in &losers {
            // Control passes as a whole: the new holder may gain a level that the loser did not hold.
            let part = if lost.control().is_empty() {
                lost.both(rest)
            } else {
                let control = Rights::of_control(gained.control());
                control.with(lost.both(rest))
            };
            rest = rest.without(part);
            decision.changes.push(Change {
                from: Some(*from),
                lost: *lost,
                to: Some(to),
                gained: part,
                why,
            });
        }
        if !rest.is_empty() {
            decision.changes.push(Change {
                from: None,
                lost: Rights::NONE,
                to: Some(to),
                gained: rest,
                why: Reason::Requested,
            });
        }
        for (from, _) in losers {
            self.forget_silence(from);
        }
    }

    /// Takes rights away, so that they are free.
    fn take(&mut self, from: Id, rights: Rights, why: Reason, decision: &mut Decision) {
        let lost = self.held(from).both(rights);
        if lost.is_empty() {
            return;
        }
        if lost.monitors() {
            self.monitors.remove(&from);
        }
        self.stations.retain(|number, holder| {
            *holder != from || !lost.stations().iter().any(|n| n == *number)
        });
        if let Some((holder, levels)) = self.control
            && holder == from
        {
            let left = levels.without(lost.control());
            self.control = (!left.is_empty()).then_some((from, left));
        }
        self.forget_silence(from);
        decision.changes.push(Change {
            from: Some(from),
            lost,
            to: None,
            gained: Rights::NONE,
            why,
        });
    }

    fn forget_silence(&mut self, id: Id) {
        if self.held(id).is_empty() {
            self.silent.remove(&id);
        }
    }
}

/// How long a holder has to consent, and a named successor to accept.
pub const CONSENT_WITHIN: Duration = Duration::from_secs(20);
