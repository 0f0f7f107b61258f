//! Payload stations: commands of a CUCS with LOI 3 to a station's gimbal and camera (19001, 19100).
//!
//! A command becomes steps ([`judge`], pure), each sent to the gimbal manager or the camera and completed when that reports
//! the result ([`step`]); then the command is acknowledged as carried out. LOI 3 is held per station: a command for a
//! station that its sender does not hold is refused. [`discovery`] requests the capabilities and state of the devices.
//!
//! Several commands of one station run in parallel, since zooming need not wait for turning. A newer command to turn, zoom
//! or focus replaces an older one in progress: an operator who moves a stick sends many.
//!
//! PX4 stops a gimbal 2 s after its rates were set, so they are set again each second. To look at a place, the gimbal's
//! direction is sent repeatedly. Both end, and a zoom stops, once the commanding CUCS no longer holds the station.
//!
//! No pointing mode is reported once the gimbal's manager shows another in control: PX4's own navigator takes a gimbal for a
//! mission, and to centre it.

mod discovery;
mod judge;
mod step;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use mapping::altitude::{Altimeter, Datum};
use mapping::payload::report::{self, Ground, Station};
use mapping::payload::{Equipment, StreamInformation};
use mapping::telemetry::Telemetry;
use mavlink_link::dialect::MavResult;
use mavlink_link::service::command::{Event, Outcome, Ticket};
use stanag_msgs::enums::{AckType, EoirPointingMode, StationBitmap1To16};
use stanag_msgs::{Id, Message};

use self::discovery::Discovery;
use self::judge::{Judged, Situation};
use self::step::{Before, Drive, Focus, Motion, Order, Slew, Step, Zoom, request};
use super::authority::rules::{Authority, Stations};
use super::context::{self, Bounds, Origin};
use super::effects::Effects;
use super::maneuver::MAY_BE_DONE;
use crate::config::Provisional;

/// The machine.
#[derive(Debug, Default)]
pub(crate) struct Payload {
    states: BTreeMap<u8, State>,
    tasks: Vec<Task>,
    discovery: Discovery,
    /// The stations last sent to listeners.
    announced: Vec<Equipment>,
    /// The same for the video streams, by station and stream number.
    announced_streams: BTreeMap<(u8, u8), StreamInformation>,
}

/// The commanded state of one station.
#[derive(Debug)]
struct State {
    /// The pointing mode that was commanded last, and the one that has been shown.
    commanded: EoirPointingMode,
    shown: EoirPointingMode,
    /// The CUCS that last commanded it.
    by: Option<Id>,
    moving: Option<Moving>,
    /// A zoom was commanded, and the camera has not shown its end.
    zooming: bool,
    /// A zoom of the previous holder must be stopped once the camera's queue has room.
    stops_zoom: bool,
    /// The focus was set manually, and the camera has not accepted auto focus since.
    by_hand: bool,
}

impl Default for State {
    fn default() -> State {
        State {
            commanded: EoirPointingMode::NoValue,
            shown: EoirPointingMode::NoValue,
            by: None,
            moving: None,
            zooming: false,
            stops_zoom: false,
            by_hand: false,
        }
    }
}

/// A motion that must be kept alive by repeated messages.
#[derive(Debug, Clone, Copy)]
struct Moving {
    motion: Motion,
    next: Duration,
}

/// A command in progress.
#[derive(Debug)]
struct Task {
    origin: Origin,
    by: Id,
    station: u8,
    mode: Option<EoirPointingMode>,
    /// A newer command has replaced steps of it.
    lost: bool,
    steps: VecDeque<Step>,
    running: Option<Running>,
}

/// The step that was sent.
#[derive(Debug)]
struct Running {
    /// Its command, until it is answered.
    ticket: Option<(u8, Ticket)>,
    /// Only reports after this time confirm it.
    since: Duration,
    until: Duration,
    before: Before,
    ask_at: Duration,
}

/// What it reads.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Context<'a> {
    pub(crate) common: context::Context<'a>,
    pub(crate) rights: &'a Authority,
    pub(crate) altimeter: Altimeter,
}

context::deref_to_common!(Context);

