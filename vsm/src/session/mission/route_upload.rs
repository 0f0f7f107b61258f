//! The upload of a route: compiled, the vehicle put on hold if needed, then uploaded.
//!
//! Nothing is sent before the whole route is valid. A different plan uploaded while the vehicle flies its mission
//! would be flown at once from the same index: the vehicle is put in AUTO.LOITER first.

use std::time::Duration;

use mapping::altitude::AltitudeError;
use mapping::mode::Px4Mode;
use mapping::plan::Plan;
use mapping::report::Commanded;
use mapping::route::{self, CompiledMission, Reason, RouteError, Site};
use mavlink_link::dialect::MissionState;
use mavlink_link::service::command;
use mavlink_link::service::mission::{self, MavMissionType, Operation, plan_id};
use stanag_msgs::enums::RouteType;
use stanag_msgs::messages::UaRoute;

use super::fence::Fence;
use super::record::UploadedMission;
use super::upload::{self, Fault, Upload};
use crate::session::link::services::Services;
use crate::session::link::state::VehicleState;
use crate::session::maneuver::{self, Maneuver, Refusal};

/// The machine.
#[derive(Debug)]
pub(super) struct RouteUpload {
    phase: Phase,
    pub(super) route_type: RouteType,
    /// The messages of the route, as they were when its upload began.
    pub(super) plan: Plan,
    /// The vehicle was taken out of AUTO.MISSION for it.
    pub(super) held: bool,
    /// The id by which MISSION_CURRENT names its items, once they are compiled.
    pub(super) mission_id: Option<u32>,
    /// When it was first given to the vehicle.
    began: Option<Duration>,
    /// When the vehicle had all of it, or the fence within which it has to be after that: it judges the route then.
    judged: Option<Duration>,
    /// What to compile; `None` for a route that was compiled before.
    route: Option<UaRoute>,
    /// For a mode: checked alone. Other messages of a CUCS, perhaps half of another upload, must not prevent a contingency
    /// route.
    alone: bool,
}

#[derive(Debug)]
enum Phase {
    /// Compiled and uploaded before: sent unchanged.
    Again {
        compiled: CompiledMission,
    },
    /// Waits for home, for parameters being read, and for the geoid separation if an altitude needs it.
    Site {
        deadline: Duration,
    },
    /// The vehicle is being put on hold.
    Hold {
        /// Boxed, because it is larger than the other variants.
        maneuver: Box<Maneuver>,
        compiled: CompiledMission,
    },
    /// The vehicle has refused that, and its reason may still come.
    NotHeld(Refusal),
    Upload {
        upload: Upload,
        compiled: CompiledMission,
    },
    Ended,
}

/// The result.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Outcome {
    Going,
    /// Per cent complete, when it has grown.
    Percent(u8),
    /// The vehicle carries it and reports it as its mission.
    Done {
        compiled: CompiledMission,
        mission_id: u32,
    },
    /// `touched`: the vehicle may carry a different mission than before. `flaw`: the route itself cannot be flown; otherwise
    /// the same route may be loaded later.
    Refused {
        waypoint: Option<u16>,
        why: String,
        touched: bool,
        flaw: bool,
    },
}

impl RouteUpload {
    /// The upload of a route of the stored plan.
    pub(super) fn new(
        now: Duration,
        route: &UaRoute,
        route_type: RouteType,
        alone: bool,
    ) -> RouteUpload {
        RouteUpload {
            phase: Phase::Site {
                deadline: now + SITE_WITHIN,
            },
            route_type,
            plan: Plan::default(),
            held: false,
            mission_id: None,
            began: None,
            judged: None,
            route: Some(route.clone()),
            alone,
        }
    }

    /// The upload of a route that the vehicle carried before.
    pub(super) fn again(uploaded: &UploadedMission) -> RouteUpload {
        RouteUpload {
            phase: Phase::Again {
                compiled: uploaded.compiled.clone(),
            },
            route_type: uploaded.route_type,
            plan: uploaded.plan.clone(),
            held: false,
            mission_id: None,
            began: None,
            judged: None,
            // Not compiled again: the vehicle gets the items of the last load, byte for byte.
            route: None,
            alone: false,
        }
    }

