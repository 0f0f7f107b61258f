//! What a machine may do: send, acknowledge, alert, command the vehicle, persist, and ask a sibling through the router.
//!
//! Nothing can be read back through it but whether an effect was possible. Two rules hold for every machine, because
//! they are kept here and nowhere else:
//!
//! - **Persist, then answer.** [`Effects::disk`] writes before it returns, or queues the change: what a machine sends
//!   after that in the same call, and every acknowledgement of it, is held until the change is durable
//!   ([`DliEffects::release`]). A message only joins the queue of the bridge, and the shell takes it from there after
//!   the call: no answer can leave before what it promises is stored.
//! - **A request to a sibling is carried out after the call**, by the router, in the order of the requests: a machine
//!   never finds itself called again in the middle of a change.

use std::collections::VecDeque;
use std::time::Duration;

use mapping::alert;
use mavlink_link::Now;
use mavlink_link::store::{Changes, Disk, Progress, StoreError};
use stanag_msgs::enums::{AckType, AlertPriority, RouteType, SubsystemId};
use stanag_msgs::messages::{MessageAcknowledgement, VehicleOperatingModeCommand};
use stanag_msgs::{Id, Message, TimeStamp, ed25};

use super::alerts::{Alerts, Cause, Raised};
use super::context::Origin;
use super::counters::Counters;
use super::duplicates::Remembered;
use super::link::services::Services;
use super::log::{LogEntry, LogLevel};
use super::outbox::{Datagram, Destination, Instance, Outbox, Waiting};
use super::paths::{Kind, Paths, Verdict};
use super::station::GroundStation;

/// What a machine of one vehicle may do. Borrowed for one call.
pub(crate) struct Effects<'a> {
    pub(crate) dli: DliEffects<'a>,
    /// The vehicle in whose name is answered.
    pub(crate) id: Id,
    pub(crate) alerts: &'a mut Alerts,
    /// The stations that hold LOI 2; written by the authority machine alone.
    pub(crate) listeners: &'a mut Vec<usize>,
    /// What is asked of the vehicle.
    pub(crate) vehicle: &'a mut Services,
    pub(crate) requests: &'a mut VecDeque<Request>,
}

/// What goes to the DLI side, to the log and to the disk: the same for all vehicles of a bridge.
pub(crate) struct DliEffects<'a> {
    pub(crate) now: Now,
    pub(crate) vsm: Id,
    pub(crate) multicast: bool,
    pub(crate) stations: &'a [GroundStation],
    /// Vehicles that are not there yet, each with the logical id that stands for it.
    pub(crate) logical: &'a [(Id, Id)],
    /// What each station has sent lately, and what it was answered.
    pub(crate) remembered: &'a mut [Remembered],
    /// Alerts of the VSM itself, not of a vehicle.
    pub(crate) alerts: &'a mut Alerts,
    pub(crate) outbox: &'a mut Outbox,
    /// How much each station may be sent.
    pub(crate) paths: &'a mut Paths,
    pub(crate) counters: &'a mut Counters,
    pub(crate) log: &'a mut VecDeque<LogEntry>,
    pub(crate) disk: &'a mut dyn Disk,
    /// The station whose message is being handled.
    pub(crate) asker: Option<usize>,
    /// The last change that the disk had queued when this began: what is sent after another waits for that.
    pub(crate) mark: u64,
}

