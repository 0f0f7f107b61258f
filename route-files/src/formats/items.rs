//! Mission items, which QGroundControl's .plan and the text files of Mission Planner and MAVProxy share: what of a
//! route each of them is, and back.
//!
//! | item | in a route |
//! |---|---|
//! | waypoint, spline | a point; hold time as a hover, an acceptance radius of at most 3 m as fly-over |
//! | loiter without end, by time, by turns | a point with a loiter |
//! | take-off at a place | a point where a take-off ends |
//! | change of speed | the speed of the legs that follow |
//! | jump back | the end of a loop |
//! | geofence vertices and circles, rally points | geofence and rally points |
//! | any other: landing, return to launch, camera | kept as it is, for mission files |
//!
//! Where all items are relative to home the route is, too; where some are, each gets the home altitude added.

use curve_paths::Position;
use stanag_msgs::enums::{LimitType, LoiterDirection, LoiterType, TurnType, WaypointSpeedType};

use super::draft::{Conduct, Datum, Draft, Extra, LoiterExit, NoAltitude, Point, Repeat, TakeOff};
use super::losses::Losses;
use crate::fence::{Area, Keep, Shape};
use crate::route::model::{Loiter, LoiterSpan};

/// An item of a mission file.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct MissionItem {
    /// Its number, by which losses name it.
    pub(super) item: usize,
    /// What jumps call it.
    pub(super) id: i64,
    pub(super) command: u16,
    pub(super) frame: u8,
    /// NaN is none.
    pub(super) params: [f64; 7],
    pub(super) line: Option<u64>,
}

/// Items, as they are read.
pub(super) struct Reader {
    draft: Draft,
    /// Of each point whether it is relative to home, and what jumps call it.
    places: Vec<(bool, i64)>,
    /// The speed that was set last; an item that no leg has followed yet.
    speed: Option<(f64, WaypointSpeedType)>,
    pending: Option<Extra>,
    jumps: Vec<Jump>,
    /// Vertices of a fence's polygon, until they are as many as each of them announces.
    vertices: Vec<[f64; 2]>,
}

struct Jump {
    /// The point that it follows.
    from: Option<usize>,
    to: i64,
    times: f64,
    item: usize,
}

impl Default for Reader {
    fn default() -> Self {
        let draft = Draft {
            losses: Losses::of("item"),
            ..Draft::default()
        };
        Self {
            draft,
            places: Vec::new(),
            speed: None,
            pending: None,
            jumps: Vec::new(),
            vertices: Vec::new(),
        }
    }
}

impl Reader {
    /// The number of the next item.
    pub(super) const fn next(&self) -> usize {
        self.draft.losses.items + 1
    }

    /// An item that is read as none of these.
    pub(super) fn lose(&mut self, what: &str) {
        self.draft.losses.items += 1;
        let item = self.draft.losses.items;
        self.draft.losses.add(item, what);
    }

    /// Takes an item; a frame that is not known is an error.
    pub(super) fn take(&mut self, item: &MissionItem) -> Result<(), String> {
        self.draft.losses.items += 1;
        let [p1, p2, p3, ..] = item.params;
        let [lat, lon, alt] = [4, 5, 6].map(|n| item.params[n]);
        // At 0, 0 is where the vehicle is, no place.
        let placed = lat.is_finite() && lon.is_finite() && (lat, lon) != (0.0, 0.0);
        match item.command {
            NAV_WAYPOINT | NAV_LOITER_UNLIM | NAV_LOITER_TURNS | NAV_LOITER_TIME | NAV_TAKEOFF
            | NAV_LOITER_TO_ALT | NAV_SPLINE | NAV_VTOL_TAKEOFF
                if placed =>
            {
                self.point(item)?;
            }
            DO_CHANGE_SPEED if p2 > 0.0 && (p1 == 0.0 || p1 == 1.0) && item.params[3] != 1.0 => {
                self.drop_pending();
                let ground = p1 == 1.0;
                let kind = if ground {
                    WaypointSpeedType::Ground
                } else {
                    WaypointSpeedType::Indicated
                };
                self.speed = Some((p2, kind));
                if p3 > 0.0 {
                    let what = format!("throttle {p3} %");
                    self.draft.losses.add(item.item, what);
                }
                self.pending = Some(self.extra(item));
            }
            DO_JUMP => self.jumps.push(Jump {
                from: self.draft.points.len().checked_sub(1),
                to: p1 as i64,
                times: p2,
                item: item.item,
            }),
            FENCE_POLYGON_IN | FENCE_POLYGON_OUT if placed => {
                self.vertices.push([lat, lon]);
                if self.vertices.len() as f64 >= p1 {
                    let vertices = std::mem::take(&mut self.vertices);
                    let keep = Keep::inside(item.command == FENCE_POLYGON_IN);
                    let shape = Shape::Polygon(vertices);
                    self.draft.areas.push(Area { keep, shape });
                }
            }
            FENCE_CIRCLE_IN | FENCE_CIRCLE_OUT if placed => self.draft.areas.push(Area {
                keep: Keep::inside(item.command == FENCE_CIRCLE_IN),
                shape: Shape::Circle {
                    centre: [lat, lon],
                    radius_m: p1,
                },
            }),
            RALLY_POINT if placed => {
                // An altitude that is absent, or above another level, is no height above home.
                if alt.is_finite() && is_relative(item.frame) == Ok(true) {
                    self.draft.rally.push(Position::new(lat, lon, alt));
                } else {
                    let what = "rally point without an altitude above home";
                    self.draft.losses.add(item.item, what);
                }
            }
            _ => {
                let extra = self.extra(item);
                self.draft.extras.push(extra);
                if item.command == DO_CHANGE_SPEED {
                    self.speed = None;
                }
            }
        }
        Ok(())
    }

