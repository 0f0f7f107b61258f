//! Each attack, by name: what the attacker does, and that nothing comes of it.

use core::time::Duration;
use std::collections::VecDeque;

use mavlink_link::exchange::{
    Identity, Ignored, Inbound, Initiator, InitiatorConfig, InitiatorEvent, InitiatorMemory,
    Message, Node, PairingCode, Parties, Received, Responder, ResponderConfig, ResponderEvent,
    ResponderMemory, Status, Step, Trust, policy_digest,
};
use snow::params::{CipherChoice, DHChoice, HashChoice};
use snow::resolvers::{CryptoResolver, DefaultResolver};
use snow::types::{Cipher, Dh, Hash, Random};

use crate::disks::{AirDisk, GroundDisk};
use crate::world::{AIR, Dice, GROUND, Parcel, WANTED, World, ms, parties, wire};

/// What may not change under an attack.
fn picture(world: &World) -> String {
    let (ground, air) = (&world.ground_disk, &world.air_disk);
    format!(
        "{:?} {:?} {:?} {:?} {:?} {:?}",
        ground.current, ground.next, ground.peer, air.current, air.next, air.peer
    )
}

fn ignored(world: &World, end: &str, reason: Ignored) -> u64 {
    match end {
        "ground" => world.ground.as_ref().unwrap().stats().count_of(reason),
        _ => world.air.as_ref().unwrap().stats().count_of(reason),
    }
}

fn agreed(world: &World) -> usize {
    let events = world.events.iter();
    events
        .filter(|event| matches!(event, InitiatorEvent::Agreed { .. }))
        .count()
}

/// The exchange's next message, caught before it arrives; from the first on the test is the network.
fn catch(world: &mut World) -> Parcel {
    world.held.get_or_insert_default();
    for _ in 0..1_000 {
        if let Some(parcel) = world.held.as_mut().and_then(|held| held.pop_front()) {
            return parcel;
        }
        let next = world.now + ms(10);
        world.run_until(next);
    }
    panic!("no message within 10 s");
}

fn message(parcel: &Parcel) -> Message {
    let (Parcel::Up(payload) | Parcel::Down(payload)) = parcel else {
        panic!("{parcel:?}");
    };
    match Message::parse(payload) {
        Ok(Received::Exchange(message)) => message,
        other => panic!("{other:?}"),
    }
}

fn attacker(seed: u64, parties: Parties, trust: Trust) -> Initiator {
    let config = InitiatorConfig {
        parties,
        identity: Identity::new(Dice::new(seed).bytes()),
        trust,
        wanted: WANTED,
    };
    let mut initiator = Initiator::new(config, InitiatorMemory::default(), Duration::ZERO);
    initiator.want();
    initiator
}

fn first_message(world: &World, mut initiator: Initiator, seed: u64) -> Message {
    let mut disk = GroundDisk::default();
    initiator.handle_timeout(world.clock(), &mut Dice::new(seed).fill(), &mut disk);
    initiator.poll_transmit().unwrap()
}

#[test]
fn a_man_in_the_middle_with_keys_of_his_own_is_neither_end() {
    let mut world = World::paired(21);
    let before = picture(&world);
    // Towards the air, as the ground.
    let trust = Trust::Pinned(world.air_identity().public());
    let offer = first_message(&world, attacker(99, parties(), trust), 1);
    world.air_hears(7, GROUND, false, &offer.to_payload());
    assert_eq!(ignored(&world, "air", Ignored::Forged), 1);
    // Towards the ground, as the air: he pins the ground's public key and answers its step 1.
    let config = ResponderConfig {
        parties: parties(),
        identity: Identity::new([9; 32]),
        wanted: WANTED,
    };
    let memory = ResponderMemory {
        peer: Some(mavlink_link::exchange::PinnedPeer {
            key: world.ground_identity().public(),
            counter: 0,
        }),
        ..ResponderMemory::default()
    };
    let mut posing = Responder::new(config, memory, Duration::ZERO);
    let Parcel::Up(payload) = catch(&mut world) else {
        panic!("step 1");
    };
    let inbound = Inbound {
        from: 1_u8,
        source: GROUND,
        verified: false,
        payload: &payload,
    };
    let answered = posing.handle(
        Duration::ZERO,
        inbound,
        &mut Dice::new(2).fill(),
        &mut AirDisk::default(),
    );
    assert_eq!(answered, Err(Ignored::Forged));
    assert_eq!(picture(&world), before);
}

