//! PARAM: the parameter protocol. A changed parameter is restored.

use std::collections::BTreeMap;
use std::sync::Arc;

use conformance::verdict::{Judged, Precondition, Stop};

use crate::bench::{Seen, Trial};
use crate::scene::Scene;
use crate::wire::Draft;

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "PARAM-001",
        play: read_by_name,
    },
    Scene {
        rule: "PARAM-002",
        play: read_by_index,
    },
    Scene {
        rule: "PARAM-003",
        play: whole_list,
    },
    Scene {
        rule: "PARAM-004",
        play: set_and_read_back,
    },
    Scene {
        rule: "PARAM-005",
        play: set_of_unknown_name,
    },
    Scene {
        rule: "PARAM-006",
        play: set_with_wrong_type,
    },
    Scene {
        rule: "PARAM-007",
        play: other_system,
    },
    Scene {
        rule: "PARAM-008",
        play: encoding_as_announced,
    },
    Scene {
        rule: "PARAM-009",
        play: unknown_name_is_an_error,
    },
    Scene {
        rule: "PARAM-010",
        play: name_of_sixteen_characters,
    },
];

/// A parameter that no autopilot has.
const UNKNOWN: &str = "XQ_NO_SUCH_PAR";
/// The parameters that may be changed where the operator names none: they count at a take-off or a return only.
const CHANGED: [&str; 2] = ["MIS_TAKEOFF_ALT", "RTL_RETURN_ALT"];
/// MAV_PARAM_TYPE_REAL32.
const REAL32: i64 = 9;

fn read(t: &Trial<'_>, name: &str) -> Draft {
    Draft::new("PARAM_REQUEST_READ")
        .to(t.bench.subject)
        .set("param_index", -1)
        .text("param_id", name)
}

fn named(name: &str) -> impl FnMut(&Seen) -> bool {
    let name = name.to_owned();
    move |seen| seen.frame.is("PARAM_VALUE") && seen.frame.text("param_id") == name
}

pub(super) fn value(t: &Trial<'_>, name: &str) -> Judged<Arc<Seen>> {
    t.peer.request(
        &read(t, name),
        t.answer(),
        &format!("a PARAM_VALUE of {name}"),
        named(name),
    )
}

/// Some parameter, by its index.
fn first(t: &Trial<'_>, index: i64) -> Judged<Arc<Seen>> {
    let draft = Draft::new("PARAM_REQUEST_READ")
        .to(t.bench.subject)
        .set("param_index", index as f64);
    t.peer.request(
        &draft,
        t.answer(),
        &format!("a PARAM_VALUE of index {index}"),
        |seen| seen.frame.is("PARAM_VALUE") && seen.frame.int("param_index") == index,
    )
}

/// The parameter that may be changed, with its value.
fn changeable(t: &Trial<'_>) -> Judged<Arc<Seen>> {
    if let Some(name) = &t.bench.parameter {
        return value(t, name).precondition("the parameter of --parameter is there");
    }
    for name in CHANGED {
        if let Ok(found) = value(t, name)
            && found.frame.int("param_type") == REAL32
        {
            return Ok(found);
        }
    }
    Err(Stop::not_applicable(format!(
        "none of {CHANGED:?} is there as a float; name one that may be changed by --parameter"
    )))
}

fn set(t: &Trial<'_>, name: &str, bits: u32, kind: i64) -> Draft {
    Draft::new("PARAM_SET")
        .to(t.bench.subject)
        .text("param_id", name)
        .bits("param_value", bits.into())
        .set("param_type", kind as f64)
}

fn bits(seen: &Seen) -> u32 {
    seen.frame.float("param_value").to_bits()
}

fn read_by_name(t: &Trial<'_>) -> Judged {
    let some = first(t, 0)?;
    let name = some.frame.text("param_id");
    let found = value(t, &name)?;
    t.expect_of(
        &found,
        bits(&found) == bits(&some) && found.frame.int("param_count") > 0,
        || format!("{name} read by name has another value than by index, or no count"),
    )
}

fn read_by_index(t: &Trial<'_>) -> Judged {
    let count = first(t, 0)?.frame.int("param_count");
    let mut names = BTreeMap::new();
    for index in [0, count / 2, count - 1] {
        let found = first(t, index)?;
        let name = found.frame.text("param_id");
        t.expect_of(&found, !name.is_empty(), || {
            format!("the parameter of index {index} has no name")
        })?;
        if let Some(other) = names.insert(name.clone(), index)
            && other != index
        {
            return Err(Stop::fail(format!(
                "{name} is the answer to index {other} and to index {index}"
            )));
        }
    }
    Ok(())
}

