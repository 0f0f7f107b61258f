//! What outlives a scene: the subject's address and profile, the suite's timers, the survey, and the network.

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

/// The suite's timers, already scaled. The standard sets no latency between VSM and CUCS, so all of them are the
/// suite's own.
#[derive(Clone, Copy, Debug)]
pub struct Timers {
    /// How long an answer to a request may take.
    pub answer: Duration,
    /// How long an acknowledgement may take.
    pub ack: Duration,
    /// How long to watch before "nothing came" is judged.
    pub quiet: Duration,
    /// Window over which rates are measured.
    pub status: Duration,
    /// How long the vehicle may take to begin what it was commanded.
    pub begin: Duration,
    /// How long the vehicle may take to arrive.
    pub flight: Duration,
    /// How long a mission transfer may take.
    pub load: Duration,
    /// How long a full configuration may take.
    pub config: Duration,
}

impl Timers {
    /// The timers of the catalogue, replaced by those of the profile, multiplied by its factor; flight times are also
    /// divided by the speed of the simulation.
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

    /// A loiter radius, in metres, that was not used shortly before: 90 to 240 m, a multiple of the wire's step. In
    /// Edition 2.5 it is one of those that stand for a mode preference ([`marker`]).
    pub fn fresh_radius(&self) -> f64 {
        let number = self.radius.fetch_add(1, Ordering::SeqCst);
        if self.net.dialect().is_some() {
            // Number 0 is skipped: it stands for the preference that a subject starts with, so setting it would show
            // nothing.
            return self.radius(1 + number * 7 % (marker::COUNT - 1));
        }
        self.radius(number * 7)
    }

    /// The loiter radius with this number, in metres: a harmless setting by which the suite sees whose commands are
    /// obeyed. Numbers beyond the last start over.
    #[must_use]
    pub fn radius(&self, number: u32) -> f64 {
        if self.net.dialect().is_some() {
            return marker::radius_m(number);
        }
        90.0 + 1.5 * f64::from(number % 100)
    }

    /// The survey.
    ///
    /// # Errors
    /// Inconclusive where there is none, because nothing answered.
    pub fn surveyed(&self) -> Judged<&Survey> {
        self.survey
            .get()
            .ok_or_else(|| Stop::inconclusive("the subject answered no discovery"))
    }
}