#[test]
fn a_man_in_the_middle_of_a_pairing_without_the_code_pairs_with_nobody() {
    let mut world = World::strangers(22);
    world.start_air();
    let code = world.code.duplicate();
    let air = world.air.as_mut().unwrap();
    air.open_window(ms(1_000), &code, &mut AirDisk::default())
        .unwrap();
    world.start_ground();
    // His own code towards both.
    let wrong = PairingCode::parse(&"A".repeat(32)).unwrap();
    let config = ResponderConfig {
        parties: parties(),
        identity: Identity::new([9; 32]),
        wanted: WANTED,
    };
    let mut as_air = Responder::new(config, ResponderMemory::default(), Duration::ZERO);
    as_air
        .open_window(Duration::ZERO, &wrong, &mut AirDisk::default())
        .unwrap();
    let mut his_disk = AirDisk::default();
    for _ in 0..2 {
        let Parcel::Up(payload) = catch(&mut world) else {
            panic!("from the ground");
        };
        let inbound = Inbound {
            from: 1_u8,
            source: GROUND,
            verified: false,
            payload: &payload,
        };
        let _ = as_air.handle(
            Duration::ZERO,
            inbound,
            &mut Dice::new(3).fill(),
            &mut his_disk,
        );
        while let Some(answer) = as_air.poll_transmit() {
            world.ground_hears(AIR, &answer.message.to_payload());
        }
    }
    assert_eq!(his_disk.next, None, "step 3 reveals nothing to him");
    assert_eq!(as_air.poll_event(), Some(ResponderEvent::WrongCode));
    assert_eq!(world.ground_disk.peer, None);
    assert_eq!(agreed(&world), 0);
}

#[test]
fn a_guessed_pairing_code_is_counted_and_the_honest_one_still_works() {
    let mut world = World::pairing(23);
    for guess in 0..30 {
        let mut disk = GroundDisk::default();
        let code = PairingCode::generate(&mut Dice::new(guess).fill()).unwrap();
        let mut initiator = attacker(200 + guess, parties(), Trust::Pairing(code));
        initiator.handle_timeout(world.clock(), &mut Dice::new(guess).fill(), &mut disk);
        let offer = initiator.poll_transmit().unwrap();
        let before = world.tape.len();
        world.air_hears(99, GROUND, false, &offer.to_payload());
        let now = world.clock();
        for parcel in world.tape[before..].iter().cloned() {
            if let Parcel::Down(payload) = parcel {
                let _ =
                    initiator.handle(now, crate::world::inbound(AIR, false, &payload), &mut disk);
            }
        }
        while let Some(confirm) = initiator.poll_transmit() {
            world.air_hears(99, GROUND, false, &confirm.to_payload());
        }
        world.run_until(world.now + ms(250));
    }
    let wrong = world.air_events.iter();
    let wrong = wrong.filter(|event| **event == ResponderEvent::WrongCode);
    assert!(wrong.count() > 0, "guesses were tried");
    assert!(world.run_until_settled(Duration::from_secs(60)).is_some());
}

