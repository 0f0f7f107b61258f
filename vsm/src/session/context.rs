//! What a machine reads: the time, the configuration, the stations, and the vehicle's state.
//!
//! Read-only, and borrowed for one call. The state of a sibling is provided as a view (such as [`FlightView`]), which the
//! router takes just before the call: a machine never keeps a reference to another.

use std::sync::Arc;
use std::time::Duration;

use curve_paths::terrain::Terrain;
use mapping::airframe::Airframe;
use mapping::altitude::{Agl, Altimeter};
use mapping::area::{Area, Areas, is_breached};
use mapping::limits::{Limits, Performance};
use mapping::mode::Px4Mode;
use mapping::parameter::Parameters;
use mapping::payload::Equipment;
use mapping::plan::Plan;
use mapping::report::Commanded;
use mapping::route::{Curving, FixedWing, Pattern, Policy, Vertices, Wings};
use mapping::telemetry::Telemetry;
use mavlink_link::Now;
use stanag_msgs::enums::{
    CommandedEngineState, FlightPathControlMode, FtState, LoiBitmap, RouteType,
};
use stanag_msgs::messages::{LoiterConfiguration, UaStickCommand, VehicleId};
use stanag_msgs::{Id, Text, TimeStamp};

use super::authority::rules::{Asker, Stations};
use super::link::state::VehicleState;
use super::mission::progress::RouteProgress;
use super::mission::record::UploadedMission;
use super::station::GroundStation;
use crate::config;

/// What every machine of a vehicle reads.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Context<'a> {
    pub(crate) now: Now,
    /// The identification number of this VSM.
    pub(crate) vsm: Id,
    pub(crate) config: &'a config::Vehicle,
    pub(crate) settings: &'a Settings,
    pub(crate) bounds: &'a Bounds,
    pub(crate) stations: &'a [GroundStation],
    /// The CUCS that holds LOI 4 or 5.
    pub(crate) controller: Option<Id>,
    /// As last reported by the vehicle, never as commanded.
    pub(crate) vehicle: &'a VehicleState,
    /// The progress of a flight termination.
    pub(crate) termination: TerminationView,
}

/// Lets the context of a machine, which has views beside `common`, be read as that.
macro_rules! deref_to_common {
    ($context:ident) => {
        impl<'a> ::std::ops::Deref for $context<'a> {
            type Target = $crate::session::context::Context<'a>;

            fn deref(&self) -> &Self::Target {
                &self.common
            }
        }
    };
}
pub(crate) use deref_to_common;

/// Configuration values common to all vehicles.
#[derive(Debug, Clone)]
pub(crate) struct Settings {
    pub(crate) authority: config::Authority,
    /// Where the status page is, for message 44000's reference to it.
    pub(crate) web_page: Option<String>,
}

/// The bounds of what a vehicle is commanded to fly, from its configuration.
#[derive(Debug, Clone)]
pub(crate) struct Bounds {
    pub(crate) agl: Agl,
    pub(crate) limits: Limits,
    /// The action if the vehicle leaves these limits.
    pub(crate) outside: config::Outside,
    /// The terrain and site data for checking routes, if configured.
    pub(crate) terrain: Option<Arc<Terrain>>,
    /// Without the limits from the vehicle's parameters.
    pub(crate) curving: Curving,
    /// Where a fixed wing lands without an approach route.
    pub(crate) landing: Option<Pattern>,
}

/// A message of a CUCS that may have to be answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Origin {
    /// Index of the station.
    pub(crate) station: usize,
    pub(crate) message_type: u16,
    pub(crate) stamp: Option<TimeStamp>,
    pub(crate) ack_requested: bool,
    /// The held command that it comes from: its answer is passed to the held machine.
    pub(crate) held: Option<HeldOrigin>,
    /// It continues the previous command of the same station.
    pub(crate) continues: Option<Continues>,
}

/// A held command (50020), as the origin of the command in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct HeldOrigin {
    pub(crate) serial: u32,
    /// Hold Kind 1: it is carried out while nobody controls the vehicle.
    pub(crate) contingency: bool,
}

