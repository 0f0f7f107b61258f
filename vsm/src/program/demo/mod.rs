//! `vsm demo`: the bridge, one simulated PX4 or a fleet, and a CUCS on loopback sockets, from discovery to release.
//!
//! Each has a thread of its own and only sockets between them. The simulator runs faster than time; signing clocks,
//! time-outs and the CUCS stay in real time.

mod agent;
mod altitudes;
pub(crate) mod attack;
mod closing;
mod curve;
mod fleet;
mod labels;
mod payload;
mod picture;
mod stage;
mod story;
mod straight;
mod table;
mod track;
mod wings;
mod wire;
mod world;

use std::net::SocketAddr;
use std::path::PathBuf;
use std::pin::pin;

use anyhow::{Context as _, anyhow};
use cucs::{LoiterAt, Session, Station};
use stanag_msgs::Id;
use stanag_msgs::enums::{AltitudeType, FlightPathControlMode as Mode, LoiBitmap, RequestedAccess};

use self::closing::leave;
use self::curve::Section;
use self::picture::{CHAIN, Picture};
use self::stage::{NO_SIGNALS, PILOT, Stage, runtime};
use self::story::{
    CUCS, FLIGHT_WITHIN, Story, await_mode, await_position, await_waypoint, discover, discover_all,
    take_control,
};
use self::track::{Point, Track};
use self::wings::Scenario;
use self::world::{Remains, World};
use super::process::{Failure, failed, stop_signal};

/// Fly the bridge, a simulated PX4 and a CUCS on loopback, and leave a picture and a recording
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Write picture and recording to this folder
    #[arg(long, value_name = "DIR", default_value = "demo-out")]
    out: PathBuf,
    /// Serve the operator's page on this port of 127.0.0.1 until Ctrl-C, and leave the flying to you; with --curve, --wing, --vtol or --payload show that flight first
    #[arg(
        long,
        value_name = "PORT",
        num_args = 0..=1,
        default_missing_value = "8586",
        conflicts_with = "attack"
    )]
    web: Option<u16>,
    /// Run the simulator this many times faster than real time (default: 10; with --attack 5; with --payload or --web 3; with --fleet 1)
    #[arg(long)]
    speed: Option<f64>,
    /// Show attacks instead: false data pull a hovering vehicle down, without signing, guard and encryption and with them
    #[arg(long)]
    attack: bool,
    /// Fly a section of the Everland Speedway by nine curved legs instead of a route of straight ones
    #[arg(long, conflicts_with = "attack")]
    curve: bool,
    /// Fly a fixed wing instead: launch, a route with a loiter, the landing pattern
    #[arg(long, conflicts_with_all = ["attack", "curve"])]
    wing: bool,
    /// Fly a standard VTOL instead: launch, its transitions, a route, the landing pattern
    #[arg(long, conflicts_with_all = ["attack", "curve", "wing"])]
    vtol: bool,
    /// Have a second CUCS point, zoom and record with an EO/IR payload while the first one flies
    #[arg(long, conflicts_with_all = ["attack", "curve", "wing", "vtol"])]
    payload: bool,
    /// Fly N quadrotors together, 1 to 200, over one bridge and one MAVLink port, by one CUCS
    #[arg(
        long,
        value_name = "N",
        value_parser = clap::value_parser!(u8).range(1..=200),
        conflicts_with_all = ["attack", "curve", "wing", "vtol", "payload"]
    )]
    fleet: Option<u8>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments {
        out,
        web,
        speed,
        attack,
        curve,
        wing,
        vtol,
        payload,
        fleet,
    } = arguments;
    // A fleet shows what it costs, which is at the speed at which it is flown. A gimbal is steered in real time: at a higher
    // speed the vehicle has moved on before it is turned. Neither is a person who looks at the page any faster. Two flights
    // at a time need two more threads.
    let usual = match (*payload || web.is_some(), *attack) {
        _ if fleet.is_some() => 1.0,
        (true, _) => 3.0,
        (false, true) => 5.0,
        (false, false) => 10.0,
    };
    let speed = speed.unwrap_or(usual);
    if *attack {
        return attack::run(out, speed);
    }
    let stage = &Stage {
        out,
        speed,
        page: *web,
    };
    let flown = if *curve {
        fly_curves(stage)
    } else if *payload {
        fly_with_payload(stage)
    } else if *wing || *vtol {
        fly_on_wings(stage, Scenario::of(*vtol))
    } else if web.is_some() {
        hand_over(stage, fleet::vehicles(fleet.unwrap_or(1)))
    } else if let Some(count) = fleet {
        fleet::fly(stage, *count)
    } else {
        fly(stage)
    };
    flown.map_err(failed)
}

