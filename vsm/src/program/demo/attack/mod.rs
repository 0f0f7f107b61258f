//! `vsm demo --attack`: the experiment of the HMAC framework for drones (Sensors 2021) on the DLI. A vehicle hovers at 2 m;
//! from 30 s of its flight on an attacker sends false data for 30 s. Each attack is flown twice, side by side: without and
//! with the protection against it. At the end somebody listens on the radio, without and with encryption.
//!
//! - [`attacker`]: what the attacks send;
//! - [`web`]: the CUCS as a web client, and who comes in its name;
//! - [`radio`]: what the listener reads.
//!
//! Flights without protection happen only here: a simulated vehicle on loopback, in a world that the demo itself creates.

mod attacker;
mod radio;
mod web;

use std::cell::Cell;
use std::fmt::Write as _;
use std::future::pending;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use cucs::{LoiterAt, Station};
use stanag_msgs::Id;
use stanag_msgs::enums::{AltitudeType, FlightPathControlMode as Mode};

use self::radio::Overheard;
use self::web::WebClient;
use super::altitudes::{Altitudes, Curve, Panel};
use super::picture::{FLOWN, PLANNED};
use super::story::{
    CUCS, FLIGHT_WITHIN, Story, await_mode, await_position, discover, take_control,
};
use super::track::Track;
use super::wire::Wire;
use super::world::{Radio, Remains, Setup, Stations, World};
use crate::program::process::{Failure, failed};

/// Flies all of it and leaves the picture in `out`.
pub(crate) fn run(out: &Path, speed: f64) -> Result<(), Failure> {
    show(out, speed).map_err(failed)
}

/// What is done to the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Attack {
    /// Position commands on the vehicle's MAVLink link.
    Link,
    /// Landings in the name of its CUCS from another computer, which answers what it is asked there.
    Elsewhere,
    /// The same from the very address and port of the CUCS: somebody on the way, or a forged sender.
    SameAddress,
    /// From both, the landing that the CUCS itself has sent at the end of an earlier flight.
    Replay,
    /// Landings in the name of a web client: by its WebSocket without its key, and by datagrams. Without a key there is no web client:
    /// the CUCS is a native one there.
    Web,
    /// Nothing is sent: somebody listens on the radio to the agent.
    Listening,
}

impl Attack {
    const ALL: [Attack; 6] = [
        Attack::Link,
        Attack::Elsewhere,
        Attack::SameAddress,
        Attack::Replay,
        Attack::Web,
        Attack::Listening,
    ];

    fn title(self) -> &'static str {
        match self {
            Attack::Link => "position commands on the MAVLink link",
            Attack::Elsewhere => "landings (2016) in the CUCS's name, from another address",
            Attack::SameAddress => "landings (2016) in the CUCS's name, from its own address",
            Attack::Replay => {
                "a recorded landing (2016) of the CUCS, from its own address and another"
            }
            Attack::Web => {
                "landings (2016) in a web client's name, by its WebSocket and from another address"
            }
            Attack::Listening => {
                "the radio between bridge and agent: altitudes that somebody reads on it"
            }
        }
    }

    fn protection(self) -> &'static str {
        match self {
            Attack::Link => "signing",
            Attack::Elsewhere | Attack::SameAddress | Attack::Replay | Attack::Web => "guard",
            Attack::Listening => "encryption",
        }
    }

    /// The world that it is done to.
    fn setup(self, speed: f64, protected: bool) -> Setup<'static> {
        let usual = Setup {
            speed,
            ..Setup::default()
        };
        match (self, protected) {
            (Attack::Link, signed) => Setup { signed, ..usual },
            (Attack::Listening, encrypt) => Setup {
                radio: Radio::Agent { encrypt },
                ..usual
            },
            (Attack::Web, true) => Setup {
                stations: Stations::Web,
                more: PAGE,
                ..usual
            },
            (_, false) => Setup {
                stations: Stations::Anywhere,
                ..usual
            },
            (_, true) => Setup {
                stations: Stations::Guard,
                ..usual
            },
        }
    }
}

