//! A mode command (2016) while it is carried out: steps, each confirmed by what the vehicle shows.
//!
//! An accepted COMMAND_ACK proves nothing: PX4 accepts modes that it does not enter. A maneuver is done when messages of
//! the vehicle, made after the command was sent, show it. Otherwise it is refused with the vehicle's reason.
//!
//! A transition or a whole climb may lie between two steps. If the vehicle meanwhile leaves the mode that the maneuver
//! found or led to, a pilot or a failsafe has taken it, and the maneuver commands nothing more.

mod confirmation;
mod refusal;
mod step;

pub(crate) use confirmation::{Away, Climb, Confirmation};
pub(crate) use refusal::Refusal;
pub(crate) use step::{
    Step, arm, change_altitude, change_speed, climbed, course, disarm, enter, figure_eight,
    go_around, launch, launch_vtol, launch_wing, mode_after, orbit, reposition, set_mode,
    shows_speed, stop, transition,
};

use std::collections::VecDeque;
use std::time::Duration;

use mapping::mode::Px4Mode;
use mapping::report::Commanded;
use mavlink_link::dialect::{MavCmd, MavResult};
use mavlink_link::service::command::{self, Command, Outcome, Ticket};
use mavlink_link::service::mission;

use self::refusal::Answered;
use self::step::Again;
use super::link::services::Services;
use super::link::state::VehicleState;
use super::other::Other;

/// The progress of a maneuver.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Progress {
    Going,
    Done,
    Refused(Refusal),
}

/// The machine.
#[derive(Debug)]
pub(crate) struct Maneuver {
    steps: VecDeque<Step>,
    waiting: Waiting,
    basis: Basis,
    /// What 3002 reports as commanded once the maneuver is done.
    pub(crate) commanded: Commanded,
    /// Sent when the maneuver fails: a launch that fails leaves no running motors.
    undo: Option<Command>,
    ends_sticks: bool,
    stays: bool,
    armed_by_us: bool,
    /// The command that had no answer although the vehicle may show its effect; its name and attempts.
    unanswered: Option<(&'static str, u8)>,
    /// When the command in front, or the last one, was first sent.
    commanded_at: Option<Duration>,
    /// When the vehicle has accepted it.
    answered_at: Option<Duration>,
}

/// The mode in which the next command of a maneuver is sent.
#[derive(Debug, Clone, Copy)]
enum Basis {
    /// The vehicle has not shown it yet.
    Unknown,
    /// The vehicle was in this one when the maneuver began.
    Found(Px4Mode),
    /// Another one is commanded and not confirmed yet.
    Entering,
    /// The maneuver has led to one of these.
    Entered(&'static [Px4Mode]),
    /// Somebody else has put the vehicle in this one.
    Lost(Px4Mode),
}

impl Basis {
    /// The basis after the vehicle has reported this mode.
    fn after(self, mode: Px4Mode) -> Basis {
        let stays = match &self {
            Basis::Unknown => return Basis::Found(mode),
            // While a mode is being entered, reports still show the earlier one. A vehicle that somebody has taken stays
            // theirs.
            Basis::Entering | Basis::Lost(_) => return self,
            Basis::Found(before) => is_from(std::slice::from_ref(before), mode),
            Basis::Entered(modes) => is_from(modes, mode),
        };
        if stays { self } else { Basis::Lost(mode) }
    }
}

/// Whether PX4 itself leads from one of these modes to `mode`: it ends a take-off and a mission in a hold.
fn is_from(modes: &[Px4Mode], mode: Px4Mode) -> bool {
    const END_IN_A_HOLD: [Px4Mode; 3] = [Px4Mode::TAKEOFF, Px4Mode::VTOL_TAKEOFF, Px4Mode::MISSION];
    let ends = |one: &Px4Mode| END_IN_A_HOLD.contains(one);
    modes.contains(&mode) || (mode == Px4Mode::LOITER && modes.iter().any(ends))
}

#[derive(Debug)]
enum Waiting {
    /// The next step has not begun.
    Nothing,
    Answer {
        ticket: Ticket,
        patient_until: Duration,
    },
    Again {
        at: Duration,
        patient_until: Duration,
    },
    Current,
    Pause {
        until: Duration,
    },
    Confirmation {
        deadline: Duration,
    },
    /// Too long ago to be continued.
    Lapsed,
}

impl Maneuver {
    pub(crate) fn new(steps: impl IntoIterator<Item = Step>, commanded: Commanded) -> Maneuver {
        Maneuver {
            steps: steps.into_iter().collect(),
            waiting: Waiting::Nothing,
            basis: Basis::Unknown,
            commanded,
            undo: None,
            ends_sticks: false,
            stays: false,
            armed_by_us: false,
            unanswered: None,
            commanded_at: None,
            answered_at: None,
        }
    }

