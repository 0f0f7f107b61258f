//! What two guards send each other beside datagrams of the DLI: steps of an exchange, offers of a group key, challenges about clocks and
//! their answers. Any bytes are read or not, what is read is written as it was, and nothing counts that the key has not made.
#![no_main]

use libfuzzer_sys::fuzz_target;
use stanag_msgs::guard::{
    ClockDatagram, Direction, ExchangeDatagram, GuardKey, Guarded, OFFER_BYTES, is_offer,
};
use stanag_msgs::{Id, ed25, frames};

fuzz_target!(|bytes: &[u8]| {
    let key = GuardKey::new(&[7; 32]);
    assert!(key.unwrap(bytes).is_none());
    if is_offer(bytes) {
        assert_eq!(bytes.len(), OFFER_BYTES);
        no_dli(bytes);
    }
    // A datagram for the group has another key than any that is for one station.
    if let Some(guarded) = Guarded::parse(bytes) {
        assert!(
            guarded.trailer.direction != Direction::ToGroup
                || guarded.trailer.direction.back().is_none()
        );
    }
    if let Some(about) = ClockDatagram::parse(bytes) {
        no_dli(bytes);
        assert_eq!(about.to_bytes(), bytes);
        assert!(Guarded::parse(bytes).is_none());
        assert!(!key.verifies_challenge(&about, Id(1)));
        assert!(!key.verifies_answer(&about, Id(1), &about));
    }
    let Some(step) = ExchangeDatagram::parse(bytes) else {
        return;
    };
    no_dli(bytes);
    let written = step.to_bytes();
    // But for zeros at its end, of which one stays where there is nothing else.
    assert!(bytes.starts_with(&written));
    assert!(bytes[written.len()..].iter().all(|byte| *byte == 0));
    let again = ExchangeDatagram::parse(&written).expect("a step was written");
    assert_eq!(
        (again.direction, again.cucs, again.vsm),
        (step.direction, step.cucs, step.vsm)
    );
});

/// No receiver of the DLI takes it for a message.
fn no_dli(bytes: &[u8]) {
    assert!(!ed25::is_ed25(bytes));
    assert!(frames(bytes).next().is_none_or(|frame| frame.is_err()));
}
