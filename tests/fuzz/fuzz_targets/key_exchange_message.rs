//! KEY_EXCHANGE payloads: any bytes are read or refused, and what is read is written as it was.
#![no_main]

use libfuzzer_sys::fuzz_target;
use mavlink_link::exchange::{Message, PairingCode, Received};

fuzz_target!(|payload: &[u8]| {
    if let Ok(Received::Exchange(message)) = Message::parse(payload) {
        let written = message.to_payload();
        assert_eq!(&written[..payload.len()], payload);
        assert!(written[payload.len()..].iter().all(|byte| *byte == 0));
        assert_eq!(Message::parse(&written), Ok(Received::Exchange(message)));
    }
    if let Ok(text) = core::str::from_utf8(payload)
        && let Ok(code) = PairingCode::parse(text)
    {
        assert_eq!(
            *PairingCode::parse(&code.text()).unwrap().text(),
            *code.text()
        );
    }
});
