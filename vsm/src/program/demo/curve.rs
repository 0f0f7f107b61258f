//! `vsm demo --curve`: a section of the Everland Speedway by nine cubic legs, end to end by DLI messages.

use std::fmt::Write as _;
use std::path::Path;

use crate::session::Status;
use anyhow::{Context as _, bail};
use cucs::{Route, Session, Station};
use curve_paths::flight::{Flown, measure};
use curve_paths::{BezierLeg, Control, Densified, Leg, Options, Position, densify};
use mapping::route::Curved;
use px4_sim::{Geodetic, LocalFrame, Truth};
use stanag_msgs::enums::{AltitudeType, FlightPathControlMode as Mode};
use stanag_msgs::{Envelope, Id, MAX_DATAGRAM, Message};

use super::picture::Planned;
use super::story::{FLIGHT_WITHIN, Story, await_mode};
use super::track::Point;

/// The route: also an example for `cucs send`.
const ROUTE: &str = include_str!("../../../../examples/everland.route.toml");

/// The section as it is flown and drawn.
pub(crate) struct Section {
    pub(crate) route: Route,
    legs: Vec<Leg>,
    densified: Densified,
}

/// How the flight compares with the plan.
pub(crate) struct Compared {
    pub(crate) flown: Flown,
    reported: Curved,
    items: usize,
}

impl Section {
    pub(crate) fn new() -> anyhow::Result<Section> {
        let route = Route::parse(Path::new("everland.route.toml"), ROUTE)?;
        let end = |number: u16| -> anyhow::Result<Position> {
            let found = route.waypoints.iter().find(|w| w.number == number);
            let w = found.with_context(|| format!("waypoint {number} is missing"))?;
            Ok(Position::new(w.latitude_deg, w.longitude_deg, w.altitude_m))
        };
        let legs: anyhow::Result<Vec<Leg>> = route
            .curves
            .iter()
            .map(|curve| {
                let [p2, p3] = [curve.p2, curve.p3]
                    .map(|place| Control::level(place.latitude_deg, place.longitude_deg));
                Ok(BezierLeg::new(end(curve.from)?, p2, p3, end(curve.to)?)?.into())
            })
            .collect();
        let legs = legs?;
        let densified = densify(&legs, &Options::flight(TOLERANCE_M))?;
        Ok(Section {
            route,
            legs,
            densified,
        })
    }

    /// Where the simulator stands: beside the start, on the track's ground.
    pub(crate) fn home(&self) -> Geodetic {
        let start = self.start();
        let beside = LocalFrame::new(Geodetic {
            latitude_deg: start.lat_deg,
            longitude_deg: start.lon_deg,
            altitude_m: GROUND_M,
        });
        beside.to_global(px4_sim::Ned::new(-60.0, 0.0, 0.0))
    }

    fn start(&self) -> Position {
        self.densified.vertices[0].position
    }

    /// What the picture shows of it, in metres from home.
    pub(crate) fn planned(&self) -> Planned {
        let frame = LocalFrame::new(self.home());
        let point = |p: Position| {
            let at = frame.to_local(Geodetic {
                latitude_deg: p.lat_deg,
                longitude_deg: p.lon_deg,
                altitude_m: GROUND_M + p.alt_m,
            });
            Point {
                time_s: 0.0,
                north_m: at.n,
                east_m: at.e,
                up_m: p.alt_m,
                in_mission: false,
            }
        };
        let numbers = self.route.waypoints.iter().map(|waypoint| {
            let (lat, lon) = (waypoint.latitude_deg, waypoint.longitude_deg);
            (
                waypoint.number,
                point(Position::new(lat, lon, waypoint.altitude_m)),
            )
        });
        let mut planned = Planned {
            waypoints: numbers.collect(),
            vertices: self
                .densified
                .vertices
                .iter()
                .map(|vertex| point(vertex.position))
                .collect(),
            ..Planned::default()
        };
        for leg in &self.legs {
            let Leg::Bezier(leg) = leg else { continue };
            planned
                .line
                .extend((0..=DRAWN).map(|k| point(leg.at(f64::from(k) / f64::from(DRAWN)))));
            for (end, control) in [(leg.p1(), leg.p2()), (leg.p4(), leg.p3())] {
                let place = Position::new(control.lat_deg, control.lon_deg, end.alt_m);
                planned.arms.push([point(end), point(place)]);
            }
        }
        planned
    }

    /// The flight beside the plan.
    pub(crate) fn compare(&self, track: &[Truth], status: &Status) -> anyhow::Result<Compared> {
        let vehicle = status.vehicles.first().context("no vehicle")?;
        let reported = vehicle
            .mission_curves
            .context("the bridge has loaded no curves")?;
        let items = vehicle.mission_items.unwrap_or(0);
        let track: Vec<Position> = track
            .iter()
            .filter(|truth| truth.armed)
            .map(|truth| {
                let at = truth.place;
                Position::new(
                    at.latitude_deg,
                    at.longitude_deg,
                    at.altitude_m - self.home().altitude_m,
                )
            })
            .collect();
        let flown = measure(&self.legs, &self.densified, &track, ACCEPTANCE_M)
            .context("the route was not flown from its start to its end")?;
        Ok(Compared {
            flown,
            reported,
            items,
        })
    }