#[test]
fn every_byte_of_every_message_bent_changes_nothing_and_the_true_one_still_does() {
    for begin in [World::paired, World::pairing] {
        let mut world = begin(24);
        for step in 0..4 {
            let parcel = catch(&mut world);
            let (Parcel::Up(payload) | Parcel::Down(payload)) = &parcel else {
                panic!("{parcel:?}");
            };
            let before = picture(&world);
            let count = agreed(&world);
            for at in 0..payload.len() {
                let mut bent = payload.clone();
                bent[at] ^= 1 << (at % 8);
                // The status of a header is unauthenticated and means nothing.
                if at == 39 {
                    continue;
                }
                match &parcel {
                    Parcel::Up(_) => {
                        // Below the limits of the responder, which are not the point here.
                        world.now += ms(60);
                        world.air_hears(at as u8, GROUND, false, &bent);
                    }
                    _ => world.ground_hears(AIR, &bent),
                }
                assert_eq!(picture(&world), before, "byte {at} of step {}", step + 1);
                assert_eq!(agreed(&world), count);
            }
            // The answers to the damaged ones are not part of the exchange.
            world.held = Some(VecDeque::new());
            world.deliver(&parcel);
        }
        assert_eq!(agreed(&world), 1);
    }
}

#[test]
fn replayed_messages_change_nothing_before_or_after_a_restart() {
    for begin in [World::paired, World::pairing] {
        let mut world = begin(25);
        assert!(world.run_until_settled(Duration::from_secs(30)).is_some());
        let tape = world.tape.clone();
        let (before, count) = (picture(&world), agreed(&world));
        for restart in [false, true] {
            if restart {
                world.kill_air(ms(10));
                world.kill_ground(ms(10));
                world.run_until(world.now + ms(50));
            }
            for parcel in tape.iter().chain(tape.iter().rev()) {
                world.deliver(parcel);
                world.run_until(world.now + ms(300));
            }
            assert_eq!(picture(&world), before, "restart {restart}");
        }
        assert_eq!(agreed(&world), count);
    }
}

#[test]
fn reflected_messages_change_nothing() {
    let mut world = World::paired(26);
    for _ in 0..4 {
        let parcel = catch(&mut world);
        let before = picture(&world);
        match &parcel {
            Parcel::Up(payload) => {
                // As it is, and readdressed so that it looks like the peer's.
                let mut message = message(&parcel);
                message.target = GROUND;
                world.ground_hears(GROUND, payload);
                world.ground_hears(AIR, &message.to_payload());
            }
            Parcel::Down(payload) => {
                let mut message = message(&parcel);
                message.target = AIR;
                world.air_hears(7, AIR, false, payload);
                world.air_hears(7, GROUND, false, &message.to_payload());
            }
            Parcel::Telemetry(_) => {}
        }
        assert_eq!(picture(&world), before);
        world.deliver(&parcel);
    }
    assert!(ignored(&world, "ground", Ignored::Reflected) >= 2);
    assert!(ignored(&world, "air", Ignored::Reflected) >= 2);
    assert_eq!(agreed(&world), 1);
}

#[test]
fn messages_of_another_session_change_nothing() {
    let mut world = World::paired(27);
    assert!(world.run_until_settled(Duration::from_secs(30)).is_some());
    world.run_until(world.now + ms(500));
    let old: Vec<Message> = world.tape.iter().map(message).collect();
    world.ground.as_mut().unwrap().want();
    for _ in 0..4 {
        let parcel = catch(&mut world);
        let (before, current) = (picture(&world), message(&parcel));
        for message in &old {
            // As it was, and under the number and the ephemeral key of the session that is open.
            let renumbered = Message {
                session: current.session,
                ..message.clone()
            };
            let dressed = Message {
                public_key: current.public_key,
                ..renumbered.clone()
            };
            if current.step == message.step && dressed == current {
                continue;
            }
            for message in [message, &renumbered, &dressed] {
                world.now += ms(60);
                match parcel {
                    Parcel::Up(_) => world.air_hears(99, GROUND, false, &message.to_payload()),
                    _ => world.ground_hears(AIR, &message.to_payload()),
                }
            }
        }
        assert_eq!(picture(&world), before, "{:?}", current.step);
        world.held = Some(VecDeque::new());
        world.deliver(&parcel);
    }
    assert_eq!(agreed(&world), 2);
}

