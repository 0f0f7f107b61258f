//! A session on a UDP socket, and the operations of an operator.
//!
//! Every method waits at most its time ([`Timeouts`]); after that its error names what was expected and what was
//! received instead. Nothing is spawned: the station is served while one of its methods runs, so one thread is
//! enough, and [`Station::idle`] is the way to wait. A method that is dropped before its end leaves the station
//! usable.
//!
//! In a group there are two sockets: one sends, from a port of its own, and one receives what is sent to the group.
//! Several VSMs and stations share the group.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, ToSocketAddrs as _};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use stanag_msgs::enums::{AlertPriority, LoiBitmap};
use stanag_msgs::{Id, Message, table};
use tokio::net::UdpSocket;
use tokio::time::{Instant, timeout_at};

use super::outcome::{Outcome, Refused, StationError, Timeouts};
use super::report;
use crate::session::machine::{Event, Session};
use crate::session::sender::{Delivery, Now, SessionConfig, Ticket};
use crate::session::vehicle::Vehicle;

/// A running CUCS.
#[derive(Debug)]
pub struct Station {
    pub(crate) session: Session,
    /// Sends, and receives what is sent to its own address.
    socket: UdpSocket,
    /// Receives what is sent to the group.
    group: Option<UdpSocket>,
    /// The destination: the VSM, or the group.
    vsm: SocketAddr,
    started: Instant,
    /// How long its methods wait; may be changed at any time.
    pub timeouts: Timeouts,
    /// Called with what a method waits for, and how much longer at most, once the wait has lasted half a second: at a
    /// terminal a wait must not look like a hang. `None` by default, since a library prints nothing.
    pub on_wait: Option<fn(&str, Duration)>,
    /// The present wait, until its notice was given.
    awaited: Option<Awaited>,
    /// Whether anything has been received from the VSM.
    pub(super) answered: bool,
    unreachable: bool,
}

/// A wait of a method.
#[derive(Debug)]
struct Awaited {
    what: String,
    notice_at: Instant,
    until: Instant,
}

impl Station {
    /// A station with this id: listens on `local`, sends to the VSM at `vsm`.
    ///
    /// # Errors
    /// The address is taken or cannot be used.
    pub async fn bind(id: Id, local: SocketAddr, vsm: SocketAddr) -> Result<Station, StationError> {
        Station::with_config(SessionConfig::new(id), local, vsm).await
    }

    /// A station for the VSM at `vsm`, HOST:PORT. Without `local` it listens on any port, on the loopback where the
    /// VSM is there.
    ///
    /// # Errors
    /// The VSM's address is invalid, or the own one is taken or cannot be used.
    pub async fn reach(
        config: SessionConfig,
        local: Option<SocketAddr>,
        vsm: &str,
    ) -> Result<Station, StationError> {
        let address = |reason: String| StationError::Address {
            address: vsm.to_owned(),
            reason,
        };
        let mut found = vsm
            .to_socket_addrs()
            .map_err(|fault| address(fault.to_string()))?;
        let vsm = found
            .next()
            .ok_or_else(|| address("no such host".to_owned()))?;
        let local = local.unwrap_or_else(|| any_port(vsm));
        Station::with_config(config, local, vsm).await
    }

    /// [`Station::bind`] with a session of another kind.
    ///
    /// # Errors
    /// The address is taken or cannot be used.
    pub async fn with_config(
        config: SessionConfig,
        local: SocketAddr,
        vsm: SocketAddr,
    ) -> Result<Station, StationError> {
        let fault = |what: String| move |source| StationError::Socket { what, source };
        let socket = UdpSocket::bind(local)
            .await
            .map_err(fault(format!("listen on {local}")))?;
        // A connected socket receives from the VSM only, and reports a closed port as ConnectionRefused.
        socket
            .connect(vsm)
            .await
            .map_err(fault(format!("reach {vsm} from {local}")))?;
        Ok(Station::on(config, socket, None, vsm))
    }

    /// A station that sends to a group, from `port` (0: any port), and receives what is sent there.
    ///
    /// # Errors
    /// There is no such interface, the port is taken, or the system refuses.
    pub fn in_group(
        config: SessionConfig,
        group: &dli_group::Group,
        port: u16,
    ) -> Result<Station, StationError> {
        let fault = |source| StationError::Group {
            group: group.address,
            source,
        };
        let system = |source: std::io::Error| fault(source.into());
        let receiver = group.receiver().map_err(fault)?;
        let sender = group.sender(port).map_err(fault)?;
        let receiver = UdpSocket::from_std(receiver).map_err(system)?;
        let sender = UdpSocket::from_std(sender).map_err(system)?;
        Ok(Station::on(config, sender, Some(receiver), group.address))
    }

