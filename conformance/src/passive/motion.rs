//! Judges of how 4000 reports the motion: a rate has the sign and the size of the change that it is the rate of, and the
//! nose is up where a vehicle brakes or climbs.
//!
//! Signs are judged only where both sides are clearly above noise: the resolution of a field, a gust, or two samples of
//! different moments show either sign. A fail needs nine of ten observations: of pure noise half are wrong, and of sixteen
//! such observations fifteen are by chance once in 4,000 times. Too few of them are no pass. Times are the vehicle's own:
//! a simulation that is ten times faster turns ten times as far between two reports, and what happened between them is
//! not known.
//!
//! Sizes are judged by what a rate makes of a whole swing of its field, not of two reports: noise has no mean, and so
//! hardly a sum, while a rate in degrees, in feet, or that is always 0, is wrong in each swing. The swings are chosen by
//! the field alone. Chosen by the rate, those would be picked in which noise made it large.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::view::{Found, Judge, Tally, View};
use crate::bench::fix::{Fix, wrapped};
use crate::wire::Seen;

pub(super) const JUDGES: &[Judge] = &[
    Judge {
        rule: "STAT-017",
        judge: rates_are_those_of_the_change,
    },
    Judge {
        rule: "STAT-017",
        judge: the_nose_is_up_where_it_has_to_be,
    },
];

/// A field of 4000, and the one that it is the rate of.
struct Rate {
    of: &'static str,
    rate: &'static str,
    /// -1 where one counts up and the other down.
    sign: f64,
    /// The rate at both ends that is above noise, in the field's unit for each second.
    least: f64,
    /// The change that is above noise.
    change: f64,
    /// The longest time between two samples, s.
    apart_s: f64,
    /// Samples further apart than this count only where the rate has its sign in the one before them too, s. What sways in
    /// less than twice the time between two samples shows the opposite sign by aliasing, but never three times in a row.
    alone_s: f64,
    /// The change of a swing, far above the noise of the field, and the longest time that it takes, s.
    swing: f64,
    swing_s: f64,
}

/// Half of the shortest time in which a vehicle sways so far that its reports show it, s: its tilt, and its velocity and
/// course.
const TILT_SWAYS_S: f64 = 0.15;
const WAY_SWAYS_S: f64 = 0.4;

const RATES: &[Rate] = &[
    Rate {
        of: "Altitude",
        rate: "W_Speed",
        sign: -1.0,
        least: 1.0,
        change: 0.5,
        apart_s: 2.5,
        alone_s: 1.0,
        swing: 3.0,
        swing_s: 6.0,
    },
    Rate {
        of: "U_Speed",
        rate: "U_Accel",
        sign: 1.0,
        least: 0.5,
        change: 0.2,
        apart_s: 1.2,
        alone_s: WAY_SWAYS_S,
        swing: 1.5,
        swing_s: 2.5,
    },
    Rate {
        of: "V_Speed",
        rate: "V_Accel",
        sign: 1.0,
        least: 0.5,
        change: 0.2,
        apart_s: 1.2,
        alone_s: WAY_SWAYS_S,
        swing: 1.5,
        swing_s: 2.5,
    },
    Rate {
        of: "W_Speed",
        rate: "W_Accel",
        sign: 1.0,
        least: 0.5,
        change: 0.2,
        apart_s: 1.2,
        alone_s: WAY_SWAYS_S,
        swing: 1.5,
        swing_s: 2.5,
    },
    Rate {
        of: "Roll",
        rate: "Roll Rate",
        sign: 1.0,
        least: 0.06,
        change: 0.015,
        apart_s: 0.3,
        alone_s: TILT_SWAYS_S,
        swing: 0.2,
        swing_s: 1.0,
    },
    Rate {
        of: "Pitch",
        rate: "Pitch Rate",
        sign: 1.0,
        least: 0.06,
        change: 0.015,
        apart_s: 0.3,
        alone_s: TILT_SWAYS_S,
        swing: 0.2,
        swing_s: 1.0,
    },
    Rate {
        of: "Heading",
        rate: "Turn Rate",
        sign: 1.0,
        least: 0.08,
        change: 0.05,
        apart_s: 1.2,
        alone_s: WAY_SWAYS_S,
        swing: 0.5,
        swing_s: 2.5,
    },
];

/// Observations of one rate that are enough to judge it, and how many of ten have to be wrong for a fail.
const ENOUGH: usize = 16;
const TENTHS: usize = 9;
/// Samples are this share of the longest time apart at least: a change has to grow above the resolution of its field.
const SPACED: f64 = 0.25;
/// A change is compared with what its rate makes of the time, within this factor: where they differ by more, the rate
/// was another one between the two samples.
const WITHIN: f64 = 3.0;
/// Swings of one field that are enough to judge the size of its rate.
const SWINGS: usize = 6;
/// What a rate makes of a swing is the swing, within this factor: feet, degrees and another step are further off. The rates
/// of a body that is banked by 50 degrees are not, which some autopilots report for those of the angles.
const SIZED: f64 = 1.7;
/// A simulation that is faster than this runs behind where the computer is slow, and only the profile says how fast it is.
const TIMED_UP_TO: f64 = 2.0;
/// Altitude Type of a height above the ground.
const ABOVE_GROUND: i64 = 2;
/// An acceleration down of this much while W_Speed stays, m/s2, is gravity: the field has what an accelerometer measures.
const GRAVITY_FROM: f64 = 5.0;
const LARGE_FOR_S: f64 = 1.2;

