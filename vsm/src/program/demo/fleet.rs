//! `vsm demo --fleet N`: quadrotors on one MAVLink port, each with a key of its own, flown together by one CUCS over one bridge.
//!
//! Whatever the CUCS commands it commands to all before it waits for the first answer. The vehicles stand in a grid and fly
//! one route, each from its own place, so that they keep their distances.

use std::collections::BTreeMap;
use std::pin::pin;
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow, bail};
use cucs::{Delivery, Event, Route, Station, StationError, Ticket, Vehicle};
use cucs::{launch_command, mode_command};
use px4_sim::{Geodetic, Truth};
use rustix::time::ClockId;
use stanag_msgs::enums::{AltitudeType, FlightPathControlMode as Mode};
use stanag_msgs::messages::Heartbeat;
use stanag_msgs::{Id, Message};

use super::super::process::stop_signal;
use super::closing::{conclude, draw};
use super::picture::{CHAIN, Picture};
use super::stage::{NO_SIGNALS, Stage, runtime};
use super::story::{CUCS, Story, discover_all, take_control};
use super::straight::{self, Row};
use super::track::{Point, Track};
use super::world::{Remains, Spent, cpu_time, north_east_deg, north_east_m};

/// The vehicles of a fleet, in rows from where one vehicle alone would stand.
pub(super) fn vehicles(count: u8) -> Vec<px4_sim::Config> {
    let vehicle = |system_id: u8| {
        let (north_m, east_m) = place(count, usize::from(system_id) - 1);
        let (latitude_deg, longitude_deg) = north_east_deg(north_m, east_m);
        let usual = px4_sim::Config::default();
        px4_sim::Config {
            system_id,
            seed: u64::from(system_id),
            home: Geodetic {
                latitude_deg,
                longitude_deg,
                ..usual.home
            },
            ..usual
        }
    };
    (1..=count).map(vehicle).collect()
}

pub(super) fn fly(stage: &Stage<'_>, count: u8) -> anyhow::Result<()> {
    let story = Story::begin(stage.speed);
    let begun = (Instant::now(), cpu_time(ClockId::ProcessCPUTime));
    let world = stage.start_fleet(vehicles(count))?;
    let flown = runtime()?.block_on(async {
        let mut stop = pin!(stop_signal().map_err(|_| anyhow!(NO_SIGNALS))?);
        let station = Station::bind(CUCS, "127.0.0.1:0".parse()?, world.vsm).await?;
        let pilot = Pilot {
            station,
            story: &story,
            count,
            vehicles: Vec::new(),
            answers: Vec::new(),
        };
        tokio::select! {
            flown = pilot.fly() => flown,
            () = &mut stop => bail!("interrupted"),
        }
    });
    // Also after a failed flight, so that the threads end.
    let remains = world.stop()?;
    let process = Spent::since(begun, ClockId::ProcessCPUTime);
    let flown = flown?;
    let truths = std::iter::once(&remains.track).chain(remains.others.iter().map(|one| &one.1));
    let tracks: Vec<Track> = truths.map(|truths| track(truths)).collect();
    let (first, others) = tracks.split_first().context("no vehicle has flown")?;
    let title = format!("vsm demo --fleet {count}: the tracks of all vehicles");
    let picture = Picture {
        title: &title,
        planned: &straight::planned(&rows(count, 0)),
        flown: first,
        others,
        note: &format!("{CHAIN}, {count} times; the route is that of the first"),
        marks: &[],
        looks: &[],
    };
    draw(stage.out, &picture)?;
    let table = closing_table(count, &flown, &tracks, &remains, &process);
    conclude(stage.out, &format!("{table}\nflight.svg shows it"))
}

/// The CUCS, which flies all of them.
struct Pilot<'a> {
    station: Station,
    story: &'a Story,
    count: u8,
    /// By rising id: in the order of the grid.
    vehicles: Vec<Id>,
    /// From each command to its first acknowledgement.
    answers: Vec<Duration>,
}

/// What the CUCS has to report.
struct Flown {
    /// From the first launch to the last landing.
    flight: Duration,
    answers: Vec<Duration>,
    /// Messages of the DLI that have reached it, used or not, without heartbeats.
    received: u64,
}