/// Nothing flies by itself: who opens the page does. The world is stopped also where this fails.
fn hand_over(stage: &Stage<'_>, vehicles: Vec<px4_sim::Config>) -> anyhow::Result<()> {
    let story = Story::begin(stage.speed);
    let count = vehicles.len();
    let world = stage.start_fleet(vehicles)?;
    let page = world.page.context("the bridge serves no page")?;
    let runtime = runtime()?;
    let ended = runtime.block_on(async {
        let mut stop = pin!(stop_signal().map_err(|_| anyhow!(NO_SIGNALS))?);
        // The link is shown once there is something to fly.
        let ready = async {
            let mut station = Station::bind(CUCS, "127.0.0.1:0".parse()?, world.vsm).await?;
            let found = discover_all(&mut station, count).await?;
            for vehicle in &found {
                station
                    .request(*vehicle, LoiBitmap::LOI2, RequestedAccess::Request)
                    .await?;
                await_position(&mut station, *vehicle).await?;
                station.release(*vehicle).await?;
            }
            anyhow::Ok(found)
        };
        tokio::select! {
            found = ready => story.tell(match &found?[..] {
                [vehicle] => format!("{vehicle} is on the ground and nobody's"),
                all => format!("{} vehicles are on the ground and nobody's", all.len()),
            }),
            () = &mut stop => return Ok(()),
        }
        story.tell(format!(
            "fly it with the mouse: {} (a key of this demo alone)",
            mouse_link(&world, page)
        ));
        story.tell("the page stays until Ctrl-C");
        stop.await;
        Ok(())
    });
    world.stop()?;
    ended
}

fn fly(stage: &Stage<'_>) -> anyhow::Result<()> {
    let mut story = Story::begin(stage.speed);
    let world = stage.start(px4_sim::Config::default())?;
    let flown = session(world, &mut story, async |_, station, story, vehicle| {
        flight(station, story, vehicle).await
    })?;
    let Some((station, remains)) = flown else {
        return Ok(());
    };
    let track = Track::flown(&remains.track);
    let planned = straight::planned(WAYPOINTS);
    let deviation_m = track.deviation_m(&planned.line);
    let picture = Picture {
        title: "vsm demo: planned and flown",
        planned: &planned,
        flown: &track,
        others: &[],
        note: &format!("{CHAIN}; largest deviation from the route {deviation_m:.1} m"),
        marks: &[],
        looks: &[],
    };
    let report = format!(
        "\nlargest deviation from the route {deviation_m:.1} m (corners are cut by PX4's acceptance radius)\n"
    );
    leave(stage.out, &picture, &station, &remains, &story, &report)
}

fn fly_curves(stage: &Stage<'_>) -> anyhow::Result<()> {
    let section = Section::new()?;
    let mut story = Story::begin(stage.speed);
    let vehicle = px4_sim::Config {
        home: section.home(),
        ..px4_sim::Config::default()
    };
    let world = stage.start(vehicle)?;
    let flown = session(world, &mut story, async |_, station, story, vehicle| {
        curve::flight(station, story, vehicle, &section).await
    })?;
    let Some((station, remains)) = flown else {
        return Ok(());
    };
    let track = Track::flown(&remains.track);
    let planned = section.planned();
    let compared = section.compare(&remains.track, &remains.status)?;
    let picture = Picture {
        title: "vsm demo --curve: Everland Speedway, nine curved legs",
        planned: &planned,
        flown: &track,
        others: &[],
        note: &format!(
            "{CHAIN}; largest deviation from the curves {:.1} m",
            compared.flown.deviation_m
        ),
        marks: &[],
        looks: &[],
    };
    let report = section.report(&compared)?;
    leave(stage.out, &picture, &station, &remains, &story, &report)
}

