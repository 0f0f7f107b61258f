//! The stations of `cargo xtask faults`: `cucs` as a program, one process for each thing that is done, and what they know to
//! be accepted.
//!
//! One controls all vehicles, and commands altitudes, each of which is new to its vehicle, so that a command can be found
//! on the wire; and sends plans of which each has a name of its own. The other takes and releases the right to monitor.

use std::collections::BTreeSet;
use std::fs;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};

use super::capture::GROUP_PORT;
use super::network::{Host, Net};
use super::process::finish;
use super::world::{Computers, GROUP, STATIONS, vehicle_id};

/// What is done while a fault lasts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Work {
    /// Loiters at an altitude above mean sea level, m.
    Altitude(f32),
    /// Sends and loads the plan with this number.
    Plan(u32),
    /// Takes (or releases) the right of the second station.
    Right(bool),
}

/// What the stations know.
#[derive(Debug)]
pub(super) struct Stations {
    computers: Arc<Computers>,
    /// By vehicle: the plan that was accepted last, and those that perhaps were since.
    plans: Vec<Plans>,
    /// By vehicle: what the right of the second station may be.
    rights: Vec<BTreeSet<bool>>,
    /// By vehicle: how many altitudes were commanded.
    altitudes: Vec<u16>,
    /// By vehicle: those since the fault began.
    pub(super) current: Vec<Vec<f32>>,
    next_plan: u32,
}

#[derive(Debug, Default, Clone)]
struct Plans {
    accepted: u32,
    /// Sent since, with no answer that says what became of it. A plan is sent in parts, so it may be mixed with the other.
    unknown: bool,
}

impl Stations {
    pub(super) fn new(computers: Arc<Computers>, vehicles: usize) -> Stations {
        Stations {
            computers,
            plans: vec![Plans::default(); vehicles],
            rights: vec![BTreeSet::from([false]); vehicles],
            altitudes: vec![0; vehicles],
            current: vec![Vec::new(); vehicles],
            next_plan: 1,
        }
    }

    /// Takes control of a vehicle, launches it, and has it fly a plan.
    pub(super) fn begin(&mut self, vehicle: usize) -> Result<()> {
        let end = Instant::now() + BOOT;
        // It boots: until then there is nothing to launch.
        while !self.cucs(0, vehicle, &["launch", "30"])?.0 {
            if Instant::now() > end {
                bail!("vehicle {} cannot be launched within {BOOT:?}", vehicle + 1);
            }
            self.cucs(0, vehicle, &["take"])?;
            thread::sleep(Duration::from_millis(500));
        }
        let plan = self.draw(Draw::Plan, vehicle);
        let (done, printed) = self.work(vehicle, plan)?;
        self.note(vehicle, plan, done);
        if !done {
            bail!("vehicle {} accepts no plan: {printed}", vehicle + 1);
        }
        let (done, printed) = self.cucs(0, vehicle, &["fly"])?;
        if !done {
            bail!("vehicle {} does not fly: {printed}", vehicle + 1);
        }
        Ok(())
    }

    /// The next work of a kind for a vehicle.
    pub(super) fn draw(&mut self, kind: Draw, vehicle: usize) -> Work {
        match kind {
            Draw::Altitude => {
                let number = &mut self.altitudes[vehicle];
                *number = (*number + 1) % ALTITUDES;
                let altitude = nth_altitude(*number);
                self.current[vehicle].push(altitude);
                Work::Altitude(altitude)
            }
            Draw::Plan => {
                self.next_plan += 1;
                Work::Plan(self.next_plan)
            }
            Draw::Right => Work::Right(!self.rights[vehicle].contains(&true)),
        }
    }

    /// Does it: whether it was accepted, and what the station printed.
    pub(super) fn work(&self, vehicle: usize, work: Work) -> Result<(bool, String)> {
        do_work(&self.computers, vehicle, work)
    }

    /// Notes what became of a work. One that was not accepted may have been carried out: its answer was lost.
    pub(super) fn note(&mut self, vehicle: usize, work: Work, accepted: bool) {
        match work {
            Work::Altitude(_) => {}
            Work::Plan(number) if accepted => {
                self.plans[vehicle] = Plans {
                    accepted: number,
                    unknown: false,
                };
            }
            Work::Plan(_) => self.plans[vehicle].unknown = true,
            Work::Right(held) if accepted => self.rights[vehicle] = BTreeSet::from([held]),
            Work::Right(held) => {
                self.rights[vehicle].insert(held);
            }
        }
    }