fn whole_list(t: &Trial<'_>) -> Judged {
    let mark = t
        .peer
        .send(&Draft::new("PARAM_REQUEST_LIST").to(t.bench.subject));
    let values = |t: &Trial<'_>| {
        t.from_subject(mark, |seen| {
            seen.frame.is("PARAM_VALUE")
                && t.peer.is_mine(seen)
                && seen.frame.int("param_index") != 65_535
        })
    };
    let mut last = 0;
    let mut still = 0;
    while still < 3 {
        t.pause(t.seconds(0.5))?;
        let now = values(t).len();
        still = if now == last { still + 1 } else { 0 };
        last = now;
    }
    let values = values(t);
    let Some(count) = values.first().map(|seen| seen.frame.int("param_count")) else {
        return Err(Stop::fail(
            "expected PARAM_VALUEs after PARAM_REQUEST_LIST; none came",
        ));
    };
    let mut names: BTreeMap<i64, String> = BTreeMap::new();
    for seen in &values {
        let (index, name) = (seen.frame.int("param_index"), seen.frame.text("param_id"));
        t.expect_of(seen, index < count, || {
            format!("PARAM_VALUE {name} has index {index} of {count}")
        })?;
        let other = names.insert(index, name.clone());
        t.expect_of(
            seen,
            other.as_ref().is_none_or(|other| *other == name),
            || {
                format!(
                    "index {index} is {name} and {}",
                    other.clone().unwrap_or_default()
                )
            },
        )?;
    }
    let missing: Vec<i64> = (0..count)
        .filter(|index| !names.contains_key(index))
        .collect();
    // UDP may lose some of a list; each has to be answered on request.
    for index in missing.iter().take(20) {
        first(t, *index).map_err(|_| {
            Stop::fail(format!(
                "of {count} parameters index {index} was not in the list, nor is it there by index"
            ))
        })?;
    }
    t.expect(missing.len() * 10 <= count as usize, || {
        format!(
            "{} of {count} parameters were not in the list",
            missing.len()
        )
    })
}

fn set_and_read_back(t: &Trial<'_>) -> Judged {
    let before = changeable(t)?;
    let (name, old, kind) = (
        before.frame.text("param_id"),
        bits(&before),
        before.frame.int("param_type"),
    );
    if kind != REAL32 {
        return Err(Stop::not_applicable(format!(
            "{name} is no float; name another by --parameter"
        )));
    }
    let new = (f32::from_bits(old) + 0.5).to_bits();
    let judged = (|| {
        let echo = t.peer.request(
            &set(t, &name, new, kind),
            t.answer(),
            "a PARAM_VALUE after PARAM_SET",
            named(&name),
        )?;
        t.expect_of(&echo, bits(&echo) == new, || {
            format!(
                "PARAM_SET of {name} to {}: PARAM_VALUE has {}",
                f32::from_bits(new),
                f32::from_bits(bits(&echo))
            )
        })?;
        let read = value(t, &name)?;
        t.expect_of(&read, bits(&read) == new, || {
            format!(
                "{name} was set to {}; read back it is {}",
                f32::from_bits(new),
                f32::from_bits(bits(&read))
            )
        })
    })();
    restore(t, &name, old, kind)?;
    judged
}

fn restore(t: &Trial<'_>, name: &str, old: u32, kind: i64) -> Judged {
    let echo = t
        .peer
        .request(
            &set(t, name, old, kind),
            t.answer(),
            "a PARAM_VALUE",
            named(name),
        )
        .precondition("the parameter is restored")?;
    if bits(&echo) != old {
        t.note(format!(
            "{name} could not be restored to {}: set it by hand",
            f32::from_bits(old)
        ));
    }
    Ok(())
}

fn set_of_unknown_name(t: &Trial<'_>) -> Judged {
    t.alive()?;
    let mark = t.peer.send(&set(t, UNKNOWN, 1.0_f32.to_bits(), REAL32));
    let echo = t.peer.wait(mark, t.quiet(), named(UNKNOWN));
    t.expect_none(echo, |_| {
        format!("expected no PARAM_VALUE after PARAM_SET of {UNKNOWN}, which does not exist")
    })?;
    t.alive()
}

