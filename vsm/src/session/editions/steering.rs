//! Modes and demands: #41, #42, #43 and #48 become 2017 and 2016.
//!
//! Edition 4 commands a mode and its values by one message, in which a field that is not commanded is absent. Edition 2.5
//! has the mode in #42, the values in #43 and the loiter in #41, each with all its fields always present. #48 decides which
//! of them rules (tables B1-22 and B1-23):
//!
//! | mode | #48 says 0, configuration | #48 says 1 or 2, manual |
//! |---|---|---|
//! | 11 | altitude and speed are the route's (#802) | those of #43 |
//! | 12 | altitude and speed of #41; the place is where the vehicle is | those of #43, and its loiter position |
//! | 15 | those of #43 | those of #43 |
//! | 20, 21 | the altitude of #43 | the altitude of #43 |
//! | others | none | none |
//!
//! So a #43 changes the flight at once if it rules in the mode that the vehicle shows: in 15, and by #48 in 11 and 12, but
//! on the ground in none. What does not rule is kept once, for the next #42: a demand from before the last #42 moves
//! nothing. A station may send the pair either way round. After its #42 a #43 belongs to that mode. Just before one it
//! belongs to the mode that follows: there its values rule again, though the mode shown has used them, and both are answered
//! together ([`Order::takes_demand`]). These values of a #43
//! count: an altitude and a heading whose command type is not 0, a speed and an altimeter setting that are not 0, and a
//! waypoint of 1 to 65534 that differs from the one before and from the one that the vehicle flies to. Preference 1 of #48
//! falls back to 0 when a waypoint is reached, and in mode 12 when the vehicle is at the loiter position of the #43
//! (without such a position it is at its loiter point and goes to none). It is accepted again only after another preference
//! was commanded.
//!
//! A station repeats its last #43 all the time, also in modes that do not use it. So a landing uses nothing of it: a
//! heading in it would have the landing refused. A wave-off uses an altitude only if that has changed since the last #42,
//! since an older one may lie below the vehicle.

use mapping::limits::metres;
use stanag_msgs::Message;
use stanag_msgs::ed25::Record;
use stanag_msgs::ed25::record::ed4;
use stanag_msgs::enums::LoiBitmap;
use stanag_msgs::messages::{LoiterConfiguration, VehicleOperatingModeCommand};

use super::form::{Refusal, clear_unused_of_loiter, new, to};

/// The state of a station's steering of one vehicle.
#[derive(Debug, Default)]
pub(crate) struct Steering {
    /// LOI 4 and 5 that it holds.
    control: LoiBitmap,
    /// The mode that 3001 last reported.
    shown: Option<u8>,
    /// It is on the ground.
    stands: bool,
    /// The waypoint that the vehicle flies to.
    to: Option<u16>,
    /// The stamp of the last #42 that was not refused.
    mode_at: Option<f64>,
    /// The modes of the last #42s, and their stamps, until the vehicle shows the last of them, or changes to a mode that
    /// none of them has commanded.
    commanded: Vec<(u8, f64)>,
    /// The last #43.
    demand: Option<Demand>,
    /// The last #41.
    loiter: Option<Record>,
    /// A #42 has commanded mode 12.
    has_loitered: bool,
    /// The last #48: altitude, speed, course and heading.
    preference: [u8; 3],
    /// Which of them were 1, have fallen back, and have not been set to anything else since.
    fallen_back: [bool; 3],
}

/// A command, and the change of this state once it is accepted.
pub(crate) struct Order {
    pub(crate) message: Message,
    pub(crate) latch: Latch,
    /// What of it has no effect now, for the operator.
    pub(crate) notice: Option<String>,
    /// It is a #42 that has the values of the #43 just before it, so that the two are one command.
    pub(crate) takes_demand: bool,
}

/// A #43, and what of it the next #42 may use.
#[derive(Debug, Clone)]
pub(crate) struct Demand {
    record: Record,
    /// What of it has not changed the flight yet.
    rest: Record,
    /// It has changed the flight in the mode that was shown.
    acted: bool,
    /// No #42 came just before it: it may be the values of one just after it.
    leads: bool,
    /// No #42 has followed.
    fresh: bool,
    /// Its waypoint differs from the one before, and no #42 has followed.
    waypoint: bool,
    /// The same for its altitude.
    altitude: bool,
}

