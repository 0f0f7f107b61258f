//! An operator at a station: carries out words ([`Verb`]) and tells what became of them, to people or to programs.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::json;
use stanag_msgs::enums::{FlightPathControlMode, RequestedAccess};
use stanag_msgs::messages::VehicleOperatingModeCommand;
use stanag_msgs::{Bam32, Id};

mod configuring;
mod error;
mod handing_over;
mod services;
mod telling;

pub use error::OperatorError;

use super::outcome::{Outcome, levels};
use super::report;
use super::route::Route;
use super::station::{LoiterAt, Station, set_altitude, set_speed};
use super::vehicle::Vehicle;
use super::verb::{Condition, ModeArguments, Verb};

/// For whom it is told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Style {
    /// Sentences.
    #[default]
    People,
    /// A JSON object a line.
    Json,
}

/// See the module.
#[derive(Debug)]
pub struct Operator<W> {
    station: Station,
    vehicle: Option<Id>,
    met: Option<Id>,
    style: Style,
    out: W,
}

type Done = Result<(), OperatorError>;

impl<W: Write> Operator<W> {
    /// At this station; commands `vehicle`, or the only one that is there.
    pub fn new(station: Station, vehicle: Option<Id>, style: Style, out: W) -> Operator<W> {
        Operator {
            station,
            vehicle,
            met: None,
            style,
            out,
        }
    }

    /// The station.
    pub fn station(&mut self) -> &mut Station {
        &mut self.station
    }

    /// Does it, and tells. Files are relative to `folder`.
    ///
    /// # Errors
    /// It was not done.
    pub async fn run(&mut self, verb: &Verb, folder: &Path) -> Done {
        let done = self.carry_out(verb, folder).await;
        self.conclude(done)
    }

    /// Sends a route of this name and loads it aboard, and tells.
    ///
    /// # Errors
    /// It was not done.
    pub async fn load(&mut self, name: &str, route: &Route) -> Done {
        let done = self.send_route(name, route).await;
        self.conclude(done)
    }

    /// Tells the alerts that came with it.
    fn conclude(&mut self, done: Done) -> Done {
        // What the error says is not told twice.
        let error = done.as_ref().err().map(ToString::to_string);
        self.tell_alerts(error.as_deref().unwrap_or_default())?;
        if self.style == Style::Json
            && let Some(error) = error
        {
            writeln!(self.out, "{}", json!({"error": error}))?;
        }
        done
    }

    async fn send_route(&mut self, name: &str, route: &Route) -> Done {
        let vehicle = self.meet().await?;
        let waypoints = route.waypoints.len();
        self.station.send_route(vehicle, route).await?.accepted()?;
        self.tell(
            &format!("{vehicle}: {name} with {waypoints} waypoints is aboard"),
            json!({"loaded": name, "waypoints": waypoints}),
        )
    }