fn fly_on_wings(stage: &Stage<'_>, scenario: &Scenario) -> anyhow::Result<()> {
    let mut story = Story::begin(stage.speed);
    let world = stage.start(scenario.vehicle())?;
    let flown = session(world, &mut story, async |_, station, story, vehicle| {
        scenario.flight(station, story, vehicle).await
    })?;
    let Some((station, remains)) = flown else {
        return Ok(());
    };
    let (track, marks, off_m) = scenario.flown(&remains)?;
    let planned = scenario.planned();
    let picture = Picture {
        title: scenario.title,
        planned: &planned,
        flown: &track,
        others: &[],
        note: &format!("{CHAIN}; touched down {off_m:.1} m from its place"),
        marks: &marks,
        looks: &[],
    };
    let mut report = String::from("\nmarks of the flight, s since arming\n");
    let begun_s = track.points.first().map_or(0.0, |first| first.time_s);
    for mark in &marks {
        let Point { time_s, up_m, .. } = mark.point;
        report += &format!(
            "  {:6.1} s  {up_m:5.1} m  {}\n",
            time_s - begun_s,
            mark.text
        );
    }
    report += &format!("touched down {off_m:.1} m from its place\n");
    leave(stage.out, &picture, &station, &remains, &story, &report)
}

fn fly_with_payload(stage: &Stage<'_>) -> anyhow::Result<()> {
    let mut story = Story::begin(stage.speed);
    let vehicle = px4_sim::Config {
        payloads: 1,
        ..px4_sim::Config::default()
    };
    let world = stage.start(vehicle)?;
    let mut watched = payload::Watched::default();
    let flown = session(world, &mut story, async |world, station, story, vehicle| {
        watched = payload::flight(world, station, story, vehicle).await?;
        Ok(())
    })?;
    let Some((station, remains)) = flown else {
        return Ok(());
    };
    let track = Track::flown(&remains.track);
    let picture = Picture {
        title: "vsm demo --payload: one CUCS flies, another operates the EO/IR payload",
        planned: &straight::planned(payload::WAYPOINTS),
        flown: &track,
        others: &[],
        note: &format!("{CHAIN}; image centres as the vehicle reported them (21101)"),
        marks: &watched.marks,
        looks: &watched.near(),
    };
    let report = watched.report();
    leave(stage.out, &picture, &station, &remains, &story, &report)
}

/// From discovery to release, `fly` between take-over and landing; the world is stopped also where it fails. With a page it
/// stays after that, until it is stopped; `None` where it was stopped before all was flown.
fn session(
    world: World,
    story: &mut Story,
    fly: impl AsyncFnOnce(&World, &mut Station, &mut Story, Id) -> anyhow::Result<()>,
) -> anyhow::Result<Option<(Station, Remains)>> {
    let runtime = runtime()?;
    let page = world.page;
    let flown = runtime.block_on(async {
        let mut stop = pin!(stop_signal().map_err(|_| anyhow!(NO_SIGNALS))?);
        if let Some(page) = page {
            story.tell(format!(
                "the operator's page: http://{page}/ (the demo flies by itself first, then it is yours)"
            ));
            // After the #, so that it is not sent to the server; the page removes it from its address. A key that is kept
            // must not be in a link.
            let mouse = mouse_link(&world, page);
            story.tell(format!(
                "to fly it with the mouse, at once by taking it from the demo: {mouse} (a key of this demo alone)"
            ));
        }
        let mut station = Station::bind(CUCS, "127.0.0.1:0".parse()?, world.vsm).await?;
        let whole = async {
            let vehicle = take_over(&mut station, story).await?;
            fly(&world, &mut station, story, vehicle).await?;
            land(&mut station, story, vehicle).await
        };
        let flown = tokio::select! {
            flown = whole => flown,
            () = &mut stop => {
                anyhow::ensure!(page.is_some(), "interrupted");
                return Ok(None);
            }
        };
        match (flown, page) {
            (flown, None) => flown?,
            (Ok(()), Some(page)) => {
                story.tell(format!("all is flown; http://{page}/ stays until Ctrl-C"));
                // Only the last line is needed now.
                let mouse = mouse_link(&world, page);
                story.tell(format!("now fly it with the mouse: {mouse}"));
                stop.await;
            }
            // Somebody has taken control on the page: the vehicle is theirs.
            (Err(fault), Some(page)) => {
                story.tell(format!(
                    "the demo's own flight has ended ({fault:#}); http://{page}/ is there until Ctrl-C"
                ));
                stop.await;
                return Ok(None);
            }
        }
        Ok(Some(station))
    });
    // Also after a failed flight, so that the threads end and the recording is flushed.
    let remains = world.stop()?;
    Ok(flown?.map(|station| (station, remains)))
}

