//! An order to zeroize, from the paired ground over the radio or from an operator of this computer.
//!
//! ```text
//! safe -> to store -> (stored) PX4 is given a key that nobody keeps, 20 s at most -> over: the shell ends, and erases
//!             |
//!             +-> (not stored) safe
//! ```
//!
//! A start that finds an order of an earlier process, which ended before PX4 had another key, begins in `waiting` with the
//! radio closed. It waits for PX4 to be there and disarmed, 30 s at most, and continues as above
//! ([`Agent::resume_zeroize`]).
//!
//! The order is on disk before it is acknowledged and before PX4's key is touched: from then on it is carried out whatever
//! happens. The machine itself erases nothing. Its caller asks whether an order has to be stored
//! ([`Agent::zeroize_to_store`]) and whether it is over ([`Agent::is_zeroized`]). While PX4 is not known to be disarmed an
//! order is refused, unless it says otherwise.
//!
//! PX4's key is replaced, not deleted: with a blank key PX4 v1.18 switches signing off, and obeys everybody in range. The
//! new key is random, in no file, and lost with this process.

use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::exchange::{AutopilotKey, Random, ZeroizeRefusal, ZeroizeReport};
use mavlink_link::link::LinkState;
use mavlink_link::provisioning::{Outcome, State};
use mavlink_link::signing::SigningKey;
use zeroize::Zeroizing;

use super::agent::Agent;
use super::keys::Keys;
use super::phase::{Cause, Phase, Stage};
use crate::session::LogLevel;

impl Agent {
    /// Takes an order of the paired ground.
    pub(super) fn zeroize_ordered(&mut self, now: Now, in_flight: bool) {
        let report = match self.zeroize {
            Stage::Safe if !in_flight && !self.watch.is_disarmed(now.mono) => {
                self.reports.note(
                    LogLevel::Warning,
                    "an order of the ground to zeroize is refused: PX4 is not known to be disarmed",
                );
                ZeroizeReport::Refused(ZeroizeRefusal::InFlight)
            }
            Stage::Safe => {
                self.zeroize = Stage::ToStore { ground: true };
                return;
            }
            // It is answered once the order is stored.
            Stage::ToStore { .. } => return,
            Stage::Waiting { .. } | Stage::Replacing { .. } => {
                ZeroizeReport::Stored(AutopilotKey::Pending)
            }
            Stage::Over { key, .. } => ZeroizeReport::Stored(key),
        };
        self.exchange.responder.report_zeroize(report);
    }

