//! The air-side agent as a process between a bridge and a simulated PX4: it relays and drops, keys are agreed through
//! it, and whatever of the three is restarted, the link is up again within 5 s.

use std::net::UdpSocket;
use std::time::Duration;

use kit::process::Running;
use mavlink_link::dialect::{MavCmd, MavMessage};
use mavlink_link::frame::{Header, INCOMPAT_SIGNED, MAX_FRAME, encode, encode_raw};
use mavlink_link::service::{Node, command};
use mavlink_link::signing::{SigningKey, Stamp, sign};

use super::field::Field;

impl Field {
    /// How long until the bridge accepts the vehicle's frames again.
    fn up_again(&self) -> Duration {
        let mut before = self.believed();
        self.wait("the link is up again", Duration::from_secs(20), |field| {
            let now = field.believed();
            // A bridge that has restarted counts from zero.
            before = before.min(now);
            now > before + 20 && field.is_live()
        })
    }

    /// Each of the three is killed and restarted, then all of them, in the least fitting order. Nobody lends a hand,
    /// and the link is up within 5 s.
    #[allow(
        clippy::print_stderr,
        reason = "what was measured is printed for whoever reads the test"
    )]
    pub(super) fn restart_each(&self, mut parts: Parts) -> Parts {
        let mut took = vec![];
        for what in ["PX4", "agent", "bridge", "all"] {
            let is = |part: &str| what == part || what == "all";
            // Dropped means killed: nothing can be written any more.
            if is("PX4") {
                drop(parts.aircraft.take());
            }
            if is("agent") {
                drop(parts.agent.take());
            }
            if is("bridge") {
                drop(parts.bridge.take());
                parts.bridge = Some(self.bridge());
            }
            if is("agent") {
                parts.agent = Some(self.agent());
            }
            if is("PX4") {
                parts.aircraft = Some(self.aircraft("1"));
            }
            let up = self.up_again();
            eprintln!("{what} restarted: up again after {:.2} s", up.as_secs_f64());
            took.push((what, up));
        }
        for (what, up) in took {
            assert!(up < Duration::from_secs(5), "{what}: {up:?}");
        }
        parts
    }
}

/// What runs: ended where it is dropped.
pub(super) struct Parts {
    pub(super) aircraft: Option<Running>,
    pub(super) agent: Option<Running>,
    pub(super) bridge: Option<Running>,
}

#[test]
fn the_agent_relays_and_drops_what_must_not_reach_px4() {
    let field = Field::new("");
    let key = field.share_key();
    field.px4_has(&key);
    let _aircraft = field.aircraft("4");
    let _agent = field.agent();
    let _bridge = field.bridge();
    field.wait("live", Duration::from_secs(15), Field::is_live);

    let attacker = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let key = SigningKey::new(key).expect("a key");
    let other = SigningKey::new([9; 32]).expect("a key");
    let now = Stamp::from_unix(kit::clock::wall());
    let year = now.plus(Duration::from_secs(366 * 86_400));
    let arm = command::long(Node::new(1, 1), MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0]);
    // Who, under which key and stamp, and the counter that must show it.
    let attacks = [
        (245, 190, None, "unsigned_vehicle"),
        (245, 190, Some((&other, now)), "bad_signature"),
        (1, 191, Some((&key, now)), "reflected"),
        (245, 77, Some((&key, now)), "not_listed"),
        (44, 190, Some((&key, now)), "unexpected_system"),
        (245, 190, Some((&key, year)), "future"),
    ];
    let refused = |name: &str| field.air()["radio"]["frames"][name].as_u64().unwrap_or(0);
    for (system, component, signature, counter) in attacks {
        let before = refused(counter);
        let bytes = signed(system, component, &arm, signature);
        attacker
            .send_to(&bytes, ("127.0.0.1", field.radio))
            .expect("sent");
        field.wait(counter, Duration::from_secs(5), |_| {
            refused(counter) > before
        });
    }
    let held = "SETUP_SIGNING from the ground";
    let ahead_s = std::cell::Cell::new(60);
    field.wait(held, Duration::from_secs(5), |field| {
        // Stamped beyond the ceiling of the agent's clock, the first is refused while the disk raises it.
        ahead_s.set(ahead_s.get() + 1);
        let setup = setup_signing(&key, now.plus(Duration::from_secs(ahead_s.get())));
        attacker
            .send_to(&setup, ("127.0.0.1", field.radio))
            .expect("sent");
        field.air()["held_back"][held].as_u64() >= Some(1)
    });
    let vehicle = field.vehicle();
    assert_eq!(vehicle["armed"], false, "{vehicle:#}");

    // And the bridge's own commands pass: it flies.
    field.launch();
}