/// What one machine asks of another.
#[derive(Debug)]
pub(crate) enum Request {
    /// Of flight: carry out a 2016; without origin it is the VSM's own. `just_loaded`: the mission that it needs was
    /// uploaded for it.
    Fly {
        origin: Option<Origin>,
        command: Box<VehicleOperatingModeCommand>,
        just_loaded: bool,
    },
    /// Of flight: put the vehicle on hold, whatever runs (the mission watchdog).
    Hold,
    /// Of flight and link: control has passed to another CUCS, or to nobody.
    ControlChanged,
    /// Of flight: the controlling CUCS was lost, and nobody has control.
    ControllerLost,
    /// Of mission: upload a route of this type, or again what 13000 has loaded where it is `None`; then fly this.
    LoadAndFly {
        origin: Option<Origin>,
        route_type: Option<RouteType>,
        command: Box<VehicleOperatingModeCommand>,
    },
    /// Of mission: refuse the mode command that waits for its route, for this reason. `without_right`: only where its
    /// sender does not control the vehicle.
    DropWaitingCommand { why: String, without_right: bool },
    /// Of the router: carry out a command that was held until now, in the way of one that arrives. `contingency`: also for
    /// a CUCS that has lost control, where nobody has it.
    CarryOut {
        origin: Origin,
        message: Box<Message>,
        contingency: bool,
    },
    /// Of held: what a command that was held is answered, and why.
    HeldEnded {
        serial: u32,
        answer: AckType,
        why: Option<String>,
    },
    /// Of flight and mission: a flight termination is commanded, end what is flown and uploaded for it.
    YieldToTermination,
    /// Of authority: write this about a flight termination into the audit log; answered to the termination.
    Audit {
        what: &'static str,
        by: Option<Id>,
        why: String,
    },
    /// Of the termination: its entry is written, up to this change of the disk, or cannot be.
    Audited(Result<Changes, String>),
    /// Of reports and the termination: the station has begun or ceased to hold LOI 2.
    ListenerChanged { station: usize },
    /// Of reports: these configuration values have changed; `by` knows already.
    Configured {
        changed: Vec<Message>,
        by: Option<usize>,
    },
    /// Of reports: send these a few at a time, then acknowledge `origin` as carried out.
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
            // What happens once is not sent again: it waits rather than being dropped.
            Message::SubsystemStatusAlert(_) | Message::HandoverStatusReport(_) => Kind::Answer,
            _ => report,
        };
        self.deliver(station, source, message, (kind, report));
    }

    /// Sends to the address of a station, and to the group where its profile says so: addressed to the station there too,
    /// so that it can be distinguished from what is for another. `kind`: at the address, and in the group.
    fn deliver(&mut self, station: usize, source: Id, message: &Message, kind: (Kind, Kind)) {
        let Some(one) = self.stations.get(station) else {
            return;
        };
        let source = self.shown_as(source);
        let (envelope, delivery) = (one.profile.envelope(source, one.id()), one.profile.delivery);
        if let (true, Some(peer)) = (delivery.to_address(), one.peer) {
            let to = Destination::Unicast(peer);
            if let Some(datagram) = Outbox::compose(to, &one.profile, &envelope, message) {
                self.deliver_to_address(station, datagram, kind.0);
            }
        }
        if self.multicast && delivery.to_group() {
            let to = Destination::Multicast;
            if let Some(datagram) = Outbox::compose(to, &one.profile, &envelope, message)
                && self.may_go_to_group(station, &datagram, kind.1)
            {
                self.post(station, datagram);
            }
        }
    }

    /// The id in whose name a vehicle speaks.
    fn shown_as(&self, source: Id) -> Id {
        let mut logical = self.logical.iter();
        logical
            .find(|(real, _)| *real == source)
            .map_or(source, |(_, logical)| *logical)
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
            && let Some(datagram) = Datagram::of_ed25(Destination::Multicast, id, bytes)
            && self.may_go_to_group(station, &datagram, Kind::Answer)
        {
            self.post(station, datagram);
        }
    }

    /// Sends a datagram to a station, within what it may be sent.
    fn convey(&mut self, station: usize, datagram: Datagram, kind: Kind) {
        if self.held_until(station).is_some() {
            // Its allowance is looked at when it goes.
            return self.post(station, datagram);
        }
        self.admit(station, datagram, kind);
    }

    fn packs(&self, station: usize) -> bool {
        let station = self.stations.get(station);
        station.is_some_and(|one| one.profile.packs() && !one.speaks_ed25())
    }

    /// Queues a datagram for the address of a station, lets it wait for its credit, or drops it.
    fn admit(&mut self, station: usize, datagram: Datagram, kind: Kind) {
        let (now, bytes) = (self.now.mono, self.paths.bytes_of(station, &datagram));
        match self.paths.admit(now, station, bytes, kind) {
            Verdict::Send if self.packs(station) => self.outbox.pack(datagram),
            Verdict::Send => self.outbox.push(datagram),
            Verdict::Wait => self.paths.wait(now, station, datagram),
            Verdict::Drop(why) => self.counters.count(why),
        }
    }

    fn may_go_to_group(&mut self, station: usize, datagram: &Datagram, kind: Kind) -> bool {
        let (now, bytes) = (self.now.mono, self.paths.bytes_of(station, datagram));
        let may = self.paths.admit_to_group(now, station, bytes, kind);
        if !may {
            self.counters.count("group over the rate");
        }
        may
    }

    /// The change of the disk that what this station is sent now waits for.
    fn held_until(&self, station: usize) -> Option<Changes> {
        let behind = || {
            // What a station is answered keeps its order; others do not wait for what it has led to.
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

    /// The message that arrived last is to be carried out: it is on disk before that. `authorised`: its Time Stamp is
    /// used from here on. `None` where it is not logged; an error where that could not be written.
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

    /// Queues what has waited for the disk, within what may be sent to where it goes.
    fn send_held(&mut self, datagram: Datagram) {
        let Destination::Unicast(to) = datagram.to else {
            return self.outbox.push(datagram);
        };
        let mut stations = self.stations.iter();
        let id = datagram.destination();
        // Of a station that has moved since it is dropped: it will ask again.
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

    fn hold(&mut self, until: Changes, asker: Option<usize>, what: Waiting) {
        let stuck = self.disk.progress(until) == Progress::Failing;
        if !self.outbox.hold((until, stuck), asker, what) {
            self.counters.count("no room to wait for the disk");
        }
    }

    fn send_acknowledgement(&mut self, source: Id, origin: &Origin, answer: AckType) {
        // Also where no 17000 was requested: a restart must find that the command has ended.
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
        let envelope = one.profile.envelope(self.shown_as(source), one.id());
        let compose = |to| Outbox::compose(to, &one.profile, &envelope, &message);
        // It has waited for the disk where it had to: neither of the two is held again.
        if let (true, Some(peer)) = (delivery.to_address(), one.peer)
            && let Some(datagram) = compose(Destination::Unicast(peer))
        {
            self.admit(origin.station, datagram, Kind::Acknowledgement);
        }
        if self.multicast
            && delivery.to_group()
            && let Some(datagram) = compose(Destination::Multicast)
            && self.may_go_to_group(origin.station, &datagram, Kind::Acknowledgement)
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
        let text = format!("{} refused: {why}", ed25::named(origin.message_type));
        let to = [origin.station];
        let raised = self.alerts.answer_sometimes(self.now.mono, &to, text);
        self.alert(vsm, &to, raised);
    }

    /// Clears the VSM's own answers whose time is over.
    pub(crate) fn clear_answers(&mut self) {
        while let Some((to, raised)) = self.alerts.next_over(self.now.mono) {
            self.show(self.vsm, &to, &raised);
        }
    }

    /// A line of the log.
    pub(crate) fn note(&mut self, level: LogLevel, about: Id, text: String) {
        if self.log.len() < MAX_LOGGED {
            self.log.push_back(LogEntry { level, about, text });
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
                let series = (self.dli.shown_as(self.id), there.id(), message);
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

    /// What a held command is answered goes to the machine that held it, which answers its 50020. False of other commands.
    fn answer_held(&mut self, origin: &Origin, answer: AckType, why: Option<&str>) -> bool {
        let Some(serial) = origin.held else {
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

    /// Refuses a command: 17000 where it was requested, 16000 with the reason to its sender. The reason of a command of
    /// the VSM itself goes to all who listen.
    pub(crate) fn refuse(&mut self, origin: Option<Origin>, why: impl Into<String>) {
        let why = why.into();
        match origin {
            Some(origin) if self.answer_held(&origin, AckType::Refused, Some(&why)) => {}
            Some(origin) => {
                self.acknowledge(&origin, AckType::Refused);
                let text = format!("{} refused: {why}", ed25::named(origin.message_type));
                let to = [origin.station];
                let raised = self.alerts.refusal(self.dli.now.mono, &to, text);
                self.dli.alert(self.id, &to, raised);
            }
            None => {
                let to = self.listeners.clone();
                self.answer(&to, why);
            }
        }
    }

    /// Refuses a message that any listed CUCS may send, with any right or none. Of many that are alike only some are
    /// answered with the reason, since nothing keeps a station from sending them.
    pub(crate) fn refuse_unprivileged(&mut self, origin: &Origin, why: &str) {
        if self.answer_held(origin, AckType::Refused, Some(why)) {
            return;
        }
        self.acknowledge(origin, AckType::Refused);
        let Some(station) = self.dli.stations.get(origin.station) else {
            return;
        };
        let message = ed25::named(origin.message_type);
        let text = format!("{message} of {} refused: {why}", station.id());
        self.answer_sometimes(&[origin.station], text);
    }

    /// As [`Effects::answer`], but only now and then of many that are alike.
    pub(crate) fn answer_sometimes(&mut self, to: &[usize], text: String) {
        let raised = self.alerts.answer_sometimes(self.dli.now.mono, to, text);
        self.dli.alert(self.id, to, raised);
    }

    /// 16000 to these stations only: the answer to one message, cleared after a while.
    pub(crate) fn answer(&mut self, to: &[usize], text: String) {
        let raised = self.alerts.answer(self.dli.now.mono, to, text);
        self.dli.alert(self.id, to, Some(raised));
    }

    /// Raises an alert that stands until it is cleared, or changes its text.
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

    /// Clears an alert, where it stands.
    pub(crate) fn clear(&mut self, cause: Cause, text: &str) {
        let raised = self.alerts.clear(cause, text);
        self.show(raised);
    }

    /// Sends what has begun, changed or ended, now or once it may.
    fn show(&mut self, raised: Option<Raised>) {
        let now = self.dli.now.mono;
        let raised = raised.and_then(|raised| self.alerts.paced(now, raised));
        self.dli.alert(self.id, self.listeners, raised);
    }

    /// Sends what of that has waited long enough.
    pub(crate) fn show_late(&mut self) {
        while let Some(raised) = self.alerts.next_late(self.dli.now.mono) {
            self.dli.alert(self.id, self.listeners, Some(raised));
        }
    }

    /// Alerts of something that happened once.
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

    /// What is answered from here on in this call depends on a change of the disk that an earlier call has queued.
    pub(crate) fn answer_after(&mut self, changes: Changes) {
        self.dli.outbox.answer_after = changes;
    }

    /// Whether what is answered now waits for the disk.
    pub(crate) fn answers_later(&self) -> bool {
        self.dli.waits_for().is_some()
    }

    /// Where records are stored, as durable as the record asks for: when the call returns, or once the disk has done
    /// what it queued.
    pub(crate) fn disk(&mut self) -> &mut dyn Disk {
        self.dli.disk
    }

    /// Asks a sibling, after this call.
    pub(crate) fn request(&mut self, request: Request) {
        self.requests.push_back(request);
    }
}

const MAX_LOGGED: usize = 1_024;