/// Two reports of one vehicle.
struct Pair<'a> {
    /// The one before them, where it is not too far either.
    before: Option<&'a Arc<Seen>>,
    first: &'a Arc<Seen>,
    second: &'a Arc<Seen>,
    /// By their stamps, in the vehicle's time.
    apart_s: f64,
}

impl Pair<'_> {
    /// The values of a field at both ends.
    fn values(&self, field: &str) -> Option<[f64; 2]> {
        Some([self.first.value(field)?, self.second.value(field)?])
    }

    /// How the vehicle gets faster along its nose; `None` where it turned.
    fn push(&self) -> Option<Push> {
        let [north, north_to] = self.values("U_Speed")?;
        let [east, east_to] = self.values("V_Speed")?;
        let [heading, heading_to] = self.values("Heading")?;
        let [pitch, pitch_to] = self.values("Pitch")?;
        let (sin, cos) = heading.sin_cos();
        let straight = wrapped(heading_to - heading).abs() < STRAIGHT_RAD;
        straight.then_some(Push {
            pushed: ((north_to - north) * cos + (east_to - east) * sin) / self.apart_s,
            speed: ((north_to + north) * cos + (east_to + east) * sin) / 2.0,
            heading,
            pitch: (pitch + pitch_to) / 2.0,
        })
    }
}

/// The 4000s of each vehicle whose stamps rise: not what was overtaken, nor the same report to another station, which is
/// no further observation.
fn reports<'a>(view: &View<'a>) -> BTreeMap<u32, Vec<&'a Arc<Seen>>> {
    let mut reports: BTreeMap<u32, Vec<&'a Arc<Seen>>> = BTreeMap::new();
    for seen in view.messages().filter(|seen| seen.kind() == 4000) {
        let known = reports.entry(seen.piece.source.0).or_default();
        let last = known.last().and_then(|last| last.stamp());
        if seen.stamp().is_some() && last < seen.stamp() {
            known.push(seen);
        }
    }
    reports
}

/// The motion between reports: pairs that follow one another, a quarter of the longest time apart at least. `speed` is how
/// much faster than time the vehicle is.
fn pairs<'a>(
    reports: &'a [&'a Arc<Seen>],
    longest_s: f64,
    speed: f64,
) -> impl Iterator<Item = Pair<'a>> {
    let mut before: Option<&'a Arc<Seen>> = None;
    let mut last: Option<&'a Arc<Seen>> = None;
    reports.iter().filter_map(move |&second| {
        let Some(first) = last else {
            last = Some(second);
            return None;
        };
        let apart_ms = second.stamp()? - first.stamp()?;
        let apart_s = apart_ms as f64 / 1000.0 * speed;
        if apart_s < longest_s * SPACED {
            return None;
        }
        last = Some(second);
        let near = apart_s <= longest_s;
        let pair = Pair {
            before,
            first,
            second,
            apart_s,
        };
        before = near.then_some(first);
        near.then_some(pair)
    })
}

/// How much faster than time the vehicle is.
fn speed_of(view: &View<'_>) -> f64 {
    view.profile.figures.speed_factor.max(0.1)
}

impl Rate {
    /// Whether the change between two reports has the sign of the rate; `None` where that is not above noise.
    fn agrees(&self, pair: &Pair<'_>) -> Option<bool> {
        let [first, second] = pair.values(self.rate)?;
        let strong = |rate: f64| rate * second > 0.0 && rate.abs() >= self.least;
        let before = pair.before.and_then(|before| before.value(self.rate));
        let lasts = pair.apart_s <= self.alone_s || before.is_some_and(strong);
        if !(strong(first) && strong(second) && lasts) {
            return None;
        }
        let change = self.change(pair.first, pair.second)?;
        let expected = self.sign * (first + second) / 2.0 * pair.apart_s;
        let ratio = change.abs() / expected.abs();
        // Beyond a third of a turn the way round is not known.
        let known = self.of != "Heading" || expected.abs() < 2.0;
        (known && change.abs() >= self.change && (1.0 / WITHIN..WITHIN).contains(&ratio))
            .then_some(change * expected > 0.0)
    }