/// One flight, and what became of the attack.
struct Flown {
    /// Seconds of flight and metres above home; on the radio those that were read.
    points: Vec<(f64, f64)>,
    text: String,
}

fn show(out: &Path, speed: f64) -> anyhow::Result<()> {
    std::fs::create_dir_all(out)
        .with_context(|| format!("the folder {} cannot be made", out.display()))?;
    let story = Story::new(speed);
    story.tell(format!(
        "a simulated PX4 hovers at {HOVER_M:.0} m, {speed} times faster than time; all of it on loopback"
    ));
    story.tell(
        "each attack is flown twice, side by side; WITHOUT protection in this simulated world only",
    );
    let mut panels = Vec::new();
    let mut text = String::from("\n");
    for attack in Attack::ALL {
        story.tell(attack.title());
        let pair = [false, true].map(|protected| (attack, protected));
        let flown = thread::scope(|scope| {
            let begin =
                |(attack, protected)| scope.spawn(move || fly(out, speed, attack, protected));
            pair.map(begin).map(|flight| {
                flight
                    .join()
                    .map_err(|_| anyhow!("a flight has panicked"))?
            })
        });
        let [without, with] = flown;
        let (without, with) = (without?, with?);
        let _ = writeln!(text, "{}", attack.title());
        let mut curves = Vec::new();
        for (word, colour, flown) in [("without", FLOWN, without), ("with", PLANNED, with)] {
            let line = format!("{word} {}: {}", attack.protection(), flown.text);
            let _ = writeln!(text, "  {line}");
            curves.push(Curve {
                text: line,
                colour,
                points: flown.points,
            });
        }
        panels.push(Panel {
            title: attack.title().to_owned(),
            attack_s: (attack != Attack::Listening).then_some(ATTACK_AFTER.as_secs_f64()),
            curves,
        });
    }
    let picture = Altitudes {
        title: "vsm demo --attack: false data at a hovering vehicle",
        panels,
    };
    let svg = out.join("attack.svg");
    std::fs::write(&svg, picture.svg())
        .with_context(|| format!("{} cannot be written", svg.display()))?;
    let out = std::path::absolute(out).unwrap_or_else(|_| PathBuf::from(out));
    let _ = write!(text, "\nattack.svg shows it\n{}\n", out.display());
    io::stdout()
        .write_all(text.as_bytes())
        .context("standard output")
}

fn fly(out: &Path, speed: f64, attack: Attack, protected: bool) -> anyhow::Result<Flown> {
    let word = if protected { "with" } else { "without" };
    let folder = out.join(format!("{attack:?}-{word}").to_lowercase());
    let world = World::start(&folder, &attack.setup(speed, protected))?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    let shot = runtime.block_on(async {
        let wire = Wire::to(world.vsm).await?;
        let (mut guard, mut web, mut address) = (None, None, wire.near);
        match (attack.setup(speed, protected).stations, world.page) {
            (Stations::Guard, _) => {
                let beside = world.guard(wire.near).await?;
                address = beside.address()?;
                guard = Some(beside);
            }
            (Stations::Web, Some(page)) => {
                let client = WebClient::open(page, CUCS, &world.guard_key())?;
                address = client.near;
                web = Some(client);
            }
            _ => {}
        }
        let station = Station::bind(CUCS, "127.0.0.1:0".parse()?, address).await?;
        let serve = async {
            match guard {
                Some(guard) => guard.serve(pending()).await,
                None => pending().await,
            }
        };
        let shot = tokio::select! {
            shot = hover_and_attack(&world, &wire, attack, station) => shot,
            () = serve => Err(anyhow!("the guard has ended")),
            _ = tokio::signal::ctrl_c() => Err(anyhow!("interrupted")),
        };
        let ended = web.map_or(Ok(()), WebClient::end);
        shot.and_then(|shot| ended.map(|()| shot))
    });
    // Also after a failed flight everything is stopped.
    let remains = world.stop()?;
    let shot =
        shot.with_context(|| format!("{}, {word} {}", attack.title(), attack.protection()))?;
    Ok(judge(attack, &remains, &shot))
}

