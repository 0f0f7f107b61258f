//! What outlives a scene: the subject's address and profile, the suite's times, the survey, and the network.

use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use super::fix::Fix;
use super::net::Net;
use super::survey::Survey;
use crate::catalogue::Catalogue;
use crate::profile::Profile;
use crate::verdict::{Judged, Stop};
use crate::wire::dialect::{Role, marker};

/// The suite's times, scaled.
#[derive(Clone, Copy, Debug)]
pub struct Timers {
    /// An answer to a request.
    pub answer: Duration,
    /// An acknowledgement.
    pub ack: Duration,
    /// How long nothing may come.
    pub quiet: Duration,
    /// Window over which rates are measured.
    pub status: Duration,
    /// The vehicle begins to obey.
    pub begin: Duration,
    /// The vehicle arrives.
    pub flight: Duration,
    /// A mission transfer.
    pub load: Duration,
    /// A full configuration.
    pub config: Duration,
}

impl Timers {
    /// Those of the catalogue, changed by the profile, times its factor; flight times also by the speed of the simulation.
    #[must_use]
    pub fn new(catalogue: &Catalogue, profile: &Profile) -> Self {
        let factor = profile.timers.get("factor").copied().unwrap_or(1.0);
        let of = |name: &str| {
            let seconds = profile
                .timers
                .get(name)
                .or(catalogue.timers.get(name))
                .copied()
                .unwrap_or(2.0);
            Duration::from_secs_f64(seconds * factor)
        };
        let speed = profile.figures.speed_factor.max(0.1);
        Self {
            answer: of("answer"),
            ack: of("ack"),
            quiet: of("quiet"),
            status: of("status"),
            begin: of("move").max(of("answer")),
            flight: of("flight").div_f64(speed).max(of("answer") * 5),
            load: of("load"),
            config: of("config"),
        }
    }
}

/// Everything that outlives a scene.
#[derive(Debug)]
pub struct Bench {
    /// Sockets, clock, recording.
    pub net: Arc<Net>,
    /// What the subject claims.
    pub profile: Profile,
    /// Where it listens.
    pub address: SocketAddr,
    /// The suite's times.
    pub timers: Timers,
    /// What the discovery showed.
    pub survey: OnceLock<Survey>,
    /// Where the vehicle stood when it was first seen.
    pub home: OnceLock<Fix>,
    /// The VSM, as its answers name it: messages of Edition 2.5 are addressed to it by name.
    pub vsm: OnceLock<stanag_msgs::Id>,
    /// Whether the hazard of a flight is released.
    pub flight_released: AtomicBool,
    /// Whether the vehicle is a simulated one, which nothing can hurt.
    pub simulated: AtomicBool,
    /// Milliseconds for which a later message 2 may follow the first: a subject may send it twice, or late.
    pub settle_ms: AtomicU32,
    radius: AtomicU32,
}

impl Bench {
    /// A bench for a subject at this address.
    #[must_use]
    pub fn new(catalogue: &Catalogue, profile: Profile, address: SocketAddr) -> Arc<Self> {
        Arc::new(Self {
            net: Net::new(&profile.subject.edition, Role::Cucs),
            timers: Timers::new(catalogue, &profile),
            profile,
            address,
            survey: OnceLock::new(),
            home: OnceLock::new(),
            vsm: OnceLock::new(),
            flight_released: AtomicBool::new(false),
            simulated: AtomicBool::new(false),
            settle_ms: AtomicU32::new(0),
            radius: AtomicU32::new(0),
        })
    }

    /// A loiter radius that was not used shortly before: 90 to 240 m, a multiple of the wire's step. In Edition 2.5 one of
    /// those that stand for a mode preference ([`marker`]).
    pub fn fresh_radius(&self) -> f64 {
        let number = self.radius.fetch_add(1, Ordering::SeqCst);
        if self.net.dialect().is_some() {
            // The first is what a subject begins with.
            return self.radius(1 + number * 7 % (marker::COUNT - 1));
        }
        self.radius(number * 7)
    }

    /// One of the loiter radii by which the suite sees whose commands are obeyed, in metres; numbers beyond begin again.
    #[must_use]
    pub fn radius(&self, number: u32) -> f64 {
        if self.net.dialect().is_some() {
            return marker::radius_m(number);
        }
        90.0 + 1.5 * f64::from(number % 100)
    }

    /// The survey, where one was made.
    ///
    /// # Errors
    /// None was made: nothing answered.
    pub fn surveyed(&self) -> Judged<&Survey> {
        self.survey
            .get()
            .ok_or_else(|| Stop::inconclusive("the subject answered no discovery"))
    }
}
