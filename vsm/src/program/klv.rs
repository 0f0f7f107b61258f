//! `vsm klv`: a ground station with LOI 2 that sends what it learns about a vehicle as metadata, alone or together with a
//! video.
//!
//! Three parts run in parallel: the station, in a task of its own, since its waits must not delay the video; a thread that
//! reads the video; and here the output, in the order in which both arrive.

use std::fs::File;
use std::io::{self, Read, Write};
use std::net::{SocketAddr, ToSocketAddrs as _, UdpSocket};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use anyhow::{Context as _, anyhow};
use clap::Args;
use cucs::{Event, SessionConfig, Station, StationError};
use stanag_msgs::enums::{LoiBitmap, RequestedAccess};
use stanag_msgs::klv::LocalSet;
use stanag_msgs::messages::{
    EoIrLaserOperatingState, InertialStates, ScheduleMessageUpdateCommand, VehicleId,
};
use stanag_msgs::{Id, Message};
use tokio::sync::mpsc::{Receiver, Sender, channel};

use super::process::{Failure, announce, bad, failed, runtime, stop_signal};
use crate::klv::h264::{AccessUnit, AccessUnits};
use crate::klv::transport::Multiplexer;
use crate::klv::view::View;

/// What is sent, of whom, and where to.
#[derive(Debug, Args)]
pub(crate) struct Klv {
    /// Send to this address by UDP: a set a datagram, or with --video seven transport packets; for example 239.45.86.2:5004
    #[arg(long, value_name = "HOST:PORT", required_unless_present = "out")]
    udp: Option<String>,
    /// Write to this file, - for standard output
    #[arg(long, value_name = "FILE", conflicts_with = "udp")]
    out: Option<PathBuf>,
    /// Video to send with the metadata in an MPEG transport stream: a bare H.264 stream, - for standard input
    #[arg(long, value_name = "FILE")]
    video: Option<PathBuf>,
    /// Pictures a second of the video, which is then paced by it; needed for a file (default: as they arrive)
    #[arg(long, value_name = "RATE", value_parser = frame_rate)]
    fps: Option<f64>,
    /// Address on which the VSM listens
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:4586")]
    vsm: String,
    /// Id of this ground station; the VSM's configuration must list it, with LOI 2
    #[arg(long, value_name = "ID", default_value = "1b:00:00:c0")]
    id: Id,
    /// Id of the vehicle (default: the only one discovered)
    #[arg(long, value_name = "ID")]
    vehicle: Option<Id>,
    /// Payload station whose sensor is described, 1 to 16
    #[arg(long, default_value_t = 1, value_name = "NUMBER", value_parser = clap::value_parser!(u8).range(1..=16))]
    station: u8,
    /// Sets a second, 1 to 50 Hz
    #[arg(long, default_value_t = 10, value_name = "HZ", value_parser = clap::value_parser!(u16).range(1..=50))]
    rate: u16,
    /// Model of the aircraft (item 10), at most 127 bytes
    #[arg(long, value_name = "TEXT", value_parser = short_text)]
    platform: Option<String>,
    /// End after this time, s (default: at SIGTERM, SIGINT or the end of the video)
    #[arg(long, value_name = "SECONDS")]
    seconds: Option<u64>,
}

pub(crate) fn run(arguments: Klv) -> Result<(), Failure> {
    let is_pipe = |path: &PathBuf| path == Path::new("-");
    if arguments
        .video
        .as_ref()
        .is_some_and(|video| !is_pipe(video))
        && arguments.fps.is_none()
    {
        return Err(bad(anyhow!(
            "--video FILE needs --fps RATE: a file of H.264 has no times"
        )));
    }
    if arguments.fps.is_some() && arguments.video.is_none() {
        return Err(bad(anyhow!("--fps is of a video: name one with --video")));
    }
    let mut output = Output::open(&arguments)?;
    let video = arguments.video.as_deref().map(open_video).transpose()?;
    let runtime = runtime()?;
    let counts = runtime.block_on(serve(&arguments, &mut output, video));
    // A thread that waits for its video never ends, so the runtime does not wait for it.
    runtime.shutdown_background();
    let (sets, pictures) = counts?;
    let pictures = pictures.map_or(String::new(), |count| format!(", {count} pictures"));
    announce("INFO", &format!("{sets} sets of metadata sent{pictures}"));
    Ok(())
}

