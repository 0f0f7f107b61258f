//! The flight of the vehicle to one item of its mission, as the mission watchdog and the landing watch follow it.
//!
//! Both judge a vehicle by the time since it last made progress. What progress is, and how long is too long, each knows by
//! itself ([`Leg`]); when an approach begins and how its time counts is the same.

use mapping::altitude::Level;
use mapping::limits::metres;
use mapping::telemetry::Telemetry;
use mavlink_link::service::mission::Item;

/// The state of the vehicle at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Moment {
    /// The vehicle's clock, s since its boot.
    pub(super) time_s: f64,
    /// When a MISSION_CURRENT last named the item, by the same clock.
    pub(super) named_s: f64,
    /// MISSION_CURRENT.seq.
    pub(super) seq: u16,
    /// Speed over ground, m/s.
    pub(super) speed_m_s: f64,
}

/// The distance to an item, over ground and in height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Away {
    pub(super) ground_m: f64,
    pub(super) height_m: f64,
}

/// What a watch keeps of the way to an item.
pub(super) trait Leg {
    /// What it is given of the vehicle.
    type Sample;

    /// The common part of that.
    fn moment(sample: &Self::Sample) -> Moment;

    /// The way begins here.
    fn begun(sample: &Self::Sample) -> Self;

    /// Updates with a distance; returns whether it is progress.
    fn is_nearer(&mut self, sample: &Self::Sample) -> bool;
}

/// The flight to one item.
#[derive(Debug, Clone, Copy)]
pub(super) struct Approach<L> {
    seq: u16,
    pub(super) leg: L,
    /// When it last made progress, s.
    pub(super) since_s: f64,
    /// The highest speed since then, m/s.
    pub(super) fastest_m_s: f64,
}

impl<L: Leg> Approach<L> {
    pub(super) fn begun(sample: &L::Sample) -> Approach<L> {
        let moment = L::moment(sample);
        Approach {
            seq: moment.seq,
            leg: L::begun(sample),
            since_s: moment.time_s,
            fastest_m_s: moment.speed_m_s,
        }
    }

    /// Updates an approach with the present state. `None` if the vehicle has made progress, or has a new item, to which an
    /// approach has begun.
    pub(super) fn follow<'a>(
        known: &'a mut Option<Approach<L>>,
        sample: &L::Sample,
    ) -> Option<&'a mut Approach<L>> {
        let moment = L::moment(sample);
        // If the clock went back, the vehicle has restarted.
        let continues = |one: &Approach<L>| one.seq == moment.seq && one.since_s <= moment.time_s;
        if !known.as_ref().is_some_and(continues) {
            *known = Some(Approach::begun(sample));
            return None;
        }
        let approach = known.as_mut()?;
        approach.fastest_m_s = approach.fastest_m_s.max(moment.speed_m_s);
        if approach.leg.is_nearer(sample) {
            approach.since_s = moment.time_s;
            // A turn back only has to cancel the speed flown since the nearest point.
            approach.fastest_m_s = moment.speed_m_s;
            return None;
        }
        Some(approach)
    }

    /// Whether the vehicle has reported this item since its last progress, and recently: a lost message must not make a passed
    /// item one that is not reached.
    pub(super) fn is_named(&self, sample: &L::Sample) -> bool {
        let moment = L::moment(sample);
        moment.named_s >= self.since_s && moment.time_s - moment.named_s <= FRESH_S
    }
}

impl Away {
    /// Takes what is nearer, over ground where that counts, and in height; returns whether anything is.
    pub(super) fn take_nearer(&mut self, away: Away, over_ground: bool) -> bool {
        // Separately: on entering AUTO.MISSION PX4 first climbs on the spot, without progress over ground.
        let ground = over_ground && away.ground_m < self.ground_m - STEP_M;
        let height = away.height_m < self.height_m - STEP_M;
        if ground {
            self.ground_m = away.ground_m;
        }
        if height {
            self.height_m = away.height_m;
        }
        ground || height
    }
}

/// The vehicle's distance to the place of an item; `None` while its own place is not known.
pub(super) fn away_from(telemetry: &Telemetry, item: &Item) -> Option<Away> {
    let here = telemetry.position?;
    let amsl_m = match Level::of_frame(item.frame, item.z.into()) {
        Some(Level::AboveHome(m)) => telemetry.home?.amsl_m + m,
        Some(Level::Amsl(m)) => m,
        None => f64::from(item.z),
    };
    let place = (f64::from(item.x) / 1e7, f64::from(item.y) / 1e7);
    Some(Away {
        ground_m: metres((here.latitude, here.longitude), place),
        height_m: (amsl_m - here.amsl_m).abs(),
    })
}

/// Minimum progress: a hovering vehicle moves by as much, m.
pub(super) const STEP_M: f64 = 1.0;
/// MISSION_CURRENT arrives each second and on change, s.
pub(super) const FRESH_S: f64 = 3.0;
/// At a hover, m.
pub(super) const HOVER_NEAR_M: f64 = 50.0;

#[cfg(test)]
mod tests {
    use super::*;

    /// A way along which each metre is progress.
    struct Metres(f64);

    impl Leg for Metres {
        type Sample = (Moment, f64);

        fn moment(sample: &(Moment, f64)) -> Moment {
            sample.0
        }

        fn begun(sample: &(Moment, f64)) -> Metres {
            Metres(sample.1)
        }

        fn is_nearer(&mut self, sample: &(Moment, f64)) -> bool {
            let nearer = sample.1 < self.0;
            self.0 = self.0.min(sample.1);
            nearer
        }
    }

    fn at(time_s: f64, speed_m_s: f64, away_m: f64) -> (Moment, f64) {
        let moment = Moment {
            time_s,
            named_s: time_s,
            seq: 3,
            speed_m_s,
        };
        (moment, away_m)
    }

    #[test]
    fn time_and_speed_count_from_the_last_progress_the_item_and_the_boot() {
        let mut known = None;
        let follow = |known: &mut Option<Approach<Metres>>, sample: &(Moment, f64)| {
            let approach = Approach::follow(known, sample);
            approach.map(|approach| (approach.since_s, approach.fastest_m_s))
        };
        assert_eq!(follow(&mut known, &at(10.0, 5.0, 100.0)), None, "it begins");
        let still = follow(&mut known, &at(11.0, 7.0, 100.0));
        assert_eq!(still, Some((10.0, 7.0)));
        assert_eq!(follow(&mut known, &at(12.0, 4.0, 90.0)), None, "nearer");
        let still = follow(&mut known, &at(13.0, 3.0, 95.0));
        assert_eq!(still, Some((12.0, 4.0)));
        let mut next = at(14.0, 3.0, 95.0);
        next.0.seq = 4;
        assert_eq!(follow(&mut known, &next), None, "the next item");
        next.0.time_s = 13.5;
        assert_eq!(follow(&mut known, &next), None, "another boot");
        next.0.time_s = 15.0;
        assert_eq!(follow(&mut known, &next), Some((13.5, 3.0)));
    }

    #[test]
    fn an_item_is_named_since_the_last_progress_and_recently() {
        let approach = Approach::<Metres>::begun(&at(10.0, 5.0, 100.0));
        let named = |time_s, named_s| {
            let mut sample = at(time_s, 5.0, 100.0);
            sample.0.named_s = named_s;
            approach.is_named(&sample)
        };
        assert!(named(11.0, 10.0) && named(13.0, 10.0));
        assert!(!named(11.0, 9.9) && !named(13.1, 10.0));
    }
}
