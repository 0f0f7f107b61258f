//! A compiled route compared with the ground, at every place it leads over, between its waypoints and on its curves too.
//!
//! Compared is what PX4 flies: straight lines between the items, in their order, also where a loop leads back, and the
//! circles of loiters with a radius. The way from the vehicle to the first waypoint is not part of a route, and a landing
//! ends on the ground. Where the terrain is unknown nothing is compared, and a note reports that.

use curve_paths::Position;
use curve_paths::terrain::{Clearance, Profile, Terrain, profile};
use mavlink_link::service::mission::Item;

use super::error::{MAX_PLACES, Reason, RouteError, TerrainError};
use super::item::{DO_JUMP, NAV_LOITER_TO_ALT};
use super::mission::{CompiledMission, touches_down};
use crate::altitude::Level;
use crate::limits::Limits;

impl CompiledMission {
    /// Checks that it stays above the ground for this altitude of home. Returns a note for the operator, if there is one.
    ///
    /// # Errors
    /// The first waypoint, in the order of the items, on the way to which it is too low.
    pub fn check_terrain(
        &self,
        home_amsl_m: f64,
        limits: &Limits,
        terrain: &Terrain,
    ) -> Result<Option<String>, RouteError> {
        let mut look = Look {
            terrain,
            spacing_m: terrain.spacing_m(),
            needed_m: limits.above_terrain_m,
            seen: Profile::default(),
            first_unknown: None,
        };
        let position = |item: &Item| {
            let level = Level::of_frame(item.frame, item.z.into())?;
            let (lat_deg, lon_deg) = (f64::from(item.x) * 1e-7, f64::from(item.y) * 1e-7);
            let flown = item.is_flown_to() && !touches_down(item);
            flown.then(|| Position::new(lat_deg, lon_deg, level.amsl(home_amsl_m)))
        };
        let mut before = None;
        for (item, waypoint) in self.items.iter().zip(&self.waypoint_of) {
            if let Some(at) = position(item) {
                look.along(before.unwrap_or(at), at, *waypoint)?;
                if let Some(radius_m) = radius_m(item) {
                    look.around(at, radius_m, *waypoint)?;
                }
                before = Some(at);
            } else if item.command == DO_JUMP
                && let Some(from) = before
            {
                let to = self.items.iter().zip(&self.waypoint_of);
                let mut to = to.skip(item.params[0].max(0.0) as usize);
                let to = to.find_map(|(item, waypoint)| Some((position(item)?, *waypoint)));
                if let Some((to, waypoint)) = to {
                    look.along(from, to, waypoint)?;
                }
            }
        }
        Ok(look.note())
    }
}

/// Checks that a vehicle may be sent straight from its position to another place, both at altitudes above mean sea level. A
/// vehicle that is already low may be sent anywhere that is no lower: climbing must always be possible.
///
/// # Errors
/// Where on the way it would be too low.
pub fn check_way(
    from: Position,
    to: Position,
    limits: &Limits,
    terrain: &Terrain,
) -> Result<(), TerrainError> {
    let spacing_m = terrain.spacing_m();
    if from.ground().distance_m(to.ground()) / spacing_m > MAX_PLACES as f64 {
        return Err(TerrainError::Long { spacing_m });
    }
    let height = |lat, lon| Ok::<_, TerrainError>(terrain.height_m(lat, lon));
    let here_m = height(from.lat_deg, from.lon_deg)?.map(|ground_m| from.alt_m - ground_m);
    let needed_m = here_m.map_or(limits.above_terrain_m, |here_m| {
        limits.above_terrain_m.min(here_m - ROUNDING_M)
    });
    match profile(from, to, spacing_m, height)?.lowest {
        Some(found) if is_low(&found, needed_m) => Err(TerrainError::Low {
            found,
            needed_m: limits.above_terrain_m,
        }),
        _ => Ok(()),
    }
}

/// A NaN counts as too low.
fn is_low(found: &Clearance, needed_m: f64) -> bool {
    found.clearance_m.is_nan() || found.clearance_m <= needed_m
}

/// A walk along a route.
struct Look<'a> {
    terrain: &'a Terrain,
    spacing_m: f64,
    needed_m: f64,
    /// So far.
    seen: Profile,
    first_unknown: Option<u16>,
}

