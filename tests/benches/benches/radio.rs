//! What PX4's low-bandwidth streams take of a radio of 57,600 baud: plain, signed, and signed and encrypted, each over a serial
//! line of its own that is as slow, side by side for a minute. Prints a Markdown table; `cargo bench -p comparison-benches
//! --bench radio`.
//!
//! The lines are pseudo terminals. Counted is what has come through them, and how long each frame was on its way, from when
//! it was handed to the agent's end until the ground's end had it.

#![allow(clippy::print_stdout, reason = "figures are printed")]

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant};

use kit::serial::{Line, Port};
use kit::streams::LOW_BANDWIDTH;
use mavlink_link::Now;
use mavlink_link::encrypted::{
    Carrier, EncryptedConfig, EncryptedLink, EncryptedState, MAX_WIRE, Role,
};
use mavlink_link::exchange::{Identity, NoRandom, Node, Parties};
use mavlink_link::frame::{Header, INCOMPAT_SIGNED, MAX_FRAME, Parser, encode_raw};
use mavlink_link::signing::{SigningKey, Stamp, sign};
use mavlink_link::store::MemoryDisk;

fn main() {
    // `cargo test --benches` asks for nothing to be measured.
    if !std::env::args().any(|argument| argument == "--bench") {
        return;
    }
    println!(
        "| PX4's low-bandwidth streams at 57,600 baud, {} s | bytes/s | of the radio | frames lost | on its way p50 | p99 |",
        SPAN.as_secs()
    );
    println!("|---|---|---|---|---|---|");
    for together in [true, false] {
        let runs = KINDS.map(|kind| thread::spawn(move || run(kind, together)));
        for (kind, run) in KINDS.into_iter().zip(runs) {
            let Measured {
                bytes_s,
                lost,
                mut ages,
            } = run.join().expect("no panic");
            ages.sort();
            let age = |part: f64| ages[(ages.len() as f64 * part) as usize].as_millis();
            println!(
                "| {}, {} | {bytes_s:.0} | {:.0} % | {lost} of {} | {} ms | {} ms |",
                kind.name(),
                if together {
                    "started together"
                } else {
                    "spread"
                },
                bytes_s / 57.6,
                lost + ages.len(),
                age(0.5),
                age(0.99)
            );
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Plain,
    Signed,
    Encrypted,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Kind::Plain => "plain",
            Kind::Signed => "signed",
            Kind::Encrypted => "signed, encrypted",
        }
    }
}

const KINDS: [Kind; 3] = [Kind::Plain, Kind::Signed, Kind::Encrypted];

struct Measured {
    bytes_s: f64,
    lost: usize,
    ages: Vec<Duration>,
}

/// One end of a line.
struct End {
    port: Port,
    /// Where the link is encrypted.
    link: Option<Encrypted>,
}

struct Encrypted {
    link: EncryptedLink<u8>,
    disk: MemoryDisk,
}

impl End {
    fn open(kind: Kind, role: Role, name: &str) -> End {
        End {
            port: Port::open(name),
            link: (kind == Kind::Encrypted).then(|| Encrypted::paired(role)),
        }
    }

    fn send(&mut self, now: Now, frame: &[u8]) {
        match &mut self.link {
            Some(encrypted) => encrypted.link.send(now.mono, 0, frame),
            None => self.port.write(frame),
        }
        self.work(now);
    }

    /// Does what is due.
    fn work(&mut self, now: Now) {
        if let Some(Encrypted { link, disk }) = &mut self.link {
            link.handle_timeout(now, &mut random, disk);
            let mut out = [0; MAX_WIRE];
            while let Some((_, length)) = link.poll_transmit(now.mono, disk, &mut out) {
                self.port.write(&out[..length]);
            }
        }
    }

    /// The frames that have arrived.
    fn receive(&mut self, now: Now) -> Vec<u8> {
        let mut bytes = [0; 1_024];
        let length = self.port.read(&mut bytes);
        match &mut self.link {
            Some(Encrypted { link, disk }) => link
                .handle(now, 0, &bytes[..length], &mut random, disk)
                .to_vec(),
            None => bytes[..length].to_vec(),
        }
    }
}