impl Demand {
    /// Whether it may be the values of a #42 with this stamp.
    fn leads_to(&self, seconds: f64) -> bool {
        let since = seconds - self.record.number(1).unwrap_or_default();
        self.leads && (0.0..ONE_COMMAND_S).contains(&since)
    }

    /// Its values for a #42 with this mode.
    fn values(&self, mode: u8, seconds: f64) -> Record {
        let mut values = if self.leads_to(seconds) {
            self.record.clone()
        } else {
            self.rest.clone()
        };
        // A route is refused with an altitude or a heading. One that repeats its demands in another mode goes on to fly it.
        if self.acted && mode == WAYPOINT {
            values.set(4, 0);
            values.set(7, 0);
        }
        values
    }
}

/// The change that a command makes to this state.
#[derive(Debug, Clone)]
pub(crate) enum Latch {
    Mode(u8, f64),
    Demand(Demand),
    Loiter(Record),
    Preference([u8; 3]),
}

impl Steering {
    /// #41, #42, #43 or #48.
    pub(super) fn order(&self, record: &Record) -> Result<Order, Refusal> {
        match record.id() {
            41 => {
                let mut loiter = record.clone();
                // Fields 9 to 12, altitude and speed, have no place in 2017: the 2016 of mode 12 carries them.
                clear_unused_of_loiter(&mut loiter, 4, 5);
                let absent = |of: &Record| of.number(9) == Some(0.0);
                let is_new = !self.loiter.as_ref().is_some_and(absent);
                Ok(Order {
                    message: to(&loiter, LoiterConfiguration::ID)?,
                    latch: Latch::Loiter(record.clone()),
                    notice: (absent(record) && is_new).then(|| NO_LOITER_ALTITUDE.to_owned()),
                    takes_demand: false,
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
                    "mode 2 (manual) is flown by sticks, which Edition 2.5 does not have: command mode 15 (autopilot)",
                ));
            }
            1 | 3..=10 | 13 | 14 | 18 | 23..=31 => {
                let why = format!("Select Flight Path Control Mode {mode} is reserved");
                return Err(Refusal::new("out of range", why));
            }
            _ => {}
        }
        let mut command = whole(record)?;
        let demand = self.demand.as_ref();
        let demand = demand.filter(|one| one.fresh && (mode != WAVE_OFF || one.altitude));
        let seconds = record.number(1).unwrap_or_default();
        let mut takes_demand = false;
        if let Some(demand) = demand {
            self.rule(mode, &demand.values(mode, seconds), &mut command);
            let rules = |(place, _): &(u8, u8)| command.number(*place).is_some();
            takes_demand = demand.leads_to(seconds) && USED_BY.iter().any(rules);
        }
        if mode == LOITER {
            self.configured(&mut command);
        }
        if let Some(demand) = demand.filter(|one| mode == WAYPOINT && one.waypoint) {
            name_waypoint(&demand.record, &mut command);
        }
        // That of before a restart of the VSM is not known.
        let unconfigured = self.loiter.is_none() && self.preference[0] == 0;
        let notice = (mode == LOITER && unconfigured && !self.has_loitered)
            .then(|| NO_LOITER_CONFIGURATION.to_owned());
        Ok(Order {
            message: command.message()?,
            latch: Latch::Mode(mode, seconds),
            notice,
            takes_demand,
        })
    }