impl Look<'_> {
    fn along(&mut self, from: Position, to: Position, waypoint: u16) -> Result<(), RouteError> {
        let at = |fault| RouteError {
            waypoint,
            reason: Reason::Terrain(fault),
        };
        let spacing_m = self.spacing_m;
        // Checked before the line is sampled: one leg alone may exceed the limit.
        let places = from.ground().distance_m(to.ground()) / spacing_m;
        if self.seen.looked_at as f64 + places > MAX_PLACES as f64 {
            return Err(at(TerrainError::Long { spacing_m }));
        }
        let height = |lat, lon| Ok::<_, RouteError>(self.terrain.height_m(lat, lon));
        let found = profile(from, to, spacing_m, height)?;
        self.seen.looked_at += found.looked_at;
        self.seen.unknown += found.unknown;
        if found.unknown > 0 {
            self.first_unknown.get_or_insert(waypoint);
        }
        match found.lowest {
            Some(found) if is_low(&found, self.needed_m) => Err(at(TerrainError::Low {
                found,
                needed_m: self.needed_m,
            })),
            _ => Ok(()),
        }
    }

    /// The circle of a loiter, in chords.
    fn around(&mut self, at: Position, radius_m: f64, waypoint: u16) -> Result<(), RouteError> {
        if radius_m.is_nan() || radius_m <= 0.0 {
            return Ok(());
        }
        let place = |part: u32| {
            let (sin, cos) =
                (f64::from(part) * std::f64::consts::TAU / f64::from(CHORDS)).sin_cos();
            let north = radius_m * cos / METRES_A_DEGREE;
            let east = radius_m * sin / (METRES_A_DEGREE * at.lat_deg.to_radians().cos().max(0.01));
            Position::new(at.lat_deg + north, at.lon_deg + east, at.alt_m)
        };
        (0..CHORDS).try_for_each(|part| self.along(place(part), place(part + 1), waypoint))
    }

    fn note(&self) -> Option<String> {
        let waypoint = self.first_unknown?;
        let percent = (100.0 * self.seen.unknown as f64 / self.seen.looked_at as f64).ceil();
        Some(format!(
            "{percent:.0} % of the route leads over places that vehicle.terrain does not cover, first on the way to waypoint \
             {waypoint}: not compared with the ground there"
        ))
    }
}

/// The radius of a loiter: NAV_LOITER_UNLIM, _TURNS and _TIME have it in param3, NAV_LOITER_TO_ALT in param2.
fn radius_m(item: &Item) -> Option<f64> {
    let radius_m = match item.command {
        17..=19 => item.params[2],
        NAV_LOITER_TO_ALT => item.params[1],
        _ => return None,
    };
    Some(radius_m.abs().into())
}