    fn point(&mut self, item: &MissionItem) -> Result<(), String> {
        let [p1, p2, p3, p4, lat, lon, alt] = item.params;
        let relative = is_relative(item.frame)?;
        let mut conduct = Conduct::default();
        let mut lost: Vec<String> = Vec::new();
        let circle = |radius: f64, span| {
            let turns = radius.is_finite() && radius != 0.0;
            Some(Loiter {
                pattern: turns.then_some(LoiterType::Circular),
                radius_m: turns.then_some(radius.abs()),
                direction: turns.then_some(if radius > 0.0 {
                    LoiterDirection::Clockwise
                } else {
                    LoiterDirection::CounterClockwise
                }),
                span,
                ..Loiter::default()
            })
        };
        let mut whole = |what: &str, value: f64| {
            let rounded = value.round().clamp(0.0, f64::from(u16::MAX));
            if (rounded - value).abs() > 1e-6 {
                lost.push(format!("{what} {value} (taken as {rounded})"));
            }
            rounded as u16
        };
        match item.command {
            NAV_LOITER_UNLIM => conduct.loiter = circle(p3, None),
            NAV_LOITER_TURNS => {
                conduct.exit = LoiterExit::of(p2, p4);
                let turns = LoiterSpan::Turns(whole("turns", p1));
                conduct.loiter = circle(p3, Some(turns));
            }
            NAV_LOITER_TIME => {
                conduct.exit = LoiterExit::of(p2, p4);
                let seconds = LoiterSpan::Seconds(whole("loiter time, s,", p1));
                conduct.loiter = circle(p3, Some(seconds));
            }
            NAV_LOITER_TO_ALT => {
                lost.push("loiter until the altitude is reached".into());
                if p2.is_finite() && p2 != 0.0 {
                    lost.push(format!("its loiter radius {p2} m"));
                }
                if LoiterExit::of(p1, p4).is_some() {
                    lost.push(LOITER_EXIT.into());
                }
            }
            NAV_TAKEOFF | NAV_VTOL_TAKEOFF => {
                conduct.take_off = Some(if item.command == NAV_TAKEOFF {
                    TakeOff::Plain
                } else {
                    TakeOff::Vtol
                });
                if p1 != 0.0 && p1.is_finite() && item.command == NAV_TAKEOFF {
                    lost.push(format!("pitch {p1} degrees of the take-off"));
                }
            }
            _ => {
                if p1 > 0.0 {
                    conduct.loiter = Some(Loiter {
                        pattern: Some(LoiterType::Hover),
                        span: Some(LoiterSpan::Seconds(whole("hold time, s,", p1))),
                        ..Loiter::default()
                    });
                }
                match p2 {
                    p if p > 0.0 && p <= FLY_OVER_M => conduct.turn = Some(TurnType::FlyOver),
                    p if p > FLY_OVER_M => lost.push(format!("acceptance radius {p} m")),
                    _ => {}
                }
                if p3 != 0.0 && p3.is_finite() {
                    lost.push(format!("pass radius {p3} m"));
                }
                if item.command == NAV_SPLINE {
                    lost.push("spline (a straight leg instead)".into());
                }
            }
        }
        // 0 is what the text files and older ground stations write for none.
        let has_heading = matches!(
            item.command,
            NAV_WAYPOINT | NAV_SPLINE | NAV_TAKEOFF | NAV_VTOL_TAKEOFF | NAV_LOITER_UNLIM
        );
        if has_heading && p4 != 0.0 && p4.is_finite() {
            lost.push(format!("heading {p4} degrees"));
        }
        for what in lost {
            self.draft.losses.add(item.item, what);
        }
        self.pending = None;
        if let Some((speed_m_s, kind)) = self.speed {
            conduct.speed_m_s = Some(speed_m_s);
            conduct.speed_type = Some(kind);
        }
        let alt = Some(alt)
            .filter(|m| m.is_finite())
            .ok_or(NoAltitude::Missing);
        self.draft.points.push(Point {
            item: item.item,
            conduct,
            ..Point::found(lat, lon, alt, item.line)
        });
        self.places.push((relative, item.id));
        Ok(())
    }

