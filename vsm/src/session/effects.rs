//! The effects of a machine: send, acknowledge, alert, command the vehicle, persist, and send requests to a sibling through
//! the router.
//!
//! A machine can read back only whether an effect was possible. Two rules hold for every machine, because they are
//! implemented only here:
//!
//! - **Persist, then answer.** [`Effects::disk`] writes before it returns, or queues the change. Messages that a machine
//!   sends after that in the same call, and every acknowledgement, are held until the change is durable
//!   ([`DliEffects::release`]). Messages are only queued in the bridge, and the shell takes them after the call: no answer
//!   can leave before its promise is stored. Only that a message about rights has arrived is answered before
//!   ([`DliEffects::acknowledge_decision`]): it promises nothing.
//! - **A request to a sibling is carried out after the call**, by the router, in the order of the requests: a machine is
//!   never called again in the middle of a change.

use std::collections::VecDeque;
use std::time::Duration;

use mapping::alert;
use mavlink_link::Now;
use mavlink_link::store::{Changes, Disk, Progress, StoreError};
use stanag_msgs::enums::{AckType, AlertPriority, RouteType, SubsystemId};
use stanag_msgs::messages::{
    Contingency, FlightTerminationModeReport, HeldCommandState, MessageAcknowledgement, VehicleId,
    VehicleOperatingModeCommand,
};
use stanag_msgs::{Id, Message, TimeStamp, ed25};

use super::alerts::{Alerts, Cause, Raised};
use super::context::{HeldOrigin, Origin};
use super::counters::Counters;
use super::duplicates::Remembered;
use super::link::services::Services;
use super::log::{LogEntry, LogLevel};
use super::logical::LogicalIds;
use super::outbox::{Datagram, Destination, Instance, Outbox, Waiting};
use super::paths::{Kind, Paths, Verdict};
use super::station::GroundStation;
use super::store::{Boot, Uptime};

/// The effects of a machine of one vehicle. Borrowed for one call.
pub(crate) struct Effects<'a> {
    pub(crate) dli: DliEffects<'a>,
    /// The vehicle that answers.
    pub(crate) id: Id,
    pub(crate) alerts: &'a mut Alerts,
    /// The stations that hold LOI 2; only the authority machine writes it.
    pub(crate) listeners: &'a mut Vec<usize>,
    /// Requests to the vehicle.
    pub(crate) vehicle: &'a mut Services,
    pub(crate) requests: &'a mut VecDeque<Request>,
}

/// The DLI side, the log and the disk: common to all vehicles of a bridge.
pub(crate) struct DliEffects<'a> {
    pub(crate) now: Now,
    /// `None` where the system does not name it.
    pub(crate) boot: Option<Boot>,
    pub(crate) vsm: Id,
    pub(crate) multicast: bool,
    pub(crate) stations: &'a [GroundStation],
    pub(crate) logical: &'a LogicalIds,
    /// Recent messages of each station, and their answers.
    pub(crate) remembered: &'a mut [Remembered],
    /// Alerts of the VSM itself, not of a vehicle.
    pub(crate) alerts: &'a mut Alerts,
    pub(crate) outbox: &'a mut Outbox,
    /// Rate limits of messages to each station.
    pub(crate) paths: &'a mut Paths,
    pub(crate) counters: &'a mut Counters,
    pub(crate) log: &'a mut VecDeque<LogEntry>,
    pub(crate) disk: &'a mut dyn Disk,
    /// The station whose message is being handled.
    pub(crate) asker: Option<usize>,
    /// The last change that the disk had queued at the start of the call: messages sent after a later change wait for it.
    pub(crate) mark: u64,
}