/// An input.
#[derive(Debug)]
pub(crate) enum Input<'a> {
    /// 19001 or 19100 of a CUCS that holds LOI 3 of a station.
    Command {
        origin: Origin,
        message: &'a Message,
    },
    /// A command to this component ended.
    CommandEnded { component: u8, event: &'a Event },
    /// The station has gained or lost LOI 2.
    ListenerChanged { station: usize },
    /// A device has reported something, or time has passed, or rights have changed.
    Poll,
}

/// The state that other machines may read.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PayloadView<'a> {
    states: &'a BTreeMap<u8, State>,
    rights: &'a Authority,
}

impl PayloadView<'_> {
    /// The pointing mode that a station was commanded to and has shown.
    pub(crate) fn mode(&self, station: u8) -> EoirPointingMode {
        let state = self.states.get(&station);
        state.map_or(EoirPointingMode::NoValue, |state| state.shown)
    }

    /// Whether a CUCS holds LOI 3 of a station.
    pub(crate) fn steers(&self, id: Id) -> bool {
        !self.rights.held(id).stations().is_empty()
    }
}

impl Payload {
    /// The state for other machines.
    pub(crate) fn view<'a>(&'a self, rights: &'a Authority) -> PayloadView<'a> {
        PayloadView {
            states: &self.states,
            rights,
        }
    }

    /// Takes an input.
    pub(crate) fn handle(
        &mut self,
        context: &Context<'_>,
        input: Input<'_>,
        effects: &mut Effects<'_>,
    ) {
        self.end_with_holder(context, effects);
        match input {
            Input::Command { origin, message } => self.command(context, origin, message, effects),
            Input::CommandEnded { component, event } => {
                self.command_ended(context, component, event, effects);
            }
            Input::ListenerChanged { station } => {
                if effects.listeners.contains(&station) {
                    let all = context.equipment();
                    announce(context, &[station], &all, effects);
                    for one in &streams(context) {
                        announce_stream(&[station], one, effects);
                    }
                }
                return;
            }
            Input::Poll => {}
        }
        self.advance(context, effects);
        self.keep_moving(context, effects);
        self.discovery.advance(&context.common, effects);
        self.watch_stations(context, effects);
    }

    /// The bridge did not run for so long: what a station has shown meanwhile is not read yet.
    pub(crate) fn postpone(&mut self, stopped: Duration) {
        let running = self.tasks.iter_mut().filter_map(|one| one.running.as_mut());
        running.for_each(|running| running.until += stopped);
    }