#[test]
fn an_all_zero_point_is_refused_by_either_end() {
    // A first message of a pairing needs no secret: everything but the point is right.
    let mut world = World::pairing(28);
    let session = 5_u32;
    let mut prologue = b"vsm-key-agreement/1\0\x02".to_vec();
    prologue.extend([245, 190, 1, 191]);
    prologue.extend(0x1b00_0001_u32.to_be_bytes());
    prologue.extend(0x1b00_0101_u32.to_be_bytes());
    prologue.extend(session.to_le_bytes());
    prologue.extend(parties().policy);
    let honest = message(&catch(&mut world));
    for (points, answers) in [(ZeroPoint(false), 1), (ZeroPoint(true), 0)] {
        let name = "Noise_XXpsk3_25519_ChaChaPoly_SHA256";
        let mut noise = snow::Builder::with_resolver(name.parse().unwrap(), Box::new(points))
            .local_private_key(&[1; 32])
            .unwrap()
            .prologue(&prologue)
            .unwrap()
            .psk(3, &[2; 32])
            .unwrap()
            .build_initiator()
            .unwrap();
        let mut bytes = [0; 128];
        let len = noise.write_message(&[], &mut bytes).unwrap();
        let mut offer = honest.clone();
        offer.session = session;
        offer.public_key.copy_from_slice(&bytes[..32]);
        offer.data = mavlink_link::exchange::Data::new(&bytes[32..len]).unwrap();
        // He has the code, too.
        let offer = authenticated(&code_secret(&world), b"vsm/2 pairing gate", &offer, 32);
        let before = world.tape.len();
        world.air_hears(42, GROUND, false, &offer.to_payload());
        let down = world.tape[before..].iter();
        let down = down.filter(|parcel| matches!(parcel, Parcel::Down(_)));
        assert_eq!(down.count(), answers, "zero: {}", answers == 0);
        world.kill_air(ms(10));
        world.run_until(world.now + ms(20));
        world.person();
    }
    // And at the ground: a step 2 with a zero point never decrypts.
    let mut world = World::paired(28);
    let offer = catch(&mut world);
    world.deliver(&offer);
    world.run_until(world.now + ms(1));
    let mut answer = message(world.tape.last().unwrap());
    assert_eq!(answer.step, Step::Answer);
    answer.public_key = [0; 32];
    let before = picture(&world);
    // As it is, and with the authenticator of the pinned keys.
    world.ground_hears(AIR, &answer.to_payload());
    let data = answer.data.as_slice();
    answer.data = mavlink_link::exchange::Data::new(&data[..data.len() - 16]).unwrap();
    let own = x25519_dalek::StaticSecret::from(*world.ground_identity().expose());
    let shared = own.diffie_hellman(&(*world.air_identity().public().bytes()).into());
    let sealed = authenticated(shared.as_bytes(), b"vsm/2 pinned gate", &answer, 16);
    world.ground_hears(AIR, &sealed.to_payload());
    assert_eq!(picture(&world), before);
    assert_eq!(ignored(&world, "ground", Ignored::Forged), 2);
}

/// The pre-shared key of the world's code, from what a person reads.
fn code_secret(world: &World) -> [u8; 32] {
    let text = world.code.text().replace('-', "");
    let mut bits = Vec::new();
    for letter in text.bytes() {
        let value = match letter {
            b'A'..=b'Z' => letter - b'A',
            _ => letter - b'2' + 26,
        };
        bits.extend((0..5).rev().map(|bit| value >> bit & 1));
    }
    let code: Vec<u8> = (bits.chunks(8))
        .map(|byte| byte.iter().fold(0, |byte, bit| byte << 1 | bit))
        .collect();
    expanded(&code, b"vsm/1 pair")
}

