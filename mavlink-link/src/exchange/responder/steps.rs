//! The steps of one exchange: step 1 in, step 2 out, step 3 in, step 4 out.

use core::hash::Hash;
use core::time::Duration;

use zeroize::Zeroizing;

use super::machine::{Responder, ResponderEvent, Window};
use super::sessions::{Arrival, Done, HalfOpen, WaitsFor};
use crate::exchange::gate::Gate;
use crate::exchange::identity::Random;
use crate::exchange::keys::{Agreed, Confirmation, Outcome, derive};
use crate::exchange::message::{Data, Message, Status, Step, Suite};
use crate::exchange::noise::{Failed, Noise, Setup, Written};
use crate::exchange::stats::Ignored;
use crate::exchange::store::{PinnedPeer, ResponderStore, StagedKey, StoreError};
use crate::exchange::terms::{Facts, Terms};

impl<A: Copy + Eq + Hash> Responder<A> {
    /// Step 1.
    pub(super) fn offered(
        &mut self,
        now: Duration,
        arrival: &Arrival<A>,
        suite: Suite,
        offer: &Message,
        random: &mut dyn Random,
        store: &mut dyn ResponderStore,
    ) -> Result<(), Ignored> {
        let known = match suite {
            Suite::Pinned => self.half_open.as_ref(),
            Suite::Pairing => self
                .pairing
                .as_ref()
                .and_then(|w| w.slots.find(offer.session)),
        };
        if let Some(open) = known.filter(|open| open.offer.session == offer.session) {
            // The same bytes are a retry and get the same answer; other bytes in the session are not the initiator's.
            if open.offer != *offer {
                return Err(Ignored::Changed);
            }
            let (answer, owner) = (open.answer.clone(), open.from == arrival.from);
            if !self.limits.repeat(arrival.from, arrival.claim, owner, now) {
                return Err(Ignored::Limited);
            }
            self.send(arrival, &answer);
            return Ok(());
        }
        match suite {
            Suite::Pinned if self.memory.peer.is_none() => return Err(Ignored::Suite),
            // A person has opened a window for a new peer: the old one must not complete an exchange meanwhile.
            Suite::Pinned if self.pairing.is_some() => return Err(Ignored::Window),
            Suite::Pairing if self.pairing.is_none() => return Err(Ignored::Window),
            _ => {}
        }
        let over = |window: &Window<A>| window.slots.is_over(offer.session);
        if suite == Suite::Pairing && self.pairing.as_ref().is_some_and(over) {
            return Err(Ignored::Repeated);
        }
        // PX4 may already have the staged key. Replacing it could leave PX4 with a key that neither end keeps.
        if self.memory.next.is_some_and(|next| next.sent) {
            return Err(Ignored::Busy);
        }
        if !self.limits.admit(arrival.from, arrival.claim, now) {
            return Err(Ignored::Limited);
        }
        let mut ephemeral = Zeroizing::new([0; 32]);
        random
            .fill(&mut *ephemeral)
            .map_err(|_| Ignored::NoRandom)?;
        match suite {
            Suite::Pinned => self.answer_pinned(now, arrival, offer, &ephemeral, store),
            Suite::Pairing => self.answer_pairing(now, arrival, offer, ephemeral),
        }
    }

    fn answer_pinned(
        &mut self,
        now: Duration,
        arrival: &Arrival<A>,
        offer: &Message,
        ephemeral: &[u8; 32],
        store: &mut dyn ResponderStore,
    ) -> Result<(), Ignored> {
        let peer = self.memory.peer.ok_or(Ignored::Suite)?.key;
        let (mut noise, payload) = self
            .read_offer(Suite::Pinned, offer, ephemeral)
            .map_err(|_| Ignored::Forged)?;
        let theirs = Facts::parse(payload.as_slice()).ok_or(Ignored::Forged)?;
        // The first Noise KK message can be replayed: only a counter above all earlier ones goes further.
        if theirs.counter <= self.highest {
            return Err(Ignored::OldCounter);
        }
        // On disk before step 2: the initiator drops its own `next` once it has that.
        self.withdraw(store)
            .map_err(|cause| self.not_stored(cause))?;
        // In memory only. It reaches the disk with step 3; until then a replay after a restart can withdraw a key, no more.
        self.highest = theirs.counter;
        let answer = self
            .write_answer(&mut noise, offer, &self.facts())
            .ok_or(Ignored::Forged)?;
        let finished = noise.finish().ok_or(Ignored::Forged)?;
        let terms = Terms {
            parties: &self.config.parties,
            session: offer.session,
            wanted: [self.config.wanted, theirs.wanted],
            epochs: [self.memory.epoch, theirs.epoch],
            peer,
        };
        let derived = derive(&finished, &terms).ok_or(Ignored::Forged)?;
        self.half_open = Some(HalfOpen {
            from: arrival.from,
            since: now,
            offer: offer.clone(),
            answer: answer.clone(),
            waits_for: WaitsFor::Proof(Box::new(derived), theirs.counter),
        });
        self.send(arrival, &answer);
        Ok(())
    }