/// What one attack has sent.
struct Shots {
    sent: u64,
    /// When it was over, in the vehicle's time.
    ended: Duration,
    /// Whether the CUCS could land the vehicle afterwards.
    served: bool,
}

async fn hover_and_attack(
    world: &World,
    wire: &Wire,
    attack: Attack,
    mut station: Station,
) -> anyhow::Result<Shots> {
    let vehicle = prepare(&mut station).await?;
    let mut recording = Vec::new();
    if attack == Attack::Replay {
        hover(world, &mut station, vehicle).await?;
        let before = wire.to_server().len();
        land(world, &mut station, vehicle).await?;
        recording = wire.to_server().split_off(before);
    }
    hover(world, &mut station, vehicle).await?;
    let begins = world.armed_at().context("the vehicle is not armed")? + ATTACK_AFTER;
    while world.truth().time < begins {
        station.idle(LOOK).await?;
    }
    let sent = Cell::new(0);
    let ends = begins + ATTACK_FOR;
    let until_end = async {
        while world.truth().time < ends {
            tokio::time::sleep(LOOK).await;
        }
    };
    let shoot = async {
        match attack {
            Attack::Link => attacker::strike(world.px4()?, &sent).await,
            Attack::Elsewhere => attacker::impersonate(world.vsm, CUCS, vehicle, &sent).await,
            Attack::SameAddress => attacker::forge(wire, CUCS, vehicle, &sent).await,
            Attack::Replay => attacker::replay(wire, world.vsm, &recording, &sent).await,
            Attack::Web => {
                let elsewhere = attacker::impersonate(world.vsm, CUCS, vehicle, &sent);
                let in_browser = async {
                    match world.page {
                        Some(page) => web::guess(page, CUCS, &sent).await,
                        None => pending().await,
                    }
                };
                tokio::try_join!(elsewhere, in_browser).map(|_| ())
            }
            Attack::Listening => pending().await,
        }
    };
    let honest = async {
        loop {
            // A forged sender can redirect the answers: receiving nothing is no reason to end.
            let _ = station.idle(FLIGHT_WITHIN).await;
        }
    };
    tokio::select! {
        () = until_end => {}
        shot = shoot => shot?,
        () = honest => {}
    }
    let ended = world.truth().time;
    let served = !world.truth().landed && land(world, &mut station, vehicle).await.is_ok();
    Ok(Shots {
        sent: sent.get(),
        ended,
        served,
    })
}

/// Discovers, takes control, and waits for a position.
async fn prepare(station: &mut Station) -> anyhow::Result<Id> {
    let vehicle = discover(station).await?;
    take_control(station, vehicle).await?;
    await_position(station, vehicle).await?;
    Ok(vehicle)
}

/// Launches, and holds at the altitude of the experiment.
async fn hover(world: &World, station: &mut Station, vehicle: Id) -> anyhow::Result<()> {
    // It is refused until the vehicle knows its home, and if a slow machine has let the vehicle disarm before its climb.
    let patience = Instant::now() + LAUNCHED_WITHIN;
    loop {
        // The flight begins with its arming.
        world.forget_track();
        let launched = station.launch(vehicle, HOVER_M, AltitudeType::Agl).await;
        match launched.map(|outcome| outcome.accepted()) {
            Ok(Ok(_)) => break,
            Ok(Err(refused)) if Instant::now() > patience => return Err(refused.into()),
            Err(fault) if Instant::now() > patience => return Err(fault.into()),
            Ok(Err(_)) | Err(_) => station.idle(LAUNCH_AGAIN).await?,
        }
    }
    let what = "the vehicle to hold after its launch";
    await_mode(station, vehicle, Mode::Loiter, what).await?;
    // A launch ends within the acceptance radius of its altitude, and the vehicle holds there.
    let at = LoiterAt {
        altitude: Some((HOVER_M, AltitudeType::Agl)),
        ..LoiterAt::default()
    };
    station.loiter(vehicle, at).await?.accepted()?;
    Ok(())
}

