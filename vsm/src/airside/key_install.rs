//! Installs a key on PX4: begun by an agreement or because PX4 has lost its key, ended by what PX4's frames prove.

use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::dialect::MavSeverity;
use mavlink_link::exchange::{ResponderEvent, Status, VERSION};
use mavlink_link::link::Endpoint;
use mavlink_link::provisioning::{
    Event, KeyRollover, KeyRolloverConfig, KeySlot, Outcome, StartError, State,
};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::SigningKey;

use super::agent::Agent;
use super::keys::{Keys, with_clock};
use super::phase::{Cause, HandingOver, Phase, Relaying};
use super::relay::FrameForwarder;
use crate::session::{LogLevel, Peer};

impl Agent {
    /// Begins to install a key that is on disk.
    pub(super) fn hand_over(
        &mut self,
        old: Option<KeyState>,
        new: SigningKey,
        cause: Cause,
        now: Now,
        keys: &mut dyn Keys,
    ) -> Result<(), StartError> {
        let mut link = *self.px4.config();
        // A peer that has proved to be PX4 is used at once; the rollover need not wait for its first frame.
        if let Some(peer) = self.px4_peer(now.mono) {
            link.endpoint = Endpoint::Fixed(peer);
        }
        let config = KeyRolloverConfig {
            link,
            not_before: self.settings.not_before,
            may_send_key: true,
            // Nobody else is on the line between PX4 and the agent, so its unsigned frames can be believed.
            believe_unsigned: true,
        };
        let handover = KeyRollover::start(config, old, new, now, keys.disk())?;
        self.phase = Phase::HandingOver(Box::new(HandingOver {
            handover,
            cause,
            previous: None,
            commit_at: None,
        }));
        Ok(())
    }

    /// Processes the events of the exchange: an agreed key goes to PX4, the rest to the log.
    pub(super) fn follow_exchange(&mut self, now: Now, keys: &mut dyn Keys) {
        while let Some(event) = self.exchange.poll_event() {
            match event {
                ResponderEvent::Staged { key, epoch } => {
                    self.reports
                        .note(LogLevel::Info, format!("key {key} agreed, epoch {epoch}"));
                    self.hand_over_staged(now, keys);
                }
                ResponderEvent::Withdrawn => self.give_up_staged(),
                ResponderEvent::Paired { peer } => {
                    let fingerprint = peer.fingerprint();
                    self.reports.note(
                        LogLevel::Warning,
                        format!("paired with ground {fingerprint}; from now on only it can agree on keys"),
                    );
                }
                ResponderEvent::WindowClosed => {
                    self.reports
                        .note(LogLevel::Info, "the pairing window is closed");
                }
                ResponderEvent::WrongCode => {
                    self.reports
                        .note(LogLevel::Warning, "pairing attempt with a wrong code");
                }
                ResponderEvent::OtherVersion { version, verified } => {
                    self.reports.note(
                        LogLevel::Warning,
                        format!(
                            "the ground speaks version {version} of the key exchange, this agent version {VERSION}: \
                             no key can be agreed on, update the older end"
                        ),
                    );
                    // Anybody can send this unverified, and not everybody may alert an operator.
                    if verified {
                        let text = "Agent: other key exchange version, update";
                        self.reports
                            .alert_ground(MavSeverity::MAV_SEVERITY_WARNING, text);
                    }
                }
                ResponderEvent::Zeroize { in_flight } => self.zeroize_ordered(now, in_flight),
                ResponderEvent::NotStored(fault) => {
                    self.reports.note(
                        LogLevel::Error,
                        format!("the exchange cannot be stored: {fault}"),
                    );
                }
            }
        }
    }

    /// A key of an exchange is on disk: installs it on PX4.
    fn hand_over_staged(&mut self, now: Now, keys: &mut dyn Keys) {
        let next = match keys.next() {
            Ok(Some(next)) => next,
            Ok(None) => return,
            Err(fault) => {
                self.reports.note(
                    LogLevel::Error,
                    format!("the agreed key cannot be read: {fault}"),
                );
                return;
            }
        };
        // The old key is kept until PX4 signs with the new one: SETUP_SIGNING is signed with it.
        let old = match std::mem::replace(&mut self.phase, Phase::Keyless) {
            Phase::Relaying(relaying) => Some(relaying.key),
            Phase::HandingOver(on) => on.handover.into_old(),
            Phase::Keyless | Phase::CannotSign { .. } => None,
        };
        if let Err(fault) = self.hand_over(old, next, Cause::NewKey, now, keys) {
            // The key stays on disk, and a restart of the agent resumes its installation.
            self.reports.note(
                LogLevel::Error,
                format!("the agreed key cannot be installed: {fault}"),
            );
            return;
        }
        // The check for a second autopilot is reported as this state: the exchange has no status of its own for it.
        self.exchange.responder.report(Status::WaitDisarm, 0);
    }