fn expanded(secret: &[u8], info: &[u8]) -> [u8; 32] {
    let mut key = [0; 32];
    let hkdf = hkdf::Hkdf::<sha2::Sha256>::new(None, secret);
    hkdf.expand(info, &mut key).unwrap();
    key
}

/// A message with its first authenticator, made here from the documented layout.
fn authenticated(secret: &[u8; 32], info: &[u8], message: &Message, trailer: usize) -> Message {
    use hmac::{KeyInit as _, Mac as _};
    let plain = message.data.as_slice();
    let mut mac = hmac::Hmac::<sha2::Sha256>::new_from_slice(&expanded(secret, info)).unwrap();
    mac.update(b"first");
    mac.update(&message.to_payload()[..43 + plain.len()]);
    let mut data = plain.to_vec();
    data.extend_from_slice(&mac.finalize().into_bytes()[..16]);
    data.resize(plain.len() + trailer, 0);
    Message {
        data: mavlink_link::exchange::Data::new(&data).unwrap(),
        ..message.clone()
    }
}

/// The primitives of an attacker whose ephemeral point is all zero, or is not.
struct ZeroPoint(bool);

impl CryptoResolver for ZeroPoint {
    fn resolve_rng(&self) -> Option<Box<dyn Random>> {
        Some(Box::new(Sevens))
    }

    fn resolve_dh(&self, choice: &DHChoice) -> Option<Box<dyn Dh>> {
        let honest = DefaultResolver.resolve_dh(choice)?;
        Some(Box::new(Point {
            honest,
            zero: self.0,
        }))
    }

    fn resolve_hash(&self, choice: &HashChoice) -> Option<Box<dyn Hash>> {
        DefaultResolver.resolve_hash(choice)
    }

    fn resolve_cipher(&self, choice: &CipherChoice) -> Option<Box<dyn Cipher>> {
        DefaultResolver.resolve_cipher(choice)
    }
}

struct Sevens;

impl Random for Sevens {
    fn try_fill_bytes(&mut self, out: &mut [u8]) -> Result<(), snow::Error> {
        out.fill(7);
        Ok(())
    }
}

struct Point {
    honest: Box<dyn Dh>,
    zero: bool,
}

impl Dh for Point {
    fn name(&self) -> &'static str {
        "25519"
    }

    fn pub_len(&self) -> usize {
        32
    }

    fn priv_len(&self) -> usize {
        32
    }

    fn set(&mut self, secret: &[u8]) {
        self.honest.set(secret);
    }

    fn generate(&mut self, random: &mut dyn Random) -> Result<(), snow::Error> {
        self.honest.generate(random)
    }

    fn pubkey(&self) -> &[u8] {
        if self.zero {
            &[0; 32]
        } else {
            self.honest.pubkey()
        }
    }

    fn privkey(&self) -> &[u8] {
        self.honest.privkey()
    }

    fn dh(&self, public: &[u8], out: &mut [u8]) -> Result<(), snow::Error> {
        self.honest.dh(public, out)
    }
}

