//! The sixteen steps of `handle_timeout`, in their order.

use super::*;
use mavlink_link::service::command;

/// Steps 1, 2, 4, 8, 9, 11, 12, 13 and 15: the controller is lost while much else is under way.
#[test]
fn one_timeout_after_the_controller_is_lost() {
    let mut scene = Scene::controlled(px4_sim::Config::default());
    scene.give(B, request(0x01));
    scene.carry_out(configuration());
    for message in line(10, 20.0) {
        scene.carry_out(message);
    }
    scene.carry_out(orders::launch(20.0));
    // Refused, since nothing is loaded: the reason stands for 15 s.
    scene.give(A, orders::mode(Mode::Waypoint));
    scene.run(12.0);
    // Seen by one timeout, and not for long enough to be raised.
    scene.vehicle.vehicle_mut().set_health_faults(HealthFaults {
        battery: Some(5),
        ..HealthFaults::default()
    });
    scene.run(1.4);
    // The end of the load is seen by the vehicle's datagrams, the mode that it makes available by the next timeout.
    scene.timeouts = false;
    scene.give(A, orders::load());
    scene.ended("A 14000 Complete");
    scene.cut = true;
    scene.give(A, orders::transfer(MissionPlanMode::Download));
    scene.give(A, ping());
    let trace = scene.jump(3.2);
    assert_trace(
        &trace,
        &[
            // 2: the controller is lost.
            "disk append audit-1b000101.log Power",
            "disk save authority-1b000101.json Power",
            // 2: the action after the loss, as a restart must find it.
            "disk save loss-action-1b000101.json Power",
            // 13: the answer to the download.
            "disk append commands-1b0000a0.log Process",
            // 2: what it still holds, that it is lost, and how the handover ended.
            "A 2 granted 0x01",
            "A 16000 Emergency Comms 10 new",
            "B 16000 Emergency Comms 10 new",
            "A 35000 Failed",
            "B 35000 Failed",
            // 4 and 8: a mode can be commanded now.
            "A 44003",
            // 4: the Mission ID is another since the load.
            "A 3",
            "B 3",
            // 9: the ping was in vain.
            "A 17000 50014 Refused",
            "A 16000 Caution VsmStatus 11 new",
            // 11: the battery.
            "A 16000 Emergency PropulsionEnergy 12 new",
            "B 16000 Emergency PropulsionEnergy 12 new",
            // 12: the refusal of mode 11 has stood for 15 s.
            "A 16000 Cleared VsmStatus 9",
            // 13: the rest of the download.
            "A 13002",
            "A 13002",
            "A 13002",
            "A 17000 13000 CarriedOut",
            "A 14000 Complete",
            // 15: what is pushed.
            "A 3001",
            "A 3002",
            "A 4000",
            "A 4001",
            "A 16002",
            "B 3001",
            "B 3002",
            "B 4000",
            "B 4001",
            "B 16002",
            // 1: the link.
            "mav HEARTBEAT",
            "mav TIMESYNC",
            // 2: the action after the loss.
            "mav MAV_CMD_DO_SET_MODE 4 5",
        ],
    );
}

/// Step 9: what was requested of the vehicle ends in vain, the software before the pings.
#[test]
fn one_timeout_after_requests_that_nothing_answered() {
    let mut scene = Scene::new(px4_sim::Config::default());
    // Without heartbeats its silence does not count.
    scene.give(A, request(0x01));
    scene.run(0.3);
    scene.cut = true;
    scene.give(A, ping());
    scene.give(A, software());
    let trace = scene.jump(3.05);
    assert_trace(
        &trace,
        &[
            // 9: what is known of the software, then that the ping was in vain.
            "A 50013",
            "A 17000 50014 Refused",
            "A 16000 Caution VsmStatus 6 new",
            // 15: what is pushed.
            "A 3001",
            "A 3002",
            "A 4000",
            "A 4001",
            "A 16002",
            // 1: the link, and the request for the software once more.
            "mav HEARTBEAT",
            "mav MAV_CMD_REQUEST_MESSAGE 148",
        ],
    );
}