    /// Whether it may wait for what the vehicle has not reported yet.
    pub(super) fn may_wait(&self, now: Duration) -> bool {
        matches!(self.phase, Phase::Site { deadline } if now < deadline)
    }

    /// Whether nothing has been requested of the vehicle yet.
    pub(super) fn has_not_begun(&self) -> bool {
        matches!(self.phase, Phase::Site { .. } | Phase::Again { .. })
    }

    /// Starts the next step if possible, and checks pending ones. `fence`: within it the vehicle judges the route, once it has read it.
    pub(super) fn advance(
        &mut self,
        now: Duration,
        plan: &Plan,
        site: Option<&Site>,
        fence: &Fence,
        (state, vehicle): (&VehicleState, &mut Services),
    ) -> Outcome {
        match std::mem::replace(&mut self.phase, Phase::Ended) {
            Phase::Site { deadline } => match self.compile(now < deadline, plan, site) {
                Ok(Some(compiled)) => self.begin(now, compiled, state, vehicle),
                Ok(None) => {
                    self.phase = Phase::Site { deadline };
                    Outcome::Going
                }
                Err(fault) => Outcome::Refused {
                    flaw: fault.is_some(),
                    waypoint: fault.as_ref().map(|fault| fault.waypoint),
                    why: fault.map_or_else(|| NO_HOME.to_owned(), |fault| fault.to_string()),
                    touched: false,
                },
            },
            Phase::Again { compiled } => self.begin(now, compiled, state, vehicle),
            Phase::Hold {
                mut maneuver,
                compiled,
            } => match maneuver.advance(now, state, vehicle) {
                maneuver::Progress::Going => {
                    self.phase = Phase::Hold { maneuver, compiled };
                    Outcome::Going
                }
                maneuver::Progress::Done => self.send(now, compiled, vehicle),
                maneuver::Progress::Refused(why) => self.not_held(now, why, state),
            },
            Phase::NotHeld(why) => self.not_held(now, why, state),
            Phase::Upload {
                mut upload,
                compiled,
            } => {
                let mut mission = state.telemetry.mission;
                if let Some(at) = fence.read_at() {
                    upload.judged_from(at);
                    self.judged = self.judged.max(Some(at));
                    // Until then PX4 reports what it found before, within its former fence.
                    mission = mission.filter(|_| state.progress_at() >= Some(at));
                }
                // PX4 also acknowledges an infeasible plan: only MISSION_STATE_NO_MISSION shows that.
                let flyable = mission
                    .is_some_and(|mission| mission.state != MissionState::MISSION_STATE_NO_MISSION);
                let named = mission.map(|mission| mission.mission_id);
                let progress = upload.check(now, named, flyable);
                if progress == upload::Progress::Failed(Fault::Unusable) {
                    return self.infeasible(&compiled, upload.touched(), fence, state);
                }
                self.follow(progress, upload, compiled, state)
            }
            Phase::Ended => Outcome::Going,
        }
    }

    /// The end of a command, while the vehicle is put on hold.
    pub(super) fn handle_command(
        &mut self,
        now: Duration,
        event: &command::Event,
        state: &VehicleState,
    ) -> Outcome {
        let Phase::Hold { maneuver, .. } = &mut self.phase else {
            return Outcome::Going;
        };
        match maneuver.handle_command(now, event, state) {
            maneuver::Progress::Refused(why) => self.not_held(now, why, state),
            maneuver::Progress::Going | maneuver::Progress::Done => Outcome::Going,
        }
    }

    /// Handles an event of the mission service.
    pub(super) fn handle_service(
        &mut self,
        now: Duration,
        event: &mission::Event,
        state: &VehicleState,
        vehicle: &mut Services,
    ) -> Outcome {
        match std::mem::replace(&mut self.phase, Phase::Ended) {
            Phase::Upload {
                mut upload,
                compiled,
            } => {
                if let mission::Event::Uploaded { .. } = event {
                    self.judged = Some(now);
                }
                let progress = upload.handle(now, event, &compiled.items, vehicle);
                self.follow(progress, upload, compiled, state)
            }
            other => {
                self.phase = other;
                Outcome::Going
            }
        }
    }

