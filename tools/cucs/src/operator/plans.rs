//! Plans as files: routes and areas that are uploaded and downloaded.

use std::io::Write;
use std::path::Path;

use serde_json::json;
use stanag_msgs::enums::AreaPlanMode;
use stanag_msgs::messages::{
    AirframeActionWaypoint, AreaTransferCommand, AreaVertex, PayloadActionWaypoint,
};
use stanag_msgs::{Id, Message};

use super::console::{Done, Operator, Style, remark};
use super::error::OperatorError;
use crate::fence;
use crate::formats::{self, Import, Losses};
use route_files::Download;
use route_files::route::model::Route;

impl<W: Write> Operator<W> {
    /// Reads a route in any format, reports what the file loses, and sends the rest.
    pub(super) async fn send_file(
        &mut self,
        file: &Path,
        name: &str,
        import: &Import,
        mission_id: Option<&str>,
    ) -> Done {
        let (mut route, losses) = formats::read_to_send(file, import)?;
        if mission_id.is_some() {
            route.mission_id = mission_id.map(str::to_owned);
        }
        losses.report(name, import.strict)?;
        self.send_route(name, &route, &losses).await
    }

    pub(super) async fn send_route(&mut self, name: &str, route: &Route, losses: &Losses) -> Done {
        let vehicle = self.find_vehicle().await?;
        let waypoints = route.waypoints.len();
        self.station.send_route(vehicle, route).await?.accepted()?;
        self.print(
            &format!("{vehicle}: {name} with {waypoints} waypoints is aboard"),
            json!({"loaded": name, "waypoints": waypoints, "losses": losses.to_json()}),
        )
    }

    pub(super) async fn download(&mut self, path: Option<&Path>) -> Done {
        let vehicle = self.find_vehicle().await?;
        let download = self.station.download(vehicle).await?;
        let routes = Route::from_download(&download).map_err(crate::StationError::from)?;
        let text = Route::joined(routes).map_or_else(String::new, |route| route.to_toml());
        let losses = lost_actions(&download);
        let name = path.map_or_else(|| vehicle.to_string(), |path| path.display().to_string());
        // Before the answer, which a script may take for the whole plan.
        losses.report(&name, false)?;
        self.write_or_print(vehicle, "plan", "route", &text, Some(&losses), path)?;
        let missing: Vec<String> = download.missing().iter().map(u16::to_string).collect();
        if missing.is_empty() {
            Ok(())
        } else {
            Err(OperatorError::Incomplete(missing.join(", ")))
        }
    }

    /// Uploads a file of areas (50016 and 50017).
    pub(super) async fn send_fence(&mut self, file: &Path) -> Done {
        let vertices = fence::messages(file, &formats::read_fence(file)?)?;
        let vehicle = self.find_vehicle().await?;
        self.station.store(vehicle, &vertices).await?.accepted()?;
        self.transfer_areas(vehicle, AreaPlanMode::Load).await?;
        let count = vertices.len();
        self.print(
            &format!(
                "{vehicle}: {} with {count} vertices is aboard",
                file.display()
            ),
            json!({"fence": file.display().to_string(), "vertices": count}),
        )
    }

    /// Deletes the areas (50017 mode 1).
    pub(super) async fn clear_fence(&mut self) -> Done {
        let vehicle = self.find_vehicle().await?;
        self.transfer_areas(vehicle, AreaPlanMode::Clear).await?;
        self.print(
            &format!("{vehicle}: areas cleared"),
            json!({"done": "areas cleared"}),
        )
    }

    /// Downloads the areas (50017 mode 3).
    pub(super) async fn download_fence(&mut self, path: Option<&Path>) -> Done {
        let vehicle = self.find_vehicle().await?;
        let answers = self.transfer_areas(vehicle, AreaPlanMode::Download).await?;
        let vertices: Vec<&AreaVertex> = answers
            .iter()
            .filter_map(|message| match message {
                Message::AreaVertex(vertex) => Some(vertex),
                _ => None,
            })
            .collect();
        self.write_or_print(
            vehicle,
            "areas",
            "fence",
            &fence::to_toml(&fence::areas(vertices)),
            None,
            path,
        )
    }

    /// Writes the text of a plan to its file, or prints it, and what of it is lost.
    fn write_or_print(
        &mut self,
        vehicle: Id,
        what: &str,
        key: &str,
        text: &str,
        losses: Option<&Losses>,
        path: Option<&Path>,
    ) -> Done {
        let answer = |key: &str, value: &str| {
            let mut answer = json!({key: value});
            if let Some(losses) = losses {
                answer["losses"] = losses.to_json();
            }
            answer
        };
        match path {
            // An empty plan is not printed: it would look like a plan file.
            _ if text.is_empty() && self.style == Style::People => {
                remark(&format!("{vehicle}: no {what}: nothing is written"));
                Ok(())
            }
            _ if text.is_empty() => Ok(writeln!(self.out, "{}", answer(key, text))?),
            None if self.style == Style::People => {
                self.alerts_aside = true;
                Ok(write!(self.out, "{text}")?)
            }
            None => Ok(writeln!(self.out, "{}", answer(key, text))?),
            Some(path) => {
                std::fs::write(path, text).map_err(|source| OperatorError::Write {
                    path: path.to_owned(),
                    source,
                })?;
                self.print(
                    &format!("{vehicle}: {what} written to {}", path.display()),
                    answer("written", &path.display().to_string()),
                )
            }
        }
    }

    async fn transfer_areas(
        &mut self,
        vehicle: Id,
        mode: AreaPlanMode,
    ) -> Result<Vec<Message>, OperatorError> {
        let command = AreaTransferCommand {
            area_plan_mode: Some(mode),
            ..AreaTransferCommand::default()
        };
        let what = format!("areas (50017 mode {}, {mode})", mode.raw());
        self.query(vehicle, command, &what).await
    }
}

/// What of a plan its route file lacks: who sends that file takes the actions at its waypoints away.
fn lost_actions(download: &Download) -> Losses {
    let mut losses = Losses::of("waypoint");
    losses.items = download.waypoints().count();
    for (waypoint, message) in download.actions() {
        let kind = match message {
            PayloadActionWaypoint::ID => "payload action",
            AirframeActionWaypoint::ID => "airframe action",
            _ => "vehicle-specific action",
        };
        let what = format!("{kind} ({message})");
        match waypoint {
            0 => losses.add_whole(what + " of the whole mission"),
            waypoint => losses.add(usize::from(waypoint), what),
        }
    }
    losses
}
