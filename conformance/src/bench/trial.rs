//! What the scene of a rule is given: stations with the rights that it begins with, and a place for its remarks.
//!
//! A scene begins with nobody in control, plays, and returns; [`Trial::clean_up`] then releases what its stations
//! hold and cancels what they scheduled. Each scene opens its own sockets, so that late datagrams of one scene cannot
//! reach the next.

use std::cell::{Cell, RefCell};
use std::collections::BTreeSet;
use std::ops::Deref;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

use stanag_msgs::Id;

use super::context::{Bench, Timers};
use super::remarks::Remarks;
use super::station::{Station, loi};
use super::survey::CucsFound;
use crate::verdict::{Judged, Precondition, Stop};
use crate::wire::{Direction, Draft, Seen};

/// A station that scenes share.
pub type Player = Rc<Station>;

/// The trial of a subject by one rule.
#[derive(Debug)]
pub struct Trial {
    /// What outlives it.
    pub bench: Arc<Bench>,
    /// Datagrams before it.
    pub mark: usize,
    remarks: Remarks<Seen>,
    players: RefCell<Vec<Player>>,
    /// The ids that it may play; all where empty. Two trials that run at the same time have disjoint ids.
    cast: BTreeSet<Id>,
    /// Whether a plan was loaded, so that the end of the run clears it.
    pub loaded: Cell<bool>,
}

impl Trial {
    /// A trial on this bench.
    #[must_use]
    pub fn new(bench: &Arc<Bench>) -> Self {
        Self {
            bench: bench.clone(),
            mark: bench.net.mark(),
            remarks: Remarks::default(),
            players: RefCell::default(),
            cast: BTreeSet::new(),
            loaded: Cell::new(false),
        }
    }

    /// A trial that plays these ids only.
    #[must_use]
    pub fn with_cast(bench: &Arc<Bench>, cast: BTreeSet<Id>) -> Self {
        Self {
            cast,
            ..Self::new(bench)
        }
    }

    fn plays(&self, cucs: &CucsFound) -> bool {
        self.cast.is_empty() || self.cast.contains(&cucs.id)
    }

    /// Times.
    #[must_use]
    pub fn timers(&self) -> &Timers {
        &self.bench.timers
    }

    /// Whether messages of Edition 2.5 are sent and judged.
    #[must_use]
    pub fn of_edition_25(&self) -> bool {
        self.bench.net.dialect().is_some()
    }

    /// Whether rules that fly are released.
    #[must_use]
    pub fn may_fly(&self) -> bool {
        self.bench
            .flight_released
            .load(std::sync::atomic::Ordering::SeqCst)
    }

