//! How an operation ends: carried out, refused with the given reasons, or not answered in time.

use std::fmt;
use std::net::SocketAddr;
use std::time::Duration;

use stanag_msgs::enums::LoiBitmap;
use stanag_msgs::{Id, OutOfRange};

use crate::session::sender::SendError;
use route_files::route::model::RouteError;

/// The result of a command or a transfer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// 17000 type 2, or 14000 status 1.
    CarriedOut,
    /// 17000 type 3, or 14000 status 2.
    Refused(Refused),
}

impl Outcome {
    /// The refusal as an error, for callers that need the command carried out.
    ///
    /// # Errors
    /// It was refused.
    pub fn accepted(self) -> Result<(), Refused> {
        match self {
            Outcome::CarriedOut => Ok(()),
            Outcome::Refused(refused) => Err(refused),
        }
    }

    /// Whether it was carried out.
    #[must_use]
    pub fn is_carried_out(&self) -> bool {
        matches!(self, Outcome::CarriedOut)
    }
}

/// A refusal.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refused {
    /// What was refused.
    pub what: String,
    /// The waypoint that 14000 names (Waypoint Request).
    pub waypoint: Option<u16>,
    /// The texts of the 16000s that came with it.
    pub reasons: Vec<String>,
    /// The rights that this CUCS held: a VSM need not report which one was missing.
    pub held: LoiBitmap,
}

impl std::error::Error for Refused {}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} is refused", self.what)?;
        if let Some(waypoint) = self.waypoint {
            write!(f, " for waypoint {waypoint}")?;
        }
        if self.reasons.is_empty() {
            let held = levels(self.held);
            write!(
                f,
                " (no reason given; this CUCS holds LOI {held}; a VSM may leave out a reason that it has just given: try again after 2 s)"
            )?;
        } else {
            // A VSM's text names the message and the refusal, as this error does already.
            let why = |text: &String| match text.split_once("refused: ") {
                Some((_, why)) => why.to_owned(),
                None => text.clone(),
            };
            let reasons: Vec<String> = self.reasons.iter().map(why).collect();
            write!(f, ": {}", reasons.join("; "))?;
        }
        // Commands need LOI 3, 4 or 5: for a CUCS without any of them that is most likely the reason.
        let commanding = LoiBitmap::LOI3 | LoiBitmap::LOI4 | LoiBitmap::LOI5;
        if self.held.intersects(commanding) {
            // The VSM's text is for any ground station; here the subcommand can be named.
            let no_route = [
                "no route has been loaded",
                "no longer holds the loaded route",
            ];
            let lacks_one = |text: &String| no_route.iter().any(|words| text.contains(words));
            if self.reasons.iter().any(lacks_one) {
                f.write_str("; `cucs send FILE` loads one")?;
            }
            return Ok(());
        }
        f.write_str("; this CUCS does not hold control: run `cucs take` first")
    }
}

