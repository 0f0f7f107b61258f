//! An order to zeroize at the agent: of the paired ground or of an operator here, stored before it is acknowledged, and PX4 with
//! a key that nobody keeps.

use std::time::Duration;

use mavlink_link::dialect::{MavCmd, MavMessage};
use mavlink_link::exchange::{
    AutopilotKey, Identity, Inbound, Initiator, InitiatorConfig, InitiatorEvent, InitiatorMemory,
    NoRandom, Node, PinnedPeer, Trust, Wanted, ZeroizeRefusal, ZeroizeReport,
};
use mavlink_link::exchange::{InitiatorStore, PublicKey};
use mavlink_link::frame::KEY_EXCHANGE_ID;
use mavlink_link::service::command;
use px4_sim::Signing;
use vsm::airside::Settings;

use crate::world::{Disk, GROUND, VSM, World, encoded, frame, key, settings};

/// An agent that a ground has been paired with, and that ground's end of the exchange.
struct Ordered {
    world: World,
    ground: Initiator,
    /// What the disk does with the order.
    stores: Result<Option<String>, String>,
    stored: u32,
    reports: Vec<Option<ZeroizeReport>>,
    random: u8,
}

/// What an order does not touch.
struct NoDisk;

impl InitiatorStore for NoDisk {
    fn store_counter(&mut self, _: u64) -> Result<(), mavlink_link::exchange::StoreError> {
        unreachable!("no exchange of keys")
    }
    fn promote_next(&mut self) -> Result<(), mavlink_link::exchange::StoreError> {
        unreachable!("no exchange of keys")
    }
    fn store_next(
        &mut self,
        _: &mavlink_link::exchange::Agreed,
    ) -> Result<(), mavlink_link::exchange::StoreError> {
        unreachable!("no exchange of keys")
    }
    fn drop_next(&mut self) -> Result<(), mavlink_link::exchange::StoreError> {
        unreachable!("no exchange of keys")
    }
    fn pin(&mut self, _: &PublicKey) -> Result<(), mavlink_link::exchange::StoreError> {
        unreachable!("no exchange of keys")
    }
}

fn identity() -> Identity {
    Identity::new([3; 32])
}

fn initiator(identity: Identity, settings: &Settings, now: Duration) -> Initiator {
    let config = InitiatorConfig {
        parties: settings.parties(),
        identity,
        trust: Trust::Pinned(Identity::new([7; 32]).public()),
        wanted: Wanted {
            signing: true,
            confidential: false,
        },
    };
    Initiator::new(config, InitiatorMemory::default(), now)
}

impl Ordered {
    fn with(settings: Settings) -> Ordered {
        let mut disk = Disk::with(Some(key(5)));
        disk.peer = Some(PinnedPeer {
            key: identity().public(),
            counter: 0,
        });
        let mut world = World::with(settings.clone(), disk, Signing::with_key(key(5), 0));
        world.run(4.0);
        assert!(!world.received().is_empty(), "{:?}", world.log);
        Ordered {
            ground: initiator(identity(), &settings, world.now.mono),
            world,
            stores: Ok(None),
            stored: 0,
            reports: vec![],
            random: 40,
        }
    }

    fn new() -> Ordered {
        Ordered::with(settings())
    }

    fn order(&mut self, in_flight: bool) {
        let mut random = random(&mut self.random);
        let now = self.world.now.mono;
        let ordered = self.ground.order_zeroize(now, in_flight, &mut random);
        assert_eq!(ordered, Ok(true));
    }

