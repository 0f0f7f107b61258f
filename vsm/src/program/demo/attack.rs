//! `vsm demo --attack`: a vehicle hovers; at 30 s of its flight somebody injects position commands on its link and mode
//! commands (2016) in the name of its CUCS. Flown twice: as the bridge is, and without signing and without addresses.
//!
//! Without protection is only ever flown here: a simulated vehicle on loopback, in a world that the demo itself makes.

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use anyhow::Context as _;
use cucs::Station;
use stanag_msgs::Id;
use stanag_msgs::enums::{AltitudeType, FlightPathControlMode as Mode};

use super::altitudes::{Altitudes, Panel};
use super::attacker::{LinkAttacker, Shots, forge};
use super::story::{
    CUCS, FLIGHT_WITHIN, READY_WITHIN, Story, await_mode, await_position, discover, take_control,
};
use super::track::Track;
use super::world::{Protection, Remains, World};
use crate::program::process::{Failure, failed};

/// Flies both and leaves the picture in `out`.
pub(crate) fn run(out: &Path, speed: f64) -> Result<(), Failure> {
    show(out, speed).map_err(failed)
}

/// One flight, and what became of the attack.
struct Flown {
    track: Track,
    shots: Shots,
    /// Refused or taken, by whom and how many: a line each.
    counts: [String; 2],
    /// The lowest altitude above home after the attack began, m.
    lowest_m: f64,
}

fn show(out: &Path, speed: f64) -> anyhow::Result<()> {
    std::fs::create_dir_all(out)
        .with_context(|| format!("the folder {} cannot be made", out.display()))?;
    let mut story = Story {
        started: Instant::now(),
        speed,
    };
    story.tell(format!(
        "a simulated PX4 hovers at {HOVER_M:.0} m, {speed} times faster than time; all of it on loopback"
    ));
    story.tell("first as the bridge is: signed, the CUCS taken from its address alone");
    let on = fly(&out.join("protected"), speed, Protection::On, &mut story)?;
    story.tell("then WITHOUT protection, in this simulated world only: signing off, any address");
    let off = fly(&out.join("unprotected"), speed, Protection::Off, &mut story)?;
    let picture = Altitudes {
        title: "vsm demo --attack: false commands at a hovering vehicle",
        attack_s: ATTACK_AFTER.as_secs_f64(),
        panels: [
            Panel {
                title: "with protection: signed MAVLink, the CUCS from its address alone",
                note: &on.counts,
                track: &on.track,
            },
            Panel {
                title: "without protection: signing off, any address",
                note: &off.counts,
                track: &off.track,
            },
        ],
    };
    let svg = out.join("attack.svg");
    std::fs::write(&svg, picture.svg())
        .with_context(|| format!("{} cannot be written", svg.display()))?;
    let mut text = String::from("\n");
    for (name, flown) in [("with protection", &on), ("without protection", &off)] {
        text += &format!(
            "{name}: {} MAVLink frames and {} mode commands (2016) injected\n  {}\n  lowest after that {:.1} m\n",
            flown.shots.frames,
            flown.shots.commands,
            flown.counts.join("\n  "),
            flown.lowest_m
        );
    }
    text += "A CUCS's address is no proof on a network whose senders can be forged.\n";
    text += &format!(
        "\nattack.svg shows it\n{}\n",
        std::path::absolute(out)
            .unwrap_or_else(|_| PathBuf::from(out))
            .display()
    );
    io::stdout()
        .write_all(text.as_bytes())
        .context("standard output")
}