/// A request of one machine to another.
#[derive(Debug)]
pub(crate) enum Request {
    /// To flight: carry out a 2016; without origin it is a command of the VSM. `just_loaded`: its mission was uploaded for
    /// it.
    Fly {
        origin: Option<Origin>,
        command: Box<VehicleOperatingModeCommand>,
        just_loaded: bool,
    },
    /// To flight: put the vehicle on hold, whatever is in progress (the mission watchdog).
    Hold,
    /// To flight and link: control has passed to another CUCS, or to nobody.
    ControlChanged,
    /// To flight: the controlling CUCS was lost, and nobody has control.
    ControllerLost,
    /// To mission: upload a route of this type, or if `None` the one that 13000 loaded, then fly this.
    LoadAndFly {
        origin: Option<Origin>,
        route_type: Option<RouteType>,
        command: Box<VehicleOperatingModeCommand>,
    },
    /// To mission: refuse the mode command that waits for its route, for this reason. `without_right`: only if its sender
    /// does not control the vehicle.
    DropWaitingCommand { why: String, without_right: bool },
    /// To the router: carry out a held command as if it arrived now; a contingency also for a CUCS that has lost control, if
    /// nobody has it.
    CarryOut {
        origin: Origin,
        message: Box<Message>,
    },
    /// To held: the answer to a held command, and the reason.
    HeldEnded {
        serial: u32,
        answer: AckType,
        why: Option<String>,
    },
    /// To flight and mission: a flight termination is commanded; end maneuvers and uploads.
    YieldToTermination,
    /// To authority: write this about a flight termination into the audit log; the result is reported to the termination
    /// machine.
    Audit {
        what: &'static str,
        by: Option<Id>,
        why: String,
    },
    /// To termination: its entry is written, up to this change of the disk, or cannot be written.
    Audited(Result<Changes, String>),
    /// To reports and termination: the station has gained or lost LOI 2.
    ListenerChanged { station: usize },
    /// To reports: these configuration values have changed; `by` already knows.
    Configured {
        changed: Vec<Message>,
        by: Option<usize>,
    },
    /// To reports: send these a few at a time, then acknowledge `origin` as carried out.
    AnswerLater {
        station: usize,
        answers: Vec<Message>,
        origin: Option<Origin>,
    },
}

