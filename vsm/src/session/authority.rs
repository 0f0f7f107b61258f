//! Who has which rights over one vehicle: levels of interoperability, with one controller at a time.
//!
//! LOI 2 may be held by any number of CUCSs. LOI 3 has one holder. LOI 4 and 5 have one holder together: the
//! controller. A release is always granted; control is taken from another only by a CUCS whose configuration allows
//! to override, or once the holder has been silent for `authority.offer_s`.

use std::collections::BTreeMap;

use stanag_msgs::Id;
use stanag_msgs::enums::LoiBitmap;

/// The rights over one vehicle.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Authority {
    held: BTreeMap<Id, LoiBitmap>,
}

/// What #1 asks (0001.10, Requested Access).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// 0: give up these levels; all that are held where none is named.
    Release(LoiBitmap),
    /// 1: have these levels.
    Control(LoiBitmap),
    /// 2: have these levels, also where another holds them.
    Override(LoiBitmap),
}

/// Who asks, and what the configuration lets it have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Asker {
    /// The CUCS.
    pub id: Id,
    /// `cucs.loi`.
    pub authorised: LoiBitmap,
    /// `cucs.override`.
    pub may_override: bool,
}

/// What came of a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Outcome {
    /// Everything that the asker now holds.
    pub granted: LoiBitmap,
    /// Whether all that was asked for was granted.
    pub in_full: bool,
    /// The CUCSs that lost rights by it.
    pub deposed: Vec<Id>,
}

/// LOI 4 and 5: the levels of the controller.
pub const CONTROL: LoiBitmap = LoiBitmap::LOI4.union(LoiBitmap::LOI5);

impl Authority {
    /// Rights as they were stored.
    pub fn restored(held: impl IntoIterator<Item = (Id, LoiBitmap)>) -> Authority {
        Authority {
            held: held.into_iter().collect(),
        }
    }

    /// Every CUCS with rights, and what it asked for and was granted.
    pub fn holders(&self) -> impl Iterator<Item = (Id, LoiBitmap)> + '_ {
        self.held.iter().map(|(id, levels)| (*id, *levels))
    }

    /// Everything that a CUCS holds: LOI 3 to 5 imply LOI 2.
    #[must_use]
    pub fn granted(&self, id: Id) -> LoiBitmap {
        match self.held.get(&id) {
            Some(levels) if !levels.is_empty() => levels.union(LoiBitmap::LOI2),
            _ => LoiBitmap::NONE,
        }
    }

    /// Whether a CUCS holds all of these levels.
    #[must_use]
    pub fn holds(&self, id: Id, levels: LoiBitmap) -> bool {
        self.granted(id).contains(levels)
    }

    /// The CUCS that holds LOI 4 or 5.
    #[must_use]
    pub fn controller(&self) -> Option<Id> {
        self.held
            .iter()
            .find(|(_, levels)| levels.intersects(CONTROL))
            .map(|(id, _)| *id)
    }

    /// Decides a request. `offered` are levels whose holder has been silent: they are granted as if they were free.
    pub fn request(&mut self, asker: Asker, request: Request, offered: bool) -> Outcome {
        match request {
            Request::Release(levels) => {
                self.release(asker.id, levels);
                Outcome {
                    granted: self.granted(asker.id),
                    in_full: true,
                    deposed: Vec::new(),
                }
            }
            Request::Control(levels) => self.take(asker, levels, offered),
            Request::Override(levels) => self.take(asker, levels, offered || asker.may_override),
        }
    }

    /// Takes levels away; all where none is named.
    pub fn release(&mut self, id: Id, levels: LoiBitmap) {
        let Some(held) = self.held.get_mut(&id) else {
            return;
        };
        *held = if levels.is_empty() {
            LoiBitmap::NONE
        } else {
            held.without(levels)
        };
        if held.is_empty() {
            self.held.remove(&id);
        }
    }

    fn take(&mut self, asker: Asker, levels: LoiBitmap, depose: bool) -> Outcome {
        let wanted = both(levels, asker.authorised);
        let mut deposed = Vec::new();
        let mut granted = both(wanted, LoiBitmap::LOI2);
        // What has one holder is decided as a whole: 3 by itself, 4 and 5 together.
        for exclusive in [LoiBitmap::LOI3, CONTROL] {
            let part = both(wanted, exclusive);
            if part.is_empty() {
                continue;
            }
            let others: Vec<Id> = self
                .held
                .iter()
                .filter(|(id, held)| **id != asker.id && held.intersects(exclusive))
                .map(|(id, _)| *id)
                .collect();
            if !others.is_empty() && !depose {
                continue;
            }
            for other in others {
                self.release(other, exclusive);
                deposed.push(other);
            }
            granted = granted.union(part);
        }
        if !granted.is_empty() {
            let held = self.held.entry(asker.id).or_default();
            *held = held.union(granted);
        }
        Outcome {
            granted: self.granted(asker.id),
            in_full: granted == levels,
            deposed,
        }
    }
}

