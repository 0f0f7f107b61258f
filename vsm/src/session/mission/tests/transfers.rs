//! Downloads, and what a cancellation ends.

use super::*;

#[test]
fn a_download_sends_eight_messages_and_pauses() {
    let (mut world, mut mission) = ready();
    for number in 10..20 {
        let waypoint = UaPositionWaypoint {
            waypoint_number: Some(number),
            ..UaPositionWaypoint::default()
        };
        command(&mut world, &mut mission, waypoint);
    }
    stored(&mut world, &mut mission);
    world.sent_to(0);
    command(&mut world, &mut mission, transfer(Mode::Download));
    let plan = |messages: Vec<Message>| {
        let plan = |message: &&Message| matches!(message.id(), 13001 | 13002);
        messages.iter().filter(plan).count()
    };
    assert_eq!(plan(world.sent_to(0)), 8);
    handle(&mut world, &mut mission, Input::AdvanceDownload);
    assert_eq!(plan(world.sent_to(0)), 0);
    let due = mission.poll_timeout().expect("a pause");
    world.advance(due.saturating_sub(world.now.mono));
    handle(&mut world, &mut mission, Input::AdvanceDownload);
    assert_eq!(plan(world.sent_to(0)), 5);
    assert_eq!(mission.poll_timeout(), None);
}

#[test]
fn a_download_ends_with_the_removal_of_its_station() {
    for removed in [true, false] {
        let (mut world, mut mission) = ready();
        for number in 10..20 {
            let waypoint = UaPositionWaypoint {
                waypoint_number: Some(number),
                ..UaPositionWaypoint::default()
            };
            command(&mut world, &mut mission, waypoint);
        }
        stored(&mut world, &mut mission);
        command(&mut world, &mut mission, transfer(Mode::Download));
        match removed {
            true => world.stations[0].removed = true,
            false => world.stations.clear(),
        }
        let due = mission.poll_timeout().expect("a pause");
        world.advance(due.saturating_sub(world.now.mono));
        handle(&mut world, &mut mission, Input::AdvanceDownload);
        assert_eq!(mission.poll_timeout(), None);
    }
}

#[test]
fn a_cancel_ends_a_download_and_what_was_sent_is_not_loaded_by_the_next_13000() {
    let (mut world, mut mission) = ready();
    stored(&mut world, &mut mission);
    for number in 10..30 {
        let waypoint = UaPositionWaypoint {
            waypoint_number: Some(number),
            ..UaPositionWaypoint::default()
        };
        command(&mut world, &mut mission, waypoint);
    }
    stored(&mut world, &mut mission);
    command(&mut world, &mut mission, transfer(Mode::Download));
    command(
        &mut world,
        &mut mission,
        UaPositionWaypoint {
            waypoint_number: Some(2),
            next_waypoint: Some(10),
            ..UaPositionWaypoint::default()
        },
    );
    world.sent_to(0);
    command(&mut world, &mut mission, transfer(Mode::Cancel));
    let (progress, texts) = reports(&mut world);
    assert_eq!(progress, [(Status::Aborted, 0), (Status::Complete, 100)]);
    assert!(texts.contains("cancelled"), "{texts}");
    assert_eq!(mission.poll_timeout(), None, "no more of the download");
    command(&mut world, &mut mission, transfer(Mode::Load));
    let (progress, texts) = reports(&mut world);
    assert_eq!(progress, [(Status::Aborted, 0)]);
    assert!(texts.contains("send the whole route"), "{texts}");
    assert!(!mission.transfers.is_running());
    assert_eq!(
        mission
            .store
            .plan()
            .waypoint(2)
            .and_then(|w| w.next_waypoint),
        Some(0)
    );
}

#[test]
fn a_cancelled_clearing_leaves_no_route_that_counts_as_uploaded() {
    let (mut world, mut mission) = ready();
    let items = compiled(&mut world, &mission);
    command(&mut world, &mut mission, transfer(Mode::Load));
    let id = transferred(&mut world, &mut mission, MISSION, &items);
    world.vehicle.telemetry.mission = named(id, 0);
    handle(&mut world, &mut mission, Input::Advance);
    assert!(mission.store.uploaded.is_some());

    command(&mut world, &mut mission, transfer(Mode::Clear));
    assert_eq!(world.services.missions.busy(), Some(Operation::Clear));
    world.sent_to(0);
    command(&mut world, &mut mission, transfer(Mode::Cancel));
    let (progress, _) = reports(&mut world);
    assert_eq!(progress, [(Status::Aborted, 0), (Status::Complete, 100)]);
    // MISSION_CLEAR_ALL was sent: the vehicle may hold nothing. What was loaded can be uploaded again.
    assert!(mission.store.uploaded.is_none());
    assert!(mission.store.loaded.is_some());
    let mut after = Mission::new(Vec::new(), Vec::new());
    world.act(|_, _, effects| after.store.restore(effects).expect("it is read"));
    assert!(after.store.uploaded.is_none());
}
