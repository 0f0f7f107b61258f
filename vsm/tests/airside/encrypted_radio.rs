//! A radio of few bits a second (`vehicle.rate_bps`) whose link is encrypted, under virtual time: a station, the bridge, both ends
//! of the link, an agent and a simulated PX4. The link comes up, what is on the line stays within its budget while commands are
//! given, and these are answered in time.

use std::time::Duration;

use kit::bridge::orders;
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode};

use crate::chain::Chain;
use crate::radio::{EncryptedRadio, GROUND_END};

/// PX4 streams here as it does to its simulator's ground station, over 15 kB a second; on a serial line it keeps to its MAV_n_RATE. So
/// the line gets its pace once the bridge has requested its rates, which takes as long as its budget lets it.
fn on_a_radio(rate_bps: u32, requested_s: f64) -> Chain {
    let keys = format!(
        "signing = {{ key_file = \"uav.key\", exchange = \"on\" }}\nencrypt = true\nrate_bps = {rate_bps}\n"
    );
    let radio = EncryptedRadio::new(rate_bps, Duration::ZERO);
    let mut chain = Chain::with(&keys, Some(radio));
    chain.run(9.0);
    let end = chain.carry_out(orders::request_control(), 20.0);
    assert_eq!(end, Some(AckType::CarriedOut), "{:#?}", chain.log);
    chain.run(requested_s);
    assert!(chain.is_encrypted(), "{:#?}", chain.log);
    assert_eq!(chain.states(), ("live", "live"), "{:#?}", chain.log);
    chain.encrypted().pace();
    chain.run(10.0);
    chain
}

/// A command of a mode, and how long its answer took.
fn commanded(chain: &mut Chain) -> Duration {
    let sent = chain.elapsed();
    let end = chain.carry_out(orders::mode(Mode::Loiter), 20.0);
    assert_eq!(end, Some(AckType::CarriedOut), "{:#?}", chain.log);
    chain.elapsed() - sent
}

#[test]
fn the_budget_of_an_encrypted_radio_is_kept_and_commands_are_answered() {
    // Of a position four times a second, and every three seconds (docs/guide/px4.md).
    for (rate_bps, requested_s, positions_s) in [(57_600, 60.0, 2.5), (9_600, 180.0, 0.2)] {
        let mut chain = on_a_radio(rate_bps, requested_s);
        let begun = chain.elapsed();
        for _ in 0..8 {
            chain.run(5.0);
            let took = commanded(&mut chain);
            // Within which a mode is shown, or refused.
            assert!(took <= Duration::from_secs(6), "{rate_bps}: {took:?}");
        }
        let seconds = (chain.elapsed() - begun).as_secs_f64();
        let radio = chain.encrypted();
        let used = radio.busiest(begun);
        assert!(used < 0.9, "{rate_bps}: {used}");
        // What is on the line is used, too.
        assert!(used > 0.15, "{rate_bps}: {used}");
        // Behind two packets at most, where that is longer than what is promised without encryption.
        let waited = radio.longest_wait(begun);
        let most = (3 * radio.packet_time()).max(Duration::from_millis(200));
        assert!(waited <= most, "{rate_bps}: {waited:?}");
        let positions = radio.count(GLOBAL_POSITION_INT, begun) as f64;
        assert!(
            positions >= positions_s * seconds,
            "{rate_bps}: {positions}"
        );
        assert!(chain.is_encrypted());
        assert_eq!(chain.states(), ("live", "live"), "{:#?}", chain.log);
    }
}

#[test]
fn an_encrypted_link_comes_up_again_on_a_line_that_carries_little() {
    for (rate_bps, requested_s) in [(57_600, 60.0), (9_600, 180.0)] {
        let mut chain = on_a_radio(rate_bps, requested_s);
        let now = chain.ground.now().mono;
        chain.encrypted().restart(GROUND_END, now);
        assert!(!chain.is_encrypted());
        let is_up = (0..150).any(|_| {
            chain.run(0.1);
            chain.is_encrypted()
        });
        assert!(is_up, "{rate_bps}: {:#?}", chain.log);
        chain.run(5.0);
        let took = commanded(&mut chain);
        assert!(took <= Duration::from_secs(6), "{rate_bps}: {took:?}");
    }
}

const GLOBAL_POSITION_INT: u32 = 33;
