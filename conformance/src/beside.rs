//! A rule that mostly waits, played at the same time as others: in its own thread, with its own ids.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::thread::JoinHandle;

use stanag_msgs::Id;

use crate::bench::context::Bench;
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Verdict};
use crate::wire::{Direction, Seen};

/// The rule that waits longest. Rules that need no control and play a single id run at the same time.
pub(crate) const PATIENT: &str = "AUTH-004";
pub(crate) const COMPANIONS: &[&str] = &[
    "ACK-005", "CONF-002", "CONF-003", "CONF-006", "CONF-007", "HB-001", "PV-005", "STAT-001",
    "STAT-003", "STAT-004", "STAT-006", "STAT-009", "STAT-016", "WRAP-003", "WRAP-004", "WRAP-007",
    "WRAP-008",
];

/// A rule that is played beside others.
pub(crate) struct Beside {
    pub(crate) rule: String,
    /// The ids that are left for the others.
    pub(crate) others: BTreeSet<Id>,
    pub(crate) thread: JoinHandle<Waited>,
}

/// What became of it.
pub(crate) struct Waited {
    pub(crate) passed: bool,
    pub(crate) datagrams: (usize, usize),
    pub(crate) evidence: Vec<serde_json::Value>,
    pub(crate) duration_s: f64,
}

/// Plays a scene with these ids only.
pub(crate) fn begin(
    bench: Arc<Bench>,
    play: fn(&Trial) -> Judged,
    cast: BTreeSet<Id>,
) -> JoinHandle<Waited> {
    std::thread::spawn(move || {
        let began = bench.net.now();
        let trial = Trial::with_cast(&bench, cast);
        let judgement = trial.judge(|| play(&trial));
        let end = bench.net.mark();
        let cleaned = trial.clean_up().is_ok();
        Waited {
            passed: judgement.verdict == Verdict::Pass && cleaned,
            datagrams: (trial.mark, end),
            evidence: evidence(&bench, &trial, end, true),
            duration_s: (bench.net.now() - began).as_secs_f64(),
        }
    })
}

/// Messages of evidence.
const MAX_EVIDENCE: usize = 40;

/// What the scene cited, and its last messages that are not periodic status.
pub(crate) fn evidence(
    bench: &Bench,
    trial: &Trial,
    end: usize,
    passed: bool,
) -> Vec<serde_json::Value> {
    let recording = bench.net.recording();
    let end = end.min(recording.datagrams.len());
    let wanted = if passed {
        MAX_EVIDENCE / 4
    } else {
        MAX_EVIDENCE
    };
    let messages: Vec<Arc<Seen>> = recording.datagrams[trial.mark.min(end)..end]
        .iter()
        .flat_map(|datagram| &datagram.messages)
        .filter(|seen| {
            !(seen.direction == Direction::Received
                && matches!(seen.kind(), 3001 | 3002 | 4000 | 4001))
        })
        .cloned()
        .collect();
    drop(recording);
    let mut chosen = trial.evidence(messages, wanted, |seen| seen.at);
    // One message of Edition 2.5 may have several counterparts: it is shown once.
    let shown = |seen: &Arc<Seen>| Arc::as_ptr(seen.original.as_ref().unwrap_or(seen));
    chosen.dedup_by(|a, b| shown(a) == shown(b));
    chosen.iter().map(|seen| seen.evidence()).collect()
}