    /// #43.
    fn demand(&self, record: &Record) -> Result<Order, Refusal> {
        let seconds = record.number(1).unwrap_or_default();
        // A mode was just commanded and is not shown yet: Edition 4 needs it named again. A loiter is entered again
        // although the vehicle shows it: otherwise a place that follows at once would reach a vehicle that is still
        // stopping, and be refused.
        let entered = self.commanded.last().copied().filter(|(mode, at)| {
            [WAYPOINT, LOITER, AUTOPILOT].contains(mode)
                && (0.0..ENTERED_WITHIN_S).contains(&(seconds - at))
                && (!self.stands || *mode == WAYPOINT)
        });
        // On the ground nothing is flown in the mode that is shown: its values are those of the launch that follows.
        let shown = self.shown.filter(|_| !self.stands);
        let mode = entered.map(|(mode, _)| mode).or(shown);
        let mut command = Record::new(&VehicleOperatingModeCommand::INFO);
        command.set(1, seconds);
        // The altimeter setting applies in every mode.
        if let Some(pascal) = record.number(16).filter(|pascal| *pascal > 0.0) {
            command.set(16, pascal);
        }
        let mut notice = None;
        if let Some(mode @ (AUTOPILOT | WAYPOINT | LOITER)) = mode {
            self.rule(mode, record, &mut command);
            if mode == WAYPOINT && self.changes(record, &[15]) && !self.flies_there(record) {
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
        let mut rest = record.clone();
        let used = |place: u8| command.number(place).is_some();
        for (_, field) in USED_BY.iter().filter(|(place, _)| used(*place)) {
            rest.set(*field, 0);
        }
        let before = self.demand.as_ref();
        let belongs = |at: f64| (0.0..ONE_COMMAND_S).contains(&(seconds - at));
        let demand = Demand {
            record: record.clone(),
            rest,
            acted: acts,
            leads: entered.is_none() && !self.mode_at.is_some_and(belongs),
            fresh: true,
            // In mode 11 it was either commanded now or is not used.
            waypoint: mode != Some(WAYPOINT)
                && (self.changes(record, &[15]) || before.is_some_and(|one| one.waypoint)),
            altitude: self.changes(record, &[4, 5, 6, 17])
                || before.is_some_and(|one| one.altitude),
        };
        Ok(Order {
            message: command.message()?,
            latch: Latch::Demand(demand),
            notice: notice.filter(|_| self.changes(record, &[18, 19])),
            takes_demand: false,
        })
    }

    /// Adds the values of a #43 that rule in a mode.
    fn rule(&self, mode: u8, demand: &Record, command: &mut Record) {
        let [altitude, speed, course] = match mode {
            WAYPOINT | LOITER => self.preference.map(|mode| mode != 0),
            AUTOPILOT => [true; 3],
            WAVE_OFF | LAUNCH => [true, false, false],
            _ => [false; 3],
        };
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
        // In mode 12 no course is valid. In mode 11 it is, by #48; the flight machine refuses it.
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
            // 0 means the vehicle's own rate, except if the rate itself is commanded.
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
        // 0 means no altitude, as for a speed.
        let metres = loiter.number(9).filter(|metres| *metres != 0.0);
        if let (0, Some(metres)) = (altitude, metres) {
            command.set(3, 1);
            command.set(4, metres);
            command.set(17, loiter.whole(10));
        }
        if let (0, Some(m_s)) = (speed, loiter.number(11).filter(|m_s| *m_s > 0.0)) {
            command.set(13, m_s);
            command.set(14, loiter.whole(12));
        }
    }

    /// Whether one of these fields of a #43 differs from the #43 before it.
    fn changes(&self, demand: &Record, fields: &[u8]) -> bool {
        let differs = |before: &Demand| {
            let mut fields = fields.iter();
            fields.any(|field| before.record.number(*field) != demand.number(*field))
        };
        self.demand.as_ref().is_none_or(differs)
    }

    fn flies_there(&self, demand: &Record) -> bool {
        self.to == Some(demand.whole(15) as u16)
    }

    /// A command of the station in control was accepted, and perhaps refused for what it commands. Returns true if #109 has
    /// changed.
    pub(super) fn accept(&mut self, latch: Latch, refused: bool) -> bool {
        match latch {
            Latch::Mode(mode, seconds) => {
                self.has_loitered |= mode == LOITER;
                // A #43 must not name a mode that is not entered.
                if !refused {
                    self.mode_at = Some(seconds);
                    let is_fresh =
                        |(_, at): &(u8, f64)| (0.0..ENTERED_WITHIN_S).contains(&(seconds - at));
                    self.commanded.retain(is_fresh);
                    let again =
                        self.commanded.is_empty() && self.shown == Some(mode) && mode != LOITER;
                    // If it was left and commanded again before the vehicle has shown another mode, it is being entered.
                    if !again {
                        self.commanded.truncate(MAX_COMMANDED);
                        self.commanded.push((mode, seconds));
                    }
                }
                if let Some(demand) = &mut self.demand {
                    (demand.fresh, demand.waypoint, demand.altitude) = (false, false, false);
                }
            }
            Latch::Demand(mut demand) => {
                // Refused values must not have a hold refused later. In mode 11 they are often refused for the mode alone.
                if refused && demand.acted {
                    demand.leads &= self.shown == Some(WAYPOINT);
                    demand.fresh = demand.leads;
                    demand.rest = new(demand.record.id());
                }
                self.demand = Some(demand);
            }
            Latch::Loiter(loiter) => self.loiter = Some(loiter),
            Latch::Preference(preference) => {
                let each = self.preference.iter_mut().zip(&mut self.fallen_back);
                for ((now, fallen_back), commanded) in each.zip(preference) {
                    *fallen_back &= commanded == UNTIL_REACHED;
                    *now = if *fallen_back { 0 } else { commanded };
                }
                return true;
            }
        }
        false
    }

    /// #21: demands from before it lost or gained control no longer apply.
    pub(super) fn granted(&mut self, levels: LoiBitmap) {
        let both = LoiBitmap::LOI4.union(LoiBitmap::LOI5);
        let control = LoiBitmap::from_raw(levels.raw() & both.raw());
        if control.is_empty() != self.control.is_empty() {
            let (shown, stands, to) = (self.shown, self.stands, self.to);
            *self = Steering {
                shown,
                stands,
                to,
                ..Steering::default()
            };
        }
        self.control = control;
    }

    /// The mode that the vehicle reports.
    ///
    /// A commanded mode is named again until it is shown. Once it was shown, or the vehicle has changed to another mode, a
    /// pilot or a failsafe has decided since: a #43 must not lead back.
    pub(super) fn shows(&mut self, mode: Option<u8>) {
        if self.shown != mode {
            let mut commanded = self.commanded.iter();
            match commanded.position(|(wanted, _)| mode == Some(*wanted)) {
                // A mode on the way to the last one is shown late: it was already left.
                Some(at) => drop(self.commanded.drain(..=at)),
                None if self.shown.is_some() => self.commanded.clear(),
                None => {}
            }
        }
        self.shown = mode;
    }

    /// Whether the vehicle has reported that it is on the ground.
    pub(super) fn stands(&mut self, stands: bool) {
        self.stands = stands;
    }

    /// 4001: returns true if a preference ends because a waypoint was reached.
    pub(super) fn flies_to(&mut self, number: Option<u16>) -> bool {
        // 65535 is a commanded loiter place, not a waypoint that was reached.
        if number == Some(65_535) {
            return false;
        }
        let reached = self.to.is_some() && number.is_some() && number != self.to;
        self.to = number;
        reached && self.shown == Some(WAYPOINT) && self.fall_back()
    }

    /// 4000: returns true if a preference ends because the loiter position of the #43 is reached.
    pub(super) fn is_at(&mut self, latitude_rad: f64, longitude_rad: f64) -> bool {
        let demand = self.demand.as_ref().map(|demand| &demand.record);
        let demand = demand.filter(|_| self.shown == Some(LOITER) && self.preference[2] != 0);
        let Some((place_rad, to_rad)) = demand
            .filter(|demand| has_place(demand))
            .and_then(|demand| demand.number(18).zip(demand.number(19)))
        else {
            return false;
        };
        // On a circle the vehicle never comes closer than the radius.
        let radius_m = self.loiter.as_ref().and_then(|loiter| loiter.number(5));
        let near_m = AT_ITS_PLACE_M + 1.2 * radius_m.unwrap_or(0.0);
        let degrees =
            |(latitude, longitude): (f64, f64)| (latitude.to_degrees(), longitude.to_degrees());
        let away_m = metres(
            degrees((latitude_rad, longitude_rad)),
            degrees((place_rad, to_rad)),
        );
        away_m < near_m && self.fall_back()
    }

    /// The waypoint or the loiter point is reached: preferences until then end. Returns true if there were any.
    fn fall_back(&mut self) -> bool {
        let ends = self.preference.contains(&UNTIL_REACHED);
        for (mode, fallen_back) in self.preference.iter_mut().zip(&mut self.fallen_back) {
            if *mode == UNTIL_REACHED {
                (*mode, *fallen_back) = (0, true);
            }
        }
        ends
    }

    /// For #109.
    pub(super) fn preference(&self) -> [u8; 3] {
        self.preference
    }
}

/// #48: becomes a 2016 that commands nothing, so that the rules of all commands apply to it.
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
        takes_demand: false,
    })
}