    /// The staged key must no longer be sent: PX4 keeps the one that it has.
    fn give_up_staged(&mut self) {
        self.reports
            .note(LogLevel::Info, "the agreed key is dropped for another");
        self.phase = match std::mem::replace(&mut self.phase, Phase::Keyless) {
            // Only a new key is withdrawn: KEY_EXCHANGE is held back while a lost key is sent again.
            Phase::HandingOver(on) if on.cause == Cause::NewKey => on
                .handover
                .into_old()
                .map_or(Phase::Keyless, |key| Phase::relaying(key, None)),
            Phase::CannotSign { .. } => Phase::Keyless,
            other => other,
        };
    }

    /// PX4 sends unsigned, or signs with the previous key: the one in force is installed again.
    pub(super) fn key_lost(&mut self, unsigned: bool, now: Now, keys: &mut dyn Keys) {
        let Phase::Relaying(relaying) = std::mem::replace(&mut self.phase, Phase::Keyless) else {
            return;
        };
        let Relaying { key, previous } = *relaying;
        self.reports.note(
            LogLevel::Error,
            if unsigned {
                "PX4 sends UNSIGNED: it has lost its key, as after a power cut. Sending the key again; no \
                 command is relayed until PX4 signs"
            } else {
                "PX4 signs with the PREVIOUS key: it has fallen back. Sending the key in force again"
            },
        );
        let text = if unsigned {
            "Agent: PX4 is UNSIGNED, sending its key again"
        } else {
            "Agent: PX4 fell back to the previous key"
        };
        self.reports
            .alert_ground(MavSeverity::MAV_SEVERITY_CRITICAL, text);
        // An unsigned PX4 holds no key that SETUP_SIGNING could be signed with: it accepts the first one unsigned.
        let old = match previous.as_ref().map(SigningKey::duplicate) {
            Some(previous) if !unsigned => {
                with_clock(previous, self.settings.not_before, now, keys).map(Some)
            }
            _ => Ok(None),
        };
        let begun = old
            .map_err(StartError::from)
            .and_then(|old| self.hand_over(old, key.key().duplicate(), Cause::LostKey, now, keys));
        // Its time since boot starts again, which alone does not prove that it kept the key.
        self.watch.forget_boot();
        if let (Ok(()), Phase::HandingOver(on)) = (&begun, &mut self.phase) {
            on.previous = previous.as_ref().map(SigningKey::duplicate);
        }
        if let Err(fault) = begun {
            // The clock cannot be read. Nothing passes under a key that PX4 does not have, and the next unsigned frame
            // tries again.
            self.reports.note(
                LogLevel::Error,
                format!("the key cannot be sent again: {fault}"),
            );
            self.phase = Phase::relaying(key, previous);
        }
    }

    /// Offers the key again: PX4 may have newer firmware now.
    pub(super) fn try_again_to_sign(&mut self, now: Now, keys: &mut dyn Keys) {
        let Phase::CannotSign { key, again_at } = &mut self.phase else {
            return;
        };
        *again_at = now.mono.saturating_add(ASK_AGAIN);
        let key = key.duplicate();
        if let Err(fault) = self.hand_over(None, key, Cause::LostKey, now, keys) {
            self.reports.note(
                LogLevel::Error,
                format!("the key cannot be sent again: {fault}"),
            );
        }
    }

