//! Trailers of the DLI guard: any bytes are read or not, what is read is written as it was, and nothing verifies that the key
//! has not sealed.
#![no_main]

use libfuzzer_sys::fuzz_target;
use stanag_msgs::Id;
use stanag_msgs::guard::{GuardKey, Guarded, MAX_GUARDED, TRAILER_BYTES};

fuzz_target!(|bytes: &[u8]| {
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
});
