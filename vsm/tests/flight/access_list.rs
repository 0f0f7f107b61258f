//! The access list: what a CUCS may do is what the configuration and the list give it, by the list that is newest.

use std::num::NonZeroU64;
use std::time::Duration;

use kit::bridge::{Rig, Setup, StationGuard, VSM, access_key, cucs, guard_key, orders, vehicle_id};
use mavlink_link::signing::{KeyId, SigningKey};
use mavlink_link::store::Disk as _;
use serde_json::Value;
use stanag_msgs::enums::{
    AckType, ContingencyAction, ContingencyCause, FlightPathControlMode as Mode, LoiBitmap,
    RequestedAccess,
};
use stanag_msgs::messages::{
    Contingency, CucsAuthorisationRequest, ParameterSetCommand,
    PositiveHandoverAuthorisationRequest,
};
use stanag_msgs::{Message, Text};
use vsm::session::{AccessEntry, AccessGroup as Group, AccessKey, AccessList};

const HOUR: u64 = 3_600;

/// A list for station 0 and vehicle 0: these groups, for so many seconds from the start of the test.
fn list(version: u64, groups: &[Group], seconds: Option<u64>) -> String {
    list_of(version, groups, seconds, guard_key(cucs(0)).id())
}

fn list_of(version: u64, groups: &[Group], seconds: Option<u64>, key: KeyId) -> String {
    let mut list = AccessList::new(VSM);
    for group in groups {
        let until = seconds.map(|seconds| kit::clock::START.as_secs() + seconds);
        let entry = AccessEntry {
            cucs: cucs(0),
            vehicle: vehicle_id(0),
            group: *group,
            key,
            until: until.and_then(NonZeroU64::new),
        };
        list.grant(entry).expect("there is room");
    }
    list.signed(version, &AccessKey::new(&access_key()))
}

/// Stations with a guard each, and this list.
fn rig(stations: u8, list: String) -> Rig {
    let mut rig = Rig::new(Setup {
        stations,
        ..Setup::default()
    });
    let mut text = rig.text.clone();
    for index in 0..usize::from(stations) {
        let id = format!("id = \"{}\"\n", cucs(index));
        text = text.replace(&id, &format!("{id}guard = {{ key_file = \"a.key\" }}\n"));
    }
    text += "[access]\nlist = \"access.list\"\nkey_file = \"access.key\"\n";
    rig.access = list;
    rig.restart_with(&text);
    rig.run(9.0);
    rig
}

fn renew(rig: &mut Rig, list: String) -> Result<Vec<String>, String> {
    rig.access = list;
    let text = rig.text.clone();
    rig.reload(&text).map(|report| report.applied)
}

fn audited(rig: &Rig) -> String {
    let name = format!("audit-{:08x}.log", vehicle_id(0).0);
    let log = rig.store.read(&name, u64::MAX);
    let log = log.expect("it can be read").expect("it is there");
    String::from_utf8_lossy(&log).into_owned()
}

fn status(rig: &Rig) -> Value {
    let bridge = rig.bridge.as_ref().expect("it runs");
    let status = bridge.status(String::new(), rig.now().mono);
    serde_json::to_value(status).expect("JSON")
}

fn refused(rig: &Rig, name: &str) -> u64 {
    status(rig)["refused"][name].as_u64().unwrap_or(0)
}

fn held(rig: &Rig) -> u64 {
    status(rig)["rights"][0]["holds"].as_u64().expect("a row")
}

/// The message is refused, counted by this name, and its sender is sent the reason.
fn is_refused(rig: &mut Rig, message: impl Into<Message>, name: &str, why: &str) {
    let before = refused(rig, name);
    assert_eq!(rig.carry_out(message), Some(AckType::Refused));
    assert_eq!(refused(rig, name), before + 1, "{name}");
    rig.run(0.5);
    let alerts = rig.station().alerts();
    assert!(alerts.iter().any(|text| text.contains(why)), "{alerts:?}");
}