    pub(super) fn take_while_handing_over(
        &mut self,
        now: Now,
        from: Peer,
        bytes: &[u8],
        keys: &mut dyn Keys,
    ) {
        let Phase::HandingOver(on) = &mut self.phase else {
            return;
        };
        let cause = on.cause;
        let mark = self.relay.mark();
        let mut forwarder = FrameForwarder {
            mono: now.mono,
            own_component: self.settings.own_component,
            ground: self.radio.peer(),
            watch: &mut self.watch,
            alone: &mut self.alone,
            relay: &mut self.relay,
        };
        on.handover
            .handle_and_pass(now, from, bytes, keys.disk(), &mut |under, frame| {
                let delivered = match cause {
                    Cause::NewKey => true,
                    // A frame under the previous key means that PX4 has fallen back: not delivered.
                    Cause::LostKey => under == KeySlot::New,
                    // Only this process has the new key, so the ground cannot verify frames under it.
                    Cause::Discarded => under == KeySlot::Old,
                };
                if delivered {
                    forwarder.pass(frame);
                }
            });
        self.follow_handover(now, keys);
        let undecided = matches!(&self.phase, Phase::HandingOver(on) if on.commit_at.is_some());
        if undecided {
            // Frames verified under a key that is not in force on disk yet are not delivered: after a crash now, the agent
            // would not know that key as the one in force.
            self.relay.undo(mark);
        }
    }

    /// Carries out and reports what the rollover requires.
    pub(super) fn follow_handover(&mut self, now: Now, keys: &mut dyn Keys) {
        let Phase::HandingOver(on) = &mut self.phase else {
            return;
        };
        if on.cause == Cause::Discarded {
            // A zeroize erases the files, so nothing is committed, and this state lasts until the agent ends.
            while on.handover.poll_event().is_some() {}
            return self.follow_zeroize(now.mono);
        }
        let mut events = Vec::new();
        while let Some(event) = on.handover.poll_event() {
            if event == Event::Commit {
                on.commit_at = Some(now.mono);
            }
            events.push(event);
        }
        let mut fault = None;
        // PX4 has the key already, so a disk that fails is retried; the rollover does not end before the files agree.
        if on.commit_at.is_some_and(|at| at <= now.mono) {
            match keys.commit() {
                Ok(()) => on.commit_at = None,
                Err(cause) => {
                    on.commit_at = Some(now.mono.saturating_add(COMMIT_AGAIN));
                    fault = Some(cause);
                }
            }
        }
        let ended = match on.commit_at {
            Some(_) => None,
            None => on.handover.outcome(),
        };
        for event in events {
            if let Event::State(state) = event {
                self.exchange.report_state(state);
            }
            self.note_progress(event);
        }
        if let Some(fault) = fault {
            self.reports.note(
                LogLevel::Error,
                format!("PX4 has the new key, but it cannot be made the one in force: {fault}"),
            );
        }
        if let Some(outcome) = ended {
            self.end_handover(outcome, now, keys);
        }
    }