impl<'a> DliEffects<'a> {
    /// The same for a shorter time.
    pub(crate) fn reborrow(&mut self) -> DliEffects<'_> {
        DliEffects {
            now: self.now,
            boot: self.boot,
            vsm: self.vsm,
            multicast: self.multicast,
            stations: self.stations,
            logical: self.logical,
            remembered: self.remembered,
            alerts: self.alerts,
            outbox: self.outbox,
            paths: self.paths,
            counters: self.counters,
            log: self.log,
            mark: self.disk.queued(),
            disk: self.disk,
            asker: self.asker,
        }
    }

    /// The changes of the disk that a message made now has to wait for.
    fn waits_for(&self) -> Option<Changes> {
        let own = Changes {
            after: self.mark,
            until: self.disk.queued(),
        };
        let until = own.and(self.outbox.answer_after);
        (self.disk.progress(until) != Progress::Durable).then_some(until)
    }

    /// The stamp of a message made now.
    pub(crate) fn stamp(&mut self) -> TimeStamp {
        self.outbox.stamp(self.now)
    }

    /// This moment, for a record whose age decides something after a restart.
    pub(crate) fn uptime(&self) -> Option<Uptime> {
        self.boot.map(|boot| boot.at(self.now.mono))
    }

    /// Sends an answer to one station, where its address is known.
    pub(crate) fn send(&mut self, station: usize, source: Id, message: &Message) {
        let is_there = |one: &GroundStation| one.peer.is_some();
        if self.stations.get(station).is_some_and(is_there) {
            self.deliver(station, source, message, (Kind::Answer, Kind::Answer));
        }
    }

    /// Sends a report or an alert to a station.
    pub(crate) fn publish(&mut self, station: usize, source: Id, message: &Message) {
        let report = Kind::Report(message.id());
        let kind = match message {
            // A one-time event is not sent again, so it waits instead of being dropped.
            Message::SubsystemStatusAlert(_) | Message::HandoverStatusReport(_) => Kind::Answer,
            _ => report,
        };
        self.deliver(station, source, message, (kind, report));
    }

    /// Sends to the address of a station, and to the group where its profile says so: addressed to the station there too,
    /// so that it can be distinguished from what is for another. `kind`: at the address, and in the group.
    fn deliver(&mut self, station: usize, source: Id, message: &Message, kind: (Kind, Kind)) {
        // A report of now is stale when the queue is sent again, and another one follows.
        if self.outbox.is_paused()
            && matches!(kind, (Kind::Report(of), _) if !SENT_ONCE.contains(&of))
        {
            return;
        }
        let Some(one) = self.stations.get(station) else {
            return;
        };
        let source = self.logical.shown_as(source);
        let (envelope, delivery) = (one.profile.envelope(source, one.id()), one.profile.delivery);
        if let (true, Some(peer)) = (delivery.to_address(), one.peer) {
            let to = Destination::Unicast(peer);
            if let Some(datagram) = Outbox::compose(to, &one.profile, &envelope, message) {
                self.deliver_to_address(station, datagram, kind.0);
            }
        }
        if self.multicast && delivery.to_group() {
            let to = Destination::Multicast;
            if let Some(mut datagram) = Outbox::compose(to, &one.profile, &envelope, message)
                && self.may_go_to_group(station, &mut datagram, kind.1)
            {
                self.post(station, datagram);
            }
        }
    }

    fn deliver_to_address(&mut self, station: usize, datagram: Datagram, kind: Kind) {
        let kind = match kind {
            Kind::Report(_) => kind,
            _ => Kind::of_answer(&datagram),
        };
        self.convey(station, datagram, kind);
    }

    /// Sends a datagram that is in Edition 2.5 already to its station.
    pub(crate) fn send_translated(&mut self, station: usize, bytes: &[u8]) {
        let Some(one) = self.stations.get(station) else {
            return;
        };
        let (id, delivery) = (one.id(), one.profile.delivery);
        if let (true, Some(peer)) = (delivery.to_address(), one.peer)
            && let Some(datagram) = Datagram::of_ed25(Destination::Unicast(peer), id, bytes)
        {
            self.convey(station, datagram, Kind::Answer);
        }
        if self.multicast
            && delivery.to_group()
            && let Some(mut datagram) = Datagram::of_ed25(Destination::Multicast, id, bytes)
            && self.may_go_to_group(station, &mut datagram, Kind::Answer)
        {
            self.post(station, datagram);
        }
    }

    /// Sends a datagram to a station, within what it may be sent.
    fn convey(&mut self, station: usize, datagram: Datagram, kind: Kind) {
        if self.held_until(station).is_some() {
            // Its rate limit is checked when it is sent.
            return self.post(station, datagram);
        }
        self.admit(station, datagram, kind);
    }

    fn packs(&self, station: usize) -> bool {
        let station = self.stations.get(station);
        station.is_some_and(|one| one.profile.packs() && !one.speaks_ed25())
    }

    /// Queues a datagram for the address of a station, lets it wait for its credit, or drops it.
    fn admit(&mut self, station: usize, mut datagram: Datagram, kind: Kind) {
        let (now, bytes) = (self.now.mono, self.paths.bytes_of(station, &datagram));
        datagram.charged = bytes;
        match self.paths.admit(now, station, bytes, kind) {
            Verdict::Send if self.packs(station) => self.outbox.pack(datagram),
            Verdict::Send => self.outbox.push(datagram),
            Verdict::Wait => self.paths.wait(now, station, datagram),
            Verdict::Drop(why) => self.counters.count(why),
        }
    }

    fn may_go_to_group(&mut self, station: usize, datagram: &mut Datagram, kind: Kind) -> bool {
        let (now, bytes) = (self.now.mono, self.paths.bytes_of(station, datagram));
        datagram.charged = bytes;
        let may = self.paths.admit_to_group(now, station, bytes, kind);
        if !may {
            self.counters.count("group over the rate");
            // Nothing waits for the group. A station that has the same at its address misses nothing.
            let station_of = self.stations.get(station);
            let alone = station_of.is_some_and(|one| !one.profile.delivery.to_address());
            if alone && !matches!(kind, Kind::Report(_)) {
                self.paths.note_missed(station);
            }
        }
        may
    }

    /// The change of the disk that what this station is sent now waits for.
    fn held_until(&self, station: usize) -> Option<Changes> {
        let behind = || {
            // Answers to one station keep their order; other stations do not wait for its changes.
            let asked = self.asker.filter(|asker| *asker == station);
            asked.and_then(|asker| self.outbox.held_for(asker))
        };
        self.waits_for().or_else(behind)
    }

    /// Queues a datagram, not before a change of the disk that it depends on is durable.
    fn post(&mut self, station: usize, datagram: Datagram) {
        match self.held_until(station) {
            None => self.outbox.push(datagram),
            Some(until) => {
                let waiting = Waiting::Datagram(Box::new(datagram));
                self.hold(until, self.asker, waiting);
            }
        }
    }

    /// Logs the last message before it is carried out. `authorised`: its Time Stamp is used from here on. `None` if such
    /// messages are not logged; an error if the write failed.
    pub(crate) fn accept(
        &mut self,
        origin: &Origin,
        authorised: bool,
    ) -> Option<Result<(), StoreError>> {
        let station = self.stations.get(origin.station)?.id();
        let remembered = self.remembered.get_mut(origin.station)?;
        let (of, now) = (origin.message_type, self.now.mono);
        let stamp = origin.stamp?;
        remembered.accept(station, of, stamp, authorised, now, self.disk)
    }

    /// Queues messages that have waited for the disk, within the rate limits of their destinations.
    fn send_held(&mut self, datagram: Datagram) {
        let Destination::Unicast(to) = datagram.to else {
            return self.outbox.push(datagram);
        };
        let mut stations = self.stations.iter();
        let id = datagram.destination();
        // If the station has moved since, it is dropped: the station will ask again.
        let is_there = |one: &GroundStation| one.id() == id && one.peer == Some(to);
        let Some(station) = stations.position(is_there) else {
            return self.counters.count("no address");
        };
        let kind = Kind::of_answer(&datagram);
        self.admit(station, datagram, kind);
    }

    /// Answers with 17000 where one was requested, and remembers the answer for duplicates.
    pub(crate) fn acknowledge(&mut self, source: Id, origin: &Origin, answer: AckType) {
        if answer == AckType::Refused {
            self.counters.count("refused");
        }
        let behind = || self.outbox.held_for(origin.station);
        match self.waits_for().or_else(behind) {
            None => self.send_acknowledgement(source, origin, answer),
            Some(until) => {
                let what = Waiting::Acknowledgement(source, *origin, answer);
                self.hold(until, Some(origin.station), what);
            }
        }
    }

    /// As [`DliEffects::acknowledge`], for a message that disposes of rights. Its decision may wait for the disk for as long as that
    /// takes: its sender is sent at once that the message has arrived. That promises nothing, so it waits for nothing.
    pub(crate) fn acknowledge_decision(&mut self, source: Id, origin: &Origin, answer: AckType) {
        let station = self.stations.get(origin.station);
        // To an address that has proven nothing little may be sent: that is for the decision, and for message 2.
        let is_there = station.is_some_and(|one| one.proven);
        // An acknowledgement of Edition 2.5 (#1400) means that the message is not refused.
        let misleads =
            answer == AckType::Refused && station.is_some_and(GroundStation::speaks_ed25);
        if is_there && !misleads && self.waits_for().is_some() {
            self.send_acknowledgement(source, origin, AckType::Received);
            if answer == AckType::Received {
                return;
            }
        }
        self.acknowledge(source, origin, answer);
    }

    /// Sends an earlier answer again. "Received" leaves at once, as it did before: behind the decision that still waits for the disk
    /// it would be the last answer.
    pub(crate) fn acknowledge_again(&mut self, source: Id, origin: &Origin, answer: AckType) {
        if answer == AckType::Received {
            self.send_acknowledgement(source, origin, answer);
        } else {
            self.acknowledge(source, origin, answer);
        }
    }

    fn hold(&mut self, until: Changes, asker: Option<usize>, what: Waiting) {
        let stuck = self.disk.progress(until) == Progress::Failing;
        if !self.outbox.hold((until, stuck), asker, what) {
            self.counters.count("no room to wait for the disk");
        }
    }

    fn send_acknowledgement(&mut self, source: Id, origin: &Origin, answer: AckType) {
        // Even if no 17000 was requested: after a restart the command must be known as ended.
        if let (Some(station), Some(remembered), Some(stamp)) = (
            self.stations.get(origin.station),
            self.remembered.get_mut(origin.station),
            origin.stamp,
        ) {
            remembered.answered(station.id(), origin.message_type, stamp, answer, self.disk);
        }
        let there = self.stations.get(origin.station);
        let (true, Some(one)) = (origin.ack_requested, there.filter(|one| one.peer.is_some()))
        else {
            return;
        };
        let message = MessageAcknowledgement {
            time_stamp: Some(self.stamp()),
            original_message_time_stamp: origin.stamp,
            original_message_type: Some(origin.message_type),
            acknowledgement_type: Some(answer),
        };
        let (message, delivery) = (Message::from(message), one.profile.delivery);
        let envelope = one
            .profile
            .envelope(self.logical.shown_as(source), one.id());
        let compose = |to| Outbox::compose(to, &one.profile, &envelope, &message);
        // It has already waited for the disk: neither message is held again.
        if let (true, Some(peer)) = (delivery.to_address(), one.peer)
            && let Some(datagram) = compose(Destination::Unicast(peer))
        {
            self.admit(origin.station, datagram, Kind::Acknowledgement);
        }
        if self.multicast
            && delivery.to_group()
            && let Some(mut datagram) = compose(Destination::Multicast)
            && self.may_go_to_group(origin.station, &mut datagram, Kind::Acknowledgement)
        {
            self.outbox.push(datagram);
        }
    }

    /// Sends what has waited for the disk.
    pub(crate) fn release(&mut self) {
        let disk = &*self.disk;
        for waiting in self.outbox.release(|changes| disk.progress(changes)) {
            match waiting {
                Waiting::Datagram(datagram) => {
                    let mut stations = self.stations.iter();
                    let datagram = match stations.find(|one| one.id() == datagram.destination()) {
                        Some(one) => self.outbox.restamped(self.now, *datagram, &one.profile),
                        None => *datagram,
                    };
                    self.send_held(datagram);
                }
                Waiting::Acknowledgement(source, origin, answer) => {
                    self.send_acknowledgement(source, &origin, answer);
                }
            }
        }
    }

    /// Sends an alert (16000) to these stations, by the group too, and writes it to the log.
    pub(crate) fn alert(&mut self, source: Id, to: &[usize], raised: Option<Raised>) {
        if let Some(raised) = raised {
            let Raised { alert, .. } = &raised;
            self.note(LogLevel::of(alert.priority), source, alert.text.clone());
            self.show(source, to, &raised);
        }
    }

    /// Sends an alert that is the VSM's own (16000) to stations, each in the name of a vehicle, and writes it to the log once.
    pub(crate) fn alert_each(&mut self, to: &[(usize, Id)], raised: Option<Raised>) {
        if let Some(raised) = raised {
            let Raised { alert, .. } = &raised;
            self.note(LogLevel::of(alert.priority), self.vsm, alert.text.clone());
            for (station, vehicle) in to {
                self.show(*vehicle, &[*station], &raised);
            }
        }
    }

    /// Sends an alert (16000) to these stations, by the group too.
    pub(crate) fn show(&mut self, source: Id, to: &[usize], raised: &Raised) {
        let Raised { alert, first } = raised;
        let mut of_each = [Vec::new(), Vec::new()];
        for station in to {
            let instance = match (alert.lasting, first) {
                (true, _) => self.outbox.show(*station, alert.id, *first, alert.priority),
                (false, true) => Instance::First,
                (false, false) => Instance::Later,
            };
            match instance {
                Instance::First => of_each[0].push(*station),
                Instance::Later => of_each[1].push(*station),
                Instance::Never => {}
            }
        }
        for (first, to) in [true, false].into_iter().zip(of_each) {
            if to.is_empty() {
                continue;
            }
            let (outbox, now) = (&mut *self.outbox, self.now);
            let stamp = || {
                let stamp = outbox.stamp(now);
                outbox.note_alert(stamp, alert.id);
                stamp
            };
            let messages: Vec<Message> = alert::messages(alert, first, stamp)
                .map(Message::SubsystemStatusAlert)
                .collect();
            for message in &messages {
                for station in &to {
                    self.publish(*station, source, message);
                }
            }
        }
    }

    /// Refuses, in the name of the VSM, a message that is for no vehicle in particular.
    pub(crate) fn refuse(&mut self, origin: &Origin, why: &str) {
        let vsm = self.vsm;
        self.acknowledge(vsm, origin, AckType::Refused);
        let text = format!("{} refused: {why}", self.named(origin));
        let to = [origin.station];
        let raised = self.alerts.answer_sometimes(self.now.mono, &to, text);
        self.alert(vsm, &to, raised);
    }

    /// The message that is answered, as its station names it.
    fn named(&self, origin: &Origin) -> String {
        let station = self.stations.get(origin.station);
        let own = station.filter(|one| one.speaks_ed25()).zip(origin.stamp);
        let own = own.and_then(|(one, stamp)| one.translator.made_from(origin.message_type, stamp));
        own.unwrap_or_else(|| ed25::named(origin.message_type))
    }

    /// Clears the VSM's own answers that have expired.
    pub(crate) fn clear_answers(&mut self) {
        while let Some((to, raised)) = self.alerts.next_over(self.now.mono) {
            self.show(self.vsm, &to, &raised);
        }
    }

    /// A line of the log.
    pub(crate) fn note(&mut self, level: LogLevel, about: Id, text: String) {
        if self.log.len() < MAX_LOGGED {
            self.log.push_back(LogEntry { level, about, text });
        } else {
            self.counters.count("too many lines of the log at once");
        }
    }
}

