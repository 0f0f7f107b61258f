//! Subjects that misbehave in the worst ways: a run against each ends in time, and its verdicts name the fault.
//!
//! The subject is the scripted vehicle in a thread, or a bare socket that answers nonsense, floods, or relays.

use std::collections::BTreeSet;
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::bench::context::Bench;
use crate::bench::net::Net;
use crate::catalogue::{Catalogue, Hazard};
use crate::profile::Profile;
use crate::report::RuleReport;
use crate::runner::{Options, Run};
use crate::scripted::{Scenario, Vehicle};
use crate::verdict::Verdict;
use crate::wire::dialect::Role;
use crate::wire::{Direction, split};

/// Rules of the core: discovery, a request, an acknowledgement.
const FEW: &[&str] = &["DISC-001", "AUTH-001", "ACK-001"];

/// A subject in a thread; the thread ends when this is dropped.
struct Subject {
    address: SocketAddr,
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    /// The vehicle's own recording, where it is one.
    net: Arc<Net>,
}

impl Subject {
    /// The scripted vehicle with these events.
    fn vehicle(scenario: &str) -> Self {
        Self::of_edition("4", scenario)
    }

    fn of_edition(edition: &str, scenario: &str) -> Self {
        let net = Net::new(edition, Role::Vehicle);
        let scenario = format!("about = \"a bad subject\"\n{scenario}");
        let scenario = Scenario::parse("bad", &scenario).unwrap_or_else(|error| panic!("{error}"));
        let mut vehicle = Vehicle::new(&net, "127.0.0.1:0".parse().unwrap(), scenario).unwrap();
        let address = vehicle.local();
        let (serving, ends) = (net.clone(), Arc::new(AtomicBool::new(false)));
        let end = ends.clone();
        let thread = std::thread::spawn(move || {
            while !end.load(Ordering::SeqCst) {
                vehicle.serve(serving.now() + Duration::from_millis(50));
            }
        });
        Self {
            address,
            ends,
            thread: Some(thread),
            net,
        }
    }

    /// A socket that answers each datagram as `answer` does.
    fn socket(answer: impl Fn(&UdpSocket, SocketAddr, &[u8]) + Send + 'static) -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket
            .set_read_timeout(Some(Duration::from_millis(20)))
            .unwrap();
        let address = socket.local_addr().unwrap();
        let ends = Arc::new(AtomicBool::new(false));
        let end = ends.clone();
        let thread = std::thread::spawn(move || {
            let mut buffer = vec![0; 65_536];
            while !end.load(Ordering::SeqCst) {
                if let Ok((length, from)) = socket.recv_from(&mut buffer) {
                    answer(&socket, from, &buffer[..length]);
                }
            }
        });
        Self {
            address,
            ends,
            thread: Some(thread),
            net: Net::new("4", Role::Vehicle),
        }
    }
}

impl Drop for Subject {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::SeqCst);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The result of a run.
struct Outcome {
    rules: Vec<RuleReport>,
    remarks: String,
    took: Duration,
    bench: Arc<Bench>,
}

impl Outcome {
    fn verdict(&self, id: &str) -> (Verdict, &str) {
        let rule = self.rules.iter().find(|rule| rule.id == id);
        let rule = rule.unwrap_or_else(|| panic!("{id} is not in the report"));
        (rule.verdict, &rule.reason)
    }
}

/// Judges the subject at a tenth of the usual times; `interrupt_after` presses Ctrl-C.
fn judge(address: SocketAddr, rules: &[&str], interrupt_after: Option<Duration>) -> Outcome {
    judge_in("4", address, rules, interrupt_after)
}

fn judge_in(
    edition: &str,
    address: SocketAddr,
    rules: &[&str],
    interrupt_after: Option<Duration>,
) -> Outcome {
    let catalogue = Catalogue::embedded();
    let mut profile = Profile::default();
    profile.subject.edition = edition.to_owned();
    profile.timers.insert("factor".into(), 0.1);
    let bench = Bench::new(&catalogue, profile, address);
    let options = Options {
        rules: rules.iter().map(|&id| id.to_owned()).collect(),
        hazards: BTreeSet::from([Hazard::None, Hazard::Ground]),
        ..Options::default()
    };
    if let Some(after) = interrupt_after {
        let net = bench.net.clone();
        std::thread::spawn(move || {
            std::thread::sleep(after);
            net.interrupt();
        });
    }
    let began = Instant::now();
    let mut run = Run {
        bench: bench.clone(),
        catalogue: &catalogue,
        options: &options,
        show: &mut |_| {},
        remarks: Vec::new(),
        cast: std::collections::BTreeSet::new(),
    };
    let rules = run.rules();
    Outcome {
        rules,
        remarks: run.remarks.join("\n"),
        took: began.elapsed(),
        bench,
    }
}