    fn on(
        config: SessionConfig,
        socket: UdpSocket,
        group: Option<UdpSocket>,
        vsm: SocketAddr,
    ) -> Station {
        Station {
            session: Session::new(config),
            socket,
            group,
            vsm,
            started: Instant::now(),
            timeouts: Timeouts::default(),
            on_wait: None,
            awaited: None,
            answered: false,
            unreachable: false,
        }
    }

    /// The session: reports of vehicles, counters.
    #[must_use]
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// The last reports of a vehicle.
    #[must_use]
    pub fn vehicle(&self, id: Id) -> Option<&Vehicle> {
        self.session.vehicle(id)
    }

    /// The address that it listens on.
    ///
    /// # Errors
    /// The system does not report it.
    pub fn local_addr(&self) -> Result<SocketAddr, StationError> {
        self.socket
            .local_addr()
            .map_err(|source| StationError::Socket {
                what: "own address".to_owned(),
                source,
            })
    }

    /// Switches heartbeats (16002, 1 Hz) on or off; they are sent while a method runs.
    pub fn set_heartbeats(&mut self, on: bool) {
        let now = self.now();
        self.session.set_heartbeats(now, on);
    }

    /// Waits until `reached` is true; it is evaluated at the start and after every message.
    ///
    /// # Errors
    /// It does not hold within that time.
    pub async fn wait_until(
        &mut self,
        description: &str,
        within: Duration,
        mut reached: impl FnMut(&Session) -> bool,
    ) -> Result<(), StationError> {
        self.expect(description, within, |session| {
            reached(session).then_some(())
        })
        .await
    }

    /// The next event. Events that arrived while another method ran come first.
    ///
    /// # Errors
    /// There is none within that time.
    pub async fn next_event(&mut self, within: Duration) -> Result<Event, StationError> {
        self.expect("event", within, Session::poll_event).await
    }

    async fn expect<T>(
        &mut self,
        expected: &str,
        within: Duration,
        check: impl FnMut(&mut Session) -> Option<T>,
    ) -> Result<T, StationError> {
        self.awaits(expected, within);
        let found = self.until(Instant::now() + within, check).await?;
        self.awaits_nothing();
        found.ok_or_else(|| StationError::TimedOut {
            expected: expected.to_owned(),
            within,
            seen: self.seen_of_all(),
        })
    }

    /// Serves for this long: receives status, sends heartbeats.
    ///
    /// # Errors
    /// The socket fails.
    pub async fn idle(&mut self, span: Duration) -> Result<(), StationError> {
        self.awaits_nothing();
        let deadline = Instant::now() + span;
        let _: Option<()> = self.until(deadline, |_| None).await?;
        Ok(())
    }

    /// Sends any message, requesting an acknowledgement, and waits for a final one.
    ///
    /// # Errors
    /// It cannot be written, or there is no answer.
    pub async fn send(
        &mut self,
        destination: Id,
        message: impl Into<Message>,
        within: Duration,
    ) -> Result<Delivery, StationError> {
        let now = self.now();
        let ticket = self.session.send(now, destination, message)?;
        self.delivered(ticket, destination, within).await
    }

    /// Queues messages that request an acknowledgement; they are sent while the next method runs. For a station that commands
    /// several vehicles at a time, and waits for all their answers together ([`Station::next_event`]).
    ///
    /// # Errors
    /// One of them cannot be written; none is sent.
    pub fn post(
        &mut self,
        destination: Id,
        messages: impl IntoIterator<Item = Message>,
    ) -> Result<Vec<Ticket>, StationError> {
        let now = self.now();
        Ok(self.session.send_all(now, destination, messages)?)
    }

    /// Sends a command and waits until it is carried out or refused.
    pub(super) async fn command(
        &mut self,
        vehicle: Id,
        command: impl Into<Message>,
        what: String,
        within: Duration,
    ) -> Result<Outcome, StationError> {
        let mark = self.alert_mark(vehicle);
        match self.send(vehicle, command, within).await? {
            Delivery::Refused => {
                let refused = self.refusal(vehicle, what, None, mark).await?;
                Ok(Outcome::Refused(refused))
            }
            _ => Ok(Outcome::CarriedOut),
        }
    }