    /// How the field changes between two reports; `None` where that is not known.
    fn change(&self, first: &Seen, second: &Seen) -> Option<f64> {
        let (from, to) = (first.value(self.of)?, second.value(self.of)?);
        let datum = |seen: &Seen| seen.raw("Altitude Type");
        // The height above rising ground falls in a climb.
        let of_one_datum = self.of != "Altitude"
            || datum(first) == datum(second) && datum(first) != Some(ABOVE_GROUND);
        of_one_datum.then(|| match self.of {
            "Roll" | "Pitch" | "Heading" => wrapped(to - from),
            _ => to - from,
        })
    }

    /// The time between two reports that follow one another, how the field changes in it, and what the rate makes of it.
    fn step(&self, pair: &[&Arc<Seen>], apart_s: f64, speed: f64) -> Option<[f64; 3]> {
        let [first, second] = pair else { return None };
        let time = (second.stamp()? - first.stamp()?) as f64 / 1000.0 * speed;
        let rate = (first.value(self.rate)? + second.value(self.rate)?) / 2.0;
        let change = self.change(first, second)?;
        (time <= apart_s).then_some([time, change, self.sign * rate * time])
    }

    /// The swings of the field, one after the other, in reports that are at most so far apart. Each lasts to where the
    /// change is largest: a rate that lags makes too little of a swing that ends sooner.
    fn swings<'a>(
        &self,
        reports: &[&'a Arc<Seen>],
        apart_s: f64,
        speed: f64,
    ) -> Vec<(&'a Arc<Seen>, Swing)> {
        let steps: Vec<Option<[f64; 3]>> = reports
            .windows(2)
            .map(|pair| self.step(pair, apart_s, speed))
            .collect();
        let mut swings = Vec::new();
        let mut begin = 0;
        while begin < steps.len() {
            let [mut time, mut change, mut made] = [0.0; 3];
            let mut largest: Option<(usize, Swing)> = None;
            let whole = steps[begin..].iter().map_while(|step| *step);
            for (index, step) in whole.enumerate() {
                time += step[0];
                change += step[1];
                made += step[2];
                if time > self.swing_s {
                    break;
                }
                let larger = largest
                    .as_ref()
                    .is_none_or(|(_, known)| change.abs() > known.change.abs());
                if change.abs() >= self.swing && larger {
                    largest = Some((index, Swing { change, made }));
                }
            }
            begin += match largest {
                Some((index, swing)) => {
                    swings.push((reports[begin + index + 1], swing));
                    index + 1
                }
                None => 1,
            };
        }
        swings
    }

    /// Fails where the rate is always 0 while the field swings, and where it makes much more or less of nearly all swings
    /// than they are; their signs are not looked at. False where there is too little to judge.
    fn judge_size(&self, view: &View<'_>, reports: &[&Arc<Seen>], found: &mut Found) -> bool {
        let speed = speed_of(view);
        let swings = self.swings(reports, self.apart_s, speed);
        let Some((last, _)) = swings.last().filter(|_| swings.len() >= SWINGS) else {
            return false;
        };
        let mut values = reports.iter().filter_map(|seen| seen.raw(self.rate));
        if values.all(|value| value == 0) {
            // Edition 2.5 has no other way to leave a value out, and whoever declares the field as not supported says so.
            if last.original.is_some() || unsupported(view, self.rate) {
                return false;
            }
            let reason = format!(
                "expected {} of 4000 to be that of {}, or to be absent where it is not known; it is always 0, while {} changes by {} or more {} times",
                self.rate,
                self.of,
                self.of,
                self.swing,
                swings.len()
            );
            // Before a recording the field may have been declared as not supported.
            if view.live {
                found.fail(last, reason);
            } else {
                found.warn(last, reason);
            }
            return true;
        }
        let timed = self.swings(reports, self.alone_s, speed);
        if speed > TIMED_UP_TO || timed.len() < SWINGS {
            return false;
        }
        let (mut small, mut large) = (Tally::default(), Tally::default());
        for (last, swing) in timed {
            let ratio = (swing.made / swing.change).abs();
            small.look(last, ratio >= 1.0 / SIZED);
            large.look(last, ratio <= SIZED);
        }
        for (tally, what) in [(small, "less"), (large, "more")] {
            let reason = format!(
                "expected {} of 4000 to make of the time what {} changes by; it makes {what} of it, by a factor above {SIZED}",
                self.rate, self.of
            );
            tally.judge_by(found, SWINGS, TENTHS, &reason);
        }
        true
    }
}

/// A clear change of a field, and what its rate makes of the same time.
struct Swing {
    change: f64,
    made: f64,
}

/// Whether the subject has declared that it does not have this field of 4000.
fn unsupported(view: &View<'_>, name: &str) -> bool {
    let info = stanag_msgs::table::message(4000).and_then(|info| info.field(name));
    // Fields are counted from 1, the time stamp being the first.
    let Some(number) = info.map(|field| i64::from(field.bit) + 1) else {
        return false;
    };
    let of = |seen: &Seen, message: &str, field: &str| {
        seen.raw(message) == Some(4000) && seen.raw(field) == Some(number)
    };
    view.messages().any(|seen| match seen.kind() {
        41_000 | 41_001 | 41_003 => {
            of(seen, "Requested Message", "Requested Field")
                && seen.raw("Field Supported") == Some(0)
        }
        44_003 => {
            of(seen, "Reported Message", "Reported Field") && seen.raw("Field Available") == Some(0)
        }
        _ => false,
    })
}