/// Where whoever opens it is the pilot of the demo.
fn mouse_link(world: &World, page: SocketAddr) -> String {
    format!("http://{page}/#{PILOT}={}", world.pilot_key)
}

/// Finds the vehicle and takes control of it.
async fn take_over(station: &mut Station, story: &mut Story) -> anyhow::Result<Id> {
    let vehicle = discover(station).await?;
    story.tell(format!("discovered {vehicle}"));
    take_control(station, vehicle).await?;
    story.tell("control granted: LOI 4 and 5");
    await_position(station, vehicle).await?;
    Ok(vehicle)
}

/// Lands and hands control back.
async fn land(station: &mut Station, story: &mut Story, vehicle: Id) -> anyhow::Result<()> {
    let flown = |session: &Session| {
        session
            .vehicle(vehicle)
            .is_some_and(|v| v.from_waypoint().is_some() && v.to_waypoint().is_none())
    };
    station
        .wait_until("the end of the route", FLIGHT_WITHIN, flown)
        .await?;
    story.tell("the route is flown");
    station.land(vehicle).await?.accepted()?;
    story.tell("lands");
    station
        .wait_until("the landing", FLIGHT_WITHIN, |session| {
            session
                .vehicle(vehicle)
                .is_some_and(|vehicle| vehicle.landed() == Some(true))
        })
        .await?;
    story.tell("landed");
    station.release(vehicle).await?;
    story.tell("control handed back");
    Ok(())
}

/// Everything that the CUCS does.
async fn flight(station: &mut Station, story: &mut Story, vehicle: Id) -> anyhow::Result<()> {
    let position = station
        .vehicle(vehicle)
        .and_then(|vehicle| vehicle.position());
    let ground_m = position.context("a vehicle without position")?.altitude_m;
    let route = straight::route(WAYPOINTS);
    let numbers: Vec<String> = route
        .waypoints
        .iter()
        .map(|waypoint| waypoint.number.to_string())
        .collect();
    station.send_route(vehicle, &route).await?.accepted()?;
    story.tell(format!(
        "route {} loaded, read back and compared",
        numbers.join(" -> ")
    ));

    station
        .launch(vehicle, LAUNCH_M, AltitudeType::Agl)
        .await?
        .accepted()?;
    story.tell(format!("launched to {LAUNCH_M:.0} m"));
    await_mode(
        station,
        vehicle,
        Mode::Loiter,
        "the vehicle to hold after its launch",
    )
    .await?;
    station.fly_route(vehicle, None, None).await?.accepted()?;
    story.tell("flies the route");
    await_waypoint(station, story, vehicle, 15).await?;
    station
        .change_speed(vehicle, SLOWER_M_S)
        .await?
        .accepted()?;
    story.tell(format!("slower: {SLOWER_M_S} m/s, in waypoint mode"));
    await_waypoint(station, story, vehicle, 40).await?;
    let higher = LoiterAt {
        altitude: Some((HIGHER_M, AltitudeType::Agl)),
        ..LoiterAt::default()
    };
    station.loiter(vehicle, higher).await?.accepted()?;
    story.tell(format!(
        "holds and climbs to {HIGHER_M:.0} m, in loiter mode"
    ));
    let above = |session: &Session| {
        let altitude_m = session
            .vehicle(vehicle)
            .and_then(|vehicle| vehicle.position())
            .map(|at| at.altitude_m);
        altitude_m.is_some_and(|m| m > ground_m + HIGHER_M - 1.5)
    };
    station
        .wait_until("the commanded altitude", FLIGHT_WITHIN, above)
        .await?;
    station
        .fly_route(vehicle, Some(40), None)
        .await?
        .accepted()?;
    story.tell("flies on to waypoint 40");
    await_waypoint(station, story, vehicle, 5).await
}

const WAYPOINTS: &[straight::Row] = &[
    (10, 60.0, 0.0, 30.0, 8.0, 7),
    (7, 120.0, 80.0, 35.0, 8.0, 15),
    (15, 60.0, 160.0, 40.0, 8.0, 40),
    (40, -40.0, 120.0, 40.0, 8.0, 5),
    (5, 0.0, 20.0, 30.0, 8.0, 0),
];

const LAUNCH_M: f64 = 30.0;
const HIGHER_M: f64 = 45.0;
const SLOWER_M_S: f64 = 5.0;
