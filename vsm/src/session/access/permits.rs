//! The permissions of one CUCS by the access list.

use mavlink_link::signing::KeyId;
use stanag_msgs::Id;
use stanag_msgs::enums::LoiBitmap;

use super::group::Group;
use super::list::AccessEntry;

/// One entry, and whether it has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Permit {
    pub(crate) entry: AccessEntry,
    pub(crate) over: bool,
}

/// The entries of one CUCS; `None` if no list is configured, so that nothing is restricted.
#[derive(Debug, Clone, Default)]
pub(crate) struct Permits(pub(crate) Option<Vec<Permit>>);

/// Whether the list permits a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Permitted {
    Yes,
    /// No entry has this vehicle and group.
    NotListed,
    /// The entry has ended.
    Ended,
    /// The entry is for a different guard key than that of the message.
    OtherKey,
}

impl Permitted {
    /// The counter and the text for its sender; `None` if it is permitted.
    pub(crate) fn refusal(self) -> Option<(&'static str, &'static str)> {
        match self {
            Permitted::Yes => None,
            Permitted::NotListed => Some((
                "access list: outside its groups",
                "the access list does not give it this group of messages",
            )),
            Permitted::Ended => Some((
                "access list: entry has ended",
                "its entry of the access list has ended",
            )),
            Permitted::OtherKey => Some((
                "access list: another guard key",
                "its entry of the access list is for another guard key",
            )),
        }
    }
}

impl Permits {
    /// The levels that it may request of a vehicle, by valid entries for keys that it has.
    pub(crate) fn levels(&self, vehicle: Id, has: impl Fn(KeyId) -> bool) -> LoiBitmap {
        self.union(vehicle, |one| !one.over && has(one.entry.key))
    }

    /// The levels that it may keep in the air if it holds them, regardless of time and key.
    pub(crate) fn kept(&self, vehicle: Id) -> LoiBitmap {
        self.union(vehicle, |_| true)
    }

    /// The same, only by entries for this key.
    pub(crate) fn kept_under(&self, vehicle: Id, key: KeyId) -> LoiBitmap {
        self.union(vehicle, |one| one.entry.key == key)
    }

    fn union(&self, vehicle: Id, counts: impl Fn(&Permit) -> bool) -> LoiBitmap {
        let Some(permits) = &self.0 else {
            return EVERY_LEVEL;
        };
        let of_it = permits.iter().filter(|one| one.entry.vehicle == vehicle);
        let levels = of_it
            .filter(|one| counts(one))
            .map(|one| one.entry.group.level());
        let levels = levels.fold(LoiBitmap::NONE, LoiBitmap::union);
        if levels.is_empty() {
            levels
        } else {
            // Every group that commands includes monitoring.
            levels.union(LoiBitmap::LOI2)
        }
    }

    /// Whether a message of this group is permitted for a vehicle. `key`: the key under which it verified; `None` for a held
    /// command. `flies`: expired entries count.
    pub(crate) fn judge(
        &self,
        vehicle: Id,
        group: Group,
        key: Option<KeyId>,
        flies: bool,
    ) -> Permitted {
        let Some(permits) = &self.0 else {
            return Permitted::Yes;
        };
        let fits = |one: &&Permit| {
            let of_group = group == Group::Monitor || one.entry.group == group;
            one.entry.vehicle == vehicle && of_group
        };
        // The last of these is the closest to a permission.
        let mut found = Permitted::NotListed;
        for one in permits.iter().filter(fits) {
            let of_key = key.is_none_or(|key| key == one.entry.key);
            match (of_key, one.over && !flies) {
                (true, false) => return Permitted::Yes,
                (true, true) => found = Permitted::Ended,
                (false, _) if found == Permitted::NotListed => found = Permitted::OtherKey,
                (false, _) => {}
            }
        }
        found
    }
}

/// The levels that no list can remove.
const EVERY_LEVEL: LoiBitmap = LoiBitmap::from_raw(u8::MAX);
