//! Days and times of day (UTC): as texts, of findings and of entries of the access list, and as milliseconds, of records.

use std::time::Duration;

/// Milliseconds since 1970.
pub(crate) fn wall_ms(wall: Duration) -> u64 {
    u64::try_from(wall.as_millis()).unwrap_or(u64::MAX)
}

/// A day, and no time.
pub(crate) fn day(unix_s: u64) -> String {
    let days = unix_s / 86_400;
    // Days to a civil date: the years begin in March, so that a leap day is the last of its year.
    let days = days + 719_468;
    let (era, of_era) = (days / 146_097, days % 146_097);
    let year = (of_era - of_era / 1_460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let day = of_year - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    let year = year + era * 400 + u64::from(month <= 2);
    format!("{year}-{month:02}-{day:02}")
}

/// A second, as `2027-01-31T12:00:00Z`.
#[must_use]
pub(crate) fn utc(unix_s: u64) -> String {
    let of_day = unix_s % 86_400;
    let (hour, minute, second) = (of_day / 3_600, of_day / 60 % 60, of_day % 60);
    format!("{}T{hour:02}:{minute:02}:{second:02}Z", day(unix_s))
}

/// The second that [`utc`] writes so; `None` of anything else: another form, a date that no calendar has, one before 1970 or
/// after 9999.
#[must_use]
pub(crate) fn parse_utc(text: &str) -> Option<u64> {
    let (date, time) = text.strip_suffix('Z')?.split_once('T')?;
    let [year, month, day] = numbers(date, '-')?;
    let [hour, minute, second] = numbers(time, ':')?;
    if !(1970..=9999).contains(&year) || !(1..=12).contains(&month) || !(1..=31).contains(&day) {
        return None;
    }
    let (year, month) = match month {
        1 | 2 => (year - 1, month + 9),
        _ => (year, month - 3),
    };
    let days = 365 * year + year / 4 - year / 100 + year / 400 + (153 * month + 2) / 5 + day - 1;
    let of_day = hour.checked_mul(3_600)? + minute.checked_mul(60)? + second;
    let unix_s = days.checked_sub(719_468)?.checked_mul(86_400)? + of_day;
    // What is written otherwise, such as the 30th of February or 24:00, was none.
    (utc(unix_s) == text).then_some(unix_s)
}

fn numbers(text: &str, between: char) -> Option<[u64; 3]> {
    let mut parts = text.split(between).map(|part| part.parse::<u16>().ok());
    let numbers = [parts.next()??, parts.next()??, parts.next()??];
    parts.next().is_none().then(|| numbers.map(u64::from))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        assert_eq!(day(0), "1970-01-01");
        assert_eq!(day(951_782_399), "2000-02-28");
        assert_eq!(day(951_782_400), "2000-02-29");
        assert_eq!(day(1_767_225_599), "2025-12-31");
        assert_eq!(utc(1_767_225_599), "2025-12-31T23:59:59Z");
    }

    #[test]
    fn a_time_is_read_as_it_is_written_and_in_no_other_form() {
        let mut random = fastrand::Rng::with_seed(3);
        for _ in 0..2_000 {
            let unix_s = random.u64(0..253_402_300_800);
            assert_eq!(parse_utc(&utc(unix_s)), Some(unix_s));
        }
        for text in [
            "2027-02-29T00:00:00Z",
            "2027-01-31T24:00:00Z",
            "2027-1-31T00:00:00Z",
            "2027-01-31 00:00:00Z",
            "2027-01-31T00:00:00",
            "2027-01-31T00:00:00+01:00",
            "2027-00-31T00:00:00Z",
            "1969-12-31T00:00:00Z",
            "10000-01-01T00:00:00Z",
            "2027-01-31T00:00:00:00Z",
            "",
        ] {
            assert_eq!(parse_utc(text), None, "{text}");
        }
    }
}
