//! Commands that are held until a condition (50020), cancelled (50021) and reported (50022).
//!
//! A held command is carried out at most once, in the name of the CUCS that sent it, as if it arrived at that moment: the
//! router checks the right again and passes the command to its machine. Promised:
//!
//! - A command is stored before it is acknowledged, and marked as started before it runs, so no restart or power cut runs it
//!   twice. If the disk does not confirm within [`STORED_WITHIN`], the command is refused.
//! - It never runs after its expiry or its cancellation, also after a restart. If the VSM's clock was set back during a
//!   restart, all held commands are cancelled.
//! - It never runs while the vehicle is silent, and never against its pilot or failsafe: a command that would take the
//!   vehicle from them is refused.
//! - It ends when its sender loses control. A [contingency](HoldKind::Contingency) is kept while nobody controls the vehicle
//!   and ends when another CUCS takes control, so that a new controller is never surprised by what another CUCS planned.
//!
//! ```text
//! waiting --condition--> being carried out --shown--> carried out
//!    |                          +--> refused
//!    +--> refused, expired, cancelled
//! ```
//!
//! `input`: what the machine reads, and its inputs; `condition`: the conditions; `record`: the record on disk.

mod condition;
mod input;
mod record;
#[cfg(test)]
mod tests;

use std::time::Duration;

use data_encoding::HEXLOWER_PERMISSIVE;
use mavlink_link::store::{Changes, Progress, Store as _, StoreError};
use stanag_msgs::enums::{
    AckType, FlightPathControlMode as Mode, HoldCondition, HoldKind, LoiBitmap,
};
use stanag_msgs::messages::{HeldCommandCancel, HoldCommand};
use stanag_msgs::{Id, Message, table};

use self::condition::{Condition, Look, wall_ms};
pub(crate) use self::input::{Context, Input};
use self::record::{Entry, Record, State};
use super::alerts::Cause;
use super::authority::{self, rules::Rights, rules::Stations};
use super::context::Origin;
use super::duplicates::Seen;
use super::effects::{Effects, Request};
use super::flight;
use super::other::Other;
use crate::config::OnLoss;

/// The machine.
#[derive(Debug, Default)]
pub(crate) struct Held {
    /// In the order that they were given.
    entries: Vec<Entry>,
    serial: u32,
    /// When to retry writing the record; `None` if it is stored.
    unsaved: Option<Duration>,
    /// Commands that run as soon as the disk has stored their start.
    storing: Vec<Storing>,
}

/// A command that is due, while the disk stores its start.
#[derive(Debug)]
struct Storing {
    serial: u32,
    stored: Changes,
    until: Duration,
    message: Message,
}

/// The command in a 50020; `None` if it cannot be decoded.
pub(crate) fn inner(message: &Message) -> Option<Message> {
    let Message::HoldCommand(hold) = message else {
        return None;
    };
    let data = hold.held_message_data?;
    let data = HEXLOWER_PERMISSIVE.decode(data.as_str().as_bytes()).ok()?;
    Message::decode(hold.held_message_type?, &data).ok()
}

impl Held {
    /// Restores the record after a restart. Returns whether the restart interrupted a launch.
    ///
    /// # Errors
    /// A record exists and cannot be read.
    pub(crate) fn restore(&mut self, effects: &mut Effects<'_>) -> Result<bool, StoreError> {
        let (vehicle, now) = (effects.id, effects.dli.now);
        let Some(record) = effects.disk().load::<Record>(&vehicle)? else {
            return Ok(false);
        };
        // Expiry and Condition Time are kept by the wall clock: if that was set back, a command could run long after its
        // expiry.
        let behind = wall_ms(now.wall) + CLOCK_SLACK_MS < record.written_ms;
        (self.entries, self.serial) = (record.entries, record.serial);
        let mut launched = false;
        for entry in &mut self.entries {
            entry.restart_clocks(now);
            let (state, why) = match entry.state {
                State::BeingCarriedOut => (State::Refused, CUT_OFF),
                State::Waiting if behind => (State::Cancelled, CLOCK_WENT_BACK),
                _ => continue,
            };
            launched |= entry.state == State::BeingCarriedOut && launches(entry);
            entry.state = state;
            why.clone_into(&mut entry.reason);
            self.unsaved = Some(now.mono);
        }
        Ok(launched)
    }

