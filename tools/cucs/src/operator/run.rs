//! Carries out a subcommand: calls the station's operation, and waits for what the vehicle reports.

use std::io::Write;
use std::path::Path;
use std::time::Duration;

use serde_json::json;
use stanag_msgs::enums::FlightPathControlMode;
use stanag_msgs::messages::VehicleOperatingModeCommand;
use stanag_msgs::{Bam32, Id};

use super::console::{Done, Operator, Style, remark};
use super::error::OperatorError;
use super::file_kind::{self, Reader};
use super::termination::Ordered;
use super::verb::{Condition, ModeArguments, Verb};
use crate::formats::Losses;
use crate::session::sender::Edition;
use crate::session::vehicle::Vehicle;
use crate::station::command::{LoiterAt, set_altitude, set_speed};
use crate::station::outcome::{StationError, levels};
use route_files::route::model::Route;

impl<W: Write> Operator<W> {
    /// Carries out a subcommand and prints the result, then the alerts that came with it. Files are relative to
    /// `folder`.
    ///
    /// # Errors
    /// It was refused, not answered, or cannot be requested.
    pub async fn run(&mut self, verb: &Verb, folder: &Path) -> Done {
        self.alerts_aside = false;
        let done = self.carry_out(verb, folder).await;
        self.conclude(done)
    }

    /// Sends a route of this name and loads it; prints the result, with what its file lost.
    ///
    /// # Errors
    /// It was refused, or there is no answer.
    pub async fn load(&mut self, name: &str, route: &Route, losses: &Losses) -> Done {
        let done = self.send_route(name, route, losses).await;
        self.conclude(done)
    }

    /// Prints the alerts that came with it.
    fn conclude(&mut self, done: Done) -> Done {
        let error = done.as_ref().err();
        self.print_alerts(error.map_or(&[], OperatorError::reasons))?;
        if self.style == Style::Json
            && let Some(error) = error
        {
            writeln!(self.out, "{}", json!({"error": error.to_string()}))?;
        }
        done
    }

    async fn carry_out(&mut self, verb: &Verb, folder: &Path) -> Done {
        match verb {
            Verb::Discover => self.discover().await,
            Verb::Take {
                loi,
                stations,
                override_holder,
            } => self.take(*loi, *stations, *override_holder).await,
            Verb::Handover(verb) => self.hand_over(verb).await,
            Verb::Release => self.release().await,
            Verb::Send {
                file,
                import,
                mission_id,
            } => {
                let name = file.display().to_string();
                let file = folder.join(file);
                file_kind::check(&file, Reader::Send)?;
                self.send_file(&file, &name, import, mission_id.as_deref())
                    .await
            }
            Verb::Clear => {
                let vehicle = self.find_vehicle().await?;
                let outcome = self.station.clear(vehicle).await?;
                self.finish(vehicle, "plan cleared", outcome)
            }
            Verb::Hold(arguments) => self.hold(arguments).await,
            Verb::Held => self.held().await,
            Verb::Contingency {
                cause: Some(cause),
                action: Some(action),
                percent,
            } => self.set_contingency(*cause, *action, *percent).await,
            Verb::Contingency { .. } => self.contingencies().await,
            Verb::Cancel { held: Some(number) } => self.cancel_held(*number).await,
            Verb::Cancel { held: None } => {
                let vehicle = self.find_vehicle().await?;
                let outcome = self.station.cancel(vehicle).await?;
                self.finish(vehicle, "transfer cancelled", outcome)
            }
            Verb::Download { output } => {
                let path = output.path().map(|path| folder.join(path));
                self.download(path.as_deref()).await
            }
            Verb::Mode(arguments) => self.mode(arguments).await,
            Verb::Launch {
                altitude,
                altitude_type,
            } => {
                let vehicle = self.find_vehicle().await?;
                let launch = self.station.launch(vehicle, *altitude, *altitude_type);
                let outcome = launch.await?;
                self.finish(vehicle, "launched", outcome)
            }
            Verb::Fly { from, speed } => {
                let vehicle = self.find_vehicle().await?;
                let outcome = self.station.fly_route(vehicle, *from, *speed).await?;
                self.finish(vehicle, "flies its route", outcome)
            }
            Verb::Loiter {
                position,
                altitude,
                altitude_type,
                speed,
            } => {
                let vehicle = self.find_vehicle().await?;
                let at = LoiterAt {
                    position_deg: *position,
                    altitude: altitude.map(|metres| (metres, *altitude_type)),
                    speed_m_s: *speed,
                };
                let outcome = self.station.loiter(vehicle, at).await?;
                self.finish(vehicle, "loiters", outcome)
            }
            Verb::Speed { metres_per_second } => {
                let vehicle = self.find_vehicle().await?;
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
                let vehicle = self.find_vehicle().await?;
                let outcome = self.station.land(vehicle).await?;
                self.finish(vehicle, "lands", outcome)
            }
            Verb::Payload(arguments) => self.payload(arguments).await,
            Verb::Terminate { step } => self.two_steps(*step, Ordered::Termination).await,
            Verb::Zeroize { step } => self.two_steps(*step, Ordered::Zeroize).await,
            Verb::Wait { condition, within } => self.wait(condition, seconds(*within)?).await,
            Verb::Watch {
                seconds: span,
                every,
            } => self.watch(seconds(*span)?, seconds(*every)?).await,
            Verb::Sleep { seconds: span } => Ok(self.station.idle(seconds(*span)?).await?),
            Verb::Heartbeats { switch } => {
                self.station.set_heartbeats(switch == "on");
                self.print(
                    &format!("heartbeats {switch}"),
                    json!({"heartbeats": switch}),
                )
            }
            Verb::Vehicle { selected } => self.select_vehicle(*selected).await,
            Verb::Traffic => self.print_traffic(),
            Verb::Config { loi } => self.configuration(*loi).await,
            Verb::Parameters { name } => self.parameters(name.as_deref()).await,
            Verb::Set { name, value } => self.set_parameter(name, *value).await,
            Verb::Controls { name, value } => self.controls(name.as_deref(), *value).await,
            Verb::Software => self.software().await,
            Verb::Ping { vehicle } => self.ping(*vehicle == Some(None)).await,
            Verb::Fence {
                file: Some(file), ..
            } => {
                let file = folder.join(file);
                file_kind::check(&file, Reader::Fence)?;
                self.send_fence(&file).await
            }
            Verb::Fence { clear: true, .. } => self.clear_fence().await,
            Verb::Fence { output, .. } => {
                let path = output.as_ref().map(|path| folder.join(path));
                self.download_fence(path.as_deref()).await
            }
        }
    }