#[test]
fn a_wrong_prologue_in_any_one_field_agrees_about_nothing() {
    let right = parties();
    let other = Node {
        system: 9,
        component: 9,
    };
    let mut wrong = vec![];
    for change in [
        |p: &mut Parties, n: Node| p.initiator.system = n.system,
        |p: &mut Parties, n: Node| p.initiator.component = n.component,
        |p: &mut Parties, n: Node| p.responder.system = n.system,
        |p: &mut Parties, n: Node| p.responder.component = n.component,
        |p: &mut Parties, _| p.vsm_id ^= 1,
        |p: &mut Parties, _| p.vehicle_id ^= 0x8000_0000,
        |p: &mut Parties, _| p.policy = policy_digest("another policy"),
    ] {
        let mut parties = right;
        change(&mut parties, other);
        wrong.push(parties);
    }
    for (field, parties) in wrong.into_iter().enumerate() {
        let mut world = World::paired(29);
        let before = picture(&world);
        // The true ground in all but one field; its messages are addressed so that they arrive.
        let config = InitiatorConfig {
            parties,
            identity: world.ground_identity().duplicate(),
            trust: Trust::Pinned(world.air_identity().public()),
            wanted: WANTED,
        };
        let mut initiator = Initiator::new(config, InitiatorMemory::default(), Duration::ZERO);
        initiator.want();
        let mut offer = first_message(&world, initiator, 1);
        offer.target = AIR;
        world.air_hears(7, GROUND, false, &offer.to_payload());
        assert_eq!(ignored(&world, "air", Ignored::Forged), 1, "field {field}");
        assert_eq!(picture(&world), before);
    }
    // Suite and session stand in the message itself.
    let mut world = World::paired(29);
    let offer = message(&catch(&mut world));
    let before = picture(&world);
    let session = offer.session ^ 1;
    world.air_hears(
        7,
        GROUND,
        false,
        &Message {
            session,
            ..offer.clone()
        }
        .to_payload(),
    );
    assert_eq!(ignored(&world, "air", Ignored::Forged), 1);
    world.air_hears(
        7,
        GROUND,
        false,
        &Message { suite: 2, ..offer }.to_payload(),
    );
    assert_eq!(ignored(&world, "air", Ignored::Window), 1);
    assert_eq!(picture(&world), before);
}

#[test]
fn an_unknown_suite_or_version_is_refused_and_nothing_is_negotiated() {
    let mut world = World::paired(30);
    let offer = message(&catch(&mut world));
    for (bent, reason) in [
        (
            Message {
                suite: 3,
                ..offer.clone()
            },
            Ignored::Suite,
        ),
        (
            Message {
                suite: 0,
                ..offer.clone()
            },
            Ignored::Suite,
        ),
        (
            Message {
                version: 3,
                ..offer.clone()
            },
            Ignored::Version,
        ),
    ] {
        let (before, count) = (picture(&world), ignored(&world, "air", reason));
        let sent = world.tape.len();
        world.air_hears(7, GROUND, false, &bent.to_payload());
        assert_eq!(ignored(&world, "air", reason), count + 1);
        let answer = message(&world.tape[sent]);
        let status = match reason {
            Ignored::Version => Status::OtherVersion,
            _ => Status::Refused,
        };
        assert_eq!((answer.step, answer.status), (Step::Reject, status));
        // The ground reports what it receives of it, and continues as before.
        world.ground_hears(AIR, &answer.to_payload());
        assert_eq!(picture(&world), before);
    }
    world.held = None;
    world.deliver(&Parcel::Up(wire(&offer.to_payload())));
    assert!(world.run_until_settled(Duration::from_secs(20)).is_some());
    assert_eq!(agreed(&world), 1);
}

#[test]
fn a_downgrade_to_the_legacy_exchange_is_not_followed() {
    let mut world = World::paired(31);
    let before = picture(&world);
    for at in 0..20 {
        world.treatments.insert(at, crate::world::Treatment::Lose);
    }
    for _ in 0..20 {
        world.ground_hears(AIR, &[8; 32]);
        world.air_hears(7, GROUND, false, &[8; 32]);
        let mut old = [8; 203];
        old[36] = 0;
        world.ground_hears(AIR, &old);
        world.air_hears(7, GROUND, false, &old);
        world.run_until(world.now + ms(1_000));
    }
    assert_eq!(ignored(&world, "ground", Ignored::Legacy), 40);
    assert_eq!(ignored(&world, "air", Ignored::Legacy), 40);
    assert_eq!(picture(&world), before);
}