    /// Resumes a 50020 that had no final answer when the VSM ended: it still waits, or is answered now. Returns false if the
    /// command is unknown.
    pub(crate) fn resume(
        &self,
        (station, owner): (usize, Option<Id>),
        seen: &Seen,
        effects: &mut Effects<'_>,
    ) -> bool {
        let is_it = |entry: &&Entry| Some(Id(entry.owner)) == owner && entry.stamp == seen.stamp.0;
        let Some(entry) = self.entries.iter().rev().find(is_it) else {
            return false;
        };
        match entry.state.has_ended() {
            true => answer_end(entry, station, effects),
            // Its sender may not have received the answer and may repeat the command.
            false => effects.acknowledge(&entry.origin(station), AckType::Received),
        }
        true
    }

    /// When [`Input::Watch`] is next due.
    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        let waiting = self.waiting();
        let due = waiting.flat_map(|entry| [Some(entry.until), entry.condition.poll_timeout()]);
        let storing = self.storing.iter().map(|one| one.until);
        due.flatten().chain(self.unsaved).chain(storing).min()
    }

    /// Takes an input.
    pub(crate) fn handle(
        &mut self,
        context: &Context<'_>,
        input: Input<'_>,
        effects: &mut Effects<'_>,
    ) {
        match input {
            Input::Command { origin, message } => match message {
                Message::HoldCommand(command) => self.hold(context, origin, command, effects),
                Message::HeldCommandCancel(command) => {
                    self.cancel(context, origin, command, effects);
                }
                _ => {}
            },
            Input::List { station } => {
                for entry in &self.entries {
                    let report = entry.report(effects.stamp());
                    effects.send(station, &report.into());
                }
            }
            Input::Watch => self.watch(context, effects),
            Input::Ended {
                serial,
                answer,
                why,
            } => self.ended(context, serial, answer, why, effects),
        }
    }

    fn waiting(&self) -> impl Iterator<Item = &Entry> {
        let waits = |entry: &&Entry| entry.state == State::Waiting;
        self.entries.iter().filter(waits)
    }
}

/// Commands of a CUCS.
impl Held {
    fn hold(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        command: &HoldCommand,
        effects: &mut Effects<'_>,
    ) {
        let entry = match self.entry(context, &origin, command) {
            Ok(entry) => entry,
            Err(why) => return effects.refuse(Some(origin), why),
        };
        let (before, serial) = (self.entries.clone(), self.serial);
        self.serial = entry.serial;
        // A CUCS may reuse a number: forget the ended command that had it.
        let (owner, number) = (entry.owner, entry.number);
        self.entries
            .retain(|one| !(one.state.has_ended() && one.owner == owner && one.number == number));
        self.entries.push(entry);
        self.forget_old();
        // Store before the 17000: a command that is acknowledged as held must survive a restart.
        if let Err(fault) = self.save(effects) {
            (self.entries, self.serial) = (before, serial);
            return effects.refuse(Some(origin), format!("it cannot be stored: {fault}"));
        }
        effects.acknowledge(&origin, AckType::Received);
        self.report_last(context, effects);
    }