    /// When [`Input::Poll`] is next needed.
    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        let tasks = self.tasks.iter().filter_map(|task| {
            let running = task.running.as_ref()?;
            // The command client times out unanswered commands by itself.
            running
                .ticket
                .is_none()
                .then(|| running.until.min(running.ask_at))
        });
        let motions = self
            .states
            .values()
            .filter_map(|state| Some(state.moving?.next));
        tasks
            .chain(motions)
            .chain(self.discovery.poll_timeout())
            .min()
    }

    fn command(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        message: &Message,
        effects: &mut Effects<'_>,
    ) {
        match self.begin(context, origin, message, effects) {
            Ok(Some(task)) => {
                effects.acknowledge(&origin, AckType::Received);
                self.tasks.push(task);
            }
            Ok(None) => effects.acknowledge(&origin, AckType::CarriedOut),
            Err(why) => effects.refuse(Some(origin), why),
        }
    }

    /// Decides a command. `None` if there is nothing to do.
    fn begin(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        message: &Message,
        effects: &mut Effects<'_>,
    ) -> Result<Option<Task>, String> {
        if context.provisional(origin.station) != Provisional::All {
            return Err(format!(
                "{} is derived from Edition 2: it is carried out with dli.provisional = \"all\" only",
                message.id()
            ));
        }
        let by = context.asker(origin.station).map(|asker| asker.id);
        let by = by.ok_or("its sender is not configured")?;
        let named = match message {
            Message::PayloadSteeringCommand(m) => m.station_number_1_16,
            Message::EoIrLaserPayloadCommand(m) => m.station_number_1_16,
            other => return Err(format!("message {} is no payload command", other.id())),
        };
        let equipment = self.station(context, by, named)?;
        if !context.vehicle.live() {
            return Err("no data from the vehicle".to_owned());
        }
        let in_progress = |ends: fn(Step) -> bool| {
            let tasks = self.tasks.iter();
            let of_station = tasks.filter(|task| task.station == equipment.number);
            let mut steps = of_station.flat_map(|task| &task.steps);
            steps.any(|step| ends(*step))
        };
        let state = self.states.entry(equipment.number).or_default();
        let situation = Situation {
            station: Station::of(equipment, &context.vehicle.payloads, context.mono()),
            telemetry: &context.vehicle.telemetry,
            ground: ground(context.bounds, &context.vehicle.telemetry),
            datum: Datum {
                geoid_m: context.vehicle.telemetry.geoid_m,
                agl: context.bounds.agl,
                altimeter: context.altimeter,
                terrain: context.bounds.terrain.as_deref(),
            },
            mode: state.commanded,
            shown: state.shown,
            // A stop in progress is not sent again: a station may send all fields with every 19001. One that failed is.
            zooming: state.zooming && !in_progress(Step::ends_zoom),
            by_hand: state.by_hand && !in_progress(Step::ends_manual_focus),
        };
        let steers = matches!(message, Message::PayloadSteeringCommand(_));
        let Judged { steps, mode, note } = match message {
            Message::PayloadSteeringCommand(m) => judge::steering(m, &situation)?,
            Message::EoIrLaserPayloadCommand(m) => judge::sensor(m, &situation)?,
            _ => Judged::default(),
        };
        let stays = |task: &&Task| {
            let mut steps_of = task.steps.iter();
            task.station == equipment.number && steps_of.any(|step| !is_replaced(step, &steps))
        };
        if !steps.is_empty() && self.tasks.iter().filter(stays).count() >= MAX_TASKS {
            return Err(format!(
                "{MAX_TASKS} commands for payload station {} are in progress, expected fewer",
                equipment.number
            ));
        }
        // Motions of this station end once this CUCS no longer holds it (`end_with_holder`).
        state.by = Some(by);
        for step in &steps {
            // What ends a zoom or a manual focus counts once it is shown (`Task::advance`): it may fail.
            match step {
                Step::Zoom(Zoom::In | Zoom::Out) => state.zooming = true,
                Step::Focus(Focus::Closer | Focus::Farther) => state.by_hand = true,
                _ => {}
            }
            // The stop of an earlier zoom would end the newer one.
            state.stops_zoom &= step.drive() != Some(Drive::Zoom);
        }
        if let Some(mode) = mode {
            state.commanded = mode;
        }
        let turns = (steps.iter()).any(|step| step.drive() == Some(Drive::Gimbal));
        if turns {
            // The earlier motion ends with the new command.
            state.moving = None;
        }
        if steps.is_empty() {
            return Ok(None);
        }
        if let Some(note) = note {
            effects.advise(note);
        }
        let replaced = self.replace(equipment.number, &steps, effects);
        let state = self.states.entry(equipment.number).or_default();
        let mode = match replaced.filter(|mode| *mode == state.commanded) {
            // A 19001 in a mode that the gimbal has not shown yet will confirm that mode in place of the replaced command.
            Some(before) if steers => Some(before),
            Some(_) if mode.is_none() => {
                state.commanded = state.shown;
                None
            }
            // It takes a gimbal back that another had taken from this mode.
            None if steers && turns && state.commanded != state.shown => Some(state.commanded),
            _ => mode,
        };
        Ok(Some(Task {
            origin,
            by,
            station: equipment.number,
            mode,
            lost: false,
            steps: steps.into(),
            running: None,
        }))
    }

    /// The single station that a command names, if its sender holds it and it is present.
    fn station(
        &self,
        context: &Context<'_>,
        by: Id,
        named: Option<StationBitmap1To16>,
    ) -> Result<Equipment, String> {
        let stations = Stations::from_bitmaps(named, None);
        let mut numbers = stations.iter();
        let (Some(number), None) = (numbers.next(), numbers.next()) else {
            return Err(format!(
                "Station Number names {} stations, expected one",
                stations.iter().count()
            ));
        };
        if !context.rights.holds_station(by, number) {
            return Err(format!(
                "it needs LOI 3 (payload) of station {number}; this CUCS holds {}",
                context.rights.held(by).in_words()
            ));
        }
        let all = context.equipment();
        all.into_iter()
            .find(|one| one.number == number)
            .ok_or_else(|| format!("the vehicle has no payload station {number}"))
    }

    /// A newer command replaces the matching steps of older ones. The older commands are refused once their other steps are
    /// completed. Returns the pointing mode that one of them was to confirm.
    fn replace(
        &mut self,
        station: u8,
        steps: &[Step],
        effects: &mut Effects<'_>,
    ) -> Option<EoirPointingMode> {
        let now = effects.dli.now.mono;
        let mut mode = None;
        self.tasks.retain_mut(|task| {
            let ends = |step: &Step| is_replaced(step, steps);
            if task.station != station || !task.steps.iter().any(ends) {
                return true;
            }
            if let Some((component, ticket)) = task
                .running
                .take_if(|_| task.steps.front().is_some_and(ends))
                .and_then(|running| running.ticket)
            {
                // Otherwise the command client would repeat the older command after the newer one.
                effects.vehicle.commands_to(component).withdraw(now, ticket);
            }
            let turned = |step: &Step| step.drive() == Some(Drive::Gimbal);
            if task.steps.iter().any(|step| ends(step) && turned(step)) {
                mode = task.mode.take().or(mode);
            }
            task.steps.retain(|step| !ends(step));
            task.lost = true;
            if !task.steps.is_empty() {
                return true;
            }
            effects.refuse(Some(task.origin), REPLACED);
            false
        });
        mode
    }

    /// Carries out the steps that are possible now.
    fn advance(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        if self.tasks.is_empty() {
            return;
        }
        let all = context.equipment();
        for mut task in std::mem::take(&mut self.tasks) {
            let equipment = all.iter().find(|one| one.number == task.station).copied();
            let ended = match equipment {
                Some(equipment) => {
                    let station = Station::of(equipment, &context.vehicle.payloads, context.mono());
                    let state = self.states.entry(task.station).or_default();
                    task.advance(context, &station, state, effects)
                }
                None => Some(Err(format!(
                    "the vehicle no longer has payload station {}",
                    task.station
                ))),
            };
            match ended {
                None => self.tasks.push(task),
                Some(end) => self.end(&task, end, effects),
            }
        }
    }

    fn end(&mut self, task: &Task, end: Result<(), String>, effects: &mut Effects<'_>) {
        let state = self.states.entry(task.station).or_default();
        // A later command may have set another mode, which this result must not change.
        let governs = task.mode == Some(state.commanded);
        match end {
            Ok(()) => {
                // Also if another step of it was replaced: the gimbal shows this mode.
                if governs {
                    state.shown = state.commanded;
                }
                if task.lost {
                    effects.refuse(Some(task.origin), REPLACED);
                } else {
                    effects.acknowledge(&task.origin, AckType::CarriedOut);
                }
            }
            Err(why) => {
                if governs {
                    state.commanded = state.shown;
                }
                effects.refuse(Some(task.origin), why);
            }
        }
    }

    fn command_ended(
        &mut self,
        context: &Context<'_>,
        component: u8,
        event: &Event,
        effects: &mut Effects<'_>,
    ) {
        let Event::Done {
            ticket,
            command,
            outcome,
            ..
        } = event
        else {
            return;
        };
        if self
            .discovery
            .ended(component, *ticket, outcome, context.mono())
        {
            return;
        }
        let of = Some((component, *ticket));
        let place = self.tasks.iter().position(|task| {
            let running = task.running.as_ref();
            running.is_some_and(|running| running.ticket == of)
        });
        let Some(place) = place else { return };
        let why = match outcome {
            Outcome::Answered {
                result: MavResult::MAV_RESULT_ACCEPTED,
                ..
            } => {
                if let Some(running) = &mut self.tasks[place].running {
                    running.ticket = None;
                    // A report from before the answer may still show the earlier state.
                    running.since = context.mono();
                }
                return;
            }
            Outcome::Answered { result, .. } => {
                format!("component {component} answers {command:?}: {result:?}")
            }
            Outcome::NoAnswer { .. } => {
                format!("component {component} does not answer {command:?}: {MAY_BE_DONE}")
            }
            Outcome::Withdrawn => format!("{command:?} was withdrawn"),
        };
        let task = self.tasks.swap_remove(place);
        self.end(&task, Err(why), effects);
    }

    /// Ends continuing motions of a CUCS that no longer holds the station: rates, a place, a zoom. The next holder begins
    /// without a pointing mode.
    fn end_with_holder(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let now = context.mono();
        for (number, state) in &mut self.states {
            if state.stops_zoom
                && let Some(station) = station_of(context, *number)
            {
                state.stops_zoom = !stop_zoom(&station, now, effects);
            }
            let lost = |by: &Id| !context.rights.holds_station(*by, *number);
            if !state.by.as_ref().is_some_and(lost) {
                continue;
            }
            let vehicle = effects.vehicle.autopilot();
            let mut stops_zoom = false;
            if let Some(station) = station_of(context, *number) {
                let turns = |task: &Task| {
                    // Only a step that was sent can have set the gimbal in motion.
                    let sent = task.running.as_ref().and(task.steps.front());
                    task.station == *number && sent.is_some_and(|step| step.motion().is_some())
                };
                if state.moving.is_some() || self.tasks.iter().any(turns) {
                    let still = Motion::Rates(Slew::STILL);
                    let telemetry = &context.vehicle.telemetry;
                    let message = still.message(&station, telemetry, vehicle);
                    message
                        .into_iter()
                        .for_each(|one| effects.vehicle.post(one));
                }
                // A full queue empties within seconds: retry then. The next holder inherits nothing else.
                stops_zoom =
                    state.stops_zoom || (state.zooming && !stop_zoom(&station, now, effects));
            }
            *state = State {
                by_hand: state.by_hand,
                stops_zoom,
                ..State::default()
            };
        }
    }

    /// Repeats the message that keeps a gimbal moving. Whatever was commanded of a gimbal that another controls is over.
    fn keep_moving(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let now = context.mono();
        let (own, vehicle) = (effects.vehicle.own(), effects.vehicle.autopilot());
        for (number, state) in &mut self.states {
            let moves = state.moving.is_some();
            if !moves && state.shown == EoirPointingMode::NoValue {
                continue;
            }
            let all = context.equipment();
            let Some(equipment) = all.into_iter().find(|one| one.number == *number) else {
                state.moving = None;
                continue;
            };
            let station = Station::of(equipment, &context.vehicle.payloads, now);
            // A command in progress may be about to take it.
            let turned = |task: &Task| {
                let mut steps = task.steps.iter();
                task.station == *number && steps.any(|step| step.drive() == Some(Drive::Gimbal))
            };
            let holder = step::holder(&station).filter(|_| !self.tasks.iter().any(turned));
            if let Some(other) = holder.filter(|one| *one != [own.system, own.component]) {
                state.moving = None;
                state.shown = EoirPointingMode::NoValue;
                // Angles are taken up by the next command; what moves a gimbal until it is ended is not, by a stream of them.
                let angles = state.commanded == EoirPointingMode::AngleToUa;
                let back = if angles {
                    "the next angles (19001) take it back"
                } else {
                    state.commanded = EoirPointingMode::NoValue;
                    "command a pointing mode (19100) to take it back"
                };
                effects.warn_of_link(taken(*number, other, back));
                continue;
            }
            let Some(moving) = &mut state.moving else {
                continue;
            };
            if now < moving.next {
                continue;
            }
            let telemetry = &context.vehicle.telemetry;
            if let Some(message) = moving.motion.message(&station, telemetry, vehicle) {
                effects.vehicle.post(message);
            }
            moving.next = now + moving.motion.again();
        }
    }

    /// Sends 21000 to all listeners if the stations have changed.
    fn watch_stations(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let all = context.equipment();
        if all != self.announced {
            let listeners = effects.listeners.clone();
            announce(context, &listeners, &all, effects);
            self.announced = all;
        }
        let streams = streams(context);
        if self
            .announced_streams
            .iter()
            .eq(streams.iter().map(|(bit, one)| (bit, *one)))
        {
            return;
        }
        let listeners = effects.listeners.clone();
        for one in &streams {
            if self.announced_streams.get(&one.0) != Some(one.1) {
                announce_stream(&listeners, one, effects);
            }
        }
        let of_now = streams.into_iter().map(|(of, one)| (of, one.clone()));
        self.announced_streams = of_now.collect();
    }
}