fn land() -> Message {
    orders::mode(Mode::AutolandEngage).into()
}

fn loiter() -> Message {
    orders::mode(Mode::Loiter).into()
}

const OUTSIDE: &str = "access list: outside its groups";
const ENDED: &str = "access list: entry has ended";
const OTHER_KEY: &str = "access list: another guard key";

#[test]
fn a_station_commands_what_its_groups_have_and_nothing_else() {
    let mut rig = rig(2, list(1, &[Group::Fly, Group::Launch], None));
    let end = rig.carry_out(orders::request_control());
    // LOI 3 was requested too, and no entry gives it.
    assert_eq!(end, Some(AckType::Refused));
    let levels = LoiBitmap::LOI2
        .union(LoiBitmap::LOI4)
        .union(LoiBitmap::LOI5);
    assert_eq!(held(&rig), u64::from(levels.raw()));
    rig.take_off(20.0);
    is_refused(
        &mut rig,
        orders::route(101),
        OUTSIDE,
        "does not give it this group",
    );
    // Another station, which the configuration gives everything and the list nothing.
    let asked = rig.send_as(1, 0, orders::request_control());
    assert_eq!(rig.end_as(1, asked), Some(AckType::Refused));
    assert_eq!(status(&rig)["rights"][1]["may_hold"], 0);
    rig.done(land());
}

#[test]
fn what_a_newer_list_takes_away_ends_at_once_and_an_older_one_brings_nothing_back() {
    let all = [Group::Fly, Group::Launch];
    let mut rig = rig(1, list(1, &all, None));
    rig.carry_out(orders::request_control());
    rig.take_off(20.0);
    let applied = renew(&mut rig, list(2, &[Group::Launch], None)).expect("it is newer");
    assert_eq!(applied, ["access list version 1 -> 2, 1 entries"]);
    rig.run(1.0);
    let levels = LoiBitmap::LOI2.union(LoiBitmap::LOI5);
    assert_eq!(held(&rig), u64::from(levels.raw()));
    is_refused(&mut rig, loiter(), "without the right", "it needs LOI 4");
    // The first list again: while it runs, and at a start.
    let fault = renew(&mut rig, list(1, &all, None)).expect_err("it is older");
    assert!(fault.contains("version 1, older than version 2"), "{fault}");
    assert_eq!(status(&rig)["access"]["version"], 2);
    rig.restart_bridge();
    rig.run(5.0);
    assert_eq!(status(&rig)["access"]["version"], 2);
    let found = status(&rig)["findings"].to_string();
    assert!(
        found.contains("access-list") && found.contains("version 1"),
        "{found}"
    );
    is_refused(&mut rig, loiter(), "without the right", "it needs LOI 4");
    // Forged: nothing of it counts.
    let forged = list(2, &[Group::Launch], None).replace("version 2", "version 9");
    let fault = renew(&mut rig, forged).expect_err("it does not verify");
    assert!(fault.contains("does not verify"), "{fault}");
    rig.run(2.0);
    let found = status(&rig)["findings"].to_string();
    assert!(found.contains("does not verify"), "{found}");
    renew(&mut rig, list(3, &all, None)).expect("it is newer");
    rig.run(2.0);
    assert!(!status(&rig)["findings"].to_string().contains("access-list"));
    // Who could command by which list is in the audit log, with what was refused.
    let log = audited(&rig);
    for what in [
        "version 1, key",
        "version 1 -> 2, 1 entries",
        "version 1, older than version 2",
        "started by version 2 of the store",
        "does not verify",
        "version 2 -> 3, 2 entries",
    ] {
        assert!(log.contains(what), "{what}: {log}");
    }
    rig.carry_out(orders::request_control());
    rig.done(loiter());
}

