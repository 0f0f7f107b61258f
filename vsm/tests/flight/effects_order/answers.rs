//! A right, a plan and a command are on disk before they are answered.

use super::*;

#[test]
fn a_grant_is_audited_and_stored_before_it_is_answered() {
    let mut scene = Scene::new(px4_sim::Config::default());
    let trace = scene.give(A, request(0x0d));
    assert_trace(
        &trace,
        &[
            "disk append commands-1b0000a0.log Process",
            "disk append audit-1b000101.log Power",
            "disk save authority-1b000101.json Power",
            // The answer to the command, before it is sent.
            "disk append commands-1b0000a0.log Process",
            // What a new listener needs, then what it holds.
            "A 3",
            "A 16000 Nominal Comms 4 new",
            "A 2 granted 0x0d",
            "A 17000 1 CarriedOut",
        ],
    );
}

#[test]
fn levels_that_command_nothing_need_not_outlive_a_power_cut() {
    let mut scene = Scene::new(px4_sim::Config::default());
    let trace = scene.give(A, request(0x01));
    assert_trace(
        &trace,
        &[
            "disk append commands-1b0000a0.log Process",
            "disk append audit-monitors-1b000101.log Answered",
            "disk save authority-1b000101.json Answered",
            "disk append commands-1b0000a0.log Process",
            "A 3",
            "A 16000 Nominal Comms 4 new",
            "A 2 granted 0x01",
            "A 17000 1 CarriedOut",
        ],
    );
}

#[test]
fn a_grant_that_cannot_be_audited_is_refused() {
    let mut scene = Scene::new(px4_sim::Config::default());
    scene.disk.full = Some("audit");
    let trace = scene.give(A, request(0x0d));
    assert_trace(
        &trace,
        &[
            "disk append commands-1b0000a0.log Process",
            // Its record is not tried.
            "disk append audit-1b000101.log Power FAILS",
            "disk append commands-1b0000a0.log Process",
            "A 2 granted 0x00",
            "A 16000 Caution VsmStatus 7 new",
            "A 17000 1 Refused",
        ],
    );
}

#[test]
fn a_grant_that_is_audited_and_not_stored_is_taken_back_in_the_audit_log() {
    let mut scene = Scene::new(px4_sim::Config::default());
    scene.disk.full = Some("authority");
    let trace = scene.give(A, request(0x0d));
    assert_trace(
        &trace,
        &[
            "disk append commands-1b0000a0.log Process",
            "disk append audit-1b000101.log Power",
            "disk save authority-1b000101.json Power FAILS",
            "disk append audit-1b000101.log Power",
            "disk append commands-1b0000a0.log Process",
            "A 2 granted 0x00",
            "A 16000 Caution VsmStatus 7 new",
            "A 17000 1 Refused",
        ],
    );
    let audit = String::from_utf8_lossy(&scene.disk.records["audit-1b000101.log"]);
    let last = audit.lines().last().expect("a line");
    assert!(last.contains("not kept"), "{last}");
}

#[test]
fn a_command_log_that_cannot_be_written_is_reported_and_stops_nothing() {
    let mut scene = Scene::new(px4_sim::Config::default());
    scene.disk.full = Some("commands");
    let trace = scene.give(A, request(0x0d));
    assert_trace(
        &trace,
        &[
            "disk append commands-1b0000a0.log Process FAILS",
            "disk append audit-1b000101.log Power",
            "disk save authority-1b000101.json Power",
            "disk append commands-1b0000a0.log Process FAILS",
            "A 3",
            "A 16000 Nominal Comms 4 new",
            "A 16000 Warning VsmStatus 6 new",
            "A 2 granted 0x0d",
            "A 17000 1 CarriedOut",
        ],
    );
    // The warning is raised once, and cleared before the next command is answered.
    let command = scene.give(A, orders::mode(Mode::Loiter));
    assert_trace(
        &command,
        &[
            "disk append commands-1b0000a0.log Process FAILS",
            "disk save repeated-1b000101.json Process",
            "A 17000 2016 Received",
            "mav MAV_CMD_DO_SET_MODE 4 3",
        ],
    );
    scene.disk.full = None;
    let corner = scene.give(A, corner());
    assert_trace(
        &corner,
        &[
            "disk append commands-1b0000a0.log Process",
            "disk save areas-1b000101.json Process",
            "disk append commands-1b0000a0.log Process",
            "A 16000 Cleared VsmStatus 6",
            "A 17000 50016 CarriedOut",
        ],
    );
}

