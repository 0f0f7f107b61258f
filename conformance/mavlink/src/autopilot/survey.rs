//! The beginning of a run: who is there, whether it signs, what it answers, whether it is armed.

use std::sync::Arc;
use std::time::Duration;

use conformance::wire::Direction;

use super::keys;
use crate::bench::peer::station_heartbeat;
use crate::bench::trial::Probe;
use crate::bench::{Bench, Peer, Seen, Trial};
use crate::wire::Draft;

/// How long to wait for the first heartbeat.
const PATIENCE: Duration = Duration::from_secs(6);

/// Finds the subject and fills in what the bench does not know yet; returns remarks about the run as a whole.
pub(crate) fn survey(
    bench: &mut Bench,
    peer: &Peer,
    wanted: Option<u8>,
) -> Result<Vec<String>, String> {
    let mut remarks = Vec::new();
    let net = bench.net.clone();
    let is_vehicle = |seen: &Seen| {
        seen.direction == Direction::Received
            && seen.socket == peer.port.number
            && seen.frame.is("HEARTBEAT")
            && seen.frame.int("type") != 6
            && seen.frame.component == 1
            && wanted.is_none_or(|system| seen.frame.system == system)
    };
    let deadline = net.now() + PATIENCE.mul_f64(bench.factor);
    let mut found: Option<Arc<Seen>> = None;
    while found.is_none() && net.now() < deadline && !net.interrupted() {
        // Many subjects send only to a peer that has sent to them.
        peer.send(&station_heartbeat());
        found = net.wait(0, net.now() + Duration::from_millis(700), is_vehicle);
    }
    let heartbeat = found.ok_or_else(|| {
        format!("no HEARTBEAT of an autopilot (component 1) came to {} within {:.0} s; is the link right, and nobody else on its port?", peer.port.local(), PATIENCE.as_secs_f64() * bench.factor)
    })?;
    let frame = &heartbeat.frame;
    bench.subject = (frame.system, frame.component);
    bench.autopilot = frame.int("autopilot");
    if frame.int("base_mode") & 0x80 != 0 {
        return Err("the vehicle is armed: nothing was begun. Disarm it, then run again".into());
    }
    // The subject may have another key: its key file is lost, or a run was interrupted in the KEY rules.
    if let Some(key) = net.key()
        && heartbeat.verified == Some(false)
    {
        if frame.verifies(&keys::other_key(key)) == Some(true) && bench.setup_signing {
            let trial = Trial::new(bench, peer);
            keys::bring_back(&trial, key, keys::other_key(key))
                .map_err(|stop| stop.judgement().reason)?;
            remarks.push("the subject still had the key of an earlier run, and was brought back to the given one".into());
        } else {
            return Err("the subject's frames are signed with another key than that of --key-file: nothing was begun".into());
        }
    }
    if net.key().is_some() && frame.signature.is_none() {
        remarks
            .push("a key was given, but the subject does not sign: rules of signing fail".into());
    }
    for probe in [Probe::Timesync, Probe::Ping, Probe::Command] {
        bench.probe = probe;
        if Trial::new(bench, peer).answers(peer) {
            let version = Draft::new("COMMAND_LONG")
                .to(bench.subject)
                .set("command", 512)
                .set("param1", 148);
            let mark = peer.send(&version);
            // Its acknowledgement is waited for too: a late one would be taken for the answer to a command of the
            // first scene.
            for name in ["AUTOPILOT_VERSION", "COMMAND_ACK"] {
                peer.wait(mark, Duration::from_secs(1), |seen| seen.frame.is(name));
            }
            return Ok(remarks);
        }
    }
    remarks.push("the subject answers neither TIMESYNC, nor PING, nor REQUEST_MESSAGE: what it takes cannot be seen".into());
    Ok(remarks)
}

/// Name and version, as the subject reports them.
pub(crate) fn describe(bench: &Bench) -> (String, String) {
    let name = match bench.autopilot {
        3 => "ArduPilot".to_owned(),
        12 => "PX4".to_owned(),
        0 => "generic autopilot".to_owned(),
        other => format!("autopilot {other}"),
    };
    let version = bench.net.all(0, |seen| seen.frame.is("AUTOPILOT_VERSION"));
    let version = version.last().map_or_else(String::new, |seen| {
        let raw = seen.frame.int("flight_sw_version") as u32;
        let kind = match raw & 0xFF {
            255 => "".to_owned(),
            192..=254 => "-rc".to_owned(),
            128..=191 => "-beta".to_owned(),
            64..=127 => "-alpha".to_owned(),
            _ => "-dev".to_owned(),
        };
        format!(
            "{}.{}.{}{kind}",
            raw >> 24,
            raw >> 16 & 0xFF,
            raw >> 8 & 0xFF
        )
    });
    (name, version)
}
