//! The command line of `px4-sim`: a simulated PX4 on UDP, for users without a PX4.

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{CommandFactory as _, Parser, ValueEnum};
use tokio::signal::unix::{SignalKind, signal};

use crate::{
    Airframe, Config, Files, Geodetic, LinkAddress, Simulator, SimulatorConfig, SimulatorError,
    read_key_file,
};

/// Simulate a PX4 v1.18 vehicle on UDP: missions, signing and the real one's pitfalls.
///
/// Example: px4-sim --link udpout:127.0.0.1:14550 --speed 10
///
/// SIGUSR1 makes it report a battery at 10 %, SIGUSR2 the simulated charge again.
#[derive(Debug, Parser)]
#[command(name = "px4-sim", version)]
struct Arguments {
    /// Link: udpin:HOST:PORT waits for a peer, udpout:HOST:PORT sends first. Repeat it for several links.
    #[arg(long, required = true, value_name = "LINK")]
    link: Vec<LinkAddress>,
    /// Signing key file (32 bytes in hex, mode 0600): sign from the first packet, accept nothing unsigned.
    #[arg(long, value_name = "FILE")]
    key_file: Option<PathBuf>,
    /// PX4's own key file (40 bytes): read at the start, written when a key is set. Without it a key is lost when the
    /// process ends.
    #[arg(long, value_name = "FILE", conflicts_with = "key_file")]
    signing_file: Option<PathBuf>,
    /// MAVLink system id, 1 to 255.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=255))]
    system_id: u8,
    /// Home position: degrees north, degrees east, metres AMSL.
    #[arg(
        long,
        value_name = "LAT,LON,ALT",
        default_value = "47.3977434,8.5455939,488",
        value_parser = home,
        allow_hyphen_values = true
    )]
    home: Geodetic,
    /// Airframe to simulate.
    #[arg(long, value_enum, default_value_t = Frame::Quad)]
    airframe: Frame,
    /// Speed of simulated time, 0.01 to 100 times real time. Signing timestamps count packets and are not affected.
    #[arg(long, default_value_t = 1.0, allow_negative_numbers = true)]
    speed: f64,
    /// Seed of all noise: the same seed gives the same flight.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Signing timestamp of the first packet, in units of 10 us since 2015.
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u64).range(0..1 << 48))]
    initial_timestamp: u64,
    /// Implement operator control (REQUEST_OPERATOR_CONTROL, CONTROL_STATUS), which PX4 v1.18 does not.
    #[arg(long)]
    operator_control: bool,
    /// Send EVENT beside STATUSTEXT, and serve the metadata of events and parameters, as PX4 does.
    #[arg(long)]
    events: bool,
    /// Fly on a combustion engine that reports itself by EFI_STATUS.
    #[arg(long)]
    combustion: bool,
    /// Payload stations, 0 to 2: each a gimbal and a camera, as MAVLink components beside the autopilot.
    #[arg(long, default_value_t = 0, value_name = "COUNT", value_parser = clap::value_parser!(u8).range(0..=2))]
    payloads: u8,
    /// Steady wind, m/s toward north and east.
    #[arg(long, value_name = "NORTH,EAST", default_value = "0,0", value_parser = wind, allow_hyphen_values = true)]
    wind: (f64, f64),
    /// Folder whose contents are the root of the vehicle's files, served by MAVLink FTP to everybody on the link: its
    /// fs/microsd/log has the logs. It is read at the start, and never written to.
    #[arg(long, value_name = "DIR")]
    files: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Frame {
    Quad,
    Plane,
    Vtol,
}

/// The command line, for completions and the manual page.
#[must_use]
pub fn command() -> clap::Command {
    Arguments::command()
}

