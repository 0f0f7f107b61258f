//! The promises of held commands along random histories: the machine alone, with what it reads and may do.

use std::collections::BTreeMap;
use std::time::Duration;

use mapping::mode::Px4Mode;
use mapping::telemetry::LandedState;
use mavlink_link::dialect::MavState;
use mavlink_link::store::MemoryDisk;
use proptest::prelude::*;
use stanag_msgs::enums::{
    AckType, FlightPathControlMode as Mode, HoldCondition, HoldKind, LoiBitmap,
};
use stanag_msgs::messages::{HeldCommandCancel, HoldCommand, VehicleOperatingModeCommand};
use stanag_msgs::{Id, MAX_DATAGRAM, Message, Text, TimeStamp};

use super::{Context, Held, Input};
use crate::config::OnLoss;
use crate::session::authority::rules::{
    Access, Asker, Authority, CONTROL, Circumstances, Rights, Stations,
};
use crate::session::context::{HeldOrigin, Origin};
use crate::session::effects::Request;
use crate::session::other::Other;
use crate::session::store::Boot;
use crate::session::testing::{CUCS, World, acknowledgements, origin};

/// What happens.
#[derive(Debug, Clone)]
enum Step {
    /// A command by this number: after so many seconds, or with less than 30 % of energy where `None`.
    Give {
        number: u16,
        after_s: Option<u32>,
        valid_s: u32,
        contingency: bool,
    },
    Cancel(u16),
    Pass(u64),
    /// The vehicle is silent, or received again.
    Silent(bool),
    Battery(u8),
    /// Who controls: 0 nobody, 1 who has given them, 2 another.
    Control(u8),
    /// `kill -9`, and a start as many seconds later.
    Restart(u64),
    /// What is being carried out ends.
    Answer(bool),
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        4 => (1_u16..4, prop::option::of(0_u32..12), 1_u32..20, any::<bool>()).prop_map(
            |(number, after_s, valid_s, contingency)| Step::Give {
                number,
                after_s,
                valid_s,
                contingency,
            }
        ),
        1 => (0_u16..4).prop_map(Step::Cancel),
        6 => (0_u64..4_000).prop_map(Step::Pass),
        2 => any::<bool>().prop_map(Step::Silent),
        2 => (0_u8..60).prop_map(Step::Battery),
        2 => (0_u8..4).prop_map(|who| Step::Control(who.min(1) + u8::from(who == 3))),
        2 => (0_u64..6).prop_map(Step::Restart),
        2 => any::<bool>().prop_map(Step::Answer),
    ]
}

/// What is known of a command that was acknowledged as held.
#[derive(Debug, Clone)]
struct Given {
    number: u16,
    until: Duration,
    contingency: bool,
    cancelled: bool,
    carried_out: u32,
}

struct Scene {
    world: World,
    held: Held,
    rights: Authority,
    /// By the stamp of its 50020.
    given: BTreeMap<u64, Given>,
    stamp: u64,
    running: Vec<u32>,
    only_holds: bool,
    loss_action: bool,
}

impl Scene {
    fn new() -> Scene {
        let mut scene = Scene {
            world: World::airborne(Px4Mode::LOITER),
            held: Held::default(),
            rights: Authority::default(),
            given: BTreeMap::new(),
            stamp: 1_000_000,
            running: Vec::new(),
            only_holds: false,
            loss_action: false,
        };
        scene.control(1);
        scene
    }

    fn control(&mut self, who: u8) {
        let holder = match who {
            0 => None,
            1 => Some(CUCS),
            _ => Some(Id(CUCS.0 + 1)),
        };
        self.rights = Authority::default();
        if let Some(id) = holder {
            let asker = Asker {
                id,
                authorised: LoiBitmap::from_raw(0x0f),
                may_override: false,
                rank: 0,
            };
            let at = Circumstances {
                now: Duration::ZERO,
                roster: &[asker],
                loading: None,
                launch_or_landing: false,
            };
            let wanted = Rights::named(CONTROL, Stations::NONE);
            let _ = self
                .rights
                .request(&at, &asker, Access::Control, wanted, false);
        }
        assert_eq!(self.rights.controller(), holder);
        self.world.controller = holder;
    }

