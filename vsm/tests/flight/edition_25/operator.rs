//! The scriptable ground station in Edition 2.5: the other half of the translation flies with the bridge's.

use std::net::SocketAddr;

use cucs::{Delivery, Edition, Event, Session, SessionConfig, Ticket};
use kit::bridge::{Rig, Setup, orders, vehicle_id};
use px4_sim::Mode as Px4;
use stanag_msgs::enums::{
    AltitudeType, FlightPathControlMode as Mode, LoiBitmap, LoiterDurationUnits, LoiterType,
    MissionPlanMode, RequestedAccess,
};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, FieldConfigurationRequest, LoiterConfiguration,
    PositiveHandoverAuthorisationRequest, UaLoiterWaypoint, VehicleOperatingModeCommand,
};
use stanag_msgs::{Bam32, Message, Scaled};

use super::after_2034::set_clock;
use super::{CUCS, rig};

/// A session on the network of the rig.
pub(super) struct Operator {
    session: Session,
    address: SocketAddr,
    taken: usize,
    taken_of_group: usize,
    pub(super) texts: Vec<String>,
    pub(super) messages: Vec<Message>,
}

impl Operator {
    pub(super) fn new(address: SocketAddr) -> Operator {
        let config = SessionConfig::of(Edition::Ed25, CUCS);
        Operator {
            session: Session::new(config),
            address,
            taken: 0,
            taken_of_group: 0,
            texts: Vec::new(),
            messages: Vec::new(),
        }
    }

    fn now(rig: &Rig) -> cucs::Now {
        let now = rig.station_now();
        cucs::Now {
            mono: now.mono,
            unix_ms: now.wall.as_millis() as u64,
        }
    }

    /// Takes what has come, sends what is due.
    fn pump(&mut self, rig: &mut Rig) {
        let new = rig.others.get(self.taken..).unwrap_or_default().to_vec();
        self.taken = rig.others.len();
        let now = Operator::now(rig);
        for (_, bytes) in new.iter().filter(|(to, _)| *to == self.address) {
            assert!(stanag_msgs::ed25::is_ed25(bytes), "another edition");
            self.session.handle_datagram(now, bytes);
        }
        let of_group = rig.group.get(self.taken_of_group..).unwrap_or_default();
        self.taken_of_group = rig.group.len();
        for bytes in of_group {
            self.session.handle_datagram(now, bytes);
        }
        self.session.handle_timeout(now);
        while let Some(bytes) = self.session.poll_transmit() {
            assert!(stanag_msgs::ed25::is_ed25(&bytes), "another edition");
            rig.deliver_from(self.address, &bytes);
        }
        while let Some(event) = self.session.poll_event() {
            match event {
                Event::Alert { alert, .. } => self.texts.push(alert.text),
                Event::Message { message, .. } => self.messages.push(*message),
                _ => {}
            }
        }
    }

    pub(super) fn until(
        &mut self,
        rig: &mut Rig,
        limit_s: f64,
        so: impl Fn(&Operator, &Rig) -> bool,
    ) -> bool {
        for _ in 0..(limit_s * 20.0) as usize {
            self.pump(rig);
            if so(self, rig) {
                return true;
            }
            rig.run(0.05);
        }
        false
    }

    fn end(&mut self, rig: &mut Rig, ticket: Ticket) -> Delivery {
        self.until(rig, 40.0, |one, _| one.session.delivery(ticket).is_final());
        self.session.delivery(ticket)
    }

    pub(super) fn send(&mut self, rig: &mut Rig, message: impl Into<Message>) -> Delivery {
        let now = Operator::now(rig);
        let ticket = self.session.send(now, vehicle_id(0), message);
        let ticket = ticket.expect("Edition 2.5 can say it");
        self.end(rig, ticket)
    }
}

fn mode(mode: Mode) -> VehicleOperatingModeCommand {
    orders::mode(mode)
}

