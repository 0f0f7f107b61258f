//! Translates for stations of Edition 2.5, between codec and session: their messages become messages of Edition 4, and
//! messages for them become messages of Edition 2.5. Sessions, authority and mapping know only one edition.
//!
//! Each station has a [`Translator`]. It has no clock and decides nothing about rights: its messages are subject to the
//! same rules of addresses, time stamps, duplicates and levels of interoperability as all others.
//!
//! Most messages are converted field by field, by the places that the table of Edition 2.5 names for Edition 4
//! ([`Record`]). Written by hand are those whose form differs:
//!
//! - [`steering`]: the mode (#42), the demands (#43), the loiter (#41) and which of them rules (#48) become one 2016.
//! - [`plans`]: the contingency waypoints of #802 are contingency routes in Edition 4.
//! - [`recorder`]: #205, #306 and #307 are the video recorder of a station's camera.
//! - [`requests`]: #1401 and #1400, which name a message by its instance; messages and fields that are named by their
//!   numbers (#1200, #1402, #1403, and the answers #1300 to #1303).
//!
//! All fields of Edition 2.5 are always sent. So that a filler value commands nothing, the text of the standard decides
//! which fields count. In reports, a value that the aircraft has not reported again keeps its last value, and a message
//! that would have to state something unknown is not sent until it is known ([`ESSENTIAL`]).

mod form;
pub(crate) mod plans;
mod recorder;
pub(crate) mod requests;
pub(crate) mod steering;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use mapping::plan::Plan;
use stanag_msgs::ed25::record::{is_moment, stamp_of};
use stanag_msgs::ed25::{self, Parties, Record, Version};
use stanag_msgs::enums::{EoirSystemMode, FlightPathControlMode, LoiBitmap};
use stanag_msgs::messages::{CucsAuthorisationRequest, EoIrLaserOperatingState};
use stanag_msgs::table::Direction;
use stanag_msgs::wrapper::{Envelope, MAX_DATAGRAM};
use stanag_msgs::{Id, Message, TimeStamp};

pub(crate) use self::form::{Refusal, Standing};
use self::form::{generic, new, to};
use self::plans::Plans;
pub(crate) use self::plans::{Contingencies, Kept, Unfit, Upload};
use self::recorder::Recorders;
use self::requests::Requests;
use self::steering::{Latch, Steering};

/// The state of one station of Edition 2.5, as far as later messages depend on it.
#[derive(Debug, Default)]
pub(crate) struct Translator {
    /// The version number that it uses for the edition.
    version: Option<Version>,
    /// The identification number of this VSM, for messages that name it where Edition 4 does not.
    vsm: Option<Id>,
    requests: Requests,
    recorders: Recorders,
    steering: BTreeMap<Id, Steering>,
    plans: BTreeMap<Id, Plans>,
    /// The last values of each report, by vehicle, message and engine.
    reports: BTreeMap<(Id, u16, u32), Record>,
    /// The last translated datagram and its result: one for a station is sent to the group as well.
    last: Option<(Vec<u8>, Vec<Vec<u8>>)>,
    /// Number of cautions that the translator itself has sent.
    cautions: u32,
    /// The last used Message Instance ID, if any.
    instance: Option<u32>,
    /// The approximate present time, ms since 1970: it resolves the period of Edition 4 stamps.
    about_ms: u64,
    /// Alerts whose text took several messages, with the number of messages.
    parts: BTreeMap<(Id, u32), u8>,
}

/// The translation of a message of Edition 2.5.
#[derive(Debug, Default)]
pub(crate) struct Inbound {
    /// Messages, in order, each with its envelope.
    pub(crate) messages: Vec<(Envelope, Message)>,
    /// Answers of the translator itself, as datagrams.
    pub(crate) replies: Vec<Vec<u8>>,
    /// What was ignored, for the operator.
    pub(crate) notices: Vec<String>,
    /// The last of them is a mode that has the values of the demand just before it.
    pub(crate) takes_demand: bool,
    /// The change of the translator's state once the last of the messages is accepted.
    pub(crate) latch: Option<(Id, Latch)>,
    /// A waypoint of a plan, whose contingencies are known once it is stored.
    pub(crate) waypoint: Option<Contingencies>,
    /// It requests a download.
    pub(crate) downloads: bool,
    /// It requests a load that is refused.
    pub(crate) unfit: Option<Unfit>,
}