/// Whether W_Accel contains gravity: it is large though W_Speed stays.
fn measures_gravity(reports: &[&Arc<Seen>], speed: f64) -> bool {
    let steady = pairs(reports, LARGE_FOR_S, speed).filter(|pair| {
        pair.values("W_Speed")
            .is_some_and(|[from, to]| (to - from).abs() < 0.1)
    });
    let large = steady.filter(|pair| {
        pair.values("W_Accel")
            .is_some_and(|[a, b]| a.abs().min(b.abs()) > GRAVITY_FROM)
    });
    large.count() >= 3
}

fn rates_are_those_of_the_change(view: &View<'_>, found: &mut Found) {
    let (reports, speed) = (reports(view), speed_of(view));
    let gravity = reports
        .values()
        .any(|reports| measures_gravity(reports, speed));
    let mut weak = Vec::new();
    for rate in RATES {
        let reason = format!(
            "expected {} of 4000 to have the sign of the change of {}, {}; they are opposed",
            rate.rate,
            rate.of,
            if rate.sign < 0.0 {
                "down where that falls"
            } else {
                "which it is the rate of"
            }
        );
        // Each vehicle by itself: one that reports rightly does not make up for another.
        let mut judged = false;
        for reports in reports
            .values()
            .filter(|_| rate.rate != "W_Accel" || !gravity)
        {
            let mut tally = Tally::default();
            for pair in pairs(reports, rate.apart_s, speed) {
                if let Some(agrees) = rate.agrees(&pair) {
                    tally.look(pair.second, agrees);
                }
            }
            judged |= tally.judge_by(found, ENOUGH, TENTHS, &reason);
            judged |= rate.judge_size(view, reports, found);
        }
        if !judged {
            weak.push(rate.rate);
        }
    }
    if !weak.is_empty() {
        found.missed(format!(
            "too little motion, too few reports (one in {:.2} s of the vehicle's time) or no values in them to compare {} of 4000 with what changes",
            median_apart_s(&reports, speed),
            weak.join(", ")
        ));
    }
}

/// The median time between two reports, in the vehicle's time.
fn median_apart_s(reports: &BTreeMap<u32, Vec<&Arc<Seen>>>, speed: f64) -> f64 {
    let pairs = reports.values().flat_map(|reports| reports.windows(2));
    let apart_ms = pairs.filter_map(|pair| Some(pair[1].stamp()? - pair[0].stamp()?));
    let mut apart_ms: Vec<i64> = apart_ms.collect();
    apart_ms.sort_unstable();
    let median = apart_ms.get(apart_ms.len() / 2).copied();
    median.unwrap_or_default() as f64 / 1000.0 * speed
}

/// How high above the lowest place that was seen a vehicle is in flight, m.
const ALOFT_M: f64 = 10.0;
/// Below this speed over the ground, m/s, for [`HOVERS_FOR`] reports, it hovers.
const HOVER_MPS: f64 = 1.0;
const HOVERS_FOR: usize = 3;
/// A flight between two hovers that gets faster is not judged: it may be on wings, where the nose says something else.
const SLOW_MPS: f64 = 11.0;
/// A vehicle that is never slower in the air flies on wings.
const WINGED_MPS: f64 = 8.0;
/// Acceleration along the nose that is above gusts, m/s2, and the longest time over which it is a mean, s.
const PUSHED_MPS2: f64 = 1.0;
const PUSHED_FOR_S: f64 = 1.2;
/// A change of heading between two reports that is no turn.
const STRAIGHT_RAD: f64 = 0.3;
/// Climb and descent of a wing that are above gusts, m/s.
const CLIMBS_MPS: f64 = 1.5;
/// A difference of the mean pitch that is no trim and no wind, rad.
const TILTED_RAD: f64 = 0.1;
/// Observations of each of the two attitudes that are enough to compare them: a hovering vehicle tilts for a second, a
/// wing climbs for many.
const EACH_TILT: usize = 3;
const EACH_CLIMB: usize = 8;
/// How alike speed, m/s, and heading, rad, are of which the tilts are compared: what the wind and the own speed add to the
/// tilt is the same then.
const ALIKE_MPS: f64 = 2.0;
const ALIKE_RAD: f64 = 0.5;

/// A vehicle that gets faster, or brakes.
struct Push {
    /// Acceleration along the nose, m/s2.
    pushed: f64,
    /// Speed over the ground along the nose, m/s.
    speed: f64,
    heading: f64,
    pitch: f64,
}