/// Steps 2, 5, 6, 10, 15 and 16: the VSM was restarted in the middle of a launch, with a new fence in its
/// configuration, and the vehicle holds another mission than the one that was loaded last.
#[test]
fn one_timeout_after_a_restart_in_the_middle_of_a_launch() {
    let mut scene = Scene::controlled(px4_sim::Config::default());
    for message in line(2, 20.0) {
        scene.carry_out(message);
    }
    scene.carry_out(orders::load());
    let of_first = scene.disk.records.clone();
    for message in line(3, 30.0) {
        scene.carry_out(message);
    }
    scene.carry_out(orders::load());
    let loaded = |name: &str| name.starts_with("aboard") || name.starts_with("chosen");
    let of_first = of_first.into_iter().filter(|(name, _)| loaded(name));
    scene.disk.records.extend(of_first);
    let unlearnt = |name: &str| name.starts_with("link-id");
    scene.disk.records.retain(|name, _| !unlearnt(name));
    scene.give(A, orders::launch(20.0));
    let up = scene.until(20.0, |scene, _| !scene.vehicle.vehicle().truth().landed);
    assert!(up.is_some(), "it takes off");
    scene.timeouts = false;
    let fence =
        "[[vehicle.area]]\nkeep = \"in\"\ncentre = [47.3977434, 8.5455939]\nradius_m = 900.0\n";
    scene.bridge = start(scene.clock, fence, &mut scene.disk);
    scene.run(4.5);
    let trace = scene.jump(0.0);
    assert_trace(
        &trace,
        &[
            // 2: that the holder sends heartbeats is stored again.
            "disk save authority-1b000101.json Power",
            // 10: the vehicle may hold areas of this VSM.
            "disk save areas-1b000101.json Process",
            // 16: the vehicle's link id.
            "disk save link-id-1b000101.json Answered",
            // 5: the vehicle holds another mission.
            "A 16000 Warning Comms 5 new",
            // 6: the launch that was cut off has taken it up.
            "A 16000 Warning Comms 6 new",
            // 15: what is pushed.
            "A 3001",
            "A 3002",
            "A 4000",
            "A 4001",
            "A 16002",
            // 1: the link, and the first rate.
            "mav HEARTBEAT",
            "mav TIMESYNC",
            "mav MAV_CMD_SET_MESSAGE_INTERVAL 436",
            // 10: the fence.
            "mav MISSION_COUNT",
        ],
    );
}

/// Steps 1, 3, 7, 8 and 15: another station owns the vehicle, a configuration is being sent, and then the vehicle falls
/// silent.
#[test]
fn timeouts_while_another_station_owns_the_vehicle() {
    let mut scene = Scene::new(operator_control());
    // The ceiling is stored 10 s ahead: until some time before it is stored again.
    let stores_clock = |_: &Scene, trace: &Trace| trace.iter().any(|line| line.starts_with(CLOCK));
    scene.until(11.0, stores_clock).expect("once in 10 s");
    scene.run(7.0);
    let ask = command::long(
        Node::new(1, 1),
        MavCmd::MAV_CMD_REQUEST_OPERATOR_CONTROL,
        [1.0, 0.0, 10.0, 255.0],
    );
    scene.vehicle.vehicle_mut().handle_message(GROUND, &ask);
    scene.run(1.5);
    scene.give(A, orders::request_control());
    scene.run(0.2);
    scene.cut = true;
    scene.give(A, configuration());
    let trace = scene.jump(2.1);
    // 1: the signing clock is stored before anything is signed beyond it.
    assert!(trace[0].starts_with(CLOCK), "{trace:#?}");
    assert_trace(
        &shortened(&trace),
        &[
            // 8: the next burst.
            "A 16 configuration answers",
            // 15: what is pushed.
            "A 3001",
            "A 3002",
            "A 4000",
            "A 4001",
            "A 16002",
            // 1: the link.
            "mav HEARTBEAT",
            // 7: what a step submits is sent by the same call.
            "mav MAV_CMD_REQUEST_OPERATOR_CONTROL 1",
        ],
    );
    let trace = scene.jump(2.1);
    assert_trace(
        &shortened(&trace),
        &[
            // 3: the vehicle is silent, and its state is reported on change.
            "A 16000 Warning Comms 8 new",
            "A 3001",
            "A 3002",
            // 8: the next burst.
            "A 16 configuration answers",
            // 15: what is pushed, of a silent vehicle less.
            "A 3001",
            "A 3002",
            "A 16002",
            // 1: the link.
            "mav HEARTBEAT",
            // 1: the repetition of what 7 sent in the timeout before.
            "mav MAV_CMD_REQUEST_OPERATOR_CONTROL 1",
        ],
    );
}