#[test]
fn an_entry_that_ends_in_the_air_ends_on_the_ground() {
    let groups = [Group::Fly, Group::Launch];
    let mut rig = rig(1, list(1, &groups, Some(60)));
    rig.carry_out(orders::request_control());
    rig.take_off(20.0);
    let all = held(&rig);
    // It ends in the air, and what is held stays: over a restart too, before the vehicle is received again.
    rig.run(60.0);
    rig.done(loiter());
    rig.restart_bridge();
    rig.run(5.0);
    assert_eq!(
        (held(&rig), status(&rig)["rights"][0]["may_hold"].as_u64()),
        (all, Some(0))
    );
    assert_eq!(status(&rig)["rights"][0]["entries"][0]["state"], "ended");
    rig.done(land());
    assert!(rig.until(60.0, |rig| rig.truth().landed));
    assert!(
        rig.until(20.0, |rig| held(rig) == 0),
        "it ends on the ground"
    );
    assert_eq!(
        rig.carry_out(orders::request_control()),
        Some(AckType::Refused)
    );
}

#[test]
fn a_wall_clock_that_is_set_ends_nothing_and_brings_nothing_back() {
    let groups = [Group::Fly, Group::Launch];
    let mut rig = rig(1, list(1, &groups, Some(HOUR / 2)));
    rig.carry_out(orders::request_control());
    // Not so far that its guard would refuse the VSM.
    rig.clock.set_wall_step(3_000.0);
    rig.run(5.0);
    assert_eq!(status(&rig)["rights"][0]["entries"][0]["state"], "in force");
    rig.take_off(20.0);
    // A start with that clock ends the entry, and neither the flight nor the way to land.
    rig.restart_bridge();
    rig.run(5.0);
    assert_eq!(status(&rig)["rights"][0]["entries"][0]["state"], "ended");
    rig.done(land());
    assert!(rig.until(60.0, |rig| rig.truth().landed));
    // And set back: what has ended has ended.
    rig.clock.set_wall_step(-(HOUR as f64));
    rig.restart_bridge();
    rig.run(9.0);
    assert_eq!(status(&rig)["rights"][0]["entries"][0]["state"], "ended");
    is_refused(
        &mut rig,
        orders::launch(20.0),
        "without the right",
        "this CUCS holds nothing",
    );
}

#[test]
fn an_entry_that_has_ended_is_refused_by_its_name() {
    // The right itself is still given by an entry without an end.
    let read = |text: String| AccessList::read(text.as_bytes()).expect("a list");
    let mut both = read(list(1, &[Group::Settings], Some(5)));
    let without_end = read(list(1, &[Group::Fly], None));
    both.grant(without_end.entries()[0]).expect("there is room");
    let mut rig = rig(1, both.signed(1, &AccessKey::new(&access_key())));
    rig.carry_out(orders::request_control());
    let set = ParameterSetCommand {
        parameter_name: Some(Text::new("NAV_DLL_ACT")),
        commanded_value: Some(0.0),
        ..ParameterSetCommand::default()
    };
    is_refused(&mut rig, set, ENDED, "has ended");
}

#[test]
fn an_entry_is_for_one_guard_key() {
    let groups = [Group::Fly, Group::Launch];
    let other = KeyId::from_bytes([9; 8]);
    let mut rig = rig(1, list_of(1, &groups, None, other));
    assert_eq!(
        rig.carry_out(orders::request_control()),
        Some(AckType::Refused)
    );
    assert_eq!(held(&rig), 0);
    let found = status(&rig)["findings"].to_string();
    assert!(found.contains("for another"), "{found}");
    renew(&mut rig, list(2, &groups, None)).expect("it is newer");
    rig.carry_out(orders::request_control());
    rig.take_off(20.0);
    // A list for a key that it does not have yet: it keeps what it holds in the air, and commands nothing by it.
    renew(&mut rig, list_of(3, &groups, None, other)).expect("it is newer");
    rig.run(2.0);
    assert!(held(&rig) > 0);
    is_refused(&mut rig, loiter(), OTHER_KEY, "for another guard key");
    renew(&mut rig, list(4, &groups, None)).expect("it is newer");
    rig.done(loiter());
}

