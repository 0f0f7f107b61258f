//! What several scenes begin with: where the vehicle is, a plan and its transfer, a launch and a landing.
//!
//! Plans are laid out around the place where the vehicle was first seen, in the altitude type that it reports. So a
//! plan can be flown wherever the vehicle is, and whichever datum the subject uses.

use std::sync::Arc;
use std::time::Duration;

pub use super::fix::{EARTH_M, Fix, wrapped};
use super::station::{Station, about};
use super::trial::{Player, Trial};
use crate::verdict::{Judged, Precondition, Stop};
use crate::wire::dialect::places::has_field;
use crate::wire::{Draft, Seen};

/// Flight modes that the rules use.
pub mod mode {
    /// Is flown by sticks.
    pub const DIRECTOR: i64 = 2;
    /// Flies the loaded route.
    pub const WAYPOINT: i64 = 11;
    /// Loiters.
    pub const LOITER: i64 = 12;
    /// Flies by commanded values (steering).
    pub const AUTOPILOT: i64 = 15;
    /// Lands.
    pub const LAND: i64 = 19;
    /// Breaks off a landing.
    pub const WAVE_OFF: i64 = 20;
    /// Launches.
    pub const LAUNCH: i64 = 21;
}

/// The next position that the station receives.
///
/// # Errors
/// A fail where no 4000 with a position comes, neither by itself nor on request.
pub fn fix(t: &Trial, station: &Station) -> Judged<Fix> {
    let mark = t.bench.net.mark();
    let next = |time| {
        station.wait(mark, time, |seen| {
            seen.kind() == 4000 && Fix::of(seen).is_some()
        })
    };
    let seen = match next(t.timers().answer) {
        Some(seen) => Some(seen),
        None => {
            let asked = station.query(4000)?;
            Fix::of(&asked).map(|_| asked)
        }
    };
    let fix = seen.as_deref().and_then(Fix::of);
    fix.ok_or_else(|| {
        Stop::fail("expected 4000 with latitude, longitude and altitude; they are absent")
    })
}

/// Where the vehicle was first seen.
///
/// # Errors
/// Inconclusive where it has no position.
pub fn home(t: &Trial, station: &Station) -> Judged<Fix> {
    if let Some(home) = t.bench.home.get() {
        return Ok(*home);
    }
    let found = fix(t, station).precondition("the vehicle has a position")?;
    Ok(*t.bench.home.get_or_init(|| found))
}

/// The flight mode that 3001 reports.
///
/// # Errors
/// A fail where 3001 does not come.
pub fn reported_mode(station: &Station) -> Judged<Option<i64>> {
    Ok(station.query(3001)?.raw("Select Flight Path Control Mode"))
}

/// The waypoint that 4001 reports the vehicle to fly to.
///
/// # Errors
/// A fail where 4001 does not come.
pub fn to_number(station: &Station) -> Judged<Option<i64>> {
    Ok(station.query(4001)?.raw("To Waypoint Number"))
}

/// Moves the waypoints of a plan to this spacing in metres, at flight altitude.
pub fn stretch(home: &Fix, plan: &mut Plan, spacing: f64) {
    let mut index = 0.0;
    for point in plan
        .points
        .iter_mut()
        .filter(|point| point.message_type == 13002)
    {
        index += 1.0;
        let east = if index % 2.0 == 0.0 { 80.0 } else { -80.0 };
        let (latitude, longitude) = home.offset(spacing * index, east);
        *point = point
            .clone()
            .set("Waypoint to Latitude or Relative Y", latitude)
            .set("Waypoint to Longitude or Relative X", longitude);
    }
}

/// Whether 3001 shows this mode within `time`.
///
/// # Errors
/// A fail where 3001 does not come at all.
pub fn mode_becomes(station: &Station, mode: i64, time: Duration) -> Judged<bool> {
    let deadline = station.bench().net.now() + time;
    loop {
        if reported_mode(station)? == Some(mode) {
            return Ok(true);
        }
        if station.bench().net.now() >= deadline {
            return Ok(false);
        }
        station.pause(Duration::from_millis(100))?;
    }
}

/// A mode command without further fields.
#[must_use]
pub fn mode_command(mode: i64) -> Draft {
    Draft::new(2016).raw("Select Flight Path Control Mode", mode)
}

/// Has the loaded route flown from this waypoint on.
///
/// # Errors
/// Inconclusive where the vehicle does not enter mode 11; a fail where 3001 does not come at all.
pub fn fly_from(t: &Trial, station: &Station, waypoint: i64) -> Judged {
    let command = mode_command(mode::WAYPOINT).raw("Commanded Waypoint Number", waypoint);
    station.send(command.acked());
    if mode_becomes(station, mode::WAYPOINT, t.timers().begin)? {
        return Ok(());
    }
    Err(Stop::inconclusive("mode 11 was not entered"))
}

