//! Who has which rights over one vehicle: a machine without clock, messages or store.
//!
//! Promised, and checked by `tests/authority/every_state.rs` over every state that can be reached:
//! - LOI 4 and 5 have one holder together, the controller. LOI 3 has one holder a payload station. LOI 2 may be held
//!   by any number.
//! - Rights change hands in one step, reported as a [`Change`]: the changes alone show who holds what at any moment.
//! - A release is always granted. Nothing is taken from a holder that is present, but by its consent, by override, or
//!   where the controller asks for a payload station by its number.
//! - While a mission is loaded for one CUCS, control does not pass to another: what was decided waits for the end.
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

/// The rights over one vehicle. That one right has one holder is the shape of it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub struct Authority {
    /// The controller, and which of LOI 4 and 5 it asked for.
    control: Option<(Id, LoiBitmap)>,
    /// LOI 3: the holder of each payload station that has one.
    stations: BTreeMap<u8, Id>,
    /// LOI 2, asked for by itself.
    monitors: BTreeSet<Id>,
    /// Control first, then by station. No two are for rights that have one holder.
    pending: Vec<Handover>,
    /// Holders that are silent.
    silent: BTreeMap<Id, Silence>,
}

/// Who asks, and what the configuration lets it have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Asker {
    /// The CUCS.
    pub id: Id,
    /// `cucs.loi`.
    pub authorised: LoiBitmap,
    /// `cucs.override`.
    pub may_override: bool,
    /// `cucs.rank`, and [`GUARDED_RANK`] more with a guard: an override takes from its own rank and below.
    pub rank: u16,
}

/// Any station with a guard is above all without: in the name of one without anybody can ask.
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

/// How far the silence of a CUCS has gone: `authority.warn_s`, `offer_s`, `act_s`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Silence {
    /// Received lately, or it never sent heartbeats.
    #[default]
    None,
    /// Operators are warned.
    Warned,
    /// Another may take what it holds.
    Offered,
    /// What it holds is taken away.
    Lost,
}

/// What the machine must know to decide.
#[derive(Debug, Clone, Copy)]
pub struct Circumstances<'a> {
    /// The time, on a clock that does not go back.
    pub now: Duration,
    /// Every CUCS of the configuration.
    pub roster: &'a [Asker],
    /// Who loads a mission just now; the null id where the VSM does by itself.
    pub loading: Option<Id>,
    /// The vehicle takes off or lands.
    pub launch_or_landing: bool,
}

impl Circumstances<'_> {
    fn asker(&self, id: Id) -> Option<&Asker> {
        self.roster.iter().find(|asker| asker.id == id)
    }

    /// Whether one is as good as the other, where that is not asked for its consent: who can keep a guarded station silent
    /// could ask in the name of one without a guard.
    fn is_fit(&self, to: Id, holder: Id) -> bool {
        let is_guarded = |id| self.asker(id).is_some_and(Asker::is_guarded);
        is_guarded(to) || !is_guarded(holder)
    }

    /// Whether control may not pass to this one before the load has ended.
    fn load_of_another(&self, to: Id) -> bool {
        self.loading.is_some_and(|owner| owner != to)
    }
}

impl Authority {
    /// Everything that a CUCS holds, as LOI Granted shows it: LOI 3 to 5 imply LOI 2.
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

    /// What a CUCS holds by itself.
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

    /// Every CUCS that holds something, and what.
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

    /// The CUCS that holds LOI 4 or 5.
    #[must_use]
    pub fn controller(&self) -> Option<Id> {
        self.control.map(|(id, _)| id)
    }

    /// Whether a CUCS holds what commands, the vehicle or a station: silence costs it that, and nothing else.
    #[must_use]
    pub fn commands(&self, id: Id) -> bool {
        self.controller() == Some(id) || !self.held(id).stations().is_empty()
    }

    /// The handovers that are not decided yet, or wait for a load to end.
    #[must_use]
    pub fn pending(&self) -> &[Handover] {
        &self.pending
    }

    /// How far the silence of a holder has gone.
    #[must_use]
    pub fn silence(&self, id: Id) -> Silence {
        self.silent.get(&id).copied().unwrap_or_default()
    }

    /// Whether nobody holds anything and nothing is pending.
    #[must_use]
    pub fn is_free(&self) -> bool {
        self.control.is_none()
            && self.stations.is_empty()
            && self.monitors.is_empty()
            && self.pending.is_empty()
    }

    /// What others than this one hold of what has one holder. Control is held as a whole.
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

    /// The holder of control, or of the stations, that is asked for: by holder, what of it each has.
    fn by_holder(&self, wanted: Rights, asker: Id) -> Vec<(Id, Rights)> {
        let others = self.holders().filter(|(id, _)| *id != asker);
        others
            .filter_map(|(id, held)| {
                let stations = Rights::of_stations(wanted.both(held).stations());
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

    /// Writes rights down, without a word about it.
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

    /// Moves rights that are free, its own, or held by others, to one CUCS in one step.
    fn give(&mut self, to: Id, rights: Rights, why: Reason, decision: &mut Decision) {
        let gained = rights.without(self.held(to));
        if gained.is_empty() {
            return;
        }
        // Found before anything moves: afterwards the losers no longer hold it.
        let losers: Vec<(Id, Rights)> = self
            .by_holder(gained, to)
            .into_iter()
            .map(|(id, part)| {
                // Who loses control loses both of its levels.
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

    /// Takes rights away: they are free.
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