/// A 2016 with the fields that a record has for it.
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

/// 0, 0 means no place.
fn has_place(demand: &Record) -> bool {
    [18, 19]
        .iter()
        .any(|field| demand.number(*field).is_some_and(|angle| angle != 0.0))
}

/// Fields of a 2016 that a value of #43 becomes, and those of #43 that command it: 0 commands nothing.
const USED_BY: [(u8, u8); 5] = [(3, 4), (6, 7), (13, 13), (18, 18), (18, 19)];
/// Preference of #48: manual until the waypoint or loiter point.
const UNTIL_REACHED: u8 = 1;
/// Distance within which a vehicle counts as at its loiter position, m, in addition to the radius of its circle.
const AT_ITS_PLACE_M: f64 = 15.0;
/// Maximum number of modes commanded within the time in which one is entered.
const MAX_COMMANDED: usize = 8;
pub(super) const MANUAL: u8 = 2;
const WAYPOINT: u8 = 11;
const LOITER: u8 = 12;
const AUTOPILOT: u8 = 15;
const WAVE_OFF: u8 = 20;
const LAUNCH: u8 = 21;
const NO_LOITER_ALTITUDE: &str = "#41: Loiter Altitude 0 is not flown to: mode 12 (loiter) keeps the altitude that the vehicle has";
const NO_LOITER_CONFIGURATION: &str = "#42: mode 12 (loiter) keeps the altitude and the speed that the vehicle has: no #41 has been received since control was \
                                       gained, or since the start of this VSM";