    /// Checks a 50020, including the right that its command needs now.
    fn entry(
        &self,
        context: &Context<'_>,
        origin: &Origin,
        command: &HoldCommand,
    ) -> Result<Entry, String> {
        let station = context.stations.get(origin.station);
        let station = station.ok_or("its sender is not configured")?;
        let owner = station.id();
        let number = command.held_command_number.filter(|number| *number != 0);
        let number = number.ok_or("Held Command Number is missing")?;
        let stamp = command.time_stamp.ok_or("Time Stamp is missing")?;
        let valid_s = command.valid_for.ok_or("Valid For is missing")?;
        if !(1..=MAX_VALID_S).contains(&valid_s) {
            return Err(format!(
                "Valid For {valid_s} s, expected 1 to {MAX_VALID_S}"
            ));
        }
        let contingency = match command.hold_kind {
            None | Some(HoldKind::Command) => false,
            Some(HoldKind::Contingency) => true,
            Some(HoldKind::Unknown(value)) => {
                return Err(format!("Hold Kind {value}, expected 0 or 1"));
            }
        };
        let message_type = command
            .held_message_type
            .ok_or("Held Message Type is missing")?;
        let data = command
            .held_message_data
            .ok_or("Held Message Data is missing")?;
        let bytes = HEXLOWER_PERMISSIVE.decode(data.as_str().as_bytes());
        let bytes = bytes.map_err(|_| "Held Message Data is not hexadecimal")?;
        // Decoded now, by the readings of its sender: a fault is then an answer to the 50020, not a surprise when it is
        // due.
        let message = station.profile.readings.decode(message_type, &bytes);
        let message = message.map_err(|fault| format!("Held Message Data: {fault}"))?;
        self.check_right(context, owner, &message)?;
        let of_owner = || self.entries.iter().filter(|entry| entry.owner == owner.0);
        let open = || of_owner().filter(|entry| !entry.state.has_ended());
        if open().any(|entry| entry.number == number) {
            return Err(format!(
                "number {number} is held already: cancel it first (50021)"
            ));
        }
        if open().count() >= MAX_HELD {
            return Err(format!(
                "{MAX_HELD} commands of this CUCS are held: cancel one first (50021)"
            ));
        }
        let serial_of = |number| {
            let mut known = of_owner().rev();
            known
                .find(|entry| entry.number == number)
                .map(|entry| entry.serial)
        };
        if command.hold_condition == Some(HoldCondition::LinkLost) {
            check_link_lost(context, contingency, &message)?;
        }
        let condition = Condition::of(command, context, serial_of)?;
        let valid = Duration::from_secs(valid_s.into());
        Ok(Entry {
            serial: self.serial.wrapping_add(1),
            owner: owner.0,
            number,
            message_type,
            data: data.as_str().to_owned(),
            contingency,
            condition,
            state: State::Waiting,
            reason: String::new(),
            until_ms: wall_ms(context.now.wall + valid),
            until: context.mono() + valid,
            stamp: stamp.0,
            ack_requested: origin.ack_requested,
        })
    }

    /// Checks whether the command can be held at all, and whether this CUCS may send it now.
    fn check_right(
        &self,
        context: &Context<'_>,
        owner: Id,
        message: &Message,
    ) -> Result<(), String> {
        let named = table::named(message.id());
        let right = right_for(context, message);
        let right = right.filter(|_| !NEVER_HELD.contains(&message.id()));
        let right = right.ok_or_else(|| format!("message {named} cannot be held"))?;
        if context.rights.holds(owner, right) {
            return Ok(());
        }
        let needed = Rights::named(right, Stations::NONE).in_words();
        let held = context.rights.held(owner).in_words();
        Err(format!(
            "message {named} needs {needed}; this CUCS holds {held}"
        ))
    }

    fn cancel(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        command: &HeldCommandCancel,
        effects: &mut Effects<'_>,
    ) {
        let Some(sender) = context.stations.get(origin.station).map(|one| one.id()) else {
            return;
        };
        let owner = command.owner_id.unwrap_or(sender);
        if owner != sender && context.controller != Some(sender) {
            let why = format!(
                "only {owner} and the CUCS that controls the vehicle can cancel the held commands of {owner}"
            );
            return effects.refuse(Some(origin), why);
        }
        let number = command.held_command_number.filter(|number| *number != 0);
        let meant = |entry: &Entry| {
            entry.owner == owner.0 && number.is_none_or(|number| entry.number == number)
        };
        let open: Vec<usize> = (self.entries.iter().enumerate())
            .filter(|(_, entry)| meant(entry) && entry.state == State::Waiting)
            .map(|(index, _)| index)
            .collect();
        if let (true, Some(number)) = (open.is_empty(), number) {
            let runs = self
                .entries
                .iter()
                .any(|entry| meant(entry) && !entry.state.has_ended());
            let why = if runs {
                format!("held command {number} is being carried out: send another command instead")
            } else {
                format!("{owner} has no waiting held command {number}")
            };
            return effects.refuse(Some(origin), why);
        }
        for index in open {
            self.end(
                context,
                index,
                State::Cancelled,
                &format!("cancelled by {sender}"),
                effects,
            );
        }
        // A command that was answered as cancelled must not wait again after a restart.
        match self.unsaved {
            None => effects.acknowledge(&origin, AckType::CarriedOut),
            Some(_) => effects.refuse(
                Some(origin),
                "cancelled, but the cancellation cannot be stored: a restart of the VSM would undo it",
            ),
        }
    }
}