/// What of Edition 2.5 a message of Edition 4 was made from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MadeOf {
    /// The message.
    pub(crate) number: u16,
    /// See [`Inbound::takes_demand`].
    pub(crate) takes_demand: bool,
}

/// The stamp of our heartbeat that a #1400 answers: a station that returns it has received our message at this address.
pub(crate) fn proof(frame: &ed25::Frame<'_>) -> Option<TimeStamp> {
    let info = ed25::message(frame.header.message_type, frame.header.version)
        .filter(|info| info.id == ACKNOWLEDGEMENT)?;
    let answer = Record::read(info, frame.data).ok()?;
    (answer.whole(8) == u32::from(REQUEST)).then(|| answer.number(6).and_then(stamp_of))?
}

/// The Time Stamp of a message, also of one that is refused.
pub(crate) fn stamp(frame: &ed25::Frame<'_>) -> Option<TimeStamp> {
    let bytes = frame.data.first_chunk()?;
    stamp_of(f64::from_be_bytes(*bytes))
}

impl Translator {
    /// The version number that the station uses for the edition.
    pub(crate) fn version(&self) -> Version {
        self.version.unwrap_or(Version::Ed25)
    }

    /// Restores that version number after a restart.
    pub(crate) fn call_it(&mut self, version: Version) {
        self.version = Some(version);
    }

    /// Sets the approximate present time, ms since 1970.
    pub(crate) fn keep_time(&mut self, about_ms: u64) {
        self.about_ms = about_ms;
    }

    /// Takes a message of the station.
    ///
    /// # Errors
    /// It is refused: the name of its counter, and why.
    pub(crate) fn inbound(
        &mut self,
        frame: &ed25::Frame<'_>,
        at: &Parties,
        standing: &Standing<'_>,
        upload: &Upload<'_>,
    ) -> Result<Inbound, Refusal> {
        let message_type = frame.header.message_type;
        let Some(info) = at.info else {
            let known = ed25::message(message_type, frame.header.version);
            return Err(match known {
                Some(info) => Refusal::new(
                    "bad length",
                    format!(
                        "{} bytes of data, expected {}",
                        frame.data.len(),
                        info.full_bytes()
                    ),
                ),
                None => Refusal::new("unknown message type", "no message of Edition 2.5"),
            });
        };
        if info.direction == Direction::ToCucs {
            return Err(Refusal::new(
                "wrong direction",
                "message is VSM to CUCS only",
            ));
        }
        let record = Record::read(info, frame.data)?;
        if record.number(1).is_none() {
            return Err(Refusal::new(
                "no time stamp",
                "Time Stamp is no moment: expected seconds since 1970, from 2000 on",
            ));
        }
        self.version = Some(frame.header.version);
        self.vsm = Some(standing.vsm);
        let instance = frame.header.instance;
        let mut taken = Inbound::default();
        self.take(&record, at, standing, upload, &mut taken)?;
        let acknowledged = self.requests.acknowledges(info.id);
        let Some((last, message)) = taken.messages.last_mut() else {
            // Nothing is passed on, so no machine will acknowledge it: it is acknowledged here.
            if acknowledged {
                let answer = requests::acknowledgement(&record, instance, standing);
                taken
                    .replies
                    .push(self.datagram(&answer, standing.named, at.cucs));
            }
            return Ok(taken);
        };
        last.ack_requested = acknowledged;
        self.requests.sent(message.id(), &record, instance);
        Ok(taken)
    }

