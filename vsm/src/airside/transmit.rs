//! Chooses the next frame and its link: first frames that pass through, then those of the agent itself.

use mavlink_link::Now;
use mavlink_link::dialect::{MavMessage, STATUSTEXT_DATA};
use mavlink_link::frame::{MAX_FRAME, SETUP_SIGNING_ID};
use mavlink_link::link::Auth;
use mavlink_link::receiver::AUTOPILOT;
use zeroize::Zeroizing;

use super::agent::Agent;
use super::keys::Keys;
use super::output::{Side, Transmit};
use super::phase::Phase;
use crate::session::LogLevel;

impl Agent {
    /// Writes the next due frame into `out`. Call it until it returns `None`, after each of the other methods.
    pub fn poll_transmit(
        &mut self,
        now: Now,
        keys: &mut dyn Keys,
        out: &mut [u8; MAX_FRAME],
    ) -> Option<Transmit> {
        let others = |side: Side, to| {
            let link = match side {
                Side::Radio => &self.radio,
                Side::Px4 => &self.px4,
            };
            let is_peer = link.peer() == Some(to);
            link.others(now.mono).filter(move |_| is_peer)
        };
        if let Some(relayed) = self.relay.poll_transmit(out, others) {
            return Some(relayed);
        }
        self.fallback
            .poll_transmit(now, &self.phase, keys, out)
            .or_else(|| self.command_transmit(now, keys, out))
            .or_else(|| self.px4_transmit(now, keys, out))
            .or_else(|| {
                let ground = (&mut self.radio, &mut self.phase);
                self.exchange.poll_transmit(now, ground, keys, out)
            })
            .or_else(|| self.radio_transmit(now, keys, out))
    }

    /// A command of the agent itself.
    fn command_transmit(
        &mut self,
        now: Now,
        keys: &mut dyn Keys,
        out: &mut [u8; MAX_FRAME],
    ) -> Option<Transmit> {
        let auth = self.phase.px4_auth(keys);
        if matches!(auth, Auth::Off) {
            return None;
        }
        let message = self.alone.poll_command(self.settings.vehicle_system)?;
        // If it cannot be sent, it is retried like one that is lost.
        let sent = self.px4.send(now, auth, &message, out).ok()?;
        Some(Transmit::new(Side::Px4, sent.to, sent.len))
    }

    fn px4_transmit(
        &mut self,
        now: Now,
        keys: &mut dyn Keys,
        out: &mut [u8; MAX_FRAME],
    ) -> Option<Transmit> {
        let (to, len, secret) = match &mut self.phase {
            Phase::Keyless | Phase::CannotSign { .. } => return None,
            Phase::HandingOver(on) => {
                // A key that a power cut could take from this disk must not be sent: PX4 would then have a key that nobody
                // knows.
                on.handover.hold_key(self.key_held || !keys.is_stored());
                let sent = on.handover.poll_transmit(now, keys.disk(), out)?;
                (sent.to, sent.len, sent.secret)
            }
            Phase::Relaying(relaying)
                if self.settings.restamp
                    && !self.key_held
                    // One of two who claim to be PX4 is not: neither is sent the key.
                    && self.px4.others(now.mono).next().is_none()
                    && self.watch.restamp_is_due(now.mono) =>
            {
                self.watch.restamped();
                let key = &mut relaying.key;
                // The same key with a stamp above all others: PX4 loses its stream table in a restart, and this
                // makes it refuse everything that was recorded before.
                let initial = key.take_stamp(now, keys.disk()).ok()?;
                let mut payload = Zeroizing::new([0; 42]);
                // SETUP_SIGNING on the wire: initial_timestamp u64, target_system, target_component, secret_key[32].
                payload[..8].copy_from_slice(&initial.get().to_le_bytes());
                payload[8] = self.settings.vehicle_system;
                payload[9] = AUTOPILOT;
                payload[10..].copy_from_slice(key.key().expose());
                let auth = Auth::Signed {
                    key,
                    store: keys.disk(),
                };
                let sent = self
                    .px4
                    .send_raw(now, auth, SETUP_SIGNING_ID, &*payload, None, out)
                    .ok()?;
                self.reports.note(
                    LogLevel::Info,
                    "PX4 has started, disarmed: sending its key with a new timestamp; do not cut its power for 5 s",
                );
                (sent.to, sent.len, true)
            }
            Phase::Relaying(relaying) => {
                let auth = Auth::Signed {
                    key: &mut relaying.key,
                    store: keys.disk(),
                };
                let sent = self.px4.poll_transmit(now, auth, out)?;
                (sent.to, sent.len, false)
            }
        };
        Some(Transmit {
            side: Side::Px4,
            to,
            len,
            secret,
        })
    }

    fn radio_transmit(
        &mut self,
        now: Now,
        keys: &mut dyn Keys,
        out: &mut [u8; MAX_FRAME],
    ) -> Option<Transmit> {
        let received = self.radio.peer().is_some();
        let auth = self.phase.ground_auth(keys);
        if matches!(auth, Auth::Off) {
            return None;
        }
        // Texts wait until the address of the ground is known; a `send` without a peer would lose them.
        let text = if received {
            self.reports.poll_text()
        } else {
            None
        };
        let sent = match text {
            Some((severity, text)) => {
                let text = MavMessage::STATUSTEXT(STATUSTEXT_DATA {
                    severity,
                    text: text.as_str().into(),
                    ..STATUSTEXT_DATA::default()
                });
                self.radio.send(now, auth, &text, out).ok()?
            }
            None => self.radio.poll_transmit(now, auth, out)?,
        };
        Some(Transmit::new(Side::Radio, sent.to, sent.len))
    }
}