impl Task {
    /// Carries out the steps that are possible now. Returns the result once the command has ended.
    fn advance(
        &mut self,
        context: &Context<'_>,
        station: &Station<'_>,
        state: &mut State,
        effects: &mut Effects<'_>,
    ) -> Option<Result<(), String>> {
        let now = context.mono();
        let own = effects.vehicle.own();
        // Without the right nothing more is commanded.
        if !context.rights.holds_station(self.by, self.station) {
            if let Some((component, ticket)) = self.running.take().and_then(|sent| sent.ticket) {
                effects.vehicle.commands_to(component).withdraw(now, ticket);
            }
            return Some(Err(format!(
                "LOI 3 (payload) of station {} is no longer held",
                self.station
            )));
        }
        loop {
            let Some(step) = self.steps.front().copied() else {
                return Some(Ok(()));
            };
            let Some(running) = &mut self.running else {
                if step.is_so(station, own) {
                    self.steps.pop_front();
                    continue;
                }
                match start(step, station, context, effects) {
                    Ok(running) => self.running = Some(running),
                    Err(why) => return Some(Err(why)),
                }
                return None;
            };
            if running.ticket.is_some() {
                return None;
            }
            let telemetry = &context.vehicle.telemetry;
            if step.is_shown(station, telemetry, own, &running.before, running.since) {
                if let Some(motion) = step.motion() {
                    // Now, not at the end of the command: a zoom that follows may take longer than the 2 s that one message
                    // keeps PX4 turning.
                    let next = running.ask_at;
                    state.moving = Some(Moving { motion, next });
                }
                state.zooming &= !step.ends_zoom();
                state.by_hand &= !step.ends_manual_focus();
                self.steps.pop_front();
                self.running = None;
                continue;
            }
            if now >= running.until {
                return Some(Err(step.undone().to_owned()));
            }
            if step == Step::Zoom(Zoom::Stop)
                && let Some((at, settings)) = station.camera.and_then(|camera| camera.settings)
                && let Some(zoom) = settings.zoom
                && at > running.since
            {
                running.before.last_zoom = Some((at, zoom));
            }
            if now >= running.ask_at {
                running.ask_at = now + step.motion().map_or(ASK_AGAIN, Motion::again);
                if let Some(motion) = step.motion() {
                    let vehicle = effects.vehicle.autopilot();
                    let message = motion.message(station, telemetry, vehicle);
                    message
                        .into_iter()
                        .for_each(|one| effects.vehicle.post(one));
                }
                if let (Some(message), Some(camera)) = (step.evidence(), station.equipment.camera) {
                    ask(camera, message, now, effects);
                }
            }
            return None;
        }
    }
}