    async fn carry_out(&mut self, verb: &Verb, folder: &Path) -> Done {
        match verb {
            Verb::Discover => self.discover().await,
            Verb::Take { loi, depose } => {
                let vehicle = self.meet().await?;
                let may = self
                    .state(vehicle)
                    .map_or_else(Default::default, Vehicle::authorised);
                let wanted = loi.map_or(may, |list| list.0);
                let access = if *depose {
                    RequestedAccess::Override
                } else {
                    RequestedAccess::Request
                };
                let granted = self.station.request(vehicle, wanted, access).await?;
                let loi = report::loi_numbers(granted.raw());
                self.tell(
                    &format!("{vehicle}: LOI {} granted", levels(granted)),
                    json!({"granted": loi}),
                )
            }
            Verb::Handover(verb) => self.hand_over(verb).await,
            Verb::Release => {
                let vehicle = self.meet().await?;
                self.station.release(vehicle).await?;
                self.tell(&format!("{vehicle}: released"), json!({"granted": []}))
            }
            Verb::Send { file, mission_id } => {
                let mut route = Route::load(&folder.join(file))?;
                if mission_id.is_some() {
                    route.mission_id.clone_from(mission_id);
                }
                self.send_route(&file.display().to_string(), &route).await
            }
            Verb::Clear => {
                let vehicle = self.meet().await?;
                let outcome = self.station.clear(vehicle).await?;
                self.finish(vehicle, "plan cleared", outcome)
            }
            Verb::Cancel => {
                let vehicle = self.meet().await?;
                let outcome = self.station.cancel(vehicle).await?;
                self.finish(vehicle, "transfer cancelled", outcome)
            }
            Verb::Download { output } => {
                let path = output.as_ref().map(|path| folder.join(path));
                self.download(path.as_deref()).await
            }
            Verb::Mode(arguments) => self.mode(arguments).await,
            Verb::Launch {
                altitude,
                altitude_type,
            } => {
                let vehicle = self.meet().await?;
                let launch = self.station.launch(vehicle, *altitude, altitude_type.0);
                let outcome = launch.await?;
                self.finish(vehicle, "launched", outcome)
            }
            Verb::Fly { from, speed } => {
                let vehicle = self.meet().await?;
                let outcome = self.station.fly_route(vehicle, *from, *speed).await?;
                self.finish(vehicle, "flies its route", outcome)
            }
            Verb::Loiter {
                position,
                altitude,
                altitude_type,
                speed,
            } => {
                let vehicle = self.meet().await?;
                let at = LoiterAt {
                    position_deg: position.map(|at| (at.0, at.1)),
                    altitude: altitude.map(|metres| (metres, altitude_type.0)),
                    speed_m_s: *speed,
                };
                let outcome = self.station.loiter(vehicle, at).await?;
                self.finish(vehicle, "loiters", outcome)
            }
            Verb::Speed { metres_per_second } => {
                let vehicle = self.meet().await?;
                let outcome = self
                    .station
                    .change_speed(vehicle, *metres_per_second)
                    .await?;
                self.finish(
                    vehicle,
                    &format!("{metres_per_second} m/s commanded"),
                    outcome,
                )
            }
            Verb::Land => {
                let vehicle = self.meet().await?;
                let outcome = self.station.land(vehicle).await?;
                self.finish(vehicle, "lands", outcome)
            }
            Verb::Wait { condition, within } => self.wait(condition, seconds(*within)?).await,
            Verb::Watch {
                seconds: span,
                every,
            } => self.watch(seconds(*span)?, seconds(*every)?).await,
            Verb::Sleep { seconds: span } => Ok(self.station.idle(seconds(*span)?).await?),
            Verb::Heartbeats { switch } => {
                self.station.set_heartbeats(switch == "on");
                self.tell(
                    &format!("heartbeats {switch}"),
                    json!({"heartbeats": switch}),
                )
            }
            Verb::Vehicle { id } => {
                self.vehicle = Some(*id);
                self.met = None;
                self.meet().await.map(|_| ())
            }
            Verb::Traffic => self.traffic(),
            Verb::Config { loi } => self.configuration(*loi).await,
            Verb::Parameters { name } => self.parameters(name.as_deref()).await,
            Verb::Set { name, value } => self.set_parameter(name, *value).await,
            Verb::Software => self.software().await,
            Verb::Ping { vehicle } => self.ping(*vehicle).await,
            Verb::Fence {
                file: Some(file), ..
            } => self.send_fence(&folder.join(file)).await,
            Verb::Fence { clear: true, .. } => self.clear_fence().await,
            Verb::Fence { output, .. } => {
                let path = output.as_ref().map(|path| folder.join(path));
                self.download_fence(path.as_deref()).await
            }
        }
    }

    /// Serves for a moment and tells alerts: between the lines of a shell.
    ///
    /// # Errors
    /// The socket, or the output.
    pub async fn idle(&mut self, span: Duration) -> Done {
        self.station.idle(span).await?;
        self.tell_alerts("")
    }

