//! PAYL-007, the image centre: valid only where the camera sees ground, and where its line of sight meets that.
//!
//! The place in 21101 is of one moment, and each 4000 of another. Between the two a vehicle flies, turns and tilts, a simulation
//! ten times as far as it seems, and a busy computer makes the time between them longer. So the place is compared with what
//! every 4000 around the report makes of it: from a second before, since a camera may compute it that seldom, to the next one
//! after. How far these differ among themselves is allowed as well, and where that is so much that even a centre straight below
//! the vehicle would be near enough, nothing is judged: there is another look, by then perhaps of a vehicle at rest.

use std::time::Duration;

use super::payload::{by_angles, operating_state, stations, steer, take_station, turns};
use super::scene::Scene;
use crate::bench::flight::{Fix, airborne, fix, hold, home, wrapped};
use crate::bench::station::Station;
use crate::bench::trial::Trial;
use crate::verdict::{Judged, Precondition, Stop};
use crate::wire::Seen;

pub(super) const SCENES: &[Scene] = &[Scene {
    rule: "PAYL-007",
    play: no_image_centre_above_the_horizon,
}];

fn no_image_centre_above_the_horizon(t: &Trial) -> Judged {
    let station = stations(t)?[0];
    let (a, _) = t.payload_pair()?;
    take_station(t, &a, station).precondition("LOI 3 is granted")?;
    a.send(by_angles(station));
    a.send(
        steer(station, 0.0)
            .set("Set Centreline Elevation Angle", 0.35)
            .acked(),
    );
    let deadline = t.bench.net.now() + t.timers().begin.min(t.timers().answer * 3);
    while t.bench.net.now() < deadline {
        let state = operating_state(&a, station)?;
        let up = state
            .value("Actual Centreline Elevation Angle")
            .is_some_and(|elevation| elevation > 0.1);
        if up {
            let valid = state.raw("Image Position");
            t.expect_beside(&state, valid.unwrap_or_default() == 0, || {
                format!("expected no valid image centre in 21101 while the camera looks above the horizon, got Image Position {valid:?}")
            })?;
            a.send(steer(station, 0.0).acked());
            a.release()?;
            return image_centre_in_flight(t, station);
        }
        t.pause(Duration::from_millis(100))?;
    }
    Err(Stop::not_applicable(
        "the camera does not look above the horizon",
    ))
}

/// Looks until one can be judged: a vehicle that the rule before has left in motion needs some seconds to stop.
const LOOKS: usize = 5;

/// In flight the centre of the image is where the line of sight meets the ground. Away from flat ground that is not
/// known, so it is judged near home only.
fn image_centre_in_flight(t: &Trial, station: u8) -> Judged {
    if !t.may_fly() {
        return Ok(());
    }
    let Ok(a) = airborne(t) else { return Ok(()) };
    let home = home(t, &a)?;
    if take_station(t, &a, station).is_err() {
        return Ok(());
    }
    let mut unjudged = "";
    for _ in 0..LOOKS {
        // Mode 12 may be that of a failsafe, which holds before it returns.
        hold(t, &a)?;
        a.send(by_angles(station));
        a.send(
            steer(station, 0.6)
                .set("Set Centreline Elevation Angle", -0.9)
                .acked(),
        );
        turns(t, &a, station, 0.6, t.timers().begin)?;
        match look(t, &a, station, &home)? {
            Ok(()) => return Ok(()),
            Err(reason) => unjudged = reason,
        }
    }
    t.note(unjudged);
    Ok(())
}

