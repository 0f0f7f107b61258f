//! Measuring programs beside each other: turns in random order, medians with their spread, what a process takes.
//!
//! What a machine does besides falls on whoever runs at that moment. So each subject is measured several times, in turns,
//! each turn in another order, and a ratio is taken within a turn. A figure is never given without its spread.
//!
//! ```
//! use kit::Random;
//! use kit::measure::{Spread, in_turns};
//!
//! let mut subjects = [10.0, 20.0];
//! let values = in_turns(5, &mut Random::with_seed(7), &mut subjects, |subject| *subject);
//! let ratio = Spread::of_ratios(&values[0], &values[1]);
//! assert_eq!(format!("{ratio:.2}"), "0.50 (0.50 to 0.50)");
//! ```

use std::fmt;
use std::fs;
use std::time::{Duration, Instant};

use crate::Random;

/// What follows this option of a bench.
pub fn given(option: &str) -> Option<String> {
    let mut arguments = std::env::args().skip_while(|argument| argument != option);
    arguments.nth(1)
}

/// Measures each subject once in each turn, in an order drawn for that turn: for each subject its values, turn by turn.
pub fn in_turns<S, V>(
    turns: usize,
    random: &mut Random,
    subjects: &mut [S],
    mut measure: impl FnMut(&mut S) -> V,
) -> Vec<Vec<V>> {
    let mut values: Vec<Vec<V>> = subjects.iter().map(|_| Vec::new()).collect();
    let mut order: Vec<usize> = (0..subjects.len()).collect();
    for _ in 0..turns {
        random.shuffle(&mut order);
        for &at in &order {
            values[at].push(measure(&mut subjects[at]));
        }
    }
    values
}

/// A median, and how far the values are spread.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// The middle one; of an even number the upper of the two.
    pub median: f64,
    /// The least.
    pub min: f64,
    /// The greatest.
    pub max: f64,
}

impl Spread {
    /// Of at least one value.
    pub fn of(values: &[f64]) -> Spread {
        let mut sorted = values.to_vec();
        Spread {
            median: quantile(&mut sorted, 0.5),
            min: sorted[0],
            max: sorted[sorted.len() - 1],
        }
    }

    /// Of the ratios of two subjects, turn by turn.
    pub fn of_ratios(of: &[f64], to: &[f64]) -> Spread {
        let ratios: Vec<f64> = of.iter().zip(to).map(|(of, to)| of / to).collect();
        Spread::of(&ratios)
    }

    /// The line by which a bench hands a figure to `cargo xtask bench`, which knows the goal of that name.
    pub fn figure(&self, name: &str) -> String {
        let Spread { median, min, max } = self;
        format!("figure {name} {median:.4} {min:.4} {max:.4}")
    }
}

/// `12.3 (11.9 to 14.0)`, with the precision that is asked for.
impl fmt::Display for Spread {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let digits = f.precision().unwrap_or(1);
        let Spread { median, min, max } = self;
        write!(f, "{median:.digits$} ({min:.digits$} to {max:.digits$})")
    }
}

/// The value below which this part of the values lies; sorts them.
pub fn quantile(values: &mut [f64], part: f64) -> f64 {
    assert!(!values.is_empty(), "nothing was measured");
    values.sort_by(f64::total_cmp);
    let at = (values.len() as f64 * part) as usize;
    values[at.min(values.len() - 1)]
}

/// Waits until an event of this number is due, of so many a second since `begun`.
///
/// It sleeps while that is long enough, and spins for the rest: a sleep ends some 50 us late, which at 20,000 a second would
/// make bursts of an even stream.
pub fn pace(begun: Instant, number: u32, rate: u32) {
    let due = begun + Duration::from_secs_f64(f64::from(number) / f64::from(rate));
    let left = due.saturating_duration_since(Instant::now());
    if left > SLEEPS_LATE {
        std::thread::sleep(left - SLEEPS_LATE);
    }
    while Instant::now() < due {
        std::hint::spin_loop();
    }
}

/// Processor time of this thread: what else the machine does is not in it.
pub fn thread_time() -> Duration {
    let at = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Duration::try_from(at).unwrap_or_default()
}

/// Processor time of all threads of a process. By the scheduler's own account, in ns: `/proc/PID/stat` has it in ticks of 10 ms,
/// which is more than a bridge at 100 messages a second takes in a second.
pub fn cpu_time(process: u32) -> Duration {
    let ns = of_tasks(process, "schedstat", |text| {
        text.split(' ').next()?.parse().ok()
    });
    Duration::from_nanos(ns)
}