    fn end_handover(&mut self, outcome: Outcome, now: Now, keys: &mut dyn Keys) {
        let Phase::HandingOver(on) = std::mem::replace(&mut self.phase, Phase::Keyless) else {
            return;
        };
        let HandingOver {
            handover,
            cause,
            previous,
            ..
        } = *on;
        // A restart before this proves nothing about the key that is in force now.
        self.watch.take_restart();
        let id = handover.new_id();
        let (text, level) = match (outcome, cause) {
            (Outcome::Committed, _) => (format!("PX4 signs with key {id}"), LogLevel::Info),
            (Outcome::RolledBack, Cause::NewKey | Cause::Discarded) => (
                format!("PX4 keeps its key: key {id} is dropped"),
                LogLevel::Error,
            ),
            (Outcome::RolledBack, Cause::LostKey) => (
                format!(
                    "PX4 keeps the previous key: sending key {id} again; nothing is relayed until it signs with it"
                ),
                LogLevel::Error,
            ),
            (Outcome::SeveralAutopilots, _) => (
                format!("more than one autopilot is on PX4's link: key {id} is refused"),
                LogLevel::Error,
            ),
            (Outcome::NeverSigns, _) => (
                "PX4 stays unsigned: it cannot sign (1.17 and older), and nothing is relayed"
                    .to_owned(),
                LogLevel::Error,
            ),
        };
        self.reports.note(level, text);
        match (outcome, cause) {
            (Outcome::Committed, Cause::LostKey) => {
                let text = "Agent: PX4 signs with its key again";
                self.reports
                    .alert_ground(MavSeverity::MAV_SEVERITY_NOTICE, text);
            }
            (Outcome::RolledBack, Cause::NewKey | Cause::Discarded) => {
                let text = "Agent: PX4 keeps its key, the new one is dropped";
                self.reports
                    .alert_ground(MavSeverity::MAV_SEVERITY_WARNING, text);
            }
            (Outcome::SeveralAutopilots, _) => {
                let text = "Agent: several autopilots, the key is refused";
                self.reports
                    .alert_ground(MavSeverity::MAV_SEVERITY_WARNING, text);
            }
            (Outcome::Committed, Cause::NewKey | Cause::Discarded)
            | (Outcome::RolledBack, Cause::LostKey)
            | (Outcome::NeverSigns, _) => {}
        }
        if cause == Cause::NewKey
            && matches!(outcome, Outcome::RolledBack | Outcome::SeveralAutopilots)
            && let Err(fault) = keys.drop_next()
        {
            self.reports.note(
                LogLevel::Warning,
                format!("key {id} cannot be deleted: {fault}"),
            );
        }
        match outcome {
            Outcome::Committed => self.exchange.responder.key_active(),
            Outcome::RolledBack if cause == Cause::NewKey => self.exchange.responder.key_dropped(),
            Outcome::RolledBack => {}
            Outcome::NeverSigns => self.exchange.responder.report(Status::CannotSign, 0),
            Outcome::SeveralAutopilots => self.exchange.report_refused(),
        }
        // A power cut can bring back PX4's old key file, so the key just replaced is kept to recognise that.
        let previous = match (outcome, cause) {
            (Outcome::Committed, Cause::NewKey) => handover.old_key(),
            _ => previous,
        };
        let later = |key| Phase::CannotSign {
            key,
            again_at: now.mono.saturating_add(ASK_AGAIN),
        };
        let key = handover.new_key();
        if (outcome, cause) == (Outcome::RolledBack, Cause::LostKey) {
            // The key in force on disk stays in force: nothing is ever relayed under the one that it replaced.
            let old = handover.into_old();
            self.phase = later(key.duplicate());
            if let Err(fault) = self.hand_over(old, key, cause, now, keys) {
                self.reports.note(
                    LogLevel::Error,
                    format!("the key cannot be sent again: {fault}"),
                );
            }
            if let Phase::HandingOver(on) = &mut self.phase {
                on.previous = previous;
            }
            return;
        }
        self.phase = match outcome {
            Outcome::NeverSigns => later(key),
            // PX4 may be unsigned here: nothing is relayed until the key can be sent again.
            Outcome::SeveralAutopilots if cause == Cause::LostKey => later(key),
            Outcome::SeveralAutopilots => handover
                .into_old()
                .map_or(Phase::Keyless, |key| Phase::relaying(key, None)),
            Outcome::Committed | Outcome::RolledBack => handover
                .into_key_in_force()
                .map_or(Phase::Keyless, |key| Phase::relaying(key, previous)),
        };
    }

    fn note_progress(&mut self, event: Event) {
        let (level, text) = match event {
            Event::State(State::Staged) => (
                LogLevel::Info,
                "a new key is on disk: listening for 10 s that only one autopilot is on PX4's link"
                    .to_owned(),
            ),
            Event::State(State::WaitDisarm) => (
                LogLevel::Info,
                "a new key waits until PX4 reports that it is disarmed".to_owned(),
            ),
            // PX4 v1.18 truncates its key file and writes it without fsync: a power cut then leaves it empty.
            Event::State(State::Sent) => (
                LogLevel::Warning,
                "the key is being sent to PX4. DO NOT cut its power for 5 s".to_owned(),
            ),
            Event::State(State::NotTaken) => {
                (LogLevel::Warning, "PX4 has not accepted the key".to_owned())
            }
            Event::State(State::RolledBack) => (
                LogLevel::Warning,
                "PX4 keeps its key; the new one is dropped if that holds for 30 s".to_owned(),
            ),
            Event::State(State::Unknown) => {
                (LogLevel::Info, "finding out which key PX4 has".to_owned())
            }
            Event::SeveralAutopilots { system } => (
                LogLevel::Error,
                format!("system {system} is on PX4's link too"),
            ),
            Event::RefusedWhileArmed => (
                LogLevel::Warning,
                "PX4 refuses a key while it is armed".to_owned(),
            ),
            Event::FellBack => (
                LogLevel::Error,
                "PX4 lost its key again; retrying".to_owned(),
            ),
            Event::State(State::Committed) | Event::Commit | Event::Ended(_) => return,
        };
        self.reports.note(level, text);
    }
}

// PX4 before v1.18 ignores SETUP_SIGNING, and only a firmware update changes that: there is no hurry.
const ASK_AGAIN: Duration = Duration::from_secs(60);
const COMMIT_AGAIN: Duration = Duration::from_secs(1);
