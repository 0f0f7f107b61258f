//! The steps of one attempt: step 1 out, step 2 in, step 3 out, step 4 in.

use core::time::Duration;

use zeroize::Zeroizing;

use super::attempt::{Asking, Attempt, Confirming, Promise};
use super::machine::{FOLLOW_EVERY, Follow, Initiator, InitiatorEvent, Phase, Trust};
use crate::Now;
use crate::exchange::identity::Random;
use crate::exchange::keys::{Agreed, derive};
use crate::exchange::message::{Data, Message, Status, Step, Suite, VERSION};
use crate::exchange::noise::{Noise, Setup};
use crate::exchange::stats::Ignored;
use crate::exchange::store::{InitiatorStore, StoreError};
use crate::exchange::terms::{Facts, Terms, VehicleState};

impl Initiator {
    /// Begins an attempt: the counter is on disk before step 1 is made.
    pub(super) fn begin(
        &mut self,
        now: Now,
        random: &mut dyn Random,
        store: &mut dyn InitiatorStore,
    ) {
        let wall_ms = u64::try_from(now.wall.as_millis()).unwrap_or(u64::MAX);
        // Wall-clock milliseconds keep the counter above earlier ones even where the stored one was lost.
        let counter = self.memory.counter.saturating_add(1).max(wall_ms);
        if let Err(cause) = store.store_counter(counter) {
            let pause = self.pauses.next(random);
            self.not_stored(now.mono, cause, pause);
            return;
        }
        self.memory.counter = counter;
        self.forget_cookie();
        let Some(asking) = self.first_message(counter, random) else {
            let pause = self.pauses.next(random);
            self.fail(now.mono, pause);
            self.events.push_back(InitiatorEvent::NoRandom);
            self.keep_few_events();
            return;
        };
        let session = asking.message.session;
        let mut attempt = Attempt::begin(now.mono);
        self.due = attempt.take_due(now.mono);
        self.phase = Phase::Asking(Box::new(asking), attempt);
        self.events.push_back(InitiatorEvent::Begun { session });
        self.keep_few_events();
    }

    /// Step 1; `None` without random bytes.
    fn first_message(&self, counter: u64, random: &mut dyn Random) -> Option<Asking> {
        let mut bytes = [0; 4];
        random.fill(&mut bytes).ok()?;
        // Session 0 marks step 0.
        let session = u32::from_le_bytes(bytes).max(1);
        let mut ephemeral = Zeroizing::new([0; 32]);
        random.fill(&mut *ephemeral).ok()?;
        let suite = self.config.trust.suite();
        let psk = match &self.config.trust {
            Trust::Pinned(_) => None,
            Trust::Pairing(code) => Some(code.psk()),
        };
        let mut noise = Noise::initiator(&Setup {
            suite,
            own: &self.config.identity,
            peer: match &self.config.trust {
                Trust::Pinned(peer) => Some(peer),
                Trust::Pairing(_) => None,
            },
            psk: psk.as_deref(),
            prologue: &self.config.parties.prologue(suite, session),
            ephemeral: &ephemeral,
        })
        .ok()?;
        let facts = self.facts(counter).to_bytes();
        let payload = match suite {
            Suite::Pinned => facts.as_slice(),
            // The first message of XX is not encrypted: the facts are sent in step 3.
            Suite::Pairing => &[],
        };
        let written = noise.write(payload).ok()?;
        let (public_key, data) = written.as_slice().split_first_chunk::<32>()?;
        let message = self.message(session, Step::Offer, *public_key, Data::new(data)?);
        Some(Asking {
            noise,
            gate: self.gate.clone()?,
            message,
            counter,
        })
    }

    fn facts(&self, counter: u64) -> Facts {
        Facts {
            counter,
            wanted: self.config.wanted,
            state: VehicleState::default(),
            epoch: self.memory.epoch,
            current: self.memory.current,
        }
    }

    fn message(&self, session: u32, step: Step, public_key: [u8; 32], data: Data) -> Message {
        Message {
            public_key,
            session,
            version: VERSION,
            step,
            suite: self.config.trust.suite().to_wire(),
            status: Status::Ok,
            target: self.config.parties.responder,
            data,
        }
    }

    /// Step 2: the keys are derived, and `next` is on disk before step 3 is made.
    pub(super) fn answered(
        &mut self,
        now: Now,
        message: &Message,
        store: &mut dyn InitiatorStore,
    ) -> Result<(), Ignored> {
        let Phase::Asking(asking, _) = &mut self.phase else {
            return Err(Ignored::Session);
        };
        if message.session != asking.message.session || message.suite != asking.message.suite {
            return Err(Ignored::Session);
        }
        // The first mixing sets the key of what follows, so a forged message leaves the state usable.
        let payload = asking
            .noise
            .read([&message.public_key, message.data.as_slice()])
            .map_err(|_| Ignored::Forged)?;
        let theirs = Facts::parse(payload.as_slice()).ok_or(Ignored::Forged)?;
        // From here on the message is proved to come from the peer; in a pairing, from somebody who has yet to prove the
        // code.
        let Phase::Asking(asking, mut attempt) = core::mem::replace(&mut self.phase, Phase::Idle)
        else {
            return Err(Ignored::Session);
        };
        match self.confirm(now, *asking, &theirs, message, store) {
            Ok(confirming) => {
                let key = confirming.agreed.key;
                attempt.next_step(now.mono);
                self.due = attempt.take_due(now.mono);
                self.phase = Phase::Confirming(Box::new(confirming), attempt);
                self.events.push_back(InitiatorEvent::NextStored { key });
                self.keep_few_events();
                Ok(())
            }
            Err(Some(cause)) => {
                self.not_stored(now.mono, cause, PAUSE);
                Ok(())
            }
            Err(None) => {
                self.fail(now.mono, PAUSE);
                Err(Ignored::Forged)
            }
        }
    }

