//! What a CUCS commands of held commands: to hold one (50020), or to cancel one (50021).

use std::time::Duration;

use data_encoding::HEXLOWER_PERMISSIVE;
use stanag_msgs::enums::{AckType, HoldCondition, HoldKind};
use stanag_msgs::messages::{HeldCommandCancel, HoldCommand};
use stanag_msgs::{Id, Message, table};

use super::condition::Condition;
use super::input::Context;
use super::others::moves;
use super::record::{Entry, State};
use super::{Held, right_for};
use crate::config::OnLoss;
use crate::session::authority::{rules::Rights, rules::Stations};
use crate::session::context::Origin;
use crate::session::effects::Effects;

impl Held {
    pub(super) fn hold(
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
            until_ms: 0,
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

    pub(super) fn cancel(
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
    if moves(message.id()) && context.settings.authority.on_loss != OnLoss::Continue {
        return Err(
            "authority.on_loss is flown when its CUCS is lost: set it to \"continue\" to use a held command instead".to_owned(),
        );
    }
    Ok(())
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