/// Within this time a mode is entered or was refused.
const ENTERED_WITHIN_S: f64 = 5.0;
/// A #42 and a #43 within this time are one command. Longer, and a hold would take the values of a steering before it.
const ONE_COMMAND_S: f64 = 1.0;

#[cfg(test)]
mod tests {
    use stanag_msgs::scalar::Altitude;

    use super::*;

    /// A record of this type with these fields.
    fn record(id: u16, seconds: f64, fields: &[(u8, f64)]) -> Record {
        let mut record = new(id);
        record.set(1, 1.7e9 + seconds);
        for (field, value) in fields {
            record.set(*field, *value);
        }
        record
    }

    /// The 2016 of a record that is taken.
    fn take(steering: &mut Steering, record: &Record) -> VehicleOperatingModeCommand {
        let order = steering.order(record).expect("it is taken");
        steering.accept(order.latch, false);
        match order.message {
            Message::VehicleOperatingModeCommand(command) => command,
            other => panic!("{other:?}"),
        }
    }

    fn mode(steering: &mut Steering, mode: u8, seconds: f64) -> VehicleOperatingModeCommand {
        take(steering, &record(42, seconds, &[(4, f64::from(mode))]))
    }

    fn metres(command: &VehicleOperatingModeCommand) -> Option<f64> {
        command
            .commanded_altitude
            .map(|altitude: Altitude| altitude.si())
    }

    /// Altitude 20 m and heading 1.5 rad, as a station repeats them.
    const DEMAND: [(u8, f64); 5] = [(4, 1.0), (5, 20.0), (7, 1.0), (8, 1.5), (17, 2.0)];

    #[test]
    fn a_demand_that_stands_by_neither_turns_a_landing_nor_lowers_a_wave_off() {
        let mut steering = Steering::default();
        steering.shows(Some(15));
        take(&mut steering, &record(43, 0.0, &DEMAND));
        mode(&mut steering, LOITER, 1.0);
        steering.shows(Some(LOITER));
        take(&mut steering, &record(43, 2.0, &DEMAND));
        let land = mode(&mut steering, 19, 3.0);
        assert_eq!((land.heading_command_type, metres(&land)), (None, None));
        steering.shows(Some(19));
        take(&mut steering, &record(43, 4.0, &DEMAND));
        let up = mode(&mut steering, WAVE_OFF, 5.0);
        assert_eq!((up.heading_command_type, metres(&up)), (None, None));
        // Another altitude is a demand for it.
        steering.shows(Some(19));
        let mut higher = DEMAND;
        higher[1].1 = 60.0;
        take(&mut steering, &record(43, 6.0, &higher));
        take(&mut steering, &record(43, 6.5, &higher));
        let up = mode(&mut steering, WAVE_OFF, 7.0);
        assert_eq!((up.heading_command_type, metres(&up)), (None, Some(60.0)));
        // A launch takes the last one, also where it is that of the launch before.
        take(&mut steering, &record(43, 8.0, &higher));
        assert_eq!(metres(&mode(&mut steering, LAUNCH, 9.0)), Some(60.0));
    }

