//! The common part of every flight of the demo: it is narrated as it happens, and begins with a CUCS that finds its
//! vehicle.

use std::cell::Cell;
use std::io::{self, IsTerminal as _, Write};
use std::time::{Duration, Instant};

use anyhow::{Context as _, bail};
use cucs::{Session, Station, Vehicle};
use stanag_msgs::Id;
use stanag_msgs::enums::{FlightPathControlMode as Mode, LoiBitmap, RequestedAccess};

/// Tells what happens as it happens.
pub(super) struct Story {
    pub(super) started: Instant,
    pub(super) speed: f64,
    /// A line of progress stands on the terminal, without its end.
    unfinished: Cell<bool>,
}

impl Story {
    pub(super) fn new(speed: f64) -> Story {
        Story {
            started: Instant::now(),
            speed,
            unfinished: Cell::new(false),
        }
    }

    /// A story whose first line states what is simulated.
    pub(super) fn begin(speed: f64) -> Story {
        let story = Story::new(speed);
        story.tell(format!(
            "simulated PX4, at {speed} times real time; signing clocks stay real"
        ));
        story
    }

    pub(super) fn tell(&self, what: impl std::fmt::Display) {
        let over = self.unfinished.take();
        self.write(over, &format!("{what}\n"));
    }

    /// One line that is written over until the next whole line; nothing where no person watches.
    pub(super) fn progress(&self, what: impl std::fmt::Display) {
        if io::stdout().is_terminal() {
            let over = self.unfinished.replace(true);
            self.write(over, &what.to_string());
        }
    }

    /// `over`: in place of the line that stands there.
    fn write(&self, over: bool, what: &str) {
        let clear = if over { "\r\x1b[K" } else { "" };
        let line = format!(
            "{clear}[{:5.1} s] {what}",
            self.started.elapsed().as_secs_f64()
        );
        let mut out = io::stdout();
        // A closed standard output must not stop a flight half-way.
        let _ = out.write_all(line.as_bytes()).and_then(|()| out.flush());
    }
}

/// The one vehicle of the demo.
pub(super) async fn discover(station: &mut Station) -> anyhow::Result<Id> {
    let found = discover_all(station, 1).await?;
    found.first().copied().context("no vehicle was discovered")
}

/// So many vehicles, by rising id.
pub(super) async fn discover_all(station: &mut Station, count: usize) -> anyhow::Result<Vec<Id>> {
    station.set_heartbeats(true);
    let mut found = Vec::new();
    // The answers come in one burst, of which a busy machine may lose some.
    for _ in 0..DISCOVERIES {
        found = station.discover().await?;
        if found.len() >= count {
            break;
        }
    }
    if found.len() < count {
        bail!("{} vehicles were discovered, expected {count}", found.len())
    }
    Ok(found.iter().map(|found| found.vehicle).collect())
}

/// LOI 4 and 5 of it.
pub(super) async fn take_control(station: &mut Station, vehicle: Id) -> anyhow::Result<()> {
    let wanted = LoiBitmap::LOI4.union(LoiBitmap::LOI5);
    station
        .request(vehicle, wanted, RequestedAccess::Request)
        .await?;
    Ok(())
}

pub(super) async fn await_position(station: &mut Station, vehicle: Id) -> anyhow::Result<()> {
    let known = |session: &Session| {
        session
            .vehicle(vehicle)
            .is_some_and(|vehicle| vehicle.position().is_some())
    };
    Ok(station
        .wait_until("position of the vehicle", READY_WITHIN, known)
        .await?)
}

pub(super) async fn await_mode(
    station: &mut Station,
    vehicle: Id,
    mode: Mode,
    what: &str,
) -> anyhow::Result<()> {
    await_state(station, vehicle, what, |state| state.mode() == Some(mode)).await
}

/// What the vehicle reports, while this station controls it.
async fn await_state(
    station: &mut Station,
    vehicle: Id,
    what: &str,
    reached: impl Fn(&Vehicle) -> bool,
) -> anyhow::Result<()> {
    let controls = |state: &Vehicle| state.granted().contains(LoiBitmap::LOI4);
    let ended = |session: &Session| {
        session
            .vehicle(vehicle)
            .is_some_and(|state| reached(state) || !controls(state))
    };
    station.wait_until(what, FLIGHT_WITHIN, ended).await?;
    let kept = station.vehicle(vehicle).is_some_and(controls);
    anyhow::ensure!(kept, "another ground station has taken control");
    Ok(())
}

pub(super) async fn await_waypoint(
    station: &mut Station,
    story: &Story,
    vehicle: Id,
    number: u16,
) -> anyhow::Result<()> {
    let what = format!("leg to waypoint {number}");
    let reached = |state: &Vehicle| state.to_waypoint() == Some(number);
    await_state(station, vehicle, &what, reached).await?;
    let from = station
        .vehicle(vehicle)
        .and_then(|v| v.from_waypoint())
        .unwrap_or(0);
    story.tell(format!("waypoint {from} passed, to {number}"));
    Ok(())
}

/// The demo's CUCS.
pub(super) const CUCS: Id = Id(0x1b00_00a0);
const DISCOVERIES: usize = 5;
const READY_WITHIN: Duration = Duration::from_secs(15);
pub(super) const FLIGHT_WITHIN: Duration = Duration::from_secs(60);
