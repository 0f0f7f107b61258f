//! An upload is one transaction: a refused one leaves nothing behind, the plan before it stays, the next begins clean.

use kit::bridge::{Rig, Setup, orders};
use mavlink_link::dialect::MavMissionType;
use stanag_msgs::enums::{AckType, AltitudeType, LoiterDurationUnits, MissionPlanMode};
use stanag_msgs::messages::{
    CurveSegment, CurveSegmentPaper, MissionTransferCommand, UaLoiterWaypoint,
};
use stanag_msgs::{Bam32, Id, Message, Scaled, Text};

const FAR_M: f64 = 60_000.0;

/// A curved leg whose first control point is so far north of home.
fn curve(p1: u16, p4: u16, north_m: f64) -> Message {
    let degrees = |(latitude, longitude): (f64, f64)| {
        (
            Some(Bam32::from_degrees(latitude)),
            Some(Bam32::from_degrees(longitude)),
        )
    };
    let (p2_latitude, p2_longitude) = degrees(orders::place(north_m, 20.0));
    let (p3_latitude, p3_longitude) = degrees(orders::place(60.0, 80.0));
    CurveSegment {
        p1_waypoint_no: Some(p1),
        p4_waypoint_no: Some(p4),
        p2_latitude,
        p2_longitude,
        p3_latitude,
        p3_longitude,
        ..CurveSegment::default()
    }
    .into()
}

/// The same as 50001, which a refusal of Edition 4's own message must not differ from.
fn paper_curve(p1: u16, p4: u16, cucs: Id, vehicle: Id) -> Message {
    let radians = |degrees: f64| Some(degrees.to_radians());
    let (p2, p3) = (orders::place(FAR_M, 20.0), orders::place(60.0, 80.0));
    CurveSegmentPaper {
        vehicle_id: Some(vehicle),
        cucs_id: Some(cucs),
        p1_waypoint_no: Some(p1),
        p4_waypoint_no: Some(p4),
        p2_latitude: radians(p2.0),
        p2_longitude: radians(p2.1),
        p3_latitude: radians(p3.0),
        p3_longitude: radians(p3.1),
        ..CurveSegmentPaper::default()
    }
    .into()
}

fn loiter(number: u16) -> Message {
    UaLoiterWaypoint {
        waypoint_number: Some(number),
        loiter_duration: Some(30),
        loiter_duration_units: Some(LoiterDurationUnits::Seconds),
        ..UaLoiterWaypoint::default()
    }
    .into()
}

/// From 10 to 20, straight.
fn straight() -> Vec<Message> {
    vec![
        orders::route(10).into(),
        orders::waypoint(10, 20, 40.0, 0.0, 20.0).into(),
        orders::waypoint(20, 0, 60.0, 100.0, 20.0).into(),
    ]
}

fn load(rig: &mut Rig) -> Option<AckType> {
    rig.carry_out(orders::load())
}

/// Loads a plan that must be refused.
fn refused(rig: &mut Rig, plan: Vec<Message>) {
    rig.send_plan(plan);
    let end = load(rig);
    let alerts = rig.station().alerts();
    assert_eq!(end, Some(AckType::Refused), "{alerts:?}");
    let why = alerts.last().expect("a reason");
    assert!(why.contains("this upload is discarded"), "{why}");
}

fn loaded(rig: &mut Rig, plan: Vec<Message>) {
    rig.send_plan(plan);
    let end = load(rig);
    let alerts = rig.station().alerts();
    assert_eq!(end, Some(AckType::CarriedOut), "{alerts:?}");
}

/// The plan as the bridge gives it back: numbers of waypoints, how many curves, how many loiters.
fn plan(rig: &mut Rig) -> (Vec<u16>, usize, usize) {
    let mark = rig.station().received.len();
    rig.done(orders::transfer(MissionPlanMode::Download));
    rig.run(1.0);
    let received = rig.station().received[mark..]
        .iter()
        .map(|(_, _, message)| message);
    let (mut numbers, mut curves, mut loiters) = (Vec::new(), 0, 0);
    for message in received {
        match message {
            Message::UaPositionWaypoint(waypoint) => numbers.extend(waypoint.waypoint_number),
            Message::CurveSegment(_) | Message::CurveSegmentPaper(_) => curves += 1,
            Message::UaLoiterWaypoint(_) => loiters += 1,
            _ => {}
        }
    }
    (numbers, curves, loiters)
}