/// Why an operation has no result.
#[derive(Debug, thiserror::Error)]
pub enum StationError {
    /// Not an address.
    #[error("{address}: {reason}, expected HOST:PORT")]
    Address {
        /// The given text.
        address: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The socket failed.
    #[error("{what}: {source}")]
    Socket {
        /// The operation on it.
        what: String,
        /// The system's error.
        source: std::io::Error,
    },
    /// The group cannot be used.
    #[error("group {group}: {source}")]
    Group {
        /// Group and port.
        group: std::net::SocketAddr,
        /// Why it cannot be joined or sent to.
        source: dli_group::GroupError,
    },
    /// The expected message did not arrive in time.
    #[error("no {expected} within {} s; {seen}", seconds(*within))]
    TimedOut {
        /// What was expected.
        expected: String,
        /// How long the station waited: until the time was up, or nothing more could arrive.
        within: Duration,
        /// What was received instead.
        seen: String,
    },
    /// No VSM answers.
    #[error("no answer from a VSM at {vsm} within {} s: {}", seconds(*within), if *unreachable { "nothing listens on that port; start the bridge or check --vsm" } else { "a VSM answers no CUCS ID (--id) that its configuration does not list, or lists with another edition, address or guard; `vsm doctor` at the VSM shows what arrives there" })]
    NoVsm {
        /// Its address.
        vsm: SocketAddr,
        /// How long the station waited.
        within: Duration,
        /// The system reported that the port is closed.
        unreachable: bool,
    },
    /// The rights requested are not granted.
    #[error(
        "vehicle {vehicle}: LOI {} requested, {} granted; this CUCS may hold {}{}",
        levels(*requested), levels(*granted), levels(*authorised),
        reasons_text(reasons)
    )]
    NotGranted {
        /// The vehicle.
        vehicle: Id,
        /// What was requested.
        requested: LoiBitmap,
        /// What this CUCS holds.
        granted: LoiBitmap,
        /// What the VSM's configuration permits it.
        authorised: LoiBitmap,
        /// The texts of the 16000s that came with the answer.
        reasons: Vec<String>,
    },
    /// A release has left rights.
    #[error(
        "vehicle {vehicle}: release requested, LOI {} still held{}",
        levels(*held), reasons_text(reasons)
    )]
    NotReleased {
        /// The vehicle.
        vehicle: Id,
        /// What this CUCS still holds.
        held: LoiBitmap,
        /// The texts of the 16000s that came with the answer.
        reasons: Vec<String>,
    },
    /// A command was refused.
    #[error(transparent)]
    Refused(#[from] Refused),
    /// A route cannot be written as messages.
    #[error(transparent)]
    Route(#[from] RouteError),
    /// A value that its field cannot express.
    #[error(transparent)]
    Value(#[from] OutOfRange),
    /// A message cannot be written, or the edition cannot express it.
    #[error(transparent)]
    Send(#[from] SendError),
}

impl StationError {
    /// 2 where the request was wrong, 1 where it was refused or not answered.
    #[must_use]
    pub fn exit_status(&self) -> u8 {
        match self {
            Self::Address { .. }
            | Self::Group {
                source:
                    dli_group::GroupError::NoInterface { .. } | dli_group::GroupError::NoAddress { .. },
                ..
            }
            | Self::Route(_)
            | Self::Value(_)
            | Self::Send(SendError::NoCounterpart(_)) => 2,
            _ => 1,
        }
    }
}

/// In tenths of a second: a wait that ended early is not a round number.
fn seconds(span: Duration) -> f64 {
    (span.as_secs_f64() * 10.0).round() / 10.0
}

fn reasons_text(reasons: &[String]) -> String {
    if reasons.is_empty() {
        " (no reason given)".to_owned()
    } else {
        format!(": {}", reasons.join("; "))
    }
}

/// Levels of interoperability for people: `2, 4, 5 (monitor, control, launch)`; `none` without a level.
pub(crate) fn levels(bits: LoiBitmap) -> String {
    bits.in_words()
}

/// Levels of interoperability as numbers: 2 to 5.
pub(crate) fn loi_numbers(bits: LoiBitmap) -> Vec<u8> {
    bits.levels().map(|(number, _)| number).collect()
}

/// How long a station waits for each kind of answer.
#[derive(Clone, Copy, Debug)]
pub struct Timeouts {
    /// For the first answer to a discovery or to a request for rights.
    pub answer: Duration,
    /// After the last discovered vehicle: another may answer this much later.
    pub quiet: Duration,
    /// For all parts of a route to be stored.
    pub store: Duration,
    /// For the 14000 that ends a transfer.
    pub transfer: Duration,
    /// For the 17000 that reports a command, or a request for rights that was received, as carried out or refused.
    pub command: Duration,
    /// For the end of a handover: the VSM gives holder and successor 20 s.
    pub consent: Duration,
    /// For the 16000 with the reason of a refusal.
    pub reason: Duration,
}

impl Default for Timeouts {
    fn default() -> Self {
        Timeouts {
            answer: Duration::from_secs(3),
            quiet: Duration::from_millis(250),
            store: Duration::from_secs(20),
            transfer: Duration::from_secs(60),
            command: Duration::from_secs(40),
            consent: Duration::from_secs(25),
            reason: Duration::from_millis(400),
        }
    }
}