    /// The messages of Edition 4 for a record, by its type.
    fn take(
        &mut self,
        record: &Record,
        at: &Parties,
        standing: &Standing<'_>,
        upload: &Upload<'_>,
        taken: &mut Inbound,
    ) -> Result<(), Refusal> {
        let envelope = Envelope::new(at.cucs, at.vehicle);
        let vehicle = at.vehicle;
        let message = match record.id() {
            1 => Some(authorisation(record, at)?),
            41..=43 | 48 => {
                let steering = self.steering.entry(vehicle).or_default();
                let order = steering.order(record)?;
                taken.notices.extend(order.notice);
                taken.takes_demand = order.takes_demand;
                taken.latch = Some((vehicle, order.latch));
                Some(order.message)
            }
            205 => {
                let (message, notice) = recorder::command(record)?;
                taken.notices.extend(notice);
                Some(message)
            }
            800..=806 => {
                let plans = self.plans.entry(vehicle).or_default();
                let messages = plans.received(record, upload)?;
                let all = messages.into_iter().map(|message| (envelope, message));
                taken.messages.extend(all);
                taken.waypoint = Contingencies::of(record);
                taken.downloads = plans::downloads(record);
                taken.unfit = plans.unfit(record, upload);
                None
            }
            ACKNOWLEDGEMENT => None,
            1401 => {
                self.requests.configure(record)?;
                None
            }
            1402 => Some(requests::schedule(record)?),
            REQUEST => match record.whole(7) {
                MODE_PREFERENCE_REPORT => {
                    let (named, stamp) = (standing.named, standing.stamp);
                    let report = self.preference_report(vehicle, named, at.cucs, stamp);
                    taken.replies.push(report);
                    None
                }
                number if recorder::is_of_recorder(number) => {
                    self.recorders.request(vehicle, number as u16);
                    let mut state = record.clone();
                    state.set(7, recorder::SENSOR_STATE);
                    Some(requests::report(&state)?)
                }
                _ => Some(requests::report(record)?),
            },
            1200 => match self.requests.configuration(record)? {
                Some(message) => Some(message),
                None => {
                    for answer in requests::unavailable(record, standing) {
                        taken
                            .replies
                            .push(self.datagram(&answer, standing.named, at.cucs));
                    }
                    None
                }
            },
            // Units and windows of remote displays: this VSM has no display but its status page.
            1201 => None,
            1202 => {
                let services = requests::services(standing);
                taken
                    .replies
                    .push(self.datagram(&services, standing.named, at.cucs));
                None
            }
            600 => {
                // 4.1.4.2.1 does not say whether this is a point in time or a duration: Edition 4 has the point in time.
                let mut record = record.clone();
                if !record.number(12).is_some_and(is_moment) {
                    record.clear(12);
                }
                Some(generic(&record)?)
            }
            _ => Some(generic(record)?),
        };
        taken
            .messages
            .extend(message.map(|message| (envelope, message)));
        Ok(())
    }

    /// The messages made from the last one were accepted: its content applies from now on, if its sender has these levels.
    /// `refused`: for what it commands.
    pub(crate) fn accept(
        &mut self,
        (vehicle, latch): (Id, Latch),
        levels: LoiBitmap,
        refused: bool,
    ) -> bool {
        let controls = levels.intersects(LoiBitmap::LOI4.union(LoiBitmap::LOI5));
        let steering = self.steering.entry(vehicle).or_default();
        controls && steering.accept(latch, refused)
    }

    /// The plan of a vehicle holds this waypoint. Returns what has to be written about it.
    pub(crate) fn stored(
        &mut self,
        vehicle: Id,
        waypoint: Contingencies,
        holds: impl Fn(u16) -> bool,
    ) -> Option<Kept> {
        self.plans
            .entry(vehicle)
            .or_default()
            .stored(waypoint, holds)
    }

    /// Restores what an earlier process has written about the contingencies of a vehicle's waypoints.
    pub(crate) fn restore(&mut self, vehicle: Id, text: &str) {
        self.plans.entry(vehicle).or_default().restore(text);
    }