/// Sends until the end; how many sets, and how many pictures of a video.
async fn serve(
    arguments: &Klv,
    output: &mut Output,
    video: Option<Box<dyn Read + Send>>,
) -> Result<(u64, Option<u64>), Failure> {
    let stop = stop_signal()?;
    tokio::pin!(stop);
    let end = arguments.seconds.map(Duration::from_secs);
    let end = async {
        match end {
            Some(span) => tokio::time::sleep(span).await,
            None => std::future::pending().await,
        }
    };
    tokio::pin!(end);
    let mut watch = tokio::select! {
        watch = Watch::begin(arguments) => watch?,
        () = &mut stop => return Ok((0, None)),
    };
    announce(
        "INFO",
        &format!(
            "ready: metadata of vehicle {} to {}",
            watch.vehicle, output.name
        ),
    );
    let mut pictures = video.map(|source| read_video(source, arguments.fps));
    let mut transport = pictures.as_ref().map(|_| Multiplexer::default());
    let (sender, mut sets) = channel(QUEUE);
    let mut station = tokio::spawn(async move { watch.run(&sender).await });
    let mut sent = (0, pictures.as_ref().map(|_| 0));
    loop {
        tokio::select! {
            () = &mut stop => break,
            () = &mut end => break,
            ended = &mut station => return Err(ended.map_err(failed)?.err().unwrap_or_else(|| failed(anyhow!("the station ended")))),
            Some(set) = sets.recv() => {
                let bytes = LocalSet::encode(&set).map_err(failed)?;
                match &mut transport {
                    None => output.send(&bytes)?,
                    Some(transport) => output.send(&transport.metadata(&bytes, set.time_us).map_err(failed)?)?,
                }
                sent.0 += 1;
            }
            unit = next(&mut pictures) => match (unit, &mut transport, &mut sent.1) {
                (Some(unit), Some(transport), Some(count)) => {
                    output.send(&transport.video(&unit.map_err(failed)?).map_err(failed)?)?;
                    *count += 1;
                }
                _ => break,
            },
        }
    }
    station.abort();
    output.flush()?;
    Ok(sent)
}

async fn next(
    pictures: &mut Option<Receiver<anyhow::Result<AccessUnit>>>,
) -> Option<anyhow::Result<AccessUnit>> {
    match pictures {
        Some(pictures) => pictures.recv().await,
        None => std::future::pending().await,
    }
}

/// The ground station.
struct Watch {
    station: Station,
    vehicle: Id,
    view: View,
    rate: u16,
}

impl Watch {
    async fn begin(arguments: &Klv) -> Result<Watch, Failure> {
        let config = SessionConfig::new(arguments.id);
        let mut station = Station::reach(config, None, &arguments.vsm)
            .await
            .map_err(bad)?;
        let vehicle = match arguments.vehicle {
            Some(vehicle) => vehicle,
            None => {
                let found = station.discover().await.with_context(|| {
                    format!("a VSM answers only stations that its configuration lists: [[cucs]] with id = \"{}\" and loi = [2]", arguments.id)
                });
                let found = found.map_err(failed)?;
                match found.as_slice() {
                    [only] => only.vehicle,
                    several => {
                        let ids: Vec<String> =
                            several.iter().map(|one| one.vehicle.to_string()).collect();
                        return Err(bad(anyhow!(
                            "vehicles {}: name one with --vehicle",
                            ids.join(", ")
                        )));
                    }
                }
            }
        };
        let view = View::new(arguments.station, arguments.platform.clone());
        let mut watch = Watch {
            station,
            vehicle,
            view,
            rate: arguments.rate,
        };
        watch.subscribe().await.map_err(failed)?;
        Ok(watch)
    }

