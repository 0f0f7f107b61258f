//! The vehicles of a bridge, and which of them has something to do next.
//!
//! With a thousand vehicles, asking each after every datagram when it is next due and whether it has a frame to send costs
//! far more than the datagram. What a vehicle answers changes only while somebody has it by `&mut`: every way to that leads through
//! here, so that the fleet knows which vehicles to ask again, and nobody has to report a change.
//!
//! One thing outside a vehicle moves its due time: the silence of the stations. Whatever is received of a station moves it to later, which
//! a vehicle finds out when it is asked at the earlier time; where it may be *earlier*, the bridge calls [`Fleet::ask_all`].
//!
//! Who holds rights over any of them is asked for each datagram of the DLI side, of senders that have proved nothing, too: [`Holders`]
//! reads again only vehicles that somebody had by `&mut` since.
//!
//! Some steps of `Aircraft::handle_timeout` have no due time of their own (a disk that does not answer, a held command whose owner is
//! gone). They are at most a second late, since each link is due for its heartbeat once a second.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};
use std::time::Duration;

use stanag_msgs::Id;
use stanag_msgs::enums::LoiBitmap;

use super::aircraft::Aircraft;
use super::link::frame::OutFrame;
use super::link::key_recovery::KeyChange;
use super::station::GroundStation;

/// The vehicles, numbered in the order of the configuration.
#[derive(Debug, Default)]
pub(crate) struct Fleet {
    all: Vec<Aircraft>,
    /// The alert seed of the next vehicle.
    pub(crate) next_number: i32,
    by_id: BTreeMap<Id, usize>,
    /// The vehicles of each link: MAVLink system id, number.
    by_port: Vec<Vec<(u8, usize)>>,
    timers: Timers,
    /// Found due last: a buffer, since telemetry passes without an allocation.
    due: Vec<usize>,
    holders: Holders,
    /// Lent since they were last asked when they are due, whether they have a frame to send, whether their key files change, and who
    /// holds rights.
    unasked: Marks,
    may_send: Marks,
    may_change_key: Marks,
    may_change_holders: Marks,
}

impl Fleet {
    pub(crate) fn len(&self) -> usize {
        self.all.len()
    }