/// Uploads that are refused, each for another reason.
fn flawed() -> Vec<Vec<Message>> {
    let (cucs, vehicle) = (kit::bridge::cucs(0), kit::bridge::vehicle_id(0));
    let low = |mut plan: Vec<Message>| {
        if let Some(Message::UaPositionWaypoint(last)) = plan.last_mut() {
            last.waypoint_to_altitude = Some(Scaled::saturating_from_si(0.0));
            last.waypoint_altitude_type = Some(AltitudeType::Barometric);
        }
        plan
    };
    let with = |mut plan: Vec<Message>, more: Message| {
        plan.push(more);
        plan
    };
    vec![
        with(straight(), curve(10, 20, FAR_M)),
        with(straight(), paper_curve(10, 20, cucs, vehicle)),
        // The other end of the curve never arrived.
        with(straight(), curve(20, 30, 40.0)),
        with(straight(), curve(70, 80, 40.0)),
        with(low(straight()), loiter(10)),
        vec![orders::route(77).into(), loiter(77)],
    ]
}

#[test]
fn after_a_refused_upload_the_plan_is_as_before_and_the_next_is_loaded_in_any_order() {
    let before = (vec![101, 102, 103, 104], 0, 0);
    let mut rig = Rig::ready();
    loaded(&mut rig, orders::square());
    for (case, upload) in flawed().into_iter().enumerate() {
        for backwards in [false, true] {
            let mut upload = upload.clone();
            if backwards {
                upload.reverse();
            }
            refused(&mut rig, upload);
            assert_eq!(plan(&mut rig), before, "{case} {backwards}");
            // The earlier plan is not loaded in its place: its CUCS would take it for the one that it has sent.
            assert_eq!(load(&mut rig), Some(AckType::Refused), "{case}");
        }
    }
    loaded(&mut rig, straight());
    let (numbers, curves, loiters) = plan(&mut rig);
    assert!(numbers.starts_with(&[10, 20]), "{numbers:?}");
    assert_eq!((curves, loiters), (0, 0));
}

#[test]
fn a_refusal_outlasts_a_restart_and_so_does_half_an_upload() {
    let mut rig = Rig::ready();
    loaded(&mut rig, orders::square());
    for upload in flawed() {
        let half = upload.len() / 2;
        rig.send_plan(upload[..half].to_vec());
        rig.restart_bridge();
        rig.run(3.0);
        refused(&mut rig, upload[half..].to_vec());
        rig.restart_bridge();
        rig.run(3.0);
        assert_eq!(plan(&mut rig), (vec![101, 102, 103, 104], 0, 0));
    }
    // A whole one, too, is loaded from both sides of a restart.
    rig.send_plan(straight()[..2].to_vec());
    rig.restart_bridge();
    rig.run(3.0);
    loaded(&mut rig, straight()[2..].to_vec());
}

#[test]
fn a_straight_route_with_the_numbers_of_a_curved_one_is_flown_straight() {
    let mut rig = Rig::ready();
    let mut curved = straight();
    curved.extend([curve(10, 20, 100.0), loiter(20)]);
    loaded(&mut rig, curved);
    assert_eq!(plan(&mut rig), (vec![10, 20], 1, 1));
    loaded(&mut rig, straight());
    assert_eq!(plan(&mut rig), (vec![10, 20], 0, 0));
    // A change of one waypoint, without 13001, leaves the rest of what was loaded.
    let mut curved = straight();
    curved.extend([curve(10, 20, 100.0), loiter(20)]);
    loaded(&mut rig, curved);
    let higher = orders::waypoint(20, 0, 60.0, 100.0, 30.0);
    loaded(&mut rig, vec![higher.into()]);
    assert_eq!(plan(&mut rig), (vec![10, 20], 1, 1));
}

#[test]
fn an_upload_that_the_link_failed_is_loaded_by_another_13000_or_dropped_by_another_upload() {
    let mut rig = Rig::ready_with(Setup::default());
    loaded(&mut rig, orders::square());
    let silent = |rig: &mut Rig, for_s: f64| {
        rig.mav.faults.loss = 1.0;
        rig.run(for_s);
    };
    let mut curved = straight();
    curved.push(curve(10, 20, 100.0));
    rig.send_plan(curved);
    silent(&mut rig, 8.0);
    assert_eq!(load(&mut rig), Some(AckType::Refused));
    rig.mav.faults.loss = 0.0;
    rig.run(8.0);
    assert_eq!(load(&mut rig), Some(AckType::CarriedOut));
    assert_eq!(plan(&mut rig).1, 1);

    let mut other = straight();
    other.extend([curve(10, 20, 100.0), curve(70, 80, 40.0)]);
    rig.send_plan(other);
    silent(&mut rig, 8.0);
    assert_eq!(load(&mut rig), Some(AckType::Refused));
    rig.mav.faults.loss = 0.0;
    rig.restart_bridge();
    rig.run(8.0);
    // Without the curve from 70 to 80, which no 13002 has described.
    loaded(&mut rig, orders::square());
}