/// How a command continues the one before it: Edition 2.5 commands a mode (#42) and its values (#43) by two messages, which a
/// station may send either way round.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Continues {
    /// A demand, with a hash of its values: one with the same hash commands the same.
    Demand(u64),
    /// A mode that has the values of the demand just before it.
    ModeOfDemand,
}

/// The mission state that other machines may read.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MissionView<'a> {
    /// The stored plan, as received from CUCSs and loaded by 13000.
    pub(crate) plan: &'a Plan,
    /// The mission that the vehicle carries, as read back from it.
    pub(crate) uploaded: Option<&'a UploadedMission>,
    /// The route that 13000 loaded: flown by mode 11, also after another route was uploaded for another mode.
    pub(crate) loaded: Option<&'a UploadedMission>,
    pub(crate) progress: &'a RouteProgress,
    pub(crate) transfer: Transfer,
    /// The mode of the command that waits for its route, if any.
    pub(crate) waiting_mode: Option<FlightPathControlMode>,
    /// A fence is being uploaded.
    pub(crate) fence_busy: bool,
    /// The areas received by 50016.
    pub(crate) areas: &'a Areas,
    /// The fence: the areas of the configuration and those loaded by 50017.
    pub(crate) fence: (&'a [Area], &'a Areas),
    /// Why the vehicle does not hold it, where it could not be uploaded.
    pub(crate) unfenced: Option<&'a str>,
    /// The vehicle finds the mission aboard infeasible within it, and flies no part of it.
    pub(crate) infeasible: bool,
    /// Why the VSM can begin no upload by itself now.
    pub(crate) may_change: Result<(), &'static str>,
}

/// The transfer in progress to the vehicle's mission store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Transfer {
    /// Nothing.
    None,
    /// A load or a clearing.
    Running {
        /// The requesting station; `None` for the VSM itself.
        owner: Option<usize>,
        /// The sender of a mode command that follows it; the inner `None` means the VSM itself.
        waiting_command: Option<Option<Origin>>,
    },
}

/// The flight state that other machines may read.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FlightView<'a> {
    /// A maneuver is in progress.
    pub(crate) maneuver: bool,
    /// A curve of the mission is being streamed: the vehicle follows it in OFFBOARD.
    pub(crate) streams_curve: bool,
    /// The VSM is flying the loss action.
    pub(crate) loss_action: bool,
    /// A contingency is being commanded, or the vehicle was brought to what it flies by one whose cause lasts.
    pub(crate) contingency: bool,
    /// Until then a wing may be on its final approach: no MISSION_CURRENT has named its item since a silence.
    pub(crate) item_unknown_until: Option<Duration>,
    /// The VSM itself is commanding the vehicle: the loss action or a contingency.
    pub(crate) commands_by_itself: bool,
    /// What 3002 and 3004 report as commanded.
    pub(crate) commanded: Commanded,
    pub(crate) altimeter: Altimeter,
    pub(crate) loiter: &'a LoiterConfiguration,
    /// The last 2008.
    pub(crate) engine_command: Option<CommandedEngineState>,
    /// The last 2010, and until when it is valid.
    pub(crate) sticks: Option<(&'a UaStickCommand, Duration)>,
}

/// The state of a flight termination that other machines may read.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct TerminationView {
    /// Reported Flight Termination State of 3005; `None` where nothing was received of the vehicle: it may have ended its
    /// flight by itself.
    pub(crate) reported: Option<FtState>,
    /// Nothing else is flown.
    pub(crate) holds: bool,
}

/// The vehicle's parameters, as far as they have been read.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ParameterView<'a> {
    pub(crate) values: &'a Parameters,
    /// More of them are being read.
    pub(crate) reading: bool,
}

