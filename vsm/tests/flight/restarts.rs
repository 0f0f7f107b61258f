//! The bridge is killed, or the vehicle restarts, at any moment of a flight; `docs/guide/reliability.md` holds the tables.
//!
//! `VSM_BLESS=1 cargo nextest run -p vsm --test flight restarts` writes them again;
//! `VSM_EVERY_MS=700 cargo test -p vsm --test flight restarts` takes more moments, `VSM_ALL_CASES=1` twice as many as CI.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::time::Duration;

use kit::bridge::flight::{Outcome, PHASES, fly, hold_to_page};
use kit::bridge::{Faults, Restart, Rig, Setup};

/// A flight over links that lose a twentieth, with something restarted at this moment. What the vehicle does is reported
/// once: for that the station's link is good.
fn rig(restart: Restart, at: Duration) -> Rig {
    let faults = Faults::lossy(0.05);
    let mut rig = Rig::new(Setup {
        seed: at.as_millis() as u64,
        dli: match restart {
            Restart::Bridge => faults,
            Restart::Vehicle => Faults::NONE,
        },
        mav: faults,
        ..Setup::default()
    });
    rig.restart_at = Some((at, restart));
    rig
}

/// Flies with a restart at these moments, in milliseconds, until a flight ends before it: outcomes by phase.
fn sweep(
    restart: Restart,
    from_ms: u64,
    judge: impl Fn(&mut Rig, &mut Outcome) -> Result<(), String>,
) -> BTreeMap<&'static str, Outcome> {
    let every_ms = std::env::var("VSM_EVERY_MS").ok();
    let every = kit::every(2);
    let usual = EVERY_MS * every as u64;
    let every_ms = every_ms.map_or(usual, |text| text.parse().expect("milliseconds"));
    let mut outcomes = BTreeMap::<_, Outcome>::new();
    // The upload is over soon: there every third of a second.
    let fine = (from_ms.max(10_600)..16_000).step_by(350 * every);
    let coarse = (0..).map(|step| from_ms + step * every_ms);
    for at in fine.chain(coarse).map(Duration::from_millis) {
        let mut rig = rig(restart, at);
        let mut outcome = Outcome::default();
        let judged = judge(&mut rig, &mut outcome);
        let Some(phase) = rig.restarted_in else {
            break;
        };
        assert_eq!((outcome.lost, outcome.twice), (0, 0), "{at:?}: {outcome:?}");
        assert_eq!(judged, Ok(()), "restarted at {at:?}, {phase}: {outcome:?}");
        let row = outcomes.entry(phase).or_default();
        row.flights += 1;
        row.again += outcome.again;
    }
    outcomes
}

#[test]
fn the_bridge_is_killed_at_any_moment() {
    let outcomes = sweep(Restart::Bridge, 700, fly);
    let mut table = String::from(
        "| bridge killed during | flights completed | accepted and lost | carried out twice |\n\
         |---|---|---|---|\n",
    );
    for phase in PHASES {
        writeln!(table, "| {phase} | all | 0 | 0 |").expect("a String takes all");
        assert!(outcomes.contains_key(phase), "{phase}: {outcomes:?}");
    }
    hold_to_page("bridge killed", &table);
}

#[test]
fn the_vehicle_restarts_at_any_moment() {
    // Before that no station listens to alerts.
    let outcomes = sweep(Restart::Vehicle, 10_600, |rig, outcome| {
        // What is under way ends one way or the other; how, is reported by 17000.
        let first = fly(rig, outcome);
        if rig.restarted_in.is_none() {
            return Ok(());
        }
        if !rig.until(20.0, |rig| rig.station().has_alert("has restarted")) {
            return Err(format!("no alert; the flight: {first:?}"));
        }
        fly(rig, outcome).map_err(|at| format!("{at}; the flight before: {first:?}"))
    });
    let mut table = String::from(
        "| vehicle restarted during | reported by 16000 | next flight completed | accepted and lost | carried out twice |\n\
         |---|---|---|---|---|\n",
    );
    // Control and plan are there within half a second, over a good link.
    for phase in &PHASES[1..] {
        writeln!(table, "| {phase} | always | all | 0 | 0 |").expect("a String takes all");
        assert!(outcomes[phase].flights > 0, "{phase}");
    }
    hold_to_page("vehicle restarted", &table);
}

/// Between the moments of two flights; twice that in CI, where every phase still has some.
const EVERY_MS: u64 = 4_300;