    /// Bytes of the messages that describe it, and of the straight waypoints that would: route and load apart.
    fn bytes(&self) -> anyhow::Result<(usize, usize)> {
        let size = |message: &Message| {
            let mut bytes = [0; MAX_DATAGRAM];
            message
                .encode(&Envelope::new(Id(1), Id(2)), &mut bytes)
                .unwrap_or(0)
        };
        let messages = self.route.messages(Id(1), Id(2))?;
        let waypoint = messages
            .iter()
            .find(|message| matches!(message, Message::UaPositionWaypoint(_)))
            .map_or(0, size);
        let curved = messages
            .iter()
            .filter(|message| !matches!(message, Message::UaRoute(_)))
            .map(size)
            .sum();
        Ok((curved, waypoint * self.densified.vertices.len()))
    }

    /// The report at the end.
    pub(crate) fn report(&self, compared: &Compared) -> anyhow::Result<String> {
        let Compared {
            flown,
            reported,
            items,
        } = compared;
        let (curved, straight) = self.bytes()?;
        let percent = 100.0 * flown.passed as f64 / flown.points as f64;
        let mut text = format!(
            "\nEverland Speedway, a section of {:.2} km\n",
            self.length_m() / 1e3
        );
        let _ = writeln!(
            text,
            "  curved legs                {:>8}\n  \
             points flown               {:>8}   of {} mission items\n  \
             DLI bytes                 {curved:>8}   {straight} as straight waypoints (13002) at those points\n  \
             tolerance                  {:>8.2} m\n  \
             deviation, proven          {:>8.2} m   of the chords from the curves\n  \
             deviation, predicted       {:>8.2} m   of the flight, not promised\n  \
             deviation, flown           {:>8.2} m\n  \
             points passed              {percent:>8.0} %   within the acceptance radius of {ACCEPTANCE_M} m",
            reported.legs,
            flown.points,
            items,
            reported.tolerance_m,
            reported.bound_m,
            reported.predicted_m.unwrap_or(f64::NAN),
            flown.deviation_m,
        );
        Ok(text)
    }

    fn length_m(&self) -> f64 {
        let bezier = |leg: &Leg| match leg {
            Leg::Bezier(leg) => leg.length_m(),
            Leg::Straight { .. } => 0.0,
        };
        self.legs.iter().map(bezier).sum()
    }
}

/// Everything that the CUCS does.
pub(crate) async fn flight(
    station: &mut Station,
    story: &mut Story,
    vehicle: Id,
    section: &Section,
) -> anyhow::Result<()> {
    let sent = station.send_route(vehicle, &section.route).await?;
    sent.accepted()?;
    story.tell(format!(
        "route of {} curved legs loaded, read back and compared",
        section.route.curves.len()
    ));
    let said = station
        .vehicle(vehicle)
        .into_iter()
        .flat_map(|vehicle| vehicle.alerts())
        .find(|alert| alert.text.contains("curved legs in"))
        .map(|alert| alert.text.clone());
    let Some(said) = said else {
        bail!("no alert reported the curves at load")
    };
    story.tell(said);
    station
        .launch(vehicle, LAUNCH_M, AltitudeType::Agl)
        .await?
        .accepted()?;
    story.tell(format!("launched to {LAUNCH_M:.0} m"));
    let held = "the vehicle to hold after its launch";
    await_mode(station, vehicle, Mode::Loiter, held).await?;
    station.fly_route(vehicle, None, None).await?.accepted()?;
    story.tell("flies the curves");
    let end = section.route.waypoints.last().map(|last| last.number);
    let mut passed = None;
    while passed != end {
        let another = |session: &Session| {
            session
                .vehicle(vehicle)
                .is_some_and(|v| v.from_waypoint() != passed)
        };
        station
            .wait_until("the next waypoint", FLIGHT_WITHIN, another)
            .await?;
        passed = station.vehicle(vehicle).and_then(|v| v.from_waypoint());
        if let Some(number) = passed {
            story.tell(format!("waypoint {number} passed"));
        }
    }
    Ok(())
}

/// `vehicle.curve.tolerance_m` of the demo: the default.
const TOLERANCE_M: f64 = 1.0;
/// What the bridge gives chords this long.
const ACCEPTANCE_M: f64 = 3.0;
const LAUNCH_M: f64 = 30.0;
/// The track's ground, m above mean sea level.
const GROUND_M: f64 = 140.0;
/// Samples of a curve in the picture.
const DRAWN: u32 = 48;