impl Context<'_> {
    /// The vehicle.
    pub(crate) fn id(&self) -> Id {
        self.config.id
    }

    /// The monotonic time.
    pub(crate) fn mono(&self) -> Duration {
        self.now.mono
    }

    /// A station as the authority knows it.
    pub(crate) fn asker(&self, index: usize) -> Option<Asker> {
        let station = self.stations.get(index)?;
        Some(station.asker(self.id()))
    }

    /// Whether a command may still be carried out after a change of control: its sender controls the vehicle, or nobody does
    /// and it is a held contingency, which was given for that.
    pub(crate) fn keeps_right(&self, origin: Origin) -> bool {
        match self.controller {
            Some(id) => self.asker(origin.station).is_some_and(|one| one.id == id),
            None => origin.held.is_some_and(|held| held.contingency),
        }
    }

    /// The station as the sender of the message that is handled now.
    pub(crate) fn sender(&self, index: usize) -> Option<Asker> {
        let station = self.stations.get(index)?;
        Some(station.sender(self.id()))
    }

    /// The levels that a station may release or hand over by that message.
    pub(crate) fn disposes_of(&self, index: usize) -> LoiBitmap {
        let station = self.stations.get(index);
        station.map_or(LoiBitmap::NONE, |one| one.disposes_of(self.id()))
    }

    /// Which messages with a derived layout are used with a station: all with one of Edition 2.5, whose layouts are those of
    /// the text.
    pub(crate) fn provisional(&self, station: usize) -> config::Provisional {
        match self.stations.get(station) {
            Some(one) if one.speaks_ed25() => config::Provisional::All,
            Some(one) => one.profile.provisional,
            None => config::Provisional::Off,
        }
    }

    /// Every CUCS of the configuration.
    pub(crate) fn roster(&self) -> Vec<Asker> {
        let listed = self.stations.iter().filter(|one| !one.removed);
        listed.map(|one| one.asker(self.id())).collect()
    }

    /// The same, each with what it keeps where it holds it.
    pub(crate) fn keepers(&self) -> Vec<Asker> {
        let listed = self.stations.iter().filter(|one| !one.removed);
        let flies = self.vehicle.may_fly();
        listed.map(|one| one.keeper(self.id(), flies)).collect()
    }

    /// The index of a station.
    pub(crate) fn station_of(&self, id: Id) -> Option<usize> {
        self.stations.iter().position(|station| station.id() == id)
    }

    /// The payload stations of the vehicle.
    pub(crate) fn equipment(&self) -> Vec<Equipment> {
        let configured: Vec<Equipment> = (self.config.payload.iter())
            .map(config::Payload::equipment)
            .collect();
        self.vehicle.payloads.stations(&configured)
    }

    /// Their numbers, as rights have them.
    pub(crate) fn payload_stations(&self) -> Stations {
        let numbers = self.equipment();
        let bits = numbers.iter().map(|one| Stations::one(one.number).raw());
        Stations::from_raw(bits.fold(0, |all, bit| all | bit))
    }

    /// Message 3.
    pub(crate) fn vehicle_id(&self, mission: &MissionView<'_>, stamp: TimeStamp) -> VehicleId {
        VehicleId {
            time_stamp: Some(stamp),
            vsm_id: Some(self.vsm),
            vehicle_id_update: Some(self.id()),
            vehicle_type: Some(self.vehicle.vehicle_type()),
            vehicle_subtype: Some(0),
            // The first byte of an id is the owning nation.
            owning_id: Some((self.id().0 >> 24) as u8),
            tail_number: Some(Text::new(&self.config.tail_number)),
            mission_id: mission
                .uploaded
                .map(|uploaded| Text::new(&uploaded.mission_name)),
            ..VehicleId::default()
        }
    }

    /// Whether a vehicle that must be stopped returns instead of holding, because nothing would end the hold. `contingency`:
    /// a contingency has sent it there.
    pub(crate) fn returns_instead(&self, contingency: bool) -> bool {
        let on_loss = self.settings.authority.on_loss;
        contingency || (self.controller.is_none() && on_loss != config::OnLoss::Continue)
    }

    /// Whether a message with a VSM ID field is for this VSM: it names this VSM, the broadcast id or the null id.
    pub(crate) fn is_addressed(&self, vsm: Option<Id>) -> bool {
        vsm.is_none_or(|id| [self.vsm, Id::BROADCAST, Id::NULL, Id(0)].contains(&id))
    }
}