#[test]
fn a_lawful_vehicle_passes() {
    let subject = Subject::vehicle("");
    let outcome = judge(subject.address, FEW, None);
    for id in FEW {
        assert_eq!(
            outcome.verdict(id).0,
            Verdict::Pass,
            "{id} {}",
            outcome.verdict(id).1
        );
    }
    assert_eq!(outcome.remarks, "");
}

/// Discovery, rights, acknowledgements and the wrapper of Edition 2.5.
const FEW_25: &[&str] = &["DISC-001", "AUTH-001", "ACK-004", "WRAP-002", "WRAP-006"];

#[test]
fn a_vehicle_of_edition_2_5_passes_and_its_faults_do_not() {
    let lawful = Subject::of_edition("2.5", "");
    let outcome = judge_in("2.5", lawful.address, FEW_25, None);
    for id in FEW_25 {
        let (verdict, reason) = outcome.verdict(id);
        assert_eq!(verdict, Verdict::Pass, "{id} {reason}");
    }
    // Edition 2.5 has no message for these rules, so nothing is sent for them, and they must not pass.
    let outcome = judge_in("2.5", lawful.address, &["ACK-001", "CURVE-005"], None);
    for id in ["ACK-001", "CURVE-005"] {
        assert_eq!(outcome.verdict(id).0, Verdict::NotApplicable, "{id}");
    }
    let faults = [
        (
            "[[lose]]\nmessage = 1\ntimes = 3000",
            "DISC-001",
            Verdict::Inconclusive,
        ),
        (
            "[[lose]]\nmessage = 2017\ntimes = 30",
            "ACK-004",
            Verdict::Fail,
        ),
        ("[authority]\ndamaged = true", "WRAP-006", Verdict::Fail),
        (
            "[authority]\nauthorised = [2]",
            "AUTH-001",
            Verdict::NotApplicable,
        ),
        // A vehicle of Edition 4 must not pass as one of Edition 2.5.
        (
            "[[event]]\nafter = \"control\"\naction = \"datagram\"\nlength = 40",
            "WRAP-002",
            Verdict::Fail,
        ),
    ];
    for (scenario, id, expected) in faults {
        let subject = Subject::of_edition("2.5", scenario);
        let outcome = judge_in("2.5", subject.address, &[id], None);
        let (verdict, reason) = outcome.verdict(id);
        assert_eq!(verdict, expected, "{id} {reason} {scenario}");
    }
}

#[test]
fn no_answer_at_all_ends_the_full_set_soon() {
    let nobody = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = nobody.local_addr().unwrap();
    drop(nobody);
    let outcome = judge(address, &[], None);
    let unjudged = |rule: &RuleReport| !rule.verdict.is_fail() && rule.verdict != Verdict::Pass;
    assert!(outcome.rules.iter().all(unjudged));
    assert!(outcome.rules.len() > 150, "{}", outcome.rules.len());
    assert!(
        outcome.remarks.contains("nothing answered"),
        "{}",
        outcome.remarks
    );
    // At the usual times ten of these seconds: under a minute.
    assert!(outcome.took < Duration::from_secs(5), "{:?}", outcome.took);
}

#[test]
fn garbage_is_no_answer_and_is_named() {
    let subject = Subject::socket(|socket, from, _| {
        let _ = socket.send_to(&[0x5A; 40], from);
    });
    let outcome = judge(subject.address, &["DISC-001", "WRAP-001"], None);
    assert_eq!(outcome.verdict("WRAP-001").0, Verdict::Fail);
    assert_eq!(outcome.verdict("DISC-001").0, Verdict::Inconclusive);
    assert!(
        outcome.remarks.contains("none was an answer"),
        "{}",
        outcome.remarks
    );
}

#[test]
fn the_largest_datagram_is_a_fail_of_its_rule_and_of_no_other() {
    let subject =
        Subject::vehicle("[[event]]\nafter = \"control\"\naction = \"datagram\"\nlength = 65507\n");
    let outcome = judge(subject.address, &["DISC-001", "WRAP-004"], None);
    let (verdict, reason) = outcome.verdict("WRAP-004");
    assert_eq!(verdict, Verdict::Fail);
    assert!(reason.contains("65507"), "{reason}");
    assert_eq!(outcome.verdict("DISC-001").0, Verdict::Pass);
}

#[test]
fn a_flood_fails_nothing_and_is_named() {
    let subject = Subject::socket(|socket, from, _| {
        for _ in 0..15_000 {
            let _ = socket.send_to(&[0; 20], from);
        }
    });
    let outcome = judge(subject.address, &["DISC-001"], None);
    assert_eq!(outcome.verdict("DISC-001").0, Verdict::Inconclusive);
    assert!(outcome.took < Duration::from_secs(20), "{:?}", outcome.took);
}

