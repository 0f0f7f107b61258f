//! Rights: levels of interoperability, and payload stations.

use std::fmt;

use stanag_msgs::enums::{LoiBitmap, StationBitmap1To16, StationBitmap17To32};

/// LOI 4 and 5: the levels of the controller.
pub const CONTROL: LoiBitmap = LoiBitmap::LOI4.union(LoiBitmap::LOI5);

/// Payload stations 1 to 32 as a set (0001.09 and Controlled Station 17-32; bit 0 is station 1).
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct Stations(u32);

impl Stations {
    /// No station.
    pub const NONE: Stations = Stations(0);
    /// Stations 1 to 32.
    pub const ALL: Stations = Stations(u32::MAX);

    /// Bit 0 is station 1.
    #[must_use]
    pub const fn from_raw(raw: u32) -> Stations {
        Stations(raw)
    }

    /// Bit 0 is station 1.
    #[must_use]
    pub const fn raw(self) -> u32 {
        self.0
    }

    /// One station, 1 to 32; empty for any other number.
    #[must_use]
    pub const fn one(number: u8) -> Stations {
        if number >= 1 && number <= 32 {
            Stations(1 << (number - 1))
        } else {
            Stations::NONE
        }
    }

    /// The two bitmaps of messages 1, 2, 4 and 5; absent is empty.
    #[must_use]
    pub fn from_bitmaps(
        low: Option<StationBitmap1To16>,
        high: Option<StationBitmap17To32>,
    ) -> Stations {
        let low = low.map_or(0, StationBitmap1To16::raw);
        let high = high.map_or(0, StationBitmap17To32::raw);
        Stations(u32::from(high) << 16 | u32::from(low))
    }

    /// Controlled Station 1-16.
    #[must_use]
    pub fn low(self) -> StationBitmap1To16 {
        StationBitmap1To16::from_raw((self.0 & 0xffff) as u16)
    }

    /// Controlled Station 17-32.
    #[must_use]
    pub fn high(self) -> StationBitmap17To32 {
        StationBitmap17To32::from_raw((self.0 >> 16) as u16)
    }

    /// Whether the set is empty.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The numbers, in increasing order.
    pub fn iter(self) -> impl Iterator<Item = u8> {
        (1..=32).filter(move |number| self.0 & (1 << (number - 1)) != 0)
    }
}

impl fmt::Debug for Stations {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.iter()).finish()
    }
}

/// A set of rights: LOI 2, LOI 4 and LOI 5, and LOI 3 by station.
///
/// Explicit rights only: [`Rights::levels`] adds the LOI 2 that LOI 3 to 5 imply.
#[derive(Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct Rights {
    /// LOI 2 and LOI 4, 5; never LOI 3.
    own: u8,
    stations: Stations,
}

impl Rights {
    /// Nothing.
    pub const NONE: Rights = Rights {
        own: 0,
        stations: Stations::NONE,
    };

    /// The rights of a request (0001.08, 0001.09). LOI 3 without a station means every station; stations without LOI 3 are
    /// ignored.
    #[must_use]
    pub fn named(levels: LoiBitmap, stations: Stations) -> Rights {
        let stations = match (levels.contains(LoiBitmap::LOI3), stations.is_empty()) {
            (false, _) => Stations::NONE,
            (true, true) => Stations::ALL,
            (true, false) => stations,
        };
        Rights {
            own: levels.raw() & (LoiBitmap::LOI2.raw() | CONTROL.raw()),
            stations,
        }
    }

    /// All rights.
    #[must_use]
    pub const fn everything() -> Rights {
        Rights {
            own: LoiBitmap::LOI2.raw() | CONTROL.raw(),
            stations: Stations::ALL,
        }
    }

    /// LOI 2 only.
    #[must_use]
    pub const fn monitor() -> Rights {
        Rights {
            own: LoiBitmap::LOI2.raw(),
            stations: Stations::NONE,
        }
    }

    /// Only LOI 4 and 5 of these levels.
    #[must_use]
    pub const fn of_control(levels: LoiBitmap) -> Rights {
        Rights {
            own: levels.raw() & CONTROL.raw(),
            stations: Stations::NONE,
        }
    }

    /// Stations only.
    #[must_use]
    pub const fn of_stations(stations: Stations) -> Rights {
        Rights { own: 0, stations }
    }

    /// LOI 3 of these stations.
    #[must_use]
    pub const fn stations(self) -> Stations {
        self.stations
    }

    /// Its LOI 4 and 5.
    #[must_use]
    pub fn control(self) -> LoiBitmap {
        LoiBitmap::from_raw(self.own & CONTROL.raw())
    }

    /// Whether LOI 2 is held explicitly.
    #[must_use]
    pub fn monitors(self) -> bool {
        self.own & LoiBitmap::LOI2.raw() != 0
    }

    /// The levels as shown by LOI Granted (0021.07): LOI 3 with any station, and LOI 2 with any right.
    #[must_use]
    pub fn levels(self) -> LoiBitmap {
        let mut raw = self.own;
        if !self.stations.is_empty() {
            raw |= LoiBitmap::LOI3.raw();
        }
        if raw != 0 {
            raw |= LoiBitmap::LOI2.raw();
        }
        LoiBitmap::from_raw(raw)
    }