/// What an operator reads of a gimbal that `other` controls.
fn taken(number: u8, other: [u8; 2], back: &str) -> String {
    let now = match other {
        [0, 0] => "controlled by nobody now (PX4 centres its gimbal when a mission is left, and for a return or a landing)".to_owned(),
        [system, component] => format!("steered by system {system} component {component} now"),
    };
    format!(
        "the gimbal of payload station {number} is {now}, no longer by this VSM (GIMBAL_MANAGER_STATUS): {back}"
    )
}

/// A present payload station.
fn station_of<'a>(context: &Context<'a>, number: u8) -> Option<Station<'a>> {
    let all = context.equipment();
    let equipment = all.into_iter().find(|one| one.number == number)?;
    let payloads = &context.common.vehicle.payloads;
    Some(Station::of(equipment, payloads, context.mono()))
}

/// Stops a zoom; returns false if the camera's queue has no room for that.
fn stop_zoom(station: &Station<'_>, now: Duration, effects: &mut Effects<'_>) -> bool {
    let own = effects.vehicle.own();
    match Step::Zoom(Zoom::Stop).order(station, own) {
        Some(Order::Command(camera, stop)) => {
            let client = effects.vehicle.commands_to(camera);
            client.submit(now, stop).is_ok()
        }
        _ => true,
    }
}