/// How long threads of a process that could run have waited for a core, all together.
pub fn waited_for_a_core(process: u32) -> Duration {
    let ns = of_tasks(process, "schedstat", |text| {
        text.split(' ').nth(1)?.parse().ok()
    });
    Duration::from_nanos(ns)
}

/// How often threads of a process have waited for something, and so were woken afterwards.
pub fn wakeups(process: u32) -> u64 {
    of_tasks(process, "status", |text| {
        let line = |line: &str| {
            let count = line.strip_prefix("voluntary_ctxt_switches:")?;
            count.trim().parse().ok()
        };
        text.lines().find_map(line)
    })
}

/// The sum over a process's threads of what a file of each says.
fn of_tasks(process: u32, file: &str, read: impl Fn(&str) -> Option<u64>) -> u64 {
    let tasks = fs::read_dir(format!("/proc/{process}/task"));
    let tasks = tasks.unwrap_or_else(|error| panic!("the threads of process {process}: {error}"));
    let of = |task: fs::DirEntry| {
        // A thread may end meanwhile.
        let text = fs::read_to_string(task.path().join(file)).ok()?;
        Some(read(&text).unwrap_or_else(|| panic!("{file} of a thread: {text:?}")))
    };
    tasks.flatten().filter_map(of).sum()
}

/// Resident memory of a process, kB.
pub fn memory_kb(process: u32) -> f64 {
    of_status(process, "VmRSS:")
}

/// Of it what is the process's own, without pages of its files; kB.
pub fn own_memory_kb(process: u32) -> f64 {
    of_status(process, "RssAnon:")
}

fn of_status(process: u32, name: &str) -> f64 {
    let status = fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix(name));
    let number = line.and_then(|rest| rest.split_whitespace().next());
    number.and_then(|kb| kb.parse().ok()).unwrap_or(f64::NAN)
}

/// By how much a sleep ends late at most, on a machine that has a core for it.
const SLEEPS_LATE: Duration = Duration::from_micros(150);

#[cfg(test)]
mod tests {
    use std::process::{Command, Stdio};

    use super::*;
    use crate::process::KillOnDrop;

    #[test]
    fn each_subject_is_measured_once_in_each_turn_and_in_changing_order() {
        let (mut order, mut subjects) = (Vec::new(), [0, 1, 2]);
        let mut random = Random::with_seed(7);
        let values = in_turns(20, &mut random, &mut subjects, |subject| {
            order.push(*subject);
            *subject
        });
        for (at, values) in values.iter().enumerate() {
            assert_eq!(values, &[at; 20]);
        }
        let first: Vec<&[usize]> = order.chunks(3).collect();
        assert!(first.iter().any(|turn| *turn != first[0]), "{order:?}");
    }

    #[test]
    fn a_spread_is_printed_as_the_table_has_it_and_as_xtask_reads_it() {
        let spread = Spread::of(&[3.0, 1.0, 2.0]);
        assert_eq!(format!("{spread:.1}"), "2.0 (1.0 to 3.0)");
        assert_eq!(
            spread.figure("a-name"),
            "figure a-name 2.0000 1.0000 3.0000"
        );
        let ratio = Spread::of_ratios(&[1.0, 4.0, 9.0], &[1.0, 2.0, 3.0]);
        assert_eq!((ratio.median, ratio.min, ratio.max), (2.0, 1.0, 3.0));
    }

    #[test]
    fn what_a_process_takes_is_counted() {
        // It works, then waits for a line that never comes.
        let work = "i=0; while [ $i -lt 200000 ]; do i=$((i+1)); done; read x";
        let mut command = Command::new("sh");
        command.args(["-c", work]).stdin(Stdio::piped());
        let child = KillOnDrop(command.spawn().expect("a shell"));
        let (process, begun) = (child.0.id(), Instant::now());
        while cpu_time(process) < Duration::from_millis(20) || wakeups(process) == 0 {
            let (cpu, woken) = (cpu_time(process), wakeups(process));
            assert!(begun.elapsed().as_secs() < 30, "{cpu:?}, {woken} wake-ups");
            std::thread::sleep(Duration::from_millis(10));
        }
        assert!(memory_kb(process) > 100.0);
    }

    #[test]
    fn the_time_of_a_thread_that_sleeps_stands() {
        let before = thread_time();
        std::thread::sleep(Duration::from_millis(50));
        let slept = thread_time() - before;
        assert!(slept < Duration::from_millis(40), "{slept:?}");
        while thread_time() - before < slept + Duration::from_millis(5) {}
    }

    #[test]
    fn a_pace_is_kept() {
        let begun = Instant::now();
        for number in 0..=20 {
            pace(begun, number, 1_000);
        }
        assert!(begun.elapsed() >= Duration::from_millis(20));
    }
}
