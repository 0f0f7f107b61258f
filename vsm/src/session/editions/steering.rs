//! Modes and demands: #41, #42, #43 and #48 become 2017 and 2016.
//!
//! Edition 4 commands a mode and its values by one message in which a field that is not commanded is absent. Edition 2.5
//! has the mode in #42, the values in #43 and the loiter in #41, each with all fields always there, and #48 says which of
//! them rules (tables B1-22 and B1-23):
//!
//! | mode | #48 says 0, configuration | #48 says 1 or 2, manual |
//! |---|---|---|
//! | 11 | altitude and speed are the route's (#802) | those of #43 |
//! | 12 | altitude and speed of #41; the place is where the vehicle is | those of #43, and its loiter position |
//! | 15 and others | those of #43 | those of #43 |
//!
//! So a #43 changes the flight at once where it rules in the mode that the vehicle shows: in 15, and in 11 and 12 with #48.
//! Else it is kept for the #42 that follows it, once: a demand from before the last #42 moves nothing. Within a #43 count an
//! altitude and a heading whose command type is not 0, a speed and an altimeter setting that are not 0, and a waypoint of
//! 1 to 65534 that is another than before, and another than the vehicle flies to. #48 preference 1 falls back to 0 when
//! a waypoint is reached.

use stanag_msgs::Message;
use stanag_msgs::ed25::Record;
use stanag_msgs::ed25::record::ed4;
use stanag_msgs::enums::LoiBitmap;
use stanag_msgs::messages::{LoiterConfiguration, VehicleOperatingModeCommand};

use super::form::{Refusal, clear_unused_of_loiter, to};

/// What a station steers one vehicle by.
#[derive(Debug, Default)]
pub(crate) struct Steering {
    /// LOI 4 and 5 that it holds.
    control: LoiBitmap,
    /// The mode that 3001 has reported last.
    shown: Option<u8>,
    /// The waypoint that the vehicle flies to.
    to: Option<u16>,
    /// The last #42: its mode, and its stamp.
    commanded: Option<(u8, f64)>,
    /// The last #43, and whether nothing was made of it yet.
    demand: Option<(Record, bool)>,
    /// The last #41.
    loiter: Option<Record>,
    /// The last #48: altitude, speed, course and heading.
    preference: [u8; 3],
}

/// A command, and what it changes here once it is taken.
pub(crate) struct Order {
    pub(crate) message: Message,
    pub(crate) latch: Latch,
    /// What of it has no effect now.
    pub(crate) notice: Option<String>,
}

/// What a command changes here.
#[derive(Debug, Clone)]
pub(crate) enum Latch {
    Mode(u8, f64),
    /// #43; whether something was made of it.
    Demand(Record, bool),
    Loiter(Record),
    Preference([u8; 3]),
}

impl Steering {
    /// #41, #42, #43 or #48.
    pub(super) fn order(&self, record: &Record) -> Result<Order, Refusal> {
        match record.id() {
            41 => {
                let mut loiter = record.clone();
                // Fields 9 to 12, altitude and speed, have no place in 2017: they go with mode 12.
                clear_unused_of_loiter(&mut loiter, 4, 5);
                Ok(Order {
                    message: to(&loiter, LoiterConfiguration::ID)?,
                    latch: Latch::Loiter(record.clone()),
                    notice: None,
                })
            }
            42 => self.mode(record),
            48 => preference(record),
            _ => self.demand(record),
        }
    }

    fn mode(&self, record: &Record) -> Result<Order, Refusal> {
        let mode = record.whole(4) as u8;
        match mode {
            MANUAL => {
                return Err(Refusal::new(
                    "not supported",
                    "mode 2 is flown by sticks, which Edition 2.5 does not have: command mode 15",
                ));
            }
            1 | 3..=10 | 13 | 14 | 18 | 23..=31 => {
                let why = format!("Select Flight Path Control Mode {mode} is reserved");
                return Err(Refusal::new("out of range", why));
            }
            _ => {}
        }
        let mut command = whole(record)?;
        let demand = self.demand.as_ref().filter(|(_, fresh)| *fresh);
        self.rule(mode, demand.map(|(demand, _)| demand), &mut command);
        if mode == LOITER {
            self.configured(&mut command);
        }
        if let Some((demand, _)) = demand.filter(|_| mode == WAYPOINT) {
            name_waypoint(demand, &mut command);
        }
        Ok(Order {
            message: command.message()?,
            latch: Latch::Mode(mode, record.number(1).unwrap_or_default()),
            notice: None,
        })
    }

