//! Discovery and identification: DISC.

use std::collections::BTreeSet;

use stanag_msgs::Id;

use super::scene::Scene;
use crate::bench::flight::{Plan, home, load};
use crate::bench::station::{Access, authorisation, discovery, loi};
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Precondition, Stop};

pub(super) const SCENES: &[Scene] = &[
    Scene {
        rule: "DISC-001",
        play: broadcast_request_is_answered,
    },
    Scene {
        rule: "DISC-002",
        play: one_response_for_each_vehicle,
    },
    Scene {
        rule: "DISC-003",
        play: offer_is_not_a_grant,
    },
    Scene {
        rule: "DISC-004",
        play: strangers_are_offered_nothing,
    },
    Scene {
        rule: "DISC-006",
        play: type_and_subtype_are_filled,
    },
    Scene {
        rule: "DISC-007",
        play: asking_does_not_release,
    },
    Scene {
        rule: "DISC-009",
        play: vehicle_id_on_request_and_on_change,
    },
];

fn broadcast_request_is_answered(t: &Trial) -> Judged {
    let station = t.any()?;
    let found = station.ask(
        discovery(),
        t.timers().answer,
        "message 2 to a broadcast #1",
        |seen| seen.kind() == 2,
    )?;
    t.cite(&found);
    Ok(())
}

fn one_response_for_each_vehicle(t: &Trial) -> Judged {
    let station = t.any()?;
    let expected: BTreeSet<Id> = t
        .bench
        .surveyed()?
        .vehicles
        .iter()
        .map(|vehicle| vehicle.id)
        .collect();
    let found: BTreeSet<Id> = station
        .discover()?
        .iter()
        .map(|seen| seen.piece.source)
        .collect();
    t.expect(found.is_superset(&expected), || {
        format!("expected a response from each of {expected:?}, got {found:?}")
    })
}

fn offer_is_not_a_grant(t: &Trial) -> Judged {
    let station = t.any()?;
    for seen in station.discover()? {
        let field = |name: &str| seen.raw(name).unwrap_or_default();
        t.expect_of(&seen, field("LOI Granted") == 0, || {
            format!(
                "expected LOI Granted 0 for a CUCS that holds nothing, got 0x{:02x}",
                field("LOI Granted")
            )
        })?;
        t.expect(field("Access Granted") == 0, || {
            format!(
                "expected Access Granted 0 for a CUCS that holds nothing, got {}",
                field("Access Granted")
            )
        })?;
        t.expect(field("LOI Authorized") != 0, || {
            "expected LOI Authorised other than 0 for a CUCS that is authorised".into()
        })?;
    }
    // The directed question of one that was never granted anything is no grant either.
    let again = station.request(0, Access::Release)?;
    let granted = again.raw("LOI Granted").unwrap_or_default();
    t.expect_of(&again, granted == 0, || {
        format!("expected LOI Granted 0 for a CUCS that holds nothing, got 0x{granted:02x}")
    })
}

fn strangers_are_offered_nothing(t: &Trial) -> Judged {
    let stranger = t.stranger()?;
    let mark = t.bench.net.mark();
    stranger.send(discovery());
    for access in [Access::Request, Access::Override] {
        stranger.send(authorisation(loi::LOI2, access));
        stranger.send(authorisation(loi::LOI4, access));
    }
    t.pause(t.timers().quiet)?;
    for seen in stranger.received(mark, |seen| seen.kind() == 2) {
        let field = |name: &str| seen.raw(name).unwrap_or_default();
        t.expect_of(&seen, field("LOI Granted") == 0 && field("LOI Authorized") == 0, || {
            format!(
                "expected no answer to {}, which the subject cannot know, or LOI 0; got authorised 0x{:02x}, granted 0x{:02x}",
                stranger.id,
                field("LOI Authorized"),
                field("LOI Granted")
            )
        })?;
    }
    let status = stranger.received(mark, |seen| matches!(seen.kind(), 3000..=4001));
    t.expect(status.is_empty(), || {
        format!(
            "expected no status to {}, which has no rights; message {} came",
            stranger.id,
            status[0].kind()
        )
    })?;
    let good = t.any()?;
    good.request(0, Access::Release)
        .precondition("the subject still answers")?;
    Ok(())
}

fn type_and_subtype_are_filled(t: &Trial) -> Judged {
    let station = t.monitor()?;
    let response = station.request(0, Access::Request)?;
    let vehicle = station.query(3)?;
    t.cite(&vehicle);
    for name in ["Vehicle Type", "Vehicle Subtype"] {
        let (offered, reported) = (response.raw(name), vehicle.raw(name));
        t.expect_of(&response, offered.is_some() && offered == reported, || {
            format!(
                "expected {name} filled and the same in #2 and #3; got {offered:?} and {reported:?}"
            )
        })?;
    }
    if response.raw("Vehicle Type") == Some(0) {
        t.warn("Vehicle Type is 0, not identified");
    }
    Ok(())
}

fn asking_does_not_release(t: &Trial) -> Judged {
    let a = t.controller()?;
    let mark = t.bench.net.mark();
    a.send(discovery());
    let vehicle = a.vehicle;
    let answer = a.wait(mark, t.timers().answer, |seen| {
        seen.kind() == 2 && seen.piece.source == vehicle
    });
    if let Some(answer) = answer {
        let granted = answer.raw("LOI Granted").unwrap_or_default();
        t.expect_of(&answer, granted & loi::LOI4 != 0, || format!("expected LOI 4 still granted in the answer to the holder's discovery, got 0x{granted:02x}"))?;
    }
    if let Ok(b) = t.b() {
        let answer = b.request(loi::LOI4, Access::Request)?;
        let granted = answer.raw("LOI Granted").unwrap_or_default();
        t.expect_of(&answer, granted & loi::LOI4 == 0, || format!("expected B's request to be denied after the holder's discovery, got LOI Granted 0x{granted:02x}"))?;
    }
    t.expect(a.commands_work()?, || {
        "expected the holder's 2017 to work after its own discovery".into()
    })
}

fn vehicle_id_on_request_and_on_change(t: &Trial) -> Judged {
    let a = t.controller()?;
    let first = a.query(3)?;
    t.cite(&first);
    if t.bench.profile.subject.sets.is_empty()
        && first.text("Tail Number").is_none_or(|text| text.is_empty())
    {
        t.note("#3 has no tail number");
    }
    let home = home(t, &a)?;
    let name = format!("ID{}", t.bench.net.mark() % 10_000);
    let mark = t.bench.net.mark();
    if load(t, &a, &Plan::zigzag(&home, &name, &[1, 2]))?.status != Some(1) {
        return Err(Stop::inconclusive(
            "precondition \"a plan is loaded\" is not met: no 14000 status 1",
        ));
    }
    let changed = a.wait(mark, t.timers().answer, |seen| {
        seen.kind() == 3 && seen.text("Mission ID").as_deref() == Some(&name)
    });
    if changed.is_some() {
        return Ok(());
    }
    let asked = a.query(3)?;
    t.cite(&asked);
    if asked.has("Mission ID") && asked.text("Mission ID").as_deref() == Some(&name) {
        return Err(Stop::fail(format!(
            "expected #3 unasked when its Mission ID became {name}; it came only on request"
        )));
    }
    t.warn(format!(
        "#3 does not carry the mission id of the plan aboard ({name}), so its change cannot be seen"
    ));
    Ok(())
}