    fn extra(&self, item: &MissionItem) -> Extra {
        Extra {
            after: self.draft.points.len(),
            item: item.item,
            command: item.command,
            frame: item.frame,
            params: item.params,
        }
    }

    /// A speed that no leg was flown with.
    fn drop_pending(&mut self) {
        self.draft.extras.extend(self.pending.take());
    }

    /// The draft; `None` where home's altitude is needed and absent.
    pub(super) fn finish(mut self, home: Option<Position>) -> Option<Draft> {
        self.drop_pending();
        for jump in std::mem::take(&mut self.jumps) {
            self.resolve(&jump);
        }
        if !self.vertices.is_empty() {
            let what = format!(
                "geofence polygon cut short ({} vertices)",
                self.vertices.len()
            );
            self.draft.losses.add_whole(what);
        }
        let all_relative = !self.places.is_empty() && self.places.iter().all(|(r, _)| *r);
        if !all_relative {
            for (point, (relative, _)) in self.draft.points.iter_mut().zip(&self.places) {
                if *relative && point.no_altitude.is_none() {
                    point.position.alt_m += home.map(|home| home.alt_m)?;
                }
            }
        }
        Some(Draft {
            datum: Datum::above_home(all_relative),
            home,
            ..self.draft
        })
    }

    /// A jump back becomes the end of a loop: at the point before it, to the first point at or behind its target.
    fn resolve(&mut self, jump: &Jump) {
        let to = self.places.iter().position(|(_, id)| *id >= jump.to);
        let free = |from: &usize| self.draft.points[*from].conduct.repeat.is_none();
        let (limit_type, limit) = if jump.times < 0.0 {
            (LimitType::None, 0)
        } else {
            let rounds = (jump.times + 1.0).clamp(1.0, f64::from(u16::MAX));
            (LimitType::Count, rounds as u16)
        };
        match (jump.from.filter(free), to) {
            (Some(from), Some(to)) if to <= from => {
                self.draft.points[from].conduct.repeat = Some(Repeat {
                    to,
                    limit_type,
                    limit,
                });
            }
            _ => {
                let what = format!("jump to item {}", jump.to);
                self.draft.losses.add(jump.item, what);
            }
        }
    }
}

fn is_relative(frame: u8) -> Result<bool, String> {
    if ABSOLUTE.contains(&frame) || RELATIVE.contains(&frame) {
        Ok(RELATIVE.contains(&frame))
    } else {
        Err(format!(
            "{frame}, expected 0, 3, 5 or 6 (terrain is not known here)"
        ))
    }
}

