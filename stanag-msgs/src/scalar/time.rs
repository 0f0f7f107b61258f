//! The time stamp of Editions 3 and 4.

use super::Field;
use crate::codec::{Fault, Reader, Writer};
use crate::scalar::U40;
use crate::table::Wire;

/// Milliseconds since 2000-01-01 00:00 UTC in five bytes; rolls over on 2034-11-03.
///
/// The stamp says when the data was valid. Leap seconds are not counted, as in Unix time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TimeStamp(pub u64);

impl TimeStamp {
    /// 2000-01-01 00:00 UTC in milliseconds of Unix time.
    pub const EPOCH_UNIX_MS: u64 = 946_684_800_000;
    /// How many stamps there are before the count rolls over: 2^40.
    pub const PERIOD_MS: u64 = 1 << 40;
    /// The unit, as the message table names it.
    pub const UNIT: &'static str = "ms since 2000-01-01T00:00:00Z";

    /// The stamp of a Unix time in milliseconds. A time before 2000 gives 0; one past the roll
    /// over gives what a counter of 40 bits shows then.
    pub const fn from_unix_ms(unix_ms: u64) -> Self {
        Self(unix_ms.saturating_sub(Self::EPOCH_UNIX_MS) % Self::PERIOD_MS)
    }

    /// The Unix time in milliseconds, of the first period.
    pub const fn unix_ms(self) -> u64 {
        self.0.saturating_add(Self::EPOCH_UNIX_MS)
    }
}

/// Only the low 40 bits are written.
impl Field for TimeStamp {
    const WIRE: Wire = Wire::U40;
    const UNIT: Option<&'static str> = Some(TimeStamp::UNIT);

    #[inline]
    fn read(reader: &mut Reader<'_>) -> Result<Self, Fault> {
        U40::read(reader).map(|raw| Self(raw.get()))
    }

    #[inline]
    fn write(self, writer: &mut Writer<'_>) -> Result<(), Fault> {
        let [_, _, _, a, b, c, d, e] = self.0.to_be_bytes();
        writer.put([a, b, c, d, e])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_epoch_is_zero() {
        assert_eq!(
            TimeStamp::from_unix_ms(TimeStamp::EPOCH_UNIX_MS),
            TimeStamp(0)
        );
        assert_eq!(TimeStamp::from_unix_ms(0), TimeStamp(0));
        assert_eq!(
            TimeStamp::from_unix_ms(1_700_000_000_123).unix_ms(),
            1_700_000_000_123
        );
    }

    #[test]
    fn the_count_rolls_over_in_2034() {
        let last = TimeStamp(TimeStamp::PERIOD_MS - 1);
        assert_eq!(last.unix_ms(), 2_046_196_427_775);
        assert_eq!(TimeStamp::from_unix_ms(last.unix_ms() + 1), TimeStamp(0));
    }
}
