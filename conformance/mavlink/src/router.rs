//! Rules of a router: the suite plays a vehicle at one end and a ground station at the other, and judges what is
//! forwarded.

use std::sync::Arc;
use std::time::Duration;

use conformance::verdict::{Judged, Stop};
use conformance::wire::Direction;

use crate::bench::peer::station_heartbeat;
use crate::bench::{Bench, Peer, Port, Seen, Trial};
use crate::scene::Scene;
use crate::wire::{Craft, Draft, Key};

/// All scenes.
pub const SCENES: &[Scene] = &[
    Scene {
        rule: "ROUTE-001",
        play: broadcast,
    },
    Scene {
        rule: "ROUTE-002",
        play: addressed,
    },
    Scene {
        rule: "ROUTE-003",
        play: signed_untouched,
    },
    Scene {
        rule: "ROUTE-004",
        play: not_back,
    },
    Scene {
        rule: "ROUTE-005",
        play: unknown_message,
    },
    Scene {
        rule: "ROUTE-006",
        play: wrong_checksum,
    },
    Scene {
        rule: "ROUTE-007",
        play: several_frames,
    },
    Scene {
        rule: "ROUTE-008",
        play: garbage,
    },
    Scene {
        rule: "ROUTE-009",
        play: once,
    },
    Scene {
        rule: "ROUTE-010",
        play: setup_signing,
    },
    Scene {
        rule: "ROUTE-011",
        play: stranger_at_the_end,
    },
    Scene {
        rule: "ROUTE-012",
        play: forged_vehicle,
    },
    Scene {
        rule: "ROUTE-013",
        play: in_order,
    },
];

/// How long a frame may take through a router.
const THROUGH: Duration = Duration::from_millis(600);

fn vehicle_heartbeat() -> Draft {
    Draft::new("HEARTBEAT")
        .set("type", 2)
        .set("autopilot", 12)
        .set("base_mode", 0x1D)
        .set("system_status", 3)
        .set("mavlink_version", 3)
}

/// Both ends of the router, as the suite plays them.
fn ends(bench: &Bench) -> (Peer, Peer) {
    let station = bench.second.clone().unwrap_or_else(|| bench.port.clone());
    (
        Peer::new(&bench.net, &bench.port, (1, 1), 0),
        Peer::new(&bench.net, &station, (245, 190), 0),
    )
}

/// Makes both ends known to the router.
///
/// # Errors
/// Nothing is forwarded from one end to the other; in a sentence.
pub fn begin(bench: &Bench) -> Result<(), String> {
    let (vehicle, station) = ends(bench);
    for _ in 0..12 {
        let mark = vehicle.send(&vehicle_heartbeat());
        station.send(&station_heartbeat());
        let passed = |peer: &Peer, system: u8| {
            let number = peer.port.number;
            bench.net.wait(mark, bench.net.now() + THROUGH, |seen| {
                seen.direction == Direction::Received
                    && seen.socket == number
                    && seen.frame.system == system
            })
        };
        if passed(&station, 1).is_some() && passed(&vehicle, 245).is_some() {
            return Ok(());
        }
        if bench.net.interrupted() {
            break;
        }
    }
    Err("no HEARTBEAT passed from one end to the other within 12 tries: are both links the router's, and does it need longer?".into())
}

/// How many frames with these bytes came out at a port.
fn came_out(t: &Trial<'_>, mark: usize, port: &Port, bytes: &[u8]) -> usize {
    t.bench
        .net
        .all(mark, |seen| {
            seen.direction == Direction::Received
                && seen.socket == port.number
                && seen.frame.bytes == bytes
        })
        .len()
}

/// Sends a frame and waits until it comes out at the other end, byte by byte the same.
fn passes(
    t: &Trial<'_>,
    from: &Peer,
    to: &Peer,
    what: &str,
    draft: &Draft,
    change: impl Fn(&mut Craft),
) -> Judged<Arc<Seen>> {
    for _ in 0..3 {
        let (mark, bytes) = from.send_with(draft, &change);
        let deadline = t.bench.net.now() + THROUGH.mul_f64(t.bench.factor);
        let number = to.port.number;
        if let Some(seen) = t.bench.net.wait(mark, deadline, |seen| {
            seen.direction == Direction::Received
                && seen.socket == number
                && seen.frame.bytes == bytes
        }) {
            return Ok(seen);
        }
        if t.bench.net.interrupted() {
            return Err(Stop::Interrupted);
        }
    }
    Err(Stop::fail(format!(
        "expected {what} at the other end, byte by byte; it did not come in three tries"
    )))
}

