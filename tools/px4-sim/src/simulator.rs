//! The simulated vehicle on real UDP sockets, in real time or faster.

use std::future::poll_fn;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::Poll;
use std::time::Duration;

use mavlink_link::frame::MAX_FRAME;
use mavlink_link::signing::{KeyId, SigningKey};
use thiserror::Error;
use tokio::net::UdpSocket;
use tokio::task::JoinHandle;
use tokio::time::{Instant, MissedTickBehavior, interval};

use crate::config::Config;
use crate::key_files::{read_px4_key, write_px4_key};
use crate::link::autopilot::{Autopilot, LinkCounters};
use crate::link::signing::Signing;
use crate::link_address::LinkAddress;
use crate::vehicle::state::{HealthFaults, Truth, VehicleCounters};

/// What to simulate, and on which links.
#[derive(Debug)]
pub struct SimulatorConfig {
    /// The vehicle.
    pub vehicle: Config,
    /// Its links; the first is the ground station's.
    pub links: Vec<LinkAddress>,
    /// Sign from the first packet with this key.
    pub key: Option<SigningKey>,
    /// Timestamp of the first packet, in units of 10 us since 2015; a real PX4's can be any.
    pub initial_timestamp: u64,
    /// PX4's own key file: read at the start where no key is given, written whenever the key changes. Without it a
    /// key is lost when the process ends.
    pub signing_file: Option<PathBuf>,
    /// How much faster than real time, 0.01 to 100.
    pub speed: f64,
}

impl SimulatorConfig {
    /// A default vehicle, unsigned, in real time, on one link.
    pub fn on(link: LinkAddress) -> Self {
        Self {
            vehicle: Config::default(),
            links: vec![link],
            key: None,
            initial_timestamp: 0,
            signing_file: None,
            speed: 1.0,
        }
    }
}

/// Why the simulator does not start.
#[derive(Debug, Error)]
pub enum SimulatorError {
    /// A link's socket.
    #[error("link {link}: {source}")]
    Socket {
        /// The link.
        link: LinkAddress,
        /// The system's error: the port may be taken.
        source: std::io::Error,
    },
    /// The speed is out of range.
    #[error("speed {0}: expected 0.01 to 100")]
    Speed(f64),
    /// The signing file cannot be used.
    #[error("signing file {}: {source}", path.display())]
    SigningFile {
        /// The file.
        path: PathBuf,
        /// The system's error, or what the file holds and what was expected.
        source: std::io::Error,
    },
    /// No link was given.
    #[error("no link: expected at least one")]
    NoLink,
}

/// Counters since the start.
#[derive(Debug, Clone, Default)]
pub struct Counters {
    /// What was done with commands and plans.
    pub vehicle: VehicleCounters,
    /// What went over each link.
    pub links: Vec<LinkCounters>,
}

/// A running simulator. Dropping it stops it.
#[derive(Debug)]
pub struct Simulator {
    shared: Arc<Mutex<Shared>>,
    addresses: Vec<SocketAddr>,
    orders: Arc<Orders>,
    task: Option<JoinHandle<()>>,
}

#[derive(Debug, Default)]
struct Orders {
    stop: AtomicBool,
    restarts: AtomicU32,
    /// Whether the battery is reported as nearly empty, whatever its simulated charge.
    empty_battery: AtomicBool,
}

/// Below PX4's BAT_LOW_THR (15 %), above BAT_CRIT_THR (7 %).
const EMPTY_BATTERY_PERCENT: u8 = 10;

#[derive(Debug)]
struct Shared {
    truth: Truth,
    track: Vec<Truth>,
    counters: Counters,
}

