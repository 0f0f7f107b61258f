use serde_json::json;

use super::*;

const VSM: Id = Id(0x1b00_0001);
const CUCS: Id = Id(0x1b00_00b0);
const OF_VSM: [u8; 32] = [3; 32];

fn key(of_client: u8) -> ConnectionKey {
    let opening = Opening {
        vsm: VSM,
        cucs: CUCS,
        of_vsm: OF_VSM,
        of_client: [of_client; 32],
    };
    GuardKey::new(&[7; 32]).connection(&opening)
}

fn seal(text: &Value) -> String {
    key(4).seal(Direction::ToVsm, &text.to_string())
}

fn end() -> WebEnd {
    WebEnd::new(key(4), CUCS)
}

fn heartbeat(n: u64) -> Value {
    json!({ "n": n, "message": { "id": 16002, "destination": "1b:00:00:01", "fields": { "Time Stamp": 5 } } })
}

#[test]
fn a_hello_verifies_under_the_key_and_the_random_bytes_it_was_sealed_with() {
    let hello = |random: &str, cucs: &str| {
        seal(&json!({ "n": 0, "hello": { "version": 1, "cucs": cucs, "random": random } }))
    };
    let frame = hello(&"04".repeat(32), "1b:00:00:b0");
    let read = Hello::parse(&frame, VSM, OF_VSM).expect("a hello");
    assert_eq!(read.cucs(), CUCS);
    assert!(read.verify(&GuardKey::new(&[7; 32])).is_some());
    assert!(read.verify(&GuardKey::new(&[8; 32])).is_none());
    // A recording of it: the VSM has sent other bytes.
    let again = Hello::parse(&frame, VSM, [9; 32]).expect("a hello");
    assert!(again.verify(&GuardKey::new(&[7; 32])).is_none());
    // In another name.
    let other = hello(&"04".repeat(32), "1b:00:00:b1");
    let other = Hello::parse(&other, VSM, OF_VSM).expect("a hello");
    assert!(other.verify(&GuardKey::new(&[7; 32])).is_none());

    for (frame, why) in [
        (hello(&"04".repeat(31), "1b:00:00:b0"), WebRefusal::Form),
        (hello(&"0G".repeat(32), "1b:00:00:b0"), WebRefusal::Form),
        (hello(&"04".repeat(32), "1b:00:00"), WebRefusal::Form),
        (
            hello(&"04".repeat(32), &"x".repeat(MAX_HELLO)),
            WebRefusal::TooLarge,
        ),
        (seal(&heartbeat(0)), WebRefusal::Form),
        ("{}".to_owned(), WebRefusal::Form),
        (String::new(), WebRefusal::Form),
    ] {
        let fault = Hello::parse(&frame, VSM, OF_VSM).err();
        assert_eq!(fault, Some(why), "{frame:.120}");
    }
}

#[test]
fn a_frame_counts_once_in_its_turn_and_in_its_connection() {
    let mut end = end();
    let now = Duration::ZERO;
    let first = seal(&heartbeat(1));
    assert!(matches!(
        end.open(now, &first),
        Ok(Ok((1, Request::Message(_))))
    ));
    assert_eq!(end.open(now, &first), Err(WebRefusal::Counter), "again");
    let skipped = seal(&heartbeat(3));
    assert_eq!(end.open(now, &skipped), Err(WebRefusal::Counter));
    let foreign = key(5).seal(Direction::ToVsm, &heartbeat(2).to_string());
    assert_eq!(
        end.open(now, &foreign),
        Err(WebRefusal::Mac),
        "of another connection"
    );
    let sent_back = key(4).seal(Direction::ToCucs, &heartbeat(2).to_string());
    assert_eq!(end.open(now, &sent_back), Err(WebRefusal::Mac));
    let mut changed = seal(&heartbeat(2));
    changed = changed.replace("16002", "16003");
    assert_eq!(end.open(now, &changed), Err(WebRefusal::Mac));
    assert!(
        matches!(end.open(now, &seal(&heartbeat(2))), Ok(Ok(_))),
        "nothing of these has counted"
    );
    let long = "x".repeat(MAX_FRAME + 1);
    assert_eq!(end.open(now, &long), Err(WebRefusal::TooLarge));
    let upper = seal(&heartbeat(3)).to_uppercase();
    assert_eq!(
        end.open(now, &upper),
        Err(WebRefusal::Form),
        "one way to write it"
    );
    let no_json = key(4).seal(Direction::ToVsm, "hello");
    assert_eq!(end.open(now, &no_json), Err(WebRefusal::Form));
}