    /// Without the implied LOI 2: for a release, a wish, a log.
    #[must_use]
    pub fn levels_by_themselves(self) -> LoiBitmap {
        let loi3 = if self.stations.is_empty() {
            0
        } else {
            LoiBitmap::LOI3.raw()
        };
        LoiBitmap::from_raw(self.own | loi3)
    }

    /// Whether there are no rights.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self == Rights::NONE
    }

    /// The intersection.
    #[must_use]
    pub const fn both(self, other: Rights) -> Rights {
        Rights {
            own: self.own & other.own,
            stations: Stations(self.stations.0 & other.stations.0),
        }
    }

    /// The union.
    #[must_use]
    pub const fn with(self, other: Rights) -> Rights {
        Rights {
            own: self.own | other.own,
            stations: Stations(self.stations.0 | other.stations.0),
        }
    }

    /// The rights that are not in the other set.
    #[must_use]
    pub const fn without(self, other: Rights) -> Rights {
        Rights {
            own: self.own & !other.own,
            stations: Stations(self.stations.0 & !other.stations.0),
        }
    }

    /// Whether it contains the other set.
    #[must_use]
    pub fn contains(self, other: Rights) -> bool {
        other.without(self).is_empty()
    }

    /// Whether both contain the same single-holder right: a station, or control (LOI 4 and 5 together).
    #[must_use]
    pub fn collides(self, other: Rights) -> bool {
        !Stations(self.stations.0 & other.stations.0).is_empty()
            || (!self.control().is_empty() && !other.control().is_empty())
    }
}

impl Rights {
    /// As [`Display`](fmt::Display), but with the names of the levels, for alerts: `LOI 4, 5 (control, launch)`.
    #[must_use]
    pub fn in_words(self) -> String {
        let own = LoiBitmap::from_raw(self.own).in_words();
        match (self.own, self.stations.is_empty()) {
            (0, true) => self.to_string(),
            (0, false) => self.to_string().replacen("LOI 3", "LOI 3 (payload)", 1),
            (_, true) => format!("LOI {own}"),
            (_, false) => {
                let stations = Rights {
                    own: 0,
                    stations: self.stations,
                };
                format!("LOI {own}; {}", stations.in_words())
            }
        }
    }
}

impl fmt::Debug for Rights {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self}")
    }
}

/// `LOI 4, 5; LOI 3 of station 1`.
impl fmt::Display for Rights {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_empty() {
            return f.write_str("nothing");
        }
        let levels: Vec<&str> = [
            (LoiBitmap::LOI2, "2"),
            (LoiBitmap::LOI4, "4"),
            (LoiBitmap::LOI5, "5"),
        ]
        .into_iter()
        .filter(|(level, _)| self.own & level.raw() != 0)
        .map(|(_, name)| name)
        .collect();
        if !levels.is_empty() {
            write!(f, "LOI {}", levels.join(", "))?;
        }
        if self.stations.is_empty() {
            return Ok(());
        }
        let and = if levels.is_empty() { "" } else { "; " };
        if self.stations == Stations::ALL {
            return write!(f, "{and}LOI 3 of every station");
        }
        let numbers: Vec<String> = self.stations.iter().map(|n| n.to_string()).collect();
        write!(f, "{and}LOI 3 of station {}", numbers.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bitmaps_are_two_halves_of_one_set() {
        let stations = Stations::from_bitmaps(
            Some(StationBitmap1To16::from_raw(0x8001)),
            Some(StationBitmap17To32::from_raw(0x8001)),
        );
        assert_eq!(stations.iter().collect::<Vec<_>>(), [1, 16, 17, 32]);
        assert_eq!(
            (stations.low().raw(), stations.high().raw()),
            (0x8001, 0x8001)
        );
        assert_eq!(Stations::one(33), Stations::NONE);
    }

    #[test]
    fn loi_3_that_names_no_station_means_every_station() {
        let all = Rights::named(LoiBitmap::LOI3, Stations::NONE);
        assert_eq!(all.stations(), Stations::ALL);
        let none = Rights::named(LoiBitmap::LOI4, Stations::one(1));
        assert_eq!(none.stations(), Stations::NONE);
    }

    #[test]
    fn every_level_implies_loi_2() {
        assert_eq!(
            Rights::named(LoiBitmap::LOI5, Stations::NONE)
                .levels()
                .raw(),
            0x09
        );
        assert_eq!(Rights::of_stations(Stations::one(2)).levels().raw(), 0x03);
        assert_eq!(Rights::NONE.levels().raw(), 0);
    }

    #[test]
    fn levels_4_and_5_collide() {
        let of = |level| Rights::named(level, Stations::NONE);
        assert!(of(LoiBitmap::LOI4).collides(of(LoiBitmap::LOI5)));
        assert!(!of(LoiBitmap::LOI2).collides(of(LoiBitmap::LOI2)));
    }
}