    /// The bridge did not run for so long.
    pub(super) fn postpone(&mut self, stopped: Duration) {
        match &mut self.phase {
            Phase::Site { deadline } => *deadline += stopped,
            Phase::Hold { maneuver, .. } => maneuver.postpone(stopped),
            Phase::NotHeld(why) => why.postpone(stopped),
            Phase::Upload { upload, .. } => upload.postpone(stopped),
            Phase::Again { .. } | Phase::Ended => {}
        }
    }

    /// When [`RouteUpload::advance`] is next needed, apart from data of the vehicle.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        match &self.phase {
            Phase::Site { deadline } => Some(*deadline),
            Phase::Hold { maneuver, .. } => maneuver.poll_timeout(),
            Phase::NotHeld(why) => why.poll_timeout(),
            Phase::Upload { upload, .. } => upload.poll_timeout(),
            // Begins with the next step, which follows at once.
            Phase::Again { .. } | Phase::Ended => None,
        }
    }

    /// Cancels it (13000 mode 5). Returns true if the vehicle may carry a different mission than before.
    pub(super) fn cancel(
        &mut self,
        now: Duration,
        state: &VehicleState,
        vehicle: &mut Services,
    ) -> bool {
        match std::mem::replace(&mut self.phase, Phase::Ended) {
            Phase::Hold { mut maneuver, .. } => {
                maneuver.abandon(now, state, vehicle);
                false
            }
            Phase::Upload { upload, .. } => {
                upload.cancel(vehicle);
                upload.touched()
            }
            Phase::Again { .. } | Phase::Site { .. } | Phase::NotHeld(_) | Phase::Ended => false,
        }
    }

    /// Another maneuver has begun, and what the vehicle says from now on may be about that.
    pub(super) fn expect_no_reason(&mut self, state: &VehicleState) {
        if let Phase::NotHeld(why) = &mut self.phase {
            why.explain(state);
        }
    }

    /// The vehicle does not hold: ends it once the reason has come.
    fn not_held(&mut self, now: Duration, why: Refusal, state: &VehicleState) -> Outcome {
        if why.awaits_reason(now, state) {
            self.phase = Phase::NotHeld(why);
            return Outcome::Going;
        }
        self.phase = Phase::Ended;
        let why = format!("the vehicle does not hold: {}", why.text(state));
        refused(None, why, false)
    }

    /// Compiles the route to mission items; `None` if it must `wait` for reports of the vehicle.
    ///
    /// # Errors
    /// It cannot be flown; `None` if home is unknown.
    fn compile(
        &mut self,
        wait: bool,
        plan: &Plan,
        site: Option<&Site>,
    ) -> Result<Option<CompiledMission>, Option<RouteError>> {
        let route = self.route.as_ref();
        let initial = route.and_then(|route| route.initial_waypoint_number);
        let own = route.filter(|_| self.alone).map(|route| plan.part(route));
        let judged = own.as_ref().unwrap_or(plan);
        let compiled = site.map(|site| {
            let mut compiled = route::compile(judged, initial.unwrap_or(0), site)?;
            // The landing of a wing may be another route of the plan.
            route::complete(&mut compiled, plan, self.route_type, site)?;
            Ok(compiled)
        });
        let mut compiled = match compiled {
            Some(Ok(compiled)) => compiled,
            // Home and the geoid separation are reported within seconds; waiting does not help with any other fault.
            Some(Err(RouteError {
                reason: Reason::Altitude(AltitudeError::NoGeoid),
                ..
            }))
            | None
                if wait =>
            {
                return Ok(None);
            }
            Some(Err(fault)) => return Err(Some(fault)),
            None => return Err(None),
        };
        if let Some((site, terrain)) = site.and_then(|site| Some((site, site.terrain?))) {
            let checked = compiled.check_terrain(site.home.amsl_m, &site.limits, terrain);
            compiled.notes.extend(checked.map_err(Some)?);
        }
        // Keep a copy: a CUCS may send messages of this route during the upload.
        if let Some(route) = route {
            self.plan = judged.part(route);
        }
        Ok(Some(compiled))
    }

    /// Sends it, from AUTO.LOITER if another mission is being flown.
    fn begin(
        &mut self,
        now: Duration,
        compiled: CompiledMission,
        state: &VehicleState,
        vehicle: &mut Services,
    ) -> Outcome {
        let telemetry = &state.telemetry;
        let id = plan_id(&compiled.items);
        self.mission_id = Some(id);
        let same = telemetry
            .mission
            .is_some_and(|mission| mission.mission_id == id);
        if same {
            // PX4 ignores an upload with the id that it already reports: only a read-back shows whether it holds these
            // items.
            self.began = Some(now);
            return match Upload::read_back(now, KIND, vehicle) {
                Ok(upload) => self.begun(upload, compiled, 50),
                Err(fault) => refused(None, Fault::NotRead(fault).explain("plan"), false),
            };
        }
        // PX4 would fly the new plan from the index that it has reached in the present one.
        if telemetry.mode == Some(Px4Mode::MISSION) && !telemetry.stands() {
            let maneuver = Maneuver::new(maneuver::enter(&[Px4Mode::LOITER]), Commanded::default());
            let maneuver = Box::new(maneuver);
            self.phase = Phase::Hold { maneuver, compiled };
            self.held = true;
            return Outcome::Percent(0);
        }
        self.send(now, compiled, vehicle)
    }

    fn send(
        &mut self,
        now: Duration,
        compiled: CompiledMission,
        vehicle: &mut Services,
    ) -> Outcome {
        self.began = Some(now);
        match Upload::send(now, KIND, &compiled.items, vehicle) {
            Ok(upload) => self.begun(upload, compiled, 0),
            Err(fault) => refused(None, Fault::NotSent(fault).explain("plan"), false),
        }
    }

    fn begun(&mut self, upload: Upload, compiled: CompiledMission, percent: u8) -> Outcome {
        self.phase = Phase::Upload { upload, compiled };
        Outcome::Percent(percent)
    }

    fn follow(
        &mut self,
        progress: upload::Progress,
        upload: Upload,
        compiled: CompiledMission,
        state: &VehicleState,
    ) -> Outcome {
        match progress {
            upload::Progress::Going => {
                self.phase = Phase::Upload { upload, compiled };
                Outcome::Going
            }
            upload::Progress::Percent(percent) => self.begun(upload, compiled, percent),
            upload::Progress::Done(mission_id) => Outcome::Done {
                compiled,
                mission_id,
            },
            upload::Progress::Failed(fault) => {
                // Only for an upload does the seq name a refused item.
                let item = fault.item().filter(|_| is_of_upload(&fault));
                let mut why = self.explain(&fault, state);
                if let Some(of) = item.and_then(|item| compiled.item_in_words(item)) {
                    why += &format!("; that item is {of}");
                }
                Outcome::Refused {
                    waypoint: item.and_then(|item| number_of(&compiled, item)),
                    why,
                    touched: upload.touched(),
                    flaw: fault.is_flaw(),
                }
            }
        }
    }

    /// The vehicle does not fly the route that it carries.
    fn infeasible(
        &self,
        compiled: &CompiledMission,
        touched: bool,
        fence: &Fence,
        state: &VehicleState,
    ) -> Outcome {
        let complaint = self.complaint(state);
        let named = item_named(&complaint);
        // PX4 does not judge a route again that it holds already, and gives no reason then; what it complains of meanwhile is
        // about something else.
        let found = || {
            fence
                .first_breach(compiled)
                .filter(|_| !is_of_judgement(&complaint))
        };
        let item = named.or_else(found);
        let of = item.and_then(|item| compiled.item_in_words(item));
        let by_whom = match (named, of) {
            (Some(item), Some(of)) => {
                format!("; item {} of the vehicle's mission is {of}", item + 1)
            }
            (None, Some(of)) => format!(": {of} breaches the fence"),
            (_, None) => String::new(),
        };
        Outcome::Refused {
            waypoint: item.and_then(|item| number_of(compiled, item)),
            why: format!("{}{complaint}{by_whom}", Fault::Unusable.explain("route")),
            touched,
            flaw: Fault::Unusable.is_flaw(),
        }
    }

    /// What the vehicle has complained of about the route; empty where it has not.
    fn complaint(&self, state: &VehicleState) -> String {
        // A read-back of many seconds follows, with other warnings.
        let complaint = self.began.and_then(|began| {
            let judged = self.judged.map_or(began, |judged| judged.max(began));
            state.complaint(began, judged)
        });
        complaint.unwrap_or_default()
    }

    fn explain(&self, fault: &Fault, state: &VehicleState) -> String {
        match fault {
            Fault::Service { operation, .. } => {
                let what = if *operation == Operation::Upload {
                    "upload"
                } else {
                    "read-back"
                };
                format!("{what}: {}", fault.explain("plan"))
            }
            Fault::NotNamed => format!(
                "the vehicle does not report the loaded route as its mission{}",
                self.complaint(state)
            ),
            Fault::Unusable => fault.explain("route"),
            Fault::NotSent(_) | Fault::NotRead(_) | Fault::Differs(_) => fault.explain("plan"),
        }
    }
}