#[test]
fn answers_from_another_port_are_judged_and_remarked() {
    let relay = UdpSocket::bind("127.0.0.1:0").unwrap();
    let vehicle = Subject::vehicle("");
    let behind = vehicle.address;
    let subject = Subject::socket(move |_, from, bytes| {
        let _ = relay.send_to(bytes, behind);
        let _ = relay.set_read_timeout(Some(Duration::from_millis(5)));
        let mut buffer = [0; 2_048];
        while let Ok(length) = relay.recv(&mut buffer) {
            let _ = relay.send_to(&buffer[..length], from);
        }
    });
    let outcome = judge(subject.address, &["DISC-001"], None);
    assert_eq!(outcome.verdict("DISC-001").0, Verdict::Pass);
    assert!(
        outcome.remarks.contains("behind a firewall or NAT"),
        "{}",
        outcome.remarks
    );
}

#[test]
fn a_subject_that_dies_makes_the_rest_inconclusive() {
    let subject = Subject::vehicle(
        "[[event]]\nafter = \"command\"\naction = \"silence\"\nlasts_s = 3600.0\n",
    );
    let outcome = judge(
        subject.address,
        &["DISC-001", "ACK-001", "ACK-002", "ACK-005"],
        None,
    );
    let (verdict, reason) = outcome.verdict("DISC-001");
    assert_eq!(verdict, Verdict::Inconclusive, "{reason}");
    assert!(
        reason.contains("answered no discovery since ACK-001"),
        "{reason}"
    );
    assert!(outcome.took < Duration::from_secs(20), "{:?}", outcome.took);
}

#[test]
fn a_subject_that_restarts_is_judged_on() {
    let subject = Subject::vehicle(
        "[[event]]\nafter = \"control\"\nseconds = 2.5\naction = \"restart\"\nlasts_s = 0.3\n",
    );
    let outcome = judge(subject.address, FEW, None);
    let fails: Vec<_> = outcome
        .rules
        .iter()
        .filter(|rule| rule.verdict == Verdict::Fail)
        .map(|rule| &rule.reason)
        .collect();
    assert!(fails.is_empty(), "{fails:?}");
    // A late acknowledgement is a warning, and a busy machine may be late.
    let (verdict, reason) = outcome.verdict("ACK-001");
    let judged = matches!(verdict, Verdict::Pass | Verdict::Warning);
    assert!(judged, "{verdict:?} {reason}");
}

#[test]
fn a_rule_that_spans_a_restart_is_judged_again() {
    // It restarts once for each CUCS, when that has control for the first time: for the second one in the middle of
    // AUTH-005, whose next request then goes unanswered.
    let subject =
        Subject::vehicle("[[event]]\nafter = \"control\"\naction = \"restart\"\nlasts_s = 0.9\n");
    let outcome = judge(subject.address, &["AUTH-005"], None);
    let (verdict, reason) = outcome.verdict("AUTH-005");
    assert_eq!(verdict, Verdict::Pass, "{reason}");
    assert!(
        outcome.remarks.contains("during AUTH-005, as in a restart"),
        "{}",
        outcome.remarks
    );
}

#[test]
fn another_cucs_that_takes_control_ends_the_run() {
    // Control is lost for good shortly after a command, though no station of the suite requested it.
    let subject =
        Subject::vehicle("[[event]]\nafter = \"command\"\nseconds = 0.12\naction = \"revoke\"\n");
    let outcome = judge(subject.address, &["ACK-002", "ACK-001", "SCALAR-007"], None);
    let all: Vec<_> = outcome
        .rules
        .iter()
        .map(|r| (&r.id, r.verdict, &r.reason))
        .collect();
    assert!(
        outcome.remarks.contains("another CUCS has taken control"),
        "{all:?} {}",
        outcome.remarks
    );
    assert!(
        !outcome.rules.iter().any(|rule| rule.verdict.is_fail()),
        "{all:?}"
    );
    assert!(
        outcome
            .rules
            .iter()
            .any(|rule| rule.reason.contains("another CUCS has taken control")),
        "{all:?}"
    );
}

#[test]
fn ctrl_c_releases_control() {
    let subject = Subject::vehicle("");
    let outcome = judge(subject.address, &[], Some(Duration::from_secs(3)));
    assert!(outcome.took < Duration::from_secs(6), "{:?}", outcome.took);
    let interrupted = |rule: &RuleReport| rule.reason.contains("interrupted");
    assert!(outcome.rules.iter().any(interrupted));
    std::thread::sleep(Duration::from_millis(100));
    let recording = subject.net.recording();
    let last = |direction: Direction| {
        let mut all = recording.datagrams.iter().rev();
        let found = all.find(|datagram| {
            datagram.direction == direction
                && split(&datagram.bytes)
                    .0
                    .iter()
                    .any(|piece| piece.message_type <= 2)
        });
        found.and_then(|datagram| {
            datagram
                .messages
                .iter()
                .find(|seen| seen.kind() <= 2)
                .cloned()
        })
    };
    let request = last(Direction::Received).expect("the suite sent a message 1");
    assert_eq!(
        request.raw("Requested/Handover Access"),
        Some(0),
        "the last is a release"
    );
    let answer = last(Direction::Sent).expect("it was answered");
    assert_eq!(answer.raw("LOI Granted"), Some(0), "nothing is held");
    assert!(outcome.bench.net.interrupted());
}
