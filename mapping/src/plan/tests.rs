use super::*;

const CUCS: Id = Id(0x1b00_00a0);
const VEHICLE: Id = Id(0x1b00_0101);

fn waypoint(number: u16, next: u16) -> Message {
    UaPositionWaypoint {
        waypoint_number: Some(number),
        next_waypoint: Some(next),
        ..UaPositionWaypoint::default()
    }
    .into()
}

fn curve(p1: u16, p4: u16) -> Message {
    CurveSegment {
        p1_waypoint_no: Some(p1),
        p4_waypoint_no: Some(p4),
        ..CurveSegment::default()
    }
    .into()
}

fn route(name: &str, initial: u16) -> Message {
    UaRoute {
        initial_waypoint_number: Some(initial),
        route_id: Some(stanag_msgs::Text::new(name)),
        ..UaRoute::default()
    }
    .into()
}

fn plan(messages: &[Message]) -> Plan {
    let mut plan = Plan::default();
    for message in messages {
        plan.store(message, CUCS, VEHICLE).expect("it is stored");
    }
    plan
}

fn ends(plan: &Plan, p1: u16) -> Vec<u16> {
    plan.curves_from(p1).map(|(p4, _)| p4).collect()
}

#[test]
fn a_waypoint_that_leads_elsewhere_takes_the_curve_of_its_old_leg_away_whichever_comes_first() {
    let before = [waypoint(1, 2), waypoint(2, 3), waypoint(3, 0), curve(1, 2)];
    let mut curve_first = plan(&before);
    for message in [curve(1, 3), waypoint(1, 3)] {
        curve_first.store(&message, CUCS, VEHICLE).expect("stored");
    }
    let mut waypoint_first = plan(&before);
    for message in [waypoint(1, 3), curve(1, 3)] {
        waypoint_first
            .store(&message, CUCS, VEHICLE)
            .expect("stored");
    }
    assert_eq!(
        (ends(&curve_first, 1), ends(&waypoint_first, 1)),
        (vec![3], vec![3])
    );
    // The same leg, sent again, keeps its curve.
    let mut same = plan(&before);
    same.store(&waypoint(1, 2), CUCS, VEHICLE).expect("stored");
    assert_eq!(ends(&same, 1), [2]);
}

#[test]
fn beside_a_route_aboard_stand_the_other_routes_and_nothing_of_earlier_plans() {
    let mut plan = plan(&[
        route("M", 1),
        waypoint(1, 2),
        waypoint(2, 0),
        curve(1, 2),
        route("C", 7),
        waypoint(7, 0),
        waypoint(90, 0),
    ]);
    let main = plan.route_named("M").cloned().expect("it is there");
    let aboard = plan.part(&main);
    plan.store(&waypoint(2, 90), CUCS, VEHICLE).expect("stored");
    let whole = plan.beside(&aboard);
    assert_eq!(whole.waypoint(2).and_then(|one| one.next_waypoint), Some(0));
    assert!(whole.waypoint(7).is_some() && whole.waypoint(90).is_none());
    assert_eq!(whole.messages_about(1).count(), 2);
    let names: Vec<_> = whole.routes().iter().map(|one| one.route_id).collect();
    assert_eq!(
        names,
        [
            Some(stanag_msgs::Text::new("C")),
            Some(stanag_msgs::Text::new("M"))
        ]
    );
}

#[test]
fn routes_without_a_name_are_kept_apart_by_their_type() {
    let unnamed = |initial, kind, id: Option<&str>| -> Message {
        UaRoute {
            initial_waypoint_number: Some(initial),
            route_type: Some(kind),
            route_id: id.map(stanag_msgs::Text::new),
            ..UaRoute::default()
        }
        .into()
    };
    let mut plan = plan(&[
        unnamed(1, RouteType::Flight, None),
        unnamed(7, RouteType::ContingencyA, Some("")),
    ]);
    let initial = |plan: &Plan, kind| {
        let route = plan.route_of_type(kind);
        route.and_then(|route| route.initial_waypoint_number)
    };
    assert_eq!(initial(&plan, RouteType::Flight), Some(1));
    assert_eq!(initial(&plan, RouteType::ContingencyA), Some(7));
    // The same once more, and its end.
    for (number, left) in [(9, Some(9)), (0, None)] {
        let message = unnamed(number, RouteType::ContingencyA, None);
        plan.store(&message, CUCS, VEHICLE).expect("stored");
        assert_eq!(initial(&plan, RouteType::ContingencyA), left);
        assert_eq!(initial(&plan, RouteType::Flight), Some(1));
    }
}

#[test]
fn a_route_that_is_cleared_takes_only_its_own_waypoints_with_it() {
    let mut plan = plan(&[
        route("M", 1),
        waypoint(1, 2),
        waypoint(2, 5),
        curve(1, 2),
        route("C", 7),
        waypoint(7, 5),
        waypoint(5, 0),
    ]);
    plan.clear_route("nobody's");
    assert_eq!(plan.messages().count(), 7);
    plan.clear_route("M");
    let left: Vec<_> = [1, 2, 5, 7]
        .into_iter()
        .filter(|number| plan.waypoint(*number).is_some())
        .collect();
    assert_eq!(left, [5, 7]);
    assert_eq!(plan.messages().count(), 3);
}

#[test]
fn a_curve_whose_stamp_is_no_number_is_not_stored() {
    // It would never be the same as itself, and mode 11 would load its route for ever.
    let curve = CurveSegmentPaper {
        time_stamp: Some(f64::NAN),
        vehicle_id: Some(VEHICLE),
        cucs_id: Some(CUCS),
        p1_waypoint_no: Some(1),
        p4_waypoint_no: Some(2),
        ..CurveSegmentPaper::default()
    };
    let stored = Plan::default().store(&curve.into(), CUCS, VEHICLE);
    assert!(matches!(stored, Err(StoreError::Stamp(_))), "{stored:?}");
}

#[test]
fn a_loop_is_a_part_of_its_route_once() {
    let plan = plan(&[route("M", 1), waypoint(1, 2), waypoint(2, 1)]);
    let part = plan.part(&plan.routes()[0]);
    assert_eq!(part.messages().count(), 3);
}