    /// Lets the machine act, and holds what it wants carried out against what it may.
    fn act(&mut self, input: Input<'_>) {
        let (held, rights) = (&mut self.held, &self.rights);
        let (only_holds, loss_action) = (self.only_holds, self.loss_action);
        self.world.act(|common, mut views, effects| {
            views.flight.loss_action = loss_action;
            let context = Context {
                common,
                mission: views.mission,
                flight: views.flight,
                other: Other::of(&common.vehicle.telemetry),
                only_holds,
                rights,
            };
            held.handle(&context, input, effects);
        });
        while let Some(request) = self.world.requests.pop_front() {
            let Request::CarryOut { origin, .. } = request else {
                continue;
            };
            let HeldOrigin {
                serial,
                contingency,
            } = origin.held.expect("a held command");
            let stamp = origin.stamp.expect("the stamp of its 50020").0;
            let given = self.given.get_mut(&stamp).expect("it was acknowledged");
            given.carried_out += 1;
            assert_eq!(given.carried_out, 1, "carried out twice: {given:?}");
            assert!(!given.cancelled, "after its cancellation: {given:?}");
            assert!(
                self.world.now.mono < given.until,
                "after its expiry: {given:?}"
            );
            assert!(self.world.vehicle.live(), "while the vehicle is silent");
            assert_eq!(contingency, given.contingency);
            let controls = self.rights.controller();
            assert!(
                controls == Some(CUCS) || (contingency && controls.is_none()),
                "without the right: {controls:?}"
            );
            self.running.push(serial);
        }
    }

    fn send(&mut self, message: &Message) -> Vec<AckType> {
        let origin = Origin {
            stamp: Some(TimeStamp(self.stamp)),
            ..origin(message)
        };
        let _ = self.world.sent_to(0);
        self.act(Input::Command { origin, message });
        acknowledgements(&self.world.sent_to(0))
    }

    fn play(&mut self, step: &Step) {
        self.stamp += 1;
        match *step {
            Step::Give {
                number,
                after_s,
                valid_s,
                contingency,
            } => {
                let message = hold(self.stamp, number, after_s, valid_s, contingency);
                if self.send(&message).contains(&AckType::Received) {
                    let given = Given {
                        number,
                        until: self.world.now.mono + Duration::from_secs(valid_s.into()),
                        contingency,
                        cancelled: false,
                        carried_out: 0,
                    };
                    self.given.insert(self.stamp, given);
                }
            }
            Step::Cancel(number) => {
                let cancel = HeldCommandCancel {
                    time_stamp: Some(TimeStamp(self.stamp)),
                    held_command_number: Some(number),
                    ..HeldCommandCancel::default()
                };
                if self.send(&cancel.into()).contains(&AckType::CarriedOut) {
                    let meant = |given: &&mut Given| number == 0 || given.number == number;
                    for given in self.given.values_mut().filter(meant) {
                        given.cancelled = true;
                    }
                }
            }
            Step::Pass(ms) => self.world.advance(Duration::from_millis(ms)),
            Step::Silent(true) => self.world.vehicle.set_silent(),
            Step::Silent(false) => self.world.vehicle.set_live(),
            Step::Battery(percent) => self.world.vehicle.telemetry.battery = Some(percent),
            Step::Control(who) => self.control(who),
            Step::Restart(seconds) => {
                self.held = Held::default();
                self.running.clear();
                self.world.advance(Duration::from_secs(seconds));
                let held = &mut self.held;
                let restored = self.world.act(|_, _, effects| held.restore(effects));
                restored.expect("the record is read");
            }
            Step::Answer(carried_out) => {
                if let Some(serial) = self.running.pop() {
                    let answer = if carried_out {
                        AckType::CarriedOut
                    } else {
                        AckType::Refused
                    };
                    self.act(Input::Ended {
                        serial,
                        answer,
                        why: None,
                    });
                }
            }
        }
        self.act(Input::Watch);
    }
}