    /// Whether it still has to enter a mode, or to leave the ground.
    pub(crate) fn enters_a_mode(&self) -> bool {
        let mut left = self.steps.iter();
        left.any(|step| {
            matches!(
                step,
                Step::Confirm {
                    confirmation: Confirmation::Mode(_) | Confirmation::OffTheGround,
                    ..
                }
            )
        })
    }

    /// Whether it still has to enter this mode.
    pub(crate) fn enters(&self, mode: Px4Mode) -> bool {
        self.modes().any(|one| one == mode)
    }

    /// The mission item that it still has to send the vehicle to.
    pub(crate) fn sends_to(&self) -> Option<u16> {
        let mut left = self.steps.iter();
        left.find_map(|step| match step {
            Step::SetCurrent(items) => Some(*items.start()),
            _ => None,
        })
    }

    /// The modes that it still has to enter; where one of several will do, all of them.
    pub(crate) fn modes(&self) -> impl Iterator<Item = Px4Mode> {
        self.steps.iter().filter_map(Step::modes).flatten().copied()
    }

    /// The last mode that it still has to enter.
    pub(crate) fn last_mode(&self) -> Option<Px4Mode> {
        let mut left = self.steps.iter().rev();
        left.find_map(|step| step.modes()?.first().copied())
    }

    /// Whether it takes a vehicle in AUTO.MISSION away from the item that it flies: to another one, or out of the mode.
    pub(crate) fn leaves_its_item(&self) -> bool {
        let other = |mode| mode != Px4Mode::MISSION;
        self.sends_to().is_some() || self.last_mode().is_some_and(other)
    }

    /// Whether it still has to have PX4 climb out of a landing.
    pub(crate) fn goes_around(&self) -> bool {
        let mut left = self.steps.iter();
        left.any(|step| match step {
            Step::Command { command, .. } => command.command == MavCmd::MAV_CMD_DO_GO_AROUND,
            _ => false,
        })
    }

    /// Whether it still has to transition a VTOL, to its wings or to a hover.
    pub(crate) fn turns(&self) -> bool {
        self.awaits(|confirmation| matches!(confirmation, Confirmation::Hovers(_)))
    }

    /// Whether it still has to stop the motors.
    pub(crate) fn disarms(&self) -> bool {
        self.awaits(|confirmation| *confirmation == Confirmation::Disarmed)
    }

    fn awaits(&self, so: impl Fn(&Confirmation) -> bool) -> bool {
        let mut left = self.steps.iter();
        left.any(|step| matches!(step, Step::Confirm { confirmation, .. } if so(confirmation)))
    }

    /// For a vehicle that has been flown by sticks, and takes them for lost so long after the command to another mode: then that is
    /// commanded once more.
    pub(crate) fn ending_sticks(mut self, lost_within: Duration) -> Maneuver {
        let mut places = 0..self.steps.len();
        let place = places.find(|place| {
            let confirmed = self.steps.get(place + 1);
            matches!(self.steps.get(*place), Some(Step::Command { .. }))
                && confirmed.is_some_and(Step::confirms_a_mode)
        });
        if let Some(place) = place
            && let Some(Step::Command { command, what, .. }) = self.steps.get(place)
            && let Some(confirmation) = self.steps.get(place + 1).and_then(Step::confirmation)
        {
            let insist = Step::Insist {
                confirmation: confirmation.clone(),
                command: *command,
                what,
                after: lost_within,
                again: Again::AfterSticks,
            };
            // It insists in this way then.
            if matches!(self.steps.get(place + 1), Some(Step::Insist { .. })) {
                self.steps.remove(place + 1);
            }
            self.steps.insert(place + 1, insist);
            self.ends_sticks = true;
        }
        self
    }