fn fly(out: &Path, speed: f64, protection: Protection, story: &mut Story) -> anyhow::Result<Flown> {
    let world = World::start(out, speed, px4_sim::Config::default(), protection)?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let shot = runtime.block_on(async {
        tokio::select! {
            shot = hover_and_attack(&world, story) => shot,
            _ = tokio::signal::ctrl_c() => Err(anyhow::anyhow!("interrupted")),
        }
    });
    // What runs is stopped also where the flight failed.
    let remains = world.stop()?;
    let shots = shot?;
    let track = Track::since_arming(&remains.track);
    let begun = track.points.first().map_or(0.0, |point| point.time_s) + ATTACK_AFTER.as_secs_f64();
    let lowest_m = track
        .points
        .iter()
        .filter(|point| point.time_s > begun)
        .map(|point| point.up_m)
        .fold(f64::INFINITY, f64::min);
    Ok(Flown {
        counts: counts(&remains),
        track,
        shots,
        lowest_m,
    })
}

async fn hover_and_attack(world: &World, story: &mut Story) -> anyhow::Result<Shots> {
    let mut station = Station::bind(CUCS, "127.0.0.1:0".parse()?, world.vsm).await?;
    let vehicle = take_off(&mut station, story).await?;
    let begins = world.armed_at().context("the vehicle is not armed")? + ATTACK_AFTER;
    while world.truth().time < begins {
        station.idle(LOOK).await?;
    }
    story.tell("somebody on the link begins to inject");
    let mut link = LinkAttacker::at(world.px4()?).await?;
    let mut commands = 0;
    let ends = begins + ATTACK_FOR;
    let until_end = async {
        while world.truth().time < ends {
            let wall = SystemTime::now()
                .duration_since(UNIX_EPOCH)
                .unwrap_or_default();
            link.shoot(wall).await?;
            tokio::time::sleep(LOOK).await;
        }
        anyhow::Ok(())
    };
    let honest = async {
        loop {
            // A forged sender draws its answers away: then it receives nothing, which is no end.
            let _ = station.idle(FLIGHT_WITHIN).await;
        }
    };
    tokio::select! {
        ended = until_end => ended?,
        forged = forge(world.vsm, CUCS, vehicle, &mut commands) => forged?,
        () = honest => {}
    }
    let up_m = -world.truth().position.d;
    story.tell(format!("after the attack the vehicle is at {up_m:.1} m"));
    Ok(Shots {
        frames: link.frames,
        commands,
    })
}

/// Discovers, takes control, launches; the vehicle holds then.
async fn take_off(station: &mut Station, story: &mut Story) -> anyhow::Result<Id> {
    let vehicle = discover(station).await?;
    take_control(station, vehicle).await?;
    await_position(station, vehicle).await?;
    // Refused until the vehicle knows where its home is.
    let patience = Instant::now() + READY_WITHIN;
    loop {
        let launched = station.launch(vehicle, HOVER_M, AltitudeType::Agl).await?;
        match launched.accepted() {
            Ok(_) => break,
            Err(refused) if Instant::now() > patience => return Err(refused.into()),
            Err(_) => station.idle(LAUNCH_AGAIN).await?,
        }
    }
    let what = "the vehicle to hold after its launch";
    await_mode(station, vehicle, Mode::Loiter, what).await?;
    story.tell(format!("launched, and hovers at {HOVER_M:.0} m"));
    Ok(vehicle)
}

/// What the vehicle and the VSM made of it.
fn counts(remains: &Remains) -> [String; 2] {
    let link = remains.counters.links.first().copied().unwrap_or_default();
    let refused = link.dropped_unsigned + link.dropped_bad_signature;
    let taken = link.from_strangers.saturating_sub(refused);
    let address = remains.status.refused.get("unauthorised address");
    [
        format!(
            "PX4 refused {} unsigned frames and {} with a wrong signature, and took {taken} of the attacker's",
            link.dropped_unsigned, link.dropped_bad_signature
        ),
        format!("the VSM refused {address} DLI datagrams from another address"),
    ]
}

const HOVER_M: f64 = 10.0;
/// Of flight, from arming.
const ATTACK_AFTER: Duration = Duration::from_secs(30);
const ATTACK_FOR: Duration = Duration::from_secs(30);
const LAUNCH_AGAIN: Duration = Duration::from_millis(200);
const LOOK: Duration = Duration::from_millis(5);
