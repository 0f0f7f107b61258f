//! Datagrams of Edition 2.5: they are admitted, counted and proven like all others, and become messages of Edition 4 only
//! if their station may send (`session::editions`). Messages to such a station are translated when they are sent.
//!
//! The edition of a datagram is known from its first byte. A station that has proven its address, or holds a right, uses
//! one edition: datagrams in its name in another edition are dropped until it has been quiet for [`EDITION_CHANGES_AFTER`].

use std::net::SocketAddr;
use std::time::Duration;

use mapping::plan::Plan;
use mavlink_link::Now;
use mavlink_link::store::Disk;
use stanag_msgs::ed25::Parties;
use stanag_msgs::enums::LoiBitmap;
use stanag_msgs::messages::Heartbeat;
use stanag_msgs::table::Direction;
use stanag_msgs::wrapper::{Header, MAX_DATAGRAM};
use stanag_msgs::{ChecksumStyle, Envelope, Id, Message, TimeStamp, ed25};

use super::arrival::drop_name;
use super::reach::Arriving;
use super::{Bridge, PAUSED};
use crate::config::Edition;
use crate::session::access::{Group, Permitted};
use crate::session::context::Origin;
use crate::session::duplicates::is_command;
use crate::session::editions::{self, Contingencies, Inbound, MadeOf, Standing, Upload};
use crate::session::outbox::{Datagram, Destination};
use crate::session::station::EDITION_CHANGES_AFTER;

impl Bridge {
    /// Takes a datagram of Edition 2.5.
    pub(super) fn handle_ed25(
        &mut self,
        now: Now,
        from: SocketAddr,
        bytes: &[u8],
        disk: &mut dyn Disk,
    ) {
        for frame in ed25::frames(bytes) {
            match frame {
                Ok(frame) => self.handle_ed25_frame(now, from, &frame, disk),
                Err(fault) => {
                    self.counters.count(drop_name(&fault));
                    self.checks
                        .evidence
                        .note_broken(now.mono, from, bytes, &fault);
                }
            }
        }
    }

    fn handle_ed25_frame(
        &mut self,
        now: Now,
        from: SocketAddr,
        frame: &ed25::Frame<'_>,
        disk: &mut dyn Disk,
    ) {
        let Some(at) = self.parties(frame) else {
            return self.counters.count("bad length");
        };
        // The wrapper does not say who sends: what VSMs send to the group names the same vehicle and CUCS.
        let sent_by_vsm = at
            .info
            .is_some_and(|info| info.direction == Direction::ToCucs);
        let place = (frame.header.message_type, frame.header.instance);
        if sent_by_vsm || self.ed25.sent_to_group.contains(&place) {
            return self.counters.count("our own");
        }
        let header = header(frame, &at);
        let made = at.info.and_then(|info| info.ed4_messages.first());
        let commands = made.is_none_or(|made| is_command(*made));
        let Some(index) = self.accept(now.mono, from, &header, Edition::Ed25, commands) else {
            return;
        };
        self.handled.asker = Some(index);
        let arriving = Arriving {
            bytes: frame.bytes,
            ed25: true,
            acknowledges: header.message_type == ED25_ACKNOWLEDGEMENT,
            answer: editions::proof(frame),
        };
        if self.is_there(now, from, index, &arriving, disk) {
            self.take_ed25(now, index, frame, disk);
        }
        self.handled.asker = None;
    }

    /// Sender and receiver of a message; a logical id stands for its vehicle.
    fn parties(&self, frame: &ed25::Frame<'_>) -> Option<Parties> {
        let at = ed25::parties(frame)?;
        Some(Parties {
            vehicle: self.logical.meant_by(at.vehicle),
            ..at
        })
    }

    /// Whether a station may speak this edition now.
    pub(super) fn may_speak(&mut self, now: Duration, index: usize, ed25: bool) -> bool {
        let station = &self.stations[index];
        let Some((before, at)) = station.spoken else {
            return true;
        };
        before == ed25
            || now.saturating_sub(at) >= EDITION_CHANGES_AFTER
            || !(station.proven || self.aircraft.has_holder(station.id()))
    }