    pub(crate) fn iter(&self) -> std::slice::Iter<'_, Aircraft> {
        self.all.iter()
    }

    pub(crate) fn get(&self, index: usize) -> Option<&Aircraft> {
        self.all.get(index)
    }

    pub(crate) fn has(&self, id: Id) -> bool {
        self.by_id.contains_key(&id)
    }

    pub(crate) fn find(&self, id: Id) -> Option<&Aircraft> {
        self.all.get(*self.by_id.get(&id)?)
    }

    /// Whether a station holds any right over any vehicle.
    pub(crate) fn has_holder(&mut self, station: Id) -> bool {
        let holds = self.holders().counts.contains_key(&station);
        debug_assert!(
            self.all
                .iter()
                .any(|one| !one.authority.rights().held(station).is_empty())
                == holds,
            "rights have changed, and nobody was lent the vehicle"
        );
        holds
    }

    /// Whether a station holds LOI 3, 4 or 5 of a vehicle.
    pub(crate) fn controls(&mut self, station: Id) -> bool {
        let count = self.holders().counts.get(&station);
        let controls = count.is_some_and(|count| count.commands > 0);
        debug_assert!(
            self.all
                .iter()
                .any(|one| one.authority.rights().commands(station))
                == controls,
            "rights have changed, and nobody was lent the vehicle"
        );
        controls
    }

    /// How often the rights over any vehicle have changed.
    pub(crate) fn changes_of_rights(&mut self) -> u64 {
        self.holders().changes
    }

    fn holders(&mut self) -> &Holders {
        while let Some(index) = self.may_change_holders.take() {
            if let Some(one) = self.all.get(index) {
                let rights = one.authority.rights().each_right();
                self.holders.read(index, rights);
            }
        }
        &self.holders
    }

    /// The vehicles of the link with this index: MAVLink system id, number.
    pub(crate) fn on_port(&self, port: usize) -> &[(u8, usize)] {
        self.by_port.get(port).map_or(&[], Vec::as_slice)
    }

    /// Lends every vehicle: for what concerns them all. For one, [`Fleet::find_mut`] costs the others nothing.
    pub(crate) fn iter_mut(&mut self) -> std::slice::IterMut<'_, Aircraft> {
        self.mark_all();
        self.all.iter_mut()
    }

    pub(crate) fn get_mut(&mut self, index: usize) -> Option<&mut Aircraft> {
        let one = self.all.get_mut(index)?;
        self.unasked.mark(index);
        self.may_send.mark(index);
        self.may_change_key.mark(index);
        self.may_change_holders.mark(index);
        Some(one)
    }

    pub(crate) fn find_mut(&mut self, id: Id) -> Option<&mut Aircraft> {
        self.get_mut(*self.by_id.get(&id)?)
    }

    /// The vehicle of this id, or where `all` is set every vehicle.
    pub(crate) fn meant_mut(&mut self, id: Id, all: bool) -> &mut [Aircraft] {
        if all {
            self.mark_all();
            return &mut self.all;
        }
        let index = self.by_id.get(&id).copied();
        let one = index.filter(|index| self.get_mut(*index).is_some());
        one.map_or(&mut [], |index| &mut self.all[index..=index])
    }

    pub(crate) fn push(&mut self, one: Aircraft) {
        self.all.push(one);
        self.number();
    }

    pub(crate) fn truncate(&mut self, length: usize) {
        self.all.truncate(length);
        self.number();
    }

    pub(crate) fn retain(&mut self, keep: impl FnMut(&Aircraft) -> bool) {
        self.all.retain(keep);
        self.number();
    }

    /// The vehicles are others, or have other numbers, links or system ids.
    pub(crate) fn number(&mut self) {
        let each = self.all.iter().enumerate();
        self.by_id = each.map(|(index, one)| (one.id(), index)).collect();
        self.by_port.clear();
        for (index, one) in self.all.iter().enumerate() {
            if self.by_port.len() <= one.port {
                self.by_port.resize_with(one.port + 1, Vec::new);
            }
            self.by_port[one.port].push((one.system(), index));
        }
        self.timers = Timers::default();
        self.holders = Holders {
            changes: self.holders.changes + 1,
            ..Holders::default()
        };
        for marks in [
            &mut self.unasked,
            &mut self.may_send,
            &mut self.may_change_key,
            &mut self.may_change_holders,
        ] {
            *marks = Marks::default();
        }
        self.mark_all();
    }

    fn mark_all(&mut self) {
        for index in 0..self.all.len() {
            self.unasked.mark(index);
            self.may_send.mark(index);
            self.may_change_key.mark(index);
            self.may_change_holders.mark(index);
        }
    }

    /// Every vehicle is asked again when it is due: the stations have changed in a way that may make it earlier.
    pub(crate) fn ask_all(&mut self) {
        for index in 0..self.all.len() {
            self.unasked.mark(index);
        }
    }

    /// When the first vehicle is due.
    pub(crate) fn poll_timeout(
        &mut self,
        now: Duration,
        stations: &[GroundStation],
    ) -> Option<Duration> {
        while let Some(index) = self.unasked.take() {
            let one = self.all.get(index);
            let due = one.and_then(|one| one.poll_timeout(now, stations));
            self.timers.set(index, due);
        }
        debug_assert!(
            self.all.iter().enumerate().all(|(index, one)| {
                let asked = self.timers.due[index].unwrap_or(Duration::MAX);
                let due = one.poll_timeout(now, stations).unwrap_or(Duration::MAX);
                asked <= due
            }),
            "a vehicle is due earlier than it said, and nobody was lent it"
        );
        self.timers.first()
    }

    /// Finds vehicles that are due, those first that have been so for longest, and how many they are; [`Fleet::due_mut`] lends them.
    /// Not more than [`MAX_AT_ONCE`]: a command must not wait for a thousand vehicles' reports. In the order of their numbers:
    /// stations see it.
    pub(crate) fn find_due(&mut self, now: Duration, stations: &[GroundStation]) -> usize {
        self.poll_timeout(now, stations);
        self.due.clear();
        while self.due.len() < MAX_AT_ONCE && self.timers.first().is_some_and(|at| at <= now) {
            self.due.extend(self.timers.pop());
        }
        self.due.sort_unstable();
        self.due.len()
    }

    pub(crate) fn due_mut(&mut self, at: usize) -> Option<&mut Aircraft> {
        self.get_mut(*self.due.get(at)?)
    }

    /// The next frame for a vehicle, and its number.
    pub(crate) fn poll_transmit(&mut self) -> Option<(usize, OutFrame)> {
        while let Some(index) = self.may_send.first() {
            let one = self.all.get_mut(index);
            if let Some(frame) = one.and_then(|one| one.link.poll_transmit()) {
                return Some((index, frame));
            }
            self.may_send.take();
        }
        None
    }

    /// Whether [`poll_transmit`](Self::poll_transmit) has one.
    pub(crate) fn has_frame(&mut self) -> bool {
        while let Some(index) = self.may_send.first() {
            if self.all.get(index).is_some_and(|one| one.link.has_frame()) {
                return true;
            }
            self.may_send.take();
        }
        false
    }

    /// The next change that the key files of a vehicle need, and its number.
    pub(crate) fn poll_key_change(&mut self) -> Option<(usize, KeyChange)> {
        while let Some(index) = self.may_change_key.first() {
            let one = self.all.get_mut(index);
            if let Some(change) = one.and_then(|one| one.link.key_recovery.change.take()) {
                return Some((index, change));
            }
            self.may_change_key.take();
        }
        None
    }
}