    /// Reads back what was accepted, and returns what is not as it was.
    pub(super) fn read_back(&mut self, vehicle: usize) -> Result<Vec<String>> {
        let mut lost = Vec::new();
        for station in 0..STATIONS.len() {
            let granted = self.granted(station)?;
            for (number, held) in granted.iter().enumerate() {
                let one = number + 1;
                if station == 0 && *held != [2, 3, 4, 5] {
                    lost.push(format!(
                        "right lost: control of vehicle {one} is now {held:?}"
                    ));
                }
                let may = &mut self.rights[number];
                if station == 1 && !may.contains(&!held.is_empty()) {
                    lost.push(format!(
                        "right lost: monitoring vehicle {one} is now {held:?}, and was {may:?}"
                    ));
                }
                if station == 1 {
                    *may = BTreeSet::from([!held.is_empty()]);
                }
            }
        }
        // Control has one owner.
        if self.ask(1, vehicle, &["take", "--loi", "4"])?.0 {
            lost.push(format!(
                "two owners: both stations control vehicle {}",
                vehicle + 1
            ));
        }
        lost.extend(self.read_plan(vehicle)?);
        Ok(lost)
    }

    fn read_plan(&mut self, vehicle: usize) -> Result<Option<String>> {
        if self.plans[vehicle].unknown {
            // Known again with the next plan that is accepted. A lease that has lapsed once more refuses it, with that reason.
            let end = Instant::now() + WITHIN;
            let plan = loop {
                let plan = self.draw(Draw::Plan, vehicle);
                let (done, printed) = self.work(vehicle, plan)?;
                if done {
                    break plan;
                }
                if Instant::now() > end {
                    // Behind the alerts that it printed before.
                    let why = printed.lines().last().unwrap_or_default();
                    let one = vehicle + 1;
                    return Ok(Some(format!("vehicle {one} accepts no plan: {why}")));
                }
                thread::sleep(Duration::from_millis(200));
            };
            self.note(vehicle, plan, true);
        }
        let number = self.plans[vehicle].accepted;
        let (_, printed) = self.ask(0, vehicle, &["download"])?;
        let whole = format!("p{number}\\\"");
        let same = printed.contains(&whole) && printed.matches(&altitude(number)).count() == 2;
        Ok((!same).then(|| format!("plan {number} of vehicle {} lost: {printed}", vehicle + 1)))
    }

    /// By vehicle: the levels that a station holds.
    fn granted(&self, station: usize) -> Result<Vec<Vec<u64>>> {
        let end = Instant::now() + WITHIN;
        loop {
            let (_, printed) = self.cucs(station, 0, &["discover"])?;
            let lines = printed
                .lines()
                .filter_map(|line| serde_json::from_str(line).ok());
            let lines: Vec<serde_json::Value> = lines.collect();
            let of = |vehicle| {
                let line = lines
                    .iter()
                    .find(|line| line["vehicle"] == vehicle_id(vehicle))?;
                let granted = line["granted"].as_array()?;
                Some(
                    granted
                        .iter()
                        .filter_map(serde_json::Value::as_u64)
                        .collect(),
                )
            };
            let granted: Option<Vec<_>> = (0..self.plans.len()).map(of).collect();
            match granted {
                Some(granted) => return Ok(granted),
                None if Instant::now() > end => bail!("no answer of every vehicle: {printed}"),
                None => thread::sleep(Duration::from_millis(300)),
            }
        }
    }

    /// A question that changes nothing, until it has an answer: a node answers nothing while its lease has ended by its own clock,
    /// as it does when the members of etcd elect a leader once more. How long that lasts is measured by commands.
    fn ask(&self, station: usize, vehicle: usize, words: &[&str]) -> Result<(bool, String)> {
        let end = Instant::now() + WITHIN;
        loop {
            let (done, printed) = self.cucs(station, vehicle, words)?;
            if !printed.contains(UNANSWERED) {
                return Ok((done, printed));
            }
            if Instant::now() > end {
                bail!("{words:?} of vehicle {}: {printed}", vehicle + 1);
            }
            thread::sleep(Duration::from_millis(200));
        }
    }