impl Effects<'_> {
    /// The stamp of a message made now.
    pub(crate) fn stamp(&mut self) -> TimeStamp {
        self.dli.stamp()
    }

    /// The stamp of a report to one station: when it was measured, where it is one of measurements.
    pub(crate) fn stamp_measured(
        &mut self,
        station: usize,
        message: u16,
        at: Option<Duration>,
    ) -> TimeStamp {
        let there = self.dli.stations.get(station);
        match there.zip(at) {
            Some((there, at)) => {
                let series = (self.dli.logical.shown_as(self.id), there.id(), message);
                self.dli.outbox.stamp_measured(self.dli.now, at, series)
            }
            None => self.stamp(),
        }
    }

    /// Sends to one station.
    pub(crate) fn send(&mut self, station: usize, message: &Message) {
        self.dli.send(station, self.id, message);
    }

    /// Sends a report to one station, and to the group.
    pub(crate) fn publish(&mut self, station: usize, message: &Message) {
        self.dli.publish(station, self.id, message);
    }

    /// Sends a report to every station that holds LOI 2.
    pub(crate) fn publish_to_listeners(&mut self, message: &Message) {
        for station in self.listeners.iter() {
            self.dli.publish(*station, self.id, message);
        }
    }

    /// Answers with 17000 where one was requested.
    pub(crate) fn acknowledge(&mut self, origin: &Origin, answer: AckType) {
        if !self.answer_held(origin, answer, None) {
            self.dli.acknowledge(self.id, origin, answer);
        }
    }

    /// Passes the answer of a held command to the held machine, which answers its 50020. Returns false for other commands.
    fn answer_held(&mut self, origin: &Origin, answer: AckType, why: Option<&str>) -> bool {
        let Some(HeldOrigin { serial, .. }) = origin.held else {
            return false;
        };
        let why = why.map(str::to_owned);
        self.request(Request::HeldEnded {
            serial,
            answer,
            why,
        });
        true
    }

    /// Refuses a command: 17000 if requested, and 16000 with the reason to its sender. The reason for a command of the VSM
    /// itself is sent to all listening stations.
    pub(crate) fn refuse(&mut self, origin: Option<Origin>, why: impl Into<String>) {
        let why = why.into();
        match origin {
            Some(origin) if self.answer_held(&origin, AckType::Refused, Some(&why)) => {}
            Some(origin) => {
                self.acknowledge(&origin, AckType::Refused);
                let text = format!("{} refused: {why}", self.dli.named(&origin));
                self.explain_refusal(origin.station, text);
            }
            None => {
                let to = self.listeners.clone();
                self.answer(&to, why);
            }
        }
    }

    /// Refuses a message that any listed CUCS may send, with or without rights. Only some of many similar ones are answered
    /// with the reason, since a station may send them without limit.
    pub(crate) fn refuse_unprivileged(&mut self, origin: &Origin, why: &str) {
        if self.answer_held(origin, AckType::Refused, Some(why)) {
            return;
        }
        self.acknowledge(origin, AckType::Refused);
        let Some(station) = self.dli.stations.get(origin.station) else {
            return;
        };
        let message = self.dli.named(origin);
        let text = format!("{message} of {} refused: {why}", station.id());
        self.answer_sometimes(&[origin.station], text);
    }

    /// As [`Effects::answer`], for the reason why a message is refused whose acknowledgement the caller returns: in a storm of
    /// refusals only some are sent.
    pub(crate) fn explain_refusal(&mut self, station: usize, text: String) {
        let to = [station];
        let raised = self.alerts.refusal(self.dli.now.mono, &to, text);
        self.dli.alert(self.id, &to, raised);
    }

    /// As [`Effects::answer`], for what has become of a handover.
    pub(crate) fn explain_handover(&mut self, to: &[usize], text: String) {
        let raised = self.alerts.handover(self.dli.now.mono, to, text);
        self.dli.alert(self.id, to, raised);
    }

    /// As [`Effects::answer`], but rate-limited for similar ones.
    pub(crate) fn answer_sometimes(&mut self, to: &[usize], text: String) {
        let raised = self.alerts.answer_sometimes(self.dli.now.mono, to, text);
        self.dli.alert(self.id, to, raised);
    }

    /// 16000 to these stations only: the answer to one message, cleared after a while.
    pub(crate) fn answer(&mut self, to: &[usize], text: String) {
        let raised = self.alerts.answer(self.dli.now.mono, to, text);
        self.dli.alert(self.id, to, Some(raised));
    }

    /// Raises an alert that is active until it is cleared, or changes its text.
    pub(crate) fn raise(
        &mut self,
        cause: Cause,
        priority: AlertPriority,
        subsystem: SubsystemId,
        text: impl Into<String>,
    ) {
        let raised = self.alerts.raise(cause, priority, subsystem, text.into());
        self.show(raised);
    }

    /// Clears an alert, if it is active.
    pub(crate) fn clear(&mut self, cause: Cause, text: &str) {
        let raised = self.alerts.clear(cause, text);
        self.show(raised);
    }

    /// Sends a begun, changed or ended alert, now or once the rate limit allows it.
    fn show(&mut self, raised: Option<Raised>) {
        let now = self.dli.now.mono;
        let raised = raised.and_then(|raised| self.alerts.paced(now, raised));
        self.dli.alert(self.id, self.listeners, raised);
    }

    /// Sends delayed alerts that the rate limit now allows.
    pub(crate) fn show_late(&mut self) {
        while let Some(raised) = self.alerts.next_late(self.dli.now.mono) {
            self.dli.alert(self.id, self.listeners, Some(raised));
        }
    }

    /// Alerts of a one-time event.
    pub(crate) fn notify(
        &mut self,
        priority: AlertPriority,
        subsystem: SubsystemId,
        text: impl Into<String>,
    ) {
        let now = self.dli.now.mono;
        let raised = self.alerts.notice(now, priority, subsystem, text.into());
        self.dli.alert(self.id, self.listeners, raised);
    }

    /// Something that operators should know.
    pub(crate) fn advise(&mut self, text: impl Into<String>) {
        self.notify(AlertPriority::Nominal, SubsystemId::VsmStatus, text);
    }

    /// Notifies once that altitude type 2 is flown as height above home.
    pub(crate) fn advise_agl(&mut self) {
        if self.alerts.first_agl() {
            self.advise("altitude type 2 (AGL) is flown as height above home");
        }
    }

    /// Raises a warning of the VSM.
    pub(crate) fn warn(&mut self, cause: Cause, text: impl Into<String>) {
        self.raise(cause, AlertPriority::Warning, SubsystemId::VsmStatus, text);
    }

    /// Warns once of something on the vehicle's side.
    pub(crate) fn warn_of_link(&mut self, text: impl Into<String>) {
        self.notify(AlertPriority::Warning, SubsystemId::Comms, text);
    }

    /// A line of the log about the vehicle.
    pub(crate) fn note(&mut self, level: LogLevel, text: impl Into<String>) {
        self.dli.note(level, self.id, text.into());
    }

    /// Answers from here on in this call depend on a change of the disk that an earlier call has queued.
    pub(crate) fn answer_after(&mut self, changes: Changes) {
        self.dli.outbox.answer_after = changes;
    }

    /// Whether answers sent now wait for the disk.
    pub(crate) fn answers_later(&self) -> bool {
        self.dli.waits_for().is_some()
    }

    /// The disk. Records are stored as durably as their type requires: when the call returns, or once the disk has completed
    /// its queue.
    pub(crate) fn disk(&mut self) -> &mut dyn Disk {
        self.dli.disk
    }

    /// Sends a request to a sibling, delivered after this call.
    pub(crate) fn request(&mut self, request: Request) {
        self.requests.push_back(request);
    }
}

const MAX_LOGGED: usize = 1_024;
/// Reports that are sent when something has changed and not repeated.
const SENT_ONCE: [u16; 4] = [
    VehicleId::ID,
    FlightTerminationModeReport::ID,
    HeldCommandState::ID,
    Contingency::ID,
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::session::testing::World;

    #[test]
    fn lines_of_the_log_that_find_no_room_are_counted() {
        let mut world = World::new();
        world.act(|_, _, effects| {
            for n in 0..MAX_LOGGED + 3 {
                effects.note(LogLevel::Info, n.to_string());
            }
        });
        assert_eq!(world.log.len(), MAX_LOGGED);
        assert_eq!(world.counters.get("too many lines of the log at once"), 3);
    }
}
