//! CMD, the command protocol: that each command for the subject is answered once, in time, to its sender, and that no
//! other is; that an accepted mode is shown.

use std::sync::Arc;
use std::time::Duration;

use conformance::verdict::{Judged, Precondition, Stop};

use crate::bench::{Peer, Seen, Trial};
use crate::scene::Scene;
use crate::wire::Draft;

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "CMD-001",
        play: acknowledged_to_the_sender,
    },
    Scene {
        rule: "CMD-002",
        play: unknown_command,
    },
    Scene {
        rule: "CMD-003",
        play: other_system,
    },
    Scene {
        rule: "CMD-004",
        play: other_component,
    },
    Scene {
        rule: "CMD-005",
        play: command_int,
    },
    Scene {
        rule: "CMD-006",
        play: requested_message,
    },
    Scene {
        rule: "CMD-007",
        play: repeated_command,
    },
    Scene {
        rule: "CMD-008",
        play: message_interval,
    },
    Scene {
        rule: "CMD-009",
        play: acknowledged_in_time,
    },
    Scene {
        rule: "CMD-010",
        play: unknown_mode,
    },
    Scene {
        rule: "CMD-011",
        play: acknowledged_mode_is_shown,
    },
    Scene {
        rule: "CMD-012",
        play: unused_parameter,
    },
    Scene {
        rule: "CMD-013",
        play: burst,
    },
    Scene {
        rule: "CMD-014",
        play: mission_start_without_mission,
    },
];

/// MAV_CMD numbers; all but MISSION_START leave the vehicle where it is.
const REQUEST_MESSAGE: u16 = 512;
const SET_MESSAGE_INTERVAL: u16 = 511;
const DO_SET_MODE: u16 = 176;
const MISSION_START: u16 = 300;
/// A command that no dialect defines.
const UNKNOWN: u16 = 59_999;

const RESULTS: [&str; 10] = [
    "ACCEPTED",
    "TEMPORARILY_REJECTED",
    "DENIED",
    "UNSUPPORTED",
    "FAILED",
    "IN_PROGRESS",
    "CANCELLED",
    "COMMAND_LONG_ONLY",
    "COMMAND_INT_ONLY",
    "UNSUPPORTED_FRAME",
];

fn result(ack: &Seen) -> String {
    let raw = ack.frame.int("result");
    RESULTS
        .get(raw as usize)
        .map_or_else(|| raw.to_string(), |name| format!("{name} ({raw})"))
}

pub(super) fn long(t: &Trial<'_>, command: u16) -> Draft {
    Draft::new("COMMAND_LONG")
        .to(t.bench.subject)
        .set("command", command)
}

fn is_ack(command: u16) -> impl FnMut(&Seen) -> bool {
    move |seen| seen.frame.is("COMMAND_ACK") && seen.frame.int("command") == i64::from(command)
}

/// Sends a command until it is acknowledged.
pub(super) fn acknowledged(
    t: &Trial<'_>,
    peer: &Peer,
    command: u16,
    draft: &Draft,
) -> Judged<Arc<Seen>> {
    peer.request(
        draft,
        t.answer(),
        &format!("a COMMAND_ACK for command {command}"),
        is_ack(command),
    )
}

fn acknowledged_to_the_sender(t: &Trial<'_>) -> Judged {
    let ack = acknowledged(
        t,
        &t.peer,
        REQUEST_MESSAGE,
        &long(t, REQUEST_MESSAGE).set("param1", 148),
    )?;
    let target = ack.frame.target().unwrap_or_default();
    t.expect_of(&ack, target == (t.peer.system, t.peer.component), || {
        format!(
            "expected a COMMAND_ACK for {}/{}, who sent the command; its target is {}/{}",
            t.peer.system, t.peer.component, target.0, target.1
        )
    })
}

fn unknown_command(t: &Trial<'_>) -> Judged {
    let ack = acknowledged(t, &t.peer, UNKNOWN, &long(t, UNKNOWN))?;
    t.expect_of(&ack, ack.frame.int("result") == 3, || {
        format!(
            "expected UNSUPPORTED (3) for the unknown command {UNKNOWN}; got {}",
            result(&ack)
        )
    })
}

/// Fails where a command for another system or component is answered.
fn not_answered(t: &Trial<'_>, target: (u8, u8)) -> Judged {
    t.alive()?;
    let mark = t
        .peer
        .send(&long(t, REQUEST_MESSAGE).set("param1", 148).to(target));
    let own = t.bench.subject;
    let answer = t.peer.wait(mark, t.quiet(), |seen| {
        (seen.frame.system, seen.frame.component) == own && is_ack(REQUEST_MESSAGE)(seen)
    });
    t.expect_none(answer, |_| {
        format!(
            "expected no answer to a command for {}/{}; the subject, {}/{}, acknowledged it",
            target.0, target.1, own.0, own.1
        )
    })?;
    t.alive()
}

fn other_system(t: &Trial<'_>) -> Judged {
    let (system, component) = t.bench.subject;
    not_answered(t, (if system == 199 { 198 } else { 199 }, component))
}