impl Simulator {
    /// Binds the sockets and starts, on the present tokio runtime.
    ///
    /// # Errors
    /// A socket cannot be bound, the signing file cannot be used, or the configuration is invalid.
    pub async fn spawn(config: SimulatorConfig) -> Result<Self, SimulatorError> {
        if !(0.01..=100.0).contains(&config.speed) {
            return Err(SimulatorError::Speed(config.speed));
        }
        if config.links.is_empty() {
            return Err(SimulatorError::NoLink);
        }
        let mut sockets = Vec::new();
        let mut addresses = Vec::new();
        for &link in &config.links {
            let fault = |source| SimulatorError::Socket { link, source };
            let socket = bind(link).await.map_err(fault)?;
            addresses.push(socket.local_addr().map_err(fault)?);
            sockets.push(socket);
        }
        let remotes = config
            .links
            .iter()
            .map(|link| match link {
                LinkAddress::UdpIn(_) => None,
                LinkAddress::UdpOut(to) => Some(*to),
            })
            .collect();
        let signing = match (config.key, &config.signing_file) {
            (Some(key), _) => Signing::with_key(key, config.initial_timestamp),
            (None, Some(path)) => read_px4_key(path).map_err(|source| {
                let path = path.clone();
                SimulatorError::SigningFile { path, source }
            })?,
            (None, None) => Signing::off(),
        };
        let autopilot = Autopilot::new(config.vehicle, signing, remotes);
        let shared = Arc::new(Mutex::new(Shared {
            truth: autopilot.vehicle().truth(),
            track: Vec::new(),
            counters: Counters::default(),
        }));
        let orders = Arc::new(Orders::default());
        let simulation = Simulation {
            autopilot,
            sockets,
            shared: Arc::clone(&shared),
            next_sample: Duration::ZERO,
            signing_file: config.signing_file,
        };
        let task = tokio::spawn(simulation.run(config.speed, Arc::clone(&orders)));
        Ok(Self {
            shared,
            addresses,
            orders,
            task: Some(task),
        })
    }

    /// The socket address of a link.
    pub fn address(&self, link: usize) -> Option<SocketAddr> {
        self.addresses.get(link).copied()
    }

    /// The true state now.
    pub fn truth(&self) -> Truth {
        self.lock().truth
    }

    /// When the vehicle was first armed, in time since boot, by the samples that [`take_track`](Self::take_track) has
    /// not returned yet.
    pub fn armed_at(&self) -> Option<Duration> {
        let shared = self.lock();
        let armed = shared.track.iter().find(|truth| truth.armed)?;
        Some(armed.time)
    }

    /// The flown track since the last call: a sample for each tenth of a simulated second.
    pub fn take_track(&self) -> Vec<Truth> {
        std::mem::take(&mut self.lock().track)
    }

    /// Counters since the start.
    pub fn counters(&self) -> Counters {
        self.lock().counters.clone()
    }

    /// Switches the vehicle off and on: see [`Autopilot::restart`].
    pub fn restart(&self) {
        self.orders.restarts.fetch_add(1, Ordering::Relaxed);
    }

    /// Reports a battery at 10 %, or the simulated charge again: for tests of a ground station's reaction.
    pub fn empty_battery(&self, empty: bool) {
        self.orders.empty_battery.store(empty, Ordering::Relaxed);
    }

    /// Stops, waits until the sockets are closed, and returns the counters of everything that was sent and received.
    pub async fn stop(mut self) -> Counters {
        self.orders.stop.store(true, Ordering::Relaxed);
        if let Some(task) = self.task.take() {
            // A panic of the task has been reported by the runtime; there is nothing left to stop.
            let _ = task.await;
        }
        self.counters()
    }

    fn lock(&self) -> MutexGuard<'_, Shared> {
        // The shared values are plain: a panic elsewhere leaves none of them half-written.
        self.shared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        self.orders.stop.store(true, Ordering::Relaxed);
    }
}

async fn bind(link: LinkAddress) -> std::io::Result<UdpSocket> {
    match link {
        LinkAddress::UdpIn(at) => UdpSocket::bind(at).await,
        LinkAddress::UdpOut(SocketAddr::V4(to)) if to.ip().is_loopback() => {
            UdpSocket::bind("127.0.0.1:0").await
        }
        LinkAddress::UdpOut(SocketAddr::V4(_)) => UdpSocket::bind("0.0.0.0:0").await,
        LinkAddress::UdpOut(SocketAddr::V6(_)) => UdpSocket::bind("[::]:0").await,
    }
}

/// The task: an autopilot, its sockets, and what the handle sees of it.
struct Simulation {
    autopilot: Autopilot<SocketAddr>,
    sockets: Vec<UdpSocket>,
    shared: Arc<Mutex<Shared>>,
    next_sample: Duration,
    signing_file: Option<PathBuf>,
}