/// Fails where a frame that must be held back comes out at the other end.
fn held_back(
    t: &Trial<'_>,
    from: &Peer,
    to: &Peer,
    what: &str,
    draft: &Draft,
    change: impl FnOnce(&mut Craft),
) -> Judged {
    let (mark, bytes) = from.send_with(draft, change);
    t.pause(t.quiet())?;
    if came_out(t, mark, &to.port, &bytes) > 0 {
        return Err(Stop::fail(format!("{what} came out at the other end")));
    }
    heartbeat_passes(t, from, to, "an honest frame")
}

/// Fails unless the HEARTBEAT of one end is forwarded to the other.
fn heartbeat_passes(t: &Trial<'_>, from: &Peer, to: &Peer, what: &str) -> Judged {
    let heartbeat = if from.system == 1 {
        vehicle_heartbeat()
    } else {
        station_heartbeat()
    };
    passes(t, from, to, what, &heartbeat, |_| {}).map(|_| ())
}

fn broadcast(t: &Trial<'_>) -> Judged {
    let (vehicle, station) = ends(t.bench);
    heartbeat_passes(t, &vehicle, &station, "a vehicle's HEARTBEAT")?;
    heartbeat_passes(t, &station, &vehicle, "a station's HEARTBEAT")
}

fn addressed(t: &Trial<'_>) -> Judged {
    let (vehicle, station) = ends(t.bench);
    heartbeat_passes(t, &vehicle, &station, "a vehicle's HEARTBEAT")?;
    let command = Draft::new("COMMAND_LONG")
        .to((1, 1))
        .set("command", 512)
        .set("param1", 148);
    passes(
        t,
        &station,
        &vehicle,
        "a command for the vehicle",
        &command,
        |_| {},
    )?;
    let ack = Draft::new("COMMAND_ACK").to((245, 190)).set("command", 512);
    passes(
        t,
        &vehicle,
        &station,
        "an acknowledgement for the station",
        &ack,
        |_| {},
    )
    .map(|_| ())
}

fn signed_untouched(t: &Trial<'_>) -> Judged {
    let (vehicle, station) = ends(t.bench);
    // The router needs no key; where the run has one, the frame is signed with it.
    let key = t
        .bench
        .net
        .key()
        .unwrap_or(Key(std::array::from_fn(|index| index as u8)));
    let seen = passes(
        t,
        &vehicle,
        &station,
        "a signed frame",
        &vehicle_heartbeat(),
        |craft| {
            craft.key = Some(key);
            craft.stamp = t.bench.net.stamp();
            craft.link = 5;
        },
    )?;
    t.expect_of(&seen, seen.frame.verifies(&key) == Some(true), || {
        "the signed frame does not verify behind the router".into()
    })
}

fn not_back(t: &Trial<'_>) -> Judged {
    let (vehicle, station) = ends(t.bench);
    heartbeat_passes(t, &vehicle, &station, "a vehicle's HEARTBEAT")?;
    for (from, draft) in [
        (&vehicle, vehicle_heartbeat()),
        (&station, station_heartbeat()),
    ] {
        let (mark, bytes) = from.send_with(&draft, |_| {});
        t.pause(t.quiet())?;
        t.expect(came_out(t, mark, &from.port, &bytes) == 0, || {
            "a frame came back to the end from which it was sent".into()
        })?;
    }
    Ok(())
}

fn unknown_message(t: &Trial<'_>) -> Judged {
    let (vehicle, station) = ends(t.bench);
    passes(
        t,
        &vehicle,
        &station,
        "a message of a dialect that the router does not know (id 54321)",
        &vehicle_heartbeat(),
        |craft| {
            craft.id = 54_321;
            craft.crc_extra = 99;
        },
    )
    .map(|_| ())
}

fn wrong_checksum(t: &Trial<'_>) -> Judged {
    let (vehicle, station) = ends(t.bench);
    held_back(
        t,
        &vehicle,
        &station,
        "a frame with a wrong checksum",
        &vehicle_heartbeat(),
        |craft| craft.crc_flip = 0x0101,
    )
}