    /// Whether any message of a vehicle's plan has been received since the start.
    pub(crate) fn has_plan(&self, vehicle: Id) -> bool {
        self.plans.contains_key(&vehicle)
    }

    /// A download of a vehicle's plan begins.
    pub(crate) fn begin_download(&mut self, vehicle: Id, plan: &Plan) {
        self.plans.entry(vehicle).or_default().begin_download(plan);
    }

    /// The present mode of a vehicle, and whether it is on the ground. The report that is sent may be late, or dropped.
    pub(crate) fn shows(&mut self, vehicle: Id, mode: FlightPathControlMode, stands: bool) {
        let steering = self.steering.entry(vehicle).or_default();
        steering.shows(Some(mode.raw()));
        steering.stands(stands);
    }

    /// The station's own message, by number and name, if this one of Edition 4 was made from it.
    pub(crate) fn made_from(&self, ed4: u16, stamp: TimeStamp) -> Option<String> {
        let number = self.requests.made_from(ed4, stamp)?;
        let mut all = ed25::messages();
        let info = all.find(|info| info.id == number)?;
        Some(format!("#{number} ({})", info.name))
    }

    /// #109 of a vehicle, under the id `named`, as a datagram.
    pub(crate) fn preference_report(
        &mut self,
        vehicle: Id,
        named: Id,
        cucs: Id,
        stamp: TimeStamp,
    ) -> Vec<u8> {
        let report = self.preference(vehicle, stamp);
        self.datagram(&report, named, cucs)
    }

    fn preference(&self, vehicle: Id, stamp: TimeStamp) -> Record {
        let modes = self.steering.get(&vehicle).map(Steering::preference);
        let mut report = new(109);
        report.set_stamp(stamp);
        for (field, mode) in (4..).zip(modes.unwrap_or_default()) {
            report.set(field, mode);
        }
        report
    }

    /// Translates a message for this station: to no datagram, one or several. `of`: the vehicle that sends it, perhaps
    /// under a logical id.
    pub(crate) fn outbound(
        &mut self,
        envelope: &Envelope,
        of: Id,
        message: &Message,
    ) -> Vec<Vec<u8>> {
        let mut whole = [0; MAX_DATAGRAM];
        let length = message.encode(envelope, &mut whole).unwrap_or(0);
        let bytes = whole.get(..length).unwrap_or_default();
        if let Some((last, became)) = &self.last
            && last == bytes
        {
            return became.clone();
        }
        let became = self.translate(envelope, of, message);
        self.last = Some((bytes.to_vec(), became.clone()));
        became
    }

    fn translate(&mut self, envelope: &Envelope, of: Id, message: &Message) -> Vec<Vec<u8>> {
        let (vehicle, cucs) = (envelope.source, envelope.destination);
        let mut record = Record::of(message);
        record.move_times_near(self.about_ms);
        let mut before = Vec::new();
        self.note(of, message, &mut before);
        match message {
            // Group copies of others and pushed heartbeats have no counterpart; one that requests an acknowledgement
            // challenges the station's address.
            Message::Heartbeat(_) if envelope.ack_requested => {
                return vec![self.question(&record, vehicle, cucs)];
            }
            Message::MessageAcknowledgement(answer) => {
                let answer = self.requests.acknowledge(answer, vehicle);
                before.extend(answer);
                return self.datagrams(&before, vehicle, cucs);
            }
            Message::SubsystemStatusAlert(alert) => {
                let text = alert.text.as_ref().map_or("", |text| text.as_str());
                record.set_text(12, self.requests.in_own_numbers(text));
                let records = self.alert(&record, of);
                return self.datagrams(&records, vehicle, cucs);
            }
            Message::UaRoute(_)
            | Message::UaPositionWaypoint(_)
            | Message::UaLoiterWaypoint(_)
            | Message::PayloadActionWaypoint(_)
            | Message::VehicleSpecificWaypoint(_) => {
                let plans = self.plans.entry(of).or_default();
                match plans.sent(message) {
                    Ok(Some(mut part)) => {
                        part.move_times_near(self.about_ms);
                        before.push(part);
                    }
                    Ok(None) => {}
                    Err(what) => {
                        let caution = self.caution(&record, &what);
                        before.push(caution);
                    }
                }
                return self.datagrams(&before, vehicle, cucs);
            }
            Message::CurveSegment(_) | Message::CurveSegmentPaper(_) => {
                let caution = self.caution(
                    &record,
                    "the plan has curved legs, which Edition 2.5 cannot name",
                );
                before.push(caution);
                return self.datagrams(&before, vehicle, cucs);
            }
            _ => {}
        }
        if let Some(answers) = self.requests.answers(&record) {
            before.extend(answers);
            return self.datagrams(&before, vehicle, cucs);
        }
        for number in ed25::reports_of(record.id()) {
            before.extend(self.report(number, &record, of));
        }
        if record.id() == EoIrLaserOperatingState::ID {
            before.extend(self.recorders.answers(of, &record));
        }
        self.datagrams(&before, vehicle, cucs)
    }

