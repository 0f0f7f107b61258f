//! Any bytes in a key exchange: as a payload; and as what moves both ends, an attacker on the line between them, and time.

use core::time::Duration;

use mavlink_link::Now;
use mavlink_link::exchange::*;

/// A payload of KEY_EXCHANGE, and a pairing code: read or refused, and what is read is written as it was.
///
/// # Panics
/// It is written differently.
pub fn message(payload: &[u8]) {
    if let Ok(Received::Exchange(message)) = Message::parse(payload) {
        let written = message.to_payload();
        assert_eq!(&written[..payload.len()], payload);
        assert!(written[payload.len()..].iter().all(|byte| *byte == 0));
        assert_eq!(Message::parse(&written), Ok(Received::Exchange(message)));
    }
    if let Ok(text) = core::str::from_utf8(payload)
        && let Ok(code) = PairingCode::parse(text)
    {
        assert_eq!(
            *PairingCode::parse(&code.text()).unwrap().text(),
            *code.text()
        );
    }
}

/// The initiator under any sequence of messages and timeouts: bytes of the input go to it.
///
/// # Panics
/// As [`responder`].
pub fn initiator(input: &[u8]) {
    run(true, input);
}

/// The responder under any sequence of messages and timeouts: bytes of the input go to it.
///
/// # Panics
/// The responder holds a key that the initiator does not hold.
pub fn responder(input: &[u8]) {
    run(false, input);
}

#[derive(Default)]
struct Disk {
    next: Option<[u8; 32]>,
    epoch: u32,
    writes: u8,
    fails_at: u8,
}

impl Disk {
    fn write(&mut self) -> Result<(), StoreError> {
        self.writes = self.writes.wrapping_add(1);
        if self.writes == self.fails_at {
            return Err(StoreError {
                reason: String::new(),
            });
        }
        Ok(())
    }

    fn keep(&mut self, agreed: &Agreed) -> Result<(), StoreError> {
        self.write()?;
        assert!(agreed.epoch > self.epoch);
        self.epoch = agreed.epoch;
        self.next = Some(*agreed.key.expose());
        Ok(())
    }
}

impl InitiatorStore for Disk {
    fn store_counter(&mut self, _: u64) -> Result<(), StoreError> {
        self.write()
    }
    fn promote_next(&mut self) -> Result<(), StoreError> {
        self.write()
    }
    fn store_next(&mut self, agreed: &Agreed) -> Result<(), StoreError> {
        self.keep(agreed)
    }
    fn drop_next(&mut self) -> Result<(), StoreError> {
        self.write()?;
        self.next = None;
        Ok(())
    }
    fn pin(&mut self, _: &PublicKey) -> Result<(), StoreError> {
        self.write()
    }
}

impl ResponderStore for Disk {
    fn withdraw_next(&mut self) -> Result<(), StoreError> {
        self.write()?;
        self.next = None;
        Ok(())
    }
    fn store_agreed(&mut self, _: &PinnedPeer, agreed: &Agreed) -> Result<(), StoreError> {
        self.keep(agreed)
    }
}

const GROUND: Node = Node {
    system: 245,
    component: 190,
};
const AIR: Node = Node {
    system: 1,
    component: 191,
};

