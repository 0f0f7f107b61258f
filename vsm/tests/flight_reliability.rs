//! Whole flights over links that lose up to 40 % of their packets both ways; `docs/reliability.md` holds the table.
//!
//! `VSM_BLESS=1 cargo nextest run -p vsm --test flight_reliability` writes the table anew.

mod support;

use std::fmt::Write as _;

use stanag_msgs::enums::{
    AckType, AltitudeCommandType, AltitudeType, FlightPathControlMode as Mode, MissionPlanMode,
};
use stanag_msgs::messages::VehicleOperatingModeCommand;
use stanag_msgs::{Message, Scaled};
use support::{Faults, Rig, Setup, Ticket, orders};

/// What became of the flights at one rate of loss.
#[derive(Debug, Default)]
struct Outcome {
    flights: u32,
    completed: u32,
    /// Orders that ended refused and had to be given again.
    again: u32,
    /// Accepted waypoints that a restarted bridge did not know.
    lost: u32,
    /// Orders repeated late, octet for octet, that moved the vehicle once more.
    twice: u32,
    /// The longest upload of a route, s.
    load_s: f64,
}

impl Outcome {
    fn row(&self, loss: f64) -> String {
        format!(
            "| {:.0} % | {} of {} | {} | {} | {} |",
            loss * 100.0,
            self.completed,
            self.flights,
            self.lost,
            self.twice,
            // Coarse: what matters is the order of magnitude.
            [10.0, 40.0, 160.0]
                .iter()
                .find(|bound| self.load_s <= **bound)
                .map_or_else(
                    || "over 160 s".to_owned(),
                    |bound| format!("under {bound} s")
                ),
        )
    }
}

/// Gives an order until it is carried out, as an operator would, six times at most.
fn insist(rig: &mut Rig, outcome: &mut Outcome, order: impl Into<Message>) -> Option<Ticket> {
    let order = order.into();
    for _ in 0..6 {
        let ticket = rig.tell(order.clone());
        match rig.end(ticket) {
            Some(AckType::CarriedOut) => return Some(ticket),
            _ => outcome.again += 1,
        }
        rig.stations[0].give_up(ticket);
    }
    None
}

/// A launch whose last step was not seen in time is refused, and the vehicle is in the air all the same.
fn launch(rig: &mut Rig, outcome: &mut Outcome) -> Option<()> {
    for _ in 0..6 {
        let end = rig.carry_out(orders::launch(20.0));
        if end == Some(AckType::CarriedOut) || !rig.truth().landed {
            return Some(());
        }
        outcome.again += 1;
    }
    None
}

fn hold_at(height_m: f64) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        altitude_command_type: Some(AltitudeCommandType::Altitude),
        commanded_altitude: Some(Scaled::saturating_from_si(height_m)),
        altitude_type: Some(AltitudeType::Agl),
        ..orders::mode(Mode::Loiter)
    }
}

/// One flight: control, plan, load, launch, route, a restart of the bridge in the middle, two altitudes, a late
/// repetition, landing. `None` where an order could not be got through.
fn fly(loss: f64, seed: u64, outcome: &mut Outcome) -> Option<()> {
    let faults = Faults::lossy(loss);
    let mut rig = Rig::new(Setup {
        seed,
        dli: faults,
        mav: faults,
        ..Setup::default()
    });
    rig.run(10.0);
    insist(&mut rig, outcome, orders::request_control())?;
    for message in orders::square() {
        insist(&mut rig, outcome, message)?;
    }
    let begun = rig.clock;
    insist(&mut rig, outcome, orders::load())?;
    outcome.load_s = outcome.load_s.max((rig.clock - begun).as_secs_f64());
    launch(&mut rig, outcome)?;
    rig.until(60.0, |rig| -rig.truth().position.d > 18.0)
        .then_some(())?;
    insist(&mut rig, outcome, orders::mode(Mode::Waypoint))?;
    rig.until(90.0, |rig| rig.truth().mission_seq >= 1)
        .then_some(())?;

    rig.restart_bridge();
    rig.run(3.0);
    // The vehicle flies on, and the plan is known: each waypoint by itself, so that a lost report is asked for again.
    rig.until(120.0, |rig| rig.truth().mission_seq >= 2)
        .then_some(())?;
    for number in 101..=104 {
        let known = (0..8).any(|_| {
            let mark = rig.station().heard.len();
            let mut one = orders::transfer(MissionPlanMode::DownloadWaypoint);
            one.waypoint_number = Some(number);
            rig.carry_out(one);
            rig.run(0.5);
            rig.station().heard[mark..].iter().any(|(_, _, message)| {
                matches!(message, Message::UaPositionWaypoint(w) if w.waypoint_number == Some(number))
            })
        });
        outcome.lost += u32::from(!known);
    }

    let low = insist(&mut rig, outcome, hold_at(25.0))?;
    insist(&mut rig, outcome, hold_at(40.0))?;
    rig.until(60.0, |rig| -rig.truth().position.d > 39.0)
        .then_some(())?;
    for _ in 0..5 {
        rig.stations[0].repeat(low);
        rig.run(1.0);
    }
    rig.run(5.0);
    outcome.twice += u32::from(-rig.truth().position.d < 38.0);
    insist(&mut rig, outcome, orders::mode(Mode::AutolandEngage))?;
    rig.until(90.0, |rig| !rig.truth().armed).then_some(())
}

#[test]
fn the_table_of_outcomes_is_up_to_date() {
    let mut table = String::from(
        "| loss each way | flights completed | accepted and lost | carried out twice | longest upload of 4 waypoints |\n\
         |---|---|---|---|---|\n",
    );
    for loss in [0.0, 0.1, 0.2, 0.3, 0.4] {
        let mut outcome = Outcome::default();
        for seed in 1..=3 {
            outcome.flights += 1;
            outcome.completed += u32::from(fly(loss, seed, &mut outcome).is_some());
        }
        assert_eq!((outcome.lost, outcome.twice), (0, 0), "{loss}: {outcome:?}");
        // Beyond that an order may need giving more than six times: the table says what came of it.
        assert!(
            loss > 0.3 || outcome.completed == outcome.flights,
            "{loss}: {outcome:?}"
        );
        writeln!(table, "{}", outcome.row(loss)).expect("a String takes all");
    }
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/reliability.md");
    let page = std::fs::read_to_string(path).expect("docs/reliability.md is there");
    let (head, rest) = page.split_once(BEGIN).expect("the table's begin");
    let (old, tail) = rest.split_once(END).expect("the table's end");
    if std::env::var_os("VSM_BLESS").is_some() {
        let page = format!("{head}{BEGIN}\n{table}{END}{tail}");
        std::fs::write(path, page).expect("docs/reliability.md can be written");
        return;
    }
    assert_eq!(old.trim(), table.trim(), "VSM_BLESS=1 writes it anew");
}

const BEGIN: &str = "<!-- table: loss -->";
const END: &str = "<!-- end of table -->";
