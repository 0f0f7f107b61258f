//! MODE-017, sticks (2010) in mode 2: that a deflection moves the vehicle, and to its own side.
//!
//! Each stick is pushed to both sides, and the two flights are compared: wind and trim are in both alike. No source says
//! how far a deflection goes, so 60 is sent, which is less than full travel in per cent and of 127; the throttle is left
//! out, since its middle is not known either.

use std::time::Duration;

use super::scene::Scene;
use crate::bench::fix::{Fix, wrapped};
use crate::bench::flight::{airborne, fix, hold, mode, mode_becomes, mode_command};
use crate::bench::station::{Station, about, information_request, schedule};
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Stop};
use crate::wire::Draft;

pub(super) const SCENES: &[Scene] = &[Scene {
    rule: "MODE-017",
    play: sticks_move_the_vehicle,
}];

/// Between two 2010s: often enough for a vehicle that takes half a second without them for a loss, ten times faster than
/// time.
const EVERY: Duration = Duration::from_millis(20);
/// Sticks before the mode: a vehicle may enter it only once they come.
const BEFORE: Duration = Duration::from_millis(700);
/// By then a vehicle has noticed that sticks no longer come.
const GONE: Duration = Duration::from_millis(1_500);
/// A loss of sticks is a loss of the network or of a slow computer, so it is tried again.
const ATTEMPTS: usize = 3;

/// A part of the motion that a stick changes, and the least change that is above noise.
type Effect = (fn(&Motion) -> f64, f64);

/// A stick with the effects that show it: by how much they differ between the two deflections at least. A vehicle that
/// hovers shows the first: it moves sideways, and forward. One on wings shows the last: it banks and turns, and sinks; what
/// it moves sideways and forward over the ground is the wind's as well, which is another one in another heading.
struct Stick {
    field: &'static str,
    to: &'static str,
    deflection: i64,
    effects: &'static [Effect],
    /// Whether there are vehicles on wings without it.
    optional: bool,
}

const STICKS: &[Stick] = &[
    Stick {
        field: "Lateral Stick",
        to: "to the right",
        deflection: 60,
        effects: &[(|motion| motion.right, 1.5), (|motion| motion.turned, 0.3)],
        optional: false,
    },
    Stick {
        field: "Longitudinal Stick",
        to: "forward, or nose down",
        deflection: 60,
        effects: &[(|motion| motion.forward, 1.5), (|motion| motion.down, 1.5)],
        optional: false,
    },
    Stick {
        field: "Rotational Stick (Rudder)",
        to: "to the right",
        // A turn by more than half a circle between two reports would look like one to the other side.
        deflection: 30,
        effects: &[(|motion| motion.turned, 0.3)],
        // A flying wing has no rudder.
        optional: true,
    },
];

/// What the vehicle did under a deflection: mean speeds in m/s, and the change of heading in radians.
#[derive(Default)]
struct Motion {
    forward: f64,
    right: f64,
    down: f64,
    turned: f64,
}

impl Motion {
    /// Of these fixes; `None` where they are too few, or have no heading.
    fn of(fixes: &[Fix]) -> Option<Self> {
        let settled = &fixes[fixes.len() / 2..];
        if settled.len() < 2 {
            return None;
        }
        let mut motion = Self::default();
        for fix in settled {
            let (sin, cos) = fix.heading?.sin_cos();
            motion.forward += fix.north * cos + fix.east * sin;
            motion.right += fix.east * cos - fix.north * sin;
            motion.down += fix.down;
        }
        let count = settled.len() as f64;
        for mean in [&mut motion.forward, &mut motion.right, &mut motion.down] {
            *mean /= count;
        }
        for pair in fixes.windows(2) {
            motion.turned += wrapped(pair[1].heading? - pair[0].heading?);
        }
        Some(motion)
    }
}

impl Stick {
    /// 1 where the vehicle moves to the side of the deflection, -1 to the other, 0 where it does not move by it.
    fn side(&self, hovers: bool, positive: &Motion, negative: &Motion) -> i32 {
        let mut sides = self.effects.iter().map(|(effect, least)| {
            let by = effect(positive) - effect(negative);
            if by.abs() < *least {
                0
            } else {
                by.signum() as i32
            }
        });
        // Where the effects differ one of them is a by-product, so that of the vehicle's own kind counts.
        let shown = |side: &i32| *side != 0;
        let side = if hovers {
            sides.find(shown)
        } else {
            sides.rfind(shown)
        };
        side.unwrap_or(0)
    }
}

/// Why sticks were not judged to their end.
enum Broken {
    /// The vehicle left mode 2, for which it may have its reasons.
    Left,
    /// The rule's verdict, or the operator.
    Stop(Stop),
}