/// Numbers, each at most once, in the order in which they were marked.
#[derive(Debug, Default)]
struct Marks {
    order: std::collections::VecDeque<usize>,
    marked: Vec<bool>,
}

impl Marks {
    fn mark(&mut self, index: usize) {
        if self.marked.len() <= index {
            self.marked.resize(index + 1, false);
        }
        if !std::mem::replace(&mut self.marked[index], true) {
            self.order.push_back(index);
        }
    }

    fn first(&self) -> Option<usize> {
        self.order.front().copied()
    }

    fn take(&mut self) -> Option<usize> {
        let index = self.order.pop_front()?;
        self.marked[index] = false;
        Some(index)
    }
}

/// When each is due, with the first at hand.
#[derive(Debug, Default)]
struct Timers {
    due: Vec<Option<Duration>>,
    /// Also times that are no longer those of `due`: they are dropped when they come first, or when they are the most of it,
    /// which is cheaper than to find each.
    heap: BinaryHeap<Reverse<(Duration, usize)>>,
}

impl Timers {
    fn set(&mut self, index: usize, due: Option<Duration>) {
        if self.due.len() <= index {
            self.due.resize(index + 1, None);
        }
        let before = std::mem::replace(&mut self.due[index], due);
        if let Some(at) = due.filter(|_| before != due) {
            self.heap.push(Reverse((at, index)));
        }
        if self.heap.len() > 4 * self.due.len() + 64 {
            let each = self.due.iter().enumerate();
            let each = each.filter_map(|(index, due)| Some(Reverse(((*due)?, index))));
            self.heap = each.collect();
        }
    }

    fn first(&mut self) -> Option<Duration> {
        while let Some(Reverse((at, index))) = self.heap.peek() {
            if self.due[*index] == Some(*at) {
                return Some(*at);
            }
            self.heap.pop();
        }
        None
    }

    fn pop(&mut self) -> Option<usize> {
        self.first()?;
        let Reverse((_, index)) = self.heap.pop()?;
        self.due[index] = None;
        Some(index)
    }
}