impl Pilot<'_> {
    async fn fly(mut self) -> anyhow::Result<Flown> {
        let count = usize::from(self.count);
        self.vehicles = discover_all(&mut self.station, count).await?;
        self.story.tell(format!("discovered {count} vehicles"));
        for (nth, vehicle) in self.vehicles.clone().into_iter().enumerate() {
            take_control(&mut self.station, vehicle).await?;
            self.show("control granted", nth + 1);
        }
        self.story.tell("control granted: LOI 4 and 5 of each");
        let known = |vehicle: &Vehicle| vehicle.position().is_some();
        self.await_all("position", known).await?;

        let routes: Vec<Route> = (0..count)
            .map(|nth| straight::route(&rows(self.count, nth)))
            .collect();
        let cucs = self.station.session().id();
        self.command("route stored", false, |nth, vehicle| {
            Ok(routes[nth].messages(vehicle, cucs)?)
        })
        .await?;
        self.command("route loaded", true, |nth, _| {
            Ok(vec![routes[nth].load_command()?.into()])
        })
        .await?;
        self.story.tell(format!(
            "a route of {} waypoints loaded in each, read back and compared",
            WAYPOINTS.len()
        ));

        let begun = Instant::now();
        self.command("launched", true, |_, _| {
            Ok(vec![launch_command(LAUNCH_M, AltitudeType::Agl)?.into()])
        })
        .await?;
        let holds = |vehicle: &Vehicle| vehicle.mode() == Some(Mode::Loiter);
        self.await_all("hold after the launch", holds).await?;
        self.story
            .tell(format!("all launched to {LAUNCH_M:.0} m, and hold"));
        self.command("flies the route", true, |_, _| {
            Ok(vec![mode_command(Mode::Waypoint).into()])
        })
        .await?;
        self.story.tell("all fly the route");
        let flown = |vehicle: &Vehicle| {
            vehicle.from_waypoint().is_some() && vehicle.to_waypoint().is_none()
        };
        self.await_all("route flown", flown).await?;
        self.story.tell("the routes are flown");
        self.command("lands", true, |_, _| {
            Ok(vec![mode_command(Mode::AutolandEngage).into()])
        })
        .await?;
        self.await_all("landed", |vehicle| vehicle.landed() == Some(true))
            .await?;
        let flight = begun.elapsed();
        self.story.tell("all landed");
        for vehicle in self.vehicles.clone() {
            self.station.release(vehicle).await?;
        }
        // What was on its way to it then must not count as lost.
        self.station.idle(LAST_REPORTS).await?;
        self.story.tell("control handed back");
        let traffic = self.station.session().traffic();
        let used = traffic.received.total() - traffic.received.of(Heartbeat::ID);
        // The repeated acknowledgements among them are counted as received, too.
        let dropped = traffic.dropped.iter();
        let dropped = dropped.filter(|(reason, _)| **reason != "unmatched acknowledgement");
        Ok(Flown {
            flight,
            answers: self.answers,
            received: used + dropped.map(|(_, count)| count).sum::<u64>(),
        })
    }

    /// Commands all vehicles, and waits until each has carried it out.
    async fn command(
        &mut self,
        what: &str,
        timed: bool,
        messages: impl Fn(usize, Id) -> anyhow::Result<Vec<Message>>,
    ) -> anyhow::Result<()> {
        // What was reported until now is no answer, and would be read first.
        while self.station.next_event(Duration::ZERO).await.is_ok() {}
        let mut open = BTreeMap::<Ticket, Open>::new();
        for (nth, vehicle) in self.vehicles.iter().enumerate() {
            let tickets = self.station.post(*vehicle, messages(nth, *vehicle)?)?;
            let given = Instant::now();
            open.extend(tickets.into_iter().map(|ticket| {
                let one = Open {
                    vehicle: *vehicle,
                    given,
                    answered: false,
                };
                (ticket, one)
            }));
        }
        let (all, until) = (open.len(), Instant::now() + CARRIED_OUT_WITHIN);
        while !open.is_empty() {
            let left = until.saturating_duration_since(Instant::now());
            let (ticket, delivery) = match self.station.next_event(left).await {
                Ok(Event::Answered { ticket, delivery }) => (ticket, delivery),
                Ok(_) => continue,
                Err(StationError::TimedOut { .. }) => {
                    let late = open.values().map(|open| open.vehicle);
                    bail!("{what}: no outcome {}", within(late, CARRIED_OUT_WITHIN))
                }
                Err(fault) => return Err(fault.into()),
            };
            let Some(one) = open.get_mut(&ticket) else {
                continue;
            };
            if timed && !std::mem::replace(&mut one.answered, true) {
                self.answers.push(one.given.elapsed());
            }
            match delivery {
                Delivery::Refused => {
                    let vehicle = one.vehicle;
                    // The reason comes in a message of its own.
                    self.station.idle(REASON_WITHIN).await?;
                    let state = self.station.vehicle(vehicle);
                    let alert = state.and_then(|state| state.alerts().next_back());
                    let reason = alert.map_or("no reason given", |alert| alert.text.as_str());
                    bail!("{what}: vehicle {vehicle} refuses it: {reason}")
                }
                Delivery::CarriedOut => {
                    open.remove(&ticket);
                    self.show(what, all - open.len());
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Waits until all vehicles report something.
    async fn await_all(
        &mut self,
        what: &str,
        reached: impl Fn(&Vehicle) -> bool,
    ) -> anyhow::Result<()> {
        let until = Instant::now() + FLOWN_WITHIN;
        loop {
            let missing: Vec<Id> = (self.vehicles.iter().copied())
                .filter(|id| !self.station.vehicle(*id).is_some_and(&reached))
                .collect();
            self.show(what, self.vehicles.len() - missing.len());
            if missing.is_empty() {
                return Ok(());
            }
            if Instant::now() >= until {
                bail!("{what}: not {}", within(missing, FLOWN_WITHIN))
            }
            self.station.idle(LOOK).await?;
        }
    }

    /// The line of progress.
    fn show(&self, what: &str, done: usize) {
        let at = |vehicle: &Id| {
            let state = self.station.vehicle(*vehicle)?;
            let passed = state.from_waypoint()?;
            Some(usize::from(passed))
        };
        let passed: usize = self.vehicles.iter().filter_map(at).sum();
        self.story.progress(format!(
            "{what}: {done}; waypoints passed {passed} of {}",
            self.vehicles.len() * WAYPOINTS.len()
        ));
    }
}

/// A message that is not carried out yet.
struct Open {
    vehicle: Id,
    given: Instant,
    answered: bool,
}

/// Which of them are late, by name where there are few.
fn within(late: impl IntoIterator<Item = Id>, span: Duration) -> String {
    let mut late: Vec<Id> = late.into_iter().collect();
    late.dedup();
    let named: Vec<String> = late.iter().take(3).map(Id::to_string).collect();
    let more = match late.len().saturating_sub(named.len()) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    format!(
        "from {}{more} within {} s",
        named.join(", "),
        span.as_secs()
    )
}

fn closing_table(
    count: u8,
    flown: &Flown,
    tracks: &[Track],
    remains: &Remains,
    process: &Spent,
) -> String {
    let counters =
        std::iter::once(&remains.counters).chain(remains.others.iter().map(|one| &one.0));
    let sent: u64 = counters
        .flat_map(|one| &one.links)
        .map(|link| link.sent)
        .sum();
    let arrived = remains.status.vehicles.iter();
    let arrived: u64 = arrived
        .filter_map(|vehicle| vehicle.link.frames.get("datagrams"))
        .sum();
    let reports = &remains.status.sent;
    let reports: u64 = reports
        .iter()
        .filter(|(kind, _)| *kind != u32::from(Heartbeat::ID))
        .map(|(_, count)| count)
        .sum();
    let reached: usize = tracks
        .iter()
        .enumerate()
        .map(|(nth, track)| waypoints_reached(&rows(count, nth), track))
        .sum();
    let truths = std::iter::once(&remains.track).chain(remains.others.iter().map(|one| &one.1));
    let landed = truths.filter(|truths| has_flown(truths)).count();
    let mut answers = flown.answers.clone();
    answers.sort_unstable();
    let rows = [
        ("vehicles flown", format!("{landed} of {count}")),
        (
            "waypoints reached",
            format!(
                "{reached} of {}, by the vehicles' true tracks",
                usize::from(count) * WAYPOINTS.len()
            ),
        ),
        (
            "time",
            format!(
                "{:.1} s from the launch to the last landing",
                flown.flight.as_secs_f64()
            ),
        ),
        (
            "CPU share",
            format!(
                "bridge {:.1} % of a core, all of it with the simulated vehicles {:.1} %",
                remains.bridge.percent(),
                process.percent()
            ),
        ),
        (
            "datagrams lost",
            format!(
                "{} of {sent} from the vehicles",
                sent.saturating_sub(arrived)
            ),
        ),
        (
            "messages lost",
            format!(
                "{} of {reports} to the CUCS",
                reports.saturating_sub(flown.received)
            ),
        ),
        (
            "first answer to a command",
            format!(
                "p50 {:.1} ms, p99 {:.1} ms, of {}",
                percentile_ms(&answers, 50),
                percentile_ms(&answers, 99),
                answers.len()
            ),
        ),
    ];
    let lines = rows.map(|(name, value)| format!("  {name:<28}{value}\n"));
    format!("\nThe fleet\n{}", lines.concat())
}

/// The smallest of sorted values that so many per cent of them do not exceed, ms.
fn percentile_ms(sorted: &[Duration], percent: usize) -> f64 {
    let rank = (sorted.len() * percent).div_ceil(100).max(1);
    let value = sorted.get(rank - 1).copied().unwrap_or_default();
    value.as_secs_f64() * 1e3
}

/// Has left the ground, and is back on it.
fn has_flown(truths: &[Truth]) -> bool {
    truths.iter().any(|truth| !truth.landed) && truths.last().is_some_and(|last| last.landed)
}

/// How many waypoints of the route the track has passed.
fn waypoints_reached(rows: &[Row], track: &Track) -> usize {
    let planned = straight::planned(rows);
    let reached = planned.waypoints.iter().filter(|(_, waypoint)| {
        let nearest = track.nearest(waypoint);
        nearest.is_some_and(|at| {
            let off_m = (at.north_m - waypoint.north_m).hypot(at.east_m - waypoint.east_m);
            off_m <= REACHED_M
        })
    });
    reached.count()
}

/// The track of a vehicle in the frame of the first one's home; a sample each half second, enough to draw.
fn track(truths: &[Truth]) -> Track {
    let armed = truths.iter().filter(|truth| truth.armed);
    let points = armed.step_by(SAMPLES).map(|truth| {
        let (north_m, east_m) = north_east_m(truth.place.latitude_deg, truth.place.longitude_deg);
        Point {
            north_m,
            east_m,
            ..Point::of(truth)
        }
    });
    Track {
        points: points.collect(),
    }
}

/// Where in the grid a vehicle stands, m north and east.
fn place(count: u8, nth: usize) -> (f64, f64) {
    let columns = (1..=usize::from(count))
        .find(|columns| columns * columns >= usize::from(count))
        .unwrap_or(1);
    let (row, column) = (nth / columns, nth % columns);
    (row as f64 * -SPACING_M, column as f64 * SPACING_M)
}

/// The route of a vehicle: the same for all, from where it stands.
fn rows(count: u8, nth: usize) -> Vec<Row> {
    let (north_m, east_m) = place(count, nth);
    let row = |(number, north, east, up_m, speed_m_s, next): &Row| {
        let (north, east) = (north + north_m, east + east_m);
        (*number, north, east, *up_m, *speed_m_s, *next)
    };
    WAYPOINTS.iter().map(row).collect()
}

const WAYPOINTS: &[Row] = &[
    (1, 60.0, 0.0, UP_M, SPEED_M_S, 2),
    (2, 60.0, 60.0, UP_M, SPEED_M_S, 3),
    (3, 0.0, 60.0, UP_M, SPEED_M_S, 4),
    (4, 0.0, 15.0, UP_M, SPEED_M_S, 0),
];
const UP_M: f64 = 15.0;
const LAUNCH_M: f64 = 10.0;
const SPEED_M_S: f64 = 8.0;
/// Between neighbours, more than PX4 cuts a corner by.
const SPACING_M: f64 = 12.0;
/// NAV_ACC_RAD, at which PX4 turns to the next waypoint, and half of what is flown between two samples.
const REACHED_M: f64 = 12.5;
/// Of each five samples, a tenth of a second apart, one is kept.
const SAMPLES: usize = 5;
const LOOK: Duration = Duration::from_millis(200);
const REASON_WITHIN: Duration = Duration::from_millis(400);
const LAST_REPORTS: Duration = Duration::from_millis(500);
const CARRIED_OUT_WITHIN: Duration = Duration::from_secs(90);
/// All of a route, in real time on a busy machine.
const FLOWN_WITHIN: Duration = Duration::from_secs(240);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_vehicles_of_the_largest_fleet_stand_at_one_place_or_have_one_system_id() {
        let fleet = vehicles(200);
        let mut ids: Vec<u8> = fleet.iter().map(|vehicle| vehicle.system_id).collect();
        ids.dedup();
        assert_eq!(ids, (1..=200).collect::<Vec<u8>>());
        for (nth, one) in fleet.iter().enumerate() {
            let (north_m, east_m) = north_east_m(one.home.latitude_deg, one.home.longitude_deg);
            for other in &fleet[..nth] {
                let at = north_east_m(other.home.latitude_deg, other.home.longitude_deg);
                let apart_m = (north_m - at.0).hypot(east_m - at.1);
                assert!(apart_m > SPACING_M - 0.1, "{apart_m} m");
            }
        }
    }

    #[test]
    fn percentiles_are_of_the_values_themselves() {
        let values: Vec<Duration> = (1..=100).map(Duration::from_millis).collect();
        assert_eq!(percentile_ms(&values, 50), 50.0);
        assert_eq!(percentile_ms(&values, 99), 99.0);
        assert_eq!(percentile_ms(&values[..1], 99), 1.0);
        assert_eq!(percentile_ms(&[], 99), 0.0);
    }
}
