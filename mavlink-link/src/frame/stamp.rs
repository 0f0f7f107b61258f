//! The timestamp of a signature, and the unit of the signing clock.
//!
//! Units of 10 us since 2015-01-01 00:00 UTC, not Unix time: the wrong epoch or unit is pitfall 10.

use core::time::Duration;

/// A signing timestamp: 48 bits, units of 10 us since 2015-01-01 00:00 UTC.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Stamp(u64);

impl Stamp {
    /// The first stamp.
    pub const ZERO: Self = Self(0);
    /// The last stamp, in the year 2104.
    pub const MAX: Self = Self((1 << 48) - 1);

    /// A stamp of so many units of 10 us, at most [`Stamp::MAX`].
    #[must_use]
    pub const fn new(units: u64) -> Self {
        if units > Self::MAX.0 {
            Self::MAX
        } else {
            Self(units)
        }
    }

    /// Units of 10 us.
    #[must_use]
    pub const fn get(self) -> u64 {
        self.0
    }

    /// The stamp of a time since 1970; [`Stamp::ZERO`] before 2015, [`Stamp::MAX`] after 2104.
    #[must_use]
    pub const fn from_unix(since_1970: Duration) -> Self {
        Self::ZERO.plus(since_1970.saturating_sub(EPOCH))
    }

    /// The time since 1970 that the stamp stands for.
    #[must_use]
    pub const fn to_unix(self) -> Duration {
        EPOCH.saturating_add(Duration::from_micros(self.0 * UNIT_US))
    }

    /// Later by `span`, rounded down to whole units, at most [`Stamp::MAX`].
    #[must_use]
    pub const fn plus(self, span: Duration) -> Self {
        let units = span.as_micros() / UNIT_US as u128;
        if units > Self::MAX.0 as u128 {
            Self::MAX
        } else {
            Self::new(self.0 + units as u64)
        }
    }

    /// The next stamp; `None` after the last.
    #[must_use]
    pub const fn next(self) -> Option<Self> {
        if self.0 < Self::MAX.0 {
            Some(Self(self.0 + 1))
        } else {
            None
        }
    }

    /// The time from `earlier` to `self`, zero where it is not earlier.
    #[must_use]
    pub const fn since(self, earlier: Self) -> Duration {
        Duration::from_micros(self.0.saturating_sub(earlier.0) * UNIT_US)
    }

    /// As in the trailer: 6 bytes, little-endian.
    #[must_use]
    pub const fn to_le_bytes(self) -> [u8; 6] {
        let [a, b, c, d, e, f, _, _] = self.0.to_le_bytes();
        [a, b, c, d, e, f]
    }

    /// From the trailer: 6 bytes, little-endian.
    #[must_use]
    pub const fn from_le_bytes(bytes: [u8; 6]) -> Self {
        let [a, b, c, d, e, f] = bytes;
        Self(u64::from_le_bytes([a, b, c, d, e, f, 0, 0]))
    }
}

/// 2015-01-01 00:00 UTC since 1970.
const EPOCH: Duration = Duration::from_secs(1_420_070_400);
const UNIT_US: u64 = 10;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_epoch_is_2015_and_the_unit_ten_microseconds() {
        // 2015-01-01 and one second, and a time of day in 2026 (date -u -d @1795246260).
        assert_eq!(
            Stamp::from_unix(Duration::from_secs(1_420_070_401)),
            Stamp::new(100_000)
        );
        assert_eq!(
            Stamp::from_unix(Duration::from_secs(1_795_246_260)).get(),
            37_517_586_000_000
        );
        assert_eq!(Stamp::from_unix(Duration::from_secs(0)), Stamp::ZERO);
        assert_eq!(Stamp::from_unix(Duration::MAX), Stamp::MAX);
    }

    #[test]
    fn the_wire_form_is_little_endian() {
        let stamp = Stamp::new(0x0605_0403_0201);
        assert_eq!(stamp.to_le_bytes(), [1, 2, 3, 4, 5, 6]);
        assert_eq!(Stamp::from_le_bytes([1, 2, 3, 4, 5, 6]), stamp);
        assert_eq!(Stamp::MAX.next(), None);
        assert_eq!(Stamp::new(u64::MAX), Stamp::MAX);
    }
}