    /// Waits until a message is carried out or refused.
    async fn delivered(
        &mut self,
        ticket: Ticket,
        destination: Id,
        within: Duration,
    ) -> Result<Delivery, StationError> {
        let began = Instant::now();
        let message_type = self.session.sent(ticket).map_or(0, |(kind, _)| kind);
        self.awaits(format!("outcome of {}", table::named(message_type)), within);
        let delivery = self
            .until(began + within, |session| {
                let delivery = session.delivery(ticket);
                delivery.is_final().then_some(delivery)
            })
            .await?;
        self.awaits_nothing();
        let waited = time_waited(began, within);
        // Read before the withdrawal, which makes the state final.
        let last = self.session.delivery(ticket);
        self.session.withdraw(ticket);
        match delivery {
            Some(Delivery::Unanswered) if !self.answered => Err(self.no_vsm(waited)),
            Some(Delivery::Unanswered) => {
                let expected = format!("acknowledgement (17000) of {}", table::named(message_type));
                Err(self.timed_out(expected, waited, destination))
            }
            Some(delivery) => Ok(delivery),
            None => {
                let what = if last == Delivery::Received {
                    "it was received, but not finished; "
                } else {
                    ""
                };
                Err(StationError::TimedOut {
                    expected: format!(
                        "outcome (17000 type 2, carried out, or 3, refused) of {}",
                        table::named(message_type)
                    ),
                    within: waited,
                    seen: format!("{what}{}", self.seen_of(destination)),
                })
            }
        }
    }

    /// Sets what is waited for from now on, for [`Station::on_wait`].
    pub(super) fn awaits(&mut self, what: impl Into<String>, within: Duration) {
        let now = Instant::now();
        self.awaited = Some(Awaited {
            what: what.into(),
            notice_at: now + NOTICE_AFTER,
            until: now + within,
        });
    }

    /// No long wait is in progress any longer.
    pub(super) fn awaits_nothing(&mut self) {
        self.awaited = None;
    }

    /// Calls [`Station::on_wait`] where that is due.
    fn notice(&mut self) {
        let now = Instant::now();
        let due = self.awaited.take_if(|awaited| now >= awaited.notice_at);
        if let (Some(awaited), Some(on_wait)) = (due, self.on_wait) {
            on_wait(&awaited.what, awaited.until.saturating_duration_since(now));
        }
    }

    /// Serves until `check` has a result, or the time is up.
    pub(super) async fn until<T>(
        &mut self,
        deadline: Instant,
        mut check: impl FnMut(&mut Session) -> Option<T>,
    ) -> Result<Option<T>, StationError> {
        let mut buffer = [0; RECEIVE_BYTES];
        loop {
            let now = self.now();
            // Sends before checking: `check` may wait for the answer to what is queued here.
            self.session.handle_timeout(now);
            self.flush().await?;
            if let Some(found) = check(&mut self.session) {
                return Ok(Some(found));
            }
            if Instant::now() >= deadline {
                return Ok(None);
            }
            self.notice();
            let due = self.session.poll_timeout().map(|due| self.started + due);
            let notice_at = self.awaited.as_ref().map(|awaited| awaited.notice_at);
            let wake = due
                .into_iter()
                .chain(notice_at)
                .fold(deadline, Instant::min);
            match timeout_at(wake, self.receive(&mut buffer)).await {
                Err(_) => {}
                Ok(Ok(bytes)) => {
                    self.answered = true;
                    self.unreachable = false;
                    let now = self.now();
                    let datagram = buffer.get(..bytes).unwrap_or_default();
                    self.session.handle_datagram(now, datagram);
                }
                Ok(Err(source)) => self.tolerate_refused("receive", source)?,
            }
        }
    }

    /// The next datagram, from either socket.
    async fn receive(&self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let Some(group) = &self.group else {
            return self.socket.recv(buffer).await;
        };
        loop {
            // Both are only polled until one can be read: a read that is cancelled would lose a datagram.
            tokio::select! {
                ready = group.readable() => ready?,
                ready = self.socket.readable() => ready?,
            }
            for socket in [group, &self.socket] {
                match socket.try_recv_from(buffer) {
                    Ok((bytes, _)) => return Ok(bytes),
                    Err(fault) if fault.kind() == std::io::ErrorKind::WouldBlock => {}
                    Err(fault) => return Err(fault),
                }
            }
        }
    }

    /// The position in the vehicle's alerts after which the reason of a refusal may occur.
    pub(super) fn alert_mark(&self, vehicle: Id) -> u64 {
        self.vehicle(vehicle).map_or(0, |state| state.next_alert())
    }