fn other_component(t: &Trial<'_>) -> Judged {
    let (system, component) = t.bench.subject;
    not_answered(t, (system, if component == 77 { 78 } else { 77 }))
}

fn command_int(t: &Trial<'_>) -> Judged {
    let draft = Draft::new("COMMAND_INT")
        .to(t.bench.subject)
        .set("command", REQUEST_MESSAGE)
        .set("param1", 148);
    let ack = acknowledged(t, &t.peer, REQUEST_MESSAGE, &draft)?;
    // A subject may answer that it accepts the command as COMMAND_LONG only; no answer at all breaks the rule.
    t.expect_of(&ack, matches!(ack.frame.int("result"), 0 | 7), || {
        format!(
            "expected ACCEPTED or COMMAND_LONG_ONLY for REQUEST_MESSAGE as COMMAND_INT; got {}",
            result(&ack)
        )
    })
}

fn requested_message(t: &Trial<'_>) -> Judged {
    let mark = t.bench.net.mark();
    let ack = acknowledged(
        t,
        &t.peer,
        REQUEST_MESSAGE,
        &long(t, REQUEST_MESSAGE).set("param1", 148),
    )?;
    t.expect_of(&ack, ack.frame.int("result") == 0, || {
        format!(
            "expected ACCEPTED for AUTOPILOT_VERSION; got {}",
            result(&ack)
        )
    })?;
    let sent = t
        .peer
        .wait(mark, t.answer(), |seen| seen.frame.is("AUTOPILOT_VERSION"));
    t.expect(sent.is_some(), || {
        "REQUEST_MESSAGE for AUTOPILOT_VERSION was ACCEPTED, but the message did not come".into()
    })?;
    let ack = acknowledged(
        t,
        &t.peer,
        REQUEST_MESSAGE,
        &long(t, REQUEST_MESSAGE).set("param1", 54_321),
    )?;
    t.expect_of(&ack, ack.frame.int("result") != 0, || {
        "expected a refusal of REQUEST_MESSAGE for the unknown message 54321; got ACCEPTED".into()
    })
}

fn repeated_command(t: &Trial<'_>) -> Judged {
    t.alive()?;
    for confirmation in 0..3 {
        let draft = long(t, REQUEST_MESSAGE)
            .set("param1", 300)
            .set("confirmation", confirmation);
        acknowledged(t, &t.peer, REQUEST_MESSAGE, &draft).map_err(|_| {
            Stop::fail(format!("expected a COMMAND_ACK for each repetition of a command; that with confirmation {confirmation} had none in three tries"))
        })?;
    }
    Ok(())
}

/// How many of this message the subject sends in a second.
fn rate(t: &Trial<'_>, name: &str) -> Judged<f64> {
    let (mark, window) = (t.bench.net.mark(), t.seconds(2.0));
    t.pause(window)?;
    Ok(t.from_subject(mark, |seen| {
        seen.frame.is(name) && seen.socket == t.peer.port.number
    })
    .len() as f64
        / window.as_secs_f64())
}

fn message_interval(t: &Trial<'_>) -> Judged {
    let set = |interval: f64| {
        acknowledged(
            t,
            &t.peer,
            SET_MESSAGE_INTERVAL,
            &long(t, SET_MESSAGE_INTERVAL)
                .set("param1", 30)
                .set("param2", interval),
        )
    };
    let ack = set(100_000.0)?;
    if ack.frame.int("result") == 3 {
        return Err(Stop::not_applicable(
            "the subject does not support SET_MESSAGE_INTERVAL",
        ));
    }
    t.expect_of(&ack, ack.frame.int("result") == 0, || {
        format!(
            "expected ACCEPTED for ATTITUDE every 100 ms; got {}",
            result(&ack)
        )
    })?;
    let found = rate(t, "ATTITUDE");
    // An interval of 0 restores the default rate, so nothing is left changed.
    let restored = set(0.0);
    let found = found?;
    t.expect((5.0..20.0).contains(&found), || {
        format!(
            "ATTITUDE every 100 ms was ACCEPTED, but {found:.1} came in a second; expected about 10"
        )
    })?;
    restored.map(|_| ())
}

fn acknowledged_in_time(t: &Trial<'_>) -> Judged {
    t.alive()?;
    let mut worst = Duration::ZERO;
    for _ in 0..5 {
        let began = t.bench.net.now();
        let ack = acknowledged(
            t,
            &t.peer,
            REQUEST_MESSAGE,
            &long(t, REQUEST_MESSAGE).set("param1", 148),
        )?;
        worst = worst.max(ack.at.saturating_sub(began));
    }
    t.expect(worst < t.seconds(0.5), || {
        format!(
            "expected COMMAND_ACK within 0.5 s; one took {:.2} s",
            worst.as_secs_f64()
        )
    })
}

