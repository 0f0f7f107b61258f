//! A whole flight as a list of orders to a world: the same orders run under a virtual clock and between processes.

use std::time::Duration;

use px4_sim::Truth;
use stanag_msgs::enums::{
    AckType, AltitudeCommandType, AltitudeType, FlightPathControlMode as Mode, MissionPlanMode,
};
use stanag_msgs::messages::VehicleOperatingModeCommand;
use stanag_msgs::{Message, Scaled};

use super::orders;
use super::rig::Rig;
use super::station::{Station, Ticket};

/// A bridge between one station and one vehicle.
pub trait World {
    /// Time since the world was made.
    fn clock(&self) -> Duration;
    /// Lets time pass until `so` is true; returns false after `limit` seconds.
    fn wait(&mut self, limit: f64, so: &dyn Fn(&Self) -> bool) -> bool;
    /// Sends a message until it is answered.
    fn give(&mut self, message: Message) -> Ticket;
    /// The station.
    fn ground(&self) -> &Station;
    /// The station.
    fn ground_mut(&mut self) -> &mut Station;
    /// The true state of the vehicle, from the simulator.
    fn flown(&self) -> Truth;
    /// Kills the bridge and restarts it from its store.
    fn kill_bridge(&mut self);
    /// The phase of the flight, for a world that restarts something in one of them.
    fn enter(&mut self, _phase: &'static str) {}

    /// Whether the time of the whole test is used up: then no wait has any effect.
    fn is_over(&self) -> bool {
        false
    }

    /// Lets this many seconds pass.
    fn pass(&mut self, seconds: f64) {
        self.wait(seconds, &|_| false);
    }

    /// Waits for the final answer to a message, 90 s at most.
    fn ended(&mut self, ticket: Ticket) -> Option<AckType> {
        self.wait(90.0, &|world| world.ground().end(ticket).is_some());
        self.ground().end(ticket)
    }
}

impl World for Rig {
    fn clock(&self) -> Duration {
        self.clock.elapsed()
    }

    fn wait(&mut self, limit: f64, so: &dyn Fn(&Rig) -> bool) -> bool {
        self.until(limit, so)
    }

    fn give(&mut self, message: Message) -> Ticket {
        self.send(message)
    }

    fn ground(&self) -> &Station {
        self.station()
    }

    fn ground_mut(&mut self) -> &mut Station {
        &mut self.stations[0]
    }

    fn flown(&self) -> Truth {
        self.truth()
    }

    fn kill_bridge(&mut self) {
        self.restart_bridge();
    }

    fn enter(&mut self, phase: &'static str) {
        self.phase = phase;
    }
}

/// The results of flights.
#[derive(Debug, Default, Clone)]
pub struct Outcome {
    /// Flights that were flown.
    pub flights: u32,
    /// Flights completed up to the landing.
    pub completed: u32,
    /// Orders that were refused and had to be sent again.
    pub again: u32,
    /// Accepted waypoints that a restarted bridge did not know.
    pub lost: u32,
    /// Orders repeated late, byte for byte, that moved the vehicle once more.
    pub twice: u32,
    /// The longest upload of a route, s.
    pub load_s: f64,
    /// Where flights ended that were not completed.
    pub ended_at: Vec<String>,
}

impl Outcome {
    /// Counts a flight.
    pub fn count(&mut self, flown: Result<(), String>) {
        self.flights += 1;
        match flown {
            Ok(()) => self.completed += 1,
            Err(at) => self.ended_at.push(at),
        }
    }

    /// Adds the results of other flights.
    pub fn add(&mut self, other: Outcome) {
        self.flights += other.flights;
        self.completed += other.completed;
        self.again += other.again;
        self.lost += other.lost;
        self.twice += other.twice;
        self.load_s = self.load_s.max(other.load_s);
        self.ended_at.extend(other.ended_at);
    }

    /// The longest upload, rounded: its order of magnitude is what counts.
    pub fn upload(&self) -> String {
        [30.0, 60.0, 160.0]
            .iter()
            .find(|bound| self.load_s <= **bound)
            .map_or_else(
                || "over 160 s".to_owned(),
                |bound| format!("under {bound} s"),
            )
    }
}

/// 2016 mode 12 at metres above home.
pub fn hold_at(height_m: f64) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        altitude_command_type: Some(AltitudeCommandType::Altitude),
        commanded_altitude: Some(Scaled::saturating_from_si(height_m)),
        altitude_type: Some(AltitudeType::Agl),
        ..orders::mode(Mode::Loiter)
    }
}

/// Sends an order until it is carried out, as an operator would: six times at most, two seconds apart.
fn insist(
    world: &mut impl World,
    outcome: &mut Outcome,
    order: impl Into<Message>,
) -> Result<Ticket, String> {
    let order = order.into();
    for _ in 0..6 {
        let ticket = world.give(order.clone());
        match world.ended(ticket) {
            Some(AckType::CarriedOut) => return Ok(ticket),
            _ => outcome.again += 1,
        }
        world.ground_mut().give_up(ticket);
        world.pass(2.0);
    }
    Err(format!(
        "message {} was not carried out: {:?}",
        order.id(),
        last_alerts(world)
    ))
}

/// The latest texts of 16000, the last one first.
fn last_alerts(world: &impl World) -> Vec<String> {
    let mut reported = world.ground().alerts();
    reported.reverse();
    reported.truncate(8);
    reported
}