    /// A refusal with its reasons: the texts of alerts since the mark that contain "refused", or, where none does, of
    /// all but information. Information that arrives beside a refusal by chance, such as a link that is up, is not
    /// its reason.
    pub(super) async fn refusal(
        &mut self,
        vehicle: Id,
        what: String,
        waypoint: Option<u16>,
        mark: u64,
    ) -> Result<Refused, StationError> {
        self.awaits_nothing();
        let deadline = Instant::now() + self.timeouts.reason;
        let refusals = |session: &mut Session| {
            let state = session.vehicle(vehicle)?;
            let texts: Vec<String> = warnings_from(state, mark)
                .filter(|text| text.contains("refused"))
                .collect();
            (!texts.is_empty()).then_some(texts)
        };
        let reasons = match self.until(deadline, refusals).await? {
            Some(texts) => texts,
            None => self
                .vehicle(vehicle)
                .map_or_else(Vec::new, |state| warnings_from(state, mark).collect()),
        };
        let state = self.vehicle(vehicle);
        Ok(Refused {
            what,
            waypoint,
            reasons,
            held: state.map_or(LoiBitmap::NONE, Vehicle::granted),
        })
    }

    async fn flush(&mut self) -> Result<(), StationError> {
        while let Some(datagram) = self.session.poll_transmit() {
            let sent = match self.group {
                Some(_) => self.socket.send_to(&datagram, self.vsm).await,
                None => self.socket.send(&datagram).await,
            };
            if let Err(source) = sent {
                self.tolerate_refused("send", source)?;
            }
        }
        Ok(())
    }

    /// A closed port may open again, as when the VSM restarts. Every other error ends the operation.
    fn tolerate_refused(&mut self, what: &str, source: std::io::Error) -> Result<(), StationError> {
        if source.kind() == std::io::ErrorKind::ConnectionRefused {
            self.unreachable = true;
            return Ok(());
        }
        let what = format!("{what} ({})", self.vsm);
        Err(StationError::Socket { what, source })
    }

    pub(super) fn now(&self) -> Now {
        let unix = SystemTime::now().duration_since(UNIX_EPOCH);
        Now {
            mono: self.started.elapsed(),
            unix_ms: unix.map_or(0, |unix| {
                u64::try_from(unix.as_millis()).unwrap_or(u64::MAX)
            }),
        }
    }

    pub(super) fn no_vsm(&self, within: Duration) -> StationError {
        StationError::NoVsm {
            vsm: self.vsm,
            within,
            unreachable: self.unreachable,
        }
    }

    pub(super) fn timed_out(
        &self,
        expected: String,
        within: Duration,
        vehicle: Id,
    ) -> StationError {
        StationError::TimedOut {
            expected,
            within,
            seen: self.seen_of(vehicle),
        }
    }

    fn seen_of(&self, vehicle: Id) -> String {
        match self.session.vehicle(vehicle) {
            Some(vehicle) => format!("last report: {}", report::line(vehicle)),
            None => format!("nothing received from vehicle {vehicle}"),
        }
    }

    fn seen_of_all(&self) -> String {
        let lines: Vec<String> = self.session.vehicles().map(report::line).collect();
        if lines.is_empty() {
            "nothing received from any vehicle".to_owned()
        } else {
            format!("last reports: {}", lines.join(" | "))
        }
    }
}

/// The texts of alerts since a mark with a priority above information.
fn warnings_from(state: &Vehicle, mark: u64) -> impl Iterator<Item = String> {
    let alerts = state.alerts_from(mark);
    let warnings = alerts.filter(|alert| {
        ![AlertPriority::Cleared, AlertPriority::Nominal].contains(&alert.priority)
    });
    warnings.map(|alert| alert.text.clone())
}

/// How long the wait lasted. It ends early once a message was sent as often as allowed.
pub(super) fn time_waited(began: Instant, within: Duration) -> Duration {
    began.elapsed().min(within)
}

fn any_port(vsm: SocketAddr) -> SocketAddr {
    let ip: IpAddr = match vsm.ip() {
        IpAddr::V4(ip) if ip.is_loopback() => Ipv4Addr::LOCALHOST.into(),
        IpAddr::V6(ip) if ip.is_loopback() => Ipv6Addr::LOCALHOST.into(),
        IpAddr::V4(_) => Ipv4Addr::UNSPECIFIED.into(),
        IpAddr::V6(_) => Ipv6Addr::UNSPECIFIED.into(),
    };
    SocketAddr::new(ip, 0)
}

/// A shorter wait needs no notice.
const NOTICE_AFTER: Duration = Duration::from_millis(500);
/// More than the longest allowed datagram: a datagram that is too long must be recognised as such, and not cut to a
/// valid length.
const RECEIVE_BYTES: usize = 2_048;