/// The program: runs until SIGTERM or SIGINT, and returns the exit status.
#[must_use]
pub fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let key = match arguments.key_file.as_deref().map(read_key_file).transpose() {
        Ok(key) => key,
        Err(error) => return fail(2, &error),
    };
    let mut files = Files::default();
    let served = match arguments.files.as_deref().map(|folder| files.load(folder)) {
        None => String::new(),
        Some(Ok(loaded)) => format!(", serves {loaded}"),
        Some(Err(error)) => return fail(2, &format!("--files: {error}")),
    };
    let config = SimulatorConfig {
        vehicle: Config {
            files,
            system_id: arguments.system_id,
            home: arguments.home,
            airframe: match arguments.airframe {
                Frame::Quad => Airframe::Quad,
                Frame::Plane => Airframe::Plane,
                Frame::Vtol => Airframe::Vtol,
            },
            seed: arguments.seed,
            wind_ne_ms: [arguments.wind.0, arguments.wind.1],
            unix_time_us: unix_time_us(),
            operator_control: arguments.operator_control,
            events: arguments.events,
            combustion: arguments.combustion,
            payloads: arguments.payloads,
            ..Config::default()
        },
        links: arguments.link,
        key,
        initial_timestamp: arguments.initial_timestamp,
        signing_file: arguments.signing_file,
        speed: arguments.speed,
    };
    let runtime = match tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
    {
        Ok(runtime) => runtime,
        Err(error) => return fail(1, &error),
    };
    runtime.block_on(serve(config, &served))
}

/// Runs the simulator. `served` ends the line that says what it is.
async fn serve(config: SimulatorConfig, served: &str) -> ExitCode {
    let signals = || -> std::io::Result<_> {
        let kinds = [
            SignalKind::terminate(),
            SignalKind::interrupt(),
            SignalKind::user_defined1(),
            SignalKind::user_defined2(),
        ];
        let [terminate, interrupt, empty, charged] = kinds.map(signal);
        Ok((terminate?, interrupt?, empty?, charged?))
    };
    let (mut terminate, mut interrupt, mut empty, mut charged) = match signals() {
        Ok(signals) => signals,
        Err(error) => return fail(1, &error),
    };
    let about = format!(
        "px4-sim ready: system {}, {}, {}, {}x{served}",
        config.vehicle.system_id,
        config
            .links
            .iter()
            .map(ToString::to_string)
            .collect::<Vec<_>>()
            .join(", "),
        match (&config.key, &config.signing_file) {
            (Some(_), _) => "signed",
            (None, Some(_)) => "signed if its key file holds a key",
            (None, None) => "unsigned",
        },
        config.speed
    );
    let simulator = match Simulator::spawn(config).await {
        Ok(simulator) => simulator,
        Err(
            error @ (SimulatorError::Speed(_)
            | SimulatorError::NoLink
            | SimulatorError::SigningFile { .. }),
        ) => return fail(2, &error),
        Err(error) => return fail(1, &error),
    };
    report(&about);
    loop {
        tokio::select! {
            _ = terminate.recv() => break,
            _ = interrupt.recv() => break,
            _ = empty.recv() => simulator.empty_battery(true),
            _ = charged.recv() => simulator.empty_battery(false),
        }
    }
    simulator.stop().await;
    ExitCode::SUCCESS
}

fn fail(status: u8, error: &dyn std::fmt::Display) -> ExitCode {
    report(&format!("px4-sim: {error}"));
    ExitCode::from(status)
}

fn report(line: &str) {
    // A closed standard error does not stop the simulator: the error is ignored.
    let _ = writeln!(std::io::stderr(), "{line}");
}

fn unix_time_us() -> u64 {
    let now = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .unwrap_or_default();
    u64::try_from(now.as_micros()).unwrap_or(0)
}

fn home(text: &str) -> Result<Geodetic, String> {
    let parts = numbers::<3>(text)?;
    let [latitude_deg, longitude_deg, altitude_m] = parts;
    let valid =
        latitude_deg.abs() <= 90.0 && longitude_deg.abs() <= 180.0 && altitude_m.abs() < 10_000.0;
    if valid {
        Ok(Geodetic::new(latitude_deg, longitude_deg, altitude_m))
    } else {
        Err("expected -90 to 90, -180 to 180, and metres above mean sea level".into())
    }
}

fn wind(text: &str) -> Result<(f64, f64), String> {
    let [north, east] = numbers::<2>(text)?;
    if north.hypot(east) <= 30.0 {
        Ok((north, east))
    } else {
        Err("expected at most 30 m/s".into())
    }
}

fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let found: Result<Vec<f64>, _> = text
        .split(',')
        .map(|part| part.trim().parse::<f64>())
        .collect();
    found
        .ok()
        .filter(|all| all.iter().all(|v| v.is_finite()))
        .and_then(|all| <[f64; N]>::try_from(all).ok())
        .ok_or_else(|| format!("expected {N} numbers with commas between them"))
}