    /// #43.
    fn demand(&self, record: &Record) -> Result<Order, Refusal> {
        let seconds = record.number(1).unwrap_or_default();
        // A mode that was just commanded and is not shown yet: Edition 4 wants it named again.
        let entered = self.commanded.filter(|(mode, at)| {
            [WAYPOINT, LOITER, AUTOPILOT].contains(mode)
                && self.shown != Some(*mode)
                && (0.0..ENTERED_WITHIN_S).contains(&(seconds - at))
        });
        let mode = entered.map(|(mode, _)| mode).or(self.shown);
        let mut command = Record::new(&VehicleOperatingModeCommand::INFO);
        command.set(1, seconds);
        // The altimeter setting is kept whatever the mode.
        if let Some(pascal) = record.number(16).filter(|pascal| *pascal > 0.0) {
            command.set(16, pascal);
        }
        let mut notice = None;
        if let Some(mode @ (AUTOPILOT | WAYPOINT | LOITER)) = mode {
            self.rule(mode, Some(record), &mut command);
            if mode == WAYPOINT && self.is_new_waypoint(record) {
                name_waypoint(record, &mut command);
            }
            if mode == LOITER && self.preference[2] == 0 && has_place(record) {
                notice = Some(
                    "#43: Loiter Position is not flown to while #48 says configuration for course"
                        .to_owned(),
                );
            }
        }
        let acts = (2..=23).any(|field| field != 16 && command.number(field).is_some());
        if let Some((mode, _)) = entered.filter(|_| acts) {
            command.set(2, mode);
        }
        Ok(Order {
            message: command.message()?,
            latch: Latch::Demand(record.clone(), acts),
            notice: notice.filter(|_| self.place_is_new(record)),
        })
    }

    /// What of a #43 rules in a mode.
    fn rule(&self, mode: u8, demand: Option<&Record>, command: &mut Record) {
        let Some(demand) = demand else {
            return;
        };
        let configured = matches!(mode, WAYPOINT | LOITER);
        let [altitude, speed, course] = self.preference.map(|mode| !configured || mode != 0);
        let mut copy = |from: u8, to: u8| {
            if let Some(value) = demand.number(from) {
                command.set(to, value);
            }
        };
        let kind = demand.whole(4);
        if altitude && kind != 0 {
            copy(4, 3);
            copy(17, 17);
            if kind != 2 {
                copy(5, 4);
            }
            if kind != 1 {
                copy(6, 5);
            }
        }
        if speed && demand.number(13).is_some_and(|speed| speed > 0.0) {
            copy(13, 13);
            copy(14, 14);
        }
        let heading = demand.whole(7);
        // In mode 12 no course is valid; in 11 it is, by #48, and refused by what flies the vehicle.
        if course && heading != 0 && mode != LOITER {
            copy(7, 6);
            let values: &[(u8, u8)] = match heading {
                1 => &[(8, 8)],
                2 => &[(9, 9)],
                3 => &[(8, 8), (9, 9)],
                4 => &[(12, 12)],
                _ => &[],
            };
            for (from, to) in values {
                copy(*from, *to);
            }
            // 0 is the rate that the vehicle has, but where the rate itself is commanded.
            if heading == 5 || demand.number(10).is_some_and(|rate| rate != 0.0) {
                copy(10, 10);
            }
            if heading == 4 && demand.number(11).is_some_and(|rate| rate != 0.0) {
                copy(11, 11);
            }
        }
        if mode == LOITER && course && has_place(demand) {
            copy(18, 18);
            copy(19, 19);
        }
    }

    /// Altitude and speed of #41, for mode 12.
    fn configured(&self, command: &mut Record) {
        let Some(loiter) = &self.loiter else {
            return;
        };
        let [altitude, speed, _] = self.preference;
        if let (0, Some(metres)) = (altitude, loiter.number(9)) {
            command.set(3, 1);
            command.set(4, metres);
            command.set(17, loiter.whole(10));
        }
        if let (0, Some(m_s)) = (speed, loiter.number(11).filter(|m_s| *m_s > 0.0)) {
            command.set(13, m_s);
            command.set(14, loiter.whole(12));
        }
    }