/// The waypoint of an item, for 14000; a place of the landing has no number.
fn number_of(compiled: &CompiledMission, item: usize) -> Option<u16> {
    let number = compiled.waypoint_of.get(item).copied();
    number.filter(|number| *number != 0)
}

/// The item, as an index, that a complaint names: PX4 v1.18 counts the items of its mission from 1, and calls them waypoints
/// (mission_feasibility_checker.cpp, FeasibilityChecker.cpp).
fn item_named(complaint: &str) -> Option<usize> {
    let before = [
        "violation for waypoint ",
        "home pos, WP ",
        "rejected: item ",
    ];
    let mut named = before
        .iter()
        .filter_map(|before| complaint.split_once(*before));
    let (_, number) = named.next()?;
    let number = number.split(|c: char| !c.is_ascii_digit()).next()?;
    number.parse::<usize>().ok()?.checked_sub(1)
}

/// Whether PX4 v1.18 complains of the mission itself.
fn is_of_judgement(complaint: &str) -> bool {
    let texts = ["Mission rejected", "feasib", "Geofence violation"];
    texts.iter().any(|text| complaint.contains(text))
}

fn is_of_upload(fault: &Fault) -> bool {
    matches!(
        fault,
        Fault::Service {
            operation: Operation::Upload,
            ..
        }
    )
}

fn refused(waypoint: Option<u16>, why: String, touched: bool) -> Outcome {
    Outcome::Refused {
        waypoint,
        why,
        touched,
        flaw: false,
    }
}

const NO_HOME: &str = "the vehicle has not reported its home position";
const KIND: MavMissionType = MavMissionType::MAV_MISSION_TYPE_MISSION;
/// PX4 reports its home some seconds after its start, every 2 s.
const SITE_WITHIN: Duration = Duration::from_secs(10);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_complaint_names_an_item_by_its_place_in_the_mission() {
        for (complaint, item) in [
            (" (Geofence violation for waypoint 6)", Some(5)),
            (
                " (Mission rejected: No home pos, WP 2 uses rel alt)",
                Some(1),
            ),
            (" (Mission rejected: item 3: unsupported cmd: 93)", Some(2)),
            (" (Geofence violation for waypoint 0)", None),
            (" (Geofence violation for waypoint)", None),
            (
                " (Distance between waypoint and gate too close: 4 meters)",
                None,
            ),
            ("", None),
        ] {
            assert_eq!(item_named(complaint), item, "{complaint}");
        }
    }
}