    /// Both ends and PX4 for so long, with what the shell does.
    fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds * 20.0) as usize {
            self.world.tick();
            let now = self.world.now;
            for payload in std::mem::take(&mut self.world.exchanged) {
                let inbound = Inbound {
                    from: (),
                    source: Node {
                        system: 1,
                        component: 191,
                    },
                    verified: true,
                    payload: &payload,
                };
                let _ = self.ground.handle(now, inbound, &mut NoDisk);
            }
            self.ground
                .handle_timeout(now, &mut random(&mut self.random), &mut NoDisk);
            while let Some(message) = self.ground.poll_transmit() {
                let stamp = self.world.ground.as_mut().unwrap().stamp(now);
                let sealed = frame(
                    VSM,
                    KEY_EXCHANGE_ID,
                    &message.to_payload(),
                    Some((&key(5), stamp)),
                );
                self.world.radio(GROUND, &sealed);
            }
            while let Some(event) = self.ground.poll_event() {
                if let InitiatorEvent::Zeroize { report } = event {
                    self.reports.push(report);
                }
            }
            if self.world.agent.zeroize_to_store() {
                self.stored += 1;
                // Nothing of it is acknowledged, and PX4's key is untouched, before it is on the disk.
                assert_eq!(self.reports, []);
                assert_eq!(self.world.secrets, 0);
                let mut random = random(&mut self.random);
                self.world.agent.zeroize_stored(
                    now,
                    &self.stores,
                    &mut random,
                    &mut self.world.disk,
                );
                self.world.drain();
            }
        }
    }

    fn is_over(&self) -> bool {
        self.world.agent.is_zeroized(self.world.now.mono)
    }
}

fn random(byte: &mut u8) -> impl FnMut(&mut [u8]) -> Result<(), NoRandom> + '_ {
    move |out: &mut [u8]| {
        *byte += 1;
        out.fill(*byte);
        Ok(())
    }
}

fn stored(key: AutopilotKey) -> Option<ZeroizeReport> {
    Some(ZeroizeReport::Stored(key))
}

#[test]
fn the_paired_ground_has_the_agent_erase_itself_and_px4_has_a_key_that_nobody_keeps() {
    let mut one = Ordered::new();
    one.order(false);
    one.run(1.0);
    assert_eq!(one.stored, 1);
    assert_eq!(one.reports, [stored(AutopilotKey::Pending)]);
    assert!(!one.is_over());
    // 10 s in which no other autopilot must be on the line.
    one.run(16.0);
    assert_eq!(
        one.reports,
        [
            stored(AutopilotKey::Pending),
            stored(AutopilotKey::Replaced)
        ],
        "{:?}",
        one.world.log
    );
    assert!(one.is_over());
    let signing = one.world.px4.signing();
    // Not a blank one, which would switch its signing off, nor one that a file has.
    assert!(signing.key().is_some());
    assert!(!one.world.px4_has(&key(5)));
    assert!(one.world.disk.next.is_none() && one.world.disk.previous.is_none());
    // What the thief of the ground's key sends is worth nothing from now on.
    let commands = |one: &Ordered| one.world.px4.vehicle().counters().commands_accepted;
    let before = commands(&one);
    let now = one.world.now;
    let arm = arming();
    let bytes = one.world.ground.as_mut().unwrap().frame(now, &arm);
    one.world
        .px4
        .handle_datagram(0, crate::world::at(9), &bytes);
    assert_eq!(commands(&one), before);
    assert_eq!(one.stored, 1);
}

fn arming() -> MavMessage {
    let px4 = Node::new(1, 1);
    command::long(px4, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0])
}

#[test]
fn in_flight_the_order_is_refused_by_the_agents_own_view_unless_it_says_in_flight() {
    let mut one = Ordered::new();
    one.world.take_off();
    one.order(false);
    one.run(2.0);
    let refused = Some(ZeroizeReport::Refused(ZeroizeRefusal::InFlight));
    assert_eq!(one.reports, [refused]);
    assert_eq!((one.stored, one.is_over()), (0, false));
    // Nothing has changed: it flies on, and what the ground sends passes.
    let now = one.world.now;
    let bytes = one.world.ground.as_mut().unwrap().frame(now, &arming());
    assert!(one.world.passes(GROUND, &bytes));
    one.reports.clear();
    one.order(true);
    one.run(5.0);
    assert_eq!(one.reports, [stored(AutopilotKey::Armed)]);
    assert_eq!((one.stored, one.is_over()), (1, true));
    // An armed PX4 takes no key, and is sent none.
    assert!(one.world.px4_has(&key(5)));
    assert_eq!(one.world.secrets, 0);
}

#[test]
fn silence_of_px4_counts_as_flight() {
    let mut one = Ordered::new();
    one.world.px4_connected = false;
    one.run(2.0);
    one.order(false);
    one.run(2.0);
    let refused = Some(ZeroizeReport::Refused(ZeroizeRefusal::InFlight));
    assert_eq!(one.reports, [refused]);
    assert_eq!(
        one.world.agent.zeroize_here(one.world.now.mono, false),
        Err(
            "PX4 is not known to be disarmed, and would lose its link to the ground: land and disarm it, or add --in-flight"
        )
    );
}