/// Lands, until the motors are off.
async fn land(world: &World, station: &mut Station, vehicle: Id) -> anyhow::Result<()> {
    station.land(vehicle).await?.accepted()?;
    let patience = Instant::now() + FLIGHT_WITHIN;
    while world.truth().armed {
        anyhow::ensure!(Instant::now() < patience, "the vehicle does not disarm");
        station.idle(LOOK).await?;
    }
    Ok(())
}

fn judge(attack: Attack, remains: &Remains, shots: &Shots) -> Flown {
    let ended = shots.ended.as_secs_f64();
    let track = Track::since_arming(&remains.track).points;
    let begun = track.first().map_or(0.0, |point| point.time_s);
    let flown = |from: f64| {
        let within = move |time_s: f64| time_s >= begun + from && time_s <= ended;
        track.iter().filter(move |point| within(point.time_s))
    };
    if attack == Attack::Listening {
        let overheard = Overheard::of(&remains.radio);
        let positions = overheard.positions.iter();
        let points = positions.map(|(time_s, up_m)| (time_s - begun, *up_m));
        return Flown {
            text: format!(
                "{} datagrams, {} positions read; in the clear: {}",
                remains.radio.len(),
                overheard.positions.len(),
                overheard.text()
            ),
            points: points
                .filter(|point| point.0 > 0.0 && point.0 < ended - begun)
                .collect(),
        };
    }
    let lowest_m = flown(ATTACK_AFTER.as_secs_f64())
        .map(|point| point.up_m.max(0.0))
        .fold(f64::INFINITY, f64::min)
        // Avoids "-0.0".
        .abs();
    let end = match (lowest_m < ON_THE_GROUND_M, shots.served) {
        (true, _) => "brought to the ground",
        (false, true) => "landed by its own CUCS afterwards",
        (false, false) => "and its own CUCS could not land it",
    };
    Flown {
        text: format!(
            "lowest {lowest_m:.1} m, {end}; {} sent, refused: {}",
            shots.sent,
            refusals(attack, remains)
        ),
        points: flown(0.0)
            .map(|point| (point.time_s - begun, point.up_m))
            .collect(),
    }
}

/// What the vehicle, or the bridge, has refused, by its name.
fn refusals(attack: Attack, remains: &Remains) -> String {
    let mut named: Vec<(&str, u64)> = Vec::new();
    if attack == Attack::Link {
        let link = remains.counters.links.first().copied().unwrap_or_default();
        named.push(("unsigned", link.dropped_unsigned));
        named.push(("wrong signature", link.dropped_bad_signature));
    } else {
        named.extend(remains.status.refused.iter());
    }
    named.retain(|(_, count)| *count > 0);
    // The most frequent refusal is the one that stopped the attack.
    named.sort_by_key(|(_, count)| u64::MAX - *count);
    let named = named.iter().take(NAMED);
    let named: Vec<String> = named
        .map(|(name, count)| format!("{name} {count}"))
        .collect();
    match named.is_empty() {
        true => "nothing".to_owned(),
        false => named.join(", "),
    }
}

/// Where a web client connects.
const PAGE: &str = "[http]\nlisten = \"127.0.0.1:0\"\n[web]\ncontrol = true\n";
/// As the paper's.
const HOVER_M: f64 = 2.0;
/// Reasons that are named.
const NAMED: usize = 2;
const ON_THE_GROUND_M: f64 = 0.3;
/// Of flight, from arming.
const ATTACK_AFTER: Duration = Duration::from_secs(30);
const ATTACK_FOR: Duration = Duration::from_secs(30);
const LAUNCHED_WITHIN: Duration = Duration::from_secs(90);
const LAUNCH_AGAIN: Duration = Duration::from_millis(200);
const LOOK: Duration = Duration::from_millis(5);
