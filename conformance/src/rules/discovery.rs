//! DISC, discovery and identification (messages 1 to 3): that a broadcast is answered for each vehicle, that an offer
//! is not a grant, and that a discovery changes nobody's rights.

use std::collections::BTreeSet;
use std::time::Duration;

use stanag_msgs::Id;

use super::scene::Scene;
use crate::bench::flight::{Plan, home, load};
use crate::bench::station::{Access, authorisation, discovery, information_request, loi, schedule};
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Precondition, Stop};
use crate::wire::Draft;

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
        rule: "DISC-005",
        play: logical_ids_without_a_vehicle,
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
    // Answered every time, and to each CUCS that may connect.
    let known: Vec<Id> = t
        .bench
        .surveyed()?
        .cucs
        .iter()
        .filter(|cucs| cucs.authorised != 0)
        .map(|cucs| cucs.id)
        .collect();
    for id in known.into_iter().chain([station.id]) {
        let station = t.station(id)?;
        t.expect(!station.discover()?.is_empty(), || {
            format!("expected message 2 to every discovery of {id}; none came to a later one")
        })?;
    }
    Ok(())
}

fn one_response_for_each_vehicle(t: &Trial) -> Judged {
    let station = t.any()?;
    let expected: BTreeSet<Id> = t.bench.surveyed()?.vehicle_ids().collect();
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
    // A directed request for nothing by a CUCS that was never granted anything grants nothing either.
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
    stranger.send(information_request(3));
    stranger.send(information_request(4000));
    stranger.send(schedule(3, 5));
    stranger.send(super::configuration::request(1));
    stranger.send(crate::bench::flight::transfer(3, "FOREIGN"));
    stranger.send(Draft::new(15000).raw("Subsystem ID", 0xFFF));
    stranger.send(
        Draft::new(2017)
            .set("Loiter Radius", t.bench.fresh_radius())
            .acked(),
    );
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
    let status = stranger.received(mark, |seen| {
        matches!(seen.kind(), 3 | 3000..=4001 | 13001..=14000 | 16000 | 16001 | 21000 | 41000..=41005 | 44003)
            || seen.kind() == 17000 && seen.raw("Acknowledgement Type") == Some(2)
    });
    t.expect(status.is_empty(), || {
        format!(
            "expected no status, configuration or 'carried out' to {}, which has no rights; message {} came",
            stranger.id,
            status[0].kind()
        )
    })?;
    let good = t.any()?;
    good.request(0, Access::Release)
        .precondition("the subject still answers")?;
    Ok(())
}

fn logical_ids_without_a_vehicle(t: &Trial) -> Judged {
    let means = &t.bench.profile.means;
    let (Some(cut), Some(restore)) = (&means.cut_vehicle_link, &means.restore_vehicle_link) else {
        return Err(Stop::not_applicable(
            "needs means.cut_vehicle_link and means.restore_vehicle_link in the profile",
        ));
    };
    let station = t.any()?;
    let real = station.vehicle;
    crate::means::shell(cut).map_err(Stop::Inconclusive)?;
    let result = (|| {
        t.pause(Duration::from_secs(6))?;
        let offers = station.discover()?;
        let Some(offer) = offers.first() else {
            return Err(Stop::fail(
                "expected a logical vehicle id on offer while no vehicle is connected; no message 2 came",
            ));
        };
        for seen in &offers {
            let others = t
                .bench
                .surveyed()?
                .vehicles
                .iter()
                .any(|vehicle| vehicle.id == seen.piece.source && vehicle.id != real);
            t.expect_of(seen, others || seen.piece.source.owner() == 0, || {
                format!(
                    "expected a logical vehicle id (first byte 0) while no vehicle is connected, got {}",
                    seen.piece.source
                )
            })?;
        }
        let logical = offer.piece.source;
        let mark = t.bench.net.mark();
        station.send(information_request(3).to(logical));
        let named = station.wait(mark, t.timers().answer / 2, |seen| {
            seen.kind() == 3 && seen.piece.source == logical && logical.owner() == 0
        });
        if let Some(named) = named {
            let tail = named.text("Tail Number").unwrap_or_default();
            t.expect_of(&named, ["", "0"].contains(&tail.as_str()), || {
                format!("expected a tail number of zero in #3 of {logical} while no vehicle is connected, got {tail:?}")
            })?;
        }
        Ok(logical)
    })();
    let mark = t.bench.net.mark();
    crate::means::shell(restore).map_err(Stop::Inconclusive)?;
    // A fail seen during the cut ends the rule: waiting longer could not change it.
    let logical = match result {
        Ok(logical) => logical,
        Err(stop) => {
            super::link::fresh_again(t)?;
            return Err(stop);
        }
    };
    let update = station.wait(mark, Duration::from_secs(10), |seen| {
        seen.kind() == 3 && seen.raw("Vehicle ID Update").map(|raw| Id(raw as u32)) == Some(real)
    });
    t.expect(update.is_some(), || {
        format!("expected #3 with Vehicle ID Update {real} from {logical} once the vehicle is connected; none came")
    })
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
    if !t.of_edition_25() {
        // Another CUCS's discovery takes nothing either. (Sent to the vehicle itself, LOI 0 with access 0 may mean
        // "all levels".)
        if let Ok(b) = t.b() {
            b.discover()?;
        }
        let answer = a.request(0, Access::Request)?;
        let granted = answer.raw("LOI Granted").unwrap_or_default();
        t.expect_of(&answer, granted & loi::LOI4 != 0, || {
            format!("expected LOI 4 to stay with its holder when another CUCS discovers; got LOI Granted 0x{granted:02x}")
        })?;
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
    // It names its own id, or the one it will have from now on, which is that of a vehicle on offer.
    let update = first.raw("Vehicle ID Update").map(|raw| Id(raw as u32));
    let offered = &t.bench.surveyed()?.vehicles;
    t.expect_of(
        &first,
        update.is_none_or(|id| {
            [Id(0), Id::NULL].contains(&id) || offered.iter().any(|vehicle| vehicle.id == id)
        }),
        || {
            format!(
                "expected the id of a vehicle on offer as Vehicle ID Update in #3, got {update:?}"
            )
        },
    )?;
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