    fn cucs(&self, station: usize, vehicle: usize, words: &[&str]) -> Result<(bool, String)> {
        cucs(&self.computers, station, vehicle, words)
    }
}

/// A kind of work.
#[derive(Debug, Clone, Copy)]
pub(super) enum Draw {
    Altitude,
    Plan,
    Right,
}

/// Does a work: whether it was accepted, and what the station printed.
pub(super) fn do_work(computers: &Computers, vehicle: usize, work: Work) -> Result<(bool, String)> {
    match work {
        Work::Altitude(altitude) => {
            let altitude = format!("{altitude:.1}");
            let words = [
                "loiter",
                "--altitude",
                altitude.as_str(),
                "--altitude-type",
                "amsl",
            ];
            cucs(computers, 0, vehicle, &words)
        }
        Work::Plan(number) => {
            let path = computers.folder.join(format!("p{number}.route.toml"));
            fs::write(&path, plan(number))?;
            let path = path.to_str().context("a folder that is not UTF-8")?;
            let done = cucs(computers, 0, vehicle, &["send", path]);
            fs::remove_file(path)?;
            done
        }
        Work::Right(true) => cucs(computers, 1, vehicle, &["take", "--loi", "2"]),
        Work::Right(false) => cucs(computers, 1, vehicle, &["release"]),
    }
}

fn cucs(
    computers: &Computers,
    station: usize,
    vehicle: usize,
    words: &[&str],
) -> Result<(bool, String)> {
    let program = computers.program("cucs");
    let mut command = computers
        .network
        .command(Host::Station, program.as_os_str());
    let group = format!("{GROUP}:{GROUP_PORT}");
    command.args(["--json", "--multicast", &group]);
    command.args(["--interface", &Net::Dli.address(Host::Station)]);
    command.args(["--id", STATIONS[station], "--vehicle", &vehicle_id(vehicle)]);
    let log = computers.folder.join(format!("station{station}.log"));
    finish(command.args(words), &log, WITHIN)
}

/// A route of two waypoints that is flown for hours, with this number in its name and altitude.
fn plan(number: u32) -> String {
    let altitude = altitude(number);
    format!(
        "mission_id = \"P{number}\"\nid = \"p{number}\"\ntype = \"flight\"\ninitial = 10\n\
         [[waypoint]]\nnumber = 10\nlatitude = 47.3981\nlongitude = 8.5459\n{altitude}\naltitude_type = \"agl\"\nspeed = 5.0\n\
         [[waypoint]]\nnumber = 20\nlatitude = 47.3990\nlongitude = 8.5459\n{altitude}\naltitude_type = \"agl\"\nspeed = 5.0\n\
         next = 10\nloop = {{ limit = 500, type = \"count\" }}\n"
    )
}

fn altitude(number: u32) -> String {
    format!("altitude = {}", 30 + number % 40)
}

/// The altitudes of orders, in turn: home is at 488 m.
///
/// Orders that follow each other are metres apart: a vehicle whose set point is within a metre of a commanded altitude shows it,
/// and the command counts as carried out even where every frame of it was lost.
pub(super) fn nth_altitude(number: u16) -> f32 {
    520.0 + f32::from(number * 37 % ALTITUDES) / 5.0
}

/// After that many an altitude is commanded again.
pub(super) const ALTITUDES: u16 = 400;
const BOOT: Duration = Duration::from_secs(60);
/// In what `cucs` prints where nothing was received in time.
const UNANSWERED: &str = "no answer from a VSM";
/// Longer than `cucs` waits for anything.
const WITHIN: Duration = Duration::from_secs(75);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_altitudes_are_the_same_and_those_in_turn_are_far_apart() {
        let all: Vec<_> = (0..ALTITUDES).map(nth_altitude).collect();
        let mut sorted = all.clone();
        sorted.sort_by(f32::total_cmp);
        assert!(sorted.windows(2).all(|two| two[1] - two[0] > 0.1));
        for apart in 1..4 {
            let mut pairs = all.iter().zip(&all[apart..]);
            assert!(pairs.all(|(one, other)| (one - other).abs() > 5.0));
        }
    }
}
