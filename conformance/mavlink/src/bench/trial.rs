//! What outlives a scene ([`Bench`]), and what a scene is given ([`Trial`]): the peer that it plays, probes, and a
//! place for its remarks.

use std::collections::BTreeSet;
use std::ops::Deref;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use conformance::bench::remarks::Remarks;
use conformance::catalogue::Hazard;
use conformance::verdict::{Judged, Stop};

use super::net::{Net, Port, Seen};
use super::peer::Peer;
use crate::wire::Draft;

/// What the run was given, and what the survey found.
#[derive(Debug)]
pub struct Bench {
    /// Sockets and recording.
    pub net: Arc<Net>,
    /// The link that is judged.
    pub port: Arc<Port>,
    /// A second link of the same subject.
    pub second: Option<Arc<Port>>,
    /// The subject: system and component.
    pub subject: (u8, u8),
    /// MAV_AUTOPILOT of its heartbeat; 12 is PX4, 3 ArduPilot.
    pub autopilot: i64,
    /// A request that it answers.
    pub probe: Probe,
    /// The suite's own station.
    pub identity: (u8, u8),
    /// Multiplies all times of the suite.
    pub factor: f64,
    /// The hazards that are released.
    pub hazards: BTreeSet<Hazard>,
    /// Whether SETUP_SIGNING may be sent.
    pub setup_signing: bool,
    /// Whether a SYSTEM_TIME of another year may be sent. PX4 in SITL, where it may set the clock of its computer,
    /// does so by this message.
    pub system_time: bool,
    /// Restarts the subject.
    pub restart: Option<String>,
    /// Files of the subject in which no key may be found: logs, recordings.
    pub logs: Vec<PathBuf>,
    /// Pass phrase from which the key was made.
    pub phrase: Option<String>,
    /// The parameter that may be changed and is restored.
    pub parameter: Option<String>,
    /// Whether the station's heartbeats are paused.
    pub paused: Arc<AtomicBool>,
}

/// A request without effect that the subject answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Probe {
    /// TIMESYNC, whose answer repeats a number of ours.
    Timesync,
    /// PING, whose answer repeats it too.
    Ping,
    /// COMMAND_LONG with REQUEST_MESSAGE for HEARTBEAT; its answers carry no number.
    Command,
}

impl Probe {
    /// A probe with this number.
    #[must_use]
    pub fn draft(self, number: u32, subject: (u8, u8)) -> Draft {
        match self {
            Self::Timesync => Draft::new("TIMESYNC").bits("ts1", u64::from(number) * 1_000),
            Self::Ping => Draft::new("PING")
                .set("seq", number)
                .set("time_usec", number),
            Self::Command => Draft::new("COMMAND_LONG")
                .to(subject)
                .set("command", 512)
                .set("param1", 148),
        }
    }

    /// Whether this frame answers it.
    #[must_use]
    pub fn is_answer(self, number: u32, seen: &Seen) -> bool {
        let frame = &seen.frame;
        match self {
            Self::Timesync => {
                frame.is("TIMESYNC")
                    && frame.int("tc1") != 0
                    && frame.int("ts1") == i64::from(number) * 1_000
            }
            Self::Ping => {
                frame.is("PING")
                    && frame.int("target_system") != 0
                    && frame.int("seq") == i64::from(number)
            }
            Self::Command => frame.is("COMMAND_ACK") && frame.int("command") == 512,
        }
    }
}

/// How long an answer may take.
const ANSWER: Duration = Duration::from_millis(1_000);
/// How long to watch before "no answer" is judged. PX4 answers within 20 ms; a late answer of a slower subject shows
/// when the answers to the next probes are counted.
const QUIET: Duration = Duration::from_millis(350);

/// The trial of a subject by one rule.
#[derive(Debug)]
pub struct Trial<'a> {
    /// What outlives it.
    pub bench: &'a Bench,
    /// Frames before it.
    pub mark: usize,
    /// The suite's station.
    pub peer: Peer,
    remarks: Remarks<Seen>,
}

impl<'a> Trial<'a> {
    /// A trial.
    #[must_use]
    pub fn new(bench: &'a Bench, peer: &Peer) -> Self {
        Self {
            bench,
            mark: bench.net.mark(),
            peer: peer.clone(),
            remarks: Remarks::default(),
        }
    }

    /// A second station, on the same port.
    #[must_use]
    pub fn other(&self) -> Peer {
        let (system, component) = self.bench.identity;
        Peer::new(
            &self.bench.net,
            &self.bench.port,
            (system.wrapping_add(1).max(1), component),
            0,
        )
    }

    /// How long an answer may take.
    #[must_use]
    pub fn answer(&self) -> Duration {
        ANSWER.mul_f64(self.bench.factor)
    }

    /// How long nothing may come.
    #[must_use]
    pub fn quiet(&self) -> Duration {
        QUIET.mul_f64(self.bench.factor)
    }

    /// This many seconds, by the factor of the run.
    #[must_use]
    pub fn seconds(&self, seconds: f64) -> Duration {
        Duration::from_secs_f64(seconds * self.bench.factor)
    }