/// A circle is sampled along this many chords: with a radius of 1 km they leave it by 4 m.
const CHORDS: u32 = 36;
/// Metres in a degree of latitude.
const METRES_A_DEGREE: f64 = 111_195.0;
/// How far a hovering vehicle may seem to sink, m.
const ROUNDING_M: f64 = 1.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::route::item::{NAV_VTOL_LAND, NAV_WAYPOINT, placed};
    use curve_paths::terrain::Grid;
    use mavlink_link::service::mission::FRAME_MISSION;

    const LOITER_TIME: u16 = 19;

    /// Ground at 100 m, with a ridge of 300 m along 8.01 degrees east.
    fn ridge() -> Terrain {
        let text = "ncols 3\nnrows 3\nxllcenter 8\nyllcenter 47\ncellsize 0.01\n\
                    100 300 100\n100 300 100\n100 300 100\n";
        Terrain::new(vec![Grid::read("ridge.asc", text.into()).expect("a grid")])
    }

    fn mission(places: &[(f64, f64, Level)]) -> CompiledMission {
        let mut compiled = CompiledMission::default();
        for (number, (lat, lon, level)) in (1..).zip(places) {
            compiled.push(number, placed((*lat, *lon), *level, NAV_WAYPOINT, [0.0; 4]));
        }
        compiled
    }

    fn checked(mission: &CompiledMission, above_terrain_m: f64) -> Result<Option<String>, String> {
        let limits = Limits {
            above_terrain_m,
            ..Limits::default()
        };
        let checked = mission.check_terrain(100.0, &limits, &ridge());
        checked.map_err(|fault| fault.to_string())
    }

    #[test]
    fn a_ridge_between_two_waypoints_is_seen() {
        let over = |level| mission(&[(47.01, 8.0, level), (47.01, 8.02, level)]);
        for level in [Level::Amsl(250.0), Level::AboveHome(150.0)] {
            let why = checked(&over(level), 0.0).expect_err("it is below the ridge");
            for part in [
                "waypoint 2: on the way to it, at 47.010000, 8.0",
                "250.0 m AMSL is ",
                " m below the terrain (",
                "vehicle.limits.above_terrain_m",
            ] {
                assert!(why.contains(part), "{part}: {why}");
            }
            assert_eq!(checked(&over(level), -60.0), Ok(None));
        }
        assert_eq!(checked(&over(Level::Amsl(310.0)), 0.0), Ok(None));
        let why = checked(&over(Level::Amsl(310.0)), 30.0).expect_err("too close");
        assert!(
            why.contains("m above the terrain (") && why.contains("expected over 30.0 m"),
            "{why}"
        );
        // Each is above the ground where it stands.
        for place in [(47.01, 8.0), (47.01, 8.02)] {
            let alone = mission(&[(place.0, place.1, Level::Amsl(250.0))]);
            assert_eq!(checked(&alone, 0.0), Ok(None));
        }
        assert!(checked(&over(Level::Amsl(f64::NAN)), 0.0).is_err());
    }

    #[test]
    fn the_way_back_of_a_loop_and_the_circle_of_a_loiter_count() {
        let high = Level::Amsl(350.0);
        let low = Level::Amsl(250.0);
        // Over the ridge it is high, and low beside it: only the way back leads below the crest.
        let mut looped = mission(&[
            (47.0, 8.0, low),
            (47.0, 8.0, high),
            (47.0, 8.02, high),
            (47.0, 8.02, low),
        ]);
        assert_eq!(checked(&looped, 0.0), Ok(None));
        let jump = Item {
            frame: FRAME_MISSION,
            command: DO_JUMP,
            params: [0.0, 2.0, 0.0, 0.0],
            ..Item::default()
        };
        looped.push(4, jump);
        let why = checked(&looped, 0.0).expect_err("the way back is low");
        assert!(why.starts_with("waypoint 1: on the way to it"), "{why}");
        let circle = |radius_m: f32| {
            let mut mission = CompiledMission::default();
            let params = [10.0, 0.0, radius_m, 0.0];
            mission.push(1, placed((47.01, 8.002), low, LOITER_TIME, params));
            mission
        };
        assert_eq!(checked(&circle(0.0), 0.0), Ok(None));
        assert!(checked(&circle(-600.0), 0.0).is_err());
        // Down to an altitude: its radius is another parameter.
        let down = |radius_m: f32| {
            let mut mission = CompiledMission::default();
            let params = [1.0, radius_m, 0.0, 1.0];
            mission.push(1, placed((47.01, 8.002), low, NAV_LOITER_TO_ALT, params));
            mission
        };
        assert_eq!(checked(&down(80.0), 0.0), Ok(None));
        assert!(checked(&down(-600.0), 0.0).is_err());
    }

    #[test]
    fn where_the_terrain_is_not_known_a_note_says_so_and_a_landing_is_not_judged() {
        let high = Level::Amsl(350.0);
        let leaves = mission(&[(47.01, 8.0, high), (47.01, 8.04, high)]);
        let note = checked(&leaves, 0.0)
            .expect("what is known is below")
            .expect("a note");
        assert!(note.contains("on the way to waypoint 2"), "{note}");
        assert!(note.starts_with("49 %") || note.starts_with("5"), "{note}");
        let mut lands = mission(&[(47.01, 8.0, high)]);
        lands.order.push(crate::route::Leg {
            number: 1,
            latitude: 47.01,
            longitude: 8.0,
            level: high,
            speed_m_s: None,
        });
        let mut hovers_down = lands.clone();
        lands.land_at_the_end();
        assert_eq!(checked(&lands, 0.0), Ok(None));
        let ground = Level::AboveHome(0.0);
        hovers_down.push(0, placed((47.01, 8.0), ground, NAV_VTOL_LAND, [0.0; 4]));
        assert_eq!(checked(&hovers_down, 0.0), Ok(None));
    }

    #[test]
    fn a_route_that_would_take_too_long_to_compare_is_refused() {
        let far = mission(&[
            (0.0, 0.0, Level::Amsl(9_000.0)),
            (0.0, 170.0, Level::Amsl(9_000.0)),
        ]);
        // 19,000 km each 30 m: over what is compared.
        let refused = checked(&far, 0.0).expect_err("too long");
        assert!(refused.contains("divide it"), "{refused}");
    }

    #[test]
    fn a_vehicle_is_not_sent_through_a_ridge_and_always_upwards() {
        let (terrain, limits) = (ridge(), Limits::default());
        let way = |from, to| check_way(from, to, &limits, &terrain);
        let at = |lon, alt_m| Position::new(47.01, lon, alt_m);
        assert!(way(at(8.0, 250.0), at(8.02, 250.0)).is_err());
        assert_eq!(way(at(8.0, 320.0), at(8.02, 320.0)), Ok(()));
        // Below the ground of the files, which may be wrong: no lower, and not along the slope.
        assert_eq!(way(at(8.0, 95.0), at(8.0, 130.0)), Ok(()));
        assert_eq!(way(at(8.0, 95.0), at(8.0, 95.0)), Ok(()));
        assert!(way(at(8.0, 95.0), at(8.0, 90.0)).is_err());
        assert!(way(at(8.0, 95.0), at(8.01, 130.0)).is_err());
    }
}
