//! Any bytes at either end of an encrypted link, on a stream and in datagrams: they bring nothing inside but pairings, and take
//! nothing away from the keys that work.

use core::time::Duration;

use mavlink_link::Now;
use mavlink_link::encrypted::{Carrier, EncryptedConfig, EncryptedLink, MAX_WIRE, Role};
use mavlink_link::exchange::{Identity, Node, Parties};
use mavlink_link::frame::{FrameView, KEY_EXCHANGE_ID};
use mavlink_link::store::MemoryDisk;

const HEARTBEAT: [u8; 21] = [
    0xfd, 9, 0, 0, 0, 1, 1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 0, 0,
];

/// The first byte selects the carrier and how long the pieces are that the rest arrives in.
///
/// # Panics
/// The link passes something, or carries nothing afterwards.
pub fn run(input: &[u8]) {
    let Some((&flags, bytes)) = input.split_first() else {
        return;
    };
    let carrier = if flags & 1 == 0 {
        Carrier::Stream
    } else {
        Carrier::Datagrams
    };
    let node = |system, component| Node { system, component };
    let parties = Parties::new(node(245, 190), node(1, 191), 1, 2);
    let mut disks = [MemoryDisk::default(), MemoryDisk::default()];
    let mut seed = 1_u8;
    let mut random = |out: &mut [u8]| {
        out.iter_mut().for_each(|byte| {
            seed = seed.wrapping_mul(5).wrapping_add(3);
            *byte = seed;
        });
        Ok(())
    };
    let keys = || [Identity::new([1; 32]), Identity::new([2; 32])];
    let mut ends = [Role::Ground, Role::Air].map(|role| {
        let ([ground, air], at) = (keys(), usize::from(role == Role::Air));
        let (identity, peer) = if at == 0 {
            (ground, air)
        } else {
            (air, ground)
        };
        let config = EncryptedConfig {
            role,
            parties,
            identity,
            peer: Some(peer.public()),
            carrier,
            at: Some(()),
            before: None,
            linger: Duration::ZERO,
        };
        EncryptedLink::open(config, Duration::ZERO, &disks[at]).expect("no record")
    });
    let mut now = Now {
        mono: Duration::ZERO,
        wall: Duration::from_secs(1_800_000_000),
    };
    let mut got = [0, 0];
    // Agree; take what somebody has made up, all of it at both ends; then carry a frame each way still.
    for round in 0..3 {
        for _ in 0..20 {
            now = now.after(Duration::from_millis(100));
            for at in 0..2 {
                ends[at].handle_timeout(now, &mut random, &mut disks[at]);
                ends[at].send(now.mono, (), &HEARTBEAT);
                let mut out = [0; MAX_WIRE];
                while let Some(((), len)) =
                    ends[at].poll_transmit(now.mono, &mut disks[at], &mut out)
                {
                    let (to, wire) = (1 - at, &out[..len]);
                    let inner = ends[to].handle(now, (), wire, &mut random, &mut disks[to]);
                    got[to] += usize::from(inner == HEARTBEAT);
                }
            }
        }
        if round < 2 {
            for piece in bytes.chunks(1 + usize::from(flags >> 1)) {
                for at in 0..2 {
                    let inner = ends[at].handle(now, (), piece, &mut random, &mut disks[at]);
                    let mut rest = inner;
                    while !rest.is_empty() {
                        let frame = FrameView::parse(rest).expect("whole frames");
                        assert_eq!(frame.header().message_id, KEY_EXCHANGE_ID);
                        rest = &rest[frame.as_bytes().len()..];
                    }
                }
            }
            // A frame that was begun ends here.
            for at in 0..2 {
                ends[at].handle(now, (), &[0x7e], &mut random, &mut disks[at]);
            }
            got = [0, 0];
        }
    }
    assert!(got.iter().all(|&count| count >= 19), "{got:?}");
}