/// The items of a draft, numbered from 1; what they cannot hold goes to `losses`.
pub(super) fn items(draft: &Draft, losses: &mut Losses) -> Vec<MissionItem> {
    let frame = if draft.datum == Datum::Home {
        RELATIVE[0]
    } else {
        ABSOLUTE[0]
    };
    let mut out: Vec<MissionItem> = Vec::new();
    let push = |out: &mut Vec<MissionItem>, command, frame, params| {
        out.push(MissionItem {
            item: out.len() + 1,
            id: out.len() as i64 + 1,
            command,
            frame,
            params,
            line: None,
        });
    };
    let points = draft.written();
    // What jumps call each point.
    let mut ids = Vec::with_capacity(points.len());
    let mut speed = None;
    let mut extras = draft.extras.iter().peekable();
    for (k, point) in points.iter().enumerate() {
        while let Some(extra) = extras.next_if(|extra| extra.after <= k) {
            push(&mut out, extra.command, extra.frame, extra.params);
            if extra.command == DO_CHANGE_SPEED {
                speed = None;
            }
        }
        let conduct = &point.conduct;
        if let Some(speed_m_s) = conduct.speed_m_s {
            let kind = speed_kind(conduct.speed_type, point.item, losses);
            if speed != Some((speed_m_s, kind)) {
                let params = [kind, speed_m_s, -1.0, 0.0, 0.0, 0.0, 0.0];
                push(&mut out, DO_CHANGE_SPEED, FRAME_MISSION, params);
                speed = Some((speed_m_s, kind));
            }
        }
        let (command, params) = place(point, losses);
        push(&mut out, command, frame, params);
        ids.push(out.len());
        if let Some(repeat) = conduct.repeat {
            let times = match repeat.limit_type {
                LimitType::None => Some(-1.0),
                LimitType::Count => Some(f64::from(repeat.limit) - 1.0),
                _ => None,
            };
            match (ids.get(repeat.to), times) {
                (Some(to), Some(times)) if times != 0.0 => {
                    let params = [*to as f64, times, 0.0, 0.0, 0.0, 0.0, 0.0];
                    push(&mut out, DO_JUMP, FRAME_MISSION, params);
                }
                (Some(_), Some(_)) => {}
                _ => losses.add(point.item, format!("loop of {} s", repeat.limit)),
            }
        }
    }
    for extra in extras {
        push(&mut out, extra.command, extra.frame, extra.params);
    }
    out
}

/// DO_CHANGE_SPEED's kind of speed.
fn speed_kind(kind: Option<WaypointSpeedType>, item: usize, losses: &mut Losses) -> f64 {
    match kind {
        None | Some(WaypointSpeedType::Ground) => 1.0,
        Some(WaypointSpeedType::Indicated) => 0.0,
        Some(other) => {
            losses.add(
                item,
                format!("{other:?} speed (written as indicated airspeed)"),
            );
            0.0
        }
    }
}

/// Command and parameters of a point.
fn place(point: &Point, losses: &mut Losses) -> (u16, [f64; 7]) {
    let Position {
        lat_deg,
        lon_deg,
        alt_m,
    } = point.position;
    let there = |p1, p2, p3, p4| [p1, p2, p3, p4, lat_deg, lon_deg, alt_m];
    let conduct = &point.conduct;
    let turn = match conduct.turn {
        Some(TurnType::FlyOver) => FLY_OVER_M,
        _ => 0.0,
    };
    if let Some(kind) = conduct.take_off {
        if conduct.loiter.is_some() {
            losses.add(point.item, "loiter where a take-off ends");
        }
        let command = match kind {
            TakeOff::Plain => NAV_TAKEOFF,
            TakeOff::Vtol => NAV_VTOL_TAKEOFF,
        };
        return (command, there(0.0, 0.0, 0.0, f64::NAN));
    }
    let Some(loiter) = &conduct.loiter else {
        return (NAV_WAYPOINT, there(0.0, turn, 0.0, f64::NAN));
    };
    for what in unfit(loiter) {
        losses.add(point.item, what);
    }
    let hover = loiter.pattern == Some(LoiterType::Hover);
    if let (true, Some(LoiterSpan::Seconds(s))) = (hover, loiter.span) {
        return (NAV_WAYPOINT, there(f64::from(s), turn, 0.0, f64::NAN));
    }
    if turn > 0.0 {
        losses.add(point.item, "fly-over beside a loiter");
    }
    if hover {
        losses.add(point.item, "hover (written as a loiter)");
    }
    let sign = match loiter.direction {
        Some(LoiterDirection::CounterClockwise) => -1.0,
        _ => 1.0,
    };
    let radius = loiter.radius_m.map_or(0.0, |m| sign * m);
    let (p2, p4) = conduct
        .exit
        .map_or((0.0, 0.0), |exit| (exit.heading, exit.tangent));
    match loiter.span {
        None => (NAV_LOITER_UNLIM, there(0.0, 0.0, radius, f64::NAN)),
        Some(LoiterSpan::Seconds(s)) => (NAV_LOITER_TIME, there(f64::from(s), p2, radius, p4)),
        Some(LoiterSpan::Turns(n)) => (NAV_LOITER_TURNS, there(f64::from(n), p2, radius, p4)),
    }
}