/// One report and the 4000s around it; why it is not judged where it is not.
fn look(t: &Trial, a: &Station, station: u8, home: &Fix) -> Judged<Result<(), &'static str>> {
    let mark = t.bench.net.mark();
    fix(t, a)?;
    let before = operating_state(a, station)?;
    let before = Image::of(&before);
    t.pause(t.timers().answer / 2)?;
    let state = operating_state(a, station)?;
    fix(t, a)?;
    let around: Vec<Fix> = a
        .received(mark, |seen| seen.kind() == 4000)
        .iter()
        .filter_map(|seen| Fix::of(seen))
        .collect();
    let Some(image) = Image::of(&state) else {
        return Ok(Err("no image centre is reported in flight"));
    };
    // Angles and place may be of two moments too.
    if before.is_none_or(|before| image.turned_since(&before)) {
        return Ok(Err(
            "the camera still turns: the place of the image centre is not judged",
        ));
    }
    let Some(found) = image.compare(&around, home) else {
        return Ok(Err(
            "the camera does not look down from 10 m or more: the place of the image centre is not judged",
        ));
    };
    if !found.judges() {
        return Ok(Err(
            "the vehicle moves too far between two reports: the place of the image centre is not judged",
        ));
    }
    t.expect_of(&state, found.off_m <= found.allowed_m, || {
        format!(
            "expected the image centre {:.0} m ahead of the vehicle, where the line of sight meets the ground; 21101 shows it {:.0} m from there, and {:.0} m are allowed",
            found.far_m, found.off_m, found.allowed_m
        )
    })?;
    Ok(Ok(()))
}

/// A valid image centre, and the direction in which the camera looks, from the vehicle's axes; all in radians.
#[derive(Clone, Copy, Debug)]
struct Image {
    latitude: f64,
    longitude: f64,
    azimuth: f64,
    elevation: f64,
}

/// How far an image centre is from where it has to be, in metres.
#[derive(Clone, Copy, Debug)]
struct Compared {
    /// How far ahead of the vehicle the line of sight meets the ground.
    far_m: f64,
    off_m: f64,
    allowed_m: f64,
}

impl Compared {
    /// Whether a centre straight below the vehicle would be found.
    fn judges(&self) -> bool {
        self.allowed_m < self.far_m
    }
}

/// How steep the line of sight has to be: at a shallower one a degree is many metres, and the ground may not be flat that far.
const DOWN: f64 = 0.48;

impl Image {
    fn of(state: &Seen) -> Option<Self> {
        if state.raw("Image Position").unwrap_or_default() == 0 {
            return None;
        }
        Some(Self {
            latitude: state.value("Latitude of image centre")?,
            longitude: state.value("Longitude of image centre")?,
            azimuth: state.value("Actual Centreline Azimuth Angle")?,
            elevation: state.value("Actual Centreline Elevation Angle")?,
        })
    }

    /// Whether the camera has turned from where it looked before, by more than a drive does in wind.
    fn turned_since(&self, before: &Self) -> bool {
        let azimuth = wrapped(self.azimuth - before.azimuth);
        azimuth.abs().max((self.elevation - before.elevation).abs()) > 0.05
    }