/// Whatever the input is, a key that the responder holds is one that the initiator holds.
fn run(to_initiator: bool, input: &[u8]) {
    let Some((&[kind, fails_at], mut script)) = input.split_first_chunk::<2>() else {
        return;
    };
    let mut seed = 1_u64;
    let mut random = move |out: &mut [u8]| {
        for byte in out {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            *byte = (seed >> 56) as u8;
        }
        Ok(())
    };
    let wanted = Wanted {
        signing: true,
        confidential: kind & 2 != 0,
    };
    let parties = Parties::new(GROUND, AIR, 1, 2);
    let (ground, air) = (Identity::new([1; 32]), Identity::new([2; 32]));
    let code = PairingCode::generate(&mut random).unwrap();
    let (trust, peer) = if kind & 1 == 0 {
        let peer = PinnedPeer {
            key: ground.public(),
            counter: 0,
        };
        (Trust::Pinned(air.public()), Some(peer))
    } else {
        (Trust::Pairing(code.duplicate()), None)
    };
    let mut ground_disk = Disk {
        fails_at,
        ..Disk::default()
    };
    let mut air_disk = Disk {
        fails_at: fails_at.rotate_left(4),
        ..Disk::default()
    };
    let mut initiator = Initiator::new(
        InitiatorConfig {
            parties,
            identity: ground,
            trust,
            wanted,
        },
        InitiatorMemory::default(),
        Duration::ZERO,
    );
    let memory = ResponderMemory {
        peer,
        ..ResponderMemory::default()
    };
    let config = ResponderConfig {
        parties,
        identity: air,
        wanted,
    };
    let mut responder: Responder<u8> = Responder::new(config, memory, Duration::ZERO);
    if peer.is_none() {
        let _ = responder.open_window(Duration::ZERO, &code, &mut air_disk);
    }
    initiator.want();
    let mut mono = Duration::ZERO;
    let (mut up, mut down): (Vec<Message>, Vec<Message>) = (Vec::new(), Vec::new());
    while let Some((&[act, value], rest)) = script.split_first_chunk::<2>() {
        script = rest;
        mono += Duration::from_millis(u64::from(value) * if act & 0x80 == 0 { 0 } else { 20 });
        let now = Now {
            mono,
            wall: mono + Duration::from_secs(1_800_000_000),
        };
        let mut to_air = |responder: &mut Responder<u8>, disk: &mut Disk, payload: &[u8]| {
            let inbound = Inbound {
                from: value,
                source: GROUND,
                verified: act & 0x40 != 0,
                payload,
            };
            let _ = responder.handle(mono, inbound, &mut random, disk);
        };
        match act & 0x0f {
            // A message arrives, once or again.
            0..=3 => {
                if let Some(message) = up.get(usize::from(value) % up.len().max(1)) {
                    to_air(&mut responder, &mut air_disk, &message.to_payload());
                }
            }
            4..=7 => {
                if let Some(message) = down.get(usize::from(value) % down.len().max(1)) {
                    let _ = initiator.handle(
                        now,
                        from_air(AIR, &message.to_payload()),
                        &mut ground_disk,
                    );
                }
            }
            // The last one of the other end, bent in one byte.
            8 | 9 => {
                let source = if to_initiator { &down } else { &up };
                if let Some(message) = source.last() {
                    let mut payload = message.to_payload();
                    payload[usize::from(value) % MAX_MESSAGE] ^= act;
                    if to_initiator {
                        let _ = initiator.handle(now, from_air(AIR, &payload), &mut ground_disk);
                    } else {
                        to_air(&mut responder, &mut air_disk, &payload);
                    }
                }
            }
            // Bytes of the input itself.
            10 | 11 => {
                let (payload, rest) = script.split_at(usize::from(value).min(script.len()));
                script = rest;
                if to_initiator {
                    let _ = initiator.handle(now, from_air(AIR, payload), &mut ground_disk);
                } else {
                    to_air(&mut responder, &mut air_disk, payload);
                }
            }
            12 => initiator.want(),
            13 => responder.report(Status::from(value), act),
            14 => {
                let source = Node {
                    system: act,
                    component: value,
                };
                let _ = initiator.handle(now, from_air(source, script), &mut ground_disk);
            }
            _ => {}
        }
        initiator.handle_timeout(now, &mut random, &mut ground_disk);
        responder.handle_timeout(mono);
        while let Some(message) = initiator.poll_transmit() {
            up.push(message);
        }
        while let Some(outbound) = responder.poll_transmit() {
            down.push(outbound.message);
        }
        while initiator.poll_event().is_some() {}
        while responder.poll_event().is_some() {}
        let _ = (initiator.poll_timeout(), responder.poll_timeout());
        // A rolled-back key is one that the responder has dropped; here it only reports that.
        if let Some(key) = air_disk.next
            && ground_disk.next.is_some()
        {
            assert_eq!(ground_disk.next, Some(key));
        }
    }
}

fn from_air(source: Node, payload: &[u8]) -> Inbound<'_, ()> {
    Inbound {
        from: (),
        source,
        verified: false,
        payload,
    }
}