    /// A restart of the VSM forgets its altitude and its speed.
    #[test]
    fn a_loiter_without_a_configuration_is_named_once() {
        let notices = |steering: &mut Steering| -> Vec<bool> {
            let mut named = Vec::new();
            for seconds in [1.0, 10.0] {
                let loiter = record(42, seconds, &[(4, f64::from(LOITER))]);
                let order = steering.order(&loiter).expect("it is taken");
                named.push(order.notice.is_some_and(|text| text.contains("no #41")));
                steering.accept(order.latch, false);
            }
            named
        };
        assert_eq!(notices(&mut Steering::default()), [true, false]);
        let mut configured = Steering::default();
        let order = configured.order(&record(41, 0.0, &[(9, 50.0)]));
        configured.accept(order.expect("it is taken").latch, false);
        assert_eq!(notices(&mut configured), [false, false]);
    }

    #[test]
    fn a_waypoint_that_was_named_before_is_not_flown_back_to() {
        let mut steering = Steering::default();
        let third = [(15, 3.0)];
        steering.shows(Some(WAYPOINT));
        steering.flies_to(Some(1));
        let named = take(&mut steering, &record(43, 0.0, &third));
        assert_eq!(named.commanded_waypoint_number, Some(3));
        steering.flies_to(Some(3));
        steering.flies_to(Some(5));
        mode(&mut steering, LOITER, 1.0);
        steering.shows(Some(LOITER));
        take(&mut steering, &record(43, 2.0, &third));
        let resumed = mode(&mut steering, WAYPOINT, 3.0);
        assert_eq!(resumed.commanded_waypoint_number, None);
        // Another, however often it is repeated before the mode.
        mode(&mut steering, LOITER, 4.0);
        for at in [5.0, 5.5] {
            take(&mut steering, &record(43, at, &[(15, 2.0)]));
        }
        let other = mode(&mut steering, WAYPOINT, 6.0);
        assert_eq!(other.commanded_waypoint_number, Some(2));
    }

    #[test]
    fn a_demand_names_a_mode_only_while_that_is_being_entered() {
        let mut steering = Steering::default();
        steering.shows(Some(LOITER));
        mode(&mut steering, AUTOPILOT, 0.0);
        let early = take(&mut steering, &record(43, 0.5, &DEMAND));
        assert_eq!(
            early.select_flight_path_control_mode.map(|one| one.raw()),
            Some(15)
        );
        steering.shows(Some(AUTOPILOT));
        // The safety pilot takes over.
        steering.shows(Some(MANUAL));
        let late = take(&mut steering, &record(43, 4.0, &DEMAND));
        assert_eq!(late.select_flight_path_control_mode, None);
        assert_eq!((late.heading_command_type, metres(&late)), (None, None));
        // Before the mode was ever shown, too; and by a #42 that was refused nothing is entered.
        mode(&mut steering, AUTOPILOT, 10.0);
        steering.shows(Some(23));
        let returned = take(&mut steering, &record(43, 11.0, &DEMAND));
        assert_eq!(returned.select_flight_path_control_mode, None);
        let order = steering
            .order(&record(42, 20.0, &[(4, 15.0)]))
            .expect("it is made");
        steering.accept(order.latch, true);
        let after = take(&mut steering, &record(43, 20.5, &DEMAND));
        assert_eq!(after.select_flight_path_control_mode, None);
    }

    #[test]
    fn a_demand_names_the_last_of_several_modes_until_that_is_shown() {
        let named = |steering: &mut Steering, at: f64| {
            let command = take(steering, &record(43, at, &DEMAND));
            command.select_flight_path_control_mode.map(|one| one.raw())
        };
        // A hold that was commanded and left again before the vehicle showed it, whether it shows it late or never.
        for late in [false, true] {
            let mut steering = Steering::default();
            steering.shows(Some(AUTOPILOT));
            for (at, wanted) in [(0.0, LOITER), (0.2, AUTOPILOT)] {
                mode(&mut steering, wanted, at);
            }
            assert_eq!(named(&mut steering, 0.4), Some(15));
            if late {
                steering.shows(Some(LOITER));
                assert_eq!(named(&mut steering, 0.6), Some(15));
                steering.shows(Some(AUTOPILOT));
                assert_eq!(named(&mut steering, 0.8), None);
            }
            // A safety pilot all the same.
            steering.shows(Some(MANUAL));
            assert_eq!(named(&mut steering, 1.0), None);
        }
    }