/// Sends several frames by `send`; returns how many of them come out, and whether in order.
fn through(
    t: &Trial<'_>,
    from: &Peer,
    to: &Peer,
    count: u32,
    send: impl Fn(&[Vec<u8>]),
) -> (usize, bool) {
    let frames: Vec<Vec<u8>> = (0..count)
        .map(|number| {
            from.craft(&vehicle_heartbeat().set("custom_mode", t.number() + number))
                .bytes()
        })
        .collect();
    let mark = t.bench.net.mark();
    send(&frames);
    t.bench.net.pause(t.quiet());
    let out = t.bench.net.all(mark, |seen| {
        seen.direction == Direction::Received && seen.socket == to.port.number
    });
    let places: Vec<Option<usize>> = frames
        .iter()
        .map(|bytes| out.iter().position(|seen| seen.frame.bytes == *bytes))
        .collect();
    let found: Vec<usize> = places.iter().flatten().copied().collect();
    (found.len(), found.is_sorted())
}

fn several_frames(t: &Trial<'_>) -> Judged {
    let (vehicle, station) = ends(t.bench);
    let mut best = 0;
    for _ in 0..3 {
        best = best.max(
            through(t, &vehicle, &station, 3, |frames| {
                vehicle.send_bytes(&frames.concat());
            })
            .0,
        );
    }
    t.expect(best == 3, || {
        format!("expected all of three frames in one datagram at the other end; {best} came")
    })
}

fn in_order(t: &Trial<'_>) -> Judged {
    let (vehicle, station) = ends(t.bench);
    let (mut best, mut sorted) = (0, true);
    for _ in 0..3 {
        let (came, in_order) = through(t, &vehicle, &station, 30, |frames| {
            for frame in frames {
                vehicle.send_bytes(frame);
            }
        });
        best = best.max(came);
        sorted &= in_order;
    }
    t.expect(sorted, || "frames came out in another order than they went in: a signed receiver drops what was overtaken".into())?;
    t.expect(best == 30, || {
        format!("of 30 frames back to back {best} came out")
    })
}

fn garbage(t: &Trial<'_>) -> Judged {
    let (vehicle, station) = ends(t.bench);
    for bytes in [
        vec![],
        vec![0xFD],
        vec![0xFD; 1_200],
        vec![0xFE, 200, 1],
        vec![0; 9_000],
    ] {
        vehicle.send_bytes(&bytes);
        station.send_bytes(&bytes);
    }
    t.pause(t.quiet())?;
    heartbeat_passes(t, &vehicle, &station, "an honest frame after garbage")?;
    heartbeat_passes(t, &station, &vehicle, "an honest frame after garbage")
}

fn once(t: &Trial<'_>) -> Judged {
    let (vehicle, station) = ends(t.bench);
    heartbeat_passes(t, &vehicle, &station, "a vehicle's HEARTBEAT")?;
    let (mark, bytes) =
        vehicle.send_with(&vehicle_heartbeat().set("custom_mode", t.number()), |_| {});
    t.pause(t.quiet())?;
    let copies = came_out(t, mark, &station.port, &bytes);
    t.expect(copies <= 1, || {
        format!(
            "one frame came out {copies} times: every copy but one is a replay to a signed receiver"
        )
    })
}

fn setup_signing(t: &Trial<'_>) -> Judged {
    let (vehicle, station) = ends(t.bench);
    heartbeat_passes(t, &vehicle, &station, "a vehicle's HEARTBEAT")?;
    // Addressed to a vehicle that is not at the other end: the key of one vehicle must not be sent to all.
    let setup = Draft::new("SETUP_SIGNING")
        .to((77, 1))
        .text("secret_key", [7; 32])
        .bits("initial_timestamp", t.bench.net.stamp());
    held_back(
        t,
        &station,
        &vehicle,
        "a SETUP_SIGNING, which holds a key, for a system that is not there",
        &setup,
        |_| {},
    )
}

fn stranger_at_the_end(t: &Trial<'_>) -> Judged {
    let (vehicle, station) = ends(t.bench);
    let remote = station
        .port
        .remote()
        .ok_or_else(|| Stop::inconclusive("the router has no address yet"))?;
    let port = Port::to(&t.bench.net, remote)
        .map_err(|error| Stop::inconclusive(format!("no socket: {error}")))?;
    port.send(b"no frame");
    port.send(&[0xFD; 40]);
    t.pause(t.quiet())?;
    heartbeat_passes(
        t,
        &vehicle,
        &station,
        "a vehicle's HEARTBEAT, after a stranger's garbage to the station's end,",
    )
}

fn forged_vehicle(t: &Trial<'_>) -> Judged {
    let (vehicle, station) = ends(t.bench);
    t.key()?;
    held_back(
        t,
        &vehicle,
        &station,
        "a HEARTBEAT with a wrong signature",
        &vehicle_heartbeat(),
        |craft| craft.hash_flip = 1,
    )
}