    /// Step 3, once everything that must be on disk is there. `Err(None)`: the handshake failed.
    fn confirm(
        &mut self,
        now: Now,
        asking: Asking,
        theirs: &Facts,
        answer: &Message,
        store: &mut dyn InitiatorStore,
    ) -> Result<Confirming, Option<StoreError>> {
        let Asking {
            mut noise,
            gate,
            message: offer,
            counter,
        } = asking;
        let last = match self.config.trust {
            Trust::Pinned(_) => None,
            Trust::Pairing(_) => {
                let facts = self.facts(counter).to_bytes();
                Some(noise.write(&facts).map_err(|_| None)?)
            }
        };
        let peer = noise.peer().ok_or(None)?;
        let finished = noise.finish().ok_or(None)?;
        let terms = Terms {
            parties: &self.config.parties,
            session: offer.session,
            wanted: [self.config.wanted, theirs.wanted],
            epochs: [self.memory.epoch, theirs.epoch],
            peer,
        };
        let (agreed, confirmation) = derive(&finished, &terms).ok_or(None)?;
        // Wiped here, before the disk is written.
        drop(finished);
        let data = match &last {
            Some(last) => Data::new(last.as_slice()),
            None => Data::new(&confirmation.of_initiator()),
        };
        // The responder already uses our waiting key, so the new one must not overwrite it.
        if self.memory.next.is_some() && self.memory.next == theirs.current {
            store.promote_next().map_err(Some)?;
            self.memory.current = self.memory.next.take();
            self.events.push_back(InitiatorEvent::Promoted);
        }
        self.store_next(&agreed, store)?;
        Ok(Confirming {
            gate,
            message: self.message(
                offer.session,
                Step::Confirm,
                offer.public_key,
                data.ok_or(None)?,
            ),
            agreed: Promise {
                key: agreed.key.id(),
                peer,
                epoch: agreed.epoch,
            },
            confirmation,
            ephemeral: answer.public_key,
            since: now.mono,
            seq: None,
        })
    }

    fn store_next(
        &mut self,
        agreed: &Agreed,
        store: &mut dyn InitiatorStore,
    ) -> Result<(), Option<StoreError>> {
        store.store_next(agreed).map_err(Some)?;
        self.memory.next = Some(agreed.key.id());
        self.memory.epoch = agreed.epoch;
        Ok(())
    }

    /// Step 4: the peer has the key too, and reports its state.
    pub(super) fn outcome(
        &mut self,
        now: Now,
        message: &Message,
        store: &mut dyn InitiatorStore,
    ) -> Result<(), Ignored> {
        let (Phase::Confirming(confirming, _) | Phase::Following(confirming, _)) = &mut self.phase
        else {
            return Err(Ignored::Session);
        };
        if message.session != confirming.message.session
            || message.suite != confirming.message.suite
            || message.public_key != confirming.ephemeral
        {
            return Err(Ignored::Session);
        }
        let outcome = confirming
            .confirmation
            .read_outcome(message.data.as_slice())
            .ok_or(Ignored::Forged)?;
        let seq = confirming.seq;
        // Step 4 may arrive out of order: an older state must not replace a newer one.
        if seq.is_some_and(|seq| outcome.seq < seq) {
            return Err(Ignored::Repeated);
        }
        if let Phase::Following(confirming, follow) = &mut self.phase {
            follow.answered = now.mono;
            if seq == Some(outcome.seq) {
                return Ok(());
            }
            confirming.seq = Some(outcome.seq);
        }
        // In all four the responder certainly does not have our `next`, and says so under the keys of the exchange.
        let gone = matches!(
            outcome.status,
            Status::Busy | Status::RolledBack | Status::UnknownSession | Status::Refused
        );
        if let Phase::Confirming(confirming, _) = &self.phase
            && !gone
        {
            let agreed = confirming.agreed;
            if let Err(cause) = self.pin(&agreed.peer, store) {
                // Step 3 is sent again, and answered again.
                self.events.push_back(InitiatorEvent::NotStored(cause));
                self.keep_few_events();
                return Ok(());
            }
            self.events.push_back(agreed.event());
            self.follow(now.mono, outcome.seq);
        }
        let (status, reason) = (outcome.status, outcome.reason);
        self.events
            .push_back(InitiatorEvent::Status { status, reason });
        if gone {
            self.drop_next(now, status, store);
        } else if status == Status::CannotSign {
            self.rest();
        }
        self.keep_few_events();
        Ok(())
    }

    fn drop_next(&mut self, now: Now, status: Status, store: &mut dyn InitiatorStore) {
        if let Err(cause) = store.drop_next() {
            self.not_stored(now.mono, cause, PAUSE);
            return;
        }
        self.memory.next = None;
        self.rest();
        self.events.push_back(InitiatorEvent::Dropped { status });
    }

    fn follow(&mut self, now: Duration, seq: u32) {
        self.wanted = false;
        self.pauses.reset();
        if let Phase::Confirming(mut confirming, _) =
            core::mem::replace(&mut self.phase, Phase::Idle)
        {
            confirming.seq = Some(seq);
            let follow = Follow {
                ask_at: now.saturating_add(FOLLOW_EVERY),
                answered: now,
            };
            self.phase = Phase::Following(confirming, follow);
        }
    }

    fn not_stored(&mut self, now: Duration, cause: StoreError, pause: Duration) {
        self.fail(now, pause);
        self.events.push_back(InitiatorEvent::NotStored(cause));
        self.keep_few_events();
    }
}

/// The pause after a failure of our own disk.
const PAUSE: Duration = Duration::from_secs(5);