    /// Takes an order of an operator of this computer.
    ///
    /// # Errors
    /// Why it is refused.
    pub fn zeroize_here(&mut self, mono: Duration, in_flight: bool) -> Result<(), &'static str> {
        if self.zeroize != Stage::Safe {
            return Err("it is ordered already");
        }
        if !in_flight && !self.watch.is_disarmed(mono) {
            return Err(FLIES);
        }
        self.zeroize = Stage::ToStore { ground: false };
        Ok(())
    }

    /// Whether an order has to be stored now.
    #[must_use]
    pub fn zeroize_to_store(&self) -> bool {
        matches!(self.zeroize, Stage::ToStore { .. })
    }

    /// The order is on disk, perhaps with a doubt; or it could not be stored, and nothing is erased. `random` is for PX4's
    /// new key.
    pub fn zeroize_stored(
        &mut self,
        now: Now,
        stored: &Result<Option<String>, String>,
        random: &mut dyn Random,
        keys: &mut dyn Keys,
    ) {
        let Stage::ToStore { ground } = self.zeroize else {
            return;
        };
        let by = match ground {
            true => "the paired ground",
            false => "an operator of this computer",
        };
        match stored {
            Err(why) => {
                self.zeroize = Stage::Safe;
                let text = format!("ZEROIZE of {by} NOT DONE: {why}");
                self.reports.note(LogLevel::Error, text);
                let refused = ZeroizeReport::Refused(ZeroizeRefusal::NotStored);
                self.exchange.responder.report_zeroize(refused);
                return;
            }
            Ok(doubt) => {
                let doubt = doubt.as_ref().map(|why| format!(" ({why})"));
                let text = format!(
                    "ZEROIZE ORDERED by {by}: the agent ends, and erases its keys{}",
                    doubt.unwrap_or_default()
                );
                self.reports.note(LogLevel::Warning, text);
            }
        }
        let begun = self.replace_px4_key(now, random, keys);
        match begun {
            Ok(()) => {
                self.zeroize = replacing(now);
                let pending = ZeroizeReport::Stored(AutopilotKey::Pending);
                self.exchange.responder.report_zeroize(pending);
            }
            Err(key) => self.conclude_zeroize(now.mono, key),
        }
    }

    /// A start has found an order, and the radio stays closed: gives PX4 another key as soon as it is there and disarmed.
    /// Call this after everything that is handled, until [`zeroized_key`](Self::zeroized_key) has an answer.
    pub fn resume_zeroize(&mut self, now: Now, random: &mut dyn Random, keys: &mut dyn Keys) {
        let until = match self.zeroize {
            Stage::Safe => now.mono.saturating_add(WAIT_WITHIN),
            Stage::Waiting { until } => until,
            Stage::ToStore { .. } | Stage::Replacing { .. } | Stage::Over { .. } => return,
        };
        self.zeroize = Stage::Waiting { until };
        match self.replace_px4_key(now, random, keys) {
            Ok(()) => self.zeroize = replacing(now),
            // PX4 starts together with this computer, or may be landed and disarmed in a moment.
            Err(AutopilotKey::NotReached | AutopilotKey::Armed) if now.mono < until => {}
            Err(key) => self.conclude_zeroize(now.mono, key),
        }
    }

    /// What happened to PX4's key, once that is known.
    #[must_use]
    pub fn zeroized_key(&self) -> Option<AutopilotKey> {
        match self.zeroize {
            Stage::Over { key, .. } => Some(key),
            _ => None,
        }
    }

    /// Whether the agent has to end now, and to erase what it has.
    #[must_use]
    pub fn is_zeroized(&self, mono: Duration) -> bool {
        matches!(self.zeroize, Stage::Over { since, .. } if mono.saturating_sub(since) >= LAST_WORDS)
    }

    /// Begins to give PX4 a key that nobody keeps; the error is why that is impossible.
    fn replace_px4_key(
        &mut self,
        now: Now,
        random: &mut dyn Random,
        keys: &mut dyn Keys,
    ) -> Result<(), AutopilotKey> {
        if !self.settings.replace_px4_key {
            return Err(AutopilotKey::Kept);
        }
        if self.px4.state() != LinkState::Live || !matches!(self.phase, Phase::Relaying(_)) {
            return Err(AutopilotKey::NotReached);
        }
        if !self.watch.is_disarmed(now.mono) {
            return Err(AutopilotKey::Armed);
        }
        let mut bytes = Zeroizing::new([0; 32]);
        random
            .fill(&mut *bytes)
            .map_err(|_| AutopilotKey::NotTaken)?;
        let other = SigningKey::new(*bytes).map_err(|_| AutopilotKey::NotTaken)?;
        let old = match std::mem::replace(&mut self.phase, Phase::Keyless) {
            Phase::Relaying(relaying) => relaying.key,
            phase => {
                self.phase = phase;
                return Err(AutopilotKey::NotReached);
            }
        };
        let begun = self.hand_over(Some(old), other, Cause::Discarded, now, keys);
        begun.map_err(|fault| {
            let text = format!("PX4 cannot be given another key: {fault}");
            self.reports.note(LogLevel::Error, text);
            AutopilotKey::NotTaken
        })
    }

    /// Concludes the zeroize by what PX4 has shown since, or by its timeout.
    pub(super) fn follow_zeroize(&mut self, mono: Duration) {
        let Stage::Replacing { until } = self.zeroize else {
            return;
        };
        let Phase::HandingOver(on) = &self.phase else {
            return;
        };
        let key = match on.handover.outcome() {
            Some(Outcome::Committed) => AutopilotKey::Replaced,
            Some(Outcome::RolledBack | Outcome::SeveralAutopilots | Outcome::NeverSigns) => {
                AutopilotKey::NotTaken
            }
            None if mono < until => return,
            None => match on.handover.state() {
                State::WaitDisarm if self.watch.is_armed() => AutopilotKey::Armed,
                State::NotTaken | State::RolledBack => AutopilotKey::NotTaken,
                _ => AutopilotKey::NotReached,
            },
        };
        self.conclude_zeroize(mono, key);
    }

    fn conclude_zeroize(&mut self, mono: Duration, key: AutopilotKey) {
        self.zeroize = Stage::Over { key, since: mono };
        self.reports
            .note(LogLevel::Warning, format!("zeroize: {key}"));
        let report = ZeroizeReport::Stored(key);
        self.exchange.responder.report_zeroize(report);
    }

    pub(super) fn zeroize_timeout(&self) -> Duration {
        match self.zeroize {
            Stage::Safe | Stage::ToStore { .. } => Duration::MAX,
            Stage::Waiting { until } | Stage::Replacing { until } => until,
            Stage::Over { since, .. } => since.saturating_add(LAST_WORDS),
        }
    }
}

fn replacing(now: Now) -> Stage {
    let until = now.mono.saturating_add(REPLACE_WITHIN);
    Stage::Replacing { until }
}

const FLIES: &str = "PX4 is not known to be disarmed, and would lose its link to the ground: land and disarm it, or add \
                     --in-flight";
/// Of these, 10 s are to check that only one autopilot is on the link; then three attempts follow.
const REPLACE_WITHIN: Duration = Duration::from_secs(20);
/// PX4 starts together with this computer after a power cut, in about ten seconds.
const WAIT_WITHIN: Duration = Duration::from_secs(30);
/// The ground asks every half second: earlier answers may have been lost.
const LAST_WORDS: Duration = Duration::from_millis(2_500);