    /// #1100. Edition 2.5 cannot append to a text: each part of a long one is an alert with a number of its own, and all of
    /// them are cleared with the first.
    fn alert(&mut self, ed4: &Record, vehicle: Id) -> Vec<Record> {
        let mut record = new(1100);
        record.take_from(ed4);
        let number = ed4.number(11).unwrap_or_default();
        let id = number.abs() as u32;
        let numbered = |mut record: Record, part: u8| {
            let apart = f64::from(part.saturating_sub(1).min(MAX_PARTS)) * PART_NUMBERS;
            record.set(8, number + apart.copysign(number));
            record
        };
        if ed4.whole(3) == CLEARED {
            let parts = self.parts.remove(&(vehicle, id)).unwrap_or(1);
            return (1..=parts)
                .map(|part| numbered(record.clone(), part))
                .collect();
        }
        let part = ed4.number(16).map_or(1, |order| order as u8);
        if part > 1 && (self.parts.len() < MAX_ALERTS || self.parts.contains_key(&(vehicle, id))) {
            self.parts.insert((vehicle, id), part);
        }
        vec![numbered(record, part)]
    }

    /// Notes what the decision about later messages depends on.
    fn note(&mut self, vehicle: Id, message: &Message, out: &mut Vec<Record>) {
        match message {
            Message::VsmAuthorisationResponse(response) => {
                let granted = response.loi_granted.unwrap_or(LoiBitmap::NONE);
                if granted.is_empty() {
                    self.requests.lapse();
                }
                let steering = self.steering.entry(vehicle).or_default();
                steering.granted(granted);
            }
            Message::VehicleOperatingModeReport(report) => {
                let mode = report.select_flight_path_control_mode;
                let steering = self.steering.entry(vehicle).or_default();
                steering.shows(mode.map(|mode| mode.raw()));
            }
            Message::InertialStates(states) => {
                let place = states.latitude.zip(states.longitude);
                if let (Some((latitude, longitude)), Some(stamp)) = (place, states.time_stamp) {
                    let steering = self.steering.entry(vehicle).or_default();
                    if steering.is_at(latitude.radians(), longitude.radians()) {
                        out.push(self.preference(vehicle, stamp));
                    }
                }
            }
            Message::FromToNextWaypointStates(states) => {
                let steering = self.steering.entry(vehicle).or_default();
                let reached = steering.flies_to(states.to_waypoint_number);
                if let (true, Some(stamp)) = (reached, states.time_stamp) {
                    out.push(self.preference(vehicle, stamp));
                }
            }
            _ => {}
        }
    }