    /// LOI 2, and the reports that are needed.
    async fn subscribe(&mut self) -> Result<(), StationError> {
        let (station, vehicle) = (&mut self.station, self.vehicle);
        station
            .request(vehicle, LoiBitmap::LOI2, RequestedAccess::Request)
            .await?;
        for (message, hertz) in [
            (VehicleId::ID, 1),
            (InertialStates::ID, self.rate),
            (EoIrLaserOperatingState::ID, self.rate),
        ] {
            let schedule = ScheduleMessageUpdateCommand {
                requested_message_type: Some(message),
                frequency: Some(hertz),
                ..ScheduleMessageUpdateCommand::default()
            };
            // Refused if the VSM has no such report, for example of payloads: then its values are absent.
            station.send(vehicle, schedule, ANSWER).await?;
        }
        Ok(())
    }

    /// Passes sets on for ever. A VSM that restarts or a link that is lost leaves a gap.
    async fn run(&mut self, sets: &Sender<LocalSet>) -> Result<(), Failure> {
        let mut heard = Instant::now();
        loop {
            match self.station.next_event(SILENCE).await {
                Ok(Event::Message { from, message }) if from == self.vehicle => {
                    if matches!(*message, Message::InertialStates(_)) {
                        heard = Instant::now();
                    }
                    if let Some(set) = self.view.take(&message, unix_us())
                        && sets.send(set).await.is_err()
                    {
                        return Ok(());
                    }
                }
                Ok(_) | Err(StationError::TimedOut { .. }) => {}
                Err(fault) => return Err(failed(fault)),
            }
            // A VSM that has restarted may have lost the schedule of this station.
            if heard.elapsed() >= SILENCE {
                heard = Instant::now();
                match self.subscribe().await {
                    // No longer granted: it may be granted again after a reload of the configuration.
                    Ok(())
                    | Err(
                        StationError::TimedOut { .. }
                        | StationError::NotGranted { .. }
                        | StationError::NoVsm { .. },
                    ) => {}
                    Err(fault) => return Err(failed(fault)),
                }
            }
        }
    }
}

/// Where the bytes go.
struct Output {
    name: String,
    to: Destination,
}

enum Destination {
    Udp(UdpSocket),
    Writer(Box<dyn Write>),
}

impl Output {
    fn open(arguments: &Klv) -> Result<Output, Failure> {
        let Some(address) = &arguments.udp else {
            let path = arguments.out.as_deref().unwrap_or(Path::new("-"));
            let name = path.display().to_string();
            let writer: Box<dyn Write> = if name == "-" {
                Box::new(io::stdout())
            } else {
                Box::new(
                    File::create(path)
                        .with_context(|| name.clone())
                        .map_err(bad)?,
                )
            };
            return Ok(Output {
                name,
                to: Destination::Writer(writer),
            });
        };
        let expected = || format!("--udp {address}: expected HOST:PORT");
        let to = address
            .to_socket_addrs()
            .with_context(expected)
            .map_err(bad)?
            .next();
        let to = to.with_context(expected).map_err(bad)?;
        let any: SocketAddr = if to.is_ipv4() {
            ([0; 4], 0).into()
        } else {
            ([0; 16], 0).into()
        };
        let socket = UdpSocket::bind(any).and_then(|socket| socket.connect(to).map(|()| socket));
        let socket = socket
            .with_context(|| format!("--udp {address}"))
            .map_err(failed)?;
        Ok(Output {
            name: format!("udp {to}"),
            to: Destination::Udp(socket),
        })
    }