/// What is lost where a format has no word for how a loiter is left.
pub(super) const LOITER_EXIT: &str = "how the loiter is left (its exit heading, its tangent)";

/// What of a loiter no item says.
fn unfit(loiter: &Loiter) -> Vec<String> {
    let mut lost = Vec::new();
    match loiter.pattern {
        None | Some(LoiterType::Circular | LoiterType::Hover) => {}
        Some(other) => lost.push(format!("loiter pattern {other:?} (written as a circle)")),
    }
    let values = [
        ("length", loiter.length_m, "m"),
        ("bearing", loiter.bearing_deg, "degrees"),
        ("speed", loiter.speed_m_s, "m/s"),
    ];
    lost.extend(
        values
            .into_iter()
            .filter_map(|(what, value, unit)| Some(format!("loiter {what} {} {unit}", value?))),
    );
    match loiter.direction {
        Some(LoiterDirection::IntoWind) => lost.push("loiter into the wind".into()),
        Some(LoiterDirection::CounterClockwise | LoiterDirection::Clockwise)
            if loiter.radius_m.is_none() =>
        {
            lost.push("loiter direction without a radius".into());
        }
        _ => {}
    }
    lost
}

/// What an item that is no part of a path does, in words.
pub(super) fn describe(extra: &Extra) -> String {
    let [p1, p2, ..] = extra.params;
    let name = match extra.command {
        NAV_WAYPOINT | NAV_SPLINE => "waypoint without a place",
        NAV_LOITER_UNLIM | NAV_LOITER_TURNS | NAV_LOITER_TIME | NAV_LOITER_TO_ALT => {
            "loiter without a place"
        }
        20 => "return to launch",
        21 => "landing",
        NAV_TAKEOFF => "take-off",
        NAV_VTOL_TAKEOFF => "VTOL take-off",
        85 => "VTOL landing",
        93 | 112 => return format!("delay of {p1} s"),
        115 => return format!("heading {p1} degrees"),
        DO_CHANGE_SPEED if p2 > 0.0 => return format!("speed {p2} m/s"),
        DO_CHANGE_SPEED => "change of speed or throttle",
        179 => "home position",
        189 => "start of the landing",
        195 | 196 | 197 | 201 => "region of interest",
        183 | 184 | 187 => "servo",
        181 | 182 => "relay",
        200 | 202 | 203 | 206 | 214 | 530 | 531 | 532 | 2000..=2003 | 2500 | 2501 => "camera",
        204 | 205 | 1000 => "gimbal",
        211 => "gripper",
        3000 => "VTOL transition",
        _ => return format!("command {} (MAV_CMD)", extra.command),
    };
    name.to_owned()
}

pub(super) const NAV_WAYPOINT: u16 = 16;
const NAV_LOITER_UNLIM: u16 = 17;
const NAV_LOITER_TURNS: u16 = 18;
const NAV_LOITER_TIME: u16 = 19;
const NAV_TAKEOFF: u16 = 22;
const NAV_LOITER_TO_ALT: u16 = 31;
const NAV_SPLINE: u16 = 82;
const NAV_VTOL_TAKEOFF: u16 = 84;
const DO_JUMP: u16 = 177;
const DO_CHANGE_SPEED: u16 = 178;
const FENCE_POLYGON_IN: u16 = 5001;
const FENCE_POLYGON_OUT: u16 = 5002;
const FENCE_CIRCLE_IN: u16 = 5003;
const FENCE_CIRCLE_OUT: u16 = 5004;
const RALLY_POINT: u16 = 5100;

/// MAV_FRAME relative to home: GLOBAL_RELATIVE_ALT and its INT twin.
const RELATIVE: [u8; 2] = [3, 6];
/// MAV_FRAME above mean sea level: GLOBAL and its INT twin.
const ABSOLUTE: [u8; 2] = [0, 5];
/// MAV_FRAME of an item without a place.
pub(super) const FRAME_MISSION: u8 = 2;
/// The acceptance radius that the bridge gives a fly-over, m.
const FLY_OVER_M: f64 = 3.0;