fn hold(stamp: u64, number: u16, after_s: Option<u32>, valid_s: u32, contingency: bool) -> Message {
    let command: Message = VehicleOperatingModeCommand {
        select_flight_path_control_mode: Some(Mode::Loiter),
        ..VehicleOperatingModeCommand::default()
    }
    .into();
    let mut data = [0; MAX_DATAGRAM];
    let length = command.encode_data(&mut data).expect("it is encoded");
    let hex = data_encoding::HEXLOWER.encode(&data[..length]);
    let condition = match after_s {
        Some(_) => HoldCondition::Time,
        None => HoldCondition::BatteryBelow,
    };
    Message::from(HoldCommand {
        time_stamp: Some(TimeStamp(stamp)),
        held_command_number: Some(number),
        held_message_type: Some(command.id()),
        held_message_data: Some(Text::new(&hex)),
        hold_condition: Some(condition),
        hold_kind: Some(if contingency {
            HoldKind::Contingency
        } else {
            HoldKind::Command
        }),
        valid_for: Some(valid_s),
        condition_time: after_s.map(|after_s| TimeStamp(stamp + u64::from(after_s) * 1_000)),
        condition_percent: after_s.is_none().then_some(30),
        ..HoldCommand::default()
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn never_twice_nor_late_nor_cancelled_nor_without_the_right(
        steps in prop::collection::vec(step(), 1..60)
    ) {
        let mut scene = Scene::new();
        for step in &steps {
            scene.play(step);
        }
    }
}

#[test]
fn what_the_histories_are_made_of_does_carry_out() {
    let mut scene = Scene::new();
    let give = Step::Give {
        number: 1,
        after_s: Some(2),
        valid_s: 10,
        contingency: false,
    };
    for step in [give, Step::Pass(1_900), Step::Restart(0), Step::Pass(200)] {
        scene.play(&step);
    }
    let carried_out: Vec<u32> = scene.given.values().map(|one| one.carried_out).collect();
    assert_eq!(carried_out, [1]);
}

/// To be carried out after so many seconds, within 20.
fn give(number: u16, after_s: u32) -> Step {
    Step::Give {
        number,
        after_s: Some(after_s),
        valid_s: 20,
        contingency: false,
    }
}

impl Scene {
    /// How often the first command was carried out.
    fn first(&self) -> u32 {
        self.given.values().next().expect("given").carried_out
    }

    fn step_wall(&mut self, seconds: i64) {
        let step = Duration::from_secs(seconds.unsigned_abs());
        match seconds < 0 {
            true => self.world.now.wall -= step,
            false => self.world.now.wall += step,
        }
    }

    fn restart_computer(&mut self) {
        self.world.boot = Some(Boot {
            id: 2,
            zero: Duration::ZERO,
        });
        self.play(&Step::Restart(0));
    }
}

#[test]
fn a_clock_that_went_back_over_a_restart_of_the_computer_cancels_what_waits() {
    let mut scene = Scene::new();
    scene.play(&give(1, 2));
    scene.step_wall(-3_600);
    scene.restart_computer();
    scene.play(&Step::Pass(5_000));
    assert_eq!(scene.first(), 0);
}

#[test]
fn a_clock_that_is_set_over_a_restart_of_the_vsm_changes_no_time() {
    for step_s in [-3_600, -5, 5, 3_600, 10 * 365 * 86_400] {
        let mut scene = Scene::new();
        scene.play(&give(1, 10));
        scene.step_wall(step_s);
        scene.play(&Step::Restart(1));
        scene.play(&Step::Pass(8_900));
        assert_eq!(scene.first(), 0, "{step_s}: not before its time");
        scene.play(&Step::Pass(200));
        assert_eq!(scene.first(), 1, "{step_s}");
    }
}

/// The times in the record are all by one clock: that of its last writing.
#[test]
fn a_clock_that_was_set_back_keeps_no_command_beyond_its_expiry() {
    for restarts_computer in [false, true] {
        let mut scene = Scene::new();
        scene.play(&give(1, 10));
        scene.step_wall(-3_600);
        // The record is written again.
        scene.play(&give(2, 15));
        match restarts_computer {
            true => scene.restart_computer(),
            false => scene.play(&Step::Restart(0)),
        }
        scene.play(&Step::Pass(10_100));
        assert_eq!(scene.first(), 1, "{restarts_computer}");
        // Each attempt is held against the expiry.
        scene.play(&Step::Pass(3_600_000));
    }
}

#[test]
fn nothing_is_carried_out_before_a_power_cut_would_leave_it_so() {
    let disk = |durable| {
        Box::new(MemoryDisk {
            queues: true,
            queued: durable,
            durable,
            ..MemoryDisk::default()
        })
    };
    // The disk keeps it after so long.
    for (ms, carried_out) in [(500, 1), (3_000, 0)] {
        let mut scene = Scene::new();
        scene.play(&Step::Give {
            number: 1,
            after_s: Some(2),
            valid_s: 20,
            contingency: false,
        });
        scene.world.disk = disk(0);
        scene.play(&Step::Pass(2_100));
        let count = |scene: &Scene| scene.given.values().next().expect("given").carried_out;
        assert_eq!(count(&scene), 0, "it is not on the disk");
        scene.play(&Step::Pass(ms));
        assert_eq!(count(&scene), 0);
        scene.world.disk = disk(100);
        scene.play(&Step::Pass(1));
        assert_eq!(count(&scene), carried_out, "after {ms} ms");
    }
}

#[test]
fn what_a_pilot_has_armed_on_the_ground_is_theirs() {
    for (mode, carried_out) in [(Px4Mode::new(7, 0), 0), (Px4Mode::LOITER, 1)] {
        let mut scene = Scene::new();
        scene.world.vehicle.telemetry.landed = Some(LandedState::OnGround);
        scene.world.show_mode(mode);
        scene.play(&Step::Give {
            number: 1,
            after_s: Some(2),
            valid_s: 10,
            contingency: false,
        });
        scene.play(&Step::Pass(2_100));
        let given = scene.given.values().next().expect("given");
        assert_eq!(given.carried_out, carried_out, "{mode:?}");
    }
}

/// On the ground a failsafe means nothing yet.
#[test]
fn a_failsafe_keeps_a_vehicle_that_is_not_known_to_be_on_the_ground() {
    for (landed, carried_out) in [(Some(LandedState::OnGround), 1), (None, 0)] {
        let mut scene = Scene::new();
        let telemetry = &mut scene.world.vehicle.telemetry;
        telemetry.landed = landed;
        telemetry.system_status = Some(MavState::MAV_STATE_CRITICAL);
        scene.play(&Step::Give {
            number: 1,
            after_s: Some(2),
            valid_s: 10,
            contingency: false,
        });
        scene.play(&Step::Pass(2_100));
        let given = scene.given.values().next().expect("given");
        assert_eq!(given.carried_out, carried_out, "{landed:?}");
    }
}

/// A contingency of a lost CUCS, and how often it has been carried out.
fn for_loss() -> (Scene, impl Fn(&mut Scene) -> u32) {
    let mut scene = Scene::new();
    scene.world.settings.authority.on_loss = OnLoss::Continue;
    scene.stamp += 1;
    let Message::HoldCommand(command) = hold(scene.stamp, 1, None, 200, true) else {
        panic!("it is a 50020");
    };
    let command = HoldCommand {
        hold_condition: Some(HoldCondition::LinkLost),
        condition_percent: None,
        ..command
    };
    assert!(scene.send(&command.into()).contains(&AckType::Received));
    let given = Given {
        number: 1,
        until: scene.world.now.mono + Duration::from_secs(200),
        contingency: true,
        cancelled: false,
        carried_out: 0,
    };
    scene.given.insert(scene.stamp, given);
    let station = &mut scene.world.stations[0];
    (station.received, station.sends_heartbeats) = (Some(scene.world.now.mono), true);
    scene.world.advance(Duration::from_secs(60));
    scene.control(0);
    let count = |scene: &mut Scene| {
        scene.play(&Step::Pass(2_000));
        scene.given.values().next().expect("given").carried_out
    };
    (scene, count)
}

#[test]
fn a_contingency_of_a_lost_cucs_waits_for_a_failsafe_that_may_only_hold_and_for_the_hold_of_what_was_steered()
 {
    let (mut scene, count) = for_loss();
    scene.world.vehicle.telemetry.system_status = Some(MavState::MAV_STATE_CRITICAL);
    for _ in 0..5 {
        assert_eq!(count(&mut scene), 0, "it may return, or land");
    }
    scene.only_holds = true;
    assert_eq!(count(&mut scene), 1);

    let (mut scene, count) = for_loss();
    scene.loss_action = true;
    assert_eq!(count(&mut scene), 0);
    scene.loss_action = false;
    assert_eq!(count(&mut scene), 1);
}

/// The end of its control would end what was begun before it, and so is waited for.
#[test]
fn a_contingency_of_a_lost_cucs_waits_for_the_end_of_its_control() {
    let (mut scene, count) = for_loss();
    scene.control(1);
    let announced = |scene: &Scene, steered| scene.held.flown_for_loss_of(CUCS, steered);
    assert_eq!(count(&mut scene), 0, "it is silent, and still in control");
    assert_eq!(announced(&scene, true), Some(1));
    scene.control(0);
    assert_eq!(count(&mut scene), 1);
    assert_eq!(announced(&scene, false), Some(1), "it is being carried out");
    assert_eq!(announced(&scene, true), None, "the hold ends it");
}

#[test]
fn a_contingency_of_a_lost_cucs_is_refused_where_a_failsafe_returns() {
    let (mut scene, count) = for_loss();
    scene.world.vehicle.telemetry.system_status = Some(MavState::MAV_STATE_CRITICAL);
    scene.world.show_mode(Px4Mode::RTL);
    assert_eq!(count(&mut scene), 0);
    scene.world.vehicle.telemetry.system_status = Some(MavState::MAV_STATE_ACTIVE);
    scene.world.show_mode(Px4Mode::LOITER);
    assert_eq!(count(&mut scene), 0, "it has ended");
}

#[test]
fn a_command_that_is_no_contingency_of_a_loss_is_never_carried_out_against_a_failsafe() {
    let mut scene = Scene::new();
    scene.world.vehicle.telemetry.system_status = Some(MavState::MAV_STATE_CRITICAL);
    let other = Other::of(&scene.world.vehicle.telemetry);
    assert!(other.is_some_and(Other::may_stay));
    scene.only_holds = true;
    scene.play(&Step::Give {
        number: 1,
        after_s: Some(2),
        valid_s: 10,
        contingency: true,
    });
    scene.play(&Step::Pass(3_000));
    assert_eq!(scene.given.values().next().expect("given").carried_out, 0);
}