    fn is_new_waypoint(&self, demand: &Record) -> bool {
        let number = demand.whole(15) as u16;
        let before = self
            .demand
            .as_ref()
            .map(|(before, _)| before.whole(15) as u16);
        before != Some(number) && self.to != Some(number)
    }

    fn place_is_new(&self, demand: &Record) -> bool {
        let place = |one: &Record| [18, 19].map(|field| one.number(field));
        self.demand
            .as_ref()
            .is_none_or(|(before, _)| place(before) != place(demand))
    }

    /// A command was taken of the station that controls the vehicle. True where #109 has something new to say.
    pub(super) fn accept(&mut self, latch: Latch) -> bool {
        match latch {
            Latch::Mode(mode, seconds) => {
                self.commanded = Some((mode, seconds));
                if let Some((_, fresh)) = &mut self.demand {
                    *fresh = false;
                }
            }
            Latch::Demand(demand, acted) => {
                self.demand = Some((demand, !acted));
            }
            Latch::Loiter(loiter) => self.loiter = Some(loiter),
            Latch::Preference(preference) => {
                self.preference = preference;
                return true;
            }
        }
        false
    }

    /// #21: what it demanded before it lost or won control counts no more. True where it did either.
    pub(super) fn granted(&mut self, levels: LoiBitmap) -> bool {
        let both = LoiBitmap::LOI4.union(LoiBitmap::LOI5);
        let control = LoiBitmap::from_raw(levels.raw() & both.raw());
        let changed = control.is_empty() != self.control.is_empty();
        if changed {
            let (shown, to) = (self.shown, self.to);
            *self = Steering {
                shown,
                to,
                ..Steering::default()
            };
        }
        self.control = control;
        changed
    }

    /// 3001.
    pub(super) fn shows(&mut self, mode: Option<u8>) {
        self.shown = mode;
    }

    /// 4001: true where a preference ends because a waypoint was reached.
    pub(super) fn flies_to(&mut self, number: Option<u16>) -> bool {
        let reached = self.to.is_some() && number.is_some() && number != self.to;
        self.to = number;
        let ends = reached && self.shown == Some(WAYPOINT) && self.preference.contains(&1);
        if ends {
            for mode in self.preference.iter_mut().filter(|mode| **mode == 1) {
                *mode = 0;
            }
        }
        ends
    }

    /// For #109.
    pub(super) fn preference(&self) -> [u8; 3] {
        self.preference
    }
}

/// #48: a 2016 that commands nothing goes before it, so that the rules of all commands hold for it.
fn preference(record: &Record) -> Result<Order, Refusal> {
    let preference = [4, 5, 6].map(|field| record.whole(field) as u8);
    if let Some(mode) = preference.iter().find(|mode| **mode > 2) {
        let why = format!("mode preference {mode}, expected 0 to 2");
        return Err(Refusal::new("out of range", why));
    }
    Ok(Order {
        message: whole(record)?.message()?,
        latch: Latch::Preference(preference),
        notice: None,
    })
}

/// A 2016 with what a record has for it.
fn whole(record: &Record) -> Result<Record, Refusal> {
    let info = ed4(VehicleOperatingModeCommand::ID).unwrap_or(&VehicleOperatingModeCommand::INFO);
    let mut command = record.to_ed4(info)?;
    if let Some(seconds) = record.number(1) {
        command.set(1, seconds);
    }
    Ok(command)
}

fn name_waypoint(demand: &Record, command: &mut Record) {
    if let number @ 1..=65_534 = demand.whole(15) {
        command.set(15, number);
    }
}

/// 0, 0 is how a place that is not meant is filled.
fn has_place(demand: &Record) -> bool {
    [18, 19]
        .iter()
        .any(|field| demand.number(*field).is_some_and(|angle| angle != 0.0))
}

const MANUAL: u8 = 2;
const WAYPOINT: u8 = 11;
const LOITER: u8 = 12;
const AUTOPILOT: u8 = 15;
/// A mode is entered within this time, or was refused.
const ENTERED_WITHIN_S: f64 = 5.0;