impl Encrypted {
    fn paired(role: Role) -> Encrypted {
        let (ground, air) = (Identity::new([0x11; 32]), Identity::new([0x22; 32]));
        let (identity, peer) = match role {
            Role::Ground => (ground, air),
            Role::Air => (air, ground),
        };
        let node = |system, component| Node { system, component };
        let config = EncryptedConfig {
            role,
            parties: Parties::new(node(245, 190), node(1, 191), 0x1b00_0001, 0x1b00_0101),
            identity,
            peer: Some(peer.public()),
            carrier: Carrier::Stream,
            at: Some(0),
            before: None,
            // As in `vsm run` and `vsm airside`.
            linger: match role {
                Role::Ground => Duration::ZERO,
                Role::Air => Duration::from_millis(5),
            },
        };
        let disk = MemoryDisk::default();
        Encrypted {
            link: EncryptedLink::open(config, Duration::ZERO, &disk).expect("it opens"),
            disk,
        }
    }
}

fn run(kind: Kind, together: bool) -> Measured {
    let (line, names) = Line::at_baud(57_600);
    let begun = Instant::now();
    let now = || Now {
        mono: begun.elapsed(),
        wall: WALL + begun.elapsed(),
    };
    let mut air = End::open(kind, Role::Air, &names[0]);
    let mut ground = End::open(kind, Role::Ground, &names[1]);
    if kind == Kind::Encrypted {
        // The keys first.
        while !air.is_ready(now().mono) {
            assert!(begun.elapsed() < Duration::from_secs(10), "no keys");
            for end in [&mut air, &mut ground] {
                end.receive(now());
                end.work(now());
            }
            ground.send(now(), &frame(kind, 0, 9, now()));
            thread::sleep(Duration::from_millis(20));
        }
        thread::sleep(Duration::from_millis(200));
        ground.receive(now());
    }
    let carried = line.carried()[0];
    let first = now().mono;
    let mut due: Vec<Duration> = (0..)
        .zip(LOW_BANDWIDTH)
        .map(|(at, (_, every))| {
            // Started together, as at a start of PX4; or spread over their periods.
            first + Duration::from_millis(if together { 0 } else { at * 37 % every })
        })
        .collect();
    let (mut sent, mut ages, mut parser) = (Vec::new(), Vec::new(), Parser::new());
    let mut next = 0;
    while now().mono < first + SPAN + Duration::from_secs(1) {
        for (due, (payload, every)) in due.iter_mut().zip(LOW_BANDWIDTH) {
            if *due <= now().mono && *due < first + SPAN {
                *due += Duration::from_millis(every);
                let frame = frame(kind, sent.len(), payload, now());
                sent.push(now().mono);
                air.send(now(), &frame);
            }
        }
        air.work(now());
        ground.work(now());
        let received = ground.receive(now());
        let mut frames = parser.feed(&received);
        while let Some(frame) = frames.next() {
            let Ok(frame) = frame else { continue };
            // Its number is known up to 256: on a line none overtakes another.
            let seq = usize::from(frame.header().seq);
            next += (seq + 256 - next % 256) % 256;
            if let Some(&at) = sent.get(next) {
                ages.push(now().mono.saturating_sub(at));
            }
            next += 1;
        }
        air.receive(now());
        thread::sleep(Duration::from_micros(500));
    }
    let bytes = line.carried()[0] - carried;
    Measured {
        bytes_s: bytes as f64 / SPAN.as_secs_f64(),
        lost: sent.len() - ages.len(),
        ages,
    }
}

impl End {
    fn is_ready(&self, now: Duration) -> bool {
        let state = |one: &Encrypted| one.link.state(now);
        self.link.as_ref().map(state) == Some(EncryptedState::Encrypted)
    }
}

/// A frame with a payload of this length, which is not trimmed.
fn frame(kind: Kind, number: usize, payload: usize, now: Now) -> Vec<u8> {
    let signed = kind != Kind::Plain;
    let header = Header {
        system_id: 1,
        component_id: 1,
        seq: number as u8,
        incompat: if signed { INCOMPAT_SIGNED } else { 0 },
        ..Header::default()
    };
    let mut out = [0; MAX_FRAME];
    let mut length = encode_raw(header, &vec![0x55; payload], &mut out).expect("it fits");
    if signed {
        let key = SigningKey::new([0x5a; 32]).expect("a key");
        let stamp = Stamp::new(Stamp::from_unix(now.wall).get() + number as u64);
        length = sign(&key, 0, stamp, &mut out, length).expect("it fits");
    }
    out[..length].to_vec()
}

/// Nothing is secret here.
fn random(out: &mut [u8]) -> Result<(), NoRandom> {
    static NEXT: AtomicU64 = AtomicU64::new(1);
    for byte in out {
        let next = NEXT.fetch_add(0x9e37_79b9_7f4a_7c15, Relaxed);
        *byte = (next.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 56) as u8;
    }
    Ok(())
}

const SPAN: Duration = Duration::from_secs(60);
const WALL: Duration = Duration::from_secs(1_795_219_200);