    /// A report by its row; `None` while a required value is not known.
    fn report(&mut self, number: u16, ed4: &Record, vehicle: Id) -> Option<Record> {
        let empty = Record::ed25(number)?;
        let engine = if number == ENGINE { ed4.whole(2) } else { 0 };
        let key = (vehicle, number, engine);
        let keeps = (100..=110).contains(&number) || number == 20;
        let mut record = match self.reports.get(&key) {
            Some(known) if keeps => known.clone(),
            _ => empty,
        };
        for (_, field) in RESET.iter().filter(|(of, _)| *of == number) {
            record.set(*field, 0);
        }
        // Required values must be known now: an old position with a new stamp would be false.
        for (_, fields) in ESSENTIAL.iter().filter(|(of, _)| *of == number) {
            for field in *fields {
                record.clear(*field);
            }
        }
        record.take_from(ed4);
        if keeps {
            self.reports.insert(key, record.clone());
        }
        let mut essential = ESSENTIAL.iter().filter(|(of, _)| *of == number);
        let known =
            essential.all(|(_, fields)| fields.iter().all(|field| record.number(*field).is_some()));
        // A stowed sensor has no direction; for any other one, missing angles would be false ones.
        let aims = number != SENSOR_STATE
            || record.number(6) == Some(f64::from(EoirSystemMode::Stow.raw()))
            || [10, 12].iter().all(|field| record.number(*field).is_some());
        (known && aims).then_some(record)
    }

    /// The challenge of an address: a request that the station acknowledges, since the #1401 before it has just configured
    /// that.
    fn question(&mut self, heartbeat: &Record, vsm: Id, cucs: Id) -> Vec<u8> {
        let mut both = Vec::new();
        for (number, field, value) in [(1401, 6, REQUEST), (REQUEST, 7, RESOURCES)] {
            let mut record = new(number);
            record.set(1, heartbeat.number(1).unwrap_or_default());
            record.set(4, vsm.0);
            record.set(5, Id::NULL.0);
            record.set(field, value);
            both.extend(self.datagram(&record, Id::NULL, cucs));
        }
        both
    }

    /// A #1100 of the translator itself: what a station is not sent because its edition cannot express it.
    fn caution(&mut self, of: &Record, text: &str) -> Record {
        self.cautions += 1;
        let mut alert = new(1100);
        let stamp = of.number(1).unwrap_or_default();
        // 50001 has milliseconds as a float.
        let later = TimeStamp(stamp as u64).unix_ms() as f64 / 1e3;
        alert.set(1, if is_moment(stamp) { stamp } else { later });
        for (field, value) in [(4, 2.0), (5, -1.0), (6, 9.0), (7, 3.0), (10, 30.0)] {
            alert.set(field, value);
        }
        // Negative means the first instance; the range is apart from the numbers of the bridge's own alerts.
        alert.set(8, -f64::from(CAUTIONS + self.cautions % CAUTIONS));
        alert.set_text(9, text);
        alert
    }

    fn datagrams(&mut self, records: &[Record], vehicle: Id, cucs: Id) -> Vec<Vec<u8>> {
        let all = records.iter();
        all.map(|record| self.datagram(record, vehicle, cucs))
            .collect()
    }