    /// The same for a vehicle that flies the mode already, and has not entered that of the sticks: nothing is commanded before it misses
    /// them.
    pub(crate) fn staying(self, lost_within: Duration) -> Maneuver {
        let mut maneuver = self.ending_sticks(lost_within);
        maneuver.steps.pop_front();
        // Its failsafe for lost sticks leaves the mode.
        maneuver.basis = Basis::Entering;
        maneuver.stays = true;
        maneuver
    }

    /// Whether it is one of these, for which nobody waits.
    pub(crate) fn stays(&self) -> bool {
        self.stays
    }

    /// Whether it was made to end a flight by sticks.
    pub(crate) fn ends_sticks(&self) -> bool {
        self.ends_sticks
    }

    /// Whether the vehicle is about to enter another mode than this, by a command that was sent, or is sent next.
    pub(crate) fn is_leaving(&self, mode: Px4Mode) -> bool {
        let is_next = matches!(self.steps.front(), Some(Step::Command { .. }))
            && self.steps.get(1).is_some_and(Step::confirms_a_mode);
        (is_next || matches!(self.basis, Basis::Entering)) && !self.enters(mode)
    }

    /// The command that is sent if the maneuver fails after its arming step.
    pub(crate) fn undone_by(mut self, command: Command) -> Maneuver {
        self.undo = Some(command);
        self
    }

    /// A command has ended: of this maneuver, or another one.
    pub(crate) fn handle_command(
        &mut self,
        now: Duration,
        event: &command::Event,
        vehicle: &VehicleState,
    ) -> Progress {
        let command::Event::Done {
            ticket, outcome, ..
        } = event
        else {
            return Progress::Going;
        };
        let Waiting::Answer {
            ticket: ours,
            patient_until,
        } = self.waiting
        else {
            return Progress::Going;
        };
        if *ticket != ours {
            return Progress::Going;
        }
        let Some(Step::Command { what, command, .. }) = self.steps.front() else {
            return Progress::Going;
        };
        match *outcome {
            Outcome::Answered {
                result: MavResult::MAV_RESULT_ACCEPTED,
                ..
            } => {
                // Noted before the state confirms it: a launch that fails in between must be undone too.
                self.armed_by_us |= command.command == MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;
                self.answered_at = Some(now);
                self.next();
                Progress::Going
            }
            // PX4 rejects arming like this for some seconds after its start, and a mode whose stream it has not seen yet:
            // the same command is accepted a little later.
            Outcome::Answered {
                result: MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
                ..
            } if now < patient_until => {
                self.waiting = Waiting::Again {
                    at: now + PAUSE,
                    patient_until,
                };
                Progress::Going
            }
            Outcome::Answered { result, .. } => {
                let why = format!("{what}: the vehicle answered: {}", name(result));
                let answered = Answered {
                    sent: self.commanded_at.unwrap_or(now),
                    at: now,
                };
                // Of a command that it does not know PX4 says no more.
                let explains = result != MavResult::MAV_RESULT_UNSUPPORTED;
                Progress::Refused(Refusal::by_vehicle(why, explains.then_some(answered)))
            }
            // If the link loses every COMMAND_ACK, the command may have been carried out all the same, and an operator who
            // reads that it was refused would be misled. What the vehicle has shown since decides.
            Outcome::NoAnswer { tries } if self.shows_the_command(vehicle) => {
                self.armed_by_us |= command.command == MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;
                self.unanswered = Some((what, tries));
                self.next();
                Progress::Going
            }
            Outcome::NoAnswer { tries } => {
                refused(format!("{}: {MAY_BE_DONE}", no_answer(what, tries)))
            }
            Outcome::Withdrawn => refused(format!("{what}: withdrawn")),
        }
    }

    /// The end of a mission operation.
    pub(crate) fn handle_mission(
        &mut self,
        now: Duration,
        event: &mission::Event,
        vehicle: &VehicleState,
    ) -> Progress {
        let (Waiting::Current, Some(Step::SetCurrent(items))) = (&self.waiting, self.steps.front())
        else {
            return Progress::Going;
        };
        match event {
            mission::Event::CurrentSet { seq } if seq == items.start() => {
                self.next();
                Progress::Going
            }
            // PX4 rejects MISSION_SET_CURRENT only by a STATUSTEXT ("WPM: WP CURR CMD: Not in list"), so this is mostly a
            // timeout.
            mission::Event::Failed {
                operation: mission::Operation::SetCurrent,
                ..
            } => refused(format!(
                "the vehicle does not show that it goes to mission item {}{}{}",
                items.end(),
                self.complaint(now, vehicle),
                unknown(vehicle)
            )),
            _ => Progress::Going,
        }
    }