    /// #48: those of #43 override.
    fn manual(steering: &mut Steering) {
        let each = [(4, 2.0), (5, 2.0), (6, 2.0)];
        take(steering, &record(48, -60.0, &each));
    }

    #[test]
    fn a_launch_takes_the_altitude_of_a_demand_whatever_mode_is_shown_on_the_ground() {
        for shown in [WAYPOINT, LOITER, AUTOPILOT] {
            let mut steering = Steering::default();
            steering.shows(Some(shown));
            steering.stands(true);
            manual(&mut steering);
            let kept = take(&mut steering, &record(43, 0.0, &DEMAND));
            assert_eq!((metres(&kept), kept.heading_command_type), (None, None));
            let launch = mode(&mut steering, LAUNCH, 30.0);
            assert_eq!(metres(&launch), Some(20.0), "{shown}");
            // Once.
            assert_eq!(metres(&mode(&mut steering, LAUNCH, 31.0)), None);
        }
    }

    #[test]
    fn what_the_mode_shown_has_used_of_a_demand_rules_in_the_mode_right_after_it() {
        let place = [(13, 4.0), (18, 0.8), (19, 0.1)];
        let mut steering = Steering::default();
        manual(&mut steering);
        steering.shows(Some(WAYPOINT));
        let faster = take(&mut steering, &record(43, 0.0, &place));
        assert!(faster.commanded_speed.is_some() && faster.loiter_position_latitude.is_none());
        let there = mode(&mut steering, LOITER, 0.2);
        assert!(there.commanded_speed.is_some() && there.loiter_position_latitude.is_some());
        // The same where it is in mode 12 already: it must not stop on its way.
        steering.shows(Some(LOITER));
        take(&mut steering, &record(43, 10.0, &place));
        let there = mode(&mut steering, LOITER, 10.2);
        assert!(there.loiter_position_latitude.is_some());
        // Course and speed: the course is not flown in mode 12, the speed is.
        let east = [(7, 2.0), (9, 1.5), (13, 4.0)];
        take(&mut steering, &record(43, 20.0, &east));
        let steered = mode(&mut steering, AUTOPILOT, 20.2);
        assert!(steered.commanded_speed.is_some() && steered.commanded_course.is_some());
    }

    #[test]
    fn of_a_demand_long_before_its_mode_only_what_was_not_used_rules() {
        let mut steering = Steering::default();
        manual(&mut steering);
        steering.shows(Some(LOITER));
        let east = [(7, 2.0), (9, 1.5), (13, 4.0)];
        take(&mut steering, &record(43, 0.0, &east));
        let steered = mode(&mut steering, AUTOPILOT, 30.0);
        assert!(steered.commanded_speed.is_none() && steered.commanded_course.is_some());
        // A hold after a steering takes nothing of it.
        steering.shows(Some(AUTOPILOT));
        take(&mut steering, &record(43, 40.0, &DEMAND));
        let hold = mode(&mut steering, LOITER, 43.0);
        assert_eq!((metres(&hold), hold.heading_command_type), (None, None));
    }

    #[test]
    fn a_mode_is_one_command_with_the_demand_just_before_it_whose_values_rule_in_it() {
        let takes = |steering: &Steering, mode: u8, at: f64| {
            let order = steering.order(&record(42, at, &[(4, f64::from(mode))]));
            order.expect("it is made").takes_demand
        };
        let mut steering = Steering::default();
        manual(&mut steering);
        steering.shows(Some(LOITER));
        take(&mut steering, &record(43, 0.0, &DEMAND));
        for (mode, at, expected) in [
            (LOITER, 0.2, true),
            (AUTOPILOT, 0.2, true),
            // A landing uses nothing of it; what is long past leads no mode.
            (19, 0.2, false),
            (LOITER, 30.0, false),
        ] {
            assert_eq!(takes(&steering, mode, at), expected, "{mode} at {at}");
        }
        // It belongs to the mode before it.
        mode(&mut steering, AUTOPILOT, 40.0);
        take(&mut steering, &record(43, 40.3, &DEMAND));
        assert!(!takes(&steering, LOITER, 40.9));
    }