impl ParameterView<'_> {
    /// A parameter of the vehicle, where it is known.
    pub(crate) fn get(&self, name: &str) -> Option<f64> {
        self.values.get(name)
    }

    /// The limits for commands and routes, as declared by 41000: from the configuration and the vehicle's own fence.
    pub(crate) fn limits(&self, context: &Context<'_>) -> Limits {
        context.bounds.limits.of(self.values)
    }

    /// The limits of commanded speeds, as reported by 41003, and the vehicle's own speeds.
    pub(crate) fn performance(&self, context: &Context<'_>) -> Performance {
        let hovers = context.vehicle.telemetry.hovers();
        Performance::of(hovers, self.values, &context.bounds.limits)
    }

    /// The same along a route: a VTOL flies it on its wings, whatever its present state.
    pub(crate) fn route_performance(&self, context: &Context<'_>) -> Performance {
        let hovers = !context.vehicle.telemetry.airframe().has_wings();
        Performance::of(hovers, self.values, &context.bounds.limits)
    }

    /// How it flies curves: the configured tolerance, and the vehicle's own parameters.
    pub(crate) fn curving(&self, context: &Context<'_>) -> Curving {
        let mut curving = context.bounds.curving;
        curving.know(self.values);
        curving
    }

    /// The limits of a route flown on wings; `None` for a multicopter.
    pub(crate) fn wings(&self, context: &Context<'_>) -> Option<Wings> {
        let vtol = match context.vehicle.telemetry.airframe() {
            Airframe::Multicopter => return None,
            Airframe::FixedWing => false,
            Airframe::Vtol => true,
        };
        let Bounds {
            limits, landing, ..
        } = context.bounds;
        Some(Wings::of(vtol, self.values, limits, *landing))
    }

    /// Whether parameters that limit a route are still being read.
    pub(crate) fn awaits_performance(&self, context: &Context<'_>) -> bool {
        let wings: &[&str] = if context.vehicle.telemetry.airframe().has_wings() {
            &Wings::NAMES
        } else {
            &[]
        };
        let mut names = Performance::NAMES.iter().chain(&Limits::NAMES).chain(wings);
        self.reading && names.any(|name| self.get(name).is_none())
    }
}

/// Whether a fixed wing flies a mission whose current item is unknown, as after each silence: it may be the touch-down.
pub(crate) fn may_be_on_final(telemetry: &Telemetry) -> bool {
    telemetry.airframe().has_wings()
        && telemetry.mode == Some(Px4Mode::MISSION)
        && telemetry.mission.is_none()
}