#[test]
fn rejections_by_anyone_change_nothing() {
    let mut world = World::paired(32);
    let mut reject = message(&catch(&mut world));
    (reject.step, reject.target) = (Step::Reject, GROUND);
    for status in 0..12 {
        reject.status = Status::from(status);
        world.ground_hears(AIR, &reject.to_payload());
    }
    world.held = None;
    assert!(world.run_until_settled(Duration::from_secs(20)).is_some());
    assert_eq!(agreed(&world), 1);
}

/// A flood of well-formed first messages of other senders, `a_second` of them, while an honest exchange runs.
fn flood(world: &mut World, a_second: u64, address: impl Fn(u64) -> u8, verified: bool) -> bool {
    let trust = Trust::Pinned(world.air_identity().public());
    let pairing = PairingCode::parse(&"B".repeat(32)).unwrap();
    let pinned = first_message(world, attacker(77, parties(), trust), 1);
    let pairing = first_message(world, attacker(78, parties(), Trust::Pairing(pairing)), 1);
    let end = world.now + Duration::from_secs(60);
    let mut n = 0;
    while world.now < end {
        let next = world.now + ms(1_000) / a_second as u32;
        run_with_honest_frames_verified(world, next, verified);
        n += 1;
        for mut message in [pinned.clone(), pairing.clone()] {
            message.session = n as u32 + 1;
            world.air_hears(address(n), GROUND, false, &message.to_payload());
        }
        if world.is_settled() && agreed(world) > 0 {
            return true;
        }
    }
    false
}

/// As [`World::run_until`], with the ground's own frames verified under the current key where it has one.
fn run_with_honest_frames_verified(world: &mut World, until: Duration, verified: bool) {
    if !verified {
        return world.run_until(until);
    }
    let seen = world.tape.len();
    world.run_until(until);
    let fresh = world.tape[seen..].to_vec();
    for parcel in fresh {
        if let Parcel::Up(payload) = parcel {
            world.air_hears(7, GROUND, true, &payload);
        }
    }
}

#[test]
fn an_honest_exchange_succeeds_under_a_flood_of_first_messages() {
    // Signed under the current key, from one and from many addresses.
    let mut world = World::paired(33);
    assert!(flood(&mut world, 1_000, |_| 200, true));
    let mut world = World::paired(34);
    assert!(flood(&mut world, 1_000, |n| n as u8, true));
    // A pairing, when nothing can be signed yet, beside another address that floods.
    let mut world = World::pairing(35);
    assert!(flood(&mut world, 1_000, |_| 200, false));
    // None of them came as far as a limit that the honest messages need.
    let forged = ignored(&world, "air", Ignored::Forged);
    assert!(forged > 100, "{forged} were forged");
    assert_eq!(ignored(&world, "air", Ignored::Limited), 0);
}

#[test]
fn a_stolen_old_counter_is_of_no_use() {
    let mut world = World::paired(36);
    let stolen = world.ground_disk.clone();
    assert!(world.run_until_settled(Duration::from_secs(30)).is_some());
    let before = picture(&world);
    // A copy of the ground's disk from before the last exchange, on a computer whose clock stands still.
    let config = InitiatorConfig {
        parties: parties(),
        identity: world.ground_identity().duplicate(),
        trust: Trust::Pinned(world.air_identity().public()),
        wanted: WANTED,
    };
    let mut thief = Initiator::new(config, stolen.memory(), Duration::ZERO);
    thief.want();
    let mut clock = world.clock();
    clock.wall = Duration::from_secs(1_800_000_000);
    let mut disk = stolen;
    thief.handle_timeout(clock, &mut Dice::new(1).fill(), &mut disk);
    let offer = thief.poll_transmit().unwrap();
    for restart in [false, true] {
        if restart {
            world.kill_air(ms(10));
            world.run_until(world.now + ms(50));
        }
        world.air_hears(7, GROUND, false, &offer.to_payload());
        assert_eq!(ignored(&world, "air", Ignored::OldCounter), 1);
        assert_eq!(picture(&world), before, "restart {restart}");
    }
}