/// Progress with time, the vehicle's state and changes of rights.
impl Held {
    fn watch(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        if self.unsaved.is_some_and(|at| at <= context.mono()) {
            self.save_or_warn(context, effects);
        }
        self.carry_out_stored(context, effects);
        let mut nearer = false;
        // A command that ends may end others, which come later in the list.
        for index in 0..self.entries.len() {
            if self
                .entries
                .get(index)
                .is_some_and(|entry| entry.state == State::Waiting)
            {
                nearer |= self.watch_one(context, index, effects);
            }
        }
        if nearer {
            self.save_or_warn(context, effects);
        }
    }

    /// Checks one waiting command; returns true if it has changed and must be stored.
    fn watch_one(
        &mut self,
        context: &Context<'_>,
        index: usize,
        effects: &mut Effects<'_>,
    ) -> bool {
        let Some(entry) = self.entries.get(index) else {
            return false;
        };
        if entry.until <= context.mono() {
            self.end(
                context,
                index,
                State::Expired,
                "its Valid For has passed",
                effects,
            );
            return false;
        }
        let owner = Id(entry.owner);
        let mut stations = context.stations.iter();
        let station = stations.find(|one| one.id() == owner && !one.removed);
        let found = station.ok_or_else(|| "its CUCS is no longer configured".to_owned());
        let found = found.and_then(|station| {
            let data = HEXLOWER_PERMISSIVE.decode(entry.data.as_bytes());
            let data = data.unwrap_or_default();
            let message = station.profile.readings.decode(entry.message_type, &data);
            let message = message.map_err(|fault| fault.to_string())?;
            may(context, entry, owner, &message)?;
            Ok((station, message))
        });
        let (station, message) = match found {
            Ok(found) => found,
            Err(why) => {
                self.end(context, index, State::Cancelled, &why, effects);
                return false;
            }
        };
        let other = match &entry.condition {
            Condition::Done { serial, number } => {
                let other = self.entries.iter().find(|other| other.serial == *serial);
                Some((*number, other.map(|other| other.state)))
            }
            _ => None,
        };
        let look = match other {
            Some((_, Some(State::CarriedOut))) => Look::Met,
            Some((_, Some(State::Waiting | State::BeingCarriedOut))) => Look::Waits,
            Some((number, _)) => {
                let why = format!("held command {number}, which it waits for, was not carried out");
                self.end(context, index, State::Cancelled, &why, effects);
                return false;
            }
            None => match self.entries.get_mut(index) {
                Some(entry) => entry.condition.look(context, station),
                None => Look::Waits,
            },
        };
        match look {
            Look::Waits => false,
            Look::Nearer => true,
            // It keeps waiting until data of the vehicle arrives or the command expires.
            Look::Met if !context.vehicle.live() => false,
            // The command is for this loss: the hold of a steered vehicle comes first, as does a PX4 failsafe that may only
            // hold.
            Look::Met if self.is_for_loss(index) && moves(&message) && holds_first(context) => {
                false
            }
            Look::Met => {
                self.carry_out(context, index, message, effects);
                false
            }
        }
    }

    fn is_for_loss(&self, index: usize) -> bool {
        let entry = self.entries.get(index);
        entry.is_some_and(|entry| entry.condition == Condition::LinkLost)
    }