    /// Begins the steps that can begin, and checks what is awaited.
    pub(crate) fn advance(
        &mut self,
        now: Duration,
        vehicle: &VehicleState,
        services: &mut Services,
    ) -> Progress {
        // Only by a report newer than the last command: an older one may show the mode that this maneuver has just left.
        if let Some(mode) = vehicle.settled_mode() {
            self.basis = self.basis.after(mode);
        }
        loop {
            let Some(step) = self.steps.front() else {
                return Progress::Done;
            };
            if let (Basis::Lost(mode), true) = (self.basis, self.commands_more()) {
                // The motors must not stop under a pilot who has taken the vehicle over on the ground.
                self.undo = None;
                return refused(format!(
                    "the vehicle is in {} now, by its pilot or a failsafe",
                    mode.name()
                ));
            }
            match (&self.waiting, step) {
                (
                    Waiting::Nothing,
                    Step::Command {
                        command,
                        what,
                        patience,
                    },
                ) => {
                    let patient_until = now + *patience;
                    (self.commanded_at, self.answered_at) = (Some(now), None);
                    // The steps since the unanswered command have been confirmed, so it no longer explains a failure.
                    self.unanswered = None;
                    // The vehicle may leave its present mode from here on, and that is not a pilot's doing.
                    let enters = self.steps.get(1).is_some_and(Step::confirms_a_mode);
                    match submit(services, now, *command, what, patient_until) {
                        Ok(waiting) => self.waiting = waiting,
                        Err(refused) => return refused,
                    }
                    if enters {
                        self.basis = Basis::Entering;
                    }
                }
                (Waiting::Again { at, patient_until }, Step::Command { command, what, .. })
                    if *at <= now =>
                {
                    let patient_until = *patient_until;
                    match submit(services, now, *command, what, patient_until) {
                        Ok(waiting) => self.waiting = waiting,
                        Err(refused) => return refused,
                    }
                }
                (Waiting::Nothing, Step::SetCurrent(items)) => {
                    (self.commanded_at, self.answered_at) = (Some(now), None);
                    match services.missions.set_current(now, items.clone()) {
                        Ok(()) => self.waiting = Waiting::Current,
                        Err(busy) => {
                            return refused(format!("the mission service is {busy}"));
                        }
                    }
                }
                (Waiting::Nothing, Step::Pause(span)) => {
                    self.waiting = Waiting::Pause { until: now + *span };
                }
                (Waiting::Pause { until }, Step::Pause(_)) if *until <= now => self.next(),
                (
                    Waiting::Nothing,
                    Step::Insist { after: within, .. } | Step::Confirm { within, .. },
                ) => {
                    self.waiting = Waiting::Confirmation {
                        deadline: now + *within,
                    };
                }
                (
                    Waiting::Confirmation { deadline },
                    Step::Insist {
                        confirmation,
                        command,
                        what,
                        again,
                        ..
                    },
                ) => {
                    if *again == Again::WhereItHolds && confirmation.is_seen(vehicle) {
                        self.confirmed();
                    } else if *deadline > now {
                        return Progress::Going;
                    } else {
                        let repeats = match again {
                            // Any other mode may be a pilot's or a failsafe's: it is not contested.
                            Again::WhereItHolds => vehicle.settled_mode() == Some(Px4Mode::LOITER),
                            Again::AfterSticks => {
                                confirmation.is_seen(vehicle) || !is_with_another(vehicle)
                            }
                        };
                        let command = Step::Command {
                            command: *command,
                            what,
                            patience: Duration::ZERO,
                        };
                        self.next();
                        if repeats {
                            self.steps.push_front(command);
                        }
                    }
                }
                (Waiting::Confirmation { deadline }, Step::Confirm { confirmation, .. }) => {
                    if confirmation.is_seen(vehicle) {
                        self.confirmed();
                    } else if *deadline <= now {
                        let why = self.complaint(now, vehicle);
                        let unanswered =
                            self.unanswered.map(|(what, tries)| no_answer(what, tries));
                        let unanswered = unanswered.map(|text| format!("{text}, and "));
                        return refused(format!(
                            "{}the vehicle does not show {}{why}{}",
                            unanswered.unwrap_or_default(),
                            confirmation.awaited(vehicle),
                            unknown(vehicle)
                        ));
                    } else {
                        return Progress::Going;
                    }
                }
                (Waiting::Lapsed, _) => return refused(LAPSED.to_owned()),
                _ => return Progress::Going,
            }
        }
    }

