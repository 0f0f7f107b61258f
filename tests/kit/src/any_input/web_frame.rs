//! Any text as a frame of a web client: nothing panics, a frame that its key has not sealed has no effect, and one
//! that it has counts once.

use std::time::Duration;

use stanag_msgs::guard::{Direction, GuardKey, Opening, SealedText};
use stanag_msgs::{Id, frames};
use vsm::session::web::{Hello, Request, WebEnd, WebRefusal};

const OPENING: Opening = Opening {
    vsm: Id(1),
    cucs: Id(2),
    of_vsm: [3; 32],
    of_client: [4; 32],
};

/// Reads the bytes as a frame, and as the content of a frame that a client has sealed.
///
/// # Panics
/// A promise is broken.
pub fn run(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let _ = Hello::parse(&text, OPENING.vsm, OPENING.of_vsm);
    let end = || WebEnd::new(GuardKey::new(&[7; 32]).connection(&OPENING), OPENING.cucs);
    let key = GuardKey::new(&[7; 32]).connection(&OPENING);
    if let Some(sealed) = SealedText::parse(&text) {
        assert!(!key.verifies(Direction::ToVsm, &sealed), "a forgery");
    }
    assert!(end().open(Duration::ZERO, &text).is_err());

    let frame = key.seal(Direction::ToVsm, &text);
    let mut end = end();
    let opened = end.open(Duration::ZERO, &frame);
    match &opened {
        Ok(Ok((number, Request::Message(datagram)))) => {
            assert_eq!(*number, 1);
            let frame = frames(datagram).next().expect("a message");
            frame.expect("that can be read");
        }
        Ok(Ok((_, Request::Route(route)))) => assert!(route.stamp < 1 << 40),
        Ok(Err(unusable)) => assert!(unusable.of == 1 && !unusable.why.is_empty()),
        Err(why) => assert!(!why.name().is_empty()),
    }
    if opened.is_ok() {
        let again = end.open(Duration::ZERO, &frame);
        assert_eq!(again, Err(WebRefusal::Counter));
    }
}