#[test]
fn what_cannot_be_stored_is_refused_and_nothing_is_touched() {
    let mut one = Ordered::new();
    one.stores = Err("no space left".to_owned());
    one.order(false);
    one.run(20.0);
    let refused = Some(ZeroizeReport::Refused(ZeroizeRefusal::NotStored));
    assert_eq!(one.reports, [refused]);
    assert_eq!((one.stored, one.is_over()), (1, false));
    assert!(one.world.px4_has(&key(5)));
    assert_eq!(one.world.state(), "relaying");
    assert!(one.world.log.iter().any(|line| line.contains("NOT DONE")));
}

#[test]
fn px4_keeps_its_key_where_that_is_configured_and_what_it_does_not_take_is_reported() {
    let mut one = Ordered::with(Settings {
        replace_px4_key: false,
        ..settings()
    });
    one.order(false);
    one.run(4.0);
    assert_eq!(one.reports, [stored(AutopilotKey::Kept)]);
    assert!(one.is_over() && one.world.px4_has(&key(5)));
    // One that takes no other key.
    let mut one = Ordered::new();
    one.world.cannot_sign = true;
    one.order(false);
    one.run(26.0);
    assert_eq!(
        one.reports.last(),
        Some(&stored(AutopilotKey::NotTaken)),
        "{:?}",
        one.world.log
    );
    assert!(one.is_over() && one.world.px4_has(&key(5)));
    // One that falls silent: a bounded time, and then the agent erases itself all the same.
    let mut one = Ordered::new();
    one.order(false);
    one.run(1.0);
    one.world.px4_connected = false;
    one.run(24.0);
    assert_eq!(
        one.reports.last(),
        Some(&stored(AutopilotKey::NotReached)),
        "{:?}",
        one.world.log
    );
    assert!(one.is_over());
}

#[test]
fn a_stranger_orders_nothing_and_is_counted() {
    let mut one = Ordered::new();
    // It has the signing key, but neither static key.
    one.ground = initiator(Identity::new([4; 32]), &settings(), one.world.now.mono);
    one.order(true);
    one.run(9.0);
    assert_eq!(one.reports, [None]);
    assert_eq!(one.stored, 0);
    let status = one.world.agent.status(String::new(), one.world.now.mono);
    assert!(status.exchange["forged"] > 10, "{:?}", status.exchange);
    // Nor does a command of MAVLink.
    let plain = encoded(VSM, &arming());
    assert!(!one.world.passes(GROUND, &plain));
}

#[test]
fn a_recorded_order_is_counted_and_orders_nothing_after_a_restart_of_the_agent() {
    let mut one = Ordered::new();
    one.world.take_off();
    one.order(false);
    // What the ground sends, sealed under its pinned key, the attacker has too.
    let mut recorded = vec![];
    for _ in 0..30 {
        one.world.tick();
        let now = one.world.now;
        for payload in std::mem::take(&mut one.world.exchanged) {
            let source = Node {
                system: 1,
                component: 191,
            };
            let inbound = Inbound {
                from: (),
                source,
                verified: true,
                payload: &payload,
            };
            let _ = one.ground.handle(now, inbound, &mut NoDisk);
        }
        one.ground
            .handle_timeout(now, &mut random(&mut one.random), &mut NoDisk);
        while let Some(message) = one.ground.poll_transmit() {
            recorded.push(message.to_payload());
            let bytes = frame(VSM, KEY_EXCHANGE_ID, &message.to_payload(), None);
            one.world.radio(GROUND, &bytes);
        }
    }
    assert!(recorded.len() >= 2);
    // On the ground again, and the agent has been restarted: now it would be carried out.
    one.world.px4 = px4_sim::Autopilot::new(
        px4_sim::Config::default(),
        Signing::with_key(key(5), 0),
        vec![Some(crate::world::at(9))],
    );
    one.world.restart_agent();
    one.world.run(4.0);
    assert!(one.world.agent.is_disarmed(one.world.now.mono));
    for payload in &recorded {
        let bytes = frame(VSM, KEY_EXCHANGE_ID, payload, None);
        one.world.radio(GROUND, &bytes);
    }
    assert!(!one.world.agent.zeroize_to_store());
    let status = one.world.agent.status(String::new(), one.world.now.mono);
    assert!(status.exchange["challenge"] > 0, "{:?}", status.exchange);
}