#[test]
fn the_scriptable_station_flies_from_discovery_to_release() {
    let (mut rig, station) = rig();
    let mut operator = Operator::new(station.address);
    // Discovery: whoever has not asked yet is shown the vehicle by #21.
    let question = CucsAuthorisationRequest {
        vsm_id: Some(stanag_msgs::Id::BROADCAST),
        requested_handover_loi: Some(LoiBitmap::NONE),
        requested_handover_access: Some(RequestedAccess::Relinquish),
        ..CucsAuthorisationRequest::default()
    };
    let now = Operator::now(&rig);
    let session = &mut operator.session;
    let sent = session.send_unconfirmed(now, stanag_msgs::Id::BROADCAST, question);
    sent.expect("a question");
    assert!(operator.until(&mut rig, 3.0, |one, _| {
        let vehicle = one.session.vehicle(vehicle_id(0));
        vehicle.is_some_and(|vehicle| vehicle.authorised().contains(LoiBitmap::LOI4))
    }));
    // Its limits, by the messages and fields of Edition 4.
    let limits = FieldConfigurationRequest {
        vsm_id: Some(stanag_msgs::Id::BROADCAST),
        request_type: Some(stanag_msgs::enums::ConfigRequestType::from_raw(3)),
        ..FieldConfigurationRequest::default()
    };
    operator.send(&mut rig, limits);
    let known = |one: &Operator| {
        one.messages.iter().any(|message| {
            let Message::FieldConfigurationIntegerResponse(answer) = message else {
                return false;
            };
            (answer.requested_message, answer.requested_field) == (Some(2016), Some(4))
        })
    };
    assert!(
        operator.until(&mut rig, 5.0, |one, _| known(one)),
        "{:?}",
        operator.session.traffic()
    );
    let taken = operator.send(&mut rig, orders::request_control());
    assert_eq!(taken, Delivery::CarriedOut, "{:?}", operator.texts);
    assert!(operator.until(&mut rig, 3.0, |one, _| {
        one.session
            .vehicle(vehicle_id(0))
            .is_some_and(|one| one.position().is_some())
    }));
    // A route with a loiter.
    let mut plan = orders::square();
    plan.push(
        UaLoiterWaypoint {
            waypoint_number: Some(102),
            waypoint_loiter_type: Some(LoiterType::Hover),
            loiter_duration: Some(3),
            loiter_duration_units: Some(LoiterDurationUnits::Seconds),
            ..UaLoiterWaypoint::default()
        }
        .into(),
    );
    for part in plan {
        assert_eq!(
            operator.send(&mut rig, part),
            Delivery::CarriedOut,
            "{:?}",
            operator.texts
        );
    }
    let loaded = |one: &Operator, _: &Rig| {
        let vehicle = one.session.vehicle(vehicle_id(0));
        vehicle
            .and_then(|vehicle| vehicle.transfer_status())
            .is_some_and(|(status, _)| {
                status == stanag_msgs::enums::MissionTransferStatus::Complete
            })
    };
    let now = Operator::now(&rig);
    let named = stanag_msgs::messages::MissionTransferCommand {
        // #800 has no field for it: a mission is loaded whole.
        route_id: Some(stanag_msgs::Text::new("R1")),
        ..orders::load()
    };
    let load = operator.session.send(now, vehicle_id(0), named);
    load.expect("a load");
    assert!(
        operator.until(&mut rig, 20.0, loaded),
        "{:?}",
        operator.texts
    );
    // A launch carries its altitude, though #43 goes before #42.
    assert_eq!(
        operator.send(&mut rig, orders::launch(20.0)),
        Delivery::CarriedOut
    );
    assert!(
        operator.until(&mut rig, 60.0, |_, rig| -rig.truth().position.d > 18.5),
        "{:?}",
        operator.texts
    );
    // The route from its second waypoint, faster.
    let fly = VehicleOperatingModeCommand {
        commanded_waypoint_number: Some(102),
        ..mode(Mode::Waypoint)
    };
    assert_eq!(
        operator.send(&mut rig, fly),
        Delivery::CarriedOut,
        "{:?}",
        operator.texts
    );
    assert!(
        operator.until(&mut rig, 20.0, |one, rig| {
            let vehicle = one.session.vehicle(vehicle_id(0));
            rig.truth().mode == Px4::Mission
                && vehicle.and_then(|one| one.to_waypoint()) == Some(102)
        }),
        "{:?}",
        operator.texts
    );
    // A loiter there, higher, without any #41.
    let (latitude, longitude) = orders::place(60.0, 10.0);
    let loiter = VehicleOperatingModeCommand {
        loiter_position_latitude: Some(Bam32::from_degrees(latitude)),
        loiter_position_longitude: Some(Bam32::from_degrees(longitude)),
        altitude_command_type: Some(stanag_msgs::enums::AltitudeCommandType::Altitude),
        commanded_altitude: Some(Scaled::from_si(32.0).expect("an altitude")),
        altitude_type: Some(AltitudeType::Agl),
        ..mode(Mode::Loiter)
    };
    assert_eq!(
        operator.send(&mut rig, loiter),
        Delivery::CarriedOut,
        "{:?}",
        operator.texts
    );
    assert!(
        operator.until(&mut rig, 60.0, |_, rig| {
            let at = rig.truth().position;
            (at.n - 60.0).abs() < 3.0 && (-at.d - 32.0).abs() < 1.5
        }),
        "{:?} {:?}",
        rig.truth(),
        operator.texts
    );
    // What it configures and does not command leaves the altitude as it is.
    let hover = LoiterConfiguration {
        loiter_type: Some(LoiterType::Hover),
        ..LoiterConfiguration::default()
    };
    assert_eq!(operator.send(&mut rig, hover), Delivery::CarriedOut);
    assert_eq!(
        operator.send(&mut rig, mode(Mode::Loiter)),
        Delivery::CarriedOut
    );
    operator.until(&mut rig, 6.0, |_, _| false);
    assert!(
        (-rig.truth().position.d - 32.0).abs() < 1.5,
        "{:?}",
        rig.truth()
    );
    // A refusal is found among the alerts.
    assert_eq!(
        operator.send(&mut rig, orders::launch(20.0)),
        Delivery::Refused,
        "{:?}",
        operator.texts
    );
    // The plan comes back as it was sent.
    operator.session.start_download(vehicle_id(0));
    let download = operator.send(
        &mut rig,
        orders::transfer(MissionPlanMode::DownloadWaypoint),
    );
    assert_ne!(download, Delivery::CarriedOut, "no waypoint is named");
    let now = Operator::now(&rig);
    let all = orders::transfer(MissionPlanMode::Download);
    operator
        .session
        .send(now, vehicle_id(0), all)
        .expect("a download");
    assert!(operator.until(&mut rig, 10.0, |one, _| {
        one.session.vehicle(vehicle_id(0)).is_some_and(|one| {
            one.download.waypoints().count() == 4 && one.download.missing().is_empty()
        })
    }));
    assert_eq!(
        operator.send(&mut rig, mode(Mode::AutolandEngage)),
        Delivery::CarriedOut
    );
    assert!(operator.until(&mut rig, 90.0, |_, rig| rig.truth().landed));
    let release = CucsAuthorisationRequest {
        requested_handover_access: Some(RequestedAccess::Relinquish),
        requested_handover_loi: Some(LoiBitmap::NONE),
        ..CucsAuthorisationRequest::default()
    };
    assert_eq!(operator.send(&mut rig, release), Delivery::CarriedOut);
    assert!(
        operator
            .session
            .vehicle(vehicle_id(0))
            .unwrap()
            .granted()
            .is_empty()
    );
}

