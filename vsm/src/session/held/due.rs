//! When a held command is due, and how it is carried out: its start is stored first.

use std::time::Duration;

use data_encoding::HEXLOWER_PERMISSIVE;
use mavlink_link::store::{Changes, Progress};
use stanag_msgs::{Id, Message, table};

use super::condition::{Condition, Look};
use super::input::Context;
use super::others::{flown_from_here, holds_first, moves, undisturbed};
use super::record::{Entry, State};
use super::{Held, Storing, report, right_for};
use crate::session::authority::{rules::Rights, rules::Stations};
use crate::session::context::{HeldOrigin, Origin};
use crate::session::effects::{Effects, Request};

impl Held {
    pub(super) fn watch(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
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
            Look::Met if self.is_for_loss(index) && moves(message.id()) && holds_first(context) => {
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
                held: Some(HeldOrigin {
                    serial: entry.serial,
                    contingency: entry.contingency,
                }),
                ..entry.origin(station)
            },
            message: Box::new(message),
        });
    }
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

/// How long a due command waits for the disk.
const STORED_WITHIN: Duration = Duration::from_secs(2);