    /// Whether the vehicle is a simulated one, which nothing can hurt.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        let simulated = &self.bench.simulated;
        simulated.load(std::sync::atomic::Ordering::SeqCst)
    }

    /// Waits.
    ///
    /// # Errors
    /// The operator stopped the run.
    pub fn pause(&self, time: Duration) -> Judged {
        self.bench.net.pause(time);
        if self.bench.net.interrupted() {
            Err(Stop::Interrupted)
        } else {
            Ok(())
        }
    }

    /// The vehicle that is judged.
    ///
    /// # Errors
    /// None was offered.
    pub fn vehicle(&self) -> Judged<Id> {
        let survey = self.bench.surveyed()?;
        survey.vehicle().map(|vehicle| vehicle.id).ok_or_else(|| {
            Stop::not_applicable("no vehicle was offered, and the profile names none")
        })
    }

    /// A station with this id, from a port of its own.
    ///
    /// # Errors
    /// There is no vehicle, or no socket.
    pub fn station(&self, id: Id) -> Judged<Player> {
        let station = Rc::new(Station::new(&self.bench, id, self.vehicle()?)?);
        self.players.borrow_mut().push(station.clone());
        Ok(station)
    }

    fn nth(&self, index: usize, levels: i64, what: &str) -> Judged<Player> {
        let mut found = self.bench.surveyed()?.with(levels);
        found.retain(|cucs| self.plays(cucs));
        match found.get(index) {
            Some(cucs) => self.station(cucs.id),
            None => Err(Stop::not_applicable(format!(
                "needs {what}; the subject knows {} such ids of the profile",
                found.len()
            ))),
        }
    }

    /// CUCS A: may have LOI 4, holds nothing.
    ///
    /// # Errors
    /// No id may.
    pub fn a(&self) -> Judged<Player> {
        self.nth(0, loi::LOI4, "a CUCS id that may have LOI 4")
    }

    /// CUCS B: another that may have LOI 4, holds nothing.
    ///
    /// # Errors
    /// No second id may.
    pub fn b(&self) -> Judged<Player> {
        self.nth(1, loi::LOI4, "a second CUCS id that may have LOI 4")
    }

    /// The first and the second CUCS that may have LOI 3.
    ///
    /// # Errors
    /// There are not two.
    pub fn payload_pair(&self) -> Judged<(Player, Player)> {
        let levels = loi::LOI3 | loi::LOI4;
        let what = "two CUCS ids that may have LOI 3 and 4";
        Ok((self.nth(0, levels, what)?, self.nth(1, levels, what)?))
    }

    /// CUCS C: any third id that is known.
    ///
    /// # Errors
    /// There is none.
    pub fn c(&self) -> Judged<Player> {
        let survey = self.bench.surveyed()?;
        let taken: Vec<Id> = survey
            .with(loi::LOI4)
            .iter()
            .take(2)
            .map(|cucs| cucs.id)
            .collect();
        let third = survey.cucs.iter().find(|cucs| !taken.contains(&cucs.id));
        third.map_or_else(
            || Err(Stop::not_applicable("needs a third CUCS id")),
            |cucs| self.station(cucs.id),
        )
    }

    /// Any known CUCS, for rules that need no right.
    ///
    /// # Errors
    /// There is none.
    pub fn any(&self) -> Judged<Player> {
        let survey = self.bench.surveyed()?;
        let mut found = survey.with(loi::LOI4);
        found.extend(&survey.cucs);
        let found = found.into_iter().find(|cucs| self.plays(cucs));
        match found.map(|cucs| cucs.id) {
            Some(id) => self.station(id),
            None => Err(Stop::inconclusive(
                "the subject offers LOI 0 to every CUCS id that was tried; name an id that it knows in the profile",
            )),
        }
    }

    /// The first id that `wanted` accepts.
    ///
    /// # Errors
    /// There is none: `what` is named.
    pub fn find(&self, what: &str, wanted: impl Fn(&CucsFound) -> bool) -> Judged<Player> {
        let found = self
            .bench
            .surveyed()?
            .cucs
            .iter()
            .find(|cucs| wanted(cucs))
            .map(|cucs| cucs.id);
        found.map_or_else(
            || Err(Stop::not_applicable(format!("needs {what}"))),
            |id| self.station(id),
        )
    }

    /// A CUCS id that the subject cannot know.
    ///
    /// # Errors
    /// There is no socket.
    pub fn stranger(&self) -> Judged<Player> {
        let known: Vec<Id> = self
            .bench
            .surveyed()?
            .cucs
            .iter()
            .map(|cucs| cucs.id)
            .collect();
        let id = (0x1b00_7701..)
            .map(Id)
            .find(|id| !known.contains(id))
            .unwrap_or(Id(0x1b00_7701));
        self.station(id)
    }

    /// CUCS A with LOI 2 and 4.
    ///
    /// # Errors
    /// Inconclusive where it is not granted.
    pub fn controller(&self) -> Judged<Player> {
        let a = self.a()?;
        self.grant(&a, loi::LOI2 | loi::LOI4)?;
        Ok(a)
    }

    /// CUCS A with LOI 2, 4 and 5.
    ///
    /// # Errors
    /// Inconclusive where it is not granted, not applicable where no id may have LOI 5.
    pub fn launcher(&self) -> Judged<Player> {
        let a = self.nth(0, loi::LOI4 | loi::LOI5, "a CUCS id that may have LOI 5")?;
        self.grant(&a, loi::LOI2 | loi::LOI4 | loi::LOI5)?;
        Ok(a)
    }

    /// A CUCS with LOI 2 only.
    ///
    /// # Errors
    /// Inconclusive where it is not granted.
    pub fn monitor(&self) -> Judged<Player> {
        let station = self.any()?;
        self.grant(&station, loi::LOI2)?;
        Ok(station)
    }

    /// Gives a station these levels, as a precondition.
    ///
    /// # Errors
    /// Inconclusive where they are not granted.
    pub fn grant(&self, station: &Station, levels: i64) -> Judged {
        station
            .take(levels)
            .precondition("control is granted")
            .map(|_| ())
    }

    /// Everything received in this trial that `wanted` accepts, by any station.
    #[must_use]
    pub fn all_received(&self, mut wanted: impl FnMut(&Seen) -> bool) -> Vec<Arc<Seen>> {
        let recording = self.bench.net.recording();
        recording.datagrams[self.mark..]
            .iter()
            .filter(|datagram| datagram.direction == Direction::Received)
            .flat_map(|datagram| &datagram.messages)
            .filter(|seen| wanted(seen))
            .cloned()
            .collect()
    }

    /// Releases what the stations hold, and cancels what they scheduled.
    ///
    /// # Errors
    /// A release is not confirmed.
    pub fn clean_up(&self) -> Judged {
        let sent: Vec<(usize, i64)> = {
            let recording = self.bench.net.recording();
            let messages = recording.datagrams[self.mark..]
                .iter()
                .flat_map(|datagram| &datagram.messages);
            messages
                .filter(|seen| seen.direction == Direction::Sent && seen.kind() == 17001)
                .filter(|seen| seen.raw("Frequency").is_some_and(|hertz| hertz > 0))
                .map(|seen| {
                    (
                        seen.socket,
                        seen.raw("Requested Message Type").unwrap_or_default(),
                    )
                })
                .collect()
        };
        let known: Vec<Id> = self
            .bench
            .surveyed()?
            .cucs
            .iter()
            .map(|cucs| cucs.id)
            .collect();
        let mut released = Vec::new();
        // Newest first: an id's rights are bound to the latest socket that used it.
        for player in self.players.borrow().iter().rev() {
            for (_, kind) in sent.iter().filter(|(socket, _)| *socket == player.socket()) {
                player.send(
                    Draft::new(17001)
                        .raw("Requested Message Type", *kind)
                        .raw("Frequency", 0),
                );
            }
            if released.contains(&player.id) || !known.contains(&player.id) {
                continue;
            }
            released.push(player.id);
            let answer = player.release()?;
            if answer.raw("LOI Granted").unwrap_or_default() & 0x0F != 0 {
                // Some subjects confirm a release before they carry it out, so its effect is checked.
                let answer = player.release()?;
                let granted = answer.raw("LOI Granted").unwrap_or_default();
                if granted & 0x0F != 0 {
                    return Err(Stop::fail(format!(
                        "{} still holds LOI 0x{granted:02x} after its release",
                        player.id
                    )));
                }
            }
        }
        Ok(())
    }
}

impl Deref for Trial {
    type Target = Remarks<Seen>;

    fn deref(&self) -> &Self::Target {
        &self.remarks
    }
}
