//! `vsm demo --wing` and `--vtol`: launch, a route with a loiter, and the landing pattern, with PX4's stock parameters.
//!
//! The picture marks what a multicopter does not have: the landing pattern (the approach route), where the landing begins
//! and ends, and each transition of a VTOL, from the vehicle's true state.

use anyhow::Context as _;
use cucs::{FurtherRoute, Loiter, LoiterSpan, Route, Station, Waypoint};
use px4_sim::{Airframe, Truth, VtolState};
use stanag_msgs::Id;
use stanag_msgs::enums::{
    AltitudeType, FlightPathControlMode as Mode, LoiterDirection, LoiterType, RouteType,
    WaypointSpeedType,
};

use super::picture::{Mark, Planned};
use super::story::{Story, await_mode, await_waypoint};
use super::track::{Point, Track};
use super::world::{Remains, north_east_deg};

/// What is flown, and by which figures.
pub(super) struct Scenario {
    airframe: Airframe,
    pub(super) title: &'static str,
    /// Number, m north and east of home, m above home.
    waypoints: &'static [(u16, f64, f64, f64)],
    /// Where it circles, for how long, s, and with which radius, m.
    loiter: (u16, u16, f64),
    /// The approach: a loiter down to its altitude, then the touch-down.
    approach: [(u16, f64, f64, f64); 2],
    radius_m: f64,
    speed_m_s: f64,
    /// Commanded at the waypoint named before it, m/s.
    faster: (u16, f64),
    launch_m: f64,
}

/// A fixed wing: FW_AIRSPD_TRIM 15 m/s, a glide of at most 5 degrees.
const WING: Scenario = Scenario {
    airframe: Airframe::Plane,
    title: "vsm demo --wing: a fixed wing, from launch to landing",
    waypoints: &[
        (1, 350.0, 0.0, 60.0),
        (2, 520.0, 260.0, 60.0),
        (3, 350.0, 560.0, 80.0),
        (4, 60.0, 480.0, 80.0),
        (5, -200.0, 330.0, 60.0),
    ],
    loiter: (2, 25, 60.0),
    approach: [(31, 60.0, -640.0, 50.0), (32, 0.0, 0.0, 2.0)],
    radius_m: 60.0,
    speed_m_s: 15.0,
    faster: (4, 18.0),
    launch_m: 60.0,
};

/// A standard VTOL: FW_AIRSPD_TRIM 10 m/s; it lands vertically.
const VTOL: Scenario = Scenario {
    airframe: Airframe::Vtol,
    title: "vsm demo --vtol: a standard VTOL, from launch to landing",
    waypoints: &[
        (1, 200.0, 0.0, 70.0),
        (2, 320.0, 160.0, 70.0),
        (3, 200.0, 340.0, 80.0),
        (4, 0.0, 300.0, 80.0),
        (5, -120.0, 150.0, 60.0),
    ],
    loiter: (2, 25, 45.0),
    approach: [(31, 0.0, -260.0, 45.0), (32, 0.0, 0.0, 2.0)],
    radius_m: 45.0,
    speed_m_s: 10.0,
    faster: (4, 11.5),
    launch_m: 40.0,
};