    /// Takes a message of Edition 2.5 from its station's address.
    pub(super) fn take_ed25(
        &mut self,
        now: Now,
        index: usize,
        frame: &ed25::Frame<'_>,
        disk: &mut dyn Disk,
    ) {
        let Some(at) = self.parties(frame) else {
            return;
        };
        self.stations[index].spoken = Some((true, now.mono));
        let standing = Standing {
            vsm: self.vsm,
            named: self.logical.shown_as(at.vehicle),
            stamp: self.outbox.stamp(now),
            web_page: self.setup.settings.web_page.as_deref(),
        };
        let answered = (standing.named, standing.stamp);
        let translator = &mut self.stations[index].translator;
        translator.keep_time(self.outbox.last_stamp_ms());
        let vehicle = self.aircraft.find(at.vehicle);
        let live = vehicle.filter(|one| one.vehicle.live());
        if let Some((mode, telemetry)) = live.and_then(|one| {
            let telemetry = &one.vehicle.telemetry;
            Some((telemetry.mode?, telemetry))
        }) {
            translator.shows(at.vehicle, mode.reported(), telemetry.stands());
        }
        let none = Plan::default();
        let (plan, sent) = vehicle.map_or((&none, None), |one| one.mission.upload_of(at.cucs));
        let upload = Upload { plan, sent };
        let taken = match translator.inbound(frame, &at, &standing, &upload) {
            Ok(taken) => taken,
            Err(refusal) => {
                self.counters.count(refusal.counter);
                let origin = Origin {
                    station: index,
                    message_type: header(frame, &at).message_type,
                    stamp: editions::stamp(frame),
                    ack_requested: false,
                    held: None,
                    continues: None,
                };
                let number = frame.header.message_type;
                match at.info {
                    Some(_) => self.refuse_command(now, &origin, at.vehicle, refusal.why, disk),
                    // Nothing of it can be answered: no message of that number, or not of that length.
                    None => self.note_undecodable(now.mono, index, number, &refusal.why),
                }
                return;
            }
        };
        self.checks
            .evidence
            .note_decoded(at.cucs, frame.header.message_type);
        self.note_received(index, now.mono);
        if self.outbox.is_paused() {
            return self.counters.count(PAUSED);
        }
        let stamp = editions::stamp(frame);
        self.carry_out(now, index, (&at, stamp), taken, answered, disk);
    }

    fn carry_out(
        &mut self,
        now: Now,
        index: usize,
        (at, sent_at): (&Parties, Option<TimeStamp>),
        taken: Inbound,
        (named, stamp): (Id, TimeStamp),
        disk: &mut dyn Disk,
    ) {
        let Inbound {
            messages,
            replies,
            notices,
            takes_demand,
            latch,
            waypoint,
            downloads,
            unfit,
        } = taken;
        let vehicle = at.vehicle;
        {
            let (mut dli, aircraft) = self.effects(now, disk);
            for reply in &replies {
                dli.send_translated(index, reply);
            }
            if let Some(one) = aircraft.find_mut(vehicle) {
                for notice in notices {
                    one.effects(&mut dli).answer_sometimes(&[index], notice);
                }
            }
        }
        if let (Some(unfit), Some(one)) = (unfit, self.aircraft.find_mut(vehicle)) {
            one.mission.refuse_load((at.cucs, sent_at), unfit);
        }
        let discovers = messages
            .iter()
            .any(|(_, message)| matches!(message, Message::CucsAuthorisationRequest(_)));
        let made_of = at.info.map(|info| MadeOf {
            number: info.id,
            takes_demand,
        });
        let mut accepted = false;
        let mut refused = false;
        for (envelope, message) in messages {
            accepted = self.take_made(now, index, &envelope, &message, made_of, disk);
            let was = |stamp| self.remembered[index].was_refused(message.id(), stamp);
            refused = sent_at.is_some_and(was);
        }
        if let Some(latch) = latch.filter(|_| accepted) {
            let levels = self.levels(at.cucs, vehicle);
            let translator = &mut self.stations[index].translator;
            if translator.accept(latch, levels, refused) {
                let report = translator.preference_report(vehicle, named, at.cucs, stamp);
                self.effects(now, disk).0.send_translated(index, &report);
            }
        }
        // Also for a message that is repeated after a restart. For a station that may no longer send a plan nothing is
        // kept, since its message may be such a repetition.
        if let Some(waypoint) = waypoint
            .filter(|one| self.holds(vehicle, at.cucs, one) && self.may_plan(index, vehicle))
        {
            self.keep_contingencies(index, vehicle, waypoint, disk);
        }
        if downloads
            && accepted
            && let Some(one) = self.aircraft.find(vehicle)
        {
            let plan = one.mission.plan();
            self.stations[index]
                .translator
                .begin_download(vehicle, plan);
        }
        if discovers && accepted {
            self.show_holders_to(now, index, vehicle, disk);
        }
    }

