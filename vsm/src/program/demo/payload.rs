//! `vsm demo --payload`: one CUCS flies a route, another holds LOI 3 of the payload station: it points, zooms, records and takes
//! a photograph.
//!
//! The picture draws where the sensor looked only by reports of the vehicle: the image centre of 21101, from the position
//! of the 4000 before it. A commanded value appears only as the text of a mark.

use std::time::Duration;

use anyhow::Context as _;
use cucs::{Event, PayloadAction, Position, Sensor, Session, Station, Switch, ZoomTo};
use stanag_msgs::enums::{
    AltitudeType, EoirPointingMode as Pointing, FlightPathControlMode as Mode, LoiBitmap,
    RequestedAccess, StationBitmap1To16,
};
use stanag_msgs::{Id, Message};

use super::picture::Mark;
use super::story::{FLIGHT_WITHIN, Story, await_mode, await_position, await_waypoint, discover};
use super::straight::{self, Row};
use super::track::Look;
use super::world::{OPERATOR, World, north_east_deg, north_east_m};

/// What the operator has seen and done.
#[derive(Debug, Default)]
pub(super) struct Watched {
    at: Option<Position>,
    looks: Vec<Look>,
    pub(super) marks: Vec<Mark>,
    /// States without an image centre.
    nowhere: usize,
}

impl Watched {
    /// What has arrived since the last time.
    async fn drain(&mut self, station: &mut Station, vehicle: Id) {
        while let Ok(event) = station.next_event(Duration::ZERO).await {
            let Event::Message { from, message } = event else {
                continue;
            };
            if from == vehicle {
                self.take(&message);
            }
        }
    }

    fn take(&mut self, message: &Message) {
        match message {
            Message::InertialStates(m) => {
                let place = m.latitude.zip(m.longitude).zip(m.altitude);
                self.at = place.map(|((latitude, longitude), altitude)| Position {
                    latitude_deg: latitude.degrees(),
                    longitude_deg: longitude.degrees(),
                    altitude_m: altitude.si(),
                    altitude_type: m.altitude_type.unwrap_or(AltitudeType::Wgs84),
                });
            }
            Message::EoIrLaserOperatingState(m) => {
                let center = m.latitude_of_image_centre.zip(m.longitude_of_image_centre);
                let valid = m.image_position == Some(1);
                let Some(((latitude, longitude), at)) = center.filter(|_| valid).zip(self.at)
                else {
                    self.nowhere += 1;
                    return;
                };
                let field = m.actual_horizontal_field_of_view.zip(m.reported_range);
                let from = north_east_m(at.latitude_deg, at.longitude_deg);
                let to = north_east_m(latitude.degrees(), longitude.degrees());
                self.looks.push(Look {
                    from,
                    to,
                    away_m: (to.0 - from.0).hypot(to.1 - from.1),
                    half_width_m: field
                        .map(|(field, range_m)| f64::from(range_m) * (field.radians() / 2.0).tan()),
                    mode: m.pointing_mode_state,
                });
            }
            _ => {}
        }
    }

    /// What the picture shows: a look along the horizon ends kilometres away, where nothing else is.
    pub(super) fn near(&self) -> Vec<Look> {
        let near = |look: &&Look| look.away_m <= NEAR_M;
        self.looks.iter().filter(near).copied().collect()
    }

    /// What the reports say of the two ways of pointing.
    pub(super) fn report(&self) -> String {
        let of = |mode| {
            self.looks
                .iter()
                .filter(move |look| look.mode == Some(mode))
        };
        let (north_m, east_m) = PLACE;
        // The first reports in this mode show the gimbal still turning.
        let off = of(Pointing::LatLongSlaved).skip(TURNING);
        let off_m = off
            .map(|look| (look.to.0 - north_m).hypot(look.to.1 - east_m))
            .fold(0.0, f64::max);
        format!(
            "\nimage centres reported (21101): {} by angles, {} slaved to a place, at most {off_m:.1} m from it; \
             {} states without one; {} drawn, nearer than {NEAR_M} m\n",
            of(Pointing::AngleToUa).count(),
            of(Pointing::LatLongSlaved).count(),
            self.nowhere,
            self.near().len()
        )
    }
}

/// Both CUCSs, until the route is flown and the operator has finished.
pub(super) async fn flight(
    world: &World,
    pilot: &mut Station,
    story: &Story,
    vehicle: Id,
) -> anyhow::Result<Watched> {
    let mut operator = Station::bind(OPERATOR, "127.0.0.1:0".parse()?, world.vsm).await?;
    let (_, watched) = tokio::try_join!(
        fly(pilot, story, vehicle),
        operate(world, &mut operator, story)
    )?;
    Ok(watched)
}

