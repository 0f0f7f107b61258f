//! Each record of the store in turn cannot be written, in flight: what is refused, what is reported, and that nothing that
//! was accepted is lost over a restart. `docs/guide/reliability.md` holds the table.
//!
//! `VSM_BLESS=1 cargo nextest run -p vsm --test flight full_disk` writes the table again.

use std::fmt::Write as _;

use kit::bridge::flight::{hold_at, hold_to_page};
use kit::bridge::{Rig, Setup, orders};
use stanag_msgs::Message;
use stanag_msgs::enums::{
    AckType, FlightPathControlMode as Mode, MissionPlanMode, RequestedAccess,
};
use stanag_msgs::messages::CucsAuthorisationRequest;

/// What became of the orders while a record could not be written.
#[derive(Debug, PartialEq, Eq)]
struct Outcome {
    waypoint: AckType,
    load: AckType,
    hold: AckType,
    control: AckType,
    later: AckType,
    reported: bool,
    lost: bool,
    land: AckType,
}

fn end(rig: &mut Rig, order: impl Into<Message>) -> AckType {
    rig.carry_out(order).unwrap_or(AckType::Unknown(0))
}

fn fly(full: &'static str, written_over: Option<&'static str>) -> Outcome {
    let mut rig = Rig::ready_with(Setup {
        stations: 2,
        ..Setup::default()
    });
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.take_off(20.0);
    rig.store.full = Some(full);
    rig.store.written_over = written_over;
    let waypoint = end(&mut rig, orders::waypoint(102, 103, 40.0, 40.0, 60.0));
    let load = end(&mut rig, orders::load());
    let hold = end(&mut rig, orders::mode(Mode::Loiter));
    let listen = CucsAuthorisationRequest {
        requested_handover_access: Some(RequestedAccess::Request),
        requested_handover_loi: Some(stanag_msgs::enums::LoiBitmap::LOI2),
        ..orders::request_control()
    };
    let ticket = rig.send_as(1, 0, listen);
    let control = rig.end_as(1, ticket).unwrap_or(AckType::Unknown(0));
    // Longer than the signing clock is written ahead.
    rig.run(120.0);
    let later = end(&mut rig, hold_at(25.0));
    let reported = ["cannot be stored", "could not be stored", "No space left"]
        .iter()
        .any(|text| rig.station().has_alert(text));
    rig.store.full = None;
    rig.restart_bridge();
    rig.run(5.0);
    if waypoint == AckType::CarriedOut && load != AckType::CarriedOut {
        // Not loaded, and not lost: the next 13000 loads it.
        assert_eq!(end(&mut rig, orders::load()), AckType::CarriedOut);
    }
    let mark = rig.station().received.len();
    let down = end(&mut rig, orders::transfer(MissionPlanMode::Download));
    rig.run(0.5);
    let height = rig.station().received[mark..]
        .iter()
        .find_map(|(_, _, m)| match m {
            Message::UaPositionWaypoint(w) if w.waypoint_number == Some(102) => {
                w.waypoint_to_altitude.map(|altitude| altitude.si())
            }
            _ => None,
        });
    let expected = if waypoint == AckType::CarriedOut {
        60.0
    } else {
        20.0
    };
    let lost = down != AckType::CarriedOut || height != Some(expected);
    let land = end(&mut rig, orders::mode(Mode::AutolandEngage));
    Outcome {
        waypoint,
        load,
        hold,
        control,
        later,
        reported,
        lost,
        land,
    }
}

#[test]
fn a_record_that_cannot_be_written_refuses_what_it_must_keep_and_loses_nothing() {
    let mut table = String::from(
        "| record that cannot be written | waypoint | load | hold | a right granted | hold after two minutes | \
         reported by 16000 | accepted and lost | landing after the restart |\n|---|---|---|---|---|---|---|---|---|\n",
    );
    for (full, written_over, name) in RECORDS {
        let outcome = fly(full, written_over);
        let word = |answer: AckType| match answer {
            AckType::CarriedOut => "carried out",
            AckType::Refused => "refused",
            _ => "no answer",
        };
        let yes = |so: bool| if so { "yes" } else { "no" };
        writeln!(
            table,
            "| {name} | {} | {} | {} | {} | {} | {} | {} | {} |",
            word(outcome.waypoint),
            word(outcome.load),
            word(outcome.hold),
            word(outcome.control),
            word(outcome.later),
            yes(outcome.reported),
            yes(outcome.lost),
            word(outcome.land)
        )
        .expect("a String takes all");
        assert!(!outcome.lost, "{name}: {outcome:?}");
        assert_eq!(
            outcome.hold,
            AckType::CarriedOut,
            "{name}: the flight continues"
        );
        // Without the signing clock nothing may be sent to the vehicle.
        let link = full != "clock" && (!full.is_empty() || written_over.is_some());
        assert_eq!(outcome.later == AckType::CarriedOut, link, "{name}");
        assert_eq!(outcome.land, AckType::CarriedOut, "{name}");
    }
    hold_to_page("full disk", &table);
}

/// What cannot be written, what of it is written over in its place, and their name.
const RECORDS: [(&str, Option<&str>, &str); 7] = [
    ("plan", None, "plan"),
    ("aboard", None, "route aboard"),
    ("authority", None, "authority"),
    ("audit", None, "audit log"),
    ("clock", None, "signing clock"),
    ("", Some("clock"), "every record: a full disk"),
    ("", None, "every record, the signing clock too: read-only"),
];