    /// The bridge did not run for so long: what the vehicle has shown meanwhile is not read yet.
    pub(crate) fn postpone(&mut self, stopped: Duration) {
        match &mut self.waiting {
            Waiting::Answer { patient_until, .. } | Waiting::Again { patient_until, .. } => {
                *patient_until += stopped;
            }
            Waiting::Confirmation { deadline } => *deadline += stopped,
            Waiting::Nothing | Waiting::Current | Waiting::Pause { .. } | Waiting::Lapsed => {}
        }
    }

    /// The bridge did not run for too long: the next [`Maneuver::advance`] refuses it, whatever the vehicle has answered and shown.
    pub(crate) fn lapse(&mut self, now: Duration, services: &mut Services) {
        self.withdraw(now, services);
        self.waiting = Waiting::Lapsed;
    }

    /// When [`Maneuver::advance`] is next needed.
    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        match self.waiting {
            Waiting::Again { at, .. } => Some(at),
            Waiting::Pause { until } => Some(until),
            Waiting::Confirmation { deadline } => Some(deadline),
            Waiting::Nothing | Waiting::Lapsed => Some(Duration::ZERO),
            // The services report the end of these, timeouts included, by an event.
            Waiting::Answer { .. } | Waiting::Current => None,
        }
    }

    /// Ends it early: withdraws what waits, and undoes what must not stay.
    pub(crate) fn abandon(
        &mut self,
        now: Duration,
        vehicle: &VehicleState,
        services: &mut Services,
    ) {
        self.withdraw(now, services);
        // In the air nothing is undone: motors must not stop there, and PX4 refuses to disarm.
        let on_ground = vehicle.telemetry.stands();
        if let (true, true, Some(undo)) = (self.armed_by_us, on_ground, self.undo) {
            // A full queue means that the vehicle does not answer; PX4 disarms by itself on the ground (COM_DISARM_PRFLT).
            let _ = services.commands.submit(now, undo);
        }
    }

    fn withdraw(&self, now: Duration, services: &mut Services) {
        match self.waiting {
            // Unanswered commands are repeated for seconds: PX4 could receive this one after that of a later maneuver.
            Waiting::Answer { ticket, .. } => services.commands.withdraw(now, ticket),
            Waiting::Current => services.missions.cancel(),
            _ => {}
        }
    }

    /// Whether the vehicle shows what the step after the command in front waits for, and the steps up to the next command
    /// prove it. The mode of a circle or an eight proves nothing: the vehicle may have been in it before.
    fn shows_the_command(&self, vehicle: &VehicleState) -> bool {
        let Some(Step::Command { command, .. }) = self.steps.front() else {
            return false;
        };
        let behind = || self.steps.iter().skip(1).map_while(Step::confirmation);
        let proves = |confirmation: &Confirmation| match confirmation {
            Confirmation::Mode(_) => command.command == MavCmd::MAV_CMD_DO_SET_MODE,
            Confirmation::Armed
            | Confirmation::Disarmed
            | Confirmation::OffTheGround
            | Confirmation::Orbit { .. }
            | Confirmation::Hovers(_)
            | Confirmation::Stays { .. } => true,
            // On wings another circle or eight may have been flown at the same place.
            Confirmation::Target { .. } => !matches!(
                command.command,
                MavCmd::MAV_CMD_DO_ORBIT | MavCmd::MAV_CMD_DO_FIGURE_EIGHT
            ),
            // Their tolerance is wide, so the vehicle may have shown them before the command.
            Confirmation::Speed(_) | Confirmation::Course(_) => false,
        };
        behind().any(proves) && behind().next().is_some_and(|first| first.is_seen(vehicle))
    }

    /// Whether a step that commands something has not begun yet.
    fn commands_more(&self) -> bool {
        let begun = usize::from(!matches!(
            self.waiting,
            Waiting::Nothing | Waiting::Again { .. }
        ));
        let mut left = self.steps.iter().skip(begun);
        left.any(|step| matches!(step, Step::Command { .. } | Step::SetCurrent(_)))
    }