fn set_with_wrong_type(t: &Trial<'_>) -> Judged {
    let before = changeable(t)?;
    let (name, old, kind) = (
        before.frame.text("param_id"),
        bits(&before),
        before.frame.int("param_type"),
    );
    // INT32 with the bits of 7: as a float it would be 1e-44.
    t.peer
        .send(&set(t, &name, 7, if kind == 6 { REAL32 } else { 6 }));
    t.pause(t.quiet())?;
    let after = value(t, &name)?;
    let kept = bits(&after) == old;
    if !kept {
        restore(t, &name, old, kind)?;
    }
    t.expect_of(&after, kept, || {
        format!(
            "PARAM_SET of {name} with another type changed it from {} to {}",
            f32::from_bits(old),
            f32::from_bits(bits(&after))
        )
    })
}

fn other_system(t: &Trial<'_>) -> Judged {
    let name = first(t, 0)?.frame.text("param_id");
    let other = if t.bench.subject.0 == 199 { 198 } else { 199 };
    let mark = t.peer.send(&read(t, &name).to((other, 1)));
    let own = t.bench.subject;
    let answer = t.peer.wait(mark, t.quiet(), |seen| {
        (seen.frame.system, seen.frame.component) == own && named(&name)(seen)
    });
    t.expect_none(answer, |_| {
        format!("expected no answer to PARAM_REQUEST_READ for system {other}; the subject answered")
    })?;
    t.alive()
}

fn encoding_as_announced(t: &Trial<'_>) -> Judged {
    let draft = super::command::long(t, 512).set("param1", 148);
    let version = t
        .peer
        .request(&draft, t.answer(), "AUTOPILOT_VERSION", |seen| {
            seen.frame.is("AUTOPILOT_VERSION")
        })
        .precondition("the capabilities are known")?;
    let capabilities = version.frame.int("capabilities");
    let (bytewise, cast) = (capabilities & 16 != 0, capabilities & 131_072 != 0);
    t.expect_of(&version, bytewise != cast, || {
        format!("expected one of PARAM_ENCODE_BYTEWISE (16) and PARAM_ENCODE_C_CAST (131072) in the capabilities; they are 0x{capabilities:x}")
    })?;
    let count = first(t, 0)?.frame.int("param_count");
    let mut judged = 0;
    for index in 0..count.min(60) {
        let Ok(found) = first(t, index) else { continue };
        // Integer types up to 32 bits (1 to 6). A value of 0 has the same bytes in both encodings.
        if !(1..=6).contains(&found.frame.int("param_type")) || bits(&found) == 0 {
            continue;
        }
        judged += 1;
        // A small integer sent as bits reads as a denormal float, or as NaN where negative; sent as a float it is a
        // whole number.
        let float = f32::from_bits(bits(&found));
        let reads_bytewise = float.is_nan() || float.abs() < 1e-30;
        let reads_cast = float.is_finite() && float.fract() == 0.0;
        t.expect_of(
            &found,
            if bytewise {
                reads_bytewise || !reads_cast
            } else {
                reads_cast
            },
            || {
                format!(
                    "{} is an integer and reads as {float}: not as the capabilities announce",
                    found.frame.text("param_id")
                )
            },
        )?;
        if judged == 5 {
            break;
        }
    }
    if judged == 0 {
        Err(Stop::inconclusive(
            "none of the first 60 parameters is an integer other than 0",
        ))
    } else {
        Ok(())
    }
}

fn unknown_name_is_an_error(t: &Trial<'_>) -> Judged {
    t.alive()?;
    let mark = t.peer.send(&read(t, UNKNOWN));
    let answer = t.peer.wait(mark, t.answer(), |seen| {
        seen.frame.is("PARAM_ERROR") || named(UNKNOWN)(seen)
    });
    let answer = answer.ok_or_else(|| {
        Stop::fail(format!(
            "expected PARAM_ERROR for {UNKNOWN}, which does not exist; nothing came"
        ))
    })?;
    t.expect_of(&answer, answer.frame.is("PARAM_ERROR"), || {
        format!("expected PARAM_ERROR for {UNKNOWN}, which does not exist; got a PARAM_VALUE")
    })
}

fn name_of_sixteen_characters(t: &Trial<'_>) -> Judged {
    let listed = t.bench.net.all(0, |seen| {
        seen.frame.is("PARAM_VALUE") && seen.frame.text("param_id").len() == 16
    });
    let Some(longest) = listed.first() else {
        return Err(Stop::not_applicable(
            "no parameter with a name of 16 characters was seen",
        ));
    };
    let name = longest.frame.text("param_id");
    value(t, &name).map(|_| ())
}