    async fn mode(&mut self, arguments: &ModeArguments) -> Done {
        let vehicle = self.find_vehicle().await?;
        let command = mode_command(arguments)?;
        let outcome = self.station.operate(vehicle, command).await?;
        let mode = arguments.mode;
        let what = format!("mode {} entered", mode.in_words());
        self.finish(vehicle, &what, outcome)
    }

    async fn wait(&mut self, condition: &Condition, within: Duration) -> Done {
        if self.station.session().edition() == Edition::Ed25
            && matches!(condition, Condition::Landed | Condition::Airborne)
        {
            return Err(OperatorError::NotShown(describe(condition)));
        }
        // A CUCS without rights receives messages about rights too, but no status.
        let vehicle = match condition {
            Condition::Asked
            | Condition::Offered
            | Condition::Holds { .. }
            | Condition::Lacks { .. } => self.find_vehicle().await?,
            _ => self.find_vehicle_with_status().await?,
        };
        if matches!(condition, Condition::RouteEnd | Condition::Waypoint { .. })
            && let Some(why) = self.no_route(vehicle).await?
        {
            if matches!(condition, Condition::RouteEnd) {
                return Err(OperatorError::NoRoute { vehicle, why });
            }
            // Another station may still start a route.
            remark(&format!("vehicle {vehicle} flies no route: {why}"));
        }
        // Only alerts from now on: an earlier alert with this text may have had another reason.
        let mark = self.state(vehicle).map_or(0, Vehicle::next_alert);
        let is_met = |state: &Vehicle| match condition {
            Condition::Mode { mode } => state.mode() == Some(*mode),
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
            Condition::Asked => state.handover_request().is_some(),
            Condition::Offered => state.handover_offer().is_some(),
            Condition::Holds { loi } => state.granted().contains(loi.0),
            Condition::Lacks { loi } => !state.granted().intersects(loi.0),
        };
        self.station
            .wait_until(&describe(condition), within, |session| {
                session.vehicle(vehicle).is_some_and(is_met)
            })
            .await?;
        self.print_state(vehicle)
    }

