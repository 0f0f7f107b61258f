//! `send`: uploads a route through a VSM, as a ground station (CUCS) does.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use clap::Args;
use cucs::formats::{self, Import, Losses};
use cucs::{LoiList, Operator, OperatorError, SessionConfig, Station, Style, Vehicle, Verb};
use stanag_msgs::Id;
use stanag_msgs::enums::LoiBitmap;

use crate::failure::Failure;
use crate::output::note;

/// Arguments of `send`.
#[derive(Debug, Args)]
pub(crate) struct Command {
    /// Read this route, in any format that can be read.
    file: PathBuf,
    /// Send to the VSM at this address.
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:4586")]
    vsm: String,
    /// Send as this CUCS id, which the VSM's configuration must list.
    #[arg(long, default_value = "1b:00:00:a0")]
    id: Id,
    /// Listen on this address; without it any port, on the loopback where the VSM is there.
    #[arg(long, value_name = "IP:PORT")]
    listen: Option<SocketAddr>,
    /// Send to this vehicle; without it, to the only one that is there.
    #[arg(long, value_name = "ID")]
    vehicle: Option<Id>,
    #[command(flatten)]
    import: Import,
    /// Take the rights (LOI 4) also where another station holds them.
    #[arg(long = "override")]
    depose: bool,
    /// Keep the rights; without it they are given back, unless this id held some before.
    #[arg(long)]
    keep: bool,
    /// Print JSON, one object per line.
    #[arg(long)]
    json: bool,
}

impl Command {
    pub(crate) fn run(&self) -> Result<(), Failure> {
        let draft = formats::read(&self.file, &self.import)?;
        // A file that is not a route is refused before anything is sent.
        draft.legs(&self.file)?;
        let (plan, losses) = draft.to_send(&self.file)?;
        losses.report(&self.file.display().to_string(), self.import.strict)?;
        tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(|e| Failure::Answer(e.to_string()))?
            .block_on(self.upload(&plan, &losses))?;
        Ok(())
    }

    async fn upload(&self, plan: &cucs::Route, losses: &Losses) -> Result<(), OperatorError> {
        let mut station =
            Station::reach(SessionConfig::new(self.id), self.listen, &self.vsm).await?;
        station.on_wait = Some(|what, left| {
            note(&format!(
                "waiting for the {what}, {:.0} s at most",
                left.as_secs_f64()
            ));
        });
        let style = if self.json {
            Style::Json
        } else {
            Style::People
        };
        let mut operator = Operator::new(station, self.vehicle, style, std::io::stdout());
        let vehicle = operator.find_vehicle().await?;
        let held = operator
            .station()
            .vehicle(vehicle)
            .map_or(LoiBitmap::NONE, Vehicle::granted);
        let nowhere = Path::new("");
        if !held.contains(LoiBitmap::LOI4) || self.depose {
            let take = Verb::Take {
                stations: None,
                loi: Some(LoiList(LoiBitmap::LOI4)),
                override_holder: self.depose,
            };
            operator.run(&take, nowhere).await?;
        }
        let name = self.file.display().to_string();
        let sent = operator.load(&name, plan, losses).await;
        if held.is_empty() && !self.keep {
            let released = operator.run(&Verb::Release, nowhere).await;
            // Where both failed, the upload's failure is closer to the cause.
            return sent.and(released);
        }
        sent
    }
}