/// The two questions for a proof leave no credit for the answer to a single message 1.
#[test]
fn a_station_in_the_group_that_is_not_proven_yet_is_sent_its_rights_once_it_is() {
    let mut rig = Rig::new(Setup {
        tables: "[[cucs]]\nid = \"1b:00:00:b0\"\nloi = [2, 3, 4, 5]\ndelivery = \"group\"\n",
        dli_keys: "multicast = \"239.45.86.1:26001\"\ninterface = \"127.0.0.1\"",
        ..Setup::default()
    });
    rig.run(9.0);
    let mut operator = Operator::new(SocketAddr::from(([192, 0, 2, 7], 7)));
    let now = Operator::now(&rig);
    let session = &mut operator.session;
    let sent = session.send_unconfirmed(now, vehicle_id(0), orders::request_control());
    sent.expect("a request");
    let granted = |one: &Operator, _: &Rig| {
        let vehicle = one.session.vehicle(vehicle_id(0));
        vehicle.is_some_and(|one| one.granted().contains(LoiBitmap::LOI4))
    };
    assert!(
        operator.until(&mut rig, 5.0, granted),
        "{:?}",
        operator.session.traffic()
    );
}

/// It has proved its address, and only listens: after a restart of the bridge it is asked again before anything has come from it.
#[test]
fn a_station_that_only_listens_is_asked_in_its_edition_after_a_restart() {
    let mut rig = Rig::new(Setup {
        tables: "[[cucs]]\nid = \"1b:00:00:b0\"\nloi = [2, 3, 4, 5]\n",
        ..Setup::default()
    });
    rig.run(9.0);
    let mut operator = Operator::new(SocketAddr::from(([127, 0, 0, 2], 41_000)));
    let granted = operator.send(&mut rig, orders::request_control());
    assert_eq!(granted, Delivery::CarriedOut);
    operator.until(&mut rig, 2.0, |_, _| false);
    rig.restart_bridge();
    // A lease, and the two after which a proof that was not renewed ends.
    operator.until(&mut rig, 200.0, |_, _| false);
    let bridge = rig.bridge.as_ref().expect("it runs");
    let status = bridge.status(String::new(), rig.now().mono);
    let mut all = status.stations.iter();
    let own = all.find(|one| one.id == CUCS.to_string());
    assert_eq!(own.expect("it is listed").proof, "answered");
    let sent = |rig: &Rig| rig.sent_to[&operator.address].0;
    let before = sent(&rig);
    rig.run(1.0);
    assert!(sent(&rig) > before, "it has no status");
}