    /// Why the vehicle flies no route, and what to do. `None` where it flies one, has flown it to its end, or does
    /// not report it.
    async fn no_route(&mut self, vehicle: Id) -> Result<Option<String>, OperatorError> {
        // The reports that a VSM sends first to a station that begins to receive.
        let shown = |state: &Vehicle| state.waypoints.is_some() && state.mode().is_some();
        let within = self.station.timeouts.answer;
        let first = self
            .station
            .wait_until("first status (3001, 4001)", within, |session| {
                session.vehicle(vehicle).is_some_and(shown)
            });
        match first.await {
            Err(StationError::TimedOut { .. }) | Ok(()) => {}
            Err(fault) => return Err(fault.into()),
        }
        let Some(state) = self.state(vehicle).filter(|state| shown(state)) else {
            return Ok(None);
        };
        let to = state.to_waypoint().filter(|number| *number != NO_NUMBER);
        Ok(match (state.from_waypoint(), to, state.mode()) {
            (None, None, _) => Some(
                "none is loaded; `cucs send FILE`, then `cucs fly`, or `cucs launch 30` first where it is on the ground"
                    .to_owned(),
            ),
            (_, Some(number), Some(mode)) if !flies_routes(mode) => Some(format!(
                "one is loaded, to waypoint {number}, and the mode is {}; `cucs fly` begins or continues it",
                mode.in_words()
            )),
            _ => None,
        })
    }

    async fn watch(&mut self, span: Duration, every: Duration) -> Done {
        self.alerts_in_full = true;
        let vehicle = self.find_vehicle_with_status().await?;
        let every = every.max(MIN_WATCH_PERIOD);
        let mut left = span;
        loop {
            let pause = left.min(every);
            self.station.idle(pause).await?;
            self.print_state(vehicle)?;
            self.print_alerts(&[])?;
            left -= pause;
            if left.is_zero() {
                return Ok(());
            }
        }
    }
}

/// The 2016 for these arguments.
pub(super) fn mode_command(
    arguments: &ModeArguments,
) -> Result<VehicleOperatingModeCommand, OperatorError> {
    let mut command = VehicleOperatingModeCommand {
        select_flight_path_control_mode: Some(arguments.mode),
        commanded_waypoint_number: arguments.waypoint,
        loiter_position_latitude: arguments.position.map(|at| Bam32::from_degrees(at.0)),
        loiter_position_longitude: arguments.position.map(|at| Bam32::from_degrees(at.1)),
        ..VehicleOperatingModeCommand::default()
    };
    if let Some(metres) = arguments.altitude {
        set_altitude(&mut command, metres, arguments.altitude_type)?;
    }
    set_speed(&mut command, arguments.speed)?;
    Ok(command)
}

/// Whether a vehicle in this mode may be flying a route; a VSM defines the modes from 32 up itself.
fn flies_routes(mode: FlightPathControlMode) -> bool {
    use FlightPathControlMode as Mode;
    matches!(
        mode,
        Mode::Waypoint | Mode::ContingencyA | Mode::ContingencyB
    ) || mode.raw() >= 32
}

fn describe(condition: &Condition) -> String {
    match condition {
        Condition::Mode { mode } => format!("3001 mode {}", mode.in_words()),
        Condition::Waypoint { number } => format!("leg to waypoint {number} (4001)"),
        Condition::RouteEnd => "end of the route (4001)".to_owned(),
        Condition::Landed => "landing (3002)".to_owned(),
        Condition::Airborne => "lift-off (3002)".to_owned(),
        Condition::Above { altitude } => format!("altitude of at least {altitude} m (4000)"),
        Condition::Below { altitude } => format!("altitude of at most {altitude} m (4000)"),
        Condition::Alert { text } => format!("alert (16000) with {text:?}"),
        Condition::Asked => "request from another CUCS (4)".to_owned(),
        Condition::Offered => "offer from the holder (5)".to_owned(),
        Condition::Holds { loi } => format!("LOI {} (2)", levels(loi.0)),
        Condition::Lacks { loi } => format!("loss of LOI {} (2)", levels(loi.0)),
    }
}

pub(super) fn seconds(value: f64) -> Result<Duration, OperatorError> {
    if (0.0..=1e6).contains(&value) {
        Ok(Duration::from_secs_f64(value))
    } else {
        Err(OperatorError::Seconds(value))
    }
}

/// The number in 4001 for a place that is not a waypoint of a route, such as that of a loiter.
const NO_NUMBER: u16 = 65_535;
/// The shortest period of `watch`.
const MIN_WATCH_PERIOD: Duration = Duration::from_millis(50);