#[test]
fn a_list_for_another_vehicle_gives_nothing_of_this_one() {
    let mut list = AccessList::new(VSM);
    list.grant(AccessEntry {
        cucs: cucs(0),
        vehicle: vehicle_id(1),
        group: Group::Fly,
        key: guard_key(cucs(0)).id(),
        until: None,
    })
    .expect("there is room");
    let list = list.signed(1, &AccessKey::new(&access_key()));
    let mut rig = rig(1, list);
    assert_eq!(
        rig.carry_out(orders::request_control()),
        Some(AckType::Refused)
    );
    assert_eq!(held(&rig), 0);
    is_refused(
        &mut rig,
        loiter(),
        "without the right",
        "this CUCS holds nothing",
    );
}

/// Station 0 with a new guard key; the one before is accepted still, and who has it is returned with the guard of the new one.
fn rotated(rig: &mut Rig) -> [StationGuard; 2] {
    let new = || SigningKey::new([0x4e; 32]).expect("not all zero");
    let now = rig.now();
    let until = Some(now.mono + Duration::from_secs(24 * HOUR));
    let keys = vec![(new(), None), (guard_key(cucs(0)), until)];
    let bridge = rig.bridge.as_mut().expect("it runs");
    let given = bridge.set_guard_keys(vec![(cucs(0), keys)], now, Duration::ZERO, &mut rig.store);
    given.expect("their clocks can be read");
    let thief = rig.guards.remove(&0).expect("it has one");
    let owner = StationGuard::with_key(cucs(0), new(), rig.station_now());
    [thief, owner]
}

#[test]
fn a_key_that_was_replaced_neither_requests_nor_gives_up_what_is_listed_under_the_new_one() {
    let groups = [Group::Fly, Group::Launch];
    let next = SigningKey::new([0x4e; 32]).expect("not all zero").id();
    let mut rig = rig(2, list_of(1, &groups, None, next));
    rig.stations[0].heartbeats = true;
    let [thief, owner] = rotated(&mut rig);
    rig.guards.insert(0, thief);
    let asked = rig.carry_out(orders::request_control());
    assert_eq!((asked, held(&rig)), (Some(AckType::Refused), 0));
    let thief = rig.guards.insert(0, owner).expect("it was there");
    rig.carry_out(orders::request_control());
    rig.take_off(20.0);
    let all = held(&rig);
    assert!(all > 0);
    // In the air, within the day in which the key before verifies.
    let owner = rig.guards.insert(0, thief).expect("it was there");
    let release = CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::from_raw(0x0f)),
        requested_handover_access: Some(RequestedAccess::Relinquish),
        ..CucsAuthorisationRequest::default()
    };
    is_refused(
        &mut rig,
        release.clone(),
        OTHER_KEY,
        "for another guard key",
    );
    let hand_over = PositiveHandoverAuthorisationRequest {
        requesting_cucs_id: Some(cucs(1)),
        requested_handover_loi: Some(LoiBitmap::from_raw(0x0c)),
        ..PositiveHandoverAuthorisationRequest::default()
    };
    is_refused(&mut rig, hand_over, OTHER_KEY, "for another guard key");
    is_refused(&mut rig, loiter(), OTHER_KEY, "for another guard key");
    assert_eq!(held(&rig), all);
    rig.guards.insert(0, owner);
    rig.done(land());
    rig.done(release);
    assert_eq!(held(&rig), 0);
}

#[test]
fn a_contingency_that_lands_needs_the_group_that_lands() {
    let set = |action| Contingency {
        contingency_cause: Some(ContingencyCause::Battery),
        contingency_action: Some(action),
        ..Contingency::default()
    };
    let mut rig = rig(1, list(1, &[Group::Fly], None));
    rig.carry_out(orders::request_control());
    is_refused(
        &mut rig,
        set(ContingencyAction::Landing),
        OUTSIDE,
        "does not give it this group",
    );
    rig.done(set(ContingencyAction::Return));
    renew(&mut rig, list(2, &[Group::Fly, Group::Launch], None)).expect("it is newer");
    rig.done(set(ContingencyAction::Landing));
}