/// Launches. A launch whose last step was not confirmed in time is refused although the vehicle is in the air, so the
/// true state is checked.
fn launch(world: &mut impl World, outcome: &mut Outcome) -> Result<(), String> {
    for _ in 0..6 {
        let ticket = world.give(orders::launch(20.0).into());
        if world.ended(ticket) == Some(AckType::CarriedOut) || !world.flown().landed {
            return Ok(());
        }
        world.ground_mut().give_up(ticket);
        outcome.again += 1;
        world.pass(2.0);
    }
    Err(format!(
        "launch was not carried out: {:?}",
        last_alerts(world)
    ))
}

fn await_it<W: World>(
    world: &mut W,
    what: &str,
    limit: f64,
    so: impl Fn(&W) -> bool,
) -> Result<(), String> {
    if world.wait(limit, &so) {
        Ok(())
    } else {
        let truth = world.flown();
        Err(format!(
            "{what}: not within {limit} s; sequence {}, height {:.0} m",
            truth.mission_seq, -truth.position.d
        ))
    }
}

/// The phases of a flight.
pub const PHASES: [&str; 6] = [
    "control and plan",
    "upload",
    "launch",
    "route",
    "two altitudes",
    "landing",
];

/// One flight: control, plan, load, launch, route, a restart of the bridge on the way, two altitudes, a late
/// repetition, landing. An error where an order did not succeed, or the vehicle did not carry it out.
pub fn fly<W: World>(world: &mut W, outcome: &mut Outcome) -> Result<(), String> {
    world.enter(PHASES[0]);
    world.pass(10.0);
    insist(world, outcome, orders::request_control())?;
    for message in orders::square() {
        insist(world, outcome, message)?;
    }
    world.enter(PHASES[1]);
    let begun = world.clock();
    insist(world, outcome, orders::load())?;
    outcome.load_s = outcome.load_s.max((world.clock() - begun).as_secs_f64());
    world.enter(PHASES[2]);
    launch(world, outcome)?;
    await_it(world, "20 m", 60.0, |world| {
        -world.flown().position.d > 18.0
    })?;
    world.enter(PHASES[3]);
    insist(world, outcome, orders::mode(Mode::Waypoint))?;
    await_it(world, "the second waypoint", 90.0, |world| {
        world.flown().mission_seq >= 1
    })?;

    world.kill_bridge();
    world.pass(3.0);
    // The vehicle flies on, and the plan must still be known: each waypoint is requested separately, so that a lost
    // report is requested again.
    await_it(world, "the third waypoint", 120.0, |world| {
        world.flown().mission_seq >= 2
    })?;
    for number in 101..=104 {
        let known = is_known(world, number);
        if world.is_over() {
            return Err(format!("waypoint {number} was not reported in time"));
        }
        outcome.lost += u32::from(!known);
    }

    world.enter(PHASES[4]);
    let low = insist(world, outcome, hold_at(25.0))?;
    insist(world, outcome, hold_at(40.0))?;
    await_it(world, "40 m", 60.0, |world| {
        -world.flown().position.d > 39.0
    })?;
    for _ in 0..5 {
        world.ground_mut().repeat(low);
        world.pass(1.0);
    }
    world.pass(5.0);
    // A restarted vehicle is on the ground for another reason.
    let flown = world.flown();
    outcome.twice += u32::from(!flown.landed && -flown.position.d < 38.0);
    world.enter(PHASES[5]);
    insist(world, outcome, orders::mode(Mode::AutolandEngage))?;
    await_it(world, "the ground", 90.0, |world| !world.flown().armed)
}

/// Whether the bridge returns a waypoint, requested sixteen times at most: at 40 % loss eight lost answers in a row
/// happen once in 1,500.
pub fn is_known(world: &mut impl World, number: u16) -> bool {
    (0..16).any(|_| {
        let mark = world.ground().received.len();
        let mut one = orders::transfer(MissionPlanMode::DownloadWaypoint);
        one.waypoint_number = Some(number);
        let ticket = world.give(one.into());
        world.ended(ticket);
        world.pass(0.5);
        world.ground().received[mark..].iter().any(|(_, _, message)| {
            matches!(message, Message::UaPositionWaypoint(w) if w.waypoint_number == Some(number))
        })
    })
}

/// Compares a table between two marks of `docs/guide/reliability.md` with the results; with `VSM_BLESS` set it writes
/// the table.
pub fn hold_to_page(mark: &str, table: &str) {
    let path = crate::workspace().join("docs/guide/reliability.md");
    let page = std::fs::read_to_string(&path).expect("docs/guide/reliability.md is there");
    let (begin, end) = (
        format!("<!-- table: {mark} -->"),
        format!("<!-- end of table: {mark} -->"),
    );
    let (head, rest) = page.split_once(&begin).expect("the table's begin");
    let (old, tail) = rest.split_once(&end).expect("the table's end");
    if std::env::var_os("VSM_BLESS").is_some() {
        let page = format!("{head}{begin}\n{table}{end}{tail}");
        std::fs::write(path, page).expect("docs/guide/reliability.md can be written");
        return;
    }
    assert_eq!(old.trim(), table.trim(), "VSM_BLESS=1 rewrites it");
}
