//! Pairing while forty others send first messages, a hundred a second each: who has no code costs the air side no
//! Diffie-Hellman and no session, and the pairing takes as long as without them.

#![expect(clippy::print_stdout, reason = "the figures are what it is for")]

use core::time::Duration;

use mavlink_link::exchange::{
    Identity, Ignored, Inbound, Initiator, InitiatorConfig, InitiatorEvent, InitiatorMemory,
    Message, PairingCode, Received, Responder, ResponderConfig, ResponderMemory, Status, Step,
    Trust,
};

use crate::disks::{AirDisk, GroundDisk};
use crate::world::{Dice, GROUND, Parcel, WANTED, Weather, World, inbound, ms, parties};

const ADDRESSES: u32 = 40;

/// Step 1 of somebody with this code.
fn first_message(code: &PairingCode, seed: u64) -> (Initiator, Message) {
    let config = InitiatorConfig {
        parties: parties(),
        identity: Identity::new(Dice::new(seed).bytes()),
        trust: Trust::Pairing(code.duplicate()),
        wanted: WANTED,
    };
    let mut initiator = Initiator::new(config, InitiatorMemory::default(), Duration::ZERO);
    initiator.want();
    let now = mavlink_link::Now {
        mono: Duration::ZERO,
        wall: Duration::from_secs(1_800_000_000),
    };
    initiator.handle_timeout(now, &mut Dice::new(seed).fill(), &mut GroundDisk::default());
    let message = initiator.poll_transmit().unwrap();
    (initiator, message)
}

fn wrong_code() -> PairingCode {
    PairingCode::parse(&"B".repeat(32)).unwrap()
}

/// The nth message of those without the code: first and third messages, well-formed and not, with wrong
/// authenticators, of other versions.
fn forged(template: &Message, n: u32) -> Message {
    let mut message = Message {
        session: n.wrapping_mul(2_654_435_761) | 1,
        ..template.clone()
    };
    match n % 4 {
        0 => message.step = Step::Confirm,
        1 => message.version = 1,
        2 => message.public_key = [n as u8 | 1; 32],
        _ => {}
    }
    message
}

struct Window {
    responder: Responder<u32>,
    disk: AirDisk,
    code: PairingCode,
    /// How often random bytes were drawn: an ephemeral key for each handshake that was begun.
    drawn: u32,
}

impl Window {
    fn open() -> Window {
        let config = ResponderConfig {
            parties: parties(),
            identity: Identity::new([9; 32]),
            wanted: WANTED,
        };
        let mut window = Window {
            responder: Responder::new(config, ResponderMemory::default(), Duration::ZERO),
            disk: AirDisk::default(),
            code: PairingCode::generate(&mut Dice::new(3).fill()).unwrap(),
            drawn: 0,
        };
        let (responder, disk) = (&mut window.responder, &mut window.disk);
        responder.open_window(ms(1), &window.code, disk).unwrap();
        window
    }

    /// The answers, by step and length of their payload.
    fn receive(&mut self, at: Duration, from: u32, message: &Message) -> Vec<Message> {
        let (drawn, mut dice) = (&mut self.drawn, Dice::new(u64::from(from) + 5));
        let mut random = |out: &mut [u8]| {
            *drawn += 1;
            dice.fill()(out)
        };
        let payload = message.to_payload();
        let inbound = Inbound {
            from,
            source: GROUND,
            verified: false,
            payload: &payload,
        };
        let _ = self
            .responder
            .handle(at, inbound, &mut random, &mut self.disk);
        let answers = std::iter::from_fn(|| self.responder.poll_transmit());
        answers.map(|answer| answer.message).collect()
    }
}

fn used(message: &Message) -> usize {
    43 + message.data.as_slice().len()
}

#[test]
fn whoever_has_no_code_costs_no_handshake_no_session_and_little_air() {
    let mut window = Window::open();
    let (_, template) = first_message(&wrong_code(), 1);
    let mut answers = 0;
    for n in 0..120_000 {
        let at = ms(2) + Duration::from_micros(250) * n;
        let message = forged(&template, n);
        for answer in window.receive(at, n % ADDRESSES, &message) {
            assert_eq!(answer.step, Step::Reject);
            answers += 1;
        }
    }
    assert_eq!(window.drawn, 0, "a handshake was begun");
    assert_eq!(window.responder.stats().taken, 0);
    assert!(answers <= 5 * 31, "{answers} refusals in 30 s");
    // And the first honest message after all that is answered at once.
    let (_, honest) = first_message(&window.code, 2);
    let answer = window.receive(Duration::from_secs(31), 7, &honest);
    assert_eq!(
        answer.iter().map(|one| one.step).collect::<Vec<_>>(),
        [Step::Answer]
    );
    assert_eq!(window.drawn, 1);
}

#[test]
fn a_recorded_first_message_costs_one_handshake_and_no_more_air_than_it_takes() {
    let mut window = Window::open();
    let (_, honest) = first_message(&window.code, 2);
    assert_eq!(window.receive(ms(2), 7, &honest)[0].step, Step::Answer);
    let (mut up, mut down) = (0, 0);
    for n in 0..80_000 {
        let at = ms(3) + Duration::from_micros(250) * n;
        up += used(&honest);
        for answer in window.receive(at, 100 + n % ADDRESSES, &honest) {
            assert!(matches!(answer.step, Step::Answer | Step::Cookie));
            assert!(used(&answer) <= 3 * used(&honest));
            down += used(&answer);
        }
    }
    // The ephemeral key of the honest session, and the secret of the cookies. Once its session is over the recording
    // opens no other.
    assert!(window.drawn <= 3, "{}", window.drawn);
    assert!(down <= up, "{down} bytes for {up}");
    assert!(window.responder.stats().count_of(Ignored::Repeated) > 10_000);
}

