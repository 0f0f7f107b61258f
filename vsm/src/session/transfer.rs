//! A route on its way aboard: held if it must be, sent, read back, compared, its id checked.
//!
//! Nothing is sent before the whole route is valid. A different plan uploaded while the vehicle flies its mission
//! would be flown at once from the same index: it is put in AUTO.LOITER first.

use std::time::Duration;

use mapping::limits::Limits;
use mapping::mode::Px4Mode;
use mapping::plan::Plan;
use mapping::report::Commanded;
use mapping::route::Curving;
use mapping::route::{self, CompiledMission, Reason, RouteError, Site};
use mavlink_link::dialect::MissionState;
use mavlink_link::service::command;
use mavlink_link::service::mission::{
    self, Failure, MavMissionResult, MavMissionType, Operation, plan_id, verify,
};
use stanag_msgs::enums::RouteType;
use stanag_msgs::messages::UaRoute;

use super::maneuver::{self, Maneuver, Progress};
use super::plan_record::UploadedMission;
use super::vehicle::VehicleLink;

/// The machine.
#[derive(Debug)]
pub(crate) struct Transfer {
    phase: Phase,
    pub(crate) route_type: RouteType,
    /// The messages of the route that is sent, as they were when it was.
    pub(crate) plan: Plan,
    /// The vehicle was taken out of AUTO.MISSION for it.
    pub(crate) held: bool,
    route: Option<UaRoute>,
    percent: u8,
    /// Something of this plan may be aboard.
    touched: bool,
}

#[derive(Debug)]
enum Phase {
    /// Made before, and aboard once: sent as it was.
    Again {
        compiled: CompiledMission,
    },
    /// Waits for home, for the parameters that are being read, and for the geoid separation where an altitude needs it.
    Site {
        deadline: Duration,
    },
    Hold {
        maneuver: Maneuver,
        compiled: CompiledMission,
    },
    Sending {
        compiled: CompiledMission,
    },
    Reading {
        compiled: CompiledMission,
    },
    Checking {
        compiled: CompiledMission,
        id: u32,
        deadline: Duration,
    },
    Ended,
}

/// What became of a transfer.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Course {
    Going,
    /// Per cent complete, when it has grown.
    Percent(u8),
    /// It is aboard, as the vehicle itself says.
    Done {
        compiled: CompiledMission,
        mission_id: u32,
    },
    /// It is not. `touched`: the vehicle may hold something else than before.
    Refused {
        waypoint: Option<u16>,
        why: String,
        touched: bool,
    },
}

/// What is the same for every route of a vehicle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bounds {
    pub(crate) agl: mapping::altitude::Agl,
    pub(crate) altimeter: mapping::altitude::Altimeter,
    pub(crate) limits: Limits,
    pub(crate) curving: Curving,
}

impl Transfer {
    pub(crate) fn new(now: Duration, route: &UaRoute, route_type: RouteType) -> Transfer {
        Transfer {
            phase: Phase::Site {
                deadline: now + SITE_WITHIN,
            },
            route_type,
            plan: Plan::default(),
            held: false,
            route: Some(route.clone()),
            percent: 0,
            touched: false,
        }
    }

    /// A route that was aboard already, and is no more.
    pub(crate) fn again(aboard: &UploadedMission) -> Transfer {
        Transfer {
            phase: Phase::Again {
                compiled: aboard.compiled.clone(),
            },
            route_type: aboard.route_type,
            plan: aboard.plan.clone(),
            held: false,
            route: None,
            percent: 0,
            touched: false,
        }
    }

    /// Whether it may wait for what the vehicle has not told yet.
    pub(crate) fn may_wait(&self, now: Duration) -> bool {
        matches!(self.phase, Phase::Site { deadline } if now < deadline)
    }

    /// Whether nothing has been asked of the vehicle yet.
    pub(crate) fn has_not_begun(&self) -> bool {
        matches!(self.phase, Phase::Site { .. } | Phase::Again { .. })
    }

    /// Begins what can begin, looks at what is awaited.
    pub(crate) fn advance(
        &mut self,
        now: Duration,
        plan: &Plan,
        site: Option<&Site>,
        vehicle: &mut VehicleLink,
    ) -> Course {
        match std::mem::replace(&mut self.phase, Phase::Ended) {
            Phase::Site { deadline } => self.start(now, deadline, plan, site, vehicle),
            Phase::Again { compiled } => self.begin(now, compiled, vehicle),
            Phase::Hold {
                mut maneuver,
                compiled,
            } => match maneuver.advance(now, vehicle) {
                Progress::Going => {
                    self.phase = Phase::Hold { maneuver, compiled };
                    Course::Going
                }
                Progress::Done => self.send(now, compiled, vehicle),
                Progress::Refused(why) => {
                    self.refused(None, format!("the vehicle does not hold: {why}"))
                }
            },
            Phase::Checking {
                compiled,
                id,
                deadline,
            } => self.check(now, compiled, id, deadline, vehicle),
            other => {
                self.phase = other;
                Course::Going
            }
        }
    }