/// Steps 1, 3, 14 and 15: a load fails, and the handover that waited for its end is completed by the same timeout.
#[test]
fn one_timeout_that_ends_a_load_and_completes_a_handover() {
    let mut scene = Scene::controlled(px4_sim::Config::default());
    for message in line(2, 20.0) {
        scene.carry_out(message);
    }
    scene.cut = true;
    scene.give(A, orders::load());
    let offer = scene.give(A, hand_over(B));
    assert_trace(
        &offer,
        &[
            "disk append commands-1b0000a0.log Process",
            "disk save authority-1b000101.json Power",
            "A 35000 InProgress",
            "A 16000 Caution VsmStatus 6 new",
            "A 17000 4 Received",
        ],
    );
    let acceptance = scene.give(B, hand_over(B));
    assert_trace(
        &acceptance,
        &[
            "disk append commands-1b0000a1.log Process",
            "disk save authority-1b000101.json Power",
            "A 35000 InProgress",
            "B 35000 InProgress",
            "A 16000 Caution VsmStatus 7 new",
            "B 16000 Caution VsmStatus 7 new",
            "B 17000 4 Received",
        ],
    );
    let trace = scene.ended("A 14000 Aborted");
    assert_trace(
        &trace,
        &[
            // 3: how the upload ended, and the answer to the load.
            "disk save plan-1b000101.json Process",
            "disk remove plan-1b000101.log Power",
            "disk append commands-1b0000a0.log Process",
            // 14: the handover, and the answers to both parties.
            "disk append audit-1b000101.log Power",
            "disk save authority-1b000101.json Power",
            "disk append commands-1b0000a0.log Process",
            "disk append commands-1b0000a1.log Process",
            // Control has changed: what A had sent is dropped.
            "disk save plan-1b000101.json Process",
            // 3: the load has failed.
            "A 14000 Aborted",
            "A 17000 13000 Refused",
            "A 16000 Caution VsmStatus 9 new",
            // 14: the rights of both, the end of the handover, and the answers that waited for it.
            "A 2 granted 0x03",
            "B 2 granted 0x0d",
            "B 5",
            "A 35000 Successful",
            "B 35000 Successful",
            "A 16000 Caution VsmStatus 10 new",
            "B 16000 Caution VsmStatus 10 new",
            "A 2 granted 0x03",
            "A 17000 4 CarriedOut",
            "B 2 granted 0x0d",
            "B 17000 4 CarriedOut",
            // 14: what a new listener needs.
            "B 3",
            "B 16000 Nominal Comms 4 new",
            "B 16000 Warning Comms 8 new",
            // 15: what is pushed.
            "A 16002",
            "B 3001",
            "B 3002",
            "B 16002",
            // 14: what A had sent is dropped.
            "A 16000 Nominal VsmStatus 11 new",
            "B 16000 Nominal VsmStatus 11 new",
            // 1: the link, and the end of the transfer.
            "mav HEARTBEAT",
            "mav MISSION_ACK",
        ],
    );
}