/// Sends a step.
fn start(
    step: Step,
    station: &Station<'_>,
    context: &Context<'_>,
    effects: &mut Effects<'_>,
) -> Result<Running, String> {
    let now = context.mono();
    let (own, vehicle) = (effects.vehicle.own(), effects.vehicle.autopilot());
    // The report that confirms a command is requested as soon as the command is accepted.
    let mut ask_at = now;
    let order = step.order(station, own);
    let ticket = match order.ok_or("the station lacks the device for it, or its manager")? {
        Order::Post(motion) => {
            let telemetry = &context.vehicle.telemetry;
            let message = motion.message(station, telemetry, vehicle);
            let missing = "the gimbal has no manager, or the vehicle's position is not known";
            effects.vehicle.post(message.ok_or(missing)?);
            ask_at += motion.again();
            None
        }
        Order::Command(component, command) => {
            let client = effects.vehicle.commands_to(component);
            let ticket = client
                .submit(now, command)
                .map_err(|fault| fault.to_string())?;
            Some((component, ticket))
        }
    };
    Ok(Running {
        ticket,
        since: now,
        until: now + step.limit(),
        before: Before::of(station),
        ask_at,
    })
}

/// Requests a message of a component once; the result of the request is ignored.
fn ask(component: u8, message: u16, now: Duration, effects: &mut Effects<'_>) {
    let client = effects.vehicle.commands_to(component);
    // One at a time, so that a camera that is slow to answer does not get a queue of them.
    if client.pending() == 0 {
        let _ = client.submit(now, request(message));
    }
}