impl Simulation {
    async fn run(mut self, speed: f64, orders: Arc<Orders>) {
        let mut beat = interval(BEAT);
        beat.set_missed_tick_behavior(MissedTickBehavior::Skip);
        let mut last = Instant::now();
        let mut restarts = 0;
        let mut empty_battery = false;
        let mut buffer = vec![0; 65_536];
        loop {
            tokio::select! {
                _ = beat.tick() => {
                    if orders.stop.load(Ordering::Relaxed) {
                        // What was answered since the last step counts too.
                        self.publish();
                        return;
                    }
                    let requested = orders.restarts.load(Ordering::Relaxed);
                    if requested != restarts {
                        restarts = requested;
                        self.autopilot.restart();
                        self.next_sample = Duration::ZERO;
                    }
                    let empty = orders.empty_battery.load(Ordering::Relaxed);
                    if empty != empty_battery {
                        empty_battery = empty;
                        self.autopilot.vehicle_mut().set_health_faults(HealthFaults {
                            battery: empty.then_some(EMPTY_BATTERY_PERCENT),
                            ..HealthFaults::default()
                        });
                    }
                    let elapsed = last.elapsed().min(CATCH_UP);
                    last = Instant::now();
                    self.advance(elapsed.mul_f64(speed)).await;
                }
                link = readable(&self.sockets) => {
                    self.receive(link, &mut buffer);
                    self.flush().await;
                }
            }
        }
    }

    /// Lets simulated time pass in small steps, so that messages are sent in order, and a fast simulator does not
    /// send whole seconds at once.
    async fn advance(&mut self, span: Duration) {
        let mut left = span;
        while !left.is_zero() {
            let piece = left.min(PIECE);
            left -= piece;
            self.autopilot.step(piece);
            self.sample();
            self.flush().await;
        }
        self.publish();
    }

    /// Shows the handle where the vehicle is, and the counters.
    fn publish(&self) {
        let counters = Counters {
            vehicle: self.autopilot.vehicle().counters(),
            links: (0..self.sockets.len())
                .map(|link| self.autopilot.counters(link))
                .collect(),
        };
        let mut shared = self.shared.lock().unwrap_or_else(PoisonError::into_inner);
        shared.truth = self.autopilot.vehicle().truth();
        shared.counters = counters;
    }

    fn sample(&mut self) {
        let truth = self.autopilot.vehicle().truth();
        if truth.time < self.next_sample {
            return;
        }
        self.next_sample = truth.time + SAMPLE;
        let mut shared = self.shared.lock().unwrap_or_else(PoisonError::into_inner);
        if shared.track.len() < MAX_TRACK {
            shared.track.push(truth);
        }
    }

    /// Reads what one socket has, up to a limit, so that a flood does not stop time.
    fn receive(&mut self, link: usize, buffer: &mut [u8]) {
        let Some(socket) = self.sockets.get(link) else {
            return;
        };
        let before = self.signing_mark();
        for _ in 0..BATCH {
            match socket.try_recv_from(buffer) {
                Ok((len, from)) => self.autopilot.handle_datagram(link, from, &buffer[..len]),
                // On loopback, a closed port at the other end is reported as an error of this socket; its peer may
                // still start.
                Err(error) if error.kind() == std::io::ErrorKind::ConnectionRefused => {}
                Err(_) => break,
            }
        }
        if let Some(path) = &self.signing_file
            && self.signing_mark() != before
        {
            // PX4 does not notice a full card either, so the error is ignored.
            let _ = write_px4_key(path, self.autopilot.signing());
        }
    }

    /// A value that changes where the key or its first stamp changes.
    fn signing_mark(&self) -> (Option<KeyId>, u64) {
        let signing = self.autopilot.signing();
        (signing.key().map(SigningKey::id), signing.stored_stamp())
    }

    async fn flush(&mut self) {
        let mut buffer = [0; MAX_FRAME];
        while let Some(transmit) = self.autopilot.poll_transmit(&mut buffer) {
            if let Some(socket) = self.sockets.get(transmit.link) {
                // A closed port or a full buffer is a lost datagram, as on any link.
                let _ = socket.send_to(&buffer[..transmit.len], transmit.to).await;
            }
        }
    }
}

/// The index of the first socket that can be read.
async fn readable(sockets: &[UdpSocket]) -> usize {
    poll_fn(|context| {
        let ready = sockets
            .iter()
            .position(|socket| socket.poll_recv_ready(context).is_ready());
        ready.map_or(Poll::Pending, Poll::Ready)
    })
    .await
}

/// How often real time is turned into simulated time.
const BEAT: Duration = Duration::from_millis(4);
/// Simulated time between two rounds of sending.
const PIECE: Duration = Duration::from_millis(20);
/// After a pause of the whole machine longer than this, the lost time is skipped.
const CATCH_UP: Duration = Duration::from_millis(250);
/// Simulated time between two samples of the track.
const SAMPLE: Duration = Duration::from_millis(100);
/// Datagrams read at once.
const BATCH: usize = 64;
/// Samples of one day.
const MAX_TRACK: usize = 864_000;