impl Push {
    fn is_like(&self, other: &Self) -> bool {
        (self.speed - other.speed).abs() < ALIKE_MPS
            && wrapped(self.heading - other.heading).abs() < ALIKE_RAD
    }
}

/// A flight between two hovers.
#[derive(Default)]
struct Leg {
    faster: Vec<Push>,
    braked: Vec<Push>,
}

/// By how much the nose is higher where a vehicle brakes than where it gets faster, at like speeds of each flight.
#[derive(Default)]
struct Tilts {
    raised: f64,
    compared: usize,
    faster: usize,
    braked: usize,
}

impl Tilts {
    fn take(&mut self, leg: &mut Leg) {
        let Leg { faster, braked } = std::mem::take(leg);
        for one in &faster {
            for other in braked.iter().filter(|other| other.is_like(one)) {
                self.raised += other.pitch - one.pitch;
                self.compared += 1;
            }
        }
        let compared = |these: &[Push], those: &[Push]| {
            let has_like = |one: &&Push| those.iter().any(|other| other.is_like(one));
            these.iter().filter(has_like).count()
        };
        self.faster += compared(&faster, &braked);
        self.braked += compared(&braked, &faster);
    }

    fn mean(&self) -> Option<f64> {
        (self.faster.min(self.braked) >= EACH_TILT).then(|| self.raised / self.compared as f64)
    }
}

/// A value while the nose has to be lower, and while it has to be higher.
#[derive(Default)]
struct Noses {
    lower: Vec<f64>,
    higher: Vec<f64>,
}

impl Noses {
    /// By how much the mean is higher where it has to be; `None` where too few of one kind were seen.
    fn raised(&self) -> Option<f64> {
        let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len() as f64;
        (self.lower.len().min(self.higher.len()) >= EACH_CLIMB)
            .then(|| mean(&self.higher) - mean(&self.lower))
    }
}

/// A vehicle that hovers tilts to where it accelerates: its nose is lower when it gets faster forward than when it brakes.
/// One on wings has its nose higher in a climb than in a descent. Differences, since wind, trim and the angle of the
/// wings shift both alike. A recording may begin in the cruise of a vehicle that can hover, whose nose follows its speed
/// and not its path: there the second is a warning.
fn the_nose_is_up_where_it_has_to_be(view: &View<'_>, found: &mut Found) {
    let mut judged = false;
    let speed = speed_of(view);
    for reports in reports(view).values() {
        let pairs: Vec<Pair<'_>> = pairs(reports, PUSHED_FOR_S, speed).collect();
        let Some(last) = pairs.last() else { continue };
        for (raised, what, sure) in [
            (
                hovering(&pairs),
                "where a hovering vehicle brakes than where it gets faster forward",
                true,
            ),
            (
                on_wings(&pairs),
                "where a vehicle on wings climbs than where it descends",
                view.live,
            ),
        ] {
            let Some(raised) = raised else { continue };
            judged = true;
            let reason = format!(
                "expected Pitch of 4000 to be positive nose up, and so to be higher {what}; it is {:.2} rad lower",
                -raised
            );
            if sure || raised > 0.0 {
                found.check(last.second, raised > 0.0, || reason);
            } else {
                found.warn(last.second, reason);
            }
        }
    }
    if !judged {
        found.missed(
            "neither a hovering vehicle that gets faster and brakes nor one on wings that climbs and descends, to compare Pitch of 4000 with",
        );
    }
}

/// The reports of a vehicle in the air, of two successive ones the second.
fn aloft<'a>(pairs: &'a [Pair<'a>]) -> impl Iterator<Item = (&'a Pair<'a>, Fix)> {
    let mut lowest: BTreeMap<i64, f64> = BTreeMap::new();
    pairs.iter().filter_map(move |pair| {
        let fix = Fix::with_speeds(pair.second)?;
        let lowest = lowest.entry(fix.altitude_type).or_insert(fix.altitude);
        *lowest = fix.altitude.min(*lowest);
        (fix.altitude > *lowest + ALOFT_M).then_some((pair, fix))
    })
}