impl Scenario {
    pub(super) fn of(vtol: bool) -> &'static Scenario {
        if vtol { &VTOL } else { &WING }
    }

    /// The vehicle that flies it.
    pub(super) fn vehicle(&self) -> px4_sim::Config {
        px4_sim::Config {
            airframe: self.airframe,
            ..px4_sim::Config::default()
        }
    }

    fn route(&self) -> Route {
        let (at, seconds, radius_m) = self.loiter;
        let circle = |radius_m, span| Loiter {
            pattern: Some(LoiterType::Circular),
            radius_m: Some(radius_m),
            direction: Some(LoiterDirection::Clockwise),
            span,
            ..Loiter::default()
        };
        let [entry, touch_down] = self.approach.map(|point| point.0);
        let ends: Vec<u16> = self.waypoints.iter().map(|point| point.0).collect();
        let all = self.waypoints.iter().chain(&self.approach);
        let waypoints = all.map(|(number, north_m, east_m, up_m)| {
            let (latitude_deg, longitude_deg) = north_east_deg(*north_m, *east_m);
            let after = ends.iter().skip_while(|end| *end != number).nth(1);
            Waypoint {
                number: *number,
                latitude_deg,
                longitude_deg,
                altitude_m: *up_m,
                altitude_type: Some(AltitudeType::Agl),
                speed_m_s: ends.contains(number).then_some(self.speed_m_s),
                speed_type: ends
                    .contains(number)
                    .then_some(WaypointSpeedType::Indicated),
                next: match after {
                    Some(next) => *next,
                    None if *number == entry => touch_down,
                    None => 0,
                },
                loiter: if *number == at {
                    Some(circle(radius_m, Some(LoiterSpan::Seconds(seconds))))
                } else if *number == entry {
                    // Without a duration: it descends to its altitude, then flies to the touch-down.
                    Some(circle(self.radius_m, None))
                } else {
                    None
                },
                ..Waypoint::default()
            }
        });
        Route {
            mission_id: Some("DEMO".to_owned()),
            id: Some("DEMO ROUTE".to_owned()),
            waypoints: waypoints.collect(),
            further: vec![FurtherRoute {
                id: Some("DEMO LANDING".to_owned()),
                route_type: Some(RouteType::Approach),
                initial: entry,
            }],
            ..Route::default()
        }
    }

    /// What the picture shows of the plan.
    pub(super) fn planned(&self) -> Planned {
        let waypoints: Vec<(u16, Point)> = self
            .waypoints
            .iter()
            .map(|(number, north_m, east_m, up_m)| (*number, place(*north_m, *east_m, *up_m)))
            .collect();
        let legs = waypoints.iter().map(|(_, point)| *point);
        let [entry, touch_down] = self
            .approach
            .map(|(_, north_m, east_m, up_m)| place(north_m, east_m, up_m));
        Planned {
            line: std::iter::once(Point::HOME).chain(legs).collect(),
            landing: landing_line(&entry, &touch_down, self.radius_m),
            waypoints,
            ..Planned::default()
        }
    }

    /// The flown track, its marks, and how far from its place it touched down, m.
    pub(super) fn flown(&self, remains: &Remains) -> anyhow::Result<(Track, Vec<Mark>, f64)> {
        let vehicle = remains.status.vehicles.first().context("no vehicle")?;
        let items = vehicle.mission_items.context("no mission is loaded")?;
        // The pattern is the end of the mission: DO_LAND_START, the loiter, the touch-down.
        let lands = |truth: &Truth| {
            truth.mode == px4_sim::Mode::Mission
                && usize::from(truth.mission_seq) + PATTERN_ITEMS >= items
        };
        let mut track = Track::flown(&remains.track);
        let flown: Vec<&Truth> = remains.track.iter().filter(|truth| truth.armed).collect();
        let mut marks = Vec::new();
        for (before, now) in flown.iter().zip(flown.iter().skip(1)) {
            if let Some(text) = transition(before.vtol, now.vtol) {
                marks.push(Mark::at(now, text));
            }
        }
        let landing = flown.iter().find(|truth| lands(truth));
        let landing = landing.context("the landing pattern was not flown")?;
        marks.push(Mark::at(landing, "landing (mode 19)"));
        let down = flown.iter().rev().find(|truth| truth.landed || truth.armed);
        let down = down.context("it has not flown")?;
        marks.push(Mark::at(down, "touch-down"));
        marks.sort_by(|a, b| a.point.time_s.total_cmp(&b.point.time_s));
        // The route ends where the landing begins.
        let begins_s = landing.time.as_secs_f64();
        for point in &mut track.points {
            point.in_mission &= point.time_s < begins_s;
        }
        let [_, (_, north_m, east_m, _)] = self.approach;
        let off_m = (down.position.n - north_m).hypot(down.position.e - east_m);
        Ok((track, marks, off_m))
    }

    /// Everything that the CUCS does between take-over and landing.
    pub(super) async fn flight(
        &self,
        station: &mut Station,
        story: &mut Story,
        vehicle: Id,
    ) -> anyhow::Result<()> {
        let route = self.route();
        station.send_route(vehicle, &route).await?.accepted()?;
        story.tell(format!(
            "route of {} waypoints and its approach route loaded, checked by PX4's rules for wings, read back and compared",
            self.waypoints.len()
        ));
        let launched = station.launch(vehicle, self.launch_m, AltitudeType::Agl);
        launched.await?.accepted()?;
        let how = match self.airframe {
            Airframe::Vtol => "takes off vertically, and transitions at",
            _ => "rolls, takes off, and climbs to",
        };
        story.tell(format!("{how} {:.0} m", self.launch_m));
        let what = "the vehicle to loiter after its launch";
        await_mode(station, vehicle, Mode::Loiter, what).await?;
        story.tell("flies on its wings, in a loiter");
        station.fly_route(vehicle, None, None).await?.accepted()?;
        story.tell("flies the route");
        let (at, speed_m_s) = self.faster;
        for (number, ..) in self.waypoints.iter().skip(1) {
            await_waypoint(station, story, vehicle, *number).await?;
            if *number == at {
                station.change_speed(vehicle, speed_m_s).await?.accepted()?;
                story.tell(format!("faster: {speed_m_s} m/s of air speed"));
            }
        }
        Ok(())
    }
}

/// What a change of a VTOL's state is called; none where nothing changes.
fn transition(before: Option<VtolState>, now: Option<VtolState>) -> Option<&'static str> {
    if before == now {
        return None;
    }
    Some(match now? {
        VtolState::ToWings => "transition to wings",
        VtolState::Wings => "on wings",
        VtolState::ToHover => "transition to hover",
        VtolState::Hover => "hovers",
    })
}

fn place(north_m: f64, east_m: f64, up_m: f64) -> Point {
    Point {
        north_m,
        east_m,
        up_m,
        ..Point::HOME
    }
}

/// The circle down, clockwise, and from its tangent to the touch-down.
fn landing_line(entry: &Point, touch_down: &Point, radius_m: f64) -> Vec<Point> {
    let (north_m, east_m) = (
        touch_down.north_m - entry.north_m,
        touch_down.east_m - entry.east_m,
    );
    // A quarter before the course, the wing heads for the touch-down.
    let leaves = east_m.atan2(north_m) - (radius_m / north_m.hypot(east_m)).clamp(-1.0, 1.0).acos();
    let on_circle = |step: u32| {
        let bearing = leaves + std::f64::consts::TAU * f64::from(step) / f64::from(STEPS);
        place(
            entry.north_m + radius_m * bearing.cos(),
            entry.east_m + radius_m * bearing.sin(),
            entry.up_m,
        )
    };
    (0..=STEPS).map(on_circle).chain([*touch_down]).collect()
}

/// DO_LAND_START, NAV_LOITER_TO_ALT and NAV_LAND or NAV_VTOL_LAND.
const PATTERN_ITEMS: usize = 3;
/// Of a drawn circle.
const STEPS: u32 = 48;