    fn start(
        &mut self,
        now: Duration,
        deadline: Duration,
        plan: &Plan,
        site: Option<&Site>,
        vehicle: &mut VehicleLink,
    ) -> Course {
        let wait = now < deadline;
        let initial = self
            .route
            .as_ref()
            .and_then(|route| route.initial_waypoint_number);
        let initial = initial.unwrap_or(0);
        let compiled = match site.map(|site| route::compile(plan, initial, site)) {
            Some(Ok(compiled)) => compiled,
            Some(Err(RouteError {
                reason: Reason::Altitude(mapping::altitude::AltitudeError::NoGeoid),
                ..
            }))
            | None
                if wait =>
            {
                self.phase = Phase::Site { deadline };
                return Course::Going;
            }
            Some(Err(fault)) => return self.refused(Some(fault.waypoint), fault.to_string()),
            None => {
                return self.refused(
                    None,
                    "the vehicle has not told its home position".to_owned(),
                );
            }
        };
        if let Some(route) = &self.route {
            self.plan = plan.part(route);
        }
        let mut compiled = compiled;
        if self.route_type == RouteType::Approach {
            compiled.land_at_the_end();
        }
        self.begin(now, compiled, vehicle)
    }

    /// Sends it, from AUTO.LOITER where another mission is flown.
    fn begin(
        &mut self,
        now: Duration,
        compiled: CompiledMission,
        vehicle: &mut VehicleLink,
    ) -> Course {
        let telemetry = &vehicle.telemetry;
        let same = telemetry
            .mission
            .is_some_and(|mission| mission.mission_id == plan_id(&compiled.items));
        // What the vehicle names as its plan already is only read back: PX4 would apply nothing of an upload.
        if same {
            return self.read_back(now, compiled, vehicle);
        }
        if telemetry.mode == Some(Px4Mode::MISSION) && !telemetry.stands() {
            let maneuver = Maneuver::new(maneuver::enter(&[Px4Mode::LOITER]), Commanded::default());
            self.phase = Phase::Hold { maneuver, compiled };
            self.held = true;
            return Course::Percent(0);
        }
        self.send(now, compiled, vehicle)
    }

    fn send(
        &mut self,
        now: Duration,
        compiled: CompiledMission,
        vehicle: &mut VehicleLink,
    ) -> Course {
        match vehicle.missions.upload(
            now,
            MavMissionType::MAV_MISSION_TYPE_MISSION,
            compiled.items.clone(),
        ) {
            Ok(()) => {
                self.phase = Phase::Sending { compiled };
                Course::Percent(0)
            }
            Err(fault) => self.refused(None, format!("the upload cannot begin: {fault}")),
        }
    }

    fn read_back(
        &mut self,
        now: Duration,
        compiled: CompiledMission,
        vehicle: &mut VehicleLink,
    ) -> Course {
        match vehicle
            .missions
            .download(now, MavMissionType::MAV_MISSION_TYPE_MISSION)
        {
            Ok(()) => {
                self.phase = Phase::Reading { compiled };
                self.grown(50)
            }
            Err(fault) => self.refused(None, format!("the read-back cannot begin: {fault}")),
        }
    }

    /// The end of a command, while the vehicle is put on hold.
    pub(crate) fn handle_command(
        &mut self,
        now: Duration,
        event: &command::Event,
        vehicle: &VehicleLink,
    ) -> Course {
        let Phase::Hold { maneuver, .. } = &mut self.phase else {
            return Course::Going;
        };
        match maneuver.handle_command(now, event, vehicle) {
            Progress::Refused(why) => {
                self.refused(None, format!("the vehicle does not hold: {why}"))
            }
            Progress::Going | Progress::Done => Course::Going,
        }
    }

    /// What the mission service has done.
    pub(crate) fn handle_mission(
        &mut self,
        now: Duration,
        event: mission::Event,
        vehicle: &mut VehicleLink,
    ) -> Course {
        match (std::mem::replace(&mut self.phase, Phase::Ended), event) {
            (
                Phase::Sending { compiled },
                mission::Event::Progress {
                    operation: Operation::Upload,
                    percent,
                    ..
                },
            ) => {
                self.phase = Phase::Sending { compiled };
                self.touched = true;
                // The read-back is the second half.
                self.grown(percent / 2)
            }
            (
                Phase::Reading { compiled },
                mission::Event::Progress {
                    operation: Operation::Download,
                    percent,
                    ..
                },
            ) => {
                self.phase = Phase::Reading { compiled };
                self.grown(50 + percent / 2)
            }
            (Phase::Sending { compiled }, mission::Event::Uploaded { .. }) => {
                self.touched = true;
                self.read_back(now, compiled, vehicle)
            }
            (
                Phase::Reading { compiled },
                mission::Event::Downloaded {
                    items, opaque_id, ..
                },
            ) => {
                match verify(
                    MavMissionType::MAV_MISSION_TYPE_MISSION,
                    &compiled.items,
                    &items,
                ) {
                    Ok(()) => {
                        let deadline = now + CURRENT_WITHIN;
                        self.phase = Phase::Checking {
                            compiled,
                            id: opaque_id,
                            deadline,
                        };
                        Course::Going
                    }
                    // It names this plan, and holds another: it gets it after all.
                    Err(_) if !self.touched => self.send(now, compiled, vehicle),
                    Err(difference) => self.refused(
                        None,
                        format!("the vehicle holds another plan: {difference}"),
                    ),
                }
            }
            (
                Phase::Sending { compiled },
                mission::Event::Failed {
                    operation: Operation::Upload,
                    reason,
                    ..
                },
            ) => {
                let waypoint = match reason {
                    Failure::Refused { seq: Some(seq), .. } => {
                        compiled.waypoint_of.get(usize::from(seq)).copied()
                    }
                    _ => None,
                };
                self.refused(waypoint, format!("upload: {}", explain(&reason)))
            }
            (
                Phase::Reading { .. },
                mission::Event::Failed {
                    operation: Operation::Download,
                    reason,
                    ..
                },
            ) => self.refused(None, format!("read-back: {}", explain(&reason))),
            (phase, _) => {
                self.phase = phase;
                Course::Going
            }
        }
    }