    fn carry_out(
        &mut self,
        context: &Context<'_>,
        index: usize,
        message: Message,
        effects: &mut Effects<'_>,
    ) {
        if let Err(why) = undisturbed(context, &message, self.is_for_loss(index)) {
            return self.end(context, index, State::Refused, &why, effects);
        }
        let Some(entry) = self.entries.get_mut(index) else {
            return;
        };
        entry.state = State::BeingCarriedOut;
        // Store the start before running it: a restart must not run it again.
        if let Err(fault) = self.save(effects) {
            let why = format!("its start could not be stored ({fault})");
            return self.end(context, index, State::Refused, &why, effects);
        }
        let Some(entry) = self.entries.get(index) else {
            return;
        };
        report(entry, context, effects);
        self.storing.push(Storing {
            serial: entry.serial,
            stored: Changes {
                after: effects.dli.mark,
                until: effects.disk().queued(),
            },
            until: entry.until.min(context.mono() + STORED_WITHIN),
            message,
        });
        self.carry_out_stored(context, effects);
    }

    /// Runs the commands whose start is stored.
    fn carry_out_stored(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        for one in std::mem::take(&mut self.storing) {
            let durable = effects.disk().progress(one.stored) == Progress::Durable;
            if !durable && context.mono() < one.until {
                self.storing.push(one);
                continue;
            }
            let is_it = |entry: &Entry| entry.serial == one.serial;
            let Some(index) = self.entries.iter().position(is_it) else {
                continue;
            };
            let result = match (durable, context.vehicle.live()) {
                (false, _) => Err("the disk did not confirm its start in time".to_owned()),
                (true, false) => Err("no data from the vehicle".to_owned()),
                (true, true) if self.entries[index].until <= context.mono() => {
                    Err("its Valid For has passed".to_owned())
                }
                // A command for the loss of the CUCS may start together with the loss action; every other command gives way
                // to it.
                (true, true) if self.entries[index].condition == Condition::LinkLost => {
                    flown_from_here(context, &one.message, true)
                }
                (true, true) => undisturbed(context, &one.message, false),
            };
            match result {
                Ok(()) => self.request(context, index, one.message, effects),
                Err(why) => self.end(context, index, State::Refused, &why, effects),
            }
        }
    }

    fn request(
        &self,
        context: &Context<'_>,
        index: usize,
        message: Message,
        effects: &mut Effects<'_>,
    ) {
        let Some(entry) = self.entries.get(index) else {
            return;
        };
        let Some(station) = context.station_of(Id(entry.owner)) else {
            return;
        };
        let text = format!(
            "held command {} of {}: carrying out message {}",
            entry.number,
            Id(entry.owner),
            table::named(entry.message_type)
        );
        effects.advise(text);
        effects.request(Request::CarryOut {
            origin: Origin {
                message_type: entry.message_type,
                // The acknowledgement was requested for the 50020, and the 50020 has had its own.
                ack_requested: false,
                held: Some(entry.serial),
                ..entry.origin(station)
            },
            message: Box::new(message),
            contingency: entry.contingency,
        });
    }

    fn ended(
        &mut self,
        context: &Context<'_>,
        serial: u32,
        answer: AckType,
        why: Option<String>,
        effects: &mut Effects<'_>,
    ) {
        let runs = |entry: &Entry| entry.serial == serial && entry.state == State::BeingCarriedOut;
        let Some(index) = self.entries.iter().position(runs) else {
            return;
        };
        match answer {
            AckType::Received => {}
            AckType::CarriedOut => self.end(context, index, State::CarriedOut, "", effects),
            _ => {
                let why = why.unwrap_or_else(|| "unknown reason".to_owned());
                self.end(context, index, State::Refused, &why, effects);
            }
        }
    }

    /// Ends a command: stores the end, then answers and reports it.
    fn end(
        &mut self,
        context: &Context<'_>,
        index: usize,
        state: State,
        why: &str,
        effects: &mut Effects<'_>,
    ) {
        let Some(entry) = self.entries.get_mut(index) else {
            return;
        };
        entry.state = state;
        why.clone_into(&mut entry.reason);
        self.save_or_warn(context, effects);
        let Some(entry) = self.entries.get(index) else {
            return;
        };
        report(entry, context, effects);
        if let Some(station) = context.station_of(Id(entry.owner)) {
            answer_end(entry, station, effects);
        }
        // Notify the controlling CUCS of what will not happen; the sender was notified above.
        let controller = context.controller.filter(|id| *id != Id(entry.owner));
        if let (false, Some(station)) = (
            state == State::CarriedOut,
            controller.and_then(|id| context.station_of(id)),
        ) {
            let text = format!(
                "held command {} of {} is not carried out: {why}",
                entry.number,
                Id(entry.owner)
            );
            effects.answer(&[station], text);
        }
    }