    /// The step in front is confirmed; a confirmed mode is the new basis.
    fn confirmed(&mut self) {
        if let Some(Step::Insist { confirmation, .. } | Step::Confirm { confirmation, .. }) =
            self.steps.front()
            && let Confirmation::Mode(modes) = confirmation
        {
            self.basis = Basis::Entered(modes);
        }
        self.next();
    }

    /// What the vehicle has complained about since the command, to be appended to a refusal: PX4 sends its reason at once, and
    /// what is awaited may be given up only seconds later.
    fn complaint(&self, now: Duration, vehicle: &VehicleState) -> String {
        let sent = self.commanded_at.unwrap_or(now);
        let answered = self.answered_at.unwrap_or(sent);
        vehicle.complaint(sent, answered).unwrap_or_default()
    }

    fn next(&mut self) {
        self.steps.pop_front();
        self.waiting = Waiting::Nothing;
    }
}

/// Sends a command. If it is rejected for now, it is retried until `patient_until`.
fn submit(
    services: &mut Services,
    now: Duration,
    command: Command,
    what: &str,
    patient_until: Duration,
) -> Result<Waiting, Progress> {
    match services.commands.submit(now, command) {
        Ok(ticket) => Ok(Waiting::Answer {
            ticket,
            patient_until,
        }),
        Err(full) => Err(refused(format!("{what}: {full}"))),
    }
}

/// Whether a vehicle that is in another mode than was commanded last was put there by a pilot or another station: not by a failsafe.
fn is_with_another(vehicle: &VehicleState) -> bool {
    vehicle.settled_mode().is_some()
        && !matches!(Other::of(&vehicle.telemetry), Some(Other::Failsafe(_)))
}

fn refused(why: String) -> Progress {
    Progress::Refused(why.into())
}

fn no_answer(what: &str, tries: u8) -> String {
    format!("{what}: no answer from the vehicle after {tries} attempts")
}

/// Appended to a refusal because the vehicle shows nothing: a silent vehicle may have done it.
fn unknown(vehicle: &VehicleState) -> String {
    if vehicle.live() {
        return String::new();
    }
    format!("; no data from the vehicle: {MAY_BE_DONE}")
}

fn name(result: MavResult) -> &'static str {
    match result {
        MavResult::MAV_RESULT_ACCEPTED => "accepted",
        MavResult::MAV_RESULT_TEMPORARILY_REJECTED => "temporarily rejected",
        MavResult::MAV_RESULT_DENIED => "denied",
        MavResult::MAV_RESULT_UNSUPPORTED => "unsupported",
        MavResult::MAV_RESULT_FAILED => "failed",
        MavResult::MAV_RESULT_IN_PROGRESS => "in progress",
        MavResult::MAV_RESULT_CANCELLED => "cancelled",
        MavResult::MAV_RESULT_NOT_IN_CONTROL => "this VSM has no operator control",
        _ => "no",
    }
}

/// Where nothing shows whether the vehicle has done what was commanded. Nothing is reported about it later: whether this
/// command or somebody else's led to what the vehicle then shows is not known.
pub(crate) const MAY_BE_DONE: &str =
    "it may have been carried out all the same, check the vehicle's state";
/// Where the bridge did not run for too long.
pub(crate) const LAPSED: &str = "the VSM did not run for over a minute and continues nothing of before: check the vehicle's state, and \
                                 command again";
/// Time between two attempts after a temporary rejection.
const PAUSE: Duration = Duration::from_millis(400);

#[cfg(test)]
mod tests {
    use mapping::telemetry::LandedState;
    use mavlink_link::dialect::MavMessage;

    use super::*;
    use crate::session::testing::World;

    fn advance(maneuver: &mut Maneuver, world: &mut World) -> Progress {
        maneuver.advance(world.now.mono, &world.vehicle, &mut world.services)
    }