#[test]
fn what_the_edition_cannot_say_is_not_sent() {
    let (mut rig, station) = rig();
    let mut operator = Operator::new(station.address);
    let now = Operator::now(&rig);
    let session = &mut operator.session;
    let mut refused = |message: Message| {
        let sent = session.send(now, vehicle_id(0), message);
        sent.expect_err("it has no words for it").to_string()
    };
    let turns = UaLoiterWaypoint {
        waypoint_number: Some(7),
        loiter_duration: Some(2),
        loiter_duration_units: Some(LoiterDurationUnits::Turns),
        ..UaLoiterWaypoint::default()
    };
    assert!(refused(turns.into()).contains("loiter at waypoint 7"));
    assert!(refused(mode(Mode::ContingencyA).into()).contains("mode 23"));
    let curve = Message::from(stanag_msgs::messages::CurveSegment::default());
    let number = curve.id().to_string();
    assert!(refused(curve).contains(&number));
    let before_a_report = LoiterConfiguration::default();
    assert!(refused(before_a_report.into()).contains("altitude"));
    // Nothing of it has left.
    operator.pump(&mut rig);
    assert_eq!(operator.session.traffic().sent.total(), 0);
}

#[test]
fn control_passes_between_the_scriptable_station_and_one_of_edition_4() {
    let (mut rig, station) = rig();
    let mut operator = Operator::new(station.address);
    let levels = LoiBitmap::from_raw(super::LOI_4_AND_5);
    let wish = |cucs| PositiveHandoverAuthorisationRequest {
        vsm_id: Some(stanag_msgs::Id::BROADCAST),
        requested_handover_loi: Some(levels),
        requesting_cucs_id: Some(cucs),
        ..PositiveHandoverAuthorisationRequest::default()
    };
    assert!(rig.carry_out(orders::request_control()).is_some());
    let now = Operator::now(&rig);
    let asked = operator.session.send(now, vehicle_id(0), wish(CUCS));
    let asked = asked.expect("a request");
    operator.until(&mut rig, 1.0, |_, _| false);
    assert!(
        !operator.session.delivery(asked).is_final(),
        "the holder has not consented"
    );
    assert!(rig.carry_out(wish(CUCS)).is_some());
    assert_eq!(
        operator.end(&mut rig, asked),
        Delivery::CarriedOut,
        "{:?}",
        operator.texts
    );
    let held = |one: &Operator| one.session.vehicle(vehicle_id(0)).map(|one| one.granted());
    operator.until(&mut rig, 1.0, |_, _| false);
    assert!(
        held(&operator).is_some_and(|held| held.contains(levels)),
        "{:?}",
        held(&operator)
    );
    // And back: #600 names who acquires it, who accepts by message 1.
    let other = rig.stations[0].id;
    let now = Operator::now(&rig);
    let offered = operator.session.send(now, vehicle_id(0), wish(other));
    let offered = offered.expect("an offer");
    operator.until(&mut rig, 1.0, |_, _| false);
    assert!(rig.carry_out(orders::request_control()).is_some());
    assert_eq!(
        operator.end(&mut rig, offered),
        Delivery::CarriedOut,
        "{:?}",
        operator.texts
    );
    assert!(
        held(&operator).is_none_or(|held| !held.intersects(levels)),
        "{:?}",
        held(&operator)
    );
}

