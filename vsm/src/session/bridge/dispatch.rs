//! To whom a message of a station speaks: to the VSM, to one of its vehicles, or to all, and what that needs.

use mavlink_link::Now;
use stanag_msgs::enums::{AckType, LoiBitmap};
use stanag_msgs::messages::CucsAuthorisationRequest;
use stanag_msgs::{Id, Message};

use super::{Bridge, destination_as_source};
use crate::session::aircraft::Aircraft;
use crate::session::desk::{Desk, Origin};
use mavlink_link::store::Disk;

impl Bridge {
    /// Carries out the message of a station that may speak.
    pub(super) fn dispatch(
        &mut self,
        now: Now,
        origin: Origin,
        destination: Id,
        message: &Message,
        store: &mut dyn Disk,
    ) {
        match message {
            Message::Heartbeat(_) => {
                // One before any grant is harmless: it does not make later silence count.
                let id = self.stations[origin.station].id();
                let holds = |aircraft: &Aircraft| {
                    aircraft.authority.holders().any(|(holder, _)| holder == id)
                };
                self.stations[origin.station].sends_heartbeats |= self.aircraft.iter().any(holds);
                self.acknowledge(now, &origin, destination, AckType::CarriedOut, store);
            }
            Message::MessageAcknowledgement(_) => {}
            Message::CucsAuthorisationRequest(request) => {
                self.authorise(now, &origin, destination, request, store);
            }
            Message::PositiveHandoverAuthorisationRequest(request) => {
                let (mut desk, aircraft) = self.desk(now, store);
                let meant = aircraft.iter_mut().find(|one| one.id() == destination);
                match meant {
                    Some(aircraft) => {
                        let answer = aircraft.hand_over(&mut desk, &origin, request);
                        desk.acknowledge(destination, &origin, answer);
                    }
                    None => desk.refuse(&origin, TO_ONE),
                }
            }
            Message::VehicleDataLinkTransitionCoordination(request) => {
                let (mut desk, aircraft) = self.desk(now, store);
                match aircraft.iter_mut().find(|one| one.id() == destination) {
                    Some(aircraft) => aircraft.coordinate_transition(&mut desk, origin, request),
                    None => desk.refuse(&origin, TO_ONE),
                }
            }
            Message::ScheduleMessageUpdateCommand(command) => {
                self.inform(now, origin, destination, store, |aircraft, desk| {
                    aircraft.schedule(desk, origin.station, command)
                });
            }
            Message::GenericInformationRequestMessage(request) => {
                self.inform(now, origin, destination, store, |aircraft, desk| {
                    aircraft.report_once(desk, origin.station, request)
                });
            }
            Message::FieldConfigurationRequest(request) => {
                let (mut desk, aircraft) = self.desk(now, store);
                for aircraft in aircraft.iter_mut() {
                    let to_all = destination == Id::BROADCAST || destination == desk.vsm;
                    if to_all || aircraft.id() == destination {
                        aircraft.configure(&mut desk, origin, request);
                    }
                }
            }
            command => self.command(now, origin, destination, command, store),
        }
    }

    /// Message 1: to one vehicle, or to all of this VSM.
    fn authorise(
        &mut self,
        now: Now,
        origin: &Origin,
        destination: Id,
        request: &CucsAuthorisationRequest,
        store: &mut dyn Disk,
    ) {
        let (mut desk, aircraft) = self.desk(now, store);
        if destination == Id::BROADCAST && !desk.is_meant(request.vsm_id) {
            // Who is discovered by name is another.
            return desk.counters.count("another VSM's");
        }
        let to_all = destination == Id::BROADCAST || destination == desk.vsm;
        let mut answer = AckType::CarriedOut;
        for aircraft in aircraft.iter_mut() {
            let of_one = if aircraft.id() == destination {
                aircraft.authorise(&mut desk, origin, request)
            } else if to_all {
                aircraft.authorise_to_all(&mut desk, origin, request)
            } else {
                continue;
            };
            if of_one != AckType::CarriedOut {
                answer = of_one;
            }
        }
        let vehicle = aircraft
            .iter()
            .map(Aircraft::id)
            .find(|id| *id == destination);
        let source = vehicle.unwrap_or(desk.vsm);
        desk.acknowledge(source, origin, answer);
    }

    /// 17001 and 17002: for those that may listen, to one vehicle or all. To all it is carried out where any vehicle does.
    fn inform(
        &mut self,
        now: Now,
        origin: Origin,
        destination: Id,
        store: &mut dyn Disk,
        mut ask: impl FnMut(&mut Aircraft, &mut Desk<'_>) -> Result<(), String>,
    ) {
        let asker = self.stations[origin.station].id();
        let (mut desk, aircraft) = self.desk(now, store);
        if let Some(one) = aircraft.iter_mut().find(|one| one.id() == destination) {
            if !one.authority.holds(asker, LoiBitmap::LOI2) {
                return one.refuse_without_right(&mut desk, &origin, LoiBitmap::LOI2);
            }
            return match ask(one, &mut desk) {
                Ok(()) => desk.acknowledge(destination, &origin, AckType::CarriedOut),
                Err(why) => one.refuse(&mut desk, Some(origin), why),
            };
        }
        let (mut told, mut why) = (false, "it needs LOI 2, and none is held".to_owned());
        for one in aircraft.iter_mut() {
            if one.authority.holds(asker, LoiBitmap::LOI2) {
                match ask(one, &mut desk) {
                    Ok(()) => told = true,
                    Err(fault) => why = fault,
                }
            }
        }
        if told {
            let vsm = desk.vsm;
            desk.acknowledge(vsm, &origin, AckType::CarriedOut);
        } else {
            desk.refuse(&origin, &why);
        }
    }

    fn command(
        &mut self,
        now: Now,
        origin: Origin,
        destination: Id,
        message: &Message,
        store: &mut dyn Disk,
    ) {
        let cucs = self.stations[origin.station].id();
        let (mut desk, aircraft) = self.desk(now, store);
        let Some(aircraft) = aircraft
            .iter_mut()
            .find(|aircraft| aircraft.id() == destination)
        else {
            // A command to everybody is a command to nobody in particular: refused.
            desk.counters.count("misaddressed");
            return desk.refuse(&origin, TO_ONE);
        };
        match aircraft.right_for(message) {
            Some(right) if aircraft.authority.holds(cucs, right) => {
                aircraft.command(&mut desk, origin, message);
            }
            Some(right) => aircraft.refuse_without_right(&mut desk, &origin, right),
            None => {
                desk.counters.count("not supported");
                let why = format!(
                    "message {} is not supported by this VSM",
                    origin.message_type
                );
                aircraft.refuse_foreign(&mut desk, &origin, why);
            }
        }
    }

    fn acknowledge(
        &mut self,
        now: Now,
        origin: &Origin,
        destination: Id,
        answer: AckType,
        store: &mut dyn Disk,
    ) {
        let (mut desk, _) = self.desk(now, store);
        desk.acknowledge(destination_as_source(destination, desk.vsm), origin, answer);
    }
}

/// A command to everybody is a command to nobody in particular.
const TO_ONE: &str = "it is for one vehicle, and is addressed to none";