    /// One message with its wrapper, as a datagram.
    fn datagram(&mut self, record: &Record, vehicle: Id, cucs: Id) -> Vec<u8> {
        let version = self.version();
        let mut record = record.clone();
        // 700 names the parties of a handover in its own fields 3 and 4.
        for (field, id) in [(2, vehicle), (3, cucs)] {
            if record.number(field).is_none() {
                record.set(field, id.0);
            }
        }
        if let (AVAILABILITY, None, Some(vsm)) = (record.id(), record.number(4), self.vsm) {
            record.set(4, vsm.0);
            record.set(5, Id::NULL.0);
        }
        let number = u32::from(record.id());
        let Some(info) = ed25::message(number, version) else {
            return Vec::new();
        };
        // Only our own stamp is converted: values that return something of the station stay as received.
        if let Some(stamp) = record.stamp() {
            record.set_stamp_near(stamp, self.about_ms);
        }
        let data = record.data(info);
        // Our stamps rise strictly, so their low bits distinguish the messages of a mission, also after a restart.
        let stamp = record.stamp().map_or(0, |stamp| stamp.0 as u32);
        // Several messages may be made from one. The difference is taken modulo 2^32. The first instance is its stamp: if
        // it were counted from 0, half of all clocks would begin at 1, like every other station's.
        let rises = |last: u32| stamp.wrapping_sub(last).wrapping_sub(1) < u32::MAX / 2;
        let instance = match self.instance {
            Some(last) if !rises(last) => last.wrapping_add(1),
            _ => stamp,
        };
        self.instance = Some(instance);
        let header = ed25::Header {
            version,
            instance,
            message_type: number,
        };
        let mut out = [0; MAX_DATAGRAM];
        let length = ed25::encode(&header, &data, &mut out).unwrap_or(0);
        out.get(..length).unwrap_or_default().to_vec()
    }

    /// #21 that shows the holder of a vehicle, since every station may listen to it (4.1.1.3): field 3 has the holder.
    pub(crate) fn holder(
        &mut self,
        vsm: Id,
        vehicle: Id,
        holder: Id,
        (levels, vehicle_type): (LoiBitmap, u16),
        stamp: TimeStamp,
    ) -> Vec<u8> {
        let mut record = new(21);
        // As in every #21 of this vehicle: with another type it would be another vehicle.
        record.set(10, vehicle_type);
        record.set_stamp(stamp);
        record.set(4, vsm.0);
        record.set(5, Id::NULL.0);
        record.set(6, levels.raw());
        record.set(7, levels.raw());
        record.set(9, u8::from(!levels.is_empty()));
        self.datagram(&record, vehicle, holder)
    }
}

/// #1: in a broadcast the mode is always 0 (4.1.1.1), so it releases nothing.
fn authorisation(record: &Record, at: &Parties) -> Result<Message, Refusal> {
    let mut record = record.clone();
    if at.vehicle == Id::BROADCAST {
        if record.whole(10) != 0 {
            return Err(Refusal::new(
                "out of range",
                "Controlled Station Mode of a broadcast, expected 0: request control of a single vehicle",
            ));
        }
        record.set(8, 0);
    }
    to(&record, CucsAuthorisationRequest::ID)
}

/// Messages that the translator composes or answers itself.
const ACKNOWLEDGEMENT: u16 = 1400;
const REQUEST: u16 = 1403;
/// #43, whose values belong to the mode that a #42 has commanded.
pub(crate) const DEMAND: u16 = 43;
const RESOURCES: u16 = 1202;
const ENGINE: u16 = 105;
const SENSOR_STATE: u16 = 302;
/// It names this VSM, unlike 44003.
const AVAILABILITY: u16 = 1303;
const MODE_PREFERENCE_REPORT: u32 = 109;
/// First number of the translator's cautions.
const CAUTIONS: u32 = 1_000_000_000;

/// Fields that mark other fields of a report as unused: their last value is not kept. Message and field.
const RESET: &[(u16, u8)] = &[
    (104, 19),
    (104, 20),
    (106, 4),
    (110, 10),
    (110, 16),
    (110, 22),
];

/// Values that must be known before a report is sent, since Edition 2.5 cannot leave them out: position and altitude; the
/// commanded altitude, or the present one if none was ever commanded; energy, since an unknown value would read as empty;
/// the mode of a sensor, which would read as stowed.
pub(crate) const ESSENTIAL: &[(u16, &[u8])] = &[(101, &[4, 5, 6]), (104, &[4, 16]), (302, &[6])];

/// Subsystem state of a cleared alert.
const CLEARED: u32 = 0;
/// Distance between the numbers of an alert's parts.
const PART_NUMBERS: f64 = 1e7;
const MAX_PARTS: u8 = 90;
/// Maximum number of alerts in several parts.
const MAX_ALERTS: usize = 256;