#[test]
fn a_flood_ends_and_a_pace_below_it_does_not() {
    let mut steady = end();
    for n in 1..3_000 {
        let now = Duration::from_millis(2 * n);
        assert!(steady.open(now, &seal(&heartbeat(n))).is_ok(), "{n}");
    }
    let mut flooded = end();
    let refused = (1..3_000).find(|n| {
        let opened = flooded.open(Duration::ZERO, &seal(&heartbeat(*n)));
        opened == Err(WebRefusal::Flood)
    });
    assert_eq!(refused, Some(1_001));
}

#[test]
fn what_verifies_and_cannot_be_used_is_answered_with_what_was_expected() {
    let message = |message: Value| json!({ "message": message });
    for (body, expected) in [
        (json!({}), "either message or route"),
        (
            json!({ "message": {}, "route": {} }),
            "either message or route",
        ),
        (message(json!(5)), "expected an object"),
        (
            message(json!({ "id": 16002, "fields": {} })),
            "destination is missing",
        ),
        (
            message(json!({ "id": 9, "destination": 1, "fields": {} })),
            "message",
        ),
        (
            message(json!({ "id": 16002, "destination": 1, "idd": "2.5", "fields": {} })),
            "Edition 4",
        ),
        (
            message(
                json!({ "id": 2016, "destination": 1, "fields": { "Commanded Speed": "fast" } }),
            ),
            "Commanded Speed",
        ),
        (
            json!({ "route": { "vehicle": "1b:00:01:01", "file": "a.kml", "stamp": 1 } }),
            "either text or base64",
        ),
        (
            json!({ "route": { "vehicle": "uav", "file": "a.kml", "stamp": 1, "text": "" } }),
            "vehicle",
        ),
        (
            json!({ "route": { "vehicle": "1b:00:01:01", "file": "a.kmz", "stamp": 1, "base64": "*" } }),
            "base64",
        ),
        (
            json!({ "route": { "vehicle": "1b:00:01:01", "file": "a.kml", "stamp": 1_u64 << 41, "text": "" } }),
            "ms since 2000",
        ),
    ] {
        let mut end = end();
        let mut body = body;
        body["n"] = 1.into();
        let opened = end.open(Duration::ZERO, &seal(&body)).expect("it verifies");
        let Err(Unusable { of: 1, why }) = opened else {
            panic!("{body}: {opened:?}");
        };
        assert!(why.contains(expected), "{body}: {why}");
        assert!(
            end.open(Duration::ZERO, &seal(&heartbeat(2))).is_ok(),
            "the connection stays"
        );
    }
}

#[test]
fn the_client_is_the_source_unless_it_names_another_and_what_it_was_sent_it_may_send() {
    let source = |message: Value| {
        let frame = seal(&json!({ "n": 1, "message": message }));
        let opened = end().open(Duration::ZERO, &frame).expect("it verifies");
        let Ok((1, Request::Message(bytes))) = opened else {
            panic!("{opened:?}");
        };
        let frame = stanag_msgs::frames(&bytes)
            .next()
            .expect("one")
            .expect("good");
        frame.header.source
    };
    let heartbeat =
        json!({ "id": 16002, "destination": "1b:00:00:01", "fields": { "Time Stamp": 5 } });
    assert_eq!(source(heartbeat.clone()), CUCS);
    let mut decoded = heartbeat;
    decoded["source"] = "1b:00:00:a0".into();
    decoded["idd"] = 32.into();
    decoded["checksum"] = 3.into();
    decoded["name"] = "Heartbeat".into();
    assert_eq!(source(decoded), Id(0x1b00_00a0), "the bridge refuses it");
}

#[test]
fn what_a_client_is_sent_is_numbered_and_verifies() {
    let mut end = end();
    let why = "because";
    for n in 0..3 {
        let frame = end.seal(&Body::Error { of: 7, why });
        let sealed = SealedText::parse(&frame).expect("a frame");
        assert!(key(4).verifies(Direction::ToCucs, &sealed));
        assert_eq!(
            sealed.text,
            format!(r#"{{"n":{n},"error":{{"of":7,"why":"because"}}}}"#)
        );
    }
}