/// The rights over all vehicles, by the station that holds them.
#[derive(Debug, Default)]
struct Holders {
    /// Those over each vehicle, as they were last read.
    of_each: Vec<Vec<(Id, LoiBitmap)>>,
    counts: BTreeMap<Id, Count>,
    changes: u64,
}

/// How many rights a station holds, and how many of these command.
#[derive(Debug, Default)]
struct Count {
    all: usize,
    commands: usize,
}

impl Holders {
    fn read(&mut self, index: usize, rights: impl Iterator<Item = (Id, LoiBitmap)> + Clone) {
        if self.of_each.len() <= index {
            self.of_each.resize_with(index + 1, Vec::new);
        }
        let known = &mut self.of_each[index];
        if rights.clone().eq(known.iter().copied()) {
            return;
        }
        self.changes += 1;
        for (station, level) in known.drain(..) {
            if let Some(count) = self.counts.get_mut(&station) {
                count.all -= 1;
                count.commands -= usize::from(level != LoiBitmap::LOI2);
            }
        }
        for (station, level) in rights {
            known.push((station, level));
            let count = self.counts.entry(station).or_default();
            count.all += 1;
            count.commands += usize::from(level != LoiBitmap::LOI2);
        }
        self.counts.retain(|_, count| count.all > 0);
    }
}

/// Vehicles whose due work is done in one call.
const MAX_AT_ONCE: usize = 64;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn each_is_marked_once_and_taken_in_order() {
        let mut marks = Marks::default();
        for index in [2, 0, 2, 1, 0] {
            marks.mark(index);
        }
        let taken: Vec<_> = std::iter::from_fn(|| marks.take()).collect();
        assert_eq!(taken, [2, 0, 1]);
        marks.mark(2);
        assert_eq!(marks.first(), Some(2));
    }

    proptest! {
        /// Against a walk over all, which is what the counts save.
        #[test]
        fn the_holders_are_those_of_all_vehicles(
            steps in proptest::collection::vec(
                (0..4_usize, proptest::collection::vec((0..3_u32, 0..3_usize), 0..4)),
                0..60,
            )
        ) {
            let levels = [LoiBitmap::LOI2, LoiBitmap::LOI3, LoiBitmap::LOI4];
            let mut holders = Holders::default();
            let mut model: [Vec<(Id, LoiBitmap)>; 4] = Default::default();
            for (index, rights) in steps {
                let rights = rights.into_iter().map(|(id, level)| (Id(id), levels[level]));
                let rights: Vec<_> = rights.collect();
                let before = holders.changes;
                holders.read(index, rights.iter().copied());
                prop_assert_eq!(holders.changes > before, model[index] != rights);
                model[index] = rights;
                for station in (0..3).map(Id) {
                    let own = model.iter().flatten().filter(|(id, _)| *id == station);
                    let all = own.clone().count();
                    let commands = own.filter(|(_, level)| *level != LoiBitmap::LOI2).count();
                    let count = holders.counts.get(&station);
                    let found = count.map(|count| (count.all, count.commands));
                    prop_assert_eq!(found, (all > 0).then_some((all, commands)));
                }
            }
        }

        /// Against the minimum over all, which is what the heap saves.
        #[test]
        fn the_first_is_the_earliest_of_those_that_are_set(
            steps in proptest::collection::vec((0..5_usize, proptest::option::of(0..900_u64)), 0..600)
        ) {
            let (mut timers, mut model) = (Timers::default(), [None; 5]);
            for (index, due) in steps {
                let due = due.map(Duration::from_secs);
                timers.set(index, due);
                model[index] = due;
                prop_assert_eq!(timers.first(), model.iter().flatten().min().copied());
                prop_assert!(timers.heap.len() <= 84, "what is of no use is kept");
            }
            while let Some(index) = timers.pop() {
                let least = model.iter().flatten().min().copied();
                prop_assert_eq!(model[index].take(), least);
            }
            prop_assert!(model.iter().all(Option::is_none));
        }
    }
}