/// A plan: route message and waypoints, in the order in which they are flown.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Mission ID.
    pub mission: String,
    /// Route ID.
    pub route: String,
    /// 13001, where there is one.
    pub head: Option<Draft>,
    /// 13002s with their 13003s after them.
    pub points: Vec<Draft>,
}

impl Plan {
    /// Waypoints with these numbers on a zigzag north of home, 60 m apart, 50 m above home.
    #[must_use]
    pub fn zigzag(home: &Fix, mission: &str, numbers: &[i64]) -> Self {
        let points = numbers
            .iter()
            .enumerate()
            .map(|(index, &number)| {
                let next = numbers.get(index + 1).copied().unwrap_or(0);
                let east = if index % 2 == 0 { 0.0 } else { 40.0 };
                let (latitude, longitude) = home.offset(60.0 * (index + 1) as f64, east);
                waypoint(home, number, next, latitude, longitude, 50.0)
            })
            .collect();
        let route = format!("R-{mission}");
        Self {
            head: Some(route_head(&route, numbers.first().copied().unwrap_or(1), 2)),
            mission: mission.to_owned(),
            route,
            points,
        }
    }

    /// All its messages, the route message first.
    #[must_use]
    pub fn messages(&self) -> Vec<Draft> {
        self.head.iter().chain(&self.points).cloned().collect()
    }
}

/// 13001.
#[must_use]
pub fn route_head(route: &str, first: i64, kind: i64) -> Draft {
    Draft::new(13001)
        .raw("Initial Waypoint Number", first)
        .text("Route ID", route.as_bytes())
        .raw("Route Type", kind)
}

/// 13002 at this place, so many metres above home.
#[must_use]
pub fn waypoint(
    home: &Fix,
    number: i64,
    next: i64,
    latitude: f64,
    longitude: f64,
    up: f64,
) -> Draft {
    Draft::new(13002)
        .raw("Waypoint Number", number)
        .set("Waypoint to Latitude or Relative Y", latitude)
        .set("Waypoint to Longitude or Relative X", longitude)
        .raw("Location Type", 0)
        .set("Waypoint to Altitude", home.altitude + up)
        .raw("Waypoint Altitude Type", home.altitude_type)
        .set("Waypoint to Speed", 5.0)
        .raw("Waypoint Speed Type", 2)
        .raw("Next Waypoint", next)
}

/// 13000.
#[must_use]
pub fn transfer(mode: i64, mission: &str) -> Draft {
    Draft::new(13000)
        .text("Mission ID", mission.as_bytes())
        .raw("Mission Plan Mode", mode)
}

/// Sends a message over a network that may lose it: with the acknowledgement bit, the same bytes up to three times,
/// until something acknowledges it.
pub fn deliver(station: &Station, draft: Draft) {
    let lossless = station
        .bench()
        .survey
        .get()
        .is_some_and(|survey| survey.loss == 0.0);
    if lossless {
        station.send(draft);
        station.bench().net.pause(Duration::from_millis(2));
        return;
    }
    let sent = station.send(draft.acked());
    for _ in 0..3 {
        let acknowledged = |seen: &Seen| {
            seen.kind() == 17000 && seen.raw("Original Message Time Stamp") == Some(sent.stamp)
        };
        if station
            .wait(sent.mark, Duration::from_millis(200), acknowledged)
            .is_some()
        {
            return;
        }
        station.send_bytes(&sent.bytes);
    }
}

/// How a transfer ended, with everything that came during it.
#[derive(Clone, Debug)]
pub struct Transfer {
    /// 1 complete, 2 aborted; none where no end came.
    pub status: Option<i64>,
    /// The 14000s of it.
    pub reports: Vec<Arc<Seen>>,
    /// 13001 to 13006 and curve messages that the subject sent.
    pub messages: Vec<Arc<Seen>>,
}

