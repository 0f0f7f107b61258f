//! Any bytes where a DLI guard listens: the trailer behind a datagram, and what two guards send each other beside datagrams.

use stanag_msgs::guard::{
    ClockDatagram, Direction, ExchangeDatagram, GuardKey, Guarded, MAX_GUARDED, OFFER_BYTES,
    TRAILER_BYTES, is_offer,
};
use stanag_msgs::{Id, ed25, frames};

/// A trailer is read or not, what is read is written as it was, and nothing verifies that the key has not sealed.
///
/// # Panics
/// One of these does not hold.
pub fn trailer(bytes: &[u8]) {
    let Some(guarded) = Guarded::parse(bytes) else {
        return;
    };
    let (key, receiver) = (GuardKey::new(&[7; 32]), Id(1));
    assert!(!key.verifies(&guarded, receiver));
    let mut out = [0; MAX_GUARDED];
    let length = key
        .seal(&guarded.trailer, receiver, guarded.datagram, &mut out)
        .expect("it is no longer than what was read");
    assert_eq!(length, bytes.len());
    // All but the MAC, which only the key makes.
    let (head, mac) = out[..length].split_at(length - 32);
    assert_eq!(head, &bytes[..length - 32]);
    assert_ne!(mac, &bytes[length - 32..]);
    let again = Guarded::parse(&out[..length]).expect("a trailer was written");
    assert_eq!(again.datagram.len() + TRAILER_BYTES, length);
    let names_it = guarded.trailer.key_id == key.id();
    assert_eq!(key.verifies(&again, receiver), names_it);
}

/// Steps of an exchange, offers of a group key, challenges about clocks and their answers: they are read or not, what is
/// read is written as it was, and nothing counts that the key has not made.
///
/// # Panics
/// One of these does not hold.
pub fn exchange(bytes: &[u8]) {
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
}

/// No receiver of the DLI takes it for a message.
fn no_dli(bytes: &[u8]) {
    assert!(!ed25::is_ed25(bytes));
    assert!(frames(bytes).next().is_none_or(|frame| frame.is_err()));
}