    async fn discover(&mut self) -> Done {
        for found in self.station.discover().await? {
            let vsm = found
                .vsm
                .map_or_else(|| "no VSM".to_owned(), |id| format!("VSM {id}"));
            self.tell(
                &format!(
                    "{} behind {vsm}, vehicle type {}, LOI {} authorised, {} granted",
                    found.vehicle,
                    found.vehicle_type,
                    levels(found.authorised),
                    levels(found.granted)
                ),
                json!({
                    "vehicle": found.vehicle.to_string(),
                    "vsm": found.vsm.map(|id| id.to_string()),
                    "vehicle_type": found.vehicle_type,
                    "authorised": report::loi_numbers(found.authorised.raw()),
                    "granted": report::loi_numbers(found.granted.raw()),
                }),
            )?;
        }
        Ok(())
    }

    /// The vehicle that is commanded: the one named, or the only one. The VSM hears of this station by it.
    ///
    /// # Errors
    /// Nobody answers, it is not there, or more than one are and none was named.
    pub async fn meet(&mut self) -> Result<Id, OperatorError> {
        if let Some(met) = self.met {
            return Ok(met);
        }
        let found: Vec<Id> = self
            .station
            .discover()
            .await?
            .iter()
            .map(|found| found.vehicle)
            .collect();
        let names = || {
            let names: Vec<String> = found.iter().map(Id::to_string).collect();
            names.join(", ")
        };
        let vehicle = match (self.vehicle, found.as_slice()) {
            (Some(wanted), _) if found.contains(&wanted) => wanted,
            (Some(wanted), _) => {
                let found = names();
                return Err(OperatorError::NoSuchVehicle { wanted, found });
            }
            (None, [only]) => *only,
            (None, _) => return Err(OperatorError::Ambiguous(names())),
        };
        self.met = Some(vehicle);
        Ok(vehicle)
    }

    /// As [`Self::meet`], for what needs the vehicle's status.
    async fn listen(&mut self) -> Result<Id, OperatorError> {
        let vehicle = self.meet().await?;
        if self
            .state(vehicle)
            .is_none_or(|state| state.granted().is_empty())
        {
            return Err(OperatorError::NoRights(vehicle));
        }
        Ok(vehicle)
    }

    fn state(&self, vehicle: Id) -> Option<&Vehicle> {
        self.station.vehicle(vehicle)
    }

    async fn mode(&mut self, arguments: &ModeArguments) -> Done {
        let vehicle = self.meet().await?;
        let mut command = VehicleOperatingModeCommand {
            select_flight_path_control_mode: Some(arguments.mode.0),
            commanded_waypoint_number: arguments.waypoint,
            loiter_position_latitude: arguments.position.map(|at| Bam32::from_degrees(at.0)),
            loiter_position_longitude: arguments.position.map(|at| Bam32::from_degrees(at.1)),
            ..VehicleOperatingModeCommand::default()
        };
        if let Some(metres) = arguments.altitude {
            set_altitude(&mut command, metres, arguments.altitude_type.0)?;
        }
        set_speed(&mut command, arguments.speed)?;
        let outcome = self.station.operate(vehicle, command).await?;
        let mode = arguments.mode.0;
        let what = format!("mode {} ({}) entered", mode.raw(), report::mode_name(mode));
        self.finish(vehicle, &what, outcome)
    }

    async fn download(&mut self, path: Option<&Path>) -> Done {
        let vehicle = self.meet().await?;
        let download = self.station.download(vehicle).await?;
        let routes = Route::from_download(&download);
        let text: Vec<String> = routes.iter().map(Route::to_toml).collect();
        // Routes share waypoints and a file holds one route: further ones are told apart by their files.
        for (index, text) in text.iter().enumerate() {
            match path {
                None if self.style == Style::People => write!(self.out, "{text}")?,
                None => writeln!(self.out, "{}", json!({"route": text}))?,
                Some(path) => {
                    let path = numbered(path, index);
                    std::fs::write(&path, text).map_err(|source| OperatorError::Write {
                        path: path.clone(),
                        source,
                    })?;
                    self.tell(
                        &format!("{vehicle}: route written to {}", path.display()),
                        json!({"written": path.display().to_string()}),
                    )?;
                }
            }
        }
        let missing: Vec<String> = download.missing().iter().map(u16::to_string).collect();
        if missing.is_empty() {
            Ok(())
        } else {
            Err(OperatorError::Incomplete(missing.join(", ")))
        }
    }