#[test]
fn under_load_an_address_is_proven_by_a_cookie_that_is_of_no_use_elsewhere() {
    let mut window = Window::open();
    let (mut initiator, honest) = first_message(&window.code, 2);
    window.receive(ms(2), 7, &honest);
    // Somebody plays it until repetitions are answered to nobody; the honest answer was lost.
    for n in 0..100 {
        window.receive(ms(3), 100 + n, &honest);
        window.receive(ms(3), 7, &honest);
    }
    let asked = window.receive(ms(3), 7, &honest);
    assert_eq!(asked[0].step, Step::Cookie);
    let clock = mavlink_link::Now {
        mono: ms(3),
        wall: Duration::from_secs(1_800_000_000),
    };
    let payload = asked[0].to_payload();
    let air = parties().responder;
    initiator
        .handle(
            clock,
            inbound(air, false, &payload),
            &mut GroundDisk::default(),
        )
        .unwrap();
    let proven = initiator.poll_transmit().unwrap();
    assert_eq!(window.receive(ms(4), 100, &proven)[0].step, Step::Cookie);
    assert_eq!(window.receive(ms(4), 7, &proven)[0].step, Step::Answer);
    // A cookie in the ground's name that nobody with the code has made.
    let mut bent = asked[0].clone();
    bent.data = mavlink_link::exchange::Data::new(&[1; 32]).unwrap();
    let refused = initiator.handle(
        clock,
        inbound(air, false, &bent.to_payload()),
        &mut GroundDisk::default(),
    );
    assert_eq!(refused, Err(Ignored::Forged));
}

#[test]
fn another_version_is_refused_by_name_in_its_own_words() {
    let mut window = Window::open();
    let (_, mut old) = first_message(&window.code, 2);
    old.version = 1;
    let answer = &window.receive(ms(2), 7, &old)[0];
    let found = (answer.step, answer.version, answer.status);
    assert_eq!(found, (Step::Reject, 1, Status::OtherVersion));
    // And an older agent reports it to a newer ground: it refuses in version 1.
    let mut world = World::pairing(4);
    world.run_until(world.now + ms(5));
    let mut refusal = answer.clone();
    (refusal.target, refusal.status) = (GROUND, Status::Refused);
    world.ground_hears(crate::world::AIR, &refusal.to_payload());
    let status = Status::OtherVersion;
    assert!(world.events.contains(&InitiatorEvent::Rejected { status }));
}

/// How long a pairing takes beside so many addresses that send a hundred messages a second each: forged ones, and the
/// honest ones again.
fn pairing_beside(addresses: u32, seed: u64, loss: u64) -> Duration {
    let mut world = World::pairing(seed);
    world.addressed = true;
    // The vehicle stays armed: the key rollover follows, which has its own timing.
    world.armed = true;
    world.weather = Weather {
        loss,
        ..Weather::default()
    };
    let (_, template) = first_message(&wrong_code(), seed);
    let begun = world.now;
    let mut n = 0_u32;
    while !world.is_paired() {
        let next = world.now + ms(1);
        world.run_until(next);
        let recorded: Vec<Vec<u8>> = (world.tape.iter().rev())
            .filter_map(|parcel| match parcel {
                Parcel::Up(payload) => Some(payload.clone()),
                _ => None,
            })
            .take(4)
            .collect();
        for _ in 0..addresses / 10 {
            n += 1;
            let from = 100 + (n % addresses) as u8;
            let payload = match recorded.get(n as usize % 8) {
                Some(recorded) => recorded.clone(),
                None => forged(&template, n).to_payload().to_vec(),
            };
            world.air_hears(from, GROUND, false, &payload);
        }
        assert!(world.now - begun < Duration::from_secs(300), "starved");
    }
    world.now - begun
}

#[test]
fn forty_addresses_do_not_delay_a_pairing() {
    const RUNS: u64 = 100;
    for loss in [0, 10] {
        let [alone, beside] = [0, ADDRESSES].map(|addresses| {
            let times = (0..RUNS).map(|n| pairing_beside(addresses, 7_000 + n, loss));
            let mut times: Vec<Duration> = times.collect();
            times.sort();
            let at = |percent: usize| times[(times.len() - 1) * percent / 100].as_secs_f64();
            println!(
                "pairing beside {addresses} addresses with 100 messages a second each, {loss} % lost: \
                 {:.2} s median, {:.2} s p99",
                at(50),
                at(99)
            );
            [at(50), at(99)]
        });
        assert!(
            beside[0] <= alone[0] + 0.05,
            "median: {beside:?}, {alone:?}"
        );
        // One retry more: which messages are lost is another draw.
        assert!(beside[1] <= alone[1] + 8.0, "p99: {beside:?}, {alone:?}");
    }
}

#[test]
fn the_longest_message_fits_its_frame() {
    let mut world = World::pairing(9);
    world.run_until(world.now + Duration::from_secs(1));
    let mut steps = Vec::new();
    for parcel in &world.tape {
        let (Parcel::Up(payload) | Parcel::Down(payload)) = parcel else {
            continue;
        };
        let Ok(Received::Exchange(message)) = Message::parse(payload) else {
            panic!("{payload:?}");
        };
        assert!(used(&message) <= 203);
        steps.push((message.step, message.data.as_slice().len()));
    }
    assert_eq!(
        steps,
        [
            (Step::Offer, 48),
            (Step::Answer, 104),
            (Step::Confirm, 120),
            (Step::Outcome, 56)
        ]
    );
}
