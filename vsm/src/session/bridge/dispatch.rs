//! The destination of a station's message (the VSM, one of its vehicles, or all of them), and the right that it needs.

use mapping::support;
use mavlink_link::Now;
use mavlink_link::store::Disk;
use stanag_msgs::enums::{AckType, LoiBitmap};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, DataLinkConfigurationAssignmentMessage,
    GenericInformationRequestMessage,
};
use stanag_msgs::{Id, Message, ed25};

use super::{Bridge, destination_as_source};
use crate::session::access::{Group, Permitted};
use crate::session::aircraft::Aircraft;
use crate::session::alerts::Cause;
use crate::session::authority::{self, rules::Rights, rules::Stations};
use crate::session::context::Origin;
use crate::session::effects::DliEffects;
use crate::session::fleet::Fleet;
use crate::session::{held, reports};

impl Bridge {
    /// Carries out the message of an accepted station.
    pub(super) fn dispatch(
        &mut self,
        now: Now,
        origin: Origin,
        destination: Id,
        message: &Message,
        disk: &mut dyn Disk,
    ) {
        if let Message::Heartbeat(_) = message {
            // A heartbeat before any grant does not enable the silence rule, nor does one from an unproven address.
            let station = &self.stations[origin.station];
            let (may, id) = (!station.sends_heartbeats && station.proven, station.id());
            if may && self.aircraft.has_holder(id) {
                self.stations[origin.station].sends_heartbeats = true;
                // Its silence counts from now on.
                self.aircraft.ask_all();
            }
        }
        let cucs = self.stations[origin.station].id();
        let (mut dli, aircraft) = self.effects(now, disk);
        let to_all = destination == Id::BROADCAST || destination == dli.vsm;
        let meant = aircraft.find_mut(destination);
        match message {
            Message::Heartbeat(_) => {
                let source = destination_as_source(destination, dli.vsm);
                dli.acknowledge(source, &origin, AckType::CarriedOut);
            }
            Message::MessageAcknowledgement(_) => {}
            Message::CucsAuthorisationRequest(request) => {
                authorise(aircraft, &mut dli, &origin, destination, cucs, request);
            }
            Message::PositiveHandoverAuthorisationRequest(request) => match meant {
                Some(one) => {
                    accept(one, &mut dli, &origin, true);
                    let input = authority::Input::HandOver {
                        origin: &origin,
                        request,
                    };
                    let answer = one.ask_authority(&mut dli, input);
                    dli.acknowledge_decision(destination, &origin, answer);
                }
                None => dli.refuse(&origin, TO_ONE),
            },
            Message::VehicleDataLinkTransitionCoordination(message) => match meant {
                Some(one) => {
                    accept(one, &mut dli, &origin, true);
                    let input = authority::Input::Transition { origin, message };
                    one.ask_authority(&mut dli, input);
                }
                None => dli.refuse(&origin, TO_ONE),
            },
            Message::ScheduleMessageUpdateCommand(command) => {
                let station = origin.station;
                inform(aircraft, &mut dli, origin, destination, cucs, || {
                    reports::Input::Schedule { station, command }
                });
            }
            Message::GenericInformationRequestMessage(request) => {
                let station = origin.station;
                inform(aircraft, &mut dli, origin, destination, cucs, || {
                    reports::Input::ReportOnce { station, request }
                });
            }
            // Sent to all, it is a query for links, whatever its assignment: it assigns none.
            Message::DataLinkControlRequest(_) if to_all => {
                let station = origin.station;
                let links = GenericInformationRequestMessage {
                    message_type: Some(DataLinkConfigurationAssignmentMessage::ID),
                    ..GenericInformationRequestMessage::default()
                };
                inform(aircraft, &mut dli, origin, destination, cucs, || {
                    reports::Input::ReportOnce {
                        station,
                        request: &links,
                    }
                });
            }
            // No right is checked: configuration comes before a grant.
            Message::FieldConfigurationRequest(request) => {
                for one in aircraft.meant_mut(destination, to_all) {
                    // It answers the station itself.
                    let _ =
                        one.ask_reports(&mut dli, reports::Input::Configure { origin, request });
                }
            }
            Message::ZeroizeCommand(order) => match meant {
                Some(one) => {
                    let vehicle = one.id();
                    if admit(one, &mut dli, &origin, cucs, message) {
                        self.order_zeroize(now, origin, vehicle, order, disk);
                    }
                }
                None => dli.refuse(&origin, TO_ONE),
            },
            command => match meant {
                Some(one) => command_one(one, &mut dli, origin, cucs, command),
                None => {
                    // Nobody can say which vehicle a command to all is meant for.
                    dli.counters.count("misaddressed");
                    dli.refuse(&origin, TO_ONE);
                }
            },
        }
        if let Message::CucsAuthorisationRequest(_) = message {
            self.forget_who_left();
        }
        // The CUCS that armed it may have lost control by this message.
        self.watch_zeroize(now, disk);
    }
}