fn heartbeat(t: &Trial<'_>) -> Judged<Arc<Seen>> {
    let mark = t.bench.net.mark();
    let own = t.bench.subject;
    let wanted = |seen: &Seen| {
        seen.frame.is("HEARTBEAT") && (seen.frame.system, seen.frame.component) == own
    };
    t.peer
        .wait(mark, t.seconds(3.0), wanted)
        .ok_or_else(|| Stop::inconclusive("no HEARTBEAT of the subject within 3 s"))
}

/// DO_SET_MODE with the main and sub mode of a packed custom mode, as PX4 expects it; ArduPilot expects the plain
/// number.
fn set_mode(t: &Trial<'_>, custom: i64) -> Draft {
    let draft = long(t, DO_SET_MODE).set("param1", 1);
    if t.bench.autopilot == 12 {
        draft
            .set("param2", (custom >> 16 & 0xFF) as f64)
            .set("param3", (custom >> 24 & 0xFF) as f64)
    } else {
        draft.set("param2", custom as f64)
    }
}

fn unknown_mode(t: &Trial<'_>) -> Judged {
    let before = heartbeat(t)?;
    let ack = acknowledged(
        t,
        &t.peer,
        DO_SET_MODE,
        &long(t, DO_SET_MODE)
            .set("param1", 1)
            .set("param2", 99)
            .set("param3", 99),
    )?;
    t.expect_of(&ack, ack.frame.int("result") != 0, || {
        "expected a refusal of DO_SET_MODE with the unknown mode 99; got ACCEPTED".into()
    })?;
    let after = heartbeat(t)?;
    t.expect_of(
        &after,
        after.frame.int("custom_mode") == before.frame.int("custom_mode"),
        || "the unknown mode 99 was refused, but the HEARTBEAT shows another mode".into(),
    )
}

fn acknowledged_mode_is_shown(t: &Trial<'_>) -> Judged {
    if t.bench.autopilot != 12 {
        return Err(Stop::not_applicable("mode numbers are known for PX4 only"));
    }
    let before = heartbeat(t)?.frame.int("custom_mode");
    // AUTO.LOITER or AUTO.MISSION, whichever is not the current mode.
    let wanted = if before == 0x0304_0000 {
        0x0404_0000
    } else {
        0x0304_0000
    };
    let judged = (|| {
        let ack = acknowledged(t, &t.peer, DO_SET_MODE, &set_mode(t, wanted))?;
        if ack.frame.int("result") != 0 {
            return Err(Stop::not_applicable(format!(
                "the subject refuses the mode: {}",
                result(&ack)
            )));
        }
        let mark = t.bench.net.mark();
        let own = t.bench.subject;
        let shown = t.peer.wait(mark, t.seconds(3.0), |seen| {
            seen.frame.is("HEARTBEAT")
                && (seen.frame.system, seen.frame.component) == own
                && seen.frame.int("custom_mode") == wanted
        });
        t.expect(shown.is_some(), || format!("DO_SET_MODE to 0x{wanted:08x} was ACCEPTED, but no HEARTBEAT within 3 s shows that mode"))
    })();
    let _ = acknowledged(t, &t.peer, DO_SET_MODE, &set_mode(t, before));
    judged
}

fn unused_parameter(t: &Trial<'_>) -> Judged {
    let mode = heartbeat(t)?.frame.int("custom_mode");
    let ack = acknowledged(t, &t.peer, DO_SET_MODE, &set_mode(t, mode).set("param7", 5))?;
    t.expect_of(&ack, ack.frame.int("result") == 2, || {
        format!(
            "expected DENIED for a parameter that DO_SET_MODE does not have (param7 = 5); got {}",
            result(&ack)
        )
    })
}

fn burst(t: &Trial<'_>) -> Judged {
    t.alive()?;
    let count = 50;
    let mark = t.bench.net.mark();
    for _ in 0..count {
        t.peer.send(&long(t, REQUEST_MESSAGE).set("param1", 300));
    }
    t.pause(t.answer())?;
    let acks = t
        .from_subject(mark, |seen| {
            t.peer.is_mine(seen) && is_ack(REQUEST_MESSAGE)(seen)
        })
        .len();
    t.alive().map_err(|_| {
        Stop::fail(format!(
            "after {count} commands back to back the subject answers no more"
        ))
    })?;
    t.expect(acks >= count, || format!("{count} commands back to back: {acks} were acknowledged; the others have to be repeated"))
}

fn mission_start_without_mission(t: &Trial<'_>) -> Judged {
    let saved = super::mission::download(t, &t.peer, 0).precondition("the mission can be saved")?;
    super::mission::clear(t, 0).precondition("the mission can be cleared")?;
    let ack = acknowledged(t, &t.peer, MISSION_START, &long(t, MISSION_START));
    let armed = heartbeat(t).is_ok_and(|seen| seen.frame.int("base_mode") & 0x80 != 0);
    if armed {
        let _ = acknowledged(t, &t.peer, 400, &long(t, 400));
    }
    super::mission::restore(t, 0, &saved)?;
    let ack = ack?;
    t.expect_of(&ack, ack.frame.int("result") != 0 && !armed, || {
        format!(
            "expected a refusal of MISSION_START without a mission; got {}, armed: {armed}",
            result(&ack)
        )
    })
}
