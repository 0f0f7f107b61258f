//! One fault from its making to the verdict.

use std::net::UdpSocket;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, anyhow, bail};

use super::capture::{FIRST_PORT, locked};
use super::draw::Dice;
use super::kind::{Fault, Kind};
use super::network::{Host, NODES, Net, VIP};
use super::process::interrupted;
use super::station::{ALTITUDES, Draw, Stations, Work, do_work, nth_altitude};
use super::wire::{Answer, Order, Wire, is_same};
use super::world::World;

/// What became of a fault.
#[derive(Debug)]
pub(super) struct Record {
    pub(super) kind: Kind,
    pub(super) line: String,
    /// Until the last vehicle had a frame of the next node, where one took over.
    pub(super) taken_over: Option<Duration>,
    /// Until a command was carried out again.
    pub(super) restored: Duration,
    /// What must not be.
    pub(super) violations: Vec<String>,
    /// The command of which the answer was on its way reached the vehicle twice, as documented.
    pub(super) repeated: bool,
    /// How long the earlier node still reported to stations beside the next one.
    pub(super) both_report: Duration,
    /// Answers of the earlier node after the next one had begun to serve: it can store nothing, and so mostly refuses.
    pub(super) late_answers: usize,
    /// The station has such a refusal for its result, and the next node carried the command out.
    pub(super) contradicted: bool,
    /// Frames of the earlier node that vehicles refuse.
    pub(super) fenced: u64,
    pub(super) work: Work,
    pub(super) accepted: bool,
}

/// Makes one fault, with something done meanwhile, waits until all is as before, and judges.
pub(super) fn one(
    world: &mut World,
    stations: &mut Stations,
    dice: &mut Dice,
    kinds: &[Kind],
) -> Result<Record> {
    let before = world.settled(SETTLES)?;
    let mut fault = Fault::draw(dice, kinds, before.0);
    let vehicle = dice.below(world.vehicles);
    let draw = [Draw::Altitude, Draw::Altitude, Draw::Plan, Draw::Right][dice.below(4)];
    let fenced = fenced(&locked(&world.wire));
    let broken = world.computers.broken_audit_logs();
    locked(&world.wire).begin();
    stations.current.iter_mut().for_each(Vec::clear);
    let work = stations.draw(draw, vehicle);

    // From 0.4 s before the fault to 0.8 s after it has begun.
    let begins = Instant::now() + Duration::from_millis(dice.below(1_200) as u64);
    let computers = world.computers.clone();
    let doing = thread::spawn(move || {
        thread::sleep(begins.saturating_duration_since(Instant::now()));
        do_work(&computers, vehicle, work)
    });
    thread::sleep(Duration::from_millis(400));
    let injected = fault.inject(world);
    // What was made before it failed is healed too.
    fault.heal(world)?;
    injected?;

    world.settled(SETTLES)?;
    let (accepted, printed) = doing
        .join()
        .map_err(|_| anyhow!("the station panicked"))??;
    stations.note(vehicle, work, accepted);
    let restored = probe(stations, vehicle, fault.at)?;
    let mut violations = stations.read_back(vehicle)?;
    // Only now: a lease may have ended since the fault was healed.
    let (owner, epoch) = world.settled(SETTLES)?;

    let mut wire = locked(&world.wire);
    violations.append(&mut wire.violations);
    let after = world.computers.broken_audit_logs();
    let audits = after.difference(&broken);
    violations.extend(audits.map(|log| format!("an audit log lost a line: {log}")));
    violations.extend(owners(&wire, owner, epoch - before.1));
    let mut repeated = false;
    violations.extend(late_orders(&wire, &stations.current));
    if let Work::Altitude(altitude) = work {
        let runs = wire.vehicles[vehicle].runs(altitude);
        match carried_out(&runs, &wire.answers, accepted, fault.kind.loses_answers()) {
            Ok(twice) => repeated = twice,
            Err(why) => violations.push(format!("{why}: {altitude} m, {runs:?}; {printed}")),
        }
    }
    let once = epoch == before.1 + 1 && owner != before.0;
    let mut record = Record {
        kind: fault.kind,
        line: fault.in_words(),
        taken_over: once.then(|| taken_over(&wire, owner, fault.at)).flatten(),
        restored,
        violations,
        repeated,
        both_report: Duration::ZERO,
        late_answers: 0,
        contradicted: false,
        fenced: self::fenced(&wire) - fenced,
        work,
        accepted,
    };
    if let (true, Some((begun, _))) = (once, wire.reports[owner]) {
        if let Some((_, last)) = wire.reports[before.0] {
            record.both_report = last.saturating_duration_since(begun);
        }
        let late = |answer: &&Answer| answer.node == before.0 && answer.at > begun + DECODED;
        let runs = match work {
            Work::Altitude(altitude) => wire.vehicles[vehicle].runs(altitude),
            _ => Vec::new(),
        };
        // What it did before it stood still it may report later. Plans and rights are read back.
        let did = runs
            .iter()
            .any(|run| run.node == before.0 && run.at < begun);
        let commands = matches!(work, Work::Altitude(_));
        for answer in wire.answers.iter().filter(late) {
            record.late_answers += 1;
            if answer.kind == CARRIED_OUT && commands && !did {
                record.violations.push(format!(
                    "two owners: n{} reported a command as carried out after n{owner} had begun to serve, and the vehicle had none of it",
                    before.0
                ));
            }
        }
        let flown = !runs.is_empty();
        record.contradicted = flown && !accepted && record.late_answers > 0;
    }
    Ok(record)
}