/// The ground that sensors look at: from elevation files if there are some, otherwise flat at home's height.
pub(crate) fn ground<'a>(bounds: &'a Bounds, telemetry: &Telemetry) -> Option<Ground<'a>> {
    match &bounds.terrain {
        Some(terrain) => Some(Ground::Terrain(terrain)),
        None => {
            let home = telemetry.home?;
            Some(Ground::Flat(home.amsl_m))
        }
    }
}

/// The video streams of all stations, each with its station and stream number.
fn streams<'a>(context: &Context<'a>) -> Vec<((u8, u8), &'a StreamInformation)> {
    let payloads = &context.common.vehicle.payloads;
    let cameras = context.equipment().into_iter().filter(|one| one.bit() != 0);
    let cameras = cameras.filter_map(|one| Some((one.number, payloads.camera(one.camera)?)));
    let each = cameras.flat_map(|(station, camera)| {
        let streams = camera.streams.iter();
        streams.map(move |(number, stream)| ((station, *number), stream))
    });
    each.collect()
}

/// Sends 50025 for a stream to these CUCSs.
fn announce_stream(
    to: &[usize],
    ((station, number), stream): &((u8, u8), &StreamInformation),
    effects: &mut Effects<'_>,
) {
    let bit = 1 << (station - 1);
    for listener in to {
        let message = report::video_stream(bit, (*number, stream), effects.stamp());
        effects.send(*listener, &message.into());
    }
}

/// Sends 21000 for every station to these CUCSs.
fn announce(context: &Context<'_>, to: &[usize], all: &[Equipment], effects: &mut Effects<'_>) {
    for listener in to {
        if context.provisional(*listener) == Provisional::Off {
            continue;
        }
        for one in all.iter().filter(|one| one.bit() != 0) {
            let station = Station::of(*one, &context.vehicle.payloads, context.mono());
            let stamp = effects.stamp();
            let message = report::configuration(&station, all, context.vsm, stamp);
            // Sent directly, not as a report: reports may be withheld from an address that is not proven yet, and this is
            // sent only once.
            effects.send(*listener, &message.into());
        }
    }
}

/// Whether a newer command of these steps moves what this step moves.
fn is_replaced(step: &Step, by: &[Step]) -> bool {
    let drive = step.drive();
    drive.is_some() && by.iter().any(|newer| newer.drive() == drive)
}

const REPLACED: &str = "replaced by a newer command for the same gimbal, zoom or focus";
/// Time after which the report that confirms a step is requested again.
const ASK_AGAIN: Duration = Duration::from_millis(400);
/// Maximum number of tasks per station, so that holders of other stations need not wait. Newer commands replace older ones,
/// so four are enough.
const MAX_TASKS: usize = 4;
