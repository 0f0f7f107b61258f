//! Commands that are held until a condition (50020), cancelled (50021) and reported (50022).
//!
//! A held command is carried out at most once, in the name of the CUCS that sent it, as if it arrived at that moment: the
//! router checks the right again and passes the command to its machine. Promised:
//!
//! - A command is stored before it is acknowledged, and marked as started before it runs, so no restart or power cut runs it
//!   twice. If the disk does not confirm that in time, the command is refused.
//! - It never runs after its expiry or its cancellation, also after a restart, over which the computer's time since boot
//!   counts. Over a restart of the computer the wall clock does: if that was set back, all held commands are cancelled.
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
//! `input`: what the machine reads, and its inputs; `command`: what CUCSs command; `condition`: the conditions; `due`: when
//! a command is due, and its start; `others`: who else flies the vehicle; `record`: the record on disk.

mod command;
mod condition;
mod due;
mod input;
mod others;
mod record;
#[cfg(test)]
mod tests;

use std::time::Duration;

use data_encoding::HEXLOWER_PERMISSIVE;
use mavlink_link::store::{Changes, Store as _, StoreError};
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode, LoiBitmap};
use stanag_msgs::{Id, Message, table};

use self::condition::Condition;
pub(crate) use self::input::{Context, Input};
use self::others::moves;
use self::record::{Entry, Record, State};
use super::alerts::Cause;
use super::authority;
use super::dates::wall_ms;
use super::duplicates::Seen;
use super::effects::Effects;
use super::flight;

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

/// What a restart has interrupted.
#[derive(Debug, Default)]
pub(crate) struct CutOff {
    /// A launch.
    pub(crate) launch: bool,
    /// The number of a contingency that moves the vehicle.
    pub(crate) contingency: Option<u16>,
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
    /// Restores the record after a restart. Returns what the restart interrupted.
    ///
    /// # Errors
    /// A record exists and cannot be read.
    pub(crate) fn restore(&mut self, effects: &mut Effects<'_>) -> Result<CutOff, StoreError> {
        let (vehicle, now) = (effects.id, effects.dli.now);
        let Some(record) = effects.disk().load::<Record>(&vehicle)? else {
            return Ok(CutOff::default());
        };
        let now_ms = record.now_ms(now, effects.dli.uptime());
        (self.entries, self.serial) = (record.entries, record.serial);
        let mut cut_off = CutOff::default();
        for entry in &mut self.entries {
            entry.restart_clocks(now.mono, now_ms.unwrap_or(u64::MAX));
            let (state, why) = match entry.state {
                State::BeingCarriedOut => (State::Refused, CUT_OFF),
                State::Waiting if now_ms.is_none() => (State::Cancelled, CLOCK_WENT_BACK),
                _ => continue,
            };
            if entry.state == State::BeingCarriedOut {
                cut_off.launch |= launches(entry);
                let moving = entry.contingency && moves(entry.message_type);
                cut_off.contingency = moving.then_some(entry.number).or(cut_off.contingency);
            }
            entry.state = state;
            why.clone_into(&mut entry.reason);
            self.unsaved = Some(now.mono);
        }
        Ok(cut_off)
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

    /// The bridge did not run for so long: nothing has lasted by that.
    pub(crate) fn note_stop(&mut self, stopped: Duration) {
        for entry in &mut self.entries {
            entry.condition.note_stop(stopped);
        }
    }

    /// The number of the held command that moves the vehicle once `owner` is lost: one that waits for that, or a contingency
    /// that is being carried out. `steered`: the vehicle is put on hold first, which ends the latter.
    pub(crate) fn flown_for_loss_of(&self, owner: Id, steered: bool) -> Option<u16> {
        let follows = |entry: &&Entry| {
            let due = match entry.state {
                State::Waiting => entry.condition == Condition::LinkLost,
                State::BeingCarriedOut => !steered,
                _ => false,
            };
            due && entry.contingency && Id(entry.owner) == owner && moves(entry.message_type)
        };
        self.entries.iter().find(follows).map(|entry| entry.number)
    }

    /// Whether a command waits until its start is stored.
    pub(crate) fn awaits_disk(&self) -> bool {
        !self.storing.is_empty()
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

/// The end of a command, and the record.
impl Held {
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

    fn save(&mut self, effects: &mut Effects<'_>) -> Result<(), StoreError> {
        let (vehicle, now) = (effects.id, effects.dli.now);
        for entry in &mut self.entries {
            entry.store_clocks(now);
        }
        let record = Record {
            entries: self.entries.clone(),
            serial: self.serial,
            written_ms: wall_ms(now.wall),
            written: effects.dli.uptime(),
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

/// Whether the command is a launch.
fn launches(entry: &Entry) -> bool {
    let data = HEXLOWER_PERMISSIVE.decode(entry.data.as_bytes()).ok();
    let message = data.and_then(|data| Message::decode(entry.message_type, &data).ok());
    matches!(message, Some(Message::VehicleOperatingModeCommand(command))
        if command.select_flight_path_control_mode == Some(Mode::Launch))
}

const SAVE_AGAIN: Duration = Duration::from_secs(1);
const CUT_OFF: &str =
    "the VSM restarted while it was carried out: not resumed; check the vehicle's state";
const CLOCK_WENT_BACK: &str = "the clock of the VSM was set back while its computer was restarted";