/// Commands altitudes until one is carried out; returns how long that was after the fault.
fn probe(stations: &mut Stations, vehicle: usize, at: Instant) -> Result<Duration> {
    let end = Instant::now() + SETTLES;
    loop {
        interrupted()?;
        let order = stations.draw(Draw::Altitude, vehicle);
        let (done, printed) = stations.work(vehicle, order)?;
        if done {
            return Ok(at.elapsed());
        }
        if Instant::now() > end {
            bail!(
                "no command of vehicle {} within {SETTLES:?}: {printed}",
                vehicle + 1
            );
        }
        thread::sleep(Duration::from_millis(200));
    }
}

/// Each change of the node that a vehicle accepts is a change of the owner, and in the end it accepts the owner.
fn owners(wire: &Wire, owner: usize, epochs: u64) -> Vec<String> {
    let mut wrong = Vec::new();
    for (number, vehicle) in wire.vehicles.iter().enumerate() {
        let one = number + 1;
        if vehicle.changes.len() as u64 > epochs {
            let nodes: Vec<_> = vehicle.changes.iter().map(|(_, node)| node).collect();
            wrong.push(format!(
                "two owners: vehicle {one} accepted nodes {nodes:?} in turn, and the owner changed {epochs} times"
            ));
        }
        if vehicle.serving != Some(owner) {
            let serving = vehicle.serving;
            wrong.push(format!(
                "vehicle {one} accepts node {serving:?}, and n{owner} serves"
            ));
        }
    }
    wrong
}

/// Commands on the wire that were given before this fault.
fn late_orders(wire: &Wire, current: &[Vec<f32>]) -> Vec<String> {
    let mut late = Vec::new();
    for (number, vehicle) in wire.vehicles.iter().enumerate() {
        for order in &vehicle.orders {
            let given = |altitude: f32| is_same(altitude, order.altitude_m);
            let now = current[number].iter().any(|altitude| given(*altitude));
            if !now && (0..ALTITUDES).map(nth_altitude).any(given) {
                late.push(format!(
                    "a command twice, or late: vehicle {} again to {} m by n{}",
                    number + 1,
                    order.altitude_m,
                    order.node
                ));
            }
        }
    }
    late
}