    /// Whether a station may change its plan for a vehicle now.
    fn may_plan(&self, index: usize, vehicle: Id) -> bool {
        let (station, of) = (&self.stations[index], self.aircraft.find(vehicle));
        of.is_some_and(|one| {
            let flies = one.vehicle.may_fly();
            let listed = station.permitted(vehicle, Group::Plan, flies, false);
            let rights = one.authority.rights();
            rights.holds(station.id(), LoiBitmap::LOI4) && listed == Permitted::Yes
        })
    }

    /// Whether a waypoint is in the upload of its station.
    fn holds(&self, vehicle: Id, station: Id, waypoint: &Contingencies) -> bool {
        let of = self.aircraft.find(vehicle);
        let sent = of.and_then(|one| one.mission.upload_of(station).1);
        let held = sent.and_then(|sent| sent.waypoint(waypoint.number));
        held.is_some_and(|held| held.time_stamp == Some(waypoint.stamp))
    }

    /// Handles a message made from a datagram of Edition 2.5 like one that arrives in Edition 4.
    fn take_made(
        &mut self,
        now: Now,
        index: usize,
        envelope: &Envelope,
        message: &Message,
        made_of: Option<MadeOf>,
        disk: &mut dyn Disk,
    ) -> bool {
        let mut bytes = [0; MAX_DATAGRAM];
        let profile = self.stations[index].profile.readings.clone();
        let Ok(length) = profile.encode(message, envelope, &mut bytes) else {
            self.counters.count("undecodable");
            return false;
        };
        let made = bytes.get(..length).unwrap_or_default();
        let Some(Ok(frame)) = profile.frames(made).next() else {
            return false;
        };
        self.take_frame(now, index, &frame, made_of, disk)
    }

    /// The levels that a station holds over a vehicle.
    fn levels(&self, station: Id, vehicle: Id) -> LoiBitmap {
        let of = self.aircraft.find(vehicle);
        of.map_or(LoiBitmap::NONE, |one| {
            one.authority.rights().held(station).levels()
        })
    }

    /// Sends #21 for each other holder of the vehicles that a station asks about (4.1.1.3).
    fn show_holders_to(&mut self, now: Now, index: usize, vehicle: Id, disk: &mut dyn Disk) {
        let asker = self.stations[index].id();
        let all = self.holders();
        let asked = all.into_iter().filter(|(of, holder, _)| {
            *holder != asker && ([Id::BROADCAST, self.vsm, *of].contains(&vehicle))
        });
        for (of, holder, levels) in asked.collect::<Vec<_>>() {
            self.show_holder(now, index, (of, holder, levels), disk);
        }
    }

    fn show_holder(
        &mut self,
        now: Now,
        index: usize,
        (vehicle, holder, levels): (Id, Id, LoiBitmap),
        disk: &mut dyn Disk,
    ) {
        let (vsm, stamp) = (self.vsm, self.outbox.stamp(now));
        let named = self.logical.shown_as(vehicle);
        let of = self.aircraft.find(vehicle);
        let kind = of.map_or(0, |one| one.vehicle.vehicle_type());
        let translator = &mut self.stations[index].translator;
        translator.keep_time(self.outbox.last_stamp_ms());
        let line = translator.holder(vsm, named, holder, (levels, kind), stamp);
        self.effects(now, disk).0.send_translated(index, &line);
    }

    /// Vehicle, holder, and its levels above LOI 2.
    fn holders(&self) -> Vec<(Id, Id, LoiBitmap)> {
        let beyond = LoiBitmap::LOI3
            .union(LoiBitmap::LOI4)
            .union(LoiBitmap::LOI5);
        let each = self.aircraft.iter().flat_map(|one| {
            let holders = one.authority.rights().holders();
            holders.map(|(id, rights)| (one.id(), id, rights.levels()))
        });
        each.filter(|(_, _, levels)| levels.intersects(beyond))
            .collect()
    }

    /// Sends stations of Edition 2.5 the changed holders of vehicles: every station may receive them (4.1.1.3).
    pub(super) fn show_holders(&mut self, now: Now, disk: &mut dyn Disk) {
        let listens = |station: &&crate::session::station::GroundStation| {
            station.speaks_ed25() && !station.removed
        };
        if !self.stations.iter().any(|one| listens(&one)) {
            return;
        }
        // This runs at every datagram, whoever sends it.
        let changes = self.aircraft.changes_of_rights();
        if std::mem::replace(&mut self.ed25.shown_changes, changes) == changes {
            return;
        }
        let holders = self.holders();
        if holders == self.ed25.shown_holders {
            return;
        }
        let before = std::mem::replace(&mut self.ed25.shown_holders, holders.clone());
        let ended = before.iter().filter(|(vehicle, id, _)| {
            !holders
                .iter()
                .any(|(of, holder, _)| (of, holder) == (vehicle, id))
        });
        let ended = ended.map(|(vehicle, id, _)| (*vehicle, *id, LoiBitmap::NONE));
        let begun = holders
            .iter()
            .filter(|line| !before.contains(line))
            .copied();
        let lines: Vec<_> = ended.chain(begun).collect();
        for index in 0..self.stations.len() {
            let station = &self.stations[index];
            if !listens(&station) {
                continue;
            }
            let own = station.id();
            for line in lines.iter().filter(|(_, holder, _)| *holder != own) {
                self.show_holder(now, index, *line, disk);
            }
        }
    }

