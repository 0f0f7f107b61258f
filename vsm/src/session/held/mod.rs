//! Commands that are held until a condition (50020), cancelled (50021) and reported (50022).
//!
//! A held command is carried out once at most, by the CUCS that gave it, in the same way as one that arrives then: the
//! router checks the right again and hands it to the machine that it is for. Promised:
//!
//! - It is on disk before it is acknowledged, and that it is being carried out is on disk before it is: what a restart, or a
//!   power cut, finds so is not carried out again. A disk that does not keep it within [`STORED_WITHIN`] has it refused.
//! - Never after its expiry or its cancellation, over restarts too. A VSM whose clock went back over a restart cancels all.
//! - Never while the vehicle is silent, and never against its pilot or its failsafe: a command that would take the
//!   vehicle from them is refused.
//! - A command ends with the control of its sender. A [contingency](HoldKind::Contingency) is kept while nobody controls
//!   the vehicle, and ends when another does: who controls is not surprised by what another has planned.
//!
//! ```text
//! waiting --condition--> being carried out --shown--> carried out
//!    |                          +--> refused
//!    +--> refused, expired, cancelled
//! ```
//!
//! `input`: what the machine reads, and what happens to it; `condition`: what is waited for; `record`: what a restart finds.

mod condition;
mod input;
mod record;
#[cfg(test)]
mod tests;

use std::time::Duration;

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
use super::mission::record::unhex;
use super::other::Other;
use crate::config::OnLoss;

/// The machine.
#[derive(Debug, Default)]
pub(crate) struct Held {
    /// In the order that they were given.
    entries: Vec<Entry>,
    serial: u32,
    /// The record could not be written, and is written again then.
    unsaved: Option<Duration>,
    /// What is carried out once the disk has it.
    storing: Vec<Storing>,
}

/// A command that is due, and is on its way to the disk as such.
#[derive(Debug)]
struct Storing {
    serial: u32,
    stored: Changes,
    until: Duration,
    message: Message,
}

/// The command in a 50020; none where it cannot be read.
pub(crate) fn inner(message: &Message) -> Option<Message> {
    let Message::HoldCommand(hold) = message else {
        return None;
    };
    let data = unhex(hold.held_message_data?.as_str())?;
    Message::decode(hold.held_message_type?, &data).ok()
}

impl Held {
    /// What a restart finds. Returns whether it has cut off a launch.
    ///
    /// # Errors
    /// A record exists and cannot be read.
    pub(crate) fn restore(&mut self, effects: &mut Effects<'_>) -> Result<bool, StoreError> {
        let (vehicle, now) = (effects.id, effects.dli.now);
        let Some(record) = effects.disk().load::<Record>(&vehicle)? else {
            return Ok(false);
        };
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

    /// A 50020 that had no final answer when the VSM ended: it still waits, or is answered now. False where nothing is
    /// known of it.
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
            // Its sender may not have been answered yet, and repeats it.
            false => effects.acknowledge(&entry.origin(station), AckType::Received),
        }
        true
    }

    /// When [`Input::Watch`] is due by the time alone.
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
        // A number may come again: what it meant before is known no more.
        let (owner, number) = (entry.owner, entry.number);
        self.entries
            .retain(|one| !(one.state.has_ended() && one.owner == owner && one.number == number));
        self.entries.push(entry);
        self.forget_old();
        // On disk before 17000: what is acknowledged as held must survive a restart.
        if let Err(fault) = self.save(effects) {
            (self.entries, self.serial) = (before, serial);
            return effects.refuse(Some(origin), format!("it cannot be stored: {fault}"));
        }
        effects.acknowledge(&origin, AckType::Received);
        self.report_last(context, effects);
    }

    /// A 50020, checked: also the right that its command needs now.
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
        let bytes = unhex(data.as_str()).ok_or("Held Message Data is not hexadecimal")?;
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

    /// Whether the command can be held at all, and may be given by this CUCS now.
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
        // What is answered as cancelled must not wait again after a restart.
        match self.unsaved {
            None => effects.acknowledge(&origin, AckType::CarriedOut),
            Some(_) => effects.refuse(
                Some(origin),
                "cancelled, but the cancellation cannot be stored: a restart of the VSM would undo it",
            ),
        }
    }
}