#[test]
fn a_plan_and_a_command_are_on_disk_before_they_are_answered() {
    let mut scene = Scene::controlled(px4_sim::Config::default());
    for (number, message) in line(2, 20.0).into_iter().enumerate() {
        let answer = format!("A 17000 {} CarriedOut", message.id());
        let trace = scene.give(A, message);
        // The first message of a plan begins its log, the others are appended.
        let stored = match number {
            0 => "disk save plan-1b000101.log Process",
            _ => "disk append plan-1b000101.log Process",
        };
        assert_trace(
            &trace,
            &[
                "disk append commands-1b0000a0.log Process",
                stored,
                "disk append commands-1b0000a0.log Process",
                &answer,
            ],
        );
    }
    let area = scene.give(A, corner());
    assert_trace(
        &area,
        &[
            "disk append commands-1b0000a0.log Process",
            "disk save areas-1b000101.json Process",
            "disk append commands-1b0000a0.log Process",
            "A 17000 50016 CarriedOut",
        ],
    );
    let load = scene.give(A, orders::load());
    assert_trace(
        &load,
        &[
            "disk append commands-1b0000a0.log Process",
            // That the upload has ended here.
            "disk append plan-1b000101.log Process",
            "A 17000 13000 Received",
            "A 14000 InProgress",
            "A 14000 InProgress",
            "mav MISSION_COUNT",
        ],
    );
    let loaded = scene.ended("A 17000 13000 CarriedOut");
    assert_trace(
        &loaded,
        &[
            "disk save chosen-1b000101.json Power",
            "disk save aboard-1b000101.json Power",
            // What is loaded is a good moment to fold the plan's log into its record.
            "disk save plan-1b000101.json Process",
            "disk remove plan-1b000101.log Power",
            "disk append commands-1b0000a0.log Process",
            // That AGL is flown above home, once.
            "A 16000 Nominal VsmStatus 6 new",
            "A 17000 13000 CarriedOut",
            "A 14000 Complete",
        ],
    );
    let hold = scene.give(A, orders::mode(Mode::Loiter));
    assert_trace(
        &hold,
        &[
            "disk append commands-1b0000a0.log Process",
            "disk save repeated-1b000101.json Process",
            "A 17000 2016 Received",
            "mav MAV_CMD_DO_SET_MODE 4 3",
        ],
    );
    let held = scene.ended("A 17000 2016 CarriedOut");
    assert_trace(
        &held,
        &[
            "disk append commands-1b0000a0.log Process",
            "disk save repeated-1b000101.json Process",
            "A 17000 2016 CarriedOut",
        ],
    );
}

#[test]
fn a_plan_that_cannot_be_stored_is_refused_and_unknown() {
    let mut scene = Scene::controlled(px4_sim::Config::default());
    for message in line(2, 20.0) {
        scene.carry_out(message);
    }
    scene.disk.full = Some("plan");
    let waypoint = scene.give(A, orders::waypoint(103, 0, 60.0, 0.0, 30.0));
    assert_trace(
        &waypoint,
        &[
            "disk append commands-1b0000a0.log Process",
            "disk append plan-1b000101.log Process FAILS",
            "disk append commands-1b0000a0.log Process",
            "A 17000 13002 Refused",
            "A 16000 Caution VsmStatus 6 new",
        ],
    );
    let mut one = orders::transfer(MissionPlanMode::DownloadWaypoint);
    one.waypoint_number = Some(103);
    let download = scene.give(A, one);
    assert!(
        download.contains(&"A 17000 13000 Refused".to_owned()),
        "{download:#?}"
    );
    scene.disk.full = Some("areas");
    let area = scene.give(A, corner());
    assert_trace(
        &area,
        &[
            "disk append commands-1b0000a0.log Process",
            "disk save areas-1b000101.json Process FAILS",
            "disk append commands-1b0000a0.log Process",
            "A 17000 50016 Refused",
            "A 16000 Caution VsmStatus 8 new",
        ],
    );
    scene.disk.full = Some("aboard");
    scene.give(A, orders::load());
    let load = scene.ended("A 17000 13000 Refused");
    assert_trace(
        &load,
        &[
            "disk save chosen-1b000101.json Power",
            "disk save aboard-1b000101.json Power FAILS",
            // The upload stays for another 13000, and gives way to another upload.
            "disk save plan-1b000101.json Process",
            "disk remove plan-1b000101.log Power",
            "disk append commands-1b0000a0.log Process",
            // That AGL is flown above home, once.
            "A 16000 Nominal VsmStatus 9 new",
            "A 14000 Aborted",
            "A 17000 13000 Refused",
            "A 16000 Caution VsmStatus 10 new",
        ],
    );
}
