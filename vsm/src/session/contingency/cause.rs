//! Whether a cause of a contingency is active, by reports that confirm each other.
//!
//! One bad report must not send an aircraft home, and one good report must not end a contingency: [`CONFIRMED`] reports in
//! a row are needed for either, over [`LASTS`] or [`CLEAR_AFTER`]. A value between two thresholds is no reason for a change
//! ([`What::Between`]): a battery recovers a little whenever its load decreases.

use std::time::Duration;

/// One cause.
#[derive(Debug, Default)]
pub(crate) struct Watch {
    /// Whether it is active.
    pub(crate) stands: bool,
    /// The number of the last report.
    number: Option<u32>,
    /// The latest reports that agree.
    run: Option<Run>,
}

#[derive(Debug, Clone, Copy)]
struct Run {
    present: bool,
    since: Duration,
    reports: u32,
}

/// The content of a report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Seen {
    /// The number of the report.
    pub(crate) number: u32,
    pub(crate) what: What,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum What {
    Present,
    Between,
    Absent,
}

impl Watch {
    /// The bridge did not run for so long.
    pub(crate) fn note_stop(&mut self, stopped: Duration) {
        if let Some(run) = &mut self.run {
            run.since += stopped;
        }
    }

    /// Takes the latest report. Returns true if the cause has been gone for long enough.
    pub(crate) fn look(&mut self, now: Duration, seen: Seen) -> bool {
        if self.number == Some(seen.number) {
            return false;
        }
        self.number = Some(seen.number);
        let present = match seen.what {
            What::Present => true,
            What::Between => self.stands,
            What::Absent => false,
        };
        let begun = Run {
            present,
            since: now,
            reports: 0,
        };
        let run = self.run.filter(|run| run.present == present);
        let mut run = run.unwrap_or(begun);
        run.reports = run.reports.saturating_add(1);
        self.run = Some(run);
        let lasted = now.saturating_sub(run.since);
        let confirmed = |span| run.reports >= CONFIRMED && lasted >= span;
        match present {
            true => {
                self.stands |= confirmed(LASTS);
                false
            }
            false if confirmed(CLEAR_AFTER) => {
                self.stands = false;
                true
            }
            false => false,
        }
    }
}

/// Number of agreeing reports in a row.
const CONFIRMED: u32 = 3;
/// How long a cause must last.
const LASTS: Duration = Duration::from_millis(1_500);
/// How long it must be gone before it is cleared.
const CLEAR_AFTER: Duration = Duration::from_secs(10);

#[cfg(test)]
mod tests {
    use super::*;

    /// Reports, one a second: `p`resent, `a`bsent, `b`etween, `.` lost, `s` begun again after a silence. What stands after each.
    fn stands_after(reports: &str) -> String {
        let mut watch = Watch::default();
        let mut seen = Seen {
            number: 0,
            what: What::Absent,
        };
        let mut after = |(second, letter): (usize, char)| {
            seen.number += u32::from(letter != '.');
            seen.what = match letter {
                'p' => What::Present,
                'b' => What::Between,
                'a' => What::Absent,
                's' => {
                    watch = Watch::default();
                    return '-';
                }
                _ => seen.what,
            };
            let now = Duration::from_secs(second as u64);
            if watch.look(now, seen) {
                'G'
            } else if watch.stands {
                'S'
            } else {
                '-'
            }
        };
        reports.chars().enumerate().map(&mut after).collect()
    }

    /// A bad report before the stop, and the next two, which waited in a socket, at once after it.
    #[test]
    fn a_cause_has_not_lasted_while_the_bridge_did_not_run() {
        let mut watch = Watch::default();
        let mut look = |at: Duration, number, stopped| {
            let what = What::Present;
            watch.note_stop(stopped);
            watch.look(at, Seen { number, what });
            watch.stands
        };
        let (stopped, ms) = (Duration::from_secs(60), Duration::from_millis);
        assert!(!look(ms(0), 0, ms(0)));
        assert!(!look(stopped, 1, stopped));
        assert!(!look(stopped + ms(20), 2, ms(0)));
        assert!(look(stopped + LASTS, 3, ms(0)));
    }

    #[test]
    fn single_reports_lead_to_nothing_and_end_nothing() {
        assert_eq!(stands_after("apapppp"), "-----SS");
        // One bad report that no further one follows, and one beside a silence.
        assert_eq!(stands_after("ap......"), "--------");
        assert_eq!(stands_after("ppspps"), "------");
        assert_eq!(stands_after("bbbbb"), "-----");
        assert_eq!(stands_after("pppapaap"), "--SSSSSS");
        assert_eq!(stands_after("pppbbbbbbbbbbbbb"), "--SSSSSSSSSSSSSS");
        assert_eq!(stands_after("pppaaaaaaaaaaaappp"), "--SSSSSSSSSSSGG--S");
        assert_eq!(stands_after("ppp..........aapa"), "--SSSSSSSSSSSSSSS");
    }
}