impl From<Stop> for Broken {
    fn from(stop: Stop) -> Self {
        Self::Stop(stop)
    }
}

/// Sends a 2010 again and again for this long.
fn push(t: &Trial, a: &Station, sticks: &Draft, time: Duration) -> Judged {
    let until = t.bench.net.now() + time;
    while t.bench.net.now() < until {
        a.send(sticks.clone());
        t.pause(EVERY)?;
    }
    Ok(())
}

/// All sticks centred, but this one.
fn deflected(stick: &str, deflection: i64) -> Draft {
    STICKS
        .iter()
        .fold(Draft::new(2010), |draft, one| draft.raw(one.field, 0))
        .raw(stick, deflection)
}

fn centred() -> Draft {
    deflected(STICKS[0].field, 0)
}

/// Enters mode 2 with centred sticks.
fn enter(t: &Trial, a: &Station) -> Result<(), Broken> {
    push(t, a, &centred(), BEFORE)?;
    let sent = a.send(mode_command(mode::DIRECTOR).acked());
    let until = t.bench.net.now() + t.timers().begin;
    while t.bench.net.now() < until {
        a.send(information_request(3001));
        push(t, a, &centred(), Duration::from_millis(200))?;
        let refused = a.received(sent.mark, |seen| {
            about(seen, 2016, sent.stamp) && seen.raw("Acknowledgement Type") == Some(3)
        });
        if !refused.is_empty() {
            return Err(
                Stop::not_applicable("mode 2, which is flown by sticks, is refused").into(),
            );
        }
        if shows_director(a, sent.mark) == Some(true) {
            return Ok(());
        }
    }
    Err(Broken::Left)
}

/// Whether the last 3001 since `mark` shows mode 2.
fn shows_director(a: &Station, mark: usize) -> Option<bool> {
    let reports = a.received(mark, |seen| seen.kind() == 3001);
    let last = reports.last()?;
    Some(last.raw("Select Flight Path Control Mode") == Some(mode::DIRECTOR))
}

/// What the vehicle does under a deflection for some seconds of its time.
fn flown(t: &Trial, a: &Station, sticks: &Draft, time: Duration) -> Result<Motion, Broken> {
    let mark = t.bench.net.mark();
    push(t, a, sticks, time)?;
    if shows_director(a, mark) == Some(false) {
        return Err(Broken::Left);
    }
    let fixes: Vec<Fix> = a
        .received(mark, |seen| seen.kind() == 4000)
        .iter()
        .filter_map(|seen| Fix::of(seen))
        .collect();
    Motion::of(&fixes)
        .ok_or_else(|| Stop::inconclusive("4000 has no heading, or comes too seldom").into())
}

/// One flight by sticks.
struct Flight {
    /// To which side each of them moved the vehicle.
    sides: Vec<i32>,
    /// How it moved under the last deflection, and how it moves once all are centred.
    last: Motion,
    rest: Motion,
}

impl Flight {
    /// Whether it still turns as it did under the last deflection. One that turns its nose into the wind may do so by
    /// itself, and one that drifts with the wind as well.
    fn turns_on(&self) -> bool {
        let (last, rest) = (self.last.turned, self.rest.turned);
        rest.abs() >= STOPPED_RAD && rest * last > 0.0 && rest.abs() > last.abs() / 2.0
    }
}

fn by_sticks(t: &Trial, a: &Station, hovers: bool) -> Result<Flight, Broken> {
    let speed = t.bench.profile.figures.speed_factor.max(1.0);
    let time = Duration::from_secs_f64((4.0 / speed).max(1.0));
    let began = fix(t, a)?;
    let (mut sides, mut last) = (Vec::new(), Motion::default());
    enter(t, a)?;
    for stick in STICKS {
        let positive = flown(t, a, &deflected(stick.field, stick.deflection), time)?;
        let negative = flown(t, a, &deflected(stick.field, -stick.deflection), time)?;
        sides.push(stick.side(hovers, &positive, &negative));
        last = negative;
        if fix(t, a)?.altitude < began.altitude - SINKS_M {
            return Err(Stop::inconclusive(format!(
                "the vehicle sank by more than {SINKS_M:.0} m in mode 2, where no throttle was commanded"
            ))
            .into());
        }
    }
    flown(t, a, &centred(), time)?;
    let rest = flown(t, a, &centred(), time)?;
    Ok(Flight { sides, last, rest })
}

/// How far the vehicle may sink before the sticks are left.
const SINKS_M: f64 = 15.0;
/// Speed, m/s, and change of heading, rad, above which a vehicle that hovers has not stopped: above gusts.
const STOPPED_MPS: f64 = 2.5;
const STOPPED_RAD: f64 = 0.3;