    fn report_last(&self, context: &Context<'_>, effects: &mut Effects<'_>) {
        if let Some(entry) = self.entries.last() {
            report(entry, context, effects);
        }
    }

    /// Keeps the latest ended commands, and those that another command waits for.
    fn forget_old(&mut self) {
        let waited_for: Vec<u32> = (self.waiting())
            .filter_map(|entry| match entry.condition {
                Condition::Done { serial, .. } => Some(serial),
                _ => None,
            })
            .collect();
        let goes = |entry: &Entry| entry.state.has_ended() && !waited_for.contains(&entry.serial);
        let ended = self.entries.iter().filter(|entry| goes(entry)).count();
        let mut over = ended.saturating_sub(MAX_ENDED);
        self.entries.retain(|entry| {
            let drop = over > 0 && goes(entry);
            over -= usize::from(drop);
            !drop
        });
    }

    fn save(&mut self, effects: &mut Effects<'_>) -> Result<(), StoreError> {
        let vehicle = effects.id;
        let record = Record {
            entries: self.entries.clone(),
            serial: self.serial,
            written_ms: wall_ms(effects.dli.now.wall),
        };
        effects.disk().save(&vehicle, &record)?;
        self.unsaved = None;
        Ok(())
    }

    /// Stores the record; on failure raises an alert and retries later.
    fn save_or_warn(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        match self.save(effects) {
            Ok(()) => effects.clear(Cause::HeldCommands, "held commands are stored again"),
            Err(fault) => {
                self.unsaved = Some(context.mono() + SAVE_AGAIN);
                let text = format!("held commands cannot be stored: {fault}");
                effects.warn(Cause::HeldCommands, text);
            }
        }
    }
}

/// Sends 50022 to all listening stations and to the sender of the command.
fn report(entry: &Entry, context: &Context<'_>, effects: &mut Effects<'_>) {
    let message: Message = entry.report(effects.stamp()).into();
    effects.publish_to_listeners(&message);
    let owner = context.station_of(Id(entry.owner));
    if let Some(owner) = owner.filter(|owner| !effects.listeners.contains(owner)) {
        effects.send(owner, &message);
    }
}

/// Sends the final 17000 for the 50020, with the reason.
fn answer_end(entry: &Entry, station: usize, effects: &mut Effects<'_>) {
    let origin = entry.origin(station);
    let number = entry.number;
    match entry.state {
        State::Waiting | State::BeingCarriedOut => {}
        State::CarriedOut => effects.acknowledge(&origin, AckType::CarriedOut),
        State::Refused => effects.refuse(
            Some(origin),
            format!(
                "held command {number}: {} refused: {}",
                table::named(entry.message_type),
                entry.reason
            ),
        ),
        State::Expired => {
            effects.refuse(Some(origin), format!("held command {number} has expired"))
        }
        State::Cancelled => effects.refuse(
            Some(origin),
            format!("held command {number} is cancelled: {}", entry.reason),
        ),
    }
}

fn right_for(context: &Context<'_>, message: &Message) -> Option<LoiBitmap> {
    let mode = flight::mode_of(message, &context.vehicle.telemetry);
    // Requests for information are answered at once, so they cannot be held.
    authority::right_for(message, mode).filter(|right| *right != LoiBitmap::LOI2)
}

/// Checks whether its CUCS may still have it carried out.
fn may(context: &Context<'_>, entry: &Entry, owner: Id, message: &Message) -> Result<(), String> {
    let right = right_for(context, message).ok_or("the LOI that it needs is unknown")?;
    if context.rights.holds(owner, right) {
        return Ok(());
    }
    match context.rights.controller() {
        None if entry.contingency => Ok(()),
        None => Err(format!(
            "{owner} no longer controls the vehicle, nobody does"
        )),
        Some(id) if id == owner => {
            let needed = Rights::named(right, Stations::NONE).in_words();
            Err(format!("{owner} no longer holds {needed}"))
        }
        Some(id) => Err(format!("{id} controls the vehicle now")),
    }
}

