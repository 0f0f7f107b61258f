//! `dli-check init`: discover a VSM, and write the profile of what it shows.

use std::path::PathBuf;

use clap::Args;

use crate::bench::context::Bench;
use crate::bench::discovery::survey;
use crate::bench::station::Station;
use crate::catalogue::Catalogue;
use crate::outcome::{eprint, print, save};
use crate::profile::{CucsClaims, VehicleClaims};

/// Arguments of `dli-check init`.
#[derive(Debug, Args)]
pub(super) struct InitArguments {
    #[command(flatten)]
    subject: super::vsm::VsmArguments,
    /// Where to write the profile; standard output where it is left out
    #[arg(long, value_name = "FILE")]
    to: Option<PathBuf>,
    /// CUCS ids to try, 1b:00:00:a0 (repeatable)
    #[arg(long, value_name = "ID")]
    cucs: Vec<String>,
}

pub(super) fn write(arguments: &InitArguments) -> Result<u8, String> {
    let (address, mut profile) = super::vsm::subject(&arguments.subject)?;
    for id in &arguments.cucs {
        profile.cucs.push(CucsClaims {
            id: id.clone(),
            loi: None,
            overrides: false,
        });
    }
    profile.check().map_err(|error| error.to_string())?;
    let bench = Bench::new(&Catalogue::embedded(), profile.clone(), address);
    let survey = survey(&bench).map_err(|stop| stop.judgement().reason)?;
    if !survey.answered {
        eprint(&format!(
            "nothing at {address} answered a discovery; name CUCS ids that the VSM knows with --cucs"
        ));
        return Ok(3);
    }
    let overrides: Vec<String> = profile
        .cucs
        .iter()
        .filter(|claim| claim.overrides)
        .map(|claim| claim.id.clone())
        .collect();
    profile.cucs = survey
        .cucs
        .iter()
        .map(|cucs| CucsClaims {
            id: cucs.id.to_string(),
            loi: Some(
                (2..=5)
                    .filter(|level| cucs.authorised >> (level - 2) & 1 == 1)
                    .collect(),
            ),
            overrides: overrides.contains(&cucs.id.to_string()),
        })
        .collect();
    profile.vehicle = survey
        .vehicles
        .iter()
        .map(|vehicle| {
            let cucs = survey.cucs.first().map(|cucs| cucs.id);
            let station = cucs.and_then(|id| Station::new(&bench, id, vehicle.id).ok());
            let tail_number = station
                .and_then(|station| station.query(3).ok())
                .and_then(|seen| seen.text("Tail Number"));
            VehicleClaims {
                id: vehicle.id.to_string(),
                simulated: arguments.subject.simulated,
                tail_number,
                stations: (vehicle.stations != 0).then(|| {
                    (1..=16)
                        .filter(|station| vehicle.stations >> (station - 1) & 1 == 1)
                        .collect()
                }),
                ..VehicleClaims::default()
            }
        })
        .collect();
    let text = format!(
        "# Profile of a VSM for dli-check: what it claims. Check every line; mark ids that may override, and say whether\n\
         # the vehicle is simulated. Keys: docs/guide/conformance.md\n\n{}",
        profile.to_toml()
    );
    match &arguments.to {
        Some(file) => {
            save(file, text.as_bytes())?;
            print(&format!(
                "wrote {}: {} vehicles, {} CUCS ids",
                file.display(),
                survey.vehicles.len(),
                survey.cucs.len()
            ));
        }
        None => print(&text),
    }
    Ok(0)
}