/// By how much the nose is higher while the vehicle brakes than while it gets faster along its nose, between two hovers.
fn hovering(pairs: &[Pair<'_>]) -> Option<f64> {
    let (mut all, mut leg) = (Tilts::default(), Leg::default());
    let (mut slow, mut hovered) = (0, false);
    for (pair, fix) in aloft(pairs) {
        let pace = fix.north.hypot(fix.east);
        slow = if pace < HOVER_MPS { slow + 1 } else { 0 };
        if slow >= HOVERS_FOR {
            hovered = true;
            all.take(&mut leg);
        } else if pace > SLOW_MPS {
            hovered = false;
            leg = Leg::default();
        }
        if let Some(push) = pair.push().filter(|_| hovered) {
            if push.pushed >= PUSHED_MPS2 {
                leg.faster.push(push);
            } else if push.pushed <= -PUSHED_MPS2 {
                leg.braked.push(push);
            }
        }
    }
    all.mean().filter(|raised| raised.abs() >= TILTED_RAD)
}

/// By how much the nose of a vehicle that is never slow in the air is higher in climbs than in descents. Only where that
/// is about as much as its path is steeper: then it follows the nose.
fn on_wings(pairs: &[Pair<'_>]) -> Option<f64> {
    let (mut noses, mut paths) = (Noses::default(), Noses::default());
    for (pair, fix) in aloft(pairs) {
        let pace = fix.north.hypot(fix.east);
        if pace < WINGED_MPS {
            return None;
        }
        let Some(pitch) = pair.second.value("Pitch") else {
            continue;
        };
        let path = (-fix.down).atan2(pace);
        if fix.down <= -CLIMBS_MPS {
            noses.higher.push(pitch);
            paths.higher.push(path);
        } else if fix.down >= CLIMBS_MPS {
            noses.lower.push(pitch);
            paths.lower.push(path);
        }
    }
    let (raised, steeper) = (noses.raised()?, paths.raised()?);
    let ratio = raised.abs() / steeper;
    (1.0 / WITHIN..WITHIN).contains(&ratio).then_some(raised)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use stanag_msgs::Id;

    use super::*;
    use crate::bench::net::Datagram;
    use crate::passive::view::trace::received;
    use crate::passive::view::{verdict_on, verdict_on_recorded};
    use crate::verdict::Verdict;
    use crate::wire::Draft;

    /// Noise from -1 to 1.
    struct Gusts(u32);

    impl Gusts {
        fn draw(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(self.0 >> 8) / f64::from(1_u32 << 23) - 1.0
        }
    }

    /// 4000s of a vehicle that hovers, flies north and brakes, climbs and turns, each `every_ms`; with the sign of some
    /// fields inverted, and with noise of this strength.
    fn flight(every_ms: u64, inverted: &[&str], noise: f64) -> Vec<Datagram> {
        flight_of(Id(0x1b00_0101), every_ms, noise, |name| {
            Some(if inverted.contains(&name) { -1.0 } else { 1.0 })
        })
    }

    /// The same of this vehicle; what is reported of a field is so many times its value, or nothing.
    fn flight_of(
        vehicle: Id,
        every_ms: u64,
        noise: f64,
        factor: impl Fn(&str) -> Option<f64>,
    ) -> Vec<Datagram> {
        let mut gusts = Gusts(7);
        let (mut pace, mut up, mut altitude): (f64, f64, f64) = (0.0, 0.0, 500.0);
        let (mut pitch, mut heading): (f64, f64) = (0.0, 0.0);
        let mut datagrams = Vec::new();
        let dt: f64 = 0.02;
        for step in 0..3_600_u64 {
            let at_ms = step * 20;
            let time = (at_ms as f64 / 1000.0) % 12.0;
            let pushed: f64 = match time {
                0.0..1.6 => 5.0,
                4.0..5.6 => -5.0,
                _ => 0.0,
            };
            let wanted: f64 = match time {
                1.6..4.0 => 2.0,
                8.0..10.4 => -2.0,
                _ => 0.0,
            };
            let turn: f64 = match time {
                8.0..10.0 => 0.4,
                10.0..12.0 => -0.4,
                _ => 0.0,
            };
            // The first second is on the ground.
            if at_ms == 1_000 {
                altitude = 540.0;
            }
            let lift = ((wanted - up) / dt).clamp(-3.0, 3.0);
            pace += pushed * dt;
            up += lift * dt;
            altitude += up * dt;
            heading = wrapped(heading + turn * dt);
            let pitch_rate = (-(pushed / 9.81).atan() - pitch) / 0.3;
            pitch += pitch_rate * dt;
            if !at_ms.is_multiple_of(every_ms) {
                continue;
            }
            let mut draft = Draft::new(4000)
                .set("Latitude", 0.8)
                .set("Longitude", 0.1)
                .raw("Altitude Type", 3);
            draft.source = Some(vehicle);
            for (name, value, gust) in [
                ("Altitude", altitude, 0.1),
                ("U_Speed", pace, 0.1),
                ("V_Speed", 0.0, 0.1),
                ("W_Speed", -up, 0.1),
                ("U_Accel", pushed, 1.0),
                ("V_Accel", 0.0, 1.0),
                ("W_Accel", -lift, 1.0),
                ("Roll", 0.0, 0.03),
                ("Pitch", pitch, 0.03),
                ("Heading", heading, 0.03),
                ("Roll Rate", 0.0, 0.3),
                ("Pitch Rate", pitch_rate, 0.3),
                ("Turn Rate", turn, 0.3),
            ] {
                let value = value + gust * noise * gusts.draw();
                if let Some(factor) = factor(name) {
                    draft = draft.set(name, factor * value);
                }
            }
            datagrams.push(received(at_ms, draft));
        }
        datagrams
    }

    fn rates(datagrams: &[Datagram]) -> Verdict {
        verdict_on(datagrams, rates_are_those_of_the_change)
    }

    fn nose(datagrams: &[Datagram]) -> Verdict {
        verdict_on(datagrams, the_nose_is_up_where_it_has_to_be)
    }

    #[test]
    fn an_inverted_rate_is_found() {
        assert_eq!(rates(&flight(100, &[], 0.0)), Verdict::Pass);
        for name in [
            "W_Speed",
            "U_Accel",
            "W_Accel",
            "Pitch",
            "Pitch Rate",
            "Turn Rate",
        ] {
            assert_eq!(rates(&flight(100, &[name], 0.0)), Verdict::Fail, "{name}");
        }
    }

    #[test]
    fn a_vehicle_does_not_make_up_for_another() {
        let mut both = flight(100, &[], 0.0);
        let turns_back = |name: &str| Some(if name == "Turn Rate" { -1.0 } else { 1.0 });
        both.extend(flight_of(Id(0x1b00_0102), 100, 0.0, turns_back));
        assert_eq!(rates(&both), Verdict::Fail);
    }

    /// A flight in which one field is so many times what it should be.
    fn scaled(name: &str, factor: f64) -> Vec<Datagram> {
        flight_of(Id(0x1b00_0101), 100, 0.0, |field| {
            Some(if field == name { factor } else { 1.0 })
        })
    }

    #[test]
    fn a_rate_that_is_absent_accuses_nobody() {
        let of = |kept: &[&str]| {
            flight_of(Id(0x1b00_0101), 100, 0.0, |name| {
                let is_rate = RATES.iter().any(|one| one.rate == name);
                (!is_rate || kept.contains(&name)).then_some(1.0)
            })
        };
        assert_eq!(rates(&of(&[])), Verdict::Inconclusive);
        assert_eq!(rates(&of(&["Turn Rate"])), Verdict::Pass);
    }

    #[test]
    fn a_rate_of_another_size_is_found() {
        for name in ["W_Speed", "U_Accel", "W_Accel", "Pitch Rate", "Turn Rate"] {
            for factor in [0.0, 0.3, 3.3] {
                assert_eq!(
                    rates(&scaled(name, factor)),
                    Verdict::Fail,
                    "{name} {factor}"
                );
            }
            // Banked, filtered, or by a clock that is a little wrong.
            for factor in [0.8, 1.25] {
                assert_eq!(
                    rates(&scaled(name, factor)),
                    Verdict::Pass,
                    "{name} {factor}"
                );
            }
        }
    }

    #[test]
    fn a_rate_that_is_said_not_to_be_there_may_be_0() {
        let zero = scaled("Turn Rate", 0.0);
        let recorded = verdict_on_recorded(&zero, rates_are_those_of_the_change);
        assert_eq!(recorded, Verdict::Warning);
        let declared = Draft::new(41_001)
            .raw("Requested Message", 4000)
            .raw("Requested Field", 17)
            .raw("Field Supported", 0);
        let mut all = vec![received(0, declared)];
        all.extend(zero);
        assert_eq!(rates(&all), Verdict::Pass);
    }

    #[test]
    fn a_vehicle_that_sways_as_often_as_it_reports_is_not_judged() {
        let swaying: Vec<_> = (0..120_u32)
            .map(|step| {
                let at = f64::from(step) * TAU / 1.6 + 0.3;
                let draft = Draft::new(4000)
                    .set("U_Speed", 0.5 * at.sin())
                    .set("U_Accel", 0.5 * TAU / 1.6 * at.cos());
                received(u64::from(step) * 1000, draft)
            })
            .collect();
        assert_eq!(rates(&swaying), Verdict::Inconclusive);
    }

    #[test]
    fn a_height_above_rising_ground_is_not_judged() {
        let uphill = |altitude_type: i64| -> Vec<_> {
            (0..60_u32)
                .map(|step| {
                    let draft = Draft::new(4000)
                        .set("Altitude", 200.0 - 2.0 * f64::from(step))
                        .raw("Altitude Type", altitude_type)
                        .set("W_Speed", -2.0);
                    received(u64::from(step) * 1000, draft)
                })
                .collect()
        };
        assert_eq!(rates(&uphill(2)), Verdict::Inconclusive);
        assert_eq!(rates(&uphill(3)), Verdict::Fail);
    }

    /// Legs against a wind of 10 m/s, gently: faster than 1 m/s2 while it is slow only, braking as much while it is fast.
    fn against_the_wind() -> Vec<Datagram> {
        let mut datagrams = Vec::new();
        let mut pace: f64 = 0.0;
        let mut fly = |pace: &mut f64, pushed: f64| {
            let at_ms = 100 * datagrams.len() as u64;
            let drag = 0.002 * (*pace + 10.0).powi(2);
            let draft = Draft::new(4000)
                .set("Latitude", 0.8)
                .set("Longitude", 0.1)
                .set("Altitude", if at_ms < 1_000 { 500.0 } else { 540.0 })
                .raw("Altitude Type", 3)
                .set("U_Speed", *pace)
                .set("V_Speed", 0.0)
                .set("W_Speed", 0.0)
                .set("Heading", 0.0)
                .set("Pitch", -pushed / 9.81 - drag);
            datagrams.push(received(at_ms, draft));
            *pace += pushed / 10.0;
        };
        for _ in 0..3 {
            for _ in 0..30 {
                fly(&mut pace, 0.0);
            }
            while pace < 10.0 {
                let pushed = if pace < 3.0 { 1.2 } else { 0.8 };
                fly(&mut pace, pushed);
            }
            while pace > 0.05 {
                let pushed = if pace > 7.0 { -1.2 } else { -0.8 };
                fly(&mut pace, pushed);
            }
            pace = 0.0;
        }
        for _ in 0..30 {
            fly(&mut pace, 0.0);
        }
        datagrams
    }

    #[test]
    fn drag_is_no_pitch_that_is_inverted() {
        assert_eq!(nose(&against_the_wind()), Verdict::Inconclusive);
    }

    #[test]
    fn a_pitch_that_is_inverted_with_its_rate_is_found_by_the_motion() {
        let inverted = flight(100, &["Pitch", "Pitch Rate"], 0.0);
        assert_eq!(rates(&inverted), Verdict::Pass);
        assert_eq!(nose(&inverted), Verdict::Fail);
        assert_eq!(nose(&flight(100, &[], 0.0)), Verdict::Pass);
    }

    #[test]
    fn slow_reports_lost_reports_and_gusts_are_no_faults() {
        for every_ms in [100_u64, 260, 500, 1_000] {
            for noise in [0.0, 1.0, 3.0] {
                let all = flight(every_ms, &[], noise);
                let mut gusts = Gusts(every_ms as u32);
                let some: Vec<_> = all
                    .iter()
                    .filter(|_| gusts.draw() > -0.4)
                    .cloned()
                    .collect();
                for datagrams in [&all, &some] {
                    assert_ne!(rates(datagrams), Verdict::Fail, "{every_ms} {noise}");
                    assert_ne!(nose(datagrams), Verdict::Fail, "{every_ms} {noise}");
                }
            }
        }
    }

    #[test]
    fn a_vehicle_at_rest_is_not_judged() {
        let still: Vec<_> = flight(100, &["Pitch", "U_Accel"], 0.0)
            .into_iter()
            .take(10)
            .map(|datagram| datagram.at.as_millis() as u64)
            .map(|at_ms| {
                let draft = Draft::new(4000).set("Latitude", 0.8).set("Longitude", 0.1);
                received(at_ms, draft.set("Altitude", 500.0).set("U_Accel", 0.0))
            })
            .collect();
        assert_eq!(rates(&still), Verdict::Inconclusive);
        assert_eq!(nose(&still), Verdict::Inconclusive);
    }

    #[test]
    fn an_accelerometer_in_w_accel_is_not_judged() {
        let with_gravity: Vec<_> = (0..400)
            .map(|step| {
                let time = f64::from(step) / 10.0;
                let up = (time * 0.8).sin() * 2.5;
                let lift = (time * 0.8).cos() * 2.0;
                let draft = Draft::new(4000)
                    .set("W_Speed", -up)
                    .set("W_Accel", -lift - 9.81);
                received(step as u64 * 100, draft)
            })
            .collect();
        assert_eq!(rates(&with_gravity), Verdict::Inconclusive);
    }

    #[test]
    fn on_wings_the_nose_follows_the_path() {
        let winged = |sign: f64| -> Vec<_> {
            (0..300)
                .map(|step| {
                    let up = (f64::from(step) / 20.0).sin() * 4.0;
                    let altitude = 580.0 - (f64::from(step) / 20.0).cos() * 60.0;
                    let draft = Draft::new(4000)
                        .set("Latitude", 0.8)
                        .set("Longitude", 0.1)
                        .set("Altitude", altitude)
                        .raw("Altitude Type", 3)
                        .set("U_Speed", 16.0)
                        .set("V_Speed", 0.0)
                        .set("W_Speed", -up)
                        .set("Heading", 0.0)
                        .set("Pitch", sign * (0.05 + up / 16.0));
                    received(step as u64 * 500, draft)
                })
                .collect()
        };
        assert_eq!(nose(&winged(1.0)), Verdict::Pass);
        assert_eq!(nose(&winged(-1.0)), Verdict::Fail);
        // A recording may be that of a helicopter in its cruise.
        let recorded = |sign| verdict_on_recorded(&winged(sign), the_nose_is_up_where_it_has_to_be);
        assert_eq!(recorded(1.0), Verdict::Pass);
        assert_eq!(recorded(-1.0), Verdict::Warning);
    }
}