    /// PX4 accepts a place outside its fence, says so at once, and does not fly there.
    #[test]
    fn a_refusal_long_after_the_command_has_the_reason_that_the_vehicle_gave_at_once() {
        for (after_command, live) in [(true, true), (false, true), (false, false)] {
            let mut world = World::airborne(Px4Mode::LOITER);
            let mut maneuver = Maneuver::new(change_altitude(500.0), Commanded::default());
            let complain = |world: &mut World| {
                let now = world.now.mono;
                world
                    .vehicle
                    .complain(now, "Reposition is outside geofence");
            };
            if !after_command {
                complain(&mut world);
                world.advance(Duration::from_secs(4));
            }
            assert_eq!(advance(&mut maneuver, &mut world), Progress::Going);
            world.commanded_modes();
            let command = MavCmd::MAV_CMD_DO_CHANGE_ALTITUDE;
            let accepted = world.answer(command, MavResult::MAV_RESULT_ACCEPTED);
            assert_eq!(accepted.len(), 1);
            for event in accepted {
                let now = world.now.mono;
                maneuver.handle_command(now, &event, &world.vehicle);
            }
            if after_command {
                complain(&mut world);
            }
            if !live {
                world.vehicle.set_silent();
            }
            assert_eq!(advance(&mut maneuver, &mut world), Progress::Going);
            world.advance(Duration::from_secs(60));
            if after_command {
                let now = world.now.mono;
                world.vehicle.complain(now, "Low battery");
            }
            let Progress::Refused(refusal) = advance(&mut maneuver, &mut world) else {
                panic!("it is not shown");
            };
            let why = refusal.text(&world.vehicle);
            assert_eq!(why.contains("outside geofence"), after_command, "{why}");
            // A vehicle that is not received may fly it.
            assert_eq!(why.contains(MAY_BE_DONE), !live, "{why}");
        }
    }

    /// A process that was stopped reads afterwards what the vehicle has shown meanwhile.
    #[test]
    fn what_a_vehicle_shows_while_the_bridge_does_not_run_is_waited_for() {
        for noted in [true, false] {
            let mut world = World::airborne(Px4Mode::LOITER);
            let mut maneuver = Maneuver::new(change_altitude(500.0), Commanded::default());
            assert_eq!(advance(&mut maneuver, &mut world), Progress::Going);
            world.commanded_modes();
            let command = MavCmd::MAV_CMD_DO_CHANGE_ALTITUDE;
            for event in world.answer(command, MavResult::MAV_RESULT_ACCEPTED) {
                maneuver.handle_command(world.now.mono, &event, &world.vehicle);
            }
            assert_eq!(advance(&mut maneuver, &mut world), Progress::Going);
            let stopped = Duration::from_secs(60);
            world.advance(stopped);
            if noted {
                maneuver.postpone(stopped);
            }
            let waits = advance(&mut maneuver, &mut world) == Progress::Going;
            assert_eq!(waits, noted);
        }
    }

    /// The oldest of what waited in a socket shows what the launch waited for, minutes ago.
    #[test]
    fn a_launch_continues_after_a_short_stop_and_is_undone_after_a_long_one() {
        for lapsed in [false, true] {
            let mut world = World::new();
            world.vehicle.telemetry.landed = Some(LandedState::OnGround);
            let enters = |step: &Step| !matches!(step, Step::Command { what: "arming", .. });
            let steps = launch(420.0).into_iter().skip_while(enters);
            let mut maneuver = Maneuver::new(steps, Commanded::default()).undone_by(arm(false));
            assert_eq!(advance(&mut maneuver, &mut world), Progress::Going);
            world.commanded_modes();
            let arming = MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;
            for event in world.answer(arming, MavResult::MAV_RESULT_ACCEPTED) {
                maneuver.handle_command(world.now.mono, &event, &world.vehicle);
            }
            assert_eq!(advance(&mut maneuver, &mut world), Progress::Going);
            let stopped = Duration::from_secs(if lapsed { 600 } else { 60 });
            world.advance(stopped);
            let now = world.now.mono;
            if lapsed {
                maneuver.lapse(now, &mut world.services);
            } else {
                maneuver.postpone(stopped);
            }
            assert!(maneuver.poll_timeout().is_some());
            world.vehicle.telemetry.armed = Some(true);
            let expected = if lapsed {
                Progress::Refused(LAPSED.to_owned().into())
            } else {
                Progress::Going
            };
            assert_eq!(advance(&mut maneuver, &mut world), expected);
            if lapsed {
                maneuver.abandon(now, &world.vehicle, &mut world.services);
            }
            let sent: Vec<_> = std::iter::from_fn(|| world.services.commands.poll_transmit())
                .filter_map(|message| match message {
                    MavMessage::COMMAND_LONG(command) => Some((command.command, command.param1)),
                    _ => None,
                })
                .collect();
            let expected = if lapsed {
                arming
            } else {
                MavCmd::MAV_CMD_NAV_TAKEOFF
            };
            assert_eq!(sent, [(expected, 0.0)]);
        }
    }