    /// The next datagram for the DLI side, in the edition of its station.
    pub(super) fn next_datagram(&mut self) -> Option<Datagram> {
        let left_out = self.outbox.take_left_out();
        self.counters.add("too many datagrams at once", left_out);
        loop {
            if let Some(datagram) = self.ed25.translated.pop_front() {
                return Some(datagram);
            }
            let datagram = self.outbox.pop()?;
            if ed25::is_ed25(datagram.bytes()) {
                self.remember_sent(&datagram);
                return Some(datagram);
            }
            let id = datagram.destination();
            let Some(index) = self.stations.iter().position(|one| one.id() == id) else {
                return Some(datagram);
            };
            let station = &mut self.stations[index];
            // A question is in the edition of the address that it is for (`reach`), which could not answer it in the station's.
            if !station.speaks_ed25() || is_question(&datagram) {
                return Some(datagram);
            }
            let readings = &station.profile.readings;
            if readings.frames(datagram.bytes()).nth(1).is_some() {
                // Packed just before the station used this edition, which has one message per datagram.
                self.outbox
                    .put_back(&datagram, readings.frames(datagram.bytes()).flatten());
                continue;
            }
            let Some(Ok(frame)) = readings.frames(datagram.bytes()).next() else {
                continue;
            };
            let decoded = readings.decode(frame.header.message_type, frame.data);
            let Ok(mut message) = decoded else { continue };
            let envelope = frame.header.envelope();
            let of = self.logical.meant_by(envelope.source);
            if let Message::VehicleOperatingStates(states) = &mut message {
                let live = self.aircraft.find(of).filter(|one| one.vehicle.live());
                if let Some(one) = live {
                    let (telemetry, last) = (&one.vehicle.telemetry, one.flight.last_commanded());
                    mapping::report::fill_commanded(states, telemetry, last);
                }
            }
            station.translator.keep_time(self.outbox.last_stamp_ms());
            let translated = station.translator.outbound(&envelope, of, &message);
            let bytes = translated.iter().map(Vec::len).sum();
            if !self.paths.settle(index, &datagram, bytes) {
                self.counters.count("unproven address");
                continue;
            }
            for bytes in translated {
                if let Some(translated) = datagram.translated(&bytes) {
                    self.remember_sent(&translated);
                    self.ed25.translated.push_back(translated);
                }
            }
        }
    }

    /// Remembers datagrams to the group: they may come back, and look as if their station had sent them.
    fn remember_sent(&mut self, datagram: &Datagram) {
        if datagram.to != Destination::Multicast {
            return;
        }
        for frame in ed25::frames(datagram.bytes()).flatten() {
            self.ed25.sent_to_group.truncate(MAX_REMEMBERED);
            let ed25::Header {
                message_type,
                instance,
                ..
            } = frame.header;
            self.ed25.sent_to_group.push_front((message_type, instance));
        }
    }
}

/// The header that a wrapper of Edition 4 would have.
fn header(frame: &ed25::Frame<'_>, at: &Parties) -> Header {
    Header {
        source: at.cucs,
        destination: at.vehicle,
        message_type: frame.header.message_type.try_into().unwrap_or(u16::MAX),
        ack_requested: false,
        idd: Header::IDD_ED4,
        checksum: ChecksumStyle::None,
    }
}

/// #1400.
const ED25_ACKNOWLEDGEMENT: u16 = 1400;
/// Whether it challenges an address: a heartbeat that requests an acknowledgement.
fn is_question(datagram: &Datagram) -> bool {
    let mut frames = stanag_msgs::frames(datagram.bytes());
    let first = frames.next().and_then(Result::ok);
    first.is_some_and(|one| one.header.message_type == Heartbeat::ID && one.header.ack_requested)
}

/// Maximum number of remembered messages to the group.
const MAX_REMEMBERED: usize = 256;