    #[test]
    fn a_demand_belongs_to_the_mode_just_before_it() {
        let mut steering = Steering::default();
        manual(&mut steering);
        steering.shows(Some(LOITER));
        // Shown at once, so that the demand does not name it again.
        mode(&mut steering, AUTOPILOT, 0.0);
        steering.shows(Some(AUTOPILOT));
        assert_eq!(
            metres(&take(&mut steering, &record(43, 0.3, &DEMAND))),
            Some(20.0)
        );
        let hold = mode(&mut steering, LOITER, 0.9);
        assert_eq!((metres(&hold), hold.heading_command_type), (None, None));
    }

    #[test]
    fn a_refused_demand_has_no_hold_refused_but_rules_in_the_mode_after_a_route() {
        let after = |shown: u8| {
            let mut steering = Steering::default();
            manual(&mut steering);
            steering.shows(Some(shown));
            let order = steering.order(&record(43, 0.0, &DEMAND));
            let latch = order.expect("it is made").latch;
            steering.accept(latch, true);
            mode(&mut steering, LOITER, 0.2)
        };
        assert_eq!(metres(&after(AUTOPILOT)), None);
        assert_eq!(metres(&after(WAYPOINT)), Some(20.0));
    }

    #[test]
    fn a_route_is_resumed_though_demands_are_repeated_in_another_mode() {
        let mut steering = Steering::default();
        manual(&mut steering);
        for shown in [LOITER, AUTOPILOT] {
            steering.shows(Some(shown));
            let mut all = DEMAND.to_vec();
            all.push((13, 4.0));
            take(&mut steering, &record(43, 0.0, &all));
            let resumed = mode(&mut steering, WAYPOINT, 0.2);
            let values = (metres(&resumed), resumed.heading_command_type);
            assert_eq!(values, (None, None), "{shown}");
            assert!(resumed.commanded_speed.is_some());
        }
    }

    #[test]
    fn a_preference_until_the_loiter_point_ends_there_and_must_be_left_before_it_is_taken_again() {
        let prefer = |steering: &mut Steering, at: f64, mode: f64| {
            let fields = [(4, mode), (5, mode), (6, mode)];
            take(steering, &record(48, at, &fields));
            steering.preference()
        };
        let mut steering = Steering::default();
        assert_eq!(prefer(&mut steering, 0.0, 1.0), [1; 3]);
        take(&mut steering, &record(43, 1.0, &[(18, 0.8), (19, 0.1)]));
        // On the way there in another mode nothing is reached.
        steering.shows(Some(WAYPOINT));
        assert!(!steering.is_at(0.8, 0.1));
        mode(&mut steering, LOITER, 2.0);
        steering.shows(Some(LOITER));
        assert!(!steering.is_at(0.800_1, 0.1), "600 m away");
        assert!(steering.is_at(0.800_001, 0.1), "6 m away");
        assert_eq!(steering.preference(), [0; 3]);
        // A station repeats its last #48.
        assert_eq!(prefer(&mut steering, 3.0, 1.0), [0; 3]);
        assert_eq!(prefer(&mut steering, 4.0, 2.0), [2; 3]);
        assert_eq!(prefer(&mut steering, 5.0, 1.0), [1; 3]);
    }

    #[test]
    fn a_loiter_altitude_of_zero_is_none_and_the_station_is_informed_once() {
        let mut steering = Steering::default();
        let low = record(41, 0.0, &[(4, 1.0), (5, 50.0), (9, 0.0), (10, 2.0)]);
        let order = steering.order(&low).expect("it is made");
        assert!(
            order
                .notice
                .is_some_and(|text| text.contains("Loiter Altitude 0"))
        );
        steering.accept(order.latch, false);
        assert_eq!(steering.order(&low).expect("it is made").notice, None);
        let hold = mode(&mut steering, LOITER, 1.0);
        assert_eq!((hold.altitude_command_type, metres(&hold)), (None, None));
    }
}