/// Checks a command that waits for the loss of its own sender. Control ends with that loss, so only a contingency outlives
/// it, and the VSM's own loss action is flown first.
fn check_link_lost(
    context: &Context<'_>,
    contingency: bool,
    message: &Message,
) -> Result<(), String> {
    if !contingency {
        return Err(
            "condition 6 (link lost) ends the control of its CUCS: it needs Hold Kind 1".to_owned(),
        );
    }
    if moves(message) && context.settings.authority.on_loss != OnLoss::Continue {
        return Err(
            "authority.on_loss is flown when its CUCS is lost: set it to \"continue\" to use a held command instead".to_owned(),
        );
    }
    Ok(())
}

/// Whether a command of this kind takes the vehicle from its pilot or failsafe.
fn moves(message: &Message) -> bool {
    matches!(
        message,
        Message::VehicleOperatingModeCommand(_)
            | Message::EngineCommand(_)
            | Message::MissionTransferCommand(_)
    )
}

/// Checks that nobody else flies the vehicle. An operator sees the effect of a command sent now; a command from an hour ago
/// takes no account of a pilot or failsafe that has taken the vehicle since.
fn undisturbed(context: &Context<'_>, message: &Message, for_loss: bool) -> Result<(), String> {
    if !moves(message) {
        return Ok(());
    }
    if context.flight.loss_action {
        return Err("the vehicle flies the loss action".to_owned());
    }
    if context.flight.contingency {
        return Err("the vehicle flies a contingency (vehicle.contingency)".to_owned());
    }
    flown_from_here(context, message, for_loss)
}

/// As [`undisturbed`], but without the loss action: a command for the loss of the CUCS may start together with it.
fn flown_from_here(context: &Context<'_>, message: &Message, for_loss: bool) -> Result<(), String> {
    let telemetry = &context.vehicle.telemetry;
    let armed = telemetry.armed == Some(true);
    if !moves(message) || !(armed || telemetry.airborne()) {
        return Ok(());
    }
    let ends_never = for_loss && context.only_holds;
    match context
        .other
        .filter(|other| !(ends_never && other.may_stay()))
    {
        // On the ground a failsafe means nothing yet, but a pilot who has armed by hand is about to take off.
        Some(other @ Other::Pilot(_)) => Err(other.to_string()),
        Some(other) if telemetry.airborne() => Err(other.to_string()),
        None if telemetry.mode.is_none() => Err("the mode of the vehicle is not known".to_owned()),
        _ => Ok(()),
    }
}

/// Whether the vehicle is being put on hold, or is held by a failsafe that may still do more.
fn holds_first(context: &Context<'_>) -> bool {
    context.flight.loss_action
        || (context.other.is_some_and(Other::may_stay) && !context.only_holds)
}

/// Whether the command is a launch.
fn launches(entry: &Entry) -> bool {
    let data = HEXLOWER_PERMISSIVE.decode(entry.data.as_bytes()).ok();
    let message = data.and_then(|data| Message::decode(entry.message_type, &data).ok());
    matches!(message, Some(Message::VehicleOperatingModeCommand(command))
        if command.select_flight_path_control_mode == Some(Mode::Launch))
}

/// Messages that are never held: sticks, which are a stream; 50020 and 50021 themselves; and orders that cannot be undone,
/// for which an operator must be watching.
const NEVER_HELD: [u16; 5] = [2005, 2010, 50020, 50021, 50023];
/// Maximum number of held commands of one CUCS.
const MAX_HELD: usize = 16;
/// Number of ended commands that are still listed.
const MAX_ENDED: usize = 16;
/// One day.
const MAX_VALID_S: u32 = 86_400;
/// How long a due command waits for the disk.
const STORED_WITHIN: Duration = Duration::from_secs(2);
const SAVE_AGAIN: Duration = Duration::from_secs(1);
/// A smaller step of the clock is ignored.
const CLOCK_SLACK_MS: u64 = 1_000;
const CUT_OFF: &str =
    "the VSM restarted while it was carried out: not resumed; check the vehicle's state";
const CLOCK_WENT_BACK: &str = "the clock of the VSM was set back during a restart";