/// What the time, the vehicle and the holders of rights make of it.
impl Held {
    fn watch(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        if self.unsaved.is_some_and(|at| at <= context.mono()) {
            self.save_or_warn(context, effects);
        }
        self.carry_out_stored(context, effects);
        let mut nearer = false;
        // One that ends may end others, which come after it.
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

    /// Looks at one that waits; true where something of it must be stored.
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
            let data = unhex(&entry.data).unwrap_or_default();
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
            // It waits on until the vehicle is received, or its time is over.
            Look::Met if !context.vehicle.live() => false,
            // It is there for this loss: the hold of what was steered comes first, and a failsafe of PX4 that may only hold.
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
        // On disk before it is done: a restart must not do it again.
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

    /// Carries out what the disk has as being carried out.
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
                // What waits for the loss of the CUCS begins with the loss action, all else gives way to it.
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

    /// Ends one: stored, then answered and reported.
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
        // Who controls the vehicle learns what will not happen, and who gave it was refused it above.
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

    /// Keeps the latest of those that have ended, and what another waits for.
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

    /// What cannot be stored is tried again.
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

/// 50022 to all who listen, and to who gave it.
fn report(entry: &Entry, context: &Context<'_>, effects: &mut Effects<'_>) {
    let message: Message = entry.report(effects.stamp()).into();
    effects.publish_to_listeners(&message);
    let owner = context.station_of(Id(entry.owner));
    if let Some(owner) = owner.filter(|owner| !effects.listeners.contains(owner)) {
        effects.send(owner, &message);
    }
}

/// The final 17000 of the 50020, and the reason.
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
    // What only asks is answered at once.
    authority::right_for(message, mode).filter(|right| *right != LoiBitmap::LOI2)
}

/// Whether its CUCS may still have it carried out.
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

/// The loss of its own sender is what ends its control: only a contingency outlives that, and the VSM's own loss action is
/// flown first.
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

/// Whether a command of this kind takes the vehicle from whoever flies it.
fn moves(message: &Message) -> bool {
    matches!(
        message,
        Message::VehicleOperatingModeCommand(_)
            | Message::EngineCommand(_)
            | Message::MissionTransferCommand(_)
    )
}

/// Whether nobody else flies the vehicle: a command that arrives is an operator's who sees what it does; one that was given
/// an hour ago does not know that a pilot or a failsafe has taken it since.
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

/// The same without the loss action, which may begin with what is due when the CUCS is lost.
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
        // On the ground a failsafe means nothing yet; who has armed it by hand is about to take off.
        Some(other @ Other::Pilot(_)) => Err(other.to_string()),
        Some(other) if telemetry.airborne() => Err(other.to_string()),
        None if telemetry.mode.is_none() => Err("the mode of the vehicle is not known".to_owned()),
        _ => Ok(()),
    }
}

/// Whether the vehicle is put on hold, or held by a failsafe that may yet do more.
fn holds_first(context: &Context<'_>) -> bool {
    context.flight.loss_action
        || (context.other.is_some_and(Other::may_stay) && !context.only_holds)
}

/// Whether it is a launch.
fn launches(entry: &Entry) -> bool {
    let message =
        unhex(&entry.data).and_then(|data| Message::decode(entry.message_type, &data).ok());
    matches!(message, Some(Message::VehicleOperatingModeCommand(command))
        if command.select_flight_path_control_mode == Some(Mode::Launch))
}

/// Sticks are a stream; what holds and cancels is not held; and what cannot be taken back is for a person who looks.
const NEVER_HELD: [u16; 5] = [2005, 2010, 50020, 50021, 50023];
/// Commands of one CUCS that are held at once.
const MAX_HELD: usize = 16;
/// Commands that have ended and are still listed.
const MAX_ENDED: usize = 16;
/// A day.
const MAX_VALID_S: u32 = 86_400;
/// What is due waits no longer for the disk.
const STORED_WITHIN: Duration = Duration::from_secs(2);
const SAVE_AGAIN: Duration = Duration::from_secs(1);
/// A clock that is set by less counts as the same.
const CLOCK_SLACK_MS: u64 = 1_000;
const CUT_OFF: &str =
    "the VSM restarted while it was carried out: not resumed; check the vehicle's state";
const CLOCK_WENT_BACK: &str = "the clock of the VSM was set back during a restart";