#[test]
fn an_operator_of_this_computer_has_px4s_key_replaced_too() {
    let mut one = Ordered::new();
    let now = one.world.now.mono;
    assert_eq!(one.world.agent.zeroize_here(now, false), Ok(()));
    assert_eq!(
        one.world.agent.zeroize_here(now, false),
        Err("it is ordered already")
    );
    one.run(17.0);
    assert_eq!(one.world.agent.zeroized_key(), Some(AutopilotKey::Replaced));
    assert!(one.is_over() && !one.world.px4_has(&key(5)));
    let log = one.world.log.join("\n");
    assert!(log.contains("ZEROIZE ORDERED by an operator"), "{log}");
    assert!(
        log.contains("PX4 has taken a key that nobody keeps"),
        "{log}"
    );
}

/// PX4 is being given another key for up to 20 s: who takes off meanwhile would be without keys in the air.
#[test]
fn what_stands_on_the_ground_is_not_started_once_a_zeroize_is_ordered() {
    let mut ordered = Ordered::new();
    let command = |ordered: &mut Ordered, command, param1| {
        let message = command::long(Node::new(1, 1), command, [param1]);
        let now = ordered.world.now;
        let ground = ordered.world.ground.as_mut().unwrap();
        let bytes = ground.frame(now, &message);
        ordered.world.passes(GROUND, &bytes)
    };
    ordered.world.run(12.0);
    let arm = MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;
    assert!(command(&mut ordered, arm, 0.0), "before, it passes");
    ordered.order(false);
    ordered.run(1.0);
    assert_eq!(ordered.stored, 1);
    assert!(!command(&mut ordered, arm, 1.0));
    assert_eq!(ordered.world.held_back("a zeroize is ordered"), 1);
    assert!(command(&mut ordered, arm, 0.0), "disarming always does");
}

/// A start that has found an order, with the radio closed, for so long.
fn resume(world: &mut World, seconds: f64) -> Option<AutopilotKey> {
    let mut byte = 90;
    for _ in 0..(seconds * 20.0) as usize {
        world.tick();
        let now = world.now;
        world
            .agent
            .resume_zeroize(now, &mut random(&mut byte), &mut world.disk);
        world.drain();
    }
    world.agent.zeroized_key()
}

#[test]
fn a_start_that_finds_an_order_waits_for_px4_and_gives_it_a_key_that_nobody_keeps() {
    let mut one = Ordered::new();
    // A power cut: PX4 starts with this computer, and takes longer.
    one.world.restart_agent();
    one.world.px4_connected = false;
    assert_eq!(resume(&mut one.world, 12.0), None);
    one.world.px4_connected = true;
    assert_eq!(resume(&mut one.world, 20.0), Some(AutopilotKey::Replaced));
    assert!(one.world.px4.signing().key().is_some() && !one.world.px4_has(&key(5)));
    // One that has such a key already is not reached, and nobody waits for it for ever.
    one.world.restart_agent();
    assert_eq!(resume(&mut one.world, 29.0), None);
    let not_reached = Some(AutopilotKey::NotReached);
    assert_eq!(resume(&mut one.world, 2.0), not_reached);
}

#[test]
fn a_start_that_finds_an_order_in_flight_waits_for_the_landing_and_sends_px4_nothing_before() {
    let mut one = Ordered::new();
    one.world.take_off();
    one.world.restart_agent();
    assert_eq!(resume(&mut one.world, 29.0), None);
    assert_eq!(resume(&mut one.world, 2.0), Some(AutopilotKey::Armed));
    assert!(one.world.px4_has(&key(5)));
    assert_eq!(one.world.secrets, 0);
    // Landed and disarmed within the 30 s, it is given the other key.
    one.world.restart_agent();
    one.world.run(4.0);
    // Custom mode AUTO.LAND.
    one.world
        .command(MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 4.0, 6.0], 0.0);
    one.world.run(12.0);
    assert!(one.world.px4.vehicle().truth().armed);
    one.world.restart_agent();
    assert_eq!(resume(&mut one.world, 50.0), Some(AutopilotKey::Replaced));
}