    fn answer_pairing(
        &mut self,
        now: Duration,
        arrival: &Arrival<A>,
        offer: &Message,
        ephemeral: Zeroizing<[u8; 32]>,
    ) -> Result<(), Ignored> {
        let (mut noise, _) = self
            .read_offer(Suite::Pairing, offer, &ephemeral)
            .map_err(|_| Ignored::Forged)?;
        let facts = self.facts();
        let answer = self
            .write_answer(&mut noise, offer, &facts)
            .ok_or(Ignored::Forged)?;
        let window = self.pairing.as_mut().ok_or(Ignored::Window)?;
        window.slots.insert(HalfOpen {
            from: arrival.from,
            since: now,
            offer: offer.clone(),
            answer: answer.clone(),
            waits_for: WaitsFor::Message { ephemeral, facts },
        });
        self.send(arrival, &answer);
        Ok(())
    }

    /// A handshake that has read step 1, and its payload.
    fn read_offer(
        &self,
        suite: Suite,
        offer: &Message,
        ephemeral: &[u8; 32],
    ) -> Result<(Noise, Written), Failed> {
        let peer = self.memory.peer.map(|peer| peer.key);
        let pinned = suite == Suite::Pinned;
        let mut noise = Noise::responder(&Setup {
            suite,
            own: &self.config.identity,
            peer: peer.as_ref().filter(|_| pinned),
            psk: self
                .pairing
                .as_ref()
                .map(|window| &*window.psk)
                .filter(|_| !pinned),
            prologue: &self.config.parties.prologue(suite, offer.session),
            ephemeral,
        })?;
        let payload = noise.read([&offer.public_key, offer.data.as_slice()])?;
        Ok((noise, payload))
    }

    fn facts(&self) -> [u8; Facts::LEN] {
        Facts {
            counter: 0,
            wanted: self.config.wanted,
            state: self.vehicle,
            epoch: self.memory.epoch,
            current: self.memory.current,
        }
        .to_bytes()
    }

    fn write_answer(
        &self,
        noise: &mut Noise,
        offer: &Message,
        facts: &[u8; Facts::LEN],
    ) -> Option<Message> {
        let written = noise.write(facts).ok()?;
        let (public_key, data) = written.as_slice().split_first_chunk::<32>()?;
        Some(Message {
            public_key: *public_key,
            data: Data::new(data)?,
            ..self.message(offer.suite, offer.session, Step::Answer, Status::Ok)
        })
    }

    /// Step 3.
    pub(super) fn confirmed(
        &mut self,
        now: Duration,
        arrival: &Arrival<A>,
        confirm: &Message,
        store: &mut dyn ResponderStore,
    ) -> Result<(), Ignored> {
        if let Some(done) = &self.done
            && done.confirm.session == confirm.session
        {
            if done.confirm != *confirm {
                return Err(Ignored::Changed);
            }
            return self.answer_done(now, arrival, confirm);
        }
        let pinned = self
            .half_open
            .as_ref()
            .is_some_and(|open| fits(open, confirm));
        if pinned {
            self.prove_pinned(arrival, confirm, store)
        } else {
            self.prove_pairing(now, arrival, confirm, store)
        }
    }

    /// The same step 3 again gets the same step 4, unless the state of the key has changed.
    fn answer_done(
        &mut self,
        now: Duration,
        arrival: &Arrival<A>,
        confirm: &Message,
    ) -> Result<(), Ignored> {
        let done = self.done.as_ref().ok_or(Ignored::Session)?;
        let owner = done.from == arrival.from;
        if !self.limits.repeat(arrival.from, arrival.claim, owner, now) {
            return Err(Ignored::Limited);
        }
        let answer = self.outcome(done, confirm).ok_or(Ignored::Session)?;
        self.send(arrival, &answer);
        Ok(())
    }

    fn outcome(&self, done: &Done<A>, confirm: &Message) -> Option<Message> {
        Some(Message {
            public_key: done.ephemeral,
            data: Data::new(&done.confirmation.of_responder(done.outcome))?,
            ..self.message(confirm.suite, confirm.session, Step::Outcome, Status::Ok)
        })
    }