    /// An answer that was not read before a long stop belongs to nothing any more.
    #[test]
    fn a_command_without_an_answer_before_a_long_stop_is_not_repeated_after_it() {
        let mut world = World::airborne(Px4Mode::LOITER);
        let mut maneuver = Maneuver::new(change_altitude(500.0), Commanded::default());
        assert_eq!(advance(&mut maneuver, &mut world), Progress::Going);
        world.commanded_modes();
        world.advance(Duration::from_secs(600));
        let now = world.now.mono;
        maneuver.lapse(now, &mut world.services);
        world.services.commands.handle_timeout(now);
        assert!(world.services.commands.poll_transmit().is_none());
        while let Some(event) = world.services.commands.poll_event() {
            let progress = maneuver.handle_command(now, &event, &world.vehicle);
            assert_eq!(progress, Progress::Going);
        }
        let refused = Progress::Refused(LAPSED.to_owned().into());
        assert_eq!(advance(&mut maneuver, &mut world), refused);
    }

    #[test]
    fn a_command_that_the_vehicle_does_not_know_waits_for_no_reason() {
        let mut world = World::airborne(Px4Mode::LOITER);
        let mut maneuver = Maneuver::new(change_altitude(500.0), Commanded::default());
        assert_eq!(advance(&mut maneuver, &mut world), Progress::Going);
        let now = world.now.mono;
        world.vehicle.complain(now, "Low battery");
        let command = MavCmd::MAV_CMD_DO_CHANGE_ALTITUDE;
        let events = world.answer(command, MavResult::MAV_RESULT_UNSUPPORTED);
        let [event] = events.as_slice() else {
            panic!("one answer, not {events:?}");
        };
        let progress = maneuver.handle_command(now, event, &world.vehicle);
        let Progress::Refused(refusal) = progress else {
            panic!("it is unsupported, not {progress:?}");
        };
        assert!(refusal.is_by_vehicle() && !refusal.awaits_reason(now, &world.vehicle));
        assert_eq!(refusal.poll_timeout(), None);
        let text = refusal.text(&world.vehicle);
        assert!(text.ends_with("unsupported"), "{text}");
    }

    /// As PX4 v1.17 and v1.18 do: the COMMAND_ACK, and the STATUSTEXT at once, or once 130 ms later. A warning of before the command is
    /// none of its reasons.
    #[test]
    fn a_refusal_waits_for_the_reason_that_comes_behind_the_answer() {
        for reason_after_ms in [Some(0), Some(130), None] {
            let mut world = World::airborne(Px4Mode::LOITER);
            let mut maneuver = Maneuver::new(change_altitude(500.0), Commanded::default());
            let now = world.now.mono;
            world.vehicle.complain(now, "High wind");
            world.advance(Duration::from_millis(10));
            assert_eq!(advance(&mut maneuver, &mut world), Progress::Going);
            world.commanded_modes();
            let command = MavCmd::MAV_CMD_DO_CHANGE_ALTITUDE;
            let denied = world.answer(command, MavResult::MAV_RESULT_DENIED);
            let [event] = denied.as_slice() else {
                panic!("one answer, not {denied:?}");
            };
            let now = world.now.mono;
            let progress = maneuver.handle_command(now, event, &world.vehicle);
            let Progress::Refused(refusal) = progress else {
                panic!("it is denied, not {progress:?}");
            };
            assert!(refusal.is_by_vehicle() && refusal.awaits_reason(now, &world.vehicle));
            let until = refusal.poll_timeout().expect("a while");
            if let Some(ms) = reason_after_ms {
                let at = now + Duration::from_millis(ms);
                assert!(refusal.awaits_reason(at, &world.vehicle));
                world.vehicle.complain(at, "No altitude");
                assert!(!refusal.awaits_reason(at, &world.vehicle));
                world.vehicle.complain(until, "Low battery");
            }
            assert!(!refusal.awaits_reason(until, &world.vehicle));
            let reason = reason_after_ms.map_or("", |_| " (No altitude)");
            let text = refusal.text(&world.vehicle);
            assert!(text.ends_with(&format!("denied{reason}")), "{text}");
        }
    }
}