    /// Waits.
    ///
    /// # Errors
    /// The operator stopped the run.
    pub fn pause(&self, time: Duration) -> Judged {
        self.bench.net.pause(time);
        if self.bench.net.interrupted() {
            Err(Stop::Interrupted)
        } else {
            Ok(())
        }
    }

    /// A number that no probe had before.
    #[must_use]
    pub fn number(&self) -> u32 {
        static NEXT: std::sync::atomic::AtomicU32 = std::sync::atomic::AtomicU32::new(0);
        // The first number is taken from the clock: a subject may still answer probes of an earlier run.
        let base = (crate::wire::wall_stamp() / 100) as u32 & 0x0FFF_FFFF;
        let _ = NEXT.compare_exchange(0, base.max(1), Ordering::SeqCst, Ordering::SeqCst);
        NEXT.fetch_add(1, Ordering::SeqCst)
    }

    /// A probe and its number.
    #[must_use]
    pub fn probe(&self) -> (Draft, u32) {
        let number = self.number();
        (self.bench.probe.draft(number, self.bench.subject), number)
    }

    /// Whether the answer to a probe came from `mark` on.
    pub fn answered(
        &self,
        peer: &Peer,
        mark: usize,
        number: u32,
        time: Duration,
    ) -> Option<Arc<Seen>> {
        peer.wait(mark, time, |seen| {
            (seen.frame.system, seen.frame.component) == self.bench.subject
                && self.bench.probe.is_answer(number, seen)
        })
    }

    /// Whether the subject answers an honest probe of this peer within three tries.
    pub fn answers(&self, peer: &Peer) -> bool {
        (0..3).any(|_| {
            let (draft, number) = self.probe();
            let mark = peer.send(&draft);
            self.answered(peer, mark, number, self.answer()).is_some()
        })
    }

    /// Inconclusive unless the subject answers an honest probe.
    ///
    /// # Errors
    /// It does not.
    pub fn alive(&self) -> Judged {
        if self.answers(&self.peer) {
            Ok(())
        } else if self.bench.net.interrupted() {
            Err(Stop::Interrupted)
        } else {
            Err(Stop::inconclusive(
                "the subject does not answer an honest request of the suite",
            ))
        }
    }

    /// Sends a probe that `change` has made one that must be dropped. `what` names the frame.
    ///
    /// # Errors
    /// A fail where it is answered, or where the subject answers no honest probe afterwards; inconclusive where it
    /// answers none before.
    pub fn refuses(&self, what: &str, change: impl FnOnce(&mut crate::wire::Craft)) -> Judged {
        self.alive()?;
        let (draft, number) = self.probe();
        let (mark, _) = self.peer.send_with(&draft, change);
        let answer = self.answered(&self.peer, mark, number, self.quiet());
        self.expect_none(answer, |seen| {
            format!(
                "expected no answer to {what}; the subject answered it with {}",
                seen.frame.name()
            )
        })?;
        if self.answers(&self.peer) {
            Ok(())
        } else {
            Err(Stop::fail(format!(
                "after {what} the subject answers honest frames no more"
            )))
        }
    }

    /// Sends a probe that `change` has made unusual but lawful.
    ///
    /// # Errors
    /// A fail where it is not answered.
    pub fn takes(&self, what: &str, change: impl Fn(&mut crate::wire::Craft)) -> Judged {
        self.alive()?;
        for _ in 0..3 {
            let (draft, number) = self.probe();
            let (mark, _) = self.peer.send_with(&draft, &change);
            if self
                .answered(&self.peer, mark, number, self.answer())
                .is_some()
            {
                return Ok(());
            }
        }
        Err(Stop::fail(format!(
            "expected an answer to {what}; none came in three tries"
        )))
    }

    /// The run's key.
    ///
    /// # Errors
    /// Not applicable where the run has none.
    pub fn key(&self) -> Judged<crate::wire::Key> {
        self.bench
            .net
            .key()
            .ok_or_else(|| Stop::not_applicable("needs the subject's signing key (--key-file)"))
    }

    /// Frames of the subject from `mark` on.
    #[must_use]
    pub fn from_subject(&self, mark: usize, wanted: impl Fn(&Seen) -> bool) -> Vec<Arc<Seen>> {
        let (system, component) = self.bench.subject;
        self.bench.net.all(mark, |seen| {
            seen.direction == conformance::wire::Direction::Received
                && (seen.frame.system, seen.frame.component) == (system, component)
                && wanted(seen)
        })
    }

    /// Whether the vehicle's latest heartbeat reports it as armed.
    #[must_use]
    pub fn armed(&self) -> bool {
        self.from_subject(0, |seen| seen.frame.is("HEARTBEAT"))
            .last()
            .is_some_and(|seen| seen.frame.int("base_mode") & 0x80 != 0)
    }
}

impl Deref for Trial<'_> {
    type Target = Remarks<Seen>;

    fn deref(&self) -> &Self::Target {
        &self.remarks
    }
}