    fn prove_pinned(
        &mut self,
        arrival: &Arrival<A>,
        confirm: &Message,
        store: &mut dyn ResponderStore,
    ) -> Result<(), Ignored> {
        let Some(HalfOpen {
            waits_for: WaitsFor::Proof(derived, counter),
            ..
        }) = &self.half_open
        else {
            return Err(Ignored::Session);
        };
        if !derived.1.proves_initiator(confirm.data.as_slice()) {
            return Err(Ignored::Forged);
        }
        let peer = PinnedPeer {
            key: derived.0.peer,
            counter: *counter,
        };
        // On disk before step 4: the initiator must not rely on a key that a restart here would forget.
        store
            .store_agreed(&peer, &derived.0)
            .map_err(|cause| self.not_stored(cause))?;
        let Some(HalfOpen {
            answer,
            waits_for: WaitsFor::Proof(derived, _),
            ..
        }) = self.half_open.take()
        else {
            return Err(Ignored::Session);
        };
        let (agreed, confirmation) = *derived;
        self.complete(arrival, confirm, &answer, peer, &agreed, confirmation)
    }

    fn prove_pairing(
        &mut self,
        now: Duration,
        arrival: &Arrival<A>,
        confirm: &Message,
        store: &mut dyn ResponderStore,
    ) -> Result<(), Ignored> {
        let open = self
            .pairing
            .as_ref()
            .and_then(|window| window.slots.find(confirm.session))
            .filter(|open| fits(open, confirm))
            .ok_or(Ignored::Session)?;
        if !self.limits.admit(arrival.from, arrival.claim, now) {
            return Err(Ignored::Limited);
        }
        let WaitsFor::Message { ephemeral, facts } = &open.waits_for else {
            return Err(Ignored::Session);
        };
        // A forged step 3 corrupts a Noise state, so each try builds a new one.
        let Ok((mut noise, _)) = self.read_offer(Suite::Pairing, &open.offer, ephemeral) else {
            return Err(Ignored::Forged);
        };
        // Yields the same bytes as before, since all inputs are the same.
        let answer = self
            .write_answer(&mut noise, &open.offer, facts)
            .ok_or(Ignored::Forged)?;
        let Ok(payload) = noise.read([confirm.data.as_slice(), &[]]) else {
            self.note(ResponderEvent::WrongCode);
            return Err(Ignored::Forged);
        };
        let theirs = Facts::parse(payload.as_slice()).ok_or(Ignored::Forged)?;
        let key = noise.peer().ok_or(Ignored::Forged)?;
        let finished = noise.finish().ok_or(Ignored::Forged)?;
        let terms = Terms {
            parties: &self.config.parties,
            session: confirm.session,
            wanted: [self.config.wanted, theirs.wanted],
            epochs: [self.memory.epoch, theirs.epoch],
            peer: key,
        };
        let (agreed, confirmation) = derive(&finished, &terms).ok_or(Ignored::Forged)?;
        let counter = theirs.counter;
        let peer = PinnedPeer { key, counter };
        // On disk before step 4, as in suite 1.
        store
            .store_agreed(&peer, &agreed)
            .map_err(|cause| self.not_stored(cause))?;
        self.pairing = None;
        self.note(ResponderEvent::Paired { peer: key });
        self.complete(arrival, confirm, &answer, peer, &agreed, confirmation)
    }

    /// Both ends have both keys on disk.
    fn complete(
        &mut self,
        arrival: &Arrival<A>,
        confirm: &Message,
        answer: &Message,
        peer: PinnedPeer,
        agreed: &Agreed,
        confirmation: Confirmation,
    ) -> Result<(), Ignored> {
        let (key, epoch) = (agreed.key.id(), agreed.epoch);
        self.highest = peer.counter;
        // The gate costs a Diffie-Hellman, so it is kept for the same peer.
        if self.memory.peer.map(|known| known.key) != Some(peer.key) {
            self.gate = Gate::of_peers(&self.config.identity, &peer.key);
        }
        self.memory.peer = Some(peer);
        self.memory.epoch = epoch;
        self.memory.next = Some(StagedKey {
            id: key,
            sent: false,
        });
        self.half_open = None;
        let done = Done {
            from: arrival.from,
            gate: arrival.gate.clone(),
            confirm: confirm.clone(),
            ephemeral: answer.public_key,
            confirmation,
            outcome: Outcome {
                status: Status::Ok,
                reason: 0,
                seq: 0,
            },
        };
        let outcome = self.outcome(&done, confirm);
        self.done = Some(done);
        self.note(ResponderEvent::Staged { key, epoch });
        if let Some(outcome) = outcome {
            self.send(arrival, &outcome);
        }
        Ok(())
    }

    fn not_stored(&mut self, cause: StoreError) -> Ignored {
        self.note(ResponderEvent::NotStored(cause));
        Ignored::NotStored
    }
}

/// Whether step 3 belongs to the session: its number, its suite, the same ephemeral key as in step 1.
fn fits<A>(open: &HalfOpen<A>, confirm: &Message) -> bool {
    open.offer.session == confirm.session
        && open.offer.suite == confirm.suite
        && open.offer.public_key == confirm.public_key
}
