//! Judges of how 4000 reports the motion: a rate has the sign of the change that it is the rate of, and the nose is up
//! where a vehicle brakes or climbs.
//!
//! Signs only, and only where both sides are clearly above noise: the resolution of a field, a gust, or two samples of
//! different moments show either sign. A fail needs nine of ten observations: of pure noise half are wrong, and of sixteen
//! such observations fifteen are by chance once in 4,000 times. Too few of them are no pass. Times are the vehicle's own:
//! a simulation that is ten times faster turns ten times as far between two reports, and what happened between them is
//! not known.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::view::{Ends, Found, Judge, Tally, View, ends};
use crate::bench::fix::{Fix, wrapped};
use crate::wire::Seen;

pub(super) const JUDGES: &[Judge] = &[
    Judge {
        rule: "STAT-017",
        judge: rates_have_the_sign_of_the_change,
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
    /// The longest time between two samples, s. What sways faster than twice this may show the opposite sign by
    /// aliasing: a vehicle's tilt may, for half a second; its velocity and course take two.
    apart_s: f64,
}

const RATES: &[Rate] = &[
    Rate {
        of: "Altitude",
        rate: "W_Speed",
        sign: -1.0,
        least: 1.0,
        change: 0.5,
        apart_s: 2.5,
    },
    Rate {
        of: "U_Speed",
        rate: "U_Accel",
        sign: 1.0,
        least: 0.5,
        change: 0.2,
        apart_s: 1.2,
    },
    Rate {
        of: "V_Speed",
        rate: "V_Accel",
        sign: 1.0,
        least: 0.5,
        change: 0.2,
        apart_s: 1.2,
    },
    Rate {
        of: "W_Speed",
        rate: "W_Accel",
        sign: 1.0,
        least: 0.5,
        change: 0.2,
        apart_s: 1.2,
    },
    Rate {
        of: "Roll",
        rate: "Roll Rate",
        sign: 1.0,
        least: 0.06,
        change: 0.015,
        apart_s: 0.3,
    },
    Rate {
        of: "Pitch",
        rate: "Pitch Rate",
        sign: 1.0,
        least: 0.06,
        change: 0.015,
        apart_s: 0.3,
    },
    Rate {
        of: "Heading",
        rate: "Turn Rate",
        sign: 1.0,
        least: 0.08,
        change: 0.05,
        apart_s: 1.2,
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
/// An acceleration down of this much while W_Speed stays, m/s2, is gravity: the field has what an accelerometer measures.
const GRAVITY_FROM: f64 = 5.0;
const LARGE_FOR_S: f64 = 1.2;

/// Two reports of one vehicle at one socket.
struct Pair<'a> {
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

    /// Acceleration along the nose by the change of speed, m/s2, and the mean pitch; `None` where the vehicle turned.
    fn push(&self) -> Option<(f64, f64)> {
        let [north, north_to] = self.values("U_Speed")?;
        let [east, east_to] = self.values("V_Speed")?;
        let [heading, heading_to] = self.values("Heading")?;
        let [pitch, pitch_to] = self.values("Pitch")?;
        let (sin, cos) = heading.sin_cos();
        let pushed = ((north_to - north) * cos + (east_to - east) * sin) / self.apart_s;
        let straight = wrapped(heading_to - heading).abs() < STRAIGHT_RAD;
        straight.then_some((pushed, (pitch + pitch_to) / 2.0))
    }
}

/// The 4000s of each vehicle at each socket whose stamps rise: not what was overtaken, or came by another way too.
fn reports<'a>(view: &View<'a>) -> BTreeMap<Ends, Vec<&'a Arc<Seen>>> {
    let mut reports: BTreeMap<Ends, Vec<&'a Arc<Seen>>> = BTreeMap::new();
    for seen in view.messages().filter(|seen| seen.kind() == 4000) {
        let known = reports.entry(ends(seen)).or_default();
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
    let mut first: Option<&'a Arc<Seen>> = None;
    reports.iter().filter_map(move |&second| {
        let Some(before) = first else {
            first = Some(second);
            return None;
        };
        let apart_ms = second.stamp()? - before.stamp()?;
        let apart_s = apart_ms as f64 / 1000.0 * speed;
        if apart_s < longest_s * SPACED {
            return None;
        }
        first = Some(second);
        (apart_s <= longest_s).then_some(Pair {
            first: before,
            second,
            apart_s,
        })
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
        if first * second <= 0.0 || first.abs().min(second.abs()) < self.least {
            return None;
        }
        let [from, to] = pair.values(self.of)?;
        let of_one_datum = self.of != "Altitude"
            || pair.first.raw("Altitude Type") == pair.second.raw("Altitude Type");
        let change = match self.of {
            "Roll" | "Pitch" | "Heading" => wrapped(to - from),
            _ => to - from,
        };
        let expected = self.sign * (first + second) / 2.0 * pair.apart_s;
        let ratio = change.abs() / expected.abs();
        // Beyond a third of a turn the way round is not known.
        let known = self.of != "Heading" || expected.abs() < 2.0;
        (of_one_datum
            && known
            && change.abs() >= self.change
            && (1.0 / WITHIN..WITHIN).contains(&ratio))
        .then_some(change * expected > 0.0)
    }
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

fn rates_have_the_sign_of_the_change(view: &View<'_>, found: &mut Found) {
    let (reports, speed) = (reports(view), speed_of(view));
    let gravity = reports
        .values()
        .any(|reports| measures_gravity(reports, speed));
    let mut weak = Vec::new();
    for rate in RATES {
        let mut tally = Tally::default();
        for pair in reports
            .values()
            .flat_map(|reports| pairs(reports, rate.apart_s, speed))
            .filter(|_| rate.rate != "W_Accel" || !gravity)
        {
            if let Some(agrees) = rate.agrees(&pair) {
                tally.look(pair.second, agrees);
            }
        }
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
        if !tally.judge_by(found, ENOUGH, TENTHS, &reason) {
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
fn median_apart_s(reports: &BTreeMap<Ends, Vec<&Arc<Seen>>>, speed: f64) -> f64 {
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

/// A value while the nose has to be lower, and while it has to be higher.
#[derive(Default)]
struct Noses {
    lower: Vec<f64>,
    higher: Vec<f64>,
}

impl Noses {
    /// By how much the mean is higher where it has to be; `None` where fewer than `each` of one kind were seen.
    fn raised(&self, each: usize) -> Option<f64> {
        let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len() as f64;
        (self.lower.len().min(self.higher.len()) >= each)
            .then(|| mean(&self.higher) - mean(&self.lower))
    }

    fn take(&mut self, other: &mut Self) {
        self.lower.append(&mut other.lower);
        self.higher.append(&mut other.higher);
    }
}

/// A vehicle that hovers tilts to where it accelerates: its nose is lower when it gets faster forward than when it brakes.
/// One on wings has its nose higher in a climb than in a descent. Differences, since wind, trim and the angle of the
/// wings shift both alike.
fn the_nose_is_up_where_it_has_to_be(view: &View<'_>, found: &mut Found) {
    let mut judged = false;
    let speed = speed_of(view);
    for reports in reports(view).values() {
        let pairs: Vec<Pair<'_>> = pairs(reports, PUSHED_FOR_S, speed).collect();
        let Some(last) = pairs.last() else { continue };
        for (raised, what) in [
            (
                hovering(&pairs),
                "where a hovering vehicle brakes than where it gets faster forward",
            ),
            (
                on_wings(&pairs),
                "where a vehicle on wings climbs than where it descends",
            ),
        ] {
            let Some(raised) = raised else { continue };
            judged = true;
            found.check(last.second, raised > 0.0, || {
                format!(
                    "expected Pitch of 4000 to be positive nose up, and so to be higher {what}; it is {:.2} rad lower",
                    -raised
                )
            });
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
    let mut lowest = f64::MAX;
    pairs.iter().filter_map(move |pair| {
        let fix = Fix::of(pair.second)?;
        lowest = lowest.min(fix.altitude);
        (fix.altitude > lowest + ALOFT_M).then_some((pair, fix))
    })
}

/// By how much the nose is higher while the vehicle brakes than while it gets faster along its nose, between two hovers.
fn hovering(pairs: &[Pair<'_>]) -> Option<f64> {
    let (mut all, mut leg) = (Noses::default(), Noses::default());
    let (mut slow, mut hovered) = (0, false);
    for (pair, fix) in aloft(pairs) {
        let pace = fix.north.hypot(fix.east);
        slow = if pace < HOVER_MPS { slow + 1 } else { 0 };
        if slow >= HOVERS_FOR {
            hovered = true;
            all.take(&mut leg);
        } else if pace > SLOW_MPS {
            hovered = false;
            leg = Noses::default();
        }
        if let Some((pushed, pitch)) = pair.push().filter(|_| hovered) {
            if pushed >= PUSHED_MPS2 {
                leg.lower.push(pitch);
            } else if pushed <= -PUSHED_MPS2 {
                leg.higher.push(pitch);
            }
        }
    }
    all.raised(EACH_TILT)
        .filter(|raised| raised.abs() >= TILTED_RAD)
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
    let (raised, steeper) = (noses.raised(EACH_CLIMB)?, paths.raised(EACH_CLIMB)?);
    let ratio = raised.abs() / steeper;
    (1.0 / WITHIN..WITHIN).contains(&ratio).then_some(raised)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::net::Datagram;
    use crate::passive::view::trace::received;
    use crate::passive::view::verdict_on;
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
                let sign = if inverted.contains(&name) { -1.0 } else { 1.0 };
                draft = draft.set(name, sign * value);
            }
            datagrams.push(received(at_ms, draft));
        }
        datagrams
    }

    fn rates(datagrams: &[Datagram]) -> Verdict {
        verdict_on(datagrams, rates_have_the_sign_of_the_change)
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
    }
}