/// A 13000 that loads nothing ends the messages before it, whatever is wrong with it: their 13001 may come last again.
#[test]
fn an_upload_is_sent_again_in_any_order_after_a_13000_that_could_load_nothing() {
    let mut rig = Rig::ready();
    let unknown = MissionTransferCommand {
        route_id: Some(Text::new("NOPE")),
        ..orders::load()
    };
    let no_mode = MissionTransferCommand {
        mission_plan_mode: None,
        ..orders::load()
    };
    for wrong in [
        orders::transfer(MissionPlanMode::from_raw(9)),
        unknown,
        no_mode,
    ] {
        // Its 13001 last.
        let upload: Vec<Message> = straight().into_iter().rev().collect();
        rig.send_plan(upload.clone());
        let end = rig.carry_out(wrong.clone());
        assert_eq!(end, Some(AckType::Refused), "{wrong:?}");
        loaded(&mut rig, upload);
        assert_eq!(plan(&mut rig), (vec![10, 20], 0, 0), "{wrong:?}");
    }
}

/// A station that asks for no answers, over a link that loses every fourth message: what has arrived of its route is loaded
/// whole or not at all, whether or not its 13001 has arrived.
#[test]
fn what_is_left_of_a_lost_upload_is_never_loaded_as_a_shorter_route() {
    let mut rig = Rig::ready();
    let (mut loaded, mut refused, mut without_13001) = (0, 0, 0);
    for (trial, first) in [1, 7].repeat(20).into_iter().enumerate() {
        rig.done(orders::transfer(MissionPlanMode::Clear));
        rig.dli.faults.loss = if trial < 2 { 0.0 } else { 0.25 };
        for number in first..first + 3 {
            let next = if number == first + 2 { 0 } else { number + 1 };
            let north = 40.0 * f64::from(number);
            rig.send_once(orders::waypoint(number, next, north, 0.0, 20.0));
        }
        if trial % 4 < 2 {
            rig.send_once(orders::route(first));
        }
        rig.run(0.2);
        rig.dli.faults.loss = 0.0;
        let end = rig.carry_out(orders::load());
        let aboard = rig.vehicles[0].vehicle().plan(MISSION).len();
        match end {
            Some(AckType::CarriedOut) => {
                loaded += 1;
                without_13001 += u32::from(trial % 4 >= 2);
                assert_eq!(aboard, 3, "trial {trial}");
            }
            _ => {
                refused += 1;
                assert_eq!(aboard, 0, "trial {trial}");
            }
        }
    }
    assert!(
        loaded > 3 && refused > 10 && without_13001 > 0,
        "{loaded} {refused} {without_13001}"
    );
    assert!(rig.station().has_alert("came without a 13001"));
}

/// Its 13001 lost, an upload is in no route, and the route of before must not be loaded in its place.
#[test]
fn an_upload_without_its_13001_does_not_load_the_route_of_before() {
    let mut rig = Rig::ready();
    loaded(&mut rig, orders::square());
    let aboard = |rig: &Rig| rig.vehicles[0].vehicle().plan(MISSION).to_vec();
    let before = aboard(&rig);
    let chain = || -> Vec<Message> {
        vec![
            orders::waypoint(3, 4, 30.0, 0.0, 20.0).into(),
            orders::waypoint(4, 0, 60.0, 0.0, 20.0).into(),
        ]
    };
    rig.send_plan(chain());
    assert_eq!(rig.carry_out(orders::load()), Some(AckType::Refused));
    assert!(rig.station().has_alert("waypoint 3 is in no route"));
    assert_eq!(aboard(&rig), before);
    // Repeated, the 13000 loads no other route either.
    assert_eq!(rig.carry_out(orders::load()), Some(AckType::Refused));
    let whole = std::iter::once(orders::route(3).into()).chain(chain());
    loaded(&mut rig, whole.collect());
    assert_eq!(aboard(&rig).len(), 2);
}

#[test]
fn a_changed_route_is_reported_where_its_13001_was_not_sent_again() {
    let mut rig = Rig::ready();
    loaded(&mut rig, orders::square());
    rig.done(orders::waypoint(103, 104, 0.0, 80.0, 30.0));
    assert!(!rig.station().has_alert("came without a 13001"));
    rig.done(orders::load());
    let text = "came without a 13001: they change the routes received before";
    assert!(rig.station().has_alert(text));
}

const MISSION: MavMissionType = MavMissionType::MAV_MISSION_TYPE_MISSION;