/// Message 1: to one vehicle, or to all of this VSM.
fn authorise(
    aircraft: &mut Fleet,
    dli: &mut DliEffects<'_>,
    origin: &Origin,
    destination: Id,
    cucs: Id,
    request: &CucsAuthorisationRequest,
) {
    let addressed = |vsm: Id| [dli.vsm, Id::BROADCAST, Id::NULL, Id(0)].contains(&vsm);
    if destination == Id::BROADCAST && !request.vsm_id.is_none_or(addressed) {
        // The message names another vehicle.
        return dli.counters.count("another VSM's");
    }
    let to_all = destination == Id::BROADCAST || destination == dli.vsm;
    let mut answer = AckType::CarriedOut;
    for one in aircraft.meant_mut(destination, to_all) {
        // A request is authorised if it is granted. A release of nothing, and a request for LOI 2, use no Time Stamp, since
        // any number of them is allowed.
        let gives_up = authority::releases(request) && one.authority.has_rights(cucs);
        accept(
            one,
            dli,
            origin,
            authority::requests_control(request) || gives_up,
        );
        let input = authority::Input::Authorise {
            origin,
            request,
            to_all,
        };
        let of_one = one.ask_authority(dli, input);
        // One 17000 answers for all vehicles: it is type 2 only if each has carried it out.
        if of_one != AckType::CarriedOut {
            answer = of_one;
        }
    }
    // An answer comes from the destination of the query; for a query to all that is the VSM.
    let source = Some(destination).filter(|id| aircraft.has(*id));
    dli.acknowledge_decision(source.unwrap_or(dli.vsm), origin, answer);
}

/// 17001 and 17002 of stations that hold LOI 2, to one vehicle or all. Sent to all, it is carried out if any vehicle does
/// so.
fn inform<'m>(
    aircraft: &mut Fleet,
    dli: &mut DliEffects<'_>,
    origin: Origin,
    destination: Id,
    cucs: Id,
    input: impl Fn() -> reports::Input<'m>,
) {
    let listens = |one: &Aircraft| one.authority.rights().holds(cucs, LoiBitmap::LOI2);
    let listed = |one: &Aircraft, dli: &DliEffects<'_>| one.permitted(dli, &origin, Group::Monitor);
    if let Some(one) = aircraft.find_mut(destination) {
        if !listens(one) {
            return refuse_without_right(one, dli, &origin, cucs, LoiBitmap::LOI2);
        }
        if let Some(why) = listed(one, dli).refusal() {
            return refuse_unlisted(one, dli, &origin, why);
        }
        return match one.ask_reports(dli, input()) {
            Ok(()) => dli.acknowledge(destination, &origin, AckType::CarriedOut),
            Err(why) => one.effects(dli).refuse(Some(origin), why),
        };
    }
    let (mut informed, mut why) = (false, "it needs LOI 2 (monitor), no LOI is held".to_owned());
    for one in aircraft.iter_mut() {
        if listens(one) && listed(one, dli) == Permitted::Yes {
            match one.ask_reports(dli, input()) {
                Ok(()) => informed = true,
                Err(fault) => why = fault,
            }
        }
    }
    if informed {
        let vsm = dli.vsm;
        dli.acknowledge(vsm, &origin, AckType::CarriedOut);
    } else {
        dli.refuse(&origin, &why);
    }
}