    fn send(&mut self, bytes: &[u8]) -> Result<(), Failure> {
        let sent = match &mut self.to {
            Destination::Writer(writer) => writer.write_all(bytes),
            Destination::Udp(socket) => {
                bytes
                    .chunks(DATAGRAM)
                    .try_for_each(|datagram| match socket.send(datagram) {
                        // Nobody listens at present; somebody may later.
                        Err(fault) if fault.kind() == io::ErrorKind::ConnectionRefused => Ok(()),
                        other => other.map(|_| ()),
                    })
            }
        };
        sent.with_context(|| self.name.clone()).map_err(failed)
    }

    fn flush(&mut self) -> Result<(), Failure> {
        match &mut self.to {
            Destination::Writer(writer) => writer
                .flush()
                .with_context(|| self.name.clone())
                .map_err(failed),
            Destination::Udp(_) => Ok(()),
        }
    }
}

fn open_video(path: &Path) -> Result<Box<dyn Read + Send>, Failure> {
    if path == Path::new("-") {
        return Ok(Box::new(io::stdin()));
    }
    let file = File::open(path)
        .with_context(|| path.display().to_string())
        .map_err(bad)?;
    Ok(Box::new(file))
}

/// Reads the video in a thread of its own: a blocking read cannot be cancelled. With a frame rate each picture is due at its time.
fn read_video(
    mut source: Box<dyn Read + Send>,
    fps: Option<f64>,
) -> Receiver<anyhow::Result<AccessUnit>> {
    let (sender, receiver) = channel(QUEUE);
    std::thread::spawn(move || {
        let (mut units, mut buffer) = (AccessUnits::default(), vec![0; 1 << 16]);
        let (began, began_us, mut count) = (Instant::now(), unix_us(), 0_u32);
        loop {
            let read = source.read(&mut buffer);
            let found = match read {
                Ok(0) => units.finish(),
                Ok(length) => units.push(buffer.get(..length).unwrap_or_default(), unix_us()),
                Err(fault) => {
                    let _ = sender.blocking_send(Err(anyhow!(fault).context("the video")));
                    return;
                }
            };
            let found = match found {
                Ok(found) => found,
                Err(fault) => {
                    let _ = sender.blocking_send(Err(fault.into()));
                    return;
                }
            };
            for mut unit in found {
                if let Some(fps) = fps {
                    let due = Duration::from_secs_f64(f64::from(count) / fps);
                    std::thread::sleep(due.saturating_sub(began.elapsed()));
                    unit.at_us = began_us + u64::try_from(due.as_micros()).unwrap_or(0);
                    count += 1;
                }
                if sender.blocking_send(Ok(unit)).is_err() {
                    return;
                }
            }
            if matches!(read, Ok(0)) {
                return;
            }
        }
    });
    receiver
}

fn unix_us() -> u64 {
    let unix = SystemTime::now().duration_since(UNIX_EPOCH);
    unix.map_or(0, |unix| {
        u64::try_from(unix.as_micros()).unwrap_or(u64::MAX)
    })
}

fn frame_rate(text: &str) -> Result<f64, String> {
    let rate = text
        .parse::<f64>()
        .ok()
        .filter(|rate| (0.1..=1_000.0).contains(rate));
    rate.ok_or_else(|| "expected 0.1 to 1000 pictures a second".to_owned())
}

fn short_text(text: &str) -> Result<String, String> {
    let fits = text.len() <= stanag_msgs::klv::MAX_TEXT;
    fits.then(|| text.to_owned())
        .ok_or_else(|| format!("{} bytes, expected at most 127", text.len()))
}

/// Sets, and pictures, that wait for the output.
const QUEUE: usize = 16;
/// A datagram of seven transport packets fits an Ethernet frame.
const DATAGRAM: usize = 7 * 188;
/// Without a 4000 for so long the rights are requested again.
const SILENCE: Duration = Duration::from_secs(3);
const ANSWER: Duration = Duration::from_secs(3);