fn sticks_move_the_vehicle(t: &Trial) -> Judged {
    let a = airborne(t)?;
    let largest = t.bench.profile.figures.largest_rate_hz;
    a.send(schedule(4000, largest.min(10)));
    let hovers = {
        let now = fix(t, &a)?;
        now.north.hypot(now.east) < 1.0
    };
    let mut found = None;
    for _ in 0..ATTEMPTS {
        let flight = by_sticks(t, &a, hovers);
        // Out of mode 2 before anything else: nobody moves the sticks any longer.
        hold(t, &a)?;
        match flight {
            Ok(flight) => {
                found = Some(flight);
                break;
            }
            Err(Broken::Stop(stop)) => return Err(stop),
            Err(Broken::Left) => {}
        }
    }
    a.send(schedule(4000, 0));
    // To some autopilots sticks that no longer come are a loss in mode 12 too: they hold, show mode 12, and return some
    // seconds later, in the rules that follow. A mode that is commanded once they are gone ends that.
    t.pause(GONE)?;
    a.send(mode_command(mode::LOITER));
    mode_becomes(&a, mode::LOITER, t.timers().begin)?;
    let Some(flight) = found else {
        return Err(Stop::inconclusive(format!(
            "mode 2 was not entered, or was left while sticks came, in {ATTEMPTS} attempts"
        )));
    };
    for (stick, &side) in STICKS.iter().zip(&flight.sides) {
        if side == 0 && stick.optional && !hovers {
            t.note(format!(
                "the {} of 2010 moves nothing on wings",
                stick.field
            ));
            continue;
        }
        t.expect(side != 0, || {
            format!(
                "expected the {} of 2010 to move the vehicle in mode 2; deflections of {} to both sides make no difference",
                stick.field, stick.deflection
            )
        })?;
        t.expect(side > 0, || {
            format!(
                "expected a positive {} of 2010 to move the vehicle {}; it moves to the other side",
                stick.field, stick.to
            )
        })?;
    }
    let pace = flight.rest.forward.hypot(flight.rest.right);
    t.expect(!hovers || !flight.turns_on(), || {
        format!("expected a vehicle that hovers to stop in mode 2 once all sticks of 2010 are centred; it has turned on by {:.1} rad", flight.rest.turned)
    })?;
    // Without an autopilot a vehicle drifts with the wind.
    if hovers && pace >= STOPPED_MPS {
        t.warn(format!("a vehicle that hovers flies at {pace:.1} m/s in mode 2 with all sticks of 2010 centred, as in a wind"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(forward: f64, right: f64, turned: f64) -> Motion {
        Motion {
            forward,
            right,
            down: 0.0,
            turned,
        }
    }

    #[test]
    fn a_stick_moves_the_vehicle_to_its_side_whatever_the_wind() {
        let [lateral, longitudinal, rudder] = STICKS else {
            panic!("three sticks");
        };
        // 6 m/s to each side, in a wind of 2 m/s from the left.
        let (right, left) = (motion(0.0, 8.0, 0.0), motion(0.0, -4.0, 0.0));
        assert_eq!(lateral.side(true, &right, &left), 1);
        assert_eq!(lateral.side(true, &left, &right), -1);
        assert_eq!(longitudinal.side(true, &right, &left), 0);
        // On wings it banks and turns, and out of the wind, which then comes from the other side.
        let (right, left) = (motion(20.0, -6.0, 0.9), motion(20.0, 6.0, -0.9));
        assert_eq!(lateral.side(false, &right, &left), 1);
        assert_eq!(rudder.side(false, &left, &right), -1);
        // Gusts alone.
        let (right, left) = (motion(0.0, 0.6, 0.1), motion(0.0, -0.6, 0.0));
        assert_eq!(lateral.side(true, &right, &left), 0);
    }

    #[test]
    fn a_vehicle_that_drifts_or_turns_into_the_wind_does_not_turn_on() {
        let turned = |last: f64, rest: f64| {
            let flight = Flight {
                sides: Vec::new(),
                last: motion(0.0, 0.0, last),
                rest: motion(8.0, 0.0, rest),
            };
            flight.turns_on()
        };
        assert!(turned(-1.2, -1.2));
        assert!(!turned(-1.2, 0.0));
        assert!(!turned(-1.2, 0.5) && !turned(-1.2, -0.4));
    }

    #[test]
    fn a_deflection_moves_nothing_but_its_stick() {
        let sticks = deflected("Lateral Stick", -60).seen();
        assert_eq!(sticks.raw("Lateral Stick"), Some(-60));
        assert_eq!(sticks.raw("Longitudinal Stick"), Some(0));
        assert!(!sticks.has("Throttle Stick - Engine 1"));
    }
}