    async fn wait(&mut self, condition: &Condition, within: Duration) -> Done {
        // What concerns rights is told to those who have none too.
        let vehicle = match condition {
            Condition::Asked
            | Condition::Offered
            | Condition::Holds { .. }
            | Condition::Lacks { .. } => self.meet().await?,
            _ => self.listen().await?,
        };
        let mark = self.state(vehicle).map_or(0, Vehicle::next_alert);
        let holds = |state: &Vehicle| match condition {
            Condition::Mode { mode } => state.mode() == Some(mode.0),
            Condition::Waypoint { number } => state.to_waypoint() == Some(*number),
            Condition::RouteEnd => state.waypoints.is_some() && state.to_waypoint().is_none(),
            Condition::Landed => state.landed() == Some(true),
            Condition::Airborne => state.landed() == Some(false),
            Condition::Above { altitude } => state
                .position()
                .is_some_and(|at| at.altitude_m >= *altitude),
            Condition::Below { altitude } => state
                .position()
                .is_some_and(|at| at.altitude_m <= *altitude),
            Condition::Alert { text } => state
                .alerts_from(mark)
                .any(|alert| alert.text.contains(text)),
            Condition::Asked => state.wish().is_some(),
            Condition::Offered => state.offer().is_some(),
            Condition::Holds { loi } => state.granted().contains(loi.0),
            Condition::Lacks { loi } => !state.granted().intersects(loi.0),
        };
        self.station
            .wait_until(&awaited(condition), within, |session| {
                session.vehicle(vehicle).is_some_and(holds)
            })
            .await?;
        self.tell_state(vehicle)
    }

    async fn watch(&mut self, span: Duration, every: Duration) -> Done {
        let vehicle = self.listen().await?;
        let every = every.max(SHORTEST_LOOK);
        let mut left = span;
        loop {
            let pause = left.min(every);
            self.station.idle(pause).await?;
            self.tell_state(vehicle)?;
            self.tell_alerts("")?;
            left -= pause;
            if left.is_zero() {
                return Ok(());
            }
        }
    }

    fn finish(&mut self, vehicle: Id, what: &str, outcome: Outcome) -> Done {
        outcome.accepted()?;
        self.tell(&format!("{vehicle}: {what}"), json!({"done": what}))
    }
}

fn awaited(condition: &Condition) -> String {
    match condition {
        Condition::Mode { mode } => format!("mode {} (3001)", FlightPathControlMode::raw(mode.0)),
        Condition::Waypoint { number } => format!("leg to waypoint {number} (4001)"),
        Condition::RouteEnd => "end of the route (4001)".to_owned(),
        Condition::Landed => "landing (3002)".to_owned(),
        Condition::Airborne => "lift-off (3002)".to_owned(),
        Condition::Above { altitude } => format!("altitude of at least {altitude} m (4000)"),
        Condition::Below { altitude } => format!("altitude of at most {altitude} m (4000)"),
        Condition::Alert { text } => format!("alert (16000) with {text:?}"),
        Condition::Asked => "wish of another CUCS (4)".to_owned(),
        Condition::Offered => "offer of the holder (5)".to_owned(),
        Condition::Holds { loi } => format!("LOI {} (2)", levels(loi.0)),
        Condition::Lacks { loi } => format!("loss of LOI {} (2)", levels(loi.0)),
    }
}

fn seconds(value: f64) -> Result<Duration, OperatorError> {
    if (0.0..=1e6).contains(&value) {
        Ok(Duration::from_secs_f64(value))
    } else {
        Err(OperatorError::Seconds(value))
    }
}

/// `plan.toml`, `plan-2.toml`, `plan-3.toml`.
fn numbered(path: &Path, index: usize) -> PathBuf {
    if index == 0 {
        return path.to_owned();
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let name = match path.extension() {
        Some(extension) => format!("{stem}-{}.{}", index + 1, extension.to_string_lossy()),
        None => format!("{stem}-{}", index + 1),
    };
    path.with_file_name(name)
}

const SHORTEST_LOOK: Duration = Duration::from_millis(50);