fn command_one(
    one: &mut Aircraft,
    dli: &mut DliEffects<'_>,
    origin: Origin,
    cucs: Id,
    message: &Message,
) {
    if admit(one, dli, &origin, cucs, message) {
        one.command(dli, origin, message);
    }
}

/// Checks the right of a command's sender: logs the command if it may be carried out, otherwise refuses it.
fn admit(
    one: &mut Aircraft,
    dli: &mut DliEffects<'_>,
    origin: &Origin,
    cucs: Id,
    message: &Message,
) -> bool {
    match one.right_for(message) {
        Some(right) if one.authority.rights().holds(cucs, right) => {
            let inner = held::inner(message);
            let meant = inner.as_ref().unwrap_or(message);
            let groups = [Some(Group::of(meant, right)), Group::besides(meant)];
            let mut each = groups.into_iter().flatten();
            match each.find_map(|group| one.permitted(dli, origin, group).refusal()) {
                Some(why) => refuse_unlisted(one, dli, origin, why),
                None => {
                    accept(one, dli, origin, true);
                    return true;
                }
            }
        }
        Some(right) => refuse_without_right(one, dli, origin, cucs, right),
        None => {
            dli.counters.count("not supported");
            let why = support::why_refused(message.id());
            let why = format!(
                "message {} is not supported by this VSM{}{}",
                ed25::named(origin.message_type),
                if why.is_some() { ": " } else { "" },
                why.unwrap_or_default()
            );
            one.effects(dli).refuse_unprivileged(origin, &why);
        }
    }
    false
}

/// Logs a message before it is carried out; `authorised`: its Time Stamp is used from now on. Raises an alert if it could
/// not be logged, and clears that once commands are logged again.
fn accept(one: &mut Aircraft, dli: &mut DliEffects<'_>, origin: &Origin, authorised: bool) {
    let Some(logged) = dli.accept(origin, authorised) else {
        return;
    };
    let mut effects = one.effects(dli);
    match logged {
        Ok(()) => effects.clear(Cause::CommandLog, "commands are logged again"),
        Err(fault) => effects.warn(
            Cause::CommandLog,
            format!(
                "commands cannot be logged: a command repeated after a restart would be carried out again ({fault})"
            ),
        ),
    }
}

/// Refuses a message of a CUCS that does not hold the right it needs.
fn refuse_without_right(
    one: &mut Aircraft,
    dli: &mut DliEffects<'_>,
    origin: &Origin,
    cucs: Id,
    right: LoiBitmap,
) {
    dli.counters.count("without the right");
    let held = one.authority.rights().held(cucs);
    let needed = Rights::named(right, Stations::NONE);
    let why = format!(
        "it needs {}; this CUCS holds {}",
        needed.in_words(),
        held.in_words()
    );
    one.effects(dli).refuse_unprivileged(origin, &why);
}

/// Refuses a message of a CUCS that holds the right but is not permitted this message by the access list.
fn refuse_unlisted(
    one: &mut Aircraft,
    dli: &mut DliEffects<'_>,
    origin: &Origin,
    (counter, why): (&'static str, &str),
) {
    dli.counters.count(counter);
    one.effects(dli).refuse_unprivileged(origin, why);
}

/// The refusal of a message to all vehicles that only one can carry out.
const TO_ONE: &str = "must be addressed to a single vehicle";