/// Sends 13000 and waits until its transfer ends.
///
/// # Errors
/// The operator stopped the run.
pub fn run_transfer(
    t: &Trial,
    station: &Station,
    command: Draft,
    time: Duration,
) -> Judged<Transfer> {
    let ended =
        |seen: &Seen| seen.kind() == 14000 && seen.raw("Status").is_some_and(|status| status != 0);
    let sent = station.send(command);
    let deadline = t.bench.net.now() + time;
    let mut end = None;
    let mut begun = false;
    let mut repeated = 0;
    while end.is_none() && t.bench.net.now() < deadline {
        end = station.wait(sent.mark, t.timers().answer, ended);
        begun |= !station
            .received(sent.mark, |seen| {
                matches!(seen.kind(), 14000 | 13001 | 13002)
            })
            .is_empty();
        // Nothing at all within the answer time: the command may have been lost, so it is sent again.
        if end.is_none() && !begun && repeated < 2 {
            repeated += 1;
            station.send_bytes(&sent.bytes);
        }
        if t.bench.net.interrupted() {
            return Err(Stop::Interrupted);
        }
        if !begun && repeated == 2 && t.bench.net.now() > sent.at + 4 * t.timers().answer {
            break;
        }
    }
    // The last waypoints may arrive just after the end of the transfer.
    t.pause(Duration::from_millis(50))?;
    let reports = station.received(sent.mark, |seen| seen.kind() == 14000);
    for report in &reports {
        t.cite(report);
    }
    Ok(Transfer {
        status: end.and_then(|seen| seen.raw("Status")),
        reports,
        messages: station.received(sent.mark, |seen| {
            matches!(seen.kind(), 13001..=13006 | 50001 | 50002)
        }),
    })
}

/// Sends a plan and the load command.
///
/// # Errors
/// The operator stopped the run.
pub fn load(t: &Trial, station: &Station, plan: &Plan) -> Judged<Transfer> {
    t.loaded.set(true);
    for message in plan.messages() {
        deliver(station, message);
    }
    run_transfer(t, station, transfer(2, &plan.mission), t.timers().load)
}

/// Clears the mission: a subject may keep waypoints of earlier uploads until they are cleared.
///
/// # Errors
/// The operator stopped the run.
pub fn clear(t: &Trial, station: &Station) -> Judged {
    run_transfer(t, station, transfer(1, "CLEAR"), t.timers().answer * 5)?;
    Ok(())
}

/// Loads a plan, as a precondition.
///
/// # Errors
/// Inconclusive where it is not complete.
pub fn loaded(t: &Trial, station: &Station, plan: &Plan) -> Judged {
    clear(t, station)?;
    match load(t, station, plan)?.status {
        Some(1) => Ok(()),
        status => Err(Stop::inconclusive(format!(
            "precondition \"a plan is aboard\" is not met: the load of a good route ended with 14000 status {status:?}, expected 1"
        ))),
    }
}

/// Downloads the loaded plan.
///
/// # Errors
/// The operator stopped the run.
pub fn download(t: &Trial, station: &Station, mission: &str) -> Judged<Transfer> {
    run_transfer(t, station, transfer(3, mission), t.timers().load)
}

/// How the downloaded messages differ from a plan: the first difference, in words.
#[must_use]
pub fn difference(plan: &Plan, found: &Transfer, bench: &super::context::Bench) -> Option<String> {
    for sent in &plan.points {
        let number = field(sent, "Waypoint Number");
        let same = |seen: &&Arc<Seen>| {
            seen.kind() == sent.message_type && seen.raw("Waypoint Number") == number
        };
        let Some(seen) = found.messages.iter().find(same) else {
            return Some(format!(
                "{} of waypoint {} is missing",
                sent.message_type,
                number.unwrap_or_default()
            ));
        };
        for info in seen.info.map_or(&[][..], |info| info.fields) {
            if ["Time Stamp", "Activity ID"].contains(&info.name) || info.wire.integers().is_none()
            {
                continue;
            }
            if seen.original.is_some() && !has_field(seen.kind(), info.name) {
                continue;
            }
            let (expected, found) = (field(sent, info.name), seen.raw(info.name));
            if expected.is_some() && found != expected {
                return Some(format!(
                    "{} of waypoint {}: {} is {} as on the wire, expected {} as uploaded",
                    sent.message_type,
                    number.unwrap_or_default(),
                    info.name,
                    found.map_or("absent".to_owned(), |found| found.to_string()),
                    expected.unwrap_or_default()
                ));
            }
        }
    }
    let expected = plan
        .points
        .iter()
        .filter(|point| point.message_type == 13002)
        .count();
    let mut numbers: Vec<_> = found
        .messages
        .iter()
        .filter(|seen| seen.kind() == 13002)
        .filter_map(|seen| seen.raw("Waypoint Number"))
        .collect();
    numbers.sort_unstable();
    numbers.dedup();
    let _ = bench;
    (numbers.len() != expected).then(|| {
        format!(
            "{} waypoints came back ({numbers:?}), expected {expected}",
            numbers.len()
        )
    })
}