#[test]
fn the_scriptable_station_operates_a_payload_and_commands_nothing_beside() {
    use cucs::{PayloadAction, ZoomTo};
    let (mut rig, station) = super::payload::operating();
    let mut operator = Operator::new(station.address);
    let seen = |rig: &Rig| rig.vehicles[0].vehicle().payloads()[0];
    let act = |operator: &mut Operator, rig: &mut Rig, action: PayloadAction| {
        for message in action.messages(1).expect("messages") {
            let end = operator.send(rig, message);
            assert_eq!(end, Delivery::CarriedOut, "{action:?} {:?}", operator.texts);
        }
    };
    // Every field of #201 commands something: nothing is sent before #302 has shown what there is.
    let now = Operator::now(&rig);
    let point = PayloadAction::Point {
        azimuth: 60.0,
        elevation: -30.0,
    };
    let first = point.messages(1).expect("messages").remove(0);
    let fault = operator.session.send(now, vehicle_id(0), first);
    assert!(fault.expect_err("unknown").to_string().contains("#302"));
    operator.until(&mut rig, 2.0, |_, _| false);
    act(&mut operator, &mut rig, point);
    let looks = seen(&rig).sight;
    act(
        &mut operator,
        &mut rig,
        PayloadAction::Record {
            switch: cucs::Switch::On,
        },
    );
    assert!(seen(&rig).recording);
    act(
        &mut operator,
        &mut rig,
        PayloadAction::Zoom {
            to: ZoomTo::Field(20.0),
        },
    );
    assert!((seen(&rig).hfov.to_degrees() - 20.0).abs() < 1.0);
    // Neither the zoom nor the recording has turned it, stowed it, or ended the other.
    let turned: f64 = looks
        .iter()
        .zip(seen(&rig).sight)
        .map(|(a, b)| (a - b).powi(2))
        .sum();
    assert!(turned.sqrt() < 0.06 && seen(&rig).recording, "{turned}");
    act(
        &mut operator,
        &mut rig,
        PayloadAction::Rate {
            right: 5.0,
            up: 0.0,
            inertial: false,
        },
    );
    act(
        &mut operator,
        &mut rig,
        PayloadAction::Zoom {
            to: ZoomTo::Field(30.0),
        },
    );
    let before = seen(&rig).sight;
    operator.until(&mut rig, 3.0, |_, _| false);
    let turned: f64 = before
        .iter()
        .zip(seen(&rig).sight)
        .map(|(a, b)| (a - b).powi(2))
        .sum();
    assert!(
        turned.sqrt() > 0.1,
        "the zoom has not ended the rate: {turned}"
    );
    act(
        &mut operator,
        &mut rig,
        PayloadAction::Record {
            switch: cucs::Switch::Off,
        },
    );
    assert!(!seen(&rig).recording);
    let stow = PayloadAction::Stow.messages(1).expect("messages").remove(0);
    assert_eq!(operator.send(&mut rig, stow), Delivery::Refused);
    let said = operator.texts.join("|");
    assert!(said.contains("retract"), "{said}");
}

#[test]
fn the_scriptable_station_flies_after_the_roll_over_of_2034() {
    let (mut rig, station) = rig();
    set_clock(&mut rig, 2_240_000_000.0);
    let mut operator = Operator::new(station.address);
    let taken = operator.send(&mut rig, orders::request_control());
    assert_eq!(taken, Delivery::CarriedOut, "{:?}", operator.texts);
    let launched = operator.send(&mut rig, orders::launch(20.0));
    assert_eq!(launched, Delivery::CarriedOut, "{:?}", operator.texts);
    assert!(operator.until(&mut rig, 60.0, |_, rig| -rig.truth().position.d > 18.0));
}