#[test]
fn both_sides_pair_agree_fly_rotate_and_survive_each_restart() {
    let field = Field::new(r#", exchange = "on""#);
    let aircraft = field.aircraft("4");
    let agent = field.agent();
    field.pair();

    let bridge = field.bridge();
    field.wait_until_signed();
    let first = field.air()["key_id"].clone();

    field.launch();
    field.cucs(&["land"]);
    field.cucs(&["wait", "landed", "--within", "60"]);
    field.wait("disarmed", Duration::from_secs(30), |field| {
        field.vehicle()["armed"] == false
    });
    field.cucs(&["release"]);
    drop(bridge);

    // A key that is old after a few seconds: another is agreed about, and taken over while the vehicle stands.
    field.write_ground(r#", exchange = "on", rotate_days = 0.0001"#);
    let bridge = field.bridge();
    field.wait("another key", Duration::from_secs(60), |field| {
        let air = field.air();
        air["state"] == "relaying"
            && air["key_id"] != first
            && field.vehicle()["link"]["key_id"] == air["key_id"]
            && field.is_live()
    });
    drop(bridge);
    field.write_ground(r#", exchange = "on""#);

    // Whatever is switched off and on, and though the key was agreed over the air, the link comes up by itself.
    let parts = Parts {
        aircraft: Some(aircraft),
        agent: Some(agent),
        bridge: Some(field.bridge()),
    };
    field.wait("live", Duration::from_secs(20), Field::is_live);
    let _parts = field.restart_each(parts);
    assert_ne!(field.air()["key_id"], first, "the second key is in force");
    field.launch();
}

/// Neither the agent's request for a key, which anyone may have sent, nor a bridge that starts before the vehicle has the
/// key, is a reason for another one.
#[test]
fn the_key_of_a_pairing_comes_into_force_and_no_other() {
    let field = Field::new(r#", exchange = "on""#);
    let _aircraft = field.aircraft("1");
    let _agent = field.agent();
    for pairing in ["first", "second"] {
        let agreed = field.pair();
        let bridge = field.bridge();
        field.wait("a key comes into force", Duration::from_secs(60), |field| {
            let air = field.air();
            let link = field.vehicle()["link"].clone();
            air["state"] == "relaying"
                && air["next_key_id"].is_null()
                && link["key_id"] == air["key_id"]
                && link["exchange"]["next_key_id"].is_null()
                && field.is_live()
        });
        assert_eq!(field.air()["key_id"], *agreed, "{pairing} pairing");
        assert!(!bridge.output().contains("agreed with agent"));
        drop(bridge);
    }
}

#[test]
fn over_serial_lines_both_sides_pair_fly_signed_and_come_back() {
    let field = Field::on_serial_lines(r#", exchange = "on""#);
    let parts = Parts {
        aircraft: Some(field.aircraft("1")),
        agent: Some(field.agent()),
        bridge: None,
    };
    field.pair();
    let parts = Parts {
        bridge: Some(field.bridge()),
        ..parts
    };
    field.wait_until_signed();
    let _parts = field.restart_each(parts);
    field.launch();
}

#[test]
fn whatever_restarts_the_link_is_up_within_5_s() {
    let field = Field::new("");
    let key = field.share_key();
    field.px4_has(&key);
    let parts = Parts {
        aircraft: Some(field.aircraft("1")),
        agent: Some(field.agent()),
        bridge: Some(field.bridge()),
    };
    field.wait("live", Duration::from_secs(20), Field::is_live);
    let _parts = field.restart_each(parts);
}

fn signed(
    system: u8,
    component: u8,
    message: &MavMessage,
    signature: Option<(&SigningKey, Stamp)>,
) -> Vec<u8> {
    let header = Header {
        system_id: system,
        component_id: component,
        incompat: signature.map_or(0, |_| INCOMPAT_SIGNED),
        ..Header::default()
    };
    let mut out = [0; MAX_FRAME];
    let mut len = encode(message, header, &mut out);
    if let Some((key, stamp)) = signature {
        len = sign(key, 0, stamp, &mut out, len).expect("room");
    }
    out[..len].to_vec()
}

/// As the VSM would sign it: from the radio it must not pass all the same.
fn setup_signing(key: &SigningKey, stamp: Stamp) -> Vec<u8> {
    let header = Header {
        system_id: 245,
        component_id: 190,
        message_id: 256,
        incompat: INCOMPAT_SIGNED,
        ..Header::default()
    };
    let mut out = [0; MAX_FRAME];
    let len = encode_raw(header, &[7; 42], &mut out).expect("a frame");
    let len = sign(key, 0, stamp, &mut out, len).expect("room");
    out[..len].to_vec()
}