async fn fly(station: &mut Station, story: &Story, vehicle: Id) -> anyhow::Result<()> {
    station
        .send_route(vehicle, &straight::route(WAYPOINTS))
        .await?
        .accepted()?;
    story.tell("pilot: route loaded, read back and compared");
    let launched = station.launch(vehicle, UP_M, AltitudeType::Agl).await?;
    launched.accepted()?;
    story.tell(format!("pilot: launched to {UP_M:.0} m"));
    let what = "the vehicle to hold after its launch";
    await_mode(station, vehicle, Mode::Loiter, what).await?;
    station.fly_route(vehicle, None, None).await?.accepted()?;
    story.tell("pilot: flies the route");
    for (number, ..) in WAYPOINTS.iter().skip(1) {
        await_waypoint(station, story, vehicle, *number).await?;
    }
    Ok(())
}

async fn operate(world: &World, station: &mut Station, story: &Story) -> anyhow::Result<Watched> {
    let vehicle = discover(station).await?;
    let first = StationBitmap1To16::STATION_1;
    // The devices report some seconds after the autopilot: until then the station does not exist.
    let mut tries = 0;
    loop {
        let access = RequestedAccess::Request;
        let taken = station.request_stations(vehicle, LoiBitmap::LOI3, first, access);
        match taken.await {
            Ok(_) => break,
            Err(_) if tries < 15 => station.idle(Duration::from_secs(1)).await?,
            Err(fault) => return Err(fault).context("the operator"),
        }
        tries += 1;
    }
    story.tell("operator: LOI 3 of payload station 1 granted");
    await_position(station, vehicle).await?;
    let ground_m = height(station, vehicle)?;
    wait(station, "30 m of height", |session| {
        let at = session.vehicle(vehicle).and_then(|one| one.position());
        at.is_some_and(|at| at.altitude_m > ground_m + UP_M - 5.0)
    })
    .await?;
    let mut watched = Watched::default();
    for (waypoint, action, text) in actions() {
        let to = |session: &Session| session.vehicle(vehicle).and_then(|one| one.to_waypoint());
        wait(station, "the vehicle to be on its way", |session| {
            waypoint == 0 || to(session).is_some_and(|now| now >= waypoint)
        })
        .await?;
        let outcome = action.carry_out(station, vehicle, 1).await?;
        outcome.accepted()?;
        watched.marks.push(Mark::at(&world.truth(), text));
        story.tell(format!("operator: {text}"));
        watched.drain(station, vehicle).await;
    }
    wait(station, "the end of the route", |session| {
        let state = session.vehicle(vehicle);
        state.is_some_and(|one| one.from_waypoint().is_some() && one.to_waypoint().is_none())
    })
    .await?;
    station.release(vehicle).await?;
    watched.drain(station, vehicle).await;
    Ok(watched)
}

fn height(station: &Station, vehicle: Id) -> anyhow::Result<f64> {
    let state = station.vehicle(vehicle);
    let at = state.and_then(|state| state.position());
    Ok(at.context("a vehicle without position")?.altitude_m)
}

async fn wait(
    station: &mut Station,
    what: &str,
    reached: impl FnMut(&Session) -> bool,
) -> anyhow::Result<()> {
    Ok(station.wait_until(what, FLIGHT_WITHIN, reached).await?)
}

/// What the operator does, each from when the vehicle flies to this waypoint.
fn actions() -> Vec<(u16, PayloadAction, &'static str)> {
    let (latitude, longitude) = north_east_deg(PLACE.0, PLACE.1);
    let look = |azimuth, elevation| PayloadAction::Point { azimuth, elevation };
    let record = |switch| PayloadAction::Record { switch };
    let zoom = |to| PayloadAction::Zoom { to };
    let image = |sensor| PayloadAction::Image { sensor };
    vec![
        (0, look(40.0, -40.0), "looks right"),
        (2, zoom(ZoomTo::Field(20.0)), "zooms to 20\u{b0}"),
        (
            2,
            PayloadAction::At {
                place: (latitude, longitude),
                altitude: 0.0,
                altitude_type: AltitudeType::Agl,
            },
            "looks at a place",
        ),
        (2, record(Switch::On), "records"),
        (3, image(Sensor::Ir), "IR"),
        (4, record(Switch::Off), "ends recording"),
        (4, PayloadAction::Photo, "photograph"),
        (5, zoom(ZoomTo::Field(40.0)), "zooms to 40\u{b0}"),
        (5, look(-60.0, -50.0), "looks left"),
    ]
}

pub(super) const WAYPOINTS: &[Row] = &[
    (1, 40.0, 0.0, UP_M, SPEED_M_S, 2),
    (2, 85.0, 50.0, UP_M, SPEED_M_S, 3),
    (3, 60.0, 115.0, UP_M, SPEED_M_S, 4),
    (4, 0.0, 110.0, UP_M, SPEED_M_S, 5),
    (5, -10.0, 40.0, UP_M, SPEED_M_S, 0),
];
/// What is looked at, m north and east of home.
const PLACE: (f64, f64) = (40.0, 60.0);
const UP_M: f64 = 30.0;
const SPEED_M_S: f64 = 5.0;
/// Farther ones are not drawn.
const NEAR_M: f64 = 150.0;
/// States within which a gimbal has turned.
const TURNING: usize = 2;