    /// Compares it with what each of these positions makes of its direction, on ground as high as `home`; `None` where one of them is too
    /// low, or too shallow, or not comparable.
    fn compare(&self, around: &[Fix], home: &Fix) -> Option<Compared> {
        let mut far_m: f64 = 0.0;
        let mut misses = Vec::new();
        for fix in around {
            let height = fix.altitude - home.altitude;
            let [north, east, down] = fix.sight(self.azimuth, self.elevation)?;
            if fix.altitude_type != home.altitude_type || height < 10.0 || down < DOWN {
                return None;
            }
            let (to_north, to_east) = (height * north / down, height * east / down);
            far_m = far_m.max(to_north.hypot(to_east));
            let (from_north, from_east) = fix.from(self.latitude, self.longitude);
            misses.push((from_north + to_north, from_east + to_east));
        }
        let &(north, east) = misses.first()?;
        let sway = misses
            .iter()
            .map(|miss| (miss.0 - north).hypot(miss.1 - east));
        let allowed_m = 12.0 + 0.25 * far_m + sway.fold(0.0, f64::max);
        let off = misses.iter().map(|miss| miss.0.hypot(miss.1));
        Some(Compared {
            far_m,
            off_m: off.fold(f64::INFINITY, f64::min),
            allowed_m,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where a vehicle was first seen.
    const HOME: Fix = Fix {
        at: Duration::ZERO,
        latitude: 0.8,
        longitude: 0.1,
        altitude: 500.0,
        altitude_type: 3,
        north: 0.0,
        east: 0.0,
        down: 0.0,
        heading: Some(0.0),
        roll: Some(0.0),
        pitch: Some(0.0),
    };

    /// A flight 50 m above home: where it is and how it is turned and tilted, by seconds of its own time.
    type Flight = fn(f64) -> Fix;

    fn at(north: f64, east: f64, heading: f64, [roll, pitch]: [f64; 2]) -> Fix {
        let (latitude, longitude) = HOME.offset(north, east);
        Fix {
            latitude,
            longitude,
            altitude: HOME.altitude + 50.0,
            heading: Some(heading),
            roll: Some(roll),
            pitch: Some(pitch),
            ..HOME
        }
    }

    fn hovers(time: f64) -> Fix {
        at(0.3 * time.sin(), 0.2, 0.8, [0.01, 0.02 * time.cos()])
    }

    /// At 5 m/s against its drag, so with its nose 27 degrees down.
    fn returns(time: f64) -> Fix {
        at(5.0 * time, 0.0, 0.0, [0.0, -0.47])
    }

    /// It stops at 5 s, with its nose up meanwhile.
    fn brakes(time: f64) -> Fix {
        let left = (5.0 - time).max(0.0);
        let pitch = if left > 0.0 { 0.3 } else { 0.0 };
        at(-left * left / 2.0, 0.0, 0.0, [0.0, pitch])
    }

    fn turns_round(time: f64) -> Fix {
        at(0.0, 0.0, 1.0 * time, [0.0, 0.0])
    }

    /// A wing at 20 m/s on a circle of 80 m.
    fn circles(time: f64) -> Fix {
        let turn = time / 4.0;
        at(80.0 * turn.sin(), -80.0 * turn.cos(), turn, [0.47, 0.0])
    }

    /// What a camera at these angles sees from there.
    fn seen_from(fix: &Fix, azimuth: f64, elevation: f64) -> Image {
        let [north, east, down] = fix.sight(azimuth, elevation).unwrap();
        let height = fix.altitude - HOME.altitude;
        let (latitude, longitude) = fix.offset(height * north / down, height * east / down);
        Image {
            latitude,
            longitude,
            azimuth,
            elevation,
        }
    }

    /// The 4000s of 1.2 s, one in 0.2 s, of a flight so much faster than time, of which the last is later by `delay`.
    fn around(flight: Flight, speed: f64, begin: f64, delay: f64) -> Vec<Fix> {
        let times = (0..6).map(|step| f64::from(step) * 0.2);
        let times = times.chain([1.2 + delay]);
        times.map(|time| flight(begin + time * speed)).collect()
    }

    /// Ahead and down; and to the right of a wing, which is 63 degrees down while it banks.
    const AHEAD: (f64, f64) = (0.6, -0.9);
    const RIGHT: (f64, f64) = (1.6, -0.45);

    #[test]
    fn a_right_image_centre_is_never_accused_however_the_vehicle_moves_and_the_computer_waits() {
        let flights: [Flight; 5] = [hovers, returns, brakes, turns_round, circles];
        for (index, flight) in flights.into_iter().enumerate() {
            for (azimuth, elevation) in [AHEAD, RIGHT] {
                for speed in [1.0, 10.0] {
                    for delay in [0.0, 0.1, 0.5, 1.0, 3.0] {
                        for step in 0..40 {
                            let begin = f64::from(step) * 0.25;
                            let fixes = around(flight, speed, begin, delay);
                            // Measured up to a second before the report was sent.
                            for age in [0.0, 0.3, 1.0] {
                                let then = flight(begin + (1.0 - age) * speed);
                                let image = seen_from(&then, azimuth, elevation);
                                let found = image.compare(&fixes, &HOME);
                                let right = found.is_none_or(|found| {
                                    !found.judges() || found.off_m <= found.allowed_m
                                });
                                assert!(
                                    right,
                                    "flight {index} at {begin} s, {speed} {delay} {age}: {found:?}"
                                );
                            }
                        }
                    }
                }
            }
        }
    }

    /// What was seen of a simulation ten times as fast as time, on a computer that did something else as well.
    #[test]
    fn by_the_next_position_alone_a_vehicle_in_flight_would_be_accused() {
        let image = seen_from(&returns(10.0), 0.6, -0.9);
        for (delay, off) in [(0.1, 5.0), (0.5, 25.0), (0.72, 36.0), (1.0, 50.0)] {
            let next = [returns(10.0 + 10.0 * delay)];
            let found = image.compare(&next, &HOME).unwrap();
            assert!((found.off_m - off).abs() < 0.1, "{found:?}");
        }
    }

    #[test]
    fn a_wrong_image_centre_is_found_of_a_vehicle_that_hovers_and_of_a_wing() {
        let is_found = |image: &Image, fixes: &[Fix]| {
            let found = image.compare(fixes, &HOME).unwrap();
            found.judges() && found.off_m > found.allowed_m
        };
        let cases: [(Flight, f64, (f64, f64)); 3] = [
            (hovers, 1.0, AHEAD),
            (hovers, 10.0, AHEAD),
            (circles, 1.0, RIGHT),
        ];
        for (flight, speed, (azimuth, elevation)) in cases {
            let (fixes, now) = (around(flight, speed, 3.0, 0.0), flight(3.0 + speed));
            let right = seen_from(&now, azimuth, elevation);
            assert!(!is_found(&right, &fixes), "{right:?}");
            // Straight below the vehicle.
            let below = Image {
                latitude: now.latitude,
                longitude: now.longitude,
                ..right
            };
            assert!(is_found(&below, &fixes), "{below:?}");
        }
        let fixes = around(hovers, 1.0, 3.0, 0.0);
        let mirrored = Image {
            azimuth: AHEAD.0,
            ..seen_from(&fixes[5], -AHEAD.0, AHEAD.1)
        };
        assert!(is_found(&mirrored, &fixes), "{mirrored:?}");
    }

    #[test]
    fn a_camera_that_turns_is_waited_for() {
        let image = seen_from(&hovers(0.0), 3.13, -0.9);
        let to = |azimuth: f64, elevation: f64| Image {
            azimuth,
            elevation,
            ..image
        };
        // Across the tail.
        assert!(!to(-3.13, -0.92).turned_since(&image));
        assert!(to(-3.05, -0.9).turned_since(&image));
        assert!(to(3.13, -0.8).turned_since(&image));
    }

    #[test]
    fn what_is_too_low_too_shallow_or_of_another_datum_is_not_judged() {
        let fix = hovers(0.0);
        let image = seen_from(&fix, 0.6, -0.9);
        let compare = |image: &Image, fix: Fix| image.compare(&[fix], &HOME).is_some();
        assert!(compare(&image, fix));
        let altitude = HOME.altitude + 9.0;
        assert!(!compare(&image, Fix { altitude, ..fix }));
        let altitude_type = 1;
        assert!(!compare(
            &image,
            Fix {
                altitude_type,
                ..fix
            }
        ));
        let heading = None;
        assert!(!compare(&image, Fix { heading, ..fix }));
        // The nose 30 degrees up.
        let pitch = Some(0.52);
        assert!(!compare(&image, Fix { pitch, ..fix }));
        assert!(image.compare(&[], &HOME).is_none());
    }
}