    /// MISSION_CURRENT must name the plan that was read back, and call it flyable.
    fn check(
        &mut self,
        now: Duration,
        compiled: CompiledMission,
        id: u32,
        deadline: Duration,
        vehicle: &mut VehicleLink,
    ) -> Course {
        let mission = vehicle.telemetry.mission;
        let flyable =
            mission.is_some_and(|mission| mission.state != MissionState::MISSION_STATE_NO_MISSION);
        let named = id == 0 || mission.is_some_and(|mission| mission.mission_id == id);
        if flyable && named {
            return Course::Done {
                compiled,
                mission_id: id,
            };
        }
        if now < deadline {
            self.phase = Phase::Checking {
                compiled,
                id,
                deadline,
            };
            return Course::Going;
        }
        let why = vehicle.latest_complaint(now).unwrap_or_default();
        if named {
            self.refused(None, format!("the vehicle finds the route infeasible{why}"))
        } else {
            self.refused(
                None,
                format!("the vehicle does not report the loaded route as its mission{why}"),
            )
        }
    }

    /// When [`Transfer::advance`] is next needed.
    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        match &self.phase {
            Phase::Site { deadline } | Phase::Checking { deadline, .. } => Some(*deadline),
            Phase::Hold { maneuver, .. } => maneuver.poll_timeout(),
            Phase::Again { .. } => Some(Duration::ZERO),
            Phase::Sending { .. } | Phase::Reading { .. } | Phase::Ended => None,
        }
    }

    /// Ends it (13000 mode 5). True where the vehicle may hold something else than before.
    pub(crate) fn cancel(&mut self, now: Duration, vehicle: &mut VehicleLink) -> bool {
        if let Phase::Hold { maneuver, .. } = &mut self.phase {
            maneuver.abandon(now, vehicle);
        }
        if matches!(self.phase, Phase::Sending { .. } | Phase::Reading { .. }) {
            vehicle.missions.cancel();
        }
        self.phase = Phase::Ended;
        self.touched
    }

    fn grown(&mut self, percent: u8) -> Course {
        // A step of five: 14000 is a report, not a stream.
        if percent < self.percent.saturating_add(5) {
            return Course::Going;
        }
        self.percent = percent;
        Course::Percent(percent)
    }

    fn refused(&mut self, waypoint: Option<u16>, why: String) -> Course {
        self.phase = Phase::Ended;
        Course::Refused {
            waypoint,
            why,
            touched: self.touched,
        }
    }
}

pub(crate) fn explain(reason: &Failure) -> String {
    match reason {
        Failure::Refused { result, seq } => {
            let at = seq.map_or_else(String::new, |seq| format!(" at item {seq}"));
            format!("the vehicle refuses it{at}: {}", mission_result(*result))
        }
        Failure::OtherPlan { .. } => "the vehicle acknowledged another plan".to_owned(),
        Failure::NoAnswer { .. } => "the vehicle does not answer".to_owned(),
        Failure::Cancelled => "cancelled".to_owned(),
    }
}

fn mission_result(result: MavMissionResult) -> &'static str {
    use MavMissionResult as R;
    match result {
        R::MAV_MISSION_NO_SPACE => "no space for so many items",
        R::MAV_MISSION_UNSUPPORTED => "unsupported item",
        R::MAV_MISSION_UNSUPPORTED_FRAME => "unsupported frame",
        R::MAV_MISSION_DENIED => "denied",
        R::MAV_MISSION_INVALID_SEQUENCE => "items out of sequence",
        R::MAV_MISSION_OPERATION_CANCELLED => "cancelled",
        R::MAV_MISSION_ERROR => "error, perhaps another station's transfer",
        _ => "invalid parameter",
    }
}

/// PX4 tells its home some seconds after its start, every 2 s.
const SITE_WITHIN: Duration = Duration::from_secs(10);
/// MISSION_CURRENT comes at 1 Hz at least.
const CURRENT_WITHIN: Duration = Duration::from_secs(5);