impl MissionView<'_> {
    /// Whether a load or a clearing runs.
    pub(crate) fn is_transferring(&self) -> bool {
        self.transfer != Transfer::None
    }

    /// The sender of the mode command that waits for its route.
    pub(crate) fn waiting_command(&self) -> Option<Option<Origin>> {
        match self.transfer {
            Transfer::Running {
                waiting_command, ..
            } => waiting_command,
            Transfer::None => None,
        }
    }

    /// Whether the vehicle flies the landing of the mission aboard: the touch-down or the approach.
    pub(crate) fn lands(&self, telemetry: &Telemetry) -> bool {
        self.uploaded
            .is_some_and(|uploaded| uploaded.lands(telemetry))
    }

    /// [`UploadedMission::is_on_final`] of the mission aboard.
    pub(crate) fn is_on_final(&self, telemetry: &Telemetry) -> bool {
        self.uploaded
            .is_some_and(|uploaded| uploaded.is_on_final(telemetry))
    }

    /// Whether there is a fence.
    pub(crate) fn has_fence(&self) -> bool {
        let (configured, loaded) = self.fence;
        !(configured.is_empty() && loaded.is_empty())
    }

    /// Whether a position, degrees north and east, is outside the fence.
    pub(crate) fn is_outside_fence(&self, at: (f64, f64)) -> bool {
        let (configured, loaded) = self.fence;
        is_breached(&loaded.with(configured), at)
    }

    /// Why the vehicle would not fly the mission aboard, where it finds it infeasible. On the ground PX4 judges it again on entering
    /// AUTO.MISSION: only what breaches the fence stays infeasible.
    pub(crate) fn why_infeasible(&self, telemetry: &Telemetry) -> Option<String> {
        let uploaded = self.uploaded.filter(|_| self.infeasible)?;
        let (configured, loaded) = self.fence;
        let breach = uploaded.breach_of(&loaded.with(configured));
        let stays = breach.is_some() || !telemetry.stands();
        stays.then(|| uploaded.infeasible(breach))
    }

    /// Whether a route of this type can be flown: it is stored, or aboard.
    pub(crate) fn has_route(&self, route_type: RouteType) -> bool {
        self.plan.route_of_type(route_type).is_some() || self.carries(route_type)
    }

    /// Why a route of this type cannot be flown at once without a CUCS that waits for it: the one aboard needs no upload.
    pub(crate) fn may_fly(&self, route_type: RouteType) -> Result<(), &'static str> {
        match self.carries(route_type) && !self.is_transferring() && !self.fence_busy {
            true => Ok(()),
            false => self.may_change,
        }
    }

    /// The type of the route that the vehicle flies in AUTO.MISSION; `None` if it reports a mission id other than the one
    /// read back from it, since another station's mission is not a route of this VSM.
    pub(crate) fn flies(&self, telemetry: &Telemetry) -> Option<RouteType> {
        let flown = telemetry.mode == Some(Px4Mode::MISSION);
        let mission = telemetry.mission.filter(|_| flown)?;
        let named = self.uploaded?;
        named
            .is_aboard(mission.mission_id)
            .then_some(named.route_type)
    }

    /// Whether the vehicle carries a route of this type.
    pub(crate) fn carries(&self, route_type: RouteType) -> bool {
        self.uploaded
            .is_some_and(|uploaded| uploaded.route_type == route_type)
    }
}

impl Settings {
    /// The values of a configuration.
    pub(crate) fn of(config: &config::Config) -> Settings {
        let page = |http: &config::Http| format!("http://{}/", http.listen);
        Settings {
            authority: *config.authority.get_ref(),
            web_page: config.http.as_ref().map(page),
        }
    }
}

impl Bounds {
    /// The values of a vehicle's configuration.
    pub(crate) fn of(config: &config::Vehicle) -> Bounds {
        let config::Limits {
            first_m,
            leg_m,
            lowest_m,
            below_home,
            highest_m,
            outside,
            above_terrain_m,
            speed_m_s,
            transition_m,
        } = config.limits;
        Bounds {
            agl: match config.agl {
                config::Agl::Home => Agl::AboveHome,
                config::Agl::Terrain => Agl::Terrain,
                config::Agl::Refuse => Agl::Refuse,
            },
            limits: Limits {
                first_m,
                leg_m,
                lowest_m,
                below_home,
                highest_m,
                above_terrain_m,
                speed_m_s,
                transition_m,
                items: usize::from(config.curve.max_items),
            },
            outside,
            terrain: config.terrain.as_ref().map(config::TerrainFolder::ground),
            curving: Curving {
                tolerance_m: config.curve.tolerance_m,
                policy: match config.curve.policy {
                    config::CurvePolicy::Slow => Policy::Slow,
                    config::CurvePolicy::Refuse => Policy::Refuse,
                },
                vertices: match config.curve.vertices {
                    config::CurveVertices::On => Vertices::OnCurve,
                    config::CurveVertices::Free => Vertices::Free,
                },
                streamed: config.curve.mode == config::CurveMode::Offboard,
                fixed_wing: FixedWing {
                    wind_mps: config.curve.wind_m_s,
                    ..FixedWing::default()
                },
                ..Curving::default()
            },
            landing: config.landing.as_ref().map(config::Landing::pattern),
        }
    }
}

/// Checks without another wake-up run this long after they are due: alerts may be late by as much, and so share the wake-ups
/// of the regular reports.
pub(crate) const WATCH_SLACK: Duration = Duration::from_millis(250);
