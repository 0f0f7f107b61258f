//! The start of a vehicle: its machines, and the state that they find after a restart of the VSM.

use std::collections::VecDeque;

use mapping::event::Definitions;
use mavlink_link::store::StoreError;
use stanag_msgs::enums::{AlertPriority, SubsystemId};
use stanag_msgs::messages::{FlightTerminationCommand, HoldCommand};

use super::{Aircraft, Context, Effects};
use crate::config;
use crate::session::alerts::{Alerts, Cause, Raised};
use crate::session::authority::AuthorityMachine;
use crate::session::authority::record::KnownStation;
use crate::session::context::{Bounds, Settings};
use crate::session::duplicates::Seen;
use crate::session::effects::DliEffects;
use crate::session::files::FileAccess;
use crate::session::flight::Flight;
use crate::session::held::Held;
use crate::session::link::VehicleLink;
use crate::session::link::services::Services;
use crate::session::link::state::VehicleState;
use crate::session::metadata::MetadataReader;
use crate::session::mission::Mission;
use crate::session::payload::Payload;
use crate::session::reports::Reports;
use crate::session::station::GroundStation;
use crate::session::termination::Termination;

impl Aircraft {
    /// `number` keeps the alert ids of the vehicles of one bridge apart.
    pub(crate) fn new(
        config: config::Vehicle,
        settings: Settings,
        link: VehicleLink,
        mut services: Services,
        number: i32,
    ) -> Aircraft {
        let bounds = Bounds::of(&config);
        services.ground.serve(bounds.terrain.clone());
        let areas = config.area.iter().map(config::Area::area).collect();
        let rally = config.rally.iter().map(config::Rally::point).collect();
        Aircraft {
            port: 0,
            settings,
            bounds,
            vehicle: VehicleState::default(),
            services,
            alerts: Alerts::new(number),
            listeners: Vec::new(),
            requests: VecDeque::new(),
            watch_at: None,
            authority: AuthorityMachine::default(),
            mission: Mission::new(areas, rally),
            flight: Flight::default(),
            held: Held::default(),
            termination: Termination::default(),
            reports: Reports::default(),
            payload: Payload::default(),
            link,
            zeroizing: false,
            files: FileAccess::default(),
            metadata: [Definitions::Events, Definitions::Parameters].map(MetadataReader::new),
            config,
        }
    }

    /// Restores the state from disk after a restart, and raises the alerts that are active from the start.
    ///
    /// # Errors
    /// A record exists and cannot be read. Starting without it would break what was acknowledged.
    pub(crate) fn restore(
        &mut self,
        dli: &mut DliEffects<'_>,
    ) -> Result<Vec<KnownStation>, StoreError> {
        let known = self
            .authority
            .restore(&context!(self, dli), effects!(self, dli))?;
        self.mission.restore(effects!(self, dli))?;
        self.flight.restore(effects!(self, dli))?;
        let cut_off = self.held.restore(effects!(self, dli))?;
        if cut_off.launch {
            self.flight.cut_off_launch();
        }
        if let Some(number) = cut_off.contingency {
            self.flight.cut_off_held(number);
        }
        // The addresses of listeners are not known yet: `show_standing` follows.
        let listeners = std::mem::take(&mut self.listeners);
        self.termination.restore(effects!(self, dli))?;
        let effects = effects!(self, dli);
        effects.raise(
            Cause::VehicleSilent,
            AlertPriority::Caution,
            SubsystemId::Comms,
            "no data from the vehicle yet: state unknown",
        );
        if self.config.signing == config::Signing::Off {
            effects.raise(
                Cause::SigningOff,
                AlertPriority::Warning,
                SubsystemId::Comms,
                "MAVLink signing is off: anyone in range of the link can command this vehicle",
            );
        }
        let controlled = self.authority.controller().is_some();
        self.flight.report_cut_off(controlled, effects);
        self.listeners = listeners;
        Ok(known)
    }

    /// Sends the active alerts to stations that listened before a restart. The vehicle's state is unknown until its first
    /// message to this process.
    pub(crate) fn show_standing(&mut self, dli: &mut DliEffects<'_>) {
        for alert in self.alerts.standing().cloned() {
            let raised = Raised { alert, first: true };
            dli.show(self.config.id, &self.listeners, &raised);
        }
    }

    /// Resumes a command that had no final answer when the VSM ended. Returns false if it can be forgotten: a command that
    /// only stores data or requests rights has the same result when it is sent again.
    pub(crate) fn resume_command(
        &mut self,
        dli: &mut DliEffects<'_>,
        station: usize,
        seen: &Seen,
    ) -> bool {
        let origin = seen.origin(station);
        let owner = dli.stations.get(station).map(GroundStation::id);
        match seen.message_type {
            // A handover survives the restart; its end answers the requesting CUCS.
            1 | 4 | 34000 => self.authority.resume(&context!(self, dli), origin),
            same if may_come_again(same) => false,
            HoldCommand::ID
                if self
                    .held
                    .resume((station, owner), seen, effects!(self, dli)) =>
            {
                true
            }
            _ => {
                // An interrupted launch must not leave motors running: a vehicle that is still on the ground is disarmed.
                self.flight.cut_off(seen);
                self.refuse_cut_off(dli, station, seen);
                true
            }
        }
    }

    /// Refuses a command that a restart of the VSM has cut off.
    pub(crate) fn refuse_cut_off(&mut self, dli: &mut DliEffects<'_>, station: usize, seen: &Seen) {
        let mode = if seen.mode == 0 {
            String::new()
        } else {
            format!(" (mode {})", seen.mode)
        };
        // A flight termination is not commanded again, but one that has begun is not ended by the restart either.
        let look_at = match seen.message_type {
            FlightTerminationCommand::ID => "3005 says what the vehicle shows of it",
            _ => "check the vehicle's state",
        };
        let why = format!(
            "the VSM restarted while this was carried out{mode}: not resumed after the restart; {look_at}"
        );
        let effects = effects!(self, dli);
        self.mission.report_cut_off(station, seen, effects);
        effects.refuse(Some(seen.origin(station)), why);
    }
}

/// Whether a command of this type that a restart interrupted has the same result when it is sent again.
pub(crate) fn may_come_again(message_type: u16) -> bool {
    matches!(
        message_type,
        2000 | 2017 | 13001 | 13002 | 13003 | 13004 | 13006 | 50001 | 50002 | 50016
    )
}