/// Whether a command was carried out as it was answered: `Ok(true)` where it was repeated as documented, since its answer
/// was on its way when the node was lost. `retries`: the vehicle's own answer may have been lost, so that the node repeats it.
fn carried_out(
    runs: &[Order],
    answers: &[Answer],
    accepted: bool,
    retries: bool,
) -> Result<bool, String> {
    if runs.is_empty() && accepted {
        return Err("a command lost: answered as carried out, and not on the wire".to_owned());
    }
    let mut repeated = false;
    for pair in runs.windows(2) {
        let (first, second) = (pair[0], pair[1]);
        let answered = |answer: &Answer| {
            answer.node == first.node
                && answer.kind == CARRIED_OUT
                && (first.at..second.at).contains(&answer.at)
        };
        if answers.iter().any(answered) {
            return Err("a command twice, the first one answered".to_owned());
        }
        if first.node != second.node {
            repeated = true;
        } else if !retries {
            return Err("a command twice".to_owned());
        }
    }
    Ok(repeated)
}

fn taken_over(wire: &Wire, owner: usize, at: Instant) -> Option<Duration> {
    let first = |vehicle: &super::wire::Vehicle| {
        let change = vehicle.changes.iter().find(|(_, node)| *node == owner);
        change.map(|(when, _)| when.saturating_duration_since(at))
    };
    let all: Option<Vec<_>> = wire.vehicles.iter().map(first).collect();
    all?.into_iter().max()
}

fn fenced(wire: &Wire) -> u64 {
    wire.vehicles.iter().map(|vehicle| vehicle.fenced).sum()
}

/// Sends the last frame to a vehicle once more, from a node that stands by: a violation that has to be found.
pub(super) fn plant(world: &World) -> Result<()> {
    let (owner, _) = world.settled(SETTLES)?;
    let (port, bytes) = locked(&world.wire)
        .last
        .clone()
        .context("no frame was captured")?;
    let to = format!("{}:{port}", Net::Air.address(Host::Vehicles));
    world
        .network()
        .on(Host::Node((owner + 1) % NODES), move || {
            let socket =
                UdpSocket::bind((VIP, FIRST_PORT)).context("the address of the vehicles")?;
            socket.send_to(&bytes, to)?;
            Ok(())
        })?;
    thread::sleep(Duration::from_millis(300));
    Ok(())
}

/// A lease of 2 s, a restart, and a boot of vehicles that have lost their ground.
const SETTLES: Duration = Duration::from_secs(90);
/// A 17000 is noted when `vsm decode` has decoded it.
const DECODED: Duration = Duration::from_millis(100);
/// Acknowledgement Type of a 17000.
const CARRIED_OUT: u64 = 2;

#[cfg(test)]
mod tests {
    use super::*;

    fn run(node: usize, at: Instant) -> Order {
        Order {
            at,
            node,
            altitude_m: 520.0,
        }
    }

    #[test]
    fn a_command_is_once_on_the_wire_or_repeated_before_its_answer() {
        let now = Instant::now();
        let later = |ms| now + Duration::from_millis(ms);
        let (first, second) = (run(0, now), run(1, later(3_000)));
        let again = [first, run(0, later(900))];
        let answer = Answer {
            at: later(50),
            node: 0,
            kind: 2,
        };
        assert_eq!(carried_out(&[first], &[answer], true, false), Ok(false));
        assert_eq!(carried_out(&[], &[], false, false), Ok(false));
        assert_eq!(carried_out(&[first, second], &[], true, false), Ok(true));
        assert_eq!(carried_out(&again, &[], true, true), Ok(false));
        assert!(carried_out(&again, &[], true, false).is_err());
        assert!(carried_out(&again, &[answer], true, true).is_err());
        assert!(carried_out(&[first, second], &[answer], true, true).is_err());
        assert!(carried_out(&[], &[], true, false).is_err());
    }

    #[test]
    fn a_command_of_an_earlier_fault_is_found() {
        let mut wire = Wire::new(1);
        wire.vehicles[0].orders = vec![run(0, Instant::now())];
        assert!(late_orders(&wire, &[vec![520.0]]).is_empty());
        assert_eq!(late_orders(&wire, &[vec![521.0]]).len(), 1);
        // A hold at the altitude where it is.
        wire.vehicles[0].orders[0].altitude_m = 520.1;
        assert!(late_orders(&wire, &[vec![521.0]]).is_empty());
    }
}