/// A field of a draft as on the wire.
#[must_use]
pub fn field(draft: &Draft, name: &str) -> Option<i64> {
    let seen = draft.seen();
    seen.info?.field(name)?;
    seen.raw(name)
}

/// Polls positions until one is accepted; `None` where none is accepted in time.
///
/// # Errors
/// A fail where no position comes.
pub fn fly_until(
    t: &Trial,
    station: &Station,
    time: Duration,
    mut wanted: impl FnMut(&Fix) -> bool,
) -> Judged<Option<Fix>> {
    let deadline = t.bench.net.now() + time;
    while t.bench.net.now() < deadline {
        let now = fix(t, station)?;
        if wanted(&now) {
            return Ok(Some(now));
        }
    }
    Ok(None)
}

/// Commands a launch to 50 m above home, and waits until the vehicle is nearly there.
///
/// Ends early where the launch is refused: many vehicles stop their motors some seconds after a landing, and refuse a
/// launch while they do. That is lawful; the next try finds a vehicle on the ground.
fn launched(t: &Trial, station: &Player, home: &Fix) -> Judged<bool> {
    let command = station.send(
        mode_command(mode::LAUNCH)
            .raw("Altitude Command Type", 1)
            .set("Commanded Altitude", home.altitude + 50.0)
            .raw("Altitude Type", home.altitude_type)
            .acked(),
    );
    let refused = |seen: &Seen| {
        about(seen, 2016, command.stamp) && seen.raw("Acknowledgement Type") == Some(3)
    };
    let mut climbed = false;
    fly_until(t, station, t.timers().flight, |fix| {
        climbed = fix.altitude > home.altitude + 40.0;
        climbed || !station.received(command.mark, refused).is_empty()
    })
    .precondition("the launch")?;
    Ok(climbed)
}

/// A holder of LOI 2, 4 and 5 whose vehicle is in the air, in loiter mode.
///
/// # Errors
/// Inconclusive where the launch does not succeed.
pub fn airborne(t: &Trial) -> Judged<Player> {
    let a = t.launcher()?;
    let home = home(t, &a)?;
    let now = fix(t, &a).precondition("the vehicle has a position")?;
    if now.altitude < home.altitude + 15.0 {
        if !launched(t, &a, &home)? && !launched(t, &a, &home)? {
            return Err(Stop::inconclusive(
                "precondition \"in flight\" is not met: the vehicle did not climb after 2016 mode 21",
            ));
        }
        // The commanded altitude must end the climb by itself, before the next mode does; a vehicle that ignores it
        // climbs past 75 m.
        let ends = fly_until(t, &a, t.timers().begin, |fix| {
            fix.down > -0.3 || fix.altitude > home.altitude + 75.0
        })
        .precondition("the launch")?;
        if ends.is_none_or(|fix| fix.altitude > home.altitude + 75.0) {
            hold(t, &a)?;
            return Err(Stop::inconclusive(
                "precondition \"in flight\" is not met: the vehicle did not climb after 2016 mode 21 to 50 m above home, but beyond 75 m",
            ));
        }
    }
    let reached = hold(t, &a)?;
    if !reached {
        return Err(Stop::inconclusive(
            "precondition \"in flight, mode 12\" is not met: 3001 does not show mode 12",
        ));
    }
    // The rule before may have left it sinking. How a VSM handles a mission that begins in a descent is not part of
    // any rule.
    fly_until(t, &a, t.timers().begin, |fix| fix.down.abs() < 0.5)?;
    Ok(a)
}

/// Commands mode 12 and waits until 3001 shows it.
///
/// # Errors
/// A fail where 3001 does not come.
pub fn hold(t: &Trial, station: &Station) -> Judged<bool> {
    if reported_mode(station)? == Some(mode::LOITER) {
        return Ok(true);
    }
    for _ in 0..2 {
        station.send(mode_command(mode::LOITER));
        if mode_becomes(station, mode::LOITER, t.timers().begin)? {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Lands the vehicle; true once it is on the ground.
///
/// # Errors
/// The rights cannot be had, or no position comes.
pub fn land(t: &Trial) -> Judged<bool> {
    let a = t.launcher()?;
    let home = home(t, &a)?;
    if fix(t, &a)?.altitude < home.altitude + 3.0 {
        return Ok(true);
    }
    a.send(mode_command(mode::LAND));
    let down = fly_until(t, &a, t.timers().flight, |fix| {
        fix.altitude < home.altitude + 2.0
    })?;
    // Disarming follows touchdown by a moment.
    t.pause(
        Duration::from_secs_f64(3.0 / t.bench.profile.figures.speed_factor.max(1.0))
            .max(Duration::from_millis(500)),
    )?;
    Ok(down.is_some())
}