/// The levels that are in both.
fn both(one: LoiBitmap, other: LoiBitmap) -> LoiBitmap {
    LoiBitmap::from_raw(one.raw() & other.raw())
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: LoiBitmap = LoiBitmap::from_raw(0x0f);
    const A: Asker = Asker {
        id: Id(0xa0),
        authorised: ALL,
        may_override: false,
    };
    const B: Asker = Asker {
        id: Id(0xb0),
        authorised: ALL,
        may_override: true,
    };

    #[test]
    fn control_has_one_holder() {
        let mut authority = Authority::default();
        assert_eq!(
            authority
                .request(A, Request::Control(CONTROL), false)
                .granted,
            LoiBitmap::from_raw(0x0d)
        );
        let refused = authority.request(B, Request::Control(LoiBitmap::LOI5), false);
        assert_eq!(
            (refused.granted, refused.in_full),
            (LoiBitmap::from_raw(0), false)
        );
        assert_eq!(authority.controller(), Some(A.id));
    }

    #[test]
    fn override_needs_its_right() {
        let mut authority = Authority::default();
        authority.request(B, Request::Control(CONTROL), false);
        assert!(
            !authority
                .request(A, Request::Override(CONTROL), false)
                .in_full
        );
        assert_eq!(authority.controller(), Some(B.id));
        authority.request(B, Request::Release(LoiBitmap::from_raw(0)), false);
        authority.request(A, Request::Control(CONTROL), false);
        let taken = authority.request(B, Request::Override(CONTROL), false);
        assert_eq!(taken.deposed, [A.id]);
        assert_eq!(authority.controller(), Some(B.id));
        assert!(!authority.holds(A.id, LoiBitmap::LOI4));
    }

    #[test]
    fn monitors_are_without_number_and_a_part_is_granted() {
        let mut authority = Authority::default();
        authority.request(A, Request::Control(CONTROL), false);
        let monitor = Asker {
            id: Id(0xc0),
            authorised: LoiBitmap::LOI2,
            may_override: false,
        };
        let part = authority.request(monitor, Request::Control(LoiBitmap::from_raw(0x05)), false);
        assert_eq!((part.granted, part.in_full), (LoiBitmap::LOI2, false));
        assert!(authority.holds(monitor.id, LoiBitmap::LOI2));
    }

    #[test]
    fn a_release_is_always_granted_and_ends_the_implied_level() {
        let mut authority = Authority::default();
        authority.request(A, Request::Control(CONTROL), false);
        let released = authority.request(A, Request::Release(CONTROL), false);
        assert_eq!(
            (released.granted, released.in_full),
            (LoiBitmap::from_raw(0), true)
        );
        assert_eq!(authority.controller(), None);
    }

    #[test]
    fn silence_offers_control() {
        let mut authority = Authority::default();
        authority.request(B, Request::Control(CONTROL), false);
        assert!(
            authority
                .request(A, Request::Control(CONTROL), true)
                .in_full
        );
        assert_eq!(authority.controller(), Some(A.id));
    }
}
